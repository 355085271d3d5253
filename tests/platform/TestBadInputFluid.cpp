// For every error that users may make with a MobilityForce and LangevinHI, the call throws an
// OpenMMException that names object, value, bound and remedy. (Wrong types and shapes are tested in
// tests/python/test_bad_input_fluid.py.)

#include <openmm/CMMotionRemover.h>
#include <openmm/CustomExternalForce.h>
#include <openmm/HarmonicBondForce.h>
#include <openmm/MonteCarloBarostat.h>
#include <openmm/VerletIntegrator.h>

#include <limits>

#include "HydrodynamicSupport.h"

using namespace OpenMM;
using namespace RigidHITest;
using namespace std;

namespace {

const double nan_ = numeric_limits<double>::quiet_NaN(),
             infinity = numeric_limits<double>::infinity();

vector<double> unitTensor() { return rowsOf(MatrixXd::Identity(6, 6)); }

/** Two spheres with valid settings, which a test then makes invalid. */
struct Pair : FluidScene {
    Pair() : FluidScene(0, 0.01) {
        add(sphereKind(0.5));
        add(sphereKind(0.5), Vec3(2, 0, 0));
    }
};

/** Expect an error when the Context is created (or, where geometry is not known before, given
 * positions). */
void expectRefused(FluidScene& scene, const vector<string>& fragments) {
    expectError([&] { scene.start(testPlatform()); }, fragments);
}

}  // namespace

TEST(BadFluid, Settings) {
    MobilityForce fluid;
    for (double bad : {-0.1, nan_, infinity}) {
        expectError([&] { fluid.addParticle(bad); },
                    {"particle 0: hydrodynamic radius is", "finite and not negative"});
        expectError([&] { fluid.setMinimumGap(bad); },
                    {"setMinimumGap()", "mean radii; it must be finite and not"});
    }
    EXPECT_EQ(fluid.getNumParticles(), 0);
    fluid.addParticle(0.5);
    expectError([&] { fluid.setParticleRadius(0, -1); }, {"particle 0", "-1 nm"});
    EXPECT_EQ(fluid.getParticleRadius(0), 0.5);
    for (int index : {-1, 1}) {
        expectError([&] { fluid.getParticleRadius(index); },
                    {"getParticleRadius(): particle index", "out of range"});
        expectError([&] { fluid.setParticleRadius(index, 1); },
                    {"setParticleRadius(): particle index", "out of range"});
    }
    for (double bad : {0.0, -1.0, nan_, infinity})
        expectError([&] { fluid.setViscosity(bad); },
                    {"setViscosity()", "dalton/(nm ps); it must be finite and positive"});
    for (double bad : {0.0, 1e-15, 0.2, nan_, infinity, -1e-6})
        expectError([&] { fluid.setSolverTolerance(bad); },
                    {"tolerance is", "it must be between 1e-14 and 0.1"});
    for (int bad : {-1, 17}) {
        expectError(
            [&] { fluid.setModel(static_cast<MobilityForce::Model>(bad)); },
            {"model " + to_string(bad), "it must be one of FreeDraining, RotnePragerYamakawa"});
        expectError([&] { fluid.setBoundary(static_cast<MobilityForce::Boundary>(bad)); },
                    {"setBoundary()", "boundary " + to_string(bad) + " is unknown",
                     "it must be one of Unbounded, NoSlipWall"});
        expectError([&] { fluid.setSolver(static_cast<MobilityForce::Solver>(bad)); },
                    {"solver " + to_string(bad), "it must be one of Auto, Dense, MatrixFree"});
    }
    expectError(
        [&] {
            fluid.setGroups({0, 1, -2});
        },
        {"body 2", "its group is -2; groups are numbered from 0"});
    EXPECT_TRUE(fluid.getGroups().empty());
}

