#include "fluid/BrownianGroup.h"

#include <cmath>

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

namespace {

/** Drifts below this part of mobility/length are rounding errors of a symmetric body. */
const double zeroDrift = 1e-12;

/** This number of drift factors gives their standard deviation to a tenth. */
const int enoughDriftFactors = 50;

/**
 * Forces keep turning a body if it turns by more than `surelyDriven` standard deviations of the
 * turn by noise, and by more than `leastTurn`. A body that relaxes to its place turns by pi at
 * most, and by less than `leastTurn` if a stiff force makes it overshoot.
 */
const double surelyDriven = 6, leastTurn = 4 * M_PI;

const int leastSteps = 100;

}  // namespace

BrownianGroup::BrownianGroup(const GroupMembers& members, BodyMobility& mobility,
                             BodiesAlone& alone, double tolerance)
    : members(members), bodies(members.getBodies()), realMobility(&mobility), alone(alone),
      tolerance(tolerance), mobility(&mobility), watch(bodies, alone) {}

OverdampedMove& BrownianGroup::theMove() {
    if (!move) {
        move = make_unique<OverdampedMove>(*mobility);
        move->setJoints(joints);
    }
    return *move;
}

OverdampedScheme& BrownianGroup::theScheme() {
    if (!scheme) scheme = overdampedScheme(kind).make();
    return *scheme;
}

// ---- Steps

void BrownianGroup::begin(Scheme wanted) {
    if (wanted != kind) scheme.reset();
    kind = wanted;
    stage = 0;
    attempt = 0;
    const auto memory = theScheme().memory();
    memoryAtStart.resize(memory.size());
    for (size_t i = 0; i < memory.size(); i++) memoryAtStart[i] = *memory[i];
    placesOfForces.resize(overdampedScheme(kind).numStages());
}

void BrownianGroup::end() {
    numSteps++;
    if (presentIsRemembered) swap(last, present);
    if (bodies.getFreeMotion().any()) {
        swap(lastHolds, presentHolds);
        holdsAreKnown = true;
    }
    if (joints) swap(lastJointForces, presentJointForces);
}

void BrownianGroup::prepare(const StepSettings& settings) {
    mobilityFor(2 * settings.kT * settings.h, settings.scheme);
    theMove();
    outcome = Outcome();
}

double BrownianGroup::getOperations() const {
    const double rows = bodies.getNumRows(), particleRows = bodies.getNumParticleRows();
    return bodies.isConstantInBodyFrame()
               ? operationsOfConstantTensor
               : rows * rows * rows + particleRows * particleRows * particleRows;
}

/** Read the poses at the start of the step, and set what is constant during the step. */
void BrownianGroup::startStep(const StepSettings& settings, const Surroundings& around,
                              const BodySet& set, const vector<OpenMM::Vec3>& positions) {
    OverdampedStep own;
    own.h = settings.h;
    own.kT = settings.kT;
    own.noise = settings.noise;
    own.flow = around.flow;
    own.driftFactorScalesAll = settings.driftCorrectorScaling == CustomRigidHIIntegrator::Whole;
    own.noise.attempt = attempt;
    own.difference = differenceOf(settings.traits(), settings.difference);
    own.motorRates = motorRates;
    setErrors(settings.traits(), own);
    members.readPoses(set, positions, move->start);
    move->begin(own);
    if (bodies.getFreeMotion().any()) {
        presentHolds.setZero(bodies.getNumRows(), 1);
        move->recording.holds = &presentHolds;
    }
    if (joints) {
        joints->check(move->start, jointMisfit);
        joints->findAngles(move->start, anglesOfMotors);
        joints->turnBy(settings.h * motorRates, anglesOfMotors);
        presentJointForces.setZero(4, joints->getJoints().size());
        move->recording.jointForces = &presentJointForces;
    }
    presentIsRemembered = around.stepIsRemembered;
    if (!presentIsRemembered) return;
    present.isKnown = false;
    present.scheme = settings.scheme;
    present.step = own;
    present.box = around.box;
    present.start = move->start;
    present.forces.resize(overdampedScheme(settings.scheme).numStages());
    present.memory = memoryAtStart;
    present.prescribed.clear();
}

