// The columns along x of a fluid between planes. The rows y and -y go together, because a wave
// vector along the planes and its opposite contain the modes of kz and -kz.

#if defined(RIGIDHI_GRID_PLANES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef RIGIDHI_GRID_PLANES_INL_H_
#undef RIGIDHI_GRID_PLANES_INL_H_
#else
#define RIGIDHI_GRID_PLANES_INL_H_
#endif

#include <complex>
#include <vector>

#include "mobility/models/forcecoupling/GridKernels-inl.h"
#include "mobility/models/forcecoupling/GridPlanes.h"

namespace RigidHIPlugin {
namespace HWY_NAMESPACE {

/**
 * The flow in the rows y and -y of modes (one row if both are the same), and the sums over kz on
 * the planes.
 */
template <typename T>
class ConfinedRows {
public:
    ConfinedRows(const GridWork<T>& work, const ChannelWork<T>& channel, int y,
                 GridScratch<T>& scratch)
        : work(work), channel(channel), planes(*work.layout.shape.planes),
          profiles(planes.getProfiles()), length(work.layout.columnNumbers()), y(y) {
        const int size = work.layout.shape.size[1];
        rows[0] = y;
        rows[1] = (size - y) % size;
        numRows = rows[0] == rows[1] ? 1 : 2;
        scratch.flows.resize(2 * (size_t)work.layout.numModes * 3 * length);
        scratch.sums.resize(2 * profiles.size() * 3 * length);
        flows = scratch.flows.data();
        sums = scratch.sums.data();
        std::fill_n(sums, scratch.sums.size(), T(0));
    }

    /**
     * Set the flow of all modes to projected forces or random numbers, and sum it on the planes.
     *
     * @param fill  fill(columns, y, z) sets the columns of a mode along z
     */
    template <bool root, class Fill>
    void makeFlow(double scale, const Fill& fill) {
        for (int r = 0; r < numRows; r++)
            for (int z = 0; z < work.layout.numModes; z++) {
                const OwnEnvelopes<T> columns(work, channel, flow(r, z));
                fill(columns, rows[r], z);
                for (int c = 0; c < 2 && rows[r] == 0 && z == 0; c++)
                    netForce[c] = scale * columns.flow[c][0];
                project<root>(columns, rows[r], z, scale);
                addToSums(columns, r, z);
            }
    }

    /** Replace the sums by the forces of the planes. */
    void findForces() {
        forChunks([&](const Chunk& chunk) {
            gather(chunk);
            turn(chunk, velocities);
            multiply(chunk, planes.responsesOfRow(y), velocities, forces);
            turnBack(chunk, forces);
            scatter(chunk);
        });
    }
    /**
     * Likewise for a random field.
     *
     * @param numbers  random numbers: component c of unknown j at (3 j + c) * size along x + x
     */
    void findRandomForces(const std::complex<double>* numbers, double scale) {
        const int size = work.layout.shape.size[0];
        forChunks([&](const Chunk& chunk) {
            for (int side = 0; side < 2; side++)
                for (int i = 0; i < planes.numUnknowns(); i++)
                    for (int at = 0; at < chunk.count; at++) {
                        const int x = chunk.first + at;
                        const std::complex<double> number =
                            numbers[i * size + (side == 0 ? x : (size - x) % size)];
                        forces.re[side][i][at] = scale * number.real();
                        forces.im[side][i][at] = scale * number.imag();
                    }
            turn(chunk, forces);
            multiply(chunk, planes.rootsOfRow(y), forces, wanted);
            gather(chunk);
            turn(chunk, velocities);
            for (int side = 0; side < 2; side++)
                for (int i = 0; i < planes.numUnknowns(); i++)
                    for (int at = 0; at < chunk.count; at++) {
                        velocities.re[side][i][at] += wanted.re[side][i][at];
                        velocities.im[side][i][at] += wanted.im[side][i][at];
                    }
            multiply(chunk, planes.inversesOfRow(y), velocities, forces);
            turnBack(chunk, forces);
            scatter(chunk);
        });
    }

    /** In the row y = 0: call respond(c, modes, net force) for the mean flow along axis c. */
    template <class Respond>
    void respondToMean(const Respond& respond) {
        if (y != 0) return;
        std::vector<std::complex<double>> modes(work.layout.numModes);
        for (int c = 0; c < 2; c++) {
            for (size_t z = 0; z < modes.size(); z++)
                modes[z] = {static_cast<double>(flow(0, z)[c * length]),
                            static_cast<double>(flow(0, z)[c * length + 1])};
            respond(c, modes.data(), netForce[c]);
            for (size_t z = 0; z < modes.size(); z++) {
                flow(0, z)[c * length] = static_cast<T>(modes[z].real());
                flow(0, z)[c * length + 1] = static_cast<T>(modes[z].imag());
            }
        }
    }

