#!/usr/bin/python3
"""Delong's sphere and tetramer above a wall with periods, beside the same wall without periods.

    /usr/bin/python3 periods.py --output results --minutes 4
    /usr/bin/python3 periods.py --output somewhere --quick     # seconds

A force on a body disturbs the distant fluid above a wall as the moment of the forces along the wall
about it. So images make a shear flow at the body, 1/L^3, and what they add to the mobility follows
from the velocities of the free body in a shear flow. README.md in this folder says what was
measured.
"""
import pathlib
import sys

import numpy as np
from scipy.spatial.transform import Rotation

HERE = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent/'common'), str(HERE.parent/'delong2015')]
import icosahedron  # noqa: E402
import runs  # noqa: E402
import tetramer  # noqa: E402
from equilibrium import Equilibrium  # noqa: E402
from recording import brackets, plain, pyplot  # noqa: E402
from walls import Body, Replicas  # noqa: E402

RESULTS = HERE/'results'
#: Sum of x^2/r^5 over a square lattice of side 1 without its origin.
LATTICE = 4.51681
#: Periods, in radii.
PERIODS = (10, 20, 40, 80, 160)
#: Periods whose mobilities the tables have.
TABLED = (10, 40, 160)
#: Heights of the centre, in radii, of the bodies of table and picture.
HEIGHTS = {'one blob': (1.2, 2, 4), 'icosahedron': (1.5, 2, 4), 'tetramer': (4, 6, 10)}
#: Periods of the runs; None is the wall without periods.
SAMPLED = (10, None)
SCHEME = 'FixmanMidpoint'
#: Displacements: which entries of the mobility, and twice how much of each.
KINDS = {'parallel': (0, 1), 'perpendicular': (2,)}


def blob():
    """The sphere as one blob, of the radius and the viscosity of the icosahedron's sphere."""
    return Body('one blob', np.zeros((1, 3)), np.array([icosahedron.RADIUS]), np.zeros(1),
                np.array([], int), 0.0, icosahedron.RADIUS, 1.0, icosahedron.VISCOSITY)


def bodies():
    """The bodies, and the radius in which their lengths are given."""
    return ((blob(), icosahedron.RADIUS), (icosahedron.body(), icosahedron.RADIUS),
            (tetramer.body(), 1.0))


def sheared(replicas, R, A):
    """Velocities (6, 2) of one free body in the flows (z, 0, 0) and (0, z, 0) above a wall."""
    body = replicas.body
    seen = body.radii > 0
    offsets = (body.sites @ A.T)[seen]
    flow = np.zeros((seen.sum(), 3, 2))
    flow[:, 0, 0] = flow[:, 1, 1] = R[2] + offsets[:, 2]
    if seen.sum() == 1:
        # A sphere turns with half the vorticity.
        return np.concatenate([flow[0], ((0, -0.5), (0.5, 0), (0, 0))])
    columns, M = np.flatnonzero(np.repeat(seen, 3)), []
    for column in columns:
        force = np.zeros((len(seen), 3))
        force.flat[column] = 1
        M.append(
            replicas.fluid.applyBlobMobilityInContext(replicas.context,
                                                      force)._value.ravel()[columns])
    # Angular velocities move a blob by w x r.
    K = np.concatenate(
        [np.concatenate([np.eye(3), np.cross(np.eye(3), r).T], axis=1) for r in offsets])
    friction = np.linalg.solve(np.array(M), K).T
    return np.linalg.solve(friction @ K, friction @ flow.reshape(-1, 2))


def law(body, side, S):
    """What images add to the mobility times kT, in the limit of large periods."""
    return 12*LATTICE/(8*np.pi*body.viscosity*side**3)*(S @ np.swapaxes(S, -1, -2))


def mobilities(body, radius, R, q):
    """Mobilities times kT (poses, 6, 6) without and with periods, and what the law predicts."""
    A = Rotation.from_quat(q[:, [1, 2, 3, 0]]).as_matrix()

    def each(work, **settings):
        replicas = Replicas(body, 1, SCHEME, 1e-3, platform='CPU', **settings)
        values = []
        for k in range(len(R)):
            replicas.place(R[k:k + 1], q[k:k + 1])
            values.append(work(replicas, k))
        return np.array(values)

    infinite = each(lambda replicas, k: replicas.mobilities()[0])
    S = each(lambda replicas, k: sheared(replicas, R[k], A[k]))
    return infinite, {
        period: (each(lambda replicas, k: replicas.mobilities()[0], boundary='PeriodicWall',
                      side=period*radius), infinite + law(body, period*radius, S))
        for period in PERIODS
    }


