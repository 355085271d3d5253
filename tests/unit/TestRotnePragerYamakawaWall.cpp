// The Rotne-Prager-Yamakawa mobility above a no-slip wall agrees with values computed
// independently, and with averages of Blake's image over spheres. Further tests are of no slip,
// symmetry, positive definiteness, invariances, limits, particles that reach through the wall, and
// messages.

#include <Eigen/Dense>
#include <random>

#include "TestSupport.h"
#include "linearalgebra/Decompositions.h"
#include "mobility/models/rotneprager/RotnePragerYamakawa.h"
#include "mobility/models/wall/RotnePragerYamakawaWall.h"

using namespace RigidHIPlugin;
using namespace OpenMM;
using namespace std;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using RigidHITest::expectError;

namespace {

struct Scene {
    HydrodynamicParticles particles;
    vector<Vec3> positions;
    double height = 0;
    bool crossing = false;

    void add(double radius, bool torque, const Vec3& position, int body = -1) {
        particles.add(radius, torque, particles.size(), body);
        positions.push_back(position);
    }
    RotnePragerYamakawaWall model(double viscosity) const {
        return RotnePragerYamakawaWall(particles, viscosity, NoSlipPlane(height, crossing));
    }
    MatrixXd dense(double viscosity = 1) const {
        MatrixXd matrix;
        model(viscosity).at({positions})->dense(matrix);
        return matrix;
    }
    /** The matrix by apply(), which computes each block by itself. */
    MatrixXd applied(double viscosity = 1) const {
        MatrixXd matrix;
        model(viscosity)
            .at({positions})
            ->multiply(MatrixXd::Identity(particles.numRows, particles.numRows), matrix);
        return matrix;
    }
    MatrixXd unbounded(double viscosity = 1) const {
        RotnePragerYamakawa M(particles, viscosity);
        MatrixXd matrix;
        M.at({positions})->dense(matrix);
        return matrix;
    }
};

/**
 * Particles of mixed radii and kinds, some touching the wall, in a box so small that many overlap
 * and some are inside others. The smallest gaps are `lowest` times the radius.
 */
Scene randomScene(mt19937& random, int n, double size, double lowest = 0) {
    uniform_real_distribution<double> u(0, 1);
    Scene scene;
    scene.height = 3 * u(random) - 1;
    scene.crossing = lowest < 0;
    for (int i = 0; i < n; i++) {
        const double radius = 0.2 + 1.8 * u(random);
        // One particle in three is on the wall, or as far through it as is allowed. Positions keep
        // the distance of a rounding error.
        const double gap =
            u(random) < 0.33 ? (lowest + 1e-12) * radius : lowest * radius + size * u(random);
        scene.add(radius, u(random) < 0.5,
                  Vec3(size * u(random), size * u(random), scene.height + radius + gap));
    }
    return scene;
}

/** The smallest eigenvalue in units in which every particle's own mobility is 1. */
double smallestEigenvalue(const MatrixXd& M) {
    const VectorXd d = M.diagonal().cwiseSqrt().cwiseInverse();
    return Eigen::SelfAdjointEigenSolver<MatrixXd>(MatrixXd(d.asDiagonal() * M * d.asDiagonal()))
        .eigenvalues()[0];
}

double largest(const MatrixXd& M) { return M.cwiseAbs().maxCoeff(); }

Matrix3d crossMatrix(const Vector3d& v) {
    Matrix3d m;
    m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
    return m;
}

/** The flow at x of Blake's image of a point force at y over the wall z = 0, in Blake's own form,
 * times 8 pi eta. */
Matrix3d blakeImage(const Vector3d& x, const Vector3d& y) {
    const double h = y.z();
    const Vector3d R(x.x() - y.x(), x.y() - y.y(), x.z() + h);
    const double d = R.norm(), d3 = d * d * d, d5 = d3 * d * d;
    Matrix3d G;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            // d/dR_j of h R_i/d^3 - (delta_i3/d + R_i R_3/d^3)
            const double dipole = (i == j) / d3 - 3 * R[i] * R[j] / d5;
            const double stokeslet = -(i == 2) * R[j] / d3 +
                                     ((i == j) * R[2] + R[i] * (j == 2)) / d3 -
                                     3 * R[i] * R[2] * R[j] / d5;
            const double sign = j == 2 ? -1 : 1;
            G(i, j) = -((i == j) / d + R[i] * R[j] / d3) + 2 * h * sign * (h * dipole - stokeslet);
        }
    return G;
}

