#!/usr/bin/python3
"""Spheres and Delong's tetramer above a periodic wall: heights beside Boltzmann's law.

    /usr/bin/python3 sedimentation.py --output results
    /usr/bin/python3 sedimentation.py --output somewhere --quick     # seconds

Bodies are alone in the box, with their own images along the wall. The images change the mobility,
and with it the stochastic drift, but not the equilibrium. README.md in this folder says what was
measured.
"""
import pathlib
import sys

import numpy as np

HERE = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent/'common'), str(HERE.parent/'delong2015')]
import runs  # noqa: E402
import tetramer  # noqa: E402
from equilibrium import Equilibrium, averageMobility  # noqa: E402
from openmmrigidhi import analysis  # noqa: E402
from recording import brackets, pyplot  # noqa: E402
from walls import Body  # noqa: E402

RESULTS = HERE/'results'
#: Gravitational length, whether the wall is soft, mobility at the wall, step, period.
SPHERES = ((0.5, True, False, 0.01, 8), (1, True, False, 0.02, 8), (2, True, False, 0.04, 8),
           (4, True, False, 0.04, 8), (1, True, True, 0.02, 8), (1, False, True, 0.01, 8))
#: Period and step of the tetramer's run, and periods in which its mean mobility is computed.
TETRAMER_SIDE, TETRAMER_STEP, SIDES = 16, 0.0653, (16, 32, 64)
SCHEME = 'FixmanMidpoint'


def ball(length, isSoft):
    """A sphere of radius 1 and weight 1/length, which a soft wall repels."""
    return Body(f'sphere {length:g} {"soft" if isSoft else "hard"}', np.zeros((1, 3)), np.ones(1),
                np.array([1/length]), np.arange(1), 2.0 if isSoft else 0.0, 1.0, 0.5, 1/(6*np.pi))


def plans(quick, seed):
    made, frames = [], 20 if quick else 100
    for k, (length, isSoft, isBestKnown, step, side) in enumerate(SPHERES):
        if quick and length > 1:
            continue
        body = ball(length, isSoft)
        # Bins are 0.25 lengths wide.
        equilibrium = Equilibrium(body, 1 + length*np.linspace(0, 6, 25), np.linspace(0, np.pi, 5),
                                  azimuths=8)
        observables = {
            'h': (lambda h, A: h, equilibrium.average(lambda h, u: h + 0*u[:, 2])),
            'h²': (lambda h, A: h*h, equilibrium.average(lambda h, u: h*h + 0*u[:, 2]))
        }
        name = f'sphere_{length:g}_{"soft" if isSoft else "hard"}_{isBestKnown}'
        made.append(
            runs.Plan(
                name, body, equilibrium, SCHEME, step, max(1, round(0.1*length/step)), frames,
                0.2 if quick else length, observables, replicas=32 if quick else 64, platform='CPU',
                seed=seed + k, fluid={
                    'boundary': 'PeriodicWall',
                    'side': side,
                    'bestKnown': isBestKnown
                }, labels={
                    'body': 'sphere',
                    'length': length,
                    'isSoft': isSoft,
                    'isBestKnown': isBestKnown,
                    'side': side
                }))
    body = tetramer.body()
    equilibrium = Equilibrium(body, tetramer.HEIGHTS, tetramer.ANGLES)
    observables = {
        'h': (lambda h, A: h, equilibrium.average(lambda h, u: h + 0*u[:, 2])),
        'cos²θ': (lambda h, A: A[..., 2, 2]**2, equilibrium.average(lambda h, u: u[:, 2]**2 + 0*h))
    }
    made.append(
        runs.Plan('tetramer', body, equilibrium, SCHEME, TETRAMER_STEP, 10, 10 if quick else 50,
                  10*TETRAMER_STEP, observables, replicas=32, platform='CPU',
                  seed=seed + len(SPHERES), fluid={
                      'boundary': 'PeriodicWall',
                      'side': TETRAMER_SIDE
                  }, labels={
                      'body': 'tetramer',
                      'side': TETRAMER_SIDE
                  }))
    return equilibrium, made


def slopes(equilibrium, poses, seed, **settings):
    """Mean mobility: Delong's slopes at zero time, of the centre and of vertex four."""
    vertex = equilibrium.body.sites[3]
    return averageMobility(
        equilibrium, {
            'slope centre': lambda N, A, h: 2*(N[:, 0, 0] + N[:, 1, 1]),
            'slope vertex': lambda N, A, h: 2*analysis.mobilityAboutPoint(N, A @ vertex)
            [:, [0, 1], [0, 1]].sum(1),
            'across': lambda N, A, h: N[:, 2, 2]
        }, np.random.default_rng(seed), poses, **settings)


def boxes(equilibrium, quick, seed):
    """The same poses in boxes of several periods, and without periods."""
    poses = 32 if quick else 256
    found = {'poses': poses, 'infinite': slopes(equilibrium, poses, seed)}
    for side in SIDES[:1] if quick else SIDES:
        found[str(side)] = slopes(equilibrium, poses, seed, boundary='PeriodicWall', side=side,
                                  platform='CPU')
    return found


