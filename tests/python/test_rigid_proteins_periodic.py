"""In the shortened examples/rigid_proteins_periodic, resumed runs equal uninterrupted ones, and the
fluid is that of the proteins."""
import json
import pathlib
import subprocess
import sys

import numpy as np
import pytest

pytestmark = pytest.mark.scripts
SCRIPT = pathlib.Path(__file__).resolve().parents[2]/'examples'/'rigid_proteins_periodic'/'run.py'


@pytest.fixture(scope='module')
def result(tmp_path_factory):
    folder = tmp_path_factory.mktemp('proteins')
    finished = subprocess.run(
        [sys.executable, str(SCRIPT), '--quick', '--output',
         str(folder)], capture_output=True, text=True, timeout=600)
    assert finished.returncode == 0, finished.stdout + finished.stderr
    found = {}
    assert (folder/'rigid_proteins.png').stat().st_size > 5000
    for name in ('rigid_proteins', 'prices'):
        found.update(json.loads((folder/f'{name}.json').read_text()))
    return found


def test_resumed_runs(result):
    """Runs resume bit for bit on Reference. On CPU they have the same random numbers, so that only
    the rounding of OpenMM's forces differs."""
    rows = result['saved_and_resumed']
    assert {(row['platform'], row['scheme'])
            for row in rows} == {(p, s)
                                 for p in ('Reference', 'CPU')
                                 for s in ('LangevinHI', 'DriftCorrectorFD')}
    for row in rows:
        # Steps are of 1e-3 nm, and another noise would make a difference of this size.
        assert row['moved_after'] > 1e-3
        for saved in ('State', 'checkpoint'):
            if row['platform'] == 'Reference':
                assert row[saved]['identical']
            assert row[saved]['largest_difference'] < 1e-6


def test_displacements(result):
    """Without momenta displacements have the variance 2 kT N t. From 720 squares it is known to 5
    %, and 4.5 standard errors are allowed."""
    without, = (run for run in result['runs'] if run['scheme'] == 'DriftCorrectorFD')
    count = 3*without['proteins']*without['duration_ps']/0.1
    assert count == pytest.approx(720)
    ratio = without['D_from_displacements_nm2_per_ps'][0]/without['D_from_mobility_nm2_per_ps']
    print(f'D of displacements over that of the mobility: {ratio:.3f}')
    assert ratio == pytest.approx(1, abs=4.5*np.sqrt(2/count))


def test_fluid(result):
    """The fluid is on a grid, the proteins carry the charge of villin at pH 7, and prices are those
    of the requested schemes."""
    assert result['charge_e'] == pytest.approx(6, abs=1e-6)
    price, = result['prices']
    kinds = price['kinds']
    for scheme in ('LangevinHI', 'DriftCorrectorFD'):
        assert 'on a grid' in price['fluid'][
            scheme] and kinds[scheme]['ms_transforms'] > 0 and kinds[scheme]['iterations'] > 0
    assert 'on a grid' not in price['fluid']['LangevinHI, dense'] and kinds['LangevinHI, dense'][
        'ms_transforms'] == 0
    assert kinds['forces alone, Langevin C']['ms_fluid'] == 0
    assert all(row['force_evaluations'] == 1 for row in kinds.values())
