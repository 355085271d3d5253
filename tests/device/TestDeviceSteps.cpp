// Bodies that move on the device. Without forces a run agrees with the run on Reference to
// rounding, for every scheme, kind of body, noise law and precision of the platform, so the tests
// need no statistics.

#include <openmm/CMMotionRemover.h>
#include <openmm/CustomBondForce.h>
#include <openmm/CustomCVForce.h>
#include <openmm/CustomExternalForce.h>
#include <openmm/MonteCarloAnisotropicBarostat.h>
#include <openmm/MonteCarloBarostat.h>
#include <openmm/MonteCarloMembraneBarostat.h>
#include <openmm/NonbondedForce.h>
#include <openmm/VirtualSite.h>
#include <openmm/internal/ForceImpl.h>
#include <openmm/serialization/XmlSerializer.h>

#include <memory>
#include <sstream>

#include "TestSupport.h"
#include "WaterBoxSupport.h"
#include "openmmrigidhi/CustomBodyForce.h"
#include "openmmrigidhi/CustomBodyMotion.h"
#include "openmmrigidhi/MobilityForce.h"

using namespace OpenMM;
using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace std;

namespace {

const char* const key = "bodies on the device";

bool areOnTheDevice(const CustomRigidHIIntegrator& integrator) {
    return integrator.getEffects().at(key).substr(0, 3) == "on:";
}

/** Bodies of every kind with shapes that are given, and free particles, in a triclinic box. */
struct Bodies {
    System system;
    CustomRigidHIIntegrator integrator;
    vector<Vec3> positions;
    unique_ptr<Context> context;
    int numBodies = 0, firstFree = 0;

    /**
     * @param epsilon  of a Lennard-Jones force between all particles; its cutoff makes OpenMM sort
     *     particles
     * @param count    of bodies; more than 27 overlap
     */
    explicit Bodies(double epsilon = 0, double h = 0.002, double length = 2.4, int count = 24)
        : integrator(300, h) {
        auto* nonbonded = new NonbondedForce();
        nonbonded->setNonbondedMethod(NonbondedForce::CutoffPeriodic);
        nonbonded->setCutoffDistance(0.9);
        const vector<Shape> shapes = {
            {"water", {16, 1, 1}, {Vec3(0, -0.006, 0), Vec3(0.08, 0.05, 0), Vec3(-0.08, 0.05, 0)}},
            {"rod", {12, 16}, {Vec3(0.06, 0, 0), Vec3(-0.05, 0, 0)}},
            {"point", {40}, {Vec3()}}};
        for (int i = 0; i < count; i++) {
            const Shape& shape = shapes[i % 3];
            vector<int> particles;
            const Vec3 origin(0.3 + length / 3 * (i % 3), 0.2 + length / 3 * (i / 3 % 3),
                              0.1 + length / 3 * (i / 9));
            for (size_t s = 0; s < shape.sites.size(); s++) {
                particles.push_back(system.addParticle(shape.masses[s]));
                positions.push_back(origin + shape.sites[s]);
                nonbonded->addParticle(0, epsilon == 0 ? 0 : 0.25, epsilon);
                for (size_t t = 0; t < s; t++) {
                    nonbonded->addException(particles[s], particles[t], 0, 1, 0);
                    system.addConstraint(particles[s], particles[t],
                                         norm(shape.sites[s] - shape.sites[t]));
                }
            }
            const Vec3 moments = i % 3 == 0   ? Vec3(0.006, 0.013, 0.019)
                                 : i % 3 == 1 ? Vec3(0, 0.08, 0.08)
                                              : Vec3();
            integrator.addRigidBody(particles,
                                    i % 3 == 0   ? 18
                                    : i % 3 == 1 ? 28
                                                 : 40,
                                    moments, shape.sites);
            numBodies++;
        }
        firstFree = system.getNumParticles();
        for (int i = 0; i < 5; i++) {
            system.addParticle(23);
            nonbonded->addParticle(0, epsilon == 0 ? 0 : 0.25, epsilon);
            positions.push_back(Vec3(0.7 + 0.35 * i, 0.55, 0.5));
        }
        system.addForce(nonbonded);
        system.setDefaultPeriodicBoxVectors(Vec3(length, 0, 0), Vec3(0.3, length, 0),
                                            Vec3(-0.4, 0.5, length));
        integrator.setFriction(5);
        integrator.setRotationalFriction(20);
        integrator.setRandomNumberSeed(11);
    }
    void start(const string& platformName, const map<string, string>& properties = {}) {
        context = make_unique<Context>(system, integrator, platform(platformName), properties);
        context->setPositions(positions);
        // The Context rounds positions, and the setters of bodies do not.
        mt19937 generator(5);
        normal_distribution<double> normal;
        vector<Vec3> R, v, omega;
        vector<QuaternionArray> q;
        int p = 0;
        for (int b = 0; b < numBodies; b++) {
            // Water's first site is not at the origin.
            R.push_back(positions[p] - (b % 3 == 0   ? Vec3(0, -0.006, 0)
                                        : b % 3 == 1 ? Vec3(0.06, 0, 0)
                                                     : Vec3()));
            p += b % 3 == 0 ? 3 : b % 3 == 1 ? 2 : 1;
            q.push_back(randomQuaternion(generator));
            v.push_back(Vec3(normal(generator), normal(generator), normal(generator)) * 0.4);
            omega.push_back(Vec3(normal(generator), normal(generator), normal(generator)) * 10);
        }
        integrator.setBodyPositions(R);
        integrator.setBodyOrientations(q);
        if (integrator.getScheme() == CustomRigidHIIntegrator::GradientThermostat) return;
        integrator.setBodyVelocities(v);
        integrator.setBodyAngularVelocities(omega);
    }
};

/** The largest difference of positions or orientations of bodies. */
double poseDifference(const CustomRigidHIIntegrator& a, const CustomRigidHIIntegrator& b) {
    double largest = 0;
    const auto Ra = a.getBodyPositions(), Rb = b.getBodyPositions();
    const auto qa = a.getBodyOrientations(), qb = b.getBodyOrientations();
    for (size_t i = 0; i < Ra.size(); i++) {
        largest = max(largest, norm(Ra[i] - Rb[i]));
        for (int k = 0; k < 4; k++) largest = max(largest, abs(qa[i][k] - qb[i][k]));
    }
    return largest;
}

}  // namespace

