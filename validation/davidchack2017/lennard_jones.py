#!/usr/bin/env python3
"""Davidchack 2017, Table S2, Figures S1 and S2: the Gibbs distribution of Lennard-Jones spheres.

Eight spheres have offset sites. The sites attract each other (periodic box of 15, the paper's
smooth cut-off). The fluid is unbounded, and couples the spheres' centres where they are
(unwrapped). No average at equilibrium may depend on the fluid. FreeDraining and RotnePragerYamakawa
must therefore agree with each other and with Monte Carlo; their differences from Monte Carlo grow
as h^2.

Sixteen independent clusters (32 with RPY) share one Context: `MobilityForce.setGroups` keeps them
apart in the fluid, interaction groups in the force. On the CPU platform with one thread this is ten
times faster for each cluster than one cluster on Reference.

With --periodic the fluid is periodic in the box of 15, too, as in the paper: StokesianDynamics with
lubrication, and RotnePragerYamakawa at one step. These runs have a JSON of their own, where the
runs in an unbounded fluid serve for comparison.

    python3 lennard_jones.py              # about an hour and a half, mostly for RPY at kT = 0.2,
                                          # h = 0.02
    python3 lennard_jones.py --periodic   # four hours on one idle core
    python3 lennard_jones.py --jobs 8     # eight runs at a time
    python3 lennard_jones.py --long 8     # runs eight times as long; existing runs go on
    python3 lennard_jones.py --quick      # seconds: a smoke test
"""
import argparse
import json
import pathlib
import time

import numpy as np
import openmm
from openmmrigidhi import MobilityForce
from spheres import (RESULTS, Spheres, blockError, brackets, campaign, provenance, pyplot, sample,
                     save, weightedFit)

SPHERES, BOX, SIGMA, MASS = 8, 15.0, 2.6, 5.0
MOMENTS = (3.0, 2.0, 1.5)
SITE = (0.2, 0.15, 0.0)
CUTOFF = 2.5*SIGMA
SWITCH = 0.9*CUTOFF
#: Free draining is first: the other models are compared with it.
MODELS = {
    'FreeDraining': (MobilityForce.FreeDraining, MobilityForce.Unbounded),
    'RPY': (MobilityForce.RotnePragerYamakawa, MobilityForce.Unbounded),
    'RPY periodic': (MobilityForce.RotnePragerYamakawa, MobilityForce.Periodic),
    'SD periodic': (MobilityForce.StokesianDynamics, MobilityForce.Periodic)
}
# (S3): u_LJ (1 - 10 z^3 + 15 z^4 - 6 z^5).
POTENTIAL = (f'4*s6*(s6-1)*(1-step(r-{SWITCH})*z*z*z*(10-z*(15-6*z))); '
             f'z=(r*r-{SWITCH**2})/{CUTOFF**2 - SWITCH**2}; s6=s2*s2*s2; s2={SIGMA**2}/(r*r)')
QUANTITIES = ('kT_t', 'kT_r1', 'kT_r2', 'kT_r3', 'U/N')
#: Table S2, as (A0, error, E_A, error); and Monte Carlo of this repository for U/N, independent of
#: any integrator (A0, error).
PAPER = {
    0.1: {
        'kT_t': (0.100012, 1.4e-5, -0.06972, 1.1e-4),
        'kT_r1': (0.100010, 1.8e-5, -0.00257, 1.5e-4),
        'kT_r2': (0.099992, 1.4e-5, -0.00778, 1.2e-4),
        'kT_r3': (0.100011, 1.2e-5, -0.01388, 1.1e-4),
        'U/N': (-2.34352, 3e-5, -0.0098, 4e-4)
    },
    0.2: {
        'kT_t': (0.20001, 2e-5, -0.1293, 5e-4),
        'kT_r1': (0.19998, 3e-5, -0.0027, 7e-4),
        'kT_r2': (0.20002, 2e-5, -0.0171, 6e-4),
        'kT_r3': (0.19999, 3e-5, -0.0235, 5e-4),
        'U/N': (-2.13921, 1.4e-4, -0.056, 3e-3)
    }
}
MONTE_CARLO = {0.1: (-2.34371, 1.6e-4), 0.2: (-2.13904, 3e-4)}
#: The paper fits below these h^2.
FIT_BELOW = {0.1: 0.1, 0.2: 0.06}
SAMPLE_TIME = 0.4
#: Clusters start as cubes, freeze into one of several shapes and seldom change shape. So they first
#: run for PREPARATION at the step PREPARATION_STEP without hydrodynamic interactions, which is
#: cheap and leads to the same distribution. Then they run for EQUILIBRATION as measured.
PREPARATION, PREPARATION_STEP, EQUILIBRATION = 3000.0, 0.2, 50.0


