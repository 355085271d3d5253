#ifndef RIGIDHI_OVERDAMPED_SUPPORT_H_
#define RIGIDHI_OVERDAMPED_SUPPORT_H_

// Scenes of bodies and free particles without masses, and a list of all schemes that move them.

#include <openmm/CustomExternalForce.h>

#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "HydrodynamicSupport.h"
#include "openmmrigidhi/SchemeTraits.h"

namespace RigidHITest {

using RigidHI = CustomRigidHIIntegrator;
using Scheme = RigidHI::Scheme;

struct Named {
    Scheme scheme;
    std::string name;
    int order;   // at temperature 0
    int forces;  // evaluations a step
};
/** All schemes without momenta. */
inline const std::vector<Named> schemes = [] {
    std::vector<Named> found;
    for (const RigidHIPlugin::SchemeTraits& traits : RigidHIPlugin::schemeTable)
        if (traits.isOverdamped())
            found.push_back({traits.scheme, traits.name, traits.coldOrder, traits.forces});
    return found;
}();

/** Bodies and free particles without masses. */
struct OverdampedScene : FluidScene {
    explicit OverdampedScene(Scheme scheme, double temperature = 0, double h = 0.01)
        : FluidScene(temperature, h) {
        integrator.setScheme(scheme);
    }
    void addMassless(BodyKind kind, const Vec3& R = Vec3(),
                     const QuaternionArray& q = {{1, 0, 0, 0}}) {
        kind.mass = 0;
        kind.moments = Vec3();
        add(kind, R, q);
    }
    void addWells(const std::string& energy) {
        auto* field = new OpenMM::CustomExternalForce(energy);
        for (int i = 0; i < system.getNumParticles(); i++)
            field->addParticle(i, std::vector<double>());
        system.addForce(field);
    }
    /**
     * Add a multiblob, a sphere off its origin, and if wanted a rod and a free particle, all in
     * wells, above a wall or without one.
     */
    void addMixture(bool wall, bool rod = false, bool free = true) {
        addMassless(boomerangKind(), Vec3(0, 0, 4), randomTurn(1));
        BodyKind sphere = sphereKind(0.8);
        sphere.sites[0] = Vec3(0.1, 0, -0.2);
        addMassless(sphere, Vec3(3, 0.5, 3.5), randomTurn(2));
        if (rod) addMassless(rodKind(), Vec3(0, -3, 5), randomTurn(5));
        if (free) addFree(0, 0.5, Vec3(-2.5, 1, 4));
        if (wall) {
            fluid->setBoundary(MobilityForce::NoSlipWall);
            fluid->setWallHeight(0.3);
        }
        addWells("2*(x-1)^2 + (y+1)^2 + 0.5*(z-4)^4 + 0.3*x*y");
    }
    /** The forces and torques of the mixture's wells, from derivatives written by hand. */
    static VectorXd wrenchesOfWells(const std::vector<LabBody>& bodies) {
        int row = 0;
        for (const LabBody& body : bodies) row += body.rows();
        VectorXd wrenches = VectorXd::Zero(row);
        row = 0;
        for (const LabBody& body : bodies) {
            for (const Vector3d& offset : body.offsets) {
                const Vector3d x = body.R + offset;
                const Vector3d f(-4 * (x[0] - 1) - 0.3 * x[1], -2 * (x[1] + 1) - 0.3 * x[0],
                                 -2 * std::pow(x[2] - 4, 3));
                wrenches.segment<3>(row) += f;
                if (!body.isFree) wrenches.segment<3>(row + 3) += offset.cross(f);
            }
            row += body.rows();
        }
        return wrenches;
    }
    static QuaternionArray randomTurn(int seed) {
        std::mt19937 random(seed);
        return randomQuaternion(random);
    }
    VectorXd state() {
        std::vector<double> numbers;
        for (const Vec3& x : positionsOf(*context))
            for (int k = 0; k < 3; k++) numbers.push_back(x[k]);
        return Eigen::Map<VectorXd>(numbers.data(), numbers.size());
    }
};

}  // namespace RigidHITest

#endif
