#ifndef RIGIDHI_CONTEXT_MIRROR_H_
#define RIGIDHI_CONTEXT_MIRROR_H_

#include <memory>
#include <vector>

#include "context/DrawnVelocities.h"
#include "context/RememberedArray.h"
#include "context/SavedState.h"
#include "context/Scene.h"

namespace RigidHIPlugin {

/**
 * Keeps bodies and the Context's particles in agreement: it writes poses and twists to particles,
 * detects changes that others made to the particles, and takes these changes in.
 *
 * OpenMM does not report every change of particles. The mirror therefore keeps what it wrote last,
 * and compares bits.
 */
class ContextMirror {
public:
    explicit ContextMirror(Scene& scene);

    /** Others have set positions or velocities. */
    void positionsWereSet();
    void velocitiesWereSet();
    bool hasPositions() const { return positionsAreSet; }
    /** @throws OpenMMException if positions were never set */
    void requirePositions(const char* what) const;
    /** Geometries were reset, so that all positions and velocities are to be taken in anew. */
    void forgetWritten();

    /**
     * Bring poses and twists up to date with the Context's positions, velocities and box. @throws
     * OpenMMException if others set numbers that are not finite, or positions that do not fit the
     * bodies. Bodies then stay as they were.
     */
    void takeInChanges(bool stepping = false);
    /** Likewise for the box alone, which Forces that change the state (barostats) read. */
    void takeInBox();
    /** A step tilts the box. Bodies and fluid are as before in the new box. */
    void setBox(const BoxVectors& box);
    /**
     * @throws OpenMMException if the box of a sheared fluid is not that of the last step, although
     *     positions were not set since
     */
    void checkBoxOfShear() const;
    /**
     * Bring twists up to date if velocities were changed, but not because of positions: a barostat
     * asks for the energy of trial positions.
     */
    void takeInVelocitiesIfChanged();
    /**
     * A step starts: members that others moved within the tolerance are put back to their places.
     */
    void putMembersBack();
    /**
     * Whether a step must take in changes and put members back before Forces that change the state
     * (barostats) read it.
     */
    bool awaitsTakingIn() const { return setSinceStep || loaded || !scene.isBuilt(); }
    /** A step has taken in the changes of others. */
    void stepTookIn() { setSinceStep = false; }
    /** The largest distance of a member from its place when poses were fitted last, nm. */
    double getPoseResidual() const { return poseResidual; }

    /** Run a loop over all bodies. What it writes to particles counts as written by the mirror. */
    LoopResult run(BodyLoop loop);
    /** Write poses and twists to the Context's particles. */
    void writePoses();
    void writeTwists();
    /**
     * Steps were taken elsewhere (NativeSteps), and bodies and free particles are up to date again:
     * bring the arrays up to date. @param agree  as in ContextArrays::wereWrittenThere()
     */
    void takeOver(bool agree = true);
    /**
     * Velocities of free particles that were changed together with the twists count as written by
     * the mirror.
     */
    void rememberFreeVelocities();
    /**
     * New positions are complete. Place the virtual sites in bodies with them; OpenMM places the
     * others.
     */
    void placeFreeVirtualSites();
    /** A step has moved the particles that are in no body. */
    void rememberOtherParticles();

    /**
     * setVelocitiesToTemperature(): velocities for all particles. The twists are kept for the
     * velocitiesWereSet() that follows.
     */
    std::vector<OpenMM::Vec3> drawVelocities(double temperature, int seed) {
        return drawn.draw(scene, temperature, seed);
    }

    /**
     * A saved state has become that of the bodies. It is used unchanged where the Context's arrays
     * turn out to be those it was saved with, except for the bodies in the list. These bodies are
     * fitted.
     */
    void stateWasLoaded(const SavedState& saved, const std::vector<int>& toBeFitted);

private:
    /**
     * A loaded state that was not yet compared with the Context's arrays: OpenMM restores arrays
     * and parameters in different orders.
     */
    struct Loaded {
        SavedState saved;
        std::vector<int> toBeFitted;
    };
    /** What is to be written to particles when the next step starts. */
    enum class Owed { Nothing, Twists, Poses };

    void takeInLoaded();
    void keepWhatAgrees(const Loaded& loaded, const Rounding& rounding, bool positions);
    void takeInPositions();
    void takeInVelocities(bool putBack);
    void takeInHeld();
    void stopHeldParticles();
    void takeInTwist(int body);
    BodyState fitted(int body, double& residual) const;
    bool bodyMembersDiffer(int body, const std::vector<OpenMM::Vec3>& now,
                           const RememberedArray& last) const;
    void requireFinite(const std::vector<OpenMM::Vec3>& array, const char* quantity,
                       const char* unit) const;

    Scene& scene;
    RememberedArray lastPositions, lastVelocities;  // as the mirror wrote or took them in
    BoxVectors lastBox = {};
    BoxVectors boxOfStep = {};  // of a sheared fluid, where a step left it
    bool boxIsOfStep = false;   // there is one, and nobody has set positions since
    std::unique_ptr<Loaded> loaded;
    DrawnVelocities drawn;
    Owed owed = Owed::Nothing;
    bool positionsAreSet = false;  // at any time, by others
    bool setSinceStep = false;     // positions, velocities or geometries, by users
    double poseResidual = 0;
    int heldChanges = 0;  // of the scene, as far as they were taken in
};

}  // namespace RigidHIPlugin

#endif
