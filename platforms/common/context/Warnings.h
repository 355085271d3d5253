#ifndef RIGIDHI_WARNINGS_H_
#define RIGIDHI_WARNINGS_H_

#include <map>
#include <set>
#include <string>

namespace RigidHIPlugin {

class Scene;

/**
 * The causes of warnings about the settings. A user is warned of each cause once, though its
 * numbers may change from step to step.
 */
enum class WarningCause {
    OmittedDrift,
    UnresolvedRotation,
    LargeFriction,
    DriftFactorSpread,
    LongDisplacement,
    LongTurn,
    StiffForces,
    LongDrive,
    ShortStep,
    StrainOfFlow,
    SpinUnderLangevinA,
    DrivenSpin,
    FastRelaxation,
    ManyRejections,
    BodiesWithoutContext,
    JointsWithoutContext,
    FluidWithoutUpdate,
    UnboundedFluid,
    ForcesWithoutImages,
    ForcesBetweenGroups,
    WallWithPeriodicForces,
    BoxOfTheDefault,
    WatersWithoutBodies,
    ImagesAcross,
    BarostatTemperature,
    LubricationWithoutEffect,
    SettingWithoutEffect,
    CoincidentParticles,
    OverfullBox,
    SpheresInFlowAtWall,
    MatricesByColumns,
    WrongTemperature,
    BodiesAcrossTheBox,
    ForcesWithinBodies,
    LooseParticles,
    InertiaAgainstMasses,
    ParametersWithoutAvogadro,
    BodyForceWithoutBodies,
    ForceOnFluidInside
};
using Warnings = std::map<WarningCause, std::string>;
/** The spread of drift factors above which they are no longer a small correction. */
constexpr double driftFactorLimit = 0.3;
Warnings findWarnings(const Scene& scene);
/** Also those that take as long to find as several steps. */
Warnings findAllWarnings(const Scene& scene);
/**
 * Whether the steps so far give a reason for a warning that is not among the printed ones. This is
 * cheap, because steps call it.
 */
bool stepsHaveWarnings(const Scene& scene, const std::set<WarningCause>& printed);

}  // namespace RigidHIPlugin

#endif
