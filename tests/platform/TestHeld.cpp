// Held bodies and particles under schemes without momenta, by the public API.

#include "OverdampedSupport.h"
#include "openmmrigidhi/ModelTraits.h"

using namespace OpenMM;
using namespace RigidHITest;
using namespace std;

namespace {

/** Two obstacles, a particle that is held, and bodies and a particle that move among them. */
unique_ptr<OverdampedScene> obstacles(RigidHI::Scheme scheme, double temperature, double h,
                                      const function<void(OverdampedScene&)>& change = {},
                                      int threads = 1) {
    auto scene = make_unique<OverdampedScene>(scheme, temperature, h);
    scene->fluid->setBoundary(MobilityForce::NoSlipWall);
    scene->addMassless(boomerangKind(), Vec3(0, 0, 4), {{0.8, 0, 0.6, 0}});
    scene->addMassless(sphereKind(0.7), Vec3(3, 0, 3));
    scene->addMassless(boomerangKind(), Vec3(0, 4, 3.5), {{0.6, 0.8, 0, 0}});
    scene->addMassless(rodKind(), Vec3(-3, 0, 3));
    scene->addFree(0, 0.4, Vec3(2, 2.5, 4));
    scene->addFree(0, 0.5, Vec3(-2, 3, 5));
    scene->integrator.setBodyHeld(1, true);
    scene->integrator.setBodyHeld(2, true);
    scene->integrator.setParticleHeld(scene->freeParticles[1], true);
    scene->addWells("2*(x^2 + (y - 1)^2 + (z - 4)^2) + x*y");
    if (change) change(*scene);
    scene->start(testPlatform(), threads);
    return scene;
}

/** What is at rest: poses of the held bodies, and the particles of all that is held. */
vector<double> heldPlaces(OverdampedScene& scene) {
    vector<double> numbers;
    const auto R = scene.integrator.getBodyPositions();
    const auto q = scene.integrator.getBodyOrientations();
    const auto x = positionsOf(*scene.context);
    const auto add = [&](const Vec3& v) {
        for (int k = 0; k < 3; k++) numbers.push_back(v[k]);
    };
    for (int b : {1, 2}) {
        add(R[b]);
        numbers.insert(numbers.end(), q[b].begin(), q[b].end());
        for (int p : scene.particles[b]) add(x[p]);
    }
    add(x[scene.freeParticles[1]]);
    return numbers;
}

/** N_c of the bodies, from the friction of all of them. */
MatrixXd mobilityBesideHeld(const MatrixXd& friction, const vector<bool>& held) {
    vector<int> freeRows;
    for (size_t b = 0; b < held.size(); b++)
        for (int k = 0; k < 6 && !held[b]; k++) freeRows.push_back(6 * b + k);
    const MatrixXd own = friction(freeRows, freeRows);
    MatrixXd N = MatrixXd::Zero(friction.rows(), friction.cols());
    const MatrixXd inverse = own.inverse();
    N(freeRows, freeRows) = inverse;
    return N;
}

}  // namespace

TEST(Held, StaysWhereItIsBitForBit) {
    for (const Named& s : schemes) {
        const auto scene = obstacles(s.scheme, T1, 1e-3);
        const auto before = heldPlaces(*scene);
        const auto all = scene->state();
        scene->integrator.step(20);
        EXPECT_EQ(heldPlaces(*scene), before) << s.name;
        EXPECT_GT((scene->state() - all).norm(), 1e-3) << s.name;
    }
}

TEST(Held, TheMobilityIsThatBesideWhatIsHeld) {
    for (auto solver : {MobilityForce::Dense, MobilityForce::MatrixFree}) {
        const auto scene = obstacles(RigidHI::TrapezoidalSlip, 0, 1e-3, [&](OverdampedScene& s) {
            s.fluid->setSolver(solver);
            s.fluid->setSolverTolerance(1e-9);
            // Rods have a generalised inverse, which is tested with FreeMotion.
            s.integrator.setBodyHeld(3, true);
        });
        const MatrixXd N = scene->mobility(),
                       expected = mobilityBesideHeld(scene->friction(), {false, true, true, true});
        // Of the free particle, which is force-free in both, the friction is Schur's complement.
        EXPECT_LT((N - expected).norm(), 1e-8 * expected.norm()) << solver;
        EXPECT_EQ(N.bottomRows(18).norm(), 0);
        EXPECT_EQ(N.rightCols(18).norm(), 0);
    }
}

