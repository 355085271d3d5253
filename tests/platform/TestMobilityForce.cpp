// Properties that every hydrodynamic model must have, and the results that MobilityForce gives to
// users, by the public API.

#include <openmm/VirtualSite.h>

#include "HydrodynamicSupport.h"
#include "Instrumented.h"
#include "mobility/Models.h"

using namespace OpenMM;
using namespace RigidHITest;
using namespace std;

namespace {

/** The data that tests need about a model with one of its boundaries. */
struct ModelCase {
    string name;
    MobilityForce::Model model;
    MobilityForce::Boundary boundary;
    bool takesOverlap;     // spheres may overlap
    bool takesMultiblobs;  // and bodies may have several blobs, or a sphere off their origin
    bool takesFreeParticles;
    bool couplesBodies;
    MobilityForce::SphereWallMobility sphereWall = MobilityForce::FromModel;

    const RigidHIPlugin::BoundaryTraits& bounds() const {
        return RigidHIPlugin::traitsOf(boundary);
    }
    /** Whether there are no sums that give matrices, but only products on a grid. */
    bool isOnGrid() const {
        return model == MobilityForce::ForceCoupling && bounds().isPeriodic && bounds().isAcross(2);
    }
};
void PrintTo(const ModelCase& model, ostream* out) {
    *out << model.name;
}  // for GoogleTest's messages
/**
 * All models in the list, with all of their boundaries. A model that does not couple bodies is the
 * same with each boundary, and has one line. Force coupling along no-slip walls takes long for each
 * matrix. It is here once, and not on Reference or instrumented, where it takes seconds:
 * TestConfined and TestConfinedForceCoupling have all of it, and TestConfinedGrid compares the
 * fluids of both platforms.
 */
vector<ModelCase> allModels() {
    vector<ModelCase> all;
    const bool isSlow = testPlatformName() == "Reference" || isInstrumented();
    for (const RigidHIPlugin::ModelTraits& model : RigidHIPlugin::modelTable)
        for (const RigidHIPlugin::BoundaryTraits& boundary : RigidHIPlugin::boundaryTable)
            if (model.hasBoundary(boundary.boundary) &&
                (model.couplesBodies || boundary.isUniform()) &&
                !(model.model == MobilityForce::ForceCoupling && boundary.isAcross(2) &&
                  (isSlow || boundary.boundary != MobilityForce::NoSlipChannel)))
                all.push_back({model.name + string(boundary.isUniform() ? "" : boundary.name),
                               model.model, boundary.boundary, model.takesOverlap,
                               model.takesMultiblobs, model.takesMultiblobs, model.couplesBodies});
    all.push_back({"BestKnownAtTheWall", MobilityForce::RotnePragerYamakawa,
                   MobilityForce::NoSlipWall, true, true, true, true, MobilityForce::BestKnown});
    return all;
}
const vector<ModelCase> models = allModels();
/**
 * The wall is below all particles of the mixture if their origins have z >= 0. Scenes on a grid are
 * half as large, because their time is that of the box.
 */
const double wallHeight = -2;
double channelWidth(const ModelCase& model) { return model.isOnGrid() ? 9.5 : 14.5; }
/** The tolerance of coarse grids, and the error that they have here relative to the largest entry.
 */
const double toleranceOnGrid = 0.1, errorOnGrid = 0.003;
void choose(FluidScene& scene, const ModelCase& model) {
    scene.fluid->setModel(model.model);
    scene.fluid->setBoundary(model.boundary);
    scene.fluid->setWallHeight(wallHeight);
    scene.fluid->setSphereWallMobility(model.sphereWall);
    scene.fluid->setChannelWalls(wallHeight, wallHeight + channelWidth(model));
    if (model.bounds().isPeriodic && model.bounds().hasWalls())
        scene.side = channelWidth(model) + 1;
    if (!model.isOnGrid()) return;
    // Matrices by products on a grid. It is coarse, which spoils none of the properties tested
    // here.
    scene.fluid->setSolver(MobilityForce::Dense);
    scene.fluid->setSolverTolerance(toleranceOnGrid);
}
/**
 * A distance from the scene at which the effect of a wall or of images is a radius divided by the
 * distance.
 */
void removeBoundary(FluidScene& scene, double distance = 1e18) {
    scene.fluid->setWallHeight(-distance);
    scene.fluid->setChannelWalls(-0.4 * distance, 0.4 * distance);
    scene.side = distance;
}

/**
 * Spheres of unequal radii, and where the model takes them multiblobs and rods. Where matrices are
 * products on a grid there are fewer spheres, because a grid knows particles only.
 */
void addMixture(FluidScene& scene, const ModelCase& model, int copies = 1) {
    for (int i = 0; i < copies; i++) {
        if (!model.isOnGrid()) {
            scene.add(sphereKind(0.5));
            scene.add(sphereKind(0.8));
        }
        scene.add({"marked sphere", 1, Vec3(0.3, 0.2, 0.25), {Vec3(), Vec3(0, 0.6, 0)}, {0.6, 0}});
        if (!model.takesMultiblobs) continue;
        scene.add(boomerangKind());
        scene.add(rodKind());
        if (model.isOnGrid()) continue;
        scene.add({"sphere off the origin", 1, Vec3(0.3, 0.5, 0.6), {Vec3(0.2, 0.1, -0.4)}, {0.7}});
    }
}
const double largestExtent =
    1.9;  // largest distance of a blob of the mixture from its body's origin, plus its radius

struct Configuration {
    vector<Vec3> R;
    vector<QuaternionArray> q;
};
Configuration randomConfiguration(const FluidScene& scene, const ModelCase& model, double size,
                                  int seed) {
    if (model.isOnGrid()) size /= 2;
    mt19937 random(seed);
    const int n = scene.bodies.size();
    const double contact = model.takesMultiblobs ? 2 * largestExtent : 1.6;
    return {randomPlaces(n, model.takesOverlap ? size : max(size, 1.6 * cbrt(n) * contact),
                         model.takesOverlap ? 0 : contact, random),
            randomTurns(n, random)};
}

class EveryModel : public testing::TestWithParam<ModelCase> {};
INSTANTIATE_TEST_SUITE_P(Models, EveryModel, testing::ValuesIn(models),
                         [](const testing::TestParamInfo<ModelCase>& info) {
                             return info.param.name;
                         });

void checkRandomConfigurations(const ModelCase& model, int numTrials) {
    double smallest = INFINITY;
    FluidScene scene;
    choose(scene, model);
    scene.add(sphereKind(0.5));
    scene.add(sphereKind(0.8));
    scene.add(sphereKind(0.6));
    if (model.takesMultiblobs) scene.add(boomerangKind());
    scene.start(testPlatform());
    for (int trial = 0; trial < numTrials; trial++) {
        const double size = trial % 3 == 0 ? 0.5 : trial % 3 == 1 ? 2 : 8;
        const Configuration c = randomConfiguration(scene, model, size, trial);
        scene.pose(c.R, c.q);
        const MatrixXd N = scene.mobility();
        ASSERT_LT((N - N.transpose()).cwiseAbs().maxCoeff(), 1e-15 * N.cwiseAbs().maxCoeff());
        const VectorXd d = N.diagonal().cwiseSqrt().cwiseInverse();
        const double least =
            Eigen::SelfAdjointEigenSolver<MatrixXd>(MatrixXd(d.asDiagonal() * N * d.asDiagonal()))
                .eigenvalues()[0];
        ASSERT_GT(least, 0) << "configuration " << trial;
        smallest = min(smallest, least);
    }
    cout << "smallest eigenvalue " << smallest << endl;
}

}  // namespace

