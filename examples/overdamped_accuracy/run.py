#!/usr/bin/python3
"""Which road to the overdamped limit is cheapest: bias of averages against speed, for one boomerang above a wall and for 16 that interact.

    python3 run.py                      # 35 minutes
    python3 run.py --only boomerang --budget 120
"""
import argparse
import pathlib

from openmmrigidhi.accuracy import overdamped
from tqdm import tqdm

RESULTS = pathlib.Path(__file__).parent/'results'
#: Steps without momenta and with, in tau_D. Beyond these runs are unstable.
STEPS = {'boomerang': ((0.025, 0.05, 0.1, 0.2), (0.05, 0.1, 0.2, 0.5)), 'suspension': ((0.025, 0.05, 0.1), (0.05, 0.1, 0.2))}
#: Drawn as lines, and answered.
WANTED = ['height:2%', 'cos2:2%', 'repulsion:2%', 'repulsion:5%', 'msd:5%', 'height:2%,cos2:2%,repulsion:5%,msd:5%']
BASELINE = 'TrapezoidalSlip'


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--only', choices=tuple(STEPS))
    parser.add_argument('--budget', type=float, default=1000, help='seconds for each scene')
    parser.add_argument('--sweeps', type=int, default=30000, help='of Monte Carlo, for 16 boomerangs')
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    arguments = parser.parse_args()
    for name, (without, inertial) in STEPS.items():
        if arguments.only not in (None, name):
            continue
        scene = overdamped.boomerang() if name == 'boomerang' else overdamped.suspension(sweeps=arguments.sweeps)
        study = overdamped.OverdampedStudy(scene, stepSizes={method: inertial if method in overdamped.INERTIA else without
                                                             for method in overdamped.METHODS}, clock='cpu')
        with tqdm(desc=name) as bar:
            def show(done, total, text):
                bar.total = total
                bar.set_description(f'{name}: {text}', refresh=False)
                bar.update(done - bar.n)
            result = study.run(arguments.budget, equilibration=30*scene.timeUnit, progress=show)
        result.write(str(arguments.output/name), WANTED, BASELINE)
        for item in WANTED:
            print(result.recommend(item))


if __name__ == '__main__':
    main()
