"""Every error message of the product is provoked by a test.

A site is a call of `fail`, `refuse`, `wrongValue`, `throw OpenMMException` in C++ or a `raise` in
Python, with the literal text of its message. It counts as tested if some string in a test holds
LENGTH consecutive characters of that text that occur at no other site. So a new message needs only
a test that expects it.
"""
import ast
import re

import pytest
from conftest import git_files, read

#: Shorter literal texts only forward messages that are written elsewhere.
MINIMUM = 10
LENGTH = 14
GAP = '\0'  # stands for a value inserted into a message
#: Messages that no test can provoke, each with its reason. The key is a piece of the text.
UNREACHABLE = {
    'tried to create a kernel with unknown name': 'OpenMM asks a factory only for the kernels that '
    'were registered with it',
    'unknown C++ exception in': 'a guard against exceptions that are no std::exception; nothing '
    'throws them',
    'muParser must accept each expression that the parser of this plugin accepts': 'a guard: our '
    'parser passes on nothing that muParser refuses',
    ' needs a MobilityForce in the System': 'a guard: MobilityForce asks only after it has found '
    'itself in the Context',
}
#: Messages whose words occur elsewhere too: a piece of each, and the test that provokes it.
INDISTINCT = {
    f' is {GAP} {GAP}it must be finite and positive': 'test_a_setting_that_must_be_positive',
    f' is {GAP} {GAP}it must be finite and not negative': 'test_a_negative_or_non_finite_setting',
    f'the integrator has {GAP} bodies, counted from 0'
    f'{GAP}add the body first': 'test_a_body_index_out_of_range',
    f'; it must be a {GAP}: use one of ': 'test_unknown_constants',
    f'a non-finite {GAP} was found': 'test_a_force_too_large_to_add_up',
    f"property '{GAP}' is '{GAP}'": 'test_damaged_xml_of_an_integrator',
    f'gap is {GAP} mean radii': 'test_a_negative_minimum_gap',
    f', argument {GAP} is None': 'test_bindings_check_their_buffers',
    f'no answer within {GAP} s': 'test_a_cluster_that_goes_away_is_an_error',
    f'{GAP}: {GAP}: got {GAP}; {GAP}': 'test_wrong_arguments',
}


def balanced(text, start):
    """End of the parenthesis that opens at start; literals may contain parentheses."""
    depth, i, quoted = 0, start, False
    while True:
        c = text[i]
        if quoted:
            if c == '\\':
                i += 1
            elif c == '"':
                quoted = False
        elif c == '"':
            quoted = True
        elif c == '(':
            depth += 1
        elif c == ')':
            depth -= 1
            if depth == 0:
                return i + 1
        i += 1


def strip_cpp_comments(text):
    """Comments replaced by blanks; literals are kept."""
    pattern = r'"(?:\\.|[^"\\])*"|//[^\n]*|/\*.*?\*/'
    return re.sub(pattern, lambda m: m.group()
                  if m.group().startswith('"') else ' ', text, flags=re.S)


def literals(text):
    """The string literals of C++ code; adjacent ones are joined, with GAP where code stands
    between."""
    pieces = re.findall(r'"((?:\\.|[^"\\])*)"(\s*(?=")|)', text)
    joined = ''
    for literal, adjacent in pieces:
        joined += literal + ('' if adjacent else GAP)
    # SWIG and printf insert values too.
    joined = re.sub(r'\$\w+|%[a-z]+', GAP, joined)
    return joined.replace('\\n', ' ').replace('\\"', '"').strip(GAP)


def cpp_sites():
    for name in git_files('openmmapi/*', 'serialization/*', 'platforms/*', 'python/*.i'):
        if not name.endswith(('.cpp', '.h', '.i')):
            continue
        text = strip_cpp_comments(read(name))
        for match in re.finditer(
                r'\b(?:fail\w*|refuse|reject|wrongValue|OpenMMException|PyErr_SetString|'
                r'PyErr_Format|SWIG_exception_fail)\s*\(', text):
            before = text[:match.start()].rstrip()
            if before.endswith(('void', 'inline')):
                continue  # the definition of such a function
            call = text[match.end() - 1:balanced(text, match.end() - 1)]
            message = re.sub(
                r'^(?:CustomRigidHIIntegrator|MobilityForce|CustomBodyForce|CustomBodyMotion): ',
                '', literals(call))
            if len(re.sub(r'[^A-Za-z]', '', message)) < MINIMUM:
                continue  # forwards a message that is written elsewhere
            yield f'{name}:{text.count(chr(10), 0, match.start()) + 1}', message


