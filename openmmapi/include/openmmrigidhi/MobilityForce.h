#ifndef OPENMMRIGIDHI_MOBILITY_FORCE_H_
#define OPENMMRIGIDHI_MOBILITY_FORCE_H_

#include <openmm/Context.h>
#include <openmm/Force.h>

#include <map>
#include <vector>

#include "openmmrigidhi/internal/ModelList.h"
#include "openmmrigidhi/internal/windowsExport.h"

namespace RigidHIPlugin {

class IntegrateRigidBodiesKernel;

/**
 * How the fluid couples the bodies of a CustomRigidHIIntegrator: viscosity, hydrodynamic radii,
 * model. It adds no forces and no energy. The schemes with hydrodynamic interactions read it.
 *
 * addParticle() gives every particle of the System, in order, a hydrodynamic radius. With radius 0
 * the fluid does not see the particle. A body with one hydrodynamic particle is a sphere, which
 * takes force and torque. A body with several hydrodynamic particles (blobs) is a rigid multiblob.
 * Its blobs carry forces only, and together they make the body's mobility
 * \f$N = (K^T M^{-1} K)^{-1}\f$. Where all blobs of a body lie on a line, the fluid does not drive
 * its rotation about that line, and a torque about the line beyond rounding is an error. A particle
 * in no body that has a radius takes a force only.
 *
 * Units are OpenMM's. Every error is an OpenMMException that names the object, the value, the bound
 * and the remedy. Methods throw for an index of a particle, or of a force on the fluid, that is out
 * of range, and setters of enumerations for a value that is none of the enumerators. Context
 * creation checks the indices of bodies. Methods ...InContext() throw if this force is not in the
 * Context, and those that need positions if none are set.
 */
class OPENMM_EXPORT_RIGIDHI MobilityForce : public OpenMM::Force {
public:
    /**
     * The hydrodynamic model: FreeDraining, RotnePragerYamakawa (default), StokesianDynamics,
     * ForceCoupling, numbered from 0. internal/ModelList.h describes each model, docs/models has a
     * page on each, and ModelTraits.h has them as a table.
     */
    enum Model : int {
#define RIGIDHI_ROW(name, ...) name,
        RIGIDHI_MODELS(RIGIDHI_ROW)
#undef RIGIDHI_ROW
    };
    /**
     * What bounds the fluid: Unbounded (default), NoSlipWall, Periodic, SlipChannel, PeriodicWall,
     * NoSlipChannel, Film, numbered from 0. internal/ModelList.h describes each boundary, the pages
     * of models in docs/models say what it needs and does, and ModelTraits.h has them as a table.
     */
    enum Boundary : int {
#define RIGIDHI_ROW(name, ...) name,
        RIGIDHI_BOUNDARIES(RIGIDHI_ROW)
#undef RIGIDHI_ROW
    };
    /** Which mobility a single sphere above a NoSlipWall or PeriodicWall has. */
    enum SphereWallMobility : int {
        /**
         * The mobility of the model, which has no lubrication: at contact a quarter of the free
         * mobility towards the wall is left.
         */
        FromModel = 0,
        /**
         * The mobility of a rigid sphere alone above the wall, at every gap, to 3e-8. It follows
         * the exact solutions of Dean and O'Neill, Mathematika 10, 13 (1963), and O'Neill, ibid.
         * 11, 67 (1964), along the wall, of Brenner, Chem. Eng. Sci. 16, 242 (1961), towards the
         * wall, and of Jeffery, Proc. Lond. Math. Soc. 14, 327 (1915), about the normal. Delong et
         * al., J. Chem. Phys. 143, 144107 (2015), eqs. 94 to 97, approximate these solutions to 4.4
         * %. A congruence combines this mobility with the interactions with other spheres.
         * BestKnown applies to bodies of one sphere and to free particles; multiblobs keep the
         * mobility of the model.
         */
        BestKnown = 1
    };
    /** Whether spheres have lubrication. Auto belongs to Solver; see setLubrication(Solver). */
    enum Lubrication : int {
        /** StokesianDynamics has lubrication, and other models have none. */
        AutoLubrication = 0,
        /** Spheres have lubrication with each other, and with no-slip walls. */
        On = 1,
        /** No sphere has lubrication. */
        Off = 2
    };
    /** What drives or stops the mean flow along the walls of a NoSlipChannel. */
    enum ChannelCondition : int {
        /**
         * The mean pressure gradient is 0, as in a long channel whose ends are open. Forces along
         * the walls drive fluid through the box.
         */
        ZeroPressureGradient = 0,
        /**
         * The flux through the box is 0, as in a channel whose ends are closed. The mean pressure
         * gradient balances the forces.
         */
        ZeroFlux = 1
    };
    /** The method of the linear algebra. */
    enum Solver : int {
        /**
         * Dense or MatrixFree (default), by the numbers of rows of the matrices. For periodic
         * fluids of more than 150 rows, the method whose step has the shorter estimated time; of
         * fewer rows, Dense unless its step is estimated to be five times as long.
         */
        Auto = 0,
        /** Forms and decomposes matrices. Memory is quadratic and time cubic in bodies. */
        Dense = 1,
        /**
         * Krylov methods (Lanczos) to the solver tolerance. Memory is linear in particles. Time is
         * quadratic, or less by multipoles or on a grid.
         */
        MatrixFree = 2
    };

