// Noise of the mobility problem has the right covariance without matrices, in any units and for
// unequal radii. Further tests are of models with their own random field.

#include "CoupledBodiesSupport.h"
#include "HydrodynamicSupport.h"
#include "RandomFieldModel.h"
#include "TestSupport.h"
#include "mobility/models/forcecoupling/ForceCouplingGrid.h"
#include "mobility/models/rotneprager/RotnePragerYamakawa.h"
#include "mobility/models/wall/RotnePragerYamakawaWall.h"
#include "mobility/models/wall/SlipChannel.h"
#include "schemes/OverdampedMove.h"

using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace std;

namespace {

/** Spheres and a free particle of unequal radii, with all lengths multiplied by a unit. */
struct Spheres {
    vector<FluidElement> elements;
    vector<Pose> poses;
    unique_ptr<TestedBodies> bodies;
    Spheres(double unit, double tolerance) {
        for (int i = 0; i < 9; i++) {
            FluidElement e;
            const bool isFree = i == 8;
            e.body = isFree ? -1 : i;
            e.sites = {Vector3d::Zero()};
            e.radii = {unit * (i % 3 == 0 ? 1 : i % 3 == 1 ? 0.3 : 2)};
            e.particles = {i};
            elements.push_back(e);
            Pose pose;
            pose.R = unit * Vector3d(3.2 * (i % 3), 3.1 * (i / 3), 0.4 * i);
            poses.push_back(pose);
        }
        const auto model = [](const HydrodynamicParticles& particles) {
            return make_unique<RotnePragerYamakawa>(particles, 1);
        };
        bodies = make_unique<TestedBodies>(elements, model, true, tolerance);
        bodies->setPoses(poses);
    }
};

}  // namespace

TEST(MobilityProblem, NoiseOfSpheresHasItsCovarianceInAnyUnit) {
    for (double unit : {1e-3, 1.0, 1e3}) {
        const double tolerance = 1e-3;
        Spheres spheres(unit, tolerance);
        const int n = (*spheres.bodies)->getNumRows();
        // The scale removes the units of entries: 1/length, 1/length^2, 1/length^3.
        VectorXd scale(n);
        for (int r = 0; r < n; r++) scale[r] = pow(unit, r % 6 < 3 ? 0.5 : 1.5);
        BodyMobility& problem = spheres.bodies->byProducts();
        MatrixXd slips, wrenches;
        // The unit vectors give the symmetric root column by column. Each column is accurate to
        // five tolerances, so that the covariance is accurate to ten.
        problem.thermalSlip(MatrixXd::Identity(n, n), slips);
        problem.thermalWrench(MatrixXd::Identity(n, n), wrenches);
        const MatrixXd N = scale.asDiagonal() * spheres.bodies->mobility() * scale.asDiagonal();
        const MatrixXd xi = scale.cwiseInverse().asDiagonal() * spheres.bodies->friction() *
                            scale.cwiseInverse().asDiagonal();
        const MatrixXd root = scale.asDiagonal() * slips,
                       inverseRoot = scale.cwiseInverse().asDiagonal() * wrenches;
        EXPECT_LT((root * root.transpose() - N).norm(), 10 * tolerance * N.norm()) << unit;
        EXPECT_LT((inverseRoot * inverseRoot.transpose() - xi).norm(), 10 * tolerance * xi.norm())
            << unit;
    }
}

TEST(MobilityProblem, UnitsChangeNothingButNumbers) {
    Spheres small(1, 1e-3), large(1e3, 1e-3);
    const int n = (*small.bodies)->getNumRows();
    const VectorXd W = VectorXd::LinSpaced(n, -1, 2).array().sin();
    const auto noise = [&](Spheres& spheres, int& iterations) {
        BodyMobility& problem = spheres.bodies->byProducts();
        MatrixXd slips;
        const long long before = problem.getCosts().iterations;
        problem.thermalSlip(W, slips);
        iterations = problem.getCosts().iterations - before;
        return VectorXd(slips);
    };
    int iterationsSmall, iterationsLarge;
    const VectorXd a = noise(small, iterationsSmall);
    VectorXd b = noise(large, iterationsLarge);
    for (int r = 0; r < n; r++) b[r] *= pow(1e3, r % 6 < 3 ? 0.5 : 1.5);
    EXPECT_LT((a - b).norm(), 1e-10 * a.norm());
    EXPECT_EQ(iterationsSmall, iterationsLarge);
}

