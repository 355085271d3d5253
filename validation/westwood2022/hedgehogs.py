#!/usr/bin/env python3
"""Czech hedgehogs in a driven fluid (Westwood 2022, section 6.4): viscosity and structure.

Measured are the effective viscosity against the shear rate, and the places of the centres.

    python3 hedgehogs.py                     # 64 hedgehogs, two potentials, six force densities:
                                             # half an hour on one core
    python3 hedgehogs.py --long 2 --jobs 8   # runs twice as long, eight at a time; existing runs
                                             # go on
    python3 hedgehogs.py --full              # the paper's 1177 hedgehogs: time of steps and a short
                                             # run; --steps 10000 is a run as long as the paper's
                                             # shortest
    python3 hedgehogs.py --quick             # seconds
    python3 hedgehogs.py --report            # tables and pictures again, from what is saved
    python3 hedgehogs.py --animate --bare 100
"""
import argparse
import pathlib
import sys
import time
import zlib

import numpy as np
from tqdm import tqdm

HERE = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent/'common')]
import campaign  # noqa: E402
import hedgehogmodel as model  # noqa: E402
import hedgehogpictures as pictures  # noqa: E402
from openmmrigidhi.analysis import (  # noqa: E402
    sampleFlowAmplitudes, viscosity, viscosityFromAmplitudes)
from recording import brackets, provenance, save  # noqa: E402

RESULTS = HERE/'results'
SEED = 2022
TOLERANCE = 1e-2
POTENTIALS = tuple(model.GAUSSIANS)
#: Shear rates that the force densities would make in the fluid without bodies, 1/tau: the paper
#: does not give its f0.
BARE = (10.0, 20.0, 30.0, 55.0, 100.0, 300.0)
RELAX = 3000, 1/200  # steps, and their length over tau, without noise and fluid
# Steps: of a part that is saved together; between frames; between samples of the flow.
SEGMENT, FRAME, INTERVAL = 300, 30, 2
STEPS = 3600  # steps of a run
#: The part at the beginning of a run that is not counted. It was chosen before the runs.
EQUILIBRATION = 1/3
BIN = 0.5  # width of bins of saved distances, nm
BINS_TOGETHER = 2  # bins in one bin of g(r)


def seedOf(*words):
    return SEED + zlib.crc32(' '.join(map(str, words)).encode()) % 1000000007


