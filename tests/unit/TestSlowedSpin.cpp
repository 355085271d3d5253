// Bodies with a spin slowed so that a step resolves it: their mobility in all strategies, and the
// digits of nearly straight bodies.

#include "CoupledBodiesSupport.h"
#include "HydrodynamicSupport.h"
#include "TestSupport.h"
#include "mobility/models/rotneprager/RotnePragerYamakawa.h"

using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace std;

namespace {

const double eta = 0.7;

unique_ptr<MobilityModel> makeRpy(const HydrodynamicParticles& particles) {
    return make_unique<RotnePragerYamakawa>(particles, eta);
}

FluidElement element(int body, const vector<Vector3d>& sites, double radius) {
    FluidElement e;
    e.body = body;
    e.sites = sites;
    e.radii.assign(sites.size(), radius);
    for (size_t i = 0; i < sites.size(); i++) e.particles.push_back(10 * body + i);
    return e;
}

/** Five touching blobs along a skew line, each of them off the line by about `bend`. */
FluidElement rod(int body, double bend) {
    const Vector3d line = Vector3d(1, 2, 3).normalized(), x = line.unitOrthogonal(),
                   y = line.cross(x);
    const double off[5][2] = {{0.3, -1}, {-0.8, 0.4}, {1, 0.2}, {-0.3, 0.7}, {0.1, -0.6}};
    vector<Vector3d> sites;
    for (int i = 0; i < 5; i++)
        sites.push_back((i - 2) * line + bend * (off[i][0] * x + off[i][1] * y));
    return element(body, sites, 0.5);
}

}  // namespace

TEST(SlowedSpin, IsAPartOfTheMobilityAboutOneScrew) {
    for (int seed = 1; seed <= 20; seed++) {
        MatrixXd N = tensorWithoutSymmetry(seed);
        const double fast = 30;
        N.row(5) *= fast;
        N.col(5) *= fast;
        const double mu = findRotation(N, 0).fastest, energy = 3 / mu;  // 3 rad^2 in a step
        for (const SpinBounds& bounds : {boundsOfStart, boundsOfMidpoint}) {
            const BodyRotation rotation = findRotation(N, energy, bounds);
            const SlowedSpin& spin = rotation.spin;
            ASSERT_TRUE(spin.isSlowed());
            const double bound = max(bounds.target, bounds.ratio * energy * rotation.second);
            EXPECT_NEAR(energy * rotation.fastestInStep(), bound, 1e-14);
            const MatrixXd slowed = spin.slow(N);
            SlowedSpin::Vector6d whole = spin.screw;
            whole.head<3>() += spin.advance * spin.axis;
            const SlowedSpin::Vector6d kept = spin.slowedScrew();
            const MatrixXd rest = N - mu * whole * whole.transpose(),
                           expected = rest + mu * kept * kept.transpose();
            const double rounding = 1e-10 * N.cwiseAbs().maxCoeff();
            EXPECT_LT((slowed - expected).cwiseAbs().maxCoeff(), rounding);
            // Without the spin no torque about the axis turns anything. Motion along the axis has
            // its whole mobility.
            EXPECT_LT((rest.rightCols<3>() * spin.axis).norm(), 1e-10 * mu);
            const auto along = [&](const MatrixXd& M) {
                return spin.axis.dot(M.topLeftCorner<3, 3>() * spin.axis);
            };
            EXPECT_NEAR(along(slowed), along(N), rounding);
            // What the watch of driven spins reads is the spin that a wrench causes.
            const VectorXd wrench = VectorXd::LinSpaced(6, -1, 2);
            EXPECT_NEAR(spin.axis.dot((slowed * wrench).tail<3>()),
                        spin.factor * mu * kept.dot(wrench), 10 * rounding);
            EXPECT_GT(Eigen::SelfAdjointEigenSolver<MatrixXd>(slowed).eigenvalues()[0], 0);
            // A step that resolves the spin is not changed.
            EXPECT_FALSE(findRotation(N, 0.999 * bounds.resolved / mu, bounds).spin.isSlowed());
        }
        EXPECT_FALSE(findRotation(N, 0).spin.isSlowed());  // no noise
    }
    // No axis is much faster than the next.
    MatrixXd alike = MatrixXd::Identity(6, 6);
    alike(3, 3) = 0.99 * leastSpinRatio;
    EXPECT_FALSE(findRotation(alike, 1e6).spin.isSlowed());
    alike(3, 3) = 1.01 * leastSpinRatio;
    EXPECT_TRUE(findRotation(alike, 1e6).spin.isSlowed());
}