def nameOf(run):
    if run['body'] == 'tetramer':
        return f'tetramer, period {run["side"]}'
    return (f'sphere, l = {run["length"]:g}, {"soft" if run["isSoft"] else "hard"} wall' +
            (', BestKnown' if run['isBestKnown'] else ''))


def fittedLength(run):
    """l of the density, by the slope of the logarithm of its ratio to the exact one."""
    found = run['histograms']['h']
    edges, P, error, exact = (np.array(found[key]) for key in ('edges', 'P', 'error', 'exact'))
    seen = P > 3*error
    if seen.sum() < 3:
        return np.nan
    middle = ((edges[1:] + edges[:-1])/2)[seen]
    slope = np.polyfit(middle, np.log(P[seen]/exact[seen]), 1, w=P[seen]/error[seen])[0]
    return 1/(1/run['length'] - slope)


def tables(data):
    yield ('| body | step | time of all copies | steps redone | mean height | exact | difference, '
           'standard errors | all bins: p | l, fitted |')
    yield '|---|---|---|---|---|---|---|---|---|'
    for run in data['runs']:
        mean = run['means']['h']
        p = run['histograms']['h']['significance']
        tail = f'{fittedLength(run):.2f}' if run['body'] == 'sphere' else ''
        yield (f'| {nameOf(run)} | {run["step"]:g} | {run["time_of_all_replicas"]:.0f} | '
               f'{100*run["redone_per_step_and_body"]:.2g} % | '
               f'{brackets(mean["mean"], mean["error"])} | {mean["exact"]:.4f} | '
               f'{(mean["mean"] - mean["exact"])/mean["error"]:+.1f} | '
               f'{"–" if p is None else format(p, ".2g")} | {tail} |')
    yield ''
    yield '| tetramer, period | slope of the centre | slope of vertex four | mobility across |'
    yield '|---|---|---|---|'
    for name, row in data['boxes'].items():
        if name != 'poses':
            yield f'| {name} | ' + ' | '.join(
                f'{row[key][0]:.4f}' for key in ('slope centre', 'slope vertex', 'across')) + ' |'


def draw(data, folder):
    plt = pyplot()
    figure, axes = plt.subplots(1, 3, figsize=(14, 4.6), layout='constrained')
    for k, run in enumerate(run for run in data['runs'] if run['body'] == 'sphere'):
        found = run['histograms']['h']
        edges, P, error, exact = (np.array(found[key]) for key in ('edges', 'P', 'error', 'exact'))
        scaled, width = ((edges[1:] + edges[:-1])/2 - 1)/run['length'], np.diff(edges)/run['length']
        seen = P > 0
        axes[0].errorbar(scaled[seen], (P/width)[seen]*10.0**-k, (error/width)[seen]*10.0**-k,
                         fmt='os^Dvp'[k], markersize=3.5, color=f'C{k}', label=nameOf(run))
        axes[0].plot(scaled, exact/width*10.0**-k, 'k-', linewidth=0.7)
        seen &= error < 0.15*exact
        axes[1].errorbar(scaled[seen] + 0.02*k, (P/exact)[seen], (error/exact)[seen],
                         fmt='os^Dvp'[k], markersize=3.5, color=f'C{k}', linewidth=0.8)
    x = np.linspace(0, 6, 50)
    axes[0].plot(x, np.exp(-x), 'k--', linewidth=0.7, label='exp(−(z − a)/l)')
    axes[0].set(yscale='log', ylim=(1e-8, 3), xlabel='(z − a)/l',
                title='Spheres; each curve a tenth of the one before')
    axes[1].axhline(1, color='k', linewidth=0.7)
    axes[1].set(xlabel='(z − a)/l', ylabel='density over the exact one', ylim=(0.7, 1.3))
    for run in data['runs']:
        if run['body'] == 'tetramer':
            found = run['histograms']['h']
            edges, P, error, exact = (np.array(found[key])
                                      for key in ('edges', 'P', 'error', 'exact'))
            middle, width = (edges[1:] + edges[:-1])/2, np.diff(edges)
            axes[2].errorbar(middle, P/width, error/width, fmt='o', markersize=3.5,
                             label=nameOf(run))
            axes[2].plot(middle, exact/width, 'k-', linewidth=0.8, label='quadrature')
            axes[2].set(xlabel='height of the centre', ylabel='density')
            axes[2].legend(fontsize=7)
    axes[0].legend(fontsize=6)
    figure.savefig(folder/'sedimentation.png', dpi=85)
    plt.close(figure)


def main():
    args = runs.arguments(__doc__, RESULTS)
    equilibrium = runs.planned(plans, args.quick, args.seed)[0]
    data = {'boxes': boxes(equilibrium, args.quick, args.seed)}
    data = runs.drive(plans, data, args, 'sedimentation.json')
    draw(data, args.output)
    print('\n'.join(tables(data)))


if __name__ == '__main__':
    main()
