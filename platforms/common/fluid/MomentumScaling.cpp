#include "fluid/MomentumScaling.h"

#include <cmath>

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

MomentumScaling::MomentumScaling(const CoupledBodies& coupled, const vector<int>& freeIndex,
                                 const BodySet& bodies)
    : coupled(coupled), freeIndex(freeIndex) {
    const auto& elements = coupled.getElements();
    for (size_t e = 0; e < elements.size(); e++) {
        int live = 0;
        if (elements[e].isWhollyFixed()) {
            numLive.push_back(0);
            firstRows.push_back(-1);
            continue;
        }
        if (!elements[e].isFree()) {
            for (int k = 0; k < 3; k++) live += bodies.inertia(elements[e].body).isLive(k);
            deadAxesAreNull_ = deadAxesAreNull_ && live == (coupled.hasNullVector(e) ? 2 : 3);
        }
        numLive.push_back(live);
        firstRows.push_back(numRows);
        numRows += 3 + live;
    }
}

void MomentumScaling::matrix(bool inverse, BodyMobility& mobility, const BodySet& bodies,
                             const FreeParticles& freeParticles, MatrixXd& S) {
    const MatrixXd& matrix = inverse ? mobility.mobility() : mobility.friction();
    const auto& elements = coupled.getElements();
    half.resize(numRows, matrix.cols());
    S.resize(numRows, numRows);
    const auto weight = [&](double inertia) { return inverse ? sqrt(inertia) : 1 / sqrt(inertia); };
    for (int pass = 0; pass < 2; pass++)
        for (size_t e = 0; e < elements.size(); e++) {
            const int row = coupled.firstRow(e), z = firstRows[e];
            if (elements[e].isWhollyFixed()) continue;
            const double mass = elements[e].isFree() ? freeParticles.mass(freeIndex[e])
                                                     : bodies.inertia(elements[e].body).mass;
            if (pass == 0)
                half.middleRows<3>(z) = weight(mass) * matrix.middleRows<3>(row);
            else
                S.middleCols<3>(z) = weight(mass) * half.middleCols<3>(row);
            if (elements[e].isFree()) continue;
            const BodyInertia& inertia = bodies.inertia(elements[e].body);
            const Matrix3d& A = mobility.getTurn(e);
            for (int k = 0, next = z + 3; k < 3; k++) {
                if (!inertia.isLive(k)) continue;
                const Vector3d axis = weight(inertia.moments[k]) * A.col(k);
                if (pass == 0)
                    half.row(next++).noalias() = axis.transpose() * matrix.middleRows<3>(row + 3);
                else
                    S.col(next++).noalias() = half.middleCols<3>(row + 3) * axis;
            }
        }
}

void MomentumScaling::wrenches(const MatrixXd& x, const BodyMobility& mobility,
                               const BodySet& bodies, const FreeParticles& freeParticles,
                               MatrixXd& wrenches) const {
    scale(x, true, mobility, bodies, freeParticles, wrenches);
}

void MomentumScaling::scaled(const MatrixXd& twists, const BodyMobility& mobility,
                             const BodySet& bodies, const FreeParticles& freeParticles,
                             MatrixXd& x) const {
    scale(twists, false, mobility, bodies, freeParticles, x);
}

void MomentumScaling::scale(const MatrixXd& from, bool fromZ, const BodyMobility& mobility,
                            const BodySet& bodies, const FreeParticles& freeParticles,
                            MatrixXd& to) const {
    const auto& elements = coupled.getElements();
    to.resize(fromZ ? coupled.getNumRows() : numRows, from.cols());
    for (size_t e = 0; e < elements.size(); e++) {
        const int z = firstRows[e], row = coupled.firstRow(e);
        if (elements[e].isWhollyFixed()) {
            if (fromZ) to.middleRows(row, elements[e].numRows()).setZero();
            continue;
        }
        if (elements[e].isFree()) {
            to.middleRows<3>(fromZ ? row : z) =
                sqrt(freeParticles.mass(freeIndex[e])) * from.middleRows<3>(fromZ ? z : row);
            continue;
        }
        const BodyInertia& inertia = bodies.inertia(elements[e].body);
        to.middleRows<3>(fromZ ? row : z) =
            sqrt(inertia.mass) * from.middleRows<3>(fromZ ? z : row);
        if (fromZ) to.middleRows<3>(row + 3).setZero();
        for (int k = 0, next = z + 3; k < 3; k++) {
            if (!inertia.isLive(k)) continue;
            const Vector3d axis = sqrt(inertia.moments[k]) * mobility.getTurn(e).col(k);
            if (fromZ)
                to.middleRows<3>(row + 3).noalias() += axis * from.row(next++);
            else
                to.row(next++).noalias() = axis.transpose() * from.middleRows<3>(row + 3);
        }
    }
}

}  // namespace RigidHIPlugin
