#ifndef RIGIDHI_FLUID_CHECKS_H_
#define RIGIDHI_FLUID_CHECKS_H_

#include <string>
#include <vector>

#include "fluid/FluidContents.h"

namespace RigidHIPlugin {

/** @throws OpenMMException for an objection to bodies that are held or wholly prescribed */
[[noreturn]] void refusePrescribedMotion(const std::string& objection);

/** Whether steps can go on from the present poses and forces. */
class FluidChecks {
public:
    explicit FluidChecks(const FluidContents& fluid) : fluid(fluid) {}
    /**
     * Why the model has no mobility at the present poses, naming particles; empty if it has one.
     */
    std::string objection(const BodySet& bodies, const std::vector<OpenMM::Vec3>& positions) const;
    /**
     * objection() to the held and wholly prescribed elements alone, if any is prescribed: no noise
     * can change their poses.
     */
    std::string objectionToWhollyFixed(const BodySet& bodies,
                                       const std::vector<OpenMM::Vec3>& positions) const;
    /** Whether objection() can ever return a reason. */
    bool mayObject() const;
    /**
     * Check that the forces last gathered do not turn bodies about the line of their collinear
     * blobs, where neither fluid nor inertia resists.
     * @param forces  on all particles; their size gives the size of rounding errors
     * @throws OpenMMException naming the body, for a torque beyond rounding
     */
    void checkTorques(const BodySet& bodies, const std::vector<OpenMM::Vec3>& forces) const;

private:
    const FluidContents& fluid;
};

}  // namespace RigidHIPlugin

#endif
