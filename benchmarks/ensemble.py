#!/usr/bin/python3
"""The overhead of openmmrigidhi.ensemble, and the gain of two workers over one.

Overhead: tasks of half a minute run one after the other on one worker. The time from the beginning
of the first task to the end of the last is divided by the time of their steps and samples, which
the files of the tasks record. Checkpoints count as overhead. Starting the workers does not count;
its time is given separately. Scaling: as many tasks on two workers, in turns with one. Both are
measured by the clock, so the machine must be quiet. The JSON has its load.

    PYTHONPATH=build/python /usr/bin/python3 benchmarks/ensemble.py
"""
import argparse
import json
import pathlib
import tempfile
import time

import numpy as np

from openmmrigidhi import ensemble

from common import RESULTS, describeMachine, save

OBSERVABLES = ['potential_energy', 'translational_temperature', 'rotational_temperature_1']
#: Length, ps, of a first task, whose speed sets the length of the others.
TRIAL = 20.0


def study(length, tasks, checkpoint):
    """Bodies in a trap on the Reference platform: steps, samples, checkpoints.

    The Reference platform is chosen because the CPU platform computes in a thread of its own, even
    with one thread. On the CPU platform a worker alone wakes one processor from another at every
    step, while two workers stay on theirs. Two workers then seem three times as fast as one.
    """
    return ensemble.Study('trap', [{
        'bodies': 400,
        'stepSize': 0.002
    }], tasks, length, OBSERVABLES, platform='Reference', equilibration=0.0,
                          checkpointInterval=checkpoint)


def work(result):
    """Seconds of steps and samples of each task."""
    import h5py
    seconds = []
    for task in result.tasks:
        with h5py.File(task.path, 'r') as file:
            sessions = json.loads(file['about'][()].tobytes())['sessions']
        seconds.append(sum(each['seconds'] + each['seconds_sampling'] for each in sessions))
    return np.array(seconds)


def run(length, tasks, jobs, cluster, checkpoint):
    """One study: when the first task began, the work of each task, and when each task ended.

    All are in seconds. Tasks are in the order of their ends.
    """
    ends = []
    with tempfile.TemporaryDirectory() as folder:
        began = time.time()
        result = study(length, tasks, checkpoint).run(
            folder, jobs, cluster, quiet=False, finished=lambda task: ends.append(
                (time.time(), task.replica)))
        assert result.isComplete
        seconds = work(result)
        ends = sorted(ends)
        # The first task to end has done its own work before.
        return {
            'begun': ends[0][0] - began - seconds[ends[0][1]],
            'work': [seconds[replica] for _, replica in ends],
            'ends': [end - began for end, _ in ends]
        }


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--seconds', type=float, default=30, help='length of a task (30)')
    parser.add_argument('--tasks', type=int, default=4,
                        help='tasks of each study, an even number (4)')
    parser.add_argument('--checkpoint', type=float, default=10,
                        help='seconds between checkpoints (10; the default of studies is 60)')
    parser.add_argument('--clusters', nargs='+', default=['processes', 'local'])
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    options = parser.parse_args()
    machine = describeMachine()
    trial = run(TRIAL, 1, 1, 'processes', 1e9)
    length = round(TRIAL*options.seconds/trial['work'][0]/0.05)*0.05
    found = {}
    for cluster in options.clusters:
        one = run(length, options.tasks, 1, cluster, options.checkpoint)
        two = run(length, options.tasks, 2, cluster, options.checkpoint)
        # From the end of the first task to the end of the last task: the work of all tasks but one,
        # and all that happens between tasks.
        between = one['ends'][-1] - one['ends'][0]
        overhead = between/sum(one['work'][1:]) - 1
        scaling = (one['ends'][-1] - one['begun'])/(two['ends'][-1] - two['begun'])
        found[cluster] = {
            'length_ps': length,
            'tasks': options.tasks,
            'checkpoint_interval_s': options.checkpoint,
            'one_worker': one,
            'two_workers': two,
            'overhead': round(overhead, 5),
            'seconds_before_the_first_task': round(one['begun'], 2),
            'scaling_of_two_workers': round(scaling, 3)
        }
        print(f'{cluster}: overhead {100*overhead:.2f} % of tasks of {np.mean(one["work"]):.1f} s; '
              f'{one["begun"]:.1f} s before the first; two workers {scaling:.2f} times as fast')
        save(options.output, 'ensemble.json', machine, {'clusters': found})


if __name__ == '__main__':
    main()
