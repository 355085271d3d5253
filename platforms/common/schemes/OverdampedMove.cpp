#include "schemes/OverdampedMove.h"

#include <openmm/OpenMMException.h>

#include <cmath>

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

namespace {

/** Rotate(q, turn): rotate q by the angle |turn| about the direction of turn, lab frame. */
scalar::Quaternion<double> rotated(const scalar::Quaternion<double>& q, const Vector3d& turn) {
    return scalar::exponential(
               scalar::Vector3<double>{0.5 * turn.x(), 0.5 * turn.y(), 0.5 * turn.z()}) *
           q;
}

/**
 * The step of the differences for the flow of a known drift, in body lengths and radians. It
 * balances rounding of 1e-16 and the error of the difference.
 */
const double recordedDifference = 1e-5;

/**
 * How often to try a finite difference again with a tenth of its step, if the model has no mobility
 * at its ends.
 */
const int maxShrinks = 3;

}  // namespace

OverdampedMove::OverdampedMove(BodyMobility& mobility) : mobility(mobility) {
    const CoupledBodies& bodies = mobility.getBodies();
    const auto& elements = bodies.getElements();
    start.resize(elements.size());
    present = start;
    for (size_t e = 0; e < elements.size(); e++)
        for (int i = 0; i < elements[e].numRows(); i++)
            lengths.push_back(i < 3 ? bodies.length(e) : 1);
    force.setZero(bodies.getNumRows(), 1);
}

void OverdampedMove::begin(const OverdampedStep& step) {
    // The spread of drift factors belongs to a step size and a temperature.
    if (h != step.h || kT != step.kT) driftFactors = DriftFactors();
    h = step.h;
    kT = step.kT;
    stream = step.noise;
    differenceStep_ = step.difference;
    driftFactorScalesAll_ = step.driftFactorScalesAll;
    flow = step.flow;
    if (joints) joints->findRightSides(step.motorRates, rightSides);
    randomNumbers = 0;
    differencesHaveEnded = false;
    present = start;
}

void OverdampedMove::goFromStart(double t, const Vectors& twistsOfAll, double nu) {
    const bool scalesFree = prescribed && nu != 1;
    if (scalesFree)
        scaledTwists = nu * twistsOfAll + (1 - nu) * findPrescribed(mobility.getPoses());
    else
        t *= nu;
    const Vectors& twists = scalesFree ? scaledTwists : twistsOfAll;
    const auto& elements = mobility.getBodies().getElements();
    for (size_t e = 0; e < start.size(); e++) {
        const int row = mobility.getBodies().firstRow(e);
        if (elements[e].isHeld) {
            present[e] = start[e];
            continue;
        }
        present[e].R = start[e].R + t * twists.col(0).segment<3>(row);
        if (elements[e].isFree()) continue;
        present[e].q = rotated(start[e].q, t * twists.col(0).segment<3>(row + 3));
        scalar::renormalise(present[e].q);
    }
}

// ---- Random numbers

void OverdampedMove::drawNumbers(uint32_t purpose, uint32_t index, int count, double* numbers) {
    double unused;
    for (int k = 0; k < count; k += 2)
        stream.pair(purpose, index, k / 2, numbers[k], k + 1 < count ? numbers[k + 1] : unused);
    randomNumbers += count;
}

/** @param onlyFree  leave out elements that are wholly fixed; their numbers are 0 */
void OverdampedMove::drawForBodies(uint32_t purpose, uint32_t freePurpose, Vectors& numbers,
                                   bool onlyFree) {
    const auto& elements = mobility.getBodies().getElements();
    numbers.resize(getNumRows(), 1);
    for (size_t e = 0; e < elements.size(); e++) {
        if (onlyFree && elements[e].isWhollyFixed()) {
            numbers.middleRows(mobility.getBodies().firstRow(e), elements[e].numRows()).setZero();
            continue;
        }
        double* to = &numbers(mobility.getBodies().firstRow(e), 0);
        if (elements[e].isFree())
            drawNumbers(freePurpose, elements[e].particles[0], 3, to);
        else
            drawNumbers(purpose, elements[e].body, 6, to);
    }
}

