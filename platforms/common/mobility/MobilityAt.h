#ifndef RIGIDHI_MOBILITY_AT_H_
#define RIGIDHI_MOBILITY_AT_H_

#include <openmm/Vec3.h>

#include <Eigen/Core>
#include <array>
#include <vector>

#include "mobility/Accuracy.h"
#include "mobility/FlowSources.h"

namespace RigidHIPlugin {

struct HydrodynamicParticles;
class MobilityModel;
class NearAndFar;
struct DrivenFlow;

/** The vectors of a periodic box, nm. Zeros mean no box. */
using BoxVectors = std::array<OpenMM::Vec3, 3>;

/** Where the particles of a model are. */
struct Placement {
    std::vector<OpenMM::Vec3> positions;  // nm, not wrapped, one per hydrodynamic particle
    BoxVectors box = {};
};

/**
 * A mobility model at one placement: velocities = M forces.
 *
 * Models make such objects (MobilityModel::at()), and several may exist at once. An object keeps
 * cached results until it moves to another placement. One object serves one caller at a time.
 *
 * All matrices are in the lab frame, with rows as in HydrodynamicParticles, in nm/(ps kJ/mol/nm)
 * and so on. The matrix is symmetric positive definite at every placement that the model accepts.
 */
class MobilityAt {
public:
    explicit MobilityAt(const MobilityModel& model);
    virtual ~MobilityAt() {}
    /**
     * Compute velocities = M forces. Columns are independent of each other.
     *
     * For differences, this object must have come to all placements from the same accepted one, or
     * the objects at these placements must have been at the accepted one before
     * (MobilityTraits::isAnchored).
     *
     * @param velocities  resized and overwritten
     * @param accuracy    exact by default. A model with one kind of product ignores it
     */
    virtual void multiply(const Eigen::MatrixXd& forces, Eigen::MatrixXd& velocities,
                          const Accuracy& accuracy = Accuracy()) = 0;
    /** The matrix itself. Default: multiply() with the identity. */
    virtual void dense(Eigen::MatrixXd& mobility);
    /**
     * The columns of dense() that belong to this particle and later ones, with the same bits. Other
     * elements are undefined. Default: dense().
     */
    virtual void denseColumns(int firstParticle, Eigen::MatrixXd& mobility) { dense(mobility); }
    /**
     * The inverse of the matrix. Default: from the Cholesky factors of dense().
     *
     * @throws OpenMMException if M is not positive definite
     */
    virtual void friction(Eigen::MatrixXd& friction);
    /**
     * Add to the rows of particles the velocities induced by the stresslets with which particles
     * resist the strain of a flow. Default: nothing, for models without stresslets.
     */
    virtual void addStressletsOf(const DrivenFlow& flow, Eigen::MatrixXd& slips) {}
    /**
     * The sources of the fluid's flow when these forces act on particles: the forces and, where
     * particles resist strain, their stresslets. The stresslets include those that a driven flow
     * causes. Default: the forces.
     *
     * @param flow      the driven flow; null without one
     * @param accuracy  of stresslets; exact by default. Models without iterations ignore it
     */
    virtual FlowSources sources(const Eigen::MatrixXd& forces, const DrivenFlow* flow,
                                const Accuracy& accuracy = Accuracy()) {
        return {forces, {}};
    }
    /**
     * Add to the velocities `factor` times the flow of such sources at points of the fluid. The
     * driven flow is not included.
     *
     * @throws OpenMMException if the model does not know this flow (default)
     */
    virtual void addFlowAt(const FlowSources& sources, const std::vector<OpenMM::Vec3>& points,
                           double factor, Velocities& velocities);
    /**
     * M and Delta of a mobility (M^-1 + Delta)^-1. Default: null, for mobilities without such
     * parts.
     */
    virtual NearAndFar* parts() { return nullptr; }
    /** Seconds of the caller's thread in products with a grid; 0 for models without a grid. */
    virtual double getSecondsOfGrid() const { return secondsOfGrid; }

protected:
    friend class MobilityModel;
    /**
     * Move to this placement. The model has already accepted it; with `nearby` it may also be a
     * small displacement away from an accepted placement. An override drops cached results and
     * keeps allocated memory.
     */
    virtual void moveTo(const Placement& placement, bool nearby) = 0;

    const HydrodynamicParticles& particles;
    const double viscosity;
    double secondsOfGrid = 0;
};

}  // namespace RigidHIPlugin

#endif
