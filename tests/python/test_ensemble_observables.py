"""Heights, displacements and histograms of any scene in an ensemble, and times with units."""
import json
import pathlib

import numpy as np
import openmm
import openmmrigidhi
import pytest
from openmm import unit
from openmmrigidhi import ensemble
from openmmrigidhi.accuracy import Scene, observables

KT = 300*unit.kelvin*unit.MOLAR_GAS_CONSTANT_R/unit.kilojoule_per_mole
#: Drag of a sphere of 1 nm in the fluid of the scene, and its diffusion coefficient.
DRAG = 6*np.pi*1.0
FREE = KT/DRAG


def falling(spheres=20, weight=0.0, seed=1):
    """Spheres of 1 nm that feel no others, in a trap along z if they have a weight."""
    system, fluid = openmm.System(), openmmrigidhi.MobilityForce()
    integrator = openmmrigidhi.CustomRigidHIIntegrator(300, 0.01)
    integrator.setScheme('EulerMaruyama')
    for _ in range(spheres):
        openmmrigidhi.app.addRigidMultiblob(system, integrator, fluid, [(0, 0, 0)], 1.0)
    fluid.setViscosity(1.0)
    fluid.setModel('FreeDraining')
    system.addForce(fluid)
    trap = openmm.CustomExternalForce('spring*(z - 3)^2/2')
    trap.addGlobalParameter('spring', weight)
    for i in range(spheres):
        trap.addParticle(i, [])
    system.addForce(trap)
    random = np.random.default_rng(seed)
    spread = (KT/weight)**0.5 if weight else 0
    return system, [(0, 0, 3 + spread*random.normal()) for _ in range(spheres)], integrator


def twoKinds(few=4, spring=25.0, weak=10.0, seed=1):
    """Ten such spheres: the first few in traps at a height of 3, the others in weaker ones at 5."""
    system, _, integrator = falling(10)
    trap = openmm.CustomExternalForce('own*(z - height)^2/2')
    trap.addPerParticleParameter('own')
    trap.addPerParticleParameter('height')
    for i in range(10):
        trap.addParticle(i, [spring, 3] if i < few else [weak, 5])
    system.addForce(trap)
    random = np.random.default_rng(seed)
    heights = [3 + random.normal()*(KT/spring)**0.5 for _ in range(few)]
    heights += [5 + random.normal()*(KT/weak)**0.5 for _ in range(10 - few)]
    return system, [(0, 0, height) for height in heights], integrator


def heightOfBodies(context):
    """The height of each body above 3 nm, as a function of the user's."""
    integrator = openmmrigidhi.CustomRigidHIIntegrator.cast(context.getIntegrator())
    return integrator.getBodyPositions()[:, 2] - 3*unit.nanometer


heightOfBodies.unit = 'nm'


def test_displacements_are_those_of_free_diffusion(tmp_path):
    picosecond = unit.picosecond
    study = ensemble.Study(
        falling, replicas=4, length=4000*unit.femtosecond, equilibration=0*picosecond,
        sampleInterval=0.1*picosecond, observables=[
            'msd_0.4',
            observables.meanSquareDisplacement(400*unit.femtosecond, lateral=True)
        ], platform='Reference', checkpointInterval=1e3)
    result = study.run(str(tmp_path/'study'), quiet=True)
    for name, axes in (('msd_0.4', 3), ('lateral_msd_0.4', 2)):
        row = result.row(name)
        assert row['unit'] == 'nm^2' and row['replicas'] == 4
        # 80 independent spheres, 10 independent displacements each.
        assert row['mean'] == pytest.approx(2*axes*FREE*0.4, rel=5*(2/axes/800)**0.5)
    # The first four samples have no past.
    samples = result.series('msd_0.4', 0, 0)
    assert len(samples) == 40 and np.isnan(samples[:4]).sum() in (3, 4)


