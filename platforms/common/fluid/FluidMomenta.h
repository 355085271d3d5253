#ifndef RIGIDHI_FLUID_MOMENTA_H_
#define RIGIDHI_FLUID_MOMENTA_H_

#include <vector>

#include "fluid/FluidContents.h"
#include "rigidbody/Thermostat.h"

namespace RigidHIPlugin {

/**
 * The effect of the fluid on momenta: its part of a step of LangevinHI.
 *
 * A Thermostat like that of Langevin C treats a body whose tensor is constant and isotropic (a
 * sphere about its centre, alone), and relax() has nothing to do for this body.
 */
class FluidMomenta {
public:
    explicit FluidMomenta(const FluidContents& fluid);
    /** Whether a matrix couples anything, so that relax() has something to do. */
    bool couplesBodies() const { return !coupledGroups.empty(); }
    /** Whether steps must stop in the middle: for relax(), or for fixed components. */
    bool needsMiddle() const { return couplesBodies() || fixesComponents; }
    /**
     * Check the inertia that LangevinHI needs, such as zero inertia about the line of collinear
     * blobs.
     * @throws OpenMMException
     */
    void checkInertia(const BodySet& bodies) const;
    /**
     * The factors of one step for a body that no matrix couples. For a coupled body they are all
     * zeros and ones.
     */
    Thermostat bodyThermostat(int body, const BodyInertia& inertia, double kT, double h) const;
    /**
     * The factors of one step for a free particle. @return false if the fluid does not see the
     * particle
     */
    bool freeThermostat(int freeParticle, double mass, double kT, double h,
                        Thermostat& thermostat) const;
    /**
     * Change momenta of bodies and velocities of free particles over the time h at the present
     * poses (Davidchack 2017, eq. 26).
     *
     * @param prescribed  velocities in the middle of the step, 6 for each body of the Context;
     *     null: none
     */
    LoopResult relax(double h, double kT, const NoiseStream& noise, BodySet& bodies,
                     const FreeParticles& freeParticles, const std::vector<OpenMM::Vec3>& positions,
                     std::vector<OpenMM::Vec3>& velocities, const Eigen::MatrixXd* prescribed);
    /**
     * Note the forces at the start and at the end of a step, for the wrenches that hold fixed
     * components.
     */
    void beginStep(const BodySet& bodies, const FreeParticles& freeParticles);
    void endStep(const BodySet& bodies, const FreeParticles& freeParticles);

private:
    const FluidContents& fluid;
    std::vector<FluidGroup*> coupledGroups;
    bool fixesComponents = false;
    double operationsPerStep = 0;  // of the coupled groups, roughly
};

}  // namespace RigidHIPlugin

#endif
