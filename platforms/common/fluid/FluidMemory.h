#ifndef RIGIDHI_FLUID_MEMORY_H_
#define RIGIDHI_FLUID_MEMORY_H_

#include "fluid/FluidContents.h"
#include "schemes/SchemeMemory.h"

namespace RigidHIPlugin {

class FlowReader;

/**
 * What the groups remember from step to step without momenta: vectors that the scheme keeps
 * (OverdampedScheme::memory()), and data from which the last step can be done again. Both are saved
 * with checkpoints and States.
 */
class FluidMemory {
public:
    /** @param flowReader  forgets its answer when another last step is set */
    FluidMemory(const FluidContents& fluid, FlowReader& flowReader)
        : fluid(fluid), flowReader(flowReader) {}
    /** Put the scheme's vectors back as they were when the step began. */
    void restore();
    /** Empty the scheme's vectors. */
    void forget();
    /** The scheme's vectors, for saving. */
    SchemeMemory getOfScheme() const;
    /**
     * @throws OpenMMException if the vectors are not of these groups, or damaged. Those of another
     *     scheme are ignored
     */
    void checkOfScheme(const SchemeMemory& saved, CustomRigidHIIntegrator::Scheme scheme) const;
    /** Set the vectors. Errors as in checkOfScheme(), after which nothing is changed. */
    void setOfScheme(const SchemeMemory& saved, CustomRigidHIIntegrator::Scheme scheme);
    /** Take over the scheme's vectors of another fluid of this Context. */
    void continueFrom(const FluidMemory& before);

    /** The data of the last step, for saving; empty where no step is known. */
    SchemeMemory getLastStep() const;
    /**
     * @throws OpenMMException if the data are not of these groups, or damaged. The data of a scheme
     *     that is not known are ignored
     */
    void checkLastStep(const SchemeMemory& saved) const;
    /** Set the data. Errors as in checkLastStep(), after which nothing is changed. */
    void setLastStep(const SchemeMemory& saved);
    /** What held bodies and particles in the last step; empty where nothing did. */
    SchemeMemory getHolds() const;
    /** @throws OpenMMException if the data are not of these bodies and particles, or damaged */
    void checkHolds(const SchemeMemory& saved) const;
    /** Set the data. Errors as in checkHolds(), after which nothing is changed. */
    void setHolds(const SchemeMemory& saved);

private:
    const FluidContents& fluid;
    FlowReader& flowReader;
};

}  // namespace RigidHIPlugin

#endif
