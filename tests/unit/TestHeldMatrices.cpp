// Matrices that are computed once for bodies that stay in place: factors of their mobility, and
// their block of the preconditioner.

#include <algorithm>
#include <numeric>

#include "CoupledBodiesSupport.h"
#include "HydrodynamicSupport.h"
#include "ReferenceScenes.h"
#include "mobility/models/periodic/PeriodicMobility.h"
#include "mobility/models/rotneprager/CpuRotnePragerYamakawa.h"
#include "mobility/models/rotneprager/RotnePragerYamakawa.h"
#include "mobility/models/wall/RotnePragerYamakawaWall.h"
#include "rigid/MultiblobSolver.h"

using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace std;

namespace {

MatrixXd normal(mt19937& random, int rows, int columns) {
    normal_distribution<double> gauss;
    MatrixXd m(rows, columns);
    for (int i = 0; i < m.size(); i++) m.data()[i] = gauss(random);
    return m;
}

/** The vertices of an icosahedron, whose blobs of half the edge make a sphere of radius 1. */
vector<Vector3d> icosahedron() {
    const double golden = (1 + sqrt(5.0)) / 2;
    vector<Vector3d> sites;
    for (int axis = 0; axis < 3; axis++)
        for (double a : {-1, 1})
            for (double b : {-1, 1}) {
                Vector3d v = Vector3d::Zero();
                v[axis] = a;
                v[(axis + 1) % 3] = b * golden;
                sites.push_back(v.normalized() / 1.262447);
            }
    return sites;
}

/** Shells of 12 blobs on a lattice, the first of which are held. */
struct Shells {
    vector<FluidElement> elements;
    vector<Pose> poses;
    unique_ptr<CoupledBodies> bodies;

    Shells(int count, int held, double spacing, const CoupledBodies::ModelFactory& makeModel) {
        mt19937 random(7);
        const vector<Vector3d> sites = icosahedron();
        const double blobRadius = 0.525731 / 1.262447;
        vector<int> places(count);
        iota(places.begin(), places.end(), 0);
        shuffle(places.begin(), places.end(), random);
        for (int b = 0; b < count; b++) {
            const int place = places[b];
            elements.push_back(fluidElement(b, sites, vector<double>(12, blobRadius)));
            if (b < held) elements.back().hold();
            Pose pose;
            pose.R = spacing * Vector3d(place % 4, place / 4 % 4, place / 16) + Vector3d(0, 0, 2);
            const QuaternionArray q = randomQuaternion(random);
            pose.q = {q[0], q[1], q[2], q[3]};
            poses.push_back(pose);
        }
        bodies = make_unique<CoupledBodies>(elements, makeModel);
    }
};

CoupledBodies::ModelFactory withPacks() {
    return [](const HydrodynamicParticles& particles) {
        return make_unique<CpuRotnePragerYamakawa>(
            particles, 1, [](int size, const function<void(int, int)>& task) { task(0, size); });
    };
}

struct IterationCase {
    double spacing;
    int held, most;
};

void checkIterations(const vector<IterationCase>& cases) {
    mt19937 random(3);
    for (const IterationCase& c : cases) {
        Shells scene(64, c.held, c.spacing, withPacks());
        MobilityCosts costs;
        BodiesAt here(*scene.bodies, costs);
        here.setPoses(scene.poses);
        MultiblobSolver solver(scene.bodies->getMotion(), scene.bodies->getNullTwists(),
                               scene.bodies->getModel());
        solver.setPoses(here.getPoses(), here.getTurns());
        const MatrixXd wrenches = normal(random, scene.bodies->getNumRows(), 1);
        MatrixXd twists;
        const int iterations =
            solver.solve(here.particles(), wrenches, MatrixXd(), 1e-6, 0, twists);
        EXPECT_LE(iterations, c.most) << c.spacing << " " << c.held;
        EXPECT_GE(iterations, c.most - 3) << c.spacing << " " << c.held;
    }
}

}  // namespace

