"""The pictures and tables of prices.

The pictures show total error against time, and the time to a wanted error against the knob.
"""
from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, Sequence, Union

import numpy as np

from ._pages import FACTOR, duration, empty_panels, number, plain_ticks, png, sentence, table
from ._results import (DECIDED, HARDLY, LONGER, NO_MEAN, NO_REFERENCE, NONE, RECOMMENDED, REFERENCE,
                       SMALL_STEPS, UNDECIDED, UNUSABLE, finite)
from .price import OPEN, Prices, aim

if TYPE_CHECKING:
    from ._results import Recommendation
    from .result import StudyResult

#: Uncertainties are drawn for at most so many settings, to keep the picture readable.
MOST_BANDS = 2
#: Curves end at this many times the longest time of interest.
MARGIN = 20
#: Settings whose price is so many times the least do not widen a picture.
FAR = 100


class PriceReport:
    """Pictures, tables and JSON of the answers about prices.

    Parameters
    ----------
    result : StudyResult
    price : str, or sequence of str
        wanted total errors; the report gives the price of each
    spend : sequence of (str, float)
        observables, and seconds to spend on them
    style : dict
        method -> (colour, marker)
    areMany : bool
        whether there are so many methods that their legend is below the panels
    """

    _LEAST = (
        'The recommended setting takes the least time of the settings whose bias is '
        'below the wanted total error with the stated confidence. Its time is an estimate, since '
        'the bias, the correlation time and the speed are measured: the interval beside the time '
        'shows how well they are known.')
    _TAKE = (
        'Take the recommended scheme and step, for the time that the answer names. Settings that '
        'are not distinguishable from it serve as well.')
    _OPEN = 'This study cannot tell the price: no bias is known well enough.'
    _OTHER_ERROR = ('ask for a larger total error (--from results.json --price, which '
                    'measures nothing anew)')
    ADVICE = {
        (RECOMMENDED, DECIDED): (_LEAST, _TAKE),
        (RECOMMENDED, LONGER): (
            _LEAST,
            f'{_TAKE} A study that is about {FACTOR} times as long (--budget) decides about '
            'one or more of the settings that may cost less.'),
        (RECOMMENDED, HARDLY): (
            _LEAST, f'{_TAKE} About the settings that may cost less no study of a sensible length '
            f'decides; to learn about them, {_OTHER_ERROR}.'),
        (RECOMMENDED, SMALL_STEPS): (
            _LEAST,
            f'{_TAKE} To learn about the settings that may cost less, measure smaller steps '
            '(--steps), from which the limit of small steps is known better.'),
        (RECOMMENDED, REFERENCE): (
            _LEAST, f'{_TAKE} To learn about the settings that may cost less, give a more accurate '
            'reference (--reference).'),
        (NONE, DECIDED): (
            'No time suffices: the bias of every stable setting that can be judged exceeds the '
            'wanted total error with the stated confidence.',
            'Measure smaller steps or other schemes (--steps, --methods), or accept a larger total '
            'error.'),
        (NONE, UNUSABLE): ('No setting was stable, so that nothing is known about prices.',
                           'Measure smaller steps (--steps). The table says how each run ended.'),
        (UNDECIDED, LONGER): (
            _OPEN, f'Make the study about {FACTOR} times as long (--budget), or {_OTHER_ERROR}.'),
        (UNDECIDED, HARDLY): (
            _OPEN,
            'No study of a sensible length decides about biases that are so near to the wanted '
            f'total error, or so small: {_OTHER_ERROR}.'),
        (UNDECIDED, SMALL_STEPS): (
            'This study cannot tell the price: the limit of small steps, with which settings are '
            'compared, is not known well enough.',
            f'Measure smaller steps (--steps), or {_OTHER_ERROR}.'),
        (UNDECIDED, REFERENCE): (
            'This study cannot tell the price: the reference that was given is not known well '
            'enough.', f'Give a more accurate reference (--reference), or {_OTHER_ERROR}.'),
        (UNDECIDED, NO_REFERENCE): (
            'This study cannot tell the price: there is no value with which the settings could be '
            'compared, or there is no correlation time.',
            'Measure smaller steps (--steps), or give a reference (--reference), with runs that '
            'have samples.'),
        (UNDECIDED, NO_MEAN): (
            'This study cannot tell the price: the observable has no mean at any stable setting.',
            'Look at the observable: the answer says why there is no mean. Where samples are too '
            'few, make the study longer (--budget) or samples more frequent (--sample-interval); '
            'where they are not numbers, measure another observable (--observables).')
    }

    def __init__(self, result: StudyResult, price: Union[str, Sequence[str]],
                 spend: Sequence[tuple[str, float]], style: dict, areMany: bool = False) -> None:
        self.result = result
        self.style = style
        self.areMany = areMany
        self.prices = Prices(result)
        self.wanted = [price] if isinstance(price, str) else list(price)
        self.answers = [result.price(item) for item in self.wanted]
        self.spend = list(spend)
        self.spendings = [result.spend(*item) for item in self.spend]

    def texts(self) -> list:
        """The answers as text."""
        return [answer.text for answer in self.answers + self.spendings]

    def asDict(self) -> dict:
        """The answers as a dict for JSON, where infinite numbers are null."""
        def plain(answer, **about):
            return {
                **about,
                **{
                    key: finite(getattr(answer, key))
                    for key in ('verdict', 'setting', 'factor', 'text', 'candidates')
                }
            }

        result = {}
        if self.answers:
            result['prices'] = [
                plain(answer, wanted=[vars(each) for each in answer.wanted])
                for answer in self.answers
            ]
        if self.spendings:
            result['spendings'] = [
                plain(answer, observable=name, seconds=seconds)
                for (name, seconds), answer in zip(self.spend, self.spendings)
            ]
        return result

    def pictures(self) -> dict[str, bytes]:
        """File name -> PNG, one for each wanted error that has a price."""
        return {
            self.fileName(item): self.draw(item, answer)
            for item, answer in zip(self.wanted, self.answers) if any(
                math.isfinite(each['seconds']) for each in answer.candidates)
        }

    @staticmethod
    def fileName(wanted: str) -> str:
        """The file name of the picture of a wanted error.

        Parameters
        ----------
        wanted : str
        """
        return f'price_{re.sub("[^A-Za-z0-9_.]+", "_", wanted.replace("%", "pc"))}.png'

    # ---- Pictures --------------------------------------------------------------------------------

    def draw(self, wanted: str, answer: Recommendation) -> bytes:
        """Draw total error against time, and the time to the wanted error; return a PNG.

        The total error has a panel for each observable. The time is drawn against the knob.

        Parameters
        ----------
        wanted : str
        answer : Recommendation
        """
        figure, panels = empty_panels(
            f'What it takes to know {" and ".join(aim(item) for item in answer.wanted)}, '
            f'{self.result.scene["name"]}', [1.35]*len(answer.wanted) + [1])
        for axes, item in zip(panels, answer.wanted):
            self._draw_errors(axes, item, answer)
        self._draw_times(panels[-1], answer)
        if self.areMany:
            self._legend_below(figure, panels)
        return png(figure, f'Price of {wanted}')

    @staticmethod
    def _legend_below(figure, panels):
        """One legend for all panels, below them, with as much room as it needs."""
        entries = {}
        for axes in panels:
            axes.get_legend().remove()
            for handle, label in zip(*axes.get_legend_handles_labels()):
                entries[label] = handle
        columns = 4
        inches = 0.19*math.ceil(len(entries)/columns) + 0.35
        width, height = figure.get_size_inches()
        figure.set_size_inches(width, height + inches)
        bottom = inches/(height + inches)
        figure.get_layout_engine().set(rect=(0, bottom, 1, 1 - bottom))
        figure.legend(entries.values(), entries.keys(), loc='lower center', ncol=columns,
                      fontsize=8, title='thick: the best setting of a method, by time',
                      title_fontsize=8)

    def _draw_errors(self, axes, item, answer):
        result, reference = self.result, self.result.references[item.observable].value
        scale = 100/abs(reference) if reference else 1.0
        finite = _positive_times(answer)
        known = self.prices.known(item.observable)
        # Before the end of the first equilibration there is nothing to see.
        first = max(np.nanmin(known.equilibration/self.prices.speed), min(finite)/MARGIN)
        seconds = np.geomspace(first, min(max(finite), FAR*min(finite))*MARGIN, 200)
        errors, low, high = (
            values*scale
            for values in self.prices.curves(item.observable, seconds, result.confidence))
        best = []
        for each in answer.candidates:
            if each['bias'] == 'yes' and each['method'] not in [one[0] for one in best]:
                best.append((each['method'], each['value']))
        bottom = np.inf
        for method in result.methods():
            colour, marker = self.style[method]
            mine = [
                k for k, key in enumerate(self.prices.keys)
                if key[0] == method and np.isfinite(errors[:, k]).any()
            ]
            if not mine:
                continue
            for k in mine:
                axes.plot(seconds, errors[:, k], color=colour, lw=0.7, alpha=0.35, zorder=1)
            own = np.array(mine)[errors[:, mine].argmin(axis=1)]
            envelope = errors[np.arange(len(seconds)), own]
            # Where there are many methods a colour is not enough.
            axes.plot(seconds, np.where(np.isfinite(envelope), envelope,
                                        np.nan), color=colour, lw=1.5 if self.areMany else 2.2,
                      zorder=3, label=method, marker=marker if self.areMany else None,
                      markevery=(len(seconds) // 12, 25), ms=6)
            bottom = min(bottom, envelope.min())
            self._name_settings(axes, seconds, envelope, own, colour)
            for key in [(name, value) for name, value in best[:MOST_BANDS] if name == method]:
                k = self.prices.keys.index(key)
                there = np.isfinite(low[:, k])
                axes.fill_between(
                    seconds[there], low[there, k], np.minimum(high[there, k], 1e6), color=colour,
                    alpha=0.18, lw=0, zorder=0, label=f'{100*result.confidence:g} % interval, ' +
                    (f'{method}, ' if self.areMany else '') + result.knob.format(key[1]))
        axes.axhline(item.tolerance*scale, color='black', ls='--', lw=1.2, zorder=2)
        axes.annotate('wanted: ' + item.text.split(' of ')[0], (0.99, item.tolerance*scale),
                      xycoords=('axes fraction', 'data'), xytext=(-2, 4), ha='right',
                      textcoords='offset points', fontsize=9)
        axes.set_xscale('log')
        axes.set_yscale('log')
        axes.set_ylim(bottom*0.4 if bottom > 0 else item.tolerance*scale/12,
                      item.tolerance*scale*12)
        axes.set_xlim(seconds[0]*0.7, seconds[-1])
        axes.set_xlabel('processor seconds' if result.provenance.get('clock') ==
                        'cpu' else 'seconds')
        unit = result.observables[item.observable]['unit']
        axes.set_ylabel('total error, ' +
                        (f'% of {abs(reference):.5g} {unit}' if reference else unit))
        axes.set_title(f'{sentence(result.observables[item.observable]["label"])}: bias and noise',
                       fontsize=10.5)
        axes.grid(True, which='major', alpha=0.35)
        plain_ticks(axes)
        axes.legend(loc='lower left', fontsize=8, framealpha=0.9,
                    title='thick: the best setting of a method, by time', title_fontsize=8)

    def _name_settings(self, axes, seconds, envelope, own, colour):
        """Write a setting's name where it is the best of its method."""
        there = np.isfinite(envelope)
        for k in dict.fromkeys(own[there]):
            where = np.flatnonzero((own == k) & there)
            if len(where) >= 12:
                at = where[len(where) // 2]
                axes.annotate(self.result.knob.format(self.prices.keys[k][1]),
                              (seconds[at], envelope[at]), xytext=(3, 4),
                              textcoords='offset points', fontsize=8.5, color=colour, zorder=5)

    def _draw_times(self, axes, answer):
        result, knob = self.result, self.result.knob
        finite = _positive_times(answer)
        top = min(max(finite), FAR*min(finite))*4
        bottom = min([each['seconds_low']
                      for each in answer.candidates if each['seconds_low'] > 0] + finite)/2
        values = sorted({each['value']*knob.scale for each in answer.candidates})
        # Bars of several methods at one value stand side by side.
        aside = min([b - a for a, b in zip(values, values[1:])] + [values[-1]])*min(
            0.08, 0.4/len(result.methods()))
        for index, method in enumerate(result.methods()):
            colour, marker = self.style[method]
            shift = (index - (len(result.methods()) - 1)/2)*aside
            mine = [
                each for each in answer.candidates
                if each['method'] == method and each['verdict'] != 'n/a'
            ]
            for each in mine:
                x, y = each['value']*knob.scale + shift, each['seconds']
                # Settings that never get there, or hardly do, are at the upper edge.
                if y > top:
                    axes.plot(x, top*0.8, marker='x', ms=8, mew=2, color=colour, ls='')
                else:
                    axes.plot(x, y, marker=marker, ms=7, color=colour,
                              mfc='white' if each['bias'] == OPEN else colour, mew=1.4, ls='',
                              zorder=3)
                if each['seconds_low'] < top:
                    axes.plot([x, x],
                              [max(each['seconds_low'], bottom),
                               min(each['seconds_high'], top)], color=colour, lw=1.3, alpha=0.8,
                              zorder=2)
                    if each['seconds_high'] > top:
                        axes.annotate('', (x, top), (x, top*0.75), arrowprops={
                            'arrowstyle': '->',
                            'color': colour,
                            'lw': 1.3
                        })
            points = sorted((each['value']*knob.scale + shift, each['seconds']) for each in mine
                            if each['seconds'] <= top)
            if points:
                axes.plot(*zip(*points), color=colour, lw=0.8, alpha=0.5, zorder=1)
            axes.plot([], [], color=colour, marker=marker, ms=7, label=method)
        axes.plot([], [], marker='o', mfc='white', color='grey', ls='',
                  label='bias not known well enough')
        axes.plot([], [], marker='x', mew=2, color='grey', ls='', label='never, or hardly')
        axes.set_yscale('log')
        axes.set_ylim(bottom, top*1.3)
        axes.set_xlabel(f'{knob.label}, {knob.unit}')
        axes.set_ylabel('time to the wanted error, ' +
                        ('processor seconds' if result.provenance.get('clock') == 'cpu' else 's'))
        axes.set_title(f'Time to it: lower is better (bars: {100*result.confidence:g} %)',
                       fontsize=10.5)
        axes.grid(True, alpha=0.3)
        plain_ticks(axes)
        axes.legend(loc='best', fontsize=8, framealpha=0.9)

    # ---- Tables ----------------------------------------------------------------------------------

    def _head(self, wanted):
        return (wanted, f'{self.result.knob.label}, {self.result.knob.unit}', 'time',
                f'{100*self.result.confidence:g} %', 'times the least',
                f'{100*self.result.confidence:g} %', 'bias, % of square', 'equilibration, %',
                'tau, ps', 'independent/s', 'verdict')

    def _rows(self, answer):
        knob = self.result.knob
        rows = []
        for each in answer.candidates:
            interval = '' if not math.isfinite(
                each['seconds_low']
            ) else f'{duration(each["seconds_low"])} – {_or_never(each["seconds_high"])}'
            ratio = '' if each['ratio'] is None or not math.isfinite(
                each['ratio']) else f'{each["ratio"]:.2f}'
            ratios = '' if not ratio else f'{each["ratio_low"]:.2f} – ' + (
                f'{each["ratio_high"]:.2f}' if math.isfinite(each['ratio_high']) else '∞')
            rows.append(
                (each['method'], f'{each["value"]*knob.scale:g}', duration(
                    each['seconds']), interval, ratio, ratios, '' if each['bias_part'] is None else
                 f'{100*each["bias_part"]:.0f}' if each['bias_part'] < 1 else '> 100',
                 number(None if not each['equilibration_part'] else 100*each['equilibration_part'],
                        '.0f'), number(each['own_tau'],
                                       '.2g'), number(each['effective_per_second'],
                                                      '.3g'), each['verdict']))
        return rows

    def tables(self) -> list[str]:
        """HTML tables, one for each wanted error."""
        return [
            table((*self._head(wanted), 'note'), [
                row + ('; '.join(each['marks']),)
                for row, each in zip(self._rows(answer), answer.candidates)
            ], True) for wanted, answer in zip(self.wanted, self.answers)
        ]

    def textTables(self) -> list[str]:
        """The same tables as text, one for each wanted error."""
        result = []
        for wanted, answer in zip(self.wanted, self.answers):
            lines = [self._head('method'), *self._rows(answer)]
            widths = [max(len(line[k]) for line in lines) for k in range(len(lines[0]))]
            result.append('\n'.join([f'what it takes to know {wanted}'] + [
                '  '.join(
                    cell.ljust(width) if k == 0 else cell.rjust(width)
                    for k, (cell, width) in enumerate(zip(line, widths))) for line in lines
            ]))
        return result

    def how(self) -> list[str]:
        """Paragraphs about how prices were computed."""
        if not self.answers and not self.spendings:
            return []
        clock = 'processor time' if self.result.provenance.get(
            'clock') == 'cpu' else 'wall-clock time'
        return [
            f'Prices: the total error after a time is the root mean square of the bias (the '
            f'measured error) and of the standard error. The square of the standard error is '
            f'2 tau variance/(length of the run). Time is the {clock} of the integration '
            f'steps, with the equilibration that the runs had. For intervals the following were '
            "resampled together: biases (Student's t, with the shared reference), noises (chi^2 "
            "with samples/(10 tau/interval + 1) degrees of freedom, by Sokal's variance of tau; in "
            "results without noise those of the blocks) and rounds of the timings. The "
            'cheapest of many looks a little cheaper than it is.'
        ]


def _or_never(seconds):
    return duration(seconds) if math.isfinite(seconds) else '∞'


def _positive_times(answer):
    """Finite times of the candidates that have a logarithm; a second where there is none.

    A constant observable without equilibration takes no time at all.
    """
    return [
        each['seconds']
        for each in answer.candidates if math.isfinite(each['seconds']) and each['seconds'] > 0
    ] or [1.0]
