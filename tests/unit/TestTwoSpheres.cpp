// The resistance functions of two spheres: the exact solution, the table, and the FTS far field of
// a pair agree with independent values and with limits.

#include <Eigen/Dense>

#include "TestSupport.h"
#include "linearalgebra/Decompositions.h"
#include "mobility/models/stokesian/ForceTorqueStresslet.h"
#include "mobility/models/stokesian/TwoSphereResistance.h"

using namespace OpenMM;
using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace std;
using Eigen::MatrixXd;

using Values = TwoSphereValues<double>;

namespace {

struct Reference {
    double ratio, s;
    vector<double> values;  // in the order of TwoSphereFunction
    double tolerance;
};

/**
 * Equal spheres: boundary collocation with Lamb's solution. Unequal: Jeffrey and Onishi's power
 * series in 1/s, by their recursions, 110 to 130 terms without any resummation (converged to 1e-13
 * at these distances), and again by least squares of Lamb's solutions about both centres on 150
 * points a meridian, 45 to 50 harmonics: both agree to the digits given.
 */
const vector<Reference> references = {
    {1,
     3,
     {1.3684796021, -0.6701750418, 1.3684796021, 1.0921017533, -0.2971758580, 1.0921017533,
      -0.0567464842, 0.1853881406, -0.1853881406, 0.0567464842, 1.0019591542, -0.0371453527,
      1.0019591542, 1.0179857151, 0.0216646650, 1.0179857151},
     6e-11},
    {1,
     25.0 / 12,
     {4.5704210744, -3.9204733872, 4.5704210744, 1.4215986203, -0.6898578424, 1.4215986203,
      -0.4323363171, 0.6573566895, -0.6573566895, 0.4323363171, 1.0305903123, -0.1207014998,
      1.0305903123, 1.2605911008, 0.1093199134, 1.2605911008},
     6e-11},
    {1,
     2.01,
     {27.034008, -26.388286, 27.034008, 1.7669602, -1.0414384, 1.7669602, -0.92097765, 1.1567743,
      -1.1567743, 0.92097765, 1.0467746, -0.14419486, 1.0467746, 1.6350647, 0.20555108, 1.6350647},
     6e-7},
    {0.3,
     3,
     {1.197567317114, -0.424038095726, 1.307187735486, 1.059630114724, -0.211222819147,
      1.083232757099, -0.056251283498, 0.305176804514, -0.027235302349, 0.021160893875,
      1.000528406786, -0.013277240737, 1.001228389918, 1.019155743680, 0.007501876945,
      1.005828516298},
     2e-12},
    {0.1,
     2.8,
     {1.083820595069, -0.181626998333, 1.193690905069, 1.033049493864, -0.107425661908,
      1.061876441864, -0.037687389531, 0.222289572594, -0.002199388304, 0.005802851952,
      1.000075954703, -0.001646348782, 1.000387697001, 1.014497453615, 0.000894543054,
      1.001380939914},
     2e-12}};

/** The functions with the spheres' numbers exchanged. The direction from 1 to 2 changes sign, and
 * so does B. */
Values exchanged(const Values& f) {
    Values g = f;
    for (int first : {XA11, YA11, XC11, YC11, XM11, YM11, ZM11}) swap(g[first], g[first + 2]);
    for (int first : {YB11, XG11, YG11, YH11}) {
        const double sign = first == YH11 ? 1 : -1;
        for (int k = 0; k < 4; k++) g[first + k] = sign * f[first + 3 - k];
    }
    return g;
}

/** Largest difference, relative to the function where it exceeds 1. */
double difference(const Values& f, const Values& g) {
    return ((f - g).abs() / g.abs().max(1)).maxCoeff();
}

const vector<double> ratios = {1, 0.7, 0.3, 0.1, 2.5};

}  // namespace

