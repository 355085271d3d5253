#include "context/BodyAccess.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "context/Messages.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

void BodyAccess::prepare(const char* method) {
    mirror.requirePositions(method);
    mirror.takeInChanges();
}

template <class Of>
auto BodyAccess::ofBodies(Of of) const {
    vector<decltype(of(0))> result;
    for (int b = 0; b < scene.bodies.getNumBodies(); b++) result.push_back(of(b));
    return result;
}

bool BodyAccess::hasMomenta() const { return traitsOf(scene.integrator.getScheme()).hasMomenta; }

// -------------------------------------------------------------------------------------------------
// Poses and twists

vector<Vec3> BodyAccess::getPositions() {
    prepare("getBodyPositions()");
    return ofBodies([&](int b) { return scene.bodies.getState(b).R; });
}

vector<array<double, 4> > BodyAccess::getOrientations() {
    prepare("getBodyOrientations()");
    return ofBodies([&](int b) { return scene.bodies.getState(b).q; });
}

vector<Vec3> BodyAccess::getVelocities() {
    prepare("getBodyVelocities()");
    return ofBodies([&](int b) {
        return scene.bodies.getState(b).p / max(scene.bodies.inertia(b).mass, 1e-300);
    });
}

vector<Vec3> BodyAccess::getAngularVelocities() {
    prepare("getBodyAngularVelocities()");
    return ofBodies([&](int b) { return scene.bodies.getAngularVelocity_lab(b); });
}

void BodyAccess::posesWereSet() {
    if (scene.fluid) scene.fluid->getMemory().forget();
    mirror.writePoses();
    scene.noteChange();
    scene.watch.restart();
}

void BodyAccess::twistsWereSet() {
    mirror.writeTwists();
    scene.watch.restart();
}

void BodyAccess::setPositions(const vector<Vec3>& rows) {
    prepare("setBodyPositions()");
    for (int b = 0; b < scene.bodies.getNumBodies(); b++) {
        BodyState state = scene.bodies.getState(b);
        state.R = rows[b];
        scene.bodies.setState(b, state);
    }
    posesWereSet();
}

void BodyAccess::setOrientations(const vector<array<double, 4> >& rows) {
    prepare("setBodyOrientations()");
    BodySet& bodies = scene.bodies;
    for (int b = 0; b < bodies.getNumBodies(); b++) {
        const Vec3 omega_lab = bodies.getAngularVelocity_lab(b);  // the motion in the lab stays
        BodyState state = bodies.getState(b);
        const auto& q = rows[b];
        const double length = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
        const bool same = state.q == q;
        for (int k = 0; k < 4; k++) state.q[k] = q[k] / length;
        if (same) continue;
        bodies.setState(b, state);
        bodies.setAngularVelocity_lab(b, omega_lab);
    }
    posesWereSet();
}

void BodyAccess::setVelocities(const vector<Vec3>& rows) {
    prepare("setBodyVelocities()");
    for (int b = 0; b < scene.bodies.getNumBodies(); b++) {
        BodyState state = scene.bodies.getState(b);
        state.p = rows[b] * scene.bodies.inertia(b).mass;
        scene.bodies.setState(b, state);
    }
    twistsWereSet();
}

void BodyAccess::setAngularVelocities(const vector<Vec3>& rows) {
    prepare("setBodyAngularVelocities()");
    for (int b = 0; b < scene.bodies.getNumBodies(); b++)
        scene.bodies.setAngularVelocity_lab(b, rows[b]);
    twistsWereSet();
}

double BodyAccess::getPoseResidual() {
    prepare("getPoseResidual()");
    return mirror.getPoseResidual();
}

// -------------------------------------------------------------------------------------------------
// Forces and energies

void BodyAccess::requireGeometry() {
    if (!scene.isBuilt())
        prepare("the geometry of bodies that were added by their particles alone");
}

vector<Vec3> BodyAccess::getForces() {
    requireGeometry();
    return ofBodies([&](int b) { return scene.bodies.getForce_lab(b); });
}

vector<Vec3> BodyAccess::getTorques() {
    requireGeometry();
    return ofBodies([&](int b) { return scene.bodies.getTorque_lab(b); });
}

double BodyAccess::translationalKineticEnergy() {
    if (!hasMomenta() || !mirror.hasPositions()) return 0;
    mirror.takeInVelocitiesIfChanged();
    return scene.bodies.translationalKineticEnergy();
}

Vec3 BodyAccess::rotationalKineticEnergies() {
    if (!hasMomenta() || !mirror.hasPositions()) return Vec3();
    mirror.takeInVelocitiesIfChanged();
    return scene.bodies.rotationalKineticEnergies();
}

