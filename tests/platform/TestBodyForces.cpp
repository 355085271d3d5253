// CustomBodyForce: the motion of bodies under the force, the order of the scheme, the variables of
// its expressions, exact resume, and refused input.

#include <openmm/CustomExternalForce.h>
#include <openmm/VerletIntegrator.h>

#include <sstream>

#include "TestSupport.h"
#include "openmmrigidhi/CustomBodyForce.h"

using namespace OpenMM;
using namespace RigidHITest;
using RigidHIPlugin::CustomBodyForce;
using namespace std;

namespace {

using RigidIntegrator = CustomRigidHIIntegrator;

/** Bodies with explicit mass, moments and four sites. All particles of the System are massless
 * except the first. */
struct Scene {
    System system;
    RigidIntegrator integrator;
    vector<Vec3> positions;
    unique_ptr<Context> context;

    explicit Scene(double h, double temperature = 0) : integrator(temperature, h) {
        integrator.setFriction(0);
        integrator.setRotationalFriction(0);
        integrator.setRandomNumberSeed(3);
    }
    void addBody(const Vec3& at, const Vec3& moments = Vec3(1, 2, 2.5), double mass = 2) {
        const vector<Vec3> sites = {Vec3(), Vec3(0.5, 0, 0), Vec3(0, 0.5, 0), Vec3(0, 0, 0.5)};
        vector<int> particles;
        for (const Vec3& site : sites) {
            particles.push_back(system.addParticle(1));
            positions.push_back(at + site);
        }
        integrator.addRigidBody(particles, mass, moments, sites);
    }
    CustomBodyForce* addForce(const vector<string>& e) {
        auto* force = new CustomBodyForce(e[0], e[1], e[2], e[3], e[4], e[5]);
        system.addForce(force);
        return force;
    }
    void create() {
        context = make_unique<Context>(system, integrator, testPlatform());
        context->setPositions(positions);
    }
    vector<double> stateOfBodies() {
        vector<double> values;
        auto append = [&](const vector<Vec3>& rows) {
            for (const Vec3& v : rows) values.insert(values.end(), {v[0], v[1], v[2]});
        };
        append(integrator.getBodyPositions());
        append(integrator.getBodyVelocities());
        append(integrator.getBodyAngularVelocities());
        append(integrator.getBodyForces());
        append(integrator.getBodyTorques());
        for (const auto& q : integrator.getBodyOrientations())
            values.insert(values.end(), q.begin(), q.end());
        return values;
    }
};

const vector<string> none = {"0", "0", "0", "0", "0", "0"};

}  // namespace

TEST(BodyForces, ConstantForceGivesAParabola) {
    Scene scene(0.01);
    scene.addBody(Vec3(1, 2, 3));
    scene.addBody(Vec3(5, 0, 0));
    CustomBodyForce* force = scene.addForce({"f", "-2*f", "0.5", "0", "0", "0"});
    force->addPerBodyParameter("f");
    force->addBody(1, {3});
    scene.create();
    scene.integrator.setBodyVelocities({Vec3(0.1, 0, 0), Vec3(0, 0.2, -1)});
    scene.integrator.step(200);
    const double t = 2, mass = 2;
    const Vec3 acceleration = Vec3(3, -6, 0.5) / mass;
    EXPECT_NEAR(scene.context->getTime(), t, 1e-12);
    EXPECT_LT(norm(scene.integrator.getBodyPositions()[0] - Vec3(1 + 0.1 * t, 2, 3)), 1e-13);
    const Vec3 expected = Vec3(5, 0, 0) + Vec3(0, 0.2, -1) * t + acceleration * (t * t / 2);
    EXPECT_LT(norm(scene.integrator.getBodyPositions()[1] - expected), 1e-12);
    EXPECT_LT(norm(scene.integrator.getBodyVelocities()[1] - Vec3(0, 0.2, -1) - acceleration * t),
              1e-12);
    EXPECT_LT(norm(scene.integrator.getBodyForces()[1] - Vec3(3, -6, 0.5)), 1e-15);
    EXPECT_LT(norm(scene.integrator.getBodyForces()[0]), 1e-15);
    EXPECT_NE(scene.integrator.getEffects()["body forces"].find("on: 1 body, 1 CustomBodyForce"),
              string::npos);
}

