#include <fftw3.h>

#include <algorithm>
#include <mutex>

#include "mobility/models/forcecoupling/GridFluid.h"
#include "mobility/models/forcecoupling/GridPlanes.h"
#include "mobility/models/forcecoupling/GridWalls.h"
#include "openmmrigidhi/internal/FourierPlanner.h"

using std::complex;

namespace RigidHIPlugin {

namespace {

using Kind = GridStencils::Kind;

/**
 * Call visit(node, i, j, k) for all nodes of a stencil. i, j and k are the indices of its weights
 * along the axes.
 */
template <class Visit>
void forNodes(const GridStencils& stencils, int p, const Visit& visit) {
    const GridStencils::Stencil& s = stencils[p];
    const std::array<int, 3>& n = stencils.getShape().size;
    const GridStencils::Range own = stencils.slicesOf(p);
    for (int number = own.begin; number < own.end; number++) {
        const GridStencils::Slice& slice = stencils.slice(stencils.sliceNumber(number));
        const int planes = stencils.planesOf((s.first[0] + std::max(0, slice.offset)) % n[0] /
                                             GridStencils::slabWidth);
        for (int i = std::max(0, slice.offset); i < std::min(s.width[0], slice.offset + planes);
             i++)
            for (int j = 0; j < s.width[1]; j++) {
                const GridStencils::Range range = stencils.nodesOf(slice, j);
                const size_t row =
                    ((size_t)((s.first[0] + i) % n[0]) * n[1] + (s.first[1] + j) % n[1]) * n[2];
                for (int k = range.begin; k < range.end; k++)
                    visit(row + (s.first[2] + k) % n[2], i, j, k);
            }
    }
}

/** An envelope of a particle with its derivatives: the weights along the axes, and their slopes. */
struct Envelope {
    const double *w[3], *slope[3];
    Envelope(const GridStencils& stencils, int p, Kind kind, Kind slopeKind) {
        for (int axis = 0; axis < 3; axis++) {
            w[axis] = stencils.weightsOf(p, axis, kind);
            slope[axis] = stencils.weightsOf(p, axis, slopeKind);
        }
    }
    double value(int i, int j, int k) const { return w[0][i] * w[1][j] * w[2][k]; }
    /**
     * The derivative by the position of the node, which is minus that by the position of the
     * particle.
     */
    void gradient(int i, int j, int k, double* g) const {
        g[0] = slope[0][i] * w[1][j] * w[2][k];
        g[1] = w[0][i] * slope[1][j] * w[2][k];
        g[2] = w[0][i] * w[1][j] * slope[2][k];
    }
};

/** Call visit(number, indices, k, k^2) for all modes of a grid, with k^2 = 0 for excluded modes. */
template <class Visit>
void forModes(const GridShape& shape, const Visit& visit) {
    size_t at = 0;
    int index[3];
    for (index[0] = 0; index[0] < shape.size[0]; index[0]++)
        for (index[1] = 0; index[1] < shape.size[1]; index[1]++)
            for (index[2] = 0; index[2] < shape.numRowModes(); index[2]++, at++) {
                const std::array<double, 3> k = shape.waveVector(index[0], index[1], index[2]);
                bool isOut = false;
                for (int axis = 0; axis < 3; axis++)
                    isOut = isOut || shape.isNyquist(axis, index[axis]);
                visit(at, index, k.data(), isOut ? 0 : k[0] * k[0] + k[1] * k[1] + k[2] * k[2]);
            }
}

/** The factor of a mode of forModes(). */
double factorOf(const GridFactors& factors, const int* index, double k2) {
    return k2 > 0 ? factors.column(index[1], index[2], double())[2 * index[0]] : 0;
}

/** u <- strength (1 - k k/k^2) u */
void project(const double* k, double k2, double strength, complex<double>* u) {
    const complex<double> along = (k[0] * u[0] + k[1] * u[1] + k[2] * u[2]) / k2;
    for (int c = 0; c < 3; c++) u[c] = strength * (u[c] - along * k[c]);
}

}  // namespace

PlainGridFluid::~PlainGridFluid() { release(); }

void PlainGridFluid::release() {
    if (!forwardPlan) return;
    const std::lock_guard<std::mutex> lock(fourierPlanner());
    fftw_destroy_plan((fftw_plan)forwardPlan);
    fftw_destroy_plan((fftw_plan)backwardPlan);
    forwardPlan = nullptr;
}

void PlainGridFluid::prepare(const GridShape& shape) {
    if (forwardPlan && planned.size == shape.size) {
        planned = shape;
        return;
    }
    release();
    held = memory(shape);
    planned = shape;
    const std::array<int, 3>& n = shape.size;
    const std::lock_guard<std::mutex> lock(fourierPlanner());
    for (int c = 0; c < 3; c++) {
        work.values[c].resize(shape.numNodes());
        modes[c].resize(2 * (size_t)n[0] * n[1] * shape.numRowModes());
    }
    forwardPlan =
        fftw_plan_dft_r2c_3d(n[0], n[1], n[2], work.values[0].data(),
                             (fftw_complex*)modes[0].data(), FFTW_ESTIMATE | FFTW_UNALIGNED);
    backwardPlan = fftw_plan_dft_c2r_3d(n[0], n[1], n[2], (fftw_complex*)modes[0].data(),
                                        work.values[0].data(), FFTW_ESTIMATE | FFTW_UNALIGNED);
}

/** f(x) = sum over particles of F Delta(x - Y) + curl(T Theta(x - Y))/2 */
void PlainGridFluid::spread(const GridStencils& stencils, const double* forces) {
    const ScopedTimer timer(seconds.spreading);
    const HydrodynamicParticles& particles = stencils.getParticles();
    for (AlignedArray& component : work.values)
        std::fill(component.data(), component.data() + component.size(), 0.0);
    for (int p = 0; p < particles.size(); p++) {
        const double* F = forces + particles.firstRow[p];
        const Envelope force(stencils, p, Kind::Force, Kind::ForceSlope);
        forNodes(stencils, p, [&](size_t node, int i, int j, int k) {
            const double w = force.value(i, j, k);
            for (int c = 0; c < 3; c++) work.values[c][node] += w * F[c];
        });
        if (!particles.hasTorque[p]) continue;
        const double* T = F + 3;
        const Envelope torque(stencils, p, Kind::Torque, Kind::TorqueSlope);
        forNodes(stencils, p, [&](size_t node, int i, int j, int k) {
            double g[3];
            torque.gradient(i, j, k, g);
            for (int c = 0; c < 3; c++) {
                const int d = (c + 1) % 3, e = (c + 2) % 3;
                work.values[c][node] += 0.5 * (g[d] * T[e] - g[e] * T[d]);
            }
        });
    }
    if (planned.mirrored) addReflections();
}

/** f_a(x) = - sum over particles and b of Q_ab dDelta(x - Y)/dx_b */
void PlainGridFluid::spreadDipoles(const GridStencils& stencils, const double* dipoles) {
    const ScopedTimer timer(seconds.spreading);
    for (AlignedArray& component : work.values)
        std::fill(component.data(), component.data() + component.size(), 0.0);
    for (int p = 0; p < stencils.size(); p++) {
        const double* Q = dipoles + 9 * (size_t)p;
        const Envelope force(stencils, p, Kind::Force, Kind::ForceSlope);
        forNodes(stencils, p, [&](size_t node, int i, int j, int k) {
            double g[3];
            force.gradient(i, j, k, g);
            for (int a = 0; a < 3; a++)
                for (int b = 0; b < 3; b++) work.values[a][node] -= Q[3 * a + b] * g[b];
        });
    }
}

/** f(r) <- f(r) + P f(Pr) */
void PlainGridFluid::addReflections() {
    const std::array<int, 3>& n = planned.size;
    for (int c = 0; c < 3; c++)
        for (int x = 0; x < n[0]; x++)
            for (int y = 0; y < n[1] / 2; y++) {
                double* const plane = work.values[c].data() + (size_t)x * n[1] * n[2];
                double *row = plane + (size_t)y * n[2],
                       *reflected = plane + (size_t)(n[1] - 1 - y) * n[2];
                const int sign = c == 1 ? -1 : 1;
                for (int z = 0; z < n[2]; z++) {
                    row[z] += sign * reflected[z];
                    reflected[z] = sign * row[z];
                }
            }
}

void PlainGridFluid::store(size_t at, const complex<double>* u) {
    for (int c = 0; c < 3; c++) {
        modes[c][2 * at] = u[c].real();
        modes[c][2 * at + 1] = u[c].imag();
    }
}

void PlainGridFluid::backward(GridField& field) {
    const ScopedTimer timer(seconds.transforms);
    for (int c = 0; c < 3; c++)
        fftw_execute_dft_c2r((fftw_plan)backwardPlan, (fftw_complex*)modes[c].data(),
                             field.values[c].data());
}

void PlainGridFluid::multiplyColumn(const GridStencils& stencils, double viscosity,
                                    const double* forces, double* velocities) {
    prepare(stencils.getShape());
    work.shape = planned;
    work.rowLength = planned.size[2];
    spread(stencils, forces);
    respond(viscosity);
    backward(work);
    averageColumn(work, stencils, velocities);
}

void PlainGridFluid::forward() {
    for (int c = 0; c < 3; c++)
        fftw_execute_dft_r2c((fftw_plan)forwardPlan, work.values[c].data(),
                             (fftw_complex*)modes[c].data());
}

/** Compute the modes of the flow from the forces on nodes. */
void PlainGridFluid::respond(double viscosity) {
    double netForce[2];
    respondWithoutPlanes(viscosity, netForce);
    if (!planned.planes) return;
    const GridPlanes& planes = *planned.planes;
    confine([&](int x, int y, const complex<double>* velocities,
                complex<double>* forces) { planes.respond(x, y, velocities, forces); },
            [&](int x, int y, const complex<double>* forces) { addResponse(x, y, forces); });
    for (int c = 0; c < 2; c++)
        planes.respondToMean(reinterpret_cast<complex<double>*>(modes[c].data()), netForce[c]);
}

/** Likewise without planes. Also give the net force along x and y. */
void PlainGridFluid::respondWithoutPlanes(double viscosity, double* netForce) {
    const ScopedTimer timer(seconds.transforms);
    forward();
    // u(k) = (1 - k k/k^2) f(k)/(eta k^2); a forward and a backward transform multiply by the
    // number of nodes.
    const double scale = 1 / (viscosity * planned.numNodes());
    for (int c = 0; c < 2; c++) netForce[c] = scale * modes[c][0];
    forModes(planned, [&](size_t at, const int*, const double* k, double k2) {
        complex<double> u[3] = {};
        if (k2 > 0) {
            for (int c = 0; c < 3; c++) u[c] = {modes[c][2 * at], modes[c][2 * at + 1]};
            project(k, k2, scale / k2, u);
        }
        store(at, u);
    });
}

/**
 * Call add(x, y, forces) with the forces of planes for each wave vector along the planes, except 0.
 * respond(x, y, velocities, forces) finds the forces from the velocities on the planes.
 */
template <class Respond, class Add>
void PlainGridFluid::confine(const Respond& respond, const Add& add) {
    const GridPlanes& planes = *planned.planes;
    const std::array<int, 3>& n = planned.size;
    const int numModes = (n[2] + 1) / 2, unknowns = planes.numUnknowns();
    const auto isOut = [&](int x, int y) {
        return (x == 0 && y == 0) || planned.isNyquist(0, x) || planned.isNyquist(1, y);
    };
    // Of kz and -kz, the modes of the latter are the conjugates of those of -kx, -ky and kz.
    std::vector<complex<double>> velocities((size_t)n[0] * n[1] * unknowns), forces(unknowns);
    const auto velocitiesOf = [&](int x, int y) {
        return velocities.data() +
               ((size_t)(x + n[0]) % n[0] * n[1] + (y + n[1]) % n[1]) * unknowns;
    };
    for (int x = 0; x < n[0]; x++)
        for (int y = 0; y < n[1]; y++)
            for (const GridPlanes::Profile& profile : planes.getProfiles())
                for (int c = 0; c < 3; c++)
                    for (int z = 0; z < numModes; z++) {
                        const complex<double> part =
                            (z == 0 ? 0.5 : 1) * profile.values[z] * mode(c, x, y, z) *
                            (profile.isImaginary ? complex<double>(0, 1) : complex<double>(1, 0));
                        velocitiesOf(x, y)[3 * profile.unknown + c] += part;
                        velocitiesOf(-x, -y)[3 * profile.unknown + c] += conj(part);
                    }
    for (int x = 0; x < n[0]; x++)
        for (int y = 0; y < n[1]; y++) {
            if (isOut(x, y)) continue;
            respond(x, y, velocitiesOf(x, y), forces.data());
            add(x, y, forces.data());
        }
}

/** Add the response to forces of planes to the modes of a wave vector along the planes. */
void PlainGridFluid::addResponse(int x, int y, const complex<double>* forces) {
    const GridPlanes& planes = *planned.planes;
    for (int z = 0; z < (planned.size[2] + 1) / 2; z++) {
        complex<double> u[3] = {};
        for (const GridPlanes::Profile& profile : planes.getProfiles())
            for (int c = 0; c < 3; c++)
                u[c] += profile.values[z] * forces[3 * profile.unknown + c] *
                        (profile.isImaginary ? complex<double>(0, -1) : complex<double>(1, 0));
        const double k[3] = {planned.waveNumber(0, x), planned.waveNumber(1, y),
                             planned.waveNumber(2, z)},
                     k2 = k[0] * k[0] + k[1] * k[1] + k[2] * k[2];
        project(k, k2, 1 / (k2 * planned.edge[2]), u);
        for (int c = 0; c < 3; c++) mode(c, x, y, z) += u[c];
    }
}

complex<double>& PlainGridFluid::mode(int c, int x, int y, int z) {
    const size_t at = ((size_t)x * planned.size[1] + y) * planned.numRowModes() + z;
    return reinterpret_cast<complex<double>*>(modes[c].data())[at];
}

void PlainGridFluid::drawModes(const GridStencils& stencils, double viscosity,
                               const ModeNoise& noise, GridField& field) {
    const GridShape& shape = stencils.getShape();
    prepare(shape);
    field.shape = shape;
    field.rowLength = shape.size[2];
    for (AlignedArray& component : field.values) component.resize(shape.numNodes());
    drawInto(shape, viscosity, noise, nullptr);
    backward(field);
}

/**
 * Draw the modes of the random field.
 *
 * @param factors  null for 1/|k|
 */
void PlainGridFluid::drawInto(const GridShape& shape, double viscosity, const ModeNoise& noise,
                              const GridFactors* factors) {
    const double scale = 1 / std::sqrt(viscosity * shape.numNodes());
    forModes(shape, [&](size_t at, const int* index, const double* k, double k2) {
        complex<double> zeta[3] = {};
        if (k2 > 0) {
            const int nx = shape.waveIndex(0, index[0]);
            noise.fill(&nx, 1, shape.waveIndex(1, index[1]), index[2], zeta);
            project(k, k2, scale * (factors ? factorOf(*factors, index, k2) : 1 / std::sqrt(k2)),
                    zeta);
            // The random numbers belong to modes with their origin at y = 0. The modes here have
            // their origin at the first node.
            for (complex<double>& u : zeta) u *= std::polar(1.0, k[1] * shape.firstNode(1));
        }
        store(at, zeta);
    });
    if (!shape.planes) return;
    const GridPlanes& planes = *shape.planes;
    planes.prepareFields();
    const double ofPlanes = planes.scaleOfNumbers(viscosity);
    complex<double> numbers[12];
    const auto respond = [&](int x, int y, const complex<double>* velocities,
                             complex<double>* forces) {
        const int nx = shape.waveIndex(0, x), ny = shape.waveIndex(1, y);
        for (int j = 0; 3 * j < planes.numUnknowns(); j++)
            noise.fillPlane(&nx, 1, ny, j, numbers + 3 * j);
        planes.respondRandomly(x, y, velocities, numbers, ofPlanes, forces);
    };
    confine(respond,
            [&](int x, int y, const complex<double>* forces) { addResponse(x, y, forces); });
    GridPlanes::MeanNumbers ofMean(planes, noise);
    for (int c = 0; c < 2; c++)
        planes.respondToMeanRandomly(reinterpret_cast<complex<double>*>(modes[c].data()),
                                     ofMean.along(c), ofPlanes);
}

// ---- Channels: envelopes of any shape, with a factor for each mode

namespace {

/** The flows of walls for channels (GridWalls); nothing if the grid has no walls. */
class WallFactors {
public:
    /** @param modes  modes of the forces of channels, three for each channel */
    WallFactors(const GridShape& shape, const std::vector<GridChannel>& channels,
                const std::vector<AlignedArray>& modes)
        : WallFactors(shape, channels) {
        if (!shape.walls) return;
        const std::array<int, 3>& n = shape.size;
        forModes(shape, [&](size_t at, const int* index, const double*, double k2) {
            if (!(k2 > 0)) return;
            double values[GridWalls::numProfiles];
            profilesAt(index, values);
            // The modes of -kz are the conjugates of those of -kx, -ky and kz. Half of the modes
            // with kz = 0 come from there, too.
            const double half = index[2] == 0 ? 0.5 : 1;
            for (int g = 0; g < numChannels; g++)
                for (int c = 0; c < 3; c++) {
                    const AlignedArray& of = modes[3 * g + c];
                    const complex<double> f = half * complex<double>(of[2 * at], of[2 * at + 1]);
                    for (int p = 0; p < GridWalls::numProfiles; p++) {
                        sumsAt(g, index[0], index[1])[3 * p + c] += values[p] * f;
                        sumsAt(g, n[0] - index[0], n[1] - index[1])[3 * p + c] +=
                            (GridWalls::isOdd(p) ? -values[p] : values[p]) * std::conj(f);
                    }
                }
        });
        for (int x = 0; x < n[0]; x++)
            for (int y = 0; y < n[1]; y++)
                shape.walls->respond(x, y, channels.data(), numChannels,
                                     reinterpret_cast<GridWalls::Sums*>(sumsAt(0, x, y)));
    }
    /** Add the flow of a mode of a channel. */
    void add(int channel, const int* index, double factor, complex<double>* u) {
        if (!shape.walls) return;
        double values[GridWalls::numProfiles];
        profilesAt(index, values);
        const complex<double>* const of = sumsAt(channel, index[0], index[1]);
        for (int p = 0; p < GridWalls::numProfiles; p++)
            for (int c = 0; c < 3; c++) u[c] += factor * values[p] * of[3 * p + c];
    }

protected:
    WallFactors(const GridShape& shape, const std::vector<GridChannel>& channels)
        : shape(shape), numChannels(channels.size()) {
        if (!shape.walls) return;
        const std::array<int, 3>& n = shape.size;
        for (int x = 0; x < n[0]; x++)
            for (int y = 0; y < n[1]; y++)
                along.push_back(
                    shape.walls->along(std::hypot(shape.waveNumber(0, x), shape.waveNumber(1, y))));
        sums.resize((size_t)n[0] * n[1] * numChannels * numbers);
    }
    static constexpr int numbers = 3 * GridWalls::numProfiles;
    void profilesAt(const int* index, double (&values)[GridWalls::numProfiles]) const {
        GridWalls::profiles(along[(size_t)index[0] * shape.size[1] + index[1]],
                            shape.walls->across(index[2]), values);
    }
    complex<double>* sumsAt(int channel, int x, int y) {
        const std::array<int, 3>& n = shape.size;
        return &sums[(((size_t)(x % n[0]) * n[1] + y % n[1]) * numChannels + channel) * numbers];
    }

