"""The site is built without a warning, has a page for every public object, and its check finds the
faults that it should find."""
import collections
import enum
import importlib.util
import inspect
import json
import os
import re
import shutil
import subprocess
import sys
import types
import xml.etree.ElementTree
from html import unescape

import openmmrigidhi
import PIL.Image
import pytest
from conftest import ROOT, git_files, read

sys.path.insert(0, str(ROOT/'site'))
import apipages  # noqa: E402
import check  # noqa: E402
import collect  # noqa: E402
import gallery  # noqa: E402
import notebooks  # noqa: E402
import references  # noqa: E402

GOOD = ('<html><body id="top"><a href="other.html#here">there</a>'
        '<img src="a.png" alt="Two spheres"></body></html>')
OTHER = ('<html><body><p id="here"></p><a href="index.html">back</a>'
         '<a href="https://openmm.org">OpenMM</a></body></html>')


@pytest.fixture
def pages(tmp_path):
    (tmp_path/'index.html').write_text(GOOD)
    (tmp_path/'other.html').write_text(OTHER)
    (tmp_path/'a.png').write_bytes(b'')
    return tmp_path


def test_check_is_content_with_good_pages(pages):
    assert check.faults(pages) == []


@pytest.mark.parametrize(
    'good, bad, said',
    [('other.html#here', 'another.html', 'another.html is not there'),
     ('other.html#here', 'other.html#there', 'leads to no place on that page'),
     ('other.html#here', '#here', 'leads to no place on that page'),
     ('other.html#here', '../index.html', 'is not there'),
     ('src="a.png"', 'src="b.png"', 'b.png is not there'),
     (' alt="Two spheres"', '', 'has no text alternative'),
     ('Two spheres', ' ', 'has no text alternative'),
     ('Two spheres', 'a.png', 'has no text alternative'),
     ('src="a.png"', 'src="https://openmm.org/a.png"', 'is fetched from elsewhere'),])
def test_check_finds(pages, good, bad, said):
    assert good in GOOD
    (pages/'index.html').write_text(GOOD.replace(good, bad))
    found = check.faults(pages)
    assert len(found) == 1 and said in found[0] and found[0].startswith('index.html: ')


@pytest.mark.parametrize('style, said',
                         [('@import url(/elsewhere.css);', 'is not there'),
                          ('a { background: url("https://openmm.org/a.png") }', 'from elsewhere')])
def test_check_looks_into_styles(pages, style, said):
    (pages/'style.css').write_text(style)
    assert len(check.faults(pages)) == 1 and said in check.faults(pages)[0]


def test_check_looks_into_scripts(pages):
    (pages/'index.html').write_text(
        GOOD.replace('</body>', '<script src="a.js?digest=1"></script></body>'))
    (pages/'a.js').write_text('const a = 1;\n')
    assert check.faults(pages) == []
    (pages/'a.js').write_text('import b from "./b.js";\n')
    assert check.faults(pages) == [
        'index.html: a.js?digest=1 is a module, but is loaded as a plain script'
    ]


def test_check_wants_pages(tmp_path):
    assert 'there are no pages' in check.faults(tmp_path)[0]


@pytest.mark.parametrize('page', [page for page in git_files('*.md') if '![' in read(page)])
def test_pictures_have_a_text_alternative(page):
    for words, picture in re.findall(r'!\[([^\]]*)\]\(([^)]*)\)', read(page)):
        assert words.strip(
        ) and not words.endswith('.png'), f'{page}: say in words what {picture} shows'


@pytest.mark.parametrize(
    'text, expected',
    [('[a](../docs/theory/walls.md#on-a-grid)', '[a](docs/theory/walls.md#on-a-grid)'),
     ('[`code`](../README.md) and `[b](../README.md)`',
      '[`code`](README.md) and `[b](../README.md)`'), ('[a\nb](../docs)', 'a\nb'),
     ('[a](https://openmm.org) [b](#here)', '[a](https://openmm.org) [b](#here)'),
     ('```text\n[a](../docs/INSTALL.md)\n```', '```text\n[a](../docs/INSTALL.md)\n```'),])
def test_links_lead_on_the_site_to_what_they_lead_to_in_the_repository(text, expected, tmp_path):
    assert collect.links_of_the_site(text, 'site/index.md', collect.markdown_files(),
                                     tmp_path) == expected


FRICTION = '{py:obj}`setFriction(5) <openmmrigidhi.CustomRigidHIIntegrator.setFriction>`'


