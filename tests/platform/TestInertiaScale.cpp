// setInertiaScale() multiplies moments of inertia by a factor in the dynamics of schemes with
// momenta. Equipartition and averages over configurations do not depend on the factor. Trajectories
// are those of bodies with the scaled moments. Users see the angular velocities of these
// trajectories.

#include <openmm/CMMotionRemover.h>
#include <openmm/CustomExternalForce.h>
#include <openmm/HarmonicBondForce.h>
#include <openmm/MonteCarloBarostat.h>
#include <openmm/VirtualSite.h>

#include <sstream>

#include "HydrodynamicSupport.h"
#include "openmmrigidhi/SchemeTraits.h"

using namespace OpenMM;
using namespace RigidHITest;
using RigidHIPlugin::schemeTable;
using RigidHIPlugin::SchemeTraits;
using namespace std;

namespace {

using Scheme = CustomRigidHIIntegrator::Scheme;

/** A scheme with momenta, in each of the ways in which it may be computed. */
struct Way {
    string name;
    Scheme scheme;
    bool hasFluid;
    MobilityForce::Model model;
    MobilityForce::Solver solver;
};

vector<Way> waysWithMomenta() {
    const auto free = MobilityForce::FreeDraining, rpy = MobilityForce::RotnePragerYamakawa;
    vector<Way> ways;
    for (const SchemeTraits& traits : schemeTable) {
        if (!traits.hasMomenta) continue;
        const string name = traits.name;
        if (!traits.needsFluid()) {
            ways.push_back({name, traits.scheme, false, rpy, MobilityForce::Auto});
            continue;
        }
        ways.push_back(
            {name + ", constant tensors", traits.scheme, true, free, MobilityForce::Auto});
        ways.push_back({name + ", dense", traits.scheme, true, rpy, MobilityForce::Dense});
        ways.push_back(
            {name + ", matrix-free", traits.scheme, true, rpy, MobilityForce::MatrixFree});
    }
    return ways;
}

/** Bodies that turn about three axes and about two, and a free particle, in a field that turns and
 * pulls them. kT = 1. */
struct Mixture : FluidScene {
    Mixture(const Way& way, double inertiaScale, double factorOfMoments = 1)
        : FluidScene(1 / boltzmann, 0.02) {
        mt19937 random(5);
        vector<BodyKind> kinds = {
            boomerangKind(),
            {"sphere", 2, Vec3(0.5, 0.3, 0.4), {Vec3(), Vec3(0.1, 0.15, 0.7)}, {0.6, 0}},
            rodKind()};
        for (size_t i = 0; i < kinds.size(); i++) {
            kinds[i].moments *= factorOfMoments;
            add(kinds[i], Vec3(2.7 * i, 0.2 * i, 0), randomQuaternion(random));
        }
        addFree(3.0, way.hasFluid ? 0.3 : 0, Vec3(0, 4, 0));
        fluid->setModel(way.model);
        fluid->setSolver(way.solver);
        if (!way.hasFluid) removeFluid();
        auto* field = new CustomExternalForce("0.3*x^2+0.2*y^2+0.5*z^2+0.4*x*y+sin(z)");
        for (int i = 0; i < system.getNumParticles(); i++) field->addParticle(i, vector<double>());
        system.addForce(field);
        integrator.setScheme(way.scheme);
        integrator.setInertiaScale(inertiaScale);
        start(testPlatform());
        context->setVelocitiesToTemperature(1 / boltzmann, 7);
    }
    vector<Vec3> spins() const { return integrator.getBodyAngularVelocities(); }
};

/**
 * Waters of four particles, with the charge of oxygen on a virtual site, that feel only a uniform
 * field along z. The dipole times the field is k kT, so the exact mean cosine is the Langevin
 * function coth k - 1/k.
 */
struct Waters {
    System system;
    CustomRigidHIIntegrator integrator;
    unique_ptr<Context> context;
    const int copies;
    vector<Vec3> positions;
    static constexpr double temperature = 300;

