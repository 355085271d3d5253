// The Rotne-Prager-Yamakawa mobility agrees with values computed independently. It is continuous,
// symmetric, positive definite, and covariant.

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <random>

#include "TestSupport.h"
#include "linearalgebra/Decompositions.h"
#include "mobility/models/rotneprager/RotnePragerYamakawa-inl.h"
#include "mobility/models/rotneprager/RotnePragerYamakawa.h"

using namespace RigidHIPlugin;
using namespace RigidHIPlugin::scalar;
using namespace OpenMM;
using namespace std;
using Eigen::MatrixXd;

namespace {

/** Elements of the pair mobility for viscosity 1: tt across and along r, rr across and along r, and
 * c, the coefficient of F x n. */
struct Numbers {
    double v[6];  // ..., rt, tr
};
Numbers numbers(double a_i, double a_j, double R) {
    const auto m = pairMobility(R * R, a_i, a_j);
    const double scale = 1 / (8 * M_PI);
    return {{scale * m.ttI, scale * (m.ttI + m.ttR * R * R), scale * m.rrI,
             scale * (m.rrI + m.rrR * R * R), scale * m.rt * R, scale * m.tr * R}};
}

struct Scene {
    HydrodynamicParticles particles;
    vector<Vec3> positions;
    MatrixXd dense(double viscosity = 1) const {
        RotnePragerYamakawa M(particles, viscosity);
        MatrixXd mobility;
        M.at({positions})->dense(mobility);
        return mobility;
    }
    void add(double radius, bool torque, const Vec3& position) {
        particles.add(radius, torque, particles.size(), -1);
        positions.push_back(position);
    }
};
/** Particles of mixed radii and kinds in a cube so small that many overlap and some are inside
 * others. */
Scene randomScene(mt19937& random, int n, double size) {
    uniform_real_distribution<double> u(0, 1);
    Scene scene;
    for (int i = 0; i < n; i++)
        scene.add(0.2 + 1.8 * u(random), u(random) < 0.5,
                  size * Vec3(u(random), u(random), u(random)));
    return scene;
}

}  // namespace

TEST(RotnePragerYamakawa, ValuesComputedElsewhere) {
    // The expected values are by quadrature over the spheres' surfaces, good to 2e-12: tt across
    // and along r, rr across and along r, c.
    const struct {
        double a_i, a_j, R, expected[5];
    } cases[] = {
        {1,
         1,
         3,
         {0.0142453498446, 0.0245609480080, -0.000736828440, 0.00147365688, 0.00442097064}},
        {1,
         1,
         1.5,
         {0.0306704838250, 0.0381308717824, -7.77123746e-05, 0.0104134582, 0.0130556789}},
        {1, 0.5, 1, {0.0445550947458, 0.0501503857139, 0.00986947157, 0.0287535786, 0.0251788094}},
    };
    for (const auto& c : cases)
        for (int k = 0; k < 5; k++)
            EXPECT_NEAR(numbers(c.a_i, c.a_j, c.R).v[k], c.expected[k], 1e-9 * c.expected[1]);
    // With one sphere inside the other the elements are those of the large sphere alone. A force on
    // the small sphere turns the large one, but not the other way round.
    const auto large = numbers(2, 0.5, 1.2), small = numbers(0.5, 2, 1.2);
    for (int k = 0; k < 2; k++) {
        EXPECT_NEAR(large.v[k], 1 / (6 * M_PI * 2), 1e-15);
        EXPECT_NEAR(large.v[2 + k], 1 / (8 * M_PI * 8), 1e-15);
    }
    EXPECT_NEAR(large.v[4], 1.2 / (8 * M_PI * 8), 1e-15);
    EXPECT_NEAR(large.v[5], 0, 1e-15);
    EXPECT_NEAR(small.v[4], 0, 1e-15);
    EXPECT_NEAR(small.v[5], 1.2 / (8 * M_PI * 8), 1e-15);
}

TEST(RotnePragerYamakawa, ContinuousWhereTheFormulaChanges) {
    const double radii[][2] = {{1, 1}, {1, 0.5}, {0.5, 1}, {3, 0.1}, {0.1, 3}};
    for (const auto& a : radii)
        for (double R : {a[0] + a[1], abs(a[0] - a[1])}) {
            if (R == 0) continue;
            const double e = 1e-7 * R;
            const auto below = numbers(a[0], a[1], R - e), above = numbers(a[0], a[1], R + e);
            for (int k = 0; k < 6; k++) {
                const double scale = k < 2   ? 1 / sqrt(a[0] * a[1])
                                     : k < 4 ? pow(a[0] * a[1], -1.5)
                                             : pow(a[0] * a[1], -1);
                EXPECT_NEAR(below.v[k], above.v[k], 1e-5 * scale)
                    << a[0] << " " << a[1] << " " << R << " " << k;
            }
        }
}

