// LangevinHI without matrices agrees with the dense solver to the solver's tolerance.

#include <sstream>

#include "TestSupport.h"
#include "openmmrigidhi/MobilityForce.h"

using namespace OpenMM;
using namespace RigidHITest;
using namespace std;
using RigidHIPlugin::MobilityForce;

namespace {

enum class Scene { Spheres, Multiblobs, Mixture, Rods, OwnTensors };

/** Eight bodies on a loose lattice, unequal blobs, and a free particle. */
class FluidScene {
public:
    FluidScene(Scene kind, MobilityForce::Solver solver, double tolerance, double temperature,
               double h)
        : integrator(temperature, h), force(new MobilityForce()) {
        mt19937 generator(11);
        uniform_real_distribution<double> uniform(-1, 1);
        vector<Vec3> positions;
        force->setViscosity(1 / (4 * M_PI));
        force->setSolver(solver);
        force->setSolverTolerance(tolerance);
        for (int b = 0; b < 8; b++) {
            vector<Vec3> sites = {Vec3()};
            Vec3 moments(0.4, 0.4, 0.4);
            if (kind == Scene::Rods) {
                sites = {Vec3(-1.6, 0, 0), Vec3(-0.5, 0, 0), Vec3(0.6, 0, 0), Vec3(1.5, 0, 0)};
                moments = Vec3(0, 2, 2);
            } else if (kind == Scene::Multiblobs || (kind == Scene::Mixture && b % 2 == 0)) {
                sites.clear();
                for (int i = 0; i < 7; i++)
                    sites.push_back(
                        Vec3(uniform(generator), uniform(generator), uniform(generator)) * 1.5);
                moments = Vec3(2.5, 2, 3);
            }
            vector<int> particles;
            const Vec3 centre(5.0 * (b % 2), 5.0 * (b / 2 % 2), 5.0 * (b / 4));
            const QuaternionArray q = randomQuaternion(generator);
            for (const Vec3& site : sites) {
                particles.push_back(system.addParticle(1));
                force->addParticle(sites.size() > 1 ? 0.5 + 0.05 * particles.size() : 1.0);
                positions.push_back(centre + rotate(q, site));
            }
            integrator.addRigidBody(particles, 2, moments, sites);
            if (kind == Scene::OwnTensors) {
                vector<double> tensor(36, 0.0);
                for (int k = 0; k < 6; k++) tensor[7 * k] = k < 3 ? 0.4 + 0.1 * k : 0.3 + 0.05 * k;
                tensor[3] = tensor[18] = 0.05;
                force->setBodyMobility(b, tensor);
            }
        }
        system.addParticle(3);
        force->addParticle(0.7);
        positions.push_back(Vec3(2.5, 2.5, 2.5));
        system.addForce(force);
        integrator.setScheme(CustomRigidHIIntegrator::LangevinHI);
        integrator.setRandomNumberSeed(5);
        context = make_unique<Context>(system, integrator, testPlatform(),
                                       threads(testPlatformName(), 2));
        context->setPositions(positions);
        context->setVelocitiesToTemperature(1 / boltzmann, 3);
    }
    /** Mass-weighted momenta. Angular momenta are in the lab frame, where the rotation after the
     * fluid's part of the step does not change them. */
    vector<double> Z() {
        vector<double> result;
        const vector<Vec3> v = integrator.getBodyVelocities(),
                           w = integrator.getBodyAngularVelocities();
        const vector<QuaternionArray> q = integrator.getBodyOrientations();
        for (size_t b = 0; b < v.size(); b++) {
            vector<int> particles;
            double mass;
            Vec3 moments;
            vector<Vec3> sites;
            integrator.getRigidBodyParameters(b, particles, mass, moments, sites);
            Vec3 L;
            for (int k = 0; k < 3; k++) {
                const Vec3 axis = rotate(q[b], Vec3(k == 0, k == 1, k == 2));
                L += axis * (moments[k] * axis.dot(w[b]));
            }
            for (int k = 0; k < 3; k++) {
                result.push_back(sqrt(mass) * v[b][k]);
                result.push_back(L[k] / sqrt(moments[1]));
            }
        }
        const Vec3 free = velocitiesOf(*context).back();
        for (int k = 0; k < 3; k++) result.push_back(sqrt(3.0) * free[k]);
        return result;
    }
    System system;
    CustomRigidHIIntegrator integrator;
    MobilityForce* force;
    unique_ptr<Context> context;
};

double difference(const vector<double>& a, const vector<double>& b) {
    double square = 0, scale = 0;
    for (size_t i = 0; i < a.size(); i++) {
        square += (a[i] - b[i]) * (a[i] - b[i]);
        scale += b[i] * b[i];
    }
    return sqrt(square / scale);
}

const vector<Scene> scenes = {Scene::Spheres, Scene::Multiblobs, Scene::Mixture, Scene::Rods,
                              Scene::OwnTensors};

}  // namespace

