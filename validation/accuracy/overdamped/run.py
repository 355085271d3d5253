#!/usr/bin/python3
"""Which method reaches the overdamped limit at least cost: bias of averages against speed.

The scenes are one boomerang above a wall, and 16 boomerangs that interact.

    python3 run.py                      # 20 minutes
    python3 run.py --only boomerang --budget 120
"""
import argparse
import pathlib
import sys

from openmmrigidhi.accuracy import overdamped
from tqdm import tqdm

HERE = pathlib.Path(__file__).resolve().parent
sys.path.append(str(HERE.parents[1]/'common'))
import campaign  # noqa: E402

RESULTS = HERE/'results'
#: Time steps in units of tau_D: of the schemes without momenta, then of the LangevinHI methods. The
#: longest steps are at the edge of stability.
STEPS = {
    'boomerang': ((0.1, 0.2), {
        'LangevinHI(0.3)': (0.1, 0.2, 0.5),
        'LangevinHI(1)': (0.05, 0.1, 0.2),
        'LangevinHI(3)': (0.05, 0.1)
    }),
    'suspension': ((0.05, 0.1), {
        'LangevinHI(0.3)': (0.05, 0.1, 0.2),
        'LangevinHI(1)': (0.05, 0.1),
        'LangevinHI(3)': (0.05,)
    })
}
#: Wishes that are drawn as lines and answered.
WANTED = [
    'height:2%', 'cos2:2%', 'repulsion:2%', 'repulsion:5%', 'msd:5%',
    'height:2%,cos2:2%,repulsion:5%,msd:5%'
]
BASELINE = 'TrapezoidalSlip'


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--only', choices=tuple(STEPS))
    parser.add_argument('--budget', type=float, default=480, help='seconds for each scene')
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    campaign.addPlaces(parser)
    arguments = parser.parse_args()
    for name, (without, inertial) in STEPS.items():
        if arguments.only not in (None, name):
            continue
        scene = overdamped.SCENES[name]()
        # For 16 bodies, 98 square roots in a step of DriftCorrectorFD would take most of the time.
        methods = [
            method for method in overdamped.METHODS
            if name == 'boomerang' or method != 'DriftCorrectorFD'
        ]
        study = overdamped.OverdampedStudy(
            scene, methods, {method: inertial.get(method, without)
                             for method in methods}, clock='cpu')
        with tqdm(desc=name) as bar:

            def show(done, total, text):
                bar.total = total
                bar.set_description(f'{name}: {text}', refresh=False)
                bar.update(done - bar.n)

            result = study.run(arguments.budget, equilibration=10*scene.timeUnit,
                               jobs=arguments.jobs, progress=show, cluster=arguments.cluster)
        result.write(str(arguments.output/name), WANTED, BASELINE)
        campaign.keepPictures(arguments.output/name, 'error_repulsion.png', 'error_msd.png')
        for item in WANTED:
            print(result.recommend(item))


if __name__ == '__main__':
    main()
