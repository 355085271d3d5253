#include "mobility/models/forcecoupling/GridPlanes.h"

#include <algorithm>
#include <cmath>

#include "mobility/models/confined/PlaneMatrices.h"

namespace RigidHIPlugin {

namespace {

using Real = PlaneConditions::Real;
using Matrix = PlaneConditions::Matrix;
using std::complex;

Matrix symmetric(const Matrix& m) { return (m + m.transpose()) / 2; }
Matrix symmetricInverse(const Matrix& m) { return symmetric(inverseOf(m)); }
/** 1/S - 1/S T 1/S */
Matrix responseOf(const Matrix& S, const Matrix& T) {
    const Matrix inverse = symmetricInverse(S);
    return symmetric(inverse - inverse * T * inverse);
}

/** S of the mean flow, with the uniform velocity as the last unknown. */
Matrix withUniform(const PlaneConditions& conditions) {
    const int n = conditions.numOfMean();
    Matrix K = Matrix::Zero(n + 1, n + 1);
    K.topLeftCorner(n, n) = conditions.meanPeriodic();
    K.col(n).head(n) = conditions.meanOfUniform();
    K.row(n) = K.col(n).transpose().eval();
    return K;
}

}  // namespace

std::vector<GridPlanes::Profile> GridPlanes::profilesOf(const PlaneConditions& conditions,
                                                        const GridShape& shape) {
    const int p = conditions.numPlanes(), numModes = (shape.size[2] + 1) / 2;
    std::vector<Profile> profiles;
    for (int j = 0; j < p; j++)
        for (bool isImaginary : {false, true}) {
            Profile profile = {j, isImaginary, std::vector<double>(numModes)};
            bool isZero = true;
            for (int z = 0; z < numModes; z++) {
                // Combinations of planes at equal distances from z = 0 are cosines or sines.
                Real sum = 0;
                for (int plane = 0; plane < p; plane++) {
                    const Real angle = static_cast<Real>(shape.waveNumber(2, z)) *
                                       static_cast<Real>(conditions.place(plane));
                    sum += conditions.combinations()(j, plane) *
                           (isImaginary ? std::sin(angle) : std::cos(angle));
                }
                profile.values[z] = static_cast<double>(sum);
                isZero = isZero && profile.values[z] == 0;
            }
            if (!isZero) profiles.push_back(profile);
        }
    return profiles;
}

std::vector<double> GridPlanes::profileOfFlux(const PlaneConditions& conditions,
                                              const GridShape& shape) {
    std::vector<double> profile;
    if (!conditions.hasZeroFlux()) return profile;
    profile.resize((shape.size[2] + 1) / 2, conditions.getHeight());
    for (size_t z = 1; z < profile.size(); z++) {
        const double k = shape.waveNumber(2, z);
        profile[z] = 2 / k * std::sin(k * conditions.getHeight() / 2);
    }
    return profile;
}

GridPlanes::GridPlanes(const PlaneConditions& conditions, const GridShape& gridShape)
    : conditions(conditions), shape(gridShape), numModes((shape.size[2] + 1) / 2),
      numX(shape.size[0] / 2 + 1), profiles(profilesOf(conditions, shape)),
      fluxProfile(profileOfFlux(conditions, shape)) {
    numbers = numbersOf(conditions.numPlanes());
    // Packs may read a little beyond the last number.
    const int beyond = 16;
    responses.assign(numbers * numX * (shape.size[1] / 2 + 1) + beyond, 0.0);
    for (int y = 0; 2 * y < shape.size[1]; y++)
        for (int x = y == 0 ? 1 : 0; 2 * x < shape.size[0]; x++) {
            const Real k = waveNumber(x, y);
            const Matrices S = conditions.periodic(k), T = conditions.law(k);
            store({responseOf(S.t, T.t), responseOf(S.lz, T.lz)}, x, y, responses);
        }
    const int n = conditions.numOfMean();
    Matrix T = Matrix::Zero(n + 1, n + 1);
    T.topLeftCorner(n, n) = conditions.meanLaw();
    meanResponse = responseOf(withUniform(conditions), T).cast<double>();
}

double GridPlanes::waveNumber(int x, int y) const {
    return std::hypot(shape.waveNumber(0, x), shape.waveNumber(1, y));
}

void GridPlanes::store(const Matrices& from, int x, int y, std::vector<double>& to) const {
    double* next = &to[placeOfRow(y) + x];
    for (const Matrix* m : {&from.t, &from.lz})
        for (int i = 0; i < m->size(); i++, next += numX) *next = static_cast<double>(m->data()[i]);
}

GridPlanes::Matrices GridPlanes::truncated(const PlaneConditions& conditions,
                                           const std::vector<Profile>& profiles,
                                           const GridShape& shape, Real k, const PartOfMode& part) {
    const int p = conditions.numPlanes(), numModes = (shape.size[2] + 1) / 2;
    Matrices S = {Matrix::Zero(p, p), Matrix::Zero(2 * p, 2 * p)};
    Eigen::Matrix<Real, Eigen::Dynamic, 1, 0, 3, 1> even(p), odd(p);
    for (int z = 0; z < numModes; z++) {
        even.setZero();
        odd.setZero();
        for (const Profile& profile : profiles)
            (profile.isImaginary ? odd : even)[profile.unknown] = profile.values[z];
        // Take the modes kz and -kz together; kz = 0 is its own opposite. Their products of factors
        // have opposite imaginary parts.
        const Real kz = shape.waveNumber(2, z), k2 = k * k + kz * kz,
                   weight = part(k2) * (z == 0 ? 1 : 2) / (k2 * static_cast<Real>(shape.edge[2]));
        const Matrix same = weight * (even * even.transpose() + odd * odd.transpose()),
                     turned = weight * (odd * even.transpose() - even * odd.transpose());
        S.t += same;
        S.lz.topLeftCorner(p, p) += kz * kz / k2 * same;
        S.lz.bottomRightCorner(p, p) += k * k / k2 * same;
        S.lz.topRightCorner(p, p) += k * kz / k2 * turned;
        S.lz.bottomLeftCorner(p, p) -= k * kz / k2 * turned;
    }
    return S;
}

Matrix GridPlanes::truncatedMean(const PlaneConditions& conditions,
                                 const std::vector<Profile>& profiles,
                                 const std::vector<double>& fluxProfile, const GridShape& shape,
                                 const PartOfMode& part) {
    const int n = conditions.numOfMean(), p = conditions.numPlanes(),
              numModes = (shape.size[2] + 1) / 2;
    Matrix S = Matrix::Zero(n, n);
    Eigen::Matrix<Real, Eigen::Dynamic, 1, 0, 6, 1> even(n), odd(n);
    for (int z = 1; z < numModes; z++) {
        even.setZero();
        odd.setZero();
        for (const Profile& profile : profiles)
            (profile.isImaginary ? odd : even)[profile.unknown] = profile.values[z];
        if (!fluxProfile.empty()) even[p] = fluxProfile[z];
        const Real kz = shape.waveNumber(2, z);
        S += 2 * part(kz * kz) / (kz * kz * static_cast<Real>(shape.edge[2])) *
             (even * even.transpose() + odd * odd.transpose());
    }
    return S;
}

void GridPlanes::prepareFields() const {
    std::call_once(fieldsAreMade, [this] { makeFields(); });
}

void GridPlanes::makeFields() const {
    const auto whole = [](Real) { return Real(1); };
    inverses.assign(responses.size(), 0.0);
    roots.assign(responses.size(), 0.0);
    for (int y = 0; 2 * y < shape.size[1]; y++)
        for (int x = y == 0 ? 1 : 0; 2 * x < shape.size[0]; x++) {
            const Real k = waveNumber(x, y);
            const Matrices S = conditions.periodic(k), T = conditions.law(k),
                           own = truncated(conditions, profiles, shape, k, whole);
            store({symmetricInverse(S.t), symmetricInverse(S.lz)}, x, y, inverses);
            // The roots for the velocities that planes should have and that the modes of the grid
            // do not provide.
            store({principalRoot(T.t + S.t - own.t), principalRoot(T.lz + S.lz - own.lz)}, x, y,
                  roots);
        }
    meanInverse = symmetricInverse(withUniform(conditions)).cast<double>();
    meanRoot = principalRoot(conditions.meanLaw() + conditions.meanPeriodic() -
                             truncatedMean(conditions, profiles, fluxProfile, shape, whole))
                   .cast<double>();
}

void GridPlanes::multiply(int x, int y, const std::vector<double>& matrices,
                          const complex<double>* from, complex<double>* to) const {
    const int p = conditions.numPlanes();
    const double *const t = &matrices[placeOfRow(y) + std::min(x, shape.size[0] - x)], *const lz =
                                                                                           t +
                                                                                           p * p *
                                                                                               numX;
    const double kx = shape.waveNumber(0, x), ky = shape.waveNumber(1, y),
                 inverse = 1 / std::sqrt(kx * kx + ky * ky), nx = kx * inverse, ny = ky * inverse;
    // l is along k, t along z x k, and u_z is i times the number of z.
    complex<double> along[6], across[3], resultLz[6] = {}, resultT[3] = {};
    for (int j = 0; j < p; j++) {
        const complex<double>* u = from + 3 * j;
        along[j] = nx * u[0] + ny * u[1];
        across[j] = nx * u[1] - ny * u[0];
        along[p + j] = {u[2].imag(), -u[2].real()};
    }
    for (int j = 0; j < p; j++)
        for (int i = 0; i < p; i++) resultT[i] += t[(j * p + i) * numX] * across[j];
    for (int j = 0; j < 2 * p; j++)
        for (int i = 0; i < 2 * p; i++) resultLz[i] += lz[(j * 2 * p + i) * numX] * along[j];
    for (int j = 0; j < p; j++) {
        to[3 * j] = ny * resultT[j] - nx * resultLz[j];
        to[3 * j + 1] = -nx * resultT[j] - ny * resultLz[j];
        to[3 * j + 2] = {resultLz[p + j].imag(), -resultLz[p + j].real()};
    }
}

void GridPlanes::addFlow(int x, int y, double z, const complex<double>* forces,
                         complex<double>* velocities) const {
    const double k = waveNumber(x, y), nx = shape.waveNumber(0, x) / k,
                 ny = shape.waveNumber(1, y) / k;
    for (int plane = 0; plane < conditions.numPlanes(); plane++) {
        complex<double> f[3] = {};
        for (int j = 0; j < conditions.numPlanes(); j++)
            for (int c = 0; c < 3; c++)
                f[c] +=
                    static_cast<double>(conditions.combinations()(j, plane)) * forces[3 * j + c];
        const double away = z - conditions.place(plane);
        const PlaneConditions::Response response(k, std::abs(away), shape.edge[2]);
        // u_z is i times the number of z (PlaneConditions).
        const double lz = away < 0 ? -response.lz : response.lz;
        const complex<double> i(0, 1),
            along = nx * f[0] + ny * f[1], across = nx * f[1] - ny * f[0],
            l = response.ll * along - i * lz * f[2], t = response.tt * across;
        velocities[0] += nx * l - ny * t;
        velocities[1] += ny * l + nx * t;
        velocities[2] += response.zz * f[2] - i * lz * along;
    }
}

double GridPlanes::meanFlow(double z, const Eigen::VectorXd& forces) const {
    double u = forces[conditions.numOfMean()];
    for (int plane = 0; plane < conditions.numPlanes(); plane++)
        for (int j = 0; j < conditions.numPlanes(); j++)
            u += static_cast<double>(conditions.combinations()(j, plane)) * forces[j] *
                 conditions.meanResponse(std::abs(z - conditions.place(plane)));
    if (conditions.hasZeroFlux())
        u += forces[conditions.numPlanes()] * conditions.meanResponseToGradient(z);
    return u;
}

void GridPlanes::respondRandomly(int x, int y, const complex<double>* velocities,
                                 const complex<double>* randoms, double scale,
                                 complex<double>* forces) const {
    complex<double> wanted[9];
    multiply(x, y, roots, randoms, wanted);
    for (int i = 0; i < numUnknowns(); i++) wanted[i] = velocities[i] + scale * wanted[i];
    multiply(x, y, inverses, wanted, forces);
}

GridPlanes::MeanNumbers::MeanNumbers(const GridPlanes& planes, const ModeNoise& noise) {
    const int none = 0;
    for (int j = 0; j < planes.conditions.numOfMean(); j++) {
        complex<double> drawn[3];
        noise.fillPlane(&none, 1, 0, j, drawn);
        for (int axis = 0; axis < 2; axis++) numbers[axis][j] = std::sqrt(2.0) * drawn[axis].real();
    }
}

Eigen::VectorXd GridPlanes::meanOf(const complex<double>* modes) const {
    Eigen::VectorXd sums = Eigen::VectorXd::Zero(conditions.numOfMean() + 1);
    for (int z = 1; z < numModes; z++) {
        for (const Profile& profile : profiles)
            sums[profile.unknown] +=
                2 * (profile.isImaginary ? -profile.values[z] * modes[z].imag()
                                         : profile.values[z] * modes[z].real());
        if (!fluxProfile.empty())
            sums[conditions.numPlanes()] += 2 * fluxProfile[z] * modes[z].real();
    }
    return sums;
}

void GridPlanes::addMean(const Eigen::VectorXd& forces, complex<double>* modes) const {
    modes[0] += forces[conditions.numOfMean()];
    for (int z = 1; z < numModes; z++) {
        complex<double> sum = 0;
        for (const Profile& profile : profiles)
            sum += profile.values[z] * forces[profile.unknown] *
                   (profile.isImaginary ? complex<double>(0, -1) : complex<double>(1, 0));
        if (!fluxProfile.empty()) sum += fluxProfile[z] * forces[conditions.numPlanes()];
        const double kz = shape.waveNumber(2, z);
        modes[z] += sum / (kz * kz * shape.edge[2]);
    }
}

Eigen::VectorXd GridPlanes::meanForces(const complex<double>* modes, double netForce) const {
    Eigen::VectorXd sums = meanOf(modes);
    sums[conditions.numOfMean()] = netForce * shape.edge[2];
    return -meanResponse * sums;
}

void GridPlanes::respondToMean(complex<double>* modes, double netForce) const {
    addMean(meanForces(modes, netForce), modes);
}

void GridPlanes::respondToMeanRandomly(complex<double>* modes, const double* randoms,
                                       double scale) const {
    const int n = conditions.numOfMean();
    Eigen::VectorXd sums = meanOf(modes);
    sums.head(n) -= scale * meanRoot * Eigen::Map<const Eigen::VectorXd>(randoms, n);
    addMean(-meanInverse * sums, modes);
}

}  // namespace RigidHIPlugin
