// Flows along the walls of confined fluids in a Context: the motion of bodies in these flows, the
// effect of bodies on them (flux and modes), and refused input.

#include <openmm/HarmonicBondForce.h>
#include <openmm/MonteCarloBarostat.h>
#include <openmm/MonteCarloMembraneBarostat.h>

#include "FlowReadingSupport.h"
#include "openmmrigidhi/ModelTraits.h"

using namespace OpenMM;
using namespace RigidHITest;
using namespace std;

namespace {

using RigidHIPlugin::BoundaryTraits;

const double low = -0.6, high = 7.3, height = high - low, eta = 0.6, edge = 9;

struct ConfinedScene : Pushed {
    explicit ConfinedScene(MobilityForce::Boundary boundary, double temperature = 0, double h = 1,
                           RigidHI::Scheme scheme = RigidHI::EulerMaruyama)
        : Pushed(periodicModels[0], temperature, h, scheme) {
        fluid->setBoundary(boundary);
        fluid->setWallHeight(low);
        fluid->setChannelWalls(low, high);
        side = edge;
    }
    /** A sphere, a multiblob and a free particle, all between x = 0.3 and 5.5 nm. */
    void addBodies() {
        add(sphereKind(0.7), Vec3(4.2, 0.5, 1.5));
        add(apartKind(), Vec3(2, 4, 4), {{0.8, 0, 0.6, 0}});
        addFree(1, 0.5, Vec3(3, 7, 2.5));
    }
    /** Velocities of particles that follow a flow, by its averages over their surfaces. */
    VectorXd following(const function<Vector3d(const Vector3d&)>& flow) {
        vector<double> rows;
        for (const LabBody& body : labBodies())
            for (size_t i = 0; i < body.radii.size(); i++) {
                const Vector3d x = body.R + body.offsets[i];
                const Envelope surface(MobilityForce::RotnePragerYamakawa, x, body.radii[i], 16);
                Vector3d v = Vector3d::Zero(), omega = Vector3d::Zero();
                for (size_t p = 0; p < surface.points.size(); p++) {
                    const Vector3d there = flow(toEigen(surface.points[p])),
                                   n = (toEigen(surface.points[p]) - x) / body.radii[i];
                    v += surface.weights[p] * there;
                    omega += surface.weights[p] * 3 / (2 * body.radii[i]) * n.cross(there);
                }
                rows.insert(rows.end(), v.data(), v.data() + 3);
                if (body.isSphere()) rows.insert(rows.end(), omega.data(), omega.data() + 3);
            }
        return Eigen::Map<VectorXd>(rows.data(), rows.size());
    }
    Vector3d meanFlow() { return toEigen(fluid->getMeanFlowInContext(*context)); }
    /** The mean velocity through the plane x (axis 0) or y = const. No fluid comes from anywhere,
     * so that it is the same through every plane. */
    double meanThrough(int axis, double at) {
        const int across = 18, up = 28;
        VectorXd z, w;
        gauss(up, false, z, w);
        vector<Vec3> points;
        for (int i = 0; i < up; i++)
            for (int j = 0; j < across; j++) {
                Vec3 x(at, at, 0.5 * (low + high) + 0.5 * height * z[i]);
                x[1 - axis] = edge * j / across;
                points.push_back(x);
            }
        const MatrixXd velocities = flow(points);
        double mean = 0;
        for (size_t p = 0; p < points.size(); p++)
            mean += w[p / across] / across * velocities(axis, p);
        return mean;
    }
};

/** A flow of a boundary, as a user sets it, and its velocity without bodies. */
struct FlowCase {
    string name;
    MobilityForce::Boundary boundary;
    function<void(MobilityForce&)> set;
    function<Vector3d(const Vector3d&)> at;
};

vector<FlowCase> flowCases() {
    const double k = 2 * M_PI / edge;
    const auto crest = [=](double y) { return 0.3 / (eta * k * k) * sin(k * y); };
    return {
        {"Couette", MobilityForce::NoSlipChannel,
         [](MobilityForce& fluid) { fluid.setWallVelocity(Vec3(0.2, -0.1, 0)); },
         [](const Vector3d& x) -> Vector3d {
             return (x[2] - low) / height * Vector3d(0.2, -0.1, 0);
         }},
        {"Couette in a closed channel", MobilityForce::NoSlipChannel,
         [](MobilityForce& fluid) {
             fluid.setWallVelocity(Vec3(0.2, -0.1, 0));
             fluid.setChannelCondition(MobilityForce::ZeroFlux);
         },
         [](const Vector3d& x) -> Vector3d {
             const double s = (x[2] - low) / height;
             return s * (3 * s - 2) * Vector3d(0.2, -0.1, 0);
         }},
        {"Poiseuille", MobilityForce::NoSlipChannel,
         [](MobilityForce& fluid) { fluid.setBodyForceDensity(Vec3(-0.01, 0.02, 0)); },
         [](const Vector3d& x) -> Vector3d {
             return (x[2] - low) * (high - x[2]) / (2 * eta) * Vector3d(-0.01, 0.02, 0);
         }},
        {"wave between walls", MobilityForce::NoSlipChannel,
         [](MobilityForce& fluid) { fluid.setSinusoidalForceDensity(0.3, 0, 1, 1); },
         [=](const Vector3d& x) -> Vector3d {
             return crest(x[1]) *
                    (1 - cosh(k * (x[2] - 0.5 * (low + high))) / cosh(0.5 * k * height)) *
                    Vector3d::UnitX();
         }},
        {"wave above a wall", MobilityForce::PeriodicWall,
         [](MobilityForce& fluid) { fluid.setSinusoidalForceDensity(0.3, 0, 1, 1); },
         [=](const Vector3d& x) -> Vector3d {
             return crest(x[1]) * (1 - exp(-k * (x[2] - low))) * Vector3d::UnitX();
         }},
        {"shear above a wall", MobilityForce::PeriodicWall,
         [](MobilityForce& fluid) {
             fluid.setBackgroundFlow(Vec3(0, -0.05 * low, 0), {0, 0, 0, 0, 0, 0.05, 0, 0, 0});
         },
         [](const Vector3d& x) -> Vector3d { return 0.05 * (x[2] - low) * Vector3d::UnitY(); }}};
}

}  // namespace

