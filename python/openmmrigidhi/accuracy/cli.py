"""The command line: python3 -m openmmrigidhi.accuracy."""
from __future__ import annotations

import argparse
import os
import sys
import time
from typing import Optional

from .. import _tasks
from . import grid, methods, mobilities, observables, overdamped, rungs, scenes
from ._results import check_lengths, split_wanted
from .grid import GridStudy
from .gridresult import GridResult
from .ladder import LadderStudy
from .ladderresult import LadderResult
from .price import parseSpending
from .result import StudyResult
from .study import StepSizeStudy

DESCRIPTION = '''Measure, on this machine, what accuracy costs: the error of observables against
ns/day, for step sizes and schemes, beside OpenMM's LangevinMiddleIntegrator with constraints. The
command writes results.csv, results.json, error_*.png and report.html. It names the cheapest setting
for a wanted error, or says that none reaches it.

With --ladder it does the same for models of the fluid: the error of the mobility against time per
step, from free draining to lubrication (docs/hydrodynamic_ladder.md). With --overdamped it compares
the schemes without momenta, and LangevinHI at high friction, for bodies above a wall
(docs/overdamped_accuracy.md). With --grid it studies the grid of a periodic fluid: errors of
products against their time, by tolerance (docs/grid_accuracy.md).'''

EPILOG = '''examples:
  python3 -m openmmrigidhi.accuracy --scene water --budget 1800 \\
      --wanted-error potential_energy:0.5%
  python3 -m openmmrigidhi.accuracy --scene trap --platform Reference --length 20 \\
      --methods LangevinB LangevinC
  python3 -m openmmrigidhi.accuracy --system system.xml --state state.xml \\
      --integrator integrator.xml --steps 2,4,6
  python3 -m openmmrigidhi.accuracy --scene mymodule:makeScene \\
      --observables potential_energy mymodule:endToEnd
  python3 -m openmmrigidhi.accuracy --ladder --wanted-error mobility:1%
  python3 -m openmmrigidhi.accuracy --ladder --scene mymodule:makeScene \\
      --wanted-error sedimentation:1%,mobility:5%
  python3 -m openmmrigidhi.accuracy --ladder --scene arrays --wanted-error drag:10%
  python3 -m openmmrigidhi.accuracy --overdamped --wanted-error height:1%,repulsion:5%
  python3 -m openmmrigidhi.accuracy --grid --bodies 200 --wanted-error forces:1e-4
  python3 -m openmmrigidhi.accuracy --from accuracy/results.json \\
      --wanted-error potential_energy:0.2%
  python3 -m openmmrigidhi.accuracy --from accuracy/results.json \\
      --price potential_energy:0.2% --spend potential_energy:2h'''


