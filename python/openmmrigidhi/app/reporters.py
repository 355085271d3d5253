"""A StateDataReporter that counts the degrees of freedom of rigid bodies."""
from __future__ import annotations

import functools
import os
import warnings
from typing import IO, Any, Union

import openmm.app

from .. import _units
from .._systems import BodyDefinitions
from ..integrator import CustomRigidHIIntegrator
from .trajectories import rowsBefore

_NOT_AVAILABLE = 'n/a'


class StateDataReporter(openmm.app.StateDataReporter):
    r"""openmm.app.StateDataReporter for a CustomRigidHIIntegrator, with the right temperatures.

    OpenMM's own reporter counts three degrees of freedom for each massive particle, minus one for
    each constraint. Temperatures of rigid bodies without constraints are then far too low. This
    reporter takes the degrees of freedom from ``integrator.getDegreesOfFreedom()``. It writes
    ``n/a`` for schemes without momenta, and for kinds of motion that the System lacks.

    Parameters
    ----------
    file, reportInterval, ... :
        as for openmm.app.StateDataReporter; ``temperature`` is the temperature of bodies and free
        particles together. With ``append`` and ``step``, lines at or after the step of the first
        new line are dropped from the file, so that a resumed run leaves the lines of the
        uninterrupted run. A file that does not exist is created.
    translationalTemperature : bool
        whether to write the temperature of the bodies' translation
    rotationalTemperatures : bool
        whether to write the temperatures of rotation about the axis of the smallest, the middle and
        the largest principal moment, in three columns. At equilibrium all temperatures fluctuate
        about the temperature of the heat bath. The relative standard deviation of a single report
        is :math:`\sqrt{2/n}` with n degrees of freedom.
    """
    def __init__(self, file: Union[str, IO[str]], reportInterval: int, *args: Any,
                 translationalTemperature: bool = False, rotationalTemperatures: bool = False,
                 **kwargs: Any) -> None:
        isPath = isinstance(file, (str, os.PathLike))
        if isPath and kwargs.get('append'):
            kwargs['append'] = os.path.exists(file) and os.path.getsize(file) > 0
        super().__init__(os.fspath(file) if isPath else file, reportInterval, *args, **kwargs)
        self._file = os.fspath(file) if isPath and self._append else None
        self._firstStep = None
        self._columns = {}
        if self._temperature:
            self._columns['Temperature (K)'] = self._system_temperature
        if translationalTemperature:
            self._columns['Translational Temperature (K)'] = self._translational_temperature
        if rotationalTemperatures:
            for axis in range(3):
                self._columns[f'Rotational Temperature {axis+1} (K)'] = functools.partial(
                    self._rotational_temperature, axis)
        # The base class must not compute its own temperature, which divides by its own number of
        # degrees of freedom.
        self._temperature = False

    def describeNextReport(self, simulation: openmm.app.Simulation) -> tuple:
        """Tell the Simulation when the next report is due, and what the report needs."""
        if self._firstStep is None:
            self._firstStep = simulation.currentStep
        return super().describeNextReport(simulation)

    def _initializeConstants(self, simulation):
        if self._file is not None and self._step:
            self._drop_lines_from(simulation.currentStep)
        elif self._append:
            warnings.warn(
                'StateDataReporter: append: lines from after the loaded State stay in the file, '
                'and the run writes them again; give step=True and the name of the file, so that '
                'they can be found', stacklevel=2)
        super()._initializeConstants(simulation)
        integrator = CustomRigidHIIntegrator.cast(simulation.context.getIntegrator())
        self._massFraction = _mass_fraction_of_bodies(integrator, simulation.system)

    def _drop_lines_from(self, step):
        """Cut the file before its first line at or after a step, or a line without an end."""
        with open(self._file, 'rb') as file:
            lines = file.read().splitlines(keepends=True)
        ends, steps, size = [], [], 0
        for line in lines:
            if line.endswith(b'\n'):
                words = line.decode(errors='replace').split(self._separator)
                number = words[min(bool(self._progress), len(words) - 1)].strip()
                if number.isdigit():
                    steps.append(int(number))
                    ends.append(size)
                size += len(line)
        first = step if self._firstStep is None else self._firstStep
        kept = rowsBefore(steps, step, first, f'StateDataReporter: {self._file}')
        os.truncate(self._file, ends[kept] if kept < len(steps) else size)

    def _place(self):
        """The number of columns before the temperatures."""
        return sum(
            map(bool, (self._progress, self._step, self._time, self._potentialEnergy,
                       self._kineticEnergy, self._totalEnergy)))

    def _constructHeaders(self):
        headers = super()._constructHeaders()
        place = self._place()
        return headers[:place] + list(self._columns) + headers[place:]

    def _constructReportValues(self, simulation, state):
        values = super()._constructReportValues(simulation, state)
        integrator = CustomRigidHIIntegrator.cast(simulation.context.getIntegrator())
        degrees = integrator.getDegreesOfFreedom()
        place = self._place()
        return values[:place] + [column(integrator, degrees)
                                 for column in self._columns.values()] + values[place:]

    def _system_temperature(self, integrator, degrees):
        return integrator.computeSystemTemperature(
        )._value if degrees['total'] > 0 else _NOT_AVAILABLE

    def _translational_temperature(self, integrator, degrees):
        # With total momentum 0, <p^2/m> = 3 kT (1 - m/M) for each body, M the mass of everything
        # that moves.
        removed = degrees['removed']*self._massFraction
        return _temperature(integrator.computeTranslationalKineticEnergy()._value,
                            degrees['translational'] - removed)

    def _rotational_temperature(self, axis, integrator, degrees):
        energies = integrator.computeRotationalKineticEnergies()._value
        return _temperature(energies[axis], degrees[f'rotational{axis+1}'])


def _temperature(energy, degrees):
    """2 E/(k_B n) in K for an energy in kJ/mol, or n/a for no degrees of freedom."""
    return 2*energy/(_units.GAS_CONSTANT*degrees) if degrees > 0 else _NOT_AVAILABLE


def _mass_fraction_of_bodies(integrator, system):
    """The bodies' share of the mass of everything that moves."""
    bodies = BodyDefinitions(integrator)
    members = set(bodies.members.tolist())
    massOfBodies = sum(bodies.masses.tolist())
    massOfFree = sum(
        system.getParticleMass(i)._value for i in range(system.getNumParticles())
        if i not in members)
    return massOfBodies/(massOfBodies + massOfFree) if massOfBodies > 0 else 0
