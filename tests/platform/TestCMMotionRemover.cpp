// OpenMM's CMMotionRemover removes the momentum of bodies with any masses, only in the steps in
// which it is due, and changes nothing else.

#include <openmm/CMMotionRemover.h>
#include <openmm/internal/ContextImpl.h>
#include <openmm/internal/ForceImpl.h>

#include <numeric>

#include "WaterBoxSupport.h"

using namespace OpenMM;
using namespace RigidHITest;
using namespace std;

TEST(CMMotionRemover, RemovesMomentumAndThreeDegreesOfFreedom) {
    WaterBox box(3, 0.002);
    box.system.addForce(new CMMotionRemover());
    box.start();
    box.context->setVelocitiesToTemperature(300, 1);
    EXPECT_EQ(box.integrator.getDegreesOfFreedom().at("removed"), 3);
    EXPECT_EQ(box.integrator.getDegreesOfFreedom().at("total"), 27 * 6 - 3);
    const auto spinsBefore = box.integrator.getBodyAngularVelocities();
    // The remover acts before the drift of a step. With no forces and no friction, the momentum
    // after a step is that of one step's noise.
    box.integrator.setFriction(0);
    box.integrator.setRotationalFriction(0);
    box.integrator.step(5);
    Vec3 p;
    for (const Vec3& v : box.integrator.getBodyVelocities()) p += v * 18.0154;
    // Internal forces conserve momentum (on CPU to single precision).
    EXPECT_LT(norm(p), hasSingleForces() ? 0.05 : forceTolerance(1e-9, 1));
    EXPECT_GT(box.integrator.getBodyAngularVelocities()[0].dot(spinsBefore[0]), -1e9);
}

TEST(CMMotionRemover, LeavesRotationAlone) {
    Vec3 rotational[2];
    double whole[2];
    for (bool remover : {false, true}) {
        System system;
        CustomRigidHIIntegrator integrator(0, 0.001);
        integrator.setFriction(0);
        integrator.setRotationalFriction(0);
        vector<Vec3> positions;
        double y = 0;
        for (const Shape& shape : allShapes()) {
            addBodies(system, integrator, shape, 2);
            for (const Vec3& x : randomPoses(shape, 2, 5, 3))
                positions.push_back(x + Vec3(0, y, 0));
            y += 5;
        }
        system.addParticle(7.0);
        positions.push_back(Vec3(0, -5, 0));
        if (remover) system.addForce(new CMMotionRemover());
        Context context(system, integrator, testPlatform());
        context.setPositions(positions);
        context.setVelocitiesToTemperature(300, 1);
        integrator.step(3);
        rotational[remover] = integrator.computeRotationalKineticEnergies();
        whole[remover] = context.getState(State::Energy).getKineticEnergy();
        if (!remover) continue;
        Vec3 p;
        const auto v = velocitiesOf(context);
        for (int i = 0; i < system.getNumParticles(); i++) p += v[i] * system.getParticleMass(i);
        EXPECT_LT(norm(p), readTolerance(1e-10, 1e3));  // the total mass is that large
    }
    // Reading the shifted velocities adds rounding errors only. About a needle's thin axis 1e-16
    // becomes 1e-11.
    EXPECT_LT(norm(rotational[1] - rotational[0]) / norm(rotational[0]), readTolerance(1e-9, 1));
    EXPECT_LT(whole[1], whole[0]);
}

