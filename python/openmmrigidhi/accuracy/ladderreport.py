"""The report of a LadderResult: errors of the models against time per step.

It has texts, pictures, tables and one HTML page.
"""
from __future__ import annotations

import html
from typing import TYPE_CHECKING, Any, Optional, Sequence

import numpy as np

from ._pages import Report, duration, paragraph, plain_ticks, section, sentence, table
from ._results import (DECIDED, NO_REFERENCE, NONE, RECOMMENDED, REFERENCE, UNDECIDED, UNUSABLE)
from .measurement import STABLE
from .rungs import BEST

if TYPE_CHECKING:
    from ._results import Recommendation
    from .ladderresult import LadderResult

COLOURS = {
    'FreeDraining': '#7F7F7F',
    'RPY': '#E69F00',
    'ForceCoupling': '#CC79A7',
    'FTS': '#D55E00',
    'multiblob12': '#9ECAE1',
    'multiblob42': '#4292C6',
    'multiblob162': '#08519C',
    'multiblob642': '#08204C',
    'FTS+lubrication': '#009E73'
}
MARKERS = {
    'FreeDraining': 'x',
    'RPY': 's',
    'ForceCoupling': '<',
    'FTS': '^',
    'multiblob12': 'v',
    'multiblob42': 'D',
    'multiblob162': 'o',
    'multiblob642': 'P',
    'FTS+lubrication': '*'
}
#: Places of names that would otherwise overlap: points from the marker, alignment. Force coupling
#: is near RPY, and both kinds of FTS may be near each other.
LABELS = {'ForceCoupling': ((-8, -3), 'right'), BEST: ((8, -8), 'left')}
#: Smaller errors are drawn here, unless a reference is known less well.
FLOOR = 1e-9
#: A model follows exact numbers up to this error.
FOLLOWS = 0.1


class LadderReport(Report):
    """The report of a LadderResult.

    Parameters
    ----------
    result : LadderResult
    wanted : str, or sequence of str
        wanted errors; the report answers each of them
    """

    FILES, PICTURE = ('ladder.csv', 'ladder.json', 'ladder.html'), 'ladder'
    TITLE, CHOICE, EXAMPLE = 'What hydrodynamic accuracy costs', 'model', 'mobility:1%'
    READING = (
        'Each colour is a model of the fluid. The left panel has the relative errors of models. '
        'The right panel has the same errors against the time of a step. Models below the dashed '
        'line have the wanted error, and the best one is farthest to the left. In the grey region '
        'errors are smaller than the uncertainty of the reference. Where exact numbers are known, '
        'a further panel shows the models beside the exact numbers.')
    _BELOW = ('The error of the recommended model plus the uncertainty of the reference '
              'is below the wanted error. There is no statistical error. The answer is for the '
              'arrangements of this scene.')
    _USE = ('Use the recommended model by setModel(). The table of times says what the other '
            'models cost.')
    ADVICE = {
        (RECOMMENDED, DECIDED): (_BELOW, _USE),
        (RECOMMENDED, REFERENCE): (
            _BELOW, f'{_USE} To learn about the faster models that the answer names, add a finer '
            'multiblob as the reference (--ladder-reference).'),
        (NONE, DECIDED): (
            'Every model has an error above the wanted one, by more than the reference is '
            'uncertain, or cannot be used here. There is no statistical error.',
            'Add more accurate models (--rungs), or accept a larger error.'),
        (NONE, UNUSABLE): ('No model could be used here, so that no error is known.',
                           'Look at the reasons below, and add other models (--rungs).'),
        (UNDECIDED, REFERENCE): (
            'The reference is not accurate enough for this wanted error.',
            'Add a finer multiblob as the reference (--ladder-reference), or accept a larger error.'
        ),
        (UNDECIDED, NO_REFERENCE): (
            'The observable has no meaning for this scene.',
            'Ask for another observable (--observables), or take another scene.')
    }

    def compared(self) -> str:
        """What was compared, a sentence."""
        rungs = dict.fromkeys(row['rung'] for row in self.result.rows)
        labels = (about['label'] for about in self.result.observables.values())
        return (f'These models were compared: {", ".join(rungs)}. '
                f'What was computed with each: {"; ".join(labels)}.')

    def describePicture(self, observable: str) -> str:
        """What the picture of an observable shows, for readers who do not see it."""
        label = self.result.observables[observable]['label']
        return (f'Error of {label} for each model, against '
                f'{self.result.parameter + " and against " if self.result.parameter else ""}'
                f'the time of a step. The table of {label} has all numbers.')

    def textTable(self) -> str:
        """As the function textTable()."""
        return textTable(self.result)

    def paragraphs(self) -> list[str]:
        """The report as paragraphs, the answers first."""
        return summary(self.result, self.answers, self.wanted)

    def widths(self, observable: str) -> Sequence[float]:
        """As the base class; a third panel has the numbers where exact numbers are known."""
        return (1,
                *super().widths(observable)) if self.result.parameter and self.result.exactNumbers(
                    observable) else super().widths(observable)

    def panels(self, *panels: Any) -> None:
        """Draw errors against the parameter beside errors against time per step.

        For a single scene the former are bars. A further panel has the numbers where exact numbers
        are known.

        Parameters
        ----------
        panels : tuple
            two or three matplotlib.axes.Axes, the observable (str), and a list of Wanted, which are
            drawn as lines
        """
        *numbers, left, right, observable, limits = panels
        for axes in numbers:
            _draw_numbers(axes, self.result, observable)
        (_draw_sweep if self.result.parameter else _draw_bars)(left, self.result, observable)
        _draw_cost(right, self.result, observable)
        for axes in (left, right) if self.result.parameter else (right,):
            for item in limits:
                axes.axhline(item.tolerance, color='black', ls='--', lw=1)

    def body(self, pictures: dict) -> list[str]:
        """What the page has in addition to the paragraphs, as HTML.

        Parameters
        ----------
        pictures : dict
            observable -> PNG
        """
        parts = [section('Time'), costTable(self.result), section('Errors')]
        for observable, about in self.result.observables.items():
            if observable not in pictures:
                parts.append(paragraph(f'{sentence(about["label"])}: has no meaning here.'))
                continue
            parts += [
                f'<h3>{html.escape(sentence(about["label"]))}</h3>',
                paragraph(about['description'] + '.'),
                self.image(observable, pictures),
                errorTable(self.result, observable)
            ]
        return parts

    def how(self) -> list:
        """Paragraphs about how the study was measured."""
        scene, provenance = self.result.scene, self.result.provenance
        text = (
            'Errors are relative: (value - reference)/|reference|. For matrices and several '
            'velocities they are the norm of the difference over that of the reference. Times are '
            f'for a step of LangevinHI with noise at {scene["temperature"]:g} K. They are medians '
            f'over {provenance.get("rounds")} rounds in which the models took turns, on the faster '
            f'of {provenance.get("platforms")} ({provenance.get("threads")} thread(s); with one '
            'thread CPU time, if less than by the clock). Noise alone moved the spheres, and the '
            'time of the scene\'s own forces in a step was added.')
        if scene.get('timed_at') is not None:
            text += (f' They were taken at {self.result.parameter} {scene["timed_at"]:g}, on which '
                     'they hardly depend.')
        return [text]


