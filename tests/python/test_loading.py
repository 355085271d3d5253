"""The package finds its libraries and those of OpenMM, or says what is missing."""
import os
import shutil
import subprocess
import sys

import numpy as np
import openmm
import pytest

import openmmrigidhi


def run(code, path=None, **variables):
    environment = {
        **os.environ, 'PYTHONPATH': path
        or os.path.dirname(os.path.dirname(openmmrigidhi.__file__)),
        **variables
    }
    return subprocess.run([sys.executable, '-c', code], env=environment, capture_output=True,
                          text=True)


def packageDirectory():
    return os.path.dirname(openmmrigidhi.__file__)


def test_checkPlatform_says_why():
    openmmrigidhi.checkPlatform('Reference')
    openmmrigidhi.checkPlatform(openmm.Platform.getPlatformByName('CPU'))
    with pytest.raises(openmm.OpenMMException,
                       match="'Nonsense': OpenMM has no platform of this name.*Reference, CPU"):
        openmmrigidhi.checkPlatform('Nonsense')


def test_importing_needs_no_environment_and_loads_twice_harmlessly():
    code = ('import importlib, openmm, openmmrigidhi; openmmrigidhi._loading.load(); '
            'openmmrigidhi.checkPlatform("Reference"); print(openmmrigidhi.app.sphereShell(12, '
            '1).shape)')
    result = run(code)
    assert result.returncode == 0, result.stderr
    assert result.stdout.strip() == '(12, 3)'


def test_a_library_that_does_not_load_fails_loudly(tmp_path):
    package = tmp_path/'openmmrigidhi'
    shutil.copytree(packageDirectory(), package)
    (package/'lib'/'plugins'/'libOpenMMRigidHICPU.so').write_bytes(b'no library')
    result = run('import openmmrigidhi', str(tmp_path))
    assert result.returncode != 0
    assert ('ImportError: openmmrigidhi: cannot load the platform library '
            'libOpenMMRigidHICPU.so') in result.stderr
    assert str(package) in result.stderr and 'invalid ELF header' in result.stderr \
        or 'file too short' in result.stderr


def test_the_library_of_a_device_may_fail_to_load(tmp_path):
    """The software of a GPU is not on every machine on which the package is."""
    package = tmp_path/'openmmrigidhi'
    shutil.copytree(packageDirectory(), package)
    (package/'lib'/'plugins'/'libOpenMMRigidHIHIP.so').write_bytes(b'no library')
    result = run(
        'import openmmrigidhi; openmmrigidhi.checkPlatform("CPU"); '
        'print(openmmrigidhi.describe())', str(tmp_path))
    assert result.returncode == 0, result.stderr
    found = [
        line for line in result.stdout.splitlines()
        if line.startswith('libraries of devices that failed to load')
    ]
    assert len(found) == 1 and 'libOpenMMRigidHIHIP.so: ' in found[0]


def test_another_copy_of_the_library_is_not_mixed_in(tmp_path):
    """The loader would take a library of the same name that is installed already, for example that
    of a Debian package instead of the build tree's."""
    copy = shutil.copy(os.path.join(packageDirectory(), 'lib', 'libOpenMMRigidHI.so'), tmp_path)
    result = run(f'import ctypes; ctypes.CDLL({copy!r}); import openmmrigidhi')
    assert ('ImportError: openmmrigidhi: its library libOpenMMRigidHI.so was loaded from '
            f'{copy}') in result.stderr
    assert 'this process would mix two copies of openmm-rigidhi' in result.stderr


def test_a_python_module_of_another_openmm_is_refused():
    """As on a machine with two of them, where the loader finds a library for the bindings."""
    result = run("import openmm; openmm.Platform.getOpenMMVersion = lambda: '99.1.2'; "
                 'import openmmrigidhi')
    assert result.returncode != 0
    assert 'but the Python module openmm is OpenMM 99.1, from ' in result.stderr


