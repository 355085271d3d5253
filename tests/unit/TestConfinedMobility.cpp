// Rotne-Prager-Yamakawa above a no-slip wall and between two of them, periodic along the walls:
// values computed independently of this library, and limits.

#include <Eigen/Dense>
#include "ReferenceScenes.h"
#include "TestSupport.h"
#include "linearalgebra/Decompositions.h"
#include "mobility/models/confined/ConfinedRotnePragerYamakawa.h"
#include "mobility/models/confined/PlaneModes.h"
#include "mobility/models/wall/RotnePragerYamakawaWall.h"

using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace OpenMM;
using namespace std;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

HydrodynamicParticles spheresOf(const vector<double>& radii, bool torque = true) {
    HydrodynamicParticles particles;
    for (size_t i = 0; i < radii.size(); i++) particles.add(radii[i], torque, i, i);
    return particles;
}

/** A fluid with viscosity 1, whose wall, or lower wall, is at z = low. Height 0: one wall. */
struct Confined {
    double height = 0, low = 0;
    bool zeroFlux = false, crossing = false;

    ConfiningPlanes planes() const {
        MobilityForce force;
        force.setBoundary(height > 0 ? MobilityForce::NoSlipChannel : MobilityForce::PeriodicWall);
        force.setWallHeight(low);
        if (height > 0) force.setChannelWalls(low, low + height);
        if (zeroFlux) force.setChannelCondition(MobilityForce::ZeroFlux);
        return ConfiningPlanes(force, crossing);
    }
    ConfinedRotnePragerYamakawa model(const HydrodynamicParticles& particles) const {
        return ConfinedRotnePragerYamakawa(particles, 1, planes());
    }
    MatrixXd matrix(const HydrodynamicParticles& particles, const vector<Vec3>& positions,
                    const BoxVectors& box) const {
        MatrixXd M;
        model(particles).at({positions, box})->dense(M);
        return M;
    }
};

BoxVectors boxOf(double x, double y, double z = 1) {
    return {Vec3(x, 0, 0), Vec3(0, y, 0), Vec3(0, 0, z)};
}

/** The largest difference of entries, in units of the roots of the diagonal entries. */
double scaledDifference(const MatrixXd& a, const MatrixXd& b) {
    const VectorXd d = b.diagonal().cwiseSqrt().cwiseInverse();
    return (d.asDiagonal() * (a - b) * d.asDiagonal()).cwiseAbs().maxCoeff();
}

double leastEigenvalue(const MatrixXd& m) {
    const VectorXd d = m.diagonal().cwiseSqrt().cwiseInverse();
    return Eigen::SelfAdjointEigenSolver<MatrixXd>(MatrixXd(d.asDiagonal() * m * d.asDiagonal()))
        .eigenvalues()[0];
}

MatrixXd matrixOf(const JsonValue& rows) {
    MatrixXd M(rows.size(), rows[0].size());
    for (int i = 0; i < M.rows(); i++) M.row(i) = rows[i].column().transpose();
    return M;
}

/**
 * The largest difference from reference values, as scaledDifference().
 *
 * The lattice sums of these values end a little early and leave out one small multiple of 1 between
 * the velocities and the forces of all pairs. It is determined here, and must be small. (Against
 * Hasimoto's constant, the lattice sums of this library are right to 1e-15: TestPeriodicMobility.)
 */
double differenceFromReference(const MatrixXd& M, MatrixXd expected) {
    const int n = M.rows() / 6;
    double sum = 0;
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++)
            sum += (M - expected).block<3, 3>(6 * i, 6 * j).trace() / (3 * n * n);
    EXPECT_LT(abs(sum), 4e-12 / (6 * M_PI));
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) expected.block<3, 3>(6 * i, 6 * j).diagonal().array() += sum;
    return scaledDifference(M, expected);
}

/** Spheres of tests/data/confined. */
struct Spheres {
    JsonValue data;
    vector<Vec3> positions;
    vector<double> radii;
    BoxVectors box;

