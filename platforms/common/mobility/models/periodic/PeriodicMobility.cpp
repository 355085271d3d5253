#include "mobility/models/periodic/PeriodicMobility.h"

#include <openmm/OpenMMException.h>

#include <algorithm>
#include <cmath>

#include "mobility/CoincidenceCheck.h"
#include "mobility/models/periodic/MostLatticeRows.h"
#include "mobility/models/wall/NoSlipPlane.h"
#include "openmmrigidhi/internal/Messages.h"

namespace RigidHIPlugin {

using Eigen::MatrixXd;
using Eigen::Vector3d;

namespace {

MobilityTraits traitsOf(const char* name) {
    MobilityTraits traits(name);
    traits.isHomogeneous = traits.isDivergenceFree = true;
    traits.hasProducts = false;
    return traits;
}

}  // namespace

PeriodicMobility::PeriodicMobility(const HydrodynamicParticles& particles, double viscosity,
                                   const char* name, int largestRows)
    : MobilityModel(particles, viscosity, traitsOf(name)) {
    checkPeriodicRows(particles.numRows, largestRows);
}

void checkPeriodicRows(int rows, int largestRows) {
    if (rows <= largestRows) return;
    throw OpenMM::OpenMMException(
        "MobilityForce: a periodic fluid that is not matrix-free uses dense matrices of at most " +
        text(largestRows) + " rows, but these particles need " + text(rows) +
        " rows: six for each sphere (StokesianDynamics: eleven), three for each blob or particle "
        "in no body, and in a SlipChannel as many again for its image; use fewer particles, or "
        "the grid, by setSolver(MatrixFree)");
}

void PeriodicMobility::checkWave(const BoxVectors& box, int axis, int periods) const {
    checkPeriodicWave(box, axis, periods);
}

void checkPeriodicWave(const BoxVectors& box, int axis, int periods) {
    const double rounding = 1e-9;
    for (const OpenMM::Vec3& vector : box) {
        const double phase = periods * vector[axis] / box[axis][axis];
        if (std::abs(phase - std::round(phase)) <= rounding * std::max(1.0, std::abs(phase)))
            continue;
        throw OpenMM::OpenMMException(
            "MobilityForce: a wave of index " + text(periods) + " along the edge " + text(axis) +
            " of the box is not periodic along its vector " + text(vector) +
            " nm; take another wave axis or index, or an orthogonal box");
    }
}

std::string PeriodicMobility::coincidence(const Placement& placement,
                                          const Lattice& lattice) const {
    for (int i = 0; i < particles.size(); i++)
        for (int j = 0; j < i; j++) {
            const double smaller = std::min(particles.radii[i], particles.radii[j]),
                         bound = CoincidenceCheck::bound * smaller;
            if (std::abs(particles.radii[i] - particles.radii[j]) > bound) continue;
            // For small distances the wrapped difference is the nearest image.
            const double distance =
                lattice.wrapped(placement.positions[i] - placement.positions[j]).norm();
            if (distance > 0.5 * bound) continue;
            return particleAndBody(particles, j) + " and " + particleAndBody(particles, i) +
                   ", both of radius " + text(particles.radii[i]) +
                   " nm, are at the same place of the periodic box, " + text(distance) +
                   " nm apart, so that their mobility matrix is singular; move one of them, or "
                   "give it the radius 0 or another radius";
        }
    return {};
}

LatticeSumAt::LatticeSumAt(const PeriodicMobility& model)
    : MobilityAt(model), model(model), sum(particles, model.spreading(), false) {}

void LatticeSumAt::moveTo(const Placement& placement, bool nearby) {
    sum.setBox(placement.box);
    const std::string problem =
        nearby ? std::string() : model.coincidence(placement, sum.getLattice());
    if (!problem.empty()) throw OpenMM::OpenMMException("MobilityForce: " + problem);
    positions = placement.positions;
    box = placement.box;
    isKnown = false;
}

const MatrixXd& LatticeSumAt::matrix() {
    if (!isKnown) {
        sum.compute(positions, false, cached);
        cached *= 1 / (8 * M_PI * viscosity);
        isKnown = true;
    }
    return cached;
}

void LatticeSumAt::multiply(const MatrixXd& forces, MatrixXd& velocities, const Accuracy&) {
    velocities.noalias() = matrix() * forces;
}

void LatticeSumAt::addFlowAt(const FlowSources& sources, const std::vector<OpenMM::Vec3>& points,
                             double factor, Velocities& velocities) {
    LatticeSum flow(particles, model.spreading(), false, true);
    flow.setBox(box);
    flow.addFlowAt(positions, sources, points, factor / (8 * M_PI * viscosity), velocities);
}

void LatticeSumAt::dense(MatrixXd& mobility) { mobility = matrix(); }

// -------------------------------------------------------------------------------------------------

PeriodicRotnePragerYamakawa::PeriodicRotnePragerYamakawa(const HydrodynamicParticles& particles,
                                                         double viscosity)
    : PeriodicMobility(particles, viscosity, "RotnePragerYamakawa", mostLatticeRows) {}

const Spreading& PeriodicRotnePragerYamakawa::spreading() const { return overSurfaces(); }

std::unique_ptr<MobilityAt> PeriodicRotnePragerYamakawa::makePlace() const {
    return std::make_unique<LatticeSumAt>(*this);
}

PeriodicForceCoupling::PeriodicForceCoupling(const HydrodynamicParticles& particles,
                                             double viscosity)
    : PeriodicMobility(particles, viscosity, "ForceCoupling", mostLatticeRows) {}

const Spreading& PeriodicForceCoupling::spreading() const { return overGaussians(); }

std::unique_ptr<MobilityAt> PeriodicForceCoupling::makePlace() const {
    return std::make_unique<LatticeSumAt>(*this);
}

void PeriodicForceCoupling::ownMobility(const HydrodynamicParticles& body,
                                        const std::vector<OpenMM::Vec3>& sites,
                                        MatrixXd& mobility) const {
    freeForceCoupling(body, sites, viscosity, mobility);
}

void freeForceCoupling(const HydrodynamicParticles& body, const std::vector<OpenMM::Vec3>& sites,
                       double viscosity, MatrixXd& mobility) {
    mobility.setZero(body.numRows, body.numRows);
    PairBlocks pair;
    for (int i = 0; i < body.size(); i++)
        for (int j = 0; j < body.size(); j++) {
            const OpenMM::Vec3 d = sites[i] - sites[j];
            const Vector3d r(d[0], d[1], d[2]);
            pair.setZero();
            pair.add(overGaussians().free(body.radii[i], body.radii[j], r.norm(), true, false), r,
                     false);
            const int row = body.firstRow[i], column = body.firstRow[j];
            mobility.block<3, 3>(row, column) = pair.tt;
            if (body.hasTorque[i]) mobility.block<3, 3>(row + 3, column) = pair.rt;
            if (body.hasTorque[j]) mobility.block<3, 3>(row, column + 3) = pair.tr;
            if (body.hasTorque[i] && body.hasTorque[j])
                mobility.block<3, 3>(row + 3, column + 3) = pair.rr;
        }
    mobility *= 1 / (8 * M_PI * viscosity);
}

}  // namespace RigidHIPlugin
