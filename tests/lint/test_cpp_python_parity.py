"""The C++ header, the SWIG interface and the Python class declare the same methods, parameters and constants."""
import inspect
import re

import openmmrigidhi
import pytest
from conftest import read

HEADER = 'openmmapi/include/openmmrigidhi/CustomRigidHIIntegrator.h'
INTERFACE = 'python/openmmrigidhi.i'
CLASS = 'CustomRigidHIIntegrator'

#: Names that C++ parameters by reference have as results in Python.
RESULTS = {'getRigidBodyParameters': {'particles', 'mass', 'principalMoments', 'sitePositions'},
           'getBodyFriction': {'gamma', 'Gamma'}}
#: Python methods beyond C++, each with its reason.
PYTHON_ONLY = {'cast': 'OpenMM returns generic objects in Python only'}


def without_comments(text):
    return re.sub(r'//[^\n]*', '', re.sub(r'/\*.*?\*/', '', text, flags=re.S))


def class_body(text):
    """The text between the braces of the class."""
    start = re.search(rf'class\s+(?:\w+\s+)?{CLASS}\s*:[^{{;]*{{', text).end()
    depth, end = 1, start
    while depth > 0:
        depth += {'{': 1, '}': -1}.get(text[end], 0)
        end += 1
    return text[start:end-1]


def public_part(name):
    text = read(name)
    # What is marked @private is not for users.
    text = re.sub(r'/\*\* @private.*?\*/.*?;', '', text, flags=re.S)
    body = class_body(without_comments(text))
    body = re.sub(r'%extend\s*{.*?\n    }', '', body, flags=re.S)
    return re.split(r'\b(?:protected|private)\s*:', body.split('public:', 1)[1])[0]


def declarations(name):
    """Method declarations of the public part, in one form: 'int f(const A& a) const'."""
    body = re.sub(r'enum\b.*?};', '', public_part(name), flags=re.S)
    found = [' '.join(declaration.split()) for declaration in body.split(';')]
    found = [re.sub(r' override$', '', d).replace('RigidHIPlugin::', '').replace('( ', '(') for d in found]
    return [d for d in found if '(' in d and f'{CLASS}(' not in d]


def method(declaration):
    """Name and parameter names of a declaration."""
    name, parameters = re.match(r'.*?(\w+)\((.*)\)', declaration).groups()
    return name, [parameter.split()[-1].lstrip('&*') for parameter in parameters.split(',') if parameter.strip()]


def enumerators(name):
    return {enum: re.findall(r'(\w+)\s*=\s*(\d+)', values)
            for enum, values in re.findall(r'enum (\w+)\s*:\s*int\s*{(.*?)}', public_part(name), flags=re.S)}


def test_parsing_finds_the_methods():
    names = {method(d)[0] for d in declarations(HEADER)}
    assert {'addRigidBody', 'setBodyFriction', 'getBodyOrientations', 'step'} <= names
    assert len(declarations(HEADER)) > 40


def test_interface_repeats_the_header():
    header, interface = set(declarations(HEADER)), set(declarations(INTERFACE))
    assert header - interface == set(), 'in the C++ header but not in the SWIG interface'
    assert interface - header == set(), 'in the SWIG interface but not in the C++ header'


def test_constants_agree():
    assert enumerators(HEADER) == enumerators(INTERFACE)
    for constants in enumerators(HEADER).values():
        for name, value in constants:
            assert int(getattr(openmmrigidhi.CustomRigidHIIntegrator, name)) == int(value)


@pytest.mark.parametrize('declaration', declarations(HEADER))
def test_python_class_has_the_method(declaration):
    name, parameters = method(declaration)
    python = vars(openmmrigidhi.CustomRigidHIIntegrator).get(name)
    assert python is not None, f'{name} is not defined in the Python class: units would not be checked'
    expected = [p for p in parameters if p not in RESULTS.get(name, ())]
    assert list(inspect.signature(python).parameters)[1:][:len(expected)] == expected


def test_python_methods_are_methods_of_the_header():
    known = {method(d)[0] for d in declarations(HEADER)}
    public = {name for name, value in vars(openmmrigidhi.CustomRigidHIIntegrator).items()
              if not name.startswith('_') and callable(getattr(openmmrigidhi.CustomRigidHIIntegrator, name))
              and not isinstance(value, int)}
    assert public - known - set(PYTHON_ONLY) == set()


def test_every_setter_has_its_getter():
    names = {method(d)[0] for d in declarations(HEADER)}
    inherited = {'getStepSize', 'getConstraintTolerance'}
    for name in names:
        if name.startswith('set'):
            assert 'get' + name[3:] in names | inherited, f'{name} has no getter'
