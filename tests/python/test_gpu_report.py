"""The report on steps and products of a device, with boxes that take seconds on a processor.

Its times say nothing here. What is tested: every method runs, at the right temperature; numbers of
the report belong together; a run that fails and what there is no time for are said.
"""
import importlib.util
import json
import os
import pathlib
import subprocess
import sys

import openmm
import pytest

TOOL = pathlib.Path(__file__).resolve().parents[2]/'tools'/'gpu-report.py'
METHODS = 10  # Verlet, three of LangevinMiddle, three steps of ours on the device and on the host


@pytest.fixture(scope='module')
def tool():
    spec = importlib.util.spec_from_file_location('gpu_report', TOOL)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def report(folder, *options):
    """(exit code, what is printed, the JSON) of the tool."""
    finished = subprocess.run([
        sys.executable, TOOL, '--platform', 'CPU', '--output', folder/'report.json', '--rounds',
        '2', *options
    ], capture_output=True, text=True, timeout=300)
    assert (folder/'report.json').exists(), finished.stderr
    return finished.returncode, finished.stdout, json.loads((folder/'report.json').read_text())


def program(path, output, code):
    path.write_text(f'#!/bin/sh\necho "{output}"\nexit {code}\n')
    path.chmod(0o755)
    return path


def test_every_method_is_measured(tmp_path):
    passes = program(tmp_path/'TestPasses', '[  PASSED  ] 3 tests.', 0)
    code, printed, result = report(tmp_path, '--waters', '64', '--bodies', 'device', 'host',
                                   '--products', '40', '--budget', '0.1', '--equilibration', '1',
                                   '--tests', passes)
    assert code == 0, printed
    assert result['left_out'] == [] and result['settings']['seed'] == 2026
    assert result['machine']['platform'] == 'CPU' and result['machine']['openmm']
    assert [(row['program'], row['passed'], row['failed']) for row in result['tests']
            ] == [('TestPasses', 3, [])] and '3 tests passed, 0 failed' in printed

    rows = result['water']
    assert len(rows) == METHODS
    for row in rows:
        assert row['particles'] == 256 and 'failed' not in row, row
        # 384 degrees of freedom: a standard deviation of 22 K, more for Verlet, which has no bath.
        assert 180 < row['temperature_K'] < 420, row
        assert -50 < row['energy_of_a_molecule'] < -38, row
        for call in (1000, 10, 1):
            entry = row['steps_by'][f'calls of {call}']
            assert 1 <= entry['steps_in_a_call'] <= call and entry['rounds'] == 2
            assert entry['ns_per_day'] == pytest.approx(
                row['step_fs']*86.4/entry['milliseconds']['median'], rel=1e-3)
        assert f'{row["steps_by"]["calls of 1"]["ns_per_day"]:.1f}' in printed
    ours = [row for row in rows if row['method'] == 'LangevinC']
    assert [(row['step_fs'], row['moments_times'], row['bodies_asked_for'])
            for row in ours] == [(step, moments, place)
                                 for step, moments in ((4, 1), (12, 8), (15, 8))
                                 for place in ('device', 'host')]
    for row in ours:
        assert row['loops'].startswith('on: CPU')
        parts = [
            row[f'milliseconds_{part}_by_our_timer']['median'] for part in ('scheme', 'forces')
        ]
        whole = row['steps_by']['calls of 1000']['milliseconds']['median']
        assert 0 < parts[0] < parts[1] and sum(parts) == pytest.approx(whole, rel=0.3)
        # LangevinMiddle has the step of 4 fs, but none of 12 or 15.
        for entry in row['steps_by'].values():
            assert ('time_over_that_of_LangevinMiddle_at_the_same_step'
                    in entry) == (row['step_fs'] == 4)
            assert ('time_over_that_of_bodies_on_the_host'
                    in entry) == (row['bodies_asked_for'] == 'device')
            assert entry['ns_per_day_over_LangevinMiddle_at_4_fs']['median'] > 0

    assert len(result['products']) == 6
    for row in result['products']:
        assert row['particles'] == 40 and row['product']['milliseconds']['median'] > 0
        step = row['step_with_noise']
        assert step['products_a_step'] > 1
        assert 0 < step['milliseconds_mobility'] < 2*step['milliseconds']['quartiles'][1]


def test_what_fails_is_said(tmp_path):
    fails = program(tmp_path/'TestFails', '[  FAILED  ] Water.Boils', 1)
    code, printed, result = report(tmp_path, '--waters', '--products', '--tests', fails)
    assert code == 1 and result['tests'][0]['failed'] == ['Water.Boils']
    assert 'TestFails (double): failed: Water.Boils' in printed
    assert 'Water.Boils' in result['tests'][0]['end_of_output']


def test_a_program_that_is_not_there_is_said(tmp_path):
    finished = subprocess.run([sys.executable, TOOL, '--output', tmp_path/'r.json', '--tests', 'a'],
                              capture_output=True, text=True, timeout=60)
    assert finished.returncode == 2
    assert '--tests: there is no program a: build it, or correct the path' in finished.stderr


def test_a_program_that_hangs_has_failed(tmp_path, tool):
    hangs = program(tmp_path/'TestHangs', 'begun', '$(sleep 30)')
    row, = tool.runTests([hangs], ['double'], 1, 0.5/60)
    assert row['failed'] == ['the process as a whole, exit code none in 0.5 s']


