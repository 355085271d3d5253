// Bodies of every shape stay rigid and finite, have the right temperature about every axis, and do
// not turn about axes without inertia.

#include <openmm/CustomExternalForce.h>

#include "Sampling.h"
#include "TestSupport.h"

using namespace OpenMM;
using namespace RigidHITest;
using namespace std;

namespace {

/** The allowed deviation of a distance, in nm. At coordinates of 1000 nm members of a body cannot
 * be placed better than 1e-13. */
const double rigidity = 1e-12;

void checkShape(const Shape& shape, int copies, int steps) {
    System system;
    // Gamma is such that the slowest axis relaxes at 2/ps at least. Needles need a large Gamma,
    // because the rate is Gamma/(I sum 1/I).
    CustomRigidHIIntegrator integrator(300, 0.002);
    addBodies(system, integrator, shape, copies);
    // A force that turns bodies and pulls them back.
    auto* force =
        new CustomExternalForce("(5*(y^2+z^2)+2*sin(3*y)*z)/" + to_string(shape.sites.size()));
    for (int i = 0; i < system.getNumParticles(); i++) force->addParticle(i, vector<double>());
    system.addForce(force);
    integrator.setRandomNumberSeed(31);
    integrator.setFriction(2);
    Context context(system, integrator, testPlatform(), threads(testPlatformName(), 2));
    // The first body is aligned with the axes, the others have random orientations.
    vector<Vec3> positions = randomPoses(shape, copies, 0.01, 7);
    for (size_t s = 0; s < shape.sites.size(); s++) positions[s] = shape.sites[s];
    context.setPositions(positions);

    vector<int> particles;
    double mass;
    Vec3 moments;
    vector<Vec3> sites;
    integrator.getRigidBodyParameters(0, particles, mass, moments, sites);
    double sum = 0, largest = 0;
    for (int k = 0; k < 3; k++)
        if (moments[k] > 1e-13 * moments[2]) {
            sum += 1 / moments[k];
            largest = max(largest, moments[k]);
        }
    const double Gamma = max(10.0, 2 * largest * sum);
    integrator.setRotationalFriction(Gamma);

    // From rest; after four relaxation times energies lack exp(-8).
    const int relax = 1000, apart = 250;
    integrator.step(relax);
    const map<string, int> dof = integrator.getDegreesOfFreedom();
    vector<double> rotational[3];
    const int samples = (steps - relax) / apart;
    for (int s = 0; s < samples; s++) {
        integrator.step(apart);
        const Vec3 e = integrator.computeRotationalKineticEnergies();
        for (int k = 0; k < 3; k++) rotational[k].push_back(e[k]);
    }
    const vector<Vec3> end = positionsOf(context);
    for (const Vec3& x : end) ASSERT_TRUE(isfinite(x[0] + x[1] + x[2])) << shape.name;
    EXPECT_LT(largestDistortion(end, shape, copies), readTolerance(rigidity, 10)) << shape.name;
    const double kT = boltzmann * 300;
    for (int k = 0; k < 3; k++) {
        const int live = dof.at("rotational" + to_string(k + 1));
        if (live == 0) {
            for (double e : rotational[k]) ASSERT_EQ(e, 0.0) << shape.name;
            continue;
        }
        // The slowest axis counts for all, since free rotation takes energy from one to another.
        const double relaxations = Gamma / (largest * sum) * apart * 0.002;
        expectMean(shape.name + " axis " + to_string(k + 1),
                   {estimate(rotational[k]).mean / copies / (kT / 2),
                    errorOfCorrelatedSquares(relaxations) * sqrt(2.0 / (copies * samples))},
                   1);
    }
}

}  // namespace

TEST(Shapes, AreRigidFiniteAndThermal) {
    for (const Shape& shape : allShapes())
        checkShape(shape, shape.sites.size() > 100 ? 8 : 64, 6000);
}

