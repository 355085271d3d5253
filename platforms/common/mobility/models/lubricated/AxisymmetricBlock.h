#ifndef RIGIDHI_AXISYMMETRIC_BLOCK_H_
#define RIGIDHI_AXISYMMETRIC_BLOCK_H_

#include <Eigen/Geometry>

#include "linearalgebra/Decompositions.h"

namespace RigidHIPlugin {

/**
 * A symmetric matrix that gives forces and torques from velocities and angular velocities of one or
 * two spheres, and that is invariant under rotations about an axis d and reflections in planes
 * through this axis. It splits into three parts: `along` the axis (velocities), `about` it (angular
 * velocities), and `across` it. The last part acts on U, the velocity across the axis, together
 * with V = d x Omega, and gives F across the axis and G = d x T; both directions across the axis
 * have the same matrix. Rows of `across` are U of all spheres, then V of all spheres.
 *
 * The same form serves mobilities. Functions of the matrix are functions of its parts.
 */
template <int n>
struct AxisymmetricBlock {
    using Part = Eigen::Matrix<double, n, n>;
    using Across = Eigen::Matrix<double, 2 * n, 2 * n>;
    using Whole = Eigen::Matrix<double, 6 * n, 6 * n>;

    Part along = Part::Zero(), about = Part::Zero();
    Across across = Across::Zero();

    AxisymmetricBlock& operator+=(const AxisymmetricBlock& other) {
        along += other.along;
        about += other.about;
        across += other.across;
        return *this;
    }
    AxisymmetricBlock& operator*=(double factor) {
        along *= factor;
        about *= factor;
        across *= factor;
        return *this;
    }
    AxisymmetricBlock operator-(const AxisymmetricBlock& other) const {
        AxisymmetricBlock difference = other;
        difference *= -1;
        return difference += *this;
    }
    AxisymmetricBlock inverse() const {
        AxisymmetricBlock result;
        result.along = along.inverse();
        result.about = about.inverse();
        result.across = across.inverse();
        return result;
    }
    /**
     * The symmetric square root of the nearest matrix without negative eigenvalues, and this
     * matrix. Lengths in units of `length` make forces and torques comparable.
     */
    void factorise(double length, AxisymmetricBlock& root, AxisymmetricBlock& positive) const {
        factorise(along, root.along, positive.along);
        factorise(about, root.about, positive.about);
        Across scaled = across;
        scaled.template rightCols<n>() /= length;
        scaled.template bottomRows<n>() /= length;
        factorise(scaled, root.across, positive.across);
        root.across.template bottomRows<n>() *= length;
        positive.across.template rightCols<n>() *= length;
        positive.across.template bottomRows<n>() *= length;
    }
    /** y += matrix x, where x and y have six rows for each sphere, from these rows on. */
    template <class X, class Y>
    void addProduct(const Eigen::Vector3d& d, const int (&rows)[n], const X& x, Y&& y) const {
        add(d, rows, x, y);
    }
    /** Add the matrix to a matrix of all spheres. */
    void addTo(const Eigen::Vector3d& d, const int (&rows)[n], Eigen::MatrixXd& matrix) const {
        addWhole(whole(d), rows, matrix);
    }
    static void addWhole(const Whole& whole, const int (&rows)[n], Eigen::MatrixXd& matrix) {
        for (int p = 0; p < n; p++)
            for (int q = 0; q < n; q++)
                matrix.block<6, 6>(rows[p], rows[q]) += whole.template block<6, 6>(6 * p, 6 * q);
    }
    Whole whole(const Eigen::Vector3d& d) const {
        int rows[n];
        for (int p = 0; p < n; p++) rows[p] = 6 * p;
        Whole result = Whole::Zero();
        addProduct(d, rows, Whole::Identity().eval(), result);
        return result;
    }

private:
    template <class Matrix>
    static void factorise(const Matrix& matrix, Matrix& root, Matrix& positive) {
        const Eigen::SelfAdjointEigenSolver<Matrix> solver(matrix);
        const auto& vectors = solver.eigenvectors();
        const auto values = solver.eigenvalues().cwiseMax(0).eval();
        positive = vectors * values.asDiagonal() * vectors.transpose();
        root = vectors * values.cwiseSqrt().asDiagonal() * vectors.transpose();
    }
    template <class X, class Y>
    void add(const Eigen::Vector3d& d, const int (&rows)[n], const X& x, Y& y) const {
        using Eigen::Vector3d;
        for (int c = 0; c < x.cols(); c++) {
            double U_along[n], W_along[n];
            Vector3d U[n], V[n];
            for (int q = 0; q < n; q++) {
                const Vector3d u = x.col(c).template segment<3>(rows[q]),
                               w = x.col(c).template segment<3>(rows[q] + 3);
                U_along[q] = d.dot(u);
                W_along[q] = d.dot(w);
                U[q] = u - U_along[q] * d;
                V[q] = d.cross(w);
            }
            for (int p = 0; p < n; p++) {
                Vector3d F = Vector3d::Zero(), G = Vector3d::Zero(), T;
                double T_along = 0;
                for (int q = 0; q < n; q++) {
                    F += along(p, q) * U_along[q] * d + across(p, q) * U[q] +
                         across(p, n + q) * V[q];
                    G += across(n + p, q) * U[q] + across(n + p, n + q) * V[q];
                    T_along += about(p, q) * W_along[q];
                }
                T = T_along * d + G.cross(d);
                y.col(c).template segment<3>(rows[p]) += F;
                y.col(c).template segment<3>(rows[p] + 3) += T;
            }
        }
    }
};

}  // namespace RigidHIPlugin

#endif
