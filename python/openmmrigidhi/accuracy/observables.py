"""The quantities measured in a run: energies, temperatures, pressure, dipole moment, diffusion.

They may include a user's own function of the Context.
"""
from __future__ import annotations

import copy
import re
from collections import deque
from functools import cached_property
from typing import TYPE_CHECKING, Callable, Optional, Sequence, Union

import numpy as np
import openmm
from openmm import unit

from .. import _units
from .._types import Array, Number, Numbers
from ..integrator import CustomRigidHIIntegrator
from .scenes import GAS_CONSTANT, findObservable, importObject

if TYPE_CHECKING:
    from .scenes import Scene


class Sample:
    """The present moment of a run; everything is computed once, when it is first asked for."""
    def __init__(self, scene: Scene, context: openmm.Context) -> None:
        self.scene = scene
        self.context = context

    @cached_property
    def rigid(self) -> Optional[CustomRigidHIIntegrator]:
        """The CustomRigidHIIntegrator, or None for OpenMM's own integrators."""
        integrator = self.context.getIntegrator()
        try:
            return CustomRigidHIIntegrator.cast(integrator)
        except TypeError:
            return None

    @cached_property
    def energies(self) -> openmm.State:
        """The State with the energies."""
        return self.context.getState(getEnergy=True)

    @cached_property
    def potentialEnergy(self) -> float:
        """The potential energy, kJ/mol."""
        return self.energies.getPotentialEnergy()._value

    @cached_property
    def positions(self) -> Array:
        """Positions of all particles, nm, array of shape (particles, 3), unwrapped."""
        return self.context.getState(getPositions=True).getPositions(asNumpy=True)._value

    @cached_property
    def bodyPositions(self) -> Array:
        """Origins of all bodies, nm, array of shape (bodies, 3), unwrapped.

        With OpenMM's own integrators they are the centres of mass.
        """
        if self.rigid is not None:
            return self.rigid.getBodyPositions()._value
        return _CentresOfMass(self.scene).of(self.positions)

    @cached_property
    def kineticEnergies(self) -> Array:
        """Kinetic energies summed over bodies, kJ/mol.

        They are those of translation, and of rotation about the axis of the smallest, middle and
        largest moment.
        """
        if self.rigid is not None:
            rotation = self.rigid.computeRotationalKineticEnergies()._value
            return np.array([self.rigid.computeTranslationalKineticEnergy()._value, *rotation])
        state = self.context.getState(getPositions=True, getVelocities=True)
        return self.scene.bodyTable().kineticEnergies(
            state.getPositions(asNumpy=True)._value,
            state.getVelocities(asNumpy=True)._value)

    @cached_property
    def degrees(self) -> dict[str, int]:
        """Kinetic degrees of freedom, as CustomRigidHIIntegrator.getDegreesOfFreedom()."""
        if self.rigid is not None:
            return self.rigid.getDegreesOfFreedom()
        return self.scene.bodyTable().degrees


