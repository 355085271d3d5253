#include "mobility/CoincidenceCheck.h"

#include <openmm/OpenMMException.h>

#include <algorithm>
#include <cmath>
#include <sstream>

#include "mobility/models/wall/NoSlipPlane.h"

using namespace std;

namespace RigidHIPlugin {

CoincidenceCheck::Pair CoincidenceCheck::find(const HydrodynamicParticles& particles,
                                              const vector<OpenMM::Vec3>& places,
                                              double inOneBody) {
    Pair found;
    const int n = particles.size();
    if (n < 2) return found;
    // Sort the particles along a line. Its direction is general, so that no two points of a lattice
    // have the same projection. Particles close to each other are then close in the order.
    const OpenMM::Vec3 direction(0.5773, 0.2111, 0.7888);
    order.clear();
    double largest = 0, radius = 0;
    for (int i = 0; i < n; i++) {
        order.emplace_back(direction.dot(places[i]), i);
        largest = max(largest, abs(order.back().first));
        radius = max(radius, particles.radii[i]);
    }
    sort(order.begin(), order.end());
    const double rounding = 1e-15, window = bound * radius + rounding * largest;
    for (int k = 0; k < n; k++)
        for (int l = k + 1; l < n && order[l].first - order[k].first <= window; l++) {
            const int i = min(order[k].second, order[l].second),
                      j = max(order[k].second, order[l].second);
            const double smaller = min(particles.radii[i], particles.radii[j]);
            const bool together = particles.body[i] >= 0 && particles.body[i] == particles.body[j];
            if (abs(particles.radii[i] - particles.radii[j]) > bound * smaller) continue;
            const OpenMM::Vec3 r = places[i] - places[j];
            const double distance = sqrt(r.dot(r));
            if (!(distance <= (together ? inOneBody : 1) * bound * smaller)) continue;
            if (found.first >= 0 && make_pair(i, j) > make_pair(found.first, found.second))
                continue;
            found = {i, j, distance};
        }
    return found;
}

void CoincidenceCheck::check(const HydrodynamicParticles& particles,
                             const vector<OpenMM::Vec3>& places, double inOneBody) {
    const Pair pair = find(particles, places, inOneBody);
    if (pair.first < 0) return;
    const bool together = particles.body[pair.first] >= 0 &&
                          particles.body[pair.first] == particles.body[pair.second];
    const double radius = min(particles.radii[pair.first], particles.radii[pair.second]);
    ostringstream text;
    text << "MobilityForce: " << particleAndBody(particles, pair.first) << " and "
         << particleAndBody(particles, pair.second) << ", both of radius " << radius
         << " nm, are at the same place: " << pair.distance << " nm apart, where " << bound * radius
         << " nm, 1e-6 of the radius, is the least at which "
         << "their mobility matrix is not singular; "
         << (together ? "give one of them the radius 0, another radius or another site"
                      : "move one of them, or give it the radius 0 or another radius");
    throw OpenMM::OpenMMException(text.str());
}

}  // namespace RigidHIPlugin
