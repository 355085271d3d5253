#ifndef RIGIDHI_STRESS_READER_H_
#define RIGIDHI_STRESS_READER_H_

#include <Eigen/Core>

#include "fluid/FlowReader.h"
#include "fluid/FluidContents.h"

namespace RigidHIPlugin {

/** The stress that bodies add to a periodic fluid, by parts, kJ/(mol nm^3). */
struct StressParts {
    Eigen::Matrix3d hydrodynamic, brownian, interparticle, ideal;
};

/**
 * Reads the stress of the bodies in a periodic fluid at present poses and forces:
 *
 *     stress = -(sum of S + sum of X F)/V - n kT.
 *
 * S is the symmetric part without trace of sum (x - X) f over the particles of a body at X, plus
 * the stresslets of spheres where the model has them. f are forces on the fluid.
 *
 *     hydrodynamic    S of force-free bodies that resist the driven flow, or swim
 *     interparticle   S that forces and torques cause, and X F of these forces (a virial)
 *     Brownian        S of kT div(R N), where R N gives S from forces and torques: a random finite
 *                     difference, one sample whose mean is the Brownian stress
 *     ideal           -n kT
 */
class StressReader {
public:
    explicit StressReader(const FluidContents& fluid) : fluid(fluid) {}
    /** The settings of steps that the Brownian part needs. */
    struct Noise {
        double h, kT, difference;
        NoiseStream stream;
    };
    /** @throws OpenMMException for fluids whose bodies have no such stress */
    void check() const;
    /** @param virial  sum of F_a X_b, with nearest images, for a <= b */
    StressParts find(const FlowQuestion& question, const Noise& noise,
                     const Eigen::Matrix3d& virial) const;

private:
    Eigen::Matrix3d stressletsOf(const FluidGroup& group, const std::vector<Pose>& poses,
                                 const FlowSources& sources) const;
    Eigen::Matrix3d stressletsOfWrenches(const FluidGroup& group, BodyMobility& mobility,
                                         const std::vector<Pose>& poses,
                                         const Eigen::MatrixXd& wrenches, bool nearby,
                                         double error) const;
    const FluidContents& fluid;
};

}  // namespace RigidHIPlugin

#endif
