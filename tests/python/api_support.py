"""Integrators for the tests of the Python API."""
import openmm
from openmm import unit

from openmmrigidhi import CustomRigidHIIntegrator
from scenes import dumbbells

SITES = [(0, 0, -0.1), (0, 0, 0.1)]


def make():
    return CustomRigidHIIntegrator(300, 0.002)


def makeWithBodies():
    """Body 0 is implicit, body 1 explicit."""
    integrator = make()
    integrator.addRigidBody([0, 1, 2])
    integrator.addRigidBody([3, 4], 4.0, (0.04, 0.04, 0.0), SITES)
    return integrator


def bound(platform, count=2):
    system, positions, definitions = dumbbells(count)
    integrator = make()
    for definition in definitions:
        integrator.addRigidBody(*definition)
    context = openmm.Context(system, integrator, platform)
    context.setPositions(positions)
    return integrator, context


def plain(value):
    return value._value if unit.is_quantity(value) else value
