"""The price of 0.5 % of water's energy and mean square dipole moment, by LangevinC and others.

The scene is 216 TIP4P-Ew molecules on the CPU platform, with one thread; prices are processor time.
The methods are LangevinC with real moments of inertia and with moments times 4, 8, 16; OpenMM's
LangevinMiddleIntegrator with its own hydrogens and with heavier ones; and LangevinMiddleIntegrator
with reciprocal space in every other step. Each runs with several frictions. OpenMM's methods are
the best that users have without this plugin.

``price.py run`` makes the runs of a series, as many at a time as --jobs says. If it is stopped and
started again, it goes on where it was, and a longer run goes on from a shorter one. ``price.py
motion`` measures how fast molecules move. ``price.py time`` lets all settings take turns for their
speeds, alone on the machine. ``price.py report`` writes results_price/ from all runs that there
are. If none of these runs is long, the ratio of the autocorrelation time of M^2 to the
reorientation time is that of the published series.
"""
import argparse
import collections
import json
import math
import os
import pathlib
import re
import sys
import time

for _variable in ('OPENBLAS_NUM_THREADS', 'OMP_NUM_THREADS'):
    os.environ.setdefault(_variable, '1')

import numpy as np  # noqa: E402
import openmm  # noqa: E402
from tqdm import tqdm  # noqa: E402

from openmmrigidhi import accuracy  # noqa: E402
from openmmrigidhi.accuracy import measurement, observables  # noqa: E402
from openmmrigidhi.accuracy.scenes import Scene  # noqa: E402
from openmmrigidhi.analysis import series  # noqa: E402

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1]/'common'))
import campaign  # noqa: E402
import recording  # noqa: E402

OBSERVABLES = [
    'potential_energy', 'dipole_squared', 'translational_temperature', 'rotational_temperature_1'
]
WANTED, WISH = ['potential_energy:0.5%'], 0.005
#: The limit of small steps of results/results.json, kJ/mol.
REFERENCES = {'potential_energy': (-46.498, 0.042)}
#: Method -> time steps in fs.
SERIES = {
    'scout': {
        'LangevinC': (9,),
        'LangevinC-g1-G2': (9,),
        'LangevinC-I4-g1-G2': (12,),
        'LangevinC-I4-g3-G3': (13,),
        'LangevinC-I8-g1-G2': (14, 16),
        'LangevinC-I8-g3-G3': (15,),
        'LangevinC-I8-g5-G2': (15, 16),
        'LangevinC-I16': (15,),
        'LangevinMiddle-g1': (7,),
        'LangevinMiddle-H2-g1': (9,),
        'LangevinMiddle-H3-g1': (10, 12),
        'LangevinMiddle-H4-g1': (12, 13, 14),
        'LangevinMiddle-N2-g1': (7,),
        'LangevinMiddle-N2-H3-g1': (8, 10)
    },
    'long': {
        'LangevinC-I8': (15,),
        'LangevinMiddle': (7,),
        'LangevinMiddle-H3': (12,)
    },
    'best': {
        'LangevinC-I4-g1-G2': (13,),
        'LangevinC-I8-g2-G2': (15,),
        'LangevinC-I8-g5-G2': (15,),
        'LangevinMiddle-g1': (7,),
        'LangevinMiddle-H3-g0.5': (12,),
        'LangevinMiddle-H3-g1': (12,)
    },
    'recommended': {
        'LangevinC-I8-g2-G2': (15,)
    },
}
#: Settings whose molecules are followed; lags of cosines, ps; number of blocks for errors.
MOTION = {
    'LangevinC': (9,),
    'LangevinC-g1-G2': (8,),
    'LangevinC-I4': (13,),
    'LangevinC-I4-g1-G2': (12, 13),
    'LangevinC-I4-g2-G2': (13,),
    'LangevinC-I8': (15,),
    'LangevinC-I8-g1-G2': (14,),
    'LangevinC-I8-g2-G2': (15,),
    'LangevinC-I8-g5-G2': (15,),
    'LangevinMiddle': (7,),
    'LangevinMiddle-g1': (7,),
    'LangevinMiddle-H3': (12,),
    'LangevinMiddle-H3-g0.5': (12,),
    'LangevinMiddle-H3-g1': (12,),
    'LangevinMiddle-N2-H3': (12,)
}
LAGS, BLOCKS = (2.0, 4.0), 5
#: ps that a setting advances in one turn, between two saves on disk.
PIECE = 20.0
SAMPLE_INTERVAL, EQUILIBRATION = 0.2, 20.0
#: Runs of this length, ps, give the autocorrelation time of M^2 to a quarter or better.
LONG = 900.0
#: ps that a setting advances in one turn of ``price.py time``.
TIMED = 2.0


