// Flows that users drive along no-slip planes: Stokes' equation, conditions on the planes, fluxes,
// averages over spheres and Gaussians, and refused input.

#include "FlowReadingSupport.h"
#include "fluid/UserFlow.h"
#include "mobility/models/periodic/PeriodicMobility.h"
#include "openmmrigidhi/ModelTraits.h"

using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace std;
using OpenMM::Vec3;

namespace {

const double eta = 1.7, low = -3.2, high = -0.9, height = high - low;
const BoxVectors box = {Vec3(6, 0, 0), Vec3(1, 5, 0), Vec3(0, 0, 4)};
const auto boundaries = {MobilityForce::PeriodicWall, MobilityForce::NoSlipChannel,
                         MobilityForce::Film};

MobilityForce fluidOf(MobilityForce::Boundary boundary) {
    MobilityForce fluid;
    fluid.setModel(boundary == MobilityForce::Film ? MobilityForce::ForceCoupling
                                                   : MobilityForce::RotnePragerYamakawa);
    fluid.setViscosity(eta);
    fluid.setBoundary(boundary);
    fluid.setWallHeight(low);
    fluid.setChannelWalls(low, high);
    return fluid;
}

DrivenFlow flowOf(const MobilityForce& fluid) {
    const UserFlow flow(fluid);
    flow.check();
    return flow.inBox(box);
}

/** All flows that a boundary has along its planes, each by itself, and its force density. */
struct Case {
    string name;
    MobilityForce fluid;
    function<Vector3d(const Vector3d&)> forceDensity;
};

vector<Case> allFlows() {
    vector<Case> cases;
    const auto none = [](const Vector3d&) -> Vector3d { return Vector3d::Zero(); };
    for (auto boundary : boundaries)
        for (int axis : {0, 1}) {
            const double edge = box[1 - axis][1 - axis], f0 = 0.7;
            Case wave{string(traitsOf(boundary).name) + " wave", fluidOf(boundary), {}};
            wave.fluid.setSinusoidalForceDensity(f0, axis, 1 - axis, 2);
            wave.forceDensity = [=](const Vector3d& x) -> Vector3d {
                return f0 * sin(4 * M_PI / edge * x[1 - axis]) * Vector3d::Unit(axis);
            };
            cases.push_back(wave);
        }
    for (auto boundary : {MobilityForce::NoSlipChannel, MobilityForce::Film}) {
        const Vector3d f(0.3, -1.1, 0);
        Case poiseuille{string(traitsOf(boundary).name) + " Poiseuille", fluidOf(boundary),
                        [=](const Vector3d&) { return f; }};
        poiseuille.fluid.setBodyForceDensity(toVec3(f));
        cases.push_back(poiseuille);
    }
    for (auto condition : {MobilityForce::ZeroPressureGradient, MobilityForce::ZeroFlux}) {
        const Vector3d U(0.4, 0.9, 0);
        Case couette{"Couette", fluidOf(MobilityForce::NoSlipChannel), none};
        couette.fluid.setChannelCondition(condition);
        couette.fluid.setWallVelocity(toVec3(U));
        // A closed channel has a pressure gradient of 6 eta U/H^2.
        if (condition == MobilityForce::ZeroFlux)
            couette.forceDensity = [=](const Vector3d&) -> Vector3d {
                return -6 * eta / (height * height) * U;
            };
        cases.push_back(couette);
    }
    Case shear{"shear", fluidOf(MobilityForce::PeriodicWall), none};
    shear.fluid.setBackgroundFlow(Vec3(0.5 * -low, 0, 0), {0, 0, 0.5, 0, 0, 0, 0, 0, 0});
    cases.push_back(shear);
    return cases;
}

/** Derivatives of the flow at points, by central differences: dv_a/dx_b. */
Matrix3d gradientOf(const DrivenFlow& flow, const Vector3d& x) {
    const double h = 1e-5;  // differences are right to h^2 and rounding/h
    Matrix3d G;
    for (int b = 0; b < 3; b++)
        G.col(b) = (flow.velocityAt(x + h * Vector3d::Unit(b), {}) -
                    flow.velocityAt(x - h * Vector3d::Unit(b), {})) /
                   (2 * h);
    return G;
}

const vector<Vector3d> places = {Vector3d(0.3, 1.2, -2.9), Vector3d(2.2, -7.1, -1.4),
                                 Vector3d(-1.9, 0.4, -2.05)};

}  // namespace

