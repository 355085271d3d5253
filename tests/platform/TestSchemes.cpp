// The schemes without a fluid are compared with closed forms. Further tests are of their orders and
// of steps without noise. Units have kT = 1.

#include <openmm/CustomExternalForce.h>

#include "Sampling.h"
#include "TestSupport.h"
#include "openmmrigidhi/SchemeTraits.h"

using namespace OpenMM;
using namespace RigidHITest;
using RigidHIPlugin::traitsOf;
using namespace std;

namespace {

using Scheme = CustomRigidHIIntegrator::Scheme;
const auto A = CustomRigidHIIntegrator::LangevinA, B = CustomRigidHIIntegrator::LangevinB,
           C = CustomRigidHIIntegrator::LangevinC,
           Gradient = CustomRigidHIIntegrator::GradientThermostat;

/** Many copies of a body whose centres of mass are in a harmonic well k/2 R^2. The force on each
 * site is in proportion to its mass. */
struct Trap {
    System system;
    CustomRigidHIIntegrator integrator;
    unique_ptr<Context> context;
    int copies;
    Trap(Scheme scheme, double h, const Shape& shape, int copies, double k, bool free = false)
        : integrator(T1, h), copies(copies) {
        double mass = 0;
        for (double m : shape.masses) mass += m;
        auto* well = new CustomExternalForce("0.5*share*(x*x+y*y+z*z)");
        well->addPerParticleParameter("share");
        vector<Vec3> positions;
        if (free)
            for (int i = 0; i < copies; i++) system.addParticle(mass);
        else
            addBodies(system, integrator, shape, copies);
        positions = randomPoses(free ? Shape{"", {mass}, {Vec3()}} : shape, copies, 0, 11);
        for (int i = 0; i < system.getNumParticles(); i++)
            well->addParticle(i, {k * system.getParticleMass(i) / mass});
        system.addForce(well);
        integrator.setScheme(scheme);
        integrator.setRandomNumberSeed(1234);
        context = make_unique<Context>(system, integrator, testPlatform(),
                                       threads(testPlatformName(), 1));
        context->setPositions(positions);
        if (traitsOf(scheme).hasMomenta) context->setVelocitiesToTemperature(T1, 5);
    }
};

/** Variance of a component of the centre and of the momentum, from all bodies at `samples` times.
 */
void sampleTrap(Trap& trap, int burnIn, int apart, int samples, double mass, Estimate& x2,
                Estimate& p2) {
    trap.integrator.step(burnIn);
    MeanOverBodies ofX2, ofP2;
    for (int s = 0; s < samples; s++) {
        trap.integrator.step(apart);
        vector<Vec3> R, V;
        if (trap.integrator.getNumRigidBodies() > 0) {
            R = trap.integrator.getBodyPositions();
            V = trap.integrator.getBodyVelocities();
        } else {
            R = positionsOf(*trap.context);
            V = velocitiesOf(*trap.context);
        }
        vector<double> xs, ps;
        for (size_t i = 0; i < R.size(); i++) {
            xs.push_back(R[i].dot(R[i]) / 3);
            ps.push_back(V[i].dot(V[i]) * mass * mass / 3);
        }
        ofX2.add(xs);
        ofP2.add(ps);
    }
    x2 = ofX2.estimated();
    p2 = ofP2.estimated();
}

}  // namespace

TEST(Schemes, HarmonicWellHasItsClosedFormsAtAnyStep) {
    // At any h, with w^2 = k/m, Langevin C has the exact <x^2> = kT/k and <p^2> = m kT (1 - h^2
    // w^2/4). Langevin B has the exact <p^2> = m kT and <x^2> = kT/k/(1 - h^2 w^2/4).
    const double m = 2, k = 2, h = 1.0, w2 = k / m;
    const Shape ball{"ball", {m}, {Vec3()}};
    for (bool free : {false, true})
        for (Scheme scheme : {B, C}) {
            Trap trap(scheme, h, ball, 3000, k, free);
            trap.integrator.setFriction(1);
            Estimate x2, p2;
            sampleTrap(trap, 20, 10, 30, m, x2, p2);
            const string name =
                string(free ? "free particles " : "bodies ") + (scheme == B ? "B" : "C");
            expectMean(name + " <x^2>", x2, scheme == C ? 1 / k : 1 / k / (1 - h * h * w2 / 4));
            expectMean(name + " <p^2>", p2, scheme == B ? m : m * (1 - h * h * w2 / 4));
        }
}

