// Fluid: the flow of the fluid itself, for users who ask.

#include <openmm/OpenMMException.h>

#include <cmath>
#include <string>

#include "fluid/Fluid.h"
#include "linearalgebra/OneBlasThread.h"
#include "mobility/Models.h"
#include "openmmrigidhi/internal/Errors.h"
#include "rigidbody/EigenVec3.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

namespace {

constexpr ErrorsOf fail{"MobilityForce"};

bool samePoses(const vector<Pose>& a, const vector<Pose>& b) {
    bool same = a.size() == b.size();
    for (size_t e = 0; same && e < a.size(); e++)
        same = a[e].R == b[e].R && a[e].q.w == b[e].q.w && a[e].q.x == b[e].q.x &&
               a[e].q.y == b[e].q.y && a[e].q.z == b[e].q.z;
    return same;
}

/** How far a step that is done again may end from where it ended, relative to its largest move: a
 * state may come from another platform, or from another fluid. */
const double replayTolerance = 1e-2;

/** In lengths of the body, and half radians. */
double distance(const Pose& a, const Pose& b, double length) {
    const Vector4d p(a.q.w, a.q.x, a.q.y, a.q.z), q(b.q.w, b.q.x, b.q.y, b.q.z);
    return (a.R - b.R).norm() / length + min((p - q).norm(), (p + q).norm());
}

MatrixXd toMatrix(const vector<Pose>& poses) {
    MatrixXd numbers(7, poses.size());
    for (size_t e = 0; e < poses.size(); e++)
        numbers.col(e) << poses[e].R, poses[e].q.w, poses[e].q.x, poses[e].q.y, poses[e].q.z;
    return numbers;
}

vector<Pose> toPoses(const MatrixXd& numbers) {
    vector<Pose> poses(numbers.cols());
    for (size_t e = 0; e < poses.size(); e++) {
        poses[e].R = numbers.col(e).head<3>();
        poses[e].q = {numbers(3, e), numbers(4, e), numbers(5, e), numbers(6, e)};
    }
    return poses;
}

const int numNumbersOfStep = 18;

/** The numbers of a step, but poses and forces. */
MatrixXd toMatrix(const OverdampedStep& step, const BoxVectors& box) {
    MatrixXd numbers(numNumbersOfStep, 1);
    numbers << step.h, step.kT, step.difference, step.driftFactorScalesAll, step.noise.seed,
        double(step.noise.step), step.noise.attempt, step.noise.law, step.noise.field,
        toEigen(box[0]), toEigen(box[1]), toEigen(box[2]);
    return numbers;
}

OverdampedStep toStep(const MatrixXd& numbers) {
    OverdampedStep step;
    step.h = numbers(0);
    step.kT = numbers(1);
    step.difference = numbers(2);
    step.driftFactorScalesAll = numbers(3) != 0;
    step.noise.seed = numbers(4);
    step.noise.step = numbers(5);
    step.noise.attempt = numbers(6);
    step.noise.law = numbers(7) == 1   ? NoiseStream::ThreePoint
                     : numbers(7) == 2 ? NoiseStream::TwoPoint
                                       : NoiseStream::Gaussian;
    step.noise.field = numbers(8);
    return step;
}

BoxVectors toBox(const MatrixXd& numbers) {
    BoxVectors box;
    for (int i = 0; i < 3; i++)
        box[i] = OpenMM::Vec3(numbers(9 + 3 * i), numbers(10 + 3 * i), numbers(11 + 3 * i));
    return box;
}

}  // namespace

bool Fluid::lastStepIsPresent(const BodySet& bodies, const vector<OpenMM::Vec3>& positions) const {
    vector<Pose> poses;
    for (const auto& group : groups) {
        if (!group->overdamped.last.isKnown || group->overdamped.last.box != box) return false;
        poses.resize(group->poses.size());
        group->readPoses(bodies, positions, poses);
        if (!samePoses(poses, group->overdamped.last.end)) return false;
    }
    return true;
}

FluidGroup& Fluid::onlyGroup(const char* method) const {
    if (force.getModel() == MobilityForce::FreeDraining)
        fail(method,
             "model FreeDraining has a separate fluid for each body, and no flow between bodies; "
             "use RotnePragerYamakawa");
    if (!hasOneFlow())
        fail(method,
             "there are " + to_string(groups.size()) +
                 " groups of bodies, each in a fluid of its own; ask in a Context with one group");
    return *groups[0];
}

