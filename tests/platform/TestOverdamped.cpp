// Schemes without momenta by the public API: order without noise, exact averages, effects and
// counters, exact resume, and refused input. unit/TestOverdampedSchemes.cpp tests the drift and the
// covariance of one step, and TestOverdampedWall.cpp tests steps at a wall.

#include <openmm/CMMotionRemover.h>
#include <openmm/HarmonicBondForce.h>
#include <openmm/VirtualSite.h>
#include <openmm/serialization/XmlSerializer.h>

#include <functional>
#include <map>
#include <sstream>

#include "OverdampedSupport.h"
#include "openmmrigidhi/CustomBodyForce.h"
#include "schemes/OverdampedSchemes.h"

using namespace OpenMM;
using namespace RigidHITest;
using RigidHIPlugin::CustomBodyForce;
using RigidHIPlugin::schemeTable;
using RigidHIPlugin::traitsOf;
using namespace std;

// ---- Differences of iterated roots ----

/**
 * Drift correctors take differences of square roots that are known to the tolerance only. A step is
 * still right to about the tolerance, because these roots follow one course of iterations: their
 * difference is right to some hundred tolerances, relative to a drift factor nu - 1 below 0.3.
 */
TEST(Overdamped, DriftCorrectorsAreRightToTheTolerance) {
    SKIP_ON_SINGLE_PRECISION_DEVICES("positions are rounded");
    for (auto scheme : {RigidHI::DriftCorrectorFD, RigidHI::DriftCorrectorRFD}) {
        const auto move = [&](double tolerance, double difference) -> VectorXd {
            OverdampedScene scene(scheme, T1, 5e-3);
            scene.fluid->setSolver(MobilityForce::MatrixFree);
            scene.fluid->setSolverTolerance(tolerance);
            scene.integrator.setFiniteDifferenceStep(difference);
            scene.addMixture(true);
            scene.start(testPlatform());
            const VectorXd before = scene.state();
            scene.integrator.step(1);
            return scene.state() - before;
        };
        const VectorXd exact = move(1e-11, 1e-5);
        for (double tolerance : {1e-5, 1e-6, 1e-8}) {
            const double error = (move(tolerance, 0) - exact).norm() / exact.norm();
            cout << traitsOf(scheme).name << ": error " << error / tolerance << " tolerances\n";
            EXPECT_LT(error, (5 + 0.3 * 100) * tolerance) << traitsOf(scheme).name;
        }
    }
}

// ---- Without noise ----

/** A step at T = 0 needs the iterations of its solves only, and none for differences. */
TEST(Overdamped, ColdStepsIterateForTheirSolvesOnly) {
    const auto iterationsOf = [](RigidHI::Scheme scheme) {
        OverdampedScene scene(scheme, 0, 1e-9);
        scene.fluid->setSolver(MobilityForce::MatrixFree);
        scene.fluid->setSolverTolerance(1e-3);
        scene.addMixture(true);
        scene.start(testPlatform());
        scene.integrator.step(3);
        return scene.integrator.getStepStatistics().at("solverIterations");
    };
    const double once = iterationsOf(RigidHI::EulerMaruyama);
    EXPECT_GT(once, 0);
    for (const Named& s : schemes) EXPECT_LE(iterationsOf(s.scheme), s.forces * once) << s.name;
}

TEST(Overdamped, OrderWithoutNoise) {
    // The reference is a step 32 times finer with a second-order scheme, whose own error is 1e-3 of
    // that of the tested schemes.
    const double total = 1.6;
    const int steps = 64;
    for (bool wall : {false, true}) {
        OverdampedScene fine(RigidHI::FixmanMidpoint, 0, total / (32 * steps));
        fine.addMixture(wall);
        fine.start(testPlatform());
        fine.integrator.step(32 * steps);
        for (const Named& s : schemes) {
            double error[2];
            for (int k = 0; k < 2; k++) {
                OverdampedScene scene(s.scheme, 0, total / (steps << k));
                scene.addMixture(wall);
                scene.start(testPlatform());
                scene.integrator.step(steps << k);
                error[k] = (scene.state() - fine.state()).norm();
                const auto statistics = scene.integrator.getStepStatistics();
                EXPECT_EQ(statistics.at("randomNumbers"), 0) << s.name;
                EXPECT_EQ(statistics.at("squareRoots"), 0) << s.name;
                EXPECT_EQ(statistics.at("forceEvaluations"), s.forces * (steps << k)) << s.name;
                // The scheme makes one matrix for each configuration at which forces act.
                EXPECT_EQ(statistics.at("mobilityProducts"), s.forces * (steps << k)) << s.name;
            }
            EXPECT_NEAR(log2(error[0] / error[1]), s.order, 0.15) << s.name << " wall " << wall;
        }
    }
}

