// Bodies with some fixed components of motion, including held bodies: their mobility, their holding
// wrenches, and the mean and the covariance of a step.

#include <Eigen/Eigenvalues>

#include "HydrodynamicSupport.h"
#include "StepMoments.h"
#include "mobility/models/confined/ConfinedRotnePragerYamakawa.h"
#include "mobility/models/periodic/PeriodicMobility.h"
#include "mobility/models/rotneprager/RotnePragerYamakawa.h"
#include "mobility/models/stokesian/StokesianDynamics.h"
#include "mobility/models/wall/RotnePragerYamakawaWall.h"
#include "mobility/models/wall/SlipChannel.h"
#include "mobility/models/wall/SphereWall.h"

using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace std;

namespace {

using Integrator = CustomRigidHIIntegrator;
using Scheme = Integrator::Scheme;

/** A way to compute, and the errors that it may have. */
struct Strategy {
    string name;
    bool matrixFree;
    double tolerance;       // of iterations
    double error;           // of results, relative to the largest number
    double difference;      // setFiniteDifferenceStep()
    double h;               // of short steps
    double errorOfMoments;  // of means and covariances of such steps
};
const Strategy byMatrices = {"by matrices", false, 1e-6, 1e-12, 1e-5, 1e-6, 2e-5};
const Strategy matrixFree = {"matrix-free", true, 1e-11, 1e-8, 1e-4, 1e-5, 2e-4};

BodyMobility& strategyOf(TestedBodies& bodies, const Strategy& strategy) {
    BodyMobility& mobility = strategy.matrixFree ? bodies.byProducts() : bodies.byMatrices();
    mobility.setTolerance(strategy.tolerance);
    return mobility;
}

const vector<Scheme> allSchemes = [] {
    vector<Scheme> found;
    for (const SchemeTraits& traits : schemeTable)
        if (traits.isOverdamped()) found.push_back(traits.scheme);
    return found;
}();
/** The mean of DriftCorrectorRFD takes as many steps as all other schemes take, ten times. */
const vector<Scheme> exceptRFD = [] {
    vector<Scheme> found;
    for (Scheme scheme : allSchemes)
        if (scheme != Integrator::DriftCorrectorRFD) found.push_back(scheme);
    return found;
}();

// ---- What is expected

/** The problem of bodies with fixed components and joints, from the friction of all bodies. */
struct Expected {
    MatrixXd Nc, friction;
    MatrixXd response;                // 1 - xi N_c, which gives the wrenches of conditions
    MatrixXd onFixed;                 // of it, what acts on fixed components and not on joints
    MatrixXd ofHolds;                 // the same of xi - xi N_c xi
    VectorXd velocities, holds, all;  // `all`: holds, with the wrenches that joints exert
    Expected(const PosedBodies& scene, TestedBodies& bodies, const vector<Pose>& poses) {
        bodies.setPoses(poses);
        friction = bodies.friction();
        const MatrixXd C = scene.constraints(poses);
        const int n = C.cols();
        const MatrixXd Z = complement(C), ofFree = Z.transpose() * friction * Z;
        Nc = Z * pseudoInverse(ofFree) * Z.transpose();
        for (size_t e = 0; e < scene.elements.size(); e++) removeSpin(scene, C, poses, e);
        // Forces mu of conditions from their wrenches C^T mu.
        const MatrixXd CC = C * C.transpose(), forces = pseudoInverse(CC) * C;
        VectorXd b = VectorXd::Zero(C.rows()), F = VectorXd::Zero(n);
        int numFixed = 0;
        for (size_t e = 0; e < scene.elements.size(); e++)
            for (int k = 0; k < scene.elements[e].numRows(); k++)
                if (scene.elements[e].isFixed(k)) {
                    if (scene.velocities.size() > 0)
                        b[numFixed] = scene.velocities(scene.firstRow(e) + k, 0);
                    numFixed++;
                }
        int row = numFixed;
        for (const Joint& joint : scene.joints) {
            row += joint.numRows();
            if (joint.hasMotor()) b[row - 1] = scene.motorRates[joint.motor];
        }
        if (scene.wrenches.size() > 0) F = scene.wrenches.col(0);
        velocities = forces.transpose() * b;
        velocities += Nc * (F - friction * velocities);
        all = friction * velocities - F;
        const MatrixXd fixedPart = C.topRows(numFixed).transpose() * forces.topRows(numFixed);
        response = MatrixXd::Identity(n, n) - friction * Nc;

        holds = fixedPart * all;
        onFixed = fixedPart * response;
        ofHolds = onFixed * friction * fixedPart.transpose();
    }
    /**
     * Nothing resists the rotation of a rod about its line, if it is free. N_c is the generalised
     * inverse without such rotations.
     */
    void removeSpin(const PosedBodies& scene, const MatrixXd& C, const vector<Pose>& poses, int e) {
        const vector<Vector3d>& sites = scene.elements[e].sites;
        if (sites.size() < 2) return;
        const Matrix3d A = poses[e].rotation();
        const Vector3d line = A * (sites[1] - sites[0]).normalized();
        for (const Vector3d& site : sites)
            if ((A * (site - sites[0])).cross(line).norm() > 1e-9) return;
        VectorXd twist = VectorXd::Zero(Nc.rows());
        const int row = scene.firstRow(e);
        twist.segment<6>(row) << -line.cross(A * sites[0]), line;
        if (C.rows() > 0 && (C * twist).norm() > 1e-9) return;
        MatrixXd Q = MatrixXd::Identity(Nc.rows(), Nc.rows());
        Q.middleCols<3>(row + 3) -= twist * line.transpose();
        Nc = Q * Nc * Q.transpose();
    }
    /** An orthonormal basis of the motions that independent rows C allow. */
    static MatrixXd complement(const MatrixXd& C) {
        const MatrixXd square = C.transpose() * C;
        const Eigen::SelfAdjointEigenSolver<MatrixXd> solver(square);
        return solver.eigenvectors().leftCols(C.cols() - C.rows());
    }
    static MatrixXd pseudoInverse(const MatrixXd& m) {
        if (m.size() == 0) return m;
        const Eigen::SelfAdjointEigenSolver<MatrixXd> solver(m);
        VectorXd inverse = solver.eigenvalues();
        for (double& x : inverse) x = x > 1e-9 * solver.eigenvalues().maxCoeff() ? 1 / x : 0;
        return solver.eigenvectors() * inverse.asDiagonal() * solver.eigenvectors().transpose();
    }
};

/**
 * sum_k d_k N_c,ik, and below it -sum_k d_k of what acts on fixed components (`part`), which is
 * sum_k d_k (xi N_c)_ik where there are no joints: by differences, along twists.
 */
VectorXd divergences(const PosedBodies& scene, MatrixXd Expected::*part = &Expected::onFixed) {
    auto bodies = scene.bodies();
    const int n = scene.numRows();
    const double delta = 3e-5;
    VectorXd sum = VectorXd::Zero(2 * n);
    for (int k = 0; k < n; k++)
        for (int sign : {1, -1}) {
            const Expected there(scene, bodies,
                                 scene.posesAfter(sign * delta * VectorXd::Unit(n, k)));
            sum.head(n) += sign / (2 * delta) * there.Nc.col(k);
            sum.tail(n) -= sign / (2 * delta) * (there.*part).col(k);
        }
    return sum;
}

/**
 * The same from the file, except that files do not have the part of joints in holds by itself, and
 * those with motors have no derivatives.
 */
VectorXd divergenceOfFile(const ReferenceScene& scene) {
    const int n = scene.numRows();
    VectorXd found = scene.joints.empty() ? VectorXd(2 * n) : divergences(scene);
    if (scene.data.has("divNc")) found.head(n) = scene.ofBodies("divNc");
    if (scene.joints.empty()) found.tail(n) = scene.ofBodies("divHold");
    return found;
}

/** The largest difference of entries, relative to the largest entry or to `size`. */
double error(const MatrixXd& found, const MatrixXd& expected, double size = 0) {
    return (found - expected).cwiseAbs().maxCoeff() / max(size, expected.cwiseAbs().maxCoeff());
}

// ---- Scenes

const vector<Vector3d> threeBlobs = {{-1, 0, 0}, {1.2, 0.5, 0.3}, {0.2, -1.4, 1.1}};
const double viscosity = 1 / (6 * M_PI);

unique_ptr<MobilityModel> rotnePrager(const HydrodynamicParticles& particles) {
    return make_unique<RotnePragerYamakawa>(particles, viscosity);
}

PosedBodies named(const string& name, const CoupledBodies::ModelFactory& makeModel) {
    PosedBodies scene;
    scene.name = name;
    scene.makeModel = makeModel;
    return scene;
}

/** Wrenches on all rows, and velocities of fixed components that are not held. */
PosedBodies driven(PosedBodies scene) {
    const int n = scene.numRows();
    scene.wrenches = VectorXd::LinSpaced(n, -0.5, 0.8);
    scene.velocities = MatrixXd::Zero(n, 1);
    for (size_t e = 0; e < scene.elements.size(); e++)
        for (int k = 0; k < scene.elements[e].numRows() && !scene.elements[e].isHeld; k++)
            if (scene.elements[e].isFixed(k))
                scene.velocities(scene.firstRow(e) + k, 0) = 0.1 + 0.05 * k;
    return scene;
}

unsigned bits(const vector<int>& components) {
    unsigned found = 0;
    for (int k : components) found |= 1u << k;
    return found;
}

/** Spheres about their centres, which have a drift beside a held one only. */
PosedBodies spheresBesideAHeldOne() {
    PosedBodies s = named("spheres beside a held one", rotnePrager);
    s.add(fluidElement(0, {{0, 0, 0}}, {1}), {0, 0, 0}, {0.5, 0.2, 0}).hold();
    s.add(fluidElement(1, {{0, 0, 0}}, {0.6}), {1.9, 0.4, -0.5}, {0.1, 0.4, 0});
    s.add(fluidElement(2, {{0, 0, 0}}, {0.8}), {-1.4, 1.7, 0.4});
    s.add(fluidElement(-1, {{0, 0, 0}}, {0.5}), {0.2, 1.3, 1.6});
    return s;
}
PosedBodies lubricatedAtWall() {
    PosedBodies s =
        named("spheres above a wall, one of them held, best known mobilities",
              [](const HydrodynamicParticles& particles) {
                  const NoSlipPlane plane(0, false);
                  return make_unique<SphereWallCongruence>(
                      particles, viscosity, plane, "NoSlipWall",
                      make_unique<RotnePragerYamakawaWall>(particles, viscosity, plane));
              });
    s.add(fluidElement(0, {{0, 0, 0}}, {1}), {0, 0, 1.2}).hold();
    s.add(fluidElement(1, {{0, 0, 0}}, {0.8}), {1.9, 0.4, 1.5}, {0.1, 0.4, 0}).fixed = bits({2, 4});
    return s;
}
PosedBodies ownTensors() {
    PosedBodies s = named("own tensors, one of a held body, one of a body in a plane", rotnePrager);
    const auto tensor = [](int seed) {
        const MatrixXd m = tensorWithoutSymmetry(seed);
        return MatrixXd(m / (m.trace() / 6));
    };
    s.add(fluidElement(0, threeBlobs, {1, 0.8, 1}), {0, 0, 0}, {0.3, 0.1, -0.5}).hold();
    s.elements[0].ownMobility = tensor(1);
    s.add(fluidElement(1, {{0.1, 0, 0.2}}, {0.9}), {2.6, 1.6, 0.5}, {0, 1, 0.3}).ownMobility =
        tensor(2);
    s.elements[1].fixed = bits({2, 3, 4});
    s.add(fluidElement(2, threeBlobs, {0.7, 0.8, 0.6}), {-0.6, 3.2, 1.0}, {1, 0, 0});
    return s;
}
PosedBodies stokesianSpheres() {
    PosedBodies s = named("spheres with lubrication, one of them held",
                          [](const HydrodynamicParticles& particles) {
                              return make_unique<StokesianDynamics>(particles, viscosity, true, 0);
                          });
    s.add(fluidElement(0, {{0, 0, 0}}, {1}), {0, 0, 0}).hold();
    s.add(fluidElement(1, {{0.2, 0, -0.1}}, {0.8}), {1.9, 0.4, 0.5}, {0.1, 0.4, 0});
    s.add(fluidElement(2, {{0, 0, 0}}, {0.9}), {0.3, 2.1, 0.4}).fixed = bits({0, 5});
    return s;
}
PosedBodies blobsInAField() {
    PosedBodies s = named("blobs and particles in a fluid with a random field",
                          [](const HydrodynamicParticles& particles) {
                              return make_unique<RandomFieldModel>(particles);
                          });
    s.add(fluidElement(-1, {{0, 0, 0}}, {0.6}), {-0.6, 1.9, 1.0}).hold();
    s.add(fluidElement(0, threeBlobs, {1, 0.8, 1}), {0, 0, 0}, {0.3, 0.1, -0.5}).fixed =
        bits({1, 3});
    return s;
}
/** A ball between a held body and another, and a hinge with a motor to a third. */
PosedBodies tiedToAHeldOne() {
    PosedBodies s = named("bodies that are joined to each other and to a held one", rotnePrager);
    s.add(fluidElement(0, threeBlobs, {0.9, 0.8, 1}), {0, 0, 0}, {0.3, 0.1, -0.5}).hold();
    for (int b = 1; b < 3; b++)
        s.add(fluidElement(b, threeBlobs, {0.7, 0.8, 0.6}), {2.7 * b, 0.8 * b, 0.5},
              {0.4 * b, -0.2, 0.7});
    // In the frame of an element, a point or a direction of the lab.
    const auto inFrame = [&](int e, const Vector3d& x) {
        return Vector3d(s.poses[e].rotation().transpose() * x);
    };
    const auto anchor = [&](int e, const Vector3d& x) { return inFrame(e, x - s.poses[e].R); };
    const Vector3d first(1.5, 0.9, 0.2), second(4.2, 1, -0.3), axis(0.6, 0, 0.8);
    Joint ball;
    ball.kind = Joint::Ball;
    ball.i = 1;
    ball.j = 0;
    ball.anchor_i = anchor(1, first);
    ball.anchor_j = anchor(0, first);
    Joint hinge;
    hinge.kind = Joint::Hinge;
    hinge.i = 1;
    hinge.j = 2;
    hinge.anchor_i = anchor(1, second);
    hinge.anchor_j = anchor(2, second);
    hinge.axis_i = inFrame(1, axis);
    hinge.axis_j = inFrame(2, axis);
    hinge.motor = 0;
    s.joints = {ball, hinge};
    s.motorRates = VectorXd::Constant(1, -0.7);
    return s;
}
PosedBodies inABox() {
    PosedBodies s =
        named("a body beside a held one in a periodic box", [](const HydrodynamicParticles& p) {
            return make_unique<PeriodicRotnePragerYamakawa>(p, viscosity);
        });
    s.box = {OpenMM::Vec3(7, 0, 0), OpenMM::Vec3(1, 7.5, 0), OpenMM::Vec3(-2, 0.5, 8)};
    s.add(fluidElement(0, {{0, 0, 0}}, {0.7}), {0, 0.3, 0}).hold();
    s.add(fluidElement(1, {{-0.5, 0, 0}, {0.6, 0.5, 0.3}, {0, 0.4, -0.6}}, {0.6, 0.7, 0.5}),
          {2.6, 1.6, 0.5});
    return s;
}
/** A sphere, and a body that does not move along x and about y, near walls. */
PosedBodies confined(bool between) {
    MobilityForce force;
    force.setBoundary(between ? MobilityForce::NoSlipChannel : MobilityForce::PeriodicWall);
    force.setChannelWalls(0, 4.4);
    const ConfiningPlanes planes(force, false);
    PosedBodies s =
        named(between ? "between walls" : "above a periodic wall",
              [planes](const HydrodynamicParticles& particles) {
                  return make_unique<ConfinedRotnePragerYamakawa>(particles, viscosity, planes);
              });
    s.box = {OpenMM::Vec3(5, 0, 0), OpenMM::Vec3(1, 4, 0), OpenMM::Vec3(0, 0, 3)};
    s.add(fluidElement(0, {{0, 0, 0}}, {1}), {0.1, 0.2, 1.5});
    s.add(fluidElement(1, {{0.5, 0, 0}, {-0.4, 0.3, 0}, {0, 0, 0.6}}, {0.5, 0.6, 0.5}),
          {2, 1, between ? 3.2 : 1.5}, {0.3, 0.2, -0.4})
        .fixed = bits({0, 4});
    return s;
}
/** Three blobs on a line, about an origin on it or off it. */
PosedBodies rod(const vector<int>& fixed, const Vector3d& turn, bool offLine = true) {
    PosedBodies s = named("a rod beside a sphere", rotnePrager);
    const Vector3d shift = offLine ? Vector3d(0.3, -0.2, 0) : Vector3d(0, 0, 0);
    s.add(fluidElement(0, {shift + Vector3d(0, 0, -1), shift, shift + Vector3d(0, 0, 1.3)},
                       {0.7, 0.6, 0.7}),
          {0, 0, 0}, turn)
        .fixed = bits(fixed);
    s.add(fluidElement(1, {{0.1, 0, 0}}, {0.8}), {0.7, 2.2, 0.3});
    return s;
}
/** A body without particles, which has a tensor of its own. */
PosedBodies freeDraining(const vector<int>& fixed, bool inBody = false) {
    PosedBodies s = named("a body with free draining", rotnePrager);
    s.add(fluidElement(0, {}, {}), {0.2, -0.1, 0.4}, {0.3, -0.7, 0.5});
    s.elements[0].ownMobility = tensorWithoutSymmetry(3);
    s.elements[0].fixed = bits(fixed);
    s.elements[0].fixedInBody = inBody;
    return s;
}
PosedBodies alone(const vector<int>& fixed, bool mayBeConstant) {
    PosedBodies s = named("a multiblob alone", rotnePrager);
    s.add(fluidElement(0, threeBlobs, {1, 0.8, 1}), {0, 0, 0}, {0.2, 0.7, -0.4}).fixed =
        bits(fixed);
    s.mayBeConstant = mayBeConstant;
    return s;
}

// ---- Steps

/** Whether drift correctors also take steps whose factor scales the whole step. */
enum class Factors { One, Both };

/**
 * The mean of a step is U + kT div N_c, and the mean wrench that holds fixed components the one
 * without noise plus kT div(xi N_c). A scheme that omits the drift has neither of the two.
 *
 * Velocities have the covariance (2 kT/h) N_c, and the wrenches that hold (2 kT/h) (xi - xi N_c
 * xi), which is the inverse of the fixed block of N. The two are independent.
 */
void checkSteps(const PosedBodies& scene, const VectorXd& divergence, const Strategy& strategy,
                const vector<Scheme>& schemes = allSchemes, Factors factors = Factors::One) {
    const double kT = 1.3;
    const int n = scene.numRows();
    auto bodies = scene.bodies(strategy.tolerance);
    const Expected expected(scene, bodies, scene.poses);
    VectorXd atRest(2 * n);
    atRest << expected.velocities, expected.holds;
    // Errors are relative to the drift, or to a tenth of what it might be for these radii.
    const double drift = max(kT * max(divergence.head(n).cwiseAbs().maxCoeff(),
                                      0.1 * expected.Nc.cwiseAbs().maxCoeff()),
                             0.01 * expected.velocities.cwiseAbs().maxCoeff()),
                 hold = kT * max(divergence.tail(n).cwiseAbs().maxCoeff(), 0.1);
    const double sizeOfN = expected.Nc.cwiseAbs().maxCoeff(),
                 sizeOfHolds = max(expected.ofHolds.cwiseAbs().maxCoeff(),
                                   0.01 * expected.friction.cwiseAbs().maxCoeff());
    for (Scheme scheme : schemes)
        for (bool scalesAll : {false, true}) {
            const bool isCorrector =
                scheme == Integrator::DriftCorrectorFD || scheme == Integrator::DriftCorrectorRFD;
            if (scalesAll && !(isCorrector && factors == Factors::Both)) continue;
            SCOPED_TRACE(scene.name + ", " + strategy.name + ", " + traitsOf(scheme).name +
                         (scalesAll ? ", the factor scales all" : ""));
            TestedStep step(scheme, scene, strategyOf(bodies, strategy), strategy.h, kT);
            step.step.difference = strategy.difference;
            step.step.driftFactorScalesAll = scalesAll;
            const VectorXd found = step.mean();
            const double sign = traitsOf(scheme).omitsDrift() ? 0 : 1;
            const VectorXd wanted = atRest + sign * kT * divergence;
            // Differences of this scheme are one-sided.
            const double tolerance =
                strategy.errorOfMoments * (scheme == Integrator::DriftCorrectorFD ? 10 : 1);
            EXPECT_LT((found - wanted).head(n).cwiseAbs().maxCoeff(), tolerance * drift);
            EXPECT_LT((found - wanted).tail(n).cwiseAbs().maxCoeff(), tolerance * hold);
            if (scalesAll) continue;
            const MatrixXd covariance = strategy.h / (2 * kT) * step.covariance();
            EXPECT_LT(error(covariance.topLeftCorner(n, n), expected.Nc, 1e-300),
                      strategy.errorOfMoments);
            EXPECT_LT(error(covariance.bottomRightCorner(n, n), expected.ofHolds, sizeOfHolds),
                      strategy.errorOfMoments);
            EXPECT_LT(covariance.topRightCorner(n, n).cwiseAbs().maxCoeff(),
                      strategy.errorOfMoments * sqrt(sizeOfN * sizeOfHolds) + 1e-300);
        }
}

void checkSteps(const PosedBodies& scene, const Strategy& strategy = byMatrices) {
    checkSteps(scene, divergences(scene), strategy);
}

/** A scene of the files, with the schemes whose drift is right in it. */
struct TestedScene {
    const char* name;
    vector<Scheme> schemes;
};
const vector<Scheme> withJoints = {Integrator::FixmanMidpoint, Integrator::RandomFiniteDifference,
                                   Integrator::TrapezoidalSlip};
const vector<TestedScene> testedScenes = {{"held_body", allSchemes},
                                          {"held_body_wall", allSchemes},
                                          {"held_sphere", allSchemes},
                                          {"held_sphere_wall", allSchemes},
                                          {"held_particles", allSchemes},
                                          {"held_particles_wall", allSchemes},
                                          {"lab_components", allSchemes},
                                          {"lab_components_wall", allSchemes},
                                          {"moving_body", allSchemes},
                                          {"moving_body_wall", allSchemes},
                                          {"rollers_wall", allSchemes},
                                          {"body_components", allSchemes},
                                          {"body_components_wall", allSchemes},
                                          {"ball_link", withJoints},
                                          {"ball_link_wall", withJoints},
                                          {"hinge_link", withJoints},
                                          {"hinge_link_wall", withJoints},
                                          {"pendulum", withJoints},
                                          {"pendulum_wall", withJoints},
                                          {"chain_of_spheres", withJoints},
                                          {"motor", withJoints},
                                          {"motor_wall", withJoints}};

}  // namespace

