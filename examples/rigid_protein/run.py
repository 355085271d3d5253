#!/usr/bin/env python3
"""The diffusion tensor of a rigid protein, measured in equilibrium, is kT times its mobility.

Hen egg-white lysozyme from its PDB entry is one rigid body: every C-alpha has a blob of radius 0.61
nm and the mass of its residue. One MobilityForce (Rotne-Prager-Yamakawa) makes the fluid,
LangevinHI the dynamics, with inertia, at 298.15 K in water. Several copies run in one Context. Each
copy is in a hydrodynamic group of its own, so that the copies do not interact.

What is measured: the twist u = (V, W) of a protein in its own frame, as displacements x_k and turns
over intervals of --sample ps. By the Green-Kubo relation the running sum

    D(t) = 1/(2 delta) sum over |n| delta <= t of <x_k x_(k+n)^T>

rises over the ballistic time (the slowest relaxation, m D/kT = 0.7 ps) to the 6 x 6 diffusion
tensor about the centre of mass.

    python3 run.py --output results      # 4 minutes on one core
    python3 run.py --mobility            # matrices only: two proteins at several distances;
                                         # blobs that carry torques too
"""
import argparse
import json
import pathlib
import sys
import time

import numpy as np
import openmm
from openmm import unit
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from tqdm import tqdm

from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce

HERE = pathlib.Path(__file__).resolve().parent
sys.path.append(str(HERE.parents[1]/'validation'/'common'))
from recording import provenance, pyplot  # noqa: E402

STRUCTURE = HERE/'1aki_ca.pdb'
BLOB_RADIUS = 0.61  # nm, one bead a residue: Ortega et al., Biophys. J. 101, 892 (2011)
TEMPERATURE = 298.15  # K
VISCOSITY = 0.890  # mPa s, water at 298.15 K
GAS_CONSTANT = unit.MOLAR_GAS_CONSTANT_R.value_in_unit(unit.kilojoule_per_mole/unit.kelvin)
# Average masses of amino acids in a chain, dalton, from the standard atomic weights. A whole chain
# has a water more.
RESIDUE_MASS = {
    'GLY': 57.05,
    'ALA': 71.08,
    'SER': 87.08,
    'PRO': 97.12,
    'VAL': 99.13,
    'THR': 101.10,
    'CYS': 103.14,
    'LEU': 113.16,
    'ILE': 113.16,
    'ASN': 114.10,
    'ASP': 115.09,
    'GLN': 128.13,
    'LYS': 128.17,
    'GLU': 129.12,
    'MET': 131.19,
    'HIS': 137.14,
    'PHE': 147.18,
    'ARG': 156.19,
    'TYR': 163.18,
    'TRP': 186.21
}
# Measured at 20 C, in water: Dubin, Clark and Benedek, J. Chem. Phys. 54, 5158 (1971). Each has its
# value and its error, in cm^2/s and 1/s.
MEASURED_D_T, MEASURED_D_R = (10.6e-7, 0.1e-7), (16.7e6, 0.8e6)
MEASURED_TEMPERATURE, MEASURED_VISCOSITY = 293.15, 1.002
CM2_PER_S, PER_S = 1e-2, 1e12  # 1 nm^2/ps in cm^2/s, and 1/ps in 1/s


# ---- The scene -----------------------------------------------------------------------------------
def readProtein(path=STRUCTURE):
    """C-alpha positions, nm, shape (residues, 3), and masses of the residues."""
    atoms = [
        line for line in path.read_text().splitlines()
        if line.startswith('ATOM') and line[12:16].strip() == 'CA'
    ]
    positions = np.array([[float(line[k:k + 8]) for k in (30, 38, 46)] for line in atoms])/10
    masses = np.array([RESIDUE_MASS[line[17:20]] for line in atoms])
    masses[0] += 1.01  # H of the N terminus
    masses[-1] += 17.01  # OH of the C terminus
    return positions, masses