    explicit Spheres(const string& name)
        : data(readTestData("confined/" + name)), radii(data["radii"].numbers()) {
        const vector<double> edges = data["in_plane_box"].numbers();
        box = boxOf(edges[0], edges[1]);
        for (int i = 0; i < data["positions"].size(); i++) {
            const vector<double> x = data["positions"][i].numbers();
            positions.push_back(Vec3(x[0], x[1], x[2]));
        }
    }
    HydrodynamicParticles particles() const { return spheresOf(radii); }
};

vector<Vec3> shifted(vector<Vec3> positions, const Vec3& by) {
    for (Vec3& x : positions) x += by;
    return positions;
}

}  // namespace

TEST(ConfinedMobility, ThreeSpheresHaveTheirReferenceValues) {
    for (const string name : {"three_spheres", "three_overlapping"}) {
        const Spheres spheres("confined_" + name);
        const double H = spheres.data["slit_height"].number;
        const struct {
            const char* name;
            Confined fluid;
        } cases[] = {{"wall", {}},
                     {"slit_zero_mean_pressure_gradient", {H}},
                     {"slit_zero_net_flux", {H, 0, true}}};
        for (const auto& c : cases) {
            Confined fluid = c.fluid;
            const MatrixXd expected = matrixOf(spheres.data[c.name]);
            EXPECT_LT(
                differenceFromReference(
                    fluid.matrix(spheres.particles(), spheres.positions, spheres.box), expected),
                2e-12)
                << name << " " << c.name;
            // Nor do the height of the walls, the third vector of the box and whole periods matter.
            fluid.low = -7.3;
            BoxVectors other = spheres.box;
            other[2] = Vec3(0, 0, 123);
            vector<Vec3> moved = shifted(spheres.positions, Vec3(0, 0, fluid.low));
            moved[1] += other[0] * 3 - other[1];
            EXPECT_LT(
                differenceFromReference(fluid.matrix(spheres.particles(), moved, other), expected),
                2e-12);
        }
    }
}

TEST(ConfinedMobility, OneSphereHasItsReferenceValues) {
    const JsonValue data = readTestData("confined/confined_own_mobilities");
    for (const char* geometry : {"wall", "slit"})
        for (const JsonValue& list : data[geometry].list) {
            const vector<double> edges = list["box"].numbers();
            const bool isWall = geometry == string("wall");
            const Confined fluid = {isWall ? 0 : list["height"].number, 0,
                                    !isWall && list["convention"].text == "flux0"};
            for (const JsonValue& row : list["rows"].list) {
                const vector<double> value = row.numbers();
                const MatrixXd M = fluid.matrix(spheresOf({1}), {Vec3(0.3, -2, value[0])},
                                                boxOf(edges[0], edges[1]));
                MatrixXd expected = MatrixXd::Zero(6, 6);
                for (int a = 0; a < 3; a++) {
                    expected(a, a) = value[1 + a] / (6 * M_PI);
                    expected(3 + a, 3 + a) = value[4 + a] / (8 * M_PI);
                }
                expected(0, 4) = expected(4, 0) = value[7] / (6 * M_PI);
                expected(1, 3) = expected(3, 1) = value[8] / (6 * M_PI);
                EXPECT_LT(differenceFromReference(M, expected), 1e-12)
                    << geometry << " " << value[0];
            }
        }
}

TEST(ConfinedMobility, DoesNotDependOnThePeriodOfItsBase) {
    // A sphere far above the others lengthens the period along z.
    const vector<Vec3> positions = {Vec3(0, 0, 1), Vec3(2.2, 1, 1.6)};
    const BoxVectors box = boxOf(7, 6);
    const MatrixXd M = Confined().matrix(spheresOf({1, 0.7}), positions, box);
    for (double height : {9.0, 40.0}) {
        vector<Vec3> more = positions;
        more.push_back(Vec3(3, -1, height));
        const MatrixXd with =
            Confined().matrix(spheresOf({1, 0.7, 1}), more, box).topLeftCorner(12, 12);
        EXPECT_LT(scaledDifference(with, M), 1e-12) << height;
    }
}