    Waters(Scheme scheme, double h, double inertiaScale, double k, int copies)
        : integrator(temperature, h), copies(copies) {
        const Shape water = waterShape();
        const Vec3 sum = water.sites[1] + water.sites[2];
        const double side = 0.1067, length = norm(sum) * (1 - 2 * side);  // of H1 + H2 - 2 M
        auto* field = new CustomExternalForce("-strength*charge*z");
        field->addPerParticleParameter("charge");
        field->addGlobalParameter("strength", k * boltzmann * temperature / length);
        mt19937 generator(2);
        for (int i = 0; i < copies; i++) {
            const int p = system.getNumParticles();
            for (double mass : water.masses) system.addParticle(mass);
            system.addParticle(0);
            for (int a = 0; a < 3; a++)
                for (int b = 0; b < a; b++)
                    system.addConstraint(p + a, p + b, norm(water.sites[a] - water.sites[b]));
            system.setVirtualSite(
                p + 3, new ThreeParticleAverageSite(p, p + 1, p + 2, 1 - 2 * side, side, side));
            field->addParticle(p + 1, {1.0});
            field->addParticle(p + 2, {1.0});
            field->addParticle(p + 3, {-2.0});
            const QuaternionArray q = randomQuaternion(generator);
            for (const Vec3& s : water.sites)
                positions.push_back(Vec3(0.3 * i, 0, 0) + rotate(q, s));
            positions.push_back(positions[p] * (1 - 2 * side) +
                                (positions[p + 1] + positions[p + 2]) * side);
            integrator.addRigidBody({p, p + 1, p + 2, p + 3});
        }
        system.addForce(field);
        integrator.setScheme(scheme);
        integrator.setInertiaScale(inertiaScale);
        integrator.setRandomNumberSeed(31);
    }
    void start() {
        context = make_unique<Context>(system, integrator, testPlatform(),
                                       threads(testPlatformName(), 1));
        context->setPositions(positions);
        context->setVelocitiesToTemperature(temperature, 3);
    }
    /** cos of the dipoles' angles to the field. */
    void appendCosines(vector<double>& to) const {
        const auto x = positionsOf(*context);
        for (int i = 0; i < copies; i++) {
            const Vec3 dipole = x[4 * i + 1] + x[4 * i + 2] - x[4 * i + 3] * 2;
            to.push_back(dipole[2] / norm(dipole));
        }
    }
};

/** Sums of kinetic energies over samples, in units of kT/2 for each degree of freedom. */
struct Energies {
    double translation = 0, rotation[3] = {0, 0, 0};
    int samples = 0;
    void add(const CustomRigidHIIntegrator& integrator) {
        translation += integrator.computeTranslationalKineticEnergy();
        for (int k = 0; k < 3; k++) rotation[k] += integrator.computeRotationalKineticEnergies()[k];
        samples++;
    }
    /** @param removed  degrees of translation that a CMMotionRemover takes */
    void expectEquipartition(const string& what, int copies, const vector<bool>& isLive, double kT,
                             int removed = 0) const {
        // The relative error is that of a chi^2 variable with this number of degrees of freedom.
        const auto check = [&](const string& which, double sum, double degrees) {
            expectMean(what + ", " + which, {sum / degrees / (kT / 2), sqrt(2 / degrees)}, 1);
        };
        check("translation", translation, double(samples) * (3 * copies - removed));
        for (int k = 0; k < 3; k++) {
            if (isLive[k])
                check("axis " + to_string(k + 1), rotation[k], double(samples) * copies);
            else
                EXPECT_EQ(rotation[k], 0) << what;
        }
    }
};

/**
 * Schemes and factors whose statistics are sampled. Devices have fewer of them, because a launch
 * takes a tenth of a millisecond there, and because the loops over bodies are those of CPU.
 */
vector<Scheme> schemesToSample() {
    return onDevice() ? vector<Scheme>{CustomRigidHIIntegrator::LangevinC}
                      : thermostatsWithMomenta();
}
vector<double> factorsToSample() {
    return onDevice() ? vector<double>{4} : vector<double>{1, 4, 16};
}

double langevinFunction(double k) { return 1 / tanh(k) - 1 / k; }

}  // namespace

