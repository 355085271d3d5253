// Functions of matrices times vectors by Lanczos iteration have the promised accuracy, also for
// hard spectra and for suspensions of spheres. Further tests are of error messages.

#include "linearalgebra/Decompositions.h"
#include "linearalgebra/Lanczos.h"

#include <Eigen/Dense>

#include "TestSupport.h"
#include "mobility/MobilityAt.h"
#include "mobility/models/rotneprager/RotnePragerYamakawa.h"

using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace OpenMM;
using namespace std;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

/** The matrix Q diag(values) Q^T. Without Q it is diagonal, and only the iteration itself makes
 * rounding errors. */
struct KnownMatrix {
    VectorXd values;
    MatrixXd Q;
    MatrixXd times(const MatrixXd& x, const VectorXd& factors) const {
        if (Q.size() == 0) return factors.asDiagonal() * x;
        return Q * (factors.asDiagonal() * (Q.transpose() * x)).eval();
    }
    Lanczos::Product product() const {
        return [this](double, const MatrixXd& x, MatrixXd& y) { y = times(x, values); };
    }
    VectorXd apply(const function<double(double)>& f, const VectorXd& x) const {
        return times(x, values.unaryExpr([&](double v) { return f(v); }));
    }
};

MatrixXd normal(mt19937& random, int rows, int columns) {
    normal_distribution<double> gauss;
    MatrixXd m(rows, columns);
    for (int i = 0; i < m.size(); i++) m.data()[i] = gauss(random);
    return m;
}
MatrixXd rotation(mt19937& random, int n) {
    return Eigen::HouseholderQR<MatrixXd>(normal(random, n, n)).householderQ();
}
KnownMatrix known(const vector<double>& values) {
    return {Eigen::Map<const VectorXd>(values.data(), values.size()), MatrixXd()};
}

enum Spectrum {
    Uniform,
    Logarithmic,
    Clusters,
    FewHigh,
    FewLow,
    Equal,
    ManyHigh,
    DenseEnds,
    numSpectra
};
/** Eigenvalues between 1/condition and 1. */
VectorXd spectrum(mt19937& random, Spectrum kind, int n, double condition) {
    uniform_real_distribution<double> uniform(0, 1);
    VectorXd v(n);
    for (int i = 0; i < n; i++) {
        const double u = uniform(random), least = 1 / condition;
        switch (kind) {
            case Uniform: v[i] = least + (1 - least) * u; break;
            case Logarithmic: v[i] = pow(condition, -u); break;
            case Clusters:
                v[i] = pow(condition, -floor(4 * u) / 3) * (1 + 1e-3 * uniform(random));
                break;
            case FewHigh: v[i] = i < 3 ? 1 : least * (1 + u); break;
            case FewLow: v[i] = i < 3 ? least * (1 + u) : (1 + u) / 2; break;
            case Equal: v[i] = 1; break;
            case ManyHigh: v[i] = 1 / (1 + (condition - 1) * u * u * u); break;
            default: v[i] = least + pow(sin(M_PI / 2 * u), 2); break;
        }
    }
    return v;
}

/** The error relative to the norm of the expected result; 0 where both are zero. */
double errorOf(const Lanczos& lanczos, const MatrixXd& result, const KnownMatrix& A,
               const SpectralFunction& f, const VectorXd& x, int column = 0) {
    const VectorXd expected = A.apply(lanczos.isIncrement(column) ? f.minusOne : f.value, x);
    const double nothing = 1e-139 * x.norm();
    if (expected.norm() < nothing) return result.col(column).norm() < 10 * nothing ? 0 : INFINITY;
    return (result.col(column) - expected).norm() / expected.norm();
}

template <class Action>
string messageOf(Action action) {
    try {
        action();
    } catch (const OpenMMException& e) {
        return e.what();
    }
    return "no exception";
}
void expectFragment(const string& message, const string& fragment) {
    EXPECT_NE(message.find(fragment), string::npos) << message;
}

}  // namespace

