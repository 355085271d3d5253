// Pack: a number type for the templates of platforms/common that holds one double of each of
// several bodies. It is built on Google Highway and compiled once per instruction set
// (rigidbody/Target.h).

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

using Doubles = HWY_CAPPED(double, BodySet::blockSize);
using Words = hn::RebindToUnsigned<Doubles>;
using DoubleVec = hn::Vec<Doubles>;
using WordVec = hn::Vec<Words>;

struct Pack {
    using Scalar = double;
    static const int packs = 1;
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
HWY_INLINE Pack multiplyAdd(const Pack& a, const Pack& b, const Pack& c) {
    return hn::MulAdd(a.v, b.v, c.v);
}
HWY_INLINE Pack negativeMultiplyAdd(const Pack& a, const Pack& b, const Pack& c) {
    return hn::NegMulAdd(a.v, b.v, c.v);
}
HWY_INLINE Pack multiplySubtract(const Pack& a, const Pack& b, const Pack& c) {
    return hn::MulSub(a.v, b.v, c.v);
}
HWY_INLINE Pack inverseSquareRoot(const Pack& a) { return Pack(1.0) / squareRoot(a); }
HWY_INLINE Pack selectGreater(const Pack& a, const Pack& b, const Pack& x, const Pack& y) {
    return hn::IfThenElse(hn::Gt(a.v, b.v), x.v, y.v);
}
HWY_INLINE bool allGreater(const Pack& a, const Pack& b) {
    return hn::AllTrue(Doubles(), hn::Gt(a.v, b.v));
}
HWY_INLINE void load(const double* from, Pack& x) { x.v = hn::LoadU(Doubles(), from); }
HWY_INLINE void store(const Pack& x, double* to) { hn::StoreU(x.v, Doubles(), to); }
HWY_INLINE int lanes(const Pack&) { return hn::Lanes(Doubles()); }
HWY_INLINE bool isFinite(const Pack& x) {
    return hn::AllTrue(Doubles(), hn::Eq(hn::Sub(x.v, x.v), hn::Zero(Doubles())));
}

/**
 * As many floats as two Packs have doubles, in the space of one. They are for sums that need only
 * six digits.
 */
#if HWY_TARGET == HWY_SCALAR
using Floats = hn::Rebind<float, Doubles>;
#else
using Floats = hn::Repartition<float, Doubles>;
#endif
struct SinglePack {
    using Scalar = float;
    static const int packs = HWY_TARGET == HWY_SCALAR ? 1 : 2;
    hn::Vec<Floats> v;
    SinglePack() = default;
    explicit SinglePack(double x) : v(hn::Set(Floats(), static_cast<float>(x))) {}
    SinglePack(hn::Vec<Floats> v) : v(v) {}
};
HWY_INLINE SinglePack operator+(const SinglePack& a, const SinglePack& b) {
    return hn::Add(a.v, b.v);
}
HWY_INLINE SinglePack operator-(const SinglePack& a, const SinglePack& b) {
    return hn::Sub(a.v, b.v);
}
HWY_INLINE SinglePack operator*(const SinglePack& a, const SinglePack& b) {
    return hn::Mul(a.v, b.v);
}
HWY_INLINE SinglePack operator/(const SinglePack& a, const SinglePack& b) {
    return hn::Div(a.v, b.v);
}
HWY_INLINE SinglePack squareRoot(const SinglePack& a) { return hn::Sqrt(a.v); }
HWY_INLINE SinglePack multiplyAdd(const SinglePack& a, const SinglePack& b, const SinglePack& c) {
    return hn::MulAdd(a.v, b.v, c.v);
}
HWY_INLINE SinglePack negativeMultiplyAdd(const SinglePack& a, const SinglePack& b,
                                          const SinglePack& c) {
    return hn::NegMulAdd(a.v, b.v, c.v);
}
HWY_INLINE SinglePack multiplySubtract(const SinglePack& a, const SinglePack& b,
                                       const SinglePack& c) {
    return hn::MulSub(a.v, b.v, c.v);
}
HWY_INLINE SinglePack inverseSquareRoot(const SinglePack& a) {
    return SinglePack(1.0) / squareRoot(a);
}
HWY_INLINE void load(const float* from, SinglePack& x) { x.v = hn::LoadU(Floats(), from); }
HWY_INLINE void store(const SinglePack& x, float* to) { hn::StoreU(x.v, Floats(), to); }
HWY_INLINE int lanes(const SinglePack&) { return hn::Lanes(Floats()); }
HWY_INLINE bool allGreater(const SinglePack& a, const SinglePack& b) {
    return hn::AllTrue(Floats(), hn::Gt(a.v, b.v));
}
HWY_INLINE void round(const Pack (&x)[1], Pack& to) { to = x[0]; }
/**
 * Numbers that are too large for a float become 1e30, so that their product with 0 (a factor at
 * distance 0) is not NaN.
 */
HWY_INLINE void round(const Pack (&x)[SinglePack::packs], SinglePack& to) {
    const Doubles d;
    const auto bounded = [&](const Pack& a) {
        return hn::Clamp(a.v, hn::Set(d, -1e30), hn::Set(d, 1e30));
    };
#if HWY_TARGET == HWY_SCALAR
    to.v = hn::DemoteTo(Floats(), bounded(x[0]));
#else
    const hn::Half<Floats> half;
    to.v =
        hn::Combine(Floats(), hn::DemoteTo(half, bounded(x[1])), hn::DemoteTo(half, bounded(x[0])));
#endif
}
/** sum += x */
HWY_INLINE void addTo(const SinglePack& x, Pack* sum) {
    const Doubles d;
#if HWY_TARGET == HWY_SCALAR
    sum[0].v = hn::Add(sum[0].v, hn::PromoteTo(d, x.v));
#else
    const hn::Half<Floats> half;
    sum[0].v = hn::Add(sum[0].v, hn::PromoteTo(d, hn::LowerHalf(half, x.v)));
    sum[1].v = hn::Add(sum[1].v, hn::PromoteTo(d, hn::UpperHalf(half, x.v)));
#endif
}

/** Sine and cosine of any argument. */
HWY_MAYBE_UNUSED static HWY_NOINLINE void sincosOfLarge(const Pack& x, Pack& sine, Pack& cosine) {
    // Highway's range reduction holds up to 39000, and needles may spin faster.
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
 * Sine and cosine of |x| <= pi/4. The Taylor series to x^15 and x^16 have truncation errors of less
 * than x^16/17! = 6e-17 in sin x/x and x^18/18! = 2e-18 in cos x, below rounding.
 */
HWY_INLINE void sincosOfSmall(DoubleVec x, DoubleVec& sine, DoubleVec& cosine) {
    const Doubles d;
    const DoubleVec z = hn::Mul(x, x);
    auto series = [&](DoubleVec sum, double coefficient) {
        return hn::MulAdd(sum, z, hn::Set(d, coefficient));
    };
    DoubleVec s = hn::Set(d, -1.0 / 1307674368000.0);  // -1/15!
    s = series(s, 1.0 / 6227020800.0);
    s = series(s, -1.0 / 39916800.0);
    s = series(s, 1.0 / 362880.0);
    s = series(s, -1.0 / 5040.0);
    s = series(s, 1.0 / 120.0);
    s = series(s, -1.0 / 6.0);
    sine = hn::MulAdd(hn::Mul(s, z), x, x);
    DoubleVec c = hn::Set(d, 1.0 / 20922789888000.0);  // 1/16!
    c = series(c, -1.0 / 87178291200.0);
    c = series(c, 1.0 / 479001600.0);
    c = series(c, -1.0 / 3628800.0);
    c = series(c, 1.0 / 40320.0);
    c = series(c, -1.0 / 720.0);
    c = series(c, 1.0 / 24.0);
    c = series(c, -0.5);
    cosine = hn::MulAdd(c, z, hn::Set(d, 1.0));
}

/** Sine and cosine. The half angles of a step are almost always small. */
HWY_INLINE void sincos(const Pack& x, Pack& sine, Pack& cosine) {
    const Doubles d;
    if (HWY_UNLIKELY(!hn::AllTrue(d, hn::Le(hn::Abs(x.v), hn::Set(d, M_PI / 4)))))
        sincosOfLarge(x, sine, cosine);
    else
        sincosOfSmall(x.v, sine.v, cosine.v);
}

/**
 * Philox4x32-10, one counter for each lane, for `count` independent sets of counters. The results
 * are bit for bit those of Random123 (a test compares them). A set is one long chain of dependent
 * operations, so the sets are interleaved.
 */
template <int count>
HWY_INLINE void philox(WordVec (&c)[count][4], uint32_t key0, uint32_t key1) {
#if HWY_TARGET == HWY_SCALAR
    for (auto& set : c) {
        uint32_t in[4];
        for (int i = 0; i < 4; i++) in[i] = static_cast<uint32_t>(hn::GetLane(set[i]));
        const auto out = r123::Philox4x32()({{in[0], in[1], in[2], in[3]}}, {{key0, key1}});
        for (int i = 0; i < 4; i++) set[i] = hn::Set(Words(), out[i]);
    }
#else
    const Words d;
    const hn::Repartition<uint32_t, Words> half;
    auto product = [&](WordVec a, WordVec b) {
        return hn::MulEven(hn::BitCast(half, a), hn::BitCast(half, b));
    };
    const WordVec m0 = hn::Set(d, 0xD2511F53u), m1 = hn::Set(d, 0xCD9E8D57u);
    for (int round = 0; round < 10; round++) {
        for (auto& set : c) {
            const WordVec p0 = product(m0, set[0]), p1 = product(m1, set[2]);
            // Nothing reads the upper halves of the 64-bit lanes, so they may hold anything.
            set[0] = hn::Xor(hn::Xor(hn::ShiftRight<32>(p1), set[1]), hn::Set(d, key0));
            set[1] = p1;
            set[2] = hn::Xor(hn::Xor(hn::ShiftRight<32>(p0), set[3]), hn::Set(d, key1));
            set[3] = p0;
        }
        key0 += 0x9E3779B9u;
        key1 += 0xBB67AE85u;
    }
#endif
}

/**
 * Sine and cosine of 2 pi v for v in [0, 1). The nearest quarter turn is subtracted exactly; the
 * series serve for the rest, at most an eighth of a turn.
 */
HWY_INLINE void sincosOfTurn(DoubleVec v, DoubleVec& sine, DoubleVec& cosine) {
    const Doubles d;
    const DoubleVec quarters = hn::Round(hn::Mul(v, hn::Set(d, 4.0)));  // 0 ... 4
    const DoubleVec x =
        hn::Mul(hn::Set(d, 2.0 * M_PI), hn::NegMulAdd(quarters, hn::Set(d, 0.25), v));
    DoubleVec s, c;
    sincosOfSmall(x, s, c);
    // Quarter turns: 1 and 3 swap sine and cosine; sine is negative after 2 and 3, cosine after 1
    // and 2.
    const auto one = hn::Eq(quarters, hn::Set(d, 1.0)), two = hn::Eq(quarters, hn::Set(d, 2.0)),
               three = hn::Eq(quarters, hn::Set(d, 3.0));
    const auto odd = hn::Or(one, three);
    const DoubleVec a = hn::IfThenElse(odd, c, s), b = hn::IfThenElse(odd, s, c);
    sine = hn::IfThenElse(hn::Or(two, three), hn::Neg(a), a);
    cosine = hn::IfThenElse(hn::Or(one, two), hn::Neg(b), b);
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
    if (noise.law == NoiseStream::TwoPoint)
        return hn::IfThenElse(hn::Lt(u.v, hn::Set(d, 0.5)), hn::Neg(one), one);
    return hn::IfThenElse(hn::Lt(u.v, hn::Set(d, 1.0 / 6.0)), hn::Neg(root3),
                          hn::IfThenElse(hn::Lt(u.v, hn::Set(d, 5.0 / 6.0)), hn::Zero(d), root3));
}

/** NoiseStream::pair for every lane, for blocks firstBlock, firstBlock + 1, ...: numbers 2k and 2k
 * + 1 are block k's.
 */
template <int count>
HWY_NOINLINE void noisePairs(const NoiseStream& noise, uint32_t purpose, const int* index,
                             uint32_t firstBlock, Pack (&numbers)[2 * count]) {
    const Words d;
    const Doubles dd;
    HWY_ALIGN uint64_t indices[BodySet::blockSize];
    for (int i = 0; i < lanes(numbers[0]); i++) indices[i] = static_cast<uint32_t>(index[i]);
    const uint64_t step = static_cast<uint64_t>(noise.step);
    WordVec c[count][4];
    for (int k = 0; k < count; k++) {
        c[k][0] = hn::Set(d, step & 0xffffffffu);
        c[k][1] = hn::Set(d, step >> 32);
        c[k][2] = hn::Load(d, indices);
        c[k][3] = hn::Set(d, noise.lastWord(purpose, firstBlock + k));
    }
    philox(c, noise.seed, NoiseStream::keyWord + noise.field);
    Pack u[count], v[count];
    for (int k = 0; k < count; k++) {
        u[k] = uniform(c[k][0], c[k][1]);
        v[k] = uniform(c[k][2], c[k][3]);
    }
    if (noise.law == NoiseStream::Gaussian) {
        for (int k = 0; k < count; k++) {
            const DoubleVec radius = hn::Sqrt(
                hn::Mul(hn::Set(dd, -2.0), hn::Log(dd, hn::Sub(hn::Set(dd, 1.0), u[k].v))));
            DoubleVec sine, cosine;
            sincosOfTurn(v[k].v, sine, cosine);
            numbers[2 * k] = hn::Mul(radius, cosine);
            numbers[2 * k + 1] = hn::Mul(radius, sine);
        }
    } else {
        for (int k = 0; k < count; k++) {
            numbers[2 * k] = discrete(noise, u[k]);
            numbers[2 * k + 1] = discrete(noise, v[k]);
        }
    }
}

}  // namespace HWY_NAMESPACE
}  // namespace RigidHIPlugin

#endif