TEST(ConfinedFlow, CarriesSpheresAndFreeParticlesByTheirAverages) {
    for (const FlowCase& one : flowCases()) {
        SCOPED_TRACE(one.name);
        ConfinedScene scene(one.boundary);
        one.set(*scene.fluid);
        scene.add(sphereKind(0.7), Vec3(4.2, 0.5, 1.5));
        scene.add(sphereKind(0.9), Vec3(1, 5, 6.4));
        scene.addFree(1, 0.5, Vec3(3, 3, 2.5));
        scene.start();
        const VectorXd expected = scene.following(one.at);
        EXPECT_GT(expected.norm(), 0.1);
        expectNear(scene.stepTwists(), expected, 1e-11);
    }
}

TEST(ConfinedFlow, MomentaRelaxToTheFlow) {
    // Rates of relaxation are 8/ps and more, and no force is on the way along x and y.
    ConfinedScene scene(MobilityForce::NoSlipChannel, 0, 0.05, RigidHI::LangevinHI);
    const vector<FlowCase> cases = flowCases();
    cases[0].set(*scene.fluid);
    cases[2].set(*scene.fluid);
    scene.add(sphereKind(0.7), Vec3(4.2, 0.5, 1.5));
    scene.add(sphereKind(0.9), Vec3(1, 5, 6.2));
    scene.start();
    scene.integrator.step(100);
    const VectorXd expected = scene.following(
        [&](const Vector3d& x) -> Vector3d { return cases[0].at(x) + cases[2].at(x); });
    expectNear(scene.twists(), expected, 1e-10);
}

TEST(ConfinedFlow, MultiblobsGoAsTheirBlobsLetThem) {
    // U = N K^T M^-1 v, with M from the velocities of blobs under forces.
    for (const FlowCase& one : flowCases()) {
        SCOPED_TRACE(one.name);
        ConfinedScene scene(one.boundary);
        one.set(*scene.fluid);
        scene.add(apartKind(), Vec3(2, 4, 4), {{0.8, 0, 0.6, 0}});
        scene.add(apartKind(), Vec3(5, 1, 2), {{0.6, 0.8, 0, 0}});
        scene.start();
        const int rows = 3 * scene.system.getNumParticles();
        MatrixXd M(rows, rows), K = MatrixXd::Zero(rows, 12);
        for (int column = 0; column < rows; column++) {
            vector<double> forces(rows, 0);
            forces[column] = 1;
            const auto velocities = scene.fluid->applyBlobMobilityInContext(*scene.context, forces);
            M.col(column) = Eigen::Map<const VectorXd>(velocities.data(), rows);
        }
        int row = 0;
        const auto bodies = scene.labBodies();
        for (int b = 0; b < 2; b++)
            for (const Vector3d& offset : bodies[b].offsets) {
                K.block<3, 3>(row, 6 * b).setIdentity();
                K.block<3, 3>(row, 6 * b + 3) = -cross(offset);
                row += 3;
            }
        const Eigen::LLT<MatrixXd> inverse(M);
        const MatrixXd friction = K.transpose() * inverse.solve(K);
        const VectorXd expected =
            friction.llt().solve(K.transpose() * inverse.solve(scene.following(one.at)));
        expectNear(scene.stepTwists(), expected, 1e-9);
    }
}

