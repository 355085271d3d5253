// The flow of the fluid, as users read it, is compared with Stokes' solution, tracers, and averages
// over particles. Tests of walls, modes, incompressibility and the Brownian stress follow.
// TestFlowOfStep.cpp tests which flow users get at which time.

#include <array>

#include "FlowReadingSupport.h"
#include "Instrumented.h"

using namespace OpenMM;
using namespace RigidHITest;
using namespace std;

namespace {

using Points = vector<Vec3>;

/** The divergences at points by central differences. The flow is read once for all of them, because
 * each reading repeats the last step. */
VectorXd divergencesOfFlow(Pushed& scene, const Points& points, double step) {
    Points around;
    for (const Vec3& x : points)
        for (int k = 0; k < 3; k++) {
            Vec3 d;
            d[k] = step;
            around.push_back(x + d);
            around.push_back(x - d);
        }
    const MatrixXd u = scene.flow(around);
    VectorXd sums = VectorXd::Zero(points.size());
    for (int i = 0; i < u.cols(); i += 2)
        sums[i / 6] += (u(i / 2 % 3, i) - u(i / 2 % 3, i + 1)) / (2 * step);
    return sums;
}

}  // namespace

// ---- What the flow is ----

TEST(Flow, OfASphereIsThatOfStokes) {
    SKIP_ON_SINGLE_PRECISION_DEVICES("positions are rounded");
    const double a = 0.8, eta = 0.6;
    const Vector3d centre(1, -2, 0.5);
    const VectorXd wrench = someWrenches(1);
    for (auto model : {MobilityForce::RotnePragerYamakawa, MobilityForce::StokesianDynamics})
        for (auto solver : {MobilityForce::Dense, MobilityForce::MatrixFree}) {
            if (model == MobilityForce::StokesianDynamics && solver == MobilityForce::MatrixFree)
                continue;
            Pushed scene({"", model, solver});
            scene.add(sphereKind(a), toVec3(centre), {{0.6, 0, 0.8, 0}});
            scene.pushBy(wrench);
            scene.start();
            Points points;
            for (double r : {0.0, 0.4, 0.79, 0.81, 1.5, 30.0})
                for (const Vector3d& n : {Vector3d(1, 2, 2), Vector3d(-2, 1, 2), Vector3d(0, 0, 3)})
                    points.push_back(toVec3(centre + r / 3 * n));
            const MatrixXd flow = scene.flow(points);
            for (size_t p = 0; p < points.size(); p++)
                expectNear(
                    flow.col(p),
                    stokes(toEigen(points[p]) - centre, a, eta, wrench.head<3>(), wrench.tail<3>()),
                    1e-14);
        }
}

TEST(Flow, OfSeveralIsTheSumAndOfFreeParticlesToo) {
    SKIP_ON_SINGLE_PRECISION_DEVICES("positions are rounded");
    const double eta = 0.6, freeRadius = 0.3;
    const Vector3d x[] = {Vector3d(3, 1, -2), Vector3d(-1, 2.5, 1), Vector3d(0.4, -2, 2)};
    const VectorXd wrenches = someWrenches(2);
    Pushed scene;
    scene.add(sphereKind(0.8), toVec3(x[0]));
    scene.add(sphereKind(0.5), toVec3(x[1]));
    scene.addFree(1, freeRadius, toVec3(x[2]));
    scene.pushBy(wrenches);
    scene.addField("-0.7*x + 0.2*z");  // a force (0.7, 0, -0.2) on every particle
    scene.start();
    const Vector3d field(0.7, 0, -0.2);
    const Points points = {Vec3(0.3, -2, 2.1), Vec3(1, 1, 1), Vec3(3, 1.5, -2), Vec3(-4, 2, 0)};
    const MatrixXd flow = scene.flow(points);
    for (size_t p = 0; p < points.size(); p++) {
        const Vector3d at = toEigen(points[p]);
        expectNear(
            flow.col(p),
            stokes(at - x[0], 0.8, eta, wrenches.head<3>() + field, wrenches.segment<3>(3)) +
                stokes(at - x[1], 0.5, eta, wrenches.segment<3>(6) + field, wrenches.tail<3>()) +
                stokes(at - x[2], freeRadius, eta, field, Vector3d::Zero()),
            forceTolerance(1e-13, 1));
    }
}