    /** Add the response to the forces of planes, and transform back along x. */
    void scatter() {
        for (int r = 0; r < numRows; r++)
            for (int z = 0; z < work.layout.numModes; z++) {
                addResponse(r, z);
                OwnEnvelopes<T>(work, channel, flow(r, z)).scatter(rows[r], z);
            }
    }

private:
    static constexpr int chunkSize = 64;
    /** Some indices x from 0 to half of the size, with the unit vectors of their wave vectors. */
    struct Chunk {
        int first, count;
        double kx[chunkSize], ky[chunkSize];
    };
    /**
     * Complex numbers of a chunk, for x and for -x: number 3 j + c for component c of unknown j.
     * After turn(), c = 0, 1, 2 are l, t and z, where z is -i times the component.
     */
    struct Numbers {
        double re[2][9][chunkSize], im[2][9][chunkSize];
    };

    template <class Task>
    void forChunks(const Task& task) {
        Chunk chunk;
        const double k = work.layout.shape.waveNumber(1, y);
        for (chunk.first = 0; chunk.first < planes.numOfRow(); chunk.first += chunkSize) {
            chunk.count = std::min(chunkSize, planes.numOfRow() - chunk.first);
            for (int at = 0; at < chunk.count; at++) {
                const double kx = work.layout.shape.waveNumber(0, chunk.first + at),
                             length = std::sqrt(kx * kx + k * k);
                // The matrices for k = 0 are 0.
                chunk.kx[at] = length > 0 ? kx / length : 0;
                chunk.ky[at] = length > 0 ? k / length : 0;
            }
            task(chunk);
        }
    }

    /**
     * Set the velocities to sums of the modes of kz and of -kz, which are the conjugates of those
     * of -kx, -ky and kz.
     */
    void gather(const Chunk& chunk) {
        const int size = work.layout.shape.size[0];
        for (int side = 0; side < 2; side++)
            for (int i = 0; i < planes.numUnknowns(); i++) {
                double *re = velocities.re[side][i], *im = velocities.im[side][i];
                std::fill_n(re, chunkSize, 0.0);
                std::fill_n(im, chunkSize, 0.0);
                for (size_t m = 0; m < profiles.size(); m++) {
                    if (profiles[m].unknown != i / 3) continue;
                    const T *own = sum(0, m, i % 3), *other = sum(numRows - 1, m, i % 3);
                    for (int at = 0; at < chunk.count; at++) {
                        const int x = chunk.first + at, minus = x == 0 ? 0 : size - x,
                                  here = 2 * (side == 0 ? x : minus),
                                  there = 2 * (side == 0 ? minus : x);
                        if (profiles[m].isImaginary) {
                            re[at] -= static_cast<double>(own[here + 1]) + other[there + 1];
                            im[at] += static_cast<double>(own[here]) - other[there];
                        } else {
                            re[at] += static_cast<double>(own[here]) + other[there];
                            im[at] += static_cast<double>(own[here + 1]) - other[there + 1];
                        }
                    }
                }
            }
    }
    /** Replace the sums by forces. Factors of forces are the conjugates of those of velocities. */
    void scatter(const Chunk& chunk) {
        const int size = work.layout.shape.size[0];
        for (int side = 0; side < 2; side++)
            for (size_t m = 0; m < profiles.size(); m++)
                for (int c = 0; c < 3; c++) {
                    const int i = 3 * profiles[m].unknown + c;
                    const double *re = forces.re[side][i], *im = forces.im[side][i];
                    T *own = sum(0, m, c), *other = sum(numRows - 1, m, c);
                    const bool isImaginary = profiles[m].isImaginary;
                    for (int at = 0; at < chunk.count; at++) {
                        const int x = chunk.first + at, minus = x == 0 ? 0 : size - x,
                                  here = 2 * (side == 0 ? x : minus),
                                  there = 2 * (side == 0 ? minus : x);
                        const T first = static_cast<T>(isImaginary ? im[at] : re[at]),
                                second = static_cast<T>(isImaginary ? -re[at] : im[at]);
                        own[here] = first;
                        own[here + 1] = second;
                        // The conjugate, with its own factor.
                        other[there] = isImaginary ? -first : first;
                        other[there + 1] = isImaginary ? second : -second;
                    }
                }
    }

