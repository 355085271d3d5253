// Changes that users and other Forces make to a Context, and the integrator's reaction to them.
// TestCMMotionRemover.cpp tests CMMotionRemover.

#include <openmm/CustomExternalForce.h>
#include <openmm/HarmonicAngleForce.h>
#include <openmm/HarmonicBondForce.h>
#include <openmm/LocalEnergyMinimizer.h>
#include <openmm/MonteCarloBarostat.h>
#include <openmm/VerletIntegrator.h>

#include <ctime>
#include <numeric>

#include "WaterBoxSupport.h"
#include "openmmrigidhi/CustomBodyForce.h"
#include "openmmrigidhi/MobilityForce.h"
#include "openmmrigidhi/SchemeTraits.h"

using namespace OpenMM;
using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace std;

TEST(VirtualSites, ForcesOnThemAreCountedOnce) {
    // The force and torque on a body are minus the derivatives of the energy, which are found by
    // moving bodies.
    WaterBox box(2);
    box.start();
    box.integrator.setTemperature(0);
    box.integrator.step(1);
    const auto R = box.integrator.getBodyPositions();
    const auto q = box.integrator.getBodyOrientations();
    const auto forces = box.integrator.getBodyForces(), torques = box.integrator.getBodyTorques();
    auto energy = [&] { return box.context->getState(State::Energy).getPotentialEnergy(); };
    // CPU evaluates pairs in single precision, so there the displacement is large and the tolerance
    // loose. A device in double precision has functions of single precision.
    const bool coarse = hasSingleForces() || onDevice();
    const double delta = coarse ? 2e-3 : 1e-5, tolerance = coarse ? 0.02 : 1e-5;
    for (int b : {0, 5})
        for (int k = 0; k < 3; k++) {
            double e[2], f[2];
            for (int side = 0; side < 2; side++) {
                const double d = side == 0 ? -delta : delta;
                auto moved = R;
                moved[b][k] += d;
                box.integrator.setBodyPositions(moved);
                e[side] = energy();
                box.integrator.setBodyPositions(R);
                QuaternionArray turn = {{cos(d / 2), 0, 0, 0}};
                turn[1 + k] = sin(d / 2);
                auto turned = q;
                turned[b] = product(turn, q[b]);
                box.integrator.setBodyOrientations(turned);
                f[side] = energy();
                box.integrator.setBodyOrientations(q);
            }
            EXPECT_NEAR(forces[b][k], -(e[1] - e[0]) / (2 * delta),
                        tolerance * norm(forces[b]) + tolerance)
                << b << k;
            EXPECT_NEAR(torques[b][k], -(f[1] - f[0]) / (2 * delta),
                        tolerance * norm(torques[b]) + tolerance)
                << b << k;
        }
}

TEST(VirtualSites, FollowTheirBodies) {
    WaterBox box(2);
    // The user need not place the virtual sites.
    for (size_t i = 3; i < box.positions.size(); i += 4) box.positions[i] = Vec3();
    box.start();
    box.integrator.step(20);
    const auto x = positionsOf(*box.context);
    for (size_t p = 0; p < x.size(); p += 4)
        EXPECT_LT(norm(x[p + 3] - x[p] * 0.786646558 - (x[p + 1] + x[p + 2]) * 0.106676721),
                  readTolerance(1e-8, 1));
}

