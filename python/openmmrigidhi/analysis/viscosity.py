"""Effective viscosity of a suspension driven by a force density."""
from __future__ import annotations

import dataclasses
import warnings
from typing import TYPE_CHECKING, Optional, Union

import numpy as np
from openmm import unit

from .. import _units
from .._types import Numbers
from .._systems import forces_of
from ..integrator import CustomRigidHIIntegrator
from ..mobility import MobilityForce
from ._doubts import without_resistance
from ._moves import positive
from ._sampling import (advance, at_least, block_average, check_finite, lengths, lines_of_doubts,
                        sampled, too_few_blocks)
from .series import FEWEST_TRUSTED_BLOCKS

if TYPE_CHECKING:
    import openmm
    import openmm.app

#: The flow must have an amplitude of at least this many standard errors above 0 to measure a
#: viscosity.
LEAST_SIGNIFICANCE = 3
#: The volume fraction above which spheres of StokesianDynamics have too small a viscosity in a
#: wave: 1.5 % at 0.1, 7 % at 0.2, 40 % at 0.45.
MOST_WITHOUT_LUBRICATION = 0.1


@dataclasses.dataclass
class EffectiveViscosity:
    r"""An effective viscosity, and the flow that was measured for it.

    Errors are standard errors.

    Attributes
    ----------
    viscosity, viscosityError : Quantity
        :math:`f_0/(k^2 A)` of a wave, :math:`f H^2/(12 A)` in a channel, :math:`f H^2/(3 A)` in a
        film, with the amplitude A; dalton/(nm ps)
    ratio, ratioError : float
        ratio to the viscosity of the fluid alone
    amplitude, amplitudeError : Quantity
        mean amplitude A of :math:`\sin(k x)` in the velocity along the force, with the coordinate x
        along waveAxis; positive along it, nm/ps. With a uniform force density it is the mean
        velocity of the fluid along the force.
    cosine, cosineError : Quantity
        mean amplitude of the cosine, or the mean velocity along the walls and across the force,
        nm/ps; it tends to 0 as the average includes more positions of the bodies
    shearRate, shearRateError : Quantity
        largest shear rate of the mean flow, 1/ps: :math:`k A` of a wave, and for Poiseuille's flow
        the shear rate at a wall, :math:`6 A/H` in a channel and :math:`3 A/H` in a film
    degrees : int
        degrees of freedom of the errors: number of blocks minus 1; 0 for a single value without
        noise
    tau : float
        integrated autocorrelation time of the amplitude that corresponds to the error, in samples;
        about 0.5 for independent samples
    samples : int
        number of samples
    doubts : tuple of str
        reasons not to trust the viscosity or its error
    """

    viscosity: unit.Quantity
    viscosityError: unit.Quantity
    ratio: float
    ratioError: float
    amplitude: unit.Quantity
    amplitudeError: unit.Quantity
    cosine: unit.Quantity
    cosineError: unit.Quantity
    shearRate: unit.Quantity
    shearRateError: unit.Quantity
    degrees: int
    tau: float
    samples: int
    doubts: tuple = ()

    @property
    def isTrusted(self) -> bool:
        """Whether nothing speaks against the viscosity and its error; doubts has the reasons."""
        return not self.doubts

    def __str__(self) -> str:
        lines = [
            f'viscosity: {self.ratio:.5g} +- {self.ratioError:.2g} times that of the fluid, '
            f'{self.viscosity._value:.5g} +- {self.viscosityError._value:.2g} dalton/(nm ps)',
            f'amplitude: {self.amplitude._value:.5g} +- {self.amplitudeError._value:.2g} nm/ps, '
            f'cosine: {self.cosine._value:.5g} +- {self.cosineError._value:.2g} nm/ps',
            f'shear rate: {self.shearRate._value:.5g} +- {self.shearRateError._value:.2g} /ps, '
            f'samples: {self.samples}'
        ]
        return '\n'.join(lines + lines_of_doubts(self.doubts))