// ---- The problem of the bodies

/** The forces of conditions in the file are, in this order, those of its joints and motors. */
void checkJointForces(const ReferenceScene& scene, const Joints& joints, const MatrixXd& found,
                      double tolerance) {
    if (scene.joints.empty() || !scene.data.has("multipliers")) return;
    int numOfHeld = 0;  // come first
    for (const JsonValue& constraint : scene.data["constraints"].list)
        if (constraint["type"].text == "held") numOfHeld += 6;
    const VectorXd mu = scene.data["multipliers"].column().tail(joints.getNumRows());
    ASSERT_EQ(scene.data["multipliers"].size(), numOfHeld + joints.getNumRows());
    const double size = mu.cwiseAbs().maxCoeff();
    for (size_t k = 0; k < scene.joints.size(); k++) {
        const Joint& joint = joints.getJoints()[k];
        const double torque = joint.hasMotor() ? mu[joint.motorRow()] : 0;
        EXPECT_NEAR(found(3, k), torque, tolerance * size);
        const Vector3d force = found.col(k).head<3>();
        if (joint.kind == Joint::Link) {
            EXPECT_NEAR(force.norm(), abs(mu[joint.firstRow]), tolerance * size);
        } else {
            EXPECT_LT(error(force, mu.segment<3>(joint.firstRow), size), tolerance);
        }
    }
}