/**
 * Held bodies resist like a porous medium; with their block they need no more iterations than free
 * bodies.
 */
TEST(HeldMatrices, IterationsDoNotGrowWithWhatIsHeld) {
    checkIterations({{4, 0, 6}, {4, 63, 6}, {2.6, 0, 11}, {2.6, 32, 13}});
}
TEST(HeldMatrices, FullIterationsDoNotGrowWithWhatIsHeld) {
    checkIterations(
        {{4, 0, 6}, {4, 32, 7}, {4, 63, 6}, {2.6, 0, 11}, {2.6, 32, 13}, {2.6, 63, 11}});
}

/**
 * The block agrees with the inverse of the matrix, both where floats are enough and where they are
 * not.
 */
TEST(HeldMatrices, TheBlockIsTheInverseOfTheMobility) {
    mt19937 random(5);
    for (double overlap : {1.0, 1e-5}) {
        PosedBodies scene;
        for (int b = 0; b < 3; b++)
            scene
                .add(fluidElement(b,
                                  {Vector3d(0, 0, 0), Vector3d(overlap, 0, 0), Vector3d(0, 2.2, 0),
                                   Vector3d(1, 1, 1)},
                                  {0.6, 0.6, 0.5, 0.7}),
                     Vector3d(3 * b, 0.2, 0.1 * b), Vector3d(0.3 * b, 0.5, 0.2))
                .hold();
        FluidElement particle = fluidElement(3, {Vector3d::Zero()}, {0.4});
        particle.body = -1;
        scene.add(particle, Vector3d(1, 4, 0)).hold();
        scene.add(fluidElement(4, {Vector3d::Zero()}, {1}), Vector3d(1, -4, 0));
        const RigidMotion motion(scene.elements);
        const RotnePragerYamakawa model(motion.getParticles(), 1);
        HeldBlock block(motion, model);
        vector<Matrix3d> turns;
        setTurns(scene.poses, turns);
        EXPECT_TRUE(block.setPoses(scene.poses, turns));
        EXPECT_FALSE(block.setPoses(scene.poses, turns));
        ASSERT_EQ(block.getNumRows(), 39);
        EXPECT_EQ(block.getCondition() > 1e-5, overlap == 1);
        Placement placement;
        motion.place(scene.poses, turns, placement);
        MatrixXd M;
        model.at(placement)->dense(M);
        MatrixXd T = MatrixXd::Identity(39, 39);
        for (int e = 0, row = 0; e < 3; e++)
            for (int i = 0; i < 4; i++, row += 3) T.block<3, 3>(row, row) = turns[e];
        const MatrixXd inverse = T.transpose() * MatrixXd(M.topLeftCorner(39, 39)).llt().solve(T);
        for (int columns : {1, 2, 5}) {
            const MatrixXd x = 1e-30 * normal(random, motion.getParticles().numRows, columns);
            MatrixXd y = MatrixXd::Constant(x.rows(), columns, 7);
            block.apply(x, y);
            const MatrixXd expected = inverse * x.topRows(39);
            const double error = (y.topRows(39) - expected).norm() / expected.norm();
            EXPECT_LT(error, overlap == 1 ? 1e-5 : 1e-8);
            EXPECT_EQ(y.bottomRows(6), MatrixXd::Constant(6, columns, 7));
            // Positive, to what rounding there is.
            for (int c = 0; c < columns; c++)
                EXPECT_GT(x.col(c).head(39).dot(y.col(c).head(39)), 0);
        }
        // Another place is another block.
        scene.poses[1].R[0] += 0.1;
        EXPECT_TRUE(block.setPoses(scene.poses, turns));
    }
}