def viscosity(context: Union[openmm.Context,
                             openmm.app.Simulation], steps: int = 0, equilibration: int = 0,
              interval: int = 1, progress: Optional[bool] = None) -> EffectiveViscosity:
    r"""Get the effective viscosity of the suspension in a Context.

    A force density :math:`f_0 \sin(k x)`, with the coordinate x along waveAxis, drives a fluid of
    viscosity :math:`\eta` to the velocity :math:`f_0/(\eta k^2) \sin(k x)`. In a suspension the
    mean amplitude A of this wave is smaller. The effective viscosity at this wavelength and shear
    rate is :math:`f_0/(k^2 A)` (Westwood 2022, eq. 65). The flow of each sampled step contains the
    bodies' forces and the random field, so its mean has the Brownian stress.

    A uniform force density f drives Poiseuille's flow. Between the walls of a NoSlipChannel its
    mean velocity is :math:`f H^2/(12 \eta)` with the height H. Times H, this is the flux Q per
    length across the flow. In a suspension the apparent viscosity is :math:`f H^3/(12 Q)`. In a
    Film it is :math:`f H^3/(3 Q)`. Particles keep away from walls, so the apparent viscosity
    depends on H.

    Parameters
    ----------
    context : openmm.Context or openmm.app.Simulation
        with a CustomRigidHIIntegrator, positions, and a MobilityForce with
        :meth:`MobilityForce.setSinusoidalForceDensity` or
        :meth:`MobilityForce.setBodyForceDensity`, whose settings are those of the Context; the call
        advances it by equilibration + steps steps. Only a Simulation calls its reporters during
        these steps; its Context has none.
    steps : int
        number of measured steps. 0, at temperature 0: one measurement of the flow at the present
        poses, without error.
    equilibration : int
        number of earlier steps without measurement
    interval : int
        steps from one sample to the next. A sample costs about a step. The effect of noise on the
        amplitude is new at each step. Therefore 1 (default) is at worst half as efficient as the
        best interval. A larger interval pays where configurations cause most of the error.
    progress : bool, optional
        show a progress bar; None: on a terminal only

    Returns
    -------
    EffectiveViscosity

    Raises
    ------
    TypeError, ValueError
        for arguments that are no such Context or numbers; without a force density, or with a second
        one or a moving wall in addition; with fewer than 10 samples; if the amplitude is not 3
        standard errors above 0; at temperatures above 0 with LangevinHI, or with EulerMaruyama
        where the drift that it omits is not 0, since the mean flow of these schemes does not have
        the Brownian stress
    openmm.OpenMMException
        as :meth:`MobilityForce.getFlowModeInContext` and
        :meth:`MobilityForce.getMeanFlowInContext`

    Notes
    -----
    Errors come from averages over 20 blocks or fewer
    (:func:`openmmrigidhi.analysis.series.seriesStatistics`). A run must therefore be long compared
    with 20 times the time in which configurations change. The relative error of the viscosity
    equals the relative error of the amplitude.

    Without bodies the random field of a fluid on a grid gives the amplitude of a step the variance
    :math:`4 kT/(\eta k^2 V h)`, with the step h and the volume V. The amplitude of the random field
    itself is known (:meth:`MobilityForce.getRandomFlowModeInContext`). The function subtracts the
    multiple of this amplitude that minimises the variance. This removes nearly all of the variance
    in dilute suspensions, and in dense suspensions a part of 1/ratio. Dense matrices have no such
    field. The remaining variance does not depend on :math:`f_0`, so weaker driving needs longer
    runs, as :math:`1/f_0^2`. Bodies feel the curvature of the wave by :math:`(k a)^2`, where a is
    their size.

    Under StokesianDynamics lubrication does not act on the strain of a wave. Above a volume
    fraction of 0.1 a UserWarning says so. In the uniform shear of :meth:`MobilityForce.setShear` it
    does act; use :func:`shearViscosity` there.

    Another UserWarning tells of single spheres of models without stresslets, unless bonds connect
    them: without forces they leave the flow as it is. Both warnings are among the doubts of the
    result.
    """
    where = 'viscosity'
    context, step, integrator, drive = _driven_scene(context, where)
    random = integrator.getTemperature()._value > 0
    steps, equilibration, interval = lengths(steps, equilibration, interval, random, where)
    if equilibration:
        _check_scheme(context, integrator, where)
        advance(step, equilibration, 'equilibration', progress)
    if steps == 0:
        amplitudes = drive.read(context)[None]
    else:
        _check_scheme(context, integrator, where)
        amplitudes = _sampled(context, step, drive, steps, interval, progress)
    return _estimate(context, amplitudes, where)