/** In boxes, where a matrix takes up to a hundred times longer, over fewer. */
TEST_P(EveryModel, IsSymmetricAndPositiveOverRandomConfigurations) {
    checkRandomConfigurations(GetParam(), GetParam().isOnGrid()            ? allOrFew(9, 3)
                                          : GetParam().bounds().isPeriodic ? allOrFew(200, 30)
                                                                           : allOrFew(1000, 30));
}
TEST_P(EveryModel, FullIsSymmetricAndPositiveOverManyConfigurationsInBoxes) {
    if (GetParam().isOnGrid() || !GetParam().bounds().isPeriodic)
        GTEST_SKIP() << "the test without Full has as many";
    checkRandomConfigurations(GetParam(), 1000);
}

TEST_P(EveryModel, FrictionIsTheInverseAndProductsAreTheMatrix) {
    for (int seed = 0; seed < (GetParam().isOnGrid() ? 1 : 5); seed++) {
        FluidScene scene;
        choose(scene, GetParam());
        addMixture(scene, GetParam());
        scene.start(testPlatform());
        const Configuration c = randomConfiguration(scene, GetParam(), 10, seed);
        scene.pose(c.R, c.q);
        const MatrixXd N = scene.mobility(), xi = scene.friction();
        EXPECT_LT(difference(N * xi * N, N), 1e-11);
        EXPECT_LT(difference(xi * N * xi, xi), 1e-11);
        EXPECT_LT((N * xi - (N * xi).transpose()).cwiseAbs().maxCoeff(), 1e-11);
        // The wrenches have no torque about the line of a rod, which would be refused.
        const VectorXd wrenches = xi * (N * VectorXd::Random(N.rows()));
        const vector<double> twists = scene.fluid->applyMobilityInContext(
            *scene.context, {wrenches.data(), wrenches.data() + wrenches.size()});
        EXPECT_LT(
            difference(Eigen::Map<const VectorXd>(twists.data(), twists.size()), N * wrenches),
            1e-12);
    }
}

TEST_P(EveryModel, TurnsAndMovesWithTheScene) {
    FluidScene scene;
    choose(scene, GetParam());
    addMixture(scene, GetParam());
    scene.start(testPlatform());
    for (int seed = 0; seed < (GetParam().isOnGrid() ? 2 : 5); seed++) {
        const Configuration c = randomConfiguration(scene, GetParam(), 8, seed);
        scene.pose(c.R, c.q);
        const MatrixXd before = scene.mobility();
        mt19937 random(100 + seed);
        // At a wall, only turns and moves that leave the wall where it is are allowed.
        const bool atWall = GetParam().bounds().isAcross(2);
        const bool inChannel = GetParam().bounds().isAcross(1);
        // In a box only turns by right angles are allowed.
        const double half = sqrt(0.5);
        const QuaternionArray turn = atWall && scene.isPeriodic()
                                         ? QuaternionArray{{half, 0, 0, -half}}
                                     : atWall             ? QuaternionArray{{0.6, 0, 0, -0.8}}
                                     : inChannel          ? QuaternionArray{{half, 0, half, 0}}
                                     : scene.isPeriodic() ? QuaternionArray{{0.5, 0.5, -0.5, 0.5}}
                                                          : randomQuaternion(random);
        Configuration moved = c;
        for (Vec3& R : moved.R) R = rotate(turn, R) + Vec3(3, inChannel ? 0 : -7, atWall ? 0 : 11);
        for (QuaternionArray& q : moved.q) q = product(turn, q);
        scene.pose(moved.R, moved.q);
        EXPECT_LT(difference(scene.mobility(), turned(before, rotationOf(turn))),
                  GetParam().isOnGrid() ? errorOnGrid : 1e-11);
    }
}

