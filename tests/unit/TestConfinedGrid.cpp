// Force coupling between planes on a grid: reference values, tolerance, symmetries, noise, and
// invariances.

#include <Eigen/Dense>
#include <cmath>
#include <random>
#include <set>

#include "GridFluidSupport.h"
#include "Instrumented.h"
#include "ReferenceScenes.h"
#include "TestSupport.h"
#include "UnitNoise.h"
#include "linearalgebra/Decompositions.h"
#include "mobility/models/confined/ConfinedForceCoupling.h"
#include "mobility/models/confined/ConfinedRotnePragerYamakawa.h"
#include "mobility/models/confined/PlaneConditions.h"
#include "mobility/models/forcecoupling/CpuGridFluid.h"
#include "mobility/models/forcecoupling/Envelopes.h"
#include "mobility/models/forcecoupling/GridChecks.h"
#include "mobility/models/forcecoupling/GridPlanes.h"
#include "openmmrigidhi/ModelTraits.h"

using namespace Eigen;
using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace std;
using OpenMM::Vec3;

namespace {

// ---- Fluids

struct Geometry {
    MobilityForce::Boundary boundary;
    string reference;
    bool zeroFlux;
};
const Geometry geometries[] = {{MobilityForce::NoSlipChannel, "slit", false},
                               {MobilityForce::NoSlipChannel, "", true},
                               {MobilityForce::PeriodicWall, "wall", false},
                               {MobilityForce::Film, "film", false}};
const Geometry &channel = geometries[0], &fluxless = geometries[1], &wall = geometries[2],
               &film = geometries[3];

ostream& operator<<(ostream& out, const Geometry& geometry) {
    return out << traitsOf(geometry.boundary).name << (geometry.zeroFlux ? " without flux" : "");
}

/** The lower wall is not at z = 0. */
const double low = -0.7, width = 5, depth = 6.2, height = 4.8;
const BoxVectors box = {Vec3(width, 0, 0), Vec3(0, depth, 0), Vec3(0, 0, 9)};

ConfiningPlanes planesOf(const Geometry& geometry, double high = height, bool crossing = true) {
    MobilityForce force;
    force.setBoundary(geometry.boundary);
    force.setWallHeight(low);
    force.setChannelWalls(low, low + high);
    force.setChannelCondition(geometry.zeroFlux ? MobilityForce::ZeroFlux
                                                : MobilityForce::ZeroPressureGradient);
    return ConfiningPlanes(force, crossing);
}
unique_ptr<ConfinedForceCoupling> modelOf(const Geometry& geometry,
                                          const HydrodynamicParticles& particles, double tolerance,
                                          double high = height,
                                          const shared_ptr<GridFluid>& fluid = nullptr,
                                          double eta = 1, bool crossing = true) {
    return make_unique<ConfinedForceCoupling>(particles, eta, planesOf(geometry, high, crossing),
                                              tolerance, 0,
                                              fluid ? fluid : make_shared<CpuGridFluid>());
}
/** Heights above the lower wall. */
Placement at(vector<Vec3> positions, const BoxVectors& inBox = box) {
    for (Vec3& x : positions) x[2] += low;
    return {positions, inBox};
}
MatrixXd matrixAt(const MobilityModel& model, const Placement& placement) {
    MatrixXd M;
    model.at(placement)->dense(M);
    return M;
}

// ---- Particles

HydrodynamicParticles threeSpheres() {
    HydrodynamicParticles particles;
    const double radii[] = {1, 0.8, 0.9};
    for (int i = 0; i < 3; i++) particles.add(radii[i], true, i, i);
    return particles;
}
const vector<Vec3> threePlaces = {Vec3(0.3, 0.4, 1.0), Vec3(2.1, 1.1, 1.9), Vec3(1.2, 4.2, 3.6)};

/** Spheres of three radii, some without torque. */
HydrodynamicParticles mixture(int number) {
    HydrodynamicParticles particles;
    const double radii[] = {0.6, 1, 0.8};
    for (int i = 0; i < number; i++) particles.add(radii[i % 3], i % 4 != 0, i, i);
    return particles;
}
/** At random, every other one in contact with a plane. They overlap each other. */
vector<Vec3> placesOf(const HydrodynamicParticles& particles, double high, int seed) {
    mt19937 random(seed);
    uniform_real_distribution<double> uniform(0, 1);
    vector<Vec3> places;
    for (int i = 0; i < particles.size(); i++) {
        const double a = particles.radii[i], z = uniform(random);
        places.push_back(Vec3(width * uniform(random), depth * uniform(random),
                              i % 4 == 0   ? a
                              : i % 4 == 2 ? high - a
                                           : a + (high - 2 * a) * z));
    }
    return places;
}

/** Entries over the roots of the particles' own mobilities. */
MatrixXd scaled(const MatrixXd& M, const HydrodynamicParticles& particles) {
    VectorXd root(particles.numRows);
    for (int p = 0; p < particles.size(); p++) {
        const double a = particles.radii[p];
        root.segment<3>(particles.firstRow[p]).setConstant(sqrt(6 * M_PI * a));
        if (particles.hasTorque[p])
            root.segment<3>(particles.firstRow[p] + 3).setConstant(sqrt(8 * M_PI * a * a * a));
    }
    return root.asDiagonal() * M * root.asDiagonal();
}
double normOf(const MatrixXd& M) {
    return SelfAdjointEigenSolver<MatrixXd>(M, EigenvaluesOnly).eigenvalues().cwiseAbs().maxCoeff();
}
double leastEigenvalue(const MatrixXd& M) {
    return SelfAdjointEigenSolver<MatrixXd>(M, EigenvaluesOnly).eigenvalues()[0];
}
double asymmetry(const MatrixXd& M) { return (M - M.transpose()).norm() / M.norm(); }

/** The reflection z -> -z of forces and velocities; torques and angular velocities are axial. */
VectorXd reflectionOf(const HydrodynamicParticles& particles) {
    VectorXd sign = VectorXd::Ones(particles.numRows);
    for (int p = 0; p < particles.size(); p++) {
        const int row = particles.firstRow[p];
        sign[row + 2] = -1;
        if (particles.hasTorque[p]) sign[row + 3] = sign[row + 4] = -1;
    }
    return sign;
}

// ---- Grids of given size

struct SmallGrid {
    PlaneConditions conditions;
    GridResolution resolution;
    GridShape shape;
    GridStencils stencils;

