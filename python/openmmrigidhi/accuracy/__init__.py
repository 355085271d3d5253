"""The cost of accuracy, measured on this machine: errors of chosen observables against ns/day.

From the shell, ``python3 -m openmmrigidhi.accuracy --help``; from Python::

    from openmmrigidhi import accuracy
    scene = accuracy.scenes.water(216)
    study = accuracy.StepSizeStudy(scene, ['LangevinC', 'LangevinMiddle'],
                                   [0.002, 0.004, 0.006, 0.008])
    result = study.run(budget=1200)
    print(result.recommend('potential_energy:0.5%'))
    result.write('accuracy', wanted=['potential_energy:0.5%'])

The same for models of the fluid::

    result = accuracy.LadderStudy(scene).run()
    print(result.recommend('mobility:1%'))

Schemes without momenta, and LangevinHI at high friction, for bodies above a wall::

    result = accuracy.OverdampedStudy(accuracy.overdamped.boomerang()).run(budget=1200)
    print(result.recommend('height:2%'))

Grids of a periodic fluid::

    result = accuracy.GridStudy().run()
    print(result.recommend('forces:1e-4'))
"""
from typing import TYPE_CHECKING

from .._lazy import lazy

if TYPE_CHECKING:
    from . import methods, mobilities, observables, overdamped, rungs, scenes, statistics
    from .grid import GridStudy
    from .gridresult import GridResult
    from .ladder import LadderStudy
    from .ladderresult import LadderResult
    from .methods import Method
    from .mobilities import MobilityObservable
    from .observables import Observable
    from .overdamped import OverdampedStudy, WallScene
    from .result import Recommendation, Reference, StudyResult
    from .rungs import Rung
    from .scenes import Scene
    from .study import Knob, Setting, StepSizeStudy, Study
else:
    __getattr__, __dir__ = lazy(
        __name__, {
            'grid': ['GridStudy'],
            'gridresult': ['GridResult'],
            'ladder': ['LadderStudy'],
            'ladderresult': ['LadderResult'],
            'methods': ['Method'],
            'mobilities': ['MobilityObservable'],
            'observables': ['Observable'],
            'overdamped': ['OverdampedStudy', 'WallScene'],
            'result': ['Recommendation', 'Reference', 'StudyResult'],
            'rungs': ['Rung'],
            'scenes': ['Scene'],
            'study': ['Knob', 'Setting', 'StepSizeStudy', 'Study']
        })

__all__ = [
    'StepSizeStudy', 'StudyResult', 'Recommendation', 'Reference', 'Scene', 'Method', 'Observable',
    'Study', 'Knob', 'Setting', 'LadderStudy', 'LadderResult', 'Rung', 'MobilityObservable',
    'scenes', 'methods', 'observables', 'mobilities', 'rungs', 'statistics', 'OverdampedStudy',
    'WallScene', 'overdamped', 'GridStudy', 'GridResult'
]
