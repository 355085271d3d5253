"""What the tests of ensembles share, and studies for them."""
import time

import numpy as np
import pytest

from openmmrigidhi import ensemble

try:
    import distributed
except ImportError:
    distributed = None

#: The ways to compute: plain processes, and two workers behind a scheduler.
CLUSTERS = ['processes', *(['scheduler'] if distributed else [])]
needsDask = pytest.mark.skipif(distributed is None, reason='dask.distributed is not installed')
SCENE = 'ensemble_tasks:scene'


def small(observables=('ensemble_tasks:energy',), length=3.0, replicas=3, **kwargs):
    kwargs.setdefault('settings', ({},))
    return ensemble.Study(SCENE, replicas=replicas, length=length, observables=observables,
                          platform='Reference', checkpointInterval=0.0, equilibration=0.5, **kwargs)


def samples(result):
    """All series by setting and replica, for any name of the observable."""
    return {(task.setting, task.replica): result.series(next(iter(result.observables)),
                                                        task.setting, task.replica)
            for task in result.tasks}


def same(one, other):
    return one.keys() == other.keys() and all(np.array_equal(one[key], other[key]) for key in one)


def waitFor(condition, seconds=60):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, 'it did not happen'
        time.sleep(0.05)
