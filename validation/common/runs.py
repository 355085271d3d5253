"""Runs of replicas of one body: what is counted, errors, when to stop, and how to continue.

A run is made of chunks. Each chunk gives every replica its counts in bins, sums of observables, and
mean square displacements. Sums over chunks are saved in the run's directory with the last poses,
which are the whole state of an overdamped scheme. A later run goes on from there with new random
numbers. Replicas are independent, so errors come from the spread of the replicas' averages,
whatever the correlation in time.
"""
import argparse
import json
import pathlib
import re
import time
import warnings

import numpy as np
import openmm
from scipy.spatial.transform import Rotation
from scipy.stats import f

import campaign
from openmmrigidhi import analysis
from recording import provenance, save
from walls import Replicas

#: The wanted relative standard error of each mean, and the wanted chi^2 per bin of each histogram.
#: A run that does not reach them ends after this many minutes of processor time for each scheme.
WANTED_ERROR, WANTED_CHI2, MINUTES = 0.005, 1.5, 60.0
#: Bins are merged until each holds this much, or neither their errors nor their law are good enough
#: for chi^2.
LEAST_IN_BIN, LEAST_FOR_TEST = 0.01, 0.05


class Plan:
    """The definition of one run: scheme, step, spacing of frames, observables.

    Parameters
    ----------
    body, equilibrium
        the scene and its distribution, whose bins are used
    observables : dict
        name -> (f(heights (k, n), A (k, n, 3, 3)) -> (k, n), exact mean or None)
    msd : dict
        name -> function(R, q, interval, lags) -> MeanSquareDisplacement of one number a lag, by
        replica
    settle : float
        time before anything is counted: replicas start from the Boltzmann distribution, which is
        not that of the scheme
    fluid : dict, optional
        boundary, side and bestKnown of Replicas, where they are not the default
    """
    def __init__(self, name, body, equilibrium, scheme, step, every, frames, settle, observables,
                 msd=None, lags=(1,), replicas=64, platform='Reference', seed=2015, labels=None,
                 lateFrom=None, fluid=None):
        self.name, self.body, self.equilibrium = name, body, equilibrium
        self.scheme, self.step = scheme, step
        self.every, self.frames, self.settle, self.observables = every, frames, settle, observables
        self.msd, self.lags, self.replicas, self.platform, self.seed = msd or {}, np.unique(
            np.rint(lags).astype(int)), replicas, platform, seed
        self.labels, self.lateFrom, self.fluid = labels or {}, lateFrom, fluid or {}
        self.edges = {'h': equilibrium.heightEdges, 'theta': equilibrium.thetaEdges}
        self.exact = {'h': equilibrium.heightBins(), 'theta': equilibrium.thetaBins()}

    def settings(self):
        """What must be the same to go on with a run."""
        return json.dumps({
            **self.fluid, 'scheme': self.scheme,
            'step': self.step,
            'every': self.every,
            'frames': self.frames,
            'settle': self.settle,
            'replicas': self.replicas,
            'lags': self.lags.tolist(),
            'observables': list(self.observables),
            'msd': list(self.msd),
            'edges': {k: [len(v), v[0], v[-1]]
                      for k, v in self.edges.items()},
            'body': [self.body.name, self.body.strength,
                     self.body.weights.sum()]
        })


