#!/usr/bin/env python3
"""Delong 2015, Figures 3 to 5: a tetramer of four blobs above a wall, each blob of another weight.

The height of the centre is compared with quadrature, for schemes with the stochastic drift and for
Euler-Maruyama, which lacks it. Mean square displacements are those of the centre and of vertex
four, whose slopes at zero time are averages of the mobility, and rotational ones.

    python3 tetramer.py                      # until the errors are small, or an hour a scheme
    python3 tetramer.py --minutes 5 --jobs 2   # up to five minutes a scheme, two at a time; the
                                               # same command again goes on
    python3 tetramer.py --quick              # seconds

Units: blob radius a = 1, kT = 1, time 6 pi eta a^3/kT = 1.
"""
import pathlib
import sys

import numpy as np
from openmmrigidhi import analysis, app

HERE = pathlib.Path(__file__).resolve().parent
sys.path.append(str(HERE.parent/'common'))
import runs  # noqa: E402
import wallpictures as pictures  # noqa: E402
from equilibrium import Equilibrium, averageMobility, rotationalPlateau, withoutDrift  # noqa: E402
from recording import pyplot  # noqa: E402
from walls import Body  # noqa: E402

RESULTS = HERE/'results'
#: The step of Figure 3; Figure 4 has 0.136.
STEP = 0.0653
#: Runs at a fourth of the step show that the error of RandomFiniteDifference is one of the step.
CASES = (('EulerMaruyama', STEP), ('FixmanMidpoint', STEP), ('RandomFiniteDifference', STEP),
         ('DriftCorrectorRFD', STEP), ('RandomFiniteDifference', STEP/4))
HEIGHTS, ANGLES = np.linspace(1.5, 16.5, 61), np.linspace(0, np.pi, 31)
#: Delong's numbers (captions of Figures 4 and 3): slopes at zero time of the parallel MSD,
#: gravitational height.
PAPER = {'slope centre': 1.34, 'slope vertex': 2.21, 'gravitational height': 1.75}


def body():
    sites = app.tetramer(4.0)._value
    return Body('tetramer', sites, np.ones(4), np.array([0.15, 0.1, 0.3, 0.05]), np.arange(4), 20.0,
                1.0, 0.5, 1/(6*np.pi))


def exact(equilibrium, poses, random):
    """Results from the distribution: means, plateaus, slopes.

    They include the distribution that a scheme without drift would have for a sphere.
    """
    b = equilibrium.body
    height = equilibrium.average(lambda h, u: h + 0*u[:, 2])
    variance = equilibrium.average(lambda h, u: (h - height)**2 + 0*u[:, 2])
    mobility = averageMobility(
        equilibrium, {
            'slope centre': lambda N, A, h: 2*(N[:, 0, 0] + N[:, 1, 1]),
            'slope vertex': lambda N, A, h: 2*analysis.mobilityAboutPoint(N, A @ b.sites[3])
            [:, [0, 1], [0, 1]].sum(1),
            'rotation xx': lambda N, A, h: N[:, 3, 3] + N[:, 4, 4]
        }, random, poses)
    return {
        'mean h': height,
        'gravitational height': variance**0.5,
        'mean cos theta': equilibrium.average(lambda h, u: u[:, 2] + 0*h),
        'without drift': withoutDrift(equilibrium, random),
        'mobility averages (mean, error)': mobility,
        'rotational plateau (mean, error)': rotationalPlateau(equilibrium, random)
    }


def plans(quick, seed):
    b = body()
    equilibrium = Equilibrium(b, HEIGHTS, ANGLES)
    observables = {
        'h': (lambda h, A: h, equilibrium.average(lambda h, u: h + 0*u[:, 2])),
        'h²': (lambda h, A: h*h, equilibrium.average(lambda h, u: h*h + 0*u[:, 2])),
        'cos²θ': (lambda h, A: A[..., 2, 2]**2, equilibrium.average(lambda h, u: u[:, 2]**2 + 0*h))
    }
    msd = {
        'centre parallel': runs.parallel((0, 0, 0)),
        'vertex parallel': runs.parallel(b.sites[3]),
        'centre perpendicular': runs.perpendicular((0, 0, 0)),
        'rotation xx': runs.rotational((0.5, 0.5, 0)),
        'rotation zz': runs.rotational((0, 0, 1))
    }
    return equilibrium, runs.plansOfCases(quick, seed, 'tetramer', CASES, STEP, b, equilibrium,
                                          5*STEP, 10 if quick else 300, observables, msd)


def draw(data, folder):
    plt = pyplot()
    figure, axes = plt.subplots(2, 2, figsize=(13, 9), constrained_layout=True)
    entries, e = data['runs'], data['exact']
    pictures.densities(
        axes[0, 0], entries, 'h',
        [r['scheme'] + ('' if r['step'] == STEP else f', step {r["step"]:.3g}') for r in entries])
    pictures.withoutDrift(axes[0, 0], entries[0], e, 'exp(-U/kT)/⟨μ⊥⟩(h)')
    right = [r for r in entries if r['scheme'] != 'EulerMaruyama' and r['step'] == STEP]
    pictures.displacements(axes[0, 1], right, ('centre parallel', 'vertex parallel'))
    pictures.displacements(axes[1, 0], right, ('centre perpendicular',))
    pictures.displacements(axes[1, 1], right, ('rotation xx', 'rotation zz'))
    lag = np.array(entries[0]['msd']['centre parallel']['lag'])
    for name, style in (('centre', '--'), ('vertex', '-')):
        axes[0, 1].plot(lag, e['mobility averages (mean, error)'][f'slope {name}'][0]*lag,
                        'k' + style, lw=1, label=f'2 kT⟨Nxx+Nyy⟩ t, {name}')
    axes[1, 0].axhline(2*e['gravitational height']**2, color='k', ls='--', lw=1,
                       label='2 var h (eq. 69)')
    for name in ('xx', 'zz'):
        axes[1, 1].axhline(e['rotational plateau (mean, error)'][name][0], color='k', ls='--', lw=1,
                           label=f'eq. 71, {name}')
    pictures.finish(axes[0, 0], 'Figure 3', 'height of the centre / a', 'P(h) a')
    pictures.finish(axes[0, 1], 'Figure 4, left', 't', 'parallel MSD / a²', 'xy')
    pictures.finish(axes[1, 0], 'Figure 5: perpendicular', 't', 'MSD / a²', 'x')
    pictures.finish(axes[1, 1], 'Figures 4, 5, right: rotational', 't', 'MSD', 'x')
    figure.savefig(folder/'tetramer.png', dpi=80)
    plt.close(figure)


def main():
    args = runs.arguments(__doc__, RESULTS)
    equilibrium = runs.planned(plans, args.quick, args.seed)[0]
    data = {
        'paper': PAPER,
        'exact': exact(equilibrium, 2560 if args.quick else 128000,
                       np.random.default_rng(args.seed))
    }
    draw(runs.drive(plans, data, args, 'tetramer.json'), args.output)


if __name__ == '__main__':
    main()
