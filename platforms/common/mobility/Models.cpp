#include "mobility/Models.h"

#include <openmm/OpenMMException.h>

#include <string>

#include "mobility/models/ewald/RotnePragerYamakawaGrid.h"
#include "mobility/models/forcecoupling/ForceCouplingGrid.h"
#include "mobility/models/periodic/PeriodicMobility.h"
#include "mobility/models/periodic/PeriodicStokesianDynamics.h"
#include "mobility/models/rotneprager/RotnePragerYamakawa.h"
#include "mobility/models/stokesian/StokesianDynamics.h"
#include "mobility/models/wall/RotnePragerYamakawaWall.h"
#include "mobility/models/wall/SlipChannel.h"
#include "mobility/models/wall/SphereWall.h"
#include "openmmrigidhi/internal/ModelNames.h"

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

/**
 * A model above the wall, with the mobility of single spheres that setSphereWallMobility() asks
 * for.
 */
unique_ptr<MobilityModel> withSphereWallMobility(const MobilityForce& force,
                                                 const HydrodynamicParticles& particles,
                                                 unique_ptr<MobilityModel> model) {
    switch (force.getSphereWallMobility()) {
        case MobilityForce::FromModel: return model;
        case MobilityForce::BestKnown:
            return unique_ptr<MobilityModel>(
                new SphereWallCongruence(particles, force.getViscosity(),
                                         NoSlipPlane(force.getWallHeight(), false), move(model)));
    }
    refuse(force.getModel(), force.getBoundary());
}

shared_ptr<GridFluid> gridFluid(const PlatformModels& own) {
    return own.gridFluid ? own.gridFluid() : shared_ptr<GridFluid>(new PlainGridFluid());
}

/**
 * Up to this many rows Auto takes lattice sums and matrices. Measurements (benchmarks/README.md)
 * found that a step takes as long either way for fewer than 10 spheres or blobs, and for about 10
 * where roots of the whole matrix are wanted to 1e-6. The number here is larger, because matrices
 * are exact and take triclinic boxes.
 */
const int largestDenseSurfaceRows = 150;

unique_ptr<MobilityModel> periodicRotnePragerYamakawa(const MobilityForce& force,
                                                      const MobilityScene& scene,
                                                      const HydrodynamicParticles& particles,
                                                      const PlatformModels& own) {
    bool onGrid = false;
    switch (force.getSolver()) {
        case MobilityForce::Dense: break;
        case MobilityForce::MatrixFree: onGrid = true; break;
        case MobilityForce::Auto:
            onGrid = particles.numRows > largestDenseSurfaceRows && !scene.isTriclinic &&
                     (int)kindsOf(particles).size() <= RotnePragerYamakawaGrid::mostRadii;
            break;
    }
    if (!onGrid)
        return unique_ptr<MobilityModel>(
            new PeriodicRotnePragerYamakawa(particles, force.getViscosity()));
    return unique_ptr<MobilityModel>(
        new RotnePragerYamakawaGrid(particles, force.getViscosity(), force.getSolverTolerance(),
                                    force.getGridSpacing(), gridFluid(own)));
}

unique_ptr<MobilityModel> rotnePragerYamakawa(const MobilityForce& force,
                                              const MobilityScene& scene,
                                              const HydrodynamicParticles& particles,
                                              const PlatformModels& own) {
    const double eta = force.getViscosity();
    switch (force.getBoundary()) {
        case MobilityForce::Unbounded:
            if (own.rotnePragerYamakawa) return own.rotnePragerYamakawa(particles, eta, {});
            return unique_ptr<MobilityModel>(new RotnePragerYamakawa(particles, eta));
        case MobilityForce::NoSlipWall: {
            const NoSlipPlane wall(force.getWallHeight(), scene.crossingAllowed);
            return withSphereWallMobility(
                force, particles,
                own.rotnePragerYamakawa
                    ? own.rotnePragerYamakawa(particles, eta, wall)
                    : unique_ptr<MobilityModel>(new RotnePragerYamakawaWall(particles, eta, wall)));
        }
        case MobilityForce::Periodic:
            return periodicRotnePragerYamakawa(force, scene, particles, own);
        case MobilityForce::SlipChannel: break;
    }
    refuse(force.getModel(), force.getBoundary());
}

