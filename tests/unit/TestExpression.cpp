// Expressions are those of OpenMM's Custom forces: they have the same values, and reject the same
// texts.

#include <openmm/CustomExternalForce.h>
#include <openmm/VerletIntegrator.h>

#include <iostream>
#include <memory>

#include "TestSupport.h"
#include "forces/Expression.h"

using namespace OpenMM;
using namespace RigidHITest;
using RigidHIPlugin::Expression;
using namespace std;

namespace {

const vector<string> names = {"x", "y", "z", "k", "long_name2"};

/** OpenMM's value of an expression. */
double openmmValue(const string& text, const vector<double>& values) {
    System system;
    system.addParticle(1);
    auto* force = new CustomExternalForce(text);
    system.addForce(force);
    for (size_t i = 3; i < names.size(); i++) force->addPerParticleParameter(names[i]);
    force->addParticle(0, vector<double>(values.begin() + 3, values.end()));
    VerletIntegrator integrator(0.001);
    Context context(system, integrator, platform("Reference"));
    context.setPositions({Vec3(values[0], values[1], values[2])});
    return context.getState(State::Energy).getPotentialEnergy();
}

double ourValue(const string& text, const vector<double>& values) {
    return Expression(text, names, values.data()).evaluate();
}

void expectSame(const string& text, const vector<double>& values) {
    const double expected = openmmValue(text, values), value = ourValue(text, values);
    if (std::isnan(expected))
        EXPECT_TRUE(std::isnan(value)) << text << ": " << value;
    else if (std::isinf(expected))
        EXPECT_EQ(value, expected) << text;
    else
        EXPECT_NEAR(value, expected, 1e-13 * max(1.0, abs(expected))) << text;
}

const vector<vector<double>> points = {
    {0.3, -1.7, 2.4, 0.5, -3}, {0, 0, 1, 1, 2}, {-2, 0.25, -0.1, 3, 1e-3}, {1, 2, 3, -1, 0}};

}  // namespace

TEST(Expression, HasTheValuesOfOpenMM) {
    for (const string text :
         {"0", "1", "x", "1.", ".5", "1e3", "1E-3", "2.5e+2", "x+y", "x-y", "x*y", "x/z", "x-y-z",
          "x/z/k", "x-y+z", "x/z*k", "2^3^2", "(2^3)^2", "-x^2", "-2^2", "(-2)^2", "2^-1", "2^-x",
          "2^-x^2", "-x^-2", "z^2", "z^3", "z^-3", "z^0.5", "z^y", "x*-y", "x--y", "x - -y", "--x",
          "---x", "-(x)", "x^0", "0^0", "x+y*z", "(x+y)*z", "x*y+z*k", "x*y^2*z", "-x*y", "-x+y",
          "x/-z", " x +\ty\n* z ", "((x))", "1/x", "-1/x", "x/0", "sqrt(z*z)", "exp(x)", "log(z*z)",
          "log(10)", "log(0)", "sin(x)", "cos(x)", "sec(x)", "csc(y+3)", "tan(x)", "cot(y+3)",
          "asin(x/5)", "acos(x/5)", "atan(x)", "atan2(x,y)", "atan2(y, x)", "sinh(x)", "cosh(x)",
          "tanh(x)", "erf(x)", "erfc(x)", "step(x)", "step(-x)", "step(0)", "delta(x)", "delta(1)",
          "square(x)", "cube(x)", "recip(z)", "min(x,y)", "max(x,y)", "max(x, min(y, z))", "abs(x)",
          "floor(x)", "ceil(x)", "floor(-0.5)", "ceil(-1.5)", "select(x,y,z)", "select(0,y,z)",
          "select(step(x), sqrt(y), 1)", "sqrt(-1-z^2)", "sin(cos(tan(x)))", "square(x-1)^2",
          "k*x^2", "0.5*k*((x-1)^2+(y-2)^2)", "long_name2*k", "exp(-x^2/2)/sqrt(2*3.14159265)",
          "x*x", "x+x", "2*x*3", "2*(x*3)", "x*2/3*y", "1-1e-16-x", "1e300*1e300", "x^2-y^2",
          "(x-y)*(x+y)",
          // definitions
          "a; a=x", "a+b; a=x; b=y", "a; a=b; b=x+1", "a*a; a=b*b; b=c*c; c=x", "a;a=x;",
          "a;;a=x;;", "a ; a = x ; ", "x; x=2", "x; x=x+1", "a; a=a+1; a=2", "a; a=1; a=2",
          "x; b=unknown", "sin(a); a=k^b; b=long_name2", "r^2; r=sqrt(x*x+y*y+z*z)", "sin; sin=2",
          "sin(sin); sin=x", "x; 1=2", "x; a b=2", "a.b; a.b=x", "x?y; x?y=2", "x<y; x<y=3",
          "_pi; _pi=3"})
        for (const auto& values : points) expectSame(text, values);
}

