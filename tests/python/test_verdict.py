"""validation/verdict.py writes its page, and its verdicts on made-up numbers are right."""
import importlib
import pathlib

import pytest

FOLDER = pathlib.Path(__file__).resolve().parents[2]/'validation'


@pytest.fixture
def verdict(monkeypatch):
    monkeypatch.syspath_prepend(str(FOLDER))
    return importlib.import_module('verdict')


def test_the_page_is_what_the_script_writes(verdict):
    assert (FOLDER/'README.md').read_text() == verdict.page(), 'run validation/verdict.py'


def test_differences(verdict):
    assert verdict.compared((1.0, 0.3), (2.5, 0.4)) == ('+3.0', 'disagrees')
    assert verdict.compared((1.0, 0.3), (2.49, 0.4), 'a reason') == ('+3.0', 'agrees')
    assert verdict.compared((3.0, 0.1), (2.0, 0.0), 'a reason') == ('-10.0', 'disagrees: a reason')
    # A constant that is not measured well cannot agree, but may disagree.
    assert verdict.constant((0.1, 0.01), (0.2, 0.2))[1].startswith('not reached')
    assert verdict.constant((0.1, 0.01), (0.2, 0.05))[1] == 'agrees' and verdict.constant(
        (0.1, 0.01), (2.0, 0.2))[1] == 'disagrees'
    # Rounding to hundredths hides a uniform distribution of that width.
    assert verdict.printed('2.21') == (2.21, pytest.approx(
        0.01/12**0.5)) and verdict.printed('7')[1] == pytest.approx(1/12**0.5)


def test_every_row_has_a_verdict_and_every_paper_its_folder(verdict):
    for folder, rows, *_ in verdict.PAPERS:
        assert (FOLDER/folder/'README.md').exists()
        for row in rows():
            assert len(row) == 7 and any(
                cell.startswith(('agrees', 'disagrees', 'not reached: ')) for cell in row[5:]), row
    studies = [folder for folder, _ in verdict.STUDIES]
    assert all((FOLDER/folder/'README.md').exists() for folder in studies)
    pages = {path.name for path in FOLDER.iterdir() if (path/'README.md').exists()}
    assert pages == {folder
                     for folder, *_ in verdict.PAPERS}.union(folder for folder in studies
                                                             if '/' not in folder)


def test_maxima(verdict):
    """A maximum exceeds three bins on either side. Of equal neighbours both count, and an edge is
    no maximum."""
    found = {'edges': [float(k) for k in range(11)], 'P': [9, 1, 2, 1, 5, 1, 1, 1, 2, 1]}
    assert verdict.maxima(found) == [(4.5, 5), (8.5, 2)]
    assert [x for x, _ in verdict.maxima(found, reach=1)] == [2.5, 4.5, 6.5, 8.5]
