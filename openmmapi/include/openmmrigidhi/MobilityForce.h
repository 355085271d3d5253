#ifndef OPENMMRIGIDHI_MOBILITY_FORCE_H_
#define OPENMMRIGIDHI_MOBILITY_FORCE_H_

#include <openmm/Context.h>
#include <openmm/Force.h>

#include <map>
#include <vector>

#include "openmmrigidhi/internal/windowsExport.h"

namespace RigidHIPlugin {

class IntegrateRigidBodiesKernel;

/**
 * How the fluid couples the bodies of a CustomRigidHIIntegrator: viscosity, hydrodynamic radii,
 * model. It adds no forces and no energy; the schemes with hydrodynamic interactions read it.
 *
 * Every particle of the System is given a hydrodynamic radius, in order, by addParticle(); 0: the
 * fluid does not see it. A body with one hydrodynamic particle is a sphere, which takes force and
 * torque; a body with several is a rigid multiblob, whose blobs carry forces only and together make
 * the body's mobility N = (K^T M^-1 K)^-1. Where all blobs of a body lie on a line, the fluid does
 * not drive its rotation about that line, and a torque about it beyond rounding is an error. A
 * particle in no body with a radius takes a force only.
 *
 * Units are OpenMM's. Every error is an OpenMMException that names the object, the value, the bound
 * and the remedy.
 */
class OPENMM_EXPORT_RIGIDHI MobilityForce : public OpenMM::Force {
public:
    /** The hydrodynamic model. */
    enum Model : int {
        /**
         * No interaction between bodies: a sphere has its Stokes drag 6 pi eta a, 8 pi eta a^3, a
         * multiblob its own constant tensor in its body frame, computed once. Cost: linear in
         * bodies.
         */
        FreeDraining = 0,
        /**
         * Rotne-Prager-Yamakawa with rotation, unequal radii, overlap allowed: translation,
         * rotation and their coupling; always positive definite. Pairwise: the error is O((a/r)^4)
         * of the mobility (Wajnryb et al., J. Fluid Mech. 731, R3, 2013). Cost: quadratic in
         * particles for each product; Periodic: as the box, on a grid, else dense.
         */
        RotnePragerYamakawa = 1,
        /**
         * Spheres with force, torque and stresslet, and pair lubrication from the exact two-sphere
         * resistance functions (Jeffrey and Onishi, J. Fluid Mech. 139, 261, 1984): exact for an
         * isolated pair at every gap. Spheres must not overlap; ratios of radii 0.1 to 10.
         * Unbounded or Periodic. Cost: cubic in bodies.
         */
        StokesianDynamics = 2,
        /**
         * Force coupling (Maxey and Patel, Int. J. Multiphase Flow 27, 1603, 2001; Lomholt and
         * Maxey, J. Comput. Phys. 184, 381, 2003): like RotnePragerYamakawa, with forces and
         * torques spread by Gaussians in place of surfaces; periodic fluids only. Unequal radii and
         * overlap allowed; always positive definite. Accuracy as RotnePragerYamakawa's. From 300
         * rows on, or with MatrixFree, on a grid (Yeo and Maxey, J. Comput. Phys. 229, 2401, 2010),
         * to the solver tolerance and at a cost that grows as the box; else dense.
         */
        ForceCoupling = 3
    };
    /** What bounds the fluid. */
    enum Boundary : int {
        /** Nothing: fluid at rest at infinity. */
        Unbounded = 0,
        /**
         * A plane z = setWallHeight() on which the fluid is at rest; the fluid is above it.
         * RotnePragerYamakawa only: its mobility with Blake's image, all blocks, unequal radii
         * (Swan and Brady, Phys. Fluids 19, 113306, 2007); positive definite where no particle
         * reaches through the wall. CustomRigidHIIntegrator::setWallRejection() says what happens
         * where one does. Cost: two to three times that of Unbounded.
         */
        NoSlipWall = 1,
        /**
         * The periodic box of the Context, triclinic ones too, as it is at each step: particles
         * feel all images of all others and of themselves. The mean velocity of fluid and bodies is
         * zero, and net forces are allowed: a uniform force density balances them.
         * RotnePragerYamakawa, StokesianDynamics and ForceCoupling, by lattice sums to 1e-13 of own
         * mobilities and dense matrices: up to 12000 rows (2000 spheres, 4000 blobs),
         * StokesianDynamics up to 1000 spheres; ForceCoupling and, of up to 8 radii,
         * RotnePragerYamakawa on a grid have no such limit, but boxes with edges along the axes. A
         * body must be shorter than the shortest lattice vector.
         */
        Periodic = 2,
        /**
         * Two walls, setChannelWalls(), that the fluid slips along; between them it is periodic in
         * the x and z edges of the Context's box, which must have its edges along the axes and a y
         * edge longer than the channel is wide. ForceCoupling only, by mirror images of period
         * twice the width: dense up to 2000 spheres or half as many blobs as Periodic, or on a
         * grid. Positive definite wherever centres are between the walls;
         * CustomRigidHIIntegrator::setWallRejection() says how near surfaces may come. Cost: on a
         * grid that of Periodic in a box of the channel's width, dense that of twice the particles
         * in twice the width.
         */
        SlipChannel = 3
    };
    /** What a single sphere above a NoSlipWall moves like. */
    enum SphereWallMobility : int {
        /** As the model says, which has no lubrication: at contact a quarter of the free mobility
           towards the wall is left. */
        FromModel = 0,
        /**
         * Like a rigid sphere alone above the wall, at every gap, to 3e-8: the exact solutions of
         * Dean and O'Neill, Mathematika 10, 13 (1963), and O'Neill, ibid. 11, 67 (1964), along the
         * wall, of Brenner, Chem. Eng. Sci. 16, 242 (1961), towards it, and of Jeffery, Proc. Lond.
         * Math. Soc. 14, 327 (1915), about the normal. Delong et al., J. Chem. Phys. 143, 144107
         * (2015), eqs. 94 to 97, approximate them to 4.4 %. Other spheres by congruence. For bodies
         * of one sphere and free particles; multiblobs stay as the model says.
         */
        BestKnown = 1
    };
    /** How the linear algebra is done. */
    enum Solver : int {
        /** Dense or matrix-free, by the numbers of rows of the matrices, never by a clock
           (default). */
        Auto = 0,
        /** Matrices are formed and decomposed. Memory quadratic, time cubic in bodies. */
        Dense = 1,
        /** Krylov methods (Lanczos) to the solver tolerance. Memory linear, time quadratic in
           particles. */
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
     * @throws OpenMMException if the radius is negative or not finite
     */
    int addParticle(double radius);
    /** Get the hydrodynamic radius of a particle, nm. */
    double getParticleRadius(int index) const;
    /** Set the hydrodynamic radius of a particle, nm; see updateParametersInContext(). Errors as
     * addParticle(). */
    void setParticleRadius(int index, double radius);
    /** Get the viscosity, dalton/(nm ps). */
    double getViscosity() const { return viscosity; }
    /**
     * Set the viscosity eta, dalton/(nm ps); 1 mPa s = 602.214076. Default: water at 298.15 K, 0.89
     * mPa s.
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
    /** Get the height of the NoSlipWall, nm. */
    double getWallHeight() const { return wallHeight; }
    /**
     * Set the z of the NoSlipWall, nm (default 0); other boundaries ignore it. Takes effect at
     * Context creation or reinitialize().
     *
     * @throws OpenMMException if not finite
     */
    void setWallHeight(double height);
    /** Get the walls of the SlipChannel, nm. */
    void getChannelWalls(double& yLow, double& yHigh) const {
        yLow = channelLow;
        yHigh = channelHigh;
    }
    /**
     * Set the y of both walls of the SlipChannel, nm (default 0 and 0, no channel: a Context with
     * this boundary is refused); other boundaries ignore them. Takes effect at Context creation or
     * reinitialize().
     *
     * @throws OpenMMException unless both are finite and yLow < yHigh
     */
    void setChannelWalls(double yLow, double yHigh);
    /** Get what a single sphere above a NoSlipWall moves like. */
    SphereWallMobility getSphereWallMobility() const { return sphereWallMobility; }
    /**
     * Set what a single sphere above a NoSlipWall moves like (default FromModel). Takes effect at
     * Context creation or reinitialize(). BestKnown needs a wall and the wall rejection Overlap:
     * without them no Context is created.
     */
    void setSphereWallMobility(SphereWallMobility mobility);
    /** Get whether StokesianDynamics includes lubrication. */
    bool getLubrication() const { return lubrication; }
    /** Set whether StokesianDynamics includes lubrication (default true; other models have none).
     */
    void setLubrication(bool enabled) { lubrication = enabled; }
    /** Get the smallest gap of StokesianDynamics. */
    double getMinimumGap() const { return minimumGap; }
    /**
     * Set the smallest gap between spheres for StokesianDynamics, relative to the mean of the two
     * radii (default 0). Smaller gaps, and overlaps, are treated as this one. With 0 a start with
     * overlapping spheres is refused, and a step after which spheres overlap is redone with new
     * noise.
     *
     * @throws OpenMMException if negative or not finite
     */
    void setMinimumGap(double gap);
    /** Get how the linear algebra is done. */
    Solver getSolver() const { return solver; }
    /**
     * Set how the linear algebra is done (default Auto). With LangevinHI the same seed gives the
     * same step either way, to the tolerance. In schemes without momenta Dense and MatrixFree take
     * different square roots of other random numbers: noise of the same law, but for the same seed
     * other trajectories. So Auto, which goes by the number of rows, has other noise for a larger
     * scene. applyMobilityInContext() goes the same way, whatever masses there are;
     * CustomRigidHIIntegrator::getEffects() says which.
     */
    void setSolver(Solver solver);
    /** Get the relative tolerance of MatrixFree. */
    double getSolverTolerance() const { return solverTolerance; }
    /**
     * Set the relative tolerance of MatrixFree (default 1e-6). LangevinHI: in the norm of
     * mass-weighted momenta, one step differs from the Dense one by at most five times this.
     * Schemes without momenta: velocities that belong to forces have at most this error in the norm
     * of the friction, random ones at most five times this in the norm of velocities over the roots
     * of the particles' (multiblobs: bodies') own mobilities. Or an exception says what was
     * reached.
     *
     * @throws OpenMMException if not between 1e-14 and 0.1
     */
    void setSolverTolerance(double tolerance);
    /** Get the largest spacing of the nodes of a grid, nm; 0: as the solver tolerance wants. */
    double getGridSpacing() const { return gridSpacing; }
    /**
     * Set the largest spacing of the nodes where a fluid is on a grid (Periodic or SlipChannel,
     * MatrixFree), nm; the grid has the next number of nodes without prime factors above 7. 0
     * (default): so that products have the solver tolerance. Another spacing means, for
     * ForceCoupling, another tolerance of products, which
     * CustomRigidHIIntegrator::describeEffects() says; for RotnePragerYamakawa, more pairs or fewer
     * at the same tolerance.
     *
     * @throws OpenMMException if negative or not finite
     */
    void setGridSpacing(double spacing);
    /** Get whether products with the mobility of many particles may be done by multipoles. */
    bool getFastSummation() const { return fastSummation; }
    /**
     * Set whether products with the mobility of many particles may be done by multipoles (default
     * true): RotnePragerYamakawa, Unbounded or NoSlipWall, on platforms that have it (all but
     * Reference), MatrixFree. Then products that a tolerance is good enough for take a time that
     * grows little faster than the number of particles: answers of applyMobilityInContext() for
     * spheres, to the solver tolerance from 1e-6 on, and those of iterations whose tolerance is
     * 5e-5 or more, to 1e-6. The numbers of particles from which it is done follow from the
     * tolerance alone; CustomRigidHIIntegrator::getEffects() says it. Other products are sums over
     * all pairs, to rounding, and all are if this is false.
     */
    void setFastSummation(bool enabled) { fastSummation = enabled; }