# ---- Pictures ------------------------------------------------------------------------------------


def _style(rung):
    base = rung.replace('+self', '')
    return {
        'color': COLOURS.get(base, '#882255'),
        'marker': MARKERS.get(base, 'h'),
        'ls': ':' if base != rung else '-'
    }


def _floor(result, observable):
    """Smaller errors are drawn here, also where exact numbers end."""
    return max(
        (entry['observables'][observable]['believed'] for entry in result.references.values()),
        default=FLOOR) if result.exactNumbers(observable) else FLOOR


def _size(row, floor=FLOOR):
    return max(abs(row['error']), floor)


def _set_parameter_axis(axes, result):
    if result.parameter != 'volume fraction':
        axes.set_xscale('log')
    axes.set_xlabel('gap between the surfaces, radii' if result.parameter ==
                    'gap' else result.parameter)


def _draw_numbers(axes, result, observable):
    """Draw the numbers of the models where exact numbers are known."""
    exact = result.exactNumbers(observable)
    axes.plot(list(exact), list(exact.values()), color='black', lw=2.2, marker='.', ms=8,
              label='exact', zorder=5)
    for rung in result.rungs:
        rows = result.select(observable, rung)
        axes.plot([row['parameter'] for row in rows], [row['value'] for row in rows], ms=5, lw=1.2,
                  **_style(rung))
    _set_parameter_axis(axes, result)
    axes.set_yscale('log')
    plain_ticks(axes)
    axes.set_ylabel(result.observables[observable]['label'])
    axes.grid(True, which='major', alpha=0.35)
    axes.legend(loc='upper left', fontsize=9)
    axes.set_title('models in the colours of the next panel', fontsize=9.5)


def _draw_sweep(axes, result, observable):
    floor = _floor(result, observable)
    for rung in result.rungs:
        rows = [row for row in result.select(observable, rung)]
        if rows and not all(row['is_reference'] for row in rows):
            axes.plot([row['parameter'] for row in rows], [_size(row, floor) for row in rows],
                      label=rung, ms=5, lw=1.4, **_style(rung))
        elif rows:
            axes.plot([], [], label=f'{rung}: the reference' +
                      (', exact to 1e-9' if all(entry['exact']
                                                for entry in result.references.values()) else ''),
                      ms=9, **dict(_style(rung), ls=''))
    _set_parameter_axis(axes, result)
    axes.set_yscale('log')
    axes.set_ylabel('|relative error|')
    axes.grid(True, which='major', alpha=0.35)
    axes.legend(fontsize=8.5)


