#include "fluid/MomentumHolds.h"

#include <cmath>

#include "schemes/OverdampedMove.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

void MomentumHolds::begin(const BodySet& bodies, const FreeParticles& freeParticles) {
    present.forces.setZero(members.getBodies().getNumRows(), 1);
    members.readForces(bodies, freeParticles, present.forces);
}

void MomentumHolds::noteMiddle(const vector<Pose>& poses, const Relaxation* relaxation,
                               const RelaxationStep& step) {
    present.poses = poses;
    present.h = step.h;
    present.kT = step.kT;
    present.noise = step.noise;
    present.hasFlow = step.flow;
    if (step.flow) present.flow = *step.flow;
    if (!members.readPrescribed(step.prescribed, present.prescribed))
        present.prescribed.resize(0, 0);
    if (relaxation)
        relaxation->getImpulses(step, present.impulses);
    else
        present.impulses.setZero(members.getBodies().getNumRows(), 1);
}

void MomentumHolds::end(const BodySet& bodies, const FreeParticles& freeParticles) {
    forcesAtEnd.setZero(present.forces.rows(), 1);
    members.readForces(bodies, freeParticles, forcesAtEnd);
    present.forces = (present.forces + forcesAtEnd) / 2;
    swap(last, present);
    isPending = true;
    group.forgetHolds();
}

void MomentumHolds::find() {
    if (!isPending) return;
    BodyMobility& mobility = group.mobilityFor(0, CustomRigidHIIntegrator::LangevinHI);
    mobility.setTolerance(tolerance);
    OverdampedMove move(mobility);
    OverdampedStep step;
    step.h = last.h;
    step.kT = last.kT;
    step.noise = last.noise;
    step.flow = last.hasFlow ? &last.flow : nullptr;
    move.start = last.poses;
    move.begin(step);
    if (last.prescribed.size() > 0) move.prescribe(&last.prescribed);
    MatrixXd holds = MatrixXd::Zero(last.forces.rows(), 1), wrench = last.impulses / last.h,
             thermal, twists;
    move.atStart();
    if (last.kT > 0) {
        // The relaxation of momenta has used the first draw.
        move.thermalWrench(OverdampedMove::Second, thermal);
        wrench += sqrt(2 * last.kT / last.h) * thermal;
    }
    move.recording.holds = &holds;
    move.solve(OverdampedMove::velocity(1, wrench), twists);
    group.setHolds(holds - last.forces);
    isPending = false;
}

}  // namespace RigidHIPlugin
