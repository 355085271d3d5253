#!/usr/bin/env python3
"""Delong 2015, Figures 6 and 7: a sphere made of twelve blobs, one of them heavy, above a wall.

Distributions of height and tilt are compared with the exact ones, P(h) ~ exp(-2.5 h - 10/(h-0.5)
exp(-(h-0.5)/0.5)) and P(theta) ~ sin theta exp(1.09375 cos theta). Mean square displacements,
translational and rotational, are compared with two predictions: from the mobility of the blobs'
icosahedron, and from the best-known mobility of a sphere.

    python3 icosahedron.py                      # until the errors are small, or an hour a scheme
    python3 icosahedron.py --minutes 5 --jobs 2   # up to five minutes a scheme, two at a time; the
                                                  # same command again goes on
    python3 icosahedron.py --quick              # seconds

Units: the paper's length (sphere radius a_I = 0.5), kT = 1, time 6 pi eta a_I^3/kT = 1.
"""
import pathlib
import sys

import numpy as np
from openmmrigidhi import app

HERE = pathlib.Path(__file__).resolve().parent
sys.path.append(str(HERE.parent/'common'))
import runs  # noqa: E402
import wallpictures as pictures  # noqa: E402
from equilibrium import (  # noqa: E402
    Equilibrium, averageMobility, rotationalPlateau, sphereMobilities, withoutDrift)
from recording import pyplot  # noqa: E402
from walls import Body  # noqa: E402

RESULTS = HERE/'results'
RADIUS, BLOB = 0.5, 0.175
#: The step of Figure 6 is 0.04, that of Figure 7 0.004. At 0.04 a step turns the sphere by 0.25
#: rad. The mean of cos theta is then 2.5 % low for any scheme that moves by F at the old pose, also
#: for a sphere that only turns.
STEP, PAPER_STEP, SPACING = 0.01, 0.04, 0.08
CASES = (('EulerMaruyama', STEP), ('FixmanMidpoint', STEP), ('RandomFiniteDifference', STEP),
         ('DriftCorrectorRFD', STEP), ('RandomFiniteDifference', PAPER_STEP))
HEIGHTS, ANGLES = np.linspace(0.5, 3.5, 61), np.linspace(0, np.pi, 31)
VISCOSITY = 1/(6*np.pi*RADIUS**3)
#: From caption and text: gravitational height 0.96 a_I.
PAPER = {'gravitational height': 0.96*RADIUS}


def body():
    """Twelve blobs, and at the centre a site that the wall repels; the blob on -z is heavy."""
    sites = np.concatenate([app.icosahedron(2.5*BLOB)._value, np.zeros((1, 3))])
    radii, weights = np.r_[np.full(12, BLOB), 0], np.zeros(13)
    weights[11] = 1.25/RADIUS
    return Body('icosahedron', sites, radii, weights, np.array([12]), 20.0, RADIUS, RADIUS,
                VISCOSITY)


def exact(equilibrium, poses, random):
    height = equilibrium.average(lambda h, u: h + 0*u[:, 2])
    functions = {
        'parallel': lambda N, A, h: 2*(N[:, 0, 0] + N[:, 1, 1]),
        'perpendicular': lambda N, A, h: 2*N[:, 2, 2],
        'rotation xx': lambda N, A, h: N[:, 3, 3] + N[:, 4, 4],
        'rotation zz': lambda N, A, h: 2*N[:, 5, 5]
    }
    # The sphere's slopes depend on the height alone.
    marginal = equilibrium.probability.sum(1)
    seen = marginal > 1e-12
    N = sphereMobilities(equilibrium.h[seen], RADIUS, VISCOSITY)
    return {
        'mean h': height,
        'gravitational height': equilibrium.average(lambda h, u: (h - height)**2 + 0*u[:, 2])**0.5,
        'mean cos theta': equilibrium.average(lambda h, u: u[:, 2] + 0*h),
        'without drift': withoutDrift(equilibrium, random),
        'slopes (mean, error)': averageMobility(equilibrium, functions, random, poses),
        'slopes of the sphere': {
            name: float(marginal[seen] @ function(N, None, None))
            for name, function in functions.items()
        },
        'rotational plateau (mean, error)': rotationalPlateau(equilibrium, random)
    }


