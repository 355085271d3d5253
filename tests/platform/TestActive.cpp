// Active bodies: bodies with a slip on their surface. Their motion is compared with a second
// implementation of rigid multiblobs, and their flow with the velocities at their surface.
// (test_active.py has squirmers.)

#include "FlowReadingSupport.h"

using namespace OpenMM;
using namespace RigidHITest;
using namespace std;

namespace {

const ModelCase matrixFree = {"matrix-free", MobilityForce::RotnePragerYamakawa,
                              MobilityForce::MatrixFree};

/** Bodies in the fluid, some of which have slips. */
struct ActiveScene : Pushed {
    using Pushed::Pushed;
    map<int, vector<Vec3>> slipOfBody;

    static vector<Vec3> someSlip(int particles, int seed, double factor = 1) {
        mt19937 random(seed);
        normal_distribution<double> normal;
        vector<Vec3> velocities(particles);
        for (Vec3& v : velocities)
            for (int k = 0; k < 3; k++) v[k] = 0.1 * factor * normal(random);
        return velocities;
    }
    void setSlip(int body, double factor = 1) {
        int particles = 0;
        for (double radius : bodies[body].radii) particles += radius > 0;
        slipOfBody[body] = someSlip(particles, body, factor);
        fluid->setBodySlip(body, slipOfBody[body]);
    }
    struct Push {
        int body;
        Vector3d site, force;
        double radius;
    };
    vector<Push> pushes;
    void push(int body, const Vec3& site, double radius, const Vec3& force) {
        pushes.push_back({body, toEigen(site), toEigen(force), radius});
        fluid->addBodyForceOnFluid(body, site, radius, force);
    }
    /** Forces on sites, and the opposite ones on bodies. @param all  bodies, and sites as particles
     */
    VectorXd wrenchesOfPushes(vector<LabBody>& all) {
        all = labBodies();
        const vector<LabBody> real = all;
        const auto q = integrator.getBodyOrientations();
        int rows = 0;
        vector<int> first;
        for (const LabBody& body : real) {
            first.push_back(rows);
            rows += body.rows();
        }
        VectorXd wrenches = VectorXd::Zero(rows + 3 * pushes.size());
        for (const Push& push : pushes) {
            const Matrix3d A = rotationOf(q[push.body]);
            const Vector3d f = A * push.force, arm = A * push.site;
            wrenches.segment<3>(first[push.body]) -= f;
            wrenches.segment<3>(first[push.body] + 3) -= arm.cross(f);
            wrenches.segment<3>(rows) = f;
            rows += 3;
            all.push_back({real[push.body].R + arm, {Vector3d::Zero()}, {push.radius}, true});
        }
        return wrenches;
    }
    VectorXd velocitiesByPushes() {
        vector<LabBody> all;
        const VectorXd wrenches = wrenchesOfPushes(all);
        return (expected(all).mobility * wrenches).head(wrenches.size() - 3 * pushes.size());
    }
    /** -A u of the particles, in the order of labBodies(). */
    VectorXd activeSlips() {
        const auto q = integrator.getBodyOrientations();
        const vector<LabBody> all = labBodies();
        vector<double> rows;
        for (size_t b = 0; b < all.size(); b++)
            for (size_t i = 0; i < all[b].radii.size(); i++) {
                Vector3d slip = Vector3d::Zero();
                if (slipOfBody.count(b)) slip = -rotationOf(q[b]) * toEigen(slipOfBody[b][i]);
                rows.insert(rows.end(), slip.data(), slip.data() + 3);
                if (all[b].isSphere()) rows.insert(rows.end(), 3, 0.0);
            }
        return Eigen::Map<VectorXd>(rows.data(), rows.size());
    }
};

/** A boomerang and a rod that are active, beside spheres and a free particle. */
void addActiveMixture(ActiveScene& scene) {
    scene.addMixture();
    for (int body : {2, 3}) scene.setSlip(body);
}

void useWall(ActiveScene& scene, MobilityForce::Boundary boundary) {
    scene.fluid->setBoundary(boundary);
    scene.fluid->setWallHeight(0.7);
}

/** The displacement of a body with a slip of its own, beside that without the slip. */
Vector3d displacementBySlip(RigidHI::Scheme scheme, RigidHI::DriftCorrectorScaling scaling,
                            double h, double factor) {
    Vector3d end[2];
    for (bool active : {false, true}) {
        ActiveScene scene(rotnePrager, T1, h, scheme);
        scene.integrator.setDriftCorrectorScaling(scaling);
        scene.add(boomerangKind(), Vec3());
        scene.add(sphereKind(0.6), Vec3(0, 0, 60));
        if (active) scene.setSlip(0, factor);
        scene.start();
        scene.integrator.step(1);
        end[active] = toEigen(scene.integrator.getBodyPositions()[0]);
    }
    return end[1] - end[0];
}

}  // namespace

