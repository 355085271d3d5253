#!/usr/bin/env python3
"""Davidchack 2017, Table S1: two spheres side by side sediment without noise, by all models.

The models are those of the hydrodynamic ladder. The dynamics is run to its steady state at h =
0.001, 0.01, 0.02, 0.03, 0.04 (m = 0.25, I = 0.1). F/U and omega/U are extrapolated h^2 -> 0 and
compared with the exact solution of Stokes' equations. The spheres lie on the x axis, the force is
along z. Multiblob shells have corners, but the force is so weak that they do not turn noticeably
while they settle: Stokes flow is linear.

    python3 sedimenting_spheres.py           # minutes, nearly all for the shells of 162 blobs
    python3 sedimenting_spheres.py --jobs 2  # two separations or models at a time
    python3 sedimenting_spheres.py --quick   # seconds: one separation, no large shells
"""
import argparse
import pathlib
import time

import numpy as np
import openmm
import openmmrigidhi
from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce
from spheres import RESULTS, VISCOSITY, Spheres, campaign, provenance, pyplot, sample, save

MASS, MOMENT, FORCE = 0.25, 0.1, 1e-6
SEPARATIONS = {'10': 10.0, '4': 4.0, '3': 3.0, '5/2': 2.5, '25/12': 25/12}
STEPS = (0.04, 0.03, 0.02, 0.01, 0.001)
#: Table S1: F/U and omega/U, computed by the paper (extrapolated) and its series for large l.
PAPER = {
    '10': (1.3946988, 1.3946984, 0.006973076, 0.006973573),
    '4': (1.2551892, 1.2545428, 0.03906680, 0.03925395),
    '3': (1.1840827, 1.1806098, 0.06455729, 0.06596017),
    '5/2': (1.1308965, 1.1208450, 0.08549728, 0.09099600),
    '25/12': (1.0756197, 1.0450674, 0.09772490, 0.12515166)
}
#: Solved by boundary collocation with Lamb's solution (40 to 120 harmonics), independently of this
#: package and of the paper.
COLLOCATION = {
    '10': (1.3947015340, 0.006973274431),
    '3': (1.1840839517, 0.064558335059),
    '25/12': (1.0756206190, 0.097726919137)
}
MODELS = ('RPY', 'FTS', 'FTS+lubrication', 'multiblob 12', 'multiblob 42', 'multiblob 162')
#: Steady: the velocities change by less than this (relative) in the time SETTLE.
STEADY, SETTLE = 1e-10, 0.25


# ---- The exact answer ----------------------------------------------------------------------------
def exactPair(l, points=700, depth=None):
    """F/U and omega/U of two spheres of radius 1, by the method of fundamental solutions.

    Their centres are a distance l apart. Stokeslets are on a sphere inside each sphere. Their
    strengths are those that meet the boundary condition on the surface best (least squares). The
    second sphere's stokeslets are the mirror images of the first's. The method converges
    exponentially unless the spheres nearly touch.
    """
    def fibonacci(n):
        k = np.arange(n) + 0.5
        z, phi = 1 - 2*k/n, np.pi*(1 + 5**0.5)*k
        return np.stack([np.sqrt(1 - z*z)*np.cos(phi), np.sqrt(1 - z*z)*np.sin(phi), z], axis=1)

    def oseen(target, source):
        d = target[:, None] - source[None]
        r = np.linalg.norm(d, axis=2)[..., None, None]
        return ((np.eye(3)/r + d[..., :, None]*d[..., None, :]/r**3)/(8*np.pi*VISCOSITY)).transpose(
            0, 2, 1, 3)

    depth = depth or 0.5
    centre, mirror = np.array([-l/2, 0, 0]), np.array([-1.0, 1, 1])
    inside, surface = centre + depth*fibonacci(points), centre + fibonacci(2*points)
    flow = oseen(surface, inside) + oseen(surface, inside*mirror)*mirror
    flow = flow.reshape(3*len(surface), 3*points)
    fall = np.tile([0, 0, 1.0], len(surface))
    spin = np.cross([0, -1.0, 0], surface - centre).reshape(-1)
    strengths = np.linalg.lstsq(flow, np.stack([fall, spin], axis=1), rcond=1e-14)[0]
    strengths = strengths.T.reshape(2, points, 3)
    force = strengths[:, :, 2].sum(1)
    torque = np.cross(inside - centre, strengths)[:, :, 1].sum(1)
    omega = -torque[0]/torque[1]
    return force[0] + omega*force[1], omega


