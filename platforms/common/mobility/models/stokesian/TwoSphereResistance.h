#ifndef RIGIDHI_TWO_SPHERE_RESISTANCE_H_
#define RIGIDHI_TWO_SPHERE_RESISTANCE_H_

#include <Eigen/Core>
#include <memory>

#include "linearalgebra/ChebyshevSeries.h"

namespace RigidHIPlugin {

/**
 * The scalar resistance functions of two spheres, scaled as by Jeffrey and Onishi (1984): A_ij by 3
 * pi eta (a_i + a_j), B_ij by pi eta (a_i + a_j)², C_ij by pi eta (a_i + a_j)³, and those of strain
 * by Jeffrey (1992): G_ij by pi eta (a_i + a_j)², H_ij by pi eta (a_i + a_j)³, M_ij by 5/6 pi eta
 * (a_i + a_j)³. G and H give the stresslet of i from the velocity and angular velocity of j, and M
 * gives it from the strain rate of the surface of j. X is along the line of centres, Y across it,
 * and Z of azimuthal order 2. A_21 = A_12, C_21 = C_12, M_21 = M_12.
 */
enum TwoSphereFunction {
    XA11,
    XA12,
    XA22,
    YA11,
    YA12,
    YA22,
    YB11,
    YB12,
    YB21,
    YB22,
    XC11,
    XC12,
    XC22,
    YC11,
    YC12,
    YC22,
    NumFunctionsOfMotion,
    XG11 = NumFunctionsOfMotion,
    XG12,
    XG21,
    XG22,
    YG11,
    YG12,
    YG21,
    YG22,
    YH11,
    YH12,
    YH21,
    YH22,
    XM11,
    XM12,
    XM22,
    YM11,
    YM12,
    YM22,
    ZM11,
    ZM12,
    ZM22,
    NumTwoSphereFunctions
};
template <class Real>
using TwoSphereValues = Eigen::Array<Real, NumTwoSphereFunctions, 1>;

/**
 * The resistance functions of two spheres in unbounded fluid, without a table.
 *
 * Method:    u = x Q/2 + v with Q and v harmonic, expanded in bispherical coordinates. No slip on
 *            both spheres and div u = 0 are a block tridiagonal system in the order n of the
 *            harmonics, for azimuthal order 0 (6 unknowns for each n), 1 and 2 (8). Rotation about
 *            the line of centres has closed coefficients. The solution is exact except for
 *            truncation, which is below rounding.
 * Accuracy:  In double 1e-13 at gap 1e-2, 1e-12 at 1e-3, 2e-11 at 1e-4 (rounding grows as 1/gap);
 *            in long double 2000 times better.
 * Cost:      About 25/alpha orders, with alpha = sqrt(gap) for equal spheres: 0.15 ms at gap 1e-1,
 *            1.3 ms at 1e-3; with ratio 10: 0.4 and 10 ms.
 * Reference: O'Neill, Mathematika 11:67 (1964) and Stimson and Jeffery (1926) for the coordinates;
 *            the equations are in the source.
 *
 * @param ratio  a_2/a_1
 * @param gap  between the surfaces, in units of (a_1 + a_2)/2; > 0
 */
template <class Real>
TwoSphereValues<Real> solveTwoSpheres(Real ratio, Real gap);
extern template TwoSphereValues<double> solveTwoSpheres(double ratio, double gap);
/** For tests at gaps where double has too few digits. */
extern template TwoSphereValues<long double> solveTwoSpheres(long double ratio, long double gap);

/** The same functions of two FTS spheres (ForceTorqueStresslet.h). */
TwoSphereValues<double> forceTorqueStressletPair(double ratio, double gap);

/**
 * The part of the resistance functions that FTS lacks, exact - FTS, for two spheres with one ratio
 * of radii at any gap, quickly.
 *
 * Method:    With u = gap/(centre distance), the singular terms G1/u + (G2 + G3 u) ln u of
 *            lubrication have closed forms. The rest, about u² ln u, is one Chebyshev series in
 *            u^(1/4), in which it is smooth enough. One expression, infinitely differentiable and
 *            without joints, holds for all gaps. At nodes too close for solveTwoSpheres() it comes
 *            from an expansion in u and ln u, fitted where solveTwoSpheres() is precise.
 * Accuracy:  6e-10 (ratio 10) and 2e-11 (equal spheres) near contact, 1e-12 at gaps above 1e-2;
 *            absolute, or relative to the function where it exceeds 1. Checked at gaps of 1e-6 to
 *            1e3 in tests/unit/TestTwoSpheres.cpp.
 * Cost:      Construction 0.1 s (equal) to 0.4 s (ratio 10), evaluation 0.3 us, with the functions
 *            of strain 0.6 us. The table is immutable, so threads may share it.
 * Reference: Jeffrey and Onishi, J. Fluid Mech. 139:261 (1984), and Jeffrey, Phys. Fluids A 4:16
 *            (1992), for the constants of the singular terms.
 * Limits:    Ratios from 0.1 to 10.
 */
class TwoSphereResistance {
public:
    static constexpr double maximumRatio = 10;

    /**
     * @param ratio  a_2/a_1, from 1/maximumRatio to maximumRatio
     * @throws OpenMMException if the ratio is outside this range
     */
    explicit TwoSphereResistance(double ratio);
    /** The table for a ratio, shared by all callers in the process. */
    static std::shared_ptr<const TwoSphereResistance> get(double ratio);

    /**
     * The difference exact - FTS.
     *
     * @param gap  in units of the mean radius; > 0
     */
    TwoSphereValues<double> correction(double gap) const {
        return evaluate<NumTwoSphereFunctions>(gap);
    }
    /** The functions of rigid motion alone, in half the time. */
    Eigen::Array<double, NumFunctionsOfMotion, 1> correctionOfMotion(double gap) const {
        return evaluate<NumFunctionsOfMotion>(gap);
    }
    /**
     * The full functions. This is slower than correction(), because it adds
     * forceTorqueStressletPair().
     */
    TwoSphereValues<double> exact(double gap) const {
        return correction(gap) + forceTorqueStressletPair(ratio, gap);
    }

private:
    using Values = TwoSphereValues<double>;
    using Rest = ChebyshevSeries<NumTwoSphereFunctions, 56>;

    Values singularTerms(double u) const { return singularTerms<NumTwoSphereFunctions>(u); }
    template <int n>
    Eigen::Array<double, n, 1> singularTerms(double u) const;
    /** The first n functions. */
    template <int n>
    Eigen::Array<double, n, 1> evaluate(double gap) const;

    double ratio;
    Values inverseGap, logarithm, gapLogarithm;  // G1, G2, G3
    Rest rest;
};

}  // namespace RigidHIPlugin

#endif
