"""Would LangevinC gain by evaluating the reciprocal space of water less often?

The script measures which part of a force evaluation reciprocal space is, for 216 and 1000
molecules. It also measures the potential energy if reciprocal space kicks bodies in every N-th step
only, N times as long. This is an impulse method: one half of the kick comes before N steps of
LangevinC under the other forces, one half after them. The plugin has no such scheme. The kicks are
given here to body velocities between steps, which serves averages, not speed. The script writes
results_price/slow_forces.json.
"""
import argparse
import math
import os
import pathlib
import sys
import time

for _variable in ('OPENBLAS_NUM_THREADS', 'OMP_NUM_THREADS'):
    os.environ.setdefault(_variable, '1')

import numpy as np  # noqa: E402
import openmm  # noqa: E402
from tqdm import tqdm  # noqa: E402

from openmmrigidhi import accuracy  # noqa: E402
from openmmrigidhi.accuracy import methods, statistics  # noqa: E402

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1]/'common'))
import campaign  # noqa: E402
import recording  # noqa: E402

#: (method, time step in fs, N)
SETTINGS = (('LangevinC-I8', 14, 2), ('LangevinC-I8', 14, 3), ('LangevinC-I8', 16, 2),
            ('LangevinC-I8', 12, 3), ('LangevinC', 8, 2))
#: Numbers of molecules, and of force evaluations in one repetition.
BOXES = ((216, 40), (1000, 12))
REPETITIONS = 7
SAMPLE_INTERVAL, EQUILIBRATION = 0.2, 5.0
CPU = openmm.Platform.getPlatformByName('CPU')


def share(molecules, count, bar):
    """Processor seconds of one evaluation of forces: without, of, and with reciprocal space.

    Each is the median over repetitions; the three take turns.
    """
    scene = methods.reciprocalSpaceApart(
        accuracy.scenes.water(molecules, equilibration=1.0, threads=1, seed=2026))
    slow, fast = methods._force_groups(scene.system)
    context = scene.makeContext(openmm.VerletIntegrator(0.001), CPU, {'Threads': '1'}, 1)
    parts = {'without': set(fast), 'reciprocal': set(slow), 'all': set(fast + slow)}
    seconds = {name: [] for name in parts}
    for repetition in range(REPETITIONS + 1):
        for name, groups in parts.items():
            began = time.process_time()
            for _ in range(count):
                context.getState(getForces=True, groups=groups)
            if repetition > 0:
                seconds[name].append((time.process_time() - began)/count)
        bar.update(1)
    middle = {name: float(np.median(values)) for name, values in seconds.items()}
    return {
        'molecules': molecules,
        'seconds': middle,
        'scatter': {name: float(np.std(values, ddof=1))
                    for name, values in seconds.items()},
        'reciprocal_share': middle['reciprocal']/(middle['reciprocal'] + middle['without']),
        **netForces(scene, context, slow, fast)
    }


def netForces(scene, context, slow, fast):
    """Root mean square of bodies' net forces, kJ/(mol nm)."""
    bodies = Bodies(scene, 1.0)
    return {
        f'rms_force_{name}':
        float(np.sqrt((bodies.wrenches(context, set(groups))[0]**2).sum(axis=1).mean()))
        for name, groups in (('reciprocal', slow), ('others', fast))
    }


class Bodies:
    """Water molecules as bodies that forces on particles act upon."""
    def __init__(self, scene, inertiaScale):
        masses = np.array(
            [scene.system.getParticleMass(i)._value for i in range(scene.system.getNumParticles())])
        # OpenMM has already moved the forces on virtual sites to massive particles, and reports
        # both.
        self.members = np.array([[i for i in body if masses[i] > 0] for body in scene.bodies])
        self.masses = masses[self.members]
        self.inertiaScale = inertiaScale

    def wrenches(self, context, groups):
        """Net forces (n, 3), torques (n, 3), and inertia tensors (n, 3, 3), in the lab frame.

        Torques and inertia are about centres of mass.
        """
        state = context.getState(getPositions=True, getForces=True, groups=groups)
        positions = state.getPositions(asNumpy=True)._value[self.members]
        forces = state.getForces(asNumpy=True)._value[self.members]
        centres = np.einsum('bk,bki->bi', self.masses, positions)/self.masses.sum(axis=1)[:, None]
        arms = positions - centres[:, None]
        second = np.einsum('bk,bki,bkj->bij', self.masses, arms, arms)
        inertia = np.trace(second, axis1=1, axis2=2)[:, None, None]*np.eye(3) - second
        return forces.sum(axis=1), np.cross(arms, forces).sum(axis=1), self.inertiaScale*inertia

    def kick(self, context, integrator, groups, duration):
        """Let forces of these groups act for this duration on velocities alone."""
        force, torque, inertia = self.wrenches(context, groups)
        mass = self.masses.sum(axis=1)[:, None]
        integrator.setBodyVelocities(integrator.getBodyVelocities()._value + duration*force/mass)
        turned = np.linalg.solve(inertia, torque[:, :, None])[:, :, 0]
        integrator.setBodyAngularVelocities(integrator.getBodyAngularVelocities()._value +
                                            duration*turned)


