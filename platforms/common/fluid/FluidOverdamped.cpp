// Fluid: steps without momenta.

#include <openmm/OpenMMException.h>

#include <cmath>
#include <functional>
#include <sstream>

#include "fluid/Fluid.h"
#include "linearalgebra/OneBlasThread.h"
#include "openmmrigidhi/internal/Messages.h"
#include "rigid/ErrorBudget.h"
#include "rigidbody/BodyPoses.h"
#include "rigidbody/EigenVec3.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

namespace {

Differencing differencing(const SchemeTraits& scheme, const OverdampedMove& move,
                          const BodyMobility& mobility) {
    return Differencing::of(scheme, mobility, move.driftIsKnown());
}

/** Drifts below this part of mobility/length are rounding errors of a symmetric body. */
const double zeroDrift = 1e-12;

}  // namespace

OverdampedMove& Fluid::moveOf(FluidGroup& group) const {
    if (!group.overdamped.move)
        group.overdamped.move.reset(new OverdampedMove(*group.overdamped.mobility));
    return *group.overdamped.move;
}

/** Whether a scheme differences results of iterations, which have a tolerance. */
bool Fluid::differencesIterate(FluidGroup& group, const SchemeTraits& scheme) const {
    return differencing(scheme, moveOf(group), *group.overdamped.mobility).iterate;
}

/** Set the tolerance of iterations in this step. Without noise there are no differences. */
void Fluid::setTolerance(FluidGroup& group, const SchemeTraits& scheme,
                         const OverdampedStep& step) const {
    BodyMobility& mobility = *group.overdamped.mobility;
    const double tolerance = force.getSolverTolerance();
    Differencing differences;
    if (step.kT > 0) differences = differencing(scheme, moveOf(group), mobility);
    mobility.setTolerance(tolerance,
                          ErrorBudget::forDifferences(tolerance, differences, step.difference));
}

/** The finite-difference step: as set, or chosen by the errors of the differenced results. */
double Fluid::differenceOf(FluidGroup& group, const SchemeTraits& scheme, double wanted) const {
    if (wanted > 0) return wanted;
    return ErrorBudget::differenceStep(
        force.getSolverTolerance(),
        differencing(scheme, moveOf(group), *group.overdamped.mobility));
}

Fluid::Drifts Fluid::findDrifts() const {
    Drifts drifts;
    for (auto& group : groups) {
        const OverdampedMove& move = moveOf(*group);
        BodyMobility& mobility = *group->overdamped.mobility;
        if (!move.driftIsKnown())
            drifts.differenced.push_back(group.get());
        else if (move.driftIsZero())
            drifts.ofSpheres++;
        else if (group->bodies.isConstantInBodyFrame() &&
                 mobility.uniformDivergence().norm() >
                     zeroDrift * mobility.mobility()(0, 0) / group->bodies.length(0))
            drifts.known++;
        else
            drifts.zero++;
    }
    return drifts;
}

bool Fluid::hasStochasticDrift() const { return findDrifts().numNotZero() > 0; }

map<string, string> Fluid::describeDrift(const SchemeTraits& scheme, double kT,
                                         double difference) const {
    const Drifts drifts = findDrifts();
    const int others = drifts.differenced.size(), known = drifts.known,
              zero = drifts.zero + drifts.ofSpheres;
    double smallest = 0, largest = 0;
    bool byFields = scheme.differenced == Differenced::Roots;
    for (FluidGroup* group : drifts.differenced) {
        byFields = byFields && group->overdamped.mobility->divergenceIsOfField();
        const double step = differenceOf(*group, scheme, difference);
        smallest = smallest == 0 ? step : min(smallest, step);
        largest = max(largest, step);
    }
    const string uniform = "every body is alone in a uniform fluid",
                 spheres = string("the mobility of spheres in ") +
                           (isPeriodic() ? "a periodic" : "an unbounded") +
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
        if (largest > smallest) differences << " (dense) and " << largest << " (matrix-free)";
        differences << " body lengths, and radians";
    }
    return {{"stochastic drift", drift.str()}, {"finite differences", differences.str()}};
}