class _Components:
    """The components of the box's dipole moment, e nm, as one series each.

    Autocorrelation times are better known from the components than from the square alone.
    """

    name, setup = 'components', observables.BUILT_IN['dipole_squared'].setup

    @staticmethod
    def measure(sample, charges):
        return observables.dipoleMoment(sample, charges)


class Legs(accuracy.StepSizeStudy):
    """Settings whose runs are made in parts.

    Each time that a run is continued, its random numbers are others.
    """

    leg = 0

    def __init__(self, *arguments, **keywords):
        super().__init__(*arguments, **keywords)
        self.reported = list(self.observables)
        self.observables.append(_Components())

    def reference(self, observable, rows):
        # The mean square dipole moment is known to some percent: a fit over steps would be of no
        # use.
        return None if observable.name == 'dipole_squared' else super().reference(observable, rows)

    def settingSeed(self, setting):
        return (super().settingSeed(setting) + 7919*self.leg) % (2**31 - 2) + 1


class Kept:
    """A run that is saved in a directory of its own below a folder.

    Saved are samples, times, and the State from which the run goes on.
    """
    def __init__(self, study, setting, folder):
        self.study = study
        self.setting = setting
        self.name = f'{setting.method.name}_{1000*setting.stepSize:g}fs'
        self.kept = campaign.State(folder/campaign.directoryName(self.name),
                                   (self.name, study.seed))
        self.record = measurement.Record(0.0)
        self.state, self.legs, self.run = None, 0, None
        kept = self.kept.load()
        if kept:
            self.state, self.legs = str(kept['state']), int(kept['legs'])
            record = self.record
            record.samplesAt, record.length, record.equilibration = (float(
                kept[name]) for name in ('samplesAt', 'length', 'equilibration'))
            record.status, record.message = str(kept['status']), str(kept['message'])
            record.timings = [tuple(row) for row in kept['timings']]
            record.series = {
                name[7:]: list(values)
                for name, values in kept.items() if name.startswith('series_')
            }

    @property
    def key(self):
        """(method, step in fs)."""
        return self.setting.method.name, round(1000*self.setting.stepSize, 6)

    def goOn(self):
        """A Context at the end of the saved run, to measure its speed."""
        self.study.leg = self.legs
        run = self.study._make_run(self.setting)
        if self.state is not None:
            self._place(run.context)
        return run.context

    def _place(self, context):
        state = openmm.XmlSerializer.deserialize(self.state)
        context.setPositions(state.getPositions())
        context.setVelocities(state.getVelocities())

    def _begin(self):
        """Continue the saved run, or begin it."""
        self.study.leg = self.legs
        self.legs += 1
        self.run = self.study._make_run(self.setting)
        if self.state is None:
            self.run.advance(round(EQUILIBRATION/self.run.record.samplesAt), record=False)
            self.record = self.run.record
        else:
            # The bounds of its energy were found at the scene's start. The time goes on from the
            # end of the record.
            self._place(self.run.context)
            self.run.time = self.record.equilibration + self.record.length
            self.run.record = self.record

    def advance(self, ps):
        """Continue the run, and save what there is then."""
        if self.record.status != measurement.STABLE:
            return
        if self.run is None:
            self._begin()
        if self.run.isAlive:
            self.run.advance(max(1, round(ps/self.run.record.samplesAt)))
        self._keep()

    def _keep(self):
        record = self.record = self.run.record
        if self.run.isAlive:
            self.state = openmm.XmlSerializer.serialize(
                self.run.context.getState(getPositions=True, getVelocities=True))
        self.kept.save(
            state=self.state or '', legs=self.legs, samplesAt=record.samplesAt,
            length=record.length, equilibration=record.equilibration, status=record.status,
            message=record.message, timings=np.array(record.timings).reshape(-1, 3),
            **{f'series_{name}': np.array(values)
               for name, values in record.series.items()})


