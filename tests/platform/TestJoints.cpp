// Bodies joined by balls, links and hinges, by the public API.

#include <limits>

#include "OverdampedSupport.h"

using namespace OpenMM;
using namespace RigidHITest;
using namespace std;

namespace {

const vector<Scheme> jointed = {RigidHI::FixmanMidpoint, RigidHI::TrapezoidalSlip,
                                RigidHI::RandomFiniteDifference};

string nameOf(Scheme scheme) { return RigidHIPlugin::traitsOf(scheme).name; }

const double noMotor = numeric_limits<double>::quiet_NaN();

/** Three boomerangs in a row: a ball, then a hinge, and a link to a sphere. */
struct Chain : OverdampedScene {
    /** @param rate  of a motor in the hinge */
    Chain(Scheme scheme, double temperature, double h, int threads = 1,
          MobilityForce::Solver solver = MobilityForce::Dense, double rate = noMotor)
        : OverdampedScene(scheme, temperature, h) {
        fluid->setSolver(solver);
        fluid->setSolverTolerance(1e-9);
        addMassless(boomerangKind(), Vec3(0, 0, 0));
        addMassless(boomerangKind(), Vec3(4, 0, 0));
        addMassless(boomerangKind(), Vec3(8, 0, 0));
        addMassless(sphereKind(0.6), Vec3(8, 3, 0));
        integrator.addBallJoint(0, Vec3(2, 0, 0.3), 1, Vec3(-2, 0, 0.3));
        integrator.addHinge(1, Vec3(2, 0.2, 0), 2, Vec3(-2, 0.2, 0), Vec3(0, 0, 1), Vec3(0, 0, 1));
        integrator.addLink(2, Vec3(), 3, Vec3(), 3);
        if (!isnan(rate)) integrator.addHingeMotor(1, rate);
        addWells("0.3*(x-4)^2 + 0.2*(y-1)^2 + 0.1*z^2 + 0.2*x*y");
        start(testPlatform(), threads);
    }
    /** The largest violation of the joints. */
    double violation() {
        const auto R = integrator.getBodyPositions();
        const auto q = integrator.getBodyOrientations();
        const auto at = [&](int b, const Vector3d& site) {
            return Vector3d(Vector3d(R[b][0], R[b][1], R[b][2]) + turn(q[b]) * site);
        };
        double worst = (at(0, {2, 0, 0.3}) - at(1, {-2, 0, 0.3})).norm();
        worst = max(worst, (at(1, {2, 0.2, 0}) - at(2, {-2, 0.2, 0})).norm());
        worst = max(worst, (turn(q[1]).col(2) - turn(q[2]).col(2)).norm());
        return max(worst, abs((at(2, {0, 0, 0}) - at(3, {0, 0, 0})).norm() - 3));
    }
    /** The angle of the hinge, from -pi to pi; it begins with 0. */
    double angle() {
        const auto q = integrator.getBodyOrientations();
        const Matrix3d relative = turn(q[1]).transpose() * turn(q[2]);
        return atan2(relative(1, 0), relative(0, 0));
    }
    static Matrix3d turn(const QuaternionArray& q) {
        return Eigen::Quaterniond(q[0], q[1], q[2], q[3]).toRotationMatrix();
    }
};

}  // namespace

TEST(Joints, HoldUnderEverySchemeThatHasThem) {
    for (auto scheme : jointed)
        for (double temperature : {0.0, T1}) {
            Chain scene(scheme, temperature, 1e-3);
            const VectorXd before = scene.state();
            scene.integrator.step(50);
            EXPECT_LT(scene.violation(), 3e-10) << nameOf(scheme);
            EXPECT_GT((scene.state() - before).norm(), 0.01) << nameOf(scheme);
        }
}

TEST(Joints, TheMobilityObeysThem) {
    Chain scene(RigidHI::TrapezoidalSlip, 0, 1e-3);
    const MatrixXd N = scene.mobility();
    // The ball: velocities of both anchors are the same whatever the wrenches are.
    MatrixXd C = MatrixXd::Zero(3, 24);
    for (int side = 0; side < 2; side++) {
        const Vector3d arm(side ? -2 : 2, 0, 0.3);
        C.block<3, 3>(0, 6 * side) = (side ? -1 : 1) * Matrix3d::Identity();
        for (int k = 0; k < 3; k++)
            C.block<3, 1>(0, 6 * side + 3 + k) = (side ? -1 : 1) * Vector3d::Unit(k).cross(arm);
    }
    EXPECT_LT((C * N).norm(), 1e-12 * N.norm());
    EXPECT_LT((N - N.transpose()).norm(), 1e-12 * N.norm());
    const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(N);
    EXPECT_GT(eigen.eigenvalues()[0], -1e-13 * N.norm());
    int zeros = 0;
    for (int i = 0; i < 24; i++) zeros += abs(eigen.eigenvalues()[i]) < 1e-12 * N.norm();
    EXPECT_EQ(zeros, 3 + 5 + 1);
}

