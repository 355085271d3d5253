// Bodies with prescribed motion (CustomBodyMotion) among bodies with momenta in a fluid
// (LangevinHI), by the public API. Units have kT = 1.

#include <openmm/CustomExternalForce.h>

#include "LangevinHISupport.h"
#include "ReferenceScenes.h"
#include "openmmrigidhi/CustomBodyForce.h"
#include "openmmrigidhi/CustomBodyMotion.h"

using namespace OpenMM;
using namespace RigidHITest;
using RigidHIPlugin::CustomBodyForce;
using RigidHIPlugin::CustomBodyMotion;
using namespace std;

namespace {

using RigidHI = CustomRigidHIIntegrator;

CustomBodyMotion* motion(const vector<string>& e, bool inBody = false) {
    auto* made = new CustomBodyMotion(e[0], e[1], e[2], e[3], e[4], e[5]);
    if (inBody) made->setFrame(CustomBodyMotion::Body);
    return made;
}

const vector<string> orbit = {"speed*cos(3*t)", "0.3*sin(2*t)", "-0.2", "0.4", "t", "0.5*cos(t)"};

/** A boomerang that is driven beside a sphere, a boomerang and a particle in wells. */
struct Driven : FluidScene {
    Driven(double temperature, double h, const vector<string>& expressions, bool inBody = false,
           int threads = 1, const function<void(Driven&)>& change = {})
        : FluidScene(temperature, h) {
        fluid->setBoundary(MobilityForce::NoSlipWall);
        add(boomerangKind(), Vec3(0, 0, 4), {{0.8, 0, 0.6, 0}});
        add(markedSphere(0.8, 2, Vec3(0.5, 0.6, 0.8)), Vec3(3, 0.5, 3.5), {{0.6, 0, 0, 0.8}});
        add(boomerangKind(), Vec3(0, 4, 3.5), {{0, 0.6, 0.8, 0}});
        addFree(1.5, 0.4, Vec3(-3, 1, 4));
        addField(system, "2*(x-1)^2 + (y-1)^2 + 0.5*(z-4)^2 + 0.3*x*y");
        CustomBodyMotion* driving = motion(expressions, inBody);
        driving->addGlobalParameter("speed", 1.5);
        driving->addBody(0, {});
        system.addForce(driving);
        if (change) change(*this);
        start(testPlatform(), threads);
        if (temperature > 0) context->setVelocitiesToTemperature(temperature, 7);
    }
};

VectorXd column(const vector<double>& numbers) {
    return Eigen::Map<const VectorXd>(numbers.data(), numbers.size());
}

/** A scene of tests/data/bodies, whose first body is driven; masses are so small that momenta relax
 * before anything moves. */
struct OfReference : FluidScene {
    OfReference(const ReferenceScene& reference, double mass, double h,
                MobilityForce::Solver solver, bool withForces)
        : FluidScene(0, h) {
        const JsonValue& data = reference.data;
        fluid->setViscosity(data["viscosity"].number);
        fluid->setSolver(solver);
        fluid->setSolverTolerance(1e-11);
        if (data["boundary"].text != "Unbounded") fluid->setBoundary(MobilityForce::NoSlipWall);
        const vector<double> wrenches = data["wrenches"].numbers();
        vector<string> components(6);
        for (const JsonValue& constraint : data["constraints"].list) {
            const Vector3d axis = constraint["axis"].vector3();
            for (int k = 0; k < 3; k++)
                if (axis[k] == 1)
                    components[k + 3 * (constraint["what"].text == "W")] =
                        to_string(constraint["value"].number);
        }
        for (int b = 0; b < data["bodies"].size(); b++) {
            const JsonValue& body = data["bodies"][b];
            BodyKind kind = {"reference", mass, Vec3(mass, 1.2 * mass, 1.4 * mass), {}, {}};
            for (int i = 0; i < body["sites"].size(); i++)
                kind.sites.push_back(toVec3(body["sites"][i].vector3()));
            kind.radii = body["radii"].numbers();
            const auto q = body["quaternion"].numbers();
            add(kind, toVec3(body["position"].vector3()), {{q[0], q[1], q[2], q[3]}});
            vector<string> wrench;
            for (int k = 0; k < 6; k++) {
                ostringstream text;
                text.precision(17);
                text << (withForces ? wrenches[6 * b + k] : 0);
                wrench.push_back(text.str());
            }
            auto* force = new CustomBodyForce(wrench[0], wrench[1], wrench[2], wrench[3], wrench[4],
                                              wrench[5]);
            force->addBody(b, {});
            system.addForce(force);
        }
        CustomBodyMotion* driving = motion(components);
        driving->addBody(0, {});
        system.addForce(driving);
        start(testPlatform());
    }
};

}  // namespace

