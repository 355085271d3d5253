// Mid-step temperatures of a Context, from the momenta with which a step moves bodies and
// particles, and the watch over them: calls that change no step, alarms, and no false alarms.

#include <openmm/CMMotionRemover.h>
#include <openmm/CustomExternalForce.h>
#include <openmm/HarmonicBondForce.h>

#include <sstream>

#include "TestSupport.h"
#include "openmmrigidhi/CustomBodyForce.h"
#include "openmmrigidhi/MobilityForce.h"

using namespace OpenMM;
using namespace RigidHITest;
using RigidHIPlugin::CustomBodyForce;
using RigidHIPlugin::MobilityForce;
using namespace std;

namespace {

using Scheme = CustomRigidHIIntegrator::Scheme;
const auto A = CustomRigidHIIntegrator::LangevinA, B = CustomRigidHIIntegrator::LangevinB,
           C = CustomRigidHIIntegrator::LangevinC;

/** Spheres of mass 2 and different moments in wells 0.5 k r^2, each at its own place. */
struct Wells {
    static constexpr double mass = 2;
    System system;
    CustomRigidHIIntegrator integrator;
    vector<Vec3> positions;
    unique_ptr<Context> context;
    CustomExternalForce* well = new CustomExternalForce("0.5*k*((x-x0)^2+y^2+z^2)");

    Wells(Scheme scheme, double h, double friction, double k, double temperature = T1)
        : integrator(temperature, h) {
        integrator.setScheme(scheme);
        integrator.setFriction(friction);
        integrator.setRotationalFriction(friction);
        integrator.setRandomNumberSeed(7);
        well->addGlobalParameter("k", k);
        well->addPerParticleParameter("x0");
        system.addForce(well);
    }
    int place() {
        const int p = system.addParticle(mass);
        well->addParticle(p, {2.0 * p});
        positions.emplace_back(2.0 * p, 0, 0);
        return p;
    }
    void addBodies(int number) {
        for (int i = 0; i < number; i++)
            integrator.addRigidBody({place()}, mass, Vec3(0.3, 0.4, 0.5), {Vec3()});
    }
    void addFree(int number) {
        for (int i = 0; i < number; i++) place();
    }
    /** Two free particles and a constraint along x between them. */
    void addPair() {
        const int p = place();
        place();
        positions[p + 1] = positions[p] + Vec3(1, 0, 0);
        well->setParticleParameters(1, p + 1, {2.0 * p + 1});
        system.addConstraint(p, p + 1, 1);
    }
    void start(double temperature = -1) {
        context = make_unique<Context>(system, integrator, testPlatform(),
                                       threads(testPlatformName(), 1));
        context->setPositions(positions);
        context->setVelocitiesToTemperature(
            temperature >= 0 ? temperature : integrator.getTemperature(), 5);
    }
    string warnings() const { return integrator.getEffects().at("warnings"); }
};

/** Kinetic energy of the motion between two sets of positions over h. */
double kineticEnergy(const vector<Vec3>& from, const vector<Vec3>& to, double mass, double h) {
    double sum = 0;
    for (size_t i = 0; i < from.size(); i++) {
        const Vec3 v = (to[i] - from[i]) / h;
        sum += 0.5 * mass * v.dot(v);
    }
    return sum;
}

}  // namespace

TEST(MidStep, IsThatOfTheNextDrift) {
    // At temperature 0 a step of A and B drifts once, by h p/m of the mid-step momentum. Without
    // friction so does C.
    for (Scheme scheme : {A, B, C})
        for (bool free : {false, true}) {
            const double h = 0.3, friction = scheme == C ? 0 : 1.5;
            Wells wells(scheme, h, friction, 3, 0);
            if (free)
                wells.addFree(5);
            else
                wells.addBodies(5);
            for (size_t i = 0; i < wells.positions.size(); i++)
                wells.positions[i] += Vec3(0.1 * i, 0.2, 0.05 * i);
            wells.start(2 * T1);
            wells.integrator.step(3);
            const auto from = positionsOf(*wells.context);
            const auto T = wells.integrator.computeMidStepTemperatures();
            wells.integrator.step(1);
            const double expected =
                2 * kineticEnergy(from, positionsOf(*wells.context), Wells::mass, h) /
                (15 * boltzmann);
            EXPECT_NEAR(T.at(free ? "free" : "translational"), expected,
                        (onDevice() ? 1e-4 : 1e-6) * expected)
                << scheme;
            EXPECT_EQ(T.count(free ? "translational" : "free"), 0u);
            EXPECT_EQ(T.count("rotational"), !free);
        }
}

