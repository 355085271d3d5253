#include "mobility/ForceTorqueStresslet.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

namespace RigidHIPlugin {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;

namespace {

/** Columns n.B_a of an orthonormal basis B_a (a = 0..4) of the symmetric traceless tensors. */
Eigen::Matrix<double, 3, 5> contractBasis(const Vector3d& n) {
    const double half = std::sqrt(0.5), third = std::sqrt(1.0 / 6);
    Eigen::Matrix<double, 3, 5> v;
    // B_0 = (2zz-xx-yy)/sqrt 6, B_1 = (xx-yy)/sqrt 2, then (xy+yx), (xz+zx), (yz+zy) over sqrt 2
    v << -third * n.x(), half * n.x(), half * n.y(), half * n.z(), 0,  //
        -third * n.y(), -half * n.y(), half * n.x(), 0, half * n.z(),  //
        2 * third * n.z(), 0, 0, half * n.x(), half * n.y();
    return v;
}

Matrix3d crossProduct(const Vector3d& v) {
    Matrix3d m;
    m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
    return m;
}

/** What two spheres do to each other at centre distance r, direction n from j to i; in units of 1/(8 pi viscosity). */
struct PairMobility {
    Matrix3d tt, rt, rr;                 // of (F_j, T_j) on (U_i, Omega_i); the coupling of T_j to U_i equals rt
    Eigen::Matrix<double, 3, 5> ts, rs;  // of S_j on (U_i, Omega_i)
    Eigen::Matrix<double, 3, 5> tsBackward, rsBackward;  // of S_i on (U_j, Omega_j)
    Eigen::Matrix<double, 5, 5> ss;

    PairMobility(double ai, double aj, double r, const Vector3d& n) {
        const double r2 = r * r, r3 = r2 * r, r4 = r2 * r2, r5 = r4 * r;
        const double squares = ai * ai + aj * aj;
        const Matrix3d one = Matrix3d::Identity(), nn = n * n.transpose(), cross = crossProduct(n);
        tt = (1 / r + squares / (3 * r3)) * one + (1 / r - squares / r3) * nn;
        rt = -cross / r2;  // Omega_i = F_j x n / r²
        rr = (1.5 * nn - 0.5 * one) / r3;
        // the stresslet's flow is 3 n (n.S.n)/r²; each Faxén Laplacian adds (12 S.n - 30 n (n.S.n))/r⁴ times its coefficient
        const Eigen::Matrix<double, 3, 5> v = contractBasis(n);
        const Eigen::Matrix<double, 1, 5> s = n.transpose() * v;
        const auto velocity = [&](double laplacian) -> Eigen::Matrix<double, 3, 5> {
            return (3 / r2 - 30 * laplacian / r4) * n * s + 12 * laplacian / r4 * v;
        };
        ts = velocity(ai * ai / 6 + aj * aj / 10);
        tsBackward = -velocity(aj * aj / 6 + ai * ai / 10);  // n changes sign
        rs = -3 / r3 * cross * v;                            // Omega_i = 3 (S.n) x n / r³
        rsBackward = rs;
        const double laplacian = squares / 10;
        ss = 12 * laplacian / r5 * Eigen::Matrix<double, 5, 5>::Identity() +
             2 * (3 / r3 - 60 * laplacian / r5) * v.transpose() * v +
             (-15 / r3 + 210 * laplacian / r5) * s.transpose() * s;
    }
};

}  // namespace

MatrixXd forceTorqueStressletMobility(const std::vector<double>& radii, const std::vector<OpenMM::Vec3>& positions,
                                      double viscosity) {
    const int n = radii.size();
    MatrixXd mobility(6 * n, 6 * n), ss(5 * n, 5 * n), coupling(5 * n, 6 * n);  // coupling: E of F, T
    for (int i = 0; i < n; i++) {
        const double a = radii[i], a3 = a * a * a;
        mobility.block<6, 6>(6 * i, 6 * i).setZero();
        mobility.block<3, 3>(6 * i, 6 * i).diagonal().setConstant(4 / (3 * a));
        mobility.block<3, 3>(6 * i + 3, 6 * i + 3).diagonal().setConstant(1 / a3);
        ss.block<5, 5>(5 * i, 5 * i) = 6 / (5 * a3) * Eigen::Matrix<double, 5, 5>::Identity();
        coupling.block<5, 6>(5 * i, 6 * i).setZero();
        for (int j = 0; j < i; j++) {
            const OpenMM::Vec3 d = positions[i] - positions[j];
            const double distance = std::sqrt(d.dot(d));
            const PairMobility pair(radii[i], radii[j], std::max(distance, radii[i] + radii[j]),
                                    Vector3d(d[0], d[1], d[2]) / distance);
            mobility.block<3, 3>(6 * i, 6 * j) = pair.tt;
            mobility.block<3, 3>(6 * i + 3, 6 * j) = pair.rt;
            mobility.block<3, 3>(6 * i, 6 * j + 3) = pair.rt;
            mobility.block<3, 3>(6 * i + 3, 6 * j + 3) = pair.rr;
            mobility.block<6, 6>(6 * j, 6 * i) = mobility.block<6, 6>(6 * i, 6 * j).transpose();
            ss.block<5, 5>(5 * i, 5 * j) = pair.ss;
            ss.block<5, 5>(5 * j, 5 * i) = pair.ss.transpose();
            // by the reciprocal theorem E_j of F_i is the transpose of U_i of S_j
            coupling.block<5, 3>(5 * j, 6 * i) = pair.ts.transpose();
            coupling.block<5, 3>(5 * j, 6 * i + 3) = pair.rs.transpose();
            coupling.block<5, 3>(5 * i, 6 * j) = pair.tsBackward.transpose();
            coupling.block<5, 3>(5 * i, 6 * j + 3) = pair.rsBackward.transpose();
        }
    }
    // E = 0: the stresslets are -ss^-1 coupling (F, T)
    Eigen::LLT<Eigen::Ref<MatrixXd>> factor(ss);
    factor.matrixL().solveInPlace(coupling);
    mobility.selfadjointView<Eigen::Lower>().rankUpdate(coupling.transpose(), -1.0);
    mobility.triangularView<Eigen::StrictlyUpper>() = mobility.transpose();
    return mobility / (8 * M_PI * viscosity);
}

}  // namespace RigidHIPlugin
