// The resolution of a step: bodies that are straight only to the decimals of their file, and
// warnings of steps that are too long, given only where they are due.

#include <openmm/CustomExternalForce.h>

#include <functional>
#include <map>

#include "HydrodynamicSupport.h"
#include "Sampling.h"
#include "openmmrigidhi/CustomBodyForce.h"
#include "openmmrigidhi/SchemeTraits.h"

using namespace OpenMM;
using namespace RigidHITest;
using RigidHIPlugin::CustomBodyForce;
using RigidHIPlugin::schemeTable;
using RigidHIPlugin::SchemeTraits;
using namespace std;

namespace {

using RigidHI = CustomRigidHIIntegrator;
using Scheme = RigidHI::Scheme;

const Vec3 skewLine = Vec3(1, 2, 3) / sqrt(14.0);

/** A coordinate as a file with so many decimals has it; -1: as it is. */
double rounded(double x, int decimals) {
    return decimals < 0 ? x : round(x * pow(10, decimals)) / pow(10, decimals);
}

Vec3 rounded(const Vec3& x, int decimals) {
    return Vec3(rounded(x[0], decimals), rounded(x[1], decimals), rounded(x[2], decimals));
}
/** A place that is not one of a file, so that rounding bends what is straight. */
const Vec3 offGrid(1 / 3.0, 1 / 7.0, 1 / 9.0);

/** Five touching blobs on a line, with the origin off the middle one; massless. */
BodyKind straightRod(int decimals, const Vec3& origin = Vec3()) {
    BodyKind kind = {"rod", 0, Vec3(), {}, vector<double>(5, 0.5)};
    for (int i = -2; i <= 2; i++) {
        kind.sites.push_back(rounded(skewLine * i, decimals) - origin);
    }
    return kind;
}

/** Rods that do not feel each other. */
struct Rods : FluidScene {
    Rods(Scheme scheme, const BodyKind& kind, int copies, double h, double temperature = T1)
        : FluidScene(temperature, h) {
        integrator.setScheme(scheme);
        integrator.setRandomNumberSeed(7);
        vector<int> groups;
        for (int i = 0; i < copies; i++) {
            add(kind);
            groups.push_back(i);
        }
        fluid->setGroups(groups);
    }
    string warnings() { return integrator.getEffects().at("warnings"); }
};

bool holds(const string& text, const string& part) { return text.find(part) != string::npos; }

}  // namespace

/**
 * The axis of a straight rod has <u(t) u(0)> = exp(-2 D t), and the mean square displacement of its
 * centre is 2 tr(D_t) t. A rod with rounded coordinates must do the same, although its spin is up
 * to 1e13 times as fast. The tracking point is off the line. Standard errors of 1000 rods are 3 %
 * of both numbers. The test allows five of them (56 numbers: a chance of 3e-5 to fail), and 2 % for
 * the step, the largest error that slowed spins may have (SlowedSpin.h).
 */