TEST(BadFluid, Tensors) {
    MobilityForce fluid;
    for (bool friction : {false, true}) {
        const auto set = [&](int body, const vector<double>& tensor) {
            friction ? fluid.setBodyFriction(body, tensor) : fluid.setBodyMobility(body, tensor);
        };
        expectError([&] { set(-1, unitTensor()); },
                    {"body index -1 is negative; bodies are counted from 0"});
        expectError([&] { set(0, vector<double>(35, 1)); },
                    {"body 0", "its tensor has 35 numbers; it must be 6 x 6"});
        vector<double> tensor = unitTensor();
        tensor[1] = nan_;
        expectError([&] { set(3, tensor); },
                    {"body 3: its tensor has an entry nan", "all entries must be finite"});
        tensor = unitTensor();
        tensor[1] = 0.1;
        expectError([&] { set(3, tensor); }, {"its tensor is not symmetric",
                                              "(1, 0) and (0, 1) are 0 and 0.1", "agree to 1e-9"});
        tensor[1] = tensor[6] = 1.5;
        expectError(
            [&] { set(3, tensor); },
            {"its tensor is not positive definite; the motion of a body must dissipate energy"});
        tensor = unitTensor();
        tensor[35] = 0;
        expectError([&] { set(3, tensor); }, {"not positive definite"});
        tensor[35] = -1;
        expectError([&] { set(3, tensor); }, {"not positive definite"});
    }
    EXPECT_FALSE(fluid.getBodyHasOwnTensor(3));
    for (auto ask : {+[](MobilityForce& f) { f.getBodyMobility(3); },
                     +[](MobilityForce& f) { f.getBodyFriction(3); },
                     +[](MobilityForce& f) { f.getBodyTensorIsFriction(3); }})
        expectError(
            [&] { ask(fluid); },
            {"body 3 has no tensor of its own; only tensors that were set can be returned"});
}

TEST(BadFluid, RadiiAndGroupsOfAnotherNumber) {
    Pair tooMany, tooFew, groups, tensor;
    tooMany.fluid->addParticle(1);
    expectRefused(tooMany,
                  {"3 radii, but the System has 2", "call addParticle() once for each particle"});
    tooFew.system.addParticle(0);
    tooFew.positions.push_back(Vec3());
    expectRefused(tooFew, {"2 radii, but the System has 3"});
    groups.fluid->setGroups({0, 0, 1});
    expectRefused(groups, {"setGroups() was given 3 groups, but the integrator has 2 bodies"});
    tensor.fluid->setBodyMobility(2, unitTensor());
    expectRefused(tensor,
                  {"body 2 was given a tensor of its own, but the integrator has 2 bodies"});
}

TEST(BadFluid, BodiesAndParticlesThatTheFluidCannotTake) {
    Pair unseen, massless, line;
    unseen.fluid->setParticleRadius(1, 0);
    expectRefused(unseen,
                  {"body 1 has no particle with a hydrodynamic radius", "give at least one"});
    massless.addFree(0, 0.4, Vec3(0, 3, 0));
    expectRefused(massless,
                  {"particle 2 has hydrodynamic radius 0.4", "is in no body and has no mass"});
    BodyKind rod = rodKind();
    rod.moments[2] = 0.01;
    line.add(rod, Vec3(0, 5, 0));
    expectRefused(line, {"body 2: its hydrodynamic particles lie on a line",
                         "the body has a moment of inertia about the line"});
    // The line must be the axis without inertia, and it must go through the centre of mass.
    Pair shifted, askew;
    rod = rodKind();
    for (Vec3& site : rod.sites) site += Vec3(0.1, 0, 0);
    shifted.add(rod, Vec3(0, 5, 0));
    expectRefused(shifted, {"lie on a line"});
    rod = rodKind();
    rod.moments = Vec3(0, 0.9, 0.9);
    askew.add(rod, Vec3(0, 5, 0));
    expectRefused(askew, {"lie on a line"});
    // Free draining refuses the body too.
    Pair draining;
    draining.fluid->setModel(MobilityForce::FreeDraining);
    draining.add(rod, Vec3(0, 5, 0));
    expectRefused(draining, {"lie on a line"});
    // An own tensor cannot be combined with the mobility of the blobs, which has no part about the
    // line.
    Pair own;
    own.add(rodKind(), Vec3(0, 5, 0));
    own.fluid->setBodyFriction(2, unitTensor());
    expectRefused(own, {"body 2 was given a tensor of its own", "lie on a line"});
}

namespace {

/** A body of two blobs at one place beside a third one. It is turned and moved at random, so that
 * rounding differs from seed to seed. */
BodyKind twinKind(int seed, double distance = 0, double otherRadius = 0.5) {
    mt19937 generator(seed);
    uniform_real_distribution<double> u(-1, 1);
    BodyKind kind = boomerangKind();
    const QuaternionArray q = randomQuaternion(generator);
    const Vec3 shift(u(generator), u(generator), u(generator));
    for (Vec3& site : kind.sites) site = rotate(q, site) + shift;
    kind.radii[3] = otherRadius;
    kind.sites[3] = kind.sites[0] + rotate(q, Vec3(distance, 0, 0));
    return kind;
}

const vector<MobilityForce::Solver> solvers = {MobilityForce::Dense, MobilityForce::MatrixFree};

}  // namespace

