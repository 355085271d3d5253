"""The gallery: lists of examples in site/gallery.md become cards with their pictures."""
import os
import re

import PIL.Image
from collect import ROOT, git_files

#: Width of a thumbnail in pixels: twice that of cards, for screens with small pixels.
WIDTH = 560
ITEM = re.compile(
    r'^- \[(?P<title>[^\]]+)\]\((?P<page>examples/(?P<name>[^/)]+)/README\.md)\): '
    r'(?P<sentence>.+)$', flags=re.M)


def picture_of(page):
    """The first picture of a page, as (text alternative, path), or None."""
    found = re.search(r'!\[([^\]]+)\]\(([^)\s]+)\)', (ROOT/page).read_text(encoding='utf-8'))
    return found and (found[1], os.path.normpath(os.path.join(os.path.dirname(page), found[2])))


def _thumbnail(picture, target):
    with PIL.Image.open(ROOT/picture) as image:
        small = image.convert('RGBA')
        canvas = PIL.Image.new('RGBA', small.size, 'white')
        canvas.alpha_composite(small)
        canvas.thumbnail((WIDTH, WIDTH))
        target.parent.mkdir(parents=True, exist_ok=True)
        canvas.convert('RGB').save(target, optimize=True)


def _card(title, name, page, sentence, source):
    text, picture = picture_of(page)
    thumbnail = f'thumbnails/{name}.png'
    _thumbnail(picture, source/thumbnail)
    return f'- [![{text}]({thumbnail})]({page})\n\n  [{title}]({page})\n\n  {sentence}\n'


def _opening(page):
    """Title and first sentence of a page."""
    text = (ROOT/page).read_text(encoding='utf-8')
    title, _, rest = text.removeprefix('# ').partition('\n')
    paragraph = re.sub(r'\[([^\]]*)\]\([^)]*\)', r'\1',
                       ' '.join(rest.strip().split('\n\n')[0].split()))
    return title, re.split(r'(?<=[.:])\s', paragraph)[0].rstrip(':')


def write(source):
    """Make cards of the lists in the gallery's page; examples without a place come at its end."""
    file = source/'gallery.md'
    text = file.read_text(encoding='utf-8')
    named = {found['page'] for found in ITEM.finditer(text)}
    rest = [
        page for page in git_files('examples/*/README.md') if page not in named and picture_of(page)
    ]
    if rest:
        text += '\n## More\n' + ''.join('- [{1}]({0}): {2}\n'.format(page, *_opening(page))
                                        for page in rest)
    text = re.sub(r'((?:^- \[.*\n)+)', r'```{container} cards\n\1```\n', text, flags=re.M)
    text = ITEM.sub(
        lambda found: _card(found['title'], found['name'], found['page'], found['sentence'], source
                            ), text)
    file.write_text(text, encoding='utf-8')