def _draw_bars(axes, result, observable):
    rows = {row['rung']: row for row in result.select(observable)}
    names = [name for name in result.rungs if name in rows]
    sizes = [_size(rows[name]) for name in names]
    believed = next((rows[name]['believed'] for name in names if rows[name]['is_reference']), None)
    shown = [
        size if not rows[name]['is_reference'] else believed or FLOOR
        for name, size in zip(names, sizes)
    ]
    axes.barh(range(len(names)), shown, color=[_style(name)['color'] for name in names],
              hatch=['//' if rows[name]['is_reference'] else '' for name in names], alpha=0.85)
    axes.set_yticks(
        range(len(names)),
        [f'{name}\n(believed)' if rows[name]['is_reference'] else name
         for name in names], fontsize=9)
    for k, size in enumerate(shown):
        axes.annotate(' ' + percent(size), (size, k), va='center', fontsize=9)
    axes.set_xscale('log')
    axes.set_xlim(min(shown)/3, max(shown)*8)
    axes.set_xlabel('|relative error|')
    if believed:
        axes.axvspan(axes.get_xlim()[0], believed, color='black', alpha=0.08, lw=0)
    axes.invert_yaxis()


def _draw_cost(axes, result, observable):
    values, floor = sorted(result.references), _floor(result, observable)
    chosen = sorted({values[round(k)]
                     for k in np.linspace(0,
                                          len(values) - 1, 4)}) if result.parameter else values
    fills = np.linspace(1, 0.25, len(chosen))
    for rung in result.rungs:
        rows = {row['parameter']: row for row in result.select(observable, rung)}
        seconds, style = result.seconds(rung), _style(rung)
        if seconds is None or not rows or all(row['is_reference'] for row in rows.values()):
            continue
        for value, fill in zip(chosen, fills):
            if value in rows:
                axes.plot(1e3*seconds, _size(rows[value], floor), marker=style['marker'],
                          color=style['color'], alpha=fill, ms=8, ls='')
        sizes = [_size(rows[v], floor) for v in chosen if v in rows]
        axes.plot([1e3*seconds]*2, [min(sizes), max(sizes)], color=style['color'], lw=0.8,
                  alpha=0.6)
        if not result.parameter:  # else the other panel has a legend
            place, side = LABELS.get(rung, ((4, 7), 'left'))
            axes.annotate(rung, (1e3*seconds, max(sizes)), textcoords='offset points', xytext=place,
                          ha=side, fontsize=8.5)
    best = next(iter(result.references.values()))['observables'][observable]['rung']
    if result.seconds(best) is not None:
        axes.axvline(1e3*result.seconds(best), color=_style(best)['color'], lw=1.2, ls='-.')
        believed = [
            row['believed'] for row in result.select(observable, best) if row['is_reference']
        ]
        if not result.parameter and believed and believed[0]:
            axes.plot(1e3*result.seconds(best), believed[0], marker='*', ms=13, mfc='white',
                      color=_style(best)['color'], ls='')
            axes.annotate(f'{best} (believed)', (1e3*result.seconds(best), believed[0]),
                          textcoords='offset points', xytext=(4, 9 if best == BEST else 22),
                          ha='left' if best == BEST else 'right', fontsize=8.5)
        else:
            axes.annotate(f'{best} (reference)', (1e3*result.seconds(best), 0.02),
                          xycoords=('data', 'axes fraction'), rotation=90, fontsize=8.5, ha='left',
                          va='bottom')
    axes.set_xscale('log')
    axes.set_yscale('log')
    low, high = axes.get_xlim()
    axes.set_xlim(low/1.3, high*3)
    plain_ticks(axes)
    axes.set_xlabel('ms per LangevinHI step (faster platform, forces included)')
    axes.set_ylabel('|relative error|')
    if len(chosen) > 1:
        axes.set_title(
            f'full to pale: {result.parameter} ' + ', '.join(f'{value:g}' for value in chosen),
            fontsize=9.5)
    axes.grid(True, which='major', alpha=0.35)


# ---- Texts and tables ----------------------------------------------------------------------------


def percent(error: Optional[float]) -> str:
    """A relative error as text.

    Parameters
    ----------
    error : float or None
    """
    if error is None:
        return 'n/a'
    error = 100*abs(error)
    return (f'{error:.0f} %' if error >= 10 else
            f'{error:.2g} %' if error >= 1e-3 or error == 0 else f'{error:.1e} %')


