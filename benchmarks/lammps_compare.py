#!/usr/bin/python3
"""Langevin C here and in LAMMPS (fix nve/dotc/langevin): speed on one thread, and same physics.

Speed is in ns per free body and step. LAMMPS needs its packages ASPHERE and CG-DNA; Debian's build
lacks CG-DNA. Without such an executable the comparison is skipped with a message. In both programs
a body is one ellipsoid with mass 1 amu, semi-axes 0.5, 0.4, 0.3 nm, kT = 1 kJ/mol (LAMMPS's reduced
units with nm, amu and kJ/mol; the time unit is then 1 ps).

    PYTHONPATH=build/python /usr/bin/python3 benchmarks/lammps_compare.py --lmp lmp
"""
import argparse
import pathlib
import re
import shutil
import subprocess
import tempfile
import time

import numpy as np
import openmm
import tqdm
from openmm import unit

import openmmrigidhi
from common import RESULTS, describeMachine, save, show, spread

MASS, SEMI_AXES = 1.0, (0.5, 0.4, 0.3)
KT = 1.0  # kJ/mol
GAMMA, ROTATIONAL_FRICTION = 1.0, 2.0  # 1/ps
LOOP_TIME = re.compile(r'Loop time of ([\d.eE+-]+) on')

INPUT = """
units lj
boundary p p p
atom_style ellipsoid
lattice sc 1.0
region box block 0 {side} 0 {side} 0 {side}
create_box 1 box
create_atoms 1 box
set type 1 mass {mass}
set type 1 shape {diameters}
set type 1 quat/random 123
velocity all create 1.0 4711
comm_modify cutoff 0.5
neighbor 0.3 bin
neigh_modify every 100 delay 0 check no
pair_style none
timestep {step}
{trap}
fix 1 all nve/dotc/langevin {kT} {kT} {period} 457145 angmom {ratio}
"""
TIMING = """
thermo 1000000
run {warmup}
run {steps}
"""
PHYSICS = """
compute translation all temp
compute all_asphere all temp/asphere dof all
fix average all ave/time 1 1 10 c_translation c_all_asphere file {file}
thermo 1000000
run {steps}
"""


def moments():
    a, b, c = (axis**2 for axis in SEMI_AXES)
    return MASS/5*np.array([b + c, a + c, a + b])


def hasFix(lmp):
    """Whether an executable has the fix; Debian's does not have it."""
    if lmp is None:
        return False
    script = INPUT.format(side=2, mass=MASS, diameters='1 1 1', step=0.01, kT=1, period=1, ratio=1,
                          trap='')
    with tempfile.TemporaryDirectory() as folder:
        return runLammps(lmp, script, folder, check=False).returncode == 0


def runLammps(lmp, script, folder, check=True):
    (pathlib.Path(folder)/'in.lmp').write_text(script)
    return subprocess.run([lmp, '-in', 'in.lmp', '-log', 'none'], cwd=folder, capture_output=True,
                          text=True, check=check, env={
                              'OMP_NUM_THREADS': '1',
                              'PATH': '/usr/bin:/bin'
                          })


def lammpsInput(side, step, trap=''):
    return INPUT.format(side=side, mass=MASS, diameters=' '.join(str(2*axis) for axis in SEMI_AXES),
                        step=step, kT=KT, period=1/GAMMA, ratio=ROTATIONAL_FRICTION/GAMMA,
                        trap=trap)


def makeOurs(count, step, platformName='CPU', stiffness=0, law='Gaussian'):
    """The same bodies in OpenMM, with one particle each."""
    system = openmm.System()
    integrator = openmmrigidhi.CustomRigidHIIntegrator(KT/unit.MOLAR_GAS_CONSTANT_R._value*1000,
                                                       step)
    positions = np.array(list(np.ndindex(*[int(np.ceil(count**(1/3)))]*3)))[:count].astype(float)
    if stiffness > 0:
        trap = openmm.CustomExternalForce('k/2*((x-x0)^2+(y-y0)^2+(z-z0)^2)')
        trap.addGlobalParameter('k', stiffness)
        for name in ('x0', 'y0', 'z0'):
            trap.addPerParticleParameter(name)
        for i in range(count):
            trap.addParticle(i, positions[i])
        system.addForce(trap)
    for _ in range(count):
        particle = system.addParticle(MASS)
        integrator.addRigidBody([particle], MASS, openmm.Vec3(*moments()), [openmm.Vec3(0, 0, 0)])
    integrator.setFriction(GAMMA)
    integrator.setRotationalFriction(ROTATIONAL_FRICTION)
    integrator.setNoiseLaw(getattr(integrator, law))
    integrator.setRandomNumberSeed(1)
    properties = {'Threads': '1'} if platformName == 'CPU' else {}
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName(platformName),
                             properties)
    context.setPositions(positions)
    context.setVelocitiesToTemperature(integrator.getTemperature(), 1)
    return context, integrator