TEST(ConfinedMobility, ALargeBoxIsTheWallAlone) {
    // Of the images of a force along the wall, those of order r^-3 stay: 12 z^2 4.51681/(8 pi L^3).
    // Along z the error is of order L^-5.
    const HydrodynamicParticles sphere = spheresOf({1});
    for (double z : {1.0, 1.5}) {
        MatrixXd alone;
        RotnePragerYamakawaWall(sphere, 1, NoSlipPlane(0, false))
            .at({{Vec3(0, 0, z)}})
            ->dense(alone);
        MatrixXd errors[2];
        const double edges[2] = {64, 128};
        for (int e = 0; e < 2; e++)
            errors[e] =
                Confined().matrix(sphere, {Vec3(0, 0, z)}, boxOf(edges[e], edges[e])) - alone;
        for (int e = 0; e < 2; e++) {
            const double law = 12 * z * z * 4.51681 / (8 * M_PI * pow(edges[e], 3));
            EXPECT_NEAR(errors[e](0, 0) / law, 1, 40 / (edges[e] * edges[e])) << z;
            EXPECT_NEAR(errors[e](1, 1), errors[e](0, 0), 1e-13);
        }
        EXPECT_NEAR(log2(errors[0](2, 2) / errors[1](2, 2)), 5, 0.1) << z;
        EXPECT_LT(abs(errors[0](2, 2)), 3e-5);
    }
}

TEST(ConfinedMobility, TheMeanOfBothConditionsIsTheInfiniteChannel) {
    const HydrodynamicParticles sphere = spheresOf({1});
    const double H = 4, z = 1.5, L = 32, a = 1;
    MatrixXd M[2];
    for (int flux = 0; flux < 2; flux++)
        M[flux] = Confined{H, 0, flux == 1}.matrix(sphere, {Vec3(0, 0, z)}, boxOf(L, L));
    // Liron and Mochon's channel.
    EXPECT_NEAR(3 * M_PI * (M[0](0, 0) + M[1](0, 0)), 0.525490138216, 2e-10);
    EXPECT_NEAR(6 * M_PI * M[0](2, 2), 0.327232847402, 1e-11);
    EXPECT_EQ(M[0](2, 2), M[1](2, 2));
    EXPECT_NEAR(M[0](0, 0) - M[1](0, 0), 3 * pow(z * (H - z) - a * a / 3, 2) / (pow(H, 3) * L * L),
                1e-14);
}

TEST(ConfinedMobility, AHighChannelIsTheWall) {
    // What is left decays as -z z'/(eta H A), from forces along the walls.
    const HydrodynamicParticles spheres = spheresOf({1, 0.8});
    const vector<Vec3> positions = {Vec3(0, 0, 1.3), Vec3(1, 2, 2.4)};
    const BoxVectors box = boxOf(6, 7);
    const MatrixXd wall = Confined().matrix(spheres, positions, box);
    for (double H : {80.0, 300.0}) {
        MatrixXd expected = wall;
        // Torques about y feel and make half of the shear.
        const auto law = [&](int i, int j, bool turn_i, bool turn_j) {
            return -(turn_i ? 0.5 : positions[i][2]) * (turn_j ? 0.5 : positions[j][2]) / (H * 42);
        };
        for (int i = 0; i < 2; i++)
            for (int j = 0; j < 2; j++)
                for (int axis = 0; axis < 2; axis++) {
                    const int V = 6 * i + axis, W = 6 * i + 4 - axis, F = 6 * j + axis,
                              T = 6 * j + 4 - axis, sign = axis == 0 ? 1 : -1;
                    expected(V, F) += law(i, j, false, false);
                    expected(W, F) += sign * law(i, j, true, false);
                    expected(V, T) += sign * law(i, j, false, true);
                    expected(W, T) += law(i, j, true, true);
                }
        EXPECT_LT(scaledDifference(Confined{H}.matrix(spheres, positions, box), expected), 2e-12)
            << H;
    }
}

