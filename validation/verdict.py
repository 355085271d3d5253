#!/usr/bin/env python3
"""Write README.md of this folder: every number and figure of the papers beside ours.

    python3 verdict.py            # writes README.md
    python3 verdict.py --print    # prints it

A row is (where, what, published, ours, difference in standard errors, length, verdict). The numbers
come from the JSONs in the papers' folders. Statements that the papers make in words or in figures
without numbers are written down here, with the result of ours that each is compared with.
"""
import argparse
import json
import math
import pathlib
import sys

import numpy as np

HERE = pathlib.Path(__file__).resolve().parent
sys.path += [str(HERE/'common'), str(HERE.parent/'tools')]
from format_markdown import format_text  # noqa: E402
from recording import brackets  # noqa: E402

#: Differences below so many standard errors agree. There are some two hundred rows; chance alone
#: makes one in 370 larger.
AGREES_BELOW = 3.0
#: Probabilities of a histogram (all bins together) above this agree: the same share of false
#: alarms.
AGREES_ABOVE = 0.0027
Z95 = 1.96


def read(path):
    return json.loads((HERE/path).read_text())


def printed(text):
    """A number as it is printed, and the standard deviation of its rounding error."""
    digits = len(text.partition('.')[2])
    return float(text), 10.0**-digits/math.sqrt(12)


def compared(published, ours, why=''):
    """(z, verdict) of two (value, standard error); why: the reason of a disagreement."""
    z = (ours[0] - published[0])/math.hypot(ours[1], published[1])
    return f'{z:+.1f}', 'agrees' if abs(z) < AGREES_BELOW else 'disagrees' + (
        f': {why}' if why else '')


def constant(published, ours):
    """(z, verdict) of the constant of an error that falls with the step.

    A constant below the standard error of our run is not reached, rather than an agreement.
    """
    z, verdict = compared(published, ours)
    return z, verdict if ours[1] < abs(
        published[0]
    ) or verdict != 'agrees' else 'not reached: our standard error is larger than the number'


def table(rows):
    yield ('| where | what | published | ours | difference, standard errors '
           '| length of our run | verdict |')
    yield '|---|---|---|---|---|---|---|'
    for row in rows:
        yield '| ' + ' | '.join(str(cell).replace('|', '\\|') for cell in row) + ' |'


# ---- Davidchack, Handel, Tretyakov's water -------------------------------------------------------
NAMES_2015 = {'g_OO': 'g_OO(2.78 Å)', 'g_OH': 'g_OH(1.82 Å)', 'g_HH': 'g_HH(2.38 Å)'}
UNITS_2015 = {'U': 'kcal/mol', 'P_ex': 'MPa', 'g_OO': '', 'g_OH': '', 'g_HH': ''}


def davidchack2015():
    data = read('davidchack2015/results/table1.json')
    for scheme, entry in data['schemes'].items():
        if scheme not in ('A', 'B', 'C', 'gradient'):
            continue
        figure = f'Table 1, Figure {dict(A=1, B=2, C=3, gradient=4)[scheme]}'
        steps = sorted({entry['measured_steps'][h] for h in entry['measured_steps']})
        hs = ', '.join(sorted(entry['measured_steps'], key=float))
        counts = ' to '.join(f'{n:,}' for n in sorted({steps[0], steps[-1]}))
        length = f'512 molecules, h = {hs} fs, {counts} steps each'
        power = '' if scheme == 'gradient' else '²'
        for row, line in entry['fits'].items():
            paper = line['paper']
            called, unit = NAMES_2015.get(row, row), UNITS_2015.get(row, 'K')
            for key, name in (('A0', f'{called} at h → 0' + (f', {unit}' if unit else '')),
                              ('E', f'E_A of {called}, {unit or 1}/fs{power}')):
                published, ours = (paper[key], paper[f'{key}_error95']/Z95), (line[key],
                                                                              line[f'{key}_error'])
                why = (f'{100*(ours[0]/published[0] - 1):+.1f} %; the paper gives neither the '
                       f'screening nor the truncation of its electrostatics'
                       if row.startswith('g_') and key == 'A0' else '')
                yield figure, f'{scheme}: {name}', brackets(*published), brackets(
                    *ours), *(compared(published, ours, why) if key == 'A0' else constant(
                        published, ours)), length
    trials = read('davidchack2015/results/stability.json')
    limits = trials['limits']

    def limit(name):
        found = limits[name]
        return (f'stable to {found["largest_stable_below_the_first_failure"]:g}, '
                f'unstable at {found["smallest_unstable"]:g}')

    def temperatures(name, key):
        return ', '.join(f'{brackets(t[key]["mean"], t[key]["standard_error"])} at {t["x"]:g}'
                         for t in trials['trials'][name] if t['x'] >= 100)

    length = '343 molecules, 20 ps a step size'
    yield ('section VI', 'A, B, C without friction, largest h, fs', 'unstable at around 8',
           f'A: {limit("Langevin A, no friction")}', '–', 'agrees', length)
    yield ('section VI', 'A, B, C, γ + Γ = 15/ps, largest h, fs', 'stable up to about 10',
           f'A: {limit("Langevin A, gamma 5, Gamma 10 per ps")}; temperatures too high from 11 on',
           '–', 'agrees', length)
    length = '343 molecules, 2000 steps of 1 fs'
    yield 'section VI', 'gradient, largest h υ, fs²', 'about 150', limit(
        'gradient, h upsilon'), '–', 'agrees', length
    yield ('section VI', 'gradient, largest h Υ, fs²', 'about 70',
           'no run explodes; by the criterion that U stays below −5 kcal/mol: ' +
           limit('gradient, h Upsilon'), '–',
           'not reached: there is no sharp limit, and the paper does not define "unstable"', length)
    length = '343 molecules, 2000 steps of 2 fs'
    yield ('section VI', 'A, T_tk, K, for large γ, 1/ps', 'breaks down above about 100',
           temperatures('Langevin A, gamma', 'T_tk'), '–', 'agrees', length)
    yield ('section VI', 'A, T_rk, K, for large Γ, 1/ps', 'breaks down above about 200',
           temperatures('Langevin A, Gamma', 'T_rk'), '–',
           'agrees: the breakdown is gradual, and A is off from 500 on', length)
    yield ('section VI', 'C, T_tk, K, for large γ, 1/ps', 'any γ',
           temperatures('Langevin C, gamma', 'T_tk'), '–', 'agrees', length)


