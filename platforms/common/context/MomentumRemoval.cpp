#include "context/MomentumRemoval.h"

#include <algorithm>
#include <cmath>

#include "context/ContextMirror.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

bool massesAreTheSystems(const Scene& scene) {
    for (const auto& block : scene.bodies.blocks)
        if (!block.massesMakeTheBodies) return false;
    return true;
}

bool MomentumRemoval::isDue() const {
    for (int frequency : scene.stock.removalFrequencies)
        if (scene.arrays->getStepCount() % frequency == 0) return true;
    return false;
}

bool MomentumRemoval::isToBeUndone() const {
    if (scene.stock.removalFrequencies.empty()) return false;
    return !scene.arrays->removesMomentumExactly() || (isDue() && !massesAreTheSystems(scene));
}

void MomentumRemoval::begin() { before = scene.arrays->velocities(); }

void MomentumRemoval::undo() {
    scene.arrays->pullVelocities();
    vector<Vec3>& velocities = scene.arrays->velocities();
    // Rounding of a few operations, relative to velocities. Device platforms sum momenta in single
    // precision.
    const double rounding = scene.arrays->rounding().isExact() ? 1e-12 : 3e-5;
    Vec3 shift;
    double mass = 0, largest = 0;
    for (size_t p = 0; p < before.size(); p++) {
        const Vec3& v = before[p];
        const double m = scene.system.getParticleMass(p);
        shift += v * m;
        mass += m;
        largest = max(largest, abs(v[0]) + abs(v[1]) + abs(v[2]));
    }
    if (mass > 0) shift /= mass;
    for (size_t p = 0; p < before.size(); p++) {
        const Vec3 change = velocities[p] - before[p],
                   unexplained = scene.system.getParticleMass(p) > 0 ? change + shift : change;
        // Another Force has changed velocities too. Nothing distinguishes its part from the
        // remover's, so keep both.
        if (!(unexplained.dot(unexplained) <= rounding * rounding * largest * largest)) return;
    }
    velocities = before;
    scene.arrays->pushVelocities();
}

void MomentumRemoval::remove() {
    BodySet& bodies = scene.bodies;
    const FreeParticles& free = *scene.freeParticles;
    vector<Vec3>& velocities = scene.arrays->velocities();
    Vec3 momentum;
    double mass = 0;
    for (int b = 0; b < bodies.getNumBodies(); b++) {
        const int s = bodies.slot(b);
        momentum += Vec3(bodies.p[0][s], bodies.p[1][s], bodies.p[2][s]);
        mass += bodies.inertia(b).mass;
    }
    for (int i = 0; i < free.getNumParticles(); i++) {
        momentum += velocities[free.getParticles()[i]] * free.mass(i);
        mass += free.mass(i);
    }
    if (mass == 0) return;
    const Vec3 shift = momentum / mass;
    for (int b = 0; b < bodies.getNumBodies(); b++)
        for (int k = 0; k < 3; k++)
            bodies.p[k][bodies.slot(b)] -= shift[k] * bodies.inertia(b).mass;
    for (int p : free.getParticles()) velocities[p] -= shift;
    mirror.writeTwists();
    mirror.rememberFreeVelocities();
}

}  // namespace RigidHIPlugin
