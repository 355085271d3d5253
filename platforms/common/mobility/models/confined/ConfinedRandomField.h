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
 * The random field of ConfinedRotnePragerYamakawaGrid, of two independent flows whose covariances
 * are both positive (GridWallFields): waves with planes, which are drawn as a whole, and pairs
 * given that their flow is 0 on the planes. The latter is known at the particles alone: it is the
 * symmetric root of N', by Lanczos' method, times random numbers that are the same at all
 * placements.
 *
 * Where the highest particle of a fluid above a wall says how high the grid is, the field is drawn
 * where it is asked for first. If a placement is above the grid that the field was drawn on, the
 * field is drawn on a higher one.
 */
class ConfinedRandomField : public RandomField {
public:
    explicit ConfinedRandomField(const ConfinedRotnePragerYamakawaGrid& model);
    ~ConfinedRandomField() override;
    void draw(const NoiseStream& noise, uint32_t purpose, const BoxVectors& box);
    void slipsAt(const Placement& placement, bool nearby, Eigen::MatrixXd& slips) override;
    /**
     * Add the mean of the flow at given slips, which is the flow of the forces that cause these
     * slips.
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
    void drawFor(double top);
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