TEST(VirtualSites, OfVirtualSitesFollowTheirBodies) {
    // Site 2 of each molecule depends on site 3, which depends on the atoms. The first molecule is
    // a body, the second one is free.
    System system;
    CustomRigidHIIntegrator integrator(300, 0.002);
    integrator.setRandomNumberSeed(8);
    vector<Vec3> start;
    auto* field = new CustomExternalForce("50*(x^2+y^2+z^2)");
    for (int molecule = 0; molecule < 2; molecule++) {
        const int p = 4 * molecule;
        for (double mass : {12.0, 16.0, 0.0, 0.0}) system.addParticle(mass);
        system.addConstraint(p, p + 1, 0.1);
        system.setVirtualSite(p + 2, new TwoParticleAverageSite(p + 3, p + 1, 0.5, 0.5));
        system.setVirtualSite(p + 3, new TwoParticleAverageSite(p, p + 1, 0.5, 0.5));
        for (double x : {0.0, 0.1, 0.075, 0.05}) start.emplace_back(x, molecule, 0.3);
        for (int i = 0; i < 4; i++) field->addParticle(p + i);
    }
    system.addForce(field);
    integrator.addRigidBody({0, 1, 2, 3});
    unique_ptr<Context> context;
    try {
        context = make_unique<Context>(system, integrator, testPlatform());
    } catch (const OpenMMException& error) {
        ASSERT_STREQ(error.what(), "A virtual site cannot depend on another virtual site");
        GTEST_SKIP() << "OpenMM " << Platform::getOpenMMVersion()
                     << " has no virtual sites that depend on others";
    }
    context->setPositions(start);
    context->setVelocitiesToTemperature(300, 4);
    integrator.step(50);
    const auto x = positionsOf(*context);
    EXPECT_GT(norm(x[0] - start[0]), 1e-3);
    for (int p : {0, 4}) {
        EXPECT_LT(norm(x[p + 2] - x[p] * 0.25 - x[p + 1] * 0.75), readTolerance(1e-7, 1)) << p;
        EXPECT_LT(norm(x[p + 3] - x[p] * 0.5 - x[p + 1] * 0.5), readTolerance(1e-7, 1)) << p;
    }
    // The force on the body is that on all four particles. The springs make it -100 times the sum
    // of all positions.
    const auto sum = x[0] + x[1] + x[2] + x[3];
    EXPECT_LT(norm(integrator.getBodyForces()[0] + sum * 100.0),
              forceTolerance(1e-9, 100 * norm(sum)));
}

TEST(FreeParticles, ConstrainedFlexibleMoleculesKeepTheirConstraintsAndTemperature) {
    // Free four-atom molecules with two constraints, beside water bodies.
    System system;
    CustomRigidHIIntegrator integrator(300, 0.001);
    const int copies = 200;
    vector<Vec3> positions;
    auto* bonds = new HarmonicBondForce();
    auto* angles = new HarmonicAngleForce();
    for (int i = 0; i < copies; i++) {
        const int p = system.addParticle(12);
        for (double mass : {1.0, 1.0, 16.0}) system.addParticle(mass);
        system.addConstraint(p, p + 1, 0.1);
        system.addConstraint(p, p + 2, 0.1);
        bonds->addBond(p, p + 3, 0.14, 20000);
        angles->addAngle(p + 1, p, p + 2, 1.9, 300);
        angles->addAngle(p + 1, p, p + 3, 1.9, 300);
        for (const Vec3& x :
             {Vec3(), Vec3(0.1, 0, 0), Vec3(-0.03, 0.0953939, 0), Vec3(-0.04, -0.06, 0.12)})
            positions.push_back(x + Vec3(0.5 * i, 0, 0));
    }
    system.addForce(bonds);
    system.addForce(angles);
    addBodies(system, integrator, waterShape(), 50);
    for (const Vec3& x : randomPoses(waterShape(), 50, 0.5, 3))
        positions.push_back(x + Vec3(0, 2, 0));
    integrator.setFriction(10);
    integrator.setConstraintTolerance(1e-8);
    integrator.setRandomNumberSeed(10);
    Context context(system, integrator, testPlatform(), threads(testPlatformName(), 2));
    context.setPositions(positions);
    context.setVelocitiesToTemperature(300, 4);
    const auto dof = integrator.getDegreesOfFreedom();
    EXPECT_EQ(dof.at("free"), copies * (12 - 2));
    EXPECT_EQ(dof.at("translational"), 150);
    EXPECT_EQ(dof.at("total"), copies * 10 + 300);
    integrator.step(1000);
    vector<double> temperatures;
    for (int s = 0; s < 40; s++) {
        integrator.step(200);
        temperatures.push_back(integrator.computeFreeParticleKineticEnergy() /
                               (0.5 * boltzmann * dof.at("free")));
        const auto x = positionsOf(context), v = velocitiesOf(context);
        for (int i = 0; i < 4 * copies; i += 4)
            for (int k : {1, 2}) {
                const Vec3 d = x[i + k] - x[i];
                // The tolerance includes the rounding of positions so far from the origin, and of
                // the direction that these positions define.
                const double reading = readTolerance(0, 0.5 * copies);
                ASSERT_NEAR(norm(d), 0.1, 1e-8 + reading);
                ASSERT_NEAR(d.dot(v[i + k] - v[i]) / norm(d), 0,
                            1e-5 + reading / 0.1 * norm(v[i + k] - v[i]));
            }
    }
    // The kinetic bias of BAOAB for the stiffest bond is h^2 w^2/4 of 1/10 of the energy. With w^2
    // = 20000/6.9 this is 7e-5.
    expectMean("free temperature",
               {estimate(temperatures).mean, 300 * sqrt(2.0 / (dof.at("free") * 40.0))}, 300);
}

