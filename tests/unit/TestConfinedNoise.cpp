// The random field of Rotne-Prager-Yamakawa beside walls on a grid: its covariance is the mobility,
// and both of its parts are positive.

#include <Eigen/Dense>
#include <map>
#include <random>

#include "GridFluidSupport.h"
#include "Instrumented.h"
#include "TestSupport.h"
#include "UnitNoise.h"
#include "linearalgebra/Decompositions.h"
#include "mobility/models/confined/ConfinedRandomField.h"
#include "mobility/models/confined/ConfinedRotnePragerYamakawa.h"
#include "mobility/models/confined/NearPlanes.h"
#include "mobility/models/ewald/NearPair.h"
#include "mobility/models/ewald/WaveField.h"
#include "mobility/models/forcecoupling/CpuGridFluid.h"
#include "mobility/models/forcecoupling/GridWalls.h"
#include "mobility/models/periodic/PeriodicMobility.h"

using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace OpenMM;
using namespace std;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

const double eta = 0.7, low = -3.1;

enum Fluid { Wall, Channel, ClosedChannel };

ConfiningPlanes planesOf(Fluid fluid, double height, bool crossing = false) {
    MobilityForce force;
    force.setBoundary(fluid == Wall ? MobilityForce::PeriodicWall : MobilityForce::NoSlipChannel);
    force.setWallHeight(low);
    force.setChannelWalls(low, low + height);
    if (fluid == ClosedChannel) force.setChannelCondition(MobilityForce::ZeroFlux);
    return ConfiningPlanes(force, crossing);
}

struct Scene {
    HydrodynamicParticles particles;
    Placement placement;
};

/** Particles of these radii, with torque or without, some of which touch walls or overlap. */
Scene mixture(int number, double height, unsigned seed, const vector<double>& radii = {1, 0.7},
              double width = 6) {
    Scene scene;
    mt19937 random(seed);
    uniform_real_distribution<double> uniform(0, 1);
    scene.placement.box = {Vec3(width, 0, 0), Vec3(0, width + 1, 0), Vec3(0, 0, 3)};
    for (int i = 0; i < number; i++) {
        const double a = radii[i % radii.size()], range = height - 2 * a;
        scene.particles.add(a, i % 3 == 0, i, i);
        const double z = i % 5 == 0 ? a : i % 5 == 1 ? height - a : a + range * uniform(random);
        scene.placement.positions.push_back(
            Vec3(15 * uniform(random) - 4, 15 * uniform(random) - 4, low + z));
    }
    return scene;
}

/** Matrices scaled by roots of the own mobilities of spheres in unbounded fluid. */
MatrixXd scaled(const MatrixXd& M, const HydrodynamicParticles& particles) {
    VectorXd d(particles.numRows);
    for (int i = 0; i < particles.size(); i++) {
        const double a = particles.radii[i];
        d.segment<3>(particles.firstRow[i]).setConstant(sqrt(6 * M_PI * eta * a));
        if (particles.hasTorque[i])
            d.segment<3>(particles.firstRow[i] + 3).setConstant(sqrt(8 * M_PI * eta * a * a * a));
    }
    return d.asDiagonal() * M * d.asDiagonal();
}

VectorXd eigenvalues(const MatrixXd& A) {
    return Eigen::SelfAdjointEigenSolver<MatrixXd>(MatrixXd(0.5 * (A + A.transpose())))
        .eigenvalues();
}
double normOf(const MatrixXd& A) { return eigenvalues(A).cwiseAbs().maxCoeff(); }

/** The parts of a field as matrices. */
struct Parts {
    MatrixXd M, pairs, rest;