def makeContext(places, step, groups=None, temperature=TEMPERATURE, viscosity=VISCOSITY,
                radius=BLOB_RADIUS, platformName='CPU', seed=1):
    """A Context with a protein's centre of mass at each of `places`; all have one orientation."""
    positions, masses = readProtein()
    positions = positions - masses @ positions/masses.sum()
    system = openmm.System()
    fluid = MobilityForce()
    fluid.setViscosity(viscosity*1e-3*unit.pascal*unit.second)
    integrator = CustomRigidHIIntegrator(temperature, step)
    integrator.setScheme(CustomRigidHIIntegrator.LangevinHI)
    integrator.setRandomNumberSeed(seed)
    for _ in places:
        first = system.getNumParticles()
        for mass in masses:
            system.addParticle(mass)
            fluid.addParticle(radius)
        integrator.addRigidBody(range(
            first,
            system.getNumParticles()))  # mass, inertia and shape from the System and positions
    fluid.setGroups(groups if groups is not None else [])
    system.addForce(fluid)
    properties = {'Threads': '1'} if platformName == 'CPU' else {}
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName(platformName),
                             properties)
    context.setPositions(np.concatenate([positions + place for place in places]))
    return context, integrator, fluid


# ---- What theory says ----------------------------------------------------------------------------
def twoRotations(integrator, body=0):
    """diag(A, A), where A turns the body frame into the lab frame."""
    w, x, y, z = integrator.getBodyOrientations()[body]
    return np.kron(np.eye(2), Rotation.from_quat([x, y, z, w]).as_matrix())


def bodyMobility(context, integrator, fluid):
    """Mobility of body 0 alone, (6, 6), in its frame about its centre of mass."""
    turn = twoRotations(integrator)
    return turn.T @ fluid.getMobilityInContext(context)[:6, :6] @ turn


def relaxation(mobility, inertia):
    """Relaxation times of the twist, ps, and their modes.

    A mode v and its time solve mobility v = time inverse(inertia) v.
    """
    return eigh(mobility, np.diag(1/inertia))


def diffusionAtStep(mobility, inertia, kT, h):
    """The diffusion tensor of the scheme at the time step h.

    The part of each mode is larger than kT times mobility by the factor (h/2 tau) coth(h/2 tau).
    """
    times, modes = relaxation(mobility, inertia)
    x = h/2/times
    left = np.linalg.inv(modes)
    return kT*left.T @ np.diag(times*x/np.tanh(x)) @ left


def centreOfDiffusion(D):
    """The point where the translational tensor has its smallest trace, and the tensor about it.

    D is the tensor about the origin; the point is given relative to the origin.
    """
    rotation, coupling = D[3:, 3:], D[3:, :3]  # rows W, columns F
    skew = coupling - coupling.T
    # Moving by r makes the coupling C + D_r [r x], whose antisymmetric part is to vanish (Brenner
    # 1967).
    r = -np.linalg.solve(
        np.trace(rotation)*np.eye(3) - rotation, np.array([skew[2, 1], skew[0, 2], skew[1, 0]]))
    return r, moved(D, r)[:3, :3]


def moved(D, r):
    """The tensor about the point r of the body: V_r = V + W x r."""
    cross = np.array([[0, -r[2], r[1]], [r[2], 0, -r[0]], [-r[1], r[0], 0]])
    shift = np.eye(6)
    shift[:3, 3:] = -cross
    return shift @ D @ shift.T


# ---- Measurement ---------------------------------------------------------------------------------
def increments(start, end):
    """Displacements and turns of bodies from start to end, (n, 6), in the frame half-way.

    start and end are each (positions, quaternions).
    """
    before, after = (Rotation.from_quat(q[:, [1, 2, 3, 0]]) for _, q in (start, end))
    turns = (before.inv()*after).as_rotvec()
    midway = before*Rotation.from_rotvec(turns/2)
    return np.concatenate([midway.inv().apply(end[0] - start[0]), turns], axis=1)


def runningSums(x, lags, delta):
    """D(t) at t = 0, delta, ..., lags delta, shape (lags + 1, 6, 6).

    x are the increments, of shape (samples, bodies, 6).
    """
    samples, bodies, _ = x.shape
    terms = []
    for n in range(lags + 1):
        C = np.tensordot(x[:samples - n], x[n:], axes=((0, 1), (0, 1)))/((samples - n)*bodies)
        terms.append(C if n == 0 else C + C.T)
    return np.cumsum(terms, axis=0)/(2*delta)


