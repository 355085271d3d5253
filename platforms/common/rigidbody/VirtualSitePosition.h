#ifndef RIGIDHI_VIRTUAL_SITE_POSITION_H_
#define RIGIDHI_VIRTUAL_SITE_POSITION_H_

#include <openmm/OpenMMException.h>
#include <openmm/System.h>
#include <openmm/VirtualSite.h>

#include <cmath>
#include <string>

namespace RigidHIPlugin {

template <class PositionOf>
OpenMM::Vec3 virtualSitePosition(const OpenMM::System& system, int particle, PositionOf position) {
    using namespace OpenMM;
    const VirtualSite& site = system.getVirtualSite(particle);
    auto parent = [&](int i) { return Vec3(position(site.getParticle(i))); };
    if (auto* two = dynamic_cast<const TwoParticleAverageSite*>(&site))
        return parent(0) * two->getWeight(0) + parent(1) * two->getWeight(1);
    if (auto* three = dynamic_cast<const ThreeParticleAverageSite*>(&site))
        return parent(0) * three->getWeight(0) + parent(1) * three->getWeight(1) + parent(2) * three->getWeight(2);
    if (auto* out = dynamic_cast<const OutOfPlaneSite*>(&site)) {
        const Vec3 v12 = parent(1) - parent(0), v13 = parent(2) - parent(0);
        return parent(0) + v12 * out->getWeight12() + v13 * out->getWeight13() + v12.cross(v13) * out->getWeightCross();
    }
    if (auto* local = dynamic_cast<const LocalCoordinatesSite*>(&site)) {
        std::vector<double> originWeights, xWeights, yWeights;
        local->getOriginWeights(originWeights);
        local->getXWeights(xWeights);
        local->getYWeights(yWeights);
        Vec3 origin, x, y;
        for (int i = 0; i < site.getNumParticles(); i++) {
            origin += parent(i) * originWeights[i];
            x += parent(i) * xWeights[i];
            y += parent(i) * yWeights[i];
        }
        Vec3 z = x.cross(y);
        x /= std::sqrt(x.dot(x));
        z /= std::sqrt(z.dot(z));
        y = z.cross(x);
        const Vec3 place = local->getLocalPosition();
        return origin + x * place[0] + y * place[1] + z * place[2];
    }
    throw OpenMMException("CustomRigidHIIntegrator: particle " + std::to_string(particle) +
                          ": its kind of virtual site is not known; two- and three-particle averages, out-of-plane and "
                          "local-coordinates sites are supported");
}

}  // namespace RigidHIPlugin

#endif
