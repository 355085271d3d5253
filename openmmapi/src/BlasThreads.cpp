#include "openmmrigidhi/internal/BlasThreads.h"

namespace RigidHIPlugin {

BlasThreads& blasThreads() {
    static BlasThreads threads;
    return threads;
}

}  // namespace RigidHIPlugin