@pytest.mark.parametrize(
    'text, expected',
    [('Call `setFriction(5)`.', f'Call {FRICTION}.'),
     ('`fluid.addParticle(1)`',
      '{py:obj}`fluid.addParticle(1) <openmmrigidhi.MobilityForce.addParticle>`'),
     ('`app.rod`', '{py:obj}`app.rod <openmmrigidhi.app.rod>`'),
     # A System has particles, too, a rod is a body, and parameters belong to two classes.
     ('`addParticle()` `rod` `addPerBodyParameter()`',
      '`addParticle()` `rod` `addPerBodyParameter()`'),
     ('# `setFriction(5)`\n[`setFriction(5)`](a.md) `setFriction(5)`',
      f'# `setFriction(5)`\n[`setFriction(5)`](a.md) {FRICTION}'),
     ('```python\n`setFriction(5)`\n```', '```python\n`setFriction(5)`\n```'),])
def test_names_lead_to_the_reference_where_they_mean_one_thing(text, expected):
    assert references.with_references(text, references.names()) == expected


@pytest.mark.parametrize('box, corner', [((0, 0, 0.5, 1), (20, 30)), ((0.5, 0, 1, 0.5), (120, 10)),
                                         ((0.4, 0.5, 1, 1), (110, 60))])
def test_thumbnails_show_one_panel(box, corner):
    """Three panels, of which one goes over both rows: black, 60 pixels wide, and a bar on top of
    none."""
    image = PIL.Image.new('RGB', (200, 100), 'white')
    for place in ((20, 30, 80, 70), (120, 10, 180, 40), (110, 60, 190, 90)):
        image.paste('black', place)
    panel = gallery.panel(image, box)
    assert panel.size == {20: (60, 40), 120: (60, 30), 110: (80, 30)}[corner[0]]
    assert panel.getcolors() == [(panel.width*panel.height, (0, 0, 0))]


def test_thumbnails_want_a_gap_between_panels():
    image = PIL.Image.new('RGB', (200, 100), 'black')
    assert gallery.panel(image, (0, 0, 0.5, 1)) is None


def test_panels_belong_to_examples():
    assert all((ROOT/'examples'/name/'README.md').exists() for name in gallery.PANELS)


def test_first_page_leads_three_kinds_of_readers_to_five_pages_each():
    text = read('site/index.md')
    paths = text.split('\n### ')[1:]
    assert len(paths) == 3
    for path in paths:
        targets = [
            target.partition('#')[0]
            for target in re.findall(r'^\d\. \[[^\]]+\]\(([^)]+)\)', path, flags=re.M)
        ]
        assert len(set(targets)) == 5, f'{path.splitlines()[0]}: {targets}'


#: Runs the script of versions on a page with a server that has some files, chooses a version if a
#: list is shown, and prints what is shown, where the page goes then, and what it fetched.
STAGE = """
const [script, root, page, files, chosen] = JSON.parse(require('fs').readFileSync(0, 'utf8'));
const element = () => ({
    children: [], append(...each) { this.children.push(...each); },
    addEventListener(_, heard) { this.heard = heard; }, after(each) { shown.push(each); }});
const shown = [], fetched = [];
let ready, gone = null;
const context = {
    URL, Option: function(text, value, _, selected) { return {value, selected}; },
    document: {
        currentScript: {src: root + '_static/versions.js?v=1'}, createElement: element,
        addEventListener(_, heard) { ready = heard; }, querySelector: element},
    location: {href: page, assign(target) { gone = target.href; }},
    fetch: async (target) => {
        fetched.push(target.href);
        const text = files[target.href];
        return {ok: text !== undefined, json: async () => JSON.parse(text)};
    }};
require('vm').runInNewContext(script, context);
(async () => {
    await ready();
    const select = shown[0]?.children[1];
    if (select && chosen) {
        select.value = chosen;
        await select.heard();
    }
    console.log(JSON.stringify([select ? select.children : null, gone, fetched]));
})();
"""
SITE = 'https://a.org/rigid/0.1.0/'
LIST = 'https://a.org/rigid/versions.json'


def versions(files, root=SITE, page='docs/INSTALL.html#on-debian', chosen=None):
    """What STAGE prints."""
    if shutil.which('node') is None:
        pytest.skip('node is not installed')
    things = (read('site/static/versions.js'), root, root + page, files, chosen)
    finished = subprocess.run(['node', '-e', STAGE], input=json.dumps(things), capture_output=True,
                              text=True, check=True)
    return json.loads(finished.stdout)


@pytest.mark.parametrize(
    'listed, expected',
    [('["latest", "0.1.0"]', ['latest', '0.1.0']), ('["latest"]', ['0.1.0', 'latest']),
     ('["../secret", "https://b.org", "", "0.0.9", "0.1.0"]', ['0.0.9', '0.1.0']),
     ('["0.1.0"]', None), ('{"a": 1}', None), ('not a list', None),])
def test_versions_are_those_of_the_list(listed, expected):
    options, _, fetched = versions({LIST: listed})
    assert (options and [each['value'] for each in options]) == expected and fetched == [LIST]
    assert not options or [each['value'] for each in options if each['selected']] == ['0.1.0']


