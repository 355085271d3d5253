"""The site's pages are the repository's Markdown files.

They are copied into one tree, where their links have the same targets as in the repository.
"""
import os
import pathlib
import re
import shutil
import subprocess

from scripts import page_text, shows_script

ROOT = pathlib.Path(__file__).resolve().parents[1]
PICTURES = ('.png', '.gif', '.jpg', '.jpeg', '.svg')

#: The table of contents: sections with their pages, and the folders whose other pages belong to
#: them, too. `folder/*` are the pages of a folder, in the order of the links on its first page.
SECTIONS = [('Begin', ['README', 'docs/INSTALL', 'docs/cookbook/README', 'gallery'], []),
            ('User guide', ['docs/guide/README', 'docs/guide/*'], []),
            ('Schemes and models',
             ['docs/schemes/README', 'docs/models/README', 'docs/CONVENTIONS',
              'docs/ensembles'], ['docs']), ('Theory', ['docs/theory/README', 'docs/theory/*'], []),
            ('Accuracy and validation', [
                'docs/accuracy', 'docs/hydrodynamic_ladder', 'docs/grid_accuracy',
                'docs/overdamped_accuracy', 'validation/README', 'benchmarks/README'
            ], ['validation', 'benchmarks']), ('Reference', ['api/index', 'cpp/index'], []),
            ('Development', ['CONTRIBUTING', 'docs/ARCHITECTURE', 'CHANGELOG'], ['']),]
#: What the table of contents says in place of a page's own title.
TITLES = {
    'api/app/index': 'app',
    'api/analysis/index': 'analysis',
    'api/accuracy/index': 'accuracy',
    'api/ensemble/index': 'ensemble',
    'README': 'Overview',
    'docs/INSTALL': 'Installing',
    'validation/README': 'Validation',
    'docs/cookbook/README': 'Cookbook',
    'docs/guide/README': 'Contents',
    'docs/CONVENTIONS': 'Conventions',
    'docs/theory/README': 'Contents',
    'CHANGELOG': 'Changelog'
}
#: Folders whose pages stand below a page that is not in the folder.
PARENTS = {'examples': 'gallery'}


def git_files(*patterns):
    """Files that are in the repository, or would be if added, as paths relative to its root."""
    command = [
        'git', '-c', f'safe.directory={ROOT}', 'ls-files', '-z', '--cached', '--others',
        '--exclude-standard', '--', *patterns
    ]
    listing = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    return sorted({name for name in listing.split('\0') if name and (ROOT/name).exists()})


def page_of(name):
    """The page of a Markdown file: its path without the ending.

    The site's own pages are at the top.
    """
    return name.removeprefix('site/').removesuffix('.md')


def markdown_files():
    """All Markdown files that become pages; tables that scripts write become parts of pages."""
    return [
        name for name in git_files('*.md')
        if not name.startswith(('.', 'tests/')) and '/results' not in name
    ]


def copy_pages(source, change=lambda text, page: text):
    """Copy all Markdown files, and the files that they link to, and return the pages.

    A change is made to the text of each page at the end, change(text, page).
    """
    pages, known = [], markdown_files()
    for name in known:
        text = page_text(name)
        page = page_of(name)
        text = links_of_the_site(text, name, known, source)
        text = re.sub(r'^```math\n(.*?)^```', r'$$\n\1$$', text,
                      flags=re.S | re.M)  # GitHub has both ways to write a formula
        text = change(text, page) + _script_of(name, source)
        target = source/(page + '.md')
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(text, encoding='utf-8')
        pages.append(page)
    return pages


def links_of_the_site(text, name, known, source):
    """The text of a Markdown file with links as they are on the site.

    Targets that are no pages are copied. A folder without a page is no link.
    """
    return outside_code(text, lambda part: _with_links_of_the_site(part, name, known, source))


def outside_code(text, change):
    """Apply a change to text that is neither in a block of code nor in code within a line."""
    parts = re.split(r'(^```.*?^```|``[^\n]+?``|`[^`\n]+`)', text, flags=re.S | re.M)
    # A link's text may have code in it: code comes back in before links are looked for.
    blocks = [part for part in parts if part.startswith('```')]
    inline = [part for part in parts[1::2] if not part.startswith('```')]
    marked = ''.join('\0B' if part.startswith('```') else '\0I' if k % 2 else part
                     for k, part in enumerate(parts))
    marked = change(marked)
    for mark, originals in (('\0B', iter(blocks)), ('\0I', iter(inline))):
        marked = re.sub(mark, lambda _, originals=originals: next(originals), marked)
    return marked