TEST(InertiaScale, MotionIsThatOfBodiesWithThoseMoments) {
    // The factor is a power of 2, so that rounding is the same.
    for (const Way& way : waysWithMomenta()) {
        Mixture scaled(way, 4), heavy(way, 1, 4), plain(way, 1);
        for (int part = 0; part < 3; part++) {
            EXPECT_EQ(scaled.state(), heavy.state()) << way.name;
            EXPECT_TRUE(sameBits(scaled.spins(), heavy.spins())) << way.name;
            EXPECT_TRUE(sameBits({scaled.integrator.computeRotationalKineticEnergies()},
                                 {heavy.integrator.computeRotationalKineticEnergies()}))
                << way.name;
            for (Mixture* scene : {&scaled, &heavy, &plain}) scene->integrator.step(4);
        }
        EXPECT_GT((scaled.state() - plain.state()).norm(), 0.1) << way.name;
    }
}

TEST(InertiaScale, SchemesWithoutMomentaTakeNoNotice) {
    for (const SchemeTraits& traits : schemeTable) {
        if (traits.hasMomenta) continue;
        const Way way = {traits.name, traits.scheme, traits.needsFluid(),
                         MobilityForce::RotnePragerYamakawa, MobilityForce::Auto};
        vector<VectorXd> ends;
        for (double factor : {1.0, 7.0}) {
            Mixture scene(way, factor);
            scene.integrator.step(5);
            ends.push_back(scene.state());
            const string effect = scene.integrator.getEffects().at("inertia scale");
            EXPECT_NE(
                effect.find(
                    factor == 1
                        ? "off: the dynamics has the real principal moments"
                        : "off: the scheme has no momenta, so that the factor 7 has no effect"),
                string::npos)
                << effect;
        }
        EXPECT_EQ(ends[0], ends[1]) << traits.name;
    }
}

TEST(InertiaScale, EquipartitionPerAxis) {
    const int copies = 100;
    const Shape co2{"CO2", {16.0, 12.0, 16.0}, {Vec3(0, 0, -0.116), Vec3(), Vec3(0, 0, 0.116)}};
    for (Scheme scheme : schemesToSample())
        for (const Shape& shape : {waterShape(), co2})
            for (double factor : factorsToSample()) {
                System system;
                CustomRigidHIIntegrator integrator(300, 0.002);
                addBodies(system, integrator, shape, copies);
                integrator.setScheme(scheme);
                integrator.setInertiaScale(factor);
                integrator.setFriction(20);
                integrator.setRotationalFriction(50);
                integrator.setRandomNumberSeed(3);
                Context context(system, integrator, testPlatform(), threads(testPlatformName(), 1));
                context.setPositions(randomPoses(shape, copies, 1, 2));
                // The slowest axis relaxes at about a fifth of Gamma, 0.1 ps, whatever the factor.
                // After ten times that, squares of momenta are independent within exp(-6).
                integrator.step(500);
                Energies energies;
                for (int s = 0; s < 8; s++) {
                    integrator.step(150);
                    energies.add(integrator);
                }
                energies.expectEquipartition(string(RigidHIPlugin::traitsOf(scheme).name) + ", " +
                                                 shape.name + ", factor " + to_string(factor),
                                             copies, {shape.name == "water", true, true},
                                             boltzmann * 300);
            }
}

TEST(InertiaScale, EquipartitionInAFluid) {
    // The friction is that of the fluid, so angular momenta relax more slowly by the factor. The
    // slowest of them relaxes at a rate of about 10/factor, translation at a rate of about 4.
    // Samples are 1.2 sqrt(factor) apart, so that squares of momenta are independent within
    // exp(-5).
    const int copies = 100;
    for (double factor : factorsToSample()) {
        FluidScene scene(1 / boltzmann, 0.02);
        mt19937 random(2);
        const BodyKind kinds[] = {boomerangKind(), rodKind()};
        for (int i = 0; i < copies; i++)
            scene.add(kinds[i % 2], Vec3(5.0 * (i % 10), 5.0 * (i / 10), 0),
                      randomQuaternion(random));
        scene.fluid->setModel(MobilityForce::FreeDraining);
        scene.integrator.setInertiaScale(factor);
        scene.start(testPlatform());
        scene.context->setVelocitiesToTemperature(1 / boltzmann, 7);
        Energies energies;
        for (int s = 0; s < 16; s++) {
            scene.integrator.step(static_cast<int>(60 * sqrt(factor)));
            energies.add(scene.integrator);
        }
        const double halfKT = 0.5, n = 16.0 * copies;
        expectMean("translation", {energies.translation / (3 * n) / halfKT, sqrt(2 / (3 * n))}, 1);
        for (int k = 0; k < 3; k++) {
            const double bodies = k == 0 ? n / 2 : n;  // rods do not turn about their line
            expectMean("axis " + to_string(k + 1),
                       {energies.rotation[k] / bodies / halfKT, sqrt(2 / bodies)}, 1);
        }
    }
}

