"""The report of a StudyResult: errors against speed, and means against the knob.

It has texts, pictures, tables and one HTML page.
"""
from __future__ import annotations

import html
import itertools
from functools import cached_property
from typing import TYPE_CHECKING, Sequence, Union

import numpy as np

from ._pages import (FACTOR, Report, advise, duration, number, picture, plain_ticks, section,
                     sentence, table)
from ._results import (DECIDED, HARDLY, LONGER, NO_MEAN, NO_REFERENCE, NONE, RECOMMENDED, REFERENCE,
                       SMALL_STEPS, UNDECIDED, UNUSABLE)
from .measurement import FAILED, NOT_RUN, SLOW, STABLE, UNSTABLE
from .pricereport import PriceReport

if TYPE_CHECKING:
    import matplotlib.axes
    from ._results import Wanted
    from .result import StudyResult

#: Colours that the colour-blind can tell apart (Okabe and Ito), one for each method. Users' own
#: methods take the other colours in turn.
COLOURS = {
    'LangevinC': '#0072B2',
    'LangevinMiddle': '#D55E00',
    'LangevinB': '#009E73',
    'LangevinA': '#E69F00',
    'GradientThermostat': '#CC79A7',
    'EulerMaruyama': '#999999',
    'FixmanMidpoint': '#E69F00',
    'RandomFiniteDifference': '#56B4E9',
    'TractionEulerMaruyama': '#B8A800',
    'TrapezoidalSlip': '#0072B2',
    'DriftCorrectorFD': '#CC79A7',
    'DriftCorrectorRFD': '#882255',
    'LangevinHI(0.3)': '#009E73',
    'LangevinHI(1)': '#D55E00',
    'LangevinHI(3)': '#000000'
}
SPARE_COLOURS = ('#56B4E9', '#000000', '#7F7F7F', '#8C564B', '#009E73', '#CC79A7', '#B8A800',
                 '#0072B2', '#E69F00', '#882255', '#D55E00')
MARKERS = {
    'LangevinC': 'o',
    'LangevinMiddle': 's',
    'LangevinB': '^',
    'LangevinA': 'v',
    'GradientThermostat': 'D',
    'EulerMaruyama': 'X',
    'FixmanMidpoint': '^',
    'RandomFiniteDifference': 's',
    'TractionEulerMaruyama': 'v',
    'TrapezoidalSlip': 'o',
    'DriftCorrectorFD': '<',
    'DriftCorrectorRFD': '>',
    'LangevinHI(0.3)': 'D',
    'LangevinHI(1)': 'P',
    'LangevinHI(3)': '*'
}
#: Methods that have the same colour for want of more have other markers.
SPARE_MARKERS = ('P', 'X', '*', 'd', 'p')
#: More methods than this need a legend of several columns.
MANY_METHODS = 6


