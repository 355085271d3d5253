#ifndef OPENMMRIGIDHI_FOURIER_PLANNER_H_
#define OPENMMRIGIDHI_FOURIER_PLANNER_H_

#include <mutex>

#include "openmmrigidhi/internal/windowsExport.h"

namespace RigidHIPlugin {

/**
 * To be held while FFTW makes or destroys plans, which is not safe for threads.
 *
 * One for the process: each platform's library has its own copy of the numerics and of what is
 * static in them, so this is in the API library, which is loaded once.
 */
OPENMM_EXPORT_RIGIDHI std::mutex& fourierPlanner();

}  // namespace RigidHIPlugin

#endif
