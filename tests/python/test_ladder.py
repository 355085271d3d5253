"""openmmrigidhi.accuracy, the hydrodynamic ladder: known errors of a pair, its advice, scenes,
files, and the command line."""
import contextlib
import copy
import csv
import io
import os
import re

import numpy as np
import openmm
import pytest

import openmmrigidhi
from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce, accuracy
from openmmrigidhi.accuracy import cli, ladderreport, ladderresult

#: Relative errors of F/U and of omega/U for two spheres of radius 1 side by side, by distance of
#: the centres: solved by boundary collocation, independently of this package (the project's
#: reference values, section 1). Two digits are printed.
KNOWN = {
    3.0: {
        'RPY': (-1.35e-3, 1.8e-2),
        'FTS': (-9.5e-4, 1.8e-4),
        'multiblob12': (4.2e-5, -7.9e-3),
        'multiblob42': (2.7e-5, -3.6e-4)
    },
    25/12: {
        'RPY': (-1.5e-2, 2.5e-1),
        'FTS': (-7.9e-3, 1.2e-1),
        'multiblob12': (3.9e-4, 4.6e-2),
        'multiblob42': (-3.8e-4, 2.5e-2)
    }
}
#: F/U in units of 4 pi eta a, and omega a/U, exactly.
EXACT = {
    10.0: (1.3947015340, 0.006973274431),
    3.0: (1.1840839517, 0.064558335059),
    25/12: (1.0756206190, 0.097726919137)
}
RUNGS = ('FreeDraining', 'RPY', 'FTS', 'multiblob12', 'multiblob42', 'FTS+lubrication')


@pytest.fixture(scope='module')
def pairs():
    """The ladder of two spheres at three gaps."""
    scenes = accuracy.scenes.pairs([l - 2 for l in EXACT])
    return accuracy.LadderStudy(
        scenes, RUNGS,
        ['mobility', 'sedimentation', 'rotation_translation', 'relative_mobility', 'worst_wrench'],
        platforms=('Reference',)).run(rounds=2, seconds=0.005)


def value(result, l, rung, observable):
    return next(row for row in result.select(observable, rung)
                if row['parameter'] == pytest.approx(l - 2))


def test_the_reference_is_exact_for_a_pair(pairs):
    eta = MobilityForce().getViscosity()._value
    assert all(entry['exact'] for entry in pairs.references.values())
    assert {row['rung'] for row in pairs.rows if row['is_reference']} == {'FTS+lubrication'}
    for l, (drag, spin) in EXACT.items():
        velocity = value(pairs, l, 'FTS+lubrication', 'sedimentation')['value']
        # The norm is over both spheres, which turn in opposite directions.
        turning = value(pairs, l, 'FTS+lubrication', 'rotation_translation')['value']/np.sqrt(2)
        print(f'l = {l:g}: F/U off by {1/(4*np.pi*eta*velocity)/drag - 1:.1e}, omega/U by '
              f'{turning/spin - 1:.1e}')
        assert 1/(4*np.pi*eta*velocity) == pytest.approx(drag, rel=1e-9)
        assert turning == pytest.approx(spin, rel=1e-9)


@pytest.mark.parametrize('l', KNOWN)
@pytest.mark.parametrize('rung', ('RPY', 'FTS', 'multiblob12', 'multiblob42'))
def test_errors_of_a_pair_are_the_known_ones(pairs, l, rung):
    drag, spin = KNOWN[l][rung]
    # F/U is the inverse of the velocity.
    found = 1/(1 + value(pairs, l, rung, 'sedimentation')['error']) - 1
    turning = value(pairs, l, rung, 'rotation_translation')['error']
    print(f'F/U {found:+.2e} (known {drag:+.1e}), omega/U {turning:.2e} (known {spin:+.1e})')
    assert found == pytest.approx(drag, rel=0.03)
    assert turning == pytest.approx(abs(spin), rel=0.03)


def test_free_draining_misses_all_interaction(pairs):
    for row in pairs.select('rotation_translation', 'FreeDraining'):
        assert row['error'] == pytest.approx(1, abs=1e-9)


