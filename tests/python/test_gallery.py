"""Examples of the gallery run, shortened, and the physics in them is right."""
import importlib.util
import os
import pathlib
import subprocess
import sys

import numpy as np
import pytest

EXAMPLES = pathlib.Path(__file__).resolve().parents[2]/'examples'
SHORT = {
    'bodies_above_a_wall': ['--steps', '3'],
    'driven_dipoles': ['--duration', '4'],
    'ions_in_water': ['--edge', '1.9', '--samples', '1'],
    'own_tensors': [],
    'sedimenting_cluster': ['--steps', '1'],
    'two_colloids': ['--steps', '40'],
}


def script(name):
    """The script of an example as a module."""
    spec = importlib.util.spec_from_file_location(name, EXAMPLES/name/'run.py')
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize('name', SHORT)
def test_script_runs_and_draws(name, tmp_path):
    command = [
        sys.executable,
        str(EXAMPLES/name/'run.py'), *SHORT[name], '--picture', 'picture.png'
    ]
    finished = subprocess.run(command, cwd=tmp_path, env=dict(os.environ, MPLBACKEND='Agg'),
                              capture_output=True, text=True, timeout=300)
    assert finished.returncode == 0, finished.stderr
    assert finished.stdout and (tmp_path/'picture.png').stat().st_size > 1000


def test_bodies_above_a_wall_stay_there():
    module = script('bodies_above_a_wall')
    integrator, context = module.scene(seed=4)
    integrator.step(50)
    heights = context.getState(getPositions=True).getPositions(asNumpy=True)._value[:, 2]
    radii = np.concatenate([[radius]*len(sites) for sites, radius, _ in module.SHAPES])
    assert (heights > radii).all()


def test_two_colloids_touch_only_without_lubrication():
    module = script('two_colloids')
    gaps = {name: module.approach(*kind)[1] for name, kind in module.MODELS.items()}
    times = module.approach(*module.MODELS['free draining'])[0]
    # Alone each moves with its Stokes drag: the gap closes by 2 radii in a unit of time.
    np.testing.assert_allclose(gaps['free draining'], 1 - 2*times, atol=1e-9)
    assert gaps['Rotne-Prager-Yamakawa'][-1] < 0 < gaps['Stokesian dynamics'].min()
    # Near contact two spheres that approach at V resist by 6 pi eta a (V/2) (1/(2 gap) + ...),
    # where the terms left out grow as the logarithm and slow them further: the gap decays at a
    # little less than 4 per unit of time.
    closing = -np.diff(np.log(gaps['Stokesian dynamics'][-2:]))*1000
    assert 3.3 < closing < 4


def test_a_cluster_falls_as_a_ball_of_point_forces_does():
    module = script('sedimenting_cluster')
    falls = []
    for seed in range(1, 6):
        positions = module.cluster(seed)
        integrator, context = module.scene(positions, step=1e-3)
        integrator.step(1)
        falls.append((positions - integrator.getBodyPositions()._value)[:, 2].mean()/1e-3)
    # Point forces spread over a ball of radius R: 1 + (N - 1) times the mean of 1/r, which is
    # 6/(5R) but for pairs nearer than d = 2, of which there are none.
    R, d = module.CLUSTER, 2
    inverse = (6/(5*R) - 1.5*d**2/R**3)/(1 - (d/R)**3)
    # Each start differs by how its centres happen to lie.
    error = np.std(falls, ddof=1)/np.sqrt(len(falls))
    assert error < 0.3 and abs(np.mean(falls) - 1 -
                               (module.NUMBER - 1)*inverse) < 4*error, (falls, inverse)


def test_dipoles_follow_and_slip_as_theory_says():
    module = script('driven_dipoles')
    frequencies = [0.3, 0.8, 1.5, 3.0]
    measured = module.rates(frequencies, duration=200)
    # An unfinished turn counts by 2 pi over half the duration at most.
    np.testing.assert_allclose(measured[:2], frequencies[:2], atol=1e-3)
    np.testing.assert_allclose(measured[2:], module.theory(frequencies[2:]), atol=2*np.pi/100)


def test_tilted_rods_glide_as_their_tensors_say():
    module = script('own_tensors')
    tilts = np.radians([0, 30, 45, 90])
    path = module.fall(tilts, duration=2.0)
    np.testing.assert_allclose((path[-1] - path[0])/2, module.theory(tilts), atol=1e-12)
    assert path[
        -1, 1,
        0] < -0.1  # the rod's upper end points to +x, and it glides to -x, downwards along its axis


def test_ions_are_free_particles_and_see_oxygens_where_they_should():
    module = script('ions_in_water')
    topology, integrator, context = module.scene(1.9, seed=1)
    integrator.step(500)
    sodium, ions, oxygens = module.separations(topology, context, 'Na')
    chloride, _, _ = module.separations(topology, context, 'Cl')
    assert integrator.getNumRigidBodies() == oxygens and ions > 0 and len(sodium) == ions*oxygens
    assert 0.2 < sodium.min() < 0.26 < 0.27 < chloride.min() < 0.34
