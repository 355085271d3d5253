// What is computed once for bodies that stay where they are: factors of their mobility.

#include <algorithm>
#include <numeric>

#include "CoupledBodiesSupport.h"
#include "HydrodynamicSupport.h"
#include "ReferenceScenes.h"
#include "mobility/models/periodic/PeriodicMobility.h"
#include "mobility/models/rotneprager/CpuRotnePragerYamakawa.h"
#include "mobility/models/rotneprager/RotnePragerYamakawa.h"
#include "mobility/models/wall/RotnePragerYamakawaWall.h"

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

}  // namespace

/** What was computed before gives the same bits as a beginning, and both the mobility. */
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
