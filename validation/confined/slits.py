#!/usr/bin/python3
"""A rod and a boomerang of blobs in slits: density across the slit, diffusion along it.

    /usr/bin/python3 slits.py --output results
    /usr/bin/python3 slits.py --output somewhere --quick     # seconds

Each copy is alone in a box with its own images along the walls. README.md in this folder says what
was measured.
"""
import argparse
import pathlib
import time

import numpy as np
from scipy.stats import f as fisher

from confinedscene import Scene, meanAndError, quietly, turns  # isort: skip
import campaign  # isort: skip
from openmmrigidhi._quaternions import rotate  # isort: skip
from recording import brackets, provenance, pyplot, save  # isort: skip

RADIUS = 0.5


def centred(sites):
    return np.array(sites, float) - np.mean(sites, axis=0)


#: Blobs that touch. Origins are the means of their centres.
BODIES = {
    'rod': centred([(-1, 0, 0), (0, 0, 0), (1, 0, 0)]),
    'boomerang': centred([(2, 0, 0), (1, 0, 0), (0, 0, 0), (0, 1, 0), (0, 2, 0)])
}
SIDE = 6.0
#: Strength, kT, and range of the force that keeps blobs off soft walls.
REPULSION = (6.0, 0.25)
BINS, LAGS = 10, (1, 2, 4, 8)
#: Body, width, whether a force keeps blobs off the walls, scheme, step, time between frames.
RUNS = (('rod', 2.5, True, 'FixmanMidpoint', 0.02,
         0.2), ('rod', 4, True, 'FixmanMidpoint', 0.02,
                0.2), ('boomerang', 3, True, 'FixmanMidpoint', 0.02,
                       0.2), ('boomerang', 5, True, 'FixmanMidpoint', 0.02, 0.2),
        ('rod', 4, False, 'FixmanMidpoint', 0.02, 0.2), ('rod', 4, True, 'TrapezoidalSlip', 0.02,
                                                         0.2))
WIDTHS = (1.5, 2, 2.5, 3, 4, 5, 6, 8)


def energies(heights, width, isSoft):
    """kT, of blobs at heights (..., blobs); infinite where one is in a wall."""
    gaps = np.stack([heights, width - heights]) - RADIUS
    energy = REPULSION[0]*np.exp(-gaps/REPULSION[1]).sum(
        (0, -1)) if isSoft else np.zeros(heights.shape[:-1])
    return np.where((gaps >= 0).all((0, -1)), energy, np.inf)


def draw_poses(body, width, isSoft, count, random):
    """Independent poses of Boltzmann's law: heights of the origin, quaternions, share accepted."""
    found, tried = [np.empty(0), np.empty((0, 4))], 0
    while len(found[0]) < count:
        z, q = random.uniform(0, width, 4*count), turns(random, 4*count)
        heights = z[:, None] + rotate(q[:, None], BODIES[body])[..., 2]
        take = random.uniform(size=4*count) < np.exp(-energies(heights, width, isSoft))
        found = [np.concatenate([found[0], z[take]]), np.concatenate([found[1], q[take]])]
        tried += 4*count
    return found[0][:count], found[1][:count], len(found[0])/tried


def observe(body, z, q):
    axis = np.array([1.0, 0, 0] if body == 'rod' else [0, 0, 1.0])
    return rotate(q, axis)[..., 2]**2


def exact(body, width, isSoft, seed, count):
    """Edges of bins of equal probability, and averages, by independent draws."""
    z, q, share = draw_poses(body, width, isSoft, count, np.random.default_rng(seed))
    edges = np.quantile(z, np.linspace(0, 1, BINS + 1))
    edges[[0, -1]] = 0, width
    middle = np.abs(z - width/2)
    fine = np.histogram(z, np.linspace(0, width, 61), density=True)[0]
    cosine = observe(body, z, q)
    return {
        'edges': edges,
        'fine': fine,
        'draws': count,
        'accepted': share,
        '|z - H/2|': middle.mean(),
        '|z - H/2|_error': middle.std()/np.sqrt(count),
        'cos2': cosine.mean(),
        'cos2_error': cosine.std()/np.sqrt(count)
    }


