// Pack: a number type for the templates of platforms/common that holds one double of each of several bodies.
// Built on Google Highway; compiled once per instruction set (rigidbody/Target.h).

#if defined(RIGIDHI_SIMD_REAL_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef RIGIDHI_SIMD_REAL_INL_H_
#undef RIGIDHI_SIMD_REAL_INL_H_
#else
#define RIGIDHI_SIMD_REAL_INL_H_
#endif

#include <cmath>

#include "hwy/contrib/math/math-inl.h"
#include "hwy/highway.h"
#include "random/CounterNoise.h"
#include "rigidbody/BodySet.h"

namespace RigidHIPlugin {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

typedef HWY_CAPPED(double, BodySet::blockSize) Doubles;
typedef hn::RebindToUnsigned<Doubles> Words;
typedef hn::Vec<Doubles> DoubleVec;
typedef hn::Vec<Words> WordVec;

struct Pack {
    DoubleVec v;
    Pack() = default;
    explicit Pack(double x) : v(hn::Set(Doubles(), x)) {}
    Pack(DoubleVec v) : v(v) {}
};

HWY_INLINE Pack operator+(const Pack& a, const Pack& b) { return hn::Add(a.v, b.v); }
HWY_INLINE Pack operator-(const Pack& a, const Pack& b) { return hn::Sub(a.v, b.v); }
HWY_INLINE Pack operator*(const Pack& a, const Pack& b) { return hn::Mul(a.v, b.v); }
HWY_INLINE Pack operator/(const Pack& a, const Pack& b) { return hn::Div(a.v, b.v); }
HWY_INLINE Pack squareRoot(const Pack& a) { return hn::Sqrt(a.v); }
HWY_INLINE Pack maximum(const Pack& a, const Pack& b) { return hn::Max(a.v, b.v); }
HWY_INLINE void load(const double* from, Pack& x) { x.v = hn::LoadU(Doubles(), from); }
HWY_INLINE void store(const Pack& x, double* to) { hn::StoreU(x.v, Doubles(), to); }
HWY_INLINE int lanes(const Pack&) { return hn::Lanes(Doubles()); }
HWY_INLINE bool isFinite(const Pack& x) {
    return hn::AllTrue(Doubles(), hn::Eq(hn::Sub(x.v, x.v), hn::Zero(Doubles())));
}

/** Sine and cosine of any argument. */
HWY_NOINLINE void sincosOfLarge(const Pack& x, Pack& sine, Pack& cosine) {
    // Highway's range reduction holds to 39000; needles spin faster than that.
    const double reducible = 30000;
    const Doubles d;
    if (HWY_LIKELY(hn::AllTrue(d, hn::Lt(hn::Abs(x.v), hn::Set(d, reducible))))) {
        sine = hn::Sin(d, x.v);
        cosine = hn::Cos(d, x.v);
        return;
    }
    double in[BodySet::blockSize], s[BodySet::blockSize], c[BodySet::blockSize];
    store(x, in);
    for (int i = 0; i < lanes(x); i++) {
        s[i] = std::sin(in[i]);
        c[i] = std::cos(in[i]);
    }
    load(s, sine);
    load(c, cosine);
}

/**
 * Sine and cosine. The half angles of a step are almost always small: up to 1/2 the Taylor series to x^13 and x^14 leave out
 * less than x^14/15! = 5e-17 of sin x/x and x^16/16! = 7e-19 of cos x, below rounding.
 */
HWY_INLINE void sincos(const Pack& x, Pack& sine, Pack& cosine) {
    const Doubles d;
    if (HWY_UNLIKELY(!hn::AllTrue(d, hn::Le(hn::Abs(x.v), hn::Set(d, 0.5))))) {
        sincosOfLarge(x, sine, cosine);
        return;
    }
    const DoubleVec z = hn::Mul(x.v, x.v);
    auto series = [&](DoubleVec sum, double coefficient) { return hn::MulAdd(sum, z, hn::Set(d, coefficient)); };
    DoubleVec s = hn::Set(d, 1.0 / 6227020800.0);  // 1/13!
    s = series(s, -1.0 / 39916800.0);
    s = series(s, 1.0 / 362880.0);
    s = series(s, -1.0 / 5040.0);
    s = series(s, 1.0 / 120.0);
    s = series(s, -1.0 / 6.0);
    sine = hn::MulAdd(hn::Mul(s, z), x.v, x.v);
    DoubleVec c = hn::Set(d, -1.0 / 87178291200.0);  // -1/14!
    c = series(c, 1.0 / 479001600.0);
    c = series(c, -1.0 / 3628800.0);
    c = series(c, 1.0 / 40320.0);
    c = series(c, -1.0 / 720.0);
    c = series(c, 1.0 / 24.0);
    c = series(c, -0.5);
    cosine = hn::MulAdd(c, z, hn::Set(d, 1.0));
}

/** Philox4x32-10, one counter a lane: bit for bit what Random123 gives (a test compares them). */
HWY_INLINE void philox(WordVec c[4], uint32_t key0, uint32_t key1) {
#if HWY_TARGET == HWY_SCALAR
    uint32_t in[4];
    for (int i = 0; i < 4; i++) in[i] = static_cast<uint32_t>(hn::GetLane(c[i]));
    const auto out = r123::Philox4x32()({{in[0], in[1], in[2], in[3]}}, {{key0, key1}});
    for (int i = 0; i < 4; i++) c[i] = hn::Set(Words(), out[i]);
#else
    const Words d;
    const hn::Repartition<uint32_t, Words> half;
    auto product = [&](WordVec a, WordVec b) { return hn::MulEven(hn::BitCast(half, a), hn::BitCast(half, b)); };
    const WordVec m0 = hn::Set(d, 0xD2511F53u), m1 = hn::Set(d, 0xCD9E8D57u);
    for (int round = 0; round < 10; round++) {
        const WordVec p0 = product(m0, c[0]), p1 = product(m1, c[2]);
        // Upper halves of the 64-bit lanes are never looked at, so they may hold anything.
        c[0] = hn::Xor(hn::Xor(hn::ShiftRight<32>(p1), c[1]), hn::Set(d, key0));
        c[1] = p1;
        c[2] = hn::Xor(hn::Xor(hn::ShiftRight<32>(p0), c[3]), hn::Set(d, key1));
        c[3] = p0;
        key0 += 0x9E3779B9u;
        key1 += 0xBB67AE85u;
    }
#endif
}

HWY_INLINE Pack uniform(WordVec low, WordVec high) {
    const Words d;
    const WordVec bits = hn::Or(hn::ShiftLeft<32>(high), hn::And(low, hn::Set(d, 0xffffffffu)));
    const WordVec mantissa = hn::Or(hn::ShiftRight<12>(bits), hn::Set(d, 0x3ff0000000000000u));
    return hn::Sub(hn::BitCast(Doubles(), mantissa), hn::Set(Doubles(), 1.0));
}

HWY_INLINE Pack discrete(const NoiseStream& noise, const Pack& u) {
    const Doubles d;
    const DoubleVec one = hn::Set(d, 1.0), root3 = hn::Set(d, std::sqrt(3.0));
    if (noise.law == NoiseStream::TwoPoint) return hn::IfThenElse(hn::Lt(u.v, hn::Set(d, 0.5)), hn::Neg(one), one);
    return hn::IfThenElse(hn::Lt(u.v, hn::Set(d, 1.0 / 6.0)), hn::Neg(root3),
                          hn::IfThenElse(hn::Lt(u.v, hn::Set(d, 5.0 / 6.0)), hn::Zero(d), root3));
}

/** NoiseStream::pair for every lane. */
HWY_NOINLINE void noisePair(const NoiseStream& noise, uint32_t purpose, const int* index, uint32_t block, Pack& a,
                            Pack& b) {
    const Words d;
    const Doubles dd;
    HWY_ALIGN uint64_t indices[BodySet::blockSize];
    for (int i = 0; i < lanes(a); i++) indices[i] = static_cast<uint32_t>(index[i]);
    const uint64_t step = static_cast<uint64_t>(noise.step);
    WordVec c[4] = {hn::Set(d, step & 0xffffffffu), hn::Set(d, step >> 32), hn::Load(d, indices),
                    hn::Set(d, noise.lastWord(purpose, block))};
    philox(c, noise.seed, NoiseStream::keyWord);
    const Pack u = uniform(c[0], c[1]), v = uniform(c[2], c[3]);
    if (noise.law == NoiseStream::Gaussian) {
        const DoubleVec radius = hn::Sqrt(hn::Mul(hn::Set(dd, -2.0), hn::Log(dd, hn::Sub(hn::Set(dd, 1.0), u.v))));
        Pack sine, cosine;
        sincosOfLarge(Pack(2.0 * M_PI) * v, sine, cosine);
        a = Pack(radius) * cosine;
        b = Pack(radius) * sine;
    } else {
        a = discrete(noise, u);
        b = discrete(noise, v);
    }
}

}  // namespace HWY_NAMESPACE
}  // namespace RigidHIPlugin

#endif
