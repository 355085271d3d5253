#ifndef RIGIDHI_UNIFORM_FIELD_H_
#define RIGIDHI_UNIFORM_FIELD_H_

#include <Eigen/Core>
#include <vector>

#include "mobility/MobilityModel.h"
#include "mobility/models/forcecoupling/GridWallFields.h"

namespace RigidHIPlugin {

/**
 * The random flows between planes that do not depend on x and y, which GridWallFields leaves out.
 * They are along x and y, with the same law for both. The conditions on such a flow are its
 * velocities on both planes, and its flux if that is 0 (PlaneConditions). A uniform velocity is an
 * additional unknown, which makes the forces of planes balance all others.
 */
class UniformField {
public:
    /**
     * @param shape  of the grid; the fluid is in the middle of its period
     * @param part   H of a wave number: the part of each mode on the grid
     */
    UniformField(const HydrodynamicParticles& particles, double viscosity,
                 const PlaneConditions& conditions, const GridShape& shape,
                 const GridWallFields::PartOfMode& part,
                 const std::function<WaveFactors(double radius, double k)>& waveFactors);
    void moveTo(const std::vector<OpenMM::Vec3>& positions);
    /** Draw the forces and the uniform velocity, with the numbers of the field on the grid. */
    void draw(const ModeNoise& noise);
    /** Add the part of the flow that is not in the modes of the grid. */
    void addTo(double* velocities) const;
    /**
     * The number of random numbers in addition to those of the grid: two for each condition and
     * axis.
     */
    int getNumRandomNumbers() const { return 4 * numConditions(); }
    /**
     * Subtract the part k = 0, which NearPlanes leaves out, in units of 1/(8 pi eta), for one
     * column.
     */
    void subtractProduct(const double* forces, double* velocities) const;

private:
    using Numbers = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, 4, 1>;
    int numConditions() const { return conditions.numOfMean(); }
    template <class Task>
    void forRows(const Task& task) const;

    const HydrodynamicParticles& particles;
    const double viscosity;
    const PlaneConditions conditions;
    const GridShape shape;
    const std::vector<GridPlanes::Profile> profiles;
    const std::vector<double> fluxProfile;
    std::vector<double> parts;  // H of modes along z
    std::vector<double> radii;
    std::vector<Eigen::ArrayXd> s, t;  // of radii and modes
    std::vector<int> kind;
    Eigen::Matrix3Xd polynomials;  // in the height: flows of forces, then the uniform velocity
    Eigen::MatrixXd inverseFactor, factor, root, inverse;
    /**
     * The velocities along an axis and angular velocities about the other one that flows of forces
     * give to a particle.
     */
    Eigen::MatrixXd wholeAlong, wholeAbout, nearAlong, nearAbout;
    Numbers nearForces[2], forces[2];
};

}  // namespace RigidHIPlugin

#endif
