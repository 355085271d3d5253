#ifndef OPENMMRIGIDHI_CUSTOM_RIGID_HI_INTEGRATOR_H_
#define OPENMMRIGIDHI_CUSTOM_RIGID_HI_INTEGRATOR_H_

#include <openmm/Integrator.h>
#include <openmm/Kernel.h>
#include <openmm/Vec3.h>

#include <array>
#include <map>
#include <set>
#include <string>
#include <unordered_map>
#include <vector>

#include "openmmrigidhi/internal/JointDefinition.h"
#include "openmmrigidhi/internal/SchemeList.h"
#include "openmmrigidhi/internal/windowsExport.h"

namespace RigidHIPlugin {

/** A unit quaternion (w, x, y, z) that turns body-frame vectors into lab-frame vectors. */
using QuaternionArray = std::array<double, 4>;

/**
 * Integrates rigid bodies, whose orientation is a unit quaternion, under the forces of an ordinary
 * OpenMM Context.
 *
 * addRigidBody() groups particles of the System into bodies. All other particles ("free particles")
 * are integrated with the same scheme, as point particles. The state of a body is
 *   - R: position of the body's origin, nm, lab frame (the origin is the centre of mass; for
 *     schemes without momenta in a fluid it may be any point),
 *   - q: unit quaternion (w, x, y, z), body frame to lab frame,
 *   - p: momentum, amu nm/ps, lab frame,
 *   - l: angular momentum, amu nm^2/ps, body frame.
 *
 * setScheme() chooses the scheme. The schemes of Davidchack, Ouldridge, Tretyakov, J. Chem. Phys.
 * 142, 144114 (2015), have one force evaluation a step each:
 *   - LangevinA (eq. 20), LangevinB (eq. 27) and LangevinC (eq. 28) have weak order 2. Each body
 *     feels friction gamma on its momentum and Gamma on its angular momentum, and noise of
 *     temperature T. Prefer LangevinC.
 *   - GradientThermostat (eq. 30) has weak order 1 and no momenta.
 *
 * The scheme of Davidchack, Ouldridge, Tretyakov, J. Chem. Phys. 147, 224103 (2017), also has one
 * force evaluation a step:
 *   - LangevinHI (eq. 27) is LangevinC with hydrodynamic interactions. A MobilityForce in the
 *     System describes the fluid.
 *
 * The schemes of Brownian dynamics have no momenta and weak order 1. They integrate
 * \f$dQ/dt = N F + \sqrt{2 kT}\,N^{1/2}\,dW/dt + kT\,\mathrm{div} N\f$ with the mobility N of a
 * MobilityForce. They are those of Delong, Balboa Usabiaga, Donev, J. Chem. Phys. 143, 144107
 * (2015), Sprinkle, Balboa Usabiaga, Patankar, Donev, J. Chem. Phys. 147, 244103 (2017), and
 * Westwood, Delmotte, Keaveny, J. Comput. Phys. 467, 111437 (2022):
 *   - EulerMaruyama, FixmanMidpoint, RandomFiniteDifference, TractionEulerMaruyama,
 *     TrapezoidalSlip, DriftCorrectorFD, DriftCorrectorRFD.
 *
 * The Brownian schemes differ in how they make the stochastic drift \f$kT\,\mathrm{div} N\f$
 * (EulerMaruyama omits it), in their cost and in their error at finite steps. Bodies need no mass,
 * and their origin may be any point. Spheres about their centres and free particles have
 * \f$\mathrm{div} N = 0\f$ where the fluid is unbounded or periodic, but not under
 * StokesianDynamics. Where \f$\mathrm{div} N = 0\f$, the schemes compute no drift.
 *
 * The rotational friction of the Langevin schemes relaxes body axis l at the rate
 * \f$\Gamma/(I_l \sum_k 1/I_k)\f$, where the sum is over axes with a non-zero moment. Where a
 * moment is below a tenth of the middle one, the rates change continuously into those of a linear
 * body, so that the thermostat also acts on the tumbling of an elongated body
 * (docs/theory/thermostats.md).
 *
 * Units are OpenMM's: nm, ps, amu, K, kJ/mol. Every error is an OpenMMException that names the
 * object, the value, the bound and the remedy. Methods throw for an index of a body, joint or motor
 * that is out of range, setters of enumerations for a value that is none of the enumerators, and
 * methods that need a Context without one.
 */
class OPENMM_EXPORT_RIGIDHI CustomRigidHIIntegrator : public OpenMM::Integrator {
public:
    /**
     * The time-stepping scheme: LangevinA, LangevinB, LangevinC (default), GradientThermostat,
     * LangevinHI, EulerMaruyama, FixmanMidpoint, RandomFiniteDifference, TractionEulerMaruyama,
     * TrapezoidalSlip, DriftCorrectorFD, DriftCorrectorRFD, numbered from 0. internal/SchemeList.h
     * describes each scheme, docs/schemes has a page on each, and SchemeTraits.h has them as a
     * table.
     */
    enum Scheme : int {
#define RIGIDHI_ROW(name, ...) name,
        RIGIDHI_SCHEMES(RIGIDHI_ROW)
#undef RIGIDHI_ROW
    };
    /** The law of the random numbers; all have mean 0 and variance 1. */
    enum NoiseLaw : int {
        /** Normal (default). */
        Gaussian = 0,
        /** 0 with probability 2/3, \f$\pm\sqrt 3\f$ with 1/6 each (Davidchack 2015, eq. 21): enough
           for weak order 2. */
        ThreePoint = 1,
        /**
         * \f$\pm 1\f$ with probability 1/2 each (eq. 31): enough for weak order 1
         * (GradientThermostat and the schemes without momenta in a fluid).
         */
        TwoPoint = 2
    };
    /**
     * Which steps through a wall of a MobilityForce, or through the free surface of a Film, are
     * redone with new noise.
     */
    enum WallRejection : int {
        /**
         * Steps after which a hydrodynamic particle is nearer to the wall than its radius
         * (default).
         */
        Overlap = 0,
        /**
         * Steps after which the centre of a hydrodynamic particle is on the wall or behind it. A
         * particle of radius a whose centre is at \f$0 < z < a\f$ above the wall has the mobility
         * of contact, multiplied by \f$z/a\f$ on the side of velocities and again on the side of
         * forces.
         */
        Crossing = 1
    };
    /**
     * What the drift factor \f$\nu = 1 + (h/2)\,\mathrm{div} V\f$ of DriftCorrectorFD and
     * DriftCorrectorRFD multiplies. The factor is one number for all bodies of a group.
     */
    enum DriftCorrectorScaling : int {
        /**
         * The slips v (random surface velocities) in the mobility problem:
         * \f$U = N (F + \nu K^T M^{-1} v)\f$ (default). The weak order is the same as that of
         * Whole, and the velocities due to forces have no noise.
         */
        SlipOnly = 0,
        /** The whole step, as in Westwood 2022, eq. 44: \f$U = \nu N (F + K^T M^{-1} v)\f$. */
        Whole = 1
    };

