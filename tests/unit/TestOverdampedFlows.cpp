// The flow of the fluid in one step of the schemes without momenta. TestOverdampedSchemes has the
// steps themselves.

#include "OverdampedSteps.h"

using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace std;

namespace {

const vector<OpenMM::Vec3> pointsOfFluid = {OpenMM::Vec3(0.4, 1.2, 1.4),
                                            OpenMM::Vec3(1.5, -0.6, 2.1)};

/** The flow at points of the fluid that is made by these shares of a step's flow. */
VectorXd flowAt(BodyMobility& mobility, const FlowOfStep& made, RandomField* field,
                const DrivenFlow* driven = nullptr) {
    Velocities velocities = Velocities::Zero(3, pointsOfFluid.size());
    for (const FlowOfStep::Share& share : made.shares) {
        mobility.setPoses(share.poses, true);
        mobility.flow().addAt(
            mobility.flow().sourcesOf(share.forces, share.movesBodies ? driven : nullptr,
                                      share.movesBodies),
            pointsOfFluid, share.weight, velocities);
    }
    if (made.fieldWeight != 0) field->addFlowAt(pointsOfFluid, made.fieldWeight, velocities);
    return velocities.reshaped();
}

/** Steps whose flow is recorded. */
struct FlowingSteps : Steps {
    const char* name;
    FlowingSteps(Integrator::Scheme s, const Scene& scene, double kT)
        : Steps(s, scene, kT), name(traitsOf(s).name) {}
    /** The flow of step i, times h. */
    VectorXd flow(int i, double h) {
        FlowOfStep made;
        move.recording.flow = &made;
        increment(i, h);
        move.recording.flow = nullptr;
        made.check(name);
        return h * flowAt(move.getMobility(), made, move.getField());
    }
};

/**
 * div N_xQ of the flow at points that a wrench makes, by central differences of the bodies' poses.
 */
VectorXd divergenceOfFlow(const Scene& scene) {
    auto bodies = scene.mobility();
    BodyMobility& mobility = bodies.byMatrices();
    const int n = bodies->getNumRows();
    const double delta = 1e-4;
    VectorXd sum = VectorXd::Zero(3 * pointsOfFluid.size());
    MatrixXd twists, forces;
    for (int k = 0; k < n; k++)
        for (double sign : {1, -1}) {
            mobilityAt(scene, bodies, sign * delta * VectorXd::Unit(n, k));
            const vector<Pose> poses = mobility.getPoses();
            mobility.solve(MatrixXd(VectorXd::Unit(n, k)), twists);
            mobility.getBlobForces(forces);
            FlowOfStep made;
            made.shares.push_back({1, poses, forces, false});
            sum += sign / (2 * delta) * flowAt(mobility, made, nullptr);
        }
    return sum;
}

/** The mean of a step's flow, without sampling. */
struct ExactFlows : ExactSteps {
    const char* name;
    bool whole = true;  // false: only the flow that comes from solves for velocities
    ExactFlows(Integrator::Scheme s, const Scene& scene, double kT)
        : ExactSteps(s, scene, kT), name(traitsOf(s).name) {}
    VectorXd take(const RandomNumbers& values) override {
        FlowOfStep made;
        move.recording.flow = &made;
        ExactSteps::take(values);
        move.recording.flow = nullptr;
        made.check(name);
        if (!whole) {
            // Besides these shares, only thermal slips are recorded.
            made.fieldWeight = 0;
            if (made.shares.size() > 1) made.shares.resize(1);
        }
        return flowAt(move.getMobility(), made, move.getField());
    }
};

/**
 * The mean flow of a step without forces is kT div N_xQ. It is the stochastic drift of a particle
 * at the point, without the fluid's own derivative, because the point stays where it is.
 */
void checkMeanFlow(const Scene& scene) {
    const double kT = 1.3;
    checkMean<ExactFlows>(scene, kT, kT * divergenceOfFlow(scene));
}

/** The same by sampling, where pairs have random numbers of their own. */
void checkSampledMeanFlow(const Scene& scene, const vector<Integrator::Scheme>& schemes) {
    const double h = 1e-4, kT = 1.3;
    const VectorXd expected = kT * h * divergenceOfFlow(scene);
    for (Integrator::Scheme scheme : schemes) {
        SCOPED_TRACE(scene.name + ", " + traitsOf(scheme).name);
        FlowingSteps steps(scheme, scene, kT);
        checkSampledMean(expected, h, [&](int k, double h) { return steps.flow(k, h); });
    }
}

}  // namespace