/** Points and weights (sum 1) on the unit sphere: Gauss-Legendre in z, even spacing around. Exact
 * to degree 2n - 1. */
struct SphereRule {
    vector<Vector3d> points;
    vector<double> weights;
    explicit SphereRule(int n) {
        MatrixXd jacobi = MatrixXd::Zero(n, n);
        for (int k = 1; k < n; k++) jacobi(k, k - 1) = jacobi(k - 1, k) = k / sqrt(4.0 * k * k - 1);
        const Eigen::SelfAdjointEigenSolver<MatrixXd> nodes(jacobi);
        for (int k = 0; k < n; k++)
            for (int l = 0; l < 2 * n; l++) {
                const double z = nodes.eigenvalues()[k], s = sqrt(1 - z * z),
                             angle = (l + 0.5 * (k % 2)) * M_PI / n;
                points.push_back(Vector3d(s * cos(angle), s * sin(angle), z));
                weights.push_back(pow(nodes.eigenvectors()(0, k), 2) / (2 * n));
            }
    }
};

/** The velocities (V, W) of a sphere from (F, T) on another by way of the wall, as averages over
 * both surfaces, times 8 pi eta. */
MatrixXd averagedImage(const SphereRule& rule, const Vector3d& r_i, double a_i, const Vector3d& r_j,
                       double a_j) {
    MatrixXd M = MatrixXd::Zero(6, 6);
    Eigen::Matrix<double, 3, 6> source;
    Eigen::Matrix<double, 6, 3> target;
    source.leftCols<3>().setIdentity();
    target.topRows<3>().setIdentity();
    for (size_t p = 0; p < rule.points.size(); p++) {
        target.bottomRows<3>() =
            1.5 / a_i * crossMatrix(rule.points[p]);  // W = 3/(2 a^2) mean of rho x u
        for (size_t q = 0; q < rule.points.size(); q++) {
            source.rightCols<3>() =
                -1.5 / a_j * crossMatrix(rule.points[q]);  // traction 3/(2 a^2) T x rho
            const Matrix3d G = blakeImage(r_i + a_i * rule.points[p], r_j + a_j * rule.points[q]);
            M += rule.weights[p] * rule.weights[q] * target * (G * source);
        }
    }
    return M;
}

}  // namespace

TEST(RotnePragerYamakawaWall, OneSphere) {
    const double eta = 2.5, height = -1.3;
    for (double a : {0.7, 1.0})
        for (double u : {1.0, 0.9, 0.5, 0.1, 1e-3}) {
            const double u3 = u * u * u, u5 = u3 * u * u;
            Scene scene;
            scene.height = height;
            scene.crossing = true;  // rounding of the height then does not matter at contact
            scene.add(a, true, Vec3(1, 2, height + a / u));
            MatrixXd expected = MatrixXd::Zero(6, 6);
            const double across = 1 - 9 * u / 8 + u3 / 2 - u5 / 8,
                         along = 1 - 9 * u / 16 + u3 / 8 - u5 / 16;
            expected.diagonal() << along, along, across, 1 - 5 * u3 / 16, 1 - 5 * u3 / 16,
                1 - u3 / 8;
            expected.diagonal().head(3) /= 6 * M_PI * eta * a;
            expected.diagonal().tail(3) /= 8 * M_PI * eta * a * a * a;
            // A force along the wall makes the sphere roll along it.
            const double rolling = 3 * u3 * u / 32 / (6 * M_PI * eta * a * a);
            expected(4, 0) = expected(0, 4) = rolling;
            expected(3, 1) = expected(1, 3) = -rolling;
            EXPECT_LT(largest(scene.dense(eta) - expected), 1e-14 * largest(expected))
                << a << " " << u;
        }
}