TEST(Overdamped, TimeDependentForcesAreTakenWhereTheSchemesTakeThem) {
    // A sphere is driven by sin(w t). It follows the exact path, with errors of the scheme's order.
    const double w = 3, total = 1;
    for (const Named& s : schemes) {
        double error[2];
        for (int k = 0; k < 2; k++) {
            const int steps = 100 << k;
            OverdampedScene scene(s.scheme, 0, total / steps);
            scene.addMassless(sphereKind(1));
            auto* drive = new CustomBodyForce("sin(3*t)", "0", "0", "0", "0", "cos(3*t)");
            drive->addBody(0, {});
            scene.system.addForce(drive);
            scene.start(testPlatform());
            scene.integrator.step(steps);
            const double mu = 1 / (6 * M_PI * scene.fluid->getViscosity());
            error[k] =
                abs(scene.integrator.getBodyPositions()[0][0] - mu * (1 - cos(w * total)) / w);
        }
        // Forces at the mid-point, as in the drift-corrector, make the order 2 here.
        const int order =
            RigidHIPlugin::overdampedScheme(s.scheme).forcesAt.back() == 0.5 ? 2 : s.order;
        EXPECT_NEAR(log2(error[0] / error[1]), order, 0.1) << s.name;
    }
}

TEST(Overdamped, VelocityIsMobilityTimesForce) {
    // Every row is compared, within the O(h) by which velocities change during the step.
    // getMobilityInContext() has no rows of free particles, and the forces on these act on bodies
    // too. So the mobility is the independently computed one, which is compared with
    // getMobilityInContext() where there are no free particles.
    const double h = 1e-7;
    for (const Named& s : schemes) {
        for (bool wall : {false, true}) {
            for (bool free : {false, true}) {
                SCOPED_TRACE(s.name + (wall ? ", wall" : "") + (free ? ", free particle" : ""));
                OverdampedScene scene(s.scheme, 0, h);
                scene.addMixture(wall, true, free);
                scene.start(testPlatform());
                const auto bodies = scene.labBodies();
                const MatrixXd N = scene.expected(bodies).mobility;
                if (!free) {
                    EXPECT_LT(difference(scene.mobility(), N), 1e-11);
                }
                const VectorXd twists = N * OverdampedScene::wrenchesOfWells(bodies);
                const auto R = scene.integrator.getBodyPositions();
                const auto q = scene.integrator.getBodyOrientations();
                const auto x = positionsOf(*scene.context);
                scene.integrator.step(1);
                const auto R1 = scene.integrator.getBodyPositions();
                const auto q1 = scene.integrator.getBodyOrientations();
                VectorXd found(twists.size());
                for (size_t b = 0; b < R.size(); b++) {
                    const Eigen::AngleAxisd turn(rotationOf(q1[b]) * rotationOf(q[b]).transpose());
                    found.segment(6 * b, 6) << toEigen(R1[b] - R[b]) / h,
                        turn.angle() / h * turn.axis();
                }
                if (free) {
                    const int p = scene.freeParticles[0];
                    found.tail(3) = toEigen(positionsOf(*scene.context)[p] - x[p]) / h;
                }
                // Positions of free particles are read from the Context, in the precision of its
                // platform.
                for (int i = 0; i < found.size(); i++)
                    EXPECT_NEAR(found[i], twists[i],
                                free && i >= found.size() - 3
                                    ? readTolerance(1e-6 * twists.norm(), 3 / h)
                                    : 1e-6 * twists.norm())
                        << "row " << i;
                // No velocity is so small that zero would pass the test.
                for (int i = 0; i < found.size(); i += 3)
                    EXPECT_GT(twists.segment(i, 3).norm(), 1e-2 * twists.norm()) << "row " << i;
            }
        }
    }
}

// ---- Averages ----

TEST(Overdamped, DipoleInAField) {
    // For U = -k n_z in units of kT the exact mean is <n_z> = coth k - 1/k. The body's origin is
    // not its centre of mobility, so N couples translation and rotation.
    const double k = 2, exact = 1 / tanh(k) - 1 / k;
    for (const Named& s : schemes) {
        if (s.scheme == RigidHI::EulerMaruyama) continue;
        OverdampedScene scene(s.scheme, T1, 0.02);
        const int replicas = 50, steps = 2000, discard = 300;
        vector<int> groups;
        // n = (2(q1q3+q0q2), 2(q2q3-q0q1), ...), torque = k n x e_z = k (n_y, -n_x, 0).
        auto* field = new CustomBodyForce("-0.5*x", "-0.5*y", "-0.5*z", "2*2*(q2*q3-q0*q1)",
                                          "-2*2*(q1*q3+q0*q2)", "0");
        for (int i = 0; i < replicas; i++) {
            scene.addMassless(boomerangKind(), Vec3(), OverdampedScene::randomTurn(i));
            field->addBody(i, {});
            groups.push_back(i);
        }
        scene.fluid->setGroups(groups);
        scene.fluid->setViscosity(0.2);
        scene.system.addForce(field);
        scene.start(testPlatform());
        scene.integrator.step(discard);
        vector<double> means(replicas, 0.0);
        for (int i = 0; i < steps; i++) {
            scene.integrator.step(1);
            const auto q = scene.integrator.getBodyOrientations();
            for (int b = 0; b < replicas; b++) means[b] += rotate(q[b], Vec3(0, 0, 1))[2] / steps;
        }
        // Bodies are independent. By weak order 1 the bias is 0.01 at this step.
        Estimate found = estimate(means);
        expectMean(s.name, found, exact);
        EXPECT_LT(found.error, 0.03);
    }
}