def test_no_versions_are_shown_without_a_list_or_a_server():
    assert versions({}) == [None, None, [LIST]]
    assert versions({}, root='file:///rigid/0.1.0/') == [None, None, []]
    assert versions({}, root='https://a.org/') == [None, None, []]


def test_another_version_opens_at_the_same_page_if_it_has_that():
    files = {LIST: '["latest", "0.1.0"]'}
    first, same = 'https://a.org/rigid/latest/', 'https://a.org/rigid/latest/docs/INSTALL.html'
    assert versions(files, chosen='latest')[1] == first
    assert versions({same: '', **files}, page='docs/INSTALL.html', chosen='latest')[1] == same


def test_pages_load_the_script_of_versions():
    assert "'versions.js'" in read('site/conf.py')


# ---- The built site ------------------------------------------------------------------------------


@pytest.fixture(scope='module')
def html(tmp_path_factory):
    """The site, as `make site` builds it, which takes half a minute."""
    lacking = [
        name for name in ('sphinx', 'myst_parser', 'breathe', 'furo', 'nbformat')
        if importlib.util.find_spec(name) is None
    ]
    lacking += [] if shutil.which('doxygen') else ['doxygen']
    if lacking:
        pytest.skip(
            f'{", ".join(lacking)} not installed; `make site` installs what it needs and checks '
            f'the site')
    output = tmp_path_factory.mktemp('site')
    environment = dict(os.environ, OPENBLAS_NUM_THREADS='1')
    finished = subprocess.run(
        [sys.executable, str(ROOT/'site'/'build.py'),
         str(output)], env=environment, capture_output=True, text=True, timeout=1200)
    assert finished.returncode == 0, finished.stdout + finished.stderr
    return output/'html'


def test_tutorials_are_offered_as_notebooks(html):
    for page in notebooks.PAGES:
        file = html/page.replace('.md', '.html')
        link = re.search(r'href="([^"]+)"><span[^>]*>Download as a notebook<',
                         file.read_text(encoding='utf-8'))
        offered = json.loads((file.parent/link[1]).read_text(encoding='utf-8'))
        assert offered == notebooks.notebook(page), page
    assert len(list(html.rglob('*.ipynb'))) == len(notebooks.PAGES)


def anchors(html, page):
    return set(re.findall(r' id="([^"]+)"', (html/page).read_text(encoding='utf-8')))


def test_site_is_built_without_warnings_and_faults(html):
    assert (html/'searchindex.js').exists() and check.faults(html) == []


def test_formulas_of_headers_become_those_of_sphinx():
    said = xml.etree.ElementTree.fromstring(
        '<d><para>It is <formula id="0">$N F$</formula>,\n nm.</para></d>')
    assert apipages._text(said) == 'It is :math:`N F`, nm.'


#: Prints what KaTeX objects to, of formulas that come as a list of (place, TeX, displayed).
DRAW = """
const katex = require(process.argv[1] + '/katex.min.js');
for (const [place, tex, displayMode] of JSON.parse(require('fs').readFileSync(0, 'utf8')))
    try {
        katex.renderToString(tex, {displayMode, throwOnError: true});
    } catch (error) {
        console.log(place + ': ' + error.message);
    }
"""


def test_no_formula_is_left_as_text_and_katex_draws_all(html):
    formulas, pages = [], collections.Counter()
    for file in sorted(html.rglob('*.html')):
        text = file.read_text(encoding='utf-8')
        marked = r'<(span|div) class="math notranslate[^"]*"[^>]*>\s*(.*?)\s*</\1>'
        found = re.findall(marked, text, flags=re.S)
        formulas += [(file.name, unescape(tex)[2:-2], tex.startswith(r'\[')) for _, tex in found]
        part = file.relative_to(html).parts[0]
        pages[part] += bool(found)
        if part in ('docs', 'api', 'cpp'):
            rest = re.sub(marked + r'|<(pre|code|script|style)\b.*?</\3>', '', text, flags=re.S)
            left = re.findall(r'.{0,30}(?:\$|:math:|\\f\b).{0,30}', rest)
            assert not left, f'{file.name}: {left}'
    assert pages['api'] > 20 and pages['cpp'] > 1
    assert len(formulas) > 1000
    folder = '/usr/share/javascript/katex'
    if shutil.which('node') is None:
        pytest.skip('node is not installed: formulas were found and not drawn')
    finished = subprocess.run(['node', '-e', DRAW, folder], input=json.dumps(formulas),
                              capture_output=True, text=True, check=True)
    assert not finished.stdout, finished.stdout


