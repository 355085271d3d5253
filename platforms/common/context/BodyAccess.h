#ifndef RIGIDHI_BODY_ACCESS_H_
#define RIGIDHI_BODY_ACCESS_H_

#include <array>
#include <vector>

#include "context/ContextMirror.h"

namespace RigidHIPlugin {

/**
 * Requests of users for the state of bodies and their fluid, and changes of this state. Changes
 * that others made to the Context are taken in first.
 */
class BodyAccess {
public:
    BodyAccess(Scene& scene, ContextMirror& mirror) : scene(scene), mirror(mirror) {}

    std::vector<OpenMM::Vec3> getPositions();
    std::vector<std::array<double, 4> > getOrientations();
    std::vector<OpenMM::Vec3> getVelocities();
    std::vector<OpenMM::Vec3> getAngularVelocities();
    void setPositions(const std::vector<OpenMM::Vec3>& rows);
    void setOrientations(const std::vector<std::array<double, 4> >& rows);
    void setVelocities(const std::vector<OpenMM::Vec3>& rows);
    void setAngularVelocities(const std::vector<OpenMM::Vec3>& rows);
    /** Forces of the last step. */
    std::vector<OpenMM::Vec3> getForces();
    std::vector<OpenMM::Vec3> getTorques();
    double getPoseResidual();
    /** Make sure that all geometries are known. @throws OpenMMException without positions */
    void requireGeometry();

    /** 0 for schemes without momenta. */
    double translationalKineticEnergy();
    OpenMM::Vec3 rotationalKineticEnergies();
    double freeParticleKineticEnergy();

    /** getMobilityInContext() and so on; matrices row after row. */
    std::vector<double> getMobility();
    std::vector<double> getFriction();
    std::vector<double> applyMobility(const std::vector<double>& wrenches);
    std::vector<double> applyBlobMobility(const std::vector<double>& forces);
    /**
     * Whether the flow is that of present forces, which are to be evaluated before the flow is
     * asked for.
     */
    bool flowNeedsForces(const char* method);
    std::vector<OpenMM::Vec3> getFlow(const std::vector<OpenMM::Vec3>& points);
    std::vector<double> getFlowMode(int forceAxis, int waveAxis, int waveVectorIndex,
                                    bool randomOnly);

private:
    void prepare(const char* method);
    Fluid& prepareFluid(const char* method);
    FlowQuestion askForFlow() const;
    void posesWereSet();
    void twistsWereSet();
    bool hasMomenta() const;
    template <class Of>
    auto ofBodies(Of of) const;
    Scene& scene;
    ContextMirror& mirror;
};

}  // namespace RigidHIPlugin

#endif
