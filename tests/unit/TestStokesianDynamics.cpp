// Stokesian dynamics of spheres in unbounded fluid has the exact friction of one sphere and of an
// isolated pair, and far fields of known accuracy.

#include <Eigen/Dense>
#include <Eigen/Geometry>

#include "ReferenceScenes.h"
#include "ShearedScenes.h"
#include "TestSupport.h"
#include "linearalgebra/Decompositions.h"
#include "mobility/StressletBasis.h"
#include "mobility/models/periodic/Lattice.h"
#include "mobility/models/periodic/PeriodicStokesianDynamics.h"
#include "mobility/models/stokesian/ForceTorqueStresslet.h"
#include "mobility/models/stokesian/StokesianDynamics.h"

using namespace OpenMM;
using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace std;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

namespace {

HydrodynamicParticles spheres(const vector<double>& radii) {
    HydrodynamicParticles particles;
    for (size_t i = 0; i < radii.size(); i++) particles.add(radii[i], true, 100 + i, i);
    return particles;
}

MatrixXd frictionOf(const vector<double>& radii, const vector<Vec3>& positions,
                    bool lubrication = true, double minimumGap = 0, double viscosity = 1) {
    StokesianDynamics model(spheres(radii), viscosity, lubrication, minimumGap);
    MatrixXd friction;
    model.at({positions})->friction(friction);
    return friction;
}

/** Forces and torques in units of each sphere's own friction coefficients, so that eigenvalues of
 * different kinds can be compared. */
MatrixXd scaled(const MatrixXd& friction, const vector<double>& radii) {
    VectorXd scale(friction.rows());
    for (size_t i = 0; i < radii.size(); i++) {
        scale.segment<3>(6 * i).setConstant(1 / sqrt(6 * M_PI * radii[i]));
        scale.segment<3>(6 * i + 3).setConstant(1 / sqrt(8 * M_PI * pow(radii[i], 3)));
    }
    return scale.asDiagonal() * friction * scale.asDiagonal();
}

VectorXd eigenvalues(const MatrixXd& m) {
    return Eigen::SelfAdjointEigenSolver<MatrixXd>(m, Eigen::EigenvaluesOnly).eigenvalues();
}

Vec3 randomDirection(mt19937& generator) {
    normal_distribution<double> normal;
    const Vec3 v(normal(generator), normal(generator), normal(generator));
    return v / norm(v);
}

/** Spheres that are added one by one at a given gap from an earlier one, without any overlap. */
vector<Vec3> cluster(const vector<double>& radii, const vector<double>& gaps, mt19937& generator) {
    vector<Vec3> positions = {Vec3()};
    while (positions.size() < radii.size()) {
        const int i = positions.size(), next = generator() % i;
        const double gap = gaps[generator() % gaps.size()];
        const Vec3 trial = positions[next] +
                           randomDirection(generator) * ((radii[i] + radii[next]) * (1 + gap / 2));
        bool free = true;
        for (int j = 0; j < i; j++)
            free = free &&
                   (j == next || norm(trial - positions[j]) > (radii[i] + radii[j]) * (1 + 5e-7));
        if (free) positions.push_back(trial);
    }
    return positions;
}

const vector<double> threeRadii = {1, 0.5, 0.8};
const vector<Vec3> threePositions = {Vec3(0.1, -0.2, 0.3), Vec3(1.4, 0.6, 0.5),
                                     Vec3(-0.6, 1.6, -0.4)};

}  // namespace

TEST(StokesianDynamics, SingleSphere) {
    for (bool lubrication : {true, false}) {
        StokesianDynamics model(spheres({0.7}), 1.3, lubrication, 0);
        EXPECT_EQ(model.getTraits().isMadeFromFriction, lubrication);
        const auto at = model.at({{Vec3(1, 2, 3)}});
        MatrixXd friction, mobility;
        at->friction(friction);
        at->dense(mobility);
        VectorXd expected(6);
        expected << VectorXd::Constant(3, 6 * M_PI * 1.3 * 0.7),
            VectorXd::Constant(3, 8 * M_PI * 1.3 * pow(0.7, 3));
        EXPECT_LT((friction - MatrixXd(expected.asDiagonal())).cwiseAbs().maxCoeff(), 1e-13);
        EXPECT_LT((friction * mobility - MatrixXd::Identity(6, 6)).cwiseAbs().maxCoeff(), 1e-14);
    }
}