// ---- Effects ----

TEST(Overdamped, AConstantMobilityHasNoDifferences) {
    for (const Named& s : schemes) {
        OverdampedScene scene(s.scheme, T1);
        scene.addMassless(boomerangKind());
        scene.start(testPlatform());
        const auto before = scene.integrator.getStepStatistics();
        scene.integrator.step(10);
        const auto after = scene.integrator.getStepStatistics();
        const double numbers = after.at("randomNumbers") - before.at("randomNumbers");
        EXPECT_EQ(numbers, s.scheme == RigidHI::FixmanMidpoint ? 120 : 60) << s.name;
        EXPECT_EQ(scene.integrator.getEffects().at("momenta").substr(0, 3), "off");
        EXPECT_EQ(scene.integrator.computeTranslationalKineticEnergy(), 0);
    }
}

// ---- Spheres in an unbounded fluid, whose mobility has no divergence ----

namespace {

/** Unequal spheres and a free particle, two pairs of them overlapping. */
void addSpheres(OverdampedScene& scene) {
    scene.addMassless(sphereKind(1), Vec3(0, 0, 0), OverdampedScene::randomTurn(1));
    scene.addMassless(sphereKind(0.6), Vec3(1.1, 0.3, 0.2), OverdampedScene::randomTurn(2));
    scene.addMassless(sphereKind(0.8), Vec3(-1, 2.5, 0.4), OverdampedScene::randomTurn(3));
    scene.addFree(0, 0.5, Vec3(-0.2, 2, 0.1));
    scene.addWells("(x-1)^2 + 0.5*(y+1)^2 + 0.5*z^4 + 0.3*x*y");
}

}  // namespace

TEST(Overdamped, SpheresInFluidsWithoutWallsHaveNoDriftTerms) {
    const int steps = 3, numbers = 3 * 6 + 3;
    const struct {
        MobilityForce::Solver solver;
        MobilityForce::Model model;
        MobilityForce::Boundary boundary;
    } fluids[] = {
        {MobilityForce::Dense, MobilityForce::RotnePragerYamakawa, MobilityForce::Unbounded},
        {MobilityForce::MatrixFree, MobilityForce::RotnePragerYamakawa, MobilityForce::Unbounded},
        {MobilityForce::Dense, MobilityForce::RotnePragerYamakawa, MobilityForce::Periodic},
        {MobilityForce::Dense, MobilityForce::ForceCoupling, MobilityForce::Periodic}};
    for (const auto& fluid : fluids) {
        const auto solver = fluid.solver;
        VectorXd eulerMaruyama;
        map<string, double> itsStatistics;
        for (const Named& s : schemes) {
            SCOPED_TRACE(s.name + (solver == MobilityForce::Dense ? ", dense" : ", matrix-free"));
            OverdampedScene scene(s.scheme, 300, 1e-3);
            addSpheres(scene);
            scene.fluid->setSolver(solver);
            scene.fluid->setModel(fluid.model);
            scene.fluid->setBoundary(fluid.boundary);
            scene.start(testPlatform());
            const auto effects = scene.integrator.getEffects();
            EXPECT_EQ(effects.at("stochastic drift"),
                      string("off: the mobility of spheres in ") +
                          (scene.isPeriodic() ? "a periodic" : "an unbounded") +
                          " fluid has no divergence");
            EXPECT_EQ(effects.at("finite differences").substr(0, 4), "off:");
            EXPECT_EQ(effects.at("warnings"), "off: none");
            scene.integrator.step(steps);
            const auto statistics = scene.integrator.getStepStatistics();
            // The counters hold the random numbers and square roots of the noise. FixmanMidpoint
            // has them at the mid-point too.
            const bool isFixman = s.scheme == RigidHI::FixmanMidpoint;
            EXPECT_EQ(statistics.at("randomNumbers"), (isFixman ? 2 : 1) * numbers * steps);
            EXPECT_EQ(statistics.at("squareRoots"), (isFixman ? 2 : 1) * steps);
            EXPECT_EQ(statistics.at("forceEvaluations"), s.forces * steps);
            // There is one matrix at the start, and one at intermediate positions where forces are
            // evaluated.
            const bool inBetween = RigidHIPlugin::overdampedScheme(s.scheme).numStages() > 1;
            if (solver == MobilityForce::Dense) {
                EXPECT_EQ(statistics.at("mobilityProducts"), (inBetween ? 2 : 1) * steps);
                EXPECT_EQ(statistics.at("solverIterations"), 0);
            }
            // Without drift, RandomFiniteDifference and TractionEulerMaruyama are EulerMaruyama,
            // bit for bit.
            if (s.scheme == RigidHI::EulerMaruyama) {
                eulerMaruyama = scene.state();
                itsStatistics = statistics;
            }
            if (s.scheme != RigidHI::RandomFiniteDifference &&
                s.scheme != RigidHI::TractionEulerMaruyama)
                continue;
            EXPECT_EQ((scene.state() - eulerMaruyama).cwiseAbs().maxCoeff(), 0);
            for (const char* name : {"mobilityProducts", "solverIterations"})
                EXPECT_EQ(statistics.at(name), itsStatistics.at(name)) << name;
        }
    }
}