/** N_c, velocities, forces of particles and holds have the values of the files. */
void checkProblem(const ReferenceScene& scene, const Strategy& strategy) {
    SCOPED_TRACE(scene.name + ", " + strategy.name);
    auto bodies = scene.bodies(strategy.tolerance);
    BodyMobility& mobility = strategyOf(bodies, strategy);
    const int n = scene.numRows();
    const Expected expected(scene, bodies, scene.poses);
    // Files with motors have velocities and forces of conditions only.
    const MatrixXd Nc = scene.data.has("Nc") ? scene.matrix("Nc") : expected.Nc,
                   identity = MatrixXd::Identity(n, n);
    EXPECT_LT(error(expected.Nc, Nc), 1e-12);
    EXPECT_LT(error(expected.velocities, scene.ofBodies("U")), 1e-12);
    EXPECT_LT(error(expected.all, scene.ofBodies("hold")), 1e-12);
    mobility.setPoses(scene.poses);
    MatrixXd found, lambda, total;
    if (scene.joints.empty()) {
        EXPECT_LT(error(mobility.mobility(), Nc), strategy.error);
        mobility.multiply(identity, found);
        EXPECT_LT(error(found, Nc), strategy.error);
        mobility.solve(identity, found);
        EXPECT_LT(error(found, Nc), strategy.error);
        // Forces of particles add up to the wrenches in the rows of what is free.
        mobility.getBlobForces(lambda);
        mobility.totalWrenches(scene.poses, lambda, total);
        EXPECT_LT(error(total, identity - expected.onFixed), strategy.error);
    }
    OverdampedMove move(mobility);
    move.start = scene.poses;
    move.force = scene.wrenches;
    if (scene.velocities.size() > 0) move.prescribe(&scene.velocities);
    MatrixXd holds = MatrixXd::Zero(n, 1), twists;
    move.recording.holds = &holds;
    const Joints joints(scene.joints, *bodies);
    if (!scene.joints.empty()) move.setJoints(&joints);
    MatrixXd jointForces = MatrixXd::Zero(4, scene.joints.size());
    move.recording.jointForces = &jointForces;
    OverdampedStep step;
    step.motorRates = scene.motorRates;
    move.begin(step);
    move.atStart();
    found.resize(n, n);
    for (int k = 0; k < n; k++) {
        const MatrixXd unit = identity.col(k);
        move.solve(move.direction(0, unit), twists);
        found.col(k) = twists;
    }
    EXPECT_LT(error(found, Nc), strategy.error);
    move.solve(move.velocity(1, move.force), twists);
    EXPECT_LT(error(twists, scene.ofBodies("U")), strategy.error);
    mobility.getBlobForces(lambda);
    if (scene.data.has("blobForces")) {
        EXPECT_LT(error(lambda, scene.ofParticles("blobForces")), strategy.error);
    }
    mobility.totalWrenches(scene.poses, lambda, total);
    EXPECT_LT(error(total, scene.wrenches + expected.all), strategy.error);
    checkJointForces(scene, joints, jointForces, strategy.error);
    EXPECT_LT(error(holds, expected.holds, expected.all.cwiseAbs().maxCoeff()), strategy.error);
}

