// Periodic fluids in a Context: every step uses the box of the Context, particles that do not fit
// into the box are refused, and schemes have the mobility in this box.

#include <openmm/CustomExternalForce.h>
#include <openmm/HarmonicBondForce.h>
#include <openmm/MonteCarloBarostat.h>

#include "HydrodynamicSupport.h"
#include "mobility/models/periodic/PeriodicMobility.h"

using namespace OpenMM;
using namespace RigidHITest;
using namespace std;

namespace {

using RigidHI = CustomRigidHIIntegrator;

struct Box {
    Vec3 a, b, c;
};
const Box small = {Vec3(6, 0, 0), Vec3(0, 6.5, 0), Vec3(0, 0, 7)},
          large = {Vec3(11, 0, 0), Vec3(2, 10, 0), Vec3(-3, 1, 9)};
void setBox(FluidScene& scene, const Box& box) {
    scene.context->setPeriodicBoxVectors(box.a, box.b, box.c);
}

struct PeriodicScene : FluidScene {
    explicit PeriodicScene(double temperature = 0, double h = 0.01,
                           RigidHI::Scheme scheme = RigidHI::LangevinHI,
                           MobilityForce::Model model = MobilityForce::RotnePragerYamakawa)
        : FluidScene(temperature, h) {
        fluid->setBoundary(MobilityForce::Periodic);
        fluid->setModel(model);
        integrator.setScheme(scheme);
    }
    /** Spheres, and where the model takes it a multiblob, pulled. */
    void addBodies() {
        add(sphereKind(1), Vec3(0, 0, 0));
        add(sphereKind(0.6), Vec3(2.1, 0.3, 0.2));
        if (fluid->getModel() != MobilityForce::StokesianDynamics)
            add(boomerangKind(), Vec3(-1, 2.5, 2.4));
        auto* pull = new CustomExternalForce("0.7*x-0.4*y+0.2*z*z");
        for (int i = 0; i < system.getNumParticles(); i++) pull->addParticle(i, vector<double>());
        system.addForce(pull);
    }
};
const MobilityForce::Model models[] = {MobilityForce::RotnePragerYamakawa,
                                       MobilityForce::StokesianDynamics,
                                       MobilityForce::ForceCoupling};
const RigidHI::Scheme schemes[] = {RigidHI::LangevinHI, RigidHI::EulerMaruyama,
                                   RigidHI::TrapezoidalSlip, RigidHI::DriftCorrectorFD};

}  // namespace

TEST(Periodic, TheBoxOfAStepIsThatOfTheContextWhenItBegins) {
    // After a change of the box the step is, bit for bit, that of a Context that always had this
    // box.
    for (auto model : models)
        for (auto scheme : schemes) {
            PeriodicScene changed(0.1 * T1, 0.01, scheme, model),
                always(0.1 * T1, 0.01, scheme, model);
            for (PeriodicScene* scene : {&changed, &always}) {
                scene->addBodies();
                scene->start(testPlatform());
            }
            changed.mobility();
            setBox(changed, large);
            setBox(always, large);
            EXPECT_EQ(changed.mobility(), always.mobility());
            changed.integrator.step(1);
            always.integrator.step(1);
            EXPECT_EQ(changed.state(), always.state());
            // The same holds after further steps, because the noise is that of the step number.
            setBox(changed, small);
            const MatrixXd inSmall = changed.mobility();
            EXPECT_GT(difference(inSmall, always.mobility()), 1e-3);
            setBox(always, small);
            EXPECT_EQ(always.mobility(), inSmall);
            changed.integrator.step(2);
            always.integrator.step(2);
            EXPECT_EQ(changed.state(), always.state());
        }
}

TEST(Periodic, StepsFollowTheMobilityOfTheBox) {
    // Without noise, one step of EulerMaruyama moves bodies by the mobility of each box.
    for (auto model : models) {
        PeriodicScene scene(0, 1e-4, RigidHI::EulerMaruyama, model);
        scene.addBodies();
        scene.start(testPlatform());
        const vector<Vec3> R = scene.integrator.getBodyPositions();
        const auto q = scene.integrator.getBodyOrientations();
        for (const Box& box : {small, large, small}) {
            setBox(scene, box);
            scene.pose(R, q);
            const MatrixXd N = scene.mobility();
            scene.integrator.step(1);
            const auto moved = scene.integrator.getBodyPositions(),
                       F = scene.integrator.getBodyForces(), T = scene.integrator.getBodyTorques();
            VectorXd wrenches(N.rows());
            for (size_t b = 0; b < R.size(); b++)
                wrenches.segment<6>(6 * b) << toEigen(F[b]), toEigen(T[b]);
            const VectorXd U = N * wrenches;
            for (size_t b = 0; b < R.size(); b++)
                EXPECT_LT((toEigen(moved[b] - R[b]) / 1e-4 - U.segment<3>(6 * b)).norm(),
                          1e-9 * U.norm());
        }
    }
}

