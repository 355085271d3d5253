#include "rigid/BodyMobility.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

const Placement& BodyMobility::placementOf(const vector<Pose>& at) {
    setTurns(at, askedTurns);
    asked.box = bodies.getBox();
    bodies.getMotion().place(at, askedTurns, asked);
    return asked;
}

string BodyMobility::objection(const vector<Pose>& at) {
    if (!mayObject()) return {};
    string found = bodies.getModel().objection(placementOf(at));
    if (!found.empty() || !bodies.getForcesOnFluid()) return found;
    bodies.getForcesOnFluid()->place(at, askedTurns, asked);
    found = bodies.getForcesOnFluid()->getModel().objection(asked);
    return found.empty() ? found
                         : "at the site of a force on the fluid (addBodyForceOnFluid()): " + found;
}

bool BodyMobility::acceptsNearby(const vector<Pose>& at) {
    return !mayObject() || bodies.getModel().acceptsNearby(placementOf(at));
}

void BodyMobility::slipsOf(RandomField& field, MatrixXd& slips) {
    BodiesAt& here = particlesHere();
    field.slipsAt(here.getPlacement(), here.isNearby(), slips);
    costs.roots += !bodies.getModel().randomField()->isLocal();
}

void BodyMobility::applyToParticles(const VectorXd& forces, VectorXd& velocities) {
    const HydrodynamicParticles& particles = bodies.getParticles();
    if (particles.size() == 0) return;
    MatrixXd f = MatrixXd::Zero(particles.numRows, 1), u;
    for (int i = 0; i < particles.size(); i++)
        f.middleRows<3>(particles.firstRow[i]) = forces.segment<3>(3 * particles.systemIndex[i]);
    particlesHere().particles().multiply(f, u);
    costs.products += bodies.hasProducts();
    for (int i = 0; i < particles.size(); i++)
        velocities.segment<3>(3 * particles.systemIndex[i]) =
            u.middleRows<3>(particles.firstRow[i]);
}

}  // namespace RigidHIPlugin
