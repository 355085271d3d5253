#include "fluid/StepWatch.h"

#include <algorithm>
#include <cmath>

#include "linearalgebra/Decompositions.h"
#include "mobility/MobilityModel.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

namespace {

/** The watch looks at the change over one step of so many. */
const long long interval = 4;
/** The watch judges after this number of samples, and begins anew after the largest one. */
const int leastSamples = 8, mostSamples = 250;
/** A finding exceeds its limit by this number of standard errors. */
const double standardErrors = 5;
/** Single samples are cut here, so that rare collisions or one jump do not decide. */
const double largestSample = 3;
/** The samples of a block, and the blocks that must agree. */
const int samplesInABlock = 32, agreeingBlocks = 3;
/** Of elements together: samples before earlier ones count less, and the part that must matter. */
const double mostSamplesTogether = 4000, leastPartOfSamples = 0.15;
/** Longer steps throw elements that touch apart, to farther away than where they came from. */
const double overshooting = 2;
/** Samples in which nothing must have moved before steps count as too short. */
const int samplesOfCrawling = 32;
/** Without noise, shorter displacements are rounding, in smallest radii. */
const double rounding = 1e-7;

}  // namespace

namespace {

Vector3d turnBetween(const Pose& before, const Pose& after) {
    const auto turn = after.q * conjugate(before.q);
    return (turn.w < 0 ? -2 : 2) * Vector3d(turn.x, turn.y, turn.z);
}

}  // namespace

void StepWatch::Block::add(const Vector3d& dx, const Vector3d& fall) {
    changes += fall * dx.transpose();
    squares += dx * dx.transpose();
    squaresOfFalls += fall * fall.transpose();
    displacement += dx;
}

/** mu K h along the direction in which K, the best fit of fall = K dx, is largest. */
double StepWatch::Block::relaxation(int samples, double mobility, double h, double kT,
                                    bool isHindered) const {
    // Directions in which nothing moves have no stiffness.
    const double still = 1e-9;
    const SelfAdjointEigenSolver<Matrix3d> spread(squares);
    const double largest = spread.eigenvalues()[2];
    if (!(largest > 0) || !isfinite(largest)) return 0;
    Matrix3d inverse = Matrix3d::Zero();
    for (int k = 0; k < 3; k++)
        if (spread.eigenvalues()[k] > still * largest)
            inverse += spread.eigenvectors().col(k) * spread.eigenvectors().col(k).transpose() /
                       spread.eigenvalues()[k];
    const Matrix3d K = changes * inverse;
    const Matrix3d symmetric = 0.5 * (K + K.transpose());
    const SelfAdjointEigenSolver<Matrix3d> modes(symmetric);
    const double stiffest = modes.eigenvalues()[2];
    if (!(stiffest > 0) || !isfinite(stiffest)) return 0;
    const Vector3d n = modes.eigenvectors().col(2);
    // What K dx leaves of the changes may look like a stiffness where displacements are short.
    const double left =
                     max(0.0, n.dot(squaresOfFalls * n) - n.dot(K * squares * K.transpose() * n)),
                 error = sqrt(left / (samples - 3) * n.dot(inverse * n));
    double found = mobility * h;
    if (isHindered) {
        // Long steps shorten random displacements, by half at most where this decides.
        const double mean = n.dot(displacement) / samples,
                     variance = n.dot(squares * n) / samples - mean * mean;
        found = min(found, variance / kT);
    }
    return found * (stiffest - standardErrors * error) > largestRelaxation ? found * stiffest : 0;
}

void StepWatch::Together::add(double ownOfStep, double fallenOfStep) {
    // The state of long ago does not count for ever.
    if (samples >= mostSamplesTogether)
        for (double* sum : {&samples, &own, &fallen, &squareOfOwn, &squareOfFallen, &product})
            *sum *= 0.5;
    samples++;
    own += ownOfStep;
    fallen += fallenOfStep;
    squareOfOwn += ownOfStep * ownOfStep;
    squareOfFallen += fallenOfStep * fallenOfStep;
    product += ownOfStep * fallenOfStep;
}

/** The ratio of the sums, if it is surely too large; else 0. */
double StepWatch::Together::relaxation() const {
    if (samples < samplesInABlock || !(fallen > 0) || !isfinite(squareOfOwn)) return 0;
    // Rare collisions may take longer than a step, as long as it does not overshoot.
    const bool isRare = own * own < leastPartOfSamples * samples * squareOfOwn;
    const double ratio = own / fallen, largest = isRare ? overshooting : largestRelaxation,
                 variance = squareOfOwn - 2 * ratio * product + ratio * ratio * squareOfFallen,
                 error = sqrt(max(0.0, variance)) / fallen;
    return ratio - standardErrors * error > largest ? ratio : 0;
}

