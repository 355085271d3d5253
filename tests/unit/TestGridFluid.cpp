// Force coupling on a grid. Products agree with the sum over Fourier modes that defines them, and
// the random field has the covariance of the products. Further tests are of stencils.

#include <Eigen/Dense>
#include <cmath>
#include <random>

#include "GridFluidSupport.h"
#include "TestSupport.h"
#include "UnitNoise.h"
#include "linearalgebra/Decompositions.h"
#include "mobility/models/forcecoupling/CpuGridFluid.h"
#include "mobility/models/forcecoupling/Envelopes.h"
#include "mobility/models/forcecoupling/ForceCouplingGrid.h"

using namespace Eigen;
using namespace OpenMM;
using namespace RigidHIPlugin;
using namespace std;
using RigidHITest::covarianceOfFields;
using RigidHITest::onThreads;
using RigidHITest::UnitNoise;

namespace {

const double eta = 0.7;

HydrodynamicParticles mixture() {
    HydrodynamicParticles particles;
    const double radii[] = {0.3, 0.42, 0.3, 0.9};
    const bool torque[] = {false, true, true, false};
    for (int i = 0; i < 4; i++) particles.add(radii[i], torque[i], i, i);
    return particles;
}
HydrodynamicParticles blobs(int number, double radius) {
    HydrodynamicParticles particles;
    for (int i = 0; i < number; i++) particles.add(radius, false, i, -1);
    return particles;
}
/** Places across faces of the box, of overlapping particles, and far outside of the box. */
vector<Vec3> places(const BoxVectors& box) {
    return {Vec3(0.05, 2.4, 1.1), Vec3(0.4, 2.2, 1.4), Vec3(box[0][0] - 0.01, -3.1, 0.2),
            Vec3(0.9, 0.02, 17.3)};
}
BoxVectors orthogonal(double x, double y, double z) {
    return {{Vec3(x, 0, 0), Vec3(0, y, 0), Vec3(0, 0, z)}};
}

/** The sum of the definition, up to the waves at which the envelopes end: (1/(eta V)) sum_k D_i^+
 * (1 - k k) k^-2 D_j exp(i k (r_i - r_j)). */
MatrixXd latticeSum(const HydrodynamicParticles& particles, const BoxVectors& box,
                    const vector<Vec3>& at) {
    double narrowest = 1e9;
    for (double a : particles.radii) narrowest = min(narrowest, torqueEnvelopeWidth(a));
    const double largest = sqrt(2 * 37.0) / narrowest;
    int n[3];
    // |n_c| = |k.a_c|/2 pi for the vector a_c of the box, and the reciprocal vectors are those to
    // it.
    Matrix3d vectors;
    for (int c = 0; c < 3; c++) {
        vectors.row(c) << box[c][0], box[c][1], box[c][2];
        n[c] = ceil(largest * vectors.row(c).norm() / (2 * M_PI));
    }
    const Matrix3d reciprocal = 2 * M_PI * vectors.inverse();
    MatrixXd M = MatrixXd::Zero(particles.numRows, particles.numRows);
    const double volume = box[0][0] * box[1][1] * box[2][2];
    // k and -k give the same real part.
    for (int x = 0; x <= n[0]; x++)
        for (int y = -n[1]; y <= n[1]; y++)
            for (int z = -n[2]; z <= n[2]; z++) {
                const Vector3d k = reciprocal * Vector3d(x, y, z);
                const double k2 = k.squaredNorm();
                if (k2 == 0 || k2 > largest * largest) continue;
                Matrix3d cross;
                cross << 0, -k[2], k[1], k[2], 0, -k[0], -k[1], k[0], 0;
                MatrixXcd D(3, particles.numRows);
                for (int p = 0; p < particles.size(); p++) {
                    const double sF = forceEnvelopeWidth(particles.radii[p]),
                                 sT = torqueEnvelopeWidth(particles.radii[p]);
                    const complex<double> phase = exp(
                        complex<double>(0, -(k[0] * at[p][0] + k[1] * at[p][1] + k[2] * at[p][2])));
                    D.middleCols<3>(particles.firstRow[p]) =
                        phase * exp(-sF * sF * k2 / 2) *
                        Matrix3d::Identity().cast<complex<double>>();
                    if (particles.hasTorque[p])
                        D.middleCols<3>(particles.firstRow[p] + 3) =
                            phase * exp(-sT * sT * k2 / 2) * complex<double>(0, 0.5) *
                            cross.cast<complex<double>>();
                }
                const Matrix3d P = Matrix3d::Identity() - k * k.transpose() / k2;
                M += (x == 0 ? 1 : 2) * (D.adjoint() * P.cast<complex<double>>() * D).real() /
                     (eta * volume * k2);
            }
    return M;
}

MatrixXd dense(GridFluid& fluid, const GridStencils& stencils) {
    const int rows = stencils.getParticles().numRows;
    MatrixXd M;
    fluid.multiply(stencils, eta, MatrixXd::Identity(rows, rows), M);
    return M;
}

/** Entries over the roots of the particles' own mobilities. */
MatrixXd scaled(const MatrixXd& difference, const HydrodynamicParticles& particles) {
    VectorXd root(particles.numRows);
    for (int p = 0; p < particles.size(); p++) {
        const double a = particles.radii[p];
        root.segment<3>(particles.firstRow[p]).setConstant(sqrt(6 * M_PI * eta * a));
        if (particles.hasTorque[p])
            root.segment<3>(particles.firstRow[p] + 3)
                .setConstant(sqrt(8 * M_PI * eta * a * a * a));
    }
    return root.asDiagonal() * difference * root.asDiagonal();
}
double normOf(const MatrixXd& symmetric) {
    return SelfAdjointEigenSolver<MatrixXd>(symmetric, EigenvaluesOnly)
        .eigenvalues()
        .cwiseAbs()
        .maxCoeff();
}

}  // namespace

