#!/usr/bin/python3
"""Run all benchmarks and keep their results.

    make benchmark

The C++ programs are in the build directory from which openmmrigidhi was imported.
"""
import argparse
import json
import pathlib
import subprocess
import sys
import tempfile
import time

import tqdm

import openmmrigidhi
from common import RESULTS, describeMachine, save

HERE = pathlib.Path(__file__).parent
PROGRAMS = {
    'BenchmarkFreeBodies': 'free_bodies',
    'BenchmarkRandomNumbers': 'random_numbers',
    'BenchmarkPoseFit': 'pose_fit',
    'BenchmarkRotnePragerYamakawa': 'rotne_prager_yamakawa',
    'BenchmarkGridFluid': 'grid_fluid',
    'BenchmarkSlipChannel': 'slip_channel',
    'BenchmarkFastSum': 'fast_sum',
    'BenchmarkSplitEwald': 'split_ewald'
}
#: In the order of their benefit, if a run is stopped. Left out are comparisons with other codes
#: that this repository cannot install (multiblob_compare.py, multiblob_solve.py), the report of a
#: GPU, one_body.py, which needs valgrind for its counts, and two_builds.py, which needs a second
#: build.
SCRIPTS = """
water_step.py
water_step.py --no-cm-motion-removal
water_step.py --threads 1
platforms.py
lammps_compare.py
langevin_hi.py
overdamped.py
effects.py
effects.py --scene periodic
products.py
periodic.py
grid_steps.py
channel_steps.py
split_ewald_steps.py
auto_choice.py
planes.py --page docs/how_cost_grows.md
lubricated_steps.py
rollers.py
confined.py --limit 10
growth.py --limit 10 --page docs/how_cost_grows.md
"""


def runProgram(program, repetitions, output, name, only=None):
    """Run a Google Benchmark program, or the part that a regular expression selects.

    Medians of times and of the counted quantities are kept, in ns.
    """
    machine = describeMachine()
    with tempfile.TemporaryDirectory() as folder:
        report = pathlib.Path(folder)/'report.json'
        subprocess.run([
            str(program), f'--benchmark_out={report}', '--benchmark_out_format=json',
            f'--benchmark_repetitions={repetitions}', '--benchmark_enable_random_interleaving=true',
            '--benchmark_report_aggregates_only=true',
            *([f'--benchmark_filter={only}'] if only else [])
        ], check=True)
        content = json.loads(report.read_text())
    rows = {}
    for run in content['benchmarks']:
        if run.get('aggregate_name') not in ('median', 'stddev'):
            continue
        key = run['run_name'] + (' ' + run['label'] if 'label' in run else '')
        values = {
            counter: 1e9*run[counter]
            for counter in run if counter.startswith(('time_per', 'own_time_per'))
        } or {
            'time': run['cpu_time']*{
                'ns': 1,
                'us': 1e3,
                'ms': 1e6
            }[run['time_unit']]
        }
        values.update(
            {counter: run[counter]
             for counter in ('error', 'megabytes') if counter in run})
        suffix = '' if run['aggregate_name'] == 'median' else ' (standard deviation)'
        rows.setdefault(key, {}).update(
            {counter + suffix: float(f'{value:.4g}')
             for counter, value in values.items()})
    save(output, name + '.json', machine, {
        'unit': 'ns',
        'repetitions': repetitions,
        'filter': only,
        'medians': rows
    })


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--repetitions', type=int, default=5)
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    parser.add_argument('--lmp', default='lmp', help='LAMMPS with the packages ASPHERE and CG-DNA')
    parser.add_argument('--only', choices=('programs', 'scripts'))
    parser.add_argument('--program', choices=PROGRAMS, help='run this program alone')
    parser.add_argument('--filter', help='run only the rows that match this regular expression')
    arguments = parser.parse_args()
    directory = pathlib.Path(openmmrigidhi.__file__).parents[2]/'benchmarks'
    seconds, failed = {}, []
    if arguments.only != 'scripts':
        chosen = [name for name in PROGRAMS if arguments.program in (None, name)]
        for program in tqdm.tqdm(chosen, desc='programs'):
            begin = time.monotonic()
            if not (directory/program).exists():
                raise SystemExit(
                    f'{program} was not built: configure with -DRIGIDHI_BUILD_BENCHMARKS=ON, as '
                    f'make benchmark does')
            runProgram(directory/program, arguments.repetitions, arguments.output,
                       PROGRAMS[program], arguments.filter)
            seconds[program] = round(time.monotonic() - begin)
    if arguments.only != 'programs' and not arguments.program:
        for called in tqdm.tqdm(SCRIPTS.split('\n')[1:-1], desc='scripts'):
            script, *options = called.split()
            begin = time.monotonic()
            if script == 'lammps_compare.py':
                options += ['--lmp', arguments.lmp]
            command = [
                sys.executable, HERE/script, *options, '--output',
                arguments.output.resolve()
            ]
            if subprocess.run(command, cwd=HERE.parent).returncode != 0:
                failed.append(called)
            seconds[called] = round(time.monotonic() - begin)
    print('\n'.join(f'{taken:6d} s  {name}' for name, taken in seconds.items()))
    if failed:
        raise SystemExit('Failed, the others have run: ' + '; '.join(failed))


if __name__ == '__main__':
    main()
