#ifndef RIGIDHI_RANDOM_FIELD_H_
#define RIGIDHI_RANDOM_FIELD_H_

#include <openmm/Vec3.h>

#include <Eigen/Core>
#include <vector>

#include "mobility/DrivenFlow.h"
#include "mobility/FlowSources.h"

namespace RigidHIPlugin {

struct Placement;

/**
 * A model's own random flow, of unit temperature and time. It is drawn once
 * (FieldOfModel::draw()) and stays the same wherever it is evaluated.
 *
 * The velocities of particles at a placement ("slips", random surface velocities) have the
 * covariance M there. If the field is local (FieldOfModel::isLocal()), velocities at two placements
 * have the covariance that M would have between the particles of both. So the differences that
 * schemes take between placements come from the positions alone, not from new random numbers.
 */
class RandomField {
public:
    virtual ~RandomField() {}
    /**
     * Velocities of the particles at a placement, one column.
     *
     * @param nearby  whether the placement is a small displacement from the one before, for a
     *     finite difference
     * @param slips  resized and overwritten
     */
    virtual void slipsAt(const Placement& placement, bool nearby, Eigen::MatrixXd& slips) = 0;
    /**
     * Whether gradientsAt() gives the derivatives of slips by positions, so that no differences are
     * needed. Default: no.
     */
    virtual bool hasGradients() const { return false; }
    /**
     * The derivatives of the slips: dv_a/dx_b at (3 a + b, particle), of velocities but not of
     * angular velocities.
     */
    virtual void gradientsAt(const Placement& placement, bool nearby, Eigen::MatrixXd& gradients) {}
    /**
     * Add to the velocities `factor` times the field at points of the fluid, with all modes of the
     * field.
     */
    virtual void addFlowAt(const std::vector<OpenMM::Vec3>& points, double factor,
                           Velocities& velocities) = 0;
    /**
     * The component of the field along the wave sin(k x_b + phase) e_a; between planes
     * (DrivenFlow::hasPlanes), the mean of this component over the height of the fluid.
     */
    virtual double amplitudeOf(const DrivenFlow& wave) = 0;
    /**
     * The mean of the field over the volume of the fluid; with planes, the fluid lies between these
     * heights. Default: 0, for a fluid whose mean flow is 0.
     */
    virtual Eigen::Vector3d meanFlow(double low, double high) { return Eigen::Vector3d::Zero(); }
    /** The number of random numbers of the field. It is final once slipsAt() has been called. */
    virtual long long getNumRandomNumbers() const = 0;
};

}  // namespace RigidHIPlugin

#endif
