#include "fluid/FluidReport.h"

#include <algorithm>
#include <cmath>
#include <sstream>

#include "mobility/Models.h"
#include "openmmrigidhi/internal/Messages.h"
#include "rigidbody/EigenVec3.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

namespace {

/** Of 1 dalton/(nm ps), and of 1 nm^2/ps. */
const double milliPascalSeconds = 1.66053906660e-3, squareMicrometresPerSecond = 1e6;

/**
 * How iterations of a step without momenta make their products. In schemes of several stages the
 * last stage follows the differences (OverdampedMove::atPresent()).
 */
string describeProducts(BrownianGroup& group, const SchemeTraits& scheme, double kT,
                        double difference) {
    const ErrorBudget errors = group.errorsOf(scheme, kT, group.differenceOf(scheme, difference));
    BodyMobility& mobility = group.getMobility();
    const string products = mobility.describeProducts(errors);
    if (overdampedScheme(scheme.scheme).numStages() == 1) return products;
    const string later = mobility.describeProducts(errors.afterDifferences());
    if (later == products) return products;
    const auto text = [](const string& way) { return way.empty() ? "over all pairs" : way; };
    return text(products) + " for differences, then " + text(later);
}

/** The number of bodies or free particles that the fluid sees, from the groups that they are in. */
int numSeen(const vector<int>& groupOf) {
    return count_if(groupOf.begin(), groupOf.end(), [](int g) { return g >= 0; });
}

}  // namespace

const FluidGroup* FluidReport::findLargest() const {
    const FluidGroup* largest = nullptr;
    for (const auto& group : fluid.groups)
        if (!largest || group->bodies.getNumParticleRows() > largest->bodies.getNumParticleRows())
            largest = group.get();
    return largest;
}

string FluidReport::describeWalls() const {
    const BoundaryTraits& boundary = traitsOf(fluid.force.getBoundary());
    if (!boundary.hasWalls()) return {};
    double low, high;
    findWalls(fluid.force, low, high);
    const bool one = boundary.numWalls == 1;
    ostringstream text;
    text << (one ? " above " : " between ") << boundary.walls << " at "
         << "xyz"[boundary.wallAxis] << " = " << low;
    if (!one) text << " and " << high;
    text << " nm (the scheme redoes a step after which a particle "
         << (fluid.settings.wallRejection == CustomRigidHIIntegrator::Crossing
                 ? "has its centre behind "
                 : "overlaps ")
         << (one ? "the wall)" : "a wall)");
    if (boundary.boundary == MobilityForce::NoSlipChannel)
        text << (fluid.force.getChannelCondition() == MobilityForce::ZeroFlux
                     ? ", without flux along them,"
                     : ", without a pressure gradient along them,");
    return text.str();
}

string FluidReport::describeImages() const {
    const BoundaryTraits& boundary = traitsOf(fluid.force.getBoundary());
    const string axes = boundary.hasWalls() ? string("along ") + boundary.namesAlongWalls() : "";
    if (fluid.userFlow.hasPlanes())  // the third vector of the box is not a period
        return " with all images " + axes + " (of the periods " +
               RigidHIPlugin::text(fluid.box[0]) + " and " + RigidHIPlugin::text(fluid.box[1]) +
               " nm)";
    return " with all images " + (axes.empty() ? "" : axes + " ") + "in " + textOf(fluid.box);
}

string FluidReport::describeScale(double kT) const {
    const MobilityForce& force = fluid.force;
    double smallest = INFINITY, largest = 0;
    for (int p = 0; p < force.getNumParticles(); p++)
        if (force.getParticleRadius(p) > 0) {
            smallest = min(smallest, force.getParticleRadius(p));
            largest = max(largest, force.getParticleRadius(p));
        }
    if (largest == 0) return {};
    const int digits = 3;
    const auto number = [&](double value) { return RigidHIPlugin::text(value, digits); };
    string result = "; viscosity " + number(force.getViscosity()) + " dalton/(nm ps) (" +
                    number(force.getViscosity() * milliPascalSeconds) + " mPa s), " +
                    (smallest == largest ? "radius " : "radii " + number(smallest) + " to ") +
                    number(largest) + " nm";
    if (kT > 0) {
        const double D = kT / (6 * M_PI * force.getViscosity() * smallest);
        result += string(": alone, a ") + (smallest == largest ? "" : "smallest ") +
                  "sphere diffuses at " + number(D) + " nm^2/ps (" +
                  number(D * squareMicrometresPerSecond) + " um^2/s)";
    }
    return result;
}

