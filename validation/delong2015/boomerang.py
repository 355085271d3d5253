#!/usr/bin/env python3
"""Delong 2015, Figures 8 and 9 and Table 1: a boomerang of 15 blobs above a wall, at three weights.

Table 1 comes from averages over the Gibbs-Boltzmann distribution: chi_2D of the centre of
hydrodynamic stress, chi_theta with a cut-off (its average diverges), gravitational height of a tip.
Figures 8 and 9 come from trajectories: mean square displacements of the cross point, of a tip and
of the centre of hydrodynamic stress, and of the bisector's angle in the plane. Heights of the cross
point and tilts are compared with quadrature.

    python3 boomerang.py                          # until the errors are small, or an hour a scheme
                                                  # and weight
    python3 boomerang.py --minutes 5 --jobs 2     # up to five minutes each, two at a time; the same
                                                  # command again goes on
    python3 boomerang.py --quick                  # seconds

Units: um and s as nm and ps, kT = 1; water at 300 K: eta = 8.9e-4 Pa s, kT/eta = 4.65387 um^3/s.
"""
import pathlib
import sys

import numpy as np
from openmmrigidhi import analysis, app

HERE = pathlib.Path(__file__).resolve().parent
sys.path.append(str(HERE.parent/'common'))
import runs  # noqa: E402
import wallpictures as pictures  # noqa: E402
from equilibrium import Equilibrium, averageMobility, sphereMobilities  # noqa: E402
from recording import pyplot  # noqa: E402
from walls import Body, Replicas  # noqa: E402

RESULTS = HERE/'results'
SCHEMES = ('RandomFiniteDifference', 'FixmanMidpoint')
GRAVITIES = (1, 10, 20)
A = 0.265*1.5**0.5
KT_PER_VISCOSITY = 1.380649e-23*300/8.9e-4*1e18
#: s; the papers' diffusive time of a blob, 6 pi eta a^3/kT, is 0.1385 s.
STEP = 0.01
#: um: top of the bins of height.
TOP = {1: 12.3, 10: 4.3, 20: 2.8}
#: s: times before anything is counted. Heights relax in about 4 D/v^2 with diffusion D and
#: sedimentation v, 55 s at g = 1.
SETTLE = {1: 200, 10: 30, 20: 20}
ANGLES = np.linspace(0, np.pi, 31)
#: s: long-time slopes are taken from this time on; orientations relax in 1 to 4 s.
LATE = 5.0
BISECTOR = np.array([1.0, 1.0, 0])/2**0.5
#: Sine of the bisector's angle to the vertical below which a configuration is left out of
#: chi_theta.
CUTOFF = 0.3
#: Table 1: chi_2D (um^2/s), chi_2D/chi_3D, chi_theta (rad^2/s), h_g of a tip (um), sphere's ratio.
PAPER = {
    1: (0.226, 0.834, 1.42, 1.77, 0.837),
    10: (0.194, 0.716, 0.79, 0.605, 0.724),
    20: (0.185, 0.683, 0.22, 0.419, 0.680)
}


def body(g):
    return Body(f'boomerang g={g:g}',
                app.boomerang(0.3)._value, np.full(15, A), np.full(15, 0.18*g/15/A), np.arange(15),
                23.08, A, A/2, 1/KT_PER_VISCOSITY)


def centres():
    """Centres of hydrodynamic stress and of mobility, and chi_3D, in bulk.

    Centres are given by their distance from the cross point.
    """
    replicas = Replicas(body(1), 1, 'RandomFiniteDifference', STEP, boundary='Unbounded')
    N = replicas.mobilities()
    axes = np.array([BISECTOR, (-BISECTOR[1], BISECTOR[0], 0), (0, 0, 1)])
    CoH, CoM = analysis.planarCenterOfHydrodynamicStress(N[0])._value, analysis.centerOfMobility(
        N[0])._value
    about = analysis.mobilityAboutPoint(N[0], CoM)[:3, :3]
    return {
        'CoH': float(CoH @ BISECTOR),
        'CoM': float(CoM @ BISECTOR),
        'chi_3D': float(np.trace(about)/3),
        'D about CoM: bisector, in plane, normal': np.diag(axes @ about @ axes.T),
        'D_rot: bisector, in plane, normal': np.diag(axes @ N[0, 3:, 3:] @ axes.T)
    }


def sphereRatio(height):
    """<mu_par>/mu_0 of a sphere with the blobs' radius.

    Its gap to the wall is exponentially distributed about the mean `height`.
    """
    x, w = np.polynomial.laguerre.laggauss(60)
    return float(w @ sphereMobilities(A + x*height, A, 1/(6*np.pi*A))[:, 0, 0])