def test_the_worst_wrench_is_no_better_than_any_other(pairs):
    for rung in RUNGS[:-1]:
        for l in EXACT:
            assert value(pairs, l, rung, 'worst_wrench')['error'] >= abs(
                value(pairs, l, rung, 'relative_mobility')['error'])*(1 - 1e-9)


def test_the_cheapest_rung_is_named(pairs):
    result = copy.deepcopy(pairs)
    cost = {
        'FreeDraining': 1e-6,
        'RPY': 2e-6,
        'FTS': 3e-6,
        'FTS+lubrication': 4e-6,
        'multiblob12': 1e-5,
        'multiblob42': 1e-4
    }
    for row in result.rows:
        row['seconds_step'] = cost[row['rung']]
    # Errors of the settling velocity are up to 1.5 % for RPY, and up to 0.8 % for FTS.
    assert result.recommend('sedimentation:2%').setting['rung'] == 'RPY'
    assert result.recommend('sedimentation:1%').setting['rung'] == 'FTS'
    assert result.recommend(
        'sedimentation:1%,rotation_translation:5%').setting['rung'] == 'FTS+lubrication'
    # Cheaper multiblobs would be good enough.
    for row in result.rows:
        if row['rung'] == 'multiblob12':
            row['seconds_step'] = 1.5e-6
    assert result.recommend(['sedimentation:1%',
                             'rotation_translation:5%']).setting['rung'] == 'multiblob12'
    assert result.recommend('sedimentation:50%').setting['rung'] == 'FreeDraining'
    assert [c['verdict'] for c in result.recommend('sedimentation:0.001').candidates
            ] == ['no', 'yes', 'no', 'no', 'yes', 'yes']


def test_none_of_these(pairs):
    result = copy.deepcopy(pairs)
    del result.rungs['FTS+lubrication'], result.rungs['multiblob42']
    answer = result.recommend('rotation_translation:1%')
    assert answer.verdict == 'none of these' and answer.setting is None
    assert 'none of these' in answer.text and 'multiblob12 with 4.6 %' in answer.text


def test_cannot_tell_below_what_is_known_of_the_reference(pairs):
    result = copy.deepcopy(pairs)
    for row in result.rows:
        row['believed'] = 0.002
    assert result.judge({'error': 0.003, 'believed': 0.002}, 0.006) == 'yes'
    assert result.judge({'error': 0.003, 'believed': 0.002}, 0.004) == 'undecided'
    assert result.judge({'error': -0.003, 'believed': 0.002}, 0.0009) == 'no'
    assert result.judge({'error': 0.0, 'believed': None}, 0.1) == 'undecided'
    answer = result.recommend('sedimentation:0.1%')
    assert answer.verdict == 'cannot tell'
    assert 'add a finer multiblob' in answer.text


def test_where_a_wanted_error_is_met(pairs):
    found = pairs.goodDownTo('sedimentation:0.2%')
    assert found['RPY'] == pytest.approx(1) and found['FTS'] == pytest.approx(1)
    assert found['multiblob12'] == pytest.approx(1/12) and found['FreeDraining'] is None


@pytest.mark.parametrize('wanted', ('weight:1%', 'mobility:x'))
def test_wrong_wishes_are_refused(pairs, wanted):
    with pytest.raises(ValueError, match='wanted error: got'):
        pairs.recommend(wanted)


def test_files(pairs, tmp_path):
    paths = pairs.write(str(tmp_path), ['mobility:5%', 'sedimentation:1e-12'])
    assert {os.path.basename(path)
            for path in paths
            } >= {'ladder.csv', 'ladder.json', 'ladder.html', 'ladder_mobility.png'}
    with open(tmp_path/'ladder.csv') as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(pairs.rows) and float(rows[0]['seconds_step']) > 0
    page = (tmp_path/'ladder.html').read_text()
    assert 'exact for a pair' in page and 'src="data:image/png' in page and 'href="#' in page
    assert 'http' not in re.sub('base64,[^"]*', '', page)
    again = accuracy.LadderResult.fromJson(tmp_path/'ladder.json')
    assert again.rows == pairs.rows and again.recommend('mobility:5%').text == pairs.recommend(
        'mobility:5%').text
    assert 'FTS+lubrication' in ladderreport.textTable(again)