TEST(Lanczos, ThePromiseHolds) {
    mt19937 random(1);
    uniform_real_distribution<double> uniform(0, 1);
    double worst = 0;
    int refused = 0, cases = 0;
    for (int n : {12, 60, 150})
        for (int kind = 0; kind < numSpectra; kind++)
            for (int function = 0; function < 3; function++)
                for (int repeat = 0; repeat < 12; repeat++) {
                    const double condition = pow(10, 8 * uniform(random) * uniform(random));
                    const double scale = pow(10, 6 * uniform(random) - 3),
                                 tolerance = pow(10, -2 - 8 * uniform(random));
                    // The decay ranges from none to complete. In every third case h is in the range
                    // where the decay changes most.
                    const double h = scale * pow(10, repeat % 3 == 0 ? 6 * uniform(random) - 3
                                                                     : 28 * uniform(random) - 14);
                    KnownMatrix A = {scale * spectrum(random, Spectrum(kind), n, condition),
                                     MatrixXd()};
                    if (repeat % 2 == 0) A.Q = rotation(random, n);
                    const auto f = function == 0   ? SpectralFunction::decay(h)
                                   : function == 1 ? SpectralFunction::decayNoise(h)
                                                   : SpectralFunction::squareRoot();
                    const VectorXd x = normal(random, n, 1);
                    Lanczos lanczos(tolerance);
                    MatrixXd result;
                    cases++;
                    try {
                        lanczos.apply(A.product(), x, {f}, result);
                    } catch (const OpenMMException& e) {
                        expectFragment(e.what(), "rounding");
                        EXPECT_LT(tolerance, 1e-13 * condition) << e.what();
                        refused++;
                        continue;
                    }
                    const double error = errorOf(lanczos, result, A, f, x) / tolerance;
                    worst = max(worst, error);
                    EXPECT_LE(error, 5)
                        << n << " " << kind << " " << function << " tolerance " << tolerance
                        << " condition " << condition << " h " << h / scale;
                    EXPECT_LE(lanczos.getNumProducts(), n);
                }
    cout << cases << " cases, worst error " << worst << " tolerances, " << refused << " refused"
         << endl;
    EXPECT_LE(refused, cases / 100);
}

TEST(Lanczos, ThePromiseHoldsForLargeMatrices) {
    // There an eigenvector has a small part in the vector, which the bound counts on.
    mt19937 random(21);
    uniform_real_distribution<double> uniform(0, 1);
    const int n = 3000;
    double worst = 0;
    for (int kind = 0; kind < numSpectra; kind++)
        for (int repeat = 0; repeat < 12; repeat++) {
            const double condition = pow(10, 2.5 * uniform(random)),
                         tolerance = pow(10, -2 - 5 * uniform(random));
            const KnownMatrix A = {spectrum(random, Spectrum(kind), n, condition), MatrixXd()};
            const auto f =
                repeat % 2 ? SpectralFunction::squareRoot() : SpectralFunction::inverseSquareRoot();
            const VectorXd x = normal(random, n, 1);
            Lanczos lanczos(tolerance);
            MatrixXd result;
            lanczos.apply(A.product(), x, {f}, result);
            const double error = errorOf(lanczos, result, A, f, x) / tolerance;
            EXPECT_LE(error, 5) << kind << " tolerance " << tolerance << " condition " << condition;
            worst = max(worst, error);
        }
    cout << "worst error " << worst << " tolerances" << endl;
}

