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
 * Which forces of a Context an evaluation counts in: the integrator's groups and the group of every
 * Force.
 *
 * Both may be set between steps, and OpenMM tells nobody; its own integrators see it because they
 * evaluate forces in every step.
 */
class ForceChoice {
public:
    /** @return whether the choice is another one than at the last call, or this is the first */
    bool changed(const OpenMM::System& system, int integrationForceGroups);

private:
    /** What the class of a Force is, asked once. */
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
