// The coupled Ornstein-Uhlenbeck process is compared with results in extended precision, for
// matrices S with known eigenvectors.

#include <Eigen/Dense>
#include <iostream>

#include "TestSupport.h"
#include "linearalgebra/Decompositions.h"
#include "linearalgebra/OneBlasThread.h"
#include "schemes/FluidOrnsteinUhlenbeck.h"

using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace std;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

class ProcessOfFluid : public testing::Test {
    const RigidHIPlugin::OneBlasThread singleBlasThread;  // as callers of SymmetricEigen must
};

using MatrixXl = Eigen::Matrix<long double, Eigen::Dynamic, Eigen::Dynamic>;
using VectorXl = Eigen::Matrix<long double, Eigen::Dynamic, 1>;

/** A matrix S whose eigenvectors and eigenvalues are known to all digits of a long double. */
struct Known {
    MatrixXl Q;
    VectorXl rates;
    Known(int n, long double largest, long double condition, int seed) {
        mt19937 random(seed);
        normal_distribution<double> normal;
        uniform_real_distribution<double> uniform;
        MatrixXl start(n, n);
        for (int i = 0; i < n; i++)
            for (int k = 0; k < n; k++) start(i, k) = normal(random);
        if (n > 0) Q = MatrixXl(Eigen::HouseholderQR<MatrixXl>(start).householderQ());
        rates.resize(n);
        for (int i = 0; i < n; i++) rates[i] = largest * powl(condition, -uniform(random));
        if (n > 0) rates[0] = largest;
        if (n > 1) rates[1] = largest / condition;
    }
    template <class Function>
    MatrixXd of(Function f) const {
        MatrixXl result = MatrixXl::Zero(rates.size(), rates.size());
        for (int i = 0; i < rates.size(); i++)
            result += f(rates[i]) * Q.col(i) * Q.col(i).transpose();
        return result.cast<double>();
    }
    MatrixXd S() const {
        return of([](long double x) { return x; });
    }
    MatrixXd inverse() const {
        return of([](long double x) { return 1 / x; });
    }
};

VectorXd randomVector(int n, int seed) {
    mt19937 random(seed);
    normal_distribution<double> normal;
    VectorXd v(n);
    for (int i = 0; i < n; i++) v[i] = normal(random);
    return v;
}

// From 40 rows on LAPACK decomposes the matrix.
const int sizes[] = {1, 2, 6, 12, 39, 40, 41, 90};
/** The uncertainty of the rates after S was rounded to doubles, relative to the largest rate: a few
 * roundings. */
const double rounding = 2e-15;

double relativeError(const MatrixXd& a, const MatrixXd& exact) {
    return (a - exact).norm() / exact.norm();
}

/** @param stride  from power of ten to power of ten */
void checkMatrixFunctions(int stride) {
    double worst = 0;
    for (int n : sizes)
        for (long double condition : {1.0L, 3.0L, 100.0L})
            for (int exponent = -14; exponent <= 14; exponent += n < 90 ? stride : 7) {
                const double h = 0.002;
                const Known known(n, powl(10, exponent) / h, condition, 31 * n + exponent);
                const MatrixXd decay = known.of([&](long double x) { return expm1l(-x * h); });
                const MatrixXd noise =
                    known.of([&](long double x) { return sqrtl(-expm1l(-2 * x * h)); });
                for (bool inverse : {false, true}) {
                    FluidOrnsteinUhlenbeck process;
                    process.decompose(inverse ? known.inverse() : known.S(), inverse);
                    MatrixXd measuredDecay, measuredNoise;
                    process.matrices(h, measuredDecay, measuredNoise);
                    const double error = max(relativeError(measuredDecay, decay),
                                             relativeError(measuredNoise, noise));
                    ASSERT_LT(error, 1e-12)
                        << n << " rows, h S = 1e" << exponent << ", condition " << condition;
                    worst = max(worst, error);
                    // exp(-S h) itself has as many correct digits as h S, rounded to doubles,
                    // determines.
                    const MatrixXd exponential =
                        known.of([&](long double x) { return expl(-x * h); });
                    if (exponential.norm() < 1e-290) continue;
                    const MatrixXd all = measuredDecay + MatrixXd::Identity(n, n);
                    ASSERT_LT((all - exponential).norm(),
                              1e-12 * max(exponential.norm(), sqrt(double(n))));
                }
            }
    cout << "largest relative error " << worst << endl;
}

}  // namespace

