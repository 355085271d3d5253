#!/usr/bin/python3
"""A monolayer of spheres above a wall: short-time diffusion along it, over the area fraction.

    /usr/bin/python3 monolayer.py --output results
    /usr/bin/python3 monolayer.py --output somewhere --quick     # seconds

Short-time coefficients are exact averages of the mobility over configurations: those of one
sphere (self) and those of all spheres together (collective). Configurations are hard discs of
radius 1, from Monte Carlo. README.md in this folder says what was measured.
"""
import argparse
import pathlib
import time

import numpy as np

from confinedscene import Scene, meanAndError, quietly, sphere, turns  # isort: skip
import campaign  # isort: skip
from recording import brackets, provenance, pyplot, save  # isort: skip

#: Height of the centres over the wall. Shells of 12 blobs of hydrodynamic radius 1 reach 1.21.
HEIGHT = 1.25
FRACTIONS = (0.1, 0.2, 0.3, 0.4, 0.5)
NO_TURN = (1.0, 0, 0, 0)


class Discs:
    """Hard discs of radius 1 in a square with periods, moved one by one."""
    def __init__(self, count, fraction, random):
        rows = int(np.ceil(np.sqrt(count)))
        self.count, self.random = count, random
        self.side = np.sqrt(count*np.pi/fraction)
        grid = (np.arange(rows) + 0.5)*self.side/rows
        self.centres = np.array([(x, y) for x in grid for y in grid])[:count]
        self.reach = 0.5

    def sweep(self, sweeps, adapt=False):
        for _ in range(sweeps):
            accepted = 0
            for k, move in zip(self.random.integers(self.count, size=self.count),
                               self.random.uniform(-self.reach, self.reach, (self.count, 2))):
                new = self.centres[k] + move
                apart = self.centres - new
                apart -= self.side*np.rint(apart/self.side)
                squares = (apart*apart).sum(1)
                squares[k] = 4
                if squares.min() >= 4:
                    self.centres[k] = new % self.side
                    accepted += 1
            if adapt:
                self.reach = np.clip(self.reach*(1.1 if accepted > 0.4*self.count else 0.9), 0.02,
                                     self.side/2)


