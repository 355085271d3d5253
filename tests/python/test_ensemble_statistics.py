"""openmmrigidhi.ensemble: means, errors, R-hat and effective samples of replicas."""
import json
import math
import types

import numpy as np
import pytest

from openmmrigidhi import ensemble
from openmmrigidhi.analysis import series as seriesModule
from openmmrigidhi.ensemble.result import EnsembleResult, TaskRecord


def test_means_and_errors_of_a_scene_whose_averages_are_known(tmp_path):
    """Two exact means are tested by Student's t of 6 replicas. With 5 degrees of freedom each
    exceeds 6.9 once in 1000."""
    study = ensemble.Study('trap', [{
        'bodies': 20
    }], 6, 10.0, ['energy_group_0', 'translational_temperature'], platform='Reference', seed=3)
    result = study.run(str(tmp_path/'study'), 2, 'processes', quiet=True)
    for row in result.rows:
        exact = 300.0 if row['exact'] is None else row['exact']
        t = (row['mean'] - exact)/row['standard_error']
        print(f'{row["observable"]}: t {t:.2f}, R-hat {row["r_hat"]:.4f}, '
              f'{row["effective_samples"]:.0f} effective samples')
        assert abs(t) < 6.9 and row['degrees'] == 5 and row['replicas'] == 6
        means = [result.series(row['observable'], 0, replica).mean() for replica in range(6)]
        assert row['mean'] == pytest.approx(np.mean(means), rel=1e-12)
        assert row['standard_error'] == pytest.approx(np.std(means, ddof=1)/math.sqrt(6), rel=1e-12)
        # 2.5706 is the 97.5 % point of Student's t at 5 degrees of freedom.
        assert row['high'] - row['mean'] == pytest.approx(2.5706*row['standard_error'], rel=1e-4)
        assert row['r_hat'] < 1.05
    lines = (tmp_path/'study'/'results.csv').read_text().splitlines()
    assert len(lines) == 3 and lines[0].startswith('setting,settings,observable')
    assert json.loads((tmp_path/'study'/'results.json').read_text())['rows'] == result.rows


def autoregressive(count, n, rho, rng):
    """Chains of variance 1 with autocorrelation rho^k."""
    noise = rng.normal(size=(n, count))
    chains = np.empty((n, count))
    chains[0] = noise[0]
    for k in range(1, n):
        chains[k] = rho*chains[k - 1] + math.sqrt(1 - rho*rho)*noise[k]
    return chains.T


def test_rhat_of_equal_chains_is_one():
    """For independent samples R-hat^2 - 1 is (B/W - 1)/n with B/W about F(7, inf). So R-hat exceeds
    1 + 24.3/7/n/2 once in 1000, and the folded R-hat too."""
    value = seriesModule.splitRHat(np.random.default_rng(1).normal(size=(4, 1000)))
    print(f'R-hat {value:.5f}')
    assert 0.999 < value < 1 + (24.3/7 - 1)/500/2 + 1e-3


def test_rhat_sees_means_widths_and_drifts():
    """R-hat of shifted chains has its exact value, and R-hat also detects widths and drifts.

    For two groups of chains at -d/2 and d/2 with small d, R-hat^2 is 1 + d^2/4 8/7.
    """
    rng = np.random.default_rng(2)
    chains = rng.normal(size=(4, 4000))
    d = 0.5
    shifted = chains + d*np.array([-0.5, -0.5, 0.5, 0.5])[:, None]
    # All normal scores together have variance 1. Of it d^2/4 of (1 + d^2/4) is between the halves
    # of chains, of which there are 8, with ddof 1.
    between = d*d/4/(1 + d*d/4)
    expected = math.sqrt(1 + 8/7*between/(1 - between))
    value = seriesModule.splitRHat(shifted)
    print(f'means: {value:.4f}, expected {expected:.4f}')
    assert value == pytest.approx(expected, abs=0.015)
    wide = chains*np.array([1, 1, 1, 3])[:, None]
    assert seriesModule._r_hat(
        seriesModule._normal_scores(wide)) < 1.01 < 1.1 < seriesModule.splitRHat(wide)
    assert seriesModule.splitRHat(chains[:1] + np.linspace(-1, 1, 4000)) > 1.2
    # R-hat depends only on ranks. So heavy tails, monotone functions and reflections do not change
    # it.
    bulk = seriesModule._r_hat(seriesModule._normal_scores(np.exp(5*shifted)))
    assert bulk == pytest.approx(seriesModule._r_hat(seriesModule._normal_scores(shifted)),
                                 rel=1e-12)


