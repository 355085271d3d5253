#!/usr/bin/env python3
"""Effective viscosity by analysis.viscosity, beside values that are known.

Dilute: one body is in a periodic box, on a crest of the shear and at its zero. The mean ratio of
viscosities is 1 + 5/2 phi_S + .... Here phi_S is the volume fraction of spheres of the body's
stresslet radius a_S. This radius is defined by the stresslet S = (20/3) pi eta a_S^3 E of the body
in the strain E of an unbounded fluid. It comes from dense algebra written here. Lattices: simple
cubic arrays in longer and longer waves, extrapolated, have the viscosity of the array in uniform
shear.

Brownian stress: rods of three blobs are in weak flow. Half of what they add to the viscosity comes
from their rotational diffusion.

    python3 run.py --output results                     # ten seconds
    python3 run.py --output results --brownian --jobs 2 # some minutes
"""
import argparse
import sys
from pathlib import Path

import numpy as np
import openmm
from openmm import unit
from scipy.special import erf

from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce, analysis, app
from openmmrigidhi._quaternions import rotate

sys.path.insert(0, str(Path(__file__).resolve().parents[2]/'common'))
import campaign  # noqa: E402
import recording  # noqa: E402

ETA = 1.5
BOXES = (20.0, 30.0, 40.0, 60.0)  # edges over radius
SHELLS = (12, 42, 162)
MODELS = ('RotnePragerYamakawa', 'ForceCoupling')
WAVES = (4, 8, 16, 32)  # numbers of spheres of an array along the wave
#: Simple cubic arrays: volume fraction; viscosity for a shear along the edges over the fluid's
#: viscosity, exact; the same by force, torque and stresslet of each sphere.
LATTICES = ((0.001, 1.002498, 1.002498), (0.027, 1.066333, 1.066332), (0.064, 1.155148, 1.155111),
            (0.125, 1.302305, 1.301682), (0.216, 1.542367, 1.535882), (0.343, 1.997443, 1.941957),
            (0.45, 2.739045, 2.437858))


class Scene:
    """Bodies without forces on them in a periodic box, with a wave of force density.

    The force density is along x, the wave is along y.

    Parameters
    ----------
    model : str
        name of the model
    bodies : list of (sites, radii)
        sites of shape (m, 3), nm; radii: one of each, or one of all, nm
    box : sequence of float
        three edges, nm
    setUp : callable, optional
        called with the MobilityForce
    temperature, step, seed
        K; ps; of the random numbers
    """
    def __init__(self, model, bodies, box, setUp=lambda fluid: None, temperature=0, step=0.1,
                 seed=1):
        self.system, self.fluid, self.bodies, self.box = openmm.System(), MobilityForce(
        ), bodies, box
        self.integrator = CustomRigidHIIntegrator(temperature, step)
        self.integrator.setScheme(CustomRigidHIIntegrator.DriftCorrectorFD)
        self.integrator.setRandomNumberSeed(seed)
        for sites, radii in bodies:
            app.addRigidMultiblob(self.system, self.integrator, self.fluid, sites, radii)
        self.fluid.setViscosity(ETA)
        self.fluid.setModel(getattr(MobilityForce, model))
        self.fluid.setBoundary(MobilityForce.Periodic)
        self.fluid.setSolver(MobilityForce.Dense)
        self.fluid.setSinusoidalForceDensity(0.7, 0, 1, 1)
        setUp(self.fluid)
        self.system.addForce(self.fluid)
        self.system.setDefaultPeriodicBoxVectors(*np.diag(np.asarray(box, float)).tolist())
        app.bindBodies(self.system, self.integrator)
        self.context = openmm.Context(self.system, self.integrator,
                                      openmm.Platform.getPlatformByName('CPU'), {'Threads': '1'})

    def place(self, R, q=None):
        """Bodies at R (n, 3), turned by q."""
        q = np.tile((1.0, 0, 0, 0), (len(self.bodies), 1)) if q is None else q
        self.context.setPositions(
            np.concatenate([
                place + rotate(turn, np.asarray(sites))
                for (sites, _), place, turn in zip(self.bodies, R, q)
            ]))
        self.integrator.setBodyPositions(R)
        self.integrator.setBodyOrientations(q)

    def viscosity(self, R, q=None):
        """The EffectiveViscosity with the bodies at R (n, 3), turned by q."""
        self.place(R, q)
        return analysis.viscosity(self.context)


