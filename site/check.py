#!/usr/bin/env python3
"""Find faults on built pages.

Faults are links that lead nowhere, pictures that are missing or have no text alternative, things
fetched from elsewhere, and scripts that do not run.
"""
import argparse
import html.parser
import pathlib
import re
import sys
import urllib.parse

#: What a browser fetches to show a page, by element and attribute.
FETCHED = {('img', 'src'), ('script', 'src'), ('link', 'href'), ('source', 'src'), ('video', 'src'),
           ('iframe', 'src'), ('object', 'data')}


class _Page(html.parser.HTMLParser):
    """The links of a page, and the anchors on it."""
    def __init__(self):
        super().__init__()
        self.links, self.fetched, self.anchors, self.silent, self.scripts = [], [], set(), [], []

    def handle_starttag(self, tag, attributes):
        attributes = dict(attributes)
        self.anchors |= {
            attributes[key]
            for key in ('id', 'name') if attributes.get(key) and (key == 'id' or tag == 'a')
        }
        for key, value in attributes.items():
            if (tag, key) in FETCHED:
                self.fetched.append(value or '')
            elif key == 'href' and value is not None:
                self.links.append(value)
        if tag == 'script' and attributes.get('src') and attributes.get('type') != 'module':
            self.scripts.append(attributes['src'])
        if tag == 'img' and not _says_something(attributes):
            self.silent.append(attributes.get('src', ''))


def _says_something(attributes):
    """Whether a picture has a text alternative other than its own name."""
    text = (attributes.get('alt') or '').strip()
    return bool(text) and not text.endswith(
        ('.png', '.gif', '.jpg', '.svg')) and text != attributes.get('src')


def _read(folder):
    pages = {}
    for file in sorted(folder.rglob('*.html')):
        page = _Page()
        page.feed(file.read_text(encoding='utf-8'))
        pages[file.resolve()] = page
    return pages


def faults(folder):
    """All faults of the pages in a folder, a line each."""
    folder = pathlib.Path(folder).resolve()
    pages = _read(folder)
    found = [] if pages else [f'{folder}: there are no pages']
    for file, page in pages.items():
        name = file.relative_to(folder)
        found += [f'{name}: the picture {source} has no text alternative' for source in page.silent]
        found += [
            f'{name}: {target} is fetched from elsewhere' for target in page.fetched
            if _is_elsewhere(target)
        ]
        for target in page.links + page.fetched:
            if not _is_elsewhere(target) and not target.startswith(('mailto:', 'data:')):
                found += _objection(name, file, target, folder, pages)
        found += [
            f'{name}: {script} is a module, but is loaded as a plain script'
            for script in page.scripts if _is_module(file.parent/script)
        ]
    for file in sorted(folder.rglob('*.css')):
        for target in re.findall(r'url\(\s*["\']?([^"\')]+)', file.read_text(encoding='utf-8')):
            name = file.relative_to(folder)
            if _is_elsewhere(target):
                found.append(f'{name}: {target} is fetched from elsewhere')
            elif not target.startswith(
                ('data:', '#')) and not (file.parent/re.split('[?#]', target)[0]).exists():
                found.append(f'{name}: {target} is not there')
    return list(dict.fromkeys(found))


def _is_module(file):
    file = file.with_name(file.name.split('?')[0])
    return file.exists() and re.search(r'^(import|export) ', file.read_text(encoding='utf-8'),
                                       flags=re.M) is not None


def _is_elsewhere(target):
    return target.startswith(('http:', 'https:', '//'))


def _objection(name, file, target, folder, pages):
    """What is wrong with a link within the site."""
    parts = urllib.parse.urlsplit(target)
    place = (file.parent/urllib.parse.unquote(parts.path)).resolve() if parts.path else file
    if place.is_dir():
        place = place/'index.html'
    if folder not in place.parents or not place.exists():
        return [f'{name}: {target} is not there']
    anchor = urllib.parse.unquote(parts.fragment)
    if anchor and place in pages and anchor not in pages[place].anchors:
        return [f'{name}: {target} leads to no place on that page']
    return []


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('folder', type=pathlib.Path, help='where the pages are')
    found = faults(parser.parse_args().folder)
    print('\n'.join(found) if found else 'No faults.')
    sys.exit(bool(found))


if __name__ == '__main__':
    main()
