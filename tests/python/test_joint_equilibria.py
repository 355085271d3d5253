"""The study validation/bodies/joints.py begins in equilibrium, and a trumbbell stays there."""
import importlib.util
import json
import pathlib

import numpy as np
import pytest

SCRIPT = pathlib.Path(__file__).resolve().parents[2]/'validation'/'bodies'/'joints.py'


def study():
    spec = importlib.util.spec_from_file_location('joints', SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


SCENES = ('LooseTrumbbell', 'CoupledTrumbbell', 'Ring', 'Tied', 'Linked', 'Pair')


@pytest.mark.parametrize('name', SCENES)
def test_copies_begin_in_equilibrium(name):
    """Means of 300 independent copies are within 4.5 standard errors of the exact ones. A start
    that does not fit the joints would be an error of the first step."""
    module = study()
    assert tuple(module.SCENES) == SCENES
    scene = module.SCENES[name](300, 'FixmanMidpoint', 1e-4, 7)
    first = scene.observe(scene.positions())
    for key, exact in scene.exact.items():
        error = first[key].std(ddof=1)/np.sqrt(len(first[key]))
        assert abs(first[key].mean() - exact) < 4.5*error and error < 0.06, key
    scene.integrator.step(2)
    moved = scene.observe(scene.positions())
    for key in scene.exact:
        assert 0 < np.abs(moved[key] - first[key]).max() < 0.5, key


def test_the_page_has_the_table_of_the_results():
    module = study()
    folder = SCRIPT.parent
    runs = [
        run for name in SCENES
        for run in json.loads((folder/'results'/f'{name}.json').read_text())['runs']
    ]
    page = (folder/'README.md').read_text(encoding='utf-8')
    assert len(runs) == len(module.RUNS)*len(module.SCHEMES) and '\n'.join(
        module.table(runs)) in page


@pytest.mark.full
def test_a_trumbbell_has_the_measure_of_stiff_springs():
    """At the step D h/L^2 = 0.009 the mean of cos^2 is 1/3 with an error of the step of +0.003.

    Without its term for joints TrapezoidalSlip has 0.325 at this step, on the way to 0.3210 of
    rigid constraints with masses; Euler's method with a projection has 0.38. The bounds are 4
    standard errors of this run or more from all of them.
    """
    module = study()

    class Job:
        def report(self, steps):
            pass

    run = module.simulate(('LooseTrumbbell', 'TrapezoidalSlip', 0.009, 256, 26, 1), Job())
    mean, error = run['mean']['cos^2'], run['error']['cos^2']
    assert error < 0.0015
    assert 0.3310 < mean < 0.3425, (mean, error)
