#include "mobility/models/forcecoupling/GridMeans.h"

#include <cmath>

namespace RigidHIPlugin {

using std::complex;

namespace {

/**
 * Weights of the nodes along z that give the mean from `low` to `high` of the modes of a grid:
 * (1/n) sum over k of exp(-ik z_j) times the mean of exp(ikz).
 */
Eigen::VectorXd weightsOfMean(const GridShape& shape, double low, double high) {
    const int n = shape.size[2];
    Eigen::VectorXd weights = Eigen::VectorXd::Constant(n, 1.0 / n);
    const double middle = 0.5 * (low + high), half = 0.5 * (high - low);
    for (int m = 1; 2 * m < n; m++) {
        const double k = shape.waveNumber(2, m), mean = std::sin(k * half) / (k * half);
        for (int j = 0; j < n; j++)
            weights[j] += 2.0 / n * mean * std::cos(k * (middle - j * shape.spacing(2)));
    }
    return weights;
}

}  // namespace

Eigen::Vector3cd meanOverHeight(const GridField& field, int axis, int index, double low,
                                double high) {
    const GridShape& shape = field.shape;
    const Eigen::VectorXd weights = weightsOfMean(shape, low, high);
    const int across = shape.size[0] * shape.size[1];
    Eigen::Vector3cd mean = Eigen::Vector3cd::Zero();
    for (int x = 0; x < shape.size[0]; x++)
        for (int y = 0; y < shape.size[1]; y++) {
            const double angle = -2 * M_PI * index * (axis == 0 ? x : y) / shape.size[axis];
            const complex<double> wave = std::polar(1.0 / across, angle);
            const size_t row = ((size_t)x * shape.size[1] + y) * field.rowLength;
            for (int c = 0; c < 3; c++)
                mean[c] += wave * Eigen::Map<const Eigen::VectorXd>(field.values[c].data() + row,
                                                                    shape.size[2])
                                      .dot(weights);
        }
    // The values are velocities times the root of a node's volume.
    return mean / std::sqrt(shape.volume() / shape.numNodes());
}

}  // namespace RigidHIPlugin