    /** The velocities of one field without the pairs. */
    static VectorXd restOf(const Scene& scene, const ConfinedRotnePragerYamakawaGrid& model,
                           const NoiseStream& noise) {
        NoiseStream ofWaves = noise;
        ofWaves.field = 1;  // of the group of particle 0
        VectorXd result;
        withColumns(scene, model, fluidOf(true), [&](const GridShape&, const auto& column) {
            result = column(CounterModeNoise(ofWaves, NoiseStream::ParticleFirstDraw));
        });
        return result;
    }

    Parts(const Scene& scene, const ConfiningPlanes& planes, double tolerance,
          const shared_ptr<GridFluid>& fluid) {
        const ConfinedRotnePragerYamakawaGrid model(scene.particles, eta, tolerance, 0, planes,
                                                    fluid);
        const int rows = scene.particles.numRows;
        model.at(scene.placement)->multiply(MatrixXd::Identity(rows, rows), M);
        ConfinedRandomField field(model);
        field.draw(NoiseStream(), NoiseStream::ParticleFirstDraw, scene.placement.box);
        field.multiplyPairs(scene.placement, MatrixXd::Identity(rows, rows), pairs);
        findRest(scene, model, fluid);
    }
    /** The covariance of the field without the pairs, by all of its random numbers. */
    void findRest(const Scene& scene, const ConfinedRotnePragerYamakawaGrid& model,
                  const shared_ptr<GridFluid>& fluid) {
        withColumns(scene, model, fluid, [&](const GridShape& shape, const auto& column) {
            rest = covarianceOfFields(shape.size, scene.particles.numRows, -shape.size[1] / 2,
                                      CounterModeNoise::isMirrored, column);
            for (int nx = -shape.size[0] / 2; nx <= shape.size[0] / 2; nx++)
                for (int ny = -shape.size[1] / 2; ny <= shape.size[1] / 2; ny++) {
                    if (CounterModeNoise::isMirrored(nx, ny, 0)) continue;
                    for (int j = 0; j < GridWallFields::numSets; j++)
                        for (int c = 0; c < 3; c++)
                            for (complex<double> value :
                                 {complex<double>(1, 0), complex<double>(0, 1)}) {
                                const VectorXd v =
                                    column(UnitNoise::ofPlane(nx, ny, j, c, sqrt(0.5) * value));
                                rest += v * v.transpose();
                            }
                }
        });
    }
    /** Call task(shape, column), where column(noise) is the field of these numbers. */
    template <class Task>
    static void withColumns(const Scene& scene, const ConfinedRotnePragerYamakawaGrid& model,
                            const shared_ptr<GridFluid>& fluid, const Task& task) {
        const HydrodynamicParticles& particles = scene.particles;
        ConfinedRotnePragerYamakawaGrid::Lifted lifted;
        model.lift(scene.placement, false, lifted);
        const BoxVectors& box = scene.placement.box;
        const auto base = model.baseFor(box, lifted.top, lifted.nearest);
        const auto inBox = base.model->inBox({box[0], box[1], Vec3(0, 0, base.period)});
        const GridShape& shape = inBox->splitting.shape;
        for (Vec3& x : lifted.positions) x[2] -= low + 0.5 * base.height;
        WaveField waves(particles, base.model->getKinds());
        waves.setBox(*inBox);
        waves.moveTo(lifted.positions, false);
        UniformField uniform(
            particles, eta, shape.walls->getFields().getConditions(), shape,
            [&](double k) { return hasimoto(k, inBox->splitting.xi); },
            [](double radius, double k) { return overSurfaces().waveFactors(radius, k); });
        uniform.moveTo(lifted.positions);
        vector<GridField> fields;
        task(shape, [&](const ModeNoise& noise) {
            waves.draw(*fluid, eta, noise, fields);
            VectorXd v = VectorXd::Zero(particles.numRows);
            waves.addAverages(*fluid, fields, v.data());
            uniform.draw(noise);
            uniform.addTo(v.data());
            return v;
        });
    }
};

/**
 * Draws as many fields as there are random numbers.
 *
 * @param away  distance of walls from particles that would touch them otherwise
 */