/**
 * Up to this many rows Auto takes lattice sums and matrices, and beyond it a grid. Measurements at
 * the default tolerance (benchmarks/README.md) found that a product takes as long either way for
 * fewer than 8, about 40 and about 1000 blobs at volume fractions of 0.1, 0.01 and 0.001. A step of
 * DriftCorrectorFD takes as long for fewer blobs. A step of EulerMaruyama, with a root or a field,
 * takes as long for about 75 blobs at 0.1, 220 at 0.01, and more in dilute suspensions. The model
 * does not know the box, so the number here is an intermediate one.
 */
const int largestDenseLatticeRows = 300;

unique_ptr<MobilityModel> periodicForceCoupling(const MobilityForce& force,
                                                const MobilityScene& scene,
                                                const HydrodynamicParticles& particles,
                                                bool inChannel, const PlatformModels& own) {
    bool onGrid = false;
    const int rows = (inChannel ? 2 : 1) * particles.numRows;
    switch (force.getSolver()) {
        case MobilityForce::Dense: break;
        case MobilityForce::MatrixFree: onGrid = true; break;
        case MobilityForce::Auto:
            onGrid = rows > largestDenseLatticeRows && !scene.isTriclinic;
            break;
    }
    if (!onGrid)
        return unique_ptr<MobilityModel>(new PeriodicForceCoupling(
            inChannel ? SlipChannel::withImages(particles) : particles, force.getViscosity()));
    return unique_ptr<MobilityModel>(
        new ForceCouplingGrid(particles, force.getViscosity(), force.getSolverTolerance(),
                              force.getGridSpacing(), gridFluid(own), inChannel));
}

unique_ptr<MobilityModel> forceCoupling(const MobilityForce& force, const MobilityScene& scene,
                                        const HydrodynamicParticles& particles,
                                        const PlatformModels& own) {
    if (force.getBoundary() != MobilityForce::SlipChannel)
        return periodicForceCoupling(force, scene, particles, false, own);
    SlipWalls walls;
    force.getChannelWalls(walls.low, walls.high);
    walls.crossingAllowed = scene.crossingAllowed;
    return unique_ptr<MobilityModel>(
        new SlipChannel(particles, force.getViscosity(), walls,
                        periodicForceCoupling(force, scene, particles, true, own)));
}

}  // namespace

// These switches have no default, so that the compiler names those that do not know a new model or
// boundary.
unique_ptr<MobilityModel> createMobility(const MobilityForce& force, const MobilityScene& scene,
                                         const HydrodynamicParticles& particles,
                                         const PlatformModels& own) {
    checkOperator(force.getModel(), force.getBoundary());
    switch (force.getModel()) {
        case MobilityForce::StokesianDynamics:
            if (force.getBoundary() == MobilityForce::Periodic)
                return unique_ptr<MobilityModel>(
                    new PeriodicStokesianDynamics(particles, force.getViscosity(),
                                                  force.getLubrication(), force.getMinimumGap()));
            return unique_ptr<MobilityModel>(new StokesianDynamics(
                particles, force.getViscosity(), force.getLubrication(), force.getMinimumGap()));
        case MobilityForce::ForceCoupling: return forceCoupling(force, scene, particles, own);
        // Particles that do not feel others still feel themselves: the blobs of one body make its
        // tensor.
        case MobilityForce::FreeDraining:
        case MobilityForce::RotnePragerYamakawa:
            return rotnePragerYamakawa(force, scene, particles, own);
    }
    refuse(force.getModel(), force.getBoundary());
}

void checkOperator(MobilityForce::Model model, MobilityForce::Boundary boundary) {
    if (!hasBoundary(model, boundary)) refuse(model, boundary);
}

const char* modelName(MobilityForce::Model model) { return nameIn(modelNames, model); }

const char* boundaryName(MobilityForce::Boundary boundary) {
    return nameIn(boundaryNames, boundary);
}

bool hasBoundary(MobilityForce::Model model, MobilityForce::Boundary boundary) {
    switch (boundary) {
        case MobilityForce::Unbounded:
            return *modelName(model) != 0 && model != MobilityForce::ForceCoupling;
        case MobilityForce::NoSlipWall: return model == MobilityForce::RotnePragerYamakawa;
        case MobilityForce::Periodic:
            return model == MobilityForce::RotnePragerYamakawa ||
                   model == MobilityForce::StokesianDynamics ||
                   model == MobilityForce::ForceCoupling;
        case MobilityForce::SlipChannel: return model == MobilityForce::ForceCoupling;
    }
    return false;
}

}  // namespace RigidHIPlugin
