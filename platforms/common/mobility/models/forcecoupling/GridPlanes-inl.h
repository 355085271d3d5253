// The columns along x of a fluid between planes: the rows y and -y together, because a wave vector
// along the planes and its opposite have the modes of kz and -kz.

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
 * The flow in the rows y and -y of modes, which are one row where both are the same, and the sums
 * over kz on the planes.
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

    /**
     * Replace the sums by the forces of the planes: respond(x, velocities, forces) for each wave
     * vector except 0.
     */
    template <class Respond>
    void findForces(const Respond& respond) {
        const GridShape& shape = work.layout.shape;
        const int size = shape.size[0];
        std::complex<double> velocities[9], forces[9];
        for (int x = 0; x < size; x++) {
            const int opposite = (size - x) % size;
            if (numRows == 1 && opposite < x) continue;
            for (int i = 0; i < planes.numUnknowns(); i++) velocities[i] = forces[i] = 0;
            // Of kz and -kz, the modes of the latter are the conjugates of those of -kx, -ky and
            // kz.
            for (size_t m = 0; m < profiles.size(); m++)
                for (int c = 0; c < 3; c++) {
                    const std::complex<double> own = sumOf(0, m, c, x),
                                               other = sumOf(numRows - 1, m, c, opposite);
                    const int i = 3 * profiles[m].unknown + c;
                    velocities[i] += profiles[m].isImaginary
                                         ? timesI(own) + std::conj(timesI(other))
                                         : own + std::conj(other);
                }
            if (!(shape.isNyquist(0, x) || shape.isNyquist(1, y) || (x == 0 && y == 0)))
                respond(x, velocities, forces);
            for (size_t m = 0; m < profiles.size(); m++)
                for (int c = 0; c < 3; c++) {
                    const std::complex<double> force = forces[3 * profiles[m].unknown + c];
                    setForce(0, m, c, x, force);
                    setForce(numRows - 1, m, c, opposite, std::conj(force));
                }
        }
    }

    /** In the row y = 0: respond(c, modes, net force) to the mean flow along axis c. */
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
    static std::complex<double> timesI(const std::complex<double>& x) {
        return {-x.imag(), x.real()};
    }
    T* flow(int row, int z) const {
        return flows + ((size_t)row * work.layout.numModes + z) * 3 * length;
    }
    T* sum(int row, int profile, int c) const {
        return sums + (((size_t)row * profiles.size() + profile) * 3 + c) * length;
    }
    std::complex<double> sumOf(int row, int profile, int c, int x) const {
        const T* at = sum(row, profile, c) + 2 * x;
        return {static_cast<double>(at[0]), static_cast<double>(at[1])};
    }
    /** Factors of forces are the conjugates of those of velocities. */
    void setForce(int row, int profile, int c, int x, std::complex<double> force) const {
        if (profiles[profile].isImaginary) force = -timesI(force);
        T* at = sum(row, profile, c) + 2 * x;
        at[0] = static_cast<T>(force.real());
        at[1] = static_cast<T>(force.imag());
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
            k2 = hn::IfThenElse(hn::Gt(k2, hn::Zero(d)), k2, one);  // there are no forces
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
    rows.findForces(
        [&](int x, const std::complex<double>* velocities, std::complex<double>* forces) {
            planes.respond(x, y, velocities, forces);
        });
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
    rows.findForces(
        [&](int x, const std::complex<double>* velocities, std::complex<double>* forces) {
            std::complex<double> own[9];
            for (int i = 0; i < 3 * unknowns; i++) own[i] = numbers[i * size + x];
            planes.respondRandomly(x, y, velocities, own, scale, forces);
        });
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
