#include "schemes/FluidOrnsteinUhlenbeck.h"

#include <openmm/OpenMMException.h>

#include <cmath>
#include <sstream>

namespace RigidHIPlugin {

namespace {

/**
 * Negative eigenvalues of at most this times the largest eigenvalue are zeros with rounding: the
 * friction of a rotation that the fluid does not resist.
 */
const double roundingOfZero = 1e-12;

}  // namespace

void FluidOrnsteinUhlenbeck::decompose(const Eigen::MatrixXd& matrix, bool isInverse) {
    eigen.compute(matrix);
    const int n = matrix.rows();
    rates = eigen.values();
    if (n == 0) return;
    const double largest = eigen.values()[n - 1], smallest = eigen.values()[0];
    if (!(smallest > (isInverse ? 0 : -roundingOfZero * largest))) {
        std::ostringstream text;
        text << "LangevinHI: the " << (isInverse ? "mobility" : "friction")
             << " matrix is not positive definite: its mass-weighted eigenvalues are from "
             << smallest << " to " << largest
             << ", and rounding is about 1e-16 of the largest; look for overlapping or nearly "
                "touching particles, or make the masses and radii of bodies more alike";
        throw OpenMM::OpenMMException(text.str());
    }
    for (int i = 0; i < n; i++) rates[i] = isInverse ? 1 / rates[i] : std::max(0.0, rates[i]);
}

void FluidOrnsteinUhlenbeck::step(double h, double kT, Eigen::VectorXd& Z,
                                  const Eigen::VectorXd& chi) {
    // If nothing decays much, Z + (exp(-S h) - 1) Z keeps digits of Z that V V^T Z would lose.
    const int n = rates.size();
    if (n == 0) return;
    const bool weak = rates.maxCoeff() * h < 0.5;
    modes.noalias() = eigen.vectors().transpose() * Z;
    for (int i = 0; i < n; i++)
        modes[i] *= weak ? std::expm1(-rates[i] * h) : std::exp(-rates[i] * h);
    if (kT > 0) {
        noiseModes.noalias() = eigen.vectors().transpose() * chi;
        for (int i = 0; i < n; i++)
            modes[i] += std::sqrt(-kT * std::expm1(-2 * rates[i] * h)) * noiseModes[i];
    }
    if (weak)
        Z.noalias() += eigen.vectors() * modes;
    else
        Z.noalias() = eigen.vectors() * modes;
}

void FluidOrnsteinUhlenbeck::matrices(double h, Eigen::MatrixXd& decayMinusOne,
                                      Eigen::MatrixXd& noise) {
    const auto& V = eigen.vectors();
    modes = rates;
    noiseModes = rates;
    for (int i = 0; i < rates.size(); i++) {
        modes[i] = std::expm1(-rates[i] * h);
        noiseModes[i] = std::sqrt(-std::expm1(-2 * rates[i] * h));
    }
    decayMinusOne.noalias() = V * modes.asDiagonal() * V.transpose();
    noise.noalias() = V * noiseModes.asDiagonal() * V.transpose();
}

}  // namespace RigidHIPlugin
