#include "mobility/models/confined/ConfinedRandomField.h"

#include <algorithm>
#include <cmath>

#include "mobility/InnerErrors.h"
#include "mobility/models/confined/PlaneModes.h"
#include "mobility/models/ewald/NearPair.h"
#include "mobility/models/forcecoupling/GridWalls.h"
#include "mobility/models/periodic/PeriodicMobility.h"

namespace RigidHIPlugin {

using Eigen::MatrixXd;
using Eigen::Vector3d;
using OpenMM::Vec3;

ConfinedRandomField::ConfinedRandomField(const ConfinedRotnePragerYamakawaGrid& model)
    : model(model), particles(model.getParticles()),
      lanczos(InnerErrors::ofDifferences * model.getTolerance(), Lanczos::defaultIterations,
              model.getTolerance()),
      ownScale(rootsOfOwnFriction(particles)) {}

ConfinedRandomField::~ConfinedRandomField() {}

void ConfinedRandomField::draw(const NoiseStream& newNoise, uint32_t newPurpose,
                               const BoxVectors& newBox) {
    model.check(newBox);
    box = newBox;
    noise = newNoise;
    purpose = newPurpose;
    // Groups of one Context have the same modes, but each group takes its own random numbers, by
    // its first particle.
    ofDraw = noise;
    ofDraw.field = 1 + particles.systemIndex[0];
    W.resize(particles.numRows, 1);
    for (int i = 0; i < particles.size(); i++)
        for (int k = 0; k < (particles.hasTorque[i] ? 6 : 3); k += 2) {
            double* const to = &W(particles.firstRow[i] + k, 0);
            double unused;
            const bool last = !particles.hasTorque[i] && k == 2;
            noise.pair(purpose, particles.systemIndex[i], k / 2, to[0], last ? unused : to[1]);
        }
    isDrawn = isThere = hasForces = false;
}

void ConfinedRandomField::drawFor(double top, double nearest) {
    base = model.baseFor(box, top, nearest);
    if (base.model != baseOfPlanes.model) {
        const auto inBox = base.model->inBox({box[0], box[1], Vec3(0, 0, base.period)});
        const EwaldSplitting& splitting = inBox->splitting;
        const GridWallFields& ofWalls = splitting.shape.walls->getFields();
        planes =
            std::make_unique<NearPlanes>(particles, base.model->getKinds(), splitting,
                                         model.getTolerance(), base.height, base.longest, ofWalls);
        uniform = std::make_unique<UniformField>(
            particles, model.getViscosity(), ofWalls.getConditions(), splitting.shape,
            [xi = splitting.xi](double k) { return hasimoto(k, xi); },
            [](double radius, double k) { return overSurfaces().waveFactors(radius, k); });
        baseOfPlanes = base;
        parts.reset();
    }
    base.model->setBox(parts, base.model->inBox({box[0], box[1], Vec3(0, 0, base.period)}));
    parts->draw(ofDraw, purpose, fields);
    parts.reset();  // so that products can reuse these parts
    uniform->draw(CounterModeNoise(ofDraw, purpose));
    isDrawn = true;
    isThere = false;
}

void ConfinedRandomField::moveTo(const Placement& placement, bool nearby) {
    if (nearby && !parts && isThere) {
        // Differences need the pairs and nodes of the previous placement.
        base.model->move(parts, inBase, false);
    }
    model.lift(placement, nearby, lifted);
    if (!isDrawn || !model.holds(base, lifted.top, lifted.nearest, nearby ? 1e-3 : 0))
        drawFor(lifted.top, lifted.nearest);
    at = placement;
    wasNearby = nearby;
    isThere = true;
    hasForces = false;
    inBase.box = {box[0], box[1], Vec3(0, 0, base.period)};
    inBase.positions = lifted.positions;
    for (Vec3& x : inBase.positions) x[2] -= model.getPlanes().getLow() + 0.5 * base.height;
    base.model->move(parts, inBase, nearby);
    planes->moveTo(inBase.positions, nearby, parts->getBox()->spacing, parts->ranges());
    uniform->moveTo(inBase.positions);
}

/** Compute velocities = N' forces. */
void ConfinedRandomField::applyPairs(const MatrixXd& forces, MatrixXd& result) {
    const double unit = 8 * M_PI * model.getViscosity();
    parts->multiplyPairs(forces, result);
    result *= unit;
    for (int c = 0; c < forces.cols(); c++) {
        planes->subtractProduct(forces.col(c).data(), result.col(c).data(), parts->ranges());
        uniform->subtractProduct(forces.col(c).data(), result.col(c).data());
    }
    result /= unit;
}

void ConfinedRandomField::multiplyPairs(const Placement& placement, const MatrixXd& forces,
                                        MatrixXd& result) {
    moveTo(placement, false);
    applyPairs(forces, result);
    isThere = false;
}

void ConfinedRandomField::slipsAt(const Placement& placement, bool nearby, MatrixXd& slips) {
    if (!isThere || nearby != wasNearby || placement.positions != at.positions) {
        moveTo(placement, nearby);
        const double more =
            InnerErrors::ofOwnMobilities * model.getTolerance() / (6 * M_PI * model.getViscosity());
        lanczos.apply(
            [&](double, const MatrixXd& x, MatrixXd& y) {
                scaled = ownScale.asDiagonal() * x;
                applyPairs(scaled, y);
                y = ownScale.asDiagonal() * y;
                y += more * x;
            },
            W, {SpectralFunction::squareRoot()}, velocities);
        velocities = ownScale.cwiseInverse().asDiagonal() * velocities;
        parts->addAverages(fields, velocities);
        uniform->addTo(velocities.data());
        if (lifted.weights.size() > 0) velocities = lifted.weights.asDiagonal() * velocities;
        if (!nearby) parts.reset();
    }
    slips = velocities;
}

/** Find the forces f with M f = slips. */
void ConfinedRandomField::findForces() {
    if (hasForces) return;
    const auto here = wasNearby ? nullptr : model.at(at);
    std::unique_ptr<MobilityAt> place;
    if (!here) {
        model.placeNear(place, at);
    }
    MobilityAt& mobility = here ? *here : *place;
    Lanczos solver(model.getTolerance(), Lanczos::defaultIterations, model.getTolerance());
    solver.apply(
        [&](double, const MatrixXd& x, MatrixXd& y) {
            scaled = ownScale.asDiagonal() * x;
            mobility.multiply(scaled, y);
            y = ownScale.asDiagonal() * y;
        },
        ownScale.asDiagonal() * velocities, {SpectralFunction::inverse()}, forcesOfSlips);
    forcesOfSlips = ownScale.asDiagonal() * forcesOfSlips;
    hasForces = true;
}

void ConfinedRandomField::addFlowAt(const std::vector<Vec3>& points, double factor,
                                    Velocities& flow) {
    findForces();
    std::unique_ptr<MobilityAt> place;
    if (wasNearby)
        model.placeNear(place, at);
    else
        model.place(place, at);
    place->addFlowAt({forcesOfSlips, {}}, points, factor, flow);
}

/**
 * The power of the forces on a flow. By the symmetry of M it gives the component of the forces' own
 * flow.
 */
double ConfinedRandomField::powerOn(const DrivenFlow& flow) const {
    double power = 0;
    for (int p = 0; p < particles.size(); p++) {
        const WaveFactors f = model.waveFactors(particles.radii[p], flow.k);
        const Vec3& r = lifted.positions[p];
        const Vector3d x(r[0], r[1], r[2]);
        const int row = particles.firstRow[p];
        const double weight = lifted.weights.size() > 0 ? lifted.weights[row] : 1;
        power += weight * forcesOfSlips.block<3, 1>(row, 0).dot(flow.velocityAt(x, f));
        if (particles.hasTorque[p])
            power +=
                weight * forcesOfSlips.block<3, 1>(row + 3, 0).dot(flow.angularVelocityAt(x, f));
    }
    return power;
}

double ConfinedRandomField::amplitudeOf(const DrivenFlow& wave) {
    findForces();
    const double volume = planeArea(box) * (wave.high - wave.low);
    return 2 / (model.getViscosity() * wave.k * wave.k * volume) * powerOn(wave);
}

Vector3d ConfinedRandomField::meanFlow(double low, double high) {
    Vector3d mean = Vector3d::Zero();
    if (model.getPlanes().hasZeroFlux()) return mean;
    findForces();
    for (int axis = 0; axis < 2; axis++) {
        // the flow of a unit force density
        DrivenFlow unit;
        unit.hasPlanes = true;
        unit.low = low;
        unit.high = unit.top = high;
        unit.bend[axis] = 1 / (2 * model.getViscosity());
        mean[axis] = powerOn(unit) / (planeArea(box) * (high - low));
    }
    return mean;
}

long long ConfinedRandomField::getNumRandomNumbers() const {
    if (!isDrawn) return 0;
    // The last term counts the flow that does not depend on x and y.
    return GridModeNoise::numbersOf(fields[0].shape) + particles.numRows +
           uniform->getNumRandomNumbers();
}

}  // namespace RigidHIPlugin