TEST(Lanczos, InexactProductsTakeOverWhereTheyDoNoHarm) {
    // Errors of products have the size that inexact products may have. They have random directions,
    // or they are those of a slightly different matrix.
    mt19937 random(4);
    uniform_real_distribution<double> uniform(0, 1);
    int cases = 0, products = 0, inexactOnes = 0, again = 0;
    double worst = 0;
    for (int kind = 0; kind < numSpectra; kind++)
        for (double tolerance : {1e-3, 1e-5, 1e-6, 1e-8})
            for (int repeat = 0; repeat < 12; repeat++) {
                const int n = 80;
                const double condition = pow(10, 2.5 * uniform(random));
                KnownMatrix A = {spectrum(random, Spectrum(kind), n, condition),
                                 rotation(random, n)};
                const double size = Accuracy::errorOfSinglePrecision * A.values.maxCoeff();
                KnownMatrix other = {
                    A.values + 0.5 * size * normal(random, n, 1).array().sin().matrix(), A.Q};
                int exact = 0, inexact = 0;
                const auto inexactly = [&](const MatrixXd& x, MatrixXd& y) {
                    inexact++;
                    y = other.times(x, other.values);
                    for (int c = 0; c < x.cols(); c++)
                        y.col(c) +=
                            0.5 * size * x.col(c).norm() * normal(random, n, 1).normalized();
                };
                const auto exactly = [&](const MatrixXd& x, MatrixXd& y) {
                    exact++;
                    y = A.times(x, A.values);
                };
                const auto f = repeat % 3 == 0 ? SpectralFunction::squareRoot()
                               : repeat % 3 == 1
                                   ? SpectralFunction::inverseSquareRoot()
                                   : SpectralFunction::decay(pow(10, 2 * uniform(random) - 1));
                const VectorXd x = normal(random, n, 1);
                Lanczos lanczos(tolerance);
                MatrixXd result;
                const double single = Accuracy::errorOfSinglePrecision;
                const auto product = [&](double error, const MatrixXd& x, MatrixXd& y) {
                    EXPECT_TRUE(error == 0 || error == single);
                    error > 0 ? inexactly(x, y) : exactly(x, y);
                };
                lanczos.apply(
                    product, x, {f}, result, Lanczos::OwnNorm,
                    {{single, single, 0, tolerance >= Accuracy::leastToleranceOfSinglePrecision}});
                const double error = errorOf(lanczos, result, A, f, x) / tolerance;
                EXPECT_LE(error, 5) << kind << " tolerance " << tolerance << " condition "
                                    << condition << " " << repeat;
                worst = max(worst, error);
                cases++;
                again += exact + inexact > lanczos.getNumProducts();
                if (kind == Uniform && tolerance == 1e-6)
                    products += exact + inexact, inexactOnes += inexact;
            }
    cout << cases << " cases, worst error " << worst << " tolerances, " << again
         << " done again; at 1e-6 " << inexactOnes << " of " << products << " products inexact"
         << endl;
    EXPECT_GT(inexactOnes, products / 3);
}

/** Roots for differences allow much less rounding than their tolerance. */
TEST(Lanczos, InexactProductsKeepTheirShare) {
    mt19937 random(6);
    const int n = 90;
    for (double tolerance : {1e-5, 1e-6, 1e-8})
        for (double share : {1e-3 * tolerance, 1e-1 * tolerance}) {
            int products = 0, inexactOnes = 0;
            double worst = 0;
            for (int repeat = 0; repeat < 40; repeat++) {
                const KnownMatrix A = {spectrum(random, Uniform, n, 20), rotation(random, n)};
                const double norm = A.values.cwiseAbs().maxCoeff();
                const MatrixXd x = normal(random, n, 1);
                const double single = Accuracy::errorOfSinglePrecision;
                const auto product = [&](double error, const MatrixXd& in, MatrixXd& out) {
                    EXPECT_TRUE(error == 0 || error == single);
                    out = A.times(in, A.values);
                    if (error > 0)
                        out += error * norm * in.norm() * normal(random, n, 1).normalized();
                };
                const auto f = repeat % 2 ? SpectralFunction::squareRoot()
                                          : SpectralFunction::inverseSquareRoot();
                Lanczos lanczos(tolerance);
                MatrixXd result, exact;
                lanczos.apply(product, x, {f}, result, Lanczos::OwnNorm,
                              {{single, single, 0, false, share}});
                const Lanczos::Course course = lanczos.getCourse();
                products += course.isInexact.size();
                inexactOnes += count(course.isInexact.begin(), course.isInexact.end(), 1);
                // As many products, all exact.
                lanczos.apply(product, x, {f}, exact, Lanczos::OwnNorm, {}, &course);
                ASSERT_EQ(lanczos.getNumProducts(), course.products[0]);
                worst = max(worst, (result - exact).norm() / exact.norm() / share);
            }
            cout << "tolerance " << tolerance << ", share " << share << ": rounding makes at most "
                 << worst << " of it; " << inexactOnes << " of " << products
                 << " products inexact\n";
            EXPECT_LT(worst, 1);
            EXPECT_GT(inexactOnes, products / 10);
        }
}

