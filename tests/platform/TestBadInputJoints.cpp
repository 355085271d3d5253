// For every error that users may make with joints, the call throws an OpenMMException that names
// object, value, bound and remedy.

#include <openmm/MonteCarloBarostat.h>

#include <limits>

#include "OverdampedSupport.h"
#include "openmmrigidhi/CustomBodyMotion.h"

using namespace OpenMM;
using namespace RigidHITest;
using RigidHIPlugin::CustomBodyMotion;
using RigidHIPlugin::JointDefinition;
using namespace std;

namespace {

const Vec3 centre, back(-1, 0, 0), front(1, 0, 0), up(0, 0, 1);

/** Three spheres in a row, 2 nm apart, in a fluid. */
struct Scene : FluidScene {
    explicit Scene(RigidHI::Scheme scheme = RigidHI::TrapezoidalSlip) : FluidScene(0) {
        for (int b = 0; b < 3; b++) add(sphereKind(0.5), Vec3(2 * b, 0, 0));
        integrator.setScheme(scheme);
    }
    void prescribe(int body, const vector<string>& e) {
        auto* force = new CustomBodyMotion(e[0], e[1], e[2], e[3], e[4], e[5]);
        force->addBody(body, {});
        system.addForce(force);
    }
    void expectRefused(const vector<string>& fragments) {
        expectError([&] { start(testPlatform()); }, fragments);
    }
    /** The Context exists, and its bodies fit and move. */
    void expectAccepted() {
        start(testPlatform());
        integrator.step(1);
        EXPECT_EQ(static_cast<int>(integrator.getJointForces().size()), integrator.getNumJoints());
        context.reset();
    }
    /** How far the anchor `front` of body 0 is from `back` of body 1, nm. */
    double gap() {
        const auto R = integrator.getBodyPositions();
        const auto q = integrator.getBodyOrientations();
        const Vec3 between = R[0] + rotate(q[0], front) - R[1] - rotate(q[1], back);
        return sqrt(between.dot(between));
    }
};

}  // namespace

TEST(BadJoints, Bodies) {
    Scene scene;
    RigidHI& integrator = scene.integrator;
    for (int bad : {-1, 3}) {
        const string index =
            "body index " + to_string(bad) + " is out of range; the integrator has 3 bodies";
        expectError([&] { integrator.addBallJoint(bad, front, 1, back); },
                    {"CustomRigidHIIntegrator: addBallJoint(): " + index});
        expectError([&] { integrator.addBallJoint(0, front, bad, back); },
                    {"addBallJoint(): " + index});
        expectError([&] { integrator.addBallJointToPoint(bad, front, back); },
                    {"addBallJointToPoint(): " + index});
        expectError([&] { integrator.addLink(0, front, bad, back, 1); }, {"addLink(): " + index});
        expectError([&] { integrator.addHinge(bad, front, 1, back, up, up); },
                    {"addHinge(): " + index});
    }
    const vector<string> same = {"both bodies are body 1",
                                 "a joint is between two bodies or between a body and a point",
                                 "use addBallJointToPoint() for a place in space"};
    expectError([&] { integrator.addBallJoint(1, front, 1, back); }, same);
    expectError([&] { integrator.addLink(1, front, 1, back, 1); }, same);
    expectError([&] { integrator.addHinge(1, front, 1, back, up, up); }, same);
    EXPECT_EQ(integrator.getNumJoints(), 0);
}