    MobilityForce();
    ~MobilityForce();

    /** Get the number of particles that were added. */
    int getNumParticles() const { return radii.size(); }
    /**
     * Add the next particle of the System.
     *
     * @param radius  hydrodynamic radius, nm; 0: the fluid does not see the particle
     * @return index of the particle
     * @throws OpenMMException if the radius is negative or not finite. At Context creation: if the
     *     System has another number of particles
     */
    int addParticle(double radius);
    /** Get the hydrodynamic radius of a particle, nm. */
    double getParticleRadius(int index) const;
    /**
     * Set the hydrodynamic radius of a particle, nm; see updateParametersInContext(). Errors are as
     * in addParticle().
     */
    void setParticleRadius(int index, double radius);
    /** Get the viscosity, dalton/(nm ps). */
    double getViscosity() const { return viscosity; }
    /**
     * Set the viscosity eta, dalton/(nm ps); 1 mPa s = 602.214076. The default is that of water at
     * 298.15 K, 0.89 mPa s.
     *
     * @throws OpenMMException if not positive and finite
     */
    void setViscosity(double eta);
    /** Get the hydrodynamic model. */
    Model getModel() const { return model; }
    /** Set the hydrodynamic model (default RotnePragerYamakawa). Takes effect at Context creation
     * or reinitialize(). */
    void setModel(Model model);
    /** Get what bounds the fluid. */
    Boundary getBoundary() const { return boundary; }
    /** Set what bounds the fluid (default Unbounded). Takes effect at Context creation or
     * reinitialize(). */
    void setBoundary(Boundary boundary);
    /** Get the height of the NoSlipWall or PeriodicWall, nm. */
    double getWallHeight() const { return wallHeight; }
    /**
     * Set the z of the NoSlipWall or PeriodicWall, nm (default 0). Other boundaries ignore it.
     * Takes effect at Context creation or reinitialize().
     *
     * @throws OpenMMException if not finite
     */
    void setWallHeight(double height);
    /** Get the walls of the SlipChannel, NoSlipChannel or Film, nm. */
    void getChannelWalls(double& low, double& high) const {
        low = channelLow;
        high = channelHigh;
    }
    /**
     * Set the y of both walls of the SlipChannel, or the z of both walls of the NoSlipChannel, or
     * the z of the wall and of the free surface of the Film, nm. The default is 0 and 0, which is
     * no channel: Context creation with such a boundary throws. Other boundaries ignore the walls.
     * Takes effect at Context creation or reinitialize().
     *
     * @throws OpenMMException unless both are finite and low < high
     */
    void setChannelWalls(double low, double high);
    /** Get what drives or stops the mean flow along the walls of a NoSlipChannel. */
    ChannelCondition getChannelCondition() const { return channelCondition; }
    /**
     * Set what drives or stops the mean flow along the walls of a NoSlipChannel (default
     * ZeroPressureGradient). Other boundaries ignore it. Takes effect at Context creation or
     * reinitialize().
     */
    void setChannelCondition(ChannelCondition condition);
    /** Get which mobility a single sphere above a NoSlipWall or PeriodicWall has. */
    SphereWallMobility getSphereWallMobility() const { return sphereWallMobility; }
    /**
     * Set which mobility a single sphere above one no-slip wall has (default FromModel). Takes
     * effect at Context creation or reinitialize(). BestKnown needs RotnePragerYamakawa, a
     * NoSlipWall or PeriodicWall, and the rejection Overlap; otherwise Context creation throws.
     */
    void setSphereWallMobility(SphereWallMobility mobility);
    /** Get whether spheres have lubrication, as setLubrication() has set it. */
    Lubrication getLubrication() const { return lubrication; }
    /**
     * Set whether spheres that are close to each other, or to a wall, have lubrication (default
     * Auto: only with StokesianDynamics).
     *
     * With RotnePragerYamakawa and ForceCoupling the friction is that of the model, \f$M^{-1}\f$,
     * plus \f$\Delta\f$, the sum of what the model lacks for each pair of spheres alone and for
     * each sphere alone at a wall. So \f$(M^{-1} + \Delta)^{-1}\f$ is exact for two spheres, and
     * for one sphere above a wall. Spheres are bodies of one hydrodynamic particle; multiblobs and
     * free particles have no lubrication. The pages of the models state the accuracy.
     *
     * Spheres must not overlap each other (see setMinimumGap()) or touch walls, and the ratio of
     * two radii must be at most 10. Context creation refuses SphereWallMobility BestKnown, which
     * the lubrication at walls replaces, and the wall rejection Crossing. Slip walls and free
     * surfaces act as mirrors: spheres have the lubrication of pairs with mirror images.
     *
     * @throws OpenMMException for a value that is none of the enumerators
     */
    void setLubrication(Lubrication lubrication);
    /** Set whether spheres have lubrication, by a bool: On or Off. */
    void setLubrication(bool lubrication) { setLubrication(lubrication ? On : Off); }
    /**
     * Set AutoLubrication by the name Auto, which belongs to Solver.
     *
     * @throws OpenMMException for any value other than Auto
     */
    void setLubrication(Solver lubrication);
    /** Get how far lubrication of pairs reaches, as setLubricationReach() has set it. */
    void getLubricationReach(double& whole, double& nothing) const {
        whole = wholeLubrication;
        nothing = noLubrication;
    }
    /**
     * Set how far lubrication of pairs reaches, in mean radii of a pair. Lubrication is whole up to
     * the first distance of the centres, 0 from the second distance on, and smooth between the two.
     * 0, 0 (default) stands for the distances of the model. These are 3 and 4, except for
     * StokesianDynamics with dense matrices: 8 and 10 with Periodic, and all distances with
     * Unbounded. Lubrication at walls is whole at every height.
     *
     * @throws OpenMMException if the first distance is below 2 (contact), if the second is not
     *     above the first, or if either is not finite; both may be 0
     */
    void setLubricationReach(double whole, double nothing);
    /** Get the smallest gap between spheres with lubrication, relative to their mean radius. */
    double getMinimumGap() const { return minimumGap; }
    /**
     * Set the smallest gap between spheres with lubrication, and of StokesianDynamics, relative to
     * the mean of the two radii (default 0). Smaller gaps, and overlaps, count as this gap. With 0,
     * a start with overlapping spheres is an error, and the integrator redoes, with new noise, a
     * step after which spheres overlap.
     *
     * @throws OpenMMException if negative or not finite
     */
    void setMinimumGap(double gap);
    /** Get the method of the linear algebra. */
    Solver getSolver() const { return solver; }
    /**
     * Set the method of the linear algebra (default Auto). With LangevinHI, Dense and MatrixFree
     * take the same step for the same seed, to the tolerance. In schemes without momenta, Dense and
     * MatrixFree take different square roots of the mobility and use different random numbers.
     * Their noise has the same law, but the same seed gives different trajectories. Auto may choose
     * differently for another scene, scheme or tolerance, and then the noise is different.
     * applyMobilityInContext() uses the same solver, whatever the masses are.
     * CustomRigidHIIntegrator::getEffects() names the solver in use.
     */
    void setSolver(Solver solver);
    /** Get the relative tolerance of MatrixFree. */
    double getSolverTolerance() const { return solverTolerance; }
    /**
     * Set the relative tolerance of MatrixFree (default 1e-6). What it bounds depends on the
     * scheme:
     *   - LangevinHI: friction and noise of a step differ from the Dense ones by at most five times
     *     the tolerance, in the norm of mass-weighted momenta.
     *   - Velocities due to forces, also applyMobilityInContext() of multiblobs: their error is at
     *     most the tolerance, in the norm of the friction, unless bodies nearly coincide.
     *   - Schemes without momenta, random velocities: their error is at most five times the
     *     tolerance. The norm is that of the velocities divided by the roots of the particles' own
     *     mobilities (for multiblobs: of the bodies' own mobilities).
     *
     * Where iterations do not reach the tolerance, an exception states what they reached.
     *
     * @throws OpenMMException if not between 1e-14 and 0.1
     */
    void setSolverTolerance(double tolerance);
    /** Get the largest spacing of the nodes of a grid, nm; 0: the solver tolerance decides. */
    double getGridSpacing() const { return gridSpacing; }
    /**
     * Set the largest spacing of the nodes where a fluid is on a grid, nm. A periodic fluid is on a
     * grid with MatrixFree, except under FreeDraining. The grid has the next larger number of nodes
     * without prime factors above 7. With 0 (default) products have the solver tolerance. For
     * ForceCoupling, another spacing means another tolerance of products, which
     * CustomRigidHIIntegrator::describeEffects() states. For RotnePragerYamakawa, another spacing
     * means more pairs or fewer at the same tolerance.
     *
     * @throws OpenMMException if negative or not finite
     */
    void setGridSpacing(double spacing);
    /** Get whether products with the mobility of many particles may use multipoles. */
    bool getFastSummation() const { return fastSummation; }
    /**
     * Set whether products with the mobility of many particles may use multipoles (default true).
     * Multipoles serve RotnePragerYamakawa, Unbounded or NoSlipWall, with MatrixFree, on all
     * platforms but Reference. The time of such a product grows little faster than the number of
     * particles. Three kinds of products use multipoles, because a tolerance suffices for them:
     *   - answers of applyMobilityInContext() for spheres, to the solver tolerance, if that is 1e-6
     *     or more,
     *   - products of iterations, to a part of their tolerance, if that is 1e-6 or more. The result
     *     keeps the tolerance. Iterations whose results a scheme differences do not use multipoles,
     *   - products that a scheme differences. The relative error of the difference is then a tenth
     *     of the tolerance, at most 1e-4.
     *
     * The numbers of particles from which products use multipoles follow from the tolerance alone,
     * and CustomRigidHIIntegrator::getEffects() gives them. Other products are sums over all pairs,
     * to rounding. If the setting is false, all products are sums over all pairs, and answers of
     * applyMobilityInContext() for spheres are exact to rounding, on devices, too.
     */
    void setFastSummation(bool enabled) {
        settingsVersion++;
        fastSummation = enabled;
    }

