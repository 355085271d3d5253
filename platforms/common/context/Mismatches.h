#ifndef RIGIDHI_MISMATCHES_H_
#define RIGIDHI_MISMATCHES_H_

#include <string>

#include "context/Warnings.h"

namespace RigidHIPlugin {

/**
 * Settings of a Context that should fit each other, but that users set independently: those of
 * integrator, System, fluid and barostat. Each function returns a warning, or nothing if the
 * settings fit.
 */
std::string bodiesWithoutContext(const Scene& scene);
std::string jointsWithoutContext(const Scene& scene);
std::string unboundedFluidWithPeriodicForces(const Scene& scene);
/** A periodic fluid whose particles may meet through a face of the box, where a force sees none. */
std::string forcesWithoutImages(const Scene& scene);
/** Bodies that feel images by forces above a wall, whose fluid has no images. */
std::string wallWithPeriodicForces(const Scene& scene);
/** A periodic fluid in the box that a System has if nobody sets one. */
std::string boxOfTheDefault(const Scene& scene);
std::string watersWithoutBodies(const Scene& scene);
/** Between walls the fluid is not periodic along z, but forces are. */
std::string imagesAcrossTheFluid(const Scene& scene);
/** The temperature of a barostat is a parameter of the Context, which users set independently. */
std::string barostatAtAnotherTemperature(const Scene& scene);

void addMismatches(const Scene& scene, Warnings& warnings);
/** The part of them that depends on positions, which are not known at Context creation. */
void addMismatchesOfPositions(const Scene& scene, Warnings& warnings);
/** The barostat with its temperature and pressure, for describeEffects(). */
std::string describeBarostat(const Scene& scene);

}  // namespace RigidHIPlugin

#endif