def water(folder, threads):
    """The equilibrated box, made once for all runs of this folder."""
    names = [folder/f'water_{part}.xml' for part in ('system', 'state', 'integrator')]
    if not all(name.exists() for name in names):
        folder.mkdir(parents=True, exist_ok=True)
        with tqdm(desc='equilibrating', unit='step') as bar:
            scene = accuracy.scenes.water(216, seed=2026, threads=threads,
                                          progress=lambda done, total: bar.update(done - bar.n))
        context = scene.makeContext(openmm.VerletIntegrator(0.001),
                                    openmm.Platform.getPlatformByName('Reference'), {}, 1)
        objects = (scene.system, context.getState(getPositions=True,
                                                  getVelocities=True), scene.makeIntegrator())
        for name, thing in zip(names, objects):
            name.write_text(openmm.XmlSerializer.serialize(thing))
    system, state, integrator = (openmm.XmlSerializer.deserialize(name.read_text())
                                 for name in names)
    return Scene(
        system, state, integrator, 'water216',
        '216 TIP4P-Ew molecules at 995 kg/m^3 and 298.15 K, PME, cutoff 0.9 nm; where a method\'s '
        'name says nothing else gamma = 5/ps, Gamma = 10/ps', equilibration=EQUILIBRATION,
        sampleInterval=SAMPLE_INTERVAL)


def makeStudy(options, settings):
    steps = {name: [h/1000 for h in own] for name, own in settings.items()}
    return Legs(water(options.work, 1), list(steps), steps, REFERENCES, observables=OBSERVABLES,
                platform='CPU', threads=1, seed=options.seed, clock='cpu')


def wanted(options):
    """Method -> time steps in fs, of a series or of the named methods."""
    if not options.methods:
        return SERIES[options.series]
    return {
        name: tuple(float(h) for h in own.split(','))
        for name, _, own in (text.partition(':') for text in options.methods)
    }


def advance(argument, job):
    """Run one setting until it has its length, ps."""
    name, step, length, seed = argument
    options = argparse.Namespace(work=pathlib.Path(job.directory).parent, seed=seed)
    study = makeStudy(options, {name: (step,)})
    kept = Kept(study, study.settings()[0], options.work)
    while kept.record.status == measurement.STABLE and kept.record.length < length - 0.5*PIECE:
        kept.advance(PIECE)
        job.report(kept.record.length)
    return {'status': kept.record.status, 'length': kept.record.length}


def run(options):
    """Run all settings until each has its length."""
    settings = [(name, step) for name, steps in wanted(options).items() for step in steps]
    water(options.work, 1)  # made once, before all runs need it
    campaign.run(advance, [(*setting, options.length, options.seed) for setting in settings],
                 [f'{name}_{step:g}fs' for name, step in settings], options,
                 [options.length]*len(settings), 'ps', 'runs')


# ---- Motion --------------------------------------------------------------------------------------


class Cosine(observables.Observable):
    """Mean cosine of the angle by which molecules' dipoles turn within a lag (ps)."""
    def __init__(self, lag):
        super().__init__(f'cosine_{lag:g}', f'cosine over {lag:g} ps', '', self._cosine,
                         setup=self._begin)
        self.lag = lag

    @staticmethod
    def _begin(scene, platform, properties):
        return observables.BUILT_IN['dipole_squared'].setup(scene, platform, properties), np.array(
            scene.bodies), collections.deque()

    def _cosine(self, sample, memory):
        charges, members, past = memory
        dipoles = np.einsum('bk,bki->bi', charges.charges[members], sample.positions[members])
        past.append(
            (sample.energies.getTime()._value, dipoles/np.linalg.norm(dipoles, axis=1)[:, None]))
        if past[-1][0] - past[0][0] < self.lag - 1e-6:
            return float('nan')
        while past[-1][0] - past[1][0] > self.lag - 1e-6:
            past.popleft()
        return float((past[-1][1]*past[0][1]).sum(axis=1).mean())


class Unreferenced(accuracy.StepSizeStudy):
    """A study without limits of small steps, which are not needed here."""
    def reference(self, observable, rows):
        return None


