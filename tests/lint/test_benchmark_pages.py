"""The tables of benchmarks and pages are those of the results in the repository, of one run."""
import datetime
import json
import pathlib
import sys

import pytest

ROOT = pathlib.Path(__file__).parents[2]
sys.path.insert(0, str(ROOT/'benchmarks'))

import page  # noqa: E402
import run  # noqa: E402

#: Results that answer other questions than the run does, on other machines or beside other builds.
OTHERS = {'auto_choice_walls', 'gpu', 'two_builds'}
RUN = json.loads((page.RESULTS/'run.json').read_text())
FILES = [
    file for file in sorted(page.RESULTS.rglob('*.json'))
    if file.stem not in OTHERS and file.stem != 'run'
]


@pytest.mark.parametrize('name', page.PAGES)
def test_tables_are_those_of_the_results(name):
    missing = []
    text = (ROOT/name).read_text()
    assert page.TABLE.search(text), f'{name} has no table'
    assert page.filled(text, page.Results(page.RESULTS), missing) == text, \
        f'run benchmarks/page.py: tables of {name} are not those of benchmarks/results'
    assert not missing


def test_every_table_has_a_page():
    used = {
        match.group(2)
        for name in page.PAGES for match in page.TABLE.finditer((ROOT/name).read_text())
    }
    tables = {
        name
        for name, function in vars(page).items() if getattr(function, '__code__', None)
        and function.__code__.co_varnames[:function.__code__.co_argcount] == ('results',)
    }
    assert used == tables


def test_the_run_had_all_parts():
    parts = [(part, False) for part in run.PARTS.split('\n')[1:-1]]
    if RUN['machine']['avx512']:
        parts += [(part, True) for part in run.AVX2_PARTS.split('\n')[1:-1]]
    assert [(each['part'], each['avx2']) for each in RUN['parts']] == parts
    assert not [each['part'] for each in RUN['parts'] if each['failed']]
    assert RUN['seconds'] < 3*3600


@pytest.mark.parametrize('file', FILES, ids=[str(f.relative_to(page.RESULTS)) for f in FILES])
def test_results_are_of_one_run(file):
    def moment(date):
        return datetime.datetime.strptime(date, '%Y-%m-%d %H:%M UTC')

    own, first = json.loads(file.read_text())['machine'], RUN['machine']
    assert moment(first['date']) <= moment(own['date']) <= moment(RUN['ended'])
    for key in ('processor', 'cores', 'avx512', 'python', 'openmm', 'openmmrigidhi'):
        assert own[key] == first[key]
    assert own['kept_to_avx2'] == (file.parent.name == 'avx2')