TEST(Resolution, NearlyStraightRodsTumbleAtTheRightRate) {
    const int copies = 1000, steps = 40;
    const double Dh = 5e-4;
    Rods straight(RigidHI::TrapezoidalSlip, straightRod(-1), 1, 1);
    straight.start(testPlatform());
    const MatrixXd N = straight.mobility();
    const Vector3d line = toEigen(skewLine), across = line.unitOrthogonal();
    const double D = across.dot(N.bottomRightCorner<3, 3>() * across),
                 D_t = N.topLeftCorner<3, 3>().trace(), h = Dh / D;
    for (const SchemeTraits& traits : schemeTable) {
        if (!traits.isOverdamped()) continue;
        for (int decimals : {-1, 6, 4, 2}) {
            if (decimals >= 4 && traits.scheme != RigidHI::TrapezoidalSlip) continue;
            SCOPED_TRACE(string(traits.name) + ", decimals " + to_string(decimals));
            const Vec3 origin = decimals < 0 ? Vec3() : Vec3(0.2, -0.1, 0.1);
            const BodyKind kind = straightRod(decimals, origin);
            Rods rods(traits.scheme, kind, copies, h);
            rods.start(testPlatform());
            rods.integrator.step(steps);
            const vector<Vec3> ends = positionsOf(*rods.context);
            vector<double> cosines, squares;
            const Vec3 before = kind.sites[4] - kind.sites[0];
            for (int i = 0; i < copies; i++) {
                const Vec3 axis = ends[5 * i + 4] - ends[5 * i];
                cosines.push_back(axis.dot(before) / (norm(axis) * norm(before)));
                Vec3 moved;
                for (int k = 0; k < 5; k++) moved += (ends[5 * i + k] - kind.sites[k]) / 5;
                squares.push_back(moved.dot(moved));
            }
            const Estimate cosine = estimate(cosines), square = estimate(squares);
            const double t = steps * h;
            EXPECT_NEAR(-log(cosine.mean) / (2 * D * t), 1, 5 * cosine.error / (2 * D * t) + 0.02);
            // EulerMaruyama omits the drift towards the line, and says so.
            if (!traits.omitsDrift() || decimals < 0) {
                EXPECT_NEAR(square.mean / (2 * D_t * t), 1,
                            5 * square.error / (2 * D_t * t) + 0.02);
            }
            const string slowed = rods.integrator.getEffects().at("slowed spins");
            EXPECT_EQ(slowed.substr(0, 3), decimals < 0 ? "off" : "on:") << slowed;
            EXPECT_EQ(rods.warnings().substr(0, 9),
                      traits.omitsDrift() && decimals >= 0 ? "on: Euler" : "off: none")
                << rods.warnings();
        }
    }
}

/**
 * At T = 0 no spin is slowed, so trajectories keep their order. Short steps slow no spin either.
 */
TEST(Resolution, SpinsAreRealWithoutNoiseAndInShortSteps) {
    for (double temperature : {0.0, T1}) {
        Rods rods(RigidHI::TrapezoidalSlip, straightRod(2), 2, temperature == 0 ? 1 : 1e-7,
                  temperature);
        rods.start(testPlatform());
        rods.integrator.step(2);
        EXPECT_EQ(rods.integrator.getEffects().at("slowed spins").substr(0, 4), "off:");
    }
}

/** Bodies with slowed spins above a wall, where each pose has a mobility of its own. */
TEST(Resolution, SlowedSpinsResumeBitForBit) {
    const auto start = [](int) {
        auto scene = make_unique<Rods>(RigidHI::DriftCorrectorRFD, straightRod(3), 3, 1.0);
        scene->fluid->setBoundary(MobilityForce::NoSlipWall);
        scene->fluid->setWallHeight(-20);
        scene->start(testPlatform());
        return scene;
    };
    SKIP_ON_DEVICES("devices round positions");
    expectToResumeBitForBit<Rods>(
        start, [](Rods& scene) { scene.integrator.step(3); }, 5);
}

/**
 * Carbon dioxide with rounded coordinates, from rest: after 50/Gamma, when energies lack a part
 * exp(-8), the tumbling has the temperature of the bath (an earlier thermostat gave a seventh of
 * it). The test allows five standard errors.
 */
