#include "forces/Expression.h"

#include <muParser.h>
#include <openmm/OpenMMException.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <deque>
#include <map>

using namespace std;

namespace RigidHIPlugin {

namespace {

// What OpenMM's expressions know (Lepton), and muParser calls.
double sec(double x) { return 1 / cos(x); }
double csc(double x) { return 1 / sin(x); }
double cot(double x) { return 1 / tan(x); }
double step(double x) { return x >= 0 ? 1 : 0; }
double delta(double x) { return x == 0 ? 1 : 0; }
double square(double x) { return x * x; }
double cube(double x) { return x * x * x; }
double recip(double x) { return 1 / x; }
double smaller(double x, double y) { return min(x, y); }
double larger(double x, double y) { return max(x, y); }
double select(double x, double y, double z) { return x != 0 ? y : z; }

typedef double (*Function1)(double);
typedef double (*Function2)(double, double);
const map<string, Function1> functions1 = {
    {"sqrt", sqrt},     {"exp", exp},   {"log", log},     {"sin", sin},     {"cos", cos},
    {"sec", sec},       {"csc", csc},   {"tan", tan},     {"cot", cot},     {"asin", asin},
    {"acos", acos},     {"atan", atan}, {"sinh", sinh},   {"cosh", cosh},   {"tanh", tanh},
    {"erf", erf},       {"erfc", erfc}, {"step", step},   {"delta", delta}, {"abs", fabs},
    {"square", square}, {"cube", cube}, {"recip", recip}, {"floor", floor}, {"ceil", ceil}};
const map<string, Function2> functions2 = {{"atan2", atan2}, {"min", smaller}, {"max", larger}};

/** How many arguments a function has; 0: there is none of that name. */
int numArguments(const string& function) {
    return functions1.count(function) ? 1 : functions2.count(function) ? 2 : function == "select" ? 3 : 0;
}

/** Deeper nesting is refused, before it could exhaust the stack. */
const int maximumDepth = 1000;
/** Longer texts are evaluated in pieces: muParser takes up to mu::MaxLenExpression characters. */
const size_t longText = 4000;

bool isSpace(char c) { return isspace(static_cast<unsigned char>(c)) != 0; }
bool isOperator(char c) { return string("+-*/^").find(c) != string::npos; }
bool isDigit(char c) { return c >= '0' && c <= '9'; }

string trimmed(const string& text) {
    size_t first = 0, end = text.size();
    while (first < end && isSpace(text[first])) first++;
    while (end > first && isSpace(text[end - 1])) end--;
    return text.substr(first, end - first);
}

struct Token {
    enum Kind { Number, Name, Function, Operator, Open, Close, Comma, End } kind;
    string text;
};

/** Part of an expression. */
struct Node {
    enum Kind { Number, Name, Definition, Negation, Function, Chain };
    explicit Node(Kind kind) : kind(kind) {}
    Kind kind;
    double value = 0;      // Number
    string name;           // Name, Function; Chain: its operators, applied from left to right
    int definition = -1;   // Definition
    vector<int> operands;  // indices of nodes
};

/** The grammar of OpenMM's parser. */
class Parser {
public:
    explicit Parser(const string& text) : text(text) {
        // The last definition comes first: each may use those to its right.
        string primary = text;
        for (size_t at = primary.find_last_of(';'); at != string::npos; at = primary.find_last_of(';')) {
            const string piece = trimmed(primary.substr(at + 1));
            primary = primary.substr(0, at);
            if (piece.empty()) continue;
            const size_t equals = piece.find('=');
            const string name = equals == string::npos ? "" : trimmed(piece.substr(0, equals));
            if (name.empty())
                fail("the definition '" + piece + "' does not name what it defines",
                     "after a semicolon there must be 'name = expression'", "write it so");
            const int root = parse(piece.substr(equals + 1));
            definitions.push_back(root);
            definitionOfName[name] = definitions.size() - 1;
        }
        root = parse(primary);
    }

    [[noreturn]] void fail(const string& problem, const string& bound, const string& remedy) const {
        const string where = "expression \"" + text + "\": ";
        throw OpenMM::OpenMMException(where + problem + "; " + bound + ": " + remedy);
    }

    vector<Node> nodes;
    vector<int> definitions;  // their roots
    map<string, int> definitionOfName;
    int root;

private:
    int parse(const string& part) {
        tokenize(part);
        at = depth = 0;
        const int result = parsePrecedence(0);
        if (tokens[at].kind != Token::End)
            fail("unexpected '" + tokens[at].text + "'", "an expression must end or go on with an operator there",
                 "add the operator that is missing, or remove the rest");
        return result;
    }

