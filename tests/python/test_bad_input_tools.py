"""Bad arguments of openmmrigidhi.app, and attributes that are not there."""
import re

import numpy as np
import openmm
import pytest
from openmm import app

import openmmrigidhi


def refused(*pieces, error=ValueError):
    return pytest.raises(error, match='.*'.join(re.escape(piece) for piece in pieces))


def test_residues_that_are_not_there():
    topology = app.Topology()
    residue = topology.addResidue('ALA', topology.addChain())
    topology.addAtom('C', app.Element.getBySymbol('C'), residue)
    integrator = openmmrigidhi.CustomRigidHIIntegrator(300, 0.001)
    with refused('addRigidWater: topology: no residue has a name that means water',
                 "the topology has ALA: give the residue names of water as names=['...']"):
        openmmrigidhi.app.addRigidWater(integrator, topology)
    with refused('addRigidResidues: names: no residue is named LIG', 'the topology has ALA'):
        openmmrigidhi.app.addRigidResidues(integrator, topology, ['LIG'])
    with refused('addRigidResidues: names: got the string', "give ['ALA']", error=TypeError):
        openmmrigidhi.app.addRigidResidues(integrator, topology, 'ALA')
    with refused('addRigidWater: names: got the string', "give ['ALA']", error=TypeError):
        openmmrigidhi.app.addRigidWater(integrator, topology, names='ALA')


def test_a_residue_of_two_waters(waterBox):
    topology = app.Topology()
    residue = topology.addResidue('HOH', topology.addChain())
    for symbol in 'OHHOHH':
        topology.addAtom(symbol, app.Element.getBySymbol(symbol), residue)
    integrator = openmmrigidhi.CustomRigidHIIntegrator(300, 0.001)
    with refused('addRigidWater: residue HOH 1 has 4 H, 2 O', 'each residue must be one water'):
        openmmrigidhi.app.addRigidWater(integrator, topology)
    with refused('addRigidResidues: topology: it has 6 atoms, and the System has 0 particles',
                 'the atoms must be all particles, or all that are no virtual sites'):
        openmmrigidhi.app.addRigidResidues(integrator, topology, ['HOH'], openmm.System())


@pytest.mark.parametrize('tolerance', [0, -1, np.nan, np.inf])
def test_a_bad_tolerance_of_the_minimiser(tolerance):
    with refused('minimize: tolerance: got', 'kJ/(mol nm); it must be finite and positive'):
        openmmrigidhi.app.minimize(None, tolerance=tolerance)


def test_a_minimisation_from_infinite_energy(platform):
    system = openmm.System()
    force = openmm.CustomExternalForce('sqrt(-1-x^2)')
    for particle in range(2):
        system.addParticle(1)
        force.addParticle(particle, [])
    system.addForce(force)
    integrator = openmmrigidhi.CustomRigidHIIntegrator(300, 0.001)
    integrator.addRigidBody([0, 1])
    context = openmm.Context(system, integrator, platform)
    context.setPositions([(0, 0, 0), (0.1, 0, 0)])
    with refused('minimize: energy at the start is', 'look for particles at the same place',
                 error=openmm.OpenMMException):
        openmmrigidhi.app.minimize(context)


def test_spheres_that_are_not_there():
    with refused('sphereShell: n: got 13; it must be one of 12, 42, 162, 642, 2562'):
        openmmrigidhi.app.sphereShell(13, 1)
    with refused('sphereShell: radius: got -1.0 nm; it must be finite and positive'):
        openmmrigidhi.app.sphereShell(12, -1)


def test_attributes_that_are_not_there():
    with refused("module 'openmmrigidhi' has no attribute 'hydrodynamics'", error=AttributeError):
        openmmrigidhi.hydrodynamics
