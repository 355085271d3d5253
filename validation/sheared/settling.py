#!/usr/bin/env python3
"""How fast spheres settle: simple cubic arrays and random hard spheres over the volume fraction.

Every sphere has the same force, and the mean velocity of the whole is zero. The mean velocity of
spheres over that of one sphere alone is 1/K of an array, and the sedimentation coefficient of
random spheres.

    python3 settling.py --output results --jobs 2          # some minutes
"""
import pathlib
import sys

import numpy as np

sys.path.append(str(pathlib.Path(__file__).resolve().parents[1]/'common'))
import campaign  # noqa: E402
from hardspheres import (  # noqa: E402
    SWEEPS, compressibility, edgeOf, fits, hardSpheres, imagesOf, periodicFluid)
from recording import brackets, provenance, pyplot, save  # noqa: E402
from tilted_arrays import turned  # noqa: E402

from openmmrigidhi import accuracy, app  # noqa: E402

FRACTIONS = (0.05, 0.1, 0.2, 0.3, 0.4, 0.45)
#: Name in the results: model, reach of lubrication, and blobs of a sphere.
MODELS = {
    'FTS + pairs': ('StokesianDynamics', (8, 10), 1),
    'RPY': ('RotnePragerYamakawa', None, 1),
    'RPY + pairs': ('RotnePragerYamakawa', (3, 4), 1),
    'force coupling': ('ForceCoupling', None, 1),
    'force coupling + pairs': ('ForceCoupling', (3, 4), 1),
    'shells of 42': ('RotnePragerYamakawa', None, 42)
}
ARRAY_MODELS = {**MODELS, 'shells of 162': ('RotnePragerYamakawa', None, 162)}
#: Spheres of a configuration, of shells.
SHELLS = 32


def richardsonZaki(phi):
    """The velocity of settling spheres over that of one, by Richardson and Zaki (1954)."""
    return (1 - phi)**4.65


def collective(model, x, edge, seed=1):
    """The mean velocity of spheres under equal forces, over that of one sphere alone."""
    name, reach, blobs = model
    sites, radius = (np.zeros(
        (1,
         3)), 1.0) if blobs == 1 else [value._value for value in app.multiblobSphere(blobs, 1.0)]
    context, fluid, _ = periodicFluid(name, reach, x, edge, sites=sites, radius=radius,
                                      turns=turned(len(x), seed))
    velocities = []
    for axis in range(3):
        wrenches = np.zeros((len(x), 6))
        wrenches[:, axis] = 1
        velocities.append(fluid.applyMobilityInContext(context, wrenches)[:, axis].mean())
    return 6*np.pi*np.mean(velocities)


def array(argument, job):
    """1/K of an array by all models; None where shells do not fit into the lattice."""
    fraction, names = argument
    found = {}
    for name in names:
        try:
            found[name] = collective(ARRAY_MODELS[name], np.zeros((1, 3)), edgeOf(1, fraction))
        except Exception as error:
            if 'would overlap its own image' not in str(error):
                raise
            found[name] = None
    return {
        'fraction': fraction,
        'exact': 1/accuracy.scenes.SIMPLE_CUBIC[fraction][0],
        'velocity': found
    }


def configuration(argument, job):
    """The velocity in one configuration, less what images add, by all models."""
    phi, number, seed, names = argument
    found = {}
    random = np.random.default_rng((seed, round(1000*phi)))
    x, edge = hardSpheres(number, phi, random)
    for name in names:
        # Images slow the whole by 1.76 (phi/n)^(1/3) eta/eta_suspension times S(0).
        found[name] = collective(MODELS[name], x, edge, seed +
                                 1) + compressibility(phi)*imagesOf(phi, number,
                                                                    fits(phi)['viscosity'])
    return found


def tables(data):
    """Lines of tables in Markdown."""
    names = list(data['arrays'][0]['velocity'])
    yield '| simple cubic, volume fraction | exact 1/K | ' + ' | '.join(names) + ' |'
    yield '|---'*(2 + len(names)) + '|'
    for each in data['arrays']:
        cells = [
            '' if value is None else f'{value:.4f} ({value/each["exact"]:.2f})'
            for value in each['velocity'].values()
        ]
        yield f'| {each["fraction"]:g} | {each["exact"]:.4f} | ' + ' | '.join(cells) + ' |'
    yield ''
    names = list(data['random'][0]['velocity'])
    yield '| random, volume fraction | fit | (1 − φ)^4.65 | ' + ' | '.join(names) + ' |'
    yield '|---'*(3 + len(names)) + '|'
    for each in data['random']:
        phi = each['fraction']
        yield f'| {phi:g} | {each["fit"]:.3f} | {richardsonZaki(phi):.3f} | ' + ' | '.join(
            f'{brackets(*value)} ({value[0]/each["fit"]:.2f})'
            for value in each['velocity'].values()) + ' |'