TEST(ConfinedMobility, HasTheSymmetriesOfTheFluid) {
    const vector<double> radii = {1, 0.7, 0.8};
    const vector<Vec3> positions = {Vec3(0.3, -1, 1.1), Vec3(2, 1.3, 2.2), Vec3(-2, 3, 2.9)};
    const HydrodynamicParticles particles = spheresOf(radii);
    for (const Confined& fluid : {Confined(), Confined{4.2}, Confined{4.2, 0, true}}) {
        const MatrixXd M = fluid.matrix(particles, positions, boxOf(6, 8));
        EXPECT_EQ(M, MatrixXd(M.transpose()));
        // x and y swapped
        vector<Vec3> swapped;
        for (const Vec3& x : positions) swapped.push_back(Vec3(x[1], x[0], x[2]));
        MatrixXd P = MatrixXd::Zero(18, 18);
        for (int i = 0; i < 3; i++) {
            Matrix3d swap;
            swap << 0, 1, 0, 1, 0, 0, 0, 0, 1;
            P.block<3, 3>(6 * i, 6 * i) = swap;
            P.block<3, 3>(6 * i + 3, 6 * i + 3) = -swap;
        }
        EXPECT_LT(
            scaledDifference(
                MatrixXd(P * fluid.matrix(particles, swapped, boxOf(8, 6)) * P.transpose()), M),
            1e-12);
        // Another pair of vectors of the same lattice
        BoxVectors skewed = boxOf(6, 8);
        skewed[1] = Vec3(-6, 8, 0);
        EXPECT_LT(scaledDifference(fluid.matrix(particles, positions, skewed), M), 1e-12);
        // Lengths twice as large
        Confined twice = fluid;
        twice.height *= 2;
        vector<Vec3> scaled;
        for (const Vec3& x : positions) scaled.push_back(x * 2);
        VectorXd units(18);
        for (int i = 0; i < 18; i++) units[i] = i % 6 < 3 ? sqrt(2) : sqrt(8);
        EXPECT_LT(scaledDifference(
                      MatrixXd(units.asDiagonal() *
                               twice.matrix(spheresOf({2, 1.4, 1.6}), scaled, boxOf(12, 16)) *
                               units.asDiagonal()),
                      M),
                  1e-12);
        if (fluid.height == 0) continue;
        // The channel upside down
        vector<Vec3> mirrored;
        for (const Vec3& x : positions) mirrored.push_back(Vec3(x[0], x[1], fluid.height - x[2]));
        VectorXd signs(18);
        for (int i = 0; i < 18; i++) signs[i] = i % 6 == 2 || i % 6 == 3 || i % 6 == 4 ? -1 : 1;
        EXPECT_LT(scaledDifference(
                      MatrixXd(signs.asDiagonal() * fluid.matrix(particles, mirrored, boxOf(6, 8)) *
                               signs.asDiagonal()),
                      M),
                  1e-12);
    }
}

TEST(ConfinedMobility, IsPositiveDefiniteAtTheLimits) {
    mt19937 random(5);
    uniform_real_distribution<double> uniform(0, 1);
    double least = INFINITY;
    for (const Confined& fluid :
         {Confined(), Confined{2.05}, Confined{2.05, 0, true}, Confined{6}, Confined{6, 0, true}})
        for (bool torques : {true, false})
            for (int n = 0; n < 4; n++) {
                // Crowded, with many that overlap, and some that touch a wall
                vector<double> radii;
                vector<Vec3> positions;
                for (int i = 0; i < 24; i++) {
                    radii.push_back(i % 3 == 0 ? 1 : 0.3 + 0.7 * uniform(random));
                    const double top = (fluid.height > 0 ? fluid.height : 5) - radii[i];
                    const double z =
                        i % 4 == 0 ? radii[i] : radii[i] + (top - radii[i]) * uniform(random);
                    positions.push_back(Vec3(5 * uniform(random), 6 * uniform(random), z));
                }
                const double found = leastEigenvalue(
                    fluid.matrix(spheresOf(radii, torques), positions, boxOf(5, 6)));
                EXPECT_GT(found, 0);
                least = min(least, found);
            }
    cout << "least eigenvalue " << least << endl;
}

