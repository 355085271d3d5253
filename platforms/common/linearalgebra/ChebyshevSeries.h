#ifndef RIGIDHI_CHEBYSHEV_SERIES_H_
#define RIGIDHI_CHEBYSHEV_SERIES_H_

#include <Eigen/Core>
#include <cmath>

namespace RigidHIPlugin {

/** Functions of a number between -1 and 1, interpolated at the nodes of Chebyshev's polynomials. */
template <int numFunctions, int numCoefficients>
class ChebyshevSeries {
public:
    ChebyshevSeries() = default;
    /** @param valuesAt  the values of all functions at a number */
    template <class Values>
    explicit ChebyshevSeries(const Values& valuesAt) {
        for (int node = 0; node < numCoefficients; node++) {
            const double angle = M_PI * (node + 0.5) / numCoefficients;
            const Eigen::Array<double, numFunctions, 1> values = valuesAt(std::cos(angle));
            for (int k = 0; k < numCoefficients; k++)
                coefficients.col(k) +=
                    (k == 0 ? 1.0 : 2.0) / numCoefficients * std::cos(k * angle) * values;
        }
    }
    /** The first n functions, by Clenshaw's recurrence, added to others. */
    template <int n = numFunctions>
    Eigen::Array<double, n, 1> addedTo(const Eigen::Array<double, n, 1>& others, double x) const {
        Eigen::Array<double, n, 1> last = Eigen::Array<double, n, 1>::Zero(), sum = last;
        for (int k = numCoefficients - 1; k > 0; k--) {
            const Eigen::Array<double, n, 1> next =
                coefficients.col(k).template head<n>() + 2 * x * sum - last;
            last = sum;
            sum = next;
        }
        return others + coefficients.col(0).template head<n>() + x * sum - last;
    }

private:
    Eigen::Array<double, numFunctions, numCoefficients> coefficients =
        Eigen::Array<double, numFunctions, numCoefficients>::Zero();
};

}  // namespace RigidHIPlugin

#endif
