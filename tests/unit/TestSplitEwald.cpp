// Periodic Rotne-Prager-Yamakawa by pairs and waves: against lattice sums, both parts positive, the covariance of the waves' field.

#include <Eigen/Dense>
#include <cmath>
#include <cstdlib>
#include <random>
#include <thread>

#include "TestSupport.h"
#include "mobility/models/ewald/NearField.h"
#include "mobility/models/ewald/RotnePragerYamakawaGrid.h"
#include "mobility/models/ewald/WaveField.h"
#include "mobility/models/forcecoupling/CpuGridFluid.h"
#include "mobility/models/periodic/PeriodicMobility.h"

using namespace Eigen;
using namespace OpenMM;
using namespace RigidHIPlugin;
using namespace std;

namespace {

const double eta = 0.7;

BoxVectors orthogonal(double x, double y, double z) { return {{Vec3(x, 0, 0), Vec3(0, y, 0), Vec3(0, 0, z)}}; }

/** Particles at random places, in and out of the box, overlapping as they come. */
struct Scene {
    const char* what;
    HydrodynamicParticles particles;
    Placement placement;

    enum Kind { Blobs, Spheres, Mixed };
    Scene(const char* what, int number, const BoxVectors& box, Kind kind, const vector<double>& radii, unsigned seed)
        : what(what) {
        mt19937 random(seed);
        uniform_real_distribution<double> uniform(-1, 2);
        placement.box = box;
        for (int i = 0; i < number; i++) {
            particles.add(radii[i % radii.size()], kind == Spheres || (kind == Mixed && i % 3 > 0), i, i);
            placement.positions.push_back(
                Vec3(uniform(random) * box[0][0], uniform(random) * box[1][1], uniform(random) * box[2][2]));
        }
    }
};

vector<Scene> scenes() {
    return {{"blobs in a cube, 0.2", 100, orthogonal(12.8, 12.8, 12.8), Scene::Blobs, {1}, 1},
            {"blobs, dilute", 40, orthogonal(40, 35, 52), Scene::Blobs, {1}, 2},
            {"spheres", 50, orthogonal(9, 10.5, 12), Scene::Spheres, {1}, 3},
            {"unequal blobs", 60, orthogonal(14, 10, 11), Scene::Blobs, {1, 0.6, 1.7}, 4},
            {"unequal spheres and blobs", 36, orthogonal(9, 12, 10), Scene::Mixed, {1, 1.4}, 5},
            {"crowded blobs", 120, orthogonal(5, 5.5, 6), Scene::Blobs, {1}, 6},
            {"a box that pairs reach across", 3, orthogonal(2.6, 3, 2.4), Scene::Mixed, {1, 0.5}, 7},
            {"one sphere", 1, orthogonal(5, 6, 7), Scene::Spheres, {1}, 8}};
}

VectorXd roots(const HydrodynamicParticles& particles) {
    VectorXd root(particles.numRows);
    for (int p = 0; p < particles.size(); p++) {
        const double a = particles.radii[p];
        root.segment<3>(particles.firstRow[p]).setConstant(sqrt(6 * M_PI * eta * a));
        if (particles.hasTorque[p])
            root.segment<3>(particles.firstRow[p] + 3).setConstant(sqrt(8 * M_PI * eta * a * a * a));
    }
    return root;
}
/** Entries over the roots of the particles' own mobilities. */
MatrixXd scaled(const MatrixXd& difference, const HydrodynamicParticles& particles) {
    const VectorXd root = roots(particles);
    return root.asDiagonal() * difference * root.asDiagonal();
}
double normOf(const MatrixXd& symmetric) {
    return SelfAdjointEigenSolver<MatrixXd>(symmetric, EigenvaluesOnly).eigenvalues().cwiseAbs().maxCoeff();
}

MatrixXd latticeSum(const Scene& scene) {
    MatrixXd M;
    PeriodicRotnePragerYamakawa(scene.particles, eta).at(scene.placement)->dense(M);
    return M;
}

shared_ptr<GridFluid> plainFluid() { return make_shared<PlainGridFluid>(); }
GridThreads onThreads(int number) {
    return [number](int count, const function<void(int, int)>& task) {
        vector<thread> threads;
        for (int t = 0; t < number; t++)
            threads.emplace_back([&, t] { task(count * t / number, count * (t + 1) / number); });
        for (thread& one : threads) one.join();
    };
}

}  // namespace

TEST(SplitEwald, TablesAreThePairsToRounding) {
    const vector<EwaldKind> kinds = {{0.4, 1, 1}, {1, 1, 1}};
    for (double xi : {0.1, 0.5, 2.0}) {
        const double gap = 5 / xi;
        const NearTables tables(kinds, 6, xi, gap, 0.1), ofForces(kinds, 2, xi, gap, 0.1);
        for (int i = 0; i < 2; i++)
            for (int j = 0; j < 2; j++) {
                const double a = kinds[i].radius, b = kinds[j].radius;
                const NearPair pair(a, b, xi, true);
                for (double r = 0; r < gap + a + b + 0.1; r += 0.0371 / xi) {
                    double f[6];
                    tables.at<6>(i, j, r, f);
                    double g2[2];
                    ofForces.at<2>(i, j, r, g2);
                    const PairFunctions g = pair.at(r);
                    const double expected[] = {g.ttI, g.ttR, g.tr, g.rt, g.rrI, g.rrR};
                    const PairFunctions h = overSurfaces().free(a, b, a + b, true, false);
                    const double scale[] = {h.ttI, h.ttR, h.tr, h.rt, h.rrI, h.rrR};
                    EXPECT_EQ(g2[0], f[0]);
                    EXPECT_EQ(g2[1], f[1]);
                    for (int c = 0; c < 6; c++)
                        EXPECT_NEAR(f[c], expected[c], 1e-10 * abs(scale[c])) << xi << " " << a << " " << b << " " << r << " " << c;
                }
            }
    }
}

TEST(SplitEwald, ProductsHaveTheTolerance) {
    for (const Scene& scene : scenes()) {
        const MatrixXd exact = latticeSum(scene), m = scaled(exact, scene.particles);
        const double norm = normOf(m);
        for (double tolerance : {1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8}) {
            const RotnePragerYamakawaGrid model(scene.particles, eta, tolerance, 0, plainFluid());
            MatrixXd M;
            model.at(scene.placement)->dense(M);
            const double error = normOf(scaled(0.5 * (M + M.transpose()) - exact, scene.particles));
            EXPECT_LE(error, tolerance * norm) << scene.what << " " << tolerance;
            EXPECT_LE((M - M.transpose()).norm(), 1e-14 * M.norm()) << scene.what << " " << tolerance;
            if (getenv("RIGIDHI_PRINT"))
                printf("%-32s %.0e  error %.2e of the norm, %.2e of own (norm %.2f)  %s\n", scene.what, tolerance,
                       error / norm, error, norm, model.describe(scene.placement.box).c_str());
        }
    }
}

TEST(SplitEwald, ThreadsDoNotChangeABit) {
    for (const Scene& scene : scenes()) {
        const VectorXd forces = VectorXd::LinSpaced(scene.particles.numRows, 1, 3);
        MatrixXd first, velocities;
        for (int threads : {1, 2, 3, 5}) {
            const RotnePragerYamakawaGrid model(scene.particles, eta, 1e-4, 0,
                                                make_shared<CpuGridFluid>(onThreads(threads)));
            model.at(scene.placement)->apply(forces, velocities);
            if (threads == 1) first = velocities;
            EXPECT_EQ(velocities, first) << scene.what << " " << threads;
        }
    }
}