bool BrownianGroup::runStage(int wanted, const StepSettings& settings, const Surroundings& around,
                             BodySet& set, const FreeParticles& freeParticles,
                             vector<OpenMM::Vec3>& positions) {
    if (stage != wanted) {
        if (wanted > 0) members.writePoses(move->present, set, positions);
        return false;
    }
    const OverdampedEntry& entry = overdampedScheme(settings.scheme);
    const MobilityCosts before = mobility->getCosts();
    move->randomNumbers = 0;
    if (stage == 0) startStep(settings, around, set, positions);
    const bool isDriven = members.readPrescribed(around.prescribed, prescribed);
    move->prescribe(isDriven ? &prescribed : nullptr);
    if (isDriven && presentIsRemembered) {
        present.prescribed.resize(entry.numStages());
        present.prescribed[stage] = prescribed;
    }
    if (entry.needsForces(stage)) {
        members.readForces(set, freeParticles, move->force);
        if (presentIsRemembered) present.forces[stage] = move->force;
        const bool isFirst = stage == 0 || !entry.needsForces(0);
        if (settings.kT > 0 && isFirst) noteDrivenSpins(settings.h, settings.kT);
        if (isFirst)
            watch.note(numSteps, settings.h, settings.kT, move->present, move->force,
                       {!around.flow || !around.flow->hasGradient(),
                        !around.flow && entry.numForceEvaluations() == 1});
    }
    scheme->run(stage, *move);
    // A dense solve keeps nothing for later ones, so that no step depends on the watch.
    if (watch.getFalls() && mobility->getWay() == BodyMobility::Dense &&
        watch.isAt(mobility->getPoses())) {
        mobility->solve(*watch.getFalls(), velocitiesOfFalls);
        watch.addVelocities(velocitiesOfFalls);
    }
    stage++;
    if (joints && stage == entry.numStages()) {
        if (ownMobilities.empty())
            for (size_t e = 0; e < bodies.getElements().size(); e++)
                ownMobilities.push_back(alone.of(e).mobility);
        joints->project(ownMobilities, jointTolerance, anglesOfMotors, move->present);
    }
    if (stage == entry.numStages() && presentIsRemembered) {
        present.end = move->present;
        present.isKnown = true;
    }
    if (stage < entry.numStages()) placesOfForces[stage] = move->present;
    outcome.isFinite = members.writePoses(move->present, set, positions);
    outcome.randomNumbers = move->randomNumbers;
    outcome.squareRoots = mobility->getCosts().roots - before.roots;
    outcome.iterations = mobility->getCosts().iterations - before.iterations;
    return true;
}

void BrownianGroup::reject() {
    stage = 0;
    attempt++;
    numRejections++;
    restoreMemory();
}

void BrownianGroup::showStage(int wanted, BodySet& set, vector<OpenMM::Vec3>& positions) const {
    if (stage > wanted) members.writePoses(placesOfForces[wanted], set, positions);
}

// ---- Memory

vector<MatrixXd*> BrownianGroup::getMemory() const {
    return scheme ? scheme->memory() : vector<MatrixXd*>();
}

void BrownianGroup::restoreMemory() {
    const auto memory = getMemory();
    for (size_t i = 0; i < memory.size() && i < memoryAtStart.size(); i++)
        *memory[i] = memoryAtStart[i];
}

void BrownianGroup::forgetMemory() {
    for (MatrixXd* vectors : getMemory()) vectors->resize(0, 0);
}

// ---- Differences and drift

Differencing BrownianGroup::differencing(const SchemeTraits& traits) {
    return Differencing::of(traits, *mobility, theMove().driftIsKnown());
}

ErrorBudget BrownianGroup::errorsOf(const SchemeTraits& traits, double kT, double difference) {
    Differencing differences;  // without noise a step takes none
    if (kT > 0) differences = differencing(traits);
    return ErrorBudget::ofDifferencing(tolerance, differences, difference);
}

double BrownianGroup::differenceOf(const SchemeTraits& traits, double wanted) {
    if (wanted > 0) return wanted;
    return ErrorBudget::differenceStep(tolerance, differencing(traits));
}

BrownianGroup::Drift BrownianGroup::getDrift() {
    const OverdampedMove& here = theMove();
    if (!here.driftIsKnown()) return Drift::Differenced;
    if (here.driftIsZero()) return Drift::ZeroOfSpheres;
    const bool isKnown = bodies.isConstantInBodyFrame() && !mobility->getBodies().isImmobile() &&
                         mobility->uniformDivergence().norm() >
                             zeroDrift * mobility->mobility()(0, 0) / bodies.length(0);
    return isKnown ? Drift::Known : Drift::Zero;
}