TEST(MidStep, HasTheVelocityConstraintsOfFreeParticles) {
    Wells wells(B, 0.1, 1.5, 3);
    wells.addPair();
    wells.integrator.setConstraintTolerance(1e-10);
    wells.start(0);
    // From rest at the bottom nothing is left but the noise of half a step: kT (1 - exp(-gamma h))
    // a degree of freedom, of which the constraint leaves five.
    const auto T = wells.integrator.computeMidStepTemperatures();
    EXPECT_NEAR(T.at("free"), T1 * (1 - exp(-0.15)), (hasSingleForces() ? 1e-5 : 1e-9) * T1);
    EXPECT_NEAR(T.at("total"), T.at("free"), 1e-12 * T1);
    // A force along the constraint pushes nothing.
    Wells pushed(C, 0.1, 0, 3, 0);
    pushed.addPair();
    pushed.start(0);
    pushed.context->setPositions({Vec3(-0.1, 0, 0), Vec3(0.9, 0, 0)});
    pushed.context->setParameter("k", 0);
    EXPECT_NEAR(pushed.integrator.computeMidStepTemperature(), 0, 1e-9);
    pushed.context->setParameter("k", 3);
    // The force -3 (x - x0) = 0.3 on both accelerates the pair as a whole: p = 0.05 0.3 each.
    const double p = 0.05 * 0.3;
    EXPECT_NEAR(pushed.integrator.computeMidStepTemperature(),
                2 * 2 * p * p / (2 * Wells::mass) / (5 * boltzmann), 1e-5 * T1 * p * p);
}

TEST(MidStep, CallsChangeNoStep) {
    SKIP_ON_SINGLE_PRECISION_DEVICES("forces there depend on the order of particles");
    // The scene has bodies, free particles, and forces that depend on velocity and time.
    for (Scheme scheme : {A, B, C}) {
        vector<vector<Vec3>> results;
        double evaluations[2];
        for (bool asked : {false, true}) {
            Wells wells(scheme, 0.05, 1, 3);
            wells.addBodies(5);
            wells.addFree(3);
            auto* field =
                new CustomBodyForce("sin(3*t)-0.1*vy", "0.1*vx", "0", "0.1*q1", "0", "cos(t)");
            for (int b = 0; b < 5; b++) field->addBody(b, vector<double>());
            wells.system.addForce(field);
            wells.start();
            const auto ask = [&] {
                if (asked) {
                    EXPECT_GT(wells.integrator.computeMidStepTemperature(), 0);
                    EXPECT_GT(wells.integrator.computeMidStepTemperatures().at("free"), 0);
                }
            };
            ask();
            wells.integrator.step(5);
            const auto forces = wells.integrator.getBodyForces();
            ask();
            EXPECT_TRUE(sameBits(forces, wells.integrator.getBodyForces()));
            wells.integrator.step(5);
            wells.context->setVelocitiesToTemperature(T1, 8);
            ask();
            wells.integrator.step(1);
            wells.context->setTime(0.3);
            ask();
            wells.integrator.step(1);
            wells.integrator.setIntegrationForceGroups(2);
            ask();
            wells.integrator.setIntegrationForceGroups(-1);
            wells.integrator.step(3);
            results.push_back(positionsOf(*wells.context));
            results.push_back(velocitiesOf(*wells.context));
            evaluations[asked] = wells.integrator.getStepStatistics().at("forceEvaluations");
        }
        EXPECT_TRUE(sameBits(results[0], results[2])) << scheme;
        EXPECT_TRUE(sameBits(results[1], results[3])) << scheme;
        EXPECT_GT(evaluations[1], evaluations[0]);
    }
}

