#ifndef RIGIDHI_PERIODIC_MOBILITY_H_
#define RIGIDHI_PERIODIC_MOBILITY_H_

#include <memory>
#include <string>

#include "mobility/models/periodic/LatticeSum.h"

namespace RigidHIPlugin {

/**
 * The common part of models of periodic fluids with lattice sums. Particles feel all images of all
 * particles, including their own. These models have no products without the matrix, so the number
 * of rows is limited.
 *
 * Shifts of all particles, and shifts of single particles by lattice vectors, leave the mobility
 * unchanged, but rotations do not. The mean velocity of fluid and bodies is zero: a uniform force
 * density balances the sum of the forces.
 */
class PeriodicMobility : public MobilityModel, BoxOfModel {
public:
    /** @throws OpenMMException for more rows than `largestRows` */
    PeriodicMobility(const HydrodynamicParticles& particles, double viscosity, const char* name,
                     int largestRows);
    virtual const Spreading& spreading() const = 0;
    WaveFactors waveFactors(double radius, double k) const override {
        return spreading().waveFactors(radius, k);
    }
    const BoxOfModel* box() const override { return this; }
    /**
     * The reason why the particles have no mobility in this box: images of two particles of one
     * radius coincide. Empty where they have a mobility.
     */
    std::string coincidence(const Placement& placement, const Lattice& lattice) const;

private:
    double volume(const BoxVectors& box) const override { return Lattice(box).getVolume(); }
    void checkWave(const BoxVectors& box, int axis, int periods) const override;
};

/**
 * @throws OpenMMException if a wave of so many periods along an axis is not periodic in the box, as
 *     in some triclinic boxes
 */
void checkPeriodicWave(const BoxVectors& box, int axis, int periods);
/** @throws OpenMMException for more rows than a dense matrix may have */
void checkPeriodicRows(int rows, int largestRows);

/** A model that is just a lattice sum, at a placement. */
class LatticeSumAt : public MobilityAt {
public:
    explicit LatticeSumAt(const PeriodicMobility& model);
    void multiply(const Eigen::MatrixXd& forces, Eigen::MatrixXd& velocities,
                  const Accuracy&) override;
    void dense(Eigen::MatrixXd& mobility) override;
    void addFlowAt(const FlowSources& sources, const std::vector<OpenMM::Vec3>& points,
                   double factor, Velocities& velocities) override;

protected:
    void moveTo(const Placement& placement, bool nearby) override;

private:
    const Eigen::MatrixXd& matrix();
    const PeriodicMobility& model;
    LatticeSum sum;
    BoxVectors box = {};
    std::vector<OpenMM::Vec3> positions;
    Eigen::MatrixXd cached;
    bool isKnown = false;
};

/**
 * Rotne-Prager-Yamakawa mobility in a periodic box, with all blocks, unequal radii, overlap and any
 * lattice.
 *
 * Equation:  LatticeSum.h with s(k) = sin(ka)/(ka) and t(k) = 3 j_1(ka)/(ka). Forces are spread
 *            evenly over the surfaces of spheres, and velocities are averaged over them.
 * Limits:    The mobility is pairwise and has no lubrication near contact.
 */
class PeriodicRotnePragerYamakawa : public PeriodicMobility {
public:
    PeriodicRotnePragerYamakawa(const HydrodynamicParticles& particles, double viscosity);
    const Spreading& spreading() const override;

protected:
    std::unique_ptr<MobilityAt> makePlace() const override;
};

/**
 * Force coupling in a periodic box: as Rotne-Prager-Yamakawa, with Gaussians instead of surfaces.
 *
 * Equation:  LatticeSum.h with s(k) = exp(-sigma^2 k^2/2), sigma = a/sqrt(pi), and t(k) =
 *            exp(-sigma_D^2 k^2/2), sigma_D = a/(6 sqrt(pi))^(1/3). A single sphere has its Stokes
 *            drag in translation and rotation.
 * Reference: Maxey and Patel, Int. J. Multiphase Flow 27:1603 (2001); Lomholt and Maxey, J. Comput.
 *            Phys. 184:381 (2003).
 * Limits:    The mobility is pairwise and has no lubrication near contact.
 */
class PeriodicForceCoupling : public PeriodicMobility {
public:
    PeriodicForceCoupling(const HydrodynamicParticles& particles, double viscosity);
    const Spreading& spreading() const override;
    /** The matrix in unbounded fluid, also with Gaussians. */
    void ownMobility(const HydrodynamicParticles& body, const std::vector<OpenMM::Vec3>& sites,
                     Eigen::MatrixXd& mobility) const override;

protected:
    std::unique_ptr<MobilityAt> makePlace() const override;
};

/** The matrix of force coupling for particles alone in unbounded fluid. */
void freeForceCoupling(const HydrodynamicParticles& body, const std::vector<OpenMM::Vec3>& sites,
                       double viscosity, Eigen::MatrixXd& mobility);

/**
 * The spreadings of these models. PeriodicStokesianDynamics uses overSurfaces(), with stresslets.
 */
const Spreading& overSurfaces();
const Spreading& overGaussians();

}  // namespace RigidHIPlugin

#endif