def test_every_public_thing_has_its_page(html):
    for package in ('app', 'analysis', 'accuracy', 'ensemble'):
        module = getattr(openmmrigidhi, package)
        for name in module.__all__:
            thing = getattr(module, name)
            wanted = f'module-{thing.__name__}' if isinstance(
                thing, types.ModuleType) else f'{module.__name__}.{name}'
            assert wanted in anchors(html, f'api/{package}/{name}.html'), wanted
    for name in openmmrigidhi.__all__:
        if inspect.isfunction(getattr(openmmrigidhi, name)):
            assert f'openmmrigidhi.{name}' in anchors(html, 'api/index.html')


@pytest.mark.parametrize(
    'name', ['CustomRigidHIIntegrator', 'MobilityForce', 'CustomBodyForce', 'CustomBodyMotion'])
def test_every_method_and_enumerator_is_on_the_page_of_its_class(html, name):
    type_ = getattr(openmmrigidhi, name)
    public = [
        key for key, value in vars(type_).items() if not key.startswith('_') and (
            isinstance(value, (staticmethod, enum.Enum)) or inspect.isfunction(value))
    ]
    assert len(public) > 10
    missing = {f'openmmrigidhi.{name}.{key}' for key in public} - anchors(html, f'api/{name}.html')
    assert not missing


def test_pages_and_reference_lead_to_each_other(html):
    for page in ('schemes/LangevinC', 'models/RotnePragerYamakawa', 'cookbook/suspensions'):
        text = (html/f'docs/{page}.html').read_text(encoding='utf-8')
        assert re.search(r'href="../../api/[^"#]+#openmmrigidhi\.', text), page
    for name in references.CLASSES:
        text = (html/f'api/{name}.html').read_text(encoding='utf-8')
        assert all(f'href="../{page}.html"' in text for _, page in references.PAGES[name])


def test_schemes_and_models_lead_to_both_references_and_back(html):
    for folder, (enumeration, class_) in references.ENUMERATIONS.items():
        for name in getattr(getattr(openmmrigidhi, class_), enumeration).__members__:
            text = (html/folder/f'{name}.html').read_text(encoding='utf-8')
            assert f'api/{class_}.html#openmmrigidhi.{class_}.{name}"' in text, name
            assert f'cpp/{class_}.html#_CPPv4N13RigidHIPlugin' in text, name
            assert f'href="../{folder}/{name}.html"' in (html/f'api/{class_}.html').read_text(
                encoding='utf-8'), name


def test_the_guide_is_a_section_whose_pages_follow_each_other(html):
    listed = re.findall(r'^- \[[^]]*\]\((\w+)\.md\)', read('docs/guide/README.md'), flags=re.M)
    pages = ['docs/guide/README', *(f'docs/guide/{name}' for name in listed)]
    assert len(pages) == len(git_files('docs/guide/*.md'))
    navigation = (html/'index.html').read_text(encoding='utf-8').partition('sidebar-tree')[2]
    places = [navigation.index(f'href="{page}.html"') for page in [*pages, 'docs/ARCHITECTURE']]
    assert navigation.index('>User guide<') < places[0] and places == sorted(places)
    for page, following in zip(pages, pages[1:]):
        text = (html/f'{page}.html').read_text(encoding='utf-8')
        assert f'class="next-page" href="{following.rpartition("/")[2]}.html"' in text, page


def test_search_tells_kinds_of_pages_apart(html):
    """The guide and the cookbook count more than pages for contributors, and a class of both
    languages has two titles."""
    script = read('site/search.js')
    assert script in (html/'_static'/'language_data.js').read_text(encoding='utf-8')
    kinds = [(pattern.replace('\\/', '/'), name, float(factor), float(bonus))
             for pattern, name, factor, bonus in re.findall(
                 r'\[/(.*)/, "([^"]+)", ([\d.]+), ([-\d.]+)\]', script)]

    def best_and_worst(page):
        _, _, factor, bonus = next(each for each in kinds if re.search(each[0], page))
        return factor*100 + bonus, bonus

    for page in ('CONTRIBUTING', 'CHANGELOG', 'docs/ARCHITECTURE'):
        for other in ('docs/guide/bodies', 'docs/cookbook/walls'):
            assert best_and_worst(page)[0] < best_and_worst(other)[1]
    for name in references.CLASSES:
        for folder, language in (('api', 'Python'), ('cpp', 'C++')):
            text = (html/folder/f'{name}.html').read_text(encoding='utf-8')
            assert f'<title>{name} ({language})' in text


def test_every_public_header_is_in_the_cpp_reference(html):
    for header in git_files('openmmapi/include/openmmrigidhi/*.h'):
        if '/internal/' not in header:
            for kind, name in re.findall(
                    r'^(class|struct)\s+(?:OPENMM_EXPORT_RIGIDHI\s+)?(\w+)[^;\n]*\{', read(header),
                    flags=re.M):
                assert f'_CPPv4N13RigidHIPlugin{len(name)}{name}E' in anchors(
                    html, f'cpp/{name}.html'), f'{kind} {name}'
