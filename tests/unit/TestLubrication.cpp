// Lubrication on top of models without it: exact pairs, exact spheres at walls, and products by
// iterations.

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <random>
#include <set>
#include "linearalgebra/Decompositions.h"

#include "TestSupport.h"
#include "linearalgebra/BlockIncompleteCholesky.h"
#include "linearalgebra/Gmres.h"
#include "mobility/NearAndFar.h"
#include "mobility/models/confined/ConfinedForceCoupling.h"
#include "mobility/models/confined/ForceCouplingAtWall.h"
#include "mobility/models/lubricated/LubricatedMobility.h"
#include "mobility/models/periodic/PeriodicMobility.h"
#include "mobility/models/rotneprager/RotnePragerYamakawa.h"
#include "mobility/models/stokesian/StokesianDynamics.h"
#include "mobility/models/wall/RotnePragerYamakawaWall.h"
#include "mobility/models/wall/SphereWall.h"
#include "openmmrigidhi/MobilityForce.h"

using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace std;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

namespace {

const double eta = 0.7;
const LubricationReach everywhere = {100, 101}, near = {3, 4};

struct Spheres {
    HydrodynamicParticles particles;
    Placement placement;

    void add(double radius, const Vector3d& x, bool torque = true) {
        particles.add(radius, torque, 2 * particles.size() + 1, torque ? particles.size() : -1);
        placement.positions.push_back(Vec3(x[0], x[1], x[2]));
    }
    LubricatedMobility unbounded(LubricationReach reach = everywhere, double minimumGap = 0) const {
        LubricationScene scene;
        scene.reach = reach;
        scene.minimumGap = minimumGap;
        return {particles, eta, overSurfaces(), scene,
                make_unique<RotnePragerYamakawa>(particles, eta)};
    }
    LubricatedMobility aboveWall(LubricationReach reach = everywhere) const {
        LubricationScene scene;
        scene.reach = reach;
        scene.low = 0;
        return {particles, eta, overSurfaces(), scene,
                make_unique<RotnePragerYamakawaWall>(particles, eta, NoSlipPlane(0, false))};
    }
    LubricatedMobility inBox(bool gaussians = false, LubricationReach reach = near) const {
        LubricationScene scene;
        scene.reach = reach;
        scene.numPeriods = 3;
        if (gaussians)
            return {particles, eta, overGaussians(), scene,
                    make_unique<PeriodicForceCoupling>(particles, eta)};
        return {particles, eta, overSurfaces(), scene,
                make_unique<PeriodicRotnePragerYamakawa>(particles, eta)};
    }
};

MatrixXd denseOf(const MobilityModel& model, const Placement& placement) {
    MatrixXd matrix;
    model.at(placement)->dense(matrix);
    return matrix;
}
MatrixXd frictionOf(const MobilityModel& model, const Placement& placement) {
    MatrixXd matrix;
    model.at(placement)->friction(matrix);
    return matrix;
}
/** The largest error of a matrix in the norm of another one. */
double errorOf(const MatrixXd& matrix, const MatrixXd& exact) {
    return Eigen::GeneralizedSelfAdjointEigenSolver<MatrixXd>(matrix - exact, exact)
        .eigenvalues()
        .cwiseAbs()
        .maxCoeff();
}

/** Three unequal spheres above a wall and a free particle. */
Spheres threeAtWall() {
    Spheres s;
    s.add(1, {0, 0, 1.05});
    s.add(1.25, {2.25, 0.3, 1.31});
    s.add(0.3, {-1.2, 1.1, 0.6}, false);
    s.add(0.8, {0.72, 1.9, 2});
    return s;
}

/** Random hard spheres in a cube at a volume fraction, each nearly touching another one. */
Spheres suspension(int count, double fraction, double gap, int seed) {
    const double edge = cbrt(4 * M_PI / 3 * count / fraction);
    mt19937 random(seed);
    uniform_real_distribution<double> u(-0.5, 0.5);
    const int side = ceil(cbrt(count / 4.0) - 1e-9);
    vector<Vector3d> x;
    for (int i = 0; (int)x.size() < count; i++) {
        const Vector3d cell(i % side, i / side % side, i / side / side);
        for (const Vector3d& basis : {Vector3d(0, 0, 0), Vector3d(0, 0.5, 0.5),
                                      Vector3d(0.5, 0, 0.5), Vector3d(0.5, 0.5, 0)})
            if ((int)x.size() < count) x.push_back((cell + basis) * edge / side);
    }
    const auto distanceTo = [&](const Vector3d& a, const Vector3d& b) {
        Vector3d d = a - b;
        for (int k = 0; k < 3; k++) d[k] -= edge * round(d[k] / edge);
        return d;
    };
    const auto isFree = [&](int i, const Vector3d& place) {
        for (int j = 0; j < count; j++)
            if (j != i && distanceTo(place, x[j]).norm() < 2 + gap) return false;
        return true;
    };
    for (int sweep = 0; sweep < 100; sweep++)
        for (int i = 0; i < count; i++) {
            const Vector3d place = x[i] + 0.6 * Vector3d(u(random), u(random), u(random));
            if (isFree(i, place)) x[i] = place;
        }
    for (int i = 0; i < count; i++) {
        Vector3d nearest(edge, 0, 0);
        for (int j = 0; j < count; j++)
            if (j != i && distanceTo(x[j], x[i]).norm() < nearest.norm())
                nearest = distanceTo(x[j], x[i]);
        const Vector3d place =
            x[i] + (nearest.norm() - 2 - gap * (1 + 1e-9)) * nearest.normalized();
        if (isFree(i, place)) x[i] = place;
    }
    Spheres s;
    for (const Vector3d& place : x) s.add(1, place);
    s.placement.box = {Vec3(edge, 0, 0), Vec3(0, edge, 0), Vec3(0, 0, edge)};
    return s;
}

MatrixXd randomVectors(int rows, int columns, int seed) {
    mt19937 random(seed);
    normal_distribution<double> normal;
    MatrixXd x(rows, columns);
    for (int c = 0; c < columns; c++)
        for (int r = 0; r < rows; r++) x(r, c) = normal(random);
    return x;
}

/** Products against matrices, in the norm of the friction. */
void checkProducts(const LubricatedMobility& model, const Placement& placement) {
    const MatrixXd N = denseOf(model, placement), R = frictionOf(model, placement),
                   F = randomVectors(N.rows(), 2, 3), exact = N * F;
    for (double tolerance : {1e-3, 1e-6, 1e-9}) {
        const auto at = model.at(placement);
        MatrixXd U;
        at->multiply(F, U, {tolerance});
        for (int c = 0; c < 2; c++) {
            const Eigen::VectorXd error = U.col(c) - exact.col(c);
            EXPECT_LT(sqrt(error.dot(R * error) / exact.col(c).dot(R * exact.col(c))),
                      tolerance + 1e-12);
        }
        EXPECT_GT(at->parts()->getNumIterations(), 0);
    }
}

}  // namespace