TEST(TwoSpheres, ReferenceValues) {
    for (const Reference& reference : references) {
        const double gap = reference.s - 2;
        const auto expected = Eigen::Map<const Eigen::ArrayXd>(reference.values.data(), XG11);
        const Values solution = solveTwoSpheres(reference.ratio, gap),
                     table = TwoSphereResistance(reference.ratio).exact(gap);
        EXPECT_LT((solution.head(XG11) - expected).abs().maxCoeff(), reference.tolerance)
            << reference.ratio;
        EXPECT_LT((table.head(XG11) - expected).abs().maxCoeff(), max(reference.tolerance, 1e-10));
    }
}

TEST(TwoSpheres, ReferenceValuesOfStrain) {
    // Equal spheres, by boundary collocation with Lamb's solution: the force along the line of a
    // sphere's own strain sqrt(2/3) (zz - (xx + yy)/2), and the stresslets of its own strain.
    struct Case {
        double gap, force, stresslets[3];
    };
    for (const Case& c : {Case{1, 3.34425676, {1.08534939, 1.01453981, 1.00052004}},
                          Case{0.1, 42.50324431, {2.57280143, 1.18112812, 1.01217811}},
                          Case{0.01, 396.03234893, {16.34623813, 1.43973110, 1.02219056}}}) {
        const Values f = TwoSphereResistance(1).exact(c.gap);
        EXPECT_NEAR(4 * M_PI * sqrt(2.0 / 3) * f[XG11], c.force, 6e-9);
        int k = 0;
        for (int function : {XM11, YM11, ZM11}) EXPECT_NEAR(f[function], c.stresslets[k++], 6e-9);
    }
}

TEST(TwoSpheres, AffineMotionIsNotSingular) {
    // Where both surfaces take part in one affine motion, nothing flows out of the gap: with the
    // second sphere's velocity E.(2 + gap) (equal spheres) all singular terms cancel, of stresslets
    // of strain and of rotation alike. The three products of the gap are 1e-6, 1e-4, 1e-2.
    const TwoSphereResistance table(1);
    Values last = Values::Zero();
    for (double gap : {1e-6, 1e-4, 1e-2}) {
        const Values f = table.exact(gap);
        const double r = 2 + gap;
        // in units of pi eta (2a)^2 a: strain along the line, across it, rotation
        const double along = 5.0 / 3 * (f[XM11] + f[XM12]) + f[XG12] * r * 2 / 3,
                     across = 5.0 / 3 * (f[YM11] + f[YM12]) + f[YG12] * r,
                     spin = 2 * (f[YH11] + f[YH12]) + f[YG12] * r;
        printf("gap %g: %.6f %.6f %.6f\n", gap, along, across, spin);
        Values now = Values::Zero();
        now[0] = along, now[1] = across, now[2] = spin;
        if (gap > 1e-6) {
            EXPECT_LT((now - last).abs().maxCoeff(), 3 * gap * abs(log(gap)));
        }
        last = now;
    }
}

