#include "context/ContextFluid.h"

#include <string>

#include "context/Messages.h"
#include "context/Scene.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

ContextFluid::ContextFluid(Scene& scene, const MobilityForce* inSystem)
    : scene(scene), source(inSystem) {
    if (inSystem) parameters = make_unique<MobilityForce>(*inSystem);
}

const MobilityForce* ContextFluid::getChanged() const {
    for (int i = 0; parameters && i < scene.system.getNumForces(); i++)
        if (&scene.system.getForce(i) == source &&
            source->getSettingsVersion() != parameters->getSettingsVersion())
            return source;
    return nullptr;
}

FluidSettings ContextFluid::settings() const {
    return FluidSettings(scene.integrator, scene.stock.prescribed, scene.definitions.joints(),
                         scene.definitions.motors());
}

void ContextFluid::checkWithIntegrator(const MobilityForce& force) const {
    checkBoundary(force, scene.integrator);
    checkSlips(force, scene.integrator);
    checkShear(force, scene.integrator);
    double rate;
    int flowAxis, gradientAxis;
    force.getShear(rate, flowAxis, gradientAxis);
    constexpr ErrorsOf fail{"MobilityForce"};
    if (rate != 0 && !scene.arrays->canSetBox())
        fail("a shear (setShear()) of the rate " + number(rate) +
             "/ps tilts the box at each step, which the platform of the Context does not allow for "
             "where it keeps lists of neighbours; use the platform CPU or Reference");
}

void ContextFluid::check(const MobilityForce& force) const {
    checkWithIntegrator(force);
    Fluid::check(force, settings(), scene.system, scene.definitions.particlesOfBodies(),
                 *scene.freeParticles, *scene.loops);
}

void ContextFluid::check() const {
    if (parameters) check(*parameters);
}

unique_ptr<Fluid> ContextFluid::make(const vector<BodyGeometry>& geometries,
                                     const BodySet& bodies) const {
    if (!parameters) return nullptr;
    // Settings of the integrator may have been changed since the Context was created.
    checkWithIntegrator(*parameters);
    auto made = make_unique<Fluid>(*parameters, settings(), scene.system,
                                   scene.definitions.particlesOfBodies(), geometries, bodies,
                                   *scene.freeParticles, *scene.loops);
    made->setBox(scene.getBox());
    made->checkWave();
    return made;
}

void ContextFluid::takeBox() {
    if (!fluid || !fluid->getContents().isPeriodic()) return;
    const BoxVectors box = scene.getBox();
    if (fluid->getContents().box == box) return;
    fluid->setBox(box);
    // Data that a scheme keeps for its next step belong to the old box.
    fluid->getMemory().forget();
}

void ContextFluid::adoptBox() {
    takeBox();
    if (fluid) fluid->checkBox();
}

unique_ptr<Fluid> ContextFluid::make(const BodyDefinitions::Bodies& bodies) {
    unique_ptr<Fluid> result = make(bodies.geometries, bodies.set);
    if (fluid) result->continueFrom(*fluid);
    return result;
}

void ContextFluid::rebuild() {
    unique_ptr<Fluid> before(move(fluid));
    try {
        fluid = make(scene.definitions.geometries(), scene.bodies);
        if (traitsOf(scene.integrator.getScheme()).kind == SchemeKind::FluidThermostat)
            fluid->getMomenta().checkInertia(scene.bodies);
    } catch (...) {
        fluid = move(before);
        throw;
    }
    fluid->continueFrom(*before);
    scene.settings.forget();
}

void ContextFluid::adoptSettings() {
    if (!fluid) return;
    const FluidSettings wanted = settings();
    if (fluid->isMadeFor(wanted))
        fluid->setMotorRates(wanted.motors);
    else
        rebuild();
}

void ContextFluid::update(const MobilityForce& force) {
    if (!parameters) fail("updateParametersInContext() needs a MobilityForce in the System");
    const string remedy = "; call reinitialize(preserveState=True) on the Context";
    if (force.getModel() != parameters->getModel() ||
        force.getBoundary() != parameters->getBoundary())
        fail("updateParametersInContext() cannot change the model or boundary of a MobilityForce" +
             remedy);
    if (force.getWallHeight() != parameters->getWallHeight() ||
        force.getSphereWallMobility() != parameters->getSphereWallMobility())
        fail(
            "updateParametersInContext() cannot change the wall height or sphere-wall mobility of "
            "a MobilityForce" +
            remedy);
    double low, high, lowBefore, highBefore;
    force.getChannelWalls(low, high);
    parameters->getChannelWalls(lowBefore, highBefore);
    if (low != lowBefore || high != highBefore ||
        force.getChannelCondition() != parameters->getChannelCondition())
        fail("updateParametersInContext() cannot change the walls or the condition of a channel" +
             remedy);
    if (force.getGroups() != parameters->getGroups())
        fail(
            "updateParametersInContext() cannot change the groups of a MobilityForce; call "
            "reinitialize(preserveState=False) on the Context and set positions");
    if (force.getNumParticles() != parameters->getNumParticles())
        fail(
            "updateParametersInContext() cannot change the number of particles of a MobilityForce" +
            remedy);
    for (int p = 0; p < force.getNumParticles(); p++)
        if ((force.getParticleRadius(p) > 0) != (parameters->getParticleRadius(p) > 0))
            fail("particle " + to_string(p) +
                 ": updateParametersInContext() cannot change its hydrodynamic radius between 0 "
                 "and a positive value" +
                 remedy);
    if (!scene.isBuilt()) {
        check(force);
        *parameters = force;
        return;
    }
    const auto before = make_unique<MobilityForce>(*parameters);
    *parameters = force;
    try {
        rebuild();
    } catch (...) {
        *parameters = *before;
        throw;
    }
}

}  // namespace RigidHIPlugin
