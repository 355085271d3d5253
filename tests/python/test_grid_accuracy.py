"""openmmrigidhi.accuracy, grids of a periodic fluid: the errors that the study measures agree with
those of matrices, and its advice is right."""
import contextlib
import copy
import io

import numpy as np
import openmm
import pytest

from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce, accuracy
from openmmrigidhi._systems import forces_of
from openmmrigidhi.accuracy import cli, grid, gridreport


@pytest.fixture(scope='module')
def result():
    """Eight spheres."""
    return accuracy.GridStudy(accuracy.scenes.periodicSuspension(8, 0.1),
                              [1e-2, 1e-4, 1e-6]).run(rounds=2)


def test_sizes_of_grids():
    assert grid.gridSizes(20, 56) == [20, 24, 28, 30, 32, 36, 40, 42, 48, 50, 54, 56]
    assert grid.gridSizes(21.5, 23) == [] and grid.gridSizes(1, 5) == [2, 4]


def test_what_the_sampling_of_a_gaussian_asks_for():
    assert [round(gridreport.gaussianFineness(error), 2)
            for error in (1e-4, 1e-6, 1e-8)] == [0.97, 1.18, 1.37]


@pytest.mark.parametrize('observable', grid.OBSERVABLES)
def test_errors_are_those_of_the_matrices(result, observable):
    """The errors agree with those of matrices column by column and by all eigenvalues, instead of
    by iterations."""
    study = accuracy.GridStudy(accuracy.scenes.periodicSuspension(8, 0.1), [1e-2])
    dense, products = (study.makeContext(observable, solver, 1e-2)
                       for solver in (MobilityForce.Dense, MobilityForce.MatrixFree))
    rows = 8*(6 if observable == 'wrenches' else 3)
    exact, M = (np.array([study._product(observable, fluid, context, e) for e in np.eye(rows)]).T
                for fluid, _, context in (dense, products))
    root = 1/np.sqrt(np.diag(exact))
    error, norm = (np.linalg.norm(root[:, None]*A*root, 2) for A in (M - exact, exact))
    row = next(row for row in result.select(observable, 'tolerance') if row['setting'] == 1e-2)
    # Iterations stop at an error of half a per cent.
    assert row['own_error'] == pytest.approx(error, rel=0.01) and row['error'] == pytest.approx(
        error/norm, rel=0.02)
    assert result.observables[observable]['norm'] == pytest.approx(norm, rel=0.01)
    assert grid.describedGrid(products[1])[1] == 0.01 == row['described']


def test_grids_are_as_described(result):
    edge = result.scene['edges'][0]
    for row in result.rows:
        nodes = [int(n) for n in row['nodes'].split(' x ')]
        width = {
            'forces': 1/np.sqrt(np.pi),
            'wrenches': 1/(6*np.sqrt(np.pi))**(1/3)
        }[row['observable']]
        assert row['fineness'] == pytest.approx(
            width*max(nodes)/edge) and nodes[0] == nodes[1] == nodes[2]
        assert row['status'] == 'stable' and 0 < row['error'] <= row['own_error']
        if row['kind'] == 'spacing':
            # The grid is the one that was asked for, and not the next one.
            assert row['fineness'] == pytest.approx(
                row['setting']) and row['seconds_product'] is None
        else:
            assert row['seconds_product'] <= row['seconds_median'] and row['described'] == row[
                'setting']


def test_errors_are_below_tolerances_and_fall_with_them(result):
    for observable in grid.OBSERVABLES:
        rows = result.select(observable, 'tolerance')
        assert all(row['setting']/300 < row['error'] < row['setting'] for row in rows)
        spaced = result.select(observable, 'spacing')
        assert len(spaced) >= 4 and all(fine['error'] < coarse['error']
                                        for coarse, fine in zip(spaced[:-1], spaced[1:]))
        assert all(row['error'] < row['described'] for row in spaced)
        # The fineness is that needed to sample a Gaussian, and a little more for the curls of
        # torques. It is never more than the library chooses.
        for error in (1e-4, 1e-6, 1e-8):
            chosen = np.sqrt(np.log({'forces': 2, 'wrenches': 9}[observable]/error))/np.pi
            assert gridreport.gaussianFineness(error) - 0.05 < result.finenessFor(
                observable, error) < chosen
        assert result.finenessFor(observable, 1) is None and result.finenessFor(observable,
                                                                                1e-30) is None


def test_described_tolerances_hold_where_no_node_is_to_spare():
    """For one sphere the whole error is that of its own mobility, and a spacing that divides the
    box leaves no margin."""
    result = accuracy.GridStudy(accuracy.scenes.array(0.125), [1e-2], (0.8, 1.5)).run(rounds=1)
    for observable in grid.OBSERVABLES:
        rows = result.select(observable, 'spacing')
        print(observable, [f'{row["error"]/row["described"]:.3f}' for row in rows])
        assert len(rows) >= 2 and all(row['own_error'] <= row['described'] for row in rows)


def test_a_flow_that_drives_the_scene_does_not_matter(result):
    """The study compares products, which do not depend on the driven flow."""
    scene = accuracy.scenes.periodicSuspension(8, 0.1)
    system = openmm.XmlSerializer.clone(scene.system)
    fluid, = forces_of(system, MobilityForce)
    fluid.setSinusoidalForceDensity(2, 0, 1, 1)
    driven = accuracy.Scene(system, scene.positions, scene.makeIntegrator())
    row, = accuracy.GridStudy(driven, [1e-2], None, ['forces']).run(rounds=1).rows
    undriven = next(row for row in result.select('forces', 'tolerance') if row['setting'] == 1e-2)
    assert row['error'] == undriven['error'] > 0


