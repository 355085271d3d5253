#include "fluid/StepWatch.h"

#include <algorithm>
#include <cmath>

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
/** Without noise, shorter displacements are rounding, in smallest radii. */
const double rounding = 1e-7;

}  // namespace

void StepWatch::restart() {
    hasBefore = false;
    samples = 0;
    sums.assign(bodies.getElements().size(), Sums());
    stiffest = farthest = Finding();
    smallestRadius = INFINITY;
    for (const FluidElement& element : bodies.getElements())
        for (double radius : element.radii) smallestRadius = min(smallestRadius, radius);
}

void StepWatch::note(long long step, double h, double kT, const vector<Pose>& poses,
                     const MatrixXd& wrenches, bool isUniform) {
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
        compare(kT, poses, wrenches, isUniform);
        hasBefore = false;
    }
}

void StepWatch::compare(double kT, const vector<Pose>& poses, const MatrixXd& wrenches,
                        bool isUniform) {
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
        const auto force = wrenchesBefore.col(0).segment<3>(row);
        double work = force.dot(displacement),
               fall = (force - wrenches.col(0).segment<3>(row)).dot(displacement);
        if (!elements[e].isFree()) {
            const auto turn = poses[e].q * conjugate(before[e].q);
            const Vector3d angles = (turn.w < 0 ? -2 : 2) * Vector3d(turn.x, turn.y, turn.z);
            const auto torque = wrenchesBefore.col(0).segment<3>(row + 3);
            work += torque.dot(angles);
            fall += (torque - wrenches.col(0).segment<3>(row + 3)).dot(angles);
        }
        const double scale = max(2 * kT, abs(work));
        if (kT == 0 && (scale == 0 || !(displacement.norm() > rounding * smallestRadius))) continue;
        const double sample = max(-largestSample, min(largestSample, fall / scale));
        if (!isfinite(sample)) continue;
        own.relaxation += sample;
        own.squareOfRelaxation += sample * sample;
        own.relaxations++;
    }
    if (++samples >= leastSamples) judge(isUniform && moving > 1);
    if (samples < mostSamples) return;
    samples = 0;
    sums.assign(elements.size(), Sums());
}

void StepWatch::judge(bool withDisplacements) {
    stiffest = farthest = Finding();
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
