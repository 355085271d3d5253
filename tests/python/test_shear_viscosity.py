"""Viscosity and normal stresses in steady shear, by parts: exact values of spheres at rest, springs
that have the stress of Rouse's dumbbells, errors, and what is refused."""
import copy
import itertools
import re
import warnings

import numpy as np
import openmm
import openmm.app
import pytest
from scipy import stats
from test_shear import BOLTZ, cubic, data, gas, repulsion, scene

from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce, analysis, app

#: Chance of a false alarm of each statistical test.
FALSE_ALARMS = 1e-5


def quantile(degrees):
    return stats.t.ppf(1 - FALSE_ALARMS/2, degrees)


@pytest.mark.parametrize('case', data('periodic_sheared.json'), ids=lambda case: case['name'])
@pytest.mark.parametrize('rate', [1.0, -0.25])
def test_spheres_at_rest_have_the_exact_viscosity(case, rate):
    context = scene('CPU', case['positions'], case['box'], radii=case['radii'], rate=rate)[2]
    found = analysis.shearViscosity(context)
    assert found.ratio == pytest.approx(case['relativeViscosity'], rel=1e-8)
    assert found.viscosity._value == found.ratio and found.shearRate._value == rate
    assert found.parts == {
        'hydrodynamic': found.ratio - 1,
        'brownian': 0,
        'interparticle': 0
    } or np.isclose(found.parts['hydrodynamic'], found.ratio - 1)
    stress = np.sign(rate)*np.array(case['particleStressInShear'])
    assert found.firstNormalDifference == pytest.approx(stress[0, 0] - stress[1, 1], abs=1e-7)
    assert found.secondNormalDifference == pytest.approx(stress[1, 1] - stress[2, 2], abs=1e-7)
    assert found.ratioError == 0 and found.samples == 1 and found.isTrusted


def spheres(model, lubrication='Auto', shells=0, **options):
    """A Context of spheres at random places, of which the first may be shells of blobs."""
    sites, radius = (part._value for part in app.multiblobSphere(12, 1.0))
    centres = gas(8, 9.0, nearest=2.6)
    definitions = [sites if i < shells else np.zeros((1, 3)) for i in range(8)]
    system, fluid = openmm.System(), MobilityForce()
    integrator = CustomRigidHIIntegrator(0, 0.01)
    integrator.setScheme('FixmanMidpoint')
    for i, each in enumerate(definitions):
        app.addRigidMultiblob(system, integrator, fluid, each, radius if i < shells else 1.0)
    fluid.setModel(model)
    fluid.setBoundary('Periodic')
    fluid.setLubrication(lubrication)
    fluid.setShear(1.0, 0, 1)
    system.addForce(fluid)
    for force in options.get('forces', ()):
        system.addForce(copy.deepcopy(force))
    system.setDefaultPeriodicBoxVectors(*cubic(9.0).tolist())
    app.bindBodies(system, integrator)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('CPU'))
    context.setPositions(np.concatenate([x + each for x, each in zip(centres, definitions)]))
    return context


@pytest.mark.parametrize('model', ['RotnePragerYamakawa', 'ForceCoupling'])
@pytest.mark.parametrize('forces', [[], [repulsion(8, 4.0)]], ids=['alone', 'with a repulsion'])
def test_spheres_that_do_not_resist_strain_are_warned_of(model, forces):
    """Forces between the spheres do not hide what is missing, as they would if only the stress of
    the samples counted."""
    with pytest.warns(
            UserWarning, match=f'all bodies are single spheres of model {model}, which do not '
            r'resist the strain of the flow; .* volume fraction of 0.046 and more: use '
            r'setModel\(StokesianDynamics\), or make each body of several blobs'):
        found = analysis.shearViscosity(spheres(model, forces=forces))
    assert found.parts['hydrodynamic'] == 0 and not found.isTrusted
    assert (found.ratio == 1) == (not forces)
    assert 'not trusted: all bodies are single spheres' in str(found)


def test_lubrication_does_not_make_spheres_resist():
    with pytest.warns(UserWarning, match='and their lubrication does not act on strain; the visc'):
        assert analysis.shearViscosity(spheres('RotnePragerYamakawa', 'On')).ratio == 1


def test_spheres_beside_shells_are_warned_of():
    """The model of spheres takes no shells, so that blobs are the only remedy."""
    with pytest.warns(
            UserWarning, match='7 of 8 bodies are single spheres.* volume fraction of '
            '0.04 and more: make each body of several blobs'):
        found = analysis.shearViscosity(spheres('RotnePragerYamakawa', shells=1))
    assert found.parts['hydrodynamic'] > 0 and not found.isTrusted


