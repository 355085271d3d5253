#include "fluid/FluidMomenta.h"

#include <cmath>
#include <functional>

#include "linearalgebra/OneBlasThread.h"
#include "openmmrigidhi/internal/Errors.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

FluidMomenta::FluidMomenta(const FluidContents& fluid) : fluid(fluid) {
    for (const auto& group : fluid.groups) {
        fixesComponents = fixesComponents || group->holds;
        if (!group->relaxation) continue;
        coupledGroups.push_back(group.get());
        const double rows = group->relaxation->getNumRows(),
                     particleRows = group->bodies.getNumParticleRows();
        operationsPerStep +=
            group->bodies.isConstantInBodyFrame()
                ? BrownianGroup::operationsOfConstantTensor
                : 20 * rows * rows * rows + particleRows * particleRows * particleRows / 3;
    }
}

void FluidMomenta::checkInertia(const BodySet& bodies) const {
    for (const auto& group : fluid.groups) {
        if (fluid.force.getSolver() == MobilityForce::MatrixFree && group->relaxation &&
            group->relaxation->getMobility().getWay() == BodyMobility::Dense)
            failFluid(
                "solver MatrixFree cannot be used with a body that has a principal moment of 0 "
                "about an axis about which the fluid resists its rotation (a sphere, or blobs that "
                "are not on a line); use setSolver(Dense)");
        const auto& elements = group->bodies.getElements();
        for (size_t e = 0; e < elements.size(); e++) {
            if (!group->bodies.hasNullVector(e) || !elements[e].isWhollyFree()) continue;
            // The null twist (the rotation about the line of a linear body's blobs) must have no
            // momentum: it is a rotation about dead axes only.
            const VectorXd& twist = group->bodies.getNullVector_body(e);
            const BodyInertia& inertia = bodies.inertia(elements[e].body);
            double momentum = twist.head<3>().norm();
            for (int k = 0; k < 3; k++)
                if (inertia.isLive(k)) momentum += abs(twist[3 + k]);
            const double directionTolerance = 1e-6;
            if (momentum > directionTolerance)
                failFluid(
                    "body " + to_string(elements[e].body) +
                    ": its hydrodynamic particles lie on a line, so that the fluid does not "
                    "resist rotation about this line, but the body has a moment of inertia about "
                    "the line; give the body a moment of 0 about the line, or hydrodynamic "
                    "particles off the line");
        }
    }
}

Thermostat FluidMomenta::bodyThermostat(int body, const BodyInertia& inertia, double kT,
                                        double h) const {
    const FluidGroup& group = *fluid.groups[fluid.groupOfBody[body]];
    if (!group.isThermostat) return {};
    double rates[3] = {0, 0, 0};
    for (int k = 0; k < 3; k++)
        if (inertia.isLive(k)) rates[k] = group.drag_r[k] / inertia.moments[k];
    return ornsteinUhlenbeckCoefficients(inertia, group.drag_t / inertia.mass, rates, kT, h);
}

bool FluidMomenta::freeThermostat(int freeParticle, double mass, double kT, double h,
                                  Thermostat& thermostat) const {
    if (fluid.groupOfFree[freeParticle] < 0) return false;
    thermostat = Thermostat();
    const FluidGroup& group = *fluid.groups[fluid.groupOfFree[freeParticle]];
    if (!group.isThermostat) return true;
    setOrnsteinUhlenbeck(mass, group.drag_t / mass, kT, h, thermostat.decay_p, thermostat.noise_p);
    return true;
}

LoopResult FluidMomenta::relax(double h, double kT, const NoiseStream& noise, BodySet& bodies,
                               const FreeParticles& freeParticles,
                               const vector<OpenMM::Vec3>& positions,
                               vector<OpenMM::Vec3>& velocities, const MatrixXd* prescribed) {
    const OneBlasThread single;
    const RelaxationStep step{h,          kT,          noise,           bodies,    freeParticles,
                              velocities, fluid.loops, fluid.getFlow(), prescribed};
    const auto task = [&](int i) {
        FluidGroup& group = *coupledGroups[i];
        group.relaxation->relax(group.readPoses(bodies, positions), step);
        if (group.holds) group.holds->noteMiddle(group.poses, group.relaxation.get(), step);
    };
    for (const auto& group : fluid.groups)
        if (group->holds && !group->relaxation)
            group->holds->noteMiddle(group->readPoses(bodies, positions), nullptr, step);
    fluid.forGroups(coupledGroups.size(), operationsPerStep, cref(task));
    LoopResult result;
    for (const FluidGroup* group : coupledGroups) {
        result.randomNumbers += group->relaxation->getNumRandomNumbers();
        result.squareRoots += kT > 0;
        result.iterations += group->relaxation->getNumIterations();
        result.finite = result.finite && group->relaxation->isFinite();
    }
    return result;
}

void FluidMomenta::beginStep(const BodySet& bodies, const FreeParticles& freeParticles) {
    for (const auto& group : fluid.groups)
        if (group->holds) group->holds->begin(bodies, freeParticles);
}

void FluidMomenta::endStep(const BodySet& bodies, const FreeParticles& freeParticles) {
    for (const auto& group : fluid.groups)
        if (group->holds) group->holds->end(bodies, freeParticles);
}

}  // namespace RigidHIPlugin
