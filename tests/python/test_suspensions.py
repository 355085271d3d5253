"""The study of random hard spheres at short times: its configurations, and what they give."""
import importlib.util
import pathlib
import sys

import numpy as np
import pytest

VALIDATION = pathlib.Path(__file__).resolve().parents[2]/'validation'
STUDY = VALIDATION/'accuracy'/'suspensions'
sys.path.append(str(VALIDATION/'common'))
import hardspheres  # noqa: E402


@pytest.fixture(scope='module')
def run():
    spec = importlib.util.spec_from_file_location('suspensions_run', STUDY/'run.py')
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_configurations_have_no_overlap_and_forget_the_lattice(run):
    # 0.45 is the densest fraction of the study, where spheres forget their lattice last.
    order = []
    for seed in range(4):
        x, edge = run.hardSpheres(32, 0.45, np.random.default_rng(seed))
        d = x[:, None] - x
        d -= edge*np.round(d/edge)
        distances = np.linalg.norm(d, axis=-1)[np.triu_indices(32, 1)]
        assert distances.min() > 2 and 4*np.pi/3*32/edge**3 == pytest.approx(0.45)
        order.append(hardspheres.latticeOrder(x, edge))
    # The waves of the lattice have the intensity of a fluid: four exponential variables of a mean
    # up to 3, so that the mean over 16 is below 6 but in one of 3000 cases. A crystal has 10 to 20
    # (a lattice 32), also after 400 sweeps at 0.45.
    assert np.mean(order) < 6
    places = np.stack(np.meshgrid(*[np.arange(4)]*3), axis=-1).reshape(-1, 3)/4
    lattice = places[(4*places.sum(axis=1)) % 2 == 0]
    assert len(lattice) == 32 and hardspheres.latticeOrder(edge*lattice, edge) > 31


def test_a_suspension_that_is_not_dense(run):
    """At a volume fraction of 0.1 all models are near the fits (3 %, and 32 spheres of one
    configuration scatter by some per cent)."""
    found, fits = run.configuration((0.1, 32, 0), None), run.fits(0.1)
    for name, quantities in found.items():
        for quantity, value in quantities.items():
            if value is not None:
                assert value == pytest.approx(fits[quantity], rel=0.12), (name, quantity)


def test_lubrication_of_strain_makes_dense_suspensions_viscous(run):
    """Stresslets alone have 3.2 at 0.45, and the fit has 5.4."""
    found = run.configuration((0.45, 32, 0), None)
    assert found['FTS']['viscosity'] == pytest.approx(3.2, rel=0.1)
    assert found['FTS + pairs']['viscosity'] == pytest.approx(run.fits(0.45)['viscosity'], rel=0.15)
    assert found['FTS + pairs']['D_s'] == pytest.approx(run.fits(0.45)['D_s'], rel=0.1)