namespace {

/** Without forces, the device moves bodies and free particles as Reference does. */
void expectTheMovesOfReference(CustomRigidHIIntegrator::Scheme scheme,
                               CustomRigidHIIntegrator::NoiseLaw law, double inertiaScale,
                               int steps) {
    SCOPED_TRACE("scheme " + to_string(scheme) + ", law " + to_string(law) + ", inertia times " +
                 to_string(inertiaScale));
    Bodies device, host;
    for (Bodies* each : {&device, &host}) {
        each->integrator.setScheme(scheme);
        each->integrator.setNoiseLaw(law);
        each->integrator.setInertiaScale(inertiaScale);
    }
    device.start(testPlatformName());
    host.start("Reference");
    device.integrator.step(steps);
    host.integrator.step(steps);
    ASSERT_TRUE(areOnTheDevice(device.integrator)) << device.integrator.getEffects().at(key);
    // Rounding adds up along a path of some nm. Angles of fast rotors grow with time.
    EXPECT_LT(poseDifference(device.integrator, host.integrator), 1e-13);
    // Positions of free particles are set through the Context, which rounds them.
    const auto x = positionsOf(*device.context), y = positionsOf(*host.context);
    for (size_t p = device.firstFree; p < x.size(); p++)
        EXPECT_LT(norm(x[p] - y[p]), readTolerance(1e-12, 4));
    // Particles have the velocities of their bodies.
    const auto a = velocitiesOf(*device.context), b = velocitiesOf(*host.context);
    for (int p = 0; p < device.firstFree; p++)
        EXPECT_LT(norm(a[p] - b[p]), readTolerance(1e-11, 5)) << "particle " << p;
    EXPECT_EQ(device.integrator.getStepStatistics().at("randomNumbers"),
              host.integrator.getStepStatistics().at("randomNumbers"));
    EXPECT_EQ(device.context->getStepCount(), steps);
    EXPECT_NEAR(device.context->getState(0).getTime(), 0.002 * steps, 1e-9);
}

}  // namespace

TEST(DeviceSteps, WithoutForcesPosesAndFreeParticlesAreThoseOfReference) {
    for (auto scheme : thermostats())
        expectTheMovesOfReference(scheme, CustomRigidHIIntegrator::Gaussian,
                                  scheme == CustomRigidHIIntegrator::LangevinC ? 4 : 1, 300);
    for (auto law : {CustomRigidHIIntegrator::ThreePoint, CustomRigidHIIntegrator::TwoPoint})
        expectTheMovesOfReference(CustomRigidHIIntegrator::LangevinB, law, 1, 300);
}

// Where the fluid couples nothing, the friction of each body is its own tensor.
TEST(DeviceSteps, LangevinHIWithoutCouplingMovesBodiesAsOnReference) {
    Bodies device, host;
    for (Bodies* each : {&device, &host}) {
        each->integrator.setScheme(CustomRigidHIIntegrator::LangevinHI);
        auto* fluid = new MobilityForce();
        fluid->setModel(MobilityForce::FreeDraining);
        for (int p = 0; p < each->system.getNumParticles(); p++)
            fluid->addParticle(p < each->firstFree ? 0 : 0.02);
        // Isotropic in translation, diagonal in rotation, without coupling.
        vector<double> friction(36);
        for (int k = 0; k < 6; k++) friction[7 * k] = k < 3 ? 200 : 0.1 * k;
        for (int b = 0; b < each->numBodies; b++) fluid->setBodyFriction(b, friction);
        each->system.addForce(fluid);
    }
    device.start(testPlatformName());
    host.start("Reference");
    device.integrator.step(300);
    host.integrator.step(300);
    ASSERT_TRUE(areOnTheDevice(device.integrator)) << device.integrator.getEffects().at(key);
    EXPECT_LT(poseDifference(device.integrator, host.integrator), 1e-13);
}

TEST(DeviceSteps, FullEveryLawAndInertiaScaleMovesBodiesAsOnReference) {
    for (auto scheme : thermostats())
        for (auto law : {CustomRigidHIIntegrator::Gaussian, CustomRigidHIIntegrator::ThreePoint,
                         CustomRigidHIIntegrator::TwoPoint})
            for (double scale : {1.0, 4.0}) expectTheMovesOfReference(scheme, law, scale, 1000);
}

/** Molecules of free particles with constraints, beside the bodies. */
struct Molecules : Bodies {
    vector<pair<int, int>> constraints;
    explicit Molecules(double tolerance) {
        integrator.setConstraintTolerance(tolerance);
        auto& nonbonded = dynamic_cast<NonbondedForce&>(system.getForce(0));
        const auto add = [&](const vector<double>& masses, const vector<Vec3>& places,
                             const vector<pair<int, int>>& bonds) {
            const int first = system.getNumParticles();
            for (size_t i = 0; i < masses.size(); i++) {
                system.addParticle(masses[i]);
                nonbonded.addParticle(0, 0, 0);
                positions.push_back(places[i]);
            }
            for (auto [i, j] : bonds) {
                system.addConstraint(first + i, first + j, norm(places[i] - places[j]));
                constraints.emplace_back(first + i, first + j);
            }
        };
        // OpenMM takes SETTLE for a triangle, SHAKE for a star and CCMA for a chain.
        add({16, 1, 1}, {Vec3(1, 1, 0), Vec3(1.08, 1.05, 0), Vec3(0.92, 1.05, 0)},
            {{0, 1}, {0, 2}, {1, 2}});
        add({12, 1, 1, 1}, {Vec3(1, 1, 1), Vec3(1.1, 1, 1), Vec3(1, 1.1, 1), Vec3(1, 1, 1.1)},
            {{0, 1}, {0, 2}, {0, 3}});
        add({12, 12, 12, 12},
            {Vec3(0, 1, 1), Vec3(0.15, 1, 1), Vec3(0.2, 1.14, 1), Vec3(0.35, 1.14, 1)},
            {{0, 1}, {1, 2}, {2, 3}});
    }
};

