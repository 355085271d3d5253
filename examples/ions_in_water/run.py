#!/usr/bin/env python3
"""Ions and a peptide in rigid water: molecules of water are rigid bodies, all else is flexible.

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
#: Heavy atoms of an alanine with both ends capped, nm: stretched, from usual lengths and angles.
PEPTIDE = {
    'ACE': {'CH3': (-0.253, 0.066, 0), 'C': (-0.128, -0.020, 0), 'O': (-0.136, -0.143, 0)},
    'ALA': {'N': (-0.011, 0.044, 0), 'CA': (0.116, -0.026, 0), 'CB': (0.124, -0.116, 0.123),
            'C': (0.234, 0.070, 0), 'O': (0.217, 0.192, 0)},
    'NME': {'N': (0.356, 0.015, 0), 'C': (0.477, 0.095, 0)}
}  # yapf: disable


def peptide(forceField, edge):
    """Topology and positions of the peptide, with hydrogens, in the middle of the box."""
    topology, positions = openmmapp.Topology(), []
    chain = topology.addChain()
    for name, atoms in PEPTIDE.items():
        residue = topology.addResidue(name, chain)
        for atom, place in atoms.items():
            topology.addAtom(atom, openmmapp.Element.getBySymbol(atom[0]), residue)
            positions.append(openmm.Vec3(*place))
    topology.createStandardBonds()
    middle = openmm.Vec3(edge/2 - 0.1, edge/2, edge/2)
    modeller = openmmapp.Modeller(topology, [place + middle for place in positions]*unit.nanometer)
    modeller.addHydrogens(forceField, platform=openmm.Platform.getPlatformByName('Reference'))
    return modeller


def scene(edge, seed):
    """Salt water with a peptide in a cubic box, 1 mol/l, after a minimisation.

    Returns topology, integrator, Context.
    """
    forceField = openmmapp.ForceField('amber14/protein.ff14SB.xml', 'amber14/tip4pew.xml')
    random.seed(seed)  # which molecules OpenMM replaces by ions
    modeller = peptide(forceField, edge)
    modeller.addSolvent(forceField, model='tip4pew',
                        boxSize=openmm.Vec3(edge, edge, edge)*unit.nanometer,
                        ionicStrength=1*unit.molar)
    system = forceField.createSystem(modeller.topology, nonbondedMethod=openmmapp.PME,
                                     nonbondedCutoff=0.9*unit.nanometer,
                                     constraints=openmmapp.HBonds)
    integrator = CustomRigidHIIntegrator(TEMPERATURE, 2*unit.femtosecond)
    integrator.setFriction(5/unit.picosecond)
    integrator.setRotationalFriction(10/unit.picosecond)
    integrator.setRandomNumberSeed(seed)
    # Ions and the peptide belong to no body, so their atoms are free particles.
    app.addRigidWater(integrator, modeller.topology, system)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('CPU'))
    context.setPositions(modeller.positions)
    context.applyConstraints(1e-6)
    app.minimize(context, maxIterations=100)
    context.setVelocitiesToTemperature(TEMPERATURE, seed)
    return modeller.topology, integrator, context


def kinds(topology):
    """Indices of atoms by kind: ions, oxygens of water, and oxygens of the peptide."""
    found = {'Na': [], 'Cl': [], 'peptide O': [], 'water O': []}
    for atom in topology.atoms():
        symbol = atom.element.symbol if atom.element else ''
        if symbol in ('Na', 'Cl'):
            found[symbol].append(atom.index)
        elif symbol == 'O':
            found['water O' if atom.residue.name == 'HOH' else 'peptide O'].append(atom.index)
    return found


def separations(context, some, others):
    """Distances of all atoms of one kind from all of another, nm, between nearest images."""
    state = context.getState(getPositions=True)
    positions = state.getPositions(asNumpy=True)/unit.nanometer
    edge = state.getPeriodicBoxVectors()[0][0]/unit.nanometer
    apart = positions[some][:, None] - positions[others]
    return np.linalg.norm(apart - edge*np.round(apart/edge), axis=2).ravel()


def radii(topology):
    """Radii to draw, nm: molecules of water are dots, so that one sees what is between them."""
    size = {'Na': 0.14, 'Cl': 0.2, 'H': 0.06}
    return [
        0 if atom.residue.name == 'HOH' else size.get(atom.element.symbol, 0.1)
        for atom in topology.atoms()
    ]


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
    atoms = kinds(topology)
    water = atoms.pop('water O')
    bins = np.linspace(0.15, 0.8, 66)
    counts, temperatures = {name: 0 for name in atoms}, []
    for _ in range(arguments.samples):
        integrator.step(20)
        temperatures.append(integrator.computeSystemTemperature()/unit.kelvin)
        for name, indices in atoms.items():
            counts[name] += np.histogram(separations(context, indices, water), bins)[0]/len(indices)
    free = integrator.getDegreesOfFreedom()['free']
    print(f'{len(water)} molecules, {len(atoms["Na"])} ions of each kind, '
          f'{free} degrees of freedom of the ions and the peptide, {np.mean(temperatures):.1f} K')
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4.5), layout='constrained')
    app.show(context, radii(topology), ax=left, title='', view=(10, -65))
    shells = 4/3*np.pi*np.diff(bins**3)*len(water)/arguments.edge**3
    for name, count in counts.items():
        right.plot(bins[:-1] + np.diff(bins)/2, count/arguments.samples/shells,
                   label=f'{name} – water O')
    right.set(xlabel='distance (nm)', ylabel='radial distribution')
    right.legend()
    figure.savefig(arguments.picture, dpi=110)


if __name__ == '__main__':
    main()