def shell(n):
    """Centres and radius of the blobs of a shell of hydrodynamic radius 1."""
    sites, radius = app.multiblobSphere(n, 1.0)
    return sites.value_in_unit(unit.nanometer), radius.value_in_unit(unit.nanometer)


def blobMobility(sites, radius, model):
    """Mobility (3n, 3n) of blobs in an unbounded fluid, times eta.

    The blobs are those of Rotne-Prager-Yamakawa, or Gaussians of width radius/sqrt(pi).
    """
    d = sites[:, None] - sites
    r = np.linalg.norm(d, axis=-1)
    alone = np.eye(len(sites), dtype=bool)
    r = np.where(alone, 1, r)
    if model == 'RotnePragerYamakawa':
        x = r/radius
        far = x > 2
        along, radial = (np.where(far, a, b)/(6*np.pi*radius)
                         for a, b in ((3/(4*x) + 1/(2*x**3), 1 - 9*x/32), (3/(4*x) - 3/(2*x**3),
                                                                           3*x/32)))
    else:
        # Two Gaussians of width sigma interact as a point with a Gaussian of width sqrt(2) sigma.
        s = np.sqrt(2/np.pi)*radius
        bell, hill = np.sqrt(2/np.pi)*s/r*np.exp(-r**2/(2*s**2)), erf(r/(np.sqrt(2)*s))
        along = ((1 + (s/r)**2)*hill - bell)/(8*np.pi*r)
        radial = ((1 - 3*(s/r)**2)*hill + 3*bell)/(8*np.pi*r)
    along, radial = np.where(alone, 1/(6*np.pi*radius), along), np.where(alone, 0, radial)
    n = d/r[..., None]
    return (along[..., None, None]*np.eye(3) +
            radial[..., None, None]*n[..., :, None]*n[..., None, :]).transpose(0, 2, 1, 3).reshape(
                3*len(sites), -1)


def stressletRadius(sites, radius, model):
    """Stresslet radius a_S of a body without preferred directions, centred at 0.

    It comes from the forces that keep the blobs at rest in a strain, M F = E x.
    """
    strain = np.zeros((3, 3))
    strain[0, 1] = strain[1, 0] = 0.5
    F = np.linalg.solve(blobMobility(sites, radius, model),
                        (sites @ strain).reshape(-1)).reshape(-1, 3)
    stresslet = 0.5*(F[:, 0] @ sites[:, 1] + F[:, 1] @ sites[:, 0])
    return (stresslet/(20/3*np.pi*0.5))**(1/3)


def dilute(model, body, edge):
    """Ratio of viscosities of one body in a cubic box, averaged over its place.

    Flows are linear in sin^2 and cos^2 of the phase, so the average is taken over flows.
    """
    scene = Scene(model, [body], (edge,)*3)
    return 2/sum(1/scene.viscosity(np.array([(0, y, 0)])).ratio for y in (0, edge/4))


def lattice(fraction, count, model='StokesianDynamics', lubrication=True):
    """Ratio of viscosities of a simple cubic array of spheres, with `count` spheres to a wave."""
    spacing = (4*np.pi/3/fraction)**(1/3)
    scene = Scene(model, [(np.zeros((1, 3)), 1.0)]*count, (spacing, count*spacing, spacing),
                  lambda fluid: fluid.setLubrication('Auto' if lubrication else 'Off'))
    return scene.viscosity(
        spacing*np.stack([np.zeros(count), np.arange(count) + 0.5,
                          np.zeros(count)], axis=1)).ratio