# ---- Running the dynamics ------------------------------------------------------------------------
class Pair:
    """Two bodies a distance l apart on the x axis, with a force along z on each centre."""
    def __init__(self, name, l, step):
        centres = np.array([(-l/2, 0, 0), (l/2, 0, 0)])
        if name.startswith('multiblob'):
            self.integrator, system, positions, middle = self._shells(int(name.split()[1]), centres,
                                                                      step)
        else:
            model = (MobilityForce.RotnePragerYamakawa
                     if name == 'RPY' else MobilityForce.StokesianDynamics)
            scene = Spheres(2, MASS, 3*(MOMENT,), 0, step, model, lubrication='lubrication' in name)
            self.integrator, system, positions, middle = scene.integrator, scene.system, centres, (
                0, 1)
        gravity = openmm.CustomExternalForce(f'-{FORCE}*z')
        for i in middle:
            gravity.addParticle(i)
        system.addForce(gravity)
        self.context = openmm.Context(system, self.integrator,
                                      openmm.Platform.getPlatformByName('Reference'))
        self.context.setPositions(positions)

    @staticmethod
    def _shells(n, centres, step):
        shell, blob = (x._value for x in openmmrigidhi.app.multiblobSphere(n, 1))
        system, fluid, integrator = openmm.System(), MobilityForce(), CustomRigidHIIntegrator(
            0, step)
        integrator.setScheme(CustomRigidHIIntegrator.LangevinHI)
        fluid.setViscosity(VISCOSITY)
        sites = np.vstack([np.zeros((1, 3)), shell])
        for _ in centres:
            members = [system.addParticle(0.0) for _ in sites]
            for radius in [0.0] + n*[blob]:
                fluid.addParticle(radius)
            integrator.addRigidBody(members, MASS, 3*(MOMENT,), sites)
        system.addForce(fluid)
        return integrator, system, (centres[:, None] + sites).reshape(-1, 3), (0, n + 1)

    def settle(self, label):
        """Step until steady; F/U, omega/U, steps."""
        step = self.integrator.getStepSize()._value
        chunk, before, steps = max(1, round(SETTLE/step)), np.zeros(2), 0
        for _ in sample(self.integrator, 200, chunk):
            steps += chunk
            v, w = self.integrator.getBodyVelocities(
            )._value, self.integrator.getBodyAngularVelocities()._value
            now = np.array([v[:, 2].mean(), (w[1, 1] - w[0, 1])/2])
            if np.all(abs(now - before) < STEADY*abs(now)):
                return FORCE/now[0], now[1]/now[0], steps, np.stack([v, w])
            before = now
        raise RuntimeError(f'{label}: not steady after {steps} steps')


def ladder(argument, job):
    """One model at one separation, steady at every step size.

    The first step size starts from rest. Each further one starts from the velocities that those
    before predict.
    """
    name, separation = argument
    l, began = SEPARATIONS[separation], time.time()
    state = campaign.State(job, argument)
    kept = state.load()
    rows, ends = list(kept.get('rows', ())), list(kept.get('ends', ()))
    began -= float(kept.get('seconds', 0))
    for k, h in enumerate(STEPS):
        if k < len(rows):
            continue
        pair = Pair(name, l, h)
        if ends:
            past = np.array(STEPS[:k])**2
            expected = np.polyfit(past, np.array(ends).reshape(k, -1), min(k - 1, 2))
            v, w = sum(c*h**(2*power) for power, c in enumerate(expected[::-1])).reshape(2, 2, 3)
            pair.integrator.setBodyVelocities(v)
            pair.integrator.setBodyAngularVelocities(w)
        drag, spin, steps, end = pair.settle(f'{name} l={separation} h={h:g}')
        ends.append(end)
        rows.append((h, drag, spin, steps))
        state.save(rows=rows, ends=ends, seconds=time.time() - began)
    h, drag, spin, _ = np.array(rows).T
    return {
        'h': h,
        'F/U_h': drag,
        'omega/U_h': spin,
        'steps': [int(r[3]) for r in rows],
        'seconds': time.time() - began,
        'F/U': np.polyfit(h**2, drag, 2)[-1],
        'omega/U': np.polyfit(h**2, spin, 2)[-1],
        'F/U_straight_line': np.polyfit(h**2, drag, 1)[-1],
        'omega/U_straight_line': np.polyfit(h**2, spin, 1)[-1]
    }


