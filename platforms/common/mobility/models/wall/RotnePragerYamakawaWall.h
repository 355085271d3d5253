#ifndef RIGIDHI_ROTNE_PRAGER_YAMAKAWA_WALL_H_
#define RIGIDHI_ROTNE_PRAGER_YAMAKAWA_WALL_H_

#include "mobility/models/wall/NoSlipPlane.h"

namespace RigidHIPlugin {

/**
 * Rotne-Prager-Yamakawa mobility above a no-slip plane z = height: the free mobility and its image
 * in the wall, pair by pair, in plain loops. Formulas, references and limits:
 * RotnePragerYamakawaWall-inl.h and RotnePragerYamakawa-inl.h.
 *
 * Particles may overlap each other. Two particles of one radius at the same place make the matrix
 * singular, not indefinite. With crossing, the same holds for two particles of one radius above
 * each other whose centres are both lower than this radius. Cost: two to three times that of
 * unbounded fluid, about twice for dense(). Nothing is allocated after the first call of each
 * method of a MobilityAt, if the number of columns stays the same.
 */
class RotnePragerYamakawaWall : public MobilityModel {
public:
    RotnePragerYamakawaWall(const HydrodynamicParticles& particles, double viscosity,
                            const NoSlipPlane& wall);
    bool acceptsNearby(const Placement& placement) const override {
        return wall.acceptsNearby(particles, placement.positions);
    }
    std::string objection(const Placement& placement) const override {
        return wall.objection(particles, placement.positions);
    }
    std::unique_ptr<MobilityModel> forCollectiveModes(
        const HydrodynamicParticles& spheres) const override;
    OpenMM::Vec3 placeInFormulas(int i, const OpenMM::Vec3& position) const override {
        return wall.placeInFormulas(position, particles.radii[i]);
    }

protected:
    std::unique_ptr<MobilityAt> makePlace() const override;

private:
    const NoSlipPlane wall;
};

/**
 * As addFreeFlowAt(), above the wall.
 *
 * @param positions  z from the wall, at least the radius
 * @param weights  factors that multiply the forces of particles
 */
void addWallFlowAt(const HydrodynamicParticles& particles,
                   const std::vector<OpenMM::Vec3>& positions, const std::vector<double>& weights,
                   double wallHeight, const FlowSources& sources,
                   const std::vector<OpenMM::Vec3>& points, double factor, Velocities& velocities);

}  // namespace RigidHIPlugin

#endif