def test_numbers_for_people():
    assert [ladderresult.duration(x)
            for x in (2.0, 0.0123, 4.5e-6, 1e-8)] == ['2 s', '12.3 ms', '4.5 us', '0.01 us']
    assert [ladderresult.percent(x)
            for x in (1.0, -0.012, 1e-7, None)] == ['100 %', '1.2 %', '1.0e-05 %', 'n/a']


# ---- The user's scene ----------------------------------------------------------------------------


def trap(offset=(0.0, 0.0, 0.0), markers=True, force=1.0):
    """Three turned spheres whose centres are off the bodies' origins, with forces, and with markers
    that the fluid does not see."""
    system, fluid, integrator = openmm.System(), MobilityForce(), CustomRigidHIIntegrator(
        300, 0.001)
    integrator.setScheme(CustomRigidHIIntegrator.LangevinHI)
    fluid.setModel(MobilityForce.FreeDraining)
    pull = openmm.CustomExternalForce(f'-{force}*z+{force}*x')
    turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
    sites = np.array([offset, (0, 0, 1.0)] if markers else [offset])
    positions = []
    for k, (radius, centre) in enumerate(
            zip((1.0, 0.7, 0.5), ((0, 0, 0), (2.5, 0, 0.3), (0.4, 2.2, 0)))):
        members = [system.addParticle(1.0) for _ in sites]
        for r in ([radius, 0.0] if markers else [radius]):
            fluid.addParticle(r)
        pull.addParticle(members[0])
        integrator.addRigidBody(members, 100.0, (10.0, 11.0, 12.0), sites)
        # The centre of each sphere is at its place for any offset.
        positions.extend(np.asarray(centre) + (sites - sites[0]) @ turn.T)
    system.addForce(pull)
    system.addForce(fluid)
    return accuracy.Scene(system, positions, integrator, 'three')


def callableScene():
    """The scene of the tests of the command line."""
    return trap()


def test_where_the_origin_is_does_not_matter():
    rungs = ['RPY', 'FTS+lubrication', 'multiblob12+self']
    results = []
    for offset in ((0, 0, 0), (0.2, -0.1, 0.3)):
        spheres = accuracy.ladder.Spheres(trap(offset))
        assert np.allclose(spheres.centres[1], (2.5, 0, 0.3), atol=1e-6)
        assert np.allclose(spheres.forces, [(-1, 0, 1)]*3) and np.allclose(
            spheres.torques, 0, atol=1e-9)
        results.append([
            spheres.sample(*spheres.makeContext(accuracy.rungs.byName(rung))[::2]).mobility
            for rung in rungs
        ])
    for rung, first, second in zip(rungs, *results):
        difference = abs(first - second).max()/abs(first).max()
        print(f'{rung}: {difference:.1e}')
        assert difference < (1e-6 if 'blob' not in rung else 1e-2)
    # A distant sphere has Stokes' tensor about its centre, if this tensor is set.
    spheres = accuracy.ladder.Spheres(accuracy.scenes.spheres([(0, 0, 0), (1000, 0, 0)]))
    scaled = accuracy.mobilities.byName('mobility').measure(
        spheres.sample(*spheres.makeContext(accuracy.rungs.byName('multiblob12+self'))[::2]))
    assert np.allclose(scaled, np.eye(12), atol=2e-3)


def trace(sample):
    """An observable that a user might write."""
    return np.trace(sample.mobility)