def _with_links_of_the_site(text, name, known, source):
    def replaced(found):
        words, target = found['words'], found['target']
        if target.startswith(('http:', 'https:', 'mailto:', '#')):
            return found[0]
        file, _, anchor = target.partition('#')
        path = os.path.normpath(os.path.join(os.path.dirname(name), file))
        if (ROOT/path).is_dir():
            path = path + '/README.md'
        if path.endswith('.md'):
            if path not in known:
                return words  # a folder of sources, for instance, is no page
            place = page_of(path) + '.md'
        else:
            place = path
            (source/place).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT/path, source/place)
        relative = os.path.relpath(place, os.path.dirname(page_of(name)) or '.')
        return f'{found["bang"]}[{words}]({relative}{"#" + anchor if anchor else ""})'

    # Pictures within links: the inner one first.
    text = re.sub(r'(?P<bang>!)\[(?P<words>[^\]]*)\]\((?P<target>[^)\s]+)\)', replaced, text)
    return re.sub(
        r'(?P<bang>(?<!!))\[(?P<words>(?:!\[[^\]]*\]\([^)]*\)|[^\[\]])*)\]\((?P<target>[^)\s]+)\)',
        replaced, text)


def _script_of(name, source):
    """An example's page shows its script, too, if it does not show the parts of it."""
    script = os.path.join(os.path.dirname(name), 'run.py')
    if not name.startswith('examples/') or not name.endswith('/README.md') or not (
            ROOT/script).exists() or shows_script(name):
        return ''
    (source/script).parent.mkdir(parents=True, exist_ok=True)
    shutil.copy(ROOT/script, source/script)
    return (f'\n\n## The script\n`{script}`:\n\n'
            '```{literalinclude} run.py\n:language: python\n```\n')


def _parent(page, pages):
    """The page below which another one stands in the table of contents, or None."""
    folder = os.path.dirname(page)
    if os.path.basename(page) in ('README', 'index'):
        folder = os.path.dirname(folder)
    while folder:
        for candidate in (folder + '/README', folder + '/index', PARENTS.get(folder)):
            if candidate in pages and candidate != page:
                return candidate
        folder = os.path.dirname(folder)
    return None


def write_contents(source, pages):
    """Add tables of contents.

    The first page gets that of the whole site, and a folder's page that of the folder.
    """
    pages = [page for page in pages if page != 'index']
    sections = [(title, _listed(source, entries, pages), folders)
                for title, entries, folders in SECTIONS]
    named = [page for _, listed, _ in sections for page in listed]
    children = {}
    for page in sorted(pages):
        if page not in named:
            children.setdefault(_parent(page, pages), []).append(page)
    for page in children.pop(None, []):
        next(listed for _, listed, folders in sections if any(
            page.startswith(folder) for folder in folders)).append(page)
    for page, below in children.items():
        _append(source, page, _in_order_of_links(source, page, below))
    for title, listed, _ in sections:
        _append(source, 'index', listed, title)


def _listed(source, entries, pages):
    """The pages of a section."""
    listed = []
    for entry in entries:
        if entry.endswith('/*'):
            first = entry[:-1] + 'README'
            inside = [page for page in pages if page.startswith(entry[:-1]) and page != first]
            listed += _in_order_of_links(source, first, inside)
        elif entry in pages:
            listed.append(entry)
    return listed


def _in_order_of_links(source, page, below):
    """Pages in the order of the links on another page; pages without a link come last."""
    file = source/(page + '.md')
    text = file.read_text(encoding='utf-8') if file.exists() else ''
    places = {
        each: text.find(f'({os.path.relpath(each, os.path.dirname(page) or ".")}.md')
        for each in below
    }
    return sorted(below, key=lambda each: (places[each] < 0, places[each]))


def _append(source, page, below, caption=None):
    entries = [f'{TITLES[each]} </{each}>' if each in TITLES else f'/{each}' for each in below]
    for ending in ('.md', '.rst'):
        file = source/(page + ending)
        if not file.exists():
            continue
        lines = [':hidden:'] + ([f':caption: {caption}'] if caption else []) + [''] + entries
        if ending == '.md':
            text = '\n\n```{toctree}\n' + '\n'.join(lines) + '\n```\n'
        else:
            text = '\n\n.. toctree::\n' + '\n'.join('   ' + line if line else ''
                                                    for line in lines) + '\n'
        with open(file, 'a', encoding='utf-8') as stream:
            stream.write(text)
