// Spreading of forces over surfaces of spheres, or with Gaussians.

#include <cmath>

#include "mobility/StressletBasis.h"
#include "mobility/models/periodic/PeriodicMobility.h"
#include "mobility/models/rotneprager/RotnePragerYamakawa-inl.h"

namespace RigidHIPlugin {

namespace {

class OverSurfaces : public Spreading {
public:
    double ofForce(double a, double k) const override {
        double phi[5];
        besselQuotients(k * a, phi);
        return phi[0];
    }
    double ofTorque(double a, double k) const override {
        double phi[5];
        besselQuotients(k * a, phi);
        return 3 * phi[1];
    }
    double laplacian(double a) const override { return a * a / 6; }
    PairFunctions free(double a_i, double a_j, double distance, bool,
                       bool stresslets) const override {
        if (a_i == 0 && !(distance * distance > a_j * a_j)) return insideOf(a_j, stresslets);
        const auto m = scalar::pairMobility(distance * distance, a_i, a_j);
        PairFunctions f;
        f.ttI = m.ttI;
        f.ttR = m.ttR;
        f.tr = m.tr;
        f.rt = m.rt;
        f.rrI = m.rrI;
        f.rrR = m.rrR;
        if (!stresslets) return f;
        if (distance == 0) {
            f.ssI = ownStressletFunction(a_i);
            return f;
        }
        const StressletPair pair(a_i, a_j, distance);
        const double r2 = distance * distance, r3 = r2 * distance;
        const auto v_i = pair.velocity(a_i, a_j), v_j = pair.velocity(a_j, a_i);
        f.ts = v_i.towards / distance;
        f.tsR = v_i.along / r3;
        f.st = v_j.towards / distance;
        f.stR = v_j.along / r3;
        f.rs = -pair.omega() / r2;
        f.ssI = pair.ssI();
        f.ssV = pair.ssV() / r2;
        f.ssR = pair.ssS() / (r2 * r2);
        return f;
    }
    double reach(double q, double inverseSplitting, double largest) const override {
        return q * inverseSplitting + 2 * largest;
    }
    double largestWave(double q, double inverseSplitting, double, bool) const override {
        return 2 * q / inverseSplitting;
    }
    bool convergesByWaves() const override { return false; }

private:
    /**
     * The flow inside a sphere with forces spread over its surface. It equals the motion of the
     * surface: uniform, a rotation or a strain.
     */
    static PairFunctions insideOf(double a, bool stresslets) {
        PairFunctions f;
        f.ttI = 4 / (3 * a);
        f.tr = 1 / (a * a * a);
        if (stresslets) f.ts = StressletPair(0, a, a).velocity(0, a).towards / a;
        return f;
    }
};

class OverGaussians : public Spreading {
public:
    double ofForce(double a, double k) const override {
        return std::exp(-0.5 * square(k * width(a)));
    }
    double ofTorque(double a, double k) const override {
        return std::exp(-0.5 * square(k * widthOfTorque(a)));
    }
    double laplacian(double a) const override { return 0.5 * square(width(a)); }
    PairFunctions free(double a_i, double a_j, double distance, bool torques, bool) const override {
        const double s_i = width(a_i), s_j = width(a_j);
        const Integrals tt(s_i * s_i + s_j * s_j, distance);
        PairFunctions f;
        f.ttI = tt.phi0 - tt.phi1;
        f.ttR = tt.k2phi2;
        if (!torques) return f;
        const double t_i = widthOfTorque(a_i), t_j = widthOfTorque(a_j);
        const Integrals tr(s_i * s_i + t_j * t_j, distance), rt(t_i * t_i + s_j * s_j, distance),
            rr(t_i * t_i + t_j * t_j, distance);
        f.tr = 0.5 * tr.k2phi1;
        f.rt = 0.5 * rt.k2phi1;
        f.rrI = 0.25 * (rr.k2phi0 - rr.k2phi1);
        f.rrR = 0.25 * rr.k4phi2;
        return f;
    }
    double reach(double q, double inverseSplitting, double largest) const override {
        return q * std::sqrt(square(inverseSplitting) + 4 * square(width(largest)));
    }
    double largestWave(double q, double inverseSplitting, double smallest,
                       bool hasTorque) const override {
        return q / std::sqrt(0.25 * square(inverseSplitting) +
                             square(hasTorque ? widthOfTorque(smallest) : width(smallest)));
    }
    bool convergesByWaves() const override { return true; }

private:
    static double square(double x) { return x * x; }
    static double width(double a) { return a / std::sqrt(M_PI); }
    static double widthOfTorque(double a) { return a / std::cbrt(6 * std::sqrt(M_PI)); }

    /** 4/pi times the integrals of exp(-variance k^2/2) k^2n phi_m(kr) over k > 0. */
    struct Integrals {
        double phi0 = 0, phi1 = 0, k2phi0 = 0, k2phi1 = 0, k2phi2 = 0, k4phi2 = 0;
        Integrals(double variance, double r) {
            const double width = std::sqrt(variance), farFrom = 4;
            if (r > farFrom * width) {
                // Here the closed form has no cancellation.
                const double E = 2 * std::erf(r / (width * std::sqrt(2.0))), r2 = r * r,
                             r3 = r2 * r;
                const double g = 2 * std::sqrt(2 / M_PI) / width *
                                 std::exp(-0.5 * r2 / variance);  // E' with respect to r
                phi0 = E / r;
                phi1 = (0.5 * (r2 - variance) * E + 0.5 * variance * r * g) / r3;
                k2phi0 = g / variance;
                k2phi1 = E / r3 - g / r2;
                k2phi2 = (3 * phi1 - phi0) / r2;
                k4phi2 = (3 * k2phi1 - k2phi0) / r2;
                return;
            }
            // The trapezoidal rule, as in LatticeSum: the Gaussian is negligible beyond deep/width,
            // and its transform beyond deep width.
            const double deep = 9.5, step = 2 * M_PI / (r + deep * width), end = deep / width;
            for (int n = 0; n * step <= end; n++) {
                const double k = n * step, k2 = k * k,
                             w = 4 / M_PI * step * (n == 0 ? 0.5 : 1) *
                                 std::exp(-0.5 * variance * k2);
                double phi[5];
                besselQuotients(k * r, phi);
                phi0 += w * phi[0];
                phi1 += w * phi[1];
                k2phi0 += w * k2 * phi[0];
                k2phi1 += w * k2 * phi[1];
                k2phi2 += w * k2 * phi[2];
                k4phi2 += w * k2 * k2 * phi[2];
            }
        }
    };
};

}  // namespace

const Spreading& overSurfaces() {
    static const OverSurfaces only;
    return only;
}

const Spreading& overGaussians() {
    static const OverGaussians only;
    return only;
}

}  // namespace RigidHIPlugin
