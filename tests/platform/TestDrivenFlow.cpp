// The motion of bodies in flows that users drive is compared with closed forms, Jeffery's orbits
// and exact averages. It is also compared with rigid multiblobs and with spheres with stresslets
// that are written down a second time. Further tests are of invariance and of exact resume.

#include <openmm/CustomExternalForce.h>

#include <complex>

#include "FlowSupport.h"
#include "mobility/StressletBasis.h"
#include "mobility/models/periodic/PeriodicMobility.h"

using namespace OpenMM;
using namespace RigidHITest;
using namespace std;

// ---- Linear flows ----

TEST(DrivenFlow, CarriesSpheresAndFreeParticlesAndTurnsSpheres) {
    const LinearFlow flow = generalFlow();
    const Vec3 places[] = {Vec3(3, 1, -2), Vec3(-1, 2.5, 1), Vec3(0.4, -2, 2)};
    for (const SchemeTraits& traits : overdampedSchemes())
        for (auto model : {MobilityForce::FreeDraining, MobilityForce::RotnePragerYamakawa})
            for (auto solver : {MobilityForce::Dense, MobilityForce::MatrixFree}) {
                if (model == MobilityForce::FreeDraining && solver == MobilityForce::MatrixFree)
                    continue;
                SCOPED_TRACE(traits.name);
                FlowScene scene(0, 0.5, traits.scheme);
                scene.fluid->setModel(model);
                scene.fluid->setSolver(solver);
                flow.set(*scene.fluid);
                scene.add(sphereKind(0.8), places[0]);
                scene.add(sphereKind(0.5), places[1], {{0.6, 0, 0.8, 0}});
                scene.addFree(1, 0.3, places[2]);
                scene.start();
                VectorXd expected(15);
                // A scheme of order 2 takes the average of both ends or the mid-point. In a linear
                // field both are the same.
                const double h = 0.5, between = traits.coldOrder == 2 ? h / 2 : 0;
                const auto carried = [&](const Vec3& x) {
                    return flow.at(toEigen(x) + between * flow.at(toEigen(x)));
                };
                expected << carried(places[0]), flow.halfCurl(), carried(places[1]),
                    flow.halfCurl(), carried(places[2]);
                expectNear(scene.stepTwists(), expected, 1e-13);
            }
}

TEST(DrivenFlow, MultiblobsGoAsTheirBlobsLetThem) {
    for (auto boundary : {MobilityForce::Unbounded, MobilityForce::NoSlipWall})
        for (auto solver : {MobilityForce::Dense, MobilityForce::MatrixFree})
            for (bool pulled : {false, true}) {
                FlowScene scene;
                LinearFlow flow = generalFlow();
                if (boundary == MobilityForce::NoSlipWall) {
                    flow = LinearFlow();
                    flow.gradient.col(2) << 0.2, -0.3, 0;
                    flow.velocity = -0.7 * flow.gradient.col(2);
                    scene.fluid->setWallHeight(0.7);
                }
                scene.fluid->setBoundary(boundary);
                scene.fluid->setSolver(solver);
                scene.fluid->setSolverTolerance(1e-11);
                flow.set(*scene.fluid);
                scene.addMixture();
                if (pulled) scene.addField("0.1*z");
                scene.start();
                const IndependentMobility reference = scene.expected();
                VectorXd expected = reference.following * scene.slips(flow);
                if (pulled) {
                    VectorXd wrenches = VectorXd::Zero(expected.size());
                    int row = 0;
                    for (const LabBody& body : scene.labBodies()) {
                        for (const Vector3d& offset : body.offsets) {
                            wrenches.segment<3>(row) -= 0.1 * Vector3d::UnitZ();
                            if (!body.isFree)
                                wrenches.segment<3>(row + 3) -=
                                    0.1 * offset.cross(Vector3d::UnitZ());
                        }
                        row += body.rows();
                    }
                    expected += reference.mobility * wrenches;
                }
                expectNear(scene.stepTwists(), expected, pulled ? forceTolerance(1e-10, 1) : 1e-10);
            }
}

