"""Imports among the modules of the Python package make no circle, and none is inside a function.
Includes among the folders of platforms/common make no circle either."""
import ast
import re

import pytest
from conftest import git_files, read

PACKAGE = 'openmmrigidhi'
#: Modules that exist only after a build.
GENERATED = {f'{PACKAGE}._bindings', f'{PACKAGE}._openmmrigidhi'}
#: Allowed imports of the package's modules inside functions, (module, imported), each with its
#: reason.
IN_FUNCTIONS = {
    (f'{PACKAGE}._loading', f'{PACKAGE}._bindings'): 'if the binding module does not load, the '
    'error says from where and why',
}


def python_modules():
    """Name of each module -> its file."""
    names = {}
    for path in git_files('python/openmmrigidhi/*.py'):
        name = path[len('python/'):-len('.py')].replace('/', '.')
        names[name[:-len('.__init__')] if name.endswith('.__init__') else name] = path
    return names


def imports(name, source, isPackage, known):
    """The imports of known modules in a module: (line, imported module, whether within a function).

    Imports for type checkers alone never run.
    """
    package = name if isPackage else name.rpartition('.')[0]
    found = []

    def look(node, inFunction):
        for child in ast.iter_child_nodes(node):
            targets = []
            if isinstance(child, ast.If) and ast.unparse(child.test) == 'TYPE_CHECKING':
                child = ast.Module(child.orelse, [])
            if isinstance(child, ast.Import):
                targets = [alias.name for alias in child.names]
            elif isinstance(child, ast.ImportFrom):
                above = package.split('.')[:len(package.split('.')) - child.level +
                                           1] if child.level else []
                base = '.'.join([*above, *([child.module] if child.module else [])])
                targets = [
                    f'{base}.{alias.name}' if f'{base}.{alias.name}' in known else base
                    for alias in child.names
                ]
            found.extend(
                (child.lineno, target, inFunction) for target in targets if target in known)
            look(
                child, inFunction
                or isinstance(child, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)))

    look(ast.parse(source), False)
    return found


def needs(name, imported):
    """The modules that run before the importing one goes on: the imported module, and the packages
    that contain it but not the importing one."""
    parts = imported.split('.')
    chain = ['.'.join(parts[:k]) for k in range(1, len(parts) + 1)]
    return [one for one in chain if one == imported or not (name + '.').startswith(one + '.')]


def circles(graph):
    """Circles of a graph {node: nodes}: for each node that is on one, the shortest from it, each
    circle once."""
    found = {}
    for start in graph:
        before, queue = {}, [start]
        while queue and start not in before:
            node = queue.pop(0)
            for after in sorted(graph.get(node, ())):
                if after not in before:
                    before[after] = node
                    queue.append(after)
        if start in before:
            way = [start]
            while before[way[-1]] != start:
                way.append(before[way[-1]])
            found.setdefault(frozenset(way), [start, *reversed(way)])
    return list(found.values())


MODULES = python_modules()
IMPORTS = {
    name: imports(name, read(path), path.endswith('__init__.py'),
                  set(MODULES) | GENERATED)
    for name, path in MODULES.items()
}


def test_no_circles():
    graph = {
        name: {one
               for _, imported, _ in found for one in needs(name, imported)} - {name}
        for name, found in IMPORTS.items()
    }
    assert not circles(graph), '\n'.join(' -> '.join(circle) for circle in circles(graph))


def test_no_circles_of_rooms():
    """Each folder of platforms/common is a room: it includes headers of the rooms further inside,
    and no others (docs/ARCHITECTURE.md, Layout)."""
    graph = {}
    for path in git_files('platforms/common/*.h', 'platforms/common/*.cpp'):
        included = re.findall(r'^#include "(\w+)/', read(path), flags=re.M)
        graph.setdefault(path.split('/')[2], set()).update(included)
    assert len(graph) > 10
    graph = {room: rooms & set(graph) - {room} for room, rooms in graph.items()}
    assert not circles(graph), '\n'.join(' -> '.join(circle) for circle in circles(graph))


@pytest.mark.parametrize('name', MODULES)
def test_own_modules_are_imported_at_the_top(name):
    hidden = [
        f'line {line}: {imported}' for line, imported, inFunction in IMPORTS[name]
        if inFunction and (name, imported) not in IN_FUNCTIONS
    ]
    assert not hidden, (f'{name} imports in a function, where circles hide: {"; ".join(hidden)}: '
                        'import it at the top, or say in this file why not')


def test_reasons_are_still_needed():
    hidden = {(name, imported)
              for name, found in IMPORTS.items() for _, imported, inFunction in found if inFunction}
    assert set(IN_FUNCTIONS) <= hidden


def test_what_counts_as_a_circle():
    """Circles are found for two modules that import each other, also from within a function, and
    for two packages by the imports of their __init__. What type checkers import is no circle."""
    sources = {
        'p': '',
        'p.a': 'from .b import x\ndef f():\n    from . import c',
        'p.b': 'import numpy\nif TYPE_CHECKING:\n    from .a import X',
        'p.c': 'from . import a',
        'p.one': 'from .top import x',
        'p.one.top': 'from ..two.leaf import y',
        'p.two': 'from .root import z',
        'p.two.root': 'from ..one import x',
        'p.two.leaf': ''
    }
    packages = {'p', 'p.one', 'p.two'}
    found = {
        name: imports(name, source, name in packages, sources)
        for name, source in sources.items()
    }
    assert found['p.a'] == [(1, 'p.b', False), (3, 'p.c', True)]
    graph = {
        name: {one
               for _, imported, _ in each for one in needs(name, imported)} - {name}
        for name, each in found.items()
    }
    assert {frozenset(circle)
            for circle in circles(graph)} == {
                frozenset(('p.a', 'p.c')),
                frozenset(('p.one', 'p.one.top', 'p.two', 'p.two.root'))
            }