class StudyReport(Report):
    """The report of a StudyResult.

    Parameters
    ----------
    result : StudyResult
    wanted : str, or sequence of str
        wanted errors; the report answers each of them
    baseline : str
        the method with which speeds are compared
    price : str, or sequence of str
        wanted total errors (bias and noise); the report gives the price of each
    spend : sequence of (str, float)
        observables, and seconds to spend on them
    """

    FILES, PICTURE = ('results.csv', 'results.json', 'report.html'), 'error'
    TITLE, CHOICE, EXAMPLE = 'What accuracy costs', 'setting', 'potential_energy:0.5%'
    ANSWER = ('verdict', 'setting', 'factor', 'text', 'candidates')
    READING = (
        'On the left each point is a setting, with its speed and its error. The label is the '
        'setting. Settings below the dashed line have the wanted error, and the best one is '
        'farthest to the right. An open symbol is an error that the statistics do not distinguish '
        'from 0. On the right is the mean of the observable for each setting. Errors are '
        'differences from the black line, which is the exact value or the limit of small steps.')
    _USE = 'Use the recommended scheme and step.'
    _QUALIFIES = (
        'The recommended setting has the wanted error with the stated confidence: the '
        'upper confidence bound of its error, systematic and statistical, is below the wanted '
        'error. The confidence is about this scene and these observables only.')
    _INSIDE = ('This study cannot tell: the wanted error lies inside the confidence intervals of '
               'the settings that could be the answer.')
    _OTHER_ERROR = ('ask for a larger error (--from results.json --wanted-error, which '
                    'measures nothing anew)')
    ADVICE = {
        (RECOMMENDED, DECIDED): (_QUALIFIES, _USE),
        (RECOMMENDED, LONGER): (
            _QUALIFIES, f'{_USE} A study that is about {FACTOR} times as long (--budget) decides '
            'about one or more of the faster settings that the answer names.'),
        (RECOMMENDED, HARDLY): (
            _QUALIFIES, f'{_USE} About the faster settings that the answer names no study of a '
            f'sensible length decides; to learn about them, {_OTHER_ERROR}.'),
        (RECOMMENDED, SMALL_STEPS): (
            _QUALIFIES, f'{_USE} To learn about the faster settings that the answer names, measure '
            'smaller steps (--steps), from which the limit of small steps is known better.'),
        (RECOMMENDED, REFERENCE): (
            _QUALIFIES, f'{_USE} To learn about the faster settings that the answer names, give a '
            'more accurate reference (--reference).'),
        (NONE, DECIDED): (
            'No setting has the wanted error: for each stable setting that can be judged, the '
            'lower confidence bound of its error is above the wanted error.',
            'Measure more accurate settings (--steps, --methods), or accept a larger error.'),
        (NONE, UNUSABLE): ('No setting was stable, so that nothing is known about errors.',
                           'Measure smaller steps (--steps). The table says how each run ended.'),
        (UNDECIDED, LONGER): (
            _INSIDE, f'Make the study about {FACTOR} times as long (--budget), or {_OTHER_ERROR}.'),
        (UNDECIDED, HARDLY): (
            _INSIDE, 'No study of a sensible length decides between errors that are so near to the '
            f'wanted one, or that are so small: {_OTHER_ERROR}.'),
        (UNDECIDED, SMALL_STEPS): (
            'This study cannot tell: the limit of small steps, with which settings are compared, '
            'is not known well enough.', f'Measure smaller steps (--steps), or {_OTHER_ERROR}.'),
        (UNDECIDED, REFERENCE): (
            'This study cannot tell: the reference that was given is not known well enough.',
            f'Give a more accurate reference (--reference), or {_OTHER_ERROR}.'),
        (UNDECIDED, NO_REFERENCE): (
            'This study cannot tell: there is no value with which the settings could be compared.',
            'Measure smaller steps (--steps), or give a reference (--reference).'),
        (UNDECIDED, NO_MEAN): (
            'This study cannot tell: the observable has no mean at any stable setting.',
            'Look at the observable: the notes in the table say why there is no mean. Where '
            'samples are too few, make the study longer (--budget) or samples more frequent '
            '(--sample-interval); where they are not numbers, measure another observable or other '
            'methods (--observables, --methods).')
    }

    def __init__(
        self, result: StudyResult, wanted: Union[str, Sequence[str]] = (),
        baseline: str = 'LangevinMiddle', price: Union[str, Sequence[str]] = (),
        spend: Sequence[tuple[str, float]] = ()
    ) -> None:
        super().__init__(result, wanted)
        self.baseline = baseline
        self.priced = PriceReport(result, price, spend, self._style(),
                                  len(result.methods()) > MANY_METHODS)
        #: Wanted error -> what StudyResult.compareAt() returned for it.
        self.comparisons = {item: result.compareAt(item, baseline) for item in self.single}

    def extras(self) -> dict:
        """What the JSON has in addition to the result."""
        return {**super().extras(), 'at_wanted_error': self.comparisons, **self.priced.asDict()}

    def answerTexts(self) -> list[str]:
        """The answers as text: settings for wanted errors, prices, and what a time buys."""
        return super().answerTexts() + self.priced.texts()

    def questions(self) -> list[str]:
        """What was asked, a sentence for each answer: also prices, and what a time buys."""
        priced, labels = self.priced, self._labels()
        return super().questions() + [
            f'How long does it take to know {" and ".join(item.text for item in answer.wanted)}, '
            'bias and standard error together?' for answer in priced.answers
        ] + [
            f'How well is {labels[name]} known after {duration(seconds)}?'
            for name, seconds in priced.spend
        ]

    def advice(self) -> tuple[list[str], list[str]]:
        """How sure the answers are, prices too, and what to do: two lists of paragraphs."""
        sure, following = super().advice()
        surePrices, followingPrices = advise(self.priced)
        return sure + surePrices, following + followingPrices

    def compared(self) -> str:
        """What was compared, a sentence."""
        result, knob = self.result, self.result.knob
        parts = []
        for method in result.methods():
            values = sorted({row['value'] for row in result.rows if row['method'] == method})
            parts.append(f'{method} at {", ".join(knob.format(value) for value in values)}')
        return (f'These settings were compared: {"; ".join(parts)}. '
                f'What was measured: {"; ".join(self._labels().values())}.')

    def _labels(self):
        return {name: about['label'] for name, about in self.result.observables.items()}

    def describePicture(self, observable: str) -> str:
        """What the picture of an observable shows, for readers who do not see it."""
        label, knob = self.result.observables[observable]['label'], self.result.knob
        return (f'Left: error of {label} against {knob.speedUnit} for '
                f'{", ".join(self.result.methods())}. Right: mean of {label} against '
                f'{knob.label}. The table of {label} has all numbers.')

    # ---- Pictures --------------------------------------------------------------------------------

    def otherPictures(self) -> dict[str, bytes]:
        """The pictures of prices."""
        return self._price_pictures

    @cached_property
    def _price_pictures(self):
        return self.priced.pictures()

    def _style(self):
        """Method -> (colour, marker), no two of them the same."""
        methods = self.result.methods()
        named = {
            method: (COLOURS[method], MARKERS[method])
            for method in methods if method in COLOURS
        }
        taken = [colour for colour, _ in named.values()]
        colours = [colour for colour in SPARE_COLOURS if colour not in taken]
        spare = itertools.cycle(
            (colours[k % len(colours)],
             SPARE_MARKERS[(k % len(colours) + k // len(colours)) % len(SPARE_MARKERS)])
            for k in range(len(colours)*len(SPARE_MARKERS)))
        return {method: named[method] if method in named else next(spare) for method in methods}

    def _platform(self):
        threads = self.result.provenance.get('threads')
        return (f'{self.result.provenance.get("platform")} platform, '
                f'{threads} thread{"" if threads == 1 else "s"}')

    def panels(self, left: matplotlib.axes.Axes, right: matplotlib.axes.Axes, observable: str,
               limits: list[Wanted]) -> None:
        """Draw errors against speed beside the means against the knob.

        Parameters
        ----------
        left, right : matplotlib.axes.Axes
        observable : str
        limits : list of Wanted
            errors that are drawn as lines
        """
        reference, unit = self.result.references[observable], self.result.observables[observable][
            'unit']
        scale = 100/abs(reference.value) if reference.value else 1.0
        self._draw_errors(left, observable, scale,
                          f'% of {abs(reference.value):.5g} {unit}' if reference.value else unit,
                          limits)
        self._draw_means(right, observable, reference, limits)

    def _draw_errors(self, axes, observable, scale, unit, lines):
        result, style = self.result, self._style()
        rows = [
            row for row in result.select(observable)
            if row['error'] is not None and row['ns_per_day']
        ]
        sizes = [abs(row['error'])*scale for row in rows]
        sigmas = [row['error_standard_error']*scale for row in rows]
        # Below a third of the smallest error bar there is nothing to see.
        floor = min([s/2 for s in sigmas if s > 0] + [line.tolerance*scale/4 for line in lines] +
                    [s for s in sizes if s > 0] + [1e300])
        floor = max(floor, min([s/3 for s in sigmas if s > 0], default=floor))
        top = max(sizes + [line.tolerance*scale*3 for line in lines] + [floor*10])
        for method in result.methods():
            colour, marker = style[method]
            mine = [row for row in rows if row['method'] == method]
            known = []
            for row in mine:
                size, x = abs(row['error'])*scale, row['ns_per_day']*result.knob.speedScale
                low, high = row['error_low']*scale, row['error_high']*scale
                smallest = 0 if low <= 0 <= high else min(abs(low), abs(high))
                largest = max(abs(low), abs(high))
                resolved = smallest > 0
                y = max(size, floor)
                axes.plot([x, x], [max(smallest, floor*0.7), largest], color=colour, lw=1.4,
                          alpha=0.8, zorder=2)
                axes.plot([
                    row[key]*result.knob.speedScale for key in ('ns_per_day_low', 'ns_per_day_high')
                ], [y, y], color=colour, lw=1.0, alpha=0.6, zorder=2)
                axes.plot(x, y, marker=marker, ms=7, color=colour,
                          mfc=colour if resolved else 'white', mew=1.4, zorder=4, ls='')
                axes.annotate(result.knob.format(row['value']), (x, y), xytext=(6, 5),
                              textcoords='offset points', fontsize=8.5, color=colour, zorder=5)
                known.append((x, y) if resolved else (np.nan, np.nan))
            if known:
                axes.plot(*zip(*known), color=colour, lw=1.0, alpha=0.45, zorder=1)
            axes.plot([], [], color=colour, marker=marker, ms=7, label=method)
            dead = sorted({(row['value'], row['step_size'])
                           for row in result.rows if row['method'] == method
                           and row['status'] == UNSTABLE and row['observable'] == observable})
            for k, (value, step) in enumerate(dead):
                rates = result.stepsPerSecond(observable, method, step)
                if len(rates):
                    x = step*np.median(rates)*86.4*result.knob.speedScale
                    axes.plot(x, top*1.9, marker='x', ms=9, mew=2.2, color=colour, zorder=4)
                    axes.annotate(result.knob.format(value), (x, top*1.9), xytext=(0, -15),
                                  ha='center', textcoords='offset points', fontsize=8.5,
                                  color=colour)
                    if k == 0:
                        axes.annotate('unstable:', (x, top*1.9), xytext=(-10, 0), ha='right',
                                      va='center', textcoords='offset points', fontsize=8.5,
                                      color=colour)
        for line in lines:
            axes.axhline(line.tolerance*scale, color='black', ls='--', lw=1.2, zorder=1)
            axes.annotate('wanted: ' + line.text.split(' of ')[0], (0.01, line.tolerance*scale),
                          xycoords=('axes fraction', 'data'), xytext=(2, 4),
                          textcoords='offset points', fontsize=9)
        axes.set_xscale('log')
        axes.set_yscale('log')
        axes.set_ylim(floor*0.6, top*3)
        left, right = axes.get_xlim()
        axes.set_xlim(left, right*1.12)
        axes.set_xlabel(result.knob.speedUnit +
                        (' (CPU time)' if result.provenance.get('clock') == 'cpu' else '') +
                        f'   [{self._platform()}]')
        axes.set_ylabel(f'|error|, {unit}')
        axes.set_title('Error against speed: down and to the right is better', fontsize=10.5)
        axes.grid(True, which='major', alpha=0.35)
        axes.grid(True, which='minor', alpha=0.12)
        plain_ticks(axes)
        axes.plot([], [], marker='o', mfc='white', color='grey', ls='',
                  label='not distinguishable from 0')
        many = len(result.methods()) > MANY_METHODS
        if many:
            # Room for the legend above all points.
            low, high = axes.get_ylim()
            axes.set_ylim(low, high*(high/low)**0.45)
        axes.legend(loc='upper center' if many else 'best', ncol=3 if many else 1,
                    fontsize=8 if many else 9, framealpha=0.9,
                    title=f'bars: {100*result.confidence:g} % confidence (error), 16–84 % (speed)',
                    title_fontsize=8)

    def _draw_means(self, axes, observable, reference, lines):
        result, style, knob = self.result, self._style(), self.result.knob
        for method in result.methods():
            colour, marker = style[method]
            rows = result.select(observable, method)
            if not rows:
                continue
            axes.errorbar([row['value']*knob.scale for row in rows], [row['mean'] for row in rows],
                          yerr=[row['standard_error'] for row in rows], color=colour, marker=marker,
                          ls='', ms=6, capsize=2.5, label=method)
            if reference.fit is not None and method in reference.fit.coefficients:
                E, F = reference.fit.coefficients[method]
                used = [
                    value for (name, value), flag in zip(reference.points, reference.fit.used)
                    if flag and name == method
                ]
                h = np.linspace(0, max(used), 100)
                x = h**result.orders[method]
                axes.plot(h*knob.scale, reference.value + E*x + (F or 0)*x*x, color=colour, lw=1.2)
        axes.axhline(reference.value, color='black', lw=1)
        if reference.standardError > 0:
            axes.axhspan(reference.value - reference.standardError,
                         reference.value + reference.standardError, color='black', alpha=0.15, lw=0)
        what = {
            'exact': 'exact',
            'given': 'given',
            'extrapolated': 'limit of small steps'
        }[reference.kind]
        errorText = f' ± {reference.standardError:.1g}' if reference.standardError else ''
        axes.set_title(
            f'{what}: {reference.value:.6g}{errorText} {result.observables[observable]["unit"]}',
            fontsize=10.5)
        axes.set_xlabel(f'{knob.label}, {knob.unit}')
        axes.set_ylabel(f'mean, {result.observables[observable]["unit"]} (bars: 1 sigma)')
        axes.set_xlim(left=0)
        tolerances = [line.tolerance for line in lines]
        errors = [row['error'] for row in result.select(observable) if row['error'] is not None]
        # Far beyond the wanted error the exact distance does not matter.
        if tolerances and max(map(abs, errors)) > 10*max(tolerances):
            inside = [e for e in errors if abs(e) <= 10*max(tolerances)
                      ] + [-2*max(tolerances), 2*max(tolerances)]
            margin = 0.08*(max(inside) - min(inside))
            axes.set_ylim(reference.value + min(inside) - margin,
                          reference.value + max(inside) + margin)
            axes.annotate('larger errors are outside', (0.98, 0.02), xycoords='axes fraction',
                          ha='right', fontsize=8.5)
        axes.grid(True, alpha=0.3)

    # ---- Words -----------------------------------------------------------------------------------

    def atWantedError(self, comparison: dict) -> list[str]:
        """How the methods compare at the wanted error, a sentence for each method.

        Parameters
        ----------
        comparison : dict
            what StudyResult.compareAt() returned
        """
        knob, lines = self.result.knob, []
        for method, entry in comparison.items():
            if entry['missed']:
                lines.append(f'{method}: its errors as measured are above the wanted one at all '
                             'measured steps, so that no step is known; smaller steps or longer '
                             'runs may show one.')
                continue
            speed, step = knob.speed(
                entry['ns_per_day']), f'{entry["step"]*knob.scale:.3g} {knob.unit}'
            if entry['capped']:
                largest = 'largest stable' if entry['limited'] else 'largest measured'
                text = f'{method}: its error is still below the wanted one at its {largest} step, '
                text += f'{step}: at least {speed}'
                if not entry['sure']:
                    text = (f'{method}: the statistics do not suffice to tell whether its error is '
                            f'below the wanted one at its {largest} step, {step}; if it is, at '
                            f'least {speed}')
            else:
                where = ('beyond the measured steps, by the fit'
                         if entry['beyond'] else 'between the measured steps')
                text = (
                    f'{method}: reaches the wanted error at a step of {step} '
                    f'({entry["step_low"]*knob.scale:.3g} to {entry["step_high"]*knob.scale:.3g}), '
                    f'{where}: {speed}')
            if entry['ratio'] is not None and method != self.baseline:
                # The baseline may be good for larger steps than were measured, or the method.
                bound = {
                    (False, True): 'at most ',
                    (True, False): 'at least '
                }.get((entry['capped'], comparison[self.baseline]['capped']), '')
                text += (
                    f'; {bound}{entry["ratio"]:.2f} times the {knob.speedUnit} of {self.baseline} '
                    f'({entry["ratio_low"]:.2f} to {entry["ratio_high"]:.2f})')
            lines.append(text + '.')
        return lines

    def paragraphs(self) -> list[str]:
        """The report as paragraphs, the answers first."""
        result, knob = self.result, self.result.knob
        lines = self.answerTexts()
        for wanted, comparison in self.comparisons.items():
            if comparison:
                item, = result.parseWanted(wanted)
                lines.append(f'At exactly {item.text}: ' + ' '.join(self.atWantedError(comparison)))
        for status, text in ((UNSTABLE, 'was unstable'), (FAILED, 'failed'),
                             (NOT_RUN, 'did not come to its end')):
            dead, messages = {}, {}
            for row in result.rows:
                if row['status'] == status:
                    dead.setdefault(row['method'], set()).add(row['value'])
                    messages[row['method']] = row['message']
            for method, values in dead.items():
                lines.append(f'{method} {text} at '
                             f'{", ".join(knob.format(value) for value in sorted(values))}' +
                             (f': {messages[method]}' if status == FAILED else '') + '.')
        for method, reason in result.refusals.items():
            lines.append(f'{method} was not run: {reason}.')
        refused = {
            row['method']: row['message']
            for row in result.rows if row['status'] not in (STABLE, UNSTABLE, FAILED, NOT_RUN)
        }
        for method, reason in refused.items():
            lines.append(f'{method} cannot be used on this scene: {reason}')
        drifting = sorted({(row['method'], row['value'])
                           for row in result.rows if row['note'] == 'drifts'})
        if drifting:
            lines.append(
                'The two halves of the run disagree (a longer equilibration is needed, or the run '
                'is about to blow up) at: ' + ', '.join(f'{method} {knob.format(value)}'
                                                        for method, value in drifting) + '.')
        slow = list(
            dict.fromkeys(
                (row['method'], row['value']) for row in result.rows if row['note'] == SLOW))
        if slow:
            lines.append(
                f'Under fast fluctuations there are {SLOW}, which make the error larger (it is '
                'from blocks as long as they need, and longer runs may show them to be larger '
                'still) at: ' + ', '.join(f'{method} {knob.format(value)}'
                                          for method, value in slow) + '.')
        if any(row['note'] == 'few independent samples' for row in result.rows):
            lines.append(
                'Some runs have fewer than 10 blocks of independent samples. Their errors are '
                'themselves uncertain (marked in the table).')
        return lines

    def how(self) -> list[str]:
        """Paragraphs about how the study was measured."""
        result, provenance = self.result, self.result.provenance
        lines = [
            f'{self._platform()}, {provenance.get("rounds")} rounds in which the settings took '
            f'turns in a random order. {result.knob.speedUnit} is the median over rounds of the '
            f'integration steps alone ({provenance.get("clock")} time).',
            'Standard errors are from block averages with blocks of 20 integrated autocorrelation '
            "times. Intervals use Student's t with the number of blocks."
        ]
        if any(reference.kind == 'extrapolated' for reference in result.references.values()):
            lines.append(
                'Where no exact average is known, means are compared with the common limit A0 of '
                'all methods, from a weighted fit of A0 + E h^p + F h^2p (p: order of the method). '
                'The intervals take account of the error of A0, and of the part that a mean has in '
                'the fit.')
        for name, reference in result.references.items():
            if reference.fit is not None:
                fit, about = reference.fit, result.observables[name]
                dropped = [
                    f'{method} {result.knob.format(value)}'
                    for (method, value), used in zip(reference.points, fit.used) if not used
                ]
                lines.append(f'{sentence(about["label"])}: A0 = {reference.value:.6g} ± '
                             f'{reference.standardError:.2g} {about["unit"]}, '
                             f'chi2 = {fit.chi2:.1f} for {fit.degrees} degrees of freedom' +
                             (f', without {", ".join(dropped)}' if dropped else '') +
                             (f'; {fit.note}' if fit.note else '') + '.')
        if any('temperature' in name
               for name in result.observables) and 'LangevinMiddle' in result.methods():
            lines.append(
                "LangevinMiddle's temperatures are from the velocities in its State. These belong "
                "to the middle of the step, where kinetic energy is more accurate than at its end. "
                "Its configurations are not more accurate for this reason. The plugin's "
                'temperatures are from the end of the step.')
        return lines + self.priced.how()

    # ---- Tables ----------------------------------------------------------------------------------

    def textTable(self) -> str:
        """Errors of all settings as text, with a column for each observable.

        Errors are in per cent where that has a meaning.
        """
        result, names = self.result, list(self.result.observables)
        lines = [
            'error in % of the reference (± 1 sigma)' if all(
                result.references[n].value for n in names
                if n in result.references) else 'relative errors in %; absolute where the '
            'reference is 0'
        ]
        short = [
            name.replace('temperature', 'T').replace('potential_energy', 'U').replace(
                'translational', 'trans').replace('rotational', 'rot') for name in names
        ]
        lines.append(f'{"method":<20}{result.knob.label + "/" + result.knob.unit:>10}'
                     f'{result.knob.speedUnit:>10}' + ''.join(f'{n:>20}' for n in short))
        for key in dict.fromkeys((row['method'], row['value']) for row in result.rows):
            rows = {
                row['observable']: row
                for row in result.rows if (row['method'], row['value']) == key
            }
            first = next(iter(rows.values()))
            speed = first['ns_per_day'] and first['ns_per_day']*result.knob.speedScale
            line = f'{key[0]:<20}{key[1]*result.knob.scale:>10.4g}' + (f'{speed:>10.3g}'
                                                                       if speed else f'{"":>10}')
            if first['status'] != 'stable':
                lines.append(line + f'  {first["status"]} {first["message"]}'[:100])
                continue
            for name in names:
                row = rows[name]
                if row['error'] is None:
                    line += f'{row["note"] if row["note"] == "n/a" else "-":>20}'
                else:
                    scale = 100/abs(
                        result.references[name].value) if result.references[name].value else 1
                    line += (f'{row["error"]*scale:>12.3f} ± '
                             f'{row["error_standard_error"]*scale:<5.3f}')
            lines.append(line)
        return '\n\n'.join(['\n'.join(lines), *self.priced.textTables()])

    def body(self, pictures: dict) -> list[str]:
        """What the page has in addition to the paragraphs, as HTML.

        Parameters
        ----------
        pictures : dict
            observable -> PNG
        """
        parts = [
            self._comparison_table(wanted, comparison)
            for wanted, comparison in self.comparisons.items() if comparison
        ]
        if self.priced.answers:
            parts.append(section('Prices'))
            parts += [
                picture(content, 'Total error against time, and the time to the wanted error')
                for content in self._price_pictures.values()
            ]
            parts += self.priced.tables()
        parts.append(section('Pictures and tables'))
        for observable, about in self.result.observables.items():
            parts.append(f'<h3>{html.escape(sentence(about["label"]))}</h3>')
            if observable in pictures:
                parts.append(self.image(observable, pictures))
            parts.append(self._table(observable))
        return parts

    def _comparison_table(self, wanted, comparison):
        knob, confidence, rows = self.result.knob, f'{100*self.result.confidence:g} %', []
        for method, entry in comparison.items():
            if entry['missed']:
                rows.append((method, 'not known') + 7*('',))
                continue
            atLeast = '≥ ' if entry['capped'] else ''
            ratio = ('', '') if entry['ratio'] is None else (
                f'{entry["ratio"]:.2f}', f'{entry["ratio_low"]:.2f} – {entry["ratio_high"]:.2f}')
            low, middle, high = (f'{entry[key]*knob.scale:.3g}'
                                 for key in ('step_low', 'step', 'step_high'))
            slow, speed, fast = (f'{entry[key]*knob.speedScale:.3g}'
                                 for key in ('ns_per_day_low', 'ns_per_day', 'ns_per_day_high'))
            middle += ' (by the fit)' if entry['beyond'] else ''
            rows.append(
                (method, atLeast + middle, f'{low} – {high}', f'{entry["steps_per_second"]:.1f}',
                 atLeast + speed, f'{slow} – {fast}', *ratio))
        return table((f'at {wanted}', f'step, {knob.unit}', confidence, 'steps/s', knob.speedUnit,
                      confidence, f'times {self.baseline}', confidence), rows)

    def _table(self, observable):
        knob, unit = self.result.knob, self.result.observables[observable]['unit']
        rows = [row for row in self.result.rows if row['observable'] == observable]
        pale = [k for k, row in enumerate(rows) if row['status'] != STABLE]
        return table(('method', f'{knob.label}, {knob.unit}', knob.speedUnit, f'mean, {unit}',
                      '± (1 sigma)', f'error, {unit}', f'{100*self.result.confidence:g} % interval',
                      'error, %', 'tau, ps', 'length, ps', 'note'), map(self._cells, rows), True,
                     pale)

    def _cells(self, row):
        stable, knob = row['status'] == STABLE, self.result.knob
        interval = '' if row[
            'error'] is None else f'{row["error_low"]:.3g} … {row["error_high"]:.3g}'
        return (row['method'], f'{row["value"]*knob.scale:g}',
                number(None if row['ns_per_day'] is None else row['ns_per_day']*knob.speedScale,
                       '.3g'), number(row['mean'],
                                      '.6g'), number(row['standard_error'],
                                                     '.2g'), number(row['error'], '.3g'), interval,
                number(None if row['relative_error'] is None else 100*row['relative_error'],
                       '.3f'), number(row['tau'],
                                      '.2g'), number(row['length'], '.4g') if stable else '',
                row['note'] if stable else f'{row["status"]}: {row["message"]}')