TEST_F(ProcessOfFluid, BothMatrixFunctionsAtEveryScale) { checkMatrixFunctions(2); }
TEST_F(ProcessOfFluid, FullBothMatrixFunctionsAtEveryPowerOfTen) { checkMatrixFunctions(1); }

TEST_F(ProcessOfFluid, StepIsTheMatrices) {
    for (int n : sizes)
        for (double hS : {1e-14, 1e-9, 1e-3, 0.49, 0.51, 1.0, 30.0, 1e5, 1e14})
            for (bool inverse : {false, true}) {
                const double h = 0.01, kT = 2.5;
                const Known known(n, hS / h, 50, n);
                FluidOrnsteinUhlenbeck process;
                process.decompose(inverse ? known.inverse() : known.S(), inverse);
                const VectorXd start = randomVector(n, 1), chi = randomVector(n, 2);
                const MatrixXd decay = known.of([&](long double x) { return expm1l(-x * h); });
                const MatrixXd noise =
                    known.of([&](long double x) { return sqrtl(-expm1l(-2 * x * h)); });
                VectorXd Z = start;
                process.step(h, 0, Z, VectorXd());  // without noise chi may be empty
                // Where the momenta have decayed completely, only the rounding of the start is
                // left.
                const VectorXd left = start + decay * start;
                ASSERT_LT((Z - left).norm(), 1e-13 * start.norm()) << n << " rows, h S " << hS;
                if (hS < 0.1) {
                    ASSERT_LT((Z - start - decay * start).norm(), 3e-16 * sqrt(n) * start.norm());
                }
                Z = start;
                process.step(h, kT, Z, chi);
                ASSERT_LT((Z - left - sqrt(kT) * noise * chi).norm(),
                          1e-12 * (start.norm() + chi.norm()));
                // The noise alone keeps its relative accuracy where it is small.
                Z.setZero();
                process.step(h, kT, Z, chi);
                const VectorXd expected = sqrt(kT) * noise * chi;
                ASSERT_LT((Z - expected).norm(), 1e-12 * noise.norm() * chi.norm());
            }
}

TEST_F(ProcessOfFluid, StrongFrictionLeavesNoTraceOfTheStart) {
    // exp(-800) is negligible. What remains must not be rounding of the start, however large the
    // start is.
    const Known known(12, 800 * 50, 50, 5);
    FluidOrnsteinUhlenbeck process;
    process.decompose(known.S(), false);
    VectorXd Z = 1e6 * randomVector(12, 1);
    process.step(1.0, 0, Z, VectorXd());
    EXPECT_LT(Z.norm(), 1e-300);
}

TEST_F(ProcessOfFluid, NoiseHasTheCovarianceThatKeepsTheGibbsDistribution) {
    for (int n : sizes)
        for (double hS : {1e-12, 1e-2, 1.0, 1e3}) {
            const Known known(n, hS, 100, 7 * n);
            FluidOrnsteinUhlenbeck process;
            process.decompose(known.S(), false);
            MatrixXd decayMinusOne, noise;
            process.matrices(1, decayMinusOne, noise);
            EXPECT_LT((noise - noise.transpose()).norm(), 1e-14 * noise.norm());
            const MatrixXd covariance = noise * noise.transpose();
            ASSERT_LT(
                relativeError(covariance, known.of([](long double x) { return -expm1l(-2 * x); })),
                1e-12);
            const MatrixXd decay = decayMinusOne + MatrixXd::Identity(n, n);
            ASSERT_LT((decay * decay.transpose() + covariance - MatrixXd::Identity(n, n)).norm(),
                      1e-13 * n);
        }
}