// ---- Motion ----

TEST(Active, BodiesMoveAsTheirBlobsLetThem) {
    for (auto boundary : {MobilityForce::Unbounded, MobilityForce::NoSlipWall})
        for (const ModelCase& model : {rotnePrager, matrixFree})
            for (bool own : {false, true}) {
                ActiveScene scene(model);
                useWall(scene, boundary);
                addActiveMixture(scene);
                // A body with a tensor of its own goes as its blobs do, as in a driven flow.
                if (own) scene.fluid->setBodyMobility(2, rowsOf(tensorWithoutSymmetry(2)));
                if (own) scene.fluid->setBodyMobility(0, rowsOf(tensorWithoutSymmetry(1)));
                if (own && model.solver == MobilityForce::Dense) scene.setSlip(2, 3);
                scene.start();
                const VectorXd expected = scene.expected().following * scene.activeSlips();
                EXPECT_GT(expected.norm(), 0.1);
                expectNear(scene.stepTwists(), expected, 1e-9);
            }
}

TEST(Active, ABodyAloneHasAConstantVelocity) {
    for (const ModelCase& model : {rotnePrager, matrixFree})
        for (bool isRod : {false, true})
            for (bool own : {false, true}) {
                if (own && isRod) continue;
                ActiveScene scene(model);
                scene.add(isRod ? rodKind() : boomerangKind(), Vec3(1, 2, 3), {{0.6, 0, 0.8, 0}});
                scene.setSlip(0);
                if (own) scene.fluid->setBodyMobility(0, rowsOf(tensorWithoutSymmetry(2)));
                scene.start();
                const VectorXd expected = scene.expected().following * scene.activeSlips();
                expectNear(scene.stepTwists(), expected, 1e-12);
            }
}

TEST(Active, FreeDrainingBodiesGoEachByItself) {
    ActiveScene scene;
    scene.fluid->setModel(MobilityForce::FreeDraining);
    addActiveMixture(scene);
    scene.start();
    const VectorXd slips = scene.activeSlips();
    vector<double> expected;
    int row = 0;
    for (const LabBody& body : scene.labBodies()) {
        const int rows = body.radii.size() * (body.isSphere() ? 6 : 3);
        const VectorXd twist = scene.expected({body}).following * slips.segment(row, rows);
        expected.insert(expected.end(), twist.data(), twist.data() + twist.size());
        row += rows;
    }
    expectNear(scene.stepTwists(), Eigen::Map<VectorXd>(expected.data(), expected.size()), 1e-12);
}

/** The velocity is constant in the body's frame, so the path is a helix. */
TEST(Active, GoesAlongAHelixInTheOrderOfTheScheme) {
    for (const SchemeTraits& traits : overdampedSchemes()) {
        const double time = 2;
        double errors[2];
        for (int fine : {0, 1}) {
            ActiveScene scene(rotnePrager, 0, time / (fine ? 80 : 40), traits.scheme);
            scene.add(boomerangKind(), Vec3(1, 2, 3), {{0.6, 0, 0.8, 0}});
            scene.setSlip(0, 20);
            scene.start();
            const VectorXd twist = scene.expected().following * scene.activeSlips();
            const Vector3d V = twist.head<3>(), W = twist.tail<3>();
            const double w = W.norm(), angle = w * time;
            EXPECT_GT(angle, 0.5);
            const Vector3d path = time * V + (1 - cos(angle)) / (w * w) * W.cross(V) +
                                  (angle - sin(angle)) / (w * w * w) * W.cross(W.cross(V));
            scene.integrator.step(fine ? 80 : 40);
            errors[fine] =
                (toEigen(scene.integrator.getBodyPositions()[0]) - Vector3d(1, 2, 3) - path).norm();
        }
        const double order = log2(errors[0] / errors[1]);
        EXPECT_NEAR(order, traits.coldOrder, 0.15) << traits.name;
    }
}

TEST(Active, TheDriftFactorDoesNotMultiplyIt) {
    // The body is too far from anything to feel it, so that its velocity is one of its own frame.
    const double h = 0.02;
    for (auto scheme : {RigidHI::DriftCorrectorFD, RigidHI::DriftCorrectorRFD}) {
        ActiveScene alone;
        alone.add(boomerangKind(), Vec3());
        alone.setSlip(0, 20);
        alone.start();
        const VectorXd twist = alone.expected().following * alone.activeSlips();
        const double expected = h * twist.head<3>().norm(),
                     slipOnly = displacementBySlip(scheme, RigidHI::SlipOnly, h, 20).norm(),
                     whole = displacementBySlip(scheme, RigidHI::Whole, h, 20).norm();
        EXPECT_NEAR(slipOnly, expected, 1e-5 * expected);
        EXPECT_GT(abs(whole - expected), 1e-3 * expected);  // there is a drift factor
    }
}