TEST(BadJoints, Numbers) {
    Scene scene;
    RigidHI& integrator = scene.integrator;
    for (double bad : {numeric_limits<double>::quiet_NaN(), HUGE_VAL}) {
        const Vec3 wrong(0, bad, 0);
        expectError(
            [&] { integrator.addBallJoint(0, wrong, 1, back); },
            {"addBallJoint(): anchor in body 0 is (0, ", "all three numbers must be finite"});
        expectError([&] { integrator.addLink(0, front, 2, wrong, 1); },
                    {"addLink(): anchor in body 2 is (0, ", "all three numbers must be finite"});
        expectError(
            [&] { integrator.addBallJointToPoint(0, front, wrong); },
            {"addBallJointToPoint(): point of space is (0, ", "all three numbers must be finite"});
        expectError([&] { integrator.addHinge(0, front, 1, back, up, wrong); },
                    {"addHinge(): axis in body 1 is (0, ", "all three numbers must be finite"});
        expectError([&] { integrator.addLink(0, front, 1, back, bad); },
                    {"addLink(): length is ", "it must be finite and positive"});
        expectError([&] { integrator.setJointTolerance(bad); },
                    {"setJointTolerance(): joint tolerance is ", "it must be finite and positive"});
    }
    for (double bad : {0.0, -0.5})
        expectError([&] { integrator.addLink(0, front, 1, back, bad); },
                    {"addLink(): length is " + string(bad < 0 ? "-0.5" : "0") + " nm",
                     "give a value above 0, or use addBallJoint() for a length of 0"});
    for (double bad : {0.0, -1e-10})
        expectError(
            [&] { integrator.setJointTolerance(bad); },
            {"setJointTolerance(): joint tolerance is ", " nm; it must be finite and positive"});
    expectError([&] { integrator.addHinge(0, front, 1, back, Vec3(), up); },
                {"addHinge(): axis in body 0 is (0, 0, 0); an axis needs a direction",
                 "give the direction of the hinge in the body frame, with any length but 0"});
    expectError([&] { integrator.addHinge(0, front, 1, back, up, Vec3()); },
                {"addHinge(): axis in body 1 is (0, 0, 0)"});
    EXPECT_EQ(integrator.getNumJoints(), 0);
    EXPECT_EQ(integrator.getJointTolerance(), 1e-10);
    integrator.setJointTolerance(1e-6);
    EXPECT_EQ(integrator.getJointTolerance(), 1e-6);
}

TEST(BadJoints, Getters) {
    Scene scene;
    EXPECT_EQ(scene.integrator.addLink(0, front, 1, back, 0.25), 0);
    EXPECT_EQ(scene.integrator.addBallJointToPoint(2, up, front), 1);
    for (int bad : {-1, 2})
        expectError([&] { scene.integrator.getJointParameters(bad); },
                    {"getJointParameters(): joint index " + to_string(bad) + " is out of range",
                     "the integrator has 2 joints, counted from 0",
                     "add the joint first, or correct the index"});
    expectError([&] { scene.integrator.getJointForces(); },
                {"getJointForces()", "needs a Context"});
    const JointDefinition &link = scene.integrator.getJointParameters(0),
                          &ball = scene.integrator.getJointParameters(1);
    EXPECT_EQ(link.kind, JointDefinition::Link);
    EXPECT_EQ(link.i, 0);
    EXPECT_EQ(link.j, 1);
    EXPECT_EQ(link.anchor_i, front);
    EXPECT_EQ(link.anchor_j, back);
    EXPECT_EQ(link.length, 0.25);
    EXPECT_EQ(ball.kind, JointDefinition::BallToPoint);
    EXPECT_EQ(ball.i, 2);
    EXPECT_EQ(ball.j, -1);
    EXPECT_EQ(ball.anchor_i, up);
    EXPECT_EQ(ball.anchor_j, front);
    EXPECT_EQ(ball.axis_i, Vec3());
}

TEST(BadJoints, AxesAreUnitVectors) {
    Scene scene;
    for (double size : {1e-300, 3.0, 1e300})
        scene.integrator.addHinge(0, front, 1, back, Vec3(3, 0, -4) * size, Vec3(0, size, 0));
    for (int k = 0; k < 3; k++) {
        const JointDefinition& joint = scene.integrator.getJointParameters(k);
        const Vec3 off = joint.axis_i - Vec3(0.6, 0, -0.8);
        EXPECT_LT(sqrt(off.dot(off)), 1e-15);
        EXPECT_EQ(joint.axis_j, Vec3(0, 1, 0));
        // A unit vector stays as it is, so that copies of joints are the same to the last bit.
        scene.integrator.addJoint(joint);
        const JointDefinition& copy = scene.integrator.getJoints().back();
        EXPECT_EQ(copy.axis_i, scene.integrator.getJoints()[k].axis_i);
    }
}

