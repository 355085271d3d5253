#!/usr/bin/env python3
"""Rigid proteins with all their atoms and PME in a periodic fluid: runs, resumed runs, costs.

Eight villin headpieces (from the PDB file that comes with OpenMM, with all hydrogens) are in a box
of 7.2 nm. NonbondedForce with PME acts between atoms, with the charges and Lennard-Jones parameters
of amber14. Water molecules are left out: charges are divided by sqrt(78.4), so that Coulomb's law
is the law in water. Each protein is one rigid body. In the same box a MobilityForce stands for the
water around the proteins: ForceCoupling with periodic images, a blob at every C-alpha, on a grid.
The proteins move by LangevinHI, with inertia, and by DriftCorrectorFD, without inertia. The script
checks that saved runs resume exactly, and measures what the fluid costs beside the forces.

    python3 run.py --output results      # half an hour on one core
    python3 run.py --quick               # seconds: three proteins
    python3 run.py --pdb my_protein.pdb  # another protein; hydrogens are added if there are none
"""
import argparse
import functools
import pathlib
import sys
import time

import numpy as np
import openmm
from openmm import app, unit
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from tqdm import tqdm

import openmmrigidhi
from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce

HERE = pathlib.Path(__file__).resolve().parent
sys.path.append(str(HERE.parents[1]/'validation'/'common'))
from recording import provenance, pyplot, save  # noqa: E402

STRUCTURE = pathlib.Path(
    app.__file__).parent/'data'/'test.pdb'  # villin in water; the water is left out
BLOB_RADIUS = 0.61  # nm, one bead a residue: Ortega et al., Biophys. J. 101, 892 (2011)
TEMPERATURE = 298.15  # K
VISCOSITY = 0.890  # mPa s, water at 298.15 K
PERMITTIVITY = 78.4  # of water at 298.15 K
SPACING = 3.6  # nm between the places where proteins start; a villin is 3.0 nm long
CUTOFF = 1.0  # nm
TOLERANCE = 1e-3  # tolerance of the fluid: of the grid and of the iterations
STEP = {
    'LangevinHI': 0.02,
    'DriftCorrectorFD': 0.05
}  # ps; momenta relax in 0.24 ps (translation) and 0.04 ps (rotation)
SAMPLE = 0.1  # ps
GAS_CONSTANT = unit.MOLAR_GAS_CONSTANT_R.value_in_unit(unit.kilojoule_per_mole/unit.kelvin)


# ---- The scene -----------------------------------------------------------------------------------
def isCAlpha(atom):
    return atom.name == 'CA' and atom.element is app.element.carbon


def readProtein(path=STRUCTURE):
    """Topology and positions of the protein in a PDB file, with hydrogens.

    Positions have the shape (atoms, 3), in nm, relative to their mean.
    """
    pdb = app.PDBFile(str(path))
    protein = app.Modeller(pdb.topology, pdb.positions)
    protein.delete([
        residue for residue in protein.topology.residues()
        if not any(isCAlpha(atom) for atom in residue.atoms())
    ])
    if not any(atom.element is app.element.hydrogen for atom in protein.topology.atoms()):
        protein.addHydrogens(app.ForceField('amber14/protein.ff14SB.xml'))
    positions = np.array(protein.positions.value_in_unit(unit.nanometer))
    return protein.topology, positions - positions.mean(0)


@functools.lru_cache(maxsize=None)
def makeSystem(cells, structure):
    """Topology and System of one protein for each cell, and the charge of all atoms, e.

    The System has a NonbondedForce alone.
    """
    topology, shape = readProtein(structure)
    model = app.Modeller(topology, shape*unit.nanometer)
    for _ in range(int(np.prod(cells)) - 1):
        model.add(topology, shape*unit.nanometer)
    model.topology.setUnitCellDimensions(openmm.Vec3(*(SPACING*np.array(cells)))*unit.nanometer)
    system = app.ForceField('amber14/protein.ff14SB.xml').createSystem(
        model.topology, nonbondedMethod=app.PME, nonbondedCutoff=CUTOFF*unit.nanometer,
        removeCMMotion=False)
    # Bonds, angles and torsions do nothing in rigid bodies.
    for k in reversed(range(system.getNumForces())):
        if not isinstance(system.getForce(k), openmm.NonbondedForce):
            system.removeForce(k)
    return model.topology, system, putIntoWater(system.getForce(0))