TEST(RotnePragerYamakawaWall, ValuesComputedElsewhere) {
    Scene scene;
    scene.add(1, true, Vec3(0, 0, 1.2));
    scene.add(1, true, Vec3(2.5, 1, 3));
    const MatrixXd M = scene.dense(1 / (6 * M_PI));
    Matrix3d TT, RT, RR;
    TT << 0.1563498397, 0.0399050815, 0.0959610869, 0.0399050815, 0.0725491686, 0.0383844348,
        0.0104756178, 0.0041902471, 0.0076203779;
    RT << -0.0098960427, -0.0348598456, -0.0010756279, 0.0556415353, 0.0098960427, 0.0026890697,
        -0.0160350448, 0.0400876120, 0;
    RR << -0.0026775858, 0.0051614653, 0.0180264142, 0.0051614653, -0.0135166629, 0.0072105657,
        0.0103826096, 0.0041530439, -0.0042110697;
    const double digits = 5.1e-11;
    EXPECT_LT(largest(M.block(0, 6, 3, 3) - TT), digits) << M.block(0, 6, 3, 3);
    EXPECT_LT(largest(M.block(3, 6, 3, 3) - RT), digits) << M.block(3, 6, 3, 3);
    EXPECT_LT(largest(M.block(3, 9, 3, 3) - RR), digits) << M.block(3, 9, 3, 3);
}

TEST(RotnePragerYamakawaWall, AveragesOfBlakesImage) {
    const struct {
        double a_i, a_j;
        Vec3 r_i, r_j;
        int points;  // enough for an error of the size of rounding
    } cases[] = {
        {1, 1, {0, 0, 1.4}, {2.5, 1, 3}, 16},           // apart
        {0.3, 1.5, {0.5, -0.2, 0.8}, {2, 1, 2.6}, 16},  // unequal
        {1.2, 0.4, {0, 0, 1.9}, {0.9, 0.6, 1.3}, 16},   // overlapping
        {1.5, 0.2, {0, 0, 2.5}, {0.3, -0.5, 2.2}, 16},  // one inside the other
        {0.9, 0.9, {1, 1, 1.3}, {1, 1, 1.3}, 18},       // the same
    };
    for (const auto& c : cases) {
        const SphereRule rule(c.points);
        const MatrixXd expected = averagedImage(rule, Vector3d(c.r_i[0], c.r_i[1], c.r_i[2]), c.a_i,
                                                Vector3d(c.r_j[0], c.r_j[1], c.r_j[2]), c.a_j);
        // Two particles may be at one place, so the self block is tested here as an off-diagonal
        // block of M.
        Scene scene;
        scene.add(c.a_i, true, c.r_i);
        scene.add(c.a_j, true, c.r_j);
        const MatrixXd M = 8 * M_PI * (scene.applied() - scene.unbounded());
        const double error = largest(M.topRightCorner(6, 6) - expected);
        cout << "radii " << c.a_i << " " << c.a_j << ": largest element " << largest(expected)
             << ", error " << error << endl;
        EXPECT_LT(error, 1e-9 * largest(expected)) << M.topRightCorner(6, 6) << "\n\n" << expected;
    }
}

TEST(RotnePragerYamakawaWall, NoSlip) {
    mt19937 random(1);
    uniform_real_distribution<double> u(-1, 1);
    const double probe = 1e-9;
    for (int trial = 0; trial < 50; trial++) {
        Scene scene;
        const double a = 1 + 0.5 * u(random);
        scene.add(a, true, Vec3(0, 0, a * (1.6 + 0.5 * u(random))));
        // The probe is on the wall, below the sphere or beside it.
        scene.add(probe, false, Vec3(3 * a * u(random), 3 * a * u(random), probe));
        const MatrixXd flow = scene.dense().bottomLeftCorner(3, 6);
        const VectorXd scale = scene.dense().diagonal().head(6);
        EXPECT_LT(largest(flow.leftCols(3)), 100 * probe * scale[0]) << trial;
        EXPECT_LT(largest(flow.rightCols(3)), 100 * probe * scale[3]) << trial;
    }
}

TEST(RotnePragerYamakawaWall, SymmetricPositiveDefinite) {
    mt19937 random(2);
    double smallest = INFINITY, asymmetry = 0;
    for (int trial = 0; trial < 1000; trial++) {
        const Scene scene = randomScene(random, 2 + trial % 6,
                                        trial % 3 == 0   ? 1
                                        : trial % 3 == 1 ? 3
                                                         : 8);
        const MatrixXd M = scene.applied(), dense = scene.dense();
        ASSERT_EQ(largest(dense - dense.transpose()), 0);
        asymmetry = max(asymmetry, largest(M - M.transpose()) / largest(M));
        ASSERT_LT(largest(M - M.transpose()), 1e-13 * largest(M)) << trial;
        smallest = min(smallest, smallestEigenvalue(dense));
        ASSERT_GT(smallest, 0) << trial;
    }
    cout << "smallest eigenvalue " << smallest << ", largest asymmetry " << asymmetry << endl;
}

