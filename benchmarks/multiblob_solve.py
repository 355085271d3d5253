#!/usr/bin/python3
r"""Shells of blobs above a wall: a solve and a step here and in RigidMultiblobsWall, in turns.

The script also says what a solve and a step are made of. Shells of 12, 42, 162 and 642 blobs
represent a sphere of radius 1. They are turned at random, in a layer above the wall, at two
distances. A solve is the mobility problem for random forces and torques. A step is one of
trapezoidal slip, or of the drift-corrector with random finite differences.

RigidMultiblobsWall (github.com/stochasticHydroTools/RigidMultiblobsWall) is not part of this
repository; --code names its folder. It needs python3-numba, with which its products run on all
threads. It runs in a process of its own. Both processes are warmed up. Each round times first
RigidMultiblobsWall and then this plugin, while the other waits.

The preconditioner of RigidMultiblobsWall consists of the bodies' own matrices with the wall. By
default it is made anew in each step, and so it is here; a solve is timed without it.
RigidMultiblobsWall takes the last solution for a first guess, so each solve here is for other
forces. Times are given by the clock and by the processors; other processes on a busy machine
disturb the latter less. Without --code this plugin is measured alone. With --avx2 neither program
uses AVX-512, so that ratios of a machine without it can be measured on one with it.

    PYTHONPATH=build/python /usr/bin/python3 benchmarks/multiblob_solve.py \
        --code path/to/RigidMultiblobsWall
"""
import os

os.environ['OPENBLAS_NUM_THREADS'] = '1'
from instructions import HELP, keepToAvx2IfAsked  # noqa: E402

keepToAvx2IfAsked()
import argparse  # noqa: E402  (what is set above is set before numpy is imported)
import importlib.metadata  # noqa: E402
import json  # noqa: E402
import math  # noqa: E402
import pathlib  # noqa: E402
import subprocess  # noqa: E402
import sys  # noqa: E402
import tempfile  # noqa: E402
import time  # noqa: E402

import numpy as np  # noqa: E402
import openmm  # noqa: E402
import tqdm  # noqa: E402
from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce, app  # noqa: E402

from common import RESULTS, describeMachine, save, show, spread  # noqa: E402

