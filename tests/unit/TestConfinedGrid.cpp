// Force coupling between planes on a grid: reference values, symmetry, noise, and what the result
// must not depend on.

#include <Eigen/Dense>
#include <cmath>

#include "ConfinedForceCoupling.h"
#include "EigenInstances.h"
#include "TestSupport.h"
#include "UnitNoise.h"
#include "mobility/models/confined/PlaneConditions.h"
#include "mobility/models/forcecoupling/CpuGridFluid.h"
#include "mobility/models/forcecoupling/GridPlanes.h"

using namespace Eigen;
using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace std;
using OpenMM::Vec3;

namespace {

HydrodynamicParticles threeSpheres() {
    HydrodynamicParticles particles;
    const double radii[] = {1, 0.8, 0.9};
    for (int i = 0; i < 3; i++) particles.add(radii[i], true, i, i);
    return particles;
}
const vector<Vec3> places = {Vec3(0.3, 0.4, 1.0), Vec3(2.1, 1.1, 1.9), Vec3(1.2, 4.2, 3.6)};
const double width = 5, depth = 6.2, height = 4.8;

MatrixXd lowerHalf(const double* numbers) {
    MatrixXd M(18, 18);
    for (int i = 0; i < 18; i++)
        for (int j = 0; j <= i; j++) M(i, j) = M(j, i) = *numbers++;
    return M;
}

GridShape shapeOf(const PlaneConditions& conditions, const GridResolution& resolution) {
    GridShape shape = resolution.shapeFor(
        {Vec3(width, 0, 0), Vec3(0, depth, 0), Vec3(0, 0, conditions.getPeriod())});
    shape.planes = make_shared<GridPlanes>(conditions, shape);
    return shape;
}
vector<Vec3> inGrid(const PlaneConditions& conditions, vector<Vec3> positions) {
    for (Vec3& x : positions) x[2] -= conditions.getOrigin();
    return positions;
}
MatrixXd matrixOf(GridFluid& fluid, const GridStencils& stencils, double eta = 1) {
    const int rows = stencils.getParticles().numRows;
    MatrixXd M;
    fluid.multiply(stencils, eta, MatrixXd::Identity(rows, rows), M);
    return M;
}
MatrixXd scaled(const MatrixXd& M, const HydrodynamicParticles& particles) {
    VectorXd root(particles.numRows);
    for (int p = 0; p < particles.size(); p++) {
        const double a = particles.radii[p];
        root.segment<3>(particles.firstRow[p]).setConstant(sqrt(6 * M_PI * a));
        root.segment<3>(particles.firstRow[p] + 3).setConstant(sqrt(8 * M_PI * a * a * a));
    }
    return root.asDiagonal() * M * root.asDiagonal();
}
double normOf(const MatrixXd& M) {
    return SelfAdjointEigenSolver<MatrixXd>(M, EigenvaluesOnly).eigenvalues().cwiseAbs().maxCoeff();
}

}  // namespace

TEST(ConfinedGrid, HasTheReferenceValues) {
    const HydrodynamicParticles particles = threeSpheres();
    const struct {
        PlaneConditions conditions;
        const double* expected;
    } cases[] = {{PlaneConditions::channel(height, 2, false), channelOfThreeSpheres},
                 {PlaneConditions::wall(height + 6, 2, 1.5), wallOfThreeSpheres},
                 {PlaneConditions::film(height, 2), filmOfThreeSpheres}};
    for (const auto& each : cases)
        for (double tolerance : {1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-8, 1e-10}) {
            const GridResolution resolution(particles, tolerance, 0);
            const GridShape shape = shapeOf(each.conditions, resolution);
            GridStencils stencils(particles, resolution);
            stencils.moveTo(shape, inGrid(each.conditions, places), false);
            PlainGridFluid plain;
            CpuGridFluid fast;
            const MatrixXd M = matrixOf(plain, stencils), ofCpu = matrixOf(fast, stencils);
            MatrixXd single;
            fast.multiplyInSingle(stencils, 1, MatrixXd::Identity(18, 18), single);
            printf("cpu %g single %g\n", (ofCpu - M).norm() / M.norm(),
                   (single - M).norm() / M.norm());
            const double error = normOf(scaled(M - lowerHalf(each.expected), particles));
            printf("%d %g: %g sym %g\n", int(&each - cases), tolerance, error,
                   (M - M.transpose()).norm() / M.norm());
            EXPECT_LE(error, tolerance);
            EXPECT_LE((M - M.transpose()).norm(), 1e-14 * M.norm());
        }
}

TEST(ConfinedGrid, RandomFieldsHaveTheCovarianceOfProducts) {
    const HydrodynamicParticles particles = threeSpheres();
    const vector<PlaneConditions> cases = {
        PlaneConditions::channel(height, 2, false), PlaneConditions::channel(height, 2, true),
        PlaneConditions::wall(height + 1, 2, 1.5), PlaneConditions::film(height, 2)};
    const GridResolution resolution(particles, 0.1, 0.9);
    for (const PlaneConditions& conditions : cases)
        for (array<int, 3> size : {array<int, 3>{6, 5, 8}, array<int, 3>{5, 6, 7}}) {
            GridShape shape = shapeOf(conditions, resolution);
            shape.size = size;
            shape.planes.reset();
            shape.planes = make_shared<GridPlanes>(conditions, shape);
            GridStencils stencils(particles, resolution);
            stencils.moveTo(shape, inGrid(conditions, places), false);
            PlainGridFluid plain;
            CpuGridFluid fast;
            const MatrixXd M = matrixOf(plain, stencils);
            for (GridFluid* fluid : {(GridFluid*)&plain, (GridFluid*)&fast}) {
                GridField field;
                VectorXd column;
                const auto columnOf = [&](const UnitNoise& noise) {
                    fluid->draw(stencils, 1, noise, field);
                    fluid->average(field, stencils, column);
                    return column;
                };
                MatrixXd covariance = covarianceOfFields(size, M.rows(), -size[1] / 2,
                                                         CounterModeNoise::isMirrored, columnOf);
                const double withoutPlanes = (covariance - M).norm() / M.norm();
                for (int nx = -size[0] / 2; nx <= size[0] / 2; nx++)
                    for (int ny = -size[1] / 2; ny <= size[1] / 2; ny++) {
                        if (CounterModeNoise::isMirrored(nx, ny, 0)) continue;
                        for (int j = 0; j < 4; j++)
                            for (int c = 0; c < 3; c++)
                                for (complex<double> value :
                                     {complex<double>(1, 0), complex<double>(0, 1)}) {
                                    const VectorXd v = columnOf(
                                        UnitNoise::ofPlane(nx, ny, j, c, sqrt(0.5) * value));
                                    covariance += v * v.transpose();
                                }
                    }
                printf("%d: %g without planes' %g\n", int(&conditions - &cases[0]),
                       (covariance - M).norm() / M.norm(), withoutPlanes);
            }
        }
}
