#!/usr/bin/python3
"""The hydrodynamic ladder: errors of the models, and what a step with each model costs.

The scenes are two spheres over a range of gaps, a suspension, and periodic boxes.

    python3 run.py            # three to five minutes, nearly all for shells of 162 and 642 blobs
    python3 run.py --quick    # without these shells
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
RUNGS = ('FreeDraining', 'RPY', 'ForceCoupling', 'FTS', 'multiblob12', 'multiblob42',
         'multiblob162', 'multiblob642', 'FTS+lubrication')
GENERAL = ('mobility', 'sedimentation', 'relative_mobility', 'rotation_translation', 'worst_wrench')
#: Wishes that are drawn as lines and answered.
WANTED = {
    'pairs': [
        'mobility:5%', 'sedimentation:1%', 'rotation_translation:5%', 'relative_mobility:10%'
    ],
    'suspension': ['mobility:5%', 'mobility:1%', 'sedimentation:1%', 'own_forces:0.1%'],
    'arrays': ['drag:10%', 'rotational_drag:10%'],
    'periodic': ['mobility:5%', 'sedimentation:1%']
}
OBSERVABLES = {
    'pairs': GENERAL,
    'suspension': ('own_forces', *GENERAL),
    'arrays': None,
    'periodic': GENERAL
}
#: Pictures that pages show.
PICTURES = {
    'pairs': ('ladder_mobility.png', 'ladder_relative_mobility.png'),
    'suspension': ('ladder_sedimentation.png',),
    'arrays': ('ladder_drag.png',),
    'periodic': ('ladder_sedimentation.png',)
}
#: Shells whose matrices would take hours to compute.
TOO_LARGE = {'suspension': ('multiblob642',), 'periodic': ('multiblob642',)}


def scenes():
    return {
        'pairs': accuracy.scenes.pairs((0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10)),
        'suspension': accuracy.scenes.suspension(12, 0.15),
        'arrays': accuracy.scenes.arrays(),
        'periodic': accuracy.scenes.periodicSuspension(8, 0.15)
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--quick', action='store_true',
                        help='leave out shells of 162 and 642 blobs')
    parser.add_argument('--rounds', type=int, default=20)
    parser.add_argument('--only', choices=tuple(WANTED))
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    campaign.addPlaces(parser)
    arguments = parser.parse_args()
    for name, scene in scenes().items():
        if arguments.only not in (None, name):
            continue
        rungs = [
            rung for rung in RUNGS
            if not (arguments.quick and rung in ('multiblob162', 'multiblob642'))
            and rung not in TOO_LARGE.get(name, ()) and not (rung == 'ForceCoupling' and name in
                                                             ('pairs', 'suspension'))
        ]
        study = accuracy.LadderStudy(scene, rungs, OBSERVABLES[name])
        with tqdm(desc=name) as bar:

            def show(done, total, text):
                bar.total = total
                bar.set_description(f'{name}: {text}', refresh=False)
                bar.update(done - bar.n)

            result = study.run(arguments.rounds, 0.01, show, arguments.jobs, arguments.cluster)
        result.write(str(arguments.output/name), WANTED[name])
        campaign.keepPictures(arguments.output/name, *PICTURES[name])
        print(accuracy.ladderreport.textTable(result))
        for item in WANTED[name]:
            print(result.recommend(item))
            if result.parameter:
                print('   ',
                      result.goodUpTo(item) if result.isHarderUpwards else result.goodDownTo(item))
        print(result.referenceText())


if __name__ == '__main__':
    main()