def row(argument, job):
    """One row of the JSON: a shell or a sphere in boxes, or a lattice in waves."""
    kind, *which = argument
    if kind == 'lattices':
        fraction, exact, stresslets = which
        ratios = [lattice(fraction, count) for count in WAVES]
        return {
            'fraction': fraction,
            'exact': exact,
            'stresslets': stresslets,
            'spheres_to_a_wave': WAVES,
            'ratios': ratios,
            'extrapolated': ratios[-1] + (ratios[-1] - ratios[-2])/((WAVES[-1]/WAVES[-2])**2 - 1),
            'force_coupling': lattice(fraction, WAVES[0], 'ForceCoupling', False)
        }
    model, n = which
    sites, radius = shell(n) if n else (np.zeros((1, 3)), 1.0)
    slopes = [(dilute(model, (sites, radius), edge) - 1)*edge**3/(4/3*np.pi) for edge in BOXES]
    if not n:
        return {'model': model, 'edges': BOXES, 'slopes': slopes}
    own = stressletRadius(sites, radius, model)
    return {
        'model': model,
        'blobs': n,
        'stresslet_radius': own,
        'edges': BOXES,
        'slopes': slopes,
        'slopes_over_their_due': [slope/(2.5*own**3) for slope in slopes]
    }


def measure(arguments):
    """All that the JSON contains."""
    todo = ([('shells', model, n) for model in MODELS for n in SHELLS] +
            [('spheres', model, 0)
             for model in ('StokesianDynamics',) + MODELS] + [('lattices', *row)
                                                              for row in LATTICES])
    rows = campaign.run(row, todo, ['viscosity ' + ' '.join(map(str, each)) for each in todo],
                        arguments, unit='row')
    return {
        kind: [found for each, found in zip(todo, rows) if each[0] == kind]
        for kind in ('shells', 'spheres', 'lattices')
    }


def rodInWeakFlow(sites, radius, model):
    """What a rod of blobs along z adds to the viscosity in weak flow, and its rotational friction.

    The viscosity is over the fluid's, times the volume of fluid. It has two parts: resistance to
    strain, averaged over all directions of the rod, and rotational diffusion. The friction is over
    the fluid's viscosity.

    In a strain E the rod turns by B n x E n, with B = 1 for blobs on a line. Its directions n then
    have the density 1 + E:nn B/(2 D), D = kT/zeta. The stress of the Brownian torque dissipates kT
    B^2 |n x E n|^2/D, on average kT B^2 E:E/(5 D). This is a viscosity of zeta B^2/10.
    """
    inverse = np.linalg.inv(blobMobility(sites, radius, model))
    rigid = np.concatenate(
        [np.concatenate([np.eye(3), np.cross(np.eye(3), x).T], axis=1) for x in sites])
    friction = rigid.T @ inverse @ rigid
    mobility = np.linalg.pinv(friction, rcond=1e-10, hermitian=True)

    def response(strain):
        """The twist of the rod when free of forces, and the power that it takes."""
        u = (sites @ strain).reshape(-1)
        twist = mobility @ rigid.T @ inverse @ u
        return twist, u @ inverse @ (u - rigid @ twist)

    # An orthonormal basis of strains: the mean over the basis is that over all directions.
    strains = [np.diag((1, -1, 0))/2**0.5, np.diag((-1, -1, 2))/6**0.5]
    for i, j in ((0, 1), (0, 2), (1, 2)):
        strains.append(np.zeros((3, 3)))
        strains[-1][i, j] = strains[-1][j, i] = 0.5**0.5
    resists = np.mean([response(strain)[1] for strain in strains])/2
    turning = abs(response(strains[3])[0][4])/0.5**0.5
    return resists, friction[3, 3]*turning**2/10, friction[3, 3]


def readAmplitudes(scene, rows, steps, note):
    """Read the amplitudes that analysis.sampleFlowAmplitudes reads, and add them to rows.

    Reading ends when there are `steps` rows. Schemes that analysis.sampleFlowAmplitudes refuses are
    read, too, to show why it refuses them.
    """
    while len(rows) < steps:
        scene.integrator.step(1)
        rows.append(
            np.concatenate([
                read(scene.context, 0, 1, 1)._value
                for read in (scene.fluid.getFlowModeInContext,
                             scene.fluid.getRandomFlowModeInContext)
            ]))
        note(rows)


#: Samples of the flow between two checks of the clock.
SAMPLES_TOGETHER = 50


