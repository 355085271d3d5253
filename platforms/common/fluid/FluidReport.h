#ifndef RIGIDHI_FLUID_REPORT_H_
#define RIGIDHI_FLUID_REPORT_H_

#include <map>
#include <string>

#include "fluid/FluidContents.h"

namespace RigidHIPlugin {

/** Describes the fluid of a Context and its work, for describeEffects(). */
class FluidReport {
public:
    explicit FluidReport(const FluidContents& fluid) : fluid(fluid) {}
    /**
     * The fluid, the number of groups that each strategy solves, and the products of iterations.
     *
     * @param difference  setFiniteDifferenceStep()
     */
    std::string describe(const SchemeTraits& scheme, double kT, double difference) const;
    /** Which setting of lubrication has no effect, and why; empty: none. */
    std::string lubricationWithoutEffect() const;
    /** The flow that users drive; empty: none. */
    std::string describeFlow() const;
    /**
     * The method of mobility(), friction() and apply() (FluidAnswers), whatever the scheme.
     */
    std::string describeAnswers() const;
    /** For a scheme without momenta: "stochastic drift" and "finite differences". */
    std::map<std::string, std::string> describeDrift(const SchemeTraits& scheme, double kT,
                                                     double difference) const;
    /** Whether any div N is not 0, so that a scheme without momenta that omits it is wrong. */
    bool hasStochasticDrift() const;
    /** The number of bodies and free particles that are not alone in their group. */
    int numInteracting() const;
    /**
     * The number of bodies whose hydrodynamic particles are on a line. The fluid does not turn such
     * bodies about the line.
     */
    int numCollinear() const;

private:
    std::string describeWalls() const;
    std::string describeImages() const;
    /** Viscosity and radii, and what they mean, so that users see numbers in a wrong unit. */
    std::string describeScale(double kT) const;
    /** Groups by the kind of their stochastic drift. */
    struct Drifts {
        std::vector<BrownianGroup*> differenced;  // by finite differences, if the scheme has any
        int known = 0, zero = 0, ofSpheres = 0;   // known for a body alone in a uniform fluid; the
                                                  // same, and 0; 0 for spheres that feel each other
        int numNotZero() const { return differenced.size() + known; }
    };
    Drifts findDrifts() const;
    const FluidGroup* findLargest() const;

    const FluidContents& fluid;
};

}  // namespace RigidHIPlugin

#endif
