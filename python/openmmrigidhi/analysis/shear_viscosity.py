"""Viscosity and normal stresses of a suspension in steady shear."""
from __future__ import annotations

import dataclasses
import warnings
from typing import TYPE_CHECKING, Optional, Union

import numpy as np
from openmm import unit

from .. import _units
from .._types import Numbers
from .._systems import BodyDefinitions, forces_of
from ..integrator import CustomRigidHIIntegrator
from ..mobility import MobilityForce
from ._doubts import forces_on_positions, without_resistance
from ._moves import positive
from ._sampling import (advance, at_least, block_average, check_finite, lengths, lines_of_doubts,
                        sampled, too_few_blocks)

if TYPE_CHECKING:
    import openmm
    import openmm.app

#: The parts of the stress, in the order of samples.
PARTS = ('hydrodynamic', 'brownian', 'interparticle', 'ideal')
#: Structure forms over a strain of about 1, or over the time a^2/D in which a body diffuses over
#: its radius, whichever is shorter: validation/sheared leaves out two of these. Shorter runs
#: measure the poses at their start.
LEAST_STRAIN = LEAST_DIFFUSION_TIMES = 1.0


@dataclasses.dataclass
class ShearViscosity:
    r"""The viscosity of a suspension in steady shear, by parts, and its normal stresses.

    With the fluid's viscosity :math:`\eta`, the shear rate g and the stress s of bodies, the parts
    of the ratio are :math:`s_{fg}/(\eta g)` of each part of the stress; here f is the axis of the
    flow and g the axis of the gradient. Errors are standard errors.

    Attributes
    ----------
    viscosity, viscosityError : Quantity
        :math:`\eta + s_{fg}/g`, dalton/(nm ps)
    ratio, ratioError : float
        ratio to the viscosity of the fluid alone
    parts, partErrors : dict of float
        contributions of 'hydrodynamic', 'brownian' and 'interparticle' stresses to the ratio
    firstNormalDifference, firstNormalDifferenceError : float
        :math:`N_1/(\eta |g|)` with :math:`N_1 = s_{ff} - s_{gg}`
    secondNormalDifference, secondNormalDifferenceError : float
        :math:`N_2/(\eta |g|)` with :math:`N_2 = s_{gg} - s_{vv}`, where v is the third axis
    shearRate : Quantity
        g, 1/ps
    degrees : int
        degrees of freedom of the error of the ratio: number of blocks minus 1; 0 for a single
        sample
    tau : float
        integrated autocorrelation time of :math:`s_{fg}` that corresponds to the error, in samples
    samples : int
        number of samples
    strain : float
        strain of the fluid over all samples
    doubts : tuple of str
        reasons not to trust the viscosity or its error
    """

    viscosity: unit.Quantity
    viscosityError: unit.Quantity
    ratio: float
    ratioError: float
    parts: dict
    partErrors: dict
    firstNormalDifference: float
    firstNormalDifferenceError: float
    secondNormalDifference: float
    secondNormalDifferenceError: float
    shearRate: unit.Quantity
    degrees: int
    tau: float
    samples: int
    strain: float
    doubts: tuple = ()

    @property
    def isTrusted(self) -> bool:
        """Whether nothing speaks against the viscosity and its error; doubts has the reasons."""
        return not self.doubts

    def __str__(self) -> str:
        lines = [
            f'viscosity: {self.ratio:.5g} +- {self.ratioError:.2g} times that of the fluid, '
            f'{self.viscosity._value:.5g} +- {self.viscosityError._value:.2g} dalton/(nm ps)'
        ]
        lines += [
            f'  {name} part: {value:.5g} +- {self.partErrors[name]:.2g}'
            for name, value in self.parts.items()
        ]
        lines += [
            f'N1/(eta rate): {self.firstNormalDifference:.5g} +- '
            f'{self.firstNormalDifferenceError:.2g}',
            f'N2/(eta rate): {self.secondNormalDifference:.5g} +- '
            f'{self.secondNormalDifferenceError:.2g}',
            f'shear rate: {self.shearRate._value:.5g}/ps, strain: {self.strain:.3g}, samples: '
            f'{self.samples}'
        ]
        return '\n'.join(lines + lines_of_doubts(self.doubts))