TEST(BodyForces, ConstantTorqueSpinsUpASphere) {
    // The torque is about an axis of the lab frame, which is not a body axis.
    Scene scene(0.01);
    scene.addBody(Vec3(), Vec3(2, 2, 2));
    scene.addForce({"0", "0", "0", "0.3", "-0.2", "0.6"})->addBody(0, {});
    scene.create();
    scene.integrator.setBodyOrientations({{{0.5, 0.5, -0.5, 0.5}}});
    scene.integrator.step(100);
    const Vec3 omega = Vec3(0.3, -0.2, 0.6) / 2.0;
    EXPECT_LT(norm(scene.integrator.getBodyAngularVelocities()[0] - omega), 1e-12);
    // The axis does not move, so the angle is omega t^2 / 2.
    const double angle = norm(omega) / 2;
    const Vec3 axis = omega / norm(omega);
    const QuaternionArray turn = {{cos(angle / 2), sin(angle / 2) * axis[0],
                                   sin(angle / 2) * axis[1], sin(angle / 2) * axis[2]}};
    const QuaternionArray expected = product(turn, {{0.5, 0.5, -0.5, 0.5}}),
                          q = scene.integrator.getBodyOrientations()[0];
    const double overlap =
        q[0] * expected[0] + q[1] * expected[1] + q[2] * expected[2] + q[3] * expected[3];
    EXPECT_NEAR(abs(overlap), 1, 1e-9);
}

TEST(BodyForces, TimeDependentForceConvergesWithSecondOrder) {
    vector<double> errors;
    for (const double h : {0.04, 0.02, 0.01}) {
        Scene scene(h);
        scene.addBody(Vec3());
        scene.addForce({"cos(w*t); w=3", "0", "0", "0", "0", "0"})->addBody(0, {});
        scene.create();
        scene.integrator.step(int(2 / h + 0.5));
        // x'' = cos(w t) / m
        const double expected = (1 - cos(3 * 2.0)) / 9 / 2;
        errors.push_back(abs(scene.integrator.getBodyPositions()[0][0] - expected));
        EXPECT_NEAR(scene.integrator.getBodyForces()[0][0], cos(6.0), 1e-12)
            << "that of the end of the step";
    }
    EXPECT_NEAR(errors[0] / errors[1], 4, 0.2);
    EXPECT_NEAR(errors[1] / errors[2], 4, 0.1);
}

TEST(BodyForces, VelocityDependentForceConvergesWithSecondOrder) {
    for (const auto scheme :
         {RigidIntegrator::LangevinA, RigidIntegrator::LangevinB, RigidIntegrator::LangevinC}) {
        vector<double> errors;
        for (const double h : {0.04, 0.02, 0.01}) {
            Scene scene(h);
            scene.integrator.setScheme(scheme);
            scene.addBody(Vec3());
            scene.addForce({"-c*v*vx; v=sqrt(vx^2+vy^2+vz^2); c=1.5", "0", "0", "0", "0", "0"})
                ->addBody(0, {});
            scene.create();
            scene.integrator.setBodyVelocities({Vec3(2, 0, 0)});
            scene.integrator.step(int(2 / h + 0.5));
            // v' = -c/m v^2
            const double rate = 1.5 / 2, v = 2 / (1 + rate * 2 * 2.0),
                         x = log(1 + rate * 2 * 2.0) / rate;
            errors.push_back(abs(scene.integrator.getBodyVelocities()[0][0] - v) +
                             abs(scene.integrator.getBodyPositions()[0][0] - x));
        }
        EXPECT_NEAR(errors[0] / errors[1], 4, 0.5) << scheme;
        EXPECT_NEAR(errors[1] / errors[2], 4, 0.3) << scheme;
    }
}