TEST(FlowBetweenPlanes, FulfilsStokesEquation) {
    for (const Case& one : allFlows()) {
        SCOPED_TRACE(one.name);
        const DrivenFlow flow = flowOf(one.fluid);
        const double h = 1e-3;  // second differences are right to h^2 k^2/12 and rounding/h^2
        for (const Vector3d& x : places) {
            Vector3d laplacian = Vector3d::Zero();
            for (int b = 0; b < 3; b++)
                laplacian +=
                    (flow.velocityAt(x + h * Vector3d::Unit(b), {}) - 2 * flow.velocityAt(x, {}) +
                     flow.velocityAt(x - h * Vector3d::Unit(b), {})) /
                    (h * h);
            EXPECT_LE((eta * laplacian + one.forceDensity(x)).cwiseAbs().maxCoeff(), 2e-6);
            EXPECT_LE(abs(gradientOf(flow, x).trace()), 1e-9);
        }
    }
}

TEST(FlowBetweenPlanes, IsAtRestOnWallsAndWithoutStressOnASurface) {
    for (const Case& one : allFlows()) {
        SCOPED_TRACE(one.name);
        const DrivenFlow flow = flowOf(one.fluid);
        EXPECT_FALSE(flow.isZero());
        for (Vector3d x : places) {
            x[2] = low;
            EXPECT_LE(flow.velocityAt(x, {}).cwiseAbs().maxCoeff(), 1e-15);
            x[2] = high;
            const Vector3d onTop = flow.velocityAt(x, {});
            if (one.fluid.getBoundary() == MobilityForce::NoSlipChannel) {
                EXPECT_LE((onTop - toEigen(one.fluid.getWallVelocity())).cwiseAbs().maxCoeff(),
                          1e-15);
            }
            if (one.fluid.getBoundary() == MobilityForce::Film) {
                EXPECT_LE(gradientOf(flow, x).col(2).cwiseAbs().maxCoeff(), 1e-9);
            }
        }
    }
}

TEST(FlowBetweenPlanes, FarAboveAWallAWaveIsThatOfAPeriodicFluid) {
    MobilityForce fluid = fluidOf(MobilityForce::PeriodicWall);
    fluid.setSinusoidalForceDensity(1.3, 0, 1, 1);
    const double k = 2 * M_PI / 5;
    for (double z : {20.0, 1e6}) {
        const Vector3d x(0, 0.7, low + z);
        EXPECT_NEAR(flowOf(fluid).velocityAt(x, {})[0], 1.3 / (eta * k * k) * sin(k * 0.7), 1e-10);
    }
    // In a high channel and film, no exponential overflows.
    for (auto boundary : {MobilityForce::NoSlipChannel, MobilityForce::Film}) {
        MobilityForce tall = fluidOf(boundary);
        tall.setChannelWalls(low, low + 1e5);
        tall.setSinusoidalForceDensity(1.3, 0, 1, 1);
        for (double z : {0.8, 2e4, 1e5 - 0.8})
            EXPECT_NEAR(flowOf(tall).velocityAt(Vector3d(0, 0.7, low + z), {})[0],
                        1.3 / (eta * k * k) * sin(k * 0.7) *
                            (1 - exp(-k * z) -
                             (boundary == MobilityForce::NoSlipChannel ? exp(-k * (1e5 - z)) : 0)),
                        1e-10);
    }
}

TEST(FlowBetweenPlanes, TurnsAndStrainsAsItsGradient) {
    for (const Case& one : allFlows()) {
        SCOPED_TRACE(one.name);
        const DrivenFlow flow = flowOf(one.fluid);
        for (const Vector3d& x : places) {
            const Matrix3d G = gradientOf(flow, x);
            const Vector3d halfCurl =
                0.5 * Vector3d(G(2, 1) - G(1, 2), G(0, 2) - G(2, 0), G(1, 0) - G(0, 1));
            EXPECT_LE((flow.angularVelocityAt(x, {}) - halfCurl).cwiseAbs().maxCoeff(), 1e-9);
            EXPECT_LE((flow.strainRateAt(x, {}) - 0.5 * (G + G.transpose())).cwiseAbs().maxCoeff(),
                      1e-9);
        }
    }
}