    /**
     * Get the flow that setBackgroundFlow() has set: nm/ps, and 9 numbers
     * \f$\partial v_a/\partial x_b\f$ in rows a, 1/ps.
     */
    void getBackgroundFlow(OpenMM::Vec3& velocity, std::vector<double>& gradient) const {
        velocity = flowVelocity;
        gradient = flowGradient;
    }
    /**
     * Set the flow that the fluid has without bodies, \f$v(x) = v_0 + G x\f$ with the velocity
     * \f$v_0\f$, the gradient G, and x from the origin of coordinates (default: none). The flow
     * carries and turns bodies: blobs have the slip (surface velocity) \f$v(x)\f$, and spheres have
     * \f$v(x)\f$ and half the curl of v (Westwood 2022, eq. 33). Spheres of StokesianDynamics
     * resist the strain by their stresslets, with lubrication of the strain. Multiblobs resist it
     * by their blobs. Spheres of other models, and bodies' own tensors, do not resist it.
     *
     * The boundary must be Unbounded, or NoSlipWall or PeriodicWall if the flow is 0 at the wall.
     * Context creation refuses a flow with other boundaries. The flow acts in schemes without
     * momenta, and in LangevinHI. The friction of LangevinHI acts on velocities relative to those
     * of force-free bodies in the flow.
     *
     * @param velocity  at the origin, nm/ps
     * @param gradient  9 numbers \f$\partial v_a/\partial x_b\f$, row after row, 1/ps
     * @throws OpenMMException if the gradient has not 9 numbers, if any number is not finite, or if
     *     the trace is not 0 to 1e-12 (the fluid is incompressible)
     */
    void setBackgroundFlow(const OpenMM::Vec3& velocity, const std::vector<double>& gradient);
    /**
     * Get the force density that setSinusoidalForceDensity() has set: kJ/(mol nm^4), axes, number
     * of waves.
     */
    void getSinusoidalForceDensity(double& f0, int& forceAxis, int& waveAxis,
                                   int& waveVectorIndex) const;
    /**
     * Drive the fluid by a force density \f$f_0 \sin(k x)\f$ along forceAxis, where x is the
     * coordinate along waveAxis (default: \f$f_0 = 0\f$, none). Here \f$k = 2 \pi n/L\f$, n is
     * waveVectorIndex, and L is the edge of the Context's box along waveAxis. Without bodies the
     * force density makes the flow \f$f_0/(\eta k^2) \sin(k x)\f$. The slip (surface velocity) of a
     * blob is the average of this flow over the blob's surface or Gaussian. Spheres with torque
     * also have the average curl of the flow (Westwood 2022, section 6.4). Stresslets are as in
     * setBackgroundFlow().
     *
     * The boundary must be periodic, and both axes must be along its walls. Context creation
     * refuses other boundaries with f0 not 0, and waves that are not periodic in a triclinic box or
     * too short for a grid. Above a no-slip wall, or between walls, the flow is
     * \f$f_0/(\eta k^2) (1 - p(z)) \sin(k x)\f$, where p is 1 on a wall
     * (docs/theory/driven_flows.md).
     *
     * @param f0               kJ/(mol nm^4)
     * @param forceAxis        0, 1, 2: x, y, z
     * @param waveAxis         0, 1, 2: x, y, z; not forceAxis
     * @param waveVectorIndex  periods of the wave in the box, at least 1
     * @throws OpenMMException if f0 is not finite, an axis is not as above, or waveVectorIndex is
     *     below 1
     */
    void setSinusoidalForceDensity(double f0, int forceAxis, int waveAxis, int waveVectorIndex);
    /** Get the velocity of the upper wall of a NoSlipChannel, nm/ps. */
    OpenMM::Vec3 getWallVelocity() const { return wallVelocity; }
    /**
     * Let the upper wall of a NoSlipChannel move along itself (default: 0, at rest). The lower wall
     * is at rest. Without bodies the fluid has the Couette flow \f$U (z - z_\mathrm{low})/H\f$ with
     * the height H of the channel. With the condition ZeroFlux, where the channel is closed at its
     * ends, the pressure makes the flux 0: \f$U (3 s^2 - 2 s)\f$ with
     * \f$s = (z - z_\mathrm{low})/H\f$. Bodies follow the flow as in setBackgroundFlow().
     *
     * Context creation refuses other boundaries with a velocity that is not 0.
     *
     * @param velocity  nm/ps; its z must be 0
     * @throws OpenMMException if not finite, or if z is not 0
     */
    void setWallVelocity(const OpenMM::Vec3& velocity);
    /** Get the uniform force density on the fluid, kJ/(mol nm^4). */
    OpenMM::Vec3 getBodyForceDensity() const { return bodyForceDensity; }
    /**
     * Drive the fluid along its walls by a uniform force density f, as gravity or a pressure
     * gradient -f does (default: 0, none). Without bodies the fluid has the Poiseuille flow. This
     * is \f$f (z - z_\mathrm{low}) (z_\mathrm{high} - z)/(2 \eta)\f$ in a NoSlipChannel, and
     * \f$f (z - z_\mathrm{low}) (2 z_\mathrm{high} - z_\mathrm{low} - z)/(2 \eta)\f$ in a Film.
     * Bodies follow the flow as in setBackgroundFlow(). The force density acts as if the volume of
     * the bodies were fluid too, and exerts no other force on bodies.
     *
     * The boundary must be NoSlipChannel with the condition ZeroPressureGradient, or Film. Context
     * creation refuses a force density that is not 0 with anything else: with ZeroFlux the pressure
     * would balance the force density, and above a PeriodicWall no flow is steady.
     *
     * @param forceDensity  kJ/(mol nm^4), which is dalton/(nm^2 ps^2); its z must be 0
     * @throws OpenMMException if not finite, or if z is not 0
     */
    void setBodyForceDensity(const OpenMM::Vec3& forceDensity);
    /** Get the shear that setShear() has set: rate in 1/ps, and axes. */
    void getShear(double& rate, int& flowAxis, int& gradientAxis) const;
    /**
     * Shear a periodic fluid steadily (default: rate 0, none), with the boundary conditions of Lees
     * and Edwards. Without bodies the fluid flows along flowAxis with the velocity \f$g x\f$, where
     * g is the rate and x the coordinate along gradientAxis. The box tilts with the flow: steps set
     * the Context's box, and the Context computes forces in the box of their time. The tilt starts
     * at that of the Context's box. Where a tilt exceeds half an edge, the box flips to the other
     * tilt with the same lattice, so that positions, which are not wrapped, and forces stay as they
     * are. States and checkpoints hold the box, and with it the strain.
     *
     * Bodies follow the flow as in setBackgroundFlow(). The velocity gradient is the mean one of
     * the fluid with its bodies, so that the relative viscosity is \f$1 + s/(\eta g)\f$, with the
     * stress s of getStressInContext().
     *
     * Context creation refuses boundaries other than Periodic, the model FreeDraining, schemes with
     * momenta, barostats, a sinusoidal force density beside the shear, and platforms other than
     * Reference and CPU. A step throws if strain rate times step size is above 0.1, or if the box
     * was set without positions. In the two boxes of one lattice OpenMM's PME agrees only to its
     * tolerance, so that its forces jump by its error at a flip.
     *
     * @param rate          1/ps
     * @param flowAxis      0 or 1: x or y
     * @param gradientAxis  1 or 2: y or z; after flowAxis, since OpenMM's boxes are lower
     *     triangular
     * @throws OpenMMException if rate is not finite, or an axis is not as above
     */
    void setShear(double rate, int flowAxis, int gradientAxis);