def measure(context, integrator, blocks, samplesPerBlock, stepsPerSample, lags, quiet=False):
    """Running sums of each block of time, (blocks, lags + 1, 6, 6)."""
    delta = stepsPerSample*integrator.getStepSize().value_in_unit(unit.picosecond)

    def pose():
        return integrator.getBodyPositions()/unit.nanometer, integrator.getBodyOrientations()

    last, results = pose(), []
    for _ in tqdm(range(blocks), desc='blocks', disable=quiet):
        x = np.empty((samplesPerBlock, integrator.getNumRigidBodies(), 6))
        for k in range(samplesPerBlock):
            integrator.step(stepsPerSample)
            now = pose()
            x[k], last = increments(last, now), now
        results.append(runningSums(x, lags, delta))
    return np.array(results)


def compare(D, expected):
    """Blocks of measured tensors (blocks, 6, 6) against the expected tensor.

    Both are scaled to expected^(-1/2) . expected^(-1/2), so that the expected tensor becomes the
    identity. The result has the mean and the standard error of the 21 entries, and chi^2. Theory
    gives the ratio of their errors: squared, they are 2 times one variance for entries on the
    diagonal, and 1 times it for entries off the diagonal. This variance comes from the scatter of
    all entries over the blocks.
    """
    values, vectors = np.linalg.eigh(expected)
    scale = vectors @ np.diag(values**-0.5) @ vectors.T
    rows, columns = np.triu_indices(6)
    entries = (scale @ D @ scale)[:, rows, columns]
    mean = entries.mean(0)
    ideal = (rows == columns).astype(float)
    variance = np.mean(entries.var(0, ddof=1)/(1 + ideal))/len(D)
    errors = np.sqrt(variance*(1 + ideal))
    z = (mean - ideal)/errors
    return {
        'rows': rows.tolist(),
        'columns': columns.tolist(),
        'deviation': (mean - ideal).tolist(),
        'error': errors.tolist(),
        'largest_z': float(np.abs(z).max()),
        'chi2': float(np.sum(z**2)),
        'chi2_probability': float(chi2.sf(np.sum(z**2), len(z)))
    }


def diffusion(copies=64, step=0.01, sample=0.1, window=5.0, blockTime=200.0, total=1e6,
              platformName='CPU', seed=1, quiet=False):
    """Measure and compare: a dict of results, and the running sums of all blocks.

    `total` is in ps, summed over copies.
    """
    stepsPerSample = round(sample/step)
    lags, samplesPerBlock = round(window/sample), round(blockTime/sample)
    blocks = max(8, round(total/copies/blockTime))
    places = 10.0*np.arange(copies)[:, None]*np.array([1.0, 0, 0])
    context, integrator, fluid = makeContext(places, step, range(copies), platformName=platformName,
                                             seed=seed)
    context.setVelocitiesToTemperature(TEMPERATURE, seed)
    kT = GAS_CONSTANT*TEMPERATURE
    _, mass, moments, _ = integrator.getRigidBodyParameters(0)
    mass, moments = mass/unit.dalton, moments/(unit.dalton*unit.nanometer**2)
    inertia = np.concatenate([np.full(3, mass), moments])
    mobility = bodyMobility(context, integrator, fluid)
    times, _ = relaxation(mobility, inertia)
    began = time.time()
    running = measure(context, integrator, blocks, samplesPerBlock, stepsPerSample, lags, quiet)
    seconds = time.time() - began
    D, expected = running[:, -1], kT*mobility
    mean, error = D.mean(0), D.std(0, ddof=1)/np.sqrt(blocks)
    _, central = centreOfDiffusion(mean)
    _, centralExpected = centreOfDiffusion(expected)
    # Averages over the axes, with errors from the scatter of the blocks.
    averages = {}
    for name, part, factor in (('translational', slice(0, 3), CM2_PER_S), ('rotational', slice(
            3, 6), PER_S)):
        values = np.trace(D[:, part, part], axis1=1, axis2=2)/3*factor
        averages[name] = {
            'measured': float(values.mean()),
            'error': float(values.std(ddof=1)/np.sqrt(blocks)),
            'kT_mobility': float(np.trace(expected[part, part])/3*factor)
        }
    averages['translational']['about_centre_of_diffusion'] = float(np.trace(central)/3*CM2_PER_S)
    averages['translational']['kT_mobility_about_centre_of_diffusion'] = float(
        np.trace(centralExpected)/3*CM2_PER_S)
    toHere = TEMPERATURE/MEASURED_TEMPERATURE*MEASURED_VISCOSITY/VISCOSITY
    averages['translational']['literature_at_this_temperature'] = [v*toHere for v in MEASURED_D_T]
    averages['rotational']['literature_at_this_temperature'] = [v*toHere for v in MEASURED_D_R]
    result = {
        'copies': copies,
        'step_ps': step,
        'sample_ps': sample,
        'window_ps': window,
        'blocks': blocks,
        'block_ps': blockTime,
        'total_ps': copies*blocks*blockTime,
        'seed': seed,
        'platform': platformName,
        'seconds': seconds,
        'temperature_K': TEMPERATURE,
        'viscosity_mPa_s': VISCOSITY,
        'blob_radius_nm': BLOB_RADIUS,
        'mass_dalton': mass,
        'principal_moments_amu_nm2': moments.tolist(),
        'relaxation_times_ps': times.tolist(),
        'window_bias': float(np.exp(-window/times.max())),
        'diffusion_tensor': mean.tolist(),
        'error': error.tolist(),
        'kT_mobility': expected.tolist(),
        'kT_mobility_at_this_step': diffusionAtStep(mobility, inertia, kT, step).tolist(),
        'averages_cm2_per_s_and_per_s': averages,
        'against_kT_mobility': compare(D, expected),
        'against_kT_mobility_at_this_step': compare(D, diffusionAtStep(mobility, inertia, kT,
                                                                       step)),
        'effects': {k: str(v)
                    for k, v in integrator.getEffects().items()},
    }
    return result, running