TEST(StokesianDynamics, TwoSedimentingSpheres) {
    // The exact values are those of Davidchack et al. 2017, Table S1, by collocation (1e-10). The
    // error of FTS without lubrication is known too.
    struct Case {
        double l, force, omega, ftsForceError, ftsOmegaError, tolerance;
    };
    for (const Case& c : {Case{10, 1.3947015340, 0.006973274431, -9.7e-7, -7.6e-6, 0.06},
                          Case{3, 1.1840839517, 0.064558335059, -9.5e-4, 1.8e-4, 0.03},
                          Case{25.0 / 12, 1.0756206190, 0.097726919137, -7.9e-3, 1.2e-1, 0.05}})
        for (bool lubrication : {true, false}) {
            StokesianDynamics model(spheres({1, 1}), 1 / (4 * M_PI), lubrication, 0);
            VectorXd force = VectorXd::Zero(12);
            force[2] = force[8] = -1;
            MatrixXd velocity;
            model.at({{Vec3(), Vec3(c.l, 0, 0)}})->multiply(force, velocity);
            const double forceRatio = -1 / velocity(2), omega = velocity(4) / velocity(2);
            EXPECT_NEAR(velocity(8), velocity(2), 1e-14);
            EXPECT_NEAR(velocity(10), -velocity(4), 1e-14);
            if (lubrication) {
                EXPECT_NEAR(forceRatio / c.force, 1, 2e-10) << c.l;
                EXPECT_NEAR(abs(omega) / c.omega, 1, 2e-9) << c.l;
                // The left sphere falls and turns about +y, because its right side is dragged down.
                EXPECT_GT(velocity(4), 0);
            } else {
                EXPECT_NEAR((forceRatio / c.force - 1) / c.ftsForceError, 1, c.tolerance) << c.l;
                EXPECT_NEAR((abs(omega) / c.omega - 1) / c.ftsOmegaError, 1, c.tolerance) << c.l;
            }
        }
}

TEST(StokesianDynamics, IsolatedPairIsExact) {
    // The pair has a general direction and either order. Its friction is compared with the exact
    // solution for two spheres: R.(U along the line) and so on.
    const double viscosity = 0.7;
    for (double gap : {1e-2, 0.3, 4.0})
        for (bool swapped : {false, true}) {
            const double a1 = 0.9, a2 = 0.36, mean = (a1 + a2) / 2;
            const Vec3 d = Vec3(2, -1, 2) / 3, across = Vec3(1, 0, -1) / sqrt(2),
                       third = across.cross(d);
            vector<double> radii = {a1, a2};
            vector<Vec3> positions = {Vec3(5, 6, 7), Vec3(5, 6, 7) + d * (a1 + a2 + gap * mean)};
            if (swapped) {
                swap(radii[0], radii[1]);
                swap(positions[0], positions[1]);
            }
            const MatrixXd friction = frictionOf(radii, positions, true, 0, viscosity);
            const TwoSphereValues<double> f = solveTwoSpheres(a2 / a1, gap);
            const int row[2] = {swapped ? 6 : 0, swapped ? 0 : 6};
            const auto element = [&](int i, int j, const Vec3& u, const Vec3& v, int torque,
                                     int spin) {
                double sum = 0;
                for (int k = 0; k < 3; k++)
                    for (int l = 0; l < 3; l++)
                        sum +=
                            u[k] * friction(row[i] + 3 * torque + k, row[j] + 3 * spin + l) * v[l];
                return sum;
            };
            const double a[2] = {a1, a2};
            for (int i = 0; i < 2; i++)
                for (int j = 0; j < 2; j++) {
                    const double s = a[i] + a[j], A = 3 * M_PI * viscosity * s, B = A * s / 3,
                                 C = B * s;
                    const double tolerance = 1e-10 * max(1.0, f[XA22]);
                    EXPECT_NEAR(element(i, j, d, d, 0, 0) / A, f[XA11 + i + j], tolerance);
                    EXPECT_NEAR(element(i, j, across, across, 0, 0) / A, f[YA11 + i + j],
                                tolerance);
                    EXPECT_NEAR(element(i, j, across, third, 0, 0) / A, 0, tolerance);
                    EXPECT_NEAR(element(i, j, d, d, 1, 1) / C, f[XC11 + i + j], tolerance);
                    EXPECT_NEAR(element(i, j, across, across, 1, 1) / C, f[YC11 + i + j],
                                tolerance);
                    // T = B U x d: across x d = third
                    EXPECT_NEAR(element(i, j, third, across, 1, 0) / B, f[YB11 + 2 * i + j],
                                tolerance);
                    EXPECT_NEAR(element(j, i, across, third, 0, 1) / B, f[YB11 + 2 * i + j],
                                tolerance);
                }
        }
}