TEST(Lubrication, TwoSpheresAreExact) {
    for (double ratio : {1.0, 0.4, 2.5})
        for (double gap : {1e-3, 0.05, 1.0, 4.0}) {
            Spheres s;
            s.add(1, {0.3, -0.1, 0.4});
            s.add(ratio,
                  Vector3d(0.3, -0.1, 0.4) + (1 + ratio) * (1 + gap / 2) * Vector3d(1, -2, 2) / 3);
            const StokesianDynamics exact(s.particles, eta, true, 0);
            EXPECT_LT(
                errorOf(frictionOf(s.unbounded(), s.placement), frictionOf(exact, s.placement)),
                1e-9)
                << ratio << " " << gap;
            EXPECT_LT(errorOf(denseOf(s.unbounded(), s.placement), denseOf(exact, s.placement)),
                      1e-9);
        }
}

/** Gaussians do not approximate the friction from below, so a part of Delta could be negative. */
TEST(Lubrication, PairsOfGaussiansAreNearlyExact) {
    for (double ratio : {1.0, 0.7, 0.4, 0.1})
        for (double gap : {1e-3, 0.05, 0.3, 1.0, 2.0}) {
            Spheres s;
            s.add(1, {0, 0, 0});
            s.add(ratio, {0, 0, (1 + ratio) * (1 + gap / 2)});
            LubricationScene scene;
            scene.reach = everywhere;
            const Lubrication lubrication(s.particles, eta, overGaussians(), scene, "model");
            vector<Lubrication::NearPair> pairs;
            lubrication.findPairs(s.placement, pairs);
            ASSERT_EQ(pairs.size(), 1u);
            Lubrication::Pair delta, root;
            lubrication.ofPair(pairs[0], delta, root);
            MatrixXd M;
            freeForceCoupling(s.particles, s.placement.positions, eta, M);
            const StokesianDynamics exact(s.particles, eta, true, 0);
            // A negative part is left out. It grows with the ratio of the radii.
            const double bound = ratio >= 0.7 ? 1.2e-4 : ratio == 0.4 ? 2e-3 : 2e-2;
            EXPECT_LT(errorOf(M.inverse() + delta.whole(Vector3d::UnitZ()),
                              frictionOf(exact, s.placement)),
                      bound)
                << ratio << " " << gap;
        }
}

TEST(Lubrication, OneSphereAtAWallIsExact) {
    for (double gap : {1e-3, 0.05, 1.0, 3.0}) {
        Spheres s;
        s.add(1.3, {0.3, -0.1, 1.3 * (1 + gap)});
        const NoSlipPlane wall(0, false);
        const SphereWallCongruence exact(
            s.particles, eta, wall, "NoSlipWall",
            make_unique<RotnePragerYamakawaWall>(s.particles, eta, wall));
        EXPECT_LT(errorOf(denseOf(s.aboveWall(), s.placement), denseOf(exact, s.placement)), 1e-10);
    }
}

/** Far from the wall an envelope acts as a sphere whose square of the radius is 3/pi as large. */
TEST(Lubrication, GaussiansFarFromAWallAreSpheres) {
    const double part = 3 / M_PI;
    for (double u : {0.25, 0.2, 0.1, 0.01, 0.0}) {
        const SphereWallMobility m = ForceCouplingAtWall(1.5).at(u);
        const double u3 = u * u * u, u5 = u3 * u * u;
        EXPECT_NEAR(m.along, 1 - 9 * u / 16 + part * u3 / 8 - part * part * u5 / 16, 1e-9);
        EXPECT_NEAR(m.across, 1 - 9 * u / 8 + part * u3 / 2 - part * part * u5 / 8, 1e-9);
        EXPECT_NEAR(m.turnAlong, 0.75 * (1 - 5 * u3 / 16), 1e-9);
        EXPECT_NEAR(m.turnNormal, 0.75 * (1 - u3 / 8), 1e-9);
        EXPECT_NEAR(m.rolling, 3 * part * u3 * u / 32, 1e-9);
    }
}

