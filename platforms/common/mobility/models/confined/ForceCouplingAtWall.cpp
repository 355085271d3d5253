#include "mobility/models/confined/ForceCouplingAtWall.h"

#include <cmath>

#include "linearalgebra/Decompositions.h"
#include "mobility/models/forcecoupling/Envelopes.h"

using namespace std;

namespace RigidHIPlugin {

namespace {

// Lengths are in radii of the sphere, viscosities are 1. Planes that are close to each other for a
// long wave make S nearly singular, hence long double.
using Real = long double;
using OfPlanes = Eigen::Matrix<Real, Eigen::Dynamic, 1, 0, 4, 1>;
using BetweenPlanes = Eigen::Matrix<Real, Eigen::Dynamic, Eigen::Dynamic, 0, 4, 4>;

/** Averages over z of a Gaussian at z = d > 0, times exp(-k^2 width^2/2) of the wave along. */
struct Averages {
    Real wave, sign;     // exp(-k |z|), and with the sign of z
    Real height, slope;  // |z| exp(-k |z|), and z exp(-k |z|)

    Averages(Real k, Real d, Real width) {
        const Real s2 = width * width, root = sqrt(Real(2)) * width,
                   towards = exp(-k * d) * erfc((k * s2 - d) / root) / 2,
                   beyond = exp(k * d) * erfc((k * s2 + d) / root) / 2,
                   density =
                       exp(-d * d / (2 * s2) - k * k * s2 / 2) / (sqrt(2 * Real(M_PI)) * width);
        wave = towards + beyond;
        sign = towards - beyond;
        // <z f> = d <f> + width^2 <f'>
        slope = d * wave - k * s2 * sign;
        height = d * sign + s2 * (2 * density - k * wave);
    }
};

/**
 * Planes at rest for one wave number k. Rows of `across` are the velocities along k of all planes,
 * and after them those along z times -i; rows of `along` are those along z x k. See PlaneModes.h
 * for the flows.
 */
struct Planes {
    BetweenPlanes across, along;

    Planes(const vector<Real>& at, Real k) {
        const int n = at.size();
        across.resize(2 * n, 2 * n);
        along.resize(n, n);
        for (int p = 0; p < n; p++)
            for (int q = 0; q < n; q++) {
                const Real d = at[p] - at[q], x = k * abs(d), wave = exp(-x);
                across(p, q) = (1 - x) * wave / (4 * k);
                across(n + p, n + q) = (1 + x) * wave / (4 * k);
                across(p, n + q) = d * wave / 4;
                across(n + p, q) = -d * wave / 4;
                along(p, q) = wave / (2 * k);
            }
    }
};

/** What the sphere feels of unit forces on the planes, in the rows of Planes. */
struct FeltFromPlanes {
    OfPlanes velocityAlongK, velocityZ, turnAcrossK;  // of `across`
    OfPlanes velocityAcrossK, turnAlongK, turnZ;      // of `along`

    FeltFromPlanes(const vector<Real>& at, Real k, Real height) {
        const int n = at.size();
        for (OfPlanes* each : {&velocityAlongK, &velocityZ, &turnAcrossK}) each->resize(2 * n);
        for (OfPlanes* each : {&velocityAcrossK, &turnAlongK, &turnZ}) each->resize(n);
        for (int p = 0; p < n; p++) {
            const Real d = height - at[p];
            const Averages v(k, d, forceEnvelopeWidth(1)), w(k, d, torqueEnvelopeWidth(1));
            velocityAlongK[p] = (v.wave - k * v.height) / (4 * k);
            velocityAlongK[n + p] = v.slope / 4;
            velocityZ[p] = -v.slope / 4;
            velocityZ[n + p] = (v.wave + k * v.height) / (4 * k);
            velocityAcrossK[p] = v.wave / (2 * k);
            turnAcrossK[p] = -w.sign / 4;
            turnAcrossK[n + p] = w.wave / 4;
            turnAlongK[p] = w.sign / 4;
            turnZ[p] = w.wave / 4;
        }
    }
};

/** Beyond this height no double notices what is behind the wall. */
const double highAboveWall = 4;

}  // namespace

SphereWallMobility ForceCouplingAtWall::integral(double u, double behind) {
    SphereWallMobility free = {1, 1, 0.75, 0.75, 0};
    if (u == 0) return free;
    const Real height = 1 / Real(u);
    vector<Real> at = {0};
    if (height < highAboveWall) at.push_back(-behind);
    // The integrand is cut off by exp(-2 k height). With k height = exp(t - exp(-t)) the
    // trapezoidal rule converges faster than any power.
    const Real from = -4, to = 3.5L, step = 0.1L;
    Real along = 0, across = 0, turnAlong = 0, turnNormal = 0, rolling = 0;
    for (int n = 0; n <= (to - from) / step; n++) {
        const Real t = from + n * step, k = exp(t - exp(-t)) / height,
                   weight = step * (1 + exp(-t)) * k * k / (2 * Real(M_PI));
        const Planes planes(at, k);
        const FeltFromPlanes felt(at, k, height);
        const Eigen::LDLT<BetweenPlanes> inK(planes.across), acrossK(planes.along);
        const OfPlanes ofV = inK.solve(felt.velocityAlongK),
                       ofVAcross = acrossK.solve(felt.velocityAcrossK),
                       ofTurn = inK.solve(felt.turnAcrossK),
                       ofTurnAlong = acrossK.solve(felt.turnAlongK);
        // Averages over the directions of k.
        along += weight * (felt.velocityAlongK.dot(ofV) + felt.velocityAcrossK.dot(ofVAcross)) / 2;
        turnAlong += weight * (felt.turnAcrossK.dot(ofTurn) + felt.turnAlongK.dot(ofTurnAlong)) / 2;
        rolling +=
            weight * (felt.velocityAlongK.dot(ofTurn) - felt.velocityAcrossK.dot(ofTurnAlong)) / 2;
        across += weight * felt.velocityZ.dot(inK.solve(felt.velocityZ));
        turnNormal += weight * felt.turnZ.dot(acrossK.solve(felt.turnZ));
    }
    const Real stokes = 6 * Real(M_PI);
    free.along -= stokes * along;
    free.across -= stokes * across;
    free.turnAlong -= stokes * turnAlong;
    free.turnNormal -= stokes * turnNormal;
    free.rolling -= stokes * rolling;
    return free;
}

ForceCouplingAtWall::ForceCouplingAtWall(double behind)
    : series([&](double x) {
          const SphereWallMobility m = integral((1 + x) / 2, behind);
          return Eigen::Array<double, 5, 1>(
              {m.along, m.across, m.turnAlong, m.turnNormal, m.rolling});
      }) {}

SphereWallMobility ForceCouplingAtWall::at(double u) const {
    const Eigen::Array<double, 5, 1> m =
        series.addedTo<5>(Eigen::Array<double, 5, 1>::Zero(), 2 * u - 1);
    return {m[0], m[1], m[2], m[3], m[4]};
}

}  // namespace RigidHIPlugin
