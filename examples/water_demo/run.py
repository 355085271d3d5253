#!/usr/bin/python3
"""A box of TIP4P-Ew water, every molecule one rigid body, under Langevin C.

    /usr/bin/python3 run.py --output water_demo_output

README.md in this folder explains the script step by step.
"""
import argparse
import json
import pathlib
import sys
import time

import numpy as np
import openmm
import tqdm
from openmm import app, unit

import openmmrigidhi

TEMPERATURE = 300*unit.kelvin
STEP, EQUILIBRATION_STEP = 2*unit.femtosecond, 4*unit.femtosecond
# gamma and Gamma of Davidchack 2015.
FRICTION, ROTATIONAL_FRICTION = 5/unit.picosecond, 10/unit.picosecond
SEED = 2015
REPORT_INTERVAL = 25  # steps between lines of the table
FRAME_INTERVAL = 100  # steps between frames of the DCD and the body-state file
BLOCKS = 5  # blocks of each half, for the error bars: 2 ps each
GAS_CONSTANT = unit.MOLAR_GAS_CONSTANT_R.value_in_unit(unit.kilojoule_per_mole/unit.kelvin)

# Kinetic temperatures of Langevin C at a finite time step h are too low by E_A h^2, with E_A in
# K/fs^2 (Davidchack 2015, Table 1, for the original TIP4P). Averages over configurations (U, the
# pressure, an RDF) have much smaller errors.
TRANSLATIONAL_SLOPE, ROTATIONAL_SLOPE = 0.135, 0.803

# ---- The simulation ------------------------------------------------------------------------------


def makeSimulation(topology, forceField, platform, cutoff=0.9*unit.nanometer):
    """An ordinary OpenMM Simulation, except for its integrator."""
    system = forceField.createSystem(topology, nonbondedMethod=app.PME, nonbondedCutoff=cutoff)
    integrator = openmmrigidhi.CustomRigidHIIntegrator(TEMPERATURE, STEP)
    integrator.setScheme(integrator.LangevinC)
    integrator.setFriction(FRICTION)
    integrator.setRotationalFriction(ROTATIONAL_FRICTION)
    integrator.setRandomNumberSeed(SEED)
    openmmrigidhi.app.addRigidWater(integrator, topology, system)
    return app.Simulation(topology, system, integrator, openmm.Platform.getPlatformByName(platform))


def addReporters(simulation, output, append):
    """Add reporters: a trajectory for viewers, body states for analysis, a table of energies."""
    simulation.reporters = [
        app.DCDReporter(str(output/'trajectory.dcd'), FRAME_INTERVAL, append=append,
                        enforcePeriodicBox=True),
        openmmrigidhi.app.RigidBodyReporter(output/'bodies.h5', FRAME_INTERVAL, append=append),
        openmmrigidhi.app.StateDataReporter(str(output/'table.csv'), REPORT_INTERVAL, append=append,
                                            time=True, potentialEnergy=True, temperature=True,
                                            translationalTemperature=True,
                                            rotationalTemperatures=True)
    ]


def run(simulation, steps, label):
    """Take steps with a progress bar; return the seconds of wall time."""
    start = time.perf_counter()
    picoseconds = simulation.integrator.getStepSize().value_in_unit(unit.picosecond)
    with tqdm.tqdm(
            total=steps*picoseconds, desc=f'{label:18}', unit='ps',
            bar_format='{desc} |{bar}| {n:.2f}/{total:.2f} ps [{elapsed}<{remaining}{postfix}]'
    ) as bar:
        while steps > 0:
            chunk = min(steps, 50)
            simulation.step(chunk)
            steps -= chunk
            temperature = simulation.integrator.computeSystemTemperature()
            bar.set_postfix_str(f'{temperature.value_in_unit(unit.kelvin):.0f} K', refresh=False)
            bar.update(chunk*picoseconds)
    return time.perf_counter() - start


# ---- Stopping and resuming -----------------------------------------------------------------------


def snapshot(simulation):
    """Everything that moves, as arrays, and the potential energy per molecule."""
    integrator = simulation.integrator
    state = simulation.context.getState(getPositions=True, getVelocities=True, getEnergy=True)
    energy = state.getPotentialEnergy()/integrator.getNumRigidBodies()
    velocity, rate = unit.nanometer/unit.picosecond, unit.radian/unit.picosecond
    return {'particle positions': state.getPositions(asNumpy=True)/unit.nanometer,
            'particle velocities': state.getVelocities(asNumpy=True)/velocity,
            'body positions': integrator.getBodyPositions()/unit.nanometer,
            'body orientations': integrator.getBodyOrientations(),
            'body velocities': integrator.getBodyVelocities()/velocity,
            'angular velocities': integrator.getBodyAngularVelocities()/rate}, \
        energy.value_in_unit(unit.kilojoule_per_mole)