TEST(Lanczos, CoarseProductsAreTriedFirst) {
    // Errors of a tenth and of a hundredth of the tolerance, relative to the first product, as
    // those of multipoles. They have random directions, or they are those of another matrix.
    mt19937 random(5);
    uniform_real_distribution<double> uniform(0, 1);
    map<string, int> outcomes;  // by the kinds of products, in order
    double worst = 0;
    for (int kind = 0; kind < numSpectra; kind++)
        for (double tolerance : {1e-2, 1e-3, 1e-4})
            for (int repeat = 0; repeat < 12; repeat++) {
                const int n = 80;
                const double condition = pow(10, 2.5 * uniform(random));
                const KnownMatrix A = {spectrum(random, Spectrum(kind), n, condition),
                                       rotation(random, n)};
                const VectorXd x = normal(random, n, 1);
                const double first = A.times(x, A.values).norm() / x.norm();
                const VectorXd change = normal(random, n, 1).array().sin();
                const MatrixXd Q = rotation(random, n);
                string calls;
                const double coarse = 0.1 * tolerance, fine = 0.01 * tolerance;
                const auto product = [&](double error, const MatrixXd& in, MatrixXd& out) {
                    const char name = error == coarse ? 'c' : error == fine ? 'f' : 'e';
                    if (calls.empty() || calls.back() != name) calls += name;
                    out = A.times(in, A.values);
                    const double size = 0.5 * error * first;
                    out += size * (Q * change.asDiagonal() * Q.transpose() * in);
                    for (int c = 0; c < in.cols(); c++)
                        out.col(c) += size * in.col(c).norm() * normal(random, n, 1).normalized();
                };
                const auto f = repeat % 3 == 0 ? SpectralFunction::squareRoot()
                               : repeat % 3 == 1
                                   ? SpectralFunction::inverseSquareRoot()
                                   : SpectralFunction::decay(pow(10, 2 * uniform(random) - 1));
                Lanczos lanczos(tolerance);
                MatrixXd result;
                lanczos.apply(product, x, {f}, result, Lanczos::OwnNorm,
                              {{coarse, 0, coarse}, {fine, 0, fine}});
                const double error = errorOf(lanczos, result, A, f, x) / tolerance;
                EXPECT_LE(error, 5) << kind << " tolerance " << tolerance << " condition "
                                    << condition << " " << repeat;
                worst = max(worst, error);
                outcomes[calls]++;
            }
    cout << "worst error " << worst << " tolerances;";
    int cases = 0;
    for (const auto& each : outcomes) {
        cout << " " << each.first << " " << each.second;
        cases += each.second;
    }
    cout << endl;
    EXPECT_EQ(outcomes["c"] + outcomes["cf"] + outcomes["cfe"], cases);
    EXPECT_GT(outcomes["c"], cases / 3);
    EXPECT_GT(outcomes["cf"], 0);
    EXPECT_LT(outcomes["cfe"], outcomes["cf"]);
}

