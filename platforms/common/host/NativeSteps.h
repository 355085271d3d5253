#ifndef RIGIDHI_NATIVE_STEPS_H_
#define RIGIDHI_NATIVE_STEPS_H_

#include <string>

namespace RigidHIPlugin {

/**
 * Steps that a platform takes by itself, where its particles are, without the bodies of the host.
 * While these steps go on, and after them, the bodies of the host are out of date. Whoever reads or
 * changes them must call bringBack() first.
 */
class NativeSteps {
public:
    virtual ~NativeSteps() {}
    /**
     * Take steps, if this scene can take them there.
     *
     * @return whether they were taken; otherwise the host's bodies are up to date
     * @throws OpenMMException if a step fails; bodies and particles are then as before this step
     */
    virtual bool take(int number) = 0;
    /** Bring the bodies of the host, and the arrays of particles, up to date. */
    virtual void bringBack() = 0;
    /**
     * Whether Forces act on the state at present, in the middle of a step. Bodies cannot be brought
     * back then. Barostats ask for all energies of a State, and use the potential one.
     */
    virtual bool isActedOn() const = 0;
    /** Why the next step will be taken by the host; empty: it will not. */
    virtual std::string reasonForHost() const = 0;
    /** What its steps have cost so far, since the Context was created. */
    struct Counts {
        long long launches = 0;   // of kernels, without those of OpenMM
        long long transfers = 0;  // of states or lists, in either direction
        long long looks = 0;      // at a flag or a few sums, for which the host waits
    };
    virtual Counts getCounts() const = 0;
    /** Where and how steps are taken, for describeEffects(). */
    virtual std::string describe() const = 0;
};

}  // namespace RigidHIPlugin

#endif
