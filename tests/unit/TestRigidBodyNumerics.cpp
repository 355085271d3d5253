// Quaternions, the free rotor, body geometry, fits of poses and twists, and the step of the
// gradient thermostat.

#include <openmm/VirtualSite.h>

#include <Eigen/Dense>
#include <unsupported/Eigen/MatrixFunctions>

#include "TestSupport.h"
#include "host/BodyLoops-inl.h"
#include "rigidbody/BodyGeometry.h"
#include "rigidbody/PoseFit.h"

using namespace OpenMM;
using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace std;

using Quat = scalar::Quaternion<double>;
using Vector = scalar::Vector3<double>;

namespace {

Vector labMomentum(const Quat& q, const Vector& l) { return scalar::Rotation<double>(q).toLab(l); }

double rotationalEnergy(const Vector& l, const Vector& inverse) {
    return 0.5 * (l.x * l.x * inverse.x + l.y * l.y * inverse.y + l.z * l.z * inverse.z);
}

}  // namespace

TEST(Quaternion, BodyToLabConvention) {
    // A quarter turn about z takes the body's x axis to the lab's y axis.
    const Quat q = {sqrt(0.5), 0, 0, sqrt(0.5)};
    const Vector v = scalar::Rotation<double>(q).toLab({1, 0, 0});
    EXPECT_NEAR(v.x, 0, 1e-15);
    EXPECT_NEAR(v.y, 1, 1e-15);
    const Vector back = scalar::Rotation<double>(q).toBody(v);
    EXPECT_NEAR(back.x, 1, 1e-15);
    // Products compose: (a b) turns by b first.
    const Quat a = scalar::exponential(Vector{0.3, -0.2, 0.5}),
               b = scalar::exponential(Vector{-0.1, 0.7, 0.2});
    const Vector once = scalar::Rotation<double>(a * b).toLab({1, 2, 3});
    const Vector twice =
        scalar::Rotation<double>(a).toLab(scalar::Rotation<double>(b).toLab({1, 2, 3}));
    EXPECT_NEAR(once.x, twice.x, 1e-14);
    EXPECT_NEAR(once.y, twice.y, 1e-14);
    EXPECT_NEAR(once.z, twice.z, 1e-14);
}

TEST(FreeRotor, KeepsLabAngularMomentumAndItsErrorIsSecondOrder) {
    const Vector inverse = {1 / 1.0, 1 / 1.9, 1 / 2.9};
    auto run = [&](int steps, Quat& q, Vector& l) {
        q = {0.5, 0.5, -0.5, 0.5};
        l = {1.0, 0.4, -0.7};
        for (int i = 0; i < steps; i++) scalar::rotateFreely(q, l, inverse, 10.0 / steps);
    };
    Quat fine, q;
    Vector l, lFine;
    run(80000, fine, lFine);
    double previous = 0;
    for (int steps : {100, 200, 400}) {
        run(steps, q, l);
        const Vector L = labMomentum(q, l),
                     L0 = labMomentum({0.5, 0.5, -0.5, 0.5}, {1.0, 0.4, -0.7});
        EXPECT_NEAR(L.x, L0.x, 1e-12);
        EXPECT_NEAR(L.y, L0.y, 1e-12);
        EXPECT_NEAR(L.z, L0.z, 1e-12);
        const double error = sqrt(pow(q.w - fine.w, 2) + pow(q.x - fine.x, 2) +
                                  pow(q.y - fine.y, 2) + pow(q.z - fine.z, 2));
        if (previous > 0) {
            EXPECT_NEAR(log2(previous / error), 2.0, 0.1);
        }
        previous = error;
    }
}

TEST(FreeRotor, LinearBodyIsExactAndNeverSpinsAboutItsLine) {
    const Vector inverse = {0, 1 / 2.0, 1 / 2.0};
    Quat q = {1, 0, 0, 0};
    Vector l = {0, 3.0, -1.0};
    const double t = 1.7;
    for (int i = 0; i < 1000; i++) scalar::rotateLinearBodyFreely(q, l, inverse, t / 1000);
    const double angle = sqrt(10.0) * t / 2.0;
    EXPECT_NEAR(q.w, cos(angle / 2), 1e-12);
    EXPECT_NEAR(q.x, 0, 1e-14);
    EXPECT_EQ(l.x, 0);
    EXPECT_EQ(l.y, 3.0);
}