/** In the limit of strong friction, bodies have the velocities of schemes without momenta. */
TEST(PrescribedMomenta, StrongFrictionGivesTheVelocitiesOfTheOverdampedProblem) {
    for (const string name : {"moving_body", "moving_body_wall"})
        for (auto solver : {MobilityForce::Dense, MobilityForce::MatrixFree}) {
            const ReferenceScene reference(name);
            const VectorXd U = reference.data["U"].column(),
                           F = reference.data["wrenches"].column(),
                           hold = reference.data["hold"].column();
            const MatrixXd N = reference.matrix("Nc");
            // Without forces the velocities of one long step are exactly those of the flow.
            OfReference drag(reference, 1e-12, 1e-10, solver, false);
            drag.integrator.step(1);
            const VectorXd flow = U - N * F;
            const VectorXd after = twistsOf(drag);
            EXPECT_LT((after - flow).tail<6>().norm(), 1e-9 * U.norm()) << name << solver;
            EXPECT_EQ(after.head<6>().norm(), 0);
            EXPECT_GT(flow.tail<6>().norm(), 1e-3);
            // With forces in many short ones, with an error of second order in them.
            const double mass = 1e-8;
            OfReference pulled(reference, mass, 4e-4 * mass, solver, true);
            pulled.integrator.step(solver == MobilityForce::Dense ? 15000 : 1);
            if (solver == MobilityForce::MatrixFree) {
                // The velocities that they have in the end
                VectorXd twists = U;
                twists.head<6>().setZero();
                setTwists(pulled, twists);
            } else
                EXPECT_LT((twistsOf(pulled) - U).tail<6>().norm(), 1e-5 * U.norm()) << name;
            const VectorXd now = column(pulled.integrator.computeHoldingWrenches());
            EXPECT_LT((now - hold).head<6>().norm(), 1e-5 * hold.norm()) << name << solver;
            EXPECT_LT(now.tail<6>().norm(), 1e-5 * hold.norm());
            pulled.integrator.step(1);
            const VectorXd last = column(pulled.integrator.getHoldingWrenches());
            EXPECT_LT((last - hold).head<6>().norm(), 1e-4 * hold.norm()) << name << solver;
            EXPECT_EQ(last.tail<6>().norm(), 0);
        }
}

/**
 * The path is the integral of the expressions, and the other bodies follow, with errors of order
 * two.
 */
