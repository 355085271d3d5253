#include "host/SimdTargets.h"  // must precede foreach_target.h

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "PlainPairs.cpp"
#include "hwy/foreach_target.h"  // must precede highway.h

#include "PlainPairs.h"
#include "hwy/highway.h"

#undef RIGIDHI_TARGET
#define RIGIDHI_TARGET HWY_NAMESPACE

HWY_BEFORE_NAMESPACE();
#include "mobility/models/wall/RotnePragerYamakawaWall-inl.h"

namespace RigidHIPlugin {
namespace HWY_NAMESPACE {

template <bool wall, bool torques, int columns>
void addTriangle(const PlainPairs& pairs, int first, int step, std::vector<std::vector<double>>& velocities) {
    constexpr int rows = torques ? 6 : 3;
    const int n = pairs.x.size();
    const double a = pairs.radius;
    const double* __restrict x = pairs.x.data(), * __restrict y = pairs.y.data(), * __restrict z = pairs.z.data();
    const double* load[columns * rows];
    double* velocity[columns * rows];
    for (int k = 0; k < columns * rows; k++) {
        load[k] = pairs.loads[k].data();
        velocity[k] = velocities[k].data();
    }
    for (int i = first; i < n; i += step) {
        double mine[columns * rows] = {}, sum[columns * rows] = {};
        for (int k = 0; k < columns * rows; k++) mine[k] = load[k][i];
        const double xi = x[i], yi = y[i], zi = z[i];
#pragma GCC ivdep
        for (int j = 0; j < i; j++) {
            const Vector3<double> r = {xi - x[j], yi - y[j], zi - z[j]};
            PairBlocks<double> m;
            fillPairBlocks<torques, torques>(farPairMobility(r.x * r.x + r.y * r.y + r.z * r.z, 2 * a * a), r, 1.0, m);
            if (wall) addWallBlocks<torques, torques>(wallMobility(r, zi, z[j], a, a), 1.0, m);
            for (int c = 0; c < columns; c++) {
                const int f = c * rows;
                for (int p = 0; p < 3; p++)
                    for (int q = 0; q < 3; q++) {
                        sum[f + p] += m.tt[p][q] * load[f + q][j];
                        velocity[f + q][j] += m.tt[p][q] * mine[f + p];
                        if (!torques) continue;
                        sum[f + p] += m.tr[p][q] * load[f + 3 + q][j];
                        velocity[f + 3 + q][j] += m.tr[p][q] * mine[f + p];
                        sum[f + 3 + p] += m.rt[p][q] * load[f + q][j];
                        velocity[f + q][j] += m.rt[p][q] * mine[f + 3 + p];
                        sum[f + 3 + p] += m.rr[p][q] * load[f + 3 + q][j];
                        velocity[f + 3 + q][j] += m.rr[p][q] * mine[f + 3 + p];
                    }
            }
        }
        for (int k = 0; k < columns * rows; k++) velocity[k][i] += sum[k];
    }
}

void addPlain(const PlainPairs& pairs, int first, int step, std::vector<std::vector<double>>& velocities) {
    const auto task = pairs.hasWall   ? pairs.torques
                                            ? pairs.columns == 1 ? addTriangle<true, true, 1> : addTriangle<true, true, 2>
                                        : pairs.columns == 1 ? addTriangle<true, false, 1>
                                                             : addTriangle<true, false, 2>
                        : pairs.torques ? pairs.columns == 1 ? addTriangle<false, true, 1> : addTriangle<false, true, 2>
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
static void chosen(const PlainPairs& pairs, int first, int step, std::vector<std::vector<double>>& velocities) {
    HWY_DYNAMIC_DISPATCH(addPlain)(pairs, first, step, velocities);
}
}  // namespace RigidHIPlugin

void addPlainPairs(const PlainPairs& pairs, int first, int step, std::vector<std::vector<double>>& velocities) {
    RigidHIPlugin::chosen(pairs, first, step, velocities);
}

#endif
