#!/usr/bin/python3
"""A whole step of TIP4P-Ew water with PME, by three integrators.

They are rigid bodies under Langevin C, OpenMM's LangevinMiddle with SETTLE, and Verlet. The three
take turns in one process, a few steps each, so that other load on the machine affects all alike.
The script prints and saves medians and quartiles over the rounds, of times and of ratios within a
round, and the integrators' own shares of a step.

    PYTHONPATH=build/python /usr/bin/python3 benchmarks/water_step.py
"""
import argparse
import pathlib
import time

import openmm
import tqdm
from openmm import app, unit

import openmmrigidhi
from common import RESULTS, describeMachine, save, show, spread, waterBox

TEMPERATURE, STEP = 300*unit.kelvin, 2*unit.femtosecond
CUTOFF = 1*unit.nanometer
OURS, MIDDLE, VERLET = 'LangevinC', 'LangevinMiddle + SETTLE', 'Verlet + SETTLE'


def makeIntegrators(topology):
    ours = openmmrigidhi.CustomRigidHIIntegrator(TEMPERATURE, STEP)
    ours.setFriction(5)
    ours.setRotationalFriction(10)
    openmmrigidhi.app.addRigidWater(ours, topology)
    return {
        OURS: ours,
        MIDDLE: openmm.LangevinMiddleIntegrator(TEMPERATURE, 5/unit.picosecond, STEP),
        VERLET: openmm.VerletIntegrator(STEP)
    }


def timed(task):
    start = time.perf_counter()
    task()
    return time.perf_counter() - start


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--molecules', type=int, default=1728)
    parser.add_argument('--threads', type=int, default=2)
    parser.add_argument('--rounds', type=int, default=30)
    parser.add_argument('--steps', type=int, default=20, help='steps of each integrator in a round')
    parser.add_argument('--no-cm-motion-removal', action='store_true',
                        help='leave out the CMMotionRemover')
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    arguments = parser.parse_args()
    machine = describeMachine()

    topology, positions = waterBox(arguments.molecules)
    system = app.ForceField('tip4pew.xml').createSystem(
        topology, nonbondedMethod=app.PME, nonbondedCutoff=CUTOFF,
        removeCMMotion=not arguments.no_cm_motion_removal)
    platform = openmm.Platform.getPlatformByName('CPU')
    integrators = makeIntegrators(topology)
    contexts = {
        name: openmm.Context(system, integrator, platform, {'Threads': str(arguments.threads)})
        for name, integrator in integrators.items()
    }
    contexts[OURS].setPositions(positions)
    openmmrigidhi.app.minimize(contexts[OURS], maxIterations=100)
    contexts[OURS].setVelocitiesToTemperature(TEMPERATURE, 1)
    for _ in tqdm.trange(20, desc='Equilibration', unit_scale=50):
        integrators[OURS].step(50)
    state = contexts[OURS].getState(getPositions=True, getVelocities=True)
    for name in (MIDDLE, VERLET):
        contexts[name].setPositions(state.getPositions())
        contexts[name].setVelocities(state.getVelocities())

    def own():
        statistics = integrators[OURS].getStepStatistics()
        return statistics['seconds_scheme'], statistics['seconds_forces']

    for integrator in integrators.values():
        integrator.step(arguments.steps)
    times = {name: [] for name in integrators}
    schemes, forces = [], []
    names = list(integrators)
    for number in tqdm.trange(arguments.rounds, desc='Rounds'):
        # Each round begins with another integrator.
        for name in names[number % 3:] + names[:number % 3]:
            before = own()
            times[name].append(
                timed(lambda: integrators[name].step(arguments.steps))*1e3/arguments.steps)
            if name == OURS:
                scheme, force = (1e3*(after - start)/arguments.steps
                                 for after, start in zip(own(), before))
                schemes.append(scheme)
                forces.append(force)

    def ratio(above, below):
        return spread([a/b for a, b in zip(above, below)])

    result = {
        'molecules': arguments.molecules,
        'threads': arguments.threads,
        'rounds': arguments.rounds,
        'steps_per_round': arguments.steps,
        'cutoff_nm': CUTOFF._value,
        'step_fs': STEP._value,
        'cm_motion_removal': not arguments.no_cm_motion_removal,
        'loops': integrators[OURS].getEffects()['loops'],
        'milliseconds_per_step': {name: spread(values)
                                  for name, values in times.items()},
        'milliseconds_forces_within_our_step': spread(forces),
        'milliseconds_own': {
            OURS + ', by its timer': spread(schemes),
            OURS + ', step less forces': spread([t - f for t, f in zip(times[OURS], forces)]),
            MIDDLE + ', step less our forces': spread(
                [t - f for t, f in zip(times[MIDDLE], forces)]),
            VERLET + ', step less our forces': spread(
                [t - f for t, f in zip(times[VERLET], forces)])
        },
        'own_share_of_step': {
            OURS + ', by its timer': ratio(schemes, times[OURS]),
            OURS + ', step less forces': ratio([t - f for t, f in zip(times[OURS], forces)],
                                               times[OURS])
        },
        'ratio_of_steps': {
            f'{OURS} / {MIDDLE}': ratio(times[OURS], times[MIDDLE]),
            f'{OURS} / {VERLET}': ratio(times[OURS], times[VERLET])
        }
    }
    for group in ('milliseconds_per_step', 'milliseconds_own', 'own_share_of_step',
                  'ratio_of_steps'):
        print(group.replace('_', ' ') + ', median (quartiles):')
        for name, values in result[group].items():
            print(f'  {name:45} {show(values, 4)}')
    suffix = '_no_cm_removal' if arguments.no_cm_motion_removal else ''
    save(arguments.output,
         f'water_step_{arguments.molecules}_threads{arguments.threads}{suffix}.json', machine,
         result)


if __name__ == '__main__':
    main()
