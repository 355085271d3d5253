#include "rigidbody/VirtualSitePosition.h"

#include <cxxabi.h>

#include <cstdlib>
#include <memory>
#include <typeinfo>

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

bool turnsWithItsParents(const VirtualSite& site) {
    return dynamic_cast<const TwoParticleAverageSite*>(&site) ||
           dynamic_cast<const ThreeParticleAverageSite*>(&site) ||
           dynamic_cast<const OutOfPlaneSite*>(&site) ||
           dynamic_cast<const LocalCoordinatesSite*>(&site);
}

string kindOf(const VirtualSite& site) {
    int status = 0;
    const unique_ptr<char, void (*)(void*)> whole(
        abi::__cxa_demangle(typeid(site).name(), nullptr, nullptr, &status), free);
    const string name = status == 0 ? whole.get() : typeid(site).name();
    const size_t colon = name.rfind("::");
    return colon == string::npos ? name : name.substr(colon + 2);
}

}  // namespace RigidHIPlugin
