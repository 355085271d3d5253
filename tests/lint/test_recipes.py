"""The recipes can be followed step by step, and a step that cannot be followed is an error.

`make recipes` builds and tests the results of the recipes.
"""
import importlib.util

import pytest
from conftest import ROOT

spec = importlib.util.spec_from_file_location('follow_recipes', ROOT/'tools/follow_recipes.py')
follow_recipes = importlib.util.module_from_spec(spec)
spec.loader.exec_module(follow_recipes)

LIST = b'#define ROWS(ROW) \\\n    ROW(A) \\\n    ROW(B)\n#define OTHERS(ROW) \\\n    ROW(D)\n'


def follow(page, **files):
    recipes = follow_recipes.Recipes({
        'page.md': page.encode(),
        **{name.replace('_', '.'): text
           for name, text in files.items()}
    })
    recipes.follow('page.md')
    return recipes


def test_every_step_of_every_page_can_be_followed():
    follow_recipes.main(['--check'])


def test_blocks_go_where_the_page_says():
    page = (
        '<!-- recipe: create new.h -->\n```cpp\nnew\n```\n\n<!-- recipe: add to the list ROWS in '
        'list.h -->\n```cpp\n    ROW(C)\n```\n'
        '<!-- recipe: in old.h before third -->\n```cpp\nsecond\n```\n'
        '<!-- recipe: in old.h in place of fourth -->\n```cpp\nfour\nfive\n```\n')
    files = follow(page, list_h=LIST, old_h=b'first\nthird\nthe fourth\nsixth\n').files
    assert files['new.h'] == b'new\n'
    assert files['list.h'] == LIST.replace(b'ROW(B)', b'ROW(B) \\\n    ROW(C)')
    assert files['old.h'] == b'first\nsecond\nthird\nfour\nfive\nsixth\n'


@pytest.mark.parametrize(
    'step, block, message',
    [('create old.h', 'x', 'old.h is there already'), ('create new.h', None, 'needs a code block'),
     ('add to the list ROWS in old.h', 'x', 'old.h has no list ROWS'),
     ('add to the list ROWS in none.h', 'x', 'there is no none.h'),
     ('in old.h after second', 'x', '0 lines of old.h have "second"'),
     ('test TestNothing', None, 'no test program TestNothing'),
     ('test TestNothing', 'x', 'takes no code block'),
     ('pytest tests/none.py', None, 'there is no tests/none.py'),
     ('spoil old.h: second -> third, seen by TestNothing', None, '0 times, not once'),
     ('guess', None, 'is no step'),])
def test_a_step_that_cannot_be_followed_is_an_error(step, block, message):
    page = f'text\n<!-- recipe: {step} -->\n' + ('' if block is None else f'```cpp\n{block}\n```\n')
    with pytest.raises(follow_recipes.RecipeError, match=f'page.md, line 2: .*{message}'):
        follow(page, old_h=b'first\n')


@pytest.mark.parametrize('name, good, bad', [('new.h', 'int x;\n', 'int  x ;\n'),
                                             ('new.py', 'x = 1\n', 'x=1\n'),])
def test_blocks_are_formatted(name, good, bad):
    if follow_recipes.formatter(name) is None:
        pytest.skip('the formatter of Debian 12 is not installed')
    assert not follow_recipes.unformatted({name: good.encode()}, {})
    assert not follow_recipes.unformatted({name: bad.encode()}, {name: bad.encode()})
    lines = follow_recipes.unformatted({name: bad.encode()}, {})
    assert '-' + bad.rstrip() in lines and '+' + good.rstrip() in lines


def test_a_step_that_is_not_seen_is_an_error():
    with pytest.raises(follow_recipes.RecipeError, match='alone'):
        follow('text <!-- recipe: create new.h -->\n')
