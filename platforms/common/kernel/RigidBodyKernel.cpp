#include "kernel/RigidBodyKernel.h"

#include <cmath>

#include "context/Messages.h"
#include "context/Resuming.h"
#include "kernel/BodyAccess.h"
#include "kernel/FluidAccess.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

void RigidBodyKernel::initialize(ContextImpl& context, const CustomRigidHIIntegrator& integrator) {
    scene = make_unique<Scene>(context, integrator, parts.arrays(context), parts.loops(context));
    mirror = make_unique<ContextMirror>(*scene);
    stepper = make_unique<Stepper>(context, *scene, *mirror);
    if (parts.native) native = parts.native(context, *scene, *mirror, *stepper);
    scene->native = native.get();
    bodies = accessToBodies(*scene, *mirror, *stepper, getPlatform().getName());
    fluid = accessToFluid(*scene, *mirror, *stepper);
}

void RigidBodyKernel::step(int steps) {
    if (native && native->take(steps)) return;
    stepper->takeSteps(steps);
}

void RigidBodyKernel::stateChanged(State::DataType changed) {
    if (changed == State::Positions || changed == State::Velocities) bringBack();
    scene->noteChange();
    if (changed == State::Positions) mirror->positionsWereSet();
    if (changed == State::Velocities) mirror->velocitiesWereSet();
    if (changed == State::Positions || changed == State::Velocities)
        scene->noiseHistory.stateWasSet(*scene);
}

void RigidBodyKernel::resetBodyGeometry() {
    bringBack();
    scene->resetGeometry();
    mirror->forgetWritten();
}

void RigidBodyKernel::setRandomNumberSeed(int seed) {
    scene->settings.noise.seed = seedOrFresh(seed);
    scene->noiseHistory.setSeed(scene->settings.noise.seed, *scene);
}

vector<Vec3> RigidBodyKernel::drawVelocities(double temperature, int seed) {
    bringBack();
    mirror->requirePositions("setVelocitiesToTemperature()");
    if (!(temperature >= 0) || !isfinite(temperature))
        fail("setVelocitiesToTemperature(): the temperature is " + number(temperature) +
             " K; it must be 0 or positive and finite");
    mirror->takeInChanges();
    return mirror->drawVelocities(temperature, seed);
}

void RigidBodyKernel::createCheckpoint(ostream& stream) {
    bringBack();
    collectState(*scene, *mirror).write(stream);
}

void RigidBodyKernel::loadCheckpoint(istream& stream) {
    bringBack();
    adoptState(SavedState::read(stream), *scene, *mirror);
}

void RigidBodyKernel::serialize(SerializationNode& node) {
    bringBack();
    collectState(*scene, *mirror).write(node);
}

void RigidBodyKernel::deserialize(const SerializationNode& node) {
    bringBack();
    adoptState(node, *scene, *mirror);
}

}  // namespace RigidHIPlugin
