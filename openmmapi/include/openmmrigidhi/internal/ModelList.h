#ifndef OPENMMRIGIDHI_MODEL_LIST_H_
#define OPENMMRIGIDHI_MODEL_LIST_H_

/**
 * The one list of boundaries of the fluid and the one list of hydrodynamic models, each in the
 * order of their numbers. A new boundary or model is a line at the end. The lists generate the
 * enumerations in C++ and Python, names in XML and messages, checks of combinations, docstrings,
 * the tables of the pages, and the lists in the tests.
 *
 * ROW(name, isPeriodic, wallAxis, lowWall, highWall, walls, description)
 *   name         of the enumerator of MobilityForce
 *   isPeriodic   whether the fluid fills the periodic box of the Context
 *   wallAxis     the axis that crosses the walls, 0 to 2; -1 without walls
 *   lowWall      the wall below the fluid (WallKind): NoWall; NoSlip: the fluid is at rest on it;
 *                Slip: the fluid slips along it without friction. A single wall is at
 *                setWallHeight(), two are at setChannelWalls()
 *   highWall     the wall above the fluid, likewise
 *   walls        what the walls are, a few words for descriptions; empty without walls
 *   description  a sentence or two for docstrings and tables
 */
#define RIGIDHI_BOUNDARIES(ROW)                                                                   \
    ROW(Unbounded, false, -1, NoWall, NoWall, "",                                                 \
        "Nothing bounds the fluid, which is at rest at infinity.")                                \
    ROW(NoSlipWall, false, 2, NoSlip, NoWall, "a no-slip wall",                                   \
        "The plane z = setWallHeight() bounds the fluid, which is above it and at rest on it.")   \
    ROW(Periodic, true, -1, NoWall, NoWall, "",                                                   \
        "The fluid fills the periodic box of the Context, as the box is at each step. Under "     \
        "FreeDraining nothing changes compared with Unbounded.")                                  \
    ROW(SlipChannel, true, 1, Slip, Slip, "slip walls",                                           \
        "Two walls y = const (setChannelWalls()) bound the fluid, which slips along them and is " \
        "periodic in x and z.")                                                                   \
    ROW(PeriodicWall, true, 2, NoSlip, NoWall, "a no-slip wall",                                  \
        "The plane z = setWallHeight() bounds the fluid, which is above it, at rest on it, "      \
        "and periodic in x and y.")                                                               \
    ROW(NoSlipChannel, true, 2, NoSlip, NoSlip, "no-slip walls",                                  \
        "Two walls z = const (setChannelWalls()) bound the fluid, which is at rest on them and "  \
        "periodic in x and y. setChannelCondition() says what drives or stops the mean flow.")    \
    ROW(Film, true, 2, NoSlip, Slip, "a no-slip wall and a free surface",                         \
        "The fluid is at rest on the wall z = low (setChannelWalls()), slips along the flat "     \
        "free surface z = high, and is periodic in x and y.")

/**
 * ROW(name, boundaries, grids, takesOverlap, takesMultiblobs, couplesBodies, interactions, cost,
 *     description)
 *   name             of the enumerator of MobilityForce, and of the model's page in docs/models
 *   boundaries       that the model has, separated by |
 *   grids            the boundaries with which a grid can take the place of matrices; 0: none
 *   takesOverlap     whether spheres may overlap each other
 *   takesMultiblobs  whether bodies may have several particles or tensors of their own, and
 *                    particles may be in no body; if not, bodies are single spheres
 *   couplesBodies    whether bodies feel each other
 *   interactions     a few words for tables
 *   cost             likewise, for tables and docstrings
 *   description      sentences for docstrings, with the papers
 */
#define RIGIDHI_MODELS(ROW)                                                                        \
    ROW(FreeDraining, Unbounded | Periodic, 0, true, true, false, "none between bodies",           \
        "linear in the number of bodies",                                                          \
        "Bodies do not interact through the fluid. A sphere has its Stokes drag, and a "           \
        "multiblob has its own constant tensor.")                                                  \
    ROW(RotnePragerYamakawa, Unbounded | NoSlipWall | Periodic | PeriodicWall | NoSlipChannel,     \
        Periodic | PeriodicWall | NoSlipChannel, true, true, true,                                 \
        "pairs, with lubrication on request",                                                      \
        "a product is quadratic in the number of particles, nearly linear by multipoles "          \
        "(thousands of particles and more), or proportional to the volume of the fluid on a grid " \
        "(periodic boundaries); dense matrices are cubic",                                         \
        "Pairs of particles interact. A particle is a sphere or a blob. The mobility of a pair "   \
        "follows from surface averages of a point force, with rotation. Radii may be unequal. "    \
        "The mobility is always positive definite. Without lubrication, which setLubrication() "   \
        "adds for spheres, the relative error is O((a/r)^4) (Wajnryb et al., J. Fluid Mech. 731, " \
        "R3, 2013). setFastSummation() says which products use multipoles. With a periodic "       \
        "boundary and MatrixFree, a product is a sum over pairs and over waves on a grid (Fiore "  \
        "et al., J. Chem. Phys. 146, 124116, 2017).")                                              \
    ROW(StokesianDynamics, Unbounded | Periodic, Periodic, false, false, true,                     \
        "many-body far field, exact lubrication of pairs",                                         \
        "cubic in the number of spheres, with a large factor; proportional to the volume of the "  \
        "fluid on a grid (Periodic)",                                                              \
        "Spheres interact, with lubrication of pairs. Forces, torques and stresslets of all "      \
        "spheres interact together. The lubrication of each pair is exact. The model is exact "    \
        "for two spheres at every gap (Jeffrey and Onishi, J. Fluid Mech. 139, 261, 1984). "       \
        "Ratios of radii are from 0.1 to 10. With the boundary Periodic and MatrixFree, a "        \
        "product is a sum over pairs and over waves on a grid.")                                   \
    ROW(ForceCoupling, Periodic | SlipChannel | PeriodicWall | NoSlipChannel | Film,               \
        Periodic | SlipChannel | PeriodicWall | NoSlipChannel | Film, true, true, true,            \
        "as in RotnePragerYamakawa, by Gaussians",                                                 \
        "proportional to the volume of the box on a grid; few particles take dense matrices",      \
        "Particles interact by Gaussian force densities. The model is like RotnePragerYamakawa, "  \
        "with Gaussians in place of surfaces. A grid couples many particles; few particles, and "  \
        "dilute suspensions, take dense matrices. Radii may be unequal. The mobility is "          \
        "always positive semidefinite (Maxey and Patel, Int. J. Multiphase Flow 27, 1603, 2001; "  \
        "Lomholt and Maxey, J. Comput. Phys. 184, 381, 2003; grids: Yeo and Maxey, J. Comput. "    \
        "Phys. 229, 2401, 2010).")

#endif
