// Products of a device agree with those of the host within the error of single precision. The same
// positions and forces give the same bits, and the host takes over where the device fails.

#include <openmm/Force.h>
#include <openmm/VerletIntegrator.h>
#include <openmm/internal/ContextImpl.h>

#include <Eigen/Core>
#include <random>

#include "DeviceMobility.h"
#include "DeviceOfTests.h"
#include "ProductChoice.h"
#include "TestSupport.h"

using namespace OpenMM;
using namespace RigidHITest;
using namespace RigidHIPlugin;
using namespace std;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

/** A Context, for its device. */
struct Products : testing::Test {
    System system;
    VerletIntegrator integrator{0.001};
    unique_ptr<Context> context;
    ComputeContext* cc = nullptr;
    void SetUp() override {
        system.addParticle(1);
        context = make_unique<Context>(system, integrator, testPlatform());
        auto* data = static_cast<DevicePlatform::PlatformData*>(implOf(*context).getPlatformData());
        cc = data->contexts[0];
        context->setPositions({Vec3()});
        context->getState(State::Forces);
    }
    shared_ptr<DevicePairs> pairs(ProductWish wish = ProductWish::Device) {
        return make_shared<DevicePairs>(make_unique<Device>(*cc), testPlatformName(), wish);
    }
};

enum Spacing { Dilute, Overlapping, Coincident };

struct Scene {
    HydrodynamicParticles particles;
    Placement placement;
    optional<NoSlipPlane> wall;

    /** @param ratio  of the largest radius to the smallest */
    Scene(int n, double shareOfTorques, bool hasWall, Spacing spacing, double ratio,
          bool crossing = false, double unit = 1) {
        mt19937 random(n + 3 * spacing);
        uniform_real_distribution<double> u(0, 1);
        const double height = 0.3 * unit;
        if (hasWall) wall.emplace(height, crossing);
        const double edge = unit * cbrt(n * (spacing == Dilute ? 200.0 : 3.0));
        for (int i = 0; i < n; i++) {
            const double radius = unit * pow(ratio, u(random) - 0.5);
            particles.add(radius, u(random) < shareOfTorques, i, -1);
            const double low = height + (crossing ? 0.5 : 1.001) * radius;
            placement.positions.push_back(
                Vec3(edge * u(random), edge * u(random), edge * u(random) + low));
            // Pairs at one place, or one of them within the other.
            if (spacing == Coincident && i % 2 == 1) {
                Vec3& r = placement.positions.back();
                r = placement.positions[i - 1];
                r[2] = max(r[2], low);
            }
        }
    }
    MatrixXd forces(int columns) const {
        mt19937 random(9);
        normal_distribution<double> g;
        MatrixXd f(particles.numRows, columns);
        for (int c = 0; c < columns; c++)
            for (int i = 0; i < f.rows(); i++) f(i, c) = g(random);
        return f.array().colwise() * inverseScale().array();
    }
    /** So that forces and torques are of one strength; the norm of velocities has the inverse. */
    VectorXd inverseScale() const {
        VectorXd s(particles.numRows);
        for (int i = 0; i < particles.size(); i++) {
            const double a = particles.radii[i];
            s.segment<3>(particles.firstRow[i]).setConstant(sqrt(a));
            if (particles.hasTorque[i])
                s.segment<3>(particles.firstRow[i] + 3).setConstant(sqrt(4.0 / 3.0 * a * a * a));
        }
        return s;
    }
    MatrixXd onHost(const MatrixXd& f) const {
        const CpuRotnePragerYamakawa model(particles, 0.7, {}, wall, false);
        MatrixXd u;
        model.at(placement)->multiply(f, u);
        return u;
    }
    MatrixXd onDevice(const shared_ptr<DevicePairs>& pairs, const MatrixXd& f,
                      double error = Accuracy::errorOfSinglePrecision) const {
        const DeviceRotnePragerYamakawa model(particles, 0.7, {}, wall, false, pairs);
        MatrixXd u;
        model.at(placement)->multiply(f, u, {error, Accuracy::Value});
        return u;
    }
    /** The error of columns relative to their norms. */
    double error(const MatrixXd& device, const MatrixXd& host) const {
        const VectorXd s = inverseScale();
        const auto scale = s.asDiagonal();
        const MatrixXd difference = scale * (device - host), scaled = scale * host;
        return (difference.colwise().norm().array() / scaled.colwise().norm().array()).maxCoeff();
    }
};