namespace {

/** A Force of another plugin that changes the velocity of one particle before every step. */
class Kick : public Force {
public:
    Kick(int particle, const Vec3& change) : particle(particle), change(change) {}
    bool usesPeriodicBoundaryConditions() const override { return false; }

protected:
    struct Impl : ForceImpl {
        const Kick& owner;
        explicit Impl(const Kick& owner) : owner(owner) {}
        void initialize(ContextImpl&) override {}
        const Force& getOwner() const override { return owner; }
        void updateContextState(ContextImpl& context, bool&) override {
            vector<Vec3> v;
            context.getVelocities(v);
            v[owner.particle] += owner.change;
            context.setVelocities(v);
        }
        double calcForcesAndEnergy(ContextImpl&, bool, bool, int) override { return 0; }
        map<string, double> getDefaultParameters() override { return {}; }
        vector<string> getKernelNames() override { return {}; }
    };
    ForceImpl* createImpl() const override { return new Impl(*this); }

private:
    const int particle;
    const Vec3 change;
};

/** Bodies without forces whose masses differ from those of their particles, in every possible way.
 */
struct OddMasses {
    System system;
    CustomRigidHIIntegrator integrator{0, 0.001};
    vector<Vec3> positions;
    vector<double> masses;  // of the bodies
    unique_ptr<Context> context;
    void add(const vector<double>& systemMasses, double mass, const Vec3& moments,
             const vector<Vec3>& sites) {
        vector<int> members;
        for (size_t i = 0; i < sites.size(); i++) {
            members.push_back(system.addParticle(systemMasses[i]));
            positions.push_back(sites[i] + Vec3(2.0 * masses.size(), 0, 0));
        }
        masses.push_back(mass);
        if (moments == Vec3())
            integrator.addRigidBody(members);
        else
            integrator.addRigidBody(members, mass, moments, sites);
    }
    OddMasses(int frequency, Force* other = nullptr) {
        integrator.setFriction(0);
        integrator.setRotationalFriction(0);
        const vector<Vec3> pair = {Vec3(-0.1, 0, 0), Vec3(0.2, 0, 0)},
                           three = {Vec3(-0.1, 0, 0), Vec3(0.2, 0.1, 0), Vec3(0, 0, 0.3)};
        add({1, 1}, 100, Vec3(0.9, 1, 1.1), pair);  // heavier than in the System
        add({1, 1}, 1, Vec3(0.9, 1, 1.1), pair);    // lighter
        add({0, 0, 0}, 20, Vec3(1, 2, 3), three);   // without mass in the System
        add({1, 7, 2}, 10, Vec3(1, 2, 3), three);   // the same mass, its centre elsewhere
        add({5, 0, 3}, 8, Vec3(1, 2, 3), three);    // a marker without mass
        add({5, 0}, 5, Vec3(),
            {Vec3(), Vec3(0.2, 0, 0)});  // likewise, where only the marker can tell a spin
        add({3}, 4, Vec3(0.3, 0.4, 0.5), {Vec3()});                     // one site that rotates
        add({16, 1, 1}, 18, Vec3(), waterShape().sites);                // the System's masses
        add({2, 2}, 4, Vec3(), {Vec3(-0.1, 0, 0), Vec3(0.1, 0.1, 0)});  // two sites, likewise
        system.addParticle(7.0);
        system.addParticle(0.0);
        for (double y : {5.0, 6.0}) positions.push_back(Vec3(0, y, 0));
        if (frequency > 0) system.addForce(new CMMotionRemover(frequency));
        if (other) system.addForce(other);
        context = make_unique<Context>(system, integrator, testPlatform(),
                                       threads(testPlatformName(), 1));
        context->setPositions(positions);
        push();
    }
    /** Velocities with a momentum. */
    void push() {
        mt19937 generator(4);
        normal_distribution<double> normal(0.5, 1);
        vector<Vec3> v(masses.size()), omega, ofParticles(positions.size());
        for (Vec3& x : v) x = Vec3(normal(generator), normal(generator), normal(generator));
        omega = v;
        ofParticles[positions.size() - 2] = Vec3(-1, 2, 3);
        context->setVelocities(ofParticles);
        integrator.setBodyVelocities(v);
        integrator.setBodyAngularVelocities(omega);
    }
    Vec3 freeVelocity() { return velocitiesOf(*context)[positions.size() - 2]; }
    Vec3 momentum() {
        Vec3 p = freeVelocity() * 7.0;
        const auto v = integrator.getBodyVelocities();
        for (size_t b = 0; b < masses.size(); b++) p += v[b] * masses[b];
        return p;
    }
    double totalMass() const { return accumulate(masses.begin(), masses.end(), 7.0); }
};

}  // namespace

