#include "fluid/SavedStep.h"

#include <cmath>

#include "rigidbody/EigenVec3.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

namespace {

MatrixXd toMatrix(const vector<Pose>& poses) {
    MatrixXd numbers(7, poses.size());
    for (size_t e = 0; e < poses.size(); e++)
        numbers.col(e) << poses[e].R, poses[e].q.w, poses[e].q.x, poses[e].q.y, poses[e].q.z;
    return numbers;
}

vector<Pose> toPoses(const MatrixXd& numbers) {
    vector<Pose> poses(numbers.cols());
    for (size_t e = 0; e < poses.size(); e++) {
        poses[e].R = numbers.col(e).head<3>();
        poses[e].q = {numbers(3, e), numbers(4, e), numbers(5, e), numbers(6, e)};
    }
    return poses;
}

const int numNumbersOfStep = 18;  // and then the rates of motors

/** The numbers of a step, without poses and forces. */
MatrixXd toMatrix(const OverdampedStep& step, const BoxVectors& box) {
    MatrixXd numbers(numNumbersOfStep + step.motorRates.size(), 1);
    numbers.col(0).head(numNumbersOfStep) << step.h, step.kT, step.difference,
        step.driftFactorScalesAll, step.noise.seed, double(step.noise.step), step.noise.attempt,
        step.noise.law, step.noise.field, toEigen(box[0]), toEigen(box[1]), toEigen(box[2]);
    numbers.col(0).tail(step.motorRates.size()) = step.motorRates;
    return numbers;
}

OverdampedStep toStep(const MatrixXd& numbers) {
    OverdampedStep step;
    step.h = numbers(0);
    step.kT = numbers(1);
    step.difference = numbers(2);
    step.driftFactorScalesAll = numbers(3) != 0;
    step.noise.seed = numbers(4);
    step.noise.step = numbers(5);
    step.noise.attempt = numbers(6);
    step.noise.law = numbers(7) == 1   ? NoiseStream::ThreePoint
                     : numbers(7) == 2 ? NoiseStream::TwoPoint
                                       : NoiseStream::Gaussian;
    step.noise.field = numbers(8);
    step.motorRates = numbers.col(0).tail(numbers.rows() - numNumbersOfStep);
    return step;
}

BoxVectors toBox(const MatrixXd& numbers) {
    BoxVectors box;
    for (int i = 0; i < 3; i++)
        box[i] = OpenMM::Vec3(numbers(9 + 3 * i), numbers(10 + 3 * i), numbers(11 + 3 * i));
    return box;
}

}  // namespace

vector<MatrixXd> numbersOf(const LastStep& last) {
    vector<MatrixXd> numbers = {toMatrix(last.step, last.box), toMatrix(last.start),
                                toMatrix(last.end)};
    numbers.insert(numbers.end(), last.forces.begin(), last.forces.end());
    numbers.insert(numbers.end(), last.memory.begin(), last.memory.end());
    numbers.insert(numbers.end(), last.prescribed.begin(), last.prescribed.end());
    return numbers;
}

bool areOfAStep(const vector<MatrixXd>& numbers, const OverdampedEntry& scheme, int numElements,
                int numRows) {
    const int numStages = scheme.numStages(), numMemories = scheme.make()->memory().size();
    const int count = numbers.size(), numWithoutPrescribed = 3 + numStages + numMemories;
    if (count != numWithoutPrescribed && count != numWithoutPrescribed + numStages) return false;
    if (numbers[0].rows() < numNumbersOfStep || numbers[0].cols() != 1) return false;
    for (int i = 0; i < (int)numbers.size(); i++) {
        bool fits = numbers[i].allFinite();
        if (i == 1 || i == 2)
            fits = fits && numbers[i].rows() == 7 && numbers[i].cols() == numElements;
        if (i > 2) fits = fits && (numbers[i].size() == 0 || numbers[i].rows() == numRows);
        if (i >= numWithoutPrescribed) fits = fits && numbers[i].cols() == 1;
        if (i > 2 && i < 3 + numStages && scheme.needsForces(i - 3))
            fits = fits && numbers[i].cols() == 1;
        if (!fits) return false;
    }
    // The step size and kT, and the numbers that are integers of 32 bits.
    if (!(numbers[0](0) > 0 && numbers[0](1) >= 0)) return false;
    for (int i : {4, 6, 7, 8})
        if (!(numbers[0](i) >= 0 && numbers[0](i) <= 4294967295.0)) return false;
    for (int i = 1; i < 3; i++)
        for (int e = 0; e < numElements; e++)
            if (!(abs(numbers[i].col(e).tail<4>().norm() - 1) <= 1e-9)) return false;
    return true;
}

LastStep stepOf(const vector<MatrixXd>& numbers, CustomRigidHIIntegrator::Scheme scheme) {
    LastStep last;
    last.scheme = scheme;
    last.step = toStep(numbers[0]);
    last.box = toBox(numbers[0]);
    last.start = toPoses(numbers[1]);
    last.end = toPoses(numbers[2]);
    const auto forces = numbers.begin() + 3;
    const int numStages = overdampedScheme(scheme).numStages();
    last.forces.assign(forces, forces + numStages);
    const auto memory = forces + numStages;
    const int numMemories = overdampedScheme(scheme).make()->memory().size();
    last.memory.assign(memory, memory + numMemories);
    last.prescribed.assign(memory + numMemories, numbers.end());
    last.isKnown = true;
    return last;
}

}  // namespace RigidHIPlugin
