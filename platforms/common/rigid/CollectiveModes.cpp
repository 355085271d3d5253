#include "rigid/CollectiveModes.h"

#include <algorithm>
#include <cmath>

#include "linearalgebra/Decompositions.h"
#include "rigidbody/EigenVec3.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

int CollectiveModes::numGroups(int numMembers, int numParticles) {
    // For fewer members the largest eigenvalue is not much larger than the others.
    const int fewest = 24;
    if (numMembers < fewest) return 0;
    // With this number of groups the factor takes about as long as a product with the mobility (by
    // a sum over all pairs, or by multipoles where the number of groups is at its limit). An
    // operation of a factor takes some ten times as long as one of a sum over pairs.
    const int most = 700;
    const double factorForProducts = 0.9;
    return min<double>({double(numMembers), most, factorForProducts * pow(numParticles, 2.0 / 3)});
}

void CollectiveModes::clear() {
    groups.clear();
    vectors.clear();
}

/** Halve members along the longest edge of their box, down to `count` groups. */
void CollectiveModes::divide(const vector<Member>& members, int first, int end, int count) {
    if (count <= 1 || end - first <= 1) {
        groups.emplace_back();
        groups.back().members.assign(order.begin() + first, order.begin() + end);
        return;
    }
    Vector3d low = members[order[first]].centre, high = low;
    for (int i = first; i < end; i++) {
        low = low.cwiseMin(members[order[i]].centre);
        high = high.cwiseMax(members[order[i]].centre);
    }
    int axis;
    (high - low).maxCoeff(&axis);
    const int countOfFirst = count / 2;
    const int middle = first + (long long)(end - first) * countOfFirst / count;
    nth_element(order.begin() + first, order.begin() + middle, order.begin() + end,
                [&](int a, int b) {
                    const double x = members[a].centre[axis], y = members[b].centre[axis];
                    return x < y || (x == y && a < b);
                });
    sort(order.begin() + first, order.begin() + middle);
    sort(order.begin() + middle, order.begin() + end);
    divide(members, first, middle, countOfFirst);
    divide(members, middle, end, count - countOfFirst);
}

/**
 * Compute centre, friction and radius of each group. A sphere of this radius has the group's mean
 * mobility, for a force that the members share in proportion to their friction.
 */
void CollectiveModes::measure(const vector<Member>& members, double viscosity) {
    vector<double> a(members.size());  // the Stokes radius of each
    for (size_t i = 0; i < members.size(); i++)
        a[i] = members[i].translations.squaredNorm() / (18 * M_PI * viscosity);
    for (Group& group : groups) {
        for (int i : group.members) {
            group.friction += a[i];
            group.centre += a[i] * members[i].centre;
        }
        group.centre /= group.friction;
        double mean = 0;
        for (int i : group.members)
            for (int j : group.members) {
                const double r = (members[i].centre - members[j].centre).norm(), both = a[i] + a[j];
                // The trace of a pair's RPY block, for equal radii where spheres overlap.
                mean += a[i] * a[j] * (r > both ? 1 / r : 2 / both * (1 - r / (2 * both)));
            }
        group.radius = group.friction * group.friction / mean;
    }
}

void CollectiveModes::makeVectors(const vector<Member>& members) {
    vectors.resize(members.size());
    for (size_t g = 0; g < groups.size(); g++) {
        Matrix3d friction = Matrix3d::Zero();
        for (int i : groups[g].members)
            friction += members[i].translations.transpose() * members[i].translations;
        const Matrix3d root = SelfAdjointEigenSolver<Matrix3d>(friction).operatorInverseSqrt();
        for (int i : groups[g].members)
            vectors[i] = {members[i].firstRow, int(g), members[i].translations * root};
    }
}

bool CollectiveModes::compute(const MobilityModel& model, const vector<Member>& members,
                              int mostGroups) {
    clear();
    if (mostGroups < 2) return false;
    order.resize(members.size());
    for (size_t i = 0; i < order.size(); i++) order[i] = i;
    divide(members, 0, members.size(), mostGroups);
    measure(members, model.getViscosity());
    HydrodynamicParticles spheres;
    Placement placement;
    for (size_t g = 0; g < groups.size(); g++) {
        spheres.add(groups[g].radius, false, g, -1);
        placement.positions.push_back(toVec3(groups[g].centre));
    }
    const unique_ptr<MobilityModel> coarse = model.forCollectiveModes(spheres);
    MatrixXd C;
    if (coarse && coarse->objection(placement).empty()) coarse->at(placement)->dense(C);
    VectorXd scale(C.rows());
    for (size_t g = 0; g < groups.size() && C.size() > 0; g++)
        scale.segment<3>(3 * g).setConstant(
            sqrt(6 * M_PI * model.getViscosity() * groups[g].friction));
    C = scale.asDiagonal() * C * scale.asDiagonal();
    // A sphere is a bad approximation for a group that is flat or near a wall: if its radius is
    // larger than its height, its mobility is far too small. The modes of such a group would become
    // far too fast in S'. A single body has no such error.
    const double ofGroups = 0.5;
    for (size_t g = 0; g < groups.size() && C.size() > 0; g++)
        if (groups[g].members.size() > 1) C.diagonal().segment<3>(3 * g).array() += ofGroups;
    if (C.size() == 0 || !C.allFinite() || !factor.compute(C)) {
        clear();
        return false;
    }
    makeVectors(members);
    return true;
}

/** x <- x + Y (act - 1) Y^T x */
template <class Act>
void CollectiveModes::act(MatrixXd& x, const Act& act) const {
    if (!any()) return;
    modes.setZero(3 * groups.size(), x.cols());
    for (const Vectors& own : vectors)
        modes.middleRows<3>(3 * own.group).noalias() +=
            own.Y.transpose() * x.middleRows(own.firstRow, own.Y.rows());
    changed = modes;
    act(changed);
    changed -= modes;
    for (const Vectors& own : vectors)
        x.middleRows(own.firstRow, own.Y.rows()).noalias() +=
            own.Y * changed.middleRows<3>(3 * own.group);
}

void CollectiveModes::multiply(MatrixXd& x) const {
    act(x, [this](MatrixXd& y) { y = (factor.L() * MatrixXd(y)).eval(); });
}

void CollectiveModes::solve(MatrixXd& x) const {
    act(x, [this](MatrixXd& y) { factor.solveL(y); });
}

void CollectiveModes::solveTransposed(MatrixXd& x) const {
    act(x, [this](MatrixXd& y) { factor.solveU(y); });
}

}  // namespace RigidHIPlugin
