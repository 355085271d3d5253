#!/usr/bin/env python3
"""Davidchack 2017, Figures 2 to 5: correlations of two trapped spheres, against linear theory.

Two spheres are a distance R apart on the z axis. Each is in a translational well kt/2 |r - r0|^2
and a rotational one -kr/2 n_x^2, with n the body's x axis. They interact through the fluid alone.
For small amplitudes the friction is that at the traps' centres and everything is linear: state (x,
v), dx = v dt, M dv = -(K x + xi v) dt + noise, C(t) = [exp(A t)]_qq diag(kT/K). The friction comes
from `getFrictionInContext`, the exponential from scipy.

The same linearisation gives the scheme's own correlations at a time step h, [B^n]_qq Sigma with its
one-step matrix B and stationary covariance Sigma. The bias of a step size is thus known before any
run, and the largest step with a bias below BIAS is taken.

At the paper's kT the traps are not quite linear (kr/kT = 200: a few 1e-3 in the rotational curves),
so each set is also run at a tenth of it. Estimators use symmetries: the mirror z -> -z, which
exchanges the spheres, and <a(t)b(0)> = <b(t)a(0)>.

    python3 trapped_spheres.py               # 5 minutes for the inertial set, an hour for the
                                             # overdamped one
    python3 trapped_spheres.py --sets overdamped --keep     # one set, keeping runs of the other
    python3 trapped_spheres.py --model RPY   # other hydrodynamics, other curves
    python3 trapped_spheres.py --sets overdamped --shares 0.1 --distances 3 --seed 2018 --step 0.01
                                             # a second seed, at the paper's step: 10 minutes
    python3 trapped_spheres.py --quick       # seconds
"""
import argparse
import json
import pathlib
import time

import numpy as np
import openmm
import scipy.linalg
from openmmrigidhi import MobilityForce
from spheres import RESULTS, Spheres, campaign, provenance, pyplot, sample, save

#: m, I, kt, kr, the paper's kT, how long the correlations are followed, spacing of samples, running
#: time.
SETS = {
    'inertial (Figs 2, 3)': {
        'm': 1.0,
        'I': 0.4,
        'kt': 10.0,
        'kr': 20.0,
        'kT': 0.1,
        'lag': 4.0,
        'every': 0.05,
        'time': 5e4
    },
    'overdamped (Figs 4, 5)': {
        'm': 0.05,
        'I': 0.02,
        'kt': 0.5,
        'kr': 1.0,
        'kT': 0.005,
        'lag': 20.0,
        'every': 0.1,
        'time': 1.7e5
    }
}
DISTANCES = (3.0, 3.5)
MODELS = {
    'RPY': (MobilityForce.RotnePragerYamakawa, False),
    'FTS': (MobilityForce.StokesianDynamics, False),
    'FTS+lubrication': (MobilityForce.StokesianDynamics, True)
}
#: The ten functions: sphere and variable of a and of b.
FUNCTIONS = {
    'x1 x1': ('x1', 'x1'),
    'z1 z1': ('z1', 'z1'),
    'chiy1 chiy1': ('chiy1', 'chiy1'),
    'chiz1 chiz1': ('chiz1', 'chiz1'),
    'x1 x2': ('x1', 'x2'),
    'z1 z2': ('z1', 'z2'),
    'chiy1 chiy2': ('chiy1', 'chiy2'),
    'chiz1 chiz2': ('chiz1', 'chiz2'),
    'x1 chiy2': ('x1', 'chiy2'),
    'x1 chiy1': ('x1', 'chiy1')
}
VARIABLES = ('x1', 'z1', 'chiy1', 'chiz1', 'x2', 'z2', 'chiy2', 'chiz2')
#: Sign of each kind under the mirror z -> -z that exchanges the spheres.
MIRROR = {'x': 1, 'z': -1, 'chiy': -1, 'chiz': 1}
#: Row of each kind among a body's six rows: position, then rotation vector.
ROW = {'x': 0, 'z': 2, 'chiy': 4, 'chiz': 5}
STEPS = (0.1, 0.05, 0.025, 0.02, 0.0125, 0.01, 0.005, 0.004, 0.0025, 0.002, 0.00125, 0.001)
BIAS = 0.002
BLOCKS = 32