TEST(BadFluid, BlobsOfABodyAtOnePlaceAreRefusedWithItsShape) {
    for (auto solver : solvers)
        for (int seed = 0; seed < 200; seed++) {
            // The two blobs are at exactly one place, or apart by rounding or a little more. The
            // bound is 1e-6 of the radius.
            const double distance = seed % 4 == 0   ? 0
                                    : seed % 4 == 1 ? 1e-16
                                    : seed % 4 == 2 ? 1e-10
                                                    : 0.499e-6;
            FluidScene scene;
            scene.add(sphereKind(0.5));
            scene.add(twinKind(seed, distance), Vec3(0, 5, 0));
            scene.fluid->setSolver(solver);
            expectError(
                [&] { Context context(scene.system, scene.integrator, testPlatform()); },
                {"particle 1 (body 1) and particle 4 (body 1), both of radius 0.5 nm, are at the "
                 "same place",
                 "5e-07 nm, 1e-6 of the radius, is the least", "give one of them the radius 0"});
        }
}

TEST(BadFluid, BlobsOfABodyNearEachOtherOrOfOtherRadiiAreTaken) {
    for (auto solver : solvers)
        for (int seed = 0; seed < 20; seed++)
            for (bool concentric : {false, true}) {
                FluidScene scene;
                scene.add(sphereKind(0.5));
                scene.add(
                    concentric ? twinKind(seed, 0, 0.5 * (1 + 2e-6)) : twinKind(seed, 0.51e-6),
                    Vec3(0, 5, 0));
                scene.fluid->setSolver(solver);
                scene.start(testPlatform());
                // A second blob at the same place adds nothing to its own body.
                FluidScene single;
                single.add(sphereKind(0.5));
                BodyKind kind = twinKind(seed, 0);
                kind.radii[3] = 0;
                single.add(kind, Vec3(0, 5, 0));
                single.start(testPlatform());
                EXPECT_LT(difference(scene.mobility(), single.mobility()), 1e-5);
                scene.integrator.setBodyVelocities({Vec3(1, 0, 0), Vec3(0, 1, 0)});
                scene.integrator.step(1);
            }
}

TEST(BadFluid, BlobsThatAreAllAtOnePlace) {
    for (double distance : {0.0, 1e-16, 4e-7}) {
        FluidScene scene;
        scene.add({"concentric",
                   1,
                   Vec3(1, 1, 1),
                   {Vec3(0.1, 0.2, 0.3), Vec3(0.1, 0.2, 0.3 + distance)},
                   {0.5, 0.4}});
        expectRefused(scene, {"body 0: its 2 hydrodynamic particles are all at one place",
                              "do not resist rotation", "which makes the body a sphere"});
    }
}

TEST(BadFluid, SpheresAndFreeParticlesAtOnePlaceAreNamed) {
    for (auto scheme : {CustomRigidHIIntegrator::LangevinHI, CustomRigidHIIntegrator::EulerMaruyama,
                        CustomRigidHIIntegrator::FixmanMidpoint})
        for (auto solver : solvers)
            for (double distance : {0.0, 1e-17, 1e-12, 0.49e-6})
                for (bool free : {false, true}) {
                    FluidScene scene(300, 0.01);
                    scene.integrator.setScheme(scheme);
                    scene.fluid->setSolver(solver);
                    scene.add(sphereKind(0.5), Vec3(4, 0, 0));
                    scene.add(sphereKind(0.5), Vec3(1, 1.3, -0.7));
                    if (free)
                        scene.addFree(1, 0.5, Vec3(1 + distance, 1.3, -0.7));
                    else
                        scene.add(sphereKind(0.5), Vec3(1 + distance, 1.3, -0.7));
                    scene.start(testPlatform());
                    const vector<string> fragments = {
                        "particle 1 (body 1) and particle 2 " +
                            string(free ? "(in no body)" : "(body 2)") +
                            ", both of radius 0.5 nm, are at the same place",
                        "move one of them"};
                    expectError([&] { scene.integrator.step(1); }, fragments);
                    expectError([&] { scene.mobility(); }, fragments);
                    expectError([&] { scene.friction(); }, fragments);
                    expectError(
                        [&] {
                            scene.fluid->applyMobilityInContext(*scene.context,
                                                                vector<double>(6 * (2 + !free)));
                        },
                        fragments);
                    // The Context keeps its state, and goes on from another.
                    auto R = scene.integrator.getBodyPositions();
                    EXPECT_EQ(R[1], Vec3(1, 1.3, -0.7));
                    R[1] = Vec3(1, 3, 0);
                    scene.integrator.setBodyPositions(R);
                    scene.integrator.step(1);
                }
}

