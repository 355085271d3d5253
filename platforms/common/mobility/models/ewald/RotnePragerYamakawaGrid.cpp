#include "mobility/models/ewald/RotnePragerYamakawaGrid.h"

#include <openmm/OpenMMException.h>

#include <algorithm>
#include <cmath>

#include "mobility/models/ewald/NearField.h"
#include "mobility/models/ewald/WaveField.h"
#include "mobility/models/forcecoupling/GridChecks.h"
#include "mobility/models/periodic/PeriodicMobility.h"
#include "openmmrigidhi/internal/Messages.h"

using namespace Eigen;
using OpenMM::Vec3;

namespace RigidHIPlugin {

namespace {

class Place : public MobilityAt {
public:
    explicit Place(const RotnePragerYamakawaGrid& model)
        : MobilityAt(model), model(model), near(particles), waves(particles, model.getKinds()) {
        for (int p = 0; p < particles.size(); p++)
            for (size_t k = 0; k < model.getKinds().size(); k++)
                if (model.getKinds()[k].radius == particles.radii[p]) kindOfParticle.push_back(k);
    }
    void apply(const MatrixXd& forces, MatrixXd& velocities) override { multiply(forces, velocities, false); }
    void applyRoughly(const MatrixXd& forces, MatrixXd& velocities) override { multiply(forces, velocities, true); }
    void addFlowAt(const FlowSources& sources, const std::vector<Vec3>& points, double factor,
                   Velocities& velocities) override {
        LatticeSum flow(particles, overSurfaces(), false, true);
        flow.setBox(next.box);
        flow.addFlowAt(next.positions, sources, points, factor / (8 * M_PI * viscosity), velocities);
    }

protected:
    void moveTo(const Placement& placement, bool nearby) override {
        model.checkBox(placement.box);
        // Nearby is near the placement before, where anchors then must be.
        if (nearby) prepare();
        next = placement;
        nextIsNearby = nearby;
        isPrepared = false;
    }

private:
    /** Pairs and weights are made for the first product: schemes also go where they ask for none. */
    void prepare() {
        if (isPrepared) return;
        if (next.box != box) {
            box = next.box;
            const EwaldSplitting splitting = model.splittingFor(box);
            spacing = 0;
            for (int axis = 0; axis < 3; axis++) spacing = std::max(spacing, splitting.shape.spacing(axis));
            // As far as two particles may be from their anchors, each a tenth of the spacing along each axis.
            tables.reset(
                new NearTables(model.getKinds(), near.numbersOfPair(), splitting.xi, splitting.gap, 0.4 * spacing));
            near.setTables(*tables, kindOfParticle, splitting.shape);
            waves.setSplitting(splitting);
        }
        const GridFluid& fluid = model.getFluid();
        waves.moveTo(next.positions, nextIsNearby);
        near.moveTo(next.positions, nextIsNearby, spacing,
                    [&](int count, const std::function<void(int, int)>& task) { fluid.forRanges(count, task); });
        isPrepared = true;
    }
    void multiply(const MatrixXd& forces, MatrixXd& velocities, bool roughly) {
        prepare();
        const TimeOfLife timer(secondsOfGrid);
        GridFluid& fluid = model.getFluid();
        velocities.resize(forces.rows(), forces.cols());
        for (int c = 0; c < forces.cols(); c++) {
            near.multiply(
                forces.col(c).data(), velocities.col(c).data(),
                [&](int count, const std::function<void(int, int)>& task) { fluid.forRanges(count, task); });
            velocities.col(c) *= 1 / (8 * M_PI * viscosity);
            waves.addProduct(fluid, viscosity, roughly, forces.col(c).data(), velocities.col(c).data());
        }
    }
    const RotnePragerYamakawaGrid& model;
    NearField near;
    WaveField waves;
    std::unique_ptr<NearTables> tables;
    std::vector<int> kindOfParticle;
    BoxVectors box = {};
    double spacing = 0;
    Placement next;
    bool nextIsNearby = false, isPrepared = true;
};

}  // namespace

RotnePragerYamakawaGrid::RotnePragerYamakawaGrid(const HydrodynamicParticles& particles, double viscosity,
                                                 double tolerance, double spacing,
                                                 const std::shared_ptr<GridFluid>& fluid)
    : MobilityModel(particles, viscosity), tolerance(tolerance), spacing(spacing), kinds(kindsOf(particles)),
      fluid(fluid) {
    if ((int)kinds.size() > mostRadii)
        throw OpenMM::OpenMMException(
            "MobilityForce: RotnePragerYamakawa on a grid has " + text(kinds.size()) +
            " different radii, each of which takes transforms of its own, and may have " + text(mostRadii) +
            "; use setSolver(Dense), or fewer different radii by addParticle()");
}

EwaldSplitting RotnePragerYamakawaGrid::splittingFor(const BoxVectors& box) const {
    const std::lock_guard<std::mutex> lock(splittingMutex);
    if (!lastSplitting || lastBox != box) {
        lastSplitting.reset(new EwaldSplitting(kinds, tolerance, spacing, box));
        lastBox = box;
    }
    return *lastSplitting;
}

void RotnePragerYamakawaGrid::checkBox(const BoxVectors& box) const {
    checkBoxOfGrid(name(), box);
    const EwaldSplitting splitting = splittingFor(box);
    if (splitting.xi == 0) {
        const GridShape shape = EwaldSplitting(kinds, tolerance, 0, box).shape;
        refuseGrid(name(), "has no splitting with nodes " + text(spacing) + " nm apart and the tolerance " +
                               text(tolerance, 3) + "; give setGridSpacing() about " + text(shape.spacing(0), 3) +
                               " nm, or 0 for the fastest");
    }
    checkSizeOfGrid(name(), box, splitting.shape.spacing(0));
    int numChannels = 0, numParticles = 0;
    bool anyTorques = false;
    for (const EwaldKind& kind : kinds) {
        numChannels += kind.torques > 0 ? 2 : 1;
        numParticles += kind.particles;
        anyTorques = anyTorques || kind.torques > 0;
    }
    checkMemoryOfGrid(name(), splitting.shape,
                      numChannels * GridFluid::memory(splitting.shape) +
                          numParticles * splitting.neighbours * NearField::memoryOfPair(anyTorques),
                      fluid->memoryHeld());
}

std::string RotnePragerYamakawaGrid::describe(const BoxVectors& box) const {
    const EwaldSplitting splitting = splittingFor(box);
    const GridShape& shape = splitting.shape;
    return "pairs and a grid of " + std::to_string(shape.size[0]) + " x " + std::to_string(shape.size[1]) + " x " +
           std::to_string(shape.size[2]) + " nodes, whose products have the tolerance " + text(tolerance, 3) +
           " (positively split Ewald sums, xi = " + text(splitting.xi, 3) + "/nm, surfaces up to " +
           text(splitting.gap, 3) + " nm apart are pairs)";
}

WaveFactors RotnePragerYamakawaGrid::waveFactors(double radius, double k) const {
    return overSurfaces().waveFactors(radius, k);
}

void RotnePragerYamakawaGrid::checkWave(const BoxVectors& box, int axis, int periods) const {
    checkPeriodicWave(box, axis, periods);
}

std::unique_ptr<MobilityAt> RotnePragerYamakawaGrid::makePlace() const {
    return std::unique_ptr<MobilityAt>(new Place(*this));
}

}  // namespace RigidHIPlugin
