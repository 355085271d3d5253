#include "mobility/models/forcecoupling/GridChannels.h"

#include <cmath>

namespace RigidHIPlugin {

GridFactors::GridFactors(const GridShape& shape,
                         const std::function<double(double, double)>& factor)
    : shape(shape), isSkewed(!shape.skew.isNone()),
      columnNumbers((size_t)GridStencils::slabsOf(shape) * 2 * GridStencils::slabWidth),
      numModes((shape.size[2] + 1) / 2) {
    const std::array<int, 3>& n = shape.size;
    const int numRows = isSkewed ? n[1] : n[1] / 2 + 1;
    const size_t numColumns = (size_t)numRows * numModes;
    exact.resize(numColumns * columnNumbers);
    single.resize(numColumns * columnNumbers);
    std::fill_n(exact.data(), exact.size(), 0.0);
    const double longest = shape.longestWave();
    for (int y = 0; y < numRows; y++)
        for (int z = 0; z < numModes; z++) {
            if (shape.isNyquist(1, y)) continue;
            double* const to = &exact[place(y, z)];
            const double ky = shape.waveNumber(1, y), kz = shape.waveNumber(2, z);
            for (int x = 0; isSkewed ? x < n[0] : 2 * x < n[0]; x++) {
                const double kx = shape.waveNumber(0, x), k2 = kx * kx + ky * ky + kz * kz;
                if (k2 == 0 || shape.isNyquist(0, x)) continue;
                if (isSkewed) {
                    const std::array<double, 3> k = shape.waveVector(x, y, z);
                    const double length = std::sqrt(k[0] * k[0] + k[1] * k[1] + k[2] * k[2]);
                    if (length <= longest)
                        to[2 * x] = to[2 * x + 1] = factor(length, std::sqrt(k2));
                    continue;
                }
                const double value = factor(std::sqrt(k2), std::sqrt(k2));
                for (int at : {2 * x, 2 * ((n[0] - x) % n[0])}) to[at] = to[at + 1] = value;
            }
        }
    std::copy_n(exact.data(), exact.size(), single.data());
}

}  // namespace RigidHIPlugin
