// Force coupling on a grid in a Context: against lattice sums, boxes, noise, drift, resume.

#include <openmm/CustomExternalForce.h>
#include <openmm/serialization/XmlSerializer.h>

#include <chrono>
#include <sstream>

#include "HydrodynamicSupport.h"

using namespace OpenMM;
using namespace RigidHITest;
using namespace std;

namespace {

typedef CustomRigidHIIntegrator RigidHI;
const double T1 = 1 / boltzmann;  // the temperature with kT = 1
const RigidHI::Scheme schemes[] = {RigidHI::LangevinHI, RigidHI::DriftCorrectorFD, RigidHI::TrapezoidalSlip};

struct GridScene : FluidScene {
    explicit GridScene(double temperature = 0, RigidHI::Scheme scheme = RigidHI::DriftCorrectorFD, double h = 0.002,
                       MobilityForce::Solver solver = MobilityForce::MatrixFree, double tolerance = 1e-2)
        : FluidScene(temperature, h) {
        fluid->setBoundary(MobilityForce::Periodic);
        fluid->setModel(MobilityForce::ForceCoupling);
        fluid->setSolver(solver);
        fluid->setSolverTolerance(tolerance);
        integrator.setScheme(scheme);
        side = 8;
    }
    /** Spheres, multiblobs and a free particle, pulled; across faces of the box and outside of it. */
    void addBodies() {
        add(sphereKind(1), Vec3(0, 0, 0));
        add(sphereKind(0.8), Vec3(2.1, 0.3, 8.2));
        add(boomerangKind(), Vec3(-1, 2.5, 2.4));
        add(boomerangKind(), Vec3(3.5, -2.5, 0.4));
        auto* pull = new CustomExternalForce("0.7*x-0.4*y+0.2*z*z");
        for (int i = 0; i < system.getNumParticles(); i++) pull->addParticle(i, vector<double>());
        system.addForce(pull);
    }
    VectorXd state() {
        vector<double> numbers;
        for (const auto& rows : {positionsOf(*context), velocitiesOf(*context)})
            for (const Vec3& x : rows) numbers.insert(numbers.end(), {x[0], x[1], x[2]});
        return Eigen::Map<VectorXd>(numbers.data(), numbers.size());
    }
    double count(const string& what) const { return integrator.getStepStatistics().at(what); }
    void setBox(double x, double y, double z) {
        context->setPeriodicBoxVectors(Vec3(x, 0, 0), Vec3(0, y, 0), Vec3(0, 0, z));
    }
};

/** Entries over the roots of the diagonal. */
double relativeError(const MatrixXd& N, const MatrixXd& exact) {
    const VectorXd root = exact.diagonal().cwiseSqrt().cwiseInverse();
    const MatrixXd error = root.asDiagonal() * (N - exact) * root.asDiagonal();
    return Eigen::SelfAdjointEigenSolver<MatrixXd>(error).eigenvalues().cwiseAbs().maxCoeff();
}

}  // namespace

TEST(ForceCouplingGrid, IsTheLatticeSumToTheTolerance) {
    GridScene exact(0, RigidHI::DriftCorrectorFD, 0.002, MobilityForce::Dense);
    exact.addBodies();
    exact.start(testPlatform());
    const MatrixXd N = exact.mobility();
    for (double tolerance : {1e-2, 1e-3, 1e-5}) {
        GridScene scene(0, RigidHI::DriftCorrectorFD, 0.002, MobilityForce::MatrixFree, tolerance);
        scene.addBodies();
        scene.start(testPlatform());
        EXPECT_LE(relativeError(scene.mobility(), N), tolerance);
        EXPECT_NE(scene.integrator.getEffects().at("hydrodynamics").find(" on a grid of "), string::npos);
    }
}

