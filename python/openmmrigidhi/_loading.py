"""Loads the plugin's libraries, which lie beside this file, and explains what is wrong if that fails."""
import os

import openmm

_DIRECTORY = os.path.dirname(os.path.abspath(__file__))
_PLUGIN_DIRECTORY = os.path.join(_DIRECTORY, 'lib', 'plugins')
_KERNEL = 'IntegrateRigidBodies'
#: Serves every platform that is there when it is loaded, or loaded again.
_FOR_ANY_PLATFORM = 'libOpenMMRigidHIAny.so'

version = None


def load():
    """Load the binding module, then every platform library; ImportError names library, place and cause."""
    global version
    version = _load_bindings().version
    for path in _plugin_libraries():
        try:
            openmm.Platform.loadPluginLibrary(path)
        except Exception as error:
            raise ImportError(f'openmmrigidhi: cannot load the platform library {os.path.basename(path)} '
                              f'from {_PLUGIN_DIRECTORY}: {error}') from error


def _load_bindings():
    try:
        from . import _bindings
    except ImportError as error:
        raise ImportError(f'openmmrigidhi: cannot load its binding module _openmmrigidhi.so from {_DIRECTORY} '
                          f'(with lib/libOpenMMRigidHI.so): {error}. Built for another Python or OpenMM, or not built '
                          'at all? Build it with "make build" and put build/python on PYTHONPATH.') from error
    return _bindings


def _plugin_libraries():
    names = sorted(os.listdir(_PLUGIN_DIRECTORY)) if os.path.isdir(_PLUGIN_DIRECTORY) else []
    paths = [os.path.join(_PLUGIN_DIRECTORY, name) for name in names if name.endswith('.so')]
    if not paths:
        raise ImportError(f'openmmrigidhi: there is no platform library (libOpenMMRigidHI*.so) in {_PLUGIN_DIRECTORY}: '
                          'the package is incomplete, build or install it anew with "make build" or "make install"')
    return paths


def checkPlatform(platform):
    """Check that a platform can run this plugin's integrator, and say why if it cannot.

    A platform that was loaded after this package gets our kernels now.

    OpenMM's own message when a Context is created on a platform without our kernels ("Specified a Platform for a Context
    which does not support all required kernels") gives no cause.

    Parameters
    ----------
    platform : str or openmm.Platform
        the platform or its name, for example 'CPU'

    Raises
    ------
    openmm.OpenMMException
        if OpenMM has no such platform, or the platform lacks our kernels
    """
    name = platform if isinstance(platform, str) else platform.getName()
    late = os.path.join(_PLUGIN_DIRECTORY, _FOR_ANY_PLATFORM)
    if os.path.exists(late):
        openmm.Platform.loadPluginLibrary(late)
    present = [openmm.Platform.getPlatform(i) for i in range(openmm.Platform.getNumPlatforms())]
    names = [p.getName() for p in present]
    able = [p.getName() for p in present if p.supportsKernels([_KERNEL])]
    if name in able:
        return
    failures = '; '.join(openmm.Platform.getPluginLoadFailures()) or 'none'
    background = (f"Platforms in OpenMM: {', '.join(names)}; with the kernels of openmmrigidhi: "
                  f"{', '.join(able) or 'none'}. OPENMM_PLUGIN_DIR: {os.environ.get('OPENMM_PLUGIN_DIR', 'not set')}; "
                  f"plugins that failed to load: {failures}. Libraries of openmmrigidhi: {_PLUGIN_DIRECTORY}.")
    if name not in names:
        raise openmm.OpenMMException(f"openmmrigidhi: platform '{name}': OpenMM has none of this name; it must be one "
                                     f'that is loaded: load its plugin first. {background}')
    raise openmm.OpenMMException(f"openmmrigidhi: platform '{name}': it has no kernels of this plugin; its "
                                 f"library must be loaded: use one of {', '.join(able) or 'none'}, or install the package anew. {background}")