TEST(PrescribedMomenta, TrajectoriesHaveOrderTwo) {
    for (bool inBody : {false, true})
        for (bool matrixFree : {false, true}) {
            vector<VectorXd> ends, holds;
            for (int n : {20, 40, 80}) {
                Driven scene(0, 0.4 / n, orbit, inBody, 1, [&](Driven& own) {
                    own.fluid->setSolver(matrixFree ? MobilityForce::MatrixFree
                                                    : MobilityForce::Dense);
                    own.fluid->setSolverTolerance(1e-10);
                });
                VectorXd sum = VectorXd::Zero(18);
                for (int i = 0; i < n; i++) {
                    scene.integrator.step(1);
                    sum += column(scene.integrator.getHoldingWrenches()) / n;
                }
                ends.push_back(scene.state());
                holds.push_back(sum);
            }
            const double ratio = (ends[0] - ends[1]).norm() / (ends[1] - ends[2]).norm(),
                         ofHolds = (holds[0] - holds[1]).norm() / (holds[1] - holds[2]).norm();
            EXPECT_GT((ends[0] - ends[1]).norm(), 1e-5);
            EXPECT_GT(ratio, 3.7) << inBody << matrixFree;
            EXPECT_LT(ratio, 4.3) << inBody << matrixFree;
            EXPECT_GT(holds[2].norm(), 1);
            EXPECT_GT(ofHolds, 3.5) << inBody << matrixFree;
            EXPECT_LT(ofHolds, 4.5) << inBody << matrixFree;
        }
    // The path itself, in the lab: the mid-point rule over half steps.
    const double h = 0.02;
    Driven scene(T1, h, {"speed*sin(9*t)", "0", "0", "0", "0", "0"});
    const Vec3 start = scene.integrator.getBodyPositions()[0];
    const auto q = scene.integrator.getBodyOrientations()[0];
    scene.integrator.step(20);
    double x = start[0];
    for (int i = 0; i < 40; i++) x += 1.5 * h / 2 * sin(9 * (i + 0.5) * h / 2);
    const Vec3 end = scene.integrator.getBodyPositions()[0];
    EXPECT_NEAR(end[0], x, 1e-12);
    EXPECT_EQ(end[1], start[1]);
    EXPECT_EQ(end[2], start[2]);
    EXPECT_EQ(scene.integrator.getBodyOrientations()[0], q);
    // Its particles are where it is.
    const auto places = positionsOf(*scene.context);
    for (size_t i = 0; i < scene.particles[0].size(); i++)
        EXPECT_LT(norm(places[scene.particles[0][i]] - end - rotate(q, scene.bodies[0].sites[i])),
                  readTolerance(1e-13, 10));
}

namespace {

/** A driven boomerang and a sphere whose momentum relaxes within a step, at one place always. */
struct OneStep : FluidScene {
    const double mass = 1e-8;
    explicit OneStep(double h) : FluidScene(T1, h) {
        add(boomerangKind(), Vec3(), {{0.8, 0, 0.6, 0}});
        BodyKind sphere = sphereKind(0.6);
        sphere.mass = mass;
        sphere.moments = Vec3(0.4 * mass, 0.4 * mass, 0.4 * mass);
        add(sphere, Vec3(0.4, 2.1, 0.3));
        // As fast as thermal motion.
        CustomBodyMotion* driving = motion({"2e4", "-1e4", "1e4", "5e3", "-2e4", "1e4"});
        driving->addBody(0, {});
        system.addForce(driving);
        start(testPlatform());
    }
};

}  // namespace

