#!/usr/bin/env python3
"""Rods between slip walls (Westwood 2022, section 6.3): dynamics against Monte Carlo.

Heights and angles from dynamics are compared with those from Monte Carlo of the same model.

    python3 rods.py                     # Monte Carlo, then dynamics from its states, at a quarter
                                        # of the paper's area: an hour or two on one core
    python3 rods.py --long 2 --jobs 8   # twice the sweeps, twice the runs, eight at a time;
                                        # existing runs go on
    python3 rods.py --full              # the paper's size, up to 256 rods: times of steps and a
                                        # short run; --steps 10000 is the paper's length
    python3 rods.py --quick             # seconds
    python3 rods.py --report            # tables and pictures again, from what is saved
"""
import argparse
import pathlib
import sys
import time
import zlib

import numpy as np

HERE = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent/'common')]
import campaign  # noqa: E402
import model  # noqa: E402
import montecarlo  # noqa: E402
import pictures  # noqa: E402
from recording import brackets, provenance, save  # noqa: E402

RESULTS = HERE/'results'
SEED = 2022
BINS_Y = {8: 24, 4: 32, 2: 48}  # of |y - Ly/2|, from 0 to Ly/2
BINS_THETA = 45  # of two degrees
#: Means of a configuration, each a number for each rod; their names in tables.
MEANS = {
    'theta': '⟨θ⟩',
    'off': '⟨\\|y − Ly/2\\|⟩/a',
    'walls': 'wall energy a rod/kT',
    'pairs': 'pair energy a rod/kT'
}
FRAME = 30  # steps between frames: tau/20
SEGMENT = 300  # steps whose histograms are saved together: tau/2
TOLERANCE = 1e-3
#: (L/Ly, cut-off): systems, sweeps, sweeps before anything is counted; runs of dynamics, steps of
#: each run.
PLANS = {
    (8, 6.0): (32, 5000, 2000, 12, 1500),
    (4, 6.0): (24, 4500, 2500, 8, 900),
    (2, 6.0): (16, 2300, 1800, 3, 900),
    (8, 4.0): (16, 3000, 1200, 0, 0),
    (8, 3.0): (32, 3500, 1500, 3, 900),
    (4, 3.0): (24, 2000, 1000, 0, 0),
    (2, 3.0): (16, 1000, 500, 0, 0)
}
CHUNK = 100  # sweeps that are saved together
SAMPLE = 5  # sweeps between samples
FEWEST_TRUSTED = 10  # runs from whose spread errors are taken


def edges(scene):
    return np.linspace(0, scene.width/2,
                       BINS_Y[scene.fraction] + 1), np.linspace(0, np.pi/2, BINS_THETA + 1)


def histograms(scene, R, q):
    """Counts (systems, bins) of |y - Ly/2| and of theta, of R (systems, rods, 3)."""
    def counts(values, bounds):
        k = np.clip(np.searchsorted(bounds, values, side='right') - 1, 0, len(bounds) - 2)
        return np.stack([np.bincount(row, minlength=len(bounds) - 1) for row in k])

    y, theta = edges(scene)
    return counts(np.abs(R[..., 1] - scene.width/2), y), counts(model.angles(q), theta)


def seedOf(*words):
    return SEED + zlib.crc32(' '.join(map(str, words)).encode()) % 1000000007


