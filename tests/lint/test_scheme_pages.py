"""Every scheme and every model has its page, with sections in one order, examples, and facts that
agree with the library and the benchmarks."""
import re

import openmm
import openmmrigidhi
import pytest
from conftest import cpp_files, git_files, read
from openmmrigidhi import _models, _schemes

SCHEMES = [scheme.name for scheme in openmmrigidhi.CustomRigidHIIntegrator.Scheme]
MODELS = [model.name for model in openmmrigidhi.MobilityForce.Model]
BOUNDARIES = [boundary.name for boundary in openmmrigidhi.MobilityForce.Boundary]
#: Sections of each kind of page, in their order.
OF_SCHEME = [
    'Equation', 'One step', 'Symbols', 'What it samples', 'Order', 'Cost', 'Limits and errors',
    'When to take it', 'When not to take it', 'Example', 'Paper'
]
OF_MODEL = [
    'Equation', 'Symbols', 'What it has', 'Accuracy', 'Boundaries', 'Cost', 'Limits and errors',
    'When to take it', 'When not to take it', 'Example', 'Paper'
]
OF_TOPIC = [
    'Equation', 'Symbols', 'What it does', 'Limits and errors', 'When to take it',
    'When not to take it', 'Example', 'Paper'
]
#: Pages about models that are not the page of one model.
TOPICS = ['driven_flows', 'free_particles', 'own_tensors']

PAGES = {f'docs/schemes/{name}.md': OF_SCHEME for name in SCHEMES}
PAGES.update({f'docs/models/{name}.md': OF_MODEL for name in MODELS})
PAGES.update({f'docs/models/{name}.md': OF_TOPIC for name in TOPICS})


def sections(page, level='##'):
    """The headings of a page, each with the text under it."""
    parts = re.split(rf'^{level} (.*)\n', read(page), flags=re.M)
    return dict(zip(parts[1::2], parts[2::2]))


def test_every_page_is_known():
    """Every page is in a list. Otherwise no test would check it, and no reader would find it."""
    written = set(git_files('docs/schemes/*.md', 'docs/models/*.md'))
    assert written == set(PAGES) | {'docs/schemes/README.md', 'docs/models/README.md'}


@pytest.mark.parametrize('page', PAGES)
def test_sections_are_there_in_their_order(page):
    found = sections(page)
    assert list(found) == PAGES[page]
    assert all(text.strip() for text in found.values()), f'{page} has an empty section'


@pytest.mark.parametrize('page', PAGES)
def test_page_has_equations_symbols_and_one_example(page):
    found = sections(page)
    assert '$$' in found['Equation']
    assert found['Symbols'].count(
        '\n|') > 3 and '| symbol | what it is | unit |' in found['Symbols']
    examples = re.findall(r'^```python\n(.*?)^```', read(page), flags=re.S | re.M)
    assert len(examples) == 1 and examples[0].count('\n') <= 25
    assert re.match('assert |print', examples[0].strip().splitlines()
                    [-1]), f'the example of {page} ends without a check or a number'
    assert max(map(len, examples[0].splitlines())) <= 130


#: Abbreviations whose dot does not end a sentence.
ABBREVIATIONS = (r'\b(?:[A-Z]|al|eqs?|Phys|Chem|Comput|Fluid|Mech|Int|Multiphase|Trans|Camb|Phil|'
                 r'Proc|Soc|Lond|Math|Sci|Eng)\. ')


@pytest.mark.parametrize('page', PAGES)
def test_page_is_one_sentence_a_line(page):
    """Sentences that share a line cannot be told apart in a diff."""
    text = re.sub(r'^```.*?^```|^\$\$\n.*?\n\$\$|^\|.*?$', '', read(page), flags=re.S | re.M)
    for line in text.splitlines():
        assert not re.search(r'[.!?] [A-Z`$]', re.sub(ABBREVIATIONS, '', line)), f'{page}: {line}'


