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
 * Faster models of a platform. Where a platform sets none, the readable single-threaded models
 * serve.
 */
struct PlatformModels {
    /** RotnePragerYamakawa, in unbounded fluid or above a wall. */
    std::function<std::unique_ptr<MobilityModel>(const HydrodynamicParticles& particles,
                                                 double viscosity,
                                                 const std::optional<NoSlipPlane>& wall)>
        rotnePragerYamakawa;
    /** The fluid on a grid. Models of several groups may share it. */
    std::function<std::shared_ptr<GridFluid>()> gridFluid;
};
/** The properties of the scene that a model needs in addition to its MobilityForce. */
struct MobilityScene {
    bool crossingAllowed = false;  // whether surfaces of particles may reach through a wall
    bool onGrid = false;           // a grid instead of matrices (GridChoice), where the model has
                                   // both
};
/**
 * The model of a MobilityForce, with its boundary, on every platform. New models need a case here.
 *
 * @throws OpenMMException as checkOperator(), and for settings that the model refuses
 */
std::unique_ptr<MobilityModel> createMobility(const MobilityForce& force,
                                              const MobilityScene& scene,
                                              const HydrodynamicParticles& particles,
                                              const PlatformModels& own = {});
/**
 * @throws OpenMMException if the model or boundary is not an enumerator, or if the model does not
 *     support the boundary
 */
void checkOperator(MobilityForce::Model model, MobilityForce::Boundary boundary);
/**
 * The names of a model and of a boundary, for describeEffects() and messages; empty for values that
 * are not enumerators.
 */
const char* modelName(MobilityForce::Model model);
const char* boundaryName(MobilityForce::Boundary boundary);
/**
 * The coordinates of the walls of a fluid along their normal (BoundaryTraits::wallAxis), nm;
 * infinite without a wall.
 */
void findWalls(const MobilityForce& force, double& low, double& high);
/**
 * Whether a boundary is a periodic fluid along no-slip walls. No-slip walls are normal to z, and
 * slip walls are normal to y.
 */
inline bool isConfined(MobilityForce::Boundary boundary) {
    return traitsOf(boundary).isPeriodic && traitsOf(boundary).isAcross(2);
}
/** Whether a model supports a boundary; false for values that are not enumerators. */
bool hasBoundary(MobilityForce::Model model, MobilityForce::Boundary boundary);

}  // namespace RigidHIPlugin

#endif
