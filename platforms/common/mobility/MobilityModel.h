#ifndef RIGIDHI_MOBILITY_MODEL_H_
#define RIGIDHI_MOBILITY_MODEL_H_

#include <Eigen/Core>
#include <memory>
#include <string>
#include <vector>

#include "mobility/DrivenFlow.h"
#include "mobility/GridSeconds.h"
#include "mobility/MobilityAt.h"
#include "mobility/RandomField.h"
#include "random/CounterNoise.h"

namespace RigidHIPlugin {

/**
 * The hydrodynamic particles that feel each other, in the order of their rows. What does not change
 * in a step.
 *
 * A particle with torque (a sphere) has six rows, force then torque (velocity then angular
 * velocity); one without (a blob of a rigid multiblob, or a free particle) has three.
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

/** @throws OpenMMException  always: the mobility matrix of so many particles is not positive
 * definite, and where to look */
[[noreturn]] void refuseIndefiniteMobility(int numParticles);
/** Likewise the friction matrix of so many bodies. */
[[noreturn]] void refuseIndefiniteFriction(int numBodies);
/**
 * A tolerance in a message: the one that the user has set, and the part of it that is left for an
 * iteration.
 *
 * @param wanted  the former; 0: it is the iteration's own
 */
std::string toleranceText(double tolerance, double wanted);

/**
 * How the fluid couples particles: what does not depend on where they are. Immutable, so that any
 * number of places may be asked at once, by several threads.
 *
 * A new model is two classes: this one, with name() and makePlace(), and its MobilityAt, with
 * apply(); what it can do better than by the defaults it overrides.
 */
class MobilityModel {
public:
    /** @param viscosity  dalton/(nm ps) */
    MobilityModel(const HydrodynamicParticles& particles, double viscosity)
        : particles(particles), viscosity(viscosity) {}
    virtual ~MobilityModel() {}
    const HydrodynamicParticles& getParticles() const { return particles; }
    double getViscosity() const { return viscosity; }
    /** The model in messages: that of setModel(). */
    virtual const char* name() const = 0;

    // ---- The model at a place
    /**
     * The mobility of one configuration. The model must outlive it.
     *
     * @throws OpenMMException with the objection(), if there is one
     */
    std::unique_ptr<MobilityAt> at(const Placement& placement) const;
    /**
     * Likewise for a finite difference, a small way from an accepted placement: where that touches
     * the limit of what the model accepts, the small way may lead beyond. A model whose formulas
     * hold there too (holdsNearby()) takes it.
     */
    std::unique_ptr<MobilityAt> near(const Placement& placement) const;
    /**
     * at() and near() with the memory of a place that this model has made before; null at first.
     * What was cached is forgotten. If the model objects, the place stays as it was.
     */
    void place(std::unique_ptr<MobilityAt>& at, const Placement& placement) const;
    void placeNear(std::unique_ptr<MobilityAt>& at, const Placement& placement) const;

    // ---- Noise
    /**
     * Draw the model's own random field, where it has one (hasOwnRandomField()); without, nothing
     * is done.
     *
     * @param purpose  of the random numbers: with the noise's seed and step it says which they are
     * @param field    that of an earlier draw of this model, whose memory is taken, or null
     */
    virtual void drawField(const NoiseStream& noise, uint32_t purpose, const BoxVectors& box,
                           std::unique_ptr<RandomField>& field) const {}

    // ---- A flow that is there without particles
    /**
     * Velocities of particles that go with a flow, and angular velocities where there are rows for
     * them, each particle by itself: averages as the model takes them of its own flows. What strain
     * does by stresslets MobilityAt::addStressletsOf() adds.
     */
    void follow(const DrivenFlow& flow, const Placement& placement, Eigen::MatrixXd& slips) const;
    /** What a particle averages of a wave exp(ikx): the s(k) and t(k) of its force and torque.
     * Default: of waves much longer than the radius. */
    virtual WaveFactors waveFactors(double radius, double k) const { return {}; }
    /**
     * Volume of the fluid in the box, nm^3, between walls where there are some; 0: it is not
     * bounded. Sources make of a wave sin(kx) along the direction a the amplitude 2/(eta k^2 V)
     * times their power on a flow of unit amplitude: M is symmetric.
     */
    virtual double fluidVolume(const BoxVectors& box) const { return 0; }
    /** Whether particles resist strain by stresslets of their own. Default: no. */
    virtual bool hasStresslets() const { return false; }
    /** @throws OpenMMException if a wave of so many periods along an axis of the box is too short
     * for the model. Default: it is not */
    virtual void checkWave(const BoxVectors& box, int axis, int periods) const {}

