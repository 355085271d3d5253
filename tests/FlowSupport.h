#ifndef RIGIDHI_FLOW_SUPPORT_H_
#define RIGIDHI_FLOW_SUPPORT_H_

// Scenes of bodies in flows that users drive and in periodic fluids, for tests of the motion of
// bodies in flows, and of the effect of bodies on flows.

#include <openmm/CustomExternalForce.h>

#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "HydrodynamicSupport.h"
#include "openmmrigidhi/SchemeTraits.h"

namespace RigidHITest {

using RigidHIPlugin::schemeTable;
using RigidHIPlugin::SchemeTraits;
using RigidHIPlugin::traitsOf;

using RigidHI = CustomRigidHIIntegrator;

inline std::vector<SchemeTraits> overdampedSchemes() {
    std::vector<SchemeTraits> found;
    for (const SchemeTraits& traits : schemeTable)
        if (traits.isOverdamped()) found.push_back(traits);
    return found;
}

/** v(x) = velocity + gradient x. */
struct LinearFlow {
    Vector3d velocity = Vector3d::Zero();
    Matrix3d gradient = Matrix3d::Zero();

    Vector3d at(const Vector3d& x) const { return velocity + gradient * x; }
    Vector3d halfCurl() const {
        const Matrix3d& g = gradient;
        return 0.5 * Vector3d(g(2, 1) - g(1, 2), g(0, 2) - g(2, 0), g(1, 0) - g(0, 1));
    }
    Matrix3d strain() const { return 0.5 * (gradient + gradient.transpose()); }
    void set(MobilityForce& fluid) const {
        fluid.setBackgroundFlow(toVec3(velocity), rowsOf(gradient));
    }
};

/** A flow with rotation, strain and a velocity, none of them along an axis. */
inline LinearFlow generalFlow() {
    LinearFlow flow;
    flow.velocity << 0.3, -0.2, 0.1;
    flow.gradient << 0.05, 0.21, -0.13, -0.08, 0.04, 0.17, 0.11, -0.02, -0.09;
    return flow;
}
inline LinearFlow shear(double rate) {
    LinearFlow flow;
    flow.gradient(0, 1) = rate;
    return flow;
}
inline LinearFlow uniform(const Vector3d& velocity) {
    LinearFlow flow;
    flow.velocity = velocity;
    return flow;
}

/** The flow of a force density f0 sin(k x_wave) along another axis, in a box with a given edge
 * along x_wave. The averages over particles have the factors s and t. */
struct Wave {
    double f0;
    int force, wave, index;