TEST(Velocities, ToTemperatureReplacesAndDrawsTwists) {
    System system;
    CustomRigidHIIntegrator integrator(300, 0.001);
    const int copies = 3000;
    vector<Vec3> positions;
    for (int i = 0; i < copies;
         i++) {  // spheres with an orientation: one site, so velocities say nothing of the spin
        system.addParticle(3.0);
        integrator.addRigidBody({i}, 3.0, Vec3(0.3, 0.1, 0.2), {Vec3()});
        positions.push_back(Vec3(i, 0, 0));
    }
    addBodies(system, integrator, waterShape(), copies);
    for (const Vec3& x : randomPoses(waterShape(), copies, 1, 3))
        positions.push_back(x + Vec3(0, 2, 0));
    Context context(system, integrator, testPlatform());
    context.setPositions(positions);
    const double half = boltzmann * 300 / 2;
    for (int repeat = 0; repeat < 3; repeat++) {
        context.setVelocitiesToTemperature(300, 5 + repeat);
        auto check = [&](const string& what, double energy, double n) {
            expectMean(what, {energy / half / n, sqrt(2 / n)}, 1);
        };
        check("translation", integrator.computeTranslationalKineticEnergy(), 6.0 * copies);
        for (int k = 0; k < 3; k++)
            check("axis " + to_string(k + 1), integrator.computeRotationalKineticEnergies()[k],
                  2.0 * copies);
    }
    // The twists agree with the particles' velocities.
    const auto x = positionsOf(context), v = velocitiesOf(context);
    const auto R = integrator.getBodyPositions(), V = integrator.getBodyVelocities(),
               omega = integrator.getBodyAngularVelocities();
    for (int b : {copies, copies + 1, 2 * copies - 1})
        for (int i = 0; i < 3; i++) {
            const int p = copies + 3 * (b - copies) + i;
            EXPECT_LT(norm(v[p] - V[b] - omega[b].cross(x[p] - R[b])), readTolerance(1e-12, 5));
        }
    context.setVelocitiesToTemperature(0, 1);
    EXPECT_EQ(context.getState(State::Energy).getKineticEnergy(), 0);
    EXPECT_NEAR(integrator.computeSystemTemperature(), 0, 1e-12);
}

TEST(Velocities, AreProjectedOnRigidMotion) {
    System system;
    CustomRigidHIIntegrator integrator(300, 0.001);
    const Shape water = waterShape();
    addBodies(system, integrator, water, 1);
    Context context(system, integrator, testPlatform());
    context.setPositions(randomPoses(water, 1, 0, 1));
    const auto x = positionsOf(context);
    const vector<Vec3> v = {Vec3(1, 2, 3), Vec3(-1, 0.5, 2), Vec3(0.3, -2, 1)};  // not rigid
    context.setVelocities(v);
    Vec3 p, L;
    double mass = 0;
    const Vec3 R = integrator.getBodyPositions()[0];
    for (int i = 0; i < 3; i++) {
        mass += water.masses[i];
        p += v[i] * water.masses[i];
        L += (x[i] - R).cross(v[i]) * water.masses[i];
    }
    EXPECT_LT(norm(integrator.getBodyVelocities()[0] - p / mass), readTolerance(1e-13, 3));
    // The angular momentum is kept: L = sum m r x (omega x r).
    const Vec3 omega = integrator.getBodyAngularVelocities()[0];
    Vec3 rigid;
    for (int i = 0; i < 3; i++) rigid += (x[i] - R).cross(omega.cross(x[i] - R)) * water.masses[i];
    EXPECT_LT(norm(rigid - L), readTolerance(1e-13, 3));
    // Setting the velocities again replaces them and does not accumulate.
    context.setVelocities(v);
    EXPECT_LT(norm(integrator.getBodyAngularVelocities()[0] - omega), 1e-13);
    // Body setters are seen in the particles at once.
    integrator.setBodyVelocities({Vec3(1, 0, 0)});
    integrator.setBodyAngularVelocities({Vec3(0, 0, 2)});
    const auto after = velocitiesOf(context);
    for (int i = 0; i < 3; i++)
        EXPECT_LT(norm(after[i] - Vec3(1, 0, 0) - Vec3(0, 0, 2).cross(x[i] - R)),
                  readTolerance(1e-14, 1));
}