def test_a_scene_of_three():
    calls = []
    study = accuracy.LadderStudy(trap(), ['FreeDraining', 'RPY', 'multiblob12', 'FTS+lubrication'],
                                 ['mobility', 'own_forces', trace], platforms=('Reference',))
    result = study.run(rounds=1, seconds=0.005, progress=lambda *what: calls.append(what))
    assert calls[-1][0] == calls[-1][1] == len(calls)
    reference, = result.references.values()
    chosen = reference['observables']['own_forces']
    assert not reference['exact'] and chosen['rung'] == 'FTS+lubrication' and chosen['seconds'] == [
        'multiblob12', 'multiblob12+self'
    ]
    assert 'multiblob12+self' not in result.rungs
    believed = chosen['believed']
    errors = {rung: abs(result.select('own_forces', rung)[0]['error']) for rung in result.rungs}
    print(f'believed {believed:.2e}, errors {errors}')
    assert 0 < believed < errors['RPY'] < errors['FreeDraining']
    assert result.select('trace', 'FTS+lubrication')[0]['value'] > 0
    assert 'its distance to multiblob12 and multiblob12+self' in result.referenceText()
    forces = {row['seconds_forces'] for row in result.rows}
    assert len(forces) == 1 and 0 < forces.pop() < min(row['seconds_step'] for row in result.rows)


def test_remainder_of_a_sequence():
    # For 1, 1.4, 1.5 the last difference is a quarter of the one before. At least a half is
    # assumed, so the remainder equals the last difference.
    assert accuracy.ladder.remainder([0.5, 0.1]) == pytest.approx(0.1)
    # A last difference of nearly zero is taken for chance.
    assert accuracy.ladder.remainder([0.41, 0.01]) == pytest.approx(0.1)
    # For a ratio of 0.6 the remainder is 0.6/0.4 of the last difference.
    assert accuracy.ladder.remainder([1.6, 0.6]) == pytest.approx(0.9)
    assert accuracy.ladder.remainder([1.9, 1.0]) is None
    assert accuracy.ladder.remainder([1.0]) is None and accuracy.ladder.remainder([0.0, 0.0]) == 0


def test_the_reference_of_many_bodies_depends_on_the_observable():
    study = accuracy.LadderStudy(
        trap(), ['RPY', 'multiblob12', 'multiblob42', 'multiblob162', 'FTS+lubrication'],
        ['sedimentation'])
    names = [rung.name for rung in study.rungs]

    class Number:
        compare = staticmethod(lambda value, reference: (value - reference)/reference)

    # Multiblobs agree with each other but not with FTS+lubrication, which lacks many-body terms.
    found = study.chooseReference(Number, dict(zip(names, (1.03, 1.004, 1.0005, 1.0, 0.99))))
    assert found['rung'] == 'multiblob162' and found['believed'] == pytest.approx(0.0035/4)
    # For nearly touching spheres, multiblobs approach FTS+lubrication, but are far from it.
    found = study.chooseReference(Number, dict(zip(names, (8.0, 4.5, 3.0, 2.2, 1.0))))
    assert found['rung'] == 'FTS+lubrication' and found['believed'] == pytest.approx(1.2)


def test_without_a_second_opinion_nothing_is_claimed():
    result = accuracy.LadderStudy(trap(), ['RPY', 'FTS'], ['mobility'],
                                  platforms=('Reference',)).run(rounds=1, seconds=0.001)
    assert result.references[0.0]['observables']['mobility']['rung'] == 'FTS'
    assert result.recommend('mobility:90%').verdict == 'cannot tell'
    assert 'nothing that was computed tells how wrong that is itself' in result.referenceText()


def test_overlap_leaves_other_rungs():
    scene = accuracy.scenes.spheres([(0, 0, 0), (1.8, 0, 0)], temperature=1e-9)
    result = accuracy.LadderStudy(scene, ['RPY', 'multiblob12', 'FTS+lubrication'],
                                  ['sedimentation'], platforms=('Reference',)).run(1, 0.001)
    row = next(row for row in result.rows if row['rung'] == 'FTS+lubrication')
    assert row['status'] == 'not applicable' and 'overlap' in row[
        'message'] and row['seconds_step'] is None
    assert result.references[0.0]['observables']['sedimentation']['rung'] == 'multiblob12'
    with pytest.raises(ValueError, match='cannot be used on this scene: choose another one'):
        accuracy.LadderStudy(scene, ['RPY'], ['sedimentation'],
                             reference='FTS+lubrication').run(1, 0.001)
    with pytest.raises(ValueError, match='none of the rungs can be used'):
        accuracy.LadderStudy(scene, ['FTS'], ['sedimentation'],
                             platforms=('Reference',)).run(1, 0.001)


