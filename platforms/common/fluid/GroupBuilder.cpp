#include "fluid/GroupBuilder.h"

#include <algorithm>
#include <cmath>

#include "linearalgebra/OneBlasThread.h"
#include "mobility/GridChoice.h"
#include "mobility/Models.h"
#include "openmmrigidhi/internal/Errors.h"
#include "openmmrigidhi/internal/Messages.h"
#include "rigidbody/EigenVec3.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

namespace {

/**
 * Up to this number of rows Auto decomposes matrices, and above it uses Lanczos. 30 spheres have
 * this number; there Lanczos becomes faster at the default tolerance.
 */
const int largestDenseRows = 180;
/** The same limit for the particles of multiblobs, whose matrix is factorised. */
const int largestDenseParticleRows = 1500;

/**
 * The same limit for schemes without momenta, which need few iterations. 8 boomerangs of 15 blobs
 * have this number of particle rows; there both methods take equally long at the default tolerance.
 */
const int largestDenseOverdampedRows = 360;

/** Rounding that a product of rotations leaves in a tensor. */
const double isotropyTolerance = 1e-13;

/** Whether a friction tensor is isotropic in translation, diagonal in rotation, and without
 * coupling. */
bool isThermostatTensor(const MatrixXd& friction) {
    for (int i = 0; i < friction.rows(); i++)
        for (int k = 0; k < friction.cols(); k++)
            if (i != k && abs(friction(i, k)) >
                              isotropyTolerance * sqrt(abs(friction(i, i) * friction(k, k))))
                return false;
    return abs(friction(0, 0) - friction(1, 1)) <= isotropyTolerance * friction(0, 0) &&
           abs(friction(0, 0) - friction(2, 2)) <= isotropyTolerance * friction(0, 0);
}

/** Whether LubricatedMobility adds lubrication to a model that has none of its own. */
bool isLubricatedByPairs(const MobilityForce& force) {
    return hasLubrication(force) && force.getModel() != MobilityForce::StokesianDynamics;
}

/** Whether the settings (MatrixFree) put StokesianDynamics on a grid. */
bool isStokesianGrid(const MobilityForce& force) {
    return force.getModel() == MobilityForce::StokesianDynamics &&
           force.getSolver() == MobilityForce::MatrixFree &&
           traitsOf(force.getModel()).hasGrid(force.getBoundary());
}

/** The object whose products are iterations, for messages. */
string whatIterates(const MobilityForce& force) {
    return (isLubricatedByPairs(force) ? "lubrication of model " : "model ") +
           string(modelName(force.getModel()));
}

[[noreturn]] void refuseMatrixFree(const MobilityForce& force) {
    failFluid("solver MatrixFree cannot be used with model " + string(modelName(force.getModel())) +
              "; use setSolver(Dense), or setModel(RotnePragerYamakawa)");
}

}  // namespace

/**
 * Form the groups, in the order of their labels. Without interaction every body is a group of its
 * own. The elements do not yet have what needs the shapes of bodies: sites, own tensors, slips and
 * forces on the fluid.
 */
