#ifndef RIGIDHI_CONFINED_ROTNE_PRAGER_YAMAKAWA_H_
#define RIGIDHI_CONFINED_ROTNE_PRAGER_YAMAKAWA_H_

#include <memory>
#include <string>

#include "mobility/MobilityModel.h"
#include "mobility/models/confined/ConfiningPlanes.h"

namespace RigidHIPlugin {

/**
 * Rotne-Prager-Yamakawa mobility above a no-slip wall or between two walls, periodic along the
 * walls, with all blocks, unequal radii and overlap, by matrices.
 *
 * Equation:  The periodic lattice sum M_P with the period P along z, minus, for each wave vector
 *            along the walls, flows of low rank (PlaneModes.h):
 *              NoSlipChannel: P is the height H, so that both walls are one plane of the lattice.
 *                M = M_P - U S^-1 U^T, U the flow of forces on the plane, S that flow on the plane.
 *                This is the law of velocities given that the plane is at rest.
 *              PeriodicWall: M = M_P - (images of the period) - (images of the wall), with
 *                  (images of the wall) = (e e' + f f')/8k + (along t) e e'/2k,
 *                  e = exp(-kz), f = (1 + 2kz) exp(-kz), over eta A.
 *                The result does not depend on P.
 *            Waves k = 0 carry forces along the walls only: u = g F/A. Above a wall g =
 *            min(z, z')/eta. Between walls g = z (H - z')/(eta H), z < z', where the pressure
 *            gradient is 0. ZeroFlux subtracts 3 p p'/(eta H^3), p = z (H - z).
 * Accuracy:  1e-12 of own mobilities.
 * Limits:    The matrix is positive definite for a <= z <= H - a. Where the surface of a particle
 *            reaches through a wall, M -> B M B, as with NoSlipPlane. No lubrication.
 * Cost:      That of the lattice sum, and six columns of a symmetric product for each of about
 *            A k^2/8 pi wave vectors, k = 20/(least height above a wall). Particles far from the
 *            walls take part in few of them.
 * Reference: docs/theory/walls.md; Blake, Proc. Camb. Phil. Soc. 70, 303 (1971); Liron and Mochon,
 *            J. Eng. Math. 10, 287 (1976).
 */
class ConfinedRotnePragerYamakawa : public MobilityModel, BoxOfModel {
public:
    /** @throws OpenMMException for more rows than a matrix may have, or radii that do not fit */
    ConfinedRotnePragerYamakawa(const HydrodynamicParticles& particles, double viscosity,
                                const ConfiningPlanes& planes);
    const ConfiningPlanes& getPlanes() const { return planes; }
    std::string objection(const Placement& placement) const override {
        return planes.objection(particles, placement);
    }
    bool acceptsNearby(const Placement& placement) const override;
    OpenMM::Vec3 placeInFormulas(int i, const OpenMM::Vec3& position) const override {
        return planes.placeInFormulas(position, particles.radii[i]);
    }
    double weightInFormulas(int i, const OpenMM::Vec3& position) const override {
        return planes.allowsCrossing() ? planes.weight(position[2], particles.radii[i]) : 1;
    }
    WaveFactors waveFactors(double radius, double k) const override;
    const BoxOfModel* box() const override { return this; }
    void check(const BoxVectors& box) const override { planes.checkBox(box); }

protected:
    std::unique_ptr<MobilityAt> makePlace() const override;

private:
    double volume(const BoxVectors& box) const override;
    void checkWave(const BoxVectors& box, int axis, int periods) const override;

    const ConfiningPlanes planes;
};

}  // namespace RigidHIPlugin

#endif