TEST(StokesianDynamics, ForceAndTorqueBlocksFarApart) {
    // The blocks are those of Rotne-Prager-Yamakawa, at a distance where stresslets (a/r)^4 and
    // lubrication are below the tolerance.
    const vector<double> radii = {1, 0.6};
    const double r = 200;
    StokesianDynamics model(spheres(radii), 1, true, 0);
    MatrixXd mobility;
    model.at({{Vec3(0, 0, r), Vec3()}})->dense(mobility);
    const double squares = 1.36, tolerance = 1e-9;
    EXPECT_NEAR(mobility(0, 6) * 8 * M_PI * r, 1 + squares / (3 * r * r), tolerance);
    EXPECT_NEAR(mobility(2, 8) * 8 * M_PI * r, 2 - 2 * squares / (3 * r * r),
                2e-7);  // the stresslets' share is 3e-8
    EXPECT_NEAR(mobility(9, 3) * 16 * M_PI * r * r * r, -1, 1e-6);
    EXPECT_NEAR(mobility(11, 5) * 8 * M_PI * r * r * r, 1, 1e-6);
    EXPECT_NEAR(mobility(3, 7) * 8 * M_PI * r * r, 1,
                1e-6);  // Omega_0 = F_1 x n/(8 pi r²): y x z = x
}

TEST(StokesianDynamics, MatricesAgreeAndAreSymmetric) {
    for (bool lubrication : {true, false}) {
        StokesianDynamics model(spheres(threeRadii), 0.9, lubrication, 0);
        MatrixXd friction, mobility, velocities;
        unique_ptr<MobilityAt> at;
        for (int visit = 0; visit < 2; visit++) {  // earlier positions have no influence
            vector<Vec3> positions = threePositions;
            if (visit == 0) positions[1] *= 3;
            model.place(at, {positions});
            at->dense(mobility);
            at->friction(friction);
            const MatrixXd forces = MatrixXd::Random(18, 2);
            at->multiply(forces, velocities);
            EXPECT_LT((friction - friction.transpose()).norm() / friction.norm(), 1e-14);
            EXPECT_LT((mobility - mobility.transpose()).norm() / mobility.norm(), 1e-14);
            EXPECT_LT((friction * mobility - MatrixXd::Identity(18, 18)).norm(), 1e-12);
            EXPECT_LT((mobility * forces - velocities).norm() / velocities.norm(), 1e-13);
        }
        EXPECT_LT((friction - frictionOf(threeRadii, threePositions, lubrication, 0, 0.9)).norm(),
                  1e-12);
    }
}