TEST(Joints, MatricesAndProductsTakeTheSameStep) {
    for (auto scheme : jointed) {
        Chain dense(scheme, 0, 1e-3), products(scheme, 0, 1e-3, 1, MobilityForce::MatrixFree);
        dense.integrator.step(3);
        products.integrator.step(3);
        EXPECT_LT((dense.state() - products.state()).norm(), 1e-7) << nameOf(scheme);
    }
}

/** At T = 0 schemes have the same orders as without joints: 1 and 2. */
TEST(Joints, OrdersWithoutNoise) {
    for (double rate : {noMotor, 6.0})
        for (auto scheme : jointed) {
            const auto end = [&](int n) {
                Chain scene(scheme, 0, 0.2 / n, 1, MobilityForce::Dense, rate);
                scene.integrator.step(n);
                return scene.state();
            };
            const VectorXd exact = end(256);
            const double coarse = (end(8) - exact).norm(), fine = (end(16) - exact).norm();
            const double order = log2(coarse / fine);
            EXPECT_NEAR(order, RigidHIPlugin::traitsOf(scheme).coldOrder, 0.35)
                << nameOf(scheme) << " " << coarse << ", rate " << rate;
        }
}

/** A sphere hangs on a link from a point of a held body: the force of the link is its weight. */
TEST(Joints, TheForceOfALink) {
    OverdampedScene scene(RigidHI::TrapezoidalSlip, 0, 1e-3);
    scene.addMassless(sphereKind(0.5), Vec3());
    scene.addMassless(sphereKind(0.5), Vec3(0, 0, -3));
    scene.integrator.setBodyHeld(0, true);
    scene.integrator.addLink(1, Vec3(), 0, Vec3(), 3);
    auto* weight = new CustomExternalForce("2*z");
    weight->addParticle(scene.particles[1][0], {});
    scene.system.addForce(weight);
    scene.start(testPlatform());
    scene.integrator.step(1);
    EXPECT_NEAR(scene.integrator.getBodyPositions()[1][2], -3, 1e-9);
    const Vec3 force = scene.integrator.getJointForces()[0];
    EXPECT_NEAR(force[2], 2, 1e-8);
    EXPECT_NEAR(force[0], 0, 1e-8);
}

TEST(Joints, ResumeBitForBit) {
    for (double rate : {noMotor, 6.0})
        for (auto scheme : jointed)
            expectToResumeBitForBit<Chain>(
                [&](int threads) {
                    return make_unique<Chain>(scheme, T1, 1e-3, threads, MobilityForce::Dense,
                                              rate);
                },
                [](Chain& scene) { scene.integrator.step(3); }, 4);
}

TEST(Joints, WhatDoesNotFitOrFollowsFromOthers) {
    OverdampedScene apart(RigidHI::TrapezoidalSlip);
    apart.addMassless(boomerangKind());
    apart.addMassless(boomerangKind(), Vec3(4, 0, 0));
    apart.integrator.addBallJoint(0, Vec3(1.9, 0, 0), 1, Vec3(-2, 0, 0));
    apart.start(testPlatform());
    expectError([&] { apart.integrator.step(1); },
                {"joint 0 (a ball of body 0 and body 1) is violated by 0.1 nm",
                 "place its bodies so that their"});
    OverdampedScene twice(RigidHI::TrapezoidalSlip);
    twice.addMassless(boomerangKind());
    twice.addMassless(boomerangKind(), Vec3(4, 0, 0));
    for (int i = 0; i < 2; i++) twice.integrator.addBallJoint(0, Vec3(2, 0, 0), 1, Vec3(-2, 0, 0));
    twice.start(testPlatform());
    expectError([&] { twice.integrator.step(1); },
                {"joint ", "has a condition that follows from the conditions of other joints"});
}

TEST(Joints, AreSaid) {
    Chain scene(RigidHI::TrapezoidalSlip, T1, 1e-3);
    EXPECT_EQ(scene.integrator.getEffects()["joints"],
              "on: 1 ball, 1 link, 1 hinge; configurations have the measure of infinitely stiff "
              "springs; each step ends with a projection of the joints to 1e-10 nm");
    Chain driven(RigidHI::TrapezoidalSlip, T1, 1e-3, 1, MobilityForce::Dense, 2);
    EXPECT_EQ(driven.integrator.getEffects()["joints"].substr(0, 37),
              "on: 1 ball, 1 link, 1 hinge, 1 motor;");
}

// ---- Motors

/** The angle grows by rate times step size, with noise or without, and at any rate. */
TEST(HingeMotors, TurnByTheirRate) {
    for (auto scheme : jointed)
        for (double temperature : {0.0, T1}) {
            SCOPED_TRACE(nameOf(scheme) + " at " + to_string(temperature));
            Chain scene(scheme, temperature, 1e-3, 1, MobilityForce::Dense, -8);
            const VectorXd before = scene.state();
            scene.integrator.step(50);
            EXPECT_NEAR(scene.angle(), -0.4, 1e-9);
            EXPECT_LT(scene.violation(), 3e-10);
            EXPECT_GT((scene.state() - before).norm(), 0.1);
            // The rate may change between steps. Of 0 it locks the hinge.
            scene.integrator.setHingeMotorRate(0, 0);
            scene.integrator.step(20);
            EXPECT_NEAR(scene.angle(), -0.4, 2e-9);
            scene.integrator.setHingeMotorRate(0, 1000);
            scene.integrator.step(10);
            EXPECT_NEAR(remainder(scene.angle() - 9.6, 2 * M_PI), 0, 3e-9);
            EXPECT_LT(scene.violation(), 3e-10);
        }
}