/** One of ConfinedForceCoupling in a wide box. What images add along the wall falls as L^-3. */
TEST(Lubrication, GaussiansAtAWallAreThoseOfTheModel) {
    HydrodynamicParticles particles;
    particles.add(1, true, 0, 0);
    MobilityForce force;
    force.setBoundary(MobilityForce::PeriodicWall);
    const ConfiningPlanes planes(force, false);
    const ConfinedForceCoupling model(particles, eta, planes, 1e-6, 0,
                                      make_shared<PlainGridFluid>());
    const double unit = 6 * M_PI * eta;
    for (double height : {1.0, 1.5}) {
        MatrixXd inBox[2];
        for (int wide : {0, 1}) {
            Placement placement;
            const double edge = wide ? 40 : 20;
            placement.box = {Vec3(edge, 0, 0), Vec3(0, edge, 0), Vec3(0, 0, 9)};
            placement.positions = {Vec3(0.3, 0.1, height)};
            inBox[wide] = unit * denseOf(model, placement);
        }
        const MatrixXd wall = (8 * inBox[1] - inBox[0]) / 7;
        const SphereWallMobility m = ForceCouplingAtWall(1.5).at(1 / height);
        const double error = height == 1 ? 1e-5 : 1e-4;  // what is left of images, as L^-5
        EXPECT_NEAR(wall(0, 0), m.along, error);
        EXPECT_NEAR(wall(2, 2), m.across, error);
        EXPECT_NEAR(wall(3, 3), m.turnAlong, error);
        EXPECT_NEAR(wall(5, 5), m.turnNormal, error);
        EXPECT_NEAR(wall(0, 4), m.rolling, error);
        EXPECT_NEAR(wall(4, 0), m.rolling, error);
    }
}

TEST(Lubrication, GaussiansAtAWallAreATable) {
    for (double behind : {1.5, 2.0, 15.0}) {
        const ForceCouplingAtWall table(behind);
        for (double u : {1.0, 0.97, 0.71, 0.333, 0.26, 0.1}) {
            const SphereWallMobility found = table.at(u),
                                     exact = ForceCouplingAtWall::integral(u, behind);
            EXPECT_NEAR(found.along, exact.along, 1e-12);
            EXPECT_NEAR(found.across, exact.across, 1e-12);
            EXPECT_NEAR(found.turnAlong, exact.turnAlong, 1e-12);
            EXPECT_NEAR(found.turnNormal, exact.turnNormal, 1e-12);
            EXPECT_NEAR(found.rolling, exact.rolling, 1e-12);
        }
    }
}

/** The friction of the model by itself and what it lacks are that of a rigid sphere. */
TEST(Lubrication, OneGaussianAtAWallIsExact) {
    for (double gap : {1e-3, 0.05, 0.3, 1.0, 3.0}) {
        Spheres s;
        s.add(1.3, {0.3, -0.1, 1.3 * (1 + gap)});
        LubricationScene scene;
        scene.reach = near;
        scene.low = 0;
        scene.behind = 1.5 * 1.3;
        const Lubrication lubrication(s.particles, eta, overGaussians(), scene, "model");
        Lubrication::Single delta, root, own;
        lubrication.ofSphere(0, s.placement.positions[0][2], delta, root, own);
        own += delta;
        const NoSlipPlane wall(0, false);
        const SphereWallCongruence exact(
            s.particles, eta, wall, "NoSlipWall",
            make_unique<RotnePragerYamakawaWall>(s.particles, eta, wall));
        // A negative part is left out.
        EXPECT_LT(errorOf(own.whole(Vector3d::UnitZ()), frictionOf(exact, s.placement)), 1e-4)
            << gap;
    }
}

/**
 * A mirror stands for spheres with their images, which move as the mirrored ones do. Half of the
 * friction of all is that of the spheres.
 */
TEST(Lubrication, MirrorsAreImages) {
    for (bool channel : {false, true}) {
        const int axis = channel ? 1 : 2;
        const double plane = channel ? -0.5 : 4, other = channel ? 3.1 : 0;
        Spheres s;
        const auto at = [&](double x, double along, double fromPlane) {
            Vector3d place(x, along, along);
            place[axis] = channel ? plane + fromPlane : plane - fromPlane;
            return place;
        };
        s.add(1, at(0, 0.2, 1.02));
        s.add(0.7, at(1.75, 0.3, 0.71));
        s.add(0.3, at(-1.2, 1.1, 0.6), false);
        s.add(0.8, at(0.72, 1.9, 2.2));
        s.placement.box = {Vec3(4.4, 0, 0), Vec3(0, 5, 0), Vec3(0, 0, 20)};
        LubricationScene scene, whole;
        scene.reach = whole.reach = near;
        scene.numPeriods = whole.numPeriods = channel ? 3 : 2;
        scene.mirrorAxis = axis;
        scene.mirror = plane;
        if (channel) scene.mirrorPeriod = 2 * (other - plane);
        Spheres all = s;
        MatrixXd P = MatrixXd::Zero(2 * s.particles.numRows, s.particles.numRows);
        P.topRows(s.particles.numRows).setIdentity();
        for (int i = 0; i < s.particles.size(); i++) {
            Vec3 x = s.placement.positions[i];
            x[axis] = 2 * plane - x[axis];
            const bool torque = s.particles.hasTorque[i];
            all.add(s.particles.radii[i], {x[0], x[1], x[2]}, torque);
            for (int k = 0; k < (torque ? 6 : 3); k++)
                P(s.particles.numRows + s.particles.firstRow[i] + k, s.particles.firstRow[i] + k) =
                    (k % 3 == axis) == (k < 3) ? -1 : 1;
        }
        if (channel) all.placement.box[1] = Vec3(0, scene.mirrorPeriod, 0);
        const auto deltaOf = [&](const Spheres& of, const LubricationScene& in) -> MatrixXd {
            const Lubrication lubrication(of.particles, eta, overGaussians(), in, "model");
            Lubrication::Terms terms;
            lubrication.findTerms(of.placement, terms);
            const int rows = of.particles.numRows;
            MatrixXd delta = MatrixXd::Zero(rows, rows), product = delta;
            lubrication.addTo(terms, delta);
            lubrication.addProduct(terms, MatrixXd::Identity(rows, rows), product);
            EXPECT_LT((delta - product).norm(), 1e-13 * delta.norm());
            return delta;
        };
        const MatrixXd mirrored = deltaOf(s, scene),
                       expected = 0.5 * P.transpose() * deltaOf(all, whole) * P;
        EXPECT_LT((mirrored - expected).norm(), 1e-12 * expected.norm()) << channel;
        EXPECT_GT((mirrored - deltaOf(s, whole)).norm(), 0.1 * expected.norm());
    }
}

