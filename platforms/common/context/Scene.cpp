#include "context/Scene.h"

#include <random>

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

Scene::Scene(ContextImpl& context, const CustomRigidHIIntegrator& integrator,
             unique_ptr<ContextArrays> arraysToUse, unique_ptr<PlatformLoops> loopsToUse)
    : integrator(integrator), system(context.getSystem()), arrays(move(arraysToUse)),
      loops(move(loopsToUse)), definitions(integrator, system),
      stock(takeStock(context, definitions.underPresentScheme())), bodyForces(context),
      fluid(*this, stock.mobilityForce) {
    arrays->checkVirtualSites();
    stock.velocityDependentForce = bodyForces.velocityDependence();
    checkScheme(system, definitions.underPresentScheme(), stock);
    stock.mobilityForce = fluid.getParameters();
    freeParticles.reset(new FreeParticles(system, stock.freeParticles, arrays->constraints()));
    definitions.takeFromSystem();
    if (definitions.areAllKnown())
        build(definitions.geometries());
    else
        fluid.check();
    settings.noise.seed = integrator.getRandomNumberSeed();
    while (settings.noise.seed == 0) settings.noise.seed = random_device()();
}

void Scene::build(const vector<BodyGeometry>& geometries) {
    BodyDefinitions::Bodies newBodies = definitions.build(geometries);
    unique_ptr<Fluid> newFluid = fluid.make(newBodies);
    const auto exchange = [&] {
        definitions.exchange(newBodies);
        swap(bodies, newBodies.set);
        fluid.exchange(newFluid);
        settings.forget();
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

void Scene::adoptInertiaScale() {
    bodies.setInertiaScale(
        traitsOf(integrator.getScheme()).hasMomenta ? integrator.getInertiaScale() : 1);
}

BoxVectors Scene::getBox() const {
    Vec3 box[3];
    arrays->getBox(box);
    return {box[0], box[1], box[2]};
}

void Scene::resetGeometry() {
    definitions.reset();
    built = false;
    noteChange();
}

}  // namespace RigidHIPlugin