/** With the same random numbers, the slip of a body adds the same velocity with and without noise:
 * in EulerMaruyama the step is linear. */
TEST(Active, NoiseIsThatOfPassiveBodies) {
    const double h = 1e-3;
    VectorXd twists[2][2];
    int ofBodies = 0;
    for (bool noise : {false, true})
        for (bool active : {false, true}) {
            ActiveScene scene(rotnePrager, noise ? T1 : 0, h);
            scene.addMixture();
            if (active) scene.setSlip(2);
            scene.start();
            twists[noise][active] = scene.stepTwists();
            ofBodies = 6 * scene.integrator.getNumRigidBodies();
        }
    EXPECT_GT(twists[1][0].norm(), 10);
    const VectorXd found = twists[1][1] - twists[1][0], expected = twists[0][1];
    EXPECT_LE((found - expected).head(ofBodies).cwiseAbs().maxCoeff(), 1e-9);
    // Velocities of free particles are differences of positions that were read from the Context.
    const double largest = (found - expected).tail(found.size() - ofBodies).cwiseAbs().maxCoeff();
    EXPECT_LE(largest, readTolerance(1e-9, 10 / h));
}

TEST(Active, ABodyThatIsHeldPumps) {
    for (const ModelCase& model : {rotnePrager, matrixFree}) {
        ActiveScene scene(model);
        scene.add(boomerangKind(), Vec3(0, 0, 0), {{0.6, 0, 0.8, 0}});
        scene.add(apartKind(), Vec3(3, 1, 0), {{0.8, 0.6, 0, 0}});
        scene.add(sphereKind(0.6), Vec3(-1, 3.5, 1));
        for (int b : {0, 1}) scene.setSlip(b);
        scene.integrator.setBodyHeld(0, true);
        scene.start();
        const IndependentMobility reference = scene.expected();
        const VectorXd pushed = reference.friction * reference.following * scene.activeSlips();
        VectorXd twists = VectorXd::Zero(18);
        twists.tail(12) =
            reference.friction.bottomRightCorner(12, 12).ldlt().solve(pushed.tail(12));
        const VectorXd hold = (reference.friction * twists - pushed).head(6);
        EXPECT_GT(hold.norm(), 0.1);
        const auto now = scene.integrator.computeHoldingWrenches();
        expectNear(scene.stepTwists(), twists, 1e-9);
        const auto last = scene.integrator.getHoldingWrenches();
        for (int k = 0; k < 6; k++) {
            EXPECT_NEAR(now[k], hold[k], 1e-8);
            EXPECT_NEAR(last[k], hold[k], 1e-8);
        }
    }
}

/**
 * If a step does not resolve the spin of a body about its long axis, it slows the noise of this
 * spin, but not the spin that the slip causes.
 */
TEST(Active, SpinsAreNotSlowed) {
    BodyKind screw = rodKind();
    screw.moments[2] = 0.1;
    screw.sites[1] += Vec3(0.05, 0, 0);
    for (bool alone : {false, true}) {
        const auto make = [&](double temperature, bool active) {
            auto scene = make_unique<ActiveScene>(rotnePrager, temperature, 0.05);
            scene->add(screw, Vec3());
            if (!alone) scene->add(sphereKind(0.6), Vec3(0, 0, 60));
            if (active) scene->setSlip(0);
            scene->start();
            return scene;
        };
        const auto with = make(T1, true), without = make(T1, false), cold = make(0, true);
        EXPECT_EQ(with->integrator.getEffects()["slowed spins"].substr(0, 3), "on:");
        const VectorXd expected = cold->expected().following * cold->activeSlips();
        EXPECT_GT(abs(expected[5]), 0.01);  // the spin about the axis
        expectNear(with->stepTwists() - without->stepTwists(), expected, alone ? 1e-10 : 1e-6);
    }
}

// ---- The flow of the fluid ----

