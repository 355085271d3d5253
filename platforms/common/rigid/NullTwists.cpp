#include "rigid/NullTwists.h"

#include <Eigen/Geometry>

#include "linearalgebra/Decompositions.h"
#include "rigid/RigidMotion.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

namespace {

using Vector6d = Matrix<double, 6, 1>;

/**
 * Blobs nearer to a line than this, relative to the body's size, count as on the line: files rarely
 * give coordinates to more digits.
 */
const double lineTolerance = 1e-9;

/**
 * The twist about the line of the sites, which leaves all sites where they are; an empty vector if
 * the sites are not on one line.
 */
VectorXd twistAboutLine(const vector<Vector3d>& sites) {
    Vector3d centre = Vector3d::Zero();
    for (const Vector3d& s : sites) centre += s / sites.size();
    MatrixXd spread(3, sites.size());
    for (size_t i = 0; i < sites.size(); i++) spread.col(i) = sites[i] - centre;
    const SelfAdjointEigenSolver<Matrix3d> solver(Matrix3d(spread * spread.transpose()));
    const Vector3d line = solver.eigenvectors().col(2);
    for (size_t i = 0; i < sites.size(); i++)
        if (Vector3d(spread.col(i)).cross(line).norm() > lineTolerance * spread.norm())
            return VectorXd();
    VectorXd twist(6);
    twist << -line.cross(centre), line;
    return twist / twist.norm();
}

/**
 * Replace twists by Q twists: subtract the multiple of n after which they have no rotation about
 * the line.
 */
void removeTurn(const Vector6d& n, Ref<MatrixXd> twists) {
    const Vector3d line = n.tail<3>();
    for (int c = 0; c < twists.cols(); c++)
        twists.col(c) -= line.dot(twists.col(c).tail<3>()) / line.squaredNorm() * n;
}

/**
 * Replace wrenches by Q^T wrenches: subtract the torque about the line after which they do no work
 * on n.
 */
void removeTorque(const Vector6d& n, Ref<MatrixXd> wrenches) {
    const Vector3d line = n.tail<3>();
    for (int c = 0; c < wrenches.cols(); c++)
        wrenches.col(c).tail<3>() -= n.dot(wrenches.col(c)) / line.squaredNorm() * line;
}

}  // namespace

void NullTwists::find(int e, const vector<Vector3d>& sites) {
    twists_body[e] = twistAboutLine(sites);
    hasAny = hasAny || has(e);
}

void NullTwists::fix(int e, const FluidElement& components) {
    if (!has(e) || components.isWhollyFree() || components.isWhollyFixed()) return;
    partlyFixed[e] = {true, components.fixedInBody, components.fixed, components.axes};
}

/** The part of a twist in fixed components. */
static Vector6d fixedPart(const Vector6d& twist, unsigned fixed, const Matrix3d& toLab) {
    Vector6d ofAxes = twoRotations(toLab.transpose()) * twist;
    for (int k = 0; k < 6; k++)
        if (!(fixed >> k & 1)) ofAxes[k] = 0;
    return twoRotations(toLab) * ofAxes;
}

/** Call action(n, row) with the null twists in the lab frame. */
template <class Action>
void NullTwists::forEach(const vector<Matrix3d>& turns, const Action& action) const {
    if (!hasAny) return;
    const double noPart = 1e-9;  // the twist is free
    for (size_t e = 0; e < rows.size(); e++) {
        if (!has(e)) continue;
        const Vector6d n = twoRotations(turns[e]) * twists_body[e];
        const PartlyFixed& own = partlyFixed[e];
        const Matrix3d toLab = own.inBody ? Matrix3d(turns[e] * own.axes) : Matrix3d::Identity();
        if (!own.is || fixedPart(n, own.fixed, toLab).norm() <= noPart) action(n, rows[e]);
    }
}

/**
 * Call action(n, fixed part of n, row, element, axes to lab) for null twists that a fixed component
 * prevents.
 */
template <class Action>
void NullTwists::forPartlyFixed(const vector<Matrix3d>& turns, const Action& action) const {
    if (!hasAny) return;
    const double noPart = 1e-9;
    for (size_t e = 0; e < rows.size(); e++) {
        const PartlyFixed& own = partlyFixed[e];
        if (!own.is) continue;
        const Vector6d n = twoRotations(turns[e]) * twists_body[e];
        const Matrix3d toLab = own.inBody ? Matrix3d(turns[e] * own.axes) : Matrix3d::Identity();
        const Vector6d fixed = fixedPart(n, own.fixed, toLab);
        if (fixed.norm() > noPart) action(n, fixed, rows[e], e, toLab);
    }
}

