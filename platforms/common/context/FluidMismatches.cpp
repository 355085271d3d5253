#include "context/FluidMismatches.h"

#include <openmm/serialization/SerializationNode.h>
#include <openmm/serialization/SerializationProxy.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <typeinfo>
#include <utility>
#include <vector>

#include "context/Messages.h"
#include "context/Scene.h"
#include "mobility/Models.h"
#include "openmmrigidhi/MobilityForce.h"
#include "openmmrigidhi/ModelTraits.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

namespace {

/** The first setting in which two serialized Forces differ, with both values; empty: none. */
string differenceOf(const SerializationNode& ofForce, const SerializationNode& ofContext) {
    for (const auto& property : ofForce.getProperties()) {
        const string& name = property.first;
        // The first two follow from other contents.
        if (name == "version" || name == "lubrication" || name == "name" || name == "forceGroup")
            continue;
        const string there = ofContext.getStringProperty(name, "");
        if (there != property.second)
            return name + " is " + property.second + " in the MobilityForce, but " +
                   (there.empty() ? "not set" : there) + " in this Context";
    }
    const auto &children = ofForce.getChildren(), &others = ofContext.getChildren();
    for (size_t i = 0; i < min(children.size(), others.size()); i++) {
        const string& name = children[i].getName();
        if (name != others[i].getName()) break;
        const string text = differenceOf(children[i], others[i]);
        if (text.empty()) continue;
        const bool isOneOfMany = (i > 0 && children[i - 1].getName() == name) ||
                                 (i + 1 < children.size() && children[i + 1].getName() == name);
        return name + (isOneOfMany ? " " + to_string(i) : "") + ": " + text;
    }
    map<string, int> more;  // in the Force than in the Context, without empty lists
    const auto isEmpty = [](const SerializationNode& node) {
        return node.getStringProperty("count", "") == "0";
    };
    for (const SerializationNode& child : children) more[child.getName()] += !isEmpty(child);
    for (const SerializationNode& child : others) more[child.getName()] -= !isEmpty(child);
    for (const auto& [name, number] : more)
        if (number != 0)
            return "the MobilityForce has " + string(number > 0 ? "more" : "fewer") +
                   " entries of " + name + " than this Context";
    return {};
}

}  // namespace

string fluidWithoutUpdate(const Scene& scene) {
    const MobilityForce* changed = scene.fluid.getChanged();
    if (!changed) return {};
    SerializationNode ofForce, ofContext;
    const SerializationProxy& proxy = SerializationProxy::getProxy(typeid(MobilityForce));
    proxy.serialize(changed, ofForce);
    proxy.serialize(scene.fluid.getParameters(), ofContext);
    const string text = differenceOf(ofForce, ofContext);
    if (text.empty()) return {};
    return text +
           ", which was created or updated before this change: its steps do not know of it; call "
           "updateParametersInContext() of the MobilityForce, which says so where the Context must "
           "be made anew";
}

namespace {

/** A body of one hydrodynamic particle, or a free particle. */
bool isSingle(const FluidElement& element) { return element.particles.size() == 1; }

/** Whether any element of the fluid is as the function says. */
template <class Is>
bool anyElement(const Scene& scene, const Is& is) {
    for (const auto& group : scene.fluid->getContents().groups)
        for (const FluidElement& element : group->bodies.getElements())
            if (is(element)) return true;
    return false;
}

}  // namespace

string settingWithoutEffect(const Scene& scene) {
    if (!scene.fluid) return {};
    const MobilityForce& force = scene.fluid->getContents().force;
    const BoundaryTraits& boundary = traitsOf(force.getBoundary());
    const string with = string(" has no effect with the boundary ") + boundary.name;
    double low, high;
    force.getChannelWalls(low, high);
    // With other walls a height is harmless: scripts set both for all their boundaries.
    if (force.getWallHeight() != 0 && !boundary.hasWalls())
        return "setWallHeight(" + number(force.getWallHeight()) + ")" + with +
               "; for a wall at this height call setBoundary(NoSlipWall), or leave out the height";
    if ((low != 0 || high != 0) && !boundary.hasWalls())
        return "setChannelWalls(" + number(low) + ", " + number(high) + ")" + with +
               "; for these walls call setBoundary(NoSlipChannel) or (SlipChannel), or leave them "
               "out";
    if (force.getChannelCondition() != MobilityForce::ZeroPressureGradient &&
        force.getBoundary() != MobilityForce::NoSlipChannel)
        return "setChannelCondition(ZeroFlux)" + with +
               "; call setBoundary(NoSlipChannel), or leave out the condition";
    if (force.getSphereWallMobility() == MobilityForce::BestKnown && !anyElement(scene, isSingle))
        return "setSphereWallMobility(BestKnown) has no effect, because no body is a single sphere "
               "and no particle is free; leave it out";
    if (force.getMinimumGap() > 0 && !hasLubrication(force))
        return "setMinimumGap(" + number(force.getMinimumGap()) +
               ") has no effect without lubrication; call setLubrication(On), or leave out the gap";
    return {};
}

namespace {

/** Where a particle is that the fluid sees. */
struct Seen {
    int particle, group, body;
    double radius;
    Vec3 place;
};

vector<Seen> particlesSeen(const Scene& scene) {
    vector<Seen> seen;
    const auto& groups = scene.fluid->getContents().groups;
    for (size_t g = 0; g < groups.size(); g++)
        for (const FluidElement& element : groups[g]->bodies.getElements())
            for (size_t k = 0; k < element.particles.size(); k++) {
                const int p = element.particles[k];
                seen.push_back(
                    {p, int(g), element.body, element.radii[k], scene.arrays->positions()[p]});
            }
    return seen;
}

string nameOf(const Seen& one) {
    return one.body < 0 ? "particle " + to_string(one.particle) : "body " + to_string(one.body);
}

}  // namespace

