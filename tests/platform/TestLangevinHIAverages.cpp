// The scheme LangevinHI: averages in equilibrium compared with closed forms, bodies among free
// particles and virtual sites, replicas, many bodies, and the matrix-free solver. Units have kT = 1
// unless said otherwise.

#include <openmm/VirtualSite.h>

#include <cstring>
#include <map>

#include "LangevinHISupport.h"

using namespace OpenMM;
using namespace RigidHITest;
using namespace std;

// ---- Equilibrium ----

namespace {

/** Replicas of a scene, each in a group of its own. Traps hold the origins, and fields act on the
 * markers. */
struct Replicas {
    FluidScene scene;
    CustomExternalForce* trap = new CustomExternalForce("0.5*k*((x-x0)^2+y^2+z^2)");
    CustomExternalForce* field = new CustomExternalForce("-charge*z");
    vector<int> groups;
    Replicas(double temperature, double h) : scene(temperature, h) {
        trap->addPerParticleParameter("k");
        trap->addPerParticleParameter("x0");
        field->addPerParticleParameter("charge");
        scene.system.addForce(trap);
        scene.system.addForce(field);
    }
    /** A body whose last three sites must be its origin and a pair of opposite markers. */
    void add(const BodyKind& kind, int group, double x0, double k, double charge,
             const QuaternionArray& q) {
        scene.add(kind, Vec3(x0, 0, 0), q);
        const vector<int>& p = scene.particles.back();
        const int n = p.size();
        trap->addParticle(p[n - 3], {k, x0});
        field->addParticle(p[n - 2], {charge});
        field->addParticle(p[n - 1], {-charge});
        groups.push_back(group);
    }
    void start() {
        scene.fluid->setGroups(groups);
        scene.start(testPlatform());
        scene.context->setVelocitiesToTemperature(scene.integrator.getTemperature(), 3);
    }
};

/** The boomerang with an origin and two markers along a direction that is no principal axis. */
const Vec3 markerDirection(0.6, 0.48, 0.64);
BodyKind heldBoomerang() {
    BodyKind kind = boomerangKind();
    kind.sites.insert(kind.sites.end(), {Vec3(), markerDirection, markerDirection * -1});
    kind.radii.insert(kind.radii.end(), {0, 0, 0});
    return kind;
}
BodyKind heldSphere(double radius, double mass, const Vec3& moments) {
    return {"held sphere",
            mass,
            moments,
            {Vec3(), Vec3(), markerDirection, markerDirection * -1},
            {radius, 0, 0, 0}};
}

/** The mean and its error from the means of replicas, which are independent of each other. */
struct ByReplica {
    vector<double> sums;
    int count = 0;
    void add(const vector<double>& values) {
        sums.resize(values.size());
        for (size_t i = 0; i < values.size(); i++) sums[i] += values[i];
        count++;
    }
    Estimate result() const {
        vector<double> means;
        for (double s : sums) means.push_back(s / count);
        return estimate(means);
    }
};

}  // namespace