void NullTwists::lift(const vector<Matrix3d>& turns, MatrixXd& friction) const {
    if (!hasAny) return;
    const double size = friction.trace() / friction.rows();
    forEach(turns, [&](const Vector6d& n, int row) {
        friction.block<6, 6>(row, row) += size * n * n.transpose();
    });
    forPartlyFixed(turns,
                   [&](const Vector6d&, const Vector6d& fixed, int row, int, const Matrix3d&) {
                       friction.block<6, 6>(row, row) += size * fixed * fixed.transpose();
                   });
}

void NullTwists::project(const vector<Matrix3d>& turns, MatrixXd& inverse) const {
    forEach(turns, [&](const Vector6d& n, int row) {
        removeTurn(n, inverse.middleRows<6>(row));
        Matrix<double, 6, 6> own = inverse.block<6, 6>(row, row).transpose();
        removeTurn(n, own);
        for (int i = 0; i < inverse.rows(); i++)
            inverse.row(i).segment<6>(row) = inverse.col(i).segment<6>(row);
        inverse.block<6, 6>(row, row) = own;
    });
}

void NullTwists::removeTurns(const vector<Matrix3d>& turns, MatrixXd& twists) const {
    forEach(turns, [&](const Vector6d& n, int row) { removeTurn(n, twists.middleRows<6>(row)); });
}

void NullTwists::removeTorques(const vector<Matrix3d>& turns, MatrixXd& wrenches) const {
    forEach(turns,
            [&](const Vector6d& n, int row) { removeTorque(n, wrenches.middleRows<6>(row)); });
}

void NullTwists::removeLift(const vector<Matrix3d>& turns, MatrixXd& wrenches) const {
    forEach(turns, [&](const Vector6d& n, int row) {
        auto own = wrenches.middleRows<6>(row);
        for (int c = 0; c < own.cols(); c++) own.col(c) -= n * n.dot(own.col(c));
    });
    removeWorkOfFixed(turns, wrenches);
}

/** The lift is n_o n_o^T, and n^T of a wrench with the covariance of the friction is 0. */
void NullTwists::removeWorkOfFixed(const vector<Matrix3d>& turns, MatrixXd& wrenches) const {
    forPartlyFixed(turns,
                   [&](const Vector6d& n, const Vector6d& fixed, int row, int, const Matrix3d&) {
                       auto own = wrenches.middleRows<6>(row);
                       for (int c = 0; c < own.cols(); c++)
                           own.col(c) -= fixed * n.dot(own.col(c)) / fixed.squaredNorm();
                   });
}

void NullTwists::turnWithFixed(const vector<Matrix3d>& turns, MatrixXd& twists) const {
    forPartlyFixed(turns,
                   [&](const Vector6d& n, const Vector6d& fixed, int row, int, const Matrix3d&) {
                       auto own = twists.middleRows<6>(row);
                       for (int c = 0; c < own.cols(); c++)
                           own.col(c) -= n * fixed.dot(own.col(c)) / fixed.squaredNorm();
                   });
}

/**
 * When a body turns about the axis k, n changes by T n, T = diag(e_k x, e_k x). Its fixed part
 * changes by T n_o where axes turn with the body, and by the fixed part of T n otherwise.
 */
void NullTwists::addDivergenceOfTurns(const vector<Matrix3d>& turns, double factor,
                                      MatrixXd& wrenches) const {
    forPartlyFixed(turns, [&](const Vector6d& n, const Vector6d& fixed, int row, int e,
                              const Matrix3d& toLab) {
        const PartlyFixed& own = partlyFixed[e];
        const double square = fixed.squaredNorm();
        for (int k = 0; k < 3; k++) {
            Vector6d change, ofFixed;
            const auto turned = [k](const Vector6d& x) {
                Vector6d y;
                y << Vector3d::Unit(k).cross(Vector3d(x.head<3>())),
                    Vector3d::Unit(k).cross(Vector3d(x.tail<3>()));
                return y;
            };
            change = turned(n);
            ofFixed = own.inBody ? turned(fixed) : fixedPart(change, own.fixed, toLab);
            const double ofFree = change[3 + k] - ofFixed[3 + k], free = n[3 + k] - fixed[3 + k];
            wrenches.col(0).segment<6>(row) +=
                factor *
                (free * (ofFixed / square - 2 * fixed.dot(ofFixed) / (square * square) * fixed) +
                 ofFree / square * fixed);
        }
    });
}

MatrixXd generalisedInverse(const MatrixXd& friction, const VectorXd& nullVector) {
    MatrixXd lifted = friction;
    const double lift = friction.trace() / friction.rows();
    if (nullVector.size() > 0) lifted += lift * nullVector * nullVector.transpose();
    MatrixXd inverse = inverseOfPositive(lifted);
    if (nullVector.size() > 0) {
        removeTurn(nullVector, inverse);
        inverse.transposeInPlace();
        removeTurn(nullVector, inverse);
    }
    return 0.5 * (inverse + inverse.transpose());
}

}  // namespace RigidHIPlugin