TEST(StokesianDynamics, TurnsWithTheLaboratoryAndTheNumbering) {
    mt19937 generator(1);
    const MatrixXd friction = frictionOf(threeRadii, threePositions);
    const QuaternionArray q = randomQuaternion(generator);
    vector<Vec3> turned;
    for (const Vec3& x : threePositions) turned.push_back(rotate(q, x) + Vec3(3, 4, 5));
    Eigen::Matrix3d rotation;
    for (int k = 0; k < 3; k++) {
        const Vec3 column = rotate(q, Vec3(k == 0, k == 1, k == 2));
        rotation.col(k) << column[0], column[1], column[2];
    }
    MatrixXd all = MatrixXd::Zero(18, 18);
    for (int block = 0; block < 6; block++) all.block<3, 3>(3 * block, 3 * block) = rotation;
    EXPECT_LT((frictionOf(threeRadii, turned) - all * friction * all.transpose()).norm() /
                  friction.norm(),
              1e-12);

    const int order[3] = {2, 0, 1};
    vector<double> radii;
    vector<Vec3> positions;
    MatrixXd permutation = MatrixXd::Zero(18, 18);
    for (int i = 0; i < 3; i++) {
        radii.push_back(threeRadii[order[i]]);
        positions.push_back(threePositions[order[i]]);
        permutation.block<6, 6>(6 * i, 6 * order[i]).setIdentity();
    }
    EXPECT_LT(
        (frictionOf(radii, positions) - permutation * friction * permutation.transpose()).norm() /
            friction.norm(),
        1e-13);
}

TEST(StokesianDynamics, LubricationIsPositiveSemidefinite) {
    for (double ratio : {1.0, 0.5, 0.2, 0.1}) {
        const vector<double> radii = {1, ratio};
        for (double gap = 1e-6; gap < 20; gap *= 2) {
            const vector<Vec3> positions = {Vec3(), Vec3(0, 0, (1 + ratio) * (1 + gap / 2))};
            const MatrixXd lubrication =
                scaled(frictionOf(radii, positions) - frictionOf(radii, positions, false), radii);
            const VectorXd values = eigenvalues(lubrication);
            EXPECT_GT(values[0], -1e-14 - 1e-15 * values[11]) << ratio << " " << gap;
        }
    }
}

TEST(StokesianDynamics, PositiveDefiniteForRandomClusters) {
    mt19937 generator(2);
    const vector<double> sizes = {1, 0.5, 0.1}, gaps = {1e-6, 1e-4, 1e-2, 0.3, 2};
    double smallest = 1e300;
    for (int sample = 0; sample < 1000; sample++) {
        vector<double> radii;
        for (int i = 2 + generator() % 5; i > 0; i--)
            radii.push_back(sizes[generator() % sizes.size()]);
        const vector<Vec3> positions = cluster(radii, gaps, generator);
        const MatrixXd friction = scaled(frictionOf(radii, positions), radii);
        const double value = eigenvalues(friction)[0];
        smallest = min(smallest, value);
        ASSERT_GT(value, 1e-3) << sample;
        // Galerkin's far field is a lower bound, so the friction that lubrication adds is positive.
        ASSERT_GT(eigenvalues(friction - scaled(frictionOf(radii, positions, false), radii))[0],
                  -1e-14 * friction.norm());
    }
    printf("smallest eigenvalue %g\n", smallest);
}

TEST(StokesianDynamics, SmoothInThePositions) {
    // Finite differences of second order converge as h², also where the source of the tables' nodes
    // changes.
    for (double gap : {1e-3, 0.05, 2.0}) {
        const auto element = [&](double h) -> VectorXd {
            const vector<Vec3> positions = {Vec3(), Vec3(2 + gap * (1 + h), 0.3 * gap * h, 0),
                                            Vec3(0.5, 2.5, 0.3)};
            return Eigen::Map<VectorXd>(frictionOf({1, 1, 1}, positions).data(), 18 * 18);
        };
        const VectorXd centre = element(0);
        const auto second = [&](double h) -> VectorXd {
            return (element(h) - 2 * centre + element(-h)) / (h * h);
        };
        const VectorXd a = second(0.08), b = second(0.04), c = second(0.02);
        EXPECT_NEAR((a - b).norm() / (b - c).norm(), 4, 0.2) << gap;
        EXPECT_LT((b - c).norm(), 0.01 * c.norm());
    }
}

