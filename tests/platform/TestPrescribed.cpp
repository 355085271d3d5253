// Prescribed motion of bodies (CustomBodyMotion) under schemes without momenta, by the public API.

#include "OverdampedSupport.h"
#include "openmmrigidhi/CustomBodyMotion.h"

using namespace OpenMM;
using namespace RigidHITest;
using RigidHIPlugin::CustomBodyMotion;
using namespace std;

namespace {

CustomBodyMotion* motion(const vector<string>& e, bool inBody = false) {
    auto* made = new CustomBodyMotion(e[0], e[1], e[2], e[3], e[4], e[5]);
    if (inBody) made->setFrame(CustomBodyMotion::Body);
    return made;
}

/** A boomerang and a sphere beside another boomerang, in wells above a wall. */
struct Driven : OverdampedScene {
    Driven(Scheme scheme, double temperature, double h, const vector<string>& expressions,
           bool inBody = false, int threads = 1, const function<void(Driven&)>& change = {})
        : OverdampedScene(scheme, temperature, h) {
        fluid->setBoundary(MobilityForce::NoSlipWall);
        addMassless(boomerangKind(), Vec3(0, 0, 4), randomTurn(1));
        addMassless(sphereKind(0.8), Vec3(3, 0.5, 3.5), randomTurn(2));
        addMassless(boomerangKind(), Vec3(0, 4, 3.5), randomTurn(3));
        addWells("2*(x-1)^2 + (y-1)^2 + 0.5*(z-4)^2 + 0.3*x*y");
        CustomBodyMotion* driving = motion(expressions, inBody);
        driving->addGlobalParameter("speed", 1.5);
        driving->addBody(0, {});
        system.addForce(driving);
        if (change) change(*this);
        start(testPlatform(), threads);
    }
};

Vector3d toVector(const Vec3& x) { return Vector3d(x[0], x[1], x[2]); }

}  // namespace

/** A sphere at the height h with a prescribed spin rolls at a known speed. */
TEST(Prescribed, ARollerMovesAlongItsWall) {
    const double spin = 0.7;
    for (double h : {1.2, 1.5, 3.0})
        for (auto solver : {MobilityForce::Dense, MobilityForce::MatrixFree}) {
            OverdampedScene scene(RigidHI::TrapezoidalSlip, 0, 1e-6);
            scene.fluid->setSolver(solver);
            scene.fluid->setSolverTolerance(1e-9);
            scene.fluid->setBoundary(MobilityForce::NoSlipWall);
            scene.addMassless(sphereKind(1), Vec3(0, 0, h));
            CustomBodyMotion* driving = motion({"", "", "", "", to_string(spin), ""});
            driving->addBody(0, {});
            scene.system.addForce(driving);
            scene.start(testPlatform());
            scene.integrator.step(1);
            const Vec3 x = scene.integrator.getBodyPositions()[0];
            const double u = 1 / h, speed = spin * pow(u, 4) / 8 / (1 - 5 * pow(u, 3) / 16);
            EXPECT_NEAR(x[0] / 1e-6, speed, 1e-8) << h;
            EXPECT_EQ(x[1], 0);
            EXPECT_NEAR(x[2], h, 1e-13);
            if (h == 1.5) {
                EXPECT_NEAR(speed / spin, 0.027210884353741, 1e-14);
            }
        }
}

/** Free components follow from the friction of all bodies: xi_ff U_f + xi_fp U_p = F_f. */
TEST(Prescribed, WhatIsFreeFollows) {
    const double h = 1e-7;
    for (const Named& s : schemes) {
        Driven scene(s.scheme, 0, h, {"0.5", "", "-0.3", "", "0.8", ""});
        const MatrixXd xi = scene.friction();
        const auto R = scene.integrator.getBodyPositions();
        VectorXd forces = VectorXd::Zero(18);
        const auto hold = scene.integrator.computeHoldingWrenches();
        scene.integrator.step(1);
        const auto after = scene.integrator.getBodyPositions();
        const auto f = scene.integrator.getBodyForces(), t = scene.integrator.getBodyTorques();
        for (int b = 0; b < 3; b++)
            for (int k = 0; k < 3; k++) {
                forces[6 * b + k] = f[b][k];
                forces[6 * b + 3 + k] = t[b][k];
            }
        const vector<int> fixed = {0, 2, 4};
        const vector<double> values = {0.5, -0.3, 0.8};
        vector<int> freeRows;
        for (int row = 0; row < 18; row++)
            if (find(fixed.begin(), fixed.end(), row) == fixed.end()) freeRows.push_back(row);
        VectorXd prescribed = VectorXd::Zero(18);
        for (int i = 0; i < 3; i++) prescribed[fixed[i]] = values[i];
        const VectorXd right = forces - xi * prescribed;
        const MatrixXd own = xi(freeRows, freeRows);
        const VectorXd found = own.llt().solve(VectorXd(right(freeRows)));
        VectorXd U = prescribed;
        U(freeRows) = found;
        for (int b = 0; b < 3; b++)
            EXPECT_LT((toVector(after[b] - R[b]) / h - U.segment<3>(6 * b)).norm(), 1e-4)
                << s.name << " " << b;
        // The wrench that this takes.
        const VectorXd holds = xi * U - forces;
        for (int row = 0; row < 18; row++)
            EXPECT_NEAR(hold[row], holds[row], 1e-4 * holds.norm()) << s.name << " " << row;
    }
}

/**
 * A body with all components prescribed has the path of its expressions, by the quadrature of the
 * scheme.
 */