// ---- Many bodies

namespace {

/**
 * Enough bodies for collective modes. Spheres and free particles of unequal radii, or multiblobs of
 * three blobs, in unbounded fluid in two clouds far apart, or in layers above a wall.
 */
struct ManyBodies {
    vector<FluidElement> elements;
    vector<Pose> poses;
    unique_ptr<TestedBodies> bodies;
    ManyBodies(int count, bool multiblobs, bool wall, double tolerance) {
        mt19937 random(5);
        uniform_real_distribution<double> uniform(-1, 1);
        normal_distribution<double> gauss;
        const vector<Vector3d> sites = {{-1, 0, 0.1}, {1.2, 0.5, 0.3}, {0.2, -1.4, 1.1}};
        const int side = ceil(cbrt(count));
        for (int b = 0, particle = 0; b < count; b++) {
            FluidElement e;
            const bool isFree = !multiblobs && b % 5 == 4;
            e.body = isFree ? -1 : b;
            e.sites = multiblobs ? sites : vector<Vector3d>{Vector3d::Zero()};
            for (size_t i = 0; i < e.sites.size(); i++) {
                e.radii.push_back(multiblobs ? 0.9 : b % 3 == 0 ? 1 : b % 3 == 1 ? 0.4 : 1.4);
                e.particles.push_back(particle++);
            }
            elements.push_back(e);
            Pose pose;
            const double spacing = multiblobs ? 4.4 : 2.6;
            pose.R = spacing * Vector3d(b % side, b / side % side, b / side / side);
            for (int k = 0; k < 3; k++) pose.R[k] += 0.2 * uniform(random);
            if (wall) pose.R[2] += 2.9;
            if (!wall && b % 2) pose.R[0] += 300;
            double norm = 0;
            for (double* q : {&pose.q.w, &pose.q.x, &pose.q.y, &pose.q.z}) {
                *q = gauss(random);
                norm += *q * *q;
            }
            for (double* q : {&pose.q.w, &pose.q.x, &pose.q.y, &pose.q.z}) *q /= sqrt(norm);
            poses.push_back(pose);
        }
        const auto model = [wall](const HydrodynamicParticles& particles) {
            unique_ptr<MobilityModel> made;
            if (wall)
                made = make_unique<RotnePragerYamakawaWall>(particles, 1, NoSlipPlane(0, false));
            else
                made = make_unique<RotnePragerYamakawa>(particles, 1);
            return made;
        };
        bodies = make_unique<TestedBodies>(elements, model, true, tolerance);
        bodies->setPoses(poses);
    }
    MatrixXd blobMobility() {
        Placement placement;
        vector<Matrix3d> turns;
        setTurns(poses, turns);
        (*bodies)->getMotion().place(poses, turns, placement);
        MatrixXd M;
        (*bodies)->getModel().at(placement)->dense(M);
        return M;
    }
};

}  // namespace

