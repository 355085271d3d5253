#!/usr/bin/env python3
"""The tables of README.md, from the JSONs in results/ (printed as Markdown)."""
import pathlib
import sys

HERE = pathlib.Path(__file__).resolve().parent
sys.path.append(str(HERE.parent/'common'))
import runs  # noqa: E402
from recording import brackets, printTables  # noqa: E402


def distributions(data, label=None):
    names = list(data['runs'][0]['means'])
    yield f'| {label + " | " if label else ""}scheme | step | ' + ' | '.join(
        f'⟨{n}⟩ | exact | z' for n in names) + ' | redone steps | μs a step and body | reached |'
    yield '|---'*(5 + 3*len(names) + bool(label)) + '|'
    for r in data['runs']:
        cells = []
        for m in r['means'].values():
            cells.append(f'{brackets(m["mean"], m["error"])} | {m["exact"]:.5g} | '
                         f'{(m["mean"] - m["exact"])/m["error"]:+.1f}')
        yield (f'| {str(r[label]) + " | " if label else ""}{r["scheme"]} | {r["step"]:.3g} | ' +
               ' | '.join(cells) +
               f' | {r["redone_per_step_and_body"]:.1e} | {r["us_per_step_and_body"]:.0f} | '
               f'{runs.criterion(r)} |')


def firstSlope(r, name):
    m = r['msd'][name]
    return brackets(m['mean'][0]/m['lag'][0], m['error'][0]/m['lag'][0])


def slopes(data, rows, last):
    """Slopes of displacements from the first lag, and their expected values.

    rows are (label, name, cells).
    """
    entries = [r for r in data['runs'] if r['step'] == data['runs'][0]['step']]
    yield ''
    yield '| slope of the MSD at t = 0 | ' + ' | '.join(f'{r["scheme"]}, first lag'
                                                        for r in entries) + f' | {last} |'
    yield '|---'*(3 + len(entries)) + '|'
    for label, name, cells in rows:
        yield f'| {label} | ' + ' | '.join(firstSlope(r, name) for r in entries) + f' | {cells} |'


def tetramer(data):
    e, paper = data['exact'], data['paper']
    yield from distributions(data)
    yield ''
    yield (f'Quadrature: mean height {e["mean h"]:.5f}, gravitational height '
           f'{e["gravitational height"]:.5f} (paper: {paper["gravitational height"]}); '
           f'exp(−U/kT)/⟨μ⊥⟩(h) would have the mean {e["without drift"]["mean h"]:.3f}.')
    yield from slopes(data,
                      [(name, f'{name} parallel',
                        f'{brackets(*e["mobility averages (mean, error)"][f"slope {name}"])} | '
                        f'{paper[f"slope {name}"]}')
                       for name in ('centre', 'vertex')], '2 kT⟨Nxx+Nyy⟩ | paper')


def icosahedron(data):
    e = data['exact']
    yield from distributions(data)
    yield ''
    yield (f'Exact: mean height {e["mean h"]:.5f}, gravitational height '
           f'{e["gravitational height"]:.5f} (paper: {data["paper"]["gravitational height"]:.2f}); '
           f'exp(−U/kT)/μ⊥(h) has the mean {e["without drift"]["mean h"]:.4f}.')
    yield from slopes(
        data,
        [(name, name,
          f'{brackets(*e["slopes (mean, error)"][name])} | {e["slopes of the sphere"][name]:.4f}')
         for name in ('parallel', 'perpendicular', 'rotation xx', 'rotation zz')],
        'kT⟨N⟩, icosahedron | sphere (best known)')


def boomerang(data):
    bulk = data['bulk']
    yield (
        f'Bulk: CoH {bulk["CoH"]:.4f} μm and CoM {bulk["CoM"]:.4f} μm from the cross point, χ_3D = '
        f'{bulk["chi_3D"]:.5f} μm²/s; D about the CoM '
        f'{", ".join(f"{v:.5f}" for v in bulk["D about CoM: bisector, in plane, normal"])} μm²/s '
        f'and rotational '
        f'{", ".join(f"{v:.5f}" for v in bulk["D_rot: bisector, in plane, normal"])} rad²/s (along '
        f'the bisector, in the plane, normal).')
    yield ''
    yield ('| g | χ_2D (CoH) | CoM | cross point | tip | paper | χ_2D/χ_3D | paper | '
           'χ_θ of sine > 0.3 | poses left out | paper | h_g of a tip | paper | sphere | paper |')
    yield '|---'*15 + '|'
    for g, row in data['table'].items():
        paper = data['paper: chi_2D, chi_2D/chi_3D, chi_theta, h_g, sphere'][g]
        chi = {
            k[7:]: brackets(*v)
            for k, v in row['averages (mean, error)'].items() if k.startswith('chi_2D')
        }
        left = 1 - row['averages (mean, error)']['fraction above cut-off'][0]
        yield (
            f'| {g} | {chi["CoH"]} | {chi["CoM"]} | {chi["cross point"]} | {chi["tip"]} | '
            f'{paper[0]} | {row["chi_2D/chi_3D"]:.4f} | {paper[1]} | '
            f'{brackets(*row["averages (mean, error)"]["chi_theta where sine > cut-off, else 0"])} '
            f'| {100*left:.2f} % | {paper[2]} | {row["h_g of a tip"]:.4f} | {paper[3]} | '
            f'{row["sphere at h_g"]:.4f} | {paper[4]} |')
    yield ''
    yield from distributions(data, 'g')
    yield ''
    yield ('| g | scheme | half the slope, CoH: first lag | from 5 s on | ⟨χ_2D⟩ | '
           'tip: first lag | from 5 s | cross point: first lag | from 5 s |')
    yield '|---'*9 + '|'
    for r in data['runs']:
        late = {n: brackets(*v) if v else '–' for n, v in r['late_slopes'].items()}
        first = {
            n: brackets(r['msd'][n]['mean'][0]/r['msd'][n]['lag'][0]/4,
                        r['msd'][n]['error'][0]/r['msd'][n]['lag'][0]/4)
            for n in late
        }
        chi = data['table'][str(r['g'])]['averages (mean, error)']['chi_2D CoH']
        yield (f'| {r["g"]} | {r["scheme"]} | {first["parallel CoH"]} | {late["parallel CoH"]} | '
               f'{brackets(*chi)} | {first["parallel tip"]} | {late["parallel tip"]} | '
               f'{first["parallel cross point"]} | {late["parallel cross point"]} |')


if __name__ == '__main__':
    printTables(__doc__, HERE/'results',
                (('tetramer.json', tetramer), ('icosahedron.json', icosahedron),
                 ('boomerang.json', boomerang)))