def test_rhat_by_hand():
    """The halves (1, 2), (3, 4), (5, 6), (7, 8) of two chains of four are their own ranks, which
    give the normal scores by hand."""
    from scipy.stats import norm
    chains = np.arange(1.0, 9).reshape(2, 4)
    z = norm.ppf((np.array([1, 2, 3, 4, 5, 6, 7, 8]) - 0.375)/8.25).reshape(4, 2)
    between, within = 2*np.var(z.mean(axis=1), ddof=1), np.var(z, axis=1, ddof=1).mean()
    assert seriesModule.splitRHat(chains) == pytest.approx(
        math.sqrt((0.5*within + between/2)/within), rel=1e-12)
    assert math.isnan(seriesModule.splitRHat(np.ones((2, 8))))
    with pytest.raises(ValueError, match='there must be rows of at least 4 samples'):
        seriesModule.splitRHat([[1, 2, 3]])


def test_effective_samples_of_autoregressive_chains():
    """For rho = 0.8, tau is 1/2 + 0.8/0.2 = 4.5, so 40000 samples are 4444 independent ones.

    The relative error of tau is sqrt(2 (2 W + 1)/n) = 0.05 with the window W = 5 tau, for n = 40000
    samples in all. Three times this error is allowed.
    """
    chains = autoregressive(4, 10000, 0.8, np.random.default_rng(3))
    found = seriesModule.independentRuns(chains)
    print(f'effective samples {found.effectiveSamples:.0f} of 4444')
    assert found.effectiveSamples == pytest.approx(
        40000/9, rel=0.15) and found.samples == 40000 and found.degrees == 3


def test_students_errors_cover_the_truth():
    """With 4 chains (3 degrees of freedom), t exceeds 3.182 in 5 % of 1000 studies. Four times the
    standard error of 0.7 % is allowed."""
    rng = np.random.default_rng(4)
    beyond = 0
    for _ in range(1000):
        found = seriesModule.independentRuns(rng.normal(size=(4, 50)))
        beyond += abs(found.mean) > 3.182*found.standardError
    print(f'{beyond} of 1000 beyond')
    assert 22 <= beyond <= 78


def test_stuck_replicas_have_an_infinite_rhat():
    """Replicas that never move, each at a value of its own, disagree as much as replicas can. Equal
    up to rounding they say nothing."""
    stuck = np.array([1.0, 1.0, 2.0])[:, None] + np.zeros((3, 8))
    assert seriesModule.splitRHat(stuck) == math.inf
    assert seriesModule.independentRuns(stuck).rHat == math.inf
    assert math.isnan(seriesModule.splitRHat(np.array([[0.3]*8, [0.1 + 0.2]*8])))
    # Two values that all chains visit have one distance from their median. Halves of 50 with the
    # same mean give sqrt(1 - 1/50).
    assert seriesModule.splitRHat(np.tile([0.0, 1.0],
                                          (4, 50))) == pytest.approx(math.sqrt(49/50), rel=1e-12)


def test_a_table_and_files_of_stuck_replicas(tmp_path):
    """JSON has no infinity, so that parsers that follow its rules would refuse the file."""
    contents = {(0, k): types.SimpleNamespace(
        series={'u': np.full(8, float(k))}, about={
            'sample_interval': 1.0,
            'exact': {},
            'position': 8,
            'samples': 8,
            'sessions': []
        })
                for k in range(3)}
    records = [TaskRecord(0, k, {}, 1, '', 'complete') for k in range(3)]
    found = EnsembleResult({'settings': [{}]}, {'u': {
        'label': 'u',
        'unit': 'kJ/mol'
    }}, records, contents, {'sessions': []})
    row, = found.rows
    assert row['r_hat'] == math.inf and 'stuck at a value of its own' in row['note']
    assert ' inf ' in found.table()
    json_, csv_ = found.write(str(tmp_path))

    def refuse(name):
        raise AssertionError(f'{name} is no number of JSON')

    with open(json_) as file:
        read, = json.load(file, parse_constant=refuse)['rows']
    assert read['r_hat'] is None and 'infinite' in read['note']
    with open(csv_) as file:
        assert ',inf,' in file.read()


def test_replicas_that_disagree_have_few_effective_samples():
    """Four chains of 1000 with the means 0, 0, 5, 5 know their mean to sqrt(25/3/4); samples of
    variance 1 + 25/4 that are independent know it as well if they are 3.5."""
    chains = np.random.default_rng(6).normal(size=(4, 1000)) + np.array([0, 0, 5, 5])[:, None]
    found = seriesModule.independentRuns(chains)
    # The means are known to 0.03, which is 1 % of their differences.
    assert found.effectiveSamples == pytest.approx((1 + 25/4)/(25/3/4), rel=0.05)


def test_runs_of_unequal_lengths_and_single_ones():
    rng = np.random.default_rng(5)
    found = seriesModule.independentRuns([rng.normal(size=100), rng.normal(size=60)])
    assert found.samples == 160 and found.degrees == 1 and found.rHat is not None
    single = seriesModule.independentRuns([rng.normal(size=100)])
    assert single.degrees > 3 and single.standardError == pytest.approx(0.1, rel=0.5)
    assert seriesModule.independentRuns([[1.0, 2.0]]).rHat is None
    with pytest.raises(ValueError, match='at least one run of 2 is needed'):
        seriesModule.independentRuns([])
