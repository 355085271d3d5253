#ifndef RIGIDHI_BODY_DEFINITIONS_H_
#define RIGIDHI_BODY_DEFINITIONS_H_

#include <openmm/System.h>

#include <memory>
#include <vector>

#include "openmmrigidhi/CustomRigidHIIntegrator.h"
#include "rigidbody/BodyGeometry.h"
#include "rigidbody/BodySet.h"
#include "rigidbody/PoseFit.h"

namespace RigidHIPlugin {

/**
 * The bodies as they were when the Context was created, and their geometries: the one owner of
 * both.
 *
 * What users add or redefine later takes effect in the next Context. A geometry that becomes known
 * is recorded in the integrator too.
 */
class BodyDefinitions {
public:
    BodyDefinitions(const CustomRigidHIIntegrator& integrator, const OpenMM::System& system);
    /** The bodies under the integrator's present scheme, for checks: an integrator that is bound to
     * nothing. */
    const CustomRigidHIIntegrator& underPresentScheme();

    int getNumBodies() const { return definitions->getNumRigidBodies(); }
    const std::vector<int>& particles(int body) const {
        return definitions->getRigidBodyParticles(body);
    }
    std::vector<std::vector<int> > particlesOfBodies() const;
    bool isExplicit(int body) const { return definitions->getRigidBodyIsExplicit(body); }
    bool isKnown(int body) const { return definitions->getRigidBodyGeometryIsKnown(body); }
    bool areAllKnown() const;
    /** Of bodies whose geometry is not known, anything. */
    const std::vector<BodyGeometry>& geometries() const { return geometries_; }
    const PoseFit& fit(int body) const { return fits[body]; }

    /** Find all geometries for which no positions are needed. Particle indices must have been
     * checked. */
    void takeFromSystem();
    /** All geometries; those that are not known come from positions. */
    std::vector<BodyGeometry> fromPositions(const std::vector<OpenMM::Vec3>& positions) const;
    /** BodyGeometryBuilder::update(): the System wins over what is known of a body. */
    BodyGeometry updateBySystem(int body, const BodyGeometry& known) const;
    /** A geometry is known from now on. */
    void record(int body, const BodyGeometry& geometry);
    /** Geometries of implicit bodies are not known any more. */
    void reset() { definitions->resetBodyGeometry(); }

    /** What stands on geometries; states are at the origin. @throws OpenMMException for sites that
     * are not where they must be */
    struct Bodies {
        std::vector<BodyGeometry> geometries;
        std::vector<PoseFit> fits;
        BodySet set;
    };
    Bodies build(const std::vector<BodyGeometry>& geometries) const;
    /** The present geometries and fits are exchanged for others. */
    void exchange(Bodies& others);

private:
    BodyGeometryBuilder builder(int body) const;
    void checkVirtualSites(int body, const BodyGeometry& geometry) const;
    const CustomRigidHIIntegrator& integrator;
    const OpenMM::System& system;
    std::unique_ptr<CustomRigidHIIntegrator> definitions;
    std::unique_ptr<ConstraintsOfParticles> constraints;
    std::vector<BodyGeometry> geometries_;
    std::vector<PoseFit> fits;
};

}  // namespace RigidHIPlugin

#endif
