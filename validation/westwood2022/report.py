#!/usr/bin/env python3
"""The table of the boomerang in README.md, from the JSON in results/ (printed as Markdown).

rods.py and hedgehogs.py print their tables themselves (--report).
"""
import pathlib
import sys

HERE = pathlib.Path(__file__).resolve().parent
sys.path.append(str(HERE.parent/'common'))
import runs  # noqa: E402
from boomerang_steps import SCHEMES  # noqa: E402
from recording import brackets, printTables  # noqa: E402


def steps(data):
    yield ('| scheme | step/τ | ⟨h⟩/a (exact ' +
           format(data['runs'][0]['means']['h']['exact'], '.4f') + ') | ⟨cos²θ⟩ (exact ' +
           format(data['runs'][0]['means']['cos²θ']['exact'], '.4f') +
           ') | L2 of P(h) | of that noise | L2 of P(θ) | of that noise | '
           'redone steps | restarted | time of all/paper\'s | μs a step and body | reached |')
    yield '|---'*13 + '|'
    for r in sorted(data['runs'], key=lambda r: (SCHEMES.index(r['scheme']), r['step'])):
        m, h, t = r['means'], r['histograms']['h'], r['histograms']['theta']
        yield (f'| {r["scheme"]} | {r["step"]:g} | {brackets(m["h"]["mean"], m["h"]["error"])} | '
               f'{brackets(m["cos²θ"]["mean"], m["cos²θ"]["error"])} | '
               f'{h["L2"]:.2e} | {h["L2_of_noise"]:.1e} | {t["L2"]:.2e} | {t["L2_of_noise"]:.1e} | '
               f'{r["redone_per_step_and_body"]:.1e} | {r["restarted"]} | '
               f'{r["time_of_all_replicas"]/data["paper"]["time_of_all_replicas"]:.2f} | '
               f'{r["us_per_step_and_body"]:.0f} | {runs.criterion(r)} |')


if __name__ == '__main__':
    printTables(__doc__, HERE/'results', (('boomerang_steps.json', steps),))