TEST(InertiaScale, AveragesOverConfigurationsStay) {
    const double k = 2;
    const int copies = 60;
    for (Scheme scheme : schemesToSample())
        for (double factor : factorsToSample()) {
            if (factor == 1) continue;  // TestSchemes
            // Steps grow as the square root of the factor. Directions decorrelate in at most 1.5
            // ps, a third of the distance of samples. (If the friction were divided by the root
            // too, every factor would have the same path.) A CMMotionRemover makes the integrator
            // take in all velocities at every step.
            Waters waters(scheme, 0.0015 * sqrt(factor), factor, k, copies);
            waters.integrator.setRotationalFriction(20);
            waters.integrator.setRandomNumberSeed(31 + static_cast<int>(factor));
            const bool remover = factor == 4;
            if (remover) waters.system.addForce(new CMMotionRemover());
            waters.start();
            waters.integrator.step(1500);
            vector<double> cosines;
            Energies energies;
            for (int s = 0; s < 12; s++) {
                waters.integrator.step(800);
                waters.appendCosines(cosines);
                energies.add(waters.integrator);
            }
            const string what =
                string(RigidHIPlugin::traitsOf(scheme).name) + ", factor " + to_string(factor);
            expectMean(what + ", <cos>", estimate(cosines), langevinFunction(k));
            energies.expectEquipartition(what, copies, {true, true, true}, boltzmann * 300,
                                         remover ? 3 : 0);
        }
}

TEST(InertiaScale, AveragesUnderABarostatStay) {
    // Bodies do not interact. An ideal gas of N bodies has <V> = (N + 1) kT/P.
    const int copies = 20;
    const double k = 2, kT = boltzmann * 300, V = 27, bar = 0.0602214076;  // kJ/mol/nm^3
    Waters waters(CustomRigidHIIntegrator::LangevinC, 0.004, 8, k, copies);
    waters.system.setDefaultPeriodicBoxVectors(Vec3(3, 0, 0), Vec3(0, 3, 0), Vec3(0, 0, 3));
    auto* barostat = new MonteCarloBarostat((copies + 1) * kT / V / bar, 300, 1);
    barostat->setRandomNumberSeed(5);
    auto* nothing = new HarmonicBondForce();
    nothing->setUsesPeriodicBoundaryConditions(true);  // a barostat needs a Force that uses the box
    waters.system.addForce(nothing);
    waters.system.addForce(barostat);
    waters.start();
    waters.integrator.setFriction(5);
    waters.integrator.setRotationalFriction(5);
    waters.integrator.step(2000);
    // Blocks of 200 steps: volumes decorrelate in a dozen attempts, directions within half a
    // picosecond.
    vector<double> volumes, cosines;
    Energies energies;
    for (int block = 0; block < 80; block++) {
        double volume = 0;
        for (int i = 0; i < 20; i++) {
            waters.integrator.step(10);
            volume += waters.context->getState(0).getPeriodicBoxVolume() / 20;
        }
        volumes.push_back(volume);
        waters.appendCosines(cosines);
        energies.add(waters.integrator);
    }
    expectMean("volume", estimate(volumes), V);
    expectMean("<cos>", estimate(cosines), langevinFunction(k));
    energies.expectEquipartition("barostat", copies, {true, true, true}, kT);
}

