"""The gallery: lists of examples in site/gallery.md become cards with their pictures."""
import os
import re

import numpy as np
import PIL.Image
from collect import ROOT, git_files

#: Width of a thumbnail in pixels: twice that of cards, for screens with small pixels.
WIDTH = 560
#: The panel that a thumbnail shows of a picture with several: left, top, right and bottom, as
#: fractions of the picture. The edges move to the nearest gap between panels.
PANELS = {
    'boomerang_at_a_wall': (0, 0, 0.5, 1),
    'flow_pictures': (0.385, 0, 1, 1),
    'ions_in_water': (0, 0, 0.45, 1),
    'jointed_chain': (0, 0, 0.33, 1),
    'pillars': (0, 0, 0.5, 0.5),
    'rigid_protein': (0, 0, 0.33, 1),
    'ring_of_driven_spheres': (0, 0, 0.5, 1),
    'roller': (0, 0.53, 1, 1),
    'sedimenting_cluster': (0.75, 0, 1, 1),
    'squirmers': (0, 0, 0.32, 0.6),
    'towing': (0, 0, 0.33, 1),
    'water_demo': (0.52, 0.5, 1, 1)
}
#: How far an edge may be from a gap, as a fraction of the picture.
REACH = 0.06
#: Brighter pixels are no ink, on a scale up to 255.
WHITE = 250
ITEM = re.compile(
    r'^- \[(?P<title>[^\]]+)\]\((?P<page>examples/(?P<name>[^/)]+)/README\.md)\): '
    r'(?P<sentence>.+)$', flags=re.M)


def picture_of(page):
    """The first picture of a page, as (text alternative, path), or None."""
    found = re.search(r'!\[([^\]]+)\]\(([^)\s]+)\)', (ROOT/page).read_text(encoding='utf-8'))
    return found and (found[1], os.path.normpath(os.path.join(os.path.dirname(page), found[2])))


def _nearest_gap(blank, fraction):
    """The place in the middle of the gap next to a fraction of the lines, some of them blank, or
    None."""
    place, last = round(fraction*len(blank)), len(blank)
    if place in (0, last):
        return place
    gaps = np.flatnonzero(blank)
    near = gaps[np.argmin(np.abs(gaps - place))] if len(gaps) else -last
    if abs(near - place) > REACH*last:
        return None
    lowest = highest = near
    while lowest and blank[lowest - 1]:
        lowest -= 1
    while highest < last - 1 and blank[highest + 1]:
        highest += 1
    return (lowest + highest) // 2


def panel(image, box):
    """The part of a white picture around a box of fractions, without its white margins, or None.

    A gap between columns need not go through all rows, nor one between rows through all columns.
    """
    left, top, right, bottom = box
    pixels = np.asarray(image.convert('L'))
    for order in ((0, 1), (1, 0)):
        corner, part = [0, 0], pixels
        for axis in order:
            blank = (part >= WHITE).all(axis=1 - axis)
            edges = [_nearest_gap(blank, each) for each in ((top, bottom), (left, right))[axis]]
            if None in edges:
                break
            corner[axis], part = edges[0], part.take(range(*edges), axis)
        else:
            y, x = np.nonzero(part < WHITE)
            y, x = y + corner[0], x + corner[1]
            return image.crop((x.min(), y.min(), x.max() + 1, y.max() + 1))
    return None


def _thumbnail(picture, name, target):
    with PIL.Image.open(ROOT/picture) as image:
        small = image.convert('RGBA')
        canvas = PIL.Image.new('RGBA', small.size, 'white')
        canvas.alpha_composite(small)
        canvas = canvas.convert('RGB')
        if name in PANELS:
            canvas = panel(canvas, PANELS[name])
            if canvas is None:
                raise ValueError(f'{picture} has no gap between panels where it should have one: '
                                 f'correct PANELS in site/gallery.py')
        canvas.thumbnail((WIDTH, WIDTH))
        target.parent.mkdir(parents=True, exist_ok=True)
        canvas.save(target, optimize=True)


def _card(title, name, page, sentence, source):
    text, picture = picture_of(page)
    if name in PANELS:
        text = f'A panel of the picture on the page "{title}"'
    thumbnail = f'thumbnails/{name}.png'
    _thumbnail(picture, name, source/thumbnail)
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
