#!/usr/bin/python3
"""Density of TIP4P-Ew water at 300 K and 1 bar: Langevin C against OpenMM's own rigid water.

Under Langevin C the molecules are rigid bodies.

    /usr/bin/python3 run.py --length 200 --replicas 2 --jobs 2

README.md in this folder says what was measured.
"""
import argparse
import pathlib
import sys
import time

import numpy as np
import openmm
from openmm import app, unit

import openmmrigidhi

HERE = pathlib.Path(__file__).resolve().parent
sys.path.append(str(HERE.parents[1]/'common'))
import campaign  # noqa: E402
from recording import provenance, pyplot, save  # noqa: E402

MOLECULES = 216
TEMPERATURE, PRESSURE = 300*unit.kelvin, 1*unit.bar
FRICTION, ROTATIONAL_FRICTION = 5/unit.picosecond, 10/unit.picosecond
CUTOFF = 0.85*unit.nanometer  # less than half of the 1.86 nm box at all densities that occur
BAROSTAT_TIME = 0.05  # ps between trial moves of the volume: the same for all step sizes
AVERAGE = 1  # ps; densities are kept as averages over this time
BLOCK = 20  # ps; the volume's autocorrelation time is a few ps
FIRST_SEED = 100

#: name: (integrator, step in fs)
METHODS = {
    'LangevinC 2 fs': ('LangevinC', 2),
    'LangevinC 4 fs': ('LangevinC', 4),
    'LangevinMiddle + SETTLE 2 fs': ('LangevinMiddle', 2),
}
REFERENCE = 'LangevinMiddle + SETTLE 2 fs'
LABELS = {
    method: method.replace(' + ', ' +\n').replace(' 2', '\n2').replace(' 4', '\n4')
    for method in METHODS
}


def makeContext(topology, positions, integratorName, step, seed, platformName='CPU', threads=1,
                cutoff=CUTOFF):
    """A Context at constant pressure; its integrator is the only difference between the methods."""
    system = app.ForceField('tip4pew.xml').createSystem(topology, nonbondedMethod=app.PME,
                                                        nonbondedCutoff=cutoff)
    stepSize = step*unit.femtosecond
    interval = max(1, round(BAROSTAT_TIME/stepSize.value_in_unit(unit.picosecond)))
    barostat = openmm.MonteCarloBarostat(PRESSURE, TEMPERATURE, interval)
    barostat.setRandomNumberSeed(seed)
    system.addForce(barostat)
    if integratorName == 'LangevinMiddle':
        integrator = openmm.LangevinMiddleIntegrator(TEMPERATURE, FRICTION, stepSize)
    else:
        integrator = openmmrigidhi.CustomRigidHIIntegrator(TEMPERATURE, stepSize)
        integrator.setScheme(getattr(integrator, integratorName))
        integrator.setFriction(FRICTION)
        integrator.setRotationalFriction(ROTATIONAL_FRICTION)
        openmmrigidhi.app.addRigidWater(integrator, topology, system)
    integrator.setRandomNumberSeed(seed)
    properties = {'Threads': str(threads)} if platformName == 'CPU' else {}
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName(platformName),
                             properties)
    context.setPeriodicBoxVectors(*topology.getPeriodicBoxVectors())
    context.setPositions(positions)
    context.setVelocitiesToTemperature(TEMPERATURE, seed)
    return context, integrator, interval


def waterTopology(molecules):
    """A Modeller with a box of water near its density."""
    modeller = app.Modeller(app.Topology(), []*unit.nanometer)
    modeller.addSolvent(app.ForceField('tip4pew.xml'), model='tip4pew', numAdded=molecules)
    return modeller


def waterBox(molecules):
    """(topology, positions) of the water after a minimisation."""
    modeller = waterTopology(molecules)
    system = app.ForceField('tip4pew.xml').createSystem(modeller.topology, nonbondedMethod=app.PME,
                                                        nonbondedCutoff=CUTOFF)
    context = openmm.Context(system, openmm.VerletIntegrator(0.001),
                             openmm.Platform.getPlatformByName('CPU'))
    context.setPositions(modeller.positions)
    openmm.LocalEnergyMinimizer.minimize(context, 10, 200)
    return modeller.topology, context.getState(getPositions=True).getPositions()


def density(context, massOfAll):
    """The density in kg/m^3."""
    volume = context.getState().getPeriodicBoxVolume()
    return (massOfAll/volume/unit.AVOGADRO_CONSTANT_NA).value_in_unit(unit.kilogram/unit.meter**3)


def simulate(argument, job, positions):
    """One run: densities at every trial move of the barostat, after equilibration.

    The run's length and the equilibration are in ps. A run that is interrupted begins anew, because
    OpenMM 7.7 does not save the barostat's counters.
    """
    method, seed, equilibration, length, threads = argument
    topology = waterTopology(MOLECULES).topology
    integratorName, step = METHODS[method]
    context, integrator, interval = makeContext(topology, positions, integratorName, step, seed,
                                                threads=threads)
    massOfAll = sum((context.getSystem().getParticleMass(i)
                     for i in range(context.getSystem().getNumParticles())), 0*unit.dalton)
    start, series, residual = time.perf_counter(), [], 0
    for sample in range(round((equilibration + length)/BAROSTAT_TIME)):
        integrator.step(interval)
        job.report((sample + 1)*BAROSTAT_TIME)
        if (sample + 1)*BAROSTAT_TIME > equilibration:
            series.append(density(context, massOfAll))
            if integratorName != 'LangevinMiddle':
                residual = max(residual, integrator.getPoseResidual()._value)
    run = {
        'method': method,
        'seed': seed,
        'step_fs': step,
        'equilibration_ps': equilibration,
        'length_ps': length,
        'seconds': round(time.perf_counter() - start, 1),
        'density': averages(series)
    }
    if integratorName != 'LangevinMiddle':
        run['largest_pose_residual_nm'] = residual
    return run


