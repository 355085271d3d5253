"""Pages of every public class and function.

Those of the Python package come from its docstrings, those of the C++ headers from Doxygen's XML by
Breathe.
"""
import contextlib
import enum
import importlib
import inspect
import io
import os
import re
import textwrap
import types
import xml.etree.ElementTree

import openmmrigidhi
from collect import ROOT
from references import CLASSES, back, with_pages

PACKAGES = ['app', 'analysis', 'accuracy', 'ensemble']


def write(source, xml_folder):
    """Write all pages, and return their names."""
    documents = _enumerators_of_cpp(xml_folder)
    pages = {'api/index': _index()}
    for name in CLASSES:
        pages[f'api/{name}'] = _page_of_large_class(getattr(openmmrigidhi, name), documents)
    for package in PACKAGES:
        pages |= _pages_of_package(importlib.import_module(f'openmmrigidhi.{package}'))
    pages |= _cpp_pages(xml_folder)
    for page, text in pages.items():
        file = source/(page + '.rst')
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding='utf-8')
    return list(pages)


def _heading(text, line='='):
    return f'{text}\n{line*len(text)}\n\n'


def _first_sentence(thing):
    """The text for a thing in a table: the first sentence of its docstring."""
    return _sentence(' '.join((inspect.getdoc(thing) or '').split('\n\n')[0].split()))


def _sentence(text):
    return re.split(r'(?<=[^.\d][.:])\s+(?=[A-Z`*])', text + ' ', maxsplit=1)[0].strip().rstrip(':')


def _table(rows):
    """A table of (reference, sentence)."""
    lines = ['.. list-table::', '   :widths: 35 65', '   :class: summary', '']
    for reference, sentence in rows:
        lines += [f'   * - {reference}', f'     - {sentence}']
    return '\n'.join(lines) + '\n\n'


def _index():
    functions = [
        name for name in openmmrigidhi.__all__ if inspect.isfunction(getattr(openmmrigidhi, name))
    ]
    text = _heading('Python reference') + '.. module:: openmmrigidhi\n\n'
    text += (
        'Arguments are numbers in OpenMM\'s units or quantities, whose dimension is checked. What '
        'is returned has units wherever it has a dimension. '
        'Each page is the docstring that ``help()`` shows.\n\n')
    text += _heading('Classes', '-') + _table(
        (f':class:`{name} <openmmrigidhi.{name}>`', _first_sentence(getattr(openmmrigidhi, name)))
        for name in CLASSES)
    text += _heading('Packages', '-') + _table(
        (f':mod:`openmmrigidhi.{name}`', _first_sentence(getattr(openmmrigidhi, name)))
        for name in PACKAGES)
    text += _heading('Functions', '-') + ''.join(f'.. autofunction:: openmmrigidhi.{name}\n\n'
                                                 for name in functions)
    return text


# ---- Packages ------------------------------------------------------------------------------------


def _pages_of_package(package):
    """One page for the package, and one for each thing and each module that it exports."""
    name = package.__name__
    short = name.rsplit('.', 1)[1]
    exported = [(each, getattr(package, each)) for each in package.__all__]
    modules = [each for each in exported if isinstance(each[1], types.ModuleType)]
    kinds = [('Functions', [each for each in exported if inspect.isfunction(each[1])]),
             ('Classes', [each for each in exported if inspect.isclass(each[1])])]
    own = [
        f'{type_.__module__}.{type_.__name__}' for _, type_ in exported
        if not isinstance(type_, types.ModuleType)
    ]
    text = _heading(name) + f'.. automodule:: {name}\n   :no-members:\n\n'
    pages = {}
    for title, members in kinds:
        if members:
            text += _heading(title, '-')
            text += _table(
                (f':{"class" if title == "Classes" else "func"}:`{each} <{name}.{each}>`',
                 _first_sentence(thing)) for each, thing in members)
        for each, thing in members:
            body = _class(name, each,
                          thing) if title == 'Classes' else f'.. autofunction:: {name}.{each}\n'
            pages[f'api/{short}/{each}'] = _heading(each) + f'.. currentmodule:: {name}\n\n' + body
    if modules:
        text += _heading('Modules', '-') + _table(
            (f':mod:`{thing.__name__}`', _first_sentence(thing)) for _, thing in modules)
    for each, module in modules:
        pages[f'api/{short}/{each}'] = _page_of_module(module, own)
    pages[f'api/{short}/index'] = text + _command_line(package)
    return pages