TEST(BadFluid, ParticlesAtOnePlaceThatDoNotFeelEachOther) {
    // Particles at one place do not make a matrix singular if they are replicas, under free
    // draining, or if their radii differ.
    FluidScene groups, draining, radii;
    for (FluidScene* scene : {&groups, &draining, &radii})
        for (int b = 0; b < 2; b++)
            scene->add(sphereKind(scene == &radii ? 0.5 + 0.1 * b : 0.5), Vec3(1, 1, 1));
    groups.fluid->setGroups({0, 1});
    draining.fluid->setModel(MobilityForce::FreeDraining);
    for (FluidScene* scene : {&groups, &draining, &radii}) {
        scene->start(testPlatform());
        scene->integrator.setBodyVelocities({Vec3(1, 0, 0), Vec3(0, 1, 0)});
        scene->integrator.step(2);
    }
}

TEST(BadFluid, ErrorsInOneOfManyGroupsReachTheUser) {
    // The error may be thrown on another thread.
    FluidScene scene(0, 0.01);
    vector<int> groups;
    for (int g = 0; g < 6; g++)
        for (int b = 0; b < 2; b++) {
            scene.add(sphereKind(0.5), Vec3(5 * g, g == 5 ? 0 : 2 * b, 0));
            groups.push_back(g);
        }
    scene.fluid->setGroups(groups);
    scene.start(testPlatform(), 2);
    expectError([&] { scene.integrator.step(1); },
                {"particle 10 (body 10) and particle 11 (body 11)"});
}

TEST(BadFluid, WhatStokesianDynamicsCannotTake) {
    Pair overlapping, tensor, multiblob, ratio, free;
    for (Pair* pair : {&overlapping, &tensor, &multiblob, &ratio, &free})
        pair->fluid->setModel(MobilityForce::StokesianDynamics);
    overlapping.start(testPlatform());
    overlapping.integrator.setBodyPositions({Vec3(), Vec3(0.9, 0, 0)});
    for (const auto& action : {function<void()>([&] { overlapping.mobility(); }),
                               function<void()>([&] { overlapping.integrator.step(1); })})
        expectError(action, {"body 0", "body 1",
                             "; separate the particles, allow overlap by setMinimumGap()"});
    overlapping.integrator.setBodyPositions({Vec3(), Vec3(1.1, 0, 0)});
    overlapping.integrator.step(1);
    tensor.fluid->setBodyMobility(1, unitTensor());
    expectRefused(tensor,
                  {"body 1", "which model StokesianDynamics cannot take; use RotnePragerYamakawa"});
    multiblob.add(boomerangKind(), Vec3(0, 4, 0));
    expectRefused(multiblob, {"StokesianDynamics", "body 2"});
    ratio.add(sphereKind(20), Vec3(0, 40, 0));
    expectRefused(ratio, {"StokesianDynamics", "have the ratio 40"});
    free.addFree(1, 0.5, Vec3(0, 4, 0));
    expectRefused(free, {"StokesianDynamics is a model of spheres that rotate", "particle 2"});
}

TEST(BadFluid, MatrixFreeWhereItCannotBe) {
    Pair model, dead;
    for (Pair* pair : {&model, &dead}) pair->fluid->setSolver(MobilityForce::MatrixFree);
    model.fluid->setModel(MobilityForce::StokesianDynamics);
    expectRefused(model, {"solver MatrixFree cannot be used with model ", "StokesianDynamics",
                          "; use setSolver(Dense), or setModel(RotnePragerYamakawa)"});
    dead.add({"linear sphere", 1, Vec3(1, 1, 0), {Vec3()}, {0.4}}, Vec3(0, 4, 0));
    expectRefused(dead, {"solver MatrixFree", "has a principal moment of 0"});
}