TEST(Overdamped, DriftIsOffOnlyWhereItIsZero) {
    // There is a drift with a sphere off its body's origin, an own tensor, a wall, lubrication, and
    // a multiblob beside a sphere.
    const vector<pair<string, function<void(OverdampedScene&)>>> changes = {
        {"off the origin",
         [](OverdampedScene& scene) {
             BodyKind sphere = sphereKind(0.8);
             sphere.sites[0] = Vec3(0.1, 0, 0);
             scene.addMassless(sphere, Vec3(0, 5, 0));
         }},
        {"own tensor",
         [](OverdampedScene& scene) {
             scene.fluid->setBodyMobility(0, rowsOf(tensorWithoutSymmetry(1)));
         }},
        {"wall",
         [](OverdampedScene& scene) {
             scene.fluid->setBoundary(MobilityForce::NoSlipWall);
             scene.fluid->setWallHeight(-3);
         }},
        {"lubrication",
         [](OverdampedScene& scene) { scene.fluid->setModel(MobilityForce::StokesianDynamics); }},
        {"lubrication in a box",
         [](OverdampedScene& scene) {
             scene.fluid->setModel(MobilityForce::StokesianDynamics);
             scene.fluid->setBoundary(MobilityForce::Periodic);
         }},
        {"multiblob in a box",
         [](OverdampedScene& scene) {
             scene.fluid->setBoundary(MobilityForce::Periodic);
             scene.addMassless(boomerangKind(), Vec3(0, 5, 0));
         }},
        {"multiblob",
         [](OverdampedScene& scene) { scene.addMassless(boomerangKind(), Vec3(0, 5, 0)); }}};
    for (const auto& change : changes)
        for (const Named& s : schemes) {
            SCOPED_TRACE(change.first + ", " + s.name);
            OverdampedScene scene(s.scheme, 300, 1e-3);
            scene.addMassless(sphereKind(1), Vec3(0, 0, 0));
            scene.addMassless(sphereKind(0.7), Vec3(2, 0.5, 0));
            change.second(scene);
            scene.start(testPlatform());
            const auto effects = scene.integrator.getEffects();
            const bool omits = s.scheme == RigidHI::EulerMaruyama;
            EXPECT_EQ(effects.at("stochastic drift").substr(0, 3), omits ? "off" : "on:");
            EXPECT_EQ(effects.at("stochastic drift").find("no divergence"), string::npos);
            EXPECT_EQ(effects.at("warnings").substr(0, 3), omits ? "on:" : "off");
        }
}

TEST(Overdamped, SpheresOnASpringHaveTheirDistance) {
    // Two unequal spheres on a spring of energy k r^2/2 have the exact <r^2> = 3 kT/k. At these
    // distances the spheres overlap, and their mobility changes most. Square roots at the mid-point
    // without the divergence of slips are 8 % off. Each of the other schemes is the same as one of
    // these here.
    const double k = 3, exact = 3 / k;
    for (Scheme scheme : {RigidHI::EulerMaruyama, RigidHI::FixmanMidpoint, RigidHI::TrapezoidalSlip,
                          RigidHI::DriftCorrectorRFD}) {
        OverdampedScene scene(scheme, T1, 0.04);
        const int replicas = 100, steps = 1500, discard = 50;
        vector<int> groups;
        auto* spring = new OpenMM::HarmonicBondForce();
        for (int i = 0; i < replicas; i++) {
            scene.addMassless(sphereKind(1), Vec3(0, 0, 0));
            scene.addMassless(sphereKind(0.6), Vec3(0.5, 0.5, 0.5));
            spring->addBond(2 * i, 2 * i + 1, 0, k);
            groups.insert(groups.end(), 2, i);
        }
        scene.fluid->setGroups(groups);
        scene.fluid->setViscosity(0.2);
        scene.system.addForce(spring);
        scene.start(testPlatform());
        scene.integrator.step(discard);
        vector<double> means(replicas, 0.0);
        for (int i = 0; i < steps; i++) {
            scene.integrator.step(1);
            const auto R = scene.integrator.getBodyPositions();
            for (int b = 0; b < replicas; b++) {
                const Vec3 r = R[2 * b + 1] - R[2 * b];
                means[b] += r.dot(r) / steps;
            }
        }
        // By weak order 1, Euler's method has a bias of 2 %.
        Estimate found = estimate(means);
        expectMean(string(traitsOf(scheme).name), found, exact);
        EXPECT_LT(found.error, 0.013 * exact);
    }
}