bool StepWatch::isAt(const vector<Pose>& poses) const {
    for (size_t e = 0; e < posesOfFalls.size(); e++) {
        const auto &q = poses[e].q, &other = posesOfFalls[e].q;
        if (poses[e].R != posesOfFalls[e].R || q.w != other.w || q.x != other.x || q.y != other.y ||
            q.z != other.z)
            return false;
    }
    return true;
}

void StepWatch::addVelocities(const MatrixXd& velocities) {
    wantsVelocities = false;
    Finding found;
    for (size_t e = 0; e < stiffness.size(); e++) {
        if (bodies.getElements()[e].isWhollyFixed()) continue;
        const int row = bodies.firstRow(e), size = bodies.getElements()[e].isFree() ? 3 : 6;
        const auto fall = falls.col(0).segment(row, size);
        Together& own = stiffness[e].together;
        own.add(stepSize * fall.dot(velocities.col(0).segment(row, size)),
                fall.dot(moves.col(0).segment(row, size)));
        const double relaxation = own.relaxation();
        if (relaxation > found.value) found = {(int)e, relaxation};
    }
    stiffest = found.value > stiffestAlone.value ? found : stiffestAlone;
    remember();
}

void StepWatch::remember() {
    if (stiffest.value > stiffestSoFar.value) stiffestSoFar = stiffest;
    if (farthest.value > farthestSoFar.value) farthestSoFar = farthest;
}

void StepWatch::restart() {
    hasBefore = wantsVelocities = false;
    samples = 0;
    sums.assign(bodies.getElements().size(), Sums());
    stiffness.assign(bodies.getElements().size(), Stiffness());
    samplesOfBlock = 0;
    samplesOfMotion = 0;
    stiffestAlone = stiffest = farthest = stiffestSoFar = farthestSoFar = leap = motion = crawling =
        Finding();
    smallestRadius = INFINITY;
    for (const FluidElement& element : bodies.getElements())
        for (double radius : element.radii) smallestRadius = min(smallestRadius, radius);
}

void StepWatch::note(long long step, double h, double kT, const vector<Pose>& poses,
                     const MatrixXd& wrenches, const Motion& kind) {
    wantsVelocities = false;
    if (h != stepSize || kT != energy) {
        restart();
        stepSize = h;
        energy = kT;
    }
    if (step % interval == 0) {
        before = poses;
        wrenchesBefore = wrenches;
        hasBefore = true;
    } else if (hasBefore && step % interval == 1) {
        compare(kT, poses, wrenches, kind);
        hasBefore = false;
    }
}

void StepWatch::compare(double kT, const vector<Pose>& poses, const MatrixXd& wrenches,
                        const Motion& kind) {
    const auto& elements = bodies.getElements();
    Vector3d mean = Vector3d::Zero();
    int moving = 0;
    for (size_t e = 0; e < elements.size(); e++) {
        if (elements[e].isWhollyFixed()) continue;
        mean += poses[e].R - before[e].R;
        moving++;
    }
    if (moving > 0) mean /= moving;
    for (size_t e = 0; e < elements.size(); e++) {
        if (elements[e].isWhollyFixed()) continue;
        Sums& own = sums[e];
        const Vector3d displacement = poses[e].R - before[e].R;
        const Vector3d relative = displacement - mean;
        own.displacement += relative;
        own.squareOfDisplacement += relative.squaredNorm();
        const int row = bodies.firstRow(e);
        if (relative.norm() > largestLeap * smallestRadius && moving > 1 && kind.flowIsUniform &&
            relative.norm() > leap.value)
            leap = {(int)e, relative.norm()};
        if (kT > 0) {
            addToBlock(e, poses, wrenches);
            continue;
        }
        const int size = elements[e].isFree() ? 3 : 6;
        Matrix<double, Dynamic, 1, 0, 6, 1> d(size);
        d.head<3>() = displacement;
        if (size == 6) d.tail<3>() = turnBetween(before[e], poses[e]);
        const double fall =
            d.dot(wrenchesBefore.col(0).segment(row, size) - wrenches.col(0).segment(row, size));
        double scale = abs(d.dot(wrenchesBefore.col(0).segment(row, size)));
        const auto* known = kind.followsForces || isHindered() ? nullptr : alone.find(e);
        if (known) {
            const Matrix3d toBody = poses[e].rotation().transpose();
            for (int k = 0; k < size; k += 3) d.segment<3>(k) = (toBody * d.segment<3>(k)).eval();
            scale = 0;
            for (int i = 0; i < size; i++)
                for (int k = 0; k < size; k++)
                    scale += d[i] * known->friction(i, k) * d[k] / stepSize;
        }
        if (scale == 0 || !(displacement.norm() > rounding * smallestRadius)) continue;
        const double sample = max(-largestSample, min(largestSample, fall / scale));
        if (!isfinite(sample)) continue;
        own.relaxation += sample;
        own.squareOfRelaxation += sample * sample;
        own.relaxations++;
    }
    // Joints take mobility off that the product with the mobility does not.
    wantsVelocities = kT > 0 && !hasJoints && elements.size() > 1;
    if (wantsVelocities) {
        falls = wrenchesBefore.col(0) - wrenches.col(0);
        posesOfFalls = poses;
    }
    if (kT > 0 && ++samplesOfBlock == samplesInABlock) judgeBlock();
    if (kT > 0 && (motion.element < 0 || motion.value < leastMotion)) noteMotion(poses);
    if (++samples >= leastSamples) judge(kind.flowIsUniform && moving > 1);
    remember();
    if (samples < mostSamples) return;
    samples = 0;
    sums.assign(elements.size(), Sums());
    leap = Finding();
}

