#!/usr/bin/env python3
"""Spheres near a wall with and without lubrication: a pair of rollers, and a monolayer.

Rollers spin at a prescribed rate about an axis along the wall, and are free otherwise. Their
velocities over the gap between them stand beside those of a collocation of both surfaces. In a
monolayer hard discs are at one height: the short-time self-diffusion along the wall, and the
friction of the whole layer with the wall, over the area fraction.

    python3 rollers.py --output results --jobs 2          # some minutes
"""
import pathlib
import sys

import numpy as np

HERE = pathlib.Path(__file__).resolve().parent
sys.path += [str(HERE), str(HERE.parent/'common'), str(HERE.parent/'confined')]
import campaign  # noqa: E402
from collocation import frictionOfPair  # noqa: E402
from confinedscene import Scene, meanAndError, quietly, sphere, turns  # noqa: E402
from monolayer import Discs  # noqa: E402
from recording import brackets, provenance, pyplot, save  # noqa: E402

#: Gaps to the wall, and between spheres, in radii.
WALL_GAPS = (0.2, 1)
GAPS = (0.1, 0.2, 0.4, 0.7, 1, 2, 4)
#: Gaps of pairs and to the wall at which frictions are compared; those of one gap are beside those
#: of the rollers.
CORNERS = ((1, 1), (1, 0.2), (0.2, 1), (0.2, 0.2), (0.1, 0.1))
#: Points of the collocation, for two results, and those where a surface is nearer than 0.15 to the
#: middle of a gap.
POINTS, MORE_POINTS = (250, 450), (400, 700)
#: Name in the results: whether the own mobility is BestKnown, and whether there is lubrication.
MODELS = {
    'RPY': (False, False),
    'RPY, BestKnown': (True, False),
    'RPY + lubrication': (False, True)
}
HEIGHTS = (1.05, 1.25)
FRACTIONS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)


def lubricated(fluid):
    fluid.setLubrication('On')


def sceneOf(name, *arguments, **settings):
    isBestKnown, isLubricated = MODELS[name]
    return quietly(Scene, *arguments, isBestKnown=isBestKnown,
                   prepare=lubricated if isLubricated else None, **settings)


def frictionByModel(name, apart, height):
    """The friction (12, 12) of two spheres by a model."""
    scene = sceneOf(name, 'NoSlipWall', *sphere(1), 2)
    scene.place(np.array([(0, 0, height), (apart, 0, height)]))
    return np.linalg.inv(scene.mobility().reshape(12, 12))


def rolling(R):
    """Velocities over the spin of two rollers of the friction R.

    Returns
    -------
    dict
        'along': of both along the wall, where they roll along the line of centres; 'up': of the
        one in front, across the wall; 'beside': along the wall, where they roll side by side
    """
    found = {}
    for axis, names in ((4, ('along', 'up')), (3, ('beside',))):
        driven = [axis, 6 + axis]
        free = [k for k in range(12) if k not in driven]
        u = np.linalg.solve(R[np.ix_(free, free)], -R[np.ix_(free, driven)].sum(axis=1))
        whole = np.ones(12)
        whole[free] = u
        if axis == 4:
            found['along'], found['up'] = (whole[0] + whole[6])/2, whole[8]
        else:
            found['beside'] = -(whole[1] + whole[7])/2
    return found


def pair(argument, job):
    """Rollers at one gap and height, and the errors of frictions.

    'fewer points' is the collocation with fewer points, whose difference shows how far it has
    converged.
    """
    gap, wall, points = argument
    apart, height = 2 + gap, 1 + wall
    exact = [frictionOfPair(apart, height, count) for count in points]
    own = np.linalg.cholesky(np.linalg.inv(exact[-1]))

    def error(R):
        return float(abs(np.linalg.eigvalsh(own.T @ ((R + R.T)/2) @ own) - 1).max())

    found = {'gap': gap, 'wall': wall, 'points': points}
    frictions = {name: frictionByModel(name, apart, height) for name in MODELS}
    frictions['fewer points'] = exact[0]
    found['error'] = {name: error(R) for name, R in frictions.items()}
    found['rolling'] = {'exact': rolling(exact[-1])}
    found['rolling'].update((name, rolling(R)) for name, R in frictions.items())
    return found