TEST(LangevinHIAverages, EquilibriumUnderStrongCouplingOfTranslationAndRotation) {
    // A boomerang whose centre of mass is far from the middle of its blobs, alone and with a
    // neighbour in the same group. The trap, the field and the moments determine its distribution,
    // not the friction.
    const double k = 3, charge = 1, h = 0.04;
    for (bool neighbour : {false, true}) {
        Replicas replicas(T1, h);
        replicas.scene.fluid->setViscosity(0.2);
        mt19937 random(7);
        const int copies = neighbour ? 60 : 200;
        for (int i = 0; i < copies; i++) {
            replicas.add(heldBoomerang(), i, 5 * i, k, charge, randomQuaternion(random));
            if (neighbour)
                replicas.add(heldSphere(0.8, 2, Vec3(0.5, 0.9, 0.7)), i, 5 * i + 2, k, charge,
                             randomQuaternion(random));
        }
        replicas.start();
        replicas.scene.integrator.step(400);
        const int perCopy = neighbour ? 2 : 1;
        map<string, ByReplica> sums;
        map<string, double> expected;
        const int samples = neighbour ? 60 : 80;
        for (int s = 0; s < samples; s++) {
            replicas.scene.integrator.step(20);
            const Snapshot now(replicas.scene);
            map<string, vector<double>> values;
            for (size_t b = 0; b < now.R.size(); b++) {
                const BodyKind& kind = replicas.scene.bodies[b];
                const string body = b % perCopy == 0 ? "boomerang " : "sphere ";
                const Vec3 x = now.R[b] - Vec3(5.0 * (b / perCopy) + 2.0 * (b % perCopy), 0, 0);
                const Vector3d omega = rotationOf(now.q[b]).transpose() * toEigen(now.omega[b]);
                const string axes = "xyz";
                for (int c = 0; c < 3; c++) {
                    values[body + "k " + axes[c] + "^2"].push_back(k * x[c] * x[c]);
                    expected[body + "k " + axes[c] + "^2"] = 1;
                    values[body + "I omega^2 of " + axes[c]].push_back(kind.moments[c] * omega[c] *
                                                                       omega[c]);
                    values[body + "m v^2 of " + axes[c]].push_back(kind.mass * now.V[b][c] *
                                                                   now.V[b][c]);
                    // As in Langevin C the kinetic energy has a bias of -h^2 w^2/4, which is below
                    // 2e-3 here.
                    expected[body + "I omega^2 of " + axes[c]] = 1;
                    expected[body + "m v^2 of " + axes[c]] = 1 - h * h * k / kind.mass / 4;
                    values[body + "x v of " + axes[c]].push_back(x[c] * now.V[b][c]);
                    expected[body + "x v of " + axes[c]] = 0;
                }
                values[body + "n_z"].push_back(rotate(now.q[b], markerDirection)[2]);
                expected[body + "n_z"] = 1 / tanh(2 * charge) - 1 / (2 * charge);
                values[body + "omega_x v_y"].push_back(omega[0] * now.V[b][1]);
                expected[body + "omega_x v_y"] = 0;
            }
            if (neighbour)
                for (int c = 0; c < 3; c++)
                    for (size_t b = 0; b < now.R.size(); b += 2) {
                        const Vec3 home(5.0 * (b / 2), 0, 0);
                        values["x1 x2 of " + to_string(c)].push_back(
                            (now.R[b] - home)[c] * (now.R[b + 1] - home - Vec3(2, 0, 0))[c]);
                        values["v1 v2 of " + to_string(c)].push_back(now.V[b][c] * now.V[b + 1][c]);
                        expected["x1 x2 of " + to_string(c)] =
                            expected["v1 v2 of " + to_string(c)] = 0;
                    }
            for (const auto& value : values) sums[value.first].add(value.second);
        }
        for (const auto& sum : sums)
            expectMean(sum.first, sum.second.result(), expected.at(sum.first));
    }
}

TEST(LangevinHIAverages, StaticCovariancesOfTwoTrappedSpheres) {
    // Spheres that touch and overlap under RPY: friction varies strongly, but the Gibbs
    // distribution does not depend on it.
    const double k = 2, h = 0.1;
    Replicas replicas(T1, h);
    mt19937 random(3);
    for (int i = 0; i < 120; i++)
        for (int b = 0; b < 2; b++)
            replicas.add(heldSphere(0.5, 1, Vec3(0.1, 0.1, 0.1)), i, b, k, 0,
                         randomQuaternion(random));
    replicas.start();
    replicas.scene.integrator.step(100);
    ByReplica xx[3], cross[3], vv[3];
    for (int s = 0; s < 60; s++) {
        replicas.scene.integrator.step(15);
        const Snapshot now(replicas.scene);
        for (int c = 0; c < 3; c++) {
            vector<double> a, b, v;
            for (size_t i = 0; i < now.R.size(); i += 2) {
                const Vec3 x1 = now.R[i], x2 = now.R[i + 1] - Vec3(1, 0, 0);
                a.push_back(k * (x1[c] * x1[c] + x2[c] * x2[c]) / 2);
                b.push_back(k * x1[c] * x2[c]);
                v.push_back(now.V[i][c] * now.V[i + 1][c]);
            }
            xx[c].add(a);
            cross[c].add(b);
            vv[c].add(v);
        }
    }
    for (int c = 0; c < 3; c++) {
        expectMean("k x^2/kT", xx[c].result(), 1);
        expectMean("k x1 x2/kT", cross[c].result(), 0);
        expectMean("v1 v2", vv[c].result(), 0);
    }
}