TEST_P(EveryModel, DoesNotDependOnTheOrderOfBodiesOrParticles) {
    vector<int> order;
    FluidScene first, second;
    choose(first, GetParam());
    choose(second, GetParam());
    addMixture(first, GetParam(), 2);
    const int n = first.bodies.size();
    const Configuration c = randomConfiguration(first, GetParam(), 10, 3);
    for (int i = 0; i < n; i++) order.push_back((5 * i + 2) % n);
    for (int b : order) {
        BodyKind kind = first.bodies[b];
        reverse(kind.sites.begin(), kind.sites.end());
        reverse(kind.radii.begin(), kind.radii.end());
        second.add(kind, c.R[b], c.q[b]);
    }
    first.start(testPlatform());
    second.start(testPlatform());
    first.pose(c.R, c.q);
    const MatrixXd a = first.mobility(), b = second.mobility();
    MatrixXd expected(6 * n, 6 * n);
    for (int i = 0; i < n; i++)
        for (int k = 0; k < n; k++)
            expected.block(6 * i, 6 * k, 6, 6) = a.block(6 * order[i], 6 * order[k], 6, 6);
    EXPECT_LT(difference(b, expected), 1e-12);
}

TEST_P(EveryModel, OneSphereHasStokesDrag) {
    if (GetParam().isOnGrid()) GTEST_SKIP() << "no grid has such distances";
    for (double radius : {1e-3, 0.7, 40.0}) {
        FluidScene scene;
        choose(scene, GetParam());
        removeBoundary(scene);
        scene.fluid->setViscosity(2.5);
        scene.add(sphereKind(radius));
        scene.start(testPlatform());
        const double t = 1 / (6 * M_PI * 2.5 * radius), r = 1 / (8 * M_PI * 2.5 * pow(radius, 3));
        VectorXd diagonal(6);
        diagonal << t, t, t, r, r, r;
        EXPECT_LT(difference(scene.mobility(), diagonal.asDiagonal()), 1e-15);
        EXPECT_LT(difference(scene.friction(), diagonal.cwiseInverse().asDiagonal()), 1e-15);
    }
}

TEST_P(EveryModel, BodiesAloneHaveTheTensorOfTheirBlobs) {
    if (!GetParam().takesMultiblobs) GTEST_SKIP() << "spheres only";
    if (GetParam().model == MobilityForce::ForceCoupling)
        GTEST_SKIP() << "of Gaussians: TestPeriodicMobility";
    if (GetParam().bounds().isPeriodic) {
        SKIP_ON_DEVICES("they keep positions in the box, and the box is 1e18 nm wide");
    }
    for (const BodyKind& kind : {boomerangKind(), rodKind()})
        for (int seed = 0; seed < 3; seed++) {
            mt19937 random(seed);
            FluidScene scene;
            choose(scene, GetParam());
            removeBoundary(scene);
            scene.add(kind, Vec3(1, 2, 3), randomQuaternion(random));
            scene.start(testPlatform());
            EXPECT_LT(difference(scene.mobility(), scene.expected().mobility), 1e-11) << kind.name;
            EXPECT_LT(difference(scene.friction(), scene.expected().friction), 1e-12) << kind.name;
        }
}

TEST_P(EveryModel, FarAwayIsThatOfAPointForce) {
    const double R = 300, eta = 0.6;
    if (GetParam().isOnGrid()) GTEST_SKIP() << "no grid has such distances";
    if (GetParam().bounds().isPeriodic) {
        SKIP_ON_SINGLE_PRECISION_DEVICES(
            "they keep positions in the box, and the box is 1e9 nm wide");
    }
    FluidScene scene;
    choose(scene, GetParam());
    removeBoundary(scene, 1e9);
    addMixture(scene, GetParam());
    const int n = scene.bodies.size();
    const Vec3 direction(0.48, -0.6, 0.64);
    scene.start(testPlatform());
    mt19937 random(3);
    vector<Vec3> places;
    for (int i = 0; i < n; i++) places.push_back(direction * (R * i));
    scene.pose(places, randomTurns(n, random));
    const MatrixXd N = scene.mobility();
    const Vector3d u = toEigen(direction);
    for (int i = 0; i < n; i++)
        for (int k = 0; k < i; k++) {
            const double r = R * (i - k), scale = 1 / (8 * M_PI * eta * r);
            MatrixXd expected = MatrixXd::Zero(6, 6);
            if (GetParam().couplesBodies) {
                expected.topLeftCorner(3, 3) = scale * (Matrix3d::Identity() + u * u.transpose());
                expected.bottomLeftCorner(3, 3) = expected.topRightCorner(3, 3) =
                    -scale / r * cross(u);
                expected.bottomRightCorner(3, 3) =
                    -0.5 * scale / (r * r) * (Matrix3d::Identity() - 3 * u * u.transpose());
            }
            const MatrixXd block = N.block(6 * i, 6 * k, 6, 6);
            // For bodies off their origin, and bodies that turn when pushed, corrections are of the
            // order of their size over the distance.
            const double size = 3 / r;
            EXPECT_LT((block - expected).topLeftCorner(3, 3).norm(), scale * size) << i << " " << k;
            if (!GetParam().couplesBodies) {
                EXPECT_EQ(block.norm(), 0);
            }
            if (i > 2 || k > 2) continue;
            EXPECT_LT((block - expected).bottomLeftCorner(3, 3).norm(), scale / r * size)
                << i << " " << k;
            EXPECT_LT((block - expected).bottomRightCorner(3, 3).norm(), scale / (r * r) * size)
                << i << " " << k;
        }
}