def layer(case, job):
    """Self-diffusion and friction with the wall of one monolayer, over configurations."""
    random = np.random.default_rng(case['seed'])
    discs = Discs(case['count'], case['fraction'], random)
    discs.sweep(case['settle'], adapt=True)
    sites, radius = sphere(case['blobs'])
    n, height = case['count'], case['height']

    def sceneOfLayer(boundary, count, side):
        return sceneOf(case['model'], boundary, sites, radius, count, side=side)

    scene = sceneOfLayer('PeriodicWall', n, discs.side)
    own, friction = [], []
    for _ in range(case['configurations']):
        discs.sweep(case['sweeps'])
        scene.place(np.column_stack([discs.centres, np.full(n, height)]),
                    turns(random, n) if case['blobs'] > 1 else None)
        M = scene.mobility()
        own.append(np.einsum('iaia->ia', M)[:, :2].mean())
        # All move alike along the wall and are free to turn: F = N_tt^-1 U.
        N = M[:, :3, :, :3].reshape(3*n, 3*n)
        along = np.zeros((3*n, 2))
        along[0::3, 0] = along[1::3, 1] = 1
        friction.append((along*np.linalg.solve(N, along)).sum()/(2*n))
    # What the images of one sphere by itself add in the same box.
    single = []
    for boundary, side in (('PeriodicWall', discs.side), ('NoSlipWall', None)):
        one = sceneOfLayer(boundary, 1, side)
        one.place(np.array([(0, 0, height)]),
                  turns(np.random.default_rng(1), 1) if case['blobs'] > 1 else None)
        single.append(np.einsum('iaia->ia', one.mobility())[0, :2].mean())
    found = dict(case, side=discs.side, alone=single[1])
    found['self'], found['self_error'] = meanAndError(np.array(own) - single[0] + single[1])
    found['friction'], found['friction_error'] = meanAndError(friction)
    return found


def layers(quick, seed):
    """All monolayers."""
    made = []

    def add(model, blobs, count, height, fraction, configurations):
        made.append({
            'model': model,
            'blobs': blobs,
            'count': count,
            'height': height,
            'fraction': fraction,
            'configurations': configurations,
            'settle': 60 if quick else 400,
            'sweeps': 10 if quick else 60,
            'seed': seed + len(made)
        })

    for height in HEIGHTS:
        for fraction in FRACTIONS[1::3] if quick else FRACTIONS:
            for model in MODELS:
                add(model, 1, 9 if quick else 49, height, fraction, 3 if quick else 8)
            if height == HEIGHTS[1] and not quick:
                add('RPY', 42, 16, height, fraction, 4)
    return made


def nameOf(case):
    return case['model'] if case['blobs'] == 1 else f'shells of {case["blobs"]}'


def tables(data):
    """Lines of tables in Markdown."""
    names = list(MODELS)
    for key, title in (('along', 'one behind the other'), ('up', 'of the one in front, upward'),
                       ('beside', 'side by side')):
        yield (f'| velocity {title}: wall gap | gap | exact | with fewer points | ' +
               ' | '.join(names) + ' |')
        yield '|---'*(4 + len(names)) + '|'
        for each in data['pairs']:
            cells = [
                f'{each["rolling"][name][key]:.4f}' for name in ('exact', 'fewer points', *names)
            ]
            yield f'| {each["wall"]:g} | {each["gap"]:g} | ' + ' | '.join(cells) + ' |'
        yield ''
    yield '| largest error of friction: gap | wall gap | with fewer points | ' + ' | '.join(
        names) + ' |'
    yield '|---'*(3 + len(names)) + '|'
    for each in data['pairs']:
        if (each['gap'], each['wall']) in CORNERS:
            yield f'| {each["gap"]:g} | {each["wall"]:g} | ' + ' | '.join(
                f'{100*each["error"][name]:.2g} %' for name in ('fewer points', *names)) + ' |'
    for key, title in (('self', 'self-diffusion D'), ('friction', 'friction of the layer')):
        for height in dict.fromkeys(run['height'] for run in data['layers']):
            own = [run for run in data['layers'] if run['height'] == height]
            fractions = sorted({run['fraction'] for run in own})
            yield ''
            yield f'| {title}, height {height:g} | one alone | ' + ' | '.join(
                f'{fraction:g}' for fraction in fractions) + ' |'
            yield '|---'*(2 + len(fractions)) + '|'
            for name in dict.fromkeys(nameOf(run) for run in own):
                runs = [run for run in own if nameOf(run) == name]
                alone = runs[0]['alone'] if key == 'self' else 1/runs[0]['alone']
                yield f'| {name} | {alone:.4f} | ' + ' | '.join(
                    brackets(run[key], run[key + '_error']
                             ) if run[key + '_error'] > 1e-6 else f'{run[key]:.4f}'
                    for run in runs) + ' |'