TEST(Lanczos, ACourseIsFollowed) {
    // As many products of each column as the course has, in its order of exact and inexact ones,
    // even where the iteration would have gone another way.
    mt19937 random(12);
    const int n = 90;
    const double tolerance = 1e-3;
    const KnownMatrix A = {spectrum(random, Uniform, n, 30), rotation(random, n)};
    const MatrixXd x = normal(random, n, 2);
    const vector<SpectralFunction> f(2, SpectralFunction::squareRoot());
    string calls;  // e for an exact product, i for an inexact one
    const auto product = [&](double error, const MatrixXd& in, MatrixXd& out) {
        calls += error > 0 ? 'i' : 'e';
        out = A.times(in, A.values);
    };
    Lanczos lanczos(tolerance);
    MatrixXd result;
    const double single = Accuracy::errorOfSinglePrecision;
    const vector<InexactProduct> inexact = {{single, single, 0, true}};
    lanczos.apply(product, x, f, result, Lanczos::OwnNorm, inexact);
    Lanczos::Course course = lanczos.getCourse();
    ASSERT_EQ(course.isInexact.size(), calls.size());
    for (size_t k = 0; k < calls.size(); k++) EXPECT_EQ(course.isInexact[k], calls[k] == 'i');
    EXPECT_EQ(*max_element(course.products.begin(), course.products.end()), int(calls.size()));
    EXPECT_EQ(course.products[0] + course.products[1], lanczos.getNumProducts());
    course.products[0] += 2;
    course.products[1] += 5;
    course.isInexact.clear();
    string wanted;
    for (int k = 0; k < course.products[1]; k++) {
        course.isInexact.push_back(k % 3 == 1);
        wanted += k % 3 == 1 ? 'i' : 'e';
    }
    calls.clear();
    lanczos.apply(product, x, f, result, Lanczos::OwnNorm, inexact, &course);
    EXPECT_EQ(calls, wanted);
    EXPECT_EQ(lanczos.getNumProducts(), course.products[0] + course.products[1]);
    EXPECT_EQ(lanczos.getCourse().products, course.products);
    // Too short a course is left: the error decides.
    course.products = {3, 3};
    lanczos.apply(product, x, f, result, Lanczos::OwnNorm, {}, &course);
    EXPECT_GT(lanczos.getNumProducts(), 6);
    for (int c = 0; c < 2; c++)
        EXPECT_LT(errorOf(lanczos, result, A, f[c], x.col(c), c), 10 * tolerance);
}

/**
 * (f(A + eps B) - f(A)) x / eps. In spectra without gaps the iteration's polynomial of degree k
 * fits f and, less well, its derivative: by Markov's inequality the error grows by up to k^2 over
 * half the length of the spectrum, not by 1/eps. This requires the same number of products for both
 * matrices.
 */
TEST(Lanczos, DifferencesOfOneCourseKeepTheirDigits) {
    mt19937 random(11);
    const int n = 90;
    const double tolerance = 1e-4;
    for (double eps : {1e-6, 1e-2, 0.3}) {
        double worst = 0;
        int cases = 0, longer = 0;
        for (int repeat = 0; repeat < 40; repeat++) {
            const Spectrum kind = repeat / 2 % 2 ? Uniform : Logarithmic;
            const KnownMatrix A = {spectrum(random, kind, n, 30), rotation(random, n)};
            const MatrixXd whole = A.Q * A.values.asDiagonal() * A.Q.transpose();
            MatrixXd B = normal(random, n, n);
            B = (B + B.transpose()).eval();
            B *= A.values.minCoeff() / B.norm();
            const auto f =
                repeat % 2 ? SpectralFunction::squareRoot() : SpectralFunction::inverseSquareRoot();
            const MatrixXd x = normal(random, n, 1);
            const auto product = [&](double shift) {
                return [&whole, &B, shift](double, const MatrixXd& in, MatrixXd& out) {
                    out = whole * in + shift * (B * in);
                };
            };
            Lanczos lanczos(tolerance);
            MatrixXd here, there;
            lanczos.apply(product(0), x, {f}, here);
            const Lanczos::Course course = lanczos.getCourse();
            const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(whole + eps * B);
            const KnownMatrix displaced = {eigen.eigenvalues(), eigen.eigenvectors()};
            const MatrixXd exact = (displaced.apply(f.value, x) - A.apply(f.value, x)) / eps;
            const auto errorOfDifference = [&](const MatrixXd& second) {
                return ((second - here) / eps - exact).norm() / exact.norm() / tolerance;
            };
            lanczos.apply(product(eps), x, {f}, there, Lanczos::OwnNorm, {}, &course);
            longer += lanczos.getNumProducts() > course.products[0];
            if (lanczos.getNumProducts() == course.products[0]) {
                worst = max(worst, errorOfDifference(there));
                EXPECT_LT(errorOfDifference(there), pow(course.products[0], 2)) << repeat;
            }
            cases++;
        }
        cout << "eps " << eps << ": worst error of a derivative " << worst << " tolerances; "
             << longer << " of " << cases << " took more products" << endl;
        EXPECT_LE(longer, cases / 20);
    }
}

