#ifndef OPENMMRIGIDHI_BLAS_THREADS_H_
#define OPENMMRIGIDHI_BLAS_THREADS_H_

#include <mutex>

#include "openmmrigidhi/internal/windowsExport.h"

namespace RigidHIPlugin {

/**
 * Who holds the number of BLAS threads, which is one number for the whole process.
 *
 * Each platform's library has its own copy of the numerics and of what is static in them. So this
 * is in the API library, which is loaded once.
 */
struct BlasThreads {
    std::mutex mutex;  // for all members, and for changes of the number
    int holders = 0;
    int wanted = 0;  // by others than holders: the number when there are none
};
OPENMM_EXPORT_RIGIDHI BlasThreads& blasThreads();

}  // namespace RigidHIPlugin

#endif