TEST(FixedComponents, ScenesOfFilesHaveTheirMobilityVelocitiesAndHolds) {
    for (const TestedScene& tested : testedScenes)
        checkProblem(ReferenceScene(tested.name), byMatrices);
}
TEST(FixedComponents, ScenesOfFilesMatrixFree) {
    for (const TestedScene& tested : testedScenes)
        checkProblem(ReferenceScene(tested.name), matrixFree);
}

/** A step without noise, with constant wrenches. The files contain the poses at the end. */
TEST(FixedComponents, ScenesOfFilesHaveTheirPosesAfterAStep) {
    for (const TestedScene& tested : testedScenes)
        for (Scheme scheme : {Integrator::EulerMaruyama, Integrator::TrapezoidalSlip}) {
            // The values of T-S with joints are those before the projection.
            const ReferenceScene scene(tested.name);
            SCOPED_TRACE(scene.name + ", " + traitsOf(scheme).name);
            if (!scene.data.has("TS_T0")) continue;
            auto bodies = scene.bodies();
            TestedStep step(scheme, scene, bodies.byMatrices(), scene.data["h"].number, 0);
            const auto expected =
                scene.posesOf(scheme == Integrator::EulerMaruyama ? "EM_T0" : "TS_T0");
            EXPECT_EQ(step.move.randomNumbers, 0);
            for (size_t e = 0; e < expected.size(); e++) {
                EXPECT_LT((step.move.present[e].R - expected[e].R).norm(), 1e-12) << e;
                if (scene.elements[e].isFree()) continue;
                EXPECT_LT((step.move.present[e].rotation() - expected[e].rotation()).norm(), 1e-12)
                    << e;
            }
        }
}

