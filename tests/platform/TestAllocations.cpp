// After the first steps, a step with dense matrices allocates no memory.

#include <dlfcn.h>
#include <openmm/CustomExternalForce.h>
#include <openmm/internal/ContextImpl.h>

#include <atomic>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <vector>

#include "HydrodynamicSupport.h"
#include "TestSupport.h"
#include "openmmrigidhi/SchemeTraits.h"

using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace OpenMM;
using namespace std;

namespace {

atomic<bool> counting(false);
atomic<int> allocations(0);

}  // namespace

// The program's malloc takes precedence over that of the C library in all libraries. So new, Eigen
// and the vectors of C++ call this function. OpenBLAS, which contains LAPACK, takes buffers of its
// own for some sizes.
extern "C" {
void* __libc_malloc(size_t);
__attribute__((visibility("default"))) void* malloc(size_t size) {
    Dl_info caller;
    if (counting && dladdr(__builtin_return_address(0), &caller) != 0 &&
        !strstr(caller.dli_fname, "blas") && !strstr(caller.dli_fname, "lapack"))
        allocations++;
    return __libc_malloc(size);
}
}

namespace {

/** The bodies of a scene and its fluid. */
struct Scenery {
    const char* name;
    BodyKind body;
    function<void(FluidScene&)> choose;
    vector<int> numBodies = {4, 9};
    double spacing = 6;
    /** The allocations that a step may have: 0, or `some` (docs/ARCHITECTURE.md). */
    int allowed = 0;
    bool isSlow = false;  // only with LangevinHI
};

/** A limit for scenes whose steps allocate. The largest number was 1898, with DriftCorrectorFD. */
const int some = 4000;

/** A model between or in these bounds. */
Scenery bounded(const char* name, MobilityForce::Model model, MobilityForce::Boundary boundary,
                int allowed = 0, bool isSlow = false) {
    return {name,
            sphereKind(0.5),
            [=](FluidScene& scene) {
                scene.fluid->setModel(model);
                scene.fluid->setBoundary(boundary);
                scene.fluid->setChannelWalls(0, 6);
                scene.side = 10;
            },
            {4},
            2,
            allowed,
            isSlow};
}

/** One of the first two bodies moves on a ball at the other one. */
void join(FluidScene& scene) { scene.integrator.addBallJoint(0, Vec3(3, 0, 0), 1, Vec3(-3, 0, 0)); }

const vector<Scenery>& sceneries() {
    using Force = MobilityForce;
    const auto model = [](Force::Model of) {
        return [of](FluidScene& scene) { scene.fluid->setModel(of); };
    };
    const auto lubricated = [](Force::Boundary boundary) {
        return [boundary](FluidScene& scene) {
            scene.fluid->setBoundary(boundary);
            scene.fluid->setLubrication(true);
        };
    };
    const auto held = [](FluidScene& scene) { scene.integrator.setBodyHeld(0, true); };
    const BodyKind rod = {"rod",
                          1,
                          Vec3(0.4, 0.4, 0),
                          {Vec3(0, 0, -1), Vec3(0, 0, 0.2), Vec3(0, 0, 1.2)},
                          {0.5, 0.5, 0.5}};
    static const vector<Scenery> all = {
        {"spheres", sphereKind(0.5), [](FluidScene&) {}},
        {"multiblobs", boomerangKind(),
         [](FluidScene& scene) {
             const bool overdamped = traitsOf(scene.integrator.getScheme()).isOverdamped();
             scene.addFree(overdamped ? 0 : 1, 0.5, Vec3(0, 0, 9));
         }},
        {"rods", rod, [](FluidScene&) {}},
        {"a tensor of its own", boomerangKind(),
         [](FluidScene& scene) {
             scene.fluid->setBodyMobility(0, rowsOf(0.01 * tensorWithoutSymmetry(1)));
         }},
        {"above a wall", sphereKind(0.5),
         [](FluidScene& scene) { scene.fluid->setBoundary(Force::NoSlipWall); }},
        {"one multiblob", boomerangKind(), [](FluidScene&) {}, {1}},
        {"FreeDraining", boomerangKind(), model(Force::FreeDraining)},
        {"StokesianDynamics", sphereKind(0.5), model(Force::StokesianDynamics)},
        {"StokesianDynamics without lubrication", sphereKind(0.5),
         [](FluidScene& scene) {
             scene.fluid->setModel(Force::StokesianDynamics);
             scene.fluid->setLubrication(false);
         }},
        {"lubrication", sphereKind(0.5), lubricated(Force::Unbounded), {4}, 6, some},
        {"lubrication above a wall", sphereKind(0.5), lubricated(Force::NoSlipWall), {4}, 6, some},
        bounded("periodic RotnePragerYamakawa", Force::RotnePragerYamakawa, Force::Periodic),
        bounded("RotnePragerYamakawa, PeriodicWall", Force::RotnePragerYamakawa,
                Force::PeriodicWall, some),
        bounded("RotnePragerYamakawa, NoSlipChannel", Force::RotnePragerYamakawa,
                Force::NoSlipChannel, some),
        bounded("periodic StokesianDynamics", Force::StokesianDynamics, Force::Periodic, some),
        bounded("periodic ForceCoupling", Force::ForceCoupling, Force::Periodic),
        bounded("ForceCoupling, SlipChannel", Force::ForceCoupling, Force::SlipChannel, some),
        bounded("ForceCoupling, NoSlipChannel", Force::ForceCoupling, Force::NoSlipChannel, some,
                true),
        {"a held sphere", sphereKind(0.5), held, {4, 9}, 6, some},
        {"a held multiblob", boomerangKind(), held, {4, 9}, 6, some},
        {"a joint", boomerangKind(), join, {4, 9}, 6, some},
    };
    return all;
}

template <class Work>
int countIn(const Work& work) {
    allocations = 0;
    counting = true;
    work();
    counting = false;
    return allocations;
}

/** Reaches what a step calls for its forces. */
struct ForceEvaluation : CustomExternalForce {
    ForceEvaluation() : CustomExternalForce("0") {}
    int count(Context& context) {
        ContextImpl& impl = getContextImpl(context);
        return countIn([&] { impl.calcForcesAndEnergy(true, false, -1); });
    }
};

/**
 * How often a step allocates memory: the largest number in three steps, after three steps that are
 * not counted. OpenMM's own force evaluations do not count; they allocate on the CPU platform.
 */
int countInSteps(CustomRigidHIIntegrator& integrator, Context& context) {
    integrator.step(3);
    const auto evaluations = [&] { return integrator.getStepStatistics()["forceEvaluations"]; };
    const int inForces = ForceEvaluation().count(context);
    int most = 0;
    for (int i = 0; i < 3; i++) {
        const double before = evaluations();
        const int inStep = countIn([&] { integrator.step(1); });
        most = max(most, inStep - inForces * static_cast<int>(evaluations() - before));
    }
    return most;
}

int countAllocations(CustomRigidHIIntegrator::Scheme scheme, const Scenery& scenery, int numBodies,
                     bool inShear) {
    FluidScene scene(300, 1e-4);
    scene.integrator.setScheme(scheme);
    for (int i = 0; i < numBodies; i++)
        scene.add(scenery.body, scenery.spacing * Vec3(i % 4, i / 4, 0) + Vec3(0, 1, 3));
    scenery.choose(scene);
    if (scene.integrator.getNumJoints() > 0 && *traitsOf(scheme).whyNoJoints()) return 0;
    if (inShear && scene.isPeriodic()) return 0;
    if (inShear) scene.fluid->setBackgroundFlow(Vec3(), {0, 0, 0.1, 0, 0, 0, 0, 0, 0});
    scene.fluid->setSolver(MobilityForce::Dense);
    scene.start(testPlatform());
    return countInSteps(scene.integrator, *scene.context);
}

}  // namespace

