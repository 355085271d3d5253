"""The command line: python3 -m openmmrigidhi.ensemble."""
from __future__ import annotations

import argparse
import contextlib
import json
import signal
import sys
import threading
from typing import Optional

import openmm
from tqdm import tqdm

from .. import _tasks, _units
from ..accuracy import observables, overdamped
from .simulation import BUILT_IN
from .study import Study, read, sweep

DESCRIPTION = '''Run independent replicas of a scene, for each of several settings, in processes or
on a cluster of dask.distributed. The directory keeps everything. A study that was interrupted goes
on with --resume, and grows with --extend (docs/ensembles.md).'''

EPILOG = '''examples:
  python3 -m openmmrigidhi.ensemble my_study --scene trap --sweep temperature=280,300,320 \\
      --replicas 4 --length 100 --jobs 4
  python3 -m openmmrigidhi.ensemble my_study --scene mymodule:makeScene --set pressure=1 \\
      --sweep size=3,4 --length 500 --cluster tcp://host:8786
  python3 -m openmmrigidhi.ensemble my_study --resume --jobs 4
  python3 -m openmmrigidhi.ensemble my_study --extend --length 200 --replicas 8
  python3 -m openmmrigidhi.ensemble my_study --show

The exit status is 0 if all tasks are complete, 1 if some failed or are not finished, 2 if nothing
could be run. Ctrl-C and SIGTERM end the run; what was saved stays, and --resume goes on from it.'''

#: What describes a new study, with the values where they are not given. A study that is there keeps
#: its own.
OF_NEW_STUDIES = {
    'scene': None,
    'equilibration': None,
    'interval': None,
    'observables': list(observables.DEFAULT),
    'seed': 1,
    'platform': 'CPU',
    'threads': 1
}
#: What an extension may give.
OF_EXTENSIONS = ('set', 'sweep', 'replicas', 'length')