def python_message(node):
    """The literal text of an expression that builds a string, GAP for values."""
    if isinstance(node, ast.Constant):
        return node.value if isinstance(node.value, str) else GAP
    if isinstance(node, ast.JoinedStr):
        return ''.join(python_message(value) for value in node.values)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return python_message(node.left) + python_message(node.right)
    return GAP


def python_sites():
    for name in git_files('python/openmmrigidhi/*.py'):
        for node in ast.walk(ast.parse(read(name))):
            if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call) and node.exc.args:
                message = python_message(node.exc.args[0])
                if len(message.replace(GAP, '')) >= MINIMUM:
                    yield f'{name}:{node.lineno}', message


def normalise(text):
    """Compare letters only: whitespace, escapes and quotes differ between sources and tests."""
    return re.sub(r'[\s\\\'"]+', ' ', text)


def test_strings():
    """All string literals in test files (except in this directory), cut where a pattern matches any
    text.
    """
    found = set()
    for name in git_files('tests/*', 'platforms/*/tests/*'):
        if name.startswith('tests/lint/'):
            continue
        if name.endswith('.py'):
            strings = [
                node.value for node in ast.walk(ast.parse(read(name)))
                if isinstance(node, ast.Constant) and isinstance(node.value, str)
            ]
        elif name.endswith(('.cpp', '.h')):
            strings = literals(strip_cpp_comments(read(name))).split(GAP)
        else:
            continue
        for string in strings:
            for piece in re.split(r'\.\*\??|\\d\+|\\S\+|\.\+|\[[^\]]*\][+*]?|\|', string):
                piece = normalise(piece).strip()
                if len(piece) >= MINIMUM:
                    found.add(piece)
    return found


test_strings.__test__ = False
SITES = list(cpp_sites()) + list(python_sites())


def fragments(text):
    """All pieces of LENGTH characters, or the text itself if it is shorter."""
    return {text[i:i + LENGTH] for i in range(max(1, len(text) - LENGTH + 1))}


@pytest.fixture(scope='module')
def tied():
    """Places of the sites of which some test holds a fragment that is in no other site's text."""
    texts = {place: normalise(message) for place, message in SITES}
    owners = {}
    for place, text in texts.items():
        for piece in text.split(GAP):
            if len(piece.strip()) >= MINIMUM:
                for fragment in fragments(piece):
                    owners.setdefault(fragment, set()).add(place)
    places = set()
    for string in test_strings():
        for fragment in fragments(string):
            found = owners.get(fragment, ())
            # The same message may stand at two places.
            if len({texts[place] for place in found}) == 1:
                places.update(found)
    return places


def test_finds_the_sites():
    assert len(SITES) > 60
    assert any('triangle inequality' in message for _, message in SITES)


@pytest.mark.parametrize('place, message', SITES, ids=[place for place, _ in SITES])
def test_message_is_expected_by_a_test(place, message, tied):
    if any(piece in message for piece in UNREACHABLE):
        return
    if any(piece in message for piece in INDISTINCT):
        return
    assert place in tied, f'no test expects this message: {message.replace(GAP, "<...>")}'


@pytest.mark.parametrize('piece', [*UNREACHABLE, *INDISTINCT],
                         ids=lambda piece: piece.replace(GAP, '<...>'))
def test_exception_is_still_needed(piece):
    assert any(piece in message for _, message in SITES)


@pytest.mark.parametrize('test', INDISTINCT.values())
def test_named_test_exists(test):
    assert any(f'def {test}(' in read(name) for name in git_files('tests/python/*.py'))