void checkCovariance(const vector<Fluid>& fluids, double tolerance, bool simd, double away = 0) {
    for (Fluid fluid : fluids) {
        const double height = 3.2 + 2 * away;
        Scene scene = mixture(4, height - 2 * away, 3 + fluid, {1, 0.7}, 2.5);
        for (Vec3& x : scene.placement.positions) x[2] += away;
        const Parts parts(scene, planesOf(fluid, height), tolerance, fluidOf(simd));
        const MatrixXd M = scaled(parts.M, scene.particles),
                       pairs = scaled(parts.pairs, scene.particles),
                       rest = scaled(parts.rest, scene.particles);
        EXPECT_LE(normOf(pairs + rest - M), tolerance * normOf(M)) << fluid << " " << simd;
        // Both parts are positive, and neither is small.
        EXPECT_GE(eigenvalues(rest).minCoeff(), -1e-12) << fluid << " " << simd;
        EXPECT_GE(eigenvalues(pairs).minCoeff(), 0.02) << fluid << " " << simd;
        EXPECT_GE(normOf(rest), 0.2) << fluid << " " << simd;
        EXPECT_GE(normOf(pairs), 0.2) << fluid << " " << simd;
    }
}

void checkBothParts(const vector<double>& tolerances) {
    // That waves are a covariance is by algebra, and tested above. Here they are what products have
    // besides the pairs.
    for (Fluid fluid : {Channel, ClosedChannel, Wall})
        for (double tolerance : tolerances)
            for (const bool flat : {false, true}) {
                const double height = flat ? 2.05 : 4;
                const Scene scene =
                    flat ? mixture(9, height, 7, {1, 0.98}) : mixture(24, height, 8, {1, 0.7, 0.5});
                const ConfinedRotnePragerYamakawaGrid model(scene.particles, eta, tolerance, 0,
                                                            planesOf(fluid, height), fluidOf(true));
                const int rows = scene.particles.numRows;
                MatrixXd M, pairs;
                model.at(scene.placement)->multiply(MatrixXd::Identity(rows, rows), M);
                ConfinedRandomField field(model);
                field.draw(NoiseStream(), NoiseStream::ParticleFirstDraw, scene.placement.box);
                field.multiplyPairs(scene.placement, MatrixXd::Identity(rows, rows), pairs);
                M = scaled(M, scene.particles);
                pairs = scaled(pairs, scene.particles);
                EXPECT_LE((pairs - pairs.transpose()).norm(), 1e-12 * pairs.norm());
                EXPECT_GE(eigenvalues(pairs).minCoeff(), -0.3 * tolerance)
                    << fluid << " " << tolerance << " " << flat;
                EXPECT_GE(eigenvalues(M - pairs).minCoeff(), -tolerance * normOf(M))
                    << fluid << " " << tolerance << " " << flat;
                MatrixXd slips;
                field.draw(NoiseStream(), NoiseStream::ParticleFirstDraw, scene.placement.box);
                field.slipsAt(scene.placement, false, slips);
                EXPECT_LE(field.getNumIterations(), tolerance < 1e-3 ? 18 : 8)
                    << fluid << " " << tolerance << " " << flat;
            }
}

}  // namespace

TEST(ConfinedNoise, TheCovarianceIsTheMobility) {
    checkCovariance({Channel, ClosedChannel, Wall}, 1e-2, true);
}
TEST(ConfinedNoise, TheCovarianceIsTheMobilityAwayFromWalls) {
    checkCovariance({Channel, Wall}, 1e-2, true, 0.7);
}
/** Both fluids agree everywhere (below). */
TEST(ConfinedNoise, FullTheCovarianceIsTheMobilityOnFinerGridsAndInBothFluids) {
    checkCovariance({Channel}, 1e-3, true);
    checkCovariance({Wall}, 1e-2, false);
}
TEST(ConfinedNoise, BothPartsArePositiveInHardScenes) { checkBothParts({1e-2}); }
TEST(ConfinedNoise, FullBothPartsArePositiveInHardScenes) { checkBothParts({1e-4}); }

