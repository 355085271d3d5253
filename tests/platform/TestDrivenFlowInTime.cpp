// Bodies in flows that users drive, in time: Jeffery's orbits, orders, momenta and exact averages,
// invariance and exact resume.

#include "FlowSupport.h"

using namespace OpenMM;
using namespace RigidHITest;
using namespace std;

// ---- Without noise ----

namespace {

/** A blob at each corner of a square prism. By its symmetry the prism rotates like a body of
 * revolution (Bretherton 1962). */
BodyKind prismKind(double halfHeight) {
    BodyKind kind = {"prism", 1, Vec3(1, 1, 1), {}, {}};
    for (double x : {-0.6, 0.6})
        for (double y : {-0.6, 0.6})
            for (double z : {-halfHeight, halfHeight}) kind.sites.push_back(Vec3(x, y, z));
    kind.radii.assign(8, 0.5);
    return kind;
}

/** Where the axis n of a prism is after this time in shear, in so many steps. */
Vector3d axisAfter(RigidHI::Scheme scheme, double halfHeight, const QuaternionArray& q, double rate,
                   double time, int steps) {
    FlowScene scene(0, time / steps, scheme);
    shear(rate).set(*scene.fluid);
    scene.add(prismKind(halfHeight), Vec3(), q);
    scene.start();
    scene.integrator.step(steps);
    EXPECT_LT(norm(scene.integrator.getBodyPositions()[0]), readTolerance(1e-9, 1));
    return rotationOf(scene.integrator.getBodyOrientations()[0]) * Vector3d::UnitZ();
}

/**
 * The constant of Jeffery's orbits, by the rotation of a prism that lies along the flow: B =
 * (ratio^2 - 1)/(ratio^2 + 1) of an equivalent spheroid.
 */
double brethertonConstant(double halfHeight) {
    FlowScene scene;
    scene.add(prismKind(halfHeight), Vec3(), {{sqrt(0.5), 0, sqrt(0.5), 0}});  // z to x
    scene.start();
    const VectorXd twist = scene.expected().following * scene.slips(shear(1));
    return 1 + 2 * twist[5];
}

}  // namespace

TEST(DrivenFlowInTime, JefferysOrbits) {
    const double rate = 0.7;
    const QuaternionArray q = {{0.8, 0.36, 0.48, 0}};
    for (double halfHeight : {1.4, 0.3}) {
        const double B = brethertonConstant(halfHeight);
        EXPECT_GT(abs(B), 0.2);
        const double period = 4 * M_PI / (rate * sqrt(1 - B * B));
        const Vector3d n = rotationOf(q) * Vector3d::UnitZ();
        for (auto scheme : {RigidHI::FixmanMidpoint, RigidHI::TrapezoidalSlip}) {
            double errors[2];
            for (int i : {0, 1})
                errors[i] = (axisAfter(scheme, halfHeight, q, rate, period, 100 << i) - n).norm();
            EXPECT_LT(errors[1], 0.01);
            EXPECT_NEAR(errors[0] / errors[1], 4, 0.6) << traitsOf(scheme).name;
        }
        // Half an orbit turns the axis by half a turn about the vorticity. The component of the
        // axis along the vorticity is then the same as before.
        const Vector3d half =
            axisAfter(RigidHI::FixmanMidpoint, halfHeight, q, rate, period / 2, 400);
        EXPECT_NEAR(half[2], n[2], 1e-3);
        EXPECT_NEAR(half[0], -n[0], 1e-3);
        EXPECT_NEAR(half[1], -n[1], 1e-3);
    }
    // A prism with the symmetry of a cube turns at a constant rate, like a sphere.
    EXPECT_NEAR(brethertonConstant(0.6), 0, 1e-12);
    for (auto scheme : {RigidHI::EulerMaruyama, RigidHI::FixmanMidpoint}) {
        const Vector3d n = axisAfter(scheme, 0.6, q, rate, 2, 7);
        const Vector3d expected =
            Eigen::AngleAxisd(-rate, Vector3d::UnitZ()) * (rotationOf(q) * Vector3d::UnitZ());
        EXPECT_LT((n - expected).norm(), 1e-12);
    }
}