TEST(Expression, RefusesWhatOpenMMRefuses) {
    const vector<string> texts = {"",
                                  " ",
                                  ";",
                                  "x+",
                                  "*x",
                                  "+x",
                                  "x y",
                                  "2x",
                                  "2 x",
                                  "x 2",
                                  "(x",
                                  "x)",
                                  "(x))",
                                  "()",
                                  "sin()",
                                  "sin(x",
                                  "sin x",
                                  "sin (x)",
                                  "sin",
                                  "sin(x,y)",
                                  "min(x)",
                                  "min(x,y,z)",
                                  "max()",
                                  "select(x,y)",
                                  "atan2(x)",
                                  "sqrt(x,y)",
                                  "x,y",
                                  ",",
                                  "foo",
                                  "foo(x)",
                                  "x(2)",
                                  "k(x)",
                                  "x^",
                                  "x^*2",
                                  "x**2",
                                  "x//2",
                                  "x%2",
                                  "x!",
                                  "x?1:2",
                                  "x>0",
                                  "x<y",
                                  "x==y",
                                  "x>=0",
                                  "x&&y",
                                  "x||y",
                                  "!x",
                                  "x=2",
                                  "x;y",
                                  "x; =y",
                                  "x; a",
                                  "a; a=",
                                  "a; a=(x",
                                  "a; a=x y",
                                  "a; a=a",
                                  "a; a=b; b=a",
                                  "b; b=a; c=1",
                                  "a; b=a; a=c",
                                  "b; a=x; b=a",
                                  "_pi",
                                  "_e",
                                  "pi",
                                  "e",
                                  "rint(x)",
                                  "sign(x)",
                                  "sum(x,y)",
                                  "avg(x,y)",
                                  "ln(x)",
                                  "log2(x)",
                                  "log10(x)",
                                  "asinh(x)",
                                  "x; a=foo(x)",
                                  "\"x\"",
                                  "1.2.3 x",
                                  "x..y",
                                  "#",
                                  "x$",
                                  "[x]",
                                  "{x}",
                                  "sqrt((x)",
                                  "2(x)",
                                  "(x)(y)",
                                  "(x)y",
                                  "(x)2",
                                  "x; a=sin(x,y)",
                                  "-",
                                  "--",
                                  "x-",
                                  "x'"};
    for (const string& text : texts) {
        EXPECT_THROW(openmmValue(text, points[0]), exception) << "OpenMM takes " << text;
        EXPECT_THROW(ourValue(text, points[0]), OpenMMException) << text;
    }
}

TEST(Expression, IsAtLeastAsStrictAsOpenMM) {
    // OpenMM reads 1e as 0, 1.2.3 as 1.2 and 1e5.5 as 1e5.
    for (const string text : {"1e", "1e+", "1.2.3", "1e5.5", ".", "1e999"})
        expectError([&] { ourValue(text, points[0]); },
                    {"expression \"" + text + "\"", "is no number", "a number looks like 1, 0.5"});
}

/** Random expressions of a grammar that makes all combinations of operators. */
class RandomText {
public:
    explicit RandomText(int seed) : generator(seed) {}
    string operator()(int depth) {
        const int kind = depth == 0 ? pick(4) : pick(14);
        if (kind < 2) return names[pick(names.size())];
        if (kind < 4) return to_string(uniform_real_distribution<double>(0.1, 3)(generator));
        if (kind < 8) return (*this)(depth - 1) + "+-*/"[pick(4)] + (*this)(depth - 1);
        if (kind < 9)
            return (*this)(depth - 1) + "^" +
                   vector<string>{"2", "-1", "2^2", "-2^2", "3"}[pick(5)];
        if (kind < 10) return "-" + (*this)(depth - 1);
        if (kind < 12) return "(" + (*this)(depth - 1) + ")";
        if (kind < 13) {
            const vector<string> functions = {"sin", "cos",  "tanh", "square", "cube",
                                              "abs", "step", "atan", "erf"};
            return functions[pick(functions.size())] + "(" + (*this)(depth - 1) + ")";
        }
        return vector<string>{"min", "max"}[pick(2)] + "(" + (*this)(depth - 1) + "," +
               (*this)(depth - 1) + ")";
    }

private:
    int pick(int count) { return uniform_int_distribution<int>(0, count - 1)(generator); }
    mt19937 generator;
};

TEST(Expression, RandomOnesHaveTheValuesOfOpenMM) {
    RandomText random(11);
    int finite = 0;
    for (int i = 0; i < 1500; i++) {
        const string text = random(4);
        for (const auto& values : {points[0], points[2]}) {
            const double value = ourValue(text, values);
            // Values that are not finite are not compared, because OpenMM simplifies 0*x/0 to 1,
            // and does not return for constants that are NaN. Large values are not compared,
            // because cancellation magnifies rounding.
            if (!isfinite(value) || abs(value) > 1e8) continue;
            const double expected = openmmValue(text, values);
            finite++;
            EXPECT_NEAR(value, expected, 1e-7 * max(1.0, abs(expected))) << text;
        }
    }
    EXPECT_GT(finite, 1500);
}