TEST(Poses, MembersWithinToleranceArePutBackOthersAreAnError) {
    WaterBox box(2);
    box.start();
    auto moved = box.positions;
    moved[4] += Vec3(3e-4, 0, 0);
    box.context->setPositions(moved);
    EXPECT_GT(box.integrator.getPoseResidual(), 1e-6);
    EXPECT_LT(box.integrator.getPoseResidual(), 3e-4);
    box.integrator.step(1);
    const auto x = positionsOf(*box.context);
    for (int p = 0; p < 8; p += 4)
        EXPECT_NEAR(norm(x[p] - x[p + 1]), 0.09572, readTolerance(1e-14, 1));
    moved[5] += Vec3(0, 0.05, 0);
    box.context->setPositions(moved);
    expectError([&] { box.integrator.step(1); },
                {"body 1", "particle ", "nm from its place", "setPoseTolerance"});
    // The given state is still there, and good positions make it valid.
    const auto kept = positionsOf(*box.context);
    for (size_t p = 0; p < moved.size(); p++)
        EXPECT_LE(norm(kept[p] - moved[p]), readTolerance(0, 1));
    box.context->setPositions(box.positions);
    box.integrator.step(1);
    auto broken = box.positions;
    broken[9][1] = NAN;
    box.context->setPositions(broken);
    expectError([&] { box.integrator.step(1); }, {"body 2", "particle 9", "which is not finite"});
}

TEST(Poses, ResetBodyGeometryTakesTheShapeAnew) {
    System system;
    CustomRigidHIIntegrator integrator(0, 0.001);
    const Shape water = waterShape();
    addBodies(system, integrator, water, 1);
    expectError(
        [&] {
            vector<int> p;
            double m;
            Vec3 I;
            vector<Vec3> s;
            integrator.getRigidBodyParameters(0, p, m, I, s);
        },
        {"body 0"});
    Context context(system, integrator, testPlatform());
    context.setPositions(water.sites);
    integrator.step(1);
    vector<Vec3> larger;
    for (const Vec3& s : water.sites) larger.push_back(s * 1.5);
    context.setPositions(larger);
    expectError([&] { integrator.step(1); }, {"resetBodyGeometry"});
    integrator.resetBodyGeometry();
    integrator.step(1);
    vector<int> particles;
    double mass;
    Vec3 moments;
    vector<Vec3> sites;
    integrator.getRigidBodyParameters(0, particles, mass, moments, sites);
    EXPECT_NEAR(norm(sites[0] - sites[1]), 0.09572 * 1.5, readTolerance(1e-12, 1));
}

TEST(Others, ParametersBoxAndForceGroupsAreSeenAtOnce) {
    System system;
    CustomRigidHIIntegrator integrator(0, 0.01);
    integrator.setFriction(0);
    system.addParticle(1.0);
    integrator.addRigidBody({0}, 1.0, Vec3(), {Vec3()});
    auto* push = new CustomExternalForce("-strength*x");
    push->addGlobalParameter("strength", 0.0);
    push->addParticle(0, vector<double>());
    push->setForceGroup(3);
    system.addForce(push);
    Context context(system, integrator, testPlatform());
    context.setPositions({Vec3()});
    integrator.step(1);
    EXPECT_EQ(integrator.getBodyVelocities()[0][0], 0);
    context.setParameter("strength", 2.0);
    integrator.step(1);
    EXPECT_NEAR(integrator.getBodyVelocities()[0][0], 0.02, 1e-9);
    EXPECT_NEAR(integrator.getBodyForces()[0][0], 2.0, 1e-6);
    integrator.setIntegrationForceGroups(~(1 << 3));
    context.setVelocities({Vec3()});
    integrator.step(1);
    EXPECT_EQ(integrator.getBodyVelocities()[0][0], 0);
}

namespace {

/** Two waters and a free particle under several forces, of which every setting can be changed
 * between steps. */
struct ChangeableScene {
    System system;
    CustomRigidHIIntegrator integrator;
    CustomExternalForce* well = new CustomExternalForce("strength*k*(x^2+2*y^2+x*z)");
    HarmonicBondForce* bond = new HarmonicBondForce();
    NonbondedForce* nonbonded = new NonbondedForce();
    CustomBodyForce* push = new CustomBodyForce("a*pull", "0", "0", "0", "0", "0.1*a");
    unique_ptr<Context> context;