def parser() -> argparse.ArgumentParser:
    """The argument parser."""
    result = argparse.ArgumentParser(prog='python3 -m openmmrigidhi.accuracy',
                                     description=DESCRIPTION, epilog=EPILOG,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    scene = result.add_argument_group('scene')
    scene.add_argument(
        '--scene', default=None, help=
        'water (default), trap; with --ladder pairs (default), suspension, arrays (simple cubic, '
        'periodic), periodic (a suspension); with --overdamped boomerang (default), suspension; or '
        'module:function that returns a Scene, '
        '(system, state or positions, integrator) or (system, topology, positions, integrator)')
    scene.add_argument('--system',
                       help='System as XML: your own scene, with --state and --integrator')
    scene.add_argument('--state', help='State as XML: the start, which should be equilibrated')
    scene.add_argument(
        '--integrator',
        help='CustomRigidHIIntegrator as XML: says what the bodies, temperature and frictions are')
    scene.add_argument(
        '--bodies', type=int, help=
        'number of molecules of water (216), or of bodies in trap (400), suspension (12; 16 with '
        '--overdamped), periodic (8; 500 with --grid) or boomerang (32 replicas)')
    scene.add_argument('--temperature', type=float, help='K, of a built-in scene')
    scene.add_argument(
        '--gamma', type=float,
        help='translational friction of a built-in scene and of LangevinMiddle, 1/ps')
    scene.add_argument('--Gamma', type=float, help='rotational friction of a built-in scene, 1/ps')
    what = result.add_argument_group('what is compared')
    what.add_argument(
        '--methods', nargs='+', default=None, metavar='NAME[:STEPS]',
        help=f'among {", ".join(methods.BUILT_IN)}; with step sizes of its own in fs, e.g. '
        'GradientThermostat:1,2,3,4; options may follow a name: -I8 inertia scale, -g2 and '
        '-G4 frictions, -H3 hydrogens of 3 dalton, -N2 reciprocal space in every other step '
        '(default: LangevinC LangevinMiddle); with --overdamped among '
        f'{", ".join(overdamped.METHODS)}, steps in tau_D (default: all)')
    what.add_argument(
        '--steps', metavar='FS',
        help='step sizes of all methods in fs (with --overdamped in tau_D), e.g. 1,2,4,6,8 '
        '(default: the scene\'s)')
    what.add_argument(
        '--observables', nargs='+', default=None, metavar='NAME',
        help=f'among {", ".join(observables.BUILT_IN)}, energy_group_N, or module:function of the '
        'Context (default: energy and temperatures); with --overdamped among '
        f'{", ".join(overdamped.OBSERVABLES)} (default: all)')
    what.add_argument(
        '--wanted-error', nargs='+', default=[], metavar='NAME:ERROR',
        help='e.g. potential_energy:0.5%%, or potential_energy:0.2 in its unit; several in one '
        'word, with commas, must all be met')
    what.add_argument(
        '--price', nargs='+', default=[], metavar='NAME:ERROR', help=
        'what it takes to know a number to this error, bias and standard error together: the time '
        'of every setting, and the cheapest; written as for --wanted-error')
    what.add_argument(
        '--spend', nargs='+', default=[], metavar='NAME:TIME',
        help='the setting with which a number is known best after this time, e.g. '
        'potential_energy:2h (s, min, h, d)')
    what.add_argument('--reference', nargs='+', default=[], metavar='NAME=VALUE[+-ERROR]',
                      help='a known average, used instead of the extrapolation to step 0')
    ladder = result.add_argument_group('the hydrodynamic ladder')
    ladder.add_argument(
        '--ladder', action='store_true',
        help='compare models of the fluid instead of step sizes; the scene has spheres and '
        f'a MobilityForce. Observables: {", ".join(mobilities.BUILT_IN)}, or module:function of '
        f'the MobilitySample')
    ladder.add_argument(
        '--rungs', nargs='+', metavar='NAME',
        help=f'among {", ".join(rungs.RUNGS)} (default: all but multiblob642 and those with +self)')
    ladder.add_argument('--gaps', metavar='RADII',
                        help='of pairs, between the surfaces, in radii, e.g. 0.01,0.1,1,10')
    ladder.add_argument('--ladder-reference', metavar='NAME',
                        help='the rung that others are compared with (default: the best)')
    road = result.add_argument_group('the overdamped limit')
    road.add_argument('--overdamped', action='store_true',
                      help='compare the schemes without momenta and LangevinHI at high friction')
    nodes = result.add_argument_group('the grid of a periodic fluid')
    nodes.add_argument(
        '--grid', action='store_true', help=
        'compare tolerances of ForceCoupling on a grid; the scene has spheres and a MobilityForce '
        f'with the boundary Periodic. Observables: {", ".join(grid.OBSERVABLES)}')
    nodes.add_argument('--tolerances', metavar='EPS',
                       help='e.g. 1e-2,1e-4,1e-6 (default: 1e-2 to 1e-10)')
    how = result.add_argument_group('how it is measured')
    how.add_argument('--budget', type=float, default=600,
                     help='seconds for the measurement; run lengths are planned from it (600)')
    how.add_argument('--length', type=float,
                     help='ps (with --overdamped tau_D) for every setting, instead of a budget')
    how.add_argument('--equilibration', type=float,
                     help='ps (with --overdamped tau_D) left out at the start of each run')
    how.add_argument('--sample-interval', type=float, metavar='PS',
                     help='between samples, rounded to whole steps (default: the scene\'s)')
    how.add_argument('--rounds', type=int, default=20, help='number of turns (20)')
    how.add_argument(
        '--platform', choices=['CPU', 'Reference'], help=
        '(CPU, also with --grid; with --ladder the faster of the two; with --overdamped Reference)')
    how.add_argument('--threads', type=int, default=1, help='of the CPU platform (1)')
    how.add_argument(
        '--jobs', type=int, default=1,
        help='runs at the same time, with --ladder mobilities; times are then measured afterwards, '
        'alone (1)')
    how.add_argument(
        '--cluster', metavar='ADDRESS', help=
        'a scheduler of dask.distributed whose workers make the runs; local or processes: on this '
        'machine (docs/ensembles.md)')
    how.add_argument(
        '--clock', default='wall', choices=['wall', 'cpu'],
        help='what ns/day is computed from; cpu is less disturbed by other programs (wall)')
    how.add_argument('--seed', type=int, default=1)
    out = result.add_argument_group('output')
    out.add_argument('--output',
                     help='directory (accuracy; with --from, that of the earlier result)')
    out.add_argument(
        '--baseline', help=
        'method that speeds are compared with (LangevinMiddle; with --overdamped TrapezoidalSlip)')
    out.add_argument('--from', dest='source', metavar='RESULTS.JSON',
                     help='measure nothing: report again from an earlier result')
    out.add_argument('--quiet', action='store_true', help='no progress bar')
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
        exit status: 0; 2 for wrong arguments
    """
    options = parser().parse_args(arguments)
    try:
        if (options.ladder or options.grid) and (options.price or options.spend):
            raise ValueError(
                '--price, --spend: got one with --ladder or --grid, which measure no averages and '
                'so no noise: leave it out')
        if options.source:
            result = next(
                (kind for kind in (LadderResult, GridResult) if kind.isOne(options.source)),
                StudyResult).fromJson(options.source)
        else:
            # Before a scene is made, which may take minutes.
            check_lengths('accuracy', options.budget, options.length, options.equilibration,
                          options.rounds)
            result = (_ladder if options.ladder else _grid if options.grid else
                      _overdamped if options.overdamped else _step_sizes)(options)
        if isinstance(result, (LadderResult, GridResult)):
            report = result.report(options.wanted_error)
        else:
            report = result.report(
                options.wanted_error, options.baseline
                or ('TrapezoidalSlip' if options.overdamped else 'LangevinMiddle'), options.price,
                [parseSpending(text, list(result.observables)) for text in options.spend])
        directory = options.output
        if directory is None:
            directory = os.path.dirname(options.source) or '.' if options.source else 'accuracy'
        paths = report.write(directory)
    except (ValueError, TypeError, OSError, ImportError, _tasks.TaskError) as error:
        print(f'error: {error}', file=sys.stderr)
        return 2
    print(report.textTable())
    for text in report.paragraphs():
        print('\n' + text)
    print('\nWritten: ' + ', '.join(paths))
    return 0


# ---- The studies ---------------------------------------------------------------------------------


def _step_sizes(options):
    """The study of step sizes."""
    options.platform = options.platform or 'CPU'
    found, steps = _methods(options.methods or ['LangevinC', 'LangevinMiddle'], methods.byName,
                            options.steps, 'fs')
    steps = {name: [h/1000 for h in own] for name, own in steps.items()}
    asked = options.observables or observables.DEFAULT
    names = [observables.byName(name).name for name in asked]
    _check_wanted(options, names, 'potential_energy:0.5%')
    references = dict(_reference(text, names) for text in options.reference)
    with _Bar(options.quiet) as bar:
        study = StepSizeStudy(_scene(options, bar), found, steps, references, observables=asked,
                              platform=options.platform, threads=options.threads, seed=options.seed,
                              clock=options.clock, sampleInterval=options.sample_interval)
        return study.run(options.budget, options.length, options.equilibration, options.rounds,
                         options.jobs, bar.study, options.cluster)


def _overdamped(options):
    """The study of the overdamped limit."""
    name = options.scene or 'boomerang'
    if name not in overdamped.SCENES or options.system or options.state or options.integrator:
        raise ValueError(f'--scene: got {name!r} with --overdamped; it must be one of '
                         f'{", ".join(overdamped.SCENES)}, without --system, --state and '
                         '--integrator')
    if options.sample_interval is not None:
        raise ValueError(
            f'--sample-interval: got {options.sample_interval} with --overdamped, where samples '
            f'are 1 tau_D apart: leave it out')
    found, steps = _methods(options.methods or overdamped.METHODS, overdamped.byName, options.steps,
                            'tau_D')
    names = options.observables or list(overdamped.OBSERVABLES)
    _check_wanted(options, names, 'height:1%')
    given = {} if options.bodies is None else {
        'replicas' if name == 'boomerang' else 'bodies': options.bodies
    }
    scene = overdamped.SCENES[name](seed=options.seed, **given)
    study = overdamped.OverdampedStudy(scene, [method.name for method in found], steps, names,
                                       platform=options.platform or 'Reference',
                                       threads=options.threads, seed=options.seed,
                                       clock=options.clock)
    with _Bar(options.quiet) as bar:
        return study.run(
            options.budget, None if options.length is None else options.length*scene.timeUnit,
            (30 if options.equilibration is None else options.equilibration)*scene.timeUnit,
            options.rounds, options.jobs, bar.study, options.cluster)


def _ladder(options):
    """The hydrodynamic ladder."""
    study = LadderStudy(_sphere_scene(options), options.rungs, options.observables,
                        options.ladder_reference, (options.platform,) if options.platform else
                        ('Reference', 'CPU'), options.threads, seed=options.seed)
    _check_wanted(options, [observable.name for observable in study.observables], 'mobility:1%')
    with _Bar(options.quiet, 'run') as bar:
        return study.run(options.rounds, progress=bar.study, jobs=options.jobs,
                         cluster=options.cluster)


def _grid(options):
    """The grid of a periodic fluid."""
    names = options.observables or list(grid.OBSERVABLES)
    _check_wanted(options, names, 'forces:1e-4')
    tolerances = _positives(options.tolerances) if options.tolerances else grid.TOLERANCES
    if not tolerances:
        raise ValueError(
            f'--tolerances: got {options.tolerances!r}, where a list of numbers is wanted: write '
            f'e.g. 1e-2,1e-4')
    if not any((options.scene, options.system, options.state, options.integrator)):
        scene = scenes.periodicSuspension(options.bodies or 500, 0.1, seed=options.seed)
    else:
        scene = _sphere_scene(options)
    study = GridStudy(scene, tolerances, observables=names, platform=options.platform or 'CPU',
                      threads=options.threads, seed=options.seed)
    with _Bar(options.quiet, 'run') as bar:
        return study.run(options.rounds, progress=bar.study)


# ---- Meaning of the arguments --------------------------------------------------------------------


def _check_wanted(options, names, example):
    """Find wrong wanted errors before anything is measured."""
    for item in options.wanted_error + options.price:
        split_wanted(item, names, example)
    for item in options.spend:
        parseSpending(item, names)


def _methods(texts, byName, common, unit):
    """Methods, and the step sizes that they have, in this unit.

    Some methods may have step sizes of their own. If there are common step sizes, all methods have
    them.
    """
    found, steps = [], {}
    for text in texts:
        name, _, own = text.partition(':')
        found.append(byName(name))
        if own or common:
            steps[name] = _positives(own or common)
            if not steps[name]:
                raise ValueError(
                    f'step sizes: got {own or common!r}; they must be positive numbers in {unit} '
                    'with commas between: write e.g. 2,4,6')
    return found, steps


def _positives(text):
    """Positive numbers with commas between, or an empty list if the text is something else."""
    try:
        values = [float(part) for part in text.split(',')]
    except ValueError:
        return []
    return values if min(values) > 0 else []


def _sphere_scene(options):
    files = (options.system, options.state, options.integrator)
    name = options.scene or 'pairs'
    if options.gaps and (any(files) or name != 'pairs'):
        raise ValueError(
            '--gaps: got it with another scene; gaps are those of pairs: leave out one of the two')
    if any(files) or name not in scenes.OF_SPHERES:
        if not any(files) and ':' not in name:
            raise ValueError(f'--scene: got {name!r} with --ladder; it must be one of '
                             f'{", ".join(scenes.OF_SPHERES)}, or module:function')
        return _scene(options, None)
    if name == 'pairs':
        gaps = _positives(options.gaps) if options.gaps else None
        if gaps == []:
            raise ValueError(
                f'--gaps: got {options.gaps!r}; gaps are positive numbers in radii with commas '
                f'between: write e.g. 0.01,0.1,1')
        return scenes.pairs(gaps) if gaps else scenes.pairs()
    if name == 'arrays':
        return scenes.arrays()
    given = {
        key: getattr(options, key)
        for key in ('bodies', 'temperature') if getattr(options, key) is not None
    }
    return scenes.OF_SPHERES[name](seed=options.seed, **given)


def _reference(text, names):
    name, _, amount = text.partition('=')
    value, _, error = amount.partition('+-')
    try:
        pair = float(value), float(error or 0)
    except ValueError:
        pair = None
    if pair is None or name not in names:
        raise ValueError(
            f'--reference: got {text!r}; it must be name=value or name=value+-error, the name one '
            f'of {", ".join(names)}: write e.g. potential_energy=-46.5+-0.02')
    return name, pair


def _scene(options, bar):
    files = (options.system, options.state, options.integrator)
    if any(files):
        if not all(files) or options.scene:
            raise ValueError(
                '--system, --state and --integrator: all three must be given, and no --scene: add '
                'what is missing')
        return scenes.fromFiles(*files)
    name = options.scene or 'water'
    if name not in scenes.BUILT_IN:
        if ':' not in name:
            raise ValueError(f'--scene: got {name!r}; it must be a built-in scene '
                             f'({", ".join(scenes.BUILT_IN)}) or module:function')
        return scenes.fromFunction(name)
    given = {
        key: getattr(options, key)
        for key in ('temperature', 'gamma', 'Gamma') if getattr(options, key) is not None
    }
    if name == 'water':
        if options.bodies is not None:
            given['molecules'] = options.bodies
        given.update(platform=options.platform, threads=options.threads, progress=bar.scene)
    elif options.bodies is not None:
        given['bodies'] = options.bodies
    return scenes.BUILT_IN[name](seed=options.seed, **given)


class _Bar:
    """Two progress bars, one after the other: making the scene, and the study."""
    def __init__(self, quiet, unit='step'):
        self.quiet = quiet
        self.unit = unit
        self.bar = None
        self.stage = None
        self.last = 0.0

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._close()

    def _close(self):
        if self.bar is not None:
            self.bar.close()
        self.bar = None

    def _show(self, stage, done, total, text):
        if self.quiet:
            return
        if self.stage != stage:
            from tqdm import tqdm
            self._close()
            self.bar = tqdm(total=total, unit=self.unit, unit_scale=self.unit == 'step',
                            smoothing=0.02, mininterval=0.5)
            self.stage = stage
        now = time.monotonic()
        if now - self.last > 0.5 or done >= total:
            self.last = now
            self.bar.total = max(total, done)
            self.bar.set_description(text, refresh=False)
            self.bar.update(done - self.bar.n)

    def scene(self, done, total):
        """For scenes.water()."""
        self._show('scene', done, total, 'equilibrating')

    def study(self, done, total, text):
        """For Study.run()."""
        self._show('study', done, total, text)