def motion(options):
    """How fast molecules diffuse and turn.

    Slow averages depend on this motion, and it is known sooner than the autocorrelation time of the
    box's dipole. Settings that motion.json has already are replaced, the others kept.
    """
    steps = {
        name: [h/1000 for h in own]
        for name, own in (wanted(options) if options.methods else MOTION).items()
    }
    chosen = ['diffusion_coefficient', *map(Cosine, LAGS), 'potential_energy']
    study = Unreferenced(water(options.work, 1), list(steps), steps, observables=chosen,
                         platform='CPU', threads=1, seed=options.seed, clock='cpu')
    with tqdm(total=1, unit='step', mininterval=5) as bar:

        def show(done, total, text):
            bar.total = total
            bar.set_description(text, refresh=False)
            bar.update(done - bar.n)

        study.run(length=options.length, equilibration=10.0, rounds=5, jobs=options.jobs,
                  progress=show, cluster=options.cluster)
    rows = []
    for setting, record in study.records:
        row = {
            'method': setting.method.name,
            'step_fs': 1000*setting.stepSize,
            'status': record.status,
            'message': record.message,
            'length_ps': record.length
        }
        if record.status == measurement.STABLE:
            series_ = [
                np.array(record.series[observable.name], float) for observable in study.observables
            ]
            D, first, last, energy = ([
                block.mean() for block in np.array_split(each[np.isfinite(each)], BLOCKS)
            ] for each in series_)
            lags = [max(1, math.ceil(lag/record.samplesAt - 1e-6))*record.samplesAt for lag in LAGS]
            taus = (lags[1] - lags[0])/np.log(np.array(first)/last)
            for name, values in (('diffusion_nm2_per_ps', D), ('reorientation_ps', taus), ('energy',
                                                                                           energy)):
                row.update({
                    name: np.mean(values),
                    f'{name}_error': np.std(values, ddof=1)/math.sqrt(BLOCKS)
                })
        rows.append(row)
        print(row)
    path = options.output/'motion.json'
    old = json.loads(path.read_text()) if path.exists() else {'rows': [], 'provenance': []}
    again = {(row['method'], row['step_fs']) for row in rows}
    rows = [row for row in old['rows'] if (row['method'], row['step_fs']) not in again] + rows
    recording.save(
        options.output, 'motion.json', {
            'lags_ps': LAGS,
            'blocks': BLOCKS,
            'seed': options.seed,
            'rows': rows,
            'provenance': [*old['provenance'], recording.provenance(options)]
        })


# ---- Speeds --------------------------------------------------------------------------------------


def moved(options):
    """The rows that ``price.py motion`` has written: (method, step in fs) -> row."""
    path = options.output/'motion.json'
    rows = json.loads(path.read_text())['rows'] if path.exists() else []
    return {(row['method'], round(row['step_fs'], 6)): row
            for row in rows if row['status'] == measurement.STABLE}


def found(options):
    """All runs of the folder, and settings whose motion is known, as (study, list of Kept)."""
    settings = {}
    for path in sorted(options.work.glob('*fs/state.npz')):
        name, _, step = path.parent.name.rpartition('_')
        settings.setdefault(name, []).append(float(step[:-2]))
    for name, step in moved(options):
        settings.setdefault(name, []).append(step)
    study = makeStudy(options, settings)
    return study, [Kept(study, setting, options.work) for setting in study.settings()]


def clockSpeeds(options):
    """Let all stable settings take turns; speeds.json has ns per processor day of each turn."""
    _, runs = found(options)
    followed = moved(options)
    runs = [
        each for each in runs if each.record.status == measurement.STABLE and (
            each.record.length >= options.least or each.key in followed)
    ]
    rng = np.random.default_rng(options.seed)
    speeds = {each.name: [] for each in runs}
    with tqdm(total=options.rounds*len(runs), desc='speeds', mininterval=2) as bar:
        contexts = [each.goOn() for each in runs]
        for turn in range(-1, options.rounds):
            for i in rng.permutation(len(runs)):
                step = runs[i].setting.stepSize
                count = round(TIMED/step)
                began = time.process_time()
                contexts[i].getIntegrator().step(count)
                if turn >= 0:
                    speeds[runs[i].name].append(
                        count*step/1000*measurement.SECONDS_PER_DAY/(time.process_time() - began))
                    bar.update(1)
    recording.save(options.output, 'speeds.json', {
        'ns_per_cpu_day': speeds,
        'ps_per_turn': TIMED,
        'provenance': recording.provenance(options)
    })


