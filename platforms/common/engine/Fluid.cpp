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

/** How much more exactly than the tolerance Lanczos' products are taken where they are solves themselves. */
const double innerTolerance = 0.05;

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

}  // namespace

namespace {

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
                const bool hasNull = group.mobility->hasNullVector(group.numLive.size());
                group.hasNullVectors = group.hasNullVectors || hasNull;
                group.deadAxesAreNull = group.deadAxesAreNull && live == (hasNull ? 2 : 3);
                groupOfBody[element.body] = groups.size() - 1;
            }
            group.freeIndex.push_back(freeIndex);
            group.numLive.push_back(live);
            group.firstZ.push_back(group.numZ);
            group.numZ += 3 + live;
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
        const double rows = group.numZ, particleRows = group.mobility->getNumParticleRows();
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
    group.overdampedMatrixFree = takes(particleRows > largestDenseOverdampedRows);
    // What users ask for knows no inertia: as with the masses that go with the fluid, whatever the bodies have.
    int rows = group.mobility->getNumRows();
    for (size_t e = 0; e < group.mobility->getElements().size(); e++) rows -= group.mobility->hasNullVector(e);
    group.answersMatrixFree = takes(rows > largestDenseRows || particleRows > largestDenseParticleRows);
    group.solvesMatrixFree =
        group.deadAxesAreNull && takes(group.numZ > largestDenseRows || particleRows > largestDenseParticleRows);
    if (group.solvesMatrixFree) group.lanczos.reset(new Lanczos(force.getSolverTolerance()));
}