double BodyAccess::freeParticleKineticEnergy() {
    if (!hasMomenta()) return 0;
    scene.arrays->pullVelocities();
    return scene.freeParticles->kineticEnergy(scene.arrays->velocities());
}

// -------------------------------------------------------------------------------------------------
// What a MobilityForce asks for

namespace {

vector<double> rowAfterRow(const Eigen::MatrixXd& matrix) {
    vector<double> result(matrix.size());
    for (int i = 0; i < matrix.rows(); i++)
        for (int k = 0; k < matrix.cols(); k++) result[i * matrix.cols() + k] = matrix(i, k);
    return result;
}

Eigen::Map<const Eigen::VectorXd> asVector(const vector<double>& numbers) {
    return Eigen::Map<const Eigen::VectorXd>(numbers.data(), numbers.size());
}

vector<double> asNumbers(const Eigen::VectorXd& v) {
    return vector<double>(v.data(), v.data() + v.size());
}

}  // namespace

Fluid& BodyAccess::prepareFluid(const char* method) {
    prepare(method);
    if (!scene.fluid) fail(string(method) + " needs a MobilityForce in the System");
    scene.fluid.adoptSettings();
    scene.fluid.adoptBox();
    return *scene.fluid.get();
}

vector<double> BodyAccess::getMobility() {
    return rowAfterRow(prepareFluid("getMobilityInContext()")
                           .getAnswers()
                           .mobility(scene.bodies, scene.arrays->positions()));
}

vector<double> BodyAccess::getFriction() {
    return rowAfterRow(prepareFluid("getFrictionInContext()")
                           .getAnswers()
                           .friction(scene.bodies, scene.arrays->positions()));
}

vector<double> BodyAccess::applyMobility(const vector<double>& wrenches) {
    Fluid& fluid = prepareFluid("applyMobilityInContext()");
    if ((int)wrenches.size() != 6 * scene.bodies.getNumBodies())
        fail("applyMobilityInContext() was given " + to_string(wrenches.size()) +
             " numbers, but there are " + to_string(scene.bodies.getNumBodies()) +
             " bodies; give 6 numbers for each");
    return asNumbers(
        fluid.getAnswers().apply(asVector(wrenches), scene.bodies, scene.arrays->positions()));
}

bool BodyAccess::flowNeedsForces(const char* method) {
    Fluid& fluid = prepareFluid(method);
    return !hasMomenta() &&
           !fluid.getFlowReader().findLastStep(scene.bodies, scene.arrays->positions(),
                                               scene.integrator.getScheme());
}

FlowQuestion BodyAccess::askForFlow() const {
    scene.arrays->pullVelocities();
    return {scene.bodies, *scene.freeParticles, scene.arrays->positions(),
            scene.arrays->velocities(), scene.integrator.getScheme()};
}

vector<Vec3> BodyAccess::getFlow(const vector<Vec3>& points) {
    const Velocities velocities =
        prepareFluid("getFlowInContext()").getFlowReader().flowAt(points, askForFlow());
    vector<Vec3> result;
    for (int p = 0; p < velocities.cols(); p++)
        result.push_back(Vec3(velocities(0, p), velocities(1, p), velocities(2, p)));
    return result;
}

vector<double> BodyAccess::getFlowMode(int forceAxis, int waveAxis, int waveVectorIndex,
                                       bool randomOnly) {
    Fluid& fluid = prepareFluid("getFlowModeInContext()");
    const auto amplitudes = randomOnly ? fluid.getFlowReader().randomFlowMode(
                                             forceAxis, waveAxis, waveVectorIndex, askForFlow())
                                       : fluid.getFlowReader().flowMode(
                                             forceAxis, waveAxis, waveVectorIndex, askForFlow());
    return {amplitudes[0], amplitudes[1]};
}

vector<double> BodyAccess::applyBlobMobility(const vector<double>& forces) {
    Fluid& fluid = prepareFluid("applyBlobMobilityInContext()");
    const int particles = scene.system.getNumParticles();
    if ((int)forces.size() != 3 * particles)
        fail("applyBlobMobilityInContext() was given " + to_string(forces.size()) +
             " numbers, but the System has " + to_string(particles) +
             " particles; give 3 numbers for each of them, whether the fluid sees it or not");
    return asNumbers(
        fluid.getAnswers().applyToBlobs(asVector(forces), scene.bodies, scene.arrays->positions()));
}

}  // namespace RigidHIPlugin