def relax(argument, job):
    """Poses from which runs begin.

    They are random, then relaxed without noise and without a fluid that couples bodies, as in the
    paper.
    """
    bodies, potential, steps = argument
    state = campaign.State(job, ('start', bodies, potential))
    if not state.load():
        R, q = model.atRandom(bodies, np.random.default_rng(seedOf('start', bodies, potential)))
        hedgehogs = model.Hedgehogs(bodies, potential, None, step=RELAX[1])
        hedgehogs.place(R, q)
        energies = [hedgehogs.energy()/bodies]
        for k in range(10):
            hedgehogs.integrator.step(max(1, steps // 10))
            energies.append(hedgehogs.energy()/bodies)
            job.report(k + 1)
        R, q = hedgehogs.poses()
        state.save(R=R % hedgehogs.side, q=q, energies=energies)
    return {}


def makeStarts(bodies, potentials, steps, args):
    campaign.run(relax, [(bodies, potential, steps) for potential in potentials],
                 [f'hedgehogs_start_{bodies}_{potential}' for potential in potentials], args,
                 [10]*len(potentials), 'tenth', 'relaxing')


def start(folder, bodies, potential):
    """The poses that relax() has left in a folder."""
    state = campaign.State(folder/f'hedgehogs_start_{bodies}_{potential}',
                           ('start', bodies, potential))
    kept = state.load()
    if not kept:
        raise FileNotFoundError(
            f'{state.path}: it is not there; runs begin from its poses: run without --report and '
            f'--animate first')
    return kept['R'], kept['q'], kept['energies']


def distances(R, edge):
    """Counts of distances of centres (nearest images), by bins up to half the box."""
    i, j = np.triu_indices(len(R), 1)
    d = R[i] - R[j]
    d -= edge*np.round(d/edge)
    return np.histogram(np.linalg.norm(d, axis=1), BIN*np.arange(int(edge/2/BIN) + 1))[0]


class Run:
    """One potential and force density, saved in a directory below a folder.

    Attributes
    ----------
    amplitudes : array (samples, 2)
        of the flow, on sin and cos
    counts : array (segments, bins)
        of distances of centres
    energies : array (segments,)
        mean pair energy of a body, kT
    track : array (frames, bodies, 7)
        poses of the last segment's frames
    """

    ARRAYS = ('amplitudes', 'counts', 'energies', 'track', 'R', 'q')

    def __init__(self, folder, bodies, potential, bare):
        self.bodies, self.potential, self.bare, self.folder = bodies, potential, bare, folder
        self.name = f'hedgehogs_{bodies}_{potential}_{bare:g}'
        self.kept = campaign.State(folder/self.name, self.name)
        self.amplitudes, self.counts, self.energies, self.track = np.empty(
            (0, 2)), None, np.empty(0), None
        self.R = self.q = self.hedgehogs = None
        self.seconds, self.tolerance = 0.0, TOLERANCE

    @property
    def steps(self):
        return len(self.amplitudes)*INTERVAL

    def load(self):
        kept = self.kept.load()
        if not kept:
            return False
        for name in self.ARRAYS:
            setattr(self, name, kept[name])
        self.seconds, self.tolerance = float(kept['seconds']), float(kept['tolerance'])
        return True

    def save(self):
        self.kept.save(seconds=self.seconds, tolerance=self.tolerance,
                       **{name: getattr(self, name)
                          for name in self.ARRAYS})

    def make(self):
        """The Context; its seed depends on the steps done, so a continued run has new noise."""
        if self.hedgehogs is None:
            self.hedgehogs = model.Hedgehogs(self.bodies, self.potential, self.bare, self.tolerance,
                                             seed=seedOf(self.name, self.steps) % 2**31)
            if self.R is not None:
                self.hedgehogs.place(self.R, self.q)
        return self.hedgehogs

    def segment(self, steps):
        """Continue the run by this number of steps."""
        if self.R is None:
            self.R, self.q, _ = start(self.folder, self.bodies, self.potential)
        hedgehogs, began = self.make(), time.process_time()
        parts, counts, energies, track = [self.amplitudes], 0, [], []
        for _ in range(steps // FRAME):
            # Without the amplitudes of the random field, whose part in the variance is only 1/ratio
            # here.
            parts.append(
                sampleFlowAmplitudes(hedgehogs.context, FRAME, INTERVAL,
                                     progress=False)._value[:, :2])
            self.R, self.q = hedgehogs.poses()
            counts = counts + distances(self.R, hedgehogs.side)
            energies.append(hedgehogs.energy()/self.bodies)
            track.append(np.concatenate([self.R, self.q], axis=1))
        self.amplitudes, self.track = np.concatenate(parts), np.array(track, np.float32)
        self.counts = counts[None] if self.counts is None else np.concatenate(
            [self.counts, counts[None]])
        self.energies = np.append(self.energies, np.mean(energies))
        self.seconds += time.process_time() - began
        self.save()

    def estimate(self, amplitudes):
        """Viscosity over the fluid's and shear rate with errors, or why they are refused."""
        try:
            found = viscosityFromAmplitudes(self.make().context,
                                            np.concatenate([amplitudes, 0*amplitudes], axis=1))
        except ValueError as problem:
            return {'refused': str(problem)}
        return {
            'ratio': [found.ratio, found.ratioError],
            'shear_rate': [found.shearRate._value, found.shearRateError._value],
            'tau_samples': found.tau,
            'blocks': found.degrees + 1,
            'cosine_over_sine': [found.cosine/found.amplitude, found.cosineError/found.amplitude],
            'trusted': found.isTrusted
        }

    def summary(self):
        edge = model.side(self.bodies)
        first = int(EQUILIBRATION*len(self.amplitudes))
        counted = self.amplitudes[first:]
        segments = slice(int(EQUILIBRATION*len(self.counts)), None)
        together = self.counts.shape[1] // BINS_TOGETHER
        counts = self.counts[:, :together*BINS_TOGETHER].reshape(len(self.counts), together,
                                                                 BINS_TOGETHER).sum(axis=2)
        edges = BIN*BINS_TOGETHER*np.arange(together + 1)
        shells = 4/3*np.pi*np.diff(edges**3)
        # Frames of a segment: SEGMENT/FRAME at most. Counts are normalised by the number of pairs.
        frames = self.steps/FRAME/len(self.counts)
        expected = frames*self.bodies*(self.bodies - 1)/2*shells/edge**3
        g = counts[segments]/expected
        half = len(counted) // 2
        return {
            'bodies': self.bodies,
            'side': edge,
            'potential': self.potential,
            'bare_shear_rate': self.bare,
            'f0': model.forceDensity(self.bare, edge),
            'k': 2*np.pi/edge,
            'steps': self.steps,
            'time_over_tau': self.steps*model.STEP,
            'not_counted_over_tau': first*INTERVAL*model.STEP,
            'tolerance': self.tolerance,
            'cpu_ms_a_step': 1e3*self.seconds/self.steps,
            **self.estimate(counted), 'halves': [
                self.estimate(part) for part in (counted[:half], counted[half:])
            ],
            'spread_of_samples': counted.std(axis=0),
            'energy_of_a_body': {
                'start': start(self.folder, self.bodies, self.potential)[2][-1],
                'by_segment': self.energies
            },
            'r': (edges[1:] + edges[:-1])/2,
            'g': g.mean(axis=0),
            'g_error': g.std(axis=0, ddof=1)/
            np.sqrt(len(g)) if len(g) > 1 else np.full(len(shells), np.nan)
        }


def drive(argument, job):
    """Continue a run until it has this number of steps."""
    bodies, potential, bare, steps, segment = argument
    run = Run(pathlib.Path(job.directory).parent, bodies, potential, bare)
    run.load()
    while run.steps < steps:
        run.segment(min(segment, -(-(steps - run.steps) // FRAME)*FRAME))
        job.report(run.steps)
    return {'steps': run.steps}


def tolerances(folder, bodies, potential):
    """Ratio of viscosities at the relaxed poses without noise, by tolerance of grid and solver."""
    R, q, _ = start(folder, bodies, potential)
    found = {}
    for tolerance in (1e-2, 1e-3, 1e-6):
        hedgehogs = model.Hedgehogs(bodies, potential, BARE[-1], tolerance, temperature=0)
        hedgehogs.place(R, q)
        found[f'{tolerance:g}'] = viscosity(hedgehogs.context).ratio
    return found


def rigid(folder, bodies, potential):
    """Ratio of viscosities at the relaxed poses, without forces between bodies and without noise.

    This is the contribution of the rigid bodies alone.
    """
    R, q, _ = start(folder, bodies, potential)
    hedgehogs = model.Hedgehogs(bodies, None, 1.0, 1e-3, temperature=0)
    hedgehogs.place(R, q)
    return viscosity(hedgehogs.context).ratio


def fullSize(argument, job):
    """The paper's size: seconds of a step, and the results of a short run."""
    potential, steps, bare = argument
    R, q, energies = start(pathlib.Path(job.directory).parent, model.BODIES, potential)
    hedgehogs = model.Hedgehogs(model.BODIES, potential, bare, TOLERANCE, seed=SEED)
    hedgehogs.place(R, q)
    hedgehogs.integrator.step(1)
    done, began, cpu = dict(
        hedgehogs.integrator.getStepStatistics()), time.time(), time.process_time()
    for k in range(steps):
        hedgehogs.integrator.step(1)
        job.report(k + 1)
    wall, cpu = (time.time() - began)/steps, (time.process_time() - cpu)/steps
    now, began = hedgehogs.integrator.getStepStatistics(), time.process_time()
    sampled = min(steps, 10)
    amplitudes = sampleFlowAmplitudes(hedgehogs.context, sampled, 1, progress=False)._value[:, :2]
    sampling = (time.process_time() - began)/sampled
    k = 2*np.pi/hedgehogs.side
    mean, error = amplitudes.mean(axis=0), amplitudes.std(axis=0, ddof=1)/np.sqrt(sampled)
    return {
        'bodies': model.BODIES,
        'beads': model.BODIES*len(model.SITES),
        'side': hedgehogs.side,
        'potential': potential,
        'bare_shear_rate': bare,
        'steps': steps + 1 + sampled,
        'seconds_a_step': wall,
        'cpu_seconds_a_step': cpu,
        'cpu_seconds_a_step_with_its_sample': sampling,
        'iterations_a_step': (now['solverIterations'] - done['solverIterations'])/steps,
        'tolerance': TOLERANCE,
        'hours_of_10000_steps': wall*1e4/3600,
        'energy_of_a_body': [energies[0], energies[-1],
                             hedgehogs.energy()/model.BODIES],
        'fluid': str(hedgehogs.integrator.getEffects()['hydrodynamics']),
        'amplitude': [mean[0], error[0]],
        'ratio_of_the_short_run': [bare/k/mean[0], bare/k/mean[0]**2*error[0]],
        'amplitude_on_cosine': [mean[1], error[1]]
    }


def report(output, args, bodies):
    """Write the JSON and the pictures, from what --work has."""
    folder = args.work
    runs = []
    for path in sorted(folder.glob('hedgehogs_[0-9]*/state.npz')):
        count, potential, bare = path.parent.name.split('_')[1:]
        run = Run(folder, int(count), potential, float(bare))
        if run.load() and len(run.counts) > 1:
            runs.append(run)
    runs.sort(key=lambda run: (run.bodies, run.potential, run.bare))
    rows = [run.summary() for run in tqdm(runs, desc='summaries', disable=args.silent)]
    data = {
        'model': {
            'A': model.WELL,
            'lambda': model.WIDTH,
            'U0': model.PAIR_STRENGTH,
            'b': model.PAIR_RANGE,
            'cutoff': model.CUTOFF,
            'volume_fraction': model.FRACTION,
            'step_over_tau': model.STEP,
            'interval_of_samples': INTERVAL,
            'not_counted': EQUILIBRATION,
            'units': 'a = 1, kT = 1, tau = 6 pi eta a^3/kT'
        },
        'seed': SEED,
        'runs': rows,
        'tolerances': {
            potential: tolerances(folder, bodies, potential)
            for potential in POTENTIALS
        },
        'without_forces_and_noise': {
            potential: rigid(folder, bodies, potential)
            for potential in POTENTIALS
        },
        'provenance': provenance(args)
    }
    save(output, 'hedgehogs.json', data)
    pictures.draw(data, bodies, output/'hedgehogs.png')
    print('\n'.join(table(data)))
    return data


def animate(output, work, bodies, potential, bare, frames, quiet):
    """A GIF of hedgehogs that go on from where the run stands.

    They have fresh noise. Frames are closer together than the saved ones.
    """
    run = Run(work, bodies, potential, bare)
    if not run.load():
        raise SystemExit(
            f'{run.kept.path}: it is not there; the animation starts from its poses: run without '
            f'--animate first')
    hedgehogs, track = run.make(), []
    for _ in tqdm(range(frames), desc='animation', disable=quiet):
        track.append(np.concatenate(hedgehogs.poses(), axis=1))
        hedgehogs.integrator.step(5)
    pictures.animation(np.array(track), hedgehogs.side, output/'hedgehogs.gif')


def table(data):
    """Lines of the table in Markdown."""
    yield ('| hedgehogs | potential | f0/(kη) τ | time/τ | shear rate × τ | η_eff/η | first half | '
           'second half | energy a body/kT: start, end | ms a step |')
    yield '|---'*10 + '|'
    for row in data['runs']:

        def pair(found, name):
            return brackets(*found[name]) if name in found else '–'

        yield (f'| {row["bodies"]} | {row["potential"]} | {row["bare_shear_rate"]:g} | '
               f'{row["time_over_tau"]:.3g} | {pair(row, "shear_rate")} | {pair(row, "ratio")} | ' +
               ' | '.join(pair(half, 'ratio') for half in row['halves']) +
               f' | {row["energy_of_a_body"]["start"]:.1f}, '
               f'{row["energy_of_a_body"]["by_segment"][-1]:.1f} | {row["cpu_ms_a_step"]:.0f} |')


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--quick', action='store_true', help='seconds: eight hedgehogs, few steps')
    parser.add_argument('--full', action='store_true',
                        help="time steps of the paper's size, and make a short run")
    parser.add_argument('--steps', type=int, help=f'steps of a run ({STEPS}; --full: 10)')
    parser.add_argument('--bodies', type=int, default=64,
                        help='hedgehogs, at the volume fraction of the paper (%(default)s)')
    parser.add_argument('--potentials', nargs='+', default=list(POTENTIALS), choices=POTENTIALS)
    parser.add_argument('--bare', type=float, nargs='+', default=list(BARE),
                        help='shear rates without bodies, f0/(k eta), 1/tau (%(default)s)')
    parser.add_argument('--long', type=float, default=1, help='multiply the length of runs by this')
    parser.add_argument('--report', action='store_true', help='make no runs')
    parser.add_argument(
        '--animate', action='store_true',
        help='make the animation, from the saved poses of the first of --potentials and --bare')
    parser.add_argument('--silent', action='store_true', help='no progress bars')
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    campaign.addOptions(parser)
    args = campaign.settle(parser.parse_args())
    if args.full:
        steps, bare = args.steps or 10, args.bare[0] if len(args.bare) == 1 else 50.0
        makeStarts(model.BODIES, POTENTIALS[:1], 400, args)
        rows = campaign.run(fullSize, [(POTENTIALS[0], steps, bare)], ['hedgehogs full'], args,
                            [steps], 'step', "the paper's size")
        print(f'{model.BODIES} hedgehogs: {rows[0]["seconds_a_step"]:.2f} s a step '
              f'({rows[0]["cpu_seconds_a_step"]:.2f} s of one core)')
        save(args.output, 'hedgehogs_full.json', {
            'rows': rows,
            'seed': SEED,
            'provenance': provenance(args)
        })
        return
    if args.animate:
        animate(args.output, args.work, args.bodies, args.potentials[0], args.bare[0], 48,
                args.silent)
        return
    bodies, steps, segment, bare, relaxing = args.bodies, round(
        (args.steps or STEPS)*args.long), SEGMENT, args.bare, RELAX[0]
    if args.quick:
        # Few steps of few hedgehogs: this shows that the script runs, nothing else.
        bodies, steps, segment, bare, relaxing = 27, round(120*args.long), 60, [300.0], 100
    if not args.report:
        makeStarts(bodies, POTENTIALS, relaxing, args)
        todo = [(bodies, potential, each, steps, segment) for each in bare
                for potential in args.potentials]
        campaign.run(drive, todo, [Run(args.work, *task[:3]).name for task in todo], args,
                     [steps]*len(todo), 'step', 'hedgehogs')
    report(args.output, args, bodies)


if __name__ == '__main__':
    main()