TEST(Overdamped, GroupsDoNotFeelEachOther) {
    // Two groups that are far apart in the list, but at one place, move at T = 0 as each of them
    // alone.
    for (const Named& s : schemes) {
        OverdampedScene both(s.scheme), one(s.scheme);
        both.addMassless(boomerangKind(), Vec3(0, 0, 1), OverdampedScene::randomTurn(1));
        both.addMassless(sphereKind(0.6), Vec3(1.5, 2, 1));
        both.addMassless(boomerangKind(), Vec3(0.1, 0, 1), OverdampedScene::randomTurn(1));
        both.fluid->setGroups({0, 0, 7});
        both.addWells("(x-1)^2+y^2+z^4");
        one.addMassless(boomerangKind(), Vec3(0.1, 0, 1), OverdampedScene::randomTurn(1));
        one.addWells("(x-1)^2+y^2+z^4");
        both.start(testPlatform());
        one.start(testPlatform());
        both.integrator.step(5);
        one.integrator.step(5);
        EXPECT_LT(
            norm(both.integrator.getBodyPositions()[2] - one.integrator.getBodyPositions()[0]),
            1e-12)
            << s.name;
    }
}

TEST(Overdamped, MatrixFreeIsDenseWithoutNoise) {
    for (const Named& s : schemes) {
        VectorXd states[2];
        for (int k = 0; k < 2; k++) {
            OverdampedScene scene(s.scheme, 0, 0.05);
            scene.addMixture(true);
            scene.fluid->setSolver(k == 0 ? MobilityForce::Dense : MobilityForce::MatrixFree);
            scene.fluid->setSolverTolerance(1e-7);
            scene.start(testPlatform());
            const VectorXd before = scene.state();
            scene.integrator.step(1);
            states[k] = scene.state() - before;
        }
        EXPECT_LT((states[0] - states[1]).norm(), 5e-7 * states[0].norm()) << s.name;
    }
}

namespace {

/** Two multiblobs, a rod and a sphere above a wall, with or without masses. */
struct AnswerScene : FluidScene {
    AnswerScene(bool massive, MobilityForce::Solver solver, double tolerance) {
        integrator.setScheme(massive ? RigidHI::LangevinHI : RigidHI::FixmanMidpoint);
        vector<BodyKind> kinds = {boomerangKind(), boomerangKind(), rodKind(), sphereKind(0.6)};
        for (size_t b = 0; b < kinds.size(); b++) {
            if (!massive) {
                kinds[b].mass = 0;
                kinds[b].moments = Vec3();
            }
            add(kinds[b], Vec3(2.5 * b, 0.4 * b, 3), OverdampedScene::randomTurn(b));
        }
        addFree(massive ? 1 : 0, 0.5, Vec3(1, 3, 2));
        fluid->setBoundary(MobilityForce::NoSlipWall);
        fluid->setSolver(solver);
        fluid->setSolverTolerance(tolerance);
        start(testPlatform());
    }
    vector<double> twists() {
        vector<double> wrenches(24);
        for (int i = 0; i < 24; i++) wrenches[i] = sin(1 + i);
        // Nothing resists a torque about the rod's line.
        for (int i = 15; i < 18; i++) wrenches[i] = 0;
        return fluid->applyMobilityInContext(*context, wrenches);
    }
};

}  // namespace

TEST(Overdamped, AnswersDoNotDependOnMasses) {
    for (auto solver : {MobilityForce::Auto, MobilityForce::Dense, MobilityForce::MatrixFree}) {
        const double tolerance = 1e-3;
        AnswerScene massless(false, solver, tolerance), massive(true, solver, tolerance);
        const auto found = massless.twists();
        // The answers agree up to the rounding of the rotation to the axes of inertia. So both
        // scenes take the same path of computation.
        const auto withMasses = massive.twists();
        for (int i = 0; i < 24; i++) EXPECT_NEAR(found[i], withMasses[i], 1e-12);
        for (AnswerScene* scene : {&massless, &massive}) {
            const string effect = scene->integrator.getEffects().at("mobilities asked for");
            EXPECT_EQ(effect,
                      solver == MobilityForce::MatrixFree
                          ? "on: applyMobilityInContext() does 1 group by iterations to 0.001; "
                            "getMobilityInContext() 1 group by dense matrices; "
                            "getFrictionInContext() 1 group by "
                            "dense matrices"
                          : "on: applyMobilityInContext() does 1 group by dense matrices; "
                            "getMobilityInContext() 1 group by dense matrices; "
                            "getFrictionInContext() 1 group by "
                            "dense matrices");
        }
        // Iterations have an error below the tolerance in the norm of the friction. They stop at
        // this error, which is not zero.
        AnswerScene exact(false, MobilityForce::Dense, tolerance);
        const auto expected = exact.twists();
        const VectorXd error = Eigen::Map<const VectorXd>(found.data(), 24) -
                               Eigen::Map<const VectorXd>(expected.data(), 24);
        const double norm = Eigen::Map<const VectorXd>(expected.data(), 24).norm();
        EXPECT_LT(error.norm(), 5 * tolerance * norm);
        EXPECT_EQ(error.norm() > 1e-9 * norm, solver == MobilityForce::MatrixFree);
    }
}