def brownian(steps, scheme, job=None, rods=27, edge=24.0, blobs=3, peclet=1.0, resolution=0.02,
             seed=7):
    """Rods without forces between them in weak flow, on a grid.

    Parameters
    ----------
    scheme : str
    peclet : float
        largest shear rate of the fluid alone over the rotational diffusion coefficient D
    resolution : float
        step times D
    """
    sites = np.stack(
        [np.zeros(blobs), np.zeros(blobs), 2*(np.arange(blobs) - (blobs - 1)/2)], axis=1)
    resists, diffuses, friction = rodInWeakFlow(sites, 1.0, 'ForceCoupling')
    D = 300*unit.MOLAR_GAS_CONSTANT_R.value_in_unit(
        unit.kilojoule_per_mole/unit.kelvin)/(friction*ETA)

    def setUp(fluid):
        fluid.setSolver(fluid.MatrixFree)
        fluid.setSolverTolerance(1e-2)
        fluid.setSinusoidalForceDensity(peclet*D*2*np.pi/edge*ETA, 0, 1, 1)

    scene = Scene('ForceCoupling', [(sites, 1.0)]*rods, (edge,)*3, setUp, 300, resolution/D, seed)
    scene.integrator.setScheme(getattr(CustomRigidHIIntegrator, scheme))
    scene.context.reinitialize()
    random = np.random.default_rng(seed)
    q = random.standard_normal((rods, 4))
    scene.place(edge*random.random((rods, 3)), q/np.linalg.norm(q, axis=1)[:, None])
    state = campaign.State(job, (scheme, rods, edge, blobs, peclet, resolution, seed))
    kept = state.load()
    rows = list(kept.get('rows', ()))
    if kept:
        scene.context.loadCheckpoint(kept['checkpoint'].tobytes())
    else:
        # Directions are random at the start; they take 1/(6 D) to align.
        scene.integrator.step(round(1/resolution))

    def note(rows):
        if job is not None:
            job.report(len(rows))
        if state.isDue() or len(rows) == steps:
            state.save(rows=rows, checkpoint=campaign.checkpoint(scene.context))

    if scheme == 'EulerMaruyama':
        readAmplitudes(scene, rows, steps, note)
    while len(rows) < steps:
        rows += list(
            analysis.sampleFlowAmplitudes(scene.context, min(SAMPLES_TOGETHER, steps - len(rows)),
                                          progress=False)._value)
        note(rows)
    amplitudes = np.array(rows)*(unit.nanometer/unit.picosecond)
    found = analysis.viscosityFromAmplitudes(scene.context, amplitudes)
    plain = analysis.viscosityFromAmplitudes(scene.context, amplitudes._value*(1, 1, 0, 0))
    return {
        'scheme': scheme,
        'blobs': blobs,
        'rods': rods,
        'edge': edge,
        'volume_fraction': rods*blobs*4/3*np.pi/edge**3,
        'steps': steps,
        'peclet': peclet,
        'step_times_D': resolution,
        'seed': seed,
        'ratio_less_1': [found.ratio - 1, found.ratioError],
        'with_the_fields_own_noise': [plain.ratio - 1, plain.ratioError],
        'tau_samples': found.tau,
        'due': rods*(resists + diffuses)/edge**3,
        'due_by_resisting': rods*resists/edge**3,
        'due_by_diffusion': rods*diffuses/edge**3
    }


def brownianRow(argument, job):
    return brownian(*argument, job)


