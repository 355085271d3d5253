#ifndef RIGIDHI_MOBILITY_MODEL_H_
#define RIGIDHI_MOBILITY_MODEL_H_

#include <Eigen/Core>
#include <memory>
#include <string>
#include <vector>

#include "mobility/DrivenFlow.h"
#include "mobility/MobilityAt.h"
#include "mobility/MobilityTraits.h"
#include "mobility/ModelFacets.h"

namespace RigidHIPlugin {

/**
 * The hydrodynamic particles that feel each other, in the order of their rows. These data do not
 * change in a step.
 *
 * A particle with torque (a sphere) has six rows: force then torque, or velocity then angular
 * velocity. A particle without torque (a blob of a rigid multiblob, or a free particle) has three.
 */
struct HydrodynamicParticles {
    std::vector<double> radii;     // nm
    std::vector<char> hasTorque;   // whether the particle has rows for torque and angular velocity
    std::vector<int> firstRow;     // of each particle
    std::vector<int> systemIndex;  // index in the System, for messages
    std::vector<int> body;         // the body of each particle; -1: a free particle
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

/**
 * For each row, the root of a particle's own friction over 6 pi viscosity.
 *
 * @param stresslets  whether five more rows for each particle follow all other rows
 */
Eigen::VectorXd rootsOfOwnFriction(const HydrodynamicParticles& particles, bool stresslets = false);

/**
 * @throws OpenMMException  always, because the mobility matrix of so many particles is not positive
 *     definite. The message names a likely cause.
 */
[[noreturn]] void refuseIndefiniteMobility(int numParticles);
/** Likewise for the friction matrix of so many bodies. */
[[noreturn]] void refuseIndefiniteFriction(int numBodies);

/**
 * How the fluid couples particles: everything that does not depend on their positions. A model is
 * immutable, so several threads may ask any number of its MobilityAt objects at once.
 *
 * A new model is two classes: a MobilityModel with its traits and makePlace(), and its MobilityAt
 * with multiply(). It overrides a default where the model has something better.
 */
class MobilityModel {
public:
    /** @param viscosity  dalton/(nm ps) */
    MobilityModel(const HydrodynamicParticles& particles, double viscosity,
                  const MobilityTraits& traits)
        : particles(particles), viscosity(viscosity), traits(traits) {}
    virtual ~MobilityModel() {}
    const HydrodynamicParticles& getParticles() const { return particles; }
    double getViscosity() const { return viscosity; }
    /** Properties of the model. */
    const MobilityTraits& getTraits() const { return traits; }
    /** The name of the model in messages: that of setModel(). */
    const char* name() const { return traits.name; }

    // ---- The model at a place
    /**
     * The mobility of one configuration. The model must outlive it.
     *
     * @throws OpenMMException with the text of objection(), if the model refuses the placement
     */
    std::unique_ptr<MobilityAt> at(const Placement& placement) const;
    /**
     * Likewise for a finite difference, at a small displacement from an accepted placement. If the
     * accepted placement is at the limit of what the model accepts, the displacement may lead
     * beyond the limit. A model whose formulas hold there, too (MobilityTraits::holdsNearby),
     * accepts it.
     */
    std::unique_ptr<MobilityAt> near(const Placement& placement) const;
    /**
     * at() and near() that reuse the memory of a MobilityAt that this model made earlier; a null
     * pointer gets a new object. The object drops its cached results. If the model refuses the
     * placement, the object stays unchanged.
     */
    void place(std::unique_ptr<MobilityAt>& at, const Placement& placement) const;
    void placeNear(std::unique_ptr<MobilityAt>& at, const Placement& placement) const;