/** The last step once more, from what is known of it, on vectors of its own. */
void Fluid::replay(FluidGroup& group, FlowOfGroup& result) const {
    const LastStep& last = group.overdamped.last;
    slowSpins(group, 2 * last.step.kT * last.step.h);
    moveOf(group);  // there is none yet in a Context that took no step itself
    const OverdampedEntry& entry = overdampedScheme(last.scheme);
    result.move.reset(new OverdampedMove(*group.overdamped.mobility));
    OverdampedStep step = last.step;
    step.flow = flowIfAny();
    setTolerance(group, traitsOf(last.scheme), step);
    OverdampedMove& move = *result.move;
    move.start = last.start;
    move.begin(step);
    move.record(&result.made);
    const unique_ptr<OverdampedScheme> scheme = entry.make();
    const auto memory = scheme->memory();
    for (size_t i = 0; i < memory.size(); i++) *memory[i] = last.memory[i];
    for (int stage = 0; stage < entry.numStages(); stage++) {
        if (entry.needsForces(stage)) move.force = last.forces[stage];
        scheme->run(stage, move);
    }
    move.record(nullptr);
    result.made.check(traitsOf(last.scheme).name);
    if (step.kT > 0) result.randomFlow = sqrt(2 * step.kT / step.h);
}

/** Without noise, under the forces as last gathered. */
void Fluid::flowOfForces(FluidGroup& group, const BodySet& bodies,
                         const FreeParticles& freeParticles, const vector<OpenMM::Vec3>& positions,
                         FlowOfGroup& result) const {
    slowSpins(group, 0);
    moveOf(group);
    takeForces(group, bodies, freeParticles);
    result.move.reset(new OverdampedMove(*group.overdamped.mobility));
    OverdampedMove& move = *result.move;
    OverdampedStep step;
    step.flow = flowIfAny();
    group.overdamped.mobility->setTolerance(force.getSolverTolerance());
    group.readPoses(bodies, positions, move.start);
    move.begin(step);
    move.force = group.overdamped.move->force;
    move.record(&result.made);
    MatrixXd slips, twists;
    move.atStart();
    move.addFlow(slips);
    move.solve(move.force, slips, twists);
    move.recordSolve(1);
    move.record(nullptr);
}

/** LangevinHI: of the friction forces, with which bodies are held at the velocities that they have.
 */
void Fluid::flowOfVelocities(FluidGroup& group, const BodySet& bodies,
                             const vector<OpenMM::Vec3>& positions,
                             const vector<OpenMM::Vec3>& velocities, FlowOfGroup& result) const {
    const auto& elements = group.bodies.getElements();
    MatrixXd twists(group.bodies.getNumRows(), 1), forces;
    for (size_t e = 0; e < elements.size(); e++) {
        const int row = group.bodies.firstRow(e);
        if (elements[e].isFree()) {
            twists.block<3, 1>(row, 0) = toEigen(velocities[elements[e].particles[0]]);
            continue;
        }
        const int body = elements[e].body;
        twists.block<3, 1>(row, 0) = toEigen(bodies.getState(body).p) / bodies.inertia(body).mass;
        twists.block<3, 1>(row + 3, 0) = toEigen(bodies.getAngularVelocity_lab(body));
    }
    slowSpins(group, 0);
    BodyMobility& mobility = *group.overdamped.mobility;
    mobility.setTolerance(force.getSolverTolerance());
    const vector<Pose>& poses = group.readPoses(bodies, positions);
    mobility.setPoses(poses);
    mobility.forcesOfTwists(twists, flowIfAny(), forces);
    result.made.shares.push_back({1, poses, forces, isDriven});
}

bool Fluid::findFlowOfLastStep(const BodySet& bodies, const vector<OpenMM::Vec3>& positions,
                               CustomRigidHIIntegrator::Scheme scheme) {
    if (!hasOneFlow() || !lastStepIsPresent(bodies, positions)) return false;
    FluidGroup& group = *groups[0];
    if (group.overdamped.last.scheme != scheme) return false;
    if (flowOfLastStep && flowOfLastStep->isOfLastStep) return true;
    flowOfLastStep.reset(new FlowOfGroup());
    flowOfLastStep->isOfLastStep = true;
    replay(group, *flowOfLastStep);
    LastStep& last = group.overdamped.last;
    double largest = 0, off = 0;
    for (size_t e = 0; e < last.end.size(); e++) {
        const double length = group.bodies.length(e);
        largest = max(largest, distance(last.start[e], last.end[e], length));
        off = max(off, distance(last.end[e], flowOfLastStep->move->present[e], length));
    }
    if (off <= replayTolerance * largest) return true;
    flowOfLastStep.reset();
    last.isKnown = false;
    return false;
}

