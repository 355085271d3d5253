// The text of kernels of products, run on the host, gives the same bits as the templates that it
// comes from.

#include <cctype>
#include <random>

#include "TestSupport.h"
#include "mobility/models/wall/RotnePragerYamakawaWall-inl.h"
#include "text/PairText.h"

using namespace RigidHIPlugin;
using namespace RigidHIPlugin::scalar;
using namespace std;

namespace {

using Vector = Vector3<double>;
using Values = map<string, double>;

const PairKind kinds[] = {{false, false}, {true, false}, {false, true}, {true, true}};

struct Pair {
    Vector r, F, T, V, W;
    double a_i, a_j, z_i, z_j;
};

/** Pairs that are apart, that overlap, one within the other, at one place. */
vector<Pair> pairs() {
    mt19937 random(5);
    uniform_real_distribution<double> u(-1, 1);
    const auto vectorOf = [&](double size) {
        return Vector{size * u(random), size * u(random), size * u(random)};
    };
    vector<Pair> all;
    for (double distance : {100.0, 5.0, 1.5, 0.3, 1e-9, 0.0})
        for (int i = 0; i < 50; i++) {
            Pair p;
            p.r = vectorOf(distance);
            p.F = vectorOf(3);
            p.T = vectorOf(3);
            p.V = vectorOf(1);
            p.W = vectorOf(1);
            p.a_i = 1 + 0.7 * u(random);
            p.a_j = i % 3 == 0 ? p.a_i : 1 + 0.7 * u(random);
            p.z_j = 2 + u(random);
            p.z_i = p.z_j + p.r.z;
            all.push_back(p);
        }
    return all;
}

void add(const string& name, const Vector& v, Values& values) {
    values[name + "_x"] = v.x;
    values[name + "_y"] = v.y;
    values[name + "_z"] = v.z;
}
Values valuesOf(const Pair& p) {
    Values values = {{"a_i", p.a_i}, {"a_j", p.a_j}, {"z_i", p.z_i}, {"z_j", p.z_j}};
    add("r", p.r, values);
    add("F", p.F, values);
    add("T", p.T, values);
    add("V", p.V, values);
    add("W", p.W, values);
    return values;
}
void expectBits(const string& name, const Vector& expected, const Values& values) {
    EXPECT_EQ(values.at(name + "_x"), expected.x) << name;
    EXPECT_EQ(values.at(name + "_y"), expected.y) << name;
    EXPECT_EQ(values.at(name + "_z"), expected.z) << name;
}

}  // namespace

TEST(PairText, HasTheBitsOfTheTemplates) {
    int apart = 0, overlapping = 0;
    for (const PairKind& kind : kinds)
        for (const Pair& p : pairs()) {
            const double distance2 = addedDot(p.r, p.r), sum = p.a_i + p.a_j;
            const PairMobility<double> m = pairMobility(distance2, p.a_i, p.a_j);
            Values values = valuesOf(p);
            runOnHost(pairComparison(), values);
            EXPECT_EQ(values.at("compared"), distance2);
            EXPECT_EQ(values.at("bound"), sum * sum);
            const bool isApart = values.at("compared") > values.at("bound");
            (isApart ? apart : overlapping)++;
            runOnHost(pairFactors(kind, isApart), values);
            EXPECT_EQ(values.at("m_ttI"), m.ttI);
            EXPECT_EQ(values.at("m_ttR"), m.ttR);
            EXPECT_EQ(values.count("m_rrR"), kind.hasTorque ? 1u : 0u);
            if (kind.hasTorque) {
                EXPECT_EQ(values.at("m_tr"), m.tr);
                EXPECT_EQ(values.at("m_rt"), m.rt);
                EXPECT_EQ(values.at("m_rrI"), m.rrI);
                EXPECT_EQ(values.at("m_rrR"), m.rrR);
            }
            Vector V = p.V, W = p.W;
            if (kind.hasTorque)
                addPairVelocities<1, true, true>(m, p.r, &p.F, &p.T, &V, &W);
            else
                addPairVelocities<1, false, false>(m, p.r, &p.F, &p.T, &V, &W);
            runOnHost(pairVelocities(kind), values);
            expectBits("V", V, values);
            expectBits("W", W, values);
            if (!kind.hasWall) continue;
            const WallMobility<double> wall = wallMobility(p.r, p.z_i, p.z_j, p.a_i, p.a_j);
            if (kind.hasTorque)
                addWallVelocities<1, true, true>(wall, &p.F, &p.T, &V, &W);
            else
                addWallVelocities<1, false, false>(wall, &p.F, &p.T, &V, &W);
            runOnHost(wallVelocities(kind), values);
            expectBits("V", V, values);
            expectBits("W", W, values);
        }
    EXPECT_GT(apart, 100);
    EXPECT_GT(overlapping, 100);
}

TEST(PairText, NeedsNoWordOfTheHost) {
    for (const PairKind& kind : kinds) {
        const KernelProgram program = pairProgram(kind);
        for (const char* word : {"COMPARISON", "FACTORS_APART", "FACTORS_OVERLAPPING",
                                 "PAIR_VELOCITIES", "WALL_VELOCITIES"})
            EXPECT_EQ(replaceWords(program.source, {{word, ""}}), program.source) << word;
        EXPECT_EQ(program.source.find("const number"), string::npos);
        EXPECT_EQ(program.defines.count("HAS_TORQUE"), kind.hasTorque ? 1u : 0u);
        EXPECT_EQ(program.defines.count("HAS_WALL"), kind.hasWall ? 1u : 0u);
        // Floats hold neither this distance nor its inverse squared.
        EXPECT_EQ(program.source.find("e-150"), string::npos);
        EXPECT_NE(program.source.find("(double) 1e-13"), string::npos);
    }
}

TEST(PairText, TypesAndWords) {
    const Program program = trace([] {
        const Line x = Line::input("x"), tiny(1e-150), product = tiny * x, two(-2.0);
        (product + two).output("y");
    });
    EXPECT_EQ(textOf(program, {"float", 1e-13, false}),
              "{\nconst float t2 = (float) 1e-13*x;\nconst float t4 = t2 + (float) -2.0;\n"
              "const float new_y = t4;\ny = new_y;\n}\n");
    EXPECT_EQ(textOf(program, {"double", 0, true}),
              "{\nconst double t2 = (double) 1e-150*((double) x);\n"
              "const double t4 = t2 + (double) -2.0;\nconst double new_y = t4;\ny = new_y;\n}\n");
    EXPECT_EQ(replaceWords("A B_A(AB)A", {{"A", "b"}, {"B_A", "c d"}}), "b c d(AB)b");
}

TEST(PairText, ComparisonsAreTracedForBothAnswers) {
    const auto formula = [] {
        const Line a = Line::input("a"), b = Line::input("b");
        selectGreater(a, b, a + b, a * b).output("y");
    };
    for (bool greater : {true, false}) {
        const Program program = trace(formula, greater);
        Values values = {{"a", 3}, {"b", 5}};
        runOnHost(program, values);
        EXPECT_EQ(values.at("y"), greater ? 8 : 15);
        ASSERT_EQ(program.getComparisons().size(), 1u);
    }
}
