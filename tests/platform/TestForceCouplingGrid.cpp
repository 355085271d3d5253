// Force coupling on a grid in a Context. TestPeriodicGrids has the tests that every model on a grid
// must pass.

#include <openmm/CustomExternalForce.h>
#include <openmm/CustomNonbondedForce.h>

#include <chrono>
#include <thread>

#include "GridSceneSupport.h"
#include "linearalgebra/Decompositions.h"
#include "openmmrigidhi/SchemeTraits.h"

using namespace OpenMM;
using namespace RigidHITest;
using namespace std;

namespace {

using RigidHI = CustomRigidHIIntegrator;
const RigidHI::Scheme schemes[] = {RigidHI::LangevinHI, RigidHI::DriftCorrectorFD,
                                   RigidHI::TrapezoidalSlip};

struct ForceCouplingScene : GridScene {
    explicit ForceCouplingScene(double temperature = 0,
                                RigidHI::Scheme scheme = RigidHI::DriftCorrectorFD,
                                double h = 0.002,
                                MobilityForce::Solver solver = MobilityForce::MatrixFree,
                                double tolerance = 1e-2)
        : GridScene(MobilityForce::ForceCoupling, temperature, scheme, h, solver, tolerance) {}
};

/** A body with one bead in the middle and three beads on each half-axis (Westwood 2022, 6). */
BodyKind hedgehogKind(double spacing) {
    BodyKind kind = {"hedgehog", 1, Vec3(1, 1, 1), {Vec3()}, {}};
    for (int axis = 0; axis < 3; axis++)
        for (int bead = -3; bead <= 3; bead++)
            if (bead != 0) {
                kind.sites.push_back(Vec3());
                kind.sites.back()[axis] = bead * spacing;
            }
    kind.radii.assign(kind.sites.size(), 1);
    return kind;
}

/** Random poses in a periodic box. The bodies are then pushed apart until beads of different bodies
 * no longer overlap. */
void placeApart(const BodyKind& kind, int count, double side, vector<Vec3>& places,
                vector<QuaternionArray>& turns) {
    mt19937 random(4);
    FluidScene pushed(0, 0.02);
    pushed.side = side;
    pushed.fluid->setModel(MobilityForce::FreeDraining);
    pushed.fluid->setViscosity(1 / (6 * M_PI));
    pushed.integrator.setScheme(RigidHI::EulerMaruyama);
    places = randomPlaces(count, side, 0, random);
    turns = randomTurns(count, random);
    auto* push = new CustomNonbondedForce("50*step(2-r)*(2-r)^2");
    push->setNonbondedMethod(CustomNonbondedForce::CutoffPeriodic);
    push->setCutoffDistance(2.2);
    for (int b = 0; b < count; b++) {
        pushed.add(kind, places[b], turns[b]);
        const auto& members = pushed.particles.back();
        for (size_t i = 0; i < members.size(); i++) {
            push->addParticle({});
            for (size_t j = 0; j < i; j++) push->addExclusion(members[j], members[i]);
        }
    }
    pushed.system.addForce(push);
    pushed.bind();
    pushed.start(platform("CPU"));
    pushed.integrator.step(300);
    EXPECT_LT(pushed.context->getState(State::Energy).getPotentialEnergy(), 1e-3);
    places = pushed.integrator.getBodyPositions();
    turns = pushed.integrator.getBodyOrientations();
}

}  // namespace

TEST(ForceCouplingGrid, TheSpacingOfTheUserMeansATolerance) {
    ForceCouplingScene scene;
    scene.addBodies();
    scene.fluid->setGridSpacing(0.3);
    scene.start(testPlatform());
    const string found = scene.integrator.getEffects().at("hydrodynamics");
    EXPECT_NE(found.find("on a grid of 28 x 28 x 28 nodes, whose products have the tolerance "),
              string::npos)
        << found;
    for (const double bad : {-1.0, double(NAN), double(INFINITY)})
        expectError([&] { scene.fluid->setGridSpacing(bad); },
                    {"setGridSpacing(): spacing is ", " nm; it must be finite and not negative",
                     "give a length, or 0 for the spacing that the solver tolerance needs"});
    // On this grid whole particles would lie between the nodes. An earlier version then gave
    // mobilities of zero.
    ForceCouplingScene coarse;
    coarse.addBodies();
    coarse.fluid->setGridSpacing(0.5);
    expectError([&] { coarse.start(testPlatform()); },
                {"setGridSpacing(): the spacing is 0.5 nm, too coarse for the smallest particle of",
                 "give at most 0.312 nm, or 0"});
    coarse.fluid->setGridSpacing(0.312);
    coarse.start(testPlatform());
    // No spacing makes errors smaller than rounding, and the reaches of envelopes must not grow
    // without end.
    ForceCouplingScene fine;
    fine.addBodies();
    fine.fluid->setGridSpacing(0.08);
    fine.start(testPlatform());
    EXPECT_NE(fine.integrator.getEffects().at("hydrodynamics").find("have the tolerance 1e-14"),
              string::npos);
}

