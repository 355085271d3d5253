"""In README and docs, Python snippets run, links have targets, and commands exist."""
import pathlib
import re
import shutil
import subprocess
import sys

import pytest
from conftest import ROOT, git_files, read

sys.path.insert(0, str(ROOT/'site'))
import notebooks  # noqa: E402
from scripts import page_text  # noqa: E402

PAGES = git_files('*.md')
#: Pages whose snippets are complete scripts, each by itself.
COOKBOOK = [page for page in PAGES if page.startswith('docs/cookbook/')]


def snippets(page):
    """The ```python blocks of a page. Each block may need the earlier ones.

    Blocks that a recipe puts into files are no scripts. Parts of a script that the page shows are
    blocks, too.
    """
    text = re.sub(r'^<!-- recipe: [^\n]*-->\n```python\n.*?^```', '', page_text(page),
                  flags=re.S | re.M)
    return re.findall(r'^```python\n(.*?)^```', text, flags=re.S | re.M)


@pytest.mark.parametrize(
    'page', [page for page in PAGES if snippets(page) and page not in COOKBOOK + notebooks.PAGES])
def test_snippets_run(page, tmp_path, run_python):
    finished = run_python('\n'.join(snippets(page)), tmp_path, timeout=300, seeded=True)
    assert finished.returncode == 0, finished.stderr


@pytest.mark.parametrize('page', [page for page in PAGES if snippets(page)])
def test_snippets_fit_on_a_screen(page):
    """On a screen 1400 pixels wide the site has room for 112 columns of code."""
    wide = [line for snippet in snippets(page) for line in snippet.splitlines() if len(line) > 112]
    assert not wide, f'{page}: {wide}'


@pytest.mark.parametrize('page, number', [(page, number) for page in COOKBOOK
                                          for number in range(len(snippets(page)))])
def test_scripts_of_the_cookbook_run_by_themselves(page, number, tmp_path, run_python):
    finished = run_python(snippets(page)[number], tmp_path, seeded=True)
    assert finished.returncode == 0, finished.stderr
    assert 'Warning: ' not in finished.stderr, finished.stderr


def test_the_cookbook_lists_every_script():
    listed = re.findall(r'\]\((\w+\.md#[^)]+)\)', read('docs/cookbook/README.md'))
    headings = sum(len(re.findall(r'^## ', read(page), flags=re.M)) for page in COOKBOOK)
    assert len(set(listed)) == len(listed) == headings == sum(
        len(snippets(page)) for page in COOKBOOK)


def test_the_guide_leads_from_page_to_page():
    """The first page of the guide lists all others, and each one says what it is for and which one
    comes next."""
    listed = re.findall(r'^- \[([^]]*)\]\((\w+\.md)\): .', read('docs/guide/README.md'), flags=re.M)
    assert {f'docs/guide/{name}'
            for _, name in listed} | {'docs/guide/README.md'} == set(git_files('docs/guide/*.md'))
    for k, (title, name) in enumerate(listed):
        text = read(f'docs/guide/{name}')
        assert text.startswith(f'# {title}\nThis page is '), name
        following = f'Next: [{listed[k + 1][0]}]({listed[k + 1][1]}).' if k + 1 < len(
            listed) else 'Next: the [cookbook](../cookbook/README.md)'
        assert text.splitlines()[-1].startswith(following), f'{name}: {following}'
        assert len(text.split()) < 2500, f'{name} is long: make two pages of it'


@pytest.mark.parametrize('page',
                         git_files('docs/schemes/*.md', 'docs/models/*.md', 'docs/guide/*.md',
                                   'docs/theory/*.md'))
def test_names_of_source_files_are_links(page):
    dead = re.findall(
        r'(?<!\[)`((?:openmmapi|platforms|python|tests|docs|examples|validation|'
        r'benchmarks)/[\w./-]+\.\w+)`', read(page))
    assert not dead, f'{page}: make links of {", ".join(dead)}'


@pytest.mark.parametrize('page', [page for page in PAGES if not page.startswith('tests/')])
def test_no_page_needs_the_inside_of_a_quantity(page):
    """Users divide by a unit: integrator.getBodyPositions()/unit.nanometer."""
    assert '._value' not in read(page), f'{page}: divide by a unit instead of taking ._value'