TEST(LangevinHIAverages, DiffusionIsTheTemperatureTimesMobility) {
    // The mean square displacement of the mobility centre, where coupling is symmetric, is linear
    // in time once inertia is forgotten: 2 kT tr mu_tt t (Cichocki, Ekiel-Jezewska, Wajnryb, J.
    // Chem. Phys. 136, 071102, 2012).
    FluidScene scene(T1, 0.01);
    scene.fluid->setModel(MobilityForce::FreeDraining);
    const int copies = 1500;
    mt19937 random(1);
    BodyKind light = boomerangKind();
    light.mass = 1;
    light.moments *= 0.3;
    for (int i = 0; i < copies; i++) scene.add(light, Vec3(), randomQuaternion(random));
    scene.start(testPlatform());
    LabBody home;
    for (size_t i = 0; i < light.sites.size(); i++) {
        home.offsets.push_back(toEigen(light.sites[i]));
        home.radii.push_back(light.radii[i]);
    }
    const auto mobilityAbout = [&](const Vector3d& point) {
        LabBody moved = home;
        for (Vector3d& x : moved.offsets) x -= point;
        return IndependentMobility({moved}, 0.6).mobility;
    };
    // The antisymmetric part of mu_rt is linear in the point, which gives three equations.
    const auto antisymmetric = [&](const Vector3d& point) {
        const Matrix3d b = mobilityAbout(point).bottomLeftCorner(3, 3);
        return Vector3d(b(1, 2) - b(2, 1), b(2, 0) - b(0, 2), b(0, 1) - b(1, 0));
    };
    const Vector3d zero = antisymmetric(Vector3d::Zero());
    Matrix3d slope;
    for (int k = 0; k < 3; k++) slope.col(k) = antisymmetric(Vector3d::Unit(k)) - zero;
    const Vector3d centre = -slope.inverse() * zero;
    ASSERT_LT(antisymmetric(centre).norm(), 1e-12);
    const double expected = 2 * mobilityAbout(centre).topLeftCorner(3, 3).trace();

    const auto centres = [&] {
        const auto R = scene.integrator.getBodyPositions();
        const auto q = scene.integrator.getBodyOrientations();
        vector<Vec3> result;
        for (int i = 0; i < copies; i++) result.push_back(R[i] + rotate(q[i], toVec3(centre)));
        return result;
    };
    const auto start = centres();
    scene.integrator.step(100);
    const auto early = centres();
    scene.integrator.step(500);
    const auto late = centres();
    vector<double> slopes;
    for (int i = 0; i < copies; i++) {
        const Vec3 a = early[i] - start[i], b = late[i] - start[i];
        slopes.push_back((b.dot(b) - a.dot(a)) / 5.0);
    }
    expectMean("d<r^2>/dt", estimate(slopes), expected);
}

TEST(LangevinHIAverages, TemperatureAtAnyFriction) {
    for (double frictionOverMass : {1e-6, 1.0, 1e6}) {
        FluidScene scene(T1, 0.01);
        const int pairs = 60;
        const double mass = 6 * M_PI * 0.6 * 0.5 / frictionOverMass;
        vector<int> groups;
        for (int i = 0; i < pairs; i++)
            for (int b = 0; b < 2; b++) {
                scene.add(markedSphere(0.5, mass, Vec3(0.2, 0.2, 0.2) * mass),
                          Vec3(3 * i + 1.2 * b, 0, 0));
                groups.push_back(i);
            }
        scene.fluid->setGroups(groups);
        scene.start(testPlatform());
        scene.context->setVelocitiesToTemperature(T1, 2);
        const double start = scene.integrator.computeTranslationalKineticEnergy();
        vector<double> translational, rotational[3];
        scene.integrator.step(10);
        for (int s = 0; s < 40; s++) {
            scene.integrator.step(3);
            translational.push_back(scene.integrator.computeTranslationalKineticEnergy());
            for (int k = 0; k < 3; k++)
                rotational[k].push_back(scene.integrator.computeRotationalKineticEnergies()[k]);
        }
        const double bodies = 2 * pairs;
        if (frictionOverMass < 1e-3) {
            // 130 steps of 0.01 at this friction change the energy by less than 2e-6, and noise by
            // less than the root of that.
            for (double e : translational) ASSERT_NEAR(e / start, 1, 0.01);
            continue;
        }
        // With strong friction every sample is independent. With a friction of 1/ps the relaxation
        // time is 100 steps.
        const double independent = frictionOverMass > 1e3 ? 40 : 1;
        expectMean(
            "translation at " + to_string(frictionOverMass),
            {estimate(translational).mean / (1.5 * bodies), sqrt(2 / (3 * bodies * independent))},
            1);
        for (int k = 0; k < 3; k++)
            expectMean(
                "axis " + to_string(k),
                {estimate(rotational[k]).mean / (0.5 * bodies), sqrt(2 / (bodies * independent))},
                1);
    }
}