    /**
     * Give a body a mobility tensor of its own. The tensor gives the body's velocity and angular
     * velocity (about its origin) from force and torque, when the body is alone in unbounded fluid,
     * in the body frame.
     *
     * FreeDraining takes the tensor as it is. RotnePragerYamakawa combines it with the interactions
     * by congruence, \f$N = B N_\mathrm{RPY} B^T\f$ with
     * \f$B = N_\mathrm{own}^{1/2} N_\mathrm{RPY,alone}^{-1/2}\f$. The result is exact for a body
     * alone and always positive definite. B scales the interactions on both sides, so give the
     * particles radii whose tensor is near the body's own.
     *
     * @param body      index of the body
     * @param mobility  36 numbers, rows Vx Vy Vz Wx Wy Wz, columns Fx Fy Fz Tx Ty Tz, body frame;
     *     nm/ps per kJ/(mol nm), ...
     * @throws OpenMMException if not 36 finite numbers, not symmetric to 1e-9, or not positive
     *     definite. At Context creation: with StokesianDynamics, whose bodies are spheres
     */
    void setBodyMobility(int body, const std::vector<double>& mobility);
    /**
     * Give a body a tensor of its own by its friction tensor, the inverse of the mobility tensor.
     * The friction tensor gives the force and torque that the moving body exerts on the fluid. All
     * else is as in setBodyMobility().
     *
     * @param body      index of the body
     * @param friction  36 numbers, rows Fx Fy Fz Tx Ty Tz, columns Vx Vy Vz Wx Wy Wz, body frame;
     *     kJ/(mol nm) per nm/ps, ...
     */
    void setBodyFriction(int body, const std::vector<double>& friction);
    /** Get whether a body has a tensor of its own. */
    bool getBodyHasOwnTensor(int body) const { return ownTensors.count(body) > 0; }
    /**
     * Get whether setBodyFriction() gave a body its tensor. @throws OpenMMException if it has none
     */
    bool getBodyTensorIsFriction(int body) const;
    /** Get a body's own mobility tensor, 36 numbers. @throws OpenMMException if it has none */
    std::vector<double> getBodyMobility(int body) const;
    /** Get a body's own friction tensor, 36 numbers. @throws OpenMMException if it has none */
    std::vector<double> getBodyFriction(int body) const;
    /** Remove a body's own tensor. */
    void clearBodyTensor(int body);
    /** Get the bodies with tensors of their own. */
    std::vector<int> getBodiesWithOwnTensors() const;