TEST(BodyForces, TrapEqualsCustomExternalForceOnTheParticle) {
    // The first particle of each body is at its origin.
    vector<vector<double>> results;
    for (const bool ours : {true, false}) {
        Scene scene(0.01, 300);
        scene.integrator.setFriction(2);
        scene.integrator.setRotationalFriction(3);
        for (int b = 0; b < 11; b++)
            scene.addBody(Vec3(0.25 * b, 0.1, -0.2));  // binary fractions: parameters may be floats
        if (ours) {
            CustomBodyForce* force = scene.addForce({"-k*(x-x0)", "-k*y", "-2*k*z", "0", "0", "0"});
            force->addGlobalParameter("k", 40);
            force->addPerBodyParameter("x0");
            for (int b = 0; b < 11; b++) force->addBody(b, {0.25 * b});
        } else {
            auto* force = new CustomExternalForce("k/2*((x-x0)^2+y^2+2*z^2)");
            force->addGlobalParameter("k", 40);
            force->addPerParticleParameter("x0");
            for (int b = 0; b < 11; b++) force->addParticle(4 * b, {0.25 * b});
            scene.system.addForce(force);
        }
        scene.create();
        scene.context->setVelocitiesToTemperature(300, 5);
        scene.integrator.step(100);
        scene.context->setParameter("k", 60);
        scene.integrator.step(100);
        results.push_back(scene.stateOfBodies());
    }
    for (size_t i = 0; i < results[0].size(); i++)
        EXPECT_NEAR(results[0][i], results[1][i], forceTolerance(1e-9, 5)) << i;
}

TEST(BodyForces, ExpressionsSeeTheUsersFrame) {
    // Moments are sorted inside. Whatever their order, q is that of the user's frame: here it gives
    // a force along the body's own x axis.
    mt19937 generator(8);
    for (const Vec3& moments : {Vec3(1, 2, 2.5), Vec3(2, 1, 2.5), Vec3(2.5, 2, 1), Vec3(1, 2.5, 2),
                                Vec3(2.5, 1, 2), Vec3(2, 2.5, 1)}) {
        Scene scene(0.001);
        scene.addBody(Vec3(), moments);
        scene
            .addForce({"q0^2+q1^2-q2^2-q3^2", "2*(q1*q2+q0*q3)", "2*(q1*q3-q0*q2)", "x", "vy", "t"})
            ->addBody(0, {});
        scene.create();
        const QuaternionArray q = randomQuaternion(generator);
        scene.integrator.setBodyOrientations({q});
        scene.integrator.setBodyPositions({Vec3(7, 8, 9)});
        scene.integrator.setBodyVelocities({Vec3(1, 2, 3)});
        scene.context->setTime(5);
        scene.integrator.step(1);
        const Vec3 axis = rotate(scene.integrator.getBodyOrientations()[0], Vec3(1, 0, 0));
        EXPECT_LT(norm(scene.integrator.getBodyForces()[0] - axis), 1e-13);
        const Vec3 torque = scene.integrator.getBodyTorques()[0];
        EXPECT_NEAR(torque[0], scene.integrator.getBodyPositions()[0][0], 1e-13);
        EXPECT_NEAR(torque[1], scene.integrator.getBodyVelocities()[0][1], 1e-6) << "predicted";
        EXPECT_NEAR(torque[2], 5.001, 1e-13);
    }
}

TEST(BodyForces, DipoleInAFieldHasItsDistribution) {
    // Under a torque n x E on the body axis n the exact <cos> is coth(u) - 1/u with u = E/kT.
    Scene scene(0.05, 1 / boltzmann);
    const int n = 400;
    for (int b = 0; b < n; b++) scene.addBody(Vec3(2.0 * b, 0, 0), Vec3(2.5, 1, 2));
    scene.integrator.setRotationalFriction(2);
    scene.integrator.setFriction(2);
    // E = 2 along z, n the body's axis z.
    CustomBodyForce* force = scene.addForce(
        {"0", "0", "0", "2*ny; ny=2*(q2*q3-q0*q1)", "-2*nx; nx=2*(q1*q3+q0*q2)", "0"});
    for (int b = 0; b < n; b++) force->addBody(b, {});
    scene.create();
    scene.context->setVelocitiesToTemperature(1 / boltzmann, 2);
    scene.integrator.step(400);
    vector<double> means(n);
    const int samples = 100;
    for (int s = 0; s < samples; s++) {
        scene.integrator.step(20);
        const auto q = scene.integrator.getBodyOrientations();
        for (int b = 0; b < n; b++) means[b] += rotate(q[b], Vec3(0, 0, 1))[2] / samples;
    }
    expectMean("<cos>", estimate(means), 1 / tanh(2.0) - 0.5);
}

