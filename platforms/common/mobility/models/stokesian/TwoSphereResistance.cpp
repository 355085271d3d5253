#include "mobility/models/stokesian/TwoSphereResistance.h"

#include <openmm/OpenMMException.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <mutex>
#include <string>
#include <vector>

#include "linearalgebra/Decompositions.h"
#include "mobility/models/stokesian/ForceTorqueStresslet.h"

namespace RigidHIPlugin {

namespace {

/**
 * Two spheres in bispherical coordinates, z = sinh(xi)/h, rho = sin(eta)/h, h = cosh(xi) - x, x =
 * cos(eta), unit focal length and viscosity. Sphere 0 is xi = alpha, sphere 1 is xi = -beta. With k
 * = n + 1/2 and Ferrers' P_n^m without (-1)^m, the functions
 *
 *     f_n^{m,+-} = h^{1/2} exp(+-k xi) P_n^m(x) e^{i m phi}
 *
 * are harmonic. Their derivatives are sums of such functions and do not mix + and -:
 *
 *     d_z f_n           = +-[k f_n - (n-m+1)/2 f_{n+1} - (n+m)/2 f_{n-1}]
 *     (d_x + i d_y) f_n = f_n - f_{n+1}/2 - f_{n-1}/2   (order m+1)
 *     (d_x - i d_y) f_n = -(n+m)(n-m+1) f_n + (n-m+1)(n-m+2)/2 f_{n+1}
 *                         + (n+m)(n+m-1)/2 f_{n-1}      (order m-1)
 *     r.grad f_n        = -f_n/2 - (n-m+1)/2 f_{n+1} + (n+m)/2 f_{n-1}
 *
 * The unknowns are the coefficients of Q and v_z (order m), v_x + i v_y (m+1) and v_x - i v_y (m-1;
 * for m = 0 it mirrors the former). The coefficient of + is stored times exp(k alpha), and that of
 * - times exp(k beta). Each number is then the part that the function contributes at the sphere in
 * which it is singular.
 */
template <class Real>
class Bispherical {
public:
    // Orders share matrices of one type, without memory of their own on the heap: instances for
    // each order would take half a minute to compile.
    static constexpr int mostUnknowns = 8, mostMotions = 6;
    using Resistance =
        Eigen::Matrix<Real, Eigen::Dynamic, Eigen::Dynamic, 0, mostMotions, mostMotions>;

    Bispherical(int m, Real alpha, Real beta, int maxOrder)
        : m(m), ofStrain(m == 0   ? 1
                         : m == 1 ? 2
                                  : 0),
          numOfSphere(ofStrain + 1), numUnknowns(m == 0 ? 6 : 8), xi{alpha, beta},
          maxOrder(maxOrder) {}

    /**
     * The force, torque and stresslet of each sphere on the fluid for the same motions, about the
     * spheres' centres. Strains and stresslets are multiples of zz - (xx + yy)/2 (m = 0), xz + zx
     * (1) and xx - yy (2). Each motion strains the surface of one sphere only.
     */
    Resistance resistance() const {
        // block elimination upwards, substitution downwards
        std::vector<Block> above(maxOrder + 1);
        std::vector<Block> solution(maxOrder + 1);
        for (int n = 0; n <= maxOrder; n++) {
            Equations e = equations(n);
            if (n > 0) {
                e.same -= e.lower.lazyProduct(above[n - 1]);
                e.right -= e.lower.lazyProduct(solution[n - 1]);
            }
            const Eigen::PartialPivLU<Block> factor(e.same);
            above[n] = factor.solve(e.upper);
            solution[n] = factor.solve(e.right);
        }
        for (int n = maxOrder - 1; n >= 0; n--)
            solution[n] -= above[n].lazyProduct(solution[n + 1]);
        return farField(solution);
    }

private:
    enum {
        Q = 0,
        W = 2,
        X = 4,
        Y = 6
    };  // first of the two coefficients of Q, v_z, v_x + i v_y, v_x - i v_y
    using Block =
        Eigen::Matrix<Real, Eigen::Dynamic, Eigen::Dynamic, 0, mostUnknowns, mostUnknowns>;
    struct Equations {
        Block lower, same, upper, right;
    };

