#include "mobility/models/confined/PlaneConditions.h"

#include <cmath>

#include "mobility/models/confined/PlaneModes.h"

namespace RigidHIPlugin {

namespace {

using Real = PlaneConditions::Real;

/**
 * The flow of forces on a plane (PeriodicPlane) on this plane, minus the same flow at the distance
 * z, without loss of digits.
 */
struct LessThanOwn {
    Real ll, zz, tt;

    LessThanOwn(Real k, Real z, Real period) {
        const PeriodicPlane<Real> at(k, period, z);
        const Real c = period / 2, coth = (2 - at.rest) / at.rest,
                   oneLessSh = (-std::expm1(-k * z) - std::exp(-k * period) + at.down) / at.rest,
                   E = std::expm1(-k * z) * std::expm1(-k * (period - z)) / at.rest,
                   F = c * coth * E - c * oneLessSh - z * at.sh;
        ll = (E - k * F) / (4 * k);
        zz = (E + k * F) / (4 * k);
        tt = E / (2 * k);
    }
};

/** The flow of uniform forces along an axis on a plane, without the uniform velocity. */
Real meanKernel(Real z, Real period) { return period / 12 - z / 2 + z * z / (2 * period); }

}  // namespace

PlaneConditions::PlaneConditions(Kind kind, double height, double period, bool zeroFlux)
    : kind(kind), height(height), period(period), zeroFlux(zeroFlux) {}

PlaneConditions PlaneConditions::channel(double height, double gap, bool zeroFlux) {
    PlaneConditions made(Channel, height, height + gap, zeroFlux);
    made.origin = height / 2;
    made.planes = {-made.height / 2, made.height / 2};
    made.combined.resize(2, 2);
    made.combined << 0.5, 0.5, -0.5, 0.5;
    return made;
}

PlaneConditions PlaneConditions::film(double height, double gap) {
    PlaneConditions made(Film, height, height + gap, false);
    made.origin = height / 2;
    made.planes = {-made.height / 2, made.height / 2};
    made.combined.resize(2, 2);
    made.combined << 0.5, 0.5, -0.5, 0.5;
    return made;
}

PlaneConditions PlaneConditions::wall(double height, double gap, double below) {
    PlaneConditions made(Wall, height, height + gap + below, false);
    made.origin = -below / 2;
    made.planes = {-static_cast<Real>(below) / 2, static_cast<Real>(below) / 2,
                   made.height + static_cast<Real>(below) / 2};
    made.combined.resize(3, 3);
    made.combined << 0.5, 0.5, 0, -0.5, 0.5, 0, -0.5, -0.5, 1;
    return made;
}

PlaneConditions PlaneConditions::layer(double height, double gap) {
    PlaneConditions made(Wall, height, height + gap, false);
    made.origin = height / 2;
    made.planes = {-made.height / 2, made.height / 2};
    made.combined.resize(2, 2);
    made.combined << 0.5, 0.5, -0.5, 0.5;
    return made;
}

/** Combine rows and columns of planes. They consist of `kinds` blocks, each with all planes. */
PlaneConditions::Matrix PlaneConditions::combine(const Matrix& ofPlanes, int kinds) const {
    const int p = numPlanes();
    Matrix result(kinds * p, kinds * p);
    for (int a = 0; a < kinds; a++)
        for (int b = 0; b < kinds; b++)
            result.block(a * p, b * p, p, p) =
                combined * ofPlanes.block(a * p, b * p, p, p) * combined.transpose();
    return result;
}

PlaneConditions::Matrices PlaneConditions::periodic(Real k) const {
    const int p = numPlanes();
    // For long waves all planes have nearly the same response. So compute differences of planes
    // from differences to the response of a plane to itself.
    Matrix t(p, p), lz(2 * p, 2 * p);
    for (int i = 0; i < p; i++)
        for (int j = 0; j < p; j++) {
            const Real away = planes[i] - planes[j];
            const LessThanOwn lacking(k, std::abs(away), period);
            const Real below = -PeriodicPlane<Real>(k, period, std::abs(away)).slope / k,
                       coupling = away < 0   ? -below
                                  : away > 0 ? below
                                             : 0;
            t(i, j) = -lacking.tt;
            lz(i, j) = -lacking.ll;
            lz(p + i, p + j) = -lacking.zz;
            lz(i, p + j) = coupling;
            lz(p + j, i) = coupling;
        }
    Matrices S = {combine(t, 1), combine(lz, 2)};
    const PeriodicPlane<Real> own(k, period, 0);
    const auto ofUniform = combined.rowwise().sum().eval();
    const Matrix uniform = ofUniform * ofUniform.transpose();
    S.t += own.tt * uniform;
    S.lz.topLeftCorner(p, p) += own.ll * uniform;
    S.lz.bottomRightCorner(p, p) += own.zz * uniform;
    return S;
}

PlaneConditions::Response::Response(double k, double z, double period) {
    const PeriodicPlane<double> kernel(k, period, z);
    ll = kernel.ll;
    zz = kernel.zz;
    tt = kernel.tt;
    lz = -kernel.slope / k;
}

double PlaneConditions::meanResponse(double z) const {
    return static_cast<double>(meanKernel(z, period));
}

double PlaneConditions::meanResponseToGradient(double z) const {
    const Real H = height, P = period, below = H / 2 + z, above = H / 2 - z;
    return static_cast<double>(P * H / 12 - (below * below + above * above) / 4 +
                               (below * below * below + above * above * above) / (6 * P));
}

PlaneConditions::Matrices PlaneConditions::law(Real k) const {
    const int p = numPlanes(), last = p - 1;
    Matrix t = Matrix::Zero(p, p), lz = Matrix::Zero(2 * p, 2 * p);
    if (kind == Film) {
        // The film and its reflection form a channel with one plane at rest and a period of twice
        // the height. A force on the surface is its own reflection, so it acts twice.
        const PeriodicPlane<Real> own(k, 2 * height, 0), far(k, 2 * height, height);
        t(last, last) = 2 * (own.tt - far.tt * far.tt / own.tt);
        lz(last, last) = 2 * (own.ll - far.ll * far.ll / own.ll);
    } else if (kind == Wall) {
        // Blake's fluid above a wall, at one height.
        const Real x = 2 * k * height, e = std::exp(-x);
        t(last, last) = -std::expm1(-x) / (2 * k);
        lz(last, last) = (1 - (1 + (1 - x) * (1 - x)) / 2 * e) / (4 * k);
        lz(p + last, p + last) = (1 - (1 + (1 + x) * (1 + x)) / 2 * e) / (4 * k);
        lz(last, p + last) = lz(p + last, last) = -k * height * height / 2 * e;
    }
    return {combine(t, 1), combine(lz, 2)};
}

PlaneConditions::Matrix PlaneConditions::meanPeriodic() const {
    const int p = numPlanes();
    Matrix ofPlanes(p, p), S(numOfMean(), numOfMean());
    for (int i = 0; i < p; i++)
        for (int j = 0; j < p; j++)
            ofPlanes(i, j) = meanKernel(std::abs(planes[i] - planes[j]), period);
    S.topLeftCorner(p, p) = combine(ofPlanes, 1);
    if (zeroFlux) {
        // The flux is the integral of the velocity over the height. A pressure gradient is a
        // uniform force over the height.
        const Real H = height, P = period, ofPlane = P * H / 12 - H * H / 4 + H * H * H / (6 * P);
        for (int i = 0; i < p; i++) S(i, p) = S(p, i) = ofPlane * combined.row(i).sum();
        S(p, p) = 2 * H * H * (P / 24 - H / 12 + H * H / (24 * P));
    }
    return S;
}

PlaneConditions::Matrix PlaneConditions::meanLaw() const {
    const int p = numPlanes();
    Matrix ofPlanes = Matrix::Zero(p, p), T = Matrix::Zero(numOfMean(), numOfMean());
    // A uniform force on the upper plane shears the fluid below.
    if (kind != Channel) ofPlanes(p - 1, p - 1) = height;
    T.topLeftCorner(p, p) = combine(ofPlanes, 1);
    return T;
}

Eigen::Matrix<PlaneConditions::Real, Eigen::Dynamic, 1, 0, 6, 1> PlaneConditions::meanOfUniform()
    const {
    Eigen::Matrix<Real, Eigen::Dynamic, 1, 0, 6, 1> result(numOfMean());
    for (int i = 0; i < numPlanes(); i++) result[i] = combined.row(i).sum();
    if (zeroFlux) result[numPlanes()] = height;
    return result;
}

}  // namespace RigidHIPlugin
