#!/usr/bin/env python3
"""List the tests that take most processor time.

Each test of ctest is run alone and its processor time (user and system) is taken from the
operating system, so that the list is right on a machine that does other work, too. With --python
the tests of pytest are listed instead, each with the time of its fixtures and of processes that
it started.

Example
-------
tools/slow_tests.py build                            the 20 slowest quick tests in C++
tools/slow_tests.py build --only TestReferenceFlow   those of one program
tools/slow_tests.py build --python tests/python      the 20 slowest tests in Python
"""
import argparse
import json
import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest
from tqdm import tqdm


def processor_time(who):
    """User and system time of this process or of its children that have ended, in seconds."""
    used = resource.getrusage(who)
    return used.ru_utime + used.ru_stime


def ctest_times(build, label, only):
    """Run the tests of a build folder one by one.

    Parameters
    ----------
    build : Path
        the build folder
    label : str
        regular expression of ctest's labels
    only : str
        regular expression of the names of tests

    Returns
    -------
    list of (float, str)
        seconds of each test, and its name
    """
    named = ['-R', only] if only else []  # an empty expression is that of no test
    listed = subprocess.run(
        ['ctest', '--test-dir', build, '-L', label, *named, '--show-only=json-v1'], check=True,
        capture_output=True, text=True)
    times = []
    for test in tqdm(json.loads(listed.stdout)['tests'], desc='Tests'):
        if 'command' not in test:
            continue
        settings = {each['name']: each['value'] for each in test.get('properties', [])}
        own = dict(each.split('=', 1) for each in settings.get('ENVIRONMENT', []))
        before = processor_time(resource.RUSAGE_CHILDREN)
        finished = subprocess.run(test['command'], cwd=settings.get('WORKING_DIRECTORY', build),
                                  env={
                                      **os.environ,
                                      **own
                                  }, capture_output=True, check=False)
        failed = '' if finished.returncode == 0 else ' (failed)'
        times.append((processor_time(resource.RUSAGE_CHILDREN) - before, test['name'] + failed))
    return times


class PytestTimes:
    """A plugin of pytest that takes the processor time of each test."""
    def __init__(self):
        self.times = []

    @pytest.hookimpl(hookwrapper=True)
    def pytest_runtest_protocol(self, item):
        whose = resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN
        before = sum(map(processor_time, whose))
        yield
        self.times.append((sum(map(processor_time, whose)) - before, item.nodeid))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n', maxsplit=1)[0])
    parser.add_argument('build', type=Path, help='the build folder')
    parser.add_argument('--python', metavar='PATH', nargs='+', help='list these tests of pytest')
    parser.add_argument('--label', default='quick', help='label of the tests (default: quick)')
    parser.add_argument('--only', default='', help='part of the names of the tests to run')
    parser.add_argument('--number', type=int, default=20, help='how many are listed (default: 20)')
    options = parser.parse_args()
    if options.python:
        plugin = PytestTimes()
        sys.path.insert(0, str(options.build.resolve()/'python'))
        # Tests that start another Python find the package, too.
        os.environ['PYTHONPATH'] = os.pathsep.join(
            filter(None, [sys.path[0], os.environ.get('PYTHONPATH')]))
        status = pytest.main([
            '-q', '--durations=1', '-m', 'not full and not long', '-k', options.only,
            *options.python
        ], plugins=[plugin])
        times = plugin.times
    else:
        times = ctest_times(options.build.resolve(), options.label, options.only)
        status = any(name.endswith(' (failed)') for _, name in times)
    if not times:
        sys.exit('No test has such a name.')
    times.sort(reverse=True)
    total = sum(seconds for seconds, _ in times)
    print(f'\n{len(times)} tests took {total:.0f} s of processor time.')
    for seconds, name in times[:options.number]:
        print(f'{seconds:8.2f} s {seconds/total:6.1%}  {name}')
    return int(bool(status))


if __name__ == '__main__':
    sys.exit(main())