def test_what_resists_or_is_bonded_is_not_warned_of():
    """Spheres with stresslets, shells of blobs, and beads that springs connect."""
    springs = openmm.HarmonicBondForce()
    for i in range(7):
        springs.addBond(i, i + 1, 1, 1)
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        assert analysis.shearViscosity(spheres('StokesianDynamics')).ratio > 1
        assert analysis.shearViscosity(spheres('ForceCoupling', shells=8)).isTrusted
        found = analysis.shearViscosity(spheres('RotnePragerYamakawa', forces=[springs]))
        assert found.parts['interparticle'] != 0 and found.isTrusted


# ---- Forces on absolute positions ----------------------------------------------------------------


def external(expression, particles=range(4), group=0, **parameters):
    force = openmm.CustomExternalForce(expression)
    for name, value in parameters.items():
        force.addGlobalParameter(name, value)
    for i in particles:
        force.addParticle(i, [])
    force.setForceGroup(group)
    return force


def heldBy(*forces, platform='Reference', setUp=lambda fluid, integrator: None):
    return scene(platform, gas(4, 8.0, nearest=2.2), cubic(8.0), forces=forces, setUp=setUp)[2]


@pytest.mark.parametrize('expression', ['10*x^2', '2*y', '5*periodicdistance(x, y, z, 0, y, z)^2'])
def test_external_forces_are_warned_of(expression):
    """The trap 10 x^2 alone made a viscosity of 1.27 one of 2.56."""
    with pytest.warns(
            UserWarning, match='depend on absolute positions, because a '
            r'CustomExternalForce \(Force 1 of the System\) acts.* the interparticle part '
            'of the viscosity means nothing: take such forces away'):
        found = analysis.shearViscosity(heldBy(external(expression)))
    assert not found.isTrusted and 'absolute positions' in str(found)
    with pytest.warns(UserWarning, match='sampleStresses: the forces on bodies depend'):
        analysis.sampleStresses(heldBy(external(expression)), 2)


def test_external_forces_along_the_vorticity_change_a_normal_stress():
    with pytest.warns(UserWarning, match='part of the second normal stress difference means'):
        analysis.shearViscosity(heldBy(external('10*z^2')))


def test_tethers_by_other_forces_are_warned_of():
    tether = openmm.CustomCompoundBondForce(1, '10*(x1 - 3)^2')
    tether.addBond([2], [])
    with pytest.warns(UserWarning, match='because they add up to .* kJ/.mol nm.; their virial'):
        analysis.shearViscosity(heldBy(tether))


@pytest.mark.parametrize('platform', ['Reference', 'CPU'])
def test_forces_between_bodies_are_not_warned_of(platform):
    """Nor are external forces that are switched off, or not counted, nor the error of PME, nor
    forces of single precision that cancel in a lattice."""
    def leaveOut(_, integrator):
        integrator.setIntegrationForceGroups({0})

    charges = openmm.NonbondedForce()
    charges.setNonbondedMethod(charges.PME)
    charges.setCutoffDistance(3.5)
    for i in range(4):
        charges.addParticle(20*(-1)**i, 1, 0)
    lattice = 4.0*np.array(list(itertools.product((0, 1), repeat=3)))
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        for context in (heldBy(repulsion(4, 3.9),
                               platform=platform), heldBy(charges, platform=platform),
                        heldBy(external('k*x^2', k=0), platform=platform),
                        heldBy(external('x^2', group=3), platform=platform, setUp=leaveOut),
                        heldBy(external('x^2', particles=[]), platform=platform),
                        scene(platform, lattice, cubic(8.0), rate=0.01,
                              forces=[repulsion(8, 3.99, 1e5)])[2]):
            assert analysis.shearViscosity(context).isTrusted


# ---- Springs, errors and samples -----------------------------------------------------------------