# ---- Davidchack 2017 -----------------------------------------------------------------------------
#: Largest relative differences of the paper's method, which ends its multipoles at l = 2, from
#: exact numbers (Table S1).
PAPERS_OWN_ERROR = {'F/U': 1e-5, 'omega/U': 3e-4}


def tableS1():
    data = read('davidchack2017/results/sedimenting_spheres.json')
    for separation, exact in data['exact'].items():
        row = data['models']['FTS+lubrication'][separation]
        for key, column, name in (('F/U', 0, 'F/U'), ('omega/U', 2, 'ω/U')):
            published, ours = exact['paper'][column], row[key]
            difference = ours/published - 1
            yield ('Table S1', f'{name}, l/a = {separation}', f'{published:.8g}', f'{ours:.9g}',
                   f'relative: {difference:+.1e}',
                   f'agrees: ours differs by {abs(ours/exact[key] - 1):.0e} from the exact '
                   f'number, the paper\'s by {abs(published/exact[key] - 1):.0e}'
                   if abs(difference) < PAPERS_OWN_ERROR[key] else 'disagrees',
                   f'without noise; {sum(row["steps"]):,} steps, h → 0 from five step sizes')


def tableS2():
    free, periodic = (read(f'davidchack2017/results/{name}.json')
                      for name in ('lennard_jones', 'lennard_jones_periodic'))
    for data, key, label, model in ((free, None, 'no fluid', 'FreeDraining'),
                                    (periodic, 'SD periodic', 'periodic fluid', 'SD periodic')):
        for temperature, entry in data['analysis'].items():
            kT = temperature.split('=')[1]
            runs = [r for r in data['runs'] if r['model'] == model and r['kT'] == float(kT)]
            length = (f'{len(runs)} step sizes, {runs[0]["clusters"]} clusters, '
                      f'{sum(r["steps"] for r in runs):,} steps in all')
            for name, line in (entry
                               if key is None else entry.get(key, {'fit': {}}))['fit'].items():
                for value, called in (('A0', 'A0'), ('E_A', 'E_A')):
                    published = line['paper'][value], line['paper'][f'{value}_error']
                    ours = line[value], line[f'{value}_error']
                    yield (f'Table S2, Figure S{1 if kT == "0.1" else 2}',
                           f'{called} of {name}, kT = {kT}, {label}', brackets(*published),
                           brackets(*ours),
                           *(compared if value == 'A0' else constant)(published, ours), length)


def trapped():
    others = sorted((HERE/'davidchack2017/results').glob('trapped_spheres_seed*.json'))
    runs = [(r, '') for r in read('davidchack2017/results/trapped_spheres.json')['runs']
            ] + [(r, f', seed {path.stem.rpartition("seed")[2]}') for path in others
                 for r in read(path)['runs']]
    for r, which in runs:
        if r['R'] != 3:
            continue
        of = 'the scheme\'s' if r.get('theory_of', '').startswith('the scheme') else 'exact'
        figures = 'Figures 2, 3' if r['set'].startswith('inertial') else 'Figures 4, 5'
        asPrinted = r['kT'] in (0.1, 0.005)
        z = max(r['rms_z'].values())
        yield (
            figures, f'ten correlation functions, R = 3, kT = {r["kT"]:g}' +
            ('' if asPrinted else ', a tenth of the paper\'s value, where linear theory holds') +
            which, f'curves; ours are compared with {of} linear theory',
            f'largest difference from theory {max(r["largest_difference"].values()):.4f}, standard '
            f'errors up to {r["largest_standard_error"]:.4f}', f'rms of a curve: {z:.1f} at most',
            'agrees' if z < AGREES_BELOW else 'disagrees', f'time {r["time"]:.3g}, h = {r["h"]:g}')


