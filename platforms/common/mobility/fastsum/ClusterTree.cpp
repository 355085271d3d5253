#include "mobility/fastsum/ClusterTree.h"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <unordered_map>

using namespace std;
using Eigen::Vector3d;
using OpenMM::Vec3;

namespace RigidHIPlugin {

namespace {

/** The deepest level. Particles that 2^20 cubes along an edge do not separate stay in one cube. */
const int deepest = 20;

/** The bits of a coordinate, each followed by two zeros. */
uint64_t spread(uint64_t x) {
    x &= 0x1fffff;
    x = (x | x << 32) & 0x1f00000000ffffULL;
    x = (x | x << 16) & 0x1f0000ff0000ffULL;
    x = (x | x << 8) & 0x100f00f00f00f00fULL;
    x = (x | x << 4) & 0x10c30c30c30c30c3ULL;
    return (x | x << 2) & 0x1249249249249249ULL;
}

using FarKey = array<int, 6>;
struct FarKeyHash {
    size_t operator()(const FarKey& key) const {
        size_t hash = 0;
        for (int k : key) hash = (hash ^ static_cast<size_t>(k)) * 0x9E3779B97F4A7C15ULL;
        return hash ^ hash >> 32;
    }
};

}  // namespace

void ClusterTree::build(const vector<Vec3>& positions, const vector<double>& radii,
                        const vector<char>& kinds, bool hasWall, const Options& options) {
    const int count = positions.size();
    Vec3 low = positions[0], high = positions[0];
    for (const Vec3& r : positions)
        for (int k = 0; k < 3; k++) {
            low[k] = min(low[k], r[k]);
            high[k] = max(high[k], r[k]);
        }
    edge = 0;
    for (int k = 0; k < 3; k++) edge = max(edge, high[k] - low[k]);
    // The cubes stand on a wall that is near. Far from a wall they need not.
    const bool standing = hasWall && low[2] < edge;
    if (standing) edge = max(edge, high[2]);
    // Enlarge the edge a little, so that rounding puts no particle outside. If all particles are at
    // one place, any edge will do.
    const double margin = 1e-9;
    edge = edge > 0 ? edge * (1 + margin) : 1;
    for (int k = 0; k < 3; k++) corner[k] = 0.5 * (low[k] + high[k] - edge);
    if (standing) corner[2] = 0;

    keys.resize(count);
    const double cubes = 1 << deepest;
    for (int i = 0; i < count; i++) {
        uint64_t key = 0;
        for (int k = 0; k < 3; k++) {
            const double along = floor((positions[i][k] - corner[k]) / edge * cubes);
            key |= spread(static_cast<uint64_t>(min(max(along, 0.0), cubes - 1))) << k;
        }
        keys[i] = {key, i};
    }
    sort(keys.begin(), keys.end());
    order.resize(count);
    places.resize(count);
    for (int i = 0; i < count; i++) {
        order[i] = keys[i].second;
        places[i] = positions[order[i]];
    }
    divide(radii, hasWall && corner[2] == 0, options);

    leaves.clear();
    leafOfCell.assign(cells.size(), -1);
    for (size_t c = 0; c < cells.size(); c++)
        if (cells[c].isLeaf()) {
            leafOfCell[c] = leaves.size();
            leaves.push_back(c);
        }
    nearPairs.clear();
    farCells.clear();
    pairUp(0, 0, options);
    classify(hasWall);
    for (int c : leaves)
        sort(order.begin() + cells[c].first, order.begin() + cells[c].end,
             [&](int i, int j) { return kinds[i] != kinds[j] ? kinds[i] > kinds[j] : i < j; });
}

void ClusterTree::divide(const vector<double>& radii, bool standing, const Options& options) {
    cells.clear();
    firstOfLevel = {0};
    Cell root = {};
    root.parent = -1;
    root.end = order.size();
    cells.push_back(root);
    for (int level = 0;; level++) {
        const int firstCell = firstOfLevel[level], endCell = cells.size();
        firstOfLevel.push_back(endCell);
        const double half = 0.5 * ldexp(edge, -level);
        for (int c = firstCell; c < endCell; c++) {
            Cell cell = cells[c];
            cell.level = level;
            cell.half = half;
            cell.largest = 0;
            double highest = 0, smallest = radii[order[cell.first]];
            for (int i = cell.first; i < cell.end; i++) {
                const double a = radii[order[i]];
                cell.largest = max(cell.largest, a);
                smallest = min(smallest, a);
                highest = max(highest, places[i][2]);
            }
            cell.onWall = standing && cell.index[2] == 0 && highest < half;
            for (int k = 0; k < 3; k++) cell.centre[k] = corner[k] + (2 * cell.index[k] + 1) * half;
            if (cell.onWall) cell.centre[2] = 0;
            double square = 0;
            for (int i = cell.first; i < cell.end; i++)
                square =
                    max(square, (Vector3d(places[i][0], places[i][1], places[i][2]) - cell.centre)
                                    .squaredNorm());
            cell.reach = sqrt(square);
            cell.firstChild = cells.size();
            // Particles larger than a cube are near all particles in it, so dividing it further
            // saves nothing.
            const double least = 0.5;
            if (cell.end - cell.first > options.leafSize && level < deepest &&
                half > least * smallest) {
                const int shift = 3 * (deepest - 1 - level);
                for (int i = cell.first; i < cell.end;) {
                    const uint64_t octant = keys[i].first >> shift;
                    Cell child = {};
                    child.parent = c;
                    child.first = i;
                    while (i < cell.end && keys[i].first >> shift == octant) i++;
                    child.end = i;
                    for (int k = 0; k < 3; k++)
                        child.index[k] = 2 * cell.index[k] + (octant >> k & 1);
                    cells.push_back(child);
                    cell.numChildren++;
                }
            } else
                cell.firstChild = -1;
            cells[c] = cell;
        }
        if (static_cast<int>(cells.size()) == endCell) break;
    }
}

bool ClusterTree::areFar(const Cell& a, const Cell& b, double opening) const {
    const double distance = (a.centre - b.centre).norm(), reach = a.reach + b.reach;
    return reach <= opening * distance && distance - reach > a.largest + b.largest;
}

/**
 * Sort the pairs of particles of two cells into near and far ones. Either b is the later cell, or
 * both are the same.
 */
void ClusterTree::pairUp(int a, int b, const Options& options) {
    const Cell &A = cells[a], &B = cells[b];
    const auto count = [](const Cell& cell) {
        return static_cast<long long>(cell.end - cell.first);
    };
    if (a != b && areFar(A, B, options.opening) &&
        !(A.isLeaf() && B.isLeaf() && count(A) * count(B) <= 2 * options.leafSize)) {
        farCells.push_back({a, b});
        return;
    }
    if (A.isLeaf() && B.isLeaf()) {
        nearPairs.push_back({a, b});
        return;
    }
    if (a == b) {
        for (int i = 0; i < A.numChildren; i++)
            for (int j = i; j < A.numChildren; j++)
                pairUp(A.firstChild + i, A.firstChild + j, options);
        return;
    }
    const bool divideA = !A.isLeaf() && (B.isLeaf() || A.level <= B.level);
    const bool divideB = !B.isLeaf() && (A.isLeaf() || B.level <= A.level);
    for (int i = 0; i < (divideA ? A.numChildren : 1); i++)
        for (int j = 0; j < (divideB ? B.numChildren : 1); j++)
            pairUp(divideA ? A.firstChild + i : a, divideB ? B.firstChild + j : b, options);
}

void ClusterTree::classify(bool hasWall) {
    // Near pairs, leaf by leaf.
    firstNear.assign(leaves.size() + 1, 0);
    for (const auto& pair : nearPairs) {
        firstNear[leafOfCell[pair.first] + 1]++;
        if (pair.first != pair.second) firstNear[leafOfCell[pair.second] + 1]++;
    }
    for (size_t i = 0; i < leaves.size(); i++) firstNear[i + 1] += firstNear[i];
    near.resize(firstNear.back());
    vector<int> next(firstNear.begin(), firstNear.end() - 1);
    for (const auto& pair : nearPairs) {
        near[next[leafOfCell[pair.first]]++] = pair.second;
        if (pair.first != pair.second) near[next[leafOfCell[pair.second]]++] = pair.first;
    }
    for (size_t i = 0; i < leaves.size(); i++)
        sort(near.begin() + firstNear[i], near.begin() + firstNear[i + 1]);

    // Far pairs, target by target, so that every class has them sorted by targets.
    const int numCells = cells.size();
    vector<int> firstFar(numCells + 1, 0);
    for (const auto& pair : farCells) {
        firstFar[pair.first + 1]++;
        firstFar[pair.second + 1]++;
    }
    for (int c = 0; c < numCells; c++) firstFar[c + 1] += firstFar[c];
    vector<int> sources(firstFar[numCells]);
    next.assign(firstFar.begin(), firstFar.end() - 1);
    for (const auto& pair : farCells) {
        sources[next[pair.first]++] = pair.second;
        sources[next[pair.second]++] = pair.first;
    }

    vector<FarPair> pairs;
    vector<int> numbers;
    vector<FarClass> found;
    unordered_map<FarKey, int, FarKeyHash> numberOf;
    for (int target = 0; target < numCells; target++)
        for (int s = firstFar[target]; s < firstFar[target + 1]; s++)
            for (bool image : {false, true}) {
                const int source = sources[s];
                if (image && !(hasWall && !cells[source].onWall)) continue;
                const FarPair pair = {target, image ? numCells + source : source};
                FarClass of;
                of.lie(cells[target], cells[source], image, corner[2]);
                const FarKey key = {of.key[0], of.key[1], of.key[2],
                                    of.key[3], of.key[4], of.mirrored};
                const auto known = numberOf.emplace(key, found.size());
                if (known.second) found.push_back(of);
                found[known.first->second].end++;
                pairs.push_back(pair);
                numbers.push_back(known.first->second);
            }
    // Sort the classes by their keys. The order of additions then depends on the positions of
    // particles alone.
    vector<int> sorted(found.size());
    for (size_t i = 0; i < sorted.size(); i++) sorted[i] = i;
    sort(sorted.begin(), sorted.end(), [&](int a, int b) {
        return tie(found[a].key, found[a].mirrored) < tie(found[b].key, found[b].mirrored);
    });
    classes.clear();
    int first = 0;
    vector<int> nextOf(found.size());
    for (int i : sorted) {
        FarClass of = found[i];
        of.first = nextOf[i] = first;
        first = of.end = first + of.end;
        classes.push_back(of);
    }
    farPairs.resize(pairs.size());
    for (size_t i = 0; i < pairs.size(); i++) farPairs[nextOf[numbers[i]]++] = pairs[i];
}

/** @param bottom  height of the lowest cubes above the wall */
void ClusterTree::FarClass::lie(const Cell& to, const Cell& from, bool image, double bottom) {
    const int finest = max(to.level, from.level);
    const double half = min(to.half, from.half);
    const bool offLattice = image && bottom != 0;
    key = {to.level - from.level, offLattice ? from.level : -1, 0, 0, 0};
    mirrored = 0;
    for (int k = 0; k < 3; k++) {
        const auto place = [&](const Cell& cell) {
            return k == 2 && cell.onWall ? 0 : (2 * cell.index[k] + 1) << (finest - cell.level);
        };
        const bool overWall = image && k == 2;
        int along = place(to) + (overWall ? place(from) : -place(from));
        if (along < 0) {
            along = -along;
            mirrored |= 1 << k;
        }
        key[2 + k] = along;
        D[k] = ((mirrored >> k & 1 ? -along : along) + (overWall ? 2 * bottom / half : 0)) *
               (half / from.half);
    }
    first = end = 0;
}

}  // namespace RigidHIPlugin
