"""Replica exchange and expanded ensembles of openmm.app (from OpenMM 8.6 on) with rigid bodies: the
distributions are those of the states, and replicas are independent."""
import random

import numpy as np
import openmm
import pytest
from openmm import app, unit

from openmmrigidhi import CustomRigidHIIntegrator

pytestmark = pytest.mark.skipif(not hasattr(app, 'ReplicaExchangeSampler'),
                                reason='samplers came with OpenMM 8.6')

BODIES, SITES = 30, 3
SHAPE = np.array([(0.1, 0, 0), (-0.05, 0.08, 0), (-0.05, -0.08, 0)])
TRAP = 50.0  # kJ/mol/nm^2, of each particle
TEMPERATURES = (250.0, 300.0, 360.0)
GAS_CONSTANT = unit.MOLAR_GAS_CONSTANT_R.value_in_unit(unit.kilojoule_per_mole/unit.kelvin)


def simulation(platform, scheme='LangevinC', step=0.02):
    """Bodies in a trap that acts on all particles alike. Of a body, it holds the centre only, so
    that the energy is that of three harmonic coordinates, apart from a constant."""
    system, topology = openmm.System(), app.Topology()
    trap = openmm.CustomExternalForce('factor*k*(x^2+y^2+z^2)/2')
    trap.addGlobalParameter('factor', 1.0)
    trap.addGlobalParameter('k', TRAP)
    integrator = CustomRigidHIIntegrator(TEMPERATURES[0], step)
    integrator.setScheme(scheme)
    integrator.setFriction(4.0)
    integrator.setRotationalFriction(4.0)
    integrator.setRandomNumberSeed(11)
    chain = topology.addChain()
    for body in range(BODIES):
        residue = topology.addResidue('BOD', chain)
        for _ in range(SITES):
            topology.addAtom('C', app.element.carbon, residue)
            trap.addParticle(system.addParticle(10.0))
        integrator.addRigidBody(range(SITES*body, SITES*(body + 1)))
    system.addForce(trap)
    made = app.Simulation(topology, system, integrator, platform)
    made.context.setPositions(np.tile(SHAPE, (BODIES, 1)))
    made.context.setVelocitiesToTemperature(TEMPERATURES[0], 3)
    return made


def trapEnergy(positions):
    """The energy of the centres, kJ/mol; a sixth of kT is that of half a coordinate."""
    centres = positions.reshape(BODIES, SITES, 3).mean(axis=1)
    return SITES*TRAP/2*np.sum(centres**2)


def coordinates(sampler):
    """(replica, 3 numbers of each body), the centres."""
    return np.array([
        state.getPositions(asNumpy=True)._value.reshape(BODIES, SITES, 3).mean(axis=1).ravel()
        for state in sampler.replicaConformation
    ])


def test_replica_exchange_in_temperature(platform):
    """Every temperature has its own distribution of energies, with exchanges in between."""
    random.seed(1)
    simulated = simulation(platform)
    states = [{'temperature': t*unit.kelvin} for t in TEMPERATURES]
    sampler = app.ReplicaExchangeSampler(states, simulated, 40)
    sampler.simulate(4)
    energies, places, correlations = [[] for _ in states], [], []

    def record(sampler):
        for replica, state in enumerate(sampler.replicaStateIndex):
            conformation = sampler.replicaConformation[replica]
            energies[state].append(trapEnergy(conformation.getPositions(asNumpy=True)._value))
        places.append(sampler.replicaStateIndex[:])
        x = coordinates(sampler)
        correlations.append([
            np.dot(x[i], x[j])/np.sqrt(np.dot(x[i], x[i])*np.dot(x[j], x[j]))
            for i, j in ((0, 1), (0, 2), (1, 2))
        ])

    sampler.reporters.append(record)
    sampler.simulate(150)
    for temperature, found in zip(TEMPERATURES, energies):
        # 40 steps of 0.02 ps at 4/ps, in a trap of 2.2/ps: energies forget within one iteration
        # or two; three is on the safe side.
        expected = 1.5*BODIES*GAS_CONSTANT*temperature
        error = expected*np.sqrt(2/(3*BODIES)/(len(found)/3))
        assert abs(np.mean(found) - expected) < 5*error, temperature
    assert np.count_nonzero(np.diff(places, axis=0)) > 30, 'replicas change places'
    # With the same random numbers for all, replicas would come together.
    error = 1/np.sqrt(3*BODIES*len(correlations)/3)
    assert np.all(np.abs(np.mean(correlations, axis=0)) < 5*error)