    void turn(const Chunk& chunk, Numbers& u) const {
        for (int side = 0; side < 2; side++)
            for (int j = 0; j < planes.numUnknowns(); j += 3)
                for (double* x : {u.re[side][j], u.im[side][j]}) {
                    double* const y = x + chunkSize;
                    for (int at = 0; at < chunk.count; at++) {
                        const double kx = side == 0 ? chunk.kx[at] : -chunk.kx[at],
                                     ky = chunk.ky[at], l = kx * x[at] + ky * y[at],
                                     t = kx * y[at] - ky * x[at];
                        x[at] = l;
                        y[at] = t;
                    }
                }
        turnZ(chunk, u, 1);
    }
    void turnBack(const Chunk& chunk, Numbers& u) const {
        for (int side = 0; side < 2; side++)
            for (int j = 0; j < planes.numUnknowns(); j += 3)
                for (double* l : {u.re[side][j], u.im[side][j]}) {
                    double* const t = l + chunkSize;
                    for (int at = 0; at < chunk.count; at++) {
                        const double kx = side == 0 ? chunk.kx[at] : -chunk.kx[at],
                                     ky = chunk.ky[at], x = kx * l[at] - ky * t[at],
                                     y = ky * l[at] + kx * t[at];
                        l[at] = x;
                        t[at] = y;
                    }
                }
        turnZ(chunk, u, -1);
    }
    /** Multiply z by -i, or by i for the sign -1. */
    void turnZ(const Chunk& chunk, Numbers& u, double sign) const {
        for (int side = 0; side < 2; side++)
            for (int j = 2; j < planes.numUnknowns(); j += 3)
                for (int at = 0; at < chunk.count; at++) {
                    const double re = u.re[side][j][at];
                    u.re[side][j][at] = sign * u.im[side][j][at];
                    u.im[side][j][at] = -sign * re;
                }
    }

    /** Compute minus the matrices of the row times velocities along l, t and z. */
    void multiply(const Chunk& chunk, const double* matrices, const Numbers& u, Numbers& f) const {
        const int p = planes.numUnknowns() / 3, stride = planes.numOfRow();
        const double *const t = matrices + chunk.first, *const lz = t + (size_t)p * p * stride;
        // The lines of l and z, in the order of the matrix.
        const auto line = [p](int i) { return i < p ? 3 * i : 3 * (i - p) + 2; };
        for (int side = 0; side < 2; side++) {
            for (int i = 0; i < p; i++)
                multiplyRow(
                    chunk.count, t + (size_t)i * stride, (size_t)p * stride, p, u, side,
                    [](int j) { return 3 * j + 1; }, f, 3 * i + 1);
            for (int i = 0; i < 2 * p; i++)
                multiplyRow(chunk.count, lz + (size_t)i * stride, (size_t)2 * p * stride, 2 * p, u,
                            side, line, f, line(i));
        }
    }
    template <class Line>
    static HWY_INLINE void multiplyRow(int count, const double* factors, size_t column,
                                       int numColumns, const Numbers& u, int side, const Line& line,
                                       Numbers& f, int i) {
        const Doubles d;
        for (int at = 0; at < count; at += hn::Lanes(d)) {
            // The last pack may extend beyond the chunk, where the matrices have other numbers.
            auto re = hn::Zero(d), im = hn::Zero(d);
            for (int j = 0; j < numColumns; j++) {
                const auto factor = hn::LoadU(d, factors + j * column + at);
                re = hn::NegMulAdd(factor, hn::LoadU(d, u.re[side][line(j)] + at), re);
                im = hn::NegMulAdd(factor, hn::LoadU(d, u.im[side][line(j)] + at), im);
            }
            hn::StoreU(re, d, f.re[side][i] + at);
            hn::StoreU(im, d, f.im[side][i] + at);
        }
    }

    T* flow(int row, int z) const {
        return flows + ((size_t)row * work.layout.numModes + z) * 3 * length;
    }
    T* sum(int row, int profile, int c) const {
        return sums + (((size_t)row * profiles.size() + profile) * 3 + c) * length;
    }

    void addToSums(const OwnEnvelopes<T>& columns, int r, int z) const {
        const SlabLanes<T> d;
        for (size_t m = 0; m < profiles.size(); m++) {
            // Half of the modes with kz = 0 come from the opposite wave vector.
            const auto factor =
                hn::Set(d, static_cast<T>((z == 0 ? 0.5 : 1) * profiles[m].values[z]));
            for (int c = 0; c < 3; c++) {
                T* const to = sum(r, m, c);
                for (size_t i = 0; i < length; i += hn::Lanes(d))
                    hn::Store(
                        hn::MulAdd(factor, hn::Load(d, columns.flow[c] + i), hn::Load(d, to + i)),
                        d, to + i);
            }
        }
    }