class Observable:
    """A quantity with an average.

    Parameters
    ----------
    name : str
        name in tables, on the command line, in file names
    label : str
        name in pictures
    unit : str
    measure : callable
        Sample -> float; NaN where the observable has no meaning (temperatures of schemes without
        momenta)
    exact : callable, optional
        Scene -> exact canonical average or None; without it the scene's own table gives the average
    setup : callable, optional
        (scene, platform, properties) -> an object for the whole run; the arguments of measure are
        then (sample, object). If it remembers earlier samples, its methods `memory()` -> array and
        `recall(array)` let an ensemble continue from a checkpoint as without an interruption.
    """
    def __init__(self, name: str, label: str, unit: str, measure: Callable,
                 exact: Optional[Callable] = None, setup: Optional[Callable] = None) -> None:
        self.name = name
        self.label = label
        self.unit = unit
        self.measure = measure
        self._exact = exact
        self.setup = setup

    def exact(self, scene: Scene) -> Optional[float]:
        """The exact canonical average, or None where only the limit of small steps is known."""
        if self.name in scene.exact:
            return scene.exact[self.name]
        return self._exact(scene) if self._exact is not None else None

    def ofBodies(self, bodies: Sequence[int]) -> Observable:
        """This observable of some bodies alone, as in a mixture of two kinds.

        Parameters
        ----------
        bodies : sequence of int
            indices of bodies in the scene, in any order

        Returns
        -------
        Observable
            its name is that of this observable with "@" and the bodies behind it: mean_height@0-29

        Raises
        ------
        ValueError
            if bodies is empty, or has a negative index or an index twice, or if this observable is
            no mean over bodies
        """
        where = f'observable {self.name}'
        chosen = sorted(_units.integer(body, where, 'bodies') for body in bodies)
        if not chosen or chosen[0] < 0 or len(set(chosen)) < len(chosen):
            raise ValueError(
                f'{where}: bodies: got {list(bodies)}; it must have indices of bodies, '
                'not negative, each of them once')
        if not hasattr(self.measure, 'of') or '@' in self.name:
            raise ValueError(
                f'{where}: bodies: got {list(bodies)}; only heights, displacements and diffusion '
                'coefficients of all bodies can be had of some of them: leave bodies out, or write '
                'a function of the Context')
        made = copy.copy(self)
        made.measure = self.measure.of(np.array(chosen))
        made.name = f'{self.name}@{_ranges(chosen)}'
        made.label = f'{self.label}, bodies {_ranges(chosen)}'
        return made

    def requireBodies(self, scene: Scene) -> None:
        """Refuse bodies that a scene does not have, before its run begins.

        Parameters
        ----------
        scene : Scene

        Raises
        ------
        ValueError
            if it does not have them
        """
        bodies = getattr(self.measure, 'bodies', None)
        if bodies is not None and bodies[-1] >= len(scene.bodies):
            raise ValueError(
                f'observable {self.name}: bodies: got body {bodies[-1]}; the scene has '
                f'{len(scene.bodies)} bodies, and indices count from 0: take bodies of the scene')

    def __repr__(self):
        return f'Observable({self.name!r})'


def _ranges(bodies):
    """Ascending indices as text: 0-29,40."""
    bodies = np.asarray(bodies)
    runs = np.split(bodies, np.flatnonzero(np.diff(bodies) > 1) + 1)
    return ','.join(f'{run[0]}-{run[-1]}' if len(run) > 1 else f'{run[0]}' for run in runs)


def splitBodies(name: str) -> tuple[str, Optional[list[int]]]:
    """The name of an observable of all bodies, and the bodies behind "@".

    Parameters
    ----------
    name : str

    Returns
    -------
    ofAll : str
    bodies : list of int, or None
        None: all
    """
    ofAll, at, text = name.rpartition('@')
    if not at:
        return name, None
    if not re.fullmatch(r'\d+(-\d+)?(,\d+(-\d+)?)*', text):
        raise ValueError(f'observable: got {name!r}; behind "@" it must have indices of bodies and '
                         'ranges of them, as in @0-29,40')
    ends = [[int(each) for each in part.split('-')] for part in text.split(',')]
    for end in ends:
        if end[0] > end[-1]:
            raise ValueError(
                f'observable: got {name!r}; {end[0]}-{end[-1]} has no bodies: give the '
                'smaller index first')
    return ofAll, [body for end in ends for body in range(end[0], end[-1] + 1)]


class _OfBodies:
    """What has a value for each body, of all bodies or of some."""

    #: Ascending indices; None: all.
    bodies: Optional[Array] = None

    def of(self, bodies):
        """The same of some bodies."""
        made = copy.copy(self)
        made.bodies = bodies
        return made

    def chosen(self, values):
        """The values of these bodies, from one for each body of the scene."""
        if self.bodies is None:
            return values
        values = np.asarray(values)
        if values.ndim < 1 or self.bodies[-1] >= len(values):
            raise ValueError(
                f'observable: bodies: got body {self.bodies[-1]}; there are values for '
                f'{len(values) if values.ndim else 1} bodies, and indices count from 0: take '
                'bodies of the scene')
        return values[self.bodies]