TEST(DeviceSteps, FreeParticlesWithConstraintsMoveAsOnReference) {
    const int steps = 200;
    const bool single = testPrecision() == "single";
    const double tolerance = single ? 1e-6 : 1e-10;
    for (auto scheme : {CustomRigidHIIntegrator::LangevinA, CustomRigidHIIntegrator::LangevinB,
                        CustomRigidHIIntegrator::LangevinC}) {
        Molecules device(tolerance), host(1e-10);
        for (Bodies* each : {static_cast<Bodies*>(&device), static_cast<Bodies*>(&host)}) {
            each->integrator.setScheme(scheme);
            each->start(each == &device ? testPlatformName() : "Reference");
            each->integrator.step(steps);
        }
        ASSERT_TRUE(areOnTheDevice(device.integrator)) << device.integrator.getEffects().at(key);
        EXPECT_LT(poseDifference(device.integrator, host.integrator), 1e-13);
        // Each drift has an error of the tolerance times a distance, which also changes the
        // velocity: over the step, and until friction has damped it.
        const double ofDrift = tolerance * 0.2,
                     most = steps * ofDrift * (1 + 1 / (5 * 0.002)) + readTolerance(1e-12, 4);
        const auto x = positionsOf(*device.context), y = positionsOf(*host.context);
        double largest = 0;
        for (size_t p = device.firstFree; p < x.size(); p++)
            largest = max(largest, norm(x[p] - y[p]));
        EXPECT_LT(largest, most);
        printf("scheme %d: free particles within %.1e nm (at most %.1e)\n", scheme, largest, most);
        // OpenMM keeps squares of lengths as floats on devices.
        for (auto [i, j] : device.constraints)
            EXPECT_NEAR(norm(x[i] - x[j]), norm(device.positions[i] - device.positions[j]),
                        0.2 * (tolerance + pow(2, -24)) + readTolerance(0, 4));
        EXPECT_EQ(device.integrator.getStepStatistics().at("randomNumbers"),
                  host.integrator.getStepStatistics().at("randomNumbers"));
    }
}

TEST(DeviceSteps, HeldBodiesAndParticlesStay) {
    for (double epsilon : {0.0, 0.5}) {
        Bodies device(epsilon), host(epsilon);
        const vector<int> bodies = {0, 3, 7, 11};
        const vector<int> particles = {device.firstFree, device.firstFree + 3};
        vector<Vec3> R, x;
        for (Bodies* each : {&device, &host}) {
            each->start(each == &device ? testPlatformName() : "Reference");
            each->integrator.step(1);
            for (int b : bodies) each->integrator.setBodyHeld(b, true);
            for (int p : particles) each->integrator.setParticleHeld(p, true);
            each->integrator.step(1);
            if (each == &device) {
                R = device.integrator.getBodyPositions();
                x = positionsOf(*device.context);
            }
            each->integrator.step(100);
        }
        ASSERT_TRUE(areOnTheDevice(device.integrator)) << device.integrator.getEffects().at(key);
        const auto now = device.integrator.getBodyPositions(),
                   V = device.integrator.getBodyVelocities();
        for (int b : bodies) {
            EXPECT_EQ(now[b], R[b]);
            EXPECT_EQ(V[b], Vec3());
        }
        const auto after = positionsOf(*device.context), v = velocitiesOf(*device.context),
                   expected = positionsOf(*host.context);
        for (int p : particles) {
            EXPECT_EQ(after[p], x[p]);
            EXPECT_EQ(v[p], Vec3());
        }
        // With forces the two runs differ by errors of OpenMM's forces.
        const double close = epsilon == 0 ? 1e-13 : testPrecision() == "double" ? 1e-6 : 1e-4;
        EXPECT_LT(poseDifference(device.integrator, host.integrator), close);
        for (size_t p = device.firstFree; p < after.size(); p++)
            EXPECT_LT(norm(after[p] - expected[p]), max(close, readTolerance(1e-12, 4)));
        // They move again when they are let go.
        for (int b : bodies) device.integrator.setBodyHeld(b, false);
        for (int p : particles) device.integrator.setParticleHeld(p, false);
        device.integrator.step(100);
        ASSERT_TRUE(areOnTheDevice(device.integrator));
        for (int b : bodies)
            EXPECT_GT(norm(device.integrator.getBodyPositions()[b] - now[b]), 1e-4);
    }
}

