#include "fluid/FlowReader.h"

#include <cmath>
#include <string>

#include "linearalgebra/OneBlasThread.h"
#include "mobility/Models.h"
#include "openmmrigidhi/internal/Errors.h"
#include "rigidbody/EigenVec3.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

namespace {

bool samePoses(const vector<Pose>& a, const vector<Pose>& b) {
    bool same = a.size() == b.size();
    for (size_t e = 0; same && e < a.size(); e++) same = areSame(a[e], b[e]);
    return same;
}

/**
 * How far the end of a repeated step may be from its original end, relative to the largest move in
 * the step. A state may come from another platform, or from another fluid.
 */
const double replayTolerance = 1e-2;

/** The distance of two poses, in lengths of the body and half radians. */
double distance(const Pose& a, const Pose& b, double length) {
    const Vector4d p(a.q.w, a.q.x, a.q.y, a.q.z), q(b.q.w, b.q.x, b.q.y, b.q.z);
    return (a.R - b.R).norm() / length + min((p - q).norm(), (p + q).norm());
}

}  // namespace

bool FlowReader::lastStepIsPresent(const BodySet& bodies,
                                   const vector<OpenMM::Vec3>& positions) const {
    vector<Pose> poses;
    for (const auto& group : fluid.groups) {
        const LastStep& last = group->brownian->getLastStep();
        if (!last.isKnown || last.box != fluid.box) return false;
        poses.resize(group->poses.size());
        group->members.readPoses(bodies, positions, poses);
        if (!samePoses(poses, last.end)) return false;
    }
    return true;
}

FluidGroup& FlowReader::onlyGroup(const char* method) const {
    if (fluid.isFreeDraining())
        failFluid(
            method,
            "model FreeDraining has a separate fluid for each body, and no flow between bodies; "
            "use RotnePragerYamakawa");
    if (!fluid.hasOneFlow())
        failFluid(
            method,
            "the Context has " + to_string(fluid.groups.size()) +
                " groups of bodies, each in a fluid of its own; ask in a Context with one group");
    return *fluid.groups[0];
}

/** Repeat the last step, from its record, on vectors of its own. */
void FlowReader::replay(FluidGroup& group, Answer& result) const {
    BrownianGroup& brownian = *group.brownian;
    const LastStep& last = brownian.getLastStep();
    const OverdampedEntry& entry = overdampedScheme(last.scheme);
    result.move = make_unique<OverdampedMove>(
        brownian.mobilityFor(2 * last.step.kT * last.step.h, last.scheme));
    OverdampedStep step = last.step;
    step.flow = fluid.getFlow();
    brownian.setErrors(traitsOf(last.scheme), step);
    OverdampedMove& move = *result.move;
    move.setJoints(brownian.getJoints());
    move.start = last.start;
    move.begin(step);
    move.recording.flow = &result.made;
    const unique_ptr<OverdampedScheme> scheme = entry.make();
    const auto memory = scheme->memory();
    for (size_t i = 0; i < memory.size(); i++) *memory[i] = last.memory[i];
    for (int stage = 0; stage < entry.numStages(); stage++) {
        if (entry.needsForces(stage)) move.force = last.forces[stage];
        move.prescribe(last.prescribed.empty() ? nullptr : &last.prescribed[stage]);
        scheme->run(stage, move);
    }
    move.recording.flow = nullptr;
    result.made.check(traitsOf(last.scheme).name);
    if (step.kT > 0) result.randomFlow = sqrt(2 * step.kT / step.h);
}

/** The flow without noise, under the forces last gathered. */
void FlowReader::flowOfForces(FluidGroup& group, const FlowQuestion& question,
                              Answer& result) const {
    BrownianGroup& brownian = *group.brownian;
    result.move = make_unique<OverdampedMove>(brownian.mobilityFor(0, question.scheme));
    OverdampedMove& move = *result.move;
    move.setJoints(brownian.getJoints());
    OverdampedStep step;
    step.flow = fluid.getFlow();
    step.motorRates = brownian.getMotorRates();
    brownian.getMobility().setTolerance(force.getSolverTolerance());
    group.members.readPoses(question.bodies, question.positions, move.start);
    move.begin(step);
    move.force = brownian.readForces(question.bodies, question.freeParticles);
    move.recording.flow = &result.made;
    MatrixXd twists, prescribed;
    if (group.members.readPrescribed(question.prescribed, prescribed)) move.prescribe(&prescribed);
    move.atStart();
    move.solve(move.velocity(1, move.force), twists);
    move.recording.flow = nullptr;
}

/** LangevinHI: the flow of the friction forces that keep bodies at their present velocities. */
void FlowReader::flowOfVelocities(FluidGroup& group, const FlowQuestion& question,
                                  Answer& result) const {
    const BodySet& bodies = question.bodies;
    MatrixXd twists, forces;
    group.members.readTwists(bodies, question.velocities, question.prescribed, twists);
    BodyMobility& mobility = group.brownian->mobilityFor(0, question.scheme);
    mobility.setTolerance(force.getSolverTolerance());
    const vector<Pose>& poses = group.readPoses(bodies, question.positions);
    mobility.setPoses(poses);
    mobility.flow().forcesOfTwists(twists, fluid.getFlow(), forces);
    result.made.shares.push_back({1, poses, forces, true});
}