TEST(TwoSpheres, DifferencesArePositive) {
    // Exact - FTS of forces, torques and stresslets is positive semidefinite, at any gap.
    for (double ratio : ratios)
        for (double gap : {1e-6, 1e-4, 3e-3, 0.05, 1.0, 8.0, 18.0}) {
            const Values f = TwoSphereResistance::get(ratio)->correction(gap);
            const double a[2] = {1, ratio};
            // Parts of azimuthal order 0, 1 and 2 of each sphere: force and stresslet along the
            // line; force, torque and stresslet across; stresslet. Units of own frictions.
            MatrixXd zero(4, 4), one(6, 6), two(2, 2);
            for (int p = 0; p < 2; p++)
                for (int q = 0; q < 2; q++) {
                    const double s = a[p] + a[q], A = s / 2 / sqrt(a[p] * a[q]),
                                 cube = s * s * s / 8 / pow(a[p] * a[q], 1.5);
                    const auto ofForce = [&](int i, int j) {
                        // Stresslet of i, force of j: pi s^2 over sqrt(6 pi a_j 20/3 pi a_i^3)
                        const double t = a[i] + a[j];
                        return t * t / sqrt(40 * a[j] * pow(a[i], 3));
                    };
                    zero(2 * p, 2 * q) = A * f[XA11 + p + q];
                    zero(2 * p + 1, 2 * q + 1) = cube * f[XM11 + p + q];
                    zero(2 * p + 1, 2 * q) = sqrt(2.0 / 3) * ofForce(p, q) * f[XG11 + 2 * p + q];
                    zero(2 * q, 2 * p + 1) = zero(2 * p + 1, 2 * q);
                    one(3 * p, 3 * q) = A * f[YA11 + p + q];
                    one(3 * p + 1, 3 * q + 1) = cube * f[YC11 + p + q];
                    one(3 * p + 2, 3 * q + 2) = cube * f[YM11 + p + q];
                    one(3 * p + 1, 3 * q) =
                        -s * s / sqrt(48 * a[q] * pow(a[p], 3)) * f[YB11 + 2 * p + q];
                    one(3 * q, 3 * p + 1) = one(3 * p + 1, 3 * q);
                    one(3 * p + 2, 3 * q) = sqrt(2.0) * ofForce(p, q) * f[YG11 + 2 * p + q];
                    one(3 * q, 3 * p + 2) = one(3 * p + 2, 3 * q);
                    one(3 * p + 2, 3 * q + 1) = sqrt(2.0) * s * s * s /
                                                sqrt(8 * 20.0 / 3 * pow(a[p] * a[q], 3)) *
                                                f[YH11 + 2 * p + q];
                    one(3 * q + 1, 3 * p + 2) = one(3 * p + 2, 3 * q + 1);
                    two(p, q) = cube * f[ZM11 + p + q];
                }
            double least = INFINITY;
            for (const MatrixXd& m : {zero, one, two}) {
                EXPECT_EQ(m, m.transpose());
                least = min(least, Eigen::SelfAdjointEigenSolver<MatrixXd>(m).eigenvalues()[0]);
            }
            EXPECT_GT(least, -1e-9 * max(1.0, f[XA11])) << ratio << " " << gap;
            if (ratio == 1 && gap == 1.0) {
                EXPECT_GT(least, 5e-6);
            }
        }
}

namespace {

/** @param factor  from gap to gap */
void checkTable(double factor) {
    // Gaps are on both sides of the gap where the nodes' values change from expansion to solution
    // (2e-3 reduced radii), and far beyond the range of the fit.
    for (double ratio : ratios) {
        const TwoSphereResistance table(ratio);
        double worst = 0;
        for (double gap = 1e-4; gap < 1e3; gap *= factor) {
            // The rounding of doubles grows as 1/gap.
            const Values solution =
                gap < 0.01 ? Values(solveTwoSpheres<long double>(ratio, gap).cast<double>())
                           : solveTwoSpheres(ratio, gap);
            worst = max(worst, difference(table.exact(gap), solution));
        }
        printf("ratio %g: largest error %.1e\n", ratio, worst);
        EXPECT_LT(worst, 5e-10);
    }
}

}  // namespace

TEST(TwoSpheres, TableAgainstSolutionAtEveryGap) { checkTable(3.3); }
TEST(TwoSpheres, FullTableAgainstSolutionAtMoreGaps) { checkTable(1.7); }

TEST(TwoSpheres, FullTableNearContact) {
    for (double ratio : {1.0, 0.3}) {
        const TwoSphereResistance table(ratio);
        for (double gap : {1e-6, 1e-5})
            EXPECT_LT(difference(table.exact(gap),
                                 solveTwoSpheres<long double>(ratio, gap).cast<double>()),
                      1e-9)
                << ratio << " " << gap;
    }
}

TEST(TwoSpheres, LubricationLimits) {
    // The error at gaps below the fit, tested above, shows that all constants of the singular terms
    // are right. In addition, for equal spheres approaching each other: 1/(4 gap), the leading term
    // of lubrication theory.
    EXPECT_NEAR(TwoSphereResistance(1).exact(1e-8)[XA11] * 1e-8, 0.25, 1e-7);
    // For equal spheres shearing past each other the leading term is -(1/6) ln(gap).
    const TwoSphereResistance equal(1);
    EXPECT_NEAR((equal.exact(1e-9)[YA11] - equal.exact(1e-8)[YA11]) / log(10), 1.0 / 6, 1e-7);
}