TEST(LangevinHIAverages, WeakFrictionKeepsEnergy) {
    // At T = 0 and friction/mass 1e-6 a free flight loses 2 gamma t of its energy. Rounding adds no
    // loss.
    const double mass = 6 * M_PI * 0.6 * 0.5 * 1e6;
    FluidScene scene(0, 0.01);
    for (int b = 0; b < 2; b++) scene.add(sphereKind(0.5, mass, 0.1 * mass), Vec3(1.2 * b, 0, 0));
    scene.start(testPlatform());
    VectorXd twists = VectorXd::Zero(12);
    twists[1] = twists[7] = 1e-3;  // together, so that they keep their distance
    setTwists(scene, twists);
    const double start = scene.integrator.computeTranslationalKineticEnergy();
    scene.integrator.step(2000);
    VectorXd together = VectorXd::Zero(12);
    together[1] = together[7] = 1 / sqrt(2.0);
    const double drag = together.dot(scene.expected().friction * together);
    EXPECT_NEAR(
        log(scene.integrator.computeTranslationalKineticEnergy() / start) / (-2 * drag / mass * 20),
        1, 1e-5);
}

// ---- Company ----

TEST(LangevinHIAverages, FreeParticlesThatTheFluidDoesNotSeeFeelLangevinC) {
    // The free particles are beside bodies that feel each other, and beside free particles that the
    // fluid sees.
    FluidScene hydrodynamic(T1, 0.02), plain(T1, 0.02);
    for (FluidScene* scene : {&hydrodynamic, &plain}) {
        for (int b = 0; b < 2; b++) scene->add(sphereKind(0.5), Vec3(2 * b, 0, 0));
        scene->addFree(1, 0.3, Vec3(0, 3, 0));
        for (int i = 0; i < 3; i++) scene->addFree(2, 0, Vec3(i, 5, 0));
        // A molecule with a constraint.
        for (int i = 0; i < 2; i++) scene->addFree(2, 0, Vec3(0.5 * i, 7, 0));
        scene->system.addConstraint(scene->freeParticles[4], scene->freeParticles[5], 0.5);
        scene->integrator.setFriction(3);
        addField(scene->system, "x^2+y^2+z^2");
    }
    plain.removeFluid();
    plain.integrator.setScheme(CustomRigidHIIntegrator::LangevinC);
    vector<vector<Vec3>> x;
    for (FluidScene* scene : {&hydrodynamic, &plain}) {
        scene->start(testPlatform());
        scene->integrator.step(30);
        x.push_back(positionsOf(*scene->context));
    }
    for (size_t i = 1; i < hydrodynamic.freeParticles.size(); i++) {
        const int p = hydrodynamic.freeParticles[i];
        // The host moves the first scene, and a device the second one: positions are rounded for
        // forces in two ways, and two solvers hold the constraint.
        EXPECT_LT(norm(x[0][p] - x[1][p]), onDevice() ? 1e-6 : 1e-12) << p;
    }
    EXPECT_GT(norm(x[0][hydrodynamic.freeParticles[0]] - x[1][hydrodynamic.freeParticles[0]]),
              1e-3);
}