string FluidReport::describe(const SchemeTraits& scheme, double kT, double difference) const {
    const bool overdamped = scheme.isOverdamped();
    const auto mobilityOf = [&](const FluidGroup& group) -> BodyMobility& {
        return overdamped ? group.brownian->getMobility() : group.relaxation->getMobility();
    };
    int thermostats = 0, ways[3] = {0, 0, 0};
    for (const auto& group : fluid.groups)
        if (!overdamped && !group->relaxation)
            thermostats += group->isThermostat;
        else
            ways[mobilityOf(*group).getWay()]++;
    const BoundaryTraits& boundary = traitsOf(fluid.force.getBoundary());
    ostringstream text;
    text << modelName(fluid.force.getModel()) << describeWalls();
    if (fluid.isPeriodic()) text << describeImages();
    if (fluid.isFreeDraining() && boundary.isPeriodic)
        text << " in a periodic box, where bodies feel neither others nor images, as if unbounded";
    const FluidGroup* largest = findLargest();
    if (largest && largest->bodies.hasModel()) {
        const GridOfModel* grid = largest->grid();
        if (grid) text << " on " << grid->describe(fluid.box);
        if (!largest->gridChoice.empty())
            text << (grid ? " (" : " by matrices of lattice sums (") << largest->gridChoice << ")";
        // Auto leaves StokesianDynamics its matrices, because the grid has another reach.
        const size_t fewForMatrices = 20;
        if (fluid.force.getModel() == MobilityForce::StokesianDynamics &&
            fluid.force.getSolver() == MobilityForce::Auto && boundary.isPeriodic && overdamped &&
            scheme.takesIterations() && largest->bodies.getElements().size() > fewForMatrices)
            text << " by matrices (for so many spheres setSolver(MatrixFree) takes a fraction of "
                    "their time)";
    }
    if (largest && largest->bodies.hasModel()) {
        const string lubrication = largest->bodies.getModel().describeLubrication();
        if (!lubrication.empty()) text << ", with " << lubrication;
    }
    text << ", " << counted(numSeen(fluid.groupOfBody), "body", "bodies") << " and "
         << counted(numSeen(fluid.groupOfFree), "free particle", "free particles")
         << describeScale(kT);
    const auto groups = [](int number) { return counted(number, "group", "groups"); };
    const pair<int, string> parts[] = {
        {overdamped ? 0 : thermostats,
         to_string(thermostats) + " alone with constant isotropic drag (no matrices)"},
        {ways[BodyMobility::Constant],
         to_string(ways[BodyMobility::Constant]) + " alone with a constant tensor (computed once)"},
        {ways[BodyMobility::Dense], groups(ways[BodyMobility::Dense]) + " with dense matrices"},
        {ways[BodyMobility::Krylov], groups(ways[BodyMobility::Krylov]) + " matrix-free"}};
    const char* separator = "; ";
    for (const auto& [number, part] : parts) {
        if (number == 0) continue;
        text << separator << part;
        separator = ", ";
    }
    if (largest && largest->bodies.hasModel() && (overdamped || largest->relaxation)) {
        const string products = overdamped
                                    ? describeProducts(*largest->brownian, scheme, kT, difference)
                                    : largest->relaxation->describeProducts();
        if (!products.empty()) text << ", products in iterations " << products;
    }
    return text.str();
}

string FluidReport::lubricationWithoutEffect() const {
    const MobilityForce& force = fluid.force;
    double whole, nothing;
    force.getLubricationReach(whole, nothing);
    const string model = modelName(force.getModel());
    if (force.getLubrication() == MobilityForce::On && !mayHaveLubrication(force.getModel()))
        return "setLubrication(On) has no effect with model " + model +
               ", whose bodies do not feel each other; use RotnePragerYamakawa, ForceCoupling or "
               "StokesianDynamics";
    if (nothing > 0 && !hasLubrication(force))
        return "setLubricationReach() has no effect, because no sphere has lubrication; use "
               "setLubrication(On)";
    if (force.getLubrication() != MobilityForce::On) return {};
    for (const auto& group : fluid.groups)
        if (!group->bodies.hasModel() || force.getModel() == MobilityForce::StokesianDynamics ||
            !group->bodies.getModel().describeLubrication().empty())
            return {};
    return "setLubrication(On) has no effect, for only single spheres have lubrication, with each "
           "other, with images and with no-slip walls, and no group of bodies has such spheres; "
           "use setLubrication(Off)";
}