TEST(ForceCouplingGrid, GridsThatNoMachineHasAreRefusedBeforeTheyAreMade) {
    ForceCouplingScene scene(0, RigidHI::DriftCorrectorFD, 0.002, MobilityForce::MatrixFree, 1e-8);
    scene.add(sphereKind(0.001));
    scene.side = 1000;
    scene.start(testPlatform());
    expectError([&] { scene.integrator.step(1); },
                {"ForceCoupling on a grid would need", "nodes along an edge of 1000 nm",
                 "raise setSolverTolerance()"});
    scene.setBox(2.5, 2.5, 2.5);
    expectError(
        [&] { scene.integrator.step(1); },
        {"ForceCoupling on a grid needs ",
         " GB are free; raise setSolverTolerance() or setGridSpacing(), or make the box smaller"});
    scene.setBox(0.01, 0.01, 0.01);
    scene.integrator.step(1);
}

TEST(ForceCouplingGrid, AStepOfTheDriftCorrectorTakesOneFieldAndOneSolve) {
    ForceCouplingScene scene(T1);
    scene.addBodies();
    scene.start(testPlatform());
    scene.integrator.step(2);
    EXPECT_EQ(scene.count("squareRoots"), 0);
    EXPECT_EQ(scene.count("forceEvaluations"), 2);
    // A solve takes one product more than it takes iterations.
    EXPECT_EQ(scene.count("mobilityProducts"), scene.count("solverIterations") + 2);
    EXPECT_LE(scene.count("solverIterations"), 2 * 25);
    EXPECT_EQ(scene.integrator.getEffects().at("finite differences").substr(0, 3), "off");
    ForceCouplingScene other(T1);
    other.addBodies();
    other.integrator.setFiniteDifferenceStep(1e-3);
    other.start(testPlatform());
    other.integrator.step(2);
    EXPECT_EQ(other.state(), scene.state());
    EXPECT_GT(scene.count("seconds_fft"), 0);
    EXPECT_GT(scene.count("randomNumbers"), 0);
}

/** Only FixmanMidpoint needs random wrenches, whose square roots are computed by iterations. */
TEST(ForceCouplingGrid, SchemesTakeTheirNoiseFromTheField) {
    const map<RigidHI::Scheme, int> solves = {
        {RigidHI::EulerMaruyama, 1},         {RigidHI::RandomFiniteDifference, 2},
        {RigidHI::TractionEulerMaruyama, 2}, {RigidHI::TrapezoidalSlip, 2},
        {RigidHI::DriftCorrectorRFD, 1},     {RigidHI::DriftCorrectorFD, 1}};
    for (const auto& [scheme, count] : solves) {
        SCOPED_TRACE(traitsOf(scheme).name);
        ForceCouplingScene scene(T1, scheme);
        scene.addBodies();
        scene.start(testPlatform());
        scene.integrator.step(1);
        EXPECT_EQ(scene.count("squareRoots"), 0);
        EXPECT_LE(scene.count("solverIterations"), count * 25);
        EXPECT_GT(scene.count("randomNumbers"), 6 * 512);
    }
}

