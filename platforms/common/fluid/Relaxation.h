#ifndef RIGIDHI_RELAXATION_H_
#define RIGIDHI_RELAXATION_H_

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "fluid/MomentumScaling.h"
#include "host/PlatformLoops.h"
#include "linearalgebra/Lanczos.h"
#include "schemes/FluidOrnsteinUhlenbeck.h"

namespace RigidHIPlugin {

/** The fluid's part of a step of LangevinHI, and what it acts upon. */
struct RelaxationStep {
    double h, kT;
    const NoiseStream& noise;
    BodySet& bodies;
    const FreeParticles& freeParticles;
    std::vector<OpenMM::Vec3>& velocities;
    PlatformLoops& loops;
    const DrivenFlow* flow;  // null: none
};

/**
 * The effect of the fluid on the momenta of one group in a step of LangevinHI (Davidchack 2017, eq.
 * 26): the exact Ornstein-Uhlenbeck process of Z at the present poses. In a driven flow the process
 * is that of the momenta relative to those of bodies that go with the flow without forces (about
 * axes without moments bodies turn with the flow). Each strategy of BodyMobility has a class of its
 * own, made by makeRelaxation().
 */
class Relaxation {
public:
    Relaxation(BodyMobility& mobility, const MomentumScaling& scaling)
        : mobility(mobility), scaling(scaling) {}
    virtual ~Relaxation() {}
    BodyMobility& getMobility() const { return mobility; }
    /**
     * Change momenta of bodies and velocities of free particles over the time h. @param poses  of
     * the elements
     */
    void relax(const std::vector<Pose>& poses, const RelaxationStep& step);
    /** Of the last step. */
    long long getNumRandomNumbers() const { return randomNumbers; }
    long long getNumIterations() const { return iterations; }
    int getNumRows() const { return scaling.getNumRows(); }
    bool isFinite() const { return Z.allFinite(); }

protected:
    /** Called before anything is asked of the mobility in a step: others ask it in between, to
     * tolerances of their own. */
    virtual void prepare() {}
    /** Z and chi are those of this step; Z(0) becomes Z(h). */
    virtual void evolve(const RelaxationStep& step) = 0;

    BodyMobility& mobility;
    MomentumScaling scaling;
    Eigen::VectorXd Z, chi;
    long long iterations = 0;

private:
    void takeMomenta(const RelaxationStep& step);
    void giveMomenta(const RelaxationStep& step) const;
    void takeMomentaOfFlow(const RelaxationStep& step);
    Eigen::MatrixXd twists, Z_flow;  // of force-free bodies in the flow
    long long randomNumbers = 0;
};

/**
 * Make the Relaxation for the strategy of this mobility.
 *
 * @param tolerance  of KrylovMobility, as the user has set it
 */
std::unique_ptr<Relaxation> makeRelaxation(BodyMobility& mobility, const MomentumScaling& scaling,
                                           double tolerance);

}  // namespace RigidHIPlugin

#endif
