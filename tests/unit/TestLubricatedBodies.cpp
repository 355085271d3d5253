// Spheres with lubrication beside multiblobs and free particles: iterations against matrices.

#include <Eigen/Geometry>
#include <random>

#include "CoupledBodiesSupport.h"
#include "HydrodynamicSupport.h"
#include "TestSupport.h"
#include "mobility/DrivenFlow.h"
#include "mobility/models/lubricated/LubricatedMobility.h"
#include "mobility/models/periodic/PeriodicMobility.h"
#include "mobility/models/rotneprager/RotnePragerYamakawa.h"
#include "mobility/models/wall/RotnePragerYamakawaWall.h"
#include "rigid/BodyFlow.h"

using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace std;

namespace {

const double eta = 0.7;

struct Mixture {
    enum Boundary { Unbounded, Wall, Box, BoxOfGaussians };

    Boundary boundary = Unbounded;
    vector<FluidElement> elements;
    vector<Pose> poses;
    BoxVectors box = {Vec3(9, 0, 0), Vec3(0.4, 8.5, 0), Vec3(-0.3, 0.2, 9.5)};

    void add(const vector<Vector3d>& sites, const vector<double>& radii, const Vector3d& at,
             const Vector3d& turn = {0, 0, 0}, bool isFree = false) {
        FluidElement e;
        e.body = isFree ? -1 : elements.size();
        e.sites = sites;
        e.radii = radii;
        for (size_t i = 0; i < sites.size(); i++)
            e.particles.push_back(20 * (elements.size() + 1) + i);
        elements.push_back(e);
        Pose pose;
        pose.R = at;
        pose.q =
            scalar::exponential(scalar::Vector3<double>{turn.x() / 2, turn.y() / 2, turn.z() / 2});
        poses.push_back(pose);
    }
    /** The centre of a sphere that is off the origin of its body. */
    void addSphere(double radius, const Vector3d& centre, const Vector3d& site,
                   const Vector3d& turn) {
        add({site}, {radius}, {0, 0, 0}, turn);
        poses.back().R = centre - poses.back().rotation() * site;
    }
    TestedBodies make(double tolerance) const {
        TestedBodies bodies(
            elements,
            [this](const HydrodynamicParticles& particles) -> unique_ptr<MobilityModel> {
                LubricationScene scene;
                scene.reach = {3, 4};
                if (boundary == Wall) scene.low = 0;
                if (boundary >= Box) scene.numPeriods = 3;
                unique_ptr<MobilityModel> model;
                switch (boundary) {
                    case Unbounded: model = make_unique<RotnePragerYamakawa>(particles, eta); break;
                    case Wall:
                        model = make_unique<RotnePragerYamakawaWall>(particles, eta,
                                                                     NoSlipPlane(0, false));
                        break;
                    case Box:
                        model = make_unique<PeriodicRotnePragerYamakawa>(particles, eta);
                        break;
                    case BoxOfGaussians:
                        model = make_unique<PeriodicForceCoupling>(particles, eta);
                        break;
                }
                return make_unique<LubricatedMobility>(
                    particles, eta, boundary == BoxOfGaussians ? overGaussians() : overSurfaces(),
                    scene, move(model));
            },
            true, tolerance);
        if (boundary >= Box) bodies->setBox(box);
        bodies.byMatrices().setPoses(poses);
        bodies.byProducts().setPoses(poses);
        bodies.byProducts().setTolerance(tolerance);
        return bodies;
    }
};

/**
 * Three spheres with the same gap, in radii, between them and to the wall, one of them off its
 * body's origin; a bent body, a shell, a rod and a free particle.
 */
Mixture mixture(Mixture::Boundary boundary, double gap) {
    Mixture m;
    m.boundary = boundary;
    const Vector3d a(0, 0, 1 + gap), b = a + (1.8 + gap) * Vector3d(0.8, 0, 0.6),
                                     c = a + (2 + gap) * Vector3d(0, 0.6, 0.8);
    m.add({{0, 0, 0}}, {1}, a, {0.2, 0, 0.1});
    m.addSphere(0.8, b, {0.3, -0.2, 0.1}, {0.3, 1.1, -0.2});
    m.add({{-1, 0, 0}, {1.2, 0.5, 0.3}, {0.2, -1.4, 1.1}, {0.3, 0.6, -0.2}}, {0.8, 0.7, 0.6, 0.8},
          {-2.2, -1.5, 2.6}, {0.4, 0.3, 0.9});
    m.add({{0, 0, 0}}, {1}, c, {0, 0, 0});
    vector<Vector3d> shell;
    for (const Vector3d& x : {Vector3d(1, 1, 1), Vector3d(-1, -1, 1), Vector3d(-1, 1, -1),
                              Vector3d(1, -1, -1), Vector3d(0, 0, 1.7), Vector3d(0.1, 1.6, 0)})
        shell.push_back(0.5 * x);
    m.add(shell, vector<double>(6, 0.4), {1.9, -1.5, 1.6}, {0.7, 0, 0.1});
    m.add({{0, 0, -1}, {0, 0, 0.2}, {0, 0, 1.2}}, {0.5, 0.5, 0.5}, {-2.5, 1.9, 2.1}, {1, 0.4, 0});
    m.add({{0, 0, 0}}, {0.5}, {1.3, 2.3, 0.9}, {0, 0, 0}, true);
    return m;
}

MatrixXd randomVectors(int rows, int columns, int seed) {
    mt19937 random(seed);
    normal_distribution<double> normal;
    MatrixXd x(rows, columns);
    for (double& number : x.reshaped()) number = normal(random);
    return x;
}

/** The error of each column in the norm of the friction, relative to the column; the largest. */
double errorOf(const MatrixXd& found, const MatrixXd& expected, const MatrixXd& R) {
    const MatrixXd error = found - expected;
    double largest = 0;
    for (int c = 0; c < error.cols(); c++)
        largest = max(largest, sqrt(error.col(c).dot(R * error.col(c)) /
                                    expected.col(c).dot(R * expected.col(c))));
    return largest;
}

/** Poses displaced by these moves, in rows of twists. */
vector<Pose> displaced(const Mixture& m, const CoupledBodies& bodies, const MatrixXd& moves) {
    vector<Pose> poses = m.poses;
    for (size_t e = 0; e < poses.size(); e++) {
        const VectorXd move = moves.col(0).segment(bodies.firstRow(e), m.elements[e].numRows());
        poses[e].R += move.head<3>();
        if (m.elements[e].isFree()) continue;
        const Vector3d turn = move.tail<3>();
        poses[e].q =
            scalar::exponential(scalar::Vector3<double>{turn.x() / 2, turn.y() / 2, turn.z() / 2}) *
            poses[e].q;
    }
    return poses;
}

const auto boundaries = {Mixture::Unbounded, Mixture::Wall, Mixture::Box, Mixture::BoxOfGaussians};

}  // namespace

