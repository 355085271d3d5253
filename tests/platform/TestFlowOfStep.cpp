// When users get the flow of the last step, and when the flow of the present forces. Reading the
// flow changes nothing, and saved states contain the last step.

#include <openmm/serialization/XmlSerializer.h>

#include <functional>
#include <sstream>

#include "FlowReadingSupport.h"

using namespace OpenMM;
using namespace RigidHITest;
using RigidHIPlugin::CustomBodyForce;
using namespace std;

// ---- Which flow is answered ----

namespace {

using Points = vector<Vec3>;

/** A scene whose forces depend on positions and time, so that evaluations can be told apart. */
void addChanging(Pushed& scene) {
    scene.add(apartKind(), Vec3(1, 1, 2.5), {{0.8, 0.6, 0, 0}});
    scene.add(sphereKind(0.6), Vec3(3.5, 2, 1.5));
    scene.addFree(1, 0.5, Vec3(2, 4, 3));
    auto* force = new CustomBodyForce("x*cos(t)", "0.2*z", "1+0.3*y", "q1*q0", "x+t", "-0.4");
    for (int b : {0, 1}) force->addBody(b, {});
    scene.system.addForce(force);
}

const Points somewhere = {Vec3(2, 3, 2), Vec3(4.2, 2, 0.4), Vec3(1.9, 1.1, 3.1), Vec3(1.1, 1, 2.4)};

vector<RigidHI::Scheme> allWithFluid() {
    vector<RigidHI::Scheme> schemes = {RigidHI::LangevinHI};
    for (const SchemeTraits& traits : overdampedSchemes()) schemes.push_back(traits.scheme);
    return schemes;
}

/** The flow of the present forces at the poses of a scene, computed in a new scene that has made no
 * step. */
MatrixXd flowOfForces(
    Pushed& scene, const ModelCase& model, MobilityForce::Boundary boundary,
    const function<void(Pushed&)>& prepare = [](Pushed&) {}) {
    Pushed fresh(model);
    fresh.fluid->setBoundary(boundary);
    addChanging(fresh);
    fresh.fluid->setViscosity(scene.fluid->getViscosity());
    prepare(fresh);
    fresh.start();
    Vec3 a, b, c;
    scene.context->getState(0).getPeriodicBoxVectors(a, b, c);
    fresh.context->setPeriodicBoxVectors(a, b, c);
    fresh.context->setPositions(positionsOf(*scene.context));
    fresh.context->setTime(scene.context->getTime());
    fresh.pose(scene.integrator.getBodyPositions(), scene.integrator.getBodyOrientations());
    return fresh.flow(somewhere);
}

}  // namespace

TEST(FlowOfStep, IsThatOfForcesBeforeAStepAndAfterChanges) {
    SKIP_ON_SINGLE_PRECISION_DEVICES("positions are rounded");
    for (const SchemeTraits& traits : overdampedSchemes())
        for (auto boundary : {MobilityForce::Unbounded, MobilityForce::Periodic}) {
            SCOPED_TRACE(traits.name);
            Pushed scene(rotnePrager, T1, 1e-3, traits.scheme);
            scene.fluid->setBoundary(boundary);
            addChanging(scene);
            scene.start();
            const auto expectOfForces = [&](const string& when) {
                const MatrixXd expected = flowOfForces(scene, rotnePrager, boundary);
                EXPECT_LT((scene.flow(somewhere) - expected).cwiseAbs().maxCoeff(), 1e-11) << when;
                EXPECT_GT(expected.norm(), 0.1);
            };
            const auto expectOfStep = [&](const string& when) {
                const MatrixXd found = scene.flow(somewhere);
                EXPECT_GT((found - flowOfForces(scene, rotnePrager, boundary)).norm(), 1)
                    << when;  // noise of h^-1/2
                EXPECT_EQ(scene.flow(somewhere), found);
            };
            expectOfForces("before a step");
            scene.integrator.step(1);
            expectOfStep("after a step");
            scene.context->setTime(7);
            expectOfStep("after setTime()");
            auto R = scene.integrator.getBodyPositions();
            R[1] += Vec3(0, 0.1, 0);
            scene.integrator.setBodyPositions(R);
            expectOfForces("after setBodyPositions()");
            scene.integrator.step(1);
            expectOfStep("after another step");
            auto q = scene.integrator.getBodyOrientations();
            q[0] = product({{0.8, 0, 0.6, 0}}, q[0]);
            scene.integrator.setBodyOrientations(q);
            expectOfForces("after setBodyOrientations()");
            scene.integrator.step(1);
            auto x = positionsOf(*scene.context);
            x[scene.freeParticles[0]] += Vec3(0.1, 0, 0);
            scene.context->setPositions(x);
            expectOfForces("after setPositions()");
            scene.integrator.step(1);
            scene.fluid->setViscosity(0.7);
            scene.fluid->updateParametersInContext(*scene.context);
            expectOfForces("after updateParametersInContext()");
            scene.integrator.step(1);
            expectOfStep("with another viscosity");
            if (boundary != MobilityForce::Periodic) continue;
            scene.setBox(8.0001, 8, 8);
            expectOfForces("after a small change of the box");
            scene.setBox(8, 8, 8);
            expectOfStep("in the old box again");
            scene.setBox(8.5, 8, 8.2);
            expectOfForces("after a change of the box");
            scene.integrator.step(1);
            expectOfStep("in the new box");
        }
}

