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
 * The bodies and joints as they were at Context creation, and the bodies' geometries. This class is
 * their only owner.
 *
 * Bodies and joints that users add or redefine later take effect in the next Context. This class
 * also records in the integrator each geometry that becomes known.
 */
class BodyDefinitions {
public:
    BodyDefinitions(const CustomRigidHIIntegrator& integrator, const OpenMM::System& system);
    /**
     * An integrator, bound to no Context, with these bodies, the present scheme, and the bodies and
     * particles that are held at present. Checks use it.
     */
    const CustomRigidHIIntegrator& underPresentScheme();

    int getNumBodies() const { return definitions->getNumRigidBodies(); }
    const std::vector<int>& particles(int body) const {
        return definitions->getRigidBodyParticles(body);
    }
    std::vector<std::vector<int>> particlesOfBodies() const;
    /** The joints as they were at Context creation, in the users' body frames. */
    const std::vector<JointDefinition>& joints() const { return definitions->getJoints(); }
    /** The motors as they were at Context creation, with the integrator's present rates. */
    std::vector<HingeMotorDefinition> motors() const;
    bool isExplicit(int body) const { return definitions->getRigidBodyIsExplicit(body); }
    bool isKnown(int body) const { return definitions->getRigidBodyGeometryIsKnown(body); }
    bool areAllKnown() const;
    /** The entries of bodies whose geometry is not known are undefined. */
    const std::vector<BodyGeometry>& geometries() const { return geometries_; }
    const PoseFit& fit(int body) const { return fits[body]; }
    /**
     * How far the sites of two definitions of a body may be apart, nm: half of the pose tolerance.
     * This allows for the rounding of positions and for an equal error of the pose.
     */
    double siteTolerance() const { return integrator.getPoseTolerance() / 2; }
    /** BodyGeometryBuilder::isFixedByConstraints() of a body. */
    bool isFixedByConstraints(int body) const { return builder(body).isFixedByConstraints(); }
    bool hasRedundantConstraints(int body) const { return builder(body).hasRedundantConstraints(); }

    /** Find all geometries that need no positions. Particle indices must have been checked. */
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
     * Objects made from geometries. States are at the origin, and the bodies that the integrator
     * holds at present are held. @throws OpenMMException for sites that are not where they must be
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
