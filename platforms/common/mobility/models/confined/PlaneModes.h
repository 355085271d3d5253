#ifndef RIGIDHI_PLANE_MODES_H_
#define RIGIDHI_PLANE_MODES_H_

#include <Eigen/Core>
#include <complex>
#include <vector>

#include "mobility/MobilityAt.h"

namespace RigidHIPlugin {

// Flows that are waves exp(ik.rho) along planes z = const, and functions of z across them. The
// directions are l = k/|k|, t = z x l, and z. The component along t is independent of the others,
// which follow from u_z = w: u_l = (i/k) w'. The vorticity is (-u_t', (i/k) (w'' - k^2 w), ik u_t).

/** A wave vector along the planes, not 0. */
struct PlaneWave {
    Eigen::Vector2d k;  // 1/nm
    double length;
};

/**
 * The wave vectors of a box along its first two vectors up to a length, by increasing length. There
 * is one of each pair k and -k.
 */
std::vector<PlaneWave> planeWaves(const BoxVectors& box, double longest);
/** The area of a box along the planes, nm^2. */
double planeArea(const BoxVectors& box);

/**
 * A function of z with all that a particle takes of it: its value, its slope, and the Laplacians
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
 * What a sphere of radius a takes of a flow whose sources are outside of it: the velocity (1 +
 * (a^2/6) lap) u, and half of the curl as angular velocity, which needs no such term because the
 * vorticity is harmonic.
 */
struct FeltMode {
    std::complex<double> l = 0, t = 0, z = 0, turnL = 0, turnT = 0, turnZ = 0;

    /** Of the flow with u_z = w. */
    static FeltMode ofAcross(const PlaneFunction& w, double k, double a);
    /** Of the flow with u_t = f. */
    static FeltMode ofAlongT(const PlaneFunction& f, double k, double a);
    FeltMode operator*(std::complex<double> factor) const {
        return {factor * l, factor * t, factor * z, factor * turnL, factor * turnT, factor * turnZ};
    }
    /** The velocity along x, y, z, and the angular velocity. */
    Eigen::Vector3cd velocity(const PlaneWave& wave) const;
    Eigen::Vector3cd omega(const PlaneWave& wave) const;
};

/**
 * The flow that unit forces on the plane z = 0 and its images make in a fluid of period P along z,
 * times the viscosity, at the height zeta, 0 <= zeta <= P. With E = cosh k(P/2 - zeta)/sinh(kP/2),
 * c = P/2, y = c - zeta and F = c coth(kc) E - y sinh(ky)/sinh(kc) it is
 *     zz = g = (E + kF)/4k,  ll = (E - kF)/4k,  tt = E/2k,  lap g = -kE/2,
 * and a force along l makes w = (i/k) g'.
 */
class PeriodicPlaneFlow {
public:
    PeriodicPlaneFlow(double k, double period, double zeta);
    double zz() const { return ofZ; }
    double ll() const { return ofL; }
    double tt() const { return 0.5 * E / k; }
    /** d/dzeta of zz. */
    double slope() const { return slopeOfZ; }
    /** What a sphere takes of the flow that a force along l, t or z on the plane makes. */
    FeltMode fromL(double a) const;
    FeltMode fromT(double a) const;
    FeltMode fromZ(double a) const;

private:
    double k, E, sh, ofL, ofZ, slopeOfZ;
};

}  // namespace RigidHIPlugin

#endif