def test_heights_have_the_histogram_of_their_trap(tmp_path):
    spring = 10.0
    sigma = (KT/spring)**0.5
    edges = 3 + sigma*np.array([-1.0, 0.0, 1.0])
    own = observables.bins('test_ensemble_observables:heightOfBodies', [-sigma, sigma])
    study = ensemble.Study(falling, [{
        'spheres': 50,
        'weight': spring
    }], replicas=4, length=4.0,
                           observables=['mean_height', *observables.bins('height', edges),
                                        *own], platform='Reference')
    result = study.run(str(tmp_path/'study'), quiet=True)
    row = result.row('mean_height')
    assert abs(row['mean'] - 3) < 5*row['standard_error'] and row['unit'] == 'nm'
    found, fractions, errors = result.histogram('height')
    assert np.allclose(found, [edges[:2], edges[1:]])
    # A normal distribution has 0.3413 within a standard deviation on each side.
    assert np.all(np.abs(fractions - 0.3413) < 5*errors) and errors.max() < 0.05
    _, both, error = result.histogram('test_ensemble_observables:heightOfBodies')
    assert both[0] == pytest.approx(fractions.sum(), abs=1e-12) and 0 < error[0] < 0.05
    with pytest.raises(ValueError, match="found no samples of bins of 'depth' in setting 0"):
        result.histogram('depth')


def test_a_study_with_such_observables_goes_on_from_its_directory(tmp_path):
    edges = [2.5, 3.0]
    study = ensemble.Study(
        falling, replicas=2, length=0.5, platform='Reference', observables=[
            observables.meanSquareDisplacement(0.2),
            observables.diffusionCoefficient(0.1),
            *observables.bins('height', edges*unit.nanometer),
            *observables.bins(heightOfBodies, [0, 1])
        ])
    short = study.run(str(tmp_path/'study'), quiet=True)
    loaded = ensemble.Study.load(str(tmp_path/'study'))
    names = [each.name for each in loaded.observables]
    assert names == [
        'msd_0.2', 'diffusion_coefficient_0.1', 'height[2.5,3]',
        f'{heightOfBodies.__module__}:heightOfBodies[0,1]'
    ]
    long = loaded.extended(length=1*unit.picosecond).run(str(tmp_path/'study'), extend=True,
                                                         quiet=True)
    for name in names:
        before, after = short.series(name, 0, 1), long.series(name, 0, 1)
        assert len(after) == 2*len(before)
        assert np.array_equal(before, after[:len(before)], equal_nan=True)
        # The past goes on across the interruption.
        assert not np.isnan(after[len(before):]).any()


def test_bodies_of_two_kinds_have_observables_of_their_own(tmp_path):
    """The first spheres hang in traps at a height of 3, the others at 5 and in weaker ones."""
    length = 4.0
    chosen = [
        *observables.bins('height', [2.5, 3, 4], bodies=range(4)),
        observables.meanSquareDisplacement(0.2, bodies=range(4)),
        observables.diffusionCoefficient(0.1, lateral=True, bodies=[9, 8, 4, 5, 6, 7])
    ]
    names = [each.name for each in chosen]
    assert names == [
        'height[2.5,3]@0-3', 'height[3,4]@0-3', 'msd_0.2@0-3',
        'lateral_diffusion_coefficient_0.1@4-9'
    ]
    assert chosen[2].label.endswith('in 0.2 ps, bodies 0-3')
    study = ensemble.Study(
        twoKinds, replicas=4, length=length, observables=[
            *chosen, 'mean_height@0-3', 'mean_height@4,5-9', 'mean_height', 'msd_0.2',
            'msd_0.2@4-9', 'height[2.5,3]'
        ], platform='Reference')
    directory = str(tmp_path/'study')
    study.run(directory, quiet=True)
    loaded = ensemble.Study.load(directory)
    assert [each.name for each in loaded.observables][:4] == names
    result = loaded.extended(length=1.25*length).run(directory, extend=True, quiet=True)

    def rows(name, *choices):
        return [result.row(name + chosen) for chosen in choices]

    first, second, both = rows('mean_height', '@0-3', '@4,5-9', '')
    assert abs(first['mean'] - 3) < 5*first['standard_error'] < 1
    assert abs(second['mean'] - 5) < 5*second['standard_error'] < 1
    moved = rows('msd_0.2', '@0-3', '@4-9', '')
    for few, others, everyone in ((first, second, both), moved):
        assert everyone['mean'] == pytest.approx(0.4*few['mean'] + 0.6*others['mean'], rel=1e-12)
    assert moved[0]['mean'] != moved[1]['mean']
    edges, fractions, _ = result.histogram('height', bodies=[3, 2, 1, 0])
    assert np.allclose(edges, [[2.5, 3], [3, 4]]) and 0.8 < fractions.sum() < 1
    assert result.histogram('height')[1][0] < fractions[0]
    with pytest.raises(ValueError, match=r"bins of 'height' of bodies \[0, 1\] in setting 0"):
        result.histogram('height', bodies=[0, 1])


