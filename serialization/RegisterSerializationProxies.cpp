#include <openmm/serialization/SerializationProxy.h>

#include <typeinfo>

#include "CustomBodyForceProxy.h"
#include "CustomBodyMotionProxy.h"
#include "CustomRigidHIIntegratorProxy.h"
#include "MobilityForceProxy.h"
#include "openmmrigidhi/CustomBodyForce.h"
#include "openmmrigidhi/CustomBodyMotion.h"
#include "openmmrigidhi/CustomRigidHIIntegrator.h"
#include "openmmrigidhi/MobilityForce.h"
#include "openmmrigidhi/internal/windowsExport.h"

using namespace RigidHIPlugin;

/**
 * Runs when the library is loaded. A second run is harmless: the proxies live as long as the
 * process, and OpenMM keeps the one registered last, which does the same work.
 */
extern "C" OPENMM_EXPORT_RIGIDHI void __attribute__((constructor))
registerRigidHISerializationProxies() {
    static const CustomRigidHIIntegratorProxy integratorProxy;
    OpenMM::SerializationProxy::registerProxy(typeid(CustomRigidHIIntegrator), &integratorProxy);
    static const MobilityForceProxy mobilityProxy;
    OpenMM::SerializationProxy::registerProxy(typeid(MobilityForce), &mobilityProxy);
    static const CustomBodyForceProxy bodyForceProxy;
    OpenMM::SerializationProxy::registerProxy(typeid(CustomBodyForce), &bodyForceProxy);
    static const CustomBodyMotionProxy bodyMotionProxy;
    OpenMM::SerializationProxy::registerProxy(typeid(CustomBodyMotion), &bodyMotionProxy);
}