TEST(DrivenFlowInTime, OrderWithoutNoise) {
    // The bodies are multiblobs that feel each other, in a strain with rotation.
    const auto end = [](RigidHI::Scheme scheme, int steps) {
        FlowScene scene(0, 1.0 / steps, scheme);
        generalFlow().set(*scene.fluid);
        scene.add(rodKind(), Vec3(1, 0.5, -0.4), {{0.6, 0, 0.8, 0}});
        scene.add(boomerangKind(), Vec3(-1, -0.8, 0.6));
        scene.addField("0.3*x^2");
        scene.start();
        scene.integrator.step(steps);
        const auto x = positionsOf(*scene.context);
        VectorXd all(3 * x.size());
        for (size_t i = 0; i < x.size(); i++) all.segment<3>(3 * i) = toEigen(x[i]);
        return all;
    };
    SKIP_ON_SINGLE_PRECISION_DEVICES("errors are below what positions in single precision tell");
    const VectorXd exact = end(RigidHI::FixmanMidpoint, 1024);
    for (const SchemeTraits& traits : overdampedSchemes()) {
        const double coarse = (end(traits.scheme, 16) - exact).norm(),
                     fine = (end(traits.scheme, 32) - exact).norm();
        const double order = log2(coarse / fine);
        EXPECT_NEAR(order, traits.coldOrder, 0.15) << traits.name;
    }
}

// ---- With momenta ----

TEST(DrivenFlowInTime, MomentaGoToThoseOfTheFlow) {
    // The mass is so small that a step is long compared with relaxation and yet moves nothing.
    // Velocities are then those of bodies without forces.
    const LinearFlow flow = generalFlow();
    const double h = 1e-9, light = 1e-14;
    for (auto solver : {MobilityForce::Dense, MobilityForce::MatrixFree})
        for (bool own : {false, true}) {
            FlowScene scene(0, h, RigidHI::LangevinHI);
            scene.fluid->setSolver(solver);
            scene.fluid->setSolverTolerance(1e-9);
            flow.set(*scene.fluid);
            scene.addMixture();
            for (size_t b = 0; b < scene.bodies.size(); b++) {
                Vec3 moments = scene.bodies[b].moments;
                scene.integrator.setRigidBodyParameters(b, scene.particles[b], light,
                                                        moments * light, scene.bodies[b].sites);
            }
            scene.system.setParticleMass(scene.freeParticles[0], light);
            if (own) scene.fluid->setBodyMobility(2, rowsOf(tensorWithoutSymmetry(1)));
            scene.start();
            const VectorXd expected = scene.expected().following * scene.slips(flow);
            scene.integrator.step(1);
            expectNear(scene.twists(), expected, 1e-7);
        }
}