def pair(distances=(3.5, 4.0, 5.0, 7.0, 10.0, 20.0)):
    """Two proteins in one orientation: how one moves when the other is pulled or turned.

    Their centres are on the x axis, at these distances in nm.
    """
    rows = []
    for distance in distances:
        context, integrator, fluid = makeContext([(0, 0, 0), (distance, 0, 0)], 0.01,
                                                 platformName='Reference')
        N = fluid.getMobilityInContext(context)
        alone = makeContext([(0, 0, 0)], 0.01, platformName='Reference')
        A = alone[2].getMobilityInContext(alone[0])
        eta = fluid.getViscosity()/(unit.dalton/unit.nanometer/unit.picosecond)
        relative = N[0, 0] + N[6, 6] - N[0, 6] - N[6, 0]
        rows.append({
            'distance_nm': distance,
            'pull_along': N[6, 0]/A[0, 0],
            'pull_along_oseen': 1/(4*np.pi*eta*distance)/A[0, 0],
            'pull_across': N[7, 1]/A[1, 1],
            'turn_by_pull': N[11, 1]*distance**2*8*np.pi*eta,
            'relative_mobility': relative/(2*A[0, 0]),
            'own_mobility': N[0, 0]/A[0, 0]
        })
    return rows


def torqueCarryingBlobs():
    """D_t in cm^2/s and D_r in 1/s, means of axes, if every blob carried a torque too.

    Every blob is then a sphere with torque that turns with the protein.
    """
    positions, masses = readProtein()
    positions = positions - masses @ positions/masses.sum()
    system = openmm.System()
    fluid = MobilityForce()
    fluid.setViscosity(VISCOSITY*1e-3*unit.pascal*unit.second)
    integrator = CustomRigidHIIntegrator(TEMPERATURE, 0.01)
    integrator.setScheme(CustomRigidHIIntegrator.LangevinHI)
    motion = []  # of every sphere, from the motion of the protein
    for k, (x, y, z) in enumerate(positions):
        system.addParticle(1)
        fluid.addParticle(BLOB_RADIUS)
        integrator.addRigidBody([k], 1, (1, 1, 1), [(0, 0, 0)])
        rows = np.eye(6)
        rows[:3, 3:] = -np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        motion.append(rows)
    system.addForce(fluid)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setPositions(positions)
    K = np.concatenate(motion)
    D = GAS_CONSTANT*TEMPERATURE*np.linalg.inv(K.T @ fluid.getFrictionInContext(context) @ K)
    return float(np.trace(D[:3, :3])/3*CM2_PER_S), float(np.trace(D[3:, 3:])/3*PER_S)