TEST(FlowBetweenPlanes, CarriesSpheresByTheAverageOverTheirSurfaces) {
    // Half the curl, averaged over the ball, is 3/(2a) times the mean of n x v over its surface.
    const double a = 0.45;
    for (const Case& one : allFlows()) {
        SCOPED_TRACE(one.name);
        const DrivenFlow flow = flowOf(one.fluid);
        const WaveFactors factors = overSurfaces().waveFactors(a, flow.k);
        for (const Vector3d& x : places) {
            if (!(x[2] - low > a && high - x[2] > a)) continue;
            const Envelope surface(MobilityForce::RotnePragerYamakawa, x, a, 16);
            Vector3d v = Vector3d::Zero(), omega = Vector3d::Zero();
            for (size_t p = 0; p < surface.points.size(); p++) {
                const Vector3d there = flow.velocityAt(toEigen(surface.points[p]), {}),
                               n = (toEigen(surface.points[p]) - x) / a;
                v += surface.weights[p] * there;
                omega += surface.weights[p] * 3 / (2 * a) * n.cross(there);
            }
            EXPECT_LE((flow.velocityAt(x, factors) - v).cwiseAbs().maxCoeff(), 1e-13);
            EXPECT_LE((flow.angularVelocityAt(x, factors) - omega).cwiseAbs().maxCoeff(), 1e-12);
        }
    }
}

TEST(FlowBetweenPlanes, CarriesGaussiansByTheirAverage) {
    const double a = 0.45, ofTorque = a / pow(6 * sqrt(M_PI), 1.0 / 3);
    VectorXd nodes, weights;
    gauss(20, true, nodes, weights);
    for (const Case& one : allFlows()) {
        SCOPED_TRACE(one.name);
        const DrivenFlow flow = flowOf(one.fluid);
        const WaveFactors factors = overGaussians().waveFactors(a, flow.k);
        for (const Vector3d& x : places) {
            Vector3d v = Vector3d::Zero(), omega = Vector3d::Zero();
            for (int i = 0; i < nodes.size(); i++)
                for (int j = 0; j < nodes.size(); j++)
                    for (int k = 0; k < nodes.size(); k++) {
                        const Vector3d n(nodes[i], nodes[j], nodes[k]);
                        const double w = weights[i] * weights[j] * weights[k];
                        v += w * flow.velocityAt(x + a / sqrt(M_PI) * n, {});
                        omega += w * flow.angularVelocityAt(x + ofTorque * n, {});
                    }
            EXPECT_LE((flow.velocityAt(x, factors) - v).cwiseAbs().maxCoeff(), 1e-12);
            EXPECT_LE((flow.angularVelocityAt(x, factors) - omega).cwiseAbs().maxCoeff(), 1e-12);
        }
    }
}

