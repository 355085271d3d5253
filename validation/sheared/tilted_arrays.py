#!/usr/bin/env python3
"""Simple cubic arrays of spheres in shear: viscosity and rotation over the tilt, beside exact ones.

One sphere in a periodic box is an infinite array. Shear along an edge tilts the box. The viscosity
at each tilt is that of the stress in uniform shear.

    python3 tilted_arrays.py --output results           # a minute
"""
import pathlib
import sys

import numpy as np

sys.path.append(str(pathlib.Path(__file__).resolve().parents[1]/'common'))
import campaign  # noqa: E402
from hardspheres import edgeOf, periodicFluid  # noqa: E402
from recording import provenance, pyplot, save  # noqa: E402

from openmmrigidhi import app  # noqa: E402

#: Volume fraction -> tilt -> viscosity over the fluid's, by boundary collocation with the lattice's
#: periods; converged in all digits, except for those of 0.45 at tilts, which are good to 0.01.
EXACT = {
    0.064: {
        0: 1.1551479,
        0.2: 1.1594976,
        0.5: 1.1672025
    },
    0.216: {
        0: 1.542367,
        0.1: 1.55716,
        0.2: 1.59387,
        0.3: 1.63545,
        0.4: 1.66622,
        0.5: 1.67734
    },
    0.45: {
        0: 2.73904,
        0.2: 3.22,
        0.5: 3.64
    }
}
#: Volume fraction -> (angular velocity + rate/2)/rate of a sphere at the tilt 0.5, by the same
#: collocation.
EXACT_SPIN = {0.064: 0.0089846, 0.216: 0.03202}
#: Name in the results: model, reach of lubrication, and blobs of a sphere.
MODELS = {
    'FTS': ('StokesianDynamics', None, 1),
    'FTS + pairs': ('StokesianDynamics', (8, 10), 1),
    'FTS + pairs, 3 to 4': ('StokesianDynamics', (3, 4), 1),
    'RPY': ('RotnePragerYamakawa', None, 1),
    'RPY + pairs': ('RotnePragerYamakawa', (3, 4), 1),
    'force coupling': ('ForceCoupling', None, 1),
    'shells of 42, RPY': ('RotnePragerYamakawa', None, 42),
    'shells of 162, RPY': ('RotnePragerYamakawa', None, 162),
    'shells of 162, force coupling': ('ForceCoupling', None, 162),
    'shells of 642, RPY': ('RotnePragerYamakawa', None, 642)
}
SHOWN = {
    'FTS': 'C1--',
    'FTS + pairs': 'C0-',
    'shells of 162, RPY': 'C2s',
    'shells of 642, RPY': 'C3^'
}
#: Orientations of shells.
TURNS = {1: 1, 42: 4, 162: 4, 642: 1}


def turned(count, seed=1):
    """Uniform unit quaternions."""
    q = np.random.default_rng(seed).normal(size=(count, 4))
    return q/np.linalg.norm(q, axis=1, keepdims=True)


def measure(fraction, tilt, name):
    """Viscosity over the fluid's and spin, (Omega_z + rate/2)/rate, of an array."""
    model, reach, blobs = MODELS[name]
    edge, rate, step = edgeOf(1, fraction), 1.0, 1e-4
    box = edge*np.array([(1, 0, 0), (tilt, 1, 0), (0, 0, 1)])
    sites, radius = (np.zeros(
        (1,
         3)), 1.0) if blobs == 1 else [value._value for value in app.multiblobSphere(blobs, 1.0)]
    found = []
    for turn in turned(TURNS[blobs]):
        context, fluid, integrator = periodicFluid(model, reach, np.zeros((1, 3)), box,
                                                   (rate, 0, 1), sites, radius, [turn], step=step)
        stress = fluid.getStressInContext(context).hydrodynamic._value[0, 1]
        integrator.step(1)
        # The turn of this step, as a vector: twice the vector part of q times the start's inverse.
        w, v = integrator.getBodyOrientations()[0, 0], integrator.getBodyOrientations()[0, 1:]
        move = turn[0]*v - w*turn[1:] - np.cross(v, turn[1:])
        found.append((1 + stress/rate, 2*move[2]/step/rate + 0.5))
    return {'viscosity': np.mean(found, axis=0)[0], 'spin': np.mean(found, axis=0)[1]}