    /**
     * @param temperature  temperature of the heat bath, K; 0: no noise at all
     * @param stepSize     step size, ps
     * @throws OpenMMException if the temperature is negative, the step size is not positive, or
     *     either is not finite
     */
    CustomRigidHIIntegrator(double temperature, double stepSize);
    ~CustomRigidHIIntegrator();

    /**
     * Add a rigid body whose shape, mass and inertia come from the System.
     *
     * The shape comes from the constraints among the massive members if these constraints fix it.
     * Two members need one constraint, and three members a triangle. More members need all pairs,
     * and the first positions give the handedness. Virtual sites then come from their definitions.
     * Otherwise the shape comes from the first positions given to the Context, and stays until
     * resetBodyGeometry(). Mass and inertia come from the System's masses.
     *
     * The System takes precedence: changed constraints and masses take effect at reinitialize().
     * They also replace the constraints and masses of a saved state, whose positions and velocities
     * stay the same. The body frame has its origin at the centre of mass and its axes along the
     * principal axes, the smallest moment first.
     *
     * @param particles  indices of the particles, virtual sites included
     * @return index of the body
     * @throws OpenMMException for an empty body, a negative or repeated index, or a particle that
     *     is in a body already
     */
    int addRigidBody(const std::vector<int>& particles);
    /**
     * Add a rigid body with explicit mass, moments and shape. They override the System's masses,
     * which only OpenMM then uses.
     *
     * @param particles         indices of the particles, virtual sites included
     * @param mass              mass, amu; positive for every scheme with momenta, and for
     *     GradientThermostat
     * @param principalMoments  principal moments of inertia about the body axes x, y, z, amu nm^2,
     *     in any order. A moment below 1e-13 of the largest counts as zero: the body has no
     *     rotation, noise or energy about its axis.
     * @param sitePositions     position of each particle in the body frame, nm. The origin of the
     *     body frame is the centre of mass, and its axes are the principal axes. Schemes without
     *     momenta in a fluid take any origin (the tracking point) and any axes, and 0 for mass and
     *     moments.
     * @return index of the body
     * @throws OpenMMException as the other addRigidBody(); for a negative or non-finite mass or
     *     moment; for moments that violate the triangle inequality; if the number of sites is not
     *     the number of particles
     */
    int addRigidBody(const std::vector<int>& particles, double mass,
                     const OpenMM::Vec3& principalMoments,
                     const std::vector<OpenMM::Vec3>& sitePositions);
    /** Get the number of rigid bodies. */
    int getNumRigidBodies() const;
    /**
     * Get the number of rigid bodies of the bound Context, as it was at Context creation. Bodies
     * added later wait for the next Context or reinitialize(). Needs a Context.
     */
    int getNumRigidBodiesOfContext() const;
    /**
     * Get the definition of a body. For a body without explicit geometry this method needs a
     * Context whose positions are set, or a geometry that was read from XML. Otherwise it throws an
     * OpenMMException.
     *
     * @param index             index of the body
     * @param particles         indices of the particles
     * @param mass              mass, amu
     * @param principalMoments  principal moments about the body axes, amu nm^2
     * @param sitePositions     positions of the particles in the body frame, nm
     */
    void getRigidBodyParameters(int index, std::vector<int>& particles, double& mass,
                                OpenMM::Vec3& principalMoments,
                                std::vector<OpenMM::Vec3>& sitePositions) const;
    /** Get the indices of a body's particles. This method never needs a Context. */
    const std::vector<int>& getRigidBodyParticles(int index) const;
    /** Get whether a body was given explicit mass, moments and sites. */
    bool getRigidBodyIsExplicit(int index) const;
    /** Get whether mass, moments and sites of a body are known. */
    bool getRigidBodyGeometryIsKnown(int index) const;
    /**
     * Replace the definition of a body by an explicit one. The change takes effect at the next
     * Context creation or reinitialize(). The integrator refuses a state that was saved with
     * another mass, other moments or other sites, also in reinitialize(preserveState = true).
     * Parameters and errors are as in addRigidBody().
     */
    void setRigidBodyParameters(int index, const std::vector<int>& particles, double mass,
                                const OpenMM::Vec3& principalMoments,
                                const std::vector<OpenMM::Vec3>& sitePositions);
    /**
     * Forget the geometry of all bodies that have no explicit one. The Context's present (or next)
     * positions define it anew.
     */
    void resetBodyGeometry();