TEST(FlowBetweenPlanes, CarriesGaussiansThatReachThroughPlanesByTheFlowBeyond) {
    // Beyond the planes of a channel or film the fluid moves with the planes, up to their images in
    // a period of height + gap; behind a single wall it is at rest.
    const double a = 0.5, gap = 0.9, period = height + gap;
    WaveFactors factors;
    VectorXd nodes, weights;
    gauss(40, false, nodes, weights);
    for (const Case& one : allFlows()) {
        SCOPED_TRACE(one.name);
        const DrivenFlow flow = flowOf(one.fluid);
        const bool isWall = one.fluid.getBoundary() == MobilityForce::PeriodicWall;
        // The flow at a point of this height, and its gradient there
        const auto flowAt = [&](Vector3d x) -> Vector3d {
            while (!isWall && x[2] < low) x[2] += period;
            while (!isWall && x[2] > high + gap) x[2] -= period;
            if (x[2] < low) return Vector3d::Zero();
            if (isWall || x[2] <= high) return flow.velocityAt(x, {});
            const double s = x[2] - high;
            x[2] = high;
            const double k = flow.waveVelocity == 0 ? 0 : flow.k;
            return (k == 0 ? 1 - s / gap : sinh(k * (gap - s)) / sinh(k * gap)) *
                   flow.velocityAt(x, {});
        };
        for (const double z : {low + 0.1, low + a, low + 0.5 * height, high - 0.7 * a}) {
            const Vector3d x(0.3, 1.2, z);
            // Along x and y factors are exact.
            for (bool ofTorque : {false, true}) {
                const double width = ofTorque ? a / pow(6 * sqrt(M_PI), 1.0 / 3) : a / sqrt(M_PI),
                             alongWave = flow.waveVelocity == 0
                                             ? 1
                                             : exp(-0.5 * flow.k * flow.k * width * width);
                Vector3d v = Vector3d::Zero(), slope = v, along = v;
                vector<double> ends = {low - 2 * period, low - period, low - gap, low, high,
                                       high + gap,       high + period};
                for (size_t piece = 1; piece < ends.size(); piece++)
                    for (int i = 0; i < nodes.size(); i++) {
                        const double half = 0.5 * (ends[piece] - ends[piece - 1]), d = 1e-5,
                                     there = ends[piece - 1] + half * (1 + nodes[i]),
                                     y = (there - z) / width,
                                     w = 2 * half * weights[i] * exp(-0.5 * y * y) /
                                         (sqrt(2 * M_PI) * width);
                        Vector3d at = x;
                        at[2] = there;
                        const auto difference = [&](int axis) -> Vector3d {
                            const Vector3d step = d * Vector3d::Unit(axis);
                            return (flowAt(at + step) - flowAt(at - step)) / (2 * d);
                        };
                        v += w * alongWave * flowAt(at);
                        slope += w * alongWave * difference(2);
                        along += w * alongWave * difference(flow.waveAxis);
                    }
                (ofTorque ? factors.torqueWidth : factors.width) = width;
                factors.gap = gap;
                const WaveFactors plain = overGaussians().waveFactors(a, flow.k);
                factors.s = plain.s;
                factors.t = plain.t;
                factors.laplacian = plain.laplacian;
                if (!ofTorque) {
                    EXPECT_LE((flow.velocityAt(x, factors) - v).cwiseAbs().maxCoeff(), 1e-9) << z;
                    continue;
                }
                Matrix3d G = Matrix3d::Zero();
                G.col(2) = slope;
                G.col(flow.waveAxis) += along;
                const Vector3d omega =
                    0.5 * Vector3d(G(2, 1) - G(1, 2), G(0, 2) - G(2, 0), G(1, 0) - G(0, 1));
                EXPECT_LE((flow.angularVelocityAt(x, factors) - omega).cwiseAbs().maxCoeff(), 1e-6)
                    << z;
            }
        }
    }
}

TEST(FlowBetweenPlanes, GaussiansAtAPlaneOfAHighChannelFeelOneWall) {
    // No exponential overflows.
    const double a = 0.5, high = low + 1e5;
    Vector3d first = Vector3d::Zero(), firstTurn = first;
    for (auto boundary : boundaries) {
        MobilityForce fluid = fluidOf(boundary);
        fluid.setChannelWalls(low, high);
        fluid.setSinusoidalForceDensity(1.3, 0, 1, 3);
        const DrivenFlow flow = flowOf(fluid);
        WaveFactors factors = overGaussians().waveFactors(a, flow.k);
        factors.width = a / sqrt(M_PI);
        factors.torqueWidth = a / pow(6 * sqrt(M_PI), 1.0 / 3);
        factors.gap = 2 * a;
        const Vector3d x(0, 0.4, low + a), y(0, 0.4, high - a);
        if (boundary == MobilityForce::PeriodicWall) {
            first = flow.velocityAt(x, factors);
            firstTurn = flow.angularVelocityAt(x, factors);
            continue;
        }
        // A small part of the envelope reaches the image of the other plane: a wall, or a surface,
        // with whose image the fluid in the gap moves.
        const double part = boundary == MobilityForce::Film ? 5e-3 : 1e-7;
        EXPECT_LE((flow.velocityAt(x, factors) - first).norm(), part * first.norm());
        EXPECT_LE((flow.angularVelocityAt(x, factors) - firstTurn).norm(), part * firstTurn.norm());
        EXPECT_TRUE(flow.velocityAt(y, factors).allFinite());
        if (boundary == MobilityForce::NoSlipChannel) {
            EXPECT_LE((flow.velocityAt(y, factors) - first).norm(), part * first.norm());
        }
    }
}