    /** Get the flow that setBackgroundFlow() has set: nm/ps, and 9 numbers dv_a/dx_b in rows a,
     * 1/ps. */
    void getBackgroundFlow(OpenMM::Vec3& velocity, std::vector<double>& gradient) const {
        velocity = flowVelocity;
        gradient = flowGradient;
    }
    /**
     * Set a flow that is there without bodies, v(x) = velocity + gradient x, x from the origin of
     * coordinates (default: none). Bodies are carried and turned by it: with the slip v(x) at
     * blobs, and v(x) and half the curl of v at spheres (Westwood 2022, eq. 33). Spheres of
     * StokesianDynamics resist the strain by their stresslets, without lubrication of the strain;
     * spheres of other models, and bodies' own tensors, do not, multiblobs do by their blobs.
     *
     * With the boundary Unbounded, and with NoSlipWall if it is 0 at the wall; other boundaries
     * with a flow are refused at Context creation. Schemes without momenta, and LangevinHI, whose
     * friction is that of the velocities relative to those with which bodies free of forces go with
     * the flow.
     *
     * @param velocity  at the origin, nm/ps
     * @param gradient  9 numbers dv_a/dx_b, row after row, 1/ps
     * @throws OpenMMException if there are not 9 numbers, one of all is not finite, or the trace is
     * not 0 to 1e-12 (the fluid is incompressible)
     */
    void setBackgroundFlow(const OpenMM::Vec3& velocity, const std::vector<double>& gradient);
    /** Get the force density that setSinusoidalForceDensity() has set: kJ/(mol nm^4), axes, number
     * of waves. */
    void getSinusoidalForceDensity(double& f0, int& forceAxis, int& waveAxis,
                                   int& waveVectorIndex) const;
    /**
     * Drive the fluid by a force density f0 sin(k x_waveAxis) along forceAxis, k = 2 pi
     * waveVectorIndex/L, L the edge of the Context's box along waveAxis (default: f0 = 0, none).
     * Without bodies it makes the flow f0/(eta k^2) sin(k x_waveAxis). Blobs have the slip of its
     * average over their surface or Gaussian, spheres with torque of its average curl too (Westwood
     * 2022, section 6.4); stresslets as in setBackgroundFlow().
     *
     * With the boundary Periodic, and with SlipChannel if both axes are along the walls; other
     * boundaries with f0 not 0 are refused at Context creation, and so are waves that are not
     * periodic in a triclinic box, or too short for a grid.
     *
     * @param f0               kJ/(mol nm^4)
     * @param forceAxis        0, 1, 2: x, y, z
     * @param waveAxis         likewise, another one
     * @param waveVectorIndex  periods of the wave in the box, at least 1
     * @throws OpenMMException if one of these is not so
     */
    void setSinusoidalForceDensity(double f0, int forceAxis, int waveAxis, int waveVectorIndex);