TEST_P(EveryModel, ScalesWithLengthsAndViscosity) {
    const double scale = 3.5;
    MatrixXd N[3];
    Configuration c;
    for (int i = 0; i < 3; i++) {
        FluidScene scene;
        choose(scene, GetParam());
        const double s = i == 1 ? scale : 1;
        addMixture(scene, GetParam());
        FluidScene scaled;
        choose(scaled, GetParam());
        scaled.fluid->setWallHeight(s * wallHeight);
        scaled.fluid->setChannelWalls(s * wallHeight, s * (wallHeight + channelWidth(GetParam())));
        scaled.side *= s;
        scaled.fluid->setViscosity(i == 2 ? 0.6 * scale : 0.6);
        c = randomConfiguration(scene, GetParam(), 8, 2);
        for (size_t b = 0; b < scene.bodies.size(); b++) {
            BodyKind kind = scene.bodies[b];
            for (Vec3& x : kind.sites) x *= s;
            for (double& a : kind.radii) a *= s;
            scaled.add(kind, c.R[b] * s, c.q[b]);
        }
        scaled.start(testPlatform());
        N[i] = scaled.mobility();
    }
    EXPECT_LT(difference(N[2] * scale, N[0]), 1e-13);
    for (int row = 0; row < N[0].rows(); row += 3)
        for (int column = 0; column < N[0].cols(); column += 3) {
            const int rotations = row / 3 % 2 + column / 3 % 2;
            EXPECT_LT((N[1].block(row, column, 3, 3) * pow(scale, 1 + rotations) -
                       N[0].block(row, column, 3, 3))
                          .cwiseAbs()
                          .maxCoeff(),
                      1e-11 * N[0].cwiseAbs().maxCoeff());
        }
}

TEST_P(EveryModel, ReferenceAndCpuAgree) {
    if (!onCpu()) GTEST_SKIP() << "the program of the platform CPU compares the two";
    const bool isInBox = GetParam().bounds().isPeriodic;
    for (int seed = 0; seed < (GetParam().isOnGrid() ? 1 : isInBox ? 2 : allOrFew(5, 1)); seed++) {
        MatrixXd N[2], xi[2];
        for (int p = 0; p < 2; p++) {
            FluidScene scene;
            choose(scene, GetParam());
            addMixture(scene, GetParam(), GetParam().isOnGrid() ? 1 : 3);
            if (GetParam().takesFreeParticles) scene.addFree(1, 0.4, Vec3(1, 1, 1));
            const Configuration c = randomConfiguration(scene, GetParam(), 9, seed);
            scene.start(platform(p == 0 ? "Reference" : "CPU"), 2);
            scene.pose(c.R, c.q);
            N[p] = scene.mobility();
            xi[p] = scene.friction();
        }
        EXPECT_LT(difference(N[1], N[0]), 1e-12);
        const VectorXd values =
            Eigen::SelfAdjointEigenSolver<MatrixXd>(N[0]).eigenvalues().cwiseAbs();
        double least = values.maxCoeff();
        for (double v : values)
            if (v > 1e-9 * values.maxCoeff()) least = min(least, v);
        EXPECT_LT(difference(xi[1], xi[0]), 100 * values.maxCoeff() / least * 1e-16);
    }
}