TEST(StokesianDynamics, MinimumGap) {
    const double minimumGap = 0.02;
    const vector<double> radii = {1, 0.5};
    const auto at = [&](double gap) { return vector<Vec3>{Vec3(), Vec3(0, 0, 1.5 + 0.75 * gap)}; };
    const auto lubrication = [&](double gap) -> MatrixXd {
        return frictionOf(radii, at(gap), true, minimumGap) -
               frictionOf(radii, at(gap), false, minimumGap);
    };
    EXPECT_LT((frictionOf(radii, at(0.03), true, minimumGap) - frictionOf(radii, at(0.03))).norm(),
              1e-12);
    for (double gap : {0.01, 0.0, -0.1})
        EXPECT_LT((lubrication(gap) - lubrication(minimumGap)).norm(), 1e-10) << gap;
    EXPECT_LT(
        (frictionOf(radii, at(-0.1), true, minimumGap) - frictionOf(radii, at(0), true, minimumGap))
            .norm(),
        1e-10);
    EXPECT_GT(eigenvalues(frictionOf(radii, at(-0.1), true, minimumGap))[0], 0.1);
    int i, j;
    EXPECT_FALSE(StokesianDynamics(spheres(radii), 1, true, minimumGap).overlaps(at(-0.1), i, j));
}

TEST(StokesianDynamics, RefusedOverlap) {
    for (bool lubrication : {true, false}) {
        StokesianDynamics model(spheres({1, 0.5, 0.5}), 1, lubrication, 0);
        int i = -1, j = -1;
        const vector<Vec3> apart = {Vec3(), Vec3(2, 0, 0), Vec3(0, 2, 0)},
                           overlapping = {Vec3(), Vec3(2, 0, 0), Vec3(2, 0.9, 0)};
        EXPECT_FALSE(model.overlaps(apart, i, j));
        EXPECT_TRUE(model.overlaps(overlapping, i, j));
        EXPECT_TRUE(model.getTraits().mayObject);
        EXPECT_EQ(model.objection({apart}), "");
        EXPECT_NE(model.objection({overlapping}).find("overlap or touch"), string::npos);
        EXPECT_EQ(i, 1);
        EXPECT_EQ(j, 2);
        EXPECT_TRUE(model.overlaps({Vec3(), Vec3(1.5, 0, 0), Vec3(0, 2, 0)}, i, j)) << "contact";
        MatrixXd before, after;
        auto place = model.at({apart});
        place->friction(before);
        expectError([&] { model.place(place, {overlapping}); },
                    {"particle 101 (body 1)", "particle 102 (body 2)",
                     "overlap or touch: their distance is 0.9 nm", "sum of their radii 1 nm",
                     "setMinimumGap", "RotnePragerYamakawa"});
        place->friction(after);
        EXPECT_EQ((before - after).norm(), 0) << "the last good positions stay";
    }
    StokesianDynamics allowed(spheres({1, 0.5}), 1, true, 0.01);
    expectError(
        [&] {
            allowed.at({{Vec3(1, 1, 1), Vec3(1, 1, 1)}});
        },
        {"particle 100 (body 0) and particle 101 (body 1)",
         "are at the same place, so their line"});
}

TEST(StokesianDynamics, RefusedParticles) {
    const auto construct = [](const HydrodynamicParticles& particles, bool lubrication = true,
                              double minimumGap = 0) {
        StokesianDynamics model(particles, 1, lubrication, minimumGap);
    };
    HydrodynamicParticles freeParticle = spheres({1}), twoInABody = spheres({1, 1});
    freeParticle.add(0.5, false, 7, -1);
    expectError(
        [&] { construct(freeParticle); },
        {"is a model of spheres that rotate", "particle 7 (in no body)", "RotnePragerYamakawa"});
    twoInABody.add(1, true, 9, 1);
    expectError([&] { construct(twoInABody); },
                {"is a model of single spheres", "body 1 has particles 101 and 9"});
    expectError(
        [&] {
            construct(spheres({1, 0.05, 1.5}));
        },
        {"the radii 1.5 nm of particle 102 (body 2) and 0.05 nm of particle 101 (body 1) have the "
         "ratio 30",
         "lubrication is known up to a ratio of 10", "setLubrication(False)"});
    construct(spheres({1, 0.05}), false);
    for (double gap : {-0.1, 1.0, double(NAN)})
        expectError([&] { construct(spheres({1}), true, gap); },
                    {"the minimum gap is ", "mean radii of a pair; it must be"});
}

