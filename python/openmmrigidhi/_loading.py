"""Loads the plugin's libraries, which lie beside this file, and explains failures."""
from __future__ import annotations

import os
import warnings
from typing import Union

import openmm

_DIRECTORY = os.path.dirname(os.path.abspath(__file__))
_PLUGIN_DIRECTORY = os.path.join(_DIRECTORY, 'lib', 'plugins')
_KERNEL = 'IntegrateRigidBodies'
#: The library that serves every platform that is there when it is loaded, or loaded again.
_FOR_ANY_PLATFORM = 'libOpenMMRigidHIAny.so'

#: Libraries that must load on every machine; the others belong to devices.
_EVERYWHERE = {_FOR_ANY_PLATFORM, 'libOpenMMRigidHICPU.so', 'libOpenMMRigidHIReference.so'}

version = None
#: Platforms of devices, whose libraries move bodies there.
_DEVICES = ('OpenCL', 'CUDA', 'HIP')
#: Libraries of devices that could not be loaded, with the reason.
device_failures: list[str] = []
#: Platforms that were there when this plugin's library for them was loaded.
_platforms_at_load: set[str] = set()


def load():
    """Load the binding module, then every platform library.

    An ImportError names library, place and cause.
    """
    global version
    bindings = _load_bindings()
    version = bindings.version
    _check_versions(bindings)
    _platforms_at_load.update(_platform_names())
    for path in _plugin_libraries():
        try:
            openmm.Platform.loadPluginLibrary(path)
        except Exception as error:
            if os.path.basename(path) not in _EVERYWHERE:
                # A GPU's software, or OpenMM's platform for it, is not on this machine. Where the
                # platform is there, the host moves bodies.
                device_failures.append(f'{os.path.basename(path)}: {error}')
                continue
            raise ImportError(
                f'openmmrigidhi: cannot load the platform library {os.path.basename(path)} '
                f'from {_PLUGIN_DIRECTORY}: {error}') from error


def _load_bindings():
    try:
        from . import _bindings
    except ImportError as error:
        raise ImportError(
            f'openmmrigidhi: cannot load its binding module _openmmrigidhi.so from {_DIRECTORY} '
            f'(with lib/libOpenMMRigidHI.so): {error}. The module may be built for '
            'another Python or OpenMM, or not at all: build it with "make build" and put '
            'build/python on PYTHONPATH.') from error
    return _bindings


def _check_versions(bindings):
    """ImportError if the versions of OpenMM, libOpenMMRigidHI.so and the bindings do not match."""
    conflict = bindings.versionConflictOfBindings()
    if conflict:
        raise ImportError(conflict)
    # If the library of the other OpenMM is installed, too, the bindings load it, and find no
    # conflict with it.
    series = '.'.join(openmm.Platform.getOpenMMVersion().split('.')[:2])
    if series != bindings.openmmVersionOfBuild:
        raise ImportError(
            f'openmmrigidhi: its libraries were compiled for OpenMM {bindings.openmmVersionOfBuild}'
            f', but the Python module openmm is OpenMM {series}, from {openmm.__file__}; build '
            'openmm-rigidhi against this OpenMM, or have Python find the other one')
    # The loader takes a library of the same name that is loaded already, whichever directory the
    # bindings name.
    loaded, own = os.path.realpath(bindings.libraryPath()), os.path.join(_DIRECTORY, 'lib')
    if os.path.isdir(own) and os.path.dirname(loaded) != os.path.realpath(own):
        raise ImportError(
            f'openmmrigidhi: its library libOpenMMRigidHI.so was loaded from {loaded}, by OpenMM '
            f'or another program, and not from {own}, where the libraries of this package are; '
            'this process would mix two copies of openmm-rigidhi: remove the other copy, or set '
            'OPENMM_PLUGIN_DIR to a directory without this copy')


def _plugin_libraries():
    if not os.path.isdir(_PLUGIN_DIRECTORY) and _served():
        return []  # a Debian package: OpenMM has loaded them from its own plugin directory
    names = sorted(os.listdir(_PLUGIN_DIRECTORY)) if os.path.isdir(_PLUGIN_DIRECTORY) else []
    paths = [os.path.join(_PLUGIN_DIRECTORY, name) for name in names if name.endswith('.so')]
    if not paths:
        raise ImportError(
            'openmmrigidhi: found no platform library (libOpenMMRigidHI*.so) in '
            f'{_PLUGIN_DIRECTORY}: the package is incomplete, build or install it anew with "make '
            'build" or "make install"')
    return paths


