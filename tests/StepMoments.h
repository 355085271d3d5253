#ifndef RIGIDHI_STEP_MOMENTS_H_
#define RIGIDHI_STEP_MOMENTS_H_

// Means and covariances of one step without momenta, exactly in the limit of short steps: a step is
// taken with each of its random numbers by itself, so that nothing is sampled.

#include <Eigen/Geometry>
#include <map>
#include <memory>
#include <tuple>

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

/** Steps of a scheme that all start from the poses of the scene, with constant wrenches. */
class TestedStep {
public:
    using VectorXd = Eigen::VectorXd;
    using MatrixXd = Eigen::MatrixXd;
    using Integrator = RigidHIPlugin::CustomRigidHIIntegrator;

    TestedStep(Integrator::Scheme which, const PosedBodies& scene,
               RigidHIPlugin::BodyMobility& mobility, double h, double kT)
        : scene(scene), isDriftCorrectorRFD(which == Integrator::DriftCorrectorRFD),
          entry(RigidHIPlugin::overdampedScheme(which)), scheme(entry.make()),
          joints(scene.joints, mobility.getBodies()), move(mobility) {
        if (!scene.joints.empty()) move.setJoints(&joints);
        step.h = h;
        step.kT = kT;
        step.motorRates = scene.motorRates;
        step.difference = 1e-5;
        move.start = scene.poses;
        if (scene.wrenches.size() > 0) move.force = scene.wrenches;
        move.recordHolds(&holds);
        move.recordJointForces(&jointForces);
        move.values.clear();
        take({});
        numbers = move.drawn;
        if (const RandomFieldModel* model = fieldModel()) {
            for (int w = 0; w < model->numWaves() && move.getField(); w++)
                numbers.push_back({RigidHIPlugin::NoiseStream::RandomField, (uint32_t)w, 0});
        }
    }

    /** The mean velocity of bodies, and below it the mean wrench that holds fixed components. */
    VectorXd mean() {
        if (!isDriftCorrectorRFD) return meanOver({}, numbers);
        // Its drift is of second order in the directions of differences and in the other random
        // numbers, so that both must be there at a time.
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
    /** The covariance of mean()'s rows. */
    MatrixXd covariance() {
        const int rows = 2 * scene.numRows();
        MatrixXd sum = MatrixXd::Zero(rows, rows);
        for (const RandomNumber& number : numbers) {
            const VectorXd odd = 0.5 * (take({{number, 1}}) - take({{number, -1}}));
            sum += odd * odd.transpose();
        }
        return sum;
    }
    /** A step with these random numbers: its velocity, and below it the wrenches that hold. */
    VectorXd take(const RandomNumbers& values) {
        setField(values);
        for (RigidHIPlugin::OverdampedScheme::Vectors* memory : scheme->memory())
            memory->resize(0, 0);
        holds.setZero(scene.numRows(), 1);
        jointForces.setZero(4, scene.joints.size());
        move.values = values;
        move.drawn.clear();
        move.begin(step);
        for (int stage = 0; stage < entry.numStages(); stage++) {
            move.prescribe(scene.velocities.size() > 0 ? &scene.velocities : nullptr);
            scheme->run(stage, move);
        }
        RandomFieldModel::onlyWave = -1;
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
    const RandomFieldModel* fieldModel() {
        const RigidHIPlugin::CoupledBodies& bodies = move.getMobility().getBodies();
        return bodies.hasModel() ? dynamic_cast<const RandomFieldModel*>(&bodies.getModel())
                                 : nullptr;
    }
    void setField(const RandomNumbers& values) {
        RandomFieldModel::onlyWave = 0;
        RandomFieldModel::amplitudeOfWave = 0;
        for (const auto& value : values) {
            if (value.first.purpose != RigidHIPlugin::NoiseStream::RandomField) continue;
            RandomFieldModel::onlyWave = value.first.index;
            RandomFieldModel::amplitudeOfWave = value.second;
        }
    }
    VectorXd meanOver(const RandomNumbers& fixed, const std::vector<RandomNumber>& over) {
        const VectorXd middle = take(fixed);
        VectorXd sum = middle;
        for (const RandomNumber& number : over)
            for (int sign : {1, -1}) {
                RandomNumbers values = fixed;
                values[number] = sign;
                sum += 0.5 * (take(values) - middle);
            }
        return sum;
    }
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
    const bool isDriftCorrectorRFD;
    const RigidHIPlugin::OverdampedEntry& entry;
    const std::unique_ptr<RigidHIPlugin::OverdampedScheme> scheme;
    const RigidHIPlugin::Joints joints;

public:
    TestedMove move;

private:
    MatrixXd holds, jointForces;
    std::vector<RandomNumber> numbers;
};

}  // namespace RigidHITest

#endif