TEST(GridShape, SizesAreEvenAndSmooth) {
    EXPECT_EQ(nextGridSize(1), 2);
    for (double many : {1.5e6, 3e9, 1e300, double(INFINITY), double(NAN)})
        EXPECT_EQ(nextGridSize(many), tooManyNodes);
    EXPECT_EQ(nextGridSize(22), 24);
    EXPECT_EQ(nextGridSize(24), 24);
    EXPECT_EQ(nextGridSize(24.0000001), 28);
    EXPECT_EQ(nextGridSize(121), 126);
    EXPECT_EQ(nextGridSize(130), 140);
}

TEST(GridFluid, ProductsHaveTheTolerance) {
    const BoxVectors box = orthogonal(3.1, 2.6, 4.4);
    for (bool torques : {false, true}) {
        const HydrodynamicParticles particles = torques ? mixture() : blobs(4, 0.3);
        const MatrixXd exact = latticeSum(particles, box, places(box));
        for (double tolerance : {1e-2, 1e-4, 1e-6, 1e-8, 1e-10}) {
            const GridResolution resolution(particles, tolerance, 0);
            GridStencils stencils(particles, resolution);
            stencils.moveTo(resolution.shapeFor(box), places(box), false);
            PlainGridFluid fluid;
            const MatrixXd M = dense(fluid, stencils);
            const double error = normOf(scaled(M - exact, particles));
            EXPECT_LE(error, tolerance) << tolerance << (torques ? " with torques" : "");
            EXPECT_LE((M - M.transpose()).norm(), 1e-15 * M.norm() * particles.numRows);
        }
    }
}

