#include "fluid/UserFlow.h"

#include <cmath>
#include <string>

#include "mobility/Models.h"
#include "openmmrigidhi/internal/Errors.h"
#include "rigidbody/EigenVec3.h"

using namespace std;

namespace RigidHIPlugin {

UserFlow::UserFlow(const MobilityForce& force)
    : wallVelocity(force.getWallVelocity()), bodyForceDensity(force.getBodyForceDensity()),
      isFreeDraining(force.getModel() == MobilityForce::FreeDraining),
      hasZeroFlux(force.getBoundary() == MobilityForce::NoSlipChannel &&
                  force.getChannelCondition() == MobilityForce::ZeroFlux),
      boundary(force.getBoundary()), viscosity(force.getViscosity()) {
    force.getSinusoidalForceDensity(f0, forceAxis, waveAxis, waveVectorIndex);
    force.getBackgroundFlow(velocity, gradient);
    force.getShear(shearRate, flowAxis, gradientAxis);
    findWalls(force, low, high);
}

bool UserFlow::hasBackground() const {
    return velocity != OpenMM::Vec3() || gradient != vector<double>(gradient.size(), 0.0);
}

bool UserFlow::isAlongPlanes() const {
    return wallVelocity != OpenMM::Vec3() || bodyForceDensity != OpenMM::Vec3();
}

bool UserFlow::hasPlanes() const { return isConfined(boundary); }

void UserFlow::setPlanes(DrivenFlow& flow) const {
    if (!hasPlanes()) return;
    flow.hasPlanes = true;
    flow.low = low;
    flow.high = high;
    // The free surface of a film is half way to the mirror image of its wall.
    flow.top = traitsOf(boundary).highWall == WallKind::Slip ? high + (high - low) : high;
}

DrivenFlow UserFlow::ofUnitForceDensity(int axis) const {
    DrivenFlow flow;
    setPlanes(flow);
    if (flow.hasPlanes && !hasZeroFlux) flow.bend[axis] = 1 / (2 * viscosity);
    return flow;
}

DrivenFlow UserFlow::inBox(const BoxVectors& box) const {
    DrivenFlow flow;
    setPlanes(flow);
    flow.velocity = toEigen(velocity);
    flow.gradient = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(gradient.data());
    flow.gradient(flowAxis, gradientAxis) += shearRate;
    flow.forceAxis = forceAxis;
    flow.waveAxis = waveAxis;
    const double edge = box[waveAxis][waveAxis];
    if (hasWave() && edge > 0) {
        flow.k = 2 * M_PI * waveVectorIndex / edge;
        flow.waveVelocity = f0 / (viscosity * flow.k * flow.k);
    }
    if (wallVelocity != OpenMM::Vec3()) {
        const double height = high - low;
        flow.slope = toEigen(wallVelocity) / height;
        // Without flux: U (3 s^2 - 2 s) = U s - 3 U s (1 - s), s = (z - low)/height.
        if (hasZeroFlux) flow.bend = -3 * flow.slope / height;
    }
    if (bodyForceDensity != OpenMM::Vec3())
        flow.bend += toEigen(bodyForceDensity) / (2 * viscosity);
    return flow;
}

BoxVectors UserFlow::tilted(BoxVectors box, double time) const {
    // Boxes stay lower triangular, because the flow is along an axis before that of its gradient.
    for (OpenMM::Vec3& vector : box) vector[flowAxis] += shearRate * time * vector[gradientAxis];
    for (int k = 1; k < 3; k++)
        for (int shorter = k - 1; shorter >= 0; shorter--)
            box[k] -= box[shorter] * round(box[k][shorter] / box[shorter][shorter]);
    return box;
}

void UserFlow::check() const {
    checkShear();
    if (hasWave() && isFreeDraining)
        failFluid(
            "a sinusoidal force density drives a fluid that bodies share, and under FreeDraining "
            "each body has a fluid of its own; use setModel(RotnePragerYamakawa), or "
            "setSinusoidalForceDensity() with f0 = 0");
    const BoundaryTraits& traits = traitsOf(boundary);
    if (hasWave() && !traits.isPeriodic)
        failFluid("a sinusoidal force density needs a periodic fluid, and the boundary is " +
                  string(boundaryName(boundary)) + "; use setBoundary(" +
                  namesIn(boundaryTable, ") or (",
                          [](const BoundaryTraits& other) { return other.isPeriodic; }) +
                  "), or setSinusoidalForceDensity() with f0 = 0");
    if (hasWave() && (traits.isAcross(forceAxis) || traits.isAcross(waveAxis)))
        failFluid("the sinusoidal force density is along axis " + to_string(forceAxis) +
                  " with its wave along axis " + to_string(waveAxis) + ", and a " + traits.name +
                  " has its walls across axis " + to_string(traits.wallAxis) +
                  "; both must be along the walls: give axes " + traits.axesAlongWalls());
    checkBackground();
    checkAlongPlanes();
}

void UserFlow::checkBackground() const {
    if (!hasBackground()) return;
    const bool isUniform = gradient == vector<double>(gradient.size(), 0.0);
    if (isFreeDraining && isUniform) return;
    const BoundaryTraits& traits = traitsOf(boundary);
    if (traits.isUniform()) return;
    const bool isAboveWall = traits.isAboveNoSlipWall();
    if (isConfined(boundary) && !isAboveWall)
        failFluid("a background flow cannot be used with boundary " + string(traits.name) +
                  ", whose flows are 0 on its walls; use " +
                  (boundary == MobilityForce::NoSlipChannel ? "setWallVelocity() or " : "") +
                  "setBodyForceDensity(), or setBoundary(Unbounded)");
    if (traits.isPeriodic && !isAboveWall)
        failFluid(
            "a background flow cannot be used with boundary " + string(boundaryName(boundary)) +
            ", because the mean velocity of a periodic fluid is 0 and a velocity gradient is not "
            "periodic; use setSinusoidalForceDensity(), or setBoundary(Unbounded)");
    if (!isAboveWall)
        failFluid("a background flow cannot be used with boundary " + string(traits.name) +
                  ", because it may not be a flow along " + traits.walls +
                  "; use setBoundary(Unbounded)");
    const double rounding = 1e-12, height = low;
    double largest = 0;
    for (double x : gradient) largest = max(largest, abs(x));
    for (int a = 0; a < 3; a++) {
        const double along = max(abs(gradient[3 * a]), abs(gradient[3 * a + 1])),
                     atWall = velocity[a] + gradient[3 * a + 2] * height;
        if (along <= rounding * largest &&
            abs(atWall) <= rounding * max(abs(velocity[a]), abs(gradient[3 * a + 2] * height)))
            continue;
        failFluid(
            "the background flow is not 0 at the " + string(traits.name) +
            " z = " + number(height) + " nm: component " + to_string(a) + " is " + number(atWall) +
            " nm/ps above the origin and has the gradients " + number(gradient[3 * a]) + " and " +
            number(gradient[3 * a + 1]) +
            "/ps along the wall; give a flow that depends on z alone and is 0 at the wall, such "
            "as a shear flow, by setBackgroundFlow()");
    }
}

void UserFlow::checkShear() const {
    if (!isSheared()) return;
    const string shear = "a shear (setShear()) of the rate " + number(shearRate) + "/ps ";
    const BoundaryTraits& traits = traitsOf(boundary);
    if (boundary != MobilityForce::Periodic)
        failFluid(shear + "tilts a periodic box, and the boundary is " + boundaryName(boundary) +
                  "; use " +
                  (boundary == MobilityForce::NoSlipChannel ? "setWallVelocity(), or "
                   : traits.isUniform() || traits.isAboveNoSlipWall()
                       ? "setBackgroundFlow() with the gradient of the shear, or "
                       : "") +
                  "setBoundary(Periodic), or setShear() with the rate 0");
    if (isFreeDraining)
        failFluid(
            shear +
            "moves one fluid around all bodies, which the model FreeDraining does not have; use "
            "setModel(RotnePragerYamakawa), or setShear() with the rate 0");
    if (hasWave())
        failFluid(
            shear +
            "cannot be used together with a sinusoidal force density, whose wave is not periodic "
            "in a box that tilts; use setSinusoidalForceDensity() with f0 = 0, or setShear() with "
            "the rate 0");
}

void UserFlow::checkAlongPlanes() const {
    const string name = boundaryName(boundary);
    if (wallVelocity != OpenMM::Vec3() && boundary != MobilityForce::NoSlipChannel)
        failFluid(
            "a wall velocity (setWallVelocity()) is that of the upper wall of a NoSlipChannel, "
            "and the boundary is " +
            name + "; use setBoundary(NoSlipChannel), or setWallVelocity() with 0");
    if (bodyForceDensity == OpenMM::Vec3()) return;
    const string orNone = ", or setBodyForceDensity() with 0";
    if (boundary == MobilityForce::PeriodicWall)
        failFluid(
            "a uniform force density (setBodyForceDensity()) drives no steady flow above a "
            "PeriodicWall, because nothing bounds the fluid above; use setBackgroundFlow() for "
            "shear, setBoundary(Film)" +
            orNone);
    if (boundary != MobilityForce::NoSlipChannel && boundary != MobilityForce::Film)
        failFluid(
            "a uniform force density (setBodyForceDensity()) drives a fluid between walls or in "
            "a film, and the boundary is " +
            name + "; use setBoundary(NoSlipChannel) or (Film)" + orNone);
    if (hasZeroFlux)
        failFluid(
            "a uniform force density (setBodyForceDensity()) drives no flow with the channel "
            "condition ZeroFlux, because the pressure balances it; use "
            "setChannelCondition(ZeroPressureGradient)" +
            orNone);
}

}  // namespace RigidHIPlugin