void StepWatch::addToBlock(int e, const vector<Pose>& poses, const MatrixXd& wrenches) {
    const int row = bodies.firstRow(e);
    moves.resize(wrenches.rows(), 1);
    moves.col(0).segment<3>(row) = poses[e].R - before[e].R;
    const auto fall = wrenchesBefore.col(0).segment(row, bodies.getElements()[e].isFree() ? 3 : 6) -
                      wrenches.col(0).segment(row, bodies.getElements()[e].isFree() ? 3 : 6);
    stiffness[e].forces.add(poses[e].R - before[e].R, fall.head<3>());
    if (bodies.getElements()[e].isFree()) return;
    moves.col(0).segment<3>(row + 3) = turnBetween(before[e], poses[e]);
    stiffness[e].torques.add(moves.col(0).segment<3>(row + 3), fall.tail<3>());
}

/** Find out whether steps with noise are so short that nothing moves. */
void StepWatch::noteMotion(const vector<Pose>& poses) {
    const auto& elements = bodies.getElements();
    for (size_t e = 0; e < elements.size(); e++) {
        if (elements[e].isWhollyFixed()) continue;
        double moved = (poses[e].R - before[e].R).norm() / smallestRadius;
        if (!elements[e].isFree()) moved = max(moved, turnBetween(before[e], poses[e]).norm());
        if (moved > motion.value || motion.element < 0) motion = {(int)e, moved};
    }
    if (motion.element < 0) return;  // nothing can move
    crawling =
        ++samplesOfMotion >= samplesOfCrawling && motion.value < leastMotion ? motion : Finding();
}

/** Whether walls, lubrication, joints or constraints take mobility off elements. */
bool StepWatch::isHindered() const {
    const MobilityTraits* traits = bodies.hasModel() ? &bodies.getModel().getTraits() : nullptr;
    return hasJoints || bodies.getFreeMotion().any() ||
           (traits && (!traits->isHomogeneous || traits->productsIterate));
}

/** Find the stiffest element of the block, and begin another one. */
void StepWatch::judgeBlock() {
    stiffestAlone = Finding();
    for (size_t e = 0; e < stiffness.size(); e++) {
        Stiffness& own = stiffness[e];
        double found = 0;
        if (!bodies.getElements()[e].isWhollyFixed()) {
            // Groups may step at the same time: resolveOverdamped() has found all of these before.
            const MatrixXd& mobility = alone.of(e).mobility;
            const auto mean = [&](int first) {
                return mobility.diagonal().segment<3>(first).mean();
            };
            found = own.forces.relaxation(samplesOfBlock, mean(0), stepSize, energy, isHindered());
            // About their axes, rods turn far more easily than about others, so that the mean says
            // too little of the mobility about the stiffest direction.
            if (!bodies.getElements()[e].isFree())
                found = max(
                    found, own.torques.relaxation(samplesOfBlock, mean(3), stepSize, energy, true));
        }
        own.least = own.blocksInARow > 0 ? min(own.least, found) : found;
        own.blocksInARow = found > largestRelaxation ? own.blocksInARow + 1 : 0;
        if (own.blocksInARow >= agreeingBlocks && own.least > stiffestAlone.value)
            stiffestAlone = {(int)e, own.least};
        own.forces = own.torques = Block();
    }
    samplesOfBlock = 0;
    stiffest = stiffestAlone;
}

void StepWatch::judge(bool withDisplacements) {
    farthest = leap;
    if (energy == 0) stiffest = Finding();
    for (size_t e = 0; e < sums.size(); e++) {
        const Sums& own = sums[e];
        const double n = own.relaxations;
        if (n >= leastSamples) {
            const double mean = own.relaxation / n,
                         variance = max(0.0, own.squareOfRelaxation / n - mean * mean);
            if (mean - standardErrors * sqrt(variance / n) > largestRelaxation &&
                mean > stiffest.value)
                stiffest = {(int)e, mean};
        }
        if (!withDisplacements) continue;
        const double mean = own.displacement.norm() / samples,
                     variance = max(0.0, own.squareOfDisplacement / samples - mean * mean);
        if (mean - standardErrors * sqrt(variance / samples) >
                largestMeanDisplacement * smallestRadius &&
            mean > farthest.value)
            farthest = {(int)e, mean};
    }
}

}  // namespace RigidHIPlugin