/** Take the forces and torques last gathered, at the present poses of the bodies. */
void Fluid::takeForces(FluidGroup& group, const BodySet& bodies,
                       const FreeParticles& freeParticles) const {
    const auto& elements = group.bodies.getElements();
    for (size_t e = 0; e < elements.size(); e++) {
        double* to = &group.overdamped.move->force(group.bodies.firstRow(e), 0);
        if (elements[e].isFree()) {
            const OpenMM::Vec3 force = freeParticles.getForce(group.freeIndex[e]);
            for (int k = 0; k < 3; k++) to[k] = force[k];
            continue;
        }
        const int s = bodies.slot(elements[e].body);
        const scalar::Rotation<double> turn(
            {bodies.q[0][s], bodies.q[1][s], bodies.q[2][s], bodies.q[3][s]});
        const auto torque_lab = turn.toLab(
            {bodies.torque_body[0][s], bodies.torque_body[1][s], bodies.torque_body[2][s]});
        for (int k = 0; k < 3; k++) to[k] = bodies.force_lab[k][s];
        to[3] = torque_lab.x;
        to[4] = torque_lab.y;
        to[5] = torque_lab.z;
    }
}

/**
 * Write a scheme's poses to the bodies. Forces stay those of the poses where they were evaluated,
 * in the lab frame.
 */
bool Fluid::writePlaces(const FluidGroup& group, const vector<Pose>& places, BodySet& bodies,
                        vector<OpenMM::Vec3>& positions) const {
    const auto& elements = group.bodies.getElements();
    double sum = 0;
    for (size_t e = 0; e < elements.size(); e++) {
        const Pose& place = places[e];
        sum += place.R.sum();
        if (elements[e].isFree()) {
            positions[elements[e].particles[0]] = toVec3(place.R);
            continue;
        }
        const int s = bodies.slot(elements[e].body);
        const scalar::Rotation<double> before(
            {bodies.q[0][s], bodies.q[1][s], bodies.q[2][s], bodies.q[3][s]});
        const auto torque_body = scalar::Rotation<double>(place.q).toBody(before.toLab(
            {bodies.torque_body[0][s], bodies.torque_body[1][s], bodies.torque_body[2][s]}));
        for (int k = 0; k < 3; k++) bodies.R[k][s] = place.R[k];
        bodies.q[0][s] = place.q.w;
        bodies.q[1][s] = place.q.x;
        bodies.q[2][s] = place.q.y;
        bodies.q[3][s] = place.q.z;
        bodies.torque_body[0][s] = torque_body.x;
        bodies.torque_body[1][s] = torque_body.y;
        bodies.torque_body[2][s] = torque_body.z;
        sum += place.q.w + place.q.x + place.q.y + place.q.z;
    }
    return isfinite(sum);
}

OverdampedScheme& Fluid::schemeOf(FluidGroup& group) const {
    if (!group.overdamped.scheme)
        group.overdamped.scheme = overdampedScheme(overdampedScheme_).make();
    return *group.overdamped.scheme;
}

void Fluid::beginOverdamped(CustomRigidHIIntegrator::Scheme scheme) {
    for (auto& group : groups) {
        if (scheme != overdampedScheme_) group->overdamped.scheme.reset();
        group->overdamped.stage = 0;
        group->overdamped.attempt = 0;
        group->overdamped.objection.clear();
    }
    overdampedScheme_ = scheme;
    for (auto& group : groups) {
        const auto memory = schemeOf(*group).memory();
        group->overdamped.memoryAtStart.resize(memory.size());
        for (size_t i = 0; i < memory.size(); i++) group->overdamped.memoryAtStart[i] = *memory[i];
        group->overdamped.placesOfForces.resize(overdampedScheme(scheme).numStages());
    }
}

void Fluid::endOverdamped() {
    for (auto& group : groups)
        if (hasOneFlow()) swap(group->overdamped.last, group->overdamped.present);
}

int Fluid::nextStage() const {
    int next = overdampedScheme(overdampedScheme_).numStages();
    for (const auto& group : groups) next = min(next, group->overdamped.stage);
    return next;
}