TEST(FlowOfStep, OfAStepDoesNotDependOnWhenOneAsks) {
    SKIP_ON_SINGLE_PRECISION_DEVICES("forces are rounded");
    const int steps = 4;
    for (auto scheme : allWithFluid())
        for (auto solver : {MobilityForce::Dense, MobilityForce::MatrixFree})
            for (int threads : {1, 2}) {
                SCOPED_TRACE(traitsOf(scheme).name);
                const auto make = [&](int threadCount) {
                    auto scene = make_unique<Pushed>(
                        ModelCase{"", MobilityForce::RotnePragerYamakawa, solver}, T1, 5e-3,
                        scheme);
                    scene->fluid->setSolverTolerance(1e-3);
                    generalFlow().set(*scene->fluid);
                    addChanging(*scene);
                    scene->FluidScene::start(testPlatform(), threadCount);
                    return scene;
                };
                const auto asking = make(threads), silent = make(1);
                MatrixXd found;
                asking->flow(somewhere);
                for (int i = 0; i < steps; i++) {
                    asking->integrator.step(1);
                    found = asking->flow(somewhere);
                    EXPECT_EQ(found, asking->flow(somewhere));
                }
                silent->integrator.step(steps);
                EXPECT_EQ(asking->state(), silent->state());
                EXPECT_EQ(silent->flow(somewhere), found);
                silent->integrator.step(1);
                asking->integrator.step(1);
                EXPECT_EQ(asking->state(), silent->state());
            }
}

/**
 * The forces on the blobs of bodies with own tensors come from iterations, and other calls change
 * the tolerance of these iterations.
 */
TEST(FlowOfStep, OfAStepDoesNotDependOnWhatElseOneAsks) {
    SKIP_ON_SINGLE_PRECISION_DEVICES("forces are rounded");
    for (auto scheme : {RigidHI::RandomFiniteDifference, RigidHI::DriftCorrectorRFD}) {
        Pushed scene({"", MobilityForce::RotnePragerYamakawa, MobilityForce::MatrixFree}, T1, 5e-3,
                     scheme);
        scene.fluid->setSolverTolerance(1e-3);
        addChanging(scene);
        scene.fluid->setBodyMobility(0, rowsOf(tensorWithoutSymmetry(0)));
        scene.start();
        scene.integrator.step(1);
        const MatrixXd found = scene.flow(somewhere);
        scene.mobility();
        EXPECT_EQ(scene.flow(somewhere), found) << traitsOf(scheme).name;
    }
}