def row(argument, job):
    """One array at all tilts by one model; None where shells do not fit into the lattice."""
    fraction, tilts, name = argument
    try:
        found = [measure(fraction, tilt, name) for tilt in tilts]
    except Exception as error:
        if 'would overlap its own image' not in str(error):
            raise
        return {'fraction': fraction, 'model': name, 'tilts': tilts, 'viscosity': None}
    return {
        'fraction': fraction,
        'model': name,
        'tilts': tilts,
        **{key: [each[key] for each in found]
           for key in ('viscosity', 'spin')}
    }


def at(data, fraction, name, tilt, key='viscosity'):
    """A value of the results; None if there is none."""
    for each in data['rows']:
        if (each['fraction'], each['model']) == (fraction, name) and each['viscosity']:
            return each[key][each['tilts'].index(tilt)] if tilt in each['tilts'] else None
    return None


def tables(data):
    """Lines of tables in Markdown."""
    names = [name for name in data['models'] if not name.startswith(('RPY', 'force'))]
    yield '| volume fraction | tilt | exact | ' + ' | '.join(names) + ' |'
    yield '|---'*(3 + len(names)) + '|'
    for fraction, exact in EXACT.items():
        for tilt, value in exact.items():
            cells = []
            for name in names:
                found = at(data, fraction, name, tilt)
                cells.append(
                    '' if found is None else f'{found:.4f} ({100*(found/value - 1):+.2f} %)')
            digits = 2 if fraction == 0.45 and tilt else 4
            yield f'| {fraction:g} | {tilt:g} | {value:.{digits}f} | ' + ' | '.join(cells) + ' |'
    yield ''
    yield '| volume fraction | spin at the tilt 0.5, exact | ' + ' | '.join(names) + ' |'
    yield '|---'*(2 + len(names)) + '|'
    for fraction, value in EXACT_SPIN.items():
        yield f'| {fraction:g} | {value:.5f} | ' + ' | '.join(
            f'{at(data, fraction, name, 0.5, "spin"):.5f}' for name in names) + ' |'


def draw(data, file):
    plt = pyplot()
    figure, axes = plt.subplots(1, 3, figsize=(12.5, 3.9), layout='constrained')
    for axis, (fraction, exact) in zip(axes, EXACT.items()):
        for name, style in SHOWN.items():
            own = [
                each for each in data['rows']
                if each['fraction'] == fraction and each['model'] == name and each['viscosity']
            ]
            for each in own:
                axis.plot(each['tilts'], each['viscosity'], style, mfc='none', label=name)
        errors = [0.01 if fraction == 0.45 and tilt else 0 for tilt in exact]
        axis.errorbar(list(exact), list(exact.values()), errors, fmt='ko', ms=5, capsize=3,
                      label='exact')
        axis.set(xlabel='tilt', title=f'volume fraction {fraction:g}')
        axis.grid(alpha=0.3)
    axes[0].set(ylabel='viscosity over that of the fluid')
    axes[0].legend(fontsize=8)
    figure.savefig(file, dpi=90)
    plt.close(figure)


def main():
    parser = campaign.parser(__doc__, 'two tilts, no shells: seconds')
    campaign.addOptions(parser)
    args = campaign.settle(parser.parse_args())
    models = [name for name, model in MODELS.items() if model[2] == 1 or not args.quick]
    tilts = [0, 0.5] if args.quick else np.round(np.linspace(0, 0.5, 11), 2).tolist()
    todo = [(fraction, tilts if MODELS[name][2] == 1 else tilts[::2], name) for fraction in EXACT
            for name in models]
    rows = campaign.run(row, todo, [f'array {fraction:g} {name}' for fraction, _, name in todo],
                        args, unit='array', title='tilted arrays')
    data = {'provenance': provenance(args), 'models': models, 'rows': rows}
    save(args.output, 'tilted_arrays.json', data)
    draw(data, args.output/'tilted_arrays.png')
    print('\n'.join(tables(data)))


if __name__ == '__main__':
    main()