TEST(MobilityProblem, RootsOfManyBodiesHaveTheirCovariance) {
    for (bool multiblobs : {false, true})
        for (bool wall : {false, true}) {
            const string name =
                string(multiblobs ? "multiblobs" : "spheres") + (wall ? " above a wall" : "");
            const double tolerance = 1e-3;
            ManyBodies many(24, multiblobs, wall, tolerance), exact(24, multiblobs, wall, 1e-8);
            const MatrixXd M = many.blobMobility();
            const VectorXd scale = M.diagonal().cwiseSqrt().cwiseInverse();
            const int n = M.rows();
            BodyMobility &problem = many.bodies->byProducts(), &fine = exact.bodies->byProducts();
            problem.setPoses(many.poses);
            fine.setPoses(many.poses);
            const MatrixXd unit = MatrixXd::Identity(n, n);
            MatrixXd slips, forces, exactSlips, exactForces, wrenches;
            problem.thermalSlip(unit, slips);
            problem.forcesOfThermalSlip(unit, forces);
            fine.thermalSlip(unit, exactSlips);
            fine.forcesOfThermalSlip(unit, exactForces);
            const auto error = [](const MatrixXd& a, const MatrixXd& b) {
                return (a - b).norm() / b.norm();
            };
            // The square roots are those of M and of its inverse, and belong to each other.
            EXPECT_LT(error(exactSlips * exactSlips.transpose(), M), 1e-7) << name;
            EXPECT_LT(error(M * exactForces, exactSlips), 1e-6) << name;
            fine.thermalWrench(unit, wrenches);
            EXPECT_LT(error(wrenches * wrenches.transpose(), exact.bodies->friction()), 1e-7)
                << name;
            // The promise of the tolerance.
            double worst = 0;
            for (int c = 0; c < n; c++) {
                const VectorXd found = scale.cwiseProduct(slips.col(c)),
                               right = scale.cwiseProduct(exactSlips.col(c));
                worst = max(worst, error(found, right) / tolerance);
            }
            cout << name << ": the largest error of a column is " << worst << " tolerances" << endl;
            EXPECT_LT(worst, 5) << name;
            EXPECT_LT(error(forces, exactForces), 5 * tolerance) << name;
            MatrixXd again;
            fine.forcesOfSlips(exactSlips, again);
            EXPECT_LT(error(again, exactForces), 1e-6) << name;
        }
}

TEST(MobilityProblem, RootsOfManyBodiesTakeHardlyMoreProductsThanThoseOfFew) {
    // The largest eigenvalue is 13 times as large for 1500 spheres as for 30. Without collective
    // modes the roots take 8 and 26 products.
    const auto products = [](int count, bool multiblobs, bool wall) {
        ManyBodies many(count, multiblobs, wall, 1e-3);
        BodyMobility& problem = many.bodies->byProducts();
        const VectorXd W =
            VectorXd::LinSpaced((*many.bodies)->getParticles().numRows, 0, 1e4).array().sin();
        MatrixXd slips;
        problem.thermalSlip(W, slips);
        return problem.getCosts().products;
    };
    const int few = products(30, false, false), many = products(1500, false, false);
    cout << few << " products for 30 spheres, " << many << " for 1500" << endl;
    EXPECT_LE(many, few + 8);
}

TEST(MobilityProblem, RootsOfALayerAboveAWallTakeAsManyProductsAsThoseOfFew) {
    // Images screen the forces, so that no eigenvalue grows with the number of spheres. Spheres
    // that stand for groups are larger than the layer is high. Where they were taken for what
    // groups do, roots took 11 products instead of 6.
    const auto products = [](int side) {
        ManyBodies many(side * side, false, true, 1e-3);
        for (int b = 0; b < side * side; b++)
            for (int k = 0; k < 3; k++)
                many.poses[b].R[k] = (k == 2 ? 1.7 : 3.5 * (k == 0 ? b % side : b / side)) +
                                     0.3 * sin(7.0 * b + 2.0 * k);
        BodyMobility& problem = many.bodies->byProducts();
        problem.setPoses(many.poses);
        const VectorXd W =
            VectorXd::LinSpaced((*many.bodies)->getParticles().numRows, 0, 1e4).array().sin();
        MatrixXd slips;
        problem.thermalSlip(W, slips);
        return problem.getCosts().products;
    };
    const int few = products(4), many = products(30);
    cout << few << " products for 16 spheres, " << many << " for 900" << endl;
    EXPECT_LE(many, few + 2);
}

