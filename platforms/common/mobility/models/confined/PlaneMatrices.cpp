#include "mobility/models/confined/PlaneMatrices.h"

#include "linearalgebra/Decompositions.h"

namespace RigidHIPlugin {

using Matrix = PlaneConditions::Matrix;

Matrix principalRoot(const Matrix& square) {
    const Eigen::MatrixXd doubles = square.cast<double>();
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(doubles);
    const auto values = solver.eigenvalues().cwiseMax(0).cwiseSqrt();
    return (solver.eigenvectors() * values.asDiagonal() * solver.eigenvectors().transpose())
        .cast<PlaneConditions::Real>();
}

Matrix rootOf(const Matrix& square) {
    const Eigen::MatrixXd doubles = square.cast<double>();
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(doubles);
    const Eigen::MatrixXd root =
        solver.eigenvectors() * solver.eigenvalues().cwiseMax(0).cwiseSqrt().asDiagonal();
    return root.cast<PlaneConditions::Real>();
}

Matrix inverseOf(const Matrix& matrix) { return matrix.inverse(); }

Matrix inverseFactorOf(const Matrix& square) {
    const Matrix L = Eigen::LLT<Matrix>(square).matrixL();
    return inverseOf(L).transpose();
}

}  // namespace RigidHIPlugin
