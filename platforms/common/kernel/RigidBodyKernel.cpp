#include "kernel/RigidBodyKernel.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "context/Effects.h"
#include "context/Messages.h"
#include "context/MidStepTemperatures.h"
#include "context/Resuming.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

void RigidBodyKernel::initialize(ContextImpl& context, const CustomRigidHIIntegrator& integrator) {
    scene.reset(new Scene(context, integrator, parts.arrays(context), parts.loops(context)));
    mirror.reset(new ContextMirror(*scene));
    access.reset(new BodyAccess(*scene, *mirror));
    stepper.reset(new Stepper(context, *scene, *mirror));
}

void RigidBodyKernel::step(ContextImpl&, int steps) { stepper->takeSteps(steps); }

void RigidBodyKernel::stateChanged(ContextImpl&, State::DataType changed) {
    scene->noteChange();
    if (changed == State::Positions) mirror->positionsWereSet();
    if (changed == State::Velocities) mirror->velocitiesWereSet();
}

void RigidBodyKernel::resetBodyGeometry(ContextImpl&) {
    scene->resetGeometry();
    mirror->forgetWritten();
}

void RigidBodyKernel::requireGeometry(ContextImpl&) { access->requireGeometry(); }

vector<Vec3> RigidBodyKernel::getBodyPositions(ContextImpl&) { return access->getPositions(); }

vector<QuaternionArray> RigidBodyKernel::getBodyOrientations(ContextImpl&) {
    return access->getOrientations();
}

vector<Vec3> RigidBodyKernel::getBodyVelocities(ContextImpl&) { return access->getVelocities(); }

vector<Vec3> RigidBodyKernel::getBodyAngularVelocities(ContextImpl&) {
    return access->getAngularVelocities();
}

void RigidBodyKernel::setBodyPositions(ContextImpl&, const vector<Vec3>& rows) {
    access->setPositions(rows);
}

void RigidBodyKernel::setBodyOrientations(ContextImpl&, const vector<QuaternionArray>& rows) {
    access->setOrientations(rows);
}

void RigidBodyKernel::setBodyVelocities(ContextImpl&, const vector<Vec3>& rows) {
    access->setVelocities(rows);
}

void RigidBodyKernel::setBodyAngularVelocities(ContextImpl&, const vector<Vec3>& rows) {
    access->setAngularVelocities(rows);
}

vector<Vec3> RigidBodyKernel::getBodyForces(ContextImpl&) { return access->getForces(); }

vector<Vec3> RigidBodyKernel::getBodyTorques(ContextImpl&) { return access->getTorques(); }

double RigidBodyKernel::getPoseResidual(ContextImpl&) { return access->getPoseResidual(); }

double RigidBodyKernel::computeTranslationalKineticEnergy(ContextImpl&) {
    return access->translationalKineticEnergy();
}

Vec3 RigidBodyKernel::computeRotationalKineticEnergies(ContextImpl&) {
    return access->rotationalKineticEnergies();
}

double RigidBodyKernel::computeFreeParticleKineticEnergy(ContextImpl&) {
    return access->freeParticleKineticEnergy();
}

map<string, int> RigidBodyKernel::getDegreesOfFreedom(ContextImpl&) {
    if (traitsOf(scene->integrator.getScheme()).hasMomenta) access->requireGeometry();
    return countDegreesOfFreedom(*scene);
}

map<string, double> RigidBodyKernel::computeMidStepTemperatures(ContextImpl&) {
    return midStepTemperatures(*scene, stepper->findMidStepEnergies());
}

map<string, string> RigidBodyKernel::getEffects(ContextImpl&) {
    if (!scene->isBuilt() && mirror->hasPositions()) mirror->takeInChanges();
    scene->adoptInertiaScale();
    scene->fluid.takeBox();
    return findEffects(*scene, getPlatform().getName());
}

string RigidBodyKernel::describeEffects(ContextImpl& context) {
    string text;
    for (const auto& effect : getEffects(context)) {
        string value = effect.second;  // "on: why" or "off: why"
        text += effect.first + ": " + value.replace(value.find(':'), 1, ",") + "\n";
    }
    return text;
}

map<string, double> RigidBodyKernel::getStepStatistics(ContextImpl&) {
    return nameCounters(*scene);
}

int RigidBodyKernel::getNumRejectedSteps(ContextImpl&) {
    // The public type is int, the counter is not. In a long run the result stays at the largest int
    // instead of becoming negative.
    return static_cast<int>(
        min<long long>(scene->counters.rejectedSteps, numeric_limits<int>::max()));
}

vector<Vec3> RigidBodyKernel::drawVelocities(ContextImpl&, double temperature, int seed) {
    mirror->requirePositions("setVelocitiesToTemperature()");
    if (!(temperature >= 0) || !isfinite(temperature))
        fail("setVelocitiesToTemperature(): the temperature is " + number(temperature) +
             " K; it must be 0 or positive and finite");
    mirror->takeInChanges();
    return mirror->drawVelocities(temperature, seed);
}

void RigidBodyKernel::updateFluid(ContextImpl&, const MobilityForce& force) {
    scene->fluid.update(force);
}

vector<double> RigidBodyKernel::getMobility(ContextImpl&) { return access->getMobility(); }

vector<double> RigidBodyKernel::getFriction(ContextImpl&) { return access->getFriction(); }

vector<double> RigidBodyKernel::applyMobility(ContextImpl&, const vector<double>& wrenches) {
    return access->applyMobility(wrenches);
}

vector<Vec3> RigidBodyKernel::getFlow(ContextImpl&, const vector<Vec3>& points) {
    if (access->flowNeedsForces("getFlowInContext()")) stepper->evaluateForces();
    return access->getFlow(points);
}

vector<double> RigidBodyKernel::getFlowMode(ContextImpl&, int forceAxis, int waveAxis,
                                            int waveVectorIndex, bool randomOnly) {
    if (access->flowNeedsForces("getFlowModeInContext()")) stepper->evaluateForces();
    return access->getFlowMode(forceAxis, waveAxis, waveVectorIndex, randomOnly);
}

vector<double> RigidBodyKernel::applyBlobMobility(ContextImpl&, const vector<double>& forces) {
    return access->applyBlobMobility(forces);
}

void RigidBodyKernel::createCheckpoint(ContextImpl&, ostream& stream) {
    collectState(*scene, *mirror).write(stream);
}

void RigidBodyKernel::loadCheckpoint(ContextImpl&, istream& stream) {
    adoptState(SavedState::read(stream), *scene, *mirror);
}

void RigidBodyKernel::serialize(ContextImpl&, SerializationNode& node) {
    collectState(*scene, *mirror).write(node);
}

void RigidBodyKernel::deserialize(ContextImpl&, const SerializationNode& node) {
    adoptState(node, *scene, *mirror);
}

}  // namespace RigidHIPlugin