TEST(Lanczos, ExactInInvariantSubspaces) {
    mt19937 random(2);
    const VectorXd x = normal(random, 30, 1);
    MatrixXd result;
    Lanczos lanczos(1e-12);
    for (int distinct : {1, 2, 5}) {
        KnownMatrix A = {VectorXd(30), MatrixXd()};
        for (int i = 0; i < 30; i++) A.values[i] = 1 + i % distinct;
        lanczos.apply(A.product(), x, {SpectralFunction::squareRoot()}, result);
        EXPECT_EQ(lanczos.getNumProducts(), distinct);
        EXPECT_LT(errorOf(lanczos, result, A, SpectralFunction::squareRoot(), x), 1e-13);
    }
    // Special cases: the vector is an eigenvector, the matrix has one row, the iteration spans the
    // whole space.
    const KnownMatrix A = {spectrum(random, Logarithmic, 30, 1e4), MatrixXd()};
    lanczos.apply(A.product(), VectorXd::Unit(30, 3), {SpectralFunction::squareRoot()}, result);
    EXPECT_EQ(lanczos.getNumProducts(), 1);
    EXPECT_NEAR(result(3), sqrt(A.values[3]), 1e-15);
    const KnownMatrix one = known({4});
    lanczos.apply(one.product(), MatrixXd::Constant(1, 1, 3), {SpectralFunction::squareRoot()},
                  result);
    EXPECT_NEAR(result(0), 6, 1e-14);
    lanczos.apply(A.product(), x, {SpectralFunction::squareRoot()}, result);
    EXPECT_LE(lanczos.getNumProducts(), 30);
    EXPECT_LT(errorOf(lanczos, result, A, SpectralFunction::squareRoot(), x), 5e-12);
}

TEST(Lanczos, SmallDecaysAreGivenAsIncrements) {
    mt19937 random(3);
    const KnownMatrix A = {spectrum(random, Logarithmic, 50, 100), rotation(random, 50)};
    const VectorXd x = normal(random, 50, 1);
    Lanczos lanczos(1e-8);
    MatrixXd result;
    for (double h : {1e-14, 1e-8, 1e-3}) {
        lanczos.apply(A.product(), x, {SpectralFunction::decay(h)}, result);
        EXPECT_TRUE(lanczos.isIncrement(0));
        EXPECT_LT(errorOf(lanczos, result, A, SpectralFunction::decay(h), x), 5e-8) << h;
    }
    for (double h : {10.0, 100.0}) {
        lanczos.apply(A.product(), x, {SpectralFunction::decay(h)}, result);
        EXPECT_FALSE(lanczos.isIncrement(0));
        EXPECT_LT(errorOf(lanczos, result, A, SpectralFunction::decay(h), x), 5e-8) << h;
    }
    lanczos.apply(A.product(), x, {SpectralFunction::decay(1e14)}, result);
    EXPECT_EQ(result.norm(), 0);
}

TEST(Lanczos, ColumnsAreIndependentAndConvergedOnesAreLeftOut) {
    mt19937 random(4);
    const KnownMatrix A = {spectrum(random, Uniform, 80, 1000), MatrixXd()};
    MatrixXd x = normal(random, 80, 4);
    x.col(2).setZero();
    const vector<SpectralFunction> f = {
        SpectralFunction::decay(1e-2), SpectralFunction::decayNoise(1e3),
        SpectralFunction::squareRoot(), SpectralFunction::squareRoot()};
    Lanczos lanczos(1e-6), alone(1e-6);
    MatrixXd together, again, single;
    int multiplied = 0, calls = 0;
    const Lanczos::Product counting = [&](double, const MatrixXd& in, MatrixXd& out) {
        multiplied += in.cols();
        calls++;
        A.product()(0, in, out);
    };
    lanczos.apply(counting, x, f, together);
    EXPECT_EQ(lanczos.getNumProducts(), multiplied);
    EXPECT_EQ(lanczos.getNumIterations(), calls);
    int products = 0, most = 0;
    for (int c = 0; c < 4; c++) {
        alone.apply(A.product(), x.col(c), {f[c]}, single);
        EXPECT_EQ((single - together.col(c)).cwiseAbs().maxCoeff(), 0);
        EXPECT_EQ(alone.isIncrement(0), lanczos.isIncrement(c));
        products += alone.getNumProducts();
        most = max(most, alone.getNumProducts());
    }
    EXPECT_EQ(products, multiplied);
    EXPECT_EQ(most, calls);
    EXPECT_EQ(together.col(2).norm(), 0);
    lanczos.apply(A.product(), x, f, again);
    EXPECT_EQ((again - together).cwiseAbs().maxCoeff(), 0);
}

