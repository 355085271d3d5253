#include "fluid/UserFlow.h"

#include <cmath>
#include <string>

#include "mobility/Models.h"
#include "openmmrigidhi/internal/Errors.h"
#include "rigidbody/EigenVec3.h"

using namespace std;

namespace RigidHIPlugin {

namespace {

constexpr ErrorsOf fail{"MobilityForce"};

}  // namespace

UserFlow::UserFlow(const MobilityForce& force)
    : isFreeDraining(force.getModel() == MobilityForce::FreeDraining),
      boundary(force.getBoundary()), viscosity(force.getViscosity()),
      wallHeight(force.getWallHeight()) {
    force.getSinusoidalForceDensity(f0, forceAxis, waveAxis, waveVectorIndex);
    force.getBackgroundFlow(velocity, gradient);
}

bool UserFlow::hasBackground() const {
    return velocity != OpenMM::Vec3() || gradient != vector<double>(gradient.size(), 0.0);
}

DrivenFlow UserFlow::inBox(const BoxVectors& box) const {
    DrivenFlow flow;
    flow.velocity = toEigen(velocity);
    flow.gradient = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(gradient.data());
    flow.forceAxis = forceAxis;
    flow.waveAxis = waveAxis;
    const double edge = box[waveAxis][waveAxis];
    if (hasWave() && edge > 0) {
        flow.k = 2 * M_PI * waveVectorIndex / edge;
        flow.waveVelocity = f0 / (viscosity * flow.k * flow.k);
    }
    return flow;
}

void UserFlow::check() const {
    if (hasWave() && isFreeDraining)
        fail(
            "a sinusoidal force density drives a fluid that bodies share, and under FreeDraining "
            "each body has a fluid of its own; use setModel(RotnePragerYamakawa), or "
            "setSinusoidalForceDensity() with f0 = 0");
    const BoundaryTraits& traits = traitsOf(boundary);
    if (hasWave() && !traits.isPeriodic)
        fail("a sinusoidal force density needs a periodic fluid, and the boundary is " +
             string(boundaryName(boundary)) + "; use setBoundary(" +
             namesIn(boundaryTable, ") or (",
                     [](const BoundaryTraits& other) { return other.isPeriodic; }) +
             "), or setSinusoidalForceDensity() with f0 = 0");
    if (hasWave() && (traits.isAcross(forceAxis) || traits.isAcross(waveAxis)))
        fail("the sinusoidal force density is along axis " + to_string(forceAxis) +
             " with its wave along axis " + to_string(waveAxis) + ", and a " + traits.name +
             " has its walls across axis " + to_string(traits.wallAxis) +
             "; both must be along the walls: give axes " + traits.axesAlongWalls());
    if (!hasBackground()) return;
    const bool isUniform = gradient == vector<double>(gradient.size(), 0.0);
    if (isFreeDraining && isUniform) return;
    if (traits.isPeriodic)
        fail("a background flow cannot be used with boundary " + string(boundaryName(boundary)) +
             ", because the mean velocity of a periodic fluid is 0 and a velocity gradient is not "
             "periodic; use setSinusoidalForceDensity(), or setBoundary(Unbounded)");
    if (boundary != MobilityForce::NoSlipWall) return;
    const double rounding = 1e-12, height = wallHeight;
    double largest = 0;
    for (double x : gradient) largest = max(largest, abs(x));
    for (int a = 0; a < 3; a++) {
        const double along = max(abs(gradient[3 * a]), abs(gradient[3 * a + 1])),
                     atWall = velocity[a] + gradient[3 * a + 2] * height;
        if (along <= rounding * largest &&
            abs(atWall) <= rounding * max(abs(velocity[a]), abs(gradient[3 * a + 2] * height)))
            continue;
        fail("the background flow is not 0 at the NoSlipWall z = " + number(height) +
             " nm: component " + to_string(a) + " is " + number(atWall) +
             " nm/ps above the origin and has the gradients " + number(gradient[3 * a]) + " and " +
             number(gradient[3 * a + 1]) +
             "/ps along the wall; give a flow that depends on z alone and is 0 at the wall, such "
             "as a shear flow, by setBackgroundFlow()");
    }
}

}  // namespace RigidHIPlugin