def _platform_names():
    return [
        openmm.Platform.getPlatform(i).getName() for i in range(openmm.Platform.getNumPlatforms())
    ]


def _load_for_device(name):
    """Load this plugin's library for a device's platform that OpenMM has loaded later.

    A UserWarning says so if this library is missing or does not load: the host then moves bodies.
    """
    library = f'libOpenMMRigidHI{name}.so'
    path = find_platform_library(library)
    if path is None or name not in _platforms_at_load:
        reason = f'it is not in {_PLUGIN_DIRECTORY}' if path is None else None
        if path is not None:
            try:
                openmm.Platform.loadPluginLibrary(path)
            except Exception as error:
                reason = str(error)
        _platforms_at_load.add(name)
        device_failures[:] = [text for text in device_failures if not text.startswith(library)]
        if reason is not None:
            device_failures.append(f'{library}: {reason}')
    for failure in device_failures:
        if failure.startswith(library):
            warnings.warn(
                f'openmmrigidhi: platform {name} computes forces, but the host moves bodies, '
                f'because the library for this platform does not load: {failure}', stacklevel=3)


def _served():
    """Names of the platforms that have kernels of this plugin."""
    present = [openmm.Platform.getPlatform(i) for i in range(openmm.Platform.getNumPlatforms())]
    return [platform.getName() for platform in present if platform.supportsKernels([_KERNEL])]


def find_platform_library(name):
    """The path of a platform library of this plugin; None if it is in no directory.

    The directories are those of this package and OpenMM's plugin directories.

    Parameters
    ----------
    name : str
        for example 'libOpenMMRigidHICPU.so'
    """
    for directory in (_PLUGIN_DIRECTORY,
                      *openmm.Platform.getDefaultPluginsDirectory().split(os.pathsep)):
        path = os.path.join(directory, name)
        if os.path.exists(path):
            return path
    return None


def checkPlatform(platform: Union[str, openmm.Platform]) -> None:
    """Check that a platform can run this plugin's integrator; an error says why it cannot.

    A platform loaded after this package gets the plugin's kernels now. If the library that moves
    bodies on a device does not load, a UserWarning says why; the host then moves bodies.

    If you create a Context on a platform without these kernels, OpenMM's own message ("Specified a
    Platform for a Context which does not support all required kernels") gives no cause.

    Parameters
    ----------
    platform : str or openmm.Platform
        the platform or its name, for example 'CPU'

    Raises
    ------
    openmm.OpenMMException
        if OpenMM has no such platform, or the platform lacks the plugin's kernels
    """
    name = platform if isinstance(platform, str) else platform.getName()
    late = find_platform_library(_FOR_ANY_PLATFORM)
    if late is not None:
        openmm.Platform.loadPluginLibrary(late)
    names = _platform_names()
    if name in names and name in _DEVICES:
        _load_for_device(name)
    able = _served()
    if name in able:
        return
    failures = '; '.join([*openmm.Platform.getPluginLoadFailures(), *device_failures]) or 'none'
    background = (
        f"Platforms in OpenMM: {', '.join(names)}; with the kernels of openmmrigidhi: "
        f"{', '.join(able) or 'none'}. OPENMM_PLUGIN_DIR: "
        f"{os.environ.get('OPENMM_PLUGIN_DIR', 'not set')}; "
        f"plugins that failed to load: {failures}. Libraries of openmmrigidhi: {_PLUGIN_DIRECTORY}."
    )
    if name not in names:
        raise openmm.OpenMMException(
            f"openmmrigidhi: platform '{name}': OpenMM has no platform of this name: load "
            f'its plugin first. {background}')
    raise openmm.OpenMMException(
        f"openmmrigidhi: platform '{name}': it has no kernels of this plugin; its "
        f"library must be loaded: use one of {', '.join(able) or 'none'}, or install the package "
        f"anew. {background}")
