#ifndef RIGIDHI_NATIVE_STEPS_H_
#define RIGIDHI_NATIVE_STEPS_H_

#include <string>

namespace RigidHIPlugin {

/**
 * Steps that a platform takes by itself, where its particles are, without the bodies of the host.
 * During and after these steps the bodies of the host are out of date. Code that reads or changes
 * them must first call bringBack().
 */
class NativeSteps {
public:
    virtual ~NativeSteps() {}
    /**
     * Take steps, if the platform can take them for this scene.
     *
     * @return whether the steps were taken; otherwise the host's bodies are up to date
     * @throws OpenMMException if a step fails; bodies and particles are then as they were before
     *     this step
     */
    virtual bool take(int number) = 0;
    /** Bring the bodies of the host, and the arrays of particles, up to date. */
    virtual void bringBack() = 0;
    /**
     * Whether Forces act on the state at present, in the middle of a step. bringBack() is then
     * impossible. Barostats ask for all energies of a State, but use only the potential energy.
     */
    virtual bool isActedOn() const = 0;
    /** Why the host will take the next step; empty if it will not. */
    virtual std::string reasonForHost() const = 0;
    /** The work of the platform's steps since Context creation. */
    struct Counts {
        long long launches = 0;   // of kernels, without those of OpenMM
        long long transfers = 0;  // of states or lists, in either direction
        long long looks = 0;      // reads of a flag or of a few sums, for which the host waits
    };
    virtual Counts getCounts() const = 0;
    /** Where and how the platform takes steps, for describeEffects(). */
    virtual std::string describe() const = 0;
};

}  // namespace RigidHIPlugin

#endif
