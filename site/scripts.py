"""Parts of scripts on pages.

A page shows parts of the script beside it, `run.py`, by the comment

    <!-- script: imports, RADIUS, approach -->

so each line of code has one source. The comment stands for the script's imports, constants,
functions and classes of these names, with the comments before them.
"""
import ast
import pathlib
import re

ROOT = pathlib.Path(__file__).resolve().parents[1]
MARKER = re.compile(r'^<!-- script: ([^\n]*) -->$', flags=re.M)


def with_script(text, script):
    """The text of a page with the parts of its script as blocks of Python."""
    if not MARKER.search(text):
        return text
    parts = parts_of(pathlib.Path(script).read_text(encoding='utf-8'))

    def block(found):
        names = found[1].split(', ')
        if unknown := [name for name in names if name not in parts]:
            raise ValueError(f'{script} has no {", ".join(unknown)}, which its page shows')
        return '```python\n' + _joined([parts[name] for name in names]) + '```'

    return MARKER.sub(block, text)


def page_text(page):
    """The text of a page of the repository, with the parts of its script."""
    file = ROOT/page
    return with_script(file.read_text(encoding='utf-8'), file.parent/'run.py')


def shows_script(page):
    """Whether a page of the repository shows parts of its script."""
    return MARKER.search((ROOT/page).read_text(encoding='utf-8')) is not None


def parts_of(source):
    """What a script has at its top level, by name: text with the comments before it.

    `imports` are the imports that are used outside main().
    """
    lines, tree = source.splitlines(keepends=True), ast.parse(source)
    parts, imports = {}, []
    used = {
        node.id
        for part in tree.body if getattr(part, 'name', None) != 'main' for node in ast.walk(part)
        if isinstance(node, ast.Name)
    }
    for part in tree.body:
        first = min([part.lineno, *(each.lineno for each in getattr(part, 'decorator_list', []))])
        first -= 1
        while first and lines[first - 1].startswith('#') and not lines[first - 1].startswith('#!'):
            first -= 1
        text = ''.join(lines[first:part.end_lineno])
        if isinstance(part, (ast.Import, ast.ImportFrom)):
            if used & {(each.asname or each.name).split('.')[0] for each in part.names}:
                imports.append(text)
        elif isinstance(part, ast.Assign):
            for target in part.targets:
                for name in ast.walk(target):
                    if isinstance(name, ast.Name):
                        parts[name.id] = text
        elif hasattr(part, 'name'):
            parts[part.name] = text
    parts['imports'] = ''.join(imports)
    return parts


def _joined(texts):
    """Parts of a script, one below the other: two empty lines around functions and classes."""
    text = texts[0]
    for before, after in zip(texts, texts[1:]):
        apart = any(re.search(r'^(def|class) ', each, flags=re.M) for each in (before, after))
        text += ('\n\n' if apart else '\n' if before.startswith(('import', 'from')) else '') + after
    return text