TEST(FlowOfStep, OfAStepThatWasRedoneIsThatOfWhatWasAccepted) {
    SKIP_ON_SINGLE_PRECISION_DEVICES("differences of positions are rounded");
    for (const SchemeTraits& traits : overdampedSchemes()) {
        SCOPED_TRACE(traits.name);
        const auto make = [&] {
            auto scene = make_unique<Pushed>(rotnePrager, T1, 0.05, traits.scheme);
            scene->fluid->setBoundary(MobilityForce::NoSlipWall);
            for (int b = 0; b < 3; b++) scene->add(sphereKind(0.6), Vec3(1.5 * b, 0.1 * b, 0.65));
            scene->start();
            return scene;
        };
        const auto asking = make(), silent = make();
        int redone = 0;
        for (int i = 0; i < 40 && redone < 3; i++) {
            const int before = asking->integrator.getNumRejectedSteps();
            const auto bodies = asking->labBodies();
            const VectorXd twists = asking->stepTwists();
            silent->integrator.step(1);
            EXPECT_EQ(asking->state(), silent->state());
            if (asking->integrator.getNumRejectedSteps() == before) continue;
            redone++;
            const MatrixXd found = asking->flow(somewhere);
            EXPECT_EQ(found, silent->flow(somewhere));
            // The flow of this scheme belongs to one set of poses.
            if (traits.scheme == RigidHI::EulerMaruyama) {
                EXPECT_LT(slipOfParticles(*asking, bodies, twists, 16),
                          1e-5 * twists.cwiseAbs().maxCoeff());
            }
        }
        EXPECT_EQ(redone, 3);
    }
}

TEST(FlowOfStep, WithMomentaIsThatOfTheFriction) {
    SKIP_ON_SINGLE_PRECISION_DEVICES("positions are rounded");
    const double a = 0.8, eta = 0.6, h = 1e-3;
    const LinearFlow flow = generalFlow();
    const Vector3d centre(1, -2, 0.5), V(1, 2, -0.5), omega(0.3, -1, 2);
    {
        Pushed scene(rotnePrager, 0, h, RigidHI::LangevinHI);
        flow.set(*scene.fluid);
        scene.add(sphereKind(a), toVec3(centre));
        scene.start();
        scene.integrator.setBodyVelocities({toVec3(V)});
        scene.integrator.setBodyAngularVelocities({toVec3(omega)});
        const Vector3d F = 6 * M_PI * eta * a * (V - flow.at(centre)),
                       T = 8 * M_PI * eta * pow(a, 3) * (omega - flow.halfCurl());
        for (const Vector3d& d : {Vector3d(0.1, 0.2, 0.3), Vector3d(2, -1, 1)})
            expectNear(scene.flow({toVec3(centre + d)}),
                       flow.at(centre + d) + stokes(d, a, eta, F, T), 1e-13);
    }
    const ModelCase matrixFree = {"RotnePragerYamakawa, matrix-free",
                                  MobilityForce::RotnePragerYamakawa, MobilityForce::MatrixFree};
    for (const ModelCase& model : {rotnePrager, matrixFree})
        for (auto boundary : {MobilityForce::Unbounded, MobilityForce::NoSlipWall}) {
            Pushed scene(model, T1, h, RigidHI::LangevinHI);
            scene.fluid->setBoundary(boundary);
            if (boundary == MobilityForce::NoSlipWall)
                scene.fluid->setBackgroundFlow(Vec3(), {0, 0, 0.2, 0, 0, -0.3, 0, 0, 0});
            else
                flow.set(*scene.fluid);
            addChanging(scene);
            scene.start();
            for (int asked : {0, 1}) {
                scene.integrator.step(5 * asked);
                const VectorXd twists = scene.twists();
                EXPECT_LT(slipOfParticles(scene, scene.labBodies(), twists, 16),
                          1e-7 * (0.1 + twists.cwiseAbs().maxCoeff()));
            }
        }
}

// ---- Saved and loaded ----

namespace {

unique_ptr<Pushed> savedScene(RigidHI::Scheme scheme, MobilityForce::Solver solver, int threads,
                              double viscosity = 0.6) {
    auto scene = make_unique<Pushed>(ModelCase{"", MobilityForce::RotnePragerYamakawa, solver}, T1,
                                     5e-3, scheme);
    scene->fluid->setSolverTolerance(1e-4);
    scene->fluid->setViscosity(viscosity);
    generalFlow().set(*scene->fluid);
    addChanging(*scene);
    scene->FluidScene::start(testPlatform(), threads);
    return scene;
}

string replaced(const string& text, const string& from, const string& to, size_t after = 0) {
    const size_t at = text.find(from, after);
    if (at == string::npos) throw OpenMMException("there is no " + from);
    return text.substr(0, at) + to + text.substr(at + from.size());
}

}  // namespace