TEST(RotnePragerYamakawa, SymmetricPositiveDefinite) {
    mt19937 random(1);
    double smallest = INFINITY;
    for (int trial = 0; trial < 1000; trial++) {
        const auto scene = randomScene(random, 2 + trial % 6,
                                       trial % 3 == 0   ? 1
                                       : trial % 3 == 1 ? 3
                                                        : 8);
        const MatrixXd M = scene.dense();
        ASSERT_EQ((M - M.transpose()).cwiseAbs().maxCoeff(), 0);
        // The matrix is in units in which every particle's own mobility is 1.
        const Eigen::VectorXd d = M.diagonal().cwiseSqrt().cwiseInverse();
        const MatrixXd scaled = d.asDiagonal() * M * d.asDiagonal();
        const double least = Eigen::SelfAdjointEigenSolver<MatrixXd>(scaled).eigenvalues()[0];
        smallest = min(smallest, least);
        ASSERT_GT(least, 0) << trial;
    }
    cout << "smallest eigenvalue " << smallest << endl;
}

TEST(RotnePragerYamakawa, TwoParticlesAtOnePlace) {
    for (double other : {1.0, 0.3})
        for (double apart : {0.0, 1e-200, 1e-160, 1e-100, 1e-20, 1e-8}) {
            Scene scene;
            scene.add(1, true, Vec3(0, 0, 0));
            scene.add(other, true, Vec3(apart, 0, 0));
            scene.add(other, false, Vec3(0, 0, apart));
            const MatrixXd M = scene.dense();
            ASSERT_TRUE(M.allFinite()) << apart;
            const auto values = Eigen::SelfAdjointEigenSolver<MatrixXd>(M).eigenvalues();
            EXPECT_GT(values[0], -1e-14 * values[M.rows() - 1]) << apart;
            EXPECT_NEAR(M(0, 6), 1 / (6 * M_PI), 1e-8);
        }
}

TEST(RotnePragerYamakawa, OneSphere) {
    Scene scene;
    scene.add(0.7, true, Vec3(1, 2, 3));
    const double eta = 2.5;
    Eigen::VectorXd expected(6);
    expected << Eigen::Vector3d::Constant(1 / (6 * M_PI * eta * 0.7)),
        Eigen::Vector3d::Constant(1 / (8 * M_PI * eta * 0.343));
    EXPECT_LT((scene.dense(eta) - MatrixXd(expected.asDiagonal())).cwiseAbs().maxCoeff(), 1e-16);
}

TEST(RotnePragerYamakawa, TurnsWithTheParticles) {
    mt19937 random(2);
    const Scene scene = randomScene(random, 6, 3);
    const Eigen::Matrix3d A =
        Eigen::AngleAxisd(1.1, Eigen::Vector3d(1, -2, 0.5).normalized()).toRotationMatrix();
    Scene turned = scene;
    MatrixXd Q = MatrixXd::Zero(scene.particles.numRows, scene.particles.numRows);
    for (int row = 0; row < Q.rows(); row += 3) Q.block<3, 3>(row, row) = A;
    for (Vec3& r : turned.positions) {
        const Eigen::Vector3d v = A * Eigen::Vector3d(r[0], r[1], r[2]);
        r = Vec3(v[0], v[1], v[2]);
    }
    const MatrixXd expected = Q * scene.dense() * Q.transpose();
    EXPECT_LT((turned.dense() - expected).cwiseAbs().maxCoeff(),
              1e-13 * expected.cwiseAbs().maxCoeff());
}

TEST(RotnePragerYamakawa, ApplyIsTheMatrix) {
    mt19937 random(3);
    for (int n : {1, 2, 5, 12})
        for (int columns : {1, 2, 3}) {
            const Scene scene = randomScene(random, n, 3);
            const RotnePragerYamakawa model(scene.particles, 0.6);
            const auto M = model.at({scene.positions});
            MatrixXd dense, velocities;
            M->dense(dense);
            const MatrixXd forces = MatrixXd::Random(scene.particles.numRows, columns);
            M->multiply(forces, velocities);
            const double scale = dense.cwiseAbs().maxCoeff();
            EXPECT_LT((velocities - dense * forces).cwiseAbs().maxCoeff(), 1e-14 * scale);
        }
}
