#include "mobility/models/forcecoupling/FourierPlan.h"

#include <fftw3.h>

#include "linearalgebra/AlignedArray.h"
#include "openmmrigidhi/internal/FourierPlanner.h"

namespace RigidHIPlugin {

// FFTW has separate functions for each precision.
#define RIGIDHI_FOURIER_PLAN(T, FFTW)                                                              \
    template <>                                                                                    \
    FourierPlan<T>::FourierPlan(int n, int count, bool back) {                                     \
        AlignedArrayOf<T> from, to; /* only their alignment matters */                             \
        from.resize(2 * (size_t)n * count);                                                        \
        to.resize(2 * (size_t)n * count);                                                          \
        const std::lock_guard<std::mutex> lock(fourierPlanner());                                  \
        const auto made = FFTW##_plan_many_dft(                                                    \
            1, &n, count, reinterpret_cast<FFTW##_complex*>(from.data()), nullptr, count, 1,       \
            reinterpret_cast<FFTW##_complex*>(to.data()), nullptr, count, 1,                       \
            back ? FFTW_BACKWARD : FFTW_FORWARD, FFTW_ESTIMATE);                                   \
        plan = std::shared_ptr<void>(made, [](void* plan) {                                        \
            const std::lock_guard<std::mutex> lock(fourierPlanner());                              \
            FFTW##_destroy_plan(static_cast<FFTW##_plan>(plan));                                   \
        });                                                                                        \
    }                                                                                              \
    template <>                                                                                    \
    void FourierPlan<T>::operator()(const T* from, T* to) const {                                  \
        FFTW##_execute_dft(                                                                        \
            static_cast<FFTW##_plan>(plan.get()),                                                  \
            reinterpret_cast<FFTW##_complex*>(const_cast<T*>(from)), /* out of place: only read */ \
            reinterpret_cast<FFTW##_complex*>(to));                                                \
    }

RIGIDHI_FOURIER_PLAN(double, fftw)
RIGIDHI_FOURIER_PLAN(float, fftwf)

}  // namespace RigidHIPlugin