TEST(BadJoints, Schemes) {
    map<string, string> reasons = {
        {"DriftCorrectorFD", "its mid-point tears joints"},
        {"DriftCorrectorRFD", "its mid-point tears joints"},
        {"EulerMaruyama", "without the drift of jointed bodies it samples another measure"},
        {"TractionEulerMaruyama", "its drift leaves out how joints turn"},
        {"GradientThermostat", "joints need the mobility of a fluid"}};
    for (const char* name : {"LangevinHI", "LangevinA", "LangevinB", "LangevinC"})
        reasons[name] = "joints with momenta sample another measure";
    for (const auto& traits : RigidHIPlugin::schemeTable) {
        Scene scene(traits.scheme);
        if (!traits.needsFluid()) scene.removeFluid();
        scene.integrator.addLink(0, front, 1, centre, 1);
        if (traits.scheme == RigidHI::TrapezoidalSlip || traits.scheme == RigidHI::FixmanMidpoint ||
            traits.scheme == RigidHI::RandomFiniteDifference)
            scene.expectAccepted();
        else
            scene.expectRefused(
                {"the integrator has joint 0 (a link of body 0 and body 1), but scheme " +
                     string(traits.name) + " has no joints: " + reasons[traits.name],
                 "; use TrapezoidalSlip, FixmanMidpoint or RandomFiniteDifference, "
                 "or leave the joints out"});
    }
}

TEST(BadJoints, Barostats) {
    for (auto scheme : {RigidHI::TrapezoidalSlip, RigidHI::FixmanMidpoint}) {
        Scene scene(scheme);
        scene.fluid->setBoundary(MobilityForce::Periodic);
        scene.bind();
        scene.system.addForce(new MonteCarloBarostat(1, 300));
        scene.integrator.addBallJoint(0, front, 1, back);
        scene.expectRefused(
            {"the integrator has joint 0 (a ball of body 0 and body 1), but the System has a "
             "MonteCarloBarostat, which moves every molecule by itself and so would tear the "
             "joint; remove "
             "the barostat"});
    }
}

TEST(BadJoints, Groups) {
    Scene groups;
    groups.fluid->setGroups({0, 0, 7});
    groups.integrator.addBallJoint(0, front, 1, back);
    groups.integrator.addHinge(1, front, 2, back, up, up);
    groups.expectRefused(
        {"joint 1 (a hinge of body 1 and body 2) needs both bodies in one group, "
         "but they are in groups 0 and 7 of MobilityForce::setGroups()",
         "give both bodies the same group, or leave the joint out"});
    groups.fluid->setGroups({3, 3, 3});
    groups.expectAccepted();

    Scene alone;
    alone.fluid->setModel(MobilityForce::FreeDraining);
    alone.integrator.addBallJointToPoint(0, front, front);
    alone.expectAccepted();
    alone.integrator.addLink(2, back, 1, centre, 1);
    alone.expectRefused(
        {"joint 1 (a link of body 2 and body 1) needs both bodies in one group, but "
         "under FreeDraining every body is in a group of its own",
         "use setModel(RotnePragerYamakawa)"});
}

TEST(BadJoints, NothingThatMoves) {
    Scene held;
    held.integrator.addBallJoint(0, front, 1, back);
    held.integrator.setBodyHeld(0, true);
    held.expectAccepted();
    held.integrator.setBodyHeld(1, true);
    held.expectRefused(
        {"joint 0 (a ball of body 0 and body 1) has no body that it could move: "
         "body 0 is held, and body 1 is held; leave the joint out, or let one of "
         "the bodies go"});

    Scene driven;
    driven.integrator.addLink(0, front, 1, centre, 1);
    driven.integrator.setBodyHeld(0, true);
    driven.prescribe(1, {"1", "0", "0", "0", "t", "0"});
    driven.expectRefused(
        {"joint 0 (a link of body 0 and body 1) has no body that it could move: "
         "body 0 is held, and a CustomBodyMotion (force 1) prescribes all six "
         "components of body 1"});

    Scene rollers;
    rollers.integrator.addLink(0, front, 1, centre, 1);
    rollers.integrator.setBodyHeld(0, true);
    rollers.prescribe(1, {"", "", "0", "", "t", "0"});
    rollers.expectAccepted();

    Scene point;
    point.integrator.addBallJointToPoint(2, front, front);
    point.integrator.setBodyHeld(2, true);
    point.expectRefused(
        {"joint 0 (a ball of body 2 and a point) has nothing that it could move: "
         "body 2 is held; leave the joint out, or let the body go"});
}

