"""Sources: layout, self-contained headers, scheme headers, no leftovers, no paths of a particular
machine."""
import io
import re
import shutil
import subprocess
import sys
import tokenize

import pytest
from conftest import ROOT, cpp_files, git_files, read

from openmmrigidhi import _models, _schemes

TEXT = ('.h', '.cpp', '.py', '.i', '.md', '.txt', '.json', '.cmake', '.sh', '.ini', '.html', '')
BINARY = ('.png', '.gif', '.dcd', '.h5', '.npz', '.pdf', '.gz')
SCHEMES = git_files('platforms/common/schemes/thermostats/*-inl.h') + git_files(
    'platforms/common/schemes/overdamped/*.h')
PUBLIC_HEADERS = git_files('openmmapi/include/*.h')


def text_files():
    return [name for name in git_files() if not name.endswith(BINARY)]


# Spelled so that this file does not contain them.
FORBIDDEN = {
    'paths of one machine': r'/(?:work|root|home)/\w|/tmp/\w',
    'unfinished business': r'\b(?:TO' + r'DO|FIX' + r'ME|XX' + r'X|HA' + r'CK)\b',
}
#: Matches that are intended, as (file, text).
MEANT = set()


@pytest.mark.parametrize('what', FORBIDDEN)
def test_no(what):
    found = []
    for name in text_files():
        if name == 'tests/lint/test_sources.py':
            continue
        for number, line in enumerate(read(name).splitlines(), 1):
            for match in re.finditer(FORBIDDEN[what], line):
                if (name, match.group()) not in MEANT:
                    found.append(f'{name}:{number}: {line.strip()[:100]}')
    assert not found, f'{what}:\n' + '\n'.join(found)


def test_clang_format():
    """C++ files are formatted by the clang-format of Debian 12. Other versions format a few places
    in another way."""
    program = shutil.which('clang-format-14') or shutil.which('clang-format')
    if program is None:
        pytest.skip('clang-format is not installed')
    version = subprocess.run([program, '--version'], capture_output=True, text=True).stdout.strip()
    if ' version 14.' not in version:
        pytest.skip(f'the sources are formatted by clang-format 14; this is {version}')
    result = subprocess.run([program, '--dry-run', '-Werror', *cpp_files()], cwd=ROOT,
                            capture_output=True, text=True)
    unformatted = sorted({
        line.split(':')[0]
        for line in result.stderr.splitlines() if 'clang-format-violations' in line
    })
    assert not unformatted, 'run `make format` on ' + ', '.join(unformatted)


def test_yapf():
    """Python files are formatted by the yapf of Debian 12."""
    program = shutil.which('yapf3')
    if program is None:
        pytest.skip('yapf3 is not installed')
    version = subprocess.run([program, '--version'], capture_output=True, text=True).stdout.strip()
    if ' 0.32.' not in version:
        pytest.skip(f'the sources are formatted by yapf 0.32; this is {version}')
    result = subprocess.run([program, '--diff', '--parallel', *git_files('*.py')], cwd=ROOT,
                            capture_output=True, text=True)
    assert not result.stderr, result.stderr
    unformatted = re.findall(r'^--- (\S+)', result.stdout, re.MULTILINE)
    assert not unformatted, 'run `make format` on ' + ', '.join(unformatted)


@pytest.mark.parametrize('language, patterns', [('Python', ('*.py',)), ('C++', ('*.h', '*.cpp'))])
def test_no_line_is_wider_than_100(language, patterns):
    """Lines are not too long. Lines with web addresses are excepted, because these cannot be
    wrapped."""
    wide = [
        f'{name}:{number}' for name in git_files(*patterns)
        for number, line in enumerate(read(name).splitlines(), 1)
        if len(line) > 100 and not re.search(r'https?://\S{30}', line)
    ]
    assert not wide, f'{language}: lines wider than 100 columns:\n' + '\n'.join(wide)


def test_files_of_tests_have_a_length_that_one_can_read():
    long = {
        name: count
        for name in git_files('tests/*.py', 'tests/*.cpp', 'tests/*.h')
        for count in [len(read(name).splitlines())] if count > 950
    }
    assert not long, f'split these files by topic, at most 950 lines each: {long}'