/** On average over the surface of a blob the fluid has the velocity of the body and the slip. */
TEST(Active, TheFluidAtTheSurfaceHasTheVelocitiesOfTheSlip) {
    SKIP_ON_SINGLE_PRECISION_DEVICES("positions are rounded");
    struct Case {
        string name;
        ModelCase model;
        MobilityForce::Boundary boundary;
        bool alone, own;
        double tolerance;
        int rule = 24;  // fewer points where the flow at each of them is a lattice sum
    };
    const Case cases[] = {
        {"dense", rotnePrager, MobilityForce::Unbounded, false, false, 1e-7},
        {"matrix-free", matrixFree, MobilityForce::Unbounded, false, false, 1e-7},
        {"alone", rotnePrager, MobilityForce::Unbounded, true, false, 1e-7},
        {"alone with a tensor", rotnePrager, MobilityForce::Unbounded, true, true, 1e-7},
        {"own tensors", rotnePrager, MobilityForce::Unbounded, false, true, 1e-7},
        {"own tensors, matrix-free", matrixFree, MobilityForce::Unbounded, false, true, 1e-7},
        {"wall", rotnePrager, MobilityForce::NoSlipWall, false, false, 1e-7},
        {"periodic", rotnePrager, MobilityForce::Periodic, false, false, 1e-5, 16},
        {"force coupling", forceCoupling, MobilityForce::Periodic, false, false, 2e-3, 12},
        {"channel", forceCoupling, MobilityForce::SlipChannel, false, false, 2e-3, 12},
    };
    for (const Case& c : cases) {
        SCOPED_TRACE(c.name);
        ActiveScene scene(c.model, 0, 1e-3);
        scene.fluid->setBoundary(c.boundary);
        scene.fluid->setChannelWalls(-1, 6.5);
        scene.add(apartKind(), Vec3(1, 1, 2.5), {{0.8, 0.6, 0, 0}});
        if (!c.alone) scene.add(sphereKind(0.7), Vec3(3.6, 2.5, 1.1));
        scene.setSlip(0);
        if (c.own) scene.fluid->setBodyMobility(0, rowsOf(tensorWithoutSymmetry(1)));
        scene.start();
        const LabBody body = scene.labBodies()[0];
        const VectorXd slips = scene.activeSlips();
        const int blob = 1;
        const Envelope surface(c.model.model, body.R + body.offsets[blob], body.radii[blob],
                               c.rule);
        const Vector3d before = surface.average(scene);
        const VectorXd twists = scene.stepTwists();
        const Vector3d expected = twists.head<3>() +
                                  Vector3d(twists.segment<3>(3)).cross(body.offsets[blob]) -
                                  slips.segment<3>(3 * blob);
        expectNear(before, expected, c.tolerance);
        // The flow of the step is that at its start.
        expectNear(surface.average(scene), before, 1e-9);
    }
}

TEST(Active, MakesAFlowWithoutForcesAndSources) {
    SKIP_ON_SINGLE_PRECISION_DEVICES("positions are rounded");
    for (const ModelCase& model : {rotnePrager, matrixFree})
        for (double temperature : {0.0, T1}) {
            MatrixXd flows[2];
            vector<Vec3> points;
            const double d = 1e-4;
            const Vec3 near(1.5, 2.1, -0.4), far(300, 200, -400);
            for (int k = 0; k < 3; k++)
                for (int sign : {1, -1}) {
                    Vec3 x = near;
                    x[k] += sign * d;
                    points.push_back(x);
                }
            points.insert(points.end(), {far, far * 2, near});
            for (bool active : {false, true}) {
                ActiveScene scene(model, temperature, 1e-4);
                scene.add(boomerangKind(), Vec3());
                scene.add(apartKind(), Vec3(3, 1, 0), {{0.8, 0.6, 0, 0}});
                if (active) scene.setSlip(0);
                if (active) scene.setSlip(1);
                scene.start();
                scene.integrator.step(1);
                flows[active] = scene.flow(points);
            }
            const MatrixXd flow = flows[1] - flows[0];  // the same random numbers
            double divergence = 0;
            for (int k = 0; k < 3; k++)
                divergence += (flow(k, 2 * k) - flow(k, 2 * k + 1)) / (2 * d);
            EXPECT_LT(abs(divergence), 1e-6 * flow.col(8).norm());
            // Far away a stresslet is left, which falls off with the square of the distance, where
            // a force falls off with the distance.
            EXPECT_GT(flow.col(8).norm(), 1e-3);
            EXPECT_LT((4 * flow.col(7) - flow.col(6)).norm(), 0.02 * flow.col(6).norm());
        }
}

// ---- Forces on the fluid at sites of bodies ----

/**
 * In the independent multiblobs the site is an additional free particle, on which the force acts.
 */
TEST(Active, BodiesThatPushTheFluidMoveAsPairsOfForces) {
    for (auto boundary : {MobilityForce::Unbounded, MobilityForce::NoSlipWall})
        for (const ModelCase& model : {rotnePrager, matrixFree})
            for (bool withSlips : {false, true}) {
                ActiveScene scene(model);
                useWall(scene, boundary);
                scene.addMixture();
                if (withSlips) scene.setSlip(2);
                scene.push(0, Vec3(0.2, 1.1, 0.3), 0.3, Vec3(2, -1, 3));
                scene.push(2, Vec3(1.6, 1.8, 0), 0.5, Vec3(0, 3, -1));
                scene.push(3, Vec3(0, 0, -1.7), 0.25, Vec3(1, 0, 2));
                scene.start();
                VectorXd expected = scene.velocitiesByPushes();
                EXPECT_GT(expected.norm(), 0.1);
                if (withSlips) expected += scene.expected().following * scene.activeSlips();
                expectNear(scene.stepTwists(), expected, 1e-9);
            }
}