# ---- Prices --------------------------------------------------------------------------------------


def memory(components):
    """Autocorrelation time of the mean square of a vector, with its relative standard error.

    The time is in samples. All components of the vector are equivalent. The mean over the
    components' squares is taken: their cross-correlations vanish by symmetry, and leaving their
    noise out makes one run worth three. The standard error is that of Madras and Sokal for three
    independent series.
    """
    found = float(
        np.mean([series.autocorrelationTime(each) for each in (np.asarray(components)**2).T]))
    return found, math.sqrt(2/(3*series.noiseDegrees(found, len(components))))


def report(options):
    """results_price: the tool's result of the energy, and prices.json with the dipole moment's."""
    began = time.perf_counter()
    study, runs = found(options)
    followed = moved(options)
    runs = [
        each for each in runs if each.record.status != measurement.STABLE
        or each.record.length >= options.least or each.key in followed
    ]
    speeds = json.loads((options.output/'speeds.json').read_text())['ns_per_cpu_day']
    study.observables = study.reported
    squares, weights = [], []
    for each in runs:
        record = each.record
        # Speeds are those of ``price.py time``, where all settings took turns.
        record.timings = [(1, 1.0, each.setting.stepSize/1000*measurement.SECONDS_PER_DAY/speed)
                          for speed in speeds.get(each.name, [])]
        each.components = np.array(record.series.pop('components', []))
        if len(each.components):
            square = (each.components**2).sum(axis=1)/216
            squares.append((square.mean(), (square**2).mean()))
            weights.append(len(square))
    study.settingSeed = lambda setting: options.seed
    kept = [(each.setting, each.record) for each in runs
            if each.record.status != measurement.STABLE or each.record.length >= options.least]
    result = study._evaluate(kept, {}, study._provenance(began, max(map(len, speeds.values())), 1))
    result.write(options.output, wanted=WANTED, baseline=options.baseline, price=WANTED)
    # The distribution of M is the same for all correct methods, so its moments are averages over
    # all of them.
    mean, second = np.average(squares, axis=0, weights=weights)
    relativeVariance = second/mean**2 - 1
    energies = {(row['method'], round(1000*row['step_size'], 6)): row
                for row in result.rows if row['observable'] == 'potential_energy'}
    rows = [
        rowOf(each, energies.get(each.key), followed.get(each.key), speeds.get(each.name))
        for each in runs
    ]
    if any(isLong(row) for row in rows):
        share = dipolesShare(rows)
    else:  # a later series of other methods
        published = json.loads((HERE/'results_price'/'prices.json').read_text())
        share = dict(published['dipole_tau_over_reorientation'], source='results_price/prices.json')
        mean, relativeVariance = (published[name]
                                  for name in ('dipole_squared', 'dipole_relative_variance'))
    for row in rows:
        if 'reorientation_ps' in row:
            length = 2*share['ratio']*row['reorientation_ps']*relativeVariance/WISH**2
            row.update(
                dipole_ns=length/1000, dipole_hours=length/1000/row['ns_per_cpu_day']*24,
                dipole_hours_relative_error=math.hypot(
                    row['reorientation_ps_error']/row['reorientation_ps'],
                    row['speed_relative_error']))
    rows.sort(key=lambda row: (row.get('dipole_hours', math.inf), -row.get('ns_per_cpu_day', 0)))
    recording.save(
        options.output, 'prices.json', {
            'wish': WISH,
            'dipole_squared': mean,
            'dipole_relative_variance': relativeVariance,
            'dipole_tau_over_reorientation': share,
            'ratios': ratios(rows),
            'sample_interval_ps': SAMPLE_INTERVAL,
            'equilibration_ps': EQUILIBRATION,
            'seed': options.seed,
            'rows': rows,
            'provenance': recording.provenance(options)
        })
    print(share, mean, relativeVariance, ratios(rows))
    table(rows)
    picture(rows, options.output/'price.png')