TEST(StokesianDynamics, HopelessOverlapIsAnError) {
    mt19937 generator(3);
    vector<Vec3> positions;
    for (int i = 0; i < 30; i++) positions.push_back(randomDirection(generator) * 0.5);
    expectError([&] { frictionOf(vector<double>(30, 1), positions, true, 0.01); },
                {"the matrix of 30 spheres is not positive definite", "RotnePragerYamakawa"});
}

TEST(StokesianDynamics, StressletsAndStrainsAreReciprocal) {
    // The power of forces F on spheres that move with a strain E is the power of the stresslets
    // that F makes: F.U(E) = S(F):E.
    mt19937 generator(9);
    const double viscosity = 0.7;
    const vector<double> radii = {1, 0.8, 1.3, 0.6};
    const vector<Vec3> positions = cluster(radii, {0.05, 0.4, 1}, generator);
    StressletResponse response;
    forceTorqueStressletMobility(radii, positions, viscosity, &response);
    const auto velocitiesIn = [](const StressletResponse& spheres, VectorXd E) {
        VectorXd velocities = VectorXd::Zero(spheres.halfCoupling.cols());
        spheres.addVelocities(E, velocities);
        return velocities;
    };
    const MatrixXd everyE = MatrixXd::Identity(20, 20), everyF = MatrixXd::Identity(24, 24);
    double largest = 0;
    for (int f = 0; f < 24; f++) {
        const VectorXd S = response.stresslets(everyF.col(f), VectorXd::Zero(20), viscosity);
        for (int e = 0; e < 20; e++) {
            const double power = velocitiesIn(response, everyE.col(e))[f];
            EXPECT_NEAR(power, S[e], 1e-13);
            largest = max(largest, abs(power));
        }
    }
    EXPECT_GT(largest, 0.1);
    // One sphere in a strain has the stresslet -20/3 pi eta a^3 E (Batchelor 1970), and forces on
    // it make no stresslet.
    StressletResponse alone;
    forceTorqueStressletMobility({1.4}, {Vec3(3, 2, 1)}, viscosity, &alone);
    const VectorXd E = VectorXd::LinSpaced(5, -1, 2), F = VectorXd::LinSpaced(6, 1, 3);
    EXPECT_LT(
        (alone.stresslets(F, E, viscosity) + 20 * M_PI / 3 * viscosity * pow(1.4, 3) * E).norm(),
        1e-12);
    EXPECT_EQ(velocitiesIn(alone, E).norm(), 0);
}

TEST(StokesianDynamics, RowOfThreeInShear) {
    // Three free spheres in a row along the gradient: velocities of the outer ones over the shear
    // rate times a radius. The values of this model are those of an independent program in a box
    // of 50 radii. The exact ones are in unbounded fluid, by boundary collocation with Lamb's
    // solutions about all three spheres.
    struct Case {
        double gap, inABox, exact;
    };
    for (const Case& c : {Case{10, 11.999809, 11.9999}, Case{1, 2.982804, 2.98372480},
                          Case{0.1, 2.015156, 2.02073358}, Case{0.01, 1.881179, 1.88685740}}) {
        const double r = 2 + c.gap, L = 50;
        DrivenFlow flow;
        flow.gradient(0, 1) = 1;
        Placement row = {{Vec3(0, -r, 0), Vec3(), Vec3(0, r, 0)}};
        const auto velocity = [&](const StokesianDynamics& model) {
            MatrixXd slips;
            model.follow(flow, row, slips);
            model.at(row)->addStressletsOf(flow, slips);
            EXPECT_NEAR(slips(0, 0), -slips(12, 0), 1e-12);
            return slips(12, 0);
        };
        EXPECT_NEAR(velocity(StokesianDynamics(spheres({1, 1, 1}), 1, true, 0)), c.exact,
                    3.1e-3 * c.exact);
        row.box = {Vec3(L, 0, 0), Vec3(0, L, 0), Vec3(0, 0, L)};
        EXPECT_NEAR(velocity(PeriodicStokesianDynamics(spheres({1, 1, 1}), 1, true, 0)), c.inABox,
                    1e-6);
    }
}

