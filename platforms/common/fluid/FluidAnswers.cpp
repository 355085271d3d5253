#include "fluid/FluidAnswers.h"

#include "linearalgebra/OneBlasThread.h"
#include "rigidbody/EigenVec3.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

namespace {

/** Scatter a group's 6 x 6 blocks into the matrix of all bodies. */
void scatterBlocks(const MatrixXd& from, const CoupledBodies& bodies, MatrixXd& to) {
    const auto& elements = bodies.getElements();
    for (size_t i = 0; i < elements.size(); i++)
        for (size_t k = 0; k < elements.size(); k++)
            if (!elements[i].isFree() && !elements[k].isFree())
                to.block<6, 6>(6 * elements[i].body, 6 * elements[k].body) =
                    from.block<6, 6>(bodies.firstRow(i), bodies.firstRow(k));
}

}  // namespace

BodyMobility& FluidAnswers::answering(FluidGroup& group, const BodySet& bodies,
                                      const vector<OpenMM::Vec3>& positions) const {
    group.answering->setTolerance(fluid.force.getSolverTolerance());
    group.answering->setPoses(group.readPoses(bodies, positions));
    return *group.answering;
}

MatrixXd FluidAnswers::mobility(const BodySet& bodies, const vector<OpenMM::Vec3>& positions) {
    const OneBlasThread single;
    MatrixXd result = MatrixXd::Zero(6 * fluid.groupOfBody.size(), 6 * fluid.groupOfBody.size());
    for (const auto& group : fluid.groups)
        if (group->joints)
            scatterBlocks(mobilityWithJoints(*group, answering(*group, bodies, positions)),
                          group->bodies, result);
        else
            scatterBlocks(answering(*group, bodies, positions).mobility(), group->bodies, result);
    return result;
}

MatrixXd FluidAnswers::mobilityWithJoints(FluidGroup& group, BodyMobility& mobility) const {
    MatrixXd N = mobility.mobility(), C, inverse;
    group.joints->findRows(mobility.getPoses(), C);
    const MatrixXd along = N * C.transpose();
    group.joints->factorise(C * along, inverse);
    return N - along * inverse * along.transpose();
}

MatrixXd FluidAnswers::jointForcesOfLastStep(int numJoints) const {
    MatrixXd forces = MatrixXd::Zero(3, numJoints);
    for (const auto& group : fluid.groups) {
        if (!group->joints) continue;
        const MatrixXd& own = group->brownian->getJointForces();
        for (int k = 0; k < own.cols(); k++)
            forces.col(group->joints->getJoints()[k].index) = own.col(k).head<3>();
    }
    return forces;
}

void FluidAnswers::motorTorquesOfLastStep(vector<double>& torques) const {
    for (const auto& group : fluid.groups) {
        if (!group->joints) continue;
        const MatrixXd& own = group->brownian->getJointForces();
        for (int k = 0; k < own.cols(); k++) {
            const Joint& joint = group->joints->getJoints()[k];
            if (joint.hasMotor()) torques[joint.motor] = own(3, k);
        }
    }
}

MatrixXd FluidAnswers::friction(const BodySet& bodies, const vector<OpenMM::Vec3>& positions) {
    const OneBlasThread single;
    MatrixXd result = MatrixXd::Zero(6 * fluid.groupOfBody.size(), 6 * fluid.groupOfBody.size());
    for (const auto& group : fluid.groups) {
        const MatrixXd& friction = answering(*group, bodies, positions).friction();
        const auto& elements = group->bodies.getElements();
        bool hasFree = false;
        for (const FluidElement& element : elements)
            hasFree = hasFree || (element.isFree() && !element.isHeld);
        if (!hasFree) {
            scatterBlocks(friction, group->bodies, result);
            continue;
        }
        // Free particles are force-free. The friction is therefore the inverse of the bodies' part
        // of the mobility: a Schur complement.
        vector<int> bodyRows, freeRows;
        for (size_t e = 0; e < elements.size(); e++)
            for (int i = 0; i < elements[e].numRows(); i++)
                if (!elements[e].isHeld || !elements[e].isFree())  // held particles are at rest
                    (elements[e].isFree() ? freeRows : bodyRows)
                        .push_back(group->bodies.firstRow(e) + i);
        if (bodyRows.empty()) continue;
        MatrixXd xi = friction;
        const MatrixXd coupling = xi(freeRows, bodyRows);
        const MatrixXd schur =
            xi(bodyRows, bodyRows) -
            coupling.transpose() * MatrixXd(xi(freeRows, freeRows)).llt().solve(coupling);
        for (size_t i = 0; i < bodyRows.size(); i++)
            for (size_t k = 0; k < bodyRows.size(); k++) xi(bodyRows[i], bodyRows[k]) = schur(i, k);
        scatterBlocks(xi, group->bodies, result);
    }
    return result;
}