def test_replica_exchange_in_a_parameter(platform):
    random.seed(2)
    simulated = simulation(platform)
    factors = 1.0, 1.2, 1.44
    sampler = app.ReplicaExchangeSampler([{'factor': f} for f in factors], simulated, 40)
    sampler.simulate(4)
    squares, correlations = [[] for _ in factors], []

    def record(sampler):
        for replica, state in enumerate(sampler.replicaStateIndex):
            conformation = sampler.replicaConformation[replica]
            squares[state].append(trapEnergy(conformation.getPositions(asNumpy=True)._value))
        x = coordinates(sampler)
        correlations.append(np.dot(x[0], x[1])/np.sqrt(np.dot(x[0], x[0])*np.dot(x[1], x[1])))

    sampler.reporters.append(record)
    sampler.simulate(120)
    for factor, found in zip(factors, squares):
        expected = 1.5*BODIES*GAS_CONSTANT*TEMPERATURES[0]/factor
        assert abs(np.mean(found) - expected) < 5*expected*np.sqrt(2/(3*BODIES)/(len(found)/3))
    assert abs(np.mean(correlations)) < 5/np.sqrt(3*BODIES*len(correlations)/3)


def test_expanded_ensemble(platform):
    """With the exact weights every temperature is visited alike, and has its energies."""
    random.seed(3)
    temperatures = 260.0, 300.0, 346.0
    simulated = simulation(platform)
    # The integral over a coordinate is proportional to the root of the temperature; the turns give
    # all temperatures the same factor, and the constant part of the energy counts too.
    constant = SITES*TRAP/2*np.mean(np.sum((SHAPE - SHAPE.mean(axis=0))**2, axis=1))*BODIES
    weights = [
        constant/(GAS_CONSTANT*t) - 1.5*BODIES*np.log(t/temperatures[0]) for t in temperatures
    ]
    sampler = app.ExpandedEnsembleSampler([{
        'temperature': t*unit.kelvin
    } for t in temperatures], simulated, 40, weights=weights, reportInterval=40)
    simulated.step(200)
    visits, energies = [], [[] for _ in temperatures]
    iterations = 500
    for _ in range(iterations):
        state = sampler.currentStateIndex
        simulated.step(40)
        positions = simulated.context.getState(getPositions=True).getPositions(asNumpy=True)._value
        energies[state].append(trapEnergy(positions))
        visits.append(state)
    share = np.bincount(visits, minlength=3)/iterations
    # Between changes of state energies forget, so states are nearly independent; five iterations
    # for one is on the safe side.
    assert np.all(np.abs(share - 1/3) < 5*np.sqrt(2/9/(iterations/5)))
    for temperature, found in zip(temperatures, energies):
        expected = 1.5*BODIES*GAS_CONSTANT*temperature
        assert abs(np.mean(found) - expected) < 5*expected*np.sqrt(2/(3*BODIES)/(len(found)/3))


def test_an_expanded_ensemble_goes_on_from_its_checkpoint(platform, tmp_path):
    states = [{'temperature': t*unit.kelvin} for t in TEMPERATURES]
    file = str(tmp_path/'ensemble.checkpoint')

    def sampler(resume):
        made = simulation(platform)
        return made, app.ExpandedEnsembleSampler(states, made, 10, reportInterval=20,
                                                 checkpointFile=file, resume=resume)

    first, before = sampler(False)
    first.step(60)
    positions = first.context.getState(getPositions=True).getPositions(asNumpy=True)._value
    second, after = sampler(True)
    again = second.context.getState(getPositions=True).getPositions(asNumpy=True)._value
    assert np.array_equal(positions, again)
    assert after.currentStateIndex == before.currentStateIndex
    second.step(20)
    first.step(20)
    positions, again = (each.context.getState(getPositions=True).getPositions(asNumpy=True)._value
                        for each in (first, second))
    if platform.getName() == 'Reference' and after.currentStateIndex == before.currentStateIndex:
        assert np.array_equal(positions, again)  # up to the first change of state by chance
