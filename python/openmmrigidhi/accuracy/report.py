"""Files of a result: CSV, JSON, pictures, and one HTML page that needs nothing else."""
import base64
import csv
import html
import io
import os
import re

import numpy as np

from .measurement import STABLE, UNSTABLE

#: Colour-blind safe (Okabe and Ito), one per method; methods of the user's own take the rest in turn.
COLOURS = {'LangevinC': '#0072B2', 'LangevinMiddle': '#D55E00', 'LangevinB': '#009E73', 'LangevinA': '#E69F00',
           'GradientThermostat': '#CC79A7', 'EulerMaruyama': '#999999', 'FixmanMidpoint': '#E69F00', 'RandomFiniteDifference': '#56B4E9',
           'TractionEulerMaruyama': '#B8A800', 'TrapezoidalSlip': '#0072B2', 'DriftCorrectorFD': '#CC79A7', 'DriftCorrectorRFD': '#882255',
           'LangevinHI(0.3)': '#009E73', 'LangevinHI(1)': '#D55E00', 'LangevinHI(3)': '#000000'}
SPARE_COLOURS = ('#56B4E9', '#000000', '#7F7F7F', '#8C564B')
MARKERS = {'LangevinC': 'o', 'LangevinMiddle': 's', 'LangevinB': '^', 'LangevinA': 'v', 'GradientThermostat': 'D',
           'EulerMaruyama': 'X', 'FixmanMidpoint': '^', 'RandomFiniteDifference': 's', 'TractionEulerMaruyama': 'v', 'TrapezoidalSlip': 'o',
           'DriftCorrectorFD': '<', 'DriftCorrectorRFD': '>', 'LangevinHI(0.3)': 'D', 'LangevinHI(1)': 'P', 'LangevinHI(3)': '*'}
#: More than these need a legend of several columns.
MANY_METHODS = 6
COLUMNS = ('method', 'knob', 'value', 'step_size', 'status', 'ns_per_day', 'ns_per_day_low', 'ns_per_day_high', 'ns_per_cpu_day',
           'observable', 'mean', 'standard_error', 'error', 'error_standard_error', 'error_low', 'error_high',
           'relative_error', 'tau', 'samples', 'length', 'equilibration', 'drift', 'seed', 'note', 'message')


def writeCsv(result, path):
    """Write one row per setting and observable; empty cells where there is no number. Units: docs/accuracy.md.

    Parameters
    ----------
    result : StudyResult
    path : str
    """
    with open(path, 'w', newline='') as file:
        writer = csv.writer(file, lineterminator='\n')
        writer.writerow(COLUMNS)
        for row in result.rows:
            writer.writerow(['' if row.get(key) is None else
                             f'{row[key]:.8g}' if isinstance(row[key], float) else row[key] for key in COLUMNS])


def write(result, directory, wanted=(), baseline='LangevinMiddle'):
    """Write all files into a directory.

    Parameters
    ----------
    result : StudyResult
    directory, wanted, baseline
        see StudyResult.write()

    Returns
    -------
    list of str
        paths of the files
    """
    os.makedirs(directory, exist_ok=True)
    wanted = [wanted] if isinstance(wanted, str) else list(wanted)
    paths = [os.path.join(directory, name) for name in ('results.csv', 'results.json', 'report.html')]
    answers = [result.recommend(item) for item in wanted]
    # Several observables in one wish share an answer; each of them has a comparison of its own.
    single = list(dict.fromkeys(part.strip() for item in wanted for part in item.split(',')))
    comparisons = {item: result.compareAt(item, baseline) for item in single}
    writeCsv(result, paths[0])
    result.writeJson(paths[1], recommendations=[{'wanted': [vars(each) for each in answer.wanted], 'verdict': answer.verdict,
                                                 'setting': answer.setting, 'factor': answer.factor, 'text': answer.text,
                                                 'candidates': answer.candidates} for answer in answers],
                     at_wanted_error=comparisons)
    pictures = {}
    for observable in result.observables:
        if any(row['error'] is not None for row in result.select(observable)):
            pictures[observable] = draw(result, observable, single)
            path = os.path.join(directory, f'error_{re.sub("[^A-Za-z0-9_]", "_", observable)}.png')
            with open(path, 'wb') as file:
                file.write(pictures[observable])
            paths.append(path)
    with open(paths[2], 'w') as file:
        file.write(page(result, answers, comparisons, pictures, baseline))
    return paths