TEST(Schemes, LangevinAHarmonicWellMatchesItsExactCovariance) {
    // The expected values are the stationary covariance of the linear map (m = k = kT = 1, h =
    // gamma' = 0.2 and 1), which was computed independently.
    Trap trap(A, 0.2, Shape{"ball", {1.0}, {Vec3()}}, 4000, 1.0);
    trap.integrator.setFriction(1.0);
    Estimate x2, p2;
    sampleTrap(trap, 100, 10, 80, 1.0, x2, p2);
    expectMean("A <x^2>", x2, 1.0034317880);
    expectMean("A <p^2>", p2, 0.9834306706);
}

TEST(Schemes, GradientThermostatHarmonicWellMatchesEuler) {
    // The map x <- (1 - a) x + sqrt(2 a kT/k) xi with a = h upsilon k/m has the exact <x^2> =
    // (kT/k)/(1 - a/2).
    const double m = 2, k = 3, h = 0.01, a = 0.5;
    for (bool free : {false, true}) {
        Trap trap(Gradient, h, Shape{"ball", {m}, {Vec3()}}, 3000, k, free);
        trap.integrator.setGradientRelaxationTime(a * m / (k * h));
        Estimate x2, p2;
        sampleTrap(trap, 50, 20, 30, m, x2, p2);
        expectMean("gradient <x^2>", x2, 1 / k / (1 - a / 2));
        EXPECT_EQ(trap.integrator.computeTranslationalKineticEnergy(), 0);
    }
}

TEST(Schemes, EveryNoiseLawGivesTheSameVariance) {
    for (auto law : {CustomRigidHIIntegrator::ThreePoint, CustomRigidHIIntegrator::TwoPoint}) {
        Trap trap(C, 0.5, Shape{"ball", {1.0}, {Vec3()}}, 3000, 1.0);
        trap.integrator.setNoiseLaw(law);
        Estimate x2, p2;
        sampleTrap(trap, 40, 20, 20, 1.0, x2, p2);
        expectMean("law " + to_string(law) + " <x^2>", x2, 1);
        expectMean("law " + to_string(law) + " <p^2>", p2, 1 - 0.25 / 4);
    }
}

namespace {

/** Dipoles in a field: U = -k n_z, n a body direction. A spherical top unless moments are given. */
struct Dipoles {
    System system;
    CustomRigidHIIntegrator integrator;
    unique_ptr<Context> context;
    int copies;
    Dipoles(Scheme scheme, double h, const Vec3& moments, const Vec3& direction, double k,
            int copies, const string& energy = "-charge*z")
        : integrator(T1, h), copies(copies) {
        auto* field = new CustomExternalForce(energy);
        field->addPerParticleParameter("charge");
        field->addGlobalParameter("strength", k);
        for (int i = 0; i < copies; i++) {
            for (double sign : {1.0, -1.0})
                field->addParticle(system.addParticle(1.0), {sign * k / 2});
            integrator.addRigidBody({2 * i, 2 * i + 1}, 1.0, moments, {direction, direction * -1});
        }
        system.addForce(field);
        integrator.setScheme(scheme);
        integrator.setRandomNumberSeed(77);
        context = make_unique<Context>(system, integrator, testPlatform(),
                                       threads(testPlatformName(), 1));
        mt19937 generator(8);
        vector<QuaternionArray> q;
        for (int i = 0; i < copies; i++) q.push_back(randomQuaternion(generator));
        vector<Vec3> positions;
        for (int i = 0; i < copies; i++)
            for (double sign : {1.0, -1.0}) positions.push_back(rotate(q[i], direction) * sign);
        context->setPositions(positions);
        if (traitsOf(scheme).hasMomenta) context->setVelocitiesToTemperature(T1, 5);
    }
    vector<double> cosines(const Vec3& direction) {
        vector<double> result;
        for (const auto& q : integrator.getBodyOrientations())
            result.push_back(rotate(q, direction)[2]);
        return result;
    }
};

}  // namespace