namespace {

void longRotor(long long steps) {
    const Vector inverse = {1 / 1.0, 1 / 1.9, 1 / 2.9};
    Quat q = {1, 0, 0, 0};
    Vector l = {1.0, 0.4, -0.7};
    const double energy = rotationalEnergy(l, inverse);
    const double length = sqrt(scalar::dot(l, l));
    double worstEnergy = 0;
    for (long long i = 0; i < steps; i++) {
        scalar::rotateFreely(q, l, inverse, 0.05);
        scalar::renormalise(q);
        if (i % 1000 == 0)
            worstEnergy = max(worstEnergy, abs(rotationalEnergy(l, inverse) / energy - 1));
    }
    EXPECT_NEAR(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z, 1, 1e-15);
    // |l| performs a random walk of rounding errors, about 1e-16 sqrt(10 steps). The test allows
    // five times this value.
    EXPECT_NEAR(sqrt(scalar::dot(l, l)) / length, 1, 5e-16 * sqrt(10.0 * steps));
    EXPECT_LT(worstEnergy, 1e-3);  // bounded, since the map is symplectic; error (0.05)^2
}

}  // namespace

TEST(FreeRotor, QuaternionAndEnergyStayOverAMillionSteps) { longRotor(1000000); }
TEST(FreeRotor, FullQuaternionAndEnergyStayOverAHundredMillionSteps) { longRotor(100000000); }

TEST(BodyGeometry, WaterFromItsConstraints) {
    System system;
    for (double mass : {15.9994, 1.008, 1.008, 0.0}) system.addParticle(mass);
    system.addConstraint(0, 1, 0.09572);
    system.addConstraint(0, 2, 0.09572);
    system.addConstraint(1, 2, 0.15139006545);
    system.setVirtualSite(3, new ThreeParticleAverageSite(0, 1, 2, 0.7866, 0.1067, 0.1067));
    const vector<int> particles = {0, 1, 2, 3};
    const BodyGeometryBuilder builder(system, ConstraintsOfParticles(system), particles, "body 0");
    ASSERT_FALSE(builder.needsPositions());
    const BodyGeometry g = builder.build({});
    EXPECT_NEAR(g.mass, 18.0154, 1e-12);
    EXPECT_LT(g.moments[0], g.moments[1]);
    EXPECT_NEAR(g.moments[0] + g.moments[1], g.moments[2], 1e-15);  // planar
    Vec3 centre;
    const double masses[3] = {15.9994, 1.008, 1.008};
    for (int i = 0; i < 3; i++) centre += g.sites[i] * masses[i];
    EXPECT_NEAR(norm(centre), 0, 1e-15);
    EXPECT_NEAR(norm(g.sites[1] - g.sites[0]), 0.09572, 1e-16);
    EXPECT_NEAR(norm(g.sites[2] - g.sites[1]), 0.15139006545, 1e-16);
    const Vec3 m = g.sites[0] * 0.7866 + g.sites[1] * 0.1067 + g.sites[2] * 0.1067;
    EXPECT_NEAR(norm(g.sites[3] - m), 0, 1e-16);
    // Products of inertia vanish.
    double product = 0;
    for (int i = 0; i < 3; i++) product += masses[i] * g.sites[i][0] * g.sites[i][1];
    EXPECT_NEAR(product, 0, 1e-15);
}

TEST(BodyGeometry, VirtualSitesMayDependOnOthers) {
    // OpenMM allows this from version 8.2 on. This test needs only the System, so it runs with any
    // version.
    System system;
    for (double mass : {3.0, 1.0, 0.0, 0.0}) system.addParticle(mass);
    system.addConstraint(0, 1, 0.4);
    system.setVirtualSite(
        2, new TwoParticleAverageSite(3, 1, 0.5, 0.5));  // the first site needs the second one
    system.setVirtualSite(3, new TwoParticleAverageSite(0, 1, 0.25, 0.75));
    const vector<int> particles = {0, 1, 2, 3};
    const BodyGeometryBuilder builder(system, ConstraintsOfParticles(system), particles, "body 0");
    const BodyGeometry g = builder.build({});
    EXPECT_NEAR(norm(g.sites[3] - g.sites[0]), 0.3, 1e-15);
    EXPECT_NEAR(norm(g.sites[2] - g.sites[0]), 0.35, 1e-15);
    EXPECT_NEAR(norm(g.sites[2] - g.sites[1]), 0.05, 1e-15);
}