TEST(FlowOfStep, IsSaved) {
    SKIP_ON_DEVICES("runs resume to rounding there");
    for (auto scheme : allWithFluid())
        for (auto solver : {MobilityForce::Dense, MobilityForce::MatrixFree}) {
            SCOPED_TRACE(traitsOf(scheme).name);
            const auto scene = savedScene(scheme, solver, 1),
                       second = savedScene(scheme, solver, 2),
                       third = savedScene(scheme, solver, 1);
            scene->integrator.step(3);
            stringstream checkpoint, xml;
            saveState(*scene->context, checkpoint, xml);
            const MatrixXd expected = scene->flow(somewhere);
            second->context->loadCheckpoint(checkpoint);
            EXPECT_EQ(second->flow(somewhere), expected);
            third->integrator.step(1);
            loadState(*third->context, xml);
            EXPECT_EQ(third->flow(somewhere), expected);
            // Asking for the flow has changed nothing else.
            scene->integrator.step(2);
            second->integrator.step(2);
            third->integrator.step(2);
            EXPECT_EQ(second->state(), scene->state());
            EXPECT_EQ(third->state(), scene->state());
            EXPECT_EQ(third->flow(somewhere), scene->flow(somewhere));
        }
}

TEST(FlowOfStep, IsSavedForOtherPlatforms) {
    SKIP_ON_SINGLE_PRECISION_DEVICES("forces are rounded");
    Platform& other = platform(testPlatformName() == "CPU" ? "Reference" : "CPU");
    for (auto scheme : allWithFluid()) {
        SCOPED_TRACE(traitsOf(scheme).name);
        const auto scene = savedScene(scheme, MobilityForce::Dense, 1);
        scene->integrator.step(2);
        stringstream checkpoint, xml;
        saveState(*scene->context, checkpoint, xml);
        Pushed there(rotnePrager, T1, 5e-3, scheme);
        generalFlow().set(*there.fluid);
        addChanging(there);
        there.FluidScene::start(other);
        loadState(*there.context, xml);
        // Random finite differences over 1e-5 of lengths magnify rounding.
        EXPECT_LT((there.flow(somewhere) - scene->flow(somewhere)).cwiseAbs().maxCoeff(), 1e-6);
    }
}

TEST(FlowOfStep, OfAStateOfAnotherFluidIsThatOfForces) {
    SKIP_ON_SINGLE_PRECISION_DEVICES("positions are rounded");
    for (auto scheme :
         {RigidHI::EulerMaruyama, RigidHI::DriftCorrectorFD, RigidHI::TrapezoidalSlip}) {
        const auto scene = savedScene(scheme, MobilityForce::Dense, 1),
                   thicker = savedScene(scheme, MobilityForce::Dense, 1, 0.9);
        scene->integrator.step(2);
        stringstream checkpoint, xml;
        saveState(*scene->context, checkpoint, xml);
        loadState(*thicker->context, xml);
        const MatrixXd expected =
            flowOfForces(*thicker, rotnePrager, MobilityForce::Unbounded,
                         [](Pushed& fresh) { generalFlow().set(*fresh.fluid); });
        EXPECT_LT((thicker->flow(somewhere) - expected).cwiseAbs().maxCoeff(), 1e-11);
    }
}