TEST(Flow, CarriesTracers) {
    // A sphere too small to be felt follows the flow. Its velocity is given by rows of the mobility
    // matrix, which other tests compare with the papers. The average of the flow over its surface
    // differs by a^2/6 times the Laplacian.
    SKIP_ON_SINGLE_PRECISION_DEVICES("positions are rounded");
    struct Case {
        string name;
        ModelCase model;
        MobilityForce::Boundary boundary;
        bool bestKnown, own, blobs;
        double radius, tolerance;
    };
    const ModelCase matrixFree = {"", MobilityForce::RotnePragerYamakawa,
                                  MobilityForce::MatrixFree};
    const Case cases[] = {
        {"unbounded", rotnePrager, MobilityForce::Unbounded, false, false, true, 1e-4, 1e-7},
        {"unbounded, matrix-free", matrixFree, MobilityForce::Unbounded, false, false, true, 1e-4,
         1e-7},
        {"own tensors", rotnePrager, MobilityForce::Unbounded, false, true, true, 1e-4, 1e-7},
        {"own tensors, matrix-free", matrixFree, MobilityForce::Unbounded, false, true, true, 1e-4,
         1e-7},
        {"wall", rotnePrager, MobilityForce::NoSlipWall, false, false, true, 1e-4, 1e-7},
        {"wall, matrix-free", matrixFree, MobilityForce::NoSlipWall, false, false, true, 1e-4,
         1e-7},
        {"best known", rotnePrager, MobilityForce::NoSlipWall, true, false, true, 1e-4, 1e-7},
        {"periodic", rotnePrager, MobilityForce::Periodic, false, false, true, 1e-3, 1e-5},
        {"force coupling", forceCoupling, MobilityForce::Periodic, false, false, true, 0.02, 1e-3},
        {"channel", forceCoupling, MobilityForce::SlipChannel, false, false, true, 0.02, 1e-3},
    };
    const Points points = {Vec3(1.2, 0.8, 1.9), Vec3(3.2, 3.5, 4), Vec3(2.1, 0.2, 2.8)};
    for (const Case& c : cases) {
        SCOPED_TRACE(c.name);
        Pushed scene(c.model);
        scene.fluid->setBoundary(c.boundary);
        scene.fluid->setChannelWalls(-1, 6.5);
        if (c.bestKnown) scene.fluid->setSphereWallMobility(MobilityForce::BestKnown);
        scene.add(sphereKind(0.7), Vec3(3.1, 2, 1.1));
        scene.add(apartKind(), Vec3(1, 1, 2.5), {{0.8, 0.6, 0, 0}});
        BodyKind eccentric = sphereKind(0.5);
        eccentric.sites[0] = Vec3(0.1, 0.3, -0.2);
        scene.add(eccentric, Vec3(3.5, 4, 3), {{0.6, 0, 0.8, 0}});
        if (c.own)
            for (int body : {0, 1})
                scene.fluid->setBodyMobility(body, rowsOf(tensorWithoutSymmetry(body)));
        const VectorXd wrenches = someWrenches(3);
        for (const Vec3& x : points) scene.add(sphereKind(c.radius), x);
        VectorXd all = VectorXd::Zero(18 + 6 * points.size());
        all.head(18) = wrenches;
        scene.pushBy(all);
        scene.start();
        const VectorXd expected = scene.mobility() * all;
        const MatrixXd flow = scene.flow(points);
        for (size_t p = 0; p < points.size(); p++)
            expectNear(flow.col(p), expected.segment<3>(18 + 6 * p), c.tolerance);
        EXPECT_GT(flow.norm(), 0.05);
    }
}

TEST(Flow, MatrixFreeIsDenseToItsTolerance) {
    // Forces with a relative error t in the norm of M (power P = F U) give a tracer of radius a a
    // velocity with an error of at most t sqrt(P/(6 pi eta a)).
    SKIP_ON_SINGLE_PRECISION_DEVICES("positions are rounded");
    const double a = 0.3, eta = 0.6;
    const VectorXd wrenches = someWrenches(3);
    const Points points = {Vec3(2, 3, 2), Vec3(2.2, 0.5, 0.4), Vec3(0.2, 2.3, 3.1)};
    const auto make = [&](MobilityForce::Solver solver, double tolerance) {
        auto scene = make_unique<Pushed>(ModelCase{"", MobilityForce::RotnePragerYamakawa, solver});
        scene->fluid->setSolverTolerance(tolerance);
        scene->add(boomerangKind(), Vec3(1, 1, 2.5), {{0.8, 0.6, 0, 0}});
        scene->add(boomerangKind(), Vec3(2.5, 2, 1.5));
        scene->add(rodKind(), Vec3(1, -0.5, 1));
        scene->pushBy(wrenches.head(12));
        scene->start();
        return scene;
    };
    const auto dense = make(MobilityForce::Dense, 1e-6);
    const MatrixXd expected = dense->flow(points);
    const VectorXd pushes = wrenches.head(12);
    const double power = pushes.dot(dense->mobility().topLeftCorner(12, 12) * pushes);
    for (double tolerance : {1e-2, 1e-4, 1e-6}) {
        const MatrixXd error = make(MobilityForce::MatrixFree, tolerance)->flow(points) - expected;
        EXPECT_LT(error.cwiseAbs().maxCoeff(), tolerance * sqrt(power / (6 * M_PI * eta * a)));
    }
}

