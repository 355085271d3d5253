#!/usr/bin/env python3
"""Energy conservation of rigid water without friction: drift, and error against the time step.

The scene is 216 TIP4P-Ew waters, every molecule one rigid body. The reaction field has a force that
vanishes at the cut-off, and the Lennard-Jones potential is switched off smoothly. (A truncated
potential has a jump in its energy, which no integrator conserves.) With gamma = Gamma = 0 the
schemes become the symplectic splitting of Miller et al. (2002). No random number is drawn, and the
energy should be constant. Two questions:

1. Over --steps steps of 1 fs: the slope of the energy, in kT per molecule per ps (promised: below
   1e-4).
2. From one start, over --scan-time ps at steps of 0.5, 1, 2, 4 fs: the fluctuation of the energy,
   which should grow as h^2.

    python3 run.py --output results          # 100 ps: a few minutes
"""
import argparse
import sys
import time
from pathlib import Path

import numpy as np
import openmm
from openmm import app, unit

import openmmrigidhi

sys.path.append(str(Path(__file__).resolve().parents[2]/'common'))
import campaign  # noqa: E402
from recording import provenance, pyplot, save  # noqa: E402

KT = unit.MOLAR_GAS_CONSTANT_R.value_in_unit(unit.kilojoule_per_mole/unit.kelvin)*300


def build(waters):
    """Topology, System and positions of a small box of TIP4P-Ew water."""
    forceField = app.ForceField('tip4pew.xml')
    modeller = app.Modeller(app.Topology(), [])
    modeller.addSolvent(forceField, model='tip4pew', numAdded=waters)
    system = forceField.createSystem(modeller.topology, nonbondedMethod=app.CutoffPeriodic,
                                     nonbondedCutoff=0.85*unit.nanometer, removeCMMotion=False)
    for force in system.getForces():
        if isinstance(force, openmm.NonbondedForce):
            force.setReactionFieldDielectric(1e9)
            force.setUseSwitchingFunction(True)
            force.setSwitchingDistance(0.7*unit.nanometer)
            force.setUseDispersionCorrection(False)
    return modeller.topology, system, modeller.positions


def context(topology, system, platformName, threads, friction, step):
    """A Context whose waters are rigid bodies."""
    integrator = openmmrigidhi.CustomRigidHIIntegrator(300, step)
    integrator.setFriction(friction)
    integrator.setRotationalFriction(2*friction)
    integrator.setRandomNumberSeed(1)
    openmmrigidhi.app.addRigidWater(integrator, topology)
    properties = {'Threads': str(threads)} if platformName == 'CPU' else {}
    return integrator, openmm.Context(system, integrator,
                                      openmm.Platform.getPlatformByName(platformName), properties)


def energies(ctx, integrator, steps, every, job, settings):
    """Total energy in kT per molecule, every `every` steps."""
    keeper = campaign.State(job, settings)
    kept = keeper.load()
    values = list(kept.get('values', ()))
    if kept:
        ctx.loadCheckpoint(kept['checkpoint'].tobytes())
    while len(values) < steps // every:
        if keeper.isDue():
            keeper.save(values=values, checkpoint=campaign.checkpoint(ctx))
        integrator.step(every)
        job.report(len(values))
        state = ctx.getState(getEnergy=True)
        values.append((state.getPotentialEnergy() + state.getKineticEnergy()).value_in_unit(
            unit.kilojoule_per_mole))
    return np.array(values)/KT/integrator.getNumRigidBodies()


def slopeWithError(t, e, blocks=10):
    """Slope of a line, and its standard error.

    The error comes from the residuals about the line, averaged over blocks.
    """
    n = len(t) // blocks*blocks
    tb, eb = t[:n].reshape(blocks, -1).mean(1), e[:n].reshape(blocks, -1).mean(1)
    (slope, offset) = np.polyfit(tb, eb, 1)
    residual = eb - slope*tb - offset
    return slope, np.sqrt(np.sum(residual**2)/(blocks - 2)/np.sum((tb - tb.mean())**2))


def equilibrate(argument, job):
    """The start of all runs, in the directory of this run: after some time under Langevin C."""
    waters, duration, platformName, threads = argument
    topology, system, positions = build(waters)
    integrator, ctx = context(topology, system, platformName, threads, 5.0, 0.002)
    ctx.setPositions(positions)
    openmmrigidhi.app.minimize(ctx, maxIterations=100)
    ctx.setVelocitiesToTemperature(300, 1)
    for k in range(20):
        integrator.step(int(duration/0.002/20))
        job.report(k + 1)
    state = ctx.getState(getPositions=True, getVelocities=True, getIntegratorParameters=True)
    return {'state': openmm.XmlSerializer.serialize(state)}