def draw(result, path):
    plt = pyplot()
    figure, (top, bottom) = plt.subplots(2, 2, figsize=(11, 8.5), constrained_layout=True)
    names = [name for name in MODELS if name in result['models']]
    for ax, key in zip(top, ('F/U', 'omega/U')):
        for k, name in enumerate(names):
            rows = result['models'][name]
            ax.loglog([SEPARATIONS[s] - 2 for s in rows],
                      [max(1e-12, abs(rows[s]['relative_error'][key])) for s in rows], 'o-', ms=4,
                      color=f'C{k}', label=name)
        column = 0 if key == 'F/U' else 2
        exact = result['exact']
        ax.loglog([SEPARATIONS[s] - 2 for s in exact],
                  [abs(PAPER[s][column]/exact[s][key] - 1) for s in exact], 'k*',
                  label="paper's (num)")
        ax.loglog([SEPARATIONS[s] - 2 for s in exact],
                  [abs(PAPER[s][column + 1]/exact[s][key] - 1) for s in exact], 'k:', lw=1,
                  label='series (S1, S2)')
        ax.set(xlabel='gap (l − 2a)/a', ylabel=f'|relative error of {key}|')
        ax.grid(alpha=0.3, which='both', lw=0.4)
    top[1].legend(fontsize=7)
    shown = list(result['exact'])[len(result['exact']) // 2]
    for ax, key in zip(bottom, ('F/U', 'omega/U')):
        for k, name in enumerate(names):
            row = result['models'][name][shown]
            ax.plot(
                np.array(row['h'])**2,
                np.array(row[key + '_h'])/row[key] - 1, 'o-', ms=4, color=f'C{k}')
        ax.set(xlabel='$h^2$', ylabel=f'{key}: relative difference to h = 0',
               title=f'l/a = {shown}')
        ax.locator_params(axis='x', nbins=5)
        ax.grid(alpha=0.3)
    figure.savefig(path, dpi=90)


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--quick', action='store_true',
                        help='seconds: l = 3, without shells of 42 and 162 blobs')
    parser.add_argument('--models', nargs='+', default=MODELS, choices=MODELS, metavar='MODEL',
                        help=f'models to run, of {", ".join(MODELS)}')
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    campaign.addOptions(parser)
    args = campaign.settle(parser.parse_args())
    separations = ['3'] if args.quick else list(SEPARATIONS)
    models = [m for m in args.models if not (args.quick and m in ('multiblob 42', 'multiblob 162'))]

    result = {'exact': {}, 'models': {}}
    for s in separations:
        # At l = 3, 450 points give ten digits.
        drag, spin = exactPair(SEPARATIONS[s], 450 if args.quick else 700)
        known = COLLOCATION.get(s)
        result['exact'][s] = {
            'F/U': (known or (drag, spin))[0],
            'omega/U': (known or (drag, spin))[1],
            'source': 'collocation' if known else 'fundamental solutions',
            'F/U_fundamental_solutions': drag,
            'omega/U_fundamental_solutions': spin,
            'paper': PAPER[s]
        }
        print(f'l = {s}: exact F/U {drag:.9f}, omega/U {spin:.9f}' + (
            f'; relative difference to collocation {drag/known[0] - 1:.1e}, {spin/known[1] - 1:.1e}'
            if known else ''))
    todo, rows = [(name, s) for name in models for s in separations], {}

    def finish(index, row):
        name, s = todo[index]
        row['relative_error'] = {
            key: row[key]/result['exact'][s][key] - 1
            for key in ('F/U', 'omega/U')
        }
        rows[name, s] = row
        print(
            f'{name:16s} l = {s:5s}: F/U {row["F/U"]:.8f} ({row["relative_error"]["F/U"]:+.1e}), '
            f'omega/U {row["omega/U"]:.9f} '
            f'({row["relative_error"]["omega/U"]:+.1e})  [{row["seconds"]:.1f} s]', flush=True)
        result['models'] = {
            name: {s: rows[name, s]
                   for s in separations if (name, s) in rows}
            for name in models
        }
        result['provenance'] = provenance(args)
        save(args.output, 'sedimenting_spheres.json', result)

    campaign.run(ladder, todo, [f'sedimenting {name} {s.replace("/", "over")}' for name, s in todo],
                 args, title='sedimenting', finished=finish)
    draw(result, args.output/'sedimenting_spheres.png')


if __name__ == '__main__':
    main()