TEST(Flow, BlobsAreHeldByIt) {
    // The average of the flow over the envelope of each blob is the rigid motion there, without a
    // driven flow, in driven flows, and with noise. A rule of degree 2n on a surface leaves (a_i/(r
    // - a_j))^(2n) of the neighbour's flow: 0.55^32.
    SKIP_ON_SINGLE_PRECISION_DEVICES("positions are rounded");
    struct Case {
        ModelCase model;
        MobilityForce::Boundary boundary;
        int rule;
        double tolerance;
    };
    const ModelCase matrixFree = {"RotnePragerYamakawa, matrix-free",
                                  MobilityForce::RotnePragerYamakawa, MobilityForce::MatrixFree};
    const Case cases[] = {{rotnePrager, MobilityForce::Unbounded, 16, 1e-7},
                          {matrixFree, MobilityForce::Unbounded, 16, 1e-7},
                          {rotnePrager, MobilityForce::NoSlipWall, 16, 1e-7},
                          {matrixFree, MobilityForce::NoSlipWall, 16, 1e-7},
                          {rotnePrager, MobilityForce::Periodic, 12, 1e-5},
                          {forceCoupling, MobilityForce::Periodic, 12, 1e-5}};
    for (const Case& c : cases)
        for (double temperature : {0.0, T1}) {
            // With noise the flow is that of forces, too.
            if (temperature == 0 && c.boundary != MobilityForce::Unbounded) continue;
            SCOPED_TRACE(c.model.name + testing::PrintToString(c.boundary));
            // One step from one evaluation moves exactly with the flow of its start.
            Pushed scene(c.model, temperature, 1e-3);
            scene.fluid->setBoundary(c.boundary);
            if (c.boundary == MobilityForce::Periodic)
                Wave{0.3, 0, 1, 1}.set(*scene.fluid);
            else if (c.boundary == MobilityForce::NoSlipWall)
                scene.fluid->setBackgroundFlow(Vec3(), {0, 0, 0.2, 0, 0, -0.3, 0, 0, 0});
            else
                generalFlow().set(*scene.fluid);
            scene.add(apartKind(), Vec3(1, 1, 2.5), {{0.8, 0.6, 0, 0}});
            scene.add(sphereKind(0.6), Vec3(3.5, 2, 1.5));
            scene.pushBy(someWrenches(2));
            scene.start();
            const auto before = scene.labBodies();
            const VectorXd twists = scene.stepTwists();
            EXPECT_LT(slipOfParticles(scene, before, twists, c.rule),
                      c.tolerance * twists.cwiseAbs().maxCoeff());
            EXPECT_GT(twists.norm(), 0.1);
        }
}

TEST(Flow, SpheresOnAGridAreHeldByIt) {
    // With noise the flow has all waves of the grid, and the quadrature rule averages those that
    // the Gaussians leave. Gaussians are cut off on the grid, to its tolerance.
    SKIP_ON_SINGLE_PRECISION_DEVICES("positions are rounded");
    for (double temperature : {0.0, T1}) {
        // With noise the flow is that of forces, too.
        if ((isInstrumented() || testPlatformName() == "Reference") && temperature == 0) continue;
        Pushed scene(onGrid, temperature, 1e-3);
        scene.fluid->setBoundary(MobilityForce::Periodic);
        scene.fluid->setSolverTolerance(1e-4);
        scene.add(sphereKind(0.9), Vec3(1, 1, 2.5));
        scene.add(sphereKind(1.1), Vec3(3.2, 1.4, 2));
        scene.pushBy(someWrenches(2));
        scene.start();
        const auto before = scene.labBodies();
        const VectorXd twists = scene.stepTwists();
        EXPECT_LT(slipOfParticles(scene, before, twists, temperature > 0 ? 24 : 12),
                  2e-4 * twists.cwiseAbs().maxCoeff());
    }
}

TEST(Flow, OfEverySchemeHoldsSpheres) {
    // The step moved with the flow at the poses at which its forces were evaluated: at the start,
    // at the mid-point, or at both ends. At other poses the agreement is lower by one power of the
    // displacement.
    SKIP_ON_SINGLE_PRECISION_DEVICES("differences of positions are rounded");
    for (const SchemeTraits& traits : overdampedSchemes())
        for (auto scaling : {RigidHI::SlipOnly, RigidHI::Whole})
            for (bool noise : {false, true}) {
                const bool corrects = traits.scheme == RigidHI::DriftCorrectorFD ||
                                      traits.scheme == RigidHI::DriftCorrectorRFD;
                if (scaling == RigidHI::Whole && !corrects) continue;
                SCOPED_TRACE(string(traits.name) + (noise ? ", noise" : ""));
                double slips[2];
                for (int i : {0, 1}) {
                    const double h = i ? 1e-6 : 1e-4;
                    Pushed scene(rotnePrager, noise ? T1 : 0, h, traits.scheme);
                    scene.integrator.setDriftCorrectorScaling(scaling);
                    if (!noise) generalFlow().set(*scene.fluid);
                    scene.add(sphereKind(0.6), Vec3(3, 1, 0.5));
                    scene.add(sphereKind(0.7), Vec3(1.4, 1.1, 1.1));
                    if (!noise) scene.pushBy(someWrenches(2));
                    scene.start();
                    auto bodies = scene.labBodies();
                    const VectorXd twists = scene.stepTwists();
                    const auto after = scene.labBodies();
                    // With noise alone the mid-point is at half the displacement.
                    if (corrects)
                        for (size_t b = 0; noise && b < bodies.size(); b++)
                            bodies[b].R = 0.5 * (bodies[b].R + after[b].R);
                    slips[i] =
                        slipOfParticles(scene, bodies, twists, 16) / twists.cwiseAbs().maxCoeff();
                }
                // The trapezoidal rule has the slips (surface velocities) of its start, and the
                // forces of both ends.
                const bool atOnePlace = traits.scheme != RigidHI::FixmanMidpoint &&
                                        (traits.scheme != RigidHI::TrapezoidalSlip || noise);
                if (atOnePlace) {
                    for (double slip : slips) EXPECT_LT(slip, 1e-8);
                } else {
                    EXPECT_LT(slips[0], 0.05);
                    EXPECT_NEAR(slips[0] / slips[1], noise ? 10 : 100, noise ? 1 : 10);
                }
            }
}