TEST(Active, ABodyAloneThatPushesGoesStraightInEveryScheme) {
    for (const SchemeTraits& traits : overdampedSchemes())
        for (bool isSphere : {false, true}) {
            ActiveScene scene(rotnePrager, 0, 0.5, traits.scheme);
            scene.add(isSphere ? sphereKind(0.7) : rodKind(), Vec3(1, 2, 3), {{0.6, 0, 0.8, 0}});
            scene.push(0, Vec3(0, 0, -2.5), 0.25, Vec3(0, 0, -2));
            scene.start();
            const VectorXd expected = scene.velocitiesByPushes();
            EXPECT_GT(expected.norm(), 0.01);
            expectNear(scene.stepTwists(), expected, 1e-12, traits.name);
            expectNear(scene.stepTwists(), expected, 1e-12, traits.name);
        }
}

TEST(Active, WhatHoldsABodyThatPushes) {
    for (const ModelCase& model : {rotnePrager, matrixFree}) {
        ActiveScene scene(model);
        scene.add(boomerangKind(), Vec3(0, 0, 0), {{0.6, 0, 0.8, 0}});
        scene.add(sphereKind(0.6), Vec3(-1, 3.5, 1));
        scene.push(0, Vec3(-0.5, -1, 0.3), 0.3, Vec3(2, -1, 3));
        scene.integrator.setBodyHeld(0, true);
        scene.start();
        vector<LabBody> all;
        const VectorXd wrenches = scene.wrenchesOfPushes(all);
        const MatrixXd N = scene.expected(all).mobility;
        VectorXd total = VectorXd::Zero(15);
        total.tail(3) = wrenches.tail(3);
        total.head(6) = -N.topLeftCorner(6, 6).ldlt().solve(N.topRightCorner(6, 3) * total.tail(3));
        const VectorXd hold = total.head(6) - wrenches.head(6);
        EXPECT_GT(hold.norm(), 0.1);
        const auto now = scene.integrator.computeHoldingWrenches();
        expectNear(scene.stepTwists(), (N * total).head(12), 1e-9);
        const auto last = scene.integrator.getHoldingWrenches();
        for (int k = 0; k < 6; k++) {
            EXPECT_NEAR(now[k], hold[k], 1e-8);
            EXPECT_NEAR(last[k], hold[k], 1e-8);
        }
    }
}

TEST(Active, TheFlowHasWhatForcesAtSitesDo) {
    SKIP_ON_SINGLE_PRECISION_DEVICES("positions are rounded");
    struct Case {
        string name;
        ModelCase model;
        MobilityForce::Boundary boundary;
        bool alone, own;
        double tolerance;
        int rule = 24;  // fewer points where the flow at each of them is a lattice sum
    };
    const Case cases[] = {
        {"dense", rotnePrager, MobilityForce::Unbounded, false, false, 1e-7},
        {"matrix-free", matrixFree, MobilityForce::Unbounded, false, false, 1e-7},
        {"alone", rotnePrager, MobilityForce::Unbounded, true, false, 1e-7},
        {"own tensors", rotnePrager, MobilityForce::Unbounded, false, true, 1e-7},
        {"wall", rotnePrager, MobilityForce::NoSlipWall, false, false, 1e-7},
        {"periodic", rotnePrager, MobilityForce::Periodic, false, false, 1e-5, 16},
        {"channel", forceCoupling, MobilityForce::SlipChannel, false, false, 2e-3, 12},
    };
    for (const Case& c : cases) {
        SCOPED_TRACE(c.name);
        ActiveScene scene(c.model, 0, 1e-3);
        scene.fluid->setBoundary(c.boundary);
        scene.fluid->setChannelWalls(-1, 6.5);
        scene.add(apartKind(), Vec3(1, 1, 2.5), {{0.8, 0.6, 0, 0}});
        if (!c.alone) scene.add(sphereKind(0.7), Vec3(3.6, 2.5, 1.1));
        scene.push(0, Vec3(-0.6, 1.6, 1.3), 0.3, Vec3(2, -1, 3));
        if (c.own) scene.fluid->setBodyMobility(0, rowsOf(tensorWithoutSymmetry(1)));
        scene.start();
        const LabBody body = scene.labBodies()[0];
        const int blob = 1;
        const Envelope surface(c.model.model, body.R + body.offsets[blob], body.radii[blob],
                               c.rule);
        const Vector3d before = surface.average(scene);
        const Vec3 far(300, 200, -400);
        MatrixXd flow;
        if (c.boundary == MobilityForce::Unbounded) flow = scene.flow({far, far * 2});
        const VectorXd twists = scene.stepTwists();
        expectNear(surface.average(scene), before, 1e-9);
        // Own tensors move the body as its blobs are not moved.
        if (!c.own) {
            const Vector3d W = twists.segment<3>(3);
            expectNear(before, twists.head<3>() + W.cross(body.offsets[blob]), c.tolerance);
        }
        // Far away a stresslet is left, which falls off with the square of the distance. (A body
        // with a tensor of its own makes the flow of a scaled force, so that a part is left.)
        if (flow.size() == 0 || c.own) continue;
        EXPECT_LT((4 * flow.col(1) - flow.col(0)).norm(), 0.02 * flow.col(0).norm());
    }
}