def putIntoWater(force):
    """Divide charges by the root of water's permittivity; return the sum of the old charges, e."""
    total = 0
    for i in range(force.getNumParticles()):
        charge, sigma, epsilon = force.getParticleParameters(i)
        total += charge/unit.elementary_charge
        force.setParticleParameters(i, charge/PERMITTIVITY**0.5, sigma, epsilon)
    for k in range(force.getNumExceptions()):
        i, j, product, sigma, epsilon = force.getExceptionParameters(k)
        force.setExceptionParameters(k, i, j, product/PERMITTIVITY, sigma, epsilon)
    return total


class Scene:
    """Proteins on a lattice in a periodic box, each turned at random.

    Parameters
    ----------
    cells : tuple of int
        numbers of places of the lattice along x, y and z
    scheme : str
        'LangevinHI', 'DriftCorrectorFD', or 'LangevinC', which is without the fluid
    solver : int
        of the MobilityForce; Auto takes matrices or a grid, whichever is estimated to be faster
    """
    def __init__(self, cells, scheme, platformName='CPU', seed=1, structure=STRUCTURE,
                 solver=MobilityForce.Auto):
        topology, shape = readProtein(structure)
        self.count, self.atoms = int(np.prod(cells)), len(shape)
        turns = Rotation.random(self.count, random_state=seed)
        places = SPACING*np.stack(np.meshgrid(*[np.arange(n) + 0.5
                                                for n in cells], indexing='ij'), -1).reshape(-1, 3)
        self.start = np.concatenate(
            [turn.apply(shape) + place for turn, place in zip(turns, places)])
        self.topology, system, self.charge = makeSystem(tuple(cells), structure)
        self.system = openmm.XmlSerializer.clone(system)

        self.integrator = CustomRigidHIIntegrator(TEMPERATURE, STEP.get(scheme, STEP['LangevinHI']))
        self.integrator.setScheme(getattr(CustomRigidHIIntegrator, scheme))
        self.integrator.setRandomNumberSeed(seed)
        for k in range(self.count):
            self.integrator.addRigidBody(range(
                self.atoms*k, self.atoms*(k + 1)))  # mass, inertia and shape from the System
        openmmrigidhi.app.bindBodies(self.system, self.integrator)
        self.fluid = None
        if scheme == 'LangevinC':
            self.integrator.setFriction(1)
        else:
            self.fluid = MobilityForce()
            self.fluid.setModel(MobilityForce.ForceCoupling)
            self.fluid.setBoundary(MobilityForce.Periodic)
            self.fluid.setSolver(solver)
            self.fluid.setSolverTolerance(TOLERANCE)
            self.fluid.setViscosity(VISCOSITY*1e-3*unit.pascal*unit.second)
            for atom in self.topology.atoms():
                self.fluid.addParticle(
                    BLOB_RADIUS if isCAlpha(atom) else 0)  # 0: not seen by the fluid
            self.system.addForce(self.fluid)
        properties = {'Threads': '1'} if platformName == 'CPU' else {}
        self.simulation = app.Simulation(self.topology, self.system, self.integrator,
                                         openmm.Platform.getPlatformByName(platformName),
                                         properties)
        self.context = self.simulation.context
        self.context.setPositions(self.start)
        self.context.setVelocitiesToTemperature(TEMPERATURE, seed)

    def positions(self):
        return self.integrator.getBodyPositions()/unit.nanometer

    def poses(self):
        return np.concatenate([self.positions(), self.integrator.getBodyOrientations()], axis=1)