TEST(LangevinHIAverages, FreeParticlesBelongToGroupZero) {
    vector<Snapshot> ends;
    for (const vector<int>& groups : {vector<int>(), vector<int>{0}, vector<int>{1}}) {
        FluidScene scene(T1, 0.02);
        scene.add(boomerangKind(), Vec3(-2, 0, 0));
        scene.addFree(1.5, 0.5, Vec3());
        scene.addFree(1.5, 0.4, Vec3(1.1, 0.2, 0));
        scene.fluid->setGroups(groups);
        addField(scene.system, "z+0.3*x*y");
        scene.start(testPlatform());
        scene.integrator.step(20);
        ends.emplace_back(scene);
    }
    ends[0].expectSameBits(ends[1], "group 0 is where free particles are");
    EXPECT_GT(norm(ends[0].x[5] - ends[2].x[5]), 1e-4);
}

TEST(LangevinHIAverages, VirtualSitesFollowTheirBodies) {
    System system;
    CustomRigidHIIntegrator integrator(300, 0.002);
    auto* fluid = new MobilityForce();
    vector<Vec3> positions;
    const Shape water = waterShape();
    for (int b = 0; b < 3; b++) {
        vector<int> particles;
        for (int i = 0; i < 3; i++) {
            particles.push_back(system.addParticle(water.masses[i]));
            positions.push_back(water.sites[i] + Vec3(0.4 * b, 0, 0));
            fluid->addParticle(i == 0 ? 0 : 0.05);
        }
        particles.push_back(system.addParticle(0));
        system.setVirtualSite(
            particles[3],
            new ThreeParticleAverageSite(particles[0], particles[1], particles[2], 0.6, 0.2, 0.2));
        positions.push_back(Vec3());
        fluid->addParticle(0.14);
        integrator.addRigidBody(particles);
    }
    system.addForce(fluid);
    addField(system, "x^2+y^2+z^2");
    integrator.setScheme(CustomRigidHIIntegrator::LangevinHI);
    Context context(system, integrator, testPlatform());
    context.setPositions(positions);
    context.computeVirtualSites();
    integrator.step(100);
    const auto x = positionsOf(context);
    for (int b = 0; b < 3; b++) {
        const Vec3* p = &x[4 * b];
        EXPECT_LT(norm(p[3] - p[0] * 0.6 - p[1] * 0.2 - p[2] * 0.2), readTolerance(1e-12, 1));
        EXPECT_NEAR(norm(p[1] - p[0]), 0.09572, readTolerance(1e-12, 1));
    }
}

TEST(LangevinHIAverages, ReplicasDoNotFeelEachOther) {
    // The motion of a replica depends, bit for bit, neither on where the others are nor on how many
    // there are.
    const auto run = [](double apart, int replicas, int threadCount) {
        FluidScene scene(T1, 0.02);
        vector<int> groups;
        mt19937 random(2);
        for (int r = 0; r < replicas; r++) {
            scene.add(boomerangKind(), Vec3(r * apart, 0, 0), {{1, 0, 0, 0}});
            scene.add(sphereKind(0.5), Vec3(r * apart + 2.5, 0, 0));
            groups.insert(groups.end(), {r, r});
        }
        scene.fluid->setGroups(groups);
        scene.start(testPlatform(), threadCount);
        scene.integrator.step(15);
        return Snapshot(scene);
    };
    const Snapshot alone = run(0, 1, 1);
    for (const Snapshot& other : {run(0.3, 2, 1), run(1e4, 2, 1), run(3, 5, 2)})
        for (int b = 0; b < 2; b++) {
            EXPECT_EQ(memcmp(&alone.R[b], &other.R[b], sizeof(Vec3)), 0);
            EXPECT_EQ(memcmp(&alone.omega[b], &other.omega[b], sizeof(Vec3)), 0);
            EXPECT_EQ(alone.q[b], other.q[b]);
        }
}

