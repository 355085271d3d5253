#!/usr/bin/env python3
"""Ions in rigid water: molecules are rigid bodies, ions are free particles.

    python3 run.py                     # a minute; draws picture.png
"""
import argparse
import random

import numpy as np
import openmm
from openmm import unit
from openmm import app as openmmapp

from openmmrigidhi import CustomRigidHIIntegrator, app

TEMPERATURE = 300*unit.kelvin


def scene(edge, seed):
    """Salt water in a cubic box, 1 mol/l, after a minimisation: topology, integrator, Context."""
    forceField = openmmapp.ForceField('amber14/tip4pew.xml')
    modeller = openmmapp.Modeller(openmmapp.Topology(), [])
    random.seed(seed)  # which molecules OpenMM replaces by ions
    modeller.addSolvent(forceField, model='tip4pew',
                        boxSize=openmm.Vec3(edge, edge, edge)*unit.nanometer,
                        ionicStrength=1*unit.molar)
    system = forceField.createSystem(modeller.topology, nonbondedMethod=openmmapp.PME,
                                     nonbondedCutoff=0.9*unit.nanometer)
    integrator = CustomRigidHIIntegrator(TEMPERATURE, 2*unit.femtosecond)
    integrator.setFriction(5/unit.picosecond)
    integrator.setRotationalFriction(10/unit.picosecond)
    integrator.setRandomNumberSeed(seed)
    app.addRigidWater(integrator, modeller.topology,
                      system)  # ions belong to no body, so they are free particles
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('CPU'))
    context.setPositions(modeller.positions)
    app.minimize(context, maxIterations=100)
    context.setVelocitiesToTemperature(TEMPERATURE, seed)
    return modeller.topology, integrator, context


def separations(topology, context, ion):
    """Distances of the oxygens from the ions of a kind, with the numbers of ions and oxygens.

    Distances are in nm, between nearest images.
    """
    elements = [atom.element.symbol if atom.element else '' for atom in topology.atoms()]
    state = context.getState(getPositions=True)
    positions, edge = state.getPositions(
        asNumpy=True)._value, state.getPeriodicBoxVectors()[0][0]._value
    ions, oxygens = (positions[[k for k, each in enumerate(elements) if each == kind]]
                     for kind in (ion, 'O'))
    apart = ions[:, None] - oxygens
    return np.linalg.norm(apart - edge*np.round(apart/edge),
                          axis=2).ravel(), len(ions), len(oxygens)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--edge', type=float, default=2.2, help='edge of the box, nm (default 2.2)')
    parser.add_argument('--samples', type=int, default=100,
                        help='samples of the distances, 20 steps apart (default 100)')
    parser.add_argument('--seed', type=int, default=1,
                        help='seed of the random numbers (default 1)')
    parser.add_argument('--picture', default='picture.png',
                        help='file to draw (default picture.png)')
    arguments = parser.parse_args()
    import matplotlib
    matplotlib.use('Agg')
    import matplotlib.pyplot as plt
    topology, integrator, context = scene(arguments.edge, arguments.seed)
    integrator.step(30*arguments.samples)
    bins = np.linspace(0.15, 0.8, 66)
    counts, temperatures = {'Na': 0, 'Cl': 0}, []
    for _ in range(arguments.samples):
        integrator.step(20)
        temperatures.append(integrator.computeSystemTemperature()._value)
        for ion in counts:
            distances, ions, oxygens = separations(topology, context, ion)
            counts[ion] += np.histogram(distances, bins)[0]/ions
    print(f'{oxygens} molecules, {ions} ions of each kind, {np.mean(temperatures):.1f} K')
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4.5), layout='constrained')
    app.show(context, ax=left, title='', view=(10, -65))
    shells = 4/3*np.pi*np.diff(bins**3)*oxygens/arguments.edge**3
    for ion, count in counts.items():
        right.plot(bins[:-1] + np.diff(bins)/2, count/arguments.samples/shells, label=f'{ion} – O')
    right.set(xlabel='distance (nm)', ylabel='radial distribution')
    right.legend()
    figure.savefig(arguments.picture, dpi=110)


if __name__ == '__main__':
    main()
