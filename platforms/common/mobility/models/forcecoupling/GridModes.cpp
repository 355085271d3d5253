#include "mobility/models/forcecoupling/GridModes.h"

#include <cstdlib>
#include <vector>

#include "mobility/models/forcecoupling/GridPlanes.h"
#include "mobility/models/forcecoupling/GridWallFields.h"

namespace RigidHIPlugin {

void GridModeNoise::fill(const int* nx, int count, int ny, int nz,
                         std::complex<double>* numbers) const {
    if (!mirrored || nz > 0)
        periodic.fill(nx, count, mirrored ? std::abs(ny) : ny, nz, numbers);
    else {
        // The numbers at n and -Pn are conjugates up to P, so draw those of only one of them.
        std::vector<int> drawn(nx, nx + count);
        for (int& n : drawn) n = std::abs(n);
        periodic.fill(drawn.data(), count, std::abs(ny), nz, numbers);
    }
    if (!mirrored) return;
    const double root = std::sqrt(2.0);
    std::complex<double>* const component[3] = {numbers, numbers + count, numbers + 2 * count};
    for (int i = 0; nz == 0 && i < count; i++) {
        if (nx[i] < 0)
            for (int c = 0; c < 3; c++)
                component[c][i] = (c == 1 ? -1.0 : 1.0) * std::conj(component[c][i]);
        if (nx[i] == 0) {
            for (int c : {0, 2}) component[c][i] = root * component[c][i].real();
            component[1][i] = 0;
        }
    }
    for (int i = 0; ny == 0 && i < count; i++) {
        for (int c : {0, 2}) component[c][i] *= root;
        component[1][i] = 0;
    }
    for (int i = 0; ny < 0 && i < count; i++) component[1][i] = -component[1][i];
}

long long GridModeNoise::numbersOf(const GridShape& shape) {
    const auto modes = [&](int axis) -> long long {
        return shape.size[axis] - (shape.size[axis] % 2 == 0);
    };
    // Three complex numbers for each pair of modes +-k that is not excluded; on a mirrored grid for
    // each mode with ny >= 0. Planes take complex numbers for each pair of wave vectors along the
    // planes, and real numbers for the mean flow along two axes.
    const long long wavesAlong = modes(0) * modes(1) - 1,
                    ofPlanes = shape.planes ? shape.planes->numUnknowns() * wavesAlong +
                                                  2 * shape.planes->getConditions().numOfMean()
                               : shape.walls ? 3 * GridWallFields::numSets * wavesAlong
                                             : 0;
    if (!shape.mirrored) return 3 * (modes(0) * modes(1) * modes(2) - 1) + ofPlanes;
    return 3 * (modes(0) * modes(2) - 1) * shape.numRows() + 6 * (shape.numRows() - 1);
}

}  // namespace RigidHIPlugin