TEST(MobilityProblem, CollectiveModesStayDuringAStep) {
    // The roots at the poses of a step are one smooth function of the poses.
    ManyBodies many(60, true, true, 1e-10);
    BodyMobility& problem = many.bodies->byProducts();
    problem.setTolerance(1e-10);
    const int n = (*many.bodies)->getParticles().numRows;
    const VectorXd W = VectorXd::LinSpaced(n, 0, 1e4).array().sin();
    MatrixXd here, there, half, back;
    const auto at = [&](double way) {
        vector<Pose> poses = many.poses;
        for (size_t b = 0; b < poses.size(); b++)
            poses[b].R += way * Vector3d(cos(b), sin(2.0 * b), 0.3 * cos(3.0 * b));
        return poses;
    };
    problem.setPoses(at(0));
    problem.thermalSlip(W, here);
    problem.setPoses(at(0.1));
    problem.thermalSlip(W, there);
    problem.setPoses(at(0.05));
    problem.thermalSlip(W, half);
    EXPECT_LT((here + there - 2 * half).norm(), 0.1 * (there - here).norm());
    // The next step has modes of its own, and what was before does not matter.
    problem.setTolerance(1e-10);
    problem.setPoses(at(0));
    problem.thermalSlip(W, back);
    EXPECT_EQ(back, here);
}

// ---- A random field of the model's own

namespace {

/** Two multiblobs, a sphere and a free particle in a fluid with a random field. */
struct InAField {
    vector<FluidElement> elements;
    vector<Pose> poses, others;
    unique_ptr<TestedBodies> bodies;
    RandomFieldModel* model = nullptr;
    InAField() {
        const vector<vector<Vector3d>> sites = {{{-1, 0, 0}, {1.2, 0.5, 0.3}, {0.2, -1.4, 1.1}},
                                                {{0, 0, 0}},
                                                {{0, 0, -1}, {0, 0, 1.1}},
                                                {{0, 0, 0}}};
        for (int i = 0; i < 4; i++) {
            FluidElement e;
            e.body = i == 3 ? -1 : i;
            e.sites = sites[i];
            e.radii.assign(sites[i].size(), 0.5);
            for (size_t k = 0; k < sites[i].size(); k++) e.particles.push_back(3 * i + k);
            elements.push_back(e);
            Pose pose;
            pose.R = Vector3d(2.9 * (i % 2), 2.7 * (i / 2), 0.4 * i);
            pose.q = scalar::exponential(scalar::Vector3<double>{0.3 * i, 0.2, -0.1 * i});
            poses.push_back(pose);
            pose.R += Vector3d(0.2, -0.1 * i, 0.3);
            others.push_back(pose);
        }
        bodies = make_unique<TestedBodies>(
            elements,
            [&](const HydrodynamicParticles& particles) {
                model = new RandomFieldModel(particles);
                return unique_ptr<MobilityModel>(model);
            },
            true, 1e-10);
    }
    Placement placement(const vector<Pose>& at) const {
        vector<Matrix3d> turns;
        setTurns(at, turns);
        Placement result;
        (*bodies)->getMotion().place(at, turns, result);
        return result;
    }
    /**
     * The slips (surface velocities) of each wave alone, as a strategy gives them. In a random
     * field these slips are multiplied by random numbers.
     */
    MatrixXd response(BodyMobility& mobility) const {
        MatrixXd result(mobility.getSlipSpace().getNumRows(), model->numWaves()), slips;
        unique_ptr<RandomField> field;
        for (int w = 0; w < model->numWaves(); w++) {
            RandomFieldModel::onlyWave = w;
            EXPECT_TRUE(
                mobility.field().draw(NoiseStream(), NoiseStream::ParticleFirstDraw, field));
            mobility.slipsOf(*field, slips);
            EXPECT_EQ(slips.cols(), 1);
            result.col(w) = slips;
        }
        RandomFieldModel::onlyWave = -1;
        return result;
    }
};

}  // namespace

