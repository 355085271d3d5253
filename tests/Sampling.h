#ifndef RIGIDHI_SAMPLING_H_
#define RIGIDHI_SAMPLING_H_

#include <cmath>
#include <vector>

#include "TestSupport.h"

namespace RigidHITest {

/**
 * How much larger the standard error of a mean of squares is than that of independent samples.
 *
 * A momentum that decays as exp(-t) has squares of correlation exp(-2 t). At equal numbers of steps
 * the mean is the more exact the denser its samples are; samples half a relaxation time apart have
 * more than nine tenths of what there is to know, samples four apart a quarter.
 *
 * @param relaxations  the time between samples in relaxation times of the momentum
 */
inline double errorOfCorrelatedSquares(double relaxations) {
    return std::sqrt(1 / std::tanh(relaxations));
}

/**
 * The mean over many independent bodies, each of which is sampled again and again. Its error comes
 * from the differences of the bodies' own means, so that it is right however correlated the samples
 * of one body are.
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
