#include "rigid/OwnTensors.h"

#include "linearalgebra/Decompositions.h"
#include "rigid/RigidMotion.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

namespace {

MatrixXd symmetricPower(const MatrixXd& matrix, double power) {
    const SelfAdjointEigenSolver<MatrixXd> solver(matrix);
    return solver.eigenvectors() * solver.eigenvalues().array().pow(power).matrix().asDiagonal() *
           solver.eigenvectors().transpose();
}

}  // namespace

void OwnTensors::set(int e, const MatrixXd& own, const MatrixXd& alone, const SlowedSpin& spin) {
    MatrixXd B_body = symmetricPower(own, 0.5) * symmetricPower(alone, -0.5);
    if (spin.isSlowed()) B_body = spin.congruence() * B_body;
    factors[e] = {true, B_body, inverseOf(B_body)};
    hasAny = true;
}

OwnTensors::Matrix6d OwnTensors::factor(int e, Kind kind, const Matrix3d& A) const {
    const Matrix6d turn = twoRotations(A);
    Matrix6d factor = turn *
                      (kind == InverseTransposedB ? factors[e].inverseB_body : factors[e].B_body) *
                      turn.transpose();
    if (kind != B) factor.transposeInPlace();
    return factor;
}

/** matrix = D matrix D^T, with the block-diagonal D of the factors. */
void OwnTensors::congruence(const Turns& turns, Kind kind, MatrixXd& matrix) const {
    for (size_t e = 0; e < factors.size(); e++) {
        if (!factors[e].exist) continue;
        const Matrix6d F = factor(e, kind, turns[e]);
        for (int c = 0; c < matrix.cols(); c++)
            matrix.col(c).segment<6>(rows[e]) = (F * matrix.col(c).segment<6>(rows[e])).eval();
        for (int r = 0; r < matrix.rows(); r++)
            matrix.row(r).segment<6>(rows[e]) =
                (matrix.row(r).segment<6>(rows[e]) * F.transpose()).eval();
    }
}

void OwnTensors::multiply(const Turns& turns, Kind kind, MatrixXd& vectors) const {
    for (size_t e = 0; e < factors.size(); e++) {
        if (!factors[e].exist) continue;
        const Matrix6d F = factor(e, kind, turns[e]);
        for (int c = 0; c < vectors.cols(); c++)
            vectors.col(c).segment<6>(rows[e]) = (F * vectors.col(c).segment<6>(rows[e])).eval();
    }
}

void OwnTensors::mobility(const Turns& turns, MatrixXd& matrix) const {
    congruence(turns, B, matrix);
}
void OwnTensors::friction(const Turns& turns, MatrixXd& matrix) const {
    congruence(turns, InverseTransposedB, matrix);
}
void OwnTensors::twists(const Turns& turns, MatrixXd& vectors) const {
    multiply(turns, B, vectors);
}
void OwnTensors::wrenchesForModel(const Turns& turns, MatrixXd& vectors) const {
    multiply(turns, TransposedB, vectors);
}
void OwnTensors::wrenchesFromModel(const Turns& turns, MatrixXd& vectors) const {
    multiply(turns, InverseTransposedB, vectors);
}

}  // namespace RigidHIPlugin