def shearViscosity(context: Union[openmm.Context,
                                  openmm.app.Simulation], steps: int = 0, equilibration: int = 0,
                   interval: int = 1, progress: Optional[bool] = None) -> ShearViscosity:
    r"""Get the viscosity of a suspension that :meth:`MobilityForce.setShear` shears steadily.

    The mean velocity gradient of the box is the shear rate g, so the viscosity is
    :math:`\eta + s_{fg}/g` with the stress s that bodies add
    (:meth:`MobilityForce.getStressInContext`). The normal stress differences come from the same
    samples. :func:`viscosity` measures at a wavelength instead, by the flow that a force density
    drives.

    Parameters
    ----------
    context : openmm.Context or openmm.app.Simulation
        with a CustomRigidHIIntegrator, positions, and a MobilityForce with
        :meth:`MobilityForce.setShear`, whose settings are those of the Context; the call advances
        it by equilibration + steps steps. Only a Simulation calls its reporters during these steps;
        its Context has none.
    steps : int
        number of measured steps. 0, at temperature 0: the stress at the present poses, once,
        without error.
    equilibration : int
        number of earlier steps without measurement; let them strain the suspension by a few units,
        since structure forms with the strain
    interval : int
        steps from one sample to the next. A sample costs two mobility problems, and two more to a
        smaller tolerance at temperatures above 0; see
        :meth:`MobilityForce.getStressInContext`. Strains of 0.01 between samples lose next to
        nothing.
    progress : bool, optional
        show a progress bar; None: on a terminal only

    Returns
    -------
    ShearViscosity

    Raises
    ------
    TypeError, ValueError
        for arguments that are no such Context or numbers; without a shear; with fewer than 10
        samples at temperatures above 0, or 2 at 0; at temperatures above 0 with EulerMaruyama
        where the drift that it omits is not 0, since it samples other configurations
    openmm.OpenMMException
        as :meth:`MobilityForce.getStressInContext`

    Notes
    -----
    Errors come from averages over 20 blocks or fewer
    (:func:`openmmrigidhi.analysis.series.seriesStatistics`). In each step the Brownian part is a
    sample of mean :math:`kT\,\mathrm{div}(R N)`. Its spread does not depend on g, so slow shear
    needs long runs, as :math:`1/g^2`.

    A UserWarning tells of single spheres of models without stresslets, unless bonds connect them,
    since the viscosity lacks their hydrodynamic part. Another tells of forces that depend on
    absolute positions, such as traps, since their virial is no stress. Both are among the doubts of
    the result, and so is a run over less than a strain of 1 and less than the time :math:`a^2/D` in
    which the largest body diffuses over its radius a.
    """
    where = 'shearViscosity'
    context, step, integrator, _ = _sheared_scene(context, where)
    random = integrator.getTemperature()._value > 0
    steps, equilibration, interval = lengths(steps, equilibration, interval, random, where)
    _check_scheme(integrator, where)
    if equilibration:
        advance(step, equilibration, 'equilibration', progress)
    if steps == 0:
        samples = _stresses(context)[None]
    else:
        samples = _sampled(context, step, steps, interval, progress)
    doubt = _warn_of_positions(context, where)
    return _estimate(context, samples, interval if steps else 0, where, doubt)


def sampleStresses(context: Union[openmm.Context, openmm.app.Simulation], steps: int,
                   interval: int = 1, progress: Optional[bool] = None) -> unit.Quantity:
    """Step a Context or a Simulation, and sample the stress of its bodies by parts.

    :func:`shearViscosity` averages these samples. Use this function for runs in several parts, or
    if you also sample other quantities. :func:`shearViscosityFromStresses` computes a viscosity
    from all parts together.

    Parameters
    ----------
    context, steps, interval, progress
        as in :func:`shearViscosity`; at least one interval

    Returns
    -------
    Quantity of shape (steps // interval, 4, 3, 3)
        hydrodynamic, Brownian, interparticle and ideal stress after each interval, kJ/(mol nm^3)

    Raises
    ------
    TypeError, ValueError, openmm.OpenMMException
        as :func:`shearViscosity`
    """
    where = 'sampleStresses'
    context, step, integrator, _ = _sheared_scene(context, where)
    interval = positive(interval, where, 'interval')
    steps = at_least(interval, steps, where, 'steps')
    _check_scheme(integrator, where)
    samples = _sampled(context, step, steps, interval, progress)
    _warn_of_positions(context, where)
    return _units.STRESS.attach(samples)


def shearViscosityFromStresses(context: Union[openmm.Context, openmm.app.Simulation],
                               stresses: Numbers, interval: int = 1) -> ShearViscosity:
    """Get viscosity and normal stresses from sampled stresses.

    Parameters
    ----------
    context : openmm.Context or openmm.app.Simulation
        that of the samples, or one with the same bodies, shear and viscosity
    stresses : array-like or Quantity of shape (n, 4, 3, 3)
        results of :func:`sampleStresses`, equally spaced, of one state, kJ/(mol nm^3); at least 2.
        A single one counts as free of noise.
    interval : int
        steps from one sample to the next, as in :func:`sampleStresses`; it determines the strain

    Returns
    -------
    ShearViscosity

    Raises
    ------
    TypeError, ValueError
        as :func:`shearViscosity`
    """
    where = 'shearViscosityFromStresses'
    context, *_ = _sheared_scene(context, where)
    interval = positive(interval, where, 'interval')
    samples = np.asarray(
        _units.STRESS.strip(stresses, where, 'stresses') if unit.is_quantity(stresses) else stresses
    )
    if samples.dtype.kind not in 'fiu' or samples.shape[1:] != (4, 3, 3) or len(samples) == 0:
        raise ValueError(f'{where}: stresses: got an array of shape {samples.shape} of '
                         f'{samples.dtype}; it must have the shape (n, 4, 3, 3) and hold numbers: '
                         'give what sampleStresses() returns')
    check_finite(samples, where, 'stresses')
    return _estimate(context, samples.astype(float), interval, where)