def _temperature(energy, degrees):
    return 2*energy/(GAS_CONSTANT*degrees) if degrees > 0 else float('nan')


class _PotentialEnergy:
    def __call__(self, sample):
        return sample.potentialEnergy/len(sample.scene.bodies)


class _GroupEnergy:
    def __init__(self, group):
        self.group = group

    def __call__(self, sample):
        state = sample.context.getState(getEnergy=True, groups={self.group})
        return state.getPotentialEnergy()._value/len(sample.scene.bodies)


class _TranslationalTemperature:
    def __call__(self, sample):
        removed = sample.degrees['removed']
        if removed:
            removed *= sample.scene.bodyTable().massFraction
        return _temperature(sample.kineticEnergies[0], sample.degrees['translational'] - removed)


class _RotationalTemperature:
    def __init__(self, axis):
        self.axis = axis

    def __call__(self, sample):
        return _temperature(sample.kineticEnergies[self.axis],
                            sample.degrees[f'rotational{self.axis}'])


class _BathTemperature:
    def __call__(self, scene):
        return scene.temperature


class _PressureProbe:
    """A second Context, whose box is stretched, so that the run itself is not touched."""
    def __init__(self, scene, platform, properties):
        if not scene.system.usesPeriodicBoundaryConditions():
            raise ValueError(
                'observable pressure: the System is not periodic; it has no volume: leave this '
                'observable out')
        # Barostats are asked for their energy, too; it is 0 and costs nothing.
        self.context = openmm.Context(scene.system, openmm.VerletIntegrator(0.001), platform,
                                      properties)
        self.molecules = [np.array(molecule) for molecule in self.context.getMolecules()]
        self.masses = np.array(
            [scene.system.getParticleMass(i)._value for i in range(scene.system.getNumParticles())])
        self.index = np.empty(len(self.masses), dtype=int)
        for k, molecule in enumerate(self.molecules):
            self.index[molecule] = k
        # Extra particles without mass count for the centre of a molecule only where nothing else
        # does.
        self.weights = np.where(self.masses > 0, self.masses, 1e-12)
        self.total = np.bincount(self.index, self.weights)


class _Pressure:
    #: Relative change of length in the finite difference. Its own error is of order strain^2,
    #: rounding of order 1/strain.
    strain = 1e-3

    def __call__(self, sample, probe):
        state = sample.context.getState(getPositions=True, getVelocities=True)
        positions = state.getPositions(asNumpy=True)._value
        velocities = state.getVelocities(asNumpy=True)._value
        box = state.getPeriodicBoxVectors(asNumpy=True)._value
        volume = np.linalg.det(box)

        def average(values):
            return np.stack(
                [np.bincount(probe.index, probe.weights*values[:, k])
                 for k in range(3)], axis=1)/probe.total[:, None]

        centres = average(positions)[probe.index]
        energies = []
        for factor in (1 - self.strain, 1 + self.strain):
            probe.context.setPeriodicBoxVectors(*(box*factor))
            probe.context.setPositions(positions + centres*(factor - 1))
            energies.append(probe.context.getState(getEnergy=True).getPotentialEnergy()._value)
        dV = volume*((1 + self.strain)**3 - (1 - self.strain)**3)
        mass = np.bincount(probe.index, probe.masses)
        if sample.rigid is not None and sample.degrees['total'] == 0:
            kinetic = 1.5*len(mass)*GAS_CONSTANT*sample.scene.temperature
        else:
            kinetic = 0.5*(mass*(average(velocities)**2).sum(axis=1)).sum()
        # kJ/(mol nm^3) = 1.66053907 MPa
        return (2*kinetic/(3*volume) - (energies[1] - energies[0])/dV)*1.66053907


