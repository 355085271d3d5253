#!/usr/bin/env python3
"""Davidchack 2017, Figures 7 and 8: six spheres driven around a ring by a force and a torque.

The tangential force f along the ring has no energy, so it is a CustomBodyForce, like the torque
tau. The CustomBodyForce includes the radial well. Asymptotic states are classified from the gaps
between neighbours alone: steady (uniform, pairs, triplets, cluster) or periodic (5+1 drafting, pair
drafting, in-phase or alternating triplets), with period, orbital speed and spin. Of the repulsion
the paper says only "smoothly truncated at 2.4", and it says nothing of the start. Here there are a
switch from 2.2 to 2.4 (`--truncation none`: without it), and several random starts.

    python3 ring.py                          # the paper's (f, tau), noise, phase diagram,
                                             # animation: an hour
    python3 ring.py --parts states noise     # some of: states noise diagram animation
    python3 ring.py --model RPY --keep       # another model; keep existing runs, make the missing
    python3 ring.py --jobs 8                 # eight runs at a time
    python3 ring.py --quick                  # under a minute: one state
"""
import argparse
import json
import pathlib
import time

import numpy as np
import openmm
from openmmrigidhi import CustomBodyForce, MobilityForce
from spheres import RESULTS, Spheres, campaign, provenance, pyplot, sample, save

COUNT, MASS, MOMENT, RADIUS, KT, A = 6, 1.0, 0.4, 3.0, 10.0, 0.02
SWITCH, CUTOFF = 2.2, 2.4
MODELS = {
    'RPY': (MobilityForce.RotnePragerYamakawa, False),
    'FTS': (MobilityForce.StokesianDynamics, False),
    'FTS+lubrication': (MobilityForce.StokesianDynamics, True)
}
# The time step for the paper's states, that of the paper (0.2 % off in the spin); spacing of
# samples.
STEP, SPACING = 0.02, 0.1
#: For the phase diagram and noise: 1 % off in the spin, 0.6 % in the orbital speed.
COARSE_STEP = 0.05
#: Rms deviation of the gaps, in rad, below which a state counts as steady.
STEADY = 2e-3
#: Shifted gaps match if they differ by less than this fraction of their fluctuation.
MATCH = 0.06
#: Times of the phase diagram to settle and to follow, at f = 1 or tau = 4. Where both f and tau are
#: smaller, everything is slower.
SETTLE, WINDOW = 800.0, 300.0
PARTS = ('states', 'noise', 'diagram', 'animation')
#: f, tau, kind of start, time to settle, window, the state in the paper, and the results of an
#: independent calculation (period, orbital speed, spin), by model and truncation.
STATES = (('Fig 7', 1.0, 0.0, 'random', 700.0, 300.0, '5+1 drafting', {
    ('RPY', 'switch'): (46.2, 0.3077, 0.1092),
    ('FTS+lubrication', 'switch'): (64.8, 0.2889, 0.1227)
}), ('Fig 8(a)', 1.2, -4.0, 'random', 700.0, 200.0, 'steady pairs', {
    ('RPY', 'switch'): (None, 0.2117, -1.6605),
    ('FTS+lubrication', 'switch'): (None, 0.1488, -1.4271),
    ('FTS+lubrication', 'none'): (None, 0.1488, -1.4271)
}), ('Fig 8(b)', 1.2, -3.0, 'random', 4000.0, 950.0, 'pair drafting',
     {}), ('Fig 8(c)', 0.4, -4.0, 'random', 1200.0, 400.0, 'in-phase triplets', {}),
          ('Fig 8(c), start with theta(i+3) = theta(i) + pi', 0.4, -4.0, 'opposite', 1200.0, 400.0,
           'in-phase triplets', {
               ('FTS+lubrication', 'none'): (82.0, -0.054, None)
           }), ('video f0tau-5', 0.0, -5.0, 'random', 1200.0, 400.0, 'drafting', {}))