/** Without a motor the hinge of the same scene turns differently, so the motor has an effect. */
TEST(HingeMotors, AreNoPartOfOtherHinges) {
    Chain scene(RigidHI::TrapezoidalSlip, T1, 1e-3);
    scene.integrator.step(50);
    EXPECT_GT(abs(scene.angle()), 1e-3);
    EXPECT_TRUE(scene.integrator.getHingeMotorTorques().empty());
}

TEST(HingeMotors, TheMobilityObeysThem) {
    Chain scene(RigidHI::TrapezoidalSlip, 0, 1e-3, 1, MobilityForce::Dense, 5);
    const MatrixXd N = scene.mobility();
    EXPECT_LT((N.row(6 + 5) - N.row(12 + 5)).norm(), 1e-12 * N.norm());
    const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(N);
    EXPECT_GT(eigen.eigenvalues()[0], -1e-13 * N.norm());
    int zeros = 0;
    for (int i = 0; i < 24; i++) zeros += abs(eigen.eigenvalues()[i]) < 1e-12 * N.norm();
    EXPECT_EQ(zeros, 3 + 6 + 1);
}

TEST(HingeMotors, MatricesAndProductsTakeTheSameStep) {
    for (auto scheme : jointed) {
        Chain dense(scheme, 0, 1e-3, 1, MobilityForce::Dense, 6),
            products(scheme, 0, 1e-3, 1, MobilityForce::MatrixFree, 6);
        dense.integrator.step(3);
        products.integrator.step(3);
        EXPECT_LT((dense.state() - products.state()).norm(), 1e-7) << nameOf(scheme);
    }
}

/**
 * Two equal spheres on the axis of a hinge, at the distance r, turn in opposite directions at half
 * of the rate each. In the model their mobilities about the axis are 1/(8 pi eta a^3) and 1/(8 pi
 * eta r^3).
 */
TEST(HingeMotors, TheTorqueOfTwoSpheresOnTheAxis) {
    const double a = 0.5, r = 1.7, rate = 3, h = 1e-3;
    for (auto scheme : jointed) {
        SCOPED_TRACE(nameOf(scheme));
        OverdampedScene scene(scheme, 0, h);
        scene.addMassless(sphereKind(a), Vec3());
        scene.addMassless(sphereKind(a), Vec3(0, 0, r));
        const int hinge = scene.integrator.addHinge(0, Vec3(0, 0, r / 2), 1, Vec3(0, 0, -r / 2),
                                                    Vec3(0, 0, 1), Vec3(0, 0, 1));
        EXPECT_EQ(scene.integrator.addHingeMotor(hinge, rate), 0);
        scene.start(testPlatform());
        scene.integrator.step(1);
        const double eta = scene.fluid->getViscosity();
        const double torque = 4 * M_PI * eta * rate / (1 / (a * a * a) - 1 / (r * r * r));
        ASSERT_EQ(scene.integrator.getHingeMotorTorques().size(), 1u);
        EXPECT_NEAR(scene.integrator.getHingeMotorTorques()[0], torque, 1e-9 * torque);
        const Vec3 force = scene.integrator.getJointForces()[0];
        EXPECT_LT(sqrt(force.dot(force)), 1e-9 * torque);
        const auto q = scene.integrator.getBodyOrientations();
        EXPECT_NEAR(2 * atan2(q[0][3], q[0][0]), -rate * h / 2, 1e-12);
        EXPECT_NEAR(2 * atan2(q[1][3], q[1][0]), rate * h / 2, 1e-12);
    }
}

/** The flow of the last step contains the rates of this step, also in a restored Context. */
TEST(HingeMotors, TheFlowOfTheLastStepHasItsRates) {
    const vector<Vec3> points = {Vec3(1, 2, 3), Vec3(9, -2, 1)};
    Chain scene(RigidHI::TrapezoidalSlip, 0, 1e-3, 1, MobilityForce::Dense, 6);
    scene.integrator.step(2);
    const auto before = scene.fluid->getFlowInContext(*scene.context, points);
    stringstream saved;
    scene.context->createCheckpoint(saved);
    scene.integrator.setHingeMotorRate(0, -60);
    EXPECT_TRUE(sameBits(scene.fluid->getFlowInContext(*scene.context, points), before));
    scene.integrator.step(1);
    EXPECT_FALSE(sameBits(scene.fluid->getFlowInContext(*scene.context, points), before));
    Chain later(RigidHI::TrapezoidalSlip, 0, 1e-3, 1, MobilityForce::Dense, -60);
    later.context->loadCheckpoint(saved);
    EXPECT_TRUE(sameBits(later.fluid->getFlowInContext(*later.context, points), before));
}
