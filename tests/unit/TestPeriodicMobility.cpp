// Lattice sums agree with sums by their definition, with closed forms, and with published numbers
// of cubic arrays.

#include <Eigen/Dense>
#include <Eigen/Geometry>
#include <complex>

#include "TestSupport.h"
#include "linearalgebra/Decompositions.h"
#include "mobility/StressletBasis.h"
#include "mobility/models/periodic/PeriodicMobility.h"
#include "mobility/models/periodic/PeriodicStokesianDynamics.h"
#include "mobility/models/rotneprager/RotnePragerYamakawa.h"

using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace OpenMM;
using namespace std;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

namespace {

HydrodynamicParticles particlesOf(const vector<double>& radii, bool torque = true) {
    HydrodynamicParticles particles;
    for (size_t i = 0; i < radii.size(); i++) particles.add(radii[i], torque, i, i);
    return particles;
}

BoxVectors cube(double L) { return {Vec3(L, 0, 0), Vec3(0, L, 0), Vec3(0, 0, L)}; }

MatrixXd sum(const vector<double>& radii, const vector<Vec3>& x, const BoxVectors& box,
             const Spreading& spreading, bool stresslets = false, double xi = 0) {
    LatticeSum lattice(particlesOf(radii), spreading, stresslets);
    lattice.setSplitting(xi);
    lattice.setBox(box);
    MatrixXd M;
    lattice.compute(x, stresslets, M);
    return M / (8 * M_PI);
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

/** Boxes of all kinds, of about the same volume. */
const vector<BoxVectors> boxes = {
    cube(7.3),
    {Vec3(9, 0, 0), Vec3(0, 6.1, 0), Vec3(0, 0, 7)},
    {Vec3(7, 0, 0), Vec3(3.4, 6.5, 0), Vec3(-3.1, 2.9, 7.2)},
    {Vec3(3, 0, 0), Vec3(0, 4, 0), Vec3(0, 0, 30)},
};
const vector<double> radii = {1, 0.55, 0.8, 0.1};
/** The second and third overlap; the first overlaps an image of the last. */
const vector<Vec3> places = {Vec3(0.41, 6.9, 1.2), Vec3(2.15, 0.35, 8.9), Vec3(2.3, 0.9, 9.4),
                             Vec3(0.7, 6.2, 1.5)};

/** Force coupling by its definition, as a complex sum over all waves, both k and -k. */
MatrixXd byDefinition(const vector<double>& radii, const vector<Vec3>& x, const BoxVectors& box,
                      double largestWave) {
    using Complex = complex<double>;
    Matrix3d A;
    for (int k = 0; k < 3; k++) A.col(k) = Vector3d(box[k][0], box[k][1], box[k][2]);
    const Matrix3d B = 2 * M_PI * A.inverse().transpose();
    const double volume = abs(A.determinant());
    const int n = radii.size();
    MatrixXd M = MatrixXd::Zero(6 * n, 6 * n);
    int counts[3];
    for (int d = 0; d < 3; d++) counts[d] = int(largestWave * A.col(d).norm() / (2 * M_PI)) + 1;
    for (int i0 = -counts[0]; i0 <= counts[0]; i0++)
        for (int i1 = -counts[1]; i1 <= counts[1]; i1++)
            for (int i2 = -counts[2]; i2 <= counts[2]; i2++) {
                const Vector3d k = B * Vector3d(i0, i1, i2);
                const double k2 = k.squaredNorm();
                if (k2 == 0 || k2 > largestWave * largestWave) continue;
                Matrix3d turn;
                turn << 0, -k[2], k[1], k[2], 0, -k[0], -k[1], k[0], 0;
                Eigen::MatrixXcd D(3, 6 * n);
                for (int i = 0; i < n; i++) {
                    const double s = exp(-radii[i] * radii[i] / M_PI * k2 / 2),
                                 t = exp(-pow(radii[i] / cbrt(6 * sqrt(M_PI)), 2) * k2 / 2);
                    const Complex phase =
                        exp(Complex(0, -k.dot(Vector3d(x[i][0], x[i][1], x[i][2]))));
                    D.middleCols<3>(6 * i) = phase * s * Matrix3d::Identity();
                    D.middleCols<3>(6 * i + 3) = phase * Complex(0, 0.5) * t * turn;
                }
                const Matrix3d green =
                    (Matrix3d::Identity() - k * k.transpose() / k2) / (k2 * volume);
                M += (D.adjoint() * green * D).real();
            }
    return M;
}

/** The friction of one sphere of radius 1 in a simple cubic array of this volume fraction, divided
 * by that of a sphere alone: K for translation, KR for rotation. */
pair<double, double> arrayFriction(MobilityModel& model, double fraction) {
    MatrixXd friction;
    model.at({{Vec3(0.3, 0.1, -5)}, cube(cbrt(4 * M_PI / 3 / fraction))})->friction(friction);
    return {friction(1, 1) / (6 * M_PI), friction(4, 4) / (8 * M_PI)};
}

}  // namespace

TEST(LatticeSum, ForceCouplingIsItsDefinition) {
    const vector<double> some = {1, 0.7, 0.8};
    const vector<Vec3> x(places.begin(), places.begin() + 3);
    for (const BoxVectors& box : boxes)
        EXPECT_LT(
            scaledDifference(sum(some, x, box, overGaussians()), byDefinition(some, x, box, 24)),
            1e-13);
}

TEST(LatticeSum, DoesNotDependOnTheSplitting) {
    for (const BoxVectors& box : boxes)
        for (int kind = 0; kind < 3; kind++) {
            const Spreading& spreading = kind == 1 ? overGaussians() : overSurfaces();
            // Sums with stresslets are tested for spheres that do not overlap only.
            const vector<Vec3> x = kind == 2 ? vector<Vec3>{Vec3(0.4, 1, 3), Vec3(1.8, 2.5, 6),
                                                            Vec3(2, 3.1, 1), Vec3(1, 3.1, 4.4)}
                                             : places;
            const MatrixXd M = sum(radii, x, box, spreading, kind == 2);
            for (double xi : {0.35, 0.9, 1.7})
                EXPECT_LT(scaledDifference(sum(radii, x, box, spreading, kind == 2, xi), M), 1e-13)
                    << kind << " " << xi;
            if (kind < 2) {
                EXPECT_GT(leastEigenvalue(M), 0.01);
            }
            EXPECT_EQ((M - M.transpose()).norm(), 0);
        }
}

TEST(LatticeSum, OneSphereInACubeIsTheClosedForm) {
    // The linear term has Hasimoto's constant. The cubic terms are exact, for RotnePragerYamakawa
    // as long as the sphere does not overlap its image.
    const double hasimoto = 2.837297479480619;
    for (double x : {0.499, 0.3, 0.1, 1e-2, 1e-4, 1e-8}) {
        const BoxVectors box = cube(1 / x);
        const MatrixXd surfaces = sum({1}, {Vec3(3, 1, 2)}, box, overSurfaces()) * 6 * M_PI,
                       gaussians = sum({1}, {Vec3(3, 1, 2)}, box, overGaussians()) * 6 * M_PI;
        for (int k = 0; k < 3; k++) {
            EXPECT_NEAR(surfaces(k, k), 1 - hasimoto * x + 4 * M_PI / 3 * x * x * x, 2e-14) << x;
            // The images of a rotating sphere make a uniform counter-rotation, which leaves 1 -
            // volume fraction.
            EXPECT_NEAR(surfaces(3 + k, 3 + k) * 4 / 3, 1 - 4 * M_PI / 3 * x * x * x, 2e-14) << x;
            // The overlap of Gaussians with their images adds exp(-L^2/4 sigma^2).
            EXPECT_NEAR(gaussians(k, k), 1 - hasimoto * x + 4 * x * x * x,
                        2e-14 + 20 * exp(-M_PI / (4 * x * x)))
                << x;
        }
        EXPECT_LT((surfaces - MatrixXd(surfaces.diagonal().asDiagonal())).norm(), 1e-14);
    }
}

TEST(LatticeSum, LargeBoxesAreUnboundedFluid) {
    const double L = 1e6, hasimoto = 2.837297479480619;
    MatrixXd free;
    PeriodicRotnePragerYamakawa model(particlesOf(radii), 1);
    RotnePragerYamakawa(particlesOf(radii), 1).at({places})->dense(free);
    MatrixXd M;
    model.at({places, cube(L)})->dense(M);
    // All velocities are lower by the same amount, hasimoto/L in units of 1/(6 pi eta). The rest is
    // of order (r/L)^3.
    for (int i = 0; i < 24; i++)
        for (int j = 0; j < 24; j++) {
            const bool translations = i / 3 % 2 == 0 && i % 3 == j % 3 && j / 3 % 2 == 0;
            EXPECT_NEAR(M(i, j), free(i, j) - (translations ? hasimoto / (6 * M_PI * L) : 0),
                        1e-13 * free(i, i))
                << i << " " << j;
        }
}

TEST(LatticeSum, EquivalentLatticeVectorsAreTheSameLattice) {
    const BoxVectors& box = boxes[2];
    const vector<BoxVectors> others = {
        {box[1], box[2], box[0]},
        {box[0], box[1] - box[0], box[2]},
        {box[0] + box[1], box[1], box[2] - box[1] - box[0]},
        {box[0] * -1, box[1] + box[0] * 3, box[2] + box[1] * 2 - box[0] * 5}};
    for (const Spreading* spreading : {&overSurfaces(), &overGaussians()})
        for (const BoxVectors& other : others) {
            EXPECT_LT(scaledDifference(sum(radii, places, other, *spreading),
                                       sum(radii, places, box, *spreading)),
                      1e-13);
        }
    // A box twice as long with two spheres that move alike describes the same array.
    const MatrixXd one = sum({1}, {Vec3()}, boxes[0], overSurfaces());
    const MatrixXd two = sum({1, 1}, {Vec3(), boxes[0][0]},
                             {boxes[0][0] * 2, boxes[0][1], boxes[0][2]}, overSurfaces());
    EXPECT_LT((two.topLeftCorner(6, 6) + two.topRightCorner(6, 6) - one).cwiseAbs().maxCoeff(),
              1e-15);
}

TEST(LatticeSum, PlacesAreThoseOfTheBox) {
    // Lengths are powers of two, so that nothing is rounded when a place is a million boxes away.
    const BoxVectors box = {Vec3(8, 0, 0), Vec3(2, 8, 0), Vec3(-2, 4, 8)};
    vector<Vec3> near, far;
    for (size_t i = 0; i < places.size(); i++) {
        const double exact = 1 << 16;
        const Vec3 x(round(places[i][0] * exact) / exact, round(places[i][1] * exact) / exact,
                     round(places[i][2] * exact) / exact);
        near.push_back(x);
        far.push_back(x + box[0] * (1e6 * i) - box[1] * 123456 + box[2] * (i == 2 ? -1e6 : 4096));
    }
    EXPECT_LT(scaledDifference(sum(radii, far, box, overSurfaces()),
                               sum(radii, near, box, overSurfaces())),
              1e-13);
}

TEST(LatticeSum, BoxesOfAspectTen) {
    const BoxVectors box = {Vec3(2.5, 0, 0), Vec3(0, 25, 0), Vec3(0.5, 0, 2.5)};
    const vector<Vec3> x = {Vec3(0, 0, 0), Vec3(1, 12, 1), Vec3(1, 12.5, 2), Vec3(0.2, 24, 1)};
    const MatrixXd M = sum(radii, x, box, overSurfaces());
    EXPECT_LT(scaledDifference(sum(radii, x, box, overSurfaces(), false, 1.2), M), 1e-13);
    EXPECT_GT(leastEigenvalue(M), 1e-3);
}

TEST(LatticeSum, SmallParticlesInAWideBox) {
    // Distances and radii range from 1e-5 of the box to the whole box.
    vector<double> some;
    vector<Vec3> x;
    mt19937 random(2);
    uniform_real_distribution<double> u(-1, 1);
    for (double size : {1.0, 10.0, 100.0, 1e3, 1e4})
        for (int i = 0; i < 3; i++) {
            some.push_back(0.5 + 0.3 * i);
            x.push_back(Vec3(u(random), u(random), u(random)) * (3 * size) + Vec3(9 * size, 0, 0));
        }
    for (bool stresslets : {false, true}) {
        const MatrixXd M = sum(some, x, cube(1e5), overSurfaces(), stresslets);
        EXPECT_LT(scaledDifference(sum(some, x, cube(1e5), overSurfaces(), stresslets, 5e-5), M),
                  1e-13);
        EXPECT_GT(leastEigenvalue(M), 0.1);
    }
}

TEST(LatticeSum, FieldHasNoDivergence) {
    const double delta = 1e-4;
    for (const Spreading* spreading : {&overSurfaces(), &overGaussians()}) {
        VectorXd divergence = VectorXd::Zero(24);
        for (int j = 0; j < 4; j++)
            for (int d = 0; d < 3; d++) {
                VectorXd column[2];
                for (int sign = 0; sign < 2; sign++) {
                    vector<Vec3> moved = places;
                    moved[j][d] += sign ? delta : -delta;
                    column[sign] = sum(radii, moved, boxes[2], *spreading).col(6 * j + d);
                }
                divergence += (column[1] - column[0]) / (2 * delta);
            }
        // The differences are of second order, and overlapping spheres have kinks in their higher
        // derivatives.
        EXPECT_LT(divergence.cwiseAbs().maxCoeff(), 1e-6);
    }
}

// Values for simple cubic arrays by this library's definitions, from exact sums with forces,
// torques and stresslets (FTS), and the viscosity of FTS.
TEST(PeriodicStokesianDynamics, SimpleCubicArrays) {
    const struct {
        double fraction, K_FTS, K, KR, eta;
    } cases[] = {{0.001, 1.212139, 1.212139, 1.001001, 1.002498},
                 {0.027, 2.004151, 2.004679, 1.027825, 1.066332},
                 {0.064, 2.778145, 2.780656, 1.069171, 1.155111},
                 {0.125, 4.082623, 4.090297, 1.147979, 1.301682},
                 {0.216, 6.252788, 6.270378, 1.301371, 1.535882},
                 {0.343, 9.015767, 9.049385, 1.653346, 1.941957},
                 {0.45, 9.880996, 9.929177, 2.338201, 2.437858}};
    for (const auto& c : cases) {
        PeriodicStokesianDynamics far(particlesOf({1}), 1, false, 0),
            whole(particlesOf({1}), 1, true, 0);
        const auto FTS = arrayFriction(far, c.fraction),
                   lubricated = arrayFriction(whole, c.fraction);
        EXPECT_NEAR(FTS.first, c.K_FTS, 1e-6 * c.K_FTS) << c.fraction;
        EXPECT_NEAR(FTS.second, 1 / (1 - c.fraction), 1e-13) << c.fraction;
        EXPECT_NEAR(lubricated.first, c.K, 1e-6 * c.K) << c.fraction;
        EXPECT_NEAR(lubricated.second, c.KR, 1e-6 * c.KR) << c.fraction;
        // Stresslets are S = M_SS^-1 E, and the stress is 2 eta E + S/V.
        const double L = cbrt(4 * M_PI / 3 / c.fraction);
        const MatrixXd M = sum({1}, {Vec3()}, cube(L), overSurfaces(), true);
        EXPECT_NEAR(1 + 1 / (2 * L * L * L * M(8, 8)), c.eta, 1e-6 * c.eta) << c.fraction;
    }
}

TEST(PeriodicStokesianDynamics, LargeBoxesAreUnboundedFluid) {
    const vector<double> some = {1, 0.5, 0.8};
    const vector<Vec3> x = {Vec3(0.1, -0.2, 0.3), Vec3(1.4, 0.6, 0.5), Vec3(-0.6, 1.6, -0.4)};
    for (bool lubrication : {false, true}) {
        MatrixXd M, free;
        StokesianDynamics(particlesOf(some), 1, lubrication, 0).at({x})->dense(free);
        // The common lag of all velocities affects the friction that lubrication adds.
        const double L = lubrication ? 1e11 : 1e6, lag = 2.837297479480619 / (6 * M_PI * L);
        PeriodicStokesianDynamics model(particlesOf(some), 1, lubrication, 0);
        model.at({x, cube(L)})->dense(M);
        for (int i = 0; i < 18; i += 6)
            for (int j = 0; j < 18; j += 6)
                for (int k = 0; k < 3; k++) free(i + k, j + k) -= lag;
        EXPECT_LT(scaledDifference(M, free), 1e-11) << lubrication;
    }
}

TEST(PeriodicStokesianDynamics, LubricationOfImagesIsThatOfPairs) {
    // Two spheres near each other across a face of the box have the friction of the same pair
    // inside the box. An array has the friction of the same array in a box twice as long.
    const vector<double> some = {1, 0.7};
    MatrixXd across, inside;
    PeriodicStokesianDynamics model(particlesOf(some), 1, true, 0);
    model.at({{Vec3(0.4, 1, 1), Vec3(-1.32, 1, 1)}, cube(6)})->friction(inside);
    model.at({{Vec3(0.4, 1, 1), Vec3(4.68, 13, 1)}, cube(6)})->friction(across);
    EXPECT_LT(scaledDifference(across, inside), 1e-11);
    MatrixXd one, two;
    PeriodicStokesianDynamics(particlesOf({1}), 1, true, 0)
        .at({{Vec3()}, {Vec3(2.01, 0, 0), Vec3(0, 3, 0), Vec3(0, 0, 3.3)}})
        ->friction(one);
    PeriodicStokesianDynamics(particlesOf({1, 1}), 1, true, 0)
        .at({{Vec3(), Vec3(2.01, 0, 0)}, {Vec3(4.02, 0, 0), Vec3(0, 3, 0), Vec3(0, 0, 3.3)}})
        ->friction(two);
    EXPECT_LT((two.topLeftCorner(6, 6) + two.topRightCorner(6, 6) - one).cwiseAbs().maxCoeff(),
              1e-10 * one.maxCoeff());
}

TEST(PeriodicStokesianDynamics, DenseClustersArePositiveDefinite) {
    // Unequal spheres have gaps from 1e-5 on, some across faces of a crowded box. Lubrication only
    // adds friction.
    mt19937 random(7);
    uniform_real_distribution<double> u(-1, 1);
    const BoxVectors box = {Vec3(5, 0, 0), Vec3(1.5, 4.8, 0), Vec3(-1, 2, 4.6)};
    const Lattice lattice(box);
    for (int trial = 0; trial < 10; trial++) {
        const vector<double> some = {1, 1, 0.5, 0.5, 0.5, 0.5, 0.12, 0.12};
        vector<Vec3> x = {Vec3(u(random), u(random), u(random)) * 5};
        while (x.size() < some.size()) {
            const int i = x.size(), next = random() % i;
            const Vec3 v(u(random), u(random), u(random));
            const Vec3 place = x[next] + v * ((some[i] + some[next]) *
                                              (1 + pow(10, -2.5 + 2.5 * u(random))) / norm(v));
            bool fits = true;
            for (int j = 0; j < i; j++)
                fits = fits &&
                       lattice.nearestImage(place - x[j]).norm() > (some[i] + some[j]) * (1 + 5e-6);
            if (fits) x.push_back(place);
        }
        MatrixXd far, whole;
        PeriodicStokesianDynamics(particlesOf(some), 1, false, 0).at({x, box})->friction(far);
        PeriodicStokesianDynamics(particlesOf(some), 1, true, 0).at({x, box})->friction(whole);
        EXPECT_GT(leastEigenvalue(far), 0.01);
        EXPECT_GT(leastEigenvalue(whole), 0);
        EXPECT_EQ((whole - whole.transpose()).norm(), 0);
        const VectorXd d = far.diagonal().cwiseSqrt().cwiseInverse();
        const VectorXd added = Eigen::SelfAdjointEigenSolver<MatrixXd>(
                                   MatrixXd(d.asDiagonal() * (whole - far) * d.asDiagonal()))
                                   .eigenvalues();
        EXPECT_GT(added[0], -1e-8 * added[added.size() - 1]);
    }
}

TEST(PeriodicStokesianDynamics, IsASmoothFunctionOfTheBox) {
    // Lubrication is cut off between 8 and 10 mean radii. At both distances second differences show
    // no kink.
    PeriodicStokesianDynamics model(particlesOf({1}), 1, true, 0);
    for (double L : {8.0, 10.0}) {
        double K[5];
        const double delta = 1e-3;
        for (int i = 0; i < 5; i++)
            K[i] = arrayFriction(model, 4 * M_PI / 3 / pow(L + (i - 2) * delta, 3)).first;
        const double left = K[0] - 2 * K[1] + K[2], right = K[2] - 2 * K[3] + K[4];
        EXPECT_NEAR(left / (delta * delta), right / (delta * delta),
                    1e-5 + 0.2 * abs(left + right) / (delta * delta))
            << L;
    }
}

TEST(PeriodicStokesianDynamics, RefusesSpheresThatTouchImages) {
    PeriodicStokesianDynamics model(particlesOf({1, 0.5}), 1, true, 0);
    const vector<Vec3> apart = {Vec3(), Vec3(2, 0, 0)};
    EXPECT_EQ(model.objection({apart, cube(4)}), "");
    expectError(
        [&] {
            model.at({apart, cube(3.4)});
        },
        {"StokesianDynamics: particle 0 (body 0) and an image of particle 1 (body 1) overlap or "
         "touch: their distance "
         "is 1.4"});
    expectError(
        [&] {
            model.at({apart, {Vec3(2, 0, 0), Vec3(0, 9, 0), Vec3(0, 0, 9)}});
        },
        {"particle 0 (body 0) and the nearest image of particle 0 (body 0) overlap or touch: their "
         "distance is 2 nm"});
    // With a smallest gap spheres may overlap.
    PeriodicStokesianDynamics bridged(particlesOf({1, 0.5}), 1, true, 1e-3);
    MatrixXd friction;
    bridged.at({apart, cube(3.4)})->friction(friction);
    EXPECT_GT(leastEigenvalue(friction), 0);
}

TEST(PeriodicModels, ImagesAtOnePlaceAreRefused) {
    for (bool surfaces : {true, false}) {
        unique_ptr<MobilityModel> model(
            surfaces ? (MobilityModel*)new PeriodicRotnePragerYamakawa(particlesOf({1, 1}), 1)
                     : new PeriodicForceCoupling(particlesOf({1, 1}), 1));
        expectError(
            [&] {
                model->at({{Vec3(0.5, 1, 2), Vec3(8.5, -7, 2)}, cube(8)});
            },
            {"particle 0 (body 0) and particle 1 (body 1), both of radius 1 nm",
             "are at the same place of the periodic box"});
    }
}

TEST(PeriodicModels, NeedABox) {
    PeriodicRotnePragerYamakawa model(particlesOf({1}), 1);
    expectError([&] { model.at({{Vec3()}}); },
                {"boundary Periodic needs a periodic box, but its vectors span a volume of 0"});
}

TEST(PeriodicModels, TooManyRowsAreRefusedBeforeAnythingIsAllocated) {
    expectError([] { PeriodicRotnePragerYamakawa(particlesOf(vector<double>(2001, 1)), 1); },
                {"dense matrices of at most 12000 rows", "12006", "or the grid, by setSolver("});
    expectError([] { PeriodicForceCoupling(particlesOf(vector<double>(4001, 1), false), 1); },
                {"12003"});
    expectError(
        [] { PeriodicStokesianDynamics(particlesOf(vector<double>(1001, 1)), 1, true, 0); },
        {"dense matrices of at most 11000 rows", "11011", "or the grid, by setSolver(MatrixFree)"});
}
