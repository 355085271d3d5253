#!/usr/bin/python3
"""Force coupling on a grid: errors of products against the time that they take.

Errors are listed by tolerance and by spacing, for a random suspension in a periodic box.

    python3 run.py            # three minutes
    python3 run.py --quick    # 60 spheres, seconds

Times are measured, so grids take turns in one run; --jobs and --cluster say where it is made.
"""
import argparse
import pathlib
import sys

from openmmrigidhi import accuracy
from openmmrigidhi.ensemble import tasks

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]/'common'))
import campaign  # noqa: E402

HERE = pathlib.Path(__file__).resolve().parent
RESULTS = HERE/'results'
#: Wishes that are drawn as lines and answered.
WANTED = ['forces:1e-4', 'forces:1e-8', 'wrenches:1e-4', 'forces:1e-3,wrenches:1e-3']


def measure(argument, job):
    """The result of the study of a number of spheres in a number of rounds."""
    spheres, rounds = argument
    study = accuracy.GridStudy(accuracy.scenes.periodicSuspension(spheres, 0.1))
    return study.run(rounds, lambda done, total, text: job.report(done/total))


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--quick', action='store_true', help='60 spheres instead of 500')
    parser.add_argument('--rounds', type=int, default=30)
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    campaign.addPlaces(parser)
    arguments = parser.parse_args()
    result = tasks.run(measure, [(60 if arguments.quick else 500, arguments.rounds)],
                       arguments.jobs, arguments.cluster, amounts=[1.0], unit='study')[0].get()
    report = result.report(WANTED)
    report.write(str(arguments.output))
    campaign.keepPictures(arguments.output, 'grid_forces.png')
    print(report.textTable())
    for text in report.paragraphs():
        print('\n' + text)


if __name__ == '__main__':
    main()