    SmallGrid(const PlaneConditions& conditions, const HydrodynamicParticles& particles,
              double tolerance, array<int, 3> size, const vector<Vec3>& positions)
        : conditions(conditions), resolution(particles, tolerance, 0),
          stencils(particles, resolution) {
        shape = resolution.shapeBetweenPlanes(
            {Vec3(width, 0, 0), Vec3(0, depth, 0), Vec3(0, 0, conditions.getPeriod())});
        for (int axis = 0; axis < 3; axis++)
            if (size[axis] > 0) shape.size[axis] = size[axis];
        shape.planes = make_shared<GridPlanes>(conditions, shape);
        vector<Vec3> shifted = positions;
        for (Vec3& x : shifted) x[2] -= conditions.getOrigin();
        stencils.moveTo(shape, shifted, false);
    }
    MatrixXd matrix(GridFluid& fluid) {
        const int rows = stencils.getParticles().numRows;
        MatrixXd M;
        fluid.multiply(stencils, 1, MatrixXd::Identity(rows, rows), M);
        return M;
    }
};

}  // namespace

TEST(ConfinedGrid, HasTheReferenceValues) {
    // The values have ten digits.
    const JsonValue data = readTestData("confined/confined_fcm_three_spheres");
    const HydrodynamicParticles particles = threeSpheres();
    for (const Geometry& geometry : {channel, wall, film}) {
        const vector<double> numbers = data[geometry.reference].numbers();
        const MatrixXd expected = Map<const MatrixXd>(numbers.data(), 18, 18);
        for (double tolerance : {1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8}) {
            const MatrixXd M = matrixAt(*modelOf(geometry, particles, tolerance), at(threePlaces));
            const double error = normOf(scaled(M - expected, particles)),
                         norm = normOf(scaled(expected, particles));
            EXPECT_LE(error, tolerance * norm) << geometry << ", " << tolerance;
            EXPECT_LE(asymmetry(M), 1e-14) << geometry;
        }
    }
}

namespace {

/** @param reference  tolerance of the matrix that all others are compared with */
template <class Geometries>
void checkProductsNearPlanes(const Geometries& some, const vector<double>& tolerances,
                             double reference) {
    for (const Geometry& geometry : some)
        for (bool torques : {false, true})
            for (double high : {2.05, 4.8}) {
                HydrodynamicParticles particles = mixture(12);
                if (!torques) {
                    HydrodynamicParticles blobs;
                    for (int i = 0; i < 12; i++) blobs.add(particles.radii[i], false, i, -1);
                    particles = blobs;
                }
                const Placement places = at(placesOf(particles, high, 3));
                const MatrixXd exact =
                    matrixAt(*modelOf(geometry, particles, reference, high), places);
                for (double tolerance : tolerances) {
                    const MatrixXd M =
                        matrixAt(*modelOf(geometry, particles, tolerance, high), places);
                    EXPECT_LE(normOf(scaled(M - exact, particles)),
                              (tolerance - reference) * normOf(scaled(exact, particles)))
                        << geometry << ", " << tolerance << (torques ? " with torques" : "");
                }
            }
}

}  // namespace

TEST(ConfinedGrid, ProductsHaveTheToleranceNearPlanes) {
    checkProductsNearPlanes(geometries, {1e-2, 1e-4}, 1e-6);
    checkProductsNearPlanes(vector<Geometry>{channel}, {1e-8}, 1e-11);
}
TEST(ConfinedGrid, FullProductsHaveEveryToleranceNearPlanes) {
    checkProductsNearPlanes(geometries, {1e-2, 1e-3, 1e-4, 1e-6, 1e-8}, 1e-11);
}

