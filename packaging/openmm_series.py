"""The minor series of OpenMM (8.1, say) that a wheel of openmm-rigidhi needs.

A wheel's libraries work only with the series for which they were compiled, so the wheel's metadata
name it. scikit-build-core asks this module for the dependencies (pyproject.toml), before it
compiles. cmake/FindOpenMM.cmake answers here, as it answers in the build itself. So the two agree.
"""
import os
import pathlib
import re
import shlex
import subprocess
import sys
import tempfile

_MODULES = pathlib.Path(__file__).resolve().parents[1]/'cmake'
_PROJECT = '''
cmake_minimum_required(VERSION 3.22)
project(series LANGUAGES CXX)
list(APPEND CMAKE_MODULE_PATH "{modules}")
find_package(OpenMM REQUIRED MODULE)
message(STATUS "series=${{OPENMM_VERSION}}")
'''


def requirement(series):
    """The requirement on the package openmm, in the words of pip.

    Parameters
    ----------
    series : str
        the first two numbers of a version of OpenMM
    """
    major, minor = series.split('.')
    return f'openmm>={series},<{major}.{int(minor) + 1}'


def find_series():
    """The first two numbers of the version of the OpenMM that CMake finds."""
    with tempfile.TemporaryDirectory() as directory:
        source = pathlib.Path(directory)
        (source/'CMakeLists.txt').write_text(_PROJECT.format(modules=_MODULES.as_posix()))
        finished = subprocess.run([
            'cmake', '-S', source, '-B', source/'build', f'-DPython3_EXECUTABLE={sys.executable}',
            *shlex.split(os.environ.get('CMAKE_ARGS', ''))
        ], capture_output=True, text=True)
    found = re.search('^-- series=(.*)$', finished.stdout, flags=re.M)
    if finished.returncode != 0 or found is None:
        raise RuntimeError('openmm-rigidhi: its wheel needs the series of an OpenMM, which CMake '
                           f'did not find:\n{finished.stdout}{finished.stderr}')
    return found[1]


def dynamic_metadata(field, settings):
    """The dependencies of the wheel, for scikit-build-core.

    Parameters
    ----------
    field : str
        'dependencies'
    settings : dict
        the table of pyproject.toml: `others` lists the dependencies beside OpenMM, and `openmm`
        says which OpenMM an sdist needs, since its reader compiles it against any series
    """
    if field != 'dependencies':
        raise RuntimeError(f'openmm_series: got field {field!r}; it must be dependencies')
    openmm = settings['openmm'] if 'openmm' in settings else requirement(find_series())
    return [openmm, *settings['others']]