namespace {

/** Layers of spheres on square lattices, with a period of three radii. */
Scene layers(int wide, const vector<double>& heights) {
    Scene scene;
    scene.placement.box = {Vec3(3 * wide, 0, 0), Vec3(0, 3 * wide, 0), Vec3(0, 0, 3)};
    for (double z : heights)
        for (int x = 0; x < wide; x++)
            for (int y = 0; y < wide; y++) {
                scene.particles.add(1, false, scene.particles.size(), scene.particles.size());
                scene.placement.positions.push_back(Vec3(3 * x + 0.1, 3 * y + 0.2, low + z));
            }
    return scene;
}

}  // namespace

TEST(ConfinedNoise, RootsOfSpheresInASlitTakeFewIterations) {
    // Of whole products it takes 7, 12 and 18.
    const Scene scene = layers(10, {1, 3.2, 5});
    const map<double, int> most = {{1e-2, 4}, {1e-3, 6}, {1e-4, 9}};
    for (const auto& [tolerance, iterations] : most) {
        const ConfinedRotnePragerYamakawaGrid model(scene.particles, eta, tolerance, 0,
                                                    planesOf(Channel, 6), fluidOf(true));
        ConfinedRandomField field(model);
        MatrixXd slips;
        field.draw(NoiseStream(), NoiseStream::ParticleFirstDraw, scene.placement.box);
        field.slipsAt(scene.placement, false, slips);
        EXPECT_LE(field.getNumIterations(), iterations) << tolerance;
        EXPECT_GT(field.getNumIterations(), 1) << tolerance;
    }
}

TEST(ConfinedNoise, TheMemoryOfWallsAndPairsIsKnownBeforeItIsAllocated) {
    if (bytesInUse() == 0) GTEST_SKIP() << "no counter of allocated bytes";
    const double height = 3;  // all spheres touch a wall
    Scene scene = layers(10, {1, 2});
    for (bool torques : {false, true}) {
        HydrodynamicParticles particles;
        for (int i = 0; i < scene.particles.size(); i++) particles.add(1, torques, i, i);
        const ConfiningPlanes planes = planesOf(Channel, height);
        const ConfinedRotnePragerYamakawaGrid model(particles, eta, 1e-3, 0, planes, fluidOf(true));
        const BoxVectors& box = scene.placement.box;
        double period;
        EwaldSplitting splitting =
            ConfinedRotnePragerYamakawaGrid::splittingFor(particles, 1e-3, 0, box, height, period);
        const double start = bytesInUse();
        splitting.shape.walls =
            make_shared<GridWalls>(planes, splitting.shape, height, model.getLongestWave(),
                                   [&](double k) { return hasimoto(k, splitting.xi); });
        const GridWallFields& fields = splitting.shape.walls->getFields();
        const double ofWalls = bytesInUse() - start, before = GridWalls::memory(splitting.shape);
        EXPECT_GT(before, 0.9 * ofWalls);
        EXPECT_LT(before, 1.5 * ofWalls);
        const auto kinds = kindsOf(particles);
        NearPlanes near(particles, kinds, splitting, 1e-3, height, model.getLongestWave(), fields);
        vector<Vec3> positions = scene.placement.positions;
        for (Vec3& x : positions) x[2] -= low + 0.5 * height;
        near.moveTo(positions, false, splitting.shape.spacing(2),
                    [](int count, const function<void(int, int)>& task) { task(0, count); });
        const double ofPlanes = bytesInUse() - start - ofWalls,
                     beforePlanes = NearPlanes::memory(particles, kinds, splitting, 1e-3, height,
                                                       model.getLongestWave());
        EXPECT_GT(beforePlanes, 0.8 * ofPlanes);
        EXPECT_LT(beforePlanes, 1.5 * ofPlanes);
    }
}