TEST(Flow, SpheresWithStressletsAreRigid) {
    // In a strain the surface of a sphere moves rigidly, with stresslet and driven flow together.
    SKIP_ON_SINGLE_PRECISION_DEVICES("positions are rounded");
    const double a = 0.8;
    const Vector3d centre(1, 2, -1);
    const LinearFlow flow = generalFlow();
    const VectorXd wrench = someWrenches(1);
    Pushed scene(stokesian);
    flow.set(*scene.fluid);
    scene.add(sphereKind(a), toVec3(centre));
    scene.pushBy(wrench);
    scene.start();
    const double eta = 0.6;
    const Vector3d V = flow.at(centre) + wrench.head<3>() / (6 * M_PI * eta * a),
                   omega = flow.halfCurl() + wrench.tail<3>() / (8 * M_PI * eta * pow(a, 3));
    for (double r : {1.0, 0.5})
        for (const Vector3d& n : {Vector3d(1, 2, 2), Vector3d(-2, 1, 2), Vector3d(0, 0, 3)}) {
            const Vector3d d = r * a * n / 3;
            expectNear(scene.flow({toVec3(centre + d)}), V + omega.cross(d), 1e-13);
        }
    // The expected flow outside of a sphere without forces is Batchelor 1967, eq. 4.9.
    scene.pushBy(VectorXd::Zero(6));
    const Vector3d d(1.1, -0.4, 0.9);
    const double r = d.norm();
    const Matrix3d E = flow.strain();
    const Vector3d disturbed =
        -pow(a / r, 5) * E * d -
        2.5 * d * d.dot(E * d) * (pow(a, 3) / pow(r, 5) - pow(a, 5) / pow(r, 7));
    expectNear(scene.flow({toVec3(centre + d)}), flow.at(centre + d) + disturbed, 1e-13);
}

TEST(Flow, StaysAwayFromWalls) {
    SKIP_ON_SINGLE_PRECISION_DEVICES("positions are rounded");
    for (auto solver : {MobilityForce::Dense, MobilityForce::MatrixFree})
        for (auto sphereWall : {MobilityForce::FromModel, MobilityForce::BestKnown}) {
            Pushed scene({"", MobilityForce::RotnePragerYamakawa, solver});
            scene.fluid->setBoundary(MobilityForce::NoSlipWall);
            scene.fluid->setWallHeight(0.3);
            scene.fluid->setSphereWallMobility(sphereWall);
            scene.add(sphereKind(0.6), Vec3(3, 2, 1.1));
            scene.add(apartKind(), Vec3(1, 1, 2.5), {{0.8, 0.6, 0, 0}});
            scene.addFree(1, 0.3, Vec3(0, 2, 1));
            scene.pushBy(someWrenches(2));
            scene.addField("0.3*x - 0.2*z");
            scene.start();
            EXPECT_LT(
                scene.flow({Vec3(2, 1, 0.3), Vec3(3, 2, 0.3), Vec3(-4, 9, 0.3), Vec3(0, 2, 0.3)})
                    .norm(),
                1e-14);
            EXPECT_GT(scene.flow({Vec3(2, 1, 0.5)}).norm(), 1e-3);
        }
    for (auto solver : {MobilityForce::Dense, MobilityForce::MatrixFree})
        for (double temperature : {0.0, T1}) {
            Pushed scene({"", MobilityForce::ForceCoupling, solver}, temperature, 0.01);
            scene.fluid->setBoundary(MobilityForce::SlipChannel);
            scene.fluid->setChannelWalls(1, 5);
            scene.fluid->setSolverTolerance(1e-6);
            scene.add(sphereKind(0.6), Vec3(3, 2, 1.1));
            scene.add(sphereKind(0.5), Vec3(1, 4.2, 2.5));
            scene.pushBy(someWrenches(2));
            scene.start();
            if (temperature > 0) scene.integrator.step(1);
            const double scale = scene.flow({Vec3(3, 2, 1.1)}).norm(), d = 1e-4;
            for (double wall : {1.0, 5.0})
                for (const Vec3& x : {Vec3(3, wall, 1), Vec3(1, wall, 3.3)}) {
                    const double inside = wall == 1 ? d : -d;
                    const MatrixXd u = scene.flow({x, x + Vec3(0, inside, 0)});
                    EXPECT_LT(abs(u(1, 0)), 1e-9 * scale);
                    // Without shear stress the velocity along the wall changes as the square of the
                    // distance.
                    for (int k : {0, 2}) EXPECT_LT(abs(u(k, 1) - u(k, 0)), 1e-2 * d * scale);
                }
        }
}