TEST(HeldMatrices, BlobsAtOnePlaceAreRefused) {
    PosedBodies scene;
    for (int b = 0; b < 2; b++)
        scene
            .add(fluidElement(b, {Vector3d(0, 0, 0), Vector3d(1.5, 0, 0)}, {0.6, 0.6}),
                 Vector3d(0, 0, 0))
            .hold();
    const RigidMotion motion(scene.elements);
    const RotnePragerYamakawa model(motion.getParticles(), 1);
    HeldBlock block(motion, model);
    vector<Matrix3d> turns;
    setTurns(scene.poses, turns);
    expectError([&] { block.setPoses(scene.poses, turns); },
                {"MobilityForce: the mobility matrix of the 4 blobs of all held bodies is not "
                 "positive definite; look for blobs at the same place"});
}

/** Kept factors give the same bits as new factors, and both give the mobility. */
TEST(HeldMatrices, FactorsThatAreKeptHaveTheBitsOfNewOnes) {
    const vector<pair<string, CoupledBodies::ModelFactory>> models = {
        {"packs", withPacks()},
        {"plain",
         [](const HydrodynamicParticles& p) { return make_unique<RotnePragerYamakawa>(p, 1); }},
        {"wall",
         [](const HydrodynamicParticles& p) {
             return make_unique<RotnePragerYamakawaWall>(p, 1, NoSlipPlane(0, false));
         }},
        {"periodic", [](const HydrodynamicParticles& p) {
             return make_unique<PeriodicRotnePragerYamakawa>(p, 1);
         }}};
    for (const auto& [name, makeModel] : models) {
        mt19937 random(11);
        Shells scene(6, 4, 2.8, makeModel);
        BoxVectors box = {};
        if (name == "periodic") box = {Vec3(12, 0, 0), Vec3(0, 13, 0), Vec3(0, 0, 14)};
        scene.bodies->setBox(box);
        BodyMobilities kept(*scene.bodies, 1e-6);
        BodyMobility& ofAll = kept.get(BodyMobility::Dense);
        for (int step = 0; step < 4; step++) {
            for (int b = 4; b < 6; b++) scene.poses[b].R += 0.05 * normal(random, 3, 1);
            if (step == 2) scene.poses[1].R[0] += 0.1;  // a held body is moved by hand
            if (step == 3 && name == "periodic") scene.bodies->setBox({box[2], box[1], box[0]});
            BodyMobilities fresh(*scene.bodies, 1e-6);
            BodyMobility& once = fresh.get(BodyMobility::Dense);
            ofAll.setPoses(scene.poses);
            once.setPoses(scene.poses);
            const MatrixXd wrenches = normal(random, 36, 2), slips = normal(random, 216, 2);
            MatrixXd a, b;
            ofAll.solve(wrenches, slips, a);
            once.solve(wrenches, slips, b);
            EXPECT_EQ(a, b) << name << step;
            EXPECT_EQ(a.topRows(24).norm(), 0);
            ofAll.getBlobForces(a);
            once.getBlobForces(b);
            EXPECT_EQ(a, b) << name << step;
            ofAll.thermalSlip(slips, a);
            once.thermalSlip(slips, b);
            EXPECT_EQ(a, b) << name << step;
            ofAll.thermalWrench(wrenches.col(0), a);
            once.thermalWrench(wrenches.col(0), b);
            EXPECT_EQ(a, b) << name << step;
            EXPECT_EQ(ofAll.friction(), once.friction()) << name << step;
            // The friction of all bodies, and the mobility of what is free, by other ways.
            MobilityCosts costs;
            BodiesAt here(*scene.bodies, costs);
            here.setPoses(scene.poses);
            const MatrixXd xi = here.friction();
            EXPECT_LT((ofAll.friction() - xi).norm(), 1e-13 * xi.norm()) << name << step;
            const MatrixXd N = MatrixXd(xi.bottomRightCorner(12, 12)).inverse();
            EXPECT_LT((ofAll.mobility().bottomRightCorner(12, 12) - N).norm(), 1e-12 * N.norm());
            // Of the columns that are asked for, not one bit differs.
            MatrixXd all, some;
            here.particles().dense(all);
            here.particles().denseColumns(48, some);
            EXPECT_EQ(MatrixXd(all.rightCols(72)), MatrixXd(some.rightCols(72))) << name;
        }
    }
}