def test_bodies_that_a_scene_lacks_are_refused_before_its_run(tmp_path):
    for name in ('msd_1@0-9', 'height[0,9]@9', 'diffusion_coefficient_50@2,9'):
        study = ensemble.Study(falling, [{
            'spheres': 3
        }], replicas=1, length=0.2, platform='Reference', observables=[name])
        directory = str(tmp_path/name.replace('[', '_'))
        problem, = study.run(directory, quiet=True).problems()
        assert f'observable {name}: bodies: got body 9; the scene has 3 bodies' in str(problem)
        assert study.run(directory, quiet=True).tasks[0].samples == 0


def test_bodies_of_observables_are_checked():
    ofAll = observables.byName('mean_height')
    for bodies in ([], [-1], [2, 2]):
        with pytest.raises(ValueError, match='observable mean_height: bodies: got .* once'):
            ofAll.ofBodies(bodies)
    for name in ('potential_energy', 'pressure'):
        with pytest.raises(ValueError, match='heights, displacements and diffusion coefficients'):
            observables.byName(f'{name}@0-3')
    with pytest.raises(ValueError, match='heights, displacements'):
        ofAll.ofBodies([1]).ofBodies([0])
    for text in ('', '3-', 'a', '1;2', '-1'):
        with pytest.raises(ValueError, match='ranges of them, as in @0-29,40'):
            observables.byName(f'mean_height@{text}')
    with pytest.raises(ValueError, match="mean_height@5-3'; 5-3 has no bodies: give the smaller"):
        observables.byName('mean_height@5-3')
    system, positions, integrator = falling(2)
    scene = Scene(system, positions, integrator)
    context = scene.makeContext(integrator, openmm.Platform.getPlatformByName('Reference'), {}, 1)
    sample = observables.Sample(scene, context)
    heights = [each[2] for each in positions]
    assert ofAll.ofBodies([1]).measure(sample) == pytest.approx(heights[1])
    assert ofAll.measure(sample) == pytest.approx(sum(heights)/2)
    with pytest.raises(ValueError, match='got body 2; there are values for 2 bodies'):
        ofAll.ofBodies([0, 2]).measure(sample)
    own, = observables.bins(lambda context: [0.5, 1.5], [1, 2], bodies=[1])
    assert own.measure(sample) == 1 and own.name.endswith('[1,2]@1')
    one, = observables.bins(lambda context: 1.5, [1, 2], bodies=[0])
    with pytest.raises(ValueError, match='there are values for 1 bodies'):
        one.measure(sample)


def test_openmms_own_integrators_have_the_centres_of_mass():
    system = openmm.System()
    for mass in (3.0, 1.0):
        system.addParticle(mass)
    system.addConstraint(0, 1, 0.4)
    integrator = openmmrigidhi.CustomRigidHIIntegrator(300, 0.001)
    integrator.addRigidBody([0, 1])
    scene = Scene(system, [(0, 0, 1), (0, 0, 1.4)], integrator)
    context = scene.makeContext(openmm.VerletIntegrator(0.001),
                                openmm.Platform.getPlatformByName('Reference'), {}, 1)
    sample = observables.Sample(scene, context)
    assert observables.byName('mean_height').measure(sample) == pytest.approx(1.1)