TEST(Expression, LongAndDeepOnes) {
    vector<double> values = {0.5, 2, 3, 4, 5};
    string sum = "x", nested = "x", sines = "x";
    for (int i = 0; i < 20000; i++) sum += "+y";
    EXPECT_EQ(ourValue(sum, values), 40000.5);
    for (int i = 0; i < 800; i++) {
        nested = "(" + nested + ")";
        sines = "sin(" + sines + ")";
    }
    EXPECT_EQ(ourValue(nested, values), 0.5);
    double expected = values[0];
    for (int i = 0; i < 800; i++) expected = sin(expected);
    EXPECT_EQ(ourValue(sines, values), expected);
    for (int i = 0; i < 800; i++) nested = "(" + nested + ")";
    expectError([&] { ourValue(nested, values); },
                {"nested deeper than 1000 levels", "use definitions"});
    // The value doubles with every definition. Substitution of text would make 2^60 terms.
    string doubling = "a0";
    for (int i = 0; i < 60; i++)
        doubling += "; a" + to_string(i) + "=a" + to_string(i + 1) + "+a" + to_string(i + 1);
    EXPECT_EQ(ourValue(doubling + "; a60=x", values), ldexp(0.5, 60));
}

TEST(Expression, ChainsOfDefinitionsMayBeLong) {
    // Each definition uses the next one, in one of the possible ways. Neither depth nor time grows
    // faster than the text.
    const int links = 15000;
    string counting = "a0", nested = "a0", wide = "0", later;
    for (int i = 0; i < links; i++) {
        const string name = "a" + to_string(i), next = "a" + to_string(i + 1);
        counting += "; " + name + "=" + next + "+1";
        nested += "; " + name + "=max(0, -(-(" + next + "))^1)";
        wide += "+" + name;
        later += "; " + name + "=x*" + to_string(i);
    }
    const string end = "; a" + to_string(links) + "=x";
    const vector<double> values = {0.5, 2, 3, 4, 5};
    EXPECT_EQ(ourValue(counting + end, values), links + 0.5);
    EXPECT_EQ(ourValue(nested + end, values), 0.5);
    EXPECT_EQ(ourValue(wide + later, values), 0.25 * links * (links - 1.0));
    expectError([&] { ourValue(counting, values); }, {"the name 'a15000' is unknown"});
}

TEST(Expression, FollowsItsValuesAndKnowsWhatItUses) {
    vector<double> values = {1, 2, 3, 4, 5};
    Expression e("a*x + 0*y; a=2*z; b=k", names, values.data());
    EXPECT_EQ(e.evaluate(), 6);
    values[0] = 7;
    values[2] = -1;
    EXPECT_EQ(e.evaluate(), -14);
    EXPECT_TRUE(e.uses(0));
    EXPECT_TRUE(e.uses(1));
    EXPECT_TRUE(e.uses(2));
    EXPECT_FALSE(e.uses(3)) << "its definition is not used";
    EXPECT_FALSE(e.isZero());
    EXPECT_TRUE(Expression("0", names, values.data()).isZero());
    EXPECT_TRUE(Expression("2*(1-1)", names, values.data()).isZero());
    EXPECT_FALSE(Expression("x-x", names, values.data()).isZero());
}

TEST(Expression, ErrorsNameWhatIsWrong) {
    const vector<double>& v = points[0];
    const vector<pair<string, vector<string>>> cases = {
        {"x+foo",
         {"the name 'foo' is unknown", "the variables and parameters are x, y, z, k, long_name2",
          "correct the name"}},
        {"ln(x)",
         {"the function 'ln' is unknown", "select", "write the operator * if a product is meant"}},
        {"min(x)", {"function 'min' has 1 arguments", "the function takes 2"}},
        {"(x+1", {"a parenthesis is not closed before 'end'", "each '(' needs its ')'"}},
        {"x+", {"it ends too early", "an operand must follow"}},
        {"x y", {"unexpected 'y'", "must end or go on with an operator"}},
        {"+x", {"unexpected '+'", "or '-' must stand there"}},
        {"a; a", {"the definition 'a' does not name what it defines"}},
        {"a; a=b; b=a",
         {"'a' is defined in terms of itself, or used to the right", "reorder them"}},
    };
    for (const auto& c : cases) {
        vector<string> fragments = c.second;
        fragments.push_back("expression \"" + c.first + "\"");
        expectError([&] { ourValue(c.first, v); }, fragments);
    }
}