#: blobs of a shell: number of shells
COUNTS = {12: 100, 42: 100, 162: 100, 642: 25}
#: name: (distance of neighbours in the layer, height of the lowest centre, range of heights above
#: it); the unit is the distance from a centre to the outside of its blobs
LAYERS = {'loose': (3.5, 1.4, 1.0), 'close': (2.3, 1.1, 0.4)}
TOLERANCES = (1e-3, 1e-6)
#: scheme here: scheme there
STEPS = {'TrapezoidalSlip': 'stochastic_Slip_Trapz', 'DriftCorrectorRFD': 'stochastic_GDC_RFD'}
# kJ/mol at 300 K; dalton/(nm ps); ps; the finite difference of RigidMultiblobsWall.
KT, VISCOSITY, STEP, DIFFERENCE = 2.494339, 1.0, 0.02, 1e-3
GOALS = {'solve': 5, 'step': 8}
#: The process of RigidMultiblobsWall: it reads a line of JSON, and answers with seconds.
THEIRS = r'''
import json, sys, time
from functools import partial
import numpy as np
import multi_bodies
from body import body
from quaternion_integrator.quaternion import Quaternion
from quaternion_integrator.quaternion_integrator_multi_bodies import QuaternionIntegrator
scene = np.load(sys.argv[1])
a, eta, kT, delta = (float(x) for x in scene['numbers'])
sites, places, turns, forces = scene['sites'], scene['places'], scene['turns'], scene['forces']
bodies = []
for place, turn in zip(places, turns):
    b = body.Body(place, Quaternion(turn), sites, a)
    b.mobility_blobs = multi_bodies.set_mobility_blobs('python')
    b.body_length = float(scene['length'])
    bodies.append(b)
bodies = np.array(bodies)
blobs = len(bodies)*len(sites)
integrator = QuaternionIntegrator(bodies, blobs, 'none', tolerance=1e-3, domain='single_wall')
for name in ('build_block_diagonal_preconditioner',
             'build_block_diagonal_preconditioners_det_stoch',
             'build_block_diagonal_preconditioners_det_identity_stoch', 'get_blobs_r_vectors',
             'calc_K_matrix_bodies', 'calc_K_matrix', 'K_matrix_T_vector_prod',
             'K_matrix_vector_prod', 'calc_C_matrix_constraints'):
    setattr(integrator, name, getattr(multi_bodies, name))
integrator.linear_operator = multi_bodies.linear_operator_rigid
multi_bodies.mobility_vector_prod = multi_bodies.set_mobility_vector_prod('numba')
integrator.mobility_vector_prod = multi_bodies.mobility_vector_prod
integrator.mobility_blobs = multi_bodies.set_mobility_blobs('python')
integrator.force_torque_calculator = lambda bodies, r: forces.copy()
integrator.preprocess = integrator.postprocess = lambda bodies: None
integrator.periodic_length = np.zeros(3)
integrator.eta, integrator.a, integrator.kT, integrator.rf_delta = eta, a, kT, delta
integrator.update_PC, integrator.constraints, integrator.articulated = 1, [], []
integrator.print_residual, integrator.first_guess = False, None
random = np.random.default_rng(1)
np.random.seed(1)
preconditioner = {}
def back():
    for b, place, turn in zip(bodies, places, turns):
        b.location, b.orientation = place.copy(), Quaternion(turn)
for line in sys.stdin:
    task = json.loads(line)
    integrator.tolerance = task['tolerance']
    back()
    integrator.det_iterations_count = integrator.stoch_iterations_count = 0
    r = integrator.get_blobs_r_vectors(bodies, blobs)
    seconds = []
    def begins():
        return time.time(), time.process_time()
    def passed(begin):
        seconds.append((time.time() - begin[0], time.process_time() - begin[1]))
    if task['what'] == 'preconditioner':
        begin = begins()
        integrator.build_block_diagonal_preconditioner(bodies, [], r, blobs, eta, a, step=0,
                                                       update_PC=1)
        passed(begin)
    elif task['what'] == 'solve':
        if not preconditioner:
            preconditioner['it'] = integrator.build_block_diagonal_preconditioner(
                bodies, [], r, blobs, eta, a, step=0, update_PC=1)
        for _ in range(task['times']):
            rhs = np.concatenate([np.zeros(3*blobs), -random.normal(size=6*len(bodies))])
            begin = begins()
            integrator.solve_mobility_problem(RHS=rhs, PC_partial=preconditioner['it'])
            passed(begin)
    elif task['what'] == 'product':
        for _ in range(task['times']):
            f = random.normal(size=3*blobs)
            begin = begins()
            multi_bodies.mobility_vector_prod(r, f, eta, a, periodic_length=np.zeros(3))
            passed(begin)
    else:
        integrator.first_guess = None
        for _ in range(task['times']):
            begin = begins()
            getattr(integrator, task['what'])(task['step'], step=0)
            passed(begin)
    iterations = [integrator.det_iterations_count, integrator.stoch_iterations_count]
    print(json.dumps({'seconds': seconds, 'iterations': iterations}), flush=True)
'''


