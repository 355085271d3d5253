"""Rigid bodies with quaternion state in OpenMM.

A simulation of rigid water begins with::

    import openmm, openmmrigidhi
    integrator = openmmrigidhi.CustomRigidHIIntegrator(300*unit.kelvin, 4*unit.femtosecond)
    openmmrigidhi.app.addRigidWater(integrator, topology)
    simulation = openmm.app.Simulation(topology, system, integrator,
                                       openmm.Platform.getPlatformByName('CPU'))

Importing this package loads the plugin's libraries into OpenMM, from its own directory lib/plugins.
You need no environment variable. If a library does not load, the import raises ImportError; its
message names the library, its place and the cause.
"""
import importlib
import importlib.util

from . import _loading

_loading.load()

from .integrator import CustomRigidHIIntegrator  # noqa: E402  (needs the libraries)
from .mobility import MobilityForce  # noqa: E402
from .bodyforce import CustomBodyForce  # noqa: E402
from .bodymotion import CustomBodyMotion  # noqa: E402
from ._loading import checkPlatform  # noqa: E402
from ._description import describe  # noqa: E402

__version__ = _loading.version
__all__ = [
    'CustomRigidHIIntegrator', 'MobilityForce', 'CustomBodyForce', 'CustomBodyMotion',
    'checkPlatform', 'describe', 'app', 'analysis', 'accuracy', 'ensemble'
]

_SUBMODULES = ('app', 'analysis', 'accuracy', 'ensemble')


def __getattr__(name):
    """Submodules are attributes, imported at their first use.

    They need more packages than the integrator does.
    """
    if name in _SUBMODULES and importlib.util.find_spec('.' + name, __name__) is not None:
        return importlib.import_module('.' + name, __name__)
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'")


def __dir__():
    return sorted(list(globals()) + list(_SUBMODULES))