    /** Get the scheme. */
    Scheme getScheme() const;
    /** Set the scheme (default LangevinC). May be changed between steps. */
    void setScheme(Scheme scheme);
    /** Get the law of the random numbers. */
    NoiseLaw getNoiseLaw() const;
    /**
     * Set the law of the random numbers (default Gaussian). TwoPoint is enough only for the schemes
     * without momenta, which have weak order 1.
     */
    void setNoiseLaw(NoiseLaw law);

    /** Get the temperature, K. */
    double getTemperature() const;
    /** Set the temperature, K; 0: no noise, no random numbers. @throws OpenMMException if negative
     * or not finite */
    void setTemperature(double temperature);
    /** Get the translational friction gamma of the Langevin schemes, 1/ps. */
    double getFriction() const;
    /**
     * Set gamma, the rate at which momenta of bodies and of free particles relax (Davidchack 2015,
     * eq. 8), 1/ps. Default 1. @throws OpenMMException if negative or not finite
     */
    void setFriction(double gamma);
    /** Get the rotational friction Gamma of the Langevin schemes, 1/ps. */
    double getRotationalFriction() const;
    /**
     * Set Gamma (Davidchack 2015, eqs. 9 and 10), 1/ps: body axis l relaxes at
     * \f$\Gamma/(I_l \sum_k 1/I_k)\f$, where no moment is below a tenth of the middle one. Default
     * 1.
     * @throws OpenMMException if negative or not finite
     */
    void setRotationalFriction(double Gamma);
    /** Get the factor of the principal moments in the dynamics. */
    double getInertiaScale() const;
    /**
     * Set the factor by which schemes with momenta (LangevinA, LangevinB, LangevinC, LangevinHI)
     * multiply the principal moments of all bodies in their dynamics (default 1). Averages over
     * configurations do not depend on the factor, because momenta are Gaussian and independent of
     * the configuration. The motion does depend on the factor and is not the real motion;
     * describeEffects() says so. With a factor of 4 to 16, light bodies (water) rotate more slowly
     * than the motion that otherwise limits the step, so that longer steps become possible
     * (docs/guide/thermostats.md has measurements).
     *
     * Angular momenta, kinetic energies and temperatures belong to the scaled moments, so that
     * equipartition holds about every axis. Angular velocities, as in setBodyAngularVelocities()
     * and in the velocities of particles, are those of the visible rotation. The rates of
     * setRotationalFriction() do not change. The friction of a fluid does not change either, so
     * that in a fluid angular momenta relax more slowly by the factor, and diffusion over long
     * times is the real one. getRigidBodyParameters() and files have the real moments. The factor
     * does not change masses and free particles. Schemes without momenta ignore the factor.
     *
     * The factor may be changed between steps, and the change takes effect at once. Positions and
     * all velocities then stay the same, so that the rotational kinetic energy changes by the ratio
     * of the factors. Friction restores thermal equilibrium, or the Context's
     * setVelocitiesToTemperature() does so at once. Loading a checkpoint or State that was saved
     * under another factor likewise keeps its positions and velocities.
     *
     * @param factor  dimensionless
     * @throws OpenMMException if not positive and finite
     */
    void setInertiaScale(double factor);
    /** Give one body frictions of its own, 1/ps. @throws OpenMMException if negative or not finite
     */
    void setBodyFriction(int index, double gamma, double Gamma);
    /** Get the frictions of one body, 1/ps: its own, or else those of the integrator. */
    void getBodyFriction(int index, double& gamma, double& Gamma) const;
    /** Get whether a body has frictions of its own. */
    bool getBodyHasOwnFriction(int index) const;
    /** Let a body use the frictions of the integrator again. */
    void clearBodyFriction(int index);
    /**
     * Hold a body at its place and orientation, or let it go. A held body is an obstacle: it never
     * moves, has no momentum and needs no mass, and a fluid is at rest on it. Forces on it change
     * nothing but the wrench that holds it (computeHoldingWrenches()).
     *
     * The flag may be changed between steps. XML has the flag, but checkpoints and States do not.
     *
     * @param index  index of the body
     * @param held   whether the body is held
     * @throws OpenMMException if the index is out of range. At Context creation and at the next
     *     step: if nothing is left that could move, or if the System has a barostat or a
     *     CMMotionRemover
     */
    void setBodyHeld(int index, bool held);
    /** Get whether a body is held. */
    bool getBodyHeld(int index) const;
    /**
     * Hold a free particle where it is, or let it go. Like a held body, a held particle is an
     * obstacle (setBodyHeld()).
     *
     * @param particle  index of a particle that is in no body and is no virtual site
     * @param held      whether the particle is held
     * @throws OpenMMException if the index is negative. At Context creation and at the next step:
     *     as for setBodyHeld(), if the System lacks the particle, if it is in a body or is a
     *     virtual site, or if a constraint ties it to another particle
     */
    void setParticleHeld(int particle, bool held);
    /** Get whether setParticleHeld() holds a particle. */
    bool getParticleHeld(int particle) const;
    /** Get the indices of all particles that setParticleHeld() holds, in ascending order. */
    std::vector<int> getHeldParticles() const;

