#!/usr/bin/env python3
"""Run the platform tests on OpenMM's OpenCL platform, in each precision, and write a summary.

`ctest -L full -R OpenCL` runs the same tests, each in a process of its own, where each compiles its
kernels again. Here each program runs whole.

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
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from tqdm import tqdm

PRECISIONS = 'double', 'single', 'mixed'
#: Allocations are counted on the platforms whose steps do not copy to a device.
LEFT_OUT = {'TestOpenCLAllocations'}


def runs(program, precision, cache, logs, timeout=None):
    """Run one program in one precision.

    Parameters
    ----------
    program : Path
    precision : str
    cache : Path
        folder for compiled kernels
    logs : Path
        folder for the outputs
    timeout : float, optional
        seconds after which the program is ended, and has failed

    Returns
    -------
    (str, str, int, list of str, float)
        program, precision, number of tests that passed, what failed, seconds
    """
    log = logs/f'{program.name}.{precision}.log'
    environment = dict(os.environ, RIGIDHI_TEST_PRECISION=precision, POCL_CACHE_DIR=str(cache))
    begin = time.monotonic()
    with open(log, 'w', encoding='utf-8') as file:
        try:
            code = subprocess.run([program, '--gtest_filter=-*.Long*'], env=environment,
                                  stdout=file, stderr=subprocess.STDOUT, check=False,
                                  timeout=timeout).returncode
        except subprocess.TimeoutExpired:
            code = f'none in {timeout:g} s'
    text = log.read_text(encoding='utf-8', errors='replace')
    found = re.search(r'^\[  PASSED  \] (\d+) test', text, re.MULTILINE)
    failed = sorted(set(re.findall(r'^\[  FAILED  \] (\w+(?:/\w+)?\.[\w/]+)', text, re.MULTILINE)))
    if code and not failed:
        failed = [f'the program as a whole, exit code {code}']
    return program.name, precision, int(found[1]) if found else 0, failed, time.monotonic() - begin


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n', maxsplit=1)[0])
    parser.add_argument('build', type=Path, help='the build folder')
    parser.add_argument('--precision', nargs='+', choices=PRECISIONS, default=PRECISIONS)
    parser.add_argument('--jobs', type=int, default=2, help='programs at once')
    parser.add_argument('--only', default='', help='part of the name of the programs to run')
    parser.add_argument('--report', type=Path, help='file for the summary')
    options = parser.parse_args()
    build = options.build.resolve()
    programs = sorted(path for path in (build/'tests').glob('TestOpenCL*')
                      if path.is_file() and os.access(path, os.X_OK) and path.suffix == ''
                      and path.name not in LEFT_OUT and options.only in path.name)
    if not programs:
        sys.exit(
            f'There is no program {options.only} for OpenCL in {build/"tests"}: build it first.')
    logs = build/'Testing'/'opencl'
    logs.mkdir(parents=True, exist_ok=True)
    begin = time.monotonic()
    with ThreadPoolExecutor(options.jobs) as pool:
        tasks = [
            pool.submit(runs, program, precision, build/'pocl', logs)
            for precision in options.precision for program in programs
        ]
        results = []
        with tqdm(tasks, desc='Programs') as bar:
            for task in bar:
                results.append(task.result())
                name, precision, passed, failed, seconds = results[-1]
                if failed:
                    bar.write(f'{name} in {precision} precision: {", ".join(failed)} failed')
    commit = subprocess.run(['git', 'describe', '--always', '--dirty'], text=True,
                            capture_output=True, check=False).stdout.strip()
    lines = [
        'Platform tests on OpenMM\'s OpenCL platform (pocl: the processor is the device), '
        'made by tools/test_opencl.py',
        f'{time.strftime("%Y-%m-%d")}; commit {commit or "unknown"}; {platform.machine()}, '
        f'{os.cpu_count()} processors, {options.jobs} programs at once; '
        f'{(time.monotonic() - begin)/60:.0f} minutes', ''
    ]
    for precision in options.precision:
        own = [each for each in results if each[1] == precision]
        lines.append(
            f'{precision}: {sum(each[2] for each in own)} tests of {len(own)} programs passed, '
            f'{sum(len(each[3]) for each in own)} failed')
        lines += [f'    {name}: {failed}' for name, _, _, tests, _ in own for failed in tests]
    lines += ['', f'{"program":<40}' + ''.join(f'{each + ", s":>12}' for each in options.precision)]
    for program in programs:
        times = {each[1]: each[4] for each in results if each[0] == program.name}
        lines.append(f'{program.name:<40}' + ''.join(f'{times[each]:>12.0f}'
                                                     for each in options.precision))
    text = '\n'.join(lines) + '\n'
    print(text)
    if options.report:
        options.report.write_text(text, encoding='utf-8')
    return any(each[3] for each in results)


if __name__ == '__main__':
    sys.exit(main())
