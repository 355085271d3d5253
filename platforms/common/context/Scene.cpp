#include "context/Scene.h"

#include <algorithm>
#include <random>
#include <string>

#include "context/Messages.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

uint32_t seedOrFresh(int seed) {
    uint32_t key = seed;
    while (key == 0) key = random_device()();
    return key;
}

/** Whether OpenMM computes forces and energies in double precision. */
static bool hasExactForces(ContextImpl& context) {
    const Platform& platform = context.getPlatform();
    if (platform.getName() == "Reference") return true;
    const vector<string>& names = platform.getPropertyNames();
    return find(names.begin(), names.end(), "Precision") != names.end() &&
           platform.getPropertyValue(context.getOwner(), "Precision") == "double";
}

Scene::Scene(ContextImpl& context, const CustomRigidHIIntegrator& integrator,
             unique_ptr<ContextArrays> arraysToUse, unique_ptr<PlatformLoops> loopsToUse)
    : integrator(integrator), system(context.getSystem()),
      contextParameters(context.getParameters()), forcesAreExact(hasExactForces(context)),
      arrays(move(arraysToUse)), loops(move(loopsToUse)), definitions(integrator, system),
      stock(takeStock(context, definitions.underPresentScheme())), bodyForces(context),
      bodyMotions(context.getForceImpls(), definitions.getNumBodies()),
      fluid(*this, stock.mobilityForce) {
    arrays->checkVirtualSites();
    stock.velocityDependentForce = bodyForces.velocityDependence();
    stock.prescribed = bodyMotions.getPrescribed();
    checkScheme(system, definitions.underPresentScheme(), stock);
    stock.mobilityForce = fluid.getParameters();
    freeParticles = make_unique<FreeParticles>(system, stock.freeParticles, arrays->constraints());
    getBox();  // throws where it is not finite
    definitions.takeFromSystem();
    if (definitions.areAllKnown())
        build(definitions.geometries());
    else
        fluid.check();
    settings.noise.seed = seedOrFresh(integrator.getRandomNumberSeedAsSet());
    noiseHistory.setSeed(settings.noise.seed, *this);
}

void Scene::build(const vector<BodyGeometry>& geometries) {
    BodyDefinitions::Bodies newBodies = definitions.build(geometries, withoutMomenta());
    bodyMotions.checkSpins(geometries, definitions.particlesOfBodies(), fluid.getParameters());
    unique_ptr<Fluid> newFluid = fluid.make(newBodies);
    const auto exchange = [&] {
        definitions.exchange(newBodies);
        swap(bodies, newBodies.set);
        fluid.exchange(newFluid);
        settings.forget();
        adoptedHeld.reset();
    };
    const bool wasBuilt = built;
    exchange();
    built = true;
    try {
        updateSettings();
    } catch (...) {
        exchange();
        built = wasBuilt;
        throw;
    }
}

void Scene::buildFromPositions() {
    const vector<BodyGeometry> geometries = definitions.fromPositions(arrays->positions());
    vector<int> found;
    for (int b = 0; b < definitions.getNumBodies(); b++)
        if (!definitions.isKnown(b)) found.push_back(b);
    build(geometries);
    for (int b : found) definitions.record(b, geometries[b]);
}

void Scene::adoptInertia() {
    adoptHeld();
    bodies.setInertiaScale(
        traitsOf(integrator.getScheme()).hasMomenta ? integrator.getInertiaScale() : 1);
}

/**
 * The bodies whose momenta are no part of the state: held bodies and, under LangevinHI, bodies that
 * CustomBodyMotions move.
 */
vector<bool> Scene::withoutMomenta() const {
    const bool moves =
        traitsOf(integrator.getScheme()).kind == SchemeKind::FluidThermostat && bodyMotions.isOn();
    vector<bool> result;
    for (int b = 0; b < definitions.getNumBodies(); b++)
        result.push_back(integrator.getBodyHeld(b) ||
                         (moves && bodyMotions.getPrescribed().count(b) > 0));
    return result;
}

/**
 * Hold the bodies and particles that the integrator holds. Users may change these, and the scheme,
 * between steps.
 */
void Scene::adoptHeld() {
    if (adoptedHeld == integrator.getSettingsVersion()) return;
    bool isNew = freeParticles->setHeld(integrator.getHeldParticles()), areOthers = false;
    const vector<bool> wanted = withoutMomenta();
    for (int b = 0; built && b < bodies.getNumBodies(); b++)
        areOthers = areOthers || bodies.isHeld(b) != wanted[b];
    if (areOthers) {
        BodySet others = definitions.build(definitions.geometries(), wanted).set;
        others.takeStates(bodies);
        swap(bodies, others);
        isNew = true;
    }
    adoptedHeld = integrator.getSettingsVersion();
    if (!isNew) return;
    settings.forget();
    noteChange();
    heldChanges++;
}

BoxVectors Scene::getBox() const {
    Vec3 box[3];
    arrays->getBox(box);
    const char* const names[3] = {"a", "b", "c"};
    for (int k = 0; k < 3; k++)
        if (!isFinite(box[k]))
            fail(string("the Context's box vector ") + names[k] + " is " + text(box[k]) +
                 " nm, which is not finite; set finite vectors by setPeriodicBoxVectors() on the "
                 "Context, or by setDefaultPeriodicBoxVectors() on the System before");
    return {box[0], box[1], box[2]};
}

void Scene::resetGeometry() {
    definitions.reset();
    built = false;
    noteChange();
}

const Eigen::MatrixXd* Scene::prescribedNow() {
    if (!bodyMotions.isOn()) return nullptr;
    bodyMotions.evaluate(contextParameters, arrays->getTime(), prescribed);
    return &prescribed;
}

}  // namespace RigidHIPlugin