TEST(DrivenFlowInTime, MomentaGoWhereStepsWithoutThemDo) {
    // Velocities relax to the flow for all models and boundaries, and for bodies that have no
    // moments about some axes.
    struct Case {
        MobilityForce::Model model;
        MobilityForce::Boundary boundary;
        MobilityForce::Solver solver;
        MobilityForce::SphereWallMobility sphereWall;
    };
    const auto FreeDraining = MobilityForce::FreeDraining, RPY = MobilityForce::RotnePragerYamakawa,
               SD = MobilityForce::StokesianDynamics, FCM = MobilityForce::ForceCoupling;
    const auto Dense = MobilityForce::Dense, MatrixFree = MobilityForce::MatrixFree;
    const auto FromModel = MobilityForce::FromModel;
    const Case cases[] = {{FreeDraining, MobilityForce::Unbounded, Dense, FromModel},
                          {SD, MobilityForce::Unbounded, Dense, FromModel},
                          {RPY, MobilityForce::NoSlipWall, Dense, FromModel},
                          {RPY, MobilityForce::NoSlipWall, MatrixFree, FromModel},
                          {RPY, MobilityForce::NoSlipWall, Dense, MobilityForce::BestKnown},
                          {RPY, MobilityForce::Periodic, Dense, FromModel},
                          {SD, MobilityForce::Periodic, Dense, FromModel},
                          {FCM, MobilityForce::Periodic, Dense, FromModel},
                          {FCM, MobilityForce::Periodic, MatrixFree, FromModel},
                          {FCM, MobilityForce::SlipChannel, Dense, FromModel},
                          {FCM, MobilityForce::SlipChannel, MatrixFree, FromModel}};
    const double light = 1e-14;
    for (const Case& c : cases) {
        SCOPED_TRACE(testing::Message() << "model " << c.model << ", boundary " << c.boundary
                                        << ", solver " << c.solver);
        const auto twists = [&](bool momenta) {
            FlowScene scene(0, momenta ? 1e-9 : 1,
                            momenta ? RigidHI::LangevinHI : RigidHI::EulerMaruyama);
            scene.fluid->setModel(c.model);
            scene.fluid->setBoundary(c.boundary);
            scene.fluid->setSolver(c.solver);
            scene.fluid->setSolverTolerance(c.model == FCM ? 1e-6 : 1e-9);
            scene.fluid->setSphereWallMobility(c.sphereWall);
            scene.fluid->setChannelWalls(0, 6.5);
            scene.side = 9;
            const bool periodic =
                c.boundary == MobilityForce::Periodic || c.boundary == MobilityForce::SlipChannel;
            LinearFlow flow = generalFlow();
            if (c.boundary == MobilityForce::NoSlipWall) {
                flow = LinearFlow();
                flow.gradient(0, 2) = 0.2;
            }
            if (periodic)
                scene.fluid->setSinusoidalForceDensity(0.1, 0, 2, 1);
            else
                flow.set(*scene.fluid);
            scene.add(sphereKind(0.7, light, light), Vec3(3, 1, 2));
            BodyKind eccentric = sphereKind(0.6, light, light);
            eccentric.sites[0] = Vec3(0.1, 0.3, -0.2);
            scene.add(eccentric, Vec3(4.5, 2, 1.5), {{0.6, 0, 0.8, 0}});
            // Iterations need moments about all axes.
            scene.add(sphereKind(0.5, light, c.solver == MatrixFree ? light : 0),
                      Vec3(3, 3.5, 2.7));
            if (c.model != SD) {
                BodyKind kind = boomerangKind();
                kind.mass = light;
                kind.moments *= light;
                scene.add(kind, Vec3(6, 3, 5), {{0.8, 0.6, 0, 0}});
                scene.addFree(light, 0.5, Vec3(2, 5, 4));
            }
            scene.start();
            if (!momenta) return scene.stepTwists();
            scene.integrator.step(1);
            return scene.twists();
        };
        VectorXd expected = twists(false);
        if (c.solver == Dense)
            expected.segment<3>(15).setZero();  // without moments a sphere does not turn
        EXPECT_GT(expected.norm(), 0.1);
        expectNear(twists(true), expected, c.model == FCM && c.solver == MatrixFree ? 1e-5 : 1e-7);
    }
}

TEST(DrivenFlowInTime, MomentaRelaxExponentially) {
    const LinearFlow flow = generalFlow();
    const double h = 0.05, a = 0.7, eta = 0.6, mass = 2, moment = 0.9, freeMass = 0.7,
                 freeRadius = 0.4;
    const double decay = exp(-6 * M_PI * eta * a * h / mass),
                 decayOfTurns = exp(-8 * M_PI * eta * a * a * a * h / moment),
                 freeDecay = exp(-6 * M_PI * eta * freeRadius * h / freeMass);
    for (auto model : {MobilityForce::FreeDraining, MobilityForce::RotnePragerYamakawa,
                       MobilityForce::StokesianDynamics}) {
        FlowScene scene(0, h, RigidHI::LangevinHI);
        scene.fluid->setModel(model);
        flow.set(*scene.fluid);
        const Vec3 x(1, 2, 3), V(0.5, -1, 2), omega(1, 2, -0.5), free(-40000, 1, 2), v(1, 2, 3);
        scene.add(sphereKind(a, mass, moment), x, {{0.6, 0, 0.8, 0}});
        const bool hasFree = model == MobilityForce::FreeDraining;
        if (hasFree) scene.addFree(freeMass, freeRadius, Vec3(-4, 1, 2));
        scene.start();
        if (hasFree) scene.context->setVelocities({Vec3(), v});
        scene.integrator.setBodyVelocities({V});
        scene.integrator.setBodyAngularVelocities({omega});
        scene.integrator.step(1);
        VectorXd expected(hasFree ? 9 : 6);
        const Vector3d there = flow.at(toEigen(x + V * (h / 2)));
        expected.head<6>() << there + decay * (toEigen(V) - there),
            flow.halfCurl() + decayOfTurns * (toEigen(omega) - flow.halfCurl());
        if (hasFree) {
            const Vector3d around = flow.at(toEigen(Vec3(-4, 1, 2) + v * (h / 2)));
            expected.tail<3>() = around + freeDecay * (toEigen(v) - around);
        }
        expectNear(scene.twists(), expected, 1e-12);
    }
}