def sampleFlowAmplitudes(context: Union[openmm.Context, openmm.app.Simulation], steps: int,
                         interval: int = 1, progress: Optional[bool] = None) -> unit.Quantity:
    """Step a Context or a Simulation, and sample the flow that its force density drives.

    :func:`viscosity` averages these amplitudes. Use this function for runs in several parts, or if
    you also sample other quantities. :func:`viscosityFromAmplitudes` computes a viscosity from all
    parts together.

    Parameters
    ----------
    context, steps, interval, progress
        as in :func:`viscosity`; at least one interval

    Returns
    -------
    Quantity of shape (steps // interval, 4)
        amplitudes on sin and on cos, and the same for the random field alone, nm/ps. With a uniform
        force density they are mean velocities along x and y.

    Raises
    ------
    TypeError, ValueError, openmm.OpenMMException
        as :func:`viscosity`
    """
    where = 'sampleFlowAmplitudes'
    context, step, integrator, drive = _driven_scene(context, where)
    interval = positive(interval, where, 'interval')
    steps = at_least(interval, steps, where, 'steps')
    _check_scheme(context, integrator, where)
    return _units.VELOCITY.attach(_sampled(context, step, drive, steps, interval, progress))


def viscosityFromAmplitudes(context: Union[openmm.Context, openmm.app.Simulation],
                            amplitudes: Numbers) -> EffectiveViscosity:
    """Get the effective viscosity from sampled amplitudes.

    Parameters
    ----------
    context : openmm.Context or openmm.app.Simulation
        that of the samples, or one with the same bodies, box and force density
    amplitudes : array-like or Quantity of shape (n, 4)
        results of :func:`sampleFlowAmplitudes`, equally spaced, of one state, nm/ps; at least 10. A
        single row counts as free of noise.

    Returns
    -------
    EffectiveViscosity

    Raises
    ------
    TypeError, ValueError
        as :func:`viscosity`
    """
    where = 'viscosityFromAmplitudes'
    rows = _units.rows(amplitudes, _units.VELOCITY, 4, where, 'amplitudes')
    if len(rows) != 1 and len(rows) < FEWEST_TRUSTED_BLOCKS:
        raise ValueError(f'{where}: amplitudes: got {len(rows)}; an error needs at least '
                         f'{FEWEST_TRUSTED_BLOCKS} samples, and 1 is taken to be without '
                         'noise: sample more')
    check_finite(rows, where, 'amplitudes')
    return _estimate(context, rows, where)


class _Wave:
    """A sinusoidal force density, and the flow that it drives.

    Attributes
    ----------
    f : float
        force density, kJ/(mol nm^4); the flow without bodies has the amplitude
        f/(viscosity curvature)
    curvature : float
        1/nm^2
    rate : float
        largest shear rate over the amplitude, 1/nm
    """
    def __init__(self, fluid, box):
        f0, *self.wave = fluid.getSinusoidalForceDensity()
        _, axis, index = self.wave
        self.fluid, self.f, self.rate = fluid, f0._value, 2*np.pi*index/box[axis, axis]
        self.curvature = self.rate*self.rate
        height, boundary = _height(fluid), fluid.getBoundary()
        if boundary == MobilityForce.NoSlipChannel:
            self.curvature /= 1 - np.tanh(self.rate*height/2)/(self.rate*height/2)
        elif boundary == MobilityForce.Film:
            self.curvature /= 1 - np.tanh(self.rate*height)/(self.rate*height)

    def read(self, context):
        """Amplitudes on sin and on cos, and of the random field alone, nm/ps."""
        return np.concatenate([
            self.fluid.getFlowModeInContext(context, *self.wave)._value,
            self.fluid.getRandomFlowModeInContext(context, *self.wave)._value
        ])

    def along(self, amplitudes):
        """The rows of read() with amplitudes that are positive along the force."""
        return np.sign(self.f)*amplitudes


