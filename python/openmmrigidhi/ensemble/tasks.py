"""A function of many arguments, several at a time: here, in processes, or on a cluster of dask.distributed.

For tools that have tasks of their own; :class:`openmmrigidhi.ensemble.Study` is made of it.
"""
# It lies outside of this package, which imports openmmrigidhi.accuracy, because that needs it too.
from .._tasks import Failure, Job, Outcome, TaskError, run  # noqa: F401

__all__ = ['run', 'Job', 'Outcome', 'Failure', 'TaskError']
