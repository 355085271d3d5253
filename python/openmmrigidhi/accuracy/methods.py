"""What is compared: one method is one curve in the picture. A study adds the knob that is turned along the curve."""
from dataclasses import dataclass
from typing import Callable, Optional

import openmm

from ..integrator import CustomRigidHIIntegrator


@dataclass(frozen=True)
class Method:
    """A way to integrate a scene.

    Parameters
    ----------
    name : str
        its name in tables and pictures
    makeIntegrator : callable
        (scene, stepSize in ps, seed) -> openmm.Integrator. A module-level function, so that it can be sent to another process.
    order : int
        weak order of the error in the step size
    whyNot : callable, optional
        scene -> None, or the reason why the method cannot be used there
    description : str
    """

    name: str
    makeIntegrator: Callable
    order: int = 2
    whyNot: Optional[Callable] = None
    description: str = ''


class RigidScheme:
    """Makes the scene's own integrator with one of the plugin's schemes."""

    def __init__(self, scheme):
        self.scheme = scheme

    def __call__(self, scene, stepSize, seed):
        integrator = scene.makeIntegrator()
        integrator.setScheme(self.scheme)
        integrator.setStepSize(stepSize)
        integrator.setRandomNumberSeed(seed)
        return integrator


def _langevinMiddle(scene, stepSize, seed):
    integrator = openmm.LangevinMiddleIntegrator(scene.temperature, scene.friction, stepSize)
    integrator.setRandomNumberSeed(seed)
    return integrator


def _notHeldByConstraints(scene):
    return scene.rigidByConstraints()


#: The methods that are known by name.
BUILT_IN = {method.name: method for method in (
    Method('LangevinA', RigidScheme(CustomRigidHIIntegrator.LangevinA), 2, None, 'Davidchack 2015, eq. 20'),
    Method('LangevinB', RigidScheme(CustomRigidHIIntegrator.LangevinB), 2, None, 'Davidchack 2015, eq. 27'),
    Method('LangevinC', RigidScheme(CustomRigidHIIntegrator.LangevinC), 2, None, 'Davidchack 2015, eq. 28'),
    Method('GradientThermostat', RigidScheme(CustomRigidHIIntegrator.GradientThermostat), 1, None, 'Davidchack 2015, eq. 30'),
    Method('LangevinMiddle', _langevinMiddle, 2, _notHeldByConstraints,
           "OpenMM's LangevinMiddleIntegrator, bodies held by constraints (SETTLE for water), friction gamma"),
)}


def byName(name):
    """The built-in method of this name.

    Parameters
    ----------
    name : str

    Raises
    ------
    ValueError
        for any other name
    """
    try:
        return BUILT_IN[name]
    except KeyError:
        raise ValueError(f'method: got {name!r}; it must be a Method or the name of one of these: {", ".join(BUILT_IN)}') from None
