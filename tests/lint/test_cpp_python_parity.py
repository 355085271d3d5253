"""The C++ headers, the SWIG interface and the Python classes declare the same methods, parameters
and constants."""
import enum
import inspect
import re

import openmmrigidhi
import pytest
from conftest import read

INTERFACE = 'python/openmmrigidhi.i'
#: Every public class, whose header has its name.
CLASSES = ['CustomBodyForce', 'CustomBodyMotion', 'CustomRigidHIIntegrator', 'MobilityForce']

#: C++ parameters by reference and their names as results in Python.
RESULTS = {
    'getRigidBodyParameters': {'particles', 'mass', 'principalMoments', 'sitePositions'},
    'getBodyFriction': {'gamma', 'Gamma'},
    'getHingeMotorParameters': {'hinge', 'rate'},
    'getBodyParameters': {'bodyIndex', 'parameters'},
    'getChannelWalls': {'low', 'high'},
    'getLubricationReach': {'whole', 'nothing'},
    'getBackgroundFlow': {'velocity', 'gradient'},
    'getBodyForceOnFluidParameters': {'body', 'site', 'radius', 'force'},
    'getSinusoidalForceDensity': {'f0', 'forceAxis', 'waveAxis', 'waveVectorIndex'},
    'getShear': {'rate', 'flowAxis', 'gradientAxis'}
}
#: Python methods that C++ does not have, each with its reason.
PYTHON_ONLY = {
    'cast': 'OpenMM returns generic objects in Python only',
    'setIntegrationForceGroups': "OpenMM's own method, in Python with checks of what is given"
}
#: Setters that other methods undo or that have another getter, and why.
WITHOUT_GETTER = {}
INHERITED_GETTERS = {'getStepSize', 'getConstraintTolerance'}


def header(cls):
    return f'openmmapi/include/openmmrigidhi/{cls}.h'


def without_comments(text):
    return re.sub(r'//[^\n]*', '', re.sub(r'/\*.*?\*/', '', text, flags=re.S))


def class_body(text, cls):
    """The text between the braces of the class."""
    start = re.search(rf'class\s+(?:\w+\s+)?{cls}\s*:[^{{;]*{{', text).end()
    depth, end = 1, start
    while depth > 0:
        depth += {'{': 1, '}': -1}.get(text[end], 0)
        end += 1
    return text[start:end - 1]


def public_part(name, cls):
    text = read(name)
    # Methods that are marked @private are not for users.
    text = re.sub(r'/\*\*[\s*]*@private.*?\*/.*?;', '', text, flags=re.S)
    body = class_body(without_comments(text), cls)
    body = re.sub(r'%extend\s*{.*?\n    }', '', body, flags=re.S)
    return re.split(r'\b(?:protected|private)\s*:', body.split('public:', 1)[1])[0]


def declarations(name, cls):
    """Method declarations of the public part, in one form: 'int f(const A& a) const'."""
    body = re.sub(r'enum\b.*?};', '', public_part(name, cls), flags=re.S)
    # Replace bodies of one-line methods, after which another declaration follows.
    body = re.sub(r'{[^{}]*}', ';', body)
    found = [' '.join(declaration.split()) for declaration in body.split(';')]
    found = [
        re.sub(r' override$', '', d).replace('RigidHIPlugin::', '').replace('( ', '(')
        for d in found
    ]
    return [d for d in found if '(' in d and f'{cls}(' not in d]


def method(declaration):
    """Name and parameter names of a declaration."""
    name, parameters = re.match(r'.*?(\w+)\((.*)\)', declaration).groups()
    return name, [
        parameter.split()[-1].lstrip('&*') for parameter in parameters.split(',')
        if parameter.strip()
    ]


def names(cls):
    return {method(d)[0] for d in declarations(header(cls), cls)}


def listed(macro):
    """Names and numbers in one of the lists of schemes, models and boundaries."""
    lists = read('openmmapi/include/openmmrigidhi/internal/SchemeList.h') + read(
        'openmmapi/include/openmmrigidhi/internal/ModelList.h')
    rows = re.search(rf'^#define {macro}\(ROW\)(.*?[^\\])$', lists, flags=re.S | re.M)[1]
    names = re.findall(r'^    ROW\((\w+),', rows, flags=re.M)
    return [(name, str(number)) for number, name in enumerate(names)]


