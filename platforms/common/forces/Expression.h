#ifndef RIGIDHI_EXPRESSION_H_
#define RIGIDHI_EXPRESSION_H_

#include <memory>
#include <string>
#include <vector>

namespace RigidHIPlugin {

/**
 * A mathematical expression in OpenMM's language, compiled by muParser.
 *
 * The language is exactly that of OpenMM's Custom forces: numbers, names, + - * / ^, unary minus,
 * functions with exactly as many arguments as they have, and definitions after semicolons ("a^2 +
 * b; b = 2*a; a = x"). Each definition may use those to its right. muParser's own grammar differs
 * (-x^2, log, ?:, built-in constants, ...). This class therefore parses the text itself, and gives
 * it to muParser in one unambiguous form with functions of this plugin. It evaluates a definition
 * once, however often the definition is used.
 */
class Expression {
public:
    /**
     * @param text    the expression
     * @param names   names that it may use
     * @param values  the values of these names at every evaluation; must outlive this object
     * @throws OpenMMException with the expression, its error, and the remedy
     */
    Expression(const std::string& text, const std::vector<std::string>& names,
               const double* values);
    ~Expression();
    Expression(Expression&&);
    /** The value at the present values of the names. Does not allocate. */
    double evaluate();
    /** Whether a name (by index) occurs in the evaluated part of the expression. */
    bool uses(int name) const { return used[name]; }
    /** Whether the expression is the number 0, whatever the values. */
    bool isZero() const { return zero; }

private:
    struct Piece;
    std::vector<std::unique_ptr<Piece>> pieces;  // in the order of evaluation, the result last
    std::vector<bool> used;
    bool zero = false;
};

}  // namespace RigidHIPlugin

#endif
