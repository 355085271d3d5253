// Fluid: from the scene to groups, and what is refused.

#include "engine/Fluid.h"

#include <openmm/OpenMMException.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <sstream>

#include "engine/BodyPoses.h"
#include "mobility/Models.h"
#include "mobility/OneBlasThread.h"
#include "rigidbody/EigenVec3.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

namespace {

[[noreturn]] void fail(const string& message) { throw OpenMM::OpenMMException("MobilityForce: " + message); }

/** Up to this many rows Auto decomposes matrices, beyond it takes Lanczos: 30 spheres, where this wins at the default tolerance. */
const int largestDenseRows = 180;
/** Likewise for the particles of multiblobs, whose matrix is factorised. */
const int largestDenseParticleRows = 1500;

/** For schemes without momenta, whose iterations are few: 8 boomerangs of 15 blobs, where both take as long at the default tolerance. */
const int largestDenseOverdampedRows = 360;

/** Forces on sites of a line give a torque about it of about 1e-16 of force times size. */
const double torqueTolerance = 1e-9;

/** Rounding that a product of rotations leaves in a tensor. */
const double isotropyTolerance = 1e-13;

/** Whether a friction tensor is isotropic in translation, diagonal in rotation, and without coupling. */
bool isThermostatTensor(const MatrixXd& friction) {
    for (int i = 0; i < friction.rows(); i++)
        for (int k = 0; k < friction.cols(); k++)
            if (i != k && abs(friction(i, k)) > isotropyTolerance * sqrt(abs(friction(i, i) * friction(k, k))))
                return false;
    return abs(friction(0, 0) - friction(1, 1)) <= isotropyTolerance * friction(0, 0) &&
           abs(friction(0, 0) - friction(2, 2)) <= isotropyTolerance * friction(0, 0);
}

typedef map<int, vector<FluidElement> > ElementsOfGroups;

/**
 * Who feels whom, in the order of the groups' labels; without interaction every body is a group of its own. Elements lack
 * what needs the shapes of bodies: sites and own tensors.
 */
ElementsOfGroups groupElements(const MobilityForce& force, const OpenMM::System& system,
                               const vector<vector<int> >& particlesOfBodies, const FreeParticles& freeParticles) {
    const int numBodies = particlesOfBodies.size();
    const bool freeDraining = force.getModel() == MobilityForce::FreeDraining;
    if (force.getNumParticles() != system.getNumParticles())
        fail("it has " + to_string(force.getNumParticles()) + " radii, but the System has " +
             to_string(system.getNumParticles()) +
             " particles; call addParticle() once for each particle of the System, with radius 0 where the fluid does "
             "not see it");
    const vector<int>& labels = force.getGroups();
    if (!labels.empty() && (int)labels.size() != numBodies)
        fail("setGroups() was given " + to_string(labels.size()) + " groups, but the integrator has " +
             to_string(numBodies) + " bodies; give one for each body");
    for (int b : force.getBodiesWithOwnTensors()) {
        if (b >= numBodies)
            fail("body " + to_string(b) + " was given a tensor of its own, but the integrator has " +
                 to_string(numBodies) + " bodies, counted from 0; correct the index");
        if (force.getModel() == MobilityForce::StokesianDynamics)
            fail(
                "body " + to_string(b) +
                " was given a tensor of its own, which model StokesianDynamics cannot take; use RotnePragerYamakawa or "
                "FreeDraining");
    }

    ElementsOfGroups groups;
    int nextGroup = 0;
    for (int b = 0; b < numBodies; b++) {
        FluidElement element;
        element.body = b;
        for (int p : particlesOfBodies[b]) {
            if (force.getParticleRadius(p) == 0) continue;
            element.particles.push_back(p);
            element.radii.push_back(force.getParticleRadius(p));
        }
        if (element.particles.empty() && !(freeDraining && force.getBodyHasOwnTensor(b)))
            fail("body " + to_string(b) +
                 " has no particle with a hydrodynamic radius, so the fluid would not see it; give at least one of its "
                 "particles a radius above 0");
        groups[freeDraining ? nextGroup++ : labels.empty() ? 0 : labels[b]].push_back(element);
    }
    vector<char> known(system.getNumParticles(), false);
    for (int p : freeParticles.getParticles()) {
        known[p] = true;
        if (force.getParticleRadius(p) == 0) continue;
        FluidElement element;
        element.particles = {p};
        element.radii = {force.getParticleRadius(p)};
        groups[freeDraining ? nextGroup++ : 0].push_back(element);
    }
    for (const vector<int>& particles : particlesOfBodies)
        for (int p : particles) known[p] = true;
    for (int p = 0; p < system.getNumParticles(); p++)
        if (force.getParticleRadius(p) > 0 && !known[p])
            fail(
                "particle " + to_string(p) + " has hydrodynamic radius " + to_string(force.getParticleRadius(p)) +
                " nm but is a virtual site in no body, which the fluid cannot move; make it part of a body, or give it "
                "radius 0");
    return groups;
}

/** Add the sites of particles, and what the body's own tensor is in the inner frame. */
void addShape(FluidElement& element, const MobilityForce& force, const vector<vector<int> >& particlesOfBodies,
              const vector<BodyGeometry>& geometries, const BodySet& bodies) {
    if (element.isFree()) {
        element.sites = {Vector3d::Zero()};
        return;
    }
    const int b = element.body;
    for (size_t i = 0; i < particlesOfBodies[b].size(); i++)
        if (force.getParticleRadius(particlesOfBodies[b][i]) > 0)
            element.sites.push_back(toEigen(bodies.toInner(b, geometries[b].sites[i])));
    if (!force.getBodyHasOwnTensor(b)) return;
    const vector<double> user = force.getBodyMobility(b);
    Matrix3d toInner;
    for (int k = 0; k < 3; k++) toInner.col(k) = toEigen(bodies.toInner(b, OpenMM::Vec3(k == 0, k == 1, k == 2)));
    const Matrix<double, 6, 6> turn = twoRotations(toInner);
    element.ownMobility = turn * Map<const Matrix<double, 6, 6, RowMajor> >(user.data()) * turn.transpose();
}

[[noreturn]] void refuseMatrixFree(const MobilityForce& force) {
    fail("solver MatrixFree is there for RotnePragerYamakawa, not for " + string(modelName(force.getModel())) +
         "; use setSolver(Dense)");
}

}  // namespace