void OverdampedMove::drawForParticles(uint32_t purpose, Vectors& numbers) {
    const HydrodynamicParticles& particles = mobility.getBodies().getParticles();
    if (mobility.getSlipSpace().areOfParts()) {
        numbers.resize(mobility.getSlipSpace().getNumFarRows(), 1);
        double ofParticle[11];
        for (int i = 0; i < particles.size(); i++) {
            drawNumbers(purpose, particles.systemIndex[i], 11, ofParticle);
            std::copy_n(ofParticle, 6, &numbers(particles.firstRow[i], 0));
            std::copy_n(ofParticle + 6, 5, &numbers(particles.numRows + 5 * i, 0));
        }
        return;
    }
    numbers.resize(particles.numRows, 1);
    for (int i = 0; i < particles.size(); i++)
        drawNumbers(purpose, particles.systemIndex[i], particles.hasTorque[i] ? 6 : 3,
                    &numbers(particles.firstRow[i], 0));
}

void OverdampedMove::thermalWrench(Draw draw, Vectors& wrench) {
    if (mobility.wrenchNoiseIsOfBodies())
        drawForBodies(draw == First ? NoiseStream::FirstDraw : NoiseStream::SecondDraw,
                      draw == First ? NoiseStream::FreeFirstDraw : NoiseStream::FreeSecondDraw, W);
    else
        drawForParticles(
            draw == First ? NoiseStream::ParticleFirstDraw : NoiseStream::ParticleSecondDraw, W);
    mobility.drawForPairs(
        stream, draw == First ? NoiseStream::ParticleFirstDraw : NoiseStream::ParticleSecondDraw);
    mobility.thermalWrench(W, wrench);
    randomNumbers += mobility.takeNumPairNumbers();
}

void OverdampedMove::drawForSlips(Draw draw) {
    const uint32_t ofParticles =
        draw == First ? NoiseStream::ParticleFirstDraw : NoiseStream::ParticleSecondDraw;
    slipsAreOfField = mobility.field().draw(stream, ofParticles, field);
    fieldIsCounted = false;
    mobility.drawForPairs(stream, ofParticles);
    if (slipsAreOfField) return;
    if (mobility.slipNoiseIsOfBodies())
        drawForBodies(draw == First ? NoiseStream::FirstDraw : NoiseStream::SecondDraw,
                      draw == First ? NoiseStream::FreeFirstDraw : NoiseStream::FreeSecondDraw,
                      W_slip);
    else
        drawForParticles(ofParticles, W_slip);
}

void OverdampedMove::thermalSlip(Vectors& slips) {
    if (slipsAreOfField) {
        mobility.slipsOf(*field, slips);
        countField();
    } else
        mobility.thermalSlip(W_slip, slips);
    randomNumbers += mobility.takeNumPairNumbers();
    if (recording.flow) recordedSlips = slips;
}

// ---- Solves

const OverdampedMove::Vectors& OverdampedMove::slipsOf(const Column& column) {
    if (!column.givesVelocity) return noSlips;
    const bool active = mobility.getBodies().areActive();
    if (!flow && !active && !prescribed && column.moreSlips.size() == 0) return column.slips;
    bool any = false;
    const auto add = [&](const Vectors& more) {
        if (more.size() == 0) return;
        if (any)
            mobility.getSlipSpace().add(more, slipsOfColumn);
        else
            slipsOfColumn = more;  // without allocation: its size stays
        any = true;
    };
    add(column.slips);
    if (flow) {
        mobility.flowSlipsOfSolve(*flow, slipsOfFlow);
        add(slipsOfFlow);
    }
    if (active) {
        mobility.flow().activeSlips(slipsOfActive);
        add(slipsOfActive);
    }
    add(column.moreSlips);
    if (prescribed) {
        mobility.rigidSlips(mobility.getPoses(), -findPrescribed(mobility.getPoses()),
                            slipsOfFixed);
        add(slipsOfFixed);
    }
    return slipsOfColumn;
}