TEST(Allocations, AreCounted) {
    EXPECT_EQ(countIn([] {
                  vector<double> numbers(100);
                  const MatrixXd matrix = MatrixXd::Zero(10, numbers.size());
                  EXPECT_EQ(matrix.cols(), 100);
              }),
              2);
}

TEST(Allocations, NoneInADenseStep) {
    if (onDevice()) GTEST_SKIP() << "OpenMM's platforms for devices allocate in their steps";
    for (const SchemeTraits& traits : schemeTable) {
        if (traits.kind == SchemeKind::Thermostat) continue;
        for (const Scenery& scenery : sceneries())
            for (int numBodies : scenery.numBodies)
                for (bool inShear : {false, true}) {
                    if (inShear && numBodies == 9) continue;
                    if (scenery.isSlow && traits.isOverdamped()) continue;
                    // LangevinHI decomposes a matrix. Below 40 rows it uses Eigen, which allocates
                    // a vector of its own.
                    const bool eigen = !traits.isOverdamped() && numBodies < 9;
                    const int found = countAllocations(traits.scheme, scenery, numBodies, inShear);
                    EXPECT_LE(found, scenery.allowed + eigen)
                        << traits.name << ", " << scenery.name << ", " << numBodies << " bodies"
                        << (inShear ? " in a shear flow" : "");
                }
    }
}

TEST(Allocations, NoneWithoutAFluid) {
    if (onDevice()) GTEST_SKIP() << "OpenMM's platforms for devices allocate in their steps";
    for (const SchemeTraits& traits : schemeTable) {
        if (traits.kind != SchemeKind::Thermostat) continue;
        System system;
        vector<Vec3> positions;
        CustomRigidHIIntegrator integrator(300, 1e-3);
        integrator.setScheme(traits.scheme);
        integrator.setRandomNumberSeed(1);
        for (int b = 0; b < 20; b++) {
            vector<int> particles;
            for (const Vec3& site : {Vec3(), Vec3(0.3, 0, 0), Vec3(0, 0.4, 0.1)}) {
                particles.push_back(system.addParticle(2));
                positions.push_back(site + Vec3(b, 0, 0));
            }
            integrator.addRigidBody(particles);
        }
        Context context(system, integrator, testPlatform());
        context.setPositions(positions);
        EXPECT_EQ(countInSteps(integrator, context), 0) << traits.name;
        if (!traits.hasMomenta) continue;
        // Steps after which temperatures are watched: one that adds up, and the end of a window.
        integrator.setFriction(90);
        integrator.setRotationalFriction(90);
        const int inForces = ForceEvaluation().count(context);
        integrator.step(4099);
        EXPECT_EQ(countIn([&] { integrator.step(1); }), inForces) << traits.name;
        integrator.step(3899);
        EXPECT_EQ(countIn([&] { integrator.step(1); }), inForces) << traits.name;
    }
}