TEST(Flow, HasNoSources) {
    // Central differences of a step d leave d^2/6 times third derivatives of about scale/a^3, or
    // k^3 = 40^3 of the noise on a grid.
    SKIP_ON_SINGLE_PRECISION_DEVICES("positions are rounded");
    const double d = 2e-5;
    const auto expectNone = [&](Pushed& scene, const Points& points, const string& what) {
        const double scale = scene.flow(points).cwiseAbs().maxCoeff();
        EXPECT_GT(scale, 1e-3) << what;
        EXPECT_LT(divergencesOfFlow(scene, points, d).cwiseAbs().maxCoeff(), 2e-5 * scale) << what;
    };
    for (const ModelCase& model : periodicModels)
        for (auto boundary : {MobilityForce::Unbounded, MobilityForce::NoSlipWall,
                              MobilityForce::Periodic, MobilityForce::SlipChannel})
            for (bool noise : {false, true}) {
                const bool coupling = model.model == MobilityForce::ForceCoupling;
                const bool bounded =
                    boundary == MobilityForce::Unbounded || boundary == MobilityForce::NoSlipWall;
                if (coupling && bounded) continue;
                if (!coupling && boundary == MobilityForce::SlipChannel) continue;
                if (model.model == MobilityForce::StokesianDynamics &&
                    boundary == MobilityForce::NoSlipWall)
                    continue;
                Pushed scene(model, noise ? T1 : 0, 1e-3);
                scene.fluid->setBoundary(boundary);
                scene.fluid->setChannelWalls(-1, 6);
                scene.fluid->setSolverTolerance(1e-6);
                scene.add(sphereKind(0.6), Vec3(3, 2, 1.1));
                if (model.model == MobilityForce::StokesianDynamics)
                    scene.add(sphereKind(0.7), Vec3(1, 1, 2.5));
                else
                    scene.add(apartKind(), Vec3(1, 1, 2.5), {{0.8, 0.6, 0, 0}});
                scene.pushBy(someWrenches(2));
                scene.start();
                if (noise) scene.integrator.step(1);
                expectNone(scene, {Vec3(2, 3, 2), Vec3(4.2, 2, 0.3), Vec3(1.9, 1.1, 3.1)},
                           model.name);
            }
}

// ---- Modes ----

namespace {

/** The sine and the cosine of a wave in a box of edge 8, from the flow at points. */
Eigen::Vector2d modeOfPoints(const MatrixXd& flow, const Points& points, int force, int wave,
                             int index) {
    Eigen::Vector2d sums(0, 0);
    for (int p = 0; p < flow.cols(); p++) {
        const double angle = 2 * M_PI * index / 8 * points[p][wave];
        sums += 2.0 / flow.cols() * flow(force, p) * Eigen::Vector2d(sin(angle), cos(angle));
    }
    return sums;
}

void checkModes(bool noise) {
    // Sums over n^3 points are exact for a band-limited flow. The flow on a grid is band-limited,
    // because Gaussians are cut off within the tolerance. At the last wave, Gaussians of width
    // a/sqrt(pi) have exp(-(n pi/8)^2 a^2/(2 pi)) left. The flow of surfaces has a kink, so n^-3 is
    // left.
    struct Case {
        ModelCase model;
        int points;
        double tolerance;
    };
    for (const Case& c : {Case{rotnePrager, 16, 3e-3}, Case{forceCoupling, 24, 1e-6},
                          Case{onGrid, 24, 1e-6}, Case{stokesian, 16, 3e-3}}) {
        SCOPED_TRACE(c.model.name);
        Pushed scene(c.model, noise ? T1 : 0, 1e-3, RigidHI::TrapezoidalSlip);
        scene.fluid->setBoundary(MobilityForce::Periodic);
        scene.fluid->setSolverTolerance(1e-6);
        if (c.model.solver == MobilityForce::MatrixFree) scene.fluid->setGridSpacing(8.0 / 24);
        Wave{0.3, 1, 0, 1}.set(*scene.fluid);
        scene.add(sphereKind(0.9), Vec3(1, 2, 3));
        scene.add(sphereKind(0.8), Vec3(3, 3, 4));
        scene.pushBy(someWrenches(2));
        scene.start();
        if (noise) scene.integrator.step(1);
        Points points;
        const int n = c.points;
        for (int i = 0; i < n * n * n; i++)
            points.push_back(8.0 / n * Vec3(i / (n * n) + 0.5, i / n % n + 0.5, i % n + 0.5));
        const MatrixXd flow = scene.flow(points);
        const double scale = flow.cwiseAbs().maxCoeff();
        EXPECT_LT(flow.rowwise().mean().cwiseAbs().maxCoeff(), c.tolerance * scale);
        for (int force = 0; force < 3; force++)
            for (int wave = 0; wave < 3; wave++)
                for (int index : {1, 2}) {
                    if (force == wave) continue;
                    const Eigen::Vector2d sums = modeOfPoints(flow, points, force, wave, index);
                    EXPECT_LT((sums - scene.mode(force, wave, index)).cwiseAbs().maxCoeff(),
                              c.tolerance * scale)
                        << force << wave << index;
                }
    }
}

}  // namespace

/** The flow with noise is that of forces, of slips and of a random field. */
TEST(Flow, ModesAreThoseOfTheFlowAtPoints) {
    SKIP_ON_SINGLE_PRECISION_DEVICES("positions are rounded");
    checkModes(true);
}
TEST(Flow, FullModesWithoutNoiseAreThoseOfTheFlowAtPoints) {
    SKIP_ON_SINGLE_PRECISION_DEVICES("positions are rounded");
    checkModes(false);
}

