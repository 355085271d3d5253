// Fluid: answers to users, and descriptions of the fluid.

#include <sstream>

#include "fluid/Fluid.h"
#include "linearalgebra/OneBlasThread.h"
#include "mobility/Models.h"
#include "openmmrigidhi/internal/Messages.h"
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
        mobility.multiply(f, u, fast ? force.getSolverTolerance() : 0);
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

string Fluid::describeBox() const {
    ostringstream text;
    text << "the periodic box";
    for (int k = 0; k < 3; k++)
        text << (k == 0 ? " (" : ", (") << box[k][0] << ", " << box[k][1] << ", " << box[k][2]
             << ")";
    text << " nm";
    return text.str();
}

/**
 * How iterations make their products, where they are not plain sums over all pairs. In schemes of
 * several stages the last one follows the differences (OverdampedMove::atPresent()).
 */
static string describeProducts(BodyMobility& mobility, bool differenced,
                               const SchemeTraits& scheme) {
    const string products = mobility.describeProducts(!differenced);
    string text = products;
    if (differenced && overdampedScheme(scheme.scheme).numStages() > 1) {
        const string later = mobility.describeProducts(true);
        if (later != products)
            text = (products.empty() ? "over all pairs" : products) + " for differences, then " +
                   later;
    }
    return text.empty() ? text : ", products in iterations " + text;
}

string Fluid::describe(const SchemeTraits& scheme) const {
    const bool overdamped = scheme.isOverdamped();
    const auto mobilityOf = [&](const FluidGroup& group) -> BodyMobility& {
        return overdamped ? *group.overdamped.mobility : group.relaxation->getMobility();
    };
    int bodies = 0, free = 0, thermostats = 0, ways[3] = {0, 0, 0};
    for (int g : groupOfBody) bodies += g >= 0;
    for (int g : groupOfFree) free += g >= 0;
    for (const auto& group : groups)
        if (!overdamped && !group->relaxation)
            thermostats++;
        else
            ways[mobilityOf(*group).getWay()]++;
    ostringstream text;
    text << modelName(force.getModel());
    if (force.getBoundary() == MobilityForce::NoSlipWall)
        text << " above a no-slip wall at z = " << force.getWallHeight()
             << " nm (a step is redone if after it a particle "
             << (settings.wallRejection == CustomRigidHIIntegrator::Crossing
                     ? "has its centre behind the wall)"
                     : "overlaps the wall)");
    if (force.getBoundary() == MobilityForce::SlipChannel) {
        double low, high;
        force.getChannelWalls(low, high);
        text << " between slip walls at y = " << low << " and " << high
             << " nm (a step is redone if after it a particle "
             << (settings.wallRejection == CustomRigidHIIntegrator::Crossing
                     ? "has its centre behind a wall)"
                     : "overlaps a wall)");
    }
    if (isPeriodic())
        text << (force.getBoundary() == MobilityForce::SlipChannel
                     ? " with all images along x and z in "
                     : " with all images in ")
             << describeBox();
    if (isFreeDraining() && force.getBoundary() == MobilityForce::Periodic)
        text << " in a periodic box, where bodies feel neither others nor images, as if unbounded";
    FluidGroup* largest = nullptr;
    for (const auto& group : groups)
        if (!largest || group->bodies.getNumParticleRows() > largest->bodies.getNumParticleRows())
            largest = group.get();
    if (largest && largest->bodies.hasModel()) {
        const string grid = largest->bodies.getModel().describe(box);
        if (!grid.empty()) text << " on " << grid;
        if (!largest->gridChoice.empty())
            text << (grid.empty() ? " by matrices of lattice sums (" : " (") << largest->gridChoice
                 << ")";
    }
    text << ", " << counted(bodies, "body", "bodies") << " and "
         << counted(free, "free particle", "free particles") << "; ";
    if (!overdamped) text << thermostats << " alone with constant isotropic drag (no matrices), ";
    text << ways[BodyMobility::Constant] << " alone with a constant tensor (computed once), "
         << counted(ways[BodyMobility::Dense], "group", "groups") << " with dense matrices, "
         << counted(ways[BodyMobility::Krylov], "group", "groups") << " matrix-free";
    if (largest && largest->bodies.hasModel() && (overdamped || largest->relaxation))
        text << describeProducts(mobilityOf(*largest),
                                 overdamped && differencesIterate(*largest, scheme), scheme);
    return text.str();
}

string Fluid::describeFlow() const {
    if (!isDriven) return {};
    ostringstream text;
    const char* const axes = "xyz";
    const auto row = [&](int k) {
        return RigidHIPlugin::text(toVec3(flow.gradient.row(k).transpose()));
    };
    if (flow.waveVelocity != 0)
        text << "a sinusoidal force density along " << axes[flow.forceAxis] << " with "
             << 2 * M_PI / flow.k << " nm along " << axes[flow.waveAxis]
             << ", which without bodies drives a flow of up to " << abs(flow.waveVelocity)
             << " nm/ps";
    else
        text << "velocity " << RigidHIPlugin::text(toVec3(flow.velocity))
             << " nm/ps at the origin, gradient in rows " << row(0) << ", " << row(1) << ", "
             << row(2) << "/ps";
    if (!flow.hasGradient()) return text.str();
    bool stresslets = true, own = false;
    for (const auto& group : groups) {
        stresslets = stresslets && group->bodies.hasModel() &&
                     group->bodies.getModel().getTraits().hasStresslets;
        for (const FluidElement& element : group->bodies.getElements())
            own = own || element.ownMobility.size() > 0;
    }
    text
        << (stresslets
                ? "; spheres resist its strain by stresslets, without lubrication of the strain"
                : "; multiblobs resist its strain by their blobs, single spheres and blobs do not");
    if (own) text << "; bodies with tensors of their own resist it as their blobs do";
    return text.str();
}

string Fluid::describeAnswers() const {
    int constant = 0, dense = 0, products = 0, iterations = 0, columns = 0;
    string fast;
    for (const auto& group : groups) {
        if (group->bodies.hasModel() && fast.empty())
            fast = group->bodies.getModel().describeFastProducts(force.getSolverTolerance());
        const bool krylov = group->answering->getWay() == BodyMobility::Krylov;
        columns += krylov && group->bodies.isWorthIterations();
        (group->answering->getWay() == BodyMobility::Constant ? constant
         : !krylov                                            ? dense
         : group->bodies.multipliesWithoutIterations()        ? products
                                                              : iterations)++;
    }
    const auto list = [](const vector<pair<int, string> >& ways) {
        string all;
        for (const auto& way : ways)
            if (way.first > 0)
                all += (all.empty() ? "" : ", ") + counted(way.first, "group", "groups") + " " +
                       way.second;
        return all.empty() ? string("no groups") : all;
    };
    ostringstream tolerance;
    tolerance << "by iterations to " << force.getSolverTolerance();
    const string known = "by a constant tensor", matrices = "by dense matrices";
    return "applyMobilityInContext() does " +
           list(
               {{constant, known},
                {products, "by products without a matrix" + (fast.empty() ? string() : " " + fast)},
                {iterations, tolerance.str()},
                {dense, matrices}}) +
           "; getMobilityInContext() " +
           list({{constant, known},
                 {columns, tolerance.str() + ", column by column"},
                 {int(groups.size()) - constant - columns, matrices}}) +
           "; getFrictionInContext() " +
           list({{constant, known}, {int(groups.size()) - constant, matrices}});
}

}  // namespace RigidHIPlugin