def tableOfMobilities(seed):
    """One pose at each height: entries times 6 pi eta a, a^2 and a^3 from force and torque."""
    rows = []
    for body, radius in bodies():
        q = np.random.default_rng(seed).normal(size=4)
        q /= np.linalg.norm(q)
        units = np.repeat((radius**0.5, radius**1.5), 3)
        units = 6*np.pi*body.viscosity*np.outer(units, units)
        for height in HEIGHTS[body.name]:
            infinite, found = mobilities(body, radius, np.array([[0, 0, height*radius]]), q[None])
            infinite = infinite*units
            row = {
                'body': body.name,
                'height': height,
                'periods': PERIODS,
                'infinite': infinite[0],
                'orientation': q
            }
            for name, entry in (('xx', (0, 0)), ('zz', (2, 2))):
                row[name] = [(found[period][0]*units)[0][entry] for period in PERIODS]
            row['images'] = [abs(found[p][0]*units - infinite).max() for p in PERIODS]
            row['beyond_law'] = [abs((found[p][0] - found[p][1])*units).max() for p in PERIODS]
            rows.append(row)
    return rows


def averages(equilibrium, quick, seed):
    """Mean slopes of displacements at zero time of the icosahedron, from one set of poses."""
    poses = 16 if quick else 256
    R, q = equilibrium.draw(np.random.default_rng(seed), poses)
    infinite, found = mobilities(equilibrium.body, icosahedron.RADIUS, R, q)

    def slopes(N):
        values = {name: 2*N[:, entries, entries].sum(1) for name, entries in KINDS.items()}
        return {name: (v.mean(), v.std(ddof=1)/np.sqrt(len(v))) for name, v in values.items()}

    return {
        'poses': poses,
        'infinite': slopes(infinite),
        'periods': {
            period: dict(slopes(with_), law=slopes(predicted))
            for period, (with_, predicted) in found.items()
        }
    }


def plans(quick, seed):
    body = icosahedron.body()
    equilibrium = Equilibrium(body, icosahedron.HEIGHTS, icosahedron.ANGLES)
    observables = {
        'h': (lambda h, A: h, equilibrium.average(lambda h, u: h + 0*u[:, 2])),
        'h²': (lambda h, A: h*h, equilibrium.average(lambda h, u: h*h + 0*u[:, 2])),
        'cosθ': (lambda h, A: A[..., 2, 2], equilibrium.average(lambda h, u: u[:, 2] + 0*h))
    }
    msd = {'parallel': runs.parallel((0, 0, 0)), 'perpendicular': runs.perpendicular((0, 0, 0))}
    made = []
    for k, period in enumerate(SAMPLED):
        fluid = {'boundary': 'PeriodicWall', 'side': period*icosahedron.RADIUS} if period else {}
        made.append(
            runs.Plan(f'icosahedron_{period}', body, equilibrium, SCHEME, icosahedron.STEP,
                      round(icosahedron.SPACING/icosahedron.STEP), 8 if quick else 40,
                      0.1 if quick else 1, observables, msd, (1, 2, 4) if quick else
                      (1, 2, 4, 8, 16), replicas=16 if quick else 64, platform='CPU', seed=seed + k,
                      fluid=fluid, labels={
                          'body': 'icosahedron',
                          'period': period
                      }))
    return equilibrium, made


def power(values):
    """The power of 1/L with which values fall from the last period but one to the last, as text."""
    return f'{np.log2(values[-2]/values[-1]):.2f}'