def draw(data, file):
    plt = pyplot()
    figure, axes = plt.subplots(1, 2, figsize=(11, 4.4), layout='constrained')
    x = [each['fraction'] for each in data['arrays']]
    axes[0].plot(x, [each['exact'] for each in data['arrays']], 'ko-', ms=5, lw=1, label='exact')
    markers = dict(zip(ARRAY_MODELS, 'sxv+^Dp'))
    for name in data['arrays'][0]['velocity']:
        pairs = [(each['fraction'], each['velocity'][name]) for each in data['arrays']
                 if each['velocity'][name]]
        axes[0].plot(*zip(*pairs), markers[name] + '--', mfc='none', ms=6, lw=0.6, label=name)
    line = np.linspace(0.001, 0.46, 100)
    axes[1].plot(line, fits(line)['K'], 'k-', lw=1, label='short times, published fit')
    axes[1].plot(line, richardsonZaki(line), 'k:', lw=1, label='(1 − φ)^4.65')
    for k, name in enumerate(data['random'][0]['velocity']):
        mean, error = np.array([each['velocity'][name] for each in data['random']]).T
        axes[1].errorbar([each['fraction'] for each in data['random']], mean, error,
                         fmt=markers[name], color=f'C{k}', mfc='none', ms=6, capsize=3, label=name)
    for axis, title in zip(axes, ('simple cubic arrays', 'random hard spheres')):
        axis.set(xlabel='volume fraction', ylabel='velocity over that of one sphere', yscale='log',
                 title=title)
        axis.grid(alpha=0.3)
        axis.legend(fontsize=8)
    figure.savefig(file, dpi=90)
    plt.close(figure)


def main():
    parser = campaign.parser(__doc__, 'few spheres, no shells: seconds')
    parser.add_argument('--number', type=int, default=108,
                        help='number of spheres, 4 k^3 (%(default)s); of shells it is 32')
    parser.add_argument('--configurations', type=int, default=3,
                        help='configurations at each volume fraction (%(default)s)')
    parser.add_argument('--seed', type=int, default=0)
    campaign.addOptions(parser)
    args = campaign.settle(parser.parse_args())
    single = [name for name, model in MODELS.items() if model[2] == 1]
    shells = [] if args.quick else [name for name in MODELS if name not in single]
    number, count = (32, 2) if args.quick else (args.number, args.configurations)
    fractions = FRACTIONS[1::3] if args.quick else FRACTIONS
    arrays = campaign.run(array, [(fraction, single if args.quick else list(ARRAY_MODELS))
                                  for fraction in accuracy.scenes.SIMPLE_CUBIC],
                          [f'array {fraction:g}' for fraction in accuracy.scenes.SIMPLE_CUBIC],
                          args, unit='array', title='settling arrays')
    todo = [(phi, *what) for phi in fractions for seed in range(args.seed, args.seed + count)
            for what in [(number, seed, single)] + [(SHELLS, seed, shells)]*bool(shells)]
    found = campaign.run(configuration, todo,
                         [f'settling {phi:g} {n} {seed}' for phi, n, seed, _ in todo], args,
                         unit='configuration', title='random spheres')
    rows = []
    for phi in fractions:
        velocity = {}
        for name in single + shells:
            values = [
                each[name] for case, each in zip(todo, found) if case[0] == phi and name in each
            ]
            velocity[name] = np.mean(values), np.std(values, ddof=1)/len(values)**0.5
        rows.append({'fraction': phi, 'fit': fits(phi)['K'], 'velocity': velocity})
    data = {
        'provenance': provenance(args),
        'number': number,
        'number_of_shells': SHELLS,
        'configurations': count,
        'sweeps': SWEEPS,
        'arrays': arrays,
        'random': rows
    }
    save(args.output, 'settling.json', data)
    draw(data, args.output/'settling.png')
    print('\n'.join(tables(campaign.asJson(data))))


if __name__ == '__main__':
    main()