class Tally:
    """Sums over the chunks of a run, by replica."""
    def __init__(self, plan):
        self.plan = plan
        n = plan.replicas
        self.arrays = {
            'positions': np.zeros((n, 3)),
            'orientations': np.zeros((n, 4)),
            'numbers': np.zeros(6),  # chunks, frames, steps, redone steps, seconds, times begun
            'restarted': np.zeros(n, dtype=np.int64)
        }
        for key, edges in plan.edges.items():
            self.arrays['count ' + key] = np.zeros((n, len(edges) - 1), dtype=np.int64)
        for name in plan.observables:
            self.arrays['sum ' + name] = np.zeros(n)
        for name in plan.msd:
            self.arrays['msd ' + name] = np.zeros((n, len(plan.lags)))

    chunks = property(lambda self: self.arrays['numbers'][0])
    frames = property(lambda self: self.arrays['numbers'][1])
    seconds = property(lambda self: self.arrays['numbers'][4])

    def load(self, state):
        """Whether anything was saved."""
        kept = state.load()
        self.arrays.update((key, kept[key]) for key in self.arrays if key in kept)
        return bool(kept)

    def add(self, R, q):
        """A chunk of poses: (frames, replicas, 3) and (frames, replicas, 4)."""
        A = Rotation.from_quat(q.reshape(-1,
                                         4)[:,
                                            [1, 2, 3, 0]]).as_matrix().reshape(q.shape[:2] + (3, 3))
        h, theta = R[..., 2], np.arccos(np.clip(A[..., 2, 2], -1, 1))
        for key, values in (('h', h), ('theta', theta)):
            edges, counts = self.plan.edges[key], self.arrays['count ' + key]
            bins = np.searchsorted(edges, values, side='right') - 1
            for k in range(self.plan.replicas):
                inside = bins[:, k][(bins[:, k] >= 0) & (bins[:, k] < len(edges) - 1)]
                counts[k] += np.bincount(inside, minlength=len(edges) - 1)
        for name, (function, _) in self.plan.observables.items():
            self.arrays['sum ' + name] += function(h, A).sum(0)
        for name, function in self.plan.msd.items():
            blocks = function(R, q, self.plan.every*self.plan.step, self.plan.lags).blocks
            self.arrays['msd ' + name] += np.asarray(getattr(blocks, '_value', blocks))
        self.arrays['numbers'][:2] += 1, len(R)

    def means(self):
        """name -> (mean, standard error, exact or None)."""
        found = {}
        for name, (_, exact) in self.plan.observables.items():
            mine = self.arrays['sum ' + name]/self.frames
            found[name] = (float(mine.mean()), float(mine.std(ddof=1)/np.sqrt(len(mine))), exact)
        return found

    def histogram(self, key):
        """Probabilities of the bins, and standard errors."""
        mine = self.arrays['count ' + key]/self.frames
        return mine.mean(0), mine.std(0, ddof=1)/np.sqrt(len(mine))

    def merged(self, key, least):
        """Each replica's probabilities of merged bins, and the exact ones.

        Bins are merged to hold at least `least`.
        """
        exact, counts = self.plan.exact[key], self.arrays['count ' + key]/self.frames
        starts, held = [0], 0.0
        for k, p in enumerate(exact):
            if held >= least and exact[k:].sum() >= least:
                starts.append(k)
                held = 0.0
            held += p
        return np.add.reduceat(counts, starts, axis=1), np.add.reduceat(exact, starts)

    def significance(self, key):
        """The probability that the exact distribution differs so much from a run of this length.

        All bins are tested together. Neighbouring bins' errors are correlated, so chi^2 per bin
        scatters widely about 1. This is Hotelling's test with the covariance of the bins from the
        replicas, for bins merged to at least LEAST_FOR_TEST. The last bin follows from the others.
        The result is None if there are too few replicas or frames.
        """
        mine, exact = self.merged(key, LEAST_FOR_TEST)
        n, bins = len(mine), len(exact) - 1
        if n <= bins + 1:
            return None
        difference = (mine.mean(0) - exact)[:-1]
        covariance = np.cov(mine[:, :-1].T)/n
        if np.linalg.matrix_rank(covariance) < bins:
            return None
        return float(
            f.sf(difference @ np.linalg.solve(covariance, difference)*(n - bins)/(bins*(n - 1)),
                 bins, n - bins))

    def chi2(self, key):
        """chi^2 per bin against the exact probabilities, and the number of bins.

        Bins are merged to at least LEAST_IN_BIN.
        """
        mine, exact = self.merged(key, LEAST_IN_BIN)
        error = mine.std(0, ddof=1)/np.sqrt(len(mine))
        seen = error > 0
        return float(np.mean(((mine.mean(0) - exact)[seen]/error[seen])**2)), int(seen.sum())

    def displacement(self, name):
        """Mean square displacement by lag, and standard errors."""
        mine = self.arrays['msd ' + name]/self.chunks
        return mine.mean(0), mine.std(0, ddof=1)/np.sqrt(len(mine))

    def lateSlope(self, name, since):
        """Half the slope of a displacement along two axes (a quarter of xx + yy).

        The slope is taken from lags of at least the time `since`. The result is the mean and its
        standard error, or None.
        """
        lag = self.plan.lags*self.plan.step*self.plan.every
        late = lag >= since
        if late.sum() < 2:
            return None
        mine = np.polyfit(lag[late], (self.arrays['msd ' + name][:, late]/self.chunks).T, 1)[0]/4
        return float(mine.mean()), float(mine.std(ddof=1)/np.sqrt(len(mine)))

    def l2(self, key):
        """Distance of the density from the exact one, sqrt(integral (p - p0)^2).

        The result has the distance as it is, the part that noise makes, and the distance without
        it.
        """
        P, error = self.histogram(key)
        width = np.diff(self.plan.edges[key])
        total, noise = np.sum((P - self.plan.exact[key])**2/width), np.sum(error**2/width)
        return float(np.sqrt(total)), float(np.sqrt(noise)), float(np.sqrt(max(0.0, total - noise)))

    def worstError(self):
        """The largest relative standard error of the means."""
        return max(abs(error/mean) for mean, error, _ in self.means().values())

    def reached(self):
        """Whether the wanted errors are reached, and whether the bins agree."""
        return self.worstError() <= WANTED_ERROR, all(
            self.chi2(key)[0] <= WANTED_CHI2 for key in self.plan.edges)