def kind(name):
    return name[:-1]


def row(name):
    return 6*(int(name[-1]) - 1) + ROW[kind(name)]


# ---- Theory --------------------------------------------------------------------------------------
class Linear:
    """The scene linearised about the traps.

    Rows of position are x y z and the rotation vector of sphere 1, then of sphere 2.
    """
    def __init__(self, parameters, friction):
        # Rotation about the body's x axis is free. A tiny spring there keeps its variance finite,
        # and affects none of the measured functions.
        free = 1e-9*parameters['kr']
        self.stiffness = np.diag(2*(3*[parameters['kt']] + [free] + 2*[parameters['kr']]))
        self.inverse = np.diag(2*(3*[1/parameters['m']] + 3*[1/parameters['I']]))
        self.friction = friction

    def exact(self, times):
        """Normalised C(t), one 12 x 12 matrix for each time.

        Times are multiples of the first interval.
        """
        a = np.block([[np.zeros((12, 12)), np.eye(12)],
                      [-self.inverse @ self.stiffness, -self.inverse @ self.friction]])
        covariance = np.zeros((24, 24))
        covariance[:12, :12], covariance[12:, 12:] = np.linalg.inv(self.stiffness), self.inverse
        return self._correlations(scipy.linalg.expm(a*(times[1] - times[0])), covariance,
                                  len(times))

    def scheme(self, h, every, count):
        """The same for LangevinHI with step h, sampled every `every` steps.

        The scheme is half kick, half drift, Ornstein-Uhlenbeck, and back.
        """
        eye, zero = np.eye(12), np.zeros((12, 12))
        kick = np.block([[eye, zero], [-h/2*self.inverse @ self.stiffness, eye]])
        drift = np.block([[eye, h/2*eye], [zero, eye]])
        damping = scipy.linalg.expm(-h*self.inverse @ self.friction)
        noise = np.zeros((24, 24))
        noise[12:, 12:] = self.inverse - damping @ self.inverse @ damping.T
        after = kick @ drift
        step = after @ scipy.linalg.block_diag(eye, damping) @ drift @ kick
        covariance = scipy.linalg.solve_discrete_lyapunov(step, after @ noise @ after.T)
        return self._correlations(np.linalg.matrix_power(step, every), covariance, count)

    @staticmethod
    def _correlations(propagator, covariance, count):
        scale = 1/np.sqrt(np.diag(covariance)[:12])
        rows = []
        for _ in range(count):
            rows.append(covariance[:12, :12]*scale[:, None]*scale)
            covariance = propagator @ covariance
        return np.array(rows)


def curves(matrices):
    """The ten functions from matrices of all correlations."""
    return {name: matrices[:, row(a), row(b)] for name, (a, b) in FUNCTIONS.items()}


def largest(difference):
    return max(float(abs(d).max()) for d in difference.values())


def biases(theory, parameters):
    """Times, the exact curves, and the largest deviation from them at each step size.

    Only steps that divide the spacing of samples are taken.
    """
    times = np.arange(round(parameters['lag']/parameters['every']) + 1)*parameters['every']
    exact = curves(theory.exact(times))
    result = {}
    for h in STEPS:
        every = round(parameters['every']/h)
        if every >= 1 and abs(every*h - parameters['every']) < 1e-12:
            scheme = curves(theory.scheme(h, every, len(times)))
            result[h] = largest({n: scheme[n] - exact[n] for n in exact})
    return times, exact, result


def chooseStep(theory, parameters):
    """The largest step whose bias stays below BIAS, its bias, times and the exact curves."""
    times, exact, bias = biases(theory, parameters)
    h = max(h for h in bias if bias[h] < BIAS)
    return h, bias[h], times, exact


def saveBiases(args):
    """Save the bias of every step size, at the traps' centres; no run is needed."""
    result = {}
    for setName, parameters in SETS.items():
        for R in DISTANCES:
            probe = build(parameters, R, args.model, 0.001, 1)
            bias = biases(Linear(parameters, probe.fluid.getFrictionInContext(probe.context)),
                          parameters)[2]
            result[f'{setName} R={R:g}'] = {f'{h:g}': b for h, b in bias.items()}
    save(args.output, 'trapped_spheres_bias.json', {
        'largest_bias_by_step': result,
        'provenance': provenance(args)
    })


