// Fluid: checks that refuse a scene, and the groups as the Context sees them.

#include "fluid/Fluid.h"

#include <cmath>
#include <sstream>

#include "fluid/GroupBuilder.h"
#include "mobility/models/periodic/Lattice.h"
#include "openmmrigidhi/internal/Errors.h"
#include "rigidbody/BodyPoses.h"
#include "rigidbody/EigenVec3.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

namespace {

constexpr ErrorsOf fail{"MobilityForce"};

/** Forces on sites of a line give a torque about it of about 1e-16 of force times size. */
const double torqueTolerance = 1e-9;

}  // namespace

string textOf(const BoxVectors& box) {
    ostringstream text;
    text << "the periodic box";
    for (int k = 0; k < 3; k++)
        text << (k == 0 ? " (" : ", (") << box[k][0] << ", " << box[k][1] << ", " << box[k][2]
             << ")";
    text << " nm";
    return text.str();
}

void Fluid::check(const MobilityForce& force, const FluidSettings& settings,
                  const OpenMM::System& system, const vector<vector<int>>& particlesOfBodies,
                  const FreeParticles& freeParticles, PlatformLoops& loops) {
    GroupBuilder(force, settings, system, particlesOfBodies, freeParticles, loops).checkModels();
}

Fluid::Fluid(const MobilityForce& forceToUse, const FluidSettings& settings,
             const OpenMM::System& system, const vector<vector<int>>& particlesOfBodiesToUse,
             const vector<BodyGeometry>& geometries, const BodySet& bodies,
             const FreeParticles& freeParticles, PlatformLoops& loops)
    : force(forceToUse), userFlow(force), settings(settings), loops(loops),
      particlesOfBodies(particlesOfBodiesToUse),
      groups(GroupBuilder(force, settings, system, particlesOfBodies, freeParticles, loops)
                 .build(geometries, bodies)),
      elementOfBody(particlesOfBodies.size(), -1), groupOfBody(particlesOfBodies.size(), -1),
      groupOfFree(freeParticles.getNumParticles(), -1) {
    for (size_t g = 0; g < groups.size(); g++) {
        FluidGroup& group = *groups[g];
        const auto& elements = group.bodies.getElements();
        for (size_t e = 0; e < elements.size(); e++)
            if (elements[e].isFree()) {
                groupOfFree[group.members.freeIndex[e]] = g;
            } else {
                groupOfBody[elements[e].body] = g;
                elementOfBody[elements[e].body] = e;
            }
        if (group.isThermostat) continue;
        coupledGroups.push_back(&group);
        const double rows = group.relaxation->getNumRows(),
                     particleRows = group.bodies.getNumParticleRows();
        operationsPerStep +=
            group.bodies.isConstantInBodyFrame()
                ? BrownianGroup::operationsOfConstantTensor
                : 20 * rows * rows * rows + particleRows * particleRows * particleRows / 3;
    }
}

bool Fluid::isMadeFor(const FluidSettings& wanted) const {
    if (hasWalls() && settings.wallRejection != wanted.wallRejection) return false;
    if (settings.scheme == wanted.scheme) return true;
    return none_of(groups.begin(), groups.end(),
                   [](const unique_ptr<FluidGroup>& group) { return group->dependsOnScheme; });
}

void Fluid::checkInertia(const BodySet& bodies) const {
    for (const auto& group : groups) {
        if (force.getSolver() == MobilityForce::MatrixFree && group->relaxation &&
            group->relaxation->getMobility().getWay() == BodyMobility::Dense)
            fail(
                "solver MatrixFree cannot be used with a body that has a principal moment of 0 "
                "about an axis about which the fluid resists its rotation (a sphere, or blobs that "
                "are not on a line); use setSolver(Dense)");
        const auto& elements = group->bodies.getElements();
        for (size_t e = 0; e < elements.size(); e++) {
            if (!group->bodies.hasNullVector(e)) continue;
            // The null twist (the rotation about the line of a linear body's blobs) must have no
            // momentum: it is a rotation about dead axes only.
            const VectorXd& twist = group->bodies.getNullVector_body(e);
            const BodyInertia& inertia = bodies.inertia(elements[e].body);
            double momentum = twist.head<3>().norm();
            for (int k = 0; k < 3; k++)
                if (inertia.isLive(k)) momentum += abs(twist[3 + k]);
            const double directionTolerance = 1e-6;
            if (momentum > directionTolerance)
                fail("body " + to_string(elements[e].body) +
                     ": its hydrodynamic particles lie on a line, so that the fluid does not "
                     "resist rotation about this line, but the body has a moment of inertia about "
                     "the line; give the body a moment of 0 about the line, or hydrodynamic "
                     "particles off the line");
        }
    }
}

/**
 * Check the power of a wrench on the rotation about the line, relative to the rounding that forces
 * at the sites leave.
 */
