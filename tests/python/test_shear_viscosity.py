"""Viscosity and normal stresses in steady shear, by parts: exact values of spheres at rest, springs
that have the stress of Rouse's dumbbells, errors, and what is refused."""
import re
import warnings

import numpy as np
import openmm
import pytest
from scipy import stats
from test_shear import BOLTZ, cubic, data, gas, scene

from openmmrigidhi import analysis

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


def test_spheres_that_do_not_resist_strain_are_warned_of():
    """Spheres with stresslets, shells of blobs, and springs between beads are no such case."""
    def measured(model, lubrication='Auto', **options):
        fluid, _, context = scene('CPU', gas(4, 8.0, nearest=2.2), cubic(8.0), model=model,
                                  setUp=lambda fluid, _: fluid.setLubrication(lubrication),
                                  **options)
        return analysis.shearViscosity(context)

    with pytest.warns(
            UserWarning, match='no body resists the strain.*RotnePragerYamakawa.*use '
            r'setModel\(StokesianDynamics\)'):
        assert measured('RotnePragerYamakawa').ratio == 1
    spring = openmm.HarmonicBondForce()
    spring.addBond(0, 1, 1, 1)
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        assert measured('StokesianDynamics').ratio > 1
        assert measured('RotnePragerYamakawa', forces=[spring]).parts['interparticle'] != 0
    with pytest.warns(UserWarning, match='no body resists the strain'):
        measured('RotnePragerYamakawa', 'On')


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
    assert analysis.shearViscosityFromStresses(context, np.concatenate(parts)) == whole
    assert whole.samples == 10 and whole.partErrors['brownian'] > 0


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