/**
 * A sphere of radius 1 at a distance from a held sphere, in units of 1/(6 pi eta a). The closed
 * forms are those of two Rotne-Prager-Yamakawa spheres.
 */
TEST(FixedComponents, ASphereBesideAHeldOne) {
    struct Row {
        double r, along, across, turnAlong, turnAcross, turnPerForce, drift;
    };
    const Row rows[] = {{2.5, 0.712704000000, 0.870576000000, 0.746928000000, 0.734832000000,
                         0.043680000000, 0.048652800000},
                        {3, 0.785665294925, 0.918638545953, 0.748971193416, 0.742798353909,
                         0.023919753086, 0.031378600823},
                        {4, 0.870849609375, 0.958923339844, 0.749816894531, 0.747756958008,
                         0.009521484375, 0.014923095703}};
    for (const Row& row : rows)
        for (const Strategy& strategy : {byMatrices, matrixFree}) {
            SCOPED_TRACE(strategy.name);
            PosedBodies scene = named("two spheres", rotnePrager);
            scene.add(fluidElement(0, {{0, 0, 0}}, {1}), {0, 0, 0}).hold();
            scene.add(fluidElement(1, {{0, 0, 0}}, {1}), {0, 0, row.r});
            auto bodies = scene.bodies();
            EXPECT_FALSE(bodies->isDivergenceFree());
            BodyMobility& mobility = strategyOf(bodies, strategy);
            mobility.setPoses(scene.poses);
            const MatrixXd Nc = mobility.mobility();
            MatrixXd expected = MatrixXd::Zero(12, 12);
            expected.diagonal().tail(6) << row.across, row.across, row.along, row.turnAcross,
                row.turnAcross, row.turnAlong;
            expected(10, 6) = expected(6, 10) = row.turnPerForce;
            expected(9, 7) = expected(7, 9) = -row.turnPerForce;
            const double rounding = strategy.matrixFree ? strategy.error : 1e-11;
            EXPECT_LT((Nc - expected).cwiseAbs().maxCoeff(), rounding);
            // What holds the other one takes -m of a force along the line of centres.
            const double m = 1.5 / row.r * (1 - 2 / (3 * row.r * row.r));
            MatrixXd twists, total, lambda;
            mobility.solve(VectorXd::Unit(12, 8), twists);
            mobility.getBlobForces(lambda);
            mobility.totalWrenches(scene.poses, lambda, total);
            EXPECT_LT((total - (VectorXd::Unit(12, 8) - m * VectorXd::Unit(12, 2))).norm(),
                      10 * rounding);
            const VectorXd found = divergences(scene);
            EXPECT_LT((found.head(12) - row.drift * VectorXd::Unit(12, 8)).norm(), 1e-8);
            // Flows of spheres have no sources, so that the mean hold gets nothing.
            EXPECT_LT(found.tail(12).norm(), 1e-8);
        }
}

