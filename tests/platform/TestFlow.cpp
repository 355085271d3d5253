// The flow of the fluid, as users read it, is compared with Stokes' solution, tracers, and averages
// over particles. Tests of walls, modes, incompressibility and the Brownian stress follow. Further
// tests show which flow is returned when, and that reading the flow changes nothing.

#include <openmm/serialization/XmlSerializer.h>

#include <functional>
#include <sstream>

#include "FlowSupport.h"
#include "openmmrigidhi/CustomBodyForce.h"

using namespace OpenMM;
using namespace RigidHITest;
using RigidHIPlugin::CustomBodyForce;
using namespace std;

namespace {

typedef vector<Vec3> Points;

/** Bodies on which constant forces and torques act, lab frame. */
struct Pushed : PeriodicScene {
    CustomBodyForce* push = nullptr;  // the System's

    explicit Pushed(const ModelCase& model = periodicModels[0], double temperature = 0,
                    double h = 1, RigidHI::Scheme scheme = RigidHI::EulerMaruyama)
        : PeriodicScene(model, temperature, h, scheme) {
        fluid->setBoundary(MobilityForce::Unbounded);
        fluid->setSolverTolerance(1e-10);
    }
    /** @param wrenches  six rows a body */
    void pushBy(const VectorXd& wrenches) {
        if (!push) {
            push = new CustomBodyForce("fx", "fy", "fz", "tx", "ty", "tz");
            for (const char* name : {"fx", "fy", "fz", "tx", "ty", "tz"})
                push->addPerBodyParameter(name);
            for (size_t b = 0; b < bodies.size(); b++) push->addBody(b, vector<double>(6, 0.0));
            system.addForce(push);
        }
        for (int b = 0; b < wrenches.size() / 6; b++)
            push->setBodyParameters(b, b, vector<double>(&wrenches[6 * b], &wrenches[6 * b] + 6));
        if (context) push->updateParametersInContext(*context);
    }
    MatrixXd flow(const Points& points) {
        const Points velocities = fluid->getFlowInContext(*context, points);
        MatrixXd columns(3, velocities.size());
        for (size_t i = 0; i < velocities.size(); i++) columns.col(i) = toEigen(velocities[i]);
        return columns;
    }
    Eigen::Vector2d mode(int force, int wave, int index) {
        const vector<double> amplitudes = fluid->getFlowModeInContext(*context, force, wave, index);
        return Eigen::Vector2d(amplitudes.at(0), amplitudes.at(1));
    }
    Eigen::Vector2d randomMode(int force, int wave, int index) {
        const vector<double> amplitudes =
            fluid->getRandomFlowModeInContext(*context, force, wave, index);
        return Eigen::Vector2d(amplitudes.at(0), amplitudes.at(1));
    }
};

/** Wrenches without symmetry on this number of bodies, with components of about 1. */
VectorXd someWrenches(int bodies, int seed = 5) {
    mt19937 random(seed);
    normal_distribution<double> normal;
    VectorXd wrenches(6 * bodies);
    for (int i = 0; i < wrenches.size(); i++) wrenches[i] = normal(random);
    return wrenches;
}

/** Four blobs that do not touch. */
BodyKind apartKind() {
    return {"apart",
            2,
            Vec3(1.3, 0.7, 1.1),
            {Vec3(0, 0, 0), Vec3(1.3, 0.2, 0), Vec3(0.1, 1.2, -0.3), Vec3(-0.4, 0.2, 1.1)},
            {0.5, 0.4, 0.45, 0.3}};
}

/** Nodes and weights of Gauss-Legendre quadrature on -1..1, or of Gauss-Hermite quadrature for a
 * normal distribution. */
void gauss(int n, bool normal, VectorXd& nodes, VectorXd& weights) {
    MatrixXd J = MatrixXd::Zero(n, n);  // Golub and Welsch
    for (int i = 1; i < n; i++)
        J(i, i - 1) = J(i - 1, i) = normal ? sqrt(i) : i / sqrt(4.0 * i * i - 1);
    Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(J);
    nodes = eigen.eigenvalues();
    weights = eigen.eigenvectors().row(0).cwiseAbs2();
}

/** Points and weights for the average over a particle's envelope, which is its surface or a
 * Gaussian of width a/sqrt(pi). */
struct Envelope {
    Points points;
    vector<double> weights;
    Envelope(MobilityForce::Model model, const Vector3d& centre, double a, int n) {
        VectorXd x, w;
        if (model == MobilityForce::ForceCoupling) {
            gauss(n, true, x, w);
            for (int i = 0; i < n; i++)
                for (int j = 0; j < n; j++)
                    for (int k = 0; k < n; k++)
                        add(centre + a / sqrt(M_PI) * Vector3d(x[i], x[j], x[k]),
                            w[i] * w[j] * w[k]);
            return;
        }
        gauss(n, false, x, w);
        for (int i = 0; i < n; i++)
            for (int j = 0; j < 2 * n; j++) {
                const double phi = M_PI * (j + 0.5) / n, s = sqrt(1 - x[i] * x[i]);
                add(centre + a * Vector3d(s * cos(phi), s * sin(phi), x[i]), w[i] / (2 * n));
            }
    }
    Vector3d average(Pushed& scene) const {
        const MatrixXd flow = scene.flow(points);
        return flow * Eigen::Map<const VectorXd>(weights.data(), weights.size());
    }

private:
    void add(const Vector3d& x, double weight) {
        points.push_back(toVec3(x));
        weights.push_back(weight);
    }
};

/** The largest difference between the average flow over a particle's envelope and the velocity of a
 * rigid motion there. */
double slipOfParticles(Pushed& scene, const vector<LabBody>& bodies, const VectorXd& twists,
                       int n) {
    double largest = 0;
    int row = 0;
    for (const LabBody& body : bodies) {
        for (size_t i = 0; i < body.radii.size(); i++) {
            Vector3d velocity = twists.segment<3>(row);
            if (!body.isFree)
                velocity += Vector3d(twists.segment<3>(row + 3)).cross(body.offsets[i]);
            const Envelope envelope(scene.fluid->getModel(), body.R + body.offsets[i],
                                    body.radii[i], n);
            largest = max(largest, (envelope.average(scene) - velocity).cwiseAbs().maxCoeff());
        }
        row += body.rows();
    }
    return largest;
}

/**
 * The divergence by central differences, and a bound of its error by third derivatives, from
 * differences over twice the step.
 */
double divergenceOfFlow(Pushed& scene, const Vec3& x, double step) {
    double sum = 0;
    for (int k = 0; k < 3; k++) {
        Vec3 d;
        d[k] = step;
        const MatrixXd u = scene.flow({x + d, x - d});
        sum += (u(k, 0) - u(k, 1)) / (2 * step);
    }
    return sum;
}

const ModelCase rotnePrager = periodicModels[0], forceCoupling = periodicModels[1],
                onGrid = periodicModels[2], stokesian = periodicModels[3];

/** The velocity at x, outside or inside of a sphere at the origin with a force and a torque (Stokes
 * 1851, Kirchhoff 1876). */
Vector3d stokes(const Vector3d& x, double a, double eta, const Vector3d& F, const Vector3d& T) {
    const double r = x.norm();
    if (r <= a) return F / (6 * M_PI * eta * a) + T.cross(x) / (8 * M_PI * eta * pow(a, 3));
    const Vector3d n = x / r;
    const double c = a * a / (r * r);
    return ((1 + c / 3) * F + (1 - c) * n * n.dot(F)) / (8 * M_PI * eta * r) +
           T.cross(x) / (8 * M_PI * eta * pow(r, 3));
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
        for (const Vec3& x : points)
            EXPECT_LT(abs(divergenceOfFlow(scene, x, d)), 2e-5 * scale) << what;
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

TEST(Flow, ModesAreThoseOfTheFlowAtPoints) {
    // Sums over n^3 points are exact for a band-limited flow. The flow on a grid is band-limited,
    // because Gaussians are cut off within the tolerance. At the last wave, Gaussians of width
    // a/sqrt(pi) have exp(-(n pi/8)^2 a^2/(2 pi)) left. The flow of surfaces has a kink, so n^-3 is
    // left.
    SKIP_ON_SINGLE_PRECISION_DEVICES("positions are rounded");
    struct Case {
        ModelCase model;
        int points;
        double tolerance;
    };
    for (const Case& c : {Case{rotnePrager, 16, 3e-3}, Case{forceCoupling, 24, 1e-6},
                          Case{onGrid, 24, 1e-6}, Case{stokesian, 16, 3e-3}})
        for (bool noise : {false, true}) {
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
                        Eigen::Vector2d sums(0, 0);
                        for (int p = 0; p < flow.cols(); p++) {
                            const double angle = 2 * M_PI * index / 8 * points[p][wave];
                            sums += 2.0 / flow.cols() * flow(force, p) *
                                    Eigen::Vector2d(sin(angle), cos(angle));
                        }
                        EXPECT_LT((sums - scene.mode(force, wave, index)).cwiseAbs().maxCoeff(),
                                  c.tolerance * scale)
                            << force << wave << index;
                    }
        }
}

TEST(Flow, ModesInChannels) {
    SKIP_ON_SINGLE_PRECISION_DEVICES("positions are rounded");
    for (auto solver : {MobilityForce::Dense, MobilityForce::MatrixFree})
        for (bool noise : {false, true}) {
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
                    Eigen::Vector2d sums(0, 0);
                    for (int p = 0; p < flow.cols(); p++) {
                        const double angle = 2 * M_PI * index / 8 * points[p][wave];
                        sums += 2.0 / flow.cols() * flow(force, p) *
                                Eigen::Vector2d(sin(angle), cos(angle));
                    }
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

// ---- Which flow is answered ----

namespace {

/** A scene whose forces depend on positions and time, so that evaluations can be told apart. */
void addChanging(Pushed& scene) {
    scene.add(apartKind(), Vec3(1, 1, 2.5), {{0.8, 0.6, 0, 0}});
    scene.add(sphereKind(0.6), Vec3(3.5, 2, 1.5));
    scene.addFree(1, 0.5, Vec3(2, 4, 3));
    auto* force = new CustomBodyForce("x*cos(t)", "0.2*z", "1+0.3*y", "q1*q0", "x+t", "-0.4");
    for (int b : {0, 1}) force->addBody(b, {});
    scene.system.addForce(force);
}

const Points somewhere = {Vec3(2, 3, 2), Vec3(4.2, 2, 0.4), Vec3(1.9, 1.1, 3.1), Vec3(1.1, 1, 2.4)};

vector<RigidHI::Scheme> allWithFluid() {
    vector<RigidHI::Scheme> schemes = {RigidHI::LangevinHI};
    for (const SchemeTraits& traits : overdampedSchemes()) schemes.push_back(traits.scheme);
    return schemes;
}

/** The flow of the present forces at the poses of a scene, computed in a new scene that has made no
 * step. */
MatrixXd flowOfForces(
    Pushed& scene, const ModelCase& model, MobilityForce::Boundary boundary,
    const function<void(Pushed&)>& prepare = [](Pushed&) {}) {
    Pushed fresh(model);
    fresh.fluid->setBoundary(boundary);
    addChanging(fresh);
    fresh.fluid->setViscosity(scene.fluid->getViscosity());
    prepare(fresh);
    fresh.start();
    Vec3 a, b, c;
    scene.context->getState(0).getPeriodicBoxVectors(a, b, c);
    fresh.context->setPeriodicBoxVectors(a, b, c);
    fresh.context->setPositions(positionsOf(*scene.context));
    fresh.context->setTime(scene.context->getTime());
    fresh.pose(scene.integrator.getBodyPositions(), scene.integrator.getBodyOrientations());
    return fresh.flow(somewhere);
}

}  // namespace

TEST(Flow, IsThatOfForcesBeforeAStepAndAfterChanges) {
    SKIP_ON_SINGLE_PRECISION_DEVICES("positions are rounded");
    for (const SchemeTraits& traits : overdampedSchemes())
        for (auto boundary : {MobilityForce::Unbounded, MobilityForce::Periodic}) {
            SCOPED_TRACE(traits.name);
            Pushed scene(rotnePrager, T1, 1e-3, traits.scheme);
            scene.fluid->setBoundary(boundary);
            addChanging(scene);
            scene.start();
            const auto expectOfForces = [&](const string& when) {
                const MatrixXd expected = flowOfForces(scene, rotnePrager, boundary);
                EXPECT_LT((scene.flow(somewhere) - expected).cwiseAbs().maxCoeff(), 1e-11) << when;
                EXPECT_GT(expected.norm(), 0.1);
            };
            const auto expectOfStep = [&](const string& when) {
                const MatrixXd found = scene.flow(somewhere);
                EXPECT_GT((found - flowOfForces(scene, rotnePrager, boundary)).norm(), 1)
                    << when;  // noise of h^-1/2
                EXPECT_EQ(scene.flow(somewhere), found);
            };
            expectOfForces("before a step");
            scene.integrator.step(1);
            expectOfStep("after a step");
            scene.context->setTime(7);
            expectOfStep("after setTime()");
            auto R = scene.integrator.getBodyPositions();
            R[1] += Vec3(0, 0.1, 0);
            scene.integrator.setBodyPositions(R);
            expectOfForces("after setBodyPositions()");
            scene.integrator.step(1);
            expectOfStep("after another step");
            auto q = scene.integrator.getBodyOrientations();
            q[0] = product({{0.8, 0, 0.6, 0}}, q[0]);
            scene.integrator.setBodyOrientations(q);
            expectOfForces("after setBodyOrientations()");
            scene.integrator.step(1);
            auto x = positionsOf(*scene.context);
            x[scene.freeParticles[0]] += Vec3(0.1, 0, 0);
            scene.context->setPositions(x);
            expectOfForces("after setPositions()");
            scene.integrator.step(1);
            scene.fluid->setViscosity(0.7);
            scene.fluid->updateParametersInContext(*scene.context);
            expectOfForces("after updateParametersInContext()");
            scene.integrator.step(1);
            expectOfStep("with another viscosity");
            if (boundary != MobilityForce::Periodic) continue;
            scene.setBox(8.0001, 8, 8);
            expectOfForces("after a small change of the box");
            scene.setBox(8, 8, 8);
            expectOfStep("in the old box again");
            scene.setBox(8.5, 8, 8.2);
            expectOfForces("after a change of the box");
            scene.integrator.step(1);
            expectOfStep("in the new box");
        }
}

TEST(Flow, OfAStepDoesNotDependOnWhenOneAsks) {
    SKIP_ON_SINGLE_PRECISION_DEVICES("forces are rounded");
    const int steps = 4;
    for (auto scheme : allWithFluid())
        for (auto solver : {MobilityForce::Dense, MobilityForce::MatrixFree})
            for (int threads : {1, 2}) {
                SCOPED_TRACE(traitsOf(scheme).name);
                const auto make = [&](int threadCount) {
                    auto scene = make_unique<Pushed>(
                        ModelCase{"", MobilityForce::RotnePragerYamakawa, solver}, T1, 5e-3,
                        scheme);
                    scene->fluid->setSolverTolerance(1e-3);
                    generalFlow().set(*scene->fluid);
                    addChanging(*scene);
                    scene->FluidScene::start(testPlatform(), threadCount);
                    return scene;
                };
                const auto asking = make(threads), silent = make(1);
                MatrixXd found;
                asking->flow(somewhere);
                for (int i = 0; i < steps; i++) {
                    asking->integrator.step(1);
                    found = asking->flow(somewhere);
                    EXPECT_EQ(found, asking->flow(somewhere));
                }
                silent->integrator.step(steps);
                EXPECT_EQ(asking->state(), silent->state());
                EXPECT_EQ(silent->flow(somewhere), found);
                silent->integrator.step(1);
                asking->integrator.step(1);
                EXPECT_EQ(asking->state(), silent->state());
            }
}

/** The forces on the blobs of bodies with tensors of their own come from iterations, whose
 * tolerance other questions change. */
TEST(Flow, OfAStepDoesNotDependOnWhatElseOneAsks) {
    SKIP_ON_SINGLE_PRECISION_DEVICES("forces are rounded");
    for (auto scheme : {RigidHI::RandomFiniteDifference, RigidHI::DriftCorrectorRFD}) {
        Pushed scene({"", MobilityForce::RotnePragerYamakawa, MobilityForce::MatrixFree}, T1, 5e-3,
                     scheme);
        scene.fluid->setSolverTolerance(1e-3);
        addChanging(scene);
        scene.fluid->setBodyMobility(0, rowsOf(tensorWithoutSymmetry(0)));
        scene.start();
        scene.integrator.step(1);
        const MatrixXd found = scene.flow(somewhere);
        scene.mobility();
        EXPECT_EQ(scene.flow(somewhere), found) << traitsOf(scheme).name;
    }
}

TEST(Flow, OfAStepThatWasRedoneIsThatOfWhatWasAccepted) {
    SKIP_ON_SINGLE_PRECISION_DEVICES("differences of positions are rounded");
    for (const SchemeTraits& traits : overdampedSchemes()) {
        SCOPED_TRACE(traits.name);
        const auto make = [&] {
            auto scene = make_unique<Pushed>(rotnePrager, T1, 0.05, traits.scheme);
            scene->fluid->setBoundary(MobilityForce::NoSlipWall);
            for (int b = 0; b < 3; b++) scene->add(sphereKind(0.6), Vec3(1.5 * b, 0.1 * b, 0.65));
            scene->start();
            return scene;
        };
        const auto asking = make(), silent = make();
        int redone = 0;
        for (int i = 0; i < 40 && redone < 3; i++) {
            const int before = asking->integrator.getNumRejectedSteps();
            const auto bodies = asking->labBodies();
            const VectorXd twists = asking->stepTwists();
            silent->integrator.step(1);
            EXPECT_EQ(asking->state(), silent->state());
            if (asking->integrator.getNumRejectedSteps() == before) continue;
            redone++;
            const MatrixXd found = asking->flow(somewhere);
            EXPECT_EQ(found, silent->flow(somewhere));
            // The flow of this scheme belongs to one set of poses.
            if (traits.scheme == RigidHI::EulerMaruyama) {
                EXPECT_LT(slipOfParticles(*asking, bodies, twists, 16),
                          1e-5 * twists.cwiseAbs().maxCoeff());
            }
        }
        EXPECT_EQ(redone, 3);
    }
}

TEST(Flow, WithMomentaIsThatOfTheFriction) {
    SKIP_ON_SINGLE_PRECISION_DEVICES("positions are rounded");
    const double a = 0.8, eta = 0.6, h = 1e-3;
    const LinearFlow flow = generalFlow();
    const Vector3d centre(1, -2, 0.5), V(1, 2, -0.5), omega(0.3, -1, 2);
    {
        Pushed scene(rotnePrager, 0, h, RigidHI::LangevinHI);
        flow.set(*scene.fluid);
        scene.add(sphereKind(a), toVec3(centre));
        scene.start();
        scene.integrator.setBodyVelocities({toVec3(V)});
        scene.integrator.setBodyAngularVelocities({toVec3(omega)});
        const Vector3d F = 6 * M_PI * eta * a * (V - flow.at(centre)),
                       T = 8 * M_PI * eta * pow(a, 3) * (omega - flow.halfCurl());
        for (const Vector3d& d : {Vector3d(0.1, 0.2, 0.3), Vector3d(2, -1, 1)})
            expectNear(scene.flow({toVec3(centre + d)}),
                       flow.at(centre + d) + stokes(d, a, eta, F, T), 1e-13);
    }
    const ModelCase matrixFree = {"RotnePragerYamakawa, matrix-free",
                                  MobilityForce::RotnePragerYamakawa, MobilityForce::MatrixFree};
    for (const ModelCase& model : {rotnePrager, matrixFree})
        for (auto boundary : {MobilityForce::Unbounded, MobilityForce::NoSlipWall}) {
            Pushed scene(model, T1, h, RigidHI::LangevinHI);
            scene.fluid->setBoundary(boundary);
            if (boundary == MobilityForce::NoSlipWall)
                scene.fluid->setBackgroundFlow(Vec3(), {0, 0, 0.2, 0, 0, -0.3, 0, 0, 0});
            else
                flow.set(*scene.fluid);
            addChanging(scene);
            scene.start();
            for (int asked : {0, 1}) {
                scene.integrator.step(5 * asked);
                const VectorXd twists = scene.twists();
                EXPECT_LT(slipOfParticles(scene, scene.labBodies(), twists, 16),
                          1e-7 * (0.1 + twists.cwiseAbs().maxCoeff()));
            }
        }
}

// ---- Saved and loaded ----

namespace {

unique_ptr<Pushed> savedScene(RigidHI::Scheme scheme, MobilityForce::Solver solver, int threads,
                              double viscosity = 0.6) {
    auto scene = make_unique<Pushed>(ModelCase{"", MobilityForce::RotnePragerYamakawa, solver}, T1,
                                     5e-3, scheme);
    scene->fluid->setSolverTolerance(1e-4);
    scene->fluid->setViscosity(viscosity);
    generalFlow().set(*scene->fluid);
    addChanging(*scene);
    scene->FluidScene::start(testPlatform(), threads);
    return scene;
}

string replaced(const string& text, const string& from, const string& to, size_t after = 0) {
    const size_t at = text.find(from, after);
    if (at == string::npos) throw OpenMMException("there is no " + from);
    return text.substr(0, at) + to + text.substr(at + from.size());
}

}  // namespace

TEST(Flow, IsSaved) {
    SKIP_ON_DEVICES("runs resume to rounding there");
    for (auto scheme : allWithFluid())
        for (auto solver : {MobilityForce::Dense, MobilityForce::MatrixFree}) {
            SCOPED_TRACE(traitsOf(scheme).name);
            const auto scene = savedScene(scheme, solver, 1),
                       second = savedScene(scheme, solver, 2),
                       third = savedScene(scheme, solver, 1);
            scene->integrator.step(3);
            stringstream checkpoint, xml;
            saveState(*scene->context, checkpoint, xml);
            const MatrixXd expected = scene->flow(somewhere);
            second->context->loadCheckpoint(checkpoint);
            EXPECT_EQ(second->flow(somewhere), expected);
            third->integrator.step(1);
            loadState(*third->context, xml);
            EXPECT_EQ(third->flow(somewhere), expected);
            // Asking for the flow has changed nothing else.
            scene->integrator.step(2);
            second->integrator.step(2);
            third->integrator.step(2);
            EXPECT_EQ(second->state(), scene->state());
            EXPECT_EQ(third->state(), scene->state());
            EXPECT_EQ(third->flow(somewhere), scene->flow(somewhere));
        }
}

TEST(Flow, IsSavedForOtherPlatforms) {
    SKIP_ON_SINGLE_PRECISION_DEVICES("forces are rounded");
    Platform& other = platform(testPlatformName() == "CPU" ? "Reference" : "CPU");
    for (auto scheme : allWithFluid()) {
        SCOPED_TRACE(traitsOf(scheme).name);
        const auto scene = savedScene(scheme, MobilityForce::Dense, 1);
        scene->integrator.step(2);
        stringstream checkpoint, xml;
        saveState(*scene->context, checkpoint, xml);
        Pushed there(rotnePrager, T1, 5e-3, scheme);
        generalFlow().set(*there.fluid);
        addChanging(there);
        there.FluidScene::start(other);
        loadState(*there.context, xml);
        // Random finite differences over 1e-5 of lengths magnify rounding.
        EXPECT_LT((there.flow(somewhere) - scene->flow(somewhere)).cwiseAbs().maxCoeff(), 1e-6);
    }
}

TEST(Flow, OfAStateOfAnotherFluidIsThatOfForces) {
    SKIP_ON_SINGLE_PRECISION_DEVICES("positions are rounded");
    for (auto scheme :
         {RigidHI::EulerMaruyama, RigidHI::DriftCorrectorFD, RigidHI::TrapezoidalSlip}) {
        const auto scene = savedScene(scheme, MobilityForce::Dense, 1),
                   thicker = savedScene(scheme, MobilityForce::Dense, 1, 0.9);
        scene->integrator.step(2);
        stringstream checkpoint, xml;
        saveState(*scene->context, checkpoint, xml);
        loadState(*thicker->context, xml);
        const MatrixXd expected =
            flowOfForces(*thicker, rotnePrager, MobilityForce::Unbounded,
                         [](Pushed& fresh) { generalFlow().set(*fresh.fluid); });
        EXPECT_LT((thicker->flow(somewhere) - expected).cwiseAbs().maxCoeff(), 1e-11);
    }
}

TEST(Flow, DamagedLastStepsAreRefused) {
    SKIP_ON_SINGLE_PRECISION_DEVICES("states hold more there");
    const auto scheme = RigidHI::FixmanMidpoint;
    const auto scene = savedScene(scheme, MobilityForce::Dense, 1);
    scene->integrator.step(2);
    stringstream checkpoint, file;
    saveState(*scene->context, checkpoint, file);
    const string xml = file.str();
    const size_t at = xml.find("<LastStep");
    ASSERT_NE(at, string::npos);
    const auto other = savedScene(scheme, MobilityForce::Dense, 1);
    other->integrator.step(1);
    const auto load = [&](const string& text) {
        stringstream stream(text);
        loadState(*other->context, stream);
    };
    const vector<string> words = {
        "the saved state's last step of scheme FixmanMidpoint is damaged, or belongs to other "
        "bodies",
        "load the state into an integrator with the same bodies and groups"};
    // The record has groups twice, a negative step size, or numbers of rows and columns that do not
    // fit.
    const size_t group = xml.find("<Group", at), end = xml.find("</LastStep>", at);
    ASSERT_TRUE(group != string::npos && end != string::npos);
    const string groups = xml.substr(group, end - group);
    expectError([&] { load(xml.substr(0, end) + groups + xml.substr(end)); }, words);
    expectError([&] { load(replaced(xml, "value=\"", "value=\"-", at)); }, words);  // the step
    expectError([&] { load(replaced(xml, "rows=\"18\"", "rows=\"17\"", at)); },
                {"property 'rows' is '17'",
                 "it must be the number of values divided by the number of columns"});
    expectError(
        [&] {
            load(replaced(xml, "<Vectors columns=\"1\" rows=\"15\"",
                          "<Vectors columns=\"15\" rows=\"1\"", at));
        },
        words);
    // A quaternion of another length.
    const size_t poses = xml.find("rows=\"7\"", at);
    size_t number = poses;
    for (int i = 0; i < 4; i++) number = xml.find("value=\"", number + 1);
    expectError([&] { load(xml.substr(0, number) + "value=\"3" + xml.substr(number + 7)); }, words);
    // A State without a last step, as earlier versions saved it, gives the flow of the present
    // forces.
    load(xml.substr(0, at) + xml.substr(end + string("</LastStep>").size()));
    const MatrixXd expected = flowOfForces(*other, rotnePrager, MobilityForce::Unbounded,
                                           [](Pushed& fresh) { generalFlow().set(*fresh.fluid); });
    EXPECT_LT((other->flow(somewhere) - expected).cwiseAbs().maxCoeff(), 1e-11);
    other->integrator.step(1);
    scene->integrator.step(1);
    EXPECT_EQ(other->state(), scene->state());
    // The last step of another scheme is not used.
    const auto euler = savedScene(RigidHI::EulerMaruyama, MobilityForce::Dense, 1);
    stringstream whole(xml);
    loadState(*euler->context, whole);
    EXPECT_LT((euler->flow(somewhere) - expected).cwiseAbs().maxCoeff(), 1e-11);
}

/**
 * A step that fails leaves poses, time and the last step as they were, at whichever stage it fails.
 * The last step belongs to its scheme: another scheme has none, and has none after loading either.
 */
TEST(Flow, OfALastStepOutlivesAStepThatFails) {
    SKIP_ON_SINGLE_PRECISION_DEVICES("positions are rounded");
    VectorXd forces = someWrenches(7).head(12), torques = forces;
    for (int b = 0; b < 2; b++) forces.segment<3>(6 * b + 3).setZero();
    for (const SchemeTraits& first : overdampedSchemes())
        for (const SchemeTraits& second : overdampedSchemes()) {
            SCOPED_TRACE(string(first.name) + ", then " + second.name);
            const auto make = [&](RigidHI::Scheme scheme) {
                auto scene = make_unique<Pushed>(rotnePrager, T1, 5e-3, scheme);
                scene->add(rodKind(), Vec3(1, -0.5, 1));
                scene->add(sphereKind(0.6), Vec3(3.5, 2, 1.5));
                scene->pushBy(forces);
                scene->start();
                return scene;
            };
            const auto scene = make(first.scheme);
            scene->integrator.step(2);
            const MatrixXd found = scene->flow(somewhere);
            const VectorXd state = scene->state();
            scene->integrator.setScheme(second.scheme);
            scene->pushBy(torques);
            expectError([&] { scene->integrator.step(1); }, {"acts about the line"});
            scene->pushBy(forces);
            EXPECT_EQ(scene->state(), state);
            stringstream checkpoint, xml;
            saveState(*scene->context, checkpoint, xml);
            const auto other = make(second.scheme);
            other->integrator.step(1);
            loadState(*other->context, xml);
            const MatrixXd now = scene->flow(somewhere);
            EXPECT_LT((other->flow(somewhere) - now).cwiseAbs().maxCoeff(), 1e-12);
            if (first.scheme == second.scheme)
                EXPECT_EQ(now, found);
            else
                EXPECT_NE(now, found);
            for (Pushed* each : {scene.get(), other.get()}) {
                each->integrator.setScheme(first.scheme);
                EXPECT_EQ(each->flow(somewhere), found);
            }
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

}  // namespace

TEST(Flow, HasTheBrownianStress) {
    SKIP_ON_DEVICES("thousands of steps that copy positions");
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
        for (auto [scheme, scaling] : schemesWithDrift()) {
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
        scene->side = 5;
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
    checkBrownianStressOnAGrid({RigidHI::TrapezoidalSlip}, 600);
}

/**
 * In drift correctors nu times the random field varies more, so that their mean needs more steps.
 * On a grid they do the same as the scheme with random differences.
 */
TEST(Flow, FullOnAGridHasTheBrownianStressOfOthers) {
    SKIP_ON_DEVICES("thousands of steps that copy positions");
    checkBrownianStressOnAGrid({RigidHI::RandomFiniteDifference}, 700);
    checkBrownianStressOnAGrid({RigidHI::DriftCorrectorFD}, 4500);
}
