#ifndef RIGIDHI_FLUID_MEMORY_H_
#define RIGIDHI_FLUID_MEMORY_H_

#include "fluid/FluidContents.h"
#include "schemes/SchemeMemory.h"

namespace RigidHIPlugin {

class FlowReader;

/**
 * The data that groups without momenta remember from step to step: vectors that the scheme keeps
 * (OverdampedScheme::memory()), and the data to repeat the last step. Checkpoints and States
 * contain both.
 */
class FluidMemory {
public:
    /** @param flowReader  forgets its answer when another last step is set */
    FluidMemory(const FluidContents& fluid, FlowReader& flowReader)
        : fluid(fluid), flowReader(flowReader) {}
    /** Restore the scheme's vectors of the beginning of the step. */
    void restore();
    /** Empty the scheme's vectors. */
    void forget();
    /** The scheme's vectors, for saving. */
    SchemeMemory getOfScheme() const;
    /**
     * @throws OpenMMException if the vectors are not of these groups, or damaged. The check ignores
     *     vectors of another scheme
     */
    void checkOfScheme(const SchemeMemory& saved, CustomRigidHIIntegrator::Scheme scheme) const;
    /** Set the vectors. Errors are as in checkOfScheme(), and change nothing. */
    void setOfScheme(const SchemeMemory& saved, CustomRigidHIIntegrator::Scheme scheme);
    /** Take over the scheme's vectors of another fluid of this Context. */
    void continueFrom(const FluidMemory& before);

    /** The data of the last step, for saving; empty if no step is known. */
    SchemeMemory getLastStep() const;
    /**
     * @throws OpenMMException if the data are not of these groups, or damaged. The check ignores
     *     data of an unknown scheme
     */
    void checkLastStep(const SchemeMemory& saved) const;
    /** Set the data. Errors are as in checkLastStep(), and change nothing. */
    void setLastStep(const SchemeMemory& saved);
    /** The holds of bodies and particles in the last step; empty without any. */
    SchemeMemory getHolds() const;
    /** @throws OpenMMException if the data are not of these bodies and particles, or damaged */
    void checkHolds(const SchemeMemory& saved) const;
    /** Set the data. Errors are as in checkHolds(), and change nothing. */
    void setHolds(const SchemeMemory& saved);

private:
    const FluidContents& fluid;
    FlowReader& flowReader;
};

}  // namespace RigidHIPlugin

#endif