def finished(tally):
    """Whether a run need not go on; bins of Euler-Maruyama can never agree."""
    errors, bins = tally.reached()
    return errors and (bins or tally.plan.scheme == 'EulerMaruyama')


def restart(replicas, tally, bodies, random):
    """Give these replicas new poses of the Boltzmann distribution, at their present x and y."""
    R, q = replicas.poses()
    fresh = tally.plan.equilibrium.draw(random, len(bodies))
    R[bodies, 2], q[bodies] = fresh[0][:, 2], fresh[1]
    replicas.place(R, q)
    tally.arrays['restarted'][bodies] += 1


def step(replicas, tally, steps, random):
    """Step all replicas; replicas that are stuck at the wall or far above it begin anew.

    Such replicas are counted. A blob that comes almost into contact is pushed by a force that the
    step cannot resolve: high up, or through the wall on the other side of the body, whatever the
    noise. The papers discard such runs. A replica is far above the wall beyond the height above
    which 1e-9 of the distribution lies.
    """
    try:
        replicas.integrator.step(steps)
    except openmm.OpenMMException as error:
        stuck = re.search(r'\(body (\d+)\).*redone', str(error), re.S)
        if not stuck:
            raise
        restart(replicas, tally, [int(stuck.group(1))], random)
        step(replicas, tally, steps, random)
    thrown = np.flatnonzero(replicas.poses()[0][:, 2] > tally.plan.equilibrium.ceiling)
    if len(thrown):
        restart(replicas, tally, thrown, random)


