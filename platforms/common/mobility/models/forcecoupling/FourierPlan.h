#ifndef RIGIDHI_FOURIER_PLAN_H_
#define RIGIDHI_FOURIER_PLAN_H_

#include <memory>

namespace RigidHIPlugin {

/**
 * FFTW's discrete Fourier transform of `count` columns of n complex numbers at once, not
 * normalised. Element i of column c is at i count + c, real part before imaginary part, both in the
 * input and in the output. Input and output do not overlap, and each begins where a cache line
 * does.
 *
 * A plan is made by FFTW_ESTIMATE. FFTW's other plans are found by a clock, so their results have
 * other last bits in each run.
 */
template <typename T>
class FourierPlan {
public:
    FourierPlan() {}
    /**
     * @param back  whether the transform is by exp(+2 pi i j k/n) instead of exp(-2 pi i j k/n)
     */
    FourierPlan(int n, int count, bool back);
    /** May be called by several threads at once. */
    void operator()(const T* from, T* to) const;

private:
    std::shared_ptr<void> plan;
};

}  // namespace RigidHIPlugin

#endif