    /**
     * Join two bodies by a ball: the two anchors are at one place.
     *
     * Joints are rigid. Schemes sample the equilibrium of infinitely stiff springs, whose spring
     * constant does not depend on the poses. Jointed bodies must belong to one group of
     * MobilityForce::setGroups(), and in the poses at the start the anchors must meet within the
     * pose tolerance. Only FixmanMidpoint, RandomFiniteDifference and TrapezoidalSlip take joints.
     * Joints become part of a Context at its creation.
     *
     * @param i         index of the first body
     * @param anchor_i  the anchor in the body frame of the first body, nm
     * @param j         index of the second body
     * @param anchor_j  the anchor in the body frame of the second body, nm
     * @return index of the joint
     * @throws OpenMMException if an index is out of range, if both are the same, or if a number is
     *     not finite
     */
    int addBallJoint(int i, const OpenMM::Vec3& anchor_i, int j, const OpenMM::Vec3& anchor_j);
    /**
     * Join a body to a point of space by a ball: the anchor is at the point. All else is as for
     * addBallJoint().
     *
     * @param i         index of the body
     * @param anchor_i  the anchor in the body frame, nm
     * @param point     the point, lab frame, nm
     * @return index of the joint
     * @throws OpenMMException if the index is out of range, or if a number is not finite
     */
    int addBallJointToPoint(int i, const OpenMM::Vec3& anchor_i, const OpenMM::Vec3& point);
    /**
     * Join two bodies by a link: the two anchors have a fixed distance. All else is as for
     * addBallJoint().
     *
     * @param i         index of the first body
     * @param anchor_i  the anchor in the body frame of the first body, nm
     * @param j         index of the second body
     * @param anchor_j  the anchor in the body frame of the second body, nm
     * @param length    the distance, nm
     * @return index of the joint
     * @throws OpenMMException if an index is out of range, if both are the same, if a number is not
     *     finite, or if the length is not positive
     */
    int addLink(int i, const OpenMM::Vec3& anchor_i, int j, const OpenMM::Vec3& anchor_j,
                double length);
    /**
     * Join two bodies by a hinge: the two anchors are at one place, and the two axes have one
     * direction. All else is as for addBallJoint().
     *
     * @param i         index of the first body
     * @param anchor_i  the anchor in the body frame of the first body, nm
     * @param j         index of the second body
     * @param anchor_j  the anchor in the body frame of the second body, nm
     * @param axis_i    the axis in the body frame of the first body; its length has no effect
     * @param axis_j    the axis in the body frame of the second body; its length has no effect
     * @return index of the joint
     * @throws OpenMMException if an index is out of range, if both are the same, if a number is not
     *     finite, or if an axis is zero
     */
    int addHinge(int i, const OpenMM::Vec3& anchor_i, int j, const OpenMM::Vec3& anchor_j,
                 const OpenMM::Vec3& axis_i, const OpenMM::Vec3& axis_j);
    /** Get the number of joints. */
    int getNumJoints() const;
    /**
     * Get the definition of a joint. The reference stays valid until the next joint is added.
     *
     * @param index  index of the joint
     * @throws OpenMMException if the index is out of range
     */
    const JointDefinition& getJointParameters(int index) const;
    /** @private Add a joint with the parameters of another, checked as by the method of its kind.
     */
    int addJoint(const JointDefinition& joint);
    /** @private The definitions of all joints. */
    const std::vector<JointDefinition>& getJoints() const;
    /**
     * Add a motor to a hinge: it turns the second body relative to the first about the axis of the
     * hinge, by the right-hand rule, at a prescribed rate and with whatever torque this needs. A
     * rate of 0 locks the hinge. The motor becomes part of a Context at its creation.
     *
     * In each step, with noise or without, the angle of the hinge grows by rate times step size to
     * within the joint tolerance (setJointTolerance()). The other motions have the noise and the
     * drift of bodies with this motor.
     *
     * @param hinge  index of the joint, as addHinge() returned it
     * @param rate   rad/ps, of either sign
     * @return index of the motor
     * @throws OpenMMException if the index is out of range, if the joint is no hinge or already
     *     has a motor, or if the rate is not finite
     */
    int addHingeMotor(int hinge, double rate);
    /** Get the number of motors. */
    int getNumHingeMotors() const;
    /**
     * Get the definition of a motor.
     *
     * @param index       index of the motor
     * @param[out] hinge  index of the joint
     * @param[out] rate   rad/ps
     * @throws OpenMMException if the index is out of range
     */
    void getHingeMotorParameters(int index, int& hinge, double& rate) const;
    /** Get the rate of a motor, rad/ps. @throws OpenMMException if the index is out of range */
    double getHingeMotorRate(int index) const;
    /**
     * Set the rate of a motor, rad/ps. It may be changed between steps and is constant during a
     * step: for a rate that depends on time give the mean over the step, or the value at its
     * middle.
     *
     * @param index  index of the motor
     * @param rate   rad/ps, of either sign
     * @throws OpenMMException if the index is out of range, or if the rate is not finite
     */
    void setHingeMotorRate(int index, double rate);
    /** @private The definitions of all motors. */
    const std::vector<HingeMotorDefinition>& getHingeMotors() const;
    /** Get the tolerance of joints, nm. */
    double getJointTolerance() const;
    /**
     * Set the tolerance of joints: the largest distance, in nm, of an anchor from its place after a
     * step (default 1e-10). The same number, in radians, bounds the errors of hinge axes and of the
     * angles by which motors turn in a step. Far from the origin, where coordinates round to more
     * than an eighth of it, eight of these roundings take its place. The setting may be changed
     * between steps.
     * @throws OpenMMException if not positive and finite
     */
    void setJointTolerance(double tolerance);