TEST(ForceCouplingGrid, TheSpacingOfTheUserMeansATolerance) {
    GridScene scene;
    scene.addBodies();
    scene.fluid->setGridSpacing(0.5);
    scene.start(testPlatform());
    const string found = scene.integrator.getEffects().at("hydrodynamics");
    EXPECT_NE(found.find("on a grid of 16 x 16 x 16 nodes, whose products have the tolerance "), string::npos) << found;
    expectError([&] { scene.fluid->setGridSpacing(-1); },
                {"setGridSpacing()", "spacing is -1 nm", "it must be finite and not negative",
                 "give a length, or 0 for the spacing that the solver tolerance wants"});
}

TEST(ForceCouplingGrid, TheBoxOfAStepIsThatOfTheContext) {
    for (auto scheme : schemes) {
        GridScene changed(0.1 * T1, scheme), always(0.1 * T1, scheme);
        for (GridScene* scene : {&changed, &always}) {
            scene->addBodies();
            scene->start(testPlatform());
        }
        changed.mobility();
        for (GridScene* scene : {&changed, &always}) scene->setBox(7, 8.5, 9);
        changed.integrator.step(1);
        always.integrator.step(1);
        EXPECT_EQ(changed.state(), always.state());
        changed.setBox(9, 8, 7);
        changed.mobility();
        always.setBox(9, 8, 7);
        changed.integrator.step(1);
        always.integrator.step(1);
        EXPECT_EQ(changed.state(), always.state());
    }
}

TEST(ForceCouplingGrid, TriclinicBoxesAreRefusedWithTheAlternative) {
    GridScene scene;
    scene.addBodies();
    scene.start(testPlatform());
    scene.integrator.step(1);
    const VectorXd before = scene.state();
    scene.context->setPeriodicBoxVectors(Vec3(8, 0, 0), Vec3(1, 8, 0), Vec3(0, 0, 8));
    expectError([&] { scene.integrator.step(1); },
                {"ForceCoupling on a grid needs a box with edges along the axes", "(1, 8, 0)", "setSolver(Dense)"});
    EXPECT_EQ(scene.state(), before);
    scene.setBox(8, 8, 8);
    scene.integrator.step(1);
}

TEST(ForceCouplingGrid, GridsThatNoMachineHasAreRefusedBeforeTheyAreMade) {
    GridScene scene(0, RigidHI::DriftCorrectorFD, 0.002, MobilityForce::MatrixFree, 1e-8);
    scene.add(sphereKind(0.001));
    scene.side = 1000;
    scene.start(testPlatform());
    expectError([&] { scene.integrator.step(1); },
                {"ForceCoupling on a grid would have", "nodes along an edge of 1000 nm", "raise setSolverTolerance()"});
    scene.setBox(2.5, 2.5, 2.5);
    expectError([&] { scene.integrator.step(1); },
                {"ForceCoupling on a grid would take ",
                 " GB are free; raise setSolverTolerance() or setGridSpacing(), or make the box smaller"});
    scene.setBox(0.01, 0.01, 0.01);
    scene.integrator.step(1);
}

TEST(ForceCouplingGrid, ResumesBitForBit) {
    for (auto scheme : schemes) {
        GridScene once(T1, scheme), twice(T1, scheme), third(T1, scheme), fourth(T1, scheme);
        for (GridScene* scene : {&once, &twice, &third, &fourth}) {
            scene->addBodies();
            scene->start(testPlatform(), scene == &third ? 2 : 1);
        }
        for (GridScene* scene : {&once, &twice}) {
            scene->integrator.step(1);
            scene->setBox(8, 7.5, 9);
            scene->integrator.step(1);
        }
        stringstream checkpoint, xml;
        twice.context->createCheckpoint(checkpoint);
        const State state = twice.context->getState(State::Positions | State::Velocities | State::Parameters |
                                                    State::IntegratorParameters);
        XmlSerializer::serialize<State>(&state, "State", xml);
        once.integrator.step(2);
        third.context->loadCheckpoint(checkpoint);
        third.integrator.step(2);
        EXPECT_EQ(third.state(), once.state());
        unique_ptr<State> copy(XmlSerializer::deserialize<State>(xml));
        fourth.integrator.step(1);
        fourth.context->setState(*copy);
        fourth.integrator.step(2);
        EXPECT_EQ(fourth.state(), once.state());
    }
}

