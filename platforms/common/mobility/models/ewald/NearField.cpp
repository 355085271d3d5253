#include "mobility/models/ewald/NearField.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "linearalgebra/Decompositions.h"
#include "mobility/StressletBasis.h"
#include "mobility/models/periodic/PeriodicMobility.h"

using OpenMM::Vec3;

namespace RigidHIPlugin {

// ---- Tables

namespace {

constexpr int allNumbers = NearTables::withStresslets;

void numbersOf(const PairFunctions& f, double* to) {
    const double all[allNumbers] = {f.ttI, f.ttR, f.tr,  f.rt, f.rrI, f.rrR, f.ts,
                                    f.tsR, f.st,  f.stR, f.rs, f.ssI, f.ssV, f.ssR};
    std::copy_n(all, allNumbers, to);
}

/** Make polynomials for `count` intervals from `first` on, from values at Chebyshev nodes. */
template <int degree, class Function>
void tabulate(const Function& function, int numbers, double first, double step, int count,
              std::vector<double>& table) {
    const int n = degree + 1;
    const int columns = std::max(6, numbers);
    Eigen::MatrixXd powers(n, n), values(n, columns);  // of nodes
    for (int a = 0; a < n; a++) {
        const double x = std::cos(M_PI * (a + 0.5) / n);
        for (int m = 0; m < n; m++) powers(a, m) = std::pow(x, m);
    }
    const Eigen::MatrixXd fromNodes = inverseOf(powers);
    for (int interval = 0; interval < count; interval++) {
        for (int a = 0; a < n; a++) {
            double f[allNumbers];
            numbersOf(function(first + step * (interval + 0.5 + 0.5 * powers(a, 1))), f);
            values.row(a) = Eigen::Map<const Eigen::RowVectorXd>(f, columns);
        }
        const Eigen::MatrixXd coefficients = fromNodes * values;
        for (int m = degree; m >= 0; m--)
            for (int c = 0; c < numbers; c++) table.push_back(coefficients(m, c));
    }
}

}  // namespace

NearTables::NearTables(const std::vector<EwaldKind>& kinds, int numbers, double xi, double gap,
                       double margin)
    : numKinds(kinds.size()) {
    for (const EwaldKind& i : kinds)
        for (const EwaldKind& j : kinds) {
            Pair pair;
            pair.radius_i = i.radius;
            pair.radius_j = j.radius;
            pair.contact = i.radius + j.radius;
            if (pair.contact == 0) {  // two points are no pair
                pair.reach = pair.inverseStep = 0;
                pairs.push_back(pair);
                continue;
            }
            pair.reach = gap + pair.contact;
            largest = std::max(largest, pair.reach);
            // The part with H has waves up to about 8 xi, and the other part consists of powers of
            // contact/distance. In an interval of this length a polynomial of this degree has an
            // error below 1e-10.
            const double step = std::min(0.1 / xi, pair.contact / 20);
            pair.inverseStep = 1 / step;
            const NearPair functions(i.radius, j.radius, xi, numbers > 2,
                                     numbers == withStresslets);
            const auto intervals = [&](double length) { return (int)std::ceil(length / step) + 1; };
            tabulate<degree>([&](double r) { return functions.at(r); }, numbers, pair.contact, step,
                             intervals(gap + margin), pair.apart);
            tabulate<degree>([&](double r) { return functions.screened(r); }, numbers, 0, step,
                             intervals(pair.contact), pair.screened);
            pairs.push_back(pair);
        }
}

template <int numbers>
void NearTables::overlapping(const Pair& pair, double distance, double* f) const {
    double free[allNumbers];
    evaluate<numbers>(pair.screened, distance * pair.inverseStep, f);
    numbersOf(overSurfaces().free(pair.radius_i, pair.radius_j, distance, numbers > 2,
                                  numbers == withStresslets),
              free);
    for (int c = 0; c < numbers; c++) f[c] = free[c] - f[c];
}
template void NearTables::overlapping<2>(const Pair& pair, double distance, double* f) const;
template void NearTables::overlapping<6>(const Pair& pair, double distance, double* f) const;
template void NearTables::overlapping<NearTables::withStresslets>(const Pair& pair, double distance,
                                                                  double* f) const;

// ---- Positions

NearField::NearField(const HydrodynamicParticles& particles, bool stresslets)
    : particles(particles), stresslets(stresslets) {
    for (char torque : particles.hasTorque) anyTorques = anyTorques || torque;
}

void NearField::setTables(const NearTables& newTables, const std::vector<int>& kindOfParticle,
                          const GridShape& newBox) {
    tables = &newTables;
    kind = kindOfParticle;
    box = newBox;
    anchors.clear();
    // The edges of cells are half of the reach, and the search takes two cells on each side. The
    // ball of the reach fills a third of their volume.
    const GridSkew& skew = box.skew;
    const double stretch[3] = {std::sqrt(1 + skew.xy * skew.xy + skew.xz * skew.xz),
                               std::sqrt(1 + skew.yz * skew.yz), 1};
    for (int axis = 0; axis < 3; axis++) {
        // The extent of a ball in the coordinates of cells.
        const double reach = stretch[axis] * tables->largestReach();
        cells[axis] = std::max(1, std::min(512, (int)(2 * box.edge[axis] / reach)));
        depth[axis] = (int)std::ceil(reach * cells[axis] / box.edge[axis]);
        extended[axis] = cells[axis] + 2 * depth[axis];
    }
}

void NearField::findAnchors(const std::vector<Vec3>& positions, bool keep, double spacing) {
    const bool hasNone = anchors.empty();
    const double farthest = 0.1 * spacing;
    bool moved = hasNone;
    anchors.resize(particles.size());
    anchorsInBox.resize(particles.size());
    offsets.resize(particles.size());
    cellOfParticle.resize(3 * particles.size());
    for (int p = 0; p < particles.size(); p++) {
        Vec3 offset = hasNone ? Vec3() : positions[p] - anchors[p];
        const bool isNear = std::abs(offset[0]) <= farthest && std::abs(offset[1]) <= farthest &&
                            std::abs(offset[2]) <= farthest;
        if (hasNone || !keep || !isNear) {
            anchors[p] = positions[p];
            Vec3 inBox = box.skew.toGrid(positions[p]);
            for (int axis = 0; axis < 3; axis++) {
                const double L = box.edge[axis], x = inBox[axis];
                inBox[axis] = x - L * std::floor(x / L);
                cellOfParticle[3 * p + axis] =
                    std::min(cells[axis] - 1, (int)(inBox[axis] / L * cells[axis]));
            }
            inBox = box.skew.fromGrid(inBox);
            for (int axis = 0; axis < 3; axis++) anchorsInBox[p][axis] = inBox[axis];
            offset = Vec3();
            moved = true;
        }
        for (int axis = 0; axis < 3; axis++) offsets[p][axis] = offset[axis];
    }
    if (moved) {
        blocks.clear();
        sortIntoCells();
    }
}

/**
 * Sort the sources cell by cell, z fastest. Sources in cells beyond a face are copies. The sources
 * of a cell are in the order of particles.
 */
void NearField::sortIntoCells() {
    const int n = particles.size();
    std::vector<int> firstOfInner(cells[0] * cells[1] * cells[2] + 1, 0);
    const auto inner = [&](int x, int y, int z) { return (x * cells[1] + y) * cells[2] + z; };
    const auto cellOf = [&](int p) {
        return inner(cellOfParticle[3 * p], cellOfParticle[3 * p + 1], cellOfParticle[3 * p + 2]);
    };
    for (int p = 0; p < n; p++) firstOfInner[cellOf(p) + 1]++;
    for (size_t c = 1; c < firstOfInner.size(); c++) firstOfInner[c] += firstOfInner[c - 1];
    targets.resize(n);
    std::vector<int> next(firstOfInner.begin(), firstOfInner.end() - 1);
    for (int p = 0; p < n; p++) targets[next[cellOf(p)]++] = p;
    sources.clear();
    firstOfCell.clear();
    sourceOfTarget.resize(n);
    const auto wrapped = [&](int axis, int c, double& shift) {
        const int period = (int)std::floor((double)c / cells[axis]);
        shift = period * box.edge[axis];
        return c - period * cells[axis];
    };
    Vec3 shift;
    for (int x = -depth[0]; x < cells[0] + depth[0]; x++)
        for (int y = -depth[1]; y < cells[1] + depth[1]; y++)
            for (int z = -depth[2]; z < cells[2] + depth[2]; z++) {
                firstOfCell.push_back(sources.size());
                const int cell = inner(wrapped(0, x, shift[0]), wrapped(1, y, shift[1]),
                                       wrapped(2, z, shift[2]));
                const bool isOwn = shift[0] == 0 && shift[1] == 0 && shift[2] == 0;
                const Vec3 image = box.skew.fromGrid(shift);
                for (int t = firstOfInner[cell]; t < firstOfInner[cell + 1]; t++) {
                    const int p = targets[t];
                    if (isOwn) sourceOfTarget[t] = sources.size();
                    sources.push_back({anchorsInBox[p][0] + image[0], anchorsInBox[p][1] + image[1],
                                       anchorsInBox[p][2] + image[2], p});
                }
            }
    firstOfCell.push_back(sources.size());
}

void NearField::moveTo(const std::vector<Vec3>& positions, bool keepAnchors, double spacing,
                       const Ranges& ranges) {
    findAnchors(positions, keepAnchors, spacing);
    places.resize(sources.size());
    for (size_t s = 0; s < sources.size(); s++) {
        const std::array<double, 3>& offset = offsets[sources[s].particle];
        places[s] = {sources[s].x + offset[0], sources[s].y + offset[1], sources[s].z + offset[2]};
    }
    const int n = particles.size();
    const bool isNew = blocks.empty();
    if (isNew) blocks.resize((n + particlesOfBlock - 1) / particlesOfBlock);
    ranges(blocks.size(), [&](int first, int end) {
        for (int b = first; b < end; b++) {
            const int firstTarget = b * particlesOfBlock,
                      endTarget = std::min(n, firstTarget + particlesOfBlock);
            if (isNew) findNeighbours(blocks[b], firstTarget, endTarget);
            if (stresslets)
                findValues<NearTables::withStresslets>(blocks[b], firstTarget, endTarget);
            else if (anyTorques)
                findValues<6>(blocks[b], firstTarget, endTarget);
            else
                findValues<2>(blocks[b], firstTarget, endTarget);
        }
    });
}

void NearField::findNeighbours(Block& block, int firstTarget, int endTarget) const {
    const double largest = tables->largestReach(), largest2 = largest * largest;
    std::vector<int> row(1);
    for (int t = firstTarget; t < endTarget; t++) {
        block.first.push_back(block.source.size());
        const int own = sourceOfTarget[t], p = targets[t];
        const Source& here = sources[own];
        const int* cell = &cellOfParticle[3 * p];
        // Cells of the source list begin `depth` before the box.
        for (int x = cell[0]; x <= cell[0] + 2 * depth[0]; x++)
            for (int y = cell[1]; y <= cell[1] + 2 * depth[1]; y++) {
                const size_t firstCell = ((size_t)x * extended[1] + y) * extended[2] + cell[2];
                const int begin = firstOfCell[firstCell],
                          end = firstOfCell[firstCell + 2 * depth[2] + 1];
                // Write the source always and count it only if it is near, which needs no branch.
                if ((int)row.size() < end - begin) row.resize(end - begin);
                int count = 0;
                for (int s = begin; s < end; s++) {
                    const double dx = here.x - sources[s].x, dy = here.y - sources[s].y,
                                 dz = here.z - sources[s].z;
                    row[count] = s;
                    count += dx * dx + dy * dy + dz * dz < largest2;
                }
                for (int i = 0; i < count; i++) {
                    const int s = row[i];
                    if (s == own) continue;
                    const double reach = tables->reach(kind[p], kind[sources[s].particle]);
                    if (reach < largest) {
                        const double dx = here.x - sources[s].x, dy = here.y - sources[s].y,
                                     dz = here.z - sources[s].z;
                        if (!(dx * dx + dy * dy + dz * dz < reach * reach)) continue;
                    }
                    block.source.push_back(s);
                }
            }
    }
    block.first.push_back(block.source.size());
}

template <int numbers>
void NearField::findValues(Block& block, int firstTarget, int endTarget) const {
    block.values.resize(numbers * block.source.size());
    for (int t = firstTarget; t < endTarget; t++) {
        const std::array<double, 3>& here = places[sourceOfTarget[t]];
        const int ownKind = kind[targets[t]];
        for (int e = block.first[t - firstTarget]; e < block.first[t - firstTarget + 1]; e++) {
            const int s = block.source[e];
            const double dx = here[0] - places[s][0], dy = here[1] - places[s][1],
                         dz = here[2] - places[s][2];
            tables->at<numbers>(ownKind, kind[sources[s].particle],
                                std::sqrt(dx * dx + dy * dy + dz * dz),
                                &block.values[(size_t)numbers * e]);
        }
    }
}

long long NearField::getNumPairs() const {
    long long sum = 0;
    for (const Block& block : blocks) sum += block.source.size();
    return sum;
}

// ---- Products

template <bool torques>
void NearField::multiplyBlock(const Block& block, int firstTarget, const double* forces,
                              double* velocities) const {
    constexpr int numbers = torques ? 6 : 2;
    const int rows = torques ? 6 : 3, count = (int)block.first.size() - 1;
    double own[6];
    for (int i = 0; i < count; i++) {
        const int t = firstTarget + i, p = targets[t];
        const std::array<double, 3>& here = places[sourceOfTarget[t]];
        tables->at<numbers>(kind[p], kind[p], 0, own);
        const double* F = forces + particles.firstRow[p];
        double V[3] = {own[0] * F[0], own[0] * F[1], own[0] * F[2]}, W[3] = {0, 0, 0};
        if (torques && particles.hasTorque[p])
            for (int c = 0; c < 3; c++) W[c] = own[4] * F[3 + c];
        for (int e = block.first[i]; e < block.first[i + 1]; e++) {
            const int s = block.source[e];
            const double *f = &block.values[(size_t)numbers * e], *G = &strengths[(size_t)rows * s];
            const double x = here[0] - places[s][0], y = here[1] - places[s][1],
                         z = here[2] - places[s][2];
            const double along = f[1] * (x * G[0] + y * G[1] + z * G[2]);
            V[0] += f[0] * G[0] + along * x;
            V[1] += f[0] * G[1] + along * y;
            V[2] += f[0] * G[2] + along * z;
            if (!torques) continue;
            const double* T = G + 3;
            const double turning = f[5] * (x * T[0] + y * T[1] + z * T[2]);
            V[0] += f[2] * (T[1] * z - T[2] * y);
            V[1] += f[2] * (T[2] * x - T[0] * z);
            V[2] += f[2] * (T[0] * y - T[1] * x);
            W[0] += f[3] * (G[1] * z - G[2] * y) + f[4] * T[0] + turning * x;
            W[1] += f[3] * (G[2] * x - G[0] * z) + f[4] * T[1] + turning * y;
            W[2] += f[3] * (G[0] * y - G[1] * x) + f[4] * T[2] + turning * z;
        }
        double* to = velocities + particles.firstRow[p];
        std::copy_n(V, 3, to);
        if (torques && particles.hasTorque[p]) std::copy_n(W, 3, to + 3);
    }
}

namespace {

/** The numbers of a source with a stresslet: force, torque, and S as xx, yy, zz, xy, xz, yz. */
constexpr int numbersOfSource = 12;

using Stresslet = Eigen::Matrix<double, 5, 1>;

void symmetricNumbers(const double* S, double* to) {
    const Eigen::Matrix3d tensor = tensorOfStresslet(Eigen::Map<const Stresslet>(S));
    const double all[] = {tensor(0, 0), tensor(1, 1), tensor(2, 2),
                          tensor(0, 1), tensor(0, 2), tensor(1, 2)};
    std::copy_n(all, 6, to);
}

}  // namespace

/** The same with stresslets, whose rows follow all other rows. */
void NearField::multiplyBlockWithStresslets(const Block& block, int firstTarget,
                                            const double* forces, double* velocities) const {
    constexpr int numbers = NearTables::withStresslets;
    using Eigen::Map;
    using Eigen::Vector3d;
    double own[numbers];
    for (int i = 0; i + 1 < (int)block.first.size(); i++) {
        const int t = firstTarget + i, p = targets[t];
        const std::array<double, 3>& here = places[sourceOfTarget[t]];
        tables->at<numbers>(kind[p], kind[p], 0, own);
        const double *ownForce = forces + particles.firstRow[p],
                     *ownStresslet = forces + particles.numRows + 5 * p;
        Vector3d V = own[0] * Map<const Vector3d>(ownForce),
                 W = own[4] * Map<const Vector3d>(ownForce + 3);
        // The symmetric part of `strain`, without its trace, is part of the strain rate.
        Eigen::Matrix3d strain = Eigen::Matrix3d::Zero();
        double same[6] = {0, 0, 0, 0, 0, 0};  // the part along the stresslets of sources
        for (int e = block.first[i]; e < block.first[i + 1]; e++) {
            const int s = block.source[e];
            const double *f = &block.values[(size_t)numbers * e],
                         *G = &strengths[(size_t)numbersOfSource * s], *S = G + 6;
            const Vector3d r(here[0] - places[s][0], here[1] - places[s][1],
                             here[2] - places[s][2]);
            const Vector3d F(G[0], G[1], G[2]), T(G[3], G[4], G[5]),
                Sr(S[0] * r[0] + S[3] * r[1] + S[4] * r[2], S[3] * r[0] + S[1] * r[1] + S[5] * r[2],
                   S[4] * r[0] + S[5] * r[1] + S[2] * r[2]);
            const double rF = r.dot(F), rSr = r.dot(Sr);
            const Vector3d rxT = r.cross(T);
            V += f[0] * F + (f[1] * rF + f[7] * rSr) * r - f[2] * rxT + f[6] * Sr;
            W += (f[5] * r.dot(T)) * r + f[4] * T - r.cross(f[3] * F + f[10] * Sr);
            strain +=
                r *
                (f[10] * rxT - f[8] * F + f[12] * Sr + (f[13] * rSr - f[9] * rF) * r).transpose();
            for (int c = 0; c < 6; c++) same[c] += f[11] * S[c];
        }
        Map<Vector3d>(velocities + particles.firstRow[p]) = V;
        Map<Vector3d>(velocities + particles.firstRow[p] + 3) = W;
        strain(0, 0) += same[0];
        strain(1, 1) += same[1];
        strain(2, 2) += same[2];
        for (int c = 0; c < 3; c++) {
            const int row = c < 2 ? 0 : 1, column = c < 1 ? 1 : 2;
            strain(row, column) += same[3 + c];
            strain(column, row) += same[3 + c];
        }
        Map<Stresslet>(velocities + particles.numRows + 5 * p) =
            own[11] * Map<const Stresslet>(ownStresslet) + inStressletBasis(strain);
    }
}

void NearField::multiply(const double* forces, double* velocities, const Ranges& ranges) {
    if (stresslets) {
        strengths.resize(numbersOfSource * sources.size());
        for (size_t s = 0; s < sources.size(); s++) {
            const int p = sources[s].particle;
            double* const to = &strengths[numbersOfSource * s];
            std::copy_n(forces + particles.firstRow[p], 6, to);
            symmetricNumbers(forces + particles.numRows + 5 * p, to + 6);
        }
        ranges(blocks.size(), [&](int first, int end) {
            for (int b = first; b < end; b++)
                multiplyBlockWithStresslets(blocks[b], b * particlesOfBlock, forces, velocities);
        });
        return;
    }
    const int rows = anyTorques ? 6 : 3;
    strengths.resize(rows * sources.size());
    for (size_t s = 0; s < sources.size(); s++) {
        const int p = sources[s].particle;
        const double* F = forces + particles.firstRow[p];
        for (int c = 0; c < rows; c++)
            strengths[rows * s + c] = c < 3 || particles.hasTorque[p] ? F[c] : 0;
    }
    ranges(blocks.size(), [&](int first, int end) {
        for (int b = first; b < end; b++)
            if (anyTorques)
                multiplyBlock<true>(blocks[b], b * particlesOfBlock, forces, velocities);
            else
                multiplyBlock<false>(blocks[b], b * particlesOfBlock, forces, velocities);
    });
}

}  // namespace RigidHIPlugin
