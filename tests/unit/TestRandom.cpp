// Counter-based random numbers: Philox gives Random123's known answer, the SIMD stream agrees with
// the scalar one, and the laws have the right moments.

#include "TestSupport.h"
#include "host/SimdBodyLoops.h"
#include "random/CounterNoise.h"

using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace std;

TEST(Random, PhiloxGivesThePublishedKnownAnswer) {
    // Random123's kat_vectors, philox4x32-10, third line.
    const auto out = r123::Philox4x32()({{0x243f6a88, 0x85a308d3, 0x13198a2e, 0x03707344}},
                                        {{0xa4093822, 0x299f31d0}});
    EXPECT_EQ(out[0], 0xd16cfe09u);
    EXPECT_EQ(out[1], 0x94fdccebu);
    EXPECT_EQ(out[2], 0x5001e420u);
    EXPECT_EQ(out[3], 0x24126ea1u);
}

TEST(Random, SimdAndScalarStreamsAreTheSame) {
    for (auto law : {NoiseStream::Gaussian, NoiseStream::ThreePoint, NoiseStream::TwoPoint}) {
        NoiseStream noise;
        noise.law = law;
        noise.seed = 987654321;
        noise.step = 123456789012345;
        noise.attempt = 3;
        const int n = 1003;
        vector<int> index(n);
        for (int i = 0; i < n; i++) index[i] = 17 * i + 5;
        vector<double> xi(3 * n);
        fillSimdNoise(noise, NoiseStream::FreeFirstDraw, index.data(), n, xi.data());
        for (int i = 0; i < n; i++) {
            double z[4];
            noise.pair(NoiseStream::FreeFirstDraw, index[i], 0, z[0], z[1]);
            noise.pair(NoiseStream::FreeFirstDraw, index[i], 1, z[2], z[3]);
            // The integers are the same. Only logarithm, sine and cosine differ, by rounding.
            for (int k = 0; k < 3; k++) ASSERT_NEAR(xi[3 * i + k], z[k], 1e-14 * 8);
        }
    }
}

TEST(Random, EveryPartOfTheCounterMatters) {
    NoiseStream base;
    base.seed = 5;
    auto draw = [](const NoiseStream& noise, uint32_t purpose, uint32_t index, uint32_t block) {
        double a, b;
        noise.pair(purpose, index, block, a, b);
        return a;
    };
    const double x = draw(base, 0, 0, 0);
    EXPECT_EQ(x, draw(base, 0, 0, 0));
    NoiseStream other = base;
    other.seed = 6;
    EXPECT_NE(x, draw(other, 0, 0, 0));
    other = base;
    other.step = 1;
    EXPECT_NE(x, draw(other, 0, 0, 0));
    other.step = int64_t(1) << 32;
    EXPECT_NE(x, draw(other, 0, 0, 0));
    other = base;
    other.attempt = 1;
    EXPECT_NE(x, draw(other, 0, 0, 0));
    EXPECT_NE(x, draw(base, 1, 0, 0));
    EXPECT_NE(x, draw(base, 0, 1, 0));
    EXPECT_NE(x, draw(base, 0, 0, 1));
}

TEST(Random, LawsHaveTheRightMoments) {
    // The first moment of all three laws is 0, and the second is 1. The fourth moments are 3, 3 and
    // 1.
    for (auto law : {NoiseStream::Gaussian, NoiseStream::ThreePoint, NoiseStream::TwoPoint}) {
        NoiseStream noise;
        noise.law = law;
        vector<double> first, second, fourth, cross;
        for (int i = 0; i < 200000; i++) {
            double a, b;
            noise.pair(0, i, 0, a, b);
            for (double x : {a, b}) {
                first.push_back(x);
                second.push_back(x * x);
                fourth.push_back(x * x * x * x);
            }
            cross.push_back(a * b);
        }
        const string name = "law " + to_string(law);
        expectMean(name + " mean", estimate(first), 0);
        expectMean(name + " mean of the product of a pair", estimate(cross), 0);
        if (law == NoiseStream::TwoPoint) {
            for (double x : second) ASSERT_EQ(x, 1.0);
        } else {
            expectMean(name + " variance", estimate(second), 1);
            expectMean(name + " fourth moment", estimate(fourth), 3);
        }
    }
}