namespace {

/**
 * One or two particles at contact have a smaller mobility than many, so the same error is a larger
 * part of it. The height needs just an integer number of nodes of the largest spacing.
 */
template <class Geometries>
void checkFewNearPlanes(const Geometries& some, const vector<double>& tolerances) {
    for (const Geometry& geometry : some)
        for (bool torques : {false, true})
            for (int number : {1, 2})
                for (double tolerance : tolerances) {
                    HydrodynamicParticles particles;
                    for (int i = 0; i < number; i++) particles.add(1 - 0.1 * i, torques, i, i);
                    const double spacing =
                        GridResolution(particles, tolerance, 0).getSpacingAcross();
                    for (int nodes : {10, 12, 14, 16}) {
                        const double high = nodes * spacing * (1 - 1e-9) - 2;
                        if (high < 2) continue;
                        vector<Vec3> places = {
                            Vec3(0.1, 0.2,
                                 geometry.boundary == MobilityForce::Film && nodes > 12 ? high - 1
                                                                                        : 1),
                            Vec3(2.7, 3.2, high - 0.9)};
                        places.resize(number);
                        const double reference = 1e-2 * tolerance;
                        const auto matrix = [&](double with) {
                            return scaled(
                                matrixAt(*modelOf(geometry, particles, with, high), at(places)),
                                particles);
                        };
                        const MatrixXd exact = matrix(reference);
                        EXPECT_LE(normOf(matrix(tolerance) - exact),
                                  (tolerance - reference) * normOf(exact))
                            << geometry << ", " << number << ", " << tolerance << ", " << high
                            << (torques ? " with torques" : "");
                    }
                }
}

}  // namespace

TEST(ConfinedGrid, FewParticlesHaveTheToleranceNearPlanes) {
    checkFewNearPlanes(vector<Geometry>{channel, film}, {1e-2, 1e-3, 1e-4});
}
TEST(ConfinedGrid, FullFewParticlesHaveEveryToleranceNearPlanes) {
    checkFewNearPlanes(geometries, {1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7});
}

TEST(ConfinedGrid, BothFluidsAndAnyNumberOfThreadsAgree) {
    const HydrodynamicParticles particles = mixture(7);
    for (const Geometry& geometry : geometries) {
        const Placement places = at(placesOf(particles, height, 5));
        const auto plain = make_shared<PlainGridFluid>();
        const auto one = make_shared<CpuGridFluid>(), two = make_shared<CpuGridFluid>(onThreads(2));
        MatrixXd M[3], single[3], slips[3];
        int i = 0;
        for (const shared_ptr<GridFluid>& fluid :
             {shared_ptr<GridFluid>(plain), shared_ptr<GridFluid>(one),
              shared_ptr<GridFluid>(two)}) {
            const auto model = modelOf(geometry, particles, 1e-3, height, fluid, 0.7);
            const auto there = model->at(places);
            const MatrixXd identity = MatrixXd::Identity(particles.numRows, particles.numRows);
            there->multiply(identity, M[i]);
            Accuracy coarse;
            coarse.error = Accuracy::errorOfSinglePrecision;
            there->multiply(identity, single[i], coarse);
            unique_ptr<RandomField> field;
            model->randomField()->draw(NoiseStream(), 7, places.box, field);
            field->slipsAt(places, false, slips[i]);
            i++;
        }
        EXPECT_LE((M[1] - M[0]).norm(), 1e-13 * M[0].norm()) << geometry;
        EXPECT_LE((slips[1] - slips[0]).norm(), 1e-12 * slips[0].norm()) << geometry;
        EXPECT_LE(normOf(scaled(single[1] - M[0], particles)),
                  Accuracy::errorOfSinglePrecision * normOf(scaled(M[0], particles)))
            << geometry;
        EXPECT_TRUE(single[1] != M[1]) << geometry;
        EXPECT_TRUE(M[1] == M[2] && single[1] == single[2] && slips[1] == slips[2]) << geometry;
    }
}

TEST(ConfinedGrid, ProductsInSinglePrecisionAreForFluidsThatAreNotTooFlat) {
    HydrodynamicParticles particles;
    for (double a : {1., 0.9}) particles.add(a, true, particles.size(), 0);
    Accuracy coarse;
    coarse.error = Accuracy::errorOfSinglePrecision;
    const MatrixXd identity = MatrixXd::Identity(12, 12);
    for (const Geometry& geometry : geometries) {
        const double nearest = geometry.boundary == MobilityForce::PeriodicWall ? 1.5 : 2.1;
        const auto model = modelOf(geometry, particles, 0.1, 2.1);
        for (double ratio : {49., 51.}) {
            const auto there = model->at(at({Vec3(1, 1, 1), Vec3(4, 2, 1.1)},
                                            {Vec3(ratio * nearest, 0, 0), Vec3(0, 20, 0), Vec3()}));
            MatrixXd M, single;
            there->multiply(identity, M);
            there->multiply(identity, single, coarse);
            EXPECT_EQ(M == single, ratio > 50) << geometry;
            EXPECT_LE(normOf(scaled(single - M, particles)),
                      Accuracy::errorOfSinglePrecision * normOf(scaled(M, particles)))
                << geometry;
        }
    }
}

namespace {

/** A box along planes, 80 times as long as a fluid with this height is high. */
const double flatHeight = 2.05, flatEdge = 80 * flatHeight;
BoxVectors flatBox(double depth) {
    return {Vec3(flatEdge, 0, 0), Vec3(0, depth, 0), Vec3(0, 0, 9)};
}
/** Two spheres far apart, with torques; the first one touches the lower wall. */
MatrixXd flatMatrix(const Geometry& geometry, double tolerance, double spacing,
                    const BoxVectors& box, double x, double y) {
    HydrodynamicParticles particles;
    for (double a : {1., 0.9}) particles.add(a, true, particles.size(), 0);
    const ConfinedForceCoupling model(particles, 1, planesOf(geometry, flatHeight), tolerance,
                                      spacing, make_shared<CpuGridFluid>());
    return scaled(matrixAt(model, at({Vec3(x, y, 1), Vec3(x + 40, y + 1, 1.1)}, box)), particles);
}

}  // namespace