string FluidReport::describeFlow() const {
    if (!fluid.getFlow()) return {};
    const DrivenFlow& flow = *fluid.getFlow();
    ostringstream text;
    const char* const axes = "xyz";
    const auto row = [&](int k) {
        return RigidHIPlugin::text(toVec3(flow.gradient.row(k).transpose()));
    };
    const auto nameNext = [&](const string& what) {
        if (text.tellp() > 0) text << ", and ";
        text << what;
    };
    const UserFlow& user = fluid.userFlow;
    if (user.wallVelocity != OpenMM::Vec3())
        nameNext("an upper wall with the velocity " + RigidHIPlugin::text(user.wallVelocity) +
                 " nm/ps");
    if (user.bodyForceDensity != OpenMM::Vec3())
        nameNext(
            "a uniform force density of " + RigidHIPlugin::text(user.bodyForceDensity) +
            " kJ/(mol nm^4), which without bodies drives a mean flow of " +
            number((toEigen(user.bodyForceDensity).norm() * user.ofUnitForceDensity(0).mean())[0]) +
            " nm/ps");
    if (flow.waveVelocity != 0) {
        nameNext("");
        text << "a sinusoidal force density along " << axes[flow.forceAxis] << " with "
             << 2 * M_PI / flow.k << " nm along " << axes[flow.waveAxis]
             << ", which without bodies drives a flow of up to " << abs(flow.waveVelocity)
             << " nm/ps";
    }
    if (user.hasBackground()) {
        nameNext("");
        text << "velocity " << RigidHIPlugin::text(toVec3(flow.velocity))
             << " nm/ps at the origin, gradient in rows " << row(0) << ", " << row(1) << ", "
             << row(2) << "/ps";
    }
    if (user.isSheared()) {
        nameNext("");
        text << "shear of the rate " << number(user.shearRate) << "/ps along "
             << axes[user.flowAxis] << " with its gradient along " << axes[user.gradientAxis]
             << ", with which the box tilts (at a tilt of half an edge it goes on with the other "
                "tilt of the same lattice, where forces of PME jump by their error)";
    }
    if (!flow.hasGradient()) return text.str();
    bool stresslets = true, own = false;
    for (const auto& group : fluid.groups) {
        stresslets = stresslets && group->bodies.hasModel() &&
                     group->bodies.getModel().getTraits().hasStresslets;
        for (const FluidElement& element : group->bodies.getElements())
            own = own || element.ownMobility.size() > 0;
    }
    if (!stresslets)
        text << "; multiblobs resist its strain by their blobs, single spheres and blobs do not";
    else if (!hasLubrication(fluid.force))
        text << "; spheres resist its strain by stresslets, without lubrication";
    else
        text << "; spheres resist its strain by stresslets and lubrication"
             << (flow.waveVelocity != 0 ? ", that of a wave by stresslets alone" : "");
    if (own) text << "; bodies with tensors of their own resist it as their blobs do";
    return text.str();
}

string FluidReport::describeAnswers() const {
    int constant = 0, dense = 0, products = 0, iterations = 0, columns = 0;
    string fast;
    for (const auto& group : fluid.groups) {
        if (group->bodies.hasModel() && fast.empty())
            fast = group->bodies.getModel().describeFastProducts(fluid.force.getSolverTolerance());
        const bool krylov = group->answering->getWay() == BodyMobility::Krylov;
        columns += krylov && group->bodies.isWorthIterations();
        (group->answering->getWay() == BodyMobility::Constant ? constant
         : !krylov                                            ? dense
         : group->bodies.multipliesWithoutIterations()        ? products
                                                              : iterations)++;
    }
    const auto list = [](const vector<pair<int, string>>& ways) {
        string all;
        for (const auto& way : ways)
            if (way.first > 0)
                all += (all.empty() ? "" : ", ") + counted(way.first, "group", "groups") + " " +
                       way.second;
        return all.empty() ? string("no groups") : all;
    };
    ostringstream tolerance;
    tolerance << "by iterations to " << fluid.force.getSolverTolerance();
    const string known = "by a constant tensor", matrices = "by dense matrices";
    return "applyMobilityInContext() does " +
           list(
               {{constant, known},
                {products, "by products without a matrix" + (fast.empty() ? string() : " " + fast)},
                {iterations, tolerance.str()},
                {dense, matrices}}) +
           "; getMobilityInContext() " +
           list({{constant, known},
                 {columns, tolerance.str() + ", column by column"},
                 {int(fluid.groups.size()) - constant - columns, matrices}}) +
           "; getFrictionInContext() " +
           list({{constant, known}, {int(fluid.groups.size()) - constant, matrices}});
}

