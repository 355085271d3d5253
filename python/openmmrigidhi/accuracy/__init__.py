"""What accuracy costs, measured on this machine: error of chosen observables against ns/day.

From the shell, ``python3 -m openmmrigidhi.accuracy --help``; from Python::

    from openmmrigidhi import accuracy
    scene = accuracy.scenes.water(216)
    result = accuracy.StepSizeStudy(scene, ['LangevinC', 'LangevinMiddle'], [0.002, 0.004, 0.006, 0.008]).run(budget=1200)
    print(result.recommend('potential_energy:0.5%'))
    result.write('accuracy', wanted=['potential_energy:0.5%'])
"""
from . import methods, observables, scenes, statistics
from .methods import Method
from .observables import Observable
from .result import Recommendation, Reference, StudyResult
from .scenes import Scene
from .study import Knob, Setting, StepSizeStudy, Study

__all__ = ['StepSizeStudy', 'StudyResult', 'Recommendation', 'Reference', 'Scene', 'Method', 'Observable', 'Study', 'Knob',
           'Setting', 'scenes', 'methods', 'observables', 'statistics']