def simulate(argument, job):
    """A run of copies: bins of the height, averages, and displacement along the walls."""
    (body, width, isSoft, scheme, step, spacing), copies, frames, settle, draws, seed = argument
    began, law = time.process_time(), exact(body, width, isSoft, seed + 1000, draws)
    scene = quietly(Scene, 'NoSlipChannel', BODIES[body], RADIUS, copies, side=SIDE, height=width,
                    scheme=scheme, step=step, seed=seed, isAlone=True,
                    repulsion=REPULSION if isSoft else None)
    z, q, _ = draw_poses(body, width, isSoft, copies, np.random.default_rng(seed))
    scene.place(np.column_stack([np.zeros((copies, 2)), z]), q)
    every = round(spacing/step)
    scene.integrator.step(round(settle/spacing)*every)
    redone = scene.integrator.getNumRejectedSteps()
    R, Q = np.empty((frames, copies, 3)), np.empty((frames, copies, 4))
    for k in range(frames):
        scene.integrator.step(every)
        R[k], Q[k] = scene.poses()
        job.report((k + 1)*every*copies)
    bins = np.stack([np.histogram(R[:, c, 2], law['edges'])[0] for c in range(copies)])/frames
    difference = (bins.mean(0) - 1/BINS)[:-1]
    covariance, free = np.cov(bins[:, :-1].T)/copies, BINS - 1
    statistic = difference @ np.linalg.solve(covariance, difference)*(copies - free)/(free*
                                                                                      (copies - 1))
    found = {
        'body': body,
        'width': width,
        'isSoft': isSoft,
        'scheme': scheme,
        'step': step,
        'copies': copies,
        'frames': frames,
        'spacing': spacing,
        'settled': settle,
        'seed': seed,
        'side': SIDE,
        'time_of_all_copies': copies*frames*spacing,
        'redone_per_step_and_body': (scene.integrator.getNumRejectedSteps() - redone)/
        (frames*every*copies),
        'exact': law,
        'P': bins.mean(0),
        'P_error': bins.std(0, ddof=1)/np.sqrt(copies),
        'chi2_per_bin': statistic,
        'significance': float(fisher.sf(statistic, free, copies - free)),
        'means': {},
        'lags': [lag*spacing for lag in LAGS if lag < frames]
    }
    for name, values in (('|z - H/2|', np.abs(R[..., 2] - width/2)), ('cos2',
                                                                      observe(body, R[..., 2], Q))):
        mean, error = meanAndError(values.mean(0))
        found['means'][name] = {
            'mean': mean,
            'error': error,
            'exact': law[name],
            'z': (mean - law[name])/np.hypot(error, law[name + '_error'])
        }
    lags = [lag for lag in LAGS if lag < frames]
    D = np.array([((R[lag:, :, :2] - R[:-lag, :, :2])**2).sum(-1).mean(0)/(4*lag*spacing)
                  for lag in lags])
    found['D'], found['D_error'] = meanAndError(D.T)
    return dict(found, processor_seconds=time.process_time() - began)


def along(argument, job):
    """Mean mobility along the walls over poses of Boltzmann's law, and in unbounded fluid."""
    body, width, isSoft, side, poses, seed = argument
    random, blobs = np.random.default_rng(seed), BODIES[body]
    if width is None:
        z, q = np.zeros(poses), turns(random, poses)
    else:
        z, q, _ = draw_poses(body, width, isSoft, poses, random)
    found, values = {
        'body': body,
        'width': width,
        'isSoft': isSoft,
        'side': side,
        'poses': poses,
        'seed': seed
    }, {}
    for name, condition in (('open', 'ZeroPressureGradient'), ('closed', 'ZeroFlux')):
        scene = quietly(Scene, 'NoSlipChannel' if width else 'Unbounded', blobs, RADIUS, poses,
                        side=side, height=width, isAlone=True,
                        prepare=lambda fluid: fluid.setChannelCondition(condition))
        scene.place(np.column_stack([np.zeros((poses, 2)), z]), q)
        diagonal = np.einsum('iaia->ia', scene.mobility())
        values[name] = diagonal[:, :2].mean(1)
    # The mean of both converges to the infinite slit exponentially in the period.
    values['mean'] = (values['open'] + values['closed'])/2
    for name, column in values.items():
        found[name], found[name + '_error'] = meanAndError(column)
    job.report(poses)
    return found


def tables(data):
    yield ('| body | width | walls | scheme | time of all copies | steps redone | all bins: p | '
           'mean distance from the middle | exact | z | cos² | exact | z |')
    yield '|---|---|---|---|---|---|---|---|---|---|---|---|---|'
    for run in data['runs']:
        cells = ' | '.join(f'{brackets(m["mean"], m["error"])} | {m["exact"]:.4f} | {m["z"]:+.1f}'
                           for m in run['means'].values())
        yield (f'| {run["body"]} | {run["width"]:g} | {"soft" if run["isSoft"] else "hard"} | '
               f'{run["scheme"]} | {run["time_of_all_copies"]:.0f} | '
               f'{100*run["redone_per_step_and_body"]:.2g} % | {run["significance"]:.2g} | '
               f'{cells} |')
    yield ''
    bodies = list(BODIES)
    yield '| D along the walls, width | period | ' + ' | '.join(
        f'{body}, open | {body}, closed ends | {body}, mean of both' for body in bodies) + ' |'
    yield '|---|---|' + 3*len(bodies)*'---|'
    for width in dict.fromkeys(row['width'] for row in data['along']):
        own = {row['body']: row for row in data['along'] if row['width'] == width}
        side = own[bodies[0]]['side']
        yield (f'| {"unbounded" if width is None else format(width, "g")} | '
               f'{"" if side is None else format(side, "g")} | ') + ' | '.join(
                   brackets(own[body][name], own[body][name + '_error']) for body in bodies
                   for name in ('open', 'closed', 'mean')) + ' |'
    yield ''
    yield ('| body | width | walls | scheme | D from displacements in '
           f'{data["runs"][0]["lags"][0]:g} | mean mobility | z |')
    yield '|---|---|---|---|---|---|---|'
    for run, row in zip(data['runs'], data['short']):
        z = (run['D'][0] - row['open'])/np.hypot(run['D_error'][0], row['open_error'])
        yield (f'| {run["body"]} | {run["width"]:g} | {"soft" if run["isSoft"] else "hard"} | '
               f'{run["scheme"]} | {brackets(run["D"][0], run["D_error"][0])} | '
               f'{brackets(row["open"], row["open_error"])} | {z:+.1f} |')