TEST(BadFluid, StepsThatEndInOverlapUnderStokesianDynamics) {
    // The spheres are pushed together so hard, in so thin a fluid, that the step ends in overlap
    // whatever the noise.
    for (double temperature : {0.0, 1e-6}) {
        FluidScene scene(temperature, 0.1);
        scene.fluid->setModel(MobilityForce::StokesianDynamics);
        scene.fluid->setViscosity(1e-4);
        for (double x : {-0.75, 0.75}) scene.add(sphereKind(0.5), Vec3(x, 0, 0));
        auto* field = new CustomExternalForce("60*abs(x)");
        for (int p = 0; p < 2; p++) field->addParticle(p, {});
        scene.system.addForce(field);
        scene.integrator.setMaximumRejections(7);
        scene.start(testPlatform());
        const auto before = positionsOf(*scene.context);
        expectError([&] { scene.integrator.step(1); },
                    {temperature == 0 ? "at temperature 0 there is no noise"
                                      : "the step was redone 7 times in a row, as often as "
                                        "setMaximumRejections() allows",
                     "body 0", "body 1"});
        EXPECT_TRUE(sameBits(positionsOf(*scene.context), before));
        EXPECT_EQ(scene.integrator.getNumRejectedSteps(), temperature == 0 ? 1 : 8);
        // With a smaller step the spheres do not overlap.
        scene.integrator.setStepSize(0.001);
        scene.integrator.step(2);
    }
    CustomRigidHIIntegrator integrator(300, 0.001);
    for (int bad : {-1, 65536})
        expectError([&] { integrator.setMaximumRejections(bad); },
                    {"the number is " + to_string(bad), "it must be from 0 to 65535"});
    integrator.setMaximumRejections(65535);
    EXPECT_EQ(integrator.getMaximumRejections(), 65535);
}

TEST(BadFluid, Integrators) {
    System system;
    system.addParticle(1);
    auto* fluid = new MobilityForce();
    fluid->addParticle(1);
    system.addForce(fluid);
    VerletIntegrator verlet(0.001);
    expectError([&] { Context context(system, verlet, testPlatform()); },
                {"its integrator is not a CustomRigidHIIntegrator; another integrator would ignore "
                 "the fluid"});
    for (auto scheme : thermostats()) {
        Pair pair;
        pair.integrator.setScheme(scheme);
        expectRefused(
            pair, {"the System has a MobilityForce, which scheme", "would ignore; use LangevinHI"});
    }
}

TEST(BadFluid, OneMobilityForceExactly) {
    Pair two, none;
    auto* second = new MobilityForce();
    for (int i = 0; i < 2; i++) second->addParticle(1);
    two.system.addForce(second);
    expectRefused(two, {"2 MobilityForces", "LangevinHI needs exactly one"});
    none.removeFluid();
    expectRefused(none, {"0 MobilityForces", "LangevinHI needs exactly one; add a MobilityForce"});
}

TEST(BadFluid, ForcesThatDoNotGoWithIt) {
    Pair moving, pressed;
    moving.system.addForce(new CMMotionRemover());
    expectRefused(
        moving, {"CMMotionRemover", "LangevinHI", "the fluid exchanges momentum with the bodies"});
    pressed.system.addForce(new MonteCarloBarostat(1, 300));
    auto* periodic = new HarmonicBondForce();  // or OpenMM refuses the barostat first
    periodic->setUsesPeriodicBoundaryConditions(true);
    pressed.system.addForce(periodic);
    expectRefused(pressed, {"a MonteCarloBarostat, which scheme LangevinHI does not support: the "
                            "fluid has no pressure"});
}

TEST(BadFluid, ConstraintsOfFreeParticles) {
    for (bool seen : {false, true}) {
        Pair pair;
        for (int i = 0; i < 2; i++)
            pair.addFree(1, seen && i == 1 ? 0.3 : 0, Vec3(0, 3 + 0.5 * i, 0));
        pair.system.addConstraint(2, 3, 0.5);
        if (seen)
            expectRefused(pair, {"constraint 0 holds particle 3", "has a hydrodynamic radius",
                                 "set the radius of the particle to 0"});
        else {
            pair.start(testPlatform());
            pair.integrator.step(1);
        }
    }
}