bool FlowReader::findLastStep(const BodySet& bodies, const vector<OpenMM::Vec3>& positions,
                              CustomRigidHIIntegrator::Scheme scheme) {
    if (!fluid.remembersSteps() || !lastStepIsPresent(bodies, positions)) return false;
    FluidGroup& group = *fluid.groups[0];
    const LastStep& last = group.brownian->getLastStep();
    if (last.scheme != scheme) return false;
    if (answer && answer->isOfLastStep) return true;
    answer = make_unique<Answer>();
    answer->isOfLastStep = true;
    replay(group, *answer);
    double largest = 0, off = 0;
    for (size_t e = 0; e < last.end.size(); e++) {
        const double length = group.bodies.length(e);
        largest = max(largest, distance(last.start[e], last.end[e], length));
        off = max(off, distance(last.end[e], answer->move->present[e], length));
    }
    if (off <= replayTolerance * largest) return true;
    answer.reset();
    group.brownian->forgetLastStep();
    return false;
}

FlowReader::Answer& FlowReader::find(FluidGroup& group, const FlowQuestion& question) {
    if (!question.hasMomenta() &&
        findLastStep(question.bodies, question.positions, question.scheme))
        return *answer;
    answer = make_unique<Answer>();
    Answer& result = *answer;
    if (question.hasMomenta())
        flowOfVelocities(group, question, result);
    else
        flowOfForces(group, question, result);
    return result;
}

/** Call add(mobility at its poses, sources, share) for each share of the flow. */
template <class Add>
void FlowReader::forSources(FluidGroup& group, Answer& of, const Add& add) const {
    BodyMobility& mobility = group.brownian->getMobility();
    mobility.setTolerance(force.getSolverTolerance());  // others may have changed it since
    for (const FlowOfStep::Share& share : of.made.shares) {
        // Displaced poses may reach a little beyond what the model accepts.
        mobility.setPoses(share.poses, !mobility.objection(share.poses).empty());
        const FlowSources sources = mobility.flow().sourcesOf(
            share.forces, share.movesBodies ? fluid.getFlow() : nullptr, share.movesBodies);
        add(mobility, sources, share);
    }
}

Velocities FlowReader::flowAt(const vector<OpenMM::Vec3>& points, const FlowQuestion& question) {
    const OneBlasThread single;
    const char* const method = "getFlowInContext()";
    FluidGroup& group = onlyGroup(method);
    const BoundaryTraits& boundary = traitsOf(force.getBoundary());
    double low, high;
    findWalls(force, low, high);
    for (size_t p = 0; p < points.size() && boundary.hasWalls(); p++) {
        const OpenMM::Vec3& x = points[p];
        const double coordinate = x[boundary.wallAxis];
        if (coordinate < low || coordinate > high)
            failFluid(method,
                      "point " + to_string(p) + " at " + text(x) +
                          " nm is behind a wall, where there is no fluid; give points above the "
                          "wall or between the walls");
    }
    Answer& made = find(group, question);
    Velocities velocities = Velocities::Zero(3, points.size());
    if (const DrivenFlow* flow = fluid.getFlow())
        for (size_t p = 0; p < points.size(); p++)
            velocities.col(p) = made.made.flowWeight * flow->velocityAt(toEigen(points[p]), {});
    forSources(group, made,
               [&](BodyMobility& at, const FlowSources& sources, const FlowOfStep::Share& share) {
                   at.flow().addAt(sources, points, share.weight, velocities);
                   if (share.movesBodies) at.flow().addOfSitesAt(points, share.weight, velocities);
               });
    if (made.made.fieldWeight != 0 && made.move->getField())
        made.move->getField()->addFlowAt(points, made.made.fieldWeight, velocities);
    return velocities;
}

FluidGroup& FlowReader::groupWithWave(const char* method, int forceAxis, int waveAxis,
                                      int waveVectorIndex, DrivenFlow& wave) const {
    FluidGroup& group = onlyGroup(method);
    const BoxVectors& box = fluid.box;
    const MobilityModel& model = group.bodies.getModel();
    const BoundaryTraits& boundary = traitsOf(force.getBoundary());
    const auto hasModes = [](const BoundaryTraits& one) {
        return one.isPeriodic && one.numWalls != 1;
    };
    if (!model.box() || !hasModes(boundary))
        failFluid(method,
                  "the flow has no Fourier modes with the boundary " + string(boundary.name) +
                      (boundary.isPeriodic ? ", because the fluid has no finite height" : "") +
                      "; ask with the boundary " + namesIn(boundaryTable, " or ", hasModes) +
                      ", or use getFlowInContext()");
    if (boundary.isAcross(forceAxis) || boundary.isAcross(waveAxis))
        failFluid(method, "the axes are " + to_string(forceAxis) + " and " + to_string(waveAxis) +
                              ", and in a " + boundary.name +
                              " both must be along the walls; give the axes " +
                              boundary.axesAlongWalls());
    model.box()->checkWave(box, waveAxis, waveVectorIndex);
    wave.forceAxis = forceAxis;
    wave.waveAxis = waveAxis;
    wave.k = 2 * M_PI * waveVectorIndex / box[waveAxis][waveAxis];
    wave.waveVelocity = 1;
    fluid.userFlow.setPlanes(wave);
    return group;
}