TEST(BodyGeometry, LocalCoordinatesSitesMayHaveTwoParents) {
    // Lone pairs on a line have no y axis, so that only the coordinate along x counts.
    System system;
    for (double mass : {3.0, 1.0, 0.0}) system.addParticle(mass);
    system.addConstraint(0, 1, 0.4);
    system.setVirtualSite(
        2, new LocalCoordinatesSite({0, 1}, {1, 0}, {1, -1}, {0, 0}, Vec3(0.1, 0, 0)));
    const vector<int> particles = {0, 1, 2};
    const BodyGeometryBuilder builder(system, ConstraintsOfParticles(system), particles, "body 0");
    const BodyGeometry g = builder.build({});
    EXPECT_NEAR(norm(g.sites[2] - g.sites[0]), 0.1, 1e-15);
    EXPECT_NEAR(norm(g.sites[2] - g.sites[1]), 0.5, 1e-15);
}

TEST(BodyGeometry, AllPairsOfAChiralBodyKeepItsHandedness) {
    const Shape shape{"chiral",
                      {12, 1, 19, 35, 80},
                      {Vec3(), Vec3(0.1, 0.02, 0), Vec3(-0.03, 0.13, 0), Vec3(-0.05, -0.06, 0.17),
                       Vec3(0, -0.1, -0.19)}};
    for (double mirror : {1.0, -1.0}) {
        System system;
        vector<int> particles;
        vector<Vec3> positions;
        for (int i = 0; i < 5; i++) {
            particles.push_back(system.addParticle(shape.masses[i]));
            const Vec3 s = shape.sites[i];
            positions.push_back(Vec3(s[0], s[1], mirror * s[2]) +
                                Vec3(1e-5 * i, 0, 1));  // slightly off
        }
        for (int i = 0; i < 5; i++)
            for (int j = 0; j < i; j++)
                system.addConstraint(i, j, norm(shape.sites[i] - shape.sites[j]));
        const BodyGeometryBuilder builder(system, ConstraintsOfParticles(system), particles,
                                          "body 0");
        ASSERT_TRUE(builder.needsPositions());
        const BodyGeometry g = builder.build(positions);
        for (int i = 0; i < 5; i++)
            for (int j = 0; j < i; j++)
                EXPECT_NEAR(norm(g.sites[i] - g.sites[j]), norm(shape.sites[i] - shape.sites[j]),
                            1e-14);
        auto volume = [](const vector<Vec3>& x) {
            return (x[1] - x[0]).cross(x[2] - x[0]).dot(x[3] - x[0]);
        };
        EXPECT_GT(volume(g.sites) * volume(positions), 0);
    }
}

TEST(PoseFit, RecoversPosesOfEveryShape) {
    mt19937 generator(3);
    normal_distribution<double> normal;
    for (const Shape& shape : allShapes()) {
        System system;
        vector<int> particles;
        for (double m : shape.masses) particles.push_back(system.addParticle(m));
        const BodyGeometry g =
            BodyGeometryBuilder(system, ConstraintsOfParticles(system), particles, "body 0")
                .build(shape.sites);
        const PoseFit fit(g, shape.masses, vector<bool>(particles.size(), false));
        for (int trial = 0; trial < 200; trial++) {
            const QuaternionArray q = randomQuaternion(generator);
            const Vec3 R(normal(generator), normal(generator), normal(generator));
            vector<Vec3> positions, velocities;
            const Vec3 velocity(normal(generator), normal(generator), normal(generator)),
                omega(normal(generator), normal(generator), normal(generator));
            for (const Vec3& s : g.sites) {
                positions.push_back(R + rotate(q, s));
                velocities.push_back(velocity + omega.cross(rotate(q, s)));
            }
            BodyState state;
            int worst = -1;
            EXPECT_LT(fit.fitPose(positions, state, worst), 2e-14) << shape.name;
            Vec3 v, w(0.1, 0.2, 0.3);
            fit.fitTwist(velocities, state, v, w);
            EXPECT_LT(norm(v - velocity), 1e-13) << shape.name;
            for (size_t i = 0; i < g.sites.size(); i++)
                EXPECT_LT(norm(v + w.cross(positions[i] - state.R) - velocities[i]), 1e-12)
                    << shape.name;
        }
    }
}