/**
 * Divergences of N_c and of xi N_c agree with those in the files, which do not come from this
 * library.
 */
TEST(FixedComponents, DivergencesAreThoseOfTheFiles) {
    for (const TestedScene& tested : testedScenes) {
        const ReferenceScene scene(tested.name);
        if (!scene.data.has("divNc")) continue;
        const int n = scene.numRows();
        const VectorXd found = divergences(scene, &Expected::response),
                       ofN = scene.ofBodies("divNc"), ofHold = scene.ofBodies("divHold");
        EXPECT_LT(error(found.head(n), ofN), 1e-6) << scene.name;
        EXPECT_LT(error(found.tail(n), ofHold, 1e-2), 1e-6) << scene.name;
    }
}

// ---- Steps

TEST(FixedComponents, StepsInScenesOfFiles) {
    for (const TestedScene& tested : testedScenes) {
        const ReferenceScene scene(tested.name);
        checkSteps(scene, divergenceOfFile(scene), byMatrices, tested.schemes, Factors::Both);
    }
}

/**
 * The forces of joints are P F + (a part of motors), where the matrices P depend on poses. Their
 * mean in a step is the mean at rest plus kT sum_k d_k P_ik, which is also the mean of stiff
 * springs: a link turns with its bodies, so its force and its direction vary together.
 */
TEST(FixedComponents, MeansOfForcesOfJoints) {
    for (const char* name : {"ball_link", "hinge_link_wall", "chain_of_spheres", "motor"}) {
        const ReferenceScene scene(name);
        auto bodies = scene.bodies();
        BodyMobility& mobility = bodies.byMatrices();
        const int n = scene.numRows(), numForces = 4 * scene.joints.size();
        const Joints joints(scene.joints, *bodies);
        const auto forces = [&](const vector<Pose>& poses, const VectorXd* direction) {
            OverdampedMove move(mobility);
            move.start = poses;
            move.force = scene.wrenches;
            move.setJoints(&joints);
            MatrixXd found = MatrixXd::Zero(4, scene.joints.size()), twists;
            move.recording.jointForces = &found;
            OverdampedStep step;
            step.motorRates = scene.motorRates;
            move.begin(step);
            move.atStart();
            if (direction)
                move.solve(move.direction(1, MatrixXd(*direction)), twists);
            else
                move.solve(move.velocity(1, move.force), twists);
            return VectorXd(Eigen::Map<const VectorXd>(found.data(), numForces));
        };
        const double kT = 1.3, delta = 3e-5;
        VectorXd divergence = VectorXd::Zero(numForces);
        for (int k = 0; k < n; k++)
            for (int sign : {1, -1}) {
                const VectorXd along = VectorXd::Unit(n, k);
                divergence +=
                    sign / (2 * delta) * forces(scene.posesAfter(sign * delta * along), &along);
            }
        const VectorXd wanted = forces(scene.poses, nullptr) + kT * divergence;
        EXPECT_GT(divergence.cwiseAbs().maxCoeff(), 0.1);
        for (Scheme scheme : withJoints) {
            TestedStep step(scheme, scene, mobility, byMatrices.h, kT);
            step.givesJointForces = true;
            EXPECT_LT(error(step.mean(), wanted), byMatrices.errorOfMoments)
                << name << " " << traitsOf(scheme).name;
        }
    }
}

namespace {

void checkStepsMatrixFree(const vector<Scheme>& inMostScenes) {
    for (const char* name : {"held_body", "lab_components", "body_components"}) {
        const ReferenceScene scene(name);
        checkSteps(scene, divergenceOfFile(scene), matrixFree, inMostScenes);
    }
    const ReferenceScene particles("held_particles_wall");
    checkSteps(particles, divergenceOfFile(particles), matrixFree);
    for (const char* name : {"hinge_link", "motor_wall"}) {
        const ReferenceScene scene(name);
        checkSteps(scene, divergenceOfFile(scene), matrixFree, withJoints);
    }
    checkSteps(driven(spheresBesideAHeldOne()), matrixFree);
    for (const PosedBodies& scene :
         {driven(blobsInAField()), driven(rod({2, 3, 4}, {0.4, -0.7, 0.3}))})
        checkSteps(scene, divergences(scene), matrixFree, inMostScenes);
}

}  // namespace