TEST(Lanczos, DecayedColumnsMayBeMeasuredByTheSum) {
    // A decayed exp(-h/x) z is negligible beside the noise. With errors relative to the sum it
    // takes hardly any products.
    mt19937 random(5);
    const KnownMatrix A = {spectrum(random, Uniform, 200, 100), MatrixXd()};
    const MatrixXd x = normal(random, 200, 2);
    const double tolerance = 1e-6;
    for (double h : {1e-3, 1.0, 5.0, 20.0, 1e3}) {
        const vector<SpectralFunction> f = {SpectralFunction::decay(h),
                                            SpectralFunction::decayNoise(h)};
        Lanczos own(tolerance), sum(tolerance);
        MatrixXd result;
        own.apply(A.product(), x, f, result);
        sum.apply(A.product(), x, f, result, Lanczos::NormOfSum);
        VectorXd expected = A.apply(f[1].value, x.col(1));
        expected += A.apply(sum.isIncrement(0) ? f[0].minusOne : f[0].value, x.col(0));
        EXPECT_LT((result.rowwise().sum() - expected).norm(), 10 * tolerance * expected.norm())
            << h;
        EXPECT_LE(sum.getNumProducts(), own.getNumProducts());
        if (h == 20) {
            EXPECT_LT(sum.getNumProducts(), 0.8 * own.getNumProducts()) << h;
        }
        EXPECT_EQ(sum.isIncrement(0), h < 0.1);
    }
}

TEST(Lanczos, Errors) {
    mt19937 random(6);
    const VectorXd x = normal(random, 40, 1);
    const auto root = SpectralFunction::squareRoot();
    MatrixXd result;
    const auto solve = [&](const KnownMatrix& A, double tolerance, int maxIterations,
                           const SpectralFunction& f) {
        return messageOf(
            [&] { Lanczos(tolerance, maxIterations).apply(A.product(), x, {f}, result); });
    };
    const KnownMatrix A = {spectrum(random, Logarithmic, 40, 1e4), MatrixXd()};
    const string slow = solve(A, 1e-9, 10, root);
    expectFragment(slow, "after 10 products the Lanczos iteration has a relative error of");
    expectFragment(slow, "raise setSolverTolerance()");
    KnownMatrix indefinite = A;
    indefinite.values[7] = -0.1;
    expectFragment(solve(indefinite, 1e-9, 100, root),
                   "is not positive definite (eigenvalues from -0.0");
    const KnownMatrix hopeless = {spectrum(random, Logarithmic, 40, 1e14), MatrixXd()};
    expectFragment(solve(hopeless, 1e-9, 100, SpectralFunction::decay(1e-20)),
                   "rounding makes an error of");
    // The message about a tolerance out of reach names the tolerance that the user asked for.
    const auto part = [&](const KnownMatrix& matrix, const SpectralFunction& f, int most) {
        return messageOf(
            [&] { Lanczos(1e-15, most, 1e-14).apply(matrix.product(), x, {f}, result); });
    };
    expectFragment(
        part(hopeless, SpectralFunction::decay(1e-20), 100),
        "the tolerance of 1e-14, of which an iteration may take 1e-15, cannot be reached");
    expectFragment(part(A, root, 10),
                   "above the tolerance of 1e-14, of which an iteration may take 1e-15,");
    KnownMatrix broken = A;
    broken.values[0] = NAN;
    expectFragment(solve(broken, 1e-9, 100, root), "a product with the mobility is not finite");
    expectFragment(solve(A, 1e-9, 100, {[](double) { return NAN; }, {}}),
                   "a function of the mobility is not finite");
    const VectorXd infinite = VectorXd::Constant(40, INFINITY);
    expectFragment(messageOf([&] { Lanczos(1e-3).apply(A.product(), infinite, {root}, result); }),
                   "a vector for the Lanczos iteration is not finite");
}