/** Restores an environment variable. */
class Environment {
public:
    Environment(const char* value) {
        if (value)
            setenv(name, value, 1);
        else
            unsetenv(name);
    }
    ~Environment() { unsetenv(name); }

private:
    static constexpr const char* name = "RIGIDHI_PRODUCTS";
};

}  // namespace

TEST_F(Products, ProductsHaveTheErrorOfSinglePrecision) {
    const auto pairs = this->pairs();
    for (double shareOfTorques : {0.0, 1.0, 0.4})
        for (bool hasWall : {false, true})
            for (Spacing spacing : {Dilute, Overlapping, Coincident})
                for (double ratio : {1.0, 5.0}) {
                    const Scene scene(333, shareOfTorques, hasWall, spacing, ratio);
                    const MatrixXd f = scene.forces(2), host = scene.onHost(f),
                                   device = scene.onDevice(pairs, f);
                    const double error = scene.error(device, host);
                    EXPECT_LT(error, Accuracy::errorOfSinglePrecision)
                        << shareOfTorques << " " << hasWall << " " << spacing << " " << ratio;
                    EXPECT_GT(error, 1e-10) << "in doubles";
                    printf("torques %g wall %d spacing %d ratio %g: error %.2e\n", shareOfTorques,
                           hasWall, spacing, ratio, error);
                }
    EXPECT_EQ(pairs->reasonForHost(), "");
}

TEST_F(Products, ProductsOfVeryUnequalSpheres) {
    const auto pairs = this->pairs();
    for (bool hasWall : {false, true})
        for (Spacing spacing : {Overlapping, Coincident})
            for (double ratio : {1e2, 1e4}) {
                const Scene scene(200, 1, hasWall, spacing, ratio);
                const MatrixXd f = scene.forces(1);
                EXPECT_LT(scene.error(scene.onDevice(pairs, f), scene.onHost(f)),
                          Accuracy::errorOfSinglePrecision)
                    << hasWall << " " << spacing << " " << ratio;
            }
}

TEST_F(Products, MoreParticlesThanOneRoundOfGroups) {
    // OpenMM starts no more groups of threads than this, and kernels loop over the rest.
    const int n = 4500;
    const int groups = (n + pairGroup - 1) / pairGroup * ((n + pairTile - 1) / pairTile);
    ASSERT_GT(groups, cc->getNumThreadBlocks());
    for (bool hasWall : {false, true}) {
        const Scene scene(n, 0, hasWall, Dilute, 1);
        const MatrixXd f = scene.forces(1);
        const double error = scene.error(scene.onDevice(pairs(), f), scene.onHost(f));
        EXPECT_LT(error, Accuracy::errorOfSinglePrecision);
        printf("%d particles, wall %d: error %.2e\n", n, hasWall, error);
    }
}

TEST_F(Products, ManySpheresUnderForcesOfOneDirection) {
    // Roundings of one sign would add up.
    for (bool hasWall : {false, true})
        for (Spacing spacing : {Dilute, Overlapping}) {
            const Scene scene(2000, 1, hasWall, spacing, 2);
            MatrixXd f = scene.forces(1).cwiseAbs();
            const double error = scene.error(scene.onDevice(pairs(), f), scene.onHost(f));
            EXPECT_LT(error, Accuracy::errorOfSinglePrecision);
            printf("wall %d spacing %d: error %.2e\n", hasWall, spacing, error);
        }
}

TEST_F(Products, ParticlesThroughTheWallAndOtherUnits) {
    for (double unit : {1e-3, 1.0, 1e3}) {
        const Scene scene(150, 0.5, true, Overlapping, 2, true, unit);
        const MatrixXd f = scene.forces(1);
        EXPECT_LT(scene.error(scene.onDevice(pairs(), f), scene.onHost(f)),
                  Accuracy::errorOfSinglePrecision)
            << unit;
    }
}

