#ifndef RIGIDHI_MOMENTUM_HOLDS_H_
#define RIGIDHI_MOMENTUM_HOLDS_H_

#include <Eigen/Core>
#include <vector>

#include "fluid/BrownianGroup.h"
#include "fluid/Relaxation.h"

namespace RigidHIPlugin {

/**
 * The wrenches that held the fixed components of a group in the last step of LangevinHI, on average
 * over the step. Steps only note the data from which these wrenches follow. find() computes the
 * wrenches when a user asks for them.
 *
 * Equation:  with P the momenta of the free bodies (f), o the fixed components and dB the noise,
 *            dP = -xi_ff (U_f - U_flow) dt + dB_f,
 *            hold dt = (xi_oo U_o + xi_of U_f) dt - dB_o - F_o dt
 *                    = (lambda of force-free bodies)_o dt - xi_of xi_ff^-1 dP - F_o dt - dB',
 *            where dB' is independent of the motion and has the covariance 2 kT N_oo^-1 dt.
 * Method:    the mobility problem of a scheme without momenta, with the wrenches -dP/dt and a
 *            thermal wrench on all components. The part of this wrench along xi_of xi_ff^-1 drops
 *            out.
 */
class MomentumHolds {
public:
    /** @param tolerance  of iterations, as the user has set it */
    MomentumHolds(const GroupMembers& members, BrownianGroup& group, double tolerance)
        : members(members), group(group), tolerance(tolerance) {}
    /** Note the forces at the start of a step. */
    void begin(const BodySet& bodies, const FreeParticles& freeParticles);
    /**
     * Note the middle of the step.
     *
     * @param relaxation  the one that has just run; null: no component of the group is free
     */
    void noteMiddle(const std::vector<Pose>& poses, const Relaxation* relaxation,
                    const RelaxationStep& step);
    /** Note the forces at the end of the step. */
    void end(const BodySet& bodies, const FreeParticles& freeParticles);
    /** Forget the last step. */
    void forget() { isPending = false; }
    /** Give the group its holds (BrownianGroup::setHolds()), if its last step was noted here. */
    void find();

private:
    struct Noted {
        std::vector<Pose> poses;
        Eigen::MatrixXd forces, impulses, prescribed;  // prescribed has no rows if nothing is
        DrivenFlow flow;
        bool hasFlow = false;
        double h = 0, kT = 0;
        NoiseStream noise;
    };
    const GroupMembers& members;
    BrownianGroup& group;
    const double tolerance;
    Noted present, last;
    Eigen::MatrixXd forcesAtEnd;
    bool isPending = false;
};

}  // namespace RigidHIPlugin

#endif
