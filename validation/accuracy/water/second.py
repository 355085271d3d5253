"""A second run around the steps that decide, with another seed, and with a further friction.

The further friction is 1/ps for LangevinMiddle. The script is also an example of a user's own
method. It writes results_second/. With --jobs or --cluster several runs are made at a time, and
speeds are measured afterwards.
"""
import argparse
import pathlib
import sys

import openmm

from openmmrigidhi import accuracy

HERE = pathlib.Path(__file__).resolve().parent
sys.path.append(str(HERE.parents[1]/'common'))
import campaign  # noqa: E402


def weaklyCoupled(scene, stepSize, seed):
    """LangevinMiddle with a friction of 1/ps instead of the scene's."""
    integrator = openmm.LangevinMiddleIntegrator(scene.temperature, 1.0, stepSize)
    integrator.setRandomNumberSeed(seed)
    return integrator


if __name__ == '__main__':
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--output', type=pathlib.Path, default=HERE/'results_second')
    campaign.addPlaces(parser)
    options = parser.parse_args()
    study = accuracy.StepSizeStudy(
        accuracy.scenes.water(216, seed=2026, threads=1),
        ['LangevinC', 'LangevinMiddle',
         accuracy.Method('LangevinMiddle, 1/ps', weaklyCoupled)], {
             'LangevinC': [0.009, 0.0095],
             'LangevinMiddle': [0.007, 0.0075, 0.008],
             'LangevinMiddle, 1/ps': [0.006, 0.007]
         }, references={'potential_energy': (-46.498, 0.042)
                        },  # the limit of small steps of results/results.json
        seed=2027, clock='cpu')
    result = study.run(budget=660, rounds=10, jobs=options.jobs, cluster=options.cluster)
    result.write(str(options.output), ['potential_energy:0.5%'])
    campaign.keepPictures(options.output)
