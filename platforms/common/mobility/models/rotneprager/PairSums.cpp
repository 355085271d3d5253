// Sums over pairs for the Rotne-Prager-Yamakawa mobility, each pair once, compiled once for each instruction set.

#include "host/SimdTargets.h"  // must precede foreach_target.h

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "mobility/models/rotneprager/PairSums.cpp"
#include "hwy/foreach_target.h"  // must precede highway.h

#include <algorithm>
#include <type_traits>

#include "hwy/contrib/math/math-inl.h"
#include "hwy/highway.h"
#include "mobility/models/rotneprager/PairSums.h"

#undef RIGIDHI_TARGET
#define RIGIDHI_TARGET HWY_NAMESPACE

HWY_BEFORE_NAMESPACE();
#include "host/SimdReal-inl.h"
#include "mobility/models/rotneprager/PairsBothWays-inl.h"

namespace RigidHIPlugin {
namespace HWY_NAMESPACE {

typedef PairSumArrays Arrays;

/** What differs between sums in double and in single precision. */
template <class Real>
struct Precision;
template <>
struct Precision<Pack> {
    typedef Doubles Tag;
    static const int places = 3;  // numbers of a position
    static const int block = 16;  // targets whose sums are kept in lanes at once
    static const int lanes = 8;   // of the widest pack
    static const double* loads(const Arrays& a) { return a.loads; }
    static const double* place(const Arrays& a, int k) { return k == 0 ? a.x : k == 1 ? a.y : a.z; }
    static double third(const Arrays& a, int slot) { return 1.0 / 3.0 * (a.radius[slot] * a.radius[slot]); }
    static HWY_INLINE void thirds(const Arrays& a, int slot, Pack& to) {
        Pack radius;
        load(a.radius + slot, radius);
        to = Pack(1.0 / 3.0) * (radius * radius);
    }
};
template <>
struct Precision<SinglePack> {
    typedef Floats Tag;
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
    const auto pairs =
        hn::Add(hn::Add(hn::Load(d, x), hn::Load(d, x + 4)), hn::Add(hn::Load(d, x + 2), hn::Load(d, x + 6)));
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
    const auto four =
        hn::Add(hn::Add(hn::Load(d, x), hn::Load(d, x + 8)), hn::Add(hn::Load(d, x + 4), hn::Load(d, x + 12)));
    const auto pairs =
        hn::Add(hn::PromoteTo(wide, hn::LowerHalf(half, four)), hn::PromoteTo(wide, hn::UpperHalf(half, four)));
    return hn::GetLane(pairs) + hn::ExtractLane(pairs, 1);
#endif
}

/** Some targets, copied so that one register finds everything, with the lanes of their sums. */
template <class Number, int columns, bool torque>
struct Targets {
    typedef Number Real;
    typedef typename Real::Scalar Scalar;
    typedef Precision<Real> Kind;
    static const int size = Kind::block, rows = torque ? 6 : 3;
    HWY_ALIGN Scalar sums[columns * rows][size][Kind::lanes];
    Scalar place[Kind::places][size], third[size], load[columns * rows][size];
    int first, count;
    double largestRadius;