# ---- The run -------------------------------------------------------------------------------------
def build(parameters, R, model, step, seed):
    """Two trapped spheres; a marker at the end of each x axis carries the rotational trap."""
    scene = Spheres(2, parameters['m'], 3*(parameters['I'],), parameters['kT'], step,
                    MODELS[model][0], MODELS[model][1], marker=(1, 0, 0), seed=seed)
    trap = openmm.CustomCompoundBondForce(2, 'kt/2*(x1*x1+y1*y1+(z1-z0)*(z1-z0))-kr/2*n*n; n=x2-x1')
    trap.addGlobalParameter('kt', parameters['kt'])
    trap.addGlobalParameter('kr', parameters['kr'])
    trap.addPerBondParameter('z0')
    for i, z in enumerate((0.0, R)):
        trap.addBond([scene.centre(i), scene.marker(i)], [z])
    scene.system.addForce(trap)
    scene.start([(0, 0, 0), (0, 0, R)])
    return scene


def record(scene, R):
    """The eight variables."""
    r, q = scene.positions(), scene.orientations()
    w, x, y, z = q.T
    nx, ny, nz = 1 - 2*(y*y + z*z), 2*(x*y + w*z), 2*(x*z - w*y)
    chiY, chiZ = np.arctan(-nz/nx), np.arctan(ny/nx)
    return r[0, 0], r[0, 2], chiY[0], chiZ[0], r[1, 0], r[1, 2] - R, chiY[1], chiZ[1]


def correlate(a, b, lags):
    """<a(t+lag) b(t)> for lags 0 … by FFT."""
    n = len(a)
    size = 1 << (n + lags - 1).bit_length()
    product = np.fft.irfft(np.fft.rfft(a, size)*np.conj(np.fft.rfft(b, size)), size)[:lags]
    return product/(n - np.arange(lags))


def measured(data, lags):
    """The ten functions with standard errors from blocks; symmetric partners are averaged."""
    series = dict(zip(VARIABLES, data.T))

    def partner(name):
        return kind(name) + ('2' if name.endswith('1') else '1')

    variance = {k: np.mean([np.mean(series[k + s]**2) for s in '12']) for k in MIRROR}
    length = len(data) // BLOCKS
    result, errors = {}, {}
    for name, (a, b) in FUNCTIONS.items():
        sign = MIRROR[kind(a)]*MIRROR[kind(b)]
        blocks = []
        for k in range(BLOCKS):
            part = slice(k*length, (k + 1)*length)
            terms = [
                correlate(series[u][part], series[v][part], lags)*s
                for u, v, s in ((a, b, 1), (b, a, 1), (partner(a), partner(b), sign),
                                (partner(b), partner(a), sign))
            ]
            blocks.append(np.mean(terms, axis=0)/np.sqrt(variance[kind(a)]*variance[kind(b)]))
        result[name] = np.mean(blocks, axis=0)
        # The normalisation is measured with the same data. For auto-correlations this removes the
        # error at lag 0.
        if a == b:
            blocks = [block - result[name]*block[0] for block in blocks]
        errors[name] = np.std(blocks, axis=0, ddof=1)/np.sqrt(BLOCKS)
    return result, errors, variance


def seedOf(first, setName, R, share):
    """A seed of its own for each run, whichever other runs are made.

    With one seed for all, runs at two temperatures would differ by scale alone.
    """
    return first + 1000*list(SETS).index(setName) + round(100*share) + round(10*R)


