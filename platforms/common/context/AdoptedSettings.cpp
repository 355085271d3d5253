#include "context/AdoptedSettings.h"

#include <openmm/OpenMMException.h>
#include <openmm/reference/SimTKOpenMMRealType.h>

#include "context/Scene.h"
#include "schemes/Thermostats-inl.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

namespace {

Thermostat schemeCoefficients(CustomRigidHIIntegrator::Scheme scheme, const BodyInertia& body,
                              const HeatBath& bath, double h) {
    return scalar::withThermostat(scheme,
                                  [&](auto named) { return named.coefficients(body, bath, h); });
}

}  // namespace

Warnings AdoptedSettings::adopt(Scene& scene) {
    const CustomRigidHIIntegrator& integrator = scene.integrator;
    // The platform's arrays would be too short.
    const size_t particles = scene.system.getNumParticles(),
                 ofContext = scene.stock.bodyOfParticle.size();
    if (particles != ofContext)
        throw OpenMMException(
            "CustomRigidHIIntegrator: the System has " + to_string(particles) +
            " particles, but had " + to_string(ofContext) +
            " when this Context was created; call reinitialize(preserveState=False) on the Context "
            "and set positions, or add particles before you create the Context");
    checkScheme(scene.system, scene.definitions.underPresentScheme(), scene.stock);
    scene.adoptInertia();
    scene.fluid.adoptSettings();
    // Data that a scheme keeps for its next step are useless after another scheme has moved the
    // bodies.
    if (scheme != integrator.getScheme() && scene.fluid) scene.fluid->getMemory().forget();
    scheme = integrator.getScheme();
    h = integrator.getStepSize();
    noise.law = static_cast<NoiseStream::Law>(integrator.getNoiseLaw());
    const bool hydrodynamic = traits().kind == SchemeKind::FluidThermostat;
    if (hydrodynamic) scene.fluid->getMomenta().checkInertia(scene.bodies);
    kT = BOLTZ * integrator.getTemperature();
    difference = integrator.getFiniteDifferenceStep();
    driftCorrectorScaling = integrator.getDriftCorrectorScaling();
    needsMiddle = hydrodynamic && scene.fluid->getMomenta().needsMiddle();
    adopted = {integrator.getSettingsVersion(), integrator.getStepSize()};
    version++;
    // Find warnings first: the watch forgets its findings when it adopts the settings.
    Warnings warnings = findWarnings(scene);
    if (!traits().isOverdamped()) setThermostats(scene);
    scene.bodies.keepTorquesInLab(traits().isOverdamped());
    scene.watch.adopt(scene);
    return warnings;
}

bool AdoptedSettings::areAdopted(const CustomRigidHIIntegrator& integrator) const {
    return adopted == pair<int, double>(integrator.getSettingsVersion(), integrator.getStepSize());
}

void AdoptedSettings::setThermostats(Scene& scene) {
    const CustomRigidHIIntegrator& integrator = scene.integrator;
    const bool hydrodynamic = traits().kind == SchemeKind::FluidThermostat;
    HeatBath bath;
    bath.kT = kT;
    bath.upsilon = integrator.getGradientRelaxationTime();
    bath.Upsilon = integrator.getGradientRotationalRelaxationTime();
    BodySet& bodies = scene.bodies;
    for (auto& block : bodies.blocks) block.hasNoise = false;
    for (int b = 0; b < bodies.getNumBodies(); b++) {
        if (bodies.isHeld(b)) continue;
        integrator.getBodyFriction(b, bath.gamma, bath.Gamma);
        bodies.setThermostat(
            b, hydrodynamic ? scene.fluid->getMomenta().bodyThermostat(b, bodies.inertia(b), kT, h)
                            : schemeCoefficients(scheme, bodies.inertia(b), bath, h));
    }
    bath.gamma = integrator.getFriction();
    vector<Thermostat> free;
    for (int i = 0; i < scene.freeParticles->getNumParticles(); i++) {
        BodyInertia point;
        free.emplace_back();
        if (scene.freeParticles->isHeld(i)) continue;
        point.mass = scene.freeParticles->mass(i);
        free.back() = schemeCoefficients(scheme, point, bath, h);
        if (hydrodynamic)
            scene.fluid->getMomenta().freeThermostat(i, point.mass, kT, h, free.back());
    }
    scene.freeParticles->setThermostats(free);
}

}  // namespace RigidHIPlugin
