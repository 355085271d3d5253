"""validation/westwood2022: the sampler has the energy of the Context, and the distribution of
quadrature and of another sampler. The shortened script runs, and continues kept runs."""
import json
import pathlib
import subprocess
import sys

import numpy as np
import pytest
from openmm import unit
from openmmrigidhi import analysis
from openmmrigidhi._quaternions import rotate
from openmmrigidhi.accuracy.statistics import quantile
from openmmrigidhi.ensemble import tasks

FOLDER = pathlib.Path(__file__).resolve().parents[2]/'validation'/'westwood2022'
FALSE_ALARMS = 7e-6  # probability for each comparison, as in test_gibbs_boltzmann.py


@pytest.fixture(scope='module')
def study():
    """The example's modules."""
    sys.path[:0] = [str(FOLDER), str(FOLDER.parent/'common')]
    try:
        import model
        import montecarlo
        import rods
        yield type('Study', (), {'model': model, 'montecarlo': montecarlo, 'rods': rods})
    finally:
        del sys.path[:2]


def begun(study, scene, count=2, sweeps=3, seed=1):
    """Systems a few sweeps after starts that overlap, which have energies of all sizes."""
    random = np.random.default_rng(seed)
    parts = [study.montecarlo.starts(scene, count, flat, random) for flat in (True, False)]
    systems = study.montecarlo.Systems(scene, *(np.concatenate(both) for both in zip(*parts)),
                                       random)
    for _ in range(sweeps):
        systems.sweep(adapt=True)
    return systems


def test_the_rod(study):
    """Beads touch: neighbours in a layer and in adjacent layers are two radii apart, and none are
    nearer. The rod is 16.142 long and 4 wide."""
    sites = study.model.SITES
    distances = np.linalg.norm(sites[:, None] - sites, axis=-1)[np.triu_indices(22, 1)]
    assert distances.min() == pytest.approx(
        2, abs=1e-12) and np.count_nonzero(distances < 2 + 1e-9) == 11 + 4*10
    assert np.ptp(sites[:, 2]) + 2 == pytest.approx(16.142, abs=1e-3)
    assert np.ptp(sites[:, 0]) + 2 == pytest.approx(4) and np.ptp(sites[:,
                                                                        1]) + 2 == pytest.approx(4)


@pytest.mark.parametrize('fraction, rods', [(8, 64), (4, 128), (2, 256)])
def test_volume_fraction(study, fraction, rods):
    """The volume fraction is that of the paper, 10 %, in the paper's box and in the reduced one."""
    for part in (1.0, 0.5):
        scene = study.model.Scene(fraction, 6.0, part)
        assert scene.rods == rods*part**2
        assert 22*4/3*np.pi*scene.rods/(scene.side**2*scene.width) == pytest.approx(0.1, rel=0.02)
    with pytest.raises(SystemExit, match='there must be a whole number of rods'):
        study.model.Scene(fraction, 6.0, 0.3)


@pytest.mark.parametrize('fraction, cutoff', [(8, 6.0), (4, 3.0), (2, 6.0)])
def test_energies(study, fraction, cutoff):
    """Energies of the fast sampler equal those summed bead by bead and those of the Context, for
    overlapping and relaxed configurations, with rods across the period."""
    scene = study.model.Scene(fraction, cutoff)
    rods = study.model.Rods(scene, platform='Reference')
    for sweeps in (0, 5):
        systems = begun(study, scene, 1, sweeps)
        plain = scene.energy(systems.R, systems.q)
        assert np.allclose(systems.energies(), plain, rtol=1e-12, atol=0) and plain.min() > 0
        for R, q, energy in zip(systems.R, systems.q, plain):
            rods.place(R, q)
            assert rods.energy() == pytest.approx(energy, rel=1e-12)


