"""Where things are, for the lints."""
import os
import pathlib
import subprocess
import sys

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
CPP_DIRECTORIES = ('openmmapi', 'platforms', 'serialization', 'tests', 'benchmarks', 'examples')


def git_files(*patterns):
    """Files that are in the repository, or would be if they were added, as paths relative to its
    root."""
    command = [
        'git', '-c', f'safe.directory={ROOT}', 'ls-files', '-z', '--cached', '--others',
        '--exclude-standard', '--', *patterns
    ]
    listing = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    return sorted({name for name in listing.split('\0') if name and (ROOT/name).exists()})


def cpp_files():
    """All C++ files."""
    return [name for name in git_files('*.h', '*.cpp') if name.split('/')[0] in CPP_DIRECTORIES]


def read(name):
    """The text of a file of the repository."""
    return (ROOT/name).read_text(encoding='utf-8')


@pytest.fixture(scope='session')
def package_directory():
    """The directory from which openmmrigidhi was imported (in the build tree)."""
    import openmmrigidhi
    return pathlib.Path(openmmrigidhi.__file__).parent


@pytest.fixture(scope='session')
def build_directory(package_directory):
    """The CMake build directory to which that belongs."""
    build = package_directory.parents[1]
    if not (build/'CMakeCache.txt').exists():
        pytest.skip(
            f'openmmrigidhi was imported from {package_directory}, not from a build directory')
    return build


#: The scripts of users leave the seed to chance. A test must not: here the nth integrator without a
#: seed has the seed n.
SEEDED = """
import itertools
from openmmrigidhi import CustomRigidHIIntegrator
def seeded(made, seeds):
    def initialise(self, *arguments, **named):
        made(self, *arguments, **named)
        if self.getRandomNumberSeed() == 0:
            self.setRandomNumberSeed(next(seeds))
    return initialise
CustomRigidHIIntegrator.__init__ = seeded(CustomRigidHIIntegrator.__init__, itertools.count(1))
del itertools, CustomRigidHIIntegrator, seeded
"""


@pytest.fixture
def run_python():
    """Run a Python script in a process of its own, with this openmmrigidhi or another; returns the
    finished process.

    If seeded, all integrators have fixed seeds.
    """
    def run(source, cwd, path=None, timeout=120, seeded=False):
        environment = dict(os.environ, MPLBACKEND='Agg',
                           PYTHONPATH=str(path or os.environ.get('PYTHONPATH', '')))
        source = SEEDED*seeded + source
        return subprocess.run([sys.executable, '-c', source], cwd=cwd, env=environment,
                              capture_output=True, text=True, timeout=timeout)

    return run