TEST(ConfinedFlow, OnAGridItIsThatOfMatricesToTheTolerance) {
    const double tolerance = 1e-3;
    const vector<FlowCase> cases = flowCases();
    // Between walls, one of them moving, and above a wall. Reference's own grid is slow, and
    // TestConfinedGrid and TestConfinedWaves compare it with that of the CPU platform.
    for (int i : testPlatformName() == "Reference" ? vector<int>{2} : vector<int>{1, 2, 4}) {
        const FlowCase& one = cases[i];
        SCOPED_TRACE(one.name);
        VectorXd twists[2];
        Vector3d means[2];
        MatrixXd flows[2];
        for (bool grid : {false, true}) {
            ConfinedScene scene(one.boundary);
            scene.fluid->setSolver(grid ? MobilityForce::MatrixFree : MobilityForce::Dense);
            scene.fluid->setSolverTolerance(tolerance);
            one.set(*scene.fluid);
            scene.addBodies();
            scene.pushBy(0.3 * someWrenches(2));
            scene.start();
            twists[grid] = scene.stepTwists();
            flows[grid] = scene.flow({Vec3(1, 2, 1), Vec3(7, 1, 3)});
            if (one.boundary == MobilityForce::NoSlipChannel) means[grid] = scene.meanFlow();
        }
        EXPECT_LE((twists[1] - twists[0]).norm(), 5 * tolerance * twists[0].norm());
        EXPECT_LE((flows[1] - flows[0]).norm(), 20 * tolerance * flows[0].norm());
        if (one.boundary == MobilityForce::NoSlipChannel) {
            EXPECT_LE((means[1] - means[0]).norm(), 5 * tolerance * means[0].norm() + 1e-14);
        }
        EXPECT_GT((twists[1] - twists[0]).norm(), 0);
    }
}

namespace {

void checkMeanFlow(const vector<bool>& withNoise) {
    for (auto condition : {MobilityForce::ZeroPressureGradient, MobilityForce::ZeroFlux})
        for (bool noise : withNoise) {
            const bool isClosed = condition == MobilityForce::ZeroFlux;
            ConfinedScene scene(MobilityForce::NoSlipChannel, noise ? T1 : 0, 0.01,
                                RigidHI::TrapezoidalSlip);
            scene.fluid->setChannelCondition(condition);
            scene.fluid->setWallVelocity(Vec3(0.2, -0.1, 0));
            if (!isClosed) scene.fluid->setBodyForceDensity(Vec3(-0.05, 0.08, 0));
            scene.addBodies();
            scene.pushBy(someWrenches(2));
            scene.start();
            scene.integrator.step(1);
            const Vector3d mean = scene.meanFlow();
            for (int axis : {0, 1}) {
                const double through = scene.meanThrough(axis, axis == 0 ? 7.5 : 2.2);
                EXPECT_NEAR(mean[axis], through, forceTolerance(1e-8, 1)) << axis << " " << noise;
                if (isClosed) {
                    EXPECT_NEAR(mean[axis], 0, 1e-16);
                } else {
                    // Without bodies: f H^2/(12 eta) + U/2.
                    const Vector3d alone = height * height / (12 * eta) * Vector3d(-0.05, 0.08, 0) +
                                           0.5 * Vector3d(0.2, -0.1, 0);
                    EXPECT_GT(abs(mean[axis] - alone[axis]), 1e-4);
                }
            }
            EXPECT_EQ(mean[2], 0);
            EXPECT_EQ(scene.fluid->getRandomMeanFlowInContext(*scene.context), Vec3());
        }
}

}  // namespace

/** The flow with noise is that of forces of both kinds. */
TEST(ConfinedFlow, TheMeanFlowIsThatThroughAPlane) { checkMeanFlow({true}); }
TEST(ConfinedFlow, FullTheMeanFlowWithoutNoiseIsThatThroughAPlane) { checkMeanFlow({false}); }