/** Momenta have their temperature relative to the flow of the driven body. */
TEST(PrescribedMomenta, EquipartitionIsAboutTheFlow) {
    // The slowest rate is 6 pi eta a/m = 6.8/m, so that each step forgets the one before.
    OneStep scene(3e-8);
    const MatrixXd xi = scene.friction();
    VectorXd U_p(6);
    U_p << 2e4, -1e4, 1e4, 5e3, -2e4, 1e4;
    const VectorXd flow = -xi.bottomRightCorner(6, 6).llt().solve(xi.bottomLeftCorner(6, 6) * U_p);
    EXPECT_GT(flow.norm(), 5e3);
    const auto R = scene.integrator.getBodyPositions();
    const auto q = scene.integrator.getBodyOrientations();
    const int n = 4000;
    VectorXd mean = VectorXd::Zero(6), square = mean, holdMean = mean, holdSquare = mean;
    const VectorXd force = xi.topLeftCorner(6, 6) * U_p + xi.topRightCorner(6, 6) * flow;
    for (int i = 0; i < n; i++) {
        scene.pose(R, q);
        scene.integrator.step(1);
        const VectorXd twist = twistsOf(scene).tail<6>() - flow;
        mean += twist / n;
        square += twist.cwiseAbs2() / n;
        const VectorXd hold = column(scene.integrator.getHoldingWrenches()).head<6>() - force;
        holdMean += hold / n;
        holdSquare += hold.cwiseAbs2() / n;
    }
    // Of white noise, 2 kT/h of the inverse of the mobility of the driven body beside a free one;
    // of the momenta that are given back, 2 m kT/h^2 through the fluid.
    const double h = scene.integrator.getStepSize();
    const MatrixXd pull = xi.topRightCorner(6, 6) * xi.bottomRightCorner(6, 6).inverse(),
                   white = xi.topLeftCorner(6, 6) - pull * xi.bottomLeftCorner(6, 6);
    VectorXd inertia(6);
    inertia << VectorXd::Constant(3, scene.mass), VectorXd::Constant(3, 0.4 * scene.mass);
    const MatrixXd variance =
        2 / h * white + 2 / (h * h) * pull * inertia.asDiagonal() * pull.transpose();
    for (int k = 0; k < 6; k++) {
        // Within five standard errors, of the mean and of the variance: false alarms 1e-5 in all.
        // The sphere moves by 1e-3 until the middle of the step, which changes the flow as much.
        const double kT_m = 1 / inertia[k];
        EXPECT_NEAR(mean[k], 0, 5 * sqrt(kT_m / n) + 2e-3 * flow.norm()) << k;
        EXPECT_NEAR(square[k] / kT_m, 1, 5 * sqrt(2.0 / n)) << k;
        EXPECT_NEAR(holdMean[k], 0, 5 * sqrt(variance(k, k) / n) + 2e-3 * force.norm()) << k;
        EXPECT_NEAR(holdSquare[k] / variance(k, k), 1, 5 * sqrt(2.0 / n) + 2e-3) << k;
    }
}

TEST(PrescribedMomenta, WhatHoldsThemIsFrictionLessForces) {
    for (bool inBody : {false, true}) {
        Driven scene(T1, 0.01, orbit, inBody, 1,
                     [](Driven& own) { own.integrator.setBodyHeld(2, true); });
        scene.integrator.step(5);
        const double t = scene.context->getTime();
        VectorXd U(21);
        U.setZero();
        U.segment<6>(0) << 1.5 * cos(3 * t), 0.3 * sin(2 * t), -0.2, 0.4, t, 0.5 * cos(t);
        const auto q = scene.integrator.getBodyOrientations()[0];
        if (inBody)
            for (int part : {0, 3})
                U.segment<3>(part) = (rotationOf(q) * U.segment<3>(part)).eval();
        const VectorXd now = column(scene.integrator.computeHoldingWrenches());
        const VectorXd ofOthers = twistsOf(scene);
        U.segment<6>(6) = ofOthers.segment<6>(6);
        U.tail<3>() = ofOthers.tail<3>();
        VectorXd forces(18);
        const auto f = scene.integrator.getBodyForces(), torque = scene.integrator.getBodyTorques();
        for (int b = 0; b < 3; b++) forces.segment<6>(6 * b) << toEigen(f[b]), toEigen(torque[b]);
        const MatrixXd friction = scene.expected().friction;
        VectorXd expected = (friction * U).head(18) - forces;
        expected.segment<6>(6).setZero();
        EXPECT_LT((now - expected).norm(), forceTolerance(1e-9, 1) * expected.norm());
        // The body that is held by setBodyHeld() is held against the same flow.
        EXPECT_GT(expected.tail<6>().norm(), 0.1);
        EXPECT_GT(column(scene.integrator.getHoldingWrenches()).tail<6>().norm(), 0.1);
    }
}