TEST_P(EveryModel, GroupsAreScenesOfTheirOwn) {
    // Near or far, the mobility of a group is that of the group alone, bit for bit.
    FluidScene alone;
    choose(alone, GetParam());
    addMixture(alone, GetParam());
    const Configuration c = randomConfiguration(alone, GetParam(), 8, 5);
    const int n = alone.bodies.size();
    alone.start(testPlatform());
    alone.pose(c.R, c.q);
    const MatrixXd expected = alone.mobility(), expectedFriction = alone.friction();
    for (double apart : {0.3, 1e3}) {
        if (GetParam().isOnGrid() && apart > 1) continue;
        FluidScene both;
        choose(both, GetParam());
        vector<int> groups;
        // The bodies of both groups are interleaved, and the labels are in no order.
        for (int b = 0; b < n; b++)
            for (int group : {7, 2}) {
                both.add(alone.bodies[b], c.R[b] + Vec3(group == 7 ? 0 : apart, 0, 0), c.q[b]);
                groups.push_back(group);
            }
        both.fluid->setGroups(groups);
        both.start(testPlatform(), 2);
        const MatrixXd N = both.mobility(), xi = both.friction();
        for (int i = 0; i < n; i++)
            for (int k = 0; k < n; k++) {
                ASSERT_EQ(N.block(12 * i, 12 * k, 6, 6), expected.block(6 * i, 6 * k, 6, 6));
                ASSERT_EQ(xi.block(12 * i, 12 * k, 6, 6),
                          expectedFriction.block(6 * i, 6 * k, 6, 6));
                ASSERT_LT(
                    (N.block(12 * i + 6, 12 * k + 6, 6, 6) - expected.block(6 * i, 6 * k, 6, 6))
                        .norm(),
                    (GetParam().isOnGrid() ? errorOnGrid : 1e-9) * expected.norm());
                ASSERT_EQ(N.block(12 * i, 12 * k + 6, 6, 6).norm(), 0);
                ASSERT_EQ(xi.block(12 * i + 6, 12 * k, 6, 6).norm(), 0);
            }
    }
}

TEST_P(EveryModel, TwoContextsSideBySide) {
    FluidScene a, b;
    for (FluidScene* scene : {&a, &b}) {
        choose(*scene, GetParam());
        addMixture(*scene, GetParam());
        scene->start(testPlatform());
    }
    const Configuration here = randomConfiguration(a, GetParam(), 8, 1),
                        there = randomConfiguration(a, GetParam(), 8, 2);
    a.pose(here.R, here.q);
    const MatrixXd first = a.mobility();
    b.pose(there.R, there.q);
    b.fluid->setViscosity(2);
    b.fluid->updateParametersInContext(*b.context);
    EXPECT_GT(difference(b.mobility(), first), 0.1);
    EXPECT_EQ(a.mobility(), first);
}

TEST_P(EveryModel, ChangedParametersReachTheContext) {
    FluidScene scene;
    choose(scene, GetParam());
    addMixture(scene, GetParam());
    const Configuration c = randomConfiguration(scene, GetParam(), 8, 4);
    scene.start(testPlatform());
    scene.pose(c.R, c.q);
    const MatrixXd before = scene.mobility();
    scene.fluid->setViscosity(1.2);
    EXPECT_EQ(scene.mobility(), before);  // not before updateParametersInContext()
    scene.fluid->updateParametersInContext(*scene.context);
    EXPECT_LT(difference(2 * scene.mobility(), before), 1e-13);
    EXPECT_LT(difference(0.5 * scene.friction() * before * scene.friction() * 0.5,
                         scene.friction() * 0.5),
              1e-10);
    scene.fluid->setViscosity(0.6);
    for (int p = 0; p < scene.fluid->getNumParticles(); p++)
        scene.fluid->setParticleRadius(p, 0.9 * scene.fluid->getParticleRadius(p));
    scene.fluid->updateParametersInContext(*scene.context);
    FluidScene smaller;
    choose(smaller, GetParam());
    for (size_t b = 0; b < scene.bodies.size(); b++) {
        BodyKind kind = scene.bodies[b];
        for (double& a : kind.radii) a *= 0.9;
        smaller.add(kind, c.R[b], c.q[b]);
    }
    smaller.start(testPlatform());
    EXPECT_LT(difference(scene.mobility(), smaller.mobility()), 1e-12);
}

TEST(EveryEnumerator, RunsTheOperatorOfItsNameOnThisPlatform) {
    vector<MatrixXd> known;
    for (const RigidHIPlugin::ModelTraits& traits : RigidHIPlugin::modelTable)
        for (const RigidHIPlugin::BoundaryTraits& bounds : RigidHIPlugin::boundaryTable) {
            const auto model = traits.model;
            const auto boundary = bounds.boundary;
            const string name = string(traits.name) + ", " + bounds.name;
            FluidScene scene;
            scene.fluid->setModel(model);
            scene.fluid->setBoundary(boundary);
            scene.fluid->setChannelWalls(-2, 5);
            // Where matrices are made of products on a grid, any grid shows whose they are.
            scene.fluid->setSolverTolerance(toleranceOnGrid);
            scene.add(sphereKind(0.5), Vec3(0, 0, 1));
            scene.add(sphereKind(0.8), Vec3(0.9, 0.8, 1.7));
            if (!traits.hasBoundary(boundary)) {
                EXPECT_THROW(scene.start(testPlatform()), OpenMMException) << name;
                continue;
            }
            scene.start(testPlatform());
            const MatrixXd N = scene.mobility();
            RigidHIPlugin::HydrodynamicParticles particles;
            particles.add(0.5, true, 0, 0);
            particles.add(0.8, true, 1, 1);
            const auto common = RigidHIPlugin::createMobility(*scene.fluid, {}, particles);
            MatrixXd M;
            common
                ->at({scene.positions,
                      {Vec3(scene.side, 0, 0), Vec3(0, scene.side, 0), Vec3(0, 0, scene.side)}})
                ->dense(M);
            // Under FreeDraining every body is in a fluid of its own.
            if (model == MobilityForce::FreeDraining)
                M.topRightCorner(6, 6).setZero(), M.bottomLeftCorner(6, 6).setZero();
            EXPECT_LT(difference(N, M), 1e-12) << name << " is not what the common operator makes";
            if (model == MobilityForce::FreeDraining && boundary == MobilityForce::Periodic) {
                EXPECT_EQ(difference(N, known[0]), 0) << "it is FreeDraining, Unbounded";
                continue;
            }
            for (const MatrixXd& other : known)
                EXPECT_GT(difference(N, other), 1e-6) << name << " runs as another model";
            known.push_back(N);
        }
    EXPECT_GE(known.size(), 4u);
}