TEST(MatrixFree, OneStepAgreesWithTheDenseOneToFiveTolerances) {
    for (Scene kind : scenes)
        for (double T : {0.0, 1 / boltzmann})
            for (double h : {1e-6, 0.05, 20.0}) {
                FluidScene dense(kind, MobilityForce::Dense, 1e-6, T, h);
                dense.integrator.step(1);
                for (double tolerance : {1e-2, 1e-4, 1e-8}) {
                    FluidScene krylov(kind, MobilityForce::MatrixFree, tolerance, T, h);
                    krylov.integrator.step(1);
                    EXPECT_LT(difference(krylov.Z(), dense.Z()), 5 * tolerance)
                        << "scene " << (int)kind << " T " << T << " h " << h << " tolerance "
                        << tolerance;
                    EXPECT_GT(krylov.integrator.getStepStatistics()["solverIterations"], 0);
                }
            }
}

TEST(MatrixFree, WeakFrictionIsAccurateItself) {
    // The change by the fluid in a short step is far below the momenta. It must be accurate
    // relative to itself, or a long run at a coarse tolerance would have another temperature.
    const double h = 1e-6, tolerance = 1e-4;
    for (Scene kind : scenes) {
        FluidScene dense(kind, MobilityForce::Dense, 1e-6, 0, h),
            krylov(kind, MobilityForce::MatrixFree, tolerance, 0, h);
        const vector<double> before = dense.Z();
        dense.integrator.step(1);
        krylov.integrator.step(1);
        vector<double> a = krylov.Z(), b = dense.Z();
        for (size_t i = 0; i < before.size(); i++) {
            a[i] -= before[i];
            b[i] -= before[i];
        }
        EXPECT_LT(difference(a, b), 5 * tolerance) << "scene " << (int)kind;
    }
}

TEST(MatrixFree, ResumeAndThreadsChangeNothing) {
    for (Scene kind : scenes) {
        FluidScene whole(kind, MobilityForce::MatrixFree, 1e-3, 1 / boltzmann, 0.05);
        whole.integrator.step(3);
        stringstream saved;
        whole.context->createCheckpoint(saved);
        whole.integrator.step(3);
        FluidScene resumed(kind, MobilityForce::MatrixFree, 1e-3, 1 / boltzmann, 0.05);
        resumed.context->loadCheckpoint(saved);
        resumed.integrator.step(3);
        EXPECT_TRUE(sameBits(positionsOf(*whole.context), positionsOf(*resumed.context)))
            << "scene " << (int)kind;
        EXPECT_TRUE(sameBits(velocitiesOf(*whole.context), velocitiesOf(*resumed.context)))
            << "scene " << (int)kind;
    }
}

TEST(MatrixFree, WhatHasNoProductsIsRefused) {
    System system;
    CustomRigidHIIntegrator integrator(300, 0.001);
    auto* force = new MobilityForce();
    for (int i = 0; i < 2; i++) {
        integrator.addRigidBody({system.addParticle(1)}, 1, Vec3(1, 1, 1), {Vec3()});
        force->addParticle(0.1);
    }
    force->setModel(MobilityForce::StokesianDynamics);
    force->setSolver(MobilityForce::MatrixFree);
    system.addForce(force);
    integrator.setScheme(CustomRigidHIIntegrator::LangevinHI);
    expectError([&] { Context context(system, integrator, testPlatform()); },
                {"solver MatrixFree", "setSolver(Dense)"});
}

TEST(MatrixFree, BlobsAtOnePlaceAreNamed) {
    for (auto solver : {MobilityForce::MatrixFree, MobilityForce::Dense}) {
        System system;
        CustomRigidHIIntegrator integrator(300, 0.001);
        auto* force = new MobilityForce();
        vector<Vec3> positions;
        for (int b = 0; b < 2; b++) {
            vector<int> particles;
            vector<Vec3> sites = {Vec3(-1, 0, 0), Vec3(1, 0, 0), Vec3(0, 1, 0), Vec3(0, 1, 0)};
            for (const Vec3& site : sites) {
                particles.push_back(system.addParticle(1));
                force->addParticle(0.1);
                positions.push_back(site + Vec3(0, 0, 5 * b));
            }
            integrator.addRigidBody(particles, 1, Vec3(1, 1, 1), sites);
        }
        force->setSolver(solver);
        system.addForce(force);
        integrator.setScheme(CustomRigidHIIntegrator::LangevinHI);
        expectError(
            [&] {
                Context context(system, integrator, testPlatform());
                context.setPositions(positions);
                integrator.step(1);
            },
            {"particle 2 (body 0) and particle 3 (body 0)", "at the same place"});
    }
}
