#ifndef OPENMMRIGIDHI_MOBILITY_FORCE_IMPL_H_
#define OPENMMRIGIDHI_MOBILITY_FORCE_IMPL_H_

#include <openmm/internal/ContextImpl.h>
#include <openmm/internal/ForceImpl.h>

#include <map>
#include <string>
#include <vector>

#include "openmmrigidhi/MobilityForce.h"

namespace RigidHIPlugin {

/**
 * A MobilityForce in a Context. It computes nothing: the integrator's kernel reads the
 * MobilityForce. It refuses other integrators, which would ignore the fluid silently.
 */
class MobilityForceImpl : public OpenMM::ForceImpl {
public:
    explicit MobilityForceImpl(const MobilityForce& owner) : owner(owner) {}
    void initialize(OpenMM::ContextImpl& context) override;
    const MobilityForce& getOwner() const override { return owner; }
    void updateContextState(OpenMM::ContextImpl& context, bool& forcesInvalid) override {}
    double calcForcesAndEnergy(OpenMM::ContextImpl& context, bool includeForces, bool includeEnergy,
                               int groups) override {
        return 0;
    }
    std::map<std::string, double> getDefaultParameters() override { return {}; }
    std::vector<std::string> getKernelNames() override { return {}; }

private:
    const MobilityForce& owner;
};

}  // namespace RigidHIPlugin

#endif