    /** Get upsilon of GradientThermostat, ps. */
    double getGradientRelaxationTime() const;
    /** Set upsilon (Davidchack 2015, eq. 15), ps. Default 0.004. @throws OpenMMException if not
     * positive and finite */
    void setGradientRelaxationTime(double upsilon);
    /** Get Upsilon of GradientThermostat, ps. */
    double getGradientRotationalRelaxationTime() const;
    /** Set Upsilon (eq. 16), ps. Default 0.001. @throws OpenMMException if not positive and finite
     */
    void setGradientRotationalRelaxationTime(double Upsilon);
    /**
     * Get the seed in use: that of the bound Context, which was set, drawn, or loaded with a
     * checkpoint or State. Without a Context it is the seed as set (0: each Context draws a fresh
     * one).
     */
    int getRandomNumberSeed() const;
    /**
     * Set the seed. With 0 (default), each Context draws a fresh one. A bound Context uses the new
     * seed from its next step on; with 0 it draws a fresh seed at once.
     *
     * Checkpoints and States contain the seed in use, and loading one restores the seed.
     * reinitialize(preserveState = true) keeps it. To start different runs from one checkpoint,
     * call this method after loading the checkpoint. Random numbers are functions of seed and step,
     * so that setting the seed already in use changes nothing.
     */
    void setRandomNumberSeed(int seed);
    /**
     * Get the seed that the next Context begins with: the seed as set, or 0 for a fresh one. XML
     * has this seed.
     */
    int getRandomNumberSeedAsSet() const;
    /** Get the pose tolerance, nm. */
    double getPoseTolerance() const;
    /**
     * Set how far a particle may lie from its place in the body when positions are given to the
     * Context, nm (default 2e-3, so that positions with three decimals fit). Members within this
     * distance are put back when the next step starts. A larger distance is an error.
     * @throws OpenMMException if not positive and finite
     */
    void setPoseTolerance(double tolerance);
    /** Get the number of threads of the host as it was set (0: OpenMM's default). */
    int getNumHostThreads() const;
    /**
     * Set how many threads of the host compute bodies, fluid and noise on platforms other than
     * Reference and CPU. On such platforms a device computes the forces, and the host computes
     * everything that getEffects() does not report as "on the device". With 0 (default) the number
     * is the default of OpenMM's CPU platform: OPENMM_CPU_THREADS, or the number of processors. A
     * change takes effect at the next Context creation or reinitialize(). Reference has one thread,
     * and the CPU platform obeys its own property "Threads", whatever is set here.
     * @throws OpenMMException if not from 0 to 1024
     */
    void setNumHostThreads(int number);
    /** Get which steps through a wall the integrator redoes. */
    WallRejection getWallRejection() const;
    /**
     * Set which steps the integrator redoes where a MobilityForce has a boundary with walls.
     * Repulsions that diverge at contact need the default, Overlap. A start in a configuration that
     * would be rejected is an error. The setting may be changed between steps, and the change takes
     * effect at once.
     */
    void setWallRejection(WallRejection rejection);
    /** Get what the drift factor of DriftCorrectorFD and DriftCorrectorRFD multiplies. */
    DriftCorrectorScaling getDriftCorrectorScaling() const;
    /**
     * Set what the drift factor \f$\nu\f$ of DriftCorrectorFD and DriftCorrectorRFD multiplies
     * (default SlipOnly). The factor fluctuates about 1 by half the step times the divergence of
     * the random velocities. The fluctuations grow with the number of bodies in a group, and a
     * warning appears where they exceed 0.3. The setting may be changed between steps.
     */
    void setDriftCorrectorScaling(DriftCorrectorScaling scaling);
    /** Get how often in a row a step may be redone. */
    int getMaximumRejections() const;
    /**
     * Set how often in a row a step may be redone with new noise (default 100). The integrator
     * redoes steps after which spheres with lubrication overlap, and steps through walls as
     * setWallRejection() says. More rejections in a row are an error. Without momenta, each group
     * of MobilityForce::setGroups() has this number of its own.
     * @throws OpenMMException if negative or above 65535, which is the number of attempts that have
     *     random numbers of their own
     */
    void setMaximumRejections(int number);
    /** Get the relative finite-difference step; 0: chosen by the solver. */
    double getFiniteDifferenceStep() const;
    /**
     * Set the relative step delta of the finite differences of the schemes without momenta. Bodies
     * are displaced by delta times their length (the longest distance of points on their particles)
     * and turned by delta radians.
     *
     * With 0 (default) the step is 1e-5, except where matrix-free solves are differenced: in
     * RandomFiniteDifference with multiblobs, and in all such schemes with multiblobs that have
     * tensors of their own. There the step is \f$\epsilon^{1/3}\f$ with the solver tolerance
     * \f$\epsilon\f$, between 1e-5 and 1e-2, and iterations converge to a tenth of the tolerance.
     * The same holds in the drift-correctors at tolerances of 5e-5 and above, where products have
     * single precision. On a grid (MobilityForce::ForceCoupling) the setting has no effect on the
     * drift-correctors, which take the derivative of the random field.
     * @throws OpenMMException if negative, above 0.1 or not finite
     */
    void setFiniteDifferenceStep(double relative);
    /**
     * Get how many steps the integrator has redone since Context creation, at most
     * \f$2^{31} - 1\f$. Without momenta, every group of MobilityForce::setGroups() counts its own.
     * Needs a Context.
     */
    int getNumRejectedSteps() const;
    /** Set the step size, ps. @throws OpenMMException if not positive and finite */
    void setStepSize(double size) override;
    /** Set the relative tolerance of constraints. @throws OpenMMException if not positive and
     * finite */
    void setConstraintTolerance(double tolerance) override;

