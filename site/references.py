"""Names in the text of pages lead to the Python reference, and the reference leads back to pages.

In the repository's Markdown a name is plain code, such as `setFriction()`. On the site it becomes a
link to the page of that method or function, if there is only one thing that it can mean.
"""
import inspect
import re

import openmm
import openmmrigidhi

CLASSES = ['CustomRigidHIIntegrator', 'MobilityForce', 'CustomBodyForce', 'CustomBodyMotion']
#: What names of objects in the pages' snippets are, for methods that several classes have.
OBJECTS = {'integrator': 'CustomRigidHIIntegrator', 'fluid': 'MobilityForce'}
PACKAGES = ('app', 'analysis')
#: Methods of OpenMM's classes, which a name alone may mean.
OF_OPENMM = {
    name
    for type_ in (openmm.System, openmm.Context, openmm.Integrator, openmm.CustomNonbondedForce,
                  openmm.CustomExternalForce, openmm.State, openmm.Platform) for name in dir(type_)
}
#: Pages that the page of a class leads back to.
PAGES = {
    'CustomRigidHIIntegrator': [('User guide', 'docs/guide/README'),
                                ('Bodies', 'docs/guide/bodies'),
                                ('State and quaternions', 'docs/guide/state'),
                                ('Thermostats with momenta', 'docs/guide/thermostats'),
                                ('Held and driven bodies', 'docs/guide/held_bodies'),
                                ('Joints', 'docs/guide/joints'),
                                ('Saving and resuming', 'docs/guide/saving'),
                                ('Schemes', 'docs/schemes/README'),
                                ('Cookbook', 'docs/cookbook/README'),
                                ('Conventions', 'docs/CONVENTIONS')],
    'MobilityForce': [('User guide', 'docs/guide/README'), ('A fluid', 'docs/guide/fluid'),
                      ('Boundaries and walls', 'docs/guide/walls'),
                      ('Periodic fluids', 'docs/guide/periodic'),
                      ('Lubrication', 'docs/guide/lubrication'),
                      ('Performance', 'docs/guide/performance'),
                      ('Bodies that swim', 'docs/guide/swimmers'), ('Models', 'docs/models/README'),
                      ('Driven flows', 'docs/models/driven_flows'),
                      ('Own tensors', 'docs/models/own_tensors'),
                      ('Cookbook', 'docs/cookbook/README')],
    'CustomBodyForce': [('Forces and torques on bodies', 'docs/guide/forces'),
                        ('Cookbook', 'docs/cookbook/README')],
    'CustomBodyMotion': [('Held and driven bodies', 'docs/guide/held_bodies'),
                         ('Cookbook', 'docs/cookbook/README')]
}


def back(name):
    """A line of links from the page of a class to pages of the documentation."""
    return 'Pages: ' + ' · '.join(f':doc:`{title} </{page}>`'
                                  for title, page in PAGES[name]) + '\n\n'


#: The folders with a page for each enumerator of an enumeration, and the class that has it.
ENUMERATIONS = {
    'docs/schemes': ('Scheme', 'CustomRigidHIIntegrator'),
    'docs/models': ('Model', 'MobilityForce')
}


def to_the_reference(page):
    """A line of links from the page of a scheme or model to the references of Python and C++."""
    folder, _, name = page.rpartition('/')
    if folder not in ENUMERATIONS:
        return ''
    enumeration, class_ = ENUMERATIONS[folder]
    if name not in getattr(getattr(openmmrigidhi, class_), enumeration).__members__:
        return ''
    return (f'\nIn the references: {{py:obj}}`Python <openmmrigidhi.{class_}.{name}>`, '
            f'{{cpp:enum}}`C++ <RigidHIPlugin::{class_}::{enumeration}>`.\n')


def with_pages(text):
    """A docstring whose names of pages, such as docs/schemes/LangevinC.md, lead there."""
    return re.sub(r'(?<![\w/`<])docs/(\w+(?:/\w+)*)\.md\b', r':doc:`docs/\1.md </docs/\1>`', text)


def _methods(name):
    return [
        each for each, value in vars(getattr(openmmrigidhi, name)).items()
        if not each.startswith('_') and (
            inspect.isfunction(value) or isinstance(value, staticmethod))
    ]


def names():
    """(prefix, name) -> full name; the prefix of a name that can mean one thing only is empty."""
    found, owners = {}, {}
    for class_ in CLASSES:
        for method in _methods(class_):
            owners.setdefault(method, []).append(class_)
            found.update({(each, method): f'openmmrigidhi.{class_}.{method}'
                          for each, type_ in OBJECTS.items() if type_ == class_})
            found[class_, method] = f'openmmrigidhi.{class_}.{method}'
        found['', class_] = found['openmmrigidhi', class_] = f'openmmrigidhi.{class_}'
    for method, classes in owners.items():
        if len(classes) == 1 and method not in OF_OPENMM:
            found['', method] = f'openmmrigidhi.{classes[0]}.{method}'
    for package in PACKAGES:
        module = getattr(openmmrigidhi, package)
        for name in module.__all__:
            if inspect.ismodule(getattr(module, name)):
                continue
            full = f'openmmrigidhi.{package}.{name}'
            found[package, name] = found[f'openmmrigidhi.{package}', name] = full
            # Short words such as `rod` and `show` have other meanings, too.
            if re.search(r'[a-z][A-Z]', name) and ('', name) not in found:
                found['', name] = full
    return found


#: Code within a line, and what code is left alone in: links, headings, blocks.
CODE = re.compile(r'(?<!`)`([^`\n]+)`(?!`)')
ALONE = re.compile(r'^```.*?^```|^:::.*?^:::|^#.*?$|!?\[(?:[^\[\]]|\[[^\]]*\])*\]\([^)]*\)',
                   flags=re.S | re.M)


def with_references(text, known):
    """The text of a page whose names of methods and functions are references."""
    def referred(found):
        name = re.fullmatch(r'(?:([\w.]+)\.)?(\w+)(\([^<>`]*\))?', found[1])
        full = name and known.get((name[1] or '', name[2]))
        return f'{{py:obj}}`{found[1]} <{full}>`' if full else found[0]

    parts, last = [], 0
    for each in ALONE.finditer(text):
        parts += [CODE.sub(referred, text[last:each.start()]), each[0]]
        last = each.end()
    return ''.join(parts + [CODE.sub(referred, text[last:])])
