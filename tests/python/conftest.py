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


@pytest.fixture(scope='session')
def waterBox():
    """27 waters in a box of about 0.93 nm."""
    return WaterBox(3)
