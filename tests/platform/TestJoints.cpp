// Bodies that are joined by balls, links and hinges, by the public API.

#include "OverdampedSupport.h"

using namespace OpenMM;
using namespace RigidHITest;
using namespace std;

namespace {

const vector<Scheme> jointed = {RigidHI::FixmanMidpoint, RigidHI::TrapezoidalSlip,
                                RigidHI::RandomFiniteDifference};

string nameOf(Scheme scheme) { return RigidHIPlugin::traitsOf(scheme).name; }

/** Three boomerangs in a row: a ball, then a hinge, and a link to a sphere. */
struct Chain : OverdampedScene {
    Chain(Scheme scheme, double temperature, double h, int threads = 1,
          MobilityForce::Solver solver = MobilityForce::Dense)
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

/** At T = 0 the orders are those without joints: 1 and 2. */
TEST(Joints, OrdersWithoutNoise) {
    for (auto scheme : jointed) {
        const auto end = [&](int n) {
            Chain scene(scheme, 0, 0.2 / n);
            scene.integrator.step(n);
            return scene.state();
        };
        const VectorXd exact = end(256);
        const double coarse = (end(8) - exact).norm(), fine = (end(16) - exact).norm();
        const double order = log2(coarse / fine);
        EXPECT_NEAR(order, RigidHIPlugin::traitsOf(scheme).coldOrder, 0.35)
            << nameOf(scheme) << " " << coarse;
    }
}

/** A sphere that hangs on a link from a point of a held body: its weight is the link's force. */
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
    for (auto scheme : jointed)
        expectToResumeBitForBit<Chain>(
            [&](int threads) { return make_unique<Chain>(scheme, T1, 1e-3, threads); },
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
                {"joint ", "has a condition that follows from those of other joints"});
}

TEST(Joints, AreSaid) {
    Chain scene(RigidHI::TrapezoidalSlip, T1, 1e-3);
    EXPECT_EQ(scene.integrator.getEffects()["joints"],
              "on: 1 ball, 1 link, 1 hinge; configurations have the measure of infinitely stiff "
              "springs; projected to 1e-10 nm after each step");
}
