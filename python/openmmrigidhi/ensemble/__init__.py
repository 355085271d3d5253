"""Many runs: independent replicas and sweeps of parameters.

They run in processes or on the machines of a dask.distributed cluster.

From the shell, ``python3 -m openmmrigidhi.ensemble --help``; from Python::

    from openmmrigidhi import ensemble
    study = ensemble.Study('trap', ensemble.sweep(temperature=[280, 300, 320]), replicas=4,
                           length=100, observables=['energy_group_0'])
    result = study.run('my_study', jobs=4)
    print(result.table())

The directory keeps everything: run() continues after an interruption, and
``Study.load('my_study').extended(length=200)`` makes the study longer.
"""
from typing import TYPE_CHECKING

from .._lazy import lazy

if TYPE_CHECKING:
    from . import tasks
    from .result import EnsembleResult, TaskRecord
    from .study import Study, read, sweep, taskSeed
else:
    __getattr__, __dir__ = lazy(__name__, {
        'result': ['EnsembleResult', 'TaskRecord'],
        'study': ['Study', 'read', 'sweep', 'taskSeed']
    })

__all__ = ['Study', 'EnsembleResult', 'TaskRecord', 'read', 'sweep', 'taskSeed', 'tasks']