    double k(double edge) const { return 2 * M_PI * index / edge; }
    Vector3d at(const Vector3d& x, double edge, double eta, double s) const {
        return s * f0 / (eta * std::pow(k(edge), 2)) * sin(k(edge) * x[wave]) *
               Vector3d::Unit(force);
    }
    Vector3d halfCurl(const Vector3d& x, double edge, double eta, double t) const {
        return t * f0 / (2 * eta * k(edge)) * cos(k(edge) * x[wave]) *
               Vector3d::Unit(wave).cross(Vector3d::Unit(force));
    }
    Matrix3d strain(const Vector3d& x, double edge, double eta, double t) const {
        const Matrix3d one = Vector3d::Unit(force) * Vector3d::Unit(wave).transpose();
        return t * f0 / (2 * eta * k(edge)) * cos(k(edge) * x[wave]) * (one + one.transpose());
    }
    void set(MobilityForce& fluid) const {
        fluid.setSinusoidalForceDensity(f0, force, wave, index);
    }
};

/** The factors s(k) and t(k) are the averages over the surface and over the ball's dipole, or over
 * Gaussians (Lomholt and Maxey 2003). */
inline double sOf(MobilityForce::Model model, double a, double k) {
    const double x = k * a;
    return model == MobilityForce::ForceCoupling ? std::exp(-x * x / (2 * M_PI)) : sin(x) / x;
}
inline double tOf(MobilityForce::Model model, double a, double k) {
    const double x = k * a;
    return model == MobilityForce::ForceCoupling
               ? std::exp(-x * x / (2 * std::pow(6 * sqrt(M_PI), 2.0 / 3)))
               : 3 * (sin(x) - x * cos(x)) / (x * x * x);
}

/**
 * Bodies and free particles; the displacement in a step gives their velocities. Without noise, a
 * step with one evaluation is exact for any step size.
 */
struct FlowScene : FluidScene {
    explicit FlowScene(double temperature = 0, double h = 1,
                       RigidHI::Scheme scheme = RigidHI::EulerMaruyama)
        : FluidScene(temperature, h) {
        integrator.setScheme(scheme);
    }
    void addField(const std::string& energy) {
        auto* field = new OpenMM::CustomExternalForce(energy);
        for (int i = 0; i < system.getNumParticles(); i++)
            field->addParticle(i, std::vector<double>());
        system.addForce(field);
    }
    /** Adds a sphere, a sphere off its body's origin, a multiblob, a rod and a free particle. */
    void addMixture() {
        std::mt19937 random(3);
        add(sphereKind(0.7), Vec3(3, 0.5, 3.5), randomQuaternion(random));
        BodyKind eccentric = sphereKind(0.8);
        eccentric.sites[0] = Vec3(0.1, 0.3, -0.2);
        add(eccentric, Vec3(0.3, 3.6, 4.5), randomQuaternion(random));
        add(boomerangKind(), Vec3(-0.2, 0.1, 4), randomQuaternion(random));
        add(rodKind(), Vec3(0.5, -3, 5), randomQuaternion(random));
        addFree(1, 0.5, Vec3(-2.5, 1, 4));
    }
    /** The slips (surface velocities) of all particles that the fluid sees, in the order of
     * labBodies(). */
    VectorXd slips(const LinearFlow& flow) {
        std::vector<double> rows;
        for (const LabBody& body : labBodies())
            for (const Vector3d& offset : body.offsets) {
                const Vector3d v = flow.at(body.R + offset), omega = flow.halfCurl();
                rows.insert(rows.end(), v.data(), v.data() + 3);
                if (body.isSphere()) rows.insert(rows.end(), omega.data(), omega.data() + 3);
            }
        return Eigen::Map<VectorXd>(rows.data(), rows.size());
    }
    /**
     * The velocities and angular velocities with which a step moved bodies: 6 rows for each body,
     * then 3 for each free particle.
     */
    VectorXd stepTwists() {
        const double h = integrator.getStepSize();
        const auto R = integrator.getBodyPositions();
        const auto q = integrator.getBodyOrientations();
        const auto x = positionsOf(*context);
        integrator.step(1);
        const auto R2 = integrator.getBodyPositions();
        const auto q2 = integrator.getBodyOrientations();
        const auto x2 = positionsOf(*context);
        std::vector<Vec3> rows;
        for (size_t b = 0; b < R.size(); b++) {
            rows.push_back((R2[b] - R[b]) / h);
            const Eigen::AngleAxisd turn(
                Matrix3d(rotationOf(q2[b]) * rotationOf(q[b]).transpose()));
            rows.push_back(toVec3(turn.angle() / h * turn.axis()));
        }
        for (int p : freeParticles)
            if (fluid->getParticleRadius(p) > 0) rows.push_back((x2[p] - x[p]) / h);
        VectorXd twists(3 * rows.size());
        for (size_t i = 0; i < rows.size(); i++) twists.segment<3>(3 * i) = toEigen(rows[i]);
        return twists;
    }
    /** The velocities and angular velocities of the bodies, in the same order. */
    VectorXd twists() {
        const auto V = integrator.getBodyVelocities(),
                   omega = integrator.getBodyAngularVelocities(), v = velocitiesOf(*context);
        VectorXd all(6 * V.size() + 3 * freeParticles.size());
        for (size_t b = 0; b < V.size(); b++)
            all.segment<6>(6 * b) << toEigen(V[b]), toEigen(omega[b]);
        for (size_t i = 0; i < freeParticles.size(); i++)
            all.segment<3>(6 * V.size() + 3 * i) = toEigen(v[freeParticles[i]]);
        return all;
    }
    void start() { FluidScene::start(testPlatform()); }
};

/** Expects equality within the precision of positions of about 10 nm on this platform, over a step
 * of 1 ps. */
inline void expectNear(const VectorXd& found, const VectorXd& expected, double tolerance,
                       const std::string& what = "") {
    ASSERT_EQ(found.size(), expected.size()) << what;
    EXPECT_LE((found - expected).cwiseAbs().maxCoeff(), readTolerance(tolerance, 10))
        << what << "\nfound    " << found.transpose() << "\nexpected " << expected.transpose();
}

struct ModelCase {
    std::string name;
    MobilityForce::Model model;
    MobilityForce::Solver solver;
};
inline const std::vector<ModelCase> periodicModels = {
    {"RotnePragerYamakawa", MobilityForce::RotnePragerYamakawa, MobilityForce::Dense},
    {"ForceCoupling", MobilityForce::ForceCoupling, MobilityForce::Dense},
    {"ForceCoupling on a grid", MobilityForce::ForceCoupling, MobilityForce::MatrixFree},
    {"StokesianDynamics", MobilityForce::StokesianDynamics, MobilityForce::Dense}};

struct PeriodicScene : FlowScene {
    Vector3d edges = Vector3d(8, 8, 8);
    explicit PeriodicScene(const ModelCase& model, double temperature = 0, double h = 1,
                           RigidHI::Scheme scheme = RigidHI::EulerMaruyama)
        : FlowScene(temperature, h, scheme) {
        fluid->setBoundary(MobilityForce::Periodic);
        fluid->setModel(model.model);
        fluid->setSolver(model.solver);
        fluid->setSolverTolerance(1e-6);
        side = 8;
    }
    void setBox(double x, double y, double z) {
        edges = Vector3d(x, y, z);
        context->setPeriodicBoxVectors(Vec3(x, 0, 0), Vec3(0, y, 0), Vec3(0, 0, z));
    }
    /** Slips of all particles, in the order of labBodies(). */
    VectorXd waveSlips(const Wave& wave) {
        const double edge = edges[wave.wave], eta = fluid->getViscosity();
        std::vector<double> rows;
        for (const LabBody& body : labBodies())
            for (size_t i = 0; i < body.radii.size(); i++) {
                const Vector3d x = body.R + body.offsets[i];
                const double k = wave.k(edge), a = body.radii[i];
                const Vector3d v = wave.at(x, edge, eta, sOf(fluid->getModel(), a, k));
                const Vector3d omega = wave.halfCurl(x, edge, eta, tOf(fluid->getModel(), a, k));
                rows.insert(rows.end(), v.data(), v.data() + 3);
                if (body.isSphere()) rows.insert(rows.end(), omega.data(), omega.data() + 3);
            }
        return Eigen::Map<VectorXd>(rows.data(), rows.size());
    }
    /** M of all particles of the System, column by column. */
    MatrixXd blobMobility() {
        const int n = 3 * system.getNumParticles();
        MatrixXd M(n, n);
        for (int i = 0; i < n; i++) {
            std::vector<double> unit(n, 0.0);
            unit[i] = 1;
            const std::vector<double> column = fluid->applyBlobMobilityInContext(*context, unit);
            M.col(i) = Eigen::Map<const VectorXd>(column.data(), n);
        }
        return M;
    }
};

}  // namespace RigidHITest

#endif
