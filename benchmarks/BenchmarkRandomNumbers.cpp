// The cost of random numbers, one at a time (Reference) and in packs (CPU), for each law.

#include <benchmark/benchmark.h>

#include <numeric>
#include <vector>

#include "host/SimdBodyLoops.h"
#include "random/CounterNoise.h"

using namespace RigidHIPlugin;

namespace {

const int particles = 1000, numbersPerParticle = 3;

NoiseStream stream(const benchmark::State& state) {
    NoiseStream noise;
    noise.law = static_cast<NoiseStream::Law>(state.range(0));
    return noise;
}

void finish(benchmark::State& state) {
    state.counters["time_per_number"] =
        benchmark::Counter(static_cast<double>(state.iterations()) * particles * numbersPerParticle,
                           benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
    static const char* const laws[] = {"Gaussian", "ThreePoint", "TwoPoint"};
    state.SetLabel(laws[state.range(0)]);
}

void oneAtATime(benchmark::State& state) {
    NoiseStream noise = stream(state);
    std::vector<double> xi(particles * (numbersPerParticle + 1));
    for (auto _ : state) {
        noise.step++;
        for (int i = 0; i < particles; i++)
            for (int block = 0; block < 2; block++)
                noise.pair(NoiseStream::FirstDraw, i, block, xi[4 * i + 2 * block],
                           xi[4 * i + 2 * block + 1]);
        benchmark::DoNotOptimize(xi.data());
        benchmark::ClobberMemory();
    }
    finish(state);
}
BENCHMARK(oneAtATime)->DenseRange(0, 2);

void inPacks(benchmark::State& state) {
    NoiseStream noise = stream(state);
    std::vector<double> xi(particles * numbersPerParticle);
    std::vector<int> index(particles);
    std::iota(index.begin(), index.end(), 0);
    for (auto _ : state) {
        noise.step++;
        fillSimdNoise(noise, NoiseStream::FirstDraw, index.data(), particles, xi.data());
        benchmark::DoNotOptimize(xi.data());
        benchmark::ClobberMemory();
    }
    finish(state);
}
BENCHMARK(inPacks)->DenseRange(0, 2);

}  // namespace

int main(int argc, char** argv) {
    benchmark::AddCustomContext("instruction_set", simdTargetName());
    benchmark::Initialize(&argc, argv);
    if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
    benchmark::RunSpecifiedBenchmarks();
    benchmark::Shutdown();
    return 0;
}