TEST(PoseFit, TakesTheSmallestTurnWhereARotationIsOpen) {
    // Turning a line from x to y must not spin it about itself.
    const BodyGeometry g = {2, Vec3(0, 1, 1), {Vec3(-1, 0, 0), Vec3(1, 0, 0)}};
    const PoseFit fit(g, {1, 1}, {false, false});
    BodyState state;
    int worst;
    fit.fitPose({Vec3(0, -1, 0), Vec3(0, 1, 0)}, state, worst);
    EXPECT_NEAR(norm(rotate(state.q, Vec3(0, 0, 1)) - Vec3(0, 0, 1)), 0, 1e-14);
    // The turn to the opposite direction may be about any perpendicular axis, but must be a proper
    // rotation.
    fit.fitPose({Vec3(0, 1, 0), Vec3(0, -1, 0)}, state, worst);
    EXPECT_NEAR(norm(rotate(state.q, Vec3(1, 0, 0)) - Vec3(0, -1, 0)), 0, 1e-14);
    // Nearly opposite: the axis is known to rounding over the angle that is left to half a turn.
    for (double left = 1e-2; left > 1e-13; left /= 10) {
        const Vec3 before = rotate(state.q, Vec3(1, 0, 0)), across = rotate(state.q, Vec3(0, 0, 1)),
                   now = across * sin(left) - before * cos(left);
        fit.fitPose({-now, now}, state, worst);
        EXPECT_LT(norm(rotate(state.q, Vec3(1, 0, 0)) - now), left > 5e-7 ? 1e-15 / left : 1e-14)
            << left;
    }
    // A body of one site keeps its orientation.
    const PoseFit point({1, Vec3(), {Vec3()}}, {1}, {false});
    const QuaternionArray before = state.q;
    point.fitPose({Vec3(5, 0, 0)}, state, worst);
    EXPECT_EQ(before, state.q);
    // A body of one site also keeps its spin, which one velocity does not determine.
    Vec3 v, w(1, 2, 3);
    point.fitTwist({Vec3(1, 0, 0)}, state, v, w);
    EXPECT_NEAR(norm(w - Vec3(1, 2, 3)), 0, 1e-14);
}

TEST(PoseFit, SitesOnASkewLineAreALine) {
    // Rounding must not turn collinear sites into a body in space, whose third direction nothing
    // fixes.
    mt19937 generator(3);
    uniform_real_distribution<double> u(-1, 1);
    for (int trial = 0; trial < 2000; trial++) {
        const Vec3 direction(u(generator), u(generator), u(generator)),
            origin(u(generator), u(generator), u(generator));
        vector<Vec3> sites;
        vector<double> masses;
        for (int i = 0; i < 2 + trial % 3; i++) {
            sites.push_back(origin + direction * u(generator));
            masses.push_back(trial % 2 ? 1 : pow(10, 3 * u(generator)));
        }
        const PoseFit fit({1, Vec3(1, 1, 1), sites}, masses, vector<bool>(sites.size(), false));
        const QuaternionArray q = randomQuaternion(generator);
        vector<Vec3> positions;
        for (const Vec3& site : sites) positions.push_back(rotate(q, site));
        BodyState state;
        state.q = q;
        int worst;
        ASSERT_LT(fit.fitPose(positions, state, worst), 1e-13) << trial;
        // An orientation that fits is kept, including the angle about the line.
        for (int k = 0; k < 4; k++) ASSERT_NEAR(state.q[k], q[k], 1e-7) << trial;
        Vec3 v, omega(1, 2, 3);
        fit.fitTwist(positions, state, v, omega);
        ASSERT_LT(norm(omega), 1e3) << trial;
    }
}

TEST(PoseFit, AMasslessMarkerFixesTheOrientationOfASphere) {
    const BodyGeometry g = {10, Vec3(1, 1, 1), {Vec3(), Vec3(0.5, 0, 0)}};
    const PoseFit fit(g, {10, 0}, {false, false});
    BodyState state;
    int worst;
    EXPECT_LT(fit.fitPose({Vec3(1, 1, 1), Vec3(1, 1.5, 1)}, state, worst), 1e-14);
    EXPECT_NEAR(norm(rotate(state.q, Vec3(1, 0, 0)) - Vec3(0, 1, 0)), 0, 1e-14);
}

