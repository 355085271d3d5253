#!/usr/bin/env python3
"""Westwood 2022, Figures 4 and 5: a boomerang above a wall, error against step, all schemes.

The error is the distance in L2 of the densities of height and tilt from those of quadrature, at
steps of 0.1, 0.2 and 0.3 diffusive times of a blob. At finite length noise remains. Its part is
estimated from the spread of replicas, and the error without it is given, too. The paper ran the
trapezoidal slip scheme and both drift-correctors for 36 replicas of 30000 diffusive times. The slip
is the random surface velocity of the bodies. The drift-correctors of the paper scale the whole step
by nu. Those named +SlipOnly scale the noise alone, which is this library's default.

    python3 boomerang_steps.py                          # until the errors are small, or an hour a
                                                        # scheme and step
    python3 boomerang_steps.py --minutes 5 --jobs 2     # up to five minutes each, two at a time;
                                                        # the same command again goes on
    python3 boomerang_steps.py --quick                  # seconds

Units: blob radius 1 (and spacing 1), kT = 1, diffusive time 6 pi eta a^3/kT = 1.
"""
import pathlib
import sys

import numpy as np
from openmmrigidhi import app

HERE = pathlib.Path(__file__).resolve().parent
sys.path.append(str(HERE.parent/'common'))
import runs  # noqa: E402
import wallpictures as pictures  # noqa: E402
from equilibrium import Equilibrium  # noqa: E402
from recording import pyplot  # noqa: E402
from walls import Body  # noqa: E402

RESULTS = HERE/'results'
SCHEMES = ('EulerMaruyama', 'FixmanMidpoint', 'RandomFiniteDifference', 'TractionEulerMaruyama',
           'TrapezoidalSlip', 'DriftCorrectorFD', 'DriftCorrectorRFD', 'DriftCorrectorFD+SlipOnly',
           'DriftCorrectorRFD+SlipOnly')
#: Large steps are first, so that results of all schemes come soon.
STEPS = (0.3, 0.2, 0.1)
#: The paper's spacing is 0.3, which steps of 0.2 do not divide.
SPACING = 0.6
HEIGHTS, ANGLES = np.linspace(1, 41, 81), np.linspace(0, np.pi, 31)
#: Heights relax in 4 D/v^2 = 400 with the body's diffusion D = 0.3 and sedimentation v = 0.18 D.
SETTLE = 1000
PAPER_TIME = 36*30000.0


def body():
    return Body('boomerang',
                app.boomerang(1.0)._value, np.ones(15), np.full(15, 0.18/15), np.arange(15), 23.0,
                1.0, 0.5, 1/(6*np.pi))


def plans(quick, seed):
    b = body()
    e = Equilibrium(b, HEIGHTS, ANGLES)
    observables = {
        'h': (lambda h, A: h, e.average(lambda h, u: h + 0*u[:, 2])),
        'cos²θ': (lambda h, A: A[..., 2, 2]**2, e.average(lambda h, u: u[:, 2]**2 + 0*h))
    }
    return e, [
        runs.Plan(f'steps_{scheme}_{step:g}', b, e, scheme, step, round(SPACING/step),
                  20 if quick else 250, 10 if quick else SETTLE, observables,
                  replicas=32 if quick else 36, platform='CPU', seed=seed + 7*k + round(1000*step))
        for step in STEPS[:1 if quick else None] for k, scheme in enumerate(SCHEMES)
    ]


def draw(data, folder):
    plt = pyplot()
    figure, axes = plt.subplots(2, 2, figsize=(14, 10), constrained_layout=True)
    largest = max(r['step'] for r in data['runs'])
    names = [s for s in SCHEMES if any(r['scheme'] == s for r in data['runs'])]
    for row, key, label in ((axes[0], 'h', 'h / a'), (axes[1], 'theta', 'θ')):
        atLargest = [r for r in data['runs'] if r['step'] == largest]
        pictures.densities(row[0], atLargest, key, [r['scheme'] for r in atLargest])
        for k, name in enumerate(names):
            mine = sorted((r for r in data['runs'] if r['scheme'] == name), key=lambda r: r['step'])
            steps, errors = [r['step'] for r in mine], [r['histograms'][key] for r in mine]
            row[1].plot(steps, [h['L2'] for h in errors], 'o-', color=f'C{k}', label=name)
            row[1].plot(steps, [h['L2_of_noise'] for h in errors], ':', color=f'C{k}', lw=1)
        pictures.finish(row[0], f'step {largest:g} τ', label, 'density')
        pictures.finish(row[1], 'points: L2 distance; dotted: what noise makes of it', 'step / τ',
                        'L2 distance', 'y')
    axes[0, 0].set_xlim(1, 30)
    figure.savefig(folder/'boomerang_steps.png', dpi=75)
    plt.close(figure)


def main():
    args = runs.arguments(
        __doc__, RESULTS,
        lambda parser: parser.add_argument('--steps', nargs='+', type=float, default=STEPS))
    data = {'paper': {'time_of_all_replicas': PAPER_TIME}}
    draw(
        runs.drive(plans, data, args, 'boomerang_steps.json', lambda plan: plan.step in args.steps),
        args.output)


if __name__ == '__main__':
    main()
