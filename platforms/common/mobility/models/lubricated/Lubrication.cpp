#include "mobility/models/lubricated/Lubrication.h"

#include <openmm/OpenMMException.h>

#include <algorithm>
#include <cmath>

#include "mobility/models/periodic/PeriodicMobility.h"
#include "mobility/models/wall/NoSlipPlane.h"
#include "mobility/models/wall/SphereWall.h"
#include "openmmrigidhi/internal/Messages.h"
#include "rigidbody/EigenVec3.h"

using namespace std;
using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace RigidHIPlugin {

namespace {

/** The length of the cell along directions without a period, far beyond any other length. */
const double noPeriod = 1e12;

/** The cell of the periods. A direction stands in for each missing period. */
class Cell {
public:
    Cell(const BoxVectors& box, int numPeriods) : numPeriods(numPeriods) {
        vectors = noPeriod * Matrix3d::Identity();
        for (int k = 0; k < numPeriods; k++) vectors.col(k) = toEigen(box[k]);
        inverse = vectors.inverse();
    }
    /**
     * Call use(image, vector) for all vectors from the difference to an image that are not longer
     * than `most`.
     */
    template <class Use>
    void imagesWithin(const Vector3d& difference, double most, const Use& use) const {
        array<int, 3> from = {0, 0, 0}, to = {0, 0, 0}, n;
        const Vector3d at = inverse * difference;
        for (int k = 0; k < numPeriods; k++) {
            const double width = most * inverse.row(k).norm();
            from[k] = ceil(-at[k] - width);
            to[k] = floor(-at[k] + width);
        }
        for (n[0] = from[0]; n[0] <= to[0]; n[0]++)
            for (n[1] = from[1]; n[1] <= to[1]; n[1]++)
                for (n[2] = from[2]; n[2] <= to[2]; n[2]++) {
                    Vector3d d = difference;
                    for (int k = 0; k < numPeriods; k++) d += n[k] * vectors.col(k);
                    if (d.squaredNorm() <= most * most) use(n, d);
                }
    }

    bool isPeriod(int k) const { return k < numPeriods; }
    /** The coordinate of a position along a vector: in periods, or in nm. */
    double coordinate(const Vector3d& x, int k) const {
        return inverse.row(k).dot(x) * (isPeriod(k) ? 1 : noPeriod);
    }
    /** The distance between the planes that bound the cell, nm; 1 without a period. */
    double height(int k) const { return isPeriod(k) ? 1 / inverse.row(k).norm() : 1; }

private:
    const int numPeriods;
    Matrix3d vectors, inverse;
};

/**
 * Positions sorted into boxes at least as wide as a distance, so that a search for neighbours takes
 * linear time.
 */
class Neighbours {
public:
    Neighbours(const Cell& cell, const vector<Vector3d>& x, double distance) {
        const double most = max(1.0, cbrt(x.size()));  // boxes along a vector
        array<vector<double>, 3> at;
        for (int k = 0; k < 3; k++) {
            for (const Vector3d& place : x) at[k].push_back(cell.coordinate(place, k));
            wraps[k] = cell.isPeriod(k);
            if (wraps[k]) {
                for (double& c : at[k]) c -= floor(c);
                number[k] = min(most, floor(cell.height(k) / distance));
                if (number[k] < 3) number[k] = 1;  // else both neighbours are the same box
                continue;
            }
            const auto ends = minmax_element(at[k].begin(), at[k].end());
            const double low = x.empty() ? 0 : *ends.first,
                         width = x.empty() ? 0 : *ends.second - low;
            number[k] = max(1.0, min(most, floor(width / distance)));
            for (double& c : at[k]) c = width > 0 ? (c - low) / width : 0;
        }
        members.resize(number[0] * number[1] * number[2]);
        for (size_t i = 0; i < x.size(); i++) {
            array<int, 3> box;
            for (int k = 0; k < 3; k++) box[k] = min(number[k] - 1, int(at[k][i] * number[k]));
            boxes.push_back(box);
            members[indexOf(box)].push_back(i);
        }
    }
    /**
     * All positions up to this one, ascending, that may be within the distance of it or of an image
     * of it.
     */
    void upTo(int i, vector<int>& found) const {
        found.clear();
        array<int, 3> offset, box;
        for (offset[0] = -1; offset[0] <= 1; offset[0]++)
            for (offset[1] = -1; offset[1] <= 1; offset[1]++)
                for (offset[2] = -1; offset[2] <= 1; offset[2]++) {
                    bool isThere = true;
                    for (int k = 0; k < 3; k++) {
                        box[k] = boxes[i][k] + offset[k];
                        if (wraps[k] && number[k] > 1) box[k] = (box[k] + number[k]) % number[k];
                        isThere = isThere && box[k] >= 0 && box[k] < number[k];
                    }
                    if (!isThere) continue;
                    for (int j : members[indexOf(box)])
                        if (j <= i) found.push_back(j);
                }
        sort(found.begin(), found.end());
    }

private:
    int indexOf(const array<int, 3>& box) const {
        return (box[0] * number[1] + box[1]) * number[2] + box[2];
    }
    array<int, 3> number;
    array<bool, 3> wraps;
    vector<array<int, 3>> boxes;  // of positions
    vector<vector<int>> members;
};

/**
 * An image and its opposite are the same pair of a sphere with itself, so only one of them counts.
 */
bool isFirstOfTwo(const array<int, 3>& n) {
    for (int k = 0; k < 3; k++)
        if (n[k] != 0) return n[k] > 0;
    return false;
}

/**
 * The friction of a sphere above a wall, from its mobility over 1/(6 pi eta a). The axis is the
 * normal.
 */
Lubrication::Single frictionAtWall(const SphereWallMobility& m, double a, double stokes) {
    Lubrication::Single friction;
    friction.along(0, 0) = stokes / m.across;
    friction.about(0, 0) = stokes * a * a / m.turnNormal;
    // V = n x Omega, so rolling has the opposite sign.
    friction.across << m.along, -m.rolling, -m.rolling, m.turnAlong;
    friction.across = stokes * friction.across.inverse().eval();
    friction.across.row(1) *= a;
    friction.across.col(1) *= a;
    return friction;
}

/** Where spheres have mirror images, in descriptions. */
string nameOfMirror(const LubricationScene& scene) {
    return scene.mirrorPeriod > 0 ? "slip walls" : "free surface";
}

}  // namespace

bool Lubrication::isAny(const HydrodynamicParticles& particles, const LubricationScene& scene) {
    const int spheres = count(particles.hasTorque.begin(), particles.hasTorque.end(), char(true));
    return spheres > 1 ||
           (spheres == 1 && (scene.numPeriods > 0 || scene.hasWalls() || scene.hasMirror()));
}

Lubrication::Lubrication(const HydrodynamicParticles& particles, double viscosity,
                         const Spreading* spreading, const LubricationScene& scene,
                         const char* name)
    : particles(particles), viscosity(viscosity), spreading(spreading), scene(scene), name(name),
      kind(particles.size(), -1) {
    vector<double> radii;
    for (int i = 0; i < particles.size(); i++)
        if (particles.hasTorque[i]) {
            spheres.push_back(i);
            radii.push_back(particles.radii[i]);
        }
    if (spheres.empty()) return;
    const auto less = [&](int i, int j) { return particles.radii[i] < particles.radii[j]; };
    const auto extremes = minmax_element(spheres.begin(), spheres.end(), less);
    const int smallest = *extremes.first, largest = *extremes.second;
    largestRadius = particles.radii[largest];
    if (scene.reach.nothing == 0) return;
    const double ratio = largestRadius / particles.radii[smallest];
    if (ratio > TwoSphereResistance::maximumRatio)
        throw OpenMM::OpenMMException(
            string(name) + ": the radii " + text(largestRadius) + " nm of " +
            particleAndBody(particles, largest) + " and " + text(particles.radii[smallest]) +
            " nm of " + particleAndBody(particles, smallest) + " have the ratio " + text(ratio) +
            "; lubrication is known up to a ratio of " + text(TwoSphereResistance::maximumRatio) +
            ": turn it off by setLubrication(Off), or make the larger sphere of several blobs");
    sort(radii.begin(), radii.end());
    radii.erase(unique(radii.begin(), radii.end()), radii.end());
    vector<int> copies(radii.size());
    for (int i : spheres) {
        kind[i] = lower_bound(radii.begin(), radii.end(), particles.radii[i]) - radii.begin();
        copies[kind[i]]++;
    }
    tables.resize(radii.size());
    for (size_t larger = 0; larger < radii.size(); larger++) {
        tables[larger].resize(larger + 1);
        for (size_t smaller = 0; smaller <= larger; smaller++)
            if (smaller < larger || scene.numPeriods > 0 || scene.hasMirror() || copies[larger] > 1)
                tables[larger][smaller] = TwoSphereResistance::get(radii[smaller] / radii[larger]);
    }
    if (scene.hasWalls() && spreading == &overGaussians())
        for (double radius : radii) atWall.emplace_back(scene.behind / radius);
}

/**
 * Call use(i, j, image, vector, mirrored) for all pairs of spheres, i <= j, with distances up to so
 * many mean radii, in a fixed order.
 */
template <class Use>
void Lubrication::forPairsWithin(const Placement& placement, double meanRadii,
                                 const Use& use) const {
    const Cell cell(scene.periods(placement.box), scene.numPeriods);
    vector<Vector3d> x;
    for (int i : spheres) x.push_back(toEigen(placement.positions[i]));
    const size_t numSpheres = x.size();
    if (scene.hasMirror())
        for (size_t b = 0; b < numSpheres; b++) {
            Vector3d image = x[b];
            image[scene.mirrorAxis] = 2 * scene.mirror - image[scene.mirrorAxis];
            x.push_back(image);
        }
    const Neighbours neighbours(cell, x, meanRadii * largestRadius);
    vector<int> others;
    for (size_t b = 0; b < x.size(); b++) {
        const bool mirrored = b >= numSpheres;
        const int last = b % numSpheres, j = spheres[last];
        neighbours.upTo(b, others);
        for (int a : others) {
            // A pair of images is that of the spheres, and so is a later sphere with the image of
            // an earlier one.
            if (a > last) continue;
            const int i = spheres[a];
            if (i == j && scene.numPeriods == 0 && !mirrored) continue;
            cell.imagesWithin(x[b] - x[a], meanRadii * meanRadius(i, j),
                              [&](const array<int, 3>& image, const Vector3d& d) {
                                  if (i != j || mirrored || isFirstOfTwo(image))
                                      use(i, j, image, d, mirrored);
                              });
        }
    }
}

string Lubrication::describe() const {
    string text = "lubrication of " + counted(spheres.size(), "sphere", "spheres");
    const bool pairs = spheres.size() > 1 || scene.numPeriods > 0;
    if (pairs)
        text += string(" with each other") + (scene.numPeriods > 0 ? " and with images" : "");
    if (scene.hasWalls())
        text += string(pairs ? " and" : "") + " with the wall" +
                (isfinite(scene.low) && isfinite(scene.high) ? "s" : "");
    if (scene.hasMirror())
        text += string(pairs || scene.hasWalls() ? " and" : "") + " with mirror images in the " +
                nameOfMirror(scene);
    if (pairs || scene.hasMirror())
        text += " (that of pairs whole up to " + number(scene.reach.whole) +
                " mean radii and nothing from " + number(scene.reach.nothing) + " on)";
    if ((int)spheres.size() < particles.size()) text += "; multiblobs and free particles have none";
    return text;
}

bool Lubrication::findOverlap(const Placement& placement, NearPair& found) const {
    const double closest = 2;  // mean radii
    bool isFound = false;
    forPairsWithin(placement, closest,
                   [&](int i, int j, const array<int, 3>& image, const Vector3d& d, bool mirrored) {
                       if (isFound || (scene.minimumGap > 0 && d.norm() > 0)) return;
                       found = {i, j, image, d, d.norm(), mirrored};
                       isFound = true;
                   });
    return isFound;
}

string Lubrication::touching(const Placement& placement, int i, const string& what) const {
    const int axis = scene.hasMirror() ? scene.mirrorAxis : 2;
    return particleAndBody(particles, i) + " of radius " + text(particles.radii[i]) +
           " nm touches " + what + " with its centre at " + "xyz"[axis] + " = " +
           text(placement.positions[i][axis]) +
           " nm, where lubrication lets no sphere move; move it away, use smaller time steps, or "
           "use setLubrication(Off)";
}

string Lubrication::objection(const Placement& placement) const {
    string found;
    const string start = string(name) + " with lubrication: ";
    NearPair pair;
    if (findOverlap(placement, pair)) {
        if (pair.mirrored && pair.i == pair.j && scene.minimumGap == 0)
            return start + touching(placement, pair.i,
                                    scene.mirrorPeriod > 0 ? "a slip wall" : "the free surface");
        const string both = particleAndBody(particles, pair.i) + " and " +
                            (pair.mirrored                          ? "the mirror image of "
                             : pair.image == array<int, 3>{0, 0, 0} ? ""
                                                                    : "an image of ") +
                            particleAndBody(particles, pair.j);
        if (scene.minimumGap > 0)
            found = start + both +
                    " are at the same place, so that their line of centres has no "
                    "direction; move one of them";
        else
            found = start + both + " overlap or touch: their distance is " + text(pair.distance) +
                    " nm, the sum of their radii " + text(2 * meanRadius(pair.i, pair.j)) +
                    " nm; separate the particles, use smaller time steps, allow "
                    "overlap by setMinimumGap(), or use setLubrication(Off)";
    }
    if (!found.empty() || !scene.hasWalls()) return found;
    for (int i : spheres) {
        const double z = placement.positions[i][2], a = particles.radii[i];
        if (z - scene.low > a && scene.high - z > a) continue;
        const double wall = z - scene.low > a ? scene.high : scene.low;
        return start + touching(placement, i, "the wall at z = " + text(wall) + " nm");
    }
    return {};
}

void Lubrication::findPairs(const Placement& placement, vector<NearPair>& pairs) const {
    pairs.clear();
    forPairsWithin(placement, scene.reach.nothing,
                   [&](int i, int j, const array<int, 3>& image, const Vector3d& d, bool mirrored) {
                       const double distance = d.norm();
                       pairs.push_back({i, j, image, d / distance, distance, mirrored});
                   });
}

/** In the tables, sphere 1 is the larger. */
const TwoSphereResistance& Lubrication::tableOf(int i, int j) const {
    return particles.radii[i] < particles.radii[j] ? *tables[kind[j]][kind[i]]
                                                   : *tables[kind[i]][kind[j]];
}

double Lubrication::gapOf(int i, int j, double distance) const {
    const double larger = max(particles.radii[i], particles.radii[j]),
                 smaller = min(particles.radii[i], particles.radii[j]);
    return (distance - larger - smaller) / meanRadius(i, j);
}

/** The axis points from i to j. */
template <class Values>
Lubrication::Pair Lubrication::frictionOf(const Values& f, int i, int j) const {
    const bool swapped = particles.radii[i] < particles.radii[j];
    if (swapped) swap(i, j);
    const double a[2] = {particles.radii[i], particles.radii[j]};
    Pair friction;
    for (int p = 0; p < 2; p++)
        for (int q = 0; q < 2; q++) {
            const double sum = a[p] + a[q], unit = M_PI * viscosity * sum;
            // In the swapped order the axis is reversed, and so is V.
            const int to = swapped ? 1 - p : p, from = swapped ? 1 - q : q;
            friction.along(to, from) = 3 * unit * f[XA11 + p + q];
            friction.across(to, from) = 3 * unit * f[YA11 + p + q];
            friction.about(to, from) = unit * sum * sum * f[XC11 + p + q];
            friction.across(2 + to, 2 + from) = unit * sum * sum * f[YC11 + p + q];
            friction.across(2 + to, from) = friction.across(from, 2 + to) =
                (swapped ? -1 : 1) * unit * sum * f[YB11 + 2 * p + q];
        }
    return friction;
}

/** The friction of the same pair in the model. */
Lubrication::Pair Lubrication::pairOfModel(int i, int j, double distance) const {
    const double scale = 1 / (8 * M_PI * viscosity), r2 = distance * distance;
    const int pair[2] = {i, j};
    const PairFunctions f =
        spreading->free(particles.radii[i], particles.radii[j], distance, true, false);
    Pair mobility;
    for (int p = 0; p < 2; p++) {
        const double a = particles.radii[pair[p]];
        mobility.along(p, p) = mobility.across(p, p) = scale * 4 / (3 * a);
        mobility.about(p, p) = mobility.across(2 + p, 2 + p) = scale / (a * a * a);
    }
    mobility.along(0, 1) = mobility.along(1, 0) = scale * (f.ttI + f.ttR * r2);
    mobility.about(0, 1) = mobility.about(1, 0) = scale * (f.rrI + f.rrR * r2);
    mobility.across(0, 1) = mobility.across(1, 0) = scale * f.ttI;
    mobility.across(2, 3) = mobility.across(3, 2) = scale * f.rrI;
    mobility.across(0, 3) = mobility.across(3, 0) = scale * f.tr * distance;
    mobility.across(1, 2) = mobility.across(2, 1) = -scale * f.rt * distance;
    return mobility.inverse();
}

void Lubrication::ofPair(const NearPair& pair, Pair& delta, Pair& root) const {
    const bool isHalf = pair.mirrored && pair.i == pair.j;
    const double mean = meanRadius(pair.i, pair.j),
                 weight = scene.reach.weight(pair.distance / mean) * (isHalf ? 0.5 : 1);
    const double distance = max(pair.distance, mean * (2 + scene.minimumGap));
    const TwoSphereResistance& table = tableOf(pair.i, pair.j);
    const double gap = gapOf(pair.i, pair.j, distance);
    Pair lacking = spreading ? frictionOf(table.exact(gap), pair.i, pair.j) -
                                   pairOfModel(pair.i, pair.j, distance)
                             : frictionOf(table.correctionOfMotion(gap), pair.i, pair.j);
    lacking *= weight;
    lacking.factorise(mean, root, delta);
}

void Lubrication::keyOfPair(const NearPair& pair, uint32_t& field, uint32_t& index) const {
    const uint64_t a = particles.systemIndex[pair.i], b = particles.systemIndex[pair.j],
                   larger = max(a, b), number = larger * (larger + 1) / 2 + min(a, b);
    // The image has the sign for this order of the indices.
    const int sign = a <= b ? 1 : -1;
    uint32_t image = 0;
    for (int k = 0; k < 3; k++)
        image = image << 4 | (static_cast<uint32_t>(sign * pair.image[k]) & 15u);
    index = static_cast<uint32_t>(number);
    field = (pair.mirrored ? 0x20000000u : 0x10000000u) +
            (static_cast<uint32_t>(number >> 32) << 12) + image;
}

void Lubrication::findTerms(const Placement& placement, Terms& terms) const {
    findPairs(placement, terms.pairs);
    terms.deltas.resize(terms.pairs.size());
    terms.roots.resize(terms.pairs.size());
    for (size_t k = 0; k < terms.pairs.size(); k++)
        ofPair(terms.pairs[k], terms.deltas[k], terms.roots[k]);
}

Eigen::Matrix<double, 6, 1> Lubrication::signsOfMirror() const {
    Eigen::Matrix<double, 6, 1> signs;
    signs << 1, 1, 1, -1, -1, -1;
    signs[scene.mirrorAxis] = -1;
    signs[3 + scene.mirrorAxis] = 1;
    return signs;
}

Lubrication::Pair::Whole Lubrication::wholeOf(const NearPair& pair, const Pair& block) const {
    Pair::Whole whole = block.whole(pair.axis);
    if (!pair.mirrored) return whole;
    const auto signs = signsOfMirror();
    whole.bottomRows<6>() = signs.asDiagonal() * whole.bottomRows<6>();
    whole.rightCols<6>() = whole.rightCols<6>() * signs.asDiagonal();
    return whole;
}

void Lubrication::addProduct(const Terms& terms, const Eigen::MatrixXd& velocities,
                             Eigen::MatrixXd& forces) const {
    Eigen::MatrixXd ofPair, result;
    for (size_t k = 0; k < terms.pairs.size(); k++) {
        const NearPair& pair = terms.pairs[k];
        const int rows[2] = {particles.firstRow[pair.i], particles.firstRow[pair.j]};
        if (!pair.mirrored) {
            terms.deltas[k].addProduct(pair.axis, rows, velocities, forces);
            continue;
        }
        const auto signs = signsOfMirror();
        const int first[2] = {0, 6};
        ofPair.resize(12, velocities.cols());
        ofPair.topRows<6>() = velocities.middleRows<6>(rows[0]);
        ofPair.bottomRows<6>() = signs.asDiagonal() * velocities.middleRows<6>(rows[1]);
        result.setZero(12, velocities.cols());
        terms.deltas[k].addProduct(pair.axis, first, ofPair, result);
        forces.middleRows<6>(rows[0]) += result.topRows<6>();
        forces.middleRows<6>(rows[1]) += signs.asDiagonal() * result.bottomRows<6>();
    }
}

void Lubrication::addTo(const Terms& terms, Eigen::MatrixXd& friction) const {
    for (size_t k = 0; k < terms.pairs.size(); k++) {
        const NearPair& pair = terms.pairs[k];
        const int rows[2] = {particles.firstRow[pair.i], particles.firstRow[pair.j]};
        Pair::addWhole(wholeOf(pair, terms.deltas[k]), rows, friction);
    }
}

long long Lubrication::addNoise(const Terms& terms, const NoiseStream& noise, uint32_t purpose,
                                Eigen::MatrixXd& forces) const {
    NoiseStream stream = noise;
    uint32_t index;
    Eigen::MatrixXd numbers(12, 1), ofPair(12, 1);
    const int first[2] = {0, 6};
    for (size_t k = 0; k < terms.pairs.size(); k++) {
        const NearPair& pair = terms.pairs[k];
        keyOfPair(pair, stream.field, index);
        for (int b = 0; b < 6; b++)
            stream.pair(purpose, index, b, numbers(2 * b, 0), numbers(2 * b + 1, 0));
        ofPair.setZero();
        terms.roots[k].addProduct(pair.axis, first, numbers, ofPair);
        if (pair.mirrored)
            ofPair.bottomRows<6>() = signsOfMirror().asDiagonal() * ofPair.bottomRows<6>();
        forces.col(0).segment<6>(particles.firstRow[pair.i]) += ofPair.col(0).head<6>();
        forces.col(0).segment<6>(particles.firstRow[pair.j]) += ofPair.col(0).tail<6>();
    }
    return 12 * static_cast<long long>(terms.pairs.size());
}

void Lubrication::addNearer(double meanRadii, const Terms& terms, const vector<int>& blockOf,
                            const vector<BlockIncompleteCholesky::Block>& projectors,
                            BlockIncompleteCholesky& matrix) const {
    const double strong = 2.05;  // in mean radii; 2.002 to 2.1 give the same iterations
    for (size_t p = 0; p < terms.pairs.size(); p++) {
        const NearPair& pair = terms.pairs[p];
        const int i = pair.i, j = pair.j;
        if (pair.distance > meanRadii * 0.5 * (particles.radii[i] + particles.radii[j])) continue;
        Pair::Whole block = wholeOf(pair, terms.deltas[p]);
        const int a = blockOf[i], b = blockOf[j];
        if (!projectors.empty()) {
            Pair::Whole both = Pair::Whole::Zero();
            both.topLeftCorner<6, 6>() = projectors[a];
            both.bottomRightCorner<6, 6>() = projectors[b];
            block = (both * block * both).eval();
        }
        if (a != b && pair.distance < strong * 0.5 * (particles.radii[i] + particles.radii[j]))
            matrix.link(a, b);
        matrix.add(a, a, block.topLeftCorner<6, 6>());
        matrix.add(b, b, block.bottomRightCorner<6, 6>());
        if (a == b)
            matrix.add(a, a, block.topRightCorner<6, 6>() + block.bottomLeftCorner<6, 6>());
        else if (a > b)
            matrix.add(a, b, block.topRightCorner<6, 6>());
        else
            matrix.add(b, a, block.bottomLeftCorner<6, 6>());
    }
}

void Lubrication::ofSphere(int i, double z, Single& delta, Single& root, Single& own) const {
    const double a = particles.radii[i], stokes = 6 * M_PI * viscosity * a;
    Single free;
    free.along(0, 0) = free.across(0, 0) = stokes;
    free.about(0, 0) = free.across(1, 1) = stokes * 4 / 3 * a * a;
    own = free;
    Single lacking;
    for (double height : {z - scene.low, scene.high - z}) {
        if (!isfinite(height)) continue;
        Single inModel = frictionAtWall(atWall.empty()
                                            ? SphereWallMobility::rotnePragerYamakawa(a / height)
                                            : atWall[kind[i]].at(a / height),
                                        a, stokes),
               exact = frictionAtWall(SphereWallMobility::bestKnown((height - a) / a), a, stokes);
        // The axis points up, so V changes sign for a sphere below a wall.
        if (height != z - scene.low)
            for (Single* block : {&inModel, &exact}) {
                block->across(0, 1) *= -1;
                block->across(1, 0) *= -1;
            }
        lacking += exact - inModel;
        own += inModel - free;
    }
    lacking.factorise(a, root, delta);
}

}  // namespace RigidHIPlugin
