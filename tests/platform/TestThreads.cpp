// Contexts that step at the same time in different threads of a program. Python's threads do this,
// since the bindings release Python's lock.

#include <atomic>
#include <chrono>
#include <thread>

#include "HydrodynamicSupport.h"
#include "linearalgebra/OneBlasThread.h"

extern "C" {
int openblas_get_num_threads();
void openblas_set_num_threads(int threads);
}

using namespace OpenMM;
using namespace RigidHITest;
using namespace std;

namespace {

/** A scene with dense matrices that have enough rows for OpenBLAS to share their products among
 * threads (200 or more). */
unique_ptr<FluidScene> denseScene(Platform& platform, int seed) {
    auto scene = make_unique<FluidScene>(300, 0.002);
    scene->integrator.setRandomNumberSeed(seed);
    scene->fluid->setSolver(MobilityForce::Dense);
    for (int i = 0; i < 40; i++)
        scene->add(sphereKind(0.5), Vec3(1.5 * (i % 4), 1.5 * (i / 4 % 4), 1.5 * (i / 16)));
    scene->start(platform);
    return scene;
}
const int numSteps = 6;

vector<Vec3> resultOf(FluidScene& scene) {
    scene.integrator.step(numSteps);
    vector<Vec3> result = scene.integrator.getBodyPositions();
    for (const Vec3& v : scene.integrator.getBodyVelocities()) result.push_back(v);
    for (const Vec3& v : scene.integrator.getBodyAngularVelocities()) result.push_back(v);
    return result;
}

/** Sets two BLAS threads for a test, whatever the machine has, and restores the number afterwards.
 */
class TwoBlasThreads : public testing::Test {
protected:
    void SetUp() override { openblas_set_num_threads(2); }
    void TearDown() override { openblas_set_num_threads(before); }
    const int before = openblas_get_num_threads();
};

Platform& otherPlatform() {
    return platform(testPlatform().getName() == "CPU" ? "Reference" : "CPU");
}

}  // namespace

TEST_F(TwoBlasThreads, ContextsInTwoThreadsGiveWhatEachGivesAlone) {
    // The Contexts may be of two platforms, whose libraries share only the API library.
    for (Platform* second : {&testPlatform(), &otherPlatform()}) {
        vector<vector<Vec3>> alone = {resultOf(*denseScene(testPlatform(), 1)),
                                      resultOf(*denseScene(*second, 2))};
        for (int trial = 0; trial < 3; trial++) {
            vector<unique_ptr<FluidScene>> scenes;
            scenes.push_back(denseScene(testPlatform(), 1));
            scenes.push_back(denseScene(*second, 2));
            vector<vector<Vec3>> together(2);
            vector<thread> threads;
            for (int i = 0; i < 2; i++)
                threads.emplace_back([&, i] { together[i] = resultOf(*scenes[i]); });
            for (thread& t : threads) t.join();
            for (int i = 0; i < 2; i++)
                EXPECT_TRUE(together[i] == alone[i]) << "Context " << i << ", trial " << trial;
            EXPECT_EQ(openblas_get_num_threads(), 2);
        }
    }
}

TEST_F(TwoBlasThreads, AContextThatEndsItsStepLeavesOthersTheirOneThread) {
    const auto scene = denseScene(testPlatform(), 1);
    const auto pause = chrono::milliseconds(2);
    atomic<int> steps(0);
    atomic<bool> done(false);
    thread stepping([&] {
        while (!done) {
            scene->integrator.step(1);
            steps++;
            this_thread::sleep_for(2 * pause);
        }
    });
    // Most of these holders begin within a step, which then ends. The test program and the platform
    // have separate copies of the numerical code.
    int others = 0;
    for (int i = 0; i < 10; i++) {
        for (const int last = steps; steps == last;) this_thread::yield();
        this_thread::sleep_for(4 * pause);
        const RigidHIPlugin::OneBlasThread holder;
        for (const int last = steps; steps == last;) this_thread::yield();
        this_thread::sleep_for(pause);
        others += openblas_get_num_threads() != 1;
    }
    done = true;
    stepping.join();
    EXPECT_EQ(others, 0);
    EXPECT_EQ(openblas_get_num_threads(), 2);
}

TEST_F(TwoBlasThreads, DoNotShowInWhatIsComputedOnceAtTheStart) {
    const auto mobilityOfABall = [] {
        FluidScene scene;
        scene.fluid->setModel(MobilityForce::FreeDraining);
        BodyKind ball = {"ball", 1, Vec3(1, 1, 1), {}, {}};
        mt19937 random(1);
        normal_distribution<double> normal;
        for (int i = 0; i < 150; i++) {
            const Vec3 v(normal(random), normal(random), normal(random));
            ball.sites.push_back(v / norm(v));
            ball.radii.push_back(0.1);
        }
        scene.add(ball);
        scene.start(testPlatform());
        return scene.mobility();
    };
    const MatrixXd withTwo = mobilityOfABall();
    openblas_set_num_threads(1);
    EXPECT_EQ(withTwo, mobilityOfABall());
}