def test_two_images_of_one_rod(study):
    """Rods in a row, half a period apart, interact at both ends."""
    scene = study.model.Scene(8, 6.0)
    scene.rods = 2
    turned = np.tile((np.sqrt(0.5), 0, np.sqrt(0.5), 0), (1, 2, 1))
    R = np.array([[(0, 4, 5), (scene.side/2, 4, 5)]])
    systems = study.montecarlo.Systems(scene, R, turned, np.random.default_rng(1))
    # The layers at both ends are 5.27 apart. A shift makes the two distances unequal.
    assert systems.energies()[0] > 0
    assert systems.energies()[0] == pytest.approx(scene.energy(R, turned)[0], rel=1e-12)
    moved = R + [[(0, 0, 0), (0.3, 0.2, -0.4)]]
    assert study.montecarlo.Systems(scene, moved, turned,
                                    np.random.default_rng(1)).energies()[0] == pytest.approx(
                                        scene.energy(moved, turned)[0], rel=1e-12)


def test_forces(study):
    """The Context's forces on rods are minus the slope of the energy, for shifts and turns."""
    scene = study.model.Scene(8, 6.0)
    systems = begun(study, scene, 1, 5)
    R, q = systems.R[1], systems.q[1]
    rods = study.model.Rods(scene, platform='Reference')
    rods.place(R, q)
    forces = rods.context.getState(getForces=True).getForces(asNumpy=True)._value.reshape(
        scene.rods, 22, 3)
    arms, delta = rotate(q[:, None], study.model.SITES), 1e-5
    for rod in (0, 7):
        for axis in np.eye(3):

            def energy(shift, turn):
                R2, q2 = R.copy(), q.copy()
                R2[rod] += shift*axis
                q2[rod] = study.montecarlo.product(np.append(np.cos(turn/2),
                                                             np.sin(turn/2)*axis), q[rod])
                return scene.energy(R2, q2)

            force, torque = forces[rod].sum(0) @ axis, np.cross(arms[rod],
                                                                forces[rod]).sum(0) @ axis
            # Differences of a smooth function have errors of delta^2. The force jumps where beads
            # come into reach (by 0.01) or touch.
            assert -(energy(delta, 0) - energy(-delta, 0))/(2*delta) == pytest.approx(
                force, rel=1e-5, abs=1e-4)
            assert -(energy(0, delta) - energy(0, -delta))/(2*delta) == pytest.approx(
                torque, rel=1e-5, abs=1e-3)


def test_kept_energies_follow_moves(study):
    """After many accepted moves of all kinds the sums that the sampler keeps are still those of the
    configuration."""
    scene = study.model.Scene(8, 3.0)
    systems = begun(study, scene, 4, 30)
    assert all(systems.accepted[kind] > 0
               for kind in study.montecarlo.MOVES[:3]) and systems.tried['mirror'] > 0
    energies = systems.energies()
    systems.computeEnergies()
    assert np.allclose(systems.energies(), energies, rtol=0, atol=1e-10*energies.max())


def test_the_mirror_image_is_a_rod(study):
    scene = study.model.Scene(4, 6.0)
    systems = begun(study, scene, 2, 0)
    R, q = systems.propose('mirror', 3)
    before = systems.R[:, 3, None] + systems.arms[:, 3]
    after = R[:, None] + rotate(q[:, None], study.model.SITES)
    before[..., 1] = scene.width - before[..., 1]
    assert np.allclose(
        np.linalg.norm(before[:, :, None] - after[:, None], axis=-1).min(axis=-1), 0, atol=1e-12)


def test_chains_go_on_with_as_many_systems(study, tmp_path):
    """Chains also go on with longer runs. Chains of --quick are not taken for those of a whole run.
    """
    job = tasks.Job(0, 'mc', str(tmp_path))
    assert study.rods.monteCarlo((8, 6.0, 0.5, 2, 10, 20), job) == {'sweeps': 20}
    assert study.rods.monteCarlo((8, 6.0, 0.5, 2, 10, 30), job) == {'sweeps': 30}
    with pytest.raises(ValueError, match='it has 2 systems, where 4 are asked for'):
        study.rods.monteCarlo((8, 6.0, 0.5, 4, 10, 40), job)