def draw(data, file):
    plt = pyplot()
    runs = data['runs']
    columns = (len(runs) + 2) // 2
    figure, axes = plt.subplots(2, columns, figsize=(3.6*columns, 7), layout='constrained')
    flat = list(axes.flat)
    for ax, run in zip(flat, runs):
        law = run['exact']
        fine = np.linspace(0, run['width'], 61)
        ax.plot((fine[1:] + fine[:-1])/2, law['fine'], 'k-', linewidth=0.8,
                label='independent draws')
        edges = np.array(law['edges'])
        width = np.diff(edges)
        ax.errorbar((edges[1:] + edges[:-1])/2,
                    np.array(run['P'])/width,
                    np.array(run['P_error'])/width, width/2, 'o', markersize=3.5, label='dynamics')
        ax.set(
            title=f'{run["body"]}, H = {run["width"]:g}, '
            f'{"soft" if run["isSoft"] else "hard"}\n{run["scheme"]}, p = '
            f'{run["significance"]:.2g}', xlabel='z', ylabel='density', ylim=(0, None))
    flat[0].legend(fontsize=7)
    last = flat[len(runs)]
    for k, body in enumerate(BODIES):
        own = [row for row in data['along'] if row['body'] == body]
        free = [row['open'] for row in own if row['width'] is None]
        found = [row for row in own if row['width'] is not None]
        last.errorbar([row['width'] for row in found], [row['mean'] for row in found],
                      [row['mean_error'] for row in found], fmt='os'[k % 2] + '-', color=f'C{k}',
                      markersize=4, label=f'{body}, infinite slit')
        for value in free:
            last.axhline(value, color=f'C{k}', linestyle=':', label=f'{body}, unbounded')
    last.set(title='Diffusion along the walls', xlabel='width H', ylabel='D')
    last.legend(fontsize=7)
    for ax in flat[len(runs) + 1:]:
        ax.axis('off')
    figure.savefig(file, dpi=80)
    plt.close(figure)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--output', type=pathlib.Path, default=pathlib.Path('slits_output'))
    parser.add_argument('--quick', action='store_true', help='short runs: seconds')
    parser.add_argument('--length', type=float, default=1, help='of the runs, of the default one')
    parser.add_argument('--seed', type=int, default=32)
    campaign.addOptions(parser)
    args = campaign.settle(parser.parse_args())
    copies, frames = (16, 6) if args.quick else (64, round(150*args.length))
    draws = 20000 if args.quick else 400000
    todo = [(run, copies, frames, 0.2 if args.quick else 2.0, draws, args.seed + k)
            for k, run in enumerate(RUNS[:2] if args.quick else RUNS)]
    runs = campaign.run(
        simulate, todo,
        [f'{body} {width} {isSoft} {scheme}' for (body, width, isSoft, scheme, *_), *_ in todo],
        args, [frames*copies*spacing/step for (*_, step, spacing), *_ in todo], 'step', 'slits')
    widths = (3, None) if args.quick else WIDTHS + (None,)
    poses = 16 if args.quick else 256
    # The mean of open and closed channels of these periods is that of an infinite slit to 1e-3.
    wanted = [(body, width, False, width and max(SIDE, 2.5*width)) for body in BODIES
              for width in widths]
    wanted += [(body, width, isSoft, SIDE) for (body, width, isSoft, *_), *_ in todo]
    todo = [(*scene, poses, args.seed + 100 + k) for k, scene in enumerate(wanted)]
    mobilities = campaign.run(along, todo, [
        f'along {body} {width} {isSoft} {side} {seed}'
        for body, width, isSoft, side, _, seed in todo
    ], args,
                              len(todo)*[poses], 'pose', 'along')
    data = {
        'provenance': provenance(args),
        'runs': runs,
        'along': mobilities[:-len(runs)],
        'short': mobilities[-len(runs):]
    }
    save(args.output, 'slits.json', data)
    draw(data, args.output/'slits.png')
    print('\n'.join(tables(data)))


if __name__ == '__main__':
    main()