namespace {

/** @param reference  tolerance of the matrix that all others are compared with */
template <class Geometries>
void checkFlatBoxes(const Geometries& some, const vector<double>& tolerances, double reference) {
    for (const Geometry& geometry : some) {
        const MatrixXd exact = flatMatrix(geometry, reference, 0, flatBox(8), 0.1, 0.2);
        for (double tolerance : tolerances)
            for (double x : {0., 0.23, 17.4})
                EXPECT_LE(
                    normOf(flatMatrix(geometry, tolerance, 0, flatBox(8), x, 2.6 * x) - exact),
                    (tolerance - reference) * normOf(exact))
                    << geometry << ", " << tolerance << ", " << x;
    }
}

}  // namespace

TEST(ConfinedGrid, FlatBoxesKeepTheTolerance) {
    checkFlatBoxes(vector<Geometry>{channel}, {1e-3}, 1e-5);
}
TEST(ConfinedGrid, FullFlatBoxesKeepEveryTolerance) {
    checkFlatBoxes(geometries, {1e-2, 1e-3, 1e-6}, 1e-8);
}

TEST(ConfinedGrid, FlatBoxesLoseNoDigits) {
    // Spheres move by nodes, so differences are rounding errors. Along x they move by slabs,
    // because a slab determines which nodes at the rim of an envelope belong to a particle.
    const double spacing = flatEdge / 256;
    const BoxVectors box = flatBox(16 * spacing);
    for (const Geometry& geometry : geometries) {
        const MatrixXd M = flatMatrix(geometry, 0.1, spacing, box, 0.2, 0.3),
                       moved = flatMatrix(geometry, 0.1, spacing, box,
                                          0.2 + 5 * GridStencils::slabWidth * spacing,
                                          0.3 + 3 * spacing);
        EXPECT_LE(normOf(moved - M), 1e-13 * normOf(M)) << geometry;
    }
}

namespace {

/** Clear of walls and of each other, blobs of both models differ only in the meaning of radii. */
template <class Geometries>
void checkFlatBlobs(const Geometries& some, double tolerance) {
    const double a = 0.25;
    const Placement places =
        at({Vec3(0.1, 0.2, 1), Vec3(2.1, 1, 1.05), Vec3(50, 2, 1)}, flatBox(3));
    for (const Geometry& geometry : some) {
        HydrodynamicParticles gaussians, surfaces;
        for (size_t i = 0; i < places.positions.size(); i++) {
            gaussians.add(a, false, i, 0);
            surfaces.add(a * sqrt(3 / M_PI), false, i, 0);
        }
        const ConfiningPlanes planes = planesOf(geometry, flatHeight);
        const MatrixXd M = matrixAt(
            ConfinedForceCoupling(gaussians, 1, planes, tolerance, 0, make_shared<CpuGridFluid>()),
            places);
        MatrixXd expected = matrixAt(ConfinedRotnePragerYamakawa(surfaces, 1, planes), places);
        for (int i = 0; i < M.rows(); i += 3)  // own mobilities differ
            expected.block<3, 3>(i, i) = M.block<3, 3>(i, i);
        EXPECT_LE(normOf(scaled(M - expected, gaussians)),
                  tolerance * normOf(scaled(expected, gaussians)))
            << geometry;
    }
}

}  // namespace

TEST(ConfinedGrid, BlobsInFlatBoxesMoveAsThoseOfRotnePragerYamakawa) {
    checkFlatBlobs(vector<Geometry>{channel}, 1e-4);
}
TEST(ConfinedGrid, FullBlobsInFlatBoxesMoveAsThoseOfRotnePragerYamakawa) {
    checkFlatBlobs(vector<Geometry>{channel, fluxless, wall}, 1e-9);
}

TEST(ConfinedGrid, MatricesArePositiveWhereverParticlesAre) {
    // Touching, overlapping, reaching through a plane, and in a fluid hardly higher than a
    // particle.
    for (const Geometry& geometry : geometries)
        for (double high : {2.05, 4.8}) {
            HydrodynamicParticles particles;
            for (double a : {1., 1., 0.8, 1., 0.5}) particles.add(a, true, particles.size(), 0);
            const vector<Vec3> places = {Vec3(1, 1, 1), Vec3(3, 1, high - 1), Vec3(1.3, 1.2, 1.1),
                                         Vec3(4.9, 6, 0.04), Vec3(2, 4, high - 0.02)};
            const MatrixXd M =
                scaled(matrixAt(*modelOf(geometry, particles, 1e-3, high), at(places)), particles);
            EXPECT_GT(leastEigenvalue(M), 1e-6) << geometry << ", " << high;
            EXPECT_LE(asymmetry(M), 1e-14) << geometry;
        }
}