VectorXd FluidAnswers::apply(const VectorXd& wrenches, const BodySet& bodies,
                             const vector<OpenMM::Vec3>& positions) {
    const OneBlasThread single;
    VectorXd result = VectorXd::Zero(wrenches.size());
    MatrixXd f, u;
    for (const auto& group : fluid.groups) {
        BodyMobility& mobility = answering(*group, bodies, positions);
        const auto& elements = group->bodies.getElements();
        f.setZero(group->bodies.getNumRows(), 1);
        for (size_t e = 0; e < elements.size(); e++)
            if (!elements[e].isFree()) {
                const Matrix<double, 6, 1> wrench = wrenches.segment<6>(6 * elements[e].body);
                f.middleRows<6>(group->bodies.firstRow(e)) = wrench;
                if (group->hasNullVectors && elements[e].isWhollyFree())
                    group->checkTorque(e, twoRotations(mobility.getTurn(e)).transpose() * wrench,
                                       0);
            }
        const double tolerance = fluid.force.getSolverTolerance();
        const bool fast =
            group->bodies.hasModel() && ErrorBudget::savesTime(group->bodies.getModel(), tolerance);
        if (group->joints)
            u = mobilityWithJoints(*group, mobility) * f;
        else
            mobility.multiply(f, u, {fast ? tolerance : 0});
        for (size_t e = 0; e < elements.size(); e++)
            if (!elements[e].isFree())
                result.segment<6>(6 * elements[e].body) =
                    u.middleRows<6>(group->bodies.firstRow(e));
    }
    return result;
}

VectorXd FluidAnswers::applyToBlobs(const VectorXd& forces, const BodySet& bodies,
                                    const vector<OpenMM::Vec3>& positions) {
    const OneBlasThread single;
    VectorXd result = VectorXd::Zero(forces.size());
    for (const auto& group : fluid.groups)
        answering(*group, bodies, positions).applyToParticles(forces, result);
    return result;
}

/** Scatter the fixed components of a group's wrenches to bodies and to particles of the System. */
void FluidAnswers::scatterHolds(const FluidGroup& group, const MatrixXd& from, Holds& to) const {
    const auto& elements = group.bodies.getElements();
    for (size_t e = 0; e < elements.size(); e++)
        for (int k = 0; k < elements[e].numRows(); k++) {
            const int row = group.bodies.firstRow(e) + k;
            if (elements[e].isWhollyFree() ||
                (!elements[e].fixedInBody && group.bodies.getFreeMotion().isFree(row)))
                continue;
            if (elements[e].isFree())
                to.ofParticles[3 * elements[e].particles[0] + k] = from(row, 0);
            else
                to.ofBodies[6 * elements[e].body + k] = from(row, 0);
        }
}

FluidAnswers::Holds FluidAnswers::noHolds(int numParticles) const {
    return {VectorXd::Zero(6 * fluid.groupOfBody.size()), VectorXd::Zero(3 * numParticles)};
}

bool FluidAnswers::knowsHoldsOfLastStep() const {
    fluid.findHolds();
    for (const auto& group : fluid.groups)
        if (group->bodies.getFreeMotion().any() && !group->brownian->getHolds()) return false;
    return true;
}

FluidAnswers::Holds FluidAnswers::holdsOfLastStep(int numParticles) const {
    Holds holds = noHolds(numParticles);
    for (const auto& group : fluid.groups)
        if (group->brownian->getHolds()) scatterHolds(*group, *group->brownian->getHolds(), holds);
    return holds;
}

FluidAnswers::Holds FluidAnswers::holdsNow(const FlowQuestion& question) const {
    const OneBlasThread single;
    Holds holds = noHolds(question.positions.size());
    for (const auto& group : fluid.groups) {
        if (!group->bodies.getFreeMotion().any()) continue;
        BrownianGroup& brownian = *group->brownian;
        BodyMobility& mobility = brownian.mobilityFor(0, question.scheme);
        mobility.setTolerance(fluid.force.getSolverTolerance());
        OverdampedMove move(mobility);
        move.setJoints(brownian.getJoints());
        OverdampedStep step;
        step.flow = fluid.getFlow();
        step.motorRates = brownian.getMotorRates();
        group->members.readPoses(question.bodies, question.positions, move.start);
        move.begin(step);
        move.force = brownian.readForces(question.bodies, question.freeParticles);
        move.atStart();
        MatrixXd own = MatrixXd::Zero(group->bodies.getNumRows(), 1), twists, forces;
        if (question.hasMomenta()) {
            group->members.readTwists(question.bodies, question.velocities, question.prescribed,
                                      twists);
            mobility.flow().forcesOfTwists(twists, fluid.getFlow(), forces);
            mobility.totalWrenches(move.start, forces, own);
            own -= move.force;
        } else {
            MatrixXd prescribed;
            if (group->members.readPrescribed(question.prescribed, prescribed))
                move.prescribe(&prescribed);
            move.recording.holds = &own;
            move.solve(move.velocity(1, move.force), twists);
        }
        scatterHolds(*group, own, holds);
    }
    return holds;
}

}  // namespace RigidHIPlugin
