#ifndef RIGIDHI_RANDOM_FIELD_MODEL_H_
#define RIGIDHI_RANDOM_FIELD_MODEL_H_

#include <cmath>
#include <random>

#include "HydrodynamicSupport.h"
#include "mobility/MobilityModel.h"

namespace RigidHITest {

/**
 * A fluid with its own random field: a few plane waves w(r), each a flow without sources. Particles
 * move with the flow at their centres and turn with half its curl. Let B have a row for each
 * velocity and a column for each wave. Then M = B B^T, and the field is B times random numbers.
 */
class RandomFieldModel : public RigidHIPlugin::MobilityModel, public RigidHIPlugin::FieldOfModel {
public:
    explicit RandomFieldModel(const RigidHIPlugin::HydrodynamicParticles& particles)
        : MobilityModel(particles, 1, RigidHIPlugin::MobilityTraits("RandomFieldModel")) {
        std::mt19937 random(3);
        std::normal_distribution<double> normal;
        for (int i = 0; i < 12; i++) {
            const Vector3d k(normal(random), normal(random), normal(random));
            const Vector3d first = k.cross(Vector3d::Unit(i % 3)).normalized();
            for (const Vector3d& direction : {first, Vector3d(k.cross(first).normalized())}) {
                waves.push_back({k, direction / k.norm(), 0});
                waves.push_back({k, direction / k.norm(), M_PI / 2});
            }
        }
    }
    const FieldOfModel* randomField() const override { return this; }
    bool isLocal() const override { return true; }
    void draw(const RigidHIPlugin::NoiseStream& noise, uint32_t purpose,
              const RigidHIPlugin::BoxVectors&,
              std::unique_ptr<RigidHIPlugin::RandomField>& field) const override {
        if (!field) field = std::make_unique<Field>(*this);
        VectorXd& amplitudes = static_cast<Field&>(*field).amplitudes;
        amplitudes.resize(numWaves());
        for (int i = 0; i < numWaves(); i += 2)
            noise.pair(purpose, i, 0, amplitudes[i], amplitudes[i + 1]);
        if (onlyWave >= 0) amplitudes = amplitudeOfWave * VectorXd::Unit(numWaves(), onlyWave);
    }
    int numWaves() const { return waves.size(); }
    /** The index of one wave that replaces the random numbers, with its amplitude, or -1 for
     * random numbers. */
    static int onlyWave;
    static double amplitudeOfWave;
    /** The covariance of the flows at two points, computed in another way: the sum of cos(k.(r -
     * s)) (1 - k k/k^2)/k^2. */
    Eigen::Matrix3d covariance(const Vector3d& r, const Vector3d& s) const {
        Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
        for (size_t i = 0; i < waves.size(); i += 4) {
            const Vector3d& k = waves[i].k;
            sum += cos(k.dot(r - s)) *
                   (Eigen::Matrix3d::Identity() - k * k.transpose() / k.squaredNorm()) /
                   k.squaredNorm();
        }
        return sum;
    }
    MatrixXd B(const RigidHIPlugin::Placement& at) const {
        MatrixXd rows(particles.numRows, numWaves());
        for (int i = 0; i < particles.size(); i++)
            for (int w = 0; w < numWaves(); w++) {
                const double angle = waves[w].k.dot(toEigen(at.positions[i])) + waves[w].phase;
                rows.col(w).segment<3>(particles.firstRow[i]) = cos(angle) * waves[w].amplitude;
                if (particles.hasTorque[i])
                    rows.col(w).segment<3>(particles.firstRow[i] + 3) =
                        -0.5 * sin(angle) * waves[w].k.cross(waves[w].amplitude);
            }
        return rows;
    }

protected:
    std::unique_ptr<RigidHIPlugin::MobilityAt> makePlace() const override {
        return std::make_unique<RandomFieldModelAt>(*this);
    }

private:
    struct Wave {
        Vector3d k, amplitude;
        double phase;
    };
    struct Field : public RigidHIPlugin::RandomField {
        explicit Field(const RandomFieldModel& model) : model(model) {}
        void slipsAt(const RigidHIPlugin::Placement& at, bool, MatrixXd& slips) override {
            slips = model.B(at) * amplitudes;
        }
        void addFlowAt(const std::vector<OpenMM::Vec3>& points, double factor,
                       RigidHIPlugin::Velocities& velocities) override {
            for (size_t p = 0; p < points.size(); p++)
                for (int w = 0; w < model.numWaves(); w++)
                    velocities.col(p) +=
                        factor * amplitudes[w] *
                        cos(model.waves[w].k.dot(toEigen(points[p])) + model.waves[w].phase) *
                        model.waves[w].amplitude;
        }
        /** The waves are along no axis, so they have no amplitude along a driven wave. */
        double amplitudeOf(const RigidHIPlugin::DrivenFlow&) override { return 0; }
        long long getNumRandomNumbers() const override { return amplitudes.size(); }
        const RandomFieldModel& model;
        VectorXd amplitudes;
    };
    struct RandomFieldModelAt : public RigidHIPlugin::MobilityAt {
        explicit RandomFieldModelAt(const RandomFieldModel& model)
            : MobilityAt(model), model(model) {}
        void multiply(const MatrixXd& forces, MatrixXd& velocities,
                      const RigidHIPlugin::Accuracy&) override {
            velocities = B * (B.transpose() * forces);
        }
        void moveTo(const RigidHIPlugin::Placement& at, bool) override { B = model.B(at); }
        void addFlowAt(const RigidHIPlugin::FlowSources& sources,
                       const std::vector<OpenMM::Vec3>& points, double factor,
                       RigidHIPlugin::Velocities& velocities) override {
            Field flow(model);
            flow.amplitudes = B.transpose() * sources.forces.col(0);
            flow.addFlowAt(points, factor, velocities);
        }
        const RandomFieldModel& model;
        MatrixXd B;
    };
    std::vector<Wave> waves;
};

inline int RandomFieldModel::onlyWave = -1;
inline double RandomFieldModel::amplitudeOfWave = 1;

}  // namespace RigidHITest

#endif
