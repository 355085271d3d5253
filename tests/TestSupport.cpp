#include "TestSupport.h"

#include "Instrumented.h"
#include "openmmrigidhi/SchemeTraits.h"

#include <openmm/Force.h>
#include <openmm/internal/ContextImpl.h>
#include <openmm/internal/ForceImpl.h>
#include <openmm/reference/SimTKOpenMMRealType.h>

#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <iostream>

#ifdef __GLIBC__
#if __GLIBC_PREREQ(2, 33)
#include <malloc.h>
#define RIGIDHI_COUNTS_BYTES
#endif
#endif

using namespace OpenMM;
using namespace std;

namespace RigidHITest {

const double boltzmann = BOLTZ, T1 = 1 / (BOLTZ);

// Programs without TestPlatform.cpp use Reference.
__attribute__((weak)) string testPlatformName() { return "Reference"; }

Platform& platform(const string& name) {
    static bool loaded = [] {
        // An OpenMM installed under a prefix has its plugins beside its library, but does not know
        // the prefix.
        const string beside = OPENMM_PLUGINS_BESIDE;
        const bool known = getenv("OPENMM_PLUGIN_DIR") || !filesystem::is_directory(beside);
        const string ofOpenMM = known ? Platform::getDefaultPluginsDirectory() : beside;
        const auto loadIfThere = [](const string& directory, const string& name) {
            const string library = directory + "/libOpenMM" + name + ".so";
            if (filesystem::exists(library)) Platform::loadPluginLibrary(library);
        };
        // Only programs of devices need plugins for devices: OpenCL's driver brings a compiler,
        // and loading it takes longer than many a test.
        if (onDevice())
            Platform::loadPluginsFromDirectory(ofOpenMM);
        else
            for (const char* p : {"CPU", "PME"}) loadIfThere(ofOpenMM, p);
        for (const char* p : {"Reference", "CPU", "Any"})
            loadIfThere(RIGIDHI_PLUGIN_DIR, string("RigidHI") + p);
        for (const char* p : {"OpenCL", "CUDA", "HIP"})
            if (onDevice()) loadIfThere(RIGIDHI_PLUGIN_DIR, string("RigidHI") + p);
        return true;
    }();
    (void)loaded;
    Platform& found = Platform::getPlatformByName(name);
    if (name != "Reference" && name != "CPU")
        found.setPropertyDefaultValue("Precision", testPrecision());
    return found;
}

string testPrecision() {
    const char* precision = getenv("RIGIDHI_TEST_PRECISION");
    return precision ? precision : "double";
}

double bytesInUse() {
#ifdef RIGIDHI_COUNTS_BYTES
    if (isInstrumented()) return 0;
    const struct mallinfo2 info = mallinfo2();
    return static_cast<double>(info.uordblks) + static_cast<double>(info.hblkhd);
#else
    return 0;
#endif
}

bool isInstrumented() {
#ifdef RIGIDHI_INSTRUMENTED
    return true;
#else
    return false;
#endif
}

map<string, string> threads(const string& platformName, int count) {
    if (platformName != "CPU") return {};
#ifdef __SANITIZE_THREAD__
    count = max(count, 2);  // one thread has no races
#endif
    return {{"Threads", to_string(count)}};
}

vector<CustomRigidHIIntegrator::Scheme> thermostats() {
    vector<CustomRigidHIIntegrator::Scheme> found;
    for (const RigidHIPlugin::SchemeTraits& traits : RigidHIPlugin::schemeTable)
        if (!traits.needsFluid()) found.push_back(traits.scheme);
    return found;
}

vector<CustomRigidHIIntegrator::Scheme> thermostatsWithMomenta() {
    vector<CustomRigidHIIntegrator::Scheme> found;
    for (const CustomRigidHIIntegrator::Scheme scheme : thermostats())
        if (RigidHIPlugin::traitsOf(scheme).hasMomenta) found.push_back(scheme);
    return found;
}

Estimate estimate(const vector<double>& samples) {
    Estimate e;
    for (double x : samples) e.mean += x / samples.size();
    double variance = 0;
    for (double x : samples) variance += (x - e.mean) * (x - e.mean) / (samples.size() - 1);
    e.error = sqrt(variance / samples.size());
    return e;
}

void expectMean(const string& what, const Estimate& measured, double expected) {
    const double z = (measured.mean - expected) / measured.error;
    cout << what << ": " << measured.mean << " +- " << measured.error << ", expected " << expected
         << ", z = " << z << endl;
    EXPECT_LT(abs(z), 5.0) << what;
}

void expectError(const function<void()>& action, const vector<string>& fragments) {
    try {
        action();
    } catch (const OpenMMException& e) {
        for (const string& fragment : fragments)
            EXPECT_NE(string(e.what()).find(fragment), string::npos)
                << "the message \"" << e.what() << "\" does not mention \"" << fragment << "\"";
        return;
    }
    ADD_FAILURE() << "no exception was thrown; expected one that mentions \"" << fragments[0]
                  << "\"";
}

double norm(const Vec3& v) { return sqrt(v.dot(v)); }

QuaternionArray product(const QuaternionArray& a, const QuaternionArray& b) {
    return {{a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
             a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
             a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
             a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0]}};
}

Vec3 rotate(const QuaternionArray& q, const Vec3& v) {
    const QuaternionArray r =
        product(product(q, {{0, v[0], v[1], v[2]}}), {{q[0], -q[1], -q[2], -q[3]}});
    return Vec3(r[1], r[2], r[3]);
}