TEST(ConfinedMobility, FlatBoxesLoseNoDigits) {
    // The mean of both conditions is exponentially near to the infinite channel, also in the
    // narrowest of these boxes. In the widest one sums of planes have factors up to (L/H)^4/3.
    const double height = 2.05;
    const vector<Vec3> middle = {Vec3(0, 0, height / 2)};
    vector<MatrixXd> means;
    for (double ratio : {15, 40, 80}) {
        const BoxVectors box = boxOf(ratio * height, ratio * height);
        const HydrodynamicParticles sphere = spheresOf({1});
        means.push_back(0.5 * (Confined{height}.matrix(sphere, middle, box) +
                               Confined{height, 0, true}.matrix(sphere, middle, box)));
        EXPECT_LE(scaledDifference(means.back(), means[0]), 2e-12) << ratio;
    }
}

TEST(ConfinedMobility, DampsWhatReachesThroughAWall) {
    const double H = 5, a = 0.8;
    Confined crossing = {H, 0, false, true}, touching = {H};
    const vector<Vec3> at = {Vec3(0, 0, 0.2), Vec3(1, 2, 2.2), Vec3(2, -1, H - 0.3)},
                       lifted = {Vec3(0, 0, a), Vec3(1, 2, 2.2), Vec3(2, -1, H - a)};
    const HydrodynamicParticles particles = spheresOf({a, a, a});
    VectorXd B(18);
    B << VectorXd::Constant(6, 0.2 / a), VectorXd::Constant(6, 1), VectorXd::Constant(6, 0.3 / a);
    const MatrixXd expected =
        B.asDiagonal() * touching.matrix(particles, lifted, boxOf(6, 6)) * B.asDiagonal();
    const MatrixXd M = crossing.matrix(particles, at, boxOf(6, 6));
    EXPECT_LT(scaledDifference(M, expected), 1e-14);
    EXPECT_GT(leastEigenvalue(M), 0.01);
    expectError([&] { touching.matrix(particles, at, boxOf(6, 6)); },
                {"NoSlipChannel: particle 0 (body 0) has its centre at z = 0.2 nm, with walls at z "
                 "= 0 and 5 nm, nearer to a plane than its radius, 0.8 nm",
                 "setWallRejection(Crossing)"});
    expectError([&] { crossing.matrix(particles, shifted(at, Vec3(0, 0, 1)), boxOf(6, 6)); },
                {"NoSlipChannel: particle 2 (body 2) has its centre at z = 5.7 nm", "no mobility"});
    expectError([&] { Confined().matrix(particles, at, boxOf(6, 6)); },
                {"PeriodicWall: particle 0 (body 0)", "with the wall at z = 0 nm"});
}

TEST(ConfinedMobility, RefusesBoxesAndRadiiByName) {
    expectError([&] { Confined{1.5}.model(spheresOf({1})); },
                {"NoSlipChannel has its planes at z = 0 and 1.5 nm",
                 "nearer to each other than the diameter of particle 0 (body 0), 2 nm",
                 "setChannelWalls()"});
    BoxVectors tilted = boxOf(6, 6, 6);
    tilted[2] = Vec3(1, 0, 6);
    expectError([&] { Confined().matrix(spheresOf({1}), {Vec3(0, 0, 2)}, tilted); },
                {"PeriodicWall needs a box whose third vector is along z", "(1, 0, 6)",
                 "setPeriodicBoxVectors()"});
    expectError([&] { Confined().matrix(spheresOf({1}), {Vec3(0, 0, 2)}, {}); },
                {"PeriodicWall needs a periodic box", "setDefaultPeriodicBoxVectors()"});
}

