#!/usr/bin/python3
"""What a step of one free body costs: processor time, and instructions.

    PYTHONPATH=build/python benchmarks/one_body.py
    PYTHONPATH=build/python benchmarks/one_body.py --instructions       # needs valgrind

Compare two builds by two values of PYTHONPATH, in turns: the least time of many short runs depends
little on other work, and numbers of instructions do not depend on it.
"""
import argparse
import re
import subprocess
import sys
import tempfile
import time

import openmm

import openmmrigidhi

SITES = {
    'general3': [(0.1, 0, 0), (-0.05, 0.05, 0), (-0.05, -0.05, 0)],
    'ellipsoid': [(0, 0, 0)],
    'point': [(0, 0, 0)]
}
STEP = 'RigidHIPlugin::CustomRigidHIIntegrator::step(int)'


def start(shape, platform):
    """The integrator and the Context of one body of mass 18, with Langevin C and noise."""
    system, sites = openmm.System(), SITES[shape]
    integrator = openmmrigidhi.CustomRigidHIIntegrator(300, 0.002)
    particles = [system.addParticle(18/len(sites)) for _ in sites]
    moments = (0, 0, 0) if shape == 'point' else (0.01, 0.02, 0.03)
    integrator.addRigidBody(particles, 18, moments, sites)
    integrator.setFriction(5)
    integrator.setRotationalFriction(10)
    integrator.setRandomNumberSeed(1)
    properties = {'Threads': '1'} if platform == 'CPU' else {}
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName(platform),
                             properties)
    context.setPositions(sites)
    context.setVelocitiesToTemperature(300, 1)
    integrator.step(100)
    return integrator, context


def nanoseconds(shape, platform, runs, steps=100000):
    """Processor time of a step: the least of several runs."""
    integrator, context = start(shape, platform)
    times = []
    for _ in range(runs):
        begin = time.process_time()
        integrator.step(steps)
        times.append((time.process_time() - begin)/steps*1e9)
    del context
    return min(times)


def instructions(shape, platform, steps=10000):
    """Instructions of a step, as callgrind counts them."""
    with tempfile.TemporaryDirectory() as folder:
        run = subprocess.run([
            'valgrind', '--tool=callgrind', '--collect-atstart=no', f'--toggle-collect={STEP}',
            f'--callgrind-out-file={folder}/out', sys.executable, __file__, '--platform', platform,
            '--only', shape,
            str(steps)
        ], capture_output=True, text=True, check=True)
    return int(re.search(r'refs:\s+([\d,]+)', run.stderr)[1].replace(',', ''))/(steps + 100)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--platform', default='Reference', help='Reference or CPU (Reference)')
    parser.add_argument('--runs', type=int, default=15, help='of which the least counts (15)')
    parser.add_argument('--instructions', action='store_true', help='count instructions instead')
    parser.add_argument('--only', nargs=2, metavar=('SHAPE', 'STEPS'), help='only take steps')
    options = parser.parse_args()
    if options.only:
        integrator, context = start(options.only[0], options.platform)
        integrator.step(int(options.only[1]))
        return
    for shape in SITES:
        if options.instructions:
            print(f'{shape}: {instructions(shape, options.platform):.0f} instructions a step')
        else:
            print(f'{shape}: {nanoseconds(shape, options.platform, options.runs):.1f} ns a step')


if __name__ == '__main__':
    main()
