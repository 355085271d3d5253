#include "mobility/models/wall/SlipChannel.h"

#include <openmm/OpenMMException.h>

#include <algorithm>
#include <cmath>

#include "mobility/CoincidenceCheck.h"
#include "mobility/models/wall/NoSlipPlane.h"
#include "openmmrigidhi/internal/Messages.h"

using Eigen::MatrixXd;
using OpenMM::Vec3;

namespace RigidHIPlugin {

namespace {

/** Compute `factor` times the sum of the upper half of the rows and the reflected lower half. */
void fold(const SlipChannel& model, MatrixXd& both, double factor, MatrixXd& result) {
    const int rows = model.getParticles().numRows;
    model.reflectRows(both.bottomRows(rows));
    result = factor * (both.topRows(rows) + both.bottomRows(rows));
}

/** The mobility at a placement, from a periodic fluid with the particles and their images. */
class PlaceOfImages : public MobilityAt {
public:
    explicit PlaceOfImages(const SlipChannel& model) : MobilityAt(model), model(model) {}
    void multiply(const MatrixXd& forces, MatrixXd& velocities, const Accuracy& accuracy) override {
        mirror(forces);
        periodic->multiply(bothForces, bothVelocities, accuracy);
        fold(model, bothVelocities, 0.5, velocities);
    }
    void dense(MatrixXd& mobility) override {
        periodic->dense(bothForces);
        fold(model, bothForces, 1, bothVelocities);
        bothForces = bothVelocities.transpose();
        fold(model, bothForces, 0.5, mobility);
    }
    void addFlowAt(const FlowSources& sources, const std::vector<Vec3>& points, double factor,
                   Velocities& velocities) override {
        mirror(sources.forces);
        periodic->addFlowAt({bothForces, {}}, model.inTwice(points), factor, velocities);
    }

protected:
    void moveTo(const Placement& placement, bool nearby) override {
        model.toTwice(placement, withImages);
        for (size_t i = 0, count = placement.positions.size(); i < count; i++) {
            const Vec3& x = withImages.positions[i];
            withImages.positions.push_back(Vec3(x[0], -x[1], x[2]));
        }
        if (nearby)
            model.inPeriodicBox().placeNear(periodic, withImages);
        else
            model.inPeriodicBox().place(periodic, withImages);
    }

private:
    void mirror(const MatrixXd& forces) {
        bothForces.resize(2 * forces.rows(), forces.cols());
        bothForces.topRows(forces.rows()) = forces;
        bothForces.bottomRows(forces.rows()) = forces;
        model.reflectRows(bothForces.bottomRows(forces.rows()));
    }

