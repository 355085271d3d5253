#include "context/DrawnVelocities.h"

#include <openmm/reference/SimTKOpenMMRealType.h>

#include <cmath>
#include <cstring>

#include "context/Messages.h"
#include "context/Scene.h"
#include "context/StateHash.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

vector<Vec3> DrawnVelocities::draw(Scene& scene, double temperature, int seed) {
    BodySet& bodies = scene.bodies;
    velocities = scene.arrays->velocities();
    twists.clear();
    if (!traitsOf(scene.integrator.getScheme()).hasMomenta) return velocities;
    NoiseStream noise;
    noise.seed = seed;
    const double kT = BOLTZ * temperature;
    for (int b = 0; b < bodies.getNumBodies(); b++) {
        if (bodies.isHeld(b)) {
            twists.push_back(bodies.getState(b));
            for (int p : scene.definitions.particles(b)) velocities[p] = Vec3();
            continue;
        }
        double z[6];
        for (int k = 0; k < 3; k++)
            noise.pair(NoiseStream::Velocities, b, k, z[2 * k], z[2 * k + 1]);
        const BodyState old = bodies.getState(b);
        const BodyInertia& inertia = bodies.inertia(b);
        const array<double, 13> before = bodies.getStoredState(b);
        array<double, 13> stored = before;
        for (int k = 0; k < 3; k++) {
            stored[7 + k] = sqrt(inertia.mass * kT) * z[k];
            stored[10 + k] = sqrt(inertia.moments[k] * kT) * z[3 + k];
        }
        bodies.setStoredState(b, stored);
        twists.push_back(bodies.getState(b));
        const Vec3 velocity = twists[b].p / inertia.mass,
                   omega_lab = bodies.getAngularVelocity_lab(b);
        for (int p : scene.definitions.particles(b))
            velocities[p] = velocity + omega_lab.cross(scene.arrays->positions()[p] - old.R);
        bodies.setStoredState(b, before);
    }
    for (int i = 0; i < scene.freeParticles->getNumParticles(); i++) {
        double z[4];
        const int p = scene.freeParticles->getParticles()[i];
        if (scene.freeParticles->isHeld(i)) {
            velocities[p] = Vec3();
            continue;
        }
        noise.pair(NoiseStream::Velocities, p, 8, z[0], z[1]);
        noise.pair(NoiseStream::Velocities, p, 9, z[2], z[3]);
        velocities[p] = Vec3(z[0], z[1], z[2]) * sqrt(kT / scene.freeParticles->mass(i));
    }
    return velocities;
}

bool DrawnVelocities::takeIn(Scene& scene) {
    vector<Vec3>& read = scene.arrays->velocities();
    const double rounding = scene.arrays->rounding().velocities;
    bool areThose = !twists.empty() && read.size() == velocities.size();
    for (size_t p = 0; areThose && p < read.size(); p++)
        areThose = memcmp(&read[p], &velocities[p], sizeof(Vec3)) == 0 ||
                   isRounded(read[p], velocities[p], rounding);
    if (areThose) read = velocities;
    BodySet& bodies = scene.bodies;
    for (int b = 0; areThose && b < bodies.getNumBodies(); b++) {
        BodyState state = bodies.getState(b);
        state.p = twists[b].p;
        state.l = twists[b].l;
        bodies.setState(b, state);
    }
    twists.clear();
    velocities.clear();
    return areThose;
}

}  // namespace RigidHIPlugin