TEST(LubricatedBodies, VelocitiesHaveTheTolerance) {
    for (auto boundary : boundaries)
        for (double gap : {1.0, 1e-2, 1e-4})
            for (double tolerance : {1e-3, 1e-6, 1e-9}) {
                const Mixture m = mixture(boundary, gap);
                TestedBodies bodies = m.make(tolerance);
                const MatrixXd R = bodies.friction(), N = bodies.mobility(),
                               F = randomVectors(N.rows(), 3, 5);
                MatrixXd U;
                bodies.byProducts().solve(F, U);
                const double error = errorOf(U, N * F, R);
                EXPECT_LT(error, tolerance + 1e-11) << boundary << " " << gap;
            }
}

/**
 * A crystal of spheres that nearly touch, some of which are shells of blobs. There the bound of the
 * error needs the smallest singular value.
 */
TEST(LubricatedBodies, VelocitiesInACrystalHaveTheTolerance) {
    vector<Vector3d> shell;
    const double golden = (1 + sqrt(5.0)) / 2;
    for (double a : {-1.0, 1.0})
        for (double b : {-golden, golden})
            for (const Vector3d& x : {Vector3d(a, b, 0), Vector3d(0, a, b), Vector3d(b, 0, a)})
                shell.push_back(0.7 * x.normalized());
    for (double gap : {1e-3, 1e-6}) {
        Mixture m;
        m.boundary = Mixture::Box;
        const int cells = 2;
        const double edge = sqrt(2.0) * (2 + gap);
        m.box = {Vec3(cells * edge, 0, 0), Vec3(0, cells * edge, 0), Vec3(0, 0, cells * edge)};
        for (int i = 0; i < cells; i++)
            for (int j = 0; j < cells; j++)
                for (int k = 0; k < cells; k++)
                    for (const Vector3d& x : {Vector3d(0, 0, 0), Vector3d(0, 0.5, 0.5),
                                              Vector3d(0.5, 0, 0.5), Vector3d(0.5, 0.5, 0)}) {
                        const Vector3d at = edge * (x + Vector3d(i, j, k));
                        if (m.elements.size() % 7 == 3)
                            m.add(shell, vector<double>(shell.size(), 0.35), at,
                                  {0.3, 1.0 * i, 0.1 * j});
                        else
                            m.add({{0, 0, 0}}, {1}, at);
                    }
        for (double tolerance : {1e-3, 1e-6}) {
            TestedBodies bodies = m.make(tolerance);
            const MatrixXd R = bodies.friction(), F = randomVectors(R.rows(), 2, 5);
            MatrixXd U;
            bodies.byProducts().solve(F, U);
            EXPECT_LT(errorOf(U, bodies.mobility() * F, R), tolerance) << gap;
        }
    }
}

