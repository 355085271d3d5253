#ifndef RIGIDHI_FLOW_READING_SUPPORT_H_
#define RIGIDHI_FLOW_READING_SUPPORT_H_

// A scene of bodies that are pushed, whose flow is read.

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
    /** @param wrenches  six rows a body */
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
