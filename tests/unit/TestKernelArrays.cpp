// A kernel whose arrays are copies on the host takes the same steps, bit for bit, as the kernel
// whose arrays are the Context's own.

#include <openmm/CMMotionRemover.h>
#include <openmm/CustomExternalForce.h>
#include <openmm/KernelFactory.h>
#include <openmm/VirtualSite.h>
#include <openmm/internal/ContextImpl.h>
#include <openmm/reference/ReferencePlatform.h>

#include "TestSupport.h"
#include "context/KernelArrays.h"
#include "host/ScalarLoops.h"
#include "kernel/RigidBodyKernel.h"

using namespace OpenMM;
using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace std;

namespace {

class FactoryOfCopies : public KernelFactory {
public:
    KernelImpl* createKernelImpl(string name, const Platform& platform,
                                 ContextImpl&) const override {
        PlatformParts parts;
        parts.arrays = [](ContextImpl& context) { return make_unique<KernelArrays>(context); };
        parts.loops = [](ContextImpl&) { return make_unique<ScalarLoops>(); };
        return new RigidBodyKernel(name, platform, parts);
    }
};

/** The steps of waters with a massless marker and free particles with a constraint, under forces
 * and a CMMotionRemover. The user changes the state half-way. */
vector<Vec3> trajectory(CustomRigidHIIntegrator::Scheme scheme, Platform& on) {
    System system;
    CustomRigidHIIntegrator integrator(300, 0.002);
    integrator.setScheme(scheme);
    integrator.setRandomNumberSeed(5);
    const bool momenta = traitsOf(scheme).hasMomenta;
    addBodies(system, integrator, waterShape(), 3);
    vector<Vec3> start = randomPoses(waterShape(), 3, 0.5, 7);
    const int first = system.addParticle(12), second = system.addParticle(momenta ? 1 : 0),
              site = system.addParticle(0);
    if (momenta) system.addConstraint(first, second, 0.1);
    system.setVirtualSite(site, new TwoParticleAverageSite(first, second, 0.5, 0.5));
    for (double x : {0.0, 0.1, 0.05}) start.emplace_back(x, 2.0, 0.0);
    auto* field = new CustomExternalForce("20*(x^2+1.3*(y-1)^2+0.7*z^2)");
    for (int p = 0; p < system.getNumParticles(); p++) field->addParticle(p);
    system.addForce(field);
    if (momenta) system.addForce(new CMMotionRemover());
    Context context(system, integrator, on);
    context.setPositions(start);
    if (momenta) context.setVelocitiesToTemperature(300, 3);
    integrator.step(5);
    vector<Vec3> moved = positionsOf(context);
    for (Vec3& x : moved) x += Vec3(0.01, 0, 0);
    context.setPositions(moved);
    integrator.step(5);
    vector<Vec3> result = positionsOf(context), velocities = velocitiesOf(context);
    result.insert(result.end(), velocities.begin(), velocities.end());
    for (const Vec3& x : integrator.getBodyPositions()) result.push_back(x);
    result.emplace_back(context.getState(0).getTime(), 0, 0);
    return result;
}

}  // namespace

TEST(KernelArrays, StepsOnCopiesAreThoseOnTheContextsOwnArrays) {
    vector<vector<Vec3>> own, copies;
    for (auto scheme : thermostats()) own.push_back(trajectory(scheme, platform("Reference")));
    ReferencePlatform withCopies;
    withCopies.registerKernelFactory(IntegrateRigidBodiesKernel::Name(), new FactoryOfCopies());
    for (auto scheme : thermostats()) copies.push_back(trajectory(scheme, withCopies));
    for (size_t i = 0; i < own.size(); i++)
        EXPECT_TRUE(sameBits(own[i], copies[i])) << "scheme " << i;
}

TEST(KernelArrays, ABoxThatTiltsIsRefusedWhereNeighboursWouldNotFollow) {
    platform("Reference");  // loads the libraries
    ReferencePlatform withCopies;
    withCopies.registerKernelFactory(IntegrateRigidBodiesKernel::Name(), new FactoryOfCopies());
    System system;
    CustomRigidHIIntegrator integrator(0, 0.01);
    integrator.setScheme(CustomRigidHIIntegrator::EulerMaruyama);
    integrator.addRigidBody({system.addParticle(1)}, 1, Vec3(1, 1, 1), {Vec3()});
    auto* fluid = new MobilityForce();
    fluid->addParticle(0.5);
    fluid->setBoundary(MobilityForce::Periodic);
    fluid->setShear(0.25, 0, 1);
    system.addForce(fluid);
    system.setDefaultPeriodicBoxVectors(Vec3(9, 0, 0), Vec3(0, 9, 0), Vec3(0, 0, 9));
    expectError([&] { Context context(system, integrator, withCopies); },
                {"shear (setShear()) of the rate 0.25/ps tilts the box at each step",
                 "use the platform CPU or Reference"});
    fluid->setShear(0, 0, 1);
    CustomRigidHIIntegrator another(0, 0.01);
    another.setScheme(CustomRigidHIIntegrator::EulerMaruyama);
    another.addRigidBody({0}, 1, Vec3(1, 1, 1), {Vec3()});
    Context context(system, another, withCopies);
    context.setPositions({Vec3(1, 2, 3)});
    expectError([&] { fluid->getStressInContext(context); },
                {"strains the box for the stress of OpenMM's forces",
                 "ask on the platform CPU or Reference"});
}