TEST_F(Products, FarFromTheOrigin) {
    Scene scene(150, 1, false, Overlapping, 1);
    for (Vec3& r : scene.placement.positions) r += Vec3(3e6, -2e6, 1e6);
    const MatrixXd f = scene.forces(1);
    EXPECT_LT(scene.error(scene.onDevice(pairs(), f), scene.onHost(f)),
              Accuracy::errorOfSinglePrecision);
}

TEST_F(Products, SameBitsEveryTime) {
    const Scene scene(700, 1, true, Overlapping, 2), other(150, 0, true, Dilute, 1);
    const auto pairs = this->pairs();
    const MatrixXd f = scene.forces(3), first = scene.onDevice(pairs, f);
    other.onDevice(pairs, other.forces(1));
    EXPECT_EQ(scene.onDevice(pairs, f), first);
    EXPECT_EQ(scene.onDevice(this->pairs(), f), first);
    // Columns are cases of their own, up to the unit of forces.
    EXPECT_LT(scene.error(scene.onDevice(pairs, f.col(2)), first.col(2)), 1e-6);
}

TEST_F(Products, MovesAndManyColumns) {
    Scene scene(120, 1, false, Overlapping, 1);
    const auto pairs = this->pairs();
    const DeviceRotnePragerYamakawa model(scene.particles, 0.7, {}, {}, false, pairs);
    unique_ptr<MobilityAt> at;
    for (int move = 0; move < 2; move++) {
        for (Vec3& r : scene.placement.positions) r *= 1.3;
        model.place(at, scene.placement);
        const MatrixXd f = scene.forces(move == 0 ? 40 : 1);
        MatrixXd u;
        at->multiply(f, u, {1e-6, Accuracy::Value});
        EXPECT_LT(scene.error(u, scene.onHost(f)), Accuracy::errorOfSinglePrecision);
    }
}

TEST_F(Products, ExactProductsAndDifferencesAreTheHosts) {
    const Scene scene(150, 1, false, Overlapping, 1);
    const auto pairs = this->pairs();
    const MatrixXd f = scene.forces(1), host = scene.onHost(f);
    EXPECT_EQ(scene.onDevice(pairs, f, 0), host);
    EXPECT_EQ(scene.onDevice(pairs, f, 9e-7), host);
    const DeviceRotnePragerYamakawa model(scene.particles, 0.7, {}, {}, false, pairs);
    MatrixXd u;
    model.at(scene.placement)->multiply(f, u, {1e-4, Accuracy::Difference});
    EXPECT_EQ(u, host);
    MatrixXd bad = f;
    bad(7, 0) = NAN;
    EXPECT_FALSE(scene.onDevice(pairs, bad).allFinite());
}

TEST_F(Products, SaysWhatItDoes) {
    const auto pairs = this->pairs();
    EXPECT_FALSE(pairs->isOn());
    EXPECT_NE(pairs->describe().find("no fluid needs products with the mobility of"), string::npos);
    const Scene scene(150, 1, false, Dilute, 1), other(20, 1, false, Dilute, 1);
    {
        const DeviceRotnePragerYamakawa model(scene.particles, 0.7, {}, {}, true, pairs),
            another(other.particles, 0.7, {}, {}, true, pairs);
        EXPECT_TRUE(pairs->isOn());
        EXPECT_NE(pairs->describe().find("of 20 to 150 particles"), string::npos);
        EXPECT_NE(pairs->describe().find("RIGIDHI_PRODUCTS is device"), string::npos);
        EXPECT_EQ(model.describeFastProducts(1e-3), "by the device, over all pairs in floats");
        EXPECT_EQ(model.describeFastProducts(0), "");
        EXPECT_FALSE(model.hasFastProducts(1e-3));
        EXPECT_TRUE(model.getTraits().hasFastSinglePrecision);
    }
    EXPECT_FALSE(pairs->isOn());
    const auto host = this->pairs(ProductWish::Host), automatic = this->pairs(ProductWish::Auto);
    EXPECT_FALSE(host->serves(10000, false, true, 1e-3));
    EXPECT_NE(host->describe().find("the environment variable RIGIDHI_PRODUCTS is host"),
              string::npos);
    EXPECT_EQ(automatic->serves(10000, false, true, 1e-3), !cc->getIsCPU());
    if (cc->getIsCPU()) {
        EXPECT_NE(automatic->describe().find("the device is a CPU"), string::npos);
    }
}