def test_times_of_scenes_and_steps_take_units(tmp_path):
    system, positions, integrator = falling(2)
    scene = Scene(system, positions, integrator, sampleInterval=200*unit.femtosecond,
                  equilibration=0.1*unit.picosecond, stepSizes=[1, 2]*unit.femtosecond)
    assert (scene.sampleInterval, scene.equilibration) == pytest.approx((0.2, 0.1))
    assert scene.stepSizes == pytest.approx((0.001, 0.002))
    study = ensemble.Study(scene, ensemble.sweep(stepSize=[20*unit.femtosecond]), replicas=1,
                           length=0.4, observables=['mean_height'], platform='Reference',
                           checkpointInterval=30*unit.second)
    assert study.checkpointInterval == pytest.approx(30)
    study.run(str(tmp_path/'study'), quiet=True)
    about = json.loads((pathlib.Path(tmp_path)/'study'/'study.json').read_text())
    assert about['definition']['settings'] == [{'stepSize': pytest.approx(0.02)}]
    with pytest.raises(TypeError, match='length: got a quantity in nanometer; it must be ps'):
        ensemble.Study(falling, length=5*unit.nanometer)


@pytest.mark.parametrize('text, picoseconds', [('5', 5), ('0.5ns', 500), ('2 us', 2e6),
                                               ('1s', 1e12), ('1e3fs', 1)])
def test_times_of_the_command_take_units(text, picoseconds):
    from openmmrigidhi.ensemble import cli
    options = cli.parser().parse_args(['study', '--length', text])
    assert options.length == pytest.approx(picoseconds)


def test_bad_times_of_the_command_are_refused(capsys):
    from openmmrigidhi.ensemble import cli
    for text in ('5 nm', 'ps', '1e'):
        with pytest.raises(SystemExit):
            cli.parser().parse_args(['study', '--length', text])
        assert 'a time is a number, of ps or with one of' in capsys.readouterr().err


@pytest.mark.parametrize('name', [
    'msd_', 'msd_x', 'height[1,0]', 'height[1]', 'depth[0,1]', 'msd_5nm', 'height[1um,2ps]',
    'height[2nm,1]'
])
def test_bad_names_are_refused(name):
    with pytest.raises(ValueError, match=r'it must be one of .*msd_TIME, lateral_msd_TIME.* of fs'):
        observables.byName(name)


def test_names_and_edges_may_have_units():
    for name, time in (('msd_0.2s', 0.2e12), ('lateral_msd_5 ns', 5e3), ('msd_20', 20),
                       ('diffusion_coefficient_2us', 2e6), ('lateral_diffusion_coefficient_1ms',
                                                            1e9)):
        observable = observables.byName(name)
        assert observable.name == name and observable.measure.window == pytest.approx(time)
    um = unit.micrometer
    for each in (observables.byName('height[1um,1.5um]'),
                 *observables.bins('height', [1*um, 1.5*um]),
                 *observables.bins('height', [1, 1.5]*um)):
        assert (each.measure.low, each.measure.high) == pytest.approx((1000, 1500))
    assert observables.byName('height[1um,1.5um]').name == 'height[1um,1.5um]'
    assert observables.byName('height[-inf,3]').measure.low == -np.inf
    assert observables.bins('height', [0, 1, np.inf])[1].name == 'height[1,inf]'


@pytest.mark.parametrize('settings, message',
                         [({
                             'observables': ['msd_0.25']
                         }, 'its time of 0.25 ps is 2.5 sample intervals of 0.1 ps'),
                          ({
                              'observables': ['lateral_diffusion_coefficient_1fs']
                          }, 'is 0.01 sample intervals of 0.1 ps'),
                          ({
                              'sampleInterval': 0.001
                          }, 'sampleInterval: got 0.001 ps, which is shorter than a step of 0.01'),
                          ({
                              'length': 1e-6
                          }, 'length: got 1e-06 ps, which is shorter than a step of 0.01 ps'),])
def test_times_that_steps_and_samples_do_not_resolve_are_refused(settings, message, tmp_path):
    study = ensemble.Study(
        falling, replicas=1, platform='Reference', **{
            'length': 1,
            'sampleInterval': 0.1,
            'observables': ['mean_height'],
            **settings
        })
    task, = study.run(str(tmp_path/'study'), quiet=True).tasks
    assert task.status == 'failed' and message in task.message


def test_times_may_be_texts(tmp_path):
    study = ensemble.Study(falling, replicas=1, length='1000 fs', sampleInterval='0.1ps',
                           platform='Reference', observables=['mean_height'])
    assert len(study.run(str(tmp_path/'study'), quiet=True).series('mean_height', 0, 0)) == 10
    with pytest.raises(ValueError, match="length: got '5 nm'; a time is a number of ps"):
        ensemble.Study(falling, replicas=1, length='5 nm', observables=['mean_height'])