/** Velocities of force-free bodies, and so the flow, are those of a scheme without momenta. */
TEST(PrescribedMomenta, TheFluidFlowsAsWithoutMomenta) {
    const vector<Vec3> points = {Vec3(1, 1, 2), Vec3(-1, 2, 5), Vec3(4, -2, 3)};
    vector<vector<Vec3>> flows;
    for (auto scheme : {RigidHI::LangevinHI, RigidHI::EulerMaruyama}) {
        FluidScene scene(0, 1e-9);
        scene.add(boomerangKind(), Vec3(0, 0, 4), {{0.8, 0, 0.6, 0}});
        scene.add(sphereKind(0.8, 1e-12, 1e-12), Vec3(3, 0.5, 3.5));
        scene.integrator.setScheme(scheme);
        CustomBodyMotion* driving = motion({"1", "0.5", "0", "0", "-0.4", "0.3"}, true);
        driving->addBody(0, {});
        scene.system.addForce(driving);
        scene.start(testPlatform());
        if (scheme == RigidHI::LangevinHI) scene.integrator.step(1);
        flows.push_back(scene.fluid->getFlowInContext(*scene.context, points));
    }
    for (size_t i = 0; i < points.size(); i++) {
        EXPECT_GT(norm(flows[0][i]), 0.01);
        EXPECT_LT(norm(flows[0][i] - flows[1][i]), 1e-7);
    }
}

TEST(PrescribedMomenta, ResumesBitForBit) {
    for (auto solver : {MobilityForce::Dense, MobilityForce::MatrixFree}) {
        const auto make = [&](int threads) {
            return make_unique<Driven>(T1, 0.01, orbit, true, threads,
                                       [&](Driven& own) { own.fluid->setSolver(solver); });
        };
        const auto begin = [](Driven& scene) {
            scene.integrator.step(3);
            scene.context->setParameter("speed", 0.4);
            scene.integrator.step(2);
        };
        expectToResumeBitForBit<Driven>(make, begin, 4);
        // With what held it, and whether or not anyone asks.
        const auto once = make(1), again = make(1), byXml = make(2), unasked = make(1);
        begin(*once);
        stringstream checkpoint, xml;
        saveState(*once->context, checkpoint, xml);
        again->context->loadCheckpoint(checkpoint);
        loadState(*byXml->context, xml);
        const auto holds = once->integrator.getHoldingWrenches();
        EXPECT_GT(column(holds).head<6>().norm(), 1);
        EXPECT_EQ(again->integrator.getHoldingWrenches(), holds);
        EXPECT_EQ(byXml->integrator.getHoldingWrenches(), holds);
        EXPECT_EQ(once->integrator.getHoldingWrenches(), holds);
        begin(*unasked);
        EXPECT_EQ(unasked->integrator.getHoldingWrenches(), holds);
        once->integrator.step(3);
        unasked->integrator.step(3);
        EXPECT_EQ(once->state(), unasked->state());
    }
}