TEST(Resolution, ThermostatsReachTheTumblingOfNearlyStraightMolecules) {
    const int copies = 64, samples = 43;
    const double bond = 0.116;
    for (Scheme scheme : thermostatsWithMomenta())
        for (int decimals : {4, 2}) {
            SCOPED_TRACE(decimals);
            System system;
            CustomRigidHIIntegrator integrator(300, 0.002);
            integrator.setScheme(scheme);
            integrator.setFriction(5);
            integrator.setRotationalFriction(5);
            integrator.setRandomNumberSeed(3);
            vector<Vec3> positions = randomPoses(
                {"", {16, 12, 16}, {Vec3(-bond, 0, 0), Vec3(), Vec3(bond, 0, 0)}}, copies, 1, 5);
            for (Vec3& x : positions) x = rounded(x + offGrid, decimals);
            for (int i = 0; i < copies; i++) {
                for (double mass : {16.0, 12.0, 16.0}) system.addParticle(mass);
                integrator.addRigidBody({3 * i, 3 * i + 1, 3 * i + 2});
            }
            Context context(system, integrator, testPlatform(), threads(testPlatformName(), 1));
            context.setPositions(positions);
            integrator.step(5000);
            const bool warned = scheme == RigidHI::LangevinA;
            vector<double> energies;
            for (int s = 0; s < (warned ? 5 : samples); s++) {
                integrator.step(600);
                const Vec3 e = integrator.computeRotationalKineticEnergies();
                energies.push_back((e[1] + e[2]) / copies / (300 * boltzmann));
            }
            // LangevinA's noise has half of its variance about the axes across a fast spin, and
            // says so. The other schemes need nothing.
            const string warnings = integrator.getEffects().at("warnings");
            if (warned)
                EXPECT_TRUE(holds(warnings, "of the temperature; use LangevinB or LangevinC"));
            else
                EXPECT_EQ(warnings, "off: none");
            if (!warned) {
                // The tumbling relaxes at 0.08 Gamma.
                const double error = errorOfCorrelatedSquares(0.08 * 5 * 1.2);
                expectMean("tumbling", {estimate(energies).mean, error / sqrt(copies * samples)},
                           1);
            }
            EXPECT_GT(estimate(energies).mean, 0.45);
            EXPECT_EQ(integrator.getEffects().at("elongated bodies").substr(0, 3), "on:");
        }
}

/**
 * Dipoles in a field have <cos> = coth x - 1/x at x = mu E/kT. An earlier gradient thermostat
 * missed this value for molecules that are straight to their decimals. The step causes an error of
 * 1 % (D h = 0.005).
 */
TEST(Resolution, GradientThermostatTurnsNearlyStraightMoleculesRight) {
    const int copies = 500;
    const double bond = 0.116, x = 2, I = 2 * 16 * bond * bond;
    System system;
    const double kT = 300 * boltzmann;
    CustomRigidHIIntegrator integrator(300, 1);
    integrator.setScheme(RigidHI::GradientThermostat);
    integrator.setRandomNumberSeed(3);
    vector<Vec3> positions = randomPoses(
        {"", {16, 12, 16}, {Vec3(-bond, 0, 0), Vec3(), Vec3(bond, 0, 0)}}, copies, 1, 5);
    for (Vec3& r : positions) r = rounded(r + offGrid, 4);
    auto* field = new CustomExternalForce("-strength*z");
    field->addPerParticleParameter("strength");
    for (int i = 0; i < copies; i++) {
        for (double mass : {16.0, 12.0, 16.0}) system.addParticle(mass);
        integrator.addRigidBody({3 * i, 3 * i + 1, 3 * i + 2});
        field->addParticle(3 * i, {-x * kT / (2 * bond)});
        field->addParticle(3 * i + 2, {x * kT / (2 * bond)});
    }
    system.addForce(field);
    // D = 4 Upsilon kT/M with 4/M = sum 1/I' = 2/I.
    const double Dh = 0.005;
    integrator.setGradientRotationalRelaxationTime(Dh * I / (2 * kT));
    integrator.setGradientRelaxationTime(1e-6);
    Context context(system, integrator, testPlatform(), threads(testPlatformName(), 1));
    context.setPositions(positions);
    integrator.step(400);
    vector<double> means;
    for (int s = 0; s < 20; s++) {
        integrator.step(200);  // a relaxation time exp(-2 D t) of the free dipole
        const vector<Vec3> at = positionsOf(context);
        double sum = 0;
        for (int i = 0; i < copies; i++) sum += (at[3 * i + 2] - at[3 * i])[2] / (2 * bond);
        means.push_back(sum / copies);
    }
    const double expected = 1 / tanh(x) - 1 / x;
    EXPECT_NEAR(estimate(means).mean, expected,
                5 * 1.2 * 0.45 / sqrt(20.0 * copies) + 0.01 * expected);
    EXPECT_EQ(integrator.getEffects().at("warnings"), "off: none");
    integrator.setStepSize(100);
    EXPECT_TRUE(holds(integrator.getEffects().at("warnings"), "does not resolve its rotation"));
}