TEST(GridFluid, RandomFieldsHaveTheCovarianceOfProducts) {
    const BoxVectors box = orthogonal(3.1, 2.6, 4.4);
    const HydrodynamicParticles particles = mixture();
    const GridResolution resolution(particles, 0.1, 0.5);
    for (array<int, 3> size :
         {array<int, 3>{7, 6, 8}, array<int, 3>{6, 5, 7}, array<int, 3>{4, 11, 3}}) {
        GridShape shape = resolution.shapeFor(box);
        shape.size = size;
        GridStencils stencils(particles, resolution);
        stencils.moveTo(shape, places(box), false);
        PlainGridFluid fluid;
        const MatrixXd M = dense(fluid, stencils);
        GridField field;
        VectorXd column;
        const MatrixXd covariance =
            covarianceOfFields(size, M.rows(), -size[1] / 2, CounterModeNoise::isMirrored,
                               [&](const UnitNoise& noise) {
                                   fluid.draw(stencils, eta, noise, field);
                                   fluid.average(field, stencils, column);
                                   return column;
                               });
        EXPECT_LE((covariance - M).norm(), 1e-12 * M.norm())
            << size[0] << "x" << size[1] << "x" << size[2];
    }
}

// ---- Between slip walls

/** Places between walls at y = 0 and at half of the edge: on a wall, overlapping a wall and each
 * other, and so far from a wall that the stencil begins a little beyond this wall. */
vector<Vec3> inChannel(const BoxVectors& twice) {
    const double width = 0.5 * twice[1][1];
    return {Vec3(0.05, 0.7 * width, 1.1), Vec3(0.4, 0.05, 1.4),
            Vec3(twice[0][0] - 0.01, width, 0.2), Vec3(0.9, min(0.55 * width, 2.5), 17.3)};
}

/** Grids with an even and an odd number of rows between the walls, of wide and narrow channels,
 * also with stencils longer than the box. */
struct MirroredGrid {
    BoxVectors twice;
    array<int, 3> size;
};
const MirroredGrid mirroredGrids[] = {
    {orthogonal(3.1, 5.2, 4.4), {14, 24, 20}}, {orthogonal(3.1, 5.2, 4.4), {9, 22, 7}},
    {orthogonal(3.1, 8.4, 2.9), {12, 54, 16}}, {orthogonal(1.9, 1.3, 1.85), {6, 6, 8}},
    {orthogonal(1.9, 1.3, 1.85), {8, 2, 5}},   {orthogonal(3.1, 24, 4.4), {14, 120, 20}}};

GridShape mirroredShape(const GridResolution& resolution, const MirroredGrid& grid) {
    GridShape shape = resolution.shapeFor(grid.twice);
    shape.size = grid.size;
    shape.mirrored = true;
    return shape;
}

TEST(GridFluid, MirroredProductsAreThoseOfImages) {
    // The expected products are those on the same nodes without the symmetry. Particles and their
    // reflected images are in a periodic box, and the images have the reflected forces.
    const HydrodynamicParticles particles = mixture();
    HydrodynamicParticles both = particles;
    for (int p = 0; p < particles.size(); p++)
        both.add(particles.radii[p], particles.hasTorque[p], p, -1);
    const int rows = particles.numRows;
    VectorXd sign = VectorXd::Ones(rows);
    for (int p = 0; p < particles.size(); p++) {
        sign[particles.firstRow[p] + 1] = -1;
        if (particles.hasTorque[p])
            sign[particles.firstRow[p] + 3] = sign[particles.firstRow[p] + 5] = -1;
    }
    for (const MirroredGrid& grid : mirroredGrids) {
        const GridResolution resolution(particles, 1e-4, 0);
        const GridShape shape = mirroredShape(resolution, grid);
        GridShape whole = shape;
        whole.mirrored = false;
        // Coordinates count from the first node, where a periodic grid has its origin.
        const vector<Vec3> at = inChannel(grid.twice);
        vector<Vec3> withImages;
        for (int side : {1, -1})
            for (const Vec3& x : at)
                withImages.push_back(Vec3(x[0], side * x[1] - shape.firstNode(1), x[2]));
        GridStencils ofBoth(both, resolution), own(particles, resolution);
        ofBoth.moveTo(whole, withImages, false);
        own.moveTo(shape, at, false);
        PlainGridFluid plain;
        CpuGridFluid fast;
        MatrixXd fold(2 * rows, rows);
        fold << MatrixXd::Identity(rows, rows), MatrixXd(sign.asDiagonal());
        const MatrixXd M = 0.5 * fold.transpose() * dense(plain, ofBoth) * fold;
        EXPECT_LE((dense(plain, own) - M).norm(), 1e-13 * M.norm()) << grid.size[1];
        EXPECT_LE((dense(fast, own) - M).norm(), 1e-13 * M.norm()) << grid.size[1];
    }
}

