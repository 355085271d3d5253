// The passes of ColumnTransform, compiled once for each instruction set.

#if defined(RIGIDHI_COLUMN_TRANSFORM_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef RIGIDHI_COLUMN_TRANSFORM_INL_H_
#undef RIGIDHI_COLUMN_TRANSFORM_INL_H_
#else
#define RIGIDHI_COLUMN_TRANSFORM_INL_H_
#endif

#include "hwy/highway.h"
#include "mobility/models/forcecoupling/ColumnTransform.h"

namespace RigidHIPlugin {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/** A pack of a block's columns. */
template <typename T>
using ColumnLanes = HWY_CAPPED(T, columnsOfBlock);

/** One element of a pack of columns. */
template <typename T>
struct Element {
    hn::Vec<ColumnLanes<T> > re, im;
};

template <typename T>
HWY_INLINE Element<T> operator+(const Element<T>& a, const Element<T>& b) {
    return {hn::Add(a.re, b.re), hn::Add(a.im, b.im)};
}
template <typename T>
HWY_INLINE Element<T> operator-(const Element<T>& a, const Element<T>& b) {
    return {hn::Sub(a.re, b.re), hn::Sub(a.im, b.im)};
}
/** a - i b, a + i b */
template <typename T>
HWY_INLINE Element<T> minusI(const Element<T>& a, const Element<T>& b) {
    return {hn::Add(a.re, b.im), hn::Sub(a.im, b.re)};
}
template <typename T>
HWY_INLINE Element<T> plusI(const Element<T>& a, const Element<T>& b) {
    return {hn::Sub(a.re, b.im), hn::Add(a.im, b.re)};
}
/** (w[0] + i w[1]) a */
template <typename T>
HWY_INLINE Element<T> times(const T* w, const Element<T>& a) {
    const ColumnLanes<T> d;
    const auto re = hn::Set(d, w[0]), im = hn::Set(d, w[1]);
    return {hn::NegMulAdd(im, a.im, hn::Mul(re, a.re)), hn::MulAdd(im, a.re, hn::Mul(re, a.im))};
}

/** x_j <- sum_k exp(-2 pi i j k/R) x_k; `roots` are those of unity of the odd factor of R. */
template <int R>
struct Butterfly {
    // An odd prime: sums and differences of x_k and x_(R-k).
    template <typename T>
    static HWY_INLINE void apply(const T* roots, Element<T> (&x)[R]) {
        const ColumnLanes<T> d;
        const int half = (R - 1) / 2;
        Element<T> sum[half], difference[half], total = x[0];
#pragma GCC unroll 3
        for (int k = 0; k < half; k++) {
            sum[k] = x[k + 1] + x[R - 1 - k];
            difference[k] = x[k + 1] - x[R - 1 - k];
            total = total + sum[k];
        }
        Element<T> y[R];
#pragma GCC unroll 3
        for (int j = 1; j <= half; j++) {
            Element<T> even = x[0], odd = {hn::Zero(d), hn::Zero(d)};
#pragma GCC unroll 3
            for (int k = 1; k <= half; k++) {
                const auto c = hn::Set(d, roots[2 * (j * k % R)]), s = hn::Set(d, -roots[2 * (j * k % R) + 1]);
                even = {hn::MulAdd(c, sum[k - 1].re, even.re), hn::MulAdd(c, sum[k - 1].im, even.im)};
                odd = {hn::MulAdd(s, difference[k - 1].re, odd.re), hn::MulAdd(s, difference[k - 1].im, odd.im)};
            }
            y[j] = minusI(even, odd);
            y[R - j] = plusI(even, odd);
        }
        x[0] = total;
#pragma GCC unroll 6
        for (int j = 1; j < R; j++) x[j] = y[j];
    }
};
template <>
struct Butterfly<1> {
    template <typename T>
    static HWY_INLINE void apply(const T*, Element<T> (&)[1]) {}
};
template <>
struct Butterfly<2> {
    template <typename T>
    static HWY_INLINE void apply(const T*, Element<T> (&x)[2]) {
        const Element<T> a = x[0], b = x[1];
        x[0] = a + b;
        x[1] = a - b;
    }
};
template <>
struct Butterfly<4> {
    template <typename T>
    static HWY_INLINE void apply(const T*, Element<T> (&x)[4]) {
        const Element<T> a = x[0] + x[2], b = x[0] - x[2], c = x[1] + x[3], e = x[1] - x[3];
        x[0] = a + c;
        x[1] = minusI(b, e);
        x[2] = a - c;
        x[3] = plusI(b, e);
    }
};
template <>
struct Butterfly<8> {
    template <typename T>
    static HWY_INLINE void apply(const T* roots, Element<T> (&x)[8]) {
        const ColumnLanes<T> d;
        Element<T> even[4] = {x[0], x[2], x[4], x[6]}, odd[4] = {x[1], x[3], x[5], x[7]};
        Butterfly<4>::apply(roots, even);
        Butterfly<4>::apply(roots, odd);
        const auto half = hn::Set(d, static_cast<T>(0.70710678118654752440));
        // odd[1] (1 - i)/sqrt(2), -i odd[2], -odd[3] (1 + i)/sqrt(2)
        const Element<T> one = {hn::Mul(half, hn::Add(odd[1].re, odd[1].im)),
                                hn::Mul(half, hn::Sub(odd[1].im, odd[1].re))},
                         three = {hn::Mul(half, hn::Sub(odd[3].im, odd[3].re)),
                                  hn::Mul(half, hn::Neg(hn::Add(odd[3].re, odd[3].im)))};
        x[0] = even[0] + odd[0];
        x[1] = even[1] + one;
        x[2] = minusI(even[2], odd[2]);
        x[3] = even[3] + three;
        x[4] = even[0] - odd[0];
        x[5] = even[1] - one;
        x[6] = plusI(even[2], odd[2]);
        x[7] = even[3] - three;
    }
};
/** Twice an odd prime P: no factors in between, with indices by Good's mapping. */
template <int P>
struct TwiceOdd {
    template <typename T>
    static HWY_INLINE void apply(const T* roots, Element<T> (&x)[2 * P]) {
        Element<T> even[P], odd[P];
#pragma GCC unroll 5
        for (int k = 0; k < P; k++) {
            even[k] = x[2 * k % (2 * P)] + x[(2 * k + P) % (2 * P)];
            odd[k] = x[2 * k % (2 * P)] - x[(2 * k + P) % (2 * P)];
        }
        Butterfly<P>::apply(roots, even);
        Butterfly<P>::apply(roots, odd);
        const int inverse = (P + 1) / 2;  // of 2, modulo P
#pragma GCC unroll 5
        for (int k = 0; k < P; k++) {
            x[2 * inverse * k % (2 * P)] = even[k];
            x[(2 * inverse * k + P) % (2 * P)] = odd[k];
        }
    }
};
template <>
struct Butterfly<6> : TwiceOdd<3> {};
template <>
struct Butterfly<10> : TwiceOdd<5> {};

template <typename T>
HWY_INLINE Element<T> load(const Columns<T>& from, size_t i) {
    const ColumnLanes<T> d;
    return {hn::LoadU(d, from.re + i * from.stride), hn::LoadU(d, from.im + i * from.stride)};
}
template <typename T>
HWY_INLINE void store(const Element<T>& x, const Columns<T>& to, size_t i) {
    const ColumnLanes<T> d;
    hn::StoreU(x.re, d, to.re + i * to.stride);
    hn::StoreU(x.im, d, to.im + i * to.stride);
}

template <int R, bool last, typename T>
void pass(int groups, int stride, const T* twiddles, const T* roots, Columns<T> from, Columns<T> to) {
    const ColumnLanes<T> d;
    const int width = hn::Lanes(d);
    for (int lane = 0; lane < columnsOfBlock; lane += width) {
        for (int p = 0; p < groups; p++) {
            const T* w = twiddles + 2 * (R - 1) * p;
            for (int q = 0; q < stride; q++) {
                Element<T> x[R];
#pragma GCC unroll 10
                for (int k = 0; k < R; k++) x[k] = load(from, q + (size_t)stride * (p + k * groups));
                Butterfly<R>::apply(roots, x);
                store(x[0], to, q + (size_t)stride * R * p);
#pragma GCC unroll 10
                for (int j = 1; j < R; j++)
                    store(last ? x[j] : times(w + 2 * (j - 1), x[j]), to, q + (size_t)stride * (R * p + j));
            }
        }
        from.re += width;
        from.im += width;
        to.re += width;
        to.im += width;
    }
}

/** Any radix, one sum after the other. `from` and `to` are apart. */
template <typename T>
void passOfAny(int radix, int groups, int stride, const T* twiddles, const T* roots, Columns<T> from, Columns<T> to) {
    const ColumnLanes<T> d;
    const int width = hn::Lanes(d);
    const T one[] = {1, 0};
    for (int lane = 0; lane < columnsOfBlock; lane += width) {
        for (int p = 0; p < groups; p++)
            for (int q = 0; q < stride; q++)
                for (int j = 0; j < radix; j++) {
                    Element<T> sum = {hn::Zero(d), hn::Zero(d)};
                    for (int k = 0; k < radix; k++)
                        sum = sum + times(roots + 2 * ((long long)j * k % radix),
                                          load(from, q + (size_t)stride * (p + k * groups)));
                    const T* w = j == 0 ? one : twiddles + 2 * ((radix - 1) * p + j - 1);
                    store(times(w, sum), to, q + (size_t)stride * (radix * p + j));
                }
        from.re += width;
        from.im += width;
        to.re += width;
        to.im += width;
    }
}

/** ColumnTransform::apply() */
template <typename T>
void transformColumns(const ColumnTransform<T>& transform, const Columns<T>& source, const Columns<T>& to, T* scratch) {
    const auto& passes = transform.getPasses();
    Columns<T> from = source;
    const int count = passes.size();
    if (count == 1 && passes[0].radix > 10) {
        // Sums over all for each: not into what they are taken from.
        const Columns<T> copy = Columns<T>::packed(scratch);
        pass<1, true>(transform.getSize(), 1, (const T*)nullptr, (const T*)nullptr, from, copy);
        from = copy;
    }
    for (int i = 0; i < count; i++) {
        const typename ColumnTransform<T>::Pass& one = passes[i];
        const bool last = i == count - 1;
        const Columns<T> next =
            last ? to : Columns<T>::packed(scratch + (i % 2) * 2 * columnsOfBlock * (size_t)transform.getSize());
        const T *w = transform.numbersAt(one.twiddles), *roots = transform.numbersAt(one.roots);
        const int groups = one.length / one.radix;
        switch (one.radix) {
#define RIGIDHI_PASS(R)                                               \
    case R:                                                           \
        if (last)                                                     \
            pass<R, true>(groups, one.stride, w, roots, from, next);  \
        else                                                          \
            pass<R, false>(groups, one.stride, w, roots, from, next); \
        break;
            RIGIDHI_PASS(1)
            RIGIDHI_PASS(2)
            RIGIDHI_PASS(3)
            RIGIDHI_PASS(4)
            RIGIDHI_PASS(5)
            RIGIDHI_PASS(6)
            RIGIDHI_PASS(7)
            RIGIDHI_PASS(8)
            RIGIDHI_PASS(10)
#undef RIGIDHI_PASS
            default: passOfAny(one.radix, groups, one.stride, w, roots, from, next);
        }
        from = next;
    }
}

/** to[j][i] = from[i][j] of a block of columns: columnsOfBlock rows of as many, so many numbers apart. */
template <typename T>
HWY_INLINE void transposeBlock(const T* from, size_t fromStride, T* to, size_t toStride) {
    const ColumnLanes<T> d;
    constexpr int most = HWY_TARGET == HWY_SCALAR                     ? 1
                         : HWY_MAX_BYTES / sizeof(T) < columnsOfBlock ? HWY_MAX_BYTES / sizeof(T)
                                                                      : columnsOfBlock;
    hn::Vec<ColumnLanes<T> > x[most];
    for (int a = 0; a < columnsOfBlock; a += most)
        for (int b = 0; b < columnsOfBlock; b += most) {
#pragma GCC unroll 8
            for (int i = 0; i < most; i++) x[i] = hn::LoadU(d, from + (a + i) * fromStride + b);
#if HWY_TARGET != HWY_SCALAR
                // Exchange with the neighbour at each distance.
#pragma GCC unroll 3
            for (int distance = 1; distance < most; distance *= 2)
#pragma GCC unroll 8
                for (int i = 0; i < most; i++) {
                    if (i & distance) continue;
                    auto &lower = x[i], &upper = x[i + distance];
                    const auto l = lower, u = upper;
                    const size_t bytes = distance * sizeof(T);
                    const hn::Repartition<double, ColumnLanes<T> > d64;
                    if (bytes == 4) {
                        lower = hn::OddEven(hn::DupEven(u), l);
                        upper = hn::OddEven(u, hn::DupOdd(l));
                    } else if (bytes == 8) {
                        const auto l64 = hn::BitCast(d64, l), u64 = hn::BitCast(d64, u);
                        lower = hn::BitCast(d, hn::InterleaveLower(d64, l64, u64));
                        upper = hn::BitCast(d, hn::InterleaveUpper(d64, l64, u64));
                    } else if (2 * distance == most) {
                        lower = hn::ConcatLowerLower(d, u, l);
                        upper = hn::ConcatUpperUpper(d, u, l);
                    } else {
                        lower = hn::OddEvenBlocks(hn::SwapAdjacentBlocks(u), l);
                        upper = hn::OddEvenBlocks(u, hn::SwapAdjacentBlocks(l));
                    }
                }
#endif
#pragma GCC unroll 8
            for (int i = 0; i < most; i++) hn::StoreU(x[i], d, to + (b + i) * toStride + a);
        }
}

}  // namespace HWY_NAMESPACE
}  // namespace RigidHIPlugin

#endif
