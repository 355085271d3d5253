#include "rigid/HeldBlock.h"

#include <openmm/OpenMMException.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "mobility/MobilityModel.h"
#include "rigid/RigidMotion.h"

using namespace Eigen;
using namespace std;

// OpenBLAS contains LAPACK. Its header would bring complex types that C++ does not accept.
extern "C" {
void dpotrf_(const char* triangle, const int* n, double* a, const int* lda, int* info);
void dpocon_(const char* triangle, const int* n, const double* a, const int* lda,
             const double* norm, double* rcond, double* work, int* iwork, int* info);
void dtrtri_(const char* triangle, const char* diagonal, const int* n, double* a, const int* lda,
             int* info);
void sgemm_(const char* transposedA, const char* transposedB, const int* rows, const int* columns,
            const int* inner, const float* alpha, const float* a, const int* lda, const float* b,
            const int* ldb, const float* beta, float* c, const int* ldc);
void dgemm_(const char* transposedA, const char* transposedB, const int* rows, const int* columns,
            const int* inner, const double* alpha, const double* a, const int* lda, const double* b,
            const int* ldb, const double* beta, double* c, const int* ldc);
void sgemv_(const char* transposed, const int* rows, const int* columns, const float* alpha,
            const float* a, const int* lda, const float* x, const int* incx, const float* beta,
            float* y, const int* incy);
void dgemv_(const char* transposed, const int* rows, const int* columns, const double* alpha,
            const double* a, const int* lda, const double* x, const int* incx, const double* beta,
            double* y, const int* incy);
}