TEST(Overdamped, EffectsSayHowQuestionsAreAnswered) {
    OverdampedScene spheres(RigidHI::FixmanMidpoint);
    spheres.addMassless(sphereKind(1));
    spheres.addMassless(sphereKind(0.6), Vec3(3, 0, 0));
    spheres.addMassless(boomerangKind(), Vec3(0, 5, 0));
    spheres.fluid->setGroups({0, 0, 1});
    spheres.start(testPlatform());
    EXPECT_EQ(spheres.integrator.getEffects().at("mobilities asked for"),
              "on: applyMobilityInContext() does 1 group by a constant tensor, 1 group by products "
              "without a matrix; "
              "getMobilityInContext() 1 group by a constant tensor, 1 group by dense matrices; "
              "getFrictionInContext() "
              "1 group "
              "by a constant tensor, 1 group by dense matrices");
}

TEST(Overdamped, ColumnsOfManyBlobs) {
    // A block of 864 blobs is above a wall. The platform decides whether the mobility is computed
    // by iterations, but its numbers change by no more than the tolerance.
    const double tolerance = 1e-4;
    MatrixXd N[2];
    for (int k = 0; k < 2; k++) {
        OverdampedScene scene(RigidHI::FixmanMidpoint);
        BodyKind block = {"block", 0, Vec3(), {}, {}};
        for (int i = 0; i < 864; i++) {
            block.sites.push_back(Vec3(i % 12 - 5.5, i / 12 % 12 - 5.5, i / 144 - 2.3));
            block.radii.push_back(0.5);
        }
        scene.addMassless(block, Vec3(0, 0, 9));
        scene.fluid->setBoundary(MobilityForce::NoSlipWall);
        scene.fluid->setSolver(k == 0 ? MobilityForce::Dense : MobilityForce::MatrixFree);
        scene.fluid->setSolverTolerance(tolerance);
        scene.start(testPlatform());
        N[k] = scene.mobility();
        const bool byColumns = k == 1 && (onCpu() || onDevice());
        EXPECT_NE(scene.integrator.getEffects()
                      .at("mobilities asked for")
                      .find(byColumns ? "getMobilityInContext() 1 group by iterations to 0.0001, "
                                        "column by column;"
                                      : "getMobilityInContext() 1 group by dense matrices;"),
                  string::npos);
        EXPECT_EQ(N[k], N[k].transpose().eval());
        EXPECT_EQ(k == 1 && difference(N[1], N[0]) > 0, byColumns);
    }
    // Rows of rotations are smaller by a factor of the body's length.
    EXPECT_LT(difference(N[1].topLeftCorner(3, 3), N[0].topLeftCorner(3, 3)), tolerance);
    EXPECT_LT(difference(N[1].bottomRightCorner(3, 3), N[0].bottomRightCorner(3, 3)), tolerance);
}

TEST(Overdamped, SmallDifferencesOfIterationsAreNotRounding) {
    // At this tolerance products within iterations may be in single precision. With a
    // finite-difference step of 1e-6, their error of 1e-7 would make 6 to 16 % of the drift. In a
    // step so long that noise is negligible beside it, the drift is that of exact matrices, from
    // the same random directions.
    const double h = 1e9, tolerance = 1e-3;
    const auto velocities = [&](Scheme scheme, MobilityForce::Solver solver,
                                double solverTolerance) {
        OverdampedScene scene(scheme, 300, h);
        for (int b = 0; b < 6; b++)
            scene.addMassless(boomerangKind(), Vec3(2.5 * (b % 2), 2.7 * (b / 2), 0.3 * b),
                              OverdampedScene::randomTurn(b));
        scene.fluid->setSolver(solver);
        scene.fluid->setSolverTolerance(solverTolerance);
        scene.integrator.setFiniteDifferenceStep(1e-6);
        scene.start(testPlatform());
        const auto before = scene.integrator.getBodyPositions();
        scene.integrator.step(1);
        const auto after = scene.integrator.getBodyPositions();
        // Translations only: bodies turn too often.
        VectorXd result(3 * before.size());
        for (size_t b = 0; b < before.size(); b++)
            result.segment(3 * b, 3) = toEigen(after[b] - before[b]) / h;
        return result;
    };
    // Finite differences are those of iterations to a tenth of the tolerance. Dense roots have
    // other noise, so the drift-corrector is compared with fine iterations. Its divergence is less
    // exact than its roots.
    const struct {
        Scheme scheme;
        MobilityForce::Solver exactSolver;
        double bound;
    } cases[] = {{RigidHI::RandomFiniteDifference, MobilityForce::Dense, tolerance},
                 {RigidHI::DriftCorrectorRFD, MobilityForce::MatrixFree, 50 * tolerance}};
    for (const auto& c : cases) {
        const VectorXd exact = velocities(c.scheme, c.exactSolver, 1e-9),
                       found = velocities(c.scheme, MobilityForce::MatrixFree, tolerance);
        EXPECT_GT((found - exact).norm(), 0);
        EXPECT_LT((found - exact).norm(), c.bound * exact.norm()) << c.scheme;
    }
}

// ---- Living with OpenMM ----

