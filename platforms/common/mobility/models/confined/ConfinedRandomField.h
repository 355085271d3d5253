#ifndef RIGIDHI_CONFINED_RANDOM_FIELD_H_
#define RIGIDHI_CONFINED_RANDOM_FIELD_H_

#include <memory>
#include <vector>

#include "linearalgebra/Lanczos.h"
#include "mobility/RandomField.h"
#include "mobility/models/confined/ConfinedRotnePragerYamakawaGrid.h"
#include "mobility/models/confined/NearPlanes.h"
#include "mobility/models/confined/UniformField.h"
#include "mobility/models/ewald/SplitParts.h"

namespace RigidHIPlugin {

/**
 * The random field of ConfinedRotnePragerYamakawaGrid: two independent flows, both with a positive
 * covariance (GridWallFields). One is the flow of waves with planes, drawn as a whole. The other is
 * the flow of pairs, conditional on its being 0 on the planes. It is known at the particles only:
 * the symmetric root of N', by Lanczos' method, times random numbers that are the same at all
 * placements.
 *
 * Above a wall the highest particle determines the height of the grid, so the field is drawn at its
 * first use. If a placement is above the grid of the field, the field is drawn again on a higher
 * grid.
 */
class ConfinedRandomField : public RandomField {
public:
    explicit ConfinedRandomField(const ConfinedRotnePragerYamakawaGrid& model);
    ~ConfinedRandomField() override;
    void draw(const NoiseStream& noise, uint32_t purpose, const BoxVectors& box);
    void slipsAt(const Placement& placement, bool nearby, Eigen::MatrixXd& slips) override;
    /**
     * Add the mean of the flow conditional on the slips, which is the flow of the forces that cause
     * these slips.
     */
    void addFlowAt(const std::vector<OpenMM::Vec3>& points, double factor,
                   Velocities& velocities) override;
    double amplitudeOf(const DrivenFlow& wave) override;
    Eigen::Vector3d meanFlow(double low, double high) override;
    long long getNumRandomNumbers() const override;

    /** The matrix N' of pairs at a placement times forces, for tests. */
    void multiplyPairs(const Placement& placement, const Eigen::MatrixXd& forces,
                       Eigen::MatrixXd& velocities);
    /** Iterations of the last slips. */
    int getNumIterations() const { return lanczos.getNumIterations(); }

private:
    void drawFor(double top, double nearest);
    void moveTo(const Placement& placement, bool nearby);
    void applyPairs(const Eigen::MatrixXd& forces, Eigen::MatrixXd& velocities);
    void findForces();
    double powerOn(const DrivenFlow& flow) const;

    const ConfinedRotnePragerYamakawaGrid& model;
    const HydrodynamicParticles& particles;
    Lanczos lanczos;
    Eigen::VectorXd ownScale;
    BoxVectors box = {};
    NoiseStream noise, ofDraw;
    uint32_t purpose = 0;
    bool isDrawn = false, isThere = false, wasNearby = false, hasForces = false;
    ConfinedRotnePragerYamakawaGrid::Base base, baseOfPlanes;
    std::shared_ptr<SplitParts> parts;
    std::unique_ptr<NearPlanes> planes;
    std::unique_ptr<UniformField> uniform;
    std::vector<GridField> fields;
    Placement at, inBase;
    ConfinedRotnePragerYamakawaGrid::Lifted lifted;
    Eigen::MatrixXd W, velocities, scaled, forcesOfSlips;
};

}  // namespace RigidHIPlugin

#endif