TEST(GridFluid, MirroredFieldsHaveTheCovarianceOfProducts) {
    // As for periodic fields the covariance is a sum over the modes that are drawn. For these modes
    // ny is not negative, and nx is not negative where nz is 0. Of modes along y only the real
    // parts count.
    const HydrodynamicParticles particles = mixture();
    for (const MirroredGrid& grid : mirroredGrids) {
        if (grid.size[1] > 30) continue;  // takes minutes
        const GridResolution resolution(particles, 0.1, 0.5);
        const GridShape shape = mirroredShape(resolution, grid);
        GridStencils stencils(particles, resolution);
        stencils.moveTo(shape, inChannel(grid.twice), false);
        CpuGridFluid fluid;
        const MatrixXd M = dense(fluid, stencils);
        GridField field;
        VectorXd column;
        const MatrixXd covariance = covarianceOfFields(
            {shape.size[0], 2 * (shape.numRows() - 1), shape.size[2]}, M.rows(), 0,
            [](int nx, int, int nz) { return nz == 0 && nx < 0; },
            [&](const UnitNoise& noise) {
                fluid.draw(stencils, eta, noise, field);
                fluid.average(field, stencils, column);
                return column;
            });
        EXPECT_LE((covariance - M).norm(), 1e-12 * M.norm()) << shape.size[1];
    }
}

TEST(GridFluid, FinerGridsKeepTheNoise) {
    const BoxVectors box = orthogonal(3.1, 2.6, 4.4);
    const HydrodynamicParticles particles = blobs(4, 0.3);
    NoiseStream noise;
    VectorXd velocities[2];
    for (int i = 0; i < 2; i++) {
        const GridResolution resolution(particles, i == 0 ? 1e-6 : 1e-8, 0);
        GridStencils stencils(particles, resolution);
        stencils.moveTo(resolution.shapeFor(box), places(box), false);
        PlainGridFluid fluid;
        GridField field;
        fluid.draw(stencils, eta, noise, NoiseStream::RandomField, field);
        fluid.average(field, stencils, velocities[i]);
    }
    // The coarser grid lacks the modes that only the finer grid has. These modes make 1e-6 of the
    // variance, so 1e-3 of the amplitude.
    EXPECT_LE((velocities[0] - velocities[1]).norm(), 3e-3 * velocities[1].norm());
    EXPECT_GT(velocities[1].norm(), 0);
}

TEST(GridFluid, GradientsAreThoseOfAveragesWithAnchoredStencils) {
    const BoxVectors box = orthogonal(3.1, 2.6, 4.4);
    const HydrodynamicParticles particles = mixture();
    const GridResolution resolution(particles, 1e-4, 0);
    GridStencils stencils(particles, resolution);
    stencils.moveTo(resolution.shapeFor(box), places(box), false);
    PlainGridFluid fluid;
    GridField field;
    fluid.draw(stencils, eta, NoiseStream(), NoiseStream::RandomField, field);
    MatrixXd gradients;
    VectorXd plus, minus;
    fluid.averageGradients(field, stencils, gradients);
    const double delta = 1e-4;
    for (int b = 0; b < 3; b++) {
        for (int sign : {1, -1}) {
            vector<Vec3> moved = places(box);
            for (Vec3& x : moved) x[b] += sign * delta;
            stencils.moveTo(stencils.getShape(), moved, true);
            fluid.average(field, stencils, sign > 0 ? plus : minus);
        }
        for (int p = 0; p < particles.size(); p++)
            for (int a = 0; a < 3; a++) {
                const int row = particles.firstRow[p] + a;
                // Central differences have an error of delta^2/6 times a third derivative, which is
                // about 1/width^3.
                EXPECT_NEAR((plus[row] - minus[row]) / (2 * delta), gradients(3 * a + b, p),
                            1e-6 * gradients.norm());
            }
    }
}