TEST(Overdamped, ResumesBitForBit) {
    for (const Named& s : schemes) {
        OverdampedScene whole(s.scheme, 300), part(s.scheme, 300);
        for (OverdampedScene* scene : {&whole, &part}) {
            scene->addMixture(true);
            scene->start(testPlatform());
        }
        whole.integrator.step(12);
        part.integrator.step(5);
        stringstream checkpoint;
        part.context->createCheckpoint(checkpoint);
        part.integrator.step(3);
        part.context->loadCheckpoint(checkpoint);
        part.integrator.step(7);
        EXPECT_EQ((whole.state() - part.state()).cwiseAbs().maxCoeff(), 0) << s.name;

        // An XML integrator carries scheme, finite-difference step and bodies.
        whole.integrator.setFiniteDifferenceStep(3e-4);
        unique_ptr<RigidHI> copy(XmlSerializer::clone(whole.integrator));
        EXPECT_EQ(copy->getScheme(), s.scheme);
        EXPECT_EQ(copy->getFiniteDifferenceStep(), 3e-4);
    }
}

TEST(Overdamped, SchemeMayChangeBetweenSteps) {
    OverdampedScene scene(RigidHI::TrapezoidalSlip, 300);
    scene.addMixture(false);
    scene.start(testPlatform());
    for (const Named& s : schemes) {
        scene.integrator.setScheme(s.scheme);
        scene.integrator.step(2);
    }
    EXPECT_EQ(scene.integrator.getStepStatistics().at("steps"), 2 * schemes.size());
    EXPECT_TRUE(isfinite(scene.state().norm()));
}

TEST(Overdamped, MasslessBodiesFromPositions) {
    // The body frame is the principal frame of equal weights, its origin the centroid; inertia is
    // zero.
    OverdampedScene scene(RigidHI::RandomFiniteDifference, 300);
    const vector<Vec3> places = {Vec3(0, 0, 0), Vec3(2, 0, 0), Vec3(0, 1.5, 0), Vec3(0.3, 0, 1)};
    vector<int> members;
    for (const Vec3& x : places) {
        members.push_back(scene.system.addParticle(0));
        scene.fluid->addParticle(0.5);
        scene.positions.push_back(x);
    }
    scene.integrator.addRigidBody(members);
    scene.start(testPlatform());
    Vec3 centroid;
    for (const Vec3& x : places) centroid += x * 0.25;
    EXPECT_LT(norm(scene.integrator.getBodyPositions()[0] - centroid), readTolerance(1e-14, 2));
    scene.integrator.step(20);
    const auto x = positionsOf(*scene.context);
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < i; j++)
            EXPECT_NEAR(norm(x[i] - x[j]), norm(places[i] - places[j]), readTolerance(1e-12, 2));
    // Schemes with momenta need masses, also of free particles.
    scene.integrator.setScheme(RigidHI::LangevinHI);
    expectError([&] { scene.integrator.step(1); },
                {"body 0 has mass 0", "LangevinHI needs a positive mass"});
}

// ---- What is refused ----

TEST(Overdamped, Refused) {
    for (const Named& s : schemes) {
        OverdampedScene unseen(s.scheme), remover(s.scheme), barostat(s.scheme),
            velocities(s.scheme), constraint(s.scheme);
        unseen.addMixture(false);
        unseen.addFree(5, 0, Vec3(0, 9, 9));
        expectError([&] { unseen.start(testPlatform()); },
                    {"particle", "is in no body and has hydrodynamic radius 0, so scheme " + s.name,
                     "hold it where it is by setParticleHeld()"});
        remover.addMixture(false);
        remover.system.addForce(new CMMotionRemover());
        expectError([&] { remover.start(testPlatform()); },
                    {"CMMotionRemover", s.name, "no momenta to remove"});
        velocities.addMixture(false);
        auto* drag = new CustomBodyForce("-vx", "0", "0", "0", "0", "0");
        drag->addBody(0, {});
        velocities.system.addForce(drag);
        expectError([&] { velocities.start(testPlatform()); },
                    {"depends on vx, vy or vz", s.name + " has no velocities"});
        constraint.addMixture(false);
        constraint.addFree(1, 0.2, Vec3(9, 9, 9));
        constraint.addFree(1, 0.2, Vec3(9, 9, 8));
        constraint.system.addConstraint(constraint.freeParticles[1], constraint.freeParticles[2],
                                        1);
        expectError([&] { constraint.start(testPlatform()); },
                    {"constraints between particles that are in no body", s.name});

        System system;
        system.addParticle(1);
        RigidHI integrator(300, 0.01);
        integrator.setScheme(s.scheme);
        integrator.addRigidBody({0}, 0, Vec3(), {Vec3()});
        expectError([&] { Context context(system, integrator, testPlatform()); },
                    {"0 MobilityForces, but scheme " + s.name + " needs exactly one"});
    }
}