def averages(series):
    """Means of a series over intervals of AVERAGE."""
    parts = max(2, round(len(series)*BAROSTAT_TIME/AVERAGE))
    return [round(float(part.mean()), 3) for part in np.array_split(np.array(series), parts)]


def evaluate(runs):
    """Mean density of each method over its runs, and differences in units of their sigma.

    Standard errors come from blocks.
    """
    table = {}
    for method in METHODS:
        blocks = []
        for run in runs:
            if run['method'] == method:
                count = max(2, round(run['length_ps']/BLOCK))
                blocks += [
                    block.mean() for block in np.array_split(np.array(run['density']), count)
                ]
        blocks = np.array(blocks)
        table[method] = {
            'density_kg_m3': blocks.mean(),
            'error': blocks.std(ddof=1)/np.sqrt(len(blocks)),
            'blocks': len(blocks)
        }
    other = table[REFERENCE]
    for method, row in table.items():
        if method != REFERENCE:
            row['difference'] = row['density_kg_m3'] - other['density_kg_m3']
            row['sigmas'] = row['difference']/np.hypot(row['error'], other['error'])
    return table


def draw(file, runs, table):
    plt = pyplot()
    colors = dict(zip(METHODS, ('tab:blue', 'tab:cyan', 'tab:red')))
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.2), constrained_layout=True,
                                         gridspec_kw={'width_ratios': (2, 1)})
    for method, color in colors.items():
        label = method
        for run in runs:
            if run['method'] == method:
                average = np.cumsum(run['density'])/np.arange(1, len(run['density']) + 1)
                left.plot(AVERAGE*np.arange(1,
                                            len(average) + 1), average, color=color, label=label,
                          linewidth=1)
                label = None
    left.set(xlabel='time (ps)', ylabel='density (kg/m$^3$)',
             title='Running averages, one line a run')
    left.legend(fontsize=8)
    for place, (method, row) in enumerate(table.items()):
        right.errorbar(place, row['density_kg_m3'], row['error'], fmt='o', capsize=4,
                       color=colors[method])
        right.annotate(f'{row["density_kg_m3"]:.1f}({row["error"]:.1f})',
                       (place, row['density_kg_m3']), fontsize=9, textcoords='offset points',
                       xytext=(7, -3))
    right.set(xticks=range(len(table)), xticklabels=[LABELS[method] for method in table],
              xlim=(-0.5, 2.8), title='Means, 1 sigma')
    figure.suptitle(
        f'{MOLECULES} TIP4P-Ew waters, PME, Monte Carlo barostat at {PRESSURE._value:g} bar, '
        f'{TEMPERATURE._value:g} K')
    figure.savefig(file, dpi=130)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--output', type=pathlib.Path, default=pathlib.Path('npt_density_output'),
                        help='folder for results')
    parser.add_argument('--equilibration', type=float, default=30,
                        help='time at the start that does not count, ps')
    parser.add_argument('--length', type=float, default=200, help='length of each run, ps')
    parser.add_argument('--replicas', type=int, default=1, help='independent runs of each method')
    parser.add_argument('--threads', type=int, default=1)
    campaign.addOptions(parser)
    arguments = campaign.settle(parser.parse_args())
    _, positions = waterBox(MOLECULES)
    todo = [(method, FIRST_SEED + 10*replica + number, arguments.equilibration, arguments.length,
             arguments.threads) for replica in range(arguments.replicas)
            for number, method in enumerate(METHODS)]
    runs = campaign.run(simulate, todo,
                        [f'density {method} seed {seed}' for method, seed, *_ in todo], arguments,
                        [arguments.equilibration + arguments.length]*len(todo), 'ps', 'density',
                        given=np.array(positions.value_in_unit(unit.nanometer)))
    table = evaluate(runs)
    save(
        arguments.output, 'npt_density.json', {
            'provenance': provenance(arguments),
            'threads': arguments.threads,
            'molecules': MOLECULES,
            'temperature_K': TEMPERATURE._value,
            'pressure_bar': PRESSURE._value,
            'cutoff_nm': CUTOFF._value,
            'barostat_interval_ps': BAROSTAT_TIME,
            'average_ps': AVERAGE,
            'block_ps': BLOCK,
            'methods': table,
            'runs': runs
        })
    draw(arguments.output/'npt_density.png', runs, table)
    for method, row in table.items():
        against = (f'; {row["difference"]:+.2f} kg/m^3, {row["sigmas"]:+.2f} sigma, '
                   f'from {REFERENCE}') if 'sigmas' in row else ''
        print(f'{method:30} {row["density_kg_m3"]:8.2f} +- {row["error"]:.2f} kg/m^3{against}')
    agrees = all(abs(row.get('sigmas', 0)) < 3 for row in table.values())
    print('The methods agree within 3 combined sigma.'
          if agrees else 'THE METHODS DISAGREE by more than 3 combined sigma.')
    return 0 if agrees else 1


if __name__ == '__main__':
    raise SystemExit(main())