TEST(Flow, ModesInChannels) {
    SKIP_ON_SINGLE_PRECISION_DEVICES("positions are rounded");
    for (auto solver : {MobilityForce::Dense, MobilityForce::MatrixFree})
        for (bool noise : {false, true}) {
            // With noise the flow is that of forces, too.
            if (!noise && solver == MobilityForce::MatrixFree) continue;
            Pushed scene({"", MobilityForce::ForceCoupling, solver}, noise ? T1 : 0, 1e-3);
            scene.fluid->setBoundary(MobilityForce::SlipChannel);
            scene.fluid->setChannelWalls(1, 5);
            scene.fluid->setSolverTolerance(1e-6);
            scene.fluid->setGridSpacing(8.0 / 24);
            Wave{0.3, 2, 0, 2}.set(*scene.fluid);
            scene.add(sphereKind(0.9), Vec3(1, 2.3, 3));
            scene.add(sphereKind(0.8), Vec3(3, 3.8, 4));
            scene.pushBy(someWrenches(2));
            scene.start();
            if (noise) scene.integrator.step(1);
            // The flow is even about the walls. So sums over points that begin half a step from the
            // walls are exact too.
            Points points;
            const int n = 24, m = n / 2;
            for (int i = 0; i < n * m * n; i++)
                points.push_back(Vec3(8.0 / n * (i / (n * m)), 1 + 4.0 / m * (i / n % m + 0.5),
                                      8.0 / n * (i % n)));
            const MatrixXd flow = scene.flow(points);
            const double scale = flow.cwiseAbs().maxCoeff();
            for (int force : {0, 2})
                for (int index : {1, 2}) {
                    const int wave = 2 - force;
                    const Eigen::Vector2d sums = modeOfPoints(flow, points, force, wave, index);
                    EXPECT_LT((sums - scene.mode(force, wave, index)).cwiseAbs().maxCoeff(),
                              1e-6 * scale);
                }
        }
}

TEST(Flow, RandomModesAreThoseOfTheFluctuatingStress) {
    // For a field with the covariance 2 kT/h M, the exact <A^2> of a mode is 2 kT/h times 2/(eta
    // k^2 V), for sin and cos alike. Without a field it is 0.
    const int copies = 1000;
    const double h = 0.01;
    Pushed scene(onGrid, T1, h);
    scene.fluid->setBoundary(MobilityForce::Periodic);
    scene.fluid->setGridSpacing(0.5);
    scene.add(sphereKind(1.1), Vec3(1, 2, 3));
    scene.start();
    const double k = 2 * M_PI / 8;
    vector<double> squares, products, means;
    for (int i = 0; i < copies; i++) {
        scene.integrator.step(1);
        const Eigen::Vector2d A = scene.randomMode(0, 1, 1);
        squares.push_back(0.5 * A.squaredNorm());
        products.push_back(A[0] * A[1]);
        means.push_back(A[0]);
    }
    expectMean("<A^2>", estimate(squares), 2 / h * 2 / (0.6 * k * k * 512));
    expectMean("<A B>", estimate(products), 0);
    expectMean("<A>", estimate(means), 0);
    Pushed dense(forceCoupling, T1, h);
    dense.fluid->setBoundary(MobilityForce::Periodic);
    dense.add(sphereKind(1.1), Vec3(1, 2, 3));
    dense.start();
    dense.integrator.step(1);
    EXPECT_EQ(dense.randomMode(0, 1, 1), Eigen::Vector2d(0, 0));
    EXPECT_GT(dense.mode(0, 1, 1).norm(), 0.01);
}

// ---- Changes of frame ----

TEST(Flow, AUniformFlowIsAChangeOfFrame) {
    SKIP_ON_SINGLE_PRECISION_DEVICES("positions that are shifted are rounded in another way");
    const double h = 0.01;
    const Vector3d velocity(0.7, -0.4, 0.2);
    const Points points = {Vec3(1, 2, 3), Vec3(3, 1, 0), Vec3(-1, 0, 0.5)};
    vector<RigidHI::Scheme> schemes = {RigidHI::LangevinHI};
    for (const SchemeTraits& traits : overdampedSchemes()) schemes.push_back(traits.scheme);
    for (auto scheme : schemes) {
        if (scheme == RigidHI::TrapezoidalSlip) continue;  // its flow belongs to two poses
        SCOPED_TRACE(traitsOf(scheme).name);
        Pushed still(rotnePrager, T1, h, scheme), moving(rotnePrager, T1, h, scheme);
        uniform(velocity).set(*moving.fluid);
        for (Pushed* scene : {&still, &moving}) {
            scene->add(apartKind(), Vec3(1, 1, 2.5), {{0.8, 0.6, 0, 0}});
            scene->add(sphereKind(0.6), Vec3(3.5, 2, 1.5));
            scene->pushBy(someWrenches(2));
            scene->start();
        }
        if (scheme == RigidHI::LangevinHI)
            moving.integrator.setBodyVelocities(vector<Vec3>(2, toVec3(velocity)));
        for (Pushed* scene : {&still, &moving}) scene->integrator.step(1);
        // The displacement up to the poses where the forces were evaluated.
        const double gone = scheme == RigidHI::LangevinHI       ? h
                            : scheme == RigidHI::FixmanMidpoint ? h / 2
                                                                : 0;
        Points shifted = points;
        for (Vec3& x : shifted) x += gone * toVec3(velocity);
        const MatrixXd difference = moving.flow(shifted) - still.flow(points);
        // Finite differences over 1e-5 of the lengths magnify rounding.
        EXPECT_LT((difference.colwise() - velocity).cwiseAbs().maxCoeff(), 1e-7);
        EXPECT_GT(still.flow(points).norm(), 0.1);
    }
}

// ---- The Brownian stress ----