#: A body whose charges add up to more than this, e, is charged.
LARGEST_NET_CHARGE = 1e-6


class _Charges:
    """The charges of a scene whose bodies are neutral, and the charged particles in bodies."""
    def __init__(self, scene, platform, properties):
        forces = [
            force for force in scene.system.getForces() if isinstance(force, openmm.NonbondedForce)
        ]
        if len(forces) != 1:
            raise ValueError(
                f'observable dipole_squared: the System has {len(forces)} '
                'NonbondedForces; the charges must be those of a single one: leave this '
                'observable out')
        charges = np.array([
            forces[0].getParticleParameters(i)[0]._value for i in range(forces[0].getNumParticles())
        ])
        inBodies = np.zeros(len(charges), dtype=bool)
        for index, body in enumerate(scene.bodies):
            inBodies[body] = True
            net = charges[body].sum()
            if abs(net) > LARGEST_NET_CHARGE:
                raise ValueError(
                    f'observable dipole_squared: body {index} has a net charge of {net:.6g} e; the '
                    'dipole moment of a charged body depends on the origin, and that of a periodic '
                    'box on where its images are: leave this observable out')
        free = np.flatnonzero((charges != 0) & ~inBodies)
        if len(free):
            raise ValueError(
                f'observable dipole_squared: particle {free[0]} has a charge of '
                f'{charges[free[0]]:.6g} e and is in no body; only neutral bodies '
                'have a dipole moment that does not depend on the origin: leave this observable out'
            )
        self.charges = charges


def dipoleMoment(sample: Sample, charges: _Charges) -> Array:
    """Total dipole moment of the bodies, e nm, array of shape (3,).

    Bodies are whole in a Context's positions, on whichever side of a periodic boundary they are.
    They are also neutral. The sum of charge times position therefore needs no origin and no box.

    Parameters
    ----------
    sample : Sample
    charges : _Charges
        what the observable dipole_squared has prepared
    """
    return charges.charges @ sample.positions


class _DipoleSquared:
    def __call__(self, sample, charges):
        return float((dipoleMoment(sample, charges)**2).sum())/len(sample.scene.bodies)


#: Window of diffusion_coefficient, ps.
WINDOW = 2.0


class _CentresOfMass:
    """The centres of mass of a scene's bodies, from the positions of particles."""
    def __init__(self, scene):
        masses = np.array(
            [scene.system.getParticleMass(i)._value for i in range(scene.system.getNumParticles())])
        self.owners = np.repeat(np.arange(len(scene.bodies)), [len(body) for body in scene.bodies])
        self.members = np.concatenate([np.asarray(body, dtype=int) for body in scene.bodies])
        # Bodies without masses, which schemes without momenta may have, are where the mean of their
        # particles is.
        massless = np.bincount(self.owners, masses[self.members]) == 0
        self.weights = np.where(massless[self.owners], 1.0, masses[self.members])
        self.total = np.bincount(self.owners, self.weights)

    def of(self, positions):
        weighted = self.weights[:, None]*positions[self.members]
        return np.stack([np.bincount(self.owners, weighted[:, k])
                         for k in range(3)], axis=1)/self.total[:, None]


#: Relative change of a time by rounding it to sample intervals. A coefficient comes from the times
#: that samples have, so it may change more than a displacement.
_LARGEST_ROUNDING, _LARGEST_ROUNDING_OF_COEFFICIENT = 1e-3, 0.1