def tables(data):
    """Lines of tables in Markdown."""
    yield '| model | blobs | a_S/a | ' + ' | '.join(f'L = {edge:g} a'
                                                    for edge in data['shells'][0]['edges']) + ' |'
    yield '|---'*(3 + len(data['shells'][0]['edges'])) + '|'
    for row in data['shells']:
        yield f'| {row["model"]} | {row["blobs"]} | {row["stresslet_radius"]:.5f} | ' + ' | '.join(
            f'{value:.5f}' for value in row['slopes_over_their_due']) + ' |'
    yield ''
    yield '| spheres | ' + ' | '.join(f'L = {edge:g} a'
                                      for edge in data['spheres'][0]['edges']) + ' |'
    yield '|---'*(1 + len(data['spheres'][0]['edges'])) + '|'
    for row in data['spheres']:
        yield f'| {row["model"]} | ' + ' | '.join(f'{value:.5f}' for value in row['slopes']) + ' |'
    yield ''
    counts = data['lattices'][0]['spheres_to_a_wave']
    yield '| volume fraction | ' + ' | '.join(
        f'{count} to a wave'
        for count in counts) + ' | extrapolated | stresslets, uniform shear | exact |'
    yield '|---'*(4 + len(counts)) + '|'
    for row in data['lattices']:
        yield (f'| {row["fraction"]:g} | ' + ' | '.join(f'{value:.5f}' for value in row['ratios']) +
               f' | {row["extrapolated"]:.5f} | {row["stresslets"]:.5f} | {row["exact"]:.5f} |')


def picture(data, path):
    plt = recording.pyplot()
    figure, (left, right) = plt.subplots(1, 2, figsize=(10.5, 4), layout='constrained')
    for row in data['shells']:
        left.plot(1/np.array(row['edges']), 100*(np.array(row['slopes_over_their_due']) - 1),
                  'os'[row['model'] == 'ForceCoupling'] + '-', ms=4, lw=0.8,
                  label=f'{row["blobs"]} blobs, {row["model"]}')
    row = data['spheres'][0]
    left.plot(1/np.array(row['edges']), 100*(np.array(row['slopes'])/2.5 - 1), 'k^-', ms=4, lw=0.8,
              label='sphere, StokesianDynamics')
    left.set(xlabel='a/L', ylabel='slope over 2.5 (a_S/a)³, less 1, %', xlim=(0, None),
             title='one body in a box')
    left.axhline(0, color='0.8', lw=0.7)
    left.legend(fontsize=7)
    rows = data['lattices']
    x = [row['fraction'] for row in rows]
    right.plot(x, [row['exact'] for row in rows], 'k-', lw=1, label='exact, uniform shear')
    right.plot(x, [row['stresslets'] for row in rows], '-', color='tab:blue', lw=1,
               label='stresslets, uniform shear')
    right.plot(x, [row['extrapolated'] for row in rows], 'o', color='tab:blue', ms=5,
               label='StokesianDynamics, long waves')
    right.plot(x, [row['ratios'][0] for row in rows], 'x', color='tab:orange', ms=5,
               label=f'{rows[0]["spheres_to_a_wave"][0]} spheres to a wave')
    right.plot(x, [row['force_coupling'] for row in rows], 'd', color='tab:green', ms=4,
               label='force-coupling spheres')
    right.set(xlabel='volume fraction', ylabel='η_eff/η', title='simple cubic arrays')
    right.legend(fontsize=8)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--output', type=Path, default=Path('results'),
                        help='folder of the JSON (results)')
    parser.add_argument('--brownian', action='store_true',
                        help='measure the Brownian stress of rods, instead of what has no noise')
    parser.add_argument('--steps', type=int, default=6000, help='steps of --brownian (%(default)s)')
    parser.add_argument('--schemes', nargs='+', default=['TractionEulerMaruyama', 'EulerMaruyama'],
                        help='schemes of --brownian (%(default)s); EulerMaruyama lacks the drift')
    campaign.addOptions(parser)
    arguments = campaign.settle(parser.parse_args())
    if arguments.brownian:
        rows = campaign.run(brownianRow, [(arguments.steps, scheme)
                                          for scheme in arguments.schemes],
                            [f'brownian {scheme}' for scheme in arguments.schemes], arguments,
                            [arguments.steps]*len(arguments.schemes), 'sample', 'rods')
        recording.save(arguments.output, 'brownian.json', {
            'rows': rows,
            'run': recording.provenance(arguments)
        })
        for row in rows:
            print({
                key: value
                for key, value in row.items() if key.startswith(('scheme', 'ratio', 'with', 'due'))
            })
        return
    data = measure(arguments)
    recording.save(arguments.output, 'viscosity.json', {
        **data, 'run': recording.provenance(arguments)
    })
    picture(data, arguments.output/'viscosity.png')
    print('\n'.join(tables(data)))


if __name__ == '__main__':
    main()