def rowOf(each, energy, motion, speeds):
    """The row of a setting in prices.json."""
    record = each.record
    row = {
        'method': each.key[0],
        'step_fs': each.key[1],
        'status': record.status,
        'message': record.message,
        'length_ps': record.length + (motion['length_ps'] if motion else 0)
    }
    if record.status != measurement.STABLE:
        return row
    pairs = ([(energy['mean'], energy['standard_error'])] if energy else []) + ([
        (motion['energy'], motion['energy_error'])
    ] if motion and 'energy' in motion else [])
    row.update(
        energyOf(pairs) if pairs else {}, ns_per_cpu_day=float(np.median(speeds)),
        speed_relative_error=float(np.std(speeds, ddof=1)/math.sqrt(len(speeds))/np.median(speeds)),
        dipole_length_ps=record.length)
    if energy:
        tau, error = memory(each.components)
        tau *= record.samplesAt
        row.update(energy_tau_ps=energy['own_tau'], energy_tau_error_ps=energy['own_tau_error'],
                   dipole_tau_ps=tau, dipole_tau_error_ps=tau*error)
    if motion:
        row.update({
            key: motion[key]
            for key in ('diffusion_nm2_per_ps', 'diffusion_nm2_per_ps_error', 'reorientation_ps',
                        'reorientation_ps_error')
        })
    return row


def energyOf(pairs):
    """Error of the energy in percent, from one or two runs."""
    reference, uncertainty = REFERENCES['potential_energy']
    weights = np.array([error**-2 for _, error in pairs])
    mean = float((weights*[value for value, _ in pairs]).sum()/weights.sum())
    return {
        'energy_percent': 100*(mean - reference)/abs(reference),
        'energy_percent_error': 100*math.hypot(weights.sum()**-0.5, uncertainty)/abs(reference)
    }


def isLong(row):
    return row.get('dipole_length_ps', 0) >= LONG and 'reorientation_ps' in row


def dipolesShare(rows):
    """The autocorrelation time of M^2 over the reorientation time of one dipole.

    Only runs that are long enough for the autocorrelation time count. The ratio is a property of
    the liquid, as long as methods change how fast it moves, not how. The ratio is then better known
    from all methods together than the autocorrelation time from one of them. chi^2 says whether the
    methods agree.
    """
    long = [row for row in rows if isLong(row)]
    values = np.array([row['dipole_tau_ps']/row['reorientation_ps'] for row in long])
    errors = values*[
        math.hypot(row['dipole_tau_error_ps']/row['dipole_tau_ps'],
                   row['reorientation_ps_error']/row['reorientation_ps']) for row in long
    ]
    ratio = (values/errors**2).sum()/(errors**-2).sum()
    return {
        'ratio': ratio,
        'error': (errors**-2).sum()**-0.5,
        'chi2': (((values - ratio)/errors)**2).sum(),
        'of': [[row['method'], row['step_fs']] for row in long],
        'values': values,
        'errors': errors
    }


def ratios(rows):
    """The least price of each kind of method, and what other methods cost against this plugin's.

    Only settings whose energy is right within the wanted error count.
    """
    kinds = {
        'ours': lambda name: name.startswith('LangevinC'),
        'plain': lambda name: re.fullmatch('LangevinMiddle(-g[0-9.]+)?', name),
        'best_of_others': lambda name: name.startswith('LangevinMiddle-H')
    }
    best = {
        kind: min((row for row in rows if isOne(row['method']) and 'dipole_hours' in row
                   and abs(row.get('energy_percent', math.inf)) < 100*WISH),
                  key=lambda row: row['dipole_hours'])
        for kind, isOne in kinds.items()
    }
    return {
        kind: {
            'setting': [row['method'], row['step_fs']],
            'hours': row['dipole_hours'],
            'over_ours': row['dipole_hours']/best['ours']['dipole_hours'],
            'relative_error': math.hypot(row['dipole_hours_relative_error'],
                                         best['ours']['dipole_hours_relative_error']),
            'speed_of_ours': best['ours']['ns_per_cpu_day']/row['ns_per_cpu_day']
        }
        for kind, row in best.items()
    }