class _Past:
    """Places of all bodies at the last samples."""

    #: The observable that asks, for messages.
    name = 'diffusion_coefficient'
    #: Of a window to sample intervals.
    largestRounding = _LARGEST_ROUNDING_OF_COEFFICIENT

    def __init__(self, scene, platform, properties):
        barostat = next(
            (type(force).__name__
             for force in scene.system.getForces() if 'Barostat' in type(force).__name__), None)
        if barostat is not None:
            raise ValueError(
                f'observable {self.name}: the System has a {barostat}, which moves bodies with '
                f'the box; displacements are those of a '
                'box that stays: leave this observable out, or the barostat')
        self.times = deque()
        self.places = deque()

    def add(self, sample):
        self.times.append(sample.energies.getTime()._value)
        self.places.append(self.placesIn(sample))

    def placesIn(self, sample):
        """Where the bodies are, array of shape (bodies, 3)."""
        return sample.bodyPositions

    def memory(self):
        """What is remembered of earlier samples, as one array: times, and places in rows."""
        return np.column_stack([self.times,
                                np.reshape(self.places,
                                           (len(self.places), -1))]) if self.times else np.zeros(
                                               (0, 1))

    def recall(self, memory):
        """Remember what memory() gave."""
        self.times = deque(memory[:, 0])
        self.places = deque(np.reshape(each, (-1, 3)) for each in memory[:, 1:])

    def squaredDisplacements(self, lag, axes):
        """Of each body, summed over axes."""
        moved = (self.places[-1] - self.places[-1 - lag])[:, list(axes)]
        return (moved**2).sum(axis=1)

    def lagOf(self, window):
        """A time as a number of sample intervals, one at least."""
        interval = self.times[1] - self.times[0]
        lag = max(1, round(window/interval))
        if abs(lag*interval - window) > self.largestRounding*window:
            raise ValueError(
                f'observable {self.name}: its time of {window:g} ps is {window/interval:.3g} '
                f'sample intervals of {interval:g} ps; it must be a whole number of them to '
                f'{self.largestRounding:.4g} of itself: take another time, or another '
                'sampleInterval')
        return lag

    def forgetFirst(self):
        self.times.popleft()
        self.places.popleft()


class _Centres(_Past):
    """Centres of mass of all bodies at the last samples."""
    def __init__(self, scene, platform, properties):
        super().__init__(scene, platform, properties)
        self.centres = _CentresOfMass(scene)

    def placesIn(self, sample):
        return self.centres.of(sample.positions)


class _Origins(_Past):
    name = 'msd'
    largestRounding = _LARGEST_ROUNDING


class _DiffusionCoefficient(_OfBodies):
    """The diffusion coefficient of bodies, with the window w and the sum of msd over n axes:
    (msd(2 w) - msd(w))/(2 n w)."""
    def __init__(self, window, axes=(0, 1, 2)):
        self.window, self.axes = window, axes

    def __call__(self, sample, centres):
        centres.add(sample)
        times = centres.times
        if len(times) < 2:
            return float('nan')
        lag = centres.lagOf(self.window)
        if len(times) < 2*lag + 1:
            return float('nan')
        grown = centres.squaredDisplacements(2*lag, self.axes)
        grown -= centres.squaredDisplacements(lag, self.axes)
        value = self.chosen(grown).mean()
        value /= 2*len(self.axes)*(times[-1] - times[-1 - lag])
        centres.forgetFirst()
        return float(value)


class _Displacement(_OfBodies):
    """The mean square displacement of bodies over a time, summed over some axes."""
    def __init__(self, window, axes):
        self.window, self.axes = window, axes

    def __call__(self, sample, origins):
        origins.add(sample)
        if len(origins.times) < 2 or len(origins.times) < origins.lagOf(self.window) + 1:
            return float('nan')
        squares = origins.squaredDisplacements(origins.lagOf(self.window), self.axes)
        origins.forgetFirst()
        return float(self.chosen(squares).mean())


class _Height(_OfBodies):
    """The heights of bodies' origins, nm."""
    def __call__(self, sample):
        return self.chosen(sample.bodyPositions[:, 2])


