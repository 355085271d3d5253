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
    'jointed_chain': ['--replicas', '2', '--steps', '100', '--animation', '--frames', '3'],
    'own_tensors': [],
    'pillars': [
        '--replicas', '2', '--steps', '100', '--walkers', '20', '--cells', '2', '--passage-steps',
        '20', '--animation', '--frames', '3'
    ],
    'replicas': ['--replicas', '2', '--length', '10'],
    'ring_of_driven_spheres': ['--duration', '10'],
    'roller': ['--rollers', '4', '--duration', '10', '--animation', '--frames', '3'],
    'saving_and_resuming': ['--steps', '40'],
    'sedimenting_cluster': ['--steps', '1'],
    'squirmers': ['--duration', '0.5', '--points', '9', '--animation', '--frames', '3'],
    'towing': ['--steps', '60', '--windows', '2', '--animation', '--frames', '3'],
    'two_colloids': ['--steps', '40'],
}


def script(name):
    """The script of an example as a module."""
    spec = importlib.util.spec_from_file_location(name, EXAMPLES/name/'run.py')
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.scripts
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
    assert ('--animation' in SHORT[name]) == (tmp_path/'animation.gif').exists()


def saved(value):
    """What a JSON has, with arrays and whole numbers as keys."""
    if isinstance(value, dict):
        return {int(k) if k.isdigit() else k: saved(v) for k, v in value.items()}
    if isinstance(value, list) and not any(isinstance(v, dict) for v in value):
        return np.array(value)
    return [saved(v) for v in value] if isinstance(value, list) else value


@pytest.mark.parametrize('name', ('jointed_chain', 'squirmers', 'towing'))
def test_pages_have_the_numbers_of_their_results(name, capsys):
    """Every number with decimals that the script reports is on its page, apart from signs."""
    script(name).report(saved(json.loads((EXAMPLES/name/'results.json').read_text())))
    number = re.compile(r'\d+\.\d+(?:\(\d+\))?')
    said = set(number.findall(capsys.readouterr().out))
    page = set(number.findall((EXAMPLES/name/'README.md').read_text(encoding='utf-8')))
    assert len(said) > 10 and said <= page, sorted(said - page)


def test_the_page_of_pillars_has_the_numbers_of_its_results():
    module = script('pillars')
    found = json.loads((EXAMPLES/'pillars'/'results.json').read_text())
    page = (EXAMPLES/'pillars'/'README.md').read_text(encoding='utf-8')
    for note in module.MODELS.values():
        rows, passages = found[note], found[note]['passages']
        brackets = module.recording.brackets
        numbers = [brackets(*each) for each in zip(rows['msd_over_4t_um2_per_s'], rows['error'])]
        assert f'| {note} | {" | ".join(numbers)} |' in page
        mean = brackets(passages['mean_s'], passages['error'])
        assert f'| {note} | {passages["number"]} | {mean} |' in page


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