    /**
     * Give the surface of a multiblob a slip: the fluid at each blob moves with the body and with
     * the blob's slip velocity besides, as at the surface of a swimmer that is driven by cilia or
     * by a reaction. The slip adds no force and no torque on the body; the body moves itself and
     * the fluid. Velocities turn with the body. They enter a step as a driven flow does, and cause
     * no drift and no noise.
     *
     * Velocities at single blobs are not those of a smooth surface: a shell of 12 to 642 blobs with
     * the velocities of a squirmer swims 73 to 11 % too fast. In Python,
     * openmmrigidhi.app.squirmerSlip() scales the modes of a squirmer by the response of the shell
     * at hand.
     *
     * Slips act in schemes without momenta. Context creation refuses other schemes, a wrong number
     * of velocities, and a slip of a body of one particle, because the models have no stresslet
     * sources for a single sphere.
     *
     * @param body        index of the body
     * @param velocities  of the surface relative to the body at each hydrodynamic particle of the
     *     body, in the order of its particles with a radius, nm/ps, body frame
     * @throws OpenMMException if the index is negative or a velocity is not finite
     */
    void setBodySlip(int body, const std::vector<OpenMM::Vec3>& velocities);
    /** Get the slip velocities of a body, nm/ps, body frame. @throws OpenMMException if it has none
     */
    std::vector<OpenMM::Vec3> getBodySlip(int body) const;
    /** Remove a body's slip. */
    void clearBodySlip(int body);
    /** Get the bodies with a slip. */
    std::vector<int> getBodiesWithSlip() const;