TEST(Shapes, FullAThousandOrientationsAHundredThousandSteps) {
    SKIP_ON_DEVICES("millions of steps that copy positions");
    for (const Shape& shape : allShapes())
        checkShape(shape, shape.sites.size() > 100 ? 50 : 1000, 100000);
}

TEST(Shapes, ExplicitMomentsInEveryAxisOrder) {
    const double values[3] = {1e-9, 1.0, 1.0};
    for (int thin = 0; thin < 3; thin++) {
        Vec3 moments(1, 1, 1);
        moments[thin] = values[0];
        System system;
        CustomRigidHIIntegrator integrator(300, 0.002);
        const int copies = 200;
        Vec3 site;
        site[thin] = 0.3;
        for (int i = 0; i < copies; i++) {
            system.addParticle(1.0);
            system.addParticle(1.0);
            integrator.addRigidBody({2 * i, 2 * i + 1}, 2.0, moments, {site, site * -1});
        }
        integrator.setRotationalFriction(2e9);
        integrator.setRandomNumberSeed(4);
        Context context(system, integrator, testPlatform(), threads(testPlatformName(), 1));
        context.setPositions(randomPoses({"", {1, 1}, {site, site * -1}}, copies, 1, 3));
        // The thick axes relax at 2/ps, the thin one within a step. Energies lack exp(-8).
        const int samples = 14, apart = 250;
        integrator.step(1000);
        vector<double> energies[3];
        for (int s = 0; s < samples; s++) {
            integrator.step(apart);
            for (int k = 0; k < 3; k++)
                energies[k].push_back(integrator.computeRotationalKineticEnergies()[k]);
        }
        for (int k = 0; k < 3; k++) {
            const double correlated = k == 0 ? 1 : errorOfCorrelatedSquares(2 * apart * 0.002);
            expectMean("thin axis " + to_string(thin) + ", axis " + to_string(k + 1),
                       {estimate(energies[k]).mean / copies / (boltzmann * 150),
                        correlated * sqrt(2.0 / (copies * samples))},
                       1);
        }
    }
}

TEST(Shapes, SingularMomentsOfTenToTheSix) {
    // The moments are 1 : 1e6 : 1e6 and 1 : 0.9e6 : 1e6. A large step does not resolve the second
    // shape, and the user is warned.
    System system;
    CustomRigidHIIntegrator integrator(300, 0.001);
    system.addParticle(1.0);
    integrator.addRigidBody({0}, 1.0, Vec3(1e-6, 0.9, 0.9 + 1e-6), {Vec3()});
    Context context(system, integrator, testPlatform());
    context.setPositions({Vec3()});
    integrator.step(10);
    EXPECT_EQ(integrator.getEffects().at("warnings"), "off: none");
    CustomRigidHIIntegrator coarse(300, 0.2);
    System other;
    other.addParticle(1.0);
    coarse.addRigidBody({0}, 1.0, Vec3(1e-4, 0.01, 0.0101), {Vec3()});
    Context second(other, coarse, testPlatform());
    second.setPositions({Vec3()});
    EXPECT_NE(coarse.getEffects().at("warnings").find("does not resolve the rotation of 1 body"),
              string::npos);
}

TEST(Shapes, AMillionStepsThroughAContextKeepTheQuaternion) {
    System system;
    CustomRigidHIIntegrator integrator(300, 0.002);
    const Shape water = waterShape();
    addBodies(system, integrator, water, 1);
    integrator.setFriction(0);
    integrator.setRotationalFriction(0);
    Context context(system, integrator, platform("Reference"));
    context.setPositions(water.sites);
    context.setVelocitiesToTemperature(300, 1);
    integrator.setBodyVelocities({Vec3()});
    const double before = norm(integrator.computeRotationalKineticEnergies());
    integrator.step(1000000);
    const QuaternionArray q = integrator.getBodyOrientations()[0];
    EXPECT_NEAR(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3], 1, 1e-15);
    EXPECT_NEAR(norm(integrator.computeRotationalKineticEnergies()) / before, 1, 0.05);
    EXPECT_LT(largestDistortion(positionsOf(context), water, 1), rigidity);
}