FluidReport::Drifts FluidReport::findDrifts() const {
    Drifts drifts;
    for (const auto& group : fluid.groups) switch (group->brownian->getDrift()) {
            case BrownianGroup::Drift::Differenced:
                drifts.differenced.push_back(group->brownian.get());
                break;
            case BrownianGroup::Drift::Known: drifts.known++; break;
            case BrownianGroup::Drift::Zero: drifts.zero++; break;
            case BrownianGroup::Drift::ZeroOfSpheres: drifts.ofSpheres++; break;
        }
    return drifts;
}

bool FluidReport::hasStochasticDrift() const { return findDrifts().numNotZero() > 0; }

int FluidReport::numInteracting() const {
    int sum = 0;
    for (const auto& group : fluid.groups)
        if (group->poses.size() > 1) sum += group->poses.size();
    return sum;
}

int FluidReport::numCollinear() const {
    int sum = 0;
    for (const auto& group : fluid.groups)
        for (size_t e = 0; e < group->poses.size(); e++)
            sum += group->bodies.hasNullVector(e) && group->bodies.getElements()[e].isWhollyFree();
    return sum;
}

map<string, string> FluidReport::describeDrift(const SchemeTraits& scheme, double kT,
                                               double difference) const {
    const Drifts drifts = findDrifts();
    const int others = drifts.differenced.size(), known = drifts.known,
              zero = drifts.zero + drifts.ofSpheres;
    double smallest = 0, largest = 0;
    bool byFields = scheme.differenced == Differenced::Roots;
    for (BrownianGroup* group : drifts.differenced) {
        byFields = byFields && group->getMobility().field().knowsDivergence();
        const double step = group->differenceOf(scheme, difference);
        smallest = smallest == 0 ? step : min(smallest, step);
        largest = max(largest, step);
    }
    const string uniform = "every body is alone in a uniform fluid",
                 spheres = string("the mobility of spheres in ") +
                           (fluid.isPeriodic() ? "a periodic" : "an unbounded") +
                           " fluid has no divergence",
                 alone = ", and other bodies are alone in a uniform fluid";
    const auto count = [](int n) { return counted(n, "group of bodies", "groups of bodies"); };
    ostringstream drift, differences;
    if (kT == 0)
        drift << "off: the temperature is 0";
    else if (known + others == 0)
        drift << "off: "
              << (drifts.ofSpheres == 0 ? uniform + ", and the drift is 0 about their origins"
                  : drifts.zero == 0
                      ? spheres
                      : spheres + alone + ", where the drift is 0 about their origins");
    else if (!*scheme.drift)
        drift << "off: " << scheme.name << " omits it, so averages are wrong for "
              << count(known + others);
    else {
        const int asWritten = scheme.differenced != Differenced::Nothing ? others : known + others;
        drift << "on: ";
        if (asWritten > 0) drift << scheme.drift << " for " << count(asWritten);
        if (asWritten < known + others)
            drift << (asWritten > 0 ? ", " : "") << "without differences for " << count(known)
                  << " alone in a uniform fluid";
    }
    bool isHeld = false;
    for (const auto& group : fluid.groups)
        isHeld = isHeld || (group->bodies.getFreeMotion().any() &&
                            group->brownian->getDrift() == BrownianGroup::Drift::Differenced);
    if (kT > 0 && isHeld) drift << " (also of spheres, beside what is held)";
    if (kT > 0 && known + others > 0 && zero > 0) drift << "; the drift is 0 for " << count(zero);
    if (scheme.differenced == Differenced::Nothing)
        differences << "off: the scheme has none";
    else if (kT == 0)
        differences << "off: the temperature is 0";
    else if (others == 0)
        differences << "off: "
                    << (drifts.ofSpheres == 0 ? uniform + ", whose divergence is known"
                        : drifts.ofSpheres == zero + known
                            ? spheres
                            : spheres + alone + ", whose divergence is known");
    else if (byFields)
        differences << "off: the divergence is computed from the gradient of the random field; "
                       "setFiniteDifferenceStep() has no effect";
    else {
        differences << "on: steps of " << smallest;
        if (largest > smallest)
            differences << " of exact results and " << largest << " of results of iterations, in";
        differences << " body lengths, and radians";
    }
    return {{"stochastic drift", drift.str()}, {"finite differences", differences.str()}};
}

}  // namespace RigidHIPlugin