TEST(Schemes, DipolesInAFieldReachTheLangevinFunction) {
    // The exact mean is <n_z> = coth k - 1/k for any scheme, here for an asymmetric body and a
    // direction that is no principal axis.
    const double k = 2;
    Vec3 direction(0.6, 0.48, 0.64);
    for (Scheme scheme : thermostats()) {
        // Where the order is 1 a smaller step keeps the bias below the statistical error.
        const bool isCrude = traitsOf(scheme).weakOrder == 1;
        // Elsewhere it is (h w)^2/12 of the mean with w^2 = k/I, below 3e-4.
        const double h = isCrude ? 0.005 : 0.04;
        Dipoles dipoles(scheme, h, Vec3(2.5, 1.0, 1.9), direction, k, isCrude ? 500 : 1000);
        dipoles.integrator.setFriction(2);
        dipoles.integrator.setRotationalFriction(2);
        dipoles.integrator.setGradientRotationalRelaxationTime(0.5);
        dipoles.integrator.step(static_cast<int>(8 / h));
        MeanOverBodies n;
        for (int s = 0; s < (isCrude ? 30 : 80); s++) {
            dipoles.integrator.step(static_cast<int>(0.6 / h));
            n.add(dipoles.cosines(direction));
        }
        expectMean("scheme " + to_string(scheme) + " <n_z>", n.estimated(), 1 / tanh(k) - 1 / k);
    }
}

TEST(Schemes, RotationalErrorsAreOfSecondOrder) {
    // The biases of the rotational kinetic energy of strongly held dipoles at h and at h/2 have the
    // ratio 4 for order 2.
    const double k = 20;
    for (Scheme scheme : {C}) {
        double bias[2], error[2];
        for (int i = 0; i < 2; i++) {
            const double h = i == 0 ? 0.16 : 0.08;
            Dipoles dipoles(scheme, h, Vec3(1, 1, 1), Vec3(0, 0, 1), k, 4000);
            dipoles.integrator.setRotationalFriction(3);
            dipoles.integrator.step(100);
            // Samples are a third of the relaxation time of energies apart, which is I sum 1/I over
            // the friction, 1.
            MeanOverBodies energy;
            for (int s = 0; s < (i == 0 ? 110 : 300); s++) {
                dipoles.integrator.step(i == 0 ? 2 : 4);
                // Of the two axes perpendicular to the dipole; moments are 1.
                const vector<Vec3> omega = dipoles.integrator.getBodyAngularVelocities();
                const vector<QuaternionArray> q = dipoles.integrator.getBodyOrientations();
                vector<double> energies;
                for (size_t b = 0; b < q.size(); b++) {
                    const double along = omega[b].dot(rotate(q[b], Vec3(0, 0, 1)));
                    energies.push_back((omega[b].dot(omega[b]) - along * along) / 2);
                }
                energy.add(energies);
            }
            const Estimate estimated = energy.estimated();
            bias[i] = estimated.mean - 1;
            error[i] = estimated.error;
            cout << "h = " << h << ": bias " << bias[i] << " +- " << error[i] << endl;
        }
        const double ratio = bias[0] / bias[1];
        const double ratioError =
            ratio * sqrt(pow(error[0] / bias[0], 2) + pow(error[1] / bias[1], 2));
        // Terms of order 4 make about (h^2 w^2/4)^2. So 0.4 is allowed beside the statistical
        // error.
        EXPECT_NEAR(ratio, 4.0, 0.4 + 5 * ratioError) << "scheme " << scheme;
        EXPECT_LT(5 * ratioError,
                  1.5);  // so that order 1 (ratio 2) differs from order 2
    }
}

TEST(Schemes, IsotropicRotationalDiffusionOfTheGradientThermostat) {
    // Free bodies have <u_i(t) u_i(0)> = exp(-2 D t) with D = kT 4 Upsilon/M (M = 4/sum 1/I),
    // whatever the moments.
    const Vec3 moments(1, 2, 2.5);
    const double M = 4 / (1 / 1.0 + 1 / 2.0 + 1 / 2.5), Upsilon = 0.05, h = 0.01,
                 D = 4 * Upsilon / M;
    Dipoles dipoles(Gradient, h, moments, Vec3(0, 0, 1), 0, 20000);
    dipoles.integrator.setGradientRotationalRelaxationTime(Upsilon);
    const auto q0 = dipoles.integrator.getBodyOrientations();
    // The relative error of D is 1.03/sqrt(copies), as it is in twice the time.
    const int steps = 100;
    dipoles.integrator.step(steps);
    const auto q1 = dipoles.integrator.getBodyOrientations();
    for (int k = 0; k < 3; k++) {
        Vec3 axis;
        axis[k] = 1;
        vector<double> c;
        for (size_t i = 0; i < q0.size(); i++)
            c.push_back(rotate(q0[i], axis).dot(rotate(q1[i], axis)));
        // One step turns by 2 b eta, where |eta| has Maxwell's law. Then <cos> along an axis is
        // exactly 1/3 + 2/3 <cos 2 b |eta|>.
        const double variance = 8 * Upsilon * h / M;
        const double perStep = 1.0 / 3 + 2.0 / 3 * (1 - variance) * exp(-variance / 2);
        expectMean("axis " + to_string(k), estimate(c), pow(perStep, steps));
        EXPECT_NEAR(pow(perStep, steps), exp(-2 * D * steps * h), 0.01);
    }
}