# ---- Pictures --------------------------------------------------------------------------------------------------------

def _style(result):
    spare = iter(SPARE_COLOURS*10)
    return {method: (COLOURS.get(method) or next(spare), MARKERS.get(method, 'P')) for method in result.methods()}


def _sentence(text):
    """With a capital at the start, and nothing else changed."""
    return text[:1].upper() + text[1:]


def draw(result, observable, wanted=()):
    """Error against speed beside the means against the knob, a PNG.

    Parameters
    ----------
    result : StudyResult
    observable : str
    wanted : sequence of str
        wanted errors; those of this observable are drawn as lines

    Returns
    -------
    bytes
    """
    figure, left, right = twoPanels(f'{_sentence(result.observables[observable]["label"])}, {result.scene["name"]}')
    reference = result.references[observable]
    relative = reference.value != 0
    scale = 100/abs(reference.value) if relative else 1.0
    sign = f'% of {abs(reference.value):.5g} {result.observables[observable]["unit"]}' if relative else \
        result.observables[observable]['unit']
    _drawErrors(left, result, observable, scale, sign, wanted)
    _drawMeans(right, result, observable, reference, wanted)
    return png(figure, f'Error of {observable}')


def png(figure, title):
    """A figure as PNG, bytes.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    title : str
        in its metadata
    """
    buffer = io.BytesIO()
    figure.savefig(buffer, format='png', dpi=110, metadata={'Title': title, 'Software': None})
    return buffer.getvalue()


def twoPanels(title):
    """An empty figure with two panels side by side, the left one wider: (figure, left, right).

    Parameters
    ----------
    title : str
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    # Not pyplot: no window system, no global state.
    figure = Figure(figsize=(12.5, 5.6), layout='constrained')
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2, gridspec_kw={'width_ratios': (1.35, 1)})
    figure.suptitle(title, fontsize=13)
    return figure, left, right


def _drawErrors(axes, result, observable, scale, unit, wanted):
    style = _style(result)
    rows = [row for row in result.select(observable) if row['error'] is not None and row['ns_per_day']]
    sizes = [abs(row['error'])*scale for row in rows]
    lines = [each for item in wanted for each in result.parseWanted(item) if each.observable == observable]
    sigmas = [row['error_standard_error']*scale for row in rows]
    # Below a third of the smallest error bar there is nothing to see.
    floor = min([s/2 for s in sigmas if s > 0] + [line.tolerance*scale/4 for line in lines] + [s for s in sizes if s > 0] + [1e300])
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
            axes.plot([x, x], [max(smallest, floor*0.7), largest], color=colour, lw=1.4, alpha=0.8, zorder=2)
            axes.plot([row[key]*result.knob.speedScale for key in ('ns_per_day_low', 'ns_per_day_high')], [y, y], color=colour, lw=1.0, alpha=0.6, zorder=2)
            axes.plot(x, y, marker=marker, ms=7, color=colour, mfc=colour if resolved else 'white', mew=1.4, zorder=4, ls='')
            axes.annotate(result.knob.format(row['value']), (x, y), xytext=(6, 5), textcoords='offset points', fontsize=8.5,
                          color=colour, zorder=5)
            known.append((x, y) if resolved else (np.nan, np.nan))
        if known:
            axes.plot(*zip(*known), color=colour, lw=1.0, alpha=0.45, zorder=1)
        axes.plot([], [], color=colour, marker=marker, ms=7, label=method)
        dead = sorted({(row['value'], row['step_size']) for row in result.rows if row['method'] == method
                       and row['status'] == UNSTABLE and row['observable'] == observable})
        for k, (value, step) in enumerate(dead):
            rates = result._stepsPerSecond(observable, method, step)
            if len(rates):
                x = step*np.median(rates)*86.4*result.knob.speedScale
                axes.plot(x, top*1.9, marker='x', ms=9, mew=2.2, color=colour, zorder=4)
                axes.annotate(result.knob.format(value), (x, top*1.9), xytext=(0, -15), ha='center', textcoords='offset points',
                              fontsize=8.5, color=colour)
                if k == 0:
                    axes.annotate('unstable:', (x, top*1.9), xytext=(-10, 0), ha='right', va='center', textcoords='offset points',
                                  fontsize=8.5, color=colour)
    for line in lines:
        axes.axhline(line.tolerance*scale, color='black', ls='--', lw=1.2, zorder=1)
        axes.annotate('wanted: ' + line.text.split(' of ')[0], (0.01, line.tolerance*scale), xycoords=('axes fraction', 'data'),
                      xytext=(2, 4), textcoords='offset points', fontsize=9)
    axes.set_xscale('log')
    axes.set_yscale('log')
    axes.set_ylim(floor*0.6, top*3)
    left, right = axes.get_xlim()
    axes.set_xlim(left, right*1.12)
    axes.set_xlabel(result.knob.speedUnit + (' (CPU time)' if result.provenance.get('clock') == 'cpu' else '')
                    + f'   [{_platform(result)}]')
    axes.set_ylabel(f'|error|, {unit}')
    axes.set_title('Error against speed: down and to the right is better', fontsize=10.5)
    axes.grid(True, which='major', alpha=0.35)
    axes.grid(True, which='minor', alpha=0.12)
    plainTicks(axes)
    axes.plot([], [], marker='o', mfc='white', color='grey', ls='', label='not distinguishable from 0')
    many = len(result.methods()) > MANY_METHODS
    if many:
        # Room for the legend above all points.
        low, high = axes.get_ylim()
        axes.set_ylim(low, high*(high/low)**0.45)
    axes.legend(loc='upper center' if many else 'best', ncol=3 if many else 1, fontsize=8 if many else 9, framealpha=0.9,
                title=f'bars: {100*result.confidence:g} % confidence (error), 16–84 % (speed)', title_fontsize=8)


def _platform(result):
    threads = result.provenance.get('threads')
    return f'{result.provenance.get("platform")} platform, {threads} thread{"" if threads == 1 else "s"}'


def plainTicks(axes):
    """Numbers such as 0.2 and 50 on logarithmic axes, a list of them that is not too long."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
    for axis in (axes.xaxis, axes.yaxis):
        low, high = axis.get_view_interval()
        decades = np.log10(high/low)
        axis.set_major_locator(LogLocator(subs=(1, 2, 5) if decades < 2.5 else (1,), numticks=20))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f'{value:g}'))
        axis.set_minor_formatter(NullFormatter())