/** A sphere of half a nanometre with a step of a second, as if its units were micrometres. */
TEST(Resolution, LeapsAreWarnedOf) {
    for (const SchemeTraits& traits : schemeTable) {
        if (!traits.isOverdamped()) continue;
        for (double h : {1e-3, 1e12}) {
            SCOPED_TRACE(string(traits.name) + " " + to_string(h));
            FluidScene scene(300, h);
            scene.integrator.setScheme(traits.scheme);
            scene.fluid->setViscosity(0.89);
            scene.add(sphereKind(0.5));
            scene.add(sphereKind(0.7), Vec3(3, 0, 0));
            testing::internal::CaptureStderr();
            scene.start(testPlatform());
            scene.integrator.step(20);
            const string printed = testing::internal::GetCapturedStderr(),
                         shown = scene.integrator.getEffects().at("warnings");
            for (const string& text : {printed, shown}) {
                EXPECT_EQ(holds(text, "moves at random by"), h > 1) << text;
                EXPECT_EQ(holds(text, "turns at random by"), h > 1) << text;
            }
            if (h > 1) {
                EXPECT_TRUE(holds(printed,
                                  "body 0 moves at random by 771 um along each axis, where "
                                  "the smallest radius is 500 pm"))
                    << printed;
                EXPECT_EQ(printed.find("moves at random"), printed.rfind("moves at random"));
            }
        }
    }
}

/** At the step that the warning recommends, it does not appear. */
TEST(Resolution, TheStepThatIsNamedIsShortEnough) {
    const auto stepIn = [](const string& warnings, const string& before) {
        const size_t at = warnings.find("take a step of ", warnings.find(before));
        return stod(warnings.substr(at + 15));
    };
    FluidScene scene(300, 1e3);
    scene.integrator.setScheme(RigidHI::EulerMaruyama);
    scene.add(sphereKind(0.5));
    scene.start(testPlatform());
    string warnings = scene.integrator.getEffects().at("warnings");
    ASSERT_TRUE(holds(warnings, "moves at random by")) << warnings;
    scene.integrator.setStepSize(
        min(stepIn(warnings, "moves at random by"), stepIn(warnings, "turns at random by")));
    EXPECT_EQ(scene.integrator.getEffects().at("warnings"), "off: none");

    FluidScene hi(300, 10);
    hi.add(sphereKind(0.5, 10, 0.4));
    hi.start(testPlatform());
    warnings = hi.integrator.getEffects().at("warnings");
    ASSERT_TRUE(holds(warnings, "temperatures are right")) << warnings;
    hi.integrator.setStepSize(stepIn(warnings, "temperatures are right"));
    EXPECT_EQ(hi.integrator.getEffects().at("warnings"), "off: none");
}

/**
 * LangevinHI moves free bodies with (h s/2) coth(h s/2) times the right diffusion. The warning
 * gives this factor, and it agrees with the measured one (displacements of 4000 bodies have a
 * standard error of 1.8 %; the test allows five of these).
 */