TEST(DrivenFlowInTime, OrderOfMomenta) {
    // The equations are linear: x' = V, V' = -(xi/m)(V - v(x)), with a start at rest. Over so short
    // times the Taylor series is exact to rounding.
    SKIP_ON_SINGLE_PRECISION_DEVICES("errors are below what positions in single precision tell");
    const LinearFlow flow = generalFlow();
    const double a = 0.5, eta = 0.6, mass = 10, rate = 6 * M_PI * eta * a / mass, time = 2;
    const Vector3d start(3, -1, 2);
    MatrixXd A = MatrixXd::Zero(7, 7);
    A.block<3, 3>(0, 3).setIdentity();
    A.block<3, 3>(3, 0) = rate * flow.gradient;
    A.block<3, 3>(3, 3) = -rate * Matrix3d::Identity();
    A.block<3, 1>(3, 6) = rate * flow.velocity;
    VectorXd exact(7), term(7);
    exact << start, 0, 0, 0, 1;
    term = exact;
    for (int n = 1; n < 60; n++) {
        term = (time / n * A * term).eval();
        exact += term;
    }
    double errors[2];
    for (int i : {0, 1}) {
        const int steps = 20 << i;
        FlowScene scene(0, time / steps, RigidHI::LangevinHI);
        flow.set(*scene.fluid);
        scene.add(sphereKind(a, mass), toVec3(start));
        scene.start();
        scene.integrator.step(steps);
        errors[i] = (toEigen(scene.integrator.getBodyPositions()[0]) - exact.head<3>()).norm() +
                    (toEigen(scene.integrator.getBodyVelocities()[0]) - exact.segment<3>(3)).norm();
    }
    EXPECT_LT(errors[1], 1e-2);
    EXPECT_NEAR(log2(errors[0] / errors[1]), 2, 0.1);
}

TEST(DrivenFlowInTime, VelocitiesInShearAreThermalAboutTheFlow) {
    // Independent spheres in wells k y^2/2 and shear: m dV = -xi (V - c y e_x) dt + ... has <y^2> =
    // kT/k, <V_y^2> = kT/m, <V_x y> = c <y^2>/(1 + k m/(2 xi^2)), from the equations of the second
    // moments. <V_x> = 0, <V_z^2> = kT/m.
    const double a = 0.5, eta = 0.6, mass = 1.5, k = 2, c = 1.2, xi = 6 * M_PI * eta * a, h = 0.02;
    FlowScene scene(T1, h, RigidHI::LangevinHI);
    scene.fluid->setModel(MobilityForce::FreeDraining);
    shear(c).set(*scene.fluid);
    const int copies = 400;
    for (int i = 0; i < copies; i++) scene.add(sphereKind(a, mass, 0.4));
    scene.addField("y^2");
    scene.start();
    // The relaxation times are m/xi = 0.27 and xi/k = 2.8.
    scene.integrator.step(1000);
    vector<double> samples[4];
    for (int sample = 0; sample < 60; sample++) {
        scene.integrator.step(50);
        const auto x = scene.integrator.getBodyPositions(),
                   V = scene.integrator.getBodyVelocities();
        double sums[4] = {};
        for (int i = 0; i < copies; i++) {
            const double y = x[i][1];
            const double now[4] = {V[i][0] * y, V[i][1] * V[i][1], V[i][2] * V[i][2], y * y};
            for (int q = 0; q < 4; q++) sums[q] += now[q] / copies;
        }
        for (int q = 0; q < 4; q++) samples[q].push_back(sums[q]);
    }
    // Samples 1 ps apart are correlated. So errors are from blocks of six samples, twice xi/k.
    const auto blocks = [](const vector<double>& all) {
        vector<double> means;
        for (size_t i = 0; i + 6 <= all.size(); i += 6) {
            double sum = 0;
            for (size_t j = i; j < i + 6; j++) sum += all[j] / 6;
            means.push_back(sum);
        }
        return estimate(means);
    };
    expectMean("<V_x y>", blocks(samples[0]), c / k / (1 + k * mass / (2 * xi * xi)));
    expectMean("<V_y^2>", blocks(samples[1]), 1 / mass);
    expectMean("<V_z^2>", blocks(samples[2]), 1 / mass);
    expectMean("<y^2>", blocks(samples[3]), 1 / k);
}