/** Random forces at a mirror have the covariance of the friction that it adds. */
TEST(Lubrication, NoiseAtAMirror) {
    Spheres s;
    s.add(1, {0, 0, -1.05});
    s.add(1.2, {2.3, 0, -1.3});
    LubricationScene scene;
    scene.reach = near;
    scene.mirrorAxis = 2;
    const Lubrication lubrication(s.particles, eta, overGaussians(), scene, "model");
    Lubrication::Terms terms;
    lubrication.findTerms(s.placement, terms);
    EXPECT_EQ(terms.pairs.size(), 4u);
    MatrixXd delta = MatrixXd::Zero(12, 12), covariance = delta;
    lubrication.addTo(terms, delta);
    // Keys differ, so that terms have independent numbers.
    set<pair<uint32_t, uint32_t>> keys;
    for (size_t k = 0; k < terms.pairs.size(); k++) {
        pair<uint32_t, uint32_t> key;
        lubrication.keyOfPair(terms.pairs[k], key.first, key.second);
        keys.insert(key);
    }
    EXPECT_EQ(keys.size(), 4u);
    NoiseStream noise;
    const int samples = 4000;
    for (int k = 0; k < samples; k++) {
        noise.step = k;
        MatrixXd forces = MatrixXd::Zero(12, 1);
        EXPECT_EQ(lubrication.addNoise(terms, noise, NoiseStream::ParticleFirstDraw, forces), 48);
        covariance += forces * forces.transpose() / samples;
    }
    const Eigen::SelfAdjointEigenSolver<MatrixXd> solver(delta);
    const MatrixXd scale = (solver.eigenvalues().array() + 1e-2 * solver.eigenvalues().maxCoeff())
                               .rsqrt()
                               .matrix()
                               .asDiagonal() *
                           solver.eigenvectors().transpose();
    EXPECT_LT((scale * (covariance - delta) * scale.transpose()).cwiseAbs().maxCoeff(),
              5 * sqrt(2.0 / samples));
}

/**
 * Lubrication of pairs does not change the force on the fluid, and a wall takes its share of the
 * force.
 */
TEST(Lubrication, TheFluidHasTheForcesOnSpheres) {
    Spheres pair;
    pair.add(1, {0, 0, 3});
    pair.add(0.5, {0, 1.51, 3});
    const MatrixXd F = randomVectors(12, 1, 5);
    EXPECT_EQ(pair.unbounded().at(pair.placement)->sources(F, nullptr).forces, F);
    // One sphere: the flow of the model has the sphere's velocity at the sphere.
    Spheres one;
    one.add(1.3, {0.3, -0.1, 1.35});
    const NoSlipPlane wall(0, false);
    const MatrixXd M = denseOf(RotnePragerYamakawaWall(one.particles, eta, wall), one.placement);
    MatrixXd U;
    const auto model = one.aboveWall();
    const auto at = model.at(one.placement);
    at->multiply(F.topRows(6), U);
    EXPECT_LT((M * at->sources(F.topRows(6), nullptr).forces - U).norm(), 1e-9 * U.norm());
}

/** Below a wall a sphere moves as the reflected sphere above a wall. */
TEST(Lubrication, UpperWallsAreLowerOnesReflected) {
    Spheres s;
    s.add(1.3, {0, 0, 1.4});
    LubricationScene low, high;
    low.reach = high.reach = near;
    low.low = 0;
    high.high = 0;
    const Lubrication above(s.particles, eta, overSurfaces(), low, "model"),
        below(s.particles, eta, overSurfaces(), high, "model");
    Lubrication::Single ofAbove, ofBelow, root, ownAbove, ownBelow;
    above.ofSphere(0, 1.4, ofAbove, root, ownAbove);
    below.ofSphere(0, -1.4, ofBelow, root, ownBelow);
    Eigen::VectorXd P(6);
    P << 1, 1, -1, -1, -1, 1;
    const auto reflected = [&](const Lubrication::Single& block) -> MatrixXd {
        return P.asDiagonal() * block.whole(Vector3d::UnitZ()) * P.asDiagonal();
    };
    EXPECT_LT((reflected(ofAbove) - ofBelow.whole(Vector3d::UnitZ())).norm(), 1e-12);
    EXPECT_LT((reflected(ownAbove) - ownBelow.whole(Vector3d::UnitZ())).norm(), 1e-12);
    EXPECT_GT(abs(ofAbove.across(0, 1)), 1e-3);
}