def run(argument, job=None):
    """One set at one distance and temperature, for so many minutes of wall time.

    Minutes before an interruption count, too. Without a step the run takes the one of chooseStep(),
    and curves are compared with exact linear theory. With a step of its own they are compared with
    the linear theory of the scheme at this step.
    """
    setName, R, kT, model, duration, seed, minutes, *step = argument
    began = time.time()
    parameters = dict(SETS[setName], kT=kT)
    probe = build(parameters, R, model, 0.001, 1)
    friction = probe.fluid.getFrictionInContext(probe.context)
    theory = Linear(parameters, friction)
    h, bias, times, exact = chooseStep(theory, parameters)
    if step:
        h, = step
        expected = curves(theory.scheme(h, round(parameters['every']/h), len(times)))
        bias, exact = largest({n: expected[n] - exact[n] for n in exact}), expected
    every = round(parameters['every']/h)
    scene = build(parameters, R, model, h, seed)
    state = campaign.State(job, (setName, R, kT, model, seed, *step))
    kept = state.load()
    if kept:
        scene.context.loadCheckpoint(kept['checkpoint'].tobytes())
        began -= float(kept['seconds'])
    else:
        scene.integrator.step(round(40.0/h))
    data = list(kept.get('data', ()))
    samples = round(duration/parameters['every'])

    def note():
        state.save(data=data, seconds=time.time() - began,
                   checkpoint=campaign.checkpoint(scene.context))

    for _ in sample(scene.integrator, samples - len(data), every, job and job.report, len(data)):
        data.append(record(scene, R))
        if len(data) % 1000 == 0:
            if time.time() - began > 60*minutes:
                break
            if state.isDue():
                note()
    if job is not None:
        note()
    data = np.array(data)
    tcf, errors, variance = measured(data, len(times))
    difference = {n: tcf[n] - exact[n] for n in exact}
    z = {n: float(np.sqrt(np.mean((difference[n][1:]/errors[n][1:])**2))) for n in exact}
    return {
        'set': setName,
        'R': R,
        'kT': kT,
        'model': model,
        'h': h,
        'bias_of_this_step': bias,
        'theory_of': 'the scheme at this step' if step else 'the equations',
        'time': len(data)*parameters['every'],
        'seed': seed,
        'seconds': time.time() - began,
        'samples': len(data),
        'spacing': parameters['every'],
        'variance_over_kT_by_K': {
            k: float(v*parameters['kr' if 'chi' in k else 'kt']/kT)
            for k, v in variance.items()
        },
        'largest_standard_error': largest(errors),
        'largest_difference': {n: float(abs(d).max())
                               for n, d in difference.items()},
        'rms_z': z,
        'extremes': {
            n: [float(times[abs(c).argmax()]),
                float(c[abs(c).argmax()])]
            for n, c in tcf.items() if FUNCTIONS[n][0] != FUNCTIONS[n][1]
        },
        'friction_x_and_z_rows': friction[np.ix_([0, 4, 6, 10], [0, 4, 6, 10])],
        'times': times,
        'measured': {n: np.round(v, 6)
                     for n, v in tcf.items()},
        'standard_error': {n: np.round(v, 6)
                           for n, v in errors.items()},
        'theory': {n: np.round(v, 6)
                   for n, v in exact.items()}
    }


