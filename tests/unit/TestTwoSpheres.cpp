// The resistance functions of two spheres: the exact solution, the table, and the FTS far field of
// a pair agree with independent values and with limits.

#include <Eigen/Dense>

#include "EigenInstances.h"
#include "TestSupport.h"
#include "mobility/models/stokesian/ForceTorqueStresslet.h"
#include "mobility/models/stokesian/TwoSphereResistance.h"

using namespace OpenMM;
using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace std;

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
    for (int first : {XA11, YA11, XC11, YC11}) swap(g[first], g[first + 2]);
    g[YB11] = -f[YB22];
    g[YB12] = -f[YB21];
    g[YB21] = -f[YB12];
    g[YB22] = -f[YB11];
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
        const Values expected = Eigen::Map<const Values>(reference.values.data());
        EXPECT_LT((solveTwoSpheres(reference.ratio, gap) - expected).abs().maxCoeff(),
                  reference.tolerance)
            << reference.ratio;
        EXPECT_LT((TwoSphereResistance(reference.ratio).exact(gap) - expected).abs().maxCoeff(),
                  max(reference.tolerance, 1e-10));
    }
}

TEST(TwoSpheres, TableAgainstSolutionAtEveryGap) {
    // Gaps are on both sides of the gap where the nodes' values change from expansion to solution
    // (2e-3 reduced radii), and far beyond the range of the fit.
    for (double ratio : ratios) {
        const TwoSphereResistance table(ratio);
        double worst = 0;
        for (double gap = 1e-4; gap < 1e3; gap *= 2.1) {
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
        for (int f : {XA11, XA22, YA11, YA22, XC11, XC22, YC11, YC22}) alone[f] = 1;
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