void Fluid::checkTorque(const FluidGroup& group, int e, const Matrix<double, 6, 1>& wrench_body,
                        double siteForces) const {
    if (!group.bodies.hasNullVector(e)) return;
    const FluidElement& element = group.bodies.getElements()[e];
    const double power = group.bodies.getNullVector_body(e).dot(wrench_body);
    double size = 0;
    for (const Vector3d& site : element.sites) size = max(size, site.norm());
    // Site forces may cancel in the wrench, but their rounding errors do not.
    const double scale =
        wrench_body.tail<3>().norm() + size * (wrench_body.head<3>().norm() + siteForces);
    if (abs(power) <= torqueTolerance * scale) return;
    ostringstream text;
    text << "body " << element.body << ": a torque of " << power
         << " kJ/mol acts about the line of its hydrodynamic particles, about which neither the "
            "fluid nor inertia resists rotation; this torque must be 0 within 1e-9 of force times "
            "size plus torque: remove the torque, or give the body hydrodynamic particles off the "
            "line";
    fail(text.str());
}

void Fluid::checkTorques(const BodySet& bodies, const vector<OpenMM::Vec3>& forces) const {
    Matrix<double, 6, 1> wrench;
    for (const auto& group : groups) {
        if (!group->hasNullVectors) continue;
        const auto& elements = group->bodies.getElements();
        for (size_t e = 0; e < elements.size(); e++) {
            if (!group->bodies.hasNullVector(e)) continue;
            const int s = bodies.slot(elements[e].body);
            const Matrix3d A = poseOf(bodies, elements[e].body).rotation();
            wrench.head<3>() =
                A.transpose() *
                Vector3d(bodies.force_lab[0][s], bodies.force_lab[1][s], bodies.force_lab[2][s]);
            wrench.tail<3>() = Vector3d(bodies.torque_body[0][s], bodies.torque_body[1][s],
                                        bodies.torque_body[2][s]);
            double siteForces = 0;
            for (int p : particlesOfBodies[elements[e].body])
                siteForces += sqrt(forces[p].dot(forces[p]));
            checkTorque(*group, e, wrench, siteForces);
        }
    }
}

void Fluid::setBox(const BoxVectors& newBox) {
    box = newBox;
    boxIsChecked = false;
    for (auto& group : groups) {
        group->bodies.setBox(box);
        group->brownian->setBox(box);
    }
    flowReader.forget();
    flow = userFlow.inBox(box);
    driven = flow.isZero() ? nullptr : &flow;
}

void Fluid::checkBox() {
    if (!isPeriodic() || boxIsChecked) return;
    const Lattice lattice(box);
    const double rounding = 1e-12, shortest = lattice.getShortest();
    for (const auto& group : groups)
        for (size_t e = 0; e < group->bodies.getElements().size(); e++) {
            const FluidElement& element = group->bodies.getElements()[e];
            const double length = element.particles.empty() ? 0 : group->bodies.length(e);
            if (length <= shortest * (1 + rounding)) continue;
            ostringstream text;
            text << (element.isFree() ? "particle " + to_string(element.particles[0])
                                      : "body " + to_string(element.body))
                 << " has the length " << length
                 << " nm, hydrodynamic radii included, and would overlap its own image: in "
                 << textOf(box) << " the shortest lattice vector has the length " << shortest
                 << " nm; make the box larger by setPeriodicBoxVectors() on the Context (or "
                    "setDefaultPeriodicBoxVectors() on the System before), or use the boundary "
                    "Unbounded";
            fail(text.str());
        }
    for (const auto& group : groups)
        if (group->bodies.hasModel()) group->bodies.getModel().checkBox(box);
    checkWave();
    boxIsChecked = true;
}

void Fluid::checkWave() const {
    for (const auto& group : groups)
        if (userFlow.hasWave() && group->bodies.hasModel())
            group->bodies.getModel().checkWave(box, userFlow.waveAxis, userFlow.waveVectorIndex);
}

void Fluid::continueFrom(const Fluid& before) {
    numIterations = before.numIterations;
    numSquareRoots = before.numSquareRoots;
    productsBefore = before.numProducts();
    matricesBefore = before.numMatrices();
    // Both fluids may share a grid, whose times this fluid counts already.
    gridSecondsBefore = {};
    const GridSeconds own = getGridSeconds();
    gridSecondsBefore = before.getGridSeconds();
    gridSecondsBefore.add(own, -1);
    secondsOfSolverBefore = before.getSecondsOfSolver();
    if (!traitsOf(before.schemeOfSteps).isOverdamped() || groups.size() != before.groups.size())
        return;
    setMemory(before.getMemory(), before.schemeOfSteps);
}

MobilityCosts Fluid::costs() const {
    MobilityCosts sum;
    for (const auto& group : groups) {
        sum.add(group->mobilities.getCosts());
        sum.add(group->brownian->getCostsOfSlowed());
    }
    return sum;
}

long long Fluid::numProducts() const { return productsBefore + costs().products; }
long long Fluid::numMatrices() const { return matricesBefore + costs().matrices; }

}  // namespace RigidHIPlugin