    Targets(const Arrays& arrays, int first, int count) : first(first), count(count), largestRadius(0) {
        for (int row = 0; row < columns * rows; row++)
            for (int i = 0; i < count; i++)
                for (int lane = 0; lane < Kind::lanes; lane++) sums[row][i][lane] = 0;
        for (int i = 0; i < count; i++) {
            for (int k = 0; k < Kind::places; k++) place[k][i] = Kind::place(arrays, k)[first + i];
            third[i] = Kind::third(arrays, first + i);
            largestRadius = HWY_MAX(largestRadius, arrays.radius[first + i]);
            for (int c = 0; c < columns; c++)
                for (int k = 0; k < rows; k++)
                    load[c * rows + k][i] = Kind::loads(arrays)[arrays.stride * (6 * c + k) + first + i];
        }
    }
    HWY_INLINE void getLoad(int i, LinearAndAngular<Real, columns>& to) const {
        for (int c = 0; c < columns; c++) {
            const auto& from = &load[c * rows];
            to.linear[c] = {set(from[0][i]), set(from[1][i]), set(from[2][i])};
            if (torque) to.angular[c] = {set(from[3][i]), set(from[4][i]), set(from[5][i])};
        }
    }
    HWY_INLINE void getSums(int i, int lane, LinearAndAngular<Real, columns>& to) const {
        for (int c = 0; c < columns; c++) {
            const auto& from = &sums[c * rows];
            getVector(&from[0][i][lane], to.linear[c]);
            if (torque) getVector(&from[3][i][lane], to.angular[c]);
        }
    }
    HWY_INLINE void putSums(int i, int lane, const LinearAndAngular<Real, columns>& from) {
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

/** A pack of sources. */
template <class Number, int columns, bool torque>
struct Sources {
    typedef Number Real;
    typedef Precision<Real> Kind;
    Real place[Kind::places], third, contact2;
    LinearAndAngular<Real, columns> loads;

    /** @param radius  contact with none of this radius is missed */
    HWY_INLINE Sources(const Arrays& arrays, int slot, double radius) {
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
        for (int c = 0; c < columns; c++) {
            const auto* from = Kind::loads(arrays) + 6 * c * arrays.stride + slot;
            getVector(from, arrays.stride, loads.linear[c]);
            if (torque) getVector(from + 3 * arrays.stride, arrays.stride, loads.angular[c]);
        }
    }
    static HWY_INLINE void getVector(const typename Real::Scalar* from, std::size_t stride, Vector3<Real>& to) {
        load(from, to.x);
        load(from + stride, to.y);
        load(from + 2 * stride, to.z);
    }
};

/** Sums of a pack of sources: in double precision they go on from memory, in single precision they start anew. */
template <int columns, bool torque>
HWY_INLINE void beginSums(const double* sums, std::size_t stride, LinearAndAngular<Pack, columns>& v) {
    for (int c = 0; c < columns; c++, sums += 6 * stride) {
        Sources<Pack, columns, torque>::getVector(sums, stride, v.linear[c]);
        if (torque) Sources<Pack, columns, torque>::getVector(sums + 3 * stride, stride, v.angular[c]);
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
HWY_INLINE void endSums(const LinearAndAngular<Real, columns>& v, double* sums, std::size_t stride) {
    for (int c = 0; c < columns; c++, sums += 6 * stride) {
        endSums(v.linear[c], sums, stride);
        if (torque) endSums(v.angular[c], sums + 3 * stride, stride);
    }
}

/** r_i - r_j. In single precision what rounding left of positions is added, so that near spheres have their true distance. */
template <class T, class S>
HWY_INLINE Vector3<Pack> separation(const T& targets, int i, const S& sources, Pack*) {
    const auto& r = targets.place;
    return {T::set(r[0][i]) - sources.place[0], T::set(r[1][i]) - sources.place[1], T::set(r[2][i]) - sources.place[2]};
}
template <class T, class S>
HWY_INLINE Vector3<SinglePack> separation(const T& targets, int i, const S& sources, SinglePack*) {
    const auto& r = targets.place;
    const auto difference = [&](int k) {
        return (T::set(r[k][i]) - sources.place[k]) + (T::set(r[k + 3][i]) - sources.place[k + 3]);
    };
    return {difference(0), difference(1), difference(2)};
}

/** Target i and a pack of sources: where they are, and which pairs are to be taken, and are far enough for the plain formulas. */
template <class Real, bool diagonal>
struct Pairs {
    typedef hn::Mask<typename Precision<Real>::Tag> Mask;
    Vector3<Real> r;
    Real across2, distance2;
    Mask taken, far;
    /** @param numbers  diagonal: of sources as targets are counted; taken are those behind i */
    template <class T, class S>
    HWY_INLINE Pairs(const T& targets, int i, const S& sources, const Real& numbers)
        : r(separation(targets, i, sources, static_cast<Real*>(nullptr))) {
        across2 = multiplyAdd(r.x, r.x, r.y * r.y);
        distance2 = multiplyAdd(r.z, r.z, across2);
        far = hn::Gt(distance2.v, sources.contact2.v);
        taken = diagonal ? hn::Gt(numbers.v, T::set(i).v) : hn::Eq(numbers.v, numbers.v);
        far = hn::And(far, taken);
    }
};

/** The free part of pairs near contact, of which some overlap. Out of line: rare, and it would take the registers of the loop. */
template <class Real>
HWY_NOINLINE PairMobility<Real> exactPairMobility(const Arrays& arrays, int target, int source) {
    constexpr int packs = Real::packs;
    Pack ttI[packs], ttR[packs], tr[packs], rt[packs], rrI[packs], rrR[packs];
    for (int k = 0; k < packs; k++, source += lanes(ttI[0])) {
        Pack x, y, z, radius;
        load(arrays.x + source, x);
        load(arrays.y + source, y);
        load(arrays.z + source, z);
        load(arrays.radius + source, radius);
        const Vector3<Pack> r = {Pack(arrays.x[target]) - x, Pack(arrays.y[target]) - y, Pack(arrays.z[target]) - z};
        const auto m = pairMobility(addedDot(r, r), Pack(arrays.radius[target]), radius);
        ttI[k] = m.ttI;
        ttR[k] = m.ttR;
        tr[k] = m.tr;
        rt[k] = m.rt;
        rrI[k] = m.rrI;
        rrR[k] = m.rrR;
    }
    PairMobility<Real> m;
    round(ttI, m.ttI);
    round(ttR, m.ttR);
    round(tr, m.tr);
    round(rt, m.rt);
    round(rrI, m.rrI);
    round(rrR, m.rrR);
    return m;
}

/** What addPack() left out. */
template <class Real, int columns, bool torque_i, bool torque_j, bool diagonal>
HWY_NOINLINE void addNearPairs(const Arrays& arrays, Targets<Real, columns, torque_i>& targets, int end, int slot,
                               int lane, double* sums, std::size_t stride, const Real& numbers) {
    typedef typename Precision<Real>::Tag Tag;
    const Sources<Real, columns, torque_j> sources(arrays, slot, targets.largestRadius);
    for (int i = 0; i < end; i++) {
        const Pairs<Real, diagonal> pairs(targets, i, sources, numbers);
        const auto near = hn::AndNot(pairs.far, pairs.taken);
        if (hn::AllFalse(Tag(), near)) continue;
        PairMobility<Real> m = exactPairMobility<Real>(arrays, targets.first + i, slot);
        for (Real* factor : {&m.ttI, &m.ttR, &m.tr, &m.rt, &m.rrI, &m.rrR})
            factor->v = hn::IfThenElseZero(near, factor->v);
        const FreeFactors<Real> factors(pairs.r, m);
        LinearAndAngular<Real, columns> load, v;
        targets.getLoad(i, load);
        beginSums<columns, torque_j>(sums, stride, v);
        factors.template addToSecond<columns, torque_i, torque_j>(load, v);
        endSums<torque_j>(v, sums, stride);
        targets.getSums(i, lane, v);
        factors.template addToFirst<columns, torque_i, torque_j>(sources.loads, v);
        targets.putSums(i, lane, v);
    }
}

/**
 * Targets and a pack of sources.
 *
 * @param end   of the targets
 * @param sums  of the first source
 */
template <class Real, bool wall, int columns, bool torque_i, bool torque_j, bool diagonal>
HWY_NOINLINE void addPack(const Arrays& arrays, Targets<Real, columns, torque_i>& targets, int end, int slot, int lane,
                          double* sums, std::size_t stride) {
    typedef typename Precision<Real>::Tag Tag;
    typedef typename std::conditional<wall, WallFactors<Real>, FreeFactors<Real>>::type Factors;
    const Sources<Real, columns, torque_j> sources(arrays, slot, targets.largestRadius);
    const Real numbers = hn::Iota(Tag(), static_cast<typename Real::Scalar>(slot - targets.first));
    LinearAndAngular<Real, columns> v_j;
    beginSums<columns, torque_j>(sums, stride, v_j);
    auto allFar = hn::Eq(sources.third.v, sources.third.v);
    for (int i = 0; i < end; i++) {
        const Pairs<Real, diagonal> pairs(targets, i, sources, numbers);
        allFar = hn::And(allFar, pairs.far);
        const Real inverse = hn::IfThenElseZero(pairs.far, inverseSquareRoot(pairs.distance2).v);
        const Real third_i = targets.set(targets.third[i]);
        const PairMobility<Real> free = farPairMobilityOf(inverse, third_i + sources.third);
        const auto factors = [&] {
            if constexpr (wall) {
                const Real z_i = targets.set(targets.place[2][i]), Z = z_i + sources.place[2];
                Real p = inverseSquareRoot(multiplyAdd(Z, Z, pairs.across2));
                if (diagonal) p = hn::IfThenElseZero(pairs.taken, p.v);
                return Factors(pairs.r, free, p, z_i, sources.place[2], third_i, sources.third);
            } else {
                return Factors(pairs.r, free);
            }
        }();
        LinearAndAngular<Real, columns> load_i, v_i;
        targets.getLoad(i, load_i);
        factors.template addToSecond<columns, torque_i, torque_j>(load_i, v_j);
        targets.getSums(i, lane, v_i);
        factors.template addToFirst<columns, torque_i, torque_j>(sources.loads, v_i);
        targets.putSums(i, lane, v_i);
    }
    endSums<torque_j>(v_j, sums, stride);
    if (diagonal || HWY_UNLIKELY(!hn::AllTrue(Tag(), allFar)))
        addNearPairs<Real, columns, torque_i, torque_j, diagonal>(arrays, targets, end, slot, lane, sums, stride,
                                                                  numbers);
}

/** What spheres do to themselves, in double precision. */
template <class Real, bool wall, int columns, bool torque>
HWY_NOINLINE void addSelf(const Arrays& arrays, int first, int end, double* sums, std::size_t stride) {
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
                    numbers[k][lane] = Precision<Real>::loads(arrays)[(6 * c + k) * arrays.stride + slot + lane];
            Sources<Pack, 1, torque>::getVector(numbers[0], Precision<Pack>::lanes, loads.linear[c]);
            if (torque) Sources<Pack, 1, torque>::getVector(numbers[3], Precision<Pack>::lanes, loads.angular[c]);
        }
        beginSums<columns, torque>(sums, stride, v);
        const Vector3<Pack> r = {zero, zero, zero};
        addPairVelocities<columns, torque, torque>(pairMobility(zero, a, a), r, loads.linear, loads.angular, v.linear,
                                                   v.angular);
        if (wall)
            addWallVelocities<columns, torque, torque>(wallMobility(r, z, z, a, a), loads.linear, loads.angular,
                                                       v.linear, v.angular);
        endSums<torque>(v, sums, stride);
    }
}

/** @param second  null: the same as the first */
template <class Real, bool wall, int columns, bool torque_i, bool torque_j>
void addRanges(const Arrays& arrays, const SlotRange& first, const SlotRange* second, double* firstSums,
               double* secondSums, std::size_t stride) {
    typedef Targets<Real, columns, torque_i> Block;
    const int width = lanes(Real(0.0)), widest = Precision<Real>::lanes;
    for (int start = first.first; start < first.end; start += Block::size) {
        Block targets(arrays, start, HWY_MIN(first.end - start, Block::size));
        double* sums = firstSums + (start - first.first);
        if (second) {
            for (int slot = second->first; slot < second->end; slot += width)
                addPack<Real, wall, columns, torque_i, torque_j, false>(
                    arrays, targets, targets.count, slot, slot % widest, secondSums + (slot - second->first), stride);
        } else if constexpr (torque_i == torque_j) {
            addSelf<Real, wall, columns, torque_i>(arrays, start, start + targets.count, sums, stride);
            for (int slot = start; slot < first.end; slot += width) {
                double* to = firstSums + (slot - first.first);
                if (slot < start + Block::size)
                    addPack<Real, wall, columns, torque_i, torque_j, true>(
                        arrays, targets, HWY_MIN(targets.count, slot - start + width - 1), slot, slot % widest, to,
                        stride);
                else
                    addPack<Real, wall, columns, torque_i, torque_j, false>(arrays, targets, targets.count, slot,
                                                                            slot % widest, to, stride);
            }
        }
        for (int c = 0; c < columns; c++)
            for (int k = 0; k < Block::rows; k++)
                for (int i = 0; i < targets.count; i++)
                    sums[(6 * c + k) * stride + i] += sumOfLanes(targets.sums[c * Block::rows + k][i]);
    }
}

template <class Real, bool wall, int columns>
void addKinds(const Arrays& arrays, const SlotRange& first, const SlotRange* second, double* firstSums,
              double* secondSums, std::size_t stride) {
    const bool torque_j = second ? second->hasTorque : first.hasTorque;
    (!first.hasTorque ? addRanges<Real, wall, columns, false, false>
     : torque_j       ? addRanges<Real, wall, columns, true, true>
                : addRanges<Real, wall, columns, true, false>)(arrays, first, second, firstSums, secondSums, stride);
}
template <class Real>
void addBoundaries(const Arrays& arrays, const SlotRange& first, const SlotRange* second, double* firstSums,
                   double* secondSums, std::size_t stride) {
    (arrays.hasWall        ? arrays.columns == 1 ? addKinds<Real, true, 1> : addKinds<Real, true, 2>
            : arrays.columns == 1 ? addKinds<Real, false, 1>
                           : addKinds<Real, false, 2>)(arrays, first, second, firstSums, secondSums, stride);
}
/** Spheres with torque come first, if kinds differ. */
void addPairsOfRanges(const Arrays& arrays, const SlotRange& first, const SlotRange* second, double* firstSums,
                      double* secondSums, std::size_t stride) {
    (arrays.singleLoads ? addBoundaries<SinglePack> : addBoundaries<Pack>)(arrays, first, second, firstSums, secondSums,
                                                                           stride);
}

}  // namespace HWY_NAMESPACE
}  // namespace RigidHIPlugin
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace RigidHIPlugin {

HWY_EXPORT(addPairsOfRanges);

void addPairs(const PairSumArrays& arrays, const SlotRange& first, const SlotRange& second, double* firstSums,
              double* secondSums, std::size_t sumsStride) {
    const bool same = first.first == second.first;
    if (second.hasTorque && !first.hasTorque)
        HWY_DYNAMIC_DISPATCH(addPairsOfRanges)(arrays, second, &first, secondSums, firstSums, sumsStride);
    else
        HWY_DYNAMIC_DISPATCH(addPairsOfRanges)
        (arrays, first, same ? nullptr : &second, firstSums, secondSums, sumsStride);
}

}  // namespace RigidHIPlugin

#endif