    const GridShape& shape;
    const int numChannels;

private:
    std::vector<GridWalls::Along> along;

protected:
    std::vector<complex<double>> sums;
};

/** Likewise for random fields, with the forces of planes on the modes that the grid lacks. */
class RandomWallFactors : public WallFactors {
public:
    /** @param bare  bare(index, k, k2, u) sets the field of a mode without factors */
    template <class Bare>
    RandomWallFactors(const GridShape& shape, const std::vector<GridChannel>& channels,
                      double viscosity, const ModeNoise& noise, const Bare& bare)
        : WallFactors(shape, channels) {
        if (!shape.walls) return;
        const GridWallFields& fields = shape.walls->getFields();
        const std::array<int, 3>& n = shape.size;
        forces.resize((size_t)n[0] * n[1] * unknowns);
        forModes(shape, [&](size_t, const int* index, const double* k, double k2) {
            if (!(k2 > 0)) return;
            complex<double> u[3];
            bare(index, k, k2, u);
            // Half of the modes with kz = 0 come from the opposite wave vector.
            const double factor =
                (index[2] == 0 ? 0.5 : 1) * factorOf(fields.getFactors(), index, k2);
            for (const GridPlanes::Profile& profile : fields.getProfiles())
                for (int c = 0; c < 3; c++) {
                    const complex<double> part =
                        factor * profile.values[index[2]] * u[c] *
                        (profile.isImaginary ? complex<double>(0, 1) : complex<double>(1, 0));
                    forcesAt(index[0], index[1])[3 * profile.unknown + c] += part;
                    forcesAt(n[0] - index[0], n[1] - index[1])[3 * profile.unknown + c] +=
                        std::conj(part);
                }
        });
        const double scale = fields.scaleOfNumbers(viscosity);
        complex<double> numbersOfPlanes[3 * GridWallFields::numSets], near[unknowns];
        for (int x = 0; x < n[0]; x++)
            for (int y = 0; y < n[1]; y++) {
                const int nx = shape.waveIndex(0, x), ny = shape.waveIndex(1, y);
                for (int j = 0; j < GridWallFields::numSets; j++)
                    noise.fillPlane(&nx, 1, ny, j, numbersOfPlanes + 3 * j);
                shape.walls->respondRandomly(x, y, channels.data(), numChannels, forcesAt(x, y),
                                             numbersOfPlanes, scale, near,
                                             reinterpret_cast<GridWalls::Sums*>(sumsAt(0, x, y)));
                std::copy_n(near, unknowns, forcesAt(x, y));
            }
    }
    /** Subtract the flow of the forces from a mode of the field without factors. */
    void subtractNear(const int* index, const double* k, double k2, complex<double>* u) {
        if (!shape.walls) return;
        const GridWallFields& fields = shape.walls->getFields();
        complex<double> f[3] = {};
        for (const GridPlanes::Profile& profile : fields.getProfiles())
            for (int c = 0; c < 3; c++)
                f[c] += profile.values[index[2]] *
                        forcesAt(index[0], index[1])[3 * profile.unknown + c] *
                        (profile.isImaginary ? complex<double>(0, -1) : complex<double>(1, 0));
        project(k, k2, factorOf(fields.getFactors(), index, k2) / fields.getPeriod(), f);
        for (int c = 0; c < 3; c++) u[c] -= f[c];
    }

private:
    static constexpr int unknowns = GridWallFields::numUnknowns;
    complex<double>* forcesAt(int x, int y) {
        const std::array<int, 3>& n = shape.size;
        return &forces[((size_t)(x % n[0]) * n[1] + y % n[1]) * unknowns];
    }
    std::vector<complex<double>> forces;
};

/** u <- i k x u/2: half of the curl. It is its own adjoint. */
void halfCurl(const double* k, complex<double>* u) {
    const complex<double> half(0, 0.5),
        x = k[1] * u[2] - k[2] * u[1], y = k[2] * u[0] - k[0] * u[2], z = k[0] * u[1] - k[1] * u[0];
    u[0] = half * x;
    u[1] = half * y;
    u[2] = half * z;
}

}  // namespace

void PlainGridFluid::multiplyChannels(const std::vector<GridChannel>& channels, double viscosity,
                                      bool, const double* forces, double* velocities) {
    prepare(channels[0].stencils->getShape());
    work.shape = planned;
    work.rowLength = planned.size[2];
    modesOfChannels.resize(3 * channels.size());
    for (size_t g = 0; g < channels.size(); g++) {
        if (channels[g].ofDipoles)
            spreadDipoles(*channels[g].stencils, forces);
        else
            spread(*channels[g].stencils, forces);
        forces += channels[g].numRows();
        const ScopedTimer timer(seconds.transforms);
        forward();
        for (int c = 0; c < 3; c++) {
            modesOfChannels[3 * g + c].resize(modes[c].size());
            std::copy_n(modes[c].data(), modes[c].size(), modesOfChannels[3 * g + c].data());
        }
    }
    // f(k) = sum over channels of phi f, or phi i k x T/2. Then u(k) = (1 - k k/k^2) f(k)/eta, and
    // the way back is the transpose.
    const double scale = 1 / (viscosity * planned.numNodes());
    WallFactors ofWalls(planned, channels, modesOfChannels);
    for (size_t g = 0; g < channels.size(); g++) {
        forModes(planned, [&](size_t at, const int* index, const double* k, double k2) {
            complex<double> u[3] = {}, f[3];
            for (size_t h = 0; h < channels.size() && k2 > 0; h++) {
                const double phi = factorOf(*channels[h].factors, index, k2);
                for (int c = 0; c < 3; c++)
                    f[c] = phi * complex<double>(modesOfChannels[3 * h + c][2 * at],
                                                 modesOfChannels[3 * h + c][2 * at + 1]);
                if (channels[h].ofTorques) halfCurl(k, f);
                for (int c = 0; c < 3; c++) u[c] += f[c];
            }
            if (k2 > 0) project(k, k2, scale * factorOf(*channels[g].factors, index, k2), u);
            if (channels[g].ofTorques) halfCurl(k, u);
            if (k2 > 0) ofWalls.add(g, index, 1 / viscosity, u);
            store(at, u);
        });
        backward(work);
        if (channels[g].ofDipoles)
            averageGradientColumn(work, *channels[g].stencils, velocities);
        else
            averageColumn(work, *channels[g].stencils, velocities);
        velocities += channels[g].numRows();
    }
}

void PlainGridFluid::drawChannels(const std::vector<GridChannel>& channels, double viscosity,
                                  const ModeNoise& noise, std::vector<GridField>& fields) {
    const GridShape& shape = channels[0].stencils->getShape();
    prepare(shape);
    const double scale = 1 / std::sqrt(viscosity * shape.numNodes());
    const auto bare = [&](const int* index, const double* k, double k2, complex<double>* zeta) {
        const int nx = shape.waveIndex(0, index[0]);
        noise.fill(&nx, 1, shape.waveIndex(1, index[1]), index[2], zeta);
        project(k, k2, scale, zeta);
    };
    RandomWallFactors ofWalls(shape, channels, viscosity, noise, bare);
    for (size_t g = 0; g < channels.size(); g++) {
        fields[g].shape = shape;
        fields[g].rowLength = shape.size[2];
        for (AlignedArray& component : fields[g].values) component.resize(shape.numNodes());
        forModes(shape, [&](size_t at, const int* index, const double* k, double k2) {
            complex<double> zeta[3] = {};
            if (k2 > 0) {
                const double factor = factorOf(*channels[g].factors, index, k2);
                if (shape.walls) {
                    bare(index, k, k2, zeta);
                    ofWalls.subtractNear(index, k, k2, zeta);
                    for (complex<double>& u : zeta) u *= factor;
                } else {
                    const int nx = shape.waveIndex(0, index[0]);
                    noise.fill(&nx, 1, shape.waveIndex(1, index[1]), index[2], zeta);
                    project(k, k2, scale * factor, zeta);
                }
                if (channels[g].ofTorques) halfCurl(k, zeta);
                ofWalls.add(g, index, 1, zeta);
            }
            store(at, zeta);
        });
        backward(fields[g]);
    }
}

void GridFlow::spread(const GridStencils& stencils, double viscosity, const double* forces) {
    fluid.prepare(stencils.getShape());
    fluid.spread(stencils, forces);
    ofPlanes.clear();
    if (!fluid.planned.planes) {
        fluid.respond(viscosity);
        return;
    }
    // Keep the forces of planes, because their flow at points has more modes than the grid.
    const GridPlanes& planes = *fluid.planned.planes;
    double netForce[2];
    fluid.respondWithoutPlanes(viscosity, netForce);
    for (int c = 0; c < 2; c++)
        ofMean[c] = planes.meanForces(
            reinterpret_cast<const complex<double>*>(fluid.modes[c].data()), netForce[c]);
    fluid.confine([&](int x, int y, const complex<double>* velocities,
                      complex<double>* forces) { planes.respond(x, y, velocities, forces); },
                  [&](int x, int y, const complex<double>* forces) {
                      ofPlanes.push_back({x, y, {}});
                      std::copy_n(forces, planes.numUnknowns(), ofPlanes.back().forces);
                  });
}

void GridFlow::draw(const GridStencils& stencils, double viscosity, const ModeNoise& noise) {
    draw(stencils.getShape(), viscosity, noise, nullptr);
}

void GridFlow::draw(const GridShape& shape, double viscosity, const ModeNoise& noise,
                    const GridFactors* factors) {
    fluid.prepare(shape);
    ofPlanes.clear();
    fluid.drawInto(shape, viscosity, GridModeNoise(shape, noise), factors);
}

void GridFlow::addAt(const std::vector<OpenMM::Vec3>& points, double factor,
                     Eigen::Matrix3Xd& velocities) {
    const GridShape& shape = fluid.planned;
    const int m = shape.numRowModes(), numPoints = points.size();
    Eigen::MatrixXcd phases[3];  // exp(ikx), index by point
    for (int axis = 0; axis < 3; axis++) {
        phases[axis].resize(axis == 2 ? m : shape.size[axis], numPoints);
        for (int i = 0; i < phases[axis].rows(); i++)
            for (int p = 0; p < numPoints; p++)
                phases[axis](i, p) = std::polar(
                    1.0, shape.waveNumber(axis, i) *
                             (shape.skew.toGrid(points[p])[axis] - shape.firstNode(axis)));
    }
    // The other half of the modes are conjugates. Both halves of the modes with kz = 0 are stored.
    phases[2].bottomRows(m - 1) *= 2;
    factor /= std::sqrt(shape.volume() / shape.numNodes());
    Eigen::MatrixXcd rows;
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < shape.size[0]; i++) {
            const complex<double>* plane =
                reinterpret_cast<const complex<double>*>(fluid.modes[c].data()) +
                (size_t)i * shape.size[1] * m;
            rows.noalias() =
                phases[2].transpose() * Eigen::Map<const Eigen::MatrixXcd>(plane, m, shape.size[1]);
            for (int p = 0; p < numPoints; p++)
                velocities(c, p) +=
                    factor * (phases[0](i, p) * (rows.row(p) * phases[1].col(p))(0, 0)).real();
        }
    for (int p = 0; p < numPoints && !ofPlanes.empty(); p++) {
        for (const ForcesOfPlanes& of : ofPlanes) {
            complex<double> u[3] = {};
            shape.planes->addFlow(of.x, of.y, points[p][2], of.forces, u);
            const complex<double> phase = factor * phases[0](of.x, p) * phases[1](of.y, p);
            for (int c = 0; c < 3; c++) velocities(c, p) += (phase * u[c]).real();
        }
        for (int c = 0; c < 2; c++)
            velocities(c, p) += factor * shape.planes->meanFlow(points[p][2], ofMean[c]);
    }
}

