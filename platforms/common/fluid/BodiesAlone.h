#ifndef RIGIDHI_BODIES_ALONE_H_
#define RIGIDHI_BODIES_ALONE_H_

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "rigid/CoupledBodies.h"

namespace RigidHIPlugin {

/** The name of an element in messages, such as "body 3". */
std::string nameOf(const FluidElement& element);

/**
 * The mobility and the friction of each element of a group by itself, computed on first use.
 * Elements of one shape share the two matrices, in all groups that share `shapes`.
 */
class BodiesAlone {
public:
    using Shapes = std::map<std::vector<double>, std::shared_ptr<const CoupledBodies::Alone>>;
    BodiesAlone(const CoupledBodies& bodies, std::shared_ptr<Shapes> shapes)
        : bodies(bodies), shapes(shapes) {}
    const CoupledBodies::Alone& of(int element);
    /** The two matrices if of() has computed them, else null. Threads may call it together. */
    const CoupledBodies::Alone* find(int element) const {
        return element < (int)known.size() ? known[element].get() : nullptr;
    }

private:
    const CoupledBodies& bodies;
    const std::shared_ptr<Shapes> shapes;
    std::vector<std::shared_ptr<const CoupledBodies::Alone>> known;  // of elements
};

}  // namespace RigidHIPlugin

#endif
