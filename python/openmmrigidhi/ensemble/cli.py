"""The command line: python3 -m openmmrigidhi.ensemble."""
import argparse
import json
import sys

import openmm
from tqdm import tqdm

from ..accuracy import observables
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
  python3 -m openmmrigidhi.ensemble my_study --show'''


def parser():
    """The argument parser."""
    result = argparse.ArgumentParser(prog='python3 -m openmmrigidhi.ensemble',
                                     description=DESCRIPTION, epilog=EPILOG,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    result.add_argument('directory', help='of the study')
    result.add_argument('--resume', action='store_true', help='go on with the study that is there')
    result.add_argument(
        '--extend', action='store_true',
        help='make the study that is there longer (--length), or give it more --replicas or '
        'settings '
        '(--sweep, --set)')
    result.add_argument('--show', action='store_true', help='compute nothing: print what there is')
    what = result.add_argument_group('what is run')
    what.add_argument('--scene', help=f'{", ".join(BUILT_IN)}, or module:function')
    what.add_argument('--set', nargs='+', default=[], metavar='NAME=VALUE',
                      help='parameters of the scene; scheme and stepSize (ps) of its integrator')
    what.add_argument('--sweep', nargs='+', default=[], metavar='NAME=VALUE,VALUE',
                      help='values of parameters, in all combinations')
    what.add_argument('--replicas', type=int, help='of each setting (4)')
    what.add_argument('--length', type=float, help='ps that each replica samples')
    what.add_argument('--equilibration', type=float,
                      help='ps before (the scene\'s, or a tenth of the length)')
    what.add_argument('--interval', type=float, help='ps between samples (the scene\'s)')
    what.add_argument(
        '--observables', nargs='+', default=list(observables.DEFAULT), metavar='NAME',
        help=f'among {", ".join(observables.BUILT_IN)}, energy_group_N, or module:function of the '
        f'Context')
    what.add_argument('--seed', type=int, default=1)
    what.add_argument('--platform', default='CPU', help='(CPU)')
    what.add_argument('--threads', type=int, default=1,
                      help='of the CPU platform, in each task (1)')
    how = result.add_argument_group('who computes')
    how.add_argument('--jobs', type=int, default=1, help='tasks at the same time (1)')
    how.add_argument(
        '--cluster', metavar='ADDRESS',
        help='a scheduler of dask.distributed, e.g. tcp://host:8786; local: workers on this '
        'machine, the default with --jobs above 1 where dask.distributed is installed; processes: '
        'plain processes')
    how.add_argument('--retries', type=int, default=3,
                     help='how many times a task whose worker died is tried again (3)')
    how.add_argument('--timeout', type=float, default=60, help='seconds to wait for a cluster (60)')
    how.add_argument('--checkpoint', type=float, default=60, metavar='SECONDS',
                     help='between two savings of a task (60)')
    how.add_argument('--quiet', action='store_true', help='no progress bar')
    return result


def main(arguments=None):
    """Run the command line.

    Parameters
    ----------
    arguments : list of str, optional
        default: sys.argv

    Returns
    -------
    int
        exit status: 0; 1 if tasks failed or are not finished; 2 for wrong arguments, or a cluster
        that cannot be used
    """
    options = parser().parse_args(arguments)
    try:
        result = read(options.directory) if options.show else _run(options)
    except (ValueError, TypeError, OSError, ImportError, RuntimeError,
            openmm.OpenMMException) as error:
        print(f'error: {error}', file=sys.stderr)
        return 2
    print(result.table())
    return 0 if result.isComplete else 1


def _run(options):
    settings = _settings(options)
    if options.resume or options.extend:
        if options.resume and options.extend or options.scene:
            raise ValueError(
                '--resume, --extend, --scene: got more than one of them; a study is begun, '
                'continued or extended: leave out the others')
        study = Study.load(options.directory, options.checkpoint)
        if options.extend:
            study = study.extended(options.length, options.replicas, settings)
        elif options.length is not None or options.replicas is not None or settings:
            raise ValueError(
                '--resume: got a length, replicas or settings too; those of the study go on as '
                'they are: say --extend, or leave them out')
    else:
        if options.scene is None or options.length is None:
            raise ValueError(
                '--scene and --length: a new study needs both: give them, or --resume or --extend '
                'for one that is there')
        study = Study(options.scene, settings or [{}],
                      4 if options.replicas is None else options.replicas, options.length,
                      options.observables, options.seed, options.platform, options.threads,
                      options.equilibration, options.interval, options.checkpoint)
        if _isThere(options.directory):
            raise ValueError(
                f'{options.directory}: there is a study in it already; a new one needs a directory '
                f'of its own: say --resume or --extend, or give '
                'another directory')
    return study.run(
        options.directory, options.jobs, options.cluster, extend=options.extend,
        retries=options.retries, timeout=options.timeout, quiet=options.quiet,
        finished=None if options.quiet else lambda task: tqdm.write(str(task), file=sys.stderr))


def _isThere(directory):
    try:
        read(directory)
    except FileNotFoundError:
        return False
    return True


def _settings(options):
    """Dicts from --set and --sweep; none if neither is given."""
    fixed = {name: _value(value) for name, value in map(_pair, options.set)}
    swept = {
        name: [_value(value) for value in values.split(',')]
        for name, values in map(_pair, options.sweep)
    }
    return [dict(fixed, **each) for each in sweep(**swept)] if fixed or swept else []


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