/** The wrench of a column, with the wrenches that bodies take from their forces on the fluid. */
const OverdampedMove::Vectors& OverdampedMove::wrenchOf(const Column& column) {
    if (!column.givesVelocity || !mobility.getBodies().getForcesOnFluid()) return column.wrench;
    wrenchOfColumn = column.wrench;
    mobility.flow().addActiveWrenches(wrenchOfColumn);
    return wrenchOfColumn;
}

/** The twists that forces of joints cause at the poses set last, N C^T, and (C N C^T)^-1. */
void OverdampedMove::findResponse() {
    if (responseIsKnown) return;
    joints->findRows(mobility.getPoses(), C);
    wrenchesWithJoints = C.transpose();
    mobility.solve(wrenchesWithJoints, N_CT);
    joints->factorise(C * N_CT, inverseOfCNC);
    responseIsKnown = true;
}

void OverdampedMove::solveWithJoints(const Vectors& wrenches, const Vectors& slips, bool fromKept,
                                     const Column* const* columns, Vectors& twists) {
    const auto solveThese = [&](const Vectors& these) {
        if (fromKept)
            mobility.solveFromKept(these, slips, twists);
        else
            mobility.solve(these, slips, twists);
    };
    if (!joints) {
        solveThese(wrenches);
        return;
    }
    findResponse();
    solveThese(wrenches);
    twistsOfWrenches = twists;
    for (int k = 0; k < twists.cols(); k++)
        if (prescribed && columns[k]->givesVelocity)
            twistsOfWrenches.col(k) += findPrescribed(mobility.getPoses()).col(0);
    mu = C * twistsOfWrenches;
    if (rightSides.size() > 0)
        for (int k = 0; k < mu.cols(); k++)
            if (columns[k]->givesVelocity) mu.col(k) -= rightSides;
    mu = -inverseOfCNC * mu;
    wrenchesWithJoints = wrenches + C.transpose() * mu;
    // Solve once more, so that the forces of particles include those of joints.
    solveThese(wrenchesWithJoints);
}

void OverdampedMove::finishSolve(const Column& solved, Vectors& twists, int column) {
    if (prescribed && solved.givesVelocity) twists.col(column) += twistsOfFixed.col(0);
    recordSolve(solved, column);
    recordHold(solved, column);
    if (joints && recording.jointForces && solved.weight != 0) {
        joints->forces(mobility.getPoses(), mu.col(column), forcesOfJoints);
        *recording.jointForces += solved.weight * forcesOfJoints;
        if (solved.axisForces)
            *recording.jointForces += solved.weight * solved.axisFactor * axisForcesOfJoints;
    }
}

/**
 * On fixed components act the fluid, the wrench of the solve, and the hold, which balances both.
 * Differences of K in the wrench of a solve count as forces.
 */
void OverdampedMove::recordHold(const Column& solved, int column) {
    if (!recording.holds || solved.weight == 0) return;
    mobility.getBlobForces(forcesOfSolve);
    forcesOfSolve = forcesOfSolve.col(column).eval();
    mobility.totalWrenches(mobility.getPoses(), forcesOfSolve, wrenchesOfSolve);
    if (joints) wrenchesOfSolve -= C.transpose() * mu.col(column);  // not a part of the hold
    *recording.holds += solved.weight * (wrenchesOfSolve - wrenchOf(solved).col(0));
    if (solved.axisForces)
        *recording.holds += solved.weight * solved.axisFactor * axisForcesOfFixed;
}

const OverdampedMove::Vectors& OverdampedMove::findPrescribed(const vector<Pose>& at) {
    setTurns(at, turnsOfFixed);
    mobility.getBodies().getFreeMotion().motionOfFixed(turnsOfFixed, *prescribed, twistsOfFixed);
    return twistsOfFixed;
}

void OverdampedMove::addPrescribed(Vectors& twists) {
    if (prescribed) twists += findPrescribed(start);
}

