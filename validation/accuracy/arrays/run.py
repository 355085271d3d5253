#!/usr/bin/env python3
"""Simple cubic arrays of spheres: drag and torque by each model, beside exact numbers.

One sphere in a cubic periodic box is an infinite array. F = 6 pi eta a K U is the force on each
sphere that moves through the fluid with the velocity U relative to the mean. T = 8 pi eta a^3 KR
Omega is the torque on each sphere where all rotate alike. The exact numbers, and the arrays
themselves, are those of the hydrodynamic ladder: openmmrigidhi.accuracy.scenes.

    python3 run.py --output results          # a second
"""
import argparse
import sys
from pathlib import Path

from openmmrigidhi import accuracy

sys.path.insert(0, str(Path(__file__).resolve().parents[2]/'common'))
import campaign  # noqa: E402
import recording  # noqa: E402

# Names in the results, and the models of the hydrodynamic ladder.
MODELS = {
    'RPY': 'RPY',
    'force coupling': 'ForceCoupling',
    'FTS': 'FTS',
    'FTS + lubrication': 'FTS+lubrication'
}
NUMBERS = {'K': 'drag', 'KR': 'rotational_drag'}


def measure(fraction, rung):
    """K and KR of an array."""
    spheres = accuracy.rungs.Spheres(accuracy.scenes.array(fraction))
    fluid, _, context = spheres.makeContext(accuracy.rungs.byName(rung))
    sample = spheres.sample(fluid, context)
    return {
        name: accuracy.mobilities.byName(observable).measure(sample)
        for name, observable in NUMBERS.items()
    }


def row(fraction, job):
    """One array by all models."""
    return {
        'fraction': fraction,
        'exact': dict(zip(NUMBERS, accuracy.scenes.SIMPLE_CUBIC[fraction])),
        **{name: measure(fraction, rung)
           for name, rung in MODELS.items()}
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--output', type=Path, default=Path('results'),
                        help='folder of the JSON (results)')
    campaign.addOptions(parser)
    arguments = campaign.settle(parser.parse_args())
    fractions = list(accuracy.scenes.SIMPLE_CUBIC)
    rows = campaign.run(row, fractions, [f'array {fraction:g}' for fraction in fractions],
                        arguments, unit='array')
    for each in rows:
        print(
            f'{each["fraction"]:6.3f}',
            *(f'{name}: K {values["K"]:.6f}, KR {values["KR"]:.6f};'
              for name, values in each.items() if name != 'fraction'))
    recording.save(arguments.output, 'simple_cubic.json', {
        'arrays': rows,
        'run': recording.provenance(arguments)
    })


if __name__ == '__main__':
    main()