def conserve(argument, job, start):
    """A run without friction: energies of `steps` steps, kT per molecule.

    What the integrator counted is returned, too.
    """
    waters, step, steps, every, platformName, threads = argument
    topology, system, _ = build(waters)
    integrator, ctx = context(topology, system, platformName, threads, 0.0, step)
    ctx.setState(openmm.XmlSerializer.deserialize(start))
    began = time.time()
    values = energies(ctx, integrator, steps, every, job,
                      (waters, step, every, platformName, threads))
    return {
        'energies': values,
        'seconds': time.time() - began,
        'random_numbers': int(integrator.getStepStatistics()['randomNumbers'])
    }


SCAN = (0.0005, 0.001, 0.002, 0.004)


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--waters', type=int, default=216)
    parser.add_argument('--steps', type=int, default=100000, help='steps of 1 fs for the drift')
    parser.add_argument('--equilibrate', type=float, default=20.0, help='ps under Langevin C first')
    parser.add_argument('--scan-time', type=float, default=2.0,
                        help='run time for each step size, ps')
    parser.add_argument('--platform', default='CPU')
    parser.add_argument('--threads', type=int, default=2)
    parser.add_argument('--output', type=Path, default=Path('energy_conservation_output'))
    campaign.addOptions(parser)
    args = campaign.settle(parser.parse_args())

    how = (args.platform, args.threads)
    start = campaign.run(equilibrate, [(args.waters, args.equilibrate, *how)],
                         ['energy equilibrate'], args, [20], 'part', 'equilibrate')[0]['state']
    todo = [(args.waters, 0.001, args.steps, 100, *how)
            ] + [(args.waters, h, int(args.scan_time/h), max(1, int(0.01/h)), *how) for h in SCAN]
    names = ['energy drift'] + [f'energy {1000*h:g} fs' for h in SCAN]
    drift, *runs = campaign.run(conserve, todo, names, args,
                                [steps // every for _, _, steps, every, *_ in todo], 'sample',
                                'energies', given=start)

    scan = []
    for h, run in zip(SCAN, runs):
        e = np.array(run['energies'])
        e = e - np.polyval(np.polyfit(np.arange(len(e)), e, 1), np.arange(len(e)))
        scan.append({'step_fs': h*1000, 'rms_energy_error_kT_per_molecule': float(e.std())})
    order = np.polyfit(np.log([s['step_fs'] for s in scan[1:]]),
                       np.log([s['rms_energy_error_kT_per_molecule'] for s in scan[1:]]), 1)[0]

    e = np.array(drift['energies'])
    t = 0.1*(1 + np.arange(len(e)))
    slope, error = slopeWithError(t, e)
    result = {
        'waters': args.waters,
        'steps_of_1_fs': args.steps,
        'seconds': drift['seconds'],
        'slope_kT_per_molecule_per_ps': slope,
        'slope_error': error,
        'promised_below': 1e-4,
        'rms_fluctuation_kT_per_molecule': float((e - np.polyval(np.polyfit(t, e, 1), t)).std()),
        'random_numbers_drawn': drift['random_numbers'],
        'error_against_step': scan,
        'fitted_order_1_to_4_fs': order,
        'platform': args.platform,
        'threads': args.threads,
        'seed': 1,
        'provenance': provenance(args),
    }
    save(args.output, 'energy_conservation.json', result)
    print(result)

    plt = pyplot()
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4), constrained_layout=True)
    left.plot(t, (e - e[0])*1e3, lw=0.8)
    left.plot(t, (slope*(t - t.mean()) + e.mean() - e[0])*1e3, 'k--', lw=1,
              label=f'slope {slope:.1e} ± {error:.0e} kT/molecule/ps')
    left.set(xlabel='time (ps)', ylabel='energy − start (10$^{-3}$ kT per molecule)',
             title=f'{args.waters} rigid waters, 1 fs')
    left.legend()
    h = np.array([s['step_fs'] for s in scan])
    rms = np.array([s['rms_energy_error_kT_per_molecule'] for s in scan])
    right.loglog(h, rms, 'o', label='measured')
    right.loglog(h, rms[2]*(h/h[2])**2, 'k:', label='$h^2$')
    right.set(xlabel='step (fs)', ylabel='rms energy error (kT per molecule)',
              title=f'order {order:.2f} from 1 to 4 fs')
    right.legend()
    figure.savefig(args.output/'energy_conservation.png', dpi=110)


if __name__ == '__main__':
    main()