TEST(ConfinedFlow, TheMeanFlowIsThatThroughAPlaneAlsoWhereSpheresReachThroughWalls) {
    ConfinedScene scene(MobilityForce::NoSlipChannel);
    scene.integrator.setWallRejection(RigidHI::Crossing);
    scene.fluid->setBodyForceDensity(Vec3(-0.05, 0.08, 0));
    scene.add(sphereKind(0.7), Vec3(4.2, 0.5, low + 0.2));
    scene.add(sphereKind(0.9), Vec3(2.2, 5, high - 0.6));
    scene.pushBy(someWrenches(2));
    scene.start();
    const Vector3d mean = scene.meanFlow();
    EXPECT_NEAR(mean[0], scene.meanThrough(0, 7.5), forceTolerance(1e-8, 1));
    EXPECT_NEAR(mean[1], scene.meanThrough(1, 2.7), forceTolerance(1e-8, 1));
}

TEST(ConfinedFlow, SpheresOnAMovingWallMoveWithIt) {
    // The nearer the centre to the wall, the less of the difference to the wall's velocity is left.
    ConfinedScene scene(MobilityForce::NoSlipChannel);
    scene.integrator.setWallRejection(RigidHI::Crossing);
    scene.fluid->setWallVelocity(Vec3(0.2, -0.1, 0));
    scene.add(sphereKind(0.9), Vec3(2.2, 5, high - 0.6));
    scene.start();
    const double weight = 0.6 / 0.9, atContact = (height - 0.9) / height;
    Vector3d U(0.2, -0.1, 0);
    VectorXd expected(6);
    expected << U + weight * (atContact - 1) * U,
        weight * 0.5 / height * Vector3d::UnitZ().cross(U);
    expectNear(scene.stepTwists(), expected, 1e-12);
}

TEST(ConfinedFlow, ModesAreMeansOverTheHeight) {
    ConfinedScene scene(MobilityForce::NoSlipChannel);
    scene.fluid->setSinusoidalForceDensity(0.3, 0, 1, 1);
    scene.addBodies();
    scene.pushBy(10 * someWrenches(2));
    scene.start();
    const Eigen::Vector2d amplitudes = scene.mode(0, 1, 1);
    const int along = 20, up = 24;
    VectorXd z, w;
    gauss(up, false, z, w);
    vector<Vec3> points;
    for (int i = 0; i < up; i++)
        for (int j = 0; j < along; j++)
            for (int k = 0; k < along; k++)
                points.push_back(Vec3(edge * j / along, edge * (k + 0.3) / along,
                                      0.5 * (low + high) + 0.5 * height * z[i]));
    const MatrixXd flow = scene.flow(points);
    Eigen::Vector2d sums = Eigen::Vector2d::Zero();
    for (size_t p = 0; p < points.size(); p++) {
        const double phase = 2 * M_PI / edge * points[p][1];
        sums += 2 * w[p / (along * along)] / (along * along) * flow(0, p) *
                Eigen::Vector2d(sin(phase), cos(phase));
    }
    // The flow has kinks at surfaces of particles: the quadrature is right to 1e-3 of it.
    EXPECT_NEAR(amplitudes[0], sums[0], 1e-3 * amplitudes.norm());
    EXPECT_NEAR(amplitudes[1], sums[1], 1e-3 * amplitudes.norm());
    EXPECT_GT(abs(amplitudes[1]), 0.02 * amplitudes.norm());
    // Without bodies: f0/(eta k^2) (1 - tanh(kH/2)/(kH/2)).
    ConfinedScene empty(MobilityForce::NoSlipChannel);
    empty.fluid->setSinusoidalForceDensity(0.3, 0, 1, 1);
    empty.add(sphereKind(0.5), Vec3(1, 1, 3));
    empty.start();
    const double k = 2 * M_PI / edge;
    EXPECT_NEAR(empty.mode(0, 1, 1)[0],
                0.3 / (eta * k * k) * (1 - tanh(k * height / 2) / (k * height / 2)), 1e-13);
    EXPECT_NEAR(empty.mode(1, 0, 1).norm(), 0, 1e-15);
}