def layer(case, job):
    """Coefficients of one case, averaged over configurations.

    self is the mean of the own (xx + yy)/2, zz, and turns; collective is the velocity along the
    wall under a unit force on every sphere.
    """
    began, random = time.process_time(), np.random.default_rng(case['seed'])
    discs = Discs(case['count'], case['fraction'], random)
    discs.sweep(case['settle'], adapt=True)
    sites, radius = sphere(case['blobs'])
    isOpen = case['boundary'] == 'NoSlipWall'
    scene = quietly(Scene, case['boundary'], sites, radius, case['count'],
                    side=None if isOpen else discs.side, isBestKnown=case['isBestKnown'])
    own, inner, collective = [], [], []
    for k in range(case['configurations']):
        discs.sweep(case['sweeps'])
        positions = np.column_stack([discs.centres, np.full(case['count'], HEIGHT)])
        scene.place(positions, turns(random, case['count']) if case['blobs'] > 1 else None)
        M = scene.mobility()
        diagonal = np.einsum('iaia->ia', M)
        along = diagonal[:, :2].mean(1)
        own.append(np.append(along.mean(), diagonal.mean(0)[[2, 5]]))
        # Spheres of an open patch that are far from its edge: a quarter of them.
        middle = np.argsort(np.abs(discs.centres - discs.side/2).max(1))
        inner.append(along[middle[:max(1, case['count'] // 4)]].mean())
        collective.append((M[:, 0, :, 0].sum() + M[:, 1, :, 1].sum())/2/case['count'])
        job.report((k + 1)*(case['count']*case['blobs'])**2)
    images = 0.0 if isOpen else imagesOf(case['blobs'], case['isBestKnown'], discs.side,
                                         case['seed'])
    found = dict(case, side=discs.side, images=images,
                 processor_seconds=time.process_time() - began)
    for name, values in (('self', own), ('inner', inner), ('collective', collective)):
        found[name], found[name + '_error'] = meanAndError(values)
    return found


def imagesOf(blobs, isBestKnown, side, seed):
    """What the periodic images of one sphere add to its mobility along the wall."""
    sites, radius = sphere(blobs)
    turn = turns(np.random.default_rng(seed), 1) if blobs > 1 else None
    values = []
    for boundary, period in (('PeriodicWall', side), ('NoSlipWall', None)):
        scene = quietly(Scene, boundary, sites, radius, 1, side=period, isBestKnown=isBestKnown)
        scene.place(np.array([(0, 0, HEIGHT)]), turn)
        values.append(np.einsum('iaia->ia', scene.mobility())[0, :2].mean())
    return values[0] - values[1]


def alone(blobs, isBestKnown, boundary, seed, poses=48):
    """One sphere without periods: own coefficients along, across, about the normal, and errors."""
    sites, radius = sphere(blobs)
    random, poses = np.random.default_rng(seed), poses if blobs > 1 else 2
    scene = quietly(Scene, boundary, sites, radius, poses, isBestKnown=isBestKnown, isAlone=True)
    scene.place(np.tile((0, 0, HEIGHT), (poses, 1)), turns(random, poses) if blobs > 1 else None)
    diagonal = np.einsum('iaia->ia', scene.mobility())
    mean, error = meanAndError(np.column_stack([diagonal[:, :2].mean(1), diagonal[:, [2, 5]]]))
    return {'mean': mean, 'error': error}


def pairs(blobs, isBestKnown, boundary, seed, model=None, radii=16, poses=24):
    """Own mobility along the wall and mutual one of two spheres, over the distance.

    Gauss points in 1/r^2 cover 2 < r < infinity, and points in r the overlaps.
    """
    x, w = np.polynomial.legendre.leggauss(radii)
    u, weights = (x + 1)/8, w/8  # of u = 1/r^2, 0 to 1/4: r dr = du/(2 u^2)
    near, nearWeights = x + 1, w
    sites, radius = sphere(blobs)
    repeat = poses if blobs > 1 else 1
    turned = turns(np.random.default_rng(seed), 2*repeat) if blobs > 1 else None
    scene = quietly(Scene, boundary, sites, radius, 2*repeat, model=model, isBestKnown=isBestKnown,
                    prepare=lambda fluid: fluid.setGroups(np.repeat(np.arange(repeat), 2)))

    def along(r):
        positions = np.tile([(0, 0, HEIGHT), (r, 0, HEIGHT)], (repeat, 1))
        scene.place(positions, turned)
        M = scene.mobility()
        own = np.einsum('iaia->ia', M)[:, :2].mean()
        first = 2*np.arange(repeat)
        mutual = (M[first, 0, first + 1, 0] + M[first, 1, first + 1, 1]).mean()/2
        return own, mutual

    # Single spheres in the same poses, far apart.
    single = along(1e5)[0]
    far = np.array([along(1/np.sqrt(v)) for v in u])
    # Area fraction f is pi n; sum over pairs: n 2 pi integral r dr = f integral du/u^2.
    slope = float((weights/u**2) @ (far[:, 0]/single - 1))
    overlap = np.array([along(r)[1] for r in near]) if blobs == 1 and model is None else None
    found = {'distance': 1/np.sqrt(u), 'own_ratio': far[:, 0]/single, 'self_slope': slope}
    if overlap is not None and boundary == 'NoSlipWall':
        # Without excluded area the sum is the response to a uniform force density in the layer,
        # averaged over both spheres: (z - 1/3)/eta n. Excluded is r < 2.
        whole = 6*np.pi*(HEIGHT - 1/3)/np.pi
        excluded = 2*float((nearWeights*near) @ overlap)
        found['collective_slope'] = (whole - excluded)/single if not isBestKnown else None
    return found


def cases(quick, seed):
    """All runs; the seed of a run follows from its place."""
    made = []

    def add(kind, boundary, blobs, count, fraction, configurations, isBestKnown=False):
        made.append({
            'kind': kind,
            'boundary': boundary,
            'blobs': blobs,
            'count': count,
            'fraction': fraction,
            'configurations': configurations,
            'isBestKnown': isBestKnown,
            'settle': 60 if quick else 400,
            'sweeps': 10 if quick else 60,
            'seed': seed + len(made)
        })

    for fraction in FRACTIONS[1:4:2] if quick else FRACTIONS:
        add('density', 'PeriodicWall', 1, 9 if quick else 100, fraction, 3 if quick else 8)
        add('density', 'PeriodicWall', 1, 9 if quick else 100, fraction, 3 if quick else 8, True)
        add('density', 'PeriodicWall', 12, 4 if quick else 25, fraction, 3 if quick else 12)
        add('density', 'NoSlipWall', 12, 4 if quick else 25, fraction, 3 if quick else 12)
        if not quick:
            add('density', 'PeriodicWall', 42, 16, fraction, 6)
    for count in (4, 9) if quick else (16, 36, 100, 196):
        add('box', 'PeriodicWall', 1, count, 0.3, 3 if quick else 8)
    for count in (4, 9) if quick else (16, 36, 100, 196, 400):
        add('box', 'NoSlipWall', 1, count, 0.3, 3 if quick else 8)
    for count in (4,) if quick else (9, 16, 25, 36, 49):
        add('box', 'PeriodicWall', 12, count, 0.3, 3 if quick else 8)
    return made


def singles(seed, quick):
    """One sphere, and two, without periods."""
    poses = 4 if quick else 24
    found = {}
    for name, blobs, isBestKnown in (('1', 1, False), ('1 BestKnown', 1, True), ('12', 12, False),
                                     ('42', 42, False)):
        found[name] = alone(blobs, isBestKnown, 'NoSlipWall', seed, 2*poses)
        found[name]['pairs'] = pairs(blobs, isBestKnown, 'NoSlipWall', seed, poses=poses)
    found['unbounded 12'] = {'pairs': pairs(12, False, 'Unbounded', seed, poses=poses)}
    found['unbounded 42'] = {'pairs': pairs(42, False, 'Unbounded', seed, poses=poses)}
    found['unbounded exact pairs'] = {
        'pairs': pairs(1, False, 'Unbounded', seed, model='StokesianDynamics')
    }
    return found


def nameOf(case):
    """Of a model and boundary, in tables."""
    return ('spheres' if case['blobs'] == 1 else f'shells of {case["blobs"]}') + (
        ', BestKnown' if case['isBestKnown'] else '') + (', no periods' if case['boundary']
                                                         == 'NoSlipWall' else '')


def single(data, run):
    return data['singles'][str(run['blobs']) + (' BestKnown' if run['isBestKnown'] else '')]


def ratio(data, run, key):
    """A coefficient over that of one sphere by itself, and its standard error."""
    base = single(data, run)['mean'][0]
    value, error = run[key], run[key + '_error']
    if key == 'self':
        # Less what the images of one sphere by itself add in this box.
        value, error = value[0] - run['images'], error[0]
    return value/base, error/base


def cell(data, run, key):
    value, error = ratio(data, run, key)
    return brackets(value, error) if error > 1e-6 else f'{value:.4f}'


def tables(data):
    """Lines of Markdown."""
    density = [run for run in data['runs'] if run['kind'] == 'density']
    fractions = sorted({run['fraction'] for run in density})
    for key, title in (('self', 'one sphere'), ('collective', 'all together')):
        yield f'| {title}: D/D₀ | ' + ' | '.join(f'{f:g}' for f in fractions) + ' |'
        yield '|---|' + len(fractions)*'---|'
        for name in dict.fromkeys(nameOf(run) for run in density):
            own = {run['fraction']: run for run in density if nameOf(run) == name}
            yield f'| {name} | ' + ' | '.join(cell(data, own[f], key) for f in fractions) + ' |'
            if key == 'self' and 'no periods' in name:
                yield f'| {name}, inner quarter | ' + ' | '.join(
                    cell(data, own[f], 'inner') for f in fractions) + ' |'
        yield ''
    yield ('| 30 % of the area | spheres in the box | side | one sphere with images '
           '| one sphere, less its own images | all together |')
    yield '|---|---|---|---|---|---|'
    for run in data['runs']:
        if run['kind'] == 'box':
            yield (f'| {nameOf(run)} | {run["count"]} | {run["side"]:.1f} | '
                   f'{run["self"][0]/single(data, run)["mean"][0]:.4f} | '
                   f'{cell(data, run, "self")} | {cell(data, run, "collective")} |')
    yield ''
    yield '| one sphere by itself | D₀ along | across | about the normal, times 4/3 |'
    yield '|---|---|---|---|'
    for name, own in data['singles'].items():
        if 'mean' in own:
            values = np.array(own['mean'])*(1, 1, 4/3)
            yield f'| {name} | ' + ' | '.join(f'{v:.4f}' for v in values) + ' |'
    yield ''
    yield '| dilute limit, from pairs | self: slope | collective: slope |'
    yield '|---|---|---|'
    for name, own in data['singles'].items():
        found = own['pairs']
        other = found.get('collective_slope')
        yield f'| {name} | {found["self_slope"]:.3f} | ' + (f'{other:.3f}'
                                                            if other is not None else '') + ' |'


def draw(data, file):
    plt = pyplot()
    figure, axes = plt.subplots(1, 3, figsize=(14, 4.6), layout='constrained')
    density = [run for run in data['runs'] if run['kind'] == 'density']
    names = list(dict.fromkeys(nameOf(run) for run in density))
    for ax, key in zip(axes, ('self', 'collective')):
        for k, name in enumerate(names):
            own = [run for run in density if nameOf(run) == name]
            values = np.array([ratio(data, run, key) for run in own])
            ax.errorbar([run['fraction'] for run in own], values[:, 0], values[:, 1],
                        fmt='os^Dv'[k % 5], color=f'C{k}', markersize=5, capsize=3, label=name,
                        markerfacecolor='none' if 'no periods' in name else None)
        ax.set(xlabel='area fraction', ylabel='D/D₀ of one sphere by itself', xlim=(0, 0.55))
    x = np.linspace(0, 0.3, 10)
    for name, style in (('12', 'C2--'), ('42', 'C4--')):
        axes[0].plot(x, 1 + data['singles'][name]['pairs']['self_slope']*x, style, linewidth=0.9,
                     label=f'pairs alone, shells of {name}')
    slope = data['singles']['1']['pairs']['collective_slope']
    axes[1].plot(x, 1 + slope*x, 'C0--', linewidth=0.9, label='spheres: dilute limit')
    axes[0].set(title='One sphere, short times')
    axes[1].set(title='All together, short times')
    box = [run for run in data['runs'] if run['kind'] == 'box']
    for k, name in enumerate(dict.fromkeys(nameOf(run) for run in box)):
        own = [run for run in box if nameOf(run) == name]
        for key, style in (('collective', 'o-'), ('self', 's--')):
            values = np.array([ratio(data, run, key) for run in own])
            axes[2].errorbar([1/run['side'] for run in own], values[:, 0], values[:, 1], fmt=style,
                             color=f'C{k}', markersize=4, capsize=3, linewidth=0.8,
                             label=f'{name}: {"all" if key == "collective" else "one"}')
    axes[2].set(title='Area fraction 0.3', xlabel='1/side of the box, or of the patch',
                xlim=(0, None))
    for ax in axes:
        ax.legend(fontsize=7)
        ax.grid(alpha=0.3)
    figure.savefig(file, dpi=85)
    plt.close(figure)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--output', type=pathlib.Path, default=pathlib.Path('monolayer_output'))
    parser.add_argument('--quick', action='store_true', help='few spheres: seconds')
    parser.add_argument('--seed', type=int, default=32)
    campaign.addOptions(parser)
    args = campaign.settle(parser.parse_args())
    todo = cases(args.quick, args.seed)
    runs = campaign.run(
        layer, todo,
        [f'{k} {nameOf(case)} {case["count"]} {case["fraction"]}' for k, case in enumerate(todo)],
        args, [(case['count']*case['blobs'])**2*case['configurations']
               for case in todo], 'pair of blobs', 'monolayer')
    data = {
        'provenance': provenance(args),
        'height': HEIGHT,
        'runs': runs,
        'singles': campaign.asJson(singles(args.seed, args.quick))
    }
    save(args.output, 'monolayer.json', data)
    draw(data, args.output/'monolayer.png')
    print('\n'.join(tables(data)))


if __name__ == '__main__':
    main()