TEST(BadJoints, FirstPosesThatDoNotFit) {
    const double gap = 0.01;
    const auto refused = [](Scene& scene, const string& joint) {
        scene.start(testPlatform());
        const auto before = scene.integrator.getBodyPositions();
        expectError([&] { scene.integrator.step(1); },
                    {"CustomRigidHIIntegrator: joint 0 (" + joint + ") is violated by 0.01",
                     "place its bodies so that their anchors, axes and distance fit"});
        EXPECT_TRUE(sameBits(scene.integrator.getBodyPositions(), before));
    };
    Scene ball, link, point, hinge;
    ball.integrator.addBallJoint(0, front + up * gap, 1, back);
    refused(ball, "a ball of body 0 and body 1");
    link.integrator.addLink(0, front, 1, centre, 1 + gap);
    refused(link, "a link of body 0 and body 1");
    point.integrator.addBallJointToPoint(0, front, front - up * gap);
    refused(point, "a ball of body 0 and a point");
    hinge.integrator.addHinge(0, front, 1, back, up, Vec3(0, gap, sqrt(1 - gap * gap)));
    refused(hinge, "a hinge of body 0 and body 1");
    // What is not too large is mended by the first step.
    for (Scene* scene : {&ball, &link, &point, &hinge}) {
        scene->integrator.setPoseTolerance(0.011);
        scene->integrator.step(1);
        scene->integrator.setPoseTolerance(1e-9);
        scene->integrator.step(1);
    }
    // Axes must have one direction, not opposite ones.
    Scene opposite;
    opposite.integrator.addHinge(0, front, 1, back, up, up * -1);
    opposite.start(testPlatform());
    opposite.integrator.setPoseTolerance(1);
    expectError([&] { opposite.integrator.step(1); },
                {"joint 0 (a hinge of body 0 and body 1) is violated by 3.14159 nm (or radians), "
                 "above 1"});
}

TEST(BadJoints, Redundant) {
    Scene twice, still;
    twice.integrator.addBallJoint(0, front, 1, back);
    twice.integrator.addBallJoint(1, back, 0, front);
    twice.start(testPlatform());
    const vector<string> fragments = {
        "has a condition that follows from the conditions of other joints, or that is on a motion "
        "that does not "
        "exist",
        "remove the joint, or use a joint that leaves this motion free"};
    expectError([&] { twice.integrator.step(1); }, fragments);
    // The anchor at the centre of a sphere moves by its velocity only, all of which is prescribed.
    still.integrator.addBallJointToPoint(0, centre, centre);
    still.prescribe(0, {"0", "0", "0", "", "", ""});
    still.start(testPlatform());
    expectError([&] { still.integrator.step(1); }, fragments);
}

TEST(BadJoints, LaterJointsWaitForTheNextContext) {
    Scene scene;
    scene.start(testPlatform());
    scene.integrator.step(1);
    scene.integrator.addBallJoint(0, front, 1, back);
    scene.integrator.step(1);
    EXPECT_TRUE(scene.integrator.getJointForces().empty());
    scene.integrator.setScheme(RigidHI::EulerMaruyama);
    scene.integrator.step(1);
    expectError(
        [&] { scene.context->reinitialize(); },
        {"the integrator has joint 0 (a ball of body 0 and body 1), but scheme EulerMaruyama"});
}

