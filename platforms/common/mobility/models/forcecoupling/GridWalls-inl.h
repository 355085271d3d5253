// The columns along x of channels beside walls. The rows y and -y go together, because a wave
// vector along the walls and its opposite contain the modes of kz and -kz.

#if defined(RIGIDHI_GRID_WALLS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef RIGIDHI_GRID_WALLS_INL_H_
#undef RIGIDHI_GRID_WALLS_INL_H_
#else
#define RIGIDHI_GRID_WALLS_INL_H_
#endif

#include <complex>

#include "mobility/models/forcecoupling/GridKernels-inl.h"
#include "mobility/models/forcecoupling/GridWalls.h"

namespace RigidHIPlugin {
namespace HWY_NAMESPACE {

/**
 * The flow in the rows y and -y of modes (one row if both are the same), with sums of forces over
 * kz and the factors of the flows of walls (GridWalls).
 */
template <typename T>
class RowsBesideWalls {
public:
    RowsBesideWalls(const GridWork<T>& work, const ChannelWork<T>* channels, int count, int y,
                    GridScratch<T>& scratch)
        : work(work), channels(channels), count(count), walls(*work.layout.shape.walls),
          length(work.layout.columnNumbers()), y(y), scratch(scratch) {
        const GridShape& shape = work.layout.shape;
        const int size = shape.size[1];
        rows[0] = y;
        rows[1] = (size - y) % size;
        numRows = rows[0] == rows[1] ? 1 : 2;
        scratch.flows.resize(2 * (size_t)work.layout.numModes * 3 * length);
        scratch.sums.resize((2 * (size_t)count * numProfiles * 3 + 2) * length);
        std::fill_n(scratch.sums.data(), scratch.sums.size(), T(0));
        cosh = scratch.sums.data() + scratch.sums.size() - 2 * length;
        sinh = cosh + length;
        // Numbers for waves without walls do not matter, but must be finite.
        std::fill_n(cosh, 2 * length, T(1));
        for (int x = 0; x < shape.size[0]; x++) {
            const double k = std::hypot(shape.waveNumber(0, x), shape.waveNumber(1, y));
            if (k == 0) continue;
            const GridWalls::Along along = walls.along(k);
            cosh[2 * x] = cosh[2 * x + 1] = static_cast<T>(along.cosh);
            sinh[2 * x] = sinh[2 * x + 1] = static_cast<T>(along.sinh);
        }
    }

    void makeFlow(double scale) {
        for (int r = 0; r < numRows; r++)
            for (int z = 0; z < work.layout.numModes; z++) {
                const SharedEnvelopes<T> columns = columnsAt(r, z);
                columns.gather(rows[r], z,
                               [&](int g, T* const* forces) { addToSums(r, g, z, forces); });
                project<false>(columns, rows[r], z, scale);
            }
    }

    /** Replace the sums by factors of profiles. */
    void respond(double scale) {
        const int size = work.layout.shape.size[0];
        std::vector<std::complex<double>> all(count * numProfiles * 3);
        const auto sums = reinterpret_cast<GridWalls::Sums*>(all.data());
        for (int x = 0; x < size; x++) {
            const int opposite = (size - x) % size;
            if (numRows == 1 && opposite < x) continue;
            // The modes of -kz are the conjugates of those of -kx, -ky and kz. Profiles are even or
            // odd in kz.
            forSums([&](int g, int p, int c) {
                const std::complex<double> other = std::conj(at(numRows - 1, g, p, c, opposite));
                sums[g][p][c] = at(0, g, p, c, x) + (GridWalls::isOdd(p) ? -other : other);
            });
            walls.respond(x, y, channels, count, sums);
            forSums([&](int g, int p, int c) {
                const std::complex<double> factor = scale * sums[g][p][c];
                set(0, g, p, c, x, factor);
                set(numRows - 1, g, p, c, opposite,
                    GridWalls::isOdd(p) ? -std::conj(factor) : std::conj(factor));
            });
        }
    }