def run(plan, job, minutes=MINUTES):
    """Run until the wanted errors and chi^2 are reached, or for so many minutes; return the Tally.

    Minutes are of processor time, so that a busy machine makes no run shorter. Minutes before an
    interruption count, too. At least one chunk is made.
    """
    tally, state = Tally(plan), campaign.State(job, plan.settings())
    fresh = not tally.load(state)
    if tally.chunks and (finished(tally) or tally.seconds >= 60*minutes):
        return tally
    numbers = tally.arrays['numbers']
    numbers[5] += 1
    with warnings.catch_warnings():
        replicas = Replicas(plan.body, plan.replicas, plan.scheme, plan.step,
                            seed=plan.seed + 100003*int(numbers[5]), platform=plan.platform,
                            **plan.fluid)
    random = np.random.default_rng(plan.seed + int(numbers[5]))
    if fresh:
        replicas.place(*plan.equilibrium.draw(random, plan.replicas))
    else:
        replicas.place(tally.arrays['positions'], tally.arrays['orientations'])
    began = time.process_time()
    settle = round(plan.settle/plan.step) if fresh else 0

    def advance():
        nonlocal began
        now = time.process_time()
        numbers[4] += now - began
        began = now
        job.report(tally.seconds)

    for _ in range(-(-settle // 1000)):
        step(replicas, tally, min(1000, settle), random)
        advance()
    redone = replicas.integrator.getNumRejectedSteps()
    while not tally.chunks or tally.seconds < 60*minutes:
        R, q = np.empty((plan.frames, plan.replicas, 3)), np.empty((plan.frames, plan.replicas, 4))
        for k in range(plan.frames):
            step(replicas, tally, plan.every, random)
            R[k], q[k] = replicas.poses()
        tally.add(R, q)
        numbers[2] += plan.frames*plan.every
        numbers[3] += replicas.integrator.getNumRejectedSteps() - redone
        redone = replicas.integrator.getNumRejectedSteps()
        tally.arrays['positions'], tally.arrays['orientations'] = R[-1].copy(), q[-1].copy()
        advance()
        state.save(**tally.arrays)
        if finished(tally):
            break
    return tally


def summary(tally):
    """The entry of a run in the JSON."""
    plan, (_, frames, steps, redone, seconds, begun) = tally.plan, tally.arrays['numbers']
    errors, bins = tally.reached()
    found = {
        'scheme': plan.scheme,
        'step': plan.step,
        'replicas': plan.replicas,
        'spacing': plan.step*plan.every,
        'frames': int(frames),
        'steps': int(steps),
        'time_of_all_replicas': steps*plan.step*plan.replicas,
        'settled': plan.settle,
        'seconds': seconds,
        'us_per_step_and_body': 1e6*seconds/((steps + round(plan.settle/plan.step))*plan.replicas),
        'redone_steps': int(redone),
        'redone_per_step_and_body': redone/(steps*plan.replicas),
        'restarted': int(tally.arrays['restarted'].sum()),
        'seed': plan.seed,
        'times_begun': int(begun),
        'platform': plan.platform,
        'worst_relative_error': tally.worstError(),
        'reached_error': errors,
        'reached_chi2': bins,
        'means': {
            name: {
                'mean': m,
                'error': e,
                'exact': x
            }
            for name, (m, e, x) in tally.means().items()
        },
        'histograms': {},
        'msd': {}
    }
    for key, edges in plan.edges.items():
        P, error = tally.histogram(key)
        chi2, count = tally.chi2(key)
        l2 = tally.l2(key)
        found['histograms'][key] = {
            'edges': edges,
            'P': np.round(P, 8),
            'error': np.round(error, 8),
            'exact': np.round(plan.exact[key], 8),
            'chi2_per_bin': chi2,
            'bins_of_chi2': count,
            'significance': tally.significance(key),
            'L2': l2[0],
            'L2_of_noise': l2[1],
            'L2_without_noise': l2[2]
        }
    if plan.lateFrom is not None:
        found['late_slopes'] = {
            name: tally.lateSlope(name, plan.lateFrom)
            for name in plan.msd if name.startswith('parallel')
        }
    for name in plan.msd:
        mean, error = tally.displacement(name)
        found['msd'][name] = {'lag': plan.lags*plan.step*plan.every, 'mean': mean, 'error': error}
    return found


def criterion(entry, minutes=MINUTES):
    """In words: which of the wanted errors and chi^2 a run reached."""
    chi2 = []
    for key, h in entry['histograms'].items():
        p = '–' if h['significance'] is None else format(h['significance'], '.2g')
        chi2.append(f'{"h" if key == "h" else "θ"} χ² {h["chi2_per_bin"]:.1f} p {p}')
    chi2 = ', '.join(chi2)
    error = f'{100*entry["worst_relative_error"]:.2f} %'
    ended = 'both' if entry['reached_error'] and entry['reached_chi2'] else \
        'error' if entry['reached_error'] else 'χ²' if entry['reached_chi2'] else 'neither'
    full = '' if ended == 'both' else f', {entry["seconds"]/60:.1f} of {minutes:.0f} min'
    return f'{ended} ({error}, {chi2}{full})'


def arguments(description, results, add=None):
    """The command line; add(parser) adds further options of a script."""
    parser = argparse.ArgumentParser(description=description,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--quick', action='store_true', help='one chunk of few replicas: seconds')
    parser.add_argument(
        '--minutes', type=float, default=MINUTES,
        help='end a run after so much processor time, that before an interruption included '
        '(%(default)s)')
    parser.add_argument('--keep', action='store_true',
                        help='runs of the JSON in --output that are not made again stay in it')
    parser.add_argument('--schemes', nargs='+', help='run only these')
    parser.add_argument('--seed', type=int, default=2015)
    parser.add_argument('--output', type=pathlib.Path, default=results)
    campaign.addOptions(parser)
    if add:
        add(parser)
    return campaign.settle(parser.parse_args())


def plansOfCases(quick, seed, name, cases, usualStep, body, equilibrium, spacing, settle,
                 observables, msd):
    """A plan of 64 replicas for each (scheme, step) of cases.

    --quick takes only the cases with the usual step, with fewer replicas and frames.
    """
    frames = 40 if quick else 600
    made = []
    for k, (scheme, step) in enumerate(cases):
        if not (quick and step != usualStep):
            made.append(
                Plan(f'{name}_{scheme}' + ('' if step == usualStep else f'_{step:g}'), body,
                     equilibrium, scheme, step, round(spacing/step), frames, settle, observables,
                     msd, np.geomspace(1, frames // 2, 22), 32 if quick else 64, seed=seed + 7*k))
    return made


def planned(makePlans, quick, seed):
    """What makePlans(quick, seed) makes, once in each process: the distribution and the plans.

    A plan holds functions, which cannot be sent to other processes; makePlans can.
    """
    key = makePlans.__code__.co_filename, quick, seed
    if key not in _planned:
        _planned[key] = makePlans(quick, seed)
    return _planned[key]


_planned = {}


def perform(argument, job):
    """The summary of one plan's run."""
    makePlans, quick, seed, name, minutes = argument
    plan = next(plan for plan in planned(makePlans, quick, seed)[1] if plan.name == name)
    return dict(summary(run(plan, job, minutes)), **plan.labels)


def drive(makePlans, data, args, name, wanted=lambda plan: True):
    """Make the wanted runs, and write the JSON after each; return its data.

    A run is made if its plan is wanted and its scheme is selected. For other plans, what --work has
    goes into the JSON as it is, or with --keep what the JSON has already.
    """
    plans = planned(makePlans, args.quick, args.seed)[1]
    order, rows, todo = [plan.name for plan in plans], {}, []
    path = args.output/name
    published = json.loads(path.read_text())['runs'] if args.keep and path.exists() else []
    for plan in plans:
        if wanted(plan) and (not args.schemes or plan.scheme in args.schemes):
            todo.append(plan)
            continue
        tally = Tally(plan)
        if tally.load(campaign.State(args.work/campaign.directoryName(plan.name), plan.settings())):
            rows[plan.name] = dict(summary(tally), **plan.labels)
    for row in published:
        same = [
            plan.name for plan in plans
            if plan.scheme == row['scheme'] and plan.step == row['step'] and all(
                row[k] == v for k, v in plan.labels.items())
        ]
        rows.update((plan, row) for plan in same if plan not in rows)

    def collect():
        data['runs'] = [rows[plan] for plan in order if plan in rows]
        data['provenance'] = provenance(args)

    def end(index, row):
        rows[todo[index].name] = row
        print(f'{todo[index].name}: {criterion(row)}', flush=True)
        collect()
        save(args.output, name, data)

    minutes = 0 if args.quick else args.minutes
    campaign.run(perform, [(makePlans, args.quick, args.seed, plan.name, minutes) for plan in todo],
                 [plan.name for plan in todo], args, [60*minutes]*len(todo), 's',
                 name.partition('.')[0], end)
    collect()
    return data


# ---- Mean square displacements, by replica -------------------------------------------------------
def parallel(point):
    """Mean square displacement of a point of the body along the wall: xx + yy."""
    return lambda R, q, interval, lags: analysis.translationalMSD(R, q, interval, point, lags, 1,
                                                                  independentBodies=True).parallel


def perpendicular(point):
    """Mean square displacement of a point of the body normal to the wall."""
    return lambda R, q, interval, lags: analysis.translationalMSD(
        R, q, interval, point, lags, 1, independentBodies=True).perpendicular


def rotational(weights):
    """Rotational mean square displacement, the sum of components with these weights."""
    return lambda R, q, interval, lags: analysis.rotationalMSD(
        q, interval, lags, 1, independentBodies=True).component(weights)


def planarAngle(vector):
    """Mean square displacement of the angle of a body vector's projection onto the wall."""
    return lambda R, q, interval, lags: analysis.planarAngleMSD(q, interval, vector, lags, 1,
                                                                independentBodies=True)
