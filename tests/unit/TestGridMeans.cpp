// Means of fields on grids over x, y and a part of the heights, compared with quadratures.

#include <cmath>
#include <complex>

#include "FlowReadingSupport.h"
#include "mobility/models/forcecoupling/ForceCouplingGrid.h"
#include "mobility/models/forcecoupling/GridMeans.h"

using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace std;
using OpenMM::Vec3;

namespace {

const BoxVectors box = {Vec3(5, 0, 0), Vec3(0, 6, 0), Vec3(0, 0, 7)};

struct Quadrature {
    vector<Vec3> points;
    vector<double> weights;
    /** Over x and y, exactly for the modes of a grid of fewer nodes, and over heights to rounding.
     */
    Quadrature(double low, double high) {
        const int along = 24;
        VectorXd z, w;
        gauss(24, false, z, w);
        for (int k = 0; k < z.size(); k++)
            for (int i = 0; i < along; i++)
                for (int j = 0; j < along; j++) {
                    points.push_back(Vec3(5.0 * i / along, 6.0 * j / along,
                                          0.5 * (low + high) + 0.5 * (high - low) * z[k]));
                    weights.push_back(w[k] / (along * along));
                }
    }
};

}  // namespace

TEST(GridMeans, AmplitudesAreMeansOverTheHeight) {
    HydrodynamicParticles particles;
    particles.add(1, true, 0, 0);
    const double low = -0.7, high = 3.9;
    for (double spacing : {0.0, 0.75}) {
        const ForceCouplingGrid grid(particles, 1.3, 0.05, spacing, make_shared<PlainGridFluid>());
        const MobilityModel& model = grid;
        unique_ptr<RandomField> field;
        model.randomField()->draw(NoiseStream{5, 7}, 3, box, field);
        const Quadrature quadrature(low, high);
        Velocities flow = Velocities::Zero(3, quadrature.points.size());
        field->addFlowAt(quadrature.points, 1, flow);
        for (int axis : {0, 1})
            for (int index : {1, 2})
                for (double phase : {0.0, M_PI / 2, 0.4}) {
                    DrivenFlow wave;
                    wave.forceAxis = 1 - axis;
                    wave.waveAxis = axis;
                    wave.k = 2 * M_PI * index / box[axis][axis];
                    wave.phase = phase;
                    wave.hasPlanes = true;
                    wave.low = low;
                    wave.high = wave.top = high;
                    double sum = 0, size = 0;
                    for (size_t p = 0; p < quadrature.points.size(); p++) {
                        const double u = flow(1 - axis, p);
                        sum += 2 * quadrature.weights[p] * u *
                               sin(wave.k * quadrature.points[p][axis] + phase);
                        size += quadrature.weights[p] * u * u;
                    }
                    EXPECT_NEAR(field->amplitudeOf(wave), sum, 1e-12 * sqrt(size));
                    EXPECT_GT(abs(sum), 1e-3 * sqrt(size));
                }
        // The whole fluid of a periodic box does not move.
        EXPECT_EQ(field->meanFlow(-INFINITY, INFINITY), Vector3d::Zero());
    }
}

TEST(GridMeans, TheMeanOfAFieldIsThatOfItsFlow) {
    HydrodynamicParticles particles;
    particles.add(1, true, 0, 0);
    const GridResolution resolution(particles, 0.05, 0);
    GridStencils stencils(particles, resolution);
    stencils.layOut(resolution.shapeFor(box));
    PlainGridFluid fluid;
    GridField field;
    const CounterModeNoise noise(NoiseStream{5, 7}, 3);
    fluid.draw(stencils, 1.3, noise, field);
    GridFlow flow;
    flow.draw(stencils, 1.3, noise);
    for (const auto& [low, high] : {pair(-0.7, 3.9), pair(2.0, 2.5), pair(0.0, 7.0)}) {
        const Quadrature quadrature(low, high);
        Velocities velocities = Velocities::Zero(3, quadrature.points.size());
        flow.addAt(quadrature.points, 1, velocities);
        const Vector3d sum = velocities * Eigen::Map<const VectorXd>(quadrature.weights.data(),
                                                                     quadrature.weights.size());
        const Vector3d mean = meanOverHeight(field, 0, 0, low, high).real();
        EXPECT_LE((mean - sum).cwiseAbs().maxCoeff(), 1e-13 * velocities.cwiseAbs().maxCoeff());
        EXPECT_EQ(mean.norm() > 1e-3 * velocities.cwiseAbs().maxCoeff(), high < 7);
    }
}
