#include "mobility/Models.h"

#include <openmm/OpenMMException.h>

#include <limits>
#include <string>

#include "mobility/models/confined/ConfinedForceCoupling.h"
#include "mobility/models/confined/ConfinedRotnePragerYamakawa.h"
#include "mobility/models/confined/ConfinedRotnePragerYamakawaGrid.h"
#include "mobility/models/ewald/RotnePragerYamakawaGrid.h"
#include "mobility/models/ewald/StokesianDynamicsGrid.h"
#include "mobility/models/forcecoupling/ForceCouplingGrid.h"
#include "mobility/models/lubricated/LubricatedMobility.h"
#include "mobility/models/periodic/PeriodicMobility.h"
#include "mobility/models/periodic/PeriodicStokesianDynamics.h"
#include "mobility/models/rotneprager/RotnePragerYamakawa.h"
#include "mobility/models/stokesian/StokesianDynamics.h"
#include "mobility/models/wall/RotnePragerYamakawaWall.h"
#include "mobility/models/wall/SlipChannel.h"
#include "mobility/models/wall/SphereWall.h"

using namespace std;

namespace RigidHIPlugin {

namespace {

[[noreturn]] void refuse(MobilityForce::Model model, MobilityForce::Boundary boundary) {
    const auto text = [](const char* name, int value) {
        return *name ? string(name) : to_string(value);
    };
    throw OpenMM::OpenMMException("MobilityForce: model " + text(modelName(model), model) +
                                  " cannot be used with boundary " +
                                  text(boundaryName(boundary), boundary) +
                                  "; choose a model that has this boundary by setModel(), or a "
                                  "boundary that this model has by setBoundary()");
}

/** A model above the wall, with the single-sphere mobility that setSphereWallMobility() sets. */
unique_ptr<MobilityModel> withSphereWallMobility(const MobilityForce& force,
                                                 const HydrodynamicParticles& particles,
                                                 unique_ptr<MobilityModel> model) {
    switch (force.getSphereWallMobility()) {
        case MobilityForce::FromModel: return model;
        case MobilityForce::BestKnown:
            return make_unique<SphereWallCongruence>(
                particles, force.getViscosity(), NoSlipPlane(force.getWallHeight(), false),
                boundaryName(force.getBoundary()), move(model));
    }
    refuse(force.getModel(), force.getBoundary());
}

/**
 * The reach in mean radii where the user has set none. It gives few pairs, so that iterations and
 * matrices can use the same reach.
 */
const LubricationReach reachByDefault = {3, 4};

/** The user's reach; that of the model where the user has set none. */
LubricationReach reachOf(const MobilityForce& force, const LubricationReach& ofModel) {
    LubricationReach reach;
    force.getLubricationReach(reach.whole, reach.nothing);
    return reach.nothing > 0 ? reach : ofModel;
}

/** The walls of a boundary and its periods, as lubrication takes them. */
void setWalls(const MobilityForce& force, LubricationScene& scene) {
    const BoundaryTraits& boundary = traitsOf(force.getBoundary());
    double low, high;
    findWalls(force, low, high);
    const auto place = [&](WallKind kind, double at, double& atRest) {
        switch (kind) {
            case WallKind::NoWall: return;
            case WallKind::NoSlip: atRest = at; return;
            case WallKind::Slip:
                scene.mirrorAxis = boundary.wallAxis;
                scene.mirror = at;
                return;
        }
    };
    place(boundary.highWall, high, scene.high);
    place(boundary.lowWall, low, scene.low);  // of two mirrors the lower one
    scene.numPeriods = !boundary.isPeriodic ? 0 : boundary.hasWalls() ? 2 : 3;
    if (boundary.lowWall != WallKind::Slip || boundary.highWall != WallKind::Slip) return;
    scene.numPeriods = 3;
    scene.mirrorPeriod = 2 * (high - low);
}

constexpr bool lubricationHasAllWalls() {
    for (const BoundaryTraits& boundary : boundaryTable) {
        const bool isAtRest =
            boundary.lowWall == WallKind::NoSlip || boundary.highWall == WallKind::NoSlip;
        if (boundary.hasWalls() && boundary.wallAxis != 2 &&
            (isAtRest || (boundary.isPeriodic && boundary.numWalls == 1)))
            return false;
    }
    return true;
}
static_assert(lubricationHasAllWalls(),
              "Lubrication has walls at rest across z only, and periods along the first two box "
              "vectors or along all of them.");

/** Add lubrication to a model where the user wants it and any spheres can have it. */
unique_ptr<MobilityModel> withLubrication(const MobilityForce& force,
                                          const HydrodynamicParticles& particles,
                                          unique_ptr<MobilityModel> model) {
    if (!hasLubrication(force)) return model;
    LubricationScene scene;
    scene.reach = reachOf(force, reachByDefault);
    scene.minimumGap = force.getMinimumGap();
    setWalls(force, scene);
    const bool gaussian = force.getModel() == MobilityForce::ForceCoupling;
    if (gaussian && traitsOf(force.getBoundary()).isAcross(2))
        scene.behind = ConfinedForceCoupling::behindWalls(particles, force.getBoundary());
    if (!Lubrication::isAny(particles, scene)) return model;
    return make_unique<LubricatedMobility>(particles, force.getViscosity(),
                                           gaussian ? overGaussians() : overSurfaces(), scene,
                                           move(model));
}

shared_ptr<GridFluid> gridFluid(const PlatformModels& own) {
    return own.gridFluid ? own.gridFluid() : make_shared<PlainGridFluid>();
}

unique_ptr<MobilityModel> periodicRotnePragerYamakawa(const MobilityForce& force,
                                                      const MobilityScene& scene,
                                                      const HydrodynamicParticles& particles,
                                                      const PlatformModels& own) {
    if (!scene.onGrid)
        return make_unique<PeriodicRotnePragerYamakawa>(particles, force.getViscosity());
    return make_unique<RotnePragerYamakawaGrid>(particles, force.getViscosity(),
                                                force.getSolverTolerance(), force.getGridSpacing(),
                                                gridFluid(own));
}

unique_ptr<MobilityModel> periodicStokesianDynamics(const MobilityForce& force,
                                                    const MobilityScene& scene,
                                                    const HydrodynamicParticles& particles,
                                                    const PlatformModels& own) {
    if (!scene.onGrid)
        return make_unique<PeriodicStokesianDynamics>(
            particles, force.getViscosity(), hasLubrication(force), force.getMinimumGap(),
            reachOf(force, PeriodicStokesianDynamics::reachByDefault));
    return make_unique<StokesianDynamicsGrid>(
        particles, force.getViscosity(), hasLubrication(force), force.getSolverTolerance(),
        force.getGridSpacing(), reachOf(force, StokesianDynamicsGrid::reachByDefault),
        gridFluid(own));
}

unique_ptr<MobilityModel> unboundedRotnePragerYamakawa(const MobilityForce& force,
                                                       const HydrodynamicParticles& particles,
                                                       const PlatformModels& own) {
    const double eta = force.getViscosity();
    if (own.rotnePragerYamakawa) return own.rotnePragerYamakawa(particles, eta, {});
    return make_unique<RotnePragerYamakawa>(particles, eta);
}

unique_ptr<MobilityModel> confinedRotnePragerYamakawa(const MobilityForce& force,
                                                      const MobilityScene& scene,
                                                      const HydrodynamicParticles& particles,
                                                      const PlatformModels& own) {
    const ConfiningPlanes planes(force, scene.crossingAllowed);
    if (!scene.onGrid)
        return make_unique<ConfinedRotnePragerYamakawa>(particles, force.getViscosity(), planes);
    return make_unique<ConfinedRotnePragerYamakawaGrid>(
        particles, force.getViscosity(), force.getSolverTolerance(), force.getGridSpacing(), planes,
        gridFluid(own));
}

unique_ptr<MobilityModel> rotnePragerYamakawa(const MobilityForce& force,
                                              const MobilityScene& scene,
                                              const HydrodynamicParticles& particles,
                                              const PlatformModels& own) {
    const double eta = force.getViscosity();
    switch (force.getBoundary()) {
        case MobilityForce::Unbounded: return unboundedRotnePragerYamakawa(force, particles, own);
        case MobilityForce::NoSlipWall: {
            const NoSlipPlane wall(force.getWallHeight(), scene.crossingAllowed);
            return withSphereWallMobility(
                force, particles,
                own.rotnePragerYamakawa
                    ? own.rotnePragerYamakawa(particles, eta, wall)
                    : unique_ptr<MobilityModel>(
                          make_unique<RotnePragerYamakawaWall>(particles, eta, wall)));
        }
        case MobilityForce::Periodic:
            return periodicRotnePragerYamakawa(force, scene, particles, own);
        case MobilityForce::PeriodicWall:
            return withSphereWallMobility(
                force, particles, confinedRotnePragerYamakawa(force, scene, particles, own));
        case MobilityForce::NoSlipChannel:
            return confinedRotnePragerYamakawa(force, scene, particles, own);
        case MobilityForce::Film: break;
        case MobilityForce::SlipChannel: break;
    }
    refuse(force.getModel(), force.getBoundary());
}

unique_ptr<MobilityModel> periodicForceCoupling(const MobilityForce& force,
                                                const MobilityScene& scene,
                                                const HydrodynamicParticles& particles,
                                                bool inChannel, const PlatformModels& own) {
    if (!scene.onGrid)
        return make_unique<PeriodicForceCoupling>(
            inChannel ? SlipChannel::withImages(particles) : particles, force.getViscosity());
    return make_unique<ForceCouplingGrid>(particles, force.getViscosity(),
                                          force.getSolverTolerance(), force.getGridSpacing(),
                                          gridFluid(own), inChannel);
}

unique_ptr<MobilityModel> forceCoupling(const MobilityForce& force, const MobilityScene& scene,
                                        const HydrodynamicParticles& particles,
                                        const PlatformModels& own) {
    const BoundaryTraits& boundary = traitsOf(force.getBoundary());
    if (boundary.isAcross(2))
        return make_unique<ConfinedForceCoupling>(
            particles, force.getViscosity(), ConfiningPlanes(force, scene.crossingAllowed),
            force.getSolverTolerance(), force.getGridSpacing(), gridFluid(own), scene.onGrid);
    if (!boundary.hasWalls()) return periodicForceCoupling(force, scene, particles, false, own);
    SlipWalls walls;
    force.getChannelWalls(walls.low, walls.high);
    walls.crossingAllowed = scene.crossingAllowed;
    return make_unique<SlipChannel>(particles, force.getViscosity(), walls,
                                    periodicForceCoupling(force, scene, particles, true, own));
}

}  // namespace

// These switches have no default, so that the compiler points to every switch that lacks a new
// model or boundary.
unique_ptr<MobilityModel> createMobility(const MobilityForce& force, const MobilityScene& scene,
                                         const HydrodynamicParticles& particles,
                                         const PlatformModels& own) {
    checkOperator(force.getModel(), force.getBoundary());
    switch (force.getModel()) {
        case MobilityForce::StokesianDynamics:
            if (force.getBoundary() == MobilityForce::Periodic)
                return periodicStokesianDynamics(force, scene, particles, own);
            return make_unique<StokesianDynamics>(particles, force.getViscosity(),
                                                  hasLubrication(force), force.getMinimumGap(),
                                                  reachOf(force, StokesianDynamics::everywhere));
        case MobilityForce::ForceCoupling:
            return withLubrication(force, particles, forceCoupling(force, scene, particles, own));
        // Particles do not feel other bodies or images, but the blobs of one body still interact
        // and make its tensor.
        case MobilityForce::FreeDraining:
            return unboundedRotnePragerYamakawa(force, particles, own);
        case MobilityForce::RotnePragerYamakawa:
            return withLubrication(force, particles,
                                   rotnePragerYamakawa(force, scene, particles, own));
    }
    refuse(force.getModel(), force.getBoundary());
}

void checkOperator(MobilityForce::Model model, MobilityForce::Boundary boundary) {
    if (!hasBoundary(model, boundary)) refuse(model, boundary);
}

const char* modelName(MobilityForce::Model model) { return nameIn(modelTable, model); }

const char* boundaryName(MobilityForce::Boundary boundary) {
    return nameIn(boundaryTable, boundary);
}

void findWalls(const MobilityForce& force, double& low, double& high) {
    low = -numeric_limits<double>::infinity();
    high = numeric_limits<double>::infinity();
    const int numWalls = traitsOf(force.getBoundary()).numWalls;
    if (numWalls == 1) low = force.getWallHeight();
    if (numWalls == 2) force.getChannelWalls(low, high);
}

bool hasBoundary(MobilityForce::Model model, MobilityForce::Boundary boundary) {
    return hasRow(modelTable, model) && hasRow(boundaryTable, boundary) &&
           traitsOf(model).hasBoundary(boundary);
}

}  // namespace RigidHIPlugin
