"""validation/westwood2022/hedgehogs.py: the potentials and the shape are those of the paper. Four
hedgehogs have the same twists and viscosity with dense matrices and on a grid. The shortened script
runs."""
import json
import pathlib
import subprocess
import sys

import numpy as np
import openmm
import pytest
from openmmrigidhi import MobilityForce, analysis
from openmmrigidhi._quaternions import rotate

VALIDATION = pathlib.Path(__file__).resolve().parents[2]/'validation'


@pytest.fixture(scope='module')
def hedgehogs():
    """The module of validation/westwood2022."""
    sys.path[:0] = [str(VALIDATION/'westwood2022'), str(VALIDATION/'common')]
    try:
        import hedgehogmodel
        yield hedgehogmodel
    finally:
        del sys.path[:2]


def test_the_hedgehog(hedgehogs):
    """The body has 19 beads, and neighbours on an axis touch. The paper's numbers give a volume
    fraction of a fifth."""
    distances = np.linalg.norm(hedgehogs.SITES[:, None] - hedgehogs.SITES,
                               axis=-1)[np.triu_indices(19, 1)]
    assert len(
        hedgehogs.SITES) == 19 and distances.min() == 2 and np.count_nonzero(distances == 2) == 18
    assert hedgehogs.FRACTION == pytest.approx(0.2, rel=1e-3)
    assert hedgehogs.side(64)**3/64 == pytest.approx(77.65**3/1177, rel=1e-12)


@pytest.mark.parametrize('potential, least, barrier', [('repel-attract', -2.60, 0.27),
                                                       ('repel-attract-repel', -0.49, 4.43)])
def test_pair_potentials(hedgehogs, potential, least, barrier):
    """Energies are those of eqs. 60 to 63, written once more. Below contact the energy goes on with
    a constant force. The Context has the same energies and forces."""
    r = np.linspace(1.0, 6.5, 111)
    U = 20*np.exp((2 - r)/0.5) - 5*np.exp(-((r - 3)/0.5)**2) + (5*np.exp(-(
        (r - 3.5)/0.5)**2) if potential == 'repel-attract-repel' else 0)
    energies = hedgehogs.pairEnergy(r, potential)
    last = 20*np.exp(-8)
    outside = (r >= 2) & (r < 6)
    assert np.allclose(energies[outside],
                       (U - last)[outside], rtol=0, atol=1e-9) and not energies[r >= 6].any()
    assert np.allclose(np.diff(energies[r < 2], 2), 0, atol=1e-10)
    h = 1e-5
    below, above = ((hedgehogs.pairEnergy(2 + s*h, potential) - hedgehogs.pairEnergy(2, potential))/
                    (s*h) for s in (-1, 1))
    assert below == pytest.approx(above, rel=2e-4) and below < -39
    fine = hedgehogs.pairEnergy(np.linspace(2, 5.9, 4000), potential)
    assert fine.min() == pytest.approx(
        least, abs=0.005) and fine[fine.argmin():].max() == pytest.approx(barrier, abs=0.005)
    system = openmm.System()
    force = hedgehogs.pairForce(potential)
    for _ in range(2):
        system.addParticle(1)
        force.addParticle([])
    system.addForce(force)
    system.setDefaultPeriodicBoxVectors((20, 0, 0), (0, 20, 0), (0, 0, 20))
    context = openmm.Context(system, openmm.VerletIntegrator(0.001),
                             openmm.Platform.getPlatformByName('Reference'))
    for distance, energy in zip(r, energies):
        context.setPositions([(0, 0, 0), (0, distance, 0)])
        state = context.getState(getEnergy=True, getForces=True)
        assert state.getPotentialEnergy()._value == pytest.approx(energy, abs=1e-9)
        if abs(distance - 6) > 2*h:
            slope = (hedgehogs.pairEnergy(distance + h, potential) -
                     hedgehogs.pairEnergy(distance - h, potential))/(2*h)
            assert state.getForces()[1][1]._value == pytest.approx(-slope, rel=1e-4, abs=1e-4)


