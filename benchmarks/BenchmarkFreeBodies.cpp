// The cost of a step without forces: bodies in an otherwise empty System, on one thread.
// time_per_body (seconds per body and step) is the time of the whole step, including OpenMM's
// evaluation of no forces. own_time_per_body is this plugin's part of it.

#include <benchmark/benchmark.h>
#include <openmm/Context.h>
#include <openmm/Platform.h>
#include <openmm/System.h>

#include <algorithm>
#include <cstdlib>
#include <map>
#include <string>
#include <vector>

#include "hwy/targets.h"
#include "openmmrigidhi/CustomRigidHIIntegrator.h"

using namespace OpenMM;
using namespace RigidHIPlugin;
using namespace std;

namespace {

/**
 * A body: its sites (nm) and moments (amu nm^2). Masses are equal, and sizes are those of small
 * molecules.
 */
struct Shape {
    string name;
    Vec3 moments;
    vector<Vec3> sites;
};

const double bodyMass = 18.0;  // amu

const Shape shapes[] = {
    {"general3",
     Vec3(0.01, 0.02, 0.03),
     {Vec3(0.1, 0, 0), Vec3(-0.05, 0.05, 0), Vec3(-0.05, -0.05, 0)}},
    {"ellipsoid", Vec3(0.01, 0.02, 0.03), {Vec3()}},
    {"linear2", Vec3(0, 0.02, 0.02), {Vec3(0.1, 0, 0), Vec3(-0.1, 0, 0)}},
    {"point", Vec3(), {Vec3()}},
};

struct Case {
    string platform;
    const Shape* shape;
    int count;
    CustomRigidHIIntegrator::Scheme scheme;
    bool thermostat;
    CustomRigidHIIntegrator::NoiseLaw law;
};

void step(benchmark::State& state, const Case& scene) {
    const double temperature = 300, stepSize = 0.002, gamma = 5, Gamma = 10;
    const int bodyStepsPerIteration = 10000;
    System system;
    CustomRigidHIIntegrator integrator(temperature, stepSize);
    vector<Vec3> positions;
    for (int i = 0; i < scene.count; i++) {
        vector<int> particles;
        for (const Vec3& site : scene.shape->sites) {
            particles.push_back(system.addParticle(bodyMass / scene.shape->sites.size()));
            positions.push_back(Vec3(i, 0, 0) + site);
        }
        integrator.addRigidBody(particles, bodyMass, scene.shape->moments, scene.shape->sites);
    }
    integrator.setScheme(scene.scheme);
    integrator.setNoiseLaw(scene.law);
    integrator.setFriction(scene.thermostat ? gamma : 0);
    integrator.setRotationalFriction(scene.thermostat ? Gamma : 0);
    integrator.setRandomNumberSeed(1);
    map<string, string> properties;
    if (scene.platform == "CPU") properties["Threads"] = "1";
    Context context(system, integrator, Platform::getPlatformByName(scene.platform), properties);
    context.setPositions(positions);
    if (scene.scheme != CustomRigidHIIntegrator::GradientThermostat)
        context.setVelocitiesToTemperature(temperature, 1);
    const int steps = max(1, bodyStepsPerIteration / scene.count);
    integrator.step(steps);

    const double ownBefore = integrator.getStepStatistics()["seconds_scheme"];
    for (auto _ : state) integrator.step(steps);
    const double bodySteps = static_cast<double>(state.iterations()) * steps * scene.count;
    const auto secondsPer = benchmark::Counter::kIsRate | benchmark::Counter::kInvert;
    state.counters["time_per_body"] = benchmark::Counter(bodySteps, secondsPer);
    state.counters["own_time_per_body"] =
        (integrator.getStepStatistics()["seconds_scheme"] - ownBefore) / bodySteps;
}

void add(const string& label, const Case& scene) {
    benchmark::RegisterBenchmark(("FreeBodies/" + scene.platform + "/" + scene.shape->name + "/" +
                                  label + "/n:" + to_string(scene.count))
                                     .c_str(),
                                 step, scene)
        ->UseRealTime();
}

}  // namespace

int main(int argc, char** argv) {
    // The variable is that of instructions.py. Better instruction sets have lower bits.
    if (std::getenv("RIGIDHI_BENCHMARKS_AVX2")) hwy::DisableTargets(HWY_AVX2 - 1);
    Platform::loadPluginsFromDirectory(
        Platform::getDefaultPluginsDirectory());  // OpenMM's own CPU platform
    for (const char* name : {"Reference", "CPU"})
        Platform::loadPluginLibrary(string(RIGIDHI_PLUGIN_DIR) + "/libOpenMMRigidHI" + name +
                                    ".so");
    using I = CustomRigidHIIntegrator;
    const int middle = 1000;
    for (const char* platform : {"CPU", "Reference"}) {
        for (const Shape& shape : shapes)
            for (int count : {1, 10, 100, 1000, 10000})
                add("LangevinC", {platform, &shape, count, I::LangevinC, true, I::Gaussian});
        const Shape& general = shapes[0];
        add("LangevinA", {platform, &general, middle, I::LangevinA, true, I::Gaussian});
        add("LangevinB", {platform, &general, middle, I::LangevinB, true, I::Gaussian});
        add("GradientThermostat",
            {platform, &general, middle, I::GradientThermostat, true, I::Gaussian});
        add("LangevinC_without_friction",
            {platform, &general, middle, I::LangevinC, false, I::Gaussian});
        add("LangevinC_ThreePoint",
            {platform, &general, middle, I::LangevinC, true, I::ThreePoint});
    }
    benchmark::Initialize(&argc, argv);
    if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
    benchmark::RunSpecifiedBenchmarks();
    benchmark::Shutdown();
    return 0;
}