    explicit ChangeableScene(CustomRigidHIIntegrator::Scheme scheme) : integrator(0, 0.002) {
        integrator.setScheme(scheme);
        auto* fluid = new MobilityForce();
        Shape water = waterShape();
        vector<Vec3> positions;
        for (int b = 0; b < 2; b++) {
            addBodies(system, integrator, water, 1);
            for (int i = 0; i < 3; i++) {
                system.addConstraint(3 * b + i, 3 * b + (i + 1) % 3,
                                     norm(water.sites[i] - water.sites[(i + 1) % 3]));
                positions.push_back(water.sites[i] + Vec3(0.4 * b, 0.1, 0.2));
                fluid->addParticle(i == 0 ? 0.1 : 0);
            }
        }
        system.addParticle(3.0);
        fluid->addParticle(0.1);
        positions.push_back(Vec3(1.1, 0.2, 0.3));
        well->addGlobalParameter("strength", 1.0);
        well->addPerParticleParameter("k");
        well->setForceGroup(3);
        push->addPerBodyParameter("a");
        push->addGlobalParameter("pull", 1.0);
        for (int p = 0; p < 7; p++) {
            well->addParticle(p, {1.0});
            nonbonded->addParticle(0.1 * (p - 3), 0.1, 0.1);
        }
        for (int b = 0; b < 2; b++) push->addBody(b, {3.0});
        bond->addBond(0, 6, 0.3, 10);
        bond->setUsesPeriodicBoundaryConditions(true);
        system.setDefaultPeriodicBoxVectors(Vec3(4, 0, 0), Vec3(0, 4, 0), Vec3(0, 0, 4));
        for (Force* force : {(Force*)well, (Force*)bond, (Force*)nonbonded, (Force*)push})
            system.addForce(force);
        if (RigidHIPlugin::traitsOf(scheme).needsFluid())
            system.addForce(fluid);
        else
            delete fluid;
        context = make_unique<Context>(system, integrator, testPlatform(),
                                       threads(testPlatformName(), 1));
        context->setPositions(positions);
        integrator.step(2);
    }
};

using SceneAction = function<void(ChangeableScene&)>;

struct Change {
    string name;
    SceneAction make, prepare = [](ChangeableScene&) {};
    bool isLater = false;  // takes effect when the next Context is created
};

vector<Change> changesOfForces() {
    const SceneAction onlyGroup0 = [](ChangeableScene& s) {
        s.integrator.setIntegrationForceGroups(1);
        s.integrator.step(1);
    };
    const SceneAction ewaldInGroup0 = [onlyGroup0](ChangeableScene& s) {
        s.nonbonded->setNonbondedMethod(NonbondedForce::Ewald);
        s.nonbonded->setCutoffDistance(1.0);
        s.context->reinitialize(true);
        onlyGroup0(s);
    };
    // Version 7 looks at the groups of its own Forces in each evaluation, except for those on a
    // device. Later versions keep the groups of the start.
    const bool keepsGroups = Platform::getOpenMMVersion().substr(0, 2) != "7.",
               keepsDirect = keepsGroups || onDevice();
    return {
        {"integration force groups",
         [](ChangeableScene& s) { s.integrator.setIntegrationForceGroups(~(1 << 3)); }},
        {"force group of an OpenMM force", [](ChangeableScene& s) { s.well->setForceGroup(0); },
         onlyGroup0, keepsDirect},
        {"force group of a body force", [](ChangeableScene& s) { s.push->setForceGroup(7); },
         onlyGroup0},
        {"reciprocal-space group",
         [](ChangeableScene& s) { s.nonbonded->setReciprocalSpaceForceGroup(5); }, ewaldInGroup0,
         keepsGroups},
        {"direct space", [](ChangeableScene& s) { s.nonbonded->setIncludeDirectSpace(false); },
         ewaldInGroup0, keepsDirect},
        {"force group and reinitialize()",
         [](ChangeableScene& s) {
             s.integrator.setIntegrationForceGroups(~(1 << 5));
             s.well->setForceGroup(5);
             s.context->reinitialize(true);
         }},
        {"global parameter", [](ChangeableScene& s) { s.context->setParameter("strength", 3.0); }},
        {"global parameter of a body force",
         [](ChangeableScene& s) { s.context->setParameter("pull", 3.0); }},
        {"parameters of particles",
         [](ChangeableScene& s) {
             for (int p = 0; p < 7; p++) s.well->setParticleParameters(p, p, {2.0});
             s.well->updateParametersInContext(*s.context);
         }},
        {"parameters of bonds",
         [](ChangeableScene& s) {
             s.bond->setBondParameters(0, 0, 6, 0.2, 300);
             s.bond->updateParametersInContext(*s.context);
         }},
        {"charges",
         [](ChangeableScene& s) {
             for (int p = 0; p < 7; p++)
                 s.nonbonded->setParticleParameters(p, 0.2 * (p - 3), 0.1, 0.1);
             s.nonbonded->updateParametersInContext(*s.context);
         }},
        {"parameters of bodies",
         [](ChangeableScene& s) {
             s.push->setBodyParameters(0, 0, {9.0});
             s.push->updateParametersInContext(*s.context);
         }},
        {"box",
         [](ChangeableScene& s) {
             s.context->setPeriodicBoxVectors(Vec3(1.2, 0, 0), Vec3(0, 2, 0), Vec3(0, 0, 2));
         }},
    };
}

}  // namespace

