#ifndef RIGIDHI_COUPLED_BODIES_H_
#define RIGIDHI_COUPLED_BODIES_H_

#include <Eigen/Core>
#include <functional>
#include <memory>
#include <vector>

#include "mobility/MobilityModel.h"
#include "rigid/FluidElement.h"
#include "rigid/ForcesOnFluid.h"
#include "rigid/FreeMotion.h"
#include "rigid/NullTwists.h"
#include "rigid/OwnTensors.h"
#include "rigid/RigidMotion.h"

namespace RigidHIPlugin {

/**
 * Rigid bodies that feel each other through the fluid: the data that do not depend on the bodies'
 * poses. BodiesAt has the same bodies at one configuration.
 *
 * The mobility of the bodies follows from that of their particles, N = (K^T M^-1 K)^-1, where the
 * rows of K give the velocities of the particles from V and W of their body (Westwood 2022, eqs. 7
 * to 10). A sphere carries force and torque, the blobs of a multiblob carry forces only. Where all
 * blobs of a body are on a line, its mobility is the generalised inverse that NullTwists describes.
 *
 * Rows: six for a body (V, W about its origin; lab frame), then three for each free particle, in
 * the order of the elements.
 */
class CoupledBodies {
public:
    using ModelFactory =
        std::function<std::unique_ptr<MobilityModel>(const HydrodynamicParticles&)>;
    /**
     * @param elements       elements that feel each other
     * @param makeModel      makes the model of given particles
     * @param mayBeConstant  false: compute the tensor at every pose even if a body is alone in a
     *     uniform fluid
     */
    CoupledBodies(const std::vector<FluidElement>& elements, const ModelFactory& makeModel,
                  bool mayBeConstant = true);
    /** The same bodies in the same model and box, but with these spins, one for each element. */
    CoupledBodies(const CoupledBodies& bodies, const std::vector<SlowedSpin>& spins);

    const std::vector<FluidElement>& getElements() const { return motion.getElements(); }
    const HydrodynamicParticles& getParticles() const { return motion.getParticles(); }
    int getNumRows() const { return motion.getNumRows(); }
    int getNumParticleRows() const { return motion.getParticles().numRows; }
    int firstRow(int element) const { return motion.firstRow(element); }
    const RigidMotion& getMotion() const { return motion; }
    const NullTwists& getNullTwists() const { return nullTwists; }
    /** The null twists, with the components that are fixed (NullTwists::fix()). */
    const NullTwists& getNullTwistsOfFree() const { return nullTwistsOfFree; }
    const OwnTensors& getOwnTensors() const { return ownTensors; }
    /** Which components of twists are free. Where some are fixed, N stands for N_c. */
    const FreeMotion& getFreeMotion() const { return freeMotion; }
    /** The model of all particles. */
    const MobilityModel& getModel() const { return *model; }
    /** Whether the elements have particles. If not, a body has its own tensor only. */
    bool hasModel() const { return model != nullptr; }
    /**
     * Whether the element's friction has a null vector, because its blobs are on a line.
     * getNullVector_body() gives this vector in the element's frame (unit length).
     */
    bool hasNullVector(int element) const { return nullTwists.has(element); }
    const Eigen::VectorXd& getNullVector_body(int element) const {
        return nullTwists.inBody(element);
    }
    /**
     * The mobility and the friction of an element by itself in unbounded fluid, in its own frame:
     * its own tensors, or the model's tensors. A free particle has three rows. The cost is that of
     * a Cholesky factor of the mobility of the element's particles.
     */
    struct Alone {
        Eigen::MatrixXd mobility, friction;
    };
    Alone alone(int element) const;
    /**
     * The longest distance between points of the element's particles, nm. Finite differences scale
     * translations with this length.
     */
    double length(int element) const;

    /** Set the vectors of the periodic box, from the next poses on; zeros: no box. */
    void setBox(const BoxVectors& vectors) { box = vectors; }
    const BoxVectors& getBox() const { return box; }