// Forces on virtual sites, in bodies and between free particles, act on their parents.
TEST(DeviceSteps, ForcesOnVirtualSitesActAsOnReference) {
    struct Sites {
        System system;
        CustomRigidHIIntegrator integrator{0, 0.002};
        vector<Vec3> positions;
        unique_ptr<Context> context;
        int firstFree = 0;
        explicit Sites(const string& platformName) {
            vector<Vec3> water = {Vec3(0, -0.006, 0), Vec3(0.08, 0.05, 0), Vec3(-0.08, 0.05, 0)};
            water.push_back(0.8 * water[0] + 0.15 * water[1] + 0.05 * water[2]);
            const Vec3 a = water[1] - water[0], b = water[2] - water[0];
            water.push_back(water[0] + 0.2 * a + 0.3 * b + 4 * a.cross(b));
            vector<Vec3> rod = {Vec3(0.06, 0, 0), Vec3(-0.05, 0, 0)};
            rod.push_back(0.7 * rod[0] + 0.3 * rod[1]);
            auto* field = new CustomExternalForce("fx*x + fy*y + fz*z");
            for (const char* f : {"fx", "fy", "fz"}) field->addPerParticleParameter(f);
            for (int i = 0; i < 9; i++) {
                const bool isWater = i % 3 != 2;
                const vector<Vec3>& sites = isWater ? water : rod;
                vector<int> particles;
                for (const Vec3& site : sites) {
                    particles.push_back(system.addParticle(site == sites[0] ? 16
                                                           : particles.size() < (isWater ? 3 : 2)
                                                               ? 1
                                                               : 0));
                    positions.push_back(Vec3(0.5 * i, 0, 0) + site);
                }
                const int p = particles[0];
                if (isWater) {
                    system.setVirtualSite(
                        p + 3, new ThreeParticleAverageSite(p, p + 1, p + 2, 0.8, 0.15, 0.05));
                    system.setVirtualSite(p + 4, new OutOfPlaneSite(p, p + 1, p + 2, 0.2, 0.3, 4));
                    field->addParticle(p + 4, vector<double>{1, -2, 0.5});
                    field->addParticle(p + 3, vector<double>{-4, 1, 2});
                } else {
                    system.setVirtualSite(p + 2, new TwoParticleAverageSite(p, p + 1, 0.7, 0.3));
                    field->addParticle(p + 2, vector<double>{0.5, 3, -1});
                }
                field->addParticle(p, vector<double>{1, 1, -1});
                integrator.addRigidBody(particles, 18,
                                        isWater ? Vec3(0.006, 0.013, 0.019) : Vec3(0, 0.08, 0.08),
                                        sites);
            }
            firstFree = system.getNumParticles();
            for (int i = 0; i < 4; i++) {
                const int p = system.addParticle(23);
                system.addParticle(11);
                system.addParticle(0);
                system.setVirtualSite(p + 2, new TwoParticleAverageSite(p, p + 1, 0.25, 0.75));
                const Vec3 first(0.5 * i, 1, 0), second(0.5 * i, 1.2, 0.1);
                positions.insert(positions.end(), {first, second, 0.25 * first + 0.75 * second});
                field->addParticle(p + 2, vector<double>{2, -1, 4});
                if (i % 2) system.addConstraint(p, p + 1, norm(first - second));
            }
            system.addForce(field);
            integrator.setFriction(0);
            integrator.setRotationalFriction(0);
            integrator.setConstraintTolerance(testPrecision() == "single" ? 1e-6 : 1e-10);
            context = make_unique<Context>(system, integrator, platform(platformName));
            context->setPositions(positions);
            vector<Vec3> R;
            for (int i = 0; i < 9; i++) R.push_back(Vec3(0.5 * i, 0, 0));
            integrator.setBodyPositions(R);
            integrator.setBodyOrientations(vector<QuaternionArray>(9, {1, 0, 0, 0}));
            integrator.step(50);
        }
    };
    const Sites device(testPlatformName()), host("Reference");
    ASSERT_TRUE(areOnTheDevice(device.integrator)) << device.integrator.getEffects().at(key);
    // OpenMM hands forces on by factors of the platform's precision, in fixed point. Over 0.1 ps
    // such an error moves and turns a body by its share of the motion.
    const double force = 10, arm = 0.1, moment = 0.006, time = 0.1,
                 error = testPrecision() == "double" ? 8 * pow(2, -32) : 8 * pow(2, -24) * force,
                 close = error * (1.0 + arm / moment) * time * time / 2;
    const double found = poseDifference(device.integrator, host.integrator);
    printf("poses within %.1e (at most %.1e)\n", found, close);
    EXPECT_LT(found, close);
    EXPECT_GT(norm(host.integrator.getBodyPositions()[0]), 1e-4);
    const auto x = positionsOf(*device.context), y = positionsOf(*host.context);
    for (size_t p = 0; p < x.size(); p++)
        EXPECT_LT(norm(x[p] - y[p]), close + readTolerance(1e-8, 4)) << "particle " << p;
}

// OpenMM sorts particles and wraps them into the box every 250 steps, while bodies leave the box.
TEST(DeviceSteps, SortingAndImagesChangeNothing) {
    Bodies device, host;
    for (Bodies* each : {&device, &host}) each->integrator.setFriction(0);
    device.start(testPlatformName());
    host.start("Reference");
    for (Bodies* each : {&device, &host}) {
        vector<Vec3> v(each->numBodies);
        for (int b = 0; b < each->numBodies; b++)
            v[b] = Vec3(3, -2, 1) * (b % 5) + Vec3(0.013, 0.017, -0.011) * b;
        each->integrator.setBodyVelocities(v);
        each->integrator.step(1200);
    }
    ASSERT_TRUE(areOnTheDevice(device.integrator));
    EXPECT_LT(poseDifference(device.integrator, host.integrator), 1e-12);  // after up to 36 nm
    const auto a = positionsOf(*device.context), b = positionsOf(*host.context);
    for (int p = 0; p < device.firstFree; p++)
        EXPECT_LT(norm(a[p] - b[p]), readTolerance(1e-12, 40));
}

TEST(DeviceSteps, TransferNothingInSteps) {
    for (bool removes : {false, true}) {
        Bodies device(0.5);
        if (removes) device.system.addForce(new CMMotionRemover(3));
        device.start(testPlatformName());
        device.integrator.step(10);
        map<string, double> last = device.integrator.getStepStatistics();
        const auto spentIn = [&](int steps, int calls = 1) {
            for (int i = 0; i < calls; i++) device.integrator.step(steps);
            const auto now = device.integrator.getStepStatistics();
            map<string, double> spent;
            for (const auto& [name, value] : now) spent[name] = value - last.at(name);
            last = now;
            EXPECT_EQ(spent.at("steps"), steps * calls);
            return spent;
        };
        // The user has asked for statistics before and after: states go to the device and back, and
        // the host reads positions and velocities, which the user might have changed.
        EXPECT_EQ(spentIn(1).at("deviceTransfers"), 4);
        const auto spent = spentIn(1000);
        EXPECT_EQ(spent.at("deviceTransfers"), 4);
        // A flag every hundred steps, one at the start, and sums for the watch of temperatures.
        EXPECT_LE(spent.at("deviceLooks"), 25);
        // OpenMM's Verlet integrator has two kernels a step, and so have these; two more where
        // momentum is removed; and some for each sorting.
        EXPECT_LE(spent.at("deviceLaunches"), 2 * 1000 + (removes ? 2 * 334 : 0) + 50);
        // Steps one by one stay there, too.
        EXPECT_EQ(spentIn(1, 100).at("deviceTransfers"), 4);
    }
}