TEST(BadJoints, ChangesBetweenSteps) {
    Scene scene;
    RigidHI& integrator = scene.integrator;
    integrator.addBallJoint(0, front, 1, back);
    integrator.setTemperature(300);
    integrator.setStepSize(1e-4);
    integrator.setRandomNumberSeed(1);
    integrator.setJointTolerance(1);
    scene.start(testPlatform());
    integrator.step(1);
    const double loose = scene.gap();
    EXPECT_GT(loose, 1e-9);
    integrator.step(1);  // begins with whatever the tolerance allows
    integrator.setJointTolerance(1e-12);
    integrator.step(1);
    EXPECT_LT(scene.gap(), 2e-12);

    integrator.setScheme(RigidHI::LangevinHI);
    expectError([&] { integrator.step(1); }, {"but scheme LangevinHI has no joints"});
    integrator.setScheme(RigidHI::FixmanMidpoint);
    integrator.setBodyHeld(0, true);
    integrator.step(1);
    integrator.setBodyHeld(1, true);
    expectError([&] { integrator.step(1); }, {"joint 0 (a ball of body 0 and body 1) has no body "
                                              "that it could move"});
    integrator.setBodyHeld(0, false);
    integrator.step(1);
    EXPECT_LT(scene.gap(), 2e-12);
}

TEST(BadJoints, JointsStayWithTheirBodies) {
    Scene scene;
    scene.integrator.addBallJoint(0, front, 1, back);
    scene.integrator.setRigidBodyParameters(1, {1}, 1, Vec3(1, 1, 1), {up});
    scene.integrator.resetBodyGeometry();
    ASSERT_EQ(scene.integrator.getNumJoints(), 1);
    EXPECT_EQ(scene.integrator.getJointParameters(0).anchor_j, back);
}

TEST(BadHingeMotors, Definitions) {
    Scene scene;
    RigidHI& integrator = scene.integrator;
    integrator.addLink(0, front, 1, centre, 1);
    integrator.addHinge(1, front, 2, back, up, up);
    for (int bad : {-1, 2})
        expectError([&] { integrator.addHingeMotor(bad, 1); },
                    {"CustomRigidHIIntegrator: addHingeMotor(): joint index " + to_string(bad) +
                         " is out of range; the integrator has 2 joints, counted from 0",
                     "add the hinge first, or correct the index"});
    expectError([&] { integrator.addHingeMotor(0, 1); },
                {"addHingeMotor(): joint 0 (a link of body 0 and body 1) is no hinge; a motor "
                 "turns bodies about the axis of a hinge",
                 "give an index that addHinge() returned"});
    for (double bad : {numeric_limits<double>::quiet_NaN(), HUGE_VAL, -HUGE_VAL})
        expectError([&] { integrator.addHingeMotor(1, bad); },
                    {"addHingeMotor(): rate is ", " rad/ps; it must be finite",
                     "give a finite rate of either sign"});
    EXPECT_EQ(integrator.getNumHingeMotors(), 0);
    EXPECT_EQ(integrator.addHingeMotor(1, -0.25), 0);
    expectError([&] { integrator.addHingeMotor(1, 1); },
                {"addHingeMotor(): joint 1 (a hinge of body 1 and body 2) has motor 0 already; a "
                 "hinge has one motor",
                 "change its rate by setHingeMotorRate()"});
    expectError([&] { integrator.setHingeMotorRate(0, HUGE_VAL); },
                {"setHingeMotorRate(): rate is ", "it must be finite"});
    int hinge = 7;
    double rate = 7;
    for (int bad : {-1, 1}) {
        const string index = "(): motor index " + to_string(bad) +
                             " is out of range; the integrator has 1 motors, counted from 0";
        expectError([&] { integrator.setHingeMotorRate(bad, 1); }, {"setHingeMotorRate" + index});
        expectError([&] { integrator.getHingeMotorRate(bad); }, {"getHingeMotorRate" + index});
        expectError(
            [&] { integrator.getHingeMotorParameters(bad, hinge, rate); },
            {"getHingeMotorParameters" + index, "add the motor first, or correct the index"});
    }
    expectError([&] { integrator.getHingeMotorTorques(); },
                {"getHingeMotorTorques()", "needs a Context"});
    integrator.getHingeMotorParameters(0, hinge, rate);
    EXPECT_EQ(hinge, 1);
    EXPECT_EQ(rate, -0.25);
    EXPECT_EQ(integrator.getHingeMotorRate(0), -0.25);
    integrator.setHingeMotorRate(0, 3);
    EXPECT_EQ(integrator.getHingeMotorRate(0), 3);
}