def ring():
    rows = [
        r for name in ('FTS_lubrication', 'FTS_lubrication_untruncated', 'RPY', 'RPY_untruncated')
        for r in read(f'davidchack2017/results/ring_states_{name}.json')['rows']
    ]
    for f, tau, where, what, also in ((1.0, 0.0, 'Figure 7, Table S3', '5+1 drafting', ''),
                                      (1.2, -4.0, 'Figure 8(a), Table S3', 'steady pairs', ''),
                                      (1.2, -3.0, 'Figure 8(b), Table S3', 'pair drafting', ''),
                                      (0.4, -4.0, 'Figure 8(c), Table S3', 'in-phase triplets',
                                       ''), (0.0, -5.0, 'Table S3, video', 'drafting', '')):
        here = [r for r in rows if (r['f'], r['tau']) == (f, tau)]
        found = {}
        for r in here:
            if r['model'] == 'FTS+lubrication':
                starts = 'starts with opposite triplets' if r[
                    'start'] == 'opposite' else 'random starts'
                repulsion = 'truncated' if r['truncation'] == 'switch' else 'not truncated'
                case = f'{starts}, repulsion {repulsion}'
                found.setdefault(case, []).append(what in r['state'])
        shares = {case: (sum(yes), len(yes)) for case, yes in found.items()}
        every = [yes/of for yes, of in shares.values()]
        verdict = 'agrees' if min(every) >= 0.5 else (
            'agrees from some starts: the paper gives neither the initial positions nor the '
            'truncation of the repulsion') if max(every) > 0 else 'disagrees'
        yield (
            where, f'state at f = {f:g}, τ = {tau:g}, T = 0', what, '; '.join(
                f'{case}: {yes} of {of}' for case, (yes, of) in shares.items()), '–', verdict,
            f'time {min(r["settle"] + r["window"] for r in here):g} and more, h = {here[0]["h"]:g}')
    noisy = read('davidchack2017/results/ring_noise_FTS_lubrication.json')['rows']
    for f, tau, what in ((1.0, 0.0, '5+1 drafting'), (1.2, -4.0, 'steady pairs')):
        here = [r for r in noisy if (r['f'], r['tau']) == (f, tau) and r['kT'] > 0]

        def said(kT):
            r = next(r for r in here if r['kT'] == kT)
            mine, other = r['distances_to_noiseless'][what], min(
                v for k, v in r['distances_to_noiseless'].items() if k != what)
            return r['state'] == what, (f'{mine:.3f} rad from this state, {other:.3f} from the '
                                        f'other at kT = {kT:g}')

        for kT, published in ((1e-4, 'seen'), (1e-2, 'seen (video)')):
            yes, text = said(kT)
            yield ('section V.2' + (', Table S3' if kT == 1e-2 else ''),
                   f'{what} with noise, kT = {kT:g}', published, text, '–',
                   'agrees' if yes else 'disagrees',
                   f'time {next(r["settle"] + r["window"] for r in here if r["kT"] == kT):g}, h = '
                   f'{here[0]["h"]:g}')
    yield ('section V.2',
           'the other cycles with noise; switching between two states near the boundary', 'seen',
           '–', '–', 'not reached: not run', '–')


def davidchack2017():
    yield from tableS1()
    yield from tableS2()
    yield from trapped()
    yield from ring()


# ---- Delong 2015 ---------------------------------------------------------------------------------
def run(data, scheme, step=None, **labels):
    """The run with this scheme and step, the first one's without."""
    step = data['runs'][0]['step'] if step is None else step
    return next(r for r in data['runs']
                if r['scheme'] == scheme and abs(r['step']/step - 1) < 1e-6 and all(
                    r[k] == v for k, v in labels.items()))


def lengthOf(r, unit=''):
    return f'{r["replicas"]} × {r["steps"]:,} steps of {r["step"]:.3g}{unit}'


def distribution(where, r, key, what, wanted, unit='', why=''):
    """A histogram against the Gibbs-Boltzmann distribution.

    wanted: whether the paper's agrees with it.
    """
    h = r['histograms'][key]
    p = h['significance']
    same = p > AGREES_ABOVE
    ours = f'p = {p:.2g} (χ² a bin {h["chi2_per_bin"]:.1f})'
    return (where, f'{what}, {r["scheme"]}, step {r["step"]:.3g}',
            f'{"agrees" if wanted else "disagrees"} with Gibbs–Boltzmann', ours, '–',
            'agrees' if same == wanted else 'disagrees' + (f': {why}' if why else ''),
            lengthOf(r, unit))


def plateau(where, r, name, level, error, what):
    """The last lag of a mean square displacement against what it tends to."""
    m = r['msd'][name]
    ours, published = (m['mean'][-1], m['error'][-1]), (level, error)
    return (where, f'{what}, {r["scheme"]}',
            f'tends to {brackets(level, error) if error else format(level, ".5g")}',
            f'{brackets(*ours)} at lag {m["lag"][-1]:.3g}', *compared(published, ours), lengthOf(r))