    /** Draw the modes of a random field without factors of channels, and sum them on the planes. */
    void draw(double scale, const ModeNoise& noise) {
        const GridShape& shape = work.layout.shape;
        const size_t size = shape.size[0];
        const std::vector<GridPlanes::Profile>& profiles = walls.getFields().getProfiles();
        scratch.noise.resize(2 * 3 * size * GridWallFields::numSets);
        const auto numbers = reinterpret_cast<std::complex<double>*>(scratch.noise.data());
        ofPlanes.assign(2 * profiles.size() * 3 * length, 0.0);
        for (int r = 0; r < numRows; r++)
            for (int z = 0; z < work.layout.numModes; z++) {
                const SharedEnvelopes<T> columns = columnsAt(r, z);
                std::fill_n(columns.flow[0], 3 * length, T(0));
                if (!shape.isNyquist(1, rows[r])) {
                    noise.fill(work.waveIndices, size, shape.waveIndex(1, rows[r]), z, numbers);
                    for (int c = 0; c < 3; c++)
                        std::memcpy(columns.flow[c], numbers + c * size,
                                    size * sizeof(std::complex<double>));
                }
                project<true>(columns, rows[r], z, scale);
                const double half = z == 0 ? 0.5 : 1;
                const T* const root = walls.getFields().getFactors().column(rows[r], z, T());
                for (size_t m = 0; m < profiles.size(); m++) {
                    const T factor = half * profiles[m].values[z];
                    for (int c = 0; c < 3; c++) {
                        T* const to = ofPlane(r, m, c);
                        for (size_t i = 0; i < length; i++)
                            to[i] += factor * root[i] * columns.flow[c][i];
                    }
                }
            }
    }
    /**
     * Replace the sums on the planes by forces, for subtractNear(), and set the sums to factors of
     * profiles.
     *
     * @param numbers  random numbers: component c of set j at (3 j + c) * size along x + x
     */
    void respondRandomly(const std::complex<double>* numbers, double scale) {
        const int size = work.layout.shape.size[0], unknowns = GridWallFields::numUnknowns;
        const std::vector<GridPlanes::Profile>& profiles = walls.getFields().getProfiles();
        std::vector<std::complex<double>> all(count * numProfiles * 3);
        const auto sums = reinterpret_cast<GridWalls::Sums*>(all.data());
        const std::complex<double> turn(0, 1);
        for (int x = 0; x < size; x++) {
            const int opposite = (size - x) % size;
            if (numRows == 1 && opposite < x) continue;
            std::complex<double> velocities[unknowns] = {}, near[unknowns],
                                 own[3 * GridWallFields::numSets];
            for (size_t m = 0; m < profiles.size(); m++)
                for (int c = 0; c < 3; c++) {
                    const T *here = ofPlane(0, m, c) + 2 * x,
                            *there = ofPlane(numRows - 1, m, c) + 2 * opposite;
                    std::complex<double> a(here[0], here[1]), b(there[0], there[1]);
                    if (profiles[m].isImaginary) {
                        a *= turn;
                        b *= turn;
                    }
                    velocities[3 * profiles[m].unknown + c] += a + std::conj(b);
                }
            for (int i = 0; i < 3 * GridWallFields::numSets; i++) own[i] = numbers[i * size + x];
            walls.respondRandomly(x, y, channels, count, velocities, own, scale, near, sums);
            for (size_t m = 0; m < profiles.size(); m++)
                for (int c = 0; c < 3; c++) {
                    std::complex<double> f = near[3 * profiles[m].unknown + c], g = std::conj(f);
                    if (profiles[m].isImaginary) {
                        f *= -turn;
                        g *= -turn;
                    }
                    T *here = ofPlane(0, m, c) + 2 * x,
                      *there = ofPlane(numRows - 1, m, c) + 2 * opposite;
                    here[0] = f.real();
                    here[1] = f.imag();
                    there[0] = g.real();
                    there[1] = g.imag();
                }
            forSums([&](int g, int p, int c) {
                const std::complex<double> factor = sums[g][p][c];
                set(0, g, p, c, x, factor);
                set(numRows - 1, g, p, c, opposite,
                    GridWalls::isOdd(p) ? -std::conj(factor) : std::conj(factor));
            });
        }
    }
    /** Subtract the flow of the forces from the modes. */
    void subtractNear() {
        const Lanes d;
        const GridShape& shape = work.layout.shape;
        const std::vector<GridPlanes::Profile>& profiles = walls.getFields().getProfiles();
        const auto one = hn::Set(d, T(1));
        for (int r = 0; r < numRows; r++)
            for (int z = 0; z < work.layout.numModes; z++) {
                const auto ky = hn::Set(d, static_cast<T>(shape.waveNumber(1, rows[r]))),
                           kz = hn::Set(d, static_cast<T>(shape.waveNumber(2, z))),
                           perPeriod =
                               hn::Set(d, static_cast<T>(1 / walls.getFields().getPeriod())),
                           square = hn::MulAdd(kz, kz, hn::Mul(ky, ky));
                const T* const root = walls.getFields().getFactors().column(rows[r], z, T());
                T* const flow =
                    scratch.flows.data() + ((size_t)r * work.layout.numModes + z) * 3 * length;
                for (size_t i = 0; i < length; i += hn::Lanes(d)) {
                    Pack f[3] = {hn::Zero(d), hn::Zero(d), hn::Zero(d)};
                    for (size_t m = 0; m < profiles.size(); m++) {
                        const auto factor = hn::Set(d, static_cast<T>(profiles[m].values[z]));
                        for (int c = 0; c < 3; c++)
                            f[c] = hn::MulAdd(factor, hn::LoadU(d, ofPlane(r, m, c) + i), f[c]);
                    }
                    const auto kx = hn::Load(d, work.kx + i);
                    auto k2 = hn::MulAdd(kx, kx, square);
                    k2 = hn::IfThenElse(hn::Gt(k2, hn::Zero(d)), k2, one);  // no forces there
                    const auto strength = hn::Mul(perPeriod, hn::Load(d, root + i)),
                               along = hn::Div(
                                   hn::MulAdd(kx, f[0], hn::MulAdd(ky, f[1], hn::Mul(kz, f[2]))),
                                   k2);
                    const Pack k[3] = {kx, ky, kz};
                    for (int c = 0; c < 3; c++) {
                        T* const to = flow + c * length + i;
                        hn::Store(hn::NegMulAdd(strength, hn::NegMulAdd(along, k[c], f[c]),
                                                hn::Load(d, to)),
                                  d, to);
                    }
                }
            }
    }

