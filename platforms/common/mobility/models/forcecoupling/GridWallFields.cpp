#include "mobility/models/forcecoupling/GridWallFields.h"

#include <algorithm>
#include <cmath>

#include "mobility/models/confined/PlaneMatrices.h"

namespace RigidHIPlugin {

using std::complex;

namespace {

using Real = PlaneConditions::Real;
using Matrix = PlaneConditions::Matrix;
using Matrices = PlaneConditions::Matrices;

}  // namespace

GridWallFields::GridWallFields(const PlaneConditions& conditions, const GridShape& gridShape,
                               const PartOfMode& part, double longest,
                               const std::function<Flows(double)>& flows)
    : conditions(conditions), shape(gridShape), numX(shape.size[0] / 2 + 1),
      numKinds(conditions.law(1).t.isZero(0) ? OfLaw : OfLaw + 1),
      profiles(GridPlanes::profilesOf(conditions, shape)),
      factors(shape, [&](double k, double) { return std::sqrt(part(k)) / k; }) {
    const auto partOfSquare = [&](Real k2) {
        return static_cast<Real>(part(std::sqrt(static_cast<double>(k2))));
    };
    matrices.assign((size_t)numX * (shape.size[1] / 2 + 1) * numKinds * numbersOfMatrix, 0.0);
    for (int y = 0; 2 * y < shape.size[1]; y++)
        for (int x = y == 0 ? 1 : 0; 2 * x < shape.size[0]; x++) {
            const double k = std::hypot(shape.waveNumber(0, x), shape.waveNumber(1, y));
            if (k > longest) continue;
            const Matrices S = conditions.periodic(k),
                           SY = GridPlanes::truncated(conditions, profiles, shape, k, partOfSquare);
            const Flows flow = flows(k);
            const Matrix across = flow.across.cast<Real>(), alongT = flow.alongT.cast<Real>();
            const Matrices near = {inverseFactorOf(S.t - SY.t), inverseFactorOf(S.lz - SY.lz)},
                           inverse = {inverseOf(S.t), inverseOf(S.lz)};
            store(x, y, Near, near);
            // l - 1/S b_X = 1/S S_Y l
            store(x, y, OfNumbers,
                  {alongT * (inverse.t * (SY.t * near.t)),
                   across * (inverse.lz * (SY.lz * near.lz))});
            store(x, y, OfVelocities, {-alongT * inverse.t, -across * inverse.lz});
            if (numKinds <= OfLaw) continue;
            const Matrices T = conditions.law(k);
            store(x, y, OfLaw,
                  {alongT * (inverse.t * rootOf(T.t)), across * (inverse.lz * rootOf(T.lz))});
        }
}

void GridWallFields::store(int x, int y, Kind kind, const Matrices& from) {
    double* to = const_cast<double*>(matrix(x, y, kind));
    for (int j = 0; j < 4; j++)
        for (int i = 0; i < 4; i++) *to++ = static_cast<double>(from.lz(i, j));
    for (int j = 0; j < 2; j++)
        for (int i = 0; i < 2; i++) *to++ = static_cast<double>(from.t(i, j));
}

GridWallFields::Turned GridWallFields::turned(int x, int y, const complex<double>* u) const {
    const double kx = shape.waveNumber(0, x), ky = shape.waveNumber(1, y),
                 inverse = 1 / std::sqrt(kx * kx + ky * ky), nx = kx * inverse, ny = ky * inverse;
    Turned result;
    for (int j = 0; j < numPlanes; j++, u += 3) {
        result.lz[j] = nx * u[0] + ny * u[1];
        result.t[j] = nx * u[1] - ny * u[0];
        result.lz[numPlanes + j] = {u[2].imag(), -u[2].real()};
    }
    return result;
}

void GridWallFields::turnBack(int x, int y, const Turned& from, complex<double>* u) const {
    const double kx = shape.waveNumber(0, x), ky = shape.waveNumber(1, y),
                 inverse = 1 / std::sqrt(kx * kx + ky * ky), nx = kx * inverse, ny = ky * inverse;
    for (int j = 0; j < numPlanes; j++, u += 3) {
        u[0] = nx * from.lz[j] - ny * from.t[j];
        u[1] = ny * from.lz[j] + nx * from.t[j];
        const complex<double>& z = from.lz[numPlanes + j];
        u[2] = {-z.imag(), z.real()};
    }
}

void GridWallFields::add(const double* m, const Turned& from, double factor, Turned& to) {
    for (int j = 0; j < 4; j++)
        for (int i = 0; i < 4; i++) to.lz[i] += factor * *m++ * from.lz[j];
    for (int j = 0; j < 2; j++)
        for (int i = 0; i < 2; i++) to.t[i] += factor * *m++ * from.t[j];
}

void GridWallFields::respond(int x, int y, const complex<double>* velocities,
                             const complex<double>* numbers, double scale, complex<double>* near,
                             complex<double> (&across)[4], complex<double> (&alongT)[2]) const {
    const Turned n = turned(x, y, numbers);
    Turned forces = {}, flows = {};
    add(matrix(x, y, Near), n, scale, forces);
    turnBack(x, y, forces, near);
    add(matrix(x, y, OfNumbers), n, scale, flows);
    add(matrix(x, y, OfVelocities), turned(x, y, velocities), 1, flows);
    if (numKinds > OfLaw)
        add(matrix(x, y, OfLaw), turned(x, y, numbers + numUnknowns), scale, flows);
    // The functions belong to velocities normal to the planes; the numbers of z are -i times these.
    for (int a = 0; a < 4; a++) across[a] = {-flows.lz[a].imag(), flows.lz[a].real()};
    for (int a = 0; a < 2; a++) alongT[a] = flows.t[a];
}

void GridWallFields::respondToNear(int x, int y, complex<double>* velocities) const {
    const double* const m = matrix(x, y, Near);
    const Turned b = turned(x, y, velocities);
    Turned middle = {}, forces = {};
    for (int j = 0; j < 4; j++)
        for (int i = 0; i < 4; i++) middle.lz[j] += m[4 * j + i] * b.lz[i];
    for (int j = 0; j < 2; j++)
        for (int i = 0; i < 2; i++) middle.t[j] += m[16 + 2 * j + i] * b.t[i];
    add(m, middle, 1, forces);
    turnBack(x, y, forces, velocities);
}

}  // namespace RigidHIPlugin
