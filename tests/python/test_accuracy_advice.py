"""openmmrigidhi.accuracy: what a report advises follows from its answer, of each kind."""
import copy
import re
from html import unescape

import numpy as np
import pytest
from price_records import OBSERVABLE, REFERENCE, knownResult

from openmmrigidhi.accuracy import GridResult, LadderResult
from openmmrigidhi.accuracy.gridreport import GridReport
from openmmrigidhi.accuracy.ladderreport import LadderReport
from openmmrigidhi.accuracy.pricereport import PriceReport
from openmmrigidhi.accuracy.report import StudyReport
from openmmrigidhi.accuracy.result import Reference
from openmmrigidhi.accuracy.statistics import Extrapolation

NAMES = ('recommended', 'none of these', 'cannot tell')


def study(*errors, sigma=1e-6, reference=None, **changes):
    """A study with these errors at 4 and 200 fs; changes are made to the rows of all settings."""
    result = knownResult([('LangevinC', 4*50**k, error, 20, 1) for k, error in enumerate(errors)],
                         sigma=sigma)
    for row in result.rows:
        row.update(changes)
    if reference is not None:
        result.references = {OBSERVABLE: reference} if reference else {}
        for row in result.rows:
            result._compare(row)
    return result


def extrapolated(error):
    """A limit of small steps whose model may be wrong by this."""
    fit = Extrapolation(REFERENCE, error, np.array([]), {}, [], 0.0, 1, 0.5, '', error)
    return Reference(OBSERVABLE, REFERENCE, error, 'extrapolated', fit, [])


GIVEN = Reference(OBSERVABLE, REFERENCE, 0.1, 'given')
UNSTABLE = dict(status='unstable', mean=None, ns_per_day=None, speeds=[], error=None)
NO_MEAN = dict(mean=None, error=None, noise=None, note='n/a')
#: (verdict, reason): a study in which 0.5 kJ/mol is wanted.
STUDIES = {
    ('recommended', 'decided'): study(0.0, 3.0),
    ('recommended', 'longer runs decide'): study(0.0, 0.45, sigma=0.05),
    ('recommended', 'longer runs hardly decide'): study(0.0, 0.499, sigma=0.05),
    ('recommended', 'the limit of small steps'): study(0.0, 0.4, reference=extrapolated(0.1)),
    ('recommended', 'the reference'): study(0.0, 0.4, reference=GIVEN),
    ('none of these', 'decided'): study(2.0, 3.0),
    ('none of these', 'nothing could be used'): study(0.0, 0.0, **UNSTABLE),
    ('cannot tell', 'longer runs decide'): study(0.45, 3.0, sigma=0.3),
    ('cannot tell', 'longer runs hardly decide'): study(0.5, 3.0, sigma=0.05),
    ('cannot tell', 'the limit of small steps'): study(0.4, 3.0, reference=extrapolated(0.1)),
    ('cannot tell', 'the reference'): study(0.4, 3.0, reference=GIVEN),
    ('cannot tell', 'nothing to compare with'): study(0.0, 0.0, reference=False),
    ('cannot tell', 'no mean'): study(0.0, 0.0, **NO_MEAN)
}
#: What only the advice and the answer of this reason may say.
REMEDIES = {
    'longer runs decide': 'times as long',
    'longer runs hardly decide': 'no study of a sensible length',
    'the limit of small steps': 'limit of small steps',
    'the reference': 'more accurate reference',
    'nothing to compare with': 'there is no value',
    'no mean': 'why there is no mean'
}


def whatToDo(page):
    """The texts of a page under "How sure it is" and "What to do"."""
    return unescape(
        re.search('How sure it is</h2>(.*?)</div>|How sure it is</h2>(.*?)<h2 id="(?!what-to-do)',
                  page, re.S).group(0))


@pytest.mark.parametrize('kind', ['wanted', 'price'])
@pytest.mark.parametrize('verdict, reason', STUDIES)
def test_advice_follows_from_the_answer(verdict, reason, kind):
    result = STUDIES[verdict, reason]
    report = result.report(**{kind: [f'{OBSERVABLE}:0.5']})
    answer, = report.answers if kind == 'wanted' else report.priced.answers
    assert (answer.verdict, answer.reason) == (verdict, reason)
    (sure,), (todo,) = report.advice()
    for text in sure, todo:
        assert text in whatToDo(report.page({}))
    # Longer runs are advised where a factor is named, which is the same in both texts.
    found = [
        re.findall(pattern, text)
        for pattern, text in (('run longer: about ([0-9.]+) times', answer.text),
                              ('about ([0-9.]+) times as long', todo))
    ]
    assert found[0] == found[1] and len(found[0]) == (reason == 'longer runs decide')
    if found[0]:
        assert float(found[0][0]) == pytest.approx(max(1.1, answer.factor), rel=0.06)
    elif reason != 'no mean':  # too few samples are the only other reason for longer runs
        assert '--budget' not in todo
    for other, words in REMEDIES.items():
        if other == reason:
            assert words.lower() in (sure + todo).lower()
        elif other != 'the limit of small steps':
            assert words not in todo
    if 'longer runs will not decide it' in answer.text:
        assert reason in ('the limit of small steps', 'the reference')


@pytest.mark.parametrize('report', [StudyReport, PriceReport])
def test_each_kind_of_answer_has_an_advice_and_no_other(report):
    assert set(report.ADVICE) == set(STUDIES)


