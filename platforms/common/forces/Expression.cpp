#include "forces/Expression.h"

#include <muParser.h>
#include <openmm/OpenMMException.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <map>
#include <string_view>

using namespace std;

namespace RigidHIPlugin {

namespace {

// The functions of OpenMM's expressions (Lepton), which muParser calls.
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

using Function1 = double (*)(double);
using Function2 = double (*)(double, double);
const map<string, Function1> functions1 = {
    {"sqrt", sqrt},     {"exp", exp},   {"log", log},     {"sin", sin},     {"cos", cos},
    {"sec", sec},       {"csc", csc},   {"tan", tan},     {"cot", cot},     {"asin", asin},
    {"acos", acos},     {"atan", atan}, {"sinh", sinh},   {"cosh", cosh},   {"tanh", tanh},
    {"erf", erf},       {"erfc", erfc}, {"step", step},   {"delta", delta}, {"abs", fabs},
    {"square", square}, {"cube", cube}, {"recip", recip}, {"floor", floor}, {"ceil", ceil}};
const map<string, Function2> functions2 = {{"atan2", atan2}, {"min", smaller}, {"max", larger}};

/** The number of arguments of a function; 0 for an unknown name. */
int numArguments(const string& function) {
    return functions1.count(function)   ? 1
           : functions2.count(function) ? 2
           : function == "select"       ? 3
                                        : 0;
}

/** The parser refuses deeper nesting, before it can exhaust the stack. */
const int maximumDepth = 1000;
/** muParser gets longer texts in pieces. It takes up to mu::MaxLenExpression characters. */
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
        // The last definition comes first, because each may use the definitions to its right.
        string_view rest = this->text;
        for (size_t at = rest.rfind(';'); at != string::npos; at = rest.rfind(';')) {
            const string piece = trimmed(string(rest.substr(at + 1)));
            rest = rest.substr(0, at);
            if (piece.empty()) continue;
            const size_t equals = piece.find('=');
            const string name = equals == string::npos ? "" : trimmed(piece.substr(0, equals));
            if (name.empty())
                fail("the definition '" + piece + "' does not name what it defines",
                     "a definition after a semicolon has the form 'name = expression'");
            const int root = parse(piece.substr(equals + 1));
            definitions.push_back(root);
            definitionOfName[name] = definitions.size() - 1;
        }
        root = parse(string(rest));
    }

    /** @param remedy  may be empty where the bound already says what to do */
    [[noreturn]] void fail(const string& problem, const string& bound,
                           const string& remedy = "") const {
        const string where = "expression \"" + text + "\": ";
        throw OpenMM::OpenMMException(where + problem + "; " + bound +
                                      (remedy.empty() ? "" : ": " + remedy));
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
            fail("unexpected '" + tokens[at].text + "'",
                 "an expression must end or go on with an operator there",
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
                    if (isE && i + 1 < part.size() && (part[i + 1] == '-' || part[i + 1] == '+'))
                        i++;
                }
            } else {
                while (i < part.size() && !isOperator(part[i]) && !isSpace(part[i]) &&
                       string("(),").find(part[i]) == string::npos)
                    i++;
                // A function and its parenthesis are one token, with no space between them.
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
            chain.operands.push_back(
                parsePrecedence(op == '^' ? precedence(op) : precedence(op) + 1));
            chain.name += op;
        }
        depth--;
        return chain.operands.empty() ? first : add(chain);
    }

    int parseOperand() {
        const Token token = tokens[at];
        if (token.kind == Token::End)
            fail("it ends too early", "an operand must follow",
                 "complete the expression, or write 0");
        at++;
        if (token.kind == Token::Number) {
            Node node(Node::Number);
            const char* end = token.text.data() + token.text.size();
            const auto parsed = from_chars(token.text.data(), end, node.value);
            if (parsed.ec != errc() || parsed.ptr != end)
                fail("'" + token.text + "' is no number", "a number looks like 1, 0.5 or 6.02e23");
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
                fail("the function '" + node.name + "' is unknown", "the functions are " + known,
                     "write the operator * if a product is meant");
            }
            if (given != expected)
                fail("function '" + node.name + "' has " + to_string(given) + " arguments",
                     "the function takes " + to_string(expected));
            return add(node);
        }
        if (token.kind == Token::Operator && token.text == "-") {
            Node node(Node::Negation);
            node.operands = {parsePrecedence(2)};
            return add(node);
        }
        fail("unexpected '" + token.text + "'",
             "a number, a name, a function, '(' or '-' must stand there");
    }

    void closeParenthesis() {
        if (tokens[at].kind != Token::Close)
            fail("a parenthesis is not closed before '" + tokens[at].text + "'",
                 "each '(' needs its ')'", "add the parenthesis");
        at++;
    }

    const string text;
    vector<Token> tokens;
    size_t at = 0;
    int depth = 0;
};

}  // namespace

/** One text for muParser, and the place of its value. */
struct Expression::Piece {
    mu::Parser parser;
    double result = 0;
};

namespace {

/**
 * Writes the parser's result for muParser.
 *
 * A chain of definitions may be as long as memory allows, so the nodes in progress are on an
 * explicit stack. The cost is linear in the text, because the parser of each piece knows only the
 * names that the piece uses.
 */
template <class Piece>
class Compiler {
public:
    Compiler(const Parser& parser, const vector<string>& names, const double* values,
             vector<unique_ptr<Piece>>& pieces, vector<bool>& used)
        : parser(parser), names(names), values(values), pieces(pieces), used(used),
          pieceOfDefinition(parser.definitions.size(), -1) {
        for (size_t i = 0; i < names.size(); i++) indexOfName.emplace(names[i], i);
    }