TEST(Active, ModesHaveWhatForcesAtSitesDo) {
    SKIP_ON_SINGLE_PRECISION_DEVICES("positions are rounded");
    ActiveScene scene;
    scene.fluid->setBoundary(MobilityForce::Periodic);
    scene.add(sphereKind(0.7), Vec3(1, 2, 3));
    scene.push(0, Vec3(0, 1.3, 0), 0.4, Vec3(2, 0, 0));
    scene.start();
    // The forces are 2 at the site and -2 at the sphere, whose velocity they do not change much;
    // its torque makes a rotlet of the sphere.
    const double k = 2 * M_PI / 8, unit = 2 / (0.6 * k * k * 512), F = 2;
    const auto s = [&](double a) { return sin(k * a) / (k * a); };
    const auto t = [&](double a) { return 3 * (sin(k * a) - k * a * cos(k * a)) / pow(k * a, 3); };
    const double site = 3.3, torque = 1.3 * F;  // -(x_p - R) x f = (0, 0, 1.3 F)
    const double sine = F * s(0.4) * sin(k * site) - F * s(0.7) * sin(k * 2) -
                        torque * t(0.7) * 0.5 * k * cos(k * 2),
                 cosine = F * s(0.4) * cos(k * site) - F * s(0.7) * cos(k * 2) +
                          torque * t(0.7) * 0.5 * k * sin(k * 2);
    expectNear(scene.mode(0, 1, 1), unit * Eigen::Vector2d(sine, cosine), 1e-9);
}

// ---- In a Context ----

TEST(Active, SlipsMayChange) {
    ActiveScene scene;
    addActiveMixture(scene);
    scene.start();
    EXPECT_EQ(scene.fluid->getBodiesWithSlip(), vector<int>({2, 3}));
    EXPECT_EQ(scene.integrator.getEffects()["active slip"],
              "on: 2 bodies whose surface moves the fluid");
    scene.setSlip(2, -2);
    scene.fluid->clearBodySlip(3);
    scene.slipOfBody.erase(3);
    EXPECT_EQ(scene.integrator.getEffects()["active slip"].substr(0, 12), "on: 2 bodies");
    scene.fluid->updateParametersInContext(*scene.context);
    EXPECT_EQ(scene.integrator.getEffects()["active slip"],
              "on: 1 body whose surface moves the fluid");
    const VectorXd expected = scene.expected().following * scene.activeSlips();
    expectNear(scene.stepTwists(), expected, 1e-10);
    scene.fluid->clearBodySlip(2);
    scene.fluid->updateParametersInContext(*scene.context);
    EXPECT_EQ(scene.integrator.getEffects()["active slip"], "off: no body has a slip");
    EXPECT_LT(scene.stepTwists().norm(), 1e-14);
}

TEST(Active, ForcesOnTheFluidMayChange) {
    ActiveScene scene;
    scene.addMixture();
    scene.push(2, Vec3(1.6, 1.8, 0), 0.5, Vec3(0, 3, -1));
    scene.start();
    EXPECT_EQ(scene.integrator.getEffects()["forces on the fluid"],
              "on: 1 force at a site that moves with its body, which takes the opposite force");
    scene.pushes[0] = {0, Vector3d(1, 1, 0), Vector3d(2, 0, 1), 0.3};
    scene.fluid->setBodyForceOnFluidParameters(0, 0, Vec3(1, 1, 0), 0.3, Vec3(2, 0, 1));
    scene.fluid->updateParametersInContext(*scene.context);
    const VectorXd expected = scene.velocitiesByPushes();
    expectNear(scene.stepTwists(), expected, 1e-10);
    scene.fluid->setBodyForceOnFluidParameters(0, 0, Vec3(1, 1, 0), 0.3, Vec3());
    scene.fluid->updateParametersInContext(*scene.context);
    EXPECT_LT(scene.stepTwists().norm(), 1e-14);
    ActiveScene none;
    none.addMixture();
    none.start();
    EXPECT_EQ(none.integrator.getEffects()["forces on the fluid"],
              "off: no body exerts a force on the fluid at a site of its own");
}

