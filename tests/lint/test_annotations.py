"""Annotations of the Python package, and the stubs of the SWIG module, from which editors know what
functions take and give."""
import ast
import importlib
import inspect
import pathlib
import re
import shutil
import subprocess
import sys
import typing

import numpy.typing
import openmm.app
import pytest
from conftest import ROOT, read
from test_docstrings import modules

import openmmrigidhi

sys.path.insert(0, str(ROOT/'python'))
import make_stubs  # noqa: E402  (a program beside the package)

INTERFACE = 'python/openmmrigidhi.i'
LISTS = ('openmmapi/include/openmmrigidhi/internal/SchemeList.h',
         'openmmapi/include/openmmrigidhi/internal/ModelList.h')
#: Modules that annotations name, and that the package imports only where they are used.
OPTIONAL = ('distributed', 'h5py', 'matplotlib.axes', 'matplotlib.axis', 'matplotlib.figure')

# ---- Functions -----------------------------------------------------------------------------------


def is_ours(thing):
    module = getattr(thing, '__module__', None) or ''
    return module.split('.')[0] == 'openmmrigidhi' and module != 'openmmrigidhi._bindings'


def public_functions():
    """(name, function) of all that users can call, methods of base classes included."""
    for module in modules():
        for name, value in vars(module).items():
            shown = name in getattr(module, '__all__',
                                    ()) or getattr(value, '__module__', None) == module.__name__
            if name.startswith('_') or not shown or not is_ours(value):
                continue
            if inspect.isfunction(value):
                yield f'{value.__module__}.{name}', value
            elif inspect.isclass(value):
                for base in filter(is_ours, value.__mro__):
                    for member, function in vars(base).items():
                        function = getattr(function, 'fget', getattr(function, '__func__',
                                                                     function))
                        # Dataclasses make functions from annotated fields.
                        if inspect.isfunction(
                                function) and function.__code__.co_filename != '<string>' and (
                                    not member.startswith('_') or member == '__init__'):
                            yield f'{base.__module__}.{base.__qualname__}.{member}', function


FUNCTIONS = dict(public_functions())


def names_in_annotations():
    """What is imported for type checkers only."""
    names = {'npt': numpy.typing, 'openmm': openmm, 'unit': openmm.unit}
    for module in modules():
        names.update({
            name: value
            for name, value in vars(module).items() if inspect.isclass(value) and is_ours(value)
        })
        names.setdefault(module.__name__.split('.')[-1], module)
    for name in OPTIONAL:
        try:
            importlib.import_module(name)
        except ImportError:
            names[name.split('.')[0]] = typing.Any
        else:
            names[name.split('.')[0]] = sys.modules[name.split('.')[0]]
    return names


NAMES = names_in_annotations()


def test_functions_are_found():
    assert {
        'openmmrigidhi.integrator.CustomRigidHIIntegrator.setFriction',
        'openmmrigidhi.app.bodies.addRigidWater', 'openmmrigidhi._tasks.run',
        'openmmrigidhi.accuracy._results.Result.writeJson',
        'openmmrigidhi.accuracy.scenes.Scene.system', 'openmmrigidhi.accuracy.scenes.Scene.__init__'
    } <= set(FUNCTIONS)
    assert len(FUNCTIONS) > 400


@pytest.mark.parametrize('name', FUNCTIONS)
def test_public_functions_are_annotated(name):
    """Every parameter and the result have a type, and every type is one."""
    function = FUNCTIONS[name]
    signature = inspect.signature(function)
    # A method's own object has none.
    isMethod = '.'.join(name.split('.')[:-1]) not in sys.modules
    own = ('self', 'cls') if isMethod else ()
    without = [
        parameter.name for parameter in signature.parameters.values()
        if parameter.annotation is parameter.empty and parameter.name not in own
    ]
    assert not without, f'{name}: parameters without annotations: {", ".join(without)}'
    assert signature.return_annotation is not signature.empty, f'{name}: annotate its result'
    module = sys.modules[function.__module__]
    typing.get_type_hints(function, {**NAMES, **vars(module)})


@pytest.mark.parametrize('name', FUNCTIONS)
def test_none_as_a_default_is_in_the_annotation(name):
    for parameter in inspect.signature(FUNCTIONS[name]).parameters.values():
        if parameter.default is None:
            assert re.match(r'Optional\[|Any$', str(
                parameter.annotation)), (f'{name}: {parameter.name} may be None: annotate it as '
                                         f'Optional[{parameter.annotation}]')


# ---- Stubs ---------------------------------------------------------------------------------------