namespace {

/** The averaged quantities: flows at points, or amplitudes of modes. */
struct Observed {
    Points points;
    vector<array<int, 3>> modes;
    VectorXd of(Pushed& scene) const {
        VectorXd values(3 * points.size() + 2 * modes.size());
        if (!points.empty()) values << scene.flow(points).reshaped();
        for (size_t m = 0; m < modes.size(); m++)
            values.segment<2>(2 * m) = scene.mode(modes[m][0], modes[m][1], modes[m][2]);
        return values;
    }
    /** The same quantities of the model's random field. */
    VectorXd ofNoise(Pushed& scene) const {
        VectorXd values(2 * modes.size());
        for (size_t m = 0; m < modes.size(); m++)
            values.segment<2>(2 * m) = scene.randomMode(modes[m][0], modes[m][1], modes[m][2]);
        return values;
    }
};

/**
 * The theory: the matrix of the observed quantities for each wrench, and the divergences of this
 * matrix and of N, by differences of poses.
 */
struct Theory {
    MatrixXd N_flow, N;
    VectorXd div_flow, div_N;

    /** @param scene  without noise, before any step */
    Theory(Pushed& scene, const Observed& observed) {
        const auto R = scene.integrator.getBodyPositions();
        const auto q = scene.integrator.getBodyOrientations();
        const int rows = 6 * R.size();
        const auto column = [&](int k) {
            scene.pushBy(VectorXd::Unit(rows, k));
            return observed.of(scene);
        };
        N = scene.mobility();
        N_flow.resize(column(0).size(), rows);
        for (int k = 0; k < rows; k++) N_flow.col(k) = column(k);
        div_flow.setZero(N_flow.rows());
        div_N.setZero(rows);
        const double delta = 1e-3;
        for (int k = 0; k < rows; k++)
            for (int sign : {1, -1}) {
                auto R2 = R;
                auto q2 = q;
                if (k % 6 < 3)
                    R2[k / 6][k % 6] += sign * delta;
                else {
                    QuaternionArray turn = {{cos(delta / 2), 0, 0, 0}};
                    turn[k % 6 - 2] = sign * sin(delta / 2);
                    q2[k / 6] = product(turn, q[k / 6]);
                }
                scene.pose(R2, q2);
                div_flow += sign / (2 * delta) * column(k);
                div_N += sign / (2 * delta) * scene.mobility().col(k);
            }
        scene.pose(R, q);
    }
};

/**
 * Steps that all start from the same poses, at kT = 1 and without forces. The mean of the observed
 * quantities A is to be div_flow, and that of the bodies' velocity U is div N. N_flow N^-1 U is the
 * part of A that moves with the bodies. It is of order h^-1/2 and large, so it is subtracted. The
 * mean of the rest is div_flow minus N_flow N^-1 div N.
 */
struct Draws {
    vector<vector<double>> rest;   // of each component
    vector<VectorXd> A, U, noise;  // as drawn
};

Draws draw(Pushed& scene, const Observed& observed, const Theory& theory, int number) {
    const auto R = scene.integrator.getBodyPositions();
    const auto q = scene.integrator.getBodyOrientations();
    const MatrixXd following = theory.N_flow * theory.N.inverse();
    Draws draws;
    draws.rest.resize(following.rows());
    for (int i = 0; i < number; i++) {
        scene.pose(R, q);
        draws.U.push_back(scene.stepTwists());
        draws.A.push_back(observed.of(scene));
        if (!observed.modes.empty()) draws.noise.push_back(observed.ofNoise(scene));
        const VectorXd rest = draws.A.back() - following * draws.U.back();
        for (int a = 0; a < rest.size(); a++) draws.rest[a].push_back(rest[a]);
    }
    return draws;
}

/**
 * The root mean square over components of the deviations of means, in standard errors. The function
 * also checks that each deviation is within 5. Where nothing varies, the errors are those of the
 * theory's finite differences.
 */
double offBy(const vector<vector<double>>& samples, const VectorXd& expected, const char* what) {
    double squares = 0;
    for (int a = 0; a < expected.size(); a++) {
        Estimate found = estimate(samples[a]);
        found.error = max(found.error, 1e-5 * (0.1 + expected.norm()));
        if (what) expectMean(string(what) + ", component " + to_string(a), found, expected[a]);
        squares += pow((found.mean - expected[a]) / found.error, 2);
    }
    return sqrt(squares / expected.size());
}

vector<pair<RigidHI::Scheme, RigidHI::DriftCorrectorScaling>> schemesWithDrift() {
    vector<pair<RigidHI::Scheme, RigidHI::DriftCorrectorScaling>> found;
    for (const SchemeTraits& traits : overdampedSchemes()) {
        if (traits.omitsDrift()) continue;
        found.push_back({traits.scheme, RigidHI::SlipOnly});
        if (traits.scheme == RigidHI::DriftCorrectorRFD)
            found.push_back({traits.scheme, RigidHI::Whole});
    }
    return found;
}

void checkBrownianStress(
    const vector<pair<RigidHI::Scheme, RigidHI::DriftCorrectorScaling>>& schemes) {
    enum { TwoBodies, Alone, Spheres };
    for (int bodies : {TwoBodies, Alone, Spheres}) {
        const auto make = [&](double temperature, RigidHI::Scheme scheme) {
            auto scene = make_unique<Pushed>(rotnePrager, temperature, 1e-4, scheme);
            if (bodies == Spheres) {
                scene->add(sphereKind(0.5), Vec3(0, 0, 0));
                scene->add(sphereKind(0.4), Vec3(0.9, 0.3, 0.2));
            } else
                scene->add(apartKind(), Vec3(0, 0, 0));
            if (bodies == TwoBodies)
                scene->add(apartKind(), Vec3(1.2, -1.3, 1.2), {{0.8, 0, 0.6, 0}});
            scene->pushBy(VectorXd::Zero(6 * scene->bodies.size()));
            scene->start();
            return scene;
        };
        const Observed observed = {{Vec3(0.9, 0.9, 0.4), Vec3(0.5, -0.8, 0.1)}, {}};
        const auto cold = make(0, RigidHI::EulerMaruyama);
        const Theory theory(*cold, observed);
        const VectorXd expected =
            theory.div_flow - theory.N_flow * theory.N.inverse() * theory.div_N;
        if (bodies == Spheres) {
            EXPECT_LT(theory.div_flow.norm(), 1e-6);
        } else {
            EXPECT_GT(expected.norm(), 0.02);
        }
        // A scheme without drift has only the part that moves with the bodies, whatever is drawn.
        const auto plain = make(T1, RigidHI::EulerMaruyama);
        for (const auto& component : draw(*plain, observed, theory, 3).rest)
            for (double rest : component) EXPECT_LT(abs(rest), 1e-6);
        for (auto [scheme, scaling] : schemes) {
            SCOPED_TRACE(traitsOf(scheme).name);
            const auto scene = make(T1, scheme);
            scene->integrator.setDriftCorrectorScaling(scaling);
            const int number = 4000;
            const Draws draws = draw(*scene, observed, theory, number);
            offBy(draws.rest, expected, traitsOf(scheme).name);
            // The test can tell whether the Brownian stress is there.
            if (bodies != Spheres) {
                EXPECT_GT(offBy(draws.rest, VectorXd::Zero(expected.size()), nullptr), 8);
            }
        }
    }
}

}  // namespace