TEST(ConfinedGrid, RandomFieldsHaveTheCovarianceOfProducts) {
    // The columns of B, of covariance B B^T, are the velocities in fields of one random number
    // each.
    const HydrodynamicParticles particles = threeSpheres();
    const vector<PlaneConditions> cases = {
        PlaneConditions::channel(height, 2, false), PlaneConditions::channel(height, 2, true),
        PlaneConditions::wall(height + 1, 2, 1.5), PlaneConditions::film(height, 2)};
    for (const PlaneConditions& conditions : cases)
        for (array<int, 3> size : {array<int, 3>{6, 5, 8}, array<int, 3>{5, 6, 7}}) {
            SmallGrid grid(conditions, particles, 0.1, size, threePlaces);
            PlainGridFluid plain;
            CpuGridFluid fast;
            const MatrixXd M = grid.matrix(plain);
            for (GridFluid* fluid : {(GridFluid*)&plain, (GridFluid*)&fast}) {
                GridField field;
                VectorXd column;
                const auto columnOf = [&](const UnitNoise& noise) {
                    fluid->draw(grid.stencils, 1, noise, field);
                    fluid->average(field, grid.stencils, column);
                    return column;
                };
                MatrixXd covariance = covarianceOfFields(size, M.rows(), -size[1] / 2,
                                                         CounterModeNoise::isMirrored, columnOf);
                EXPECT_GE((covariance - M).norm(), 1e-2 * M.norm());
                for (int nx = -size[0] / 2; nx <= size[0] / 2; nx++)
                    for (int ny = -size[1] / 2; ny <= size[1] / 2; ny++)
                        for (int j = 0; j < conditions.numOfMean(); j++)
                            for (int c = 0; c < 3; c++)
                                for (complex<double> value :
                                     {complex<double>(1, 0), complex<double>(0, 1)}) {
                                    if (CounterModeNoise::isMirrored(nx, ny, 0)) continue;
                                    const VectorXd v = columnOf(
                                        UnitNoise::ofPlane(nx, ny, j, c, sqrt(0.5) * value));
                                    covariance += v * v.transpose();
                                }
                EXPECT_LE((covariance - M).norm(), 1e-13 * M.norm())
                    << &conditions - &cases[0] << ", " << size[0] << "x" << size[1] << "x"
                    << size[2];
            }
        }
}

namespace {

/** Notes the modes and the unknowns of planes whose numbers are asked for, one of n and -n each. */
class NotedNoise : public CounterModeNoise {
public:
    using CounterModeNoise::CounterModeNoise;
    void fill(const int* nx, int count, int ny, int nz, complex<double>* numbers) const override {
        CounterModeNoise::fill(nx, count, ny, nz, numbers);
        for (int i = 0; i < count; i++)
            if (nz > 0)
                modes.insert({nx[i], ny, nz});
            else
                note(modes, nx[i], ny, nz);
    }
    void fillPlane(const int* nx, int count, int ny, int j,
                   complex<double>* numbers) const override {
        CounterModeNoise::fillPlane(nx, count, ny, j, numbers);
        for (int i = 0; i < count; i++)
            if (nx[i] != 0 || ny != 0)
                note(ofPlanes, nx[i], ny, j);
            else
                ofMean.insert({0, 0, j});
    }
    mutable set<array<int, 3>> modes, ofPlanes, ofMean;

private:
    static void note(set<array<int, 3>>& all, int nx, int ny, int last) {
        if (all.count({-nx, -ny, last}) == 0) all.insert({nx, ny, last});
    }
};

}  // namespace

TEST(ConfinedGrid, FieldsCountTheirRandomNumbers) {
    const HydrodynamicParticles particles = threeSpheres();
    for (const PlaneConditions& conditions :
         {PlaneConditions::channel(height, 2, false), PlaneConditions::channel(height, 2, true),
          PlaneConditions::wall(height + 1, 2, 1.5)})
        for (array<int, 3> size : {array<int, 3>{6, 5, 8}, array<int, 3>{5, 6, 7}}) {
            SmallGrid grid(conditions, particles, 0.1, size, threePlaces);
            const NotedNoise noise(NoiseStream(), 7);
            PlainGridFluid fluid;
            GridField field;
            fluid.draw(grid.stencils, 1, noise, field);
            // Modes with kz > 0 are one of two. A mean flow has real numbers along two axes.
            EXPECT_EQ(6 * (noise.modes.size() + noise.ofPlanes.size()) + 2 * noise.ofMean.size(),
                      GridModeNoise::numbersOf(grid.shape));
        }
}

TEST(ConfinedGrid, NumbersOfPlanesAreSymmetricAndTheirOwn) {
    NoiseStream stream;
    stream.seed = 3;
    const CounterModeNoise plain(stream, 7);
    const SimdModeNoise packs(stream, 7);
    vector<int> nx;
    for (int n = -9; n <= 9; n++) nx.push_back(n);
    const int count = nx.size();
    vector<complex<double>> seen;
    for (int ny : {0, 2, -2})
        for (int j = 0; j < 3; j++) {
            vector<complex<double>> a(3 * count), b(3 * count), opposite(3 * count);
            plain.fillPlane(nx.data(), count, ny, j, a.data());
            packs.fillPlane(nx.data(), count, ny, j, b.data());
            plain.fillPlane(nx.data(), count, -ny, j, opposite.data());
            for (int c = 0; c < 3; c++)
                for (int i = 0; i < count; i++) {
                    EXPECT_LE(abs(a[c * count + i] - b[c * count + i]), 1e-14);
                    if (ny != 0 || nx[i] != 0) {
                        EXPECT_EQ(a[c * count + i], conj(opposite[c * count + count - 1 - i]));
                    }
                    if (ny >= 0 && (ny > 0 || nx[i] >= 0)) seen.push_back(a[c * count + i]);
                }
        }
    // No two are the same, and none is one of a mode.
    for (int nz : {0, 1, 2, 5}) {
        vector<complex<double>> modes(3 * count);
        plain.fill(nx.data(), count, 2, nz, modes.data());
        seen.insert(seen.end(), modes.begin(), modes.end());
    }
    sort(seen.begin(), seen.end(),
         [](const complex<double>& a, const complex<double>& b) { return a.real() < b.real(); });
    for (size_t i = 1; i < seen.size(); i++) EXPECT_LT(seen[i - 1].real(), seen[i].real());
}

