"""A second run around the steps that decide, with another seed, and LangevinMiddle with a friction of 1/ps besides.

Also an example of a method of one's own. Writes results_second/.
"""
import os

import openmm

from openmmrigidhi import accuracy


def weaklyCoupled(scene, stepSize, seed):
    """LangevinMiddle with 1/ps instead of the scene's friction."""
    integrator = openmm.LangevinMiddleIntegrator(scene.temperature, 1.0, stepSize)
    integrator.setRandomNumberSeed(seed)
    return integrator


if __name__ == '__main__':
    study = accuracy.StepSizeStudy(
        accuracy.scenes.water(216, seed=2026, threads=1),
        ['LangevinC', 'LangevinMiddle', accuracy.Method('LangevinMiddle, 1/ps', weaklyCoupled)],
        {'LangevinC': [0.009, 0.0095], 'LangevinMiddle': [0.007, 0.0075, 0.008], 'LangevinMiddle, 1/ps': [0.006, 0.007]},
        references={'potential_energy': (-46.498, 0.042)},   # the limit of small steps of results/results.json
        seed=2027, clock='cpu')
    result = study.run(budget=660, rounds=10)
    result.write(os.path.join(os.path.dirname(os.path.abspath(__file__)), 'results_second'), ['potential_energy:0.5%'])
