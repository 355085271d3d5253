#ifndef RIGIDHI_FLOW_READING_SUPPORT_H_
#define RIGIDHI_FLOW_READING_SUPPORT_H_

// A scene of pushed bodies for reading their flow, and averages of the flow over particles.

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "FlowSupport.h"
#include "openmmrigidhi/CustomBodyForce.h"

namespace RigidHITest {

/** Bodies on which constant forces and torques act, lab frame. */
struct Pushed : PeriodicScene {
    RigidHIPlugin::CustomBodyForce* push = nullptr;  // the System's

    explicit Pushed(const ModelCase& model = periodicModels[0], double temperature = 0,
                    double h = 1, RigidHI::Scheme scheme = RigidHI::EulerMaruyama)
        : PeriodicScene(model, temperature, h, scheme) {
        fluid->setBoundary(MobilityForce::Unbounded);
        fluid->setSolverTolerance(1e-10);
    }
    /** @param wrenches  six rows for each body */
    void pushBy(const VectorXd& wrenches) {
        if (!push) {
            push = new RigidHIPlugin::CustomBodyForce("fx", "fy", "fz", "tx", "ty", "tz");
            for (const char* name : {"fx", "fy", "fz", "tx", "ty", "tz"})
                push->addPerBodyParameter(name);
            for (size_t b = 0; b < bodies.size(); b++)
                push->addBody(b, std::vector<double>(6, 0.0));
            system.addForce(push);
        }
        for (int b = 0; b < wrenches.size() / 6; b++)
            push->setBodyParameters(b, b,
                                    std::vector<double>(&wrenches[6 * b], &wrenches[6 * b] + 6));
        if (context) push->updateParametersInContext(*context);
    }
    MatrixXd flow(const std::vector<Vec3>& points) {
        const std::vector<Vec3> velocities = fluid->getFlowInContext(*context, points);
        MatrixXd columns(3, velocities.size());
        for (size_t i = 0; i < velocities.size(); i++) columns.col(i) = toEigen(velocities[i]);
        return columns;
    }
    Eigen::Vector2d mode(int force, int wave, int index) {
        const std::vector<double> amplitudes =
            fluid->getFlowModeInContext(*context, force, wave, index);
        return Eigen::Vector2d(amplitudes.at(0), amplitudes.at(1));
    }
    Eigen::Vector2d randomMode(int force, int wave, int index) {
        const std::vector<double> amplitudes =
            fluid->getRandomFlowModeInContext(*context, force, wave, index);
        return Eigen::Vector2d(amplitudes.at(0), amplitudes.at(1));
    }
};

/** Wrenches without symmetry on this number of bodies, with components of about 1. */
inline VectorXd someWrenches(int bodies, int seed = 5) {
    std::mt19937 random(seed);
    std::normal_distribution<double> normal;
    VectorXd wrenches(6 * bodies);
    for (int i = 0; i < wrenches.size(); i++) wrenches[i] = normal(random);
    return wrenches;
}

/** Four blobs that do not touch. */
inline BodyKind apartKind() {
    return {"apart",
            2,
            Vec3(1.3, 0.7, 1.1),
            {Vec3(0, 0, 0), Vec3(1.3, 0.2, 0), Vec3(0.1, 1.2, -0.3), Vec3(-0.4, 0.2, 1.1)},
            {0.5, 0.4, 0.45, 0.3}};
}

/** Nodes and weights of Gauss-Legendre quadrature on -1..1, or of Gauss-Hermite quadrature for a
 * normal distribution. */
inline void gauss(int n, bool normal, VectorXd& nodes, VectorXd& weights) {
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
    std::vector<Vec3> points;
    std::vector<double> weights;
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
inline double slipOfParticles(Pushed& scene, const std::vector<LabBody>& bodies,
                              const VectorXd& twists, int n) {
    double largest = 0;
    int row = 0;
    for (const LabBody& body : bodies) {
        for (size_t i = 0; i < body.radii.size(); i++) {
            Vector3d velocity = twists.segment<3>(row);
            if (!body.isFree)
                velocity += Vector3d(twists.segment<3>(row + 3)).cross(body.offsets[i]);
            const Envelope envelope(scene.fluid->getModel(), body.R + body.offsets[i],
                                    body.radii[i], n);
            largest = std::max(largest, (envelope.average(scene) - velocity).cwiseAbs().maxCoeff());
        }
        row += body.rows();
    }
    return largest;
}

inline const ModelCase rotnePrager = periodicModels[0], forceCoupling = periodicModels[1],
                       onGrid = periodicModels[2], stokesian = periodicModels[3];

/** The velocity at x, outside or inside of a sphere at the origin with a force and a torque (Stokes
 * 1851, Kirchhoff 1876). */
inline Vector3d stokes(const Vector3d& x, double a, double eta, const Vector3d& F,
                       const Vector3d& T) {
    const double r = x.norm();
    if (r <= a) return F / (6 * M_PI * eta * a) + T.cross(x) / (8 * M_PI * eta * std::pow(a, 3));
    const Vector3d n = x / r;
    const double c = a * a / (r * r);
    return ((1 + c / 3) * F + (1 - c) * n * n.dot(F)) / (8 * M_PI * eta * r) +
           T.cross(x) / (8 * M_PI * eta * std::pow(r, 3));
}

}  // namespace RigidHITest

#endif