    const SlipChannel& model;
    Placement withImages;
    std::unique_ptr<MobilityAt> periodic;
    MatrixXd bothForces, bothVelocities;
};

/** The mobility at a placement, from a mirrored fluid, which includes the images. */
class PlaceInMirrored : public MobilityAt {
public:
    explicit PlaceInMirrored(const SlipChannel& model) : MobilityAt(model), model(model) {}
    void multiply(const MatrixXd& forces, MatrixXd& velocities, const Accuracy& accuracy) override {
        mirrored->multiply(forces, velocities, accuracy);
    }
    void addFlowAt(const FlowSources& sources, const std::vector<Vec3>& points, double factor,
                   Velocities& velocities) override {
        mirrored->addFlowAt(sources, model.inTwice(points), factor, velocities);
    }
    double getSecondsOfGrid() const override { return mirrored ? mirrored->getSecondsOfGrid() : 0; }

protected:
    void moveTo(const Placement& placement, bool nearby) override {
        model.toTwice(placement, inTwice);
        if (nearby)
            model.inPeriodicBox().placeNear(mirrored, inTwice);
        else
            model.inPeriodicBox().place(mirrored, inTwice);
    }

private:
    const SlipChannel& model;
    Placement inTwice;
    std::unique_ptr<MobilityAt> mirrored;
};

/** The field of a mirrored fluid. */
class Field : public RandomField {
public:
    explicit Field(const SlipChannel& model) : model(model) {}
    void draw(const NoiseStream& noise, uint32_t purpose, const BoxVectors& twice) {
        model.inPeriodicBox().randomField()->draw(noise, purpose, twice, mirrored);
    }
    void slipsAt(const Placement& placement, bool nearby, MatrixXd& slips) override {
        model.toTwice(placement, inTwice);
        mirrored->slipsAt(inTwice, nearby, slips);
    }
    bool hasGradients() const override { return mirrored->hasGradients(); }
    void gradientsAt(const Placement& placement, bool nearby, MatrixXd& gradients) override {
        model.toTwice(placement, inTwice);
        mirrored->gradientsAt(inTwice, nearby, gradients);
    }
    void addFlowAt(const std::vector<Vec3>& points, double factor,
                   Velocities& velocities) override {
        mirrored->addFlowAt(model.inTwice(points), factor, velocities);
    }
    double amplitudeOf(const DrivenFlow& wave) override { return mirrored->amplitudeOf(wave); }
    long long getNumRandomNumbers() const override { return mirrored->getNumRandomNumbers(); }

private:
    const SlipChannel& model;
    Placement inTwice;
    std::unique_ptr<RandomField> mirrored;
};

}  // namespace

namespace {

/** Traits of a fluid between walls at unknown heights, whose images double the matrix. */
MobilityTraits betweenWalls(MobilityTraits traits) {
    traits.mayObject = traits.holdsNearby = true;
    traits.isHomogeneous = traits.isIsotropic = traits.isDivergenceFree = false;
    traits.isMirrored = false;
    traits.isMadeFromFriction = traits.hasStresslets = false;
    return traits;
}

}  // namespace

SlipChannel::SlipChannel(const HydrodynamicParticles& particles, double viscosity,
                         const SlipWalls& walls, std::unique_ptr<MobilityModel> inPeriodicBox)
    : MobilityModel(particles, viscosity, betweenWalls(inPeriodicBox->getTraits())), walls(walls),
      periodic(std::move(inPeriodicBox)) {}

HydrodynamicParticles SlipChannel::withImages(const HydrodynamicParticles& particles) {
    HydrodynamicParticles both = particles;
    for (int i = 0; i < particles.size(); i++)
        both.add(particles.radii[i], particles.hasTorque[i], particles.systemIndex[i],
                 particles.body[i]);
    return both;
}

BoxVectors SlipChannel::twice(const BoxVectors& box) const {
    return {box[0], Vec3(0, 2 * (walls.high - walls.low), 0), box[2]};
}

void SlipChannel::toTwice(const Placement& placement, Placement& inBox) const {
    check(placement.box);
    inBox.box = twice(placement.box);
    inBox.positions = placement.positions;
    for (Vec3& x : inBox.positions) x[1] -= walls.low;
}

std::vector<Vec3> SlipChannel::inTwice(const std::vector<Vec3>& points) const {
    std::vector<Vec3> shifted = points;
    for (Vec3& x : shifted) x[1] -= walls.low;
    return shifted;
}

void SlipChannel::reflectRows(Eigen::Ref<MatrixXd> rows) const {
    for (int i = 0; i < particles.size(); i++) {
        const int row = particles.firstRow[i];
        rows.row(row + 1) *= -1;
        if (!particles.hasTorque[i]) continue;
        rows.row(row + 3) *= -1;
        rows.row(row + 5) *= -1;
    }
}

bool SlipChannel::isWithin(const Placement& placement, int i, double distance) const {
    const double y = placement.positions[i][1];
    return y - walls.low >= distance && walls.high - y >= distance;
}

std::string SlipChannel::objection(const Placement& placement) const {
    // A pose determines y of its particles only up to a few rounding errors. A centre on a wall
    // coincides with its image, and the matrix is then singular.
    for (int i = 0; i < particles.size(); i++) {
        const double y = placement.positions[i][1], radius = particles.radii[i],
                     rounding =
                         1e-12 * std::max({std::abs(y), std::abs(walls.low), std::abs(walls.high)});
        if (isWithin(placement, i,
                     walls.crossingAllowed ? CoincidenceCheck::bound * radius : radius - rounding))
            continue;
        const std::string where =
            "SlipChannel: " + particleAndBody(particles, i) + " has its centre at y = " + text(y) +
            " nm, with walls at y = " + text(walls.low) + " and " + text(walls.high) + " nm";
        if (walls.crossingAllowed)
            return where + ", where a particle (this one of radius " + text(radius) +
                   " nm) has no mobility; move it between the walls, or use smaller time steps";
        return where + ", nearer to a wall than its radius, " + text(radius) +
               " nm; move it away from the wall, use smaller time steps, or allow the overlap by "
               "setWallRejection(Crossing)";
    }
    return {};
}

bool SlipChannel::acceptsNearby(const Placement& placement) const {
    for (int i = 0; i < particles.size(); i++)
        if (!isWithin(placement, i, CoincidenceCheck::bound * particles.radii[i])) return false;
    return true;
}

void SlipChannel::check(const BoxVectors& box) const {
    const auto fail = [](const std::string& problem) {
        throw OpenMM::OpenMMException("MobilityForce: SlipChannel needs a periodic box " + problem);
    };
    if (box[1][0] != 0 || box[2][0] != 0 || box[2][1] != 0)
        fail("with edges along the axes, but the box has the vectors " + text(box[0]) + ", " +
             text(box[1]) + ", " + text(box[2]) +
             " nm; set another box by setPeriodicBoxVectors() on the Context");
    if (!(box[1][1] > walls.high - walls.low))
        fail("whose y edge is longer than the channel is wide, but it has " + text(box[1][1]) +
             " nm, and the walls are at " + text(walls.low) + " and " + text(walls.high) +
             " nm; bring the walls nearer to each other by setChannelWalls(), or make the box "
             "larger");
    periodic->box()->check(twice(box));
}

void SlipChannel::draw(const NoiseStream& noise, uint32_t purpose, const BoxVectors& box,
                       std::unique_ptr<RandomField>& field) const {
    check(box);
    if (!field) field = std::make_unique<Field>(*this);
    static_cast<Field&>(*field).draw(noise, purpose, twice(box));
}

std::unique_ptr<MobilityAt> SlipChannel::makePlace() const {
    if (periodic->getTraits().isMirrored) return std::make_unique<PlaceInMirrored>(*this);
    return std::make_unique<PlaceOfImages>(*this);
}

}  // namespace RigidHIPlugin
