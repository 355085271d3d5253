// Fluid: answers to users.

#include <algorithm>

#include "fluid/Fluid.h"
#include "linearalgebra/OneBlasThread.h"
#include "rigidbody/BodyPoses.h"
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

BodyMobility& Fluid::answering(FluidGroup& group, const BodySet& bodies,
                               const vector<OpenMM::Vec3>& positions) const {
    group.answering->setTolerance(force.getSolverTolerance());
    group.answering->setPoses(group.readPoses(bodies, positions));
    return *group.answering;
}

MatrixXd Fluid::mobility(const BodySet& bodies, const vector<OpenMM::Vec3>& positions) {
    const OneBlasThread single;
    MatrixXd result = MatrixXd::Zero(6 * groupOfBody.size(), 6 * groupOfBody.size());
    for (auto& group : groups)
        scatterBlocks(answering(*group, bodies, positions).mobility(), group->bodies, result);
    return result;
}

MatrixXd Fluid::friction(const BodySet& bodies, const vector<OpenMM::Vec3>& positions) {
    const OneBlasThread single;
    MatrixXd result = MatrixXd::Zero(6 * groupOfBody.size(), 6 * groupOfBody.size());
    for (auto& group : groups) {
        const MatrixXd& friction = answering(*group, bodies, positions).friction();
        const auto& elements = group->bodies.getElements();
        bool hasFree = false;
        for (const FluidElement& element : elements) hasFree = hasFree || element.isFree();
        if (!hasFree) {
            scatterBlocks(friction, group->bodies, result);
            continue;
        }
        // Free particles are force-free. The friction is therefore the inverse of the bodies' part
        // of the mobility: Schur's complement.
        vector<int> bodyRows, freeRows;
        for (size_t e = 0; e < elements.size(); e++)
            for (int i = 0; i < elements[e].numRows(); i++)
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

VectorXd Fluid::apply(const VectorXd& wrenches, const BodySet& bodies,
                      const vector<OpenMM::Vec3>& positions) {
    const OneBlasThread single;
    VectorXd result = VectorXd::Zero(wrenches.size());
    MatrixXd f, u;
    for (auto& group : groups) {
        BodyMobility& mobility = answering(*group, bodies, positions);
        const auto& elements = group->bodies.getElements();
        f.setZero(group->bodies.getNumRows(), 1);
        for (size_t e = 0; e < elements.size(); e++)
            if (!elements[e].isFree()) {
                const Eigen::Matrix<double, 6, 1> wrench =
                    wrenches.segment<6>(6 * elements[e].body);
                f.middleRows<6>(group->bodies.firstRow(e)) = wrench;
                if (group->hasNullVectors)
                    checkTorque(*group, e, twoRotations(mobility.getTurn(e)).transpose() * wrench,
                                0);
            }
        // Products are exact where the model has no fast ones: rounding to floats gains little in
        // one product.
        const bool fast = group->bodies.hasModel() &&
                          group->bodies.getModel().hasFastProducts(force.getSolverTolerance());
        mobility.multiply(f, u, {fast ? force.getSolverTolerance() : 0});
        for (size_t e = 0; e < elements.size(); e++)
            if (!elements[e].isFree())
                result.segment<6>(6 * elements[e].body) =
                    u.middleRows<6>(group->bodies.firstRow(e));
    }
    return result;
}

VectorXd Fluid::applyToBlobs(const VectorXd& forces, const BodySet& bodies,
                             const vector<OpenMM::Vec3>& positions) {
    const OneBlasThread single;
    VectorXd result = VectorXd::Zero(forces.size());
    for (auto& group : groups)
        answering(*group, bodies, positions).applyToParticles(forces, result);
    return result;
}

string Fluid::objection(const BodySet& bodies, const vector<OpenMM::Vec3>& positions) const {
    for (const auto& group : groups) {
        const string text = objection(*group, bodies, positions);
        if (!text.empty()) return text;
    }
    return {};
}

string Fluid::objection(FluidGroup& group, const BodySet& bodies,
                        const vector<OpenMM::Vec3>& positions) const {
    BodyMobility& mobility = *group.answering;
    return mobility.mayObject() ? mobility.objection(group.readPoses(bodies, positions)) : string();
}

bool Fluid::mayObject() const {
    for (const auto& group : groups)
        if (group->answering->mayObject()) return true;
    return false;
}

int Fluid::numInteracting() const {
    int sum = 0;
    for (const auto& group : groups)
        if (group->poses.size() > 1) sum += group->poses.size();
    return sum;
}

GridSeconds Fluid::getGridSeconds() const {
    // Models of several groups share a grid, and each reports the grid's times.
    GridSeconds seconds;
    for (const auto& group : groups)
        if (group->bodies.hasModel()) seconds.raise(group->bodies.getModel().getGridSeconds());
    seconds.add(gridSecondsBefore);
    return seconds;
}

int Fluid::numCollinear() const {
    int sum = 0;
    for (const auto& group : groups)
        for (size_t e = 0; e < group->poses.size(); e++) sum += group->bodies.hasNullVector(e);
    return sum;
}

int Fluid::getNumBodies() const {
    return count_if(groupOfBody.begin(), groupOfBody.end(), [](int g) { return g >= 0; });
}

int Fluid::getNumFree() const {
    return count_if(groupOfFree.begin(), groupOfFree.end(), [](int g) { return g >= 0; });
}

}  // namespace RigidHIPlugin