    // ---- A driven flow
    /**
     * The velocities of particles that follow a flow, with angular velocities for particles that
     * have rows for them. Each particle is alone in the flow: its velocities are the averages that
     * the model also takes of its own flows. MobilityAt::addStressletsOf() adds the velocities
     * induced by stresslets.
     */
    void follow(const DrivenFlow& flow, const Placement& placement, Eigen::MatrixXd& slips) const;
    /**
     * The factors of the averages of a wave exp(ikx) over a particle: s(k) belongs to its force,
     * t(k) to its torque, and `laplacian` to the Laplacian. Default: the values for waves much
     * longer than the radius. A model between no-slip planes must override `laplacian`.
     */
    virtual WaveFactors waveFactors(double radius, double k) const { return {}; }

    // ---- Where the model has a mobility
    /**
     * The reason why the model has no mobility at this placement (overlap, a position beyond a
     * wall), with the names of the particles; empty where it has one. The integrator repeats a step
     * that leads to such a placement with new noise. Default: the model has a mobility everywhere.
     */
    virtual std::string objection(const Placement& placement) const { return {}; }
    /** Whether near() accepts this placement. Default: where objection() is empty. */
    virtual bool acceptsNearby(const Placement& placement) const {
        return !traits.mayObject || objection(placement).empty();
    }
    /**
     * The position that the formulas use for a particle. Two particles of one radius at one such
     * position make the matrix singular. Default: the particle's own position. A model whose
     * surfaces may reach through a wall lifts such particles to contact.
     */
    virtual OpenMM::Vec3 placeInFormulas(int particle, const OpenMM::Vec3& position) const {
        return position;
    }
    /**
     * The weight with which the formulas multiply the velocities of a particle at this position,
     * relative to the nearest wall, and its forces on the fluid. It is less than 1 where the
     * formulas lift the particle to contact. Only flows with no-slip planes ask for it
     * (DrivenFlow::hasPlanes). Default: 1.
     */
    virtual double weightInFormulas(int particle, const OpenMM::Vec3& position) const { return 1; }

    /**
     * Which spheres have lubrication and how far it reaches, for describeEffects(). Default: empty,
     * if the model's name says enough.
     */
    virtual std::string describeLubrication() const { return {}; }

    // ---- Optional parts: null where the model lacks one
    /** The periodic box. */
    virtual const BoxOfModel* box() const { return nullptr; }
    /** The grid that the fluid is solved on. */
    virtual const GridOfModel* grid() const { return nullptr; }
    /** Random fields, which replace square roots of M. */
    virtual const FieldOfModel* randomField() const { return nullptr; }

    // ---- Products that take less time than sums over all pairs
    /**
     * Whether MobilityAt::multiply() makes products with this error in less time than a sum over
     * all pairs takes. Default: no.
     */
    virtual bool hasFastProducts(double error) const { return false; }
    /** The method for these products, for describeEffects(). Empty without fast products. */
    virtual std::string describeFastProducts(double error) const { return {}; }

    // ---- A single body
    /**
     * The matrix of one body's particles alone in unbounded fluid, at their sites in the body
     * frame. Preconditioners and own tensors start from this matrix. Default: the matrix of
     * RotnePragerYamakawa, in which a sphere has its Stokes drag.
     */
    virtual void ownMobility(const HydrodynamicParticles& body,
                             const std::vector<OpenMM::Vec3>& sites,
                             Eigen::MatrixXd& mobility) const;

    /**
     * A model of spheres without torque that stand for groups of particles, in the same fluid. It
     * has a mobility wherever the particles have one, even if spheres reach through a wall. It may
     * be coarse: it makes square roots of this model cheaper without changing them
     * (CollectiveModes). Default, for models whose roots do not need it: null.
     */
    virtual std::unique_ptr<MobilityModel> forCollectiveModes(
        const HydrodynamicParticles& spheres) const {
        return nullptr;
    }

protected:
    /** A MobilityAt of this model that has no placement yet. */
    virtual std::unique_ptr<MobilityAt> makePlace() const = 0;

    const HydrodynamicParticles particles;
    const double viscosity;
    const MobilityTraits traits;
};

}  // namespace RigidHIPlugin

#endif