// Where the host moves bodies, each step sends positions and gets forces.
TEST(DeviceSteps, TransfersOfTheHostAreCounted) {
    setenv("RIGIDHI_BODIES_ON_HOST", "1", 1);
    Bodies host(0.5);
    host.start(testPlatformName());
    unsetenv("RIGIDHI_BODIES_ON_HOST");
    host.integrator.step(10);
    const double before = host.integrator.getStepStatistics().at("deviceTransfers");
    host.integrator.step(100);
    const double spent = host.integrator.getStepStatistics().at("deviceTransfers") - before;
    EXPECT_GE(spent, 2 * 100);
    EXPECT_LE(spent, 2 * 100 + 5);
}

TEST(DeviceSteps, StepsOneByOneAreTheSame) {
    vector<Vec3> ends[2];
    for (int chunk : {1, 60}) {
        Bodies device(0.5);
        device.start(testPlatformName());
        for (int i = 0; i < 60 / chunk; i++) device.integrator.step(chunk);
        ends[chunk == 1] = device.integrator.getBodyPositions();
    }
    EXPECT_TRUE(sameBits(ends[0], ends[1]));
}

TEST(DeviceSteps, ResumeBitForBitFromCheckpoints) {
    Bodies whole(0.5), first(0.5), second(0.5);
    whole.start(testPlatformName());
    first.start(testPlatformName());
    second.start(testPlatformName());
    whole.integrator.step(300);
    whole.integrator.step(300);
    first.integrator.step(300);
    stringstream checkpoint;
    first.context->createCheckpoint(checkpoint);
    second.integrator.step(7);
    second.context->loadCheckpoint(checkpoint);
    second.integrator.step(300);
    ASSERT_TRUE(areOnTheDevice(second.integrator));
    EXPECT_TRUE(
        sameBits(whole.integrator.getBodyPositions(), second.integrator.getBodyPositions()));
    EXPECT_TRUE(
        sameBits(whole.integrator.getBodyVelocities(), second.integrator.getBodyVelocities()));
}

TEST(DeviceSteps, StatesGoToAnotherPrecision) {
    Bodies first, second;
    first.start(testPlatformName());
    first.integrator.step(50);
    const State state = first.context->getState(State::Positions | State::Velocities |
                                                State::IntegratorParameters | State::Parameters);
    second.start(testPlatformName(),
                 {{"Precision", testPrecision() == "double" ? "single" : "double"}});
    second.context->setState(state);
    first.integrator.step(50);
    second.integrator.step(50);
    ASSERT_TRUE(areOnTheDevice(second.integrator));
    EXPECT_LT(poseDifference(first.integrator, second.integrator), 1e-13);
}

TEST(DeviceSteps, SettingsTakeEffectAtTheNextStep) {
    Bodies device, host;
    device.start(testPlatformName());
    host.start("Reference");
    for (Bodies* each : {&device, &host}) {
        each->integrator.step(20);
        each->integrator.setTemperature(100);
        each->integrator.step(20);
        each->integrator.setStepSize(0.001);
        each->integrator.setScheme(CustomRigidHIIntegrator::LangevinA);
        each->integrator.step(20);
        each->integrator.setBodyHeld(3, true);
        each->integrator.setBodyFriction(0, 100, 200);
        each->integrator.step(20);
        each->integrator.setBodyHeld(3, false);
        each->integrator.step(20);
    }
    ASSERT_TRUE(areOnTheDevice(device.integrator));
    EXPECT_LT(poseDifference(device.integrator, host.integrator), 1e-13);
}

TEST(DeviceSteps, ChangesByUsersAreTakenIn) {
    Bodies device, host;
    device.start(testPlatformName());
    host.start("Reference");
    for (Bodies* each : {&device, &host}) {
        each->integrator.step(20);
        // Bodies in the middle of a run, by the Context and by the integrator.
        auto R = each->integrator.getBodyPositions();
        for (Vec3& r : R) r += Vec3(0.1, -0.2, 0.3);
        each->integrator.setBodyPositions(R);
        each->integrator.step(20);
        auto v = each->integrator.getBodyVelocities();
        for (Vec3& u : v) u *= -0.5;
        each->integrator.setBodyVelocities(v);
        each->integrator.step(20);
    }
    EXPECT_LT(poseDifference(device.integrator, host.integrator), 1e-13);
    for (Bodies* each : {&device, &host}) {
        auto x = positionsOf(*each->context);
        for (Vec3& r : x) r += Vec3(0.05, 0, 0);
        each->context->setPositions(x);
        each->integrator.step(20);
        auto v = velocitiesOf(*each->context);
        for (Vec3& u : v) u *= 1.5;
        each->context->setVelocities(v);
        each->integrator.step(20);
    }
    ASSERT_TRUE(areOnTheDevice(device.integrator));
    // What goes through the Context has the platform's precision.
    EXPECT_LT(poseDifference(device.integrator, host.integrator), readTolerance(1e-12, 4) * 10);
    // A body that does not fit its shape any more is refused, as on the host.
    auto x = positionsOf(*device.context);
    x[0] += Vec3(0.1, 0, 0);
    device.context->setPositions(x);
    expectError([&] { device.integrator.step(5); }, {"body 0", "from its place in the body"});
}

// OpenMM does not tell the integrator that a user has applied constraints to the particles.
TEST(DeviceSteps, ConstraintsThatAUserAppliesAreTakenIn) {
    Bodies device;
    device.start(testPlatformName());
    device.integrator.step(20);
    auto q = device.integrator.getBodyOrientations();
    device.context->applyConstraints(1e-8);
    device.integrator.step(1);
    EXPECT_EQ(device.integrator.getEffects().at(key).substr(0, 3), "on:");
}