/** Constant tensors, matrices and iterations give the same N' = B N B^T, also beside others. */
TEST(SlowedSpin, AllStrategiesHaveTheSlowedMobility) {
    Pose far;
    far.R = Vector3d(3, 1, 0.5);
    far.q = {0.5, 0.5, -0.5, 0.5};
    FluidElement own = rod(0, 0.3);
    own.ownMobility = tensorWithoutSymmetry(2);
    own.ownMobility.row(4) *= 20;
    own.ownMobility.col(4) *= 20;
    const vector<vector<FluidElement>> scenes = {
        {rod(0, 0.3)}, {own}, {rod(0, 0.3), rod(1, 0.2)}, {own, rod(1, 0.2)}};
    for (const auto& elements : scenes) {
        SCOPED_TRACE(elements.size());
        TestedBodies real(elements, makeRpy);
        vector<SlowedSpin> spins;
        for (size_t e = 0; e < elements.size(); e++) {
            spins.push_back(findRotation(real->alone(e).mobility, 1e4).spin);
            ASSERT_TRUE(spins[e].isSlowed());
            spins[e].factor = 0.2 + 0.3 * e;
        }
        CoupledBodies slowedBodies(*real, spins);
        BodyMobilities strategies(slowedBodies, 1e-10);
        vector<Pose> poses = {far, Pose()};
        poses.resize(elements.size());
        real.setPoses(poses);
        MatrixXd B = MatrixXd::Identity(6 * elements.size(), 6 * elements.size());
        for (size_t e = 0; e < elements.size(); e++) {
            const MatrixXd turn = twoRotations(poses[e].rotation());
            B.block<6, 3>(6 * e, 6 * e + 3) -= (1 - spins[e].factor) * turn * spins[e].screw *
                                               (poses[e].rotation() * spins[e].axis).transpose();
        }
        const MatrixXd expected = B * real.mobility() * B.transpose();
        for (auto way : {BodyMobility::Constant, BodyMobility::Dense, BodyMobility::Krylov}) {
            if ((way == BodyMobility::Constant) != slowedBodies.isConstantInBodyFrame()) continue;
            BodyMobility& mobility = strategies.get(way);
            mobility.setPoses(poses);
            MatrixXd found;
            mobility.solve(MatrixXd::Identity(expected.rows(), expected.rows()), found);
            EXPECT_LT(difference(found, expected), way == BodyMobility::Krylov ? 1e-8 : 1e-10);
        }
    }
}

/**
 * In a fluid that rotates as a whole, force-free bodies rotate with it, whether their spin is
 * slowed or not: each strategy must give back what K' takes from the spin, with its sign and about
 * the right origin.
 */
TEST(SlowedSpin, BodiesInAFlowSpinAsOtherwise) {
    DrivenFlow flow;
    const Vector3d omega(0.3, -0.7, 0.5);
    for (int k = 0; k < 3; k++) flow.gradient.col(k) = omega.cross(Vector3d::Unit(k));
    flow.velocity = Vector3d(0.2, 0.1, -0.4);
    FluidElement shifted = rod(0, 0.3);  // about a point off its line
    for (Vector3d& site : shifted.sites) site += Vector3d(0.4, -0.2, 0.3);
    const vector<vector<FluidElement>> scenes = {{shifted}, {shifted, rod(1, 0.2)}};
    for (const auto& elements : scenes) {
        TestedBodies real(elements, makeRpy);
        vector<SlowedSpin> spins;
        for (size_t e = 0; e < elements.size(); e++) {
            spins.push_back(findRotation(real->alone(e).mobility, 1e4).spin);
            ASSERT_TRUE(spins[e].isSlowed());
            spins[e].factor = 0.1;
        }
        CoupledBodies slowedBodies(*real, spins);
        BodyMobilities strategies(slowedBodies, 1e-10);
        vector<Pose> poses(2);
        poses[0].R = Vector3d(3, 1, 0.5);
        poses[0].q = {0.5, 0.5, -0.5, 0.5};
        poses.resize(elements.size());
        VectorXd expected(6 * elements.size());
        for (size_t e = 0; e < elements.size(); e++)
            expected.segment<6>(6 * e) << flow.velocity + omega.cross(poses[e].R), omega;
        for (auto way : {BodyMobility::Constant, BodyMobility::Dense, BodyMobility::Krylov}) {
            if ((way == BodyMobility::Constant) != slowedBodies.isConstantInBodyFrame()) continue;
            BodyMobility& mobility = strategies.get(way);
            mobility.setPoses(poses);
            MatrixXd twists;
            mobility.flow().twistsOf(flow, twists);
            EXPECT_LT((twists - expected).cwiseAbs().maxCoeff(), 1e-8) << way;
        }
    }
}

/**
 * A rod with a relative bend of `bend` tumbles like the straight rod, up to its bend, and spins
 * faster by 1/bend^2. Its friction alone would lose these digits: the friction about the line is
 * bend^2 of the rest.
 */
TEST(SlowedSpin, NearlyStraightBodiesKeepTheirDigits) {
    TestedBodies straight({rod(0, 0)}, makeRpy);
    const Vector3d line = Vector3d(1, 2, 3).normalized(), across = line.unitOrthogonal();
    const auto tumbling = [&](const MatrixXd& N) {
        return across.dot(N.bottomRightCorner<3, 3>() * across);
    };
    const double right = tumbling(straight->alone(0).mobility);
    double spinTimesSquare = 0;
    const double energy = 1e-2;
    for (double bend : {1e-2, 1e-3, 1e-4, 1e-5, 1e-6}) {
        TestedBodies bodies({rod(0, bend)}, makeRpy);
        const BodyRotation rotation = findRotation(bodies->alone(0).mobility, energy);
        ASSERT_TRUE(rotation.spin.isSlowed()) << bend;
        EXPECT_LT(abs(abs(rotation.spin.axis.dot(line)) - 1), bend * bend + 1e-14);
        if (bend == 1e-3) spinTimesSquare = rotation.fastest * bend * bend;
        if (bend < 1e-3) {
            EXPECT_NEAR(rotation.fastest * bend * bend, spinTimesSquare, 2e-3 * spinTimesSquare);
        }
        CoupledBodies slowed(*bodies, {rotation.spin});
        BodyMobilities strategies(slowed, 1e-8);
        BodyMobility& mobility = strategies.get(BodyMobility::Constant);
        EXPECT_NEAR(tumbling(mobility.mobility()), right, 0.1 * bend * right + 1e-5 * right)
            << bend;
        const Vector3d axis = rotation.spin.axis;
        EXPECT_NEAR(axis.dot(mobility.mobility().bottomRightCorner<3, 3>() * axis),
                    max(boundsOfStart.target / energy, leastSpinRatio * rotation.second),
                    1e-3 * boundsOfStart.target / energy)
            << bend;
    }
}