TEST_F(ProcessOfFluid, StepsAddUp) {
    // A step over h1 + h2 is the same as steps over h1 and then h2: the decays multiply, and the
    // covariances follow.
    for (int n : sizes) {
        const Known known(n, 3, 30, n + 1);
        FluidOrnsteinUhlenbeck process;
        process.decompose(known.inverse(), true);
        MatrixXd decay[3], noise[3];
        const double h[3] = {0.3, 0.9, 1.2};
        for (int i = 0; i < 3; i++) {
            process.matrices(h[i], decay[i], noise[i]);
            decay[i] += MatrixXd::Identity(n, n);
        }
        EXPECT_LT(relativeError(decay[1] * decay[0], decay[2]), 1e-12);
        const MatrixXd first = noise[0] * noise[0].transpose(),
                       second = noise[1] * noise[1].transpose();
        EXPECT_LT(relativeError(decay[1] * first * decay[1].transpose() + second,
                                noise[2] * noise[2].transpose()),
                  1e-12);
        VectorXd once = randomVector(n, 3), twice = once;
        process.step(h[2], 0, once, VectorXd());
        process.step(h[0], 0, twice, VectorXd());
        process.step(h[1], 0, twice, VectorXd());
        EXPECT_LT((once - twice).norm(), 1e-12 * once.norm());
    }
}

TEST_F(ProcessOfFluid, OfNothing) {
    FluidOrnsteinUhlenbeck process;
    process.decompose(MatrixXd(0, 0), false);
    MatrixXd decay, noise;
    process.matrices(1, decay, noise);
    EXPECT_EQ(decay.size() + noise.size(), 0);
    VectorXd Z, chi;
    process.step(1, 1, Z, chi);
    EXPECT_EQ(Z.size(), 0);
}

TEST_F(ProcessOfFluid, OneObjectTakesMatricesOfAnySize) {
    FluidOrnsteinUhlenbeck process;
    for (int n : {41, 3, 90, 40, 39, 1}) {
        const Known known(n, 1, 10, n);
        process.decompose(known.S(), false);
        VectorXd Z = VectorXd::Ones(n);
        process.step(1, 0, Z, VectorXd());
        const VectorXd expected =
            known.of([](long double x) { return expl(-x); }) * VectorXd::Ones(n);
        EXPECT_LT((Z - expected).norm(), 1e-12 * expected.norm());
    }
}

TEST_F(ProcessOfFluid, RotationsThatTheFluidDoesNotSeeKeepTheirMomentum) {
    // S has a null vector, up to rounding of either sign. The momentum along this vector does not
    // decay and has no noise.
    for (int n : {6, 45})
        for (double rounded : {-1e-15, 0.0, 1e-15}) {
            Known known(n, 2, 10, n);
            known.rates[1] = 0;
            MatrixXd S =
                known.S() + rounded * (known.Q.col(1) * known.Q.col(1).transpose()).cast<double>();
            FluidOrnsteinUhlenbeck process;
            process.decompose(S, false);
            const VectorXd line = known.Q.col(1).cast<double>();
            VectorXd Z = line;
            process.step(1, 1, Z, randomVector(n, 4));
            EXPECT_NEAR(line.dot(Z), 1, 1e-6);
            Z = line;
            process.step(1, 0, Z, VectorXd());
            EXPECT_LT((Z - line).norm(), 1e-13);
        }
}

TEST_F(ProcessOfFluid, MatricesThatAreNotPositiveAreRefused) {
    for (int n : {1, 6, 45}) {
        Known known(n, 1, 10, n);
        known.rates[n - 1] = -1e-3;
        FluidOrnsteinUhlenbeck process;
        if (n > 1) {
            expectError([&] { process.decompose(known.S(), false); },
                        {"the friction matrix is not positive definite", "-0.001 to 1",
                         "nearly touching particles"});
            expectError([&] { process.decompose(known.S(), true); },
                        {"the mobility matrix is not positive definite"});
        }
        // A mobility must be positive definite, because its inverse is the friction.
        MatrixXd zero = MatrixXd::Zero(n, n);
        expectError([&] { process.decompose(zero, true); }, {"not positive definite"});
        MatrixXd bad = known.S();
        bad(0, n - 1) = bad(n - 1, 0) = NAN;
        expectError([&] { process.decompose(bad, false); },
                    {"the eigenvalues of a symmetric matrix of " + to_string(n) +
                     " rows did not converge"});
    }
}
