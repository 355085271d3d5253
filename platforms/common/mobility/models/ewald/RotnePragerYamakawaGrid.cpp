#include "mobility/models/ewald/RotnePragerYamakawaGrid.h"

#include <openmm/OpenMMException.h>

#include <algorithm>
#include <cmath>

#include "linearalgebra/Lanczos.h"
#include "mobility/InnerErrors.h"
#include "mobility/StressletBasis.h"
#include "mobility/models/ewald/NearPair.h"
#include "mobility/models/ewald/SplitParts.h"
#include "mobility/models/forcecoupling/GridChecks.h"
#include "mobility/models/periodic/PeriodicMobility.h"
#include "openmmrigidhi/internal/Messages.h"

using namespace Eigen;
using OpenMM::Vec3;

namespace RigidHIPlugin {

namespace {

class RotnePragerYamakawaGridAt : public MobilityAt {
public:
    explicit RotnePragerYamakawaGridAt(const RotnePragerYamakawaGrid& model)
        : MobilityAt(model), model(model) {}
    void multiply(const MatrixXd& forces, MatrixXd& velocities, const Accuracy& accuracy) override {
        prepare();
        const ScopedTimer timer(secondsOfGrid);
        parts->multiply(forces, accuracy.allowsSinglePrecision(), velocities);
    }
    void addFlowAt(const FlowSources& sources, const std::vector<Vec3>& points, double factor,
                   Velocities& velocities) override {
        LatticeSum flow(particles, overSurfaces(), false, true);
        flow.setBox(next.box);
        flow.addFlowAt(next.positions, sources, points, factor / (8 * M_PI * viscosity),
                       velocities);
    }

protected:
    void moveTo(const Placement& placement, bool nearby) override {
        model.box()->check(placement.box);
        // A nearby placement is close to the previous placement, where the anchors must be.
        if (nearby) prepare();
        next = placement;
        nextIsNearby = nearby;
        isPrepared = false;
        if (!nearby) parts.reset();  // so that others may use them
    }

private:
    /**
     * Pairs and weights wait for the first product, because schemes also move to placements without
     * asking for a product there.
     */
    void prepare() {
        if (isPrepared) return;
        model.move(parts, next, nextIsNearby);
        isPrepared = true;
    }
    const RotnePragerYamakawaGrid& model;
    std::shared_ptr<SplitParts> parts;
    Placement next;
    bool nextIsNearby = false, isPrepared = true;
};

/**
 * A field of two independent flows. The flow of waves is drawn as a whole and known everywhere. The
 * flow of pairs is known at the particles only: it is the symmetric root of M_near, by Lanczos'
 * method, times random numbers that are the same at all placements.
 */
class Field : public RandomField {
public:
    explicit Field(const RotnePragerYamakawaGrid& model)
        : model(model), particles(model.getParticles()),
          lanczos(InnerErrors::ofDifferences * model.getTolerance(), Lanczos::defaultIterations,
                  model.getTolerance()),
          ownScale(model.rootsOfOwn()) {}
    void draw(const NoiseStream& noise, uint32_t purpose, const BoxVectors& newBox) {
        model.box()->check(newBox);
        // Groups of one Context have the same modes, but each group takes its own random numbers,
        // by its first particle.
        ofDraw = noise;
        ofDraw.field = 1 + particles.systemIndex[0];
        purposeOfDraw = purpose;
        drawWavesIn(newBox);
        W.resize(model.getNumRows(), 1);
        for (int i = 0; i < particles.size(); i++)
            for (int k = 0; k < (particles.hasTorque[i] ? 6 : 3); k += 2) {
                double* const to = &W(particles.firstRow[i] + k, 0);
                double unused;
                const bool last = !particles.hasTorque[i] && k == 2;
                noise.pair(purpose, particles.systemIndex[i], k / 2, to[0], last ? unused : to[1]);
            }
        for (int i = 0; i < particles.size() && haveStresslets(model.getKinds()); i++)
            for (int k = 0; k < 5; k += 2) {
                double* const to = &W(particles.numRows + 5 * i + k, 0);
                double unused;
                noise.pair(purpose, particles.systemIndex[i], 3 + k / 2, to[0],
                           k == 4 ? unused : to[1]);
            }
        isThere = false;
    }
    void slipsAt(const Placement& placement, bool nearby, MatrixXd& slips) override {
        // In a box that tilts during a step, the field uses the same numbers in the new box.
        const BoxVectors wanted = vectorsNearTo(box, placement.box);
        if (!isThere || nearby != wasNearby || placement.positions != at.positions ||
            wanted != box) {
            if (wanted != box) drawWavesIn(wanted);
            if (nearby && !parts && isThere) model.move(parts, at, false);
            at = placement;
            at.box = box;
            wasNearby = nearby;
            isThere = true;
            model.move(parts, at, nearby);
            applyRoot(SpectralFunction::squareRoot(), velocities);
            velocities = ownScale.cwiseInverse().asDiagonal() * velocities;
            parts->addAverages(fields, velocities);
            if (!nearby) parts.reset();
        }
        slips = velocities;
    }
    /**
     * Add the flow of waves, and the mean of the flow of pairs conditional on their slips. This
     * mean is the flow of the forces that cause these slips.
     */
    void addFlowAt(const std::vector<Vec3>& points, double factor, Velocities& flow) override {
        const EwaldSplitting& splitting = inBox->splitting;
        const GridFactors factors(splitting.shape, [&](double k, double) {
            return std::sqrt(hasimoto(k, splitting.xi)) / k;
        });
        GridFlow waves;
        waves.draw(splitting.shape, model.getViscosity(), CounterModeNoise(ofDraw, purposeOfDraw),
                   &factors);
        waves.addAt(points, factor, flow);
        MatrixXd forces;
        findForces(forces);
        addNearFlow(splitting, forces, points, factor / (8 * M_PI * model.getViscosity()), flow);
    }
    double amplitudeOf(const DrivenFlow& wave) override {
        const EwaldSplitting& splitting = inBox->splitting;
        const GridShape& shape = splitting.shape;
        const double H = hasimoto(wave.k, splitting.xi);
        double amplitude = 0;
        // The grid leaves out shorter waves.
        std::array<double, 3> k = {0, 0, 0};
        k[wave.waveAxis] = wave.k;
        if (shape.carries(k))
            amplitude =
                std::sqrt(H) * amplitudeOfMode(shape, model.getViscosity(),
                                               CounterModeNoise(ofDraw, purposeOfDraw), wave);
        MatrixXd forces;
        findForces(forces);
        double power = 0;
        for (int p = 0; p < particles.size(); p++) {
            const WaveFactors f = model.waveFactors(particles.radii[p], wave.k);
            const Vector3d x(at.positions[p][0], at.positions[p][1], at.positions[p][2]);
            const int row = particles.firstRow[p];
            power += forces.block<3, 1>(row, 0).dot(wave.velocityAt(x, f));
            if (particles.hasTorque[p])
                power += forces.block<3, 1>(row + 3, 0).dot(wave.angularVelocityAt(x, f));
            if (haveStresslets(model.getKinds()))
                power += forces.col(0)
                             .segment<5>(particles.numRows + 5 * p)
                             .dot(inStressletBasis(wave.strainRateAt(x, f)));
        }
        return amplitude +
               2 * (1 - H) / (model.getViscosity() * wave.k * wave.k * shape.volume()) * power;
    }
    long long getNumRandomNumbers() const override {
        return GridModeNoise::numbersOf(inBox->splitting.shape) + model.getNumRows();
    }

private:
    void drawWavesIn(const BoxVectors& newBox) {
        box = newBox;
        inBox = model.inBox(box);
        model.setBox(parts, inBox);
        parts->draw(ofDraw, purposeOfDraw, fields);
        parts.reset();  // so that products can reuse these parts
    }
    /**
     * Compute result = f(S) W, with S = ownScale M_near ownScale plus a small multiple of the
     * identity.
     */
    void applyRoot(const SpectralFunction& f, MatrixXd& result) {
        const double more =
            InnerErrors::ofOwnMobilities * model.getTolerance() / (6 * M_PI * model.getViscosity());
        lanczos.apply(
            [&](double, const MatrixXd& x, MatrixXd& y) {
                scaled = ownScale.asDiagonal() * x;
                parts->multiplyPairs(scaled, y);
                y = ownScale.asDiagonal() * y;
                y += more * x;
            },
            W, {f}, result);
    }
    /** Find the forces f with M_near f = slips of pairs, at the placement of the last slipsAt(). */
    void findForces(MatrixXd& forces) {
        const bool mine = parts != nullptr;
        if (!mine) model.move(parts, at, false);
        applyRoot(SpectralFunction::inverseSquareRoot(), forces);
        forces = ownScale.asDiagonal() * forces;
        if (!mine) parts.reset();
    }
    void addNearFlow(const EwaldSplitting& splitting, const MatrixXd& forces,
                     const std::vector<Vec3>& points, double factor, Velocities& flow) const;

