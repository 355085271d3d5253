"""Every kind of package names the minor series of OpenMM for which its libraries were compiled."""
import importlib.util
import re
import shutil
import subprocess

import pytest
from conftest import ROOT, read

#: The oldest series, as CMake asks for it.
OLDEST = re.search(r'find_package\(OpenMM ([0-9.]+)', read('CMakeLists.txt'))[1]


@pytest.fixture(scope='module')
def provider():
    """The module that tells a wheel's dependencies."""
    specification = importlib.util.spec_from_file_location('openmm_series',
                                                           ROOT/'packaging'/'openmm_series.py')
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


def test_requirement_of_a_series(provider):
    assert provider.requirement('7.7') == 'openmm>=7.7,<7.8'
    assert provider.requirement('8.9') == 'openmm>=8.9,<8.10'
    assert provider.requirement('8.10') == 'openmm>=8.10,<8.11'


def test_a_wheel_needs_the_series_that_cmake_finds(provider, build_directory, monkeypatch):
    cache = (build_directory/'CMakeCache.txt').read_text()
    series = re.search('^OPENMM_VERSION:INTERNAL=(.*)$', cache, flags=re.M)[1]
    prefix = re.search('^OPENMM_DIR:PATH=(.*)$', cache, flags=re.M)[1]
    monkeypatch.setenv('OPENMM_DIR', prefix)
    found = provider.dynamic_metadata('dependencies', {'others': ['numpy']})
    assert found == [provider.requirement(series), 'numpy']


def test_an_openmm_that_is_missing_is_an_error(provider, tmp_path, monkeypatch):
    if shutil.which('cmake') is None:
        pytest.skip('no cmake')
    monkeypatch.setenv('OPENMM_DIR', str(tmp_path))
    with pytest.raises(RuntimeError, match='OpenMM was not found'):
        provider.find_series()
    with pytest.raises(RuntimeError, match="got field 'version'; it must be dependencies"):
        provider.dynamic_metadata('version', {})


def test_pyproject_leaves_openmm_to_the_build():
    text = read('pyproject.toml')
    assert re.search('^dynamic = .*"dependencies"', text, flags=re.M)
    assert not re.search('^dependencies = ', text, flags=re.M)
    wheel, sdist = text.split('[tool.scikit-build.metadata.dependencies]')[1].split('[[tool')
    settings = dict(re.findall('^([a-z-]+) = (.*)$', wheel, flags=re.M))
    assert settings.keys() == {'provider', 'provider-path', 'others'}
    assert settings['provider'] == '"openmm_series"' and settings['provider-path'] == '"packaging"'
    for name, value in settings.items():
        assert f'{name} = {value}' in sdist, f'{name} of an sdist is another one'
    assert f'openmm = "openmm>={OLDEST}"' in sdist


def test_conda_pins_the_series():
    host, run = read('packaging/conda/meta.yaml').split('  host:')[1].split('  run:')
    assert f'- openmm >={OLDEST}\n' in host
    assert "- {{ pin_compatible('openmm', min_pin='x.x', max_pin='x.x') }}\n" in run
    assert '- openmm\n' not in run


def relations(text):
    """Names of Debian packages -> the sets of bounds that they are named with."""
    found = {}
    for line in text.splitlines():
        for name, bound in re.findall(r'([\w.-]*(?:openmm|simtk)[\w.-]*) \(([^)]*)\)', line):
            found.setdefault(name, set()).add(bound)
    return found


def test_debian_packages_depend_on_the_series():
    source, *packages = read('debian/control').split('\nPackage: ')
    assert relations(source) == {'libopenmm-dev': {f'>= {OLDEST}'}}
    series = {'>= ${openmm:Series}', '<< ${openmm:Next}'}
    same = {'= ${binary:Version}'}
    assert {package.splitlines()[0]: relations(package)
            for package in packages} == {
                'libopenmm-rigidhi': {
                    'libopenmm-plugins': series
                },
                'openmm-rigidhi-dev': {
                    'libopenmm-dev': series,
                    'libopenmm-rigidhi': same
                },
                'python3-openmm-rigidhi': {
                    'python3-openmm': series,
                    'python3-simtk': series,
                    'libopenmm-rigidhi': same
                }
            }


@pytest.mark.parametrize('series, bound', [('7.7', '7.8~'), ('8.10', '8.11~')])
def test_debian_rules_read_the_series_from_the_build(tmp_path, series, bound):
    """The rule's own commands, with a program in place of dh_gencontrol that prints what it got."""
    rule = read('debian/rules').split('override_dh_gencontrol:\n')[1].split('\n\n')[0]
    script = rule.replace('$$', '$').replace('$(DEB_HOST_GNU_TYPE)', 'triplet').replace('\\\n', '')
    (tmp_path/'obj-triplet').mkdir()
    cache = tmp_path/'obj-triplet'/'CMakeCache.txt'
    cache.write_text(f'OPENMM_VERSION:INTERNAL={series}\nOPENMM_VERSION_IS_OF:INTERNAL=x\n')
    script = f'dh_gencontrol() {{ echo "$*"; }}\n{script}'
    finished = subprocess.run(['sh', '-c', script], cwd=tmp_path, capture_output=True, text=True)
    assert finished.returncode == 0, finished.stderr
    assert finished.stdout == f'-- -Vopenmm:Series={series} -Vopenmm:Next={bound}\n'
    cache.write_text('')
    assert subprocess.run(['sh', '-c', script], cwd=tmp_path).returncode != 0