def _sheared_scene(context, where):
    """The Context, what steps it, the integrator, and the MobilityForce with the shear."""
    context, step = _units.context_or_simulation(context, where)
    integrator = CustomRigidHIIntegrator.cast(context.getIntegrator())
    fluids = forces_of(context.getSystem(), MobilityForce)
    if not fluids or fluids[0].getShear()[0]._value == 0:
        raise ValueError(
            f'{where}: context: its System has no MobilityForce with a shear rate other than 0; '
            'the stress is measured in steady shear: call setShear() before the Context is '
            'created, or use viscosity() with a force density')
    return context, step or integrator.step, integrator, fluids[0]


def _check_scheme(integrator, where):
    """Refuse schemes that sample other configurations than those of the temperature."""
    if 'omits it' in integrator.getEffects()['stochastic drift']:
        raise ValueError(
            f'{where}: context: its scheme is EulerMaruyama at a temperature above 0, with bodies '
            'that have a stochastic drift, which it omits; configurations are then not those of '
            'the temperature: use TractionEulerMaruyama, or another scheme that makes the drift')


def _stresses(context):
    """The stress by parts (4, 3, 3), kJ/(mol nm^3)."""
    fluid = forces_of(context.getSystem(), MobilityForce)[0]
    return np.array([part._value for part in fluid._stress(context)])


def _sampled(context, step, steps, interval, progress):
    return sampled(step, lambda: _stresses(context), (len(PARTS), 3, 3), steps, interval,
                   'sampling the stress', progress)


def _warn_of_positions(context, where):
    """Warn the caller of a public function of forces on absolute positions; return the doubt."""
    _, _, integrator, fluid = _sheared_scene(context, where)
    doubt = forces_on_positions(context, integrator, fluid)
    if doubt is not None:
        warnings.warn(f'{where}: {doubt}', stacklevel=3)
    return doubt


def _short_run(integrator, fluid, time):
    """The sentence about a run in which structure hardly forms, or None."""
    strain = time*abs(fluid.getShear()[0]._value)
    kT = _units.GAS_CONSTANT*integrator.getTemperature()._value
    bodies = BodyDefinitions(integrator)
    radii = np.array([fluid.getParticleRadius(i)._value for i in range(fluid.getNumParticles())])
    members = np.linalg.norm(bodies.places, axis=1) + radii[bodies.members]
    radius = max([radii.max(), *members[radii[bodies.members] > 0]])
    diffusion = kT/(6*np.pi*fluid.getViscosity()._value*radius)*time/radius**2
    if strain >= LEAST_STRAIN or diffusion >= LEAST_DIFFUSION_TIMES:
        return None
    alone = f', and {diffusion:.2g} times the time a^2/D of the largest body' if kT > 0 else ''
    return (f'the samples cover a strain of {strain:.2g}{alone}; structure forms over about 1 of '
            'either, so that shorter runs measure the poses at their start: run longer')


def _estimate(context, samples, interval, where, doubt=None):
    """The ShearViscosity of stresses (n, 4, 3, 3), kJ/(mol nm^3), every so many steps."""
    _, _, integrator, fluid = _sheared_scene(context, where)
    eta, (rate, flow, gradient) = fluid.getViscosity()._value, fluid.getShear()
    rate, vorticity = rate._value, 3 - flow - gradient
    time = len(samples)*interval*integrator.getStepSize()._value
    resistance = without_resistance(context, integrator, fluid)
    if resistance is not None:
        warnings.warn(f'{where}: {resistance}', stacklevel=3)

    shear = samples[:, :, flow, gradient]/(eta*rate)
    total = samples.sum(axis=1)/(eta*abs(rate))
    ratio, error, degrees, tau = block_average(shear.sum(axis=1))
    parts = {name: block_average(shear[:, k]) for k, name in enumerate(PARTS) if name != 'ideal'}
    first = block_average(total[:, flow, flow] - total[:, gradient, gradient])
    second = block_average(total[:, gradient, gradient] - total[:, vorticity, vorticity])
    doubts = (too_few_blocks(degrees, len(samples)),
              _short_run(integrator, fluid, time) if len(samples) > 1 else None, resistance, doubt)
    return ShearViscosity(_units.VISCOSITY.attach(eta*(1 + ratio)),
                          _units.VISCOSITY.attach(eta*error), 1 + ratio, error,
                          {name: each[0]
                           for name, each in parts.items()},
                          {name: each[1]
                           for name, each in parts.items()}, first[0], first[1], second[0],
                          second[1], _units.RATE.attach(rate), degrees, tau, len(samples),
                          time*abs(rate), tuple(each for each in doubts if each is not None))
