#ifndef RIGIDHI_BODY_SET_H_
#define RIGIDHI_BODY_SET_H_

#include <openmm/Vec3.h>

#include <array>
#include <vector>

#include "rigidbody/BodyGeometry.h"
#include "rigidbody/Thermostat.h"

namespace RigidHIPlugin {

/**
 * How a body rotates: not at all, as a linear body (no moment about its line), or about three axes.
 * A held body has no momenta, and the loops do not move it.
 */
enum class RotorKind { Point, Linear, General, Held };

/** The state of one body, in the user's body frame. */
struct BodyState {
    OpenMM::Vec3 R, p, l;                      // nm; amu nm/ps, lab; amu nm^2/ps, body
    std::array<double, 4> q = {{1, 0, 0, 0}};  // (w, x, y, z), body to lab
};

/**
 * All rigid bodies of a Context as a structure of arrays, so that the same loops run over one body
 * or a SIMD pack of bodies.
 *
 * Each body has a *slot*. Slots are sorted by how bodies rotate, and padded to whole blocks with
 * inactive bodies. Held bodies have blocks of their own, which come last. They never have momenta,
 * whatever callers set: their inverse masses and moments are 0. In slots, the axes of the body
 * frame are in the order of the moments, I_1 <= I_2 <= I_3 (FreeRotor-inl.h gives the reason).
 * getState() and setState() translate to and from the user's body frame.
 */
class BodySet {
public:
    /**
     * The number of bodies in a block, a multiple of every SIMD width in doubles. It is fixed, so
     * that results do not depend on the width.
     */
    static const int blockSize = 8;
    struct Block {
        RotorKind rotor = RotorKind::Point;
        bool hasNoise = false;
        bool massesMakeTheBodies =
            false;  // every body is held, or its sites' masses make its mass and inertia
        int firstSite = 0, numSites = 0;
    };

    /** Numbers of one kind, one for each slot. */
    class Column {
    public:
        double& operator[](size_t slot) { return first[slot]; }
        const double& operator[](size_t slot) const { return first[slot]; }

    private:
        friend class BodySet;
        Column() = default;
        // Private, because a copy would be another name of the same numbers.
        Column(const Column&) = default;
        Column& operator=(const Column&) = default;
        double* first = nullptr;
    };

    BodySet() = default;
    BodySet(BodySet&&) = default;
    BodySet& operator=(BodySet&&) = default;
    /**
     * @param geometries    one per body
     * @param particles     the particles of each body
     * @param siteMasses    the mass of each particle of each body whose masses add up to the body's
     *     mass and inertia about its origin; an empty list for other bodies
     * @param carriesForce  for each particle of each body, whether its force counts (a virtual
     *     site's does not: OpenMM has already given it to the parents)
     * @param held          whether each body has no momenta; empty: all have
     */
    BodySet(const std::vector<BodyGeometry>& geometries,
            const std::vector<std::vector<int>>& particles,
            const std::vector<std::vector<double>>& siteMasses,
            const std::vector<std::vector<bool>>& carriesForce, const std::vector<bool>& held = {});
    /**
     * Take the states of another set of the same bodies, and the forces gathered last. The sets may
     * hold different bodies.
     */
    void takeStates(const BodySet& others);

    int getNumBodies() const { return slotOfBody.size(); }
    int getNumBlocks() const { return blocks.size(); }
    int slot(int body) const { return slotOfBody[body]; }
    RotorKind rotor(int body) const { return blocks[slotOfBody[body] / blockSize].rotor; }
    bool isHeld(int body) const { return rotor(body) == RotorKind::Held; }
    /** The bodies that are not held. */
    int getNumMovable() const { return getNumBodies() - numHeld; }
    /**
     * Mass and moments in ascending order, with the moments times the inertia scale. A moment that
     * counts as zero is 0.
     */
    const BodyInertia& inertia(int body) const { return inertias[body]; }
    /**
     * Set the factor by which the dynamics multiplies the moments of the geometries. No other code
     * scales moments. Angular velocities stay, and angular momenta follow. The caller must set
     * thermostats anew.
     */
    void setInertiaScale(double factor);
    double getInertiaScale() const { return inertiaScale; }