TEST(Lubrication, PartsAreSquaresOfTheirRoots) {
    const Spheres s = threeAtWall();
    const LubricatedMobility model = s.aboveWall();
    vector<Lubrication::NearPair> pairs;
    model.getLubrication().findPairs(s.placement, pairs);
    EXPECT_EQ(pairs.size(), 3u);  // the free particle has none
    const MatrixXd ofModel = frictionOf(model.getModel(), s.placement);
    MatrixXd sum = frictionOf(model, s.placement) - ofModel;
    for (const Lubrication::NearPair& pair : pairs) {
        Lubrication::Pair delta, root;
        model.getLubrication().ofPair(pair, delta, root);
        const MatrixXd whole = root.whole(pair.axis);
        EXPECT_LT((whole * whole.transpose() - delta.whole(pair.axis)).norm(),
                  1e-11 * whole.norm());
        const int rows[2] = {s.particles.firstRow[pair.i], s.particles.firstRow[pair.j]};
        Lubrication::Pair minus = delta;
        minus *= -1;
        minus.addTo(pair.axis, rows, sum);
    }
    for (int i : {0, 1, 3}) {
        Lubrication::Single delta, root, own;
        model.getLubrication().ofSphere(i, s.placement.positions[i][2], delta, root, own);
        const MatrixXd whole = root.whole(Vector3d::UnitZ());
        EXPECT_LT((whole * whole.transpose() - delta.whole(Vector3d::UnitZ())).norm(),
                  1e-11 * whole.norm());
        const int rows[1] = {s.particles.firstRow[i]};
        delta *= -1;
        delta.addTo(Vector3d::UnitZ(), rows, sum);
    }
    EXPECT_LT(sum.norm(), 1e-10 * ofModel.norm());
    // The same in products.
    const auto at = model.at(s.placement);
    const MatrixXd one = MatrixXd::Identity(ofModel.rows(), ofModel.rows());
    MatrixXd delta = MatrixXd::Zero(ofModel.rows(), ofModel.rows());
    at->parts()->addNear(one, 2, delta);
    EXPECT_LT((ofModel + 0.5 * delta - frictionOf(model, s.placement)).norm(),
              1e-12 * ofModel.norm());
}

/** In boxes of any shape, the pairs are those that a search over all spheres and images finds. */
TEST(Lubrication, FindsAllPairs) {
    mt19937 random(9);
    uniform_real_distribution<double> u(0, 1);
    const BoxVectors box = {Vec3(11, 0, 0), Vec3(-4, 9, 0), Vec3(3, 2, 12)};
    for (int numPeriods : {0, 2, 3}) {
        Spheres s;
        s.placement.box = box;
        for (int i = 0; i < 150; i++)
            s.add(i % 7 == 0 ? 1.2 : 0.4,
                  Vector3d(40 * u(random) - 20, 30 * u(random),
                           numPeriods == 3 ? 50 * u(random) - 9 : 9 * u(random)));
        LubricationScene scene;
        scene.reach = near;
        scene.numPeriods = numPeriods;
        const Lubrication lubrication(s.particles, eta, overSurfaces(), scene, "model");
        vector<Lubrication::NearPair> pairs;
        lubrication.findPairs(s.placement, pairs);
        size_t expected = 0;
        const int images[3] = {numPeriods > 0 ? 9 : 0, numPeriods > 1 ? 9 : 0,
                               numPeriods > 2 ? 9 : 0};
        for (int j = 0; j < s.particles.size(); j++)
            for (int i = 0; i <= j; i++) {
                const double reach = 2 * (s.particles.radii[i] + s.particles.radii[j]);
                for (int a = -images[0]; a <= images[0]; a++)
                    for (int b = -images[1]; b <= images[1]; b++)
                        for (int c = -images[2]; c <= images[2]; c++) {
                            if (i == j && (a < 0 || (a == 0 && (b < 0 || (b == 0 && c <= 0)))))
                                continue;
                            const Vec3 d = s.placement.positions[j] - s.placement.positions[i] +
                                           box[0] * a + box[1] * b + box[2] * c;
                            expected += d.dot(d) <= reach * reach;
                        }
            }
        EXPECT_EQ(pairs.size(), expected) << numPeriods;
        EXPECT_GT(expected, 10u);
        for (const Lubrication::NearPair& pair : pairs) {
            Vec3 d = s.placement.positions[pair.j] - s.placement.positions[pair.i];
            for (int k = 0; k < 3; k++) d += box[k] * pair.image[k];
            for (int k = 0; k < 3; k++) EXPECT_NEAR(pair.distance * pair.axis[k], d[k], 1e-12);
        }
    }
}

TEST(Lubrication, FallsSmoothlyToNothing) {
    const LubricationReach reach = {3, 4};
    EXPECT_EQ(reach.weight(2.99), 1);
    EXPECT_EQ(reach.weight(4.01), 0);
    EXPECT_DOUBLE_EQ(reach.weight(3.5), 0.5);
    Spheres s;
    s.add(1, {0, 0, 0});
    s.add(0.5, {0, 0, 1.5 * 3.5 / 2});
    const MatrixXd without = frictionOf(RotnePragerYamakawa(s.particles, eta), s.placement),
                   whole = frictionOf(s.unbounded(), s.placement);
    // Distances are in mean radii, 0.75 here.
    s.placement.positions[1] = Vec3(0, 0, 0.75 * 3.5);
    const MatrixXd rpy = frictionOf(RotnePragerYamakawa(s.particles, eta), s.placement),
                   all = frictionOf(s.unbounded(), s.placement),
                   half = frictionOf(s.unbounded(near), s.placement);
    EXPECT_LT((half - 0.5 * (rpy + all)).norm(), 1e-12 * all.norm());
    EXPECT_GT((whole - without).norm(), 1e-5 * without.norm());
}