# ---- The scene -----------------------------------------------------------------------------------
def angles(kind, rng):
    """Angles at the start: random gaps of at least 0.72 rad, or three such gaps twice (to 1e-3).

    Spheres touch at 0.68 rad.
    """
    least = 0.72
    if kind == 'opposite':
        gaps = np.tile(least + rng.dirichlet(np.ones(3))*(np.pi - 3*least), 2)
        return np.cumsum(gaps) + 1e-3*rng.standard_normal(COUNT)
    return np.cumsum(least + rng.dirichlet(np.ones(COUNT))*(2*np.pi - COUNT*least))


def build(f, tau, kT, model, truncation, start, seed, step=STEP):
    """The ring in a Context, spheres at rest at the angles `start`."""
    scene = Spheres(COUNT, MASS, 3*(MOMENT,), kT, step, MODELS[model][0], MODELS[model][1],
                    seed=seed)
    drive = CustomBodyForce('(-kt*(rho-R)*x-f*y)/rho; rho=sqrt(x*x+y*y)',
                            '(-kt*(rho-R)*y+f*x)/rho; rho=sqrt(x*x+y*y)', '-kt*z', '0', '0', 'tau')
    for name, value in (('kt', KT), ('R', RADIUS), ('f', f), ('tau', tau)):
        drive.addGlobalParameter(name, value)
    for i in range(COUNT):
        drive.addBody(i, [])
    scene.system.addForce(drive)
    if truncation == 'none':
        repulsion = openmm.CustomNonbondedForce(f'{A}/((r/2)^12-1)')
        repulsion.setNonbondedMethod(openmm.CustomNonbondedForce.NoCutoff)
    else:
        repulsion = openmm.CustomNonbondedForce(
            f'{A}/((r/2)^12-1)*(1-step(r-{SWITCH})*z*z*z*(10-z*(15-6*z))); '
            f'z=(r*r-{SWITCH**2})/{CUTOFF**2 - SWITCH**2}')
        repulsion.setNonbondedMethod(openmm.CustomNonbondedForce.CutoffNonPeriodic)
        repulsion.setCutoffDistance(CUTOFF)
    for _ in range(COUNT):
        repulsion.addParticle()
    scene.system.addForce(repulsion)
    scene.start(RADIUS*np.stack([np.cos(start), np.sin(start), np.zeros(COUNT)], axis=1))
    return scene


class Trajectory:
    """Angles (unwrapped), spins, distances at equidistant times."""
    def __init__(self, scene, window, orientations=False):
        every = round(SPACING/scene.integrator.getStepSize()._value)
        theta, spin, places, turns = [], [], [], []
        for _ in sample(scene.integrator, round(window/SPACING), every):
            r = scene.positions()
            theta.append(np.arctan2(r[:, 1], r[:, 0]))
            spin.append(scene.angularVelocities()[:, 2])
            places.append(r)
            if orientations:
                turns.append(scene.orientations())
        self.theta = np.unwrap(np.array(theta), axis=0)
        self.spin, self.places, self.orientations = np.array(spin), np.array(places), np.array(
            turns)

    def gaps(self):
        """Gap of each sphere to the next anticlockwise, in the order around the ring."""
        theta = self.theta[:, np.argsort(self.theta[0] % (2*np.pi))]
        theta = theta - 2*np.pi*np.round((theta[0] - theta[0] % (2*np.pi))/(2*np.pi))
        return np.diff(np.hstack([theta, theta[:, :1] + 2*np.pi]), axis=1)


# ---- The classifier ------------------------------------------------------------------------------
def mismatch(gaps, shift, lags):
    """D_s(lag): rms of g_{k+s}(t+lag) - g_k(t) in units of the rms fluctuation of the gaps."""
    deviation = gaps - gaps.mean(0)
    fluctuation = np.sqrt(np.mean(deviation**2))
    moved = np.roll(gaps, -shift, axis=1)
    n = len(gaps)
    return np.array([np.sqrt(np.mean((moved[lag:] - gaps[:n - lag])**2))
                     for lag in lags])/fluctuation


