#ifndef RIGIDHI_LINE_H_
#define RIGIDHI_LINE_H_

#include <string>
#include <vector>

namespace RigidHIPlugin {

/**
 * The operations of a formula of this plugin, in their order: a program without branches and loops.
 * textOf() prints it as kernel text, and runOnHost() runs it.
 */
class Program {
public:
    enum Operation {
        Input,
        Constant,
        Add,
        Subtract,
        Multiply,
        Divide,
        Root,
        Maximum,
        Sine,
        Cosine
    };
    struct Step {
        Operation operation;
        int a = -1, b = -1;  // earlier steps
        double value = 0;    // of a constant
        std::string name;    // of an input
    };
    int add(const Step& step) {
        steps.push_back(step);
        return steps.size() - 1;
    }
    void setOutput(const std::string& name, int step) { outputs.push_back({name, step}); }
    const std::vector<Step>& getSteps() const { return steps; }
    /** Names of variables, and the steps whose results they get. */
    const std::vector<std::pair<std::string, int>>& getOutputs() const { return outputs; }

    /**
     * The answer to all comparisons. A formula without branches has the same text for all numbers.
     * A formula that asks which of two numbers is greater is traced once for each answer.
     */
    bool greater = true;
    bool compare(int a, int b) {
        comparisons.push_back({a, b});
        return greater;
    }
    const std::vector<std::pair<int, int>>& getComparisons() const { return comparisons; }
    /** The same steps with other results. */
    Program withOutputs(const std::vector<std::pair<std::string, int>>& wanted) const {
        Program other = *this;
        other.outputs = wanted;
        return other;
    }

    /** The program that lines are written to at present, in this thread. */
    static Program*& current() {
        static thread_local Program* program = nullptr;
        return program;
    }

private:
    std::vector<Step> steps;
    std::vector<std::pair<std::string, int>> outputs;
    std::vector<std::pair<int, int>> comparisons;
};

/**
 * A number type like `double` and packs of bodies, but its operations are recorded in the current
 * program. The formulas that run on the host thus give the text of the kernels on a device, and no
 * formula is written twice.
 */
class Line {
public:
    Line() = default;
    Line(double constant)
        : step(Program::current()->add({Program::Constant, -1, -1, constant, {}})) {}
    /** A variable of the kernel. */
    static Line input(const std::string& name) { return make({Program::Input, -1, -1, 0, name}); }
    static Line of(Program::Operation operation, const Line& a) {
        return make({operation, a.step, -1, 0, {}});
    }
    static Line of(Program::Operation operation, const Line& a, const Line& b) {
        return make({operation, a.step, b.step, 0, {}});
    }
    /** Give the result to a variable of the kernel. */
    void output(const std::string& name) const { Program::current()->setOutput(name, step); }

    friend Line operator+(const Line& a, const Line& b) { return of(Program::Add, a, b); }
    friend Line operator-(const Line& a, const Line& b) { return of(Program::Subtract, a, b); }
    friend Line operator*(const Line& a, const Line& b) { return of(Program::Multiply, a, b); }
    friend Line operator/(const Line& a, const Line& b) { return of(Program::Divide, a, b); }
    /** Record the comparison, and give the answer for which the formula is traced. */
    friend bool allGreater(const Line& a, const Line& b) {
        return Program::current()->compare(a.step, b.step);
    }

private:
    static Line make(const Program::Step& step) {
        Line line;
        line.step = Program::current()->add(step);
        return line;
    }
    int step = -1;
};

// The functions that formulas need of a number type, found by the type of their argument.
inline void sincos(const Line& x, Line& sine, Line& cosine) {
    sine = Line::of(Program::Sine, x);
    cosine = Line::of(Program::Cosine, x);
}
inline Line squareRoot(const Line& x) { return Line::of(Program::Root, x); }
inline Line maximum(const Line& a, const Line& b) { return Line::of(Program::Maximum, a, b); }
// Where the device can, compilers of kernels fuse these operations, with one rounding.
inline Line multiplyAdd(const Line& a, const Line& b, const Line& c) { return a * b + c; }
inline Line negativeMultiplyAdd(const Line& a, const Line& b, const Line& c) { return c - a * b; }
inline Line multiplySubtract(const Line& a, const Line& b, const Line& c) { return a * b - c; }
inline Line selectGreater(const Line& a, const Line& b, const Line& x, const Line& y) {
    return allGreater(a, b) ? x : y;
}

}  // namespace RigidHIPlugin

#endif
