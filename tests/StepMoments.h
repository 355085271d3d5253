#ifndef RIGIDHI_STEP_MOMENTS_H_
#define RIGIDHI_STEP_MOMENTS_H_

// Means and covariances of one step without momenta, exact in the limit of short steps. Nothing is
// sampled: a step is taken with each of its random numbers by itself.

#include <Eigen/Geometry>
#include <map>
#include <memory>
#include <tuple>
#include <utility>

#include "GridNumbers.h"
#include "RandomFieldModel.h"
#include "ReferenceScenes.h"
#include "schemes/OverdampedSchemes.h"

namespace RigidHITest {

/** One of the random numbers of a step. */
struct RandomNumber {
    uint32_t purpose, index;
    int component;
    bool operator<(const RandomNumber& other) const {
        return std::tie(purpose, index, component) <
               std::tie(other.purpose, other.index, other.component);
    }
    /** Whether it belongs to a direction of finite differences. */
    bool isOfDirection() const {
        return purpose == RigidHIPlugin::NoiseStream::FiniteDifference ||
               purpose == RigidHIPlugin::NoiseStream::FreeFiniteDifference;
    }
};
/** Values of random numbers; all others are 0. */
using RandomNumbers = std::map<RandomNumber, double>;

/** A move whose random numbers a test sets. */
class TestedMove : public RigidHIPlugin::OverdampedMove {
public:
    explicit TestedMove(RigidHIPlugin::BodyMobility& mobility) : OverdampedMove(mobility) {}
    RandomNumbers values;
    std::vector<RandomNumber> drawn;  // the random numbers of the steps

protected:
    void drawNumbers(uint32_t purpose, uint32_t index, int count, double* numbers) override {
        for (int k = 0; k < count; k++) {
            const RandomNumber number = {purpose, index, k};
            drawn.push_back(number);
            const auto found = values.find(number);
            numbers[k] = found == values.end() ? 0 : found->second;
        }
        randomNumbers += count;
    }
};

/**
 * The result of a step as a function of its random numbers, and the mean and covariance of this
 * function over the random numbers. They are right to first order in h, to which only second
 * moments of random numbers contribute. Both share the steps with a single random number, so
 * settings of the step must not change between the two.
 */
class StepMoments {
public:
    using VectorXd = Eigen::VectorXd;
    using MatrixXd = Eigen::MatrixXd;
    using Integrator = RigidHIPlugin::CustomRigidHIIntegrator;

    explicit StepMoments(Integrator::Scheme which)
        : isDriftCorrectorRFD(which == Integrator::DriftCorrectorRFD) {}
    virtual ~StepMoments() = default;
    /** The result of a step with these random numbers. */
    virtual VectorXd take(const RandomNumbers& values) = 0;

