"""The ways in which cmake/FindOpenMM.cmake finds OpenMM, and its messages if it does not."""
import shutil
import subprocess

import pytest

from conftest import ROOT

PROJECT = '''
cmake_minimum_required(VERSION 3.22)
project(finds LANGUAGES CXX)
list(APPEND CMAKE_MODULE_PATH {modules})
find_package(OpenMM {version} REQUIRED MODULE)
message(STATUS "found ${{OPENMM_VERSION}} ${{OPENMM_LIBRARY}}")
'''


@pytest.fixture
def configure(tmp_path, monkeypatch):
    if shutil.which('cmake') is None:
        pytest.skip('no cmake')
    monkeypatch.delenv('OPENMM_DIR', raising=False)

    def run(*options, version='7.7', again=False):
        (tmp_path/'CMakeLists.txt').write_text(PROJECT.format(modules=ROOT/'cmake',
                                                              version=version))
        if not again:
            shutil.rmtree(tmp_path/'build', ignore_errors=True)
        finished = subprocess.run(['cmake', '-S', tmp_path, '-B', tmp_path/'build', *options],
                                  capture_output=True, text=True)
        # Messages of errors are broken into lines.
        return finished.returncode, ' '.join((finished.stdout + finished.stderr).split())

    return run


def found(output):
    """The library that CMake found."""
    return output.split('-- found ')[1].split()[1]


def test_in_the_directories_of_the_system_and_below_a_prefix(configure, tmp_path, monkeypatch):
    status, output = configure()
    assert status == 0, output
    library = found(output)
    # Under /usr on Debian, libraries are in a directory of the architecture.
    if library.startswith('/usr/lib/'):
        assert found(configure('-DOPENMM_DIR=/usr')[1]) == library
    prefix = tmp_path/'prefix'
    (prefix/'lib').mkdir(parents=True)
    (prefix/'lib'/'libOpenMM.so').symlink_to(library)
    (prefix/'include').symlink_to('/usr/include')
    monkeypatch.setenv('OPENMM_DIR', str(prefix))
    assert found(configure()[1]) == str(prefix/'lib'/'libOpenMM.so')


def test_another_prefix_in_the_same_build_directory(configure, tmp_path, monkeypatch):
    """OPENMM_DIR counts in a build directory that is there, too: as a CMake variable, and as an
    environment variable whose value is another one."""
    library = found(configure()[1])
    prefixes = []
    for name in ('one', 'two'):
        prefix = tmp_path/name
        (prefix/'lib').mkdir(parents=True)
        (prefix/'lib'/'libOpenMM.so').symlink_to(library)
        (prefix/'include').symlink_to('/usr/include')
        prefixes.append(prefix)
    one, two = (str(prefix/'lib'/'libOpenMM.so') for prefix in prefixes)
    assert found(configure(f'-DOPENMM_DIR={prefixes[0]}', again=True)[1]) == one
    assert found(configure(again=True)[1]) == one
    assert found(configure('-DOPENMM_DIR=', again=True)[1]) == library
    monkeypatch.setenv('OPENMM_DIR', str(prefixes[0]))
    assert found(configure(again=True)[1]) == one
    monkeypatch.setenv('OPENMM_DIR', str(prefixes[1]))
    assert found(configure(again=True)[1]) == two
    # When CMake runs by itself in a build, the variable may be missing.
    monkeypatch.delenv('OPENMM_DIR')
    assert found(configure(again=True)[1]) == two


def test_headers_that_are_missing_are_not_taken_from_elsewhere(configure, tmp_path):
    library = found(configure()[1])
    for name in ('include', 'lib'):
        (tmp_path/'prefix'/name).mkdir(parents=True)
    (tmp_path/'prefix'/'lib'/'libOpenMM.so').symlink_to(library)
    (tmp_path/'prefix'/'include'/'OpenMM.h').write_text('#include "openmm/Platform.h"')
    status, output = configure(f'-DOPENMM_DIR={tmp_path}/prefix')
    assert status != 0 and 'openmm/Platform.h is missing' in output


def test_what_is_wrong_is_said(configure, tmp_path):
    status, output = configure(f'-DOPENMM_DIR={tmp_path}')
    assert (status != 0 and f"OPENMM_DIR: '{tmp_path}'" in output
            and 'name the prefix in which it is: -DOPENMM_DIR=prefix' in output)
    status, output = configure(version='99.5')
    assert status != 0 and 'is too old: openmm-rigidhi needs 99.5 or newer' in output
    (tmp_path/'lib').mkdir()
    (tmp_path/'lib'/'libOpenMM.so').write_text('no library')
    (tmp_path/'include').symlink_to('/usr/include')
    status, output = configure(f'-DOPENMM_DIR={tmp_path}')
    assert status != 0 and 'are header and library of one version and for this compiler?' in output