def plans(quick, seed):
    b = body()
    equilibrium = Equilibrium(b, HEIGHTS, ANGLES)
    observables = {
        'h': (lambda h, A: h, equilibrium.average(lambda h, u: h + 0*u[:, 2])),
        'h²': (lambda h, A: h*h, equilibrium.average(lambda h, u: h*h + 0*u[:, 2])),
        'cosθ': (lambda h, A: A[..., 2, 2], equilibrium.average(lambda h, u: u[:, 2] + 0*h))
    }
    msd = {
        'parallel': runs.parallel((0, 0, 0)),
        'perpendicular': runs.perpendicular((0, 0, 0)),
        'rotation xx': runs.rotational((0.5, 0.5, 0)),
        'rotation zz': runs.rotational((0, 0, 1))
    }
    return equilibrium, runs.plansOfCases(quick, seed, 'icosahedron', CASES, STEP, b, equilibrium,
                                          SPACING, 1 if quick else 30, observables, msd)


def draw(data, folder):
    plt = pyplot()
    figure, axes = plt.subplots(2, 2, figsize=(13, 9), constrained_layout=True)
    entries, e = data['runs'], data['exact']
    names = [r['scheme'] + ('' if r['step'] == STEP else f', step {r["step"]:g}') for r in entries]
    pictures.densities(axes[0, 0], entries, 'h', names)
    pictures.withoutDrift(axes[0, 0], entries[0], e, 'exp(-U/kT)/μ⊥(h)')
    pictures.densities(axes[0, 1], entries, 'theta', names)
    right = [r for r in entries if r['scheme'] != 'EulerMaruyama' and r['step'] == STEP]
    pictures.displacements(axes[1, 0], right, ('parallel', 'perpendicular'))
    pictures.displacements(axes[1, 1], right, ('rotation xx', 'rotation zz'))
    lag = np.array(entries[0]['msd']['parallel']['lag'])
    for slope, style, label in ((e['slopes (mean, error)']['parallel'][0], '-', 'icosahedron'),
                                (e['slopes of the sphere']['parallel'], '--', 'sphere')):
        axes[1, 0].plot(lag, slope*lag, 'k' + style, lw=1, label=f'4 kT⟨N∥⟩ t, {label}')
    axes[1, 0].axhline(2*e['gravitational height']**2, color='k', ls=':', lw=1,
                       label='2 var h (eq. 69)')
    for name, style in (('xx', '-'), ('zz', ':')):
        axes[1, 1].plot(lag[:2], e['slopes of the sphere'][f'rotation {name}']*lag[:2], 'k' + style,
                        lw=1, label=f'slope of the sphere, {name}')
    for name in ('xx', 'zz'):
        axes[1, 1].axhline(e['rotational plateau (mean, error)'][name][0], color='k', ls='--', lw=1,
                           label=f'eq. 71, {name}')
    pictures.finish(axes[0, 0], 'Figure 6, left', 'h', 'P(h)')
    pictures.finish(axes[0, 1], 'Figure 6, right', 'θ', 'P(θ)')
    pictures.finish(axes[1, 0], 'Figure 7, left', 't', 'MSD', 'xy')
    pictures.finish(axes[1, 1], 'Figure 7, right: rotational', 't', 'MSD', 'x')
    figure.savefig(folder/'icosahedron.png', dpi=80)
    plt.close(figure)


def main():
    args = runs.arguments(__doc__, RESULTS)
    equilibrium = runs.planned(plans, args.quick, args.seed)[0]
    data = {
        'paper': PAPER,
        'exact': exact(equilibrium, 2560 if args.quick else 128000,
                       np.random.default_rng(args.seed))
    }
    draw(runs.drive(plans, data, args, 'icosahedron.json'), args.output)


if __name__ == '__main__':
    main()
