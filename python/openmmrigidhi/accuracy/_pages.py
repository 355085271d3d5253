"""How the reports of all studies are made: pictures, and one self-contained HTML page."""
from __future__ import annotations

import base64
import html
import io
import os
import re
from typing import TYPE_CHECKING, Any, Collection, Iterable, Optional, Sequence, Union

import numpy as np

from .._types import Path
from ._results import finite, times

if TYPE_CHECKING:
    import matplotlib.axes
    import matplotlib.figure
    from ._results import Result
    from ._results import Wanted

#: The place in an advice where the factor of the answer comes in.
FACTOR = '{factor}'


class Report:
    """The report about a result, for some wanted errors, and its files.

    A subclass has the texts and panels of its study: textTable(), paragraphs(), panels(), body(),
    how().

    Parameters
    ----------
    result : Result
    wanted : str, or sequence of str
        wanted errors; the report answers each of them
    """

    #: Names of the CSV, the JSON and the page; beginning of the names of pictures.
    FILES, PICTURE = (), ''
    #: Title of the page, before the scene's name; what is chosen for a wanted error; an example of
    #: a wanted error.
    TITLE, CHOICE, EXAMPLE = '', '', ''
    #: How a picture is read: what the points, lines and colours are, and which ones are good.
    READING = ''
    #: (verdict, reason) of an answer -> how sure the answer is, and what to do with it.
    ADVICE = {}
    #: The parts of an answer that the JSON keeps.
    ANSWER = ('verdict', 'setting', 'text', 'candidates')

    def __init__(self, result: Result, wanted: Union[str, Sequence[str]] = ()) -> None:
        self.result = result
        self.wanted = [wanted] if isinstance(wanted, str) else list(wanted)
        self.answers = [result.recommend(item) for item in self.wanted]
        #: Several observables with commas share an answer; here they are one by one.
        self.single = list(
            dict.fromkeys(part.strip() for item in self.wanted for part in item.split(',')))

    def write(self, directory: Path) -> list[str]:
        """Write all files into a directory, and return their paths.

        The directory is made if it does not exist.
        """
        os.makedirs(directory, exist_ok=True)
        paths = [os.path.join(directory, name) for name in self.FILES]
        self.result.writeCsv(paths[0])
        self.result.writeJson(paths[1], **self.extras())
        pictures = {}
        for observable in self.result.observables:
            if any(row['error'] is not None for row in self.result.select(observable)):
                pictures[observable] = self.draw(observable)
                path = os.path.join(
                    directory, f'{self.PICTURE}_{re.sub("[^A-Za-z0-9_]", "_", observable)}.png')
                with open(path, 'wb') as file:
                    file.write(pictures[observable])
                paths.append(path)
        for name, content in self.otherPictures().items():
            paths.append(os.path.join(directory, name))
            with open(paths[-1], 'wb') as file:
                file.write(content)
        with open(paths[2], 'w') as file:
            file.write(self.page(pictures))
        return paths

    def otherPictures(self) -> dict[str, bytes]:
        """Pictures in addition to those of observables' errors: file name -> PNG."""
        return {}

    def answerTexts(self) -> list[str]:
        """The answers as text, with which paragraphs() begins."""
        return [answer.text for answer in self.answers]

    def extras(self) -> dict:
        """What the JSON has in addition to the result."""
        return {
            'recommendations': [{
                'wanted': [vars(each) for each in answer.wanted],
                **{key: finite(getattr(answer, key))
                   for key in self.ANSWER}
            } for answer in self.answers]
        }

    def limits(self, observable: str) -> list[Wanted]:
        """The wanted errors of one observable."""
        return [
            each for item in self.single for each in self.result.parseWanted(item)
            if each.observable == observable
        ]

    def draw(self, observable: str) -> bytes:
        """The picture of an observable, a PNG."""
        figure, panels = empty_panels(
            f'{sentence(self.result.observables[observable]["label"])}, '
            f'{self.result.scene["name"]}', self.widths(observable))
        self.panels(*panels, observable, self.limits(observable))
        return png(figure, f'Error of {observable}')

    def widths(self, observable: str) -> Sequence[float]:
        """The relative widths of the panels of a picture."""
        return 1.35, 1

    def questions(self) -> list[str]:
        """What was asked, a sentence for each answer."""
        return [
            f'Which {self.CHOICE} is the cheapest with an error of at most '
            f'{" and ".join(each.text for each in answer.wanted)}?' for answer in self.answers
        ]

    def advice(self) -> tuple[list[str], list[str]]:
        """How sure the answers are, and what to do with them: two lists of paragraphs."""
        return advise(self)

    def compared(self) -> str:
        """What was compared, a sentence."""
        raise NotImplementedError

    def describePicture(self, observable: str) -> str:
        """What the picture of an observable shows, for readers who do not see it."""
        raise NotImplementedError

    def image(self, observable: str, pictures: dict[str, bytes]) -> str:
        """The picture of an observable as HTML; a reference to it, if it stands with the answer."""
        if observable == self._shown(pictures):
            return '<p>The picture is <a href="#answer">with the answer</a>.</p>'
        return picture(pictures[observable], self.describePicture(observable))

    def _shown(self, pictures):
        """The observable whose picture stands with the answer: the first one that was asked for."""
        asked = [each.observable for item in self.single for each in self.result.parseWanted(item)]
        return next((name for name in (*asked, *pictures) if name in pictures), None)

    def page(self, pictures: dict[str, bytes]) -> str:
        """One HTML page with everything in it; nothing is loaded from elsewhere.

        It begins with what was asked, the answers with a picture, how sure they are, and what to
        do.

        pictures: observable -> PNG.
        """
        title, texts = f'{self.TITLE}: {self.result.scene["name"]}', self.paragraphs()
        count, shown = len(self.answerTexts()), self._shown(pictures)
        parts = [
            section('What was asked'), *map(paragraph, self.questions()),
            paragraph(self.compared()),
            paragraph(f'The scene: {self.result.scene["description"]}.'),
            section('The answer', 'answer')
        ]
        parts += [f'<p class="answer">{html.escape(text)}</p>' for text in texts[:count]]
        if not count:
            parts.append(
                paragraph(
                    f'No wanted error was given. With a wanted error (for example {self.EXAMPLE}) '
                    f'this page names the cheapest {self.CHOICE}.'))
        if shown:
            parts += [
                picture(pictures[shown], self.describePicture(shown)),
                paragraph('How to read the picture: ' + self.READING)
            ]
        sure, following = self.advice()
        if sure:
            parts += [
                section('How sure it is'), *map(paragraph, sure),
                section('What to do'), *map(paragraph, following)
            ]
        if texts[count:]:
            parts += [section('What else was found'), *map(paragraph, texts[count:])]
        parts += self.body(pictures)
        parts += [
            section('How it was measured'), *map(paragraph, self.how()),
            '<details><summary>Machine, versions, seed</summary>' +
            table(None, _flatten(self.result.provenance), notes=True) + '</details>'
        ]
        links = [
            f'<a href="#{found[1]}">{found[2]}</a>' for part in parts
            for found in re.finditer('<h2 id="([^"]*)">(.*?)</h2>', part)
        ]
        return '\n'.join([
            '<!DOCTYPE html>', '<html lang="en"><head><meta charset="utf-8">'
            '<meta name="viewport" content="width=device-width, initial-scale=1">'
            f'<title>{html.escape(title)}</title><style>{_CSS}</style></head><body>',
            f'<h1>{html.escape(title)}</h1>', f'<nav aria-label="Contents">{" ".join(links)}</nav>',
            '<main>', *parts, '</main>', '</body></html>'
        ]) + '\n'


