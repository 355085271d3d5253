#ifndef RIGIDHI_MODELS_H_
#define RIGIDHI_MODELS_H_

#include <functional>
#include <memory>
#include <optional>

#include "mobility/models/forcecoupling/GridFluid.h"
#include "mobility/models/wall/NoSlipPlane.h"
#include "openmmrigidhi/ModelTraits.h"

namespace RigidHIPlugin {

/**
 * The models that a platform makes itself because it has something faster. Where it gives nothing,
 * the readable models of one thread serve.
 */
struct PlatformModels {
    /** RotnePragerYamakawa, above the wall if there is one. */
    std::function<std::unique_ptr<MobilityModel>(const HydrodynamicParticles& particles,
                                                 double viscosity,
                                                 const std::optional<NoSlipPlane>& wall)>
        rotnePragerYamakawa;
    /** The fluid on a grid. Models of several groups may share it. */
    std::function<std::shared_ptr<GridFluid>()> gridFluid;
};
/** What a model must know of the scene besides its MobilityForce. */
struct MobilityScene {
    bool crossingAllowed = false;  // whether surfaces of particles may reach through a wall
    bool onGrid = false;           // where there is a choice: no matrices (GridChoice)
};
/**
 * The model of a MobilityForce, with its boundary, on every platform. A new model is entered here.
 *
 * @throws OpenMMException as checkOperator(), and for what the model refuses
 */
std::unique_ptr<MobilityModel> createMobility(const MobilityForce& force,
                                              const MobilityScene& scene,
                                              const HydrodynamicParticles& particles,
                                              const PlatformModels& own = {});
/**
 * @throws OpenMMException for a model or boundary that is none of the enumerators, and for a
 *     boundary that the model does not have
 */
void checkOperator(MobilityForce::Model model, MobilityForce::Boundary boundary);
/** The names of a model and of a boundary, for describeEffects() and messages; empty for values
 * that are no enumerators. */
const char* modelName(MobilityForce::Model model);
const char* boundaryName(MobilityForce::Boundary boundary);
/**
 * The coordinates of the walls of a fluid on the axis that crosses them (BoundaryTraits::wallAxis),
 * nm; infinite where there is no wall.
 */
void findWalls(const MobilityForce& force, double& low, double& high);
/**
 * Whether a boundary is a periodic fluid along no-slip walls, whose flows are 0 there. These walls
 * are across z, and those that slip are across y.
 */
inline bool isConfined(MobilityForce::Boundary boundary) {
    return traitsOf(boundary).isPeriodic && traitsOf(boundary).isAcross(2);
}
/** Whether a model has a boundary; false for values that are no enumerators. */
bool hasBoundary(MobilityForce::Model model, MobilityForce::Boundary boundary);

}  // namespace RigidHIPlugin

#endif