Fluid::FlowOfGroup& Fluid::findFlow(FluidGroup& group, const FlowQuestion& question) {
    if (!question.hasMomenta() &&
        findFlowOfLastStep(question.bodies, question.positions, question.scheme))
        return *flowOfLastStep;
    flowOfLastStep.reset(new FlowOfGroup());
    FlowOfGroup& result = *flowOfLastStep;
    if (question.hasMomenta())
        flowOfVelocities(group, question.bodies, question.positions, question.velocities, result);
    else
        flowOfForces(group, question.bodies, question.freeParticles, question.positions, result);
    return result;
}

/** Call add(mobility at its poses, sources, weight) for each share of the flow. */
template <class Add>
void Fluid::forSources(FluidGroup& group, FlowOfGroup& flowOfGroup, const Add& add) const {
    BodyMobility& mobility = *group.overdamped.mobility;
    mobility.setTolerance(force.getSolverTolerance());  // others may have asked since
    for (const FlowOfStep::Share& share : flowOfGroup.made.shares) {
        // Displaced poses may reach a little beyond what the model accepts.
        mobility.setPoses(share.poses, !mobility.objection(share.poses).empty());
        const FlowSources sources =
            mobility.flowSources(share.forces, share.inFlow ? &flow : nullptr);
        add(mobility, sources, share.weight);
    }
}

Velocities Fluid::flowAt(const vector<OpenMM::Vec3>& points, const FlowQuestion& question) {
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
            fail(method, "point " + to_string(p) + " at " + text(x) +
                             " nm is behind a wall, where there is no fluid; give points above the "
                             "wall or between the walls");
    }
    FlowOfGroup& made = findFlow(group, question);
    Velocities velocities = Velocities::Zero(3, points.size());
    if (isDriven)
        for (size_t p = 0; p < points.size(); p++)
            velocities.col(p) = made.made.flowWeight * flow.velocityAt(toEigen(points[p]), {});
    forSources(group, made, [&](BodyMobility& at, const FlowSources& sources, double weight) {
        at.addFlowAt(sources, points, weight, velocities);
    });
    if (made.made.fieldWeight != 0 && made.move->getField())
        made.move->getField()->addFlowAt(points, made.made.fieldWeight, velocities);
    return velocities;
}

FluidGroup& Fluid::groupWithWave(const char* method, int forceAxis, int waveAxis,
                                 int waveVectorIndex, DrivenFlow& wave) const {
    FluidGroup& group = onlyGroup(method);
    const MobilityModel& model = group.bodies.getModel();
    if (!(model.fluidVolume(box) > 0))
        fail(method, "the flow has no Fourier modes with the boundary " +
                         string(boundaryName(force.getBoundary())) + "; ask with the boundary " +
                         namesIn(boundaryTable, " or ",
                                 [](const BoundaryTraits& other) { return other.isPeriodic; }) +
                         ", or use getFlowInContext()");
    const BoundaryTraits& boundary = traitsOf(force.getBoundary());
    if (boundary.isAcross(forceAxis) || boundary.isAcross(waveAxis))
        fail(method, "the axes are " + to_string(forceAxis) + " and " + to_string(waveAxis) +
                         ", and in a " + boundary.name +
                         " both must be along the walls; give the axes " +
                         boundary.axesAlongWalls());
    model.checkWave(box, waveAxis, waveVectorIndex);
    wave.forceAxis = forceAxis;
    wave.waveAxis = waveAxis;
    wave.k = 2 * M_PI * waveVectorIndex / box[waveAxis][waveAxis];
    wave.waveVelocity = 1;
    return group;
}

array<double, 2> Fluid::flowMode(int forceAxis, int waveAxis, int waveVectorIndex,
                                 const FlowQuestion& question) {
    const OneBlasThread single;
    DrivenFlow wave;
    FluidGroup& group =
        groupWithWave("getFlowModeInContext()", forceAxis, waveAxis, waveVectorIndex, wave);
    const double volume = group.bodies.getModel().fluidVolume(box);
    FlowOfGroup& made = findFlow(group, question);
    const double unit = 2 / (force.getViscosity() * wave.k * wave.k * volume);
    array<double, 2> amplitudes = {0, 0};
    for (int part = 0; part < 2; part++) {
        wave.phase = part * M_PI / 2;
        forSources(group, made, [&](BodyMobility& at, const FlowSources& sources, double weight) {
            amplitudes[part] += weight * unit * at.powerOn(wave, sources);
        });
        if (made.made.fieldWeight != 0 && made.move->getField())
            amplitudes[part] += made.made.fieldWeight * made.move->getField()->amplitudeOf(wave);
    }
    if (flow.waveVelocity != 0 && flow.forceAxis == forceAxis && flow.waveAxis == waveAxis &&
        flow.k == wave.k)
        amplitudes[0] += made.made.flowWeight * flow.waveVelocity;
    return amplitudes;
}