TEST(DrivenFlow, MatrixFreeKeepsItsTolerance) {
    // The tolerance is one in the norm of the friction, as for velocities that are caused by
    // forces.
    const LinearFlow flow = generalFlow();
    for (double tolerance : {1e-2, 1e-4, 1e-6}) {
        FlowScene scene;
        scene.fluid->setSolver(MobilityForce::MatrixFree);
        scene.fluid->setSolverTolerance(tolerance);
        flow.set(*scene.fluid);
        scene.addMixture();
        scene.start();
        const IndependentMobility reference = scene.expected();
        const VectorXd expected = reference.following * scene.slips(flow),
                       error = scene.stepTwists() - expected;
        EXPECT_LE(sqrt(error.dot(reference.friction * error)),
                  readTolerance(tolerance * sqrt(expected.dot(reference.friction * expected)), 10));
    }
}

TEST(DrivenFlow, FreeDrainingBodiesGoEachByItself) {
    const LinearFlow flow = generalFlow();
    FlowScene scene;
    scene.fluid->setModel(MobilityForce::FreeDraining);
    flow.set(*scene.fluid);
    scene.addMixture();
    scene.start();
    const VectorXd slips = scene.slips(flow);
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

TEST(DrivenFlow, BodiesWithTensorsOfTheirOwnGoAsTheirBlobs) {
    const LinearFlow flow = generalFlow();
    for (auto solver : {MobilityForce::Dense, MobilityForce::MatrixFree}) {
        FlowScene scene;
        scene.fluid->setSolver(solver);
        scene.fluid->setSolverTolerance(1e-11);
        flow.set(*scene.fluid);
        scene.addMixture();
        for (int body : {0, 2})
            scene.fluid->setBodyMobility(body, rowsOf(tensorWithoutSymmetry(body)));
        scene.start();
        expectNear(scene.stepTwists(), scene.expected().following * scene.slips(flow), 1e-10);
    }
    // FreeDraining takes tensors as they are, also those of bodies on a line. Bodies without
    // hydrodynamic particles follow the flow at their origin.
    FlowScene scene;
    scene.fluid->setModel(MobilityForce::FreeDraining);
    flow.set(*scene.fluid);
    scene.add(boomerangKind(), Vec3(1, 2, 3), {{0.6, 0, 0.8, 0}});
    scene.add(rodKind(), Vec3(-1, 0.5, 3), {{0.8, 0.6, 0, 0}});
    BodyKind unseen = boomerangKind();
    unseen.radii.assign(unseen.radii.size(), 0);
    scene.add(unseen, Vec3(2, -1, 1));
    for (int body : {0, 1, 2})
        scene.fluid->setBodyMobility(body, rowsOf(tensorWithoutSymmetry(body)));
    scene.start();
    const auto bodies = scene.labBodies();
    const VectorXd slips = scene.slips(flow);
    VectorXd expected(18);
    expected << scene.expected({bodies[0]}).following * slips.head<15>(),
        scene.expected({bodies[1]}).following * slips.segment<9>(15), flow.at(bodies[2].R),
        flow.halfCurl();
    // The blobs of a rod do not determine its rotation about its line, but its own tensor does.
    // About its line the rod turns with the flow.
    const Vector3d line = (bodies[1].offsets[1] - bodies[1].offsets[0]).normalized();
    expected.segment<3>(9) += line * line.dot(flow.halfCurl());
    expectNear(scene.stepTwists(), expected, 1e-12);
}

// ---- In time ----

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

TEST(DrivenFlow, JefferysOrbits) {
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

TEST(DrivenFlow, OrderWithoutNoise) {
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

// ---- Spheres that resist strain ----

namespace {

/** Derivatives of H = G + c Laplacian G, G = 1/r + xx/r^3: d_l H_ik in [l](i, k). */
template <class T>
void derivatives(const Eigen::Matrix<T, 3, 1>& x, double c, Eigen::Matrix<T, 3, 3> (&result)[3]) {
    const T r2 = x[0] * x[0] + x[1] * x[1] + x[2] * x[2], r = sqrt(r2);
    const T f1 = -1.0 / r2 - 6 * c / (r2 * r2), g = 1.0 / (r2 * r) - 6 * c / (r2 * r2 * r),
            g1 = -3.0 / (r2 * r2) + 30 * c / (r2 * r2 * r2);
    for (int l = 0; l < 3; l++)
        for (int i = 0; i < 3; i++)
            for (int k = 0; k < 3; k++)
                result[l](i, k) = (i == k ? f1 * x[l] / r : T(0)) + (i == l ? x[k] * g : T(0)) +
                                  (k == l ? x[i] * g : T(0)) + x[i] * x[k] * g1 * x[l] / r;
}

/** The flow of a stresslet, u_i = S_kl d_l H_ik/(8 pi eta) at x from it, or its gradient d_m u_i by
 * a complex step. */
Vector3d stressletVelocity(const Vector3d& x, double c, const Matrix3d& S, double eta) {
    Matrix3d d[3];
    derivatives<double>(x, c, d);
    Vector3d u = Vector3d::Zero();
    for (int l = 0; l < 3; l++) u += d[l] * S.col(l) / (8 * M_PI * eta);
    return u;
}
Matrix3d stressletGradient(const Vector3d& x, double c, const Matrix3d& S, double eta) {
    typedef complex<double> Complex;
    const double tiny = 1e-100;
    Matrix3d gradient;
    for (int m = 0; m < 3; m++) {
        Eigen::Matrix<Complex, 3, 1> there = x.cast<Complex>();
        there[m] += Complex(0, tiny);
        Eigen::Matrix<Complex, 3, 3> d[3];
        derivatives<Complex>(there, c, d);
        gradient.col(m).setZero();
        for (int l = 0; l < 3; l++)
            gradient.col(m) += (d[l] * S.col(l).cast<Complex>()).imag() / tiny / (8 * M_PI * eta);
    }
    return gradient;
}

/** Twists of spheres without forces in a linear flow, each with a stresslet (Faxen's laws; Kim and
 * Karrila, 1991), by reflections. */
VectorXd spheresInFlow(const vector<Vector3d>& x, const vector<double>& a, const LinearFlow& flow,
                       double eta) {
    const size_t n = x.size();
    vector<Matrix3d> S(n, Matrix3d::Zero());
    for (int reflection = 0; reflection < 200; reflection++) {
        const vector<Matrix3d> before = S;
        for (size_t i = 0; i < n; i++) {
            Matrix3d E = flow.strain();
            for (size_t j = 0; j < n; j++) {
                if (j == i) continue;
                const Matrix3d G = stressletGradient(x[i] - x[j], (a[i] * a[i] + a[j] * a[j]) / 10,
                                                     before[j], eta);
                E += 0.5 * (G + G.transpose());
            }
            S[i] = 20.0 / 3 * M_PI * eta * pow(a[i], 3) * E;
        }
    }
    VectorXd twists(6 * n);
    for (size_t i = 0; i < n; i++) {
        LinearFlow total;
        total.velocity = flow.at(x[i]);
        total.gradient = flow.gradient;
        for (size_t j = 0; j < n; j++) {
            if (j == i) continue;
            total.velocity +=
                stressletVelocity(x[i] - x[j], a[i] * a[i] / 6 + a[j] * a[j] / 10, S[j], eta);
            total.gradient += stressletGradient(x[i] - x[j], a[j] * a[j] / 10, S[j], eta);
        }
        twists.segment<6>(6 * i) << total.velocity, total.halfCurl();
    }
    return twists;
}

struct StokesianScene : FlowScene {
    vector<Vector3d> x = {Vector3d(0.3, 0.1, -0.2), Vector3d(2.1, 0.9, 0.5),
                          Vector3d(-0.4, 2.2, 1.4)};
    vector<double> a = {1, 0.8, 0.6};

    explicit StokesianScene(bool lubrication) {
        fluid->setModel(MobilityForce::StokesianDynamics);
        fluid->setLubrication(lubrication);
    }
    void addSpheres() {
        for (size_t i = 0; i < x.size(); i++) add(sphereKind(a[i]), toVec3(x[i]));
    }
};

}  // namespace

TEST(DrivenFlow, SpheresResistStrainByStresslets) {
    const LinearFlow flow = generalFlow();
    for (bool lubrication : {false, true}) {
        StokesianScene scene(lubrication);
        flow.set(*scene.fluid);
        scene.addSpheres();
        scene.start();
        const VectorXd expected = spheresInFlow(scene.x, scene.a, flow, 0.6);
        // The effect of stresslets must be large in this scene, or the test would show little.
        VectorXd carried(18);
        for (int i = 0; i < 3; i++)
            carried.segment<6>(6 * i) << flow.at(scene.x[i]), flow.halfCurl();
        EXPECT_GT((expected - carried).norm(), 0.05 * carried.norm());
        expectNear(scene.stepTwists(), expected, 1e-12);
        // The velocities are also right at the positions after the step.
        const auto places = scene.integrator.getBodyPositions();
        for (int i = 0; i < 3; i++) scene.x[i] = toEigen(places[i]);
        expectNear(scene.stepTwists(), spheresInFlow(scene.x, scene.a, flow, 0.6), 1e-12);
    }
    StokesianScene alone(true);
    flow.set(*alone.fluid);
    alone.x.resize(1);
    alone.addSpheres();
    alone.start();
    VectorXd expected(6);
    expected << flow.at(alone.x[0]), flow.halfCurl();
    expectNear(alone.stepTwists(), expected, 1e-13);
}

TEST(DrivenFlow, TwoSpheresFarApartAreThoseOfBatchelorAndGreen) {
    // J. Fluid Mech. 56, 375 (1972): V = omega x r + E.r - [A nn + B (1 - nn)].E.r with A = 5/r^3 -
    // 8/r^5 + 25/r^6, B = 16/(3 r^5), and then r^-8. If any of the three terms were missing, the
    // rest would fall more slowly.
    SKIP_ON_SINGLE_PRECISION_DEVICES("what is left is 1e-7 of the velocity");
    const LinearFlow flow = generalFlow();
    double left[2][2];
    for (int i : {0, 1}) {
        const double r = i ? 16 : 8;
        StokesianScene scene(true);
        flow.set(*scene.fluid);
        const Vector3d n = Vector3d(2, -1, 2) / 3;
        scene.x = {Vector3d::Zero(), r * n};
        scene.a = {1, 1};
        scene.addSpheres();
        scene.start();
        const VectorXd twists = scene.stepTwists();
        const Vector3d stretched = r * (flow.strain() * n),
                       across = stretched - n * n.dot(stretched);
        const Vector3d lost = r * (flow.gradient * n) - (twists.segment<3>(6) - twists.head<3>());
        left[i][0] =
            lost.dot(n) / stretched.dot(n) - (5 / pow(r, 3) - 8 / pow(r, 5) + 25 / pow(r, 6));
        left[i][1] = lost.dot(across) / across.squaredNorm() - 16 / (3 * pow(r, 5));
        for (double rest : left[i]) EXPECT_LT(abs(rest) * pow(r, 8), 300);
    }
    for (int k : {0, 1}) EXPECT_GT(abs(left[0][k]), 100 * abs(left[1][k]));
}

// ---- Waves in periodic boxes ----

TEST(DrivenFlow, WavesCarryAndTurnParticlesByTheirAverages) {
    for (const ModelCase& model : periodicModels)
        for (int force = 0; force < 3; force++)
            for (int axis = 0; axis < 3; axis++) {
                if (force == axis) continue;
                SCOPED_TRACE(model.name + ", axes " + to_string(force) + " and " + to_string(axis));
                const Wave wave = {0.3, force, axis, 1 + (force + axis) % 2};
                PeriodicScene scene(model);
                wave.set(*scene.fluid);
                scene.add(sphereKind(1.1), Vec3(1, 7.5, -9));
                if (model.model != MobilityForce::StokesianDynamics) {
                    scene.add(sphereKind(0.9), Vec3(4.2, 1, 2));
                    scene.addFree(1, 1.3, Vec3(3, 4.5, 11));
                }
                scene.start();
                expectNear(scene.stepTwists(), scene.waveSlips(wave), 1e-12);
                // The wave follows the box, and its velocity goes as 1/k^2. The stresslets of a
                // sphere's own images cancel if the box is a cube.
                if (model.model == MobilityForce::StokesianDynamics)
                    scene.setBox(9, 9, 9);
                else
                    scene.setBox(7, 8.5, 9);
                expectNear(scene.stepTwists(), scene.waveSlips(wave), 1e-12);
            }
}

TEST(DrivenFlow, MultiblobsInWaves) {
    const Wave wave = {0.2, 2, 0, 1};
    for (const ModelCase& model : periodicModels) {
        if (model.model == MobilityForce::StokesianDynamics) continue;
        SCOPED_TRACE(model.name);
        PeriodicScene scene(model);
        if (model.solver == MobilityForce::MatrixFree) scene.fluid->setSolverTolerance(1e-5);
        wave.set(*scene.fluid);
        scene.add(boomerangKind(), Vec3(7.3, 2, 3), {{0.6, 0, 0.8, 0}});
        scene.add(boomerangKind(), Vec3(3.5, 3, 1), {{0.8, 0.6, 0, 0}});
        scene.start();
        const MatrixXd M = scene.blobMobility();
        MatrixXd K = MatrixXd::Zero(M.rows(), 12);
        int row = 0;
        const auto bodies = scene.labBodies();
        for (int b = 0; b < 2; b++)
            for (const Vector3d& offset : bodies[b].offsets) {
                K.block<3, 3>(row, 6 * b).setIdentity();
                K.block<3, 3>(row, 6 * b + 3) = -cross(offset);
                row += 3;
            }
        const MatrixXd lambda = M.fullPivLu().solve(K);
        const VectorXd expected =
            (K.transpose() * lambda).fullPivLu().solve(lambda.transpose() * scene.waveSlips(wave));
        expectNear(scene.stepTwists(), expected,
                   model.solver == MobilityForce::MatrixFree ? 1e-5 * expected.norm() : 1e-12);
    }
}

TEST(DrivenFlow, WavesInTriclinicBoxes) {
    // In this box every wave along z is periodic, but along x only those of every fourth index.
    for (const Wave& wave : {Wave{0.2, 0, 2, 1}, Wave{0.2, 1, 0, 4}}) {
        PeriodicScene scene(periodicModels[0]);
        wave.set(*scene.fluid);
        scene.add(sphereKind(0.4), Vec3(1.3, 7.5, -2));
        scene.start();
        scene.context->setPeriodicBoxVectors(Vec3(8, 0, 0), Vec3(2, 8, 0), Vec3(-2, 2.5, 9));
        scene.edges = Vector3d(8, 8, 9);
        const VectorXd slips = scene.waveSlips(wave);
        EXPECT_GT(slips.head<3>().norm(), 1e-2);
        expectNear(scene.stepTwists(), slips, 1e-12);
        // An image of the sphere moves with the same velocity.
        scene.pose({Vec3(1.3 - 2 + 2, 7.5 + 2.5 + 8, -2 + 9)}, {{1, 0, 0, 0}});
        expectNear(scene.stepTwists(), slips, 1e-12);
    }
    PeriodicScene scene(periodicModels[0]);
    scene.fluid->setSinusoidalForceDensity(0.2, 1, 0, 1);
    scene.add(sphereKind(0.4), Vec3(1.3, 7.5, -2));
    scene.start();
    scene.context->setPeriodicBoxVectors(Vec3(8, 0, 0), Vec3(2, 8, 0), Vec3(-2, 2.5, 9));
    expectError([&] { scene.integrator.step(1); },
                {"a wave of index 1 along the edge 0 of the box is not periodic along its vector "
                 "(2, 8, 0) nm",
                 "take another wave axis or index, or an orthogonal box"});
}

TEST(DrivenFlow, WavesAlongAChannel) {
    for (auto solver : {MobilityForce::Dense, MobilityForce::MatrixFree})
        for (const Wave& wave : {Wave{0.2, 0, 2, 2}, Wave{-0.1, 2, 0, 1}}) {
            PeriodicScene scene({"", MobilityForce::ForceCoupling, solver});
            scene.fluid->setBoundary(MobilityForce::SlipChannel);
            scene.fluid->setChannelWalls(1, 6.5);
            wave.set(*scene.fluid);
            scene.add(sphereKind(0.8), Vec3(1, 2.2, 8.2));
            scene.addFree(2, 0.5, Vec3(3, 5.2, 4));
            scene.start();
            expectNear(scene.stepTwists(), scene.waveSlips(wave), 1e-12);
        }
}

TEST(DrivenFlow, SpheresResistTheStrainOfWaves) {
    const Wave wave = {0.4, 1, 0, 1};
    PeriodicScene scene(periodicModels[3]);
    wave.set(*scene.fluid);
    const vector<Vec3> start = {Vec3(0.3, 0.1, -0.2), Vec3(2.1, 0.9, 0.5), Vec3(-0.4, 2.2, 1.4)};
    const vector<double> radii = {1, 0.8, 0.6};
    RigidHIPlugin::HydrodynamicParticles particles;
    for (int i = 0; i < 3; i++) {
        scene.add(sphereKind(radii[i]), start[i]);
        particles.add(radii[i], true, i, i);
    }
    scene.start();
    scene.setBox(8, 7.5, 9);
    // The matrix of forces, torques and stresslets is tested elsewhere. Here the effect of strains
    // on it is tested, at the start and at the positions after the step.
    RigidHIPlugin::LatticeSum sum(particles, RigidHIPlugin::overSurfaces(), true);
    sum.setBox({Vec3(8, 0, 0), Vec3(0, 7.5, 0), Vec3(0, 0, 9)});
    for (int step = 0; step < 2; step++) {
        const vector<Vec3> places = scene.integrator.getBodyPositions();
        MatrixXd all;
        sum.compute(places, true, all);
        VectorXd strains(15);
        for (int i = 0; i < 3; i++) {
            const double t = tOf(MobilityForce::StokesianDynamics, radii[i], wave.k(8));
            const Matrix3d E = wave.strain(toEigen(places[i]), 8, 0.6, t);
            for (int a = 0; a < 5; a++) {
                Matrix3d basis;
                for (int k = 0; k < 3; k++)
                    basis.col(k) = RigidHIPlugin::contractBasis(Vector3d::Unit(k)).col(a);
                strains[5 * i + a] = basis.cwiseProduct(E).sum();
            }
        }
        const VectorXd slips = scene.waveSlips(wave),
                       response = all.topRightCorner(18, 15) *
                                  all.bottomRightCorner(15, 15).ldlt().solve(strains);
        EXPECT_GT(response.norm(), 0.02 * slips.norm());
        expectNear(scene.stepTwists(), slips - response, 1e-12);
    }
}

TEST(DrivenFlow, TheMiddleOfALongWaveIsAShear) {
    // The effect of the periodic images of stresslets is of order 1/L^3, that of the curvature of
    // the wave 1/L^2.
    const LinearFlow flow = shear(0.3);
    double errors[2];
    for (int i : {0, 1}) {
        const double edge = i ? 80 : 40;
        StokesianScene scene(true);
        scene.fluid->setBoundary(MobilityForce::Periodic);
        scene.side = edge;
        const double k = 2 * M_PI / edge;
        scene.fluid->setSinusoidalForceDensity(0.3 * 0.6 * k, 0, 1, 1);
        scene.addSpheres();
        scene.start();
        const VectorXd expected = spheresInFlow(scene.x, scene.a, flow, 0.6);
        errors[i] = (scene.stepTwists() - expected).norm() / expected.norm();
    }
    EXPECT_LT(errors[1], 0.01);
    EXPECT_GT(errors[0], 3.5 * errors[1]);
}

// ---- With momenta ----

TEST(DrivenFlow, MomentaGoToThoseOfTheFlow) {
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

TEST(DrivenFlow, MomentaGoWhereStepsWithoutThemDo) {
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

TEST(DrivenFlow, MomentaRelaxExponentially) {
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

TEST(DrivenFlow, OrderOfMomenta) {
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

TEST(DrivenFlow, VelocitiesInShearAreThermalAboutTheFlow) {
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

TEST(DrivenFlow, EquipartitionIsAboutAUniformFlow) {
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

TEST(DrivenFlow, ATrapHoldsWhatAFlowPushes) {
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
    const int steps = 20 / (k * mu * h);  // twenty relaxation times
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

TEST(DrivenFlow, AUniformFlowOnlyShifts) {
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

TEST(DrivenFlow, NoFlowChangesNothing) {
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

TEST(DrivenFlow, ChangesAtOnce) {
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

TEST(DrivenFlow, ResumesBitForBit) {
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

// ---- What is said and refused ----

TEST(DrivenFlow, EffectsNameIt) {
    const auto effect = [](FlowScene& scene) {
        scene.start();
        scene.integrator.step(1);
        return scene.integrator.getEffects().at("driven flow");
    };
    const auto expectWords = [](const string& text, const vector<string>& words) {
        for (const string& piece : words) EXPECT_NE(text.find(piece), string::npos) << text;
    };
    FlowScene none;
    none.addMixture();
    expectWords(effect(none),
                {"off", "neither setBackgroundFlow() nor setSinusoidalForceDensity()"});
    FlowScene linear;
    shear(0.2).set(*linear.fluid);
    linear.addMixture();
    linear.fluid->setBodyMobility(2, rowsOf(tensorWithoutSymmetry(1)));
    expectWords(effect(linear), {"velocity (0, 0, 0) nm/ps at the origin, gradient in rows (0, "
                                 "0.2, 0), (0, 0, 0), (0, 0, 0)/ps",
                                 "multiblobs resist its strain by their blobs",
                                 "tensors of their own resist it as their blobs do"});
    FlowScene draining;
    draining.fluid->setModel(MobilityForce::FreeDraining);
    shear(0.2).set(*draining.fluid);
    draining.add(boomerangKind());
    draining.fluid->setBodyMobility(0, rowsOf(tensorWithoutSymmetry(1)));
    expectWords(effect(draining), {"tensors of their own resist it as their blobs do"});
    StokesianScene spheres(true);
    shear(0.2).set(*spheres.fluid);
    spheres.addSpheres();
    expectWords(effect(spheres),
                {"spheres resist its strain by stresslets, without lubrication of the strain"});
    PeriodicScene periodic(periodicModels[0]);
    Wave{-0.3, 0, 2, 2}.set(*periodic.fluid);
    periodic.add(sphereKind(0.8));
    expectWords(effect(periodic),
                {"force density along x with 4 nm along z", "a flow of up to 0.202"});
}

TEST(DrivenFlow, SettersRefuseWhatIsNoFlow) {
    MobilityForce fluid;
    const double nan = numeric_limits<double>::quiet_NaN();
    expectError([&] { fluid.setBackgroundFlow(Vec3(), vector<double>(8, 0.0)); },
                {"setBackgroundFlow(): the gradient has 8 numbers", "it must be 3 x 3",
                 "give 9 numbers dv_a/dx_b, row after row"});
    expectError([&] { fluid.setBackgroundFlow(Vec3(0, nan, 0), vector<double>(9, 0.0)); },
                {"setBackgroundFlow(): the velocity is ", "give a finite velocity at the origin"});
    expectError(
        [&] {
            fluid.setBackgroundFlow(Vec3(), {0, nan, 0, 0, 0, 0, 0, 0, 0});
        },
        {"setBackgroundFlow(): the gradient has an entry nan", "all entries must be finite"});
    expectError(
        [&] {
            fluid.setBackgroundFlow(Vec3(), {1, 0, 0, 0, 1, 0, 0, 0, 1});
        },
        {"setBackgroundFlow(): the trace of the gradient is 3/ps", "incompressible",
         "correct the diagonal"});
    expectError([&] { fluid.setSinusoidalForceDensity(nan, 0, 1, 1); },
                {"setSinusoidalForceDensity(): f0 is nan kJ/(mol nm^4)",
                 "give a finite force density, or 0 for none"});
    expectError(
        [&] { fluid.setSinusoidalForceDensity(1, 3, 1, 1); },
        {"setSinusoidalForceDensity(): an axis is 3", "it must be 0, 1 or 2, for x, y or z"});
    expectError([&] { fluid.setSinusoidalForceDensity(1, 1, 1, 1); },
                {"setSinusoidalForceDensity(): both axes are 1", "makes pressure and no flow"});
    expectError([&] { fluid.setSinusoidalForceDensity(1, 0, 1, 0); },
                {"setSinusoidalForceDensity(): the wave-vector index is 0",
                 "give the number of periods in the box"});
    Vec3 velocity(1, 1, 1);
    vector<double> gradient;
    fluid.getBackgroundFlow(velocity, gradient);
    EXPECT_EQ(velocity, Vec3());
    EXPECT_EQ(gradient, vector<double>(9, 0.0));
}

TEST(DrivenFlow, BoundariesWithoutItAreRefused) {
    const auto refusal = [](MobilityForce::Model model, MobilityForce::Boundary boundary,
                            const function<void(MobilityForce&)>& set,
                            const vector<string>& words) {
        FlowScene scene;
        scene.fluid->setModel(model);
        scene.fluid->setBoundary(boundary);
        scene.fluid->setChannelWalls(1, 6.5);
        scene.fluid->setWallHeight(0.5);
        scene.add(sphereKind(0.8), Vec3(4, 4, 4));
        set(*scene.fluid);
        expectError([&] { scene.start(); }, words);
        // The flow may not be set in a Context either.
        FlowScene later;
        later.fluid->setModel(model);
        later.fluid->setBoundary(boundary);
        later.fluid->setChannelWalls(1, 6.5);
        later.fluid->setWallHeight(0.5);
        later.add(sphereKind(0.8), Vec3(4, 4, 4));
        later.start();
        const VectorXd before = later.state();
        set(*later.fluid);
        expectError([&] { later.fluid->updateParametersInContext(*later.context); }, words);
        later.integrator.step(1);
        EXPECT_EQ(later.state(), before);
    };
    const auto wave = [](int force, int axis, int index) {
        return
            [=](MobilityForce& fluid) { fluid.setSinusoidalForceDensity(1, force, axis, index); };
    };
    const auto linear = [](const LinearFlow& flow) {
        return [=](MobilityForce& fluid) { flow.set(fluid); };
    };
    const auto RPY = MobilityForce::RotnePragerYamakawa, FCM = MobilityForce::ForceCoupling;
    refusal(RPY, MobilityForce::Unbounded, wave(0, 1, 1),
            {"a sinusoidal force density needs a periodic fluid, and the boundary is Unbounded",
             "f0 = 0"});
    refusal(RPY, MobilityForce::NoSlipWall, wave(0, 1, 1),
            {"needs a periodic fluid, and the boundary is NoSlipWall"});
    for (auto [force, axis] : {pair<int, int>{0, 1}, {1, 0}, {2, 1}, {1, 2}})
        refusal(FCM, MobilityForce::SlipChannel, wave(force, axis, 1),
                {"the sinusoidal force density is along axis " + to_string(force) +
                     " with its wave along axis " + to_string(axis),
                 "a SlipChannel has its walls across axis 1", "give axes 0 and 2"});
    for (auto boundary : {MobilityForce::Periodic, MobilityForce::SlipChannel})
        for (const LinearFlow& flow : {generalFlow(), uniform(Vector3d(0, 0, 1e-9)), shear(1e-9)})
            refusal(FCM, boundary, linear(flow),
                    {"a background flow cannot be used with boundary ",
                     "because the mean velocity of a periodic fluid is 0 and a velocity gradient "
                     "is not periodic"});
    LinearFlow pushesWall = shear(1), slips, along, ofRounding;
    slips.gradient(0, 2) = 0.3;  // 0 at z = 0, and the wall is at 0.5
    along.gradient(0, 0) = 0.1;
    along.gradient(1, 1) = -0.1;
    for (const LinearFlow& flow : {pushesWall, slips, along, uniform(Vector3d(0, 0.1, 0))})
        refusal(RPY, MobilityForce::NoSlipWall, linear(flow),
                {"the background flow is not 0 at the NoSlipWall z = 0.5 nm: component ",
                 "give a flow that depends on z alone and is 0 at the wall"});
}

TEST(DrivenFlow, WavesTooShortForAGridAreRefused) {
    const vector<string> tooShort = {
        "a wave of index 16 along the edge 2 of the box is too short for a grid of 32 nodes",
        "take an index below 16, or a finer grid by setGridSpacing()"};
    for (auto boundary : {MobilityForce::Periodic, MobilityForce::SlipChannel}) {
        const auto prepare = [&](PeriodicScene& scene, int index) {
            scene.fluid->setBoundary(boundary);
            scene.fluid->setChannelWalls(1, 6.5);
            scene.fluid->setGridSpacing(0.25);
            scene.add(sphereKind(0.8), Vec3(4, 4, 4));
            scene.fluid->setSinusoidalForceDensity(1, 0, 2, index);
        };
        PeriodicScene refused(periodicModels[2]), scene(periodicModels[2]);
        prepare(refused, 16);
        expectError([&] { refused.start(); }, tooShort);
        prepare(scene, 15);
        scene.start();
        expectNear(scene.stepTwists(), scene.waveSlips({1, 0, 2, 15}), 1e-12);
        scene.fluid->setSinusoidalForceDensity(1, 0, 2, 16);
        expectError([&] { scene.fluid->updateParametersInContext(*scene.context); }, tooShort);
        // The refused settings have changed nothing.
        expectNear(scene.stepTwists(), scene.waveSlips({1, 0, 2, 15}), 1e-12);
    }
}