TEST(ConfinedNoise, LongWavesOfWideBoxesAreNoWorse) {
    // What is cut off of the flow of pairs on the planes is magnified by waves that are long.
    const double tolerance = 1e-2;
    double narrow = 0;
    for (int wide : {12, 64}) {
        const Scene scene = layers(wide, {1, 3.2});
        VectorXd forces = VectorXd::Zero(scene.particles.numRows);
        for (int i = 0; i < scene.particles.size(); i++)
            forces[3 * i + 2] = cos(2 * M_PI * (i / wide % wide) / wide);
        const ConfinedRotnePragerYamakawaGrid model(scene.particles, eta, tolerance, 0,
                                                    planesOf(Channel, 6), fluidOf(true));
        ConfinedRandomField field(model);
        MatrixXd velocities;
        field.draw(NoiseStream(), NoiseStream::ParticleFirstDraw, scene.placement.box);
        field.multiplyPairs(scene.placement, forces, velocities);
        const double part = 6 * M_PI * eta * forces.dot(velocities.col(0)) / forces.squaredNorm();
        if (narrow == 0)
            narrow = part;
        else
            EXPECT_NEAR(part, narrow, 0.3 * tolerance);
        EXPECT_GT(part, 0.05);
    }
}

TEST(ConfinedNoise, SlipsAreThoseOfWavesAndARootOfPairs) {
    const double height = 3.4, tolerance = 1e-3;
    for (Fluid fluid : {Channel, Wall})
        for (bool crossing : {false, true}) {
            Scene scene = mixture(6, height, 5, {1, 0.7}, 4);
            const HydrodynamicParticles& particles = scene.particles;
            if (crossing) scene.placement.positions[0][2] -= 0.4;
            const ConfinedRotnePragerYamakawaGrid model(
                particles, eta, tolerance, 0, planesOf(fluid, height, crossing), fluidOf(true));
            NoiseStream noise;
            noise.seed = 3;
            ConfinedRandomField field(model);
            MatrixXd slips, again, pairs;
            field.draw(noise, NoiseStream::ParticleFirstDraw, scene.placement.box);
            field.slipsAt(scene.placement, false, slips);

            const VectorXd rest = Parts::restOf(scene, model, noise);
            const int rows = particles.numRows;
            field.multiplyPairs(scene.placement, MatrixXd::Identity(rows, rows), pairs);
            VectorXd scale(rows), weights = VectorXd::Ones(rows), W(rows);
            for (int i = 0; i < particles.size(); i++) {
                const double a = particles.radii[i];
                scale.segment<3>(particles.firstRow[i]).setConstant(sqrt(a));
                if (particles.hasTorque[i])
                    scale.segment<3>(particles.firstRow[i] + 3)
                        .setConstant(sqrt(4.0 / 3 * a * a * a));
                for (int k = 0; k < (particles.hasTorque[i] ? 6 : 3); k++) {
                    double pair[2];
                    noise.pair(NoiseStream::ParticleFirstDraw, i, k / 2, pair[0], pair[1]);
                    W[particles.firstRow[i] + k] = pair[k % 2];
                }
            }
            if (crossing) weights.head(particles.hasTorque[0] ? 6 : 3).setConstant(0.6);
            const MatrixXd matrix =
                scale.asDiagonal() * pairs * scale.asDiagonal() +
                0.3 * tolerance / (6 * M_PI * eta) * MatrixXd::Identity(rows, rows);
            const VectorXd root =
                               scale.cwiseInverse().asDiagonal() *
                               (Eigen::SelfAdjointEigenSolver<MatrixXd>(matrix).operatorSqrt() * W),
                           expected = weights.asDiagonal() * (root + rest);
            EXPECT_LE((slips.col(0) - expected).norm(), 0.5 * tolerance * expected.norm())
                << fluid << " " << crossing;
            EXPECT_GT(root.norm(), 0.2 * expected.norm());
            EXPECT_GT(rest.norm(), 0.2 * expected.norm());

            // The field is the same after it was evaluated at other places.
            Placement other = scene.placement;
            for (Vec3& r : other.positions) r += Vec3(1, 0.5, 0);
            field.slipsAt(other, false, again);
            EXPECT_NE(again, slips);
            field.slipsAt(scene.placement, false, again);
            EXPECT_EQ(again, slips);
        }
}