TEST(DrivenFlowInTime, EquipartitionIsAboutAUniformFlow) {
    // The process is exact: after n steps from rest mean and variance are known. Angular velocities
    // are independent of the flow.
    const double a = 0.5, eta = 0.6, mass = 1.5, h = 0.05;
    const int copies = 3000, steps = 8;
    const Vector3d velocity(1.5, -2, 0.7);
    const double decay = exp(-6 * M_PI * eta * a * h / mass * steps);
    for (bool free : {false, true}) {
        FlowScene scene(T1, h, RigidHI::LangevinHI);
        scene.fluid->setModel(MobilityForce::FreeDraining);
        uniform(velocity).set(*scene.fluid);
        for (int i = 0; i < copies; i++)
            if (free)
                scene.addFree(mass, a, Vec3());
            else
                scene.add(sphereKind(a, mass, 0.4));
        scene.start();
        scene.integrator.step(steps);
        const vector<Vec3> V =
            free ? velocitiesOf(*scene.context) : scene.integrator.getBodyVelocities();
        for (int axis = 0; axis < 3; axis++) {
            vector<double> values, squares;
            const double mean = (1 - decay) * velocity[axis];
            for (const Vec3& v : V) {
                values.push_back(v[axis]);
                squares.push_back(pow(v[axis] - mean, 2));
            }
            const string what = (free ? "free particle, axis " : "sphere, axis ") + to_string(axis);
            expectMean(what + ", mean", estimate(values), mean);
            expectMean(what + ", variance", estimate(squares), (1 - decay * decay) / mass);
        }
    }
}

// ---- Noise and invariance ----

TEST(DrivenFlowInTime, ATrapHoldsWhatAFlowPushes) {
    // Euler-Maruyama in a well k x^2/2 is x' = (1 - k mu h) x + v h + noise. Its exact mean is v/(k
    // mu), and its exact variance is kT/k/(1 - k mu h/2).
    const double a = 0.5, eta = 0.6, k = 3, h = 0.1, mu = 1 / (6 * M_PI * eta * a);
    const Vector3d velocity(0.5, -0.3, 0);
    FlowScene scene(T1, h);
    scene.fluid->setModel(MobilityForce::FreeDraining);
    uniform(velocity).set(*scene.fluid);
    const int copies = 4000;
    for (int i = 0; i < copies; i++) scene.add(sphereKind(a), toVec3(velocity / (k * mu)));
    scene.addField("1.5*(x^2 + y^2 + z^2)");
    scene.start();
    // Five relaxation times from the exact mean: the variance lacks exp(-10) of itself, where its
    // statistical error is sqrt(2/4000).
    const int steps = 5 / (k * mu * h);
    scene.integrator.step(steps);
    for (int axis = 0; axis < 3; axis++) {
        vector<double> values, squares;
        const double mean = velocity[axis] / (k * mu);
        for (const Vec3& x : scene.integrator.getBodyPositions()) {
            values.push_back(x[axis]);
            squares.push_back(pow(x[axis] - mean, 2));
        }
        expectMean("mean along " + to_string(axis), estimate(values), mean);
        expectMean("variance along " + to_string(axis), estimate(squares),
                   1 / (k * (1 - k * mu * h / 2)));
    }
}