def save(simulation, output):
    simulation.saveCheckpoint(str(output/'half_way.chk'))
    simulation.saveState(str(output/'half_way.xml'))


def load(simulation, output, how):
    if how == 'checkpoint':
        simulation.loadCheckpoint(str(output/'half_way.chk'))
    else:
        simulation.loadState(str(output/'half_way.xml'))


def sameBits(a, b):
    return all(a[name].tobytes() == b[name].tobytes() for name in a)


def largestDistance(a, b):
    """The largest distance between the same particles, nm."""
    return np.linalg.norm(a['particle positions'] - b['particle positions'], axis=1).max()


def require(condition, text):
    """Print a check and its outcome; stop if it failed."""
    print(f'  [{"ok" if condition else "FAILED"}] {text}')
    if not condition:
        raise SystemExit('The resumed run does not continue the first.')


def referenceCheck(topology, positions, forceField, output, steps):
    """Check bit for bit, on Reference, that a resumed run equals the uninterrupted run."""
    edge, margin = 1.5, 0.1  # nm; the margin keeps molecules at opposite faces apart
    modeller = app.Modeller(topology, positions*unit.nanometer)
    modeller.delete([
        residue for residue in topology.residues() if any(
            np.ptp(np.append(positions[atom.index], [0, edge - margin])) > edge - margin
            for atom in residue.atoms())
    ])
    modeller.topology.setPeriodicBoxVectors(np.diag([edge]*3)*unit.nanometer)

    def fresh():
        return makeSimulation(modeller.topology, forceField, 'Reference', 0.7*unit.nanometer)

    first = fresh()
    first.context.setPositions(modeller.positions)
    openmmrigidhi.app.minimize(first.context, maxIterations=10, progress=False)
    first.context.setVelocitiesToTemperature(TEMPERATURE, SEED)
    first.step(steps)
    save(first, output)
    first.step(steps)
    uninterrupted, _ = snapshot(first)
    waters = first.integrator.getNumRigidBodies()
    for how in ('checkpoint', 'State'):
        second = fresh()
        load(second, output, how)
        second.step(steps)
        resumed, _ = snapshot(second)
        require(
            sameBits(uninterrupted, resumed),
            f'Reference platform, {waters} waters, resumed from a {how}: after {steps} more steps '
            'positions and velocities are bit for bit those of the uninterrupted run')


# ---- Analysis ------------------------------------------------------------------------------------


def mean(series, blocks=BLOCKS):
    """Mean and its standard error.

    The error comes from the scatter of block means, which are nearly independent of each other.
    """
    blockMeans = np.array([block.mean() for block in np.array_split(series, blocks)])
    return series.mean(), blockMeans.std(ddof=1)/np.sqrt(blocks)


def readTable(file):
    """The columns of the reporter's table, by short names."""
    rows = np.genfromtxt(file, delimiter=',', names=True, deletechars='')
    names = dict(zip(('time', 'U', 'T', 'T_trans', 'T_rot1', 'T_rot2', 'T_rot3'), rows.dtype.names))
    return {short: rows[name] for short, name in names.items()}