TEST(ConfinedNoise, ThreadsChangeNoBitAndBothFluidsAgree) {
    const double height = 4;
    const Scene scene = mixture(20, height, 5);
    for (Fluid fluid : {Channel, Wall}) {
        MatrixXd slips[3];
        int i = 0;
        for (const auto& grid : {fluidOf(true), fluidOf(true, 2), fluidOf(false)}) {
            const ConfinedRotnePragerYamakawaGrid model(scene.particles, eta, 1e-3, 0,
                                                        planesOf(fluid, height), grid);
            unique_ptr<RandomField> field;
            model.randomField()->draw(NoiseStream(), NoiseStream::ParticleFirstDraw,
                                      scene.placement.box, field);
            field->slipsAt(scene.placement, false, slips[i++]);
        }
        EXPECT_EQ(slips[0], slips[1]);
        EXPECT_LE((slips[0] - slips[2]).norm(), 1e-11 * slips[2].norm());
    }
}

TEST(ConfinedNoise, SlipsNearbyAreSmooth) {
    // Central differences of slips converge as the square of the step, down to small steps.
    const double height = 4;
    const Scene scene = mixture(8, height, 5, {1, 0.7}, 4);
    const ConfinedRotnePragerYamakawaGrid model(scene.particles, eta, 1e-4, 0,
                                                planesOf(Channel, height, true), fluidOf(true));
    ConfinedRandomField field(model);
    MatrixXd slips[2];
    field.draw(NoiseStream(), NoiseStream::ParticleFirstDraw, scene.placement.box);
    field.slipsAt(scene.placement, false, slips[0]);
    const auto slope = [&](double step) {
        for (int side = 0; side < 2; side++) {
            Placement near = scene.placement;
            for (size_t p = 0; p < near.positions.size(); p++)
                near.positions[p] += Vec3(1, p % 2 ? -1 : 0.5, 0.3) * (side == 0 ? step : -step);
            field.slipsAt(near, true, slips[side]);
        }
        return VectorXd((slips[0] - slips[1]).col(0) / (2 * step));
    };
    const VectorXd fine = slope(1e-5), coarse = slope(1e-3);
    EXPECT_LE((fine - coarse).norm(), 0.02 * fine.norm());
    EXPECT_GT(fine.norm(), 0.01 * slips[0].norm());
}

TEST(ConfinedNoise, AHigherParticleDrawsAHigherField) {
    Scene scene = mixture(3, 3, 5, {1}, 5);
    scene.particles.add(1, false, 9, 9);
    scene.placement.positions.push_back(Vec3(1, 1, low + 4));
    const ConfinedRotnePragerYamakawaGrid model(scene.particles, eta, 1e-2, 0, planesOf(Wall, 1),
                                                fluidOf(true));
    unique_ptr<RandomField> field, fresh;
    MatrixXd slips, expected;
    model.randomField()->draw(NoiseStream(), 7, scene.placement.box, field);
    EXPECT_EQ(field->getNumRandomNumbers(), 0);
    field->slipsAt(scene.placement, false, slips);
    const long long low = field->getNumRandomNumbers();
    scene.placement.positions.back()[2] += 9;
    field->slipsAt(scene.placement, false, slips);
    EXPECT_GT(field->getNumRandomNumbers(), low);
    model.randomField()->draw(NoiseStream(), 7, scene.placement.box, fresh);
    fresh->slipsAt(scene.placement, false, expected);
    EXPECT_EQ(slips, expected);
}