TEST(BodyForces, SeveralForcesAndRepeatedBodiesAddUp) {
    Scene scene(0.001);
    scene.addBody(Vec3());
    scene.addBody(Vec3(3, 0, 0));
    CustomBodyForce* first = scene.addForce({"a", "0", "0", "0", "0", "a"});
    first->addPerBodyParameter("a");
    first->addBody(0, {1});
    first->addBody(0, {10});
    CustomBodyForce* second = scene.addForce({"100", "g", "0", "0", "0", "0"});
    second->addGlobalParameter("g", 7);
    second->addBody(1, {});
    second->addBody(0, {});
    scene.create();
    scene.integrator.step(1);
    EXPECT_LT(norm(scene.integrator.getBodyForces()[0] - Vec3(111, 7, 0)), 1e-12);
    EXPECT_LT(norm(scene.integrator.getBodyForces()[1] - Vec3(100, 7, 0)), 1e-12);
    EXPECT_LT(norm(scene.integrator.getBodyTorques()[0] - Vec3(0, 0, 11)), 1e-12);
    // New parameters and Context parameters take effect from the next evaluation on, also for
    // forces kept from the last step.
    const Vec3 before = scene.integrator.getBodyVelocities()[0];
    first->setBodyParameters(1, 0, {-1000});
    first->updateParametersInContext(*scene.context);
    scene.context->setParameter("g", -5);
    scene.integrator.step(1);
    const Vec3 gained = scene.integrator.getBodyVelocities()[0] - before;
    EXPECT_LT(norm(gained - Vec3(-899, -5, 0) * (0.001 / 2)), 1e-12);
    EXPECT_EQ(scene.integrator.getStepStatistics()["forceEvaluations"], 4);
}

TEST(BodyForces, HonourForceGroups) {
    Scene scene(0.01);
    scene.addBody(Vec3());
    scene.addForce({"1", "0", "0", "0", "0", "0"})->addBody(0, {});
    CustomBodyForce* second = scene.addForce({"10", "0", "0", "0", "0", "t"});
    second->addBody(0, {});
    second->setForceGroup(3);
    scene.create();
    const vector<pair<int, double>> cases = {
        {1 << 3, 10}, {1, 1}, {1 | 1 << 3, 11}, {1 << 5, 0}, {-1, 11}};
    for (const auto& c : cases) {
        scene.integrator.setIntegrationForceGroups(c.first);
        scene.integrator.step(1);
        EXPECT_EQ(scene.integrator.getBodyForces()[0][0], c.second);
        const string effect = scene.integrator.getEffects()["body forces"];
        EXPECT_EQ(effect.substr(0, 3), c.second == 0 ? "off" : "on:") << effect;
    }
}

TEST(BodyForces, SetTimeCountsForForcesKept) {
    Scene scene(0.01);
    scene.addBody(Vec3());
    scene.addForce({"t", "0", "0", "0", "0", "0"})->addBody(0, {});
    scene.create();
    scene.integrator.step(1);
    scene.context->setTime(100);
    scene.integrator.setBodyVelocities({Vec3()});
    scene.integrator.step(1);
    EXPECT_NEAR(scene.integrator.getBodyVelocities()[0][0], (100 + 100.01) / 2 * 0.01 / 2, 1e-12);
}

TEST(BodyForces, ResumeBitForBit) {
    for (const auto scheme : thermostats())
        for (const bool throughState : {false, true})
            for (const int at : {1, 7}) {
                vector<vector<double>> results;
                string saved;
                State state;
                for (const bool resumed : {false, true}) {
                    Scene scene(0.01, 300);
                    scene.integrator.setFriction(2);
                    scene.integrator.setScheme(scheme);
                    for (int b = 0; b < 9; b++)
                        scene.addBody(Vec3(b, 0.5, 0), b % 2 ? Vec3(2, 1, 2.5) : Vec3(1, 2, 2.5));
                    const bool momenta = scheme != RigidIntegrator::GradientThermostat;
                    const string drag = momenta ? "-0.3*vx*abs(vx)" : "0";
                    CustomBodyForce* force = scene.addForce(
                        {"-9*x+5*cos(3*t)+" + drag, "sin(t)", "-z", drag + "+q1*q2", "t", "x*y"});
                    for (int b = 0; b < 9; b += 2) force->addBody(b, {});
                    scene.create();
                    scene.context->setVelocitiesToTemperature(300, 1);
                    if (!resumed) {
                        scene.integrator.step(at);
                        stringstream stream;
                        scene.context->createCheckpoint(stream);
                        saved = stream.str();
                        state = scene.context->getState(State::Positions | State::Velocities |
                                                        State::Parameters |
                                                        State::IntegratorParameters);
                    } else if (throughState)
                        scene.context->setState(state);
                    else {
                        stringstream stream(saved);
                        scene.context->loadCheckpoint(stream);
                    }
                    scene.integrator.step(20);
                    results.push_back(scene.stateOfBodies());
                }
                EXPECT_EQ(results[0], results[1])
                    << "scheme " << scheme << ", state " << throughState << ", step " << at;
            }
}

