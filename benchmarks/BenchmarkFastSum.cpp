// Products with the Rotne-Prager-Yamakawa mobility by multipoles beside the direct sum.

#include <openmm/internal/ThreadPool.h>

#include <Eigen/Cholesky>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <optional>
#include <random>
#include <string>

#include "mobility/fastsum/FastSum.h"
#include "mobility/models/rotneprager/CpuRotnePragerYamakawa.h"

using namespace RigidHIPlugin;
using Eigen::MatrixXd;
using OpenMM::ThreadPool;
using OpenMM::Vec3;

namespace {

double option(int argc, char** argv, const char* name, double value) {
    for (int i = 1; i + 1 < argc; i++)
        if (!strcmp(argv[i], name)) return atof(argv[i + 1]);
    return value;
}
double seconds() { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); }

}  // namespace

int main(int argc, char** argv) {
    const int n = option(argc, argv, "n", 2000), kind = option(argc, argv, "kind", 0),
              scene = option(argc, argv, "scene", 0);
    const int threads = option(argc, argv, "threads", 1), columns = option(argc, argv, "columns", 1);
    const int repeats = option(argc, argv, "repeats", 1);
    const bool hasWall = option(argc, argv, "wall", 0), polydisperse = option(argc, argv, "poly", 0);
    const bool direct = option(argc, argv, "direct", 1);
    FastSum::Accuracy accuracy;
    accuracy.order = option(argc, argv, "order", 6);
    accuracy.opening = option(argc, argv, "opening", 0.75);
    accuracy.leafSize = option(argc, argv, "leaf", 64);
    accuracy.single = option(argc, argv, "single", 0);
    std::mt19937 random(1);
    std::uniform_real_distribution<double> u(0, 1);
    std::normal_distribution<double> g;
    HydrodynamicParticles particles;
    std::vector<Vec3> positions;
    const double phi = option(argc, argv, "phi", 0.1);
    const double size = std::cbrt(n * 4 * M_PI / 3 / phi);
    for (int i = 0; i < n; i++) {
        const double a = polydisperse ? 0.3 + 1.7 * u(random) : 1;
        particles.add(a, kind == 1 || (kind == 2 && u(random) < 0.5), i, -1);
        if (scene == 0) positions.push_back(size * Vec3(u(random), u(random), u(random)) + Vec3(0, 0, a));
        if (scene == 1) {
            const double L = std::sqrt(n * M_PI / 0.4);
            positions.push_back(Vec3(L * u(random), L * u(random), a + 1.5 * u(random)));
        }
        if (scene == 2) {
            Vec3 d(g(random), g(random), g(random));
            d *= 1 / std::sqrt(d.dot(d));
            positions.push_back(std::sqrt(n / 1.6) * (d + Vec3(0, 0, 1.1)) + Vec3(0, 0, 2));
        }
        if (scene == 3) {  // clusters
            static std::vector<Vec3> centres;
            if (centres.empty())
                for (int k = 0; k < 20; k++) centres.push_back(4 * size * Vec3(u(random), u(random), u(random)));
            Vec3 r = centres[i % 20] + 0.1 * size * Vec3(g(random), g(random), g(random));
            r[2] = std::abs(r[2]) + a;
            positions.push_back(r);
        }
    }
    ThreadPool pool(threads);
    CpuRotnePragerYamakawa::ForRanges forRanges;
    if (threads > 1)
        forRanges = [&pool](int count, const std::function<void(int, int)>& task) {
            const int parts = pool.getNumThreads();
            pool.execute([&](ThreadPool&, int thread) {
                task(static_cast<int>((long long)count * thread / parts),
                     static_cast<int>((long long)count * (thread + 1) / parts));
            });
            pool.waitForThreads();
        };
    std::optional<NoSlipPlane> wall;
    if (hasWall) wall.emplace(0, false);
    const CpuRotnePragerYamakawa model(particles, 1.0, forRanges, wall);
    MatrixXd forces(particles.numRows, columns), exact, rough, fast;
    for (int c = 0; c < columns; c++)
        for (int i = 0; i < particles.size(); i++)
            for (int k = 0; k < (particles.hasTorque[i] ? 6 : 3); k++)
                forces(particles.firstRow[i] + k, c) = c == 0 ? g(random) : (k == c % 3);
    FastSum sum(particles, hasWall, accuracy, forRanges);
    double t = seconds();
    sum.moveTo(positions, std::vector<double>(n, 1.0));
    printf("move %.4f", seconds() - t);
    t = seconds();
    sum.moveTo(positions, std::vector<double>(n, 1.0));
    printf(" again %.4f\n", seconds() - t);
    double best = 1e9, bestDirect = 1e9, bestRough = 1e9;
    for (int r = 0; r < repeats; r++) {
        t = seconds();
        sum.apply(forces, 1 / (8 * M_PI), fast);
        best = std::min(best, seconds() - t);
    }
    if (option(argc, argv, "norm", 0)) {
        const int rows = particles.numRows;
        MatrixXd dense, own = MatrixXd::Identity(rows, rows), result;
        model.at({positions})->dense(dense);
        Eigen::VectorXd s(rows);
        for (int i = 0; i < n; i++)
            for (int k = 0; k < (particles.hasTorque[i] ? 6 : 3); k++)
                s[particles.firstRow[i] + k] =
                    k < 3 ? std::sqrt(particles.radii[i]) : std::sqrt(4.0 / 3 * std::pow(particles.radii[i], 3));
        sum.apply(own, 1 / (8 * M_PI), result);
        MatrixXd E = s.asDiagonal() * (result - dense) * s.asDiagonal();
        const MatrixXd S = s.asDiagonal() * dense * s.asDiagonal();
        const auto norm = [&](const MatrixXd& A) {
            Eigen::VectorXd v = Eigen::VectorXd::Random(rows);
            double value = 0;
            for (int i = 0; i < 60; i++) {
                v.normalize();
                const Eigen::VectorXd w = A * v;
                value = w.norm();
                v = A.transpose() * w;
            }
            return value;
        };
        const double e = norm(E), m = norm(S);
        const Eigen::LLT<MatrixXd> llt(S);
        MatrixXd whitened = llt.matrixL().solve(E);
        whitened = llt.matrixL().solve(whitened.transpose().eval());
        const double relative = norm(whitened);
        printf("norm of error %.3e of M %.3e ratio %.2e; random: %.2e; asymmetry %.2e; relative to energies %.2e\n", e,
               m, e / m, E.norm() / S.norm(), norm(E - E.transpose()) / m, relative);
    }
    const ClusterTree& tree = sum.getTree();
    double near = 0;
    for (size_t l = 0; l < tree.leaves.size(); l++)
        for (int k = tree.firstNear[l]; k < tree.firstNear[l + 1]; k++)
            near += double(tree.cells[tree.leaves[l]].end - tree.cells[tree.leaves[l]].first) *
                    (tree.cells[tree.near[k]].end - tree.cells[tree.near[k]].first);
    printf("n %d cells %zu leaves %zu far %zu classes %zu near/n %.0f of %d; memory %.0f MB\n", n, tree.cells.size(),
           tree.leaves.size(), tree.farPairs.size(), tree.classes.size(), near / n, n, sum.getMemory() / 1e6);
    printf("fast %.4f s", best);
    if (direct) {
        const auto M = model.at({positions});
        for (int r = 0; r < repeats; r++) {
            t = seconds();
            M->apply(forces, exact);
            bestDirect = std::min(bestDirect, seconds() - t);
            t = seconds();
            M->applyRoughly(forces, rough);
            bestRough = std::min(bestRough, seconds() - t);
        }
        printf(" direct %.4f s rough %.4f s; errors of columns, of it, of the worst row:", bestDirect, bestRough);
        for (int c = 0; c < columns; c++)
            printf(" %.2e %.2e", (fast - exact).col(c).norm() / exact.col(c).norm(),
                   (fast - exact).col(c).cwiseAbs().maxCoeff() / exact.col(c).cwiseAbs().maxCoeff());
    }
    printf("\n");
    return 0;
}