def advise(report: Any) -> tuple[list[str], list[str]]:
    """How sure the answers of a report are, and what to do with them, each text once.

    Where the texts differ, each one begins with the wanted errors that it is about.

    Parameters
    ----------
    report : object
        with answers and the texts ADVICE, by verdict and reason

    Returns
    -------
    (list of str, list of str)
    """
    found: tuple[dict, dict] = ({}, {})
    for answer in report.answers:
        about = ' and '.join(item.text for item in answer.wanted)
        for texts, text in zip(found, report.ADVICE[answer.verdict, answer.reason]):
            text = text.replace(FACTOR, times(answer.factor)) if FACTOR in text else text
            texts.setdefault(text, []).append(about)
    sure, following = ([
        text if len(texts) == 1 else f'For {"; ".join(abouts)}: {text}'
        for text, abouts in texts.items()
    ] for texts in found)
    return sure, following


# ---- Pictures ------------------------------------------------------------------------------------


def empty_panels(title: str, widths: Sequence[float]) -> tuple:
    """An empty figure with panels side by side, of relative widths: (figure, panels)."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    # Not pyplot: no window system, no global state.
    figure = Figure(figsize=(12.5 if len(widths) < 3 else 16, 5.6), layout='constrained')
    FigureCanvasAgg(figure)
    panels = figure.subplots(1, len(widths), gridspec_kw={'width_ratios': widths})
    figure.suptitle(title, fontsize=13)
    return figure, panels


def png(figure: matplotlib.figure.Figure, title: str) -> bytes:
    """The bytes of a picture."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format='png', dpi=110, metadata={'Title': title, 'Software': None})
    return buffer.getvalue()