TEST(Others, TheNextStepHasTheForcesOfTheNewSettings) {
    // The result is that of an integrator that evaluates all forces in every step. Here this is an
    // integrator whose positions are set again, so that it evaluates all forces.
    for (auto scheme :
         {CustomRigidHIIntegrator::LangevinC, CustomRigidHIIntegrator::GradientThermostat,
          CustomRigidHIIntegrator::LangevinHI, CustomRigidHIIntegrator::FixmanMidpoint})
        for (const Change& change : changesOfForces()) {
            ChangeableScene kept(scheme), anew(scheme), unchanged(scheme);
            for (ChangeableScene* scene : {&kept, &anew, &unchanged}) change.prepare(*scene);
            change.make(kept);
            change.make(anew);
            anew.context->setPositions(positionsOf(*anew.context));
            for (ChangeableScene* scene : {&kept, &anew, &unchanged}) scene->integrator.step(1);
            EXPECT_TRUE(sameBits(positionsOf(*kept.context), positionsOf(*anew.context)))
                << change.name << ", scheme " << scheme;
            EXPECT_TRUE(sameBits(velocitiesOf(*kept.context), velocitiesOf(*anew.context)))
                << change.name << ", scheme " << scheme;
            if (change.isLater && onDevice()) continue;
            EXPECT_EQ(sameBits(positionsOf(*anew.context), positionsOf(*unchanged.context)),
                      change.isLater)
                << change.name;
        }
}

TEST(Others, LookingAtForcesOfOtherGroupsChangesNothing) {
    for (auto scheme :
         {CustomRigidHIIntegrator::LangevinC, CustomRigidHIIntegrator::GradientThermostat,
          CustomRigidHIIntegrator::LangevinHI, CustomRigidHIIntegrator::FixmanMidpoint}) {
        ChangeableScene looked(scheme), left(scheme);
        looked.context->getState(State::Forces | State::Energy, false, 1 << 3);
        looked.integrator.setIntegrationForceGroups(looked.integrator.getIntegrationForceGroups());
        for (ChangeableScene* scene : {&looked, &left}) scene->integrator.step(2);
        EXPECT_TRUE(sameBits(positionsOf(*looked.context), positionsOf(*left.context)))
            << "scheme " << scheme;
        EXPECT_EQ(looked.integrator.getStepStatistics().at("forceEvaluations"),
                  left.integrator.getStepStatistics().at("forceEvaluations"));
    }
}

TEST(Others, OpenMMsMinimiserWorksOnConstrainedBodies) {
    WaterBox box(2);
    box.start();
    const double before = box.context->getState(State::Energy).getPotentialEnergy();
    LocalEnergyMinimizer::minimize(*box.context, 10, 200);
    box.integrator.step(1);  // poses are fitted, and members put back
    const double after = box.context->getState(State::Energy).getPotentialEnergy();
    EXPECT_LT(after, before);
    EXPECT_LT(box.integrator.getPoseResidual(), 1e-3);
}

