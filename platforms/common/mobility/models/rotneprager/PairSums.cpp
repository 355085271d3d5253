// Sums over pairs for the Rotne-Prager-Yamakawa mobility, each pair once. The build compiles this
// file once for each instruction set.

#include "simd/SimdTargets.h"  // must precede foreach_target.h

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "mobility/models/rotneprager/PairSums.cpp"
#include "hwy/foreach_target.h"  // must precede highway.h

#include <algorithm>
#include <type_traits>

#include "hwy/contrib/math/math-inl.h"
#include "hwy/highway.h"
#include "mobility/models/rotneprager/PairSums.h"
#include "simd/WithFlags.h"

#undef RIGIDHI_TARGET
#define RIGIDHI_TARGET HWY_NAMESPACE

HWY_BEFORE_NAMESPACE();
#include "mobility/models/rotneprager/PairsBothWays-inl.h"
#include "mobility/models/rotneprager/RoundedPairs-inl.h"
#include "simd/SimdReal-inl.h"

namespace RigidHIPlugin {
namespace HWY_NAMESPACE {

using Arrays = PairSumArrays;

/** The differences between sums in double and in single precision. */
template <class Real>
struct Precision;
template <>
struct Precision<Pack> {
    using Tag = Doubles;
    static const int places = 3;  // numbers of a position
    static const int block = 16;  // targets whose sums stay in lanes at once
    static const int lanes = 8;   // of the widest pack
    static const double* loads(const Arrays& a) { return a.loads; }
    static const double* place(const Arrays& a, int k) { return k == 0 ? a.x : k == 1 ? a.y : a.z; }
    static double third(const Arrays& a, int slot) {
        return 1.0 / 3.0 * (a.radius[slot] * a.radius[slot]);
    }
    static HWY_INLINE void thirds(const Arrays& a, int slot, Pack& to) {
        Pack radius;
        load(a.radius + slot, radius);
        to = Pack(1.0 / 3.0) * (radius * radius);
    }
};
template <>
struct Precision<SinglePack> {
    using Tag = Floats;
    static const int places = 6;
    static const int block = 32;
    static const int lanes = 16;
    static const float* loads(const Arrays& a) { return a.singleLoads; }
    static const float* place(const Arrays& a, int k) { return a.singlePlaces + a.stride * k; }
    static float third(const Arrays& a, int slot) { return a.singlePlaces[6 * a.stride + slot]; }
    static HWY_INLINE void thirds(const Arrays& a, int slot, SinglePack& to) {
        load(a.singlePlaces + 6 * a.stride + slot, to);
    }
};

/** to[lane] += x, in doubles. */
HWY_INLINE void addToMemory(const SinglePack& x, double* to) {
    Pack sum[SinglePack::packs];
    for (int k = 0; k < SinglePack::packs; k++) load(to + k * lanes(sum[0]), sum[k]);
    addTo(x, sum);
    for (int k = 0; k < SinglePack::packs; k++) store(sum[k], to + k * lanes(sum[0]));
}

// Sums of lanes, always in the same order.
HWY_INLINE double sumOfLanes(const double* x) {
#if HWY_TARGET == HWY_SCALAR
    return ((x[0] + x[4]) + (x[2] + x[6])) + ((x[1] + x[5]) + (x[3] + x[7]));
#else
    const hn::FixedTag<double, 2> d;
    const auto pairs = hn::Add(hn::Add(hn::Load(d, x), hn::Load(d, x + 4)),
                               hn::Add(hn::Load(d, x + 2), hn::Load(d, x + 6)));
    return hn::GetLane(pairs) + hn::ExtractLane(pairs, 1);
#endif
}
HWY_INLINE double sumOfLanes(const float* x) {
#if HWY_TARGET == HWY_SCALAR
    double sum = 0;
    for (int lane = 0; lane < 16; lane++) sum += x[lane];
    return sum;
#else
    const hn::FixedTag<float, 4> d;
    const hn::FixedTag<double, 2> wide;
    const hn::FixedTag<float, 2> half;
    const auto four = hn::Add(hn::Add(hn::Load(d, x), hn::Load(d, x + 8)),
                              hn::Add(hn::Load(d, x + 4), hn::Load(d, x + 12)));
    const auto pairs = hn::Add(hn::PromoteTo(wide, hn::LowerHalf(half, four)),
                               hn::PromoteTo(wide, hn::UpperHalf(half, four)));
    return hn::GetLane(pairs) + hn::ExtractLane(pairs, 1);
#endif
}

/**
 * Some targets, copied so that one register can address all their data, with the lanes of their
 * sums.
 */
template <class Number, int columns, bool torque>
struct Targets {
    using Real = Number;
    using Scalar = typename Real::Scalar;
    using Kind = Precision<Real>;
    static const int size = Kind::block, rows = torque ? 6 : 3;
    HWY_ALIGN Scalar sums[columns * rows][size][Kind::lanes];
    Scalar place[Kind::places][size], third[size], load[columns * rows][size];
    int first, count;
    double largestRadius;

