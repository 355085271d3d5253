"""Hard spheres in a periodic box: configurations, a fluid around them, and published fits.

The radius of a sphere is 1, and the viscosity of the fluid is 1.
"""
import numpy as np
import openmm
from scipy.spatial import cKDTree

from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce, app

#: Monte Carlo sweeps of spheres of radius 1; those before, at the volume fraction MELTING.
SWEEPS, SWEEPS_OF_MELTING, MELTING = 400, 100, 0.2


def fits(phi):
    """D_s, D_r, K and the viscosity of hard spheres at short times, over those at infinite
    dilution: fits to published results."""
    x = phi*(1 + phi - 0.189*phi**2)
    return {
        'D_s': 1 - 1.8315*phi*(1 + 0.1195*phi - 0.70*phi**2),
        'D_r': 1 - 0.631*phi - 0.726*phi**2,
        'K': 1 - 6.546*phi*(1 - 3.348*phi + 7.426*phi**2 - 10.034*phi**3 + 5.882*phi**4),
        'viscosity': (1 + 1.5*x)/(1 - x)
    }


def compressibility(phi):
    """S(0) of hard spheres by Carnahan and Starling."""
    return (1 - phi)**4/((1 + 2*phi)**2 + phi**3*(phi - 4))


def contactValue(phi):
    """The pair distribution of hard spheres at contact by Carnahan and Starling."""
    return (1 - phi/2)/(1 - phi)**3


def imagesOf(phi, number, viscosity):
    """What periodic images take from D_s, over that of one sphere alone (Ladd 1990).

    The viscosity is that of the suspension. Of K they take so much times S(0).
    """
    return 1.7601*(phi/number)**(1/3)/viscosity


def edgeOf(number, phi):
    """The edge of a cube with so many spheres of radius 1."""
    return (4*np.pi/3*number/phi)**(1/3)


def hardSpheres(number, phi, random):
    """Centres of 4 k^3 spheres of radius 1 in a cube, in equilibrium; and the edge of the cube.

    A lattice of smaller spheres melts at the volume fraction 0.2. The spheres then grow as far as
    there is room, until their radius is 1. At 0.45 a lattice of whole spheres would not melt for
    thousands of sweeps. SWEEPS Monte Carlo sweeps follow.
    """
    edge = edgeOf(number, phi)
    cells = round((number/4)**(1/3))
    corner = np.array([(0, 0, 0), (1, 1, 0), (1, 0, 1), (0, 1, 1)])/2
    places = np.stack(np.meshgrid(*[np.arange(cells)]*3), axis=-1).reshape(-1, 1, 3) + corner
    x = places.reshape(-1, 3)*edge/cells
    diameter = 2*min(1, (MELTING/phi)**(1/3))
    for _ in range(SWEEPS_OF_MELTING):
        sweep(x, edge, diameter, random)
    while diameter < 2:
        sweep(x, edge, diameter, random)
        nearest = cKDTree(x % edge, boxsize=edge).query(x % edge, 2)[0][:, 1].min()
        diameter = min(2, nearest)
    for _ in range(SWEEPS):
        sweep(x, edge, 2, random)
    return x, edge


def sweep(x, edge, diameter, random):
    """Try to move each sphere of a diameter once."""
    number = len(x)
    length = 0.3*(edge/number**(1/3) - diameter) + 0.05
    # No sphere moves more than `length` along an axis in a sweep: others are far away.
    near = cKDTree(x % edge, boxsize=edge).query_ball_point(x % edge, diameter + 4*length)
    for i in random.permutation(number):
        others = [j for j in near[i] if j != i]
        trial = x[i] + length*(2*random.random(3) - 1)
        d = trial - x[others]
        d -= edge*np.round(d/edge)
        if (d*d).sum(axis=1).min(initial=9) > diameter**2:
            x[i] = trial


def latticeOrder(x, edge):
    """Mean intensity of the four waves of the lattice that hardSpheres() starts from.

    It is the number of spheres for the lattice, and that of S(k) in a fluid, some 1 to 3.
    """
    wave = 2*np.pi/edge*round((len(x)/4)**(1/3))
    k = wave*np.array([(1, 1, 1), (1, 1, -1), (1, -1, 1), (-1, 1, 1)])
    return float((abs(np.exp(1j*x @ k.T).sum(axis=0))**2).mean()/len(x))


def periodicFluid(model, reach, x, box, shear=None, sites=((0, 0, 0),), radius=1.0, turns=None,
                  scheme='EulerMaruyama', temperature=0, step=0.01, seed=1, forces=()):
    """A Context of spheres or shells in a periodic fluid, its MobilityForce and its integrator.

    Parameters
    ----------
    model : str
    reach : (float, float) or None
        of lubrication, in mean radii; None: there is no lubrication
    x : array of shape (n, 3)
    box : float or array of shape (3, 3)
        edge of a cube, or vectors of a tilted box as rows
    shear : (float, int, int), optional
        rate, and axes of the flow and of its gradient
    sites, radius
        of the blobs of a shell; by default a sphere of radius 1
    turns : array of shape (n, 4), optional
        orientations of shells
    scheme, temperature, step, seed
        of the integrator
    forces : sequence of openmm.Force
        more of the System
    """
    system, fluid = openmm.System(), MobilityForce()
    integrator = CustomRigidHIIntegrator(temperature, step)
    integrator.setScheme(scheme)
    integrator.setRandomNumberSeed(seed)
    for _ in x:
        app.addRigidMultiblob(system, integrator, fluid, sites, radius)
    fluid.setViscosity(1)
    fluid.setModel(model)
    fluid.setBoundary(MobilityForce.Periodic)
    fluid.setSolver(MobilityForce.Dense)
    fluid.setLubrication(reach is not None)
    fluid.setLubricationReach(*(reach or (0, 0)))
    if shear:
        fluid.setShear(*shear)
    system.addForce(fluid)
    for force in forces:
        system.addForce(force)
    system.setDefaultPeriodicBoxVectors(*(np.eye(3)*box if np.ndim(box) == 0 else box).tolist())
    app.bindBodies(system, integrator)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('CPU'),
                             {'Threads': '1'})
    context.setPositions(np.repeat(x, len(sites), axis=0) + np.tile(sites, (len(x), 1)))
    integrator.setBodyPositions(x)
    if turns is not None:
        integrator.setBodyOrientations(turns)
    return context, fluid, integrator