def test_one_sphere():
    result = accuracy.LadderStudy(accuracy.scenes.spheres([(0, 0, 0)]), ['RPY', 'FTS+lubrication'],
                                  ['mobility', 'relative_mobility', 'rotation_translation'],
                                  platforms=('Reference',)).run(1, 0.001)
    assert result.select('mobility', 'RPY')[0]['error'] == pytest.approx(0, abs=1e-12)
    assert result.recommend('relative_mobility:1%').verdict == 'cannot tell'
    assert 'This observable has no meaning here' in result.recommend('relative_mobility:1%').text


def test_too_many_blobs():
    with pytest.raises(ValueError, match='choose fewer blobs or spheres'):
        spheres = accuracy.ladder.Spheres(accuracy.scenes.suspension(20, 0.01))
        spheres.makeContext(accuracy.rungs.byName('multiblob162'))


def test_scenes_that_are_not_of_spheres():
    def change(work):
        scene = trap()
        system, integrator = openmm.XmlSerializer.clone(scene.system), scene.makeIntegrator()
        fluid = MobilityForce.cast(system.getForce(1))
        work(system, integrator, fluid)
        positions = list(scene.positions)
        positions += [(9, 9, 9)]*(system.getNumParticles() - len(positions))
        return accuracy.ladder.Spheres(accuracy.Scene(system, positions, integrator))

    def addFree(system, integrator, fluid):
        system.addParticle(1.0)
        fluid.addParticle(0.5)

    for work, message in ((lambda s, i, f: f.setParticleRadius(1, 0.1),
                           'body 0 has 2 hydrodynamic particles; it must be a sphere'),
                          (lambda s, i, f: s.removeForce(1), 'the System has 0 MobilityForces'),
                          (addFree, 'a particle that is in no body has a hydrodynamic radius'),
                          (lambda s, i, f: f.setBodyMobility(0, np.eye(6)),
                           'a body has a tensor of its own')):
        with pytest.raises(ValueError, match=message):
            change(work)


def test_flows_that_drive_a_scene_do_not_matter():
    """The study compares mobilities, which do not depend on the driven flow."""
    for edges, drive in ((None, lambda fluid: fluid.setBackgroundFlow((1, 0, 0), [(0, 2, 0),
                                                                                  (0, 0, 0),
                                                                                  (0, 0, 0)])),
                         ((9, 9, 9), lambda fluid: fluid.setSinusoidalForceDensity(2, 0, 1, 1))):
        scene = accuracy.scenes.spheres([(0, 0, 0), (2.5, 0.5, 1)], force=(1, 0, 0),
                                        temperature=1e-9, edges=edges)
        system = openmm.XmlSerializer.clone(scene.system)
        drive(MobilityForce.cast(system.getForce(1)))
        driven = accuracy.Scene(system, scene.positions, scene.makeIntegrator())
        values = [[
            row['value'] for row in accuracy.LadderStudy(
                one, ['RPY', 'FTS'], ['mobility', 'sedimentation'], platforms=(
                    'Reference',)).run(rounds=1, seconds=0.001).rows
        ] for one in (scene, driven)]
        assert values[0] == values[1] and all(values[0])


@pytest.mark.parametrize('boundary', ['NoSlipWall', 'PeriodicWall', 'NoSlipChannel'])
def test_walls_are_those_of_the_scene(boundary):
    """The spheres of a rung are between the same walls, in the same box, without the flow that
    drives the scene."""
    scene = accuracy.scenes.spheres([(0, 0, 0), (2.5, 1, 0.5)], (0.8, 1))
    system = scene.system
    fluid = next(filter(None, map(MobilityForce.cast, [system.getForce(0)])))
    fluid.setBoundary(boundary)
    fluid.setWallHeight(-1.5)
    fluid.setChannelWalls(-1.5, 2)
    fluid.setChannelCondition('ZeroFlux')
    if boundary == 'NoSlipChannel':
        fluid.setWallVelocity((1, 2, 0))
    system.setDefaultPeriodicBoxVectors((7, 0, 0), (0, 8, 0), (0, 0, 9))
    changed = accuracy.Scene(system, scene.positions, scene.makeIntegrator())
    spheres = accuracy.ladder.Spheres(changed)
    integrator = changed.makeIntegrator()
    integrator.setScheme(integrator.LangevinHI)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setPositions(scene.positions)
    found = spheres.sample(*spheres.makeContext(accuracy.rungs.byName('RPY'))[::2]).mobility
    # The study's centres are those after a step of 1e-9 ps.
    assert np.allclose(found, fluid.getMobilityInContext(context), rtol=1e-7, atol=1e-12)
    # Shells are bodies that forces see as one molecule each; they move much as the spheres do.
    shells = spheres.sample(*spheres.makeContext(accuracy.rungs.byName('multiblob42'))[::2])
    assert np.allclose(np.diag(shells.mobility), np.diag(found), rtol=0.5)