def _drawMeans(axes, result, observable, reference, wanted):
    style = _style(result)
    knob = result.knob
    for method in result.methods():
        colour, marker = style[method]
        rows = result.select(observable, method)
        if not rows:
            continue
        axes.errorbar([row['value']*knob.scale for row in rows], [row['mean'] for row in rows],
                      yerr=[row['standard_error'] for row in rows], color=colour, marker=marker, ls='', ms=6, capsize=2.5, label=method)
        if reference.fit is not None and method in reference.fit.coefficients:
            E, F = reference.fit.coefficients[method]
            used = [value for (name, value), flag in zip(reference.points, reference.fit.used) if flag and name == method]
            h = np.linspace(0, max(used), 100)
            x = h**result.orders[method]
            axes.plot(h*knob.scale, reference.value + E*x + (F or 0)*x*x, color=colour, lw=1.2)
    axes.axhline(reference.value, color='black', lw=1)
    if reference.standardError > 0:
        axes.axhspan(reference.value - reference.standardError, reference.value + reference.standardError, color='black', alpha=0.15,
                     lw=0)
    what = {'exact': 'exact', 'given': 'given', 'extrapolated': 'limit of small steps'}[reference.kind]
    errorText = f' ± {reference.standardError:.1g}' if reference.standardError else ''
    axes.set_title(f'{what}: {reference.value:.6g}{errorText} {result.observables[observable]["unit"]}', fontsize=10.5)
    axes.set_xlabel(f'{knob.label}, {knob.unit}')
    axes.set_ylabel(f'mean, {result.observables[observable]["unit"]} (bars: 1 sigma)')
    axes.set_xlim(left=0)
    tolerances = [each.tolerance for item in wanted for each in result.parseWanted(item) if each.observable == observable]
    errors = [row['error'] for row in result.select(observable) if row['error'] is not None]
    # Far beyond what is wanted it does not matter how far.
    if tolerances and max(map(abs, errors)) > 10*max(tolerances):
        inside = [e for e in errors if abs(e) <= 10*max(tolerances)] + [-2*max(tolerances), 2*max(tolerances)]
        margin = 0.08*(max(inside) - min(inside))
        axes.set_ylim(reference.value + min(inside) - margin, reference.value + max(inside) + margin)
        axes.annotate('larger errors are outside', (0.98, 0.02), xycoords='axes fraction', ha='right', fontsize=8.5)
    axes.grid(True, alpha=0.3)