def draw(data, file):
    plt = pyplot()
    figure, axes = plt.subplots(2, 3, figsize=(13.5, 7.6), layout='constrained')
    styles = dict(zip(MODELS, ('C1s--', 'C2^--', 'C0o-')))
    for axis, wall in zip(axes[0], WALL_GAPS):
        for key, kind in (('along', 'full'), ('beside', 'none')):
            own = [each for each in data['pairs'] if each['wall'] == wall]
            gaps = [each['gap'] for each in own]
            axis.plot(gaps, [each['rolling']['exact'][key] for each in own], 'k-', lw=1.2,
                      label='exact' if key == 'along' else None)
            for name, style in styles.items():
                axis.plot(gaps, [each['rolling'][name][key] for each in own], style, lw=0.6, ms=5,
                          fillstyle=kind, label=name if key == 'along' else None)
        axis.set(
            xscale='log', yscale='log', xlabel='gap between spheres / radius',
            ylabel='velocity / (spin × radius)', title=f'pair of rollers, wall gap {wall:g}\n'
            'full: one behind the other; open: side by side')
        ticks = (0.03, 0.05, 0.1, 0.15) if wall < 0.5 else (0.005, 0.01, 0.02, 0.04)
        axis.set_yticks(ticks, map(str, ticks))
        axis.minorticks_off()
    axis = axes[0, 2]
    own = [each for each in data['pairs'] if each['wall'] == WALL_GAPS[0]]
    gaps = [each['gap'] for each in own]
    axis.plot(gaps, [each['rolling']['exact']['up'] for each in own], 'k-', lw=1.2, label='exact')
    for name, style in styles.items():
        axis.plot(gaps, [each['rolling'][name]['up'] for each in own], style, lw=0.6, ms=5,
                  label=name)
    axis.set(xscale='log', xlabel='gap between spheres / radius',
             ylabel='upward velocity / (spin × radius)',
             title=f'the roller in front, wall gap {WALL_GAPS[0]:g}')
    axis.axhline(0, color='0.8', lw=0.7)
    axis.legend(fontsize=8)
    for axis in axes[0]:
        axis.set_xticks((0.1, 0.2, 0.5, 1, 2, 4), ('0.1', '0.2', '0.5', '1', '2', '4'))
    for axis, key, height in ((axes[1, 0], 'self', HEIGHTS[0]), (axes[1, 1], 'self', HEIGHTS[1]),
                              (axes[1, 2], 'friction', HEIGHTS[0])):
        own = [run for run in data['layers'] if run['height'] == height]
        for k, name in enumerate(dict.fromkeys(nameOf(run) for run in own)):
            runs = [run for run in own if nameOf(run) == name]
            axis.errorbar([run['fraction'] for run in runs], [run[key] for run in runs],
                          [run[key + '_error'] for run in runs], fmt=styles.get(name, 'C3D:'),
                          lw=0.8, ms=5, capsize=3, label=name)
        axis.set(
            xlabel='area fraction', ylim=(0, None),
            ylabel='D over that far from walls' if key == 'self' else 'force / (6πηa U)',
            title=('self-diffusion' if key == 'self' else 'friction of the layer') +
            f', height {height:g}')
        axis.legend(fontsize=8)
    for axis in axes.flat:
        axis.grid(alpha=0.3)
    figure.savefig(file, dpi=85)
    plt.close(figure)


def main():
    parser = campaign.parser(__doc__, 'few points and spheres: seconds')
    parser.add_argument('--seed', type=int, default=34)
    campaign.addOptions(parser)
    args = campaign.settle(parser.parse_args())
    todo = [(gap, wall) for wall in WALL_GAPS for gap in (GAPS[4::2] if args.quick else GAPS)]
    todo += [] if args.quick else [corner for corner in CORNERS if corner not in todo]
    pairs = campaign.run(
        pair, [(gap, wall,
                (60, 100) if args.quick else MORE_POINTS if min(gap/2, wall) < 0.15 else POINTS)
               for gap, wall in todo], [f'pair {gap:g} {wall:g}' for gap, wall in todo], args,
        unit='pair', title='rollers')
    cases = layers(args.quick, args.seed)
    runs = campaign.run(layer, cases,
                        [f'{nameOf(case)} {case["height"]} {case["fraction"]}' for case in cases],
                        args, unit='layer', title='monolayers')
    data = {'provenance': provenance(args), 'pairs': pairs, 'layers': runs}
    save(args.output, 'rollers.json', data)
    draw(data, args.output/'rollers.png')
    print('\n'.join(tables(data)))


if __name__ == '__main__':
    main()