TEST(MidStep, EvaluatesForcesOnlyWhereTheyAreOutOfDate) {
    Wells wells(C, 0.05, 1, 3);
    wells.addBodies(3);
    wells.start();
    const auto count = [&] { return wells.integrator.getStepStatistics().at("forceEvaluations"); };
    wells.integrator.computeMidStepTemperature();
    EXPECT_EQ(count(), 1);
    wells.integrator.step(2);
    EXPECT_EQ(count(), 4);
    wells.integrator.computeMidStepTemperature();
    EXPECT_EQ(count(), 4);
    wells.context->setParameter("k", 2);
    wells.integrator.computeMidStepTemperature();
    EXPECT_EQ(count(), 5);
}

TEST(MidStep, ForcesThatAreNotFiniteAreReportedAndNothingIsLost) {
    Wells wells(C, 0.05, 1, 3);
    wells.addBodies(3);
    auto* bad = new CustomExternalForce("1/(x-bad)^2");
    bad->addGlobalParameter("bad", 1e3);
    bad->addParticle(0, {});
    wells.system.addForce(bad);
    wells.start();
    wells.integrator.step(2);
    const auto forces = wells.integrator.getBodyForces();
    wells.context->setPositions(wells.positions);
    wells.context->setParameter("bad", 0);
    expectError([&] { wells.integrator.computeMidStepTemperature(); }, {"non-finite"});
    EXPECT_TRUE(sameBits(forces, wells.integrator.getBodyForces()));
    wells.context->setParameter("bad", 1e3);
    wells.integrator.step(1);
}

TEST(MidStep, InAWellAndOfRotorsIsThatOfTheBath) {
    // h omega = 0.9: between steps the temperature is 20 % low. Samples are a relaxation time
    // apart, and momenta of a sample are independent.
    const double omega = 3, h = 0.9 / omega, k = Wells::mass * omega * omega;
    for (Scheme scheme : {B, C}) {
        Wells wells(scheme, h, omega, k);
        wells.addBodies(1000);
        wells.addFree(1000);
        wells.start();
        wells.integrator.step(30);
        vector<double> translational, rotational, free;
        const int samples = 40;
        for (int s = 0; s < samples; s++) {
            wells.integrator.step(4);
            const auto T = wells.integrator.computeMidStepTemperatures();
            translational.push_back(T.at("translational") / T1);
            rotational.push_back(T.at("rotational") / T1);
            free.push_back(T.at("free") / T1);
        }
        const double expected = scheme == B ? 1 / (1 - 0.81 / 4) : 1;
        const string name = scheme == B ? "B, " : "C, ";
        expectMean(name + "translational", estimate(translational), expected);
        expectMean(name + "free", estimate(free), expected);
        // Free rotation exchanges energy between axes, without an error of the step that shows.
        const Estimate rotation = estimate(rotational);
        EXPECT_NEAR(rotation.mean, 1, 5 * rotation.error + 0.01) << name;
    }
}

TEST(MidStep, CountsWhatACMMotionRemoverTakes) {
    Wells wells(C, 0.05, 1, 0);
    wells.addBodies(2);
    wells.addFree(1);
    wells.system.addForce(new CMMotionRemover(1));
    wells.start(0);
    // p of each component: 1, so that energies are 3/(2 mass) for each body and particle.
    wells.context->setVelocities(vector<Vec3>(3, Vec3(0.5, 0.5, 0.5)));
    const auto T = wells.integrator.computeMidStepTemperatures();
    const double energy = 3 * 0.5 / Wells::mass;
    // 3 of 9 are taken, by equal masses 2 from the bodies and 1 from the particle.
    EXPECT_NEAR(T.at("translational"), 2 * 2 * energy / (4 * boltzmann), 1e-6 * T1);
    EXPECT_NEAR(T.at("free"), 2 * energy / (2 * boltzmann), 1e-6 * T1);
    EXPECT_NEAR(T.at("rotational"), 0, 1e-9);
    EXPECT_NEAR(T.at("total"), 2 * 3 * energy / (12 * boltzmann), 1e-6 * T1);
    EXPECT_EQ(T.at("total"), wells.integrator.computeMidStepTemperature());
}