    /** Add the flows of walls, and transform back along x. */
    void scatter() {
        for (int r = 0; r < numRows; r++)
            for (int z = 0; z < work.layout.numModes; z++)
                columnsAt(r, z).scatter(
                    rows[r], z, [&](int g, T* const* velocities) { addFlow(r, g, z, velocities); });
    }

private:
    static constexpr int numProfiles = GridWalls::numProfiles;
    using Lanes = SlabLanes<T>;
    using Pack = hn::Vec<Lanes>;

    SharedEnvelopes<T> columnsAt(int r, int z) {
        return SharedEnvelopes<T>(
            work, channels, count, scratch,
            scratch.flows.data() + ((size_t)r * work.layout.numModes + z) * 3 * length);
    }
    /** For the planes: sums of a profile, later forces. */
    T* ofPlane(int r, int profile, int c) {
        const size_t numProfilesOfPlanes = walls.getFields().getProfiles().size();
        return ofPlanes.data() + ((r * numProfilesOfPlanes + profile) * 3 + c) * length;
    }
    T* column(int r, int g, int p, int c) const {
        return scratch.sums.data() + ((((size_t)r * count + g) * numProfiles + p) * 3 + c) * length;
    }
    std::complex<double> at(int r, int g, int p, int c, int x) const {
        const T* of = column(r, g, p, c) + 2 * x;
        return {static_cast<double>(of[0]), static_cast<double>(of[1])};
    }
    void set(int r, int g, int p, int c, int x, const std::complex<double>& value) const {
        T* of = column(r, g, p, c) + 2 * x;
        of[0] = static_cast<T>(value.real());
        of[1] = static_cast<T>(value.imag());
    }
    template <class Task>
    void forSums(const Task& task) const {
        for (int g = 0; g < count; g++)
            for (int p = 0; p < numProfiles; p++)
                for (int c = 0; c < 3; c++) task(g, p, c);
    }
    /** GridWalls::profiles() of a pack of waves, times `factor`. */
    HWY_INLINE void profiles(size_t i, const GridWalls::Across& b, double factor,
                             Pack (&values)[numProfiles]) const {
        const Lanes d;
        const auto cosY = hn::Set(d, static_cast<T>(b.cos)),
                   sinY = hn::Set(d, static_cast<T>(b.sin)),
                   sign = hn::Set(d, static_cast<T>(factor * b.sign)), ch = hn::Load(d, cosh + i),
                   sh = hn::Load(d, sinh + i);
        const auto re = hn::Mul(sh, cosY), im = hn::Mul(ch, sinY);
        const auto w = hn::Div(hn::Set(d, T(1)), hn::MulAdd(re, re, hn::Mul(im, im)));
        const auto p = hn::Mul(re, w), q = hn::Mul(im, w);
        const auto square = hn::NegMulAdd(q, q, hn::Mul(p, p)), twice = hn::Mul(hn::Add(p, p), q);
        const auto e = hn::Mul(ch, cosY), f = hn::Mul(sh, sinY);
        values[0] = hn::Mul(sign, p);
        values[1] = hn::Mul(sign, q);
        values[2] = hn::Mul(sign, hn::MulAdd(e, square, hn::Mul(f, twice)));
        values[3] = hn::Mul(sign, hn::NegMulAdd(f, square, hn::Mul(e, twice)));
    }
    void addToSums(int r, int g, int z, T* const* forces) const {
        const Lanes d;
        // Half of the modes with kz = 0 come from the opposite wave vector.
        const double half = z == 0 ? 0.5 : 1;
        const GridWalls::Across across = walls.across(z);
        for (size_t i = 0; i < length; i += hn::Lanes(d)) {
            Pack values[numProfiles];
            profiles(i, across, half, values);
            for (int c = 0; c < 3; c++) {
                const auto f = hn::Load(d, forces[c] + i);
                for (int p = 0; p < numProfiles; p++) {
                    T* const to = column(r, g, p, c) + i;
                    hn::Store(hn::MulAdd(values[p], f, hn::Load(d, to)), d, to);
                }
            }
        }
    }
    void addFlow(int r, int g, int z, T* const* velocities) const {
        const Lanes d;
        const GridWalls::Across across = walls.across(z);
        for (size_t i = 0; i < length; i += hn::Lanes(d)) {
            Pack values[numProfiles];
            profiles(i, across, 1, values);
            for (int c = 0; c < 3; c++) {
                auto v = hn::Load(d, velocities[c] + i);
                for (int p = 0; p < numProfiles; p++)
                    v = hn::MulAdd(values[p], hn::Load(d, column(r, g, p, c) + i), v);
                hn::Store(v, d, velocities[c] + i);
            }
        }
    }

