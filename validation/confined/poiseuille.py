#!/usr/bin/python3
"""Poiseuille flow of a suspension of spheres between walls: velocity profile and viscosity.

    /usr/bin/python3 poiseuille.py --output results
    /usr/bin/python3 poiseuille.py --output somewhere --quick     # seconds

The flow is that of configurations of hard spheres in equilibrium: the limit of high frequencies,
without Brownian stress. No time passes. README.md in this folder says what was measured.
"""
import argparse
import pathlib
import time

import numpy as np

from confinedscene import VISCOSITY, Scene, meanAndError, quietly, sphere, turns  # isort: skip
import campaign  # isort: skip
from openmmrigidhi import analysis  # isort: skip
from recording import brackets, provenance, pyplot, save  # isort: skip

FORCE = 1.0
#: Heights of one sphere by itself.
HEIGHTS = 16
SIDE = 8.0
#: Centres stay so far from walls, and spheres from each other: shells of 12 reach 1.21.
RADIUS = 1.21


class Spheres:
    """Hard spheres between walls z = 0 and z = height, with periods along x and y."""
    def __init__(self, count, height, random):
        self.count, self.height, self.random = count, height, random
        size, tries = (SIDE, SIDE, height - 2*RADIUS), 0
        # Small first, then grown: spheres placed at random would not fit.
        self.centres = random.uniform(0, 1, (count, 3))*size + (0, 0, RADIUS)
        diameter, reach = 0.3, 0.8
        while diameter < 2*RADIUS:
            self.sweep(3, diameter, reach)
            diameter = min(2*RADIUS, max(diameter, self.nearest()*0.9999))
            tries += 1
            if tries > 5000:
                raise RuntimeError(f'{count} spheres do not fit between walls {height} apart')
        self.reach = reach

    def apart(self, k, place):
        d = self.centres - place
        d[:, :2] -= SIDE*np.rint(d[:, :2]/SIDE)
        squares = (d*d).sum(1)
        squares[k] = np.inf
        return squares

    def nearest(self):
        if self.count < 2:
            return np.inf
        return np.sqrt(min(self.apart(k, self.centres[k]).min() for k in range(self.count)))

    def sweep(self, sweeps, diameter=2*RADIUS, reach=0.8):
        for _ in range(sweeps*self.count):
            k = self.random.integers(self.count)
            new = self.centres[k] + self.random.uniform(-reach, reach, 3)
            if RADIUS <= new[2] <= self.height - RADIUS:
                old = self.apart(k, self.centres[k]).min() if diameter < 2*RADIUS else np.inf
                # While they are grown, spheres that overlap may move apart.
                if self.apart(k, new).min() >= min(diameter, np.sqrt(old))**2:
                    self.centres[k] = new


def spheresHeights(height):
    """Of one sphere by itself: equally spaced."""
    return RADIUS + (np.arange(HEIGHTS) + 0.5)/HEIGHTS*(height - 2*RADIUS)


def measure(case, job):
    """Viscosity and profile of one case, averaged over configurations."""
    began, random = time.process_time(), np.random.default_rng(case['seed'])
    spheres = Spheres(case['count'], case['height'], random)
    spheres.sweep(case['sweeps'])
    sites, radius = sphere(case['blobs'])
    scene = quietly(Scene, 'NoSlipChannel', sites, radius, case['count'], side=SIDE,
                    height=case['height'], temperature=0, scheme='EulerMaruyama',
                    prepare=lambda fluid: fluid.setBodyForceDensity((FORCE, 0, 0)))
    planes = (np.arange(case['planes']) + 0.5)*case['height']/max(1, case['planes'])
    grid = (np.arange(case['points']) + 0.5)*SIDE/case['points']
    points = np.array([(x, y, z) for z in planes for x in grid for y in grid])
    ratios, profiles, heights = [], [], []
    for k in range(case['configurations']):
        spheres.sweep(case['sweeps'])
        if case['count'] == 1:
            # Heights of one sphere are equally spaced, which has less noise than random ones.
            spheres.centres[0, 2] = spheresHeights(case['height'])[k % HEIGHTS]
        scene.place(spheres.centres, turns(random, case['count']) if case['blobs'] > 1 else None)
        ratios.append(analysis.viscosity(scene.context).ratio)
        if case['planes']:
            flow = scene.fluid.getFlowInContext(scene.context, points)._value[:, 0]
            profiles.append(flow.reshape(case['planes'], -1).mean(1))
            heights.append(
                np.histogram(spheres.centres[:, 2], case['planes'], (0, case['height']))[0])
        job.report((k + 1)*(case['count']*case['blobs'])**2)
    volume = SIDE**2*case['height']
    found = dict(case, fraction=case['count']*4*np.pi/3/volume, side=SIDE,
                 processor_seconds=time.process_time() - began)
    if case['count'] == 1:
        # Each round has all heights; only directions are random.
        ratios = np.reshape(ratios, (-1, HEIGHTS))
        found['heights'], found['of_heights'] = spheresHeights(case['height']), ratios.mean(0)
        ratios = ratios.mean(1)
    found['ratio'], found['ratio_error'] = meanAndError(ratios)
    if case['planes']:
        found.update(z=planes, density=np.mean(heights, 0)/case['count'])
        found['profile'], found['profile_error'] = meanAndError(profiles)
    return found