TEST(BodyForces, WithoutAnyNothingChanges) {
    // With a CustomBodyForce that acts on no body, results are the same bit for bit as without one.
    vector<vector<double>> results;
    for (const bool idle : {true, false}) {
        Scene scene(0.01, 300);
        for (int b = 0; b < 9; b++) scene.addBody(Vec3(b, 0.5, 0));
        if (idle) scene.addForce({"x", "t", "vx", "0", "0", "0"});
        auto* field = new CustomExternalForce("x^2+3*y*z");
        for (int i = 0; i < scene.system.getNumParticles(); i++) field->addParticle(i, {});
        scene.system.addForce(field);
        scene.create();
        scene.integrator.step(20);
        EXPECT_EQ(scene.integrator.getEffects()["body forces"],
                  idle ? "off: none of 1 CustomBodyForce has bodies and is in an integrated "
                         "force group"
                       : "off: the System has no CustomBodyForce");
        results.push_back(scene.stateOfBodies());
    }
    EXPECT_EQ(results[0], results[1]);
}

TEST(BodyForces, NonFiniteOnesAreReportedAndNothingIsLost) {
    for (const string expression : {"sqrt(0.025-t)", "sqrt(-1+0*vx+step(0.025-t))"}) {
        Scene scene(0.01);
        scene.addBody(Vec3());
        scene.addBody(Vec3(2, 0, 0));
        scene.addForce({"1", expression, "0", "0", "0", "0"})->addBody(1, {});
        scene.create();
        scene.integrator.step(2);
        const vector<double> before = scene.stateOfBodies();
        for (int attempt = 0; attempt < 2; attempt++)
            expectError([&] { scene.integrator.step(1); },
                        {"step 3: body 1", "non-finite force, torque or momentum"});
        vector<double> after = scene.stateOfBodies();
        EXPECT_TRUE(equal(before.begin(), before.begin() + 18, after.begin()));
    }
}

TEST(BodyForces, Refusals) {
    const auto creation =
        [](const vector<string>& expressions, int body, const vector<double>& parameters,
           CustomRigidHIIntegrator::Scheme scheme = CustomRigidHIIntegrator::LangevinC) {
            Scene scene(0.01);
            scene.integrator.setScheme(scheme);
            scene.addBody(Vec3());
            CustomBodyForce* force = scene.addForce(expressions);
            force->addPerBodyParameter("a");
            force->addBody(body, parameters);
            scene.create();
        };
    EXPECT_NO_THROW(creation(none, 0, {1}));
    expectError(
        [&] { creation(none, 1, {1}); },
        {"CustomBodyForce: entry 0 acts on body 1, but the integrator's 1 bodies are numbered",
         "correct the entry"});
    expectError(
        [&] { creation(none, 0, {}); },
        {"entry 0 (body 0) has 0 parameters", "the force has 1 per-body parameters", "addBody()"});
    expectError([&] { creation(none, 0, {1, 2}); }, {"entry 0 (body 0) has 2 parameters"});
    expectError(
        [&] {
            creation({"0", "0", "0", "0", "b*x", "0"}, 0, {1});
        },
        {"CustomBodyForce: force 0: ty: expression \"b*x\": the name 'b' is unknown", "vz, t, a"});
    expectError(
        [&] {
            creation({"x+", "0", "0", "0", "0", "0"}, 0, {1});
        },
        {"fx: expression \"x+\": it ends too early"});
    expectError(
        [&] {
            creation({"", "0", "0", "0", "0", "0"}, 0, {1});
        },
        {"fx: expression \"\": it ends too early"});
    expectError(
        [&] {
            creation({"vx", "0", "0", "0", "0", "0"}, 0, {1},
                     CustomRigidHIIntegrator::GradientThermostat);
        },
        {"force 0, a CustomBodyForce, depends on vx, vy or vz, but scheme GradientThermostat",
         "use a Langevin scheme"});
    // The scheme is changed later.
    Scene scene(0.01);
    scene.addBody(Vec3());
    scene.addForce({"vx", "0", "0", "0", "0", "0"})->addBody(0, {});
    scene.create();
    scene.integrator.step(1);
    scene.integrator.setScheme(CustomRigidHIIntegrator::GradientThermostat);
    expectError([&] { scene.integrator.step(1); }, {"depends on vx, vy or vz"});
    // Another integrator.
    VerletIntegrator verlet(0.001);
    expectError([&] { Context context(scene.system, verlet, testPlatform()); },
                {"the Context's integrator is a VerletIntegrator, which has no rigid bodies",
                 "works only under a CustomRigidHIIntegrator"});
    // Other bodies than at creation.
    CustomBodyForce& force = dynamic_cast<CustomBodyForce&>(scene.system.getForce(0));
    force.addBody(0, {});
    expectError(
        [&] { force.updateParametersInContext(*scene.context); },
        {"the force acts on other bodies than when the Context was created", "reinitialize()"});
}