TEST(Lanczos, SuspensionsOfSpheres) {
    // 100 spheres with forces and torques, as in a Langevin step: masses 1, moments 0.4, S^-1 =
    // K^-1/2 N K^-1/2.
    const int n = 100;
    mt19937 random(7);
    for (double fraction : {0.05, 0.15, 0.25, 0.35}) {
        const double edge = cbrt(n * 4 * M_PI / 3 / fraction);
        const int nodes = ceil(cbrt(n));
        uniform_real_distribution<double> shift(-0.3, 0.3);
        HydrodynamicParticles particles;
        vector<Vec3> positions;
        for (int i = 0; i < nodes * nodes * nodes; i++)
            positions.push_back(
                edge / nodes *
                Vec3(i % nodes + 0.5, i / nodes % nodes + 0.5, i / nodes / nodes + 0.5));
        shuffle(positions.begin(), positions.end(), random);
        positions.resize(n);
        for (int i = 0; i < n; i++) particles.add(1, true, i, i);
        for (int sweep = 0; sweep < 200; sweep++)
            for (int i = 0; i < n; i++) {
                const Vec3 trial = positions[i] + Vec3(shift(random), shift(random), shift(random));
                bool accepted = true;
                for (int k = 0; k < 3; k++) accepted &= trial[k] > 0 && trial[k] < edge;
                for (int j = 0; j < n; j++) {
                    const Vec3 r = trial - positions[j];
                    accepted &= j == i || r.dot(r) > 4;
                }
                if (accepted) positions[i] = trial;
            }
        RotnePragerYamakawa mobility(particles, 1 / (6 * M_PI));
        MatrixXd N;
        mobility.at({positions})->dense(N);
        VectorXd root(6 * n);
        for (int row = 0; row < 6 * n; row++) root[row] = row % 6 < 3 ? 1 : sqrt(0.4);
        const MatrixXd S = root.asDiagonal() * N * root.asDiagonal();
        const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(S);
        const KnownMatrix A = {eigen.eigenvalues(), eigen.eigenvectors()};
        const MatrixXd x = normal(random, 6 * n, 2);
        for (double tolerance : {1e-3, 1e-6}) {
            int fewest = 1000, most = 0;
            for (double h : {1e-14, 1e-2, 0.1, 1.0, 10.0, 1e3, 1e14}) {
                const vector<SpectralFunction> f = {SpectralFunction::decay(h),
                                                    SpectralFunction::decayNoise(h)};
                Lanczos lanczos(tolerance);
                MatrixXd result;
                lanczos.apply(
                    [&](double, const MatrixXd& in, MatrixXd& out) { out.noalias() = S * in; }, x,
                    f, result, Lanczos::NormOfSum);
                fewest = min(fewest, lanczos.getNumIterations());
                most = max(most, lanczos.getNumIterations());
                for (int c = lanczos.isIncrement(0) ? 0 : 1; c < 2; c++)
                    EXPECT_LT(errorOf(lanczos, result, A, f[c], x.col(c), c), 5 * tolerance)
                        << fraction << " " << h;
                VectorXd expected = A.apply(f[1].value, x.col(1));
                expected += A.apply(lanczos.isIncrement(0) ? f[0].minusOne : f[0].value, x.col(0));
                EXPECT_LT((result.rowwise().sum() - expected).norm(),
                          5 * tolerance * expected.norm());
            }
            cout << "volume fraction " << fraction << ", condition "
                 << A.values[6 * n - 1] / A.values[0] << ", tolerance " << tolerance << ": "
                 << fewest << " to " << most << " iterations" << endl;
            EXPECT_LE(most, tolerance > 1e-4 ? 32 : 46);
        }
    }
}