def test_the_fineness_between_grids():
    rows = [{
        'observable': 'forces',
        'kind': 'spacing',
        'fineness': x,
        'described': 1,
        'error': np.exp(-(np.pi*x)**2)
    } for x in (0.7, 1.0, 1.5)]
    result = accuracy.GridResult({}, rows, {'forces': {}}, {})
    assert [round(result.finenessFor('forces', error), 6) for error in (1e-4, 1e-8)
            ] == [round(gridreport.gaussianFineness(error), 6) for error in (1e-4, 1e-8)]


def test_the_cheapest_tolerance_is_named(result):
    result = copy.deepcopy(result)
    for row in result.rows:
        if row['kind'] == 'tolerance':
            row['seconds_product'], row['error'] = 1e-3/row['setting']**0.1, row['setting']/2
    assert result.recommend('forces:1%').setting['tolerance'] == 1e-2
    assert result.recommend('forces:1%,wrenches:1e-5').setting['tolerance'] == 1e-6
    answer = result.recommend('forces:1e-9')
    # A tolerance is also rejected if only the error of random forces is too large.
    for row in result.rows:
        row['typical'] = max(row['typical'], 2e-4) if row['setting'] == 1e-4 else row['typical']
    assert result.recommend('forces:0.01%').setting['tolerance'] == 1e-6
    assert (answer.verdict == 'none of these'
            and 'The smallest error is 5.0e-07, with a tolerance of 1e-06.' in answer.text)
    with pytest.raises(ValueError, match='wanted error: got'):
        result.recommend('torques:1%')


def test_missed_tolerances_are_said(result):
    result = copy.deepcopy(result)
    assert any('every error is below its tolerance' in text
               for text in result.report().paragraphs())
    for row in result.rows:
        row['error'] = 3*row['described']
    text = '\n'.join(result.report().paragraphs())
    assert ('every error' not in text
            and 'the error is above the tolerance at 0.01 (3.0e-02)' in text
            and 'above the tolerance that describeEffects() says: sigma/dx' in text)


def test_command_line_and_files(tmp_path):
    def run(*arguments):
        with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(
                io.StringIO()) as error:
            status = cli.main([*arguments, '--quiet'])
        return status, out.getvalue(), error.getvalue()

    status, out, error = run('--grid', '--bodies', '3', '--tolerances', '1e-2,1e-4',
                             '--observables', 'forces', '--rounds', '1', '--wanted-error',
                             'forces:0.1%', '--output', str(tmp_path))
    assert status == 0, error
    assert ('a tolerance of 0.0001, with errors up to' in out
            and 'By lattice sums a product takes' in out)
    page = (tmp_path/'grid.html').read_text()
    assert 'src="data:image/png' in page and 'sqrt(ln 1/eps)/pi' in page and (
        tmp_path/'grid_forces.png').stat().st_size > 10000
    assert len((tmp_path/'grid.csv').read_text().splitlines()) > 5
    status, again, error = run('--from', str(tmp_path/'grid.json'), '--wanted-error', 'forces:0.1%',
                               '--output', str(tmp_path/'again'))
    assert status == 0 and again.split('Written')[0] == out.split('Written')[0]
    for arguments, message in ((['--tolerances',
                                 'x'], "--tolerances: got 'x', where a list of numbers is wanted"),
                               (['--observables', 'drag'], 'got the observables'),
                               (['--scene', 'pairs'], 'it must be one scene of spheres'), ([
                                   '--scene', 'suspension'
                               ], 'its fluid must be periodic'), (['--wanted-error',
                                                                   'drag:1%'], 'wanted error: got'),
                               (['--tolerances', '1'], 'setSolverTolerance() takes 1e-14 to 0.1')):
        status, _, error = run('--grid', '--bodies', '3', *arguments)
        assert status == 2 and message in error, error


def test_wrong_studies():
    scene = accuracy.scenes.periodicSuspension(3)
    with pytest.raises(ValueError, match='at least one of each is needed'):
        accuracy.GridStudy(scene, [])
    integrator = CustomRigidHIIntegrator(0, 1)
    fluid, integrator, context = accuracy.GridStudy(scene).makeContext(
        'forces', MobilityForce.Dense, 1e-2)
    with pytest.raises(ValueError, match='the fluid is on no grid'):
        grid.describedGrid(integrator)


def test_a_grid_that_cannot_be_made_is_a_row_without_errors():
    """A sphere is so small that the grid for the finest tolerance is too large for any machine."""
    scene = accuracy.scenes.spheres([(0, 0, 0), (500, 0, 0)], 0.05, edges=(1000,)*3)
    result = accuracy.GridStudy(scene, [1e-2], None, ['forces']).run(rounds=1)
    assert result.rows[0]['status'] == 'not applicable' and 'nodes along an edge' in result.rows[0][
        'message']
    assert 'No grid could be used' in result.recommend(
        'forces:1%').text and 'cannot be used: ' in '\n'.join(result.report().paragraphs())
    assert result.report().textTable()