def test_wrong_studies():
    scene = accuracy.scenes.pair(1)
    for arguments, message in (((scene, ['Oseen']), 'the hydrodynamic ladder has FreeDraining'),
                               ((scene, ['RPY',
                                         'RPY']), 'at least one is needed, and each only once'),
                               ((scene, ['RPY'], ['weight']), 'observable of mobility: got'),
                               (({}, ['RPY']),
                                'the dict is empty; it must have at least one scene')):
        with pytest.raises(ValueError, match=message):
            accuracy.LadderStudy(*arguments)
    with pytest.raises(ValueError, match='found no room by chance'):
        accuracy.scenes.suspension(4, 2.0)
    with pytest.raises(ValueError, match='the numbers of blobs with a known hydrodynamic radius'):
        openmmrigidhi.app.multiblobSphere(1000, 1)


# ---- Command line --------------------------------------------------------------------------------


def run(*arguments):
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(
            io.StringIO()) as error:
        status = cli.main([*arguments, '--quiet'])
    return status, out.getvalue(), error.getvalue()


def test_command_line_of_pairs(tmp_path, blankPictures):
    blankPictures()
    status, out, error = run('--ladder', '--gaps', '0.1,1', '--rungs', 'RPY', 'FTS',
                             'FTS+lubrication', '--rounds', '1', '--platform', 'Reference',
                             '--wanted-error', 'mobility:1%', '--output', str(tmp_path))
    assert status == 0, error
    assert ('gaps 0.1 to 1: FTS+lubrication' in out
            and 'Where mobility:1% is met, by gap: RPY: nowhere' in out)
    status, out, error = run('--from', str(tmp_path/'ladder.json'), '--wanted-error',
                             'mobility:50%', '--output', str(tmp_path/'again'))
    assert status == 0, error
    assert 'For an error of at most 50% of mobility matrix' in out


def test_command_line_of_a_scene(tmp_path, monkeypatch, blankPictures):
    blankPictures()
    monkeypatch.syspath_prepend(os.path.dirname(__file__))
    status, out, error = run('--ladder', '--scene', 'test_ladder:callableScene', '--rungs', 'RPY',
                             'multiblob12', 'FTS+lubrication', '--rounds', '1', '--output',
                             str(tmp_path/'a'), '--observables', 'own_forces', 'test_ladder:trace')
    assert status == 0, error
    assert 'trace' in out
    scene = trap()
    state = openmm.Context(scene.system, scene.makeIntegrator(),
                           openmm.Platform.getPlatformByName('Reference'))
    state.setPositions(scene.positions)
    files = []
    for name, thing in (('system', scene.system), ('state', state.getState(getPositions=True)),
                        ('integrator', scene.makeIntegrator())):
        files += [f'--{name}', str(tmp_path/f'{name}.xml')]
        (tmp_path/f'{name}.xml').write_text(openmm.XmlSerializer.serialize(thing))
    status, out, error = run('--ladder', *files, '--rungs', 'RPY', 'FTS+lubrication', '--rounds',
                             '1', '--output', str(tmp_path/'b'))
    assert status == 0, error