    Targets(const Arrays& arrays, int first, int count)
        : first(first), count(count), largestRadius(0) {
        for (int row = 0; row < columns * rows; row++)
            for (int i = 0; i < count; i++)
                for (int lane = 0; lane < Kind::lanes; lane++) sums[row][i][lane] = 0;
        for (int i = 0; i < count; i++) {
            for (int k = 0; k < Kind::places; k++) place[k][i] = Kind::place(arrays, k)[first + i];
            third[i] = Kind::third(arrays, first + i);
            largestRadius = HWY_MAX(largestRadius, arrays.radius[first + i]);
            for (int c = 0; c < columns; c++)
                for (int k = 0; k < rows; k++)
                    load[c * rows + k][i] =
                        Kind::loads(arrays)[arrays.stride * (6 * c + k) + first + i];
        }
    }
    HWY_INLINE void getLoad(int i, LinearAndAngular<Real, columns>& to) const {
        for (int c = 0; c < columns; c++) {
            const auto& from = &load[c * rows];
            to.linear[c].x = set(from[0][i]);
            to.linear[c].y = set(from[1][i]);
            to.linear[c].z = set(from[2][i]);
            if (!torque) continue;
            to.angular[c].x = set(from[3][i]);
            to.angular[c].y = set(from[4][i]);
            to.angular[c].z = set(from[5][i]);
        }
    }
    HWY_INLINE void getSums(int i, int slot, LinearAndAngular<Real, columns>& to) const {
        const int lane = slot % Kind::lanes;
        for (int c = 0; c < columns; c++) {
            const auto& from = &sums[c * rows];
            getVector(&from[0][i][lane], to.linear[c]);
            if (torque) getVector(&from[3][i][lane], to.angular[c]);
        }
    }
    HWY_INLINE void putSums(int i, int slot, const LinearAndAngular<Real, columns>& from) {
        const int lane = slot % Kind::lanes;
        for (int c = 0; c < columns; c++) {
            auto to = &sums[c * rows];
            putVector(from.linear[c], &to[0][i][lane]);
            if (torque) putVector(from.angular[c], &to[3][i][lane]);
        }
    }
    static HWY_INLINE Real set(Scalar x) { return hn::Set(typename Kind::Tag(), x); }
    static HWY_INLINE void getVector(const Scalar* from, Vector3<Real>& to) {
        RigidHIPlugin::HWY_NAMESPACE::load(from, to.x);
        RigidHIPlugin::HWY_NAMESPACE::load(from + size * Kind::lanes, to.y);
        RigidHIPlugin::HWY_NAMESPACE::load(from + 2 * size * Kind::lanes, to.z);
    }
    static HWY_INLINE void putVector(const Vector3<Real>& from, Scalar* to) {
        store(from.x, to);
        store(from.y, to + size * Kind::lanes);
        store(from.z, to + 2 * size * Kind::lanes);
    }
};

template <class Real>
HWY_INLINE void getVector(const typename Real::Scalar* from, std::size_t stride,
                          Vector3<Real>& to) {
    load(from, to.x);
    load(from + stride, to.y);
    load(from + 2 * stride, to.z);
}

/** A pack of sources. */
template <class Number>
struct SourcePlaces {
    using Real = Number;
    using Kind = Precision<Real>;
    Real place[Kind::places], third, contact2;