void Fluid::check(const MobilityForce& force, CustomRigidHIIntegrator::WallRejection wallRejection,
                  const OpenMM::System& system, const vector<vector<int> >& particlesOfBodies,
                  const FreeParticles& freeParticles, PlatformLoops& loops) {
    for (const auto& entry : groupElements(force, system, particlesOfBodies, freeParticles)) {
        const HydrodynamicParticles particles = particlesOf(entry.second);
        if (particles.size() == 0) continue;
        const auto model =
            loops.createMobility(force, wallRejection == CustomRigidHIIntegrator::Crossing, particles, false);
        // Of one element in a uniform fluid the tensor is constant, so that nothing is ever solved.
        const bool isAlone = entry.second.size() == 1 && model->isHomogeneous() && model->isIsotropic();
        if (force.getSolver() == MobilityForce::MatrixFree && !model->hasProducts() && !isAlone)
            refuseMatrixFree(force);
    }
}

Fluid::Fluid(const MobilityForce& forceToUse, CustomRigidHIIntegrator::WallRejection wallRejection,
             const OpenMM::System& system, const vector<vector<int> >& particlesOfBodiesToUse,
             const vector<BodyGeometry>& geometries, const BodySet& bodies, const FreeParticles& freeParticles,
             PlatformLoops& loops)
    : force(forceToUse), wallRejection(wallRejection), particlesOfBodies(particlesOfBodiesToUse), loops(loops) {
    const OneBlasThread single;  // constant tensors are computed here
    const int numBodies = particlesOfBodies.size();
    ElementsOfGroups elementsOfGroup = groupElements(force, system, particlesOfBodies, freeParticles);
    for (auto& entry : elementsOfGroup)
        for (FluidElement& element : entry.second) addShape(element, force, particlesOfBodies, geometries, bodies);

    groupOfBody.assign(numBodies, -1);
    groupOfFree.assign(freeParticles.getNumParticles(), -1);
    vector<int> indexOfFree(system.getNumParticles(), -1);
    for (int i = 0; i < freeParticles.getNumParticles(); i++) indexOfFree[freeParticles.getParticles()[i]] = i;
    const bool severalGroups = elementsOfGroup.size() > 1;
    const auto makeModel = [&](const HydrodynamicParticles& particles) {
        return this->loops.createMobility(force, this->wallRejection == CustomRigidHIIntegrator::Crossing, particles,
                                          !severalGroups);
    };
    for (auto& entry : elementsOfGroup) {
        groups.emplace_back(new Group());
        Group& group = *groups.back();
        group.mobility.reset(new BodyMobility(entry.second, makeModel));
        group.mobility->wantedTolerance = force.getSolverTolerance();
        for (const FluidElement& element : group.mobility->getElements()) {
            int live = 0, freeIndex = -1;
            if (element.isFree()) {
                freeIndex = indexOfFree[element.particles[0]];
                groupOfFree[freeIndex] = groups.size() - 1;
            } else {
                for (int k = 0; k < 3; k++) live += bodies.inertia(element.body).isLive(k);
                const bool hasNull = group.mobility->hasNullVector(group.relaxation.numLive.size());
                group.hasNullVectors = group.hasNullVectors || hasNull;
                group.relaxation.deadAxesAreNull = group.relaxation.deadAxesAreNull && live == (hasNull ? 2 : 3);
                groupOfBody[element.body] = groups.size() - 1;
            }
            group.freeIndex.push_back(freeIndex);
            group.relaxation.numLive.push_back(live);
            group.relaxation.firstZ.push_back(group.relaxation.numZ);
            group.relaxation.numZ += 3 + live;
        }
        group.poses.resize(group.freeIndex.size());
        // One element alone: a constant tensor, perhaps so simple that it is a thermostat.
        if (group.mobility->isAloneInUniformFluid()) {
            group.mobility->setPoses({Pose()});
            const MatrixXd& friction = group.mobility->friction();
            group.isThermostat = isThermostatTensor(friction);
            group.drag_t = friction(0, 0);
            for (int k = 0; k < 3 && friction.rows() == 6; k++) group.drag_r[k] = friction(3 + k, 3 + k);
        }
        if (!group.isThermostat) coupledGroups.push_back(&group);
        chooseSolver(group);
        const double rows = group.relaxation.numZ, particleRows = group.mobility->getNumParticleRows();
        if (!group.isThermostat)
            operationsPerStep += group.mobility->isConstantInBodyFrame()
                                     ? operationsOfConstantTensor
                                     : 20 * rows * rows * rows + particleRows * particleRows * particleRows / 3;
    }
}