void OverdampedMove::addShear(Vectors& twists) {
    // Only a box that tilts has both periodic images and a gradient.
    const CoupledBodies& bodies = mobility.getBodies();
    if (!flow || flow->gradient.isZero(0) || !bodies.hasModel() || !bodies.getModel().box()) return;
    atStart();
    mobility.flow().slipsOf(*flow, slipsOfFlow);
    nearestTwists(slipsOfFlow, twistsOfFlow);
    twists += twistsOfFlow;
}

void OverdampedMove::solve(const Column& column, Vectors& twists) {
    const Column* const columns[] = {&column};
    solveWithJoints(wrenchOf(column), slipsOf(column), false, columns, twists);
    finishSolve(column, twists);
}

void OverdampedMove::solveFromKept(const Column& column, Vectors& twists) {
    const Column* const columns[] = {&column};
    solveWithJoints(wrenchOf(column), slipsOf(column), true, columns, twists);
    finishSolve(column, twists);
}

void OverdampedMove::solve(const Column& first, const Column& second, Vectors& twists) {
    const Column* columns[] = {&first, &second};
    wrenches.resize(getNumRows(), 2);
    slips.resize(0, 0);
    for (int k = 0; k < 2; k++) {
        wrenches.col(k) = wrenchOf(*columns[k]).col(0);
        const Vectors& ofColumn = slipsOf(*columns[k]);
        if (ofColumn.size() == 0) continue;
        if (slips.size() == 0) slips.setZero(ofColumn.rows(), 2);
        slips.col(k) = ofColumn.col(0);
    }
    solveWithJoints(wrenches, slips, false, columns, twists);
    for (int k = 0; k < 2; k++) finishSolve(*columns[k], twists, k);
}

// ---- The flow of the step

void OverdampedMove::recordSolve(const Column& solved, int column) {
    if (!recording.flow || solved.weight == 0) return;
    recordShare(solved.weight, column, solved.givesVelocity);
    if (solved.givesVelocity) recording.flow->solveWeight += solved.weight;
}

void OverdampedMove::recordShare(double weight, int column, bool movesBodies) {
    Vectors forces;
    mobility.getBlobForces(forces);
    recording.flow->shares.push_back(
        {weight, mobility.getPoses(), forces.col(column), movesBodies});
}

void FlowOfStep::check(const string& scheme) const {
    const double rounding = 1e-9;
    if (abs(solveWeight - flowWeight) <= rounding * (1 + abs(flowWeight))) return;
    throw OpenMM::OpenMMException(
        "CustomRigidHIIntegrator: the scheme " + scheme +
        " does not record the flow of its step completely: the weights of its solves for "
        "velocities in this flow add up to " +
        to_string(solveWeight) + ", and must add up to " + to_string(flowWeight) +
        "; use another scheme, or give each such solve its weight (CONTRIBUTING.md)");
}

void OverdampedMove::recordThermalSlip(double weight) {
    if (!recording.flow) return;
    if (slipsAreOfField) {
        recording.flow->fieldWeight += weight;
        return;
    }
    Vectors forces;
    // Spheres without drift keep the slips that they had at the start.
    if (driftIsZero())
        mobility.forcesOfSlips(recordedSlips, forces);
    else
        mobility.forcesOfThermalSlip(W_slip, forces);
    recording.flow->shares.push_back({weight, mobility.getPoses(), forces, false});
}

void OverdampedMove::recordTractions(double kT) {
    if (!recording.flow) return;
    recording.flow->shares.push_back({kT / centralStep, forward, lambda, false});
    recording.flow->shares.push_back({-kT / centralStep, backward, lambda, false});
}

void OverdampedMove::recordFactor(double nu) {
    if (recording.holds) *recording.holds *= nu;
    if (!recording.flow) return;
    for (FlowOfStep::Share& share : recording.flow->shares) share.weight *= nu;
    recording.flow->fieldWeight *= nu;
    recording.flow->flowWeight *= nu;
    recording.flow->solveWeight *= nu;
}

