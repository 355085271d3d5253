"""tools/check_wheel.py accepts what a wheel must be, and names what it must not be."""
import email
import importlib.util
import subprocess
import sys

import pytest
from conftest import ROOT


@pytest.fixture(scope='module')
def tool():
    specification = importlib.util.spec_from_file_location('check_wheel',
                                                           ROOT/'tools'/'check_wheel.py')
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


LISTING = '''
Dynamic section at offset 0x1000 contains 30 entries:
 0x0000000000000001 (NEEDED)             Shared library: [libOpenMM.so.7.7]
 0x0000000000000001 (NEEDED)             Shared library: [libstdc++.so.6]
 0x000000000000000e (SONAME)             Library soname: [libOpenMMRigidHI.so]
 0x000000000000001d (RUNPATH)            Library runpath: [$ORIGIN:$ORIGIN/../../OpenMM.libs]
'''


def test_what_readelf_prints_is_read(tool):
    section = tool.dynamic_section(LISTING)
    assert section == {
        'needed': ['libOpenMM.so.7.7', 'libstdc++.so.6'],
        'path': ['$ORIGIN', '$ORIGIN/../../OpenMM.libs']
    }
    assert tool.faults_of_library('libOpenMMRigidHI.so', section) == []


@pytest.mark.parametrize('name, needed, right',
                         [('libOpenMMRigidHI.so', 'libOpenMM.so', True),
                          ('libOpenMMRigidHI.so', 'libopenblas.so.0', False),
                          ('_openmmrigidhi.so', 'libOpenMMRigidHI.so', True),
                          ('_openmmrigidhi.so', 'libmuparser.so.2.3', False),
                          ('_openmmrigidhi.so', 'libpython3.11.so.1.0', False),
                          ('libOpenMMRigidHICPU.so', 'libopenblas.so.0', True),
                          ('libOpenMMRigidHICPU.so', 'libhwy.so.1', True),
                          ('libOpenMMRigidHICPU.so', 'libOpenMMCPU.so', False),
                          ('libOpenMMRigidHIOpenCL.so', 'libOpenMMOpenCL.so', True),
                          ('libOpenMMRigidHIOpenCL.so', 'libOpenMMCUDA.so', False)])
def test_only_libraries_that_have_a_reason_are_needed(tool, name, needed, right):
    faults = tool.faults_of_library(name, {'needed': ['libc.so.6', needed], 'path': []})
    assert faults == ([] if right else [f'{name} needs {needed}, which it should not'])


@pytest.mark.parametrize('place', ['/opt/openmm/lib', '', '$ORIGINAL', './lib'])
def test_places_of_the_building_machine_are_faults(tool, place):
    section = {'needed': [], 'path': ['$ORIGIN/..', place]}
    assert tool.faults_of_library('libOpenMMRigidHICPU.so', section) == [
        f'libOpenMMRigidHICPU.so looks in {place}, which is not relative to it'
    ]


@pytest.mark.parametrize('needs, series', [(['openmm<7.8,>=7.7', 'numpy'], '7.7'),
                                           (['numpy', 'openmm (>=8.9,<8.10)'], '8.9'),
                                           (['openmm>=7.7'], None), (['openmm>=8.1,<8.3'], None),
                                           (['openmm>=8.1,<9.2'], None), (['numpy'], None),
                                           (['openmm'], None), (['openmm-ml>=8.1,<8.2'], None)])
def test_metadata_need_one_series(tool, needs, series):
    text = 'Name: openmm-rigidhi\n' + ''.join(f'Requires-Dist: {need}\n' for need in needs)
    assert tool.series_of_metadata(email.message_from_string(text)) == series


def test_files_of_a_wheel(tool, package_directory):
    """Those of the build tree's package are the right ones."""
    names = [
        f'openmmrigidhi/{path.relative_to(package_directory).as_posix()}'
        for path in package_directory.rglob('*')
        if path.is_file() and '__pycache__' not in path.parts
    ]
    names.append('openmm_rigidhi-0.1.0.dist-info/METADATA')
    assert tool.faults_of_files(names) == []
    assert tool.faults_of_files(names[1:]) == [f'{names[0]} is missing']
    for other in ('openmmrigidhi/lib/libopenblas.so.0', 'include/openmmrigidhi/Version.h'):
        assert tool.faults_of_files(names + [other]) == [f'{other} should not be in the wheel']


@pytest.mark.long
def test_a_wheel_that_pip_builds_has_no_fault(tool, tmp_path):
    """Builds everything anew, unless ccache has it."""
    pytest.importorskip('scikit_build_core')
    subprocess.run([
        sys.executable, '-m', 'pip', 'wheel', '--no-deps', '--no-build-isolation', '--no-index',
        f'--config-settings=build-dir={tmp_path}/build', '--wheel-dir', tmp_path, ROOT
    ], check=True)
    (wheel,) = tmp_path.glob('*.whl')
    assert tool.main([str(wheel)]) == 0
