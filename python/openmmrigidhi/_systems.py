"""What a System says about this package's Forces."""
import numpy as np

from . import _units
from .mobility import MobilityForce


def forcesOf(system, kind):
    """The System's forces of one of our classes."""
    found = []
    for force in system.getForces():
        try:
            found.append(kind.cast(force))
        except TypeError:
            pass
    return found


def hydrodynamicRadii(system, radii, where):
    """Radius of each particle of the System, nm: those given, or else the MobilityForce's, or else 0."""
    count = system.getNumParticles()
    if radii is not None:
        return np.array(_units.perSite(radii, _units.LENGTH, count, where, 'radii'))
    fluids = forcesOf(system, MobilityForce)
    return np.array([fluids[0].getParticleRadius(i)._value for i in range(count)]) if fluids else np.zeros(count)
