#include "context/MidStepTemperatures.h"

#include <openmm/reference/SimTKOpenMMRealType.h>

#include "context/Effects.h"
#include "context/Scene.h"

using namespace std;

namespace RigidHIPlugin {

map<string, double> midStepTemperatures(const Scene& scene, const MidStepEnergies& energies) {
    const map<string, int> degrees = countDegreesOfFreedom(scene);
    double bodyMass = 0, freeMass = 0;
    for (int b = 0; b < scene.bodies.getNumBodies(); b++)
        if (!scene.bodies.isHeld(b)) bodyMass += scene.bodies.inertia(b).mass;
    for (int i = 0; i < scene.freeParticles->getNumParticles(); i++)
        if (!scene.freeParticles->isHeld(i)) freeMass += scene.freeParticles->mass(i);
    const double removed = degrees.at("removed"), mass = bodyMass + freeMass,
                 ofBodies = mass > 0 ? removed * bodyMass / mass : 0,
                 rotational = degrees.at("rotational1") + degrees.at("rotational2") +
                              degrees.at("rotational3");
    map<string, double> result;
    const auto add = [&](const string& name, double energy, double number) {
        // The shares of the removed degrees of freedom are rounded.
        const double rounding = 1e-9;
        if (number > rounding) result[name] = 2 * energy / (BOLTZ * number);
    };
    add("translational", energies.translational, degrees.at("translational") - ofBodies);
    add("rotational", energies.rotational, rotational);
    add("free", energies.free, degrees.at("free") - (removed - ofBodies));
    add("total", energies.translational + energies.rotational + energies.free, degrees.at("total"));
    return result;
}

}  // namespace RigidHIPlugin
