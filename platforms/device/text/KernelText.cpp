#include "text/KernelText.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <iomanip>
#include <locale>
#include <sstream>
#include <stdexcept>

using namespace std;

namespace RigidHIPlugin {

Program trace(const function<void()>& formula, bool greater) {
    Program program;
    program.greater = greater;
    Program* const before = Program::current();
    Program::current() = &program;
    formula();
    Program::current() = before;
    return program;
}

namespace {

/** Seventeen digits give the same double when read. The classic locale avoids a decimal comma. */
string literal(double value, const NumberType& type) {
    if (value != 0 && std::abs(value) < type.least) value = copysign(type.least, value);
    ostringstream text;
    text.imbue(locale::classic());
    text << setprecision(17) << value;
    const bool isInteger = text.str().find_first_of(".e") == string::npos;
    return "(" + type.name + ") " + text.str() + (isInteger ? ".0" : "");
}

string name(int step) { return "t" + to_string(step); }

}  // namespace

string textOf(const Program& program, const NumberType& type) {
    const auto& steps = program.getSteps();
    // Leave out unused steps. Compilers would drop them, but people read the text too.
    vector<bool> isUsed(steps.size(), false);
    for (const auto& output : program.getOutputs()) isUsed[output.second] = true;
    for (int i = steps.size() - 1; i >= 0; i--)
        for (int argument : {steps[i].a, steps[i].b})
            if (isUsed[i] && argument >= 0) isUsed[argument] = true;
    const auto operand = [&](int i) {
        const string& input = steps[i].name;
        return steps[i].operation == Program::Input
                   ? (type.convertsInputs ? "((" + type.name + ") " + input + ")" : input)
               : steps[i].operation == Program::Constant ? literal(steps[i].value, type)
                                                         : name(i);
    };
    string text = "{\n";
    for (size_t i = 0; i < steps.size(); i++) {
        const Program::Step& step = steps[i];
        if (!isUsed[i] || step.operation == Program::Input || step.operation == Program::Constant)
            continue;
        const string a = operand(step.a), b = step.b < 0 ? "" : operand(step.b);
        // Both functions of an angle together take little longer than one of them.
        if (step.operation == Program::Sine && i + 1 < steps.size() && isUsed[i + 1] &&
            steps[i + 1].operation == Program::Cosine && steps[i + 1].a == step.a) {
            text += type.name + " " + name(i) + ", " + name(i + 1) + ";\nsineAndCosine(" + a +
                    ", &" + name(i) + ", &" + name(i + 1) + ");\n";
            i++;
            continue;
        }
        text += "const " + type.name + " " + name(i) + " = ";
        switch (step.operation) {
            case Program::Add:
                text += type.exact ? "exactSum(" + a + ", " + b + ")" : a + " + " + b;
                break;
            case Program::Subtract:
                text += type.exact ? "exactSum(" + a + ", -" + b + ")" : a + " - " + b;
                break;
            case Program::Multiply:
                text += type.exact ? "exactProduct(" + a + ", " + b + ")" : a + "*" + b;
                break;
            case Program::Divide: text += a + "/" + b; break;
            case Program::Root: text += "sqrt(" + a + ")"; break;
            case Program::Maximum: text += "fmax(" + a + ", " + b + ")"; break;
            case Program::Sine: text += "sin(" + a + ")"; break;
            case Program::Cosine: text += "cos(" + a + ")"; break;
            case Program::Input:
            case Program::Constant: break;
        }
        text += ";\n";
    }
    // A variable may be an input and an output, so read all outputs before any is assigned.
    for (const auto& output : program.getOutputs())
        text +=
            "const " + type.name + " new_" + output.first + " = " + operand(output.second) + ";\n";
    for (const auto& output : program.getOutputs())
        text += output.first + " = new_" + output.first + ";\n";
    return text + "}\n";
}

string replaceWords(const string& text, const map<string, string>& replacements) {
    const auto isPart = [](char c) { return isalnum(static_cast<unsigned char>(c)) || c == '_'; };
    string result;
    for (size_t i = 0; i < text.size();) {
        size_t end = i;
        while (end < text.size() && isPart(text[end])) end++;
        const string word = text.substr(i, max(end, i + 1) - i);
        const auto found = replacements.find(word);
        result += found == replacements.end() ? word : found->second;
        i += word.size();
    }
    return result;
}

string KernelProgram::whole() const {
    string text;
    for (const auto& d : defines) text += "#define " + d.first + " " + d.second + "\n";
    return text + source;
}

void runOnHost(const Program& program, map<string, double>& values) {
    vector<double> results;
    for (const Program::Step& step : program.getSteps()) {
        const double a = step.a < 0 ? 0 : results[step.a], b = step.b < 0 ? 0 : results[step.b];
        switch (step.operation) {
            case Program::Input: results.push_back(values.at(step.name)); break;
            case Program::Constant: results.push_back(step.value); break;
            case Program::Add: results.push_back(a + b); break;
            case Program::Subtract: results.push_back(a - b); break;
            case Program::Multiply: results.push_back(a * b); break;
            case Program::Divide: results.push_back(a / b); break;
            case Program::Root: results.push_back(std::sqrt(a)); break;
            case Program::Maximum: results.push_back(a > b ? a : b); break;
            case Program::Sine: results.push_back(std::sin(a)); break;
            case Program::Cosine: results.push_back(std::cos(a)); break;
        }
    }
    for (const auto& output : program.getOutputs()) values[output.first] = results[output.second];
}

}  // namespace RigidHIPlugin
