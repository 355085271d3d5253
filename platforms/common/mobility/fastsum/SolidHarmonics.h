#ifndef RIGIDHI_SOLID_HARMONICS_H_
#define RIGIDHI_SOLID_HARMONICS_H_

#include <Eigen/Core>
#include <array>
#include <vector>

namespace RigidHIPlugin {

/**
 * Real solid harmonics up to an order P, the basis of multipoles and local expansions, with the
 * matrices that shift expansions.
 *
 * Equation:  With the complex harmonics
 *                R_n^m = r^n P_n^m(cos theta) exp(i m phi)/(n + m)!,
 *                I_n^m = (n - m)! P_n^m exp(i m phi)/r^(n+1)
 *            (P_n^m without the sign (-1)^m, and X_n^-m = (-1)^m conj X_n^m), the basis is Re R_n^m
 *            and Im R_n^m for m >= 0: element n^2 for m = 0; n^2 + 2m - 1 and n^2 + 2m for the real
 *            and imaginary part. Then
 *                R_n^m(u + v) = sum_kl R_k^l(u) R_(n-k)^(m-l)(v),
 *                1/|D + x - y| = sum (-1)^k' conj R_k^l(y) conj R_k'^l'(x) I_(k+k')^(l+l')(D).
 * Cost:      basis() takes about 6 operations for each element. A matrix takes P^4 operations.
 * Reference: Epton, Dembart, SIAM J. Sci. Comput. 16, 865 (1995); normalisation: Dehnen, Comput.
 *            Astrophys. Cosmol. 1, 1 (2014).
 */
class SolidHarmonics {
public:
    explicit SolidHarmonics(int order);
    int getOrder() const { return order; }
    /** Number of elements, (P + 1)^2. */
    int size() const { return (order + 1) * (order + 1); }
    int degree(int element) const { return degrees[element]; }

    /**
     * The basis at a point.
     *
     * @param R  size() numbers
     */
    void basis(double x, double y, double z, double* R) const;
    /**
     * The matrix C with R_a(u + d) = sum_b C_ab R_b(u). C shifts moments, and its transpose shifts
     * the coefficients of local expansions.
     */
    Eigen::MatrixXd shift(const Eigen::Vector3d& d) const;
    /**
     * The matrix T with 1/|D + x - y| = sum_ab R_a(x) T_ab R_b(y), where |x| + |y| < |D|, truncated
     * at the order.
     */
    Eigen::MatrixXd fromFar(const Eigen::Vector3d& D) const;
    /**
     * A term of the derivative along an axis: d R_a is the sum of at most two terms `factor` R_to.
     */
    struct Term {
        int to;
        double factor;
    };
    const std::vector<Term>& derivative(int axis, int element) const {
        return derivatives[axis][element];
    }
    /**
     * Add to the moments those of a derivative: M_a += factor sum_c D_ac A_c.
     *
     * @param stride  distance from one element to the next
     */
    void addDerivativeOfMoments(int axis, double factor, const double* from, double* to,
                                int stride = 1) const;
    /** The coefficients of the derivative of a local expansion: to_c = sum_a D_ac L_a. */
    void derivativeOfLocal(int axis, const double* from, double* to) const;
    /** Signs of the elements at a point mirrored in x (bit 0), y (bit 1) and z (bit 2). */
    const std::vector<double>& signs(int mirrored) const { return reflections[mirrored]; }

private:
    const int order;
    std::vector<int> degrees;
    std::vector<double> diagonal;  // R_m^m from R_(m-1)^(m-1)
    std::vector<double> inverse;   // 1/((n + m)(n - m))
    std::array<std::vector<std::vector<Term>>, 3> derivatives;
    std::array<std::vector<double>, 8> reflections;
};

}  // namespace RigidHIPlugin

#endif