TEST(EveryEnumerator, OthersAreRefused) {
    const auto badModel = static_cast<MobilityForce::Model>(17);
    const auto badBoundary = static_cast<MobilityForce::Boundary>(-1);
    expectError(
        [&] { RigidHIPlugin::checkOperator(badModel, MobilityForce::Unbounded); },
        {"model 17 cannot be used with boundary Unbounded; choose a model that has this boundary"});
    expectError(
        [&] { RigidHIPlugin::checkOperator(MobilityForce::RotnePragerYamakawa, badBoundary); },
        {"model RotnePragerYamakawa cannot be used with boundary -1"});
    // Such combinations must not silently use the operator of unbounded fluid.
    MobilityForce fluid;
    fluid.setModel(MobilityForce::StokesianDynamics);
    fluid.setBoundary(MobilityForce::NoSlipWall);
    expectError([&] { RigidHIPlugin::createMobility(fluid, {}, {}); },
                {"model StokesianDynamics cannot be used with boundary NoSlipWall"});
    fluid.setModel(MobilityForce::ForceCoupling);
    fluid.setBoundary(MobilityForce::Unbounded);
    expectError([&] { RigidHIPlugin::createMobility(fluid, {}, {}); },
                {"model ForceCoupling cannot be used with boundary Unbounded"});
}

namespace {

/** The velocities of blobs by the public API, three rows for each particle of the System. */
VectorXd blobVelocities(FluidScene& scene, const VectorXd& forces) {
    const vector<double> v = scene.fluid->applyBlobMobilityInContext(
        *scene.context, {forces.data(), forces.data() + forces.size()});
    return Eigen::Map<const VectorXd>(v.data(), v.size());
}

/**
 * The same velocities by the tensor of Rotne, Prager and Yamakawa, written down independently, or
 * above a wall by the model of each pair.
 * @param labels  a number for each particle: those with the same number feel each other
 */
VectorXd expectedBlobVelocities(FluidScene& scene, const vector<int>& labels,
                                const VectorXd& forces) {
    const auto x = positionsOf(*scene.context);
    const int n = x.size();
    VectorXd v = VectorXd::Zero(3 * n);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            const double a = scene.fluid->getParticleRadius(i),
                         b = scene.fluid->getParticleRadius(j);
            if (a == 0 || b == 0 || labels[i] != labels[j]) continue;
            Matrix3d M = pairOfSpheres(a, b, toEigen(x[i] - x[j]), scene.fluid->getViscosity())
                             .topLeftCorner(3, 3);
            if (RigidHIPlugin::traitsOf(scene.fluid->getBoundary()).hasWalls()) {
                RigidHIPlugin::HydrodynamicParticles pair;
                pair.add(a, false, 0, -1);
                if (i != j) pair.add(b, false, 1, -1);
                const auto above = RigidHIPlugin::createMobility(*scene.fluid, {}, pair);
                MatrixXd both;
                above->at({i == j ? vector<Vec3>{x[i]} : vector<Vec3>{x[i], x[j]}})->dense(both);
                M = both.topRightCorner(3, 3);
            }
            v.segment<3>(3 * i) += M * forces.segment<3>(3 * j);
        }
    return v;
}

}  // namespace

TEST_P(EveryModel, BlobsMoveByTheParticlesMobility) {
    const ModelCase& model = GetParam();
    const bool ofPairs = model.model == MobilityForce::RotnePragerYamakawa ||
                         model.model == MobilityForce::FreeDraining;
    if (!ofPairs || model.sphereWall == MobilityForce::BestKnown || model.bounds().isPeriodic)
        GTEST_SKIP() << "other than RotnePragerYamakawa's pairs: see SpheresMoveByTheirTranslation";
    for (auto solver : {MobilityForce::Dense, MobilityForce::MatrixFree}) {
        FluidScene scene;
        choose(scene, model);
        scene.fluid->setSolver(solver);
        addMixture(scene, model, 2);
        const int n = scene.bodies.size();
        vector<int> groups, labels;
        for (int b = 0; b < n; b++) {
            groups.push_back(b % 3 == 0);
            // Under FreeDraining only the blobs of one body feel each other.
            for (size_t i = 0; i < scene.particles[b].size(); i++)
                labels.push_back(model.couplesBodies ? groups[b] : b + 1);
        }
        // Free particles are in group 0, except one that the fluid does not see.
        for (int i = 0; i < 3; i++) {
            scene.addFree(1, i == 1 ? 0 : 0.3, Vec3(1.1 * i, 7, 1));
            labels.push_back(model.couplesBodies ? 0 : n + 1 + i);
        }
        scene.fluid->setGroups(groups);
        // An own tensor belongs to the body, and does not change the velocities of its blobs.
        scene.fluid->setBodyMobility(3, rowsOf(tensorWithoutSymmetry(1)));
        scene.start(testPlatform());
        const Configuration c = randomConfiguration(scene, model, 6, 1);
        scene.pose(c.R, c.q);
        const VectorXd forces = VectorXd::Random(3 * scene.positions.size());
        const VectorXd v = blobVelocities(scene, forces),
                       expected = expectedBlobVelocities(scene, labels, forces);
        EXPECT_LT(difference(v, expected), readTolerance(1e-12, 1));
        for (size_t p = 0; p < scene.positions.size(); p++)
            EXPECT_EQ(v.segment<3>(3 * p).isZero(0), scene.fluid->getParticleRadius(p) == 0)
                << "particle " << p;
    }
}

