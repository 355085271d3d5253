// Mid-step momenta, with which the first drift of a step moves a body. They are compared with
// closed forms, and with stationary covariances of a harmonic well, which follow from the schemes'
// own moves by recursion. The bounds of the watch are compared with quantiles of chi^2.

#include <array>

#include "TestSupport.h"
#include "context/TemperatureWatch.h"
#include "host/MidStep.h"
#include "schemes/MomentumFlow.h"
#include "schemes/Thermostats-inl.h"

using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace std;

namespace {

const auto A = CustomRigidHIIntegrator::LangevinA, B = CustomRigidHIIntegrator::LangevinB,
           C = CustomRigidHIIntegrator::LangevinC, HI = CustomRigidHIIntegrator::LangevinHI;
const CustomRigidHIIntegrator::Scheme schemes[] = {A, B, C, HI};

/** What a scheme does to x and p in the well k x^2/2: both are linear in x, p at the start of the
 * step and the numbers xi of its two draws. */
class WellFlow {
public:
    using Linear = array<double, 4>;  // of x, p, xi_0, xi_1
    WellFlow(double k, double m, const Thermostat& factors) : k(k), m(m), factors(factors) {}
    void kick(double t) { add(p, -t * k, xOfForces); }
    void drift(double t) {
        if (!hasDrifted) atDrift = p;
        hasDrifted = true;
        add(x, t / m, p);
    }
    void damp() {
        for (double& a : p) a *= factors.decay_p;
    }
    void addNoise(int draw) { p[2 + draw] += factors.noise_p; }
    void ornsteinUhlenbeck(int draw) {
        damp();
        addNoise(draw);
    }
    void gradientMove(int) {}

    Linear x = {1, 0, 0, 0}, p = {0, 1, 0, 0}, xOfForces = x, atDrift = p;

private:
    static void add(Linear& to, double factor, const Linear& from) {
        for (int i = 0; i < 4; i++) to[i] += factor * from[i];
    }
    const double k, m;
    const Thermostat factors;
    bool hasDrifted = false;
};

/** Covariances in the stationary state. */
struct Well {
    double xx = 0, xp = 0, pp = 0;  // between steps
    double mid = 0;                 // <p^2> at the first drift
    double midByFlow = 0;           // the same by MomentumFlow
    Well(CustomRigidHIIntegrator::Scheme scheme, double k, double m, double gamma, double kT,
         double h) {
        scalar::withThermostat(scheme, [&](auto named) {
            using Scheme = decltype(named);
            BodyInertia inertia;
            inertia.mass = m;
            HeatBath bath;
            bath.kT = kT;
            bath.gamma = gamma;
            const Thermostat factors = Scheme::coefficients(inertia, bath, h);
            WellFlow flow(k, m, factors);
            Scheme::beforeForces(flow, h);
            flow.xOfForces = flow.x;
            Scheme::afterForces(flow, h);
            const auto covariance = [&](const WellFlow::Linear& a, const WellFlow::Linear& b) {
                return a[0] * b[0] * xx + (a[0] * b[1] + a[1] * b[0]) * xp + a[1] * b[1] * pp +
                       a[2] * b[2] + a[3] * b[3];
            };
            // Momenta forget at the rate gamma. At large friction positions forget at
            // omega^2/gamma, and at omega^2 h/2 or more where a step forgets all of a momentum.
            const double g = gamma * h, x2 = k / m * h * h;
            const int steps = 40 * (1 / g + (x2 > 0 ? (g + 4) / x2 : 0));
            for (int i = 0; i < steps; i++) {
                const double next[] = {covariance(flow.x, flow.x), covariance(flow.x, flow.p),
                                       covariance(flow.p, flow.p)};
                xx = next[0], xp = next[1], pp = next[2];
            }
            mid = covariance(flow.atDrift, flow.atDrift);
            const auto up = MomentumFlow::upToDrift<Scheme>(factors.decay_p, factors.noise_p, h);
            const double ofX = -up.time * k;
            midByFlow = ofX * ofX * xx + 2 * ofX * up.factor * xp + up.factor * up.factor * pp +
                        up.variance();
        });
    }
};

const double k = 8, m = 2, kT = 1.7, omega = sqrt(k / m);

}  // namespace