def compareSpeed(lmp, count, steps, rounds):
    """Nanoseconds per body and step of each program; the programs take turns in each round."""
    side = round(count**(1/3))
    count = side**3
    step = 0.002
    times = {
        'LAMMPS': [],
        'here, CPU, Gaussian noise': [],
        'here, CPU, three-point noise': [],
        'here, Reference': []
    }
    own = {name: [] for name in times if name != 'LAMMPS'}
    ours = {
        'here, CPU, Gaussian noise': makeOurs(count, step),
        'here, CPU, three-point noise': makeOurs(count, step, law='ThreePoint'),
        'here, Reference': makeOurs(count, step, 'Reference')
    }
    script = lammpsInput(side, step) + TIMING.format(warmup=steps // 10, steps=steps)
    for _, integrator in ours.values():
        integrator.step(steps // 10)
    with tempfile.TemporaryDirectory() as folder:
        for _ in tqdm.trange(rounds, desc=f'{count} bodies'):
            loop = LOOP_TIME.findall(runLammps(lmp, script, folder).stdout)[-1]
            times['LAMMPS'].append(1e9*float(loop)/steps/count)
            for name, (_, integrator) in ours.items():
                before = integrator.getStepStatistics()['seconds_scheme']
                start = time.perf_counter()
                integrator.step(steps)
                times[name].append(1e9*(time.perf_counter() - start)/steps/count)
                own[name].append(
                    1e9*(integrator.getStepStatistics()['seconds_scheme'] - before)/steps/count)
    return {
        'bodies': count,
        'steps': steps,
        'rounds': rounds,
        'ns_per_body_and_step': {name: spread(values)
                                 for name, values in times.items()},
        'ns_per_body_and_step_own_part': {name: spread(values)
                                          for name, values in own.items()},
        'LAMMPS_over_here': {
            name: spread([a/b for a, b in zip(times['LAMMPS'], times[name])])
            for name in ours
        }
    }


def mean(series, blocks=20):
    blockMeans = np.array([block.mean() for block in np.array_split(np.asarray(series), blocks)])
    return float(blockMeans.mean()), float(blockMeans.std(ddof=1)/np.sqrt(blocks))


def comparePhysics(lmp, steps, equilibration=500):
    """Kinetic temperatures over kT of bodies in traps with h omega = 0.6, in both programs.

    The traps are harmonic. For a harmonic oscillator Langevin C gives <p^2/m> = kT (1 - (h
    omega)^2/4) exactly. Rotation is free, so its kinetic temperature is kT. Translation thus tells
    Langevin C from A and B, and rotation checks the rotational noise.
    """
    side, step, stiffness = 10, 0.1, 36.0
    count = side**3
    hOmega = step*np.sqrt(stiffness/MASS)
    with tempfile.TemporaryDirectory() as folder:
        runLammps(
            lmp,
            lammpsInput(side, step, f'fix trap all spring/self {stiffness}') +
            PHYSICS.format(steps=steps, file='average.txt'), folder)
        translation, both = np.loadtxt(pathlib.Path(folder)/'average.txt').T[1:]
    first = equilibration // 10
    # compute temp divides by 3N - 3 degrees of freedom, compute temp/asphere by 6N - 3. The traps
    # remove none.
    translational = translation*(3*count - 3)
    lammps = {
        'translation': mean(translational[first:]/(3*count)),
        'rotation': mean((both*(6*count - 3) - translational)[first:]/(3*count))
    }
    context, integrator = makeOurs(count, step, stiffness=stiffness)
    integrator.step(equilibration)
    series = []
    for _ in tqdm.trange((steps - equilibration) // 10, desc='Kinetic temperatures'):
        integrator.step(10)
        series.append([
            integrator.computeTranslationalKineticEnergy()._value*2/(3*count*KT),
            integrator.computeRotationalKineticEnergies()._value.sum()*2/(3*count*KT)
        ])
    here = {
        name: mean(column)
        for name, column in zip(('translation', 'rotation'), np.transpose(series))
    }
    expected = {'translation': 1 - hOmega**2/4, 'rotation': 1.0}
    return {
        'bodies': count,
        'steps': steps,
        'h_omega': hOmega,
        'kinetic_temperature_over_kT': {
            name: {
                'expected': expected[name],
                'LAMMPS': lammps[name],
                'here': here[name],
                'z_LAMMPS': (lammps[name][0] - expected[name])/lammps[name][1],
                'z_here': (here[name][0] - expected[name])/here[name][1]
            }
            for name in expected
        }
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--lmp', default='lmp', help='LAMMPS with the packages ASPHERE and CG-DNA')
    parser.add_argument('--rounds', type=int, default=7)
    parser.add_argument('--body-steps', type=float, default=5e6,
                        help='bodies times steps of each turn of a program')
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    arguments = parser.parse_args()
    lmp = shutil.which(arguments.lmp)
    if not hasFix(lmp):
        print(f'Skipped: {arguments.lmp} ' +
              ('is not installed' if lmp is None else 'does not know fix nve/dotc/langevin') +
              '; give a LAMMPS with the packages ASPHERE and CG-DNA by --lmp')
        return
    lmp = str(pathlib.Path(lmp).resolve())
    machine = describeMachine()
    version = subprocess.run([lmp, '-h'], capture_output=True, text=True).stdout
    result = {
        'lammps': re.search(r'Simulator - (.*)', version).group(1),
        'speed': [],
        'physics': comparePhysics(lmp, 20000)
    }
    for name, row in result['physics']['kinetic_temperature_over_kT'].items():
        print(f'kinetic temperature of {name:12} over kT: expected {row["expected"]:.4f}; LAMMPS '
              f'{row["LAMMPS"][0]:.4f} +- {row["LAMMPS"][1]:.4f} (z = {row["z_LAMMPS"]:+.1f}); '
              f'here {row["here"][0]:.4f} +- {row["here"][1]:.4f} (z = {row["z_here"]:+.1f})')
    for count in (1000, 8000):
        speed = compareSpeed(lmp, count, max(100, int(arguments.body_steps/count)),
                             arguments.rounds)
        result['speed'].append(speed)
        print(f'{speed["bodies"]} free bodies, ns per body and step, median (quartiles):')
        for name, values in speed['ns_per_body_and_step'].items():
            extra = '' if name == 'LAMMPS' else (
                f'; LAMMPS takes {show(speed["LAMMPS_over_here"][name], 2)} times as long')
            print(f'  {name:30} {show(values, 1)}{extra}')
    save(arguments.output, 'lammps_compare.json', machine, result)


if __name__ == '__main__':
    main()