TEST(StokesianDynamics, TwoFreeSpheresInStrainAreExact) {
    // Batchelor and Green's relative velocity of two free spheres, U = E.r - [A d d + B (1 - d d)].
    // E.r, from the exact friction and the exact forces of strain; a general direction, radii and
    // flow, spheres in either order. Stresslets by the exact functions, too.
    const double viscosity = 0.7;
    for (double gap : {3e-3, 0.3, 4.0})
        for (bool swapped : {false, true}) {
            vector<double> radii = {0.9, 0.36};
            if (swapped) swap(radii[0], radii[1]);
            const double mean = (radii[0] + radii[1]) / 2;
            const Vector3d d = Vector3d(2, -1, 2) / 3;
            const Vector3d first(0.5, 0.6, 0.7), second = first + d * mean * (2 + gap);
            const Placement pair = {
                {Vec3(first[0], first[1], first[2]), Vec3(second[0], second[1], second[2])}};
            StokesianDynamics model(spheres(radii), viscosity, true, 0);
            DrivenFlow flow;
            flow.gradient << 0.3, -0.2, 0.5, 0.8, -0.7, 0.1, -0.4, 0.6, 0.4;
            const auto at = model.at(pair);
            MatrixXd background, slips;
            model.follow(flow, pair, background);
            slips = background;
            at->addStressletsOf(flow, slips);
            const MatrixXd w = slips - background;
            const FlowSources sources = at->sources(MatrixXd::Zero(12, 1), &flow);

            // Expected: R w = F of strain, with E at both spheres.
            const Matrix3d E = (flow.gradient + flow.gradient.transpose()) / 2;
            const TwoSphereValues<double> f = solveTwoSpheres(radii[1] / radii[0], gap);
            const auto tensor = [&](const Matrix3d& m) -> Matrix3d {
                return m - m.trace() / 3 * Matrix3d::Identity();
            };
            VectorXd forces = VectorXd::Zero(12);
            Matrix3d stresslets[2] = {Matrix3d::Zero(), Matrix3d::Zero()};
            for (int p = 0; p < 2; p++)
                for (int q = 0; q < 2; q++) {
                    const double s = radii[p] + radii[q], b = M_PI * viscosity * s * s, c = b * s;
                    const Vector3d e = E * d;
                    const double dd = d.dot(e);
                    forces.segment<3>(6 * p) +=
                        b * (f[XG11 + 2 * q + p] * dd * d + 2 * f[YG11 + 2 * q + p] * (e - dd * d));
                    forces.segment<3>(6 * p + 3) -= 2 * c * f[YH11 + 2 * q + p] * e.cross(d);
                    const Vector3d U = w.col(0).segment<3>(6 * q),
                                   spin = w.col(0).segment<3>(6 * q + 3).cross(d);
                    const Matrix3d ddt = d * d.transpose();
                    stresslets[p] +=
                        b * (f[XG11 + 2 * p + q] * d.dot(U) * tensor(ddt) +
                             f[YG11 + 2 * p + q] *
                                 (d * U.transpose() + U * d.transpose() - 2 * d.dot(U) * ddt)) +
                        c * f[YH11 + 2 * p + q] * (d * spin.transpose() + spin * d.transpose());
                    const Matrix3d part0 = 1.5 * dd * tensor(ddt),
                                   part1 = d * e.transpose() + e * d.transpose() - 2 * dd * ddt;
                    stresslets[p] -= 5 * c / 6 *
                                     (f[XM11 + p + q] * part0 + f[YM11 + p + q] * part1 +
                                      f[ZM11 + p + q] * (E - part0 - part1));
                }
            const MatrixXd friction = frictionOf(radii, pair.positions, true, 0, viscosity);
            EXPECT_LT((friction * w.col(0) - forces).norm(), 1e-9 * forces.norm()) << gap;
            for (int p = 0; p < 2; p++)
                EXPECT_LT(
                    (sources.stresslets.segment<5>(5 * p) - inStressletBasis(stresslets[p])).norm(),
                    2e-9 * stresslets[p].norm())
                    << gap;
        }
}