    /**
     * Give a body a mobility tensor of its own: its velocity and angular velocity (about its
     * origin) from force and torque, when alone in unbounded fluid, body frame. FreeDraining takes
     * it as it is; with RotnePragerYamakawa it is combined with the interactions by congruence, N =
     * B N_RPY B^T, B = N_own^(1/2) N_RPY,alone^(-1/2): exact for a body alone, positive definite
     * always. Interactions are scaled by B on both sides: give the particles radii whose own tensor
     * is near it.
     *
     * @param body      index of the body
     * @param mobility  36 numbers, rows Vx Vy Vz Wx Wy Wz, columns Fx Fy Fz Tx Ty Tz, body frame;
     * nm/ps per kJ/(mol nm), ...
     * @throws OpenMMException if not 36 finite numbers, not symmetric to 1e-9, or not positive
     * definite
     */
    void setBodyMobility(int body, const std::vector<double>& mobility);
    /** Likewise by its inverse, the friction tensor: force and torque that a moving body exerts on
     * the fluid. */
    void setBodyFriction(int body, const std::vector<double>& friction);
    /** Get whether a body has a tensor of its own. */
    bool getBodyHasOwnTensor(int body) const { return ownTensors.count(body) > 0; }
    /** Get whether a body's own tensor was given as friction. @throws OpenMMException if it has
     * none */
    bool getBodyTensorIsFriction(int body) const;
    /** Get a body's own mobility tensor, 36 numbers. @throws OpenMMException if it has none */
    std::vector<double> getBodyMobility(int body) const;
    /** Get a body's own friction tensor, 36 numbers. @throws OpenMMException if it has none */
    std::vector<double> getBodyFriction(int body) const;
    /** Take a body's own tensor away. */
    void clearBodyTensor(int body);
    /** Get the bodies with tensors of their own. */
    std::vector<int> getBodiesWithOwnTensors() const;