QuaternionArray randomQuaternion(mt19937& generator) {
    normal_distribution<double> normal;
    QuaternionArray q;
    double length = 0;
    for (double& x : q) {
        x = normal(generator);
        length += x * x;
    }
    for (double& x : q) x /= sqrt(length);
    return q;
}

Shape waterShape() {
    const double angle = 104.52 * M_PI / 180, bond = 0.09572;
    return {"water",
            {15.9994, 1.008, 1.008},
            {Vec3(), Vec3(bond, 0, 0), Vec3(bond * cos(angle), bond * sin(angle), 0)}};
}

vector<Shape> allShapes() {
    vector<Shape> shapes = {waterShape()};
    shapes.push_back({"single atom", {39.9}, {Vec3()}});
    shapes.push_back({"two sites", {1.0, 35.0}, {Vec3(), Vec3(0.127, 0, 0)}});
    shapes.push_back({"CO2", {16.0, 12.0, 16.0}, {Vec3(0, 0, -0.116), Vec3(), Vec3(0, 0, 0.116)}});
    const double t = 0.109 / sqrt(3.0);
    shapes.push_back({"CH4",
                      {12.0, 1.0, 1.0, 1.0, 1.0},
                      {Vec3(), Vec3(t, t, t), Vec3(t, -t, -t), Vec3(-t, t, -t), Vec3(-t, -t, t)}});
    Shape benzene{"benzene", {}, {}};
    for (int i = 0; i < 6; i++)
        for (double radius : {0.139, 0.248}) {
            benzene.masses.push_back(radius < 0.2 ? 12.0 : 1.0);
            benzene.sites.push_back(
                Vec3(radius * cos(i * M_PI / 3), radius * sin(i * M_PI / 3), 0));
        }
    shapes.push_back(benzene);
    Shape octahedron{"octahedron", {32.0}, {Vec3()}};
    for (int k = 0; k < 3; k++)
        for (double sign : {-1.0, 1.0}) {
            Vec3 site;
            site[k] = 0.156 * sign;
            octahedron.masses.push_back(19.0);
            octahedron.sites.push_back(site);
        }
    shapes.push_back(octahedron);
    // A needle with moments about 1e-9 : 1 : 1 in each of the three directions of the starting
    // frame.
    for (int k = 0; k < 3; k++) {
        const double half = 0.5, thin = half * sqrt(1e-9);
        Shape needle{"needle along " + string(1, "xyz"[k]), {10, 10, 1, 1}, vector<Vec3>(4)};
        needle.sites[0][k] = -half;
        needle.sites[1][k] = half;
        needle.sites[2][(k + 1) % 3] = thin * sqrt(10.0);
        needle.sites[3][(k + 1) % 3] = -thin * sqrt(10.0);
        shapes.push_back(needle);
    }
    Shape large{"large", {}, {}};
    mt19937 generator(5);
    uniform_real_distribution<double> uniform(-2, 2);
    for (int i = 0; i < 200; i++) {
        large.masses.push_back(12.0);
        large.sites.push_back(
            Vec3(uniform(generator), 0.6 * uniform(generator), 0.3 * uniform(generator)));
    }
    shapes.push_back(large);
    return shapes;
}

void addBodies(System& system, CustomRigidHIIntegrator& integrator, const Shape& shape,
               int copies) {
    for (int c = 0; c < copies; c++) {
        vector<int> particles;
        for (double mass : shape.masses) particles.push_back(system.addParticle(mass));
        integrator.addRigidBody(particles);
    }
}

vector<Vec3> randomPoses(const Shape& shape, int copies, double spacing, int seed) {
    mt19937 generator(seed);
    vector<Vec3> positions;
    for (int c = 0; c < copies; c++) {
        const QuaternionArray q = randomQuaternion(generator);
        for (const Vec3& site : shape.sites)
            positions.push_back(rotate(q, site) + Vec3(spacing * c, 0, 0));
    }
    return positions;
}

double largestDistortion(const vector<Vec3>& positions, const Shape& shape, int copies) {
    double worst = 0;
    const int n = shape.sites.size();
    for (int c = 0; c < copies; c++)
        for (int i = 0; i < n; i++)
            for (int j = max(0, i - 20); j < i; j++)
                worst = max(worst, abs(norm(positions[c * n + i] - positions[c * n + j]) -
                                       norm(shape.sites[i] - shape.sites[j])));
    return worst;
}

namespace {

/** A Force may ask for the implementation of a Context. */
struct Opener : Force {
    ContextImpl& open(Context& context) { return getContextImpl(context); }
    bool usesPeriodicBoundaryConditions() const override { return false; }

protected:
    ForceImpl* createImpl() const override { return nullptr; }
};

}  // namespace

ContextImpl& implOf(Context& context) { return Opener().open(context); }

vector<Vec3> positionsOf(Context& context) {
    return context.getState(State::Positions).getPositions();
}
vector<Vec3> velocitiesOf(Context& context) {
    return context.getState(State::Velocities).getVelocities();
}

bool sameBits(const vector<Vec3>& a, const vector<Vec3>& b) {
    return a.size() == b.size() && memcmp(a.data(), b.data(), a.size() * sizeof(Vec3)) == 0;
}

}  // namespace RigidHITest

int main(int argc, char** argv) {
    testing::InitGoogleTest(&argc, argv);
    return RUN_ALL_TESTS();
}