def layer(count, spacing, lowest, spread_, seed=1):
    """Centres and orientations (w, x, y, z) of spheres of radius 1 in a layer, with gaps >= 0.1."""
    random, side = np.random.default_rng(seed), math.ceil(math.sqrt(count))
    reach = (spacing - 2.1)/2/math.sqrt(2)
    centres = np.array([(spacing*(b % side), spacing*(b // side), 0.0) for b in range(count)])
    centres[:, :2] += random.uniform(-reach, reach, (count, 2))
    centres[:, 2] = lowest + spread_*random.uniform(size=count)
    turns = random.normal(size=(count, 4))
    return centres, turns/np.linalg.norm(turns, axis=1, keepdims=True)


def matrix(q):
    w, x, y, z = q
    return np.array([[1 - 2*(y*y + z*z), 2*(x*y - w*z), 2*(x*z + w*y)],
                     [2*(x*y + w*z), 1 - 2*(x*x + z*z), 2*(y*z - w*x)],
                     [2*(x*z - w*y), 2*(y*z + w*x), 1 - 2*(x*x + y*y)]])


class Ours:
    """A Context with the scene."""
    def __init__(self, sites, radius, centres, turns, scheme, tolerance, threads):
        self.fluid, system = MobilityForce(), openmm.System()
        self.integrator = CustomRigidHIIntegrator(300, STEP)
        self.integrator.setScheme(getattr(CustomRigidHIIntegrator, scheme))
        self.integrator.setRandomNumberSeed(1)
        self.fluid.setBoundary(MobilityForce.NoSlipWall)
        self.fluid.setViscosity(VISCOSITY)
        self.fluid.setSolver(MobilityForce.MatrixFree)
        self.fluid.setSolverTolerance(tolerance)
        positions = []
        for centre, turn in zip(centres, turns):
            app.addRigidMultiblob(system, self.integrator, self.fluid, sites, radius)
            positions.extend(centre + sites @ matrix(turn).T)
        system.addForce(self.fluid)
        self.context = openmm.Context(system, self.integrator,
                                      openmm.Platform.getPlatformByName('CPU'),
                                      {'Threads': str(threads)})
        self.positions, self.count, self.random = positions, len(centres), np.random.default_rng(1)
        self.context.setPositions(positions)
        self.integrator.getBodyPositions()

    def solve(self, times):
        """Seconds of solves, by the clock and by the processors."""
        seconds = []
        for _ in range(times):
            wrenches = self.random.normal(size=(self.count, 6))
            begin, cpu = time.time(), time.process_time()
            self.fluid.applyMobilityInContext(self.context, wrenches)
            seconds.append((time.time() - begin, time.process_time() - cpu))
        return seconds

    def step(self, times):
        """Seconds of steps from the start, by the clock and by the processors, and their parts.

        The clock's time is without OpenMM's forces.
        """
        seconds, before = [], self.integrator.getStepStatistics()
        for _ in range(times):
            self.context.setPositions(self.positions)
            begin, cpu = self.integrator.getStepStatistics(), time.process_time()
            self.integrator.step(1)
            cpu, after = time.process_time() - cpu, self.integrator.getStepStatistics()
            seconds.append((sum(after[key] - begin[key]
                                for key in ('seconds_mobility', 'seconds_scheme')), cpu))
        return seconds, {
            key: (after[key] - before[key])/times
            for key in ('mobilityProducts', 'solverIterations')
        }


class Theirs:
    """RigidMultiblobsWall in a process of its own, with the same scene."""
    def __init__(self, code, sites, radius, centres, turns, forces, threads):
        self.folder = tempfile.TemporaryDirectory()
        path = pathlib.Path(self.folder.name)
        length = max(np.linalg.norm(sites - site, axis=1).max() for site in sites) + 2*radius
        np.savez(path/'scene.npz', sites=sites, places=centres, turns=turns, forces=forces,
                 numbers=(radius, VISCOSITY, KT, DIFFERENCE), length=length)
        (path/'theirs.py').write_text(THEIRS)
        self.errors = open(path/'errors', 'w+')
        self.process = subprocess.Popen([sys.executable, 'theirs.py', 'scene.npz'], cwd=path,
                                        stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                        stderr=self.errors, text=True, env=dict(
                                            os.environ, NUMBA_NUM_THREADS=str(threads),
                                            OPENBLAS_NUM_THREADS=str(threads),
                                            PYTHONPATH=f'{code}:{code/"multi_bodies"}'))

    def ask(self, what, tolerance=1e-3, times=1):
        """(seconds, all iterations of its solver and of its noise)"""
        print(json.dumps({
            'what': what,
            'tolerance': tolerance,
            'times': times,
            'step': STEP
        }), file=self.process.stdin, flush=True)
        for line in self.process.stdout:
            if line.startswith('{'):
                answer = json.loads(line)
                return answer['seconds'], answer['iterations']
        self.errors.seek(0)
        raise SystemExit(f'RigidMultiblobsWall did not do {what}:\n{self.errors.read()[-2000:]}')

    def close(self):
        self.process.stdin.close()
        self.process.wait()
        self.errors.close()
        self.folder.cleanup()


def timesOf(seconds, wanted):
    return int(min(20, max(1, wanted/max(seconds, 1e-6))))


def measure(code, blobs, name, what, tolerance, arguments):
    """A row: seconds of a solve, or of a step of a scheme, here and in RigidMultiblobsWall."""
    sites, radius = (np.array(x._value) if hasattr(x, '_value') else x
                     for x in app.multiblobSphere(blobs, 1.0))
    radius = float(radius)
    centres, turns = layer(COUNTS[blobs], *LAYERS[name])
    centres *= np.linalg.norm(sites, axis=1).max() + radius
    forces = np.zeros((2*len(centres), 3))
    scheme = what if what != 'solve' else 'TrapezoidalSlip'
    ours = Ours(sites, radius, centres, turns, scheme, tolerance, arguments.threads)
    act = ours.solve if what == 'solve' else (lambda times: ours.step(times)[0])
    times = timesOf(min(act(2))[0], arguments.seconds)
    theirs, pairs, row = None, [], {
        'blobs': blobs,
        'shells': COUNTS[blobs],
        'layer': name,
        'what': what,
        'tolerance': tolerance
    }
    if what != 'solve':
        row.update(ours.step(2)[1])
    if code is not None:
        theirs = Theirs(code, sites, radius, centres, turns, forces, arguments.threads)
        task = what if what == 'solve' else STEPS[what]
        theirs.ask('product')
        taken, row['their_iterations'] = theirs.ask(task, tolerance)
        if what == 'solve':
            row['their_preconditioner_ms'] = 1e3*theirs.ask('preconditioner')[0][0][0]
        if taken[0][0] >= arguments.long:
            # A start of seconds does not matter here: the first time is the only round.
            pairs.append((taken[0], np.median(act(times), axis=0)))
        else:
            theirTimes = timesOf(taken[0][0], arguments.seconds)
            for _ in range(arguments.rounds):
                pairs.append((np.median(theirs.ask(task, tolerance, theirTimes)[0],
                                        axis=0), np.median(act(times), axis=0)))
        theirs.close()
        pairs = 1e3*np.array(pairs)
        (clock, processors), ratio = pairs.transpose(2, 1, 0), (pairs[:, 0]/pairs[:, 1]).T
        row.update(their_ms=spread(clock[0]), our_ms=spread(clock[1]), ratio=spread(ratio[0]),
                   their_processor_ms=spread(processors[0]), our_processor_ms=spread(processors[1]),
                   ratio_of_processors=spread(ratio[1]), rounds=len(pairs))
        tqdm.tqdm.write(
            f'  {blobs:4} {name:6} {what:18} {tolerance:5g}: theirs {show(row["their_ms"], 1)} ms, '
            f'ours {show(row["our_ms"], 2)} ms, ratio {show(row["ratio"], 1)}, of processor time '
            f'{show(row["ratio_of_processors"], 1)}')
    else:
        clock, processors = 1e3*np.array(
            [np.median(act(times), axis=0) for _ in range(arguments.rounds)]).T
        row.update(our_ms=spread(clock), our_processor_ms=spread(processors))
        tqdm.tqdm.write(
            f'  {blobs:4} {name:6} {what:18} {tolerance:5g}: ours {show(row["our_ms"], 2)} ms')
    return row


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--code', type=pathlib.Path, help='folder of RigidMultiblobsWall')
    parser.add_argument('--rounds', type=int, default=5)
    parser.add_argument('--seconds', type=float, default=0.5,
                        help='seconds of solves or steps in a round, which has at least one')
    parser.add_argument('--long', type=float, default=20,
                        help='one round, the first, if one solve or step there takes these seconds')
    parser.add_argument('--blobs', type=int, nargs='*', default=list(COUNTS))
    parser.add_argument('--layers', nargs='*', default=list(LAYERS))
    parser.add_argument('--what', nargs='*', default=['solve', *STEPS])
    parser.add_argument('--threads', type=int, default=2)
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    parser.add_argument('--avx2', action='store_true', help=HELP)
    arguments = parser.parse_args()
    code, numba = None, None
    if arguments.code is not None and (arguments.code/'multi_bodies'/'multi_bodies.py').exists():
        try:
            numba = importlib.metadata.version('numba')
            code = arguments.code.resolve()
        except importlib.metadata.PackageNotFoundError:
            print('RigidMultiblobsWall needs numba (python3-numba): ours is measured alone.')
    else:
        print(
            'Without the folder of RigidMultiblobsWall (--code, with multi_bodies/multi_bodies.py '
            'in it) ours is measured alone.')
    machine, rows = describeMachine(), []
    cases = [(blobs, name, what, tolerance) for blobs in arguments.blobs
             for name in arguments.layers for what in arguments.what for tolerance in TOLERANCES]
    for case in tqdm.tqdm(cases):
        rows.append(measure(code, *case, arguments))
        # Results are saved after each row, since RigidMultiblobsWall may take hours.
        save(
            arguments.output, 'multiblob_solve.json', machine, {
                'rounds': arguments.rounds,
                'threads': arguments.threads,
                'numba': numba,
                'goals': GOALS,
                'rows': rows
            })


if __name__ == '__main__':
    main()