# ---- Words -----------------------------------------------------------------------------------------------------------

def comparisonText(result, comparison, baseline):
    """How the methods compare at exactly the wanted error, in words.

    Parameters
    ----------
    result : StudyResult
    comparison : dict
        what StudyResult.compareAt() returned
    baseline : str

    Returns
    -------
    list of str
        a sentence for each method
    """
    lines = []
    for method, entry in comparison.items():
        scale, speed = result.knob.scale, result.knob.speed(entry['ns_per_day'])
        step = f'{entry["step"]*scale:.3g} {result.knob.unit}'
        if entry['capped']:
            text = (f'{method}: its error is still below the wanted one at its largest stable step, {step}: at least '
                    f'{speed}')
        else:
            text = (f'{method}: reaches the wanted error at a step of {step} '
                    f'({entry["step_low"]*scale:.3g} to {entry["step_high"]*scale:.3g}): {speed}')
        if entry['ratio'] is not None and method != baseline:
            # The baseline may be good for larger steps than were measured, or the method.
            bound = {(False, True): 'at most ', (True, False): 'at least '}.get((entry['capped'], comparison[baseline]['capped']), '')
            text += (f'; {bound}{entry["ratio"]:.2f} times the {result.knob.speedUnit} of {baseline} ({entry["ratio_low"]:.2f} to '
                     f'{entry["ratio_high"]:.2f})')
        lines.append(text + '.')
    return lines


def summaryText(result, answers, comparisons, baseline):
    """Everything that is to be said in plain words.

    Parameters
    ----------
    result : StudyResult
    answers : list of Recommendation
    comparisons : dict
        wanted error -> what StudyResult.compareAt() returned for it
    baseline : str

    Returns
    -------
    list of str
        paragraphs, the answers first
    """
    lines = [answer.text for answer in answers]
    for wanted, comparison in comparisons.items():
        if comparison:
            item, = result.parseWanted(wanted)
            lines.append(f'At exactly {item.text}, between the steps that were measured: '
                         + ' '.join(comparisonText(result, comparison, baseline)))
    dead = {}
    for row in result.rows:
        if row['status'] == UNSTABLE:
            dead.setdefault(row['method'], set()).add(row['value'])
    for method, values in dead.items():
        lines.append(f'{method} was unstable at {", ".join(result.knob.format(value) for value in sorted(values))}.')
    for method, reason in result.refusals.items():
        lines.append(f'{method} was not run: {reason}.')
    refused = {}
    for row in result.rows:
        if row['status'] not in (STABLE, UNSTABLE):
            refused[row['method']] = row['message']
    for method, reason in refused.items():
        lines.append(f'{method} cannot be used on this scene: {reason}')
    drifting = sorted({(row['method'], row['value']) for row in result.rows if row['note'] == 'drifts'})
    if drifting:
        lines.append('The two halves of the run disagree (a longer equilibration is needed, or the run is about to blow up) at: '
                     + ', '.join(f'{method} {result.knob.format(value)}' for method, value in drifting) + '.')
    if any(row['note'] == 'few independent samples' for row in result.rows):
        lines.append('Some runs have fewer than 10 blocks of independent samples; their errors are themselves uncertain '
                     '(marked in the table).')
    return lines


_CSS = '''body{font:15px/1.5 sans-serif;max-width:1150px;margin:2em auto;padding:0 1em;color:#222}
img{max-width:100%}table{border-collapse:collapse;font-size:13px;margin:1em 0}td,th{border:1px solid #ccc;padding:2px 8px;text-align:right}
th{background:#f0f0f0}td:first-child,th:first-child,td.t{text-align:left}tr.bad td{color:#999}.answer{background:#eef5fb;border-left:5px
solid #0072B2;padding:.6em 1em;margin:.6em 0}summary{cursor:pointer;font-weight:bold}'''