string coincidentParticles(const Scene& scene) {
    // Beads of chains without excluded volume may be at any distance, but come nearer than this
    // part of the sum of radii hardly ever.
    const double tooNear = 0.01;
    if (!scene.fluid || scene.fluid->getContents().isFreeDraining()) return {};
    vector<Seen> seen = particlesSeen(scene);
    if (seen.size() < 2) return {};
    set<pair<int, int>> joined;
    for (const JointDefinition& joint : scene.definitions.joints())
        joined.insert(minmax(joint.i, joint.j));
    // Along the axis of the largest extent few particles are near each other.
    int axis = 0;
    double extent = -1, largest = 0;
    for (int k = 0; k < 3; k++) {
        const auto ends = minmax_element(
            seen.begin(), seen.end(),
            [k](const Seen& one, const Seen& other) { return one.place[k] < other.place[k]; });
        if (ends.second->place[k] - ends.first->place[k] <= extent) continue;
        extent = ends.second->place[k] - ends.first->place[k];
        axis = k;
    }
    for (const Seen& one : seen) largest = max(largest, one.radius);
    sort(seen.begin(), seen.end(), [axis](const Seen& one, const Seen& other) {
        return one.place[axis] < other.place[axis];
    });
    for (size_t i = 0; i < seen.size(); i++)
        for (size_t j = i + 1;
             j < seen.size() && seen[j].place[axis] - seen[i].place[axis] < 2 * tooNear * largest;
             j++) {
            const Seen &one = seen[i], &other = seen[j];
            const Vec3 between = other.place - one.place;
            const double distance = sqrt(between.dot(between));
            if (one.group != other.group || (one.body >= 0 && one.body == other.body) ||
                distance >= tooNear * (one.radius + other.radius) ||
                joined.count(minmax(one.body, other.body)))
                continue;
            return nameOf(one) + " and " + nameOf(other) + " have particles of radii " +
                   number(one.radius) + " and " + number(other.radius) + " nm whose centres are " +
                   number(distance) +
                   " nm apart: the fluid moves them as one sphere; give positions and radii in "
                   "the same unit, or apply forces that keep bodies apart";
        }
    return {};
}

string overfullBox(const Scene& scene) {
    if (!scene.fluid || !scene.fluid->getContents().isPeriodic() ||
        scene.fluid->getContents().hasWalls())
        return {};
    const BoxVectors box = scene.getBox();
    const double volume = box[0][0] * box[1][1] * box[2][2];
    for (const auto& group : scene.fluid->getContents().groups) {
        double filled = 0;
        for (const FluidElement& element : group->bodies.getElements())
            if (isSingle(element)) filled += 4 * M_PI / 3 * pow(element.radii[0], 3);
        if (filled > volume)
            return "the spheres of the fluid have " + number(filled / volume) +
                   " times the volume of the periodic box, so they overlap; set the box by "
                   "setDefaultPeriodicBoxVectors() of the System, or give box and radii in the "
                   "same unit";
    }
    return {};
}

string spheresInFlowAtWall(const Scene& scene) {
    // Goldman, Cox and Brenner (1967): far away a sphere in shear moves slower than the flow by
    // (5/16) (a/h)^3, which is 4 % at this height.
    const double near = 2;
    if (!scene.fluid) return {};
    const FluidContents& fluid = scene.fluid->getContents();
    const BoundaryTraits& boundary = traitsOf(fluid.force.getBoundary());
    const bool atLow = boundary.lowWall == WallKind::NoSlip,
               atHigh = boundary.highWall == WallKind::NoSlip;
    if (!fluid.getFlow() || !fluid.getFlow()->hasGradient() || fluid.isFreeDraining() ||
        boundary.wallAxis != 2 || (!atLow && !atHigh))
        return {};
    double low, high;
    findWalls(fluid.force, low, high);
    for (const auto& group : fluid.groups)
        for (const FluidElement& element : group->bodies.getElements()) {
            if (!isSingle(element) || element.isWhollyFixed()) continue;
            const double z = scene.arrays->positions()[element.particles[0]][2],
                         a = element.radii[0];
            const double h = min(atLow ? z - low : INFINITY, atHigh ? high - z : INFINITY);
            if (h >= near * a) continue;
            const double slower = 5.0 / 16 * pow(a / max(h, a), 3), excess = slower / (1 - slower),
                         farthestOfContact = 1.2;
            return (element.isFree() ? "particle " + to_string(element.particles[0])
                                     : "body " + to_string(element.body)) +
                   " is a single sphere " + number(h / a) +
                   " radii from a no-slip wall, in a flow with a gradient; single spheres follow "
                   "the flow as if the wall were absent, which is " +
                   number(round(100 * excess)) + " % " +
                   (h < farthestOfContact * a ? "or more " : "") +
                   "too fast in shear; take shells of blobs if the flow near walls matters";
        }
    return {};
}

void addMismatchesOfPlaces(const Scene& scene, Warnings& warnings) {
    const vector<Vec3>& positions = scene.arrays->positions();
    // Before positions are set, all of them are 0.
    if (all_of(positions.begin(), positions.end(), [](const Vec3& x) { return x == Vec3(); }))
        return;
    const pair<WarningCause, string> found[] = {
        {WarningCause::CoincidentParticles, coincidentParticles(scene)},
        {WarningCause::OverfullBox, overfullBox(scene)},
        {WarningCause::SpheresInFlowAtWall, spheresInFlowAtWall(scene)}};
    for (const auto& mismatch : found)
        if (!mismatch.second.empty()) warnings.insert(mismatch);
}

}  // namespace RigidHIPlugin
