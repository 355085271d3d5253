#ifndef RIGIDHI_TEST_SUPPORT_H_
#define RIGIDHI_TEST_SUPPORT_H_

#include <gtest/gtest.h>
#include <openmm/Context.h>
#include <openmm/OpenMMException.h>
#include <openmm/Platform.h>
#include <openmm/System.h>
#include <openmm/Vec3.h>

#include <cmath>
#include <functional>
#include <map>
#include <random>
#include <string>
#include <vector>

#include "openmmrigidhi/CustomRigidHIIntegrator.h"

namespace OpenMM {
class ContextImpl;
}

namespace RigidHITest {

using OpenMM::Vec3;
using RigidHIPlugin::CustomRigidHIIntegrator;
using RigidHIPlugin::QuaternionArray;

/** Boltzmann's constant in OpenMM units, kJ/(mol K), and the temperature with kT = 1. */
extern const double boltzmann, T1;

/** Load the plugin (once) and give a platform by name. */
OpenMM::Platform& platform(const std::string& name);
/**
 * The platform that a program in platform/ tests: "Reference", "CPU", "OpenCL", or the platform of
 * another device.
 */
std::string testPlatformName();
inline OpenMM::Platform& testPlatform() { return platform(testPlatformName()); }
inline bool onCpu() { return testPlatformName() == "CPU"; }
/** Whether a device computes forces, and particles are copied to and from it. */
inline bool onDevice() { return testPlatformName() != "Reference" && testPlatformName() != "CPU"; }
/** "double", except for device platforms. Their precision is given by the environment variable
 * RIGIDHI_TEST_PRECISION. */
std::string testPrecision();
/** Whether OpenMM's forces are computed in single precision. */
inline bool hasSingleForces() { return onCpu() || testPrecision() != "double"; }
/**
 * The tolerance of a comparison on this platform: on Reference and CPU the given one, on other
 * platforms at least the precision of their numbers.
 *
 * @param scale     the size of the compared values: positions or velocities read from the Context
 */
double readTolerance(double tolerance, double scale);
/**
 * The tolerance of numbers that follow from forces.
 * @param scale  the size of these numbers, in the units of the comparison
 */
double forceTolerance(double tolerance, double scale);
/** Skips a test whose promise does not hold for platforms that keep particles on a device. */
#define SKIP_ON_DEVICES(reason) \
    if (RigidHITest::onDevice()) GTEST_SKIP() << reason
#define SKIP_ON_SINGLE_PRECISION_DEVICES(reason) \
    if (RigidHITest::onDevice() && RigidHITest::testPrecision() != "double") GTEST_SKIP() << reason
/** Properties of a Context with this many threads on the CPU platform. */
std::map<std::string, std::string> threads(const std::string& platformName, int count);

/** The schemes without a fluid, and those of them that have momenta. */
std::vector<CustomRigidHIIntegrator::Scheme> thermostats();
std::vector<CustomRigidHIIntegrator::Scheme> thermostatsWithMomenta();

/** Mean and standard error of the mean. */
struct Estimate {
    double mean = 0, error = 0;
};
/** The mean of independent samples and its standard error. */
Estimate estimate(const std::vector<double>& samples);

/**
 * Statistical tests use fixed seeds and allow 5 standard errors. One test in 1.7 million would fail
 * by chance, and the whole suite (fewer than 150 tests) less than one time in 10^4. The z-score is
 * printed.
 */
void expectMean(const std::string& what, const Estimate& measured, double expected);

/** Expect an OpenMMException with all these fragments in its message. */
void expectError(const std::function<void()>& action, const std::vector<std::string>& fragments);

double norm(const Vec3& v);
Vec3 rotate(const QuaternionArray& q, const Vec3& v_body);
QuaternionArray randomQuaternion(std::mt19937& generator);
QuaternionArray product(const QuaternionArray& a, const QuaternionArray& b);

/** A rigid shape: masses and positions of its sites. */
struct Shape {
    std::string name;
    std::vector<double> masses;
    std::vector<Vec3> sites;
};
/** Water (TIP3P geometry), asymmetric: three different moments. */
Shape waterShape();
/** Every kind of shape that a rotor can have; see TestShapes. */
std::vector<Shape> allShapes();

/** Add `copies` bodies of a shape to a System and an integrator. The bodies are implicit: the first
 * positions define their geometry. */
void addBodies(OpenMM::System& system, CustomRigidHIIntegrator& integrator, const Shape& shape,
               int copies);
/** Random orientations, origins on a line at the given spacing. */
std::vector<Vec3> randomPoses(const Shape& shape, int copies, double spacing, int seed);
/** The largest deviation of a distance between members of a body from the distance in the shape. */
double largestDistortion(const std::vector<Vec3>& positions, const Shape& shape, int copies);

/** OpenMM's inner part of a Context. */
OpenMM::ContextImpl& implOf(OpenMM::Context& context);
std::vector<Vec3> positionsOf(OpenMM::Context& context);
std::vector<Vec3> velocitiesOf(OpenMM::Context& context);
/** Whether two arrays are the same bit for bit. */
bool sameBits(const std::vector<Vec3>& a, const std::vector<Vec3>& b);

}  // namespace RigidHITest

#endif