/** TestOverdampedSchemes has the exact mean flow of all schemes. */
TEST(Flow, HasTheBrownianStress) {
    SKIP_ON_DEVICES("thousands of steps that copy positions");
    checkBrownianStress({{RigidHI::TrapezoidalSlip, RigidHI::SlipOnly},
                         {RigidHI::DriftCorrectorRFD, RigidHI::Whole}});
}
TEST(Flow, FullHasTheBrownianStressWithEveryScheme) {
    SKIP_ON_DEVICES("thousands of steps that copy positions");
    checkBrownianStress(schemesWithDrift());
}

namespace {

/**
 * Check the mean over this number of steps, of each scheme on a grid. The mean must be known to a
 * fifth of itself.
 */
void checkBrownianStressOnAGrid(const vector<RigidHI::Scheme>& schemes, int number) {
    // Amplitudes of modes. The part of order h^-1/2 has no mean. It is found with the same random
    // numbers in a step so short that only this part is left.
    const double h = 1e-3, shortness = 1e-6;
    const auto make = [&](double temperature, double step, RigidHI::Scheme scheme) {
        auto scene = make_unique<Pushed>(onGrid, temperature, step, scheme);
        scene->fluid->setBoundary(MobilityForce::Periodic);
        scene->fluid->setSolverTolerance(1e-4);
        scene->integrator.setFiniteDifferenceStep(1e-3);
        scene->side = 4;
        BodyKind kind = apartKind();
        kind.radii.assign(4, 0.5);
        scene->add(kind, Vec3(0.7, 1.1, 2), {{0.8, 0, 0.6, 0}});
        scene->pushBy(VectorXd::Zero(6));
        scene->start();
        return scene;
    };
    const Observed observed = {{}, {{0, 1, 1}, {1, 2, 1}, {2, 0, 1}}};
    const auto cold = make(0, h, RigidHI::EulerMaruyama);
    cold->fluid->setSolverTolerance(1e-8);
    cold->fluid->updateParametersInContext(*cold->context);
    const VectorXd expected = Theory(*cold, observed).div_flow;
    EXPECT_GT(expected.norm(), 1e-3);
    for (auto scheme : schemes) {
        SCOPED_TRACE(traitsOf(scheme).name);
        const auto scene = make(T1, h, scheme), leading = make(T1, h * shortness, scheme);
        const auto R = scene->integrator.getBodyPositions();
        const auto q = scene->integrator.getBodyOrientations();
        vector<vector<double>> samples(expected.size());
        for (int i = 0; i < number; i++) {
            VectorXd A[2];
            for (int k : {0, 1}) {
                Pushed& each = k ? *leading : *scene;
                each.pose(R, q);
                each.integrator.step(1);
                A[k] = observed.of(each);
            }
            const VectorXd rest = A[0] - sqrt(shortness) * A[1];
            for (int a = 0; a < rest.size(); a++) samples[a].push_back(rest[a]);
        }
        offBy(samples, expected, traitsOf(scheme).name);
        EXPECT_GT(offBy(samples, VectorXd::Zero(expected.size()), nullptr), 5);
    }
}

}  // namespace

TEST(Flow, OnAGridHasTheBrownianStress) {
    SKIP_ON_DEVICES("hundreds of steps that copy positions");
    checkBrownianStressOnAGrid({RigidHI::TrapezoidalSlip}, 500);
}

/**
 * In drift correctors the product of nu and the random field varies more, so their mean would need
 * more steps. On a grid they do the same as the scheme with random differences.
 */
TEST(Flow, FullOnAGridHasTheBrownianStressOfOthers) {
    SKIP_ON_DEVICES("thousands of steps that copy positions");
    checkBrownianStressOnAGrid({RigidHI::RandomFiniteDifference}, 700);
    checkBrownianStressOnAGrid({RigidHI::DriftCorrectorFD}, 4500);
}