TEST(MobilityProblem, SlipsOfTheModelsOwnFieldHaveTheCovarianceM) {
    InAField scene;
    for (BodyMobility* mobility : {&scene.bodies->byMatrices(), &scene.bodies->byProducts()}) {
        mobility->setPoses(scene.poses);
        const MatrixXd B = scene.response(*mobility);
        MatrixXd M;
        scene.model->at(scene.placement(scene.poses))->dense(M);
        EXPECT_LT(difference(B * B.transpose(), M), 1e-14);
        // The twists of bodies that these slips cause have the covariance N, and no body turns
        // about its line.
        MatrixXd U;
        mobility->solve(MatrixXd::Zero((*scene.bodies)->getNumRows(), B.cols()), B, U);
        scene.bodies->setPoses(scene.poses);
        EXPECT_LT(difference(U * U.transpose(), scene.bodies->mobility()), 1e-9);
        EXPECT_EQ(mobility->getCosts().roots, 0);
    }
}

TEST(MobilityProblem, OneFieldIsLookedAtAtSeveralPlaces) {
    InAField scene;
    for (BodyMobility* mobility : {&scene.bodies->byMatrices(), &scene.bodies->byProducts()}) {
        mobility->setPoses(scene.poses);
        const MatrixXd here = scene.response(*mobility);
        mobility->setPoses(scene.others, true);
        const MatrixXd there = scene.response(*mobility);
        // The expected covariances of the flows at all pairs of centres are from a formula that
        // does not use the field.
        const Placement a = scene.placement(scene.poses), b = scene.placement(scene.others);
        const HydrodynamicParticles& particles = scene.model->getParticles();
        const MatrixXd both = here * there.transpose();
        for (int i = 0; i < particles.size(); i++)
            for (int k = 0; k < particles.size(); k++)
                EXPECT_LT((both.block<3, 3>(particles.firstRow[i], particles.firstRow[k]) -
                           scene.model->covariance(RigidHITest::toEigen(a.positions[i]),
                                                   RigidHITest::toEigen(b.positions[k])))
                              .norm(),
                          1e-13 * both.norm());
    }
}

/**
 * Schemes without momenta draw the model's field and compute no square root. The field stays the
 * same at all poses until the next draw.
 */
TEST(MobilityProblem, SchemesTakeTheModelsOwnField) {
    InAField scene;
    BodyMobility& mobility = scene.bodies->byMatrices();
    OverdampedMove move(mobility);
    move.start = scene.poses;
    OverdampedStep step;
    step.h = step.kT = 1;
    step.noise.seed = 5;
    move.begin(step);
    MatrixXd first, away, again, other, expected;
    move.drawForSlips(OverdampedMove::First);
    move.atStart();
    move.thermalSlip(first);
    move.at(scene.others);
    move.thermalSlip(away);
    move.atStart();
    move.thermalSlip(again);
    EXPECT_TRUE(first == again);
    EXPECT_EQ(move.randomNumbers, scene.model->numWaves());
    unique_ptr<RandomField> field;
    scene.model->randomField()->draw(step.noise, NoiseStream::ParticleFirstDraw, BoxVectors(),
                                     field);
    field->slipsAt(scene.placement(scene.poses), false, expected);
    EXPECT_TRUE(first == expected);
    field->slipsAt(scene.placement(scene.others), false, expected);
    EXPECT_TRUE(away == expected);
    move.drawForSlips(OverdampedMove::Second);
    move.thermalSlip(other);
    EXPECT_GT(difference(first, other), 0.1);
    EXPECT_EQ(mobility.getCosts().roots, 0);
}

/**
 * A body with an own tensor has its own slips, so schemes compute square roots although the model
 * has a field.
 */
TEST(MobilityProblem, OwnTensorsHaveNoField) {
    InAField scene;
    scene.elements.pop_back();
    scene.elements.pop_back();
    scene.poses.resize(2);
    scene.elements[0].ownMobility = tensorWithoutSymmetry(1);
    TestedBodies bodies(scene.elements, [&](const HydrodynamicParticles& particles) {
        return make_unique<RandomFieldModel>(particles);
    });
    bodies.setPoses(scene.poses);
    unique_ptr<RandomField> field;
    EXPECT_FALSE(
        bodies.byMatrices().field().draw(NoiseStream(), NoiseStream::ParticleFirstDraw, field));
    MatrixXd slips;
    bodies.byMatrices().thermalSlip(MatrixXd::Identity(12, 12), slips);
    EXPECT_LT(difference(slips * slips.transpose(), bodies.mobility()), 1e-12);
}