@pytest.mark.parametrize('tolerance', [1e-3, 1e-6])
def test_four_hedgehogs_dense_and_on_a_grid(hedgehogs, tolerance):
    """Four hedgehogs push each other in a driven fluid without noise. Twists agree to five times
    the tolerance in the norm of the friction, and the viscosity to the same. Bodies move by their
    twists."""
    R = np.array([(3.0, 3, 3), (9.5, 4, 3.5), (4, 9.5, 4), (8.0, 9.0, 9.5)])
    q = np.random.default_rng(4).standard_normal((4, 4))
    q /= np.linalg.norm(q, axis=1)[:, None]
    found = {}
    for name, solver, accuracy in (('dense', MobilityForce.Dense, 1e-6),
                                   ('grid', MobilityForce.MatrixFree, tolerance)):
        some = hedgehogs.Hedgehogs(4, 'repel-attract', 20.0, accuracy, temperature=0, solver=solver,
                                   step=1e-7, edge=15.0)
        some.place(R, q)
        ratio = analysis.viscosity(some.context).ratio
        N = some.fluid.getMobilityInContext(some.context) if name == 'dense' else None
        assert abs(some.context.getState(getEnergy=True).getPotentialEnergy()._value) > 0.1
        some.integrator.step(1)
        R1, q1 = some.poses()
        turned = np.array([2*(rotateBack(a, b)) for a, b in zip(q1, q)])
        found[name] = ratio, np.concatenate([(R1 - R)/1e-7, turned/1e-7], axis=1).reshape(-1), N
    dense, grid = found['dense'], found['grid']
    error = grid[1] - dense[1]
    friction = np.linalg.inv(dense[2])
    assert np.sqrt(error @ friction @ error) < 5*tolerance*np.sqrt(dense[1] @ friction @ dense[1])
    assert grid[0] == pytest.approx(dense[0], rel=5*tolerance) and dense[0] > 2


def rotateBack(after, before):
    """Half the rotation vector, in the lab frame, of the small turn from one quaternion to the
    other."""
    w, v = before[0], before[1:]
    turn = -after[0]*v + w*after[1:] - np.cross(after[1:], v)
    assert np.allclose(rotate(after, np.array((1.0, 0, 0))), rotate(before, np.array((1.0, 0, 0))),
                       atol=1e-3)
    return turn*np.sign(after @ before)


def run(folder, *arguments, name='hedgehogs.json'):
    finished = subprocess.run([
        sys.executable,
        str(VALIDATION/'westwood2022'/'hedgehogs.py'), '--silent', '--output',
        str(folder), *arguments
    ], capture_output=True, text=True, timeout=600)
    assert finished.returncode == 0, finished.stdout + finished.stderr
    data = json.loads((folder/name).read_text())
    assert {'processor', 'openmm', 'commit', 'plugin_sha256', 'arguments'} <= set(
        data['provenance'])
    return data, finished.stdout


@pytest.mark.scripts
def test_the_script(hedgehogs, tmp_path):
    """The shortened script runs. A second call, with two runs at a time, continues the kept runs,
    whose earlier samples stay. g(r) counts every pair within half the box."""
    first, text = run(tmp_path, '--quick')
    assert 'repel-attract-repel' in text
    assert [path.name for path in tmp_path.glob('*.png')] == ['hedgehogs.png']
    assert (tmp_path/'hedgehogs.png').stat().st_size > 5000
    kept = {
        path.parent.name: dict(np.load(path))
        for path in (tmp_path/'work').glob('hedgehogs_27*/state.npz')
    }
    assert len(first['runs']) == len(kept) == 2 and all(row['steps'] == 120 and row['bodies'] == 27
                                                        for row in first['runs'])
    second, _ = run(tmp_path, '--quick', '--long', '1.5', '--jobs', '2', '--cluster', 'processes')
    for row in second['runs']:
        assert row['steps'] == 180 and row['ratio'][0] > 3 and row['shear_rate'][
            0] == pytest.approx(300/row['ratio'][0], rel=1e-9)
        now = np.load(tmp_path/'work'/f'hedgehogs_27_{row["potential"]}_300'/'state.npz')
        before = kept[f'hedgehogs_27_{row["potential"]}_300']
        assert np.array_equal(now['amplitudes'][:60], before['amplitudes']) and np.array_equal(
            now['counts'][:2], before['counts'])
        # Every frame is counted once. It has at most all pairs, and about half of them within a
        # ball of half the box.
        inside = now['counts'].sum(axis=1)/(60/30*27*26/2)
        assert np.all(inside < 1) and np.all(inside > 0.3)
        volume = 4/3*np.pi*(np.array(row['r']) + 0.5)[-1]**3/row['side']**3
        shells = 4/3*np.pi*np.diff(np.arange(len(row['r']) + 1)**3)
        assert np.sum(np.array(row['g'])*shells)/row['side']**3 == pytest.approx(volume, rel=0.35)
