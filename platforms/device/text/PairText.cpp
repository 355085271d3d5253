#include "text/PairText.h"

#include "KernelSources.h"
#include "mobility/models/wall/RotnePragerYamakawaWall-inl.h"

using namespace std;

namespace RigidHIPlugin {

using namespace scalar;

namespace {

using LineVector = Vector3<Line>;
using Factors = PairMobility<Line>;

/**
 * Spheres with radii near 1 (DevicePairs) that are closer than this count as at one place. Floats
 * can hold its inverse times any power of radii in a formula.
 */
const double leastDistance = 1e-13;

LineVector vectorOf(const string& name) {
    return {Line::input(name + "_x"), Line::input(name + "_y"), Line::input(name + "_z")};
}
void give(const LineVector& v, const string& name) {
    v.x.output(name + "_x");
    v.y.output(name + "_y");
    v.z.output(name + "_z");
}

struct NamedFactor {
    const char* name;
    Line Factors::*factor;
    bool ofTorque;
};
const NamedFactor namedFactors[] = {
    {"m_ttI", &Factors::ttI, false}, {"m_ttR", &Factors::ttR, false},
    {"m_tr", &Factors::tr, true},    {"m_rt", &Factors::rt, true},
    {"m_rrI", &Factors::rrI, true},  {"m_rrR", &Factors::rrR, true}};

Program factorsOf(PairKind kind, bool apart) {
    return trace(
        [&] {
            const LineVector r = vectorOf("r");
            const Factors m = pairMobility(addedDot(r, r), Line::input("a_i"), Line::input("a_j"));
            for (const NamedFactor& f : namedFactors)
                if (kind.hasTorque || !f.ofTorque) (m.*f.factor).output(f.name);
        },
        apart);
}

/** The load on j and the velocities of i. */
struct Motion {
    LineVector F, T, V, W;
    explicit Motion(PairKind kind) {
        F = vectorOf("F");
        V = vectorOf("V");
        if (!kind.hasTorque) return;
        T = vectorOf("T");
        W = vectorOf("W");
    }
    void give(PairKind kind) const {
        RigidHIPlugin::give(V, "V");
        if (kind.hasTorque) RigidHIPlugin::give(W, "W");
    }
};

}  // namespace

Program pairComparison() {
    const Program apart = factorsOf({false, false}, true);
    const auto& operands = apart.getComparisons().at(0);
    return apart.withOutputs({{"compared", operands.first}, {"bound", operands.second}});
}

Program pairFactors(PairKind kind, bool apart) { return factorsOf(kind, apart); }

Program pairVelocities(PairKind kind) {
    return trace([&] {
        Factors m;
        for (const NamedFactor& f : namedFactors)
            if (kind.hasTorque || !f.ofTorque) m.*f.factor = Line::input(f.name);
        const LineVector r = vectorOf("r");
        Motion motion(kind);
        if (kind.hasTorque)
            addPairVelocities<1, true, true>(m, r, &motion.F, &motion.T, &motion.V, &motion.W);
        else
            addPairVelocities<1, false, false>(m, r, &motion.F, &motion.T, &motion.V, &motion.W);
        motion.give(kind);
    });
}

Program wallVelocities(PairKind kind) {
    return trace([&] {
        const WallMobility<Line> m =
            wallMobility(vectorOf("r"), Line::input("z_i"), Line::input("z_j"), Line::input("a_i"),
                         Line::input("a_j"));
        Motion motion(kind);
        if (kind.hasTorque)
            addWallVelocities<1, true, true>(m, &motion.F, &motion.T, &motion.V, &motion.W);
        else
            addWallVelocities<1, false, false>(m, &motion.F, &motion.T, &motion.V, &motion.W);
        motion.give(kind);
    });
}

KernelProgram pairProgram(PairKind kind) {
    const NumberType single = {"float", leastDistance, false},
                     precise = {"double", leastDistance, true};
    KernelProgram result;
    // For spheres of very different radii the factors are differences of large numbers, so
    // overlapping pairs are in double precision.
    result.source = replaceWords(
        KernelSources::pairs, {{"COMPARISON", textOf(pairComparison(), single)},
                               {"FACTORS_APART", textOf(pairFactors(kind, true), single)},
                               {"FACTORS_OVERLAPPING", textOf(pairFactors(kind, false), precise)},
                               {"PAIR_VELOCITIES", textOf(pairVelocities(kind), single)},
                               {"WALL_VELOCITIES", textOf(wallVelocities(kind), single)}});
    result.defines = {{"GROUP", to_string(pairGroup)},
                      {"TILE", to_string(pairTile)},
                      {"PART", to_string(pairPart)}};
    if (kind.hasTorque) result.defines["HAS_TORQUE"] = "1";
    if (kind.hasWall) result.defines["HAS_WALL"] = "1";
    return result;
}

}  // namespace RigidHIPlugin