TEST(TwoSpheres, ExchangeOfSpheres) {
    for (double ratio : {1.0, 0.3, 0.1}) {
        const TwoSphereResistance table(ratio), other(1 / ratio);
        for (double gap : {1e-8, 1e-3, 0.1, 3.0, 100.0}) {
            EXPECT_LT(difference(table.exact(gap), exchanged(other.exact(gap))), 1e-9);
            if (gap >= 1e-2) {
                EXPECT_LT(difference(solveTwoSpheres(ratio, gap),
                                     exchanged(solveTwoSpheres(1 / ratio, gap))),
                          1e-11);
            }
        }
    }
}

TEST(TwoSpheres, FarApart) {
    for (double ratio : ratios) {
        const TwoSphereResistance table(ratio);
        // At infinity each sphere is alone.
        Values alone = Values::Zero();
        for (int f :
             {XA11, XA22, YA11, YA22, XC11, XC22, YC11, YC22, XM11, XM22, YM11, YM22, ZM11, ZM22})
            alone[f] = 1;
        EXPECT_LT((table.exact(1e7) - alone).abs().maxCoeff(), 1e-6);
        // Rotne-Prager-Yamakawa is the far field of A12: -6 eta pi a_1 a_2 3/(2 r), and so on. The
        // terms that FTS lacks are much smaller.
        const double gap = 1e3, r = (1 + gap / 2) * (1 + ratio);
        EXPECT_NEAR(table.exact(gap)[XA12] * (1 + ratio) / 2 * r / (-1.5 * ratio), 1, 2e-4);
        EXPECT_NEAR(table.exact(gap)[YB12] * (1 + ratio) * (1 + ratio) * r * r / (6 * ratio), 1,
                    3e-3);
        // FTS lacks higher multipoles, which make reflections of order (a/r)^6 and higher.
        const auto missing = [&](double x) {
            return (solveTwoSpheres<long double>(ratio, x).cast<double>() -
                    forceTorqueStressletPair(ratio, x))
                .abs()
                .maxCoeff();
        };
        EXPECT_LT(missing(18) / missing(8), pow(0.5, 5.5)) << ratio;
        EXPECT_LT(difference(table.correction(1e4), Values::Zero()), 1e-11);
    }
}

TEST(TwoSpheres, SmoothAtEveryGap) {
    // The second derivative by finite differences converges as h² everywhere, so also where the
    // source of the table's nodes changes.
    for (double ratio : {1.0, 0.1}) {
        const TwoSphereResistance table(ratio);
        for (double gap : {3e-4, 1e-3, 2e-3, 0.02, 0.5, 5.0})
            for (int f : {XA11, YA12, YB21, YC22}) {
                const auto second = [&](double h) {
                    return (table.correction(gap * (1 + h))[f] - 2 * table.correction(gap)[f] +
                            table.correction(gap * (1 - h))[f]) /
                           (h * h);
                };
                const double a = second(0.08), b = second(0.04), c = second(0.02);
                EXPECT_NEAR((a - b) / (b - c), 4, 0.2) << ratio << " " << gap << " " << f;
            }
    }
}