def table(rows):
    print(
        '\n| method, step | runs, ns | ns per CPU-day | U, % off | dipoles forget in, ps | D, 10⁻³ '
        'nm²/ps | tau of M², ps | CPU hours to 0.5 % of ⟨M²⟩ |\n|---|---|---|---|---|---|---|---|')
    for row in rows:
        text = f'| {row["method"]}, {row["step_fs"]:g} fs | {row["length_ps"]/1000:.2f} |'
        if row['status'] != measurement.STABLE:
            print(f'{text} {row["message"]} | | | | | |')
            continue
        wasFollowed = 'reorientation_ps' in row
        print(f'{text} {row["ns_per_cpu_day"]:.0f} | ' +
              (f'{row["energy_percent"]:+.2f} ± {row["energy_percent_error"]:.2f} | '
               if 'energy_percent' in row else '| ') +
              (f'{row["reorientation_ps"]:.1f} ± {row["reorientation_ps_error"]:.1f} | '
               f'{1000*row["diffusion_nm2_per_ps"]:.2f} ± '
               f'{1000*row["diffusion_nm2_per_ps_error"]:.2f} | ' if wasFollowed else '| | ') +
              (f'{row["dipole_tau_ps"]:.1f} ± {row["dipole_tau_error_ps"]:.1f} | '
               if row['dipole_length_ps'] >= LONG else '| ') +
              (f'{row["dipole_hours"]:.1f} ± '
               f'{row["dipole_hours"]*row["dipole_hours_relative_error"]:.1f} |'
               if wasFollowed else '|'))


def picture(rows, path):
    """Draw processor hours to 0.5 % of the mean square dipole moment, and errors of energy."""
    plt = recording.pyplot()
    rows = [row for row in rows if 'dipole_hours' in row][::-1]
    colours = ['#d55e00' if row['method'].startswith('LangevinC') else '#0072b2' for row in rows]
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 0.34*len(rows) + 1.6), sharey=True,
                                         gridspec_kw={'width_ratios': [3, 2]})
    hours = np.array([row['dipole_hours'] for row in rows])
    left.barh(range(len(rows)), hours,
              xerr=hours*[row['dipole_hours_relative_error'] for row in rows], color=colours,
              ecolor='0.2', capsize=2, height=0.7)
    left.set_yticks(range(len(rows)), [f'{row["method"]}, {row["step_fs"]:g} fs' for row in rows])
    left.set_xlim(left=0)
    left.set_xlabel('processor hours to a standard error of 0.5 % of ⟨M²⟩')
    for k, row in enumerate(rows):
        if 'energy_percent' not in row:
            continue
        right.errorbar(row['energy_percent'], k, xerr=row['energy_percent_error'], fmt='o',
                       color=colours[k], capsize=2)
    right.axvspan(-100*WISH, 100*WISH, color='0.9', zorder=0)
    right.axvline(0, color='0.6', lw=0.8, zorder=0)
    right.set_xlabel('error of the potential energy, %')
    figure.suptitle(
        '216 TIP4P-Ew molecules, one thread: the plugin (orange), OpenMM (blue); bars: one '
        'standard error', fontsize=10)
    figure.tight_layout()
    figure.savefig(path, dpi=110)
    plt.close(figure)
    print(f'wrote {path}')


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('what', choices=['run', 'motion', 'time', 'report'])
    parser.add_argument('--series', choices=SERIES, default='scout')
    parser.add_argument('--methods', nargs='+', metavar='NAME:STEPS',
                        help='methods and steps instead of a series, e.g. LangevinC-I8:14,16 (fs)')
    parser.add_argument('--length', type=float, default=100,
                        help='ps for each setting, including what it has already (100)')
    parser.add_argument('--rounds', type=int, default=11,
                        help='rounds in which speeds are measured (11)')
    parser.add_argument('--least', type=float, default=55,
                        help='shorter runs than this are left out of times and report, ps (55)')
    parser.add_argument('--baseline', default='LangevinMiddle',
                        help='method that speeds of the report are relative to')
    parser.add_argument('--seed', type=int, default=2031)
    parser.add_argument('--output', type=pathlib.Path, default=HERE/'results_price')
    campaign.addOptions(parser)
    options = campaign.settle(parser.parse_args())
    {'run': run, 'motion': motion, 'time': clockSpeeds, 'report': report}[options.what](options)


if __name__ == '__main__':
    main()
