#ifndef RIGIDHI_SLIP_CHANNEL_H_
#define RIGIDHI_SLIP_CHANNEL_H_

#include <memory>
#include <string>

#include "mobility/MobilityModel.h"

namespace RigidHIPlugin {

/**
 * Two walls y = low and y = high with the fluid between them. The fluid slips along the walls
 * without friction.
 */
struct SlipWalls {
    double low, high;  // nm
    /** Whether surfaces of particles may reach through a wall. Otherwise they may only touch it. */
    bool crossingAllowed;
};

/**
 * A fluid between two slip walls, periodic along the walls, as a periodic fluid of twice the width
 * with the mirror images of all particles.
 *
 * Equation:  Let P be the reflection at the lower wall: (Fx, -Fy, Fz) at (x, -y, z) and (-Tx, Ty,
 *            -Tz). A flow with u(Pr) = P u(r) has no normal velocity and no shear at both walls.
 *            Forces F therefore act together with P F on the images: M = (1 P) M_2 (1 P)^T/2, with
 *            M_2 the periodic mobility of particles and images. A random field v_2 of covariance
 *            M_2 gives v = (v_2 + P v_2(P r))/sqrt(2) of covariance M (Westwood 2022, section 4.3).
 * Accuracy:  That of the periodic model. M is positive definite wherever centres are between the
 *            walls, so images need no damping. A mirrored grid (GridShape) represents only such
 *            flows and fields, with half of the nodes and modes.
 * Cost:      As a matrix, that of the periodic model with twice as many particles in a box of twice
 *            the width. On a grid, half of that: the cost of a periodic box of the channel's own
 *            width.
 * Limits:    The box must have edges along the axes, and a y edge longer than the channel is wide.
 */
class SlipChannel : public MobilityModel, BoxOfModel, GridOfModel, FieldOfModel {
public:
    /**
     * @param inPeriodicBox  the periodic model. If it is mirrored (MobilityTraits::isMirrored), its
     *     particles are the particles themselves, otherwise those of withImages(). A model with a
     *     random field must be mirrored.
     */
    SlipChannel(const HydrodynamicParticles& particles, double viscosity, const SlipWalls& walls,
                std::unique_ptr<MobilityModel> inPeriodicBox);
    /** The particles, followed by their images in the same order. */
    static HydrodynamicParticles withImages(const HydrodynamicParticles& particles);
    /**
     * The same placement in the box of twice the width, where y counts from the lower wall.
     *
     * @throws OpenMMException as BoxOfModel::check()
     */
    void toTwice(const Placement& placement, Placement& inBox) const;
    std::vector<OpenMM::Vec3> inTwice(const std::vector<OpenMM::Vec3>& points) const;
    /** Apply P to rows of particles: velocities and angular velocities, or forces and torques. */
    void reflectRows(Eigen::Ref<Eigen::MatrixXd> rows) const;
    const MobilityModel& inPeriodicBox() const { return *periodic; }

    std::string objection(const Placement& placement) const override;
    /**
     * The formulas hold beyond contact, too, as long as centres are between the walls. A particle
     * behind a wall would be an image.
     */
    bool acceptsNearby(const Placement& placement) const override;
    bool hasFastProducts(double error) const override { return periodic->hasFastProducts(error); }
    std::string describeFastProducts(double error) const override {
        return periodic->describeFastProducts(error);
    }
    WaveFactors waveFactors(double radius, double k) const override {
        return periodic->waveFactors(radius, k);
    }
    const BoxOfModel* box() const override { return this; }
    const GridOfModel* grid() const override { return periodic->grid() ? this : nullptr; }
    /** A mirrored field is one flow. */
    const FieldOfModel* randomField() const override {
        return periodic->getTraits().isMirrored && periodic->randomField() ? this : nullptr;
    }
    void ownMobility(const HydrodynamicParticles& body, const std::vector<OpenMM::Vec3>& sites,
                     Eigen::MatrixXd& mobility) const override {
        periodic->ownMobility(body, sites, mobility);
    }

protected:
    std::unique_ptr<MobilityAt> makePlace() const override;

private:
    void check(const BoxVectors& box) const override;
    double volume(const BoxVectors& box) const override {
        return 0.5 * periodic->box()->volume(twice(box));
    }
    void checkWave(const BoxVectors& box, int axis, int periods) const override {
        periodic->box()->checkWave(twice(box), axis, periods);
    }
    std::string describe(const BoxVectors& box) const override {
        return periodic->grid()->describe(twice(box));
    }
    GridSeconds getSeconds() const override { return periodic->grid()->getSeconds(); }
    bool isLocal() const override { return true; }
    void draw(const NoiseStream& noise, uint32_t purpose, const BoxVectors& box,
              std::unique_ptr<RandomField>& field) const override;
    BoxVectors twice(const BoxVectors& box) const;
    /** Whether particle i is at least this far from both walls. */
    bool isWithin(const Placement& placement, int i, double distance) const;

    const SlipWalls walls;
    const std::unique_ptr<MobilityModel> periodic;
};

}  // namespace RigidHIPlugin

#endif
