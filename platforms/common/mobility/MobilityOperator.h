#ifndef RIGIDHI_MOBILITY_OPERATOR_H_
#define RIGIDHI_MOBILITY_OPERATOR_H_

#include <openmm/Vec3.h>

#include <Eigen/Core>
#include <string>
#include <vector>

namespace RigidHIPlugin {

/**
 * The hydrodynamic particles that feel each other, in the order of their rows. What does not change in a step.
 *
 * A particle with torque (a sphere) has six rows, force then torque (velocity then angular velocity); one without (a blob of
 * a rigid multiblob, or a free particle) has three.
 */
struct HydrodynamicParticles {
    std::vector<double> radii;     // nm
    std::vector<char> hasTorque;   // whether the particle has rows for torque and angular velocity
    std::vector<int> firstRow;     // of each particle
    std::vector<int> systemIndex;  // index in the System, for messages
    std::vector<int> body;         // body it is in, -1: a free particle
    int numRows = 0;

    int size() const { return radii.size(); }
    void add(double radius, bool torque, int particle, int inBody) {
        radii.push_back(radius);
        hasTorque.push_back(torque);
        firstRow.push_back(numRows);
        systemIndex.push_back(particle);
        body.push_back(inBody);
        numRows += torque ? 6 : 3;
    }
};

/** @throws OpenMMException  always: the mobility matrix of so many particles is not positive definite, and where to look */
[[noreturn]] void refuseIndefiniteMobility(int numParticles);
/** Likewise the friction matrix of so many bodies. */
[[noreturn]] void refuseIndefiniteFriction(int numBodies);
/**
 * A tolerance in a message: the one that the user has set, and the part of it that is left for an iteration.
 *
 * @param wanted  the former; 0: it is the iteration's own
 */
std::string toleranceText(double tolerance, double wanted);

/**
 * How the fluid couples particles: velocities = M(positions) forces. A new model is one class with setPositions() and
 * apply(); what it can do better than by the defaults it overrides.
 *
 * All matrices are in the lab frame, with rows as HydrodynamicParticles says, in nm/(ps kJ/mol/nm) and so on. The matrix is
 * symmetric positive definite wherever setPositions() accepts the positions.
 */
class MobilityOperator {
public:
    /** @param viscosity  dalton/(nm ps) */
    MobilityOperator(const HydrodynamicParticles& particles, double viscosity)
        : particles(particles), viscosity(viscosity) {}
    virtual ~MobilityOperator() {}
    int getNumRows() const { return particles.numRows; }

    /**
     * Where the particles are, nm, one per hydrodynamic particle.
     *
     * @throws OpenMMException, naming the particles, where the model has no mobility (overlap, beyond a wall)
     */
    virtual void setPositions(const std::vector<OpenMM::Vec3>& positions) = 0;
    /**
     * Likewise for a finite difference, a small way from accepted positions: where these touch the limit of what the model
     * accepts, the small way may lead beyond. A model whose formulas hold there too takes them. Default: setPositions().
     */
    virtual void setPositionsNearby(const std::vector<OpenMM::Vec3>& positions) { setPositions(positions); }
    /** Whether that takes these positions. Default: those to which objection() does not object. */
    virtual bool acceptsNearby(const std::vector<OpenMM::Vec3>& positions) const {
        return !mayObject() || objection(positions).empty();
    }
    /**
     * Where the formulas take a particle to be: two of one radius at one such place make the matrix singular. Default: where it
     * is. A wall through which surfaces reach lifts particles to contact.
     */
    virtual OpenMM::Vec3 placeInFormulas(int particle, const OpenMM::Vec3& position) const { return position; }
    /**
     * Why the model has no mobility at these positions (overlap, beyond a wall), naming the particles; empty where it has one.
     * A step that leads to such positions is redone with new noise. Default: the model has one everywhere.
     */
    virtual std::string objection(const std::vector<OpenMM::Vec3>& positions) const { return {}; }
    /** Whether objection() can ever object. */
    virtual bool mayObject() const { return false; }
    /** velocities = M forces; every column is a case of its own. @param velocities  resized and overwritten */
    virtual void apply(const Eigen::MatrixXd& forces, Eigen::MatrixXd& velocities) const = 0;
    /** As apply(), right to `roughError` of the norm of M times that of the forces, where that takes less time. Default: apply(). */
    virtual void applyRoughly(const Eigen::MatrixXd& forces, Eigen::MatrixXd& velocities) const {
        apply(forces, velocities);
    }
    /** The error of applyRoughly(), and the tolerances of iterations that can do with it. */
    static constexpr double roughError = 1e-6, leastRoughTolerance = 5e-5;
    /** Either, for an iteration of this relative tolerance. */
    void applyFor(double tolerance, const Eigen::MatrixXd& forces, Eigen::MatrixXd& velocities) const {
        if (tolerance >= leastRoughTolerance)
            applyRoughly(forces, velocities);
        else
            apply(forces, velocities);
    }
    /** The matrix itself. Default: apply() to the identity. */
    virtual void dense(Eigen::MatrixXd& mobility) const;
    /** Its inverse. Default: by Cholesky's factors of dense(). @throws OpenMMException if M is not positive definite */
    virtual void friction(Eigen::MatrixXd& friction) const;
    /** Whether apply() needs no matrix, so that Krylov methods make sense. */
    virtual bool hasProducts() const { return true; }
    /**
     * Whether sum_j dM_ij/dx_j = 0 wherever the particles are, as for averages of a flow without sources over spheres in a fluid without
     * walls. Spheres and free particles then have no stochastic drift. Default: no.
     */
    virtual bool isDivergenceFree() const { return false; }
    /**
     * The mobility of bodies takes less time by iterations, column by column, than by a factor of dense() if there are more rows of
     * particles than this for each row of bodies. The ratio of both times is proportional to it. Measured on one thread with shells of 642
     * blobs near a wall, at a tolerance of 1e-6.
     */
    virtual double rowsWorthIterations() const { return 1750; }
    /** Whether friction() costs less than dense(), so that callers who can use either should ask for friction. */
    virtual bool isMadeFromFriction() const { return false; }

protected:
    const HydrodynamicParticles particles;
    const double viscosity;
};

}  // namespace RigidHIPlugin

#endif