TEST(Active, ResumesBitForBit) {
    for (auto scheme : {RigidHI::TrapezoidalSlip, RigidHI::DriftCorrectorRFD})
        expectToResumeBitForBit<ActiveScene>(
            [&](int threads) {
                auto scene = make_unique<ActiveScene>(rotnePrager, T1, 1e-3, scheme);
                useWall(*scene, MobilityForce::NoSlipWall);
                addActiveMixture(*scene);
                scene->push(0, Vec3(0.2, 1.1, 0.3), 0.3, Vec3(2, -1, 3));
                scene->FluidScene::start(testPlatform(), threads);
                return scene;
            },
            [](ActiveScene& scene) { scene.integrator.step(3); }, 4);
}

TEST(Active, SlipsThatAreRefused) {
    const auto refused = [](const function<void(ActiveScene&)>& change,
                            const vector<string>& fragments) {
        ActiveScene scene(rotnePrager, 0, 1e-3, RigidHI::TrapezoidalSlip);
        scene.add(sphereKind(0.7), Vec3(4, 0, 0));
        scene.add(apartKind(), Vec3());
        change(scene);
        expectError([&] { scene.start(); }, fragments);
    };
    refused([](ActiveScene& s) { s.fluid->setBodySlip(2, {Vec3()}); },
            {"MobilityForce: body 2 was given a slip, but the integrator has 2 bodies, counted "
             "from 0",
             "clearBodySlip() removes it"});
    refused([](ActiveScene& s) { s.fluid->setBodySlip(0, {Vec3(1, 0, 0)}); },
            {"MobilityForce: body 0 was given a slip, but has 1 hydrodynamic particles",
             "no stresslet sources for the surface of a single sphere",
             "make the body of at least 2 blobs"});
    refused([](ActiveScene& s) { s.fluid->setBodySlip(1, vector<Vec3>(5)); },
            {"MobilityForce: body 1 was given a slip, of 5 velocities, but has 4 hydrodynamic "
             "particles",
             "give setBodySlip() one velocity for each"});
    refused(
        [](ActiveScene& s) {
            s.setSlip(1);
            s.integrator.setScheme(RigidHI::LangevinHI);
        },
        {"body 1 has a slip (setBodySlip()), which scheme LangevinHI would ignore",
         "use a scheme without momenta in a fluid", "clearBodySlip()"});

    MobilityForce fluid;
    expectError(
        [&] { fluid.setBodySlip(-1, {}); },
        {"MobilityForce: setBodySlip(): the index of the body is -1; it must be 0 or above"});
    expectError(
        [&] {
            fluid.setBodySlip(3, {Vec3(), Vec3(0, NAN, 0)});
        },
        {"MobilityForce: body 3: velocity 1 of its slip is", "nan",
         "all velocities must be finite"});
    expectError([&] { fluid.getBodySlip(3); },
                {"MobilityForce: getBodySlip(): body 3 has no slip", "call setBodySlip() first"});
    fluid.setBodySlip(3, {Vec3(1, 2, 3)});
    EXPECT_EQ(fluid.getBodySlip(3), vector<Vec3>({Vec3(1, 2, 3)}));
}