/** The difference of N F between displaced poses, without the rod's turn about its line. */
TEST(LubricatedBodies, DifferencesAreThoseOfMatrices) {
    const double step = 1e-4;
    for (auto boundary : boundaries) {
        const Mixture m = mixture(boundary, 0.05);
        TestedBodies bodies = m.make(1e-9);
        const MatrixXd R = bodies.friction(), N = bodies.mobility(),
                       F = N * R * randomVectors(N.rows(), 1, 6),
                       moves = randomVectors(N.rows(), 1, 7);
        const vector<Pose> ends[2] = {displaced(m, *bodies, 0.5 * step * moves),
                                      displaced(m, *bodies, -0.5 * step * moves)};
        MatrixXd found[2], U;
        int k = 0;
        for (BodyMobility* mobility : {&bodies.byMatrices(), &bodies.byProducts()}) {
            mobility->solve(F, U);
            MatrixXd lambda, change;
            mobility->getBlobForces(lambda);
            mobility->differenceNearby(ends[0], ends[1], lambda, false, change);
            found[k++] = N * (R * change) / step;
        }
        EXPECT_LT((found[1] - found[0]).norm(), 1e-6 * found[0].norm()) << boundary;
        // The same for a wrench other than that of the last solve.
        bodies.byProducts().solve(randomVectors(N.rows(), 1, 8), U);
        MatrixXd change;
        bodies.byProducts().differenceNearby(ends[0], ends[1], F, false, change);
        EXPECT_LT((N * (R * change) / step - found[0]).norm(), 1e-6 * found[0].norm());
    }
}

/** Lubrication acts on velocities relative to the flow, and forces on the fluid contain it. */
TEST(LubricatedBodies, FlowsAreThoseOfMatrices) {
    for (auto boundary : {Mixture::Unbounded, Mixture::Wall}) {
        const double tolerance = 1e-7;
        const Mixture m = mixture(boundary, 0.02);
        TestedBodies bodies = m.make(tolerance);
        DrivenFlow flow;
        flow.velocity = {0.3, -0.1, 0};
        flow.gradient(0, 2) = 0.4;
        const MatrixXd F = randomVectors(bodies->getNumRows(), 1, 9);
        MatrixXd slips[2];
        FlowSources sources[2];
        int k = 0;
        for (BodyMobility* mobility : {&bodies.byMatrices(), &bodies.byProducts()}) {
            mobility->flow().slipsOf(flow, slips[k]);
            sources[k] = mobility->flow().sourcesOf(F, &flow, false);
            k++;
        }
        EXPECT_LT(errorOf(slips[1], slips[0], bodies.friction()), tolerance);
        EXPECT_LT((sources[1].forces - sources[0].forces).norm(), 1e-5 * sources[0].forces.norm());
    }
}

/**
 * A sphere, a shell and a free particle are held. Components of other bodies are fixed, also those
 * of spheres: as of rollers, and along axes that turn with the body. Held spheres have lubrication,
 * and slips of bodies are those of all bodies.
 */