TEST(Prescribed, TheTimesAreThoseOfTheStages) {
    const double h = 0.01;
    const int n = 20;
    for (double temperature : {0.0, T1})
        for (bool whole : {false, true})
            for (const Named& s : schemes) {
                Driven scene(s.scheme, temperature, h, {"speed*sin(9*t)", "0", "0", "0", "0", "0"},
                             false, 1, [&](Driven& own) {
                                 own.integrator.setDriftCorrectorScaling(whole ? RigidHI::Whole
                                                                               : RigidHI::SlipOnly);
                             });
                const Vec3 start = scene.integrator.getBodyPositions()[0];
                scene.integrator.step(n);
                const bool middle = s.scheme == RigidHI::FixmanMidpoint ||
                                    s.scheme == RigidHI::DriftCorrectorFD ||
                                    s.scheme == RigidHI::DriftCorrectorRFD;
                double x = start[0];
                for (int i = 0; i < n; i++) {
                    const double t = i * h;
                    x += 1.5 * h *
                         (middle ? sin(9 * (t + h / 2))
                          : s.scheme == RigidHI::TrapezoidalSlip
                              ? (sin(9 * t) + sin(9 * (t + h))) / 2
                              : sin(9 * t));
                }
                const Vec3 end = scene.integrator.getBodyPositions()[0];
                EXPECT_NEAR(end[0], x, 1e-9) << s.name << " " << whole;
                EXPECT_NEAR(end[1], start[1], 1e-12) << s.name;
                EXPECT_NEAR(end[2], start[2], 1e-12) << s.name;
            }
}

/** Along an axis of the body, the body has the prescribed velocity whatever the noise is. */
TEST(Prescribed, AxesMayTurnWithTheBody) {
    const double h = 1e-3;
    for (auto scheme : {RigidHI::EulerMaruyama}) {
        Driven scene(scheme, T1, h, {"speed", "", "", "", "", "2"}, true);
        for (int i = 0; i < 10; i++) {
            const Vec3 R = scene.integrator.getBodyPositions()[0];
            const auto q = scene.integrator.getBodyOrientations()[0];
            const Matrix3d A = Eigen::Quaterniond(q[0], q[1], q[2], q[3]).toRotationMatrix();
            scene.integrator.step(1);
            const Vector3d moved = toVector(scene.integrator.getBodyPositions()[0] - R) / h;
            EXPECT_NEAR(moved.dot(A.col(0)), 1.5, 1e-9);
            const auto after = scene.integrator.getBodyOrientations()[0];
            const Matrix3d B =
                Eigen::Quaterniond(after[0], after[1], after[2], after[3]).toRotationMatrix();
            const Eigen::AngleAxisd turn(B * A.transpose());
            EXPECT_NEAR(turn.angle() * turn.axis().dot(A.col(2)) / h, 2, 1e-9);
        }
    }
    for (const Named& s : schemes) {
        Driven scene(s.scheme, T1, h, {"speed", "", "", "", "0", "2"}, true);
        scene.integrator.step(5);
        EXPECT_TRUE(scene.state().allFinite()) << s.name;
    }
}

TEST(Prescribed, ResumesBitForBit) {
    for (auto scheme : {RigidHI::TrapezoidalSlip, RigidHI::FixmanMidpoint})
        expectToResumeBitForBit<Driven>(
            [&](int threads) {
                return make_unique<Driven>(scheme, T1, 1e-3,
                                           vector<string>{"speed*cos(t)", "", "", "", "t", ""},
                                           true, threads);
            },
            [](Driven& scene) {
                scene.integrator.step(3);
                scene.context->setParameter("speed", 0.4);
                scene.integrator.step(2);
            },
            4);
}

TEST(Prescribed, WhatCannotBeIsAnErrorAndNothingMoves) {
    for (const Named& s : schemes) {
        Driven scene(s.scheme, T1, 0.25, {"0.01/(t - 0.5)", "", "", "", "", ""});
        scene.integrator.step(1);
        const VectorXd before = scene.state();
        string message;
        // At the latest the third step begins where the velocity is infinite.
        for (int i = 0; i < 2 && message.empty(); i++) try {
                const VectorXd here = scene.state();
                message.clear();
                scene.integrator.step(1);
            } catch (const OpenMMException& e) {
                message = e.what();
            }
        EXPECT_NE(message.find("at t = 0.5 ps"), string::npos) << s.name << message;
        EXPECT_TRUE(scene.state().allFinite()) << s.name;
    }
    Driven falling(RigidHI::TrapezoidalSlip, T1, 0.1, {"0", "0", "-20", "0", "0", "0"});
    string message;
    VectorXd before;
    for (int i = 0; i < 10 && message.empty(); i++) try {
            before = falling.state();
            falling.integrator.step(1);
        } catch (const OpenMMException& e) {
            message = e.what();
        }
    EXPECT_NE(message.find("a prescribed motion leads to where the fluid has no mobility"),
              string::npos)
        << message;
    EXPECT_EQ(falling.state(), before);
    EXPECT_EQ(falling.integrator.getNumRejectedSteps(), 0);
}

TEST(Prescribed, IsSaid) {
    Driven scene(RigidHI::TrapezoidalSlip, T1, 1e-3, {"", "", "1", "0", "", ""});
    EXPECT_EQ(scene.integrator.getEffects()["prescribed motion"], "on: body 0: vz, wx");
    const MatrixXd N = scene.mobility();
    EXPECT_EQ(N.row(2).norm() + N.row(3).norm() + N.col(2).norm() + N.col(3).norm(), 0);
    EXPECT_GT(N.row(0).norm(), 0);
}
