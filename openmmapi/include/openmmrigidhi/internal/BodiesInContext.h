#ifndef OPENMMRIGIDHI_BODIES_IN_CONTEXT_H_
#define OPENMMRIGIDHI_BODIES_IN_CONTEXT_H_

#include <openmm/Vec3.h>

#include <map>
#include <string>
#include <vector>

#include "openmmrigidhi/CustomRigidHIIntegrator.h"

namespace RigidHIPlugin {

/**
 * What users ask a CustomRigidHIIntegrator about the bodies of its Context and about the steps so
 * far. Each method answers the integrator's method of the same name, which documents it; the
 * integrator has checked the arguments.
 *
 * Users, barostats and minimisers may change the Context's positions and velocities. Every method
 * that looks at the bodies first brings them up to date with such changes, by a comparison with the
 * numbers that the kernel wrote last.
 */
class BodiesInContext {
public:
    virtual ~BodiesInContext() {}

    /** The number of bodies of the Context. The integrator may have more by now. */
    virtual int getNumBodies() const = 0;
    /** Make sure that all geometries are known. @throws OpenMMException without positions */
    virtual void requireGeometry() = 0;

    virtual std::vector<OpenMM::Vec3> getBodyPositions() = 0;
    virtual std::vector<QuaternionArray> getBodyOrientations() = 0;
    virtual std::vector<OpenMM::Vec3> getBodyVelocities() = 0;
    virtual std::vector<OpenMM::Vec3> getBodyAngularVelocities() = 0;
    virtual void setBodyPositions(const std::vector<OpenMM::Vec3>& positions) = 0;
    virtual void setBodyOrientations(const std::vector<QuaternionArray>& orientations) = 0;
    virtual void setBodyVelocities(const std::vector<OpenMM::Vec3>& velocities) = 0;
    virtual void setBodyAngularVelocities(const std::vector<OpenMM::Vec3>& angularVelocities) = 0;
    virtual std::vector<OpenMM::Vec3> getBodyForces() = 0;
    virtual std::vector<OpenMM::Vec3> getBodyTorques() = 0;
    virtual std::vector<double> computeHoldingWrenches() = 0;
    virtual std::vector<double> getHoldingWrenches() = 0;
    virtual std::vector<OpenMM::Vec3> computeParticleHoldingForces() = 0;
    virtual std::vector<OpenMM::Vec3> getParticleHoldingForces() = 0;
    virtual std::vector<OpenMM::Vec3> getJointForces() = 0;
    virtual std::vector<double> getHingeMotorTorques() = 0;
    virtual double getPoseResidual() = 0;

    virtual double computeTranslationalKineticEnergy() = 0;
    virtual OpenMM::Vec3 computeRotationalKineticEnergies() = 0;
    virtual double computeFreeParticleKineticEnergy() = 0;
    virtual std::map<std::string, int> getDegreesOfFreedom() = 0;
    virtual std::map<std::string, double> computeMidStepTemperatures() = 0;

    virtual std::map<std::string, std::string> getEffects() = 0;
    /** Warnings for the user, one text each; getEffects() has all of them in "warnings". */
    virtual std::vector<std::string> getWarnings() = 0;
    virtual std::map<std::string, double> getStepStatistics() = 0;
    virtual int getNumRejectedSteps() = 0;
};

}  // namespace RigidHIPlugin

#endif
