#!/usr/bin/python3
"""Products with the Rotne-Prager-Yamakawa mobility, beside a plain loop over pairs.

The plain loop is in PlainPairs.h. Both run in turns in one process, in unbounded fluid and above a
wall, for blobs and for spheres with torque, with one column and two, with one thread and two, for
each instruction set. The smallest CPU time of several interleaved repetitions counts: on a busy
machine the clock also counts what other processes compute. Two threads' CPU time is halved, as if
nobody else had used the machine.

    PYTHONPATH=build/python /usr/bin/python3 benchmarks/products.py
"""
import argparse
import json
import pathlib
import subprocess
import tempfile

import openmmrigidhi

from common import RESULTS, describeMachine, save

GOAL = 0.8


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--repetitions', type=int, default=7)
    parser.add_argument('--only', default='',
                        help='a regular expression for names of scenes, as "Blobs_AVX2/n:1000/"')
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    arguments = parser.parse_args()
    program = pathlib.Path(
        openmmrigidhi.__file__).parents[2]/'benchmarks'/'BenchmarkRotnePragerYamakawa'
    if not program.exists():
        raise SystemExit(
            f'{program.name} was not built: configure with -DRIGIDHI_BUILD_BENCHMARKS=ON')
    machine = describeMachine()
    with tempfile.TemporaryDirectory() as folder:
        report = pathlib.Path(folder)/'report.json'
        subprocess.run([
            str(program), f'--benchmark_filter=^beside/.*{arguments.only}',
            f'--benchmark_out={report}', '--benchmark_out_format=json',
            f'--benchmark_repetitions={arguments.repetitions}',
            '--benchmark_enable_random_interleaving=true', '--benchmark_min_time=0.02'
        ], check=True, stdout=subprocess.DEVNULL)
        content = json.loads(report.read_text())
    seconds = {}
    for run in content['benchmarks']:
        if run['run_type'] != 'iteration':
            continue
        _, function, scene, *settings = run['run_name'].split('/')
        settings = {
            key: int(value)
            for key, value in (setting.split(':') for setting in settings if ':' in setting)
        }
        kind, instructions = scene.split('_')
        key = (kind, instructions, settings['n'], settings['columns'], settings['threads'])
        seconds.setdefault(key, {}).setdefault(function,
                                               []).append(run['cpu_time']/settings['threads'])
    rows = []
    for (kind, instructions, n, columns, threads), of in sorted(seconds.items()):
        plain, ours, rough = (min(of[function])
                              for function in ('plainProduct', 'product', 'roughProduct'))
        rows.append({
            'kind': kind,
            'instructions': instructions,
            'n': n,
            'columns': columns,
            'threads': threads,
            'plain_ms': round(plain, 4),
            'ours_ms': round(ours, 4),
            'rough_ms': round(rough, 4),
            'rate_over_plain': round(plain/ours, 3)
        })
        print(f'{kind:14} {instructions:5} n = {n:6}, {columns} columns, {threads} threads: plain '
              f'{plain:8.3f} ms, ours {ours:8.3f} ms, '
              f'rough {rough:8.3f} ms, rate over plain {plain/ours:.2f}')
    print(
        f'Least rate over the plain loop: {min(row["rate_over_plain"] for row in rows):.2f}, goal '
        f'{GOAL}')
    save(
        arguments.output, 'products.json', machine, {
            'unit': 'ms of CPU time over threads, smallest of repetitions',
            'repetitions': arguments.repetitions,
            'goal_of_rate': GOAL,
            'rows': rows
        })


if __name__ == '__main__':
    main()