def table(equilibrium, bulk, poses, random):
    """Table 1 at one weight."""
    points = {
        'CoH': bulk['CoH']*BISECTOR,
        'CoM': bulk['CoM']*BISECTOR,
        'cross point': np.zeros(3),
        'tip': equilibrium.body.sites[0]
    }

    def isAbove(A):
        """Whether the sine of the bisector's angle to the vertical is above CUTOFF."""
        return np.hypot(*(A @ BISECTOR)[:, :2].T) > CUTOFF

    functions = {
        f'chi_2D {name}':
        (lambda N, A, h, p=p: analysis.mobilityAboutPoint(N, A @ p)[:, [0, 1], [0, 1]].mean(1))
        for name, p in points.items()
    }
    functions.update({
        'chi_theta where sine > cut-off, else 0': lambda N, A, h: isAbove(A)*analysis.
        planarAngleMobility(N, A @ BISECTOR),
        'fraction above cut-off': lambda N, A, h: isAbove(A)*1.0,
        'D_rot zz': lambda N, A, h: N[:, 5, 5]
    })
    means = averageMobility(equilibrium, functions, random, poses)
    tip = equilibrium.body.sites[0]
    z = equilibrium.average(lambda h, u: h + u @ tip)
    height = equilibrium.average(lambda h, u: (h + u @ tip - z)**2)**0.5
    return {
        'averages (mean, error)': means,
        'chi_2D/chi_3D': means['chi_2D CoH'][0]/bulk['chi_3D'],
        'h_g of a tip': height,
        'sphere at h_g': sphereRatio(height),
        'mean h/a': equilibrium.average(lambda h, u: h + 0*u[:, 2])/A,
        'cos2 theta': equilibrium.average(lambda h, u: u[:, 2]**2 + 0*h)
    }


def plans(quick, seed):
    made, equilibria, bulk = [], {}, centres()
    for g in GRAVITIES:
        b = body(g)
        equilibria[g] = e = Equilibrium(b, np.linspace(0.3, TOP[g], 61), ANGLES)
        tip = b.sites[0]
        observables = {
            'h': (lambda h, A: h, e.average(lambda h, u: h + 0*u[:, 2])),
            'tip height': (lambda h, A, p=tip: h + A[..., 2, :] @ p,
                           e.average(lambda h, u, p=tip: h + u @ p)),
            'cos²θ': (lambda h, A: A[..., 2, 2]**2, e.average(lambda h, u: u[:, 2]**2 + 0*h))
        }
        msd = {
            'parallel cross point': runs.parallel((0, 0, 0)),
            'parallel tip': runs.parallel(tip),
            'parallel CoH': runs.parallel(bulk['CoH']*BISECTOR),
            'parallel CoM': runs.parallel(bulk['CoM']*BISECTOR),
            'perpendicular tip': runs.perpendicular(tip),
            'planar angle': runs.planarAngle(BISECTOR)
        }
        frames = 40 if quick else 1200
        made += [
            runs.Plan(f'boomerang_g{g:g}_{scheme}', b, e, scheme, STEP, 5,
                      frames, 1 if quick else SETTLE[g], observables, msd,
                      np.geomspace(1, frames // 2, 24), 32 if quick else 64, 'CPU',
                      seed=seed + 7*k + 100*g, labels={'g': g}, lateFrom=LATE)
            for k, scheme in enumerate(SCHEMES)
        ]
    return equilibria, made


def draw(data, folder):
    plt = pyplot()
    gravities = sorted({r['g'] for r in data['runs']})
    figure, axes = plt.subplots(3, len(gravities), figsize=(6*len(gravities), 13),
                                constrained_layout=True, squeeze=False)
    for column, g in zip(axes.T, gravities):
        exact, entries = data['table'][g], [r for r in data['runs'] if r['g'] == g]
        names = [r['scheme'] for r in entries]
        pictures.displacements(
            column[0], entries,
            ('parallel cross point', 'parallel tip', 'parallel CoH', 'perpendicular tip'),
            ('C0', 'C1', 'C2', 'C3'))
        lag = np.array(entries[0]['msd']['parallel CoH']['lag'])
        for colour, name in (('C0', 'cross point'), ('C1', 'tip'), ('C2', 'CoH')):
            column[0].plot(lag, 4*exact['averages (mean, error)'][f'chi_2D {name}'][0]*lag, '-',
                           color=colour, lw=1, label=f'4 χ t (eq. 68), {name}')
        column[0].axhline(2*exact['h_g of a tip']**2, color='C3', ls=':', label='2 h_g², tip')
        pictures.displacements(column[1], entries, ('planar angle',))
        pictures.densities(column[2], entries, 'h', names)
        pictures.finish(column[0], f'Figure 8, g = {g:g}', 't / s', 'MSD / μm²', 'xy')
        pictures.finish(column[1], 'Figure 9: angle in the plane', 't / s', 'MSD / rad²')
        pictures.finish(column[2], 'height of the cross point', 'h / μm', 'P(h) μm')
    figure.savefig(folder/'boomerang.png', dpi=70)
    plt.close(figure)


def main():
    def add(parser):
        parser.add_argument('--gravities', nargs='+', type=int, default=GRAVITIES,
                            choices=GRAVITIES)
        parser.add_argument('--poses', type=int, default=128000,
                            help='independent poses for Table 1')

    args = runs.arguments(__doc__, RESULTS, add)
    bulk, equilibria = centres(), runs.planned(plans, args.quick, args.seed)[0]
    random = np.random.default_rng(args.seed)
    data = {
        'paper: chi_2D, chi_2D/chi_3D, chi_theta, h_g, sphere': PAPER,
        'bulk': bulk,
        'cut-off': CUTOFF,
        'table': {
            g: table(e, bulk, 2560 if args.quick else args.poses, random)
            for g, e in equilibria.items()
        }
    }
    draw(
        runs.drive(plans, data, args, 'boomerang.json',
                   lambda plan: plan.labels['g'] in args.gravities), args.output)


if __name__ == '__main__':
    main()