def test_answers_that_differ_are_told_apart():
    result = study(0.0, 0.45, sigma=0.05)
    report = result.report([f'{OBSERVABLE}:0.5', f'{OBSERVABLE}:3', f'{OBSERVABLE}:4'])
    sure, todo = report.advice()
    assert len(sure) == 1 and sure[0].startswith('The recommended setting has')
    assert todo[0].startswith('For 0.5 kJ/mol of potential energy: Use the recommended scheme and '
                              'step. A study that is about 2.7 times as long')
    assert todo[1] == ('For 3 kJ/mol of potential energy; 4 kJ/mol of potential energy: Use the '
                       'recommended scheme and step.')


def test_factors_are_written_with_two_digits():
    for sigma, text in ((0.04, '1.7'), (0.05, '2.7'), (0.3, '97'), (0.9, '880')):
        answer = study(0.0, 0.45, sigma=sigma).recommend(f'{OBSERVABLE}:0.5')
        alone = study(0.45, sigma=sigma).recommend(f'{OBSERVABLE}:0.5')
        assert f'run longer: about {text} times' in alone.text
        assert answer.reason == 'longer runs decide'


def test_the_reference_is_blamed_only_where_it_is_the_reason():
    """An error at the limit stays there however well the reference is known."""
    for reference in (GIVEN, extrapolated(0.1)):
        assert study(0.5, reference=reference).recommend(
            f'{OBSERVABLE}:0.5').reason == 'longer runs hardly decide'
    # A wanted error far below that of the reference.
    result = study(0.0, reference=GIVEN)
    assert result.recommend(f'{OBSERVABLE}:1e-4').reason == 'the reference'


def test_settings_that_cannot_be_judged_are_said():
    result = study(2.0, 3.0)
    result.rows[0].update(NO_MEAN)
    for answer, text in ((result.recommend(f'{OBSERVABLE}:0.5'), 'no mean, or nothing to compare '
                          'with, for LangevinC at 4 fs'), (result.price(f'{OBSERVABLE}:0.5'),
                                                           'Nothing can be said about LangevinC at '
                                                           '4 fs')):
        assert (answer.verdict, answer.reason) == ('none of these', 'decided')
        assert 'every stable setting that can be judged' in answer.text.lower()
        assert text in answer.text


def test_infinite_factors_are_null_in_json(tmp_path):
    STUDIES['cannot tell', 'the reference'].write(str(tmp_path), [f'{OBSERVABLE}:0.5'])
    assert 'Infinity' not in (tmp_path/'results.json').read_text()


# ---- The ladder and the grid ---------------------------------------------------------------------


def ladder(*rungs):
    """A ladder with these rungs: (error or None, believed, status), from cheap to dear."""
    names = [f'rung{k}' for k in range(len(rungs))]
    rows = [{
        'parameter': 0,
        'rung': name,
        'observable': 'mobility',
        'status': status,
        'message': '',
        'error': error,
        'value': 1.0,
        'believed': believed,
        'is_reference': False,
        'seconds_step': seconds,
        'platform': 'CPU'
    } for seconds, (name, (error, believed, status)) in enumerate(zip(names, rungs), 1)]
    return LadderResult({'name': 'x'}, None, rows, {}, {'mobility': {
        'label': 'mobility'
    }}, dict.fromkeys(names, ''), {})


def unusable(result):
    for row in result.rows:
        row['seconds_step'] = None
    return result


LADDERS = {
    ('recommended', 'decided'): ladder((0.001, 0.001, 'stable')),
    ('recommended', 'the reference'): ladder((0.01, 0.001, 'stable'), (0.001, 0.001, 'stable')),
    ('none of these', 'decided'): ladder((0.1, 0.001, 'stable'), (None, None, 'not applicable')),
    ('none of these', 'nothing could be used'): unusable(ladder((None, None, 'not applicable'))),
    ('cannot tell', 'the reference'): ladder((0.01, 0.001, 'stable')),
    ('cannot tell', 'nothing to compare with'): ladder((None, None, 'stable'))
}


def grid(*errors):
    """A grid study with these errors; None: the grid could not be used."""
    rows = [{
        'observable': 'forces',
        'kind': 'tolerance',
        'setting': 10.0**-k,
        'error': error,
        'typical': error,
        'seconds_product': 1.0 + k,
        'nodes': '8 x 8 x 8'
    } for k, error in enumerate(errors, 1)]
    return GridResult({}, rows, {'forces': {'label': 'forces'}}, {})


GRIDS = {
    ('recommended', 'decided'): grid(0.1, 0.001),
    ('none of these', 'decided'): grid(0.1, None),
    ('none of these', 'nothing could be used'): grid(None)
}


@pytest.mark.parametrize('studies, kind, wanted', [(LADDERS, LadderReport, 'mobility:1%'),
                                                   (GRIDS, GridReport, 'forces:1%')],
                         ids=['ladder', 'grid'])
def test_advice_of_ladders_and_grids(studies, kind, wanted):
    assert set(kind.ADVICE) == set(studies)
    for (verdict, reason), result in studies.items():
        report = copy.deepcopy(result).report([wanted])
        answer, = report.answers
        assert (answer.verdict, answer.reason) == (verdict, reason), answer.text
        assert report.advice() == tuple([text] for text in kind.ADVICE[verdict, reason])
        assert ('finer multiblob' in report.advice()[1][0]) == (reason == 'the reference')
        assert ('could be used' in answer.text) == (reason == 'nothing could be used')
