#!/usr/bin/env python3
"""The tables of README.md, from the JSONs in results/ (printed as Markdown)."""
from spheres import RESULTS, brackets, printTables


def lennardJones(data):
    yield ('| kT | quantity | A0 here | A0 paper | exact | E_A here | E_A paper | χ²/dof | '
           'order p of the error, fitted |')
    yield '|---|---|---|---|---|---|---|---|---|'
    isPeriodic = any(r['model'] == 'SD periodic' for r in data['runs'])
    for key, entry in data['analysis'].items():
        kT = key.split('=')[1]
        fits = entry.get('SD periodic', {'fit': {}}) if isPeriodic else entry
        for name, fit in fits['fit'].items():
            paper = fit['paper']
            exact = kT if name != 'U/N' else brackets(
                entry['U/N_at_h_0.005_to_0.02']['Monte_Carlo'],
                entry['U/N_at_h_0.005_to_0.02']['Monte_Carlo_error'])
            order = fits['order'].get(name)
            yield (f'| {kT} | {name} | {brackets(fit["A0"], fit["A0_error"])} | '
                   f'{brackets(paper["A0"], paper["A0_error"])} | {exact} | '
                   f'{brackets(fit["E_A"], fit["E_A_error"])} | '
                   f'{brackets(paper["E_A"], paper["E_A_error"])} | {fit["chi2_per_dof"]:.1f} | '
                   f'{brackets(order["order"], order["error"]) if order else "–"} |')
    yield ''
    yield ('| kT | model | h | U/N | z to Monte Carlo + paper\'s E_A h² | '
           'z of U/N to free draining, same h | largest abs z of the temperatures, same h |')
    yield '|---|---|---|---|---|---|---|'
    for r in data['runs']:
        entry = data['analysis'].get(f'kT={r["kT"]:g}')
        if not entry:
            continue
        pool, constant = entry['U/N_at_h_0.005_to_0.02'], entry['fit']['U/N']['paper']['E_A']
        z = (r['mean']['U/N'] - pool['Monte_Carlo'] -
             constant*r['h']**2)/(r['error']['U/N']**2 + pool['Monte_Carlo_error']**2)**0.5
        pair = next((m for m in entry['models'] if m['h'] == r['h'] and m['model'] == r['model']),
                    None)
        yield (f'| {r["kT"]:g} | {r["model"]} | {r["h"]:g} | '
               f'{brackets(r["mean"]["U/N"], r["error"]["U/N"])} | {z:+.1f} | ' +
               (f'{pair["z U/N"]:+.1f} | '
                f'{max(abs(v) for k, v in pair.items() if k.startswith("z kT")):.1f} |'
                if pair else ' | |'))


def sedimenting(data):
    for key, column in (('F/U', 0), ('omega/U', 2)):
        names = list(data['models'])
        yield f'| l/a | {key} exact | paper (num) | ' + ' | '.join(names) + ' |'
        yield '|---'*(3 + len(names)) + '|'
        for s, exact in data['exact'].items():
            yield (f'| {s} | {exact[key]:.9f} | {exact["paper"][column]/exact[key] - 1:+.1e} | ' +
                   ' | '.join(f'{data["models"][n][s]["relative_error"][key]:+.1e}' if s in
                              data['models'][n] else '–' for n in names) + ' |')
        yield ''


def trapped(data):
    if 'runs' not in data:  # biases of steps
        return
    yield ('| set | R | kT | h | bias of h | time | largest standard error | largest difference '
           '(function) | rms z: least, median, greatest of ten | ⟨x²⟩kt/kT | ⟨χ²⟩kr/kT |')
    yield '|---'*11 + '|'
    for r in data['runs']:
        worst = max(r['largest_difference'], key=r['largest_difference'].get)
        z, v = sorted(r['rms_z'].values()), r['variance_over_kT_by_K']
        yield (
            f'| {r["set"].split()[0]} | {r["R"]:g} | {r["kT"]:g} | {r["h"]:g} | '
            f'{r["bias_of_this_step"]:.4f} | {r["time"]:.3g} | {r["largest_standard_error"]:.4f} | '
            f'{r["largest_difference"][worst]:.4f} ({worst}) | {z[0]:.2f}, {z[len(z)//2]:.2f}, '
            f'{z[-1]:.2f} | {(v["x"] + v["z"])/2:.4f} | {(v["chiy"] + v["chiz"])/2:.4f} |')