LoopResult Fluid::runStage(int stage, const StepSettings& settings, BodySet& bodies,
                           const FreeParticles& freeParticles, vector<OpenMM::Vec3>& positions) {
    const OneBlasThread single;
    flowOfLastStep.reset();
    const OverdampedEntry& entry = overdampedScheme(settings.scheme);
    double operations = 0;
    for (auto& group : groups) {
        slowSpins(*group, 2 * settings.kT * settings.h);
        moveOf(*group);
        group->overdamped.isFinite = true;
        group->overdamped.randomNumbers = group->overdamped.squareRoots =
            group->overdamped.iterations = 0;
        if (group->overdamped.stage != stage) continue;
        const double rows = group->bodies.getNumRows(),
                     particleRows = group->bodies.getNumParticleRows();
        operations += group->bodies.isConstantInBodyFrame()
                          ? operationsOfConstantTensor
                          : rows * rows * rows + particleRows * particleRows * particleRows;
    }
    OverdampedStep step;
    step.h = settings.h;
    step.kT = settings.kT;
    step.noise = settings.noise;
    step.flow = flowIfAny();
    step.driftFactorScalesAll = settings.driftCorrectorScaling == CustomRigidHIIntegrator::Whole;
    const auto task = [&](int i) {
        FluidGroup& group = *groups[i];
        OverdampedMove& move = *group.overdamped.move;
        if (group.overdamped.stage != stage) {
            if (stage > 0) writePlaces(group, move.present, bodies, positions);
            return;
        }
        BodyMobility& mobility = *group.overdamped.mobility;
        const MobilityCosts before = mobility.getCosts();
        move.randomNumbers = 0;
        if (stage == 0) {
            OverdampedStep own = step;
            own.noise.attempt = group.overdamped.attempt;
            own.difference = differenceOf(group, settings.traits(), settings.difference);
            setTolerance(group, settings.traits(), own);
            group.readPoses(bodies, positions, move.start);
            move.begin(own);
            if (hasOneFlow()) {
                LastStep& present = group.overdamped.present;
                present.isKnown = false;
                present.scheme = settings.scheme;
                present.step = own;
                present.box = box;
                present.start = move.start;
                present.forces.resize(entry.numStages());
                present.memory = group.overdamped.memoryAtStart;
            }
        }
        if (entry.needsForces(stage)) {
            takeForces(group, bodies, freeParticles);
            if (hasOneFlow()) group.overdamped.present.forces[stage] = move.force;
            if (settings.kT > 0) noteDrivenSpins(group, settings.h, settings.kT);
        }
        group.overdamped.scheme->run(stage, move);
        group.overdamped.stage++;
        if (group.overdamped.stage == entry.numStages() && hasOneFlow()) {
            group.overdamped.present.end = move.present;
            group.overdamped.present.isKnown = true;
        }
        if (group.overdamped.stage < entry.numStages())
            group.overdamped.placesOfForces[group.overdamped.stage] = move.present;
        group.overdamped.isFinite = writePlaces(group, move.present, bodies, positions);
        if (group.overdamped.isFinite)
            group.overdamped.objection = objection(group, bodies, positions);
        group.overdamped.randomNumbers = move.randomNumbers;
        group.overdamped.squareRoots = mobility.getCosts().roots - before.roots;
        group.overdamped.iterations = mobility.getCosts().iterations - before.iterations;
    };
    if (groups.size() > 1 && operations > worthThreads)
        loops.forTasks(groups.size(), cref(task));
    else
        for (size_t i = 0; i < groups.size(); i++) task(i);
    LoopResult result;
    for (const auto& group : groups) {
        result.randomNumbers += group->overdamped.randomNumbers;
        result.finite = result.finite && group->overdamped.isFinite;
        numSquareRoots += group->overdamped.squareRoots;
        numIterations += group->overdamped.iterations;
    }
    return result;
}