def test_a_program_runs_a_file_at_a_time(tmp_path, tool):
    """CMake lists the files whose tests a program has."""
    both = program(tmp_path/'TestBoth', '[  PASSED  ] 3 tests.', 0)
    (tmp_path/'files.txt').write_text('TestA TestBoth A.*:*/A.*\nTestB TestBoth B.*\n'
                                      'TestC TestOther C.*\n')
    files = tool.test_opencl.files_of(both)
    assert [(file.name, file.suites) for file in files] == [('TestA', 'A.*:*/A.*'),
                                                            ('TestB', 'B.*')]
    assert [row['program'] for row in tool.runTests([both], ['double'], 1, 1)] == ['TestA', 'TestB']


def test_the_opencl_report_says_what_ran(tmp_path, tool, monkeypatch, capsys):
    """In the order that was asked for, without the tests named Full..., and what did not pass."""
    (tmp_path/'tests').mkdir()
    output = '[  PASSED  ] 3 tests.\n[  SKIPPED ] 2 tests, listed below:\n[  FAILED  ] B.Boils'
    program(tmp_path/'tests'/'TestOpenCL', f'$@\n{output}', 1)
    (tmp_path/'tests'/'files.txt').write_text('TestOpenCLA TestOpenCL A.*\n'
                                              'TestOpenCLB TestOpenCL B.*\n')
    written = tmp_path/'report.txt'
    monkeypatch.setattr(sys, 'argv', [
        'test_opencl.py',
        str(tmp_path), '--precision', 'mixed', '--quick', '--only', 'OpenCLB', 'OpenCLA', '--jobs',
        '1', '--report',
        str(written)
    ])
    assert tool.test_opencl.main() is True
    text = written.read_text(encoding='utf-8')
    assert 'Tests named Full... were left out.' in text
    assert ('mixed: 6 tests of 2 files passed, 4 skipped, 2 failed; 0 files did not run\n'
            '    TestOpenCLB: B.Boils') in text
    assert text.index('\nTestOpenCLB') < text.index('\nTestOpenCLA')
    log = (tmp_path/'Testing'/'opencl'/'TestOpenCLB.mixed.log').read_text(encoding='utf-8')
    assert log.startswith('--gtest_filter=B.*-*.Long*:*.Full*')


def test_what_there_is_no_time_for_is_said(tmp_path):
    code, printed, result = report(tmp_path, '--waters', '27', '--products', '10', '--at-most', '0')
    assert code == 0 and not result['water'] and not result['products']
    assert result['left_out'][0] == '27 waters' and len(result['left_out']) == 7
    assert 'Left out for lack of time: 7 measurements, from "27 waters" on' in printed


def rows(folder, tool, monkeypatch, *methods):
    """Rows of a box of 27 waters with these methods."""
    monkeypatch.setattr(tool, 'methodsFor', lambda places: methods)
    monkeypatch.setattr(sys, 'argv', [
        str(TOOL), '--platform', 'Reference', '--waters', '27', '--products', '--rounds', '1',
        '--budget', '0.02', '--equilibration', '1', '--output',
        str(folder/'report.json')
    ])
    code = tool.main()
    found = json.loads((folder/'report.json').read_text())['water']
    assert code == any('failed' in row for row in found)
    return found


def test_a_run_that_explodes_is_a_row_with_the_reason(tmp_path, tool, monkeypatch, capsys):
    right, wrong = rows(tmp_path, tool, monkeypatch, tool.Method('LangevinMiddle', 4),
                        tool.Method('LangevinC', 60))
    assert 'failed' not in right and right['steps_by']
    assert 'exploded' in wrong['failed'] and not wrong['steps_by']
    assert f'failed: {wrong["failed"][:60]}' in capsys.readouterr().out


def test_a_temperature_far_from_the_bath_is_a_failure(tmp_path, tool, monkeypatch):
    monkeypatch.setattr(tool, 'TOO_FAR', 0.1)
    for row in rows(tmp_path, tool, monkeypatch, tool.Method('LangevinMiddle', 4),
                    tool.Method('LangevinC', 4)):
        assert row['failed'].startswith('the run has exploded: the temperature is ')


def test_bodies_are_asked_for_on_the_host(tmp_path, tool, monkeypatch):
    """The library reads the environment variable when a Context is created."""
    seen, Context = [], openmm.Context

    def watched(system, integrator, *others):
        seen.append((type(integrator).__name__, os.environ.get('RIGIDHI_BODIES_ON_HOST')))
        return Context(system, integrator, *others)

    monkeypatch.setenv('RIGIDHI_BODIES_ON_HOST', '')
    monkeypatch.setattr(openmm, 'Context', watched)
    box = tool.Box(27, 0.9)
    platform = openmm.Platform.getPlatformByName('Reference')
    state = tool.equilibrate(box, platform, '', 1, 0.05)
    for place in ('host', 'device'):
        tool.Runner(tool.Method('LangevinC', 2, bodies=place), box, platform, '', state, 1, 0.01)
    assert seen[1:] == [('CustomRigidHIIntegrator', '1'), ('CustomRigidHIIntegrator', '0')]
