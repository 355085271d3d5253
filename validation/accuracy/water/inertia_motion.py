"""How much slower water moves when its moments of inertia are scaled (setInertiaScale).

This is what longer steps cost in sampling. The water of inertia.py runs with LangevinC and factors
of 1, 4, 8 and 16. Measured are the diffusion coefficient of the molecules, and the time in which
their dipoles forget their direction. The script writes results_inertia/motion.json and prints the
table of README.md. It takes four minutes.
"""
import argparse
import os
import pathlib
import sys

for _variable in ('OPENBLAS_NUM_THREADS', 'OMP_NUM_THREADS'):
    os.environ.setdefault(_variable, '1')

import numpy as np  # noqa: E402
import openmm  # noqa: E402
from tqdm import tqdm  # noqa: E402

from openmmrigidhi import accuracy, analysis  # noqa: E402

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1]/'common'))
import campaign  # noqa: E402
import recording  # noqa: E402

INTERVAL = 0.12  # ps between frames: a multiple of every step
STEPS = {1: 0.008, 4: 0.012, 8: 0.012, 16: 0.015}  # ps, for each factor
FROM, TO = 1.2, 4.8  # ps: slopes are taken between these lag times
BLOCKS = 5


def simulate(scene, factor, frames, equilibration, seed, job):
    """Positions (frames, n, 3) in nm, orientations (frames, n, 4), the dipole in the body frame.

    The dipole is given as a unit vector.
    """
    step = STEPS[factor]
    state = campaign.State(job, (factor, equilibration, seed))
    kept = state.load()
    integrator = accuracy.methods.byName(f'LangevinC-I{factor}').makeIntegrator(scene, step, seed)
    context = scene.makeContext(integrator, openmm.Platform.getPlatformByName('CPU'),
                                {'Threads': '1'}, seed)
    every = round(INTERVAL/step)
    positions, orientations = list(kept.get('positions', ())), list(kept.get('orientations', ()))
    if kept:
        context.loadCheckpoint(kept['checkpoint'].tobytes())
    for frame in range(len(positions) if kept else -equilibration, frames):
        integrator.step(every)
        job.report((frame + 1 + equilibration)*every)
        if frame >= 0:
            positions.append(integrator.getBodyPositions()._value)
            orientations.append(integrator.getBodyOrientations())
        if frame >= 0 and (state.isDue() or frame == frames - 1):
            state.save(positions=positions, orientations=orientations,
                       checkpoint=campaign.checkpoint(context))
    oxygen, first, second = integrator.getRigidBodyParameters(0)[3]._value[:3]
    dipole = first + second - 2*oxygen
    return np.array(positions), np.array(orientations), dipole/np.linalg.norm(dipole)


def reorientationTime(orientations, dipole):
    """Reorientation time of dipoles, (ps, standard error).

    It is -1 over the slope of ln <cos of the angle that dipoles turn by> between FROM and TO, of
    blocks.
    """
    q, v = orientations[..., :1], orientations[..., 1:]
    directions = dipole + 2*np.cross(v, np.cross(v, dipole) + q*dipole)
    first, last = round(FROM/INTERVAL), round(TO/INTERVAL)
    times = []
    for block in np.array_split(directions, BLOCKS):
        cosines = [
            np.einsum('tik,tik->', block[:-lag], block[lag:])/block[lag:, :, 0].size
            for lag in (first, last)
        ]
        times.append((TO - FROM)/np.log(cosines[0]/cosines[1]))
    return np.mean(times), np.std(times, ddof=1)/np.sqrt(BLOCKS)


def diffusion(positions, orientations):
    """Diffusion coefficient, (nm^2/ps, standard error).

    It is a sixth of the slope of the molecules' mean square displacement between FROM and TO.
    """
    lags = range(round(FROM/INTERVAL), round(TO/INTERVAL) + 1, 5)
    msd = analysis.translationalMSD(positions, orientations, INTERVAL, (0, 0, 0), lags, BLOCKS)
    found = analysis.longTimeDiffusion(msd.trace, FROM, TO)
    return found.value._value/3, found.error._value/3


def follow(argument, job, scene):
    """One row of the table: the measurement with one factor."""
    factor, frames, equilibration, seed = argument
    positions, orientations, dipole = simulate(scene, factor, frames, equilibration, seed, job)
    D, tau = diffusion(positions, orientations), reorientationTime(orientations, dipole)
    return {
        'factor': factor,
        'step_ps': STEPS[factor],
        'length_ps': frames*INTERVAL,
        'equilibration_ps': equilibration*INTERVAL,
        'seed': seed,
        'diffusion_nm2_per_ps': D[0],
        'diffusion_error': D[1],
        'reorientation_ps': tau[0],
        'reorientation_error': tau[1]
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--length', type=float, default=96,
                        help='run time for each factor, ps (96)')
    parser.add_argument('--equilibration', type=float, default=6,
                        help='first part not counted, ps (6)')
    parser.add_argument('--seed', type=int, default=2030)
    parser.add_argument('--output', type=pathlib.Path, default=HERE/'results_inertia')
    campaign.addOptions(parser)
    options = campaign.settle(parser.parse_args())
    frames, equilibration = round(options.length/INTERVAL), round(options.equilibration/INTERVAL)
    with tqdm(desc='equilibrating', unit='step') as bar:
        scene = accuracy.scenes.water(216, seed=2026, threads=1,
                                      progress=lambda done, total: bar.update(done - bar.n))
    rows = campaign.run(follow, [(factor, frames, equilibration, options.seed + factor)
                                 for factor in STEPS], [f'factor {factor}' for factor in STEPS],
                        options, [(frames + equilibration)*round(INTERVAL/step)
                                  for step in STEPS.values()], 'step', 'motion', given=scene)
    recording.save(
        options.output, 'motion.json', {
            'scene': scene.description,
            'frame_interval_ps': INTERVAL,
            'blocks': BLOCKS,
            'lag_times_ps': [FROM, TO],
            'rows': rows,
            'provenance': recording.provenance(options)
        })
    print('\n| factor | step, fs | D, 1e-3 nm²/ps | dipoles forget in, ps |\n|---|---|---|---|')
    for row in rows:
        print(
            f'| {row["factor"]} | {1000*row["step_ps"]:g} | '
            f'{recording.brackets(1000*row["diffusion_nm2_per_ps"], 1000*row["diffusion_error"])} '
            f'| {recording.brackets(row["reorientation_ps"], row["reorientation_error"])} |')


if __name__ == '__main__':
    main()
