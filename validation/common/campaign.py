"""The runs of a script by openmmrigidhi.ensemble.tasks: command-line options, and saved runs.

Every run has a directory of its own below --work. A finished run leaves its result there, an
unfinished run its state. The same command thus continues where it was interrupted, here or on
another worker.
"""
import argparse
import json
import os
import pathlib
import re
import shutil
import sys
import time

import numpy as np

from openmmrigidhi.ensemble import tasks

#: Seconds between two saves of a run.
NOTES_EVERY = 60.0


def addPlaces(parser):
    """Add --jobs and --cluster, which say where the runs are made."""
    group = parser.add_argument_group('who makes the runs')
    group.add_argument('--jobs', type=int, default=1,
                       help='runs at a time, in processes of this machine (%(default)s)')
    group.add_argument(
        '--cluster', metavar='ADDRESS',
        help='a scheduler of dask.distributed whose workers make the runs (docs/ensembles.md)')
    return group


def parser(description, quick):
    """A parser with --output and --quick; quick says what the shortened run has."""
    made = argparse.ArgumentParser(description=description,
                                   formatter_class=argparse.RawDescriptionHelpFormatter)
    made.add_argument('--output', type=pathlib.Path, default=pathlib.Path('results'),
                      help='folder of the JSON (results)')
    made.add_argument('--quick', action='store_true', help=quick)
    return made


def addOptions(parser):
    """Add --jobs, --cluster, --work and --fresh; after parsing call settle()."""
    group = addPlaces(parser)
    group.add_argument(
        '--work', type=pathlib.Path,
        help='where runs save what they need to go on (the folder work in that of --output)')
    group.add_argument('--fresh', action='store_true',
                       help='begin all runs anew instead of going on from what is in --work')


def settle(args):
    """Give --work its default, make it absolute for workers elsewhere; return the arguments."""
    args.work = (args.work or args.output/'work').resolve()
    return args


def directoryName(name):
    """The name of the directory of a run with this name."""
    return re.sub(r'[^\w.+=-]+', '_', name)


def run(function, arguments, names, args, amounts=None, unit='run', title='', finished=None,
        given=None):
    """What function(argument, job) returns for each argument, as JSON has it.

    Results are made of numbers, lists, and dictionaries with str keys. A result that is already in
    the run's directory, of an equal argument, is taken from there.

    Parameters
    ----------
    function : callable
        of (argument, Job); both must be what pickle takes
    arguments : sequence
        what JSON takes, or functions, which are known by their names, or objects whose repr() says
        all that the result depends on
    names : sequence of str
        names of the runs
    args : argparse.Namespace
        with what addOptions() adds
    amounts : sequence of float, optional
        see tasks.run()
    finished : callable, optional
        called with the index of a run and its result, as runs finish
    given : object, optional
        what all runs need in addition, e.g. an equilibrated scene: the third argument of the
        function; the result depends on it as on the script itself

    Raises
    ------
    SystemExit
        at the end, if runs failed; the results of the other runs are saved
    """
    arguments, names = list(arguments), [directoryName(name) for name in names]

    if args.fresh:
        for name in names:
            shutil.rmtree(args.work/name, ignore_errors=True)

    def end(outcome):
        if outcome.failure is None and finished is not None:
            finished(outcome.index, outcome.value)

    outcomes = tasks.run(_perform, [(function, argument, given) for argument in arguments],
                         args.jobs, args.cluster, names=names, directory=str(args.work),
                         amounts=amounts, unit=unit, title=title, finished=end,
                         quiet=getattr(args, 'silent', False) or getattr(args, 'quick', False))
    failed = [outcome for outcome in outcomes if outcome.failure is not None]
    for outcome in failed:
        print(f'{outcome.name}: {outcome.failure.message}\n{outcome.failure.traceback}',
              file=sys.stderr)
    if failed:
        raise SystemExit(f'{len(failed)} of {len(outcomes)} runs failed '
                         f'({", ".join(outcome.name for outcome in failed)}); the others are kept: '
                         'the same command goes on with these')
    return [outcome.value for outcome in outcomes]


def _perform(task, job):
    """The result of one run: the saved result, or a new one."""
    function, argument, given = task
    path, settings = os.path.join(job.directory,
                                  'result.json'), json.loads(json.dumps(asJson(argument)))
    if os.path.exists(path):
        with open(path) as file:
            kept = json.load(file)
        if kept['settings'] == settings:
            return kept['result']
    text = json.dumps({
        'settings': settings,
        'result': asJson(
            function(argument, job) if given is None else function(argument, job, given))
    })
    with open(path + '.part', 'w') as file:
        file.write(text)
    os.replace(path + '.part', path)
    return json.loads(text)['result']


def keepPictures(folder, *names):
    """Remove all pictures of a report but those that pages show; the report's HTML page has all."""
    for path in pathlib.Path(folder).glob('*.png'):
        if path.name not in names:
            path.unlink()


def asJson(value):
    """Arrays as lists, with all digits."""
    if isinstance(value, dict):
        return {str(k): asJson(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [asJson(v) for v in value]
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    return value.__qualname__ if callable(value) else repr(value)


class State:
    """Arrays from which a run goes on, in one file of its directory that is replaced as a whole.

    Parameters
    ----------
    place : tasks.Job, pathlib.Path or None
        the directory, or what has it; None: nothing is saved
    settings : object
        whose repr() must be the same for a run to go on; the length of the run is no part of it
    """
    def __init__(self, place, settings):
        directory = getattr(place, 'directory', place)
        self.path = None if directory is None else pathlib.Path(directory)/'state.npz'
        self.settings, self.noted = repr(settings), time.monotonic()

    def load(self):
        """The saved arrays, name -> array; empty if nothing was saved.

        Raises
        ------
        ValueError
            if it belongs to other settings
        """
        if self.path is None or not self.path.exists():
            return {}
        with np.load(self.path) as file:
            found = dict(file)
        if str(found.pop('settings')) != self.settings:
            raise ValueError(
                f'{self.path}: this run was begun with other settings than those asked for; it '
                'cannot go on with these: give another --work, or --fresh to begin all anew')
        return found

    def isDue(self):
        """Whether the last save is long enough ago for another one."""
        return self.path is not None and time.monotonic() - self.noted > NOTES_EVERY

    def save(self, **arrays):
        if self.path is None:
            return
        self.path.parent.mkdir(parents=True, exist_ok=True)
        part = self.path.with_name('part.npz')
        np.savez_compressed(part, settings=self.settings, **arrays)
        part.replace(self.path)
        self.noted = time.monotonic()


def checkpoint(context):
    """A Context's checkpoint as an array."""
    return np.frombuffer(context.createCheckpoint(), dtype=np.uint8)