TEST(FlowOfStep, DamagedLastStepsAreRefused) {
    SKIP_ON_SINGLE_PRECISION_DEVICES("states hold more there");
    const auto scheme = RigidHI::FixmanMidpoint;
    const auto scene = savedScene(scheme, MobilityForce::Dense, 1);
    scene->integrator.step(2);
    stringstream checkpoint, file;
    saveState(*scene->context, checkpoint, file);
    const string xml = file.str();
    const size_t at = xml.find("<LastStep");
    ASSERT_NE(at, string::npos);
    const auto other = savedScene(scheme, MobilityForce::Dense, 1);
    other->integrator.step(1);
    const auto load = [&](const string& text) {
        stringstream stream(text);
        loadState(*other->context, stream);
    };
    const vector<string> words = {
        "the saved state's last step of scheme FixmanMidpoint is damaged, or belongs to other "
        "bodies",
        "load the state into an integrator with the same bodies and groups"};
    // The record has groups twice, a negative step size, or numbers of rows and columns that do not
    // fit.
    const size_t group = xml.find("<Group", at), end = xml.find("</LastStep>", at);
    ASSERT_TRUE(group != string::npos && end != string::npos);
    const string groups = xml.substr(group, end - group);
    expectError([&] { load(xml.substr(0, end) + groups + xml.substr(end)); }, words);
    expectError([&] { load(replaced(xml, "value=\"", "value=\"-", at)); }, words);  // the step
    expectError([&] { load(replaced(xml, "rows=\"18\"", "rows=\"17\"", at)); },
                {"property 'rows' is '17'",
                 "it must be the number of values divided by the number of columns"});
    expectError(
        [&] {
            load(replaced(xml, "<Vectors columns=\"1\" rows=\"15\"",
                          "<Vectors columns=\"15\" rows=\"1\"", at));
        },
        words);
    // A quaternion of another length.
    const size_t poses = xml.find("rows=\"7\"", at);
    size_t number = poses;
    for (int i = 0; i < 4; i++) number = xml.find("value=\"", number + 1);
    expectError([&] { load(xml.substr(0, number) + "value=\"3" + xml.substr(number + 7)); }, words);
    // A State without a last step, as earlier versions saved it, gives the flow of the present
    // forces.
    load(xml.substr(0, at) + xml.substr(end + string("</LastStep>").size()));
    const MatrixXd expected = flowOfForces(*other, rotnePrager, MobilityForce::Unbounded,
                                           [](Pushed& fresh) { generalFlow().set(*fresh.fluid); });
    EXPECT_LT((other->flow(somewhere) - expected).cwiseAbs().maxCoeff(), 1e-11);
    other->integrator.step(1);
    scene->integrator.step(1);
    EXPECT_EQ(other->state(), scene->state());
    // The last step of another scheme is not used.
    const auto euler = savedScene(RigidHI::EulerMaruyama, MobilityForce::Dense, 1);
    stringstream whole(xml);
    loadState(*euler->context, whole);
    EXPECT_LT((euler->flow(somewhere) - expected).cwiseAbs().maxCoeff(), 1e-11);
}

/**
 * A step that fails at any stage leaves poses, time and the last step unchanged. The last step
 * belongs to its scheme: another scheme has no last step, not even after loading one.
 */
TEST(FlowOfStep, OfALastStepOutlivesAStepThatFails) {
    SKIP_ON_SINGLE_PRECISION_DEVICES("positions are rounded");
    VectorXd forces = someWrenches(7).head(12), torques = forces;
    for (int b = 0; b < 2; b++) forces.segment<3>(6 * b + 3).setZero();
    for (const SchemeTraits& first : overdampedSchemes())
        for (const SchemeTraits& second : overdampedSchemes()) {
            SCOPED_TRACE(string(first.name) + ", then " + second.name);
            const auto make = [&](RigidHI::Scheme scheme) {
                auto scene = make_unique<Pushed>(rotnePrager, T1, 5e-3, scheme);
                scene->add(rodKind(), Vec3(1, -0.5, 1));
                scene->add(sphereKind(0.6), Vec3(3.5, 2, 1.5));
                scene->pushBy(forces);
                scene->start();
                return scene;
            };
            const auto scene = make(first.scheme);
            scene->integrator.step(2);
            const MatrixXd found = scene->flow(somewhere);
            const VectorXd state = scene->state();
            scene->integrator.setScheme(second.scheme);
            scene->pushBy(torques);
            expectError([&] { scene->integrator.step(1); }, {"acts about the line"});
            scene->pushBy(forces);
            EXPECT_EQ(scene->state(), state);
            stringstream checkpoint, xml;
            saveState(*scene->context, checkpoint, xml);
            const auto other = make(second.scheme);
            other->integrator.step(1);
            loadState(*other->context, xml);
            const MatrixXd now = scene->flow(somewhere);
            EXPECT_LT((other->flow(somewhere) - now).cwiseAbs().maxCoeff(), 1e-12);
            if (first.scheme == second.scheme)
                EXPECT_EQ(now, found);
            else
                EXPECT_NE(now, found);
            for (Pushed* each : {scene.get(), other.get()}) {
                each->integrator.setScheme(first.scheme);
                EXPECT_EQ(each->flow(somewhere), found);
            }
        }
}