TEST(MidStep, HasTheScaledMoments) {
    Wells wells(C, 0.05, 1, 0);
    wells.addBodies(2);
    wells.integrator.setInertiaScale(5);
    wells.start(T1);
    const Vec3 energies = wells.integrator.computeRotationalKineticEnergies();
    EXPECT_NEAR(wells.integrator.computeMidStepTemperatures().at("rotational"),
                2 * (energies[0] + energies[1] + energies[2]) / (6 * boltzmann), 1e-6 * T1);
}

// ---- The watch ----------------------------------------------------------------------------------

TEST(TemperatureWatch, FindsAStepThatIsTooLong) {
    // Langevin B at h omega = 1 moves bodies with 4/3 of the temperature. A window has 4000 steps,
    // and the first one begins after as many.
    Wells wells(B, 0.05, 20, 400 * Wells::mass, 300);
    wells.addBodies(40);
    wells.start();
    wells.integrator.step(7999);
    EXPECT_EQ(wells.warnings(), "off: none");
    wells.integrator.step(1);
    const string found = wells.warnings();
    const string begin =
        "on: over the last 4000 steps (200 ps) translations of bodies have been at ";
    ASSERT_EQ(found.find(begin), 0u) << found;
    EXPECT_NEAR(stod(found.substr(begin.size())), 400, 10);
    EXPECT_NE(found.find(" K instead of 300 K: the step is too long, or forces are not "
                         "conservative or drive bodies; take a smaller step "
                         "(computeMidStepTemperature() shows this temperature)"),
              string::npos)
        << found;
    EXPECT_EQ(found.find("rotations"), string::npos) << found;
    // The finding is not that of another step.
    wells.integrator.setStepSize(0.005);
    wells.integrator.step(1);
    EXPECT_EQ(wells.warnings(), "off: none");
    wells.integrator.step(8100);
    EXPECT_EQ(wells.warnings(), "off: none");
}

TEST(TemperatureWatch, FindsGreatHeatSoon) {
    // At h omega = 1.8 Langevin B has 5.3 times the temperature. Four looks are a short window, and
    // so many steps pass before the first one.
    Wells wells(B, 0.05, 20, 3.24 * 400 * Wells::mass, 300);
    wells.addBodies(40);
    wells.start();
    wells.integrator.step(799);
    EXPECT_EQ(wells.warnings(), "off: none");
    wells.integrator.step(1);
    EXPECT_EQ(
        wells.warnings().find("on: over the last 400 steps (20 ps) translations of bodies have "
                              "been at 1"),
        0u)
        << wells.warnings();
    // A whole window that is right takes the finding away.
    wells.context->setParameter("k", 0);
    wells.integrator.step(8000);
    EXPECT_EQ(wells.warnings(), "off: none");
}

TEST(TemperatureWatch, BeginsAnewAfterChangesFromOutside) {
    Wells wells(B, 0.05, 20, 400 * Wells::mass, 300);
    wells.addBodies(40);
    wells.start();
    const auto V = [&] { return wells.integrator.getBodyVelocities(); };
    const vector<function<void()>> changes = {
        [&] { wells.context->setPositions(positionsOf(*wells.context)); },
        [&] { wells.context->setVelocitiesToTemperature(300, 3); },
        [&] { wells.integrator.setBodyPositions(wells.integrator.getBodyPositions()); },
        [&] { wells.integrator.setBodyOrientations(wells.integrator.getBodyOrientations()); },
        [&] { wells.integrator.setBodyVelocities(V()); },
        [&] {
            wells.integrator.setBodyAngularVelocities(wells.integrator.getBodyAngularVelocities());
        },
        [&] { wells.integrator.setTemperature(300); },
        [&] {
            stringstream stream;
            wells.context->createCheckpoint(stream);
            wells.context->loadCheckpoint(stream);
        },
        [&] {
            wells.context->setState(
                wells.context->getState(State::Positions | State::Velocities | State::Parameters));
        }};
    for (size_t i = 0; i < changes.size(); i++) {
        wells.integrator.step(7999);
        EXPECT_EQ(wells.warnings(), "off: none") << i;
        changes[i]();
    }
    wells.integrator.step(8000);
    EXPECT_NE(wells.warnings(), "off: none");
    changes[4]();
    EXPECT_EQ(wells.warnings(), "off: none");
}

