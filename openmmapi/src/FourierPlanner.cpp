#include "openmmrigidhi/internal/FourierPlanner.h"

namespace RigidHIPlugin {

std::mutex& fourierPlanner() {
    static std::mutex mutex;
    return mutex;
}

}  // namespace RigidHIPlugin
