#include "context/ForcesBetweenGroups.h"

#include <openmm/CustomBondForce.h>
#include <openmm/CustomNonbondedForce.h>
#include <openmm/HarmonicBondForce.h>
#include <openmm/NonbondedForce.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>
#include <utility>
#include <vector>

#include "context/Messages.h"
#include "context/Scene.h"
#include "openmmrigidhi/MobilityForce.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

namespace {

const int noBody = -1;

/** The particles of a scene, with the body and the group of each. */
struct Members {
    explicit Members(const Scene& scene)
        : positions(scene.arrays->positions()), labels(scene.fluid.getParameters()->getGroups()),
          bodies(scene.system.getNumParticles(), noBody) {
        for (int b = 0; b < scene.definitions.getNumBodies(); b++)
            for (int p : scene.definitions.particles(b)) bodies[p] = b;
    }
    bool areApart(int p, int q) const {
        return bodies[p] != noBody && bodies[q] != noBody && labels[bodies[p]] != labels[bodies[q]];
    }
    const vector<Vec3>& positions;
    const vector<int>& labels;
    vector<int> bodies;
};

/** Which pairs of particles a force takes, and up to which distance (infinite: no cut-off). */
struct PairsOfForce {
    double range = 0;
    vector<int> particles;
    set<pair<int, int>> excluded;
    vector<pair<set<int>, set<int>>> between;  // interaction groups; none: all pairs

    bool takes(int p, int q) const {
        if (excluded.count(minmax(p, q))) return false;
        return between.empty() || any_of(between.begin(), between.end(), [&](const auto& sets) {
                   return (sets.first.count(p) && sets.second.count(q)) ||
                          (sets.first.count(q) && sets.second.count(p));
               });
    }
};

template <class Pairs>
double rangeOf(const Pairs& force) {
    return force.getNonbondedMethod() == Pairs::NoCutoff ? INFINITY : force.getCutoffDistance();
}

/** An exception of zero strength is an exclusion. */
PairsOfForce pairsOf(const NonbondedForce& force) {
    PairsOfForce pairs;
    pairs.range = rangeOf(force);
    const bool hasOffsets = force.getNumParticleParameterOffsets() > 0;
    for (int p = 0; p < force.getNumParticles(); p++) {
        double charge, sigma, epsilon;
        force.getParticleParameters(p, charge, sigma, epsilon);
        if (charge != 0 || epsilon != 0 || hasOffsets) pairs.particles.push_back(p);
    }
    for (int e = 0; e < force.getNumExceptions(); e++) {
        int p, q;
        double product, sigma, epsilon;
        force.getExceptionParameters(e, p, q, product, sigma, epsilon);
        if (product == 0 && epsilon == 0) pairs.excluded.insert(minmax(p, q));
    }
    return pairs;
}

/** Whether particles of bodies in different groups are among these. */
bool areMixed(const set<int>& first, const set<int>& second, const Members& members) {
    set<int> labels;
    for (const set<int>* particles : {&first, &second})
        for (int p : *particles)
            if (members.bodies[p] != noBody) labels.insert(members.labels[members.bodies[p]]);
    return labels.size() > 1;
}

PairsOfForce pairsOf(const CustomNonbondedForce& force, const Members& members) {
    PairsOfForce pairs;
    pairs.range = rangeOf(force);
    for (int e = 0; e < force.getNumExclusions(); e++) {
        int p, q;
        force.getExclusionParticles(e, p, q);
        pairs.excluded.insert(minmax(p, q));
    }
    for (int g = 0; g < force.getNumInteractionGroups(); g++) {
        pair<set<int>, set<int>> sets;
        force.getInteractionGroupParameters(g, sets.first, sets.second);
        if (areMixed(sets.first, sets.second, members)) pairs.between.push_back(move(sets));
    }
    // Replicas mostly have an interaction group each, so that no pair is left to look at.
    if (force.getNumInteractionGroups() > 0 && pairs.between.empty()) return pairs;
    pairs.particles.resize(force.getNumParticles());
    iota(pairs.particles.begin(), pairs.particles.end(), 0);
    return pairs;
}

using Pair = pair<int, int>;
const Pair none(noBody, noBody);

/** The axis along which particles are spread most. */
int longestAxis(const vector<int>& particles, const vector<Vec3>& x) {
    Vec3 extent;
    for (int k = 0; k < 3; k++) {
        const auto before = [&](int p, int q) { return x[p][k] < x[q][k]; };
        const auto ends = minmax_element(particles.begin(), particles.end(), before);
        extent[k] = x[*ends.second][k] - x[*ends.first][k];
    }
    return extent[0] >= max(extent[1], extent[2]) ? 0 : extent[1] >= extent[2] ? 1 : 2;
}

/** A pair of particles in different groups that the force takes. */
Pair findPair(PairsOfForce pairs, double rangeWithoutCutoff, const Members& members) {
    const double range = isinf(pairs.range) ? rangeWithoutCutoff : pairs.range;
    const vector<Vec3>& x = members.positions;
    if (pairs.particles.empty()) return none;
    const int axis = longestAxis(pairs.particles, x);
    stable_sort(pairs.particles.begin(), pairs.particles.end(),
                [&](int p, int q) { return x[p][axis] < x[q][axis]; });
    for (size_t i = 0; i < pairs.particles.size(); i++)
        for (size_t j = i + 1; j < pairs.particles.size(); j++) {
            const int p = pairs.particles[i], q = pairs.particles[j];
            const Vec3 apart = x[q] - x[p];
            if (apart[axis] > range) break;
            if (members.areApart(p, q) && apart.dot(apart) < range * range && pairs.takes(p, q))
                return minmax(p, q);
        }
    return none;
}

Pair endsOf(const HarmonicBondForce& force, int bond) {
    int p, q;
    double length, k;
    force.getBondParameters(bond, p, q, length, k);
    return {p, q};
}

Pair endsOf(const CustomBondForce& force, int bond) {
    int p, q;
    vector<double> parameters;
    force.getBondParameters(bond, p, q, parameters);
    return {p, q};
}

template <class Bonds>
Pair findBond(const Bonds& force, const Members& members) {
    for (int b = 0; b < force.getNumBonds(); b++) {
        const Pair ends = endsOf(force, b);
        if (members.areApart(ends.first, ends.second)) return ends;
    }
    return none;
}

}  // namespace