TEST(Resolution, FastRelaxationIsWarnedOfWithItsFactor) {
    const int copies = 4000;
    const double radius = 0.5, mass = 10;
    for (bool multiblob : {false, true}) {
        FluidScene scene(300, 1);
        const double s = 6 * M_PI * 0.6 * radius / mass;
        const double h = (multiblob ? 3 : 5) / s;
        scene.integrator.setStepSize(h);
        BodyKind kind = sphereKind(radius, mass, 1e4);  // rotation relaxes slowly
        if (multiblob) {
            kind = rodKind();
            kind.mass = 20;
        }
        vector<int> groups;
        for (int i = 0; i < (multiblob ? 1 : copies); i++) {
            scene.add(kind);
            groups.push_back(i);
        }
        scene.fluid->setGroups(groups);
        scene.start(testPlatform());
        const string warnings = scene.integrator.getEffects().at("warnings");
        ASSERT_TRUE(holds(warnings, "temperatures are right, but its ")) << warnings;
        ASSERT_TRUE(holds(warnings, "body 0 relaxes")) << warnings;
        if (multiblob) continue;
        ASSERT_TRUE(holds(warnings, "is 5 times the time in which the momentum")) << warnings;
        const double factor = 2.5 / tanh(2.5);
        ASSERT_TRUE(holds(warnings, "2.53 times as fast")) << warnings;
        scene.context->setVelocitiesToTemperature(300, 5);
        scene.integrator.step(20);  // of correlation exp(-5)
        const auto before = scene.integrator.getBodyPositions();
        const int steps = 40;
        scene.integrator.step(steps);
        const auto after = scene.integrator.getBodyPositions();
        vector<double> squares;
        for (int i = 0; i < copies; i++) {
            const Vec3 moved = after[i] - before[i];
            squares.push_back(moved.dot(moved));
        }
        const double D = 300 * boltzmann / (mass * s), t = steps * h;
        const Estimate square = estimate(squares);
        // The ends of the time count for 1/steps.
        EXPECT_NEAR(square.mean / (6 * D * t) / factor, 1,
                    5 * square.error / (6 * D * t * factor) + 1.0 / steps);
    }
    // Each body counts, by the faster of its motions, and free particles do.
    FluidScene scene(300, 0.001);
    scene.add(sphereKind(0.5, 1000, 1e-3));
    scene.start(testPlatform());
    EXPECT_TRUE(
        holds(scene.integrator.getEffects().at("warnings"), "the angular momentum of body 0"));
    FluidScene free(300, 0.01);
    free.add(sphereKind(0.5, 1000, 1000));
    free.addFree(1e-3, 0.2, Vec3(3, 0, 0));
    free.start(testPlatform());
    EXPECT_TRUE(holds(free.integrator.getEffects().at("warnings"), "the momentum of particle 1"));
}

/**
 * A slowed spin does not follow a torque that keeps turning a bent rod about its line, so a warning
 * is due. With forces from a potential, or without forces, slowing is harmless.
 */
TEST(Resolution, DrivenSpinsAreWarnedOfAndBoundOnesAreNot) {
    for (const string forces : {"drive", "field", "none"}) {
        SCOPED_TRACE(forces);
        BodyKind bent = rodKind();
        bent.mass = 0;
        bent.moments = Vec3();
        bent.sites[0][0] += 0.05;
        Rods rods(RigidHI::TrapezoidalSlip, bent, 5, 0.05);
        if (forces == "drive") {
            // 5 kT along body axis z.
            auto* torque = new CustomBodyForce("0", "0", "0", "10*(q1*q3+q0*q2)",
                                               "10*(q2*q3-q0*q1)", "5*(q0^2-q1^2-q2^2+q3^2)");
            for (int b = 0; b < 5; b++) torque->addBody(b, {});
            rods.system.addForce(torque);
        }
        if (forces == "field") {
            auto* field = new CustomExternalForce("5*x+2*y^2+z^2");
            for (int i = 0; i < rods.system.getNumParticles(); i++)
                if (i % 3 == 0) field->addParticle(i, {});
            rods.system.addForce(field);
        }
        rods.start(testPlatform());
        ASSERT_EQ(rods.integrator.getEffects().at("slowed spins").substr(0, 3), "on:");
        testing::internal::CaptureStderr();
        rods.integrator.step(4000);
        const string printed = testing::internal::GetCapturedStderr();
        EXPECT_EQ(holds(printed, "about its fastest axis"), forces == "drive") << printed;
        EXPECT_EQ(holds(rods.warnings(), "keep turning body"), forces == "drive")
            << rods.warnings();
    }
}

/**
 * One step in 200 may be redone without a warning. Here a weight presses a sphere to a wall that
 * does not repel it.
 */