class _OfFunction(_OfBodies):
    """The values of a user's function of the Context, one for each body or one in all."""
    def __init__(self, function):
        self.function = function

    def __call__(self, sample):
        return self.chosen(_units.plain(self.function(sample.context)))


class _MeanHeight(_Height):
    def __call__(self, sample):
        return float(super().__call__(sample).mean())


class _Bin:
    """The fraction of values in a bin, which has its lower edge and not its upper one."""
    def __init__(self, values, low, high):
        self.values, self.low, self.high = values, low, high

    @property
    def bodies(self):
        return self.values.bodies

    def of(self, bodies):
        return _Bin(self.values.of(bodies), self.low, self.high)

    def __call__(self, sample):
        values = np.ravel(np.asarray(self.values(sample), dtype=float))
        return float(((values >= self.low) & (values < self.high)).mean())


class _UserFunction:
    def __init__(self, function):
        self.function = function

    def __call__(self, sample):
        return float(_units.plain(self.function(sample.context)))


#: Observables by name.
BUILT_IN = {
    observable.name: observable
    for observable in
    (Observable('potential_energy', 'potential energy per body', 'kJ/mol', _PotentialEnergy()),
     Observable('translational_temperature', 'translational temperature', 'K',
                _TranslationalTemperature(), _BathTemperature()),
     Observable('rotational_temperature_1', 'rotational temperature, axis of the smallest moment',
                'K', _RotationalTemperature(1), _BathTemperature()),
     Observable('rotational_temperature_2', 'rotational temperature, axis of the middle moment',
                'K', _RotationalTemperature(2), _BathTemperature()),
     Observable('rotational_temperature_3', 'rotational temperature, axis of the largest moment',
                'K', _RotationalTemperature(3), _BathTemperature()),
     Observable('pressure', 'pressure', 'MPa', _Pressure(), setup=_PressureProbe),
     Observable('dipole_squared', 'mean square dipole moment of the box per body', 'e^2 nm^2',
                _DipoleSquared(), setup=_Charges),
     Observable('diffusion_coefficient',
                f'diffusion coefficient of bodies (between {WINDOW:g} and {2*WINDOW:g} ps)',
                'nm^2/ps', _DiffusionCoefficient(WINDOW), setup=_Centres),
     Observable('mean_height', "mean height of bodies' origins", 'nm', _MeanHeight()))
}
#: The observables that are measured by default.
DEFAULT = ('potential_energy', 'translational_temperature', 'rotational_temperature_1',
           'rotational_temperature_2', 'rotational_temperature_3')


def diffusionCoefficient(window: Number, lateral: bool = False,
                         bodies: Optional[Sequence[int]] = None) -> Observable:
    r"""The observable diffusion_coefficient over another window.

    The observable follows a body's centre of mass without wrapping it into the box. Its mean square
    displacement over time t is :math:`6 D t` plus a constant, once the memory of its velocity and
    of its neighbours' cage is gone. With a window w therefore :math:`D = (\mathrm{msd}(2 w) -
    \mathrm{msd}(w))/(6 w)`, averaged over bodies and over all moments of the run with a long enough
    past. D belongs to the method's own
    dynamics: friction, inertia scale and masses change it.

    Parameters
    ----------
    window : float or Quantity
        ps; a whole number of sample intervals to 10 %; for water 2 ps
    lateral : bool
        from motion along x and y alone, as for bodies above a wall, with 4 w in place of 6 w
    bodies : sequence of int, optional
        of these bodies alone, as by :meth:`Observable.ofBodies`

    Returns
    -------
    Observable
        named diffusion_coefficient_WINDOW or lateral_diffusion_coefficient_WINDOW, in nm^2/ps
    """
    where = 'diffusionCoefficient'
    window = _units.number(window, _units.TIME, where, 'window')
    lateral = _units.boolean(lateral, where, 'lateral')
    if not 0 < window < np.inf:
        raise ValueError(f'{where}: window: got {window:g} ps; a window must be positive')
    made = Observable(
        f'{"lateral_" if lateral else ""}diffusion_coefficient_{window:.12g}',
        f'diffusion coefficient of bodies{" along x and y" if lateral else ""} '
        f'(between {window:g} and {2*window:g} ps)', 'nm^2/ps',
        _DiffusionCoefficient(window, (0, 1) if lateral else (0, 1, 2)), setup=_Centres)
    return made if bodies is None else made.ofBodies(bodies)


