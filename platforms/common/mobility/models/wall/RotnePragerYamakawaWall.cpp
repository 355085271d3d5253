#include "mobility/models/wall/RotnePragerYamakawaWall.h"

#include <algorithm>
#include <cmath>

#include "mobility/models/rotneprager/Columns.h"
#include "mobility/models/rotneprager/FreeFlow.h"
#include "mobility/models/wall/RotnePragerYamakawaWall-inl.h"
#include "simd/WithFlags.h"

using namespace OpenMM;

namespace RigidHIPlugin {

using namespace scalar;

namespace {

using Vector = Vector3<double>;

/** The mobility of particle i with particle j: the free part and the part of the wall. */
struct Pair {
    Vector r;
    PairMobility<double> free;
    WallMobility<double> wall;
    Pair(const Vec3& r_i, const Vec3& r_j, double a_i, double a_j)
        : r{r_i[0] - r_j[0], r_i[1] - r_j[1], r_i[2] - r_j[2]},
          free(pairMobility(dot(r, r), a_i, a_j)), wall(wallMobility(r, r_i[2], r_j[2], a_i, a_j)) {
    }
    /**
     * Add the velocities of i induced by forces and torques on j, for particles with or without
     * torque.
     */
    template <int columns>
    void addVelocities(bool torque_i, bool torque_j, const Vector* force, const Vector* torque,
                       Vector* velocity, Vector* omega) const {
        if (torque_i && torque_j)
            add<columns, true, true>(force, torque, velocity, omega);
        else if (torque_i)
            add<columns, true, false>(force, torque, velocity, omega);
        else if (torque_j)
            add<columns, false, true>(force, torque, velocity, omega);
        else
            add<columns, false, false>(force, torque, velocity, omega);
    }

private:
    template <int columns, bool targetTorque, bool sourceTorque>
    void add(const Vector* force, const Vector* torque, Vector* velocity, Vector* omega) const {
        addPairVelocities<columns, targetTorque, sourceTorque>(free, r, force, torque, velocity,
                                                               omega);
        addWallVelocities<columns, targetTorque, sourceTorque>(wall, force, torque, velocity,
                                                               omega);
    }
};

class RotnePragerYamakawaWallAt : public MobilityAt {
public:
    RotnePragerYamakawaWallAt(const MobilityModel& model, const NoSlipPlane& wall)
        : MobilityAt(model), wall(wall), positions(particles.size()), weights(particles.size()) {}
    void multiply(const Eigen::MatrixXd& forces, Eigen::MatrixXd& velocities,
                  const Accuracy&) override;
    void dense(Eigen::MatrixXd& mobility) override { denseColumns(0, mobility); }
    void denseColumns(int firstParticle, Eigen::MatrixXd& mobility) override;
    void addFlowAt(const FlowSources& sources, const std::vector<Vec3>& points, double factor,
                   Velocities& velocities) override {
        addWallFlowAt(particles, positions, weights, wall.getHeight(), sources, points,
                      factor / (8 * M_PI * viscosity), velocities);
    }

protected:
    void moveTo(const Placement& placement, bool nearby) override;

private:
    const NoSlipPlane& wall;
    std::vector<Vec3> positions;  // z from the wall, at least the radius
    std::vector<double> weights;  // B
};

void RotnePragerYamakawaWallAt::moveTo(const Placement& placement, bool nearby) {
    for (int i = 0; i < particles.size(); i++) {
        const Vec3& r = placement.positions[i];
        const double radius = particles.radii[i];
        positions[i] =
            Vec3(r[0], r[1], nearby ? r[2] - wall.getHeight() : wall.heightOver(r[2], radius));
        weights[i] = nearby ? 1 : wall.weight(r[2], radius);
    }
}

void RotnePragerYamakawaWallAt::multiply(const Eigen::MatrixXd& forces, Eigen::MatrixXd& velocities,
                                         const Accuracy&) {
    velocities.resize(particles.numRows, forces.cols());
    velocities.setZero();
    const double scale = 1 / (8 * M_PI * viscosity);
    for (int i = 0; i < particles.size(); i++) {
        const int row = particles.firstRow[i];
        const bool torque_i = particles.hasTorque[i];
        for (int j = 0; j < particles.size(); j++) {
            const int from = particles.firstRow[j];
            const bool torque_j = particles.hasTorque[j];
            const double factor = scale * (weights[i] * weights[j]);
            const Pair pair(positions[i], positions[j], particles.radii[i], particles.radii[j]);
            for (int column = 0; column < forces.cols(); column++) {
                const Vector force = factor * rows(forces, from, column);
                const Vector torque =
                    torque_j ? factor * rows(forces, from + 3, column) : Vector{0, 0, 0};
                Vector velocity = {0, 0, 0}, omega = {0, 0, 0};
                pair.addVelocities<1>(torque_i, torque_j, &force, &torque, &velocity, &omega);
                addTo(velocities, row, column, velocity);
                if (torque_i) addTo(velocities, row + 3, column, omega);
            }
        }
    }
}

/** Put a block into the matrix, and its transpose at the mirrored position. */
void place(Eigen::MatrixXd& m, int row, int column, const double (&block)[3][3]) {
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++) m(row + a, column + b) = m(column + b, row + a) = block[a][b];
}

template <bool torque_i, bool torque_j>
void placePair(Eigen::MatrixXd& m, int row, int column, const Pair& pair, double factor) {
    PairBlocks<double> blocks;
    fillPairBlocks<torque_i, torque_j>(pair.free, pair.r, factor, blocks);
    addWallBlocks<torque_i, torque_j>(pair.wall, factor, blocks);
    place(m, row, column, blocks.tt);
    if (torque_i) place(m, row + 3, column, blocks.rt);
    if (torque_j) place(m, row, column + 3, blocks.tr);
    if (torque_i && torque_j) place(m, row + 3, column + 3, blocks.rr);
}

void RotnePragerYamakawaWallAt::denseColumns(int firstParticle, Eigen::MatrixXd& mobility) {
    mobility.resize(particles.numRows, particles.numRows);
    const double scale = 1 / (8 * M_PI * viscosity);
    for (int j = 0; j < particles.size(); j++) {
        const int column = particles.firstRow[j];
        for (int i = std::max(j, firstParticle); i < particles.size(); i++) {
            const int row = particles.firstRow[i];
            const double factor = scale * (weights[i] * weights[j]);
            const Pair pair(positions[i], positions[j], particles.radii[i], particles.radii[j]);
            withFlags(
                [&](auto torque_i, auto torque_j) {
                    placePair<torque_i, torque_j>(mobility, row, column, pair, factor);
                },
                particles.hasTorque[i], particles.hasTorque[j]);
        }
    }
}

MobilityTraits traitsAbove(const NoSlipPlane& wall) {
    MobilityTraits traits("RotnePragerYamakawa");
    traits.mayObject = true;
    traits.holdsNearby = wall.reachesBeyond();
    return traits;
}

}  // namespace