def test_passages_take_as_long_as_theory_says_without_pillars():
    """Without pillars and without a fluid the mean time out of a square is a known series."""
    module = script('pillars')
    replicas = 32
    integrator, context = module.scene('FreeDraining', replicas, places=module.CELL)
    fluid = MobilityForce.cast(context.getSystem().getForce(1))
    mobility = np.asarray(fluid.getMobilityInContext(context))[-6:-3, -6:-3]
    context.setParameter('kT', 0)  # of the repulsion
    D = module.KT*np.trace(mobility)/3
    step = integrator.getStepSize()._value
    times = np.concatenate(
        module.passages(integrator, context, replicas, 3000, 0.583*np.sqrt(2*D*step), quiet=True))
    m, n = np.meshgrid(np.arange(1, 200, 2), np.arange(1, 200, 2))
    signs = (-1)**((m + n - 2) // 2)
    theory = (16*signs/(m*n*(m*m + n*n))).sum()*module.LATTICE**2/(np.pi**4*D)
    # The spread of such times is 0.77 of their mean, and 4 standard errors are allowed.
    assert len(times) > 150
    assert abs(step*times.mean()/theory - 1) < 4*0.77/np.sqrt(len(times))


def test_rollers_go_as_fast_as_the_closed_form_says():
    module = script('roller')
    heights = np.array([1.05, 1.5, 3.0])
    np.testing.assert_allclose(module.speeds(heights), module.theory(heights), rtol=1e-9)
    assert abs(module.theory(1.5) - 0.027210884353741) < 1e-14
    # Lubrication slows a rigid sphere, and a shell of blobs has nearly the speed of a rigid sphere.
    exact = module.speeds(heights[1:], exact=True)
    assert (exact < 0.9*module.theory(heights[1:])).all()
    np.testing.assert_allclose(module.speeds(heights[1:], blobs=162), exact, rtol=0.05)


def test_pairs_of_rollers_gain_what_the_far_limit_says():
    """Beside the far limit are terms of relative order (height/distance)^2."""
    module = script('roller')
    distances, alone = [100.0, 200.0], module.theory(1.5)
    both = module.pairs(distances, (1, 0, 0))
    np.testing.assert_allclose(both[:, 0], both[:, 1], rtol=1e-7)
    error = (both[:, 0] - alone)/module.farPair(distances) - 1
    assert abs(error[0]) < 0.005 and abs(error[1]) < 0.3*abs(error[0])
    # Side by side the gain decays with the power 5 of the distance.
    beside = module.pairs([20.0, 40.0], (0, 1, 0))[:, 0] - alone
    assert 25 < beside[0]/beside[1] < 35


def test_rollers_carry_each_other_and_stay_at_their_height():
    module = script('roller')
    path = module.crowd(6, duration=20)
    speeds = (path[-1] - path[0])[:, 0]/20
    assert speeds.min() > 1.1*module.theory(1.5)


def test_towed_shells_have_the_drag_of_spheres():
    module = script('towing')
    heights = np.array([1.1, 1.5, 3, 8])
    sphere = module.drags(heights, 1, exact=True)
    np.testing.assert_allclose(sphere[:, 1], module.brenner(heights), rtol=1e-7)
    # Faxén's series omits the power 6 of radius/height.
    error = np.abs(sphere[:, 0]/module.faxen(heights) - 1)
    assert (error < 0.2/heights**6).all()
    shell = module.drags(heights, 42)
    np.testing.assert_allclose(shell[1:], sphere[1:], rtol=0.005)
    # The lowest blob of this shell would reach through the wall.
    assert np.isnan(shell[0]).all()


def test_recorded_pulls_fluctuate_as_the_friction_says():
    """Variances of 6000 normal numbers have errors of 1.8 %; seeds are fixed."""
    module = script('towing')
    holds, friction = module.pull([0, 5], 3000, blobs=12, quiet=True)
    expected = 2*module.KT*np.diag(friction)/module.MILLISECOND
    found = holds.var(axis=0).mean(axis=0)
    np.testing.assert_allclose(found, expected, rtol=4*np.sqrt(2/6000))
    mean = holds[:, 1, 0].mean() - 5*module.SPEED*friction[0, 0]
    assert abs(mean) < 4*np.sqrt(expected[0]/3000)
    frictions = []
    for state in ('held', 'free'):
        averages, friction = module.beside(state, windows=400, blobs=12, quiet=True)
        expected = 2*module.KT*np.diag(friction)/(0.5*module.MILLISECOND)
        np.testing.assert_allclose(averages.var(axis=0), expected, rtol=4*np.sqrt(2/1600))
        frictions.append(friction[0, 0])
    # The two frictions are farther apart than the errors.
    assert frictions[0] > 1.3*frictions[1]


def test_squirmers_swim_as_theory_says():
    module = script('squirmers')
    # Beside the far limits are terms of relative order 1/distance^2.
    distances = np.array([8.0, 16.0])
    extra = module.pairs(distances, B2=3.0) - module.pairs(distances, B2=0.0)
    np.testing.assert_allclose(extra[:, 0], -3/(2*distances**2), rtol=0.03)
    assert abs(extra[1, 0]*2*16**2/3 + 1) < abs(extra[0, 0]*2*8**2/3 + 1)/3
    away = module.walls(distances, module.ALONG, (0, 1))[:, 2]
    np.testing.assert_allclose(away, 3/(16*distances**2), rtol=0.03)
    # Values of an independent program, as in tests/python/test_active.py.
    np.testing.assert_allclose(
        module.pairs([3])[0, [0, 2, 4]], (-0.161106, 0.657629, -0.001612), atol=1e-6)


def test_the_flow_of_a_squirmer_is_that_of_theory_far_away():
    module = script('squirmers')
    errors = [module.errorOfFlow(r, -2.0, 42) for r in (2, 4, 8)]
    # The stresslet of the shell is exact, and its source dipole, of relative order 1/r, is not.
    assert errors[0] < 0.12 and errors[1] < 0.6*errors[0] and errors[2] < 0.6*errors[1]
    # The source dipole is that of a neutral squirmer. Its flow is too weak by the same part at all
    # distances, by 25 % with 42 blobs and 14 % with 162.
    point = np.array([[0, 0, 20.0]])
    for blobs, part in ((42, 0.7499), (162, 0.8565)):
        found = module.flow(point, 0.0, blobs)[0, 2]/module.theory(point, 0.0)[0, 2]
        assert abs(found - part) < 1e-3
    # The exact flow has no slip beside that of the surface, which moves with 2/3 B1 upwards.
    normals = np.random.default_rng(1).normal(size=(50, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    cosine = normals[:, 2:]
    surface = (1 - 2*cosine)*(cosine*normals - (0, 0, 1)) + (0, 0, 2/3)
    np.testing.assert_allclose(module.theory(normals, -2.0), surface, atol=1e-12)


def test_pushers_meet_and_pullers_part():
    module = script('squirmers')
    path = module.race(4.0, 2.0, step=0.1, quiet=True)
    gap = np.linalg.norm(path[:, :, 1, :3] - path[:, :, 0, :3], axis=-1)
    time = 0.1*(len(path) - 1)
    for change, B2 in zip(gap[-1] - gap[0], module.KINDS.values()):
        assert abs(change - ((64 + 3*B2*time)**(1/3) - 4)) < 0.01 + 0.06*abs(change)


def test_jointed_chains_are_ideal_and_diffuse_as_their_mobility_says():
    """Errors are those of the spread of replicas; 5 of them in 7 comparisons, with a fixed seed."""
    module = script('jointed_chain')
    diffusion = {}
    for name, factor in module.FACTORS.items():
        centres, u, short, gap = module.run(factor, replicas=24, steps=1500, quiet=True)
        cosines = (u[:, :, 1:]*u[:, :, :-1]).sum(axis=-1)
        for values, expected in (((cosines**2).mean(axis=2), 1/3), ((u.sum(axis=2)**2).sum(axis=-1),
                                                                    module.RODS)):
            mean, error = module.overReplicas(values)
            assert error < 0.08*expected and abs(mean - expected) < 5*error
        value, error = (each[0] for each in module.diffusion(centres, [1]))
        assert error < 0.03*value and abs(value - short.mean()) < 5*error
        # Joints hold to their tolerance.
        assert gap < 1.01e-10
        diffusion[name] = short.mean()
    alone = module.KT/(3*module.RODS*module.FRICTION)
    assert abs(diffusion['without interactions']/alone - 1) < 0.005
    # Joints and rods take a few per cent of what Kirkwood's formula has.
    assert 0.94 < diffusion['with interactions']/module.kirkwood() < 0.995


def test_the_density_of_the_ends_of_a_chain():
    module = script('jointed_chain')
    r = np.linspace(0, 4, 4001)
    for n in (3, 4):
        density = module.endToEnd(r, n)
        assert abs(np.trapz(density, r) - 1) < 1e-5 and abs(np.trapz(density*r**2, r) - n) < 1e-4
    # Two unit vectors have the density r/2.
    np.testing.assert_allclose(module.endToEnd(r[1:2000], 2), r[1:2000]/2, rtol=1e-12)


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
