#!/usr/bin/env python3
"""Delong 2015, Figures 3 to 5: a tetramer of four blobs above a wall, each blob of another weight.

Height of the centre against quadrature, for schemes with the stochastic drift and for Euler-Maruyama, which lacks it; mean square displacements of
the centre and of vertex four, whose slopes at zero time are averages of the mobility; rotational ones.

    python3 tetramer.py                      # until the errors are small, or an hour a scheme
    python3 tetramer.py --keep --minutes 5   # go on with what is there, up to five minutes a scheme
    python3 tetramer.py --quick              # seconds

Units: blob radius a = 1, kT = 1, time 6 pi eta a^3/kT = 1.
"""
import argparse
import pathlib

import numpy as np
import runs
from equilibrium import Equilibrium, aboutPoint, averageMobility, rotationalPlateau, withoutDrift
from openmmrigidhi import app
from walls import RESULTS, Body, Replicas, pyplot

SCHEMES = ('EulerMaruyama', 'FixmanMidpoint', 'RandomFiniteDifference', 'DriftCorrectorRFD')
#: Figure 3's step; Figure 4 has 0.136.
STEP = 0.0653
HEIGHTS, ANGLES = np.linspace(1.5, 16.5, 61), np.linspace(0, np.pi, 31)
#: Delong's numbers (captions of Figures 4 and 3): slopes at zero time of the parallel MSD, gravitational height.
PAPER = {'slope centre': 1.34, 'slope vertex': 2.21, 'gravitational height': 1.75}


def body():
    sites = app.tetramer(4.0)._value
    return Body('tetramer', sites, np.ones(4), np.array([0.15, 0.1, 0.3, 0.05]), np.arange(4), 20.0, 1.0, 0.5, 1/(6*np.pi))


def exact(equilibrium, rounds, random):
    """What the distribution says: means, plateaus, slopes, and the distribution that a scheme without drift would have for a sphere."""
    b = equilibrium.body
    height = equilibrium.average(lambda h, u: h + 0*u[:, 2])
    variance = equilibrium.average(lambda h, u: (h - height)**2 + 0*u[:, 2])
    replicas = Replicas(b, 128, 'EulerMaruyama', STEP)
    mobility = averageMobility(equilibrium, replicas, {
        'slope centre': lambda N, A, h: 2*(N[:, 0, 0] + N[:, 1, 1]),
        'slope vertex': lambda N, A, h: 2*aboutPoint(N, A, b.sites[3])[:, [0, 1], [0, 1]].sum(1),
        'rotation xx': lambda N, A, h: N[:, 3, 3] + N[:, 4, 4]}, random, rounds)
    return {'mean h': height, 'gravitational height': variance**0.5, 'mean cos theta': equilibrium.average(lambda h, u: u[:, 2] + 0*h),
            'without drift': withoutDrift(equilibrium, replicas, random), 'mobility averages (mean, error)': mobility, 'rotational plateau (mean, error)': rotationalPlateau(equilibrium, random)}


def plans(args):
    b = body()
    equilibrium = Equilibrium(b, HEIGHTS, ANGLES)
    observables = {'h': (lambda h, A: h, equilibrium.average(lambda h, u: h + 0*u[:, 2])),
                   'h²': (lambda h, A: h*h, equilibrium.average(lambda h, u: h*h + 0*u[:, 2])),
                   'cos²θ': (lambda h, A: A[..., 2, 2]**2, equilibrium.average(lambda h, u: u[:, 2]**2 + 0*h))}
    msd = {'centre parallel': runs.parallel((0, 0, 0)), 'vertex parallel': runs.parallel(b.sites[3]),
           'centre perpendicular': runs.perpendicular((0, 0, 0)), 'rotation xx': runs.rotational((0.5, 0.5, 0)),
           'rotation zz': runs.rotational((0, 0, 1))}
    every = 5
    frames = 40 if args.quick else 600
    lags = np.geomspace(1, frames//2, 22)
    return equilibrium, [runs.Plan(f'tetramer_{scheme}', b, equilibrium, scheme, STEP, every, frames, 10 if args.quick else 300, observables, msd,
                                   lags, 16 if args.quick else 64, seed=args.seed + 7*k)
                         for k, scheme in enumerate(SCHEMES) if not args.schemes or scheme in args.schemes]


def draw(data, folder):
    plt = pyplot()
    figure, axes = plt.subplots(2, 2, figsize=(13, 9), constrained_layout=True)
    entries = data['runs']
    for k, r in enumerate(entries):
        h = r['histograms']['h']
        edges = np.array(h['edges'])
        width, middle = np.diff(edges), (edges[1:] + edges[:-1])/2
        if not k:
            axes[0, 0].plot(middle, np.array(h['exact'])/width, 'k-', lw=1, label='quadrature')
            axes[0, 0].plot(middle, np.array(data['exact']['without drift']['P'])/width, 'k:', lw=1, label='exp(-U/kT)/⟨μ⊥⟩(h)')
        axes[0, 0].errorbar(middle, np.array(h['P'])/width, np.array(h['error'])/width, fmt='.', ms=5, color=f'C{k}', label=r['scheme'])
        if r['scheme'] == 'EulerMaruyama':
            continue
        for axis, names in ((axes[0, 1], ('centre parallel', 'vertex parallel')), (axes[1, 0], ('centre perpendicular',)),
                            (axes[1, 1], ('rotation xx', 'rotation zz'))):
            for name, marker in zip(names, 'os'):
                m = r['msd'][name]
                axis.errorbar(m['lag'], m['mean'], m['error'], fmt=marker, ms=4, mfc='none', color=f'C{k}', label=f'{name}, {r["scheme"]}')
    e = data['exact']
    lag = np.array(entries[-1]['msd']['centre parallel']['lag'])
    for name, style in (('centre', '--'), ('vertex', '-')):
        slope = e['mobility averages (mean, error)'][f'slope {name}'][0]
        axes[0, 1].plot(lag, slope*lag, 'k' + style, lw=1, label=f'2 kT⟨Nxx+Nyy⟩ t, {name}')
    axes[1, 0].axhline(2*e['gravitational height']**2, color='k', ls='--', lw=1, label='2 var h (eq. 69)')
    for name in ('xx', 'zz'):
        axes[1, 1].axhline(e['rotational plateau (mean, error)'][name][0], color='k', ls='--', lw=1, label=f'eq. 71, {name}')
    for axis, title, x, y in ((axes[0, 0], 'Figure 3', 'height of the centre / a', 'P(h) a'), (axes[0, 1], 'Figure 4, left', 't', 'parallel MSD / a²'),
                              (axes[1, 0], 'Figure 5: perpendicular', 't', 'MSD / a²'), (axes[1, 1], 'Figures 4, 5, right: rotational', 't', 'MSD')):
        axis.set(title=title, xlabel=x, ylabel=y)
        axis.legend(fontsize=7)
    for axis in (axes[0, 1], axes[1, 0], axes[1, 1]):
        axis.set_xscale('log')
    axes[0, 1].set_yscale('log')
    figure.savefig(folder/'tetramer.png', dpi=80)
    plt.close(figure)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    runs.addOptions(parser)
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    args = parser.parse_args()
    equilibrium, todo = plans(args)
    data = {'paper': PAPER, 'exact': exact(equilibrium, 20 if args.quick else 1000, np.random.default_rng(args.seed)), 'runs': []}
    runs.drive(todo, data, args, 'tetramer.json')
    draw(data, args.output)


if __name__ == '__main__':
    main()