@pytest.mark.parametrize('page', PAGES)
def test_links_lead_somewhere(page):
    text = re.sub(r'^```.*?^```', '', read(page), flags=re.S | re.M)
    here = (ROOT/page).parent
    for target in re.findall(r'\]\(([^)\s]+)\)', text):
        if target.startswith(('http:', 'https:')):
            continue
        file, _, anchor = target.partition('#')
        assert not file or (here/file).exists(), f'{page}: {target} is not there'
        if anchor:
            headings = re.findall(r'^#+ +(.*)$',
                                  read(page) if not file else (here/file).read_text(), flags=re.M)
            anchors = {
                re.sub(r'[^\w\- ]', '', heading.lower()).replace(' ', '-')
                for heading in headings
            }
            assert anchor in anchors, f'{page}: no heading makes the anchor {target}'


@pytest.mark.parametrize('page', PAGES)
def test_files_that_are_named_exist(page):
    here = (ROOT/page).parent
    for name in re.findall(
            r'`((?:openmmapi|platforms|serialization|python|tests|examples|validation|benchmarks|'
            r'docs|tools)/[\w./-]+)`', read(page)):
        assert (ROOT/name).exists() or (here/
                                        name).exists(), f'{page} names {name}, which is not there'


def test_make_targets_that_are_named_exist():
    makefile = read('Makefile')
    for page in PAGES:
        for target in re.findall(r'`make ([a-z-]+)', read(page)) + re.findall(
                r'^ *make ([a-z-]+)', read(page), flags=re.M):
            assert re.search(rf'^{target}:', makefile, flags=re.M), f'{page} names make {target}'


def test_parts_of_the_continuous_integration_are_make_targets():
    text = read('.ci/run')
    parts = re.search(r'^for part in (.+); do$', text, flags=re.M).group(1).split()
    assert {'test', 'lint'} < set(parts)
    limited = re.search(r'^ *([a-z|-]+)\)$', text, flags=re.M).group(1).split('|')
    assert set(limited) < set(parts)
    makefile = read('Makefile')
    for part in parts:
        assert re.search(rf'^{part}:', makefile, flags=re.M), f'.ci/run calls make {part}'


def test_every_public_method_is_in_a_guide_or_documented_reference():
    """A user guide need not repeat what docstrings say, but no guide may name a method that does
    not exist."""
    import openmmrigidhi
    known = set(dir(openmmrigidhi.CustomRigidHIIntegrator)) | set(dir(openmmrigidhi)) | set(
        dir(openmmrigidhi.app))
    known |= set(dir(openmmrigidhi.CustomBodyForce)) | set(dir(openmmrigidhi.MobilityForce))
    known |= set(dir(openmmrigidhi.CustomBodyMotion))
    for page in ('README.md', 'docs/CONVENTIONS.md', *git_files(
            'docs/guide/*.md', 'docs/theory/*.md', 'docs/schemes/*.md', 'docs/models/*.md')):
        for name in re.findall(r'`(?:openmmrigidhi\.app\.)?((?:get|set|compute|addRigid)\w+)\(?',
                               read(page)):
            openmms = {
                'setPositions', 'setVelocities', 'setVelocitiesToTemperature', 'setState',
                'getState', 'setPeriodicBoxVectors', 'setDefaultPeriodicBoxVectors',
                'setScaleMoleculesAsRigid'
            }
            assert name in known | openmms or name.startswith(
                'setIntegration'), f'{page} names {name}'


def test_the_theory_leads_to_each_of_its_pages_in_turn():
    """The index has the pages in the order in which each leads to the next one."""
    listed = re.findall(r'^- \[[^\]]+\]\((\w+\.md)\)', read('docs/theory/README.md'), flags=re.M)
    assert {f'docs/theory/{page}'
            for page in [*listed, 'README.md']} == set(git_files('docs/theory/*.md'))
    for page, following in zip(['README.md', *listed], listed):
        last = read(f'docs/theory/{page}').rstrip().splitlines()[-1]
        assert re.fullmatch(r'Next: \[[^\]]+\]\(' + re.escape(following) + r'\)\.', last), page


def test_pictures_are_not_huge():
    for name in git_files('*.png', '*.gif'):
        assert pathlib.Path(ROOT/name).stat().st_size < 1_000_000, f'{name} is larger than 1 MB'


def test_cpp_reference_builds_without_warnings(tmp_path):
    if shutil.which('doxygen') is None:
        pytest.skip('doxygen is not installed')
    settings = read('Doxyfile') + f'\nOUTPUT_DIRECTORY = {tmp_path}\n'
    finished = subprocess.run(['doxygen', '-'], input=settings, cwd=ROOT, capture_output=True,
                              text=True)
    assert finished.returncode == 0 and finished.stderr == ''
