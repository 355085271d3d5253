#!/usr/bin/python3
"""Force coupling on a grid: errors of products against the time that they take.

Errors are listed by tolerance and by spacing, for a random suspension in a periodic box.

    python3 run.py            # three minutes; one process, since times are measured: grids take
    turns
    python3 run.py --quick    # 60 spheres, seconds
"""
import argparse
import pathlib
import sys

from openmmrigidhi import accuracy
from tqdm import tqdm

HERE = pathlib.Path(__file__).resolve().parent
sys.path.append(str(HERE.parents[1]/'common'))
import campaign  # noqa: E402

RESULTS = HERE/'results'
#: Wishes that are drawn as lines and answered.
WANTED = ['forces:1e-4', 'forces:1e-8', 'wrenches:1e-4', 'forces:1e-3,wrenches:1e-3']


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--quick', action='store_true', help='60 spheres instead of 500')
    parser.add_argument('--rounds', type=int, default=30)
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    arguments = parser.parse_args()
    study = accuracy.GridStudy(
        accuracy.scenes.periodicSuspension(60 if arguments.quick else 500, 0.1))
    with tqdm() as bar:

        def show(done, total, text):
            bar.total = total
            bar.set_description(text, refresh=False)
            bar.update(done - bar.n)

        result = study.run(arguments.rounds, show)
    report = result.report(WANTED)
    report.write(str(arguments.output))
    campaign.keepPictures(arguments.output, 'grid_forces.png')
    print(report.textTable())
    for text in report.paragraphs():
        print('\n' + text)


if __name__ == '__main__':
    main()