GroupBuilder::GroupBuilder(const MobilityForce& force, const FluidSettings& settings,
                           const OpenMM::System& system,
                           const vector<vector<int>>& particlesOfBodies,
                           const FreeParticles& freeParticles, PlatformLoops& loops)
    : force(force), settings(settings), particlesOfBodies(particlesOfBodies),
      freeParticles(freeParticles), loops(loops), flow(force),
      indexOfFree(system.getNumParticles(), -1) {
    system.getDefaultPeriodicBoxVectors(defaultBox[0], defaultBox[1], defaultBox[2]);
    const int numBodies = particlesOfBodies.size();
    const bool freeDraining = force.getModel() == MobilityForce::FreeDraining;
    if (force.getNumParticles() != system.getNumParticles())
        failFluid(
            "it has " + to_string(force.getNumParticles()) + " radii, but the System has " +
            to_string(system.getNumParticles()) +
            " particles; call addParticle() once for each particle of the System, with radius 0 "
            "where the fluid does not see it");
    flow.check();
    const vector<int>& labels = force.getGroups();
    if (!labels.empty() && (int)labels.size() != numBodies)
        failFluid("setGroups() was given " + to_string(labels.size()) +
                  " groups, but the integrator has " + to_string(numBodies) +
                  " bodies; give one group for each body");
    for (int b : force.getBodiesWithOwnTensors()) {
        if (b >= numBodies)
            failFluid("body " + to_string(b) +
                      " was given a tensor of its own, but the integrator has " +
                      to_string(numBodies) + " bodies, counted from 0");
        if (!traitsOf(force.getModel()).takesMultiblobs)
            failFluid("body " + to_string(b) + " was given a tensor of its own, which model " +
                      modelName(force.getModel()) +
                      " cannot take; use RotnePragerYamakawa or FreeDraining");
    }
    checkSlips();
    checkForcesOnFluid();
    checkLubrication();
    checkIterations();

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
            failFluid(
                "body " + to_string(b) +
                " has no particle with a hydrodynamic radius, so the fluid would not see it; give "
                "at least one of its particles a radius above 0");
        if (settings.heldBodies.count(b)) element.hold();
        const auto prescribed = settings.prescribed.find(b);
        if (prescribed != settings.prescribed.end()) {
            element.fixed = prescribed->second.components;
            element.fixedInBody = prescribed->second.inBody;
        }
        elementsOfGroups[freeDraining     ? nextGroup++
                         : labels.empty() ? 0
                                          : labels[b]]
            .push_back(element);
    }
    vector<char> known(system.getNumParticles(), false);
    for (int p : freeParticles.getParticles()) {
        known[p] = true;
        if (force.getParticleRadius(p) == 0) continue;
        FluidElement element;
        element.particles = {p};
        element.radii = {force.getParticleRadius(p)};
        if (settings.heldParticles.count(p)) element.hold();
        elementsOfGroups[freeDraining ? nextGroup++ : 0].push_back(element);
    }
    for (const vector<int>& particles : particlesOfBodies)
        for (int p : particles) known[p] = true;
    for (int p = 0; p < system.getNumParticles(); p++)
        if (force.getParticleRadius(p) > 0 && !known[p])
            failFluid("particle " + to_string(p) + " has hydrodynamic radius " +
                      to_string(force.getParticleRadius(p)) +
                      " nm but is a virtual site in no body, which the fluid cannot move; make "
                      "this site part of a body, or give it radius 0");
    for (int i = 0; i < freeParticles.getNumParticles(); i++)
        indexOfFree[freeParticles.getParticles()[i]] = i;
    // Held elements come first, so that their part of the matrices stays together.
    for (auto& entry : elementsOfGroups)
        stable_partition(entry.second.begin(), entry.second.end(),
                         [](const FluidElement& element) { return element.isHeld; });
}

void GroupBuilder::checkSlips() const {
    const int numBodies = particlesOfBodies.size();
    for (int b : force.getBodiesWithSlip()) {
        const string object = "body " + to_string(b) + " was given a slip, ";
        if (b >= numBodies)
            failFluid(object + "but the integrator has " + to_string(numBodies) +
                      " bodies, counted from 0; clearBodySlip() removes it");
        int particles = 0;
        for (int p : particlesOfBodies[b]) particles += force.getParticleRadius(p) > 0;
        if (particles < 2)
            failFluid(
                object + "but has " + to_string(particles) +
                " hydrodynamic particles; the models have no stresslet sources for the surface of "
                "a single sphere, so that its flow would be wrong: make the body of at least 2 "
                "blobs, such as those of app.multiblobSphere(), or use clearBodySlip()");
        const int velocities = force.getBodySlip(b).size();
        if (velocities != particles)
            failFluid(
                object + "of " + to_string(velocities) + " velocities, but has " +
                to_string(particles) +
                " hydrodynamic particles; give setBodySlip() one velocity for each particle of "
                "the body with a radius above 0, in their order");
    }
}