TEST(StokesianDynamics, ShearedScenesHaveTheirTwistsStressletsAndStress) {
    // 22 spheres of two radii, gaps from 0.02, in cubic and tilted boxes: values of an independent
    // program, with ten digits (tests/data/sheared).
    const JsonValue scenes = readTestData("sheared/periodic_sheared");
    ASSERT_EQ(scenes.size(), 3);
    for (int which = 0; which < scenes.size(); which++) {
        const ShearedScene scene(scenes[which]);
        const PeriodicStokesianDynamics model(scene.particles, scene.viscosity, true, 0);
        const auto at = model.at(scene.placement);
        scene.check(*at, 1e-9);
        MatrixXd friction;
        at->friction(friction);
        const VectorXd expected = scene.data["frictionTimesWrenchNumbers"].column();
        EXPECT_LT((friction * scene.data["wrench"].column() - expected).norm(),
                  1e-9 * expected.norm());
    }
}

TEST(StokesianDynamics, ShearedArraysHaveTheirViscosity) {
    // Simple cubic arrays of unit spheres sheared by s: independent values of this model.
    struct Case {
        double fraction, tilt, viscosity;
    };
    for (const Case& c :
         {Case{0.064, 0, 1.155534}, Case{0.064, 0.2, 1.159853}, Case{0.064, 0.5, 1.167487},
          Case{0.216, 0, 1.562794}, Case{0.216, 0.3, 1.653166}, Case{0.45, 0.5, 3.903194}}) {
        const double L = cbrt(4 * M_PI / 3 / c.fraction);
        Placement place = {{Vec3()}, {Vec3(L, 0, 0), Vec3(0, L, 0), Vec3(0, 0, L)}};
        place.box[1][0] = c.tilt * L;
        PeriodicStokesianDynamics model(spheres({1}), 1, true, 0);
        DrivenFlow flow;
        flow.gradient(0, 1) = 1;
        const VectorXd stresslet = model.at(place)->sources(MatrixXd::Zero(6, 1), &flow).stresslets;
        EXPECT_NEAR(1 - stresslet[2] / sqrt(2) / (L * L * L), c.viscosity, 1e-6) << c.fraction;
    }
}

TEST(StokesianDynamics, LubricationLeavesTheStrainOfAWaveAlone) {
    // In longer and longer waves the velocities of free spheres, which stresslets alone make, have
    // no share of lubrication; in a uniform gradient they have one.
    const double spacing = 2.4;
    const int count = 6;
    Placement row = {{}, {Vec3(spacing, 0, 0), Vec3(0, count * spacing, 0), Vec3(0, 0, spacing)}};
    for (int i = 0; i < count; i++) row.positions.push_back(Vec3(0.1 * i, i * spacing, 0));
    DrivenFlow wave, shear;
    wave.waveVelocity = 1;
    wave.k = 2 * M_PI / (count * spacing);
    shear.gradient(0, 1) = 1;
    for (const DrivenFlow& flow : {wave, shear}) {
        MatrixXd velocities[2];
        for (int lubrication : {0, 1}) {
            PeriodicStokesianDynamics model(spheres(vector<double>(count, 1)), 1, lubrication, 0);
            velocities[lubrication].setZero(6 * count, 1);
            model.at(row)->addStressletsOf(flow, velocities[lubrication]);
        }
        const double change = (velocities[1] - velocities[0]).norm() / velocities[0].norm();
        if (flow.waveVelocity != 0)
            EXPECT_EQ(change, 0);
        else
            EXPECT_GT(change, 0.05);
    }
}