TEST(ConfinedFlow, FlowAtPointsIsTheDrivenFlow) {
    for (const FlowCase& one : flowCases()) {
        SCOPED_TRACE(one.name);
        ConfinedScene scene(one.boundary);
        one.set(*scene.fluid);
        scene.add(sphereKind(0.7), Vec3(4.2, 0.5, 1.5));  // a sphere without force makes no flow
        scene.start();
        const vector<Vec3> points = {Vec3(1, 2, low), Vec3(3, -4, 2), Vec3(20, 0.7, high)};
        const MatrixXd flow = scene.flow(points);
        for (size_t p = 0; p < points.size(); p++)
            EXPECT_LE((flow.col(p) - one.at(toEigen(points[p]))).cwiseAbs().maxCoeff(), 1e-14);
    }
}

TEST(ConfinedFlow, IsTakenOverWithoutANewContext) {
    ConfinedScene scene(MobilityForce::NoSlipChannel);
    scene.add(sphereKind(0.7), Vec3(4.2, 0.5, 1.5));
    scene.start();
    EXPECT_LE(scene.stepTwists().norm(), readTolerance(0, 10));
    for (int part = 0; part < 3; part++) {
        const Vector3d U(part == 1 ? 0.3 : 0, 0, 0), f(0, part == 2 ? 0.05 : 0, 0);
        scene.fluid->setWallVelocity(toVec3(U));
        scene.fluid->setBodyForceDensity(toVec3(f));
        scene.fluid->updateParametersInContext(*scene.context);
        EXPECT_LE((scene.meanFlow() - 0.5 * U - height * height / (12 * eta) * f).norm(), 1e-14);
        const double s = scene.labBodies()[0].R[2] - low;
        const VectorXd expected = s / height * U + (s * (height - s) - 0.49 / 3) / (2 * eta) * f;
        expectNear(scene.stepTwists().head(3), expected, 1e-12);
    }
    scene.fluid->setChannelCondition(MobilityForce::ZeroFlux);
    expectError([&] { scene.fluid->updateParametersInContext(*scene.context); },
                {"cannot change the walls or the condition of a channel"});
}

TEST(ConfinedFlow, EffectsNameIt) {
    ConfinedScene scene(MobilityForce::NoSlipChannel);
    scene.fluid->setWallVelocity(Vec3(0.2, -0.1, 0));
    scene.fluid->setBodyForceDensity(Vec3(3, 4, 0));
    scene.fluid->setSinusoidalForceDensity(0.3, 0, 1, 1);
    scene.addBodies();
    scene.start();
    scene.integrator.step(1);
    const auto effects = scene.integrator.getEffects();
    for (const char* piece :
         {"an upper wall with the velocity (0.2, -0.1, 0) nm/ps, and a uniform force density of "
          "(3, 4, 0) kJ/(mol nm^4), which without bodies drives a mean flow of 43.3",
          "nm/ps, and a sinusoidal force density along x with 9 nm along y",
          "multiblobs resist its strain by their blobs"})
        EXPECT_NE(effects.at("driven flow").find(piece), string::npos) << effects.at("driven flow");
    // The third vector of the box is not one of the fluid's periods.
    const string fluid = effects.at("hydrodynamics");
    EXPECT_NE(fluid.find("RotnePragerYamakawa between no-slip walls at z = -0.6 and 7.3 nm"),
              string::npos)
        << fluid;
    EXPECT_NE(fluid.find("with all images along x and y (of the periods (9, 0, 0) and (0, 9, 0) "
                         "nm"),
              string::npos)
        << fluid;
    EXPECT_EQ(fluid.find("(0, 0, 9)"), string::npos) << fluid;
}

TEST(ConfinedFlow, WhatHasNoVolumeIsRefused) {
    for (auto boundary :
         {MobilityForce::Unbounded, MobilityForce::NoSlipWall, MobilityForce::PeriodicWall}) {
        ConfinedScene scene(boundary);
        scene.add(sphereKind(0.7), Vec3(4.2, 0.5, 1.5));
        scene.start();
        const string name = RigidHIPlugin::traitsOf(boundary).name;
        for (bool random : {false, true})
            expectError(
                [&] {
                    if (random)
                        scene.fluid->getRandomMeanFlowInContext(*scene.context);
                    else
                        scene.fluid->getMeanFlowInContext(*scene.context);
                },
                {string("get") + (random ? "Random" : "") +
                     "MeanFlowInContext(): the fluid with the boundary " + name +
                     " has no finite volume to take a mean over",
                 "ask with the boundary Periodic or SlipChannel or NoSlipChannel or Film"});
        expectError([&] { scene.mode(0, 1, 1); },
                    {"the flow has no Fourier modes with the boundary " + name +
                         (boundary == MobilityForce::PeriodicWall
                              ? ", because the fluid has no finite height"
                              : ""),
                     "use getFlowInContext()"});
    }
    ConfinedScene channel(MobilityForce::NoSlipChannel);
    channel.add(sphereKind(0.7), Vec3(4.2, 0.5, 1.5));
    channel.start();
    for (auto axes : {pair(0, 2), pair(2, 1)})
        expectError([&] { channel.mode(axes.first, axes.second, 1); },
                    {"in a NoSlipChannel both must be along the walls; give the axes 0 and 1"});
    expectError([&] { channel.flow({Vec3(1, 1, high + 0.1)}); }, {"is behind a wall"});
    // Fluids whose mean flow is 0.
    ConfinedScene periodic(MobilityForce::Periodic);
    periodic.add(sphereKind(0.7), Vec3(4.2, 0.5, 1.5));
    periodic.pushBy(someWrenches(1));
    periodic.start();
    EXPECT_EQ(periodic.meanFlow(), Vector3d::Zero());
}

