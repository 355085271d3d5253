"""packages-debian.txt names the packages of all imports and includes, and site/packages-debian.txt
those that Sphinx is configured to use."""
import ast
import re
import runpy
import sys

from conftest import ROOT, git_files, read

#: The Debian package that provides a Python module.
MODULES = {
    'numpy': 'python3-numpy',
    'scipy': 'python3-scipy',
    'h5py': 'python3-h5py',
    'gsd': 'python3-gsd',
    'tqdm': 'python3-tqdm',
    'matplotlib': 'python3-matplotlib',
    'distributed': 'python3-distributed',
    'dask': 'python3-distributed',
    'PIL': 'python3-pil',
    'openmm': 'python3-openmm|python3-simtk',
    'pytest': 'python3-pytest'
}
#: The same for what only the site imports.
OF_SITE = {'nbformat': 'python3-nbformat'}
#: The same for the extensions and the theme that site/conf.py names.
EXTENSIONS = {
    'sphinx': 'python3-sphinx',
    'myst_parser': 'python3-myst-parser',
    'breathe': 'python3-breathe',
    'furo': 'furo'
}


def packages(file='packages-debian.txt'):
    return {line.split('#')[0].strip() for line in read(file).splitlines()} - {''}


def imported(name):
    for node in ast.walk(ast.parse(read(name))):
        if isinstance(node, ast.Import):
            yield from (alias.name.split('.')[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            yield node.module.split('.')[0]


def test_every_imported_module_has_its_package():
    own = {'openmmrigidhi'
           } | {part
                for name in git_files('*.py') for part in re.split(r'[/.]', name)}
    for name in git_files('*.py'):
        known = set(OF_SITE) if name.startswith('site/') else set()
        for module in set(imported(name)) - set(sys.stdlib_module_names) - own - known:
            assert module in MODULES, f'{name} imports {module}: which Debian package has it?'
            assert MODULES[module] in packages(
            ), f'{name} imports {module}: add {MODULES[module]} to packages-debian.txt'


#: What modules are called at PyPI and conda-forge, where the names differ.
ELSEWHERE = {
    'PIL': ['pillow'],
    'dask': ['distributed'],
    'matplotlib': ['matplotlib', 'matplotlib-base']
}


def test_what_the_package_imports_is_named_by_each_kind_of_package():
    """By the Debian package of Python modules, pyproject.toml, and the recipe for conda."""
    used = {module for name in git_files('python/*.py') for module in imported(name)}
    used -= set(sys.stdlib_module_names) | {'openmmrigidhi'}
    assert {'openmm', 'numpy', 'distributed', 'h5py'} <= used
    control = read('debian/control').split('Package: python3-openmm-rigidhi')[1]
    # Without the bounds on versions, which test_openmm_series.py checks.
    control = re.sub(r' \([^)]*\)', '', control)
    debian = set(re.findall(r'^[\w: ]* ((?:[\w.-]+ \| )?[\w.-]+),?$', control, flags=re.M))
    debian = {name.replace(' ', '') for name in debian}
    project = read('pyproject.toml').split('[project]')[1].split('[tool.scikit-build]')[0]
    project += read('pyproject.toml').split('[tool.scikit-build.metadata.dependencies]')[1]
    conda = re.findall(r"^    - (?:{{ pin_compatible\(')?([\w-]+)",
                       read('packaging/conda/meta.yaml').split('  run:')[1], flags=re.M)
    for module in sorted(used):
        assert MODULES[module] in debian, f'debian/control: {MODULES[module]} is not there'
        names = ELSEWHERE.get(module, [module])
        assert any(f'"{name}' in project for name in names), f'pyproject.toml: {names[0]}'
        assert set(names) & set(conda), f'packaging/conda/meta.yaml: {names[0]}'


def test_every_package_is_named_once():
    lines = [line.split('#')[0].strip() for line in read('packages-debian.txt').splitlines()]
    lines = [line for line in lines if line]
    assert len(lines) == len(set(lines))
    assert set(MODULES.values()) <= packages()


def test_what_the_site_uses_has_its_package():
    settings = runpy.run_path(str(ROOT/'site'/'conf.py'))
    used = {name.split('.')[0] for name in settings['extensions']} | {settings['html_theme']}
    assert used == set(EXTENSIONS)
    assert packages('site/packages-debian.txt') == {
        *EXTENSIONS.values(), *OF_SITE.values(), 'libjs-katex'
    }
    assert not packages('site/packages-debian.txt') & packages()
