#ifndef RIGIDHI_GROUP_BUILDER_H_
#define RIGIDHI_GROUP_BUILDER_H_

#include <openmm/System.h>

#include <map>
#include <memory>
#include <vector>

#include "fluid/FluidGroup.h"
#include "fluid/FluidSettings.h"
#include "fluid/UserFlow.h"
#include "openmmrigidhi/MobilityForce.h"

namespace RigidHIPlugin {

struct GridChoice;

/**
 * Makes groups from a MobilityForce, bodies and free particles, and refuses wrong input. It also
 * chooses each group's strategies: constant where the tensor is constant, else dense or
 * matrix-free. The choice depends only on the number of rows, and with a grid on GridChoice, so
 * that a resumed run chooses the same.
 */
class GroupBuilder {
public:
    /**
     * @throws OpenMMException for radii that are not one per particle, for a body without
     *     hydrodynamic particles, and for tensors and groups that do not match the number of bodies
     */
    GroupBuilder(const MobilityForce& force, const FluidSettings& settings,
                 const OpenMM::System& system,
                 const std::vector<std::vector<int>>& particlesOfBodies,
                 const FreeParticles& freeParticles, PlatformLoops& loops);
    /**
     * Check what the model refuses, as far as this does not depend on the shapes of bodies. @throws
     * OpenMMException
     */
    void checkModels() const;
    /**
     * @throws OpenMMException  as checkModels(), and for errors that depend on the shapes of bodies
     */
    std::vector<std::unique_ptr<FluidGroup>> build(const std::vector<BodyGeometry>& geometries,
                                                   const BodySet& bodies) const;

private:
    void checkSlips() const;
    void checkForcesOnFluid() const;
    void checkLubrication() const;
    void checkIterations() const;
    std::pair<int, ForceOnFluid> forceOnFluid(int index) const;
    void addShape(FluidElement& element, const std::vector<BodyGeometry>& geometries,
                  const BodySet& bodies) const;
    std::unique_ptr<FluidGroup> makeGroup(const std::vector<FluidElement>& elements,
                                          const BodySet& bodies) const;
    bool makesMatrices(const FluidGroup& group) const;
    void makeJoints(FluidGroup& group, const BodySet& bodies) const;
    void chooseStrategies(FluidGroup& group, const BodySet& bodies) const;
    /** The model for these particles, and how Auto chose between matrices and a grid. */
    std::unique_ptr<MobilityModel> makeModel(const HydrodynamicParticles& particles,
                                             bool mayUseThreads, GridChoice& choice) const;

    const MobilityForce& force;
    const FluidSettings settings;
    const std::vector<std::vector<int>>& particlesOfBodies;
    const FreeParticles& freeParticles;
    PlatformLoops& loops;
    const UserFlow flow;
    BoxVectors defaultBox;  // of the System
    std::map<int, std::vector<FluidElement>>
        elementsOfGroups;  // by label; elements lack sites, own tensors, slips and forces on the
                           // fluid
    std::vector<int> indexOfFree;  // of particles in FreeParticles
    const std::shared_ptr<BodiesAlone::Shapes> shapes =
        std::make_shared<BodiesAlone::Shapes>();  // shared by all groups
};

}  // namespace RigidHIPlugin

#endif
