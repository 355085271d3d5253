"""A function of many arguments, several at a time, in processes or on a cluster.

The cluster is a dask.distributed cluster. The module is for tools that have their own tasks;
:class:`openmmrigidhi.ensemble.Study` uses it.
"""
# It lies outside of this package because openmmrigidhi.accuracy, which this package imports, needs
# it too.
from .._tasks import Failure, Job, Outcome, TaskError, run  # noqa: F401

__all__ = ['run', 'Job', 'Outcome', 'Failure', 'TaskError']
