#ifndef RIGIDHI_FOURIER_PLAN_H_
#define RIGIDHI_FOURIER_PLAN_H_

#include <memory>

namespace RigidHIPlugin {

/**
 * FFTW's discrete Fourier transform of `count` columns of n complex numbers at once, not
 * normalised. In input and output, element i of column c is at i count + c, real part before
 * imaginary part. Input and output must not overlap, and each must begin at a cache line.
 *
 * Plans use FFTW_ESTIMATE. FFTW finds its other plans with a clock, so the last bits of their
 * results would differ from run to run.
 */
template <typename T>
class FourierPlan {
public:
    FourierPlan() {}
    /** @param back  whether the transform takes exp(+2 pi i j k/n) instead of exp(-2 pi i j k/n) */
    FourierPlan(int n, int count, bool back);
    /** Transform. Several threads may call this at once. */
    void operator()(const T* from, T* to) const;

private:
    std::shared_ptr<void> plan;
};

}  // namespace RigidHIPlugin

#endif