TEST_P(EveryModel, SpheresMoveByTheirTranslation) {
    FluidScene scene;
    choose(scene, GetParam());
    for (double radius : {0.5, 0.8, 0.6}) scene.add(sphereKind(radius));
    scene.start(testPlatform());
    for (int seed = 0; seed < 3; seed++) {
        const Configuration c = randomConfiguration(scene, GetParam(), 3, seed);
        scene.pose(c.R, c.q);
        const VectorXd forces = VectorXd::Random(9);
        const MatrixXd N = scene.mobility();
        VectorXd expected = VectorXd::Zero(9);
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++)
                expected.segment<3>(3 * i) +=
                    N.block<3, 3>(6 * i, 6 * j) * forces.segment<3>(3 * j);
        EXPECT_LT(difference(blobVelocities(scene, forces), expected), 1e-12);
        // Asking for velocities changes nothing.
        EXPECT_EQ(scene.mobility(), N);
    }
}

TEST(FreeDraining, IsTheBodiesOneByOne) {
    FluidScene draining, coupled;
    draining.fluid->setModel(MobilityForce::FreeDraining);
    for (FluidScene* scene : {&draining, &coupled}) {
        addMixture(*scene, models[0]);
        scene->start(testPlatform());
        const Configuration c = randomConfiguration(*scene, models[0], 6, 1);
        scene->pose(c.R, c.q);
    }
    const auto bodies = coupled.labBodies();
    MatrixXd expected = MatrixXd::Zero(6 * bodies.size(), 6 * bodies.size());
    for (size_t b = 0; b < bodies.size(); b++)
        expected.block(6 * b, 6 * b, 6, 6) = IndependentMobility({bodies[b]}, 0.6).mobility;
    EXPECT_LT(difference(draining.mobility(), expected), 1e-11);
    EXPECT_GT(difference(coupled.mobility(), expected), 0.01);
}

TEST(RotnePragerYamakawaForce, PairsMixturesAndFreeParticles) {
    for (int seed = 0; seed < 20; seed++) {
        FluidScene scene;
        addMixture(scene, models[1], 1 + seed % 3);
        if (seed % 2)
            for (int i = 0; i < 4; i++)
                scene.addFree(1, i == 2 ? 0 : 0.3 + 0.2 * i, Vec3(2 * i, 0.3, 0.1 * i * i));
        scene.start(testPlatform());
        const Configuration c = randomConfiguration(scene, models[1], seed < 10 ? 8 : 2.5, seed);
        scene.pose(c.R, c.q);
        const int n = 6 * scene.bodies.size();
        const IndependentMobility expected = scene.expected();
        // Free particles are without forces. So the mobility is the bodies' part of the whole
        // mobility, and the friction is the inverse of this part.
        const MatrixXd mobility = expected.mobility.topLeftCorner(n, n);
        EXPECT_LT(difference(scene.mobility(), mobility), 1e-10) << "scene " << seed;
        const MatrixXd xi = scene.friction();
        EXPECT_LT(difference(mobility * xi * mobility, mobility), 1e-9) << "scene " << seed;
    }
}

TEST(RotnePragerYamakawaForce, ValuesOfPairsComputedElsewhere) {
    // The expected values are by quadrature over the surfaces, for eta = 1: tt across and along, rr
    // across and along, and c, the coefficient of F x n.
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
    for (const auto& c : cases) {
        FluidScene scene;
        scene.fluid->setViscosity(1);
        scene.add(sphereKind(c.a_i), Vec3(0, 0, c.R));
        scene.add(sphereKind(c.a_j));
        scene.start(testPlatform());
        const MatrixXd N = scene.mobility();
        const double tolerance = 1e-9 * c.expected[1];
        EXPECT_NEAR(N(0, 6), c.expected[0], tolerance);
        EXPECT_NEAR(N(2, 8), c.expected[1], tolerance);
        EXPECT_NEAR(N(3, 9), c.expected[2], tolerance);
        EXPECT_NEAR(N(5, 11), c.expected[3], tolerance);
        // With n = z, F = x gives F x n = -y.
        EXPECT_NEAR(N(4, 6), -c.expected[4], tolerance);
        EXPECT_NEAR(N(3, 7), c.expected[4], tolerance);
    }
}