    BodyState getState(int body) const;
    void setState(int body, const BodyState& state);
    /**
     * R, q, p, l of one body exactly as stored (inner frame), for saving and resuming bit for bit.
     */
    std::array<double, 13> getStoredState(int body) const;
    void setStoredState(int body, const std::array<double, 13>& values);
    /** Turn a vector of the user's body frame into the inner frame. */
    OpenMM::Vec3 toInner(int body, const OpenMM::Vec3& v_user) const;
    /** Force (lab) and torque (lab) on a body, as gathered last. */
    OpenMM::Vec3 getForce_lab(int body) const;
    OpenMM::Vec3 getTorque_lab(int body) const;
    /**
     * Keep torques in the lab frame, for the solves of schemes without momenta, or in the inner
     * body frame, for schemes with momenta. Default: the body frame. This turns the present
     * torques.
     */
    void keepTorquesInLab(bool inLab);
    bool torquesAreInLab() const { return torquesInLab; }
    /** Add a force and a torque (lab) to those of a body. */
    void addForceAndTorque_lab(int body, const OpenMM::Vec3& force_lab,
                               const OpenMM::Vec3& torque_lab);
    /**
     * The angular velocity in the lab frame from l, and back. Components about axes without a
     * moment are dropped.
     */
    OpenMM::Vec3 getAngularVelocity_lab(int body) const;
    void setAngularVelocity_lab(int body, const OpenMM::Vec3& omega_lab);
    /** Set the factors of a body's thermostat. A held body ignores them. */
    void setThermostat(int body, const Thermostat& thermostat);

    double translationalKineticEnergy() const;
    /**
     * Rotational energies about the axes of the smallest, middle and largest moment, summed over
     * bodies.
     */
    OpenMM::Vec3 rotationalKineticEnergies() const;

    /** A copy of the numbers that a step changes. */
    struct Snapshot {
        std::vector<double> values;
    };
    void save(Snapshot& snapshot) const;
    void restore(const Snapshot& snapshot);
    /** Restore one body. */
    void restore(const Snapshot& snapshot, int body);
    /** Save and restore the forces and torques gathered last, without the rest of the state. */
    void saveForces(Snapshot& snapshot) const;
    void restoreForces(const Snapshot& snapshot);

    // [3] and [4] are the numbers of components. l is in the inner body frame, and so is `torque`
    // unless torquesAreInLab().
    Column R[3], q[4], p[3], l[3], force_lab[3], torque[3];
    Column inverseMass, inverseMoments[3];
    Column decay_p, noise_p, decay_l[3], noise_l[3], move_R, noise_R, move_q[3], noise_q[3];
    std::vector<int> bodyOfSlot;   // -1 for padding
    std::vector<char> drawsNoise;  // whether the thermostat of the slot's body has noise
    std::vector<Block> blocks;
    // Sites, block by block: entry s of a block holds site s of each of its bodies.
    std::vector<double>
        sites;  // [(entry * 3 + component) * blockSize + lane], inner body frame, nm
    std::vector<double> siteMass;    // [entry * blockSize + lane], 0: no such site
    std::vector<int> siteParticle;   // [entry * blockSize + lane], -1: no such site
    std::vector<int> forceParticle;  // likewise, -1 also for virtual sites

private:
    // All columns, one after the other. The columns that a step changes come first, so that a
    // snapshot is one copy.
    std::vector<double> numbers;
    size_t stride = 0, stateSize = 0;  // from one column to the next; of the columns that a step
                                       // changes
    std::vector<int> slotOfBody;
    int numHeld = 0;
    bool torquesInLab = false;
    double inertiaScale = 1;
    std::vector<BodyInertia> ownInertias;  // of the geometries, with moments ascending
    std::vector<BodyInertia> inertias;     // of the dynamics: these moments times the inertia scale
    std::vector<std::array<int, 3>> axisOrder;  // inner axis k is the user's axis axisOrder[k] ...
    std::vector<std::array<double, 3>> axisSign;   // ... times axisSign[k]
    std::vector<std::array<double, 4>> frameTurn;  // q_inner = q_user * frameTurn
    void makeColumns();
    void setInverseMoments();
    void stop(int slot);
    OpenMM::Vec3 toUser(int body, const OpenMM::Vec3& v_inner) const;
    OpenMM::Vec3 toLab(int slot, const OpenMM::Vec3& v_inner) const;
    OpenMM::Vec3 toInnerBody(int slot, const OpenMM::Vec3& v_lab) const;
};

}  // namespace RigidHIPlugin

#endif