void GroupBuilder::checkForcesOnFluid() const {
    const int numBodies = particlesOfBodies.size();
    for (int i = 0; i < force.getNumBodyForcesOnFluid(); i++) {
        const auto [b, unused] = forceOnFluid(i);
        const string object = "force " + to_string(i) + " on the fluid (addBodyForceOnFluid()) ";
        if (b >= numBodies)
            failFluid(object + "is meant for body " + to_string(b) + ", but the integrator has " +
                      to_string(numBodies) + " bodies, counted from 0");
        int particles = 0;
        for (int p : particlesOfBodies[b]) particles += force.getParticleRadius(p) > 0;
        if (particles == 0)
            failFluid(
                object + "is that of body " + to_string(b) +
                ", none of whose particles the fluid sees; give one of them a radius above 0");
        if (force.getModel() == MobilityForce::StokesianDynamics)
            failFluid(
                object +
                "is at a site without a surface, which model StokesianDynamics has no lubrication "
                "for; use setModel(RotnePragerYamakawa)");
    }
}

/** Refuse settings that the iterations of spheres with lubrication or stresslets do not support. */
void GroupBuilder::checkIterations() const {
    if (force.getSolver() != MobilityForce::MatrixFree ||
        !(isLubricatedByPairs(force) || isStokesianGrid(force)))
        return;
    const string start = whatIterates(force) + " cannot be used with solver MatrixFree and ";
    if (force.getMinimumGap() > 0)
        failFluid(
            start + "the minimum gap " + text(force.getMinimumGap()) +
            "; use setSolver(Dense), or setMinimumGap(0), with which steps to overlaps are redone");
    const SchemeTraits& scheme = traitsOf(settings.scheme);
    if (scheme.kind == SchemeKind::FluidThermostat)
        failFluid(
            start + "scheme " + scheme.name +
            ", whose friction is stiff where spheres are close; use setSolver(Dense), or a scheme "
            "without momenta, such as TractionEulerMaruyama");
    if (scheme.differenced == Differenced::Roots)
        failFluid(start + "scheme " + scheme.name +
                  ", whose differences of random velocities know nothing of lubrication; use "
                  "TractionEulerMaruyama, or setSolver(Dense)");
}

/** Refuse settings that lubrication of models other than StokesianDynamics does not support. */
void GroupBuilder::checkLubrication() const {
    if (!isLubricatedByPairs(force)) return;
    const BoundaryTraits& boundary = traitsOf(force.getBoundary());
    if (boundary.hasWalls() && settings.wallRejection == CustomRigidHIIntegrator::Crossing)
        failFluid(
            "lubrication is known only for spheres that do not overlap the wall, so it cannot be "
            "used with the wall rejection Crossing; use setWallRejection(Overlap) or "
            "setLubrication(Off)");
    if (force.getSphereWallMobility() == MobilityForce::BestKnown)
        failFluid(
            "lubrication has the exact mobility of single spheres at the wall already, so it "
            "cannot be used with sphere-wall mobility BestKnown; use "
            "setSphereWallMobility(FromModel) or setLubrication(Off)");
    for (int b : force.getBodiesWithOwnTensors()) {
        int particles = 0;
        for (int p : particlesOfBodies[b]) particles += force.getParticleRadius(p) > 0;
        if (particles == 1)
            failFluid(
                "body " + to_string(b) +
                " is a single sphere with a tensor of its own, and lubrication is known only for "
                "spheres with the mobility of their radius; use setLubrication(Off), "
                "clearBodyTensor(), or make the body of several blobs");
    }
}

/** A force on the fluid and the index of its body, in the user's body frame. */
pair<int, ForceOnFluid> GroupBuilder::forceOnFluid(int index) const {
    int body;
    OpenMM::Vec3 site, onFluid;
    ForceOnFluid result;
    force.getBodyForceOnFluidParameters(index, body, site, result.radius, onFluid);
    result.site = toEigen(site);
    result.force = toEigen(onFluid);
    return {body, result};
}