def impulses(argument, job, scene):
    """Mean energy of LangevinC with kicks of reciprocal space in every `every`-th step.

    Between the kicks the other forces act.
    """
    name, step, every, length, seed = argument
    apart = methods.reciprocalSpaceApart(scene)
    slow, fast = (set(groups) for groups in methods._force_groups(apart.system))
    integrator = methods.byName(name).makeIntegrator(apart, step/1000, seed)
    integrator.setIntegrationForceGroups(fast)
    context = apart.makeContext(integrator, CPU, {'Threads': '1'}, seed)
    bodies = Bodies(apart, integrator.getInertiaScale())
    outer = every*step/1000
    stride = max(1, round(SAMPLE_INTERVAL/outer))
    energies, temperatures, done = [], [], 0
    result = {
        'method': name,
        'step_fs': step,
        'every': every,
        'outer_fs': every*step,
        'seed': seed,
        'equilibration_ps': EQUILIBRATION
    }
    cycles = math.ceil((length + EQUILIBRATION)/outer)
    try:
        for cycle in range(1, cycles + 1):
            bodies.kick(context, integrator, slow, outer/2)
            integrator.step(every)
            bodies.kick(context, integrator, slow, outer/2)
            done = cycle*outer
            job.report(done)
            if cycle % stride == 0:
                energy = context.getState(getEnergy=True).getPotentialEnergy()._value/len(
                    apart.bodies)
                if not -1000 < energy < 0:
                    raise openmm.OpenMMException(
                        f'the potential energy is {energy:.3g} kJ/mol a molecule')
                if done > EQUILIBRATION:
                    energies.append(energy)
                    temperatures.append(2*integrator.computeTranslationalKineticEnergy()._value/
                                        (3*len(apart.bodies)*accuracy.scenes.GAS_CONSTANT))
    except openmm.OpenMMException as error:
        return {**result, 'status': 'unstable', 'message': f'after {done:.3g} ps: {error}'}
    summary = statistics.seriesStatistics(np.array(energies))
    return {
        **result, 'status': 'stable',
        'length_ps': len(energies)*stride*outer,
        'energy': summary.mean,
        'standard_error': summary.standardError,
        'blocks': summary.degrees + 1,
        'tau_ps': summary.tau*stride*outer,
        'translational_temperature': float(np.mean(temperatures))
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--length', type=float, default=40,
                        help='run time of each setting, ps (40)')
    parser.add_argument('--seed', type=int, default=2032)
    parser.add_argument('--output', type=pathlib.Path, default=HERE/'results_price')
    campaign.addOptions(parser)
    options = campaign.settle(parser.parse_args())
    # This measurement runs alone, since it measures times.
    with tqdm(total=len(BOXES)*(REPETITIONS + 1), desc='shares', mininterval=2) as bar:
        shares = [share(*box, bar) for box in BOXES]
    for row in shares:
        print(row)
    todo = [(*setting, options.length, options.seed + k) for k, setting in enumerate(SETTINGS)]
    scene = accuracy.scenes.water(216, seed=2026, threads=1)
    rows = campaign.run(impulses, todo,
                        [f'impulses {name} {step} fs {every}'
                         for name, step, every, *_ in todo], options,
                        [options.length + EQUILIBRATION]*len(todo), 'ps', 'impulses', given=scene)
    for row in rows:
        print(row)
    recording.save(
        options.output, 'slow_forces.json', {
            'scene': scene.description,
            'shares': shares,
            'impulses': rows,
            'provenance': recording.provenance(options)
        })


if __name__ == '__main__':
    main()