TEST(FlowBetweenPlanes, MeansOverTheHeight) {
    VectorXd nodes, weights;
    gauss(30, false, nodes, weights);
    for (const Case& one : allFlows()) {
        if (one.fluid.getBoundary() == MobilityForce::PeriodicWall) continue;
        SCOPED_TRACE(one.name);
        DrivenFlow flow = flowOf(one.fluid);
        const bool isWave = flow.waveVelocity != 0;
        Vector3d mean = Vector3d::Zero(), x(0, 0, 0);
        if (isWave) x[flow.waveAxis] = M_PI / (2 * flow.k);  // where the wave is 1
        for (int i = 0; i < nodes.size(); i++) {
            x[2] = 0.5 * (low + high) + 0.5 * height * nodes[i];
            mean += weights[i] * flow.velocityAt(x, {});
        }
        if (isWave) {
            EXPECT_NEAR(flow.waveVelocity * flow.meanOfWave(), mean[flow.forceAxis], 1e-14);
        } else {
            EXPECT_LE((flow.mean() - mean).cwiseAbs().maxCoeff(), 1e-14);
        }
        if (one.fluid.getChannelCondition() == MobilityForce::ZeroFlux) {
            EXPECT_LE(mean.cwiseAbs().maxCoeff(), 1e-15);
        }
    }
    // Poiseuille's flow: f H^2/(12 eta) in a channel, f H^2/(3 eta) in a film.
    for (auto boundary : {MobilityForce::NoSlipChannel, MobilityForce::Film}) {
        const Vector3d mean = UserFlow(fluidOf(boundary)).ofUnitForceDensity(1).mean();
        const double expected =
            height * height / (eta * (boundary == MobilityForce::Film ? 3 : 12));
        EXPECT_LE((mean - Vector3d(0, expected, 0)).cwiseAbs().maxCoeff(), 1e-15);
    }
    MobilityForce closed = fluidOf(MobilityForce::NoSlipChannel);
    closed.setChannelCondition(MobilityForce::ZeroFlux);
    EXPECT_TRUE(UserFlow(closed).ofUnitForceDensity(0).isZero());
    for (auto boundary : {MobilityForce::Periodic, MobilityForce::SlipChannel})
        EXPECT_TRUE(UserFlow(fluidOf(boundary)).ofUnitForceDensity(0).isZero());
}

TEST(FlowBetweenPlanes, AConditionOfAChannelIsNoneOfOthers) {
    MobilityForce film = fluidOf(MobilityForce::Film);
    film.setChannelCondition(MobilityForce::ZeroFlux);
    film.setBodyForceDensity(Vec3(1, 0, 0));
    EXPECT_GT(flowOf(film).mean()[0], 0);
}