def meanSquareDisplacement(window: Number, lateral: bool = False,
                           bodies: Optional[Sequence[int]] = None) -> Observable:
    """The mean square displacement of bodies over a time.

    The observable follows the origins of bodies without wrapping them into the box. The mean runs
    over bodies, and over all moments of the run with a long enough past.

    Parameters
    ----------
    window : float or Quantity
        ps; a whole number of sample intervals to 0.1 %
    lateral : bool
        only along x and y, as for bodies above a wall
    bodies : sequence of int, optional
        of these bodies alone, as by :meth:`Observable.ofBodies`

    Returns
    -------
    Observable
        named msd_WINDOW or lateral_msd_WINDOW, in nm^2; its sum is over three axes, or two
    """
    where = 'meanSquareDisplacement'
    window = _units.number(window, _units.TIME, where, 'window')
    lateral = _units.boolean(lateral, where, 'lateral')
    if not 0 < window < np.inf:
        raise ValueError(f'{where}: window: got {window} ps; the time of a displacement must be '
                         'finite and positive')
    made = Observable(
        f'{"lateral_" if lateral else ""}msd_{window:.12g}',
        f'mean square displacement of bodies in {window:g} ps{" along x and y" if lateral else ""}',
        'nm^2', _Displacement(window, (0, 1) if lateral else (0, 1, 2)), setup=_Origins)
    return made if bodies is None else made.ofBodies(bodies)


def bins(of: Union[str, Callable], edges: Numbers,
         bodies: Optional[Sequence[int]] = None) -> list[Observable]:
    """The observables of a histogram: for each bin the fraction of bodies in it.

    Parameters
    ----------
    of : str or callable
        "height", of the bodies' origins, nm; or a function of the Context that returns a number for
        each body, or the "module:function" of one
    edges : array-like or Quantity of shape (bins + 1,), or sequence of lengths
        ascending edges, in nm or the function's unit; a bin includes its lower edge and not its
        upper edge
    bodies : sequence of int, optional
        fractions of these bodies alone, as by :meth:`Observable.ofBodies`

    Returns
    -------
    list of Observable
        named height[LOW,HIGH] or module:function[LOW,HIGH];
        :meth:`openmmrigidhi.ensemble.EnsembleResult.histogram` puts their averages together
    """
    where = 'bins'
    if not unit.is_quantity(edges):
        edges = list(edges)
    hasUnits = unit.is_quantity(edges) or any(map(unit.is_quantity, edges))
    edges = _units.sequence(edges, _units.LENGTH if hasUnits else _units.NONE, where, 'edges')
    if len(edges) < 2 or np.any(~(np.diff(edges) > 0)):
        raise ValueError(f'{where}: edges: got {edges.tolist()}; a histogram needs two edges at '
                         'least, in ascending order: sort them')
    name = of if isinstance(of, str) else f'{of.__module__}:{of.__qualname__}'
    made = [
        byName(f'{name}[{low:.12g},{high:.12g}]' if isinstance(of, str) else _bin(
            name, _OfFunction(of), getattr(of, 'unit', ''), float(low), float(high)))
        for low, high in zip(edges[:-1], edges[1:])
    ]
    return made if bodies is None else [each.ofBodies(bodies) for each in made]