@pytest.mark.parametrize('arguments, message',
                         [(['--gaps', 'x'], 'gaps are positive numbers in radii'),
                          (['--scene', 'water'], "got 'water' with --ladder"),
                          (['--gaps', '1', '--scene', 'a:b'], 'gaps are those of pairs'),
                          (['--wanted-error', 'weight:1%'], 'wanted error: got'),
                          (['--rungs', 'Oseen'], 'the hydrodynamic ladder has')])
def test_wrong_arguments(arguments, message):
    status, _, error = run('--ladder', *arguments)
    assert status == 2 and message in error


def test_what_cannot_be_timed_is_said():
    study = accuracy.LadderStudy(accuracy.scenes.pair(0.5), ['RPY', 'FTS+lubrication'],
                                 ['mobility'], platforms=('Reference',))
    make = accuracy.rungs.Spheres.makeContext
    calls = []

    def fail(self, rung, *arguments):
        calls.append(rung.name)
        if rung.name == 'RPY' and calls.count('RPY') == 2:
            raise openmm.OpenMMException('no step today')
        return make(self, rung, *arguments)

    accuracy.rungs.Spheres.makeContext = fail
    try:
        result = study.run(rounds=1, seconds=0.001)
    finally:
        accuracy.rungs.Spheres.makeContext = make
    row = result.select('mobility', 'RPY')[0]
    assert row['seconds_step'] is None and row['message'] == 'not timed on Reference: no step today'
    assert 'RPY: not timed on Reference: no step today' in ladderreport.summary(result, [], [])
    assert [c['rung'] for c in result.recommend('mobility:99%').candidates] == ['FTS+lubrication']


# ---- Periodic boxes ------------------------------------------------------------------------------

#: K and KR of simple cubic arrays by FTS and by FTS + lubrication, computed by prototypes
#: independently of this package.
ARRAYS = {
    0.064: ((2.778145, 2.780656), (None, 1.069171)),
    0.125: ((4.082623, 4.090297), (None, 1.147979)),
    0.45: ((9.880996, 9.929177), (1/(1 - 0.45), 2.338201))
}


@pytest.fixture(scope='module')
def arrays():
    """The ladder of simple cubic arrays, with all rungs that are cheap."""
    return accuracy.LadderStudy(
        accuracy.scenes.arrays(),
        [rung for rung in accuracy.rungs.PERIODIC if rung != 'multiblob162'],
        platforms=('Reference',)).run(rounds=1, seconds=0.002)


def numberOf(result, fraction, rung, observable):
    return next(row for row in result.select(observable, rung) if row['parameter'] == fraction)


def test_arrays_have_their_exact_numbers(arrays):
    assert list(arrays.observables) == ['drag', 'rotational_drag'
                                        ] and 'exact numbers' in arrays.referenceText()
    for k, observable in enumerate(arrays.observables):
        exact = arrays.exactNumbers(observable)
        assert list(exact) == list(accuracy.scenes.SIMPLE_CUBIC) and list(
            exact.values()) == [pair[k] for pair in accuracy.scenes.SIMPLE_CUBIC.values()]
        assert not any(row['is_reference'] for row in arrays.rows)
        for fraction, numbers in ARRAYS.items():
            for rung, known in zip(('FTS', 'FTS+lubrication'), numbers[k]):
                row = numberOf(arrays, fraction, rung, observable)
                if known is not None:
                    assert row['value'] == pytest.approx(known, rel=1e-6)
                    assert row['error'] == pytest.approx(known/exact[fraction] - 1, abs=1e-6)
    # In dilute arrays all models agree.
    for rung in ('RPY', 'ForceCoupling', 'FTS', 'FTS+lubrication'):
        assert abs(numberOf(arrays, 0.001, rung, 'drag')['error']) < 1e-4
    # FreeDraining has no images, so the drag is that of a sphere alone.
    assert numberOf(arrays, 0.45, 'FreeDraining', 'drag')['value'] == pytest.approx(1, abs=1e-9)