namespace {

/** The quaternion turned by a rotation vector in the lab frame. */
scalar::Quaternion<double> turned(const scalar::Quaternion<double>& q, const Vector3d& by) {
    return scalar::exponential(scalar::Vector3<double>{by.x() / 2, by.y() / 2, by.z() / 2}) * q;
}

}  // namespace

TEST(MobilityProblem, TheDivergenceOfAFieldIsThatOfItsTwists) {
    // The divergence is compared with central differences of one coordinate of one body after the
    // other. Multiblobs about points far from their middle have a divergence made of gradients.
    // With a sphere about such a point, the divergence is made of differences of all bodies at
    // once.
    for (int k = 0; k < 4; k++) {
        const bool withSphere = k % 2 == 1, inChannel = k >= 2;
        vector<FluidElement> elements;
        vector<Pose> poses;
        for (int i = 0; i < 3; i++) {
            FluidElement e;
            e.body = i;
            e.sites = {Vector3d(0.3, -0.1, 0.2), Vector3d(0.9, 0.4, 0), Vector3d(-0.2, 0.8, 0.5)};
            e.radii = {0.4, 0.3, 0.5};
            if (withSphere && i == 2) {
                e.sites.resize(1);
                e.radii.resize(1);
            }
            for (size_t k = 0; k < e.sites.size(); k++) e.particles.push_back(3 * i + k);
            elements.push_back(e);
            Pose pose;
            pose.R = Vector3d(1.7 * i, -0.8 * i, 4 * i);
            pose.q = turned(pose.q, Vector3d(0.4 * i, 1, -0.3));
            poses.push_back(pose);
        }
        const shared_ptr<GridFluid> fluid = make_shared<PlainGridFluid>();
        TestedBodies bodies(
            elements, [&](const HydrodynamicParticles& particles) -> unique_ptr<MobilityModel> {
                auto periodic =
                    make_unique<ForceCouplingGrid>(particles, 1, 1e-6, 0, fluid, inChannel);
                if (!inChannel) return periodic;
                return make_unique<SlipChannel>(particles, 1, SlipWalls{-3, 1.7, false},
                                                move(periodic));
            });
        bodies->setBox({Vec3(5, 0, 0), Vec3(0, 5.5, 0), Vec3(0, 0, 6)});
        BodyMobility& mobility = bodies.byProducts();
        mobility.setPoses(poses);
        unique_ptr<RandomField> field;
        ASSERT_TRUE(mobility.field().draw(NoiseStream(), NoiseStream::ParticleFirstDraw, field));
        const double divergence = mobility.field().divergenceOf(*field), delta = 1e-5;
        double expected = 0, size = 0;
        MatrixXd slips, twists;
        for (int row = 0; row < bodies->getNumRows(); row++)
            for (int side : {1, -1}) {
                vector<Pose> moved = poses;
                Vector3d step = Vector3d::Unit(row % 3) * side * delta;
                if (row % 6 < 3)
                    moved[row / 6].R += step;
                else
                    moved[row / 6].q = turned(moved[row / 6].q, step);
                mobility.setPoses(moved, true);
                mobility.slipsOf(*field, slips);
                mobility.nearestTwists(slips, twists);
                expected += side * twists(row, 0) / (2 * delta);
                size = max(size, abs(twists(row, 0)));
            }
        // The errors by rounding of 1e-16 and by the third derivative are both below 1e-9.
        EXPECT_NEAR(divergence, expected, 1e-7 * size) << withSphere << inChannel;
        EXPECT_GT(abs(expected), 1e-3 * size);
    }
}
