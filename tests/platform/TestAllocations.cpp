// After the first steps, a step with dense matrices allocates no memory.

#include <dlfcn.h>
#include <openmm/CustomExternalForce.h>
#include <openmm/internal/ContextImpl.h>

#include <atomic>
#include <cstdlib>
#include <cstring>

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

enum Kind {
    Spheres,
    Multiblobs,
    Rods,
    WithOwnTensor,
    AboveWall,
    OneMultiblob,
    FreeDraining,
    Stokesian,
    Unlubricated
};

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

int countAllocations(CustomRigidHIIntegrator::Scheme scheme, Kind kind, int numBodies,
                     bool inShear) {
    FluidScene scene(300, 1e-4);
    scene.integrator.setScheme(scheme);
    const vector<Vec3> threeOnALine = {Vec3(0, 0, -1), Vec3(0, 0, 0.2), Vec3(0, 0, 1.2)};
    const BodyKind rod = {"rod", 1, Vec3(0.4, 0.4, 0), threeOnALine, {0.5, 0.5, 0.5}};
    for (int i = 0; i < numBodies; i++)
        scene.add(kind == Spheres || kind == AboveWall || kind == Stokesian || kind == Unlubricated
                      ? sphereKind(0.5)
                  : kind == Rods ? rod
                                 : boomerangKind(),
                  Vec3(6 * (i % 4), 6 * (i / 4), 3));
    if (kind == Multiblobs)
        scene.addFree(traitsOf(scheme).isOverdamped() ? 0 : 1, 0.5, Vec3(0, 0, 9));
    if (kind == WithOwnTensor)
        scene.fluid->setBodyMobility(0, rowsOf(0.01 * tensorWithoutSymmetry(1)));
    if (kind == AboveWall) scene.fluid->setBoundary(MobilityForce::NoSlipWall);
    if (kind == FreeDraining) scene.fluid->setModel(MobilityForce::FreeDraining);
    if (kind == Stokesian || kind == Unlubricated)
        scene.fluid->setModel(MobilityForce::StokesianDynamics);
    if (kind == Unlubricated) scene.fluid->setLubrication(false);
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
        for (Kind kind : {Spheres, Multiblobs, Rods, WithOwnTensor, AboveWall, OneMultiblob,
                          FreeDraining, Stokesian, Unlubricated})
            for (int numBodies : {4, 9})
                for (bool inShear : {false, true}) {
                    if (inShear && numBodies == 9) continue;
                    if (kind == OneMultiblob) numBodies = 1;
                    // LangevinHI decomposes a matrix. Below 40 rows it uses Eigen, which allocates
                    // a vector of its own.
                    const bool eigen = !traits.isOverdamped() && numBodies == 4;
                    EXPECT_LE(countAllocations(traits.scheme, kind, numBodies, inShear),
                              eigen ? 1 : 0)
                        << traits.name << ", kind " << kind << ", " << numBodies << " bodies"
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
