"""Correlations of orientations, and rotational diffusion coefficients at long times."""
import warnings

import numpy as np
import pytest
from openmm import unit

from openmmrigidhi import analysis
from openmmrigidhi._quaternions import product

#: About axes normal to z and about z in the body, 1/ps.
D, SPIN = 0.02, 0.3


def turning(bodies=40, frames=300, interval=0.5, seed=1, D=D, spin=SPIN):
    """Orientations of bodies that turn freely, by ten turns a frame."""
    random = np.random.default_rng(seed)
    q = np.zeros((frames, bodies, 4))
    present = random.normal(size=(bodies, 4))
    present /= np.linalg.norm(present, axis=1, keepdims=True)
    sigma = np.sqrt(2*interval/10*np.array([D, D, spin]))
    for frame in range(frames):
        q[frame] = present
        for _ in range(10):
            angle = sigma*random.normal(size=(bodies, 3))
            size = np.linalg.norm(angle, axis=1, keepdims=True)
            turn = np.concatenate([np.cos(size/2), np.sin(size/2)/size*angle], axis=1)
            present = product(present, turn)
            present /= np.linalg.norm(present, axis=1, keepdims=True)
    return q


def correlation(q, order=1, interval=0.5, **options):
    options = {'numBlocks': 1, 'independentBodies': True, **options}
    return analysis.orientationCorrelation(q, interval, (0, 0, 2), order=order, **options)


@pytest.mark.parametrize('order', [1, 2])
def test_free_bodies_forget_their_axis_exponentially(order):
    q = turning(400)
    found = correlation(q, order, lags=[0, 2, 5, 10, 20])
    assert np.allclose(found.mean[0], 1) and found.order == order
    exact = np.exp(-order*(order + 1)*D*found.lagTimes._value)
    assert np.all(np.abs(found.mean - exact)[1:] < 4.5*found.error[1:])
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        fitted = analysis.rotationalDiffusion(found)
    assert fitted.isTrusted and fitted.degrees == 399
    value, error = fitted.value*unit.picosecond, fitted.error*unit.picosecond
    assert abs(value - D) < 4.5*error and error < 0.05*D
    # The exact decay gives the coefficient.
    ideal = analysis.OrientationCorrelation(found.lagTimes, exact, 0*exact, np.tile(exact, (12, 1)),
                                            order)
    assert analysis.rotationalDiffusion(ideal).value._value == pytest.approx(D, rel=1e-12)
    # The other axes turn with D and SPIN.
    across = analysis.orientationCorrelation(q, 0.5, (1, 0, 0), [1, 2], 1, True)
    assert analysis.rotationalDiffusion(across).value._value == pytest.approx((D + SPIN)/2, rel=0.1)


def test_errors_are_those_of_many_runs_and_no_run_is_doubted():
    values, errors = [], []
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        for seed in range(60):
            found = analysis.rotationalDiffusion(correlation(turning(20, 100, seed=seed)))
            assert found.isTrusted
            values.append(found.value._value)
            errors.append(found.error._value)
    # The scatter of 60 values is known to 9 % (one standard error).
    assert np.std(values, ddof=1)/np.sqrt(np.mean(np.square(errors))) == pytest.approx(1, abs=0.3)
    assert abs(np.mean(values) - D) < 4.5*np.std(values)/60**0.5


def test_a_decay_that_is_no_exponential_is_doubted():
    # Every other body hardly turns.
    mixed = np.concatenate([turning(100, D=0.1), turning(100, D=1e-4, seed=2)], axis=1)
    with pytest.warns(UserWarning, match='no single exponential'):
        found = analysis.rotationalDiffusion(correlation(mixed), maxTime=40)
    assert not found.isTrusted and 'give a longer minTime' in found.doubts[0]
    blocks = correlation(turning(40, 800), numBlocks=4, independentBodies=False)
    assert '4 blocks' in analysis.rotationalDiffusion(blocks).doubts[0]


def test_displacements_near_their_limit_have_no_slope():
    q = turning(200, D=D, spin=D)
    lags = [1, 2, 60, 70, 80, 90, 100]
    msd = analysis.rotationalMSD(q, 0.5, lags, 1, independentBodies=True)
    assert msd.limit == 1/6 and msd.isotropic.limit == pytest.approx(1/6)
    for each in (msd, msd.isotropic, msd.lateral):
        with pytest.warns(UserWarning, match=r'% of the 0\.167 .* take rotationalDiffusion\(\)'):
            found = analysis.longTimeDiffusion(each, 30)
        assert len(found.doubts) == 1
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        slow = turning(200, 20, D=0.1*D, spin=0.1*D)
        early = analysis.rotationalMSD(slow, 0.5, [1, 2], 1, independentBodies=True)
        assert analysis.longTimeDiffusion(early, 0.5).isTrusted
        # Angles in a plane, and places, grow without bound.
        flat = np.zeros((300, 20, 4))
        angles = np.cumsum(np.random.default_rng(3).normal(0, 0.2, (300, 20)), axis=0)
        flat[..., 0], flat[..., 3] = np.cos(angles/2), np.sin(angles/2)
        planar = analysis.planarAngleMSD(flat, 0.5, (1, 0, 0), [50, 60, 70], 1, True)
        assert planar.limit is None and analysis.longTimeDiffusion(planar, 20).isTrusted


def test_bad_input():
    q = turning(4, 50)
    with pytest.raises(ValueError, match='bodyVector: got .* length must be finite and positive'):
        analysis.orientationCorrelation(q, 1, (0, 0, 0))
    with pytest.raises(ValueError, match='order: got 3; the order of the Legendre polynomial'):
        correlation(q, 3)
    with pytest.raises(ValueError, match='orientations must be unit quaternions'):
        correlation(2*q)
    with pytest.raises(TypeError, match='correlation: got ndarray; it must be an Orientation'):
        analysis.rotationalDiffusion(q)
    found = correlation(turning(10, 400), lags=[1, 2, 3, 150, 160])
    with pytest.raises(ValueError, match='minTime, maxTime: got 0.9 and 1.2 ps; a slope needs two'):
        analysis.rotationalDiffusion(found, 0.9, 1.2)
    with pytest.raises(ValueError, match='maxTime: the correlation at .* three times its error'):
        analysis.rotationalDiffusion(found, 0, 100)
