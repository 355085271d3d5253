#ifndef RIGIDHI_MEMBER_MISMATCHES_H_
#define RIGIDHI_MEMBER_MISMATCHES_H_

#include <string>

#include "context/Warnings.h"

namespace RigidHIPlugin {

/**
 * Particles of bodies, particles that should be in bodies, and parameters, that do not fit the
 * System's Forces and box. Each function returns a warning, or nothing if all is well. The
 * functions take as long as several steps, so steps do not call them again and again.
 */

/**
 * Bodies whose particles lie in two parts, with a gap between them of more than half of the
 * periodic box: molecules that a program has wrapped particle by particle.
 */
std::string bodiesAcrossTheBox(const Scene& scene);
/**
 * Bodies whose own particles act on each other by a NonbondedForce, so strongly that in single
 * precision the rounding of energies disturbs barostats and minimisers.
 */
std::string forcesWithinBodies(const Scene& scene);
/**
 * Particles in no body that exclude each other from a NonbondedForce, as those of one molecule do,
 * although nothing holds them together.
 */
std::string looseParticles(const Scene& scene);
/** Bodies whose mass or moments contradict the masses of their particles. */
std::string inertiaAgainstMasses(const Scene& scene);

/**
 * Parameters of OpenMM's custom Forces that are 1e20 times too small: quantities in newton or
 * joule, which OpenMM does not multiply by Avogadro's number.
 */
std::string parametersWithoutAvogadro(const Scene& scene);
/** CustomBodyForces that act on no body. */
std::string bodyForceWithoutBodies(const Scene& scene);
/** A force that a body exerts on the fluid within itself propels it hardly at all. */
std::string forceOnFluidInsideBody(const Scene& scene);

void addMismatchesOfMembers(const Scene& scene, Warnings& warnings);

}  // namespace RigidHIPlugin

#endif