    /** Get the group of each body; empty: all in one. */
    const std::vector<int>& getGroups() const { return groups; }
    /**
     * Set which bodies feel each other through the fluid: only those of one group (replicas of a
     * scene in one Context, at a cost linear in groups). Default, or empty: all. Hydrodynamic
     * particles that are in no body belong to group 0.
     *
     * Groups are meant to be independent: without momenta, a step that one must redo (at a wall,
     * for overlap) is redone for it alone, and what the others do is the same bit for bit. OpenMM
     * forces between groups break that: in schemes with forces in between, these may have felt
     * poses that were rejected. LangevinHI redoes a step for all groups.
     *
     * @param groups  a number from 0 up for each body
     * @throws OpenMMException if one is negative
     */
    void setGroups(const std::vector<int>& groups);

    /**
     * Hand changed viscosity, radii, own tensors, lubrication, minimum gap, solver, tolerance and
     * flow to a Context. A radius may not change between 0 and not 0; model, boundary, wall height,
     * sphere-wall mobility and groups need reinitialize().
     */
    void updateParametersInContext(OpenMM::Context& context);
    /**
     * Get the mobility matrix of the bodies at their present poses: 6n x 6n numbers, row after row;
     * rows per body Vx Vy Vz Wx Wy Wz about the body's origin, columns Fx Fy Fz Tx Ty Tz, lab
     * frame, OpenMM units. Free particles are force-free. By dense matrices; MatrixFree iterates
     * column by column, to its tolerance, where that takes less time: bodies of 850 blobs and more
     * on the CPU platform, 3500 on Reference. CustomRigidHIIntegrator::getEffects() says which way
     * it goes ("mobilities asked for").
     */
    std::vector<double> getMobilityInContext(OpenMM::Context& context) const;
    /** Get its inverse, the friction matrix (pseudo-inverse for bodies whose blobs are on a line).
     * Always by dense matrices. */
    std::vector<double> getFrictionInContext(OpenMM::Context& context) const;
    /**
     * Get the velocities that forces and torques on the bodies would give without inertia: mobility
     * times wrenches. Dense or matrix-free as setSolver() says; of spheres always a product,
     * without a matrix: to rounding, or where setFastSummation() has it to the solver tolerance.
     *
     * @param wrenches  6 numbers per body, Fx Fy Fz Tx Ty Tz about the body's origin, lab frame
     * @return 6 numbers per body, Vx Vy Vz Wx Wy Wz
     */
    std::vector<double> applyMobilityInContext(OpenMM::Context& context,
                                               const std::vector<double>& wrenches) const;
    /**
     * Get the velocities that forces on the hydrodynamic particles would give if each of them were
     * free: the mobility of blobs, without the rigidity of bodies. Blobs, spheres and free
     * particles are where they are at present; spheres (one particle in a body) feel no torque, and
     * their angular velocities are not given. Particles feel each other as bodies do: those of one
     * group of setGroups(), or under FreeDraining those of one body. Tensors of setBodyMobility()
     * and setBodyFriction() belong to bodies and have no effect. Nothing is solved for: one product
     * with the model's matrix for each group, whatever the solver (StokesianDynamics makes its
     * matrix).
     *
     * @param forces  3 numbers for each particle of the System, Fx Fy Fz, lab frame; those on
     * particles that the fluid does not see count not
     * @return 3 numbers for each particle of the System, Vx Vy Vz; 0 for those that the fluid does
     * not see
     */
    std::vector<double> applyBlobMobilityInContext(OpenMM::Context& context,
                                                   const std::vector<double>& forces) const;

