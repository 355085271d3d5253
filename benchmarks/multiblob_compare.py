#!/usr/bin/python3
r"""A step of boomerangs above a wall here and in RigidMultiblobsWall, in turns.

RigidMultiblobsWall (github.com/stochasticHydroTools/RigidMultiblobsWall) is the Python code of the
literature. It is not part of this repository; --code names its folder. It needs python3-numba, with
which its products run on all threads. Without it the comparison is skipped with a message. In both
codes bodies of 15 blobs lie on a square lattice 3 radii above the wall, with gravity and a
repulsion from the wall. There are no forces between bodies. The tolerance is 1e-3 where there are
many bodies. The time of RigidMultiblobsWall is the difference of two runs of different length, so
that starting and compiling do not count. It includes the few forces. The time of this plugin is a
step without OpenMM's forces.

    PYTHONPATH=build/python /usr/bin/python3 benchmarks/multiblob_compare.py \
        --code path/to/RigidMultiblobsWall
"""
import os

os.environ['OPENBLAS_NUM_THREADS'] = '1'
from instructions import HELP, keepToAvx2IfAsked  # noqa: E402

keepToAvx2IfAsked()
import argparse  # noqa: E402  (what is set above is set before numpy is imported)
import importlib.metadata  # noqa: E402
import math  # noqa: E402
import pathlib  # noqa: E402
import subprocess  # noqa: E402
import sys  # noqa: E402
import tempfile  # noqa: E402

import numpy as np  # noqa: E402
import tqdm  # noqa: E402
from openmmrigidhi import MobilityForce  # noqa: E402

from common import RESULTS, describeMachine, save, show, spread  # noqa: E402
from overdamped import RADIUS, time  # noqa: E402

TOLERANCE, STEP = 1e-3, 1e-4
#: (bodies, distance in um, threads, steps timed, {scheme here: scheme there})
CASES = ((64, 4.0, 2, 40, {
    'TrapezoidalSlip': 'stochastic_Slip_Trapz',
    'DriftCorrectorRFD': 'stochastic_GDC_RFD'
}), (64, 2.6, 2, 40, {
    'TrapezoidalSlip': 'stochastic_Slip_Trapz'
}), (1, 4.0, 1, 400, {
    'TrapezoidalSlip': 'stochastic_Slip_Trapz',
    'DriftCorrectorRFD': 'stochastic_GDC_RFD',
    'FixmanMidpoint': 'Fixman',
    'RandomFiniteDifference': 'stochastic_first_order_RFD_dense_algebra'
}))
INPUT = """
scheme {scheme}
mobility_blobs_implementation python
mobility_vector_prod_implementation numba
blob_blob_force_implementation None
body_body_force_torque_implementation None
dt {step}
n_steps {steps}
n_save 1000000
initial_step 0
solver_tolerance {tolerance}
eta 8.9e-04
g 0.0001539384
blob_radius {radius}
kT 0.0041419464
rf_delta 1.0e-6
repulsion_strength_wall 0.095713728509
debye_length_wall 0.162278695459
output_name run
save_clones one_file
structure {code}/multi_bodies/Structures/boomerang_N_15.vertex bodies.clones
"""


def theirSeconds(code, scheme, count, apart, threads, steps):
    """Seconds a step of RigidMultiblobsWall."""
    side, atFirst, total = math.ceil(math.sqrt(count)), 5, []
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        places = ''.join(f'{apart*(b % side)} {apart*(b//side)} {3*RADIUS} 1 0 0 0\n'
                         for b in range(count))
        (folder/'bodies.clones').write_text(f'{count}\n{places}')
        for length in (atFirst, atFirst + steps):
            (folder/'input.dat').write_text(
                INPUT.format(scheme=scheme, step=STEP, steps=length, tolerance=TOLERANCE,
                             radius=RADIUS, code=code))
            done = subprocess.run([
                sys.executable,
                str(code/'multi_bodies'/'multi_bodies.py'), '--input-file', 'input.dat'
            ], cwd=folder, capture_output=True, text=True,
                                  env=dict(os.environ, NUMBA_NUM_THREADS=str(threads),
                                           PYTHONPATH=f'{code}:{code/"multi_bodies"}'))
            if done.returncode or not (folder/'run.time').exists():
                raise SystemExit(
                    f'RigidMultiblobsWall did not run {scheme}:\n{done.stderr[-2000:]}')
            total.append(float((folder/'run.time').read_text().split()[0]))
    return (total[1] - total[0])/steps


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--code', type=pathlib.Path, help='folder of RigidMultiblobsWall')
    parser.add_argument('--rounds', type=int, default=5)
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    parser.add_argument('--avx2', action='store_true', help=HELP)
    arguments = parser.parse_args()
    if arguments.code is None or not (arguments.code/'multi_bodies'/'multi_bodies.py').exists():
        print(
            'Skipped: give the folder of RigidMultiblobsWall, with multi_bodies/multi_bodies.py in '
            'it, by --code.')
        return
    try:
        numba = importlib.metadata.version('numba')
    except importlib.metadata.PackageNotFoundError:
        print('Skipped: RigidMultiblobsWall needs numba (python3-numba).')
        return
    code, rows, machine = arguments.code.resolve(), [], describeMachine()
    for count, apart, threads, steps, schemes in CASES:
        for ours, theirs in tqdm.tqdm(schemes.items(), desc=f'{count} boomerangs'):
            options = {
                'platform': 'CPU',
                'solver': MobilityForce.MatrixFree,
                'tolerance': TOLERANCE
            } if count > 1 else {
                'platform': 'Reference'
            }
            pairs = []
            for _ in range(arguments.rounds):
                pairs.append((theirSeconds(code, theirs, count, apart, threads, steps),
                              float(
                                  np.median(
                                      time(5, 0.05, threads, scheme=ours, count=count, apart=apart,
                                           **options)[0]))))
            pairs = 1e3*np.array(pairs)
            row = {
                'bodies': count,
                'apart_um': apart,
                'threads': threads,
                'scheme': ours,
                'their_name': theirs,
                'their_ms_step': spread(pairs[:, 0]),
                'our_ms_step': spread(pairs[:, 1]),
                'ratio': spread(pairs[:, 0]/pairs[:, 1])
            }
            rows.append(row)
            tqdm.tqdm.write(
                f'  {count:3} at {apart} um {ours:24} theirs {show(row["their_ms_step"])} ms, ours '
                f'{show(row["our_ms_step"])} ms, ratio {show(row["ratio"], 1)}')
    save(arguments.output, 'multiblob_compare.json', machine, {
        'rounds': arguments.rounds,
        'numba': numba,
        'rows': rows
    })


if __name__ == '__main__':
    main()
