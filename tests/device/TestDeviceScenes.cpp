// Bodies on the device beside what else a System has: constraints, held bodies and particles,
// virtual sites, PME. And what the host must do, with the reason.

#include <openmm/CustomBondForce.h>
#include <openmm/CustomCVForce.h>
#include <openmm/CustomExternalForce.h>
#include <openmm/MonteCarloBarostat.h>
#include <openmm/NonbondedForce.h>
#include <openmm/VirtualSite.h>
#include <openmm/internal/ForceImpl.h>

#include <memory>

#include "DeviceSupport.h"
#include "WaterBoxSupport.h"
#include "openmmrigidhi/CustomBodyForce.h"
#include "openmmrigidhi/CustomBodyMotion.h"
#include "openmmrigidhi/MobilityForce.h"

using namespace OpenMM;
using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace std;

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

TEST(DeviceScenes, FreeParticlesWithConstraintsMoveAsOnReference) {
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
        ASSERT_TRUE(areOnTheDevice(device.integrator))
            << device.integrator.getEffects().at(bodiesKey);
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

// Velocities that constraints have changed are taken in once, also if the host asks at each step.
TEST(DeviceScenes, StepsOneByOneWithConstraintsAreTheSame) {
    vector<Vec3> positions[2], velocities[2];
    for (int chunk : {1, 50}) {
        Molecules device(1e-5);
        device.start(testPlatformName());
        for (int i = 0; i < 50 / chunk; i++) device.integrator.step(chunk);
        ASSERT_TRUE(areOnTheDevice(device.integrator));
        positions[chunk == 1] = positionsOf(*device.context);
        velocities[chunk == 1] = velocitiesOf(*device.context);
    }
    EXPECT_TRUE(sameBits(positions[0], positions[1]));
    EXPECT_TRUE(sameBits(velocities[0], velocities[1]));
}

TEST(DeviceScenes, HeldBodiesAndParticlesStay) {
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
        ASSERT_TRUE(areOnTheDevice(device.integrator))
            << device.integrator.getEffects().at(bodiesKey);
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

// The device gets the new shapes of bodies.
TEST(DeviceScenes, ShapesThatAreResetMoveAsOnReference) {
    struct Rods {
        System system;
        CustomRigidHIIntegrator integrator{300, 0.002};
        unique_ptr<Context> context;
        explicit Rods(const string& platformName) {
            for (int i = 0; i < 3; i++) {
                const int p = system.addParticle(12);
                system.addParticle(16);
                integrator.addRigidBody({p, p + 1});
            }
            integrator.setRandomNumberSeed(8);
            context = make_unique<Context>(system, integrator, platform(platformName));
            for (double length : {0.1, 0.16}) {
                vector<Vec3> positions;
                for (int i = 0; i < 3; i++)
                    for (double x : {0.0, length}) positions.push_back(Vec3(i, x, x));
                if (length > 0.1) integrator.resetBodyGeometry();
                context->setPositions(positions);
                integrator.step(20);
            }
        }
    };
    Rods device(testPlatformName()), host("Reference");
    ASSERT_TRUE(areOnTheDevice(device.integrator)) << device.integrator.getEffects().at(bodiesKey);
    // Shapes come from positions that the Context has rounded, by their moments of inertia.
    const double shape = readTolerance(1e-14, 1) / 0.1;
    EXPECT_LT(poseDifference(device.integrator, host.integrator), 10 * shape);
    const auto x = positionsOf(*device.context), y = positionsOf(*host.context);
    for (int p = 0; p < 6; p++) EXPECT_LT(norm(x[p] - y[p]), 10 * shape + readTolerance(0, 4));
    EXPECT_NEAR(norm(x[0] - x[1]), 0.16 * sqrt(2), readTolerance(1e-12, 4));
}

// Forces on virtual sites, in bodies and between free particles, act on their parents.
TEST(DeviceScenes, ForcesOnVirtualSitesActAsOnReference) {
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
    ASSERT_TRUE(areOnTheDevice(device.integrator)) << device.integrator.getEffects().at(bodiesKey);
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

TEST(DeviceScenes, WatersWithPmeMoveAsByTheHost) {
    PmeWaters device(false), host(true), still(true);
    device.integrator.step(50);
    host.integrator.step(50);
    ASSERT_TRUE(areOnTheDevice(device.integrator)) << device.integrator.getEffects().at(bodiesKey);
    ASSERT_FALSE(areOnTheDevice(host.integrator));
    // Forces of both are OpenMM's, with sums in other orders. Over 0.1 ps the difference has not
    // yet grown by chaos, so it is this error of the motion.
    const double motion = poseDifference(host.integrator, still.integrator),
                 found = poseDifference(device.integrator, host.integrator);
    printf("poses within %.1e, after a motion of %.2f\n", found, motion);
    EXPECT_GT(motion, 0.1);
    EXPECT_LT(found, forceTolerance(0, motion));
}

/** Bodies around the origin of the box, which a field without images draws there. */
struct Drawn : Bodies {
    Drawn() {
        integrator.setTemperature(0);
        auto* field = new CustomExternalForce("25*(x^2 + y^2 + z^2)");
        for (int p = 0; p < system.getNumParticles(); p++)
            if (system.getParticleMass(p) > 0) field->addParticle(p, vector<double>());
        system.addForce(field);
        for (Vec3& x : positions) x -= Vec3(1.2, 1.2, 1.2);
    }
    void startBy(bool host) {
        setenv("RIGIDHI_BODIES_ON_HOST", host ? "1" : "0", 1);
        start(testPlatformName());
        unsetenv("RIGIDHI_BODIES_ON_HOST");
    }
};

// OpenMM moves molecules into the box when it sorts particles, at the first evaluation and 250
// steps later.
TEST(DeviceScenes, ForcesWithoutImagesActOnBodiesWhereTheyAre) {
    Drawn expected;
    expected.start("Reference");
    expected.integrator.step(1);
    const auto first = expected.integrator.getBodyForces();
    expected.integrator.step(299);
    for (bool onHost : {false, true})
        for (bool isHeld : {false, true}) {
            Drawn scene;
            scene.startBy(onHost);
            if (isHeld) scene.integrator.setBodyHeld(2, true);
            scene.integrator.step(1);
            const auto forces = scene.integrator.getBodyForces();
            for (size_t b = 0; b < forces.size(); b++)
                EXPECT_LT(norm(forces[b] - first[b]), 1e-3 * norm(first[b])) << "body " << b;
            scene.integrator.step(299);
            EXPECT_EQ(areOnTheDevice(scene.integrator), !onHost && !isHeld)
                << scene.integrator.getEffects().at(bodiesKey);
            if (isHeld) continue;
            // The errors of forces, over 0.6 ps in a trap.
            const double close = testPrecision() == "double" ? 1e-6 : 1e-4;
            EXPECT_LT(poseDifference(scene.integrator, expected.integrator), close)
                << (onHost ? "by the host" : "on the device");
        }
}

// A CustomBodyForce that is off does not make steps evaluate forces twice.
TEST(DeviceScenes, ForcesThatAreOffCostNothing) {
    for (bool isInGroup : {false, true}) {
        Bodies device(0.5), expected(0.5);
        for (Bodies* each : {&device, &expected}) {
            auto* force = new CustomBodyForce("sin(t)", "0", "0", "0", "0", "0");
            force->addBody(0, vector<double>());
            force->setForceGroup(5);
            if (isInGroup || each == &device)
                each->system.addForce(force);
            else
                delete force;
            each->integrator.setTemperature(0);
            each->integrator.setIntegrationForceGroups(isInGroup ? -1 : ~(1 << 5));
            each->start(each == &device ? testPlatformName() : "Reference");
            each->integrator.step(300);
        }
        EXPECT_EQ(areOnTheDevice(device.integrator), !isInGroup);
        EXPECT_LT(device.integrator.getStepStatistics().at("forceEvaluations"), 305);
        EXPECT_LT(poseDifference(device.integrator, expected.integrator),
                  testPrecision() == "double" ? 1e-6 : 1e-3);
    }
}

/** Bodies of three particles on a line, whose constraints are one too many, and a bound pair. */
struct Redundant {
    System system;
    CustomRigidHIIntegrator integrator{300, 0.002};
    vector<Vec3> positions;
    unique_ptr<Context> context;
    explicit Redundant(const string& platformName) {
        for (int i = 0; i < 4; i++) {
            const int p = system.addParticle(12);
            system.addParticle(16);
            system.addParticle(16);
            for (double x : {0.0, 0.116, -0.116}) positions.push_back(Vec3(x, i, 0.3 * i));
            system.addConstraint(p, p + 1, 0.116);
            system.addConstraint(p, p + 2, 0.116);
            system.addConstraint(p + 1, p + 2, 0.232);
            integrator.addRigidBody({p, p + 1, p + 2});
        }
        const int p = system.addParticle(12);
        system.addParticle(12);
        system.addConstraint(p, p + 1, 0.15);
        positions.insert(positions.end(), {Vec3(0, 9, 0), Vec3(0.15, 9, 0)});
        integrator.setRandomNumberSeed(4);
        integrator.setConstraintTolerance(testPrecision() == "single" ? 1e-6 : 1e-10);
        context = make_unique<Context>(system, integrator, platform(platformName));
        context->setPositions(positions);
    }
};

TEST(DeviceScenes, ConstraintsOfFreeParticlesLeaveVelocitiesOfBodies) {
    Redundant looked(testPlatformName()), unseen(testPlatformName());
    for (int i = 0; i < 20; i++) {
        looked.integrator.step(2);
        const auto v = velocitiesOf(*looked.context), x = positionsOf(*looked.context);
        const auto R = looked.integrator.getBodyPositions(),
                   V = looked.integrator.getBodyVelocities(),
                   omega = looked.integrator.getBodyAngularVelocities();
        for (int p = 0; p < 12; p++) {
            const Vec3 expected = V[p / 3] + omega[p / 3].cross(x[p] - R[p / 3]);
            // OpenMM reads positions and velocities as it rounds them.
            EXPECT_LT(norm(v[p] - expected),
                      readTolerance(1e-12, 1) * (1 + norm(omega[p / 3])) * 10)
                << "particle " << p;
        }
    }
    EXPECT_TRUE(areOnTheDevice(looked.integrator));
    unseen.integrator.step(40);
    EXPECT_LT(poseDifference(looked.integrator, unseen.integrator), 1e-13);
}

// Steps on the host leave nothing that a question after steps on the device would take.
TEST(DeviceScenes, QuestionsAfterStepsOfHostAndDevice) {
    Bodies scene(0.5);
    auto* drag = new CustomBodyForce("-40*vx", "0", "0", "0", "0", "0");
    drag->setForceGroup(1);
    for (int b = 0; b < scene.numBodies; b++) drag->addBody(b, vector<double>());
    scene.system.addForce(drag);
    scene.start(testPlatformName());
    scene.integrator.step(5);
    EXPECT_FALSE(areOnTheDevice(scene.integrator));
    scene.integrator.setIntegrationForceGroups(1);
    scene.integrator.step(50);
    EXPECT_TRUE(areOnTheDevice(scene.integrator));
    const double once = scene.integrator.computeMidStepTemperature(),
                 twice = scene.integrator.computeMidStepTemperature();
    EXPECT_EQ(once, twice);
}

// So many boxes away that OpenMM cannot count them, the host finds where a body is.
TEST(DeviceScenes, BodiesFarFromTheBox) {
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

TEST(DeviceScenes, TheHostTakesWhatItMust) {
    const auto reasonWith = [](const function<void(Bodies&)>& change) {
        Bodies scene;
        change(scene);
        scene.start(testPlatformName());
        scene.integrator.step(2);
        return scene.integrator.getEffects().at(bodiesKey);
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
    const auto addFixed = [](Bodies& scene) {
        scene.system.addParticle(0);
        scene.positions.push_back(Vec3(0.1, 2, 2));
        dynamic_cast<NonbondedForce&>(scene.system.getForce(0)).addParticle(0, 0, 0);
    };
    expectReason("a barostat moves particles without mass", [&](Bodies& scene) {
        addFixed(scene);
        scene.system.addForce(new MonteCarloBarostat(1, 300));
    });
    const auto addField = [](Bodies& scene) {
        auto* field = new CustomExternalForce("x^2");
        field->addParticle(0, vector<double>());
        scene.system.addForce(field);
    };
    expectReason("force 1 is not periodic", [&](Bodies& scene) {
        addFixed(scene);
        addField(scene);
    });
    EXPECT_EQ(reasonWith(addFixed).substr(0, 3), "on:");
    EXPECT_EQ(reasonWith(addField).substr(0, 3), "on:");
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
        const string found = integrator.getEffects().at(bodiesKey);
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
    EXPECT_NE(unplaced.getEffects().at(bodiesKey).find("positions are not set yet"), string::npos);
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
    EXPECT_NE(integrator.getEffects().at(bodiesKey).find("nothing to move"), string::npos);
}