namespace RigidHIPlugin {

namespace {

/** Two blobs at one place leave a pivot that is rounding, of either sign. */
const double smallestCondition = 1e-14;
/**
 * Above this condition, rounding to floats (6e-8) is far smaller than any eigenvalue of the
 * inverse.
 */
const double conditionForFloats = 1e-5;
/** The number of rows of L^-1 that a cache keeps between two products. */
const int panelRows = 64;

/** c = A^T b + beta c, or A b + beta c, where A has the stride `lda`. */
void product(char transposed, int rows, int columns, int vectors, const float* a, int lda,
             const float* b, int ldb, float beta, float* c, int ldc) {
    const float one = 1;
    const int unit = 1, result = transposed == 'T' ? columns : rows,
              inner = transposed == 'T' ? rows : columns;
    if (vectors == 1)
        sgemv_(&transposed, &rows, &columns, &one, a, &lda, b, &unit, &beta, c, &unit);
    else
        sgemm_(&transposed, "N", &result, &vectors, &inner, &one, a, &lda, b, &ldb, &beta, c, &ldc);
}
void product(char transposed, int rows, int columns, int vectors, const double* a, int lda,
             const double* b, int ldb, double beta, double* c, int ldc) {
    const double one = 1;
    const int unit = 1, result = transposed == 'T' ? columns : rows,
              inner = transposed == 'T' ? rows : columns;
    if (vectors == 1)
        dgemv_(&transposed, &rows, &columns, &one, a, &lda, b, &unit, &beta, c, &unit);
    else
        dgemm_(&transposed, "N", &result, &vectors, &inner, &one, a, &lda, b, &ldb, &beta, c, &ldc);
}

}  // namespace

HeldBlock::HeldBlock(const RigidMotion& motion, const MobilityModel& model)
    : motion(motion), model(model) {
    const auto& elements = motion.getElements();
    while (numHeld < (int)elements.size() && elements[numHeld].isHeld)
        numRows += elements[numHeld++].numParticleRows();
}

/** Compute the mobility of held blobs in the frames of the bodies. */
void HeldBlock::findMobility(const vector<Pose>& poses, const vector<Matrix3d>& turns,
                             MatrixXd& M) const {
    const vector<FluidElement> elements(motion.getElements().begin(),
                                        motion.getElements().begin() + numHeld);
    vector<OpenMM::Vec3> positions;
    for (int e = 0; e < numHeld; e++)
        for (const Vector3d& site : elements[e].sites) {
            const Vector3d x =
                elements[e].isFree() ? poses[e].R : Vector3d(poses[e].R + turns[e] * site);
            positions.push_back(OpenMM::Vec3(x[0], x[1], x[2]));
        }
    model.ownMobility(particlesOf(elements), positions, M);
    for (int e = 0, row = 0; e < numHeld; e++)
        for (int end = row + elements[e].numParticleRows(); row < end; row += 3) {
            if (elements[e].isFree()) continue;
            M.middleRows<3>(row) = (turns[e].transpose() * M.middleRows<3>(row)).eval();
            M.middleCols<3>(row) = (M.middleCols<3>(row) * turns[e]).eval();
        }
}

bool HeldBlock::setPoses(const vector<Pose>& poses, const vector<Matrix3d>& turns) {
    bool known = !heldPoses.empty();
    for (int e = 0; known && e < numHeld; e++) known = areSame(heldPoses[e], poses[e]);
    if (known) return false;
    heldPoses.clear();
    MatrixXd M;
    findMobility(poses, turns, M);
    const double norm = M.cwiseAbs().colwise().sum().maxCoeff();
    int info = 0;
    dpotrf_("L", &numRows, M.data(), &numRows, &info);
    condition = 0;
    if (info == 0 && isfinite(M.diagonal().sum())) {
        vector<double> work(3 * numRows);
        vector<int> integers(numRows);
        dpocon_("L", &numRows, M.data(), &numRows, &norm, &condition, work.data(), integers.data(),
                &info);
    }
    if (!(condition > smallestCondition))
        throw OpenMM::OpenMMException(
            "MobilityForce: the mobility matrix of the " + to_string(numRows / 3) +
            " blobs of all held bodies is not positive definite; look for blobs at the same place");
    dtrtri_("L", "N", &numRows, M.data(), &numRows, &info);
    isSingle = condition > conditionForFloats;
    single = {};
    exact = {};
    M.triangularView<StrictlyUpper>().setZero();
    if (isSingle)
        single.set(M);
    else
        exact.set(M);
    heldPoses.assign(poses.begin(), poses.begin() + numHeld);
    return true;
}

/** Columns of a panel are rows of L^-1. */
template <class Number>
void HeldBlock::Inverse<Number>::set(const MatrixXd& lower) {
    const int n = lower.rows();
    for (int first = 0; first < n; first += panelRows) {
        const int end = min(first + panelRows, n);
        for (int row = first; row < end; row++)
            for (int column = 0; column < end; column++) panels.push_back(lower(row, column));
    }
    x.resize(n, 0);
}

template <class Number>
void HeldBlock::Inverse<Number>::apply(const MatrixXd& from, MatrixXd& to) {
    const int n = x.rows(), vectors = from.cols();
    // Scale the vectors, since floats hold numbers from 1e-38 to 1e38 only.
    const double largest = from.topRows(n).cwiseAbs().maxCoeff(),
                 unit = largest > 0 && isfinite(largest) ? largest : 1;
    x = (from.topRows(n) / unit).template cast<Number>();
    sum.setZero(n, vectors);
    ofPanel.resize(panelRows, vectors);
    const Number* panel = panels.data();
    for (int first = 0; first < n; first += panelRows) {
        const int end = min(first + panelRows, n), rows = end - first;
        product('T', end, rows, vectors, panel, end, x.data(), n, 0, ofPanel.data(), panelRows);
        product('N', end, rows, vectors, panel, end, ofPanel.data(), panelRows, 1, sum.data(), n);
        panel += static_cast<size_t>(end) * rows;
    }
    to.topRows(n) = unit * sum.template cast<double>();
}

void HeldBlock::apply(const MatrixXd& from, MatrixXd& to) {
    if (isSingle)
        single.apply(from, to);
    else
        exact.apply(from, to);
}

}  // namespace RigidHIPlugin
