#ifndef RIGIDHI_GRID_SCENE_SUPPORT_H_
#define RIGIDHI_GRID_SCENE_SUPPORT_H_

#include <openmm/CustomExternalForce.h>

#include <Eigen/Eigenvalues>
#include <string>

#include "HydrodynamicSupport.h"

namespace RigidHITest {

/** The temperature at which kT is 1. */

/**
 * Bodies in a periodic box that is 8 nm wide. With the solver MatrixFree the fluid is on a grid.
 */
struct GridScene : FluidScene {
    GridScene(MobilityForce::Model model, double temperature,
              CustomRigidHIIntegrator::Scheme scheme, double h = 0.002,
              MobilityForce::Solver solver = MobilityForce::MatrixFree, double tolerance = 1e-2)
        : FluidScene(temperature, h) {
        fluid->setBoundary(MobilityForce::Periodic);
        fluid->setModel(model);
        fluid->setSolver(solver);
        fluid->setSolverTolerance(tolerance);
        integrator.setScheme(scheme);
        side = 8;
    }
    /** Adds spheres, multiblobs and a free particle, across faces of the box and outside of it, and
     * forces on them. */
    void addBodies() {
        add(sphereKind(1), Vec3(0, 0, 0));
        add(sphereKind(0.8), Vec3(2.1, 0.3, 8.2));
        add(boomerangKind(), Vec3(-1, 2.5, 2.4));
        add(boomerangKind(), Vec3(3.5, -2.5, 0.4));
        auto* pull = new OpenMM::CustomExternalForce("0.7*x-0.4*y+0.2*z*z");
        for (int i = 0; i < system.getNumParticles(); i++)
            pull->addParticle(i, std::vector<double>());
        system.addForce(pull);
    }
    double count(const std::string& what) const { return integrator.getStepStatistics().at(what); }
    std::string effect(const std::string& what) const { return integrator.getEffects().at(what); }
    void setBox(double x, double y, double z) {
        context->setPeriodicBoxVectors(Vec3(x, 0, 0), Vec3(0, y, 0), Vec3(0, 0, z));
    }
};

/** The largest error of a mobility, in the norm of the roots of the diagonal. */
inline double relativeError(const MatrixXd& N, const MatrixXd& exact) {
    const VectorXd root = exact.diagonal().cwiseSqrt().cwiseInverse();
    const MatrixXd error = root.asDiagonal() * (N - exact) * root.asDiagonal();
    return Eigen::SelfAdjointEigenSolver<MatrixXd>(error).eigenvalues().cwiseAbs().maxCoeff();
}

}  // namespace RigidHITest

#endif
