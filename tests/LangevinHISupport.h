#ifndef RIGIDHI_LANGEVIN_HI_SUPPORT_H_
#define RIGIDHI_LANGEVIN_HI_SUPPORT_H_

// Bodies with momenta in a fluid, and the values that tests read of them.

#include <openmm/CustomExternalForce.h>

#include <algorithm>
#include <string>
#include <vector>

#include "HydrodynamicSupport.h"

namespace RigidHITest {

/** A force on every particle from an energy of x, y, z. */
inline void addField(OpenMM::System& system, const std::string& energy) {
    auto* field = new OpenMM::CustomExternalForce(energy);
    for (int i = 0; i < system.getNumParticles(); i++)
        if (!system.isVirtualSite(i)) field->addParticle(i, std::vector<double>());
    system.addForce(field);
}

/** A sphere about its origin with any inertia. A field turns the sphere by its marker. */
inline BodyKind markedSphere(double radius, double mass, const Vec3& moments) {
    return {"marked sphere", mass, moments, {Vec3(), Vec3(0.1, 0.15, 0.7)}, {radius, 0}};
}
inline BodyKind linearSphere(double radius, double mass, double moment) {
    return {"linear sphere", mass, Vec3(moment, moment, 0), {Vec3(), Vec3(0, 0, 0.6)}, {radius, 0}};
}
inline BodyKind pointKind(double radius, double mass) {
    return {"point", mass, Vec3(), {Vec3()}, {radius}};
}

struct Snapshot {
    std::vector<Vec3> x, v, R, V, omega;
    std::vector<QuaternionArray> q;
    explicit Snapshot(FluidScene& scene) {
        x = positionsOf(*scene.context);
        v = velocitiesOf(*scene.context);
        R = scene.integrator.getBodyPositions();
        V = scene.integrator.getBodyVelocities();
        omega = scene.integrator.getBodyAngularVelocities();
        q = scene.integrator.getBodyOrientations();
    }
    void expectSameBits(const Snapshot& other, const std::string& what) const {
        EXPECT_TRUE(sameBits(x, other.x) && sameBits(v, other.v)) << what << ": particles";
        EXPECT_TRUE(sameBits(R, other.R) && sameBits(V, other.V) && sameBits(omega, other.omega))
            << what;
        EXPECT_EQ(q, other.q) << what;
    }
    void expectNear(const Snapshot& other, double tolerance, const std::string& what) const {
        double worst = 0;
        for (size_t i = 0; i < x.size(); i++) {
            worst = std::max(worst, norm(v[i] - other.v[i]));
            // The platform may round particles, but not bodies.
            const double apart = norm(x[i] - other.x[i]);
            if (!(apart <= readTolerance(tolerance, norm(x[i])))) worst = std::max(worst, apart);
        }
        for (size_t b = 0; b < R.size(); b++) {
            worst = std::max(worst, norm(R[b] - other.R[b]));
            worst = std::max(worst, norm(omega[b] - other.omega[b]));
            for (int k = 0; k < 4; k++) worst = std::max(worst, std::abs(q[b][k] - other.q[b][k]));
        }
        EXPECT_LT(worst, tolerance) << what;
    }
};

/** Give every body and free particle a velocity, every body an angular velocity. */
inline void setTwists(FluidScene& scene, const VectorXd& twists,
                      const std::vector<Vec3>& freeVelocities = {}) {
    std::vector<Vec3> V, omega;
    for (size_t b = 0; b < scene.bodies.size(); b++) {
        V.push_back(toVec3(twists.segment<3>(6 * b)));
        omega.push_back(toVec3(twists.segment<3>(6 * b + 3)));
    }
    if (!freeVelocities.empty()) {
        std::vector<Vec3> v(scene.positions.size());
        for (size_t i = 0; i < scene.freeParticles.size(); i++)
            v[scene.freeParticles[i]] = freeVelocities[i];
        scene.context->setVelocities(v);
    }
    scene.integrator.setBodyVelocities(V);
    scene.integrator.setBodyAngularVelocities(omega);
}
inline VectorXd twistsOf(FluidScene& scene) {
    const auto V = scene.integrator.getBodyVelocities(),
               omega = scene.integrator.getBodyAngularVelocities();
    const auto v = velocitiesOf(*scene.context);
    VectorXd result(6 * V.size() + 3 * scene.freeParticles.size());
    for (size_t b = 0; b < V.size(); b++)
        result.segment<6>(6 * b) << toEigen(V[b]), toEigen(omega[b]);
    for (size_t i = 0; i < scene.freeParticles.size(); i++)
        result.segment<3>(6 * V.size() + 3 * i) = toEigen(v[scene.freeParticles[i]]);
    return result;
}

inline double counter(FluidScene& scene, const std::string& name) {
    return scene.integrator.getStepStatistics().at(name);
}

}  // namespace RigidHITest

#endif