TEST(ForceCouplingGrid, StatisticsSayWhereTheTimeGoes) {
    const char* const parts[] = {"seconds_spreading", "seconds_fft", "seconds_averaging",
                                 "seconds_solver"};
    for (auto scheme : schemes) {
        ForceCouplingScene scene(T1, scheme), matrices(T1, scheme, 0.002, MobilityForce::Dense);
        for (ForceCouplingScene* one : {&scene, &matrices}) {
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
        // The parts are sums over threads. Reference and CPU have one thread here, and beside a
        // device the host may use all of the machine's.
        EXPECT_LE(sum, wall * (onDevice() ? thread::hardware_concurrency() : 1));
        // The counters go on after the fluid was changed.
        scene.fluid->setViscosity(0.7);
        scene.fluid->updateParametersInContext(*scene.context);
        for (const char* part : parts) before += scene.count(part);
        EXPECT_NEAR(before, sum, 1e-12 * sum);
    }
}

TEST(ForceCouplingGrid, TheDriftFactorScalesSlipsOrAll) {
    // Without noise nothing is scaled. With noise the positions of both scalings differ by (nu - 1)
    // h N F, which is of the order of nu - 1.
    for (double temperature : {0.0, T1}) {
        VectorXd ends[2];
        VectorXd start;
        for (auto scaling : {RigidHI::SlipOnly, RigidHI::Whole}) {
            ForceCouplingScene scene(temperature);
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
    ForceCouplingScene scene;
    expectError(
        [&] {
            scene.integrator.setDriftCorrectorScaling(
                static_cast<RigidHI::DriftCorrectorScaling>(7));
        },
        {"setDriftCorrectorScaling()", "7", "SlipOnly, Whole"});
}

TEST(ForceCouplingGrid, WarnsWhereTheDriftFactorFluctuatesTooMuch) {
    ForceCouplingScene scene(T1, RigidHI::DriftCorrectorFD, 0.5, MobilityForce::MatrixFree, 0.05);
    for (int i = 0; i < 4; i++) scene.add(boomerangKind(), Vec3(4 * (i % 2), 4 * (i / 2), 0));
    scene.start(testPlatform());
    testing::internal::CaptureStderr();
    scene.integrator.step(55);
    const string printed = testing::internal::GetCapturedStderr();
    EXPECT_NE(printed.find("the drift factor nu of DriftCorrectorFD fluctuates by"), string::npos)
        << printed;
    EXPECT_NE(scene.integrator.getEffects().at("warnings").find("the drift factor nu"),
              string::npos);
}

/** Solves for 60 hedgehogs at a volume fraction of 0.2 take 9, 14 and 18 iterations for 1e-2, 1e-3
 * and 1e-4. */
TEST(ForceCouplingGrid, HedgehogsTakeFewIterations) {
    const BodyKind kind = hedgehogKind(2);
    const int count = 60;
    const double side = cbrt(count * kind.sites.size() * 4 / 3.0 * M_PI / 0.2);
    vector<Vec3> places;
    vector<QuaternionArray> turns;
    placeApart(kind, count, side, places, turns);
    // Solves are to be right relative to the bodies' velocities and not to the slips of all beads,
    // which takes one or two more.
    const map<double, int> most = {{1e-2, 10}, {1e-3, 16}, {1e-4, 20}};
    for (const auto& [tolerance, iterations] : most) {
        ForceCouplingScene scene(T1, RigidHI::DriftCorrectorFD, 1 / 600.0,
                                 MobilityForce::MatrixFree, tolerance);
        scene.side = side;
        scene.fluid->setViscosity(1 / (6 * M_PI));
        for (int b = 0; b < count; b++) scene.add(kind, places[b], turns[b]);
        auto* pull = new CustomExternalForce("sin(1.3*x+2.1*y-0.7*z)");
        for (int i = 0; i < scene.system.getNumParticles(); i++)
            pull->addParticle(i, vector<double>());
        scene.system.addForce(pull);
        scene.start(testPlatform());
        scene.integrator.step(1);
        EXPECT_LE(scene.count("solverIterations"), iterations) << tolerance;
    }
}

/**
 * At half their spacing the beads of a hedgehog overlap, and its own matrix has a condition number
 * in the thousands. Products still reach the tolerance of the grid, and solves that of the
 * iterations, in the norm of the friction.
 */
TEST(ForceCouplingGrid, OverlappingBeadsReachTheTolerance) {
    const BodyKind kind = hedgehogKind(1);
    const int count = 3;
    vector<Vec3> places;
    vector<QuaternionArray> turns;
    placeApart(kind, count, 11, places, turns);
    const auto scene = [&](MobilityForce::Solver solver, double tolerance) {
        auto made =
            make_unique<ForceCouplingScene>(0, RigidHI::DriftCorrectorFD, 0.002, solver, tolerance);
        made->side = 11;
        for (int b = 0; b < count; b++) made->add(kind, places[b], turns[b]);
        made->start(testPlatform());
        return made;
    };
    const auto product = [](ForceCouplingScene& scene, const VectorXd& forces, bool ofBlobs) {
        const vector<double> f(forces.data(), forces.data() + forces.size());
        const vector<double> v = ofBlobs
                                     ? scene.fluid->applyBlobMobilityInContext(*scene.context, f)
                                     : scene.fluid->applyMobilityInContext(*scene.context, f);
        return VectorXd(Eigen::Map<const VectorXd>(v.data(), v.size()));
    };
    const auto blobs = [&](ForceCouplingScene& scene) {
        const int rows = 3 * scene.system.getNumParticles();
        MatrixXd M(rows, rows);
        for (int i = 0; i < rows; i++) M.col(i) = product(scene, VectorXd::Unit(rows, i), true);
        return M;
    };
    const auto norm = [](const MatrixXd& symmetric) {
        return Eigen::SelfAdjointEigenSolver<MatrixXd>(symmetric, Eigen::EigenvaluesOnly)
            .eigenvalues()
            .cwiseAbs()
            .maxCoeff();
    };
    const MatrixXd M = blobs(*scene(MobilityForce::Dense, 1e-6));
    mt19937 random(8);
    normal_distribution<double> normal;
    for (double tolerance : {1e-2, 1e-4, 1e-6}) {
        const auto grid = scene(MobilityForce::MatrixFree, tolerance);
        EXPECT_LE(norm(blobs(*grid) - M), tolerance * norm(M)) << tolerance;
        // For so few bodies mobility() makes a matrix from the same grid without iterations.
        const MatrixXd N = grid->mobility();
        const Eigen::LLT<MatrixXd> factor(N);
        for (int i = 0; i < 5; i++) {
            VectorXd wrench(N.rows());
            for (double& x : wrench) x = normal(random);
            const VectorXd twists = product(*grid, wrench, false), error = twists - N * wrench;
            EXPECT_LE(sqrt(error.dot(factor.solve(error))),
                      tolerance * sqrt(wrench.dot(N * wrench)))
                << tolerance;
            EXPECT_GT(error.norm(), 1e-14 * twists.norm());  // iterations were used
        }
    }
}