TEST(BodySet, UserFrameIsKeptWhateverTheOrderOfMoments) {
    mt19937 generator(9);
    const double moments[3] = {1, 2, 2.5};
    int order[3] = {0, 1, 2};
    do {
        const Vec3 I(moments[order[0]], moments[order[1]], moments[order[2]]);
        BodySet bodies({{5, I, {Vec3(0.1, 0.2, 0.3)}}}, {{0}}, {{}}, {{true}});
        BodyState state;
        state.q = randomQuaternion(generator);
        state.R = Vec3(1, 2, 3);
        state.p = Vec3(4, 5, 6);
        state.l = Vec3(7, 8, 9);
        bodies.setState(0, state);
        const BodyState back = bodies.getState(0);
        EXPECT_EQ(state.l, back.l);
        for (int k = 0; k < 4; k++) EXPECT_NEAR(state.q[k], back.q[k], 1e-15);
        // The angular velocity in the lab frame is A diag(1/I) l.
        const Vec3 omega = rotate(state.q, Vec3(7 / I[0], 8 / I[1], 9 / I[2]));
        EXPECT_NEAR(norm(bodies.getAngularVelocity_lab(0) - omega), 0, 1e-13);
        // Kinetic energies are in the order of ascending moments.
        const Vec3 energies = bodies.rotationalKineticEnergies();
        for (int k = 0; k < 3; k++)
            EXPECT_NEAR(energies[order[k]], 0.5 * state.l[k] * state.l[k] / I[k], 1e-13);
        // The site is at its place in the user's body frame.
        double x[3], copy[3];
        scalar::BodyFlow<double>(bodies, StepSettings(), 0).scatterPositions(x, copy);
        EXPECT_NEAR(norm(Vec3(x[0], x[1], x[2]) - state.R - rotate(state.q, Vec3(0.1, 0.2, 0.3))),
                    0, 1e-14);
    } while (next_permutation(order, order + 3));
}

TEST(BodySet, AStateThatIsSetAsItWasReadKeepsTheLastBits) {
    mt19937 generator(10);
    const double moments[3] = {1, 2, 2.5};
    int order[3] = {0, 1, 2};
    do {
        const Vec3 I(moments[order[0]], moments[order[1]], moments[order[2]]);
        BodySet bodies({{5, I, {Vec3()}}}, {{0}}, {{}}, {{true}});
        for (int trial = 0; trial < 20; trial++) {
            BodyState state;
            state.q = randomQuaternion(generator);
            state.l = Vec3(7, 8, 9);
            bodies.setState(0, state);
            const auto stored = bodies.getStoredState(0);
            bodies.setState(0, bodies.getState(0));
            EXPECT_EQ(bodies.getStoredState(0), stored) << trial;
        }
    } while (next_permutation(order, order + 3));
}

TEST(BodySet, ASnapshotOfOneOrAllBodiesIsRestored) {
    // 256 bodies are as many as need room between the columns.
    for (int n : {1, 9, 256}) {
        const vector<BodyGeometry> geometries(n, {5, Vec3(1, 2, 2.5), {Vec3()}});
        BodySet bodies(geometries, vector<vector<int>>(n, {0}), vector<vector<double>>(n),
                       vector<vector<bool>>(n, {true}));
        const auto setAll = [&](double shift) {
            for (int b = 0; b < n; b++) {
                array<double, 13> numbers;
                for (int k = 0; k < 13; k++) numbers[k] = shift + 13 * b + k;
                bodies.setStoredState(b, numbers);
                bodies.addForceAndTorque_lab(b, Vec3(shift, b, 1), Vec3(b, 2, shift));
            }
        };
        const auto all = [&] {
            vector<vector<double>> found;
            for (int b = 0; b < n; b++) {
                const auto stored = bodies.getStoredState(b);
                found.emplace_back(stored.begin(), stored.end());
                const int s = bodies.slot(b);
                for (int k = 0; k < 3; k++) {
                    found[b].push_back(bodies.force_lab[k][s]);
                    found[b].push_back(bodies.torque[k][s]);
                }
            }
            return found;
        };
        setAll(1);
        const auto first = all();
        BodySet::Snapshot snapshot;
        bodies.save(snapshot);
        setAll(1e6);
        const auto second = all();
        bodies.restore(snapshot, n / 2);
        auto mixed = second;
        mixed[n / 2] = first[n / 2];
        EXPECT_EQ(all(), mixed) << n;
        bodies.restore(snapshot);
        EXPECT_EQ(all(), first) << n;
        bodies.saveForces(snapshot);
        setAll(1e6);
        auto withForces = all();
        for (int b = 0; b < n; b++)
            copy(first[b].begin() + 13, first[b].end(), withForces[b].begin() + 13);
        bodies.restoreForces(snapshot);
        EXPECT_EQ(all(), withForces) << n;
        for (int b = 0; b < n; b++) EXPECT_EQ(bodies.inverseMass[bodies.slot(b)], 0.2);
    }
}