/** Particles are as far below contact as finite differences may displace them. */
TEST(RotnePragerYamakawaWall, NearbyPositionsPositiveDefinite) {
    mt19937 random(4);
    double smallest = INFINITY;
    for (int trial = 0; trial < 1000; trial++) {
        Scene scene = randomScene(random, 2 + trial % 6,
                                  trial % 3 == 0   ? 1
                                  : trial % 3 == 1 ? 3
                                                   : 8);
        for (int i = 0; i < scene.particles.size(); i++)
            if (i % 2 == trial % 2)
                scene.positions[i][2] = scene.height + 0.9901 * scene.particles.radii[i];
        RotnePragerYamakawaWall M(scene.particles, 1, NoSlipPlane(scene.height, false));
        ASSERT_EQ(M.acceptsNearby({scene.positions}), true);
        ASSERT_NE(M.objection({scene.positions}), "");
        MatrixXd dense;
        M.near({scene.positions})->dense(dense);
        smallest = min(smallest, smallestEigenvalue(dense));
        ASSERT_GT(smallest, 0) << trial;
    }
    cout << "smallest eigenvalue " << smallest << endl;
}

TEST(RotnePragerYamakawaWall, ApplyIsTheMatrix) {
    mt19937 random(3);
    for (int n : {1, 2, 5, 12})
        for (int columns : {1, 2, 3})
            for (double lowest : {0.0, -0.9}) {
                const Scene scene = randomScene(random, n, 3, lowest);
                const auto model = scene.model(0.6);
                const auto M = model.at({scene.positions});
                MatrixXd dense, velocities;
                M->dense(dense);
                const MatrixXd forces = MatrixXd::Random(scene.particles.numRows, columns);
                M->multiply(forces, velocities);
                EXPECT_LT(largest(velocities - dense * forces), 3e-14 * largest(dense));
                // The product is made again, into the same memory.
                const double* place = velocities.data();
                const MatrixXd first = velocities;
                M->multiply(forces, velocities);
                EXPECT_EQ(largest(velocities - first), 0);
                EXPECT_EQ(velocities.data(), place);
            }
}

TEST(RotnePragerYamakawaWall, MovesAndTurnsWithTheParticles) {
    mt19937 random(4);
    for (double lowest : {0.0, -0.9}) {
        const Scene scene = randomScene(random, 6, 3, lowest);
        const Matrix3d A = Eigen::AngleAxisd(1.1, Vector3d::UnitZ()).toRotationMatrix();
        Scene turned = scene;
        turned.height += 7;
        MatrixXd Q = MatrixXd::Zero(scene.particles.numRows, scene.particles.numRows);
        for (int row = 0; row < Q.rows(); row += 3) Q.block<3, 3>(row, row) = A;
        for (Vec3& r : turned.positions) {
            const Vector3d v = A * Vector3d(r[0], r[1], r[2]) + Vector3d(5, -4, 7 + 1e-13);
            r = Vec3(v[0], v[1], v[2]);
        }
        const MatrixXd expected = Q * scene.dense() * Q.transpose();
        EXPECT_LT(largest(turned.dense() - expected), 1e-11 * largest(expected));
    }
}

