#include "rigid/BodyField.h"

#include <Eigen/Geometry>

#include "rigid/BodyMobility.h"
#include "rigidbody/EigenVec3.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

BodyField::BodyField(BodyMobility& mobility)
    : mobility(mobility), bodies(mobility.getBodies()), slipSpace(mobility.getSlipSpace()) {}

bool BodyField::givesSlips() const {
    return (!slipSpace.areOfBodies() || slipSpace.areOfParts()) && bodies.getModel().randomField();
}

bool BodyField::knowsDivergence() const {
    return givesSlips() && bodies.getModel().randomField()->isLocal() &&
           !bodies.getFreeMotion().turnsWithBodies();
}

bool BodyField::draw(const NoiseStream& noise, uint32_t purpose,
                     unique_ptr<RandomField>& field) const {
    if (!givesSlips()) return false;
    bodies.getModel().randomField()->draw(noise, purpose, bodies.getBox(), field);
    return true;
}

double BodyField::divergenceOf(RandomField& field) {
    bool known = field.hasGradients();
    // The field does not give angular velocities of spheres. For a sphere about its centre they do
    // not contribute.
    for (const FluidElement& element : bodies.getElements())
        known = known && !(element.isSphere() && element.sites[0] != Vector3d::Zero()) &&
                (element.isWhollyFree() || element.isWhollyFixed());
    return known ? divergenceByGradients(field) : divergenceByDifferences(field);
}

/**
 * The nearest twist of a body is A P A^T v, with P in the body's frame. If the body moves, v
 * changes; if it turns, v and A change. The trace is over the body's own coordinates.
 */
double BodyField::divergenceByGradients(RandomField& field) {
    BodiesAt& here = mobility.particlesHere();
    field.slipsAt(here.getPlacement(), here.isNearby(), slips);
    field.gradientsAt(here.getPlacement(), here.isNearby(), gradients);
    double sum = 0;
    for (size_t e = 0; e < bodies.getElements().size(); e++) {
        const FluidElement& element = bodies.getElements()[e];
        // A flow without sources moves spheres and free particles without divergence.
        if (element.isFree() || element.isSphere() || element.isWhollyFixed()) continue;
        const MatrixXd& nearest = slipSpace.nearestOfElement_body(e);
        const Matrix3d& A = here.getTurns()[e];
        const int firstRow = bodies.getMotion().firstParticleRow(e);
        const int firstParticle = bodies.getMotion().firstParticle(e);
        for (size_t i = 0; i < element.sites.size(); i++) {
            const Matrix3d P_t = A * nearest.block<3, 3>(0, 3 * i) * A.transpose(),
                           P_r = A * nearest.block<3, 3>(3, 3 * i) * A.transpose();
            const Matrix3d G =
                Map<const Matrix<double, 3, 3, RowMajor>>(&gradients(0, firstParticle + i));
            const Vector3d v = slips.col(0).segment<3>(firstRow + 3 * i),
                           arm = A * element.sites[i];
            sum += (P_t * G).trace() + (P_r * crossMatrix(v)).trace() -
                   (P_r * G * crossMatrix(arm)).trace();
        }
    }
    return sum;
}

double BodyField::divergenceByDifferences(RandomField& field) {
    BodiesAt& here = mobility.particlesHere();
    // The field's slips are exact functions of positions, so central differences have errors of
    // delta^2 and rounding/delta only.
    const double delta = 1e-5;
    const auto& elements = bodies.getElements();
    double sum = 0;
    for (int axis = 0; axis < 6; axis++)
        for (int side : {1, -1}) {
            displaced = here.getPlacement();
            displacedTurns = here.getTurns();
            const Matrix3d turn(AngleAxisd(side * delta, Vector3d::Unit(axis % 3)));
            for (size_t e = 0; e < elements.size(); e++) {
                const double step = side * delta * (axis < 3 ? bodies.length(e) : 1);
                for (size_t i = 0; i < elements[e].sites.size(); i++) {
                    OpenMM::Vec3& x = displaced.positions[bodies.getMotion().firstParticle(e) + i];
                    if (axis < 3) {
                        x[axis] += step;
                    } else if (!elements[e].isFree()) {
                        const Vector3d arm = here.getTurns()[e] * elements[e].sites[i],
                                       moved = turn * arm - arm;
                        x += OpenMM::Vec3(moved[0], moved[1], moved[2]);
                    }
                }
                if (axis >= 3) displacedTurns[e] = turn * displacedTurns[e];
            }
            field.slipsAt(displaced, true, slips);
            slipSpace.nearestTwists(displacedTurns, slips, twists);
            for (size_t e = 0; e < elements.size(); e++)
                if (axis < elements[e].numRows() &&
                    bodies.getFreeMotion().isFree(bodies.firstRow(e) + axis))
                    sum += side * twists(bodies.firstRow(e) + axis, 0) /
                           (2 * delta * (axis < 3 ? bodies.length(e) : 1));
        }
    return sum;
}

}  // namespace RigidHIPlugin