    // ---- Properties that decide between strategies
    /** Whether the bodies are a single element in a fluid that is the same everywhere. */
    bool isAloneInUniformFluid() const { return aloneInUniformFluid; }
    /** Whether N is the same at all poses, except for the rotation of one body. */
    bool isUniform() const { return aloneInUniformFluid && !freeMotion.any(); }
    /** Whether no component is free, so that N = 0. */
    bool isImmobile() const { return freeMotion.getNumFree() == 0; }
    /**
     * Whether the tensor is that of one body in a homogeneous fluid. This tensor is constant in the
     * body's frame.
     */
    bool isConstantInBodyFrame() const { return aloneInUniformFluid && !getElements()[0].isFree(); }
    /**
     * Whether div N = 0 at all poses. The mobility of spheres about their centres does not depend
     * on orientations, so its divergence is that of the particles' mobility. Beside held bodies
     * spheres have a divergence.
     */
    bool isDivergenceFree() const {
        return motion.isIdentity() && !freeMotion.any() && !ownTensors.any() && model &&
               model->getTraits().isDivergenceFree;
    }
    /**
     * Whether slips belong to bodies because no M exists: one body with a constant tensor, own
     * tensors, models made from friction.
     */
    bool slipsAreOfBodies() const {
        return isConstantInBodyFrame() || ownTensors.any() || !model ||
               model->getTraits().isMadeFromFriction;
    }
    /** Whether the friction is the matrix that costs less. */
    bool prefersFriction() const {
        return !motion.isIdentity() || freeMotion.any() ||
               (model && model->getTraits().isMadeFromFriction);
    }
    /** Whether some body has a slip of its own or exerts a force on the fluid. */
    bool areActive() const { return active || forcesOnFluid; }
    /** The forces that bodies exert on the fluid at sites; null: none. */
    const ForcesOnFluid* getForcesOnFluid() const { return forcesOnFluid.get(); }
    /**
     * The rate at which the slip of an active body spins it about the axis of its SlowedSpin, alone
     * in unbounded fluid, rad/ps; 0 where the spin is not slowed.
     */
    double spinOfSlips(int element) const { return spinsOfSlips[element]; }
    /** Whether the model has products, so that products with N need no matrix. */
    bool hasProducts() const {
        return model && model->getTraits().hasProducts &&
               (!model->getTraits().slipsOfParts || (motion.isIdentity() && !freeMotion.any()));
    }
    /** Whether products with the model are iterations themselves (MobilityTraits). */
    bool productsIterate() const { return model && model->getTraits().productsIterate; }
    /** Whether products with N need no iterations, and so have no error of iterations: spheres. */
    bool multipliesWithoutIterations() const {
        return motion.isIdentity() && !freeMotion.any() && hasProducts() && !productsIterate();
    }
    /**
     * Whether iterations, column by column, compute N in less time than factors. The answer depends
     * on numbers of rows only, so it is the same on any machine.
     */
    bool isWorthIterations() const {
        return hasProducts() && !multipliesWithoutIterations() && !productsIterate() &&
               getNumParticleRows() > model->getTraits().rowsWorthIterations * getNumRows();
    }

private:
    void findProperties(bool mayBeConstant);
    Alone aloneInModel(int element) const;
    void findSpinOfSlips(int element);
    void checkForcesOnFluid(int element) const;
    void checkSites(int element) const;

    const RigidMotion motion;
    const FreeMotion freeMotion;
    NullTwists nullTwists, nullTwistsOfFree;
    OwnTensors ownTensors;
    std::shared_ptr<const MobilityModel> model;
    bool aloneInUniformFluid = false, active = false;
    std::vector<double> spinsOfSlips;
    std::shared_ptr<const ForcesOnFluid> forcesOnFluid;
    BoxVectors box = {};
};

}  // namespace RigidHIPlugin

#endif