TEST(MidStep, InAHarmonicWellHasItsClosedForms) {
    for (double x : {0.3, 0.6, 0.9, 1.5})
        for (double friction : {0.01, 1.0, 30.0}) {
            const double h = x / omega, gamma = friction * omega;
            const Well b(B, k, m, gamma, kT, h), c(C, k, m, gamma, kT, h),
                hi(HI, k, m, gamma, kT, h);
            const double wrong = 1 / (1 - x * x / 4);  // of B's <x^2>
            EXPECT_NEAR(c.mid / (m * kT), 1, 1e-12) << x << " " << friction;
            EXPECT_NEAR(hi.mid / (m * kT), 1, 1e-12) << x << " " << friction;
            EXPECT_NEAR(b.mid / (m * kT), wrong, 1e-12 * wrong) << x << " " << friction;
            EXPECT_NEAR(b.xx * k / kT, wrong, 1e-12 * wrong) << x << " " << friction;
            // Between steps C reads low.
            EXPECT_NEAR(c.pp / (m * kT), 1 - x * x / 4, 1e-12) << x << " " << friction;
        }
}

TEST(MidStep, OfLangevinAInAHarmonicWell) {
    // Right at weak friction, at any step; low by about gamma h/2 at large friction.
    for (double x : {0.3, 0.6, 0.9}) {
        EXPECT_NEAR(Well(A, k, m, 1e-3 * omega, kT, x / omega).mid / (m * kT), 1, 1e-3) << x;
        const double low = Well(A, k, m, omega, kT, x / omega).mid / (m * kT);
        EXPECT_GT(low, 0.82) << x;
        EXPECT_LT(low, 0.89) << x;
    }
}

TEST(MidStep, IsThatOfTheMomentumAtTheDrift) {
    for (auto scheme : schemes)
        for (double x : {0.1, 0.9})
            for (double friction : {0.1, 1.0, 10.0}) {
                const Well well(scheme, k, m, friction * omega, kT, x / omega);
                EXPECT_NEAR(well.midByFlow, well.mid, 1e-13 * well.mid) << scheme << " " << x;
            }
}

TEST(MidStep, OfFreeMotion) {
    for (auto scheme : schemes)
        for (double g : {1e-4, 0.02, 0.5, 3.0, 40.0}) {
            const double h = 0.3, gamma = g / h;
            StepSettings settings;
            settings.scheme = scheme;
            settings.h = h;
            settings.kT = kT;
            BodyInertia inertia;
            inertia.mass = m;
            HeatBath bath;
            bath.kT = kT;
            bath.gamma = gamma;
            const Thermostat factors = scalar::withThermostat(
                scheme, [&](auto named) { return named.coefficients(inertia, bath, h); });
            const FreeMomentum momentum =
                freeMomentum(settings, m, factors.decay_p, factors.noise_p);
            EXPECT_NEAR(momentum.relaxation, g, 1e-11 * max(g, 1.0)) << scheme << " " << g;
            const double expected =
                scheme == A ? g / 2 * (1 + 3 * exp(-2 * g)) / (1 - exp(-2 * g)) : 1;
            EXPECT_NEAR(momentum.ratio, expected, 1e-9 * expected) << scheme << " " << g;
            // The well without a well.
            if (g > 1e-3 && g < 10) {
                EXPECT_NEAR(momentum.ratio, Well(scheme, 0, m, gamma, kT, h).mid / (m * kT), 1e-9)
                    << scheme << " " << g;
            }
        }
}

TEST(MidStep, OfNothingThatIsDamped) {
    StepSettings settings;
    settings.kT = kT;
    settings.h = 0.1;
    for (auto scheme : schemes) {
        settings.scheme = scheme;
        const FreeMomentum momentum = freeMomentum(settings, m, 1, 0);
        EXPECT_EQ(momentum.relaxation, 0);
        EXPECT_EQ(momentum.ratio, 1);
    }
}