    /**
     * Let a body exert a force on the fluid at a site that moves with the body, as the flagella of
     * a swimmer do. The body takes the opposite force there, so that body and site together are
     * free of forces and torques. Force and site turn with the body. (Forces between the blobs of a
     * body would do nothing: the body is rigid.) Such forces cause no drift and no noise.
     *
     * For the fluid the site is a particle of its own, with a radius, that nothing holds and that
     * resists nothing. It may be anywhere in the fluid. These forces act in schemes without
     * momenta. Context creation refuses other schemes, and StokesianDynamics, in which such a
     * particle would have lubrication.
     *
     * @param body    index of the body
     * @param site    body frame, nm
     * @param radius  of the particle that exerts the force, nm
     * @param force   on the fluid, body frame, kJ/(mol nm)
     * @return index of the force
     * @throws OpenMMException if the body's index is negative, the radius not positive, or a number
     *     not finite
     */
    int addBodyForceOnFluid(int body, const OpenMM::Vec3& site, double radius,
                            const OpenMM::Vec3& force);
    /** Get the number of forces on the fluid. */
    int getNumBodyForcesOnFluid() const { return forcesOnFluid.size(); }
    /** Get a force on the fluid, as addBodyForceOnFluid() took it. */
    void getBodyForceOnFluidParameters(int index, int& body, OpenMM::Vec3& site, double& radius,
                                       OpenMM::Vec3& force) const;
    /**
     * Set a force on the fluid; see updateParametersInContext(). A force of 0 switches it off.
     * Errors are as in addBodyForceOnFluid().
     */
    void setBodyForceOnFluidParameters(int index, int body, const OpenMM::Vec3& site, double radius,
                                       const OpenMM::Vec3& force);

    /** Get the group of each body; empty: all bodies are in one group. */
    const std::vector<int>& getGroups() const { return groups; }
    /**
     * Set which bodies feel each other through the fluid. Only bodies of one group do, so that one
     * Context can hold replicas of a scene at a cost linear in groups. By default, or with an empty
     * list, all bodies are in one group. Hydrodynamic particles in no body belong to group 0.
     *
     * Groups are meant to be independent. Without momenta, a step that one group must redo (at a
     * wall, for overlap) concerns that group alone, and the motion of the other groups stays the
     * same bit for bit. OpenMM forces between groups break this independence: in schemes that
     * evaluate forces at intermediate positions, these forces may have felt poses that were
     * rejected. LangevinHI redoes a step for all groups.
     *
     * @param groups  a number from 0 up for each body
     * @throws OpenMMException if a number is negative. At Context creation: unless each body has
     *     one number
     */
    void setGroups(const std::vector<int>& groups);