class _Poiseuille:
    """A uniform force density along walls, and its mean flow; attributes as of _Wave."""
    def __init__(self, fluid):
        force, height = fluid.getBodyForceDensity()._value, _height(fluid)
        inFilm = fluid.getBoundary() == MobilityForce.Film
        self.fluid, self.f = fluid, float(np.linalg.norm(force))
        self.curvature, self.rate = (3 if inFilm else 12)/height**2, (3 if inFilm else 6)/height
        self.direction = force[:2]/self.f

    def read(self, context):
        """Mean velocities along x and y, and of the random field alone, nm/ps."""
        return np.concatenate([
            self.fluid.getMeanFlowInContext(context)._value[:2],
            self.fluid.getRandomMeanFlowInContext(context)._value[:2]
        ])

    def along(self, amplitudes):
        """The rows of read(), along the force and across it."""
        x, y = self.direction
        turn = np.array([[x, -y], [y, x]])
        return np.concatenate([amplitudes[:, :2] @ turn, amplitudes[:, 2:] @ turn], axis=1)


def _height(fluid):
    low, high = (wall._value for wall in fluid.getChannelWalls())
    return high - low


def _driven_scene(context, where):
    """The Context, what steps it, the integrator, and what drives the fluid."""
    context, step = _units.context_or_simulation(context, where)
    integrator = CustomRigidHIIntegrator.cast(context.getIntegrator())
    fluids = forces_of(context.getSystem(), MobilityForce)
    fluid = fluids[0] if fluids else MobilityForce()
    isWave, isUniform = (fluid.getSinusoidalForceDensity()[0]._value != 0,
                         fluid.getBodyForceDensity()._value.any())
    if not isWave and not isUniform and fluid.getShear()[0]._value != 0:
        raise ValueError(
            f'{where}: context: its MobilityForce shears the fluid steadily, and has no force '
            'density; this function measures the flow that a force density drives: use '
            'shearViscosity()')
    if not isWave and not isUniform and fluid.getWallVelocity()._value.any():
        raise ValueError(
            f'{where}: context: a wall drives the fluid of its MobilityForce, and no force density '
            'does; the stress on a wall is not known, and this function measures the flow that a '
            'force density drives: call setWallVelocity() with zeros, and setBodyForceDensity() '
            'along the walls')
    if not isWave and not isUniform:
        raise ValueError(
            f'{where}: context: its System has no MobilityForce with a sinusoidal force density '
            f'other than 0; the viscosity is measured by the '
            'flow that one drives: call setSinusoidalForceDensity() before the Context is created, '
            'or setBodyForceDensity() between walls')
    if isWave and isUniform or fluid.getWallVelocity()._value.any():
        raise ValueError(
            f'{where}: context: its MobilityForce drives the fluid in more than one way; the '
            'viscosity is measured by one force density: take away others, and moving walls, by '
            'their setters with zeros')
    box = context.getState().getPeriodicBoxVectors(asNumpy=True)._value
    drive = _Wave(fluid, box) if isWave else _Poiseuille(fluid)
    return context, step or integrator.step, integrator, drive