TEST(InertiaScale, EnergyIsConservedToSecondOrder) {
    const double k = 20;
    double errors[2];
    for (int i = 0; i < 2; i++) {
        Waters waters(CustomRigidHIIntegrator::LangevinC, i == 0 ? 0.008 : 0.004, 8, k, 30);
        waters.start();
        waters.integrator.setFriction(0);
        waters.integrator.setRotationalFriction(0);
        const auto energy = [&] {
            const State state = waters.context->getState(State::Energy);
            return state.getPotentialEnergy() + state.getKineticEnergy();
        };
        const double start = energy();
        double worst = 0;
        for (int s = 0; s < 200; s++) {
            waters.integrator.step(i == 0 ? 5 : 10);
            worst = max(worst, abs(energy() - start));
        }
        errors[i] = worst / (30 * k * boltzmann * 300);
    }
    cout << "energy errors, in the energy of the dipoles: " << errors[0] << " and " << errors[1]
         << endl;
    EXPECT_LT(errors[0], 0.02);
    EXPECT_NEAR(errors[0] / errors[1], 4.0, 0.4);
}

TEST(InertiaScale, UsersSeeRealAngularVelocities) {
    for (bool isExplicit : {false, true}) {
        // Explicit bodies have a marker without mass here, so that their velocities are fitted in
        // another way.
        System system;
        CustomRigidHIIntegrator integrator(0, 0.001);
        const Shape water = waterShape();
        vector<Vec3> positions = randomPoses(water, 1, 0, 4);
        if (isExplicit) {
            for (double mass : water.masses) system.addParticle(mass);
            integrator.addRigidBody({0, 1, 2}, 20, Vec3(0.2, 0.1, 0.15), water.sites);
            positions = water.sites;
        } else
            addBodies(system, integrator, water, 1);
        system.addParticle(4.0);
        positions.push_back(Vec3(3, 0, 0));
        integrator.setFriction(0);
        integrator.setRotationalFriction(0);
        integrator.setInertiaScale(5);
        Context context(system, integrator, testPlatform());
        context.setPositions(positions);
        const Vec3 omega(1.5, -2, 0.7), velocity(0.3, 0.1, -0.4);
        const double close = readTolerance(1e-12, 3);
        const auto expectTwist = [&](const string& when) {
            EXPECT_LT(norm(integrator.getBodyAngularVelocities()[0] - omega), close) << when;
            EXPECT_LT(norm(integrator.getBodyVelocities()[0] - velocity), close) << when;
            const auto v = velocitiesOf(context), x = positionsOf(context);
            const Vec3 R = integrator.getBodyPositions()[0];
            for (int i = 0; i < 3; i++)
                EXPECT_LT(norm(v[i] - velocity - omega.cross(x[i] - R)), close) << when;
        };
        const auto rotational = [&] {
            const Vec3 e = integrator.computeRotationalKineticEnergies();
            return e[0] + e[1] + e[2];
        };
        const auto rotationalOf = [&](double factor) {
            vector<int> particles;
            double mass;
            Vec3 moments, sum;
            vector<Vec3> sites;
            integrator.getRigidBodyParameters(0, particles, mass, moments, sites);
            QuaternionArray q = integrator.getBodyOrientations()[0];
            for (int k = 1; k < 4; k++) q[k] = -q[k];
            const Vec3 omega_body = rotate(q, omega);
            for (int k = 0; k < 3; k++)
                sum[k] = 0.5 * factor * moments[k] * omega_body[k] * omega_body[k];
            return sum[0] + sum[1] + sum[2];
        };
        integrator.setBodyVelocities({velocity});
        integrator.setBodyAngularVelocities({omega});
        expectTwist("set on the body");
        EXPECT_NEAR(rotational(), rotationalOf(5), close);
        // Velocities of particles define the same twist.
        vector<Vec3> rigid = velocitiesOf(context);
        context.setVelocities(vector<Vec3>(4));
        EXPECT_EQ(rotational(), 0);
        rigid[3] = Vec3(0.1, 0, 0);
        context.setVelocities(rigid);
        expectTwist("set on the particles");
        EXPECT_NEAR(rotational(), rotationalOf(5), close);
        EXPECT_NEAR(context.getState(State::Energy).getKineticEnergy(),
                    rotational() + integrator.computeTranslationalKineticEnergy() + 0.5 * 4 * 0.01,
                    close);
        // A change of the factor takes effect at once. Velocities stay, and only energies of
        // rotation change.
        const double translational = integrator.computeTranslationalKineticEnergy();
        integrator.setInertiaScale(0.5);
        EXPECT_NEAR(rotational(), rotationalOf(0.5), close);
        expectTwist("after a change");
        EXPECT_EQ(integrator.computeTranslationalKineticEnergy(), translational);
        EXPECT_NEAR(integrator.computeFreeParticleKineticEnergy(), 0.5 * 4 * 0.01, close);
        integrator.setInertiaScale(1);
        EXPECT_NEAR(rotational(), rotationalOf(1), close);
    }
}