    /** Get the positions of the bodies' origins, nm, lab frame, unwrapped. Needs a Context with
     * positions. */
    std::vector<OpenMM::Vec3> getBodyPositions() const;
    /** Get the orientations of the bodies, unit quaternions (w, x, y, z), body to lab. Needs a
     * Context with positions. */
    std::vector<QuaternionArray> getBodyOrientations() const;
    /** Get the velocities of the bodies' origins, nm/ps, lab frame. Needs a Context with positions.
     */
    std::vector<OpenMM::Vec3> getBodyVelocities() const;
    /** Get the angular velocities of the bodies, rad/ps, lab frame. Needs a Context with positions.
     */
    std::vector<OpenMM::Vec3> getBodyAngularVelocities() const;
    /**
     * Set the positions of the bodies' origins, nm. The bodies' particles move along.
     * @throws OpenMMException unless each body has one finite row
     */
    void setBodyPositions(const std::vector<OpenMM::Vec3>& positions);
    /**
     * Set the orientations, quaternions (w, x, y, z), body to lab. The bodies' particles move
     * along. The quaternions are normalised.
     * @throws OpenMMException if the number of rows is not the number of bodies, or for a length
     *     that differs from 1 by more than 1e-3
     */
    void setBodyOrientations(const std::vector<QuaternionArray>& orientations);
    /**
     * Set the velocities of the bodies' origins, nm/ps.
     * @throws OpenMMException unless each body has one finite row
     */
    void setBodyVelocities(const std::vector<OpenMM::Vec3>& velocities);
    /**
     * Set the angular velocities, rad/ps, lab frame. The method drops components about axes without
     * inertia.
     * @throws OpenMMException unless each body has one finite row
     */
    void setBodyAngularVelocities(const std::vector<OpenMM::Vec3>& angularVelocities);
    /** Get the total forces on the bodies at the last force evaluation of the last step, kJ/(mol
     * nm), lab frame. */
    std::vector<OpenMM::Vec3> getBodyForces() const;
    /**
     * Get the total torques about the bodies' origins at the last force evaluation of the last
     * step, kJ/mol, lab frame.
     */
    std::vector<OpenMM::Vec3> getBodyTorques() const;
    /**
     * Get the wrenches that hold the bodies at the present poses, without noise: 6 numbers for each
     * body, the force (kJ/(mol nm)) and the torque about the body's origin (kJ/mol), lab frame. The
     * fluid and all forces on a held body together exert the opposite of its wrench. Bodies that
     * are not held have 0. Needs a Context with positions.
     */
    std::vector<double> computeHoldingWrenches() const;
    /**
     * Get the wrenches that held the bodies during the last step, with the share of the noise, in
     * the form of computeHoldingWrenches(). Their variance is inversely proportional to the step
     * size. Only schemes in a fluid have them.
     */
    std::vector<double> getHoldingWrenches() const;
    /**
     * Get the forces that hold particles (setParticleHeld()) at the present positions, without
     * noise, kJ/(mol nm), lab frame: a row for each particle of the System, which is 0 unless the
     * particle is held. Needs a Context with positions.
     */
    std::vector<OpenMM::Vec3> computeParticleHoldingForces() const;
    /**
     * Get the forces that held particles during the last step, in the form of
     * computeParticleHoldingForces(). The share of the noise is as in getHoldingWrenches().
     */
    std::vector<OpenMM::Vec3> getParticleHoldingForces() const;
    /**
     * Get the forces that the joints exerted during the last step, kJ/(mol nm), lab frame: for each
     * joint of the Context the force on its first body, which acts at the anchor. The force on the
     * second body is the opposite. The share of the noise is as in getHoldingWrenches(). A hinge
     * also exerts a torque across its axis, which is not part of the answer. Its motor exerts a
     * torque about the axis, which getHingeMotorTorques() returns.
     */
    std::vector<OpenMM::Vec3> getJointForces() const;
    /**
     * Get the torques that the motors exerted during the last step, kJ/mol: for each motor of the
     * Context the torque about the axis of its hinge on the second body. The torque on the first
     * body is the opposite. Without noise, torque times rate is the power of the motor. With noise
     * the torque fluctuates as getHoldingWrenches() do.
     */
    std::vector<double> getHingeMotorTorques() const;
    /** Get the largest distance of a particle from its place at the last fit of poses to positions,
     * nm. */
    double getPoseResidual() const;

