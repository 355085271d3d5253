#!/usr/bin/env python3
"""Make Jupyter notebooks of tutorials, from the Markdown of their pages.

    site/notebooks.py FOLDER           # the notebooks that the site offers
    site/notebooks.py FOLDER README.md # that of another page

Each block of Python on a page becomes a cell of code, with the parts of the script that a page
shows (scripts.py), and what is between becomes cells of text.
"""
import argparse
import base64
import json
import os
import pathlib
import re

from collect import ROOT, outside_code
from scripts import page_text

#: The pages that the site offers as notebooks.
PAGES = [
    'examples/water_demo/README.md', 'examples/two_colloids/README.md',
    'examples/bodies_above_a_wall/README.md', 'examples/driven_dipoles/README.md',
    'docs/cookbook/suspensions.md'
]
BLOCK = re.compile(r'^```python\n(.*?)^```\n?', flags=re.S | re.M)
#: Kinds of pictures that a notebook may contain.
KINDS = {'.png': 'image/png', '.gif': 'image/gif', '.jpg': 'image/jpeg', '.svg': 'image/svg+xml'}


def code_of(page):
    """The blocks of Python of a page of the repository, in order."""
    return BLOCK.findall(page_text(page))


def name_of(page):
    """The name of the notebook of a page."""
    folder, file = os.path.split(page)
    return (os.path.basename(folder)
            if file == 'README.md' else file.removesuffix('.md')) + '.ipynb'


def notebook(page):
    """The notebook of a page of the repository, in Jupyter's format 4.5."""
    cells = []
    for k, part in enumerate(BLOCK.split(page_text(page))):
        for text in [part] if k % 2 else re.split(r'^(?=## )', part, flags=re.M):
            if text.strip():
                cell = _code(text) if k % 2 else _text(text, ROOT/page)
                cells.append({'id': f'cell-{len(cells) + 1}', **cell})
    return {
        'cells': cells,
        'metadata': {
            'kernelspec': {
                'display_name': 'Python 3',
                'language': 'python',
                'name': 'python3'
            },
            'language_info': {
                'name': 'python'
            }
        },
        'nbformat': 4,
        'nbformat_minor': 5
    }


def _lines(text):
    return text.strip('\n').splitlines(keepends=True)


def _code(text):
    return {
        'cell_type': 'code',
        'execution_count': None,
        'metadata': {},
        'outputs': [],
        'source': _lines(text)
    }


def _text(text, file):
    """A cell of text: it contains its pictures, and has no links to files, which are elsewhere."""
    attachments = {}

    def picture(found):
        target = file.parent/found[2]
        attachments[target.name] = {
            KINDS[target.suffix]: base64.b64encode(target.read_bytes()).decode()
        }
        return f'![{found[1]}](attachment:{target.name})'

    def change(text):
        text = re.sub(r'<!--.*?-->', '', text, flags=re.S)
        text = re.sub(r'!\[([^\]]*)\]\(([^)\s]+)\)', picture, text)
        return re.sub(r'(?<!!)\[((?:!\[[^\]]*\]\([^)]*\)|[^\[\]])*)\]\((?!https?:)[^)\s]+\)', r'\1',
                      text)

    text = outside_code(re.sub(r'^```math\n(.*?)^```', r'$$\n\1$$', text, flags=re.S | re.M),
                        change)
    cell = {'cell_type': 'markdown', 'metadata': {}, 'source': _lines(text)}
    return {**cell, 'attachments': attachments} if attachments else cell


def write(page, folder):
    """Write the notebook of a page into a folder, and return its path."""
    folder.mkdir(parents=True, exist_ok=True)
    file = folder/name_of(page)
    file.write_text(
        json.dumps(notebook(page), indent=1, ensure_ascii=False) + '\n', encoding='utf-8')
    return file


def offer(text, page, source):
    """The text of a page of the site, with a link to its notebook, which is written beside it."""
    if page + '.md' not in PAGES:
        return text
    notebook = write(page + '.md', (source/page).parent)
    link = f'[Download as a notebook]({notebook.name})'
    return text.replace('\n', f'\n\n{link}\n\n', 1)  # below the title


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('folder', type=pathlib.Path, help='where the notebooks come')
    parser.add_argument('pages', nargs='*', type=pathlib.Path,
                        help='Markdown files of the repository (default: those of the site)')
    arguments = parser.parse_args()
    pages = [os.path.relpath(page.resolve(), ROOT) for page in arguments.pages]
    for page in pages or PAGES:
        print(f'Written: {write(page, arguments.folder)}')


if __name__ == '__main__':
    main()