TEST(TemperatureWatch, FindsRotationsThatAreTooHot) {
    // A constant torque makes bodies spin faster until friction takes up its power.
    Wells wells(C, 0.01, 5, 0, 300);
    wells.addBodies(40);
    auto* torque = new CustomBodyForce("0", "0", "0", "3", "0", "0");
    for (int b = 0; b < 40; b++) torque->addBody(b, vector<double>());
    wells.system.addForce(torque);
    wells.start();
    wells.integrator.step(8000);
    EXPECT_NE(wells.warnings().find("rotations of bodies have been at "), string::npos)
        << wells.warnings();
    EXPECT_EQ(wells.warnings().find("translations"), string::npos);
}

/**
 * LangevinB is hot by 1/(1 - h^2 omega^2/4) = 1.122 in these wells. One window of 40 looks at 50
 * bodies has a standard error of 1.9 %, so five standard errors and the band hide this deviation.
 * Four windows together reveal it. LangevinC is right at the same step.
 */
TEST(TemperatureWatch, AddsWindowsUp) {
    SKIP_ON_DEVICES("so many steps take long there");
    for (Scheme scheme : {B, C}) {
        Wells wells(scheme, 0.66, 0.5, Wells::mass, 300);
        wells.addBodies(50);
        wells.start();
        // (The step does not resolve rotation either, which has a warning of its own.)
        const auto isFound = [&] {
            return wells.warnings().find("translations of bodies have been at ") != string::npos;
        };
        wells.integrator.step(8001);
        EXPECT_FALSE(isFound()) << wells.warnings();
        wells.integrator.step(20000);
        EXPECT_EQ(isFound(), scheme == B) << wells.warnings();
    }
}

TEST(TemperatureWatch, FindsBodiesThatStayCold) {
    SKIP_ON_DEVICES("a step that a parameter changes takes long there");
    // Feedback cooling: the force of each step is -40/ps times the momentum before it. With the
    // friction 2/ps of the bath the temperature is 2/42 of that of the bath, or less.
    Wells wells(C, 0.01, 2, 0, 300);
    wells.addBodies(1);
    auto* feedback = new CustomExternalForce("-fx*x-fy*y-fz*z");
    for (const char* name : {"fx", "fy", "fz"}) feedback->addGlobalParameter(name, 0);
    feedback->addParticle(0, {});
    wells.system.addForce(feedback);
    wells.start();
    for (int i = 0; i < 8000; i++) {
        const Vec3 f = wells.integrator.getBodyVelocities()[0] * (-40 * Wells::mass);
        wells.context->setParameter("fx", f[0]);
        wells.context->setParameter("fy", f[1]);
        wells.context->setParameter("fz", f[2]);
        wells.integrator.step(1);
    }
    EXPECT_NE(wells.warnings().find("translations of bodies have been at "), string::npos)
        << wells.warnings();
}

TEST(TemperatureWatch, HasNoFalseAlarms) {
    // One body, or two and a particle with the removal of momentum; in wells and free, weak and
    // strong friction, cold and hot starts. A window has a false alarm less often than once in
    // 10^6, and these are fewer than 200 windows.
    SKIP_ON_DEVICES("steps of so few bodies take long there");
    for (Scheme scheme : onCpu() ? vector<Scheme>{C} : vector<Scheme>{A, B, C})
        for (int bodies : {1, 2})
            for (double start : {0.0, 3000.0})
                for (double k : {0.0, 20.0})
                    for (double friction : {2.0, 50.0}) {
                        Wells wells(scheme, 0.003, friction, k, 300);
                        wells.addBodies(bodies);
                        if (bodies == 2) {
                            wells.system.addForce(new CMMotionRemover(1));
                            wells.addFree(1);
                        }
                        wells.start(start);
                        wells.integrator.step(16000);
                        EXPECT_EQ(wells.warnings(), "off: none")
                            << scheme << " " << bodies << " " << start << " " << k;
                    }
}

