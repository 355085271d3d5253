"""The shortened water demo runs, and its own checks pass."""
import json
import pathlib
import re
import subprocess
import sys

import pytest

import openmmrigidhi

DEMO = pathlib.Path(__file__).resolve().parents[2]/'examples'/'water_demo'/'run.py'


@pytest.mark.scripts
def test_water_demo(tmp_path):
    finished = subprocess.run(
        [sys.executable, str(DEMO), '--short', '--output',
         str(tmp_path)], capture_output=True, text=True, timeout=300)
    assert finished.returncode == 0, finished.stdout + finished.stderr
    assert 'FAILED' not in finished.stdout and finished.stdout.count('[ok]') == 7
    for file in ('water.png', 'trajectory.dcd', 'half_way.chk', 'half_way.xml'):
        assert (tmp_path/file).stat().st_size > 1000
    results = json.loads((tmp_path/'results.json').read_text())
    assert results['nsPerDay'] > 0 and 0 < results['integratorShare'] < 1
    # The run is 2 ps of 895 waters, hardly equilibrated. Temperatures scatter by 1 %, and the start
    # is at most 5 % off.
    for name in ('T_trans', 'T_rot1', 'T_rot2', 'T_rot3'):
        assert abs(results[name][0] - 300) < 30, name
    assert -50 < results['U'][0] < -43
    # Both halves of the run are in the files: 1000 steps, a frame every 100, a line every 25.
    states = openmmrigidhi.app.readBodyStates(tmp_path/'bodies.h5')
    assert list(states.step) == list(range(100, 1001, 100))
    assert len(re.findall(r'^\d', (tmp_path/'table.csv').read_text(), flags=re.M)) == 40