/**
 * Add the sites of particles, and in the inner frame the body's own tensor, the slips of
 * particles, and forces on the fluid.
 */
void GroupBuilder::addShape(FluidElement& element, const vector<BodyGeometry>& geometries,
                            const BodySet& bodies) const {
    if (element.isFree()) {
        element.sites = {Vector3d::Zero()};
        return;
    }
    const int b = element.body;
    if (element.fixedInBody) element.axes = userAxes(bodies, b);
    for (size_t i = 0; i < particlesOfBodies[b].size(); i++)
        if (force.getParticleRadius(particlesOfBodies[b][i]) > 0)
            element.sites.push_back(toEigen(bodies.toInner(b, geometries[b].sites[i])));
    for (int active : force.getBodiesWithSlip())
        if (active == b)
            for (const OpenMM::Vec3& velocity : force.getBodySlip(b))
                element.slips.push_back(toEigen(bodies.toInner(b, velocity)));
    for (int i = 0; i < force.getNumBodyForcesOnFluid(); i++) {
        auto [owner, own] = forceOnFluid(i);
        if (owner != b) continue;
        own.site = toEigen(bodies.toInner(b, toVec3(own.site)));
        own.force = toEigen(bodies.toInner(b, toVec3(own.force)));
        element.forcesOnFluid.push_back(own);
    }
    if (!force.getBodyHasOwnTensor(b)) return;
    const vector<double> user = force.getBodyMobility(b);
    Matrix3d toInner;
    for (int k = 0; k < 3; k++)
        toInner.col(k) = toEigen(bodies.toInner(b, OpenMM::Vec3(k == 0, k == 1, k == 2)));
    const Matrix<double, 6, 6> turn = twoRotations(toInner);
    element.ownMobility =
        turn * Map<const Matrix<double, 6, 6, RowMajor>>(user.data()) * turn.transpose();
}

unique_ptr<MobilityModel> GroupBuilder::makeModel(const HydrodynamicParticles& particles,
                                                  bool mayUseThreads, GridChoice& choice) const {
    choice = chooseGrid(force, settings.scheme, defaultBox, particles);
    MobilityScene scene;
    scene.crossingAllowed = settings.wallRejection == CustomRigidHIIntegrator::Crossing;
    scene.onGrid = choice.onGrid;
    return loops.createMobility(force, scene, particles, mayUseThreads);
}

void GroupBuilder::checkModels() const {
    for (const auto& entry : elementsOfGroups) {
        const HydrodynamicParticles particles = particlesOf(entry.second);
        if (particles.size() == 0) continue;
        GridChoice choice;
        const auto model = makeModel(particles, false, choice);
        if (flow.hasWave() && model->box())
            model->box()->checkWave(defaultBox, flow.waveAxis, flow.waveVectorIndex);
        // The tensor of one element in a uniform fluid is constant, so that it never needs a solve.
        const bool isAlone = entry.second.size() == 1 && model->getTraits().isHomogeneous &&
                             model->getTraits().isIsotropic;
        if (force.getSolver() == MobilityForce::MatrixFree && !model->getTraits().hasProducts &&
            !isAlone)
            refuseMatrixFree(force);
    }
}

vector<unique_ptr<FluidGroup>> GroupBuilder::build(const vector<BodyGeometry>& geometries,
                                                   const BodySet& bodies) const {
    const OneBlasThread single;  // constant tensors are computed here
    auto complete = elementsOfGroups;
    for (auto& entry : complete)
        for (FluidElement& element : entry.second) addShape(element, geometries, bodies);
    vector<unique_ptr<FluidGroup>> groups;
    for (const auto& entry : complete) groups.push_back(makeGroup(entry.second, bodies));
    return groups;
}