TEST(TwoSpheres, ForceTorqueStressletBySurfaceQuadrature) {
    // Galerkin's matrix is computed by quadrature from its definition: tractions 1, e x n, B.n on
    // both spheres, with the Oseen tensor between them.
    const double a[2] = {1, 0.4}, distance = 1.9;
    const int numPolar = 28, numAzimuth = 28;
    Eigen::Matrix<double, numPolar, 1> diagonal = Eigen::Matrix<double, numPolar, 1>::Zero();
    Eigen::Matrix<double, numPolar - 1, 1> off;
    for (int i = 1; i < numPolar; i++) off[i - 1] = i / sqrt(4.0 * i * i - 1);
    Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> gauss;  // Golub and Welsch
    gauss.computeFromTridiagonal(Eigen::VectorXd(diagonal), Eigen::VectorXd(off));
    using Tractions = Eigen::Matrix<double, 3, 11>;
    const Eigen::Vector3d line = Eigen::Vector3d(1, 2, -2) / 3;
    vector<Eigen::Vector3d> points[2];
    vector<Tractions> tractions[2];
    for (int sphere = 0; sphere < 2; sphere++)
        for (int i = 0; i < numPolar; i++)
            for (int k = 0; k < numAzimuth; k++) {
                const double x = gauss.eigenvalues()[i], phi = 2 * M_PI * (k + 0.5) / numAzimuth,
                             q = sqrt(1 - x * x);
                const double weight = pow(gauss.eigenvectors()(0, i), 2) / numAzimuth;  // sums to 1
                const Eigen::Vector3d n(q * cos(phi), q * sin(phi), x);
                points[sphere].push_back(a[sphere] * n + (sphere ? Eigen::Vector3d(-distance * line)
                                                                 : Eigen::Vector3d::Zero()));
                Tractions t;
                t.leftCols<3>().setIdentity();
                for (int axis = 0; axis < 3; axis++)  // torque 1: 3/(2 a) e x n
                    t.col(3 + axis) = 1.5 / a[sphere] * Eigen::Vector3d::Unit(axis).cross(n);
                Eigen::Matrix3d basis[5];
                for (Eigen::Matrix3d& b : basis) b.setZero();
                basis[0].diagonal() << -1 / sqrt(6), -1 / sqrt(6), 2 / sqrt(6);
                basis[1].diagonal() << sqrt(0.5), -sqrt(0.5), 0;
                basis[2](0, 1) = basis[2](1, 0) = basis[3](0, 2) = basis[3](2, 0) = basis[4](1, 2) =
                    basis[4](2, 1) = sqrt(0.5);
                for (int s = 0; s < 5; s++)
                    t.col(6 + s) = 3 / a[sphere] * basis[s] * n;  // stresslet 1
                tractions[sphere].push_back(weight * t);
            }
    Eigen::Matrix<double, 22, 22> full = Eigen::Matrix<double, 22, 22>::Zero();
    for (size_t i = 0; i < points[0].size(); i++) {
        Tractions sum = Tractions::Zero();
        for (size_t j = 0; j < points[1].size(); j++) {
            const Eigen::Vector3d r = points[0][i] - points[1][j];
            const double inverse = 1 / r.norm();
            const Eigen::Matrix3d oseen =
                inverse * Eigen::Matrix3d::Identity() + pow(inverse, 3) * r * r.transpose();
            sum += oseen * tractions[1][j];
        }
        full.block<11, 11>(0, 11) += tractions[0][i].transpose() * sum;
    }
    full.block<11, 11>(11, 0) = full.block<11, 11>(0, 11).transpose();
    full /= 8 * M_PI;
    for (int s = 0; s < 2; s++)  // Stokes' drag and torque, Einstein's stresslet 20/3 pi a³
        for (int k = 0; k < 11; k++)
            full(11 * s + k, 11 * s + k) =
                k < 3 ? 1 / (6 * M_PI * a[s])
                      : (k < 6 ? 1 / (8 * M_PI * pow(a[s], 3)) : 3 / (20 * M_PI * pow(a[s], 3)));
    const Eigen::Matrix<double, 22, 22> inverse = full.inverse();
    Eigen::Matrix<double, 12, 12> friction;
    for (int p = 0; p < 2; p++)
        for (int q = 0; q < 2; q++)
            friction.block<6, 6>(6 * p, 6 * q) = inverse.block<6, 6>(11 * p, 11 * q);
    const Eigen::MatrixXd mobility = forceTorqueStressletMobility(
        {a[0], a[1]}, {Vec3(), Vec3(line[0], line[1], line[2]) * -distance}, 1.0);
    EXPECT_LT((mobility - friction.inverse()).cwiseAbs().maxCoeff(), 1e-11);
}

TEST(TwoSpheres, RefusedRatios) {
    for (double ratio : {0.0999, 10.001, 0.0, -1.0, double(NAN)})
        expectError(
            [&] { TwoSphereResistance table(ratio); },
            {"the two-sphere resistance functions are tabulated", "1/10 to 10", to_string(ratio)});
    EXPECT_EQ(TwoSphereResistance::get(0.5), TwoSphereResistance::get(0.5));
}