def delong2015():
    t = read('delong2015/results/tetramer.json')
    e, paper = t['exact'], t['paper']
    quadrature = 'quadrature'
    poses = '128,000 independent poses'
    why = 'an error of the time step, a few per cent near the wall'
    small = run(t, 'RandomFiniteDifference', t['runs'][0]['step']/4)
    fixman, rfd, em = (run(t, name)
                       for name in ('FixmanMidpoint', 'RandomFiniteDifference', 'EulerMaruyama'))
    yield ('Figure 3', 'tetramer, gravitational height/a', '1.75',
           f'{e["gravitational height"]:.5f}',
           *compared(printed('1.75'), (e['gravitational height'], 0)), quadrature)
    yield distribution('Figure 3', fixman, 'h', 'height', True)
    yield distribution('Figure 3', rfd, 'h', 'height', True, why=why)
    yield distribution('Figure 3', small, 'h', 'height', True)
    yield distribution('Figure 3', em, 'h', 'height', False)
    yield ('Figures 3, 5', 'nearly rigid bodies by the FIB method', 'agree', '–', '–',
           'not reached: FIB is a method of another program', '–')
    for name in ('centre', 'vertex'):
        text = format(paper[f'slope {name}'], '.2f')
        ours = e['mobility averages (mean, error)'][f'slope {name}']
        yield 'Figure 4', f'slope of the parallel MSD at t = 0, {name}', text, brackets(
            *ours), *compared(printed(text), ours), poses
    boxes = read('confined/results/sedimentation.json')['boxes']
    for name in ('centre', 'vertex'):
        key, text = f'slope {name}', format(paper[f'slope {name}'], '.2f')
        (wide, error), (narrow, _) = boxes['64'][key], boxes['32'][key]
        # Images add a term in 1/L^3.
        ours = wide - (narrow - wide)/7, error
        yield ('Figure 4',
               f'the same, {name}, with images above a PeriodicWall: from periods of 32 '
               'and 64 a', text, brackets(*ours), *compared(printed(text), ours),
               f'{boxes["poses"]} independent poses')
    for r in (fixman, rfd):
        yield plateau('Figure 5', r, 'centre perpendicular', 2*e['gravitational height']**2, 0,
                      'perpendicular MSD of the centre')
        yield plateau('Figures 4, 5', r, 'rotation xx',
                      *e['rotational plateau (mean, error)']['xx'], 'rotational MSD, xx')
    i = read('delong2015/results/icosahedron.json')
    e = i['exact']
    height = e['gravitational height']/0.5
    yield ('section IV.4', 'icosahedron, gravitational height/a_I', '0.96', f'{height:.5f}',
           *compared(printed('0.96'),
                     (height, 0), 'ours is exact; the paper says "about"'), quadrature)
    fixman, rfd = run(i, 'FixmanMidpoint'), run(i, 'RandomFiniteDifference')
    for r, key, what in ((fixman, 'h', 'height'), (fixman, 'theta', 'tilt'), (rfd, 'h', 'height'),
                         (rfd, 'theta', 'tilt')):
        yield distribution('Figure 6', r, key, what, True, why='an error of the time step, which '
                           'only a run of an hour resolves')
    coarse = run(i, 'RandomFiniteDifference', 0.04)
    yield distribution('Figure 6', coarse, 'h', 'height', True, why='an error of the time step')
    yield distribution('Figure 6', coarse, 'theta', 'tilt', True)
    for r in (fixman, rfd):
        yield plateau('Figure 7', r, 'perpendicular', 2*e['gravitational height']**2, 0,
                      'perpendicular MSD')
        for axis in ('xx', 'zz'):
            yield plateau('Figure 7', r, f'rotation {axis}',
                          *e['rotational plateau (mean, error)'][axis], f'rotational MSD, {axis}')
    b = read('delong2015/results/boomerang.json')
    bulk = b['bulk']
    yield ('section IV.5', 'boomerang, CoH from the cross point, μm', '1.08', f'{bulk["CoH"]:.4f}',
           *compared(printed('1.08'), (bulk['CoH'], 0)), 'one matrix')
    yield ('section IV.5', 'boomerang, CoM from the cross point, μm', '0.96', f'{bulk["CoM"]:.4f}',
           *compared(printed('0.96'), (bulk['CoM'], 0)), 'one matrix')
    sampled = ('ours agrees with an independent calculation, 0.22752(9) at g = 1; the paper\'s '
               'sampling of heights may be the cause')
    for g, row in b['table'].items():
        texts = [
            f'{value:.3f}' if k in (0, 1, 4) else f'{value:.3g}'
            for k, value in enumerate(b['paper: chi_2D, chi_2D/chi_3D, chi_theta, h_g, sphere'][g])
        ]
        chi = row['averages (mean, error)']['chi_2D CoH']
        ratio = row['chi_2D/chi_3D'], chi[1]/bulk['chi_3D']
        yield 'Table 1', f'χ_2D, g = {g}, μm²/s', texts[0], brackets(
            *chi), *compared(printed(texts[0]), chi, sampled if g == '1' else 'as at g = 1'), poses
        yield 'Table 1', f'χ_2D/χ_3D, g = {g}', texts[1], brackets(
            *ratio), *compared(printed(texts[1]), ratio, 'as χ_2D'), poses
        theta = row['averages (mean, error)']['chi_theta where sine > cut-off, else 0']
        yield (
            'Table 1', f'χ_θ, g = {g}, rad²/s', texts[2],
            f'{brackets(*theta)} without the poses whose bisector is within asin {b["cut-off"]:g} '
            f'of the vertical', '–',
            'not reached: the average that the paper defines diverges logarithmically', poses)
        yield ('Table 1', f'h_g of a tip, g = {g}, μm', texts[3], f'{row["h_g of a tip"]:.4f}',
               *compared(printed(texts[3]), (row['h_g of a tip'], 0), 'ours is exact'), quadrature)
        yield 'Table 1', f'sphere, ratio of mobilities, g = {g}', texts[
            4], f'{row["sphere at h_g"]:.4f}', *compared(printed(
                texts[4]), (row['sphere at h_g'], 0), 'a consequence of h_g'), quadrature
    for g in (1, 20):
        for scheme in ('RandomFiniteDifference', 'FixmanMidpoint'):
            r = run(b, scheme, g=g)
            chi = b['table'][str(g)]['averages (mean, error)']['chi_2D CoH']
            late = r['late_slopes']['parallel CoH']
            yield ('Figure 8',
                   f'parallel MSD of the CoH, g = {g}: half the slope from 5 s on, μm²/s, '
                   f'{scheme}', f'linear with χ_2D (ours: {brackets(*chi)})', brackets(*late),
                   *compared(chi, late), lengthOf(r, ' s'))
            row = plateau('Figure 8', r, 'perpendicular tip',
                          2*b['table'][str(g)]['h_g of a tip']**2, 0,
                          f'perpendicular MSD of a tip, g = {g}')
            # Heights relax in about 4 D/v^2 (boomerang.py): 55 s at g = 1.
            yield row if g == 20 else (
                *row[:4], '–', 'not reached: heights relax in 55 s, and the longest lag is 30 s',
                row[6])
    for scheme in ('RandomFiniteDifference', 'FixmanMidpoint'):
        r = run(b, scheme, g=20)
        m = r['msd']['planar angle']
        k = next(k for k, lag in enumerate(m['lag']) if lag >= 1)
        first, later = ((m['mean'][j]/m['lag'][j], m['error'][j]/m['lag'][j]) for j in (0, k))
        yield ('Figure 9', f'planar angle, g = 20: MSD over lag, rad²/s, {scheme}',
               f'linear (ours at {m["lag"][0]:.2g} s: {brackets(*first)})',
               f'{brackets(*later)} at {m["lag"][k]:.2g} s', *compared(first, later),
               lengthOf(r, ' s'))