TEST(ConfinedGrid, TheThirdVectorOfTheBoxIsNoPeriod) {
    const HydrodynamicParticles particles = mixture(5);
    for (const Geometry& geometry : geometries) {
        const auto model = modelOf(geometry, particles, 1e-3);
        const vector<Vec3> places = placesOf(particles, height, 2);
        BoxVectors longer = box;
        longer[2][2] = 3;
        const Placement here = at(places), there = at(places, longer);
        EXPECT_TRUE(matrixAt(*model, here) == matrixAt(*model, there)) << geometry;
        unique_ptr<RandomField> field;
        MatrixXd slips[2];
        int i = 0;
        for (const Placement& placement : {here, there}) {
            model->randomField()->draw(NoiseStream(), 7, placement.box, field);
            field->slipsAt(placement, false, slips[i++]);
        }
        EXPECT_TRUE(slips[0] == slips[1]) << geometry;
    }
}

TEST(ConfinedGrid, AFluidAboveAWallDependsNeitherOnItsGridNorOnItsPeriod) {
    const HydrodynamicParticles particles = threeSpheres();
    CpuGridFluid fluid;
    const double tolerance = 1e-7;
    MatrixXd first;
    for (double above : {4.2, 5.5, 9.})
        for (double gap : {2., 3.3}) {
            SmallGrid grid(PlaneConditions::wall(height + above, gap, 1.5), particles, tolerance,
                           {0, 0, 0}, threePlaces);
            const MatrixXd M = grid.matrix(fluid);
            if (first.size() == 0) first = M;
            // Of an envelope at contact, 5e-6 is behind the lower plane, in the gap.
            EXPECT_LE(normOf(scaled(M - first, particles)), gap == 2 ? tolerance : 5e-7)
                << above << ", " << gap;
        }
    // Another particle far above makes the model's grid higher.
    HydrodynamicParticles four = particles;
    four.add(1, true, 3, 3);
    vector<Vec3> places = threePlaces;
    MatrixXd lower;
    for (double z : {2., 9.}) {
        places.resize(3);
        places.push_back(Vec3(4, 3, z));
        const MatrixXd M =
            matrixAt(*modelOf(wall, four, tolerance), at(places)).topLeftCorner(18, 18);
        if (lower.size() == 0) lower = M;
        EXPECT_LE(normOf(scaled(M - lower, particles)), 2 * tolerance) << z;
    }
}

TEST(ConfinedGrid, AChannelIsItsOwnReflection) {
    const HydrodynamicParticles particles = mixture(6);
    const vector<Vec3> places = placesOf(particles, height, 8);
    vector<Vec3> reflected = places;
    for (Vec3& x : reflected) x[2] = height - x[2];
    const VectorXd sign = reflectionOf(particles);
    for (const Geometry& geometry : {channel, fluxless}) {
        const auto model = modelOf(geometry, particles, 1e-8);
        const MatrixXd M = matrixAt(*model, at(places)), of = matrixAt(*model, at(reflected)),
                       back = sign.asDiagonal() * of * sign.asDiagonal();
        EXPECT_LE(normOf(scaled(back - M, particles)), 1e-8 * normOf(scaled(M, particles)));
        EXPECT_GT((of - M).norm(), 1e-2 * M.norm());
    }
}

TEST(ConfinedGrid, AFilmIsAChannelOfTwiceTheHeightWithImages) {
    // Where envelopes do not reach the surface.
    HydrodynamicParticles particles, both;
    for (double a : {0.5, 0.4}) particles.add(a, true, particles.size(), 0);
    for (int copy = 0; copy < 2; copy++)
        for (double a : particles.radii) both.add(a, true, both.size(), 0);
    const double high = 7;
    const vector<Vec3> places = {Vec3(1, 1, 3.2), Vec3(2.2, 3, 4.1)};
    vector<Vec3> withImages = places;
    for (const Vec3& x : places) withImages.push_back(Vec3(x[0], x[1], 2 * high - x[2]));
    MatrixXd fold(24, 12);
    fold << MatrixXd::Identity(12, 12), MatrixXd(reflectionOf(particles).asDiagonal());
    for (double tolerance : {1e-3, 1e-6, 1e-8}) {
        const MatrixXd M = matrixAt(*modelOf(film, particles, tolerance, high), at(places)),
                       twice =
                           matrixAt(*modelOf(channel, both, tolerance, 2 * high), at(withImages)),
                       folded = 0.5 * fold.transpose() * twice * fold;
        EXPECT_LE(normOf(scaled(folded - M, particles)), 2 * tolerance) << tolerance;
    }
}

