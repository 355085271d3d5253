#include "linearalgebra/Gmres.h"

#include <openmm/OpenMMException.h>

#include <cmath>

#include "openmmrigidhi/internal/Messages.h"

using namespace std;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace RigidHIPlugin {

/** The Krylov space of one column, with the rotations that make its Hessenberg matrix triangular.
 */
struct Gmres::Column {
    int index;
    MatrixXd vectors, R;
    VectorXd cosines, sines, rightSide, x;
    int size = 0, iterations = 0;
    double residual = 0, smallest = INFINITY, bound = INFINITY;
    bool isDone = false;

    Column(int index, int rows, int most)
        : index(index), vectors(rows, most + 1), R(most + 1, most), cosines(most), sines(most),
          rightSide(most + 1), x(VectorXd::Zero(rows)) {}
    void begin(const VectorXd& residualVector) {
        size = 0;
        residual = residualVector.norm();
        rightSide.setZero();
        rightSide[0] = residual;
        if (residual > 0) vectors.col(0) = residualVector / residual;
    }
    /**
     * Take in the product with the last vector.
     *
     * @return whether the space grows
     */
    bool add(VectorXd product) {
        auto basis = vectors.leftCols(size + 1);
        auto h = R.col(size);
        h.setZero();
        for (int pass = 0; pass < 2; pass++) {
            const VectorXd part = basis.transpose() * product;
            product -= basis * part;
            h.head(size + 1) += part;
        }
        double next = product.norm();
        const bool grows = next > 1e-14 * h.norm();
        if (grows) vectors.col(size + 1) = product / next;
        for (int k = 0; k < size; k++) {
            const double upper = h[k];
            h[k] = cosines[k] * upper + sines[k] * h[k + 1];
            h[k + 1] = -sines[k] * upper + cosines[k] * h[k + 1];
        }
        const double length = hypot(h[size], next);
        cosines[size] = length > 0 ? h[size] / length : 1;
        sines[size] = length > 0 ? next / length : 0;
        h[size] = length;
        rightSide[size + 1] = -sines[size] * rightSide[size];
        rightSide[size] *= cosines[size];
        residual = abs(rightSide[size + 1]);
        size++;
        iterations++;
        return grows;
    }
    VectorXd coefficients() const {
        return R.topLeftCorner(size, size)
            .triangularView<Eigen::Upper>()
            .solve(rightSide.head(size));
    }
    /** Take in the smallest singular value of R, by inverse iteration. */
    void updateSmallest() {
        const int steps = 10;
        const auto upper = R.topLeftCorner(size, size).triangularView<Eigen::Upper>();
        VectorXd v = VectorXd::Ones(size);
        for (int k = 0; k < steps; k++) {
            v.normalize();
            v = upper.solve(upper.transpose().solve(v));
        }
        smallest = min(smallest, 1 / sqrt(v.norm()));
    }
    bool keeps(const ErrorBound& errorBound, double rounding) {
        if (size == 0 || residual <= rounding) return true;
        updateSmallest();
        bound = residual / smallest / normOfSolution();
        if (bound > errorBound.tolerance) return false;
        bound = residual / smallest / min(normOfSolution(), errorBound.norm(solution()));
        return bound <= errorBound.tolerance;
    }
    MatrixXd solution() const { return x + vectors.leftCols(size) * coefficients(); }
    void addSolution() {
        if (size > 0) x += vectors.leftCols(size) * coefficients();
    }
    /**
     * The norm of the iterate. After a restart the norms of both parts are combined as if
     * orthogonal.
     */
    double normOfSolution() const { return hypot(coefficients().norm(), x.norm()); }
};

void Gmres::solve(const Product& product, const MatrixXd& b, double tolerance, MatrixXd& x,
                  const ErrorBound* errorBound) {
    const double rounding = 1e-13;
    const int rows = b.rows();
    numIterations = numOfSlowest = 0;
    vector<Column> columns;
    for (int c = 0; c < b.cols(); c++) {
        columns.emplace_back(c, rows, min(mostVectors, rows));
        columns.back().begin(b.col(c));
        columns.back().isDone = columns.back().residual == 0;
    }
    while (true) {
        vector<Column*> active;
        for (Column& column : columns)
            if (!column.isDone) active.push_back(&column);
        if (active.empty()) break;
        directions.resize(rows, active.size());
        for (size_t k = 0; k < active.size(); k++)
            directions.col(k) = active[k]->vectors.col(active[k]->size);
        product(directions, products);
        for (size_t k = 0; k < active.size(); k++) {
            Column& column = *active[k];
            const bool grows = column.add(products.col(k));
            const bool converged =
                !grows ||
                (column.residual <= tolerance * column.normOfSolution() &&
                 (!errorBound || column.keeps(*errorBound, rounding * (b.col(column.index).norm() +
                                                                       column.normOfSolution()))));
            if (!isfinite(column.residual) || (!converged && column.iterations >= mostIterations)) {
                const bool isBound = column.residual <= tolerance * column.normOfSolution();
                throw OpenMM::OpenMMException(
                    "MobilityForce: the iterations for lubrication or stresslets did not converge: "
                    "after " +
                    to_string(column.iterations) + " of them the " +
                    (isBound
                         ? "bound of the error is " + text(column.bound, 3)
                         : "residual is " + text(column.residual / b.col(column.index).norm(), 3)) +
                    ", not below the tolerance " +
                    text(isBound ? errorBound->tolerance : tolerance, 3) +
                    "; increase setSolverTolerance(), or use setSolver(Dense)");
            }
            if (converged) {
                column.addSolution();
                column.isDone = true;
            } else if (column.size == (int)column.cosines.size()) {
                if (errorBound) column.updateSmallest();
                column.addSolution();
                directions = column.x;
                MatrixXd reached;
                product(directions, reached);
                column.begin(b.col(column.index) - reached);
            }
        }
    }
    x.resize(rows, b.cols());
    for (const Column& column : columns) {
        x.col(column.index) = column.x;
        numIterations += column.iterations;
        numOfSlowest = max(numOfSlowest, column.iterations);
    }
}

}  // namespace RigidHIPlugin