# ---- Westwood 2022 -------------------------------------------------------------------------------
def boomerangSteps():
    data = read('westwood2022/results/boomerang_steps.json')
    for key, where, what in (('h', 'Figure 4', 'height'), ('theta', 'Figure 5', 'tilt')):
        for scheme, name in (('TrapezoidalSlip', 'T-S'), ('DriftCorrectorFD', 'gDC-FD'),
                             ('DriftCorrectorRFD', 'gDC-RFD')):
            for step in (0.1, 0.2, 0.3):
                r = run(data, scheme, step)
                h = r['histograms'][key]
                share = r['time_of_all_replicas']/data['paper']['time_of_all_replicas']
                seen = h['significance'] < AGREES_ABOVE
                verdict = (
                    f'not reached: no error is visible above the noise of {share:.2g} of the '
                    'paper\'s length')
                if seen:
                    larger = run(data, scheme, round(step + 0.1, 1)) if step < 0.3 else None
                    falls = larger is None or h['L2'] < larger['histograms'][key]['L2']
                    verdict = ('disagrees' if not falls else 'agrees: an error is visible' +
                               (', smaller than at the next larger step' if larger else ''))
                yield (where, f'L2 error of the {what}, {name}, step {step:g} τ',
                       'falls with the step (figure)',
                       f'{h["L2"]:.1e}, of which {h["L2_of_noise"]:.1e} is noise; p = '
                       f'{h["significance"]:.2g}', '–', verdict, lengthOf(r, ' τ'))
    r, exact = run(data, 'DriftCorrectorRFD', 0.3), run(data, 'DriftCorrectorFD', 0.3)
    yield ('section 6.2', 'at 0.3 τ gDC-RFD has larger errors than gDC-FD', 'stated',
           ', '.join(f'⟨h⟩/a {brackets(x["means"]["h"]["mean"], x["means"]["h"]["error"])}'
                     for x in (r, exact)) + f' (exact {r["means"]["h"]["exact"]:.4f})',
           *(lambda z: (f'{z:+.1f}', 'not reached: the difference is below the noise'
                        if abs(z) < AGREES_BELOW else 'agrees'))(
                            (r['means']['h']['mean'] - exact['means']['h']['mean'])/
                            math.hypot(r['means']['h']['error'], exact['means']['h']['error'])),
           lengthOf(r, ' τ'))