    Real decay(int n, int sphere) const { return std::exp(-(n + Real(0.5)) * xi[sphere]); }
    int lowestOrder(int variable) const {
        return variable == X ? m + 1 : variable == Y ? m - 1 : m;
    }

    Equations equations(int n) const {
        const Block none = Block::Zero(numUnknowns, numUnknowns);
        Equations e = {none, none, none, Block::Zero(numUnknowns, 2 * numOfSphere)};
        const Real below = 2 * n - 1, beyond = 2 * n + 3;
        for (int sphere = 0; sphere < 2; sphere++) {
            const Real cosine = std::cosh(xi[sphere]),
                       sine = (sphere == 0 ? 1 : -1) * std::sinh(xi[sphere]);
            const auto atSphere = [&](int row, int variable, Real lower, Real same, Real upper) {
                for (int j = 0; j < 2; j++) {
                    const auto value = [&](int order) {
                        return j == sphere ? Real(1)
                                           : std::exp(-(order + Real(0.5)) * (xi[0] + xi[1]));
                    };
                    if (n > 0) e.lower(row + sphere, variable + j) += lower * value(n - 1);
                    e.same(row + sphere, variable + j) += same * value(n);
                    e.upper(row + sphere, variable + j) += upper * value(n + 1);
                }
            };
            // no slip: h v = h u - (position h) Q/2, where position h is sinh(xi) along z and
            // sin(eta) e^{+-i phi} across
            atSphere(W, W, -(n - m) / below, cosine, -(n + m + 1) / beyond);
            atSphere(W, Q, 0, sine / 2, 0);
            atSphere(X, X, -(n - m - 1) / below, cosine, -(n + m + 2) / beyond);
            atSphere(X, Q, 1 / (2 * below), 0, -1 / (2 * beyond));
            // h^{1/2} = sum of root P_n; h^{-1/2} = sum of sqrt 2 exp(-k |xi|) P_n
            const Real sqrt2 = std::sqrt(Real(2));
            const Real root =
                (decay(n + 1, sphere) / beyond - decay(n - 1, sphere) / below) / sqrt2;
            const Real previous = n > 0 ? sqrt2 * decay(n - 1, sphere) : Real(0),
                       next = sqrt2 * decay(n + 1, sphere);
            // coefficients of h^{1/2} rho (m = 1) and of h^{1/2} (z - z_centre) (m = 0)
            const Real across = previous / below - next / beyond;
            const Real along = (cosine * (n * previous / below + (n + 1) * next / beyond) -
                                sqrt2 * decay(n, sphere)) /
                               sine;
            const int motion = numOfSphere * sphere;
            if (m == 0) {
                e.right(W + sphere, motion + ofVelocity) = root;
                e.right(W + sphere, motion + ofStrain) = along;
                e.right(X + sphere, motion + ofStrain) = -across / 2;
            } else {
                atSphere(Y, Y, -(n - m + 1) / below, cosine, -(n + m) / beyond);
                atSphere(Y, Q, -(n - m) * (n - m + 1) / (2 * below), 0,
                         (n + m + 1) * (n + m) / (2 * beyond));
                if (m == 1) {
                    e.right(Y + sphere, motion + ofVelocity) = 2 * root;
                    // spin about y: v_x - i v_y = 2 (z - z_centre), where z - z_centre is (x
                    // cosh(xi) - 1)/(h sinh(xi)), and v_z = -rho e^{i phi}. The strain has the
                    // opposite v_z.
                    for (int which : {ofSpin, ofStrain}) {
                        e.right(W + sphere, motion + which) = which == ofSpin ? -across : across;
                        e.right(Y + sphere, motion + which) = 2 * along;
                    }
                } else
                    e.right(Y + sphere, motion + ofStrain) = 2 * across;
            }
            // div u = (3 Q + r.grad Q)/2 + div v = 0, separately for + and -
            const Real sign = sphere == 0 ? 1 : -1, fromLower = std::exp(xi[sphere]),
                       fromUpper = std::exp(-xi[sphere]);
            const auto divergence = [&](int variable, Real lower, Real same, Real upper) {
                e.lower(Q + sphere, variable + sphere) += lower * fromLower;
                e.same(Q + sphere, variable + sphere) += same;
                e.upper(Q + sphere, variable + sphere) += upper * fromUpper;
            };
            const Real N = n;
            divergence(Q, -(N - m) / 4, Real(1.25), (N + m + 1) / 4);
            divergence(W, -sign * (N - m) / 2, sign * (N + Real(0.5)), -sign * (N + m + 1) / 2);
            const Real share = m == 0 ? 1 : Real(0.5);
            divergence(X, share * (N - m - 1) * (N - m) / 2, -share * (N + m + 1) * (N - m),
                       share * (N + m + 2) * (N + m + 1) / 2);
            if (m > 0) divergence(Y, Real(-0.25), Real(0.5), Real(-0.25));
        }
        // P_n^m = 0 where n < m
        for (int variable = 0; variable < numUnknowns; variable += 2)
            for (int i = variable; i < variable + 2; i++) {
                if (n - 1 < lowestOrder(variable)) e.lower.col(i).setZero();
                if (n + 1 < lowestOrder(variable)) e.upper.col(i).setZero();
                if (n < lowestOrder(variable)) {
                    e.same.col(i).setZero();
                    e.lower.row(i).setZero();
                    e.same.row(i).setZero();
                    e.upper.row(i).setZero();
                    e.right.row(i).setZero();
                    e.same(i, i) = 1;
                }
            }
        return e;
    }