def members(path):
    """Class -> method -> parameters of a Python file, those of modules under the class None."""
    found = {None: {}}
    for node in ast.parse(path.read_text(encoding='utf-8')).body:
        if isinstance(node, ast.FunctionDef):
            found[None][node.name] = [argument.arg for argument in node.args.args]
        elif isinstance(node, ast.ClassDef):
            found[node.name] = {
                function.name: [argument.arg for argument in function.args.args]
                for function in node.body if isinstance(function, ast.FunctionDef)
            }
    return found


def test_stubs_say_what_swig_made(package_directory):
    stubs, made = members(package_directory/'_bindings.pyi'), members(
        package_directory/'_bindings.py')
    assert {'CustomRigidHIIntegrator', 'MobilityForce', 'CustomBodyForce', 'CustomBodyMotion'
            } <= set(stubs)
    for cls in stubs:
        mine, swigs = stubs[cls], made[cls]
        hidden = '__repr__' if cls else '_swig'
        assert set(mine) == {name for name in swigs if not name.startswith(hidden)}, cls
        for name, parameters in mine.items():
            # SWIG gives overloads one signature.
            if not swigs[name] == ['self'] or len(parameters) == 1:
                assert parameters == swigs[name], f'{cls}.{name}'


def test_stubs_have_every_enumerator(package_directory):
    bindings = openmmrigidhi._bindings
    tree = ast.parse((package_directory/'_bindings.pyi').read_text(encoding='utf-8'))
    for node in tree.body:
        if isinstance(node, ast.ClassDef):
            constants = {
                name
                for name, value in vars(getattr(bindings, node.name)).items()
                if isinstance(value, int) and not name.startswith('_')
            }
            assert constants == {
                each.target.id
                for each in node.body if isinstance(each, ast.AnnAssign)
            } - {'this', 'thisown'}, node.name


@pytest.mark.parametrize('enumeration', [
    openmmrigidhi.CustomRigidHIIntegrator.Scheme, openmmrigidhi.MobilityForce.Model,
    openmmrigidhi.MobilityForce.Boundary
])
def test_the_stub_of_an_enumeration_is_its_table(package_directory, enumeration):
    text = (package_directory/'_enumerations.pyi').read_text(encoding='utf-8')
    members = re.search(rf'^class {enumeration.__name__}\(.*?(?=^class|\Z)', text, re.M | re.S)[0]
    assert [(name, int(number)) for name, number in re.findall(r'^    (\w+) = (\d+)', members, re.M)
            ] == [(each.name, each.value) for each in enumeration]


def test_results_of_the_bindings_have_the_types_of_the_stubs():
    """The rules of make_stubs.py are those of the typemaps: one call for each kind of result."""
    integrator = openmmrigidhi._bindings.CustomRigidHIIntegrator(300.0, 0.001)
    fluid = openmmrigidhi._bindings.MobilityForce()
    hints = dict(
        re.findall(r'def (\w+)\(.*\) -> (.*): \.\.\.',
                   make_stubs.stubs(read(INTERFACE), *map(read, LISTS))[0]))
    for method, call in (('getTemperature', integrator.getTemperature),
                         ('getScheme', integrator.getScheme), ('getNumRigidBodies',
                                                               integrator.getNumRigidBodies),
                         ('resetBodyGeometry',
                          integrator.resetBodyGeometry), ('getChannelWalls', fluid.getChannelWalls),
                         ('getGroups', fluid.getGroups), ('getLubrication', fluid.getLubrication),
                         ('libraryPath', openmmrigidhi._bindings.libraryPath),
                         ('schemeTable', openmmrigidhi._bindings.schemeTable)):
        name = type(call()).__name__.replace('NoneType', 'None')
        assert hints[method].split('[')[0] == name, method


def test_an_unknown_type_in_the_interface_is_an_error():
    interface = 'class Odd : public OpenMM::Force {\npublic:\n    void setOdd(%s odd);\n};\n'
    assert 'def setOdd(self, odd: float)' in make_stubs.stubs(interface % 'double',
                                                              *map(read, LISTS))[0]
    with pytest.raises(SystemExit, match="got the type 'std::set<int>'; it must be one of bool, "):
        make_stubs.stubs(interface % 'std::set<int>', *map(read, LISTS))


def test_an_enumeration_without_names_is_an_error():
    interface = 'class Odd : public OpenMM::Force {\n    enum Kind : int {\n%s\n    };\n};\n'
    assert 'LangevinA: int' in make_stubs.stubs(interface % '        RIGIDHI_SCHEMES(ROW)',
                                                *map(read, LISTS))[0]
    with pytest.raises(SystemExit, match='enumeration Kind: no names were found'):
        make_stubs.stubs(interface % '        RIGIDHI_ODD(ROW)', *map(read, LISTS))