    /** Get the translational kinetic energy of all bodies, kJ/mol; 0 for schemes without momenta.
     */
    double computeTranslationalKineticEnergy() const;
    /**
     * Get the rotational kinetic energy, summed over bodies, about the axis of the smallest, the
     * middle and the largest principal moment (of each body), kJ/mol; 0 for schemes without
     * momenta.
     */
    OpenMM::Vec3 computeRotationalKineticEnergies() const;
    /** Get the kinetic energy of the free particles, kJ/mol; 0 for schemes without momenta. */
    double computeFreeParticleKineticEnergy() const;
    /**
     * Get the numbers of kinetic degrees of freedom, by name:
     *   - "translational",
     *   - "rotational1", "rotational2", "rotational3": bodies that can rotate about the axis of
     *     their smallest, middle, largest moment,
     *   - "free": free particles less their constraints,
     *   - "removed": 3 with a CMMotionRemover, which removes the momentum of bodies and free
     *     particles, whether or not the bodies' masses are the System's,
     *   - "total".
     *
     * All are 0 for schemes without momenta. Needs a Context.
     */
    std::map<std::string, int> getDegreesOfFreedom() const;
    /**
     * Get the instantaneous temperature of bodies and free particles, K, with the right degrees of
     * freedom. OpenMM's StateDataReporter calls this method from OpenMM 8 on.
     * @throws OpenMMException if the scheme has no momenta
     */
    double computeSystemTemperature();
    /**
     * Get the mid-step temperature of bodies and free particles, K: that of the momenta with which
     * the first drift of the next step moves them, averaged over the noise that this step draws
     * before the drift. This temperature tells right runs from wrong runs at long steps, where
     * computeSystemTemperature() reads low. Its expected mean is
     *   - LangevinC, LangevinHI: the temperature of the bath,
     *   - LangevinB: that of the bath, times the factor by which the step makes mean squares of
     *     positions in a harmonic well wrong, \f$1/(1 - h^2 \omega^2/4)\f$,
     *   - LangevinA: that of the bath, times about \f$1 - \gamma h/2\f$ (for rotation the rate of
     *     the axis; docs/theory/thermostats.md).
     *
     * The degrees of freedom are those of getDegreesOfFreedom(). The method evaluates forces if
     * they are out of date. The steps that follow are the same as without this call.
     * @throws OpenMMException if the scheme has no momenta, if nothing moves, or if positions were
     *     not set
     */
    double computeMidStepTemperature() const;
    /**
     * Get mid-step temperatures, K, by name: "translational" and "rotational" of bodies, "free" of
     * free particles, "total". Names without degrees of freedom are absent. The degrees of freedom
     * that a CMMotionRemover removes are divided between bodies and free particles by their masses.
     * Errors are as in computeMidStepTemperature().
     */
    std::map<std::string, double> computeMidStepTemperatures() const;