double amplitudeOfMode(const GridShape& shape, double viscosity, const ModeNoise& noise,
                       const DrivenFlow& wave) {
    std::array<double, 3> k = {0, 0, 0};
    k[wave.waveAxis] = wave.k;
    std::array<int, 3> n = shape.indicesOf(k);
    const bool isConjugate = n[2] < 0;  // in a triclinic box: take the numbers of the opposite mode
    if (isConjugate)
        for (int& index : n) index = -index;
    complex<double> u[3];
    GridModeNoise(shape, noise).fill(&n[0], 1, n[1], n[2], u);
    if (isConjugate)
        for (complex<double>& component : u) component = std::conj(component);
    project(k.data(), wave.k * wave.k, 1 / std::sqrt(viscosity * shape.volume()) / wave.k, u);
    // u exp(ikx) and its conjugate: 2 Re(u) cos(kx) - 2 Im(u) sin(kx)
    return 2 * u[wave.forceAxis].real() * std::sin(wave.phase) -
           2 * u[wave.forceAxis].imag() * std::cos(wave.phase);
}

void PlainGridFluid::averageColumn(const GridField& field, const GridStencils& stencils,
                                   double* velocities) {
    const ScopedTimer timer(seconds.averaging);
    const HydrodynamicParticles& particles = stencils.getParticles();
    for (int p = 0; p < particles.size(); p++) {
        double* V = velocities + particles.firstRow[p];
        std::fill(V, V + (particles.hasTorque[p] ? 6 : 3), 0.0);
        const Envelope force(stencils, p, Kind::Force, Kind::ForceSlope);
        forNodes(stencils, p, [&](size_t node, int i, int j, int k) {
            const double w = force.value(i, j, k);
            for (int c = 0; c < 3; c++) V[c] += w * field.values[c][node];
        });
        if (!particles.hasTorque[p]) continue;
        double* Omega = V + 3;
        const Envelope torque(stencils, p, Kind::Torque, Kind::TorqueSlope);
        // The transpose of the spreading of torques.
        forNodes(stencils, p, [&](size_t node, int i, int j, int k) {
            double g[3];
            torque.gradient(i, j, k, g);
            for (int c = 0; c < 3; c++) {
                const int d = (c + 1) % 3, e = (c + 2) % 3;
                Omega[e] += 0.5 * g[d] * field.values[c][node];
                Omega[d] -= 0.5 * g[e] * field.values[c][node];
            }
        });
    }
}

void PlainGridFluid::averageGradientColumn(const GridField& field, const GridStencils& stencils,
                                           double* gradients) {
    const ScopedTimer timer(seconds.averaging);
    const HydrodynamicParticles& particles = stencils.getParticles();
    std::fill(gradients, gradients + 9 * (size_t)particles.size(), 0.0);
    for (int p = 0; p < particles.size(); p++) {
        const Envelope force(stencils, p, Kind::Force, Kind::ForceSlope);
        forNodes(stencils, p, [&](size_t node, int i, int j, int k) {
            double g[3];
            force.gradient(i, j, k, g);
            for (int a = 0; a < 3; a++)
                for (int b = 0; b < 3; b++)
                    gradients[9 * p + 3 * a + b] -= g[b] * field.values[a][node];
        });
    }
}

}  // namespace RigidHIPlugin