unique_ptr<FluidGroup> GroupBuilder::makeGroup(const vector<FluidElement>& elements,
                                               const BodySet& bodies) const {
    const bool mayUseThreads = elementsOfGroups.size() == 1;  // several groups are spread over them
    GridChoice choice, ofSites;  // of the bodies' particles, and with sites of forces
    bool areSites = false;
    auto group = make_unique<FluidGroup>(
        elements,
        [&](const HydrodynamicParticles& particles) {
            GridChoice& own = areSites ? ofSites : choice;
            areSites = true;
            return makeModel(particles, mayUseThreads, own);
        },
        force.getSolverTolerance(), shapes);
    group->gridChoice = choice.text();
    vector<FluidElement> fixed;
    bool isDriven = false;
    for (const FluidElement& element : elements) {
        if (element.isWhollyFixed()) fixed.push_back(element);
        isDriven = isDriven || (element.isWhollyFixed() && !element.isHeld);
    }
    GridChoice unused;
    if (isDriven)
        group->wholly =
            make_unique<CoupledBodies>(fixed, [&](const HydrodynamicParticles& particles) {
                return makeModel(particles, mayUseThreads, unused);
            });
    group->dependsOnScheme =
        choice.isEstimated() || isLubricatedByPairs(force) || isStokesianGrid(force);
    for (size_t e = 0; e < elements.size(); e++) {
        group->members.freeIndex.push_back(
            elements[e].isFree() ? indexOfFree[elements[e].particles[0]] : -1);
        group->hasNullVectors = group->hasNullVectors || group->bodies.hasNullVector(e);
    }
    makeJoints(*group, bodies);
    chooseStrategies(*group, bodies);
    if (force.getSolver() == MobilityForce::Auto && makesMatrices(*group))
        group->columns = choice.columns;
    if (group->joints) {
        group->brownian->setJoints(group->joints.get(), settings.jointTolerance,
                                   settings.poseTolerance);
        group->brownian->setMotorRates(settings.motors);
    }
    return group;
}

/** Whether the steps of a group make matrices. */
bool GroupBuilder::makesMatrices(const FluidGroup& group) const {
    if (traitsOf(settings.scheme).isOverdamped())
        return group.brownian->getMobility().getWay() == BodyMobility::Dense;
    return group.relaxation && group.relaxation->getMobility().getWay() == BodyMobility::Dense;
}

/** The joints between the group's bodies, in the inner frames of the bodies. */
void GroupBuilder::makeJoints(FluidGroup& group, const BodySet& bodies) const {
    const auto& elements = group.bodies.getElements();
    const auto elementOf = [&](int body) {
        for (size_t e = 0; e < elements.size(); e++)
            if (elements[e].body == body) return (int)e;
        return -1;
    };
    const auto inner = [&](int body, const OpenMM::Vec3& x) {
        return toEigen(bodies.toInner(body, x));
    };
    vector<Joint> joints;
    for (size_t k = 0; k < settings.joints.size(); k++) {
        const JointDefinition& wanted = settings.joints[k];
        Joint joint;
        joint.index = k;
        joint.name = jointText(k, wanted);
        joint.i = elementOf(wanted.i);
        if (joint.i < 0) continue;
        joint.j = -1;
        joint.anchor_i = inner(wanted.i, wanted.anchor_i);
        if (wanted.kind == JointDefinition::BallToPoint) {
            joint.kind = Joint::BallToPoint;
            joint.anchor_j = toEigen(wanted.anchor_j);
            joints.push_back(joint);
            continue;
        }
        joint.j = elementOf(wanted.j);
        joint.kind = wanted.kind == JointDefinition::Link    ? Joint::Link
                     : wanted.kind == JointDefinition::Hinge ? Joint::Hinge
                                                             : Joint::Ball;
        joint.anchor_j = inner(wanted.j, wanted.anchor_j);
        joint.length = wanted.length;
        if (joint.kind == Joint::Hinge) {
            joint.axis_i = inner(wanted.i, wanted.axis_i).normalized();
            joint.axis_j = inner(wanted.j, wanted.axis_j).normalized();
        }
        for (size_t m = 0; m < settings.motors.size(); m++)
            if (settings.motors[m].hinge == joint.index) joint.motor = m;
        joints.push_back(joint);
    }
    if (!joints.empty()) group.joints = make_unique<Joints>(joints, group.bodies);
}

