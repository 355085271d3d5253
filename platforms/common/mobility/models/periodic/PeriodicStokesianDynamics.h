#ifndef RIGIDHI_PERIODIC_STOKESIAN_DYNAMICS_H_
#define RIGIDHI_PERIODIC_STOKESIAN_DYNAMICS_H_

#include <memory>
#include <string>

#include "mobility/models/stokesian/StokesianDynamics.h"

namespace RigidHIPlugin {

/**
 * Rigid spheres in a periodic box: forces, torques and stresslets by lattice sums, and exact pair
 * lubrication, also with images.
 *
 * Equation:  R = M_FTS^-1 + sum of w(r) (R_exact - R_FTS)(pair) over pairs, including images of
 *            other spheres and of the sphere itself, with w of LubricationReach, by default 8 and
 *            10 mean radii.
 * Accuracy:  M_FTS is accurate to 1e-13. The part that w cuts off is by default at most 7e-6 of
 *            6 pi eta a. A pair's term is positive semidefinite, so any w from 0 to 1 keeps R
 *            positive definite. R is a smooth function of positions and box.
 * Cost:      That of StokesianDynamics, and 20 us for each pair for the lattice sums.
 * Limits:    Those of StokesianDynamics. Spheres must not touch their own images.
 */
class PeriodicStokesianDynamics : public StokesianDynamics, BoxOfModel {
public:
    PeriodicStokesianDynamics(const HydrodynamicParticles& particles, double viscosity,
                              bool lubrication, double minimumGap,
                              const LubricationReach& reach = reachByDefault);
    static constexpr LubricationReach reachByDefault = {8, 10};
    std::string objection(const Placement& placement) const override;
    WaveFactors waveFactors(double radius, double k) const override;
    const BoxOfModel* box() const override { return this; }

protected:
    std::unique_ptr<MobilityAt> makePlace() const override;

private:
    double volume(const BoxVectors& box) const override;
    void checkWave(const BoxVectors& box, int axis, int periods) const override;
};

}  // namespace RigidHIPlugin

#endif
