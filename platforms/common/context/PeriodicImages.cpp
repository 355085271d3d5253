#include "context/PeriodicImages.h"

#include <OpenMM.h>

#include <algorithm>
#include <cmath>

#include "context/ActingForces.h"
#include "openmmrigidhi/ModelTraits.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

namespace {

/**
 * Finds forces within molecules. OpenMM derives molecules from bonds, but not from angles and
 * torsions.
 */
class WithinMolecules {
public:
    explicit WithinMolecules(const vector<vector<int>>& molecules, int numParticles)
        : moleculeOf(numParticles) {
        for (size_t m = 0; m < molecules.size(); m++)
            for (int p : molecules[m]) moleculeOf[p] = m;
    }
    bool hold(const Force& force) const {
        if (dynamic_cast<const HarmonicBondForce*>(&force) ||
            dynamic_cast<const CustomBondForce*>(&force))
            return true;
        int p[4];
        double unused[6];
        if (auto* angles = dynamic_cast<const HarmonicAngleForce*>(&force)) {
            for (int i = 0; i < angles->getNumAngles(); i++) {
                angles->getAngleParameters(i, p[0], p[1], p[2], unused[0], unused[1]);
                if (!isOne({p[0], p[1], p[2]})) return false;
            }
            return true;
        }
        if (auto* torsions = dynamic_cast<const PeriodicTorsionForce*>(&force)) {
            for (int i = 0; i < torsions->getNumTorsions(); i++) {
                int periodicity;
                torsions->getTorsionParameters(i, p[0], p[1], p[2], p[3], periodicity, unused[0],
                                               unused[1]);
                if (!isOne({p[0], p[1], p[2], p[3]})) return false;
            }
            return true;
        }
        if (auto* torsions = dynamic_cast<const RBTorsionForce*>(&force)) {
            for (int i = 0; i < torsions->getNumTorsions(); i++) {
                torsions->getTorsionParameters(i, p[0], p[1], p[2], p[3], unused[0], unused[1],
                                               unused[2], unused[3], unused[4], unused[5]);
                if (!isOne({p[0], p[1], p[2], p[3]})) return false;
            }
            return true;
        }
        return false;
    }

private:
    bool isOne(initializer_list<int> particles) const {
        return all_of(particles.begin(), particles.end(),
                      [&](int p) { return moleculeOf[p] == moleculeOf[*particles.begin()]; });
    }
    vector<int> moleculeOf;
};

bool isPeriodic(const Force& force) {
    try {
        return force.usesPeriodicBoundaryConditions();
    } catch (const OpenMMException&) {
        return false;  // the Force does not say
    }
}

}  // namespace

int forceThatSeesImages(ContextImpl& context) {
    const System& system = context.getSystem();
    const WithinMolecules within(context.getMolecules(), system.getNumParticles());
    for (int i = 0; i < system.getNumForces(); i++) {
        const Force& force = system.getForce(i);
        if (!isPeriodic(force) && !feelsNoParticles(force) && !within.hold(force)) return i;
    }
    return -1;
}

PeriodicImages::PeriodicImages(ContextImpl& context) {
    const System& system = context.getSystem();
    if (forceThatSeesImages(context) >= 0) return;
    bool anyIsPeriodic = false;
    for (int i = 0; i < system.getNumForces(); i++) {
        const Force& force = system.getForce(i);
        if (auto* fluid = dynamic_cast<const MobilityForce*>(&force))
            wallAxis = traitsOf(fluid->getBoundary()).wallAxis;
        anyIsPeriodic = anyIsPeriodic || isPeriodic(force);
    }
    if (anyIsPeriodic) molecules = context.getMolecules();
}

bool PeriodicImages::find(const vector<Vec3>& positions, const Vec3 (&box)[3],
                          vector<Vec3>& images) const {
    const double far = 2;  // boxes: nearer molecules have about the rounding of those in the box
    bool any = false;
    for (const vector<int>& molecule : molecules) {
        Vec3 centre;
        for (int p : molecule) centre += positions[p];
        centre /= molecule.size();
        Vec3 shift;
        double farthest = 0;
        for (int k = 2; k >= 0; k--) {
            if (k == wallAxis) continue;
            const double boxes = floor((centre[k] + shift[k]) / box[k][k]);
            shift -= box[k] * boxes;
            farthest = max(farthest, abs(boxes + 0.5));
        }
        if (!(farthest > far)) continue;
        if (!any) images = positions;
        any = true;
        for (int p : molecule) images[p] = positions[p] + shift;
    }
    return any;
}

}  // namespace RigidHIPlugin
