#include "mobility/models/confined/PlaneModes.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace RigidHIPlugin {

using Eigen::Vector3cd;
using std::complex;

double planeArea(const BoxVectors& box) {
    return std::abs(box[0][0] * box[1][1] - box[0][1] * box[1][0]);
}

std::vector<PlaneWave> planeWaves(const BoxVectors& box, double longest) {
    Eigen::Matrix2d vectors;
    vectors << box[0][0], box[1][0], box[0][1], box[1][1];
    const double area = planeArea(box);
    Eigen::Matrix2d reciprocal;  // reciprocal^T vectors = 2 pi
    reciprocal << vectors(1, 1), -vectors(1, 0), -vectors(0, 1), vectors(0, 0);
    reciprocal *= 2 * M_PI / (vectors.determinant() > 0 ? area : -area);
    const auto most = [&](int axis) {
        return static_cast<int>(longest * vectors.col(axis).norm() / (2 * M_PI));
    };
    std::vector<PlaneWave> waves;
    for (int m = 0; m <= most(0); m++)
        for (int n = m == 0 ? 1 : -most(1); n <= most(1); n++) {
            const Eigen::Vector2d k = reciprocal * Eigen::Vector2d(m, n);
            if (k.norm() <= longest) waves.push_back({k, k.norm()});
        }
    std::stable_sort(waves.begin(), waves.end(),
                     [](const PlaneWave& a, const PlaneWave& b) { return a.length < b.length; });
    return waves;
}

FeltMode FeltMode::ofAcross(const PlaneFunction& w, double k, double a) {
    const double sixth = a * a / 6;
    const complex<double> overK(0, 1 / k);
    FeltMode felt;
    felt.z = w.value + sixth * w.laplacian;
    felt.l = overK * (w.slope + sixth * w.slopeOfLaplacian);
    felt.turnT = 0.5 * overK * w.laplacian;
    return felt;
}

FeltMode FeltMode::ofAlongT(const PlaneFunction& f, double k, double a) {
    FeltMode felt;
    felt.t = f.value + a * a / 6 * f.laplacian;
    felt.turnL = -0.5 * f.slope;
    felt.turnZ = complex<double>(0, 0.5 * k) * f.value;
    return felt;
}

namespace {

/** Components along l, t and z as components along x, y and z. */
Vector3cd turned(const complex<double>& l, const complex<double>& t, const complex<double>& z,
                 const PlaneWave& wave) {
    const double x = wave.k[0] / wave.length, y = wave.k[1] / wave.length;
    return {l * x - t * y, l * y + t * x, z};
}

}  // namespace

Vector3cd FeltMode::velocity(const PlaneWave& wave) const { return turned(l, t, z, wave); }
Vector3cd FeltMode::omega(const PlaneWave& wave) const { return turned(turnL, turnT, turnZ, wave); }

FeltMode feltFromZ(const PeriodicPlane<double>& flow, double k, double a) {
    return FeltMode::ofAcross({flow.zz, flow.slope, -0.5 * k * flow.E, 0.5 * k * k * flow.sh}, k,
                              a);
}

FeltMode feltFromL(const PeriodicPlane<double>& flow, double k, double a) {
    const double k2 = k * k;
    return FeltMode::ofAcross(
               {flow.slope, -k2 * flow.ll, 0.5 * k2 * flow.sh, -0.5 * k2 * k * flow.E}, k, a) *
           complex<double>(0, 1 / k);
}

FeltMode feltFromT(const PeriodicPlane<double>& flow, double k, double a) {
    return FeltMode::ofAlongT({flow.tt, -0.5 * flow.sh, 0, 0}, k, a);
}

}  // namespace RigidHIPlugin