def cases(quick, seed):
    made = []

    def add(blobs, count, height, configurations):
        made.append({
            'blobs': blobs,
            'count': count,
            'height': height,
            'configurations': configurations,
            'planes': 0 if blobs == 42 or count == 1 and not quick else 8 if quick else 16,
            'points': 4 if quick else 5,
            'sweeps': 20 if quick else 200,
            'seed': seed + len(made)
        })

    add(1, 3 if quick else 24, 8.0, 3)
    for count in (1, 4) if quick else (1, 3, 6, 12, 18, 24):
        add(12, count, 8.0, 3*HEIGHTS if count == 1 else 3 if quick else 16)
    if not quick:
        for count in (1, 6, 12):
            add(42, count, 8.0, 3*HEIGHTS if count == 1 else 10)
        for height in (4.0, 16.0):
            add(12, 1, height, 3*HEIGHTS)
    return made


def dilute(height, radius=1.0):
    """Einstein's slope in a slit: 5/2 of the dissipation where centres may be.

    Centres are spread evenly where they may be; the flow is the undisturbed one.
    """
    free = height - 2*radius
    return 2.5*(free/height)**2


def tables(data):
    yield ('| blobs of a sphere | width H/a | spheres | volume fraction | viscosity over the '
           'fluid\'s | (ratio − 1)/fraction | Einstein in the slit |')
    yield '|---|---|---|---|---|---|---|'
    for run in data['runs']:
        f = run['fraction']
        ratio, error = run['ratio'], run['ratio_error']
        same = error < 1e-9
        yield (f'| {run["blobs"]} | {run["height"]:g} | {run["count"]} | {f:.3f} | '
               f'{format(ratio, ".6f") if same else brackets(ratio, error)} | '
               f'{format((ratio - 1)/f, ".3f") if same else brackets((ratio - 1)/f, error/f)} | '
               f'{dilute(run["height"], RADIUS):.2f} |')


def draw(data, file):
    plt = pyplot()
    figure, axes = plt.subplots(1, 3, figsize=(14, 4.6), layout='constrained')
    shown = [run for run in data['runs'] if run['height'] == 8.0]
    for k, run in enumerate(run for run in shown if run['planes']):
        z, mean = np.array(run['z']), FORCE*run['height']**2/(12*VISCOSITY)
        axes[0].errorbar(
            z,
            np.array(run['profile'])/mean,
            np.array(run['profile_error'])/mean, fmt='os^Dvp<>'[k % 8], markersize=3.5,
            color=f'C{k}',
            label=f'{"sphere" if run["blobs"] == 1 else "12 blobs"}, φ = {run["fraction"]:.3f}')
    x = np.linspace(0, 8, 100)
    axes[0].plot(x, 6*x*(8 - x)/64, 'k-', linewidth=0.8, label='without spheres')
    axes[0].set(title='Mean velocity in planes', xlabel='z/a',
                ylabel='over the mean without spheres')
    for k, run in enumerate(run for run in data['runs'] if run['count'] == 1):
        height = run['height']
        axes[1].plot(
            np.array(run['heights'])/height, (np.array(run['of_heights']) - 1)/run['fraction'],
            'os^v'[k % 4], markersize=4, label=f'shell of {run["blobs"]}, H = {height:g}')
    x = np.linspace(0, 1, 100)
    axes[1].plot(x, 7.5*(1 - 2*x)**2, 'k--', linewidth=0.8, label='Einstein, where it is')
    axes[1].set(title='One sphere', xlabel='height of its centre/H',
                ylabel='(viscosity ratio − 1)/fraction', ylim=(0, 7))
    for k, (blobs, style) in enumerate(((1, 'o'), (12, 's'), (42, '^'))):
        own = [run for run in shown if run['blobs'] == blobs]
        axes[2].errorbar([run['fraction'] for run in own], [run['ratio'] for run in own],
                         [run['ratio_error']
                          for run in own], fmt=style, color=f'C{k}', capsize=3, markersize=5,
                         label='single spheres' if blobs == 1 else f'shells of {blobs}')
    f = np.linspace(0, 0.2, 10)
    axes[2].plot(f, 1 + dilute(8.0, RADIUS)*f, 'k--', linewidth=0.8, label='Einstein in the slit')
    axes[2].plot(f, 1 + 2.5*f, 'k:', linewidth=0.8, label='1 + 5φ/2')
    axes[2].set(title='Apparent viscosity, H = 8 a', xlabel='volume fraction φ',
                ylabel='over that of the fluid', xlim=(0, 0.21), ylim=(0.98, 1.55))
    for ax in axes:
        ax.legend(fontsize=7)
    figure.savefig(file, dpi=85)
    plt.close(figure)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--output', type=pathlib.Path, default=pathlib.Path('poiseuille_output'))
    parser.add_argument('--quick', action='store_true', help='few spheres: seconds')
    parser.add_argument('--seed', type=int, default=32)
    campaign.addOptions(parser)
    args = campaign.settle(parser.parse_args())
    todo = cases(args.quick, args.seed)
    runs = campaign.run(measure, todo,
                        [f'{case["blobs"]} {case["count"]} {case["height"]}' for case in todo],
                        args, [(case['count']*case['blobs'])**2*case['configurations']
                               for case in todo], 'pair of blobs', 'poiseuille')
    data = {'provenance': provenance(args), 'viscosity': VISCOSITY, 'force': FORCE, 'runs': runs}
    save(args.output, 'poiseuille.json', data)
    draw(data, args.output/'poiseuille.png')
    print('\n'.join(tables(data)))


if __name__ == '__main__':
    main()