TEST(OverdampedFlows, MeanFlowOfOneBodyAboutAnyPoint) { checkMeanFlow(aloneOffCentre()); }
TEST(OverdampedFlows, MeanFlowOfThreeBlobsAboveAWall) { checkMeanFlow(boomerangAtWall()); }
TEST(OverdampedFlows, MeanFlowOfRodsUnbounded) { checkMeanFlow(rodsUnbounded()); }
TEST(OverdampedFlows, MeanFlowWithOwnTensors) { checkMeanFlow(ownTensors()); }
TEST(OverdampedFlows, MeanFlowWithARandomField) { checkMeanFlow(blobsInAField()); }
TEST(OverdampedFlows, MeanFlowWithLubricationOfPairs) { checkMeanFlow(lubricatedSpheresAtWall()); }
/** Only this scheme is sampled here, with two spheres; the others would take minutes. */
TEST(OverdampedFlows, MeanFlowWithLubricationOfPairsMatrixFree) {
    Scene scene = lubricatedSpheresAtWall();
    scene.elements.erase(scene.elements.begin() + 2);
    scene.R.erase(scene.R.begin() + 2);
    scene.q.erase(scene.q.begin() + 2);
    checkSampledMeanFlow(matrixFree(scene), {Integrator::TractionEulerMaruyama});
}
TEST(OverdampedFlows, FullMeanFlowWithLubricationOfPairsMatrixFree) {
    checkSampledMeanFlow(matrixFree(lubricatedSpheresAtWall()), consistent);
    checkSampledMeanFlow(matrixFree(lubricatedBodiesAtWall()), {Integrator::TractionEulerMaruyama});
}
TEST(OverdampedFlows, MeanFlowWithLubrication) { checkMeanFlow(stokesianSpheres()); }

/**
 * Without the random flow, the flow of the forces that keep bodies rigid has another mean, because
 * the random flow is correlated with nu.
 */
TEST(OverdampedFlows, MeanFlowNeedsTheRandomFlow) {
    const double kT = 1.3;
    for (const Scene& scene : {boomerangAtWall(), blobsInAField()}) {
        const VectorXd expected = kT * divergenceOfFlow(scene);
        ExactFlows flows(Integrator::DriftCorrectorFD, scene, kT);
        flows.whole = false;
        EXPECT_GT((flows.mean() - expected).norm(), 0.1 * expected.norm()) << scene.name;
    }
}

/**
 * Spheres have no Brownian stress, because the flow of a force has no divergence, neither with
 * respect to the position of the force nor to the point. The mean flow is therefore that of forces
 * alone. With slips of the mid-point instead of those of the start, the drift correctors would have
 * a mean of 0.01 in row 3.
 */
TEST(OverdampedFlows, MeanFlowOfSpheresIsThatOfForces) {
    Scene scene;
    scene.add(element(0, {{0, 0, 0}}, {0.9}), {0, 0, 0});
    scene.add(element(1, {{0, 0, 0}}, {0.8}), {1.4, 0.7, 0.5});
    scene.add(element(-1, {{0, 0, 0}}, {0.6}), {-0.6, 1.9, 1.0});
    EXPECT_LT(divergenceOfFlow(scene).norm(), 1e-8);
    for (Integrator::Scheme scheme : overdampedSchemes)
        for (bool iterate : {false, true})
            EXPECT_LT(ExactFlows(scheme, iterate ? matrixFree(scene) : scene, 1).mean().norm(),
                      iterate ? 3e-4 : 3e-5)
                << traitsOf(scheme).name << (iterate ? ", matrix-free" : "");
}

TEST(OverdampedFlows, SayWhatTheirFlowIs) {
    // Each solve for velocities is recorded once. FlowingSteps::flow() checks this too, with noise.
    for (Integrator::Scheme scheme : overdampedSchemes)
        for (bool whole : {false, true})
            for (double kT : {0.0, 1.0}) {
                const Scene scene = threeBodiesAtWall();
                FlowingSteps steps(scheme, scene, kT);
                steps.step.driftFactorScalesAll = whole;
                FlowOfStep made;
                steps.move.recording.flow = &made;
                steps.increment(0, 0.01);
                EXPECT_NO_THROW(made.check(traitsOf(scheme).name)) << traitsOf(scheme).name;
                EXPECT_NEAR(made.solveWeight, made.flowWeight, 1e-14);
                if (kT == 0) {
                    EXPECT_EQ(made.flowWeight, 1);
                }
            }
    FlowOfStep forgotten;
    expectError(
        [&] { forgotten.check("Forgetful"); },
        {"the scheme Forgetful does not record the flow of its step completely",
         "its solves for velocities in this flow add up to 0.000000, and must add up to 1.000000",
         "give each such solve its weight"});
}
