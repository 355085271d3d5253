#ifndef RIGIDHI_PRODUCT_CHOICE_H_
#define RIGIDHI_PRODUCT_CHOICE_H_

#include <string>

namespace RigidHIPlugin {

/** Who makes products with mobilities of many particles. */
enum class ProductWish { Auto, Device, Host };

/**
 * What the environment variable RIGIDHI_PRODUCTS says: device, host, or auto as without it.
 *
 * @throws OpenMMException for any other value
 */
ProductWish productWish();

/**
 * Whether a sum over all pairs on a GPU takes less time than what the host does for products of
 * such an error: a sum over all pairs, or multipoles where it has them and they are faster.
 */
bool deviceIsFaster(int numParticles, bool hasWall, bool hasMultipoles, double error);

/** The fewest particles for which deviceIsFaster() can be true. */
int fewestForDevice(bool hasWall);

}  // namespace RigidHIPlugin

#endif
