#include "mobility/models/stokesian/ForceTorqueStresslet.h"

#include <algorithm>
#include <cmath>

#include "linearalgebra/Decompositions.h"
#include "mobility/StressletBasis.h"

namespace RigidHIPlugin {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;

namespace {

/**
 * The mutual mobility of two spheres with the distance r of their centres and the direction n from
 * j to i, in units of 1/(8 pi viscosity).
 */
struct PairResponse {
    Matrix3d tt, rt, rr;  // of (F_j, T_j) on (U_i, Omega_i); the coupling of T_j to U_i equals rt
    Eigen::Matrix<double, 3, 5> ts, rs;                  // of S_j on (U_i, Omega_i)
    Eigen::Matrix<double, 3, 5> tsBackward, rsBackward;  // of S_i on (U_j, Omega_j)
    Eigen::Matrix<double, 5, 5> ss;

    PairResponse(double ai, double aj, double r, const Vector3d& n) {
        const double r2 = r * r, r3 = r2 * r;
        const double squares = ai * ai + aj * aj;
        const Matrix3d one = Matrix3d::Identity(), nn = n * n.transpose(), cross = crossProduct(n);
        tt = (1 / r + squares / (3 * r3)) * one + (1 / r - squares / r3) * nn;
        rt = -cross / r2;  // Omega_i = F_j x n / r²
        rr = (1.5 * nn - 0.5 * one) / r3;
        const StressletPair s1 = {ai, aj, r};
        const Eigen::Matrix<double, 3, 5> v = contractBasis(n);
        const Eigen::Matrix<double, 1, 5> s = n.transpose() * v;
        const auto velocity = [&](const StressletPair::Velocity& f) -> Eigen::Matrix<double, 3, 5> {
            return f.along * n * s + f.towards * v;
        };
        ts = velocity(s1.velocity(ai, aj));
        tsBackward = -velocity(s1.velocity(aj, ai));  // n changes sign
        rs = s1.omega() * cross * v;
        rsBackward = rs;
        ss = s1.ssI() * Eigen::Matrix<double, 5, 5>::Identity() + s1.ssV() * v.transpose() * v +
             s1.ssS() * s.transpose() * s;
    }
};

}  // namespace

void computeForceTorqueStressletMobility(const std::vector<double>& radii,
                                         const std::vector<OpenMM::Vec3>& positions,
                                         double viscosity, StressletResponse& response,
                                         MatrixXd& mobility) {
    const int n = radii.size();
    MatrixXd &ss = response.factor, &coupling = response.halfCoupling;  // coupling: E of F, T
    mobility.resize(6 * n, 6 * n);
    ss.resize(5 * n, 5 * n);
    coupling.resize(5 * n, 6 * n);
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
            const PairResponse pair(radii[i], radii[j], std::max(distance, radii[i] + radii[j]),
                                    Vector3d(d[0], d[1], d[2]) / distance);
            mobility.block<3, 3>(6 * i, 6 * j) = pair.tt;
            mobility.block<3, 3>(6 * i + 3, 6 * j) = pair.rt;
            mobility.block<3, 3>(6 * i, 6 * j + 3) = pair.rt;
            mobility.block<3, 3>(6 * i + 3, 6 * j + 3) = pair.rr;
            mobility.block<6, 6>(6 * j, 6 * i) = mobility.block<6, 6>(6 * i, 6 * j).transpose();
            ss.block<5, 5>(5 * i, 5 * j) = pair.ss;
            ss.block<5, 5>(5 * j, 5 * i) = pair.ss.transpose();
            // By the reciprocal theorem, E_j of F_i is the transpose of U_i of S_j.
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
    mobility /= 8 * M_PI * viscosity;
}

MatrixXd forceTorqueStressletMobility(const std::vector<double>& radii,
                                      const std::vector<OpenMM::Vec3>& positions, double viscosity,
                                      StressletResponse* response) {
    StressletResponse own;
    MatrixXd mobility;
    computeForceTorqueStressletMobility(radii, positions, viscosity, response ? *response : own,
                                        mobility);
    return mobility;
}

void StressletResponse::addVelocities(Eigen::VectorXd& strainRates,
                                      Eigen::Ref<Eigen::VectorXd> velocities) const {
    factor.triangularView<Eigen::Lower>().solveInPlace(strainRates);
    velocities.noalias() -= halfCoupling.transpose() * strainRates;
}

Eigen::VectorXd StressletResponse::stresslets(const Eigen::VectorXd& forces,
                                              const Eigen::VectorXd& strainRates,
                                              double viscosity) const {
    Eigen::VectorXd half =
        halfCoupling * forces + factor.triangularView<Eigen::Lower>().solve(
                                    Eigen::VectorXd(8 * M_PI * viscosity * strainRates));
    factor.triangularView<Eigen::Lower>().transpose().solveInPlace(half);
    return -half;
}

}  // namespace RigidHIPlugin