# ---- Type checkers -------------------------------------------------------------------------------

#: What mypy does not look for in the package. It looks whether annotations are types, and whether
#: functions return what they say. OpenMM has no annotations, so mypy knows too little of what
#: functions do inside. Methods of SWIG's classes are redefined with arguments and results that have
#: units.
DISABLED = ('attr-defined', 'index', 'operator', 'union-attr', 'assignment', 'call-overload',
            'var-annotated', 'has-type', 'override', 'str-bytes-safe', 'arg-type', 'misc',
            'type-var', 'call-arg')
#: What a type checker knows of this package in a user's program; it must accept all lines.
PROGRAM = '''
import openmm
from openmm import unit

from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce, accuracy, analysis, app, ensemble

integrator = CustomRigidHIIntegrator(300*unit.kelvin, 0.004)
integrator.setScheme(CustomRigidHIIntegrator.TrapezoidalSlip)
integrator.setScheme('TrapezoidalSlip')
order: int = CustomRigidHIIntegrator.Scheme.LangevinC.traits.weakOrder
index: int = integrator.addRigidBody([0, 1, 2])
fluid = MobilityForce()
fluid.setModel(MobilityForce.Model.ForceCoupling)
fluid.setBoundary('Periodic')
fluid.addParticle(0.3*unit.nanometer)
rows: int = len(fluid.getGroups())
system = openmm.System()
body: int = app.addRigidMultiblob(system, integrator, fluid, [(0, 0, 0), (1, 0, 0)], 0.5)
places = app.readVertexFile('shell.vertex').mean(axis=0)
sites, radii = app.readVertexFile('shell.vertex', True)
result = accuracy.StudyResult.fromJson('results.json')
advice: str = result.recommend('potential_energy:1%').text
'''
#: Lines that it must refuse, and what mypy says.
WRONG = (('integrator.setScheme(0.5)', 'Argument 1 to "setScheme"'),
         ('integrator.addRigidBody("water")', 'Argument 1 to "addRigidBody"'),
         ('fluid.setLubrication(0.5)', 'Argument 1 to "setLubrication"'),
         ('fluid.setBoundary(MobilityForce.Periodic, 1)', 'Too many arguments for "setBoundary"'),
         ('CustomRigidHIIntegrator.Scheme.TrapezoidalSlop', 'has no attribute "TrapezoidalSlop"'),
         ('result.recommend(1)',
          'Argument 1 to "recommend"'), ('ensemble.tasks.run(len, [1], jobs="2")',
                                         'Argument "jobs" to "run"'))


@pytest.fixture(scope='module')
def mypy(tmp_path_factory):
    """Run mypy on PROGRAM and the package together; returns what it says, as lines."""
    if shutil.which('mypy') is None:
        pytest.skip('mypy is not installed')
    version = subprocess.run(['mypy', '--version'], capture_output=True, text=True).stdout.strip()
    if not version.startswith('mypy 1.0.'):
        pytest.skip(f'what mypy says is known for mypy 1.0, that of Debian 12; this is {version}')
    folder = tmp_path_factory.mktemp('mypy')
    program, settings = folder/'program.py', folder/'mypy.ini'
    program.write_text(PROGRAM + ''.join(line + '\n' for line, _ in WRONG))
    package = pathlib.Path(openmmrigidhi.__file__).parent
    settings.write_text(
        f'[mypy]\nignore_missing_imports = True\nmypy_path = {package.parent}\ncache_dir = cache\n'
        f'[mypy-openmmrigidhi.*]\ndisable_error_code = {", ".join(DISABLED)}\n')
    finished = subprocess.run(['mypy', '--config-file', settings, program], cwd=folder,
                              capture_output=True, text=True)
    assert not finished.stderr, finished.stderr
    return [line for line in finished.stdout.splitlines() if ': error: ' in line]


def test_mypy_accepts_the_annotations_of_the_package(mypy):
    found = [line for line in mypy if not line.startswith('program.py:')]
    assert not found, '\n'.join(found)


def test_mypy_knows_the_package_in_users_programs(mypy):
    found = [line for line in mypy if line.startswith('program.py:')]
    first = PROGRAM.count('\n') + 1
    for k, (line, said) in enumerate(WRONG):
        assert any(text.startswith(f'program.py:{first + k}: ') and said in text
                   for text in found), f'{line}:\n' + '\n'.join(found)
    assert len(found) == len(WRONG), '\n'.join(found)


def test_the_package_says_that_it_is_typed(package_directory):
    for name in ('py.typed', '_bindings.pyi', '_enumerations.pyi'):
        assert pathlib.Path(package_directory/name).exists(), name