    /**
     * Far away v is F/(8 pi r) + T x r/(8 pi r³), and the pressure Q of a stresslet is 3 r.S.r/(4
     * pi r^5). Terms that are singular inside a sphere belong to that sphere. Far from +, f_n is
     * sqrt 2 times 1/r + (2n+1) z/r³ + (n² + n + 1/2) (3z² - r²)/r^5 for m = 0, n (n+1) [x/r³ +
     * (2n+1) xz/r^5] for m = 1, and (n-1) n (n+1) (n+2)/2 (x² - y²)/r^5 for m = 2.
     */
    Resistance farField(const std::vector<Block>& solution) const {
        Resistance resistance = Resistance::Zero(2 * numOfSphere, 2 * numOfSphere);
        const Real unit = 8 * std::sqrt(Real(2)) * std::acos(Real(-1));
        for (int n = maxOrder; n >= 0; n--)
            for (int sphere = 0; sphere < 2; sphere++) {
                const Real weight = unit * decay(n, sphere), N = n;
                const int response = numOfSphere * sphere;
                const auto& pressure = solution[n].row(Q + sphere);
                if (m == 0) {
                    resistance.row(response + ofVelocity) += weight * solution[n].row(W + sphere);
                    resistance.row(response + ofStrain) +=
                        weight / 3 * (N * (N + 1) + Real(0.5)) * pressure;
                } else if (m == 1) {
                    resistance.row(response + ofVelocity) +=
                        weight / 2 * solution[n].row(Y + sphere);
                    resistance.row(response + ofSpin) -=
                        weight * n * (n + 1) * solution[n].row(W + sphere);
                    resistance.row(response + ofStrain) +=
                        (sphere == 0 ? 1 : -1) * weight / 12 * N * (N + 1) * (2 * N + 1) * pressure;
                } else
                    resistance.row(response + ofStrain) +=
                        weight / 12 * (N - 1) * N * (N + 1) * (N + 2) * pressure;
            }
        // from the origin to the centres, z = +-coth(xi)
        for (int sphere = 0; m < 2 && sphere < 2; sphere++) {
            const int response = numOfSphere * sphere;
            const Eigen::Matrix<Real, 1, Eigen::Dynamic, Eigen::RowMajor, 1, mostMotions> moment =
                (sphere == 0 ? 1 : -1) / std::tanh(xi[sphere]) *
                resistance.row(response + ofVelocity);
            if (m == 1) resistance.row(response + ofSpin) -= moment;
            resistance.row(response + ofStrain) -= moment * (m == 0 ? Real(2) / 3 : Real(0.5));
        }
        return resistance;
    }