TEST(DrivenFlowInTime, AUniformFlowOnlyShifts) {
    SKIP_ON_SINGLE_PRECISION_DEVICES("positions that are shifted are rounded in another way");
    const Vector3d velocity(0.7, -0.4, 0.2);
    const int steps = 5;
    const double h = 0.02;
    for (const SchemeTraits& traits : overdampedSchemes())
        for (auto solver : {MobilityForce::Dense, MobilityForce::MatrixFree}) {
            SCOPED_TRACE(traits.name);
            FlowScene still(T1, h, traits.scheme), moving(T1, h, traits.scheme);
            uniform(velocity).set(*moving.fluid);
            for (FlowScene* scene : {&still, &moving}) {
                scene->fluid->setSolver(solver);
                scene->fluid->setSolverTolerance(1e-9);
                scene->addMixture();
                scene->start();
                scene->integrator.step(steps);
            }
            const auto x = positionsOf(*still.context), y = positionsOf(*moving.context);
            double largest = 0;
            for (size_t i = 0; i < x.size(); i++)
                largest = max(largest, norm(y[i] - x[i] - toVec3(steps * h * velocity)));
            // Finite differences over 1e-5 of the lengths magnify rounding. With iterations, they
            // magnify the errors of the iterations.
            EXPECT_LT(largest, solver == MobilityForce::Dense ? 1e-8 : 1e-4);
            EXPECT_GT(norm(x[0] - still.positions[0]), 0.1);
        }
    // The same holds with momenta if the velocities begin in the moving frame, also where a sphere
    // would be a plain thermostat without the flow.
    for (auto model : {MobilityForce::FreeDraining, MobilityForce::RotnePragerYamakawa}) {
        FlowScene still(T1, h, RigidHI::LangevinHI), moving(T1, h, RigidHI::LangevinHI);
        uniform(velocity).set(*moving.fluid);
        for (FlowScene* scene : {&still, &moving}) {
            scene->fluid->setModel(model);
            scene->addMixture();
            scene->start();
        }
        vector<Vec3> v = velocitiesOf(*moving.context);
        v[moving.freeParticles[0]] = toVec3(velocity);
        moving.context->setVelocities(v);
        moving.integrator.setBodyVelocities(vector<Vec3>(moving.bodies.size(), toVec3(velocity)));
        for (FlowScene* scene : {&still, &moving}) scene->integrator.step(steps);
        VectorXd shift = VectorXd::Zero(still.twists().size());
        for (size_t b = 0; b < still.bodies.size(); b++) shift.segment<3>(6 * b) = velocity;
        shift.tail<3>() = velocity;
        EXPECT_GT(still.twists().norm(), 1);
        expectNear(moving.twists() - still.twists(), shift, 1e-11);
    }
}

TEST(DrivenFlowInTime, NoFlowChangesNothing) {
    vector<RigidHI::Scheme> schemes = {RigidHI::LangevinHI};
    for (const SchemeTraits& traits : overdampedSchemes()) schemes.push_back(traits.scheme);
    for (auto scheme : schemes)
        for (auto model : {MobilityForce::FreeDraining, MobilityForce::RotnePragerYamakawa}) {
            const auto run = [&](int how) {
                FlowScene scene(T1, 0.01, scheme);
                scene.fluid->setModel(model);
                if (how == 1) {
                    LinearFlow().set(*scene.fluid);
                    scene.fluid->setSinusoidalForceDensity(0, 2, 0, 3);
                }
                if (how == 2) generalFlow().set(*scene.fluid);
                scene.addMixture();
                scene.start();
                if (how == 2) {
                    LinearFlow().set(*scene.fluid);
                    scene.fluid->updateParametersInContext(*scene.context);
                }
                scene.integrator.step(3);
                return VectorXd(scene.state());
            };
            const VectorXd without = run(0);
            EXPECT_EQ(run(1), without) << traitsOf(scheme).name;
            EXPECT_EQ(run(2), without) << traitsOf(scheme).name;
        }
}

