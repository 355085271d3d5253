#include "mobility/models/confined/NearPlanes.h"

#include <algorithm>
#include <cmath>
#include <complex>

namespace RigidHIPlugin {

using OpenMM::Vec3;
using std::complex;

namespace {

/** The factor by which points are denser than the largest wave number along the planes needs. */
const double finer = 1.25;

std::vector<EwaldKind> withPoints(std::vector<EwaldKind> kinds) {
    kinds.insert(kinds.begin(), {0, 0, 0});
    return kinds;
}

/**
 * How far from its surface a particle reaches points of planes. A wave k across the planes has S_X
 * = 0.0235 k^2/xi^3 and U_X of the order of k^2, but the truncation error of U_X is not of this
 * order. An error d of U_X causes an error n d^2/S_X of the matrix, where n is the number of
 * particles per area, which a long wave moves together. So the longest wave of the box limits d.
 */
double gapOf(const HydrodynamicParticles& particles, const std::vector<EwaldKind>& kinds,
             const EwaldSplitting& splitting, double tolerance) {
    const GridShape& shape = splitting.shape;
    const double smallest = kinds.front().radius, xi = splitting.xi,
                 k = 2 * M_PI / std::max(shape.edge[0], shape.edge[1]),
                 response = 0.0235 * k * k / (xi * xi * xi),
                 density = std::max(0.5 / (smallest * smallest),
                                    2 * particles.size() / (shape.edge[0] * shape.edge[1])),
                 part = 0.02,  // of the tolerance, because clusters are denser than the mean
        allowed =
            8 * M_PI * std::sqrt(part * tolerance / (6 * M_PI * smallest) * response / density);
    double gap = splitting.gap;
    for (const EwaldKind& kind : kinds) {
        const NearPair pair(0, kind.radius, xi, false);
        const double step = 0.02 / xi;
        double sum = 0;
        for (double r = pair.getReach(); r > kind.radius + gap; r -= step) {
            const PairFunctions f = pair.at(r);
            sum += 2 * M_PI * r * step * std::max(std::abs(f.ttI), std::abs(f.ttI + f.ttR * r * r));
            if (sum > allowed) gap = r - kind.radius;
        }
    }
    return gap;
}

int numbersOf(const HydrodynamicParticles& particles) {
    for (char torque : particles.hasTorque)
        if (torque) return 6;
    return 2;
}

/** The number of points along an edge. */
int pointsAlong(double edge, double longest) { return nextGridSize(finer * longest * edge / M_PI); }

}  // namespace

NearPlanes::NearPlanes(const HydrodynamicParticles& particles, const std::vector<EwaldKind>& kinds,
                       const EwaldSplitting& splitting, double tolerance, double height,
                       double longest, const GridWallFields& fields)
    : particles(particles), height(height), period(splitting.shape.edge[2]), longest(longest),
      fields(fields), tables(withPoints(kinds), numbersOf(particles), splitting.xi,
                             gapOf(particles, kinds, splitting, tolerance),
                             0.4 * std::max({splitting.shape.spacing(0), splitting.shape.spacing(1),
                                             splitting.shape.spacing(2)})),
      anyTorques(numbersOf(particles) > 2) {
    for (double radius : particles.radii)
        for (size_t k = 0; k < kinds.size(); k++)
            if (kinds[k].radius == radius) kind.push_back(k + 1);
    for (int axis = 0; axis < 2; axis++) {
        edge[axis] = splitting.shape.edge[axis];
        size[axis] = pointsAlong(edge[axis], longest);
        step[axis] = edge[axis] / size[axis];
    }
    for (int axis = 0; axis < 2; axis++)
        for (bool back : {false, true})
            plans[axis][back] = FourierPlan<double>(size[axis], size[1 - axis], back);
    for (int c = 0; c < 3; c++)
        for (AlignedArray* of : {&nodes[c], &transformed[c]})
            of->resize(2 * (size_t)size[0] * size[1]);
}

double NearPlanes::memory(const HydrodynamicParticles& particles,
                          const std::vector<EwaldKind>& kinds, const EwaldSplitting& splitting,
                          double tolerance, double height, double longest) {
    const auto& edge = splitting.shape.edge;
    const double gap = gapOf(particles, kinds, splitting, tolerance),
                 numX = pointsAlong(edge[0], longest), numY = pointsAlong(edge[1], longest),
                 ofPoint = 8.0 * (numbersOf(particles) > 2 ? 3 : 2),
                 ofLine = sizeof(Line) + sizeof(int);
    double bytes = 8.0 * 2 * 6 * numX * numY;  // of the points themselves
    for (const EwaldKind& kind : kinds)
        for (double away : {kind.radius, height - kind.radius}) {
            const double reach = std::min(kind.radius + gap,
                                          NearPair(0, kind.radius, splitting.xi, false).getReach()),
                         square = reach * reach - away * away;
            if (!(square > 0)) continue;
            bytes += kind.particles * (ofPoint * M_PI * square * numX * numY / (edge[0] * edge[1]) +
                                       ofLine * 2 * std::sqrt(square) * numX / edge[0]);
        }
    return bytes;
}

void NearPlanes::moveTo(const std::vector<Vec3>& positions, bool keepAnchors, double spacing,
                        const Ranges& ranges) {
    const double farthest = 0.1 * spacing;
    bool keeps = keepAnchors && anchors.size() == positions.size();
    for (size_t p = 0; p < positions.size() && keeps; p++)
        for (int axis = 0; axis < 3; axis++)
            keeps = keeps && std::abs(positions[p][axis] - anchors[p][axis]) <= farthest;
    if (!keeps) anchors = positions;
    places.resize(positions.size());
    for (size_t p = 0; p < positions.size(); p++) {
        places[p] = positions[p];
        for (int axis = 0; axis < 2; axis++)
            places[p][axis] -= edge[axis] * std::floor(anchors[p][axis] / edge[axis]);
    }
    if (!keeps) findLines();
    ranges(particles.size(), [&](int first, int end) {
        if (anyTorques)
            findValues<6>(first, end);
        else
            findValues<2>(first, end);
    });
}

void NearPlanes::findLines() {
    lines.clear();
    firstOfParticle.assign(1, 0);
    size_t numValues = 0;
    const int numbers = anyTorques ? 3 : 2;
    for (int p = 0; p < particles.size(); p++) {
        const double reach = tables.reach(0, kind[p]), x = places[p][0], y = places[p][1];
        for (int plane = 0; plane < 2; plane++) {
            const double z = (plane == 0 ? -0.5 : 0.5) * height, away = places[p][2] - z;
            // The planes have images at the base's period.
            for (int m = (int)std::ceil((away - reach) / period);
                 m <= (int)std::floor((away + reach) / period); m++) {
                const double dz = away - m * period, radius = std::sqrt(reach * reach - dz * dz);
                if (!(radius > 0)) continue;
                for (int i = (int)std::ceil((x - radius) / step[0]);
                     i <= (int)std::floor((x + radius) / step[0]); i++) {
                    const double dx = x - i * step[0],
                                 half = std::sqrt(std::max(0.0, radius * radius - dx * dx));
                    const int first = (int)std::ceil((y - half) / step[1]),
                              count = (int)std::floor((y + half) / step[1]) - first + 1;
                    if (count <= 0) continue;
                    lines.push_back({p, plane, wrapped(i, 0), i * step[0], z + m * period, first,
                                     count, numValues});
                    numValues += (size_t)numbers * count;
                }
            }
        }
        firstOfParticle.push_back(lines.size());
    }
    values.resize(numValues);
    firstOfRow.assign(size[0] + 1, 0);
    for (const Line& line : lines) firstOfRow[line.row + 1]++;
    for (int row = 0; row < size[0]; row++) firstOfRow[row + 1] += firstOfRow[row];
    std::vector<int> next(firstOfRow.begin(), firstOfRow.end() - 1);
    linesOfRows.resize(lines.size());
    for (size_t l = 0; l < lines.size(); l++) linesOfRows[next[lines[l].row]++] = l;
}

template <int numbers>
void NearPlanes::findValues(int firstParticle, int endParticle) {
    for (int l = firstOfParticle[firstParticle]; l < firstOfParticle[endParticle]; l++) {
        const Line& line = lines[l];
        const Vec3& here = places[line.particle];
        const double dx = line.x - here[0], dz = line.z - here[2], across = dx * dx + dz * dz;
        double f[6], *to = &values[line.values];
        for (int n = 0; n < line.count; n++) {
            const double dy = (line.first + n) * step[1] - here[1];
            tables.at<numbers>(0, kind[line.particle], std::sqrt(across + dy * dy), f);
            to[n] = f[0];
            to[line.count + n] = f[1];
            if (numbers > 2) to[2 * line.count + n] = f[2];
        }
    }
}

/** Compute the flow of pairs on a row of both planes. */
void NearPlanes::spreadRow(int row, const double* forces) {
    const size_t length = 2 * (size_t)size[1];
    double* const to[3] = {&nodes[0][row * length], &nodes[1][row * length],
                           &nodes[2][row * length]};
    for (double* component : to) std::fill_n(component, length, 0.0);
    for (int l = firstOfRow[row]; l < firstOfRow[row + 1]; l++) {
        const Line& line = lines[linesOfRows[l]];
        const int p = line.particle;
        const double *F = forces + particles.firstRow[p], *f = &values[line.values];
        const bool hasTorque = anyTorques && particles.hasTorque[p];
        const double* T = F + 3;
        const double x = line.x - places[p][0], z = line.z - places[p][2];
        int j = wrapped(line.first, 1);
        for (int n = 0; n < line.count; n++) {
            const double y = (line.first + n) * step[1] - places[p][1],
                         along = f[line.count + n] * (x * F[0] + y * F[1] + z * F[2]);
            double u[3] = {f[n] * F[0] + along * x, f[n] * F[1] + along * y,
                           f[n] * F[2] + along * z};
            if (hasTorque) {
                const double turning = f[2 * line.count + n];
                u[0] += turning * (T[1] * z - T[2] * y);
                u[1] += turning * (T[2] * x - T[0] * z);
                u[2] += turning * (T[0] * y - T[1] * x);
            }
            for (int c = 0; c < 3; c++) to[c][2 * j + line.plane] += u[c];
            if (++j == size[1]) j = 0;
        }
    }
}

/** The transpose of spreadRow(), for one particle. */
void NearPlanes::average(int p, double* velocities) const {
    const size_t length = 2 * (size_t)size[1];
    const bool hasTorque = anyTorques && particles.hasTorque[p];
    const double factor = edge[0] * edge[1] / (8 * M_PI * std::pow(size[0] * (double)size[1], 2));
    double V[3] = {0, 0, 0}, W[3] = {0, 0, 0};
    for (int l = firstOfParticle[p]; l < firstOfParticle[p + 1]; l++) {
        const Line& line = lines[l];
        const double* f = &values[line.values];
        const double* const from[3] = {nodes[0].data() + line.row * length,
                                       nodes[1].data() + line.row * length,
                                       nodes[2].data() + line.row * length};
        const double x = line.x - places[p][0], z = line.z - places[p][2];
        int j = wrapped(line.first, 1);
        for (int n = 0; n < line.count; n++) {
            const double y = (line.first + n) * step[1] - places[p][1];
            double g[3];
            for (int c = 0; c < 3; c++) g[c] = from[c][2 * j + line.plane];
            const double along = f[line.count + n] * (x * g[0] + y * g[1] + z * g[2]);
            V[0] += f[n] * g[0] + along * x;
            V[1] += f[n] * g[1] + along * y;
            V[2] += f[n] * g[2] + along * z;
            if (hasTorque) {
                const double turning = f[2 * line.count + n];
                W[0] += turning * (y * g[2] - z * g[1]);
                W[1] += turning * (z * g[0] - x * g[2]);
                W[2] += turning * (x * g[1] - y * g[0]);
            }
            if (++j == size[1]) j = 0;
        }
    }
    double* const to = velocities + particles.firstRow[p];
    for (int c = 0; c < 3; c++) to[c] -= factor * V[c];
    for (int c = 0; c < 3 && hasTorque; c++) to[3 + c] -= factor * W[c];
}

namespace {

/** Transpose a matrix of complex numbers. */
void transpose(const double* from, int rows, int columns, double* to) {
    const int block = 8;
    for (int first = 0; first < rows; first += block)
        for (int firstColumn = 0; firstColumn < columns; firstColumn += block)
            for (int i = first; i < std::min(rows, first + block); i++)
                for (int j = firstColumn; j < std::min(columns, firstColumn + block); j++) {
                    const double* const here = from + 2 * ((size_t)i * columns + j);
                    double* const there = to + 2 * ((size_t)j * rows + i);
                    there[0] = here[0];
                    there[1] = here[1];
                }
}

}  // namespace

/** Transform a component from points to wave vectors, which have x fastest, or back. */
void NearPlanes::transform(int c, bool back) {
    double *const here = nodes[c].data(), *const there = transformed[c].data();
    if (back) {
        plans[1][1](here, there);
        transpose(there, size[1], size[0], here);
        plans[0][1](here, there);
        std::swap(nodes[c], transformed[c]);
    } else {
        plans[0][0](here, there);
        transpose(there, size[0], size[1], here);
        plans[1][0](here, there);
        std::swap(nodes[c], transformed[c]);
    }
}

/** Replace the velocities of wave vectors by forces. */
void NearPlanes::respond() {
    const GridShape& shape = fields.getFactors().getShape();
    const auto combined = fields.getConditions().combinations().cast<double>().eval();
    const auto at = [&](int c, int x, int y) -> complex<double>& {
        return reinterpret_cast<complex<double>*>(nodes[c].data())[(size_t)y * size[0] + x];
    };
    const complex<double> I(0, 1);
    for (int y = 0; y <= size[1] / 2; y++)
        for (int x = 0; x < size[0]; x++) {
            const int minusX = wrapped(-x, 0), minusY = wrapped(-y, 1);
            if (minusY == y && minusX < x) continue;
            const int nx = 2 * x < size[0] ? x : x - size[0],
                      indexX = nx < 0 ? nx + shape.size[0] : nx;
            const bool isOut = 2 * std::abs(nx) >= shape.size[0] || 2 * y >= shape.size[1] ||
                               (x == 0 && y == 0) ||
                               std::hypot(nx / edge[0], y / edge[1]) * 2 * M_PI > longest;
            if (isOut) {
                for (int c = 0; c < 3; c++) at(c, x, y) = at(c, minusX, minusY) = 0;
                continue;
            }
            complex<double> u[6];
            for (int c = 0; c < 3; c++) {
                const complex<double> here = at(c, x, y), there = std::conj(at(c, minusX, minusY)),
                                      lower = 0.5 * (here + there),
                                      upper = -0.5 * I * (here - there);
                for (int j = 0; j < 2; j++)
                    u[3 * j + c] = combined(j, 0) * lower + combined(j, 1) * upper;
            }
            fields.respondToNear(indexX, y, u);
            for (int c = 0; c < 3; c++) {
                const complex<double> lower = combined(0, 0) * u[c] + combined(1, 0) * u[3 + c],
                                      upper = combined(0, 1) * u[c] + combined(1, 1) * u[3 + c];
                at(c, x, y) = lower + I * upper;
                at(c, minusX, minusY) = std::conj(lower) + I * std::conj(upper);
            }
        }
}

void NearPlanes::subtractProduct(const double* forces, double* velocities, const Ranges& ranges) {
    if (lines.empty()) return;
    ranges(size[0], [&](int first, int end) {
        for (int row = first; row < end; row++) spreadRow(row, forces);
    });
    ranges(3, [&](int first, int end) {
        for (int c = first; c < end; c++) transform(c, false);
    });
    respond();
    ranges(3, [&](int first, int end) {
        for (int c = first; c < end; c++) transform(c, true);
    });
    ranges(particles.size(), [&](int first, int end) {
        for (int p = first; p < end; p++) average(p, velocities);
    });
}

}  // namespace RigidHIPlugin