def page(result, answers, comparisons, pictures, baseline):
    """One HTML page with everything in it; nothing is loaded from elsewhere.

    Parameters
    ----------
    result : StudyResult
    answers : list of Recommendation
    comparisons : dict
        wanted error -> what StudyResult.compareAt() returned for it
    pictures : dict
        observable -> PNG, bytes
    baseline : str

    Returns
    -------
    str
    """
    escape = html.escape
    parts = [f'<h1>What accuracy costs: {escape(result.scene["name"])}</h1>', f'<p>{escape(result.scene["description"])}.</p>',
             '<h2>In words</h2>']
    texts = summaryText(result, answers, comparisons, baseline)
    parts += [f'<p class="answer">{escape(text)}</p>' for text in texts[:len(answers)]]
    parts += [f'<p>{escape(text)}</p>' for text in texts[len(answers):]]
    if not answers:
        parts.append('<p>No wanted error was given; with one (for example potential_energy:0.5%) this page names the cheapest '
                     'setting.</p>')
    for wanted, comparison in comparisons.items():
        if comparison:
            parts.append(_comparisonTable(result, wanted, comparison, baseline))
    parts.append('<h2>Pictures and tables</h2>')
    for observable in result.observables:
        about = result.observables[observable]
        parts.append(f'<h3>{escape(_sentence(about["label"]))}</h3>')
        if observable in pictures:
            parts.append(picture(pictures[observable], f'Error of {about["label"]} against {result.knob.speedUnit}'))
        parts.append(_table(result, observable))
    parts.append('<h2>How it was measured</h2>')
    parts += [f'<p>{escape(text)}</p>' for text in _howText(result)]
    return document(f'What accuracy costs: {result.scene["name"]}', parts + [machineTable(result.provenance)])


def document(title, parts):
    """An HTML page that loads nothing from elsewhere.

    Parameters
    ----------
    title : str
    parts : list of str
        HTML of the body

    Returns
    -------
    str
    """
    return '\n'.join(['<!DOCTYPE html>', f'<html lang="en"><head><meta charset="utf-8"><title>{html.escape(title)}</title>'
                      f'<style>{_CSS}</style></head><body>', *parts, '</body></html>']) + '\n'


def picture(content, text):
    """A PNG within a page.

    Parameters
    ----------
    content : bytes
    text : str
        what it shows, for those who do not see it
    """
    return f'<img alt="{html.escape(text)}" src="data:image/png;base64,{base64.b64encode(content).decode()}">'


def table(head, rows):
    """An HTML table.

    Parameters
    ----------
    head : sequence of str
    rows : sequence of sequence of str

    Returns
    -------
    str
    """
    def line(tag, cells):
        return '<tr>' + ''.join(f'<{tag}>{html.escape(cell)}</{tag}>' for cell in cells) + '</tr>'
    return '\n'.join(['<table>', line('th', head), *(line('td', row) for row in rows), '</table>'])


def machineTable(provenance):
    """Machine, versions and the like, folded.

    Parameters
    ----------
    provenance : dict
    """
    rows = ''.join(f'<tr><td>{html.escape(key)}</td><td class="t">{html.escape(str(value))}</td></tr>'
                   for key, value in _flatten(provenance))
    return f'<details><summary>Machine, versions, seed</summary><table>{rows}</table></details>'


def _flatten(data):
    for key, value in data.items():
        if isinstance(value, dict):
            yield from ((f'{key}: {name}', each) for name, each in value.items())
        else:
            yield key, value