TEST(ForceCouplingGrid, WithoutTemperatureNoFieldIsDrawn) {
    for (auto scheme : schemes) {
        GridScene scene(0, scheme);
        scene.addBodies();
        scene.start(testPlatform());
        scene.integrator.step(2);
        EXPECT_EQ(scene.count("randomNumbers"), 0);
        EXPECT_EQ(scene.count("squareRoots"), 0);
    }
}

TEST(ForceCouplingGrid, AStepOfTheDriftCorrectorTakesOneFieldAndOneSolve) {
    GridScene scene(T1);
    scene.addBodies();
    scene.start(testPlatform());
    scene.integrator.step(2);
    EXPECT_EQ(scene.count("squareRoots"), 0);
    EXPECT_EQ(scene.count("forceEvaluations"), 2);
    // A solve has one product more than iterations.
    EXPECT_EQ(scene.count("mobilityProducts"), scene.count("solverIterations") + 2);
    EXPECT_LE(scene.count("solverIterations"), 2 * 25);
    EXPECT_EQ(scene.integrator.getEffects().at("finite differences").substr(0, 3), "off");
    GridScene other(T1);
    other.addBodies();
    other.integrator.setFiniteDifferenceStep(1e-3);
    other.start(testPlatform());
    other.integrator.step(2);
    EXPECT_EQ(other.state(), scene.state());
    EXPECT_GT(scene.count("seconds_fft"), 0);
    EXPECT_GT(scene.count("randomNumbers"), 0);
}

TEST(ForceCouplingGrid, StatisticsSayWhereTheTimeGoes) {
    const char* const parts[] = {"seconds_spreading", "seconds_fft", "seconds_averaging", "seconds_solver"};
    for (auto scheme : schemes) {
        GridScene scene(T1, scheme), matrices(T1, scheme, 0.002, MobilityForce::Dense);
        for (GridScene* one : {&scene, &matrices}) {
            one->addBodies();
            one->start(testPlatform());
        }
        const auto start = chrono::steady_clock::now();
        scene.integrator.step(2);
        const double wall = chrono::duration<double>(chrono::steady_clock::now() - start).count();
        matrices.integrator.step(2);
        double sum = 0, before = 0;
        for (const char* part : parts) {
            EXPECT_GT(scene.count(part), 0) << part;
            EXPECT_EQ(matrices.count(part), 0) << part;
            sum += scene.count(part);
        }
        // These scenes have one thread.
        EXPECT_LE(sum, wall);
        // Another fluid counts on.
        scene.fluid->setViscosity(0.7);
        scene.fluid->updateParametersInContext(*scene.context);
        for (const char* part : parts) before += scene.count(part);
        EXPECT_NEAR(before, sum, 1e-12 * sum);
    }
}

TEST(ForceCouplingGrid, SpheresAloneHaveNoDrift) {
    // nu = 1, and one product: what SlipOnly and Whole do is the same.
    VectorXd ends[2];
    for (auto scaling : {RigidHI::SlipOnly, RigidHI::Whole}) {
        GridScene scene(T1);
        for (int i = 0; i < 3; i++) scene.add(sphereKind(0.8), Vec3(2.1 * i, 0.3, 0.2 * i));
        scene.integrator.setDriftCorrectorScaling(scaling);
        scene.start(testPlatform());
        scene.integrator.step(2);
        EXPECT_EQ(scene.count("mobilityProducts"), 2);
        EXPECT_EQ(scene.integrator.getEffects().at("stochastic drift").substr(0, 3), "off");
        ends[scaling] = scene.state();
    }
    EXPECT_EQ(ends[0], ends[1]);
}