def maxima(found, fromBin=0, reach=3):
    """Middles and densities of the bins that no bin exceeds among so many on either side."""
    edges, p = np.array(found['edges']), np.array(found['P'])
    density, middle = p/np.diff(edges), (edges[1:] + edges[:-1])/2
    return [(middle[k], density[k]) for k in range(max(1, fromBin),
                                                   len(p) - 1)
            if density[k] > 0 and density[k] == density[max(0, k - reach):k + reach + 1].max()]


def rods():
    data = read('westwood2022/results/rods.json')
    scenes = {round(1/s['width_over_L']): s for s in data['scenes'] if s['cutoff'] == 6.0}
    for width, s in scenes.items():
        dynamics = s['dynamics'][0]
        length = (f'{dynamics["runs"]} × {np.mean(dynamics["time_of_a_run_over_tau"]):.2g} τ, '
                  f'{s["rods"]} of {s["rods_of_paper"]} rods')
        for key, where, what in (('y', 'Figure 8', 'height'), ('theta', 'Figure 9', 'angle')):
            found = dynamics[key]['against_monte_carlo']
            yield (where, f'distribution of the {what}, L/{width}: dynamics against Monte Carlo',
                   'good agreement', f'{found["bins"]} bins, mean z² {found["mean_z2"]:.2f}',
                   f'largest of a bin: {found["largest_z"]:.1f}',
                   'agrees' if found['largest_z'] < AGREES_BELOW else 'disagrees',
                   length + '; the paper\'s runs are 50/3 τ')
    length = {
        width:
        f'Monte Carlo: {s["monte_carlo"]["systems"]} systems, {s["monte_carlo"]["sweeps"]} sweeps'
        for width, s in scenes.items()
    }
    first = {
        width: sorted(maxima(s['monte_carlo']['y']), key=lambda m: -m[1])
        for width, s in scenes.items()
    }

    def fromWall(width, k=0):
        return scenes[width]['width']/2 - first[width][k][0], first[width][k][1]/2

    def middle(width):
        found = scenes[width]['monte_carlo']['y']
        return found['P'][0]/(found['edges'][1] - found['edges'][0])/2

    yield (
        'Figure 8', 'L/8: two layers and a smaller peak in the middle', 'stated',
        f'{fromWall(8)[1]:.2f}/a at {fromWall(8)[0]:.1f} a from a wall, {middle(8):.2f}/a in the '
        f'middle', '–',
        'agrees' if fromWall(8)[1] > middle(8) > scenes[8]['monte_carlo']['y']['P'][3]/
        scenes[8]['monte_carlo']['y']['edges'][1]/2 else 'disagrees', length[8])
    yield (
        'Figure 8', 'L/4: the middle peak is more pronounced', 'stated',
        f'{middle(4):.2f}/a in the middle, {fromWall(4)[1]:.2f}/a at {fromWall(4)[0]:.1f} a from a '
        f'wall', '–',
        'agrees' if middle(4)/fromWall(4)[1] > middle(8)/fromWall(8)[1] else 'disagrees', length[4])
    peaks = sorted(first[2], key=lambda m: -m[0])[:3]
    values = [density/2 for _, density in peaks]
    yield ('Figure 8', 'L/2: lower peaks near the walls, a series that decreases inwards', 'stated',
           ', '.join(
               f'{density/2:.3f}/a at {scenes[2]["width"]/2 - y:.1f} a'
               for y, density in peaks), '–', 'agrees' if values == sorted(values, reverse=True)
           and values[0] < fromWall(4)[1] else 'disagrees', length[2])
    for width, published, wanted in ((8, 'second maximum just below π/8 = 0.39',
                                      lambda x: 0.25 < x < np.pi/8),
                                     (4, 'small second maximum at a larger angle',
                                      lambda x: x > np.pi/8)):
        found = [m for m in maxima(scenes[width]['monte_carlo']['theta'], 3) if 0.2 < m[0] < 0.9]
        place = max(found, key=lambda m: m[1])[0]
        yield ('Figure 9', f'L/{width}: θ', published,
               f'second maximum at {place:.2f} (bins of 0.035)', '–',
               'agrees' if wanted(place) else 'disagrees', length[width])
    theta = scenes[2]['monte_carlo']['theta']
    density, error = (np.array(theta[key])/np.diff(theta['edges']) for key in ('P', 'error'))
    z = max((density[k] - density[:k].min())/np.hypot(error[k], error[:k][density[:k].argmin()])
            for k in range(6, 36))
    yield ('Figure 9', 'L/2: no second maximum of θ', 'stated',
           'no rise beyond the errors of the bins' if z < AGREES_BELOW else 'a rise',
           f'largest rise: {z:.1f}', 'agrees' if z < AGREES_BELOW else 'disagrees', length[2])


