"""The report of a GridResult: errors of products on a grid against its fineness and against time.

It has texts, pictures, tables and one HTML page.
"""
from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ._pages import Report, paragraph, plain_ticks, section, sentence, table
from ._results import DECIDED, NONE, RECOMMENDED, UNUSABLE

if TYPE_CHECKING:
    import matplotlib.axes
    from ._results import Wanted

#: Errors for which the fineness is given, beside the fineness that the sampling of a Gaussian
#: needs.
NAMED = (1e-4, 1e-6, 1e-8)


def gaussianFineness(error: float) -> float:
    r"""The fineness sigma/dx at which a grid leaves out this part of a Gaussian.

    A grid leaves :math:`\exp(-(\pi \sigma/dx)^2)` of a Gaussian of width sigma out. The fineness is
    0.97, 1.18, 1.37 for errors of 1e-4, 1e-6, 1e-8.

    Parameters
    ----------
    error : float
    """
    return float(np.sqrt(np.log(1/error))/np.pi)


def milliseconds(seconds: float) -> str:
    """Seconds as text in milliseconds.

    Parameters
    ----------
    seconds : float
    """
    return f'{1e3*seconds:.3g}' if seconds < 1 else f'{1e3*seconds:.0f}'


class GridReport(Report):
    """The report of a GridResult.

    Parameters
    ----------
    result : GridResult
    wanted : str, or sequence of str
        wanted errors; the report answers each of them
    """

    FILES, PICTURE = ('grid.csv', 'grid.json', 'grid.html'), 'grid'
    TITLE, CHOICE, EXAMPLE = 'What the accuracy of a grid costs', 'tolerance', 'forces:1e-4'
    READING = (
        'On the left are errors against the fineness of the grid, in nodes for the width of the '
        'narrowest envelope. On the right are errors against the time of a product with the '
        'mobility. Points below the dashed line have the wanted error, and the best one is '
        'farthest to the left.')
    ADVICE = {
        (RECOMMENDED, DECIDED): (
            'The errors are norms of differences to the matrix of lattice sums. The '
            'answer is for the arrangement of this scene.',
            'Give the recommended tolerance to setSolverTolerance().'),
        (NONE, DECIDED): ('The errors are norms of differences to the matrix of lattice sums. Each '
                          'of them is above the wanted error.',
                          'Measure smaller tolerances (--tolerances), or accept a larger error.'),
        (NONE, UNUSABLE): ('No grid could be used, so that no error is known.',
                           'Measure other tolerances (--tolerances). The page says why each grid '
                           'could not be used.')
    }

    def compared(self) -> str:
        """What was compared, a sentence."""
        settings = sorted(
            {row['setting']
             for row in self.result.rows if row['kind'] == 'tolerance'})
        labels = (about['label'] for about in self.result.observables.values())
        return (f'Grids for these tolerances were compared: '
                f'{", ".join(f"{setting:g}" for setting in settings)}. '
                f'What was computed with each: {"; ".join(labels)}.')

    def describePicture(self, observable: str) -> str:
        """What the picture of an observable shows, for readers who do not see it."""
        label = self.result.observables[observable]['label']
        return (f'Left: errors of {label} against the fineness of the grid. Right: against the '
                f'time of a product. The table of {label} has all numbers.')

    def textTable(self) -> str:
        """Grids, errors and times by tolerance, as text."""
        head, rows = self._table()
        lines = [head, *(row for each in rows.values() for row in each)]
        widths = [max(len(line[k]) for line in lines) for k in range(len(head))]
        return '\n'.join('  '.join(cell.rjust(width) for cell, width in zip(line, widths))
                         for line in lines)

    def _table(self):
        """The head, and rows of texts by observable."""
        head = ('what', 'tolerance', 'nodes', 'sigma/dx', 'sqrt(ln 1/eps)/pi', 'error', 'over own',
                'random', 'ms a product')
        return head, {
            observable: [(observable, f'{row["setting"]:g}', row['nodes'], f'{row["fineness"]:.3f}',
                          f'{gaussianFineness(row["setting"]):.3f}', f'{row["error"]:.1e}',
                          f'{row["own_error"]:.1e}', f'{row["typical"]:.1e}',
                          milliseconds(row['seconds_product']))
                         for row in self.result.select(observable, 'tolerance')]
            for observable in self.result.observables
        }

    def paragraphs(self) -> list[str]:
        """The report as paragraphs, the answers first."""
        result = self.result
        lines = [answer.text for answer in self.answers]
        for observable, about in result.observables.items():
            rows = result.select(observable, 'tolerance')
            missed = [
                f'{row["setting"]:g} ({row["error"]:.1e})' for row in rows
                if row['error'] > row['setting']
            ]
            if rows:
                margins = [row['setting']/row['error'] for row in rows]
                lines.append(
                    f'{sentence(about["label"])}: ' +
                    (f'the error is above the tolerance at {", ".join(missed)}.' if missed else
                     f'every error is below its tolerance, by factors of {min(margins):.2g} to '
                     f'{max(margins):.2g}.') +
                    f' Over own mobilities errors are {about["norm"]:.1f} times as large: '
                    f'{max(row["own_error"]/row["setting"] for row in rows):.2g} tolerances and '
                    'less.')
            needed = {error: result.finenessFor(observable, error) for error in NAMED}
            if any(needed.values()):
                lines.append(f'{sentence(about["label"])}: errors of ' +
                             ', '.join(f'{error:g}' for error in NAMED) + ' need sigma/dx = ' +
                             ', '.join('n/a' if value is None else f'{value:.2f}'
                                       for value in needed.values()) +
                             ' by interpolation between grids; '
                             'the sampling of a Gaussian alone asks for ' +
                             ', '.join(f'{gaussianFineness(error):.2f}' for error in NAMED) + '.')
            spaced = result.select(observable, 'spacing')
            above = [row for row in spaced if row['error'] > row['described']]
            if spaced:
                lines.append(
                    f'{sentence(about["label"])}: of {len(spaced)} spacings ' +
                    ('none has an error' if not above else f'{len(above)} have errors') +
                    ' above the tolerance that describeEffects() says' +
                    (': sigma/dx = ' + ', '.join(
                        f'{row["fineness"]:.2f} ({row["error"]:.1e}, said {row["described"]:.1e})'
                        for row in above) if above else '') + '.')
        lines += [
            f'{row["observable"]}, {row["kind"]} {row["setting"]:g} cannot be used: '
            f'{row["message"]}' for row in result.rows if row['message']
        ]
        lines.append(
            f'By lattice sums a product takes {milliseconds(result.scene["seconds_dense"])} ms, '
            f'nearly all of it for the matrix.')
        return lines

    def panels(self, left: matplotlib.axes.Axes, right: matplotlib.axes.Axes, observable: str,
               limits: list[Wanted]) -> None:
        """Draw errors against sigma/dx beside errors against the time of a product.

        Parameters
        ----------
        left, right : matplotlib.axes.Axes
        observable : str
        limits : list of Wanted
            errors that are drawn as lines
        """
        result = self.result
        spaced, chosen = result.select(observable,
                                       'spacing'), result.select(observable, 'tolerance')
        finenesses = [row['fineness'] for row in (*spaced, *chosen)]
        curve = np.linspace(min(finenesses), max(finenesses), 100)
        left.plot(curve, np.exp(-(np.pi*curve)**2), color='black', lw=1, label='exp(−(π σ/dx)²)')
        for error in NAMED:
            x = gaussianFineness(error)
            left.plot([x, x], [error, 1], color='black', lw=0.7, ls=':')
            left.annotate(f'{x:.2f}', (x, 1), ha='center', va='bottom', fontsize=8.5)
        if spaced:
            left.plot([row['fineness'] for row in spaced], [row['error'] for row in spaced],
                      color='#0072B2', marker='.', lw=1.2, label='error, spacing given')
            left.plot([row['fineness'] for row in spaced], [row['typical'] for row in spaced],
                      color='#56B4E9', marker='.', lw=1, label='of random forces')
        left.plot([row['fineness'] for row in chosen], [row['error'] for row in chosen],
                  color='#D55E00', marker='o', ms=8, mfc='none', ls='',
                  label='error, tolerance given (written beside)')
        for axes, key in ((left, 'fineness'), (right, 'seconds_product')):
            for row in chosen:
                axes.annotate(f'{row["setting"]:.0e}'.replace('e-0', 'e-'),
                              (row[key]*(1e3 if axes is right else 1), row['error']),
                              textcoords='offset points', xytext=(7, 4), fontsize=8.5,
                              color='#D55E00')
        left.set_xlim(right=max(finenesses) + 0.1)
        left.set_xlabel('σ/dx, σ the narrowest envelope')
        right.plot([1e3*row['seconds_product'] for row in chosen], [row['error'] for row in chosen],
                   color='#D55E00', marker='o', label='error')
        right.plot([1e3*row['seconds_product'] for row in chosen],
                   [row['typical'] for row in chosen], color='#56B4E9', marker='o',
                   label='of random forces')
        right.axvline(1e3*result.scene['seconds_dense'], color='black', ls='-.', lw=1.2,
                      label='lattice sums')
        right.set_xscale('log')
        right.set_xlabel(f'ms a product ({result.provenance.get("platform")}, '
                         f'{result.provenance.get("threads")} thread(s))')
        for axes in (left, right):
            axes.set_yscale('log')
            axes.set_ylabel('error')
            axes.grid(True, which='major', alpha=0.35)
            for item in limits:
                axes.axhline(item.tolerance, color='black', ls='--', lw=1)
        if right.get_xlim()[0] > 0:
            low, high = right.get_xlim()
            right.set_xlim(low/1.1, high*1.3)
        plain_ticks(right)
        for axes in (left, right):
            axes.yaxis.set_major_formatter(
                lambda value, _: f'{value:.0e}'.replace('e-0', 'e-').replace('e+00', ''))
            axes.legend(fontsize=8.5)

    def body(self, pictures: dict) -> list[str]:
        """What the page has in addition to the paragraphs, as HTML.

        Parameters
        ----------
        pictures : dict
            observable -> PNG
        """
        head, rows = self._table()
        parts = []
        for observable, about in self.result.observables.items():
            parts += [section(sentence(about["label"])), paragraph(about['description'] + '.')]
            if observable in pictures:
                parts += [self.image(observable, pictures), table(head, rows[observable])]
            spaced = [(row['nodes'], f'{row["fineness"]:.3f}', f'{row["described"]:.1e}',
                       f'{row["error"]:.1e}', f'{row["own_error"]:.1e}', f'{row["typical"]:.1e}')
                      for row in self.result.select(observable, 'spacing')]
            if spaced:
                parts += [
                    '<h3>Spacings</h3>',
                    table(('nodes', 'sigma/dx', 'said', 'error', 'over own', 'random'), spaced)
                ]
        return parts

    def how(self) -> list[str]:
        """Paragraphs about how the study was measured."""
        about = self.result.provenance
        return [
            'Velocities are divided by the square roots of own mobilities, forces by those of own '
            'frictions. The error is the norm of the difference to the matrix of lattice sums, '
            'over the norm of that matrix. "Over own" is the norm of the difference alone, over '
            'own mobilities. Norms are eigenvalues, found by iterations. "Random" is the error of '
            'velocities from random forces, relative to these velocities, over four draws.',
            f'Times are the fastest of {about.get("rounds")} rounds in which the tolerances took '
            f'turns, on {about.get("platform")} with {about.get("threads")} thread(s) '
            '(with one thread CPU time, if less than by the clock). A product is called from '
            'Python, and computes the weights of all particles anew.'
        ]