TEST(LubricatedBodies, BesideHeldBodiesTheyAreThoseOfMatrices) {
    const double tolerance = 1e-9;
    for (auto boundary : {Mixture::Unbounded, Mixture::Wall, Mixture::BoxOfGaussians})
        for (double gap : {0.05, 1e-3}) {
            const double step = 2e-3 * gap;
            const Mixture all = mixture(boundary, gap);
            Mixture m;
            m.boundary = boundary;
            m.box = all.box;
            const size_t held[] = {0, 4, 6};
            for (bool areHeld : {true, false})
                for (size_t e = 0; e < all.elements.size(); e++) {
                    if ((find(begin(held), end(held), e) != end(held)) != areHeld) continue;
                    m.elements.push_back(all.elements[e]);
                    m.poses.push_back(all.poses[e]);
                    if (areHeld) m.elements.back().hold();
                    if (e == 1) m.elements.back().fixed = 1u << 2 | 1u << 4;
                    if (e == 2) m.elements.back().fixed = 1u << 1 | 1u << 3;
                    if (e == 3) {
                        m.elements.back().fixed = 1u << 0 | 1u << 5;
                        m.elements.back().fixedInBody = true;
                        m.elements.back().axes =
                            Eigen::AngleAxisd(0.7, Vector3d(1, 2, -1).normalized())
                                .toRotationMatrix();
                    }
                }
            TestedBodies bodies = m.make(tolerance);
            ASSERT_TRUE(boundary >= Mixture::Box || bodies->hasProducts());
            const int n = bodies->getNumRows();
            const MatrixXd F = randomVectors(n, 2, 5), s = randomVectors(n, 2, 6),
                           moves = 0.5 * step * randomVectors(n, 1, 7);
            const vector<Pose> forward = displaced(m, *bodies, moves),
                               backward = displaced(m, *bodies, -moves);
            MatrixXd U[2], withSlips[2], forces[2], products[2], there[2], change[2];
            int k = 0;
            for (BodyMobility* mobility : {&bodies.byMatrices(), &bodies.byProducts()}) {
                mobility->multiply(F, products[k]);
                mobility->solve(F, U[k]);
                MatrixXd lambda;
                mobility->getBlobForces(lambda);
                mobility->multiplyNearby(forward, F, there[k]);
                mobility->differenceNearby(forward, backward, lambda.leftCols(1), false, change[k]);
                mobility->solve(F, s, withSlips[k]);
                mobility->getBlobForces(forces[k]);
                k++;
            }
            // Relative to the slips, which all bodies have.
            EXPECT_LT((withSlips[1] - withSlips[0]).norm(), 1e-7 * withSlips[0].norm());
            EXPECT_LT((forces[1] - forces[0]).norm(), 1e-6 * forces[0].norm());
            EXPECT_LT((U[1] - U[0]).norm(), 1e-8 * U[0].norm());
            EXPECT_LT((products[1] - products[0]).norm(), 1e-8 * U[0].norm());
            EXPECT_LT((there[1] - there[0]).norm(), 1e-8 * there[0].norm());
            // Without the rod's turn about its line.
            const MatrixXd R = bodies.friction();
            EXPECT_LT((R * (change[1] - change[0])).norm(), 1e-5 * (R * change[0]).norm());
        }
}

/** Multiblobs add few iterations to those of the spheres. */
TEST(LubricatedBodies, IterationsAreAtMostTwiceThoseOfSpheres) {
    Mixture spheres;
    mt19937 random(4);
    uniform_real_distribution<double> u(0, 1);
    vector<Vector3d> centres;
    // Columns of spheres with gaps of 1e-3, between which bodies of blobs have room.
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++)
            for (int k = 0; k < 4; k++)
                centres.push_back(
                    Vector3d(4.5 * i + 0.5 * u(random), 4.5 * j + 0.5 * u(random), 2.001 * k));
    for (size_t i = 0; i < centres.size(); i++) {
        if (i % 4 > 0) {  // on top of the one below it
            centres[i].head<2>() = centres[i - 1].head<2>();
        }
        spheres.add({{0, 0, 0}}, {1}, centres[i]);
    }
    Mixture mixed = spheres;
    vector<Vector3d> tetrahedron = {{1, 1, 1}, {-1, -1, 1}, {-1, 1, -1}, {1, -1, -1}};
    for (Vector3d& x : tetrahedron) x *= 0.4;
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++)
            for (int k = 0; k < 3; k++)
                mixed.add(tetrahedron, vector<double>(4, 0.5),
                          {4.5 * i + 2.3, 4.5 * j + 2.3, 2.5 * k},
                          {3 * u(random), u(random), u(random)});
    for (double tolerance : {1e-3, 1e-6}) {
        long long products[2];
        int k = 0;
        for (const Mixture& m : {spheres, mixed}) {
            TestedBodies bodies = m.make(tolerance);
            MatrixXd U;
            bodies.byProducts().solve(randomVectors(bodies->getNumRows(), 1, 10), U);
            products[k++] = bodies.byProducts().getCosts().products;
        }
        EXPECT_LE(products[1], 2 * products[0]) << tolerance;
    }
}
