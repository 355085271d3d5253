#ifndef RIGIDHI_GRID_FLUID_SUPPORT_H_
#define RIGIDHI_GRID_FLUID_SUPPORT_H_

#include <functional>
#include <memory>
#include <thread>
#include <vector>

#include "mobility/models/forcecoupling/CpuGridFluid.h"
#include "mobility/models/forcecoupling/GridFluid.h"

namespace RigidHITest {

/** Computes ranges on this number of threads at once. */
inline RigidHIPlugin::GridThreads onThreads(int number) {
    return [number](int count, const std::function<void(int, int)>& task) {
        std::vector<std::thread> threads;
        for (int t = 0; t < number; t++)
            threads.emplace_back([&, t] { task(count * t / number, count * (t + 1) / number); });
        for (std::thread& one : threads) one.join();
    };
}

/** The fluid with SIMD packs, or the plain one. */
inline std::shared_ptr<RigidHIPlugin::GridFluid> fluidOf(bool simd, int numThreads = 1) {
    if (!simd) return std::make_shared<RigidHIPlugin::PlainGridFluid>();
    if (numThreads == 1) return std::make_shared<RigidHIPlugin::CpuGridFluid>();
    return std::make_shared<RigidHIPlugin::CpuGridFluid>(onThreads(numThreads));
}

}  // namespace RigidHITest

#endif