    /** @param radius  detects contact with spheres up to this radius */
    HWY_INLINE SourcePlaces(const Arrays& arrays, int slot, double radius) {
        for (int k = 0; k < Kind::places; k++) load(Kind::place(arrays, k) + slot, place[k]);
        Pack contacts[Real::packs];
        for (int k = 0; k < Real::packs; k++) {
            Pack a;
            load(arrays.radius + slot + k * lanes(a), a);
            const Pack sum = a + Pack(radius);
            contacts[k] = sum * sum;
        }
        round(contacts, contact2);
        Kind::thirds(arrays, slot, third);
    }
};
template <int columns, bool torque, class Real>
HWY_INLINE void getLoads(const Arrays& arrays, int slot, LinearAndAngular<Real, columns>& to) {
    for (int c = 0; c < columns; c++) {
        const auto* from = Precision<Real>::loads(arrays) + 6 * c * arrays.stride + slot;
        getVector(from, arrays.stride, to.linear[c]);
        if (torque) getVector(from + 3 * arrays.stride, arrays.stride, to.angular[c]);
    }
}

/**
 * Sums of a pack of sources. In double precision they continue from memory, in single precision
 * they start at zero.
 */
template <int columns, bool torque>
HWY_INLINE void beginSums(const double* sums, std::size_t stride,
                          LinearAndAngular<Pack, columns>& v) {
    for (int c = 0; c < columns; c++, sums += 6 * stride) {
        getVector(sums, stride, v.linear[c]);
        if (torque) getVector(sums + 3 * stride, stride, v.angular[c]);
    }
}
template <int columns, bool torque>
HWY_INLINE void beginSums(const double*, std::size_t, LinearAndAngular<SinglePack, columns>& v) {
    const SinglePack zero(0.0);
    for (int c = 0; c < columns; c++) v.linear[c] = v.angular[c] = {zero, zero, zero};
}
HWY_INLINE void endSums(const Vector3<Pack>& v, double* sums, std::size_t stride) {
    store(v.x, sums);
    store(v.y, sums + stride);
    store(v.z, sums + 2 * stride);
}
HWY_INLINE void endSums(const Vector3<SinglePack>& v, double* sums, std::size_t stride) {
    addToMemory(v.x, sums);
    addToMemory(v.y, sums + stride);
    addToMemory(v.z, sums + 2 * stride);
}
template <bool torque, class Real, int columns>
HWY_INLINE void endSums(const LinearAndAngular<Real, columns>& v, double* sums,
                        std::size_t stride) {
    for (int c = 0; c < columns; c++, sums += 6 * stride) {
        endSums(v.linear[c], sums, stride);
        if (torque) endSums(v.angular[c], sums + 3 * stride, stride);
    }
}

/**
 * r_i - r_j. Single precision adds the rounding errors of the positions, so that near spheres have
 * their true distance.
 */
template <class T>
HWY_INLINE Vector3<Pack> separation(const T& targets, int i, const SourcePlaces<Pack>& sources) {
    const auto& r = targets.place;
    return {T::set(r[0][i]) - sources.place[0], T::set(r[1][i]) - sources.place[1],
            T::set(r[2][i]) - sources.place[2]};
}
template <class T>
HWY_INLINE Vector3<SinglePack> separation(const T& targets, int i,
                                          const SourcePlaces<SinglePack>& sources) {
    const auto& r = targets.place;
    const auto difference = [&](int k) {
        return (T::set(r[k][i]) - sources.place[k]) + (T::set(r[k + 3][i]) - sources.place[k + 3]);
    };
    return {difference(0), difference(1), difference(2)};
}

/**
 * Which pairs of target i and a pack of sources count, and which are far enough for the plain
 * formulas.
 */
template <class Real, bool diagonal>
struct Choice {
    hn::Mask<typename Precision<Real>::Tag> taken, far;
    /**
     * @param numbers  if diagonal: the numbers of the sources, counted as targets. Only sources
     *     after i count
     */
    HWY_INLINE Choice(const Real& distance2, const Real& contact2, int i, const Real& numbers) {
        using Tag = typename Precision<Real>::Tag;
        far = hn::Gt(distance2.v, contact2.v);
        taken = diagonal ? hn::Gt(numbers.v, hn::Set(Tag(), static_cast<typename Real::Scalar>(i)))
                         : hn::Eq(contact2.v, contact2.v);
        if (diagonal) far = hn::And(far, taken);
    }
};
/** The numbers of a pack of sources, counted as targets. */
template <class Real, class T>
HWY_INLINE Real numbersOf(const T& targets, int slot) {
    return Real(hn::Iota(typename Precision<Real>::Tag(),
                         static_cast<typename Real::Scalar>(slot - targets.first)));
}

/**
 * Inverse distances of targets and a pack of sources, computed one pack ahead of the sums. Roots
 * and divisions take long, and a processor can hold only a limited number of other operations while
 * it waits for them.
 */
template <class Number, bool wall>
struct Distances {
    using Real = Number;
    using Kind = Precision<Real>;
    HWY_ALIGN typename Real::Scalar inverse[Kind::block][Kind::lanes];  // 0: overlap, or no pair
    HWY_ALIGN
    typename Real::Scalar image[wall ? Kind::block : 1]
                               [Kind::lanes];  // of i and the mirror image of j; 0: no pair
};

/** Computes the distances of one pack ahead. */
template <class Real, bool wall, bool diagonal, class T>
struct Ahead {
    using Tag = typename Precision<Real>::Tag;
    const T& targets;
    SourcePlaces<Real> sources;
    Real numbers;
    hn::Mask<Tag> allFar;
    Distances<Real, wall>& to;