TEST(DeviceSteps, MomentumRemoversAct) {
    // The momentum of all bodies becomes 0, whatever their masses are, when the remover is due.
    for (int frequency : {1, 7}) {
        Bodies device, host;
        for (Bodies* each : {&device, &host}) {
            each->system.addForce(new CMMotionRemover(frequency));
            each->integrator.setFriction(0);
        }
        device.start(testPlatformName());
        host.start("Reference");
        device.integrator.step(50);
        host.integrator.step(50);
        ASSERT_TRUE(areOnTheDevice(device.integrator));
        EXPECT_LT(poseDifference(device.integrator, host.integrator), 1e-12);
    }
    // A remover acts once on free particles, too, whenever a run begins.
    vector<Vec3> ends[2];
    for (int chunk : {1, 20}) {
        Bodies device;
        device.system.addForce(new CMMotionRemover());
        device.start(testPlatformName());
        auto v = velocitiesOf(*device.context);
        for (size_t p = device.firstFree; p < v.size(); p++) v[p] = Vec3(3, 1, 2);
        device.context->setVelocities(v);
        for (int i = 0; i < 20 / chunk; i++) device.integrator.step(chunk);
        ends[chunk == 1] = positionsOf(*device.context);
    }
    EXPECT_TRUE(sameBits(ends[0], ends[1]));
    WaterBox box(3, 0.002, true);
    box.system.addForce(new CMMotionRemover());
    box.start();
    box.context->setVelocitiesToTemperature(300, 1);
    box.integrator.setFriction(0);
    box.integrator.setRotationalFriction(0);
    box.integrator.step(100);
    ASSERT_TRUE(areOnTheDevice(box.integrator)) << box.integrator.getEffects().at(key);
    Vec3 p;
    for (const Vec3& v : box.integrator.getBodyVelocities()) p += v;
    // The forces, in single precision, do not add up to 0 in the last step.
    EXPECT_LT(norm(p), testPrecision() == "double" ? 1e-6 : 1e-2);
}

TEST(DeviceSteps, BarostatsMoveWholeBodies) {
    const int interval = 6;
    const double kelvin = 20, bar = 30;
    auto* isotropic = new MonteCarloBarostat(bar, kelvin, interval);
    auto* anisotropic =
        new MonteCarloAnisotropicBarostat(Vec3(bar, bar, bar), kelvin, true, true, true, interval);
    auto* membrane =
        new MonteCarloMembraneBarostat(bar, 0, kelvin, MonteCarloMembraneBarostat::XYIsotropic,
                                       MonteCarloMembraneBarostat::ZFree, interval);
    isotropic->setRandomNumberSeed(4);
    anisotropic->setRandomNumberSeed(4);
    membrane->setRandomNumberSeed(4);
    for (Force* barostat : initializer_list<Force*>{isotropic, anisotropic, membrane}) {
        SCOPED_TRACE(barostat->getName());
        Bodies device(0.6, 0.002, 2.2);
        device.system.addForce(barostat);
        device.start(testPlatformName());
        int accepted = 0, kept = 0;
        vector<Vec3> last;
        double volume = device.context->getState(0).getPeriodicBoxVolume();
        for (int i = 0; i < 100; i++) {
            device.integrator.step(interval);
            const double now = device.context->getState(0).getPeriodicBoxVolume();
            (now != volume ? accepted : kept)++;
            volume = now;
            // The pose is that of the particles.
            const auto x = positionsOf(*device.context);
            const auto R = device.integrator.getBodyPositions();
            EXPECT_LT(norm(x[5] - R[2]), readTolerance(1e-12, 10));  // a point
            // OpenMM wraps particles into the box, but poses stay in their images.
            for (int b = 0; i > 0 && b < device.numBodies; b++)
                EXPECT_LT(norm(R[b] - last[b]), 0.5);
            last = R;
        }
        ASSERT_TRUE(areOnTheDevice(device.integrator));
        EXPECT_GT(accepted, 10);
        EXPECT_GT(kept, 2);
        const auto x = positionsOf(*device.context);
        EXPECT_NEAR(norm(x[1] - x[2]), 0.16, 1e-5);
    }
}

// A barostat asks for energies in the middle of a step.
TEST(DeviceSteps, BarostatsBringNoBodiesBack) {
    for (double pressure : {1.0, 1e5}) {
        Bodies device(0.5, 0.002, 2.4);
        device.system.addForce(new MonteCarloBarostat(pressure, 1e-3, 5));
        device.start(testPlatformName());
        device.integrator.step(10);
        const auto before = device.integrator.getStepStatistics();
        device.integrator.step(50);
        const auto after = device.integrator.getStepStatistics();
        // States, positions and velocities once, and images after each move that the barostat
        // tries.
        EXPECT_LE(after.at("deviceTransfers") - before.at("deviceTransfers"), 4 + 10);
        EXPECT_LE(after.at("forceEvaluations") - before.at("forceEvaluations"), 50 + 10);
    }
}

TEST(DeviceSteps, UsersSetStatesBesideABarostat) {
    Bodies device(0.5);
    device.system.addForce(new MonteCarloBarostat(1, 300, 1000));
    device.start(testPlatformName());
    device.integrator.step(5);
    const auto step = [&] {
        device.integrator.step(5);
        ASSERT_TRUE(areOnTheDevice(device.integrator));
        device.integrator.step(5);  // getEffects() has brought bodies back
    };
    const double close = readTolerance(1e-12, 10);
    const auto expectPositions = [&](const vector<Vec3>& x) {
        const auto found = positionsOf(*device.context);
        for (size_t p = 0; p < x.size(); p++) EXPECT_LT(norm(found[p] - x[p]), close);
        EXPECT_LT(norm(device.integrator.getBodyPositions()[2] - x[5]), close);  // a point
    };
    auto x = positionsOf(*device.context), v = velocitiesOf(*device.context);
    for (Vec3& r : x) r += Vec3(0.05, 0.02, -0.03);
    step();
    device.context->setPositions(x);
    expectPositions(x);
    step();
    for (Vec3& u : v) u *= 2;
    device.context->setVelocities(v);
    const auto found = velocitiesOf(*device.context);
    for (size_t p = 0; p < v.size(); p++) EXPECT_LT(norm(found[p] - v[p]), close);
    EXPECT_LT(norm(device.integrator.getBodyVelocities()[2] - v[5]), close);

    step();
    stringstream checkpoint;
    device.context->createCheckpoint(checkpoint);
    x = positionsOf(*device.context);
    step();
    device.context->loadCheckpoint(checkpoint);
    expectPositions(x);
    const State state = device.context->getState(State::Positions | State::Velocities |
                                                 State::IntegratorParameters | State::Parameters);
    step();
    device.context->setState(state);
    expectPositions(x);
    step();
}