TEST(ConfinedGrid, WithoutFluxAChannelLacksAParabola) {
    // Where envelopes do not reach the walls, averages of the parabola p = z (H - z) are p -
    // sigma^2, and half of its curl is p'/2.
    HydrodynamicParticles particles;
    for (double a : {0.5, 0.4}) particles.add(a, true, particles.size(), 0);
    const double high = 7, eta = 0.7;
    const vector<Vec3> places = {Vec3(1, 1, 3.2), Vec3(2.2, 4, 4.1)};
    MatrixXd parabola = MatrixXd::Zero(12, 2);
    for (int i = 0; i < 2; i++) {
        const double z = places[i][2], sigma = forceEnvelopeWidth(particles.radii[i]),
                     slope = high - 2 * z;
        for (int c = 0; c < 2; c++) {
            parabola(6 * i + c, c) = z * (high - z) - sigma * sigma;
            parabola(6 * i + 3 + (1 - c), c) = (c == 0 ? 0.5 : -0.5) * slope;
        }
    }
    const MatrixXd lacking =
        3 / (eta * pow(high, 3) * width * depth) * parabola * parabola.transpose();
    for (double tolerance : {1e-3, 1e-8}) {
        const MatrixXd M = matrixAt(*modelOf(channel, particles, tolerance, high, nullptr, eta),
                                    at(places)),
                       without =
                           matrixAt(*modelOf(fluxless, particles, tolerance, high, nullptr, eta),
                                    at(places));
        EXPECT_LE(normOf(scaled(M - without - lacking, particles)), 2 * tolerance) << tolerance;
    }
}

TEST(ConfinedGrid, TheFlowOfForcesIsAtRestOnWallsAndHasItsFlux) {
    // The flux through the box is that of a parabola where a force acts, and 0 without flux.
    const HydrodynamicParticles particles = mixture(3);
    const vector<Vec3> places = {Vec3(0.3, 0.4, 1.0), Vec3(2.1, 1.1, 2.4), Vec3(1.2, 4.2, 3.6)};
    FlowSources sources;
    sources.forces = MatrixXd::Zero(particles.numRows, 1);
    sources.forces(particles.firstRow[1]) = 1;  // its envelope reaches no wall
    // Gauss' points and weights on (-1, 1).
    const double nodes[] = {0.1834346424956498, 0.5255324099163290, 0.7966664774136267,
                            0.9602898564975363},
                 weights[] = {0.3626837833783620, 0.3137066458778873, 0.2223810344533745,
                              0.1012285362903763};
    const int panels = 3, along = 18;
    for (const Geometry& geometry : geometries) {
        const auto model = modelOf(geometry, particles, 1e-6);
        const auto there = model->at(at(places));
        vector<Vec3> points;
        for (int i = 0; i < 5; i++) points.push_back(Vec3(i, 1.3 * i, low));
        Velocities u = Velocities::Zero(3, points.size());
        there->addFlowAt(sources, points, 1, u);
        EXPECT_LE(u.cwiseAbs().maxCoeff(), 2e-6) << geometry;
        if (geometry.boundary != MobilityForce::NoSlipChannel) continue;
        double flux = 0;
        for (int panel = 0; panel < panels; panel++)
            for (int k = 0; k < 8; k++) {
                const double half = height / (2 * panels),
                             z = low + half * (2 * panel + 1 + (k < 4 ? 1 : -1) * nodes[k % 4]);
                points.clear();
                for (int i = 0; i < along; i++)
                    for (int j = 0; j < along; j++)
                        points.push_back(Vec3(i * width / along, j * depth / along, z));
                u = Velocities::Zero(3, points.size());
                there->addFlowAt(sources, points, 1, u);
                flux += half * weights[k % 4] * u.row(0).mean();
            }
        const double z = places[1][2], sigma = forceEnvelopeWidth(particles.radii[1]),
                     expected = (z * (height - z) - sigma * sigma) / (2 * width * depth);
        EXPECT_NEAR(flux, geometry.zeroFlux ? 0 : expected, 1e-5 * expected) << geometry;
    }
}

TEST(ConfinedGrid, GradientsAreThoseOfTheField) {
    const HydrodynamicParticles particles = threeSpheres();
    for (const Geometry& geometry : geometries) {
        const auto model = modelOf(geometry, particles, 1e-4);
        const Placement places = at(threePlaces);
        unique_ptr<RandomField> field;
        model->randomField()->draw(NoiseStream(), 7, places.box, field);
        EXPECT_TRUE(model->randomField()->isLocal());
        ASSERT_TRUE(field->hasGradients());
        MatrixXd slips, gradients, ahead, behind;
        field->slipsAt(places, false, slips);
        field->gradientsAt(places, false, gradients);
        const double delta = 1e-5;
        for (int b = 0; b < 3; b++) {
            Placement moved = places;
            for (Vec3& x : moved.positions) x[b] += delta;
            field->slipsAt(moved, true, ahead);
            for (Vec3& x : moved.positions) x[b] -= 2 * delta;
            field->slipsAt(moved, true, behind);
            for (int i = 0; i < particles.size(); i++) {
                for (int a = 0; a < 3; a++) {
                    const int row = particles.firstRow[i] + a;
                    EXPECT_NEAR(gradients(3 * a + b, i),
                                (ahead(row, 0) - behind(row, 0)) / (2 * delta),
                                1e-7 * slips.norm());
                }
                // The field has no sources.
                EXPECT_NEAR(gradients(0, i) + gradients(4, i) + gradients(8, i), 0,
                            1e-3 * gradients.col(i).norm());
            }
        }
    }
}