    /**
     * Get a text that says which effects are on and why, which are off (getEffects() says why),
     * what would make steps faster, and warnings. Needs a Context.
     */
    std::string describeEffects() const;
    /**
     * Get which effects are on, and why: name to "on: reason" or "off: reason". "advice" is there
     * if something would make steps faster. Needs a Context.
     */
    std::map<std::string, std::string> getEffects() const;
    /**
     * Get counters and times since Context creation: steps, forceEvaluations, mobilityProducts,
     * solverIterations, randomNumbers, squareRoots, seconds_forces, seconds_mobility,
     * seconds_scheme. The following times are sums over all threads for a fluid on a grid, and 0
     * without a grid:
     *   - seconds_spreading: forces to nodes,
     *   - seconds_fft: Fourier transforms, with the fluid's response,
     *   - seconds_averaging: velocities over nodes,
     *   - seconds_solver: iterations without the products.
     *
     * The first two of the following counters describe the work of a device that has the bodies
     * (getEffects(), "bodies on the device"). The third also counts where the host moves bodies.
     * All are 0 without a device:
     *   - deviceLaunches: kernels, without those of OpenMM,
     *   - deviceLooks: reads of a flag or of a few sums, for which the host waits,
     *   - deviceTransfers: states of bodies, and positions, velocities or forces of all particles,
     *     in either direction.
     *
     * Needs a Context.
     */
    std::map<std::string, double> getStepStatistics() const;

    /**
     * Advance the simulation.
     *
     * @param steps  number of steps
     * @throws OpenMMException if the number is negative, if the positions do not fit the bodies, or
     *     if forces or positions become non-finite. In the last case the message names the step and
     *     the body, and the Context keeps the last good state.
     */
    void step(int steps) override;

    /**
     * @private Record a geometry that was derived when positions became known (called by the
     *     kernel).
     */
    void recordBodyGeometry(int index, double mass, const OpenMM::Vec3& principalMoments,
                            const std::vector<OpenMM::Vec3>& sitePositions) const;
    /** @private A number that changes with every setting that the kernels cache. */
    int getSettingsVersion() const;
    /**
     * @private The kernel of the bound Context, for the Forces of this plugin. @param method  the
     *     calling method, for the message
     */
    class IntegrateRigidBodiesKernel& getKernelForForces(const char* method) const;

protected:
    void initialize(OpenMM::ContextImpl& context) override;
    void cleanup() override;
    std::vector<std::string> getKernelNames() override;
    void stateChanged(OpenMM::State::DataType changed) override;
    double computeKineticEnergy() override;
    bool kineticEnergyRequiresForce() const override { return false; }
    std::vector<OpenMM::Vec3> getVelocitiesForTemperature(const OpenMM::System& system,
                                                          double temperature,
                                                          int randomSeed) const override;
    void createCheckpoint(std::ostream& stream) const override;
    void loadCheckpoint(std::istream& stream) override;
    void serializeParameters(OpenMM::SerializationNode& node) const override;
    void deserializeParameters(const OpenMM::SerializationNode& node) override;

private:
    struct Body {
        std::vector<int> particles;
        bool isExplicit = false, geometryIsKnown = false, hasOwnFriction = false, held = false;
        double mass = 0, gamma = 0, Gamma = 0;
        OpenMM::Vec3 principalMoments;
        std::vector<OpenMM::Vec3> sitePositions;
    };
    void checkBodyIndex(int index, const char* method) const;
    int appendJoint(const JointDefinition& joint, const char* method);
    void checkMotorIndex(int index, const char* method) const;
    void checkParticles(const std::vector<int>& particles, int index) const;
    void checkGeometry(const std::vector<int>& particles, double mass,
                       const OpenMM::Vec3& principalMoments,
                       const std::vector<OpenMM::Vec3>& sitePositions, int index) const;
    Body makeExplicitBody(const std::vector<int>& particles, double mass,
                          const OpenMM::Vec3& principalMoments,
                          const std::vector<OpenMM::Vec3>& sitePositions, int index) const;
    int appendBody(const Body& body);
    void requireContext(const char* method) const;
    /** @return the total; an error if the scheme has no momenta or nothing moves */
    int requireDegreesOfFreedom(const char* method) const;
    class IntegrateRigidBodiesKernel& boundKernel(const char* method) const;

    Scheme scheme;
    NoiseLaw noiseLaw;
    WallRejection wallRejection;
    DriftCorrectorScaling driftCorrectorScaling;
    double temperature, friction, rotationalFriction, inertiaScale, gradientTime,
        gradientRotationalTime, poseTolerance, finiteDifferenceStep, jointTolerance;
    int randomSeed, settingsVersion, maximumRejections, numHostThreads;
    mutable std::vector<Body> bodies;
    /** The body that each particle is in, so that adding n bodies costs O(n). */
    std::unordered_map<int, int> bodyOfParticle;
    std::set<int> heldParticles;
    std::vector<JointDefinition> joints;
    std::vector<HingeMotorDefinition> motors;
    /**
     * Whether the kernel exists: it does not before a Context is created, after the Context is
     * gone, and after a failed creation.
     */
    bool hasKernel;
    /** Whether the last Context was deleted, for messages. */
    bool contextIsGone;
    OpenMM::Kernel kernel;
};

}  // namespace RigidHIPlugin

#endif
