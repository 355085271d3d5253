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
 * The bodies and joints as they were when the Context was created, and the bodies' geometries. This
 * class is the only owner of all.
 *
 * Bodies and joints that users add or redefine later take effect in the next Context. A geometry
 * that becomes known is recorded in the integrator too.
 */
class BodyDefinitions {
public:
    BodyDefinitions(const CustomRigidHIIntegrator& integrator, const OpenMM::System& system);
    /**
     * The bodies under the integrator's present scheme, with the bodies and particles that it holds
     * at present, for checks: an integrator that is bound to no Context.
     */
    const CustomRigidHIIntegrator& underPresentScheme();

    int getNumBodies() const { return definitions->getNumRigidBodies(); }
    const std::vector<int>& particles(int body) const {
        return definitions->getRigidBodyParticles(body);
    }
    std::vector<std::vector<int>> particlesOfBodies() const;
    /** The joints as they were when the Context was created, in the users' body frames. */
    const std::vector<JointDefinition>& joints() const { return definitions->getJoints(); }
    /** Their motors of that time, with the rates that the integrator has now. */
    std::vector<HingeMotorDefinition> motors() const;
    bool isExplicit(int body) const { return definitions->getRigidBodyIsExplicit(body); }
    bool isKnown(int body) const { return definitions->getRigidBodyGeometryIsKnown(body); }
    bool areAllKnown() const;
    /** The entries of bodies whose geometry is not known are undefined. */
    const std::vector<BodyGeometry>& geometries() const { return geometries_; }
    const PoseFit& fit(int body) const { return fits[body]; }
    /**
     * How far the sites of two definitions of a body may be apart, nm: half of the pose tolerance,
     * which allows for a rounding of positions and for as large an error of the pose.
     */
    double siteTolerance() const { return integrator.getPoseTolerance() / 2; }
    /** As BodyGeometryBuilder says of a body. */
    bool isFixedByConstraints(int body) const { return builder(body).isFixedByConstraints(); }
    bool hasRedundantConstraints(int body) const { return builder(body).hasRedundantConstraints(); }

    /** Find all geometries for which no positions are needed. Particle indices must have been
     * checked. */
    void takeFromSystem();
    /** All geometries. Those that are not known come from positions. */
    std::vector<BodyGeometry> fromPositions(const std::vector<OpenMM::Vec3>& positions) const;
    /**
     * BodyGeometryBuilder::update(): the System takes precedence over the known geometry of a body.
     */
    BodyGeometry updateBySystem(int body, const BodyGeometry& known) const;
    /** Record that a geometry is known. */
    void record(int body, const BodyGeometry& geometry);
    /** Forget the geometries of implicit bodies. */
    void reset() { definitions->resetBodyGeometry(); }

    /**
     * Objects that are made from geometries; states are at the origin. The bodies that the
     * integrator holds at present are held. @throws OpenMMException for
     * sites that are not where they must be
     */
    struct Bodies {
        std::vector<BodyGeometry> geometries;
        std::vector<PoseFit> fits;
        BodySet set;
    };
    /** @param withoutMomenta  of each body: BodySet's `held` */
    Bodies build(const std::vector<BodyGeometry>& geometries,
                 const std::vector<bool>& withoutMomenta) const;
    /** Exchange the present geometries and fits for others. */
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
