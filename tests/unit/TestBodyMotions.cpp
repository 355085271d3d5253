// The motions that CustomBodyMotions prescribe: the components of bodies, and their values.

#include "HydrodynamicSupport.h"
#include "forces/BodyMotions.h"
#include "openmmrigidhi/CustomBodyMotion.h"
#include "openmmrigidhi/internal/CustomBodyMotionImpl.h"

using namespace OpenMM;
using namespace RigidHITest;
using namespace RigidHIPlugin;
using namespace std;

namespace {

/** CustomBodyMotions beside a Context of four bodies: without a step, so that no scheme matters. */
struct Motions : testing::Test {
    System system;
    CustomRigidHIIntegrator integrator{0, 0.001};
    unique_ptr<Context> context;
    vector<unique_ptr<CustomBodyMotion>> forces;
    vector<unique_ptr<ForceImpl>> impls;
    map<string, double> parameters;
    MatrixXd values;

    Motions() {
        for (int b = 0; b < 4; b++) integrator.addRigidBody({system.addParticle(1)});
        context = make_unique<Context>(system, integrator, platform("Reference"));
    }
    CustomBodyMotion& add(const vector<string>& e) {
        forces.push_back(make_unique<CustomBodyMotion>(e[0], e[1], e[2], e[3], e[4], e[5]));
        return *forces.back();
    }
    /** The implementations of earlier calls stay, because their BodyMotions refer to them. */
    BodyMotions make() {
        vector<ForceImpl*> all;
        for (const auto& force : forces) {
            impls.push_back(make_unique<CustomBodyMotionImpl>(*force));
            impls.back()->initialize(implOf(*context));
            for (const auto& parameter : impls.back()->getDefaultParameters())
                parameters.insert(parameter);
            all.push_back(impls.back().get());
        }
        return BodyMotions(all, integrator.getNumRigidBodies());
    }
};

}  // namespace

TEST_F(Motions, NoneCostNothing) {
    EXPECT_FALSE(BodyMotions().isOn());
    EXPECT_FALSE(make().isOn());
    add({"1", "", "", "", "", ""});  // without bodies
    BodyMotions motions = make();
    EXPECT_FALSE(motions.isOn());
    EXPECT_EQ(motions.describe(), "no CustomBodyMotion prescribes the motion of a body");
}

TEST_F(Motions, EmptyExpressionsAreFreeComponents) {
    CustomBodyMotion& planes = add({"", "", "0", "", "w", "0*t"});
    planes.addPerBodyParameter("w");
    planes.addBody(3, {7});
    planes.addBody(1, {-0.5});
    add({"1", "2", "3", "4", "5", "6"}).addBody(0, {});
    forces[1]->setFrame(CustomBodyMotion::Body);
    BodyMotions motions = make();
    ASSERT_TRUE(motions.isOn());
    const auto& prescribed = motions.getPrescribed();
    ASSERT_EQ(prescribed.size(), 3u);
    EXPECT_EQ(prescribed.count(2), 0u);
    EXPECT_EQ(prescribed.at(3).components, 0b110100u);
    EXPECT_EQ(prescribed.at(3).zeros, 0b000100u);
    EXPECT_EQ(prescribed.at(3).names(), "vz, wy, wz");
    EXPECT_FALSE(prescribed.at(3).inBody);
    EXPECT_FALSE(prescribed.at(3).areAll());
    EXPECT_TRUE(prescribed.at(3) == prescribed.at(1));
    EXPECT_TRUE(prescribed.at(0).areAll());
    EXPECT_TRUE(prescribed.at(0).inBody);
    EXPECT_EQ(prescribed.at(0).force, 1);
    EXPECT_FALSE(prescribed.at(0) == prescribed.at(1));
    EXPECT_EQ(motions.describe(),
              "2 bodies: vz, wy, wz; body 0: vx, vy, vz, wx, wy, wz in the body frame");
    motions.evaluate(parameters, 0, values);
    MatrixXd expected = MatrixXd::Zero(6, 4);
    expected.col(0) << 1, 2, 3, 4, 5, 6;
    expected(4, 3) = 7;
    expected(4, 1) = -0.5;
    EXPECT_EQ(values, expected);
}

TEST_F(Motions, DependOnTimeAndParameters) {
    CustomBodyMotion& force = add({"a*sin(k*t); a=3", "", "", "", "", ""});
    force.addGlobalParameter("k", 2);
    force.addBody(2, {});
    EXPECT_TRUE(make().usesTime());
    BodyMotions motions = make();
    for (double t : {0.0, 0.3, 1.7}) {
        motions.evaluate(parameters, t, values);
        EXPECT_DOUBLE_EQ(values(0, 2), 3 * sin(2 * t));
    }
    parameters["k"] = -1;
    motions.evaluate(parameters, 0.5, values);
    EXPECT_DOUBLE_EQ(values(0, 2), 3 * sin(-0.5));
    force.setExpression("vx", "k");
    EXPECT_FALSE(make().usesTime());
    // Components that are free become 0, whatever was there.
    values.setConstant(9);
    motions.evaluate(parameters, 0, values);
    EXPECT_EQ(values, MatrixXd::Zero(6, 4));
}

