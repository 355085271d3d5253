#ifndef OPENMMRIGIDHI_FOURIER_PLANNER_H_
#define OPENMMRIGIDHI_FOURIER_PLANNER_H_

#include <mutex>

#include "openmmrigidhi/internal/windowsExport.h"

namespace RigidHIPlugin {

/**
 * The mutex to hold while FFTW makes or destroys plans. FFTW's planner is not thread-safe.
 *
 * The whole process needs one mutex. Each platform's library has its own copy of the numerics and
 * of their static data, so the mutex is in the API library, which is loaded once.
 */
OPENMM_EXPORT_RIGIDHI std::mutex& fourierPlanner();

}  // namespace RigidHIPlugin

#endif