    // ---- Where it has a mobility
    /**
     * Why the model has no mobility at this placement (overlap, beyond a wall), naming the
     * particles; empty where it has one. A step that leads there is redone with new noise. Default:
     * the model has one everywhere.
     */
    virtual std::string objection(const Placement& placement) const { return {}; }
    /** Whether objection() can ever object. */
    virtual bool mayObject() const { return false; }
    /** Whether near() takes this placement. Default: where there is no objection(). */
    virtual bool acceptsNearby(const Placement& placement) const {
        return !mayObject() || objection(placement).empty();
    }
    /**
     * Where the formulas take a particle to be: two of one radius at one such place make the matrix
     * singular. Default: where it is. A wall through which surfaces reach lifts particles to
     * contact.
     */
    virtual OpenMM::Vec3 placeInFormulas(int particle, const OpenMM::Vec3& position) const {
        return position;
    }

    // ---- Traits
    /** Whether the mobility of particles stays the same when all are shifted alike: not next to a
     * wall. Default: no. */
    virtual bool isHomogeneous() const { return false; }
    /** Whether it turns with the particles: neither next to a wall nor in a periodic box. Default:
     * no. */
    virtual bool isIsotropic() const { return false; }
    /** Whether the fluid is its own reflection at y = 0, where particles then have images that are
     * not in the list. Default: no. */
    virtual bool isMirrored() const { return false; }
    /** Whether MobilityAt::applyRoughly() takes less time than apply(), so that iterations should
     * use it where they can. Default: no. */
    virtual bool hasRoughProducts() const { return false; }
    /** Whether MobilityAt::apply() needs no matrix, so that Krylov methods make sense. */
    virtual bool hasProducts() const { return true; }
    /** Whether dense() is products with the columns of the identity, so that it serves few rows
     * only. Default: no. */
    virtual bool isMatrixFree() const { return false; }
    /** Whether near() keeps something of the placement before, as the nodes of a grid that a
     * particle sees. Default: no. */
    virtual bool isAnchored() const { return false; }
    /** Whether MobilityAt::friction() costs less than dense(), so that callers who can use either
     * should ask for friction. */
    virtual bool isMadeFromFriction() const { return false; }
    /**
     * Whether sum_j dM_ij/dx_j = 0 wherever the particles are, as for averages of a flow without
     * sources over spheres in a fluid without walls. Spheres and free particles then have no
     * stochastic drift. Default: no.
     */
    virtual bool isDivergenceFree() const { return false; }
    /** Whether drawField() gives noise that costs less than square roots of M. Default: no, so that
     * roots are taken. */
    virtual bool hasOwnRandomField() const { return false; }
    /**
     * Whether what a particle sees of that field depends on its own place only, so that it is one
     * flow. If not, fields at different placements have the covariance M each by itself, and
     * divergences are found as of square roots. Default: it is.
     */
    virtual bool fieldIsLocal() const { return true; }
    /**
     * The mobility of bodies takes less time by iterations, column by column, than by a factor of
     * dense() if there are more rows of particles than this for each row of bodies. The ratio of
     * both times is proportional to it. Measured on one thread with shells of 642 blobs near a
     * wall, at a tolerance of 1e-6.
     */
    virtual double rowsWorthIterations() const { return 1750; }

    // ---- The box, and the grid in it
    /** @throws OpenMMException  if the model cannot have such a box, naming it and the remedy.
     * Default: it can */
    virtual void checkBox(const BoxVectors& box) const {}
    /** What is to be said of the model in a box, for describeEffects(). Default: nothing. */
    virtual std::string describe(const BoxVectors& box) const { return {}; }
    /** Whether MobilityAt::applyWithin() makes products of such an error in less time than a sum
     * over all pairs takes. Default: it does not. */
    virtual bool hasFastProducts(double error) const { return false; }
    /** How it makes them, for describeEffects(). Empty where it has none. */
    virtual std::string describeFastProducts(double error) const { return {}; }
    /** What a grid has taken so far, with models that share it. Default: there is none. */
    virtual GridSeconds getGridSeconds() const { return {}; }

    // ---- A body by itself
    /**
     * The matrix of one body's particles alone in unbounded fluid, at their sites in its frame:
     * where preconditioners and own tensors start from. Default: that of RotnePragerYamakawa, in
     * which a sphere has its Stokes drag.
     */
    virtual void ownMobility(const HydrodynamicParticles& body,
                             const std::vector<OpenMM::Vec3>& sites,
                             Eigen::MatrixXd& mobility) const;

protected:
    /** A place without particles yet, for this model. */
    virtual std::unique_ptr<MobilityAt> makePlace() const = 0;
    /** Whether formulas hold a little beyond what objection() allows, as finite differences from
     * there need it. */
    virtual bool holdsNearby() const { return false; }

    const HydrodynamicParticles particles;
    const double viscosity;
};

}  // namespace RigidHIPlugin

#endif
