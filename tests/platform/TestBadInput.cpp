// For every error that users may make, the call throws an OpenMMException that names object, value,
// bound and remedy. (tests/python/test_bad_input_*.py has what Python adds, and runs and saved
// states.)

#include <openmm/AndersenThermostat.h>
#include <openmm/VirtualSite.h>

#include <functional>
#include <limits>

#include "TestSupport.h"

using namespace OpenMM;
using namespace RigidHITest;
using namespace std;

namespace {

const double nan_ = numeric_limits<double>::quiet_NaN(),
             infinity = numeric_limits<double>::infinity();
const vector<Vec3> twoSites = {Vec3(), Vec3(0.1, 0, 0)};

/** A kind of virtual site that this library does not know. Any new version of OpenMM may have such
 * a kind. */
struct MirroredSite : VirtualSite {
    explicit MirroredSite(int particle) { setParticles({particle}); }
};

struct BadInput : testing::Test {
    CustomRigidHIIntegrator integrator{300, 0.001};
    BadInput() { integrator.addRigidBody({0, 1, 2}); }
};

TEST_F(BadInput, Particles) {
    expectError(
        [&] {
            integrator.addRigidBody({3, 2});
        },
        {"body 1", "particle 2 is already in body 0", "a particle may be in one body only",
         "remove it"});
    expectError(
        [&] {
            integrator.addRigidBody({4, 4});
        },
        {"body 1", "particle 4 is named twice", "remove the repetition"});
    expectError([&] { integrator.addRigidBody({-1}); },
                {"body 1", "particle index -1 is negative", "particles are counted from 0"});
    expectError([&] { integrator.addRigidBody({}); },
                {"body 1", "it has no particles", "a body needs at least one"});
    expectError([&] { integrator.getRigidBodyParticles(1); },
                {"body index 1 is out of range", "the integrator has 1 bodies"});
    expectError([&] { integrator.clearBodyFriction(-1); },
                {"clearBodyFriction()", "body index -1 is out of range"});
    EXPECT_EQ(integrator.getNumRigidBodies(), 1);
}

TEST_F(BadInput, MassMomentsAndSites) {
    const Vec3 round(1, 1, 1);
    integrator.addRigidBody({3, 4});
    const auto refuses = [&](double mass, const Vec3& moments, const vector<Vec3>& sites,
                             vector<string> fragments) {
        fragments.push_back("body 2");
        expectError([&] { integrator.addRigidBody({5, 6}, mass, moments, sites); }, fragments);
        fragments.back() = "body 1";
        expectError(
            [&] {
                integrator.setRigidBodyParameters(1, {5, 6}, mass, moments, sites);
            },
            fragments);
        EXPECT_EQ(integrator.getNumRigidBodies(), 2);
        EXPECT_FALSE(integrator.getRigidBodyIsExplicit(1));
        EXPECT_EQ(integrator.getRigidBodyParticles(1), (vector<int>{3, 4}));
    };
    for (double bad : {-1.0, nan_, infinity}) {
        refuses(bad, round, twoSites, {"mass is", "it must be finite and not negative"});
        for (int k = 0; k < 3; k++) {
            Vec3 moments = round;
            moments[k] = bad;
            refuses(1, moments, twoSites,
                    {string("moment about ") + "xyz"[k], "amu nm^2",
                     "it must be finite and not negative"});
        }
    }
    refuses(1, Vec3(1, 2, 3.1), twoSites,
            {"moments (1, 2, 3.1) amu nm^2 violate the triangle inequality",
             "no moment may exceed the sum of the other two, here 3"});
    for (const Vec3& moments : {Vec3(3.001, 1, 2), Vec3(0, 0, 1), Vec3(0, 1, 2)})
        refuses(1, moments, twoSites, {"violate the triangle inequality"});
    for (size_t count : {0, 1, 3})
        refuses(1, round, vector<Vec3>(count),
                {"2 particles but " + to_string(count) + " site positions",
                 "each particle needs one site position"});
    refuses(1, round, {Vec3(), Vec3(0, nan_, 0)},
            {"site of particle 6 is (0, nan, 0)", "all three numbers must be finite"});
    integrator.addRigidBody({5, 6}, 1, Vec3(1, 2, 3), twoSites);  // a flat body
}

TEST_F(BadInput, Settings) {
    for (double bad : {-1.0, nan_, infinity}) {
        expectError([&] { integrator.setTemperature(bad); }, {"setTemperature()", "not negative"});
        expectError([&] { integrator.setFriction(bad); }, {"setFriction()", "1/ps"});
        expectError([&] { integrator.setRotationalFriction(bad); },
                    {"setRotationalFriction()", "1/ps"});
        expectError([&] { integrator.setBodyFriction(0, bad, 1); }, {"body 0", "friction gamma"});
        expectError([&] { integrator.setBodyFriction(0, 1, bad); },
                    {"body 0", "rotational friction Gamma"});
    }
    for (double bad : {0.0, -1.0, nan_, infinity}) {
        expectError([&] { integrator.setStepSize(bad); }, {"setStepSize()", "positive"});
        expectError([&] { integrator.setInertiaScale(bad); },
                    {"setInertiaScale()", "factor of the principal moments"});
        expectError([&] { integrator.setPoseTolerance(bad); }, {"setPoseTolerance()", "positive"});
        expectError([&] { integrator.setConstraintTolerance(bad); },
                    {"setConstraintTolerance()", "positive"});
        expectError([&] { integrator.setGradientRelaxationTime(bad); },
                    {"setGradientRelaxationTime()", "positive"});
        expectError([&] { integrator.setGradientRotationalRelaxationTime(bad); },
                    {"Upsilon", "positive"});
        expectError([&] { CustomRigidHIIntegrator(300, bad); }, {"step size"});
    }
    expectError([&] { integrator.setScheme(static_cast<CustomRigidHIIntegrator::Scheme>(17)); },
                {"scheme 17"});
    expectError([&] { integrator.setNoiseLaw(static_cast<CustomRigidHIIntegrator::NoiseLaw>(-1)); },
                {"law -1"});
    EXPECT_EQ(integrator.getTemperature(), 300);
    EXPECT_EQ(integrator.getStepSize(), 0.001);
    EXPECT_EQ(integrator.getInertiaScale(), 1);
}

TEST_F(BadInput, NoContext) {
    expectError([&] { integrator.step(1); }, {"step()", "needs a Context"});
    expectError([&] { integrator.getBodyPositions(); }, {"getBodyPositions()", "needs a Context"});
    expectError([&] { integrator.setBodyVelocities({Vec3()}); },
                {"setBodyVelocities()", "needs a Context"});
    expectError([&] { integrator.describeEffects(); }, {"describeEffects()", "needs a Context"});
    vector<int> particles;
    double mass;
    Vec3 moments;
    vector<Vec3> sites;
    expectError([&] { integrator.getRigidBodyParameters(0, particles, mass, moments, sites); },
                {"body 0", "are not known", "create a Context"});
}

TEST_F(BadInput, Systems) {
    auto create = [&](System& system) { Context context(system, integrator, testPlatform()); };
    System small, tied, site, copied, andersen, massless;
    small.addParticle(1);
    expectError([&] { create(small); },
                {"body 0", "particle index 1 is out of range", "the System has 1 particles"});
    for (System* system : {&tied, &site, &andersen, &massless})
        for (int i = 0; i < 4; i++)
            system->addParticle(system == &massless || (system == &site && i == 2) ? 0 : 1);
    tied.addConstraint(2, 3, 0.1);
    expectError([&] { create(tied); },
                {"constraint 0 ties particle 2 of body 0 to particle 3 outside it",
                 "add both particles to one body"});
    site.setVirtualSite(2, new TwoParticleAverageSite(0, 3, 0.5, 0.5));
    expectError([&] { create(site); },
                {"virtual site particle 2 of body 0 depends on particle 3 outside the body",
                 "add all of them to it"});
    for (int parent : {0, 3}) {  // in the body or not
        site.setVirtualSite(2, new MirroredSite(parent));
        expectError([&] { create(site); },
                    {"virtual site particle 2 of body 0 is a MirroredSite defined by particle " +
                         to_string(parent),
                     "need not turn with a body", "use a TwoParticleAverageSite",
                     "a massless member of the body"});
    }
    for (int i = 0; i < 4; i++) copied.addParticle(i == 3 ? 0 : 1);
    copied.setVirtualSite(3, new MirroredSite(1));
    expectError([&] { create(copied); },
                {"virtual site particle 3 is a MirroredSite defined by particle 1 of body 0",
                 "need not turn"});
    andersen.addForce(new AndersenThermostat(300, 1));
    expectError(
        [&] { create(andersen); },
        {"force 0, an AndersenThermostat, changes velocities of single particles", "remove it"});
    expectError([&] { create(massless); }, {"body 0 has mass 0", "explicit mass"});
}

TEST_F(BadInput, RowsOfBodyStates) {
    System system;
    for (int i = 0; i < 3; i++) system.addParticle(1);
    Context context(system, integrator, testPlatform());
    const pair<const char*, function<void()>> tooEarly[] = {
        {"step", [&] { integrator.step(1); }},
        {"getBodyPositions", [&] { integrator.getBodyPositions(); }},
        {"getBodyOrientations", [&] { integrator.getBodyOrientations(); }},
        {"getBodyVelocities", [&] { integrator.getBodyVelocities(); }},
        {"getBodyAngularVelocities", [&] { integrator.getBodyAngularVelocities(); }},
        {"setBodyOrientations", [&] {
             integrator.setBodyOrientations({{{1, 0, 0, 0}}});
         }}};
    for (const auto& [name, call] : tooEarly)
        expectError(call, {name, "needs positions: call setPositions() on the Context first"});
    context.setPositions({Vec3(), Vec3(0.1, 0, 0), Vec3(0, 0.1, 0)});
    integrator.step(1);
    expectError([&] { integrator.step(-1); }, {"number of steps is -1"});
    expectError([&] { integrator.setBodyPositions({}); }, {"setBodyPositions()", "got 0 rows"});
    expectError(
        [&] {
            integrator.setBodyVelocities({Vec3(), Vec3()});
        },
        {"setBodyVelocities()", "got 2 rows"});
    for (double bad : {nan_, infinity}) {
        const vector<Vec3> rows = {Vec3(bad, 0, 0)};
        expectError([&] { integrator.setBodyPositions(rows); },
                    {"body 0: position is", "all three numbers must be finite"});
        expectError([&] { integrator.setBodyVelocities(rows); },
                    {"body 0: velocity is", "all three numbers must be finite"});
        expectError([&] { integrator.setBodyAngularVelocities(rows); },
                    {"body 0: angular velocity is", "all three numbers must be finite"});
    }
    for (double length : {0.0, 0.99, 1.1, 2.0, nan_, infinity})
        expectError(
            [&] {
                integrator.setBodyOrientations({{{length, 0, 0, 0}}});
            },
            {"body 0: its quaternion has length", "normalise it, in the order (w, x, y, z)"});
    integrator.step(1);
    // A body that is added now does not belong to the Context.
    integrator.addRigidBody({3});
    EXPECT_EQ(integrator.getNumRigidBodies(), 2);
    EXPECT_EQ(integrator.getNumRigidBodiesOfContext(), 1);
    const vector<Vec3> R = integrator.getBodyPositions();
    integrator.setBodyPositions(R);
    const vector<string> fragments = {
        "got 2 rows; the Context has 1 bodies, and the integrator 2",
        "bodies that you add later become part of the next Context only", "call reinitialize()"};
    expectError([&] { integrator.setBodyPositions({Vec3(), Vec3()}); }, fragments);
    expectError([&] { integrator.setBodyVelocities({Vec3(), Vec3()}); }, fragments);
    expectError([&] { integrator.setBodyAngularVelocities({Vec3(), Vec3()}); }, fragments);
    expectError(
        [&] {
            integrator.setBodyOrientations({{{1, 0, 0, 0}}, {{1, 0, 0, 0}}});
        },
        fragments);
    integrator.step(1);
}

}  // namespace