TEST(Others, BarostatMovesBodiesAsAWhole) {
    WaterBox box(5, 0.001, true);
    box.system.addForce(new MonteCarloBarostat(1.0, 300, 5));
    dynamic_cast<MonteCarloBarostat&>(box.system.getForce(1)).setRandomNumberSeed(1);
    box.start();
    box.context->setVelocitiesToTemperature(300, 1);
    Vec3 a0, a, b, c;
    box.context->getState(0).getPeriodicBoxVectors(a0, b, c);
    box.integrator.step(200);
    box.context->getState(0).getPeriodicBoxVectors(a, b, c);
    EXPECT_NE(a0[0], a[0]);
    Shape water = waterShape();
    const auto x = positionsOf(*box.context);
    for (size_t p = 0; p < x.size(); p += 4)
        EXPECT_NEAR(norm(x[p] - x[p + 1]), 0.09572, readTolerance(1e-13, 2));
    EXPECT_LT(box.integrator.getPoseResidual(), readTolerance(1e-12, 2));
    EXPECT_NE(box.integrator.getEffects().at("barostat").find("MonteCarloBarostat"), string::npos);
}

TEST(Others, NonFiniteForcesNameStepAndBodyAndKeepTheLastState) {
    System system;
    CustomRigidHIIntegrator integrator(0, 0.1);
    integrator.setFriction(0);
    vector<Vec3> positions;
    for (int i = 0; i < 3; i++) {
        system.addParticle(1.0);
        integrator.addRigidBody({i}, 1.0, Vec3(), {Vec3()});
        positions.push_back(Vec3(i == 1 ? 0.55 : 5.0, 0, 0));
    }
    auto* force = new CustomExternalForce("wall*sqrt(x)");  // not a number for x < 0
    force->addGlobalParameter("wall", 1.0);
    for (int i = 0; i < 3; i++) force->addParticle(i, vector<double>());
    system.addForce(force);
    Context context(system, integrator, testPlatform());
    context.setPositions(positions);
    context.setVelocities({Vec3(), Vec3(-2, 0, 0), Vec3()});
    integrator.step(2);
    const auto good = positionsOf(context), goodVelocities = velocitiesOf(context);
    expectError([&] { integrator.step(10); }, {"step 3", "body 1", "non-finite", "smaller step"});
    EXPECT_TRUE(sameBits(positionsOf(context), good));
    EXPECT_TRUE(sameBits(velocitiesOf(context), goodVelocities));
    EXPECT_EQ(context.getStepCount(), 2);
    EXPECT_LT(integrator.getBodyPositions()[1][0], 0.55);
    // Once the cause is removed the Context goes on.
    context.setParameter("wall", 0.0);
    context.setVelocities({Vec3(), Vec3(1, 0, 0), Vec3()});
    integrator.step(1);
    EXPECT_GT(positionsOf(context)[1][0], good[1][0]);
    // A free particle gives the same error.
    System other;
    other.addParticle(1.0);
    auto* nan = new CustomExternalForce("sqrt(x)");
    nan->addParticle(0, vector<double>());
    other.addForce(nan);
    CustomRigidHIIntegrator second(0, 0.1);
    Context free(other, second, testPlatform());
    free.setPositions({Vec3(-1, 0, 0)});
    expectError([&] { second.step(1); }, {"step 1", "free particle 0", "non-finite"});
}

TEST(Others, BodiesAcrossPeriodicBoundariesStayWhole) {
    WaterBox box(3, 0.002, true);
    for (Vec3& x : box.positions) x += Vec3(0.4, 0.4, 0.4);
    box.start();
    box.context->setVelocitiesToTemperature(300, 1);
    box.integrator.step(500);
    const State state = box.context->getState(State::Positions, true);
    for (int p = 0; p < (int)box.positions.size(); p += 4)
        EXPECT_NEAR(norm(state.getPositions()[p] - state.getPositions()[p + 1]), 0.09572,
                    readTolerance(1e-12, 2));
    // Positions of whole molecules that were wrapped into the box are accepted.
    box.context->setPositions(state.getPositions());
    box.integrator.step(5);
    EXPECT_LT(box.integrator.getPoseResidual(), readTolerance(1e-12, 2));
}

/** The processor's time, which other programs hardly change. */
static double processorSeconds() { return double(clock()) / CLOCKS_PER_SEC; }

