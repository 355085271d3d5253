#include "mobility/models/rotneprager/RotnePragerYamakawa.h"

#include "mobility/models/rotneprager/Columns.h"
#include "mobility/models/rotneprager/FreeFlow.h"
#include "mobility/models/rotneprager/RotnePragerYamakawa-inl.h"

using namespace OpenMM;

namespace RigidHIPlugin {

using namespace scalar;

namespace {

using Vector = Vector3<double>;

Vector separation(const Vec3& a, const Vec3& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }

/**
 * Put the block identity I + outer r r^T into the matrix, and its transpose at the mirrored
 * position.
 */
void placeSymmetric(Eigen::MatrixXd& m, int row, int column, double identity, double outer,
                    const Vector& r) {
    const double v[3] = {r.x, r.y, r.z};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            m(row + i, column + j) = m(column + j, row + i) =
                outer * v[i] * v[j] + (i == j ? identity : 0.0);
}
/**
 * Put the block B with B f = factor f x r into the matrix, and its transpose at the mirrored
 * position.
 */
void placeCross(Eigen::MatrixXd& m, int row, int column, double factor, const Vector& r) {
    const double x = factor * r.x, y = factor * r.y, z = factor * r.z;
    const double block[3][3] = {{0, z, -y}, {-z, 0, x}, {y, -x, 0}};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) m(row + i, column + j) = m(column + j, row + i) = block[i][j];
}

class RotnePragerYamakawaAt : public MobilityAt {
public:
    using MobilityAt::MobilityAt;
    void multiply(const Eigen::MatrixXd& forces, Eigen::MatrixXd& velocities,
                  const Accuracy&) override;
    void dense(Eigen::MatrixXd& mobility) override { denseColumns(0, mobility); }
    void denseColumns(int firstParticle, Eigen::MatrixXd& mobility) override;
    void addFlowAt(const FlowSources& sources, const std::vector<Vec3>& points, double factor,
                   Velocities& velocities) override {
        addFreeFlowAt(particles, positions, sources, points, factor / (8 * M_PI * viscosity),
                      velocities);
    }

protected:
    void moveTo(const Placement& placement, bool) override { positions = placement.positions; }

private:
    std::vector<Vec3> positions;
};

void RotnePragerYamakawaAt::multiply(const Eigen::MatrixXd& forces, Eigen::MatrixXd& velocities,
                                     const Accuracy&) {
    velocities.resize(particles.numRows, forces.cols());
    velocities.setZero();
    for (int i = 0; i < particles.size(); i++) {
        const int row = particles.firstRow[i];
        for (int j = 0; j < particles.size(); j++) {
            const int from = particles.firstRow[j];
            const Vector r = separation(positions[i], positions[j]);
            const auto m = pairMobility(dot(r, r), particles.radii[i], particles.radii[j]);
            for (int column = 0; column < forces.cols(); column++) {
                const Vector force = rows(forces, from, column);
                const Vector torque =
                    particles.hasTorque[j] ? rows(forces, from + 3, column) : Vector{0, 0, 0};
                Vector velocity = {0, 0, 0}, omega = {0, 0, 0};
                addPairVelocities<1, true, true>(m, r, &force, &torque, &velocity, &omega);
                addTo(velocities, row, column, velocity);
                if (particles.hasTorque[i]) addTo(velocities, row + 3, column, omega);
            }
        }
    }
    velocities *= 1 / (8 * M_PI * viscosity);
}

void RotnePragerYamakawaAt::denseColumns(int firstParticle, Eigen::MatrixXd& mobility) {
    mobility.resize(particles.numRows, particles.numRows);
    const double scale = 1 / (8 * M_PI * viscosity);
    for (int i = firstParticle; i < particles.size(); i++) {
        const int row = particles.firstRow[i];
        for (int j = 0; j <= i; j++) {
            const int column = particles.firstRow[j];
            const Vector r = separation(positions[i], positions[j]);
            const auto m = pairMobility(dot(r, r), particles.radii[i], particles.radii[j]);
            placeSymmetric(mobility, row, column, scale * m.ttI, scale * m.ttR, r);
            if (particles.hasTorque[i]) placeCross(mobility, row + 3, column, scale * m.rt, r);
            if (particles.hasTorque[j]) placeCross(mobility, row, column + 3, scale * m.tr, r);
            if (particles.hasTorque[i] && particles.hasTorque[j])
                placeSymmetric(mobility, row + 3, column + 3, scale * m.rrI, scale * m.rrR, r);
        }
    }
}

MobilityTraits traitsInFreeFluid() {
    MobilityTraits traits("RotnePragerYamakawa");
    traits.isHomogeneous = traits.isIsotropic = traits.isDivergenceFree = true;
    return traits;
}

}  // namespace

RotnePragerYamakawa::RotnePragerYamakawa(const HydrodynamicParticles& particles, double viscosity)
    : MobilityModel(particles, viscosity, traitsInFreeFluid()) {}

std::unique_ptr<MobilityAt> RotnePragerYamakawa::makePlace() const {
    return std::make_unique<RotnePragerYamakawaAt>(*this);
}

std::unique_ptr<MobilityModel> RotnePragerYamakawa::forCollectiveModes(
    const HydrodynamicParticles& spheres) const {
    return std::make_unique<RotnePragerYamakawa>(spheres, viscosity);
}

}  // namespace RigidHIPlugin