def radialDistributions(states, largest=0.9, bins=180):
    """g(r) of O-O, O-H and H-H between molecules, from the poses in the body-state file."""
    from scipy.spatial import cKDTree
    # O, H, H of each molecule in its body frame.
    sites = np.array([s[:3]/unit.nanometer for s in states.sitePositions])
    edges = np.linspace(0, largest, bins + 1)
    counts = {'O-O': np.zeros(bins), 'O-H': np.zeros(bins), 'H-H': np.zeros(bins)}
    volume = 0
    positions, boxes = states.positions/unit.nanometer, states.boxVectors/unit.nanometer
    for R, q, box in zip(positions, states.orientations, boxes):
        w, v = q[:, None, :1], q[:, None, 1:]
        turned = sites + 2*np.cross(v, np.cross(v, sites) + w*sites)  # q sites q^-1
        atoms = (R[:, None, :] + turned).reshape(-1, 3) % np.diag(box)
        molecule, isHydrogen = np.arange(len(atoms)) // 3, np.arange(len(atoms)) % 3 > 0
        i, j = cKDTree(np.minimum(atoms, np.nextafter(np.diag(box), 0)), boxsize=np.diag(box)) \
            .query_pairs(largest, output_type='ndarray').T
        apart = molecule[i] != molecule[j]
        i, j = i[apart], j[apart]
        offset = atoms[i] - atoms[j]
        offset -= np.diag(box)*np.round(offset/np.diag(box))
        distance = np.linalg.norm(offset, axis=1)
        hydrogens = isHydrogen[i].astype(int) + isHydrogen[j]
        for number, name in enumerate(counts):
            counts[name] += np.histogram(distance[hydrogens == number], edges)[0]
        volume += np.linalg.det(box)
    n, frames = len(sites), len(states)
    shell = 4/3*np.pi*np.diff(edges**3)
    pairs = {'O-O': n*(n - 1)/2, 'O-H': 2*n*(n - 1), 'H-H': 2*n*(n - 1)}
    r = (edges[1:] + edges[:-1])/2
    return r, {name: counts[name]/(frames*pairs[name]*shell)*volume/frames for name in counts}