    const RotnePragerYamakawaGrid& model;
    /** Held only while needed, and at nearby placements. */
    std::shared_ptr<SplitParts> parts;
    std::shared_ptr<const SplitBox> inBox;
    const HydrodynamicParticles& particles;
    Lanczos lanczos;
    VectorXd ownScale;
    std::vector<GridField> fields;
    BoxVectors box = {};
    Placement at;
    NoiseStream ofDraw;
    uint32_t purposeOfDraw = 0;
    MatrixXd W, velocities, scaled;
    bool isThere = false, wasNearby = false;
};

/** Add the flow of pairs, from all images within reach of each point. */
void Field::addNearFlow(const EwaldSplitting& splitting, const MatrixXd& forces,
                        const std::vector<Vec3>& points, double factor, Velocities& flow) const {
    const Lattice lattice(box);
    for (const EwaldKind& kind : model.getKinds()) {
        const NearPair pair(0, kind.radius, splitting.xi, kind.torques > 0, kind.stresslets);
        const double reach = splitting.gap + 2 * model.getKinds().back().radius;
        const std::vector<Vector3d> images = lattice.within(reach + lattice.getReach());
        for (int j = 0; j < particles.size(); j++) {
            if (particles.radii[j] != kind.radius) continue;
            const int row = particles.firstRow[j];
            const Vector3d force = forces.block<3, 1>(row, 0),
                           torque = particles.hasTorque[j]
                                        ? Vector3d(forces.block<3, 1>(row + 3, 0))
                                        : Vector3d(0, 0, 0);
            const double* stresslet =
                kind.stresslets ? &forces(particles.numRows + 5 * j, 0) : nullptr;
            for (size_t p = 0; p < points.size(); p++) {
                const Vector3d nearest = lattice.wrapped(points[p] - at.positions[j]);
                for (const Vector3d& image : images) {
                    const Vector3d r = nearest + image;
                    if (r.norm() < std::min(reach, pair.getReach()))
                        flow.col(p) +=
                            factor * velocityOf(pair.at(r.norm()), r, force, torque, stresslet);
                }
            }
        }
    }
}

}  // namespace

namespace {

MobilityTraits traitsOnGrid(bool stresslets) {
    MobilityTraits traits(stresslets ? "StokesianDynamics" : "RotnePragerYamakawa");
    traits.isAnchored = true;
    traits.isHomogeneous = traits.isDivergenceFree = true;
    traits.isMatrixFree = true;
    return traits;
}

}  // namespace

RotnePragerYamakawaGrid::RotnePragerYamakawaGrid(const HydrodynamicParticles& particles,
                                                 double viscosity, double tolerance, double spacing,
                                                 const std::shared_ptr<GridFluid>& fluid,
                                                 const WallMaker& walls, bool stresslets)
    : MobilityModel(particles, viscosity, traitsOnGrid(stresslets)), tolerance(tolerance),
      spacing(spacing), walls(walls), kinds(kindsOf(getParticles(), stresslets)), fluid(fluid) {
    if ((int)kinds.size() > mostRadii)
        throw OpenMM::OpenMMException(
            "MobilityForce: " + std::string(name()) + " on a grid has " + text(kinds.size()) +
            " different radii, each of which needs Fourier transforms of its own, but may have at "
            "most " +
            text(mostRadii) + "; use setSolver(Dense), or fewer different radii by addParticle()");
}

EwaldSplitting RotnePragerYamakawaGrid::splittingFor(const BoxVectors& box) const {
    const std::lock_guard<std::mutex> lock(mutex);
    return findSplitting(box);
}

const EwaldSplitting& RotnePragerYamakawaGrid::findSplitting(const BoxVectors& box,
                                                             bool withWalls) const {
    if (!lastSplitting || !GridLean::isShared(lastBox, box))
        lastSplitting =
            std::make_unique<EwaldSplitting>(kinds, tolerance, spacing, box, 0, walls.longest);
    if (withWalls && walls.make && !lastSplitting->shape.walls)
        lastSplitting->shape.walls = walls.make(*lastSplitting);
    lastSplitting->shape.skew = GridSkew(box);
    lastBox = box;
    return *lastSplitting;
}

std::shared_ptr<const SplitBox> RotnePragerYamakawaGrid::inBox(const BoxVectors& box) const {
    const std::lock_guard<std::mutex> lock(mutex);
    if (!lastInBox || lastInBox->box != box)
        lastInBox = std::make_unique<SplitBox>(kinds, findSplitting(box), box, lastInBox.get());
    return lastInBox;
}

void RotnePragerYamakawaGrid::setBox(std::shared_ptr<SplitParts>& parts,
                                     const std::shared_ptr<const SplitBox>& box) const {
    const std::lock_guard<std::mutex> lock(mutex);
    if (kept && kept->getBox() == box) {
        parts = kept;
        return;
    }
    takeUnshared(parts);
    parts->setBox(box);
}

/**
 * Make `parts` point to parts that no other caller holds: its own, or those kept here, or new ones.
 */
void RotnePragerYamakawaGrid::takeUnshared(std::shared_ptr<SplitParts>& parts) const {
    if (parts && parts.use_count() == (parts == kept ? 2 : 1)) return;
    if (kept && kept != parts && kept.use_count() == 1)
        parts = kept;
    else
        parts = std::make_unique<SplitParts>(particles, viscosity, kinds, *fluid);
}

void RotnePragerYamakawaGrid::move(std::shared_ptr<SplitParts>& parts, const Placement& placement,
                                   bool nearby) const {
    const std::shared_ptr<const SplitBox> box = inBox(placement.box);
    const std::lock_guard<std::mutex> lock(mutex);
    if (!nearby && kept && kept->isAt(box, placement.positions)) {
        parts = kept;
        return;
    }
    const std::shared_ptr<SplitParts> before = std::move(parts);
    // Anchors of parts that another caller has left here do not count.
    const bool keepsAnchors =
        nearby && before && before->getBox() == box && !before->getAnchor().empty();
    if (before && before.use_count() == (before == kept ? 2 : 1))
        parts = before;
    else
        takeUnshared(parts);
    parts->setBox(box);
    if (keepsAnchors && before != parts) parts->moveTo(before->getAnchor(), false);
    parts->moveTo(placement.positions, keepsAnchors);
    if (!nearby) kept = parts;
}

void RotnePragerYamakawaGrid::check(const BoxVectors& box) const {
    checkBoxOfGrid(name(), box, true);
    if (spacing > 0) checkSizeOfGrid(name(), box, spacing);
    // Walls need memory, so the check comes before them.
    EwaldSplitting splitting = [&] {
        const std::lock_guard<std::mutex> lock(mutex);
        return findSplitting(box, false);
    }();
    checkSizeOfGrid(name(), box,
                    std::min({splitting.shape.spacing(0), splitting.shape.spacing(1),
                              splitting.shape.spacing(2)}));
    int numChannels = 0, numParticles = 0;
    bool anyTorques = false;
    for (const EwaldKind& kind : kinds) {
        numChannels += kind.torques > 0 ? 2 : 1;
        numParticles += kind.particles;
        anyTorques = anyTorques || kind.torques > 0;
    }
    const double ofGrid = numChannels * GridFluid::memory(splitting.shape);
    const double ofPairs = numParticles * splitting.neighbours *
                           NearField::memoryOfPair(anyTorques, haveStresslets(kinds));
    const double bytes = ofGrid + ofPairs + walls.bytes,
                 held = fluid->memoryHeld() + (splitting.shape.walls ? walls.bytes : 0);
    if (ofPairs > ofGrid + walls.bytes)
        checkMemoryOfPairs(name(), splitting.neighbours, splitting.gap, bytes, held);
    else
        checkMemoryOfGrid(name(), splitting.shape, bytes, held,
                          walls.bytes > 0 ? " and for walls beside them" : "");
}

std::string RotnePragerYamakawaGrid::describe(const BoxVectors& box) const {
    const EwaldSplitting splitting = splittingFor(box);
    const GridShape& shape = splitting.shape;
    return "a grid of " + std::to_string(shape.size[0]) + " x " + std::to_string(shape.size[1]) +
           " x " + std::to_string(shape.size[2]) + " nodes, whose products have the tolerance " +
           text(tolerance, 3) + ", and a sum over pairs whose surfaces are up to " +
           text(splitting.gap, 3) +
           " nm apart (positively split Ewald sums, xi = " + text(splitting.xi, 3) + "/nm)";
}

WaveFactors RotnePragerYamakawaGrid::waveFactors(double radius, double k) const {
    return overSurfaces().waveFactors(radius, k);
}

void RotnePragerYamakawaGrid::checkWave(const BoxVectors& box, int axis, int periods) const {
    checkPeriodicWave(box, axis, periods);
}

void RotnePragerYamakawaGrid::draw(const NoiseStream& noise, uint32_t purpose,
                                   const BoxVectors& box,
                                   std::unique_ptr<RandomField>& field) const {
    if (!field) field = std::make_unique<Field>(*this);
    static_cast<Field&>(*field).draw(noise, purpose, box);
}

std::unique_ptr<MobilityAt> RotnePragerYamakawaGrid::makePlace() const {
    return std::make_unique<RotnePragerYamakawaGridAt>(*this);
}

}  // namespace RigidHIPlugin