TEST(ConfinedMobility, ItsFlowIsThatOfSmallSpheres) {
    const vector<Vec3> positions = {Vec3(0.3, -1, 1), Vec3(2, 1.3, 2.2)},
                       points = {Vec3(1, 1, 0.4), Vec3(-2, 2, 2), Vec3(3, 0, 3.9),
                                 Vec3(0.3, -0.5, 1.2)};
    const HydrodynamicParticles particles = spheresOf({1, 0.7});
    const BoxVectors box = boxOf(6, 8);
    MatrixXd forces(12, 1);
    forces << 1, -2, 3, 0.5, 1, -1, 2, 1, -1, -1, 0.3, 2;
    for (const Confined& fluid : {Confined(), Confined{4.5}, Confined{4.5, 0, true}}) {
        const ConfinedRotnePragerYamakawa model = fluid.model(particles);
        Velocities flow = Velocities::Zero(3, points.size());
        model.at({positions, box})->addFlowAt({forces, {}}, points, 1, flow);
        const double tiny = 1e-4;
        vector<Vec3> all = positions;
        HydrodynamicParticles more = particles;
        for (const Vec3& x : points) {
            all.push_back(x);
            more.add(tiny, false, more.size(), more.size());
        }
        const MatrixXd M = fluid.matrix(more, all, box);
        for (size_t p = 0; p < points.size(); p++)
            EXPECT_LT((M.block(12 + 3 * p, 0, 3, 12) * forces - flow.col(p)).norm(), 1e-8) << p;
        // At rest on the walls
        const double top = fluid.height > 0 ? fluid.height : 0;
        Velocities onWalls = Velocities::Zero(3, 2);
        model.at({positions, box})
            ->addFlowAt({forces, {}}, {Vec3(0.1, -1.3, 0), Vec3(2, 1.5, top)}, 1, onWalls);
        EXPECT_LT(onWalls.cwiseAbs().maxCoeff(), 1e-12);
    }
}

TEST(ConfinedMobility, TheMeanFlowIsThatOfTheCondition) {
    // Over planes that no sphere reaches, the mean of the flow of a force along x is g(z, z') F/A.
    // Its integral is the flux: D p/(2 eta A), or 0.
    const double H = 5, z = 2.2, a = 0.7;
    const HydrodynamicParticles particles = spheresOf({a});
    const BoxVectors box = boxOf(4, 4);
    const double area = 16, Dp = z * (H - z) - a * a / 3;
    MatrixXd force = MatrixXd::Zero(6, 1);
    force(0, 0) = 1;
    for (bool zeroFlux : {false, true})
        for (double height : {0.0, H})
            for (double plane : {0.5, 4.2}) {
                if (zeroFlux && height == 0) continue;
                vector<Vec3> points;
                const int n = 24;
                for (int i = 0; i < n * n; i++)
                    points.push_back(Vec3(i % n * 4.0 / n, i / n * 4.0 / n, plane));
                Velocities flow = Velocities::Zero(3, points.size());
                Confined{height, 0, zeroFlux}
                    .model(particles)
                    .at({{Vec3(1, 2, z)}, box})
                    ->addFlowAt({force, {}}, points, 1, flow);
                double expected = min(plane, z);
                if (height > 0) expected = expected * (H - max(plane, z)) / H;
                if (zeroFlux) expected -= 3 / (H * H * H) * plane * (H - plane) * Dp;
                const Eigen::Vector3d mean = flow.rowwise().mean();
                // The sampled sum contains waves of n periods.
                EXPECT_NEAR(mean[0], expected / area, 1e-11);
                EXPECT_NEAR(mean[1], 0, 1e-11);
                EXPECT_NEAR(mean[2], 0, 1e-11);
            }
}