// A barostat that fails in the middle of a run leaves the state before the step.
TEST(DeviceSteps, FailuresOfForcesLeaveTheStateBeforeTheStep) {
    for (int chunk : {1, 7}) {
        Bodies device;
        device.system.addForce(new MonteCarloBarostat(1e6, 300, 5));
        device.start(testPlatformName());
        vector<Vec3> R;
        double volume = 0;
        long long count = 0;
        const auto look = [&] {
            R = device.integrator.getBodyPositions();
            volume = device.context->getState(0).getPeriodicBoxVolume();
            count = device.context->getStepCount();
        };
        expectError(
            [&] {
                for (int i = 0; i < 2000; i++) {
                    look();
                    device.integrator.step(chunk);
                }
            },
            {"box size has decreased"});
        const auto now = device.integrator.getBodyPositions();
        const auto x = positionsOf(*device.context);
        EXPECT_LT(norm(x[5] - now[2]), readTolerance(1e-12, 10));
        EXPECT_LT(device.context->getStepCount() - count, chunk);
        if (chunk > 1) continue;
        EXPECT_EQ(device.context->getState(0).getPeriodicBoxVolume(), volume);
        for (int b = 0; b < device.numBodies; b++)
            EXPECT_LT(norm(now[b] - R[b]), readTolerance(1e-12, 10));
    }
}

// The device computes the sums of the watch. TestTemperatures tests what the watch must find.
TEST(DeviceSteps, TheWatchOfTemperaturesHasNoFalseAlarms) {
    // Without forces a step takes as long for many bodies.
    Bodies device(0, 0.002, 2.4, 72);
    device.system.removeForce(0);
    device.system.addForce(new CMMotionRemover(10));
    device.start(testPlatformName());
    // The first window of 4000 steps is left out, and three are judged, also together: rotations
    // that seem a quarter too hot are found then.
    device.integrator.step(16100);
    ASSERT_TRUE(areOnTheDevice(device.integrator));
    EXPECT_EQ(device.integrator.getEffects().at("warnings"), "off: none");
}

/** Waters with PME at T = 0. */
struct PmeWaters : WaterBox {
    explicit PmeWaters(bool onHost) : WaterBox(3, 0.002, true) {
        auto& nonbonded = dynamic_cast<NonbondedForce&>(system.getForce(0));
        nonbonded.setNonbondedMethod(NonbondedForce::PME);
        integrator.setTemperature(0);
        integrator.setFriction(5);
        integrator.setRotationalFriction(20);
        setenv("RIGIDHI_BODIES_ON_HOST", onHost ? "1" : "0", 1);
        start();
        unsetenv("RIGIDHI_BODIES_ON_HOST");
    }
};

TEST(DeviceSteps, WatersWithPmeMoveAsByTheHost) {
    PmeWaters device(false), host(true), still(true);
    device.integrator.step(50);
    host.integrator.step(50);
    ASSERT_TRUE(areOnTheDevice(device.integrator)) << device.integrator.getEffects().at(key);
    ASSERT_FALSE(areOnTheDevice(host.integrator));
    // Forces of both are OpenMM's, with sums in other orders. Over 0.1 ps the difference has not
    // yet grown by chaos, so it is this error of the motion.
    const double motion = poseDifference(host.integrator, still.integrator),
                 found = poseDifference(device.integrator, host.integrator);
    printf("poses within %.1e, after a motion of %.2f\n", found, motion);
    EXPECT_GT(motion, 0.1);
    EXPECT_LT(found, forceTolerance(0, motion));
}

TEST(DeviceSteps, NonFiniteForcesNameStepAndBody) {
    for (int bad : {3, 130}) {
        System system;
        CustomRigidHIIntegrator integrator(0, 0.1);
        integrator.setFriction(0);
        vector<Vec3> positions;
        for (int i = 0; i < 3; i++) {
            system.addParticle(1.0);
            integrator.addRigidBody({i}, 1.0, Vec3(), {Vec3()});
            positions.push_back(Vec3(i == 1 ? 0.2 * bad - 0.05 : 500.0, 0, 0));
        }
        auto* force = new CustomExternalForce("1e-9*sqrt(x)");  // not a number for x < 0
        for (int i = 0; i < 3; i++) force->addParticle(i, vector<double>());
        system.addForce(force);
        Context context(system, integrator, testPlatform());
        context.setPositions(positions);
        context.setVelocities({Vec3(), Vec3(-2, 0, 0), Vec3()});
        expectError([&] { integrator.step(1000); },
                    {"step " + to_string(bad), "body 1", "non-finite", "smaller step"});
        EXPECT_EQ(context.getStepCount(), bad - 1);
        EXPECT_NEAR(integrator.getBodyPositions()[1][0], 0.15, 1e-6);
    }
}

TEST(DeviceSteps, TwoContextsOfADeviceShareForces) {
    Bodies one(0.5), two(0.5);
    one.start(testPlatformName(), {{"DeviceIndex", "0"}});
    two.start(testPlatformName(), {{"DeviceIndex", "0,0"}});
    one.integrator.step(50);
    two.integrator.step(50);
    ASSERT_TRUE(areOnTheDevice(two.integrator));
    EXPECT_LT(poseDifference(one.integrator, two.integrator),
              testPrecision() == "double" ? 1e-6 : 1e-4);
}

/** A Force of another plugin. Nobody knows what it does when a step starts. */
class MayDoAnything : public Force {
public:
    bool usesPeriodicBoundaryConditions() const override { return false; }

protected:
    struct Impl : ForceImpl {
        const Force& owner;
        explicit Impl(const Force& owner) : owner(owner) {}
        void initialize(ContextImpl&) override {}
        const Force& getOwner() const override { return owner; }
        double calcForcesAndEnergy(ContextImpl&, bool, bool, int) override { return 0; }
        map<string, double> getDefaultParameters() override { return {}; }
        vector<string> getKernelNames() override { return {}; }
    };
    ForceImpl* createImpl() const override { return new Impl(*this); }
};

