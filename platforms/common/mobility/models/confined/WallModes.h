#ifndef RIGIDHI_WALL_MODES_H_
#define RIGIDHI_WALL_MODES_H_

#include <Eigen/Core>
#include <vector>

#include "mobility/MobilityModel.h"
#include "mobility/models/confined/ConfiningPlanes.h"
#include "mobility/models/confined/PlaneModes.h"

namespace RigidHIPlugin {

/** The value of k z at which the modes of a wall, (1 + 2kz)^2 exp(-2kz), have this size. */
double depthOfModes(double size);
/** The value of k z beyond which modes are negligible. */
double largestDepth();

/** A flow of rank 1 that walls subtract: M -= factor u u^T. */
struct SignedMode {
    FeltMode felt;
    double factor;
};

/**
 * The flows of rank 1 that no-slip walls subtract from the flow of a fluid of period P along z, for
 * each wave vector along the walls, times the viscosity and the area. ConfinedRotnePragerYamakawa.h
 * has the equation. Heights count from the lower wall.
 */
class WallModes {
public:
    /**
     * @param period  its height for a channel
     * @param middle  the middle height of the particles, for the images of the period
     */
    WallModes(const ConfiningPlanes& planes, double period, double middle)
        : height(planes.isChannel() ? planes.getHeight() : 0), period(period), middle(middle) {}
    static constexpr int most = 9;
    /** @param withImages  whether to subtract images of the period, too; a channel has none */
    int count(bool withImages) const { return height > 0 || !withImages ? 3 : most; }
    void fill(double k, bool withImages, double z, double a, SignedMode* modes) const;

private:
    void betweenWalls(double k, double z, double a, SignedMode* modes) const;
    void ofImages(double k, double z, double a, SignedMode* modes) const;

    const double height, period, middle;
};

/**
 * The flow along walls that does not depend on x and y, minus that in a fluid of period P along z,
 * times the viscosity and the area. A force at z' induces g(z, z') = min(z, z') above a wall.
 * Between walls without a pressure gradient it induces z (H - z')/H for z < z', and without flux 3
 * p p'/H^3 less, with p = z (H - z). In the periodic fluid it induces P/12 - |z - z'|/2 + (z -
 * z')^2/2P. The difference is a sum of products of 1, z and z^2.
 */
class UniformFlow {
public:
    UniformFlow(const ConfiningPlanes& planes, double period);
    /**
     * The velocities of a sphere along an axis in the flows 1, z and z^2, and its angular
     * velocities about the other axis (W_y for x, and -W_x for y).
     */
    static Eigen::Matrix<double, 3, 2> felt(double z, double a) {
        Eigen::Matrix<double, 3, 2> D;
        D << 1, 0, z, 0.5, z * z + a * a / 3, z;
        return D;
    }
    /** The coefficients of the products. */
    const Eigen::Matrix3d& getCoefficients() const { return coefficients; }
    /** Velocity and angular velocity of a sphere at z_i from force and torque at z_j. */
    Eigen::Matrix2d between(double z_i, double a_i, double z_j, double a_j) const {
        return felt(z_i, a_i).transpose() * coefficients * felt(z_j, a_j);
    }

private:
    Eigen::Matrix3d coefficients;
};

/**
 * The period of the fluid for lattice sums. Between walls it is their distance. Above a wall any
 * period longer than the layer of particles, `span`, would do; if it is longer by the width of the
 * box, the images of the period have few modes. It is a multiple of a step, so that it rarely
 * changes.
 */
double basePeriod(const ConfiningPlanes& planes, const BoxVectors& box, double span);

/**
 * Add to the velocities `factor` times the flow at points of spheres in a confined fluid of
 * viscosity 1. Cost: that of LatticeSum::addFlowAt(), and of all waves of the walls for each point.
 *
 * @param positions  no closer to walls than contact
 * @param forces  one column of forces and torques
 */
void addConfinedFlow(const ConfiningPlanes& planes, const HydrodynamicParticles& particles,
                     const std::vector<OpenMM::Vec3>& positions, const BoxVectors& box,
                     const Eigen::MatrixXd& forces, const std::vector<OpenMM::Vec3>& points,
                     double factor, Velocities& velocities);

}  // namespace RigidHIPlugin

#endif
