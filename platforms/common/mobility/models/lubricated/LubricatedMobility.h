#ifndef RIGIDHI_LUBRICATED_MOBILITY_H_
#define RIGIDHI_LUBRICATED_MOBILITY_H_

#include <memory>
#include <string>
#include <vector>

#include "mobility/MobilityDecorator.h"
#include "mobility/models/lubricated/Lubrication.h"

namespace RigidHIPlugin {

/**
 * Adds to another model the lubrication of spheres that are close to each other or to a wall.
 *
 * Equation:  N = (M^-1 + Delta)^-1, with M of the other model with its boundary, and Delta of
 *            Lubrication. N gives the velocities of particles relative to a driven flow:
 *            lubrication adds no joint resistance of near spheres to strain.
 * Accuracy:  Exact for one sphere at a wall and for two spheres in unbounded fluid. The page of the
 *            model has more.
 * Method:    Matrices: the friction of the other model plus Delta. Products: GMRES for (1 + M
 *            Delta) U = M F, with an incomplete Cholesky factor of the particles' own frictions and
 *            of Delta of near pairs as the preconditioner.
 * Cost:      With matrices, one factorisation more than the other model. With products, each takes
 *            about ten to forty products of the other model.
 * Limits:    Those of Lubrication.
 */
class LubricatedMobility : public MobilityDecorator {
public:
    LubricatedMobility(const HydrodynamicParticles& particles, double viscosity,
                       const Spreading& spreading, const LubricationScene& scene,
                       std::unique_ptr<MobilityModel> model);
    const Lubrication& getLubrication() const { return lubrication; }

    std::string objection(const Placement& placement) const override;
    std::string describeLubrication() const override { return lubrication.describe(); }

protected:
    std::unique_ptr<MobilityAt> makePlace() const override;

private:
    const Lubrication lubrication;
};

}  // namespace RigidHIPlugin

#endif