TEST(Periodic, ResumesInTheBoxThatItHad) {
    for (auto scheme : schemes) {
        const auto start = [&](int threads) {
            auto scene = make_unique<PeriodicScene>(T1, 0.002, scheme);
            scene->addBodies();
            scene->start(testPlatform(), threads);
            return scene;
        };
        const auto toAnotherBox = [](PeriodicScene& scene) {
            scene.integrator.step(2);
            setBox(scene, small);
            scene.integrator.step(2);
        };
        expectToResumeBitForBit<PeriodicScene>(start, toAnotherBox, 3);
    }
}

TEST(Periodic, BodiesThatOverlapTheirOwnImagesAreRefused) {
    const struct {
        bool blobs;
        double side;
        vector<string> fragments;
    } cases[] = {
        {false,
         1.9,
         {"body 1 has the length 2 nm, hydrodynamic radii included", "would overlap its own image",
          "the periodic box (1.9, 0, 0), (0, 1.9, 0), (0, 0, 1.9) nm",
          "the shortest lattice vector has the length 1.9 nm", "setPeriodicBoxVectors()"}},
        {true,
         2.9,
         {"body 0 has the length 3", "the shortest lattice vector has the length 2.9 nm"}}};
    for (const auto& c : cases)
        for (auto scheme : schemes) {
            PeriodicScene scene(0, 0.001, scheme);
            if (c.blobs)
                scene.add({"rod",
                           1,
                           Vec3(1, 1, 0),
                           {Vec3(0, 0, -1), Vec3(), Vec3(0, 0, 1)},
                           {0.5, 0.5, 0.5}});
            else {
                scene.add(sphereKind(0.9), Vec3(0.3, 0, 0));
                scene.add(sphereKind(1));
            }
            scene.side = c.side;
            scene.start(testPlatform());
            const auto before = scene.state();
            expectError([&] { scene.integrator.step(1); }, c.fragments);
            expectError([&] { scene.mobility(); }, c.fragments);
            EXPECT_EQ(scene.state(), before);
            // A body may touch its own image.
            const double enough = c.blobs ? 3 : 2;
            scene.context->setPeriodicBoxVectors(Vec3(enough, 0, 0), Vec3(0, enough, 0),
                                                 Vec3(0, 0, enough));
            scene.integrator.step(2);
            EXPECT_GT(Eigen::SelfAdjointEigenSolver<MatrixXd>(scene.mobility())
                          .eigenvalues()[c.blobs ? 1 : 0],
                      1e-3);
        }
}

TEST(Periodic, TheShortestLatticeVectorIsNotAlwaysASide) {
    PeriodicScene scene;
    scene.add(sphereKind(1));
    scene.addFree(1, 1.25, Vec3(0, 1, 0));
    scene.start(testPlatform());
    // b + c has a length of 2.507 nm, and all three sides are longer. The second box has a shorter
    // b + c.
    scene.context->setPeriodicBoxVectors(Vec3(4, 0, 0), Vec3(2, 3, 0), Vec3(-1.9, -1.49, 2));
    scene.integrator.step(1);
    scene.context->setPeriodicBoxVectors(Vec3(4, 0, 0), Vec3(2, 3, 0), Vec3(-1.9, -1.49, 1.9));
    expectError(
        [&] { scene.integrator.step(1); },
        {"particle 1 has the length 2.5 nm", "the shortest lattice vector has the length 2.4"});
}