TEST(CMMotionRemover, RemovesTheMomentumOfBodiesWithMassesOfTheirOwn) {
    OddMasses removed(1), free(0);
    EXPECT_EQ(removed.integrator.getDegreesOfFreedom().at("removed"), 3);
    EXPECT_EQ(free.integrator.getDegreesOfFreedom().at("removed"), 0);
    const double mass = free.totalMass();
    const Vec3 drift = free.momentum() / mass;
    EXPECT_GT(norm(drift), 0.5);
    for (int steps : {1, 4}) {
        for (OddMasses* scene : {&removed, &free}) scene->integrator.step(steps);
        EXPECT_LT(norm(removed.momentum()), readTolerance(1e-12, 3) * mass);
        // All velocities are changed by the same vector. So neither the rotation nor its fit to the
        // particles' velocities is changed.
        const auto v = removed.integrator.getBodyVelocities(),
                   v0 = free.integrator.getBodyVelocities(),
                   omega = removed.integrator.getBodyAngularVelocities(),
                   omega0 = free.integrator.getBodyAngularVelocities();
        for (size_t b = 0; b < v.size(); b++) {
            EXPECT_LT(norm(v[b] - v0[b] + drift), readTolerance(1e-12, 3)) << "body " << b;
            EXPECT_LT(norm(omega[b] - omega0[b]), readTolerance(1e-11, 3)) << "body " << b;
        }
        EXPECT_LT(norm(removed.freeVelocity() - free.freeVelocity() + drift),
                  readTolerance(1e-12, 3));
    }
    EXPECT_NE(
        removed.integrator.getEffects().at("centre-of-mass motion removal").find("bodies' own"),
        string::npos);
}

TEST(CMMotionRemover, ActsWhenItIsDue) {
    OddMasses scene(3);
    const double mass = scene.totalMass();
    const Vec3 pushed = scene.momentum();
    for (int step = 0; step < 7; step++) {
        scene.push();
        scene.integrator.step(1);
        EXPECT_LT(norm(scene.momentum() - (step % 3 == 0 ? Vec3() : pushed)),
                  readTolerance(1e-12, 3) * mass)
            << "step " << step;
    }
}

TEST(CMMotionRemover, WhatAnotherForceDoesToVelocitiesIsNotTakenForTheRemovers) {
    const int water = 7, freeParticle = 21;
    const Vec3 kick(1, -2, 3);
    OddMasses scene(1, new Kick(freeParticle, kick));
    const Vec3 before = scene.freeVelocity() - scene.integrator.getBodyVelocities()[water];
    scene.integrator.step(1);
    EXPECT_LT(
        norm(scene.freeVelocity() - scene.integrator.getBodyVelocities()[water] - before - kick),
        readTolerance(1e-12, 5));
    EXPECT_LT(norm(scene.momentum()), readTolerance(1e-12, 3) * scene.totalMass());
}

TEST(CMMotionRemover, EquipartitionOfTwoBodies) {
    // Bodies have masses of 100 and 1 Da, where the System has masses of 1 Da. Along each axis the
    // relative velocity has the exact variance kT/mu. The velocity of the centre of mass has only
    // the noise of the step after the removal: kT (1 - exp(-2 gamma h))/M.
    System system;
    const double gamma = 20, h = 0.002, kT = boltzmann * 300, masses[] = {100, 1};
    CustomRigidHIIntegrator integrator(300, h);
    for (int b = 0; b < 2; b++) {
        for (int i = 0; i < 2; i++) system.addParticle(1.0);
        integrator.addRigidBody({2 * b, 2 * b + 1}, masses[b], Vec3(1, 1, 1),
                                {Vec3(-0.1, 0, 0), Vec3(0.1, 0, 0)});
    }
    integrator.setFriction(gamma);
    integrator.setRotationalFriction(gamma);
    integrator.setRandomNumberSeed(5);
    system.addForce(new CMMotionRemover());
    Context context(system, integrator, testPlatform(), threads(testPlatformName(), 1));
    context.setPositions({Vec3(-0.1, 0, 0), Vec3(0.1, 0, 0), Vec3(-0.1, 1, 0), Vec3(0.1, 1, 0)});
    const int samples = onCpu() ? 200 : 1000,
              interval =
                  40;  // exp(-40 gamma h) = 0.2: their squares are independent within 4 per cent
    vector<double> relative[3], centre[3];
    for (int s = 0; s < samples; s++) {
        integrator.step(interval);
        const auto v = integrator.getBodyVelocities();
        const Vec3 w = v[0] - v[1], V = (v[0] * 100 + v[1]) / 101;
        for (int k = 0; k < 3; k++) {
            relative[k].push_back(100.0 / 101 * w[k] * w[k] / kT);
            centre[k].push_back(101 * V[k] * V[k] / kT);
        }
    }
    for (int k = 0; k < 3; k++) {
        expectMean("relative motion, axis " + to_string(k), estimate(relative[k]), 1);
        expectMean("centre of mass, axis " + to_string(k), estimate(centre[k]),
                   -expm1(-2 * gamma * h));
    }
}
