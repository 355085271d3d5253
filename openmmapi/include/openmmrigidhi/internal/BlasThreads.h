#ifndef OPENMMRIGIDHI_BLAS_THREADS_H_
#define OPENMMRIGIDHI_BLAS_THREADS_H_

#include <mutex>

#include "openmmrigidhi/internal/windowsExport.h"

namespace RigidHIPlugin {

/**
 * The holders of the number of BLAS threads, which is one number for the whole process.
 *
 * Each platform's library has its own copy of the numerics and of their static data. This struct is
 * therefore in the API library, which is loaded once.
 */
struct BlasThreads {
    std::mutex mutex;  // for all members, and for changes of the number
    int holders = 0;
    int wanted = 0;  // set by code other than the holders: the number without holders
};
OPENMM_EXPORT_RIGIDHI BlasThreads& blasThreads();

}  // namespace RigidHIPlugin

#endif