def _check_scheme(context, integrator, where):
    """Refuse schemes whose mean flow has no Brownian stress."""
    if not integrator.getTemperature()._value > 0:
        return
    scheme = integrator.getScheme()
    if scheme == CustomRigidHIIntegrator.LangevinHI:
        raise ValueError(
            f'{where}: context: its scheme is LangevinHI, whose flow is that of the friction '
            f'forces, at a temperature above 0; the mean must have '
            'the Brownian stress: use a scheme without momenta, such as DriftCorrectorFD')
    if 'omits it' in integrator.getEffects()['stochastic drift']:
        raise ValueError(
            f'{where}: context: its scheme is EulerMaruyama at a temperature above 0, with bodies '
            'that have a stochastic drift, which it omits; its mean flow then lacks Brownian '
            'stress: use DriftCorrectorFD, or another scheme that makes the drift')


def _sampled(context, step, drive, steps, interval, progress):
    """Amplitudes (n, 4) after each interval, nm/ps."""
    return sampled(step, lambda: drive.read(context), (4,), steps, interval, 'sampling the flow',
                   progress)


def _without_field(samples, field):
    """Samples less a multiple of the random field's own amplitude, of mean 0.

    The multiple is the one that leaves the least variance.
    """
    deviation = field - field.mean()
    variance = deviation @ deviation
    return samples - (samples @ deviation)/variance*field if variance > 0 else samples


def _without_lubrication(context, fluid):
    """The sentence about StokesianDynamics, whose lubrication does not act in a wave, or None."""
    if (fluid.getModel() != MobilityForce.StokesianDynamics
            or fluid.getLubrication() == MobilityForce.Off):
        return None
    radii = np.array([fluid.getParticleRadius(i)._value for i in range(fluid.getNumParticles())])
    volume = context.getState().getPeriodicBoxVolume()._value
    fraction = float(4/3*np.pi*(radii**3).sum()/volume)
    if fraction <= MOST_WITHOUT_LUBRICATION:
        return None
    return ('in a wave the lubrication of StokesianDynamics does not act on the strain '
            f'of the flow, and the volume fraction of spheres is {fraction:.2g}; above '
            f'{MOST_WITHOUT_LUBRICATION} the viscosity is too small, at 0.45 by 40 %: '
            'use setShear() and shearViscosity()')


def _estimate(context, amplitudes, where):
    """The EffectiveViscosity of amplitudes (n, 4), nm/ps."""
    context, _, integrator, drive = _driven_scene(context, where)
    doubts = [
        _without_lubrication(context, drive.fluid),
        without_resistance(context, integrator, drive.fluid)
    ]
    for doubt in filter(None, doubts):
        warnings.warn(f'{where}: {doubt}', stacklevel=3)
    eta, amplitudes = drive.fluid.getViscosity()._value, drive.along(amplitudes)
    if len(amplitudes) == 1:
        columns = [amplitudes[:, 0], amplitudes[:, 1]]
    else:
        columns = [
            _without_field(amplitudes[:, column], amplitudes[:, 2 + column]) for column in (0, 1)
        ]
    (mean, error, degrees, tau), (cosine, cosineError, *_) = map(block_average, columns)
    if not mean > LEAST_SIGNIFICANCE*error:
        raise ValueError(
            f'{where}: the amplitude of the flow is {mean:.3g} +- {error:.2g} nm/ps; it must be '
            f'more than {LEAST_SIGNIFICANCE} standard errors above '
            '0: run longer, or drive by a larger f0')
    doubts.append(too_few_blocks(degrees, len(amplitudes)))
    value = abs(drive.f)/(drive.curvature*mean)
    return EffectiveViscosity(_units.VISCOSITY.attach(value),
                              _units.VISCOSITY.attach(value*error/mean), value/eta,
                              value/eta*error/mean, _units.VELOCITY.attach(mean),
                              _units.VELOCITY.attach(error), _units.VELOCITY.attach(cosine),
                              _units.VELOCITY.attach(cosineError),
                              _units.RATE.attach(float(drive.rate*mean)),
                              _units.RATE.attach(float(drive.rate*error)), degrees, tau,
                              len(amplitudes), tuple(filter(None, doubts)))
