#ifndef RIGIDHI_FLUID_H_
#define RIGIDHI_FLUID_H_

#include <openmm/System.h>

#include <vector>

#include "fluid/BrownianGroups.h"
#include "fluid/FlowReader.h"
#include "fluid/FluidAnswers.h"
#include "fluid/FluidChecks.h"
#include "fluid/FluidContents.h"
#include "fluid/FluidCosts.h"
#include "fluid/FluidMemory.h"
#include "fluid/FluidMomenta.h"

namespace RigidHIPlugin {

/**
 * The fluid of one Context: its contents, and its parts, each with one duty. A Fluid serves one
 * MobilityForce and one set of FluidSettings; only the box may change.
 */
class Fluid {
public:
    /** @throws OpenMMException as GroupBuilder */
    Fluid(const MobilityForce& force, const FluidSettings& settings, const OpenMM::System& system,
          const std::vector<std::vector<int>>& particlesOfBodies,
          const std::vector<BodyGeometry>& geometries, const BodySet& bodies,
          const FreeParticles& freeParticles, PlatformLoops& loops);
    /**
     * Check what the constructor refuses, as far as this does not depend on the shapes of bodies.
     * @throws OpenMMException as the constructor
     */
    static void check(const MobilityForce& force, const FluidSettings& settings,
                      const OpenMM::System& system,
                      const std::vector<std::vector<int>>& particlesOfBodies,
                      const FreeParticles& freeParticles, PlatformLoops& loops);
    /** Whether the fluid serves these settings. */
    bool isMadeFor(const FluidSettings& wanted) const;
    /** The rates of motors from the next step on. */
    void setMotorRates(const std::vector<HingeMotorDefinition>& motors);
    /**
     * Go on from the state of another fluid of this Context, with its costs and the memory of the
     * scheme.
     */
    void continueFrom(const Fluid& before);

    /**
     * Set the vectors of the Context's periodic box; zeros, the initial value, stand for no box.
     */
    void setBox(const BoxVectors& box);
    /** @throws OpenMMException if a body of a periodic fluid does not fit into the box, naming it,
     * its length, the box and the remedy */
    void checkBox();
    /** @throws OpenMMException if the wave of a force density is not one of this box, or too short
     * for the model */
    void checkWave() const;

    const FluidContents& getContents() const { return contents; }
    FluidMomenta& getMomenta() { return momenta; }
    BrownianGroups& getBrownianGroups() { return brownianGroups; }
    FluidMemory& getMemory() { return memory; }
    FluidAnswers& getAnswers() { return answers; }
    FlowReader& getFlowReader() { return flowReader; }
    const FluidChecks& getChecks() const { return checks; }
    const FluidCosts& getCosts() const { return costs; }

private:
    FluidContents contents;
    bool boxIsChecked = false;
    FlowReader flowReader{contents};
    FluidMomenta momenta{contents};
    BrownianGroups brownianGroups{contents, flowReader};
    FluidMemory memory{contents, flowReader};
    FluidAnswers answers{contents};
    FluidChecks checks{contents};
    FluidCosts costs{contents};
};

}  // namespace RigidHIPlugin

#endif