TEST(ConfinedGrid, AFieldGrowsWithTheHeightOfParticles) {
    // A placement far above that of the draw has the field that is drawn there.
    HydrodynamicParticles one;
    one.add(1, true, 0, 0);
    const auto model = modelOf(wall, one, 1e-3);
    const Placement near = at({Vec3(1, 1, 1.1)}), above = at({Vec3(1, 1, 1.2)}),
                    far = at({Vec3(1, 1, 30)});
    unique_ptr<RandomField> field, atFar;
    MatrixXd slips, moved, expected, again;
    model->randomField()->draw(NoiseStream(), 7, near.box, field);
    field->slipsAt(near, false, slips);
    const long long few = field->getNumRandomNumbers();
    EXPECT_GT(few, 0);
    field->slipsAt(above, false, moved);
    EXPECT_LE((moved - slips).norm(), 0.3 * slips.norm());
    EXPECT_EQ(field->getNumRandomNumbers(), few);
    field->slipsAt(far, false, moved);
    EXPECT_GT(field->getNumRandomNumbers(), few);
    model->randomField()->draw(NoiseStream(), 7, far.box, atFar);
    atFar->slipsAt(far, false, expected);
    EXPECT_TRUE(moved == expected);
    // The flow of the field ends where its grid ends.
    Velocities u = Velocities::Zero(3, 1);
    atFar->addFlowAt({Vec3(1, 1, 31)}, 1, u);
    EXPECT_GT(u.norm(), 0);
    expectError([&] { atFar->addFlowAt({Vec3(1, 1, 60)}, 1, u); },
                {"has no random flow above z = ", "point 0 is at z = 60 nm"});
}

TEST(ConfinedGrid, TraitsSayThatThereAreWalls) {
    const HydrodynamicParticles particles = threeSpheres();
    const auto model = modelOf(channel, particles, 1e-3);
    const MobilityTraits& traits = model->getTraits();
    EXPECT_STREQ(traits.name, "ForceCoupling");
    EXPECT_TRUE(traits.mayObject && traits.holdsNearby && traits.isAnchored);
    EXPECT_FALSE(traits.isHomogeneous || traits.isIsotropic || traits.isDivergenceFree);
    EXPECT_TRUE(traits.isMatrixFree && traits.hasProducts && traits.hasSinglePrecision);
    ASSERT_TRUE(model->grid() && model->randomField() && model->box());
    EXPECT_FALSE(ConfinedForceCoupling(particles, 1, planesOf(channel), 1e-3, 0,
                                       make_shared<PlainGridFluid>(), false)
                     .getTraits()
                     .isMatrixFree);
}

TEST(ConfinedGrid, RefusesWhatItCannotHave) {
    const HydrodynamicParticles particles = threeSpheres();
    const auto between = modelOf(channel, particles, 1e-3, height, nullptr, 1, false),
               above = modelOf(wall, particles, 1e-3, height, nullptr, 1, false);
    BoxVectors oblique = box, none = {};
    oblique[1][0] = 0.5;
    expectError([&] { between->at(at(threePlaces, oblique)); },
                {"needs a box with edges along the axes", "(0.5, 6.2, 0)"});
    expectError([&] { between->at(at(threePlaces, none)); }, {"needs a periodic box"});
    vector<Vec3> far = threePlaces;
    far[1][2] = 1e9;
    expectError([&] { above->at(at(far)); },
                {"reaches from the wall to the highest particle, but particle 1"});
    vector<Vec3> below = threePlaces;
    below[0][2] = 0.9;
    expectError([&] { between->at(at(below)); }, {"particle 0", "nearer to a plane"});
    expectError([&] { between->box()->checkWave(box, 0, 9); },
                {"a wave of index 9 along the edge 0", "too short for a grid of 14 nodes"});
    EXPECT_THROW(modelOf(channel, particles, 1e-3, 1.9), OpenMM::OpenMMException);
}

TEST(ConfinedGrid, TheMemoryOfPlanesIsKnownBeforeItIsAllocated) {
    if (bytesInUse() == 0) GTEST_SKIP() << "no counter of allocated bytes";
    GridShape shape;
    shape.size = {80, 72, 12};
    shape.edge = {20, 18, 6};
    for (bool above : {false, true}) {
        const double start = bytesInUse();
        const GridPlanes planes(
            above ? PlaneConditions::wall(3, 2, 1) : PlaneConditions::channel(4, 2, false), shape);
        planes.prepareFields();
        const double allocated = bytesInUse() - start,
                     known = GridPlanes::memory(planes.getConditions().numPlanes(), shape);
        EXPECT_NEAR(known / allocated, 1, 0.1);
    }
    shape.size = {100000, 100000, 12};
    expectError([&] { checkMemoryOfGrid("ForceCoupling", shape, 1e18, 0, " and for planes"); },
                {"needs 1e+09 GB of memory for 100000 x 100000 x 12 nodes and for planes, but "});
}

TEST(ConfinedGrid, MatricesOfTooManyRowsAreRefused) {
    HydrodynamicParticles many;
    for (int i = 0; i < 2001; i++) many.add(1, true, i, i);
    const auto make = [&](bool byProducts) {
        ConfinedForceCoupling(many, 1, planesOf(channel), 1e-3, 0, make_shared<PlainGridFluid>(),
                              byProducts);
    };
    make(true);
    expectError([&] { make(false); },
                {"dense matrices of at most 12000 rows, but these particles need 12006",
                 "use fewer particles, or the grid, by setSolver(MatrixFree)"});
}
