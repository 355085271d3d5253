#ifndef RIGIDHI_UNIFORM_FIELD_H_
#define RIGIDHI_UNIFORM_FIELD_H_

#include <Eigen/Core>
#include <vector>

#include "mobility/MobilityModel.h"
#include "mobility/models/forcecoupling/GridWallFields.h"

namespace RigidHIPlugin {

/**
 * The random flows between planes that do not depend on x and y, which GridWallFields leaves out.
 * They are those along x and y, where the law is the same. The conditions on such a flow are its
 * velocities on both planes, and its flux if that is 0 (PlaneConditions); a uniform velocity is one
 * more unknown, by which the forces of planes balance all others.
 */
class UniformField {
public:
    /**
     * @param shape  of the grid, in the middle of whose period the fluid is
     * @param part   H of a wave number: the part of modes that the grid has
     */
    UniformField(const HydrodynamicParticles& particles, double viscosity,
                 const PlaneConditions& conditions, const GridShape& shape,
                 const GridWallFields::PartOfMode& part,
                 const std::function<WaveFactors(double radius, double k)>& waveFactors);
    void moveTo(const std::vector<OpenMM::Vec3>& positions);
    /** Draw the forces and the uniform velocity, with the numbers of the field on the grid. */
    void draw(const ModeNoise& noise);
    /** Add the flow that it has besides the modes of the grid. */
    void addTo(double* velocities) const;
    /** The number of random numbers besides those of the grid: two for each condition and axis. */
    int getNumRandomNumbers() const { return 4 * numConditions(); }
    /** Subtract what NearPlanes leaves out, in units of 1/(8 pi eta), for one column. */
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
    Eigen::Matrix3Xd polynomials;  // of heights: flows of forces, and last the uniform velocity
    Eigen::MatrixXd inverseFactor, factor, root, inverse;
    /** What a particle takes of flows of forces: along an axis, and about the other one. */
    Eigen::MatrixXd wholeAlong, wholeAbout, nearAlong, nearAbout;
    Numbers nearForces[2], forces[2];
};

}  // namespace RigidHIPlugin

#endif