/** A device that has no memory for large arrays. */
struct SmallDevice : Device {
    using Device::Device;
    void requireMemory(size_t bytes) const override {
        if (bytes > 10000) throw OpenMMException("Error creating array: clCreateBuffer (-4)");
    }
};

TEST_F(Products, TheHostTakesOverWhereTheDeviceFails) {
    const Scene scene(150, 1, false, Overlapping, 1);
    const MatrixXd f = scene.forces(1), host = scene.onHost(f);
    const auto expectHost = [&](unique_ptr<const Device> device, const vector<string>& reasons) {
        const auto pairs =
            make_shared<DevicePairs>(move(device), testPlatformName(), ProductWish::Device);
        const DeviceRotnePragerYamakawa model(scene.particles, 0.7, {}, {}, false, pairs);
        const auto at = model.at(scene.placement);
        for (int i = 0; i < 2; i++) {
            MatrixXd u;
            testing::internal::CaptureStderr();
            at->multiply(f, u, {1e-6, Accuracy::Value});
            const string warning = testing::internal::GetCapturedStderr();
            EXPECT_EQ(warning.find("the host makes products with mobilities") != string::npos,
                      i == 0);
            EXPECT_LT(scene.error(u, host), 1e-6);
        }
        EXPECT_FALSE(pairs->isOn());
        for (const string& reason : reasons)
            EXPECT_NE(pairs->describe().find(reason), string::npos) << pairs->describe();
    };
    expectHost(make_unique<SmallDevice>(*cc),
               {"the host makes all products: the device could not make one: it cannot hold ",
                " bytes of partialSums: Error creating array"});
    // The compiler's log names the word.
    expectHost(make_unique<NoKernels>(*cc),
               {"the host makes all products: the device could not make one: its compiler refuses "
                "a kernel: ",
                "WordThatNoCompilerKnows"});
}

TEST_F(Products, NoDoublesTheHostMakesAll) {
    const DevicePairs pairs(make_unique<NoDoubles>(*cc), testPlatformName(), ProductWish::Device);
    EXPECT_FALSE(pairs.serves(1000000, false, true, 1e-3));
    EXPECT_EQ(pairs.describe(),
              "the host makes all products: the device has no double precision, which sums of many "
              "particles need");
}

TEST(ProductChoice, FollowsTheTable) {
    for (bool hasWall : {false, true}) {
        const int fewest = fewestForDevice(hasWall);
        for (double error : {1e-2, 1e-3, 1e-6}) {
            EXPECT_FALSE(deviceIsFaster(fewest - 1, hasWall, true, error));
            EXPECT_TRUE(deviceIsFaster(fewest, hasWall, true, error));
            EXPECT_TRUE(deviceIsFaster(10000000, hasWall, false, error));
        }
        EXPECT_FALSE(deviceIsFaster(110000, hasWall, true, 1e-3));
        EXPECT_TRUE(deviceIsFaster(110000, hasWall, true, 1e-6));
        EXPECT_FALSE(deviceIsFaster(300000, hasWall, true, 1e-6));
        EXPECT_FALSE(deviceIsFaster(10000, hasWall, true, 9e-7));
    }
}

TEST(ProductChoice, ReadsTheEnvironment) {
    EXPECT_EQ((Environment(nullptr), productWish()), ProductWish::Auto);
    EXPECT_EQ((Environment("auto"), productWish()), ProductWish::Auto);
    EXPECT_EQ((Environment("device"), productWish()), ProductWish::Device);
    EXPECT_EQ((Environment("host"), productWish()), ProductWish::Host);
    const Environment wrong("gpu");
    expectError([] { productWish(); }, {"RIGIDHI_PRODUCTS is 'gpu'", "device, host or auto"});
}