def check(values, exact, error=0.0):
    """The mean of independent values is the exact one."""
    mean, own = values.mean(), values.std(ddof=1)/np.sqrt(len(values))
    z = (mean - exact)/np.hypot(own, error)
    print(f'{mean:.5f} +- {own:.5f}, expected {exact:.5f} +- {error:.5f}, z = {z:.2f}')
    assert abs(z) < quantile(1 - FALSE_ALARMS, len(values) - 1)
    return own


def test_one_rod_against_quadrature(study):
    """One rod has the law of quadrature, in y and in the direction of the wall's normal in its own
    frame. Without the energy this direction is uniform on a sphere."""
    scene = study.model.Scene(8, 6.0)
    scene.rods = 1
    random = np.random.default_rng(5)
    parts = [study.montecarlo.starts(scene, 100, flat, random) for flat in (True, False)]
    systems = study.montecarlo.Systems(scene, *(np.concatenate(both) for both in zip(*parts)),
                                       random)
    found = []
    for sweep in range(900):
        systems.sweep(adapt=sweep < 100)
        if sweep >= 200 and sweep % 3 == 0:
            found.append([
                np.abs(systems.R[:, 0, 1] - scene.width/2),
                study.model.angles(systems.q)[:, 0], systems.walls[:, 0].copy()
            ])
    off, theta, energy = np.mean(found, axis=0)

    # The quadrature has Gauss points in y and in the cosine s = sin(theta), and equal steps in the
    # angle about the rod, of which a quarter turn is enough by symmetry.
    x, weight = np.polynomial.legendre.leggauss(160)
    y, s = scene.width/4*(x + 1), (x + 1)/2  # the lower half of the channel
    psi = np.pi/2*(np.arange(16) + 0.5)/16
    normal = np.stack(
        np.broadcast_arrays(
            np.sqrt(1 - s**2)[:, None]*np.cos(psi),
            np.sqrt(1 - s**2)[:, None]*np.sin(psi), s[:, None]), -1)
    beads = y[:, None, None, None] + normal @ study.model.SITES.T
    U = study.model.wallEnergy(beads, scene.width)
    p = np.exp(-U)*weight[:, None, None]*weight[:, None]
    p /= p.sum()
    exact = [(p.sum((1, 2))*(scene.width/2 - y)).sum(), (p.sum((0, 2))*np.arcsin(s)).sum(),
             (p*np.where(p > 0, U, 0)).sum()]
    for values, mean in zip((off, theta, energy), exact):
        assert check(values, mean) < 0.02*mean


@pytest.mark.full
def test_crowded_rods_against_the_librarys_sampler(study):
    """Three rods have the averages of GibbsBoltzmannSampler under the Context's energies and
    between the channel's walls. The box is 20 x 9.7 x 20, three quarters as dense as the study's.
    """
    scene = study.model.Scene(8, 3.0)
    scene.rods, scene.side = 3, 20.0
    systems = begun(study, scene, 32, 200, 3)
    rods = study.model.Rods(scene)
    rods.place(systems.R[0], systems.q[0])
    sampler = analysis.GibbsBoltzmannSampler(rods.context, seed=2)
    assert sampler._walls[0].crossing and len(sampler._walls) == 2
    sampler.burnIn(300, progress=False)
    samples = sampler.sample(5000, 1, progress=False)
    found = []
    for sweep in range(600):
        systems.sweep()
        found.append([
            systems.energies(),
            study.model.angles(systems.q).mean(1),
            np.abs(systems.R[..., 1] - scene.width/2).mean(1)
        ])
    mine = np.mean(found, axis=0)
    other = [
        samples.energies._value,
        study.model.angles(samples.orientations).mean(1),
        np.abs(samples.positions._value[..., 1] - scene.width/2).mean(1)
    ]
    for values, series in zip(mine, other):
        average = samples.average(series*unit.dimensionless)
        check(values, average.mean, average.standardError)
        assert average.isTrusted and average.standardError < 0.06*average.mean