def classify(gaps, steady=STEADY, match=MATCH):
    """Name of the state, rms fluctuation of the gaps, period (None if there is none)."""
    mean = gaps.mean(0)
    fluctuation = float(np.sqrt(np.mean((gaps - mean)**2)))
    if fluctuation < steady:
        for shift, name in ((1, 'uniform'), (2, 'steady pairs'), (3, 'steady triplets')):
            if np.sqrt(np.mean((np.roll(mean, shift) - mean)**2)) < 5*steady:
                return name, fluctuation, None
        return 'steady cluster', fluctuation, None
    lags = np.arange(0, len(gaps) // 2, 2)
    zero = mismatch(gaps, 0, lags)
    period, left = None, np.argmax(zero > 0.5)
    if zero.max() > 0.5:
        for k in range(left, len(lags) - 1):
            if zero[k] < match and zero[k] <= zero[k - 1] and zero[k] <= zero[k + 1]:
                period = float(SPACING*lags[k])
                break
    if mismatch(gaps, 3, [0])[0] < match:
        return 'in-phase triplets', fluctuation, period
    for shift, name in ((1, '5+1 drafting'), (2, 'pair drafting'), (3, 'alternating triplets')):
        if mismatch(gaps, shift, lags).min() < match:
            return name, fluctuation, period
    return 'undecided', fluctuation, period


def neighbourDistances(places, theta):
    """Mean distances of neighbours on the ring, sorted."""
    order = np.argsort(theta[0] % (2*np.pi))
    return np.sort([
        np.linalg.norm(places[:, i] - places[:, j], axis=1).mean()
        for i, j in zip(order, np.roll(order, -1))
    ])


#: Number of parts in which a run settles; it can be saved after each.
SETTLING = 20


def settled(arguments, job):
    """The scene of a run that has settled, its saved state, and the seconds that it took before.

    It goes on where it was interrupted. The arguments have f, tau, kT, model, truncation, kind (of
    the start), settle, window, seed, step.
    """
    a = arguments
    scene = build(a['f'], a['tau'], a['kT'], a['model'], a['truncation'],
                  angles(a['kind'], np.random.default_rng(a['seed'])), a['seed'], a['step'])
    state, began = campaign.State(
        job, {key: a[key]
              for key in sorted(a) if key not in ('window', 'attempts')}), time.time()
    kept = state.load()
    done, before = int(kept.get('done', 0)), float(kept.get('seconds', 0))
    if kept:
        scene.context.loadCheckpoint(kept['checkpoint'].tobytes())
    for k in range(done, SETTLING):
        scene.integrator.step(round(a['settle']/a['step']/SETTLING))
        if job is not None:
            job.report((k + 1)/SETTLING*a['settle'])
        if state.isDue() or job is not None and k + 1 == SETTLING:
            state.save(done=k + 1, seconds=before + time.time() - began,
                       checkpoint=campaign.checkpoint(scene.context))
    return scene, state, before


def runState(arguments, job=None):
    """Settle, follow, classify; an undecided run is followed for up to `attempts` windows."""
    f, tau, kT, model, truncation, kind, settle, window, seed, step, attempts = (
        arguments[key] for key in ('f', 'tau', 'kT', 'model', 'truncation', 'kind', 'settle',
                                   'window', 'seed', 'step', 'attempts'))
    began = time.time()
    scene, state, before = settled(arguments, job)
    for attempt in range(1, attempts + 1):
        trajectory = Trajectory(scene, window)
        gaps = trajectory.gaps()
        state, fluctuation, period = classify(gaps)
        if state != 'undecided':
            break
    orbit = (trajectory.theta[-1] - trajectory.theta[0]).mean()/(SPACING*(len(gaps) - 1))
    places = trajectory.places
    nearest = min(
        np.linalg.norm(places[:, i] - places[:, j], axis=1).min() for i in range(COUNT)
        for j in range(i))
    return {
        'f': f,
        'tau': tau,
        'kT': kT,
        'model': model,
        'truncation': truncation,
        'start': kind,
        'seed': seed,
        'h': step,
        'settle': settle + window*(attempt - 1),
        'window': window,
        'state': state,
        'fluctuation': fluctuation,
        'period': period,
        'fingerprint': fingerprint(gaps),
        'least_mismatch_by_one': float(mismatch(gaps, 1, np.arange(0,
                                                                   len(gaps) // 2, 5)).min()),
        'orbital_speed': orbit,
        'spin': float(trajectory.spin.mean()),
        'smallest_gap': float(nearest - 2),
        'distances': neighbourDistances(places, trajectory.theta)
        if state.startswith('steady') else None,
        'largest_out_of_plane': float(abs(places[:, :, 2]).max()),
        'seconds': before + time.time() - began
    }


# ---- Parts of the experiment ---------------------------------------------------------------------
def made(args, path, tasks):
    """Do the runs of `tasks`; with --keep only those that the file lacks.

    A task is (arguments of runState, more entries of the row). The file is written after each run;
    rows that it has beyond the tasks stay.
    """
    def key(row):
        return tuple(row[k] for k in ('f', 'tau', 'start', 'seed', 'h'))

    rows = {key(r): r
            for r in json.loads(path.read_text())['rows']} if args.keep and path.exists() else {}
    todo = [(arguments, more) for arguments, more in tasks
            if key(dict(arguments, start=arguments['kind'], h=arguments['step'])) not in rows]
    order = list(rows) + [
        key(dict(arguments, start=arguments['kind'], h=arguments['step'])) for arguments, _ in todo
    ]

    def finish(index, row):
        more = todo[index][1]
        row.update(more)
        rows[key(row)] = row
        save(path.parent, path.name, {
            'rows': [rows[k] for k in order if k in rows],
            'provenance': provenance(args)
        })
        print(
            f'f {row["f"]:g} tau {row["tau"]:g} seed {row["seed"]}: {row["state"]}, period '
            f'{row["period"]}, Om {row["orbital_speed"]:.4f}, spin {row["spin"]:.4f}, smallest gap '
            f'{row["smallest_gap"]:.3f} {more}  [{row["seconds"]:.0f} s]', flush=True)

    together(runState, [arguments for arguments, _ in todo], args, finish)
    return [rows[k] for k in order]


def together(function, todo, args, finished=None):
    """Do runs with these arguments of runState(), as many at a time as --jobs says."""
    names = [
        f'ring {a["model"]} {a["truncation"]} f {a["f"]:g} tau {a["tau"]:g} kT {a["kT"]:g} '
        f'{a["kind"]} seed {a["seed"]} h {a["step"]:g} {function.__name__}' for a in todo
    ]
    return campaign.run(function, todo, names, args, [a['settle'] for a in todo], 'time', 'ring',
                        finished)


def states(args, path):
    tasks = []
    for k in range(1 if args.quick else args.starts):
        for name, f, tau, kind, settle, window, paper, reference in (STATES[:1]
                                                                     if args.quick else STATES):
            if args.quick:
                settle, window = 300.0, 180.0
            tasks.append(({
                'f': f,
                'tau': tau,
                'kT': 0,
                'model': args.model,
                'truncation': args.truncation,
                'kind': kind,
                'settle': settle,
                'window': window,
                'seed': args.seed + k,
                'step': COARSE_STEP if args.quick else STEP,
                'attempts': 3
            }, {
                'name': name,
                'paper': paper,
                'independent': reference.get((args.model, args.truncation))
            }))
    return made(args, path, tasks)


def fingerprint(gaps):
    """Numbers by which a noisy state is recognised, made of time-means of the gaps.

    They are the time-means of the sorted gaps, then the sorted time-means of the gaps. The first
    numbers tell the shapes apart that the ring goes through. The second tell whether every sphere
    keeps its place in them.
    """
    return np.concatenate([np.sort(gaps, axis=1).mean(0), np.sort(gaps.mean(0))])


def noise(args, path):
    """Run both of the paper's robust states with noise.

    To which of the two noiseless states is each run nearer, and is it still periodic?
    """
    todo = [(name, paper, {
        'f': f,
        'tau': tau,
        'kT': kT,
        'model': args.model,
        'truncation': args.truncation,
        'kind': 'random',
        'settle': settle,
        'window': window*(1 if kT < 1e-3 else 3),
        'seed': args.seed,
        'step': COARSE_STEP,
        'attempts': 1
    }) for kT in (0.0, 1e-5, 1e-4, 1e-3, 1e-2)
            for name, f, tau, _, settle, window, paper, _ in STATES[:2]]
    rows, noiseless = together(runState, [arguments for _, _, arguments in todo], args), {}
    for (name, paper, _), row in zip(todo, rows):
        mark = np.array(row['fingerprint'])
        if row['kT'] == 0:
            noiseless[row['state']] = mark
        else:
            row['by_classifier'] = row['state']
            row['distances_to_noiseless'] = {
                state: float(np.sqrt(np.mean((mark - m)**2)))
                for state, m in noiseless.items()
            }
            row['state'] = min(row['distances_to_noiseless'], key=row['distances_to_noiseless'].get)
        row.update({'name': name, 'paper': paper})
        print(
            f'{name} kT {row["kT"]:g}: {row["state"]} (distances '
            f'{row.get("distances_to_noiseless")}, fluctuation {row["fluctuation"]:.3f}, mismatch '
            f'after a shift by one {row["least_mismatch_by_one"]:.2f}), Om '
            f'{row["orbital_speed"]:.4f}, spin {row["spin"]:.4f}', flush=True)
    save(path.parent, path.name, {'rows': rows, 'provenance': provenance(args)})
    return rows


def diagram(args, path):
    """Random starts at each point of a grid, for one start after the other."""
    tasks = []
    for k in range(args.diagram_starts):
        for tau in args.tau:
            for f in args.f:
                if f == 0 and tau == 0:
                    continue
                slower = 1/np.clip(max(f, abs(tau)/4), 0.25, 1)
                tasks.append(({
                    'f': f,
                    'tau': tau,
                    'kT': 0,
                    'model': args.model,
                    'truncation': args.truncation,
                    'kind': 'random',
                    'settle': SETTLE*slower,
                    'window': WINDOW*slower,
                    'seed': args.seed + k,
                    'step': COARSE_STEP,
                    'attempts': args.attempts
                }, {}))
    return made(args, path, tasks)


COLOURS = {
    '5+1 drafting': 'C0',
    'steady pairs': 'C1',
    'pair drafting': 'C2',
    'in-phase triplets': 'C3',
    'alternating triplets': 'C4',
    'uniform': 'C5',
    'steady triplets': 'C6',
    'steady cluster': 'C7',
    'undecided': 'k'
}


def drawDiagram(rows, path):
    """A disc at each (f, tau), with a sector for each start."""
    plt = pyplot()
    figure, ax = plt.subplots(figsize=(9, 8), constrained_layout=True)
    named = set()
    for f, tau in sorted({(r['f'], r['tau']) for r in rows}):
        here = sorted((r for r in rows if (r['f'], r['tau']) == (f, tau)),
                      key=lambda r: list(COLOURS).index(r['state']))
        for k, r in enumerate(here):
            turn = 2*np.pi*np.linspace(k, k + 1, 20)/len(here)
            sector = np.stack([np.sin(turn), np.cos(turn)], axis=1)
            if len(here) > 1:
                sector = np.vstack([[0, 0], sector])
            # matplotlib scales a marker to its largest coordinate.
            ax.scatter([f], [tau], marker=sector, s=330*abs(sector).max()**2,
                       color=COLOURS[r['state']], lw=0,
                       label=None if r['state'] in named else r['state'])
            named.add(r['state'])
        ax.annotate(f'{np.mean([r["orbital_speed"] for r in here]):+.2f}', (f, tau), ha='center',
                    va='center', fontsize=6, color='w')
    ax.set(xlabel='f', ylabel=r'$\tau$')
    ax.margins(0.06)
    count = max(sum((r['f'], r['tau']) == (q['f'], q['tau']) for r in rows) for q in rows)
    ax.set_title(
        f'{rows[0]["model"]}, {count} random start{"s" if count > 1 else ""} at each point; '
        f'numbers: mean orbital speed', fontsize=10)
    ax.legend(fontsize=8, bbox_to_anchor=(1.01, 1), loc='upper left')
    figure.savefig(path, dpi=80)
    plt.close(figure)


def film(arguments, job):
    """Places and orientations after a run has settled."""
    trajectory = Trajectory(settled(arguments, job)[0], arguments['window'], orientations=True)
    return {'places': trajectory.places, 'orientations': trajectory.orientations}


def animation(args, path):
    """The paper's four states side by side."""
    plt = pyplot()
    from matplotlib.animation import FuncAnimation, PillowWriter
    from matplotlib.patches import Circle, Wedge
    shown = [s for s in STATES if s[0] in ('Fig 7', 'Fig 8(a)', 'Fig 8(b)') or s[3] == 'opposite']
    records = together(film, [{
        'f': f,
        'tau': tau,
        'kT': 0,
        'model': args.model,
        'truncation': args.truncation,
        'kind': kind,
        'settle': min(settle, 2000),
        'window': 96.0,
        'seed': args.seed,
        'step': COARSE_STEP
    } for _, f, tau, kind, settle, *_ in shown], args)
    places, orientations = ([np.array(record[key]) for record in records]
                            for key in ('places', 'orientations'))
    names = [f'f = {f:g}, τ = {tau:g}' for _, f, tau, *_ in shown]
    figure, axes = plt.subplots(1, len(shown), figsize=(2.6*len(shown), 2.8),
                                constrained_layout=True)
    every = 12

    def frame(k):
        for ax, x, turns, name in zip(axes, places, orientations, names):
            ax.clear()
            ax.set(xlim=(-4.2, 4.2), ylim=(-4.2, 4.2), aspect='equal', xticks=[], yticks=[],
                   title=name)
            ax.add_patch(Circle((0, 0), RADIUS, fill=False, lw=0.5, color='0.6'))
            for i in range(COUNT):
                place, q = x[k*every, i, :2], turns[k*every, i]
                turn = np.degrees(2*np.arctan2(q[3], q[0]))
                ax.add_patch(Circle(place, 1, color='#9ecae1'))
                ax.add_patch(Wedge(place, 1, turn, turn + 180, color='#08519c'))
                ax.annotate(str(i + 1), place, ha='center', va='center', fontsize=7, color='w')

    FuncAnimation(figure, frame,
                  frames=len(places[0]) // every).save(path, writer=PillowWriter(fps=12), dpi=65)


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--quick', action='store_true', help='one state, one start')
    parser.add_argument('--parts', nargs='+', choices=PARTS, default=PARTS)
    parser.add_argument('--model', default='FTS+lubrication', choices=MODELS)
    parser.add_argument('--truncation', default='switch', choices=('switch', 'none'))
    parser.add_argument('--starts', type=int, default=3,
                        help='starts for each of the paper\'s states')
    parser.add_argument('--diagram-starts', type=int, default=3,
                        help='starts at each point of the phase diagram')
    parser.add_argument('--attempts', type=int, default=12,
                        help='windows for which an undecided run of the diagram is followed')
    parser.add_argument(
        '--keep', action='store_true',
        help='keep the states and points that the output folder has; make the missing ones')
    parser.add_argument('--f', type=float, nargs='+', default=[0, 0.2, 0.4, 0.6, 0.8, 1, 1.2])
    parser.add_argument('--tau', type=float, nargs='+', default=[k/2 for k in range(-10, 5)])
    parser.add_argument('--seed', type=int, default=2017)
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    campaign.addOptions(parser)
    args = campaign.settle(parser.parse_args())
    args.output.mkdir(parents=True, exist_ok=True)
    suffix = args.model.replace('+', '_') + ('' if args.truncation == 'switch' else '_untruncated')
    for part in ('states',) if args.quick else args.parts:
        if part == 'animation':
            animation(args, args.output/f'ring_{suffix}.gif')
            continue
        rows = {
            'states': states,
            'noise': noise,
            'diagram': diagram
        }[part](args, args.output/f'ring_{part}_{suffix}.json')
        if part == 'diagram':
            drawDiagram(rows, args.output/f'ring_diagram_{suffix}.png')


if __name__ == '__main__':
    main()