TEST(Resolution, ManyRejectionsAreWarnedOf) {
    for (bool often : {true, false}) {
        FluidScene scene(T1, 0.02);
        scene.integrator.setScheme(RigidHI::RandomFiniteDifference);
        scene.fluid->setBoundary(MobilityForce::NoSlipWall);
        scene.add(sphereKind(0.5), Vec3(0, 0, 1));
        auto* weight = new CustomExternalForce(often ? "8*z" : "8*z+2*exp(-10*(z-0.5))/(z-0.5)");
        weight->addParticle(0, vector<double>());
        scene.system.addForce(weight);
        scene.start(testPlatform());
        testing::internal::CaptureStderr();
        scene.integrator.step(4000);
        const string printed = testing::internal::GetCapturedStderr();
        const int redone = scene.integrator.getNumRejectedSteps();
        EXPECT_EQ(holds(printed, "the scheme redoes "), often) << redone << printed;
        if (often)
            EXPECT_GT(redone, 20);
        else
            EXPECT_LT(redone, 20);
    }
}

/**
 * A trap of stiffness k relaxes a sphere of mobility mu in 1/(mu k). Averages in steps of a
 * twentieth of this time are right to a few percent. At T = 0 positions grow without bound in steps
 * of more than twice this time. (Devices keep forces up to 2e9 kJ/(mol nm) only.)
 */
TEST(Resolution, StiffForcesAreWarnedOf) {
    for (const SchemeTraits& traits : schemeTable)
        for (double temperature : {T1, 0.0})
            for (bool stiff : {false, true}) {
                if (!traits.isOverdamped()) continue;
                SCOPED_TRACE(string(traits.name) + (stiff ? ", stiff" : "") + " " +
                             to_string(temperature));
                const double h = 1e-3;
                FluidScene scene(temperature, h);
                scene.integrator.setScheme(traits.scheme);
                for (int i = 0; i < 3; i++) scene.add(sphereKind(0.5), Vec3(90 * i, 0, 0.1));
                auto* trap = new CustomExternalForce("0.5*k*((x-x0)^2+y^2+z^2)");
                const double ratio = stiff ? (temperature > 0 ? 1 : 2.1) : 0.05;
                trap->addGlobalParameter("k", ratio * 6 * M_PI * 0.6 * 0.5 / h);
                trap->addPerParticleParameter("x0");
                for (int i = 0; i < 3; i++) trap->addParticle(i, {90.0 * i});
                scene.system.addForce(trap);
                testing::internal::CaptureStderr();
                scene.start(testPlatform());
                scene.integrator.step(stiff && temperature == 0 ? 80 : 800);
                const string printed = testing::internal::GetCapturedStderr();
                EXPECT_EQ(holds(printed, "relaxes in the forces on it"), stiff) << printed;
                EXPECT_TRUE(!stiff || holds(printed, "take a step of about ")) << printed;
            }
}

/** Forces of a wall are stiff along one axis. Steps of a tenth of the relaxation resolve them. */
TEST(Resolution, ForcesThatAreStiffAlongOneAxisAreWarnedOf) {
    for (RigidHI::Scheme scheme : {RigidHI::FixmanMidpoint, RigidHI::EulerMaruyama})
        for (double ratio : {0.1, 1.0, 1.5, 1.9}) {
            SCOPED_TRACE("scheme " + to_string(scheme) + ", " + to_string(ratio));
            const double h = 1e-3;
            FluidScene sphere(T1, h);
            sphere.integrator.setScheme(scheme);
            sphere.add(sphereKind(0.5));
            auto* trap = new CustomExternalForce("0.5*k*(0.6*x+0.8*z)^2");
            trap->addGlobalParameter("k", ratio * 6 * M_PI * 0.6 * 0.5 / h);
            trap->addParticle(0, vector<double>());
            sphere.system.addForce(trap);
            sphere.start(testPlatform());
            sphere.integrator.step(4000);
            const string found = sphere.integrator.getEffects().at("warnings");
            EXPECT_EQ(holds(found, "relaxes in the forces on it"), ratio > 0.5) << found;
        }
}