def enumerators(name, cls):
    found = {}
    for kind, values in re.findall(r'enum (\w+)\s*:\s*int\s*{(.*?)}', public_part(name, cls),
                                   flags=re.S):
        macro = re.search(r'(\w+)\(RIGIDHI_ROW\)', values)
        found[kind] = listed(macro[1]) if macro else re.findall(r'(\w+)\s*=\s*(\d+)', values)
    return found


def python_class(cls):
    return getattr(openmmrigidhi, cls)


def test_parsing_finds_the_methods():
    assert {'addRigidBody', 'setBodyFriction', 'getBodyOrientations', 'step'
            } <= names('CustomRigidHIIntegrator')
    assert len(declarations(header('CustomRigidHIIntegrator'), 'CustomRigidHIIntegrator')) > 40
    assert {'addParticle', 'getNumParticles', 'setLubrication', 'getMobilityInContext'
            } <= names('MobilityForce')
    assert ('LangevinC', '2') in enumerators(header('CustomRigidHIIntegrator'),
                                             'CustomRigidHIIntegrator')['Scheme']
    assert enumerators(header('MobilityForce'),
                       'MobilityForce')['Model'][3] == ('ForceCoupling', '3')
    assert ('SlipChannel', '3') in enumerators(header('MobilityForce'), 'MobilityForce')['Boundary']
    assert enumerators(header('MobilityForce'), 'MobilityForce')['Solver'] == [('Auto', '0'),
                                                                               ('Dense', '1'),
                                                                               ('MatrixFree', '2')]


def test_every_class_is_listed():
    interface = without_comments(read(INTERFACE))
    wrapped = set(re.findall(r'^class (\w+) : public', interface, flags=re.M))
    assert wrapped == set(CLASSES), 'add the class to the lists of tests/lint'


@pytest.mark.parametrize('cls', CLASSES)
def test_interface_repeats_the_header(cls):
    in_header, interface = set(declarations(header(cls), cls)), set(declarations(INTERFACE, cls))
    assert in_header - interface == set(), 'in the C++ header but not in the SWIG interface'
    assert interface - in_header == set(), 'in the SWIG interface but not in the C++ header'


@pytest.mark.parametrize('cls', CLASSES)
def test_constants_agree(cls):
    assert enumerators(header(cls), cls) == enumerators(INTERFACE, cls)
    for enumeration, constants in enumerators(header(cls), cls).items():
        assert list(vars(
            python_class(cls))[enumeration].__members__) == [name for name, _ in constants]
        for name, value in constants:
            assert name in vars(
                python_class(cls)), f'{name} is not a class attribute of the Python class'
            assert int(getattr(python_class(cls), name)) == int(value)


@pytest.mark.parametrize('cls, declaration',
                         [(cls, d) for cls in CLASSES for d in declarations(header(cls), cls)])
def test_python_class_has_the_method(cls, declaration):
    name, parameters = method(declaration)
    python = vars(python_class(cls)).get(name)
    assert python is not None, (
        f'{name} is not defined in the Python class: units would not be checked')
    expected = [p for p in parameters if p not in RESULTS.get(name, ())]
    assert list(inspect.signature(python).parameters)[1:][:len(expected)] == expected


@pytest.mark.parametrize('cls', CLASSES)
def test_python_methods_are_methods_of_the_header(cls):
    public = {
        name
        for name, value in vars(python_class(cls)).items()
        if not name.startswith('_') and callable(getattr(python_class(cls), name))
        and not isinstance(value, (int, enum.EnumMeta))
    }
    assert public - names(cls) - set(PYTHON_ONLY) == set()


@pytest.mark.parametrize('cls', CLASSES)
def test_every_setter_has_its_getter(cls):
    for name in names(cls):
        if name.startswith('set') and name not in WITHOUT_GETTER:
            assert 'get' + name[3:] in names(cls) | INHERITED_GETTERS, f'{name} has no getter'