TEST(Lubrication, ProductsAreThoseOfMatrices) {
    checkProducts(threeAtWall().aboveWall(), threeAtWall().placement);
    checkProducts(threeAtWall().unbounded(), threeAtWall().placement);
    const Spheres many = suspension(32, 0.4, 1e-3, 1);
    checkProducts(many.inBox(), many.placement);
    checkProducts(many.inBox(true), many.placement);
    // A box so small that spheres feel their own images, and triclinic.
    Spheres few;
    few.add(0.9, {0, 0, 0});
    few.add(0.4, {1.3, 0.9, 0.6});
    few.placement.box = {Vec3(2.3, 0, 0), Vec3(0.4, 2.5, 0), Vec3(-0.3, 0.2, 2.8)};
    checkProducts(few.inBox(), few.placement);
}

/** The table of simple cubic arrays in the pages of the models. */
TEST(Lubrication, CubicArraysHaveTheValuesOfThePrototype) {
    const double values[][5] = {// volume fraction, K and KR (reach 8, 10), K and KR (3, 4)
                                {0.064, 2.80599, 1.07392, 2.77814, 1.06838},
                                {0.216, 6.38665, 1.36347, 6.29927, 1.34581},
                                {0.45, 10.1934, 2.70451, 10.0339, 2.67820}};
    for (const auto& row : values) {
        Spheres s;
        s.add(1, {0.1, 0.2, 0.3});
        const double edge = cbrt(4 * M_PI / 3 / row[0]);
        s.placement.box = {Vec3(edge, 0, 0), Vec3(0, edge, 0), Vec3(0, 0, edge)};
        const MatrixXd far = denseOf(s.inBox(false, {8, 10}), s.placement),
                       close = denseOf(s.inBox(), s.placement);
        const double drag = 1 / (6 * M_PI * eta), spin = 1 / (8 * M_PI * eta);
        EXPECT_NEAR(drag / far(0, 0), row[1], 2e-5 * row[1]);
        EXPECT_NEAR(spin / far(3, 3), row[2], 2e-5 * row[2]);
        EXPECT_NEAR(drag / close(0, 0), row[3], 2e-5 * row[3]);
        EXPECT_NEAR(spin / close(3, 3), row[4], 2e-5 * row[4]);
    }
}

/** The random numbers of a pair depend neither on other spheres nor on the order of the two. */
TEST(Lubrication, NoiseOfAPairIsItsOwn) {
    Spheres two;
    two.add(1, {0, 0, 0});
    two.add(1.2, {2.3, 0, 0});
    Spheres three = two;
    three.add(0.7, {10, 0, 0});
    NoiseStream noise;
    noise.step = 5;
    const auto noiseOf = [&](const Spheres& s, int step = 5) {
        noise.step = step;
        const LubricatedMobility model = s.unbounded(near);
        MatrixXd forces = MatrixXd::Zero(s.particles.numRows, 1);
        model.at(s.placement)->parts()->addNearNoise(noise, NoiseStream::ParticleFirstDraw, forces);
        return forces;
    };
    EXPECT_EQ(noiseOf(two), noiseOf(three).topRows(12));
    EXPECT_EQ(noiseOf(three).bottomRows(6).norm(), 0);
    EXPECT_NE(noiseOf(two), noiseOf(two, 6));
    // Its covariance is Delta.
    const LubricatedMobility model = two.unbounded(near);
    const MatrixXd delta = frictionOf(model, two.placement) -
                           frictionOf(model.getModel(), two.placement),
                   root = Eigen::SelfAdjointEigenSolver<MatrixXd>(frictionOf(model, two.placement))
                              .operatorInverseSqrt();
    MatrixXd sum = MatrixXd::Zero(12, 12);
    const int samples = 20000;
    for (int k = 0; k < samples; k++) {
        const MatrixXd forces = root * noiseOf(two, k);
        sum += forces * forces.transpose() / samples;
    }
    EXPECT_LT((sum - root * delta * root).cwiseAbs().maxCoeff(), 5 * sqrt(2.0 / samples));
}

/** At most twice the iterations of SHEAR.md's table, in which matrices were the reference. */
TEST(Lubrication, IterationsAreFew) {
    const struct {
        double fraction;
        int to1e3, to1e6;
    } table[] = {{0.3, 14, 23}, {0.45, 19, 34}};
    for (const auto& row : table) {
        const Spheres s = suspension(108, row.fraction, 1e-3, 7);
        const LubricatedMobility model = s.inBox();
        const auto at = model.at(s.placement);
        const MatrixXd F = randomVectors(s.particles.numRows, 1, 2);
        MatrixXd U;
        at->multiply(F, U, {1e-3});
        const int first = at->parts()->getNumIterations();
        at->multiply(F, U, {1e-6});
        const int second = at->parts()->getNumIterations() - first;
        EXPECT_LE(first, 2 * row.to1e3) << row.fraction;
        EXPECT_LE(second, 2 * row.to1e6) << row.fraction;
    }
    // A monolayer above a wall.
    mt19937 random(3);
    uniform_real_distribution<double> u(0, 1);
    Spheres s;
    const double edge = sqrt(120 * M_PI / 0.4);
    while (s.particles.size() < 120) {
        const Vector3d x(edge * u(random), edge * u(random), 1 + pow(10, -3 + 2.5 * u(random)));
        bool isFree = true;
        for (const Vec3& other : s.placement.positions)
            isFree = isFree && (Vector3d(other[0], other[1], other[2]) - x).norm() > 2.001;
        if (isFree) s.add(1, x);
    }
    const auto at = s.aboveWall(near);
    const auto place = at.at(s.placement);
    const MatrixXd F = randomVectors(s.particles.numRows, 1, 2);
    MatrixXd U;
    place->multiply(F, U, {1e-3});
    const int first = place->parts()->getNumIterations();
    place->multiply(F, U, {1e-6});
    const int second = place->parts()->getNumIterations() - first;
    EXPECT_LE(first, 2 * 7);
    EXPECT_LE(second, 2 * 13);
}

