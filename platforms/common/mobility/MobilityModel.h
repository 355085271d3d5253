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
 * @param stresslets  whether there are 5 more rows for each particle, after all others
 */
Eigen::VectorXd rootsOfOwnFriction(const HydrodynamicParticles& particles, bool stresslets = false);

/**
 * @throws OpenMMException  always: the mobility matrix of so many particles is not positive
 *     definite. The message says where to look.
 */
[[noreturn]] void refuseIndefiniteMobility(int numParticles);
/** Likewise for the friction matrix of so many bodies. */
[[noreturn]] void refuseIndefiniteFriction(int numBodies);

/**
 * How the fluid couples particles: all that does not depend on where they are. A model is
 * immutable, so several threads may ask any number of its MobilityAt objects at once.
 *
 * A new model is two classes: a MobilityModel with its traits and makePlace(), and its MobilityAt
 * with multiply(). Where the model can do better than a default, it overrides it.
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
    /** What the model says about itself. */
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
     * Likewise for a finite difference: the placement is a small way from an accepted one. If the
     * accepted placement is at the limit of what the model accepts, the small way may lead beyond
     * the limit. A model whose formulas hold there too (MobilityTraits::holdsNearby) accepts it.
     */
    std::unique_ptr<MobilityAt> near(const Placement& placement) const;
    /**
     * at() and near() with the memory of a MobilityAt that this model has made before; null at
     * first. Cached results are forgotten. If the model refuses the placement, the MobilityAt stays
     * as it was.
     */
    void place(std::unique_ptr<MobilityAt>& at, const Placement& placement) const;
    void placeNear(std::unique_ptr<MobilityAt>& at, const Placement& placement) const;

    // ---- A flow that is present without particles
    /**
     * The velocities of particles that follow a flow, and the angular velocities where there are
     * rows for them. Each particle is taken by itself: its velocities are averages as the model
     * takes them of its own flows. MobilityAt::addStressletsOf() adds what the strain does by
     * stresslets.
     */
    void follow(const DrivenFlow& flow, const Placement& placement, Eigen::MatrixXd& slips) const;
    /**
     * The factors s(k) and t(k) of the averages of a wave exp(ikx) that belong to a particle's
     * force and torque, and that of the Laplacian. Default: those of waves much longer than the
     * radius. A model between no-slip planes must know that of the Laplacian.
     */
    virtual WaveFactors waveFactors(double radius, double k) const { return {}; }

    // ---- Where the model has a mobility
    /**
     * Why the model has no mobility at this placement (overlap, a position beyond a wall), naming
     * the particles; empty where it has one. A step that leads to such a placement is redone with
     * new noise. Default: the model has a mobility everywhere.
     */
    virtual std::string objection(const Placement& placement) const { return {}; }
    /** Whether near() accepts this placement. Default: it does where objection() is empty. */
    virtual bool acceptsNearby(const Placement& placement) const {
        return !traits.mayObject || objection(placement).empty();
    }
    /**
     * The position at which the formulas take a particle to be. Two particles of one radius at one
     * such position make the matrix singular. Default: the particle's own position. Where surfaces
     * may reach through a wall, the formulas lift such particles to contact.
     */
    virtual OpenMM::Vec3 placeInFormulas(int particle, const OpenMM::Vec3& position) const {
        return position;
    }
    /**
     * What the formulas multiply the velocities of a particle at this position by, relative to the
     * nearest wall, and its forces on the fluid: less than 1 where they lift it to contact. It is
     * asked for between no-slip planes (DrivenFlow::hasPlanes) alone. Default: 1.
     */
    virtual double weightInFormulas(int particle, const OpenMM::Vec3& position) const { return 1; }

    /** Which spheres have lubrication and how far it reaches, for describeEffects(). Default: the
     * model's name says it. */
    virtual std::string describeLubrication() const { return {}; }

    // ---- What some models have and others lack: null where the model lacks it
    /** The periodic box. */
    virtual const BoxOfModel* box() const { return nullptr; }
    /** The grid that the fluid is solved on. */
    virtual const GridOfModel* grid() const { return nullptr; }
    /** Random fields, which take the place of square roots of M. */
    virtual const FieldOfModel* randomField() const { return nullptr; }

    // ---- Products that take less time than sums over all pairs
    /** Whether MobilityAt::multiply() makes products of such an error in less time than a sum over
     * all pairs takes. Default: it does not. */
    virtual bool hasFastProducts(double error) const { return false; }
    /** How it makes these products, for describeEffects(). Empty where it has none. */
    virtual std::string describeFastProducts(double error) const { return {}; }

    // ---- A body by itself
    /**
     * The matrix of one body's particles alone in unbounded fluid, at their sites in the body
     * frame. Preconditioners and own tensors start from this matrix. Default: that of
     * RotnePragerYamakawa, in which a sphere has its Stokes drag.
     */
    virtual void ownMobility(const HydrodynamicParticles& body,
                             const std::vector<OpenMM::Vec3>& sites,
                             Eigen::MatrixXd& mobility) const;

    /**
     * A model of spheres without torque that stand for groups of particles, in the same fluid. It
     * has a mobility wherever the particles have one, even if spheres reach through a wall. It may
     * be coarse: it makes square roots of this model cheaper, and not different
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
