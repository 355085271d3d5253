#ifndef RIGIDHI_SAVED_STATE_H_
#define RIGIDHI_SAVED_STATE_H_

#include <openmm/Vec3.h>
#include <openmm/serialization/SerializationNode.h>

#include <array>
#include <cstdint>
#include <iosfwd>
#include <string>
#include <vector>

#include "context/Rounding.h"
#include "rigidbody/BodyGeometry.h"
#include "schemes/SchemeMemory.h"

namespace RigidHIPlugin {

/** One body of a saved state. */
struct SavedBody {
    BodyGeometry geometry;
    /**
     * The user's values, in the body frame of the user. They remain true if the body has another
     * definition when the state is read.
     */
    OpenMM::Vec3 R, velocity, omega_lab;       // nm, nm/ps, rad/ps
    std::array<double, 4> q = {{1, 0, 0, 0}};  // (w, x, y, z), body to lab
    /** BodySet::getStoredState(). With the same definition a run resumes from it bit for bit. */
    std::array<double, 13> stored = {};
};

/** A particle in no body, in the doubles of the host. */
struct SavedParticle {
    int index = 0;
    OpenMM::Vec3 position, velocity;
};

/**
 * The data that make a resumed run the same as the uninterrupted one, as checkpoints and States
 * hold them.
 */
struct SavedState {
    uint32_t seed = 0;
    int64_t stepNumber = 0;
    bool hasBodies = false;  // positions were set, so that the following members are filled
    /**
     * BodySet::getInertiaScale(): the factor that the stored angular momenta have. If the
     * integrator has another factor when the state is read, angular velocities stay the same.
     */
    double inertiaScale = 1;
    uint64_t positionsHash = 0, velocitiesHash = 0;
    std::vector<SavedBody> bodies;
    SchemeMemory memory;  // mostly empty
    /**
     * The data that repeat the last step without momenta, for users who ask for its flow, in the
     * form of a memory.
     */
    SchemeMemory lastStep;
    /**
     * The wrenches and forces that held bodies and particles in the last step, in the form of a
     * memory.
     */
    SchemeMemory holds;
    /**
     * The rounding of the platform that saved the state, whose arrays hold particles no better than
     * this. Where the platform rounds, the state also contains the particles in no body. Bodies and
     * these particles go on from their doubles if the arrays agree.
     */
    Rounding rounding;
    std::vector<SavedParticle> particles;

    /**
     * Write version 4 if something is held, else version 3. Readers accept a text as a number only
     * if all of it is a number, and throw an OpenMMException for values that cannot be the state of
     * bodies.
     */
    void write(std::ostream& checkpoint) const;
    void write(OpenMM::SerializationNode& node) const;
    /** Read versions 2 to 4. Version 2 has no inertia scale: 1. */
    static SavedState read(std::istream& checkpoint);
    /** Read versions 1 to 4. Version 1 has no user's values. */
    static SavedState read(const OpenMM::SerializationNode& node);
};

/** Whether two geometries are the same to the last bit. */
bool sameGeometry(const BodyGeometry& a, const BodyGeometry& b);

}  // namespace RigidHIPlugin

#endif