TEST(TemperatureWatch, KnowsTheTemperatureOfLangevinA) {
    // At gamma h = 1 free motion has 0.81 of the temperature, as far as A allows it.
    Wells wells(A, 0.02, 50, 0, 300);
    wells.addBodies(40);
    wells.start();
    wells.integrator.step(8000);
    EXPECT_LT(wells.integrator.computeMidStepTemperatures().at("translational"), 270);
    EXPECT_EQ(wells.warnings(), "off: none");
}

TEST(TemperatureWatch, IsOffWithoutATemperatureToExpect) {
    // Bodies that a constant force drives, no friction, temperature 0, forces that depend on
    // velocity, and a driven flow: their momenta are not those of the bath.
    const auto run = [](Wells& wells) {
        wells.start(900);
        wells.integrator.step(8000);
        EXPECT_EQ(wells.warnings(), "off: none");
    };
    const auto force = [](Wells& wells, const string& fx) {
        auto* added = new CustomBodyForce(fx, "0", "0", "0", "0", "0");
        for (int b = 0; b < 30; b++) added->addBody(b, vector<double>());
        wells.system.addForce(added);
    };
    Wells driven(C, 0.01, 5, 0, 300), frictionless(C, 0.01, 0, 0, 300), cold(C, 0.01, 5, 0, 0),
        dragged(C, 0.01, 5, 0, 300), shaken(C, 0.01, 5, 0, 300);
    for (Wells* wells : {&driven, &frictionless, &cold, &dragged, &shaken}) wells->addBodies(30);
    force(driven, "40");
    force(dragged, "-10*vx");
    force(shaken, "200*sin(t)");
    for (Wells* wells : {&driven, &frictionless, &cold, &dragged, &shaken}) run(*wells);
    EXPECT_GT(driven.integrator.computeMidStepTemperature(), 350);

    for (double speed : {0.0, 5.0}) {
        Wells inFlow(CustomRigidHIIntegrator::LangevinHI, 0.01, 1, 0, 300);
        inFlow.addBodies(4);
        auto* fluid = new MobilityForce();
        fluid->setModel(MobilityForce::RotnePragerYamakawa);
        fluid->setViscosity(10);
        for (int p = 0; p < 4; p++) fluid->addParticle(0.1);
        fluid->setBackgroundFlow(Vec3(speed, 0, 0), vector<double>(9, 0));
        inFlow.system.addForce(fluid);
        run(inFlow);
    }
}

TEST(TemperatureWatch, WatchesBodiesThatAFluidCouples) {
    // A torque as above, with the friction 8 pi eta a^3 of spheres.
    Wells wells(CustomRigidHIIntegrator::LangevinHI, 0.01, 1, 0, 300);
    wells.addBodies(4);
    auto* fluid = new MobilityForce();
    fluid->setModel(MobilityForce::RotnePragerYamakawa);
    fluid->setViscosity(10);
    for (int p = 0; p < 4; p++) fluid->addParticle(0.2);
    wells.system.addForce(fluid);
    auto* torque = new CustomBodyForce("0", "0", "0", "8", "0", "0");
    for (int b = 0; b < 4; b++) torque->addBody(b, vector<double>());
    wells.system.addForce(torque);
    wells.start();
    wells.integrator.step(8000);
    EXPECT_NE(wells.warnings().find("rotations of bodies have been at "), string::npos)
        << wells.warnings();
}

TEST(TemperatureWatch, DoesNotChangeARunThatIsResumed) {
    SKIP_ON_DEVICES("steps there are the same to rounding only");
    // The resumed run looks at other steps than the uninterrupted one.
    vector<vector<Vec3>> results;
    for (bool resumed : {false, true}) {
        Wells wells(C, 0.01, 5, 3, 300);
        wells.addBodies(9);
        wells.start();
        wells.integrator.step(4321);
        if (resumed) {
            stringstream stream;
            wells.context->createCheckpoint(stream);
            wells.integrator.step(77);
            wells.context->loadCheckpoint(stream);
        }
        wells.integrator.step(5000);
        results.push_back(positionsOf(*wells.context));
        results.push_back(velocitiesOf(*wells.context));
    }
    EXPECT_TRUE(sameBits(results[0], results[2]));
    EXPECT_TRUE(sameBits(results[1], results[3]));
}
