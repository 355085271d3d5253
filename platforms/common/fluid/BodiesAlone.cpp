#include "fluid/BodiesAlone.h"

#include "linearalgebra/OneBlasThread.h"

using namespace std;

namespace RigidHIPlugin {

namespace {

/** The shape of an element as a key: equal keys have equal mobilities. */
vector<double> keyOf(const FluidElement& element) {
    vector<double> key = {double(element.isFree()), double(element.sites.size())};
    for (size_t i = 0; i < element.sites.size(); i++)
        key.insert(key.end(), {element.sites[i][0], element.sites[i][1], element.sites[i][2],
                               element.radii[i]});
    key.insert(key.end(), element.ownMobility.data(),
               element.ownMobility.data() + element.ownMobility.size());
    return key;
}

}  // namespace

string nameOf(const FluidElement& element) {
    return element.isFree() ? "particle " + to_string(element.particles[0])
                            : "body " + to_string(element.body);
}

const CoupledBodies::Alone& BodiesAlone::of(int e) {
    known.resize(bodies.getElements().size());
    if (known[e]) return *known[e];
    const OneBlasThread single;
    shared_ptr<const CoupledBodies::Alone>& shape = (*shapes)[keyOf(bodies.getElements()[e])];
    if (!shape) shape = make_shared<CoupledBodies::Alone>(bodies.alone(e));
    known[e] = shape;
    return *shape;
}

}  // namespace RigidHIPlugin