/**
 * The torque k n x e, which holds the axis n of a body along e, is stiff, too: e_z, or e_x with the
 * body turned by 120 degrees about (1, 1, 1), where the frames of body and lab are different.
 */
TEST(Resolution, StiffTorquesAreWarnedOf) {
    for (bool turned : {false, true})
        for (bool stiff : {false, true}) {
            SCOPED_TRACE(string(turned ? "turned" : "") + (stiff ? " stiff" : ""));
            const double h = 1e-3, mu_r = 1 / (8 * M_PI * 0.6 * 0.125);
            FluidScene scene(T1, h);
            scene.integrator.setScheme(RigidHI::EulerMaruyama);
            scene.add(sphereKind(0.5));
            scene.add(
                sphereKind(0.5), Vec3(5, 0, 0),
                turned ? QuaternionArray{{0.5, 0.5, 0.5, 0.5}} : QuaternionArray{{1, 0, 0, 0}});
            const string nx = "2*(q1*q3+q0*q2)", ny = "2*(q2*q3-q0*q1)",
                         nz = "(q0^2-q1^2-q2^2+q3^2)";
            auto* spring = turned ? new CustomBodyForce("0", "0", "0", "0", "k*" + nz, "-k*" + ny)
                                  : new CustomBodyForce("0", "0", "0", "k*" + ny, "-k*" + nx, "0");
            spring->addGlobalParameter("k", (stiff ? 1.0 : 0.05) / (mu_r * h));
            spring->addBody(1, vector<double>());
            scene.system.addForce(spring);
            testing::internal::CaptureStderr();
            scene.start(testPlatform());
            scene.integrator.step(400);
            const string printed = testing::internal::GetCapturedStderr();
            EXPECT_EQ(holds(printed, "body 1 relaxes in the forces on it"), stiff) << printed;
        }
}

/**
 * In a harmonic trap the change of the force is exactly -k dx, whatever the scheme, the step, the
 * flow and the temperature, so the warning gives mu k h to the three digits of its text. (k was
 * chosen for the mobility of a sphere alone.) Without noise spheres come to rest within a few
 * steps, except near the limit of stability.
 */
TEST(Resolution, TheTimeOfRelaxationIsRight) {
    const double h = 1e-3;
    for (RigidHI::Scheme scheme :
         {RigidHI::EulerMaruyama, RigidHI::FixmanMidpoint, RigidHI::TrapezoidalSlip})
        for (double x : {0.6, 1.3, 1.9})
            for (const auto& [temperature, flow] :
                 {pair(T1, 0.0), pair(T1, 100.0), pair(0.0, 0.0), pair(0.0, 100.0)}) {
                SCOPED_TRACE("scheme " + to_string(scheme) + ", " + to_string(x) + " " +
                             to_string(temperature));
                if (temperature == 0 && x < 1.9) continue;
                FluidScene scene(temperature, h);
                scene.integrator.setScheme(scheme);
                auto* trap = new CustomExternalForce("0.5*k*((x-x0)^2+y^2+z^2)");
                trap->addGlobalParameter("k", x * 6 * M_PI * 0.6 * 0.5 / h);
                trap->addPerParticleParameter("x0");
                for (int i = 0; i < 3; i++) {
                    scene.add(sphereKind(0.5), Vec3(5000 * i, 0, 0.1));
                    trap->addParticle(i, {5000.0 * i});
                }
                scene.system.addForce(trap);
                scene.fluid->setBackgroundFlow(Vec3(flow, 0, 0), vector<double>(9, 0));
                testing::internal::CaptureStderr();
                scene.start(testPlatform());
                scene.integrator.step(800);
                testing::internal::GetCapturedStderr();
                const string text = scene.integrator.getEffects().at("warnings"), before = "ps is ";
                ASSERT_TRUE(holds(text, "relaxes in the forces on it")) << text;
                EXPECT_NEAR(stod(text.substr(text.find(before) + before.size())), x, 0.01 * x);
            }
}

