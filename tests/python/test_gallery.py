"""Shortened examples of the gallery run, and the physics in their results is right."""
import importlib.util
import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile

import numpy as np
import openmm
import pytest

from openmmrigidhi import MobilityForce

EXAMPLES = pathlib.Path(__file__).resolve().parents[2]/'examples'
SHORT = {
    'accuracy_of_your_own_scene': ['--length', '6'],
    'bodies_above_a_wall': ['--steps', '3'],
    'boomerang_at_a_wall': ['--replicas', '2', '--steps', '20', '--walkers', '20'],
    'driven_dipoles': ['--duration', '4'],
    'hinged_swimmer': [
        '--strokes', '1', '--swimmers', '2', '--steps', '8', '--animation', '--frames', '3'
    ],
    'ions_in_water': ['--edge', '1.9', '--samples', '1'],
    'own_tensors': [],
    'pillars': ['--replicas', '2', '--steps', '100', '--walkers', '20'],
    'replicas': ['--replicas', '2', '--length', '10'],
    'ring_of_driven_spheres': ['--duration', '10'],
    'roller': ['--rollers', '4', '--duration', '10'],
    'saving_and_resuming': ['--steps', '40'],
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
    # Without interactions each sphere moves with its Stokes drag. So the gap closes by 2 radii in a
    # unit of time.
    np.testing.assert_allclose(gaps['free draining'], 1 - 2*times, atol=1e-9)
    assert gaps['Rotne-Prager-Yamakawa'][-1] < 0 < gaps['Stokesian dynamics'].min()
    # Near contact the resistance of two spheres that approach at V is 6 pi eta a (V/2) (1/(2 gap) +
    # ...). The further terms grow as the logarithm and slow the spheres further. So the gap decays
    # at a little less than 4 per unit of time.
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
    # In theory point forces are spread over a ball of radius R, which falls at 1 + (N - 1) times
    # the mean of 1/r. This mean is 6/(5R), corrected for pairs nearer than d = 2, which do not
    # exist.
    R, d = module.CLUSTER, 2
    inverse = (6/(5*R) - 1.5*d**2/R**3)/(1 - (d/R)**3)
    # Starts differ by the random places of the centres, which gives the error.
    error = np.std(falls, ddof=1)/np.sqrt(len(falls))
    assert error < 0.3 and abs(np.mean(falls) - 1 -
                               (module.NUMBER - 1)*inverse) < 4*error, (falls, inverse)


def test_dipoles_follow_and_slip_as_theory_says():
    module = script('driven_dipoles')
    frequencies = [0.3, 0.8, 1.5, 3.0]
    measured = module.rates(frequencies, duration=200)
    # An unfinished turn makes an error of at most 2 pi over half the duration.
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


def test_ions_and_peptide_are_free_particles_and_see_oxygens_where_they_should():
    module = script('ions_in_water')
    topology, integrator, context = module.scene(1.9, seed=1)
    integrator.step(500)
    atoms = module.kinds(topology)
    water = atoms.pop('water O')
    ions = len(atoms['Na'] + atoms['Cl'])
    # Of the 22 atoms of the peptide, 12 are hydrogens, whose bonds are constrained.
    assert integrator.getNumRigidBodies() == len(water) and len(atoms['Na']) == len(
        atoms['Cl']) > 0 and len(atoms['peptide O']) == 2
    assert integrator.getDegreesOfFreedom()['free'] == 3*(ions + 22) - 12
    sodium, chloride, peptide = (module.separations(context, atoms[name], water).min()
                                 for name in ('Na', 'Cl', 'peptide O'))
    assert 0.2 < sodium < 0.26 and 0.24 < peptide < 0.3 and 0.27 < chloride < 0.34


def test_boomerangs_at_a_wall_have_the_energy_that_is_sampled():
    """For poses of the dynamics the sampler's function and OpenMM give the same energy."""
    module = script('boomerang_at_a_wall')
    integrator, context = module.scene(replicas=16)
    integrator.step(30)
    written = module.energies(integrator.getBodyPositions()._value,
                              integrator.getBodyOrientations()).sum()
    computed = context.getState(getEnergy=True).getPotentialEnergy()._value
    assert abs(written - computed) < 1e-9*abs(computed)


def test_boomerangs_at_a_wall_do_not_feel_each_other():
    module = script('boomerang_at_a_wall')
    mobilities = []
    for replicas in (1, 3):
        _, context = module.scene(replicas)
        fluid = MobilityForce.cast(context.getSystem().getForce(1))
        mobilities.append(np.asarray(fluid.getMobilityInContext(context)))
    np.testing.assert_allclose(mobilities[1], np.kron(np.eye(3), mobilities[0]),
                               atol=1e-10*np.abs(mobilities[0]).max())


def test_boomerangs_among_pillars_have_the_energy_that_is_sampled():
    module = script('pillars')
    integrator, context = module.scene('FreeDraining', replicas=4)
    integrator.step(200)
    boomerangs = slice(module.BODIES - 1, None, module.BODIES)
    written = module.energies(integrator.getBodyPositions()._value[boomerangs],
                              integrator.getBodyOrientations()[boomerangs]).sum()
    computed = context.getState(getEnergy=True).getPotentialEnergy()._value
    assert abs(written - computed) < 1e-4*abs(computed)  # OpenMM's CPU forces: single precision


def test_pillars_stay_and_slow_the_boomerang():
    module = script('pillars')
    mobilities = []
    for model in ('RotnePragerYamakawa', 'FreeDraining'):
        integrator, context = module.scene(model, replicas=2)
        boomerangs = np.arange(2*module.BODIES) % module.BODIES == module.BODIES - 1
        before = integrator.getBodyPositions()._value
        fluid = MobilityForce.cast(context.getSystem().getForce(1))
        mobility = np.asarray(fluid.getMobilityInContext(context))
        integrator.step(20)
        moved = (integrator.getBodyPositions()._value != before).any(axis=1)
        np.testing.assert_array_equal(moved, boomerangs)
        assert not mobility[~np.repeat(boomerangs, 6)].any()
        mobilities.append(np.trace(mobility[-6:-3, -6:-3]))
    # In the middle of four pillars the fluid takes about a fifth of the mobility.
    assert 0.75 < mobilities[0]/mobilities[1] < 0.9


def test_rollers_go_as_fast_as_the_closed_form_says():
    module = script('roller')
    heights = np.array([1.05, 1.5, 3.0])
    np.testing.assert_allclose(module.speeds(heights), module.theory(heights), rtol=1e-9)
    assert abs(module.theory(1.5) - 0.027210884353741) < 1e-14
    # Lubrication slows a rigid sphere, and a shell of blobs has nearly the speed of a rigid sphere.
    exact = module.speeds(heights[1:], exact=True)
    assert (exact < 0.9*module.theory(heights[1:])).all()
    np.testing.assert_allclose(module.speeds(heights[1:], blobs=162), exact, rtol=0.05)


def test_rollers_carry_each_other_and_stay_at_their_height():
    module = script('roller')
    path = module.crowd(6, duration=20)
    speeds = (path[-1] - path[0])[:, 0]/20
    assert speeds.min() > 1.1*module.theory(1.5)


def test_the_page_of_the_swimmer_has_the_numbers_of_its_results(capsys):
    """Every number with decimals that the script reports is on its page."""
    module = script('hinged_swimmer')
    module.report(json.loads((EXAMPLES/'hinged_swimmer'/'results.json').read_text()))
    number = re.compile(r'\d+\.\d+(?:\(\d+\))?')
    said = set(number.findall(capsys.readouterr().out))
    page = (EXAMPLES/'hinged_swimmer'/'README.md').read_text(encoding='utf-8')
    assert len(said) > 8 and said <= set(number.findall(page)), said


def test_a_swimmer_goes_as_far_as_without_joints():
    module = script('hinged_swimmer')
    exact = module.stroke(module.frictionOfBlobs())
    # Resistive force theory of slender links is near, and without a difference of the frictions
    # along and across a link nothing swims.
    slender = module.stroke(module.resistiveForces(2))
    assert 0.5 < exact[0]/slender[0] < 0.8 and slender[0] < -module.LENGTH/6
    np.testing.assert_allclose(module.stroke(module.resistiveForces(1))[:2], 0, atol=1e-9)
    errors = []
    for steps in (8, 16):
        swimmer = module.Swimmers(1, 0, steps)
        path = swimmer.swim(1)[:, 0, 1]
        errors.append(np.linalg.norm((path[-1] - path[0])[:2] - exact[:2]))
        assert swimmer.work > 0
    # Without noise the scheme is of second order, so the error at half the step is a quarter.
    assert errors[0] < 5e-3 and errors[1] < 0.35*errors[0], errors
    # The scallop's stroke is the same forwards and backwards and leads back, although it has led
    # away.
    path = module.Swimmers(1, 0, 16).swim(1, module.SCALLOP)[:, 0, 1]
    assert np.abs(path[-1] - path[0]).max() < 1e-4 < 0.2 < np.abs(path[8] - path[0]).max()


def test_spheres_on_a_ring_go_as_fast_as_their_tensors_say():
    module = script('ring_of_driven_spheres')
    numbers = [1, 2, 6, 9]
    theory = [module.theory(n) for n in numbers]
    # The value for two spheres at a distance of 6 is computed by hand. Each pushes the other
    # backwards, at right angles to the line between them.
    assert abs(theory[1] - (1 - 3/(4*6) - 1/(2*6**3))) < 1e-12 and theory[3] > theory[2] > 1
    errors = [
        np.abs(module.speeds(numbers, MobilityForce.RotnePragerYamakawa, 0.4, step) - theory)
        for step in (0.04, 0.02)
    ]
    # Without noise the scheme is of second order, so the error at half the step is a quarter.
    assert (errors[1] < 2e-3).all() and (errors[1] < 0.35*errors[0]).all(), errors


def test_replicas_have_the_mean_of_theory():
    module = script('replicas')
    study = module.study(replicas=4, length=100.0, fields=[2.0])
    with tempfile.TemporaryDirectory() as directory:
        row = study.run(directory, quiet=True).rows[0]
    # With 3 degrees of freedom 5 standard errors are exceeded by chance for 1.5 % of seeds, but the
    # seed is fixed. There are 20 dipoles with a correlation time below 1 ps, and cosines with a
    # standard deviation of 0.4. So the error of 100 ps is about 0.4/sqrt(20*100/2).
    assert row['replicas'] == 4 and 0.002 < row['standard_error'] < 0.05, row
    assert abs(row['mean'] - module.theory(2.0)) < 5*row['standard_error'], row


def test_a_resumed_run_is_the_run_that_was_not_stopped(tmp_path):
    module = script('saving_and_resuming')
    whole = module.follow(module.begin(), 30)
    context = module.begin()
    module.follow(context, 13)
    module.save(context, tmp_path)
    assert (module.follow(module.resume(tmp_path), 17) == whole[13:]).all()
    # With other random numbers the run differs.
    assert np.abs(module.follow(module.begin(seed=2), 30) - whole).max() > 1e-3


def test_the_droplet_is_of_rigid_water_and_stays_together():
    module = script('accuracy_of_your_own_scene')
    made = module.scene()
    context = made.makeContext(made.makeIntegrator(),
                               openmm.Platform.getPlatformByName('Reference'), {}, seed=1)
    context.getIntegrator().step(500)
    places = context.getState(getPositions=True).getPositions(asNumpy=True)._value
    molecules = places.reshape(-1, 3, 3)
    for k in (1, 2):
        bonds = np.linalg.norm(molecules[:, k] - molecules[:, 0], axis=1)
        np.testing.assert_allclose(bonds, np.linalg.norm(module.SHAPE[k]), atol=1e-12)
    # In vacuum a pair of TIP3P molecules binds by 27 kJ/mol. In a droplet each molecule is bound by
    # several others.
    energy = context.getState(getEnergy=True).getPotentialEnergy()._value
    assert np.abs(places).max() < 1.5 and energy/len(molecules) < -10
