#ifndef RIGIDHI_SYSTEM_CHECK_H_
#define RIGIDHI_SYSTEM_CHECK_H_

#include <openmm/internal/ContextImpl.h>

#include <map>
#include <string>
#include <vector>

#include "forces/BodyMotions.h"
#include "openmmrigidhi/CustomRigidHIIntegrator.h"

namespace RigidHIPlugin {

/** The contents of a System apart from bodies, as far as schemes need them. */
struct SystemInventory {
    std::vector<int> bodyOfParticle;  // -1: in no body
    std::vector<int> freeParticles;   // massive, in no body
    std::vector<int> otherParticles;  // every particle that is in no body
    std::vector<int> virtualSites;    // in bodies or not
    bool hasFreeVirtualSites = false;
    int numFreeConstraints = 0;
    bool hasCMMotionRemover = false;
    std::vector<int> removalFrequencies;  // of every CMMotionRemover, steps
    std::string barostat;                 // its class name, or empty
    std::string barostatTemperature;      // the parameter of the Context that has it, or empty
    int numFreeWaters = 0;                // rigid waters in no body
    int firstFreeWater = -1;              // its first particle
    std::string
        velocityDependentForce;  // a CustomBodyForce whose expressions use velocities, or empty
    std::map<int, PrescribedComponents> prescribed;  // by body
    const class MobilityForce* mobilityForce = nullptr;
    int numMobilityForces = 0;
};

/**
 * Check everything about a System that does not depend on the scheme, and return its contents.
 *
 * @throws OpenMMException with object, value, bound and remedy for: particle indices out of range;
 *     constraints and virtual sites that tie a body to something outside it; bodies that OpenMM
 *     would tear apart across periodic boundaries; Forces that cannot work with bodies
 */
SystemInventory takeStock(const OpenMM::ContextImpl& context,
                          const CustomRigidHIIntegrator& integrator);

/** Check what depends on the scheme, which may change between steps. */
void checkScheme(const OpenMM::System& system, const CustomRigidHIIntegrator& integrator,
                 const SystemInventory& stock);

/**
 * Check that a MobilityForce's model has its boundary, and that its options are compatible with
 * those of the integrator.
 */
void checkBoundary(const class MobilityForce& force, const CustomRigidHIIntegrator& integrator);
/**
 * Check that the scheme allows a sheared fluid. Such schemes also exclude barostats. @throws
 * OpenMMException
 */
void checkShear(const class MobilityForce& force, const CustomRigidHIIntegrator& integrator);
/** Check that the scheme moves bodies by their slips and forces on the fluid. @throws
 * OpenMMException */
void checkSlips(const class MobilityForce& force, const CustomRigidHIIntegrator& integrator);

}  // namespace RigidHIPlugin

#endif