/** With DriftCorrectorRFD in two scenes. */
TEST(FixedComponents, StepsMatrixFree) { checkStepsMatrixFree(exceptRFD); }
TEST(FixedComponents, FullStepsMatrixFree) { checkStepsMatrixFree(allSchemes); }

TEST(FixedComponents, SpheresBesideAHeldOneHaveADrift) {
    const PosedBodies scene = driven(spheresBesideAHeldOne());
    const VectorXd divergence = divergences(scene);
    EXPECT_GT(divergence.head(scene.numRows()).norm(), 0.02);
    checkSteps(scene, divergence, byMatrices);
}
TEST(FixedComponents, LubricatedSpheresAtAWall) { checkSteps(driven(lubricatedAtWall())); }
TEST(FixedComponents, OwnTensors) { checkSteps(driven(ownTensors())); }
TEST(FixedComponents, SpheresOfStokesianDynamics) { checkSteps(driven(stokesianSpheres())); }
TEST(FixedComponents, InAFluidWithARandomField) { checkSteps(driven(blobsInAField())); }
TEST(FixedComponents, JoinedToAHeldBody) {
    const PosedBodies scene = driven(tiedToAHeldOne());
    const VectorXd divergence = divergences(scene);
    EXPECT_GT(divergence.tail(scene.numRows()).norm(), 0.02);
    checkSteps(scene, divergence, byMatrices, withJoints);
}
TEST(FixedComponents, InAPeriodicBox) { checkSteps(driven(inABox())); }
/** The model of planes is that between two of them, or above one. */
TEST(FixedComponents, BetweenNoSlipWalls) {
    const PosedBodies scene = driven(confined(true));
    checkSteps(scene, divergences(scene), byMatrices, exceptRFD);
}
TEST(FixedComponents, AboveAPeriodicWall) {
    const PosedBodies scene = driven(confined(false));
    checkSteps(scene, divergences(scene), byMatrices, exceptRFD);
}
TEST(FixedComponents, FullBesidePlanes) {
    checkSteps(driven(confined(true)));
    checkSteps(driven(confined(false)));
}

/** One body alone, with its tensor computed once, and the same body with matrices at every pose. */
TEST(FixedComponents, OneBodyAlone) {
    for (const vector<int>& fixed : {vector<int>{2}, {2, 3, 4}, {0, 1, 2, 3, 5}, {3}, {0, 1, 2}})
        for (bool mayBeConstant : {true, false}) checkSteps(driven(alone(fixed, mayBeConstant)));
}

/**
 * With T_k = diag(e_k x, e_k x), N_c = Z (Z^T xi Z)^-1 Z^T of one body in a uniform fluid has d_Wk
 * N_c = -N_c (T_k xi - xi T_k) N_c, and xi N_c has (1 - xi N_c) (T_k xi - xi T_k) N_c.
 */
TEST(FixedComponents, OneBodyWithFreeDraining) {
    for (const vector<int>& fixed : {vector<int>{2}, {2, 3, 4}, {0, 1, 2, 3, 5}, {3}, {0, 1, 2}}) {
        const PosedBodies scene = driven(freeDraining(fixed));
        auto bodies = scene.bodies();
        ASSERT_TRUE(bodies->isConstantInBodyFrame());
        const Expected here(scene, bodies, scene.poses);
        VectorXd divergence = VectorXd::Zero(12);
        for (int k = 0; k < 3; k++) {
            MatrixXd T = MatrixXd::Zero(6, 6);
            T.topLeftCorner<3, 3>() = T.bottomRightCorner<3, 3>() = cross(Vector3d::Unit(k));
            const MatrixXd change = (T * here.friction - here.friction * T) * here.Nc;
            divergence.head(6) -= here.Nc * change.col(3 + k);
            divergence.tail(6) += here.onFixed * change.col(3 + k);
        }
        EXPECT_LT((divergence - divergences(scene)).norm(), 1e-7 * divergence.norm());
        bodies.setPoses(scene.poses);
        EXPECT_LT(error(bodies.mobility(), here.Nc), 1e-12);
        checkSteps(scene, divergence, byMatrices);
    }
}

/**
 * A rod has a null twist about its line. If a fixed component takes part in this twist, the free
 * components have no null twist.
 */
TEST(FixedComponents, Rods) {
    const Vector3d along_x(0, M_PI / 2, 0), anywhere(0.4, -0.7, 0.3);
    for (const vector<int>& fixed : {vector<int>{2, 3, 4}, {3, 4, 5}}) {
        checkSteps(driven(rod(fixed, along_x)));
        checkSteps(driven(rod(fixed, anywhere)));
    }
    checkSteps(driven(rod({5}, anywhere)));
    for (bool mayBeConstant : {true, false}) {
        PosedBodies alone = rod({2, 3, 4}, anywhere);
        alone.name = "a rod alone";
        alone.elements.pop_back();
        alone.poses.pop_back();
        alone.mayBeConstant = mayBeConstant;
        checkSteps(driven(alone));
    }
    // A component that takes no part, of a rod that may turn about its line. Off the line, the
    // translation takes part.
    PosedBodies free = driven(rod({0, 1, 2}, anywhere, false));
    const Vector3d line = free.poses[0].rotation().col(2);
    Eigen::Block<MatrixXd> torque = free.wrenches.block(3, 0, 3, 1);
    torque -= line * line.dot(torque.col(0));  // nothing balances a torque about its line
    checkSteps(free);
    checkSteps(driven(rod({0, 1, 2}, anywhere, true)));
    PosedBodies held = driven(rod({}, anywhere));
    held.elements[0].hold();
    held.velocities.resize(0, 0);
    checkSteps(held);
    // A rod that is exactly across the plane has its null twist, which nothing resists.
    const PosedBodies across = rod({2, 3, 4}, Vector3d::Zero(), false);
    auto bodies = across.bodies();
    bodies.setPoses(across.poses);
    EXPECT_LT(error(bodies.mobility(), Expected(across, bodies, across.poses).Nc), 1e-12);
    bodies.setPoses(across.poses);
    EXPECT_EQ(bodies.mobility().row(5).cwiseAbs().maxCoeff(), 0);
}