def parser() -> argparse.ArgumentParser:
    """The argument parser."""
    result = argparse.ArgumentParser(prog='python3 -m openmmrigidhi.ensemble',
                                     description=DESCRIPTION, epilog=EPILOG,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    result.add_argument('directory', help='of the study')
    result.add_argument('--resume', action='store_true', help='go on with the study that is there')
    result.add_argument(
        '--extend', action='store_true',
        help='make the study that is there longer (--length), or give it more --replicas or '
        'settings (--sweep, --set)')
    result.add_argument('--show', action='store_true', help='compute nothing: print what there is')
    what = result.add_argument_group('what is run')
    what.add_argument(
        '--scene', help=f'{", ".join(BUILT_IN)}, or module:function; the function gets the values '
        f'of --set and --sweep as parameters')
    what.add_argument(
        '--set', nargs='+', action='extend', metavar='NAME=VALUE',
        help='parameters of the scene; scheme and stepSize (ps) of its integrator; a wrong name '
        'prints those that there are')
    what.add_argument('--sweep', nargs='+', action='extend', metavar='NAME=VALUE,VALUE',
                      help='values of parameters, in all combinations')
    what.add_argument('--replicas', type=int, help='of each setting (4)')
    what.add_argument('--length', type=_time, metavar='TIME',
                      help='time that each replica samples: ps, or with a unit, as 5ns, 20us, 1s')
    what.add_argument('--equilibration', type=_time, metavar='TIME',
                      help='time before (the scene\'s, or a tenth of the length)')
    what.add_argument('--interval', type=_time, metavar='TIME',
                      help='time between samples (the scene\'s)')
    what.add_argument(
        '--observables', nargs='+', metavar='NAME',
        help=f'among {", ".join(observables.BUILT_IN)}, energy_group_N, msd_TIME, '
        'lateral_msd_TIME, diffusion_coefficient_TIME, lateral_diffusion_coefficient_TIME, '
        'height[LOW,HIGH] (ps and nm, or with units, as msd_5ns, height[1um,2um]), of boomerangs '
        f'{", ".join(overdamped.OBSERVABLES)}, or module:function of the Context '
        f'({", ".join(observables.DEFAULT)})')
    what.add_argument('--seed', type=int, help='from which the seeds of all tasks follow (1)')
    what.add_argument('--platform', help='of OpenMM (CPU)')
    what.add_argument('--threads', type=int, help='of the CPU platform, in each task (1)')
    how = result.add_argument_group('who computes')
    how.add_argument('--jobs', type=int, default=1, help='tasks at the same time (1)')
    how.add_argument(
        '--cluster', metavar='ADDRESS',
        help='a scheduler of dask.distributed, e.g. tcp://host:8786; local: workers on this '
        'machine, the default with --jobs above 1 where dask.distributed is installed; processes: '
        'plain processes')
    how.add_argument(
        '--retries', type=int, default=_tasks.RETRIES,
        help='how many times in a row a task whose worker died without progress is '
        f'tried again ({_tasks.RETRIES})')
    how.add_argument('--timeout', type=float, default=60, help='seconds to wait for a cluster (60)')
    how.add_argument('--checkpoint', type=float, default=60, metavar='SECONDS',
                     help='between two savings of a task (60)')
    how.add_argument('--quiet', action='store_true', help='no progress bar')
    return result


def main(arguments: Optional[list[str]] = None) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments : list of str, optional
        default: sys.argv

    Returns
    -------
    int
        exit status: 0; 1 if tasks failed or are not finished; 2 for wrong arguments, or an unusable
        cluster
    """
    options = parser().parse_args(arguments)
    try:
        _check_that_given_options_are_used(options)
        with _termination_as_ctrl_c():
            result = read(options.directory) if options.show else _run(options)
    except (ValueError, TypeError, OSError, ImportError, RuntimeError,
            openmm.OpenMMException) as error:
        print(f'error: {error}', file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print('error: the run was interrupted before it began', file=sys.stderr)
        return 2
    print(result.table())
    return 0 if result.isComplete else 1


@contextlib.contextmanager
def _termination_as_ctrl_c():
    """Batch systems end programs with SIGTERM; it ends a study as Ctrl-C does."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def interrupt(number, frame):
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _check_that_given_options_are_used(options):
    """No option that describes a study may be given where it would have no effect."""
    begun = [name for name in ('resume', 'extend', 'show') if getattr(options, name)]
    given = [
        name for name in (*OF_NEW_STUDIES, *OF_EXTENSIONS) if getattr(options, name) is not None
    ]
    if len(begun) > 1 or begun and 'scene' in given:
        raise ValueError(
            '--resume, --extend, --show, --scene: got more than one of them; a study is begun, '
            'continued, extended or shown: leave out the others')
    wrong = [name for name in given if not (begun == ['extend'] and name in OF_EXTENSIONS)]
    if begun and wrong:
        raise ValueError(
            f'--{begun[0]}: got {", ".join("--" + name for name in wrong)} too; those of the study '
            f'go on as they are: leave out what was given, or begin a new study'
            f'{" (or say --extend)" if set(wrong) <= set(OF_EXTENSIONS) else ""}')


def _run(options):
    settings = _settings(options)
    if options.resume or options.extend:
        study = Study.load(options.directory, options.checkpoint)
        if options.extend:
            study = study.extended(options.length, options.replicas, settings)
    else:
        if options.scene is None or options.length is None:
            raise ValueError(
                '--scene and --length: a new study needs both: give them, or --resume or --extend '
                'for one that is there')
        of = {
            name: value if getattr(options, name) is None else getattr(options, name)
            for name, value in OF_NEW_STUDIES.items()
        }
        study = Study(of['scene'], settings or [{}],
                      4 if options.replicas is None else options.replicas, options.length,
                      of['observables'], of['seed'], of['platform'], of['threads'],
                      of['equilibration'], of['interval'], options.checkpoint)
        if _is_there(options.directory):
            raise ValueError(
                f'{options.directory}: it has a study already; a new study needs a directory '
                'of its own: say --resume or --extend, or give another directory')
    return study.run(
        options.directory, options.jobs, options.cluster, extend=options.extend,
        retries=options.retries, timeout=options.timeout, quiet=options.quiet,
        finished=None if options.quiet else lambda task: tqdm.write(str(task), file=sys.stderr))


def _is_there(directory):
    try:
        read(directory)
    except FileNotFoundError:
        return False
    return True


def _settings(options):
    """Dicts from --set and --sweep; none if neither is given."""
    fixed = [(name, _value(value)) for name, value in map(_pair, options.set or [])]
    swept = [(name, [_value(value) for value in values.split(',')])
             for name, values in map(_pair, options.sweep or [])]
    names = [name for name, _ in (*fixed, *swept)]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise ValueError(
            f'--set, --sweep: got {twice[0]} {names.count(twice[0])} times; a parameter must be '
            f'given once: give several values as --sweep {twice[0]}=VALUE,VALUE')
    return [{**dict(fixed), **each} for each in sweep(**dict(swept))] if names else []


def _time(text):
    """A time such as 5ns, 0.1 s or 20, ps."""
    try:
        return _units.from_text(text, _units.TIMES, 'ps')
    except (KeyError, ValueError):
        raise argparse.ArgumentTypeError(
            f'got {text!r}; a time is a number, of ps or with one of {", ".join(_units.TIMES)} '
            'behind it: write e.g. 5ns') from None


def _pair(text):
    name, equals, value = text.partition('=')
    if not (name and equals and value):
        raise ValueError(
            f'--set, --sweep: got {text!r}; a name and its value are needed: write e.g. '
            f'temperature=300')
    return name, value


def _value(text):
    """A number or truth value as JSON has it, else the text."""
    try:
        return json.loads(text)
    except ValueError:
        return text
