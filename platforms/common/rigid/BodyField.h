#ifndef RIGIDHI_BODY_FIELD_H_
#define RIGIDHI_BODY_FIELD_H_

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "mobility/MobilityModel.h"
#include "mobility/RandomField.h"

namespace RigidHIPlugin {

class BodyMobility;
class CoupledBodies;
class SlipSpace;

/**
 * The random field of the model as the noise of one group of bodies. BodyMobility::field() gives
 * this object.
 */
class BodyField {
public:
    explicit BodyField(BodyMobility& mobility);
    BodyField(const BodyField&) = delete;

    /**
     * Whether slips have to come from the field: the model has one, and slips belong to particles
     * or to parts.
     */
    bool givesSlips() const;
    /** Draw the field, for any number of poses, if it givesSlips(). */
    bool draw(const NoiseStream& noise, uint32_t purpose,
              std::unique_ptr<RandomField>& field) const;
    /** Whether divergenceOf() gives the divergence of such slips: the field is one flow. */
    bool knowsDivergence() const;
    /**
     * The divergence of BodyMobility::nearestTwists() of the field's slips with respect to the
     * bodies' coordinates, at the poses set last. Where the field's gradients are known, they give
     * the divergence. Otherwise six displacements of all bodies at once give it by differences,
     * since a body's twists depend on its own pose only. Fixed components take no part.
     */
    double divergenceOf(RandomField& field);

private:
    double divergenceByGradients(RandomField& field);
    double divergenceByDifferences(RandomField& field);

    BodyMobility& mobility;
    const CoupledBodies& bodies;
    const SlipSpace& slipSpace;
    Placement displaced;
    std::vector<Eigen::Matrix3d> displacedTurns;
    Eigen::MatrixXd slips, gradients, twists;
};

}  // namespace RigidHIPlugin

#endif
