"""What is compared: one method is one curve in the picture. A study adds the knob that is turned along the curve."""
from dataclasses import dataclass
from typing import Callable, Optional

import openmm

from .. import _schemes
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
    """Makes the scene's own integrator with one of the plugin's schemes, and with another inertia scale than the scene's if one is given."""

    def __init__(self, scheme, inertiaScale=None):
        self.scheme = scheme
        self.inertiaScale = inertiaScale

    def __call__(self, scene, stepSize, seed):
        integrator = scene.makeIntegrator()
        integrator.setScheme(self.scheme)
        if self.inertiaScale is not None:
            integrator.setInertiaScale(self.inertiaScale)
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


#: Between a scheme with momenta and an inertia scale: LangevinC-I8 is LangevinC with moments times 8.
SCALED = '-I'


def byName(name):
    """The built-in method of this name; or a scheme with an inertia scale, such as LangevinC-I8: setInertiaScale(8).

    Parameters
    ----------
    name : str

    Raises
    ------
    ValueError
        for any other name
    """
    found = BUILT_IN.get(name) or _scaled(name)
    if found is None:
        raise ValueError(f'method: got {name!r}; it must be a Method or the name of one of these: {", ".join(BUILT_IN)}; or a scheme with momenta '
                         f'and an inertia scale above 0, such as LangevinC{SCALED}8')
    return found


def _scaled(name):
    base, mark, text = str(name).rpartition(SCALED)
    try:
        factor = float(text)
    except ValueError:
        return None
    method = BUILT_IN.get(base)
    scheme = getattr(method and method.makeIntegrator, 'scheme', None)
    if scheme is None or not _schemes.TABLE[scheme].hasMomenta or not 0 < factor < float('inf'):
        return None
    return Method(name, RigidScheme(scheme, factor), method.order, method.whyNot, f'{method.description}; moments times {factor:g}')