TEST(RotnePragerYamakawaWall, FarFromTheWall) {
    mt19937 random(5);
    Scene scene = randomScene(random, 5, 4);
    const double rise = 1e4, eta = 0.7;
    for (Vec3& r : scene.positions) r[2] += rise - scene.height;
    scene.height = 0;
    // The effect of the wall on all particles alike, to leading order in 1/height.
    const Vector3d translation = Vector3d(9.0 / 16, 9.0 / 16, 9.0 / 8) / (6 * M_PI * eta * rise);
    const Vector3d rotation =
        Vector3d(5.0 / 16, 5.0 / 16, 1.0 / 8) / (8 * M_PI * eta * rise * rise * rise);
    const MatrixXd free = scene.unbounded(eta), M = scene.dense(eta);
    const auto& p = scene.particles;
    for (int i = 0; i < p.size(); i++)
        for (int j = 0; j < p.size(); j++) {
            const MatrixXd tt = (free - M).block(p.firstRow[i], p.firstRow[j], 3, 3);
            EXPECT_LT(largest(tt - MatrixXd(translation.asDiagonal())), 2e-3 * translation[2]);
        }
    // At this height the effect on rotation is lost beside the free mobility. So two small spheres
    // are taken at height 1, and the effect is scaled.
    Scene near;
    near.add(1e-3, true, Vec3(0, 0, 1));
    near.add(2e-3, true, Vec3(1e-3, 3e-3, 1.002));
    const MatrixXd rr = (near.unbounded(eta) - near.dense(eta)).block(3, 9, 3, 3) * pow(rise, -3);
    EXPECT_LT(largest(rr - MatrixXd(rotation.asDiagonal())), 1e-2 * rotation[0]);
}

TEST(RotnePragerYamakawaWall, DriftOfARigidBody) {
    // div N of a body of three blobs, with rows about the tracking point, was computed
    // independently and is good to the digits.
    const vector<Vector3d> blobs = {{-1, 0, 2.5}, {1.2, 0.5, 2.8}, {0.2, -1.4, 3.6}};
    const Vector3d point(0, 0, 2.5);
    VectorXd expected(6);
    expected << 0.02606396, -0.0487483, 0.35555906, 0.00676236, 0.00126031, 0.00062502;
    const auto bodyMobility = [&](const Vector3d& shift, const Vector3d& turn) {
        const Matrix3d A =
            turn.norm() > 0 ? Eigen::AngleAxisd(turn.norm(), turn.normalized()).toRotationMatrix()
                            : Matrix3d(Matrix3d::Identity());
        Scene scene;
        MatrixXd K(9, 6);
        for (int i = 0; i < 3; i++) {
            const Vector3d arm = A * (blobs[i] - point), r = point + shift + arm;
            scene.add(1, false, Vec3(r[0], r[1], r[2]), 0);
            K.middleRows(3 * i, 3) << Matrix3d::Identity(), -crossMatrix(arm);
        }
        return MatrixXd((K.transpose() * scene.dense(1 / (6 * M_PI)).ldlt().solve(K)).inverse());
    };
    const double step = 1e-4;
    VectorXd divergence = VectorXd::Zero(6);
    for (int k = 0; k < 6; k++) {
        const Vector3d move = step * Vector3d::Unit(k % 3), still = Vector3d::Zero();
        const MatrixXd plus = k < 3 ? bodyMobility(move, still) : bodyMobility(still, move);
        const MatrixXd minus = k < 3 ? bodyMobility(-move, still) : bodyMobility(still, -move);
        divergence += (plus - minus).col(k) / (2 * step);
    }
    EXPECT_LT(largest(divergence - expected), 2e-8) << divergence.transpose();
}

TEST(RotnePragerYamakawaWall, CrossingIsContinuousAtContact) {
    const double e = 1e-9;
    const auto at = [](double z) {
        Scene scene;
        scene.crossing = true;
        scene.add(1, true, Vec3(0, 0, z));
        scene.add(0.6, false, Vec3(1, 0.5, 0.7));
        scene.add(0.5, true, Vec3(-0.3, 0.2, 2.1));
        return scene.dense();
    };
    const MatrixXd above = at(1 + e), below = at(1 - e);
    EXPECT_LT(largest(above - below), 20 * e * largest(above));
    EXPECT_GT(largest(above - below), 0);
    // Where nothing crosses, allowing it changes nothing.
    mt19937 random(6);
    Scene scene = randomScene(random, 6, 3);
    const MatrixXd refused = scene.dense();
    scene.crossing = true;
    EXPECT_EQ(largest(scene.dense() - refused), 0);
}

TEST(RotnePragerYamakawaWall, CrossingScalesTheMobilityAtContact) {
    Scene crossing, contact;
    crossing.crossing = contact.crossing = true;
    crossing.height = contact.height = 2;
    const double radius[] = {1, 0.5, 0.8}, z[] = {0.25, 0.5, 0.1};
    const bool torque[] = {true, false, true};
    VectorXd B(15);
    B << VectorXd::Constant(6, 0.25), VectorXd::Ones(3), VectorXd::Constant(6, 0.125);
    for (int i = 0; i < 3; i++) {
        crossing.add(radius[i], torque[i], Vec3(1.5 * i, 0.5, 2 + z[i]));
        contact.add(radius[i], torque[i], Vec3(1.5 * i, 0.5, 2 + radius[i]));
    }
    const MatrixXd expected = B.asDiagonal() * contact.dense() * B.asDiagonal();
    EXPECT_LT(largest(crossing.dense() - expected), 1e-14 * largest(expected));
}