/** Dense or matrix-free, by the number of rows only, so that a resumed run chooses the same. */
void Fluid::chooseSolver(Group& group) const {
    if (group.isThermostat || group.mobility->isConstantInBodyFrame()) return;
    const bool wanted = force.getSolver() == MobilityForce::MatrixFree;
    if (wanted && !group.mobility->canApplyMatrixFree()) refuseMatrixFree(force);
    const auto takes = [&](bool large) {
        return group.mobility->canApplyMatrixFree() && (wanted || (force.getSolver() == MobilityForce::Auto && large));
    };
    const int particleRows = group.mobility->getNumParticleRows();
    group.overdamped.matrixFree = takes(particleRows > largestDenseOverdampedRows);
    // What users ask for knows no inertia: as with the masses that go with the fluid, whatever the bodies have.
    int rows = group.mobility->getNumRows();
    for (size_t e = 0; e < group.mobility->getElements().size(); e++) rows -= group.mobility->hasNullVector(e);
    group.answersMatrixFree = takes(rows > largestDenseRows || particleRows > largestDenseParticleRows);
    group.relaxation.solvesMatrixFree =
        group.relaxation.deadAxesAreNull &&
        takes(group.relaxation.numZ > largestDenseRows || particleRows > largestDenseParticleRows);
    if (group.relaxation.solvesMatrixFree) group.relaxation.lanczos.reset(new Lanczos(force.getSolverTolerance()));
}

