"""Tutorials make notebooks whose cells run in order, and pages show their scripts as they are."""
import json
import pathlib
import sys

import pytest
from conftest import ROOT, git_files, read

sys.path.insert(0, str(ROOT/'site'))
import notebooks  # noqa: E402
import scripts  # noqa: E402

SCRIPT = '''#!/usr/bin/env python3
"""A script."""
import argparse
from functools import cache
from math import pi

# The unit of length.
A, B = 1.0, 2.0


@cache
def area(r):
    """Of a circle."""
    return pi*r**2


def main():
    argparse.ArgumentParser()
'''


def code(notebook):
    return [''.join(cell['source']) for cell in notebook['cells'] if cell['cell_type'] == 'code']


def test_a_page_shows_parts_of_its_script(tmp_path):
    (tmp_path/'run.py').write_text(SCRIPT)
    text = scripts.with_script('Text\n\n<!-- script: imports, B, area -->\n', tmp_path/'run.py')
    assert text == ('Text\n\n```python\nfrom functools import cache\nfrom math import pi\n\n'
                    '# The unit of length.\nA, B = 1.0, 2.0\n\n\n'
                    '@cache\ndef area(r):\n    """Of a circle."""\n    return pi*r**2\n```\n')
    with pytest.raises(ValueError, match='has no volume, which its page shows'):
        scripts.with_script('<!-- script: A, volume -->\n', tmp_path/'run.py')


def test_a_notebook_has_code_of_python_only_and_needs_no_other_file(tmp_path, monkeypatch):
    monkeypatch.setattr(notebooks, 'ROOT', tmp_path)
    monkeypatch.setattr(scripts, 'ROOT', tmp_path)
    (tmp_path/'a.png').write_bytes(b'picture')
    (tmp_path/'page.md').write_text(
        '# Title\nSee [`x[0]`](other.md#y), [this](#title) and [that](https://openmm.org).\n\n'
        '    make build\n\n![A picture](a.png)\n\n<!-- a comment -->\n\n'
        '```text\n[a](b.md)\n```\n\n```python\nx = [1]\n```\n\n## Next\nEnd.\n')
    made = notebooks.notebook('page.md')
    first, second, third = made['cells']
    assert [each['cell_type'] for each in made['cells']] == ['markdown', 'code', 'markdown']
    assert code(made) == ['x = [1]']
    text = ''.join(first['source'])
    assert 'See `x[0]`, this and [that](https://openmm.org).' in text and '    make build' in text
    assert '[a](b.md)' in text and '<!--' not in text
    assert '![A picture](attachment:a.png)' in text
    assert first['attachments'] == {'a.png': {'image/png': 'cGljdHVyZQ=='}}
    assert ''.join(third['source']) == '## Next\nEnd.'


def test_pages_that_show_a_script_show_what_it_has():
    pages = [page for page in git_files('examples/*/README.md') if scripts.shows_script(page)]
    assert len(pages) > 2
    for page in pages:
        assert scripts.page_text(page) != read(page)


@pytest.mark.parametrize('page', notebooks.PAGES)
def test_notebooks_are_valid(page):
    made = notebooks.notebook(page)
    assert len(code(made)) > 2 and made['cells'][0]['cell_type'] == 'markdown'
    assert ''.join(made['cells'][0]['source']).startswith('# ')
    for cell in code(made):
        compile(cell, page, 'exec')
    nbformat = pytest.importorskip('nbformat')
    nbformat.validate(nbformat.reads(json.dumps(made), as_version=4))


@pytest.mark.parametrize('page', notebooks.PAGES)
def test_cells_run_in_order(page, tmp_path, run_python):
    """In a process of their own, as in a kernel: each cell has what the cells before it have."""
    cells = code(notebooks.notebook(page))
    (tmp_path/'cells.json').write_text(json.dumps(cells))
    finished = run_python(
        'import json\nnames = {"__name__": "__main__"}\n'
        'for cell in json.load(open("cells.json")):\n    exec(cell, names)\n', tmp_path,
        timeout=300, seeded=True)
    assert finished.returncode == 0, finished.stderr
    assert 'Warning: ' not in finished.stderr, finished.stderr


def test_notebooks_have_different_names_and_are_not_in_the_repository(tmp_path):
    names = [notebooks.name_of(page) for page in notebooks.PAGES]
    assert len(set(names)) == len(names) > 4
    assert not git_files('*.ipynb')
    file = notebooks.write(notebooks.PAGES[1], pathlib.Path(tmp_path))
    assert json.loads(file.read_text(encoding='utf-8')) == notebooks.notebook(notebooks.PAGES[1])