def build(kT, step, modelName, clusters, seed):
    """Clusters of eight spheres in one Context, each alone in the box and in the fluid."""
    model, boundary = MODELS[modelName]
    scene = Spheres(SPHERES*clusters, MASS, MOMENTS, kT, step, model, marker=SITE, seed=seed)
    scene.fluid.setBoundary(boundary)
    scene.system.setDefaultPeriodicBoxVectors((BOX, 0, 0), (0, BOX, 0), (0, 0, BOX))
    scene.fluid.setGroups([i // SPHERES for i in range(SPHERES*clusters)])
    lj = openmm.CustomNonbondedForce(POTENTIAL)
    lj.setNonbondedMethod(openmm.CustomNonbondedForce.CutoffPeriodic)
    lj.setCutoffDistance(CUTOFF)
    for _ in range(scene.system.getNumParticles()):
        lj.addParticle()
    for c in range(clusters):
        members = [scene.marker(i) for i in range(SPHERES*c, SPHERES*(c + 1))]
        lj.addInteractionGroup(members, members)
    scene.system.addForce(lj)
    return scene


def start(scene, clusters, platformName):
    """Place every cluster as a cube, near the distance of least energy."""
    side = 2**(1/6)*SIGMA
    cube = side*np.array([(i, j, k) for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    scene.start(np.tile(cube, (clusters, 1)), platformName)


def energies(scene, clusters):
    """U/N of every cluster, since OpenMM gives only the sum over clusters."""
    q = scene.orientations()
    w, v = q[:, :1], q[:, 1:]
    turn = 2*np.cross(v, SITE)
    sites = (scene.positions() + SITE + w*turn + np.cross(v, turn)).reshape(clusters, SPHERES, 3)
    i, j = np.triu_indices(SPHERES, 1)
    d = sites[:, i] - sites[:, j]
    d -= BOX*np.round(d/BOX)
    r2 = np.sum(d*d, axis=2)
    s6 = (SIGMA**2/r2)**3
    z = np.clip((r2 - SWITCH**2)/(CUTOFF**2 - SWITCH**2), 0, 1)
    return np.sum(4*s6*(s6 - 1)*(1 - z**3*(10 - z*(15 - 6*z))), axis=1)/SPHERES


def prepared(kT, step, modelName, clusters, seed, platformName, preparation):
    """Clusters that have taken their shapes, then equilibrated as they will be measured.

    They take their shapes without hydrodynamic interactions.
    """
    first = build(kT, PREPARATION_STEP, 'FreeDraining', clusters, seed + 1000)
    start(first, clusters, platformName)
    for _ in sample(first.integrator, 20, round(preparation/PREPARATION_STEP/20)):
        pass
    scene = build(kT, step, modelName, clusters, seed)
    start(scene, clusters, platformName)
    scene.integrator.setBodyPositions(first.positions())
    scene.integrator.setBodyOrientations(first.orientations())
    scene.integrator.setBodyVelocities(first.velocities())
    scene.integrator.setBodyAngularVelocities(first.angularVelocities())
    scene.integrator.step(round(EQUILIBRATION/step))
    return scene


def run(argument, job=None):
    """One run: means and standard errors of the five quantities.

    The third number is the time of each cluster. A saved run with the same other settings is
    continued to become longer.
    """
    kT, step, modelName, duration, clusters, seed, platformName, preparation = argument
    state = campaign.State(job, (kT, step, modelName, clusters, seed, platformName, preparation))
    rows, perCluster, seconds, rejected = [], [], 0.0, 0
    began, old = time.time(), state.load()
    if old:
        scene = build(kT, step, modelName, clusters, seed)
        start(scene, clusters, platformName)
        scene.context.loadCheckpoint(old['checkpoint'].tobytes())
        rows, perCluster, seconds = list(old['rows']), list(old['perCluster']), float(
            old['seconds'])
        rejected = int(old['rejected'])
    else:
        scene = prepared(kT, step, modelName, clusters, seed, platformName, preparation)
    rejectedBefore = scene.integrator.getNumRejectedSteps()
    every = max(1, round(SAMPLE_TIME/step))
    count = SPHERES*clusters

    def note():
        state.save(rows=rows, perCluster=perCluster, seconds=seconds + time.time() - began,
                   rejected=rejected + scene.integrator.getNumRejectedSteps() - rejectedBefore,
                   checkpoint=campaign.checkpoint(scene.context))

    for _ in sample(scene.integrator,
                    round(duration/step/every) - len(rows), every, job and job.report, len(rows)):
        # Axis 1 of the paper has moment 3; here axes are sorted, smallest moment first.
        rotation = scene.integrator.computeRotationalKineticEnergies()._value[::-1]
        translation = scene.integrator.computeTranslationalKineticEnergy()._value
        perCluster.append(energies(scene, clusters))
        rows.append([2*translation/(3*count), *(2*np.array(rotation)/count), perCluster[-1].mean()])
        if state.isDue():
            note()
    note()
    rejected += scene.integrator.getNumRejectedSteps() - rejectedBefore
    rows = np.array(rows)
    check = abs(perCluster[-1].mean() - scene.potentialEnergy()/count)
    if check > 1e-5:
        raise RuntimeError(f'U/N differs from OpenMM\'s by {check}')
    mean, error = rows.mean(0), blockError(rows)
    between = float(np.mean(perCluster, axis=0).std(ddof=1)/np.sqrt(clusters))
    error[4] = max(error[4], between)
    return {
        'kT': kT,
        'h': step,
        'model': modelName,
        'clusters': clusters,
        'time_per_cluster': duration,
        'preparation': preparation,
        'seed': seed,
        'steps': int(len(rows)*every),
        'samples': len(rows),
        'seconds': seconds + time.time() - began,
        'rejected_steps': int(rejected),
        'mean': dict(zip(QUANTITIES, mean)),
        'error': dict(zip(QUANTITIES, error)),
        'U/N_error_between_clusters': between,
        'U/N_difference_to_OpenMM': check
    }


def fits(runs, kT):
    """A0 and E_A of each quantity from runs below FIT_BELOW, and the fitted order of its error."""
    fitted = [r for r in sorted(runs, key=lambda r: r['h']) if r['h']**2 < FIT_BELOW[kT]]
    if len(fitted) < 2:
        return None
    h = np.array([r['h'] for r in fitted])
    found = {'fit': {}, 'order': {}}
    for name in QUANTITIES:
        y = np.array([r['mean'][name] for r in fitted])
        e = np.array([r['error'][name] for r in fitted])
        (a0, ea), (da0, dea), chi2 = weightedFit([np.ones_like(h), h**2], y, e)
        found['fit'][name] = {
            'A0': a0,
            'A0_error': da0,
            'E_A': ea,
            'E_A_error': dea,
            'chi2_per_dof': chi2,
            'paper': dict(zip(('A0', 'A0_error', 'E_A', 'E_A_error'), PAPER[kT][name]))
        }
        # Order: the exponent p of |A(h) - A(0)| = E h^p, with the exact A(0), from the points that
        # are 5 sigma away.
        exact, exactError = (kT, 0.0) if name != 'U/N' else MONTE_CARLO[kT]
        big = [(x, abs(v - exact), np.hypot(s, exactError)) for x, v, s in zip(h, y, e)
               if abs(v - exact) > 5*np.hypot(s, exactError)]
        if len(big) >= 3:
            x, d, s = np.array(big).T
            (p, _), (dp, _), _ = weightedFit([np.log(x), np.ones_like(x)], np.log(d), s/d)
            found['order'][name] = {'order': p, 'error': dp, 'points': len(big)}
    return found


def analyse(runs):
    """Fits in h^2, the fitted order, agreement with Monte Carlo and between the models."""
    result = {}
    for kT in sorted({r['kT'] for r in runs}):
        free = sorted((r for r in runs if r['kT'] == kT and r['model'] == 'FreeDraining'),
                      key=lambda r: r['h'])
        other = [r for r in runs if r['kT'] == kT and r['model'] != 'FreeDraining']
        entry = fits(free, kT)
        if not entry:
            continue
        periodic = fits([r for r in other if r['model'] == 'SD periodic'], kT)
        if periodic:
            entry['SD periodic'] = periodic
        small = [r for r in free if r['h'] <= 0.02]
        if small:
            (pooled,), (error,), chi2 = weightedFit([np.ones(len(small))],
                                                    [r['mean']['U/N'] for r in small],
                                                    np.array([r['error']['U/N'] for r in small]))
            exact, exactError = MONTE_CARLO[kT]
            entry['U/N_at_h_0.005_to_0.02'] = {
                'each': [(r['h'], r['mean']['U/N'], r['error']['U/N'],
                          (r['mean']['U/N'] - exact)/np.hypot(r['error']['U/N'], exactError))
                         for r in small],
                'pooled': pooled,
                'error': error,
                'Monte_Carlo': exact,
                'Monte_Carlo_error': exactError,
                'z': (pooled - exact)/np.hypot(error, exactError)
            }
        entry['models'] = []
        for r in other:
            same = [f for f in free if f['h'] == r['h']]
            if same:
                entry['models'].append({
                    'h': r['h'],
                    'model': r['model'],
                    **{
                        f'z {name}': (r['mean'][name] - same[0]['mean'][name])/np.hypot(
                            r['error'][name], same[0]['error'][name])
                        for name in QUANTITIES
                    }
                })
        result[f'kT={kT:g}'] = entry
    return result


def draw(runs, analysis, path):
    """Draw Figures S1 and S2: every quantity against h^2, with a fit.

    The fit is to the runs in a periodic fluid if there are any, otherwise to the runs without
    hydrodynamic interactions.
    """
    plt = pyplot()
    temperatures = sorted({r['kT'] for r in runs})
    figure, axes = plt.subplots(len(QUANTITIES), len(temperatures),
                                figsize=(5.2*len(temperatures), 12), squeeze=False, sharex='col',
                                constrained_layout=True)
    models = [name for name in MODELS if any(r['model'] == name for r in runs)]
    for column, kT in enumerate(temperatures):
        entry = analysis[f'kT={kT:g}']
        fitted = 'SD periodic' if 'SD periodic' in entry else 'FreeDraining'
        for row, name in enumerate(QUANTITIES):
            ax = axes[row, column]
            for model, style in zip(models, 'os^D'):
                chosen = [r for r in runs if r['kT'] == kT and r['model'] == model]
                ax.errorbar([r['h']**2 for r in chosen], [r['mean'][name] for r in chosen],
                            [r['error'][name] for r in chosen], fmt=style, ms=4,
                            mfc=None if model == fitted else 'none', label=model, capsize=2)
            x = np.linspace(0, max(r['h'] for r in runs if r['kT'] == kT)**2, 50)
            fit = entry.get(fitted, entry)['fit'][name]
            ax.plot(x, fit['A0'] + fit['E_A']*x, 'k--', lw=0.8, label=f'fit to {fitted}')
            ax.plot(x, fit['paper']['A0'] + fit['paper']['E_A']*x, 'C3:', lw=1.2,
                    label="paper's fit")
            if name == 'U/N':
                ax.errorbar([0], [MONTE_CARLO[kT][0]], [MONTE_CARLO[kT][1]], fmt='*', color='C2',
                            ms=9, label='Monte Carlo')
                ax.set_xlabel('$h^2$')
            ax.set_ylabel(name)
            ax.grid(alpha=0.3)
        axes[0, column].set_title(f'kT = {kT:g}')
        axes[-1, column].legend(fontsize=8)
    figure.savefig(path, dpi=80)


def plan(quick, factor, periodic):
    """(kT, h, model, time of each cluster, clusters)."""
    if periodic:
        if quick:
            return [(0.1, 0.2, 'SD periodic', 40.0, 8), (0.1, 0.2, 'RPY periodic', 40.0, 8)]
        # For errors of 1e-3 in U/N, as below. A step of one cluster takes 2 ms on an idle core. At
        # kT = 0.1, runs are twice as long at h = 0.15 and 0.2, where 1200 led to errors of 1.3e-3
        # and 1.7e-3: single clusters were long in another shape.
        return ([(0.1, h, 'SD periodic', factor*1200.0*longer, 32)
                 for h, longer in ((0.15, 2), (0.2, 2),
                                   (0.3, 1))] + [(0.1, 0.2, 'RPY periodic', factor*1200.0, 32)] +
                [(0.2, h, 'SD periodic', factor*7000.0*longer, 32)
                 for h, longer in ((0.15, 0.7), (0.2, 1), (0.24, 1.3))])
    if quick:
        return [(0.1, h, model, t, 8)
                for h, model, t in ((0.05, 'FreeDraining', 200.0), (0.2, 'FreeDraining', 800.0),
                                    (0.3, 'FreeDraining', 800.0), (0.2, 'RPY', 40.0))]
    runs = []
    # Lengths for standard errors of at most 1e-3 in U/N: in trial runs error^2 x time x clusters
    # was about 0.024 (kT = 0.1) and 0.19 (0.2), whatever the step and the model, but 0.34 at kT =
    # 0.2, h = 0.01.
    for kT, free, fluid, last in ((0.1, 2000.0, 1200.0, 0.3), (0.2, 12500.0, 8500.0, 0.24)):
        for h in (0.2, 0.1, last, 0.15, 0.05, 0.02, 0.01, 0.005):
            longer = (8 if kT == 0.1 and h >= 0.1 else
                      2.4 if kT == 0.2 and h == 0.01 else 2 if h >= 0.1 else 1)
            runs.append((kT, h, 'FreeDraining', factor*free*longer, 16))
        for h in (0.02, 0.1, 0.2):
            runs.append((kT, h, 'RPY', factor*fluid, 32))
    return runs


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--quick', action='store_true',
                        help='a smoke test: seconds instead of minutes')
    parser.add_argument('--periodic', action='store_true',
                        help='run in a periodic fluid, as in the paper')
    parser.add_argument('--long', type=float, default=1.0, metavar='FACTOR',
                        help='multiply the length of every run')
    parser.add_argument(
        '--keep', action='store_true',
        help='keep the runs that the output folder has already; run what is missing or shorter')
    parser.add_argument('--platform', default='CPU')
    parser.add_argument('--seed', type=int, default=2017)
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    campaign.addOptions(parser)
    args = campaign.settle(parser.parse_args())

    name = 'lennard_jones_periodic' if args.periodic else 'lennard_jones'
    runs, compared = {}, []
    if args.keep and (args.output/f'{name}.json').exists():
        runs = {(r['kT'], r['h'], r['model']): r
                for r in json.loads((args.output/f'{name}.json').read_text())['runs']}
    if args.periodic:
        # Published runs, or runs of this script into the same folder.
        file = next(folder/'lennard_jones.json' for folder in (args.output, RESULTS)
                    if (folder/'lennard_jones.json').exists())
        compared = [r for r in json.loads(file.read_text())['runs'] if r['model'] == 'FreeDraining']
    todo = [(*task, args.seed + i)
            for i, task in enumerate(plan(args.quick, args.long, args.periodic))]
    order = [task[:3] for task in todo]

    # The cheapest run is first (in a periodic fluid all runs at kT = 0.1 before those at 0.2). An
    # older run that is to be longer stays until its successor is there.
    def cost(task):
        kT, h, model, duration, clusters, _ = task
        return args.periodic*kT, duration/h*clusters*(60 if model == 'RPY' else 1)

    def isMissing(kT, h, model, duration, clusters, seed):
        r = runs.get((kT, h, model))
        return r is None or (r['time_per_cluster'], r['clusters'], r['seed']) != (duration,
                                                                                  clusters, seed)

    todo = [(*task, args.platform, 400.0 if args.quick else PREPARATION)
            for task in sorted(todo, key=cost) if isMissing(*task)]

    def result():
        done = [runs[key] for key in order if key in runs]
        return done, {
            'runs': done,
            'analysis': analyse(compared + done),
            'provenance': provenance(args)
        }

    def finish(index, r):
        runs[todo[index][:3]] = dict(r, provenance=provenance(args))
        print(
            f'kT {r["kT"]:g} h {r["h"]:g} {r["model"]}: ' +
            ', '.join(f'{n} {brackets(r["mean"][n], r["error"][n])}'
                      for n in QUANTITIES) + f'  [{r["seconds"]:.0f} s]', flush=True)
        save(args.output, f'{name}.json', result()[1])

    campaign.run(run, todo,
                 [f'lennard_jones {model} kT {kT:g} h {h:g}' for kT, h, model, *_ in todo], args,
                 [round(duration/h/max(1, round(SAMPLE_TIME/h)))
                  for _, h, _, duration, *_ in todo], 'sample', 'Lennard-Jones', finish)
    done, final = result()
    draw(compared + done, final['analysis'], args.output/f'{name}.png')


if __name__ == '__main__':
    main()
