#!/usr/bin/env python3
"""How fast 13 near spheres fall under equal forces, by the model of the fluid.

One sphere is in the middle of an icosahedron of twelve. A rigid body of all spheres loses as much
energy as free spheres that fall as one, or more; the sphere around it loses still more. So the mean
velocity of the spheres is at least that of the sphere around them.

    python3 models.py        # half a minute
"""
import numpy as np
import openmm

import openmmrigidhi
from openmmrigidhi import MobilityForce, app

RADIUS = 1.0  # nm
GAPS = (0.04, 0.2, 0.5)  # in radii, between the middle and the others
MODELS = {
    'RotnePragerYamakawa': ('RotnePragerYamakawa', 'Off', 0),
    'RotnePragerYamakawa with lubrication': ('RotnePragerYamakawa', 'On', 0),
    'StokesianDynamics': ('StokesianDynamics', 'On', 0),
    'StokesianDynamics without lubrication': ('StokesianDynamics', 'Off', 0),
    'shells of 42 blobs': ('RotnePragerYamakawa', 'Off', 42)
}


def places(gap):
    """The centres of the spheres, nm."""
    golden = (1 + 5**0.5)/2
    corners = [(0, i, j*golden) for i in (-1, 1) for j in (-1, 1)]
    corners = np.array([np.roll(corner, k) for corner in corners for k in range(3)])
    corners *= (2 + gap)*RADIUS/np.linalg.norm(corners[0])
    return np.vstack([np.zeros((1, 3)), corners])


def meanVelocity(gap, model, lubrication, blobs):
    """The mean velocity under equal forces, over that of one sphere."""
    system, fluid = openmm.System(), MobilityForce()
    fluid.setModel(model)
    fluid.setViscosity(1)
    fluid.setLubrication(lubrication)
    integrator = openmmrigidhi.CustomRigidHIIntegrator(0, 1)
    integrator.setScheme('FixmanMidpoint')
    sites, radius = app.multiblobSphere(blobs, RADIUS) if blobs else ([(0, 0, 0)], RADIUS)
    centres = places(gap)
    for _ in centres:
        app.addRigidMultiblob(system, integrator, fluid, sites, radius)
    system.addForce(fluid)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('CPU'))
    app.placeBodies(context, centres)
    wrenches = [(0, 0, 1, 0, 0, 0)]*len(centres)
    velocities = fluid.applyMobilityInContext(context, wrenches)
    return velocities.reshape(-1, 6)[:, 2].mean()*6*np.pi*RADIUS


def main():
    print('| gap in radii | ' + ' | '.join(map(str, GAPS)) + ' |')
    print('|---|' + '---|'*len(GAPS))
    print('| the sphere around them, a lower bound | ' + ' | '.join(f'{13/(3 + gap):.2f}'
                                                                    for gap in GAPS) + ' |')
    for name, settings in MODELS.items():
        print(f'| {name} | ' + ' | '.join(f'{meanVelocity(gap, *settings):.2f}'
                                          for gap in GAPS) + ' |')


if __name__ == '__main__':
    main()