def test_springs_have_the_stress_of_dumbbells():
    """Beads far smaller than their distance hardly feel the flow of each other. Hookean dumbbells
    then add n kT lambda to the viscosity, and N1 = 2 n kT lambda^2 g^2 (Bird, Curtiss, Armstrong,
    Hassager, Dynamics of Polymeric Liquids 2, eq. 13.4-18), with lambda = zeta/4k."""
    eta, radius, k, number, edge = 1.0, 0.02, 1.0, 2, 20.0
    kT = BOLTZ*300  # extensions of sqrt(kT/k) = 1.6 nm along each axis
    relaxation = 6*np.pi*eta*radius/(4*k)
    rate, density = 1/relaxation, number/edge**3
    springs = openmm.HarmonicBondForce()
    springs.setUsesPeriodicBoundaryConditions(True)
    for i in range(number):
        springs.addBond(2*i, 2*i + 1, 0, k)
    x = gas(number, edge)
    x = np.stack([x, x + np.random.default_rng(1).normal(0, np.sqrt(kT/k), x.shape)],
                 axis=1).reshape(-1, 3)
    _, integrator, context = scene('Reference', x, cubic(edge), radii=radius, rate=rate,
                                   temperature=300, step=0.06*relaxation,
                                   model='RotnePragerYamakawa', viscosity=eta, forces=[springs])
    found = analysis.shearViscosity(context, 12000, 150, 10, progress=False)
    polymer, error = found.parts['interparticle'], found.partErrors['interparticle']
    exact = density*kT*relaxation/eta
    # The flow of a bead and the step size change the stress by 2 % each.
    assert abs(polymer - exact) < 4.5*error + 0.04*exact
    assert 0.01*exact < error < 0.12*exact
    normal, error = found.firstNormalDifference, found.firstNormalDifferenceError
    exact = 2*density*kT*relaxation**2*rate/eta
    assert abs(normal - exact) < 4.5*error + 0.04*exact
    assert error < 0.2*exact
    print(f'{polymer/density/kT/relaxation:.3f} {normal/exact:.3f} {found}')
    assert found.ratio - 1 == pytest.approx(sum(found.parts.values()), rel=1e-9)
    assert found.samples == 1200


def test_errors_of_samples():
    """Synthetic stresses without correlation: means, and the errors of their number."""
    context = scene('Reference', [(1, 2, 3)], cubic(9), rate=-0.5, viscosity=2, axes=(0, 2))[2]
    random, n = np.random.default_rng(2), 4000
    mean = np.arange(36.).reshape(4, 3, 3)
    found = analysis.shearViscosityFromStresses(context, mean + random.standard_normal(
        (n, 4, 3, 3)))
    low, high = (np.sqrt(stats.chi2.ppf(p, found.degrees)/found.degrees)
                 for p in (FALSE_ALARMS/2, 1 - FALSE_ALARMS/2))
    # Over eta times the rate, which is -1, and its modulus.
    for value, exact, error, spread in ((found.ratio, 1 - mean[:, 0, 2].sum(), found.ratioError,
                                         2), (found.parts['brownian'], -mean[1, 0, 2],
                                              found.partErrors['brownian'], 1),
                                        (found.firstNormalDifference,
                                         (mean[:, 0, 0] - mean[:, 2, 2]).sum(),
                                         found.firstNormalDifferenceError, np.sqrt(8)),
                                        (found.secondNormalDifference,
                                         (mean[:, 2, 2] - mean[:, 1, 1]).sum(),
                                         found.secondNormalDifferenceError, np.sqrt(8))):
        assert abs(value - exact) < quantile(found.degrees)*error
        assert low < error/(spread/np.sqrt(n)) < high
    assert found.viscosity._value == pytest.approx(2*found.ratio)
    assert found.tau == pytest.approx(0.5, abs=0.3)


@pytest.mark.parametrize('scheme', ['FixmanMidpoint', 'TractionEulerMaruyama'])
def test_parts_are_the_whole(scheme):
    x = gas(4, 7, seed=2, nearest=2.2)
    arguments = dict(scheme=scheme, temperature=50, rate=0.1, step=1e-3)
    whole = analysis.shearViscosity(
        scene('Reference', x, cubic(7), **arguments)[2], 31, 4, 3, progress=False)
    _, integrator, context = scene('Reference', x, cubic(7), **arguments)
    integrator.step(4)
    parts = [
        analysis.sampleStresses(context, steps, 3, progress=False)._value for steps in (6, 9, 15)
    ]
    assert analysis.shearViscosityFromStresses(context, np.concatenate(parts), 3) == whole
    assert whole.samples == 10 and whole.partErrors['brownian'] > 0


