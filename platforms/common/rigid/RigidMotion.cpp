#include "rigid/RigidMotion.h"

#include <Eigen/Geometry>

#include "rigidbody/EigenVec3.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

namespace {

/** The additional part of K', K' = K + K s (0, axis)^T (1/factor - 1), in the lab frame. */
struct SpinInLab {
    SpinInLab(const FluidElement& element, const Matrix3d& A) : isSlowed(element.slowsK()) {
        if (!isSlowed) return;
        const SlowedSpin& spin = element.spin;
        V = A * spin.screw.head<3>();
        W = A * spin.screw.tail<3>();
        row = (1 / spin.factor - 1) * (A * spin.axis);
    }
    /** The velocity of a site at r from the origin when the screw turns by 1 rad/ps. */
    Vector3d at(const Vector3d& r) const { return V + W.cross(r); }
    const bool isSlowed;
    Vector3d V, W, row;
};

/** Write K of one element into a block of a larger matrix of zeros. */
void placeElement(const FluidElement& element, const Matrix3d& A, MatrixXd& K, int row,
                  int column) {
    const SpinInLab spin(element, A);
    for (const Vector3d& site : element.sites) {
        K.block<3, 3>(row, column).setIdentity();
        if (!element.isFree()) K.block<3, 3>(row, column + 3) = -crossMatrix(A * site);
        if (element.isSphere()) K.block<3, 3>(row + 3, column + 3).setIdentity();
        if (spin.isSlowed)
            K.block<3, 3>(row, column + 3) += spin.at(A * site) * spin.row.transpose();
        row += 3;
    }
}

}  // namespace

HydrodynamicParticles particlesOf(const vector<FluidElement>& elements) {
    HydrodynamicParticles particles;
    for (const FluidElement& element : elements)
        for (size_t i = 0; i < element.particles.size(); i++)
            particles.add(element.radii[i], element.isSphere(), element.particles[i], element.body);
    return particles;
}

vector<OpenMM::Vec3> sitesOf(const FluidElement& element) {
    vector<OpenMM::Vec3> sites;
    for (const Vector3d& site : element.sites) sites.push_back(toVec3(site));
    return sites;
}

Matrix<double, 6, 6> twoRotations(const Matrix3d& A) {
    Matrix<double, 6, 6> both = Matrix<double, 6, 6>::Zero();
    both.topLeftCorner<3, 3>() = both.bottomRightCorner<3, 3>() = A;
    return both;
}

void setTurns(const vector<Pose>& poses, vector<Matrix3d>& turns) {
    turns.resize(poses.size());
    for (size_t e = 0; e < poses.size(); e++) turns[e] = poses[e].rotation();
}

RigidMotion::RigidMotion(const vector<FluidElement>& elements)
    : elements(elements), particles(particlesOf(elements)) {
    int particleRow = 0, particle = 0;
    for (const FluidElement& element : elements) {
        firstParticles.push_back(particle);
        particle += element.sites.size();
        rows.push_back(numRows);
        particleRows.push_back(particleRow);
        numRows += element.numRows();
        particleRow += element.numParticleRows();
        if (!element.isFree() && (element.particles.size() != 1 || !element.sites[0].isZero(0)))
            identity = false;
    }
}

void RigidMotion::place(const vector<Pose>& poses, const vector<Matrix3d>& turns,
                        Placement& placement) const {
    placement.positions.resize(particles.size());
    auto to = placement.positions.begin();
    for (size_t e = 0; e < elements.size(); e++)
        for (const Vector3d& site : elements[e].sites) *to++ = toVec3(poses[e].R + turns[e] * site);
}

void RigidMotion::fill(const vector<Matrix3d>& turns, MatrixXd& K, int firstElement) const {
    const int count = elements.size(), ofParticles = particleRows[firstElement],
              ofBodies = rows[firstElement];
    K.setZero(particles.numRows - ofParticles, numRows - ofBodies);
    for (int e = firstElement; e < count; e++)
        placeElement(elements[e], turns[e], K, particleRows[e] - ofParticles, rows[e] - ofBodies);
}

MatrixXd RigidMotion::ofElement_body(int e) const {
    MatrixXd K = MatrixXd::Zero(elements[e].numParticleRows(), elements[e].numRows());
    placeElement(elements[e], Matrix3d::Identity(), K, 0, 0);
    return K;
}

void RigidMotion::slips(const vector<Matrix3d>& turns, const MatrixXd& twists,
                        MatrixXd& slips) const {
    slips.resize(particles.numRows, twists.cols());
    for (size_t e = 0; e < elements.size(); e++) {
        const FluidElement& element = elements[e];
        const SpinInLab spin(element, turns[e]);
        int row = particleRows[e];
        for (const Vector3d& site : element.sites) {
            const Vector3d r = turns[e] * site;
            for (int c = 0; c < twists.cols(); c++) {
                const auto own = twists.col(c).segment(rows[e], element.numRows());
                slips.col(c).segment<3>(row) = own.head<3>();
                if (element.isFree()) continue;
                slips.col(c).segment<3>(row) += Vector3d(own.tail<3>()).cross(r);
                if (element.isSphere()) slips.col(c).segment<3>(row + 3) = own.tail<3>();
                if (spin.isSlowed)
                    slips.col(c).segment<3>(row) += spin.at(r) * spin.row.dot(own.tail<3>());
            }
            row += element.isSphere() ? 6 : 3;
        }
    }
}

void RigidMotion::wrenches(const vector<Matrix3d>& turns, const MatrixXd& forces,
                           MatrixXd& wrenches) const {
    wrenches.setZero(numRows, forces.cols());
    for (size_t e = 0; e < elements.size(); e++) {
        const FluidElement& element = elements[e];
        const SpinInLab spin(element, turns[e]);
        int row = particleRows[e];
        for (const Vector3d& site : element.sites) {
            const Vector3d r = turns[e] * site;
            for (int c = 0; c < forces.cols(); c++) {
                const Vector3d force = forces.col(c).segment<3>(row);
                wrenches.col(c).segment<3>(rows[e]) += force;
                if (element.isFree()) continue;
                wrenches.col(c).segment<3>(rows[e] + 3) += r.cross(force);
                if (spin.isSlowed)
                    wrenches.col(c).segment<3>(rows[e] + 3) += spin.at(r).dot(force) * spin.row;
                if (element.isSphere())
                    wrenches.col(c).segment<3>(rows[e] + 3) += forces.col(c).segment<3>(row + 3);
            }
            row += element.isSphere() ? 6 : 3;
        }
    }
}

}  // namespace RigidHIPlugin