    /** The last piece becomes the value of the whole expression. */
    void compile() { addPiece(write(parser.root)); }

private:
    /** A node in progress, whose operands are written from left to right. */
    struct Writing {
        explicit Writing(const Node& node) : node(&node) {}
        const Node* node;
        size_t numWritten = 0;
        string text;
    };

    string write(int root) {
        vector<Writing> unfinished = {Writing(parser.nodes[root])};
        while (true) {
            const int operand = nextOperand(unfinished.back());
            if (operand >= 0) {
                unfinished.emplace_back(parser.nodes[operand]);
                continue;
            }
            const string written = finish(unfinished.back());
            unfinished.pop_back();
            if (unfinished.empty()) return written;
            takeOperand(unfinished.back(), written);
        }
    }

    /** The operand to write before the rest of the node, or -1. */
    int nextOperand(const Writing& now) const {
        const Node& node = *now.node;
        if (node.kind == Node::Definition)
            return pieceOfDefinition[node.definition] < 0 ? parser.definitions[node.definition]
                                                          : -1;
        return now.numWritten < node.operands.size() ? node.operands[now.numWritten] : -1;
    }

    void takeOperand(Writing& now, const string& operand) {
        const Node& node = *now.node;
        if (node.kind == Node::Definition)
            pieceOfDefinition[node.definition] = addPiece(operand);
        else if (now.numWritten == 0)
            now.text = operand;
        else if (node.kind == Node::Function)
            now.text += "," + operand;
        else {
            now.text = "(" + now.text + node.name[now.numWritten - 1] + operand + ")";
            shorten(now.text);
        }
        now.numWritten++;
    }

    string finish(Writing& now) {
        const Node& node = *now.node;
        switch (node.kind) {
            case Node::Number:
                constants.push_back(node.value);
                return "c" + to_string(constants.size() - 1);
            case Node::Name: return "v" + to_string(findName(node.name));
            case Node::Definition: return "p" + to_string(pieceOfDefinition[node.definition]);
            case Node::Negation: now.text = "(-" + now.text + ")"; break;
            case Node::Function: now.text = "f_" + node.name + "(" + now.text + ")"; break;
            case Node::Chain: break;
        }
        shorten(now.text);
        return move(now.text);
    }

    void shorten(string& text) {
        if (text.size() > longText) text = "p" + to_string(addPiece(text));
    }

    /** Add a piece that computes a text. @return its index */
    int addPiece(const string& text) {
        auto piece = make_unique<Piece>();
        mu::Parser& p = piece->parser;
        p.ClearFun();
        for (size_t i = 0; i < text.size();) {
            const char kind = text[i];
            const size_t start = i++;
            if (kind == 'f') {
                while (text[i] != '(') i++;
                define(p, text.substr(start, i - start));
            } else if (kind == 'v' || kind == 'c' || kind == 'p') {
                while (i < text.size() && isDigit(text[i])) i++;
                const string name = text.substr(start, i - start);
                const int index = stoi(name.substr(1));
                // muParser only reads through these pointers, because the language has no
                // assignments.
                if (kind == 'v') p.DefineVar(name, const_cast<double*>(values + index));
                if (kind == 'c') p.DefineConst(name, constants[index]);
                if (kind == 'p') p.DefineVar(name, &pieces[index]->result);
            }
        }
        p.SetExpr(text);
        piece->result = p.Eval();
        pieces.push_back(move(piece));
        return pieces.size() - 1;
    }

    void define(mu::Parser& p, const string& function) {
        const string name = function.substr(string("f_").size());
        if (functions1.count(name)) p.DefineFun(function, functions1.at(name));
        if (functions2.count(name)) p.DefineFun(function, functions2.at(name));
        if (name == "select") p.DefineFun(function, select);
    }

    int findName(const string& name) {
        const auto found = indexOfName.find(name);
        if (found == indexOfName.end()) {
            string known;
            for (const string& n : names) known += (known.empty() ? "" : ", ") + n;
            if (parser.definitionOfName.count(name))
                parser.fail(
                    "'" + name +
                        "' is defined in terms of itself, or used to the right of its definition",
                    "a definition may use only definitions that stand to its right",
                    "reorder them");
            parser.fail("the name '" + name + "' is unknown",
                        "the variables and parameters are " + known,
                        "correct the name, or add a parameter or a definition of this name");
        }
        used[found->second] = true;
        return found->second;
    }

    const Parser& parser;
    const vector<string>& names;
    const double* values;
    vector<unique_ptr<Piece>>& pieces;
    vector<bool>& used;
    map<string, int> indexOfName;
    vector<int> pieceOfDefinition;
    vector<double> constants;
};

}  // namespace

Expression::Expression(const string& text, const vector<string>& names, const double* values)
    : used(names.size(), false) {
    const Parser parser(text);
    Compiler<Piece> compiler(parser, names, values, pieces, used);
    try {
        compiler.compile();
    } catch (const mu::Parser::exception_type& error) {
        parser.fail("muParser: " + error.GetMsg(),
                    "muParser must accept each expression that the parser of this plugin accepts",
                    "report this message with the expression");
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
