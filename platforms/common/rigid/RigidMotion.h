#ifndef RIGIDHI_RIGID_MOTION_H_
#define RIGIDHI_RIGID_MOTION_H_

#include <Eigen/Core>
#include <vector>

#include "rigid/FluidElement.h"
#include "rigidbody/Pose.h"

namespace RigidHIPlugin {

/**
 * The motion of particles with their bodies: the positions of the particles, and K. The rows of K
 * give the velocities of particles from V and W of their body (Westwood 2022, eqs. 7 to 10). Twists
 * and wrenches have six rows for a body (V, W about its origin; lab frame) and three for a free
 * particle, in the order of the elements. Slips and forces have the rows of HydrodynamicParticles.
 * Turns are the rotations of the poses. Where an element's spin is slowed, K stands for K' of
 * SlowedSpin.
 */
class RigidMotion {
public:
    explicit RigidMotion(const std::vector<FluidElement>& elements);
    const std::vector<FluidElement>& getElements() const { return elements; }
    const HydrodynamicParticles& getParticles() const { return particles; }
    int getNumRows() const { return numRows; }
    int firstRow(int element) const { return rows[element]; }
    /** First row of the element's particles. */
    int firstParticleRow(int element) const { return particleRows[element]; }
    int firstParticle(int element) const { return firstParticles[element]; }
    /** Whether K = 1: spheres about their centres, and free particles. */
    bool isIdentity() const { return identity; }

    /** Set the positions of the particles. */
    void place(const std::vector<Pose>& poses, const std::vector<Eigen::Matrix3d>& turns,
               Placement& placement) const;
    /**
     * Fill K, without allocation if K has its size already.
     *
     * @param firstElement  K has the rows and columns of elements from this one on
     */
    void fill(const std::vector<Eigen::Matrix3d>& turns, Eigen::MatrixXd& K,
              int firstElement = 0) const;
    /** slips = K U, without making the matrix. */
    void slips(const std::vector<Eigen::Matrix3d>& turns, const Eigen::MatrixXd& twists,
               Eigen::MatrixXd& slips) const;
    /** wrenches = K^T lambda, without making the matrix. */
    void wrenches(const std::vector<Eigen::Matrix3d>& turns, const Eigen::MatrixXd& forces,
                  Eigen::MatrixXd& wrenches) const;
    /** K of one element in its own frame. */
    Eigen::MatrixXd ofElement_body(int element) const;

private:
    const std::vector<FluidElement> elements;
    const HydrodynamicParticles particles;
    std::vector<int> rows, particleRows, firstParticles;  // first of each element
    int numRows = 0;
    bool identity = true;
};

/** The 6 x 6 matrix diag(A, A) of a rotation. */
Eigen::Matrix<double, 6, 6> twoRotations(const Eigen::Matrix3d& A);
/** Compute the rotations of poses. From the second call on this allocates nothing. */
void setTurns(const std::vector<Pose>& poses, std::vector<Eigen::Matrix3d>& turns);

}  // namespace RigidHIPlugin

#endif