    const GridWork<T>& work;
    const ChannelWork<T>* const channels;
    const int count;
    const GridWalls& walls;
    const size_t length;
    const int y;
    GridScratch<T>& scratch;
    int rows[2], numRows;
    T *cosh, *sinh;
    std::vector<T> ofPlanes;
};

/** solveRow() for the rows y and -y of channels beside walls. */
template <typename T>
void solveRowsBeside(const GridWork<T>& work, const ChannelWork<T>* channels, int count, int y,
                     double viscosity, GridScratch<T>& scratch) {
    const ScopedTimer timer(scratch.seconds.transforms);
    RowsBesideWalls<T> rows(work, channels, count, y, scratch);
    rows.makeFlow(0.5 / (viscosity * work.layout.shape.numNodes()));
    // Modes of rows are twice as large.
    rows.respond(0.5 / viscosity);
    rows.scatter();
}

/** drawRow() for the rows y and -y of channels beside walls. */
inline void drawRowsBeside(const GridWork<double>& work, const ChannelWork<double>* channels,
                           int count, int y, double viscosity, const ModeNoise& noise,
                           GridScratch<double>& scratch) {
    const GridShape& shape = work.layout.shape;
    const int size = shape.size[0];
    RowsBesideWalls<double> rows(work, channels, count, y, scratch);
    rows.draw(1 / std::sqrt(viscosity * shape.numNodes()), noise);
    const auto numbers = reinterpret_cast<std::complex<double>*>(scratch.noise.data());
    if (!shape.isNyquist(1, y))
        for (int j = 0; j < GridWallFields::numSets; j++)
            noise.fillPlane(work.waveIndices, size, y, j, numbers + 3 * j * size);
    rows.respondRandomly(numbers, shape.walls->getFields().scaleOfNumbers(viscosity));
    rows.subtractNear();
    rows.scatter();
}

}  // namespace HWY_NAMESPACE
}  // namespace RigidHIPlugin

#endif