TEST(LangevinHIAverages, MatrixFreeIsDenseToFiveTimesTheTolerance) {
    // One step from the same state is compared, in the norm of mass-weighted momenta.
    double worst = 0;
    for (bool multiblobs : {false, true})
        for (double h : {1e-4, 0.03, 3.0})
            for (double temperature : {0.0, T1})
                for (double tolerance : {1e-3, 1e-6, 1e-9}) {
                    VectorXd Z[2];
                    for (bool matrixFree : {false, true}) {
                        FluidScene scene(temperature, h);
                        mt19937 random(5);
                        for (int b = 0; b < 12; b++) {
                            const Vec3 place(1.1 * (b % 3), 1.2 * (b / 3 % 2), 1.3 * (b / 6));
                            const BodyKind kind = !multiblobs  ? markedSphere(0.3 + 0.03 * b, 1 + b,
                                                                              Vec3(0.2, 0.3, 0.4))
                                                  : b % 3 == 0 ? boomerangKind()
                                                  : b % 3 == 1 ? rodKind()
                                                               : sphereKind(0.4);
                            scene.add(kind, place * (multiblobs ? 2.5 : 1),
                                      randomQuaternion(random));
                        }
                        scene.addFree(1.5, 0.4, Vec3(-1, -1, -1));
                        scene.fluid->setSolver(matrixFree ? MobilityForce::MatrixFree
                                                          : MobilityForce::Dense);
                        scene.fluid->setSolverTolerance(tolerance);
                        scene.start(testPlatform());
                        // Momenta are small, so that the rotation in the step has no visible
                        // effect.
                        VectorXd twists(72);
                        normal_distribution<double> normal(0, 1e-3);
                        for (double& x : twists) x = normal(random);
                        setTwists(scene, twists, {Vec3(1e-3, 0, 2e-3)});
                        scene.integrator.setTemperature(1e-6 * temperature);
                        scene.integrator.step(1);
                        const VectorXd end = twistsOf(scene);
                        const auto q = scene.integrator.getBodyOrientations();
                        Z[matrixFree] = end;
                        for (int b = 0; b < 12; b++) {
                            const BodyKind& kind = scene.bodies[b];
                            Z[matrixFree].segment<3>(6 * b) *= sqrt(kind.mass);
                            const Vector3d omega =
                                rotationOf(q[b]).transpose() * end.segment<3>(6 * b + 3);
                            for (int k = 0; k < 3; k++)
                                Z[matrixFree][6 * b + 3 + k] = sqrt(kind.moments[k]) * omega[k];
                        }
                        Z[matrixFree].tail<3>() *= sqrt(1.5);
                        EXPECT_EQ(counter(scene, "solverIterations") > 0, matrixFree);
                    }
                    // Where only decayed momenta are left, the error is relative to the norm of the
                    // start.
                    const double scale = max(Z[0].norm(), temperature == 0 ? 5e-3 : 0.0);
                    const double error = (Z[1] - Z[0]).norm() / scale / tolerance;
                    EXPECT_LT(error, 5) << "h = " << h << ", kT = " << temperature << ", tolerance "
                                        << tolerance << (multiblobs ? ", multiblobs" : ", spheres");
                    worst = max(worst, error);
                }
    cout << "largest difference, in tolerances: " << worst << endl;
}

TEST(LangevinHIAverages, OneHundredBodies) {
    FluidScene scene(T1, 0.01);
    for (int b = 0; b < 100; b++) scene.add(sphereKind(0.4), Vec3(b % 5, b / 5 % 5, b / 25));
    scene.start(testPlatform(), 2);
    scene.context->setVelocitiesToTemperature(T1, 3);
    scene.integrator.step(3);
    EXPECT_TRUE(isfinite(scene.integrator.computeTranslationalKineticEnergy()));
    EXPECT_EQ(counter(scene, "randomNumbers"), 1800);
}

TEST(LangevinHIAverages, FullFiveHundredBodies) {
    if (!onCpu()) GTEST_SKIP() << "3000 rows: on CPU only";
    FluidScene scene(T1, 0.01);
    for (int b = 0; b < 500; b++) scene.add(sphereKind(0.4), Vec3(b % 8, b / 8 % 8, b / 64));
    scene.start(testPlatform(), 2);
    scene.context->setVelocitiesToTemperature(T1, 3);
    scene.integrator.step(3);
    // The temperature is within 5 standard deviations of a mean over 1500 components.
    EXPECT_NEAR(scene.integrator.computeTranslationalKineticEnergy() / 750, 1,
                5 * sqrt(2.0 / 1500));
}