/** Components that are fixed along axes of the body, one of them not along its frame. */
TEST(FixedComponents, AxesOfABody) {
    for (const vector<int>& fixed : {vector<int>{0}, {5}, {1, 3, 5}, {0, 1, 2, 3, 4, 5}})
        for (bool mayBeConstant : {true, false}) {
            PosedBodies scene = alone(fixed, mayBeConstant);
            scene.elements[0].fixedInBody = true;
            scene.elements[0].axes =
                Eigen::AngleAxisd(0.7, Vector3d(1, 2, -1).normalized()).toRotationMatrix();
            scene = driven(scene);
            checkSteps(scene);
        }
}

// ---- What the tests can see

/** Without thermal slips of the held blobs, variances would be too large by this much. */
TEST(FixedComponents, SlipsOnFreeBlobsOnlyWouldBeSeen) {
    const pair<const char*, double> rows[] = {
        {"held_body", 1.135}, {"held_sphere", 1.055}, {"held_particles", 1.234}};
    for (const auto& row : rows) {
        const ReferenceScene scene(row.first);
        auto bodies = scene.bodies();
        TestedStep step(Integrator::TrapezoidalSlip, scene, bodies.byMatrices(), 1e-6, 1);
        const int n = scene.numRows();
        // T-S draws W of slips M^(1/2) W. The slips of free blobs alone are found from the slips of
        // each W by setting those of held blobs to zero.
        BodyMobility& mobility = bodies.byMatrices();
        mobility.setPoses(scene.poses);
        int heldRows = 0;
        for (const FluidElement& e : scene.elements) heldRows += e.isHeld ? e.numParticleRows() : 0;
        const int numSlips = bodies->getNumParticleRows();
        MatrixXd slips(numSlips, numSlips), twists;
        for (int i = 0; i < numSlips; i++) {
            MatrixXd one;
            mobility.thermalSlip(VectorXd::Unit(numSlips, i), one);
            slips.col(i) = one;
        }
        mobility.solve(MatrixXd::Zero(n, numSlips), slips, twists);
        const MatrixXd Nc = scene.matrix("Nc");
        EXPECT_LT(error(twists * twists.transpose(), Nc), 1e-12);
        slips.topRows(heldRows).setZero();
        mobility.solve(MatrixXd::Zero(n, numSlips), slips, twists);
        double largest = 0;
        for (int i = 0; i < n; i++)
            if (Nc(i, i) > 1e-12) largest = max(largest, twists.row(i).squaredNorm() / Nc(i, i));
        EXPECT_NEAR(largest, row.second, 5e-4) << scene.name;
    }
}

// ---- What does not move

/** Held bodies keep their poses to the last bit, though their quaternions have rounding errors. */
TEST(FixedComponents, HeldBodiesStay) {
    for (const PosedBodies& driven_ : {driven(spheresBesideAHeldOne()), driven(ownTensors()),
                                       driven(stokesianSpheres()), driven(blobsInAField())}) {
        PosedBodies scene = driven_;
        scene.poses[0].q.w *= 1 + 1e-14;
        for (Scheme scheme : allSchemes) {
            auto bodies = scene.bodies();
            TestedStep step(scheme, scene, bodies.byMatrices(), 1e-3, 1);
            const vector<RandomNumber> numbers = step.move.drawn;
            RandomNumbers all;
            for (const RandomNumber& number : numbers) all[number] = 1;
            step.take(all);
            const Pose &before = scene.poses[0], &after = step.move.present[0];
            EXPECT_TRUE(after.R == before.R && after.q.w == before.q.w && after.q.x == before.q.x &&
                        after.q.y == before.q.y && after.q.z == before.q.z)
                << scene.name << ", " << traitsOf(scheme).name;
            EXPECT_NE(step.move.present[1].R, scene.poses[1].R);
            // No direction of differences is drawn for what is held.
            const uint32_t index = scene.elements[0].isFree() ? scene.elements[0].particles[0]
                                                              : scene.elements[0].body;
            const uint32_t purpose = scene.elements[0].isFree() ? NoiseStream::FreeFiniteDifference
                                                                : NoiseStream::FiniteDifference;
            for (const RandomNumber& number : numbers)
                EXPECT_FALSE(number.index == index && number.purpose == purpose);
        }
    }
}

/** If everything is held, holds balance the wrenches and have the noise of the friction. */
TEST(FixedComponents, NothingIsFree) {
    for (PosedBodies scene : {spheresBesideAHeldOne(), ownTensors(), stokesianSpheres(),
                              blobsInAField(), freeDraining({}), rod({}, {0.4, -0.7, 0.3})}) {
        for (FluidElement& e : scene.elements) e.hold();
        scene = driven(scene);
        auto bodies = scene.bodies();
        const int n = scene.numRows();
        const Expected expected(scene, bodies, scene.poses);
        EXPECT_EQ(expected.holds, -scene.wrenches.col(0));
        for (Scheme scheme : allSchemes) {
            SCOPED_TRACE(scene.name + ", " + traitsOf(scheme).name);
            TestedStep step(scheme, scene, bodies.byMatrices(), 1e-6, 1);
            EXPECT_TRUE(step.move.driftIsKnown());
            for (const RandomNumber& number : step.move.drawn) EXPECT_FALSE(number.isOfDirection());
            const VectorXd mean = step.mean();
            EXPECT_LT(mean.head(n).norm(), 1e-9);
            EXPECT_LT((mean.tail(n) - expected.holds).norm(), 1e-7);
            const MatrixXd covariance = 0.5e-6 * step.covariance();
            EXPECT_LT(covariance.topRows(n).norm(), 1e-9);
            EXPECT_LT(error(covariance.bottomRightCorner(n, n), expected.friction), 1e-9);
        }
    }
}