TEST(GridFluid, RandomFieldsHaveNoSources) {
    // The trace of the gradient vanishes up to what the grid resolves.
    const BoxVectors box = orthogonal(3.1, 2.6, 4.4);
    const HydrodynamicParticles particles = blobs(4, 0.3);
    const double tolerance = 1e-6;
    const GridResolution resolution(particles, tolerance, 0);
    GridStencils stencils(particles, resolution);
    stencils.moveTo(resolution.shapeFor(box), places(box), false);
    PlainGridFluid fluid;
    GridField field;
    fluid.draw(stencils, eta, NoiseStream(), NoiseStream::RandomField, field);
    MatrixXd gradients;
    fluid.averageGradients(field, stencils, gradients);
    for (int p = 0; p < particles.size(); p++)
        EXPECT_LE(abs(gradients(0, p) + gradients(4, p) + gradients(8, p)),
                  10 * sqrt(tolerance) * gradients.norm());
}

TEST(GridFluid, BoxesAwayMakeNoDifference) {
    const BoxVectors box = orthogonal(3.1, 2.6, 4.4);
    const HydrodynamicParticles particles = mixture();
    const GridResolution resolution(particles, 1e-6, 0);
    MatrixXd M[2];
    for (int i = 0; i < 2; i++) {
        vector<Vec3> at = places(box);
        if (i == 1)
            for (int p = 0; p < particles.size(); p++) at[p] += box[p % 3] * (p % 2 ? 1e6 : -1e6);
        GridStencils stencils(particles, resolution);
        stencils.moveTo(resolution.shapeFor(box), at, false);
        PlainGridFluid fluid;
        M[i] = dense(fluid, stencils);
    }
    // A position a million boxes away has an error of 4e6 rounded, 5e-10 nm.
    EXPECT_LE((M[0] - M[1]).norm(), 1e-8 * M[0].norm());
}

TEST(GridFluid, StencilsLongerThanTheBox) {
    // The first box is as wide as twice the largest radius, so stencils of several boxes add up.
    // The second box has edges of 1 : 10.
    for (const BoxVectors& box : {orthogonal(1.9, 2.0, 1.85), orthogonal(1.9, 19, 1.9)}) {
        const HydrodynamicParticles particles = mixture();
        const double tolerance = 1e-6;
        const GridResolution resolution(particles, tolerance, 0);
        GridStencils stencils(particles, resolution);
        stencils.moveTo(resolution.shapeFor(box), places(box), false);
        EXPECT_GT(stencils.largestWidth(0), stencils.getShape().size[0]);
        PlainGridFluid fluid;
        const MatrixXd M = dense(fluid, stencils), exact = latticeSum(particles, box, places(box));
        EXPECT_LE(normOf(scaled(M - exact, particles)), 2 * tolerance);
    }
}

TEST(CpuGridFluid, IsThePlainOneToRounding) {
    const HydrodynamicParticles particles = mixture();
    const GridResolution resolution(particles, 1e-4, 0);
    const auto compare = [&](const GridShape& shape, const vector<Vec3>& at) {
        GridStencils stencils(particles, resolution);
        stencils.moveTo(shape, at, false);
        PlainGridFluid plain;
        CpuGridFluid fast;
        const MatrixXd M = dense(plain, stencils);
        EXPECT_LE((dense(fast, stencils) - M).norm(), 1e-13 * M.norm());
        VectorXd velocities[2];
        MatrixXd gradients[2];
        GridFluid* const fluids[2] = {&plain, &fast};
        for (int i = 0; i < 2; i++) {
            GridField field;
            fluids[i]->draw(stencils, eta, NoiseStream(), NoiseStream::RandomField, field);
            fluids[i]->average(field, stencils, velocities[i]);
            fluids[i]->averageGradients(field, stencils, gradients[i]);
        }
        EXPECT_LE((velocities[1] - velocities[0]).norm(), 1e-12 * velocities[0].norm());
        EXPECT_LE((gradients[1] - gradients[0]).norm(), 1e-12 * gradients[0].norm());
    };
    for (const BoxVectors& box : {orthogonal(3.1, 2.6, 4.4), orthogonal(1.9, 2.3, 1.85)})
        for (array<int, 3> size :
             {array<int, 3>{0, 0, 0}, array<int, 3>{23, 31, 29}, array<int, 3>{2, 2, 2}}) {
            GridShape shape = resolution.shapeFor(box);
            if (size[0] > 0) shape.size = size;
            compare(shape, places(box));
        }
    for (const MirroredGrid& grid : mirroredGrids)
        compare(mirroredShape(resolution, grid), inChannel(grid.twice));
}