TEST(Lubrication, RefusesWhatHasNone) {
    Spheres s;
    s.add(1, {0, 0, 1.2});
    s.add(0.5, {1.4, 0, 1.2});
    expectError(
        [&] { s.unbounded().at(s.placement); },
        {"RotnePragerYamakawa with lubrication", "particle 1 (body 0)", "particle 3 (body 1)",
         "overlap or touch", "1.4", "1.5", "setMinimumGap()", "setLubrication(Off)"});
    EXPECT_EQ(s.unbounded(everywhere, 0.01).objection(s.placement), "");
    s.placement.positions[1] = s.placement.positions[0];
    expectError([&] { s.unbounded(everywhere, 0.01).at(s.placement); },
                {"are at the same place", "move one of them"});
    s.placement.positions[1] = Vec3(3, 0, 0.5);
    expectError([&] { s.aboveWall().at(s.placement); },
                {"particle 3 (body 1) of radius 0.5 nm touches the wall at z = 0 nm",
                 "setLubrication(Off)"});
    s.placement.positions[1] = Vec3(3, 0, 1.5);
    EXPECT_EQ(s.aboveWall().objection(s.placement), "");
    Spheres unequal;
    unequal.add(1, {0, 0, 0});
    unequal.add(0.09, {3, 0, 0});
    expectError([&] { unequal.unbounded(); },
                {"the radii 1 nm of particle 1 (body 0)", "0.09 nm of particle 3 (body 1)",
                 "have the ratio 11.1", "lubrication is known up to a ratio of 10",
                 "turn it off by setLubrication(Off), or make the larger sphere of several blobs"});
}

/**
 * Overlaps count as the minimum gap, but only in the contribution of lubrication, not in the model.
 */
TEST(Lubrication, MinimumGapsAreOfWhatIsAdded) {
    Spheres s;
    s.add(1, {0, 0, 0});
    s.add(1, {1.9, 0, 0});
    Spheres apart = s;
    apart.placement.positions[1] = Vec3(2.02, 0, 0);
    const RotnePragerYamakawa rpy(s.particles, eta);
    const MatrixXd added = frictionOf(s.unbounded(everywhere, 0.02), s.placement) -
                           frictionOf(rpy, s.placement),
                   expected = frictionOf(apart.unbounded(), apart.placement) -
                              frictionOf(rpy, apart.placement);
    EXPECT_LT((added - expected).norm(), 1e-10 * expected.norm());
}

TEST(Lubrication, SettingsAreChecked) {
    MobilityForce force;
    EXPECT_EQ(force.getLubrication(), MobilityForce::AutoLubrication);
    force.setLubrication(true);
    EXPECT_EQ(force.getLubrication(), MobilityForce::On);
    force.setLubrication(MobilityForce::Auto);
    EXPECT_EQ(force.getLubrication(), MobilityForce::AutoLubrication);
    force.setLubrication(MobilityForce::Off);
    expectError([&] { force.setLubrication(static_cast<MobilityForce::Lubrication>(3)); },
                {"setLubrication(): the number 3 stands for no setting; it must be one of Auto, "
                 "On, Off: use the "
                 "class constants"});
    expectError([&] { force.setLubrication(MobilityForce::Dense); },
                {"setLubrication()", "got the number 1 of a solver", "use setSolver()"});
    expectError([&] { force.setLubricationReach(1.9, 3); },
                {"setLubricationReach()", "whole up to 1.9 and nothing from 3 mean radii on",
                 "at least 2, which is contact", "0, 0 for those of the model"});
    for (const auto& [least, most] :
         vector<pair<double, double>>{{3, 3}, {0, 4}, {3, INFINITY}, {NAN, 4}, {-3, -2}})
        expectError([&] { force.setLubricationReach(least, most); },
                    {"setLubricationReach()", "which is contact", "mean radii"});
    EXPECT_EQ(force.getLubrication(), MobilityForce::Off);
    double whole, nothing;
    force.getLubricationReach(whole, nothing);
    EXPECT_EQ(whole, 0);
    EXPECT_EQ(nothing, 0);
}