    void tokenize(const string& part) {
        tokens.clear();
        for (size_t i = 0; i < part.size();) {
            const char c = part[i];
            const size_t start = i++;
            Token::Kind kind = Token::Name;
            if (isSpace(c)) continue;
            if (c == '(' || c == ')' || c == ',')
                kind = c == '(' ? Token::Open : c == ')' ? Token::Close : Token::Comma;
            else if (isOperator(c))
                kind = Token::Operator;
            else if (c == '.' || isDigit(c)) {
                kind = Token::Number;
                bool hasExponent = false;
                for (; i < part.size(); i++) {
                    const bool isE = (part[i] == 'e' || part[i] == 'E') && !hasExponent;
                    if (!isDigit(part[i]) && part[i] != '.' && !isE) break;
                    hasExponent = hasExponent || isE;
                    if (isE && i + 1 < part.size() && (part[i + 1] == '-' || part[i + 1] == '+')) i++;
                }
            } else {
                while (i < part.size() && !isOperator(part[i]) && !isSpace(part[i]) &&
                       string("(),").find(part[i]) == string::npos)
                    i++;
                // A function and its parenthesis are one, with no space between them.
                if (i < part.size() && part[i] == '(') {
                    tokens.push_back({Token::Function, part.substr(start, i - start)});
                    i++;
                    continue;
                }
            }
            tokens.push_back({kind, part.substr(start, i - start)});
        }
        tokens.push_back({Token::End, "end"});
    }

    int add(const Node& node) {
        nodes.push_back(node);
        return nodes.size() - 1;
    }

    static int precedence(char op) { return op == '^' ? 3 : op == '*' || op == '/' ? 1 : 0; }

    int parsePrecedence(int lowest) {
        if (++depth > maximumDepth)
            fail("it is nested deeper than " + to_string(maximumDepth) + " levels",
                 "no more parentheses, functions or powers can be inside one another",
                 "use definitions after semicolons");
        const int first = parseOperand();
        Node chain(Node::Chain);
        while (tokens[at].kind == Token::Operator) {
            const char op = tokens[at].text[0];
            if (precedence(op) < lowest) break;
            at++;
            if (chain.operands.empty()) chain.operands = {first};
            chain.operands.push_back(parsePrecedence(op == '^' ? precedence(op) : precedence(op) + 1));
            chain.name += op;
        }
        depth--;
        return chain.operands.empty() ? first : add(chain);
    }

    int parseOperand() {
        const Token token = tokens[at];
        if (token.kind == Token::End)
            fail("it ends too early", "an operand must follow there", "complete it, or write 0");
        at++;
        if (token.kind == Token::Number) {
            Node node(Node::Number);
            const char* end = token.text.data() + token.text.size();
            const auto parsed = from_chars(token.text.data(), end, node.value);
            if (parsed.ec != errc() || parsed.ptr != end)
                fail("'" + token.text + "' is no number", "a number looks like 1, 0.5 or 6.02e23", "correct it");
            return add(node);
        }
        if (token.kind == Token::Name) {
            const auto found = definitionOfName.find(token.text);
            Node node(found == definitionOfName.end() ? Node::Name : Node::Definition);
            node.name = token.text;
            if (found != definitionOfName.end()) node.definition = found->second;
            return add(node);
        }
        if (token.kind == Token::Open) {
            const int result = parsePrecedence(0);
            closeParenthesis();
            return result;
        }
        if (token.kind == Token::Function) {
            Node node(Node::Function);
            node.name = token.text;
            for (bool more = true; more;) {
                node.operands.push_back(parsePrecedence(0));
                more = tokens[at].kind == Token::Comma;
                if (more) at++;
            }
            closeParenthesis();
            const int expected = numArguments(node.name), given = node.operands.size();
            if (expected == 0) {
                string known = "select";
                for (const auto& f : functions1) known += ", " + f.first;
                for (const auto& f : functions2) known += ", " + f.first;
                fail("there is no function '" + node.name + "'", "there are " + known,
                     "write the operator * if a product is meant");
            }
            if (given != expected)
                fail("function '" + node.name + "' has " + to_string(given) + " arguments",
                     "it takes " + to_string(expected), "write that many arguments");
            return add(node);
        }
        if (token.kind == Token::Operator && token.text == "-") {
            Node node(Node::Negation);
            node.operands = {parsePrecedence(2)};
            return add(node);
        }
        fail("unexpected '" + token.text + "'", "a number, a name, a function, '(' or '-' must stand there",
             "correct it there");
    }