def _page_of_module(module, elsewhere):
    text = _heading(module.__name__) + f'.. automodule:: {module.__name__}\n   :no-members:\n\n'
    for name, thing in vars(module).items():
        if name.startswith('_') or getattr(
                thing, '__module__',
                None) != module.__name__ or f'{module.__name__}.{name}' in elsewhere:
            continue
        if inspect.isclass(thing):
            text += _class(module.__name__, name, thing) + '\n'
        elif inspect.isfunction(thing):
            text += f'.. autofunction:: {module.__name__}.{name}\n\n'
    return text


def _class(module, name, type_):
    """A class with its methods; the docstring of a tuple describes its fields."""
    fields = getattr(type_, '_fields', None) or getattr(type_, '__dataclass_fields__', ())
    without = f'\n   :exclude-members: {", ".join(fields)}' if fields else ''
    return f'.. autoclass:: {module}.{name}\n   :members:{without}\n'


def _command_line(package):
    """The help of a package's own program."""
    try:
        cli = importlib.import_module(package.__name__ + '.cli')
    except ModuleNotFoundError:
        return ''
    said, columns = io.StringIO(), os.environ.get('COLUMNS')
    os.environ['COLUMNS'] = '100'
    with contextlib.redirect_stdout(said), contextlib.suppress(SystemExit):
        cli.main(['--help'])
    if columns is None:
        del os.environ['COLUMNS']
    else:
        os.environ['COLUMNS'] = columns
    lines = ''.join(f'   {line}\n' if line else '\n' for line in said.getvalue().split('\n'))
    return _heading(
        'From the shell',
        '-') + f'.. code-block:: text\n\n   $ python3 -m {package.__name__} --help\n{lines}\n'


# ---- The three classes ---------------------------------------------------------------------------


def _page_of_large_class(type_, documents):
    """A class with a table of its methods by purpose, its enumerations, then everything."""
    name = type_.__name__
    full = f'openmmrigidhi.{name}'
    text = _heading(f'{name} (Python)')
    text += f'.. currentmodule:: openmmrigidhi\n\n{_first_sentence(type_)}\n\n'
    text += back(name)
    for title, members in _purposes(type_):
        text += f'.. rubric:: {title}\n\n'
        text += _table((f':meth:`{each} <{full}.{each}>`', _first_sentence(getattr(type_, each)))
                       for each in members)
    # A module may have an enumeration under two names.
    enumerations = list(
        dict.fromkeys(thing for thing in vars(inspect.getmodule(type_)).values()
                      if inspect.isclass(thing) and issubclass(thing, enum.Enum) and all(
                          hasattr(type_, member.name) for member in thing)))
    if enumerations:
        text += _heading('Enumerations', '-')
    for each in enumerations:
        text += _heading(each.__name__, '~') + f'{with_pages(inspect.getdoc(each))}\n\n'
        for member in each:
            text += f'.. py:attribute:: {name}.{member.name}\n   :value: {member.value}\n\n'
            meaning = with_pages(_meaning(member, documents[name]))
            text += ''.join(f'   {line}\n' for line in meaning.split('\n')) + '\n'
    text += _heading(
        'The class', '-'
    ) + f'.. autoclass:: {full}\n   :members:\n   :exclude-members: {_enumerators(enumerations)}\n'
    return text