def hedgehogs():
    rows = [r for r in read('westwood2022/results/hedgehogs.json')['runs'] if r['bodies'] == 64]
    length = (f'64 of 1177 hedgehogs, {rows[0]["time_over_tau"]:g} τ each; the paper\'s runs are '
              f'12 to 50 τ')
    for potential in ('repel-attract', 'repel-attract-repel'):
        mine = sorted((r for r in rows if r['potential'] == potential),
                      key=lambda r: r['bare_shear_rate'])
        low, high = mine[0], mine[-1]
        z = (low['ratio'][0] - high['ratio'][0])/math.hypot(low['ratio'][1], high['ratio'][1])
        yield ('Figure 11, top', f'{potential}: rapid thinning at low shear rates', 'stated',
               f'η_eff/η {brackets(*low["ratio"])} at {low["shear_rate"][0]:.2f}/τ, '
               f'{brackets(*high["ratio"])} at {high["shear_rate"][0]:.0f}/τ',
               f'{z:+.1f} between the two', 'agrees' if z > AGREES_BELOW else 'disagrees', length)
    mine = sorted((r for r in rows if r['potential'] == 'repel-attract-repel'),
                  key=lambda r: r['shear_rate'][0])
    rises = max((b['ratio'][0] - a['ratio'][0])/math.hypot(a['ratio'][1], b['ratio'][1])
                for a, b in zip(mine[1:], mine[2:]))
    yield ('Figure 11, top', 'repel-attract-repel: no thickening', 'stated',
           ', '.join(brackets(*r['ratio']) for r in mine[-3:]) + ' at the three highest rates',
           f'largest rise: {rises:+.1f}', 'agrees' if rises < AGREES_BELOW else 'disagrees', length)
    mine = sorted((r for r in rows if r['potential'] == 'repel-attract'),
                  key=lambda r: r['bare_shear_rate'])

    def peak(r):
        k = max((k for k, x in enumerate(r['r']) if 6 < x < 11), key=lambda k: r['g'][k])
        return r['r'][k], r['g'][k], r['g_error'][k]

    low, high = peak(mine[1]), peak(mine[-1])
    yield ('Figure 11, bottom', 'repel-attract: g(r) has a peak at 8 to 10 a at the smallest f0',
           'stated', f'{brackets(*low[1:])} at {low[0]:.1f} a for '
           f'f0/(kη) = {mine[1]["bare_shear_rate"]:g}/τ', '–',
           'agrees' if 8 <= low[0] <= 10 else 'disagrees', length)
    yield ('Figure 11, bottom', 'repel-attract: the peak diminishes as f0 grows', 'stated',
           f'{brackets(*high[1:])} at {high[0]:.1f} a for {mine[-1]["bare_shear_rate"]:g}/τ',
           f'{(high[1] - low[1])/math.hypot(high[2], low[2]):+.1f} from the row above',
           'agrees' if high[1] < low[1] else 'disagrees', length)
    yield ('Figure 11', 'the numbers of the figure', 'a figure; neither numbers nor f0 are given',
           '–', '–', 'not reached: there is nothing to compare with', '–')


def westwood2022():
    yield from boomerangSteps()
    yield from rods()
    yield from hedgehogs()


# ---- The page ------------------------------------------------------------------------------------
PAPERS = (
    ('davidchack2015', davidchack2015, 'Davidchack, Ouldridge, Tretyakov 2015',
     'New Langevin and gradient thermostats for rigid body dynamics, J. Chem. Phys. 142, 144114',
     'The rows are for TIP4P water, section VI: Table 1, Figures 1 to 4, limits of stability. '
     'Published errors are the paper\'s 95 % intervals divided by 1.96.'),
    ('davidchack2017', davidchack2017, 'Davidchack, Ouldridge, Tretyakov 2017',
     'Geometric integrator for Langevin systems with quaternion-based rotational degrees of '
     'freedom and hydrodynamic interactions, J. Chem. Phys. 147, 224103',
     'The rows are for Tables S1 to S3 and Figures 2 to 5, 7, 8, S1, S2; Figures 1 and 6 are '
     'drawings. The columns "th" of Table S1 are series, which need no run. We take the errors of '
     'Table S2 as standard errors, since the paper does not define them.'),
    ('delong2015', delong2015, 'Delong, Balboa Usabiaga, Donev 2015',
     'Brownian dynamics of confined rigid bodies, J. Chem. Phys. 143, 144107',
     'The rows are for Figures 3 to 9 and Table 1; Figures 1 and 2 are drawings. For numbers '
     'printed without errors, only the rounding counts as an error; the error of the paper\'s '
     'sampling is unknown.'),
    ('westwood2022', westwood2022, 'Westwood, Delmotte, Keaveny 2022',
     'A generalised drift-correcting time integration scheme for Brownian suspensions of rigid '
     'particles with arbitrary shape, J. Comput. Phys. 467, 111437',
     'The rows are for Figures 4, 5, 8, 9, 11; Figures 1 to 3, 6, 7, 10 are drawings. The '
     'paper\'s text gives no numbers for its results, so the rows compare its statements in words.'
     ),
)
STUDIES = (('accuracy/water', 'the cost of accuracy for TIP4P-Ew water'),
           ('accuracy/overdamped', 'the bias and the cost of schemes for the overdamped limit'),
           ('accuracy/grid', 'the error and the cost of a grid at each tolerance'),
           ('accuracy/ladder', 'the error and the cost of models of the fluid'),
           ('accuracy/arrays', 'models of the fluid in dense arrays, compared with exact numbers'),
           ('accuracy/viscosity', 'the effective viscosity where its value is known'),
           ('accuracy/suspensions',
            'random hard spheres at short times, compared with published fits'),
           ('accuracy/energy', 'energy conservation without friction'),
           ('accuracy/density',
            'the density under a barostat'), ('bodies', 'equilibria of bodies with joints'),
           ('confined', 'suspensions above a wall and between walls, periodic along them'),
           ('sheared', 'suspensions in shear, rollers and monolayers, settling spheres'))