def test_a_histogram_of_bins_with_units(tmp_path):
    study = ensemble.Study(
        falling, replicas=1, length=1, sampleInterval=0.1, platform='Reference',
        observables=['height[-1um,0.004um]', *observables.bins('height', [4, 1000])])
    edges, fractions, _ = study.run(str(tmp_path/'study'), quiet=True).histogram('height')
    assert edges.tolist() == [[-1000, 4], [4, 1000]] and fractions.sum() == pytest.approx(1)


def test_lateral_diffusion_is_that_along_the_wall(tmp_path):
    """Spheres that a trap holds along z, where they move much less."""
    study = ensemble.Study(falling, ensemble.sweep(weight=[1e3]), replicas=4, length=40,
                           sampleInterval=0.1, platform='Reference',
                           observables=['lateral_diffusion_coefficient_200fs'])
    row = study.run(str(tmp_path/'study'), quiet=True).row('lateral_diffusion_coefficient_200fs')
    assert row['unit'] == 'nm^2/ps'
    # 80 spheres with 100 independent displacements over 0.4 ps, of two axes; the difference of two
    # displacements has at most the error of the longer one, which is twice as large.
    assert row['mean'] == pytest.approx(FREE, rel=5*2*(2/2/8000)**0.5)


def test_bad_observables_are_refused(tmp_path):
    with pytest.raises(ValueError, match='the time of a displacement must be'):
        observables.byName('msd_-1')
    with pytest.raises(ValueError, match='a histogram needs two edges at'):
        observables.bins('height', [1, 1])
    for name in ('height', 'msd'):
        study = ensemble.Study(falling, replicas=1, length=0.1, observables=[name],
                               platform='Reference')
        result = study.run(str(tmp_path/name), quiet=True)
        assert f'observable {name}: the scene' in result.tasks[0].message
        assert 'is no WallScene, such as boomerang' in result.tasks[0].message


def test_times_that_were_rounded_are_named(tmp_path):
    """The step is 0.01 ps."""
    def run(directory, observables=('mean_height',), **options):
        study = ensemble.Study(falling, replicas=2, platform='Reference', observables=observables,
                               **options)
        return study.run(str(tmp_path/directory), quiet=True)

    result = run('rounded', length=1.0, sampleInterval=0.025)
    assert result.sampleInterval() == 0.02*unit.picosecond
    row = result.row('mean_height')
    assert 'samples are every 0.02 ps, a whole number of steps, and not every 0.025' in row['note']
    assert len(result.series('mean_height', 0, 0)) == 50
    with pytest.raises(ValueError, match='sampleInterval: setting 1 has no samples'):
        result.sampleInterval(1)
    note = run('exact', length=1.0, sampleInterval=0.02).row('mean_height')['note']
    assert 'samples are every' not in note
    # Displacements over another time than their name says are none.
    result = run('displacements', ['msd_0.32'], length=1.0, sampleInterval=0.1)
    assert 'its time of 0.32 ps is 3.2 sample intervals' in str(result.problems()[0])
    named = run('coefficients', ['diffusion_coefficient_0.32'], length=2.0, sampleInterval=0.1)
    row = named.row('diffusion_coefficient_0.32')
    assert row['mean'] == pytest.approx(FREE, rel=0.5)
    note = run('short', length=0.05, sampleInterval=0.1).row('mean_height')['note']
    assert 'with fewer than two samples, left out: run longer' in note


def test_a_study_of_own_observables_says_how_to_go_on(tmp_path):
    own = observables.Observable('unmet', 'unmet pairs', '', lambda sample: 1.0)
    study = ensemble.Study(falling, replicas=1, length=0.1, sampleInterval=0.02,
                           platform='Reference', observables=[own])
    study.run(str(tmp_path/'study'), quiet=True)
    with pytest.raises(
            ValueError, match="observable 'unmet' is not known by its name .* run the "
            'script again that made it'):
        ensemble.Study.load(str(tmp_path/'study'))
    assert study.run(str(tmp_path/'study'), quiet=True).isComplete
