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
 * Keeps bodies and the Context's particles in agreement. It writes poses and twists (velocities and
 * angular velocities) to particles, detects changes that others made to the particles, and applies
 * these changes to the bodies.
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
    /** Geometries were reset: take in all positions and velocities anew. */
    void forgetWritten();

    /**
     * Bring poses and twists up to date with the Context's positions, velocities and box. @throws
     * OpenMMException if others set numbers that are not finite, or positions that do not fit the
     * bodies. Bodies then stay as they were.
     */
    void takeInChanges(bool stepping = false);
    /** Take in changes of the box alone, which Forces that change the state (barostats) read. */
    void takeInBox();
    /** A step tilts the box. Bodies and fluid are as before in the new box. */
    void setBox(const BoxVectors& box);
    /**
     * @throws OpenMMException if the box of a sheared fluid is not that of the last step, although
     *     positions were not set since
     */
    void checkBoxOfShear() const;
    /**
     * Bring twists up to date if velocities have changed. Changed positions are no reason, because
     * a barostat asks for the energy of trial positions.
     */
    void takeInVelocitiesIfChanged();
    /**
     * A step starts: put members that others moved within the tolerance back to their places.
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
     * The velocities of free particles have changed together with the twists. They count as written
     * by the mirror.
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
     * setVelocitiesToTemperature(): draw velocities for all particles. The mirror keeps the twists
     * for the velocitiesWereSet() that follows.
     */
    std::vector<OpenMM::Vec3> drawVelocities(double temperature, int seed) {
        return drawn.draw(scene, temperature, seed);
    }

    /**
     * A saved state has become that of the bodies. If the Context's arrays turn out to be those
     * that it was saved with, the mirror uses the state unchanged, except for the bodies in the
     * list. These bodies are fitted to the arrays.
     */
    void stateWasLoaded(const SavedState& saved, const std::vector<int>& toBeFitted);

private:
    /**
     * A loaded state before its comparison with the Context's arrays. The comparison must wait,
     * because OpenMM restores arrays and parameters in different orders.
     */
    struct Loaded {
        SavedState saved;
        std::vector<int> toBeFitted;
    };
    /** What the mirror must write to particles when the next step starts. */
    enum class Owed { Nothing, Twists, Poses };

    void takeInLoaded();
    bool keepWhatAgrees(const Loaded& loaded, const Rounding& rounding, bool positions);
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
    BoxVectors boxOfStep = {};  // of a sheared fluid, as a step left it
    bool boxIsOfStep = false;   // a step left a box, and nobody has set positions since
    std::unique_ptr<Loaded> loaded;
    DrawnVelocities drawn;
    Owed owed = Owed::Nothing;
    bool positionsAreSet = false;  // at any time, by others
    bool setSinceStep = false;     // positions, velocities or geometries, by users
    double poseResidual = 0;
    int heldChanges = 0;  // Scene::numHeldChanges(), as far as taken in
};

}  // namespace RigidHIPlugin

#endif
