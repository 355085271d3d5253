#ifndef RIGIDHI_PLANE_MODES_H_
#define RIGIDHI_PLANE_MODES_H_

#include <Eigen/Core>
#include <cmath>
#include <complex>
#include <vector>

#include "mobility/MobilityAt.h"

namespace RigidHIPlugin {

// Flows that are waves exp(ik.rho) along planes z = const, times functions of z. The directions are
// l = k/|k|, t = z x l, and z. The component along t is independent of the others, which follow
// from u_z = w: u_l = (i/k) w'. The vorticity is (-u_t', (i/k) (w'' - k^2 w), ik u_t).

/** A nonzero wave vector along the planes. */
struct PlaneWave {
    Eigen::Vector2d k;  // 1/nm
    double length;
};

/**
 * The wave vectors of a box along its first two vectors up to a length, by increasing length: one
 * of each pair k and -k.
 */
std::vector<PlaneWave> planeWaves(const BoxVectors& box, double longest);
/** The area of a box along the planes, nm^2. */
double planeArea(const BoxVectors& box);

/**
 * A function of z with everything that a particle needs: its value, its slope, and the Laplacians
 * (d^2/dz^2 - k^2) of both.
 */
struct PlaneFunction {
    double value, slope, laplacian, slopeOfLaplacian;
    PlaneFunction operator+(const PlaneFunction& b) const {
        return {value + b.value, slope + b.slope, laplacian + b.laplacian,
                slopeOfLaplacian + b.slopeOfLaplacian};
    }
    PlaneFunction operator*(double factor) const {
        return {factor * value, factor * slope, factor * laplacian, factor * slopeOfLaplacian};
    }
    PlaneFunction operator-(const PlaneFunction& b) const { return *this + b * -1; }
};

/**
 * The motion of a sphere of radius a in a flow whose sources are outside the sphere: the velocity
 * (1 + (a^2/6) lap) u, and half of the curl as angular velocity. The latter needs no Laplacian,
 * because the vorticity is harmonic.
 */
struct FeltMode {
    std::complex<double> l = 0, t = 0, z = 0, turnL = 0, turnT = 0, turnZ = 0;

    /** For the flow with u_z = w. */
    static FeltMode ofAcross(const PlaneFunction& w, double k, double a);
    /** For the flow with u_t = f. */
    static FeltMode ofAlongT(const PlaneFunction& f, double k, double a);
    FeltMode operator*(std::complex<double> factor) const {
        return {factor * l, factor * t, factor * z, factor * turnL, factor * turnT, factor * turnZ};
    }
    /** The velocity along x, y, z, and the angular velocity. */
    Eigen::Vector3cd velocity(const PlaneWave& wave) const;
    Eigen::Vector3cd omega(const PlaneWave& wave) const;
};

/**
 * The flow of unit forces on the plane z = 0 and its images in a fluid of period P along z, times
 * the viscosity, at the height zeta, 0 <= zeta <= P. With E = cosh k(P/2 - zeta)/sinh(kP/2), c =
 * P/2, y = c - zeta and F = c coth(kc) E - y sinh(ky)/sinh(kc) it is
 *     zz = g = (E + kF)/4k,  ll = (E - kF)/4k,  tt = E/2k,  lap g = -kE/2,
 * and a force along l induces w = (i/k) g'.
 */
template <typename Real>
struct PeriodicPlane {
    Real E, sh;              // sh = sinh(ky)/sinh(kc) = -E'/k
    Real zz, ll, tt, slope;  // slope = g'
    Real down, rest;         // exp(-k(P - zeta)), 1 - exp(-kP)

    PeriodicPlane(Real k, Real period, Real zeta)
        : down(std::exp(-k * (period - zeta))), rest(-std::expm1(-k * period)) {
        using std::expm1;
        const Real y = period / 2 - zeta, x = k * period / 2, up = std::exp(-k * zeta);
        E = (up + down) / rest;
        // without a difference of nearly equal numbers
        sh = (y > 0 ? -up * expm1(-2 * k * y) : down * expm1(2 * k * y)) / rest;
        const Real m = xCothMinusOne(x);
        zz = ((2 + m) * E - k * y * sh) / (4 * k);
        ll = (k * y * sh - m * E) / (4 * k);
        tt = E / (2 * k);
        slope = (k * y * E - (1 + m) * sh) / 4;
    }
    /** x coth(x) - 1, x > 0 */
    static Real xCothMinusOne(Real x) {
        const Real seriesBelow = 0.1L, x2 = x * x;
        if (x > seriesBelow) return x * (1 + std::exp(-2 * x)) / -std::expm1(-2 * x) - 1;
        // of Bernoulli's numbers; the next term is below 1e-22
        const Real terms[] = {
            1.0L / 3,     -1.0L / 45,           2.0L / 945,      -1.0L / 4725,
            2.0L / 93555, -1382.0L / 638512875, 4.0L / 18243225, -3617.0L / 162820783125.0L};
        Real sum = 0;
        for (int n = 7; n >= 0; n--) sum = (sum + terms[n]) * x2;
        return sum;
    }
};

/** The motion of a sphere of radius a in the flow of a force along l, t or z on the plane. */
FeltMode feltFromL(const PeriodicPlane<double>& flow, double k, double a);
FeltMode feltFromT(const PeriodicPlane<double>& flow, double k, double a);
FeltMode feltFromZ(const PeriodicPlane<double>& flow, double k, double a);

}  // namespace RigidHIPlugin

#endif
