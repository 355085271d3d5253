#ifndef RIGIDHI_RECORDED_PRODUCTS_H_
#define RIGIDHI_RECORDED_PRODUCTS_H_

// A platform whose models record the errors that their products may have.

#include <openmm/reference/ReferencePlatform.h>

#include <memory>
#include <string>
#include <vector>

#include "mobility/MobilityModel.h"

namespace RigidHITest {

/** What a model says about its products, noise and drifts. */
struct Kind {
    enum Noise { Roots, LocalField, OtherField };
    enum Products { Direct, Iterate, IterateInParts };

    const char* name;
    bool hasSingle, hasFast, isDivergenceFree;
    bool hasFastSingle = false;
    Noise noise = Roots;
    Products products = Direct;
};

/**
 * The errors that products were allowed, each once, in the order in which they were first needed. d
 * stands before the error of a difference, s before the tolerance of iterations of a product.
 */
extern std::vector<std::string> productsAskedFor;

std::unique_ptr<RigidHIPlugin::MobilityModel> recordingModel(
    const Kind& kind, const RigidHIPlugin::HydrodynamicParticles& particles, double viscosity);

/** The Reference platform, where every fluid has a model of this kind. */
class RecordingPlatform : public OpenMM::ReferencePlatform {
public:
    explicit RecordingPlatform(const Kind& kind);
};

}  // namespace RigidHITest

#endif