TEST(CpuGridFluid, ThreadsDoNotChangeABit) {
    const BoxVectors box = orthogonal(3.1, 2.6, 4.4);
    const HydrodynamicParticles particles = mixture();
    const GridResolution resolution(particles, 1e-4, 0);
    GridStencils stencils(particles, resolution);
    for (bool mirrored : {false, true}) {
        if (mirrored)
            stencils.moveTo(mirroredShape(resolution, mirroredGrids[2]),
                            inChannel(mirroredGrids[2].twice), false);
        else
            stencils.moveTo(resolution.shapeFor(box), places(box), false);
        const VectorXd forces = VectorXd::LinSpaced(particles.numRows, 1, 3);
        MatrixXd first;
        for (int threads : {1, 2, 4, 7}) {
            CpuGridFluid fluid(onThreads(threads));
            GridField field;
            MatrixXd velocities, result(particles.numRows, 2);
            VectorXd slips;
            fluid.multiply(stencils, eta, forces, velocities);
            fluid.draw(stencils, eta, NoiseStream(), NoiseStream::RandomField, field);
            fluid.average(field, stencils, slips);
            result << velocities, slips;
            if (threads == 1) first = result;
            EXPECT_TRUE((result.array() == first.array()).all()) << threads;
        }
    }
}

TEST(CpuGridFluid, RoughProductsHaveTheErrorThatTheyPromiseOnAnyThreads) {
    // The cases have spheres and blobs that overlap or do not, boxes that stencils fit into or not,
    // and channels.
    const HydrodynamicParticles particles = mixture();
    const GridResolution resolution(particles, 1e-4, 0);
    vector<pair<GridShape, vector<Vec3>>> cases;
    for (const BoxVectors& box :
         {orthogonal(3.1, 2.6, 4.4), orthogonal(1.9, 2.3, 1.85), orthogonal(7, 5, 8)})
        cases.push_back({resolution.shapeFor(box), places(box)});
    for (const MirroredGrid& grid : mirroredGrids)
        cases.push_back({mirroredShape(resolution, grid), inChannel(grid.twice)});
    for (const auto& [shape, at] : cases) {
        GridStencils stencils(particles, resolution);
        stencils.moveTo(shape, at, false);
        const int rows = particles.numRows;
        CpuGridFluid fluid;
        MatrixXd single, roughOfMany;
        const MatrixXd before = dense(fluid, stencils);
        fluid.multiplyInSingle(stencils, eta, MatrixXd::Identity(rows, rows), single);
        EXPECT_LE(normOf(scaled(0.5 * (single + single.transpose()) - before, particles)),
                  Accuracy::errorOfSinglePrecision * normOf(scaled(before, particles)));
        EXPECT_LE((single - before).norm(), Accuracy::errorOfSinglePrecision * before.norm());
        EXPECT_GT((single - before).norm(), 0);
        // Products in single precision have no influence on later exact ones.
        EXPECT_EQ(dense(fluid, stencils), before);
        CpuGridFluid many(onThreads(3));
        many.multiplyInSingle(stencils, eta, MatrixXd::Identity(rows, rows), roughOfMany);
        EXPECT_EQ(roughOfMany, single);
    }
}