// ---- What confined fluids cannot have ----

TEST(ConfinedFlow, UnknownConditionsAreRefused) {
    MobilityForce fluid;
    for (int bad : {-1, 2})
        expectError(
            [&] { fluid.setChannelCondition(static_cast<MobilityForce::ChannelCondition>(bad)); },
            {"setChannelCondition(): channel condition " + to_string(bad) + " is unknown",
             "it must be one of ZeroPressureGradient, ZeroFlux"});
}

TEST(ConfinedFlow, ModelsWithoutTheBoundaryAreRefused) {
    for (auto boundary :
         {MobilityForce::PeriodicWall, MobilityForce::NoSlipChannel, MobilityForce::Film})
        for (const auto& model : RigidHIPlugin::modelTable) {
            if (model.hasBoundary(boundary)) continue;
            ConfinedScene scene(boundary);
            scene.fluid->setModel(model.model);
            scene.add(sphereKind(0.7), Vec3(4.2, 0.5, 1.5));
            expectError([&] { scene.start(); },
                        {string("boundary ") + RigidHIPlugin::traitsOf(boundary).name +
                             " can be used with the model ",
                         string("not with ") + model.name});
        }
}

TEST(ConfinedFlow, BarostatsAreRefused) {
    for (auto boundary : {MobilityForce::PeriodicWall, MobilityForce::NoSlipChannel})
        for (auto scheme : {RigidHI::LangevinHI, RigidHI::TrapezoidalSlip})
            for (bool membrane : {false, true}) {
                ConfinedScene scene(boundary, 300, 0.01, scheme);
                scene.add(sphereKind(0.7), Vec3(4.2, 0.5, 1.5));
                if (membrane)
                    scene.system.addForce(new MonteCarloMembraneBarostat(
                        1, 4, 300, MonteCarloMembraneBarostat::XYIsotropic,
                        MonteCarloMembraneBarostat::ZFixed));
                else
                    scene.system.addForce(new MonteCarloBarostat(1, 300));
                expectError([&] { scene.start(); },
                            {membrane ? "the System has a MonteCarloMembraneBarostat"
                                      : "the System has a MonteCarloBarostat",
                             scheme == RigidHI::LangevinHI
                                 ? "the fluid has no pressure that could balance it"
                                 : "change the scheme or remove the barostat"});
            }
}

TEST(ConfinedFlow, TheThirdVectorOfTheBoxIsAlongZAndOtherwiseNothing) {
    for (auto boundary : {MobilityForce::PeriodicWall, MobilityForce::NoSlipChannel}) {
        ConfinedScene scene(boundary);
        scene.addBodies();
        scene.start();
        const MatrixXd N = scene.mobility();
        for (double z : {0.5, 30.0}) {
            scene.setBox(edge, edge, z);
            EXPECT_LE((scene.mobility() - N).cwiseAbs().maxCoeff(), 1e-14);
        }
        // Bodies may be longer than the vector across the walls, but not than those along them.
        scene.setBox(1.9, edge, 1);
        expectError([&] { scene.mobility(); },
                    {"would overlap its own image", "the shortest lattice vector has the length"});
        scene.context->setPeriodicBoxVectors(Vec3(edge, 0, 0), Vec3(0, edge, 0), Vec3(1, 0, 9));
        expectError([&] { scene.mobility(); },
                    {string(RigidHIPlugin::traitsOf(boundary).name) +
                         " needs a box whose third vector is along z, but the box has the vectors",
                     "set another box by setPeriodicBoxVectors() on the Context"});
    }
}
