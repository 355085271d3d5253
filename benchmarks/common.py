"""What the benchmarks share: a description of the machine, saving of results, and scenes."""
from instructions import keepToAvx2IfAsked, keptToAvx2

keepToAvx2IfAsked()
import datetime  # noqa: E402  (what is set above is set before numpy is imported)
import json  # noqa: E402
import os  # noqa: E402
import pathlib  # noqa: E402
import platform  # noqa: E402
import time  # noqa: E402

import numpy as np  # noqa: E402
import openmm  # noqa: E402
from openmm import app, unit  # noqa: E402

import openmmrigidhi  # noqa: E402

RESULTS = pathlib.Path(__file__).parent/'results'


def describeMachine():
    """The machine and the versions; load averages tell whether others were using the machine."""
    processors = [
        line.split(':')[1].strip() for line in open('/proc/cpuinfo')
        if line.startswith('model name')
    ]
    flags = next((line for line in open('/proc/cpuinfo') if line.startswith('flags')), '').split()
    return {
        'processor': processors[0] if processors else platform.processor(),
        'cores': os.cpu_count(),
        'avx512': 'avx512f' in flags,
        'kept_to_avx2': keptToAvx2(),
        'system': platform.system() + ' ' + platform.release().split('-')[0],
        'python': platform.python_version(),
        'openmm': openmm.version.short_version,
        'openmmrigidhi': openmmrigidhi.__version__,
        'load_average_before': round(os.getloadavg()[0], 2),
        'date': datetime.datetime.now(datetime.timezone.utc).strftime('%Y-%m-%d %H:%M UTC')
    }


def save(output, name, machine, result):
    """Write a result as JSON, with the description made at the start, and the load at the end."""
    output.mkdir(parents=True, exist_ok=True)
    machine = dict(machine, load_average_after=round(os.getloadavg()[0], 2))
    (output/name).write_text(json.dumps({'machine': machine, **result}, indent=1) + '\n')


def spread(values):
    """Median and quartiles of values."""
    low, middle, high = np.percentile(values, (25, 50, 75))
    return {
        'median': round(float(middle), 6),
        'quartiles': [round(float(low), 6), round(float(high), 6)]
    }


def show(values, digits=3):
    """A result of spread() as text."""
    return (f'{values["median"]:.{digits}f} ({values["quartiles"][0]:.{digits}f} ... '
            f'{values["quartiles"][1]:.{digits}f})')


def waterBox(molecules, density=989.85):
    """(topology, positions) of TIP4P-Ew molecules on a lattice, at random orientations.

    The density is in kg/m^3.
    """
    forceField = app.ForceField('tip4pew.xml')
    random = np.random.default_rng(1)
    edge = (molecules*18.01528/(density*0.602214076))**(1/3)  # nm
    side = int(np.ceil(molecules**(1/3) - 1e-9))
    cells = np.array(list(np.ndindex(side, side, side)))[:molecules]
    angle = np.deg2rad(104.52)
    shape = 0.09572*np.array([(0, 0, 0), (1, 0, 0), (np.cos(angle), np.sin(angle), 0)])
    topology = app.Topology()
    topology.setPeriodicBoxVectors(np.eye(3)*edge*unit.nanometer)
    chain = topology.addChain()
    positions = []
    for cell in cells:
        residue = topology.addResidue('HOH', chain)
        oxygen, *hydrogens = [
            topology.addAtom(name, app.Element.getBySymbol(name[0]), residue)
            for name in ('O', 'H1', 'H2')
        ]
        for hydrogen in hydrogens:
            topology.addBond(oxygen, hydrogen)
        rotation = np.linalg.qr(random.normal(size=(3, 3)))[0]
        positions.extend((cell + 0.5)*edge/side + shape @ rotation)
    modeller = app.Modeller(topology, np.array(positions)*unit.nanometer)
    modeller.addExtraParticles(forceField)
    return modeller.topology, modeller.positions