TOP = '''# Validation: the papers\u2019 numbers and ours

This page compares each published number of four papers with the number that this plugin computes.
Each paper has a folder with the scripts, their results, and a page that describes the runs and
their outcome. Errors in brackets are one standard error. A difference is our number minus the
paper\u2019s, divided by the standard error of this difference. If its magnitude is below {below:g},
the number **agrees**. A distribution agrees with the exact one if the probability of so large a
difference by chance is above {above:g}. The verdict *not reached* comes with its reason.
'''
#: Why rows disagree, by a piece of their verdicts; the others are of heights above a wall.
ELECTROSTATICS, TIME_STEP = 'truncation of its electrostatics', 'an error of the time step'
WHY = '''
Of the {all} rows that disagree, {water} are averages of water; the paper gives neither the
screening nor the truncation of its electrostatics. In {steps} rows the scheme has an error of its
time step. The other {heights} are heights above a wall and quantities that depend on them; there
our numbers are exact or agree with an independent calculation.
'''
RUNS = '''
## Making the runs again
Each page gives the commands of its runs. All scripts that make runs use
[openmmrigidhi.ensemble.tasks](../docs/ensembles.md#tasks-of-your-own). They have the options
`--jobs N`, for N runs at a time, and `--cluster ADDRESS`, for a scheduler of dask.distributed. Runs
are independent. The script\u2019s seed and the position of a run in the script determine the seed
of the run. Each run keeps its state in its own directory below `--work` (by default `work` in the
folder of `--output`, which git ignores). The same command continues an interrupted run; `--fresh`
begins anew. Timed runs take turns in one process (`accuracy/grid`, speeds of the other studies of
accuracy). Workers on a cluster must find the scripts: put `validation/common` and the
paper\u2019s folder into `PYTHONPATH`. The folder `common/` has the code that the scripts of several
papers share.

Git has tables (JSON, CSV) and a picture or two for each experiment. The same commands make states,
raw series, pages with embedded pictures and animations again. `verdict.py` writes this page from
the JSONs of the papers\u2019 folders: edit `verdict.py`, not the page.

## Studies of our own
These studies belong to no paper; [the documentation](../docs) quotes their results:

| study | what |
|---|---|
'''


def _why(verdicts):
    """A paragraph about the rows that disagree."""
    water, steps = (sum(reason in each for each in verdicts)
                    for reason in (ELECTROSTATICS, TIME_STEP))
    return WHY.format(all=len(verdicts), water=water, steps=steps,
                      heights=len(verdicts) - water - steps)


def page():
    """The text of README.md."""
    counts, sections, wrong = [], [], []
    for folder, rows, name, title, about in PAPERS:
        # Rows come with the verdict before the length.
        rows = [(*row[:5], row[6], row[5]) if row[5].startswith(
            ('agrees', 'disagrees', 'not reached')) else row for row in rows()]
        kinds = [
            next(kind for kind in ('agrees', 'disagrees', 'not reached') if row[6].startswith(kind))
            for row in rows
        ]
        wrong += [row[6] for row in rows if row[6].startswith('disagrees')]
        anchor = name.lower().replace(',', '').replace(' ', '-')
        counts.append(f'| [{name}](#{anchor}) | {len(rows)} | {kinds.count("agrees")} | '
                      f'{kinds.count("disagrees")} | {kinds.count("not reached")} |')
        sections.append('\n'.join([
            f'\n## {name}',
            f'*{title}*. [{folder}]({folder}/README.md) describes the runs. {about}', '',
            *table(rows)
        ]))
    text = TOP.format(
        below=AGREES_BELOW, above=AGREES_ABOVE
    ) + '\n| paper | rows | agree | disagree | not reached |\n|---|---|---|---|---|\n' + '\n'.join(
        counts) + '\n' + _why(wrong) + RUNS
    text += '\n'.join(f'| [{pathlib.Path(folder).name}]({folder}/README.md) | {what} |'
                      for folder, what in STUDIES) + '\n'
    return format_text(text + '\n'.join(sections))


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--print', action='store_true', help='instead of writing it')
    if parser.parse_args().print:
        print(page(), end='')
    else:
        (HERE/'README.md').write_text(page())


if __name__ == '__main__':
    main()