double BrownianGroup::getDriftFactorSpread() const {
    return move && move->driftFactors.size() >= enoughDriftFactors ? move->driftFactors.spread()
                                                                   : 0;
}

const MatrixXd& BrownianGroup::readForces(const BodySet& set, const FreeParticles& freeParticles) {
    members.readForces(set, freeParticles, theMove().force);
    return move->force;
}

// ---- Spins that a step does not resolve

const vector<BodyRotation>& BrownianGroup::findRotations(double doubleEnergy, Scheme of) {
    if (stepOfRotations == make_pair(doubleEnergy, of)) return rotations;
    const SpinBounds& bounds = overdampedScheme(of).spins;
    const auto& elements = bodies.getElements();
    rotations.assign(elements.size(), BodyRotation());
    for (size_t e = 0; e < elements.size(); e++)
        if (!elements[e].isFree() && elements[e].isWhollyFree() &&
            !(joints && joints->concerns(e)) &&
            !(elements[e].isSphere() && elements[e].ownMobility.size() == 0))
            rotations[e] = findRotation(alone.of(e).mobility, doubleEnergy, bounds);
    drivenSpins.assign(elements.size(), DrivenSpin());
    stepOfRotations = {doubleEnergy, of};
    return rotations;
}

BodyMobility& BrownianGroup::mobilityFor(double doubleEnergy, Scheme of) {
    const pair<double, Scheme> step(doubleEnergy, of);
    // Calls for other steps may have found other rotations since.
    if (stepOfMobility == step && (doubleEnergy == 0 || stepOfRotations == step)) return *mobility;
    stepOfMobility = step;
    vector<SlowedSpin> spins;
    bool any = false;
    if (doubleEnergy > 0)
        for (const BodyRotation& rotation : findRotations(doubleEnergy, of)) {
            spins.push_back(rotation.spin);
            any = any || rotation.spin.isSlowed();
        }
    BodyMobility* wanted = realMobility;
    if (any) {
        if (stepOfSlowed != step) {
            if (slowed) costsOfFormerSlowed.add(slowed->mobilities.getCosts());
            move.reset();
            slowed = make_unique<SlowedBodies>(bodies, spins, tolerance);
            stepOfSlowed = step;
        }
        wanted = &slowed->mobilities.get(realMobility->getWay());
    }
    if (mobility != wanted) move.reset();  // made anew when first needed
    mobility = wanted;
    return *mobility;
}

/** Note how the forces of this step turn slowed bodies. */
void BrownianGroup::noteDrivenSpins(double h, double kT) {
    for (size_t e = 0; e < rotations.size(); e++) {
        const BodyRotation& rotation = rotations[e];
        if (!rotation.spin.isSlowed()) continue;
        const Matrix3d A = move->present[e].rotation();
        const auto wrench = move->force.col(0).segment<6>(bodies.firstRow(e));
        const SlowedSpin::Vector6d screw = rotation.spin.slowedScrew();
        const double torque = (A * screw.head<3>()).dot(wrench.head<3>()) +
                              (A * screw.tail<3>()).dot(wrench.tail<3>());
        DrivenSpin& driven = drivenSpins[e];
        driven.turn += h * rotation.spin.factor * rotation.fastest * torque;
        driven.variance += 2 * kT * h * rotation.fastestInStep();
        driven.steps++;
    }
}

bool BrownianGroup::isDriven(int e) const {
    const DrivenSpin& driven = drivenSpins[e];
    return driven.steps >= leastSteps && abs(driven.turn) > leastTurn &&
           abs(driven.turn) > surelyDriven * sqrt(driven.variance);
}

bool BrownianGroup::drivesSlowedSpins() const {
    for (size_t e = 0; e < drivenSpins.size(); e++)
        if (isDriven(e)) return true;
    return false;
}

MobilityCosts BrownianGroup::getCostsOfSlowed() const {
    MobilityCosts sum = costsOfFormerSlowed;
    if (slowed) sum.add(slowed->mobilities.getCosts());
    return sum;
}

void BrownianGroup::setBox(const BoxVectors& box) {
    if (slowed) slowed->bodies.setBox(box);
}

}  // namespace RigidHIPlugin