# ---- Saved and resumed ---------------------------------------------------------------------------
def resumed(cells, scheme, platformName, steps, seed, structure):
    """Whether a run that goes on from a State or checkpoint equals the uninterrupted run.

    The result has the largest difference of poses (nm, quaternions) at the end.
    """
    whole = Scene(cells, scheme, platformName, seed, structure)
    start = whole.poses()
    whole.simulation.step(steps)
    state = openmm.XmlSerializer.serialize(
        whole.context.getState(getPositions=True, getVelocities=True, getParameters=True,
                               getIntegratorParameters=True))
    checkpoint = whole.context.createCheckpoint()
    saved = whole.poses()
    whole.simulation.step(steps)
    found = {
        'scheme': scheme,
        'platform': platformName,
        'proteins': whole.count,
        'steps_before': steps,
        'steps_after': steps,
        'moved_before': np.abs(saved - start).max(),
        'moved_after': np.abs(whole.poses() - saved).max()
    }
    for name in ('State', 'checkpoint'):
        again = Scene(cells, scheme, platformName, seed + 17,
                      structure)  # another seed: the run's seed is in what is saved
        if name == 'State':
            again.context.setState(openmm.XmlSerializer.deserialize(state))
        else:
            again.context.loadCheckpoint(checkpoint)
        again.simulation.step(steps)
        found[name] = {
            'largest_difference': np.abs(again.poses() - whole.poses()).max(),
            'identical': bool(np.array_equal(again.poses(), whole.poses()))
        }
    return found


# ---- Moving --------------------------------------------------------------------------------------
def diffusionOfBodies(scene):
    """kT times the trace of the translational mobility over 3, mean of the proteins, nm^2/ps."""
    N = scene.fluid.getMobilityInContext(scene.context)
    own = [N[6*k + i, 6*k + i] for k in range(scene.count) for i in range(3)]
    return GAS_CONSTANT*TEMPERATURE*np.mean(own)


def smallestGap(scene):
    """Least distance between atoms of two proteins, nm."""
    state = scene.context.getState(getPositions=True)
    x = (state.getPositions(asNumpy=True)/unit.nanometer).reshape(scene.count, scene.atoms, 3)
    box = np.diag(state.getPeriodicBoxVectors(asNumpy=True)/unit.nanometer)
    trees = [cKDTree(np.mod(places, box), boxsize=box) for places in x]
    return min(trees[i].query(trees[j].data)[0].min() for i in range(scene.count) for j in range(i))