    /**
     * Copy changed viscosity, radii, own tensors, slips, forces on the fluid, lubrication and its
     * reach, minimum gap, solver, tolerance, grid spacing, fast summation and flows to a Context. A
     * radius may not change between 0 and not 0. Changes of model, boundary, wall height, channel
     * walls and condition, sphere-wall mobility, groups and the number of particles need
     * reinitialize().
     * @throws OpenMMException if this force is not in the Context, or for a change that needs
     *     reinitialize()
     */
    void updateParametersInContext(OpenMM::Context& context);
    /**
     * Get the mobility matrix of the bodies at their present poses: 6n x 6n numbers, row after row.
     * Rows per body are Vx Vy Vz Wx Wy Wz about the body's origin, columns Fx Fy Fz Tx Ty Tz, in
     * the lab frame and OpenMM units. Free particles are force-free.
     *
     * The matrix comes from dense matrices. MatrixFree iterates column by column, to its tolerance,
     * where iterations take less time: for bodies of 850 blobs and more on the CPU platform, 3500
     * on Reference. CustomRigidHIIntegrator::getEffects() names the method in use ("mobilities
     * asked for").
     */
    std::vector<double> getMobilityInContext(OpenMM::Context& context) const;
    /**
     * Get the friction matrix, the inverse of the mobility matrix (pseudo-inverse for bodies whose
     * blobs are on a line): 6n x 6n numbers, row after row. Rows per body are Fx Fy Fz Tx Ty Tz
     * about the body's origin, columns Vx Vy Vz Wx Wy Wz, in the lab frame and OpenMM units. It
     * always comes from dense matrices.
     */
    std::vector<double> getFrictionInContext(OpenMM::Context& context) const;
    /**
     * Get the velocities that forces and torques on the bodies would give without inertia: mobility
     * times wrenches. The computation is dense or matrix-free as setSolver() says. For spheres it
     * is always a product without a matrix, to rounding, or to the solver tolerance where
     * setFastSummation() allows multipoles, or products in single precision on a device.
     *
     * @param wrenches  6 numbers per body, Fx Fy Fz (kJ/(mol nm)) and Tx Ty Tz about the body's
     *     origin (kJ/mol), lab frame
     * @return 6 numbers per body, Vx Vy Vz (nm/ps) and Wx Wy Wz (rad/ps), lab frame
     * @throws OpenMMException unless each body has 6 numbers, if a number is not finite, or for a
     *     torque about the line of a body whose blobs are on a line
     */
    std::vector<double> applyMobilityInContext(OpenMM::Context& context,
                                               const std::vector<double>& wrenches) const;
    /**
     * Get the velocities that forces on the hydrodynamic particles would give if each particle were
     * free: the mobility of blobs, without the rigidity of bodies. Blobs, spheres and free
     * particles are at their present positions. Spheres (one particle in a body) feel no torque,
     * and their angular velocities are not given.
     *
     * Particles feel each other as bodies do: within a group of setGroups(), or under FreeDraining
     * within a body. Tensors of setBodyMobility() and setBodyFriction() belong to bodies and have
     * no effect. The method solves no system of equations: each group needs one product with the
     * model's matrix, whatever the solver (StokesianDynamics forms its matrix).
     *
     * @param forces  3 numbers for each particle of the System, Fx Fy Fz, kJ/(mol nm), lab frame;
     *     forces on particles that the fluid does not see are ignored
     * @return 3 numbers for each particle of the System, Vx Vy Vz, nm/ps, lab frame; 0 for
     *     particles that the fluid does not see
     * @throws OpenMMException unless each particle has 3 numbers, or if a number is not finite
     */
    std::vector<double> applyBlobMobilityInContext(OpenMM::Context& context,
                                                   const std::vector<double>& forces) const;