RotnePragerYamakawaWall::RotnePragerYamakawaWall(const HydrodynamicParticles& particles,
                                                 double viscosity, const NoSlipPlane& wall)
    : MobilityModel(particles, viscosity, traitsAbove(wall)), wall(wall) {}

void addWallFlowAt(const HydrodynamicParticles& particles, const std::vector<Vec3>& positions,
                   const std::vector<double>& weights, double wallHeight,
                   const FlowSources& sources, const std::vector<Vec3>& points, double factor,
                   Velocities& velocities) {
    FlowSources weighted = sources;
    for (int j = 0; j < particles.size(); j++)
        weighted.forces.middleRows(particles.firstRow[j], particles.hasTorque[j] ? 6 : 3) *=
            weights[j];
    std::vector<Vec3> fromWall = points;
    for (Vec3& point : fromWall) point[2] -= wallHeight;
    addFreeFlowAt(particles, positions, weighted, fromWall, factor, velocities);
    for (int j = 0; j < particles.size(); j++) {
        const int from = particles.firstRow[j];
        const Vector force = factor * rows(weighted.forces, from, 0),
                     torque = particles.hasTorque[j] ? factor * rows(weighted.forces, from + 3, 0)
                                                     : Vector{0, 0, 0};
        for (size_t p = 0; p < points.size(); p++) {
            const Vec3 d = fromWall[p] - positions[j];
            const WallMobility<double> image = wallMobility(
                Vector{d[0], d[1], d[2]}, fromWall[p][2], positions[j][2], 0.0, particles.radii[j]);
            Vector velocity = {0, 0, 0}, unused = {0, 0, 0};
            addWallVelocities<1, false, true>(image, &force, &torque, &velocity, &unused);
            velocities.col(p) += Eigen::Vector3d(velocity.x, velocity.y, velocity.z);
        }
    }
}

std::unique_ptr<MobilityModel> RotnePragerYamakawaWall::forCollectiveModes(
    const HydrodynamicParticles& spheres) const {
    return std::make_unique<RotnePragerYamakawaWall>(spheres, viscosity,
                                                     NoSlipPlane(wall.getHeight(), true));
}

std::unique_ptr<MobilityAt> RotnePragerYamakawaWall::makePlace() const {
    return std::make_unique<RotnePragerYamakawaWallAt>(*this, wall);
}

}  // namespace RigidHIPlugin