TEST(Held, MatricesAndProductsTakeTheSameStep) {
    for (const Named& s : schemes) {
        VectorXd end[2];
        vector<double> holds[2];
        for (bool matrixFree : {false, true}) {
            const auto scene = obstacles(s.scheme, 0, 1e-3, [&](OverdampedScene& own) {
                own.fluid->setSolver(matrixFree ? MobilityForce::MatrixFree : MobilityForce::Dense);
                own.fluid->setSolverTolerance(1e-8);
            });
            scene->integrator.step(3);
            end[matrixFree] = scene->state();
            holds[matrixFree] = scene->integrator.getHoldingWrenches();
        }
        EXPECT_LT((end[1] - end[0]).norm(), 1e-6) << s.name;
        double largest = 0;
        for (size_t i = 0; i < holds[0].size(); i++) {
            largest = max(largest, abs(holds[0][i]));
            EXPECT_NEAR(holds[1][i], holds[0][i], 1e-4) << s.name << " " << i;
        }
        EXPECT_GT(largest, 1) << s.name;
    }
}

/** A body that is pulled drags the fluid: beside a sphere at the distance r the wrench that holds
 * it is -m times the force, m = (3/2r)(1 - 2/(3r^2)) in radii. */
TEST(Held, TheForceThatHoldsASphereBesideAPulledOne) {
    const double exact[][2] = {{2.5, 0}, {3, 0}, {4, 0}};
    for (const auto& row : exact) {
        const double r = row[0], m = 1.5 / r * (1 - 2 / (3 * r * r));
        OverdampedScene scene(RigidHI::EulerMaruyama, 0, 1e-4);
        scene.fluid->setViscosity(1 / (6 * M_PI));
        scene.addMassless(sphereKind(1), Vec3());
        scene.addMassless(sphereKind(1), Vec3(r, 0, 0));
        scene.integrator.setBodyHeld(0, true);
        auto* pull = new CustomExternalForce("-x");
        pull->addParticle(scene.particles[1][0], {});
        scene.system.addForce(pull);
        scene.start(testPlatform());
        const MatrixXd N = scene.mobility();
        EXPECT_NEAR(N(6, 6), 1 - m * m, 1e-12);
        const auto now = scene.integrator.computeHoldingWrenches();
        EXPECT_NEAR(now[0], -m, 1e-12);
        for (int k = 1; k < 12; k++) EXPECT_NEAR(now[k], 0, 1e-12) << k;
        scene.integrator.step(1);
        EXPECT_NEAR(scene.integrator.getBodyPositions()[1][0] - r, 1e-4 * (1 - m * m), 1e-14);
        const auto last = scene.integrator.getHoldingWrenches();
        for (int k = 0; k < 12; k++) EXPECT_NEAR(last[k], now[k], 1e-12) << k;
    }
}

TEST(Held, ForcesOnWhatIsHeldChangeTheHoldOnly) {
    VectorXd end[2];
    vector<double> holds[2];
    vector<Vec3> forces[2];
    for (bool pulled : {false, true}) {
        const auto scene = obstacles(RigidHI::TrapezoidalSlip, T1, 1e-3, [&](OverdampedScene& own) {
            auto* pull = new CustomExternalForce("-5*x + 3*y");
            pull->addParticle(own.particles[1][0], {});
            pull->addParticle(own.freeParticles[1], {});
            if (pulled)
                own.system.addForce(pull);
            else
                delete pull;
        });
        scene->integrator.step(1);
        end[pulled] = scene->state();
        holds[pulled] = scene->integrator.getHoldingWrenches();
        forces[pulled] = scene->integrator.getParticleHoldingForces();
    }
    EXPECT_EQ(end[0], end[1]);
    const double scale = abs(holds[0][6]) + 1;
    EXPECT_NEAR(holds[1][6] - holds[0][6], -5, 1e-9 * scale);
    EXPECT_NEAR(holds[1][7] - holds[0][7], 3, 1e-9 * scale);
    EXPECT_NEAR(forces[1].back()[0] - forces[0].back()[0], -5, 1e-9 * scale);
    EXPECT_EQ(forces[0][0], Vec3());
}

