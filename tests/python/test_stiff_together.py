"""Steps that do not resolve forces by which bodies relax faster together than each alone."""
import re

import numpy as np
import openmm
import openmmrigidhi
import pytest
from openmmrigidhi import app

ETA, KT = 536.0, 298*8.31446261815324e-3
MOBILITY = 1/(6*np.pi*ETA)
WARNING = re.compile(r'the step of .* is ([0-9.]+) times the time in which body')


def chain(platform, beads, relaxation, scheme='EulerMaruyama', spread=0.1, seed=1, replicas=1):
    """Beads that touch, in chains; the step over the relaxation of two of them along their bond."""
    stiffness = KT/spread**2
    # Rotne-Prager-Yamakawa: the mobility of the distance of two touching spheres.
    step = relaxation/(stiffness*2*MOBILITY*(1 - 0.75*(1 - 1/6)))
    system, fluid = openmm.System(), openmmrigidhi.MobilityForce()
    integrator = openmmrigidhi.CustomRigidHIIntegrator(298, step)
    integrator.setScheme(scheme)
    integrator.setRandomNumberSeed(seed)
    bonds = openmm.HarmonicBondForce()
    for i in range(beads*replicas):
        app.addRigidMultiblob(system, integrator, fluid, [(0, 0, 0)], 1.0)
        if i % beads:
            bonds.addBond(i - 1, i, 2.0, stiffness)
    fluid.setViscosity(ETA)
    fluid.setGroups([i // beads for i in range(beads*replicas)])
    system.addForce(fluid)
    system.addForce(bonds)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName(platform))
    context.setPositions([(2.0*(i % beads), 0, 0) for i in range(beads*replicas)])
    return context, integrator


@pytest.mark.parametrize('platform', ['Reference', 'CPU'])
@pytest.mark.parametrize('scheme', ['EulerMaruyama', 'FixmanMidpoint'])
@pytest.mark.parametrize('beads', [2, 12])
def test_a_bond_that_steps_do_not_resolve(platform, scheme, beads, capfd):
    """The measure is right to a fifth where one bond decides."""
    # Of chains the fastest mode is up to twice as fast, and long steps diverge.
    relaxation = 0.9 if beads == 2 else {'EulerMaruyama': 0.5, 'FixmanMidpoint': 0.7}[scheme]
    context, integrator = chain(platform, beads, relaxation, scheme)
    integrator.step(6000)
    said = WARNING.search(integrator.getEffects()['warnings'])
    assert said and capfd.readouterr().err.count('does not resolve these forces') == 1
    if beads == 2:
        assert float(said.group(1)) == pytest.approx(0.9, rel=0.2)


@pytest.mark.parametrize('platform', ['Reference', 'CPU'])
@pytest.mark.parametrize('beads', [2, 12])
def test_bonds_that_steps_resolve_get_no_warning(platform, beads):
    """Of 100 pairs, and of chains, whose fastest mode is at most twice as fast."""
    relaxation = 0.35 if beads == 2 else 0.2
    context, integrator = chain(platform, beads, relaxation, replicas=200 // beads)
    integrator.step(8000)
    assert integrator.getEffects()['warnings'] == 'off: none'


@pytest.mark.parametrize('relaxation, warns', [(0.7, False), (8, True)])
def test_collisions(relaxation, warns, capfd):
    """Spheres in a wide trap meet; the step over the time in which their repulsion parts them."""
    stiffness = 2000.0
    system, fluid = openmm.System(), openmmrigidhi.MobilityForce()
    step = relaxation/(stiffness*2*MOBILITY*(1 - 0.75*(1 - 1/6)))
    integrator = openmmrigidhi.CustomRigidHIIntegrator(298, step)
    integrator.setScheme('EulerMaruyama')
    integrator.setRandomNumberSeed(5)
    repulsion = openmm.CustomNonbondedForce(f'step(2.1 - r)*{stiffness/2}*(2.1 - r)^2')
    trap = openmm.CustomExternalForce('0.1*(x^2 + y^2 + z^2)')
    for _ in range(6):
        body = app.addRigidMultiblob(system, integrator, fluid, [(0, 0, 0)], 1.0)
        repulsion.addParticle([])
        trap.addParticle(body, [])
    fluid.setViscosity(ETA)
    for force in (fluid, repulsion, trap):
        system.addForce(force)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setPositions([(3*(i % 3), 3*(i // 3), 0) for i in range(6)])
    integrator.step(10000)
    printed = capfd.readouterr().err
    assert printed.count('does not resolve these forces') == warns, printed


def test_a_step_that_did_not_resolve_forces_stays_known():
    """Bonds break at the start of this run; then nothing is stiff any more."""
    context, integrator = chain('Reference', 2, 0.9)
    integrator.step(3000)
    assert WARNING.search(integrator.getEffects()['warnings'])
    bonds = context.getSystem().getForce(1)
    bonds.setBondParameters(0, 0, 1, 2.0, 0.01)
    bonds.updateParametersInContext(context)
    integrator.step(40000)
    assert 'was for some time' in integrator.getEffects()['warnings']
    context.setPositions([(0, 0, 0), (2, 0, 0)])
    integrator.step(1000)
    assert integrator.getEffects()['warnings'] == 'off: none'


def test_rods_that_a_bond_between_their_ends_turns():
    """The bond relaxes by J N J^T k with its derivatives J by positions and turns of both rods."""
    # In steps so short that rods hardly turn, the bond has one direction.
    stiffness, rods, end = KT/0.02**2, 2, 2
    system, fluid = openmm.System(), openmmrigidhi.MobilityForce()
    integrator = openmmrigidhi.CustomRigidHIIntegrator(298, 0.1)
    integrator.setScheme('FixmanMidpoint')
    integrator.setRandomNumberSeed(2)
    for _ in range(rods):
        app.addRigidMultiblob(system, integrator, fluid, app.rod(3, 2.0), 1.0)
    bond = openmm.HarmonicBondForce()
    bond.addBond(end, 3, 2.0, stiffness)
    fluid.setViscosity(ETA)
    system.addForce(fluid)
    system.addForce(bond)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    app.placeBodies(context, [(0, 0, 0), (6, 0, 0)])

    def rate():
        x = context.getState(getPositions=True).getPositions(asNumpy=True)._value
        R = integrator.getBodyPositions()._value
        n = (x[end] - x[3])/np.linalg.norm(x[end] - x[3])
        J = np.concatenate([n, np.cross(x[end] - R[0], n), -n, -np.cross(x[3] - R[1], n)])
        return stiffness*J @ fluid.getMobilityInContext(context) @ J

    integrator.step(2000)
    integrator.setStepSize(0.9/np.mean([(integrator.step(500), rate())[1] for _ in range(100)]))
    rates = [(integrator.step(60), rate())[1] for _ in range(100)]
    said = WARNING.search(integrator.getEffects()['warnings'])
    h = integrator.getStepSize()._value
    assert float(said.group(1)) == pytest.approx(h*np.mean(rates), rel=0.2)