TEST(ConfinedNoise, AParticleNearerToAWallDrawsAFinerField) {
    Scene scene = mixture(5, 3, 5, {1}, 5);
    for (Vec3& x : scene.placement.positions) x[2] += 1;
    const ConfinedRotnePragerYamakawaGrid model(scene.particles, eta, 1e-2, 0, planesOf(Channel, 5),
                                                fluidOf(true));
    unique_ptr<RandomField> field, fresh;
    MatrixXd slips, expected;
    model.randomField()->draw(NoiseStream(), 7, scene.placement.box, field);
    field->slipsAt(scene.placement, false, slips);
    const long long coarse = field->getNumRandomNumbers();
    scene.placement.positions.back()[2] = low + 1;
    field->slipsAt(scene.placement, false, slips);
    EXPECT_GT(field->getNumRandomNumbers(), coarse);
    model.randomField()->draw(NoiseStream(), 7, scene.placement.box, fresh);
    fresh->slipsAt(scene.placement, false, expected);
    EXPECT_EQ(slips, expected);
}

TEST(ConfinedNoise, FlowsAreThoseOfTheForcesThatCauseTheSlips) {
    const double height = 4, tolerance = 1e-4;
    const Scene scene = mixture(4, height, 5, {1, 0.7}, 4);
    const BoxVectors& box = scene.placement.box;
    for (Fluid fluid : {Channel, ClosedChannel}) {
        const ConfiningPlanes planes = planesOf(fluid, height);
        const ConfinedRotnePragerYamakawaGrid model(scene.particles, eta, tolerance, 0, planes,
                                                    fluidOf(true));
        const ConfinedRotnePragerYamakawa exact(scene.particles, eta, planes);
        unique_ptr<RandomField> field;
        MatrixXd slips, M;
        model.randomField()->draw(NoiseStream(), 7, box, field);
        field->slipsAt(scene.placement, false, slips);
        const auto at = exact.at(scene.placement);
        at->dense(M);
        const MatrixXd forces = M.llt().solve(slips);
        const int number = 10;
        vector<Vec3> points;
        for (int i = 0; i < number * number * number; i++)
            points.push_back(Vec3((i % number + 0.5) * box[0][0] / number,
                                  (i / number % number + 0.5) * box[1][1] / number,
                                  low + (i / number / number + 0.5) * height / number));
        Velocities flow = Velocities::Zero(3, points.size()), wanted = flow;
        field->addFlowAt(points, 2, flow);
        at->addFlowAt({forces, {}}, points, 2, wanted);
        EXPECT_LE((flow - wanted).norm(), 20 * tolerance * wanted.norm());

        DrivenFlow wave;
        wave.waveVelocity = 1;
        wave.forceAxis = 0;
        wave.waveAxis = 1;
        wave.k = 2 * M_PI / box[1][1];
        wave.phase = 0.4;
        wave.hasPlanes = true;
        wave.low = low;
        wave.high = wave.top = low + height;
        double sum = 0;
        for (size_t i = 0; i < points.size(); i++)
            sum += flow(0, i) * sin(wave.k * points[i][1] + wave.phase);
        const double scale = flow.norm() / sqrt(points.size());
        EXPECT_NEAR(2 * field->amplitudeOf(wave), 2 * sum / points.size(), 0.05 * scale);
        EXPECT_GT(abs(sum) / points.size(), 0.01 * scale);
        const Eigen::Vector3d mean = 2 * field->meanFlow(low, low + height);
        for (int axis = 0; axis < 2; axis++)
            EXPECT_NEAR(mean[axis], flow.row(axis).mean(), 0.05 * scale);
        if (fluid == ClosedChannel) {
            EXPECT_EQ(mean.norm(), 0);
        }
    }
}