    /**
     * Get the velocities of the fluid at points, nm/ps, lab frame: the driven flow and what bodies
     * make of it, over all space (within a particle that of its spread forces).
     *
     * Schemes without momenta: the flow of the last step, at the poses where it had its forces (of
     * DriftCorrectorFD and DriftCorrectorRFD, and FixmanMidpoint, the mid-point): driven flow, nu
     * times the random flow, and the flow of the forces that kept bodies rigid. Its mean has the
     * Brownian stress; a mean of forces alone has not. A model's own random field (a grid) is in it
     * with all its modes; without one the random flow is the mean of those that fit the particles'
     * random velocities. Before a step, or after poses or parameters were changed: without noise,
     * at the present poses under the present forces. LangevinHI: that of the friction forces at
     * present poses and velocities.
     *
     * The last step is saved in checkpoints and States. Cost: that of a step, and the work of each
     * particle at each point; on a grid of each node at each point.
     *
     * @param points  nm
     * @throws OpenMMException if one is not finite or behind a wall, for several groups of
     * setGroups(), and for FreeDraining
     */
    std::vector<OpenMM::Vec3> getFlowInContext(OpenMM::Context& context,
                                               const std::vector<OpenMM::Vec3>& points) const;
    /**
     * Get the amplitudes of sin(k x_waveAxis) and of cos(k x_waveAxis) in the component forceAxis
     * of the same flow, k = 2 pi waveVectorIndex/L, nm/ps: two numbers. Exact, without a grid:
     * (2/(eta k^2 V)) times the power of the forces on such a flow (docs/THEORY.md). For the
     * boundaries Periodic and SlipChannel (axes along its walls).
     *
     * @throws OpenMMException as getFlowInContext(), and for axes or an index as
     * setSinusoidalForceDensity(), and other boundaries
     */
    std::vector<double> getFlowModeInContext(OpenMM::Context& context, int forceAxis, int waveAxis,
                                             int waveVectorIndex) const;
    /**
     * Likewise of the random field of the last step alone, without nu: the part of the noise that
     * the model draws itself, on a grid; 0 where there is none. Its mean is 0, so a multiple of it
     * may be subtracted from getFlowModeInContext() to have a smaller error of the mean.
     */
    std::vector<double> getRandomFlowModeInContext(OpenMM::Context& context, int forceAxis,
                                                   int waveAxis, int waveVectorIndex) const;

    /**
     * Get whether the fluid is periodic. OpenMM then has a box, and bodies that OpenMM does not
     * know to be molecules are refused at Context creation.
     */
    bool usesPeriodicBoundaryConditions() const override;

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
    Solver solver;
    bool lubrication, fastSummation = true;
    double forceDensity = 0;
    int forceAxis = 0, waveAxis = 1, waveVectorIndex = 1;
    OpenMM::Vec3 flowVelocity;
    std::vector<double> flowGradient = std::vector<double>(9, 0.0);
    std::map<int, OwnTensor> ownTensors;
    std::vector<int> groups;
};

}  // namespace RigidHIPlugin

#endif
