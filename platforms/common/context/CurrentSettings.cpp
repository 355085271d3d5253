#include "context/CurrentSettings.h"

#include <openmm/reference/SimTKOpenMMRealType.h>

#include <iostream>

#include "context/Mismatches.h"
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

void CurrentSettings::update(Scene& scene) {
    const CustomRigidHIIntegrator& integrator = scene.integrator;
    const pair<int, double> wanted(integrator.getSettingsVersion(), integrator.getStepSize());
    if (takenOver == wanted) return;
    checkScheme(scene.system, scene.definitions.underPresentScheme(), scene.stock);
    scene.fluid.adoptSettings();
    // Data that a scheme keeps for its next step are of no use after another scheme has moved the
    // bodies.
    if (scheme != integrator.getScheme() && scene.fluid) scene.fluid->getMemory().forget();
    scheme = integrator.getScheme();
    scene.adoptInertiaScale();
    h = integrator.getStepSize();
    noise.law = static_cast<NoiseStream::Law>(integrator.getNoiseLaw());
    const bool hydrodynamic = traits().kind == SchemeKind::FluidThermostat;
    if (hydrodynamic) scene.fluid->getMomenta().checkInertia(scene.bodies);
    kT = BOLTZ * integrator.getTemperature();
    difference = integrator.getFiniteDifferenceStep();
    driftCorrectorScaling = integrator.getDriftCorrectorScaling();
    fluidCouplesBodies = hydrodynamic && scene.fluid->getMomenta().couplesBodies();
    takenOver = wanted;
    printWarnings(scene);
    if (!traits().isOverdamped()) setThermostats(scene);
    scene.watch.adopt(scene);
}

void CurrentSettings::setThermostats(Scene& scene) {
    const CustomRigidHIIntegrator& integrator = scene.integrator;
    const bool hydrodynamic = traits().kind == SchemeKind::FluidThermostat;
    HeatBath bath;
    bath.kT = kT;
    bath.upsilon = integrator.getGradientRelaxationTime();
    bath.Upsilon = integrator.getGradientRotationalRelaxationTime();
    BodySet& bodies = scene.bodies;
    for (auto& block : bodies.blocks) block.hasNoise = false;
    for (int b = 0; b < bodies.getNumBodies(); b++) {
        integrator.getBodyFriction(b, bath.gamma, bath.Gamma);
        bodies.setThermostat(
            b, hydrodynamic ? scene.fluid->getMomenta().bodyThermostat(b, bodies.inertia(b), kT, h)
                            : schemeCoefficients(scheme, bodies.inertia(b), bath, h));
    }
    bath.gamma = integrator.getFriction();
    vector<Thermostat> free;
    for (int i = 0; i < scene.freeParticles->getNumParticles(); i++) {
        BodyInertia point;
        point.mass = scene.freeParticles->mass(i);
        free.push_back(schemeCoefficients(scheme, point, bath, h));
        if (hydrodynamic)
            scene.fluid->getMomenta().freeThermostat(i, point.mass, kT, h, free.back());
    }
    scene.freeParticles->setThermostats(free);
}

void CurrentSettings::warnOfSteps(const Scene& scene) {
    if (stepsHaveWarnings(scene, printed)) printWarnings(scene);
}

void CurrentSettings::warnOfBarostat(const Scene& scene) {
    if (scene.stock.barostat.empty() || printed.count(WarningCause::BarostatTemperature) > 0)
        return;
    const string text = barostatAtAnotherTemperature(scene);
    if (!text.empty()) printOnce(WarningCause::BarostatTemperature, text);
}

void CurrentSettings::printWarnings(const Scene& scene) {
    for (const auto& warning : findWarnings(scene))
        if (warning.first != WarningCause::BarostatTemperature)
            printOnce(warning.first, warning.second);
}

void CurrentSettings::printOnce(WarningCause cause, const string& text) {
    if (printed.insert(cause).second) cerr << "Warning: CustomRigidHIIntegrator: " << text << endl;
}

}  // namespace RigidHIPlugin
