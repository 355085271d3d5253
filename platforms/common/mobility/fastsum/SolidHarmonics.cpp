#include "mobility/fastsum/SolidHarmonics.h"

#include <complex>

using namespace std;
using Eigen::MatrixXd;
using Eigen::Vector3d;

namespace RigidHIPlugin {

namespace {

using Complex = complex<double>;

/**
 * The index of the real part of R_n^m, m >= 0, among the elements. The imaginary part comes next.
 */
int realPart(int n, int m) { return m == 0 ? n * n : n * n + 2 * m - 1; }
/** The index of a complex harmonic with m >= 0. */
int place(int n, int m) { return n * (n + 1) / 2 + m; }

vector<Complex> regular(int order, const Vector3d& r) {
    vector<Complex> R((order + 1) * (order + 2) / 2);
    const double square = r.squaredNorm();
    for (int m = 0; m <= order; m++) {
        R[place(m, m)] =
            m == 0 ? Complex(1) : R[place(m - 1, m - 1)] * Complex(r[0], r[1]) / (2.0 * m);
        if (m < order) R[place(m + 1, m)] = r[2] * R[place(m, m)];
        for (int n = m + 2; n <= order; n++)
            R[place(n, m)] =
                ((2 * n - 1) * r[2] * R[place(n - 1, m)] - square * R[place(n - 2, m)]) /
                static_cast<double>((n + m) * (n - m));
    }
    return R;
}

vector<Complex> irregular(int order, const Vector3d& r) {
    vector<Complex> I((order + 1) * (order + 2) / 2);
    const double over = 1 / r.squaredNorm();
    for (int m = 0; m <= order; m++) {
        I[place(m, m)] = m == 0
                             ? Complex(sqrt(over))
                             : I[place(m - 1, m - 1)] * Complex(r[0], r[1]) * ((2 * m - 1) * over);
        if (m < order) I[place(m + 1, m)] = (2 * m + 1) * r[2] * over * I[place(m, m)];
        for (int n = m + 2; n <= order; n++)
            I[place(n, m)] = ((2 * n - 1) * r[2] * I[place(n - 1, m)] -
                              static_cast<double>((n - 1) * (n - 1) - m * m) * I[place(n - 2, m)]) *
                             over;
    }
    return I;
}

/** The harmonic for any m; a negative m uses the harmonic for -m. */
Complex ofAny(const vector<Complex>& of, int n, int m) {
    if (abs(m) > n) return 0;
    if (m >= 0) return of[place(n, m)];
    return (m % 2 ? -1.0 : 1.0) * conj(of[place(n, -m)]);
}

}  // namespace

SolidHarmonics::SolidHarmonics(int order) : order(order) {
    const int count = size();
    degrees.resize(count);
    diagonal.resize(order + 1);
    inverse.resize((order + 1) * (order + 2) / 2);
    for (auto& axis : derivatives) axis.resize(count);
    for (auto& signs : reflections) signs.resize(count);
    for (int n = 0; n <= order; n++)
        for (int m = 0; m <= n; m++) {
            if (m > 0) diagonal[m] = 1 / (2.0 * m);
            if (n > m) inverse[place(n, m)] = 1 / static_cast<double>((n + m) * (n - m));
            for (int part = 0; part < (m == 0 ? 1 : 2); part++) {
                const int element = realPart(n, m) + part;
                degrees[element] = n;
                for (int mirrored = 0; mirrored < 8; mirrored++) {
                    // Mirrored in x, exp(i m phi) becomes (-1)^m exp(-i m phi).
                    int negative = 0;
                    if (mirrored & 1) negative += m + part;
                    if (mirrored & 2) negative += part;
                    if (mirrored & 4) negative += n + m;
                    reflections[mirrored][element] = negative % 2 ? -1 : 1;
                }
                // d_z R_n^m = R_(n-1)^m; d_x R_n^m = (R_(n-1)^(m-1) - R_(n-1)^(m+1))/2; d_y R_n^m =
                // i (their sum)/2.
                const auto add = [&](int axis, int m2, int part2, double factor) {
                    if (m2 < 0) {  // R_n^-1 = -conj R_n^1
                        m2 = -m2;
                        factor *= part2 == 0 ? -1 : 1;
                    }
                    if (m2 > n - 1 || (m2 == 0 && part2 == 1) || factor == 0) return;
                    auto& terms = derivatives[axis][element];
                    const int to = realPart(n - 1, m2) + part2;
                    if (!terms.empty() && terms[0].to == to)
                        terms[0].factor += factor;
                    else
                        terms.push_back({to, factor});
                };
                add(2, m, part, 1);
                add(0, m - 1, part, 0.5);
                add(0, m + 1, part, -0.5);
                const double turned = part == 0 ? -0.5 : 0.5;
                add(1, m - 1, 1 - part, turned);
                add(1, m + 1, 1 - part, turned);
            }
        }
}

void SolidHarmonics::basis(double x, double y, double z, double* R) const {
    const double square = x * x + y * y + z * z;
    double real = 1, imaginary = 0;
    for (int m = 0; m <= order; m++) {
        if (m > 0) {
            const double next = (real * x - imaginary * y) * diagonal[m];
            imaginary = (real * y + imaginary * x) * diagonal[m];
            real = next;
        }
        double re2 = real, im2 = imaginary, re1 = z * real, im1 = z * imaginary;
        R[realPart(m, m)] = re2;
        if (m > 0) R[realPart(m, m) + 1] = im2;
        if (m == order) break;
        R[realPart(m + 1, m)] = re1;
        if (m > 0) R[realPart(m + 1, m) + 1] = im1;
        for (int n = m + 2; n <= order; n++) {
            const double over = inverse[place(n, m)], a = (2 * n - 1) * z * over, b = square * over;
            const double re = a * re1 - b * re2, im = a * im1 - b * im2;
            R[realPart(n, m)] = re;
            if (m > 0) R[realPart(n, m) + 1] = im;
            re2 = re1;
            im2 = im1;
            re1 = re;
            im1 = im;
        }
    }
}

MatrixXd SolidHarmonics::shift(const Vector3d& d) const {
    MatrixXd C = MatrixXd::Zero(size(), size());
    const auto R = regular(order, d);
    for (int n = 0; n <= order; n++)
        for (int m = 0; m <= n; m++)
            for (int k = 0; k <= n; k++)
                for (int l = -k; l <= k; l++) {
                    const Complex c = ofAny(R, n - k, m - l);
                    // c R_k^l with R_k^l = a + ib; for negative l it is c (-1)^l (a - ib).
                    const int a = realPart(k, abs(l)), b = a + 1, row = realPart(n, m);
                    const double sign = l < 0 && l % 2 ? -1 : 1, conjugate = l < 0 ? -1 : 1;
                    C(row, a) += sign * c.real();
                    if (l != 0) C(row, b) -= sign * conjugate * c.imag();
                    if (m == 0) continue;
                    C(row + 1, a) += sign * c.imag();
                    if (l != 0) C(row + 1, b) += sign * conjugate * c.real();
                }
    return C;
}

MatrixXd SolidHarmonics::fromFar(const Vector3d& D) const {
    MatrixXd T = MatrixXd::Zero(size(), size());
    const auto I = irregular(2 * order, D);
    for (int n = 0; n <= order; n++)  // of the target
        for (int m = 0; m <= n; m++)
            for (int k = 0; k <= order; k++)  // of the source
                for (int l = 0; l <= k; l++) {
                    // The terms of +-m, +-l together: 2 Re(conj R_k^l conj R_n^m I^(l+m)) + 2
                    // (-1)^m Re(conj R_k^l R_n^m I^(l-m)).
                    const Complex sum = ofAny(I, n + k, l + m),
                                  difference = (m % 2 ? -1.0 : 1.0) * ofAny(I, n + k, l - m);
                    const double factor =
                        2.0 * (n % 2 ? -1 : 1) * (l == 0 ? 0.5 : 1) * (m == 0 ? 0.5 : 1);
                    const int row = realPart(n, m), column = realPart(k, l);
                    T(row, column) = factor * (sum.real() + difference.real());
                    if (m > 0) T(row + 1, column) = factor * (sum.imag() - difference.imag());
                    if (l > 0) T(row, column + 1) = factor * (sum.imag() + difference.imag());
                    if (m > 0 && l > 0)
                        T(row + 1, column + 1) = factor * (difference.real() - sum.real());
                }
    return T;
}

void SolidHarmonics::addDerivativeOfMoments(int axis, double factor, const double* from, double* to,
                                            int stride) const {
    for (int a = 0; a < size(); a++)
        for (const Term& term : derivatives[axis][a])
            to[a * stride] += factor * term.factor * from[term.to];
}

void SolidHarmonics::derivativeOfLocal(int axis, const double* from, double* to) const {
    for (int c = 0; c < size(); c++) to[c] = 0;
    for (int a = 0; a < size(); a++)
        for (const Term& term : derivatives[axis][a]) to[term.to] += term.factor * from[a];
}

}  // namespace RigidHIPlugin