Fluid::Rejections Fluid::takeBackRejected(const BodySet::Snapshot& bodiesAtStart,
                                          const FreeParticles::Snapshot& freeAtStart,
                                          BodySet& bodies, FreeParticles& freeParticles,
                                          vector<OpenMM::Vec3>& positions) {
    Rejections result;
    for (auto& group : groups) {
        if (group->overdamped.objection.empty()) continue;
        const auto& elements = group->bodies.getElements();
        for (size_t e = 0; e < elements.size(); e++)
            if (elements[e].isFree())
                freeParticles.restore(freeAtStart, group->freeIndex[e], positions);
            else
                bodies.restore(bodiesAtStart, elements[e].body);
        group->overdamped.stage = 0;
        group->overdamped.attempt++;
        restoreMemory(*group);
        result.number++;
        if ((int)group->overdamped.attempt > result.attempts) {
            result.attempts = group->overdamped.attempt;
            result.objection = group->overdamped.objection;
        }
        group->overdamped.objection.clear();
    }
    return result;
}

void Fluid::showStage(int stage, BodySet& bodies, vector<OpenMM::Vec3>& positions) const {
    for (const auto& group : groups)
        if (group->overdamped.stage > stage)
            writePlaces(*group, group->overdamped.placesOfForces[stage], bodies, positions);
}

double Fluid::getDriftFactorSpread() const {
    // The standard deviation of so many values is known to a tenth.
    const int enough = 50;
    double spread = 0;
    for (const auto& group : groups) {
        const OverdampedMove* move = group->overdamped.move.get();
        if (move && move->getNumDriftFactors() >= enough)
            spread = max(spread, move->driftFactorSpread());
    }
    return spread;
}

void Fluid::restoreMemory(FluidGroup& group) const {
    if (!group.overdamped.scheme) return;
    const auto memory = group.overdamped.scheme->memory();
    for (size_t i = 0; i < memory.size() && i < group.overdamped.memoryAtStart.size(); i++)
        *memory[i] = group.overdamped.memoryAtStart[i];
}

void Fluid::restoreMemory() {
    for (auto& group : groups) restoreMemory(*group);
}

void Fluid::forgetMemory() {
    for (auto& group : groups)
        if (group->overdamped.scheme)
            for (MatrixXd* vectors : group->overdamped.scheme->memory()) vectors->resize(0, 0);
}

SchemeMemory Fluid::getMemory() const {
    SchemeMemory saved;
    for (const auto& group : groups) {
        if (!group->overdamped.scheme) continue;
        vector<MatrixXd> own;
        for (MatrixXd* vectors : group->overdamped.scheme->memory()) own.push_back(*vectors);
        if (!own.empty()) saved.groups.push_back(own);
    }
    if (!saved.groups.empty()) saved.scheme = traitsOf(overdampedScheme_).name;
    return saved;
}

void Fluid::checkMemory(const SchemeMemory& saved, CustomRigidHIIntegrator::Scheme scheme) const {
    const SchemeTraits& traits = traitsOf(scheme);
    if (saved.groups.empty() || saved.scheme != traits.name) return;
    bool fits = traits.isOverdamped() && saved.groups.size() == groups.size();
    const size_t count = fits ? overdampedScheme(scheme).make()->memory().size() : 0;
    for (size_t g = 0; fits && g < groups.size(); g++) {
        fits = saved.groups[g].size() == count;
        for (const MatrixXd& vectors : saved.groups[g])
            fits =
                fits && (vectors.size() == 0 ||
                         (vectors.rows() == groups[g]->bodies.getNumRows() && vectors.allFinite()));
    }
    if (!fits)
        throw OpenMM::OpenMMException(
            "CustomRigidHIIntegrator: the saved state's memory of scheme " + saved.scheme +
            " is damaged, or belongs to other bodies; load the state into an integrator with the "
            "same bodies and groups, or use another state");
}

void Fluid::setMemory(const SchemeMemory& saved, CustomRigidHIIntegrator::Scheme scheme) {
    checkMemory(saved, scheme);
    forgetMemory();
    if (saved.groups.empty() || saved.scheme != traitsOf(scheme).name) return;
    beginOverdamped(scheme);
    for (size_t g = 0; g < groups.size(); g++) {
        const auto memory = schemeOf(*groups[g]).memory();
        for (size_t i = 0; i < memory.size(); i++) *memory[i] = saved.groups[g][i];
    }
}

}  // namespace RigidHIPlugin
