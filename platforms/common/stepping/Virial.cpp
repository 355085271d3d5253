#include "stepping/Virial.h"

#include <openmm/OpenMMException.h>

#include <vector>

#include "context/ContextArrays.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

namespace {

/** The strain for differences of energies, in double and in single precision. */
const double strainOfDoubles = 1e-5, strainOfFloats = 1e-3;

/** Positions and box of the Context, which strains change. */
class Strained {
public:
    Strained(ContextImpl& context, Scene& scene)
        : context(context), scene(scene), positions(scene.arrays->positions()), origins(positions) {
        scene.arrays->getBox(box);
        for (int b = 0; b < scene.bodies.getNumBodies(); b++)
            for (int p : scene.definitions.particles(b)) origins[p] = scene.bodies.getState(b).R;
    }
    Strained(const Strained&) = delete;

    double energy(int a, int b, double strain) const {
        vector<Vec3>& moved = scene.arrays->positions();
        for (size_t p = 0; p < moved.size(); p++) {
            moved[p] = positions[p];
            moved[p][a] += strain * origins[p][b];
        }
        Vec3 there[3] = {box[0], box[1], box[2]};
        for (Vec3& vector : there) vector[a] += strain * vector[b];
        scene.arrays->setBox(there);
        if (scene.stock.hasFreeVirtualSites) scene.arrays->computeVirtualSites();
        scene.arrays->mendPositionsForForces();
        return context.calcForcesAndEnergy(false, true,
                                           scene.integrator.getIntegrationForceGroups());
    }
    /**
     * The derivative of the energy by a central difference. If a cutoff does not let OpenMM take a
     * smaller box, a difference of the same order by larger boxes takes its place.
     */
    double slope(int a, int b, double strain) const {
        const double larger = energy(a, b, strain);
        try {
            return (larger - energy(a, b, -strain)) / (2 * strain);
        } catch (const OpenMMException&) {
            if (a != b) throw;
        }
        return (4 * larger - 3 * energy(a, b, 0) - energy(a, b, 2 * strain)) / (2 * strain);
    }
    void putBack() {
        scene.arrays->positions() = positions;
        scene.arrays->setBox(box);
    }

private:
    ContextImpl& context;
    Scene& scene;
    const vector<Vec3> positions;
    vector<Vec3> origins;
    Vec3 box[3];
};

}  // namespace

Eigen::Matrix3d virialOf(ContextImpl& context, Scene& scene) {
    Eigen::Matrix3d virial = Eigen::Matrix3d::Zero();
    const bool isDouble = context.getPlatform().getName() == "Reference";
    const double strain = isDouble ? strainOfDoubles : strainOfFloats;
    Strained strained(context, scene);
    try {
        for (int a = 0; a < 3; a++)
            for (int b = a; b < 3; b++) virial(a, b) = -strained.slope(a, b, strain);
    } catch (...) {
        strained.putBack();
        throw;
    }
    strained.putBack();
    return virial;
}

}  // namespace RigidHIPlugin
