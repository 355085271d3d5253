// Spreading and averaging between particles and the nodes of a slab, slice by slice.

#if defined(RIGIDHI_GRID_SLICES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef RIGIDHI_GRID_SLICES_INL_H_
#undef RIGIDHI_GRID_SLICES_INL_H_
#else
#define RIGIDHI_GRID_SLICES_INL_H_
#endif

#include "hwy/highway.h"
#include "mobility/models/forcecoupling/GridWork.h"

namespace RigidHIPlugin {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/** A pack of a slab's planes. */
template <typename T>
using SlabLanes = HWY_CAPPED(T, slabWidth);

/** Weights of a slice's planes, times a factor, in the precision of the grid. */
template <typename T>
struct PlaneWeights {
    HWY_ALIGN T numbers[slabWidth];
    PlaneWeights(const double* weights, double factor) {
        for (int i = 0; i < slabWidth; i++) numbers[i] = static_cast<T>(factor * weights[i]);
    }
    HWY_INLINE hn::Vec<SlabLanes<T>> pack(int lane) const {
        return hn::Load(SlabLanes<T>(), numbers + lane);
    }
};

/** Add the forces of a particle to one of the slabs within its reach. */
template <typename T>
void spreadSlice(const GridStencils& stencils, const GridStencils::Slice& slice, const double* F,
                 const GridLayout& layout, const GridSlab<T>& slab) {
    using Weights = GridStencils;
    const SlabLanes<T> d;
    const int width = hn::Lanes(d), p = slice.particle;
    const GridStencils::Stencil& s = stencils[p];
    const double *x = stencils.weightsOf(p, 0, Weights::Force) + slice.offset,
                 *y = stencils.weightsOf(p, 1, Weights::Force),
                 *z = stencils.weightsOf(p, 2, Weights::Force);
    const bool hasTorque = stencils.getParticles().hasTorque[p];
    const PlaneWeights<T> fx(x, F[0]), fy(x, F[1]), fz(x, F[2]);
    if (!hasTorque) {
        for (int j = 0; j < s.width[1]; j++) {
            const GridStencils::Range range = stencils.nodesOf(slice, j);
            if (range.begin == range.end) continue;
            T *u = slab.row(layout, 0, s.first[1] + j), *v = slab.row(layout, 1, s.first[1] + j),
              *w = slab.row(layout, 2, s.first[1] + j);
            for (int lane = 0; lane < slabWidth; lane += width) {
                const auto a = fx.pack(lane), b = fy.pack(lane), c = fz.pack(lane);
                for (int k = range.begin; k < range.end; k++) {
                    const size_t at = (size_t)(s.first[2] + k) * slabWidth + lane;
                    const auto weight = hn::Set(d, static_cast<T>(y[j] * z[k]));
                    hn::Store(hn::MulAdd(a, weight, hn::Load(d, u + at)), d, u + at);
                    hn::Store(hn::MulAdd(b, weight, hn::Load(d, v + at)), d, v + at);
                    hn::Store(hn::MulAdd(c, weight, hn::Load(d, w + at)), d, w + at);
                }
            }
        }
        return;
    }
    // grad(Theta) x T/2, Theta = tx ty tz.
    const double *tx = stencils.weightsOf(p, 0, Weights::Torque) + slice.offset,
                 *gx = stencils.weightsOf(p, 0, Weights::TorqueSlope) + slice.offset;
    const double *ty = stencils.weightsOf(p, 1, Weights::Torque),
                 *gy = stencils.weightsOf(p, 1, Weights::TorqueSlope),
                 *tz = stencils.weightsOf(p, 2, Weights::Torque),
                 *gz = stencils.weightsOf(p, 2, Weights::TorqueSlope);
    const double* torque = F + 3;
    const PlaneWeights<T> plainX(tx, 0.5 * torque[0]), plainY(tx, 0.5 * torque[1]),
        plainZ(tx, 0.5 * torque[2]), slopeY(gx, 0.5 * torque[1]), slopeZ(gx, 0.5 * torque[2]);
    for (int j = 0; j < s.width[1]; j++) {
        const GridStencils::Range range = stencils.nodesOf(slice, j);
        if (range.begin == range.end) continue;
        T *u = slab.row(layout, 0, s.first[1] + j), *v = slab.row(layout, 1, s.first[1] + j),
          *w = slab.row(layout, 2, s.first[1] + j);
        for (int lane = 0; lane < slabWidth; lane += width) {
            const auto a = fx.pack(lane), b = fy.pack(lane), c = fz.pack(lane);
            const auto tX = plainX.pack(lane), tY = plainY.pack(lane), tZ = plainZ.pack(lane),
                       gY = slopeY.pack(lane), gZ = slopeZ.pack(lane);
            for (int k = range.begin; k < range.end; k++) {
                const size_t at = (size_t)(s.first[2] + k) * slabWidth + lane;
                const auto weight = hn::Set(d, static_cast<T>(y[j] * z[k])),
                           alongY = hn::Set(d, static_cast<T>(gy[j] * tz[k])),
                           alongZ = hn::Set(d, static_cast<T>(ty[j] * gz[k])),
                           plain = hn::Set(d, static_cast<T>(ty[j] * tz[k]));
                const auto toU = hn::NegMulAdd(tY, alongZ,
                                               hn::MulAdd(tZ, alongY, hn::Load(d, u + at))),
                           toV = hn::NegMulAdd(gZ, plain,
                                               hn::MulAdd(tX, alongZ, hn::Load(d, v + at))),
                           toW = hn::NegMulAdd(tX, alongY,
                                               hn::MulAdd(gY, plain, hn::Load(d, w + at)));
                hn::Store(hn::MulAdd(a, weight, toU), d, u + at);
                hn::Store(hn::MulAdd(b, weight, toV), d, v + at);
                hn::Store(hn::MulAdd(c, weight, toW), d, w + at);
            }
        }
    }
}

/**
 * The transpose of averageGradientSlice(): add the forces of a particle's dipole, nine numbers, to
 * one of the slabs within its reach.
 */
template <typename T>
void spreadDipoleSlice(const GridStencils& stencils, const GridStencils::Slice& slice,
                       const double* Q, const GridLayout& layout, const GridSlab<T>& slab) {
    using Weights = GridStencils;
    const SlabLanes<T> d;
    const int width = hn::Lanes(d), p = slice.particle;
    const GridStencils::Stencil& s = stencils[p];
    const double *x = stencils.weightsOf(p, 0, Weights::Force) + slice.offset,
                 *gx = stencils.weightsOf(p, 0, Weights::ForceSlope) + slice.offset;
    const double *y = stencils.weightsOf(p, 1, Weights::Force),
                 *gy = stencils.weightsOf(p, 1, Weights::ForceSlope),
                 *z = stencils.weightsOf(p, 2, Weights::Force),
                 *gz = stencils.weightsOf(p, 2, Weights::ForceSlope);
    const PlaneWeights<T> ux(gx, -Q[0]), uy(x, -Q[1]), uz(x, -Q[2]), vx(gx, -Q[3]), vy(x, -Q[4]),
        vz(x, -Q[5]), wx(gx, -Q[6]), wy(x, -Q[7]), wz(x, -Q[8]);
    for (int j = 0; j < s.width[1]; j++) {
        const GridStencils::Range range = stencils.nodesOf(slice, j);
        if (range.begin == range.end) continue;
        T *u = slab.row(layout, 0, s.first[1] + j), *v = slab.row(layout, 1, s.first[1] + j),
          *w = slab.row(layout, 2, s.first[1] + j);
        const auto plainY = hn::Set(d, static_cast<T>(y[j])),
                   slopeY = hn::Set(d, static_cast<T>(gy[j]));
        for (int lane = 0; lane < slabWidth; lane += width) {
            // In a row, forces are these numbers times the weights along z and their slopes.
            const auto u_plain = hn::MulAdd(slopeY, uy.pack(lane), hn::Mul(plainY, ux.pack(lane))),
                       v_plain = hn::MulAdd(slopeY, vy.pack(lane), hn::Mul(plainY, vx.pack(lane))),
                       w_plain = hn::MulAdd(slopeY, wy.pack(lane), hn::Mul(plainY, wx.pack(lane))),
                       u_slope = hn::Mul(plainY, uz.pack(lane)),
                       v_slope = hn::Mul(plainY, vz.pack(lane)),
                       w_slope = hn::Mul(plainY, wz.pack(lane));
            for (int k = range.begin; k < range.end; k++) {
                const size_t at = (size_t)(s.first[2] + k) * slabWidth + lane;
                const auto plain = hn::Set(d, static_cast<T>(z[k])),
                           slope = hn::Set(d, static_cast<T>(gz[k]));
                hn::Store(
                    hn::MulAdd(plain, u_plain, hn::MulAdd(slope, u_slope, hn::Load(d, u + at))), d,
                    u + at);
                hn::Store(
                    hn::MulAdd(plain, v_plain, hn::MulAdd(slope, v_slope, hn::Load(d, v + at))), d,
                    v + at);
                hn::Store(
                    hn::MulAdd(plain, w_plain, hn::MulAdd(slope, w_slope, hn::Load(d, w + at))), d,
                    w + at);
            }
        }
    }
}

/** The sum over planes of the weights times the sums of each plane. */
template <typename T>
HWY_INLINE double overPlanes(const double* weights, const T* sums) {
    double sum = 0;
    for (int i = 0; i < slabWidth; i++) sum += weights[i] * sums[i];
    return sum;
}

/**
 * The transpose of spreadSlice(): the contribution of a slice to the velocities of its particle.
 */
template <typename T>
void averageSlice(const GridStencils& stencils, const GridStencils::Slice& slice,
                  const GridLayout& layout, const GridSlab<T>& slab, double* V) {
    using Weights = GridStencils;
    const SlabLanes<T> d;
    const int width = hn::Lanes(d), p = slice.particle;
    const GridStencils::Stencil& s = stencils[p];
    const double *x = stencils.weightsOf(p, 0, Weights::Force) + slice.offset,
                 *y = stencils.weightsOf(p, 1, Weights::Force),
                 *z = stencils.weightsOf(p, 2, Weights::Force);
    const bool hasTorque = stencils.getParticles().hasTorque[p];
    HWY_ALIGN T sums[8][slabWidth];
    for (int lane = 0; lane < slabWidth; lane += width) {
        auto sum_u = hn::Zero(d), sum_v = hn::Zero(d), sum_w = hn::Zero(d);
        for (int j = 0; j < s.width[1]; j++) {
            const GridStencils::Range range = stencils.nodesOf(slice, j);
            const T *u = slab.row(layout, 0, s.first[1] + j) + lane,
                    *v = slab.row(layout, 1, s.first[1] + j) + lane,
                    *w = slab.row(layout, 2, s.first[1] + j) + lane;
            auto row_u = hn::Zero(d), row_v = hn::Zero(d), row_w = hn::Zero(d);
            for (int k = range.begin; k < range.end; k++) {
                const size_t at = (size_t)(s.first[2] + k) * slabWidth;
                const auto weight = hn::Set(d, static_cast<T>(z[k]));
                row_u = hn::MulAdd(weight, hn::Load(d, u + at), row_u);
                row_v = hn::MulAdd(weight, hn::Load(d, v + at), row_v);
                row_w = hn::MulAdd(weight, hn::Load(d, w + at), row_w);
            }
            const auto weight = hn::Set(d, static_cast<T>(y[j]));
            sum_u = hn::MulAdd(weight, row_u, sum_u);
            sum_v = hn::MulAdd(weight, row_v, sum_v);
            sum_w = hn::MulAdd(weight, row_w, sum_w);
        }
        hn::Store(sum_u, d, sums[0] + lane);
        hn::Store(sum_v, d, sums[1] + lane);
        hn::Store(sum_w, d, sums[2] + lane);
    }
    for (int c = 0; c < 3; c++) V[c] = overPlanes(x, sums[c]);
    if (!hasTorque) return;
    const double *tx = stencils.weightsOf(p, 0, Weights::Torque) + slice.offset,
                 *gx = stencils.weightsOf(p, 0, Weights::TorqueSlope) + slice.offset;
    const double *ty = stencils.weightsOf(p, 1, Weights::Torque),
                 *gy = stencils.weightsOf(p, 1, Weights::TorqueSlope),
                 *tz = stencils.weightsOf(p, 2, Weights::Torque),
                 *gz = stencils.weightsOf(p, 2, Weights::TorqueSlope);
    for (int lane = 0; lane < slabWidth; lane += width) {
        // Sums of: v along z minus w along y; u along z and along y; v and w without slopes.
        auto curl = hn::Zero(d), u_z = hn::Zero(d), u_y = hn::Zero(d), v_plain = hn::Zero(d),
             w_plain = hn::Zero(d);
        for (int j = 0; j < s.width[1]; j++) {
            const GridStencils::Range range = stencils.nodesOf(slice, j);
            const T *u = slab.row(layout, 0, s.first[1] + j) + lane,
                    *v = slab.row(layout, 1, s.first[1] + j) + lane,
                    *w = slab.row(layout, 2, s.first[1] + j) + lane;
            for (int k = range.begin; k < range.end; k++) {
                const size_t at = (size_t)(s.first[2] + k) * slabWidth;
                const auto alongY = hn::Set(d, static_cast<T>(gy[j] * tz[k])),
                           alongZ = hn::Set(d, static_cast<T>(ty[j] * gz[k])),
                           plain = hn::Set(d, static_cast<T>(ty[j] * tz[k]));
                const auto uk = hn::Load(d, u + at), vk = hn::Load(d, v + at),
                           wk = hn::Load(d, w + at);
                curl = hn::NegMulAdd(alongY, wk, hn::MulAdd(alongZ, vk, curl));
                u_z = hn::MulAdd(alongZ, uk, u_z);
                u_y = hn::MulAdd(alongY, uk, u_y);
                v_plain = hn::MulAdd(plain, vk, v_plain);
                w_plain = hn::MulAdd(plain, wk, w_plain);
            }
        }
        hn::Store(curl, d, sums[0] + lane);
        hn::Store(u_z, d, sums[1] + lane);
        hn::Store(u_y, d, sums[2] + lane);
        hn::Store(v_plain, d, sums[3] + lane);
        hn::Store(w_plain, d, sums[4] + lane);
    }
    V[3] = 0.5 * overPlanes(tx, sums[0]);
    V[4] = 0.5 * (overPlanes(gx, sums[4]) - overPlanes(tx, sums[1]));
    V[5] = 0.5 * (overPlanes(tx, sums[2]) - overPlanes(gx, sums[3]));
}

/** Minus the sums with the slopes of the force envelope: nine numbers. */
template <typename T>
void averageGradientSlice(const GridStencils& stencils, const GridStencils::Slice& slice,
                          const GridLayout& layout, const GridSlab<T>& slab, double* gradients) {
    using Weights = GridStencils;
    const SlabLanes<T> d;
    const int width = hn::Lanes(d), p = slice.particle;
    const GridStencils::Stencil& s = stencils[p];
    const double *x = stencils.weightsOf(p, 0, Weights::Force) + slice.offset,
                 *gx = stencils.weightsOf(p, 0, Weights::ForceSlope) + slice.offset;
    const double *y = stencils.weightsOf(p, 1, Weights::Force),
                 *gy = stencils.weightsOf(p, 1, Weights::ForceSlope),
                 *z = stencils.weightsOf(p, 2, Weights::Force),
                 *gz = stencils.weightsOf(p, 2, Weights::ForceSlope);
    HWY_ALIGN T sums[3][slabWidth];
    for (int a = 0; a < 3; a++) {
        for (int lane = 0; lane < slabWidth; lane += width) {
            auto along_x = hn::Zero(d), along_y = hn::Zero(d), along_z = hn::Zero(d);
            for (int j = 0; j < s.width[1]; j++) {
                const GridStencils::Range range = stencils.nodesOf(slice, j);
                const T* u = slab.row(layout, a, s.first[1] + j) + lane;
                auto plain = hn::Zero(d), sloped = hn::Zero(d);
                for (int k = range.begin; k < range.end; k++) {
                    const auto uk = hn::Load(d, u + (size_t)(s.first[2] + k) * slabWidth);
                    plain = hn::MulAdd(hn::Set(d, static_cast<T>(z[k])), uk, plain);
                    sloped = hn::MulAdd(hn::Set(d, static_cast<T>(gz[k])), uk, sloped);
                }
                const auto own = hn::Set(d, static_cast<T>(y[j]));
                along_x = hn::MulAdd(own, plain, along_x);
                along_y = hn::MulAdd(hn::Set(d, static_cast<T>(gy[j])), plain, along_y);
                along_z = hn::MulAdd(own, sloped, along_z);
            }
            hn::Store(along_x, d, sums[0] + lane);
            hn::Store(along_y, d, sums[1] + lane);
            hn::Store(along_z, d, sums[2] + lane);
        }
        gradients[3 * a] = -overPlanes(gx, sums[0]);
        gradients[3 * a + 1] = -overPlanes(x, sums[1]);
        gradients[3 * a + 2] = -overPlanes(x, sums[2]);
    }
}

}  // namespace HWY_NAMESPACE
}  // namespace RigidHIPlugin

#endif