    // Motions of each sphere, with the response of the fluid: velocity and force along z (m = 0) or
    // x (m = 1), angular velocity and torque about y (m = 1), strain and stresslet.
    static constexpr int ofVelocity = 0, ofSpin = 1;
    const int m, ofStrain, numOfSphere, numUnknowns;
    const Real xi[2];
    const int maxOrder;
};

/**
 * Torques about the line of centres. u_phi is harmonic of order 1, and its values sin(eta)/h are
 * sums of 2 sqrt 2 exp(-k |xi|) f_n.
 */
template <class Real>
Eigen::Matrix<Real, 2, 2> spinResistance(Real alpha, Real beta, int maxOrder) {
    Eigen::Matrix<Real, 2, 2> resistance = Eigen::Matrix<Real, 2, 2>::Zero();
    for (int n = maxOrder; n > 0; n--) {
        const Real k = n + Real(0.5), both = std::exp(-2 * k * (alpha + beta));
        const Real weight =
            -32 * std::acos(Real(-1)) * n * (n + 1) / std::expm1(-2 * k * (alpha + beta));
        resistance(0, 0) += weight * std::exp(-2 * k * alpha);
        resistance(1, 1) += weight * std::exp(-2 * k * beta);
        resistance(0, 1) -= weight * both;
    }
    resistance(1, 0) = resistance(0, 1);
    return resistance;
}

/** exp(-2 n alpha) times a small power of n is below double's rounding at n alpha = 22, and long
 * double's at 27. */
constexpr int digitsOrders = 22, longDigitsOrders = 27;

/** The units of the functions A, B and G, C and H, and M, for a sum of radii and unit viscosity. */
template <class Real>
struct Scales {
    Real A, B, C, M;
    Scales(Real sumOfRadii) {
        const Real pi = std::acos(Real(-1));
        A = 3 * pi * sumOfRadii;
        B = pi * sumOfRadii * sumOfRadii;
        C = B * sumOfRadii;
        M = Real(5) / 6 * C;
    }
};

/** The index of 11, 12 or 22 among functions that have no 21. */
int symmetricIndex(int i, int j) { return i + j; }

}  // namespace

template <class Real>
TwoSphereValues<Real> solveTwoSpheres(Real ratio, Real gap) {
    // a_1 = 1; cosh(alpha) - 1 = gap (gap + 2 a_2)/(2 r a_1) without cancellation
    const Real radius[2] = {1, ratio}, distance = gap * (1 + ratio) / 2, r = 1 + ratio + distance;
    const Real alpha = 2 * std::asinh(std::sqrt(distance * (distance + 2 * ratio) / (4 * r)));
    const Real beta = 2 * std::asinh(std::sqrt(distance * (distance + 2) / (4 * r * ratio)));
    const int enough = sizeof(Real) > sizeof(double) ? longDigitsOrders : digitsOrders;
    const int maxOrder = enough + int(enough / std::min(alpha, beta));
    const Real focal = std::sinh(alpha);
    const auto axial = Bispherical<Real>(0, alpha, beta, maxOrder).resistance();
    const auto transverse = Bispherical<Real>(1, alpha, beta, maxOrder).resistance();
    const auto planar = Bispherical<Real>(2, alpha, beta, maxOrder).resistance();
    const auto spin = spinResistance(alpha, beta, maxOrder);
    TwoSphereValues<Real> f;
    for (int i = 0; i < 2; i++)
        for (int j = 0; j < 2; j++) {
            const Scales<Real> scale((radius[i] + radius[j]) / focal);
            const auto along = axial.template block<2, 2>(2 * i, 2 * j);
            const auto across = transverse.template block<3, 3>(3 * i, 3 * j);
            if (i <= j) {
                const int ij = symmetricIndex(i, j);
                f[XA11 + ij] = along(0, 0) / scale.A;
                f[YA11 + ij] = across(0, 0) / scale.A;
                f[XC11 + ij] = spin(i, j) / scale.C;
                f[YC11 + ij] = across(1, 1) / scale.C;
                f[XM11 + ij] = along(1, 1) / scale.M;
                f[YM11 + ij] = across(2, 2) / scale.M;
                f[ZM11 + ij] = planar(i, j) / scale.M;
            }
            // The direction from sphere 1 to 2 is -z.
            f[YB11 + 2 * i + j] = across(1, 0) / scale.B;
            f[XG11 + 2 * i + j] = -Real(1.5) * along(1, 0) / scale.B;
            f[YG11 + 2 * i + j] = -across(2, 0) / scale.B;
            f[YH11 + 2 * i + j] = across(2, 1) / scale.C;
        }
    return f;
}
template TwoSphereValues<double> solveTwoSpheres(double ratio, double gap);
template TwoSphereValues<long double> solveTwoSpheres(long double ratio, long double gap);

TwoSphereValues<double> forceTorqueStressletPair(double ratio, double gap) {
    const double radius[2] = {1, ratio}, r = (1 + gap / 2) * (1 + ratio);
    StressletResponse response;
    const Eigen::MatrixXd resistance = inverseOfPositive(forceTorqueStressletMobility(
        {1, ratio}, {OpenMM::Vec3(), OpenMM::Vec3(0, 0, -r)}, 1.0, &response));
    // Forces and stresslets from rigid motions U and from strains E of the surfaces: with L L^T = G
    // and the coupling C, S = G^-1 (8 pi eta E - C f) and f = R (U - C^T G^-1 E).
    const Eigen::MatrixXd L = response.factor.triangularView<Eigen::Lower>();
    Eigen::MatrixXd ofForces = response.halfCoupling, half = Eigen::MatrixXd::Identity(10, 10);
    L.transpose().triangularView<Eigen::Upper>().solveInPlace(ofForces);
    L.triangularView<Eigen::Lower>().solveInPlace(half);
    Eigen::MatrixXd ofMotions = ofForces * resistance, ofStrains = half.transpose() * half;
    ofStrains = 8 * M_PI * ofStrains + ofMotions * ofForces.transpose();
    ofMotions *= -1;
    TwoSphereValues<double> f;
    for (int i = 0; i < 2; i++)
        for (int j = 0; j < 2; j++) {
            const Scales<double> scale(radius[i] + radius[j]);
            if (i <= j) {
                const int ij = symmetricIndex(i, j);
                f[XA11 + ij] = resistance(6 * i + 2, 6 * j + 2) / scale.A;
                f[YA11 + ij] = resistance(6 * i, 6 * j) / scale.A;
                f[XC11 + ij] = resistance(6 * i + 5, 6 * j + 5) / scale.C;
                f[YC11 + ij] = resistance(6 * i + 4, 6 * j + 4) / scale.C;
                f[XM11 + ij] = ofStrains(5 * i, 5 * j) / scale.M;
                f[YM11 + ij] = ofStrains(5 * i + 3, 5 * j + 3) / scale.M;
                f[ZM11 + ij] = ofStrains(5 * i + 1, 5 * j + 1) / scale.M;
            }
            // Ty of Ux; from sphere 1 to 2 is -z. The basis of stresslets has (zz - (xx + yy)/2)
            // sqrt(2/3) and (xz + zx)/sqrt 2.
            f[YB11 + 2 * i + j] = resistance(6 * i + 4, 6 * j) / scale.B;
            f[XG11 + 2 * i + j] = -std::sqrt(1.5) * ofMotions(5 * i, 6 * j + 2) / scale.B;
            f[YG11 + 2 * i + j] = -std::sqrt(0.5) * ofMotions(5 * i + 3, 6 * j) / scale.B;
            f[YH11 + 2 * i + j] = std::sqrt(0.5) * ofMotions(5 * i + 3, 6 * j + 4) / scale.C;
        }
    return f;
}

namespace {

/**
 * Coefficients of 1/xi, ln xi and xi ln xi near contact for the functions 11 of ratio l (Jeffrey
 * and Onishi 1984; those of strain from Jeffrey 1992; those of Z^M and Y^M_12 from fits to
 * solveTwoSpheres(); the tests compare all with solveTwoSpheres()). The coefficients of 22 are
 * those of 11 for 1/l. Only relative motion is singular, so the coefficients of 12 are minus those
 * of 11 in true units. Rotations and strains are exceptions and have their own coefficients here.
 */
struct LubricationConstants {
    double XA[3], YA[2], YB[2], XC, YC[2], YC12[2];
    double XG[3], YG[2], YH[2], YH12[2], XM[3], XM12[3], YM[2], YM12[2], ZM;
    explicit LubricationConstants(double l) {
        const double l2 = l * l, l3 = l2 * l, l4 = l2 * l2, q = 1 + l, q2 = q * q, q3 = q2 * q,
                     q4 = q2 * q2, q5 = q4 * q, q6 = q3 * q3;
        XA[0] = 2 * l2 / q3;
        XA[1] = -l * (1 + 7 * l + l2) / (5 * q3);
        XA[2] = -(1 + 18 * l - 29 * l2 + 18 * l3 + l4) / (42 * q3);
        YA[0] = -4 * l * (2 + l + 2 * l2) / (15 * q3);
        YA[1] = -2 * (16 - 45 * l + 58 * l2 - 45 * l3 + 16 * l4) / (375 * q3);
        YB[0] = l * (4 + l) / (5 * q2);
        YB[1] = (32 - 33 * l + 83 * l2 + 43 * l3) / (250 * q2);
        XC = l2 / (4 * q);
        YC[0] = -2 * l / (5 * q);
        YC[1] = -(8 + 6 * l + 33 * l2) / (125 * q);
        YC12[0] = -4 * l2 / (5 * q4);
        YC12[1] = -2 * l * (43 - 24 * l + 43 * l2) / (125 * q4);
        XG[0] = 3 * l2 / q3;
        XG[1] = -3 * l * (1 + 12 * l - 4 * l2) / (10 * q3);
        XG[2] = -(5 + 181 * l - 453 * l2 + 566 * l3 - 65 * l4) / (140 * q3);
        YG[0] = -l * (4 - l + 7 * l2) / (10 * q3);
        YG[1] = -(32 - 179 * l + 532 * l2 - 356 * l3 + 221 * l4) / (500 * q3);
        YH[0] = -l * (2 - l) / (10 * q2);
        YH[1] = -(16 - 61 * l + 180 * l2 + 2 * l3) / (500 * q2);
        YH12[0] = -2 * l2 * (1 + 7 * l) / (5 * q5);
        YH12[1] = -l * (43 + 147 * l - 185 * l2 + 221 * l3) / (125 * q5);
        XM[0] = 6 * l2 / (5 * q3);
        XM[1] = -3 * l * (1 + 17 * l - 9 * l2) / (25 * q3);
        XM[2] = -(5 + 272 * l - 831 * l2 + 1322 * l3 - 415 * l4) / (350 * q3);
        XM12[0] = 48 * l3 / (5 * q6);
        XM12[1] = -24 * l2 * (-4 + 17 * l - 4 * l2) / (25 * q6);
        XM12[2] = -4 * l * (-65 + 832 * l - 1041 * l2 + 832 * l3 - 65 * l4) / (175 * q6);
        YM[0] = -6 * l * (1 - l + 4 * l2) / (25 * q3);
        YM[1] = -(24 - 201 * l + 882 * l2 - 1182 * l3 + 591 * l4) / (625 * q3);
        YM12[0] = -12 * l2 * (7 - 10 * l + 7 * l2) / (25 * q6);
        YM12[1] = -6 * l * (221 - 748 * l + 1902 * l2 - 748 * l3 + 221 * l4) / (625 * q6);
        ZM = 3 * l2 * (1 + l2) / (10 * q3);
    }
};

/**
 * The expansion near contact replaces the solution below the gap `nearContact` and is fitted to the
 * solution up to the gap `fitTo`, in units of twice the reduced radius.
 */
constexpr double nearContact = 1e-3, fitTo = 4e-2;
constexpr int numFitGaps = 20, fitPower = 6;
/**
 * Beyond this gap the part that FTS lacks, of order (a/r)^6, is 1e-13 and less than the rounding of
 * the difference.
 */
constexpr double farApart = 300;

/**
 * The regular terms of a lubrication expansion: 1, u, then u^k and u^k ln u for k = 2 ... fitPower.
 */
Eigen::Array<double, 2 * fitPower, 1> nearContactTerms(double u, double scale) {
    Eigen::Array<double, 2 * fitPower, 1> terms;
    const double v = u / scale;
    terms[0] = 1;
    terms[1] = v;
    for (int k = 2; k <= fitPower; k++) {
        terms[2 * k - 2] = std::pow(v, k);
        terms[2 * k - 1] = std::pow(v, k) * std::log(v);
    }
    return terms;
}

double relativeGap(double u) { return 2 * u / (1 - u); }

}  // namespace

TwoSphereResistance::TwoSphereResistance(double ratio) : ratio(ratio) {
    if (!(ratio <= maximumRatio && ratio >= 1 / maximumRatio))
        throw OpenMM::OpenMMException(
            "the two-sphere resistance functions are tabulated for ratios of radii from 1/" +
            std::to_string(int(maximumRatio)) + " to " + std::to_string(int(maximumRatio)) +
            ", not " + std::to_string(ratio));
    // 1/gap = 1/(2u) - 1/2, ln gap = ln u + smooth, gap ln gap = 2 u ln u + smooth
    inverseGap.setZero();
    logarithm.setZero();
    gapLogarithm.setZero();
    const LubricationConstants one(ratio), two(1 / ratio);
    const double sum = 1 + ratio, A12 = -2 / sum, B12 = -4 / (sum * sum), B21 = B12 * ratio * ratio,
                 C12 = -8 / (sum * sum * sum);
    const auto set = [&](int function, double inverse, double log, double gapLog) {
        inverseGap[function] = inverse / 2;
        logarithm[function] = log;
        gapLogarithm[function] = 2 * gapLog;
    };
    set(XA11, one.XA[0], one.XA[1], one.XA[2]);
    set(XA12, A12 * one.XA[0], A12 * one.XA[1], A12 * one.XA[2]);
    set(XA22, two.XA[0], two.XA[1], two.XA[2]);
    set(YA11, 0, one.YA[0], one.YA[1]);
    set(YA12, 0, A12 * one.YA[0], A12 * one.YA[1]);
    set(YA22, 0, two.YA[0], two.YA[1]);
    set(YB11, 0, one.YB[0], one.YB[1]);
    set(YB12, 0, B12 * one.YB[0], B12 * one.YB[1]);
    set(YB22, 0, -two.YB[0], -two.YB[1]);
    set(YB21, 0, -B21 * two.YB[0], -B21 * two.YB[1]);
    set(XC11, 0, 0, one.XC);
    set(XC12, 0, 0, C12 * one.XC);
    set(XC22, 0, 0, two.XC);
    set(YC11, 0, one.YC[0], one.YC[1]);
    set(YC12, 0, one.YC12[0], one.YC12[1]);
    set(YC22, 0, two.YC[0], two.YC[1]);
    // Exchanging the spheres reverses the direction from 1 to 2, so G changes sign.
    set(XG11, one.XG[0], one.XG[1], one.XG[2]);
    set(XG12, B12 * one.XG[0], B12 * one.XG[1], B12 * one.XG[2]);
    set(XG22, -two.XG[0], -two.XG[1], -two.XG[2]);
    set(XG21, -B21 * two.XG[0], -B21 * two.XG[1], -B21 * two.XG[2]);
    set(YG11, 0, one.YG[0], one.YG[1]);
    set(YG12, 0, B12 * one.YG[0], B12 * one.YG[1]);
    set(YG22, 0, -two.YG[0], -two.YG[1]);
    set(YG21, 0, -B21 * two.YG[0], -B21 * two.YG[1]);
    set(YH11, 0, one.YH[0], one.YH[1]);
    set(YH12, 0, one.YH12[0], one.YH12[1]);
    set(YH22, 0, two.YH[0], two.YH[1]);
    set(YH21, 0, two.YH12[0], two.YH12[1]);
    set(XM11, one.XM[0], one.XM[1], one.XM[2]);
    set(XM12, one.XM12[0], one.XM12[1], one.XM12[2]);
    set(XM22, two.XM[0], two.XM[1], two.XM[2]);
    set(YM11, 0, one.YM[0], one.YM[1]);
    set(YM12, 0, one.YM12[0], one.YM12[1]);
    set(YM22, 0, two.YM[0], two.YM[1]);
    set(ZM11, 0, 0, one.ZM);
    set(ZM12, 0, 0, C12 * one.ZM);
    set(ZM22, 0, 0, two.ZM);

    // The rest, exact - FTS - singular, at a gap for which solveTwoSpheres() works.
    const auto remainder = [&](double u) -> Values {
        const double gap = relativeGap(u);
        if (gap > farApart) return -singularTerms(u);
        return solveTwoSpheres(ratio, gap) - forceTorqueStressletPair(ratio, gap) -
               singularTerms(u);
    };
    const double reduced = 4 * ratio / (sum * sum);  // twice the reduced radius in mean radii
    const auto fromGap = [&](double gap) { return gap * reduced / (2 + gap * reduced); };
    Eigen::MatrixXd terms(numFitGaps, 2 * fitPower), values(numFitGaps, NumTwoSphereFunctions);
    for (int i = 0; i < numFitGaps; i++) {
        const double u =
            fromGap(nearContact * std::pow(fitTo / nearContact, i / (numFitGaps - 1.0)));
        terms.row(i) = nearContactTerms(u, fromGap(fitTo));
        values.row(i) = remainder(u);
    }
    const Eigen::MatrixXd fit = leastSquares(terms, values);

    // Interpolation at Chebyshev nodes in 2 u^(1/4) - 1.
    rest = Rest([&](double x) {
        const double y = (1 + x) / 2, u = y * y * y * y;
        return u < fromGap(nearContact)
                   ? Values(fit.transpose() * nearContactTerms(u, fromGap(fitTo)).matrix())
                   : remainder(u);
    });
}

std::shared_ptr<const TwoSphereResistance> TwoSphereResistance::get(double ratio) {
    // The tables depend on the ratio alone, so sharing them has no visible effect.
    static std::mutex mutex;
    static std::map<double, std::shared_ptr<const TwoSphereResistance>> tables;
    const std::lock_guard<std::mutex> lock(mutex);
    std::shared_ptr<const TwoSphereResistance>& table = tables[ratio];
    if (!table) table = std::make_shared<const TwoSphereResistance>(ratio);
    return table;
}

template <int n>
Eigen::Array<double, n, 1> TwoSphereResistance::singularTerms(double u) const {
    const double log = std::log(u);
    return inverseGap.head<n>() / u + logarithm.head<n>() * log +
           gapLogarithm.head<n>() * (u * log);
}

template <int n>
Eigen::Array<double, n, 1> TwoSphereResistance::evaluate(double gap) const {
    const double u = gap / (2 + gap);
    return rest.addedTo<n>(singularTerms<n>(u), 2 * std::sqrt(std::sqrt(u)) - 1);
}
template Eigen::Array<double, NumFunctionsOfMotion, 1>
TwoSphereResistance::evaluate<NumFunctionsOfMotion>(double gap) const;
template TwoSphereValues<double> TwoSphereResistance::evaluate<NumTwoSphereFunctions>(
    double gap) const;

}  // namespace RigidHIPlugin