def move(cells, scheme, duration, platformName, seed, structure, quiet):
    """A run: temperature, energy, displacements against kT times mobility; and its final Scene."""
    scene = Scene(cells, scheme, platformName, seed, structure)
    first = diffusionOfBodies(scene)
    every = round(SAMPLE/STEP[scheme])
    samples = round(duration/SAMPLE)
    last, rows, mobilities = scene.positions(), [], [first]
    began = time.time()
    for k in tqdm(range(samples), desc=scheme, mininterval=2, disable=quiet):
        scene.simulation.step(every)
        now = scene.positions()
        energy = scene.context.getState(getEnergy=True).getPotentialEnergy()
        row = {'energy': energy/unit.kilojoule_per_mole, 'squares': (now - last)**2}
        if scheme == 'LangevinHI':
            moving = scene.integrator.computeTranslationalKineticEnergy()
            turning = scene.integrator.computeRotationalKineticEnergies().sum()
            row['kT_t'] = 2*moving/unit.kilojoule_per_mole/(3*scene.count)
            row['kT_r'] = 2*turning/unit.kilojoule_per_mole/(3*scene.count)
        rows.append(row)
        last = now
        if (k + 1) % max(1, samples // 10) == 0:
            mobilities.append(diffusionOfBodies(scene))
    energies = np.array([row['energy'] for row in rows])
    result = {
        'scheme': scheme,
        'step_ps': STEP[scheme],
        'duration_ps': samples*SAMPLE,
        'proteins': scene.count,
        'seed': seed,
        'platform': platformName,
        'seconds': time.time() - began,
        'rejected_steps': scene.integrator.getNumRejectedSteps(),
        'energy_start_kJ_per_mol': energies[0],
        'energy_end_kJ_per_mol': energies[-1],
        'smallest_gap_nm': smallestGap(scene),
        'D_from_mobility_nm2_per_ps': np.mean(mobilities),
        'D_from_mobility_start_end': [mobilities[0], mobilities[-1]]
    }
    if scheme == 'LangevinHI':
        for name in ('kT_t', 'kT_r'):
            values = np.array([row[name] for row in rows])/(GAS_CONSTANT*TEMPERATURE)
            blocks = np.array([block.mean() for block in np.array_split(values, 8)])
            result[f'{name}_over_kT'] = [blocks.mean(), blocks.std(ddof=1)/8**0.5]
    else:
        # Without momenta a displacement has the variance 2 kT N t, over a time in which mobility
        # and forces hardly change.
        D = np.array([row['squares'].mean() for row in rows])/(2*every*STEP[scheme])
        result['D_from_displacements_nm2_per_ps'] = [D.mean(), D.std(ddof=1)/len(D)**0.5]
    return result, scene


# ---- The price -----------------------------------------------------------------------------------
def prices(cells, rounds, steps, platformName, seed, structure, dense, quiet):
    """Milliseconds of a step with forces alone (Langevin C, no fluid) and with the fluid, in turns.

    Steps are timed by the clock, which also counts what other processes compute. So the parts are
    those of the fastest round, and medians are given too.
    """
    kinds = {
        'forces alone, Langevin C': ('LangevinC', MobilityForce.Auto),
        'LangevinHI': ('LangevinHI', MobilityForce.Auto),
        'DriftCorrectorFD': ('DriftCorrectorFD', MobilityForce.Auto)
    }
    if dense:
        kinds['LangevinHI, dense'] = ('LangevinHI', MobilityForce.Dense)
    scenes = {
        name: Scene(cells, scheme, platformName, seed, structure, solver)
        for name, (scheme, solver) in kinds.items()
    }
    counted = {
        'seconds_forces': 'ms_forces',
        'seconds_mobility': 'ms_fluid',
        'seconds_fft': 'ms_transforms',
        'solverIterations': 'iterations',
        'forceEvaluations': 'force_evaluations'
    }
    found = {name: [] for name in kinds}
    for scene in scenes.values():
        scene.integrator.step(2)
    for k in tqdm(range(rounds), desc=f'prices, {int(np.prod(cells))} proteins', disable=quiet):
        names = list(kinds)
        for name in names[k % len(names):] + names[:k % len(names)]:
            integrator = scenes[name].integrator
            before, began = dict(integrator.getStepStatistics()), time.perf_counter()
            integrator.step(steps)
            row, after = {
                'ms': 1e3*(time.perf_counter() - began)/steps
            }, integrator.getStepStatistics()
            for key, called in counted.items():
                row[called] = (after[key] -
                               before[key])/steps*(1e3 if called.startswith('ms') else 1)
            found[name].append(row)
    least = {name: min(rows, key=lambda row: row['ms']) for name, rows in found.items()}
    base = least['forces alone, Langevin C']['ms']
    return {
        'proteins': int(np.prod(cells)),
        'box_nm': list(SPACING*np.array(cells)),
        'atoms': scenes['LangevinHI'].system.getNumParticles(),
        'rounds': rounds,
        'steps_a_round': steps,
        'kinds': {
            name: {
                **least[name], 'times_forces_alone': least[name]['ms']/base,
                'ms_median': np.median([row['ms'] for row in rows]),
                'ms_of_rounds': [row['ms'] for row in rows]
            }
            for name, rows in found.items()
        },
        'fluid': {
            name: str(scene.integrator.getEffects()['hydrodynamics'])
            for name, scene in scenes.items() if scene.fluid
        }
    }


def priceTable(results):
    yield ('| proteins, atoms | step | ms, least (median) | of it in forces | in the fluid | '
           'fluid over forces | in transforms | iterations |')
    yield '|---'*8 + '|'
    for price in results:
        for name, row in price['kinds'].items():
            yield (f'| {price["proteins"]}, {price["atoms"]} | {name} | {row["ms"]:.0f} '
                   f'({row["ms_median"]:.0f}) | {row["ms_forces"]:.0f} | {row["ms_fluid"]:.0f} | '
                   f'{row["ms_fluid"]/row["ms_forces"]:.2f} | {row["ms_transforms"]:.0f} | '
                   f'{row["iterations"]:.0f} |')


# ---- Results -------------------------------------------------------------------------------------
def drawScene(scene, path):
    """The blobs of the proteins where they are now; nearer blobs are brighter."""
    plt = pyplot()
    from matplotlib.collections import EllipseCollection
    figure, axes = plt.subplots(figsize=(6, 6), constrained_layout=True)
    state = scene.context.getState(getPositions=True, enforcePeriodicBox=True)
    x = state.getPositions(asNumpy=True)/unit.nanometer
    box = scene.topology.getUnitCellDimensions().value_in_unit(unit.nanometer)
    blobs = sorted((k for k, atom in enumerate(scene.topology.atoms()) if isCAlpha(atom)),
                   key=lambda k: x[k, 2])
    size = np.full(len(blobs), 2*BLOB_RADIUS)
    colours = plt.cm.tab10(np.array([k // scene.atoms for k in blobs]) % 10)
    colours[:, :3] *= (0.45 + 0.55*np.clip(x[blobs, 2]/box[2], 0, 1))[:, None]
    axes.add_collection(
        EllipseCollection(size, size, np.zeros(len(blobs)), units='x', offsets=x[blobs, :2],
                          offset_transform=axes.transData, facecolors=colours, edgecolors='k',
                          linewidths=0.3))
    axes.add_patch(plt.Rectangle((0, 0), box[0], box[1], fill=False, ls='--', lw=1))
    axes.set(xlim=(-1.5, box[0] + 1.5), ylim=(-1.5, box[1] + 1.5), xlabel='x (nm)', ylabel='y (nm)',
             aspect='equal',
             title=f'The start: {scene.count} rigid proteins, blobs at C-alpha; dark: far')
    figure.savefig(path, dpi=90)


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--quick', action='store_true', help='three proteins, for seconds')
    parser.add_argument('--part', choices=('all', 'runs', 'prices'), default='all')
    parser.add_argument('--duration', type=float, default=200.0,
                        help='run time of DriftCorrectorFD, ps; LangevinHI runs a tenth of it')
    parser.add_argument('--rounds', type=int, default=9, help='rounds in which costs are measured')
    parser.add_argument('--pdb', type=pathlib.Path, default=STRUCTURE,
                        help='PDB file of the protein (the villin that comes with OpenMM)')
    parser.add_argument('--platform', default='CPU', help='platform of the runs; one thread on CPU')
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--output', type=pathlib.Path,
                        default=pathlib.Path('rigid_proteins_output'))
    args = parser.parse_args()
    cells, duration, rounds, steps = ((3, 1, 1), 8.0, 2,
                                      2) if args.quick else ((2, 2, 2), args.duration, args.rounds,
                                                             5)

    args.output.mkdir(parents=True, exist_ok=True)
    drawScene(Scene(cells, 'LangevinHI', args.platform, args.seed, args.pdb),
              args.output/'rigid_proteins.png')
    if args.part != 'prices':
        saved = [
            resumed((3, 1, 1), scheme, platform, 2 if args.quick else 10, args.seed, args.pdb)
            for platform in ('Reference', args.platform) for scheme in STEP
        ]
        runs = []
        for scheme in STEP:
            result, scene = move(cells, scheme, duration/10 if scheme == 'LangevinHI' else duration,
                                 args.platform, args.seed, args.pdb, args.quick)
            runs.append(result)
        for row in saved + runs:
            print(row)
        save(
            args.output, 'rigid_proteins.json', {
                'saved_and_resumed': saved,
                'runs': runs,
                'charge_e': scene.charge,
                'effects': {k: str(v)
                            for k, v in scene.integrator.getEffects().items()},
                'provenance': provenance(args)
            })
    if args.part != 'runs':
        sizes = [cells] if args.quick else [cells, (3, 3, 3)]
        costs = [
            prices(size, rounds, steps, args.platform, args.seed, args.pdb, size == cells,
                   args.quick) for size in sizes
        ]
        print('\n'.join(priceTable(costs)))
        save(args.output, 'prices.json', {'prices': costs, 'provenance': provenance(args)})


if __name__ == '__main__':
    main()