# ---- Monte Carlo ---------------------------------------------------------------------------------
class Chains:
    """Independent Monte Carlo systems of a Scene, saved in a directory.

    Half of them begin with flat rods, half at random. Arrays are by chunk and system: y and theta
    (counts), means (see MEANS), all of what was counted.
    """
    def __init__(self, scene, directory, systems, burnIn):
        self.scene, self.kept, self.count, self.burnIn = scene, campaign.State(
            directory, scene.name), systems, burnIn
        self.y, self.theta, self.means = [], [], []
        self.sweeps, self.seconds, self.state, self.acceptance = 0, 0.0, None, {}

    def load(self):
        burnIn, kept = self.burnIn, self.kept.load()
        if not kept:
            return False
        self.y, self.theta, self.means = list(kept['y']), list(kept['theta']), list(kept['means'])
        self.state = {key: kept[key] for key in ('R', 'q', 'sizes')}
        self.sweeps, self.seconds, self.burnIn = int(kept['sweeps']), float(kept['seconds']), int(
            kept['burnIn'])
        self.acceptance = dict(zip(montecarlo.MOVES, kept['acceptance'].tolist()))
        # A burn-in that is longer than before removes the first of the counted chunks.
        while self.burnIn < burnIn and self.means:
            self.burnIn += CHUNK
            for counted in (self.y, self.theta, self.means):
                del counted[0]
        self.count = len(self.state['R'])
        return True

    def save(self):
        self.kept.save(y=np.array(self.y,
                                  np.int32), theta=np.array(self.theta,
                                                            np.int32), means=np.array(self.means),
                       sweeps=self.sweeps, seconds=self.seconds, burnIn=self.burnIn,
                       acceptance=[self.acceptance[kind]
                                   for kind in montecarlo.MOVES], **self.state)

    def run(self, sweeps, report):
        """Continue to this number of sweeps."""
        if self.sweeps >= sweeps:
            return
        random = np.random.default_rng(seedOf('mc', self.scene.name, self.sweeps))
        if self.state is None:
            half = self.count // 2
            R, q = (
                np.concatenate(parts)
                for parts in zip(montecarlo.starts(self.scene, half, True, random),
                                 montecarlo.starts(self.scene, self.count - half, False, random)))
            systems = montecarlo.Systems(self.scene, R, q, random)
        else:
            systems = montecarlo.Systems(self.scene, self.state['R'], self.state['q'], random)
            for kind, size in zip(montecarlo.ADAPTED, self.state['sizes']):
                systems.steps[kind].sizes[:] = size
        chunk = min(CHUNK, self.burnIn)
        while self.sweeps < sweeps:
            began, counted = time.time(), self.sweeps >= self.burnIn
            rows = []
            for k in range(chunk):
                # Sizes change in the first half of the burn-in only.
                systems.sweep(adapt=self.sweeps < self.burnIn // 2)
                if counted and (k + 1) % SAMPLE == 0:
                    n = self.scene.rods
                    rows.append((*histograms(self.scene, systems.R, systems.q),
                                 np.stack([
                                     model.angles(systems.q).mean(1),
                                     np.abs(systems.R[..., 1] - self.scene.width/2).mean(1),
                                     systems.walls.sum(1)/n,
                                     systems.pairs.sum((1, 2))/(2*n)
                                 ], axis=1)))
            if counted:
                y, theta, means = zip(*rows)
                self.y.append(np.sum(y, 0))
                self.theta.append(np.sum(theta, 0))
                self.means.append(np.mean(means, 0))
            self.sweeps += chunk
            self.seconds += time.time() - began
            self.state = {
                'R': systems.R,
                'q': systems.q,
                'sizes': np.array([systems.steps[kind].sizes[0] for kind in montecarlo.ADAPTED])
            }
            self.acceptance = {
                kind: systems.accepted[kind]/max(1, systems.tried[kind])
                for kind in montecarlo.MOVES
            }
            self.save()
            report(self.sweeps)

    def spread(self):
        """The scatter of short runs, better known from these systems than from a few runs.

        First come the standard deviations of the means of one system over CHUNK sweeps. Then come
        the probabilities (systems, bins) of y and theta of single configurations, which scatter
        more than averages over time.
        """
        return np.concatenate(self.means).std(0), *(
            counts/self.scene.rods
            for counts in histograms(self.scene, self.state['R'], self.state['q']))

    def summary(self):
        """Densities and means with standard errors, and the means of two halves.

        Errors come from the spread of the systems. Halves are of the time, and flat and random
        starts.
        """
        found = {
            'systems': self.count,
            'sweeps': self.sweeps,
            'burn_in': self.burnIn,
            'seconds': self.seconds,
            'acceptance': self.acceptance,
            'sizes': dict(zip(montecarlo.ADAPTED, self.state['sizes'])),
            'means': {},
            'first_and_second_half_of_time': {},
            'flat_and_random_starts': {}
        }
        means = np.array(self.means)
        half = self.count // 2
        for k, name in enumerate(MEANS):
            mine = means[:, :, k].mean(0)
            found['means'][name] = meanAndError(mine)
            found['flat_and_random_starts'][name] = [
                meanAndError(mine[:half]), meanAndError(mine[half:])
            ]
            found['first_and_second_half_of_time'][name] = [
                meanAndError(part.mean(0)) for part in np.array_split(means[:, :, k], 2)
            ] if len(means) > 1 else None
        for name, counts, bounds in zip(('y', 'theta'), (self.y, self.theta), edges(self.scene)):
            total = np.sum(counts, 0)
            P = total/total.sum(1, keepdims=True)
            found[name] = {
                'edges': bounds,
                'P': P.mean(0),
                'error': P.std(0, ddof=1)/np.sqrt(len(P))
            }
        return found


def meanAndError(values):
    """Mean of independent values and its standard error."""
    values = np.asarray(values, float)
    return [values.mean(), values.std(ddof=1)/np.sqrt(len(values)) if len(values) > 1 else np.nan]


def monteCarlo(argument, job):
    """Continue the Chains of a scene until they have this number of sweeps."""
    fraction, cutoff, part, systems, burnIn, sweeps = argument
    chains = Chains(model.Scene(fraction, cutoff, part), job.directory, systems, burnIn)
    if chains.load() and chains.count != systems:
        raise ValueError(
            f'{chains.kept.path}: it has {chains.count} systems, where {systems} are asked for; it '
            'cannot go on with these: give another --work, or --fresh to begin all anew')
    chains.run(sweeps, job.report)
    return {'sweeps': chains.sweeps}


def chainsOf(scene, folder):
    """The Chains that a folder has; an error if there are none."""
    chains = Chains(scene, folder/f'mc_{scene.name}', 0, 0)
    if not chains.load():
        raise FileNotFoundError(
            f'{chains.kept.path}: it is not there; dynamics start from its states: make the Monte '
            f'Carlo runs first, without --only and --full')
    return chains


# ---- Dynamics ------------------------------------------------------------------------------------
def configurationMeans(scene, R, q):
    """The MEANS of one configuration."""
    one = montecarlo.Systems(scene, R[None], q[None], np.random.default_rng(0))
    return [
        model.angles(q).mean(),
        np.abs(R[:, 1] - scene.width/2).mean(),
        one.walls.sum()/scene.rods,
        one.pairs.sum()/(2*scene.rods)
    ]


def stemOf(scene, scheme, scaling, step):
    """The beginning of the names of the scene's runs."""
    return (f'runs_{scene.name}' + ('' if scheme == 'DriftCorrectorFD' else f'_{scheme}') +
            ('' if scaling == 'Whole' else f'_{scaling}') +
            ('' if step == model.STEP else f'_step{step/model.STEP:g}'))


def dynamics(argument, job):
    """One run of dynamics, until it has this number of steps.

    Its Monte Carlo system is in a folder beside it.
    """
    fraction, cutoff, part, scheme, scaling, coarser, number, steps = argument
    scene, step = model.Scene(fraction, cutoff, part), coarser*model.STEP
    run = Run(scene, job.directory, stemOf(scene, scheme, scaling, step), number)
    if not run.load():
        run.begin(chainsOf(scene, pathlib.Path(job.directory).parent))
    run.go(steps, scheme, scaling, step, job.report)
    return {'segments': len(run.arrays['means'])}


class Run:
    """One run of dynamics, from the state of one Monte Carlo system; saved in a directory.

    Arrays: y and theta (counts) and means by segment, the same of the start, and the present poses.
    """

    ARRAYS = ('y', 'theta', 'means', 'y0_', 'theta0_', 'means0_', 'R', 'q')

    def __init__(self, scene, directory, stem, number):
        self.scene, self.stem, self.number, self.kept = scene, stem, number, campaign.State(
            directory, (stem, number))
        self.arrays, self.seconds, self.redone, self.track = {}, 0.0, 0, []

    def load(self):
        kept = self.kept.load()
        if not kept:
            return False
        self.arrays = {key: kept[key] for key in self.ARRAYS}
        self.seconds, self.redone, self.track = float(kept['seconds']), int(kept['redone']), list(
            kept['track'])
        return True

    def begin(self, chains):
        # Flat and random starts take turns.
        start = (self.number % 2)*(chains.count // 2) + self.number // 2
        R, q = chains.state['R'][start].copy(), chains.state['q'][start].copy()
        y, theta = histograms(self.scene, R[None], q[None])
        self.arrays = {
            'y': np.empty((0, y.shape[1]), int),
            'theta': np.empty((0, theta.shape[1]), int),
            'means': np.empty((0, len(MEANS))),
            'y0_': y[0],
            'theta0_': theta[0],
            'means0_': np.array(configurationMeans(self.scene, R, q)),
            'R': R,
            'q': q
        }

    def go(self, steps, scheme, scaling, step, report):
        """Continue until there are so many steps."""
        segments, run = -(-steps // SEGMENT), self.arrays
        if len(run['means']) >= segments:
            return
        rods = model.Rods(self.scene, scheme, scaling, step, TOLERANCE,
                          seedOf(self.stem, self.number, len(run['means'])) % 2**31)
        rods.place(run['R'], run['q'])
        every, frames = round(FRAME*model.STEP/step), min(SEGMENT, steps) // FRAME
        for _ in range(len(run['means']), segments):
            began, before, rows = time.time(), rods.integrator.getNumRejectedSteps(), []
            for _ in range(frames):
                rods.integrator.step(every)
                R, q = rods.poses()
                rows.append((*[counts[0] for counts in histograms(self.scene, R[None], q[None])],
                             configurationMeans(self.scene, R, q)))
                if self.number == 0:
                    self.track.append(np.concatenate([R, q], axis=1).astype(np.float32))
            y, theta, means = zip(*rows)
            run['y'], run['theta'] = np.vstack([run['y'], np.sum(y, 0)]), np.vstack(
                [run['theta'], np.sum(theta, 0)])
            run['means'] = np.vstack([run['means'], np.mean(means, 0)])
            run['R'], run['q'] = R, q
            self.seconds += time.time() - began
            self.redone += rods.integrator.getNumRejectedSteps() - before
            self.kept.save(seconds=self.seconds, redone=self.redone, track=np.array(self.track),
                           **run)
            report(len(run['means']))


class Runs:
    """All runs of dynamics of a scene with one scheme and step that a folder has."""
    def __init__(self, scene, folder, scheme='DriftCorrectorFD', scaling='Whole', step=model.STEP):
        self.scene, self.scheme, self.scaling, self.step = scene, scheme, scaling, step
        stem = stemOf(scene, scheme, scaling, step)
        numbers = sorted(
            int(path.parent.name[len(stem) + 1:]) for path in folder.glob(f'{stem}_*/state.npz')
            if path.parent.name[len(stem) + 1:].isdigit())
        runs = [Run(scene, folder/f'{stem}_{number}', stem, number) for number in numbers]
        self.track = []
        for run in runs:
            run.load()
            self.track = self.track or run.track
        self.runs = [run.arrays for run in runs]
        self.seconds, self.redone = sum(run.seconds for run in runs), sum(run.redone
                                                                          for run in runs)

    def summary(self, reference, chains):
        """Densities, means, their changes since the start, and differences from Monte Carlo.

        Standard errors come from the spread of the runs. This spread is hardly known from fewer
        than FEWEST_TRUSTED runs. Then Chains.spread() is taken where it is larger. For densities it
        is an upper bound.
        """
        runs = self.runs
        spread = dict(zip(('means', 'y', 'theta'), chains.spread()))
        if len(runs) >= FEWEST_TRUSTED:
            spread = {name: np.zeros_like(values) for name, values in spread.items()}
        times = [round(run['y'].sum()/self.scene.rods)*FRAME*model.STEP for run in runs]
        steps = [round(t/self.step) for t in times]
        found = {
            'scheme': self.scheme,
            'scaling': self.scaling,
            'step_over_tau': self.step,
            'runs': len(runs),
            'steps': steps,
            'time_of_a_run_over_tau': times,
            'seconds': self.seconds,
            'redone_steps': self.redone,
            'ms_a_step': 1e3*self.seconds/sum(steps),
            'tolerance': TOLERANCE,
            'means': {},
            'changes': {}
        }
        for k, name in enumerate(MEANS):
            mean = meanAndError([run['means'][:, k].mean() for run in runs])
            mean[1] = max(mean[1], spread['means'][k]/np.sqrt(len(runs)))
            change = meanAndError([run['means'][:, k].mean() - run['means0_'][k] for run in runs])
            found['means'][name] = {
                'mean': mean[0],
                'error': mean[1],
                'z': separation(mean, reference['means'][name])
            }
            found['changes'][name] = {
                'mean': change[0],
                'error': change[1],
                'z': change[0]/change[1]
            }
        for name in ('y', 'theta'):
            P = np.array([run[name].sum(0)/run[name].sum() for run in runs])
            first = np.array([run[f'{name}0_']/run[f'{name}0_'].sum() for run in runs])
            found[name] = {
                'edges': reference[name]['edges'],
                'P': P.mean(0),
                'error': np.maximum(P.std(0, ddof=1), spread[name].std(0))/np.sqrt(len(P)),
                'against_monte_carlo': compare(P, reference[name], spread[name]),
                'change': compare(P - first, reference[name])
            }
        return found


def separation(mine, other):
    """Difference of two means over its standard error."""
    return (mine[0] - other[0])/np.hypot(mine[1], other[1])


LEAST_IN_BIN = 0.05  # bins are merged to hold this much before they are compared


def compare(runs, reference, spread=None):
    """Each run's probabilities against the reference's, in bins of at least LEAST_IN_BIN.

    Without the spread of single systems, `runs` are changes of probabilities, and are compared with
    0. Bins are merged to hold at least LEAST_IN_BIN. Neighbouring bins are correlated, so the mean
    of z^2 scatters widely about 1. The mean of z^2 of changes, whose errors are known from n runs
    only, scatters about (n - 1)/(n - 3).
    """
    p = reference['P']
    first, held = [0], 0.0
    for k, value in enumerate(p):
        if held >= LEAST_IN_BIN and p[k:].sum() >= LEAST_IN_BIN:
            first.append(k)
            held = 0.0
        held += value
    merged = np.add.reduceat(runs, first, axis=1)
    error2, exact = merged.var(0, ddof=1)/len(runs), 0.0
    if spread is not None:
        exact = np.add.reduceat(p, first)
        error2 = np.maximum(error2,
                            np.add.reduceat(spread, first, axis=1).var(0)/
                            len(runs)) + np.add.reduceat(reference['error']**2, first)
    z = (merged.mean(0) - exact)/np.sqrt(np.maximum(error2, 1e-30))
    return {
        'bins': len(z),
        'z': z,
        'mean_z2': np.mean(z**2),
        'largest_z': np.abs(z).max(),
        'expected_mean_z2': 1.0 if spread is not None else
        (len(runs) - 1)/(len(runs) - 3) if len(runs) > 3 else None
    }


# ---- The paper's size ----------------------------------------------------------------------------
def fullSize(argument, job):
    """Steps of the paper's number of rods: ms a step, and how far the means move.

    The start is the reduced system's state, repeated in x and z.
    """
    fraction, steps = argument
    small, scene = model.Scene(fraction, 6.0), model.Scene(fraction, 6.0, 1.0)
    chains = chainsOf(small, pathlib.Path(job.directory).parent)
    offsets = np.array([(x, 0, z) for x in (0, small.side) for z in (0, small.side)])
    R = (chains.state['R'][0] % (small.side, np.inf, small.side) + offsets[:, None]).reshape(-1, 3)
    q = np.tile(chains.state['q'][0], (4, 1))
    rods = model.Rods(scene, tolerance=TOLERANCE, seed=SEED)
    rods.place(R, q)
    before = configurationMeans(scene, R, q)
    rods.integrator.step(2)
    done, began, used = dict(rods.integrator.getStepStatistics()), time.time(), time.process_time()
    for k in range(steps):
        rods.integrator.step(1)
        job.report(k + 1)
    seconds, used = time.time() - began, time.process_time() - used
    now = rods.integrator.getStepStatistics()
    after = configurationMeans(scene, *rods.poses())
    return {
        **scene.describe(), 'steps': steps,
        'ms_a_step': 1e3*seconds/steps,
        'processor_ms_a_step': 1e3*used/steps,
        'processor_hours_of_the_papers_10000_steps': used/steps*10000/3600,
        'iterations_a_step': (now['solverIterations'] - done['solverIterations'])/steps,
        'redone_steps': rods.integrator.getNumRejectedSteps(),
        'fluid': str(rods.integrator.getEffects()['hydrodynamics']),
        'tolerance': TOLERANCE,
        'means_before_and_after': {name: [before[k], after[k]]
                                   for k, name in enumerate(MEANS)}
    }


# ---- One rod -------------------------------------------------------------------------------------
def ownMobilities(fraction, part=0.5):
    """Mobilities of one rod alone that lies along x, at several heights.

    Heights go from where a wall holds the rod to the middle. Mobilities are those along x, y, z and
    of turns about x, y, z, in units of 1/(6 pi eta a) and 1/(6 pi eta a^3). Without the stochastic
    drift a rod would be found at y as often as exp(-U/kT)/mobility_yy.
    """
    scene = model.Scene(fraction, 6.0, part)
    scene.rods = 1
    rods = model.Rods(scene, solver=model.MobilityForce.Dense, platform='Reference')
    turn = np.array([(np.sqrt(0.5), 0, np.sqrt(0.5), 0)])
    rows = []
    for y in np.linspace(2.5, scene.width/2, 8):
        rods.place(np.array([(0, y, 0)]), turn)
        rows.append([y, *np.diag(rods.fluid.getMobilityInContext(rods.context))])
    return np.array(rows)


# ---- All of it -----------------------------------------------------------------------------------
def report(folder, args, plans):
    """Write the JSON and the pictures, from what --work has."""
    data = {
        'model': {
            'beads_of_a_rod': len(model.SITES),
            'rod_length': 2*(model.HALF_LENGTH + 1),
            'K': model.WALL_STIFFNESS,
            'wall_range': model.WALL_RANGE,
            'U0': model.PAIR_STRENGTH,
            'pair_range': model.PAIR_RANGE,
            'step_over_tau': model.STEP,
            'units': 'a = 1, kT = 1, tau = 6 pi eta a^3/kT'
        },
        'seed': SEED,
        'least_in_bin': LEAST_IN_BIN,
        'scenes': []
    }
    tracks = {}
    for (fraction, cutoff), (systems, _, burnIn, _, _) in plans.items():
        scene = model.Scene(fraction, cutoff, args.part)
        chains = Chains(scene, args.work/f'mc_{scene.name}', systems, burnIn)
        if not chains.load() or not chains.means:
            continue
        entry = {**scene.describe(), 'monte_carlo': chains.summary(), 'dynamics': []}
        for scheme in ('DriftCorrectorFD', 'EulerMaruyama'):
            for scaling in ('Whole', 'SlipOnly'):
                for step in (1, 2, 3, 5):
                    runs = Runs(scene, args.work, scheme, scaling, step*model.STEP)
                    if len(runs.runs) > 1:
                        entry['dynamics'].append(runs.summary(entry['monte_carlo'], chains))
                        tracks.setdefault((fraction, cutoff), runs.track)
        data['scenes'].append(entry)
    data['own_mobilities'] = {
        f'L/{fraction}': ownMobilities(fraction, args.part)
        for fraction in {f
                         for f, _ in plans}
    }
    data['provenance'] = provenance(args)
    save(folder, 'rods.json', data)
    pictures.draw(data, folder/'rods.png')
    if (4, 6.0) in tracks:
        pictures.animation(model.Scene(4, 6.0, args.part), tracks[4, 6.0], folder/'rods.gif')
    print('\n'.join(tables(data)))
    return data


PAPERS = 'gDC, τ/600'


def variant(run):
    """The name of a run of the dynamics in tables."""
    scheme = {
        'DriftCorrectorFD': 'gDC',
        'EulerMaruyama': 'Euler–Maruyama'
    }.get(run['scheme'], run['scheme'])
    scaling = '' if run['scaling'] == 'Whole' else ' ' + run['scaling']
    return f'{scheme}{scaling}, τ/{1/run["step_over_tau"]:.0f}'


def tables(data):
    """Lines of the tables in Markdown."""
    yield ('| Ly | cut-off/a | | Monte Carlo | flat starts | random starts | dynamics | z | '
           'change since the start | z |')
    yield '|---'*10 + '|'
    for scene in data['scenes']:
        mc = scene['monte_carlo']
        for name, called in MEANS.items():
            flat, anyhow = mc['flat_and_random_starts'][name]
            row = (f'| L/{round(1/scene["width_over_L"])} | {scene["cutoff"]:g} | {called} | '
                   f'{brackets(*mc["means"][name])} | {brackets(*flat)} | {brackets(*anyhow)} |')
            for run in scene['dynamics'] or [None]:
                if run is None:
                    yield row + ' | | | |'
                    continue
                mean, change = run['means'][name], run['changes'][name]
                label = '' if variant(run) == PAPERS else f' ({variant(run)})'
                yield (row +
                       f' {brackets(mean["mean"], mean["error"])}{label} | {mean["z"]:+.1f} | '
                       f'{brackets(change["mean"], change["error"])} | {change["z"]:+.1f} |')
    yield ''
    yield (
        '| Ly | cut-off/a | rods | scheme | runs × time/τ | redone steps | ms a step | y: bins | '
        'mean z² | largest \\|z\\| | change: mean z² (expected) | θ: bins | mean z² '
        '| largest \\|z\\| | change: mean z² (expected) |')
    yield '|---'*15 + '|'
    for scene in data['scenes']:
        for run in scene['dynamics']:
            cells = [
                f'L/{round(1/scene["width_over_L"])}', f'{scene["cutoff"]:g}',
                str(scene['rods']),
                variant(run), f'{run["runs"]} × {np.mean(run["time_of_a_run_over_tau"]):.3g}',
                str(run['redone_steps']), f'{run["ms_a_step"]:.0f}'
            ]
            for name in ('y', 'theta'):
                found, change = run[name]['against_monte_carlo'], run[name]['change']
                expected = change['expected_mean_z2']
                expected = format(expected, '.1f') if expected else '–'
                cells += [
                    str(found['bins']), f'{found["mean_z2"]:.2f}', f'{found["largest_z"]:.1f}',
                    f'{change["mean_z2"]:.1f} ({expected})'
                ]
            yield '| ' + ' | '.join(cells) + ' |'


def makeRuns(plans, args):
    """Make Monte Carlo runs of all scenes, then dynamics from their states."""
    scenes = {key: model.Scene(*key, args.part) for key in plans}
    if args.only != 'dynamics':
        todo = [(*key, args.part, systems, burnIn, round(sweeps*args.long))
                for key, (systems, sweeps, burnIn, _, _) in plans.items()]
        campaign.run(monteCarlo, todo, [f'mc_{scenes[task[:2]].name}' for task in todo], args,
                     [task[5] for task in todo], 'sweep', 'Monte Carlo')
    if args.only != 'mc':
        todo = []
        for key, (systems, _, _, runs, steps) in plans.items():
            wanted = round((runs if args.runs is None else args.runs)*args.long)
            if wanted > systems:
                raise SystemExit(
                    f'{scenes[key].name}: {wanted} runs want as many Monte Carlo systems to start '
                    f'from, and there are {systems}: give a smaller --long, or more systems')
            todo += [(*key, args.part, args.scheme, args.scaling, args.coarser, number, steps)
                     for number in range(wanted)]
        names = [
            f'{stemOf(scenes[task[:2]], *task[3:5], task[5]*model.STEP)}_{task[6]}' for task in todo
        ]
        campaign.run(dynamics, todo, names, args, [-(-task[7] // SEGMENT) for task in todo],
                     'segment', 'dynamics')


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--quick', action='store_true',
                        help='few sweeps and steps of the narrowest channel: seconds')
    parser.add_argument('--full', action='store_true',
                        help="time steps of the paper's size, from states of the reduced size")
    parser.add_argument('--steps', type=int, default=20, help='steps of --full (%(default)s)')
    parser.add_argument('--part', type=float, default=0.5,
                        help="side of the box over the paper's (%(default)s)")
    parser.add_argument('--long', type=float, default=1,
                        help='multiply sweeps and runs of the table PLANS by this')
    parser.add_argument('--widths', type=int, nargs='+', default=[8, 4, 2], choices=[8, 4, 2],
                        help='widths of the channel, as L/Ly')
    parser.add_argument('--cutoffs', type=float, nargs='+', default=[6.0, 4.0, 3.0],
                        help='cut-offs of the pair potential, a')
    parser.add_argument('--only', choices=['mc', 'dynamics'], help='leave out the other part')
    parser.add_argument(
        '--scheme', default='DriftCorrectorFD',
        help='scheme of the dynamics (%(default)s); EulerMaruyama leaves out the drift')
    parser.add_argument('--scaling', default='Whole', choices=['Whole', 'SlipOnly'],
                        help="scaling by the drift-corrector; Whole is the paper's (%(default)s)")
    parser.add_argument('--coarser', type=int, default=1, choices=[1, 2, 3, 5],
                        help="step of the dynamics, times the paper's (%(default)s)")
    parser.add_argument('--runs', type=int, help='runs of dynamics, instead of those of PLANS')
    parser.add_argument('--report', action='store_true', help='make no runs')
    parser.add_argument('--silent', action='store_true', help='no progress bars')
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    campaign.addOptions(parser)
    args = campaign.settle(parser.parse_args())
    plans = {
        key: plan
        for key, plan in PLANS.items() if key[0] in args.widths and key[1] in args.cutoffs
    }
    if args.quick:
        plans = {(8, 6.0): (8, 30, 10, 2, 60)}
    if args.full:
        rows = campaign.run(fullSize, [(fraction, args.steps) for fraction in args.widths],
                            [f'rods full L{fraction}' for fraction in args.widths], args,
                            [args.steps]*len(args.widths), 'step', "the paper's size")
        for row in rows:
            print(f'{row["rods"]} rods: {row["ms_a_step"]:.0f} ms a step, '
                  f'{row["processor_ms_a_step"]:.0f} of the processor')
        save(args.output, 'rods_full.json', {'rows': rows, 'provenance': provenance(args)})
        return
    if not args.report:
        makeRuns(plans, args)
    report(args.output, args, plans if args.quick else PLANS)


if __name__ == '__main__':
    main()