def draw(runs, folder):
    """Draw Figures 2 to 5 and the deviations from theory."""
    plt = pyplot()
    panels = (('x1 x1', 'z1 z1'), ('x1 x2', 'z1 z2'), ('x1 chiy2', 'x1 chiy1'),
              ('chiy1 chiy1', 'chiz1 chiz1'), ('chiy1 chiy2', 'chiz1 chiz2'))
    for setName in sorted({r['set'] for r in runs}):
        # The longest run of each distance.
        chosen = [
            max((r for r in runs if r['set'] == setName and r['R'] == R), key=lambda r: r['time'])
            for R in sorted({r['R']
                             for r in runs if r['set'] == setName})
        ]
        figure, axes = plt.subplots(len(chosen), len(panels), figsize=(20, 3.8*len(chosen)),
                                    squeeze=False, constrained_layout=True)
        for ax, r in zip(axes, chosen):
            t = np.array(r['times'])
            for panel, names in zip(ax, panels):
                for k, name in enumerate(names):
                    panel.plot(t, r['theory'][name], '-', color=f'C{k}', lw=1)
                    thin = slice(None, None, max(1, len(t) // 40))
                    panel.errorbar(t[thin],
                                   np.array(r['measured'][name])[thin],
                                   np.array(r['standard_error'][name])[thin], fmt='o', ms=3,
                                   color=f'C{k}', label=f'⟨{name}⟩')
                panel.axhline(0, color='k', lw=0.4)
                panel.legend(fontsize=8)
                panel.set_xlabel('t')
            ax[0].set_ylabel(f'R = {r["R"]:g}, kT = {r["kT"]:g}')
        figure.suptitle(f'{setName}: {chosen[0]["model"]}, points: run, lines: linear theory')
        figure.savefig(folder/f'trapped_spheres_{setName.split()[0]}.png', dpi=70)
        plt.close(figure)


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--quick', action='store_true',
                        help='seconds: R = 3, about a hundredth of the time')
    parser.add_argument('--model', default='FTS+lubrication', choices=MODELS)
    parser.add_argument('--sets', nargs='+', default=['inertial', 'overdamped'],
                        choices=['inertial', 'overdamped'])
    parser.add_argument('--keep', action='store_true',
                        help='keep the runs that the output folder has until they are done anew')
    parser.add_argument('--bias-only', action='store_true', help='only the bias of the step sizes')
    parser.add_argument('--long', type=float, default=1.0, metavar='FACTOR',
                        help='multiply the length of every run')
    parser.add_argument('--minutes', type=float, default=np.inf,
                        help='end a run after so long (at the paper\'s kT: after a quarter of it)')
    parser.add_argument('--distances', nargs='+', type=float, default=DISTANCES)
    parser.add_argument('--shares', nargs='+', type=float, default=(0.1, 1.0),
                        help="temperatures, in units of the paper's")
    parser.add_argument('--seed', type=int, default=2017)
    parser.add_argument(
        '--step', type=float, help='a step size that divides the spacing of '
        'samples; curves are compared with the linear theory of the scheme at this '
        'step, whose bias may then be large')
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    campaign.addOptions(parser)
    args = campaign.settle(parser.parse_args())

    isFirst = args.seed == parser.get_default('seed')
    name = 'trapped_spheres' + ('' if args.model == 'FTS+lubrication' else '_' +
                                args.model) + ('' if isFirst else f'_seed{args.seed}') + '.json'
    saveBiases(args)
    todo = []
    for setName, parameters in SETS.items():
        if setName.split()[0] not in args.sets or args.bias_only:
            continue
        duration = parameters['time']*(args.long if not args.quick else
                                       0.02 if parameters['m'] == 1 else 0.007)
        for share in args.shares if not args.quick else (0.1,):
            for R in args.distances if not args.quick else DISTANCES[:1]:
                todo.append((setName, R, share*parameters['kT'], args.model, duration,
                             seedOf(args.seed, setName, R,
                                    share), args.minutes*(1 if share < 1 else 0.25),
                             *([args.step] if args.step else [])))
    runs = []
    if args.keep and (args.output/name).exists():
        runs = json.loads((args.output/name).read_text())['runs']

    def finish(_, r):
        # A kept run is removed only when its successor is there: an interrupted series loses
        # nothing.
        runs[:] = [k for k in runs if (k['set'], k['R'], k['kT']) != (r['set'], r['R'], r['kT'])
                   ] + [r]
        runs.sort(key=lambda r: (list(SETS).index(r['set']), r['kT'], r['R']))
        print(
            f'{r["set"]} R {r["R"]:g} kT {r["kT"]:g}: h {r["h"]:g} (bias '
            f'{r["bias_of_this_step"]:.1e}), largest error {r["largest_standard_error"]:.4f}, '
            f'largest difference {max(r["largest_difference"].values()):.4f}, rms z '
            f'{max(r["rms_z"].values()):.2f}  [{r["seconds"]:.0f} s]', flush=True)
        save(args.output, name, {'runs': runs, 'provenance': provenance(args)})

    names = [f'{task[0].split()[0]} R {task[1]:g} kT {task[2]:g} {args.model}' for task in todo]
    campaign.run(run, todo, names, args, [round(task[4]/SETS[task[0]]['every']) for task in todo],
                 'sample', 'trapped spheres', finish)
    if runs and isFirst:
        draw(runs, args.output)


if __name__ == '__main__':
    main()