def draw(file, table, results, r, rdf, resumedAt):
    import matplotlib
    matplotlib.use('Agg')
    import matplotlib.pyplot as plt
    figure, axes = plt.subplots(2, 2, figsize=(11, 7.5), constrained_layout=True)
    window = max(1, len(table['time']) // 10)  # 2 ps
    temperature = TEMPERATURE/unit.kelvin
    temperatures = {
        'T_trans': ('translation', 'tab:blue'),
        'T_rot1': ('rotation, smallest moment', 'tab:red'),
        'T_rot2': ('rotation, middle moment', 'tab:orange'),
        'T_rot3': ('rotation, largest moment', 'tab:green')
    }

    axis = axes[0, 0]
    for name, (label, color) in temperatures.items():
        axis.plot(
            *(np.convolve(table[x], np.full(window, 1/window), 'valid') for x in ('time', name)),
            color=color, label=label)
    axis.set(xlabel='time (ps)', ylabel='temperature (K)', title='Temperatures, moving averages',
             ylim=(temperature - 20, temperature + 20))
    axis.axhline(temperature, color='black', linewidth=0.6)
    axis.legend(fontsize=8, loc='upper left', ncol=2)

    axis = axes[0, 1]
    expected = expectedTemperatures()
    for place, (name, (label, color)) in enumerate(temperatures.items()):
        value, error = results[name]
        axis.errorbar(place, value, error, fmt='o', color=color, capsize=4)
        axis.annotate(f'{value:.1f}({error:.1f})', (place, value), textcoords='offset points',
                      xytext=(9, 6), fontsize=9)
    axis.axhline(temperature, color='black', linewidth=0.8)
    axis.plot([-0.35, 0.35], [expected['T_trans']]*2, '--', color='gray')
    axis.plot([0.65, 3.35], [expected['T_rot']]*2, '--', color='gray',
              label='to be expected at this step\n(rotation: mean of 3 axes)')
    low = min(results[name][0] - results[name][1] for name in temperatures)
    axis.set_ylim(min(low, expected['T_rot']) - 4, temperature + 2)
    axis.set(xticks=range(4), xticklabels=('trans.', 'rot. 1', 'rot. 2', 'rot. 3'),
             xlim=(-0.5, 3.8), ylabel='temperature (K)', title='Mean temperatures, 1 sigma')
    axis.legend(fontsize=8, loc='lower left')

    axis = axes[1, 0]
    axis.plot(table['time'], table['U'], color='tab:purple', linewidth=0.7)
    value, error = results['U']
    axis.axhspan(value - error, value + error, color='black', alpha=0.3,
                 label=f'mean {value:.3f}({error:.3f}) kJ/mol')
    axis.set(xlabel='time (ps)', ylabel='U (kJ/mol per molecule)', title='Potential energy')
    axis.legend(fontsize=8, loc='upper left')
    for axis in axes[:, 0]:
        axis.axvline(resumedAt, color='black', linestyle=':', linewidth=1)
        axis.annotate(' stopped, resumed', (resumedAt, axis.get_ylim()[0]), fontsize=8, va='bottom')
        axis.set_xlim(table['time'][0], table['time'][-1])

    axis = axes[1, 1]
    for (name, g), color in zip(rdf.items(), ('tab:red', 'tab:blue', 'tab:gray')):
        top = g[r > 0.23].max() if name == 'O-O' else None
        axis.plot(
            r, g, color=color,
            label=name if top is None else f'{name}, highest {top:.2f} at {r[g.argmax()]:.3f} nm')
    axis.axhline(1, color='black', linewidth=0.6)
    axis.set(xlabel='r (nm)', ylabel='g(r)', title='Radial distribution between molecules',
             xlim=(0.1, r[-1]), ylim=(0, None))
    axis.legend(fontsize=8)
    figure.suptitle(
        f'TIP4P-Ew water, {results["molecules"]} rigid molecules, PME, Langevin C, '
        f'{STEP.value_in_unit(unit.femtosecond):g} fs, {results["nsPerDay"]:.1f} ns/day')
    figure.savefig(file, dpi=130)


def expectedTemperatures():
    h, temperature = STEP.value_in_unit(unit.femtosecond), TEMPERATURE.value_in_unit(unit.kelvin)
    return {
        'T_trans': temperature - TRANSLATIONAL_SLOPE*h**2,
        'T_rot': temperature - ROTATIONAL_SLOPE*h**2
    }


def evaluate(table, statistics, seconds, steps, molecules):
    """Means with errors of both halves together, speed, and the integrator's share of a step."""
    results = {
        name: mean(table[name], 2*BLOCKS)
        for name in ('T_trans', 'T_rot1', 'T_rot2', 'T_rot3')
    }
    table['U'] /= molecules
    results['U'] = mean(table['U'], 2*BLOCKS)
    spent = {
        name: sum(after[name] - before[name] for before, after in statistics)
        for name in ('steps', 'seconds_forces', 'seconds_scheme')
    }
    own, whole = spent['seconds_scheme'], spent['seconds_scheme'] + spent['seconds_forces']
    results.update(molecules=molecules, steps=steps, picoseconds=(steps*STEP).value_in_unit(
        unit.picosecond), nsPerDay=(steps*STEP).value_in_unit(unit.nanosecond)*86400/seconds,
                   millisecondsPerStep=1e3*seconds/steps,
                   integratorMilliseconds=1e3*own/spent['steps'], integratorShare=own/whole,
                   version=openmmrigidhi.__version__, openmm=openmm.version.version, seed=SEED)
    return results


def printResults(results, table, resumedAt):
    expected = expectedTemperatures()
    print(f'  {results["picoseconds"]:g} ps, {results["molecules"]} molecules; errors are 1 sigma, '
          f'from {2*BLOCKS} blocks')
    for name, text, known in (('T_trans', 'translational temperature', 'T_trans'),
                              ('T_rot1', 'rotational temperature, smallest moment',
                               None), ('T_rot2', 'rotational temperature, middle moment', None),
                              ('T_rot3', 'rotational temperature, largest moment', None)):
        value, error = results[name]
        note = f'; expected at this step size {expected[known]:.1f} K' if known else ''
        print(f'  {text:40} {value:8.2f} +- {error:.2f} K{note}')
    rotation = (table['T_rot1'] + table['T_rot2'] + table['T_rot3'])/3
    value, error = results['T_rot'] = mean(rotation, 2*BLOCKS)
    print(f'  {"rotational temperature, mean of the three":40} {value:8.2f} +- {error:.2f} K; '
          f'expected at this step size {expected["T_rot"]:.1f} K')
    print('  (Kinetic temperatures of Langevin C read low by an error of second order in the step; '
          'README.md, point 6.)')
    value, error = results['U']
    print(f'  {"potential energy":40} {value:8.3f} +- {error:.3f} kJ/mol per molecule')
    late = table['time'] > resumedAt*(1 + 1e-9)
    for name, series, unitName in (('U', table['U'], 'kJ/mol'), ('T_trans', table['T_trans'], 'K'),
                                   ('T_rot', rotation, 'K')):
        (a, da), (b, db) = mean(series[~late]), mean(series[late])
        jump = series[late][0] - series[~late][-1]
        usual = np.diff(series).std()
        print(f'  second half - first half: {name:8}{b - a:8.3f} +- {np.hypot(da, db):.3f} '
              f'{unitName}; from the last line before '
              f'stopping to the first after resuming {jump:+.3f}, usual between lines {usual:.3f}')
    print(
        f'  {results["nsPerDay"]:.2f} ns/day ({results["millisecondsPerStep"]:.2f} ms a step with '
        f'writing the files), of which the '
        f'integrator itself {results["integratorMilliseconds"]:.3f} ms: '
        f'{100*results["integratorShare"]:.1f} % of a step')


# ---- The job -------------------------------------------------------------------------------------


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--output', type=pathlib.Path, default=pathlib.Path('water_demo_output'),
                        help='folder for results')
    parser.add_argument('--short', action='store_true',
                        help='take only a few hundred steps, to test the script')
    arguments = parser.parse_args()
    output = arguments.output
    output.mkdir(parents=True, exist_ok=True)
    sys.stdout.reconfigure(line_buffering=True)  # in step with the progress bars
    equilibration, half, witnessed, onReference = (200, 500, 20,
                                                   5) if arguments.short else (2000, 5000, 20, 20)

    print('1. Build: tip4pew.pdb and tip4pew.xml of OpenMM, PME, each molecule a rigid body')
    pdb = app.PDBFile(str(pathlib.Path(app.__file__).parent/'data'/'tip4pew.pdb'))
    forceField = app.ForceField('tip4pew.xml')
    simulation = makeSimulation(pdb.topology, forceField, 'CPU')
    molecules = simulation.integrator.getNumRigidBodies()
    simulation.context.setPositions(pdb.positions)
    print(simulation.integrator.describeEffects())

    print('2. Minimise, equilibrate')
    # A few iterations remove what rounding in the file has done. More would freeze what must then
    # be warmed up again.
    openmmrigidhi.app.minimize(simulation.context, maxIterations=5)
    simulation.context.setVelocitiesToTemperature(TEMPERATURE, SEED)
    simulation.integrator.setStepSize(EQUILIBRATION_STEP)
    run(simulation, equilibration, 'Equilibration')
    simulation.integrator.setStepSize(STEP)

    print('3. First half of the run; then stop')
    simulation.context.setTime(0)
    simulation.currentStep = 0
    before = simulation.integrator.getStepStatistics()
    addReporters(simulation, output, append=False)
    seconds = run(simulation, half, 'First half')
    statistics = [(before, simulation.integrator.getStepStatistics())]
    save(simulation, output)
    saved, savedEnergy = snapshot(simulation)
    # A few more steps, not recorded: the end of the uninterrupted run.
    simulation.reporters = []
    simulation.step(witnessed)
    uninterrupted, _ = snapshot(simulation)
    del simulation

    print('4. Resume in fresh Contexts')
    for how in ('State', 'checkpoint'):
        simulation = makeSimulation(pdb.topology, forceField, 'CPU')
        load(simulation, output, how)
        loaded, energy = snapshot(simulation)
        require(
            sameBits(saved, loaded) and simulation.currentStep == half,
            f'{how}: step number, positions, velocities and body states are bit for bit those saved'
        )
        require(
            abs(energy - savedEnergy) < 1e-3,
            f'{how}: potential energy {energy:.6f} kJ/mol per molecule, {savedEnergy:.6f} when '
            f'saved (OpenMM adds up '
            'forces and energies on several threads in float, in no fixed order)')
        if how == 'State':
            simulation.step(witnessed)
            resumed, _ = snapshot(simulation)
            moved, apart = largestDistance(saved, resumed), largestDistance(uninterrupted, resumed)
            require(
                apart < 1e-3*moved,
                f'{how}: after {witnessed} more steps the particles have moved by up to '
                f'{moved:.3f} nm, and are within {apart:.1g} nm of where the uninterrupted run was')

    print('5. Second half, from the checkpoint')
    before = simulation.integrator.getStepStatistics()
    addReporters(simulation, output, append=True)
    seconds += run(simulation, half, 'Second half')
    statistics.append((before, simulation.integrator.getStepStatistics()))

    print('6. Stop and resume on the Reference platform, where forces are reproducible')
    referenceCheck(pdb.topology,
                   pdb.getPositions(asNumpy=True)/unit.nanometer, forceField, output, onReference)

    print('7. Results')
    table = readTable(output/'table.csv')
    states = openmmrigidhi.app.readBodyStates(output/'bodies.h5')
    results = evaluate(table, statistics, seconds, 2*half, molecules)
    resumedAt = (half*STEP).value_in_unit(unit.picosecond)
    printResults(results, table, resumedAt)
    r, rdf = radialDistributions(states)
    draw(output/'water.png', table, results, r, rdf, resumedAt)
    (output/'results.json').write_text(json.dumps(results, indent=1) + '\n')
    print(f'Written to {output}: water.png (look at it), results.json, table.csv, trajectory.dcd, '
          f'bodies.h5 ({len(states)} frames), half_way.chk, half_way.xml')


if __name__ == '__main__':
    main()