def textTable(result: LadderResult) -> str:
    """Largest errors of all rungs over the scenes, in per cent, and times, as text.

    Parameters
    ----------
    result : LadderResult
    """
    names = [name for name in result.observables if result.select(name)]
    width = max(22, *(len(name) + 2 for name in names))
    lines = [
        'error in %' + (f', the largest over {result.parameter}s' if result.parameter else ''),
        f'{"rung":<18}{"a step":>10}  {"on":<10}' + ''.join(f'{name:>{width}}' for name in names)
    ]
    for rung in result.rungs:
        row = next(row for row in result.rows if row['rung'] == rung)
        line = (f'{rung:<18}{duration(row["seconds_step"]) if row["seconds_step"] else "":>10}  '
                f'{row["platform"] or "":<10}')
        for name in names:
            rows = result.select(name, rung)
            largest = percent(max(
                (abs(r['error']) for r in rows),
                default=None)) + ('' if len(rows) == len(result.references) else ' (in part)')
            isReference = rows and all(r['is_reference'] for r in rows)
            line += f'{"reference" if isReference else largest:>{width}}'
        lines.append(line)
    return '\n'.join(lines)


def summary(result: LadderResult, answers: list[Recommendation],
            wanted: Sequence[str]) -> list[str]:
    """The report as paragraphs.

    Parameters
    ----------
    result : LadderResult
    answers : list of Recommendation
    wanted : sequence of str
        the questions to the answers

    Returns
    -------
    list of str
        paragraphs, the answers first
    """
    lines = [answer.text for answer in answers] + [result.referenceText()]
    for item in wanted if result.parameter else ():
        lines.append(f'Where {item} is met, by {result.parameter}: {_where_good(result, item)}.')
    for observable, about in result.observables.items() if result.parameter else ():
        exact = result.exactNumbers(observable)
        if not exact:
            continue
        end = max(exact) if result.isHarderUpwards else min(exact)
        last = {
            row['rung']: row['value']
            for row in result.select(observable) if row['parameter'] == end
        }
        lines.append(
            f'{sentence(about["label"])}: {percent(FOLLOWS)} off at most, by {result.parameter}, '
            f'are {_where_good(result, f"{observable}:{FOLLOWS}")}. '
            f'At {end:g} the exact number is {exact[end]:.4g}, and found are ' +
            ', '.join(f'{rung} {value:.4g}' for rung, value in last.items()) + '.')
    remarks = {(row['rung'], row['status']): row['message']
               for row in result.rows if row['message']}
    for (rung, status), message in remarks.items():
        values = sorted({
            row['parameter']
            for row in result.rows if (row['rung'], row['status']) == (rung, status)
        })
        where = f' at {result.parameter} ' + ', '.join(
            f'{value:g}' for value in values) if result.parameter else ''
        lines.append(rung + ('' if status == STABLE else f' cannot be used{where}') +
                     f': {message}')
    return lines


def _where_good(result, wanted):
    """From which parameter, or up to which, each rung meets a wanted error, as text."""
    good, word = (result.goodUpTo(wanted),
                  'up to') if result.isHarderUpwards else (result.goodDownTo(wanted), 'from')
    return '; '.join(f'{rung}: ' + ('nowhere' if value is None else f'{word} {value:g}')
                     for rung, value in good.items())


def costTable(result: LadderResult) -> str:
    """Times per step, an HTML table.

    Parameters
    ----------
    result : LadderResult
    """
    rows = []
    for rung, description in result.rungs.items():
        row = next(row for row in result.rows if row['rung'] == rung)
        times = [
            duration(row[key]) if row[key] is not None else ''
            for key in ('seconds_step', 'seconds_low', 'seconds_high')
        ]
        rows.append((rung, description, times[0], f'{times[1]} – {times[2]}' if times[0] else '',
                     row['platform'] or '', row['solver'] or ''))
    return table(('rung', 'what', 'a step', '16 – 84 %', 'faster on', 'matrices'), rows)


def errorTable(result: LadderResult, observable: str) -> str:
    """Relative errors by scene and rung, an HTML table.

    Parameters
    ----------
    result : LadderResult
    observable : str
    """
    def cell(value, rung):
        row = next(row for row in result.rows if (row['parameter'], row['rung'],
                                                  row['observable']) == (value, rung, observable))
        if row['is_reference']:
            return 'reference' + ('' if row['believed'] is None else
                                  f' (± {percent(row["believed"])})')
        return '' if row['error'] is None else f'{row["error"]:+.2e}'

    return table(
        (result.parameter or 'scene', *result.rungs),
        [(f'{value:g}' if result.parameter else result.scene['name'], *(cell(value, rung)
                                                                        for rung in result.rungs))
         for value in result.references])