void Fluid::checkInertia(const BodySet& bodies) const {
    for (const auto& group : groups) {
        const bool needsSolver = !group->isThermostat && !group->mobility->isConstantInBodyFrame();
        if (needsSolver && force.getSolver() == MobilityForce::MatrixFree && !group->relaxation.solvesMatrixFree)
            fail(
                "solver MatrixFree is there for bodies that the fluid and their moments let rotate about the same "
                "axes, "
                "not for spheres and blobs off a line with a zero moment; use setSolver(Dense)");
        const auto& elements = group->mobility->getElements();
        for (size_t e = 0; e < elements.size(); e++) {
            if (!group->mobility->hasNullVector(e)) continue;
            // The null twist must be one that the body has no momentum for: rotation about dead axes only.
            const VectorXd& twist = group->mobility->getNullVector_body(e);
            const BodyInertia& inertia = bodies.inertia(elements[e].body);
            double momentum = twist.head<3>().norm();
            for (int k = 0; k < 3; k++)
                if (inertia.isLive(k)) momentum += abs(twist[3 + k]);
            const double directionTolerance = 1e-6;
            if (momentum > directionTolerance)
                fail("body " + to_string(elements[e].body) +
                     ": its hydrodynamic particles lie on a line, about which the fluid does not hold it, but it has "
                     "inertia about that line; give it a zero moment about the line, or more particles off the line");
        }
    }
}

/** The power of a wrench on the twist about the line, relative to what rounding of forces at the sites leaves. */
void Fluid::checkTorque(const Group& group, int e, const VectorXd& wrench_body, double siteForces) const {
    if (!group.mobility->hasNullVector(e)) return;
    const FluidElement& element = group.mobility->getElements()[e];
    const double power = group.mobility->getNullVector_body(e).dot(wrench_body);
    double size = 0;
    for (const Vector3d& site : element.sites) size = max(size, site.norm());
    // Site forces may cancel in the wrench, but not in its rounding.
    const double scale = wrench_body.tail<3>().norm() + size * (wrench_body.head<3>().norm() + siteForces);
    if (abs(power) <= torqueTolerance * scale) return;
    ostringstream text;
    text << "body " << element.body << ": a torque of " << power
         << " kJ/mol acts about the line of its hydrodynamic particles, where neither the fluid nor inertia resists; "
            "it must be 0 "
            "within 1e-9 of force times size and torque: remove it, or give the body hydrodynamic particles off the "
            "line";
    fail(text.str());
}

void Fluid::checkTorques(const BodySet& bodies, const vector<OpenMM::Vec3>& forces) const {
    VectorXd wrench(6);
    for (const auto& group : groups) {
        if (!group->hasNullVectors) continue;
        const auto& elements = group->mobility->getElements();
        for (size_t e = 0; e < elements.size(); e++) {
            if (!group->mobility->hasNullVector(e)) continue;
            const int s = bodies.slot(elements[e].body);
            const Matrix3d A = poseOf(bodies, elements[e].body).rotation();
            wrench.head<3>() =
                A.transpose() * Vector3d(bodies.force_lab[0][s], bodies.force_lab[1][s], bodies.force_lab[2][s]);
            wrench.tail<3>() = Vector3d(bodies.torque_body[0][s], bodies.torque_body[1][s], bodies.torque_body[2][s]);
            double siteForces = 0;
            for (int p : particlesOfBodies[elements[e].body]) siteForces += sqrt(forces[p].dot(forces[p]));
            checkTorque(*group, e, wrench, siteForces);
        }
    }
}

void Fluid::setPoses(Group& group, const BodySet& bodies, const vector<OpenMM::Vec3>& positions) const {
    const auto& elements = group.mobility->getElements();
    for (size_t e = 0; e < elements.size(); e++)
        if (elements[e].isFree())
            group.poses[e].R = toEigen(positions[elements[e].particles[0]]);
        else
            group.poses[e] = poseOf(bodies, elements[e].body);
    group.mobility->setPoses(group.poses);
}

void Fluid::setBox(const BoxVectors& box) {
    for (auto& group : groups) group->mobility->setBox(box);
}

void Fluid::continueFrom(Fluid& before) {
    numIterations = before.numIterations;
    numSquareRoots = before.numSquareRoots;
    productsBefore = before.numProducts();
    matricesBefore = before.numMatrices();
    overdampedScheme_ = before.overdampedScheme_;
    for (size_t g = 0; g < groups.size() && groups.size() == before.groups.size(); g++)
        if (groups[g]->mobility->getNumRows() == before.groups[g]->mobility->getNumRows())
            groups[g]->overdamped.scheme = move(before.groups[g]->overdamped.scheme);
}

long long Fluid::numProducts() const {
    long long sum = productsBefore;
    for (const auto& group : groups) sum += group->mobility->numProducts;
    return sum;
}

long long Fluid::numMatrices() const {
    long long sum = matricesBefore;
    for (const auto& group : groups) sum += group->mobility->numMatrices;
    return sum;
}

}  // namespace RigidHIPlugin
