// The cost for one body of taking in changes by others: the pose from positions, and the twist from
// velocities.

#include <benchmark/benchmark.h>

#include <cmath>
#include <vector>

#include "rigidbody/PoseFit.h"

using namespace RigidHIPlugin;
using OpenMM::Vec3;

namespace {

BodyGeometry point() { return {18.0, Vec3(), {Vec3()}}; }
BodyGeometry line() { return {18.0, Vec3(0, 0.18, 0.18), {Vec3(-0.1, 0, 0), Vec3(0.1, 0, 0)}}; }
BodyGeometry triangle() {
    return {18.0,
            Vec3(0.03, 0.045, 0.075),
            {Vec3(0.1, 0, 0), Vec3(-0.05, 0.05, 0), Vec3(-0.05, -0.05, 0)}};
}
/** A regular polygon: a large molecule. */
BodyGeometry ring(int sites) {
    BodyGeometry g = {18.0, Vec3(0.09, 0.09, 0.18), {}};
    for (int i = 0; i < sites; i++)
        g.sites.push_back(Vec3(std::cos(2 * M_PI * i / sites), std::sin(2 * M_PI * i / sites), 0));
    return g;
}
BodyGeometry ring42() { return ring(42); }

PoseFit makeFit(const BodyGeometry& g) {
    return PoseFit(g, std::vector<double>(g.sites.size(), g.mass / g.sites.size()),
                   std::vector<bool>(g.sites.size(), false));
}

void pose(benchmark::State& state, BodyGeometry (*shape)()) {
    const BodyGeometry g = shape();
    const PoseFit fit = makeFit(g);
    std::vector<Vec3> positions;
    for (const Vec3& s : g.sites)
        positions.push_back(Vec3(1 - s[1], 2 + s[0], 3 + s[2]));  // turned by 90 degrees about z
    for (auto _ : state) {
        BodyState body;
        int worst;
        benchmark::DoNotOptimize(fit.fitPose(positions, body, worst));
    }
}
void twist(benchmark::State& state, BodyGeometry (*shape)()) {
    const BodyGeometry g = shape();
    const PoseFit fit = makeFit(g);
    std::vector<Vec3> velocities;
    for (const Vec3& s : g.sites) velocities.push_back(Vec3(1 - 2 * s[1], 2 * s[0], 0));
    BodyState body;
    for (auto _ : state) {
        Vec3 velocity, omega_lab;
        fit.fitTwist(velocities, body, velocity, omega_lab);
        benchmark::DoNotOptimize(omega_lab);
    }
}
BENCHMARK_CAPTURE(pose, point, point);
BENCHMARK_CAPTURE(pose, line, line);
BENCHMARK_CAPTURE(pose, triangle, triangle);
BENCHMARK_CAPTURE(pose, ring42, ring42);
BENCHMARK_CAPTURE(twist, point, point);
BENCHMARK_CAPTURE(twist, line, line);
BENCHMARK_CAPTURE(twist, triangle, triangle);
BENCHMARK_CAPTURE(twist, ring42, ring42);

}  // namespace

BENCHMARK_MAIN();
