"""Write the stubs of the SWIG module, from which editors and type checkers know its classes.

SWIG's Python files say nothing about types. The interface file has the declarations, and this
program turns them into _bindings.pyi, by the rules of the typemaps there. The build runs it beside
SWIG:

    python3 make_stubs.py directory openmmrigidhi.i SchemeList.h ModelList.h

with the lists (macros of rows) that enumerations of the interface are made from.

It also writes _enumerations.pyi, the enumerations of schemes, models and boundaries: at run time
they are made from the library's tables, which no editor reads.
"""
import pathlib
import re
import sys

HEADER = '# Written by python/make_stubs.py when the bindings are built: do not edit.\n'
BINDINGS = HEADER + '''from typing import Any, Optional, Union, overload

import numpy.typing as npt
import openmm

from ._enumerations import Boundary, Model, Scheme

_Buffer = Union[bytes, bytearray, memoryview, npt.NDArray[Any]]
version: str
openmmVersionOfBuild: str
'''
ENUMERATIONS = HEADER + '''import enum

from ._models import BoundaryTraits, ModelTraits
from ._schemes import SchemeTraits
'''
ENUMERATION = '''
class {name}(enum.IntEnum):
    @property
    def traits(self) -> {name}Traits: ...
'''
#: The enumerations that Python makes from a list, by the macro of the list.
LISTED = {'RIGIDHI_SCHEMES': 'Scheme', 'RIGIDHI_BOUNDARIES': 'Boundary', 'RIGIDHI_MODELS': 'Model'}
#: What Python passes for a type of C++, and gets for it.
GIVEN = {
    'bool': 'bool',
    'int': 'int',
    'double': 'float',
    'std::string': 'str',
    'std::vector<int>': '_Buffer',
    'std::vector<double>': '_Buffer',
    'std::vector<OpenMM::Vec3>': '_Buffer',
    'std::vector<RigidHIPlugin::QuaternionArray>': '_Buffer',
    'OpenMM::Vec3': '_Buffer',
    'OpenMM::Context': 'openmm.Context',
    'OpenMM::Force': 'openmm.Force',
    'OpenMM::Integrator': 'openmm.Integrator'
}
GOT = {
    **{each: 'bytearray' if stub == '_Buffer' else stub
       for each, stub in GIVEN.items()}, 'void': 'None',
    'PyObject': 'list[tuple[Any, ...]]',
    'JointDefinition': 'dict[str, Any]',
    'std::map<std::string,int>': 'dict[str, int]',
    'std::map<std::string,double>': 'dict[str, float]',
    'std::map<std::string,std::string>': 'dict[str, str]'
}


def stub_of(cpp, table, enumerations=(), classes=()):
    """The type in a stub of a type of C++; an error names one that no rule is known for."""
    plain = re.sub(r'\bconst\b|[&*\s]|\bRigidHIPlugin::(?=\w+\*)', '', cpp)
    if plain in enumerations:
        return 'int'
    if plain in classes:
        return f'Optional[{plain}]' if '*' in cpp else plain
    if plain not in table:
        raise SystemExit(f'make_stubs.py: got the type {cpp.strip()!r}; it must be one of '
                         f'{", ".join(table)}: add the type, and what its typemap takes or gives')
    return table[plain]


def split_arguments(text):
    """The declarations of the arguments; commas in angle brackets do not part them."""
    return [each.strip() for each in re.split(r',(?![^<]*>)', text) if each.strip()]


def is_result(argument):
    """Whether C++ fills in the argument, which Python then gets instead of passing it."""
    return '&' in argument and not argument.startswith('const') and 'Context&' not in argument


def function(returned, name, arguments, enumerations, classes, cls):
    """One line of a stub."""
    given, got = [], []
    for each in split_arguments(arguments):
        cpp, argument = re.fullmatch(r'(.*?)(\w+)', each, flags=re.S).groups()
        if is_result(each):
            got.append(stub_of(cpp, GOT, enumerations, classes))
        else:
            given.append(f'{argument}: {stub_of(cpp, GIVEN, enumerations, classes)}')
    isStatic = returned.startswith('static ')
    returned = stub_of(returned.replace('static ', ''), GOT, enumerations, classes)
    if got:
        # SWIG makes a list of several results.
        returned = 'list[Any]' if len(got) > 1 else got[0]
    if cls and not isStatic:
        given.insert(0, 'self')
    line = f'def {name}({", ".join(given)}) -> {returned}: ...'
    return ['@staticmethod', line] if isStatic else [line]