TEST(Others, CreatingAContextCostsNoMoreABodyInALargerSystem) {
    // When each body searched the constraints of all bodies, four times as many bodies took
    // thirteen times as long.
    const auto seconds = [](int copies, bool constrained) {
        System system;
        CustomRigidHIIntegrator integrator(300, 0.001);
        const Shape water = waterShape();
        addBodies(system, integrator, water, copies);
        for (int p = 0; constrained && p < 3 * copies; p++)
            system.addConstraint(p, p % 3 == 2 ? p - 2 : p + 1,
                                 norm(water.sites[p % 3] - water.sites[(p + 1) % 3]));
        double least = INFINITY;
        for (int repeat = 0; repeat < 5; repeat++) {
            const double start = processorSeconds();
            Context context(system, integrator, testPlatform(), threads(testPlatformName(), 1));
            least = min(least, processorSeconds() - start);
        }
        return least;
    };
    for (bool constrained : {true, false}) {
        // Without constraints more bodies are needed for a time that the clock can measure.
        const int number = constrained ? 2000 : 8000;
        const double few = seconds(number, constrained), many = seconds(4 * number, constrained);
        cout << number << " bodies: " << few << " s, " << 4 * number << ": " << many << " s"
             << endl;
        EXPECT_LT(many, 8 * few);
    }
}

TEST(Others, ConstraintsOfFreeParticlesArePreparedOnce) {
    SKIP_ON_DEVICES(
        "the Context's constraints are the device's, and those of free particles are prepared on "
        "the host beside them");
    // OpenMM takes quadratic time to prepare constraints that are not those of water. Preparing
    // them again for this plugin took as long.
    System system;
    const int molecules = 1000;
    for (int m = 0; m < molecules; m++) {
        for (int i = 0; i < 4; i++) system.addParticle(1);
        for (int i = 0; i < 3; i++) system.addConstraint(4 * m + i, 4 * m + i + 1, 0.1);
    }
    CustomRigidHIIntegrator integrator(300, 0.001);
    VerletIntegrator verlet(0.001);
    double least[2] = {INFINITY, INFINITY};
    for (int repeat = 0; repeat < 5; repeat++)
        for (int own : {0, 1}) {
            const double start = processorSeconds();
            Context context(system, own ? (Integrator&)integrator : verlet, testPlatform(),
                            threads(testPlatformName(), 1));
            least[own] = min(least[own], processorSeconds() - start);
        }
    cout << "Verlet " << least[0] << " s, this one " << least[1] << " s" << endl;
    EXPECT_LT(least[1], 1.5 * least[0]);
}

TEST(Others, SystemsWithoutBodiesAndWithImmobileParticlesRun) {
    System system;
    system.addParticle(2.0);
    system.addParticle(0.0);
    auto* bond = new HarmonicBondForce();
    bond->addBond(0, 1, 0.1, 100);
    system.addForce(bond);
    CustomRigidHIIntegrator integrator(300, 0.002);
    Context context(system, integrator, testPlatform());
    context.setPositions({Vec3(), Vec3(0.1, 0, 0)});
    integrator.step(50);
    EXPECT_LE(norm(positionsOf(context)[1] - Vec3(0.1, 0, 0)), readTolerance(0, 0.1));
    EXPECT_NE(positionsOf(context)[0], Vec3());
    EXPECT_EQ(integrator.getDegreesOfFreedom().at("total"), 3);
}

TEST(Others, ABodyWithAMarkerFollowsItsMarker) {
    // A sphere whose orientation matters to a force carries a massless marker.
    System system;
    system.addParticle(10.0);
    system.addParticle(0.0);
    auto* pull = new CustomExternalForce("-5*y");
    pull->addParticle(1, vector<double>());
    system.addForce(pull);
    CustomRigidHIIntegrator integrator(0, 0.002);
    integrator.setRotationalFriction(50);
    integrator.setFriction(1e9);
    integrator.addRigidBody({0, 1}, 10.0, Vec3(0.1, 0.1, 0.1), {Vec3(), Vec3(0.2, 0, 0)});
    Context context(system, integrator, testPlatform());
    context.setPositions({Vec3(), Vec3(0.2 * cos(0.3), 0.2 * sin(0.3), 0)});
    EXPECT_NEAR(integrator.getBodyOrientations()[0][3], sin(0.15), readTolerance(1e-12, 1));
    integrator.step(20000);
    EXPECT_NEAR(rotate(integrator.getBodyOrientations()[0], Vec3(1, 0, 0))[1], 1, 1e-3);
}