TEST(BadFluid, QuestionsWithoutAContextOrPositions) {
    Pair pair, other;
    other.start(testPlatform());
    EXPECT_THROW(pair.fluid->getMobilityInContext(*other.context), OpenMMException);
    EXPECT_THROW(pair.fluid->getFrictionInContext(*other.context), OpenMMException);
    EXPECT_THROW(pair.fluid->applyMobilityInContext(*other.context, vector<double>(12)),
                 OpenMMException);
    EXPECT_THROW(pair.fluid->updateParametersInContext(*other.context), OpenMMException);
    pair.context = make_unique<Context>(pair.system, pair.integrator, testPlatform());
    expectError([&] { pair.mobility(); }, {"getMobilityInContext() needs positions"});
    expectError([&] { pair.friction(); }, {"getFrictionInContext() needs positions"});
    expectError([&] { pair.fluid->applyMobilityInContext(*pair.context, vector<double>(12)); },
                {"applyMobilityInContext() needs positions"});
}

namespace {

/** Two bodies of two particles, whose shapes are defined by the first positions. */
struct Shapeless {
    System system;
    MobilityForce* fluid = new MobilityForce();
    CustomRigidHIIntegrator integrator{0, 0.01};
    explicit Shapeless(bool multiblobs = true) {
        system.addForce(fluid);
        integrator.setScheme(CustomRigidHIIntegrator::FixmanMidpoint);
        for (int p = 0; p < 4; p++) {
            system.addParticle(1.0);
            fluid->addParticle(multiblobs || p % 2 == 0 ? 0.5 : 0);
        }
        for (int b = 0; b < 2; b++) integrator.addRigidBody({2 * b, 2 * b + 1});
    }
};

}  // namespace

TEST(BadFluid, WhatNeedsNoPositionsIsRefusedBeforeThem) {
    const struct {
        bool multiblobs;
        function<void(MobilityForce&)> spoil;
        vector<string> fragments;
    } cases[] = {
        {true, [](MobilityForce& f) { f.addParticle(1); }, {"5 radii, but the System has 4"}},
        {true, [](MobilityForce& f) { f.setGroups({0}); }, {"setGroups() was given 1 groups"}},
        {true,
         [](MobilityForce& f) { f.setBodyMobility(2, unitTensor()); },
         {"body 2 was given a tensor of its own"}},
        {false,
         [](MobilityForce& f) { f.setParticleRadius(2, 0); },
         {"body 1 has no particle with a hydrodynamic"}},
        {true,
         [](MobilityForce& f) { f.setModel(MobilityForce::StokesianDynamics); },
         {"a model of spheres that rotate"}},
        {false,
         [](MobilityForce& f) {
             f.setModel(MobilityForce::StokesianDynamics);
             f.setSolver(MobilityForce::MatrixFree);
         },
         {"solver MatrixFree cannot be used with", "model StokesianDynamics"}},
        {false,
         [](MobilityForce& f) {
             f.setModel(MobilityForce::StokesianDynamics);
             f.setParticleRadius(0, 20);
         },
         {"have the ratio 40"}},
        {false,
         [](MobilityForce& f) {
             f.setModel(MobilityForce::StokesianDynamics);
             f.setBodyMobility(0, unitTensor());
         },
         {"StokesianDynamics cannot take"}},
        {true,
         [](MobilityForce& f) {
             f.setModel(MobilityForce::StokesianDynamics);
             f.setBoundary(MobilityForce::NoSlipWall);
         },
         {"boundary NoSlipWall can be used with"}},
        {true,
         [](MobilityForce& f) { f.setModel(MobilityForce::ForceCoupling); },
         {"boundary Unbounded can be used with the model FreeDraining or RotnePragerYamakawa or "
          "StokesianDynamics",
          "not with ForceCoupling; use setModel(",
          "or setBoundary(Periodic or SlipChannel or PeriodicWall"}},
        {true,
         [](MobilityForce& f) {
             f.setModel(MobilityForce::FreeDraining);
             f.setBoundary(MobilityForce::NoSlipWall);
         },
         {"not with FreeDraining; use setModel(", "or setBoundary(Unbounded or Periodic)"}},
        {true,
         [](MobilityForce& f) {
             f.setModel(MobilityForce::ForceCoupling);
             f.setBoundary(MobilityForce::NoSlipWall);
         },
         {"boundary NoSlipWall can be used with the model RotnePragerYamakawa, not with "
          "ForceCoupling",
          "or setBoundary(Periodic or SlipChannel or PeriodicWall"}},
        {true,
         [](MobilityForce& f) { f.setBoundary(MobilityForce::Periodic); },
         {"body 0", "are in different molecules", "bindBodies"}},
    };
    for (const auto& c : cases) {
        Shapeless scene(c.multiblobs);
        c.spoil(*scene.fluid);
        expectError([&] { Context context(scene.system, scene.integrator, testPlatform()); },
                    c.fragments);
    }
}