def plain_ticks(axes: matplotlib.axes.Axes) -> None:
    """Numbers such as 0.2 and 50 on logarithmic axes, a list of them that is not too long."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
    for axis in (axes.xaxis, axes.yaxis):
        if axis.get_scale() != 'log':
            continue
        low, high = axis.get_view_interval()
        decades = np.log10(high/low)
        axis.set_major_locator(LogLocator(subs=(1, 2, 5) if decades < 2.5 else (1,), numticks=20))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f'{value:g}'))
        axis.set_minor_formatter(NullFormatter())


# ---- HTML ----------------------------------------------------------------------------------------

# On a narrow window pictures and tables are moved by finger or arrow keys, not the page.
_CSS = '''body{font:16px/1.5 sans-serif;max-width:1150px;margin:2em auto;padding:0 1em;color:#222}
main>p{max-width:46em}img{width:100%;min-width:720px;height:auto}a{color:#005a8c}
nav{display:flex;flex-wrap:wrap;gap:.2em 1.2em;margin:1em 0}nav a{padding:.3em 0}
a:focus,summary:focus,.wide:focus{outline:3px solid #E69F00;outline-offset:2px}
.wide{overflow-x:auto}table{border-collapse:collapse;font-size:14px;margin:1em 0}
td,th{border:1px solid #ccc;padding:2px 8px;text-align:right}
th{background:#f0f0f0}td:first-child,th:first-child,td.t{text-align:left}tr.bad td{color:#666}
.answer{background:#eef5fb;border-left:5px solid #0072B2;padding:.6em 1em;margin:.6em 0}
summary{cursor:pointer;font-weight:bold}'''


def sentence(text: str) -> str:
    """The text with a capital at the start."""
    return text[:1].upper() + text[1:]


def number(value: Optional[float], form: str) -> str:
    """A number as text, empty for none."""
    return '' if value is None else format(value, form)


def duration(seconds: float) -> str:
    """Seconds as text: three digits, in a suitable unit.

    Parameters
    ----------
    seconds : float
    """
    if not np.isfinite(seconds):
        return 'never'
    units = (('d', 86400), ('h', 3600), ('min', 60), ('s', 1), ('ms', 1e-3), ('us', 1e-6))
    name, scale = next((each for each in units if seconds >= each[1]*(2 if each[1] > 1 else 1)),
                       units[-1])
    return f'{seconds/scale:.3g} {name}'


def section(title: str, name: Optional[str] = None) -> str:
    """The heading of a section, which the contents refer to.

    Parameters
    ----------
    title : str
        plain text
    name : str, optional
        of the anchor; default: from the title
    """
    name = name or re.sub('[^a-z0-9]+', '-', title.lower()).strip('-')
    return f'<h2 id="{name}">{html.escape(title)}</h2>'


def paragraph(text: str) -> str:
    """A paragraph of plain text."""
    return f'<p>{html.escape(text)}</p>'


def picture(content: bytes, text: str) -> str:
    """A PNG within a page; the text describes it for readers who do not see it."""
    return ('<div class="wide" tabindex="0" role="region" aria-label="Picture">'
            f'<img alt="{html.escape(text)}" '
            f'src="data:image/png;base64,{base64.b64encode(content).decode()}"></div>')


def table(head: Optional[Sequence[str]], rows: Iterable[Sequence[str]], notes: bool = False,
          pale: Collection[int] = ()) -> str:
    """A table of texts.

    Parameters
    ----------
    head : sequence of str, or None
    rows : iterable of sequence of str
    notes : bool
        the last column is for texts
    pale : collection of int
        rows that are grey
    """
    def line(tag, cells, shade=''):
        opening = 'th scope="col"' if tag == 'th' else tag
        tags = [opening]*(len(cells) - notes) + [f'{tag} class="t"' if tag == 'td' else opening
                                                 ]*notes
        return f'<tr{shade}>' + ''.join(f'<{opening}>{html.escape(cell)}</{tag}>'
                                        for opening, cell in zip(tags, cells)) + '</tr>'

    return '\n'.join([
        '<div class="wide" tabindex="0" role="region" aria-label="Table"><table>',
        *([line('th', head)] if head else
          ()), *(line('td', row, ' class="bad"' if k in pale else '')
                 for k, row in enumerate(rows)), '</table></div>'
    ])


def _flatten(data):
    for key, value in data.items():
        if isinstance(value, dict):
            yield from ((f'{key}: {name}', str(each)) for name, each in value.items())
        else:
            yield key, str(value)