def tables(data):
    periods = ' | '.join(f'L = {p} a' for p in TABLED)
    shown = [PERIODS.index(p) for p in TABLED]
    yield f'| body | height/a | all: {periods} | power | less the law: {periods} | power |'
    yield '|' + '---|'*(4 + 2*len(TABLED))
    for row in data['mobilities']:
        cells = []
        for key in ('images', 'beyond_law'):
            cells += [f'{row[key][k]:.1e}' for k in shown] + [power(row[key])]
        yield f'| {row["body"]} | {row["height"]:g} | ' + ' | '.join(cells) + ' |'
    yield ''
    yield f'| body | height/a | along: no periods | {periods} | across: no periods | {periods} |'
    yield '|' + '---|'*(4 + 2*len(TABLED))
    for row in data['mobilities']:
        cells = []
        for k, name in ((0, 'xx'), (2, 'zz')):
            own = row['infinite'][k][k]
            cells += [f'{own:.5f}'] + [f'{row[name][k] - own:+.1e}' for k in shown]
        yield f'| {row["body"]} | {row["height"]:g} | ' + ' | '.join(cells) + ' |'
    yield ''
    yield ('| period/a | slope along the wall, mean mobility | by the law | first lag of the run | '
           'across the wall, mean mobility | by the law | first lag |')
    yield '|---|---|---|---|---|---|---|'
    means, lag = data['averages'], icosahedron.SPACING
    for period in [str(p) for p in PERIODS] + [None]:
        row = means['periods'][period] if period else means['infinite']
        run = next((r for r in data['runs'] if str(r['period']) == str(period)), None)
        cells = []
        for name in KINDS:
            cells += [
                f'{row[name][0]:.4f}', f'{row["law"][name][0]:.4f}' if period else '',
                brackets(run['msd'][name]['mean'][0]/lag, run['msd'][name]['error'][0]/
                         lag) if run else ''
            ]
        yield f'| {period or "none"} | ' + ' | '.join(cells) + ' |'
    yield ''
    yield ('| period/a | time of all copies | steps redone | mean height | exact | mean cos θ | '
           'exact | all bins of heights: p | of θ: p |')
    yield '|---|---|---|---|---|---|---|---|---|'
    for run in data['runs']:
        h, c = run['means']['h'], run['means']['cosθ']
        p = [run['histograms'][key]['significance'] for key in ('h', 'theta')]
        yield (f'| {run["period"] or "none"} | {run["time_of_all_replicas"]:.0f} | '
               f'{100*run["redone_per_step_and_body"]:.2g} % | {brackets(h["mean"], h["error"])} | '
               f'{h["exact"]:.4f} | {brackets(c["mean"], c["error"])} | {c["exact"]:.4f} | ' +
               ' | '.join('–' if x is None else f'{x:.2g}' for x in p) + ' |')


def draw(data, folder):
    plt = pyplot()
    figure, axes = plt.subplots(1, 3, figsize=(14, 4.6), layout='constrained')
    for k, row in enumerate(data['mobilities']):
        label = f'{row["body"]}, {row["height"]:g} a'
        axes[0].plot(row['periods'], row['images'], 'os^Dvp<>h'[k] + '-', color=f'C{k}',
                     markersize=4, linewidth=0.8, label=label)
        axes[0].plot(row['periods'], row['beyond_law'], 'os^Dvp<>h'[k] + ':', color=f'C{k}',
                     markersize=4, linewidth=0.8, mfc='none')
    axes[0].set(xscale='log', yscale='log', xlabel='period/a',
                ylabel='largest entry of the difference',
                title='From the mobility without periods; dotted: less the law')
    axes[0].legend(fontsize=6)
    means = data['averages']
    for k, name in enumerate(KINDS):
        own = means['infinite'][name][0]
        axes[1].plot(PERIODS, [means['periods'][str(p)][name][0]/own for p in PERIODS], f'C{k}o',
                     label=f'{name}, mean mobility')
        axes[1].plot(PERIODS, [means['periods'][str(p)]['law'][name][0]/own for p in PERIODS],
                     f'C{k}-', linewidth=0.8, label=f'{name}, by the law')
        for run in data['runs']:
            if run['period']:
                lag = run['msd'][name]['lag'][0]
                axes[1].errorbar(run['period']*1.04, run['msd'][name]['mean'][0]/lag/own,
                                 run['msd'][name]['error'][0]/lag/own, fmt=f'C{k}s', mfc='none')
    axes[1].set(xscale='log', xlabel='period/a', ylabel='slope over that without periods',
                title='Icosahedron: displacements (squares: runs)')
    axes[1].legend(fontsize=7)
    for k, run in enumerate(data['runs']):
        found = run['histograms']['h']
        edges, P, error, exact = (np.array(found[key]) for key in ('edges', 'P', 'error', 'exact'))
        middle, width = (edges[1:] + edges[:-1])/2, np.diff(edges)
        if not k:
            axes[2].plot(middle, exact/width, 'k-', linewidth=0.8, label='quadrature')
        axes[2].errorbar(middle, P/width, error/width, fmt='os^'[k], markersize=3, linewidth=0.8,
                         label=f'period {run["period"]} a' if run['period'] else 'no periods')
    axes[2].set(xlabel='height', ylabel='density', title='Icosahedron')
    axes[2].legend(fontsize=7)
    figure.savefig(folder/'periods.png', dpi=85)
    plt.close(figure)


def main():
    args = runs.arguments(__doc__, RESULTS)
    equilibrium = runs.planned(plans, args.quick, args.seed)[0]
    data = {
        'mobilities': tableOfMobilities(args.seed),
        'averages': averages(equilibrium, args.quick, args.seed)
    }
    data = plain(runs.drive(plans, data, args, 'periods.json'))
    draw(data, args.output)
    print('\n'.join(tables(data)))


if __name__ == '__main__':
    main()