TEST(InertiaScale, MayChangeBetweenSteps) {
    // After a change of the factor, a Context continues like one that has had the new factor from
    // its start, and was given the same poses and velocities.
    for (const Way& way : waysWithMomenta()) {
        Mixture changed(way, 1), fresh(way, 4);
        changed.integrator.step(3);
        stringstream checkpoint, xml;
        saveState(*changed.context, checkpoint, xml);
        changed.integrator.setInertiaScale(4);
        const auto spins = changed.spins();
        changed.integrator.step(4);
        for (bool fromCheckpoint : {true, false}) {
            if (fromCheckpoint)
                fresh.context->loadCheckpoint(checkpoint);
            else
                loadState(*fresh.context, xml);
            for (size_t b = 0; b < spins.size(); b++)
                EXPECT_LT(norm(fresh.spins()[b] - spins[b]), readTolerance(1e-12, 3)) << way.name;
            fresh.integrator.step(4);
            EXPECT_EQ(fresh.state(), changed.state()) << way.name;
        }
    }
}

TEST(InertiaScale, ARunGoesOnBitForBit) {
    // The factor is no power of 2. The angular momenta of the scaled moments are saved, with their
    // factor.
    for (const Way& way : waysWithMomenta()) {
        SCOPED_TRACE(way.name);
        expectToResumeBitForBit<Mixture>([&](int) { return make_unique<Mixture>(way, 3.3); },
                                         [](Mixture& scene) {
                                             scene.integrator.step(3);
                                             scene.integrator.setInertiaScale(2.7);
                                             scene.integrator.step(2);
                                             scene.integrator.setInertiaScale(3.3);
                                         },
                                         4);
    }
}

TEST(InertiaScale, SchemesMayAlternate) {
    // A scheme without momenta has nothing to scale. The velocities are kept meanwhile, and return
    // with the factor.
    const auto C = CustomRigidHIIntegrator::LangevinC,
               none = CustomRigidHIIntegrator::GradientThermostat;
    Mixture scene({"", C, false, MobilityForce::FreeDraining, MobilityForce::Auto}, 4);
    scene.integrator.step(2);
    const auto spins = scene.spins();
    const Vec3 energies = scene.integrator.computeRotationalKineticEnergies();
    scene.integrator.setScheme(none);
    EXPECT_TRUE(sameBits(scene.spins(), spins));
    EXPECT_EQ(norm(scene.integrator.computeRotationalKineticEnergies()), 0);
    scene.integrator.setScheme(C);
    EXPECT_TRUE(sameBits(scene.spins(), spins));
    EXPECT_TRUE(sameBits({scene.integrator.computeRotationalKineticEnergies()}, {energies}));
}

TEST(InertiaScale, IsDescribed) {
    Mixture scene({"", CustomRigidHIIntegrator::LangevinB, false, MobilityForce::FreeDraining,
                   MobilityForce::Auto},
                  1);
    EXPECT_EQ(scene.integrator.getEffects().at("inertia scale"),
              "off: the dynamics has the real principal moments");
    const auto degrees = scene.integrator.getDegreesOfFreedom();
    scene.integrator.setInertiaScale(2.5);
    const string effect = scene.integrator.getEffects().at("inertia scale");
    EXPECT_EQ(effect.find("on: the dynamics has the principal moments times 2.5"), 0u) << effect;
    EXPECT_NE(effect.find("motion is not the real one"), string::npos);
    EXPECT_EQ(scene.integrator.getDegreesOfFreedom(), degrees);
    // A step that does not resolve rotation resolves it with larger moments, and the warning then
    // disappears at once.
    scene.integrator.setInertiaScale(1e-4);
    EXPECT_NE(scene.integrator.getEffects().at("warnings").find("does not resolve the rotation"),
              string::npos);
    scene.integrator.setInertiaScale(100);
    EXPECT_EQ(scene.integrator.getEffects().at("warnings"), "off: none");
}
