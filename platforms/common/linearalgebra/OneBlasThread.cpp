#include "linearalgebra/OneBlasThread.h"

#include "openmmrigidhi/internal/BlasThreads.h"

extern "C" {
int openblas_get_num_threads();
void openblas_set_num_threads(int threads);
}

namespace RigidHIPlugin {

OneBlasThread::OneBlasThread() {
    BlasThreads& shared = blasThreads();
    const std::lock_guard<std::mutex> lock(shared.mutex);
    const int number = openblas_get_num_threads();
    // Holders leave the number at 1, so only other code can have set another number.
    if (shared.holders == 0 || number != 1) shared.wanted = number;
    if (number != 1) openblas_set_num_threads(1);
    shared.holders++;
}

OneBlasThread::~OneBlasThread() {
    BlasThreads& shared = blasThreads();
    const std::lock_guard<std::mutex> lock(shared.mutex);
    shared.holders--;
    if (shared.holders == 0 && openblas_get_num_threads() == 1 && shared.wanted != 1)
        openblas_set_num_threads(shared.wanted);
}

}  // namespace RigidHIPlugin
