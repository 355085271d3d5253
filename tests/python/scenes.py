"""Small Systems for the Python tests."""
import numpy as np
import openmm
import pytest
from openmm import app, unit

import openmmrigidhi
from openmmrigidhi import CustomRigidHIIntegrator


class WaterBox:
    """TIP4P-Ew waters on a cubic lattice, randomly oriented, at the density of water, with a
    reaction field."""
    def __init__(self, side, rigidWater=True, nonbondedMethod=app.CutoffPeriodic, seed=1):
        spacing = (18.015/(0.997*602.2))**(1/3)  # nm; 0.997 g/mL
        self.box = side*spacing
        self.numWaters = side**3
        forceField = app.ForceField('tip4pew.xml')
        modeller = app.Modeller(*_lattice(side, spacing, np.random.default_rng(seed)))
        modeller.addExtraParticles(forceField)
        self.topology, self.positions = modeller.topology, modeller.positions
        # With so short a cutoff, dispersion must be switched off smoothly: a jump of 0.4 kJ/mol
        # stops any minimiser.
        self.system = forceField.createSystem(self.topology, nonbondedMethod=nonbondedMethod,
                                              removeCMMotion=False, nonbondedCutoff=0.45*self.box,
                                              switchDistance=0.35*self.box, rigidWater=rigidWater)

    def integrator(self, temperature=300, stepSize=0.002, seed=1):
        integrator = openmmrigidhi.CustomRigidHIIntegrator(temperature, stepSize)
        openmmrigidhi.app.addRigidWater(integrator, self.topology)
        integrator.setRandomNumberSeed(seed)
        return integrator

    def simulation(self, platform, integrator=None):
        simulation = app.Simulation(self.topology, self.system, integrator or self.integrator(),
                                    platform)
        simulation.context.setPositions(self.positions)
        return simulation


def _lattice(side, spacing, random):
    """Topology and positions (nm) of side^3 three-site waters."""
    topology = app.Topology()
    topology.setPeriodicBoxVectors(np.eye(3)*side*spacing*unit.nanometer)
    chain = topology.addChain()
    angle = np.deg2rad(104.52)
    shape = 0.09572*np.array([(0, 0, 0), (1, 0, 0), (np.cos(angle), np.sin(angle), 0)])
    positions = []
    for cell in np.ndindex(side, side, side):
        residue = topology.addResidue('HOH', chain)
        oxygen, *hydrogens = [
            topology.addAtom(name, app.Element.getBySymbol(name[0]), residue)
            for name in ('O', 'H1', 'H2')
        ]
        for hydrogen in hydrogens:
            topology.addBond(oxygen, hydrogen)
        rotation = np.linalg.qr(random.normal(size=(3, 3)))[0]
        positions.extend((np.array(cell) + 0.5)*spacing + shape @ rotation)
    return topology, np.array(positions)*unit.nanometer


def dumbbells(count, spacing=1.0):
    """A System without forces of two-particle molecules, no constraints, with positions (nm) and
    explicit definitions.

    Each entry of the definitions is what addRigidBody() takes.
    """
    system = openmm.System()
    positions, definitions = [], []
    for k in range(count):
        particles = [system.addParticle(2.0), system.addParticle(2.0)]
        positions += [(spacing*k, 0, 0), (spacing*k, 0, 0.2)]
        definitions.append((particles, 4.0, (0.04, 0.04, 0.0), [(0, 0, -0.1), (0, 0, 0.1)]))
    return system, np.array(positions), definitions


def positionsOf(context, **options):
    return context.getState(getPositions=True, **options).getPositions(asNumpy=True)._value


def energyOf(context):
    return context.getState(getEnergy=True).getPotentialEnergy()._value


def mixedBox(platform, numBodies=14):
    """Waters, some as bodies, the others as free particles that are held by constraints."""
    box = WaterBox(3)
    integrator = CustomRigidHIIntegrator(300, 0.002)
    for residue in list(box.topology.residues())[:numBodies]:
        integrator.addRigidBody([atom.index for atom in residue.atoms()])
    return box, box.simulation(platform, integrator)


def checkShapes(box, context, tolerance):
    positions = positionsOf(context)
    for i in range(box.system.getNumConstraints()):
        first, second, distance = box.system.getConstraintParameters(i)
        assert np.linalg.norm(positions[first] - positions[second]) == pytest.approx(
            distance._value, rel=tolerance)
    before = positions.copy()
    context.computeVirtualSites()
    assert np.allclose(positionsOf(context), before, rtol=0, atol=1e-7)