array<double, 2> Fluid::randomFlowMode(int forceAxis, int waveAxis, int waveVectorIndex,
                                       const FlowQuestion& question) {
    const OneBlasThread single;
    DrivenFlow wave;
    FluidGroup& group =
        groupWithWave("getRandomFlowModeInContext()", forceAxis, waveAxis, waveVectorIndex, wave);
    FlowOfGroup& made = findFlow(group, question);
    array<double, 2> amplitudes = {0, 0};
    RandomField* field = made.move ? made.move->getField() : nullptr;
    for (int part = 0; field && part < 2; part++) {
        wave.phase = part * M_PI / 2;
        amplitudes[part] = made.randomFlow * field->amplitudeOf(wave);
    }
    return amplitudes;
}

SchemeMemory Fluid::getLastStep() const {
    SchemeMemory saved;
    for (const auto& group : groups) {
        const LastStep& last = group->overdamped.last;
        if (!last.isKnown) return {};
        vector<MatrixXd> own = {toMatrix(last.step, last.box), toMatrix(last.start),
                                toMatrix(last.end)};
        own.insert(own.end(), last.forces.begin(), last.forces.end());
        own.insert(own.end(), last.memory.begin(), last.memory.end());
        saved.groups.push_back(own);
    }
    if (!saved.groups.empty()) saved.scheme = traitsOf(groups[0]->overdamped.last.scheme).name;
    return saved;
}

namespace {

/** The scheme without momenta that made a saved last step; null: there is none. */
const SchemeTraits* schemeOfLastStep(const SchemeMemory& saved) {
    if (saved.groups.empty()) return nullptr;
    for (const SchemeTraits& traits : schemeTable)
        if (traits.isOverdamped() && saved.scheme == traits.name) return &traits;
    return nullptr;
}

}  // namespace

void Fluid::checkLastStep(const SchemeMemory& saved) const {
    const SchemeTraits* const scheme = schemeOfLastStep(saved);
    if (!scheme) return;
    const OverdampedEntry& entry = overdampedScheme(scheme->scheme);
    const int numStages = entry.numStages(), numMemories = entry.make()->memory().size();
    bool fits = saved.groups.size() == groups.size();
    for (size_t g = 0; fits && g < groups.size(); g++) {
        const vector<MatrixXd>& numbers = saved.groups[g];
        const int elements = groups[g]->poses.size(), rows = groups[g]->bodies.getNumRows();
        fits = (int)numbers.size() == 3 + numStages + numMemories &&
               numbers[0].size() == numNumbersOfStep;
        for (int i = 0; fits && i < (int)numbers.size(); i++) {
            fits = numbers[i].allFinite();
            if (i == 1 || i == 2)
                fits = fits && numbers[i].rows() == 7 && numbers[i].cols() == elements;
            if (i > 2) fits = fits && (numbers[i].size() == 0 || numbers[i].rows() == rows);
            if (i > 2 && i < 3 + numStages && entry.needsForces(i - 3))
                fits = fits && numbers[i].cols() == 1;
        }
        // Check the step size and kT, and the numbers that are integers of 32 bits.
        fits = fits && numbers[0](0) > 0 && numbers[0](1) >= 0;
        for (int i : {4, 6, 7, 8})
            fits = fits && numbers[0](i) >= 0 && numbers[0](i) <= 4294967295.0;
        for (int i = 1; fits && i < 3; i++)
            for (int e = 0; e < elements; e++)
                fits = fits && abs(numbers[i].col(e).tail<4>().norm() - 1) <= 1e-9;
    }
    if (!fits)
        throw OpenMM::OpenMMException(
            "CustomRigidHIIntegrator: the saved state's last step of scheme " + saved.scheme +
            " is damaged, or belongs to other bodies; load the state into an integrator with the "
            "same bodies and groups, or use another state");
}

void Fluid::setLastStep(const SchemeMemory& saved) {
    checkLastStep(saved);
    flowOfLastStep.reset();
    for (auto& group : groups) group->overdamped.last.isKnown = false;
    const SchemeTraits* const scheme = schemeOfLastStep(saved);
    if (!scheme) return;
    const int numStages = overdampedScheme(scheme->scheme).numStages();
    for (size_t g = 0; g < groups.size(); g++) {
        LastStep& last = groups[g]->overdamped.last;
        last.scheme = scheme->scheme;
        last.step = toStep(saved.groups[g][0]);
        last.box = toBox(saved.groups[g][0]);
        last.start = toPoses(saved.groups[g][1]);
        last.end = toPoses(saved.groups[g][2]);
        const auto forces = saved.groups[g].begin() + 3;
        last.forces.assign(forces, forces + numStages);
        last.memory.assign(forces + numStages, saved.groups[g].end());
        last.isKnown = true;
    }
}

}  // namespace RigidHIPlugin