def test_fts_cannot_follow_a_dense_array(arrays):
    good = arrays.goodUpTo('drag:10%')
    assert good['FTS'] == good['FTS+lubrication'] == good['RPY'] == 0.125 and good[
        'ForceCoupling'] == 0.216 and good['FreeDraining'] is None
    assert numberOf(arrays, 0.216, 'FTS+lubrication', 'drag')['error'] < -0.15 and numberOf(
        arrays, 0.45, 'FTS+lubrication', 'drag')['error'] < -0.6
    # For rotation lubrication is needed, and for translation shells of blobs.
    assert arrays.goodUpTo('rotational_drag:2%')['FTS+lubrication'] == 0.45
    assert good['multiblob42'] == 0.343
    text = next(text for text in ladderreport.summary(arrays, [], []) if text.startswith('Drag K'))
    assert ('FTS: up to 0.125; ' in text
            and 'the exact number is 28.09, and found are FreeDraining 1, RPY 9.881' in text)
    # Shells that do not fit between their images are named together with these arrays.
    assert any(
        text.startswith('multiblob42 cannot be used at volume fraction 0.45: ')
        for text in ladderreport.summary(arrays, [], []))


def test_what_was_not_possible_everywhere_is_not_the_most_accurate(arrays):
    assert '(in part)' in ladderreport.textTable(arrays)
    answer = arrays.recommend('drag:1%')
    assert (answer.verdict == 'none of these'
            and 'the most accurate is ForceCoupling with 37 %' in answer.text)


def test_files_of_arrays(arrays, tmp_path):
    arrays.write(str(tmp_path), ['drag:10%'])
    assert 'by volume fraction: FreeDraining: nowhere; RPY: up to 0.125' in (
        tmp_path/'ladder.html').read_text()
    again = accuracy.LadderResult.fromJson(tmp_path/'ladder.json')
    assert again.rows == arrays.rows and again.isHarderUpwards and again.exactNumbers(
        'drag') == arrays.exactNumbers('drag')


def test_a_sphere_in_a_box_is_no_exact_pair():
    """For one sphere StokesianDynamics is exact in unbounded fluid, but not among its images."""
    result = accuracy.LadderStudy(accuracy.scenes.array(0.343),
                                  ['FTS', 'multiblob42', 'FTS+lubrication'], ['mobility'],
                                  platforms=('Reference',)).run(1, 0.001)
    assert not result.references[0.0]['exact']
    assert result.references[0.0]['observables']['mobility']['believed'] > 1e-3


def test_a_periodic_suspension(tmp_path):
    status, out, error = run('--ladder', '--scene', 'periodic', '--bodies', '3', '--rounds', '1',
                             '--platform', 'Reference', '--rungs', 'FreeDraining', 'RPY',
                             'ForceCoupling', 'FTS+lubrication', 'multiblob12', '--observables',
                             'sedimentation', '--output', str(tmp_path))
    assert status == 0, error
    result = accuracy.LadderResult.fromJson(tmp_path/'ladder.json')
    errors = {rung: abs(result.select('sedimentation', rung)[0]['error']) for rung in result.rungs}
    assert errors['FreeDraining'] > 1 > errors['RPY'] and not any(row['message']
                                                                  for row in result.rows)
    scene = accuracy.scenes.periodicSuspension(3)
    edge = scene.boxVectors[0][0]
    assert edge == pytest.approx((4*np.pi/3*3/0.15)**(1/3))
    apart = scene.positions[:, None] - scene.positions
    apart -= edge*np.round(apart/edge)
    assert np.linalg.norm(apart, axis=2)[np.triu_indices(3, 1)].min() >= 2.02


def test_wrong_arrays():
    with pytest.raises(
            ValueError, match=
            'exact numbers of simple cubic arrays are known for the volume fractions 0.001, 0.027'):
        accuracy.scenes.arrays([0.2])
    status, _, error = run('--ladder', '--scene', 'arrays', '--gaps', '1')
    assert status == 2 and 'got it with another scene; gaps are those of pairs' in error
    result = accuracy.LadderStudy(accuracy.scenes.pair(1),
                                  ['RPY', 'ForceCoupling', 'FTS+lubrication'], ['mobility'],
                                  platforms=('Reference',)).run(1, 0.001)
    assert 'ForceCoupling' in next(row['message'] for row in result.rows
                                   if row['rung'] == 'ForceCoupling')
