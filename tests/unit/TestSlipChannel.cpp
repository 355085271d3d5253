// A fluid between two walls along which it slips: reference values, the flow at the walls,
// symmetry, and noise.

#include "linearalgebra/Decompositions.h"

#include "HydrodynamicSupport.h"
#include "mobility/models/forcecoupling/ForceCouplingGrid.h"
#include "mobility/models/periodic/PeriodicMobility.h"
#include "mobility/models/wall/SlipChannel.h"

using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace std;
using OpenMM::Vec3;

namespace {

const double eta = 1, low = -1.2, high = 4.3;
const BoxVectors box = {Vec3(9, 0, 0), Vec3(0, 7, 0), Vec3(0, 0, 10)};
const SlipWalls walls = {low, high, false};

HydrodynamicParticles mixture() {
    HydrodynamicParticles particles;
    particles.add(1, true, 0, 0);
    particles.add(0.6, false, 1, 1);
    particles.add(0.8, true, 2, 2);
    particles.add(0.7, false, 3, 1);
    return particles;
}
const vector<Vec3> places = {Vec3(1, 0.1, 2), Vec3(2.2, -0.5, 3.1), Vec3(8.5, 3.4, 9.7),
                             Vec3(2.9, 0.6, 3.3)};

unique_ptr<MobilityModel> dense(const HydrodynamicParticles& particles,
                                bool crossingAllowed = false) {
    return make_unique<SlipChannel>(
        particles, eta, SlipWalls{low, high, crossingAllowed},
        make_unique<PeriodicForceCoupling>(SlipChannel::withImages(particles), eta));
}
unique_ptr<MobilityModel> onGrid(const HydrodynamicParticles& particles, double tolerance) {
    return make_unique<SlipChannel>(
        particles, eta, walls,
        make_unique<ForceCouplingGrid>(particles, eta, tolerance, 0, make_shared<PlainGridFluid>(),
                                       true));
}
MatrixXd matrixAt(const MobilityModel& model, const vector<Vec3>& positions) {
    MatrixXd M;
    model.at({positions, box})->dense(M);
    return M;
}

}  // namespace

TEST(SlipChannel, OneSphere) {
    // The expected diagonal entries and the derivative towards the walls are those of PERIODIC
    // fluids, part 4. Two other ways of summing gave these values.
    HydrodynamicParticles one;
    one.add(1, true, 0, 0);
    const auto model = dense(one, true);
    const auto at = [&](double y) { return matrixAt(*model, {Vec3(3, low + y, 2)}); };
    const MatrixXd M = at(1);
    EXPECT_NEAR(M(0, 0), 0.04824844196, 1e-11);
    EXPECT_NEAR(M(1, 1), 0.01853161598, 1e-11);
    EXPECT_NEAR(M(2, 2), 0.04607665115, 1e-11);
    const double delta = 1e-4;
    EXPECT_NEAR((at(1 + delta)(1, 1) - at(1 - delta)(1, 1)) / (2 * delta), 0.02038153982, 1e-9);
    // The mobility is symmetric about the middle of the channel.
    const double middle = (high - low) / 2;
    EXPECT_NEAR(at(middle + 0.7)(1, 1), at(middle - 0.7)(1, 1), 1e-13);
    EXPECT_NEAR(at(middle + 0.7)(5, 0), -at(middle - 0.7)(5, 0), 1e-13);
}

TEST(SlipChannel, FlowsAlongItsWallsWithoutShear) {
    // Points drift with the flow of a force and a torque. They have no velocity through a wall, and
    // near the wall their velocity along it does not change with the distance.
    HydrodynamicParticles particles;
    particles.add(1, true, 0, 0);
    particles.add(1e-3, false, 1, -1);
    const auto model = dense(particles);
    VectorXd forces = VectorXd::Zero(9);
    forces.head<6>() << 1, -2, 0.5, 0.3, 1, -2;
    const auto flow = [&](double y) {
        const MatrixXd M = matrixAt(*model, {Vec3(3, 0.2, 2), Vec3(4.1, y, 3.2)});
        return Vector3d(M.bottomRows<3>() * forces);
    };
    const double near = 0.002, further = 0.01;
    for (double side : {1, -1}) {
        const double wall = side > 0 ? low : high;
        const Vector3d at = flow(wall + side * near), beyond = flow(wall + side * further);
        EXPECT_GT(at.norm(), 5e-3);
        EXPECT_LT(abs(at.y()), 0.2 * near) << wall;
        // Without shear the velocity changes as the square of the distance.
        EXPECT_LT(abs(beyond.x() - at.x()), 0.1 * further * further);
        EXPECT_LT(abs(beyond.z() - at.z()), 0.1 * further * further);
        EXPECT_GT(abs(beyond.y()), 2 * abs(at.y()));
    }
}

TEST(SlipChannel, IsSymmetricAndPositiveDefinite) {
    const HydrodynamicParticles particles = mixture();
    for (bool grid : {false, true}) {
        const auto model = grid ? onGrid(particles, 1e-3) : dense(particles);
        const MatrixXd M = matrixAt(*model, places);
        EXPECT_LT((M - M.transpose()).norm(), 1e-13 * M.norm());
        EXPECT_EQ(Eigen::LLT<MatrixXd>(M).info(), Eigen::Success);
        MatrixXd product;
        model->at({places, box})->multiply(MatrixXd::Identity(M.rows(), M.rows()), product);
        EXPECT_LT((product - M).norm(), 1e-13 * M.norm());
    }
}