TEST(Active, ForcesOnTheFluidThatAreRefused) {
    const auto refused = [](const function<void(ActiveScene&)>& change,
                            const vector<string>& fragments) {
        ActiveScene scene(rotnePrager, 0, 1e-3, RigidHI::TrapezoidalSlip);
        scene.add(sphereKind(0.7), Vec3(4, 0, 1.5));
        change(scene);
        expectError([&] { scene.start(); }, fragments);
    };
    const Vec3 x(1, 0, 0);
    refused([&](ActiveScene& s) { s.fluid->addBodyForceOnFluid(1, x, 0.3, x); },
            {"MobilityForce: force 0 on the fluid (addBodyForceOnFluid()) is meant for body 1, but "
             "the integrator has 1 bodies, counted from 0"});
    refused(
        [&](ActiveScene& s) {
            s.fluid->setModel(MobilityForce::FreeDraining);
            s.fluid->setParticleRadius(0, 0);
            s.fluid->setBodyMobility(0, rowsOf(tensorWithoutSymmetry(1)));
            s.fluid->addBodyForceOnFluid(0, x, 0.3, x);
        },
        {"force 0 on the fluid (addBodyForceOnFluid()) is that of body 0, none of whose particles "
         "the "
         "fluid sees; give one of them a radius above 0"});
    refused(
        [&](ActiveScene& s) {
            s.fluid->setModel(MobilityForce::StokesianDynamics);
            s.fluid->addBodyForceOnFluid(0, x, 0.3, x);
        },
        {"force 0 on the fluid (addBodyForceOnFluid()) is at a site without a surface, which "
         "model StokesianDynamics has no lubrication for; use setModel(RotnePragerYamakawa)"});
    refused(
        [&](ActiveScene& s) {
            s.integrator.setScheme(RigidHI::LangevinHI);
            s.fluid->addBodyForceOnFluid(0, x, 0.3, x);
        },
        {"a body exerts a force on the fluid (addBodyForceOnFluid()), which scheme LangevinHI "
         "would ignore",
         "use a scheme without momenta in a fluid"});
    refused(
        [&](ActiveScene& s) {
            s.add(rodKind(), Vec3());
            s.fluid->addBodyForceOnFluid(1, Vec3(1, 0, 0), 0.3, Vec3(0, 2, 0));
        },
        {"body 1 takes a torque of", "about the line of its hydrodynamic particles",
         "move the sites of these forces to the line"});
    {
        ActiveScene scene(rotnePrager, 0, 1e-3, RigidHI::TrapezoidalSlip);
        scene.add(sphereKind(0.7), Vec3(4, 0, 1.5));
        scene.fluid->setBoundary(MobilityForce::NoSlipWall);
        scene.fluid->addBodyForceOnFluid(0, Vec3(0, 0, -1.3), 0.3, x);
        expectError(
            [&] {
                scene.start();
                scene.integrator.step(1);
            },
            {"at the site of a force on the fluid (addBodyForceOnFluid()): NoSlipWall:"});
    }
    MobilityForce fluid;
    fluid.addBodyForceOnFluid(0, Vec3(), 1, Vec3());
    for (int bad : {-1, 1}) {
        int body;
        double radius;
        Vec3 site, force;
        expectError([&] { fluid.getBodyForceOnFluidParameters(bad, body, site, radius, force); },
                    {"getBodyForceOnFluidParameters()",
                     "force index " + to_string(bad) +
                         " is out of range; the Force has 1 forces on the fluid, counted from 0",
                     "add the force by addBodyForceOnFluid() first"});
        expectError([&] { fluid.setBodyForceOnFluidParameters(bad, 0, Vec3(), 1, Vec3()); },
                    {"setBodyForceOnFluidParameters()", "force index " + to_string(bad)});
    }
    expectError([&] { fluid.addBodyForceOnFluid(-1, Vec3(), 1, Vec3()); },
                {"force 1 on the fluid: the index of its body is -1; it must be 0 or above"});
    expectError([&] { fluid.addBodyForceOnFluid(0, Vec3(0, INFINITY, 0), 1, Vec3()); },
                {"force 1 on the fluid: its site is", "it must be finite",
                 "give a place in the body frame"});
    for (double bad : {0.0, -1.0, double(NAN)})
        expectError([&] { fluid.addBodyForceOnFluid(0, Vec3(), bad, Vec3()); },
                    {"force 1 on the fluid: the radius of its particle is",
                     "it must be finite and positive", "give the size of what exerts the force"});
    expectError([&] { fluid.addBodyForceOnFluid(0, Vec3(), 1, Vec3(NAN, 0, 0)); },
                {"force 1 on the fluid: it is", "give a finite force, or 0 for none"});
    EXPECT_EQ(fluid.getNumBodyForcesOnFluid(), 1);
}

TEST(Active, WhatIsRefusedLaterChangesNothing) {
    ActiveScene scene(rotnePrager, 0, 1e-3, RigidHI::TrapezoidalSlip);
    scene.add(apartKind(), Vec3());
    scene.setSlip(0);
    scene.start();
    scene.fluid->setBodySlip(0, {Vec3()});
    expectError([&] { scene.fluid->updateParametersInContext(*scene.context); },
                {"body 0 was given a slip, of 1 velocities, but has 4"});
    const VectorXd expected = scene.expected().following * scene.activeSlips();
    expectNear(scene.stepTwists(), expected, 1e-4);
    scene.integrator.setScheme(RigidHI::LangevinHI);
    expectError([&] { scene.integrator.step(1); },
                {"body 0 has a slip (setBodySlip()), which scheme LangevinHI would ignore"});
    scene.fluid->clearBodySlip(0);
    scene.fluid->updateParametersInContext(*scene.context);
    scene.integrator.step(1);
    scene.fluid->setBodySlip(0, vector<Vec3>(4, Vec3(1, 0, 0)));
    expectError([&] { scene.fluid->updateParametersInContext(*scene.context); },
                {"body 0 has a slip (setBodySlip()), which scheme LangevinHI would ignore"});
}