def _comparisonTable(result, wanted, comparison, baseline):
    cells = ['<table><tr><th>at ' + html.escape(wanted) + f'</th><th>step, {result.knob.unit}</th><th>95 %</th><th>steps/s</th><th>{result.knob.speedUnit}</th>'
             '<th>95 %</th><th>times ' + html.escape(baseline) + '</th><th>95 %</th></tr>'.replace('95', f'{100*result.confidence:g}')]
    for method, entry in comparison.items():
        atLeast = '&ge; ' if entry['capped'] else ''
        ratio = ('', '') if entry['ratio'] is None else (f'{entry["ratio"]:.2f}',
                                                         f'{entry["ratio_low"]:.2f} – {entry["ratio_high"]:.2f}')
        low, middle, high = (f'{entry[key]*result.knob.scale:.3g}' for key in ('step_low', 'step', 'step_high'))
        slow, speed, fast = (f'{entry[key]*result.knob.speedScale:.3g}' for key in ('ns_per_day_low', 'ns_per_day', 'ns_per_day_high'))
        cells.append(f'<tr><td>{html.escape(method)}</td><td>{atLeast}{middle}</td><td>{low} – {high}</td>'
                     f'<td>{entry["steps_per_second"]:.1f}</td><td>{atLeast}{speed}</td><td>{slow} – {fast}</td>'
                     f'<td>{ratio[0]}</td><td>{ratio[1]}</td></tr>')
    return '\n'.join(cells) + '</table>'


def _table(result, observable):
    unit = result.observables[observable]['unit']
    head = ('method', f'{result.knob.label}, {result.knob.unit}', result.knob.speedUnit, f'mean, {unit}', '± (1 sigma)', f'error, {unit}',
            f'{100*result.confidence:g} % interval', 'error, %', 'tau, ps', 'length, ps', 'note')
    lines = ['<table><tr>' + ''.join(f'<th>{html.escape(cell)}</th>' for cell in head) + '</tr>']
    for row in result.rows:
        if row['observable'] != observable:
            continue
        note = row['note'] if row['status'] == STABLE else f'{row["status"]}: {row["message"]}'
        interval = '' if row['error'] is None else f'{row["error_low"]:.3g} … {row["error_high"]:.3g}'
        speed = None if row['ns_per_day'] is None else row['ns_per_day']*result.knob.speedScale
        cells = [row['method'], f'{row["value"]*result.knob.scale:g}', _number(speed, '.3g'), _number(row['mean'], '.6g'),
                 _number(row['standard_error'], '.2g'), _number(row['error'], '.3g'), interval,
                 _number(None if row['relative_error'] is None else 100*row['relative_error'], '.3f'), _number(row['tau'], '.2g'),
                 _number(row['length'], '.4g') if row['status'] == STABLE else '']
        lines.append(f'<tr{"" if row["status"] == STABLE else " class=bad"}>' + ''.join(f'<td>{html.escape(c)}</td>' for c in cells)
                     + f'<td class="t">{html.escape(note)}</td></tr>')
    return '\n'.join(lines) + '</table>'


def _number(value, form):
    return '' if value is None else format(value, form)


def _howText(result):
    provenance = result.provenance
    lines = [f'{_platform(result)}, {provenance.get("rounds")} rounds in which the '
             f'settings took turns in a random order. {result.knob.speedUnit} is the median over rounds of the integration steps alone '
             f'({provenance.get("clock")} time).',
             'Standard errors are from block averages with blocks of 20 integrated autocorrelation times; intervals use '
             "Student's t with the number of blocks."]
    if any(reference.kind == 'extrapolated' for reference in result.references.values()):
        lines.append('Where no exact average is known, means are compared with the common limit A0 of all methods, from a weighted fit of '
                     'A0 + E h^p + F h^2p (p: order of the method); the error of A0, and that a mean is part of the fit, '
                     'are in the intervals.')
    for name, reference in result.references.items():
        if reference.fit is not None:
            dropped = [f'{method} {result.knob.format(value)}' for (method, value), used in zip(reference.points, reference.fit.used)
                       if not used]
            lines.append(f'{_sentence(result.observables[name]["label"])}: A0 = {reference.value:.6g} ± {reference.standardError:.2g} '
                         f'{result.observables[name]["unit"]}, chi2 = {reference.fit.chi2:.1f} for {reference.fit.degrees} degrees of '
                         f'freedom' + (f', without {", ".join(dropped)}' if dropped else '')
                         + (f'; {reference.fit.note}' if reference.fit.note else '') + '.')
    kinetic = any('temperature' in name for name in result.observables)
    if kinetic and 'LangevinMiddle' in result.methods():
        lines.append("LangevinMiddle's temperatures are from the velocities in its State, which belong to the middle of the step, where "
                     "kinetic energy is more accurate than at its end; its configurations are no better for it. The plugin's "
                     'are from the end of the step.')
    return lines