TEST_F(Motions, NewParametersOfBodies) {
    CustomBodyMotion& force = add({"", "", "", "", "w", ""});
    force.addPerBodyParameter("w");
    force.addBody(0, {1});
    force.addBody(3, {2});
    BodyMotions motions = make();
    force.setBodyParameters(1, 3, {5});
    motions.evaluate(parameters, 0, values);
    EXPECT_EQ(values(4, 3), 2);
    auto& impl = dynamic_cast<CustomBodyMotionImpl&>(*impls[0]);
    impl.updateParametersInContext(implOf(*context));
    motions.evaluate(parameters, 0, values);
    EXPECT_EQ(values(4, 3), 5);
    EXPECT_EQ(values(4, 0), 1);
    force.setBodyParameters(1, 2, {5});
    expectError([&] { impl.updateParametersInContext(implOf(*context)); },
                {"CustomBodyMotion: updateParametersInContext(): the force acts on other bodies",
                 "call Context::reinitialize()"});
}

TEST_F(Motions, ValuesThatAreNotFinite) {
    CustomBodyMotion& force = add({"1", "", "", "", "1/(t-1)", ""});
    force.addGlobalParameter("k", 2);
    force.addBody(3, {});
    BodyMotions motions = make();
    motions.evaluate(parameters, 0.5, values);
    EXPECT_EQ(values(4, 3), -2);
    expectError([&] { motions.evaluate(parameters, 1, values); },
                {"CustomBodyMotion: force 0: wy of body 3 is inf at t = 1 ps",
                 "a prescribed velocity must be finite", "correct its expression"});
    motions.evaluate(parameters, 1.5, values);
    EXPECT_EQ(values(4, 3), 2);
    parameters["k"] = numeric_limits<double>::quiet_NaN();
    expectError([&] { motions.evaluate(parameters, 0, values); },
                {"CustomBodyMotion: the Context's parameter 'k' of force 0 is nan",
                 "set a finite value by setParameter()"});
}

TEST_F(Motions, OneMotionForEachBody) {
    add({"1", "", "", "", "", ""}).addBody(2, {});
    add({"", "1", "", "", "", ""}).addBody(2, {});
    expectError([&] { make(); },
                {"CustomBodyMotion: forces 0 and 1 both prescribe the motion of body 2",
                 "remove the body from one of them"});
}

TEST_F(Motions, SpinsAboutTheLineOfARod) {
    // Blobs on the y axis of the body, a marker beside it, and an origin off the line.
    BodyGeometry rod;
    rod.sites = {Vec3(0.3, 0, 1), Vec3(0.3, 1.5, 1), Vec3(2, 2, 2), Vec3(0.3, 4, 1)};
    BodyGeometry bent = rod;
    bent.sites[1] = Vec3(0.3, 1.5, 1 + 1e-6);
    const vector<vector<int>> particles = {{0, 1, 2, 3}};
    MobilityForce fluid;
    for (double radius : {0.5, 0.5, 0.0, 0.5}) fluid.addParticle(radius);
    CustomBodyMotion& force = add({"", "", "", "t", "t", "t"});
    force.addBody(0, {});
    make().checkSpins({rod}, particles, &fluid);  // lab frame
    force.setFrame(CustomBodyMotion::Body);
    const vector<string> message = {
        "CustomBodyMotion: force 0 prescribes wy of body 0, but all its hydrodynamic particles are "
        "on one line along this axis",
        "leave the component free by an empty expression, or prescribe 0"};
    expectError([&] { make().checkSpins({rod}, particles, &fluid); }, message);
    make().checkSpins({bent}, particles, &fluid);
    make().checkSpins({rod}, particles, nullptr);
    for (const string e : {"", "0", "1-1"}) {
        force.setExpression("wy", e);
        make().checkSpins({rod}, particles, &fluid);
    }
    force.setExpression("wy", "1");
    // A sphere takes torques about every axis, and a body with a tensor of its own does so.
    make().checkSpins({rod}, {{0}}, &fluid);
    fluid.setBodyFriction(0, rowsOf(MatrixXd::Identity(6, 6)));
    make().checkSpins({rod}, particles, &fluid);
    fluid.clearBodyTensor(0);
    expectError([&] { make().checkSpins({rod}, particles, &fluid); }, message);
}
