"""Moments of inertia times a factor (setInertiaScale) for longer steps in water: the measurement in results_inertia/, made again.

LangevinC with the real moments, and with 4, 8 and 16 times these, at steps up to where the energy fails. What they are compared with is the limit of
small steps of results/results.json. Options: --budget seconds, --output folder.
"""
import argparse
import json
import os

from openmmrigidhi import accuracy

HERE = os.path.dirname(os.path.abspath(__file__))
STEPS = {'LangevinC': [0.004, 0.009, 0.010], 'LangevinC-I4': [0.009, 0.012, 0.014], 'LangevinC-I8': [0.012, 0.014, 0.016],
         'LangevinC-I16': [0.012, 0.015, 0.016]}


def limitOfSmallSteps():
    """Potential energy per molecule and its standard error, kJ/mol."""
    with open(os.path.join(HERE, 'results', 'results.json')) as file:
        reference = json.load(file)['references']['potential_energy']
    return reference['value'], reference['standard_error']


if __name__ == '__main__':
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--budget', type=float, default=1100, help='seconds (1100)')
    parser.add_argument('--output', default=os.path.join(HERE, 'results_inertia'))
    options = parser.parse_args()
    study = accuracy.StepSizeStudy(accuracy.scenes.water(216, seed=2026, threads=1), list(STEPS), STEPS,
                                   references={'potential_energy': limitOfSmallSteps()}, seed=2028, clock='cpu')
    study.run(budget=options.budget, rounds=10).write(options.output, ['potential_energy:0.5%'])