FluidGroup& FlowReader::groupWithVolume(const char* method) const {
    FluidGroup& group = onlyGroup(method);
    const BoundaryTraits& boundary = traitsOf(force.getBoundary());
    const auto hasVolume = [](const BoundaryTraits& one) {
        return one.isPeriodic && one.numWalls != 1;
    };
    if (!hasVolume(boundary))
        failFluid(method, string("the fluid with the boundary ") + boundary.name +
                              " has no finite volume to take a mean over; ask with the boundary " +
                              namesIn(boundaryTable, " or ", hasVolume) +
                              ", or use getFlowInContext()");
    return group;
}

array<double, 2> FlowReader::flowMode(int forceAxis, int waveAxis, int waveVectorIndex,
                                      const FlowQuestion& question) {
    const OneBlasThread single;
    DrivenFlow wave;
    FluidGroup& group =
        groupWithWave("getFlowModeInContext()", forceAxis, waveAxis, waveVectorIndex, wave);
    const double volume = group.bodies.getModel().box()->volume(fluid.box);
    Answer& made = find(group, question);
    const double unit = 2 / (force.getViscosity() * wave.k * wave.k * volume);
    array<double, 2> amplitudes = {0, 0};
    for (int part = 0; part < 2; part++) {
        wave.phase = part * M_PI / 2;
        forSources(
            group, made,
            [&](BodyMobility& at, const FlowSources& sources, const FlowOfStep::Share& share) {
                amplitudes[part] += share.weight * unit * at.flow().powerOn(wave, sources);
                if (share.movesBodies)
                    amplitudes[part] += share.weight * unit * at.flow().powerOfSites(wave);
            });
        if (made.made.fieldWeight != 0 && made.move->getField())
            amplitudes[part] += made.made.fieldWeight * made.move->getField()->amplitudeOf(wave);
    }
    const DrivenFlow* flow = fluid.getFlow();
    if (flow && flow->waveVelocity != 0 && flow->forceAxis == forceAxis &&
        flow->waveAxis == waveAxis && flow->k == wave.k)
        amplitudes[0] += made.made.flowWeight * flow->waveVelocity * flow->meanOfWave();
    return amplitudes;
}

OpenMM::Vec3 FlowReader::meanFlow(const FlowQuestion& question) {
    const OneBlasThread single;
    FluidGroup& group = groupWithVolume("getMeanFlowInContext()");
    Answer& made = find(group, question);
    Vector3d mean = Vector3d::Zero();
    for (int axis = 0; axis < 2; axis++) {
        // By symmetry of M, the mean flow of sources is their power on the flow of a unit force
        // density, divided by the volume.
        const DrivenFlow unit = fluid.userFlow.ofUnitForceDensity(axis);
        if (unit.isZero()) continue;
        const double volume =
            fluid.box[0][0] * fluid.box[1][1] * (fluid.userFlow.high - fluid.userFlow.low);
        forSources(
            group, made,
            [&](BodyMobility& at, const FlowSources& sources, const FlowOfStep::Share& share) {
                mean[axis] += share.weight / volume * at.flow().powerOn(unit, sources);
                if (share.movesBodies)
                    mean[axis] += share.weight / volume * at.flow().powerOfSites(unit);
            });
    }
    if (made.made.fieldWeight != 0 && made.move->getField())
        mean += made.made.fieldWeight *
                made.move->getField()->meanFlow(fluid.userFlow.low, fluid.userFlow.high);
    if (const DrivenFlow* flow = fluid.getFlow()) mean += made.made.flowWeight * flow->mean();
    return toVec3(mean);
}

OpenMM::Vec3 FlowReader::randomMeanFlow(const FlowQuestion& question) {
    const OneBlasThread single;
    FluidGroup& group = groupWithVolume("getRandomMeanFlowInContext()");
    Answer& made = find(group, question);
    RandomField* field = made.move ? made.move->getField() : nullptr;
    return field
               ? toVec3(made.randomFlow * field->meanFlow(fluid.userFlow.low, fluid.userFlow.high))
               : OpenMM::Vec3();
}

array<double, 2> FlowReader::randomFlowMode(int forceAxis, int waveAxis, int waveVectorIndex,
                                            const FlowQuestion& question) {
    const OneBlasThread single;
    DrivenFlow wave;
    FluidGroup& group =
        groupWithWave("getRandomFlowModeInContext()", forceAxis, waveAxis, waveVectorIndex, wave);
    Answer& made = find(group, question);
    array<double, 2> amplitudes = {0, 0};
    RandomField* field = made.move ? made.move->getField() : nullptr;
    for (int part = 0; field && part < 2; part++) {
        wave.phase = part * M_PI / 2;
        amplitudes[part] = made.randomFlow * field->amplitudeOf(wave);
    }
    return amplitudes;
}

}  // namespace RigidHIPlugin
