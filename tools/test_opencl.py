#!/usr/bin/env python3
"""Run the platform tests on OpenMM's OpenCL platform, in each precision, and write a summary.

`ctest -L full -R OpenCL` runs the same tests, each in a process of its own, where each compiles its
kernels again. Here a process has all tests of a file.

Example
-------
tools/test_opencl.py build --report tests/reports/opencl.txt
"""
import argparse
import os
import platform
import re
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import NamedTuple

from tqdm import tqdm

PRECISIONS = 'double', 'single', 'mixed'
#: Allocations are counted on the platforms whose steps do not copy to a device.
LEFT_OUT = {'TestOpenCLAllocations'}


class FileOfTests(NamedTuple):
    """The tests of one file, which are some of a program's."""
    name: str
    program: Path
    suites: str = '*'


class Run(NamedTuple):
    """What the tests of a file did in one precision."""
    name: str
    precision: str
    passed: int  # number of tests
    skipped: int  # by themselves, because their promise does not hold there
    failed: list
    seconds: float


def files_of(program):
    """The files whose tests a program has, in the list that CMake writes beside programs; a program
    that the list lacks is one file."""
    try:
        lines = (program.parent/'files.txt').read_text(encoding='utf-8').splitlines()
    except FileNotFoundError:
        lines = []
    found = [
        FileOfTests(name, program, suites) for name, whose, suites in map(str.split, lines)
        if whose == program.name
    ]
    return found or [FileOfTests(program.name, program)]


def runs(file, precision, cache, logs, timeout=None, quick=False):
    """Run the tests of one file in one precision.

    Parameters
    ----------
    file : FileOfTests
    precision : str
    cache : Path
        folder for compiled kernels
    logs : Path
        folder for the outputs
    timeout : float, optional
        seconds after which the process is ended, and has failed
    quick : bool
        whether to leave out the tests named Full...

    Returns
    -------
    Run
    """
    log = logs/f'{file.name}.{precision}.log'
    environment = dict(os.environ, RIGIDHI_TEST_PRECISION=precision, POCL_CACHE_DIR=str(cache))
    begin = time.monotonic()
    with open(log, 'w', encoding='utf-8') as output:
        try:
            left_out = '*.Long*:*.Full*' if quick else '*.Long*'
            code = subprocess.run([file.program, f'--gtest_filter={file.suites}-{left_out}'],
                                  env=environment, stdout=output, stderr=subprocess.STDOUT,
                                  check=False, timeout=timeout).returncode
        except subprocess.TimeoutExpired:
            code = f'none in {timeout:g} s'
    text = log.read_text(encoding='utf-8', errors='replace')
    found = re.search(r'^\[  PASSED  \] (\d+) test', text, re.MULTILINE)
    failed = sorted(set(re.findall(r'^\[  FAILED  \] (\w+(?:/\w+)?\.[\w/]+)', text, re.MULTILINE)))
    if code and not failed:
        failed = [f'the process as a whole, exit code {code}']
    skipped = re.search(r'^\[  SKIPPED \] (\d+) test', text, re.MULTILINE)
    return Run(file.name, precision,
               int(found[1]) if found else 0,
               int(skipped[1]) if skipped else 0, failed,
               time.monotonic() - begin)


def summary(options, names, results, seconds):
    """The text of the report.

    Parameters
    ----------
    options : argparse.Namespace
    names : list of str
        of the files that were asked for
    results : list of Run
        those that have ended
    seconds : float
        since the first began
    """
    lines = [
        'Platform tests on OpenMM\'s OpenCL platform (pocl: the processor is the device), '
        'made by tools/test_opencl.py',
        f'{time.strftime("%Y-%m-%d")}; commit {options.commit or "unknown"}; '
        f'{platform.machine()}, {os.cpu_count()} processors, {options.jobs} processes at once; '
        f'{seconds/60:.0f} minutes', ''
    ]
    if options.quick:
        lines[2:2] = ['Tests named Full... were left out.']
    for precision in options.precision:
        own = [each for each in results if each.precision == precision]
        lines.append(
            f'{precision}: {sum(each.passed for each in own)} tests of {len(own)} files passed, '
            f'{sum(each.skipped for each in own)} skipped, '
            f'{sum(len(each.failed) for each in own)} failed; '
            f'{len(names) - len(own)} files did not run')
        lines += [f'    {name}: {failed}' for name, _, _, _, tests, _ in own for failed in tests]
    lines += ['', f'{"file":<40}' + ''.join(f'{each + ", s":>12}' for each in options.precision)]
    for name in names:
        times = {each.precision: f'{each.seconds:.0f}' for each in results if each.name == name}
        lines.append(f'{name:<40}' + ''.join(f'{times.get(each, "-"):>12}'
                                             for each in options.precision))
    return '\n'.join(lines) + '\n'


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n', maxsplit=1)[0])
    parser.add_argument('build', type=Path, help='the build folder')
    parser.add_argument('--precision', nargs='+', choices=PRECISIONS, default=PRECISIONS)
    parser.add_argument('--jobs', type=int, default=2, help='processes at once')
    parser.add_argument('--only', nargs='+', default=[''],
                        help='parts of the names of the files to run, in this order')
    parser.add_argument('--quick', action='store_true', help='leave out the tests named Full...')
    parser.add_argument('--report', type=Path,
                        help='file for the summary, written anew after each file')
    options = parser.parse_args()
    build = options.build.resolve()
    found = [
        file for program in sorted((build/'tests').glob('TestOpenCL*'))
        if os.access(program, os.X_OK) and program.suffix == '' for file in files_of(program)
        if file.name not in LEFT_OUT
    ]
    files = []
    for part in options.only:
        chosen = [file for file in found if part in file.name and file not in files]
        if not chosen:
            sys.exit(f'No program for OpenCL in {build/"tests"} has another file {part}: build it '
                     'first.')
        files += chosen
    logs = build/'Testing'/'opencl'
    logs.mkdir(parents=True, exist_ok=True)
    options.commit = subprocess.run(['git', 'describe', '--always', '--dirty'], text=True,
                                    capture_output=True, check=False).stdout.strip()
    begin = time.monotonic()
    with ThreadPoolExecutor(options.jobs) as pool:
        tasks = [
            pool.submit(runs, file, precision, build/'pocl', logs, quick=options.quick)
            for file in files for precision in options.precision
        ]
        results = []
        with tqdm(as_completed(tasks), total=len(tasks), desc='Runs') as bar:
            for task in bar:
                results.append(task.result())
                last = results[-1]
                if last.failed:
                    bar.write(f'{last.name} in {last.precision} precision: '
                              f'{", ".join(last.failed)} failed')
                text = summary(options, [file.name for file in files], results,
                               time.monotonic() - begin)
                if options.report:
                    options.report.write_text(text, encoding='utf-8')
    print(text)
    return any(each.failed for each in results)


if __name__ == '__main__':
    sys.exit(main())