void OverdampedMove::removeTurnsFromHolds() {
    if (!recording.holds) return;
    setTurns(mobility.getPoses(), turnsOfFixed);
    mobility.getBodies().getNullTwistsOfFree().addDivergenceOfTurns(turnsOfFixed, -kT,
                                                                    *recording.holds);
}

double OverdampedMove::divergenceOfField() {
    const double divergence = mobility.field().divergenceOf(*field);
    countField();
    return divergence;
}

/** Count the numbers now, since a field may draw them only when it has to give slips. */
void OverdampedMove::countField() {
    if (!fieldIsCounted) randomNumbers += field->getNumRandomNumbers();
    fieldIsCounted = true;
}

// ---- Finite differences

void OverdampedMove::addKnownDrift(double factor, Vectors& twists) {
    if (!mobility.getBodies().isUniform() || mobility.getBodies().getElements()[0].isFree()) return;
    twists.col(0).head<3>() += factor * mobility.uniformDivergence();
    if (recording.flow) recordKnownDrift(factor);
}

/**
 * The fluid away from the body has another divergence than the body. Compute it coordinate by
 * coordinate, since the cost does not matter here.
 */
void OverdampedMove::recordKnownDrift(double factor) {
    vector<Pose> displaced;
    Vectors wrench, twists;
    for (int row = 0; row < getNumRows(); row++) {
        wrench.setZero(getNumRows(), 1);
        wrench(row, 0) = 1;
        for (int sign : {1, -1}) {
            displaceBy(sign * recordedDifference, row, displaced);
            at(displaced);
            mobility.solve(wrench, twists);
            recordShare(factor * sign / (2 * recordedDifference * lengths[row]), 0, false);
        }
    }
    atStart();
}

void OverdampedMove::drawDirections() {
    endsAreFound = false;
    drawForBodies(NoiseStream::FiniteDifference, NoiseStream::FreeFiniteDifference, directions,
                  true);
    for (int i = 0; i < directions.rows(); i++)
        directions(i, 0) = isFree(i) ? directions(i, 0) / lengths[i] : 0;
}

void OverdampedMove::displaceBy(double step, int onlyRow, vector<Pose>& to) const {
    const auto& elements = mobility.getBodies().getElements();
    to.resize(start.size());
    for (size_t e = 0; e < start.size(); e++) {
        const int row = mobility.getBodies().firstRow(e), count = elements[e].numRows();
        double move[6] = {0, 0, 0, 0, 0, 0};
        for (int i = 0; i < count; i++) {
            const double length = lengths[row + i];
            // directions are W~ / L, displacements step L W~.
            if (onlyRow < 0)
                move[i] = step * directions(row + i, 0) * length * length;
            else if (onlyRow == row + i)
                move[i] = step * length;
        }
        to[e].R = start[e].R + Vector3d(move[0], move[1], move[2]);
        if (count == 6) to[e].q = rotated(start[e].q, Vector3d(move[3], move[4], move[5]));
    }
}

bool OverdampedMove::isAccepted(const vector<Pose>& at) { return mobility.acceptsNearby(at); }

void OverdampedMove::failToDisplace(const vector<Pose>& at) {
    throw OpenMM::OpenMMException(
        "CustomRigidHIIntegrator: the finite difference of the stochastic drift leads in both "
        "directions to positions where the model has no mobility: " +
        mobility.objection(at) + "; use a smaller setFiniteDifferenceStep(), or FixmanMidpoint");
}

/** Throw after atPresent(), since a difference would magnify the errors that are allowed there. */
void OverdampedMove::requireDifferences(const char* method) const {
    if (differencesHaveEnded)
        throw OpenMM::OpenMMException(
            string("OverdampedMove: ") + method +
            " after atPresent(): iterations are no longer accurate enough for "
            "differences; take differences before atPresent()");
}

void OverdampedMove::displaceAlong(int row, double& step, vector<Pose>& to) {
    requireDifferences("displace()");
    for (int shrink = 0; shrink <= maxShrinks; shrink++, step *= 0.1)
        for (int side = 0; side < 2; side++, step = -step) {
            displaceBy(step, row, to);
            if (isAccepted(to)) return;
        }
    failToDisplace(to);
}