TEST(Periodic, EffectsNameTheBox) {
    PeriodicScene scene;
    scene.addBodies();
    scene.start(testPlatform());
    const auto hydrodynamics = [&] { return scene.integrator.getEffects().at("hydrodynamics"); };
    EXPECT_NE(hydrodynamics().find("RotnePragerYamakawa with all images in the periodic box (13, "
                                   "0, 0), (0, 13, 0), (0, 0, 13) nm"),
              string::npos);
    setBox(scene, large);
    EXPECT_NE(hydrodynamics().find("(11, 0, 0), (2, 10, 0), (-3, 1, 9) nm"), string::npos);
    EXPECT_TRUE(scene.fluid->usesPeriodicBoundaryConditions());
    EXPECT_TRUE(scene.system.usesPeriodicBoundaryConditions());
    scene.fluid->setBoundary(MobilityForce::Unbounded);
    EXPECT_FALSE(scene.fluid->usesPeriodicBoundaryConditions());
    // A body alone feels its own images.
    PeriodicScene alone;
    alone.add(sphereKind(0.5));
    alone.start(testPlatform());
    EXPECT_EQ(alone.integrator.getEffects().at("hydrodynamic interactions"),
              "off: no bodies or free particles interact through the fluid, but each of them "
              "interacts with its own images");
}

TEST(Periodic, WhatIsNotThereIsRefused) {
    const auto start = [](MobilityForce::Model model, MobilityForce::Solver solver) {
        PeriodicScene scene(0, 0.01, RigidHI::LangevinHI, model);
        scene.add(sphereKind(0.5));
        scene.fluid->setSolver(solver);
        scene.start(testPlatform());
    };
    expectError(
        [&] { start(MobilityForce::StokesianDynamics, MobilityForce::MatrixFree); },
        {"model StokesianDynamics cannot be used with solver MatrixFree and scheme LangevinHI",
         "use setSolver(Dense)"});
}

TEST(Periodic, BarostatsAreRefused) {
    for (auto scheme : schemes) {
        PeriodicScene scene(300, 0.01, scheme);
        scene.add(sphereKind(0.5));
        scene.system.addForce(new MonteCarloBarostat(1, 300));
        expectError([&] { scene.start(testPlatform()); }, {"MonteCarloBarostat"});
    }
}

TEST(Periodic, ABodyAloneTurnsItsTensorInTheBox) {
    // In a box the tensor does not turn with the body, so no part of the tensor is constant.
    for (auto model : {MobilityForce::RotnePragerYamakawa, MobilityForce::ForceCoupling}) {
        PeriodicScene scene(300, 1e-3, RigidHI::DriftCorrectorFD, model);
        scene.add(boomerangKind());
        scene.side = 6;
        scene.start(testPlatform());
        const MatrixXd before = scene.mobility();
        const QuaternionArray turn = {{cos(0.3), 0, 0, sin(0.3)}};
        scene.pose({Vec3(2, 1, 4)}, {turn});
        EXPECT_GT(difference(scene.mobility(), turned(before, rotationOf(turn))), 1e-4);
        scene.pose({Vec3(2, 1, 4)}, {{{sqrt(0.5), 0, 0, sqrt(0.5)}}});
        EXPECT_LT(difference(scene.mobility(),
                             turned(before, rotationOf({{sqrt(0.5), 0, 0, sqrt(0.5)}}))),
                  1e-11);
        EXPECT_EQ(scene.integrator.getEffects().at("stochastic drift").substr(0, 3), "on:");
        scene.integrator.step(2);
    }
}

TEST(Periodic, OwnTensorsAreThoseOfABodyAlone) {
    SKIP_ON_DEVICES("they keep positions in the box, and the box is 1e13 nm wide");
    const MatrixXd own = tensorWithoutSymmetry(3);
    for (auto model : {MobilityForce::RotnePragerYamakawa, MobilityForce::ForceCoupling}) {
        PeriodicScene scene(0, 0.01, RigidHI::LangevinHI, model);
        mt19937 random(4);
        const QuaternionArray q = randomQuaternion(random);
        scene.add(boomerangKind(), Vec3(1, 2, 3), q);
        scene.add(sphereKind(0.7), Vec3(4e6, 0, 0));
        scene.fluid->setBodyMobility(0, rowsOf(own));
        scene.side = 1e13;
        scene.start(testPlatform());
        EXPECT_LT(difference(scene.mobility().topLeftCorner(6, 6), turned(own, rotationOf(q))),
                  1e-9)
            << model;
    }
}

