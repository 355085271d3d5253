// For every error that users may make with a CustomBodyMotion, the call throws an OpenMMException
// that names object, value, bound and remedy. (TestBodyMotions has errors of its values.)

#include <openmm/VerletIntegrator.h>

#include "HydrodynamicSupport.h"
#include "openmmrigidhi/CustomBodyMotion.h"

using namespace OpenMM;
using namespace RigidHITest;
using RigidHIPlugin::CustomBodyMotion;
using namespace std;

namespace {

const vector<string> nothing(6), spin = {"", "", "", "", "1", ""}, all(6, "t");

/** Two spheres in a fluid. */
struct Scene : FluidScene {
    explicit Scene(
        CustomRigidHIIntegrator::Scheme scheme = CustomRigidHIIntegrator::TrapezoidalSlip)
        : FluidScene(0) {
        add(sphereKind(0.5));
        add(sphereKind(0.5), Vec3(2, 0, 0));
        integrator.setScheme(scheme);
    }
    CustomBodyMotion* addMotion(const vector<string>& e, const vector<int>& bodies) {
        auto* force = new CustomBodyMotion(e[0], e[1], e[2], e[3], e[4], e[5]);
        system.addForce(force);
        for (int b : bodies) force->addBody(b, {});
        return force;
    }
    void expectRefused(const vector<string>& fragments) {
        expectError([&] { start(testPlatform()); }, fragments);
    }
};

}  // namespace

TEST(BadMotion, Setters) {
    CustomBodyMotion force("1", "", "", "", "", "");
    expectError([&] { force.getExpression("fx"); },
                {"CustomBodyMotion: getExpression(): component 'fx' is unknown",
                 "the components are vx, vy, vz, wx, wy, wz"});
    expectError([&] { force.setFrame(static_cast<CustomBodyMotion::Frame>(2)); },
                {"CustomBodyMotion: setFrame(): frame 2 is unknown; it must be one of Lab, Body",
                 "use the class constants"});
    EXPECT_EQ(force.getFrame(), CustomBodyMotion::Lab);
    expectError([&] { force.addPerBodyParameter("t"); },
                {"the name 't' is that of a variable", "t has a meaning of its own"});
    EXPECT_EQ(force.addPerBodyParameter("x"), 0);  // which is no variable here
    expectError([&] { force.addGlobalParameter("x", 1); },
                {"the force already has a parameter 'x'"});
    expectError([&] { force.addBody(-1, {}); }, {"entry 0", "body index -1 is negative"});
    expectError([&] { force.getPerBodyParameterName(1); },
                {"index 1 is out of range", "this force has 1 per-body parameters"});
}

TEST(BadMotion, Expressions) {
    const auto refused = [](const vector<string>& e, const vector<string>& fragments) {
        Scene scene;
        scene.addMotion(e, {0});
        scene.expectRefused(fragments);
    };
    refused(nothing, {"CustomBodyMotion: all six expressions are empty, so that the force "
                      "prescribes nothing",
                      "give at least one, or remove the force"});
    // Positions and velocities are no variables.
    for (const string variable : {"x", "vx", "q0"})
        refused({"", "", "-" + variable, "", "", ""},
                {"CustomBodyMotion: force 1: vz: expression \"-" + variable + "\": the name '" +
                 variable + "' is unknown"});
    refused({" ", "", "", "", "", ""}, {"vx: expression \" \": it ends too early"});
}

TEST(BadMotion, Bodies) {
    Scene missing;
    missing.addMotion(spin, {1, 2});
    missing.expectRefused(
        {"CustomBodyMotion: entry 1 acts on body 2, but the integrator's 2 "
         "bodies are numbered from 0"});
    Scene twice;
    twice.addMotion(spin, {1, 0, 1});
    twice.expectRefused({"CustomBodyMotion: entries 0 and 2 are both for body 1",
                         "a body can have one prescribed motion only: remove one of them"});
    Scene two;
    two.addMotion(spin, {1});
    two.addMotion({"0", "", "", "", "", ""}, {0, 1});
    two.expectRefused({"forces 1 and 2 both prescribe the motion of body 1"});
    Scene parameters;
    parameters.addMotion(spin, {0})->addPerBodyParameter("w");
    parameters.expectRefused({"CustomBodyMotion: entry 0 (body 0) has 0 parameters"});
}

TEST(BadMotion, OtherIntegrators) {
    System system;
    system.addParticle(1);
    system.addForce(new CustomBodyMotion("1", "", "", "", "", ""));
    VerletIntegrator integrator(0.001);
    expectError([&] { Context context(system, integrator, testPlatform()); },
                {"CustomBodyMotion: the Context's integrator is a VerletIntegrator",
                 "a CustomBodyMotion works only under a CustomRigidHIIntegrator"});
}

TEST(BadMotion, Held) {
    Scene scene;
    scene.addMotion(spin, {1});
    scene.integrator.setBodyHeld(1, true);
    scene.expectRefused(
        {"body 1 is held, but a CustomBodyMotion (force 1) prescribes its motion; "
         "let the body go, or remove it from the force"});
}

TEST(BadMotion, Schemes) {
    const vector<string> refusal = {
        "cannot do; use a scheme without momenta in a fluid, such as TrapezoidalSlip, or hold the "
        "body by setBodyHeld()"};
    for (auto scheme : thermostats()) {
        Scene scene(scheme);
        scene.removeFluid();
        scene.addMotion(all, {0});
        scene.expectRefused(
            {"a CustomBodyMotion (force 0) prescribes the motion of body 0, which "
             "scheme ",
             refusal[0]});
    }
    Scene scene(CustomRigidHIIntegrator::LangevinHI);
    scene.addMotion({"", "", "0", "1", "", ""}, {1});
    scene.expectRefused(
        {"a CustomBodyMotion (force 1) prescribes vz, wx of body 1, but scheme LangevinHI takes "
         "prescribed motion of whole bodies only",
         "prescribe the other components too ('0': at rest), or use a scheme without momenta in a "
         "fluid, such as TrapezoidalSlip"});
    // The setter of an integrator that is in use knows nothing of it; the next step does.
    Scene later;
    later.addMotion(spin, {0});
    later.start(testPlatform());
    later.integrator.step(1);
    later.integrator.setScheme(CustomRigidHIIntegrator::LangevinHI);
    expectError([&] { later.integrator.step(1); },
                {"prescribes wy of body 0, but scheme LangevinHI takes"});
}

TEST(BadMotion, NoBodiesAreNoError) {
    Scene scene;
    CustomBodyMotion* force = scene.addMotion(spin, {});
    scene.start(testPlatform());
    scene.integrator.step(1);
    force->addBody(0, {});
    expectError([&] { force->updateParametersInContext(*scene.context); },
                {"the force acts on other bodies than when the Context was created"});
    scene.integrator.step(1);
}