TEST(BadFluid, ParametersHandedOverBeforePositionsAreChecked) {
    Shapeless scene(false);
    scene.fluid->setModel(MobilityForce::StokesianDynamics);
    Context context(scene.system, scene.integrator, testPlatform());
    const auto update = [&] { scene.fluid->updateParametersInContext(context); };
    scene.fluid->setSolver(MobilityForce::MatrixFree);
    expectError(update, {"solver MatrixFree cannot be used with"});
    scene.fluid->setSolver(MobilityForce::Dense);
    scene.fluid->setParticleRadius(0, 20);
    expectError(update, {"have the ratio 40"});
    scene.fluid->setParticleRadius(0, 0.5);
    scene.fluid->setBodyMobility(1, unitTensor());
    expectError(update, {"StokesianDynamics cannot take"});
    // The Context has the parameters that it was created with.
    context.setPositions({Vec3(), Vec3(0.5, 0, 0), Vec3(0, 3, 0), Vec3(0.5, 3, 0)});
    scene.integrator.step(1);
}

TEST(BadFluid, QuestionsToAContextOfAnotherIntegratorAreErrors) {
    // The Force belongs to no Context with this integrator.
    System system;
    system.addParticle(1);
    VerletIntegrator verlet(0.001);
    Context context(system, verlet, testPlatform());
    MobilityForce fluid;
    fluid.addParticle(1);
    EXPECT_THROW(fluid.getMobilityInContext(context), OpenMMException);
    EXPECT_THROW(fluid.updateParametersInContext(context), OpenMMException);
    // The Force does not belong to a Context without any MobilityForce either.
    CustomRigidHIIntegrator integrator(300, 0.001);
    Context own(system, integrator, testPlatform());
    own.setPositions({Vec3()});
    EXPECT_THROW(fluid.getMobilityInContext(own), OpenMMException);
    EXPECT_THROW(fluid.updateParametersInContext(own), OpenMMException);
}

TEST(BadFluid, Wrenches) {
    Pair pair;
    pair.start(testPlatform());
    for (int size : {0, 6, 11, 18})
        expectError(
            [&] { pair.fluid->applyMobilityInContext(*pair.context, vector<double>(size)); },
            {"was given " + to_string(size) + " numbers, but the Context has 2 bodies"});
    vector<double> wrenches(12);
    wrenches[7] = nan_;
    expectError([&] { pair.fluid->applyMobilityInContext(*pair.context, wrenches); },
                {"the wrench of body 1 is not finite"});
}

TEST(BadFluid, ChangesThatNeedANewContext) {
    Pair pair;
    pair.start(testPlatform());
    const MatrixXd before = pair.mobility();
    const auto update = [&] { pair.fluid->updateParametersInContext(*pair.context); };
    pair.fluid->setModel(MobilityForce::FreeDraining);
    expectError(update, {"cannot change the model or boundary of a MobilityForce", "reinitialize"});
    pair.fluid->setModel(MobilityForce::RotnePragerYamakawa);
    pair.fluid->setGroups({0, 1});
    expectError(update, {"cannot change the groups of a MobilityForce"});
    pair.fluid->setGroups({});
    pair.fluid->setParticleRadius(0, 0);
    expectError(update, {"particle 0: updateParametersInContext() cannot change its hydrodynamic "
                         "radius between 0 and a positive value"});
    pair.fluid->setParticleRadius(0, 0.5);
    pair.fluid->setBodyMobility(2, unitTensor());
    expectError(update, {"body 2 was given a tensor of its own"});
    pair.fluid->clearBodyTensor(2);
    pair.fluid->addParticle(1);
    expectError(update, {"cannot change the number of particles of a MobilityForce"});
    // A refused change leaves the Context as it was, able to go on.
    EXPECT_EQ(pair.mobility(), before);
    pair.integrator.step(2);
    pair.integrator.setTemperature(10);
    pair.integrator.step(2);
}