TEST(ForceCouplingGrid, TheDriftFactorScalesSlipsOrAll) {
    // Without noise nothing is scaled. With it the positions of both differ by (nu - 1) h N F: of the order of nu - 1.
    for (double temperature : {0.0, T1}) {
        VectorXd ends[2];
        VectorXd start;
        for (auto scaling : {RigidHI::SlipOnly, RigidHI::Whole}) {
            GridScene scene(temperature);
            scene.addBodies();
            scene.integrator.setDriftCorrectorScaling(scaling);
            scene.start(testPlatform());
            start = scene.state();
            scene.integrator.step(1);
            ends[scaling] = scene.state();
        }
        if (temperature == 0)
            EXPECT_EQ(ends[0], ends[1]);
        else {
            EXPECT_GT((ends[0] - ends[1]).norm(), 0);
            EXPECT_LT((ends[0] - ends[1]).norm(), 0.3 * (ends[0] - start).norm());
        }
    }
    GridScene scene;
    expectError([&] { scene.integrator.setDriftCorrectorScaling(static_cast<RigidHI::DriftCorrectorScaling>(7)); },
                {"setDriftCorrectorScaling()", "7", "SlipOnly, Whole"});
}

TEST(ForceCouplingGrid, WarnsWhereTheDriftFactorFluctuatesTooMuch) {
    GridScene scene(T1, RigidHI::DriftCorrectorFD, 0.5, MobilityForce::MatrixFree, 0.05);
    for (int i = 0; i < 4; i++) scene.add(boomerangKind(), Vec3(4 * (i % 2), 4 * (i / 2), 0));
    scene.start(testPlatform());
    testing::internal::CaptureStderr();
    scene.integrator.step(55);
    const string printed = testing::internal::GetCapturedStderr();
    EXPECT_NE(printed.find("the drift factor nu of DriftCorrectorFD fluctuates by"), string::npos) << printed;
    EXPECT_NE(scene.integrator.getEffects().at("warnings").find("the drift factor nu"), string::npos);
}

TEST(ForceCouplingGrid, GroupsShareAGridAndNoNoise) {
    // Two groups of the same bodies at the same places: the same mobility, no interaction, other noise.
    GridScene scene(T1);
    for (int i = 0; i < 2; i++) {
        scene.add(sphereKind(0.8), Vec3(0, 0, 0));
        scene.add(boomerangKind(), Vec3(-1, 2.5, 2.4));
    }
    scene.fluid->setGroups({0, 0, 1, 1});
    scene.start(testPlatform());
    const MatrixXd N = scene.mobility();
    EXPECT_EQ(MatrixXd(N.topLeftCorner(12, 12)), MatrixXd(N.bottomRightCorner(12, 12)));
    EXPECT_EQ(N.topRightCorner(12, 12).norm(), 0);
    const auto before = scene.integrator.getBodyPositions();
    scene.integrator.step(1);
    const auto after = scene.integrator.getBodyPositions();
    EXPECT_GT(toEigen(after[0] - before[0] - (after[2] - before[2])).norm(),
              0.1 * toEigen(after[0] - before[0]).norm());
}

TEST(ForceCouplingGrid, LangevinHITakesTheStepOfMatrices) {
    // Same seed, same step: in the norm of mass-weighted momenta to five tolerances, as for all matrix-free fluids. Masses of bodies here are 1, moments less.
    for (double temperature : {0.0, T1}) {
        const auto velocities = [&](MobilityForce::Solver solver, double tolerance) {
            GridScene scene(temperature, RigidHI::LangevinHI, 0.05, solver, tolerance);
            scene.addBodies();
            scene.start(testPlatform());
            scene.integrator.step(1);
            const auto V = scene.integrator.getBodyVelocities();
            VectorXd all(3 * V.size());
            for (size_t b = 0; b < V.size(); b++) all.segment<3>(3 * b) = sqrt(scene.bodies[b].mass) * toEigen(V[b]);
            return all;
        };
        const VectorXd exact = velocities(MobilityForce::Dense, 1e-6);
        for (double tolerance : {1e-2, 1e-4}) {
            const VectorXd error = velocities(MobilityForce::MatrixFree, tolerance) - exact;
            EXPECT_LE(error.norm(), 5 * tolerance * exact.norm()) << temperature << " " << tolerance;
        }
    }
}