void Fluid::checkInertia(const BodySet& bodies) const {
    for (const auto& group : groups) {
        const bool needsSolver = !group->isThermostat && !group->mobility->isConstantInBodyFrame();
        if (needsSolver && force.getSolver() == MobilityForce::MatrixFree && !group->solvesMatrixFree)
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

Thermostat Fluid::bodyThermostat(int body, const BodyInertia& inertia, double kT, double h) const {
    const Group& group = *groups[groupOfBody[body]];
    Thermostat c;
    if (!group.isThermostat) return c;
    const double rate = group.drag_t / inertia.mass;
    c.decay_p = exp(-rate * h);
    c.noise_p = sqrt(-inertia.mass * kT * expm1(-2 * rate * h));
    for (int k = 0; k < 3; k++) {
        if (!inertia.isLive(k)) continue;
        const double rate_k = group.drag_r[k] / inertia.moments[k];
        c.decay_l[k] = exp(-rate_k * h);
        c.noise_l[k] = sqrt(-inertia.moments[k] * kT * expm1(-2 * rate_k * h));
    }
    return c;
}

bool Fluid::freeThermostat(int freeParticle, double mass, double kT, double h, Thermostat& thermostat) const {
    if (groupOfFree[freeParticle] < 0) return false;
    thermostat = Thermostat();
    const Group& group = *groups[groupOfFree[freeParticle]];
    if (!group.isThermostat) return true;
    const double rate = group.drag_t / mass;
    thermostat.decay_p = exp(-rate * h);
    thermostat.noise_p = sqrt(-mass * kT * expm1(-2 * rate * h));
    return true;
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

/** S = T xi T^T, or its inverse = T N T^T: T has m^(-1/2) and I_k^(-1/2) (A e_k)^T, or their reciprocals. */
void Fluid::scaleToZ(Group& group, const BodySet& bodies, const FreeParticles& freeParticles, bool inverse) {
    const MatrixXd& matrix = inverse ? group.mobility->mobility() : group.mobility->friction();
    const auto& elements = group.mobility->getElements();
    group.half.resize(group.numZ, matrix.cols());
    group.S.resize(group.numZ, group.numZ);
    const auto weight = [&](double inertia) { return inverse ? sqrt(inertia) : 1 / sqrt(inertia); };
    for (int pass = 0; pass < 2; pass++)
        for (size_t e = 0; e < elements.size(); e++) {
            const int row = group.mobility->firstRow(e), z = group.firstZ[e];
            const double mass =
                elements[e].isFree() ? freeParticles.mass(group.freeIndex[e]) : bodies.inertia(elements[e].body).mass;
            if (pass == 0)
                group.half.middleRows<3>(z) = weight(mass) * matrix.middleRows<3>(row);
            else
                group.S.middleCols<3>(z) = weight(mass) * group.half.middleCols<3>(row);
            if (elements[e].isFree()) continue;
            const BodyInertia& inertia = bodies.inertia(elements[e].body);
            const Matrix3d& A = group.mobility->getTurn(e);
            for (int k = 0, next = z + 3; k < 3; k++) {
                if (!inertia.isLive(k)) continue;
                const Vector3d axis = weight(inertia.moments[k]) * A.col(k);
                if (pass == 0)
                    group.half.row(next++).noalias() = axis.transpose() * matrix.middleRows<3>(row + 3);
                else
                    group.S.col(next++).noalias() = group.half.middleCols<3>(row + 3) * axis;
            }
        }
}

/** The same by Lanczos on S^-1 = T N T^T (T as in scaleToZ), of which products are enough. */
void Fluid::relaxMatrixFree(Group& group, double h, double kT, const BodySet& bodies,
                            const FreeParticles& freeParticles) {
    const auto& elements = group.mobility->getElements();
    // x -> T^T x, and velocities -> T velocities.
    const auto scale = [&](const MatrixXd& from, MatrixXd& to, bool fromZ) {
        to.resize(fromZ ? group.mobility->getNumRows() : group.numZ, from.cols());
        for (size_t e = 0; e < elements.size(); e++) {
            const int z = group.firstZ[e], row = group.mobility->firstRow(e);
            if (elements[e].isFree()) {
                to.middleRows<3>(fromZ ? row : z) =
                    sqrt(freeParticles.mass(group.freeIndex[e])) * from.middleRows<3>(fromZ ? z : row);
                continue;
            }
            const BodyInertia& inertia = bodies.inertia(elements[e].body);
            to.middleRows<3>(fromZ ? row : z) = sqrt(inertia.mass) * from.middleRows<3>(fromZ ? z : row);
            if (fromZ) to.middleRows<3>(row + 3).setZero();
            for (int k = 0, next = z + 3; k < 3; k++) {
                if (!inertia.isLive(k)) continue;
                const Vector3d axis = sqrt(inertia.moments[k]) * group.mobility->getTurn(e).col(k);
                if (fromZ)
                    to.middleRows<3>(row + 3).noalias() += axis * from.row(next++);
                else
                    to.row(next++).noalias() = axis.transpose() * from.middleRows<3>(row + 3);
            }
        }
    };
    const auto product = [&](double toleranceOfProducts) {
        return [&, toleranceOfProducts](const MatrixXd& x, MatrixXd& y) {
            scale(x, group.wrenches, true);
            group.mobility->applyMatrixFree(group.wrenches, innerTolerance * force.getSolverTolerance(), group.twists,
                                            toleranceOfProducts);
            scale(group.twists, y, false);
        };
    };
    vector<SpectralFunction> functions = {SpectralFunction::decay(h)};
    group.columns.resize(group.numZ, kT > 0 ? 2 : 1);
    group.columns.col(0) = group.Z;
    if (kT > 0) {
        group.columns.col(1) = sqrt(kT) * group.chi;
        functions.push_back(SpectralFunction::decayNoise(h));
    }
    group.lanczos->apply(product(0), group.columns, functions, group.results, Lanczos::NormOfSum,
                         product(force.getSolverTolerance()));
    if (!group.lanczos->isIncrement(0)) group.Z.setZero();
    for (int c = 0; c < group.results.cols(); c++) group.Z += group.results.col(c);
    group.iterations += group.lanczos->getNumIterations();
}

void Fluid::relaxGroup(Group& group, double h, double kT, const NoiseStream& noise, BodySet& bodies,
                       const FreeParticles& freeParticles, const vector<OpenMM::Vec3>& positions,
                       vector<OpenMM::Vec3>& velocities) {
    const auto& elements = group.mobility->getElements();
    const bool constant = group.mobility->isConstantInBodyFrame();
    group.randomNumbers = group.iterations = 0;
    if (constant)
        group.poses[0] = poseOf(bodies, elements[0].body);
    else
        setPoses(group, bodies, positions);

    const Matrix3d A = constant ? group.poses[0].rotation() : Matrix3d();

    // Z = K^(1/2) (p, l). One body's constant process is known in its own frame, so its p is turned there.
    group.Z.resize(group.numZ);
    group.chi.resize(group.numZ);
    for (size_t e = 0; e < elements.size(); e++) {
        const int z = group.firstZ[e];
        double numbers[6];
        if (elements[e].isFree()) {
            const int p = elements[e].particles[0];
            group.Z.segment<3>(z) = sqrt(freeParticles.mass(group.freeIndex[e])) * toEigen(velocities[p]);
            if (kT == 0) continue;
            loops.fillNoise(noise, NoiseStream::FreeFirstDraw, &p, 1, numbers);
            group.chi.segment<3>(z) = Vector3d(numbers[0], numbers[1], numbers[2]);
            group.randomNumbers += 3;
            continue;
        }
        const int b = elements[e].body, s = bodies.slot(b);
        const BodyInertia& inertia = bodies.inertia(b);
        group.Z.segment<3>(z) = Vector3d(bodies.p[0][s], bodies.p[1][s], bodies.p[2][s]) / sqrt(inertia.mass);
        // Langevin C's numbers, so that with constant isotropic friction this is Langevin C (CONVENTIONS.md).
        if (kT > 0) {
            for (int k = 0; k < 3; k++) noise.pair(NoiseStream::FirstDraw, b, k, numbers[2 * k], numbers[2 * k + 1]);
            group.chi.segment<3>(z) = Vector3d(numbers[0], numbers[1], numbers[2]);
            group.randomNumbers += 3 + group.numLive[e];
        }
        for (int k = 0, next = z + 3; k < 3; k++) {
            if (!inertia.isLive(k)) continue;
            if (kT > 0) group.chi[next] = numbers[3 + k];
            group.Z[next++] = bodies.l[k][s] / sqrt(inertia.moments[k]);
        }
        if (constant) {
            group.Z.segment<3>(z) = (A.transpose() * group.Z.segment<3>(z)).eval();
            group.chi.segment<3>(z) = (A.transpose() * group.chi.segment<3>(z)).eval();
        }
    }

    if (constant) {
        if (group.constantH != h) {
            group.mobility->setPoses({Pose()});
            scaleToZ(group, bodies, freeParticles, false);
            group.process.decompose(group.S, false);
            group.process.matrices(h, group.decay, group.noise);
            group.constantH = h;
        }
        group.half.noalias() = group.decay * group.Z;
        group.Z += group.half.col(0);
        if (kT > 0) {
            group.half.noalias() = group.noise * group.chi;
            group.Z += sqrt(kT) * group.half.col(0);
        }
        group.Z.segment<3>(0) = (A * group.Z.segment<3>(0)).eval();
    } else if (group.solvesMatrixFree) {
        relaxMatrixFree(group, h, kT, bodies, freeParticles);
    } else {
        // A dead axis makes S a part of K^(1/2) xi K^(1/2), whose inverse is not that part of the mobility.
        const bool inverse = group.deadAxesAreNull && !group.mobility->prefersFriction();
        scaleToZ(group, bodies, freeParticles, inverse);
        group.process.decompose(group.S, inverse);
        group.process.step(h, kT, group.Z, group.chi);
    }

    for (size_t e = 0; e < elements.size(); e++) {
        const int z = group.firstZ[e];
        if (elements[e].isFree()) {
            velocities[elements[e].particles[0]] =
                toVec3(group.Z.segment<3>(z) / sqrt(freeParticles.mass(group.freeIndex[e])));
            continue;
        }
        const int s = bodies.slot(elements[e].body);
        const BodyInertia& inertia = bodies.inertia(elements[e].body);
        for (int k = 0; k < 3; k++) bodies.p[k][s] = sqrt(inertia.mass) * group.Z[z + k];
        for (int k = 0, next = z + 3; k < 3; k++)
            if (inertia.isLive(k)) bodies.l[k][s] = sqrt(inertia.moments[k]) * group.Z[next++];
    }
}

LoopResult Fluid::relax(double h, double kT, const NoiseStream& noise, BodySet& bodies,
                        const FreeParticles& freeParticles, const vector<OpenMM::Vec3>& positions,
                        vector<OpenMM::Vec3>& velocities) {
    const OneBlasThread single;
    const auto task = [&](int i) {
        relaxGroup(*coupledGroups[i], h, kT, noise, bodies, freeParticles, positions, velocities);
    };
    if (operationsPerStep > worthThreads)
        loops.forTasks(coupledGroups.size(), task);
    else
        for (size_t i = 0; i < coupledGroups.size(); i++) task(i);
    LoopResult result;
    for (const Group* group : coupledGroups) {
        result.randomNumbers += group->randomNumbers;
        numSquareRoots += kT > 0;
        numIterations += group->iterations;
        result.finite = result.finite && group->Z.allFinite();
    }
    return result;
}

// ---- What users ask for ----

namespace {

/** Scatter a group's 6 x 6 blocks into the matrix of all bodies. */
void scatterBlocks(const MatrixXd& from, const BodyMobility& mobility, MatrixXd& to) {
    const auto& elements = mobility.getElements();
    for (size_t i = 0; i < elements.size(); i++)
        for (size_t k = 0; k < elements.size(); k++)
            if (!elements[i].isFree() && !elements[k].isFree())
                to.block<6, 6>(6 * elements[i].body, 6 * elements[k].body) =
                    from.block<6, 6>(mobility.firstRow(i), mobility.firstRow(k));
}

}  // namespace

MatrixXd Fluid::mobility(const BodySet& bodies, const vector<OpenMM::Vec3>& positions) {
    const OneBlasThread single;
    MatrixXd result = MatrixXd::Zero(6 * groupOfBody.size(), 6 * groupOfBody.size());
    for (auto& group : groups) {
        setPoses(*group, bodies, positions);
        scatterBlocks(answersByColumns(*group) ? group->mobility->mobilityByIterations(force.getSolverTolerance())
                                               : group->mobility->mobility(),
                      *group->mobility, result);
    }
    return result;
}

MatrixXd Fluid::friction(const BodySet& bodies, const vector<OpenMM::Vec3>& positions) {
    const OneBlasThread single;
    MatrixXd result = MatrixXd::Zero(6 * groupOfBody.size(), 6 * groupOfBody.size());
    for (auto& group : groups) {
        setPoses(*group, bodies, positions);
        const auto& elements = group->mobility->getElements();
        bool hasFree = false;
        for (const FluidElement& element : elements) hasFree = hasFree || element.isFree();
        if (!hasFree) {
            scatterBlocks(group->mobility->friction(), *group->mobility, result);
            continue;
        }
        // Free particles are force-free, so this is the inverse of the bodies' part of the mobility: Schur's complement.
        vector<int> bodyRows, freeRows;
        for (size_t e = 0; e < elements.size(); e++)
            for (int i = 0; i < elements[e].numRows(); i++)
                (elements[e].isFree() ? freeRows : bodyRows).push_back(group->mobility->firstRow(e) + i);
        if (bodyRows.empty()) continue;
        MatrixXd xi = group->mobility->friction();
        const MatrixXd coupling = xi(freeRows, bodyRows);
        const MatrixXd schur =
            xi(bodyRows, bodyRows) - coupling.transpose() * MatrixXd(xi(freeRows, freeRows)).llt().solve(coupling);
        for (size_t i = 0; i < bodyRows.size(); i++)
            for (size_t k = 0; k < bodyRows.size(); k++) xi(bodyRows[i], bodyRows[k]) = schur(i, k);
        scatterBlocks(xi, *group->mobility, result);
    }
    return result;
}

VectorXd Fluid::apply(const VectorXd& wrenches, const BodySet& bodies, const vector<OpenMM::Vec3>& positions) {
    const OneBlasThread single;
    VectorXd result = VectorXd::Zero(wrenches.size());
    MatrixXd f, u;
    for (auto& group : groups) {
        setPoses(*group, bodies, positions);
        const auto& elements = group->mobility->getElements();
        f.setZero(group->mobility->getNumRows(), 1);
        for (size_t e = 0; e < elements.size(); e++)
            if (!elements[e].isFree()) {
                const Eigen::Matrix<double, 6, 1> wrench = wrenches.segment<6>(6 * elements[e].body);
                f.middleRows<6>(group->mobility->firstRow(e)) = wrench;
                if (group->hasNullVectors)
                    checkTorque(*group, e, twoRotations(group->mobility->getTurn(e)).transpose() * wrench, 0);
            }
        if (group->answersMatrixFree)
            group->mobility->applyMatrixFree(f, force.getSolverTolerance(), u);
        else
            group->mobility->apply(f, u);
        for (size_t e = 0; e < elements.size(); e++)
            if (!elements[e].isFree())
                result.segment<6>(6 * elements[e].body) = u.middleRows<6>(group->mobility->firstRow(e));
    }
    return result;
}

VectorXd Fluid::applyToBlobs(const VectorXd& forces, const BodySet& bodies, const vector<OpenMM::Vec3>& positions) {
    const OneBlasThread single;
    VectorXd result = VectorXd::Zero(forces.size());
    for (auto& group : groups) {
        setPoses(*group, bodies, positions);
        group->mobility->applyToParticles(forces, result);
    }
    return result;
}

string Fluid::objection(const BodySet& bodies, const vector<OpenMM::Vec3>& positions) const {
    for (const auto& group : groups) {
        const string text = objection(*group, bodies, positions);
        if (!text.empty()) return text;
    }
    return {};
}

string Fluid::objection(const Group& group, const BodySet& bodies, const vector<OpenMM::Vec3>& positions) const {
    if (!group.mobility->mayObject()) return {};
    vector<Pose> poses = group.poses;
    const auto& elements = group.mobility->getElements();
    for (size_t e = 0; e < elements.size(); e++)
        if (elements[e].isFree())
            poses[e].R = toEigen(positions[elements[e].particles[0]]);
        else
            poses[e] = poseOf(bodies, elements[e].body);
    return group.mobility->objection(poses);
}

void Fluid::setBox(const BoxVectors& box) {
    for (auto& group : groups) group->mobility->setBox(box);
}

bool Fluid::mayObject() const {
    for (const auto& group : groups)
        if (group->mobility->mayObject()) return true;
    return false;
}

int Fluid::numInteracting() const {
    int sum = 0;
    for (const auto& group : groups)
        if (group->poses.size() > 1) sum += group->poses.size();
    return sum;
}

int Fluid::numCollinear() const {
    int sum = 0;
    for (const auto& group : groups)
        for (size_t e = 0; e < group->poses.size(); e++) sum += group->mobility->hasNullVector(e);
    return sum;
}

string Fluid::describe(bool overdamped) const {
    int bodies = 0, free = 0, thermostats = 0, constant = 0, dense = 0, matrixFree = 0;
    for (int g : groupOfBody) bodies += g >= 0;
    for (int g : groupOfFree) free += g >= 0;
    for (const auto& group : groups)
        (group->isThermostat && !overdamped                                     ? thermostats
         : group->mobility->isConstantInBodyFrame()                             ? constant
         : (overdamped ? group->overdampedMatrixFree : group->solvesMatrixFree) ? matrixFree
                                                                                : dense)++;
    ostringstream text;
    text << modelName(force.getModel());
    if (force.getBoundary() == MobilityForce::NoSlipWall)
        text << " above a no-slip wall at z = " << force.getWallHeight()
             << " nm (steps are redone after which a particle "
             << (wallRejection == CustomRigidHIIntegrator::Crossing ? "has its centre behind it)" : "overlaps it)");
    text << ", " << bodies << " bodies and " << free << " free particles; ";
    if (!overdamped) text << thermostats << " alone with constant isotropic drag (no matrices), ";
    text << constant << " alone with a constant tensor (computed once), " << dense << " groups with dense matrices, "
         << matrixFree << " groups matrix-free";
    return text.str();
}

string Fluid::describeAnswers() const {
    int constant = 0, dense = 0, products = 0, iterations = 0, columns = 0;
    for (const auto& group : groups) {
        columns += answersByColumns(*group);
        (group->mobility->isConstantInBodyFrame()         ? constant
         : group->mobility->multipliesWithoutIterations() ? products
         : group->answersMatrixFree                       ? iterations
                                                          : dense)++;
    }
    const auto list = [](const vector<pair<int, string> >& ways) {
        string all;
        for (const auto& way : ways)
            if (way.first > 0)
                all += (all.empty() ? "" : ", ") + to_string(way.first) + (way.first == 1 ? " group " : " groups ") +
                       way.second;
        return all.empty() ? string("no groups") : all;
    };
    ostringstream tolerance;
    tolerance << "by iterations to " << force.getSolverTolerance();
    const string known = "by a constant tensor", matrices = "by dense matrices";
    return "applyMobilityInContext() does " +
           list({{constant, known},
                 {products, "by products without a matrix"},
                 {iterations, tolerance.str()},
                 {dense, matrices}}) +
           "; getMobilityInContext() " +
           list({{constant, known},
                 {columns, tolerance.str() + ", column by column"},
                 {int(groups.size()) - constant - columns, matrices}}) +
           "; getFrictionInContext() " + list({{constant, known}, {int(groups.size()) - constant, matrices}});
}

void Fluid::continueFrom(Fluid& before) {
    numIterations = before.numIterations;
    numSquareRoots = before.numSquareRoots;
    productsBefore = before.numProducts();
    matricesBefore = before.numMatrices();
    overdampedScheme_ = before.overdampedScheme_;
    for (size_t g = 0; g < groups.size() && groups.size() == before.groups.size(); g++)
        if (groups[g]->mobility->getNumRows() == before.groups[g]->mobility->getNumRows())
            groups[g]->scheme = move(before.groups[g]->scheme);
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