    void addResponse(int r, int z) const {
        const SlabLanes<T> d;
        const GridShape& shape = work.layout.shape;
        const auto one = hn::Set(d, T(1)),
                   ky = hn::Set(d, static_cast<T>(shape.waveNumber(1, rows[r]))),
                   kz = hn::Set(d, static_cast<T>(shape.waveNumber(2, z))),
                   perPeriod = hn::Set(d, static_cast<T>(1 / shape.edge[2]));
        const auto square = hn::MulAdd(kz, kz, hn::Mul(ky, ky));
        for (size_t i = 0; i < length; i += hn::Lanes(d)) {
            auto fu = hn::Zero(d), fv = hn::Zero(d), fw = hn::Zero(d);
            for (size_t m = 0; m < profiles.size(); m++) {
                const auto factor = hn::Set(d, static_cast<T>(profiles[m].values[z]));
                const T* const force = sum(r, m, 0) + i;
                fu = hn::MulAdd(factor, hn::Load(d, force), fu);
                fv = hn::MulAdd(factor, hn::Load(d, force + length), fv);
                fw = hn::MulAdd(factor, hn::Load(d, force + 2 * length), fw);
            }
            const auto kx = hn::Load(d, work.kx + i);
            auto k2 = hn::MulAdd(kx, kx, square);
            k2 = hn::IfThenElse(hn::Gt(k2, hn::Zero(d)), k2, one);  // no forces there
            const auto inverse = hn::Div(one, k2), strength = hn::Mul(perPeriod, inverse),
                       along = hn::Mul(inverse,
                                       hn::MulAdd(kx, fu, hn::MulAdd(ky, fv, hn::Mul(kz, fw))));
            T* const u = flow(r, z) + i;
            T *const v = u + length, *const w = v + length;
            hn::Store(hn::MulAdd(strength, hn::NegMulAdd(along, kx, fu), hn::Load(d, u)), d, u);
            hn::Store(hn::MulAdd(strength, hn::NegMulAdd(along, ky, fv), hn::Load(d, v)), d, v);
            hn::Store(hn::MulAdd(strength, hn::NegMulAdd(along, kz, fw), hn::Load(d, w)), d, w);
        }
    }

    const GridWork<T>& work;
    const ChannelWork<T>& channel;
    const GridPlanes& planes;
    const std::vector<GridPlanes::Profile>& profiles;
    const size_t length;
    const int y;
    int rows[2], numRows;
    T *flows, *sums;
    Numbers velocities, forces, wanted;
    double netForce[2] = {0, 0};
};

/** solveRow() for the rows y and -y of a fluid between planes. */
template <typename T>
void solveRowsBetween(const GridWork<T>& work, const ChannelWork<T>& channel, int y,
                      double viscosity, GridScratch<T>& scratch) {
    const ScopedTimer timer(scratch.seconds.transforms);
    const GridPlanes& planes = *work.layout.shape.planes;
    ConfinedRows<T> rows(work, channel, y, scratch);
    rows.template makeFlow<false>(
        0.5 / (viscosity * work.layout.shape.numNodes()),
        [](const OwnEnvelopes<T>& columns, int row, int z) { columns.gather(row, z); });
    rows.findForces();
    rows.respondToMean([&](int, std::complex<double>* modes, double netForce) {
        planes.respondToMean(modes, netForce);
    });
    rows.scatter();
}

/** drawRow() for the rows y and -y of a fluid between planes. */
inline void drawRowsBetween(const GridWork<double>& work, const ChannelWork<double>& channel, int y,
                            double viscosity, const ModeNoise& noise,
                            GridScratch<double>& scratch) {
    const GridShape& shape = work.layout.shape;
    const GridPlanes& planes = *shape.planes;
    const int size = shape.size[0];
    ConfinedRows<double> rows(work, channel, y, scratch);
    const int unknowns = planes.numUnknowns() / 3;
    scratch.noise.resize(2 * 3 * (size_t)size * unknowns);
    const auto numbers = reinterpret_cast<std::complex<double>*>(scratch.noise.data());
    rows.makeFlow<true>(1 / std::sqrt(viscosity * shape.numNodes()),
                        [&](const OwnEnvelopes<double>& columns, int row, int z) {
                            if (shape.isNyquist(1, row))
                                std::fill_n(numbers, 3 * size, 0.0);
                            else
                                noise.fill(work.waveIndices, size, shape.waveIndex(1, row), z,
                                           numbers);
                            for (int c = 0; c < 3; c++)
                                std::memcpy(columns.flow[c], numbers + c * size,
                                            size * sizeof(std::complex<double>));
                        });
    const double scale = planes.scaleOfNumbers(viscosity);
    if (!shape.isNyquist(1, y))
        for (int j = 0; j < unknowns; j++)
            noise.fillPlane(work.waveIndices, size, y, j, numbers + 3 * j * size);
    rows.findRandomForces(numbers, scale);
    if (y == 0) {
        const GridPlanes::MeanNumbers ofMean(planes, noise);
        rows.respondToMean([&](int c, std::complex<double>* modes, double) {
            planes.respondToMeanRandomly(modes, ofMean.along(c), scale);
        });
    }
    rows.scatter();
}

}  // namespace HWY_NAMESPACE
}  // namespace RigidHIPlugin

#endif