TEST(DeviceSteps, TheHostTakesWhatItMust) {
    const auto reasonWith = [](const function<void(Bodies&)>& change) {
        Bodies scene;
        change(scene);
        scene.start(testPlatformName());
        scene.integrator.step(2);
        return scene.integrator.getEffects().at(key);
    };
    const auto expectReason = [&](const string& why, const function<void(Bodies&)>& change) {
        const string found = reasonWith(change);
        EXPECT_EQ(found.substr(0, 4), "off:") << why << ": " << found;
        EXPECT_NE(found.find(why), string::npos) << found;
    };
    expectReason("CustomBodyForce", [](Bodies& scene) {
        auto* force = new CustomBodyForce("1", "0", "0", "0", "0", "0");
        force->addBody(0, vector<double>());
        scene.system.addForce(force);
    });
    expectReason("MayDoAnything",
                 [](Bodies& scene) { scene.system.addForce(new MayDoAnything()); });
    EXPECT_EQ(reasonWith([](Bodies&) {}).substr(0, 3), "on:");
    // OpenMM's own Forces only make forces.
    EXPECT_EQ(reasonWith([](Bodies& scene) {
                  auto* bias = new CustomCVForce("distance");
                  auto* distance = new CustomBondForce("r");
                  distance->addBond(0, 3, vector<double>());
                  bias->addCollectiveVariable("distance", distance);
                  scene.system.addForce(bias);
              }).substr(0, 3),
              "on:");

    // A switch for comparisons.
    setenv("RIGIDHI_BODIES_ON_HOST", "1", 1);
    expectReason("RIGIDHI_BODIES_ON_HOST", [](Bodies&) {});
    unsetenv("RIGIDHI_BODIES_ON_HOST");

    // Steps that need the fluid: all without momenta, and LangevinHI in its middle.
    const auto expectReasonInFluid = [](CustomRigidHIIntegrator::Scheme scheme,
                                        MobilityForce::Model model, bool isDriven,
                                        const string& why) {
        System spheres;
        auto* fluid = new MobilityForce();
        fluid->setModel(model);
        CustomRigidHIIntegrator integrator(300, 0.001);
        integrator.setScheme(scheme);
        for (int i = 0; i < 2; i++) {
            spheres.addParticle(1);
            fluid->addParticle(1);
            integrator.addRigidBody({i}, 1, Vec3(1, 1, 1), {Vec3()});
        }
        spheres.addForce(fluid);
        if (isDriven) {
            auto* driving = new CustomBodyMotion("1", "0", "0", "0", "0", "0");
            driving->addBody(0, vector<double>());
            spheres.addForce(driving);
        }
        Context context(spheres, integrator, testPlatform());
        context.setPositions({Vec3(), Vec3(3, 0, 0)});
        integrator.step(2);
        const string found = integrator.getEffects().at(key);
        EXPECT_EQ(found.substr(0, 4), "off:") << why << ": " << found;
        EXPECT_NE(found.find(why), string::npos) << found;
    };
    for (bool isDriven : {false, true})
        expectReasonInFluid(CustomRigidHIIntegrator::EulerMaruyama,
                            MobilityForce::RotnePragerYamakawa, isDriven,
                            "EulerMaruyama moves bodies together with the fluid");
    expectReasonInFluid(CustomRigidHIIntegrator::LangevinHI, MobilityForce::RotnePragerYamakawa,
                        false, "the fluid, which is on the host, couples momenta");
    expectReasonInFluid(CustomRigidHIIntegrator::LangevinHI, MobilityForce::FreeDraining, true,
                        "the fluid, which is on the host, couples momenta");

    // Shapes that need positions.
    System rods;
    CustomRigidHIIntegrator unplaced(300, 0.001);
    for (int i = 0; i < 2; i++) rods.addParticle(1);
    unplaced.addRigidBody({0, 1});
    Context withoutPositions(rods, unplaced, testPlatform());
    EXPECT_NE(unplaced.getEffects().at(key).find("positions are not set yet"), string::npos);
    withoutPositions.setPositions({Vec3(), Vec3(0.1, 0, 0)});
    unplaced.step(1);
    EXPECT_TRUE(areOnTheDevice(unplaced));

    // Nothing to move.
    System empty;
    empty.addParticle(0);
    CustomRigidHIIntegrator integrator(300, 0.001);
    Context context(empty, integrator, testPlatform());
    context.setPositions({Vec3()});
    integrator.step(3);
    EXPECT_EQ(context.getStepCount(), 3);
    EXPECT_NE(integrator.getEffects().at(key).find("nothing to move"), string::npos);
}

// So many boxes away that OpenMM cannot count them, the host finds where a body is.
TEST(DeviceSteps, BodiesFarFromTheBox) {
    const double away = testPrecision() == "double" ? 1e11 : 1e6;
    Bodies far, host;
    for (Bodies* each : {&far, &host}) {
        each->start(each == &far ? testPlatformName() : "Reference");
        auto R = each->integrator.getBodyPositions();
        R[4][0] += away;
        each->integrator.setBodyPositions(R);
        for (int steps : {5, 300, 5}) each->integrator.step(steps);
    }
    EXPECT_EQ(far.context->getStepCount(), 310);
    const auto R = far.integrator.getBodyPositions(), expected = host.integrator.getBodyPositions();
    for (int b = 0; b < far.numBodies; b++)
        EXPECT_LT(norm(R[b] - expected[b]), b == 4 ? 310 * away * pow(2, -53) : 1e-13) << b;
}

TEST(DeviceSteps, ForceGroupsAreThoseOfTheIntegrator) {
    Bodies device, host;
    for (Bodies* each : {&device, &host}) {
        for (int group : {1, 2}) {
            auto* force = new CustomExternalForce(group == 1 ? "10*x" : "-30*y");
            force->setForceGroup(group);
            for (int i = 0; i < each->system.getNumParticles(); i++)
                force->addParticle(i, vector<double>());
            each->system.addForce(force);
        }
    }
    device.start(testPlatformName());
    host.start("Reference");
    for (Bodies* each : {&device, &host})
        for (int groups : {1 << 1, 1 << 2, 0xff}) {
            each->integrator.setIntegrationForceGroups(groups);
            each->integrator.step(10);
        }
    ASSERT_TRUE(areOnTheDevice(device.integrator));
    EXPECT_LT(poseDifference(device.integrator, host.integrator), 1e-7);
}
