#include "fluid/StressReader.h"

#include <cmath>
#include <string>

#include "linearalgebra/OneBlasThread.h"
#include "mobility/InnerErrors.h"
#include "mobility/Models.h"
#include "mobility/StressletBasis.h"
#include "openmmrigidhi/internal/Errors.h"
#include "rigidbody/EigenVec3.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

namespace {

const char* const method = "getStressInContext()";

}  // namespace

void StressReader::check() const {
    const auto boundary = fluid.force.getBoundary();
    if (boundary != MobilityForce::Periodic || fluid.isFreeDraining())
        failFluid(method,
                  string("stress is the mean over a periodic box, and the fluid has the "
                         "boundary ") +
                      boundaryName(boundary) + " and the model " +
                      modelName(fluid.force.getModel()) +
                      "; ask with the boundary Periodic, and a model other than FreeDraining");
    if (!fluid.hasOneFlow())
        failFluid(method,
                  "the Context has " + to_string(fluid.groups.size()) +
                      " groups of bodies, each in a fluid of its own; ask in a Context with one "
                      "group");
    const FluidGroup& group = *fluid.groups[0];
    if (group.joints || group.bodies.getFreeMotion().any() || group.bodies.getForcesOnFluid())
        failFluid(
            method,
            "bodies are held, driven or joined, or exert forces on the fluid at sites, and the "
            "model does not know the stress of these forces; ask in a Context without such bodies, "
            "and tie bodies by bonds (HarmonicBondForce) instead of joints");
}

/** Sum of the stresslets of all particles and of sum (x - X) f, symmetric and without trace. */
Matrix3d StressReader::stressletsOf(const FluidGroup& group, const vector<Pose>& poses,
                                    const FlowSources& sources) const {
    const CoupledBodies& bodies = group.bodies;
    const HydrodynamicParticles& particles = bodies.getParticles();
    vector<Matrix3d> turns;
    setTurns(poses, turns);
    Placement placement;
    bodies.getMotion().place(poses, turns, placement);
    Matrix3d sum = Matrix3d::Zero();
    for (size_t e = 0; e < poses.size(); e++)
        for (size_t i = 0; i < bodies.getElements()[e].particles.size(); i++) {
            const int p = bodies.getMotion().firstParticle(e) + i;
            const Vector3d x = toEigen(placement.positions[p]) - poses[e].R,
                           f = sources.forces.block<3, 1>(particles.firstRow[p], 0);
            sum +=
                0.5 * (x * f.transpose() + f * x.transpose()) - x.dot(f) / 3 * Matrix3d::Identity();
        }
    for (int p = 0; 5 * p < sources.stresslets.size(); p++)
        sum += tensorOfStresslet(sources.stresslets.segment<5>(5 * p));
    return sum;
}

/** stressletsOf() the forces that move bodies under wrenches, without any flow. */
Matrix3d StressReader::stressletsOfWrenches(const FluidGroup& group, BodyMobility& mobility,
                                            const vector<Pose>& poses, const MatrixXd& wrenches,
                                            bool nearby, double error) const {
    MatrixXd twists, forces = wrenches;
    mobility.setPoses(poses, nearby);
    if (!mobility.getSlipSpace().slipsAreTwists()) {
        mobility.solve(wrenches, twists);
        mobility.getBlobForces(forces);
    }
    return stressletsOf(group, poses, mobility.flow().sourcesOf(forces, nullptr, false, {error}));
}

StressParts StressReader::find(const FlowQuestion& question, const Noise& noise,
                               const Matrix3d& virial) const {
    const OneBlasThread single;
    FluidGroup& group = *fluid.groups[0];
    BrownianGroup& brownian = *group.brownian;
    BodyMobility& mobility = brownian.mobilityFor(0, question.scheme);
    const double volume = group.box()->volume(fluid.box);
    // The Brownian part differences whole solves.
    const SchemeTraits& differencing = traitsOf(CustomRigidHIIntegrator::RandomFiniteDifference);
    OverdampedMove move(mobility);
    OverdampedStep step;
    step.flow = fluid.getFlow();
    step.h = noise.h;
    step.kT = noise.kT;
    step.noise = noise.stream;
    step.difference = brownian.differenceOf(differencing, noise.difference);
    brownian.setErrors(differencing, step);
    group.members.readPoses(question.bodies, question.positions, move.start);
    move.begin(step);
    StressParts result;

    const double error = InnerErrors::ofAnswers * fluid.force.getSolverTolerance();
    MatrixXd twists, forces = MatrixXd::Zero(move.getNumRows(), 1);
    move.atStart();
    if (!mobility.getSlipSpace().slipsAreTwists()) {
        FlowOfStep made;
        const MatrixXd none = forces;
        move.recording.flow = &made;
        move.solve(move.velocity(1, none), twists);
        move.recording.flow = nullptr;
        forces = made.shares.at(0).forces;
    }
    result.hydrodynamic =
        -stressletsOf(group, move.start,
                      mobility.flow().sourcesOf(forces, fluid.getFlow(), true, {error})) /
        volume;

    const MatrixXd& wrenches = brownian.readForces(question.bodies, question.freeParticles);
    Vector3d torque = Vector3d::Zero();
    const auto& elements = group.bodies.getElements();
    for (size_t e = 0; e < elements.size(); e++)
        if (!elements[e].isFree()) torque += wrenches.block<3, 1>(group.bodies.firstRow(e) + 3, 0);
    // Forces between bodies exert no total torque: sum of X x F + T = 0. The other half of the
    // virial follows from this.
    Matrix3d moments = Matrix3d::Zero();
    const Vector3d half(-0.5 * torque[2], 0.5 * torque[1], -0.5 * torque[0]);
    moments.diagonal() = virial.diagonal();
    moments(0, 1) = moments(1, 0) = virial(0, 1) + half[0];
    moments(0, 2) = moments(2, 0) = virial(0, 2) + half[1];
    moments(1, 2) = moments(2, 1) = virial(1, 2) + half[2];
    result.interparticle =
        -(moments + stressletsOfWrenches(group, mobility, move.start, wrenches, false, error)) /
        volume;

    result.brownian.setZero();
    if (noise.kT > 0) {
        move.drawDirections();
        double delta = step.difference;
        vector<Pose> displaced;
        move.displace(delta, displaced);
        const double small = error * abs(delta);
        const Matrix3d before = stressletsOfWrenches(group, mobility, move.start, move.directions,
                                                     false, small),
                       after = stressletsOfWrenches(group, mobility, displaced, move.directions,
                                                    true, small);
        result.brownian = -noise.kT / (delta * volume) * (after - before);
    }
    result.ideal = -noise.kT * elements.size() / volume * Matrix3d::Identity();
    return result;
}

}  // namespace RigidHIPlugin