    HWY_INLINE Ahead(const Arrays& arrays, const T& targets, int slot, Distances<Real, wall>& to)
        : targets(targets), sources(arrays, slot, targets.largestRadius),
          numbers(numbersOf<Real>(targets, slot)), allFar(hn::Eq(numbers.v, numbers.v)), to(to) {}
    HWY_INLINE void find(int i) {
        const Vector3<Real> r = separation(targets, i, sources);
        const Real across2 = multiplyAdd(r.x, r.x, r.y * r.y),
                   distance2 = multiplyAdd(r.z, r.z, across2);
        const Choice<Real, diagonal> choice(distance2, sources.contact2, i, numbers);
        allFar = hn::And(allFar, diagonal ? hn::Or(choice.far, hn::Not(choice.taken)) : choice.far);
        store(Real(hn::IfThenElseZero(choice.far, inverseSquareRoot(distance2).v)), to.inverse[i]);
        if (wall) {
            const Real Z = targets.set(targets.place[2][i]) + sources.place[2];
            const Real p = inverseSquareRoot(multiplyAdd(Z, Z, across2));
            store(diagonal ? Real(hn::IfThenElseZero(choice.taken, p.v)) : p, to.image[i]);
        }
    }
    HWY_INLINE bool isFar() const { return hn::AllTrue(Tag(), allFar); }
};
/**
 * All distances of a pack.
 *
 * @return whether no pairs are left for addNearPairs()
 */
template <class Real, bool wall, bool diagonal, class T>
HWY_NOINLINE bool findDistances(const Arrays& arrays, const T& targets, int end, int slot,
                                Distances<Real, wall>& to) {
    Ahead<Real, wall, diagonal, T> ahead(arrays, targets, slot, to);
    for (int i = 0; i < end; i++) ahead.find(i);
    return ahead.isFar();
}

/**
 * The free part of pairs near contact, of which some overlap. The function is not inlined, because
 * such pairs are rare and would use the registers of the loop.
 */
template <class Real>
HWY_NOINLINE PairMobility<Real> exactPairMobility(const Arrays& arrays, int target, int source) {
    return roundedPairs<Real>([&](int k) {
        const int slot = source + k * lanes(Pack(0.0));
        Pack x, y, z, radius;
        load(arrays.x + slot, x);
        load(arrays.y + slot, y);
        load(arrays.z + slot, z);
        load(arrays.radius + slot, radius);
        const Vector3<Pack> r = {Pack(arrays.x[target]) - x, Pack(arrays.y[target]) - y,
                                 Pack(arrays.z[target]) - z};
        return pairMobility(addedDot(r, r), Pack(arrays.radius[target]), radius);
    });
}

/** Add the pairs near contact, which addPack() leaves out. */
template <class Real, int columns, bool torque_i, bool torque_j, bool diagonal>
HWY_NOINLINE void addNearPairs(const Arrays& arrays, Targets<Real, columns, torque_i>& targets,
                               int slot, double* sums, std::size_t stride) {
    using Tag = typename Precision<Real>::Tag;
    const SourcePlaces<Real> sources(arrays, slot, targets.largestRadius);
    const Real numbers = numbersOf<Real>(targets, slot);
    LinearAndAngular<Real, columns> loads_j;
    getLoads<columns, torque_j>(arrays, slot, loads_j);
    for (int i = 0; i < targets.count; i++) {
        const Vector3<Real> r = separation(targets, i, sources);
        const Real distance2 = multiplyAdd(r.z, r.z, multiplyAdd(r.x, r.x, r.y * r.y));
        const Choice<Real, diagonal> choice(distance2, sources.contact2, i, numbers);
        const auto near = hn::AndNot(choice.far, choice.taken);
        if (hn::AllFalse(Tag(), near)) continue;
        PairMobility<Real> m = exactPairMobility<Real>(arrays, targets.first + i, slot);
        for (Real* factor : {&m.ttI, &m.ttR, &m.tr, &m.rt, &m.rrI, &m.rrR})
            factor->v = hn::IfThenElseZero(near, factor->v);
        const FreeFactors<Real> factors(r, m);
        LinearAndAngular<Real, columns> loads_i, v;
        targets.getLoad(i, loads_i);
        beginSums<columns, torque_j>(sums, stride, v);
        factors.template addToSecond<columns, torque_i, torque_j>(loads_i, v);
        endSums<torque_j>(v, sums, stride);
        targets.getSums(i, slot, v);
        factors.template addToFirst<columns, torque_i, torque_j>(loads_j, v);
        targets.putSums(i, slot, v);
    }
}

/**
 * Add the pairs of targets and a pack of sources.
 *
 * @param end        of the targets
 * @param sums       of the first source
 * @param distances  of these pairs
 * @param next       if `prepare`: the slot of the next pack of sources, whose distances to compute
 * @return whether all pairs of the next pack are far
 */
template <class Real, bool wall, int columns, bool torque_i, bool torque_j, bool prepare>
HWY_NOINLINE bool addPack(const Arrays& arrays, Targets<Real, columns, torque_i>& targets, int end,
                          int slot, double* sums, std::size_t stride,
                          const Distances<Real, wall>& distances, int next,
                          Distances<Real, wall>& nextDistances) {
    using T = Targets<Real, columns, torque_i>;
    const SourcePlaces<Real> sources(arrays, slot, targets.largestRadius);
    Ahead<Real, wall, false, T> ahead(arrays, targets, next, nextDistances);
    LinearAndAngular<Real, columns> loads_j, v_j;
    getLoads<columns, torque_j>(arrays, slot, loads_j);
    beginSums<columns, torque_j>(sums, stride, v_j);
    for (int i = 0; i < end; i++) {
        if (prepare) ahead.find(i);
        const Vector3<Real> r = separation(targets, i, sources);
        const Real third_i = T::set(targets.third[i]);
        Real inverse, p;
        load(distances.inverse[i], inverse);
        const PairMobility<Real> free = farPairMobilityOf(inverse, third_i + sources.third);
        if (wall) load(distances.image[i], p);
        LinearAndAngular<Real, columns> loads_i, v_i;
        targets.getLoad(i, loads_i);
        // Inlined, because a call would double the time.
        const auto add = [&](const auto& factors) __attribute__((always_inline)) {
            factors.template addToSecond<columns, torque_i, torque_j>(loads_i, v_j);
            targets.getSums(i, slot, v_i);
            factors.template addToFirst<columns, torque_i, torque_j>(loads_j, v_i);
            targets.putSums(i, slot, v_i);
        };
        if constexpr (wall)
            add(WallFactors<Real>(r, free, p, T::set(targets.place[2][i]), sources.place[2],
                                  third_i, sources.third));
        else
            add(FreeFactors<Real>(r, free));
    }
    endSums<torque_j>(v_j, sums, stride);
    return prepare && ahead.isFar();
}

/** Add the spheres' own mobility, in double precision. */
template <class Real, bool wall, int columns, bool torque>
HWY_NOINLINE void addSelf(const Arrays& arrays, int first, int end, double* sums,
                          std::size_t stride) {
    const Pack zero(0.0);
    for (int slot = first; slot < end; slot += lanes(zero), sums += lanes(zero)) {
        Pack a, z;
        load(arrays.radius + slot, a);
        load(arrays.z + slot, z);
        LinearAndAngular<Pack, columns> loads, v;
        for (int c = 0; c < columns; c++) {
            double numbers[6][Precision<Pack>::lanes];
            for (int k = 0; k < (torque ? 6 : 3); k++)
                for (int lane = 0; lane < lanes(zero); lane++)
                    numbers[k][lane] =
                        Precision<Real>::loads(arrays)[(6 * c + k) * arrays.stride + slot + lane];
            getVector(numbers[0], Precision<Pack>::lanes, loads.linear[c]);
            if (torque) getVector(numbers[3], Precision<Pack>::lanes, loads.angular[c]);
        }
        beginSums<columns, torque>(sums, stride, v);
        const Vector3<Pack> r = {zero, zero, zero};
        addPairVelocities<columns, torque, torque>(pairMobility(zero, a, a), r, loads.linear,
                                                   loads.angular, v.linear, v.angular);
        if (wall)
            addWallVelocities<columns, torque, torque>(wallMobility(r, z, z, a, a), loads.linear,
                                                       loads.angular, v.linear, v.angular);
        endSums<torque>(v, sums, stride);
    }
}

/** @param second  null if it is the first */
template <class Real, bool wall, int columns, bool torque_i, bool torque_j>
void addRanges(const Arrays& arrays, const SlotRange& first, const SlotRange* second,
               double* firstSums, double* secondSums, std::size_t stride) {
    using Block = Targets<Real, columns, torque_i>;
    const int width = lanes(Real(0.0));
    Distances<Real, wall> both[2];
    for (int start = first.first; start < first.end; start += Block::size) {
        Block targets(arrays, start, HWY_MIN(first.end - start, Block::size));
        double* sums = firstSums + (start - first.first);
        int slot = start;
        if constexpr (torque_i == torque_j) {
            if (!second) {
                addSelf<Real, wall, columns, torque_i>(arrays, start, start + targets.count, sums,
                                                       stride);
                for (; slot < HWY_MIN(start + Block::size, first.end); slot += width) {
                    double* to = firstSums + (slot - first.first);
                    // Later targets come after all of these sources.
                    const int end = HWY_MIN(targets.count, slot - start + width - 1);
                    const bool isFar =
                        findDistances<Real, wall, true>(arrays, targets, end, slot, both[0]);
                    addPack<Real, wall, columns, torque_i, torque_j, false>(
                        arrays, targets, end, slot, to, stride, both[0], slot, both[1]);
                    if (!isFar)
                        addNearPairs<Real, columns, torque_i, torque_j, true>(arrays, targets, slot,
                                                                              to, stride);
                }
            }
        }
        if (second) slot = second->first;
        const int end = second ? second->end : first.end;
        double* to = second ? secondSums : firstSums + (slot - first.first);
        bool isFar = slot < end && findDistances<Real, wall, false>(arrays, targets, targets.count,
                                                                    slot, both[0]);
        for (int turn = 0; slot < end; slot += width, to += width, turn = 1 - turn) {
            const int next = slot + width < end ? slot + width : slot;
            const auto add = next > slot ? addPack<Real, wall, columns, torque_i, torque_j, true>
                                         : addPack<Real, wall, columns, torque_i, torque_j, false>;
            const bool nextIsFar = add(arrays, targets, targets.count, slot, to, stride, both[turn],
                                       next, both[1 - turn]);
            if (HWY_UNLIKELY(!isFar))
                addNearPairs<Real, columns, torque_i, torque_j, false>(arrays, targets, slot, to,
                                                                       stride);
            isFar = nextIsFar;
        }
        for (int c = 0; c < columns; c++)
            for (int k = 0; k < Block::rows; k++)
                for (int i = 0; i < targets.count; i++)
                    sums[(6 * c + k) * stride + i] +=
                        sumOfLanes(targets.sums[c * Block::rows + k][i]);
    }
}

/** If kinds differ, spheres with torque must come first. */
void addPairsOfRanges(const Arrays& arrays, const SlotRange& first, const SlotRange* second,
                      double* firstSums, double* secondSums, std::size_t stride) {
    withFlags(
        [&](auto single, auto wall, auto two, auto torque_i, auto torque_j) {
            using Real = std::conditional_t<single, SinglePack, Pack>;
            if constexpr (torque_i || !torque_j)
                addRanges<Real, wall, two ? 2 : 1, torque_i, torque_j>(
                    arrays, first, second, firstSums, secondSums, stride);
        },
        arrays.singleLoads != nullptr, arrays.hasWall, arrays.columns == 2, first.hasTorque,
        second ? second->hasTorque : first.hasTorque);
}

}  // namespace HWY_NAMESPACE
}  // namespace RigidHIPlugin
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace RigidHIPlugin {

HWY_EXPORT(addPairsOfRanges);

void addPairs(const PairSumArrays& arrays, const SlotRange& first, const SlotRange& second,
              double* firstSums, double* secondSums, std::size_t sumsStride) {
    const bool same = first.first == second.first;
    const auto add = HWY_DYNAMIC_DISPATCH(addPairsOfRanges);
    if (second.hasTorque && !first.hasTorque)
        add(arrays, second, &first, secondSums, firstSums, sumsStride);
    else
        add(arrays, first, same ? nullptr : &second, firstSums, secondSums, sumsStride);
}

}  // namespace RigidHIPlugin

#endif