TEST(Held, EveryModelAndBoundary) {
    for (const auto& model : RigidHIPlugin::modelTable)
        for (const auto& boundary : RigidHIPlugin::boundaryTable) {
            if (!model.hasBoundary(boundary.boundary)) continue;
            OverdampedScene scene(RigidHI::RandomFiniteDifference, T1, 1e-3);
            scene.fluid->setModel(model.model);
            scene.fluid->setBoundary(boundary.boundary);
            // Where matrices are made of products on a grid, any grid and any box will do.
            scene.fluid->setChannelWalls(-1.5, 4.5);
            scene.side = 6.5;
            scene.fluid->setSolverTolerance(0.1);
            for (int i = 0; i < 4; i++)
                scene.addMassless(sphereKind(0.5 + 0.1 * i), Vec3(2.2 * (i % 2), 2.3 * (i / 2), 2));
            scene.integrator.setBodyHeld(1, true);
            scene.integrator.setBodyHeld(2, true);
            scene.start(testPlatform());
            const auto R = scene.integrator.getBodyPositions();
            const MatrixXd N = scene.mobility(), expected = mobilityBesideHeld(
                                                     scene.friction(), {false, true, true, false});
            EXPECT_LT((N - expected).norm(), 1e-8 * expected.norm())
                << model.name << " " << boundary.name;
            scene.integrator.step(2);
            const auto after = scene.integrator.getBodyPositions();
            for (int b = 0; b < 4; b++)
                EXPECT_EQ(after[b] == R[b], b == 1 || b == 2) << model.name << " " << boundary.name;
        }
}

TEST(Held, ResumesBitForBitWithWhatHeldIt) {
    for (auto scheme : {RigidHI::TrapezoidalSlip, RigidHI::DriftCorrectorRFD}) {
        expectToResumeBitForBit<OverdampedScene>(
            [&](int threads) { return obstacles(scheme, T1, 1e-3, {}, threads); },
            [](OverdampedScene& scene) { scene.integrator.step(3); }, 4);
        const auto once = obstacles(scheme, T1, 1e-3), again = obstacles(scheme, T1, 1e-3),
                   byXml = obstacles(scheme, T1, 1e-3);
        once->integrator.step(3);
        stringstream checkpoint, xml;
        saveState(*once->context, checkpoint, xml);
        again->context->loadCheckpoint(checkpoint);
        loadState(*byXml->context, xml);
        EXPECT_EQ(again->integrator.getHoldingWrenches(), once->integrator.getHoldingWrenches());
        EXPECT_EQ(byXml->integrator.getHoldingWrenches(), once->integrator.getHoldingWrenches());
        EXPECT_EQ(byXml->integrator.getParticleHoldingForces(),
                  once->integrator.getParticleHoldingForces());
    }
}

TEST(Held, FlagsMayChangeBetweenSteps) {
    const auto changed = obstacles(RigidHI::TrapezoidalSlip, T1, 1e-3),
               letGo = obstacles(RigidHI::TrapezoidalSlip, T1, 1e-3, [](OverdampedScene&scene) {
                   scene.integrator.setBodyHeld(1, false);
                   scene.integrator.setBodyHeld(0, true);
               });
    changed->integrator.setBodyHeld(1, false);
    changed->integrator.setBodyHeld(0, true);
    changed->integrator.step(4);
    letGo->integrator.step(4);
    EXPECT_EQ(changed->state(), letGo->state());
    changed->integrator.setBodyHeld(3, true);
    expectError([&] { changed->integrator.getHoldingWrenches(); },
                {"getHoldingWrenches() needs a step since bodies were held or let go"});
}

TEST(Held, IsSaidAndWarnedOf) {
    const auto scene = obstacles(RigidHI::TrapezoidalSlip, T1, 1e-3);
    auto effects = scene->integrator.getEffects();
    EXPECT_EQ(effects["held bodies"], "on: 2 bodies and 1 particle: the fluid is at rest on them");
    EXPECT_EQ(effects["stochastic drift"].substr(0, 3), "on:");
    // Spheres have a drift beside a held one, which EulerMaruyama omits.
    OverdampedScene spheres(RigidHI::EulerMaruyama, T1, 1e-3);
    spheres.addMassless(sphereKind(1), Vec3());
    spheres.addMassless(sphereKind(1), Vec3(3, 0, 0));
    spheres.start(testPlatform());
    EXPECT_EQ(spheres.integrator.getEffects()["warnings"], "off: none");
    spheres.integrator.setBodyHeld(1, true);
    spheres.integrator.step(1);
    effects = spheres.integrator.getEffects();
    EXPECT_NE(effects["stochastic drift"].find("EulerMaruyama omits it"), string::npos);
    EXPECT_NE(effects["warnings"], "off: none");
}
