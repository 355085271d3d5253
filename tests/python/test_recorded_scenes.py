"""tools/trajectories.py records every scheme, and every model with each of its boundaries."""
import pathlib
import sys

import numpy as np
import pytest

from openmmrigidhi import _models, integrator, mobility

sys.path.insert(0, str(pathlib.Path(__file__).parents[2]/'tools'))
import trajectories  # noqa: E402  (a program beside the package)

trajectories.imports()
SCENES = list(trajectories.scenes())


def combinations():
    """(model, boundary, whether on a grid) of the scenes with a fluid, and their schemes."""
    found = {}
    for name, make, schemes in SCENES:
        if name.startswith('water'):
            continue
        fluid = make().fluid
        if fluid:
            model, boundary = (mobility.Model(fluid.getModel()).name,
                               mobility.Boundary(fluid.getBoundary()).name)
            isOnGrid = boundary in mobility.Model[model].traits.grids and \
                fluid.getSolver() == fluid.MatrixFree
            found.setdefault((model, boundary, isOnGrid), set()).update(schemes)
    return found


def test_every_scheme_is_recorded():
    assert set(integrator.Scheme) == {scheme for _, _, schemes in SCENES for scheme in schemes}


def test_every_model_is_recorded_with_each_boundary():
    """Dense, and on a grid where the model has one, with all schemes in a fluid."""
    inFluid = {scheme for scheme in integrator.Scheme if scheme.traits.needsFluid}
    found = combinations()
    for model in _models.MODELS:
        for boundary in model.boundaries:
            for isOnGrid in {False, boundary in model.grids}:
                assert found.get((model.name, boundary, isOnGrid)) == inFluid, (
                    f'{model.name}, {boundary}{", on a grid" if isOnGrid else ""}')


@pytest.mark.parametrize(
    'name', ['held-dense', 'driven-dense', 'jointed-dense', 'active-dense', 'flow-shear-dense'])
def test_a_scene_is_the_same_each_time(name):
    make, scheme = next((make, schemes[-1]) for each, make, schemes in SCENES if each == name)
    once, again = (trajectories.run(make, scheme, 'Reference', {}) for _ in range(2))
    assert all(np.array_equal(a, b) for a, b in zip(once, again))