def test_describe_says_what_a_bug_report_needs():
    text = openmmrigidhi.describe()
    version = openmm.Platform.getOpenMMVersion()
    compiledFor = '.'.join(version.split('.')[:2])  # version 7.7 says no more, later ones do
    assert text.startswith(
        f'openmmrigidhi {openmmrigidhi.__version__}, compiled for OpenMM {compiledFor}, from '
    ) and f'\nOpenMM {version}; ' in text
    for name in ('Reference', 'CPU', f'NumPy {np.__version__}', 'instruction set: ', 'Eigen 3.',
                 'OpenBLAS', 'fftw-3', 'Highway', 'muParser'):
        assert name in text, name


def test_kernels_in_the_plugin_directory_of_openmm_serve(tmp_path):
    """In the layout of a distribution libraries are beside OpenMM's own, and none is in the Python
    package."""
    package = tmp_path/'python'/'openmmrigidhi'
    shutil.copytree(packageDirectory(), package)
    shutil.move(package/'lib', tmp_path/'openmm')
    code = ('import openmmrigidhi; openmmrigidhi.checkPlatform("CPU"); '
            'print(openmmrigidhi.describe())')
    # OpenMM's own plugins; below a prefix they are beside its library.
    own = os.path.join(openmm.version.openmm_library_path, 'plugins')
    if not os.path.isdir(own):
        own = openmm.Platform.getDefaultPluginsDirectory()
    environment = {'OPENMM_PLUGIN_DIR': os.pathsep.join([str(tmp_path/'openmm'/'plugins'), own])}
    result = run(code, str(package.parent), **environment)
    assert result.returncode == 0, result.stderr
    assert str(tmp_path/'openmm'/'libOpenMMRigidHI.so') in result.stdout


def test_missing_libraries_fail_loudly(tmp_path):
    package = tmp_path/'openmmrigidhi'
    shutil.copytree(packageDirectory(), package)
    shutil.rmtree(package/'lib'/'plugins')
    result = run('import openmmrigidhi', str(tmp_path))
    assert 'ImportError: openmmrigidhi: found no platform library' in result.stderr
    os.remove(package/'_openmmrigidhi.so')
    result = run('import openmmrigidhi', str(tmp_path))
    assert 'ImportError: openmmrigidhi: cannot load its binding module' in result.stderr


def test_a_context_without_our_platform_libraries_says_what_is_missing():
    """Only the bindings are loaded, as in a C++ program that does not load the plugin directory.
    """
    result = run(f'''
import sys, types, openmm
package = types.ModuleType('openmmrigidhi')
package.__path__ = [{packageDirectory()!r}]
sys.modules['openmmrigidhi'] = package
from openmmrigidhi.integrator import CustomRigidHIIntegrator
system = openmm.System()
system.addParticle(1.0)
openmm.Context(system, CustomRigidHIIntegrator(300, 0.001),
               openmm.Platform.getPlatformByName('Reference'))
''')
    message = 'no platform has the kernels of this integrator; libOpenMMRigidHIReference.so'
    assert message in result.stderr
    assert 'loadPluginsFromDirectory' in result.stderr


def test_reference_works_without_the_cpu_platform(tmp_path):
    """OPENMM_PLUGIN_DIR replaces OpenMM's own plugin directory, and its CPU platform with it."""
    os.environ['OPENMM_PLUGIN_DIR'] = str(tmp_path)
    try:
        result = run('''
import openmm, openmmrigidhi
openmmrigidhi.checkPlatform('Reference')
try:
    openmmrigidhi.checkPlatform('CPU')
except openmm.OpenMMException as error:
    print(error)
''')
    finally:
        del os.environ['OPENMM_PLUGIN_DIR']
    assert result.returncode == 0, result.stderr
    assert "platform 'CPU': OpenMM has no platform of this name" in result.stdout and str(
        tmp_path) in result.stdout