/** A Context keeps the motors that existed when it was created, but uses their present rates. */
TEST(BadHingeMotors, LaterMotorsWaitForTheNextContext) {
    Scene scene;
    RigidHI& integrator = scene.integrator;
    integrator.addHinge(0, front, 1, back, up, up);
    integrator.addHinge(1, front, 2, back, up, up);
    integrator.addHingeMotor(1, 2);
    scene.start(testPlatform());
    integrator.addHingeMotor(0, 2);
    integrator.setStepSize(0.01);
    integrator.step(1);
    EXPECT_EQ(integrator.getHingeMotorTorques().size(), 1u);
    EXPECT_NEAR(
        2 * atan2(integrator.getBodyOrientations()[2][3], integrator.getBodyOrientations()[2][0]) -
            2 * atan2(integrator.getBodyOrientations()[1][3],
                      integrator.getBodyOrientations()[1][0]),
        0.02, 1e-9);
    integrator.setHingeMotorRate(0, -1);
    integrator.step(1);
    EXPECT_NEAR(
        2 * atan2(integrator.getBodyOrientations()[2][3], integrator.getBodyOrientations()[2][0]) -
            2 * atan2(integrator.getBodyOrientations()[1][3],
                      integrator.getBodyOrientations()[1][0]),
        0.01, 1e-9);
    scene.context->reinitialize(true);
    integrator.step(1);
    EXPECT_EQ(integrator.getHingeMotorTorques().size(), 2u);
}

/** Nothing resists the rotation of a line of particles about itself, so no joint may cause it. */
TEST(BadJoints, RodsThatAreTurnedAboutTheirLine) {
    const Vec3 end(0, 0, 1), beside(0.5, 0, 1), along(0, 0, 1), across(1, 0, 0);
    const auto expectRefused = [&](const string& joint, const auto& add, bool refused = true) {
        OverdampedScene scene(RigidHI::TrapezoidalSlip);
        BodyKind rod = sphereKind(0.4);
        rod.sites = {Vec3(0, 0, -1), Vec3(0, 0, 0), Vec3(0, 0, 1)};
        rod.radii = {0.4, 0.4, 0.4};
        scene.addMassless(rod, Vec3(0, 0, -1));
        scene.addMassless(boomerangKind(), Vec3(0, 0, 3));
        add(scene.integrator);
        const auto run = [&] {
            scene.start(testPlatform());
            scene.integrator.step(1);
        };
        if (refused)
            expectError(run, {"CustomRigidHIIntegrator: joint 0 (" + joint + ") ",
                              "turns body 0 about the line of its hydrodynamic particles, which "
                              "nothing resists; put the anchor and the axis on this line and leave "
                              "the motor out, or give the body particles off the line"});
        else
            run();
    };
    const Vec3 other(0, 0, -3);
    expectRefused("a ball of body 0 and body 1", [&](RigidHI& integrator) {
        integrator.addBallJoint(0, beside, 1, other + across * 0.5);
    });
    expectRefused("a link of body 0 and body 1",
                  [&](RigidHI& integrator) { integrator.addLink(0, beside, 1, across * 0.5, 3); });
    expectRefused("a hinge of body 0 and body 1", [&](RigidHI& integrator) {
        integrator.addHinge(0, end, 1, other, across, across);
    });
    expectRefused("a hinge of body 0 and body 1", [&](RigidHI& integrator) {
        integrator.addHinge(0, end, 1, other, along, along);
        integrator.addHingeMotor(0, 1);
    });
    for (bool isHinge : {false, true})
        expectRefused(
            "",
            [&](RigidHI& integrator) {
                if (isHinge)
                    integrator.addHinge(0, end, 1, other, along, along);
                else
                    integrator.addBallJoint(0, end, 1, other);
            },
            false);
}