    VectorXd mean() {
        if (!isDriftCorrectorRFD) return meanOver({}, numbers);
        // The drift of this scheme is of second order both in the directions of differences and in
        // the other random numbers, so both must be non-zero at the same time.
        std::vector<RandomNumber> directions, others;
        for (const RandomNumber& number : numbers)
            (number.isOfDirection() ? directions : others).push_back(number);
        const VectorXd middle = meanOver({}, others);
        VectorXd sum = middle;
        for (const RandomNumber& number : directions)
            sum +=
                0.5 * (meanOver({{number, 1}}, others) + meanOver({{number, -1}}, others)) - middle;
        return sum;
    }
    MatrixXd covariance() {
        MatrixXd sum;
        for (const RandomNumber& number : numbers) {
            const VectorXd odd = 0.5 * (takeSingle(number, 1) - takeSingle(number, -1));
            if (sum.size() == 0) sum.setZero(odd.size(), odd.size());
            sum += odd * odd.transpose();
        }
        return sum;
    }

protected:
    /** Random numbers that the move has drawn, and those of its field. */
    void findNumbers(TestedMove& move) {
        numbers = move.drawn;
        for (int i = 0; i < TestedGridFluid::numNumbers() && move.getField(); i++)
            numbers.push_back({RigidHIPlugin::NoiseStream::RandomField, (uint32_t)i, 0});
        const RigidHIPlugin::CoupledBodies& bodies = move.getMobility().getBodies();
        const auto* model =
            bodies.hasModel() ? dynamic_cast<const RandomFieldModel*>(&bodies.getModel()) : nullptr;
        if (!model) return;
        for (int w = 0; w < model->numWaves() && move.getField(); w++)
            numbers.push_back({RigidHIPlugin::NoiseStream::RandomField, (uint32_t)w, 0});
    }
    static void setNumbers(TestedMove& move, const RandomNumbers& values) {
        move.values = values;
        move.drawn.clear();
        RandomFieldModel::onlyWave = 0;
        RandomFieldModel::amplitudeOfWave = 0;
        TestedGridFluid::set(-1, 0);
        for (const auto& value : values) {
            if (value.first.purpose != RigidHIPlugin::NoiseStream::RandomField) continue;
            TestedGridFluid::set(value.first.index, value.second);
            RandomFieldModel::onlyWave = value.first.index;
            RandomFieldModel::amplitudeOfWave = value.second;
        }
    }
    /** Let fields that are drawn from now on be random again. */
    static void endNumbers() { RandomFieldModel::onlyWave = -1; }

private:
    /** The result of a step with one random number, 1 or -1. It is computed once. */
    const VectorXd& takeSingle(const RandomNumber& number, int sign) {
        VectorXd& result = singles[{number, sign}];
        if (result.size() == 0) result = take({{number, double(sign)}});
        return result;
    }
    VectorXd meanOver(const RandomNumbers& fixed, const std::vector<RandomNumber>& over) {
        const VectorXd middle = take(fixed);
        VectorXd sum = middle;
        for (const RandomNumber& number : over)
            for (int sign : {1, -1}) {
                if (fixed.empty()) {
                    sum += 0.5 * (takeSingle(number, sign) - middle);
                    continue;
                }
                RandomNumbers values = fixed;
                values[number] = sign;
                sum += 0.5 * (take(values) - middle);
            }
        return sum;
    }
    const bool isDriftCorrectorRFD;
    std::vector<RandomNumber> numbers;
    std::map<std::pair<RandomNumber, int>, VectorXd> singles;
};

/** Steps of a scheme that all start from the poses of the scene, with constant wrenches. */
class TestedStep : public StepMoments {
public:
    TestedStep(Integrator::Scheme which, const PosedBodies& scene,
               RigidHIPlugin::BodyMobility& mobility, double h, double kT)
        : StepMoments(which), scene(scene), entry(RigidHIPlugin::overdampedScheme(which)),
          scheme(entry.make()), joints(scene.joints, mobility.getBodies()), move(mobility) {
        if (!scene.joints.empty()) move.setJoints(&joints);
        step.h = h;
        step.kT = kT;
        step.motorRates = scene.motorRates;
        step.difference = 1e-5;
        move.start = scene.poses;
        if (scene.wrenches.size() > 0) move.force = scene.wrenches;
        move.recording.holds = &holds;
        move.recording.jointForces = &jointForces;
        take({});
        findNumbers(move);
    }

    /**
     * The result of a step with these random numbers: its velocity, and below it the holding
     * wrenches.
     */
    VectorXd take(const RandomNumbers& values) override {
        setNumbers(move, values);
        for (RigidHIPlugin::OverdampedScheme::Vectors* memory : scheme->memory())
            memory->resize(0, 0);
        holds.setZero(scene.numRows(), 1);
        jointForces.setZero(4, scene.joints.size());
        move.begin(step);
        for (int stage = 0; stage < entry.numStages(); stage++) {
            move.prescribe(scene.velocities.size() > 0 ? &scene.velocities : nullptr);
            scheme->run(stage, move);
        }
        endNumbers();
        if (givesJointForces)
            return Eigen::Map<const VectorXd>(jointForces.data(), jointForces.size());
        VectorXd outcome(2 * scene.numRows());
        outcome << displacement() / step.h, holds.col(0);
        return outcome;
    }
    RigidHIPlugin::OverdampedStep step;
    /** Whether mean() is that of the forces of joints (Joints::forces()) instead. */
    bool givesJointForces = false;

private:
    /** Translations, and rotation vectors in the lab frame. */
    VectorXd displacement() const {
        VectorXd u = VectorXd::Zero(scene.numRows());
        for (size_t e = 0; e < scene.elements.size(); e++) {
            const int row = scene.firstRow(e);
            u.segment<3>(row) = move.present[e].R - move.start[e].R;
            if (scene.elements[e].isFree()) continue;
            const auto d = move.present[e].q * RigidHIPlugin::scalar::conjugate(move.start[e].q);
            const Eigen::AngleAxisd turn(Eigen::Quaterniond(d.w, d.x, d.y, d.z));
            u.segment<3>(row + 3) = turn.angle() * turn.axis();
        }
        return u;
    }

    const PosedBodies& scene;
    const RigidHIPlugin::OverdampedEntry& entry;
    const std::unique_ptr<RigidHIPlugin::OverdampedScheme> scheme;
    const RigidHIPlugin::Joints joints;

public:
    TestedMove move;

private:
    MatrixXd holds, jointForces;
};

}  // namespace RigidHITest

#endif
