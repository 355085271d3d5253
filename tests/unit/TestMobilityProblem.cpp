// Noise of the mobility problem, without matrices: covariance, and what units and radii do to its accuracy.

#include "HydrodynamicSupport.h"
#include "TestSupport.h"
#include "mobility/MobilityProblem.h"
#include "mobility/RotnePragerYamakawa.h"

using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace std;

namespace {

/** Spheres and a free particle of unequal radii, all lengths times a unit. */
struct Spheres {
    vector<FluidElement> elements;
    vector<Pose> poses;
    unique_ptr<BodyMobility> bodies;
    explicit Spheres(double unit) {
        for (int i = 0; i < 9; i++) {
            FluidElement e;
            const bool isFree = i == 8;
            e.body = isFree ? -1 : i;
            e.sites = {Vector3d::Zero()};
            e.radii = {unit * (i % 3 == 0 ? 1 : i % 3 == 1 ? 0.3 : 2)};
            e.particles = {i};
            elements.push_back(e);
            Pose pose;
            pose.R = unit * Vector3d(3.2 * (i % 3), 3.1 * (i / 3), 0.4 * i);
            poses.push_back(pose);
        }
        bodies.reset(new BodyMobility(elements, [](const HydrodynamicParticles& particles) {
            return unique_ptr<MobilityModel>(new RotnePragerYamakawa(particles, 1));
        }));
        bodies->setPoses(poses);
    }
};

}  // namespace

TEST(MobilityProblem, NoiseOfSpheresHasItsCovarianceInAnyUnit) {
    for (double unit : {1e-3, 1.0, 1e3}) {
        Spheres spheres(unit);
        const int n = spheres.bodies->getNumRows();
        // What entries are measured in: 1/length, 1/length^2, 1/length^3.
        VectorXd scale(n);
        for (int r = 0; r < n; r++) scale[r] = pow(unit, r % 6 < 3 ? 0.5 : 1.5);
        const double tolerance = 1e-3;
        MobilityProblem problem(*spheres.bodies, true, tolerance);
        problem.setPoses(spheres.poses);
        MatrixXd slips, wrenches;
        // The symmetric root, column by column, each to five tolerances: so the covariance to ten.
        problem.thermalSlip(MatrixXd::Identity(n, n), slips);
        problem.thermalWrench(MatrixXd::Identity(n, n), wrenches);
        const MatrixXd N = scale.asDiagonal() * spheres.bodies->mobility() * scale.asDiagonal();
        const MatrixXd xi =
            scale.cwiseInverse().asDiagonal() * spheres.bodies->friction() * scale.cwiseInverse().asDiagonal();
        const MatrixXd root = scale.asDiagonal() * slips, inverseRoot = scale.cwiseInverse().asDiagonal() * wrenches;
        EXPECT_LT((root * root.transpose() - N).norm(), 10 * tolerance * N.norm()) << unit;
        EXPECT_LT((inverseRoot * inverseRoot.transpose() - xi).norm(), 10 * tolerance * xi.norm()) << unit;
    }
}

TEST(MobilityProblem, UnitsChangeNothingButNumbers) {
    Spheres small(1), large(1e3);
    const int n = small.bodies->getNumRows();
    const VectorXd W = VectorXd::LinSpaced(n, -1, 2).array().sin();
    const auto noise = [&](Spheres& spheres, int& iterations) {
        MobilityProblem problem(*spheres.bodies, true, 1e-3);
        problem.setPoses(spheres.poses);
        MatrixXd slips;
        const long long before = spheres.bodies->numSolverIterations;
        problem.thermalSlip(W, slips);
        iterations = spheres.bodies->numSolverIterations - before;
        return VectorXd(slips);
    };
    int iterationsSmall, iterationsLarge;
    const VectorXd a = noise(small, iterationsSmall);
    VectorXd b = noise(large, iterationsLarge);
    for (int r = 0; r < n; r++) b[r] *= pow(1e3, r % 6 < 3 ? 0.5 : 1.5);
    EXPECT_LT((a - b).norm(), 1e-10 * a.norm());
    EXPECT_EQ(iterationsSmall, iterationsLarge);
}