void OverdampedMove::displace(double& step, vector<Pose>& to) { displaceAlong(-1, step, to); }

void OverdampedMove::displaceBothWays(double& step) {
    for (int shrink = 0; shrink <= maxShrinks; shrink++, step *= 0.1) {
        displaceBy(0.5 * step, -1, forward);
        displaceBy(-0.5 * step, -1, backward);
        if (isAccepted(forward) && isAccepted(backward)) return;
    }
    // The difference is one-sided where only one side is in the model's domain.
    for (double sign : {1.0, -1.0}) {
        displaceBy(sign * step, -1, forward);
        displaceBy(0, -1, backward);
        if (sign < 0) swap(forward, backward);
        if (isAccepted(forward) && isAccepted(backward)) return;
    }
    failToDisplace(forward);
}

void OverdampedMove::drawTractions(Vectors& forces, Vectors& slips, bool noiseIsFrozen) {
    requireDifferences("drawTractions()");
    mobility.getBlobForces(lambdas);
    lambda = lambdas.col(0);
    centralStep = differenceStep_;
    displaceBothWays(centralStep);
    endsAreFound = true;
    mobility.totalWrenches(backward, lambda, forces);
    mobility.totalWrenches(forward, lambda, wrenchAtOtherEnd);
    forces = (forces - wrenchAtOtherEnd) / centralStep;
    mobility.differenceNearby(forward, backward, lambda, noiseIsFrozen, slips);
    slips /= centralStep;
}

void OverdampedMove::rigidSlipDifference(const Vectors& twists, Vectors& slips) {
    mobility.rigidSlips(forward, twists, slips);
    mobility.rigidSlips(backward, twists, slipAtOtherEnd);
    slips = (slips - slipAtOtherEnd) / centralStep;
}

void OverdampedMove::drawAxisForces(Vectors& forces) {
    requireDifferences("drawAxisForces()");
    const FreeMotion& free = mobility.getBodies().getFreeMotion();
    mobility.getBlobForces(lambdas);
    lambda = lambdas.col(0);
    if (!endsAreFound) {
        centralStep = differenceStep_;
        displaceBothWays(centralStep);
        endsAreFound = true;
    }
    Vectors onAxes, along, atOtherEnd;
    mobility.totalWrenches(start, lambda, onAxes);
    onAxes -= directions;
    if (joints) onAxes -= C.transpose() * mu.col(0);
    setTurns(start, turnsOfFixed);
    free.componentsOfFixed(turnsOfFixed, onAxes, along);
    setTurns(forward, turnsOfFixed);
    free.motionOfFixed(turnsOfFixed, along, forces);
    setTurns(backward, turnsOfFixed);
    free.motionOfFixed(turnsOfFixed, along, atOtherEnd);
    forces -= atOtherEnd;
    axisForcesOfFixed = forces / centralStep;
    if (joints) {
        Vectors C_there;
        joints->findRows(forward, C_there);
        forces += C_there.transpose() * mu.col(0);
        joints->findRows(backward, C_there);
        forces -= C_there.transpose() * mu.col(0);
        joints->forces(forward, mu.col(0), axisForcesOfJoints);
        joints->forces(backward, mu.col(0), forcesOfJoints);
        axisForcesOfJoints = (axisForcesOfJoints - forcesOfJoints) / centralStep;
    }
    forces /= centralStep;
}

void OverdampedMove::prescribeAxisDifference(double factor, const Vectors& twists) {
    const FreeMotion& free = mobility.getBodies().getFreeMotion();
    Vectors values, atOtherEnd;
    setTurns(forward, turnsOfFixed);
    free.componentsOfFixed(turnsOfFixed, twists, values);
    setTurns(backward, turnsOfFixed);
    free.componentsOfFixed(turnsOfFixed, twists, atOtherEnd);
    values = -factor / centralStep * (values - atOtherEnd);
    if (prescribed) values += *prescribed;
    prescribedWithAxes = values;
    prescribed = &prescribedWithAxes;
}

}  // namespace RigidHIPlugin
