#ifndef RIGIDHI_VIRTUAL_SITE_POSITION_H_
#define RIGIDHI_VIRTUAL_SITE_POSITION_H_

#include <openmm/System.h>
#include <openmm/VirtualSite.h>

#include <cmath>
#include <string>
#include <vector>

namespace RigidHIPlugin {

/**
 * Whether a virtual site moves and turns rigidly with the particles that define it. The kinds of
 * OpenMM 7.7 do.
 */
bool turnsWithItsParents(const OpenMM::VirtualSite& site);

/** The class name of a virtual site, as users know it. */
std::string kindOf(const OpenMM::VirtualSite& site);

template <class PositionOf>
OpenMM::Vec3 virtualSitePosition(const OpenMM::System& system, int particle, PositionOf position) {
    using namespace OpenMM;
    const VirtualSite& site = system.getVirtualSite(particle);
    // From OpenMM 8.2 on, a virtual site may depend on other virtual sites, but not in circles.
    auto parent = [&](int i) {
        const int p = site.getParticle(i);
        return system.isVirtualSite(p) ? virtualSitePosition(system, p, position)
                                       : Vec3(position(p));
    };
    if (auto* two = dynamic_cast<const TwoParticleAverageSite*>(&site))
        return parent(0) * two->getWeight(0) + parent(1) * two->getWeight(1);
    if (auto* three = dynamic_cast<const ThreeParticleAverageSite*>(&site))
        return parent(0) * three->getWeight(0) + parent(1) * three->getWeight(1) +
               parent(2) * three->getWeight(2);
    if (auto* out = dynamic_cast<const OutOfPlaneSite*>(&site)) {
        const Vec3 v12 = parent(1) - parent(0), v13 = parent(2) - parent(0);
        return parent(0) + v12 * out->getWeight12() + v13 * out->getWeight13() +
               v12.cross(v13) * out->getWeightCross();
    }
    const auto& local = dynamic_cast<const LocalCoordinatesSite&>(site);
    std::vector<double> originWeights, xWeights, yWeights;
    local.getOriginWeights(originWeights);
    local.getXWeights(xWeights);
    local.getYWeights(yWeights);
    Vec3 origin, x, y;
    for (int i = 0; i < site.getNumParticles(); i++) {
        origin += parent(i) * originWeights[i];
        x += parent(i) * xWeights[i];
        y += parent(i) * yWeights[i];
    }
    Vec3 z = x.cross(y);
    // Parents on a line (collinear lone pairs of CHARMM) leave axes zero, as in OpenMM.
    const double xLength = std::sqrt(x.dot(x)), zLength = std::sqrt(z.dot(z));
    if (xLength > 0) x /= xLength;
    if (zLength > 0) z /= zLength;
    y = z.cross(x);
    const Vec3 place = local.getLocalPosition();
    return origin + x * place[0] + y * place[1] + z * place[2];
}

}  // namespace RigidHIPlugin

#endif