TEST(Schemes, EquipartitionPerAxis) {
    for (Scheme scheme : thermostatsWithMomenta()) {
        System system;
        CustomRigidHIIntegrator integrator(300, 0.002);
        const int copies = 500;
        const Shape water = waterShape();
        addBodies(system, integrator, water, copies);
        integrator.setScheme(scheme);
        integrator.setFriction(5);
        integrator.setRotationalFriction(10);
        integrator.setRandomNumberSeed(3);
        Context context(system, integrator, testPlatform(), threads(testPlatformName(), 1));
        context.setPositions(randomPoses(water, copies, 1, 2));
        // Momenta relax at the rates gamma and Gamma/(I sum 1/I), from zero: after four times the
        // slowest relaxation time energies lack exp(-8). The slowest rate is about 1.9/ps. It
        // counts for all axes, since free rotation takes energy from one to another.
        vector<int> particles;
        double mass;
        Vec3 moments;
        vector<Vec3> sites;
        integrator.getRigidBodyParameters(0, particles, mass, moments, sites);
        const double sum = 1 / moments[0] + 1 / moments[1] + 1 / moments[2], apart = 0.36;
        const double slowest = 10 / (max({moments[0], moments[1], moments[2]}) * sum);
        integrator.step(1100);
        vector<double> translational, rotational[3];
        for (int s = 0; s < 15; s++) {
            integrator.step(static_cast<int>(apart / 0.002));
            translational.push_back(integrator.computeTranslationalKineticEnergy());
            for (int k = 0; k < 3; k++)
                rotational[k].push_back(integrator.computeRotationalKineticEnergies()[k]);
        }
        // The error is that of a chi^2 variable with copies * samples degrees of freedom for each
        // axis, of samples that are correlated.
        const double kT = boltzmann * 300, n = copies * translational.size();
        auto check = [&](const string& what, const vector<double>& energies, double axes,
                         double rate) {
            Estimate e = estimate(energies);
            expectMean("scheme " + to_string(scheme) + " " + what,
                       {e.mean / copies / axes / (kT / 2),
                        sqrt(2 / (n * axes)) * errorOfCorrelatedSquares(rate * apart)},
                       1);
        };
        check("translation", translational, 3, 5);
        for (int k = 0; k < 3; k++) check("axis " + to_string(k + 1), rotational[k], 1, slowest);
    }
}

TEST(Schemes, WithoutFrictionNoRandomNumberIsDrawnAndEnergyIsConserved) {
    double drift[2];
    for (int i = 0; i < 2; i++) {
        const double h = i == 0 ? 0.004 : 0.002;
        Trap trap(C, h, waterShape(), 50, 20.0);
        trap.integrator.setFriction(0);
        trap.integrator.setRotationalFriction(0);
        auto energy = [&] {
            const State state = trap.context->getState(State::Energy);
            return state.getPotentialEnergy() + state.getKineticEnergy();
        };
        const double start = energy();
        double worst = 0;
        for (int s = 0; s < 100; s++) {
            trap.integrator.step(i == 0 ? 20 : 40);
            worst = max(worst, abs(energy() - start));
        }
        drift[i] = worst / start;
        EXPECT_EQ(trap.integrator.getStepStatistics().at("randomNumbers"), 0);
        EXPECT_NE(trap.integrator.getEffects().at("noise").find("off"), string::npos);
    }
    EXPECT_LT(drift[0], 0.02);
    cout << "energy errors " << drift[0] << " and " << drift[1] << endl;
    EXPECT_NEAR(drift[0] / drift[1], 4.0, 0.4);  // proportional to h^2
}

