"""Fixtures of all Python tests: run them with PYTHONPATH=<build>/python."""
import openmm
import pytest

import openmmrigidhi
from scenes import WaterBox

PLATFORMS = ('Reference', 'CPU')


@pytest.fixture(params=PLATFORMS)
def platform(request):
    """Each platform in turn."""
    openmmrigidhi.checkPlatform(request.param)
    return openmm.Platform.getPlatformByName(request.param)


@pytest.fixture(scope='module')
def shortTimes():
    """Studies of accuracy measure speeds for a moment only, where no test compares them."""
    with pytest.MonkeyPatch.context() as patch:
        for name in ('TRIAL_SECONDS', 'TIMING_SECONDS'):
            patch.setattr(f'openmmrigidhi.accuracy.study.{name}', 0.02)
        yield


@pytest.fixture
def blankPictures(monkeypatch):
    """A function; after its call pictures are files, but nothing is drawn.

    A drawing takes a second. For tests of other things, beside tests that draw the same pictures.
    """
    def blank():
        monkeypatch.setattr('matplotlib.figure.Figure.savefig',
                            lambda self, file, **options: file.write(b'\x89PNG\r\n\x1a\n'))

    return blank


@pytest.fixture(scope='session')
def waterBox():
    """27 waters in a box of about 0.93 nm."""
    return WaterBox(3)