TEST(Overdamped, LangevinNeedsMassesOfFreeParticles) {
    FluidScene scene;
    scene.add(sphereKind(1));
    scene.addFree(0, 0.4, Vec3(0, 5, 0));
    expectError([&] { scene.start(testPlatform()); },
                {"particle 1 has hydrodynamic radius 0.4",
                 "which scheme LangevinHI needs; give it a mass"});
    // A virtual site moves with other particles.
    OverdampedScene site(RigidHI::EulerMaruyama);
    site.addMassless(sphereKind(1));
    site.addFree(0, 0.5, Vec3(3, 0, 0));
    site.addFree(0, 0.5, Vec3(4, 0, 0));
    site.addFree(0, 0.5, Vec3(3.5, 0, 0));
    site.system.setVirtualSite(3, new OpenMM::TwoParticleAverageSite(1, 2, 0.5, 0.5));
    expectError([&] { site.start(testPlatform()); },
                {"particle 3 has hydrodynamic radius 0.5",
                 "is a virtual site in no body, which the fluid cannot move"});
}

TEST(Overdamped, Settings) {
    RigidHI integrator(300, 0.01);
    EXPECT_EQ(integrator.getFiniteDifferenceStep(), 0);
    for (double bad : {-1e-3, 0.2, double(NAN)})
        expectError([&] { integrator.setFiniteDifferenceStep(bad); },
                    {"setFiniteDifferenceStep()", "relative step"});
    expectError([&] { integrator.setFiniteDifferenceStep(0.2); }, {"must not be above 0.1"});
    const int beyond = size(schemeTable);
    expectError([&] { integrator.setScheme(Scheme(beyond)); },
                {"scheme " + to_string(beyond) + " is unknown", "DriftCorrectorRFD"});
}

TEST(Overdamped, MessagesNameTheToleranceThatWasSet) {
    // Solutions whose differences are taken are solved to a tenth of the tolerance.
    int seen = 0;
    for (const Named& s : schemes) {
        OverdampedScene scene(s.scheme, T1);
        for (int b = 0; b < 4; b++) scene.addMassless(boomerangKind(), Vec3(1.2 * b, 0, 0));
        scene.fluid->setSolver(MobilityForce::MatrixFree);
        scene.fluid->setSolverTolerance(1e-14);
        scene.start(testPlatform());
        try {
            scene.integrator.step(5);
        } catch (const OpenMM::OpenMMException& error) {
            cout << s.name << ": " << error.what() << endl;
            EXPECT_NE(string(error.what()).find("the tolerance of 1e-14"), string::npos)
                << error.what();
            seen++;
        }
    }
    EXPECT_GT(seen, 0);
}

/**
 * Spheres have neighbours on all sides that are nearer than the finite-difference step, so the
 * model refuses displacements in both directions.
 */
TEST(Overdamped, FiniteDifferencesThatLeadNowhere) {
    for (Scheme scheme : {RigidHI::RandomFiniteDifference, RigidHI::TractionEulerMaruyama,
                          RigidHI::TrapezoidalSlip, RigidHI::DriftCorrectorRFD}) {
        OverdampedScene scene(scheme, T1, 1e-12);
        scene.fluid->setModel(MobilityForce::StokesianDynamics);
        scene.integrator.setFiniteDifferenceStep(0.1);
        const double d = 2 + 1e-7;
        for (const Vec3& x : {Vec3(0, 0, 0), Vec3(1, 1, 0), Vec3(1, 0, 1), Vec3(0, 1, 1),
                              Vec3(2, 0, 0), Vec3(-1, 1, 0)})
            scene.addMassless(sphereKind(1), x * (d / sqrt(2.0)));
        scene.start(testPlatform());
        expectError([&] { scene.integrator.step(1); },
                    {"finite difference of the stochastic drift leads in both directions to "
                     "positions where the model has no mobility",
                     "use a smaller setFiniteDifferenceStep()"});
    }
}

TEST(Overdamped, ATorqueAboutARodsLine) {
    for (const Named& s : schemes) {
        OverdampedScene scene(s.scheme);
        scene.addMassless(rodKind());
        scene.addMassless(sphereKind(0.3), Vec3(3, 0, 0));
        auto* twist = new CustomBodyForce("0", "0", "0", "0", "0", "0.1");
        twist->addBody(0, {});
        scene.system.addForce(twist);
        scene.start(testPlatform());
        expectError([&] { scene.integrator.step(1); },
                    {"body 0: a torque of", "about the line of its hydrodynamic particles"});
    }
}

/** A particle with neither mass nor radius stays where it is, and one with a radius moves. */
TEST(Overdamped, ParticlesWithoutMassAndRadiusDoNotMove) {
    for (const Named& s : schemes) {
        OverdampedScene scene(s.scheme, T1);
        scene.addFree(0, 0, Vec3(1, 2, 3));
        scene.addFree(0, 0.5, Vec3(5, 0, 0));
        scene.addMassless(sphereKind(0.6));
        scene.addWells("x^2+y^2+z^2");
        scene.start(testPlatform());
        scene.integrator.step(5);
        const auto x = positionsOf(*scene.context);
        EXPECT_EQ(norm(x[0] - Vec3(1, 2, 3)), 0) << s.name;
        EXPECT_GT(norm(x[1] - Vec3(5, 0, 0)), 0) << s.name;
    }
}
