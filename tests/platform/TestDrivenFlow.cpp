// The motion of bodies in flows that users drive is compared with closed forms, and with a second
// implementation of rigid multiblobs and of spheres with stresslets. TestDrivenFlowInTime.cpp tests
// their motion over time.

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
    using Complex = complex<double>;
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
    // Without lubrication, whose strain is tested in unit/TestStokesianDynamics.cpp.
    StokesianScene scene(false);
    flow.set(*scene.fluid);
    scene.addSpheres();
    scene.start();
    const VectorXd expected = spheresInFlow(scene.x, scene.a, flow, 0.6);
    // The effect of stresslets must be large in this scene, or the test would show little.
    VectorXd carried(18);
    for (int i = 0; i < 3; i++) carried.segment<6>(6 * i) << flow.at(scene.x[i]), flow.halfCurl();
    EXPECT_GT((expected - carried).norm(), 0.05 * carried.norm());
    expectNear(scene.stepTwists(), expected, 1e-12);
    // The velocities are also right at the positions after the step.
    const auto places = scene.integrator.getBodyPositions();
    for (int i = 0; i < 3; i++) scene.x[i] = toEigen(places[i]);
    expectNear(scene.stepTwists(), spheresInFlow(scene.x, scene.a, flow, 0.6), 1e-12);
    StokesianScene alone(true);
    flow.set(*alone.fluid);
    alone.x.resize(1);
    alone.addSpheres();
    alone.start();
    VectorXd ofAlone(6);
    ofAlone << flow.at(alone.x[0]), flow.halfCurl();
    expectNear(alone.stepTwists(), ofAlone, 1e-13);
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
    expectWords(effect(spheres), {"spheres resist its strain by stresslets and lubrication"});
    StokesianScene unlubricated(false);
    shear(0.2).set(*unlubricated.fluid);
    unlubricated.addSpheres();
    expectWords(effect(unlubricated),
                {"spheres resist its strain by stresslets, without lubrication"});
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
    expectError(
        [&] { fluid.setBackgroundFlow(Vec3(0, nan, 0), vector<double>(9, 0.0)); },
        {"setBackgroundFlow(): the velocity at the origin is ", " nm/ps; it must be finite"});
    expectError(
        [&] {
            fluid.setBackgroundFlow(Vec3(), {0, nan, 0, 0, 0, 0, 0, 0, 0});
        },
        {"setBackgroundFlow(): the gradient has an entry nan", "all entries must be finite"});
    expectError(
        [&] {
            fluid.setBackgroundFlow(Vec3(), {1, 0, 0, 0, 1, 0, 0, 0, 1});
        },
        {"setBackgroundFlow(): the trace of the gradient is 3/ps; it must be 0 within 1e-12 of the "
         "largest entry of the gradient, since the fluid is incompressible",
         "correct the diagonal"});
    expectError([&] { fluid.setSinusoidalForceDensity(nan, 0, 1, 1); },
                {"setSinusoidalForceDensity(): f0 is nan kJ/(mol nm^4)",
                 "give a finite force density, or 0 for none"});
    expectError([&] { fluid.setSinusoidalForceDensity(1, 3, 1, 1); },
                {"setSinusoidalForceDensity(): an axis is 3; it must be 0, 1 or 2, for x, y or z"});
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
                 "a SlipChannel has its walls across axis 1; both must be along the walls: give "
                 "axes 0 and 2"});
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
