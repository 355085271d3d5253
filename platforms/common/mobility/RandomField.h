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
 * A model's own random flow, of unit temperature and time: drawn once (MobilityModel::drawField()),
 * and then the same wherever it is looked at. Velocities of particles at a placement have the
 * covariance M there; those at two placements the covariance that M would have between the
 * particles of both, if the model says that the field is local (MobilityModel::fieldIsLocal()). So
 * what schemes difference between placements changes with the places alone, not with new random
 * numbers.
 */
class RandomField {
public:
    virtual ~RandomField() {}
    /**
     * Velocities of the particles at a placement, one column.
     *
     * @param nearby  a small way from the placement before, for a finite difference
     * @param slips   resized and overwritten
     */
    virtual void slipsAt(const Placement& placement, bool nearby, Eigen::MatrixXd& slips) = 0;
    /** Whether the derivatives of slips by positions are known without differences. Default: no. */
    virtual bool hasGradients() const { return false; }
    /** These: dv_a/dx_b at (3 a + b, particle), of velocities, not of angular ones. */
    virtual void gradientsAt(const Placement& placement, bool nearby, Eigen::MatrixXd& gradients) {}
    /** velocities += factor times the field at points of the fluid, of all modes that it has. */
    virtual void addFlowAt(const std::vector<OpenMM::Vec3>& points, double factor,
                           Velocities& velocities) = 0;
    /** Its component along sin(k x_b + phase) e_a of a wave. */
    virtual double amplitudeOf(const DrivenFlow& wave) = 0;
    /** Random numbers that were drawn for it. */
    virtual long long getNumRandomNumbers() const = 0;
};

}  // namespace RigidHIPlugin

#endif