/**
 * Forces that move spheres relative to each other by their radius in a step, and forces that move
 * all of them alike by ten radii, or one sphere alone.
 */
TEST(Resolution, LongDrivesAreWarnedOf) {
    struct Case {
        const char* name;
        int spheres;
        double apart, alike;  // displacements in a step, in radii
        bool warns;
    };
    const double h = 1e-3, a = 0.5;
    for (double temperature : {T1, 0.0})
        for (const Case& c : {Case{"apart", 3, 1, 0, true}, Case{"slowly apart", 3, 0.1, 0, false},
                              Case{"alike", 3, 0, 10, false}, Case{"alone", 1, 10, 0, false}}) {
            SCOPED_TRACE(string(c.name) + " " + to_string(temperature));
            FluidScene scene(temperature, h);
            scene.integrator.setScheme(RigidHI::TractionEulerMaruyama);
            const double force = 6 * M_PI * 0.6 * a * a / h;
            auto* field = new CustomExternalForce("-f*x");
            field->addPerParticleParameter("f");
            for (int i = 0; i < c.spheres; i++) {
                scene.add(sphereKind(a), Vec3(0, 200 * i, 0));
                field->addParticle(i, {force * (c.alike + (i - 1) * c.apart)});
            }
            scene.system.addForce(field);
            testing::internal::CaptureStderr();
            scene.start(testPlatform());
            scene.integrator.step(200);
            const string printed = testing::internal::GetCapturedStderr();
            EXPECT_EQ(holds(printed, "forces or slips move body "), c.warns) << printed;
            EXPECT_EQ(holds(printed, "Warning"), c.warns) << printed;
        }
}

/**
 * Spheres of a micrometre with a step of picoseconds. Longer steps, smaller spheres, forces that
 * move them, and scenes without noise are no case for the warning.
 */
TEST(Resolution, StepsInWhichNothingMovesAreWarnedOf) {
    struct Case {
        const char* name;
        double temperature, h, radius, force;
        bool warns;
    };
    const double water = 540, um = 1000;
    for (const Case& c : {Case{"micrometres and picoseconds", T1, 1, um, 0, true},
                          Case{"micrometres and microseconds", T1, 1e6, um, 0, false},
                          Case{"nanometres", T1, 0.002, 2, 0, false},
                          Case{"driven", T1, 1, um, 6 * M_PI * water * um * 0.1, false},
                          Case{"without noise", 0, 1, um, 0, false}}) {
        SCOPED_TRACE(c.name);
        FluidScene scene(c.temperature, c.h);
        scene.fluid->setViscosity(water);
        scene.integrator.setScheme(RigidHI::TractionEulerMaruyama);
        auto* field = new CustomExternalForce("-f*x");
        field->addGlobalParameter("f", c.force);
        for (int i = 0; i < 2; i++) {
            scene.add(sphereKind(c.radius), Vec3(0, 10 * c.radius * i, 0));
            field->addParticle(i, {});
        }
        scene.system.addForce(field);
        testing::internal::CaptureStderr();
        scene.start(testPlatform());
        scene.integrator.step(200);
        const string printed = testing::internal::GetCapturedStderr();
        EXPECT_EQ(holds(printed, "nothing moves by more than"), c.warns) << printed;
        EXPECT_EQ(holds(printed, "Warning"), c.warns) << printed;
    }
}

TEST(Resolution, StrainsOfAStepAreWarnedOf) {
    for (double strain : {0.4, 0.6}) {
        FluidScene scene(0, 0.01);
        scene.integrator.setScheme(RigidHI::EulerMaruyama);
        scene.add(sphereKind(0.5));
        vector<double> gradient(9, 0.0);
        gradient[1] = strain / 0.01;
        scene.fluid->setBackgroundFlow(Vec3(), gradient);
        testing::internal::CaptureStderr();
        scene.start(testPlatform());
        scene.integrator.step(5);
        const string printed = testing::internal::GetCapturedStderr();
        EXPECT_EQ(holds(printed, "strains the fluid by 0.6, above 0.5"), strain > 0.5) << printed;
    }
}