TEST(DrivenFlowInTime, ChangesAtOnce) {
    const LinearFlow flow = generalFlow();
    for (auto scheme : {RigidHI::LangevinHI, RigidHI::EulerMaruyama})
        for (auto model : {MobilityForce::FreeDraining, MobilityForce::RotnePragerYamakawa}) {
            FlowScene changed(T1, 0.01, scheme), always(T1, 0.01, scheme);
            flow.set(*always.fluid);
            for (FlowScene* scene : {&changed, &always}) {
                scene->fluid->setModel(model);
                scene->addMixture();
                scene->start();
            }
            changed.mobility();  // the fluid is made
            flow.set(*changed.fluid);
            changed.fluid->updateParametersInContext(*changed.context);
            for (FlowScene* scene : {&changed, &always}) scene->integrator.step(3);
            EXPECT_EQ(changed.state(), always.state());
        }
    PeriodicScene scene(periodicModels[2]);
    scene.add(sphereKind(0.8), Vec3(1, 2, 3));
    scene.start();
    expectNear(scene.stepTwists(), VectorXd::Zero(6), 1e-14);
    const Wave wave = {0.3, 0, 1, 2};
    wave.set(*scene.fluid);
    scene.fluid->updateParametersInContext(*scene.context);
    expectNear(scene.stepTwists(), scene.waveSlips(wave), 1e-12);
}

TEST(DrivenFlowInTime, ResumesBitForBit) {
    const auto step = [](FlowScene& scene) { scene.integrator.step(2); };
    const auto starting = [](RigidHI::Scheme scheme, MobilityForce::Solver solver,
                             double tolerance = 1e-6) {
        return [=](int threads) {
            auto scene = make_unique<FlowScene>(T1, 0.005, scheme);
            generalFlow().set(*scene->fluid);
            scene->fluid->setSolver(solver);
            scene->fluid->setSolverTolerance(tolerance);
            scene->addMixture();
            scene->FluidScene::start(testPlatform(), threads);
            return scene;
        };
    };
    vector<RigidHI::Scheme> schemes = {RigidHI::LangevinHI};
    for (const SchemeTraits& traits : overdampedSchemes()) schemes.push_back(traits.scheme);
    for (auto scheme : schemes)
        for (auto solver : {MobilityForce::Dense, MobilityForce::MatrixFree})
            expectToResumeBitForBit<FlowScene>(starting(scheme, solver), step, 2);
    // Iterations may end at the same number by chance.
    for (auto scheme : {RigidHI::LangevinHI, RigidHI::TrapezoidalSlip, RigidHI::DriftCorrectorRFD})
        for (double tolerance : {1e-2, 1e-3, 1e-4, 1e-5, 1e-7}) {
            SCOPED_TRACE(tolerance);
            const auto start = starting(scheme, MobilityForce::MatrixFree, tolerance);
            expectToResumeBitForBit<FlowScene>(start, step, 2);
            const auto asked = start(1), silent = start(1);
            asked->integrator.step(2);
            asked->fluid->getMobilityInContext(*asked->context);
            asked->integrator.step(2);
            silent->integrator.step(4);
            EXPECT_EQ(asked->state(), silent->state());
        }
    for (const ModelCase& model : periodicModels) {
        const auto start = [&](int threads) {
            auto scene = make_unique<PeriodicScene>(model, T1, 0.005, RigidHI::TrapezoidalSlip);
            Wave{0.5, 1, 2, 1}.set(*scene->fluid);
            scene->fluid->setSolverTolerance(1e-3);
            scene->add(sphereKind(0.8), Vec3(1, 2, 3));
            scene->add(sphereKind(0.7), Vec3(3.4, 2, 3.5));
            scene->FluidScene::start(testPlatform(), threads);
            return scene;
        };
        const auto toAnotherBox = [](PeriodicScene& scene) {
            scene.integrator.step(1);
            scene.setBox(8, 7.5, 9);
            scene.integrator.step(1);
        };
        expectToResumeBitForBit<PeriodicScene>(start, toAnotherBox, 2);
    }
}