TEST(FlowBetweenPlanes, WhatABoundaryDoesNotHaveIsRefused) {
    const auto refused = [](const MobilityForce& fluid, const vector<string>& fragments) {
        expectError([&] { UserFlow(fluid).check(); }, fragments);
    };
    for (auto boundary :
         {MobilityForce::Unbounded, MobilityForce::NoSlipWall, MobilityForce::Periodic,
          MobilityForce::SlipChannel, MobilityForce::PeriodicWall, MobilityForce::Film}) {
        MobilityForce fluid = fluidOf(boundary);
        fluid.setWallVelocity(Vec3(1, 0, 0));
        refused(fluid, {"a wall velocity (setWallVelocity()) is that of the upper wall of a "
                        "NoSlipChannel, and the boundary is " +
                            string(traitsOf(boundary).name),
                        "use setBoundary(NoSlipChannel), or setWallVelocity() with 0"});
    }
    for (auto boundary : {MobilityForce::Unbounded, MobilityForce::NoSlipWall,
                          MobilityForce::Periodic, MobilityForce::SlipChannel}) {
        MobilityForce fluid = fluidOf(boundary);
        fluid.setBodyForceDensity(Vec3(0, 1, 0));
        refused(fluid, {"drives a fluid between walls or in a film, and the boundary is " +
                            string(traitsOf(boundary).name),
                        "use setBoundary(NoSlipChannel) or (Film), or setBodyForceDensity() with "
                        "0"});
    }
    MobilityForce wall = fluidOf(MobilityForce::PeriodicWall);
    wall.setBodyForceDensity(Vec3(0, 1, 0));
    refused(wall, {"a uniform force density (setBodyForceDensity()) drives no steady flow above "
                   "a PeriodicWall",
                   "use setBackgroundFlow() for shear"});
    MobilityForce closed = fluidOf(MobilityForce::NoSlipChannel);
    closed.setBodyForceDensity(Vec3(1, 0, 0));
    closed.setChannelCondition(MobilityForce::ZeroFlux);
    refused(closed, {"drives no flow with the channel condition ZeroFlux, because the pressure "
                     "balances it",
                     "use setChannelCondition(ZeroPressureGradient)"});
    for (auto boundary : {MobilityForce::NoSlipChannel, MobilityForce::Film}) {
        const string remedy = boundary == MobilityForce::NoSlipChannel
                                  ? "use setWallVelocity() or setBodyForceDensity()"
                                  : "use setBodyForceDensity()";
        MobilityForce uniform = fluidOf(boundary), shear = fluidOf(boundary);
        uniform.setBackgroundFlow(Vec3(1, 0, 0), vector<double>(9, 0.0));
        shear.setBackgroundFlow(Vec3(-low, 0, 0), {0, 0, 1, 0, 0, 0, 0, 0, 0});
        for (const auto& fluid : {uniform, shear})
            refused(fluid, {"a background flow cannot be used with boundary " +
                                string(traitsOf(boundary).name) + ", whose flows are 0 on",
                            remedy});
    }
    MobilityForce uniform = fluidOf(MobilityForce::PeriodicWall);
    uniform.setBackgroundFlow(Vec3(1, 0, 0), vector<double>(9, 0.0));
    refused(uniform, {"the background flow is not 0 at the PeriodicWall z = -3.2 nm"});
    for (auto boundary : boundaries)
        for (const auto& [forceAxis, waveAxis] : {pair{2, 0}, pair{1, 2}}) {
            MobilityForce fluid = fluidOf(boundary);
            fluid.setSinusoidalForceDensity(1, forceAxis, waveAxis, 1);
            refused(fluid, {"both must be along the walls: give axes 0 and 1"});
        }
    // What is 0 is nothing.
    for (const BoundaryTraits& traits : boundaryTable) {
        MobilityForce fluid = fluidOf(traits.boundary);
        fluid.setWallVelocity(Vec3());
        fluid.setBodyForceDensity(Vec3());
        UserFlow(fluid).check();
    }
}

TEST(FlowBetweenPlanes, SettingsAreAlongTheWallsAndFinite) {
    MobilityForce fluid;
    const double nan = numeric_limits<double>::quiet_NaN();
    for (const Vec3& bad : {Vec3(0, 0, 1), Vec3(nan, 0, 0),
                            Vec3(0, numeric_limits<double>::infinity(), 0), Vec3(0, 0, nan)}) {
        expectError([&] { fluid.setWallVelocity(bad); },
                    {"setWallVelocity(): the velocity is ", "it must be finite and along the wall",
                     "give a velocity along x and y, with z = 0"});
        expectError([&] { fluid.setBodyForceDensity(bad); },
                    {"setBodyForceDensity(): the force density is ",
                     "it must be finite and along the walls",
                     "give a force density along x and y, with z = 0"});
    }
    EXPECT_EQ(fluid.getWallVelocity(), Vec3());
    EXPECT_EQ(fluid.getBodyForceDensity(), Vec3());
    fluid.setWallVelocity(Vec3(1, -2, 0));
    fluid.setBodyForceDensity(Vec3(-3, 4, 0));
    EXPECT_EQ(fluid.getWallVelocity(), Vec3(1, -2, 0));
    EXPECT_EQ(fluid.getBodyForceDensity(), Vec3(-3, 4, 0));
}