def spheresAtRandom(count, fraction=0.1, seed=1):
    """Centres (count, 3) of spheres of radius 1 near points of a cubic lattice, without overlap."""
    spacing = (4*np.pi/3/fraction)**(1/3)
    side = int(np.ceil(count**(1/3) - 1e-9))
    cells = np.array(list(np.ndindex(side, side, side)))[:count]
    # The displacements leave gaps of at least 0.02 between neighbours.
    reach = (spacing - 2.02)/2
    return spacing*cells + np.random.default_rng(seed).uniform(-reach, reach, (count, 3))


def fluidScene(centres, model=None, blobs=0, temperature=300, rate_step=1.0, free=False,
               solver=None, tolerance=None, lubrication=True, scheme=None, platform='CPU',
               threads=1, density=1000.0, edge=None, tilt=0.0, shear=None):
    """Spheres of radius 1 nm in water: (integrator, Context).

    Parameters
    ----------
    blobs : int
        number of blobs of each sphere, which is a multiblob then
    rate_step : float
        Stokes friction over mass, times the time step
    free : bool
        whether spheres are free particles, which do not rotate
    scheme : int, optional
        default: LangevinHI; any other scheme runs without a fluid, unless there is an edge
    edge : float, optional
        edge of a periodic box, nm; by default the fluid is unbounded
    tilt, shear : float
        tilt of this box along x, over its edge, and rate of the shear that tilts it, 1/ps
    """
    from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce
    fluid, system = MobilityForce(), openmm.System()
    mass = density*0.602214076*4/3*np.pi
    step = rate_step*mass/(6*np.pi*fluid.getViscosity()._value)
    integrator = CustomRigidHIIntegrator(temperature, step)
    integrator.setScheme(CustomRigidHIIntegrator.LangevinHI if scheme is None else scheme)
    integrator.setRandomNumberSeed(1)
    sites, radius = np.zeros((1, 3)), 1.0
    if blobs:
        sites, radius = (x._value for x in openmmrigidhi.app.multiblobSphere(blobs, 1.0))
    positions = []
    for centre in centres:
        members = [system.addParticle(mass if free else 0.0) for _ in sites]
        for _ in sites:
            fluid.addParticle(radius)
        if not free:
            integrator.addRigidBody(members, mass, (0.4*mass,)*3, sites)
        positions.extend(centre + sites)
    if model is not None:
        fluid.setModel(model)
    if solver is not None:
        fluid.setSolver(solver)
    if tolerance is not None:
        fluid.setSolverTolerance(tolerance)
    if not lubrication:
        fluid.setLubrication(False)
    elif edge is not None:
        fluid.setLubrication(True)
    if edge is not None:
        fluid.setBoundary(MobilityForce.Periodic)
        system.setDefaultPeriodicBoxVectors((edge, 0, 0), (tilt*edge, edge, 0), (0, 0, edge))
    if shear is not None:
        fluid.setShear(shear, 0, 1)
    if scheme is None or edge is not None:
        system.addForce(fluid)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName(platform),
                             {'Threads': str(threads)} if platform == 'CPU' else {})
    context.setPositions(positions)
    context.setVelocitiesToTemperature(300, 1)
    return integrator, context


def ownSeconds(integrator, steps, threads=1):
    """Seconds a step without force evaluations: seconds_mobility + seconds_scheme.

    With one thread, the process's CPU time if it is less. Both times are upper bounds: on a busy
    machine the clock also counts what other processes compute.
    """
    before, cpu = integrator.getStepStatistics(), time.process_time()
    integrator.step(steps)
    cpu, after = time.process_time() - cpu, integrator.getStepStatistics()
    wall = sum(after[key] - before[key] for key in ('seconds_mobility', 'seconds_scheme'))
    return (min(wall, cpu) if threads == 1 else wall)/steps


def stepsFor(integrator, seconds):
    """How many steps take this time. Makes a few steps."""
    integrator.step(2)
    return int(min(2000, max(1, round(seconds/max(1e-7, ownSeconds(integrator, 1))))))