TEST(RotnePragerYamakawaWall, CrossingPositiveDefinite) {
    mt19937 random(7);
    double smallest = INFINITY;
    for (int trial = 0; trial < 1000; trial++) {
        const double lowest = trial % 2 == 0 ? -0.5 : -0.999;
        const Scene scene = randomScene(random, 2 + trial % 6,
                                        trial % 3 == 0   ? 1
                                        : trial % 3 == 1 ? 3
                                                         : 8,
                                        lowest);
        const MatrixXd M = scene.applied();
        ASSERT_LT(largest(M - M.transpose()), 1e-13 * largest(M)) << trial;
        smallest = min(smallest, smallestEigenvalue(scene.dense()));
        ASSERT_GT(smallest, 0) << trial;
    }
    cout << "smallest eigenvalue " << smallest << endl;
}

TEST(RotnePragerYamakawaWall, RefusesParticlesThatReachThroughTheWall) {
    Scene scene;
    scene.height = 2;
    scene.particles.add(0.25, true, 4, 0);
    scene.particles.add(0.5, false, 17, -1);
    const vector<Vec3> good = {Vec3(0, 0, 2.25), Vec3(0, 0, 2.5)},
                       low = {Vec3(0, 0, 2.25), Vec3(0, 0, 2.375)},
                       lower = {Vec3(0, 0, 2.125), Vec3(0, 0, 3)},
                       on = {Vec3(0, 0, 2), Vec3(0, 0, 3)},
                       behind = {Vec3(0, 0, 3), Vec3(0, 0, 1.5)},
                       nowhere = {Vec3(0, 0, 3), Vec3(0, 0, NAN)};
    RotnePragerYamakawaWall overlap(scene.particles, 1, NoSlipPlane(2, false)),
        crossing(scene.particles, 1, NoSlipPlane(2, true));
    EXPECT_TRUE(overlap.getTraits().mayObject);
    EXPECT_TRUE(crossing.getTraits().mayObject);
    EXPECT_EQ(overlap.objection({good}), "");
    for (const auto& positions : {good, low, lower}) EXPECT_EQ(crossing.objection({positions}), "");
    const vector<string> inNoBody = {
        "particle 17 (in no body) has its centre 0.375 nm above the wall at z = 2 nm",
        "less than its radius, 0.5 nm; move it up, use smaller time steps, or allow the overlap by "
        "setWallRejection(Crossing)"};
    expectError([&] { overlap.at({low}); }, inNoBody);
    for (const string& text : inNoBody)
        EXPECT_NE(overlap.objection({low}).find(text), string::npos);
    EXPECT_NE(overlap.objection({lower}).find("particle 4 (body 0) has its centre 0.125 nm above"),
              string::npos);
    for (const auto& positions : {on, behind, nowhere})
        EXPECT_NE(overlap.objection({positions}), "");
    expectError([&] { crossing.at({on}); },
                {"particle 4 (body 0) has its centre 0 nm above the wall at z = 2 nm, where a "
                 "particle (this one of radius "
                 "0.25 nm) has no mobility; move it above the wall, or use smaller time steps"});
    EXPECT_NE(
        crossing.objection({behind}).find("particle 17 (in no body) has its centre -0.5 nm above"),
        string::npos);
    EXPECT_NE(crossing.objection({nowhere}), "");
    // A refused placement leaves the last good positions.
    auto place = overlap.at({good});
    MatrixXd before, after;
    place->dense(before);
    EXPECT_THROW(overlap.place(place, {low}), OpenMMException);
    place->dense(after);
    EXPECT_EQ(largest(after - before), 0);
}

TEST(RotnePragerYamakawaWall, RefusesAWallNowhere) {
    for (double height : {double(NAN), double(INFINITY)})
        expectError([&] { NoSlipPlane(height, false); },
                    {"the height of the no-slip wall is ", "it must be finite"});
}
