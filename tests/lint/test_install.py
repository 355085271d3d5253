"""The files that `make install` makes work without the source and build trees, from Python and from
C++."""
import shutil
import subprocess
import sys

import pytest

from conftest import ROOT

PROGRAM = r'''
#include <OpenMM.h>
#include <openmmrigidhi/CustomRigidHIIntegrator.h>
#include <iostream>
#include <vector>
int main(int, char** arguments) {
    OpenMM::Platform::loadPluginsFromDirectory(arguments[1]);
    OpenMM::System system;
    for (int i = 0; i < 3; i++) system.addParticle(12.0);
    RigidHIPlugin::CustomRigidHIIntegrator integrator(300.0, 0.002);
    integrator.addRigidBody({0, 1, 2});
    OpenMM::Context context(system, integrator, OpenMM::Platform::getPlatformByName("Reference"));
    context.setPositions({OpenMM::Vec3(0, 0, 0), OpenMM::Vec3(0.1, 0, 0), OpenMM::Vec3(0, 0.1, 0)});
    integrator.step(10);
    std::cout << integrator.getStepStatistics()["steps"] << std::endl;
}
'''
SCRIPT = '''
import openmm, openmmrigidhi
system = openmm.System()
for _ in range(3):
    system.addParticle(12.0)
integrator = openmmrigidhi.CustomRigidHIIntegrator(300.0, 0.002)
integrator.addRigidBody([0, 1, 2])
for name in ("Reference", "CPU"):
    copied = openmmrigidhi.CustomRigidHIIntegrator.cast(integrator.__copy__())
    context = openmm.Context(system, copied,
                             openmm.Platform.getPlatformByName(name))
    context.setPositions([(0, 0, 0), (0.1, 0, 0), (0, 0.1, 0)])
    context.getIntegrator().step(10)
for i in range(openmm.Platform.getNumPlatforms()):
    openmmrigidhi.checkPlatform(openmm.Platform.getPlatform(i))
import openmmrigidhi.app
print(openmmrigidhi.__file__)
'''


@pytest.fixture(scope='module')
def prefix(tmp_path_factory):
    import openmmrigidhi
    import pathlib
    build = pathlib.Path(openmmrigidhi.__file__).parents[2]
    if not (build/'CMakeCache.txt').exists():
        pytest.skip('openmmrigidhi was not imported from a build directory')
    target = tmp_path_factory.mktemp('prefix')
    subprocess.run(['cmake', '--install', build, '--prefix', target], check=True,
                   capture_output=True)
    return target


def test_installed_package_is_imported_and_steps(prefix, tmp_path, run_python):
    (package,) = prefix.glob('**/openmmrigidhi/__init__.py')
    finished = run_python(SCRIPT, tmp_path, path=package.parents[1])
    assert finished.returncode == 0, finished.stderr
    assert finished.stdout.strip() == str(package)


def test_the_directory_of_the_package_names_the_python(prefix):
    """Unless CMake was told another directory (as `make install` tells it)."""
    (package,) = prefix.glob('**/openmmrigidhi/__init__.py')
    parts = package.relative_to(prefix).parts
    assert parts[0] == 'lib' and parts[1] in ('python3', 'python%d.%d' % sys.version_info[:2])
    assert parts[2] in ('site-packages', 'dist-packages')


def test_installed_files_do_not_look_into_the_build_tree(prefix):
    for library in prefix.glob('**/*.so'):
        assert str(ROOT).encode() not in library.read_bytes(
        ), f'{library.name} contains the path of the source tree'


def test_every_python_file_is_installed(prefix):
    (package,) = prefix.glob('**/openmmrigidhi/__init__.py')
    source = ROOT/'python'/'openmmrigidhi'
    for file in source.rglob('*.py'):
        assert (package.parent/file.relative_to(source)).exists(), f'{file} is not installed'


def test_what_type_checkers_read_is_installed(prefix):
    (package,) = prefix.glob('**/openmmrigidhi/__init__.py')
    for name in ('py.typed', '_bindings.pyi', '_enumerations.pyi'):
        assert (package.parent/name).exists(), f'{name} is not installed'


def test_cpp_program_builds_against_the_installation(prefix, tmp_path):
    if shutil.which('g++') is None:
        pytest.skip('no g++')
    (tmp_path/'program.cpp').write_text(PROGRAM)
    libraries = prefix/'lib'/'openmmrigidhi'
    subprocess.run([
        'g++', '-std=c++17', '-O0', 'program.cpp', '-o', 'program', f'-I{prefix}/include',
        f'-L{libraries}', f'-Wl,-rpath,{libraries}', '-lOpenMMRigidHI', '-lOpenMM'
    ], cwd=tmp_path, check=True)
    finished = subprocess.run(['./program', libraries/'plugins'], cwd=tmp_path, capture_output=True,
                              text=True)
    assert (finished.returncode, finished.stdout) == (0, '10\n'), finished.stderr


def test_directory_for_the_package():
    script = ROOT/'tools'/'python_directory.py'
    command = [sys.executable, '-I', str(script)]
    other = subprocess.run(command + ['/nowhere'], capture_output=True, text=True,
                           check=True).stdout
    assert other.strip() == 'lib/python3/dist-packages'
    advice = subprocess.run(command + ['--advise', '/nowhere'], capture_output=True, text=True,
                            check=True).stdout
    assert 'export PYTHONPATH=/nowhere/lib/python3/dist-packages' in advice