def enumerators(name, body, lists):
    """The names in an enumeration, which are written there or are those of a list."""
    macro = re.search(r'^\s*(RIGIDHI_\w+)\(', body, flags=re.M)
    found = lists.get(macro[1]) if macro else re.findall(r'(\w+) = \d+', body)
    if not found:
        raise SystemExit(f'make_stubs.py: enumeration {name}: no names were found; it must have '
                         'lines "name = number" or be made from a list: give the file of the list')
    return found


def class_of(name, base, body, lists, classes):
    """The lines of a class."""
    lines = [f'class {name}({base.replace("OpenMM::", "openmm.")}):']
    enumerations = {
        enumeration: enumerators(enumeration, values, lists)
        for enumeration, values in re.findall(r'enum (\w+) : int \{(.*?)\}', body, flags=re.S)
    }
    # The public class has members of its enumerations under these names. It writes down all of
    # them but those that are made from a list.
    lines += [
        f'    {each}: {enumeration if enumeration in LISTED.values() else "int"}'
        for enumeration, names in enumerations.items() for each in names
    ]
    lines += ['    this: Any', '    thisown: bool']
    body = re.sub(r'enum \w+ : int \{.*?\};', '', body, flags=re.S)
    body = re.sub(r'\{\s*return [^}]*\}', ';', body)
    found = {}
    for returned, method, arguments in re.findall(
            r'^\s*((?:[\w:<>&*, ]+[\s&*])?)(~?\w+)\(([^()]*)\)(?: const)?\s*;', body, flags=re.M):
        if method == name:
            returned, method = 'void', '__init__'
        if not method.startswith('~'):
            found.setdefault(method, []).append(
                function(returned.strip(), method, arguments, enumerations, classes, name))
    for overloads in found.values():
        for each in overloads:
            if len(overloads) > 1:
                lines.append('    @overload')
            lines += ['    ' + line for line in each]
    return lines


def rows_of(text):
    """The names of the rows of each list in a header, by the name of its macro."""
    return {
        macro: re.findall(r'^\s*ROW\((\w+)', rows, flags=re.M)
        for macro, rows in re.findall(r'^#define (\w+)\(ROW\)(.*?[^\\])$', text, flags=re.S | re.M)
    }


def stubs(interface, *lists):
    """The texts of _bindings.pyi and _enumerations.pyi."""
    lists = {macro: names for text in lists for macro, names in rows_of(text).items()}
    interface = re.sub(r'/\*.*?\*/|//[^\n]*', '', interface, flags=re.S)
    lines = []
    for block in re.findall(r'^%inline %\{(.*?)^%\}', interface, flags=re.S | re.M):
        for returned, name, arguments in re.findall(r'^([\w:]+[ *]+)(\w+)\((.*?)\) \{', block,
                                                    flags=re.M):
            lines += function(returned.strip(), name, arguments, (), (), None)
    found = re.findall(r'^class (\w+) : public ([\w:]+) \{(.*?)^\};', interface, flags=re.S | re.M)
    classes = {name for name, _, _ in found}
    for name, base, body in found:
        lines += ['', *class_of(name, base, body, lists, classes)]
    listed = ''.join(
        ENUMERATION.format(name=name) + ''.join(f'    {each} = {k}\n'
                                                for k, each in enumerate(lists[macro]))
        for macro, name in LISTED.items())
    return BINDINGS + '\n'.join(lines) + '\n', ENUMERATIONS + listed


def main(directory, *headers):
    texts = stubs(*(pathlib.Path(each).read_text(encoding='utf-8') for each in headers))
    for name, text in zip(('_bindings.pyi', '_enumerations.pyi'), texts):
        (pathlib.Path(directory)/name).write_text(text, encoding='utf-8')


if __name__ == '__main__':
    main(*sys.argv[1:])
