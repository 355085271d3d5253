#include "mobility/models/periodic/LatticeSum.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <complex>

#include "linearalgebra/SymmetricProduct.h"
#include "mobility/StressletBasis.h"

namespace RigidHIPlugin {

using Eigen::ArrayXd;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::Vector3i;
using std::max;
using std::min;

namespace {

/** The depth q at which Gaussians are cut off: exp(-q^2) = 2e-16. */
const double depth = 6;

/**
 * Measured times in ns: for a function of the distance at one node for one image, and for one
 * multiplication in the product of waves.
 */
const double timeOfNode = 4, timeOfProduct = 0.06;

/** The number of waves summed at once. Their columns fit in a cache. */
const int wavesAtOnce = 128;

/** H(k). @param x  k/(2 xi) */
double screening(double x) { return (1 + x * x) * std::exp(-x * x); }

}  // namespace

LatticeSum::LatticeSum(const HydrodynamicParticles& particles, const Spreading& spreading,
                       bool stresslets, bool forPoints)
    : particles(particles), spreading(spreading), stresslets(stresslets), kinds(particles.radii) {
    if (forPoints) kinds.push_back(0);
    std::sort(kinds.begin(), kinds.end());
    kinds.erase(std::unique(kinds.begin(), kinds.end()), kinds.end());
    for (int i = 0; i < particles.size(); i++) {
        kind.push_back(std::lower_bound(kinds.begin(), kinds.end(), particles.radii[i]) -
                       kinds.begin());
        hasTorques = hasTorques || particles.hasTorque[i];
    }
    if (kinds.empty()) return;
    smallest = kinds.front();
    largest = kinds.back();
}

// -------------------------------------------------------------------------------------------------
// Data that depend on the box

/** The time of a pair, ns, up to a constant. */
double LatticeSum::estimateCost(double inverse) const {
    const double wave = spreading.largestWave(depth, inverse, smallest, hasTorques),
                 rows = stresslets   ? 11
                        : hasTorques ? 6
                                     : 3;
    const double numWaves = lattice.getVolume() * wave * wave * wave / (12 * M_PI * M_PI);
    double cost = timeOfProduct * 2 * rows * rows * numWaves;
    if (inverse > 0) {
        const double range = spreading.reach(depth, inverse, largest);
        const double numImages = 1 + 4 * M_PI / 3 * range * range * range / lattice.getVolume();
        cost += timeOfNode * (stresslets ? 1.5 : 1) * numImages * wave * range / M_PI;
    }
    return cost;
}

void LatticeSum::chooseSplitting() {
    const double side = std::cbrt(lattice.getVolume()), factor = 1.15;
    double least = INFINITY;
    if (spreading.convergesByWaves()) {
        inverseSplitting = 0;
        least = estimateCost(0);
    }
    for (double inverse = side; inverse > side / 200; inverse /= factor) {
        const double cost = estimateCost(inverse);
        if (cost >= least) continue;
        least = cost;
        inverseSplitting = inverse;
    }
    if (wantedSplitting > 0) inverseSplitting = 1 / wantedSplitting;
}

void LatticeSum::fillFactors(const ArrayXd& waveNumbers, Factors& factors) const {
    factors.s.resize(waveNumbers.size(), kinds.size());
    factors.t.resize(waveNumbers.size(), kinds.size());
    for (size_t a = 0; a < kinds.size(); a++)
        for (int n = 0; n < waveNumbers.size(); n++) {
            factors.s(n, a) = spreading.ofForce(kinds[a], waveNumbers[n]);
            factors.t(n, a) = spreading.ofTorque(kinds[a], waveNumbers[n]);
        }
}

void LatticeSum::setBox(const BoxVectors& newBox) {
    if (newBox == box && lattice.getVolume() > 0) return;
    lattice = Lattice(newBox);
    box = newBox;
    if (kinds.empty()) return;
    chooseSplitting();
    const double largestWave = spreading.largestWave(depth, inverseSplitting, smallest, hasTorques);
    waves = lattice.waves(largestWave);
    waveLengths.resize(waves.size());
    waveWeights.resize(waves.size());
    for (size_t w = 0; w < waves.size(); w++) {
        const double k = (lattice.getReciprocal() * waves[w].cast<double>()).norm();
        waveLengths[w] = k;
        // The weight counts both k and -k. It is a square root, because a column is multiplied by
        // itself.
        waveWeights[w] =
            std::sqrt(16 * M_PI / lattice.getVolume() * screening(0.5 * k * inverseSplitting)) / k;
    }
    fillFactors(waveLengths, ofWaves);
    images.clear();
    nodes.resize(0);
    if (inverseSplitting == 0) return;
    reach = spreading.reach(depth, inverseSplitting, largest);
    images = lattice.within(reach + lattice.getReach());
    // The trapezoidal rule adds copies of the functions at other periods. For distances within the
    // reach, these copies are farther away than twice the reach.
    step = M_PI / reach;
    const int numNodes = std::ceil(largestWave / step);
    nodes = ArrayXd::LinSpaced(numNodes + 1, 0, numNodes * step);
    nodeWeights.resize(numNodes + 1);
    for (int n = 0; n <= numNodes; n++)
        nodeWeights[n] =
            4 / M_PI * step * (n == 0 ? 0.5 : 1) * screening(0.5 * nodes[n] * inverseSplitting);
    fillFactors(nodes, ofNodes);
}

// -------------------------------------------------------------------------------------------------
// The matrix

void LatticeSum::compute(const std::vector<OpenMM::Vec3>& positions, bool contact,
                         MatrixXd& matrix) {
    matrix.setZero(getNumRows(), getNumRows());
    if (particles.size() == 0) return;
    addWaves(positions, matrix);
    if (inverseSplitting > 0) addPairs(positions, contact, matrix);
    mirrorLower(matrix);
}

void LatticeSum::fillPhases(const std::vector<OpenMM::Vec3>& places, Phases& at) const {
    at.count.setZero();
    for (const Vector3i& w : waves) at.count = at.count.cwiseMax(w.cwiseAbs());
    at.along.resize(3);
    for (int d = 0; d < 3; d++) at.along[d].resize(2 * at.count[d] + 1, places.size());
    for (size_t i = 0; i < places.size(); i++) {
        const Vector3d f = lattice.fractions(places[i]);
        for (int d = 0; d < 3; d++)
            for (int m = 0; m <= at.count[d]; m++) {
                const double angle = 2 * M_PI * f[d] * m;
                const std::complex<double> phase(std::cos(angle), -std::sin(angle));
                at.along[d](at.count[d] + m, i) = phase;
                at.along[d](at.count[d] - m, i) = std::conj(phase);
            }
    }
}

namespace {

/** Two directions across a wave vector. */
struct Across {
    Vector3d e[2];
    explicit Across(const Vector3d& k)
        : e{k.unitOrthogonal(), k.cross(k.unitOrthogonal()).normalized()} {}
};

}  // namespace

/**
 * Fill the columns of waves k (both directions e across k, each with cosine and sine) with D_j
 * exp(-i k.r_j) along e, for the rows of each particle j.
 */
void LatticeSum::fillColumns(int first, int size) {
    for (int w = first; w < first + size; w++) {
        const Vector3d k = lattice.getReciprocal() * waves[w].cast<double>();
        const Across across(k);
        const Vector3d* e = across.e;
        const Vector3d half[2] = {0.5 * e[0].cross(k), 0.5 * e[1].cross(k)};
        Eigen::Matrix<double, 1, 5> strain[2];
        if (stresslets) {
            const Eigen::Matrix<double, 3, 5> v = contractBasis(k);
            for (int d = 0; d < 2; d++) strain[d] = e[d].transpose() * v;
        }
        for (int i = 0; i < particles.size(); i++) {
            const std::complex<double> phase = waveWeights[w] * phases.of(waves[w], i);
            const double s = ofWaves.s(w, kind[i]), t = ofWaves.t(w, kind[i]);
            const double cosine = s * phase.real(), sine = s * phase.imag();
            // i times the phase for torques; -i times the phase for stresslets
            const double turnedCosine = -t * phase.imag(), turnedSine = t * phase.real();
            const int row = particles.firstRow[i];
            for (int d = 0; d < 2; d++) {
                const int column = 4 * (w - first) + 2 * d;
                columns.block<3, 1>(row, column) = cosine * e[d];
                columns.block<3, 1>(row, column + 1) = sine * e[d];
                if (particles.hasTorque[i]) {
                    columns.block<3, 1>(row + 3, column) = turnedCosine * half[d];
                    columns.block<3, 1>(row + 3, column + 1) = turnedSine * half[d];
                }
                if (stresslets) {
                    columns.block<5, 1>(firstStresslet(i), column) =
                        -turnedCosine * strain[d].transpose();
                    columns.block<5, 1>(firstStresslet(i), column + 1) =
                        -turnedSine * strain[d].transpose();
                }
            }
        }
    }
}

void LatticeSum::addWaves(const std::vector<OpenMM::Vec3>& positions, MatrixXd& matrix) {
    const int numWaves = waves.size();
    fillPhases(positions, phases);
    columns.resize(getNumRows(), 4 * min(wavesAtOnce, numWaves));
    for (int first = 0; first < numWaves; first += wavesAtOnce) {
        const int size = min(wavesAtOnce, numWaves - first);
        fillColumns(first, size);
        addProductOfRows(columns, 4 * size, 1, matrix);
    }
}

void LatticeSum::setPairWeights(int kind_i, int kind_j, bool torques) {
    const auto s_i = ofNodes.s.col(kind_i), s_j = ofNodes.s.col(kind_j),
               t_i = ofNodes.t.col(kind_i), t_j = ofNodes.t.col(kind_j);
    withTorques = torques;
    ss = nodeWeights * s_i * s_j;
    if (!withTorques) return;
    st = nodeWeights * s_i * t_j;
    ts = nodeWeights * t_i * s_j;
    tt = nodeWeights * t_i * t_j;
}

/** The integrals over k with H for a pair at any distance. */
void LatticeSum::screenedNear(double distance, PairFunctions& f) const {
    f = PairFunctions();
    for (int n = 0; n < nodes.size(); n++) {
        double phi[5];
        besselQuotients(nodes[n] * distance, phi);
        const double k2 = nodes[n] * nodes[n], k4 = k2 * k2;
        f.ttI += ss[n] * (phi[0] - phi[1]);
        f.ttR += ss[n] * k2 * phi[2];
        if (!withTorques) continue;
        f.tr += 0.5 * st[n] * k2 * phi[1];
        f.rt += 0.5 * ts[n] * k2 * phi[1];
        f.rrI += 0.25 * tt[n] * k2 * (phi[0] - phi[1]);
        f.rrR += 0.25 * tt[n] * k4 * phi[2];
        if (!stresslets) continue;
        addStressletsOfWave(k2, st[n], ts[n], tt[n], phi, f);
    }
}

/**
 * The same integrals for several images with k r >= 1 except at k = 0, by recurrences from node to
 * node and upwards in the order.
 */
void LatticeSum::screenedFar(const Lanes& squares, PairFunctions (&f)[numLanes]) const {
    const Lanes r = squares.sqrt(), inverseR = 1 / r, inverse2 = 1 / squares;
    const Lanes cosStep = (step * r).cos(), sinStep = (step * r).sin();
    Lanes cosine = Lanes::Ones(), sine = Lanes::Zero();
    // k = 0: phi_0 - phi_1 = 2/3, and all other terms have a power of k
    Lanes ttI = Lanes::Constant(2.0 / 3 * ss[0]), ttR = Lanes::Zero(), tr = ttR, rt = ttR,
          rrI = ttR, rrR = ttR, vs = ttR, vsR = ttR, sv = ttR, svR = ttR, rs = ttR, ssI = ttR,
          ssV = ttR, ssR = ttR;
    for (int n = 1; n < nodes.size(); n++) {
        const Lanes next = cosine * cosStep - sine * sinStep;
        sine = sine * cosStep + cosine * sinStep;
        cosine = next;
        const double k = nodes[n], k2 = k * k, k4 = k2 * k2;
        const Lanes overX2 = (1 / k2) * inverse2;
        const Lanes phi0 = (1 / k) * sine * inverseR, phi1 = (phi0 - cosine) * overX2,
                    phi2 = (3 * phi1 - phi0) * overX2;
        const Lanes across = phi0 - phi1;
        ttI += ss[n] * across;
        ttR += (ss[n] * k2) * phi2;
        if (!withTorques) continue;
        tr += (0.5 * st[n] * k2) * phi1;
        rt += (0.5 * ts[n] * k2) * phi1;
        rrI += (0.25 * tt[n] * k2) * across;
        rrR += (0.25 * tt[n] * k4) * phi2;
        if (!stresslets) continue;
        const Lanes phi3 = (5 * phi2 - phi1) * overX2, phi4 = (7 * phi3 - phi2) * overX2,
                    first = phi1 - 2 * phi2;
        vs += (st[n] * k2) * first;
        vsR += (st[n] * k4) * phi3;
        sv += (ts[n] * k2) * first;
        svR += (ts[n] * k4) * phi3;
        rs += (0.5 * tt[n] * k4) * phi2;
        ssI += (tt[n] * k2) * first;
        ssV -= (tt[n] * k4) * (phi2 - 4 * phi3);
        ssR -= (tt[n] * k4 * k2) * phi4;
    }
    for (int l = 0; l < numLanes; l++)
        f[l] = {ttI[l], ttR[l], tr[l],  rt[l], rrI[l], rrR[l], vs[l],
                vsR[l], sv[l],  svR[l], rs[l], ssI[l], ssV[l], ssR[l]};
}

/**
 * Call add(r, |r|, screened) for the images of a pair within reach.
 *
 * @param difference  of the positions of the pair
 */
template <class Add>
void LatticeSum::forImages(const Vector3d& difference, const Add& add) {
    const double recurrenceFrom = 1 / step;
    PairFunctions far[numLanes], near;
    found.clear();
    for (const Vector3d& image : images) {
        const Vector3d r = difference + image;
        const double distance = r.norm();
        if (distance > reach) continue;
        if (distance > recurrenceFrom)
            found.push_back(r);
        else {
            screenedNear(distance, near);
            add(r, distance, near);
        }
    }
    for (size_t first = 0; first < found.size(); first += numLanes) {
        const int size = min<int>(numLanes, found.size() - first);
        Lanes squares = Lanes::Constant(recurrenceFrom * recurrenceFrom);
        for (int l = 0; l < size; l++) squares[l] = found[first + l].squaredNorm();
        screenedFar(squares, far);
        for (int l = 0; l < size; l++) add(found[first + l], std::sqrt(squares[l]), far[l]);
    }
}

void LatticeSum::addPairs(const std::vector<OpenMM::Vec3>& positions, bool contact,
                          MatrixXd& matrix) {
    PairBlocks pair;
    for (int i = 0; i < particles.size(); i++)
        for (int j = 0; j <= i; j++) {
            const double a_i = particles.radii[i], a_j = particles.radii[j];
            setPairWeights(kind[i], kind[j], particles.hasTorque[i] || particles.hasTorque[j]);
            pair.setZero();
            forImages(lattice.wrapped(positions[i] - positions[j]),
                      [&](const Vector3d& r, double distance, const PairFunctions& screened) {
                          // Contact needs a line of centres, which two particles at one place lack.
                          const bool moved = contact && distance < a_i + a_j && distance > 0;
                          if (!moved)
                              pair.add(spreading.free(a_i, a_j, distance, withTorques, stresslets) -
                                           screened,
                                       r, stresslets);
                          else {
                              const double scale = (a_i + a_j) / distance;
                              pair.add(spreading.free(a_i, a_j, a_i + a_j, withTorques, stresslets),
                                       scale * r, stresslets);
                              pair.add(PairFunctions() - screened, r, stresslets);
                          }
                      });
            if (i == j) {
                // For a particle with itself, the contributions of opposite images to these blocks
                // cancel.
                pair.tr.setZero();
                pair.rt.setZero();
                pair.ts.setZero();
                pair.st.setZero();
            }
            place(pair, i, j, matrix);
        }
}

void LatticeSum::addFlowAt(const std::vector<OpenMM::Vec3>& positions, const FlowSources& sources,
                           const std::vector<OpenMM::Vec3>& points, double factor,
                           Velocities& velocities) {
    if (particles.size() == 0) return;
    Eigen::VectorXd all(getNumRows());
    all.head(particles.numRows) = sources.forces.col(0);
    if (stresslets) all.tail(5 * particles.size()) = sources.stresslets;
    Phases ofPoints;
    fillPhases(positions, phases);
    fillPhases(points, ofPoints);
    const int numWaves = waves.size();
    columns.resize(getNumRows(), 4 * min(wavesAtOnce, numWaves));
    for (int first = 0; first < numWaves; first += wavesAtOnce) {
        const int size = min(wavesAtOnce, numWaves - first);
        fillColumns(first, size);
        const Eigen::VectorXd amplitudes = columns.leftCols(4 * size).transpose() * all;
        for (int w = 0; w < size; w++) {
            const Across across(lattice.getReciprocal() * waves[first + w].cast<double>());
            for (size_t p = 0; p < points.size(); p++) {
                const std::complex<double> phase =
                    waveWeights[first + w] * ofPoints.of(waves[first + w], p);
                for (int d = 0; d < 2; d++)
                    velocities.col(p) += factor *
                                         (phase.real() * amplitudes[4 * w + 2 * d] +
                                          phase.imag() * amplitudes[4 * w + 2 * d + 1]) *
                                         across.e[d];
            }
        }
    }
    if (inverseSplitting == 0) return;
    const int point = std::lower_bound(kinds.begin(), kinds.end(), 0.0) - kinds.begin();
    for (int j = 0; j < particles.size(); j++) {
        const bool torque = particles.hasTorque[j];
        setPairWeights(point, kind[j], torque);
        const int row = particles.firstRow[j];
        const Vector3d force = all.segment<3>(row),
                       T = torque ? Vector3d(all.segment<3>(row + 3)) : Vector3d(0, 0, 0);
        const double* S = stresslets ? &all[firstStresslet(j)] : nullptr;
        for (size_t p = 0; p < points.size(); p++)
            forImages(lattice.wrapped(points[p] - positions[j]),
                      [&](const Vector3d& r, double distance, const PairFunctions& screened) {
                          const PairFunctions f = spreading.free(0, particles.radii[j], distance,
                                                                 withTorques, stresslets) -
                                                  screened;
                          velocities.col(p) += factor * velocityOf(f, r, force, T, S);
                      });
    }
}

/** Put the blocks of a pair into the lower triangle. */
void LatticeSum::place(const PairBlocks& pair, int i, int j, MatrixXd& matrix) const {
    const int row = particles.firstRow[i], column = particles.firstRow[j];
    const bool torque_i = particles.hasTorque[i], torque_j = particles.hasTorque[j];
    matrix.block<3, 3>(row, column) += pair.tt;
    if (torque_i) matrix.block<3, 3>(row + 3, column) += pair.rt;
    if (torque_j) matrix.block<3, 3>(row, column + 3) += pair.tr;
    if (torque_i && torque_j) matrix.block<3, 3>(row + 3, column + 3) += pair.rr;
    if (!stresslets) return;
    // By the reciprocal theorem, E_i of F_j is the transpose of V_j of S_i.
    matrix.block<5, 3>(firstStresslet(i), column) += pair.st.transpose();
    matrix.block<5, 3>(firstStresslet(i), column + 3) += pair.sr.transpose();
    matrix.block<5, 5>(firstStresslet(i), firstStresslet(j)) += pair.ss;
    if (i == j) return;
    matrix.block<5, 3>(firstStresslet(j), row) += pair.ts.transpose();
    matrix.block<5, 3>(firstStresslet(j), row + 3) += pair.rs.transpose();
}

}  // namespace RigidHIPlugin
