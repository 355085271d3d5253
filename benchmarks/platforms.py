#!/usr/bin/python3
"""The time of a step of rigid bodies on each platform, beside OpenMM's Verlet.

Scenes are one body without forces, and TIP4P-Ew waters with a reaction field. Both integrators have
the same System in the same run. They take turns, a few steps each, so that other load on the
machine affects both alike. Results are medians and quartiles over the rounds, in microseconds. On a
platform other than Reference and CPU forces are computed on the device. The excess over Verlet
there consists of transfers to and from the device, of bodies on the host, and of waiting.

    PYTHONPATH=build/python /usr/bin/python3 benchmarks/platforms.py
"""
import argparse
import pathlib
import time

import openmm
import tqdm
from openmm import app, unit

import openmmrigidhi
from common import RESULTS, describeMachine, save, show, spread, waterBox

SEED, TEMPERATURE, STEP = 1, 300*unit.kelvin, 2*unit.femtosecond
OURS, VERLET = 'LangevinC', 'Verlet'


def oneBody():
    """A water molecule without forces; constraints hold it together under Verlet."""
    topology, positions = waterBox(1)
    system = app.ForceField('tip4pew.xml').createSystem(topology, removeCMMotion=False)
    while system.getNumForces():
        system.removeForce(0)
    return topology, system, positions


def waters(molecules):
    topology, positions = waterBox(molecules)
    system = app.ForceField('tip4pew.xml').createSystem(topology,
                                                        nonbondedMethod=app.CutoffPeriodic,
                                                        removeCMMotion=False,
                                                        nonbondedCutoff=0.9*unit.nanometer)
    return topology, system, positions


def measure(scene, platform, properties, rounds, seconds):
    """Microseconds a step of both integrators, and of the plugin's without the forces."""
    topology, system, positions = scene
    ours = openmmrigidhi.CustomRigidHIIntegrator(TEMPERATURE, STEP)
    ours.setRandomNumberSeed(SEED)
    openmmrigidhi.app.addRigidWater(ours, topology)
    integrators = {OURS: ours, VERLET: openmm.VerletIntegrator(STEP)}
    contexts = {
        name: openmm.Context(system, integrator, platform, properties)
        for name, integrator in integrators.items()
    }
    contexts[OURS].setPositions(positions)
    contexts[OURS].setVelocitiesToTemperature(TEMPERATURE, SEED)
    ours.step(20)
    state = contexts[OURS].getState(getPositions=True, getVelocities=True)
    contexts[VERLET].setPositions(state.getPositions())
    contexts[VERLET].setVelocities(state.getVelocities())

    def timed(name, steps):
        # Kernels of a device are only queued: reading the velocities waits until they have run.
        began = time.perf_counter()
        integrators[name].step(steps)
        contexts[name].getState(getVelocities=True)
        return (time.perf_counter() - began)/steps

    steps = {name: max(1, round(seconds/timed(name, 3))) for name in integrators}
    times, schemes = {name: [] for name in integrators}, []
    for number in range(rounds):
        for name in sorted(integrators, reverse=bool(number % 2)):
            before = ours.getStepStatistics()['seconds_scheme']
            times[name].append(1e6*timed(name, steps[name]))
            if name == OURS:
                schemes.append(
                    1e6*(ours.getStepStatistics()['seconds_scheme'] - before)/steps[name])
    return {
        'microseconds_ours': spread(times[OURS]),
        'microseconds_verlet': spread(times[VERLET]),
        'microseconds_more': spread([a - b for a, b in zip(times[OURS], times[VERLET])]),
        'microseconds_without_forces': spread(schemes),
        'steps': steps
    }


def kinds():
    """Every platform that works here, with its precisions."""
    for i in range(openmm.Platform.getNumPlatforms()):
        platform = openmm.Platform.getPlatform(i)
        openmmrigidhi.checkPlatform(platform)
        precisions = ('single', 'mixed',
                      'double') if 'Precision' in platform.getPropertyNames() else (None,)
        for precision in precisions:
            properties = {'Precision': precision} if precision else {}
            system = openmm.System()
            system.addParticle(1)
            try:
                openmm.Context(system, openmm.VerletIntegrator(0.001), platform, properties)
            except openmm.OpenMMException as error:
                print(f'{platform.getName()} is left out: {error}')
                break
            yield platform, properties


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--molecules', type=int, default=1000)
    parser.add_argument('--rounds', type=int, default=20)
    parser.add_argument('--seconds', type=float, default=0.2,
                        help='time of the steps of each integrator in a round (at least one step)')
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    arguments = parser.parse_args()
    machine, rows = describeMachine(), []
    scenes = {'one body': oneBody(), f'{arguments.molecules} waters': waters(arguments.molecules)}
    jobs = [(name, scene, *kind) for kind in kinds() for name, scene in scenes.items()]
    for name, scene, platform, properties in tqdm.tqdm(jobs, desc='Platforms'):
        rows.append({
            'scene': name,
            'platform': platform.getName(),
            **properties,
            **measure(scene, platform, properties, arguments.rounds, arguments.seconds)
        })
    for row in rows:
        print(f'{row["scene"]:<12} {row["platform"]:<10} {row.get("Precision", ""):<7} ours '
              f'{show(row["microseconds_ours"], 2)}, Verlet {show(row["microseconds_verlet"], 2)}, '
              f'more {show(row["microseconds_more"], 2)} us')
    save(arguments.output, 'platforms.json', machine, {
        'seed': SEED,
        'rounds': arguments.rounds,
        'rows': rows
    })


if __name__ == '__main__':
    main()