def test_a_sentence_of_markdown_is_a_line():
    pages = [page for page in git_files('*.md') if '/results/' not in page]
    result = subprocess.run([sys.executable, 'tools/format_markdown.py', '--check', *pages],
                            cwd=ROOT, capture_output=True, text=True)
    assert not result.stderr, result.stderr
    assert not result.returncode, 'run `make format` on ' + ', '.join(result.stdout.split())


def test_sentences_end_where_readers_see_their_end(tmp_path):
    page = tmp_path/'page.md'
    page.write_text('It is at 300 K. The bath is warm, says J. Smith. '
                    'See ![One. Two.](a.png) there. At $T$ K. And [a. B](c.md). New.\n')
    subprocess.run([sys.executable, 'tools/format_markdown.py', page], cwd=ROOT, check=True)
    assert page.read_text().splitlines() == [
        'It is at 300 K.', 'The bath is warm, says J. Smith.', 'See ![One. Two.](a.png) there.',
        'At $T$ K.', 'And [a. B](c.md).', 'New.'
    ]


def test_formulas_are_no_sentences(tmp_path):
    page = tmp_path/'page.md'
    text = ('Let $f. X$ be it.\n$$\na. B\n$$\n- First.\n\n  $$\n  a = b. C\n  $$\n\n  Second.\n\n'
            '```math\na. B\n```\n')
    page.write_text(text)
    subprocess.run([sys.executable, 'tools/format_markdown.py', page], cwd=ROOT, check=True)
    assert page.read_text() == text


