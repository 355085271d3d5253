#ifndef RIGIDHI_CONTEXT_FLUID_H_
#define RIGIDHI_CONTEXT_FLUID_H_

#include <memory>
#include <vector>

#include "context/BodyDefinitions.h"
#include "fluid/Fluid.h"

namespace RigidHIPlugin {

class Scene;

/**
 * The Fluid of a Context. This class makes the Fluid from the user's latest MobilityForce, and
 * makes it anew when the MobilityForce or the wall rejection changes. A Context without a
 * MobilityForce has no Fluid. Other Contexts have one as soon as the geometries of all bodies are
 * known.
 */
class ContextFluid {
public:
    ContextFluid(Scene& scene, const MobilityForce* inSystem);
    /** The user's latest MobilityForce (at Context creation or by update()), or null. */
    const MobilityForce* getParameters() const { return parameters.get(); }
    /**
     * The MobilityForce in the System, if any of its setters was called since getParameters() was
     * copied from it; otherwise null.
     */
    const MobilityForce* getChanged() const;
    Fluid* get() const { return fluid.get(); }
    Fluid* operator->() const { return fluid.get(); }
    explicit operator bool() const { return fluid != nullptr; }

    /**
     * Check what can be checked before the shapes of all bodies are known. @throws OpenMMException
     */
    void check() const;
    /**
     * Make a Fluid for these bodies, which continues from the state of the present Fluid; null
     * without a MobilityForce.
     */
    std::unique_ptr<Fluid> make(const BodyDefinitions::Bodies& bodies);
    /** Exchange the present Fluid for another. */
    void exchange(std::unique_ptr<Fluid>& other) { swap(fluid, other); }
    /** updateParametersInContext(). If anything is refused, everything stays as it was. */
    void update(const MobilityForce& force);
    /** Take over the Context's box, which may change between steps. */
    void takeBox();
    /**
     * Take over the Context's box before the fluid is used. @throws OpenMMException if a body does
     * not fit into it
     */
    void adoptBox();
    /**
     * Take over the integrator's wall rejection and scheme. They may change between steps, but a
     * Fluid is made for one value of each.
     */
    void adoptSettings();

private:
    FluidSettings settings() const;
    void check(const MobilityForce& force) const;
    void checkWithIntegrator(const MobilityForce& force) const;
    void rebuild();
    std::unique_ptr<Fluid> make(const std::vector<BodyGeometry>& geometries,
                                const BodySet& bodies) const;
    Scene& scene;
    std::unique_ptr<MobilityForce>
        parameters;                     // a copy: later changes by the user wait for update()
    const MobilityForce* const source;  // of the copy; it may no longer exist
    std::unique_ptr<Fluid> fluid;
};

}  // namespace RigidHIPlugin

#endif