TEST(PrescribedMomenta, BodiesMoveInEveryModelAndBoundary) {
    struct Case {
        MobilityForce::Model model;
        MobilityForce::Boundary boundary;
        bool alone;
    };
    for (const Case& fluid :
         {Case{MobilityForce::FreeDraining, MobilityForce::Unbounded, false},
          Case{MobilityForce::RotnePragerYamakawa, MobilityForce::Unbounded, false},
          Case{MobilityForce::RotnePragerYamakawa, MobilityForce::NoSlipWall, false},
          Case{MobilityForce::RotnePragerYamakawa, MobilityForce::Periodic, false},
          Case{MobilityForce::StokesianDynamics, MobilityForce::Unbounded, false}}) {
        FluidScene scene(T1, 0.01);
        scene.fluid->setModel(fluid.model);
        scene.fluid->setBoundary(fluid.boundary);
        for (int b = 0; b < 3; b++) scene.add(sphereKind(0.6), Vec3(2.5 * b, 0.3 * b, 3));
        CustomBodyMotion* driving = motion({"0.5", "t", "0", "0", "1", "0"});
        driving->addBody(1, {});
        scene.system.addForce(driving);
        scene.start(testPlatform());
        const auto before = scene.integrator.getBodyPositions();
        scene.integrator.step(10);
        const auto after = scene.integrator.getBodyPositions();
        const string name = to_string(fluid.model) + " " + to_string(fluid.boundary);
        EXPECT_LT(norm(after[1] - before[1] - Vec3(0.05, 0.005, 0)), 1e-12) << name;
        const auto q = scene.integrator.getBodyOrientations()[1];
        EXPECT_NEAR(q[0], cos(0.05), 1e-12) << name;
        EXPECT_NEAR(q[2], sin(0.05), 1e-12) << name;
        EXPECT_GT(norm(after[0] - before[0]), 1e-3) << name;
        const VectorXd hold = column(scene.integrator.getHoldingWrenches());
        EXPECT_GT(hold.segment<6>(6).norm(), 1) << name;
        if (fluid.model == MobilityForce::FreeDraining) {
            const VectorXd now = column(scene.integrator.computeHoldingWrenches());
            const double drag = 6 * M_PI * 0.6 * 0.6;
            EXPECT_NEAR(now[6], 0.5 * drag, 1e-9);
            EXPECT_NEAR(now[7], 0.1 * drag, 1e-9);
        }
    }
}

TEST(PrescribedMomenta, TheirMomentaAreNotState) {
    Driven scene(T1, 0.01, orbit);
    EXPECT_EQ(scene.integrator.getBodyVelocities()[0], Vec3());
    EXPECT_EQ(scene.integrator.getDegreesOfFreedom().at("total"), 15);
    vector<Vec3> V(3, Vec3(3, 2, 1));
    scene.integrator.setBodyVelocities(V);
    EXPECT_EQ(scene.integrator.getBodyVelocities()[0], Vec3());
    scene.integrator.step(3);
    EXPECT_EQ(scene.integrator.getBodyVelocities()[0], Vec3());
    EXPECT_EQ(scene.integrator.getBodyAngularVelocities()[0], Vec3());
    for (int p : scene.particles[0]) EXPECT_EQ(velocitiesOf(*scene.context)[p], Vec3());
    EXPECT_GT(norm(scene.integrator.getBodyVelocities()[1]), 0.1);
    EXPECT_EQ(scene.integrator.getEffects()["prescribed motion"],
              "on: body 0: vx, vy, vz, wx, wy, wz");
    // So it needs no mass, whatever its shape.
    for (double mass : {0.0, 5.0}) {
        FluidScene light(0, 0.01);
        BodyKind kind = boomerangKind();
        kind.mass = mass;
        kind.moments = mass * Vec3(0.3, 0.4, 0.5);
        light.add(kind);
        light.add(sphereKind(0.5), Vec3(0, 3, 0));
        CustomBodyMotion* driving = motion({"1", "0", "0", "0", "0", "2"});
        driving->addBody(0, {});
        light.system.addForce(driving);
        light.start(testPlatform());
        light.integrator.step(10);
        EXPECT_LT(norm(light.integrator.getBodyPositions()[0] - Vec3(0.1, 0, 0)), 1e-13) << mass;
        EXPECT_NEAR(light.integrator.getBodyOrientations()[0][3], sin(0.1), 1e-13) << mass;
        EXPECT_EQ(counter(light, "randomNumbers"), 0);
    }
}