TEST(Schemes, AtZeroTemperatureNoRandomNumberIsDrawn) {
    // There are 6 numbers for each body and draw, and the paper's schemes have this number of draws
    // a step.
    const map<Scheme, int> draws = {{A, 2}, {B, 2}, {C, 1}, {Gradient, 1}};
    for (Scheme scheme : thermostats()) {
        Trap trap(scheme, 0.01, waterShape(), 20, 1.0);
        trap.integrator.setTemperature(0);
        trap.integrator.step(50);
        EXPECT_EQ(trap.integrator.getStepStatistics().at("randomNumbers"), 0);
        trap.integrator.setTemperature(100);
        trap.integrator.step(1);
        const long long numbers = trap.integrator.getStepStatistics().at("randomNumbers"),
                        aDraw = 20 * 6;
        EXPECT_GT(numbers, 0) << traitsOf(scheme).name;
        EXPECT_EQ(numbers % aDraw, 0) << traitsOf(scheme).name;
        const auto known = draws.find(scheme);
        if (known != draws.end()) {
            EXPECT_EQ(numbers, known->second * aDraw) << traitsOf(scheme).name;
        }
    }
}

TEST(Schemes, TrajectoriesWithFrictionConvergeWithTheirOrder) {
    // At T = 0 only the deterministic part is left, with friction and torques. For order 1 the
    // reference has a finer step.
    for (Scheme scheme : thermostats()) {
        auto end = [&](double h) {
            Dipoles dipoles(scheme, h, Vec3(2.5, 1.0, 1.9), Vec3(0.6, 0.48, 0.64), 3.0, 8);
            dipoles.integrator.setTemperature(0);
            dipoles.integrator.setFriction(0.7);
            dipoles.integrator.setRotationalFriction(1.3);
            dipoles.integrator.setGradientRotationalRelaxationTime(0.3);
            dipoles.integrator.step(static_cast<int>(round(1.6 / h)));
            return dipoles.integrator.getBodyOrientations();
        };
        auto distance = [](const vector<QuaternionArray>& a, const vector<QuaternionArray>& b) {
            double sum = 0;
            for (size_t i = 0; i < a.size(); i++)
                for (int k = 0; k < 4; k++) sum += pow(a[i][k] - b[i][k], 2);
            return sqrt(sum);
        };
        const int order = traitsOf(scheme).coldOrder;
        const auto fine = end(order == 1 ? 0.0001 : 0.001);
        const double coarse = distance(end(0.04), fine), half = distance(end(0.02), fine);
        EXPECT_NEAR(log2(coarse / half), order, 0.15) << traitsOf(scheme).name;
    }
}

TEST(Schemes, ReferenceAndCpuTakeTheSameStep) {
    // With the same seed both platforms have the same random numbers. So after one step, noise
    // included, they differ by rounding only.
    for (Scheme scheme : thermostats()) {
        vector<Vec3> positions[2], velocities[2];
        for (int p = 0; p < 2; p++) {
            const string name = p == 0 ? "Reference" : "CPU";
            System system;
            CustomRigidHIIntegrator integrator(300, 0.002);
            vector<Vec3> start;
            int offset = 0;
            for (const Shape& shape : allShapes()) {
                addBodies(system, integrator, shape, 3);
                for (Vec3 x : randomPoses(shape, 3, 5, 1))
                    start.push_back(x + Vec3(0, 5 * offset, 0));
                offset++;
            }
            for (int i = 0; i < 5; i++) {
                system.addParticle(10);
                start.push_back(Vec3(i, -5, 0));
            }
            auto* force = new CustomExternalForce("x*y+z^2");
            for (int i = 0; i < system.getNumParticles(); i++)
                force->addParticle(i, vector<double>());
            system.addForce(force);
            integrator.setScheme(scheme);
            integrator.setRandomNumberSeed(42);
            Context context(system, integrator, platform(name), threads(name, 2));
            context.setPositions(start);
            if (traitsOf(scheme).hasMomenta) context.setVelocitiesToTemperature(300, 6);
            integrator.step(1);
            positions[p] = positionsOf(context);
            velocities[p] = velocitiesOf(context);
        }
        for (size_t i = 0; i < positions[0].size(); i++) {
            ASSERT_LT(norm(positions[0][i] - positions[1][i]), 1e-12)
                << "scheme " << scheme << " particle " << i;
            ASSERT_LT(norm(velocities[0][i] - velocities[1][i]), 1e-11)
                << "scheme " << scheme << " particle " << i;
        }
    }
}
