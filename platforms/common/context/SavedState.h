#ifndef RIGIDHI_SAVED_STATE_H_
#define RIGIDHI_SAVED_STATE_H_

#include <openmm/Vec3.h>
#include <openmm/serialization/SerializationNode.h>

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <iosfwd>
#include <string>
#include <vector>

#include "context/Rounding.h"
#include "rigidbody/BodyGeometry.h"

namespace RigidHIPlugin {

/** One body of a saved state. */
struct SavedBody {
    BodyGeometry geometry;
    /** What users mean, in the body frame of the user: this stays true if the body's definition is
     * another when it is read. */
    OpenMM::Vec3 R, velocity, omega_lab;       // nm, nm/ps, rad/ps
    std::array<double, 4> q = {{1, 0, 0, 0}};  // (w, x, y, z), body to lab
    /** BodySet::getStoredState(): what resumes bit for bit where the definition is the same. */
    std::array<double, 13> stored = {};
};

/** What a scheme without momenta keeps between steps, for each group of bodies
 * (OverdampedScheme::memory()). */
struct SchemeMemory {
    std::string scheme;  // its name
    std::vector<std::vector<Eigen::MatrixXd> > groups;
};

/** A particle in no body, in the doubles of the host. */
struct SavedParticle {
    int index = 0;
    OpenMM::Vec3 position, velocity;
};

/** What makes a resumed run the same as the uninterrupted one, as checkpoints and States hold it.
 */
struct SavedState {
    uint32_t seed = 0;
    int64_t stepNumber = 0;
    bool hasBodies = false;  // positions were set, so the following is filled
    /** BodySet::getInertiaScale(): the factor that the stored angular momenta have. Where another
     * holds when they are read, angular velocities go on. */
    double inertiaScale = 1;
    uint64_t positionsHash = 0, velocitiesHash = 0;
    std::vector<SavedBody> bodies;
    SchemeMemory memory;  // mostly empty
    /** What the last step without momenta can be done again from, by who asks for its flow: in the
     * form of a memory. */
    SchemeMemory lastStep;
    /**
     * Of the platform it was saved on, whose arrays hold particles no better than this. Where it
     * rounds, those in no body are saved here too: bodies and they go on from their doubles if the
     * arrays agree.
     */
    Rounding rounding;
    std::vector<SavedParticle> particles;

    /** Version 3. Readers take a number for a number only, and throw an OpenMMException for what
     * cannot be the state of bodies. */
    void write(std::ostream& checkpoint) const;
    void write(OpenMM::SerializationNode& node) const;
    /** Version 2 too, which had no inertia scale: 1. */
    static SavedState read(std::istream& checkpoint);
    /** Versions 1 and 2 too; version 1 had no user frame. */
    static SavedState read(const OpenMM::SerializationNode& node);
};

/** Whether two geometries are the same to the last bit. */
bool sameGeometry(const BodyGeometry& a, const BodyGeometry& b);

}  // namespace RigidHIPlugin

#endif