TEST(SlipChannel, ReflectionsAreTheSameFluid) {
    const HydrodynamicParticles particles = mixture();
    const auto model = dense(particles);
    vector<Vec3> reflected = places;
    for (Vec3& x : reflected) x[1] = low + high - x[1];
    MatrixXd M = matrixAt(*model, reflected);
    auto& channel = static_cast<SlipChannel&>(*model);
    channel.reflectRows(M);
    MatrixXd turned = M.transpose();
    channel.reflectRows(turned);
    EXPECT_LT((turned - matrixAt(*model, places)).norm(), 1e-12 * M.norm());
}

TEST(SlipChannel, GridsHaveTheirTolerance) {
    const HydrodynamicParticles particles = mixture();
    const MatrixXd exact = matrixAt(*dense(particles), places);
    const VectorXd root = exact.diagonal().cwiseSqrt().cwiseInverse();
    const auto norm = [&](const MatrixXd& M) {
        return Eigen::SelfAdjointEigenSolver<MatrixXd>(
                   MatrixXd(root.asDiagonal() * M * root.asDiagonal()))
            .eigenvalues()
            .cwiseAbs()
            .maxCoeff();
    };
    for (double tolerance : {1e-2, 1e-4, 1e-6})
        EXPECT_LT(norm(matrixAt(*onGrid(particles, tolerance), places) - exact),
                  tolerance * norm(exact));
}

TEST(SlipChannel, TraitsAreThoseOfItsModelExceptForTheWalls) {
    const auto model = onGrid(mixture(), 1e-3), ofImages = dense(mixture());
    for (const MobilityModel* each : {model.get(), ofImages.get()}) {
        const MobilityTraits& traits = each->getTraits();
        EXPECT_STREQ(traits.name, "ForceCoupling");
        EXPECT_TRUE(traits.mayObject && traits.holdsNearby);
        EXPECT_FALSE(traits.isHomogeneous || traits.isIsotropic || traits.isDivergenceFree);
        EXPECT_FALSE(traits.isMirrored);
    }
    const MobilityTraits &onGrid = model->getTraits(), &asMatrix = ofImages->getTraits();
    EXPECT_TRUE(onGrid.isMatrixFree && onGrid.isAnchored && onGrid.hasProducts);
    EXPECT_FALSE(asMatrix.isMatrixFree || asMatrix.hasProducts);
    ASSERT_TRUE(model->grid() && model->randomField());
    EXPECT_TRUE(model->randomField()->isLocal());
    EXPECT_FALSE(ofImages->grid() || ofImages->randomField());
}

TEST(SlipChannel, TheRandomFieldHasTheCovarianceOfProducts) {
    // The test allows five standard errors of a product of normal numbers, sqrt((M_ii M_kk +
    // M_ik^2)/n).
    const HydrodynamicParticles particles = mixture();
    const auto model = onGrid(particles, 0.05);
    const MatrixXd M = matrixAt(*model, places);
    MatrixXd sum = MatrixXd::Zero(M.rows(), M.rows()), slips;
    unique_ptr<RandomField> field;
    const int samples = 1500;
    NoiseStream noise;
    noise.seed = 11;
    for (int i = 0; i < samples; i++) {
        noise.step = i;
        model->randomField()->draw(noise, NoiseStream::ParticleFirstDraw, box, field);
        field->slipsAt({places, box}, false, slips);
        sum += slips * slips.transpose() / samples;
    }
    for (int i = 0; i < M.rows(); i++)
        for (int k = 0; k <= i; k++)
            EXPECT_LT(abs(sum(i, k) - M(i, k)),
                      5 * sqrt((M(i, i) * M(k, k) + M(i, k) * M(i, k)) / samples))
                << i << k;
}

TEST(SlipChannel, GradientsAreThoseOfTheField) {
    const HydrodynamicParticles particles = mixture();
    const auto model = onGrid(particles, 1e-4);
    unique_ptr<RandomField> field;
    model->randomField()->draw(NoiseStream(), NoiseStream::ParticleFirstDraw, box, field);
    ASSERT_TRUE(field->hasGradients());
    MatrixXd slips, gradients, ahead, behind;
    field->slipsAt({places, box}, false, slips);
    field->gradientsAt({places, box}, false, gradients);
    const double delta = 1e-5;
    for (int b = 0; b < 3; b++) {
        vector<Vec3> moved = places;
        for (Vec3& x : moved) x[b] += delta;
        field->slipsAt({moved, box}, true, ahead);
        for (Vec3& x : moved) x[b] -= 2 * delta;
        field->slipsAt({moved, box}, true, behind);
        for (int i = 0; i < particles.size(); i++)
            for (int a = 0; a < 3; a++) {
                const int row = particles.firstRow[i] + a;
                EXPECT_NEAR(gradients(3 * a + b, i), (ahead(row, 0) - behind(row, 0)) / (2 * delta),
                            1e-7 * slips.norm());
            }
    }
}
