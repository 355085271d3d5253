"""examples/flow_pictures: the flows that it draws have no sources, are zero at the wall, are
periodic, and move with the shells. The shortened script runs."""
import importlib.util
import json
import pathlib
import sys

import numpy as np
import pytest

SCRIPT = pathlib.Path(__file__).resolve().parents[2]/'examples'/'flow_pictures'/'run.py'


@pytest.fixture(scope='module')
def example():
    specification = importlib.util.spec_from_file_location('flow_pictures_run', SCRIPT)
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


@pytest.mark.parametrize('name', ('inWave', 'aboveWall'))
def test_flows_have_no_sources(example, name):
    """The divergence by central differences is zero. Its error is delta^2/6 of third derivatives,
    which outside of shells are below the rate of strain over the radius squared."""
    flow, delta = getattr(example, name)(12), 1e-3
    points = flow.places[0] + np.array([(1.5, 0.2, 0.3), (-0.4, 1.6, 0.5), (0.3, -0.5, 2.0)])
    gradient = np.stack([(flow.at(points + delta*e) - flow.at(points - delta*e))/(2*delta)
                         for e in np.eye(3)], -1)
    assert np.abs(np.trace(gradient, axis1=1, axis2=2)).max() < 1e-5*np.abs(gradient).max()


def test_what_bounds_a_flow(example):
    wave, wall = example.inWave(12), example.aboveWall(12)
    points = np.array([(0.3, 0.2, 0.1), (4.0, -1.0, 2.0)])
    assert np.allclose(wave.at(points + (example.EDGE, -example.EDGE, 2*example.EDGE)),
                       wave.at(points), rtol=0, atol=1e-9)
    assert np.abs(wall.at([(0.5, 0.2, 0), (-3.0, 1.0, 0)])).max() < 1e-12
    # At a large distance the flow is the shear.
    assert np.allclose(wall.at([(0, 300, 2.0)]), (2.0*example.RATE, 0, 0), atol=1e-3)


def test_shells_go_with_their_flow(example):
    """The slip on a sphere of the shells' radius is smaller with more blobs. It is small beside the
    slip of the undisturbed fluid, 0.4 to 0.6 of strain rate times radius."""
    slips = {}
    for blobs in (12, 42):
        flow = example.aboveWall(blobs)
        twists = flow.twists()
        slips[blobs] = flow.slipOfSurface(twists)
        # The shell is slower than the undisturbed fluid at its centre, because the wall slows it
        # down, and it turns with the fluid.
        assert 0.8 < twists[0][0][0]/(
            example.RATE*example.HEIGHT) < 0.95 and 0.8 < twists[1][0][1]/(example.RATE/2) < 0.95
    assert slips[42] < 0.75*slips[12] < 0.15


@pytest.mark.scripts
def test_the_script_runs(example, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, 'argv',
                        ['run.py', '--output',
                         str(tmp_path), '--blobs', '12', '--points', '9'])
    example.main()
    found = json.loads((tmp_path/'flows.json').read_text())
    assert found['run']['arguments'] == {
        'blobs': '12',
        'points': '9'
    } and (tmp_path/'flows.png').stat().st_size > 10000
    assert found['wave']['effective_viscosity_over_viscosity'] == pytest.approx(
        1 + 2.5*found['wave']['volume_fraction'], rel=0.02)
