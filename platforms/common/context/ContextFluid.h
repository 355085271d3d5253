#ifndef RIGIDHI_CONTEXT_FLUID_H_
#define RIGIDHI_CONTEXT_FLUID_H_

#include <memory>
#include <vector>

#include "context/BodyDefinitions.h"
#include "fluid/Fluid.h"

namespace RigidHIPlugin {

class Scene;

/**
 * The Fluid of a Context: made from the MobilityForce as the user handed it over last, and made
 * anew when that or the wall rejection changes. A Context without a MobilityForce has none; others
 * have one as soon as the geometries of all bodies are known.
 */
class ContextFluid {
public:
    ContextFluid(Scene& scene, const MobilityForce* inSystem);
    /** The MobilityForce as it was handed over last, or null. */
    const MobilityForce* getParameters() const { return parameters.get(); }
    Fluid* get() const { return fluid.get(); }
    Fluid* operator->() const { return fluid.get(); }
    explicit operator bool() const { return fluid != nullptr; }

    /** What can be said of it before the shapes of all bodies are known. @throws OpenMMException */
    void check() const;
    /** One for these bodies, which goes on from where the present one stopped; null where there is
     * none. */
    std::unique_ptr<Fluid> make(const BodyDefinitions::Bodies& bodies);
    /** The present one is exchanged for another. */
    void exchange(std::unique_ptr<Fluid>& other) { swap(fluid, other); }
    /** updateParametersInContext(). If anything is refused, everything stays as it was. */
    void update(const MobilityForce& force);
    /** The box is the Context's and may change between steps. */
    void takeBox();
    /** Likewise, before the fluid is used. @throws OpenMMException if a body does not fit into it
     */
    void adoptBox();
    /** The wall rejection is the integrator's and may change between steps, but a Fluid is made for
     * one. */
    void adoptWallRejection();

private:
    void check(const MobilityForce& force) const;
    void rebuild();
    std::unique_ptr<Fluid> make(const std::vector<BodyGeometry>& geometries,
                                const BodySet& bodies) const;
    Scene& scene;
    std::unique_ptr<MobilityForce>
        parameters;  // a copy: what the user sets later waits for update()
    std::unique_ptr<Fluid> fluid;
};

}  // namespace RigidHIPlugin

#endif