    void closeParenthesis() {
        if (tokens[at].kind != Token::Close)
            fail("a parenthesis is not closed before '" + tokens[at].text + "'", "each '(' needs its ')'", "add it");
        at++;
    }

    const string text;
    vector<Token> tokens;
    size_t at = 0;
    int depth = 0;
};

}  // namespace

/** One text for muParser, and where its value goes. */
struct Expression::Piece {
    mu::Parser parser;
    double result = 0;
};

namespace {

/** Writes what the parser found for muParser. */
template <class Piece>
class Compiler {
public:
    Compiler(const Parser& parser, const vector<string>& names, const double* values,
             vector<unique_ptr<Piece> >& pieces, vector<bool>& used)
        : parser(parser), names(names), values(values), pieces(pieces), used(used),
          pieceOfDefinition(parser.definitions.size(), -1) {}

    /** Add a piece that computes a text. @return its index */
    int addPiece(const string& text) {
        unique_ptr<Piece> piece(new Piece());
        mu::Parser& p = piece->parser;
        for (const auto& f : functions1) p.DefineFun("f_" + f.first, f.second);
        for (const auto& f : functions2) p.DefineFun("f_" + f.first, f.second);
        p.DefineFun("f_select", select);
        // muParser only reads through these pointers: there are no assignments.
        for (size_t i = 0; i < names.size(); i++)
            if (used[i]) p.DefineVar("v" + to_string(i), const_cast<double*>(values + i));
        for (size_t i = 0; i < constants.size(); i++) p.DefineConst("c" + to_string(i), constants[i]);
        for (size_t i = 0; i < pieces.size(); i++) p.DefineVar("p" + to_string(i), &pieces[i]->result);
        p.SetExpr(text);
        piece->result = p.Eval();
        pieces.push_back(move(piece));
        return pieces.size() - 1;
    }

    string write(int index) {
        const Node& node = parser.nodes[index];
        string result;
        switch (node.kind) {
            case Node::Number: constants.push_back(node.value); return "c" + to_string(constants.size() - 1);
            case Node::Name: return "v" + to_string(findName(node.name));
            case Node::Definition: {
                int& piece = pieceOfDefinition[node.definition];
                if (piece < 0) piece = addPiece(write(parser.definitions[node.definition]));
                return "p" + to_string(piece);
            }
            case Node::Negation: result = "(-" + write(node.operands[0]) + ")"; break;
            case Node::Function:
                for (int operand : node.operands) result += (result.empty() ? "" : ",") + write(operand);
                result = "f_" + node.name + "(" + result + ")";
                break;
            case Node::Chain:
                result = write(node.operands[0]);
                for (size_t i = 0; i < node.name.size(); i++) {
                    result = "(" + result + node.name[i] + write(node.operands[i + 1]) + ")";
                    if (result.size() > longText) result = "p" + to_string(addPiece(result));
                }
        }
        if (result.size() > longText) result = "p" + to_string(addPiece(result));
        return result;
    }

private:
    int findName(const string& name) {
        const auto found = find(names.begin(), names.end(), name);
        if (found == names.end()) {
            string known;
            for (const string& n : names) known += (known.empty() ? "" : ", ") + n;
            if (parser.definitionOfName.count(name))
                parser.fail("'" + name + "' is defined by way of itself, or used to the right of its definition",
                            "a definition may use only definitions that stand to its right", "reorder them");
            parser.fail("there is no variable or parameter '" + name + "'", "there are " + known,
                        "correct the name, or add a parameter or a definition of this name");
        }
        used[found - names.begin()] = true;
        return found - names.begin();
    }

    const Parser& parser;
    const vector<string>& names;
    const double* values;
    vector<unique_ptr<Piece> >& pieces;
    vector<bool>& used;
    vector<int> pieceOfDefinition;
    vector<double> constants;
};

}  // namespace

Expression::Expression(const string& text, const vector<string>& names, const double* values)
    : used(names.size(), false) {
    const Parser parser(text);
    Compiler<Piece> compiler(parser, names, values, pieces, used);
    try {
        compiler.addPiece(compiler.write(parser.root));
    } catch (const mu::Parser::exception_type& error) {
        parser.fail("muParser: " + error.GetMsg(), "it must take what our own parser takes", "report this text");
    }
    zero = find(used.begin(), used.end(), true) == used.end() && evaluate() == 0;
}

Expression::~Expression() {}
Expression::Expression(Expression&&) = default;

double Expression::evaluate() {
    for (auto& piece : pieces) piece->result = piece->parser.Eval();
    return pieces.back()->result;
}

}  // namespace RigidHIPlugin