TEST(RotnePragerYamakawaForce, VirtualSitesAndBodiesMadeFromParticlesHaveRadii) {
    // A body like a water is made from its particles. A virtual site is one of its blobs.
    System system;
    CustomRigidHIIntegrator integrator(0, 0.001);
    auto* fluid = new MobilityForce();
    const vector<Vec3> places = {Vec3(0.1, 0.2, 0), Vec3(0.5, 0.1, 0.3), Vec3(0, 0.6, 0.2), Vec3()};
    for (double mass : {16.0, 1.0, 1.0, 0.0}) system.addParticle(mass);
    system.setVirtualSite(3, new ThreeParticleAverageSite(0, 1, 2, 0.2, 0.5, 0.3));
    for (double radius : {0.0, 0.2, 0.25, 0.3}) fluid->addParticle(radius);
    fluid->setViscosity(1.5);
    system.addForce(fluid);
    integrator.addRigidBody({0, 1, 2, 3});
    integrator.setScheme(CustomRigidHIIntegrator::LangevinHI);
    Context context(system, integrator, testPlatform());
    context.setPositions(places);
    context.computeVirtualSites();
    LabBody body;
    body.R = toEigen(integrator.getBodyPositions()[0]);
    const auto x = positionsOf(context);
    body.offsets = {toEigen(x[1]) - body.R, toEigen(x[2]) - body.R, toEigen(x[3]) - body.R};
    body.radii = {0.2, 0.25, 0.3};
    EXPECT_LT(difference(squareOf(fluid->getMobilityInContext(context)),
                         IndependentMobility({body}, 1.5).mobility),
              readTolerance(1e-11, 1));
}

TEST(OwnTensors, AreThoseOfTheUsersBodyFrame) {
    // The boomerang's moments are not ascending, so its axes are relabelled inside. Tensors must
    // follow this change of axes.
    const MatrixXd own = tensorWithoutSymmetry(4);
    for (auto model : {MobilityForce::FreeDraining, MobilityForce::RotnePragerYamakawa})
        for (bool asFriction : {false, true}) {
            FluidScene scene;
            scene.fluid->setModel(model);
            mt19937 random(3);
            const QuaternionArray q = randomQuaternion(random);
            scene.add(boomerangKind(), Vec3(1, 1, 1), q);
            if (asFriction)
                scene.fluid->setBodyFriction(0, rowsOf(own));
            else
                scene.fluid->setBodyMobility(0, rowsOf(own));
            scene.start(testPlatform());
            EXPECT_LT(difference(asFriction ? scene.friction() : scene.mobility(),
                                 turned(own, rotationOf(q))),
                      1e-12);
            EXPECT_LT(difference(asFriction ? scene.mobility() : scene.friction(),
                                 turned(own, rotationOf(q)).inverse()),
                      1e-12);
        }
}

TEST(OwnTensors, AreChangedInAContext) {
    FluidScene scene;
    scene.add(boomerangKind());
    scene.add(sphereKind(0.5), Vec3(4, 0, 0));
    scene.start(testPlatform());
    const MatrixXd before = scene.mobility();
    // An own tensor that equals the model's tensor changes nothing.
    FluidScene alone;
    alone.add(boomerangKind());
    alone.start(testPlatform());
    scene.fluid->setBodyMobility(0, rowsOf(alone.mobility()));
    scene.fluid->updateParametersInContext(*scene.context);
    EXPECT_LT(difference(scene.mobility(), before), 1e-12);
    scene.fluid->setBodyMobility(0, rowsOf(2 * alone.mobility()));
    scene.fluid->updateParametersInContext(*scene.context);
    EXPECT_LT(difference(scene.mobility().topLeftCorner(6, 6), 2 * before.topLeftCorner(6, 6)),
              1e-12);
    EXPECT_LT(
        difference(scene.mobility().topRightCorner(6, 6), sqrt(2) * before.topRightCorner(6, 6)),
        1e-12);
    EXPECT_LT(difference(scene.mobility().bottomRightCorner(6, 6), before.bottomRightCorner(6, 6)),
              1e-12);
    scene.fluid->clearBodyTensor(0);
    scene.fluid->updateParametersInContext(*scene.context);
    EXPECT_EQ(scene.mobility(), before);
}

TEST(OwnTensors, GiveFreeDrainingBodiesADragWithoutRadii) {
    FluidScene scene;
    scene.fluid->setModel(MobilityForce::FreeDraining);
    scene.add({"unseen", 1, Vec3(1, 2, 2.5), {Vec3(), Vec3(0.5, 0, 0)}, {0, 0}});
    const MatrixXd own = tensorWithoutSymmetry(1);
    scene.fluid->setBodyMobility(0, rowsOf(own));
    scene.start(testPlatform());
    EXPECT_LT(difference(scene.mobility(), own), 1e-12);
    EXPECT_LT(difference(scene.friction(), own.inverse()), 1e-12);
    scene.integrator.step(2);
}

TEST(OwnTensors, GiveRodsADragAboutTheirLineWhenAlone) {
    // FreeDraining takes the tensor as it is, so that inertia about the line is no obstacle.
    FluidScene scene;
    scene.fluid->setModel(MobilityForce::FreeDraining);
    BodyKind rod = rodKind();
    rod.moments = Vec3(0.9, 0.9, 0.1);
    scene.add(rod);
    const MatrixXd own = tensorWithoutSymmetry(2);
    scene.fluid->setBodyMobility(0, rowsOf(own));
    scene.start(testPlatform());
    EXPECT_LT(difference(scene.mobility(), own), 1e-12);
    scene.integrator.step(2);
}
