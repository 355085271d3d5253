#ifndef RIGIDHI_FORCE_CHOICE_H_
#define RIGIDHI_FORCE_CHOICE_H_

#include <typeinfo>
#include <vector>

namespace OpenMM {
class Force;
class System;
}  // namespace OpenMM

namespace RigidHIPlugin {

/**
 * The forces of a Context that an evaluation includes: the integrator's groups and the group of
 * every Force.
 *
 * Users may change both between steps, and OpenMM does not report this. OpenMM's own integrators
 * see the change because they evaluate forces in every step.
 */
class ForceChoice {
public:
    /** @return whether the choice differs from that of the last call, or this call is the first */
    bool changed(const OpenMM::System& system, int integrationForceGroups);

private:
    /** Properties of the class of a Force, found once. */
    struct Kind {
        const std::type_info* type = nullptr;
        bool isNonbonded = false;
    };
    bool isNonbonded(int index, const OpenMM::Force& force);
    void note(int number);
    std::vector<Kind> kinds;  // of the System's Forces
    std::vector<int> last;
    int next = 0;
    bool differs = false;
};

}  // namespace RigidHIPlugin

#endif