TEST(BadFluid, RefusedChangesLeaveTheFluidAsItWas) {
    // This change is refused only after the new fluid was made, because the scheme checks inertia.
    FluidScene scene(0, 0.01);
    scene.fluid->setModel(MobilityForce::FreeDraining);
    BodyKind rod = rodKind();
    rod.moments[2] = 0.1;
    scene.add(rod);
    scene.fluid->setBodyMobility(0, unitTensor());
    scene.start(testPlatform());
    scene.integrator.step(1);
    const MatrixXd before = scene.mobility();
    scene.fluid->clearBodyTensor(0);
    expectError([&] { scene.fluid->updateParametersInContext(*scene.context); }, {"lie on a line"});
    EXPECT_EQ(scene.mobility(), before);
    scene.integrator.step(1);
}

TEST(BadFluid, StepsThatAreNotFiniteLeaveTheLastGoodState) {
    FluidScene scene(0, 0.01);
    scene.add(boomerangKind());
    scene.add(sphereKind(0.5), Vec3(4, 0, 0));
    auto* field = new CustomExternalForce("1/(x-100)^2*strength");
    field->addGlobalParameter("strength", 1);
    field->addParticle(0, {});
    scene.system.addForce(field);
    scene.start(testPlatform());
    scene.integrator.step(2);
    const auto before = positionsOf(*scene.context);
    scene.context->setParameter("strength", 1e308);
    scene.context->setParameter("strength", infinity);
    expectError([&] { scene.integrator.step(1); }, {"non-finite"});
    EXPECT_TRUE(sameBits(positionsOf(*scene.context), before));
    scene.context->setParameter("strength", 1);
    scene.integrator.step(1);
}

TEST(BadFluid, ForcesAlongARodThatCancelAreNoTorque) {
    // The wrench on the rod consists of rounding errors only, in any direction. It must not be
    // taken for a torque about the line.
    for (int seed = 0; seed < 20; seed++) {
        Pair rod;
        mt19937 generator(seed);
        const QuaternionArray q = randomQuaternion(generator);
        const Vec3 line = rotate(q, Vec3(0, 0, 1)) * 137.0;
        rod.add(rodKind(), Vec3(0.3, 5, 0.7), q);
        auto* stretch = new CustomExternalForce("-side*(fx*x+fy*y+fz*z)");
        stretch->addPerParticleParameter("side");
        stretch->addGlobalParameter("fx", line[0]);
        stretch->addGlobalParameter("fy", line[1]);
        stretch->addGlobalParameter("fz", line[2]);
        stretch->addParticle(rod.particles[2].front(), {-1.0});
        stretch->addParticle(rod.particles[2].back(), {1.0});
        rod.system.addForce(stretch);
        rod.start(testPlatform());
        rod.integrator.step(20);
    }
}

TEST(BadFluid, TorquesAboutTheLineOfARod) {
    // Neither the fluid nor inertia resists a turn about the line. A force pulls the marker off the
    // line, which the fluid does not see.
    Pair rod;
    BodyKind marked = rodKind();
    marked.sites.push_back(Vec3(0.3, 0, 0.2));
    marked.radii.push_back(0);
    rod.add(marked, Vec3(0, 5, 0));
    const int body = 2;
    auto* pull = new CustomExternalForce("-pull*y");
    pull->addGlobalParameter("pull", 0);
    pull->addParticle(rod.particles[body].back(), {});
    rod.system.addForce(pull);
    rod.start(testPlatform());
    rod.integrator.step(2);
    const vector<Vec3> before = positionsOf(*rod.context);
    rod.context->setParameter("pull", 1);
    expectError([&] { rod.integrator.step(1); }, {"body " + to_string(body) + ": a torque of",
                                                  "about the line of its hydrodynamic particles"});
    EXPECT_TRUE(sameBits(before, positionsOf(*rod.context)));
    vector<double> wrenches(6 * (body + 1), 0.0);
    wrenches[6 * body + 5] = 1;  // the rod lies along z
    expectError([&] { rod.fluid->applyMobilityInContext(*rod.context, wrenches); },
                {"body " + to_string(body) + ": a torque of 1 kJ/mol", "off the line"});
    wrenches[6 * body + 5] = 0;
    wrenches[6 * body + 3] = 1;
    EXPECT_GT(rod.fluid->applyMobilityInContext(*rod.context, wrenches)[6 * body + 3], 0);
}