@pytest.mark.parametrize('header', PUBLIC_HEADERS)
def test_public_header_compiles_alone(header, tmp_path):
    (tmp_path/'alone.cpp'
     ).write_text(f'#include "{ROOT / header}"\n#include "{ROOT / header}"\nint main() {{}}\n')
    result = subprocess.run([
        'g++', '-std=c++17', '-Wall', '-Wextra', '-Wno-unused-parameter', '-Werror',
        '-fsyntax-only', f'-I{ROOT}/openmmapi/include', 'alone.cpp'
    ], cwd=tmp_path, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr


def compiled_first():
    """Headers that some source has as its first line of code. If the build compiled this source,
    the header needs no other header before it."""
    sources = git_files('platforms/common/*.cpp')
    first_lines = (re.search(r'^[ ]*[^/\s].*', read(source), flags=re.M) for source in sources)
    included = (re.match(r'#include "([^"]+)"', line.group()) for line in first_lines if line)
    return {f'platforms/common/{found[1]}' for found in included if found}


@pytest.mark.parametrize('header',
                         sorted(set(git_files('platforms/common/*.h')) - compiled_first()))
def test_shared_header_compiles_alone(header, tmp_path, build_directory):
    (tmp_path/'alone.cpp').write_text(f'#include "{ROOT / header}"\nint main() {{}}\n')
    result = subprocess.run([
        'g++', '-std=c++17', '-fsyntax-only', f'-I{ROOT}/openmmapi/include',
        f'-I{ROOT}/platforms/common', f'-I{build_directory}/generated', '-I/usr/include/eigen3',
        'alone.cpp'
    ], cwd=tmp_path, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr


@pytest.mark.parametrize('program', git_files('benchmarks/*.cpp'))
def test_benchmark_compiles(program, build_directory):
    """No other part of the tests compiles these programs (RIGIDHI_BUILD_BENCHMARKS is off)."""
    result = subprocess.run([
        'g++', '-std=c++17', '-fsyntax-only', f'-I{ROOT}/openmmapi/include',
        f'-I{ROOT}/platforms/common', f'-I{build_directory}/generated', f'-I{ROOT}/benchmarks',
        '-I/usr/include/eigen3', '-DRIGIDHI_PLUGIN_DIR=""',
        str(ROOT/program)
    ], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr


def test_public_headers_need_openmm_and_the_standard_library_only():
    for header in PUBLIC_HEADERS:
        for included in re.findall(r'#include\s+[<"]([^>"]+)', read(header)):
            assert (included.startswith(('openmm/', 'openmmrigidhi/'))
                    or '/' not in included and '.' not in included), f'{header} includes {included}'


@pytest.mark.parametrize('scheme', SCHEMES)
def test_scheme_opens_with_its_description(scheme):
    opening = re.match(r'(?://[^\n]*\n)+', read(scheme)).group()
    for entry in ('Equation:', 'Method:', 'Order:', 'Cost:', 'Reference:', 'Limits:'):
        assert entry in opening, f'{scheme} does not say its "{entry}"'


def test_pages_know_the_schemes():
    """The tables of the user guide agree with the list of schemes, and every scheme and model has
    its equations."""
    for page, overdamped in (('docs/guide/thermostats.md', False), ('docs/guide/brownian.md',
                                                                    True)):
        table = _schemes.markdown(overdamped=overdamped)
        assert table in read(page), f'put this table into {page}, "Schemes":\n{table}'
    theory = ''.join(read(page) for page in git_files('docs/theory/*.md'))
    for traits in [*_schemes.TABLE, *_models.MODELS]:
        assert f'`{traits.name}`' in theory, f'docs/theory has no equations of {traits.name}'


def test_no_scheme_is_known_by_its_number():
    """Properties of some schemes are columns of the list (SchemeList.h), or cases of a switch."""
    for source in git_files('*.cpp', '*.h', '*.i', '*.py'):
        assert not re.search(
            r'[sS]cheme(\(\))?[ ]*[<>]=?[ ]*((CustomRigidHI)?Integrator(::|\.))?[A-Z]',
            read(source)), source


def test_switches_have_no_default():
    """The compiler then names every switch that a new scheme, model or boundary is missing from."""
    for source in git_files('openmmapi/*', 'platforms/*', 'serialization/*', 'python/*.i'):
        assert not re.search(r'^\s*default:', read(source), flags=re.M), source


#: Models that are made from another model, and the virtual methods that they do not hand on because
#: the answer is another one, or because the default asks those that are handed on.
MADE_FROM_ANOTHER = {
    'platforms/common/mobility/models/wall/SphereWall': {
        'friction': 'the friction is the inverse of the matrix',
        'randomField': 'a field would have the covariance of the other model',
        'denseColumns': 'the default makes all columns, by dense()',
        'acceptsNearby': 'the default asks objection()',
        'parts': 'lubrication is put around other models, and not into them',
    },
    'platforms/common/mobility/models/lubricated/LubricatedMobility': {
        'randomField': 'a field would have the covariance of the other model',
        'denseColumns': 'the default makes all columns, by dense()',
        'acceptsNearby': 'the default asks objection()',
    },
    'platforms/common/mobility/models/wall/SlipChannel': {
        'friction': 'images double the matrix',
        'denseColumns': 'the default makes all columns, by dense()',
        'addStressletsOf': 'models of channels have none',
        'sources': 'models of channels have none',
        'placeInFormulas': 'periodic fluids lift no particles',
        'weightInFormulas': 'likewise',
        'forCollectiveModes': 'periodic fluids have none',
        'describeLubrication': 'lubrication is put around other models, and not into them',
        'parts': 'likewise',
    },
}


@pytest.mark.parametrize('source', MADE_FROM_ANOTHER)
def test_models_made_from_another_hand_everything_on(source):
    """A new virtual method of models needs a line there, or a reason here. Traits are copied.

    Facets are handed on as they are, unless the model makes its own from those of the other model.
    """
    own_facets = 'OfModel {' in read(source + '.h')
    virtuals = {
        name
        for header in ['MobilityModel', 'MobilityAt'] + ['ModelFacets']*own_facets
        for name in re.findall(r'^    virtual [^;{]*?(?<!~)\b(\w+)\(',
                               read(f'platforms/common/mobility/{header}.h'), flags=re.M)
    }
    assert {'placeInFormulas', 'multiply', 'randomField'} <= virtuals
    assert {'checkWave', 'isLocal'} <= virtuals or not own_facets
    code = read(source + '.h') + read(source + '.cpp')
    if 'public MobilityDecorator' in code:
        code += read('platforms/common/mobility/MobilityDecorator.h')
    handed = set(re.findall(r'\b(\w+)\([^;{}]*\)(?: const)? override', code))
    reasons = set(MADE_FROM_ANOTHER[source])
    assert virtuals - handed == reasons


def test_statistics_that_sanitizers_leave_out_are_tests():
    """tests/CMakeLists.txt names the tests that sanitizers skip. A renamed test must not come back
    to the sanitizers unnoticed."""
    lists = re.findall(r'^set\(RIGIDHI_STATISTICS\w*\n(.*?)\)$', read('tests/CMakeLists.txt'),
                       flags=re.S | re.M)
    named = re.findall(r'(\w+)\.(\w+)(\*?)', re.sub(r'#.*', '', '\n'.join(lists)))
    tests = [
        found for source in git_files('tests/*.cpp')
        for found in re.findall(r'^TEST(?:_P)?\((\w+), (\w+)\)', read(source), flags=re.M)
    ]
    assert len(lists) == 2
    for suite, name, star in named:
        assert any(test == (suite, name) or star and test[0] == suite and test[1].startswith(name)
                   for test in tests), f'{suite}.{name}'


def test_unit_tests_with_threads_say_so():
    """The thread sanitizer runs the unit tests that have Thread in their name, and no others."""
    for source in git_files('tests/unit/*.cpp'):
        bodies = re.findall(r'^TEST\w*\((\w+), (\w+)\) \{\n(.*?)^\}$', read(source),
                            flags=re.S | re.M)
        for suite, name, body in bodies:
            if re.search('thread', body, flags=re.I):
                assert 'Thread' in suite + name, f'{source}: {suite}.{name}'


#: Variables that only keep their object alive.
KEPT_ALIVE = r"local variable '(_?context|simulation)' is assigned to but never used"

#: Methods of OpenMM's classes that ours override.
METHODS_OF_OPENMM = {'_initializeConstants', '_constructHeaders', '_constructReportValues'}


def test_private_functions_are_in_snake_case():
    """Public names have OpenMM's camelCase."""
    found = [
        f'{name}: {function}' for name in git_files('*.py')
        for function in re.findall(r'\bdef (_[a-z0-9_]*[A-Z]\w*)', read(name))
        if function not in METHODS_OF_OPENMM
    ]
    assert not found, '\n'.join(found)


def test_literals_that_fit_on_a_line_are_one():
    """Except after the end of a line of text."""
    found = []
    for name in git_files('*.py'):
        lines = read(name).splitlines()
        strings = [
            token for token in tokenize.generate_tokens(io.StringIO(read(name)).readline)
            if token.type not in (tokenize.NL, tokenize.COMMENT)
        ]
        for a, b in zip(strings, strings[1:]):
            if a.type != tokenize.STRING or b.type != tokenize.STRING:
                continue
            if b.start[0] != a.end[0] + 1 or a.start[0] != a.end[0] or b.start[0] != b.end[0]:
                continue
            quote = a.string[-1]
            text = re.sub(r'^\w*["\']', '', b.string)[:-1]
            whole = lines[a.start[0] - 1][:a.end[1] - 1] + text + quote + lines[b.end[0] -
                                                                                1][b.end[1]:]
            if len(whole) <= 100 and quote not in text and not a.string[:-1].endswith('\\n'):
                found.append(f'{name}:{a.start[0]}')
    assert not found, '\n'.join(found)


def test_pyflakes():
    """Python files compile, and use all their imports and variables."""
    program = shutil.which('pyflakes3')
    if program is None:
        pytest.skip('pyflakes3 is not installed')
    result = subprocess.run([program, *git_files('*.py')], cwd=ROOT, capture_output=True, text=True)
    assert not result.stderr, result.stderr
    handedOn, found = set(), []
    for line in result.stdout.splitlines():
        name, number, text = re.match(r'(.*?):(\d+):\d+:? (.*)', line).groups()
        if '# noqa' in read(name).splitlines()[int(number) - 1]:
            handedOn.add((name, number))  # imports for users of this module
        elif not re.fullmatch(KEPT_ALIVE, text) and not any(
                text.endswith(f' from line {first}') and other == name
                for other, first in handedOn):
            found.append(line)
    assert not found, '\n'.join(found)
