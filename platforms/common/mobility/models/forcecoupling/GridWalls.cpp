#include "mobility/models/forcecoupling/GridWalls.h"

#include <Eigen/LU>
#include <cmath>

#include "mobility/models/confined/PlaneModes.h"

namespace RigidHIPlugin {

using Eigen::Matrix2d;
using Eigen::Matrix4d;
using std::complex;

GridWalls::GridWalls(const ConfiningPlanes& planes, const GridShape& gridShape, double height,
                     double largestWave, const GridWallFields::PartOfMode& part)
    : shape(gridShape), height(height), largestWave(largestWave), period(shape.edge[2]),
      spacing(shape.spacing(2)),
      // Sums over modes are sums over nodes times the number of nodes along z.
      scale(period / (static_cast<double>(shape.numNodes()) * shape.size[2] * shape.size[2])),
      numX(shape.size[0] / 2 + 1),
      conditions(planes.isChannel()
                     ? PlaneConditions::channel(height, period - height, planes.hasZeroFlux())
                     : PlaneConditions::layer(height, period - height)),
      part(part) {
    for (int z = 0; 2 * z < shape.size[2]; z++) {
        const double y = M_PI * z / shape.size[2];
        ofModes.push_back({std::cos(y), std::sin(y), z % 2 == 0 ? 1.0 : -1.0});
    }
    responses.resize((size_t)numX * (shape.size[1] / 2 + 1));
    for (int y = 0; y <= shape.size[1] / 2; y++)
        for (int x = 0; x < numX; x++) {
            const double k = std::hypot(shape.waveNumber(0, x), shape.waveNumber(1, y));
            if (k == 0 || k > largestWave || shape.isNyquist(0, x) || shape.isNyquist(1, y))
                continue;
            responses[(size_t)y * numX + x] = responseOf(planes, k);
        }
}

GridWalls::Along GridWalls::along(double k) const {
    return {std::cosh(0.5 * k * spacing), std::sinh(0.5 * k * spacing)};
}

namespace {

/**
 * Q of a wave vector, for the functions exp(-kz), kz exp(-kz), and the same functions from the
 * other end.
 */
struct Coefficients {
    Matrix4d across = Matrix4d::Zero();
    Matrix2d alongT = Matrix2d::Zero();
};

/** The images of a wall, with the functions e and (1 + 2kz) e, and those of the period. */
Coefficients aboveWall(double k, double H, double P) {
    Coefficients Q;
    Q.across.topLeftCorner<2, 2>() << 2, 2, 2, 4;
    Q.across *= 1 / (8 * k);
    Q.alongT(0, 0) = 1 / (2 * k);
    // With e and d the exponentials from both ends, r = exp(-k(P - H)) and q = exp(-kP):
    //     2 q cosh(k zeta) = r (d e' + e d'),  and with kz e = s, k(H - z) d = t,
    //     2 q k zeta sinh(k zeta) = r (kH (d e' + e d') - t e' - e t' - s d' - d s').
    const double r = std::exp(-k * (P - H)), rest = -std::expm1(-k * P),
                 factor = r / (4 * k * rest);
    const double plain = factor * (1 + k * P / rest - k * H);
    Q.across(0, 2) += plain;
    Q.across(2, 0) += plain;
    for (const auto& [a, b] : {std::pair<int, int>(3, 0), {0, 3}, {1, 2}, {2, 1}})
        Q.across(a, b) += factor;
    Q.alongT(0, 1) = Q.alongT(1, 0) = 2 * factor;
    return Q;
}

/** The flows of forces on both planes. */
void flowsOf(double k, double H, double P, Matrix4d& C, Matrix2d& Ct) {
    const double r = std::exp(-k * (P - H)), rest = -std::expm1(-k * P), x = 0.5 * k * P;
    const double coth = PeriodicPlane<double>::xCothMinusOne(x);
    // Flows of a force along z, and of a force along l (times -i), on the lower plane. Flows of
    // forces on the upper plane are their reflections; those of l change sign.
    C.col(0) << 2 + coth - x, 1, r * (2 + coth + x - k * H), r;
    C.col(1) << x - 1 - coth, -1, r * (x - k * H + 1 + coth), r;
    C.col(2) << C(2, 0), C(3, 0), C(0, 0), C(1, 0);
    C.col(3) << -C(2, 1), -C(3, 1), -C(0, 1), -C(1, 1);
    C *= 1 / (4 * k * rest);
    Ct << 1, r, r, 1;
    Ct *= 1 / (2 * k * rest);
}

/** The response of forces on both planes: C S^-1 C^T, C the flows of forces on the planes. */
Coefficients betweenWalls(double k, double H, double P) {
    Matrix4d C;
    Matrix2d Ct, St;
    flowsOf(k, H, P, C, Ct);
    const PeriodicPlane<double> own(k, P, 0), other(k, P, H);
    Matrix4d S;
    const double g = own.zz, l = own.ll, gH = other.zz, lH = other.ll,
                 slope = other.slope / k;  // slope of zz at the other plane
    S << g, 0, gH, -slope, 0, l, slope, lH, gH, slope, g, 0, -slope, lH, 0, l;
    Coefficients Q;
    Q.across = C * S.inverse() * C.transpose();
    Q.across = (0.5 * (Q.across + Q.across.transpose())).eval();
    St << own.tt, other.tt, other.tt, own.tt;
    Q.alongT = Ct * St.inverse() * Ct;
    return Q;
}

}  // namespace

GridWalls::ToProfiles GridWalls::toProfiles(double k) const {
    // exp(-kz) = A e and kz exp(-kz) = D s + beta A e, in terms of functions e and s whose
    // transforms are those of the profiles.
    const double out = 0.5 * k * (period - height),
                 A = 0.5 * (std::exp(out) - std::exp(-0.5 * k * (period + height))),
                 coth = (1 + std::exp(-k * period)) / -std::expm1(-k * period),
                 beta = 0.5 * k * (height - period * coth), D = 0.5 * k * spacing * A;
    ToProfiles to = {A, Matrix4d::Zero()};
    to.across.topLeftCorner<2, 2>() << A, beta * A, 0, D;
    to.across.bottomRightCorner<2, 2>() = to.across.topLeftCorner<2, 2>();
    return to;
}

const GridWallFields& GridWalls::getFields() const {
    std::call_once(fieldsAreMade, [this] {
        fields = std::make_unique<GridWallFields>(conditions, shape, part, largestWave,
                                                  [this](double k) { return flowsOfPlanes(k); });
    });
    return *fields;
}

/** In terms of the functions of profiles, for forces in the order of PlaneConditions. */
GridWallFields::Flows GridWalls::flowsOfPlanes(double k) const {
    Matrix4d C, order = Matrix4d::Zero();
    Matrix2d Ct;
    flowsOf(k, height, period, C, Ct);
    const Matrix2d ofPlanes = conditions.combinations().transpose().cast<double>();
    // From l of both unknowns and z of both unknowns to z and l of the lower plane, and of the
    // upper one.
    for (int plane = 0; plane < 2; plane++)
        for (int j = 0; j < 2; j++) {
            order(2 * plane, 2 + j) = ofPlanes(plane, j);
            order(2 * plane + 1, j) = ofPlanes(plane, j);
        }
    const ToProfiles to = toProfiles(k);
    const double perNode = 1.0 / shape.size[2];
    return {perNode * to.across * C * order, perNode * to.A * Ct * ofPlanes};
}

GridWalls::Response GridWalls::responseOf(const ConfiningPlanes& planes, double k) const {
    const Coefficients Q =
        planes.isChannel() ? betweenWalls(k, height, period) : aboveWall(k, height, period);
    const ToProfiles to = toProfiles(k);
    const Matrix4d across = -scale * to.across * Q.across * to.across.transpose();
    const Matrix2d alongT = -scale * to.A * to.A * Q.alongT;
    Response response;
    response.isLeftOut = false;
    for (int a = 0; a < 4; a++)
        for (int b = 0; b < 4; b++) response.across[a][b] = across(a, b);
    for (int a = 0; a < 2; a++)
        for (int b = 0; b < 2; b++) response.alongT[a][b] = alongT(a, b);
    return response;
}

namespace {

const complex<double> I(0, 1);

/** A vector along l, t and z. */
struct Components {
    complex<double> l, t, z;
};
Components components(double lx, double ly, const complex<double>* v) {
    return {lx * v[0] + ly * v[1], lx * v[1] - ly * v[0], v[2]};
}

}  // namespace

// The transform of e is a - ib with the first two profiles, and that of s is g - ih with the
// others. From the upper end it is a + ib and g + ih. The slope of s is (2/dz) e - ks, and its
// Laplacian
// -(4k/dz) e; signs of slopes change with the end.
void GridWalls::addMoments(const Directions& at, double faxen, bool ofTorques, const Sums& sums,
                           complex<double> (&across)[4], complex<double> (&alongT)[2]) const {
    const double gamma = at.toPlain * faxen, delta = at.toSlope + gamma;
    for (int end = 0; end < 2; end++) {
        const complex<double> sign = end == 0 ? I : -I;
        complex<double> ofE[3], ofS[3];
        for (int c = 0; c < 3; c++) {
            ofE[c] = sums[0][c] + sign * sums[1][c];
            ofS[c] = sums[2][c] + sign * sums[3][c];
        }
        const Components e = components(at.lx, at.ly, ofE), s = components(at.lx, at.ly, ofS);
        if (ofTorques) {
            across[2 * end + 1] += I * (0.5 * at.toPlain / at.k) * e.t;
            alongT[end] += (end == 0 ? 0.5 : -0.5) * at.k * e.l - I * (0.5 * at.k) * e.z;
        } else {
            across[2 * end] += e.z + sign * e.l;
            across[2 * end + 1] += s.z - gamma * e.z - sign * (delta * e.l - s.l);
            alongT[end] += e.t;
        }
    }
}

void GridWalls::setVelocities(const Directions& at, double faxen, bool ofTorques,
                              const complex<double> (&across)[4],
                              const complex<double> (&alongT)[2], Sums& sums) const {
    const double gamma = at.toPlain * faxen, delta = at.toSlope + gamma;
    Components e[2], s[2] = {};
    for (int end = 0; end < 2; end++) {
        const complex<double> sign = end == 0 ? I : -I, plain = across[2 * end],
                              rising = across[2 * end + 1];
        if (ofTorques) {
            e[end].t = -I * (0.5 * at.toPlain / at.k) * rising;
            e[end].l = (end == 0 ? 0.5 : -0.5) * at.k * alongT[end];
            e[end].z = I * (0.5 * at.k) * alongT[end];
        } else {
            e[end].z = plain - gamma * rising;
            e[end].l = -sign * plain + sign * delta * rising;
            e[end].t = alongT[end];
            s[end].z = rising;
            s[end].l = -sign * rising;
        }
    }
    for (int pair = 0; pair < 2; pair++) {
        const Components(&f)[2] = pair == 0 ? e : s;
        const Components even = {f[0].l + f[1].l, f[0].t + f[1].t, f[0].z + f[1].z},
                         odd = {-I * (f[0].l - f[1].l), -I * (f[0].t - f[1].t),
                                -I * (f[0].z - f[1].z)};
        for (int part = 0; part < 2; part++) {
            const Components& v = part == 0 ? even : odd;
            complex<double>* const to = sums[2 * pair + part];
            to[0] = at.lx * v.l - at.ly * v.t;
            to[1] = at.ly * v.l + at.lx * v.t;
            to[2] = v.z;
        }
    }
}

}  // namespace RigidHIPlugin