TEST(MidStep, SumsOverBodiesOfEveryKind) {
    // General, linear and point bodies, in numbers that do not fill blocks.
    const Vec3 moments[] = {Vec3(0.3, 0.1, 0.2), Vec3(0.2, 0, 0.2), Vec3()};
    const int n = 21;
    vector<BodyGeometry> geometries(n);
    vector<vector<int>> particles;
    for (int b = 0; b < n; b++) {
        geometries[b].mass = 1 + b;
        geometries[b].moments = moments[b % 3];
        geometries[b].sites = {Vec3()};
        particles.push_back({b});
    }
    BodySet bodies(geometries, particles, vector<vector<double>>(n),
                   vector<vector<bool>>(n, {true}));
    mt19937 generator(5);
    normal_distribution<double> normal;
    const auto random = [&] {
        return Vec3(normal(generator), normal(generator), normal(generator));
    };
    const double h = 0.2;
    HeatBath bath;
    bath.kT = kT;
    bath.gamma = 0.7;
    bath.Gamma = 2.0;
    for (auto scheme : {A, B, C}) {
        double translational = 0, rotational = 0;
        Vec3 momentum;
        for (int b = 0; b < n; b++) {
            BodyState state;
            state.p = random();
            state.l = random();
            state.q = randomQuaternion(generator);
            bodies.setState(b, state);
            bodies.addForceAndTorque_lab(b, random(), random());
            const BodyInertia& inertia = bodies.inertia(b);
            const Thermostat factors = scalar::withThermostat(
                scheme, [&](auto named) { return named.coefficients(inertia, bath, h); });
            bodies.setThermostat(b, factors);
            const int s = bodies.slot(b);
            // LangevinC: the kick alone. B and A: the decay over h/2, and their noise.
            const auto add = [&](double p, double f, double decay, double noise, double I,
                                 double& energy) {
                const double damped = scheme == C ? p : decay * p, mean = damped + h / 2 * f,
                             variance = scheme == C ? 0 : noise * noise;
                energy += (mean * mean + variance) / (2 * I);
                return mean;
            };
            for (int i = 0; i < 3; i++) {
                momentum[i] += add(bodies.p[i][s], bodies.force_lab[i][s], factors.decay_p,
                                   factors.noise_p, inertia.mass, translational);
                if (inertia.isLive(i))
                    add(bodies.l[i][s], bodies.torque[i][s], factors.decay_l[i], factors.noise_l[i],
                        inertia.moments[i], rotational);
            }
        }
        StepSettings settings;
        settings.scheme = scheme;
        settings.h = h;
        settings.kT = kT;
        const MidStepEnergies found = midStepEnergies(bodies, settings),
                              means = midStepEnergiesOfMeans(bodies, settings),
                              noise = midStepEnergiesOfNoise(bodies, settings);
        EXPECT_NEAR(found.translational, translational, 1e-13 * translational) << scheme;
        EXPECT_NEAR(found.rotational, rotational, 1e-13 * rotational) << scheme;
        EXPECT_LT(norm(found.momentum - momentum), 1e-12) << scheme;
        EXPECT_EQ(found.rotational, means.rotational + noise.rotational);
        EXPECT_EQ(noise.translational == 0, scheme == C);
    }
}

TEST(TemperatureWatch, BoundsAreQuantilesOfChiSquared) {
    // The upper and lower quantiles at 5 standard errors, 2.87e-7, of the mean of n squares (SciPy:
    // stats.chi2.isf(stats.norm.sf(5), n)/n and stats.chi2.ppf(stats.norm.sf(5), n)/n). A window
    // that is right goes beyond them so often, whatever its band.
    struct {
        int n;
        double low, high;
    } quantiles[] = {{20, 0.11101, 3.43952},
                     {60, 0.33551, 2.19226},
                     {1000, 0.79216, 1.23982},
                     {20000, 0.95080, 1.05080}};
    for (const auto& q : quantiles) {
        TemperatureWatch::Expectation motion;
        motion.degrees = 3;
        motion.energy = 2.5;
        motion.relativeVariance = 2.0 / q.n;
        const double close = q.n < 50 ? 0.02 : 0.005;
        EXPECT_TRUE(motion.isTooHigh(2.5 * (q.high + close * q.high), 0)) << q.n;
        EXPECT_FALSE(motion.isTooHigh(2.5 * (q.high - close * q.high), 0)) << q.n;
        EXPECT_TRUE(motion.isTooLow(2.5 * (q.low - close), 0)) << q.n;
        EXPECT_FALSE(motion.isTooLow(2.5 * (q.low + close), 0)) << q.n;
        EXPECT_FALSE(motion.isTooHigh(2.5 * (q.high + 0.05), 0.1)) << q.n;
        EXPECT_TRUE(motion.isTooHigh(2.5 * (q.high + 0.2), 0.1)) << q.n;
        EXPECT_FALSE(motion.isTooLow(2.5 * (q.low - 0.05), 0.1)) << q.n;
    }
}