TEST(Gmres, SolvesAnyMatrixAndBeginsAnew) {
    const int n = 40;
    const MatrixXd A = MatrixXd::Identity(n, n) + 0.1 * randomVectors(n, n, 1),
                   b = randomVectors(n, 3, 2);
    for (int most : {100, 12}) {
        Gmres gmres(most);
        MatrixXd x, b0 = b;
        b0.col(1).setZero();
        gmres.solve([&](const MatrixXd& in, MatrixXd& out) { out = A * in; }, b0, 1e-10, x);
        EXPECT_EQ(x.col(1).norm(), 0);
        EXPECT_LT((A * x - b0).norm(), 3e-10 * x.norm());
        EXPECT_LE(gmres.getNumOfSlowest(), most == 100 ? n : 200);
        EXPECT_GE(gmres.getNumIterations(), gmres.getNumOfSlowest());
    }
    MatrixXd x;
    expectError(
        [&] {
            Gmres(100, 5).solve([&](const MatrixXd& in, MatrixXd& out) { out = A * in; }, b, 1e-10,
                                x);
        },
        {"did not converge", "after 5", "1e-10", "setSolver(Dense)"});
}

TEST(Gmres, BoundsErrorsWhereSingularValuesAreSmall) {
    // The residual alone leaves an error of the size of the solution. A norm smaller than the
    // 2-norm demands more.
    const int n = 60;
    const MatrixXd basis = Eigen::HouseholderQR<MatrixXd>(randomVectors(n, n, 1)).householderQ();
    const VectorXd values =
        VectorXd::LinSpaced(n, -4, 0).unaryExpr([](double power) { return pow(10, power); });
    const MatrixXd A = basis * values.asDiagonal() * basis.transpose(),
                   exact = basis * VectorXd::Ones(n), b = A * exact;
    const auto product = [&](const MatrixXd& x, MatrixXd& y) { y = A * x; };
    const double tolerance = 1e-3;
    MatrixXd x;
    Gmres().solve(product, b, tolerance, x);
    EXPECT_GT((x - exact).norm(), 0.2 * exact.norm());
    for (int most : {100, 20})
        for (double smaller : {1.0, 1e-3}) {
            Gmres gmres(most, 100000);
            const Gmres::ErrorBound bound = {tolerance,
                                             [&](const MatrixXd& y) { return smaller * y.norm(); }};
            gmres.solve(product, b, tolerance, x, &bound);
            EXPECT_LT((x - exact).norm(), 3 * tolerance * smaller * exact.norm());
        }
    const Gmres::ErrorBound bound = {tolerance, [](const MatrixXd& y) { return y.norm(); }};
    expectError([&] { Gmres(100, 5).solve(product, b, 0.5, x, &bound); },
                {"after 5", "the bound of the error is", "not below the tolerance 0.001"});
    // A bound that rounding does not allow.
    const Gmres::ErrorBound tiny = {1e-30, [](const MatrixXd& y) { return y.norm(); }};
    Gmres().solve(product, b, tolerance, x, &tiny);
    EXPECT_LT((x - exact).norm(), 1e-7);
}

TEST(BlockIncompleteCholesky, IsWholeWhereNothingIsFilledIn) {
    // A chain of blocks has no fill.
    const int blocks = 5;
    BlockIncompleteCholesky factor;
    MatrixXd A = MatrixXd::Zero(6 * blocks, 6 * blocks);
    factor.setZero(blocks);
    const MatrixXd random = 0.2 * randomVectors(6, 6 * blocks, 4);
    for (int i = 0; i < blocks; i++) {
        const MatrixXd own = random.middleCols<6>(6 * i), diagonal = own * own.transpose();
        A.block<6, 6>(6 * i, 6 * i) = diagonal + 3 * MatrixXd::Identity(6, 6);
        factor.add(i, i, diagonal);
        factor.add(i, i, 3 * MatrixXd::Identity(6, 6));
        if (i == 0) continue;
        A.block<6, 6>(6 * i, 6 * i - 6) = own;
        A.block<6, 6>(6 * i - 6, 6 * i) = own.transpose();
        factor.add(i, i - 1, own);
    }
    EXPECT_EQ(factor.factorise(), 0);
    EXPECT_EQ(factor.getNumBlocks(), 2 * blocks - 1);
    MatrixXd x = randomVectors(6 * blocks, 2, 5), b = x;
    factor.solveL(x);
    factor.solveLTransposed(x);
    EXPECT_LT((A * x - b).norm(), 1e-12 * b.norm());
}

TEST(BlockIncompleteCholesky, FollowsLinksInAnyOrder) {
    // A full matrix has no fill in any order; these links make it 2, 0, 1.
    const int blocks = 3;
    BlockIncompleteCholesky factor;
    factor.setZero(blocks);
    factor.link(0, 2);
    const MatrixXd random = randomVectors(6 * blocks, 6 * blocks, 6),
                   A = random * random.transpose() + MatrixXd::Identity(6 * blocks, 6 * blocks);
    for (int i = 0; i < blocks; i++)
        for (int j = 0; j <= i; j++) factor.add(i, j, A.block<6, 6>(6 * i, 6 * j));
    EXPECT_EQ(factor.factorise(), 0);
    MatrixXd x = randomVectors(6 * blocks, 2, 7), b = x;
    factor.solveL(x);
    factor.solveLTransposed(x);
    EXPECT_LT((A * x - b).norm(), 1e-10 * b.norm());
}

TEST(BlockIncompleteCholesky, ShiftsWhatIsNotPositive) {
    BlockIncompleteCholesky factor;
    factor.setZero(2);
    factor.add(0, 0, MatrixXd::Identity(6, 6));
    factor.add(1, 1, MatrixXd::Identity(6, 6));
    factor.add(1, 0, 1.1 * MatrixXd::Identity(6, 6));
    const double shift = factor.factorise();
    EXPECT_GT(shift, 0.1);
    EXPECT_LT(shift, 0.3);
    factor.setZero(1);
    expectError([&] { factor.factorise(); }, {"not positive definite", "not finite"});
}