TEST(ForceCouplingGrid, NeedsABox) {
    const ForceCouplingGrid model(blobs(1, 0.3), eta, 1e-3, 0, make_shared<PlainGridFluid>());
    RigidHITest::expectError(
        [&] {
            model.at({{Vec3()}, {}});
        },
        {"ForceCoupling on a grid", "needs a periodic box, but the System has none"});
}

namespace {

void checkTriclinicBoxes(const vector<double>& tolerances) {
    const vector<BoxVectors> boxes = {
        {{Vec3(3.1, 0, 0), Vec3(1.55, 2.6, 0), Vec3(0, 0, 4.4)}},
        {{Vec3(3.1, 0, 0), Vec3(0, 2.6, 0), Vec3(0, -1.3, 4.4)}},
        {{Vec3(3.1, 0, 0), Vec3(-1.2, 2.6, 0), Vec3(0.9, 1.1, 3.4)}},
    };
    for (const BoxVectors& box : boxes)
        for (bool torques : {false, true}) {
            const HydrodynamicParticles particles = torques ? mixture() : blobs(4, 0.3);
            const MatrixXd exact = latticeSum(particles, box, places(box));
            for (double tolerance : tolerances) {
                const ForceCouplingGrid model(particles, eta, tolerance, 0,
                                              make_shared<CpuGridFluid>());
                MatrixXd M;
                model.at({places(box), box})->dense(M);
                const double error = normOf(scaled(M - exact, particles));
                EXPECT_LE(error, tolerance) << (torques ? " with torques" : "");
                EXPECT_LE((M - M.transpose()).norm(), 1e-15 * M.norm() * particles.numRows);
            }
        }
}

}  // namespace

TEST(ForceCouplingGrid, TakesTriclinicBoxes) { checkTriclinicBoxes({1e-2, 1e-4, 1e-8}); }
TEST(ForceCouplingGrid, FullTakesTriclinicBoxesAtOtherTolerances) {
    checkTriclinicBoxes({1e-3, 1e-5, 1e-6});
}

TEST(ForceCouplingGrid, FieldsInTriclinicBoxesHaveTheSlipsForAverages) {
    // Particles move with the average of the flow over their Gaussians, here by Gauss's rule.
    const BoxVectors box = {{Vec3(3.1, 0, 0), Vec3(1.4, 2.6, 0), Vec3(0, 0, 4.4)}};
    const HydrodynamicParticles particles = blobs(4, 0.5);
    const ForceCouplingGrid model(particles, eta, 1e-6, 0, make_shared<CpuGridFluid>());
    unique_ptr<RandomField> field;
    model.randomField()->draw(NoiseStream(), NoiseStream::RandomField, box, field);
    MatrixXd slips;
    field->slipsAt({places(box), box}, false, slips);
    // The field has no derivatives by positions here, and schemes take differences.
    EXPECT_FALSE(field->hasGradients());
    const int number = 20;
    MatrixXd recurrence = MatrixXd::Zero(number, number);
    for (int i = 1; i < number; i++) recurrence(i, i - 1) = recurrence(i - 1, i) = sqrt(i);
    const SelfAdjointEigenSolver<MatrixXd> rule(recurrence);
    for (int p = 0; p < particles.size(); p++) {
        vector<Vec3> points;
        VectorXd weights(number * number * number);
        for (int i = 0; i < weights.size(); i++) {
            Vec3 x = places(box)[p];
            weights[i] = 1;
            const int node[3] = {i % number, i / number % number, i / number / number};
            for (int axis = 0; axis < 3; axis++) {
                x[axis] += 0.5 / sqrt(M_PI) * rule.eigenvalues()[node[axis]];
                weights[i] *= pow(rule.eigenvectors()(0, node[axis]), 2);
            }
            points.push_back(x);
        }
        Velocities flow = Velocities::Zero(3, points.size());
        field->addFlowAt(points, 1, flow);
        EXPECT_LE((flow * weights - slips.col(0).segment<3>(3 * p)).norm(), 1e-5 * slips.norm());
    }
}
