"""Fixtures of the tests of ensembles, which name this module in `pytest_plugins`."""
import contextlib
import os
import time

import pytest

import ensemble_tasks
from ensemble_support import distributed, samples, small


@pytest.fixture(scope='module')
def folderOfMarks(tmp_path_factory):
    """Where tasks in other processes leave marks."""
    folder = tmp_path_factory.mktemp('marks')
    before = os.environ.get(ensemble_tasks.MARKS)
    os.environ[ensemble_tasks.MARKS] = str(folder)
    yield folder
    del os.environ[ensemble_tasks.MARKS]
    if before is not None:
        os.environ[ensemble_tasks.MARKS] = before


@pytest.fixture
def marks(folderOfMarks):
    """The directory of marks, emptied for each test."""
    for path in folderOfMarks.iterdir():
        path.unlink()
    return folderOfMarks


@pytest.fixture(scope='module')
def clusters(folderOfMarks):
    """The clusters that were made. The last one is in use."""
    if distributed is None:
        pytest.skip('dask.distributed is not installed')
    import dask
    # A LocalCluster closes a worker for good that is not there 15 s after it died, so also one that
    # came back, died again, and is starting. Workers of a scheduler elsewhere stay.
    with contextlib.ExitStack() as made, dask.config.set(
        {'distributed.deploy.lost-worker-timeout': '1 hour'}):
        yield made, []


@pytest.fixture
def cluster(clusters):
    """Two workers behind a scheduler that has an address.

    Tests kill workers. If the workers do not come back, because one was killed while it started,
    the next test gets another cluster.
    """
    made, last = clusters
    deadline = time.monotonic() + 5
    while last and len(last[-1].scheduler.workers) < 2 and time.monotonic() < deadline:
        time.sleep(0.1)
    if not last or len(last[-1].scheduler.workers) < 2:
        last.append(
            made.enter_context(
                distributed.LocalCluster(n_workers=2, threads_per_worker=1,
                                         dashboard_address='127.0.0.1:0', memory_limit=0,
                                         silence_logs=50)))
    return last[-1]


@pytest.fixture
def where(request):
    """The argument `cluster` of run()."""
    return request.getfixturevalue(
        'cluster').scheduler_address if request.param == 'scheduler' else request.param


@pytest.fixture(scope='module')
def undisturbed(tmp_path_factory):
    """The result of three replicas, one after the other in this process, without checkpoints in
    between."""
    study = small()
    study.checkpointInterval = 1e9
    result = study.run(str(tmp_path_factory.mktemp('undisturbed')), quiet=True)
    assert result.isComplete and [len(each) for each in samples(result).values()] == [60, 60, 60]
    return result