    /**
     * Get the velocities of the fluid at points, nm/ps, lab frame. They are the driven flow and the
     * flow due to the bodies, over all space. Within a particle, the flow is that of the particle's
     * spread forces.
     *
     * Schemes without momenta give the flow of the last step, at the poses where forces were
     * evaluated (for DriftCorrectorFD, DriftCorrectorRFD and FixmanMidpoint, the mid-point). This
     * flow is the sum of the driven flow, \f$\nu\f$ times the random flow, and the flow of the
     * forces that kept bodies rigid. Its mean includes the Brownian stress, which a mean over
     * forces alone does not. A model's own random field (on a grid) is included with all its modes.
     * For models without such a field, the random flow is the mean of all flows that fit the
     * particles' random velocities. Before a step, or after a change of poses or parameters, the
     * flow is without noise, at the present poses under the present forces. LangevinHI gives the
     * flow of the friction forces at present poses and velocities.
     *
     * Checkpoints and States contain the last step. Cost: that of a step, and the work of each
     * particle at each point; on a grid, of each node at each point.
     *
     * @param points  nm
     * @throws OpenMMException if a point is not finite or is behind a wall, for several groups of
     *     setGroups(), for FreeDraining, and at temperatures above 0 for StokesianDynamics with
     *     MatrixFree, which does not keep the flow of the noise
     */
    std::vector<OpenMM::Vec3> getFlowInContext(OpenMM::Context& context,
                                               const std::vector<OpenMM::Vec3>& points) const;
    /**
     * Get the amplitudes of \f$\sin(k x)\f$ and of \f$\cos(k x)\f$ in the component forceAxis of
     * the flow of getFlowInContext(), with x along waveAxis and k as in
     * setSinusoidalForceDensity(), nm/ps: two numbers. They are exact and need no grid:
     * \f$2/(\eta k^2 V)\f$ times the power of the forces on such a flow
     * (docs/theory/flow_of_the_fluid.md). The boundary must be periodic, with axes along its walls.
     * Between no-slip walls and in a film, a flow is not a sum of such waves. There the amplitudes
     * are means over the height of the fluid. A PeriodicWall has no such mean.
     *
     * @throws OpenMMException as getFlowInContext(), for axes or an index as
     *     setSinusoidalForceDensity(), and for other boundaries
     */
    std::vector<double> getFlowModeInContext(OpenMM::Context& context, int forceAxis, int waveAxis,
                                             int waveVectorIndex) const;
    /**
     * Get the amplitudes, as getFlowModeInContext() does, of the random field of the last step
     * alone, without \f$\nu\f$. This field is the part of the noise that the model draws itself, on
     * a grid; without such a field the amplitudes are 0. Their mean is 0, so that you may subtract
     * a multiple of them from the result of getFlowModeInContext() to reduce the error of its mean.
     */
    std::vector<double> getRandomFlowModeInContext(OpenMM::Context& context, int forceAxis,
                                                   int waveAxis, int waveVectorIndex) const;
    /**
     * Get the mean of the flow of getFlowInContext() over the volume of the fluid, nm/ps. Times the
     * height of a channel, this is the flux through the channel per length across the flow. The
     * mean is exact and needs no grid: it is the power of the forces on the Poiseuille flow of a
     * unit force density (docs/theory/flow_of_the_fluid.md). It is 0 in a periodic box, in a
     * SlipChannel, and with the condition ZeroFlux.
     *
     * @throws OpenMMException as getFlowInContext(), and for fluids without a finite volume
     */
    OpenMM::Vec3 getMeanFlowInContext(OpenMM::Context& context) const;
    /**
     * Get the mean, as getMeanFlowInContext() does, of the random field of the last step alone,
     * without \f$\nu\f$; as getRandomFlowModeInContext().
     */
    OpenMM::Vec3 getRandomMeanFlowInContext(OpenMM::Context& context) const;
    /**
     * Get the stress that the bodies add to a periodic fluid, by parts, at present poses: four
     * matrices 3 x 3, row after row, kJ/(mol nm^3). Each is a mean over the box, and is symmetric.
     *
     *   hydrodynamic   of the resistance of force-free bodies to the driven flow, and of swimmers
     *   Brownian       one sample of a random finite difference, whose mean is the Brownian stress;
     *                  0 at temperature 0. Where spheres nearly touch, rare samples are huge, so
     *                  keep spheres apart by a repulsion.
     *   interparticle  of OpenMM's forces and torques on bodies and free particles: their virial,
     *                  and the stresslets that they cause in the fluid (under StokesianDynamics and
     *                  with multiblobs), so that the part differs from the virial of pair forces
     *   ideal          \f$-n\,kT\f$, with the number density n of bodies and free particles
     *
     * Means over a run of the sum are the stress of the suspension beside that of the fluid. The
     * hydrodynamic and Brownian parts have no trace, because the models have no pressure in bodies.
     * Spheres of StokesianDynamics have stresslets, and multiblobs have them by their blobs; single
     * spheres of the other models have none. OpenMM's forces must not depend on absolute positions
     * or orientations. Their virial is a difference of energies: to 1e-9 on Reference, and to about
     * 1e-4 on CPU, which computes in single precision.
     *
     * @throws OpenMMException for boundaries other than Periodic, FreeDraining, several groups,
     *     schemes with momenta, bodies that are held, driven, joined or exert forces on the fluid,
     *     a CustomBodyForce, and platforms other than Reference and CPU
     */
    std::vector<double> getStressInContext(OpenMM::Context& context) const;

    /**
     * Get whether the fluid is periodic. If it is, OpenMM has a box, and Context creation refuses
     * bodies that OpenMM does not know to be molecules.
     */
    bool usesPeriodicBoundaryConditions() const override;

    /** @private A number that changes with every setting. */
    int getSettingsVersion() const { return settingsVersion; }

protected:
    OpenMM::ForceImpl* createImpl() const override;

private:
    struct OwnTensor {
        bool isFriction;
        std::vector<double> values;
    };
    void checkTensor(int body, const std::vector<double>& tensor, const char* method) const;
    const OwnTensor& ownTensor(int body, const char* method) const;
    IntegrateRigidBodiesKernel& kernelIn(OpenMM::Context& context, const char* method) const;
    std::vector<double> radii;
    double viscosity, minimumGap, solverTolerance, gridSpacing, wallHeight, channelLow, channelHigh;
    Model model;
    Boundary boundary;
    SphereWallMobility sphereWallMobility;
    ChannelCondition channelCondition;
    Solver solver;
    Lubrication lubrication;
    double wholeLubrication = 0, noLubrication = 0;
    bool fastSummation = true;
    double forceDensity = 0;
    int forceAxis = 0, waveAxis = 1, waveVectorIndex = 1;
    double shearRate = 0;
    int flowAxis = 0, gradientAxis = 1;
    OpenMM::Vec3 flowVelocity, wallVelocity, bodyForceDensity;
    std::vector<double> flowGradient = std::vector<double>(9, 0.0);
    std::map<int, OwnTensor> ownTensors;
    std::map<int, std::vector<OpenMM::Vec3>> slips;  // of bodies
    struct ForceOnFluid {
        int body;
        OpenMM::Vec3 site;
        double radius;
        OpenMM::Vec3 force;
    };
    std::vector<ForceOnFluid> forcesOnFluid;
    void checkForceOnFluid(int index, const char* method) const;
    std::vector<int> groups;
    int settingsVersion = 0;
};

}  // namespace RigidHIPlugin

#endif