def run(folder, *arguments, name='rods.json'):
    finished = subprocess.run(
        [sys.executable,
         str(FOLDER/'rods.py'), '--silent', '--output',
         str(folder), *arguments], capture_output=True, text=True, timeout=600)
    assert finished.returncode == 0, finished.stdout + finished.stderr
    data = json.loads((folder/name).read_text())
    assert {'processor', 'openmm', 'commit', 'plugin_sha256', 'arguments'} <= set(
        data['provenance'])
    return data, finished.stdout


@pytest.mark.scripts
def test_the_script(study, tmp_path):
    """The shortened script runs. A second call, with two runs at a time, goes on with kept results:
    chains are longer, there are more runs, and earlier results stay."""
    first, text = run(tmp_path, '--quick')
    assert 'pair energy a rod' in text
    assert [path.name for path in tmp_path.glob('*.png')] == ['rods.png']
    assert (tmp_path/'rods.png').stat().st_size > 5000
    scene, = first['scenes']
    moving, = scene['dynamics']
    assert scene['rods'] == 16 and scene['monte_carlo']['sweeps'] == 30 and moving[
        'runs'] == 2 and moving['steps'] == [60, 60]
    for found in (scene['monte_carlo'], moving):
        assert sum(found['y']['P']) == pytest.approx(1) and sum(
            found['theta']['P']) == pytest.approx(1)
    # Ten steps of tau/600 hardly move a rod. So the runs are near their starts, but not exactly
    # there.
    assert 0 < abs(moving['changes']['off']['mean']) < 0.3
    kept = [readAll(tmp_path/'work'/f'runs_L8_cutoff6_{k}'/'state.npz') for k in (0, 1)]
    second, _ = run(tmp_path, '--quick', '--long', '2', '--jobs', '2', '--cluster', 'processes')
    scene, = second['scenes']
    assert scene['monte_carlo']['sweeps'] == 60 and scene['dynamics'][0]['runs'] == 4
    again = [readAll(tmp_path/'work'/f'runs_L8_cutoff6_{k}'/'state.npz') for k in (0, 1)]
    assert all(
        np.array_equal(old[key], new[key]) for old, new in zip(kept, again)
        for key in ('y', 'theta', 'R', 'means'))
    # A rod's mobility towards a wall falls as it comes near.
    towards = np.array(first['own_mobilities']['L/8'])[:, 2]
    assert np.all(np.diff(towards) > 0) and towards[0] < 0.7*towards[-1]
    # A run of the paper's size begins with four copies of a kept state side by side, whose means
    # are those of one copy.
    full, _ = run(tmp_path, '--full', '--widths', '8', '--steps', '2', name='rods_full.json')
    row, = full['rows']
    assert row['rods'] == 64 and row['side'] == pytest.approx(
        77.65) and 'on a grid' in row['fluid'] and row['steps'] == 2
    alone = begunAt(study, tmp_path/'work'/'mc_L8_cutoff6'/'state.npz')
    assert row['means_before_and_after']['pairs'][0] == pytest.approx(alone, rel=1e-9)


def readAll(path):
    """The arrays of a file. They are read at once, because the next run writes the file anew."""
    with np.load(path) as file:
        return dict(file)


def begunAt(study, path):
    """The pair energy for each rod of the first kept system."""
    with np.load(path) as kept:
        scene = study.model.Scene(8, 6.0)
        systems = study.montecarlo.Systems(scene, kept['R'][:1], kept['q'][:1],
                                           np.random.default_rng(1))
    return systems.pairs[0].sum()/(2*scene.rods)
