#ifndef RIGIDHI_FLUID_SETTINGS_H_
#define RIGIDHI_FLUID_SETTINGS_H_

#include "openmmrigidhi/CustomRigidHIIntegrator.h"

namespace RigidHIPlugin {

/** What a fluid takes from the integrator. Where these settings matter, it is made for them. */
struct FluidSettings {
    CustomRigidHIIntegrator::WallRejection wallRejection;
    CustomRigidHIIntegrator::Scheme scheme;

    explicit FluidSettings(const CustomRigidHIIntegrator& integrator)
        : wallRejection(integrator.getWallRejection()), scheme(integrator.getScheme()) {}
};

}  // namespace RigidHIPlugin

#endif
