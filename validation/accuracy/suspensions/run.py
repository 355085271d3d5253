#!/usr/bin/env python3
"""Random hard spheres at short times: diffusion, sedimentation and high-frequency viscosity.

Configurations are drawn by Monte Carlo steps of hard spheres in a cubic periodic box. At each of
them the mobility gives the short-time diffusion coefficients of translation D_s and rotation D_r
and the sedimentation velocity K, and the stress in uniform shear gives the viscosity. The effect of
images is taken off as Ladd (1990) does. The fits to published results are those of the literature
named in README.md, to some 3 %.

    python3 run.py --output results --jobs 2          # some minutes
"""
import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]/'common'))
import campaign  # noqa: E402
import recording  # noqa: E402
from hardspheres import (  # noqa: E402
    SWEEPS, compressibility, fits, hardSpheres, imagesOf, periodicFluid)

FRACTIONS = (0.1, 0.2, 0.3, 0.4, 0.45)
#: Name in the results: model, and the reach of its lubrication in mean radii (None: it has none).
MODELS = {
    'FTS': ('StokesianDynamics', None),
    'FTS + pairs': ('StokesianDynamics', (8, 10)),
    'RPY + pairs': ('RotnePragerYamakawa', (3, 4)),
    'RPY + pairs up to 10': ('RotnePragerYamakawa', (8, 10))
}
SHEARS = ((0, 1), (0, 2), (1, 2))


def configuration(argument, job):
    """All quantities of one configuration, by all models."""
    phi, number, seed = argument
    x, edge = hardSpheres(number, phi, np.random.default_rng((seed, round(1000*phi))))
    found = {}
    for name, (model, reach) in MODELS.items():
        viscosity = []
        for shear in SHEARS if model == 'StokesianDynamics' else SHEARS[:1]:
            made, fluid, _ = periodicFluid(model, reach, x, edge, (1, *shear))
            stress = fluid.getStressInContext(made).hydrodynamic._value
            viscosity.append(1 + stress[shear])
        M = np.asarray(fluid.getMobilityInContext(made)).reshape(number, 6, number, 6)
        eta = np.mean(viscosity)
        # The images make a sphere slower by 1.76 (phi/n)^(1/3) eta/eta_suspension of its own
        # mobility, and all spheres together by as much times S(0).
        images = imagesOf(phi, number,
                          eta if model == 'StokesianDynamics' else fits(phi)['viscosity'])
        own, turning = 6*np.pi, 8*np.pi
        D_s = own*np.einsum('iaia->', M[:, :3, :, :3])/(3*number)
        K = own*np.einsum('iaja->', M[:, :3, :, :3])/(3*number)
        found[name] = {
            'D_s': D_s + images,
            'D_r': turning*np.einsum('iaia->', M[:, 3:, :, 3:])/(3*number),
            'K': K + images*compressibility(phi),
            'viscosity': eta if model == 'StokesianDynamics' else None
        }
    return found


def tables(rows):
    """Lines of a table in Markdown."""
    yield '| volume fraction | quantity | fit | ' + ' | '.join(MODELS) + ' |'
    yield '|---'*(3 + len(MODELS)) + '|'
    for row in rows:
        for quantity, fit in row['fits'].items():
            cells = []
            for name in MODELS:
                value = row['means'][name][quantity]
                cells.append('' if value is None else f'{value[0]:.4f} ± {value[1]:.4f}')
            yield f'| {row["fraction"]:g} | {quantity} | {fit:.3f} | ' + ' | '.join(cells) + ' |'


def picture(rows, path):
    plt = recording.pyplot()
    figure, axes = plt.subplots(1, 4, figsize=(14, 3.6), layout='constrained')
    x = [row['fraction'] for row in rows]
    line = np.linspace(0.001, max(x), 100)
    for axis, quantity in zip(axes, rows[0]['fits']):
        axis.plot(line, fits(line)[quantity], 'k-', lw=1, label='published, fit')
        for marker, name in zip('os^v', MODELS):
            values = [row['means'][name][quantity] for row in rows]
            if None not in values:
                mean, error = np.array(values).T
                axis.errorbar(x, mean, error, fmt=marker, ms=5, mfc='none', label=name)
        axis.set(xlabel='volume fraction', title=quantity)
    axes[2].set_yscale('log')
    axes[0].legend(fontsize=8)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--output', type=Path, default=Path('results'),
                        help='folder of the JSON (results)')
    parser.add_argument('--number', type=int, default=108,
                        help='number of spheres, 4 k^3 (%(default)s)')
    parser.add_argument('--configurations', type=int, default=4,
                        help='configurations at each volume fraction (%(default)s)')
    campaign.addOptions(parser)
    arguments = campaign.settle(parser.parse_args())
    todo = [(phi, arguments.number, seed) for phi in FRACTIONS
            for seed in range(arguments.configurations)]
    found = campaign.run(configuration, todo, [f'spheres {phi:g} {seed}' for phi, _, seed in todo],
                         arguments, unit='configuration')
    rows = []
    for phi in FRACTIONS:
        ours = [each for (fraction, *_), each in zip(todo, found) if fraction == phi]
        means = {name: {} for name in MODELS}
        for name, quantities in means.items():
            for quantity in fits(phi):
                values = [each[name][quantity] for each in ours]
                quantities[quantity] = None if None in values else (float(
                    np.mean(values)), float(np.std(values, ddof=1)/len(values)**0.5))
        rows.append({'fraction': phi, 'fits': fits(phi), 'means': means})
    recording.save(
        arguments.output, 'suspensions.json', {
            'rows': rows,
            'number': arguments.number,
            'configurations': arguments.configurations,
            'sweeps': SWEEPS,
            'run': recording.provenance(arguments)
        })
    picture(rows, arguments.output/'suspensions.png')
    print('\n'.join(tables(rows)))


if __name__ == '__main__':
    main()
