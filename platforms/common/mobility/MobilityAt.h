#ifndef RIGIDHI_MOBILITY_AT_H_
#define RIGIDHI_MOBILITY_AT_H_

#include <openmm/Vec3.h>

#include <Eigen/Core>
#include <array>
#include <vector>

#include "mobility/FlowSources.h"

namespace RigidHIPlugin {

struct HydrodynamicParticles;
class MobilityModel;
struct DrivenFlow;

/** The vectors of a periodic box, nm; zeros: there is none. */
typedef std::array<OpenMM::Vec3, 3> BoxVectors;

/** Where the particles of a model are. */
struct Placement {
    std::vector<OpenMM::Vec3> positions;  // nm, not wrapped, one per hydrodynamic particle
    BoxVectors box = {};
};

/**
 * A mobility model at one placement: velocities = M forces. Models make them (MobilityModel::at());
 * several may live at once. What is cached lives as long as the place. One place serves one caller
 * at a time.
 *
 * All matrices are in the lab frame, with rows as HydrodynamicParticles says, in nm/(ps kJ/mol/nm)
 * and so on. The matrix is symmetric positive definite at every placement to which the model does
 * not object.
 */
class MobilityAt {
public:
    explicit MobilityAt(const MobilityModel& model);
    virtual ~MobilityAt() {}
    /** velocities = M forces; every column is a case of its own. @param velocities  resized and
     * overwritten */
    virtual void apply(const Eigen::MatrixXd& forces, Eigen::MatrixXd& velocities) = 0;
    /** As apply(), right to `roughError` of the norm of M times that of the forces:
     * MobilityModel::hasRoughProducts(). Default: apply(). */
    virtual void applyRoughly(const Eigen::MatrixXd& forces, Eigen::MatrixXd& velocities) {
        apply(forces, velocities);
    }
    /** The error of applyRoughly(), and the tolerances of iterations that can do with it. */
    static constexpr double roughError = 1e-6, leastRoughTolerance = 5e-5;
    /**
     * As apply(), right to `error` of the norm of M times that of the forces, both scaled by the
     * roots of own mobilities, if that takes less time; 0: exact. Default: applyRoughly() where
     * that is enough.
     */
    virtual void applyWithin(double error, const Eigen::MatrixXd& forces,
                             Eigen::MatrixXd& velocities) {
        if (error >= roughError)
            applyRoughly(forces, velocities);
        else
            apply(forces, velocities);
    }
    /** The error of products that an iteration of this relative tolerance can do with; 0: none. */
    static double errorFor(double tolerance) {
        return tolerance >= leastRoughTolerance ? roughError : 0;
    }
    /** Products for such an iteration. */
    void applyFor(double tolerance, const Eigen::MatrixXd& forces, Eigen::MatrixXd& velocities) {
        applyWithin(errorFor(tolerance), forces, velocities);
    }
    /** The matrix itself. Default: apply() to the identity. */
    virtual void dense(Eigen::MatrixXd& mobility);
    /** Its inverse. Default: by Cholesky's factors of dense(). @throws OpenMMException if M is not
     * positive definite */
    virtual void friction(Eigen::MatrixXd& friction);
    /** What all particles do because each resists the strain of a flow by its stresslet; added to
     * rows of particles. Default: nothing, there are none. */
    virtual void addStressletsOf(const DrivenFlow& flow, Eigen::MatrixXd& slips) {}
    /**
     * What the fluid's flow comes from when these forces act on particles: forces and, where
     * particles resist strain, stresslets; also that of a driven flow (null: none). Default: the
     * forces.
     */
    virtual FlowSources sources(const Eigen::MatrixXd& forces, const DrivenFlow* flow) {
        return {forces, {}};
    }
    /** velocities += factor times what such sources make of the fluid at points, driven flow not
     * included. @throws OpenMMException if the model does not know it (default) */
    virtual void addFlowAt(const FlowSources& sources, const std::vector<OpenMM::Vec3>& points,
                           double factor, Velocities& velocities);
    /** Seconds of the caller's thread in products with a grid; 0 for other models. */
    virtual double getSecondsOfGrid() const { return secondsOfGrid; }

protected:
    friend class MobilityModel;
    /**
     * Be at this placement from now on, to which the model does not object, or (nearby) which it
     * accepts as a small way from such a one. What was cached is to be forgotten, memory kept.
     */
    virtual void moveTo(const Placement& placement, bool nearby) = 0;

    const HydrodynamicParticles& particles;
    const double viscosity;
    double secondsOfGrid = 0;
};

}  // namespace RigidHIPlugin

#endif