string forcesBetweenGroups(const Scene& scene) {
    const MobilityForce* fluid = scene.fluid.getParameters();
    // Under FreeDraining bodies do not feel each other in the fluid, whatever their groups.
    if (!fluid || !scene.fluid || fluid->getModel() == MobilityForce::FreeDraining) return {};
    const set<int> labels(fluid->getGroups().begin(), fluid->getGroups().end());
    if (labels.size() < 2) return {};
    const Members members(scene);
    const bool areSet = any_of(members.positions.begin(), members.positions.end(),
                               [](const Vec3& x) { return x != Vec3(); });
    if (!areSet) return {};
    double largest = 0;
    for (int p = 0; p < fluid->getNumParticles(); p++)
        largest = max(largest, fluid->getParticleRadius(p));
    const double rangeWithoutCutoff = 4 * largest;
    for (int i = 0; i < scene.system.getNumForces(); i++) {
        const Force& force = scene.system.getForce(i);
        Pair found = none;
        if (auto* known = dynamic_cast<const NonbondedForce*>(&force))
            found = findPair(pairsOf(*known), rangeWithoutCutoff, members);
        else if (auto* known = dynamic_cast<const CustomNonbondedForce*>(&force))
            found = findPair(pairsOf(*known, members), rangeWithoutCutoff, members);
        else if (auto* known = dynamic_cast<const HarmonicBondForce*>(&force))
            found = findBond(*known, members);
        else if (auto* known = dynamic_cast<const CustomBondForce*>(&force))
            found = findBond(*known, members);
        if (found == none) continue;
        const auto label = [&](int p) { return to_string(members.labels[members.bodies[p]]); };
        return "force " + to_string(i) + ", a " + string(force.getName()) +
               ", acts between particles " + to_string(found.first) + " and " +
               to_string(found.second) + " of groups " + label(found.first) + " and " +
               label(found.second) +
               " of setGroups(): the fluid keeps groups apart, but forces do not; if groups are "
               "replicas, exclude such pairs (addInteractionGroup() of a CustomNonbondedForce, or "
               "exclusions), and if they are not, give their bodies one group";
    }
    return {};
}

}  // namespace RigidHIPlugin
