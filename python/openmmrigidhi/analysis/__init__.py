"""Analysis of trajectories and mobilities of rigid bodies.

It has mean square displacements, diffusion coefficients and hydrodynamic centres. It has Monte
Carlo of bodies at equilibrium, the reference for every scheme. It also has the effective viscosity
of a driven suspension.

Equation numbers are those of Delong, Balboa Usabiaga, Donev 2015, J. Chem. Phys. 143, 144107.
"""
from .displacements import MeanSquareDisplacement, planarAngleMSD, rotationalMSD, translationalMSD
from .diffusion import (DiffusionCoefficient, gravitationalHeight, longTimeDiffusion,
                        shortTimeDiffusion)
from .gibbsboltzmann import GibbsBoltzmannSampler
from .mobilities import (centerOfHydrodynamicStress, centerOfMobility, mobilityAboutPoint,
                         mobilityInBodyFrame, planarAngleMobility, planarCenterOfHydrodynamicStress)
from .samples import PoseSamples
from .viscosity import EffectiveViscosity, sampleFlowAmplitudes, viscosity, viscosityFromAmplitudes
from .walkers import WalkerSampler

__all__ = [
    'translationalMSD', 'rotationalMSD', 'planarAngleMSD', 'MeanSquareDisplacement',
    'shortTimeDiffusion', 'longTimeDiffusion', 'DiffusionCoefficient', 'mobilityAboutPoint',
    'mobilityInBodyFrame', 'centerOfMobility', 'centerOfHydrodynamicStress',
    'planarCenterOfHydrodynamicStress', 'planarAngleMobility', 'gravitationalHeight',
    'GibbsBoltzmannSampler', 'WalkerSampler', 'PoseSamples', 'viscosity', 'EffectiveViscosity',
    'sampleFlowAmplitudes', 'viscosityFromAmplitudes'
]
