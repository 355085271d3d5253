#ifndef RIGIDHI_SAMPLING_H_
#define RIGIDHI_SAMPLING_H_

#include <cmath>
#include <vector>

#include "TestSupport.h"

namespace RigidHITest {

/**
 * The standard error of a mean of squares, relative to that of independent samples.
 *
 * For a momentum that decays as exp(-t), the correlation of its squares decays as exp(-2 t). For
 * the same number of steps, denser samples give a more exact mean. Samples half a relaxation time
 * apart contain more than nine tenths of the available information, samples four relaxation times
 * apart a quarter.
 *
 * @param relaxations  the time between samples in relaxation times of the momentum
 */
inline double errorOfCorrelatedSquares(double relaxations) {
    return std::sqrt(1 / std::tanh(relaxations));
}

/**
 * The mean over many independent bodies, each sampled many times. Its error comes from the
 * differences of the bodies' own means, so it is right for any correlation between samples of one
 * body.
 */
class MeanOverBodies {
public:
    /** Take one sample of every body. */
    void add(const std::vector<double>& ofBodies) {
        sums.resize(ofBodies.size(), 0.0);
        for (size_t i = 0; i < sums.size(); i++) sums[i] += ofBodies[i];
        samples++;
    }
    Estimate estimated() const {
        std::vector<double> means = sums;
        for (double& mean : means) mean /= samples;
        return estimate(means);
    }

private:
    std::vector<double> sums;
    int samples = 0;
};

}  // namespace RigidHITest

#endif
