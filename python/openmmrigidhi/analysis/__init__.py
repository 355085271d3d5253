"""Analysis of trajectories and mobilities of rigid bodies.

It computes mean square displacements, diffusion coefficients and hydrodynamic centres, pair
distributions and structure factors, and the effective viscosity of a driven suspension. Its Monte
Carlo of bodies at equilibrium is the reference for every scheme.

Equation numbers refer to Delong, Balboa Usabiaga, Donev 2015, J. Chem. Phys. 143, 144107.
"""
from .displacements import (MeanSquareDisplacement, nonAffinePositions, planarAngleMSD,
                            rotationalMSD, translationalMSD)
from .diffusion import (DiffusionCoefficient, InfiniteBoxDiffusion, finiteSizeCorrection,
                        gravitationalHeight, infiniteBoxDiffusion, longTimeDiffusion,
                        shortTimeDiffusion)
from .gibbsboltzmann import GibbsBoltzmannSampler
from .mobilities import (centerOfHydrodynamicStress, centerOfMobility, mobilityAboutPoint,
                         mobilityInBodyFrame, planarAngleMobility, planarCenterOfHydrodynamicStress)
from .rotation import OrientationCorrelation, orientationCorrelation, rotationalDiffusion
from .samples import PoseSamples
from .series import SeriesStatistics, seriesStatistics
from .shear_viscosity import (ShearViscosity, sampleStresses, shearViscosity,
                              shearViscosityFromStresses)
from .structure import PairDistribution, StructureFactor, pairDistribution, structureFactor
from .viscosity import EffectiveViscosity, sampleFlowAmplitudes, viscosity, viscosityFromAmplitudes
from .walkers import WalkerSampler

__all__ = [
    'translationalMSD', 'nonAffinePositions', 'rotationalMSD', 'planarAngleMSD',
    'MeanSquareDisplacement', 'shortTimeDiffusion', 'longTimeDiffusion', 'DiffusionCoefficient',
    'mobilityAboutPoint', 'mobilityInBodyFrame', 'centerOfMobility', 'centerOfHydrodynamicStress',
    'planarCenterOfHydrodynamicStress', 'planarAngleMobility', 'gravitationalHeight',
    'GibbsBoltzmannSampler', 'WalkerSampler', 'PoseSamples', 'viscosity', 'EffectiveViscosity',
    'sampleFlowAmplitudes', 'viscosityFromAmplitudes', 'shearViscosity', 'ShearViscosity',
    'sampleStresses', 'shearViscosityFromStresses', 'sampleFlowAmplitudes',
    'viscosityFromAmplitudes', 'finiteSizeCorrection', 'infiniteBoxDiffusion',
    'InfiniteBoxDiffusion', 'pairDistribution', 'PairDistribution', 'structureFactor',
    'StructureFactor', 'seriesStatistics', 'SeriesStatistics', 'orientationCorrelation',
    'OrientationCorrelation', 'rotationalDiffusion'
]