/** The velocities that a driven body gives to others do not count as heat. */
TEST(PrescribedMomenta, TheWatchExpectsNoTemperatureBesideThem) {
    FluidScene scene(T1, 0.02);
    scene.add(sphereKind(0.6));
    scene.add(sphereKind(0.5, 1, 0.3), Vec3(1.7, 0, 0));
    addField(scene.system, "x^2+y^2+4*z^2");
    CustomBodyMotion* driving = motion({"0", "0", "0", "0", "0", "200"});
    driving->addBody(0, {});
    scene.system.addForce(driving);
    scene.start(testPlatform());
    scene.context->setVelocitiesToTemperature(T1, 3);
    scene.integrator.step(20000);
    EXPECT_GT(scene.integrator.computeMidStepTemperatures().at("total"), 1.5 * T1);
    EXPECT_EQ(scene.integrator.getEffects().at("warnings").find("have been at"), string::npos)
        << scene.integrator.getEffects().at("warnings");
}

TEST(PrescribedMomenta, TheSchemeMayChange) {
    Driven scene(T1, 0.01, orbit), fromThere(T1, 0.01, orbit);
    scene.integrator.step(3);
    scene.integrator.setScheme(RigidHI::TrapezoidalSlip);
    scene.integrator.step(2);
    EXPECT_GT(column(scene.integrator.getHoldingWrenches()).head<6>().norm(), 1);
    scene.integrator.setScheme(RigidHI::LangevinHI);
    const Vec3 before = scene.integrator.getBodyPositions()[0];
    scene.integrator.step(1);
    const double t = 0.05;
    const Vec3 moved = scene.integrator.getBodyPositions()[0] - before;
    EXPECT_NEAR(moved[0], 0.005 * 1.5 * (cos(3 * (t + 0.0025)) + cos(3 * (t + 0.0075))), 1e-12);
    EXPECT_GT(column(scene.integrator.getHoldingWrenches()).head<6>().norm(), 1);
}

namespace {

void expectErrorAtOnce(FluidScene& scene) {
    string message;
    VectorXd before;
    int steps = 0;
    for (; steps < 100 && message.empty(); steps++) try {
            before = scene.state();
            scene.integrator.step(1);
        } catch (const OpenMMException& e) {
            message = e.what();
        }
    EXPECT_GT(steps, 2);
    EXPECT_NE(message.find("a prescribed motion leads to where the fluid has no mobility, which no "
                           "noise can mend"),
              string::npos)
        << message;
    EXPECT_EQ(scene.state(), before);
    EXPECT_EQ(scene.integrator.getNumRejectedSteps(), 0);
}

}  // namespace

TEST(PrescribedMomenta, WhatLeadsIntoAWallOrAnOverlapIsAnErrorAtOnce) {
    Driven falling(T1, 0.02, {"0", "0", "-20", "0", "0", "0"});
    expectErrorAtOnce(falling);
    FluidScene meeting(T1, 0.02);
    meeting.fluid->setModel(MobilityForce::StokesianDynamics);
    for (int b = 0; b < 3; b++) meeting.add(sphereKind(0.5), Vec3(3 * b, 0, 0));
    meeting.integrator.setBodyHeld(1, true);
    CustomBodyMotion* driving = motion({"5", "0", "0", "0", "0", "0"});
    driving->addBody(0, {});
    meeting.system.addForce(driving);
    meeting.start(testPlatform());
    expectErrorAtOnce(meeting);
    // Where a body is stopped in time, the others go on.
    Driven stopped(T1, 0.02, {"0", "0", "speed", "0", "0", "0"});
    stopped.context->setParameter("speed", -20);
    string message;
    while (message.empty()) try {
            stopped.integrator.step(1);
        } catch (const OpenMMException& e) {
            message = e.what();
        }
    stopped.context->setParameter("speed", 0);
    EXPECT_NO_THROW(stopped.integrator.step(5));
    // A velocity that is not finite is an error, and the step is undone.
    Driven infinite(T1, 0.25, {"0.01/(t - 0.625)", "0", "0", "0", "0", "0"});
    infinite.integrator.step(2);
    const VectorXd before = infinite.state();
    expectError([&] { infinite.integrator.step(1); }, {"at t = 0.625 ps"});
    EXPECT_EQ(infinite.state(), before);
}