def test_a_simulation_calls_its_reporters():
    """A Context steps without them."""
    _, integrator, context = scene('Reference', [(1, 2, 3)], cubic(9))
    simulation = openmm.app.Simulation(app.bodyTopology(context.getSystem(), integrator),
                                       context.getSystem(), copy.deepcopy(integrator),
                                       openmm.Platform.getPlatformByName('Reference'))
    simulation.context.setPositions([(1, 2, 3)])
    steps = []

    class Reporter:
        def describeNextReport(self, simulation):
            return 2 - simulation.currentStep % 2, False, False, False, False, None

        def report(self, simulation, state):
            steps.append(simulation.currentStep)

    simulation.reporters.append(Reporter())
    found = analysis.shearViscosity(simulation, 6, 3, 2)
    assert steps == [2, 4, 6, 8] and simulation.currentStep == 9 and found.samples == 3
    samples = analysis.sampleStresses(simulation, 4)
    assert steps[-1] == 12 and len(samples._value) == 4
    assert analysis.shearViscosityFromStresses(simulation, samples).ratio == pytest.approx(
        found.ratio, rel=1e-4)  # the box has tilted on


@pytest.mark.parametrize('rate, temperature, steps, isLong', [(0.1, 0, 99, False),
                                                              (-0.1, 0, 102, True),
                                                              (0.1, 1, 99, False),
                                                              (1e-3, 2e3, 1500, True),])
def test_short_strains_are_not_trusted(rate, temperature, steps, isLong):
    """Ten samples over a strain of 0.05 gave 1.2662 +- 0.0005, although structure had not formed.

    It forms over a strain of 1, or over the time a^2/D, here 6 pi/kT = 1.13 ps in the last case.
    """
    options = dict(rate=rate, temperature=temperature, step=0.1 if temperature < 2 else 1e-3,
                   scheme='TractionEulerMaruyama')
    context = scene('Reference', [(1, 2, 3)], cubic(9), **options)[2]
    found = analysis.shearViscosity(context, steps, 0, steps // 10)
    assert found.strain == pytest.approx(steps*options['step']*abs(rate), rel=0.02)
    doubt = 'not trusted: the samples cover a strain of 0.99'
    assert (doubt in str(found)) == (any('strain of' in each for each in found.doubts)) != isLong
    assert isLong or not found.isTrusted
    assert ('of the largest body' in str(found)) == (temperature > 0 and not isLong)


def test_a_long_run_is_printed_as_trusted():
    context = scene('Reference', [(1, 2, 3)], cubic(9))[2]
    text = str(analysis.shearViscosity(context))
    assert text.startswith('viscosity: 1.0') and text.endswith('samples: 1\ntrusted')


def test_progress_bars(capfd):
    context = scene('Reference', [(1, 2, 3)], cubic(9))[2]
    analysis.shearViscosity(context, 3, 2, progress=True)
    shown = capfd.readouterr().err
    assert 'equilibration' in shown and 'sampling the stress' in shown and '3/3' in shown


def sheared(**options):
    return scene('Reference', [(1, 2, 3), (3.2, 2, 3)], cubic(9), **options)[2]


@pytest.mark.parametrize(
    'make, arguments, error, problem',
    [(lambda: sheared(rate=0), (), ValueError, 'a shear rate other than 0.*call setShear() before'),
     (lambda: 3, (), TypeError, 'must be an openmm.Context'),
     (sheared, (-1,), ValueError, 'steps: got -1; the number of steps must be at least 0'),
     (sheared, (5, 0, 3), ValueError, 'so 1 samples; a mean over time needs at least 2: give more '
      'steps, or 0 for the present poses'),
     (lambda: sheared(temperature=10, scheme='TractionEulerMaruyama'), (9,), ValueError,
      'so 9 samples; a standard error needs at least 10 where there is noise: give more steps'),
     (lambda: sheared(temperature=10),
      (20,), ValueError, 'a stochastic drift, which it omits.*use TractionEulerMaruyama'),])
def test_measurements_that_are_refused(make, arguments, error, problem):
    with pytest.raises(error, match=re.escape(problem).replace(r'\.\*', '.*')):
        analysis.shearViscosity(make(), *arguments)


@pytest.mark.parametrize(
    'stresses, problem',
    [(np.zeros((5, 3, 3)), r'got an array of shape \(5, 3, 3\).*give what sampleStresses\(\)'),
     (np.zeros((0, 4, 3, 3)), r'shape \(0, 4, 3, 3\)'),
     (np.full((3, 4, 3, 3), np.nan), r'stresses: number 0 is not finite; all must be: leave out'),])
def test_stresses_that_are_refused(stresses, problem):
    with pytest.raises(ValueError, match=problem):
        analysis.shearViscosityFromStresses(sheared(), stresses)


def test_the_other_viscosity_names_this_one():
    with pytest.raises(ValueError, match=r'shears the fluid steadily.*use shearViscosity\(\)'):
        analysis.viscosity(sheared())
