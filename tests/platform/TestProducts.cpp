// Where a platform's device makes the products of iterations, steps agree with those of the host to
// the tolerance, and resume bit for bit. Elsewhere describeEffects() says why the host makes them.

#include <cstdlib>
#include <sstream>

#include "OverdampedSupport.h"

using namespace RigidHITest;
using namespace OpenMM;
using namespace std;

namespace {

/** Sets the environment variable that chooses, while Contexts are made. */
class Wish {
public:
    explicit Wish(const char* value) { setenv("RIGIDHI_PRODUCTS", value, 1); }
    ~Wish() { unsetenv("RIGIDHI_PRODUCTS"); }
};

enum class Kind { Spheres, Multiblobs, Mixture };

/** Bodies on a loose lattice, unbounded or above a wall. */
struct ProductScene : OverdampedScene {
    ProductScene(Kind kind, bool wall, Scheme scheme, const char* wish, double temperature = T1,
                 bool fastSums = true)
        : OverdampedScene(scheme, temperature, 0.02) {
        const Wish chosen(wish);
        fluid->setFastSummation(fastSums);
        fluid->setSolver(MobilityForce::MatrixFree);
        fluid->setSolverTolerance(tolerance);
        if (wall) fluid->setBoundary(MobilityForce::NoSlipWall);
        mt19937 random(3);
        uniform_real_distribution<double> u(-0.5, 0.5);
        for (int b = 0; b < 27; b++) {
            const Vec3 R(4.5 * (b % 3) + u(random), 4.5 * (b / 3 % 3) + u(random),
                         4 + 4.5 * (b / 9) + u(random));
            if (kind == Kind::Spheres || (kind == Kind::Mixture && b % 3 == 0))
                addMassless(sphereKind(0.8 + 0.1 * (b % 4)), R, randomTurn(b));
            else if (kind == Kind::Mixture && b % 3 == 1)
                addFree(0, 0.5, R);
            else
                addMassless(boomerangKind(), R, randomTurn(b));
        }
        addWells("(x-4)^2 + 0.5*(y-5)^2 + 0.3*x*y + (z-8)^2");
        start(testPlatform(), 2);
    }
    string effect(const string& name) { return integrator.getEffects().at(name); }
    static constexpr double tolerance = 1e-4;
};

/** @param each  whether each scene has both schemes, and not one after the other */
void checkProductsOfSteps(bool each) {
    int scenes = 0;
    for (Kind kind : {Kind::Spheres, Kind::Multiblobs, Kind::Mixture})
        for (bool wall : {false, true}) {
            const bool odd = (scenes++ + (kind == Kind::Multiblobs)) % 2;
            for (Scheme scheme : {RigidHI::TrapezoidalSlip, RigidHI::FixmanMidpoint}) {
                if (!each && odd != (scheme == RigidHI::FixmanMidpoint)) continue;
                ProductScene host(kind, wall, scheme, "host"), device(kind, wall, scheme, "device");
                const VectorXd start = host.state();
                host.integrator.step(1);
                device.integrator.step(1);
                const VectorXd a = host.state(), b = device.state();
                EXPECT_LT((a - b).norm(), 5 * host.tolerance * (a - start).norm());
                if (onDevice()) {
                    EXPECT_GT((a - b).norm(), 0) << "the host made all products";
                } else {
                    EXPECT_EQ((a - b).norm(), 0);
                }
            }
        }
}

}  // namespace

TEST(Products, OfStepsAgreeWithThoseOfTheHostToTheTolerance) { checkProductsOfSteps(false); }
TEST(Products, FullOfStepsOfBothSchemesAgreeWithThoseOfTheHost) { checkProductsOfSteps(true); }

// Without fast sums, answers for spheres are exact to rounding on devices, too.
TEST(Products, AnswersWithoutFastSumsAreExact) {
    for (bool wall : {false, true}) {
        vector<double> wrenches;
        for (int i = 0; i < 6 * 27; i++) wrenches.push_back(sin(i));
        const auto answer = [&](const char* wish, bool fastSums) {
            ProductScene scene(Kind::Spheres, wall, RigidHI::TrapezoidalSlip, wish, T1, fastSums);
            return scene.fluid->applyMobilityInContext(*scene.context, wrenches);
        };
        const vector<double> exact = answer("host", false), same = answer("device", false),
                             fast = answer("device", true);
        const Eigen::Map<const VectorXd> a(exact.data(), exact.size()), b(same.data(), same.size()),
            c(fast.data(), fast.size());
        EXPECT_LT((a - b).norm(), 1e-12 * a.norm());
        EXPECT_LT((a - c).norm(), 1e-4 * a.norm());
        if (onDevice()) {
            EXPECT_GT((a - c).norm(), 1e-9 * a.norm());
        }
    }
}

TEST(Products, StepsResumeBitForBit) {
    for (Kind kind : {Kind::Spheres, Kind::Multiblobs}) {
        const auto scene = [&] {
            return make_unique<ProductScene>(kind, true, RigidHI::TrapezoidalSlip, "device");
        };
        const auto whole = scene(), part = scene();
        whole->integrator.step(2);
        stringstream checkpoint;
        whole->context->createCheckpoint(checkpoint);
        whole->integrator.step(2);
        part->context->loadCheckpoint(checkpoint);
        part->integrator.step(2);
        EXPECT_TRUE(sameBits(positionsOf(*whole->context), positionsOf(*part->context)));
    }
}

TEST(Products, EffectsSayWhoMakesThem) {
    const string name = "products on the device";
    ProductScene device(Kind::Spheres, false, RigidHI::EulerMaruyama, "device"),
        host(Kind::Spheres, false, RigidHI::EulerMaruyama, "host"),
        automatic(Kind::Spheres, false, RigidHI::EulerMaruyama, "auto");
    device.integrator.step(1);
    const auto starts = [](const string& text, const string& with) {
        return text.compare(0, with.size(), with) == 0;
    };
    if (!onDevice()) {
        EXPECT_EQ(device.effect(name),
                  "off: the host makes all products: the platform has no device for them");
        return;
    }
    EXPECT_TRUE(starts(device.effect(name), "on: products with the mobility of 27 particles"))
        << device.effect(name);
    EXPECT_NE(device.effect(name).find("on platform " + testPlatformName() + ", in floats"),
              string::npos);
    EXPECT_NE(device.effect("hydrodynamics").find("by the device, over all pairs in floats"),
              string::npos)
        << device.effect("hydrodynamics");
    EXPECT_EQ(
        host.effect(name),
        "off: the host makes all products: the environment variable RIGIDHI_PRODUCTS is host");
    // There are few particles, and the device may be a CPU.
    EXPECT_TRUE(starts(automatic.effect(name), "off: ")) << automatic.effect(name);
}

TEST(Products, AnUnknownWishIsRefused) {
    if (!onDevice()) GTEST_SKIP() << "the platform has no device";
    expectError([] { ProductScene(Kind::Spheres, false, RigidHI::EulerMaruyama, "gpu"); },
                {"RIGIDHI_PRODUCTS is 'gpu'", "device, host or auto"});
}
