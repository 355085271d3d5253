#!/usr/bin/python3
"""Run all benchmarks in one go, keep their results, and write the tables of the pages.

    make benchmark

The C++ programs are in the build directory from which openmmrigidhi was imported. On a machine with
AVX-512 some parts run a second time with AVX2; their results are in results/avx2. Each part's
seconds, and the load before and after, are in results/run.json. Nothing else should use the
machine meanwhile. The tables of README.md and of docs/ are those of page.py.
"""
import argparse
import json
import os
import pathlib
import shlex
import subprocess
import sys
import tempfile
import time

import tqdm

import instructions
import openmmrigidhi
from common import RESULTS, describeMachine, save

HERE = pathlib.Path(__file__).parent
REPETITIONS = 3
#: Of each program: name of the JSON, and options.
PROGRAMS = {
    'BenchmarkFreeBodies': ('free_bodies', ''),
    'BenchmarkRandomNumbers': ('random_numbers', ''),
    'BenchmarkPoseFit': ('pose_fit', ''),
    'BenchmarkRotnePragerYamakawa': ('rotne_prager_yamakawa', '--filter ^(matrix|scalar)'),
    'BenchmarkGridFluid': ('grid_fluid', ''),
    'BenchmarkSlipChannel': ('slip_channel', ''),
    'BenchmarkFastSum': ('fast_sum',
                         '--filter ^(product|pairs|placement)/(Blobs/n:(10000|30000|100000)|'
                         '(Spheres|BlobsAtWall|SpheresAtWall)/n:30000)/digits:[036]/'),
    # Alone, since the rest of 103,823 particles takes long; others find the best splitting.
    'BenchmarkSplitEwald': (
        'split_ewald', '--filter ^(product|forceCoupling)/|^(sixTransforms|roughProduct|'
        'productWithTorques|noise|noiseByOneRoot|pairs|makingPairs|makingWeights)/(1000|10648)/')
}
#: All parts in the order of their benefit, if a run is stopped: programs, and scripts with options.
#: Left out are the report of a GPU, one_body.py, which needs valgrind for its counts, and
#: two_builds.py, which needs a second build.
PARTS = """
platforms.py --molecules 512 --rounds 7
water_step.py
water_step.py --no-cm-motion-removal
water_step.py --threads 1
BenchmarkFreeBodies
overdamped.py
langevin_hi.py
effects.py --bodies 8
effects.py --bodies 27
effects.py --bodies 64 --rounds 9
effects.py --scene periodic --bodies 27
effects.py --scene periodic --bodies 216 --rounds 9
effects.py --scene periodic --bodies 1000 --rounds 5
products.py --repetitions 5
BenchmarkFastSum
BenchmarkRotnePragerYamakawa
BenchmarkRandomNumbers
BenchmarkPoseFit
BenchmarkGridFluid
BenchmarkSplitEwald
BenchmarkSlipChannel
lubricated_steps.py
rollers.py
planes.py
growth.py --limit 10
confined.py --limit 10
periodic.py
grid_steps.py
channel_steps.py
split_ewald_steps.py
auto_choice.py
lammps_compare.py
multiblob_compare.py
multiblob_solve.py --blobs 12 42 --rounds 3
ensemble.py
"""
#: Once more with AVX2, where the machine has AVX-512.
AVX2_PARTS = """
water_step.py
BenchmarkFreeBodies
overdamped.py
langevin_hi.py
lubricated_steps.py --largest 2916
growth.py --limit 1 --largest 10000
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
            '--benchmark_report_aggregates_only=true', '--benchmark_min_time=0.2',
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


def saveRun(output, machine, parts):
    save(
        output, 'run.json', machine, {
            'seconds': sum(each['seconds'] for each in parts),
            'ended': describeMachine()['date'],
            'parts': parts
        })


def refuseAnotherMachine(before, now):
    """One run is of one machine and one set of versions."""
    changed = [
        f'{name} was {before.get(name)} and is {now[name]}' for name in now
        if not name.startswith('load_average') and name != 'date' and before.get(name) != now[name]
    ]
    if changed:
        sys.exit('run.py: --resume: the run began elsewhere: ' + ', '.join(changed) +
                 ': begin anew, without --resume')


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--repetitions', type=int, default=REPETITIONS)
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    parser.add_argument('--lmp', default='lmp', help='LAMMPS with the packages ASPHERE and CG-DNA')
    parser.add_argument('--code', type=pathlib.Path,
                        help='folder of RigidMultiblobsWall (needs python3-numba)')
    parser.add_argument('--only', nargs='+', metavar='PART',
                        help='only parts that begin so, as growth.py or BenchmarkPoseFit')
    parser.add_argument('--program', choices=PROGRAMS, help='run this program alone')
    parser.add_argument('--filter', help='run only the rows that match this regular expression')
    parser.add_argument('--resume', action='store_true',
                        help='go on with a run that was stopped, after the parts in run.json')
    parser.add_argument('--no-pages', action='store_true', help='leave the tables of pages alone')
    parser.add_argument('--avx2', action='store_true', help=instructions.HELP)
    arguments = parser.parse_args()
    directory = pathlib.Path(openmmrigidhi.__file__).parents[2]/'benchmarks'
    output = arguments.output.resolve()
    if arguments.program:
        name, options = PROGRAMS[arguments.program]
        only = arguments.filter or (shlex.split(options) or [None])[-1]
        runProgram(directory/arguments.program, arguments.repetitions, output, name, only)
        return

    machine = describeMachine()
    parts = [(part, False) for part in PARTS.split('\n')[1:-1]]
    if machine['avx512'] and not arguments.avx2:
        parts += [(part, True) for part in AVX2_PARTS.split('\n')[1:-1]]
    if arguments.only:
        parts = [(part, avx2) for part, avx2 in parts if part.startswith(tuple(arguments.only))]
    done = []
    if arguments.resume:
        before = json.loads((output/'run.json').read_text())
        refuseAnotherMachine(before['machine'], machine)
        machine, done = before['machine'], before['parts']
        finished = [(each['part'], each['avx2']) for each in done]
        parts = [each for each in parts if each not in finished]
    for part, avx2 in tqdm.tqdm(parts, desc='Parts'):
        tqdm.tqdm.write(part + (' (AVX2)' if avx2 else ''))
        script, *options = part.split()
        where = output/'avx2' if avx2 else output
        command = [sys.executable]
        if script in PROGRAMS:
            command += [
                HERE/'run.py', '--program', script, '--repetitions',
                str(arguments.repetitions)
            ]
        else:
            command += [HERE/script, *options]
        if script == 'lammps_compare.py':
            command += ['--lmp', arguments.lmp]
        if script.startswith('multiblob_') and arguments.code is not None:
            command += ['--code', arguments.code.resolve()]
        begin, load = time.monotonic(), os.getloadavg()[0]
        environment = dict(os.environ,
                           **(instructions.ENVIRONMENT if avx2 or arguments.avx2 else {}))
        status = subprocess.run([*command, '--output', where], cwd=HERE.parent,
                                env=environment).returncode
        done.append({
            'part': part,
            'avx2': avx2 or arguments.avx2,
            'seconds': round(time.monotonic() - begin),
            'load_averages': [round(load, 2), round(os.getloadavg()[0], 2)],
            'failed': status != 0
        })
        if not arguments.only:  # parts alone are no run
            saveRun(output, machine, done)
    if not arguments.only:
        saveRun(output, machine, done)
    for each in done:
        print(f'{each["seconds"]:6d} s  {each["part"]}' + (' (AVX2)' if each['avx2'] else ''))
    failed = [each['part'] for each in done if each['failed']]
    if not arguments.no_pages:
        import page
        page.write(output)
    if failed:
        raise SystemExit('Failed, the others have run: ' + '; '.join(failed))


if __name__ == '__main__':
    main()