def _bin(name, values, unitOfValues, low, high):
    between = f'{low:g} and {high:g} {unitOfValues}'.rstrip()
    return Observable(f'{name}[{low:.12g},{high:.12g}]',
                      f'fraction of bodies with {name} between {between}', '',
                      _Bin(values, low, high))


_BIN = re.compile(r'(.+)\[([^,\[\]]+),([^,\[\]]+)\]')
_WITH_WINDOW = {
    'diffusion_coefficient_': diffusionCoefficient,
    'lateral_diffusion_coefficient_': lambda window: diffusionCoefficient(window, lateral=True),
    'msd_': meanSquareDisplacement,
    'lateral_msd_': lambda window: meanSquareDisplacement(window, lateral=True)
}


def _parametrised(name):
    """An observable whose name has numbers in it, or None."""
    try:
        for prefix, make in _WITH_WINDOW.items():
            if name.startswith(prefix):
                observable = make(_units.from_text(name[len(prefix):], _units.TIMES, 'ps'))
                observable.name = name  # with the unit in which the user asks for it
                return observable
        found = _BIN.fullmatch(name)
        if found and found[1] == 'height':
            low, high = (_units.from_text(each, _units.LENGTHS, 'nm')
                         for each in found.groups()[1:])
            if not low < high:
                return None
            observable = _bin('height', _Height(), 'nm', low, high)
            observable.name = name
            return observable
        if found and ':' in found[1] and float(found[2]) < float(found[3]):
            function = importObject(found[1], 'observable')
            return _bin(found[1], _OfFunction(function), getattr(function, 'unit', ''),
                        float(found[2]), float(found[3]))
    except KeyError:  # no unit
        return None
    except ValueError as error:
        if 'could not convert' not in str(error):
            raise
    return None


def byName(name: Union[str, Observable, Callable]) -> Observable:
    """An observable by its name on the command line.

    Parameters
    ----------
    name : str or Observable or callable
        a built-in name; "energy_group_N" for the energy of force group N per body;
        "module:function", or a function of the Context that returns a number (with optional
        attributes ``unit`` and ``exact``). dipole_squared is <M^2>/N of the box's total dipole
        moment M, e^2 nm^2, for N neutral bodies. diffusion_coefficient is the observable of
        :func:`diffusionCoefficient` over 2 ps. Times and heights in names are in ps and nm, or have
        a unit: msd_5ns, lateral_msd_0.2s, height[1um,2um]. Heights, displacements and diffusion
        coefficients of some bodies alone have these bodies behind "@": msd_5ns@0-29,40.

    Returns
    -------
    Observable
    """
    if isinstance(name, str) and '@' in name:
        ofAll, bodies = splitBodies(name)
        made = byName(ofAll).ofBodies(bodies)
        made.name = name
        return made
    found = _parametrised(name) if isinstance(name, str) else None
    if found is None:
        found = findObservable(name, Observable, BUILT_IN, _from_function)
    if found is not None:
        return found
    if name.startswith('energy_group_') and name[13:].isdigit() and int(name[13:]) < 32:
        return Observable(name, f'energy of force group {name[13:]} per body', 'kJ/mol',
                          _GroupEnergy(int(name[13:])))
    raise ValueError(
        f'observable: got {name!r}; it must be one of {", ".join(BUILT_IN)}, energy_group_0 to '
        'energy_group_31, msd_TIME, lateral_msd_TIME, diffusion_coefficient_TIME, '
        'lateral_diffusion_coefficient_TIME, height[LOW,HIGH], or module:function; times are in ps '
        f'or with one of {", ".join(_units.TIMES)} behind them, heights in nm or with one of '
        f'{", ".join(_units.LENGTHS)}')


def _from_function(function):
    exact = getattr(function, 'exact', None)
    return Observable(function.__name__, function.__name__, getattr(function, 'unit', ''),
                      _UserFunction(function), None if exact is None else _Constant(exact))


class _Constant:
    def __init__(self, value):
        self.value = value

    def __call__(self, scene):
        return self.value