@pytest.mark.parametrize('name', SCHEMES)
def test_page_has_the_facts_of_its_scheme(name):
    traits = openmmrigidhi.CustomRigidHIIntegrator.Scheme[name].traits
    page = read(_schemes.page(name))
    assert page.startswith(f'# {name}\n') and _schemes.facts(
        traits) in page, f'put this into the page: {_schemes.facts(traits)}'
    number = {1: 'one force evaluation', 2: 'two force evaluations'}[traits.forces]
    assert f'A step costs {number}' in sections(_schemes.page(name))['Cost']
    assert f'Weak order {traits.weakOrder} of averages' in sections(_schemes.page(name))['Order']
    assert re.search(rf'[oO]rder {traits.coldOrder} of trajectories at temperature 0',
                     sections(_schemes.page(name))['Order'])


@pytest.mark.parametrize('name', MODELS)
def test_page_has_every_boundary_of_its_model(name):
    text = sections(f'docs/models/{name}.md')['Boundaries']
    parts = re.split(r'^### (.*)\n', text, flags=re.M)
    assert parts[1::2] == BOUNDARIES
    for boundary, said in zip(parts[1::2], parts[2::2]):
        system, fluid = one_sphere(name, boundary)
        try:
            make_context(system, fluid)
            refused = False
        except openmm.OpenMMException:
            refused = True
        assert said.startswith('The model does not support this boundary'
                               ) == refused, f'{name}, {boundary}: the page says otherwise'


def one_sphere(model, boundary):
    system, fluid = openmm.System(), openmmrigidhi.MobilityForce()
    system.addParticle(1)
    fluid.addParticle(0.1)
    fluid.setModel(fluid.Model[model])
    fluid.setBoundary(fluid.Boundary[boundary])
    fluid.setChannelWalls(0, 1)
    system.addForce(fluid)
    return system, fluid


def make_context(system, fluid):
    integrator = openmmrigidhi.CustomRigidHIIntegrator(300, 0.001)
    integrator.setScheme(integrator.LangevinHI)
    integrator.addRigidBody([0], 1, (1, 1, 1), [(0, 0, 0)])
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setPositions([(0.5, 0.5, 0.5)])
    assert fluid.getMobilityInContext(context).shape == (6, 6)


def test_messages_that_are_quoted_are_those_of_the_library():
    """Messages on pages exist in the sources. Their parts between dots of omission are searched in
    the string literals."""
    texts = ''.join(
        re.sub(r'"\s*\n?\s*"', '', read(name)) for name in cpp_files()
        if name.startswith(('openmmapi', 'platforms')))
    for page in PAGES:
        for message in re.findall(r'"([^"\n]+)"', sections(page)['Limits and errors']):
            for part in re.split(r'…|\b[BN]\b', message):
                assert part.strip() in texts, f'{page}: no message has "{part.strip()}"'


def test_readme_and_guide_lead_to_every_page():
    assert _schemes.markdown(
        '') in read('docs/schemes/README.md'
                    ), f'put this table into docs/schemes/README.md:\n{_schemes.markdown("")}'
    for table in (_models.markdown(''), _models.markdown_of_boundaries()):
        assert table in read(
            'docs/models/README.md'), f'put this table into docs/models/README.md:\n{table}'
    for table in (_models.markdown(), _models.markdown_of_boundaries()):
        assert table in read('docs/guide/fluid.md'), (
            f'put this table into docs/guide/fluid.md, "Models and boundaries":\n{table}')
    guide = ''.join(read(page) for page in git_files('docs/guide/*.md'))
    for page in PAGES:
        folder, name = page.split('/')[1:]
        assert f']({name})' in read(
            f'docs/{folder}/README.md'), f'docs/{folder}/README.md does not lead to {name}'
        assert f'](../{folder}/{name})' in guide, f'docs/guide does not lead to {page}'


@pytest.mark.parametrize(
    'enumeration',
    [openmmrigidhi.CustomRigidHIIntegrator.Scheme, openmmrigidhi.MobilityForce.Model],
    ids=['Scheme', 'Model'])
def test_docstrings_of_enumerators_lead_to_their_pages(enumeration):
    folder = {'Scheme': 'schemes', 'Model': 'models'}[enumeration.__name__]
    assert f'docs/{folder}/README.md' in enumeration.__doc__
    for member in enumeration:
        assert f'docs/{folder}/{member.name}.md' in member.__doc__