def _enumerators(enumerations):
    return ', '.join(member.name for each in enumerations for member in each) or 'nothing'


def _purposes(type_):
    """The methods of a class as the lines between them group them: (title, names)."""
    groups, title = {}, 'Making one'
    for line in inspect.getsource(type_).split('\n'):
        if heading := re.match(r'    # -{4} (.*?) -+$', line):
            title = heading[1]
        elif (method := re.match(r'    def ([a-zA-Z]\w*)\(', line)) and not isinstance(
                inspect.getattr_static(type_, method[1]), property):
            groups.setdefault(title, {})[method[1]] = None
    groups['Copies'] = groups.pop('Copies', {})
    return [(each, list(names)) for each, names in groups.items() if names]


def _meaning(member, documents):
    """The own docstring of an enumerator, or what the C++ header says."""
    own = inspect.getdoc(member)
    if own and own != inspect.getdoc(type(member)):
        return _with_formulas(own)
    return documents[member.name]


def _with_formulas(text):
    """A docstring of a scheme with the formulas of the scheme's page in place of plain text."""
    page = re.search(r'docs/schemes/\w+\.md', text)
    if not page:
        return text
    equation = re.search(r'^## Equation\n.*?^\$\$\n(.*?)^\$\$',
                         (ROOT/page[0]).read_text(encoding='utf-8'), flags=re.S | re.M)[1]
    formulas = '.. math::\n   :nowrap:\n\n' + textwrap.indent(rf'\[{equation}\]', '   ')
    text, number = re.subn(r'^(.*)::\n\n(?: {4}.*\n)+',
                           lambda found: f'{found[1]}:\n\n{formulas}\n', text, count=1, flags=re.M)
    assert number, text
    return text


def _enumerators_of_cpp(folder):
    """The documentation of enumerators in the headers, class by class."""
    found = {}
    for name in CLASSES:
        tree = xml.etree.ElementTree.parse(folder/f'classRigidHIPlugin_1_1{name}.xml')
        found[name] = {
            value.find('name').text: ' '.join(
                _text(value.find(kind))
                for kind in ('briefdescription', 'detaileddescription')).strip()
            for value in tree.iter('enumvalue')
        }
    return found


def _text(description):
    """What an element of Doxygen's XML says, in one line, with formulas as Sphinx reads them."""
    for formula in description.iter('formula'):
        formula.text = f':math:`{formula.text.strip("$ ")}`'
    return ' '.join(''.join(description.itertext()).split())


# ---- C++ -----------------------------------------------------------------------------------------


def _cpp_pages(folder):
    """One page for each public class and struct."""
    tree = xml.etree.ElementTree.parse(folder/'index.xml')
    compounds = [(each.find('name').text, each.get('kind'), each.get('refid'))
                 for each in tree.iter('compound') if each.get('kind') in ('class', 'struct')]
    text = _heading('C++ reference')
    text += (
        'Classes of the namespace ``RigidHIPlugin``, whose headers are in '
        '``openmmapi/include/openmmrigidhi``. '
        'A program links with ``libOpenMMRigidHI.so`` only; ``find_package(OpenMMRigidHI)`` finds '
        'it.\n\n')
    pages, rows = {}, []
    for name, kind, refid in compounds:
        details = xml.etree.ElementTree.parse(folder/f'{refid}.xml').find('compounddef')
        if details.get('prot') != 'public' or not details.find('location').get('file').startswith(
                'openmmapi/'):
            continue
        short = name.rsplit('::', 1)[-1]
        description = _sentence(_text(details.find('detaileddescription')))
        rows.append((f':cpp:{"class" if kind == "class" else "struct"}:`{name}`', description))
        pages[f'cpp/{short}'] = _heading(
            f'{short} (C++)') + f'.. doxygen{kind}:: {name}\n   :members:\n'
    pages['cpp/index'] = text + _table(rows)
    return pages
