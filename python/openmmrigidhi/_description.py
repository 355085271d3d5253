"""The installed and loaded parts, in the form of a bug report."""
from __future__ import annotations

import ctypes
import os
import platform

import numpy
import openmm
import scipy

from . import _loading

_CPU_LIBRARY = 'libOpenMMRigidHICPU.so'


def describe() -> str:
    """Describe versions, platforms, instruction sets and libraries, for a bug report.

    Returns
    -------
    str
        several lines; they name no people, machines or files except the path of the plugin's own
        library
    """
    bindings = _loading._load_bindings()
    served = _loading._served()
    platforms = [
        openmm.Platform.getPlatform(i).getName() for i in range(openmm.Platform.getNumPlatforms())
    ]
    lines = [
        f'openmmrigidhi {bindings.version}, compiled for OpenMM {bindings.openmmVersionOfBuild}, '
        f'from {os.path.realpath(bindings.libraryPath())}',
        f'OpenMM {openmm.Platform.getOpenMMVersion()}; platforms: ' +
        ', '.join(name if name in served else f'{name} (without our kernels)'
                  for name in platforms),
        f'Python {platform.python_version()}, NumPy {numpy.__version__}, SciPy '
        f'{scipy.__version__}; {platform.system()} {platform.machine()}',
    ]
    failures = openmm.Platform.getPluginLoadFailures()
    if failures:
        lines.append('plugins of OpenMM that failed to load: ' + '; '.join(failures))
    if _loading.device_failures:
        lines.append('libraries of devices that failed to load (the host moves bodies there): ' +
                     '; '.join(_loading.device_failures))
    path = _loading.find_platform_library(_CPU_LIBRARY)
    if path is None:
        lines.append(f'{_CPU_LIBRARY} is in neither plugin directory')
    else:
        library = ctypes.CDLL(path)
        library.describeRigidHI.restype = ctypes.c_char_p
        lines.append(library.describeRigidHI().decode())
    return '\n'.join(lines)