void GroupBuilder::chooseStrategies(FluidGroup& group, const BodySet& bodies) const {
    const CoupledBodies& coupled = group.bodies;
    const auto strategy = [&](bool krylov) -> BodyMobility& {
        return group.mobilities.get(coupled.isConstantInBodyFrame() ? BodyMobility::Constant
                                    : krylov                        ? BodyMobility::Krylov
                                                                    : BodyMobility::Dense);
    };
    const FreeMotion& freeMotion = coupled.getFreeMotion();
    const bool isFixed = freeMotion.any();
    // One element alone has a constant tensor, which may be simple enough for a thermostat.
    if (coupled.isAloneInUniformFluid()) {
        BodyMobility& mobility = strategy(false);
        mobility.setPoses({Pose()});
        const MatrixXd& friction = mobility.friction();
        group.isThermostat =
            isThermostatTensor(friction) && !flow.isAny() && !isFixed && !group.joints;
        group.drag_t = friction(0, 0);
        for (int k = 0; k < 3 && friction.rows() == 6; k++)
            group.drag_r[k] = friction(3 + k, 3 + k);
    }
    const bool solved = !group.isThermostat && !coupled.isConstantInBodyFrame();
    const bool wanted = force.getSolver() == MobilityForce::MatrixFree;
    if (solved && wanted && !coupled.hasProducts()) {
        if (isStokesianGrid(force))
            failFluid(
                whatIterates(force) +
                " cannot be used with solver MatrixFree where bodies of several particles, bodies "
                "with their origin off the centre of their sphere, or held and driven bodies are "
                "among the others; use setSolver(Dense)");
        refuseMatrixFree(force);
    }
    // The iterations that hold bodies do not know the slips of bodies with tensors of their own.
    const bool mayIterate = !isFixed || !coupled.getOwnTensors().any();
    if (solved && wanted && !mayIterate)
        failFluid(
            "solver MatrixFree cannot be used where bodies are held or driven and others in their "
            "group have tensors of their own; use setSolver(Dense), or clearBodyTensor()");
    // Where lubrication does not support MatrixFree, Auto takes matrices.
    const SchemeTraits& scheme = traitsOf(settings.scheme);
    const bool schemeMayIterate =
        !coupled.productsIterate() || (scheme.takesIterations() && force.getMinimumGap() == 0);
    const bool productsOnly = coupled.hasModel() && coupled.getModel().getTraits().isMatrixFree;
    const auto takesKrylov = [&](bool large) {
        return solved && coupled.hasProducts() && mayIterate && schemeMayIterate &&
               (wanted || productsOnly || (force.getSolver() == MobilityForce::Auto && large));
    };
    const int particleRows = coupled.getNumParticleRows();
    group.brownian = make_unique<BrownianGroup>(
        group.members, strategy(takesKrylov(particleRows > largestDenseOverdampedRows)),
        group.alone, force.getSolverTolerance());
    if (isFixed)
        group.holds =
            make_unique<MomentumHolds>(group.members, *group.brownian, force.getSolverTolerance());
    // Answers to users do not depend on inertia. Their strategy is that for masses that fit the
    // fluid, whatever the masses of the bodies are.
    int rows = coupled.getNumRows();
    for (size_t e = 0; e < coupled.getElements().size(); e++) rows -= coupled.hasNullVector(e);
    group.answering =
        &strategy(coupled.multipliesWithoutIterations() ||
                  takesKrylov(rows > largestDenseRows || particleRows > largestDenseParticleRows));
    // Nothing moves if no component is free.
    if (group.isThermostat || freeMotion.getNumFree() == 0) return;
    const MomentumScaling scaling(coupled, group.members.freeIndex, bodies);
    const bool large =
        scaling.getNumRows() > largestDenseRows || particleRows > largestDenseParticleRows;
    group.relaxation = makeRelaxation(strategy(scaling.deadAxesAreNull() && takesKrylov(large)),
                                      scaling, group.members, force.getSolverTolerance());
}

}  // namespace RigidHIPlugin