# ---- Results -------------------------------------------------------------------------------------
def draw(result, running, path):
    """Running sums per axis against kT times mobility, and all 21 entries."""
    plt = pyplot()
    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(13, 4), constrained_layout=True)
    t = result['sample_ps']*np.arange(running.shape[1])
    mean, error = running.mean(0), running.std(0, ddof=1)/np.sqrt(len(running))
    expected = np.array(result['kT_mobility'])
    averages = result['averages_cm2_per_s_and_per_s']
    for axes, first, factor, name, label in ((left, 0, CM2_PER_S*1e6, 'translational',
                                              '$D_t$ (10$^{-6}$ cm$^2$/s)'),
                                             (middle, 3, PER_S/1e6, 'rotational',
                                              '$D_r$ (10$^6$ s$^{-1}$)')):
        for k in range(3):
            i = first + k
            axes.fill_between(t,
                              factor*(mean - error)[:, i, i],
                              factor*(mean + error)[:, i, i], color=f'C{k}', alpha=0.3, lw=0)
            axes.plot(t, factor*mean[:, i, i], f'C{k}', label=f'axis {k + 1}')
            axes.axhline(factor*expected[i, i], color=f'C{k}', ls='--', lw=1)
        value, spread = np.array(
            averages[name]['literature_at_this_temperature'])*(1e6 if first == 0 else 1e-6)
        axes.axhspan(value - spread, value + spread, color='0.8', zorder=0,
                     label='experiment, mean of axes')
        axes.plot([], [], 'k--', lw=1, label='$kT$ × mobility')
        axes.set(xlabel='time $t$ (ps)', ylabel=label,
                 title=f'{name.capitalize()} diffusion, running sum', ylim=(0, None))
        axes.legend(fontsize=8, loc='lower right')
    entries = result['against_kT_mobility']
    right.errorbar(np.arange(21), 100*np.array(entries['deviation']),
                   100*np.array(entries['error']), fmt='o', ms=3)
    right.axhline(0, color='k', lw=0.8)
    letters = ['$x$', '$y$', '$z$', '$\\varphi_x$', '$\\varphi_y$', '$\\varphi_z$']
    right.set_xticks(np.arange(21),
                     [letters[i] + letters[j] for i, j in zip(entries['rows'], entries['columns'])],
                     rotation=90, fontsize=8)
    right.set(ylabel='deviation from $kT$ × mobility (%)',
              title=f'All entries, scaled: $\\chi^2$ = {entries["chi2"]:.0f} of 21')
    figure.savefig(path, dpi=110)


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--copies', type=int, default=64)
    parser.add_argument('--step', type=float, default=0.01, help='time step, ps')
    parser.add_argument('--sample', type=float, default=0.1, help='interval of a sample, ps')
    parser.add_argument('--window', type=float, default=5.0,
                        help='time over which the running sum goes, ps')
    parser.add_argument('--total', type=float, default=1e6, help='run time, ps, summed over copies')
    parser.add_argument('--platform', default='CPU')
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--mobility', action='store_true',
                        help='compute only matrices: two proteins, blobs with torques')
    parser.add_argument('--output', type=pathlib.Path, default=pathlib.Path('rigid_protein_output'))
    args = parser.parse_args()
    args.output.mkdir(parents=True, exist_ok=True)
    if args.mobility:
        result = {
            'pairs': pair(),
            'torque_carrying_blobs_cm2_per_s_and_per_s': torqueCarryingBlobs(),
            'provenance': provenance(args)
        }
        (args.output/'mobility.json').write_text(json.dumps(result, indent=1) + '\n')
        print(json.dumps(result, indent=1))
        return
    result, running = diffusion(args.copies, args.step, args.sample, args.window, total=args.total,
                                platformName=args.platform, seed=args.seed)
    result['provenance'] = provenance(args)
    (args.output/'rigid_protein.json').write_text(json.dumps(result, indent=1) + '\n')
    draw(result, running, args.output/'rigid_protein.png')
    print(
        json.dumps(
            {
                key: result[key]
                for key in ('averages_cm2_per_s_and_per_s', 'relaxation_times_ps',
                            'against_kT_mobility', 'seconds')
            }, indent=1))


if __name__ == '__main__':
    main()