TEST(BodySet, TorquesAreInTheFrameOfTheScheme) {
    const vector<BodyGeometry> geometries(2, {5, Vec3(1, 2, 2.5), {Vec3()}});
    BodySet bodies(geometries, vector<vector<int>>(2, {0}), vector<vector<double>>(2),
                   vector<vector<bool>>(2, {true}));
    const auto turn = [&](double angle) {
        for (int b = 0; b < 2; b++) {
            BodyState state = bodies.getState(b);
            state.q = {cos(angle), 0, 0, sin(angle)};
            bodies.setState(b, state);
        }
    };
    const Vec3 first(1, 2, 3), second(-2, 0.5, 1);
    const auto expectTorque = [&](const Vec3& torque) {
        for (int b = 0; b < 2; b++) {
            const Vec3 error = bodies.getTorque_lab(b) - (b + 1) * torque;
            EXPECT_LT(sqrt(error.dot(error)), 1e-14) << b;
        }
    };
    const auto add = [&](const Vec3& torque) {
        for (int b = 0; b < 2; b++) bodies.addForceAndTorque_lab(b, Vec3(), (b + 1) * torque);
    };
    turn(0.4);
    add(first);
    expectTorque(first);
    bodies.keepTorquesInLab(true);
    expectTorque(first);
    turn(1.1);  // the torque stays
    expectTorque(first);
    add(second);
    expectTorque(first + second);
    // Bodies that take these states, because others are held, take the frame as well.
    BodySet others(geometries, vector<vector<int>>(2, {0}), vector<vector<double>>(2),
                   vector<vector<bool>>(2, {true}), {true, false});
    others.takeStates(bodies);
    swap(bodies, others);
    expectTorque(first + second);
    bodies.keepTorquesInLab(true);
    expectTorque(first + second);
    bodies.keepTorquesInLab(false);
    expectTorque(first + second);
    turn(1.1 + M_PI / 4);  // the torque turns with the body, a quarter turn about z
    const Vec3 sum = first + second;
    expectTorque(Vec3(-sum[1], sum[0], sum[2]));
}

TEST(GradientThermostat, TwoQuaternionProductsAreTheMatrixExponentialOfThePaper) {
    // Davidchack 2015, eqs. 28-30: Q <- exp(Y) Q with Y = a (F Q^T - Q F^T) + b sum_l eta_l S_l, F
    // = 2 S(Q)(0, tau).
    Eigen::Matrix4d S[3];
    S[0] << 0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 0, 1, 0, 0, -1, 0;
    S[1] << 0, 0, -1, 0, 0, 0, 0, -1, 1, 0, 0, 0, 0, 1, 0, 0;
    S[2] << 0, 0, 0, -1, 0, 0, 1, 0, 0, -1, 0, 0, 1, 0, 0, 0;
    mt19937 generator(4);
    normal_distribution<double> normal;
    for (double scale : {1e-9, 1e-3, 1.0, 5.0})
        for (int trial = 0; trial < 50; trial++) {
            const QuaternionArray q0 = randomQuaternion(generator);
            const Eigen::Vector4d q(q0[0], q0[1], q0[2], q0[3]);
            const Eigen::Vector3d tau(normal(generator), normal(generator), normal(generator)),
                eta(normal(generator), normal(generator), normal(generator));
            const double a = 0.7 * scale, b = 0.4 * scale;
            Eigen::Vector4d F = Eigen::Vector4d::Zero();
            Eigen::Matrix4d Y = Eigen::Matrix4d::Zero();
            for (int l = 0; l < 3; l++) {
                F += 2 * tau[l] * (S[l] * q);
                Y += b * eta[l] * S[l];
            }
            Y += a * (F * q.transpose() - q * F.transpose());
            const Eigen::Vector4d expected = Y.exp() * q;

            const Quat Q = {q0[0], q0[1], q0[2], q0[3]};
            const Vector turn_body = {a * tau[0], a * tau[1], a * tau[2]};
            const Vector turn_lab = scalar::Rotation<double>(Q).toLab(turn_body);
            const Vector noise = {b * eta[0], b * eta[1], b * eta[2]};
            const Quat result =
                scalar::exponential(turn_lab) * Q * scalar::exponential(turn_body + noise);
            EXPECT_NEAR(result.w, expected[0], 1e-13);
            EXPECT_NEAR(result.x, expected[1], 1e-13);
            EXPECT_NEAR(result.y, expected[2], 1e-13);
            EXPECT_NEAR(result.z, expected[3], 1e-13);
        }
}