TEST(BodyForces, SettersRefuse) {
    CustomBodyForce force("0", "0", "0", "0", "0", "0");
    EXPECT_EQ(force.addPerBodyParameter("a"), 0);
    EXPECT_EQ(force.addGlobalParameter("b", 1), 0);
    force.setPerBodyParameterName(0, "a");
    force.setGlobalParameterName(0, "b");
    for (const string name : {"x", "y", "z", "q0", "q1", "q2", "q3", "vx", "vy", "vz", "t"})
        expectError([&] { force.addPerBodyParameter(name); },
                    {"the name '" + name + "' is that of a variable", "choose another"});
    for (const string name : {"", "1a", ".5", "a b", "a+b", "-a", "f(", "a)", "a,b", "a;", "a=b",
                              "a^2", "a/b", "a*b", "\ta"}) {
        expectError([&] { force.addPerBodyParameter(name); },
                    {"the name '" + name + "' cannot stand in an expression"});
        expectError([&] { force.addGlobalParameter(name, 0); }, {"cannot stand in an expression"});
        expectError([&] { force.setGlobalParameterName(0, name); },
                    {"cannot stand in an expression"});
        expectError([&] { force.setPerBodyParameterName(0, name); },
                    {"cannot stand in an expression"});
    }
    expectError([&] { force.addPerBodyParameter("b"); },
                {"the force already has a parameter 'b'", "different names"});
    expectError([&] { force.addGlobalParameter("a", 0); },
                {"the force already has a parameter 'a'"});
    expectError([&] { force.setPerBodyParameterName(0, "b"); },
                {"the force already has a parameter 'b'"});
    expectError([&] { force.addGlobalParameter("c", NAN); },
                {"the default value of 'c' is nan", "parameters must be finite"});
    expectError([&] { force.setGlobalParameterDefaultValue(0, INFINITY); },
                {"the default value of 'b' is inf"});
    expectError([&] { force.addBody(-1, {1}); },
                {"entry 0: body index -1 is negative", "bodies are counted from 0"});
    expectError([&] { force.addBody(0, {NAN}); }, {"entry 0: parameter 'a' is nan"});
    EXPECT_EQ(force.getNumBodies(), 0);
    EXPECT_EQ(force.addBody(2, {1}), 0);
    expectError([&] { force.setBodyParameters(0, -2, {1}); }, {"body index -2 is negative"});
    expectError([&] { force.getExpression("fw"); },
                {"component 'fw' is unknown", "fx, fy, fz, tx, ty, tz"});
    expectError([&] { force.setExpression("", "0"); }, {"component '' is unknown"});
    int body;
    vector<double> values;
    expectError([&] { force.getBodyParameters(1, body, values); },
                {"index 1 is out of range", "this force has 1 entries, numbered from 0",
                 "add what is missing first, or correct the index"});
    expectError([&] { force.setBodyParameters(-1, 0, {}); }, {"index -1 is out of range"});
    expectError([&] { force.getGlobalParameterName(1); }, {"this force has 1 global parameters"});
    expectError([&] { force.getPerBodyParameterName(1); },
                {"this force has 1 per-body parameters"});
}
