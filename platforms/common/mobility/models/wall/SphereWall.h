#ifndef RIGIDHI_SPHERE_WALL_H_
#define RIGIDHI_SPHERE_WALL_H_

#include <array>
#include <memory>
#include <vector>

#include "mobility/MobilityDecorator.h"
#include "mobility/models/wall/NoSlipPlane.h"

namespace RigidHIPlugin {

/**
 * The mobility of one sphere above a no-slip wall, over 1/(6 pi eta a), with its radius a as the
 * unit of length: it gives V and a W from F and T/a. It couples a force along x with rotation about
 * y, and a force along y with rotation about -x.
 */
struct SphereWallMobility {
    double along, across;          // V along the wall and normal to it
    double turnAlong, turnNormal;  // a W about an axis along the wall and about the normal
    double rolling;                // a W_y from F_x, and V_x from T_y/a

    /** @param u  radius over height of the centre, in (0, 1] */
    static SphereWallMobility rotnePragerYamakawa(double u);
    /**
     * The mobility of a rigid sphere, from fits of the exact resistances; along the wall the
     * inverse of a 2 x 2 block. Errors are at most 3e-8 of the mobilities in free fluid at any gap.
     * Towards the wall the error is at most 1e-9 of the mobility itself.
     *
     * Reference: along the wall Dean, O'Neill, Mathematika 10, 13 (1963) and O'Neill, ibid. 11, 67
     * (1964); towards it Brenner, Chem. Eng. Sci. 16, 242 (1961); about the normal Jeffery, Proc.
     * Lond. Math. Soc. 14, 327 (1915). Delong et al., J. Chem. Phys. 143, 144107 (2015), eqs. 94 to
     * 97, approximate these resistances.
     *
     * @param gap  between surfaces, in radii, above 0
     */
    static SphereWallMobility bestKnown(double gap);
};

/**
 * Gives the spheres and free particles of another model above a wall the best known single-sphere
 * mobility: M -> B M B^T, B_i = N_i^(1/2) M_ii^(-1/2). N_i is the best known mobility and M_ii that
 * of Rotne-Prager-Yamakawa, both at the height of i, in units of the radius of i.
 *
 * Above a wall without images along it, the result is exact for one sphere. It is always symmetric
 * and positive definite. B scales interactions from both sides. Blobs of multiblobs stay unchanged.
 *
 * Reference: as SphereWallMobility. Limits: gaps larger than rounding errors. Cost: that of the
 * other model, plus a part linear in the number of particles, or quadratic for the dense matrix.
 */
class SphereWallCongruence : public MobilityDecorator {
public:
    /** @param boundary  the name of the boundary in messages */
    SphereWallCongruence(const HydrodynamicParticles& particles, double viscosity,
                         const NoSlipPlane& wall, const char* boundary,
                         std::unique_ptr<MobilityModel> model);
    std::string objection(const Placement& placement) const override;

protected:
    std::unique_ptr<MobilityAt> makePlace() const override;

private:
    const NoSlipPlane wall;
    const char* const boundary;
};

}  // namespace RigidHIPlugin

#endif
