#ifndef RIGIDHI_PRODUCT_CHOICE_H_
#define RIGIDHI_PRODUCT_CHOICE_H_

#include <string>

namespace RigidHIPlugin {

/** Whether device or host makes products with mobilities of many particles. */
enum class ProductWish { Auto, Device, Host };

/**
 * The value of the environment variable RIGIDHI_PRODUCTS: device, host, or auto, the default.
 *
 * @throws OpenMMException for any other value
 */
ProductWish productWish();

/**
 * Whether a GPU makes a product with this error by a sum over all pairs in less time than the host.
 * The host sums over all pairs, or uses multipoles if it has them and they are faster.
 */
bool deviceIsFaster(int numParticles, bool hasWall, bool hasMultipoles, double error);

/** The fewest particles for which deviceIsFaster() can be true. */
int fewestForDevice(bool hasWall);

}  // namespace RigidHIPlugin

#endif