def spread(values, digits, sign=''):
    """Mean of what several starts gave, and half the range if the digits show it."""
    half = (max(values) - min(values))/2
    return f'{sum(values)/len(values):{sign}.{digits}f}' + (f' ± {half:.{digits}f}'
                                                            if half >= 10**-digits else '')


def ring(data):
    yield ('| (f, τ), truncation | start | paper | here | period | orbital speed Ω | spin | '
           'smallest gap | independent (period, Ω, spin) |')
    yield '|---'*9 + '|'
    cases, states = {}, {}
    for r in data['rows']:
        case = r['f'], r['tau'], r['start']
        cases.setdefault(case, []).append(r)
        states.setdefault(case, {}).setdefault(r['state'], []).append(r)
    for case, rows in cases.items():
        for state, same in sorted(states[case].items(), key=lambda s: -len(s[1])):
            r = same[0]
            periods = [q['period'] for q in same if q['period'] is not None]
            independent = ['–' if v is None else str(v)
                           for v in r['independent']] if r.get('independent') else ['–']
            yield (f'| ({r["f"]:g}, {r["tau"]:g}), {r["truncation"]} | {r["start"]} | '
                   f'{r.get("paper", "")} | {state} ({len(same)} of {len(rows)}) | '
                   f'{spread(periods, 1) if periods else "–"} | '
                   f'{spread([q["orbital_speed"] for q in same], 4, "+")} | '
                   f'{spread([q["spin"] for q in same], 4, "+")} | '
                   f'{spread([q["smallest_gap"] for q in same], 3)} | {", ".join(independent)} |')


def diagram(data):
    """The states that the starts at each point led to, where they differ or no state was found."""
    points = {}
    for r in data['rows']:
        points.setdefault((r['f'], r['tau']), []).append(r)
    counts = {}
    for r in data['rows']:
        counts[r['state']] = counts.get(r['state'], 0) + 1
    alike = sum(len({r['state'] for r in rows}) == 1 for rows in points.values())
    yield (
        f'{len(data["rows"])} runs at {len(points)} points, at {alike} of which all starts agree: '
        + ', '.join(f'{name} {n}' for name, n in sorted(counts.items(), key=lambda c: -c[1])))
    for (f, tau), rows in sorted(points.items()):
        names = [r['state'] for r in rows]
        if 'undecided' in names:
            last = max(r['settle'] + r['window'] for r in rows)
            yield f'- ({f:g}, {tau:g}): {", ".join(names)}; followed to t = {last:.0f}'


def noise(data):
    yield ('| start as | kT | nearer to | distance (rad) to it, to the other | '
           'mismatch after a shift by one | Ω | spin |')
    yield '|---'*7 + '|'
    for r in data['rows']:
        d = sorted(r['distances_to_noiseless'].values()) if r['kT'] else None
        yield (f'| ({r["f"]:g}, {r["tau"]:g}) | {r["kT"]:g} | {r["state"]} | '
               f'{f"{d[0]:.3f}, {d[1]:.3f}" if d else "–"} | '
               f'{"–" if r["name"] == "Fig 8(a)" else format(r["least_mismatch_by_one"], ".2f")} | '
               f'{r["orbital_speed"]:+.4f} | {r["spin"]:+.4f} |')


if __name__ == '__main__':
    printTables(__doc__, RESULTS,
                (('lennard_jones*.json', lennardJones), ('sedimenting_spheres.json', sedimenting),
                 ('trapped_spheres*.json', trapped), ('ring_states_*.json', ring),
                 ('ring_noise_*.json', noise), ('ring_diagram_*.json', diagram)))
