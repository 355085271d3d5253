#include "simd/SimdTargets.h"  // must precede foreach_target.h

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "PlainPairs.cpp"
#include "hwy/foreach_target.h"  // must precede highway.h

#include "PlainPairs.h"
#include "hwy/contrib/math/math-inl.h"
#include "hwy/highway.h"

#undef RIGIDHI_TARGET
#define RIGIDHI_TARGET HWY_NAMESPACE

HWY_BEFORE_NAMESPACE();
#include "mobility/models/wall/RotnePragerYamakawaWall-inl.h"
#include "simd/SimdReal-inl.h"

namespace RigidHIPlugin {
namespace HWY_NAMESPACE {

/** to += m from, or its transpose. */
HWY_INLINE void addBlock(const Pack (&m)[3][3], const Pack* from, Pack* to) {
    for (int p = 0; p < 3; p++)
        for (int q = 0; q < 3; q++) to[p] = multiplyAdd(m[p][q], from[q], to[p]);
}
HWY_INLINE void addTransposed(const Pack (&m)[3][3], const Pack* from, Pack* to) {
    for (int p = 0; p < 3; p++)
        for (int q = 0; q < 3; q++) to[q] = multiplyAdd(m[p][q], from[p], to[q]);
}

/** Add the velocities of both particles of a pair, for columns of three or six rows. */
template <bool wall, bool torques, int columns>
HWY_INLINE void addBothWays(const Vector3<Pack>& r, const Pack& zi, const Pack& zj, const Pack& a,
                            const Pack* loads_i, const Pack* loads_j, Pack* v_i, Pack* v_j) {
    constexpr int rows = torques ? 6 : 3;
    const PairMobility<Pack> m = farPairMobility(addedDot(r, r), Pack(2.0) * a * a);
    if (!wall) {
        const Vector3<Pack> opposite = {Pack(0.0) - r.x, Pack(0.0) - r.y, Pack(0.0) - r.z};
        for (bool first : {true, false})
            for (int c = 0; c < columns; c++) {
                const Pack* from = (first ? loads_j : loads_i) + rows * c;
                Pack* to = (first ? v_i : v_j) + rows * c;
                const Vector3<Pack> force = {from[0], from[1], from[2]};
                Vector3<Pack> torque, velocity = {to[0], to[1], to[2]}, omega;
                if (torques) {
                    torque = {from[3], from[4], from[5]};
                    omega = {to[3], to[4], to[5]};
                }
                addPairVelocities<1, torques, torques>(m, first ? r : opposite, &force, &torque,
                                                       &velocity, &omega);
                to[0] = velocity.x;
                to[1] = velocity.y;
                to[2] = velocity.z;
                if (torques) {
                    to[3] = omega.x;
                    to[4] = omega.y;
                    to[5] = omega.z;
                }
            }
        return;
    }
    PairBlocks<Pack> blocks;
    fillPairBlocks<torques, torques>(m, r, Pack(1.0), blocks);
    addWallBlocks<torques, torques>(wallMobility(r, zi, zj, a, a), Pack(1.0), blocks);
    for (int f = 0; f < columns * rows; f += rows) {
        addBlock(blocks.tt, loads_j + f, v_i + f);
        addTransposed(blocks.tt, loads_i + f, v_j + f);
        if (!torques) continue;
        addBlock(blocks.tr, loads_j + f + 3, v_i + f);
        addTransposed(blocks.tr, loads_i + f, v_j + f + 3);
        addBlock(blocks.rt, loads_j + f, v_i + f + 3);
        addTransposed(blocks.rt, loads_i + f + 3, v_j + f);
        addBlock(blocks.rr, loads_j + f + 3, v_i + f + 3);
        addTransposed(blocks.rr, loads_i + f + 3, v_j + f + 3);
    }
}

template <bool wall, bool torques, int columns>
void addTriangle(const PlainPairs& pairs, int first, int step,
                 std::vector<std::vector<double>>& velocities) {
    constexpr int rows = columns * (torques ? 6 : 3);
    const Pack a(pairs.radius);
    const int width = lanes(a);
    const double *x = pairs.x.data(), *y = pairs.y.data(), *z = pairs.z.data(), *load_j[rows];
    double* velocity[rows];
    for (int k = 0; k < rows; k++) {
        load_j[k] = pairs.loads[k].data();
        velocity[k] = velocities[k].data();
    }
    for (int i = first; i < pairs.count; i += step) {
        Pack loads_i[rows], loads_j[rows], v_i[rows], v_j[rows];
        for (int k = 0; k < rows; k++) {
            loads_i[k] = Pack(load_j[k][i]);
            v_i[k] = Pack(0.0);
        }
        const Pack xi(x[i]), yi(y[i]), zi(z[i]);
        for (int j = 0; j < i; j += width) {
            Pack xj, yj, zj;
            load(x + j, xj);
            load(y + j, yj);
            load(z + j, zj);
            // Only a part of the last pack has j < i. The other particles are moved far away and
            // get almost nothing, which is good enough here.
            if (j + width > i)
                xj = hn::IfThenElse(hn::FirstN(Doubles(), i - j), xj.v, hn::Set(Doubles(), 1e30));
            for (int k = 0; k < rows; k++) {
                load(load_j[k] + j, loads_j[k]);
                load(velocity[k] + j, v_j[k]);
            }
            addBothWays<wall, torques, columns>({xi - xj, yi - yj, zi - zj}, zi, zj, a, loads_i,
                                                loads_j, v_i, v_j);
            for (int k = 0; k < rows; k++) store(v_j[k], velocity[k] + j);
        }
        for (int k = 0; k < rows; k++)
            velocity[k][i] += hn::GetLane(hn::SumOfLanes(Doubles(), v_i[k].v));
    }
}

void addPlain(const PlainPairs& pairs, int first, int step,
              std::vector<std::vector<double>>& velocities) {
    const auto task =
        pairs.hasWall ? pairs.torques        ? pairs.columns == 1 ? addTriangle<true, true, 1>
                                                                  : addTriangle<true, true, 2>
                               : pairs.columns == 1 ? addTriangle<true, false, 1>
                                             : addTriangle<true, false, 2>
        : pairs.torques
            ? pairs.columns == 1 ? addTriangle<false, true, 1> : addTriangle<false, true, 2>
        : pairs.columns == 1 ? addTriangle<false, false, 1>
                             : addTriangle<false, false, 2>;
    task(pairs, first, step, velocities);
}

}  // namespace HWY_NAMESPACE
}  // namespace RigidHIPlugin
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace RigidHIPlugin {
HWY_EXPORT(addPlain);
static void chosen(const PlainPairs& pairs, int first, int step,
                   std::vector<std::vector<double>>& velocities) {
    HWY_DYNAMIC_DISPATCH(addPlain)(pairs, first, step, velocities);
}
}  // namespace RigidHIPlugin

void addPlainPairs(const PlainPairs& pairs, int first, int step,
                   std::vector<std::vector<double>>& velocities) {
    RigidHIPlugin::chosen(pairs, first, step, velocities);
}

#endif