TEST(Periodic, BodiesAcrossFacesAndFarAway) {
    // Bodies are a million boxes away. The sides of the box are powers of two, so that no position
    // is rounded.
    for (auto model : models) {
        PeriodicScene near(0, 0.01, RigidHI::LangevinHI, model),
            far(0, 0.01, RigidHI::LangevinHI, model);
        MatrixXd N[2];
        for (PeriodicScene* scene : {&near, &far}) {
            const bool away = scene == &far;
            const Vec3 shift(away ? 8e6 : 0, away ? -4e6 : 0, away ? 8 : 0);
            scene->side = 8;
            scene->add(sphereKind(1), Vec3(0.5, 0.25, 0.125));
            scene->add(sphereKind(0.5), Vec3(7, 1, 0.5) + shift);
            if (model != MobilityForce::StokesianDynamics)
                scene->add({"marked",
                            1,
                            Vec3(1, 1, 1),
                            {Vec3(), Vec3(1, 0.5, 0.25), Vec3(0, 1, 0)},
                            {0.5, 0.25, 0.5}},
                           Vec3(-0.5, 3, 7.75) - shift);
            scene->start(testPlatform());
            N[away] = scene->mobility();
        }
        EXPECT_LT(difference(N[1], N[0]), 1e-8)
            << model;  // sites are placed by rotations, with 1e-9 at this distance
        const int spheres = model == MobilityForce::StokesianDynamics ? 12 : 0;
        if (spheres > 0) {
            EXPECT_LT(difference(N[1], N[0]), 1e-11);
        }
    }
}

TEST(Periodic, StepsThatOverlapImagesAreRedone) {
    // Two spheres meet across a face of the box.
    PeriodicScene scene(20 * T1, 0.05, RigidHI::EulerMaruyama, MobilityForce::StokesianDynamics);
    scene.add(sphereKind(1), Vec3(0, 0, 0));
    scene.add(sphereKind(1), Vec3(3.9, 0, 0));
    scene.side = 6;
    scene.start(testPlatform());
    for (int i = 0; i < 200; i++) {
        scene.integrator.step(1);
        const auto R = scene.integrator.getBodyPositions();
        Vec3 d = R[1] - R[0];
        for (int k = 0; k < 3; k++) d[k] -= 6 * round(d[k] / 6);
        ASSERT_GT(norm(d), 2);
    }
    EXPECT_GT(scene.integrator.getNumRejectedSteps(), 0);
}

TEST(Periodic, MultiblobsAreMadeOfTheirBlobs) {
    // The exact mobility is N = (K^T M^-1 K)^-1 with the matrix M of the lattice sum, as in
    // unbounded fluid.
    for (auto model : {MobilityForce::RotnePragerYamakawa, MobilityForce::ForceCoupling}) {
        PeriodicScene scene(0, 0.01, RigidHI::LangevinHI, model);
        scene.addBodies();
        scene.start(testPlatform());
        setBox(scene, small);
        RigidHIPlugin::HydrodynamicParticles particles;
        vector<Vec3> x;
        const auto bodies = scene.labBodies();
        int rows = 0;
        for (const LabBody& body : bodies)
            for (size_t i = 0; i < body.radii.size(); i++) {
                particles.add(body.radii[i], body.isSphere(), x.size(), -1);
                x.push_back(toVec3(body.R + body.offsets[i]));
            }
        MatrixXd M, K = MatrixXd::Zero(particles.numRows, 6 * bodies.size());
        for (size_t b = 0; b < bodies.size(); b++)
            for (const Vector3d& offset : bodies[b].offsets) {
                K.block<3, 3>(rows, 6 * b).setIdentity();
                K.block<3, 3>(rows, 6 * b + 3) = -cross(offset);
                rows += 3;
                if (!bodies[b].isSphere()) continue;
                K.block<3, 3>(rows, 6 * b + 3).setIdentity();
                rows += 3;
            }
        const RigidHIPlugin::BoxVectors box = {small.a, small.b, small.c};
        if (model == MobilityForce::ForceCoupling)
            RigidHIPlugin::PeriodicForceCoupling(particles, 0.6).at({x, box})->dense(M);
        else
            RigidHIPlugin::PeriodicRotnePragerYamakawa(particles, 0.6).at({x, box})->dense(M);
        EXPECT_LT(difference(scene.friction(), K.transpose() * M.fullPivLu().solve(K)), 1e-10);
    }
}
