// Fluid: what users ask for, and what it says about itself.

#include <sstream>

#include "engine/BodyPoses.h"
#include "engine/Fluid.h"
#include "mobility/Models.h"
#include "mobility/OneBlasThread.h"
#include "rigidbody/EigenVec3.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

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
        (group->isThermostat && !overdamped                                                 ? thermostats
         : group->mobility->isConstantInBodyFrame()                                         ? constant
         : (overdamped ? group->overdamped.matrixFree : group->relaxation.solvesMatrixFree) ? matrixFree
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

}  // namespace RigidHIPlugin
