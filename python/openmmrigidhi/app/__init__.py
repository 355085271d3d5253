"""Builders, a minimiser, reporters and shapes for OpenMM scripts with rigid bodies."""
from typing import TYPE_CHECKING

from .._lazy import lazy
from .blobfiles import readClones, readVertexFile, writeClones
from .bodies import (addRigidMultiblob, addRigidResidues, addRigidWater, bindBodies, bodyTopology,
                     excludeWithinBodies)
from .bodystates import BodyStates, RigidBodyReporter, readBodyStates
from .drawing import movie, show
from .gsdfiles import GsdReporter, readGsd
from .h5mdfiles import H5mdReporter, readH5md
from .minimizer import MinimizationResult, minimize
from .placement import makeWhole, placeBodies
from .shapes import (boomerang, cylinder, icosahedron, multiblobSphere, outerRadius, rod,
                     sphereShell, tetramer)
from .suspensions import randomSuspension
from .swimmers import squirmerSlip
from .trajectories import Trajectory

if TYPE_CHECKING:
    from .reporters import StateDataReporter
else:
    # It imports openmm.app, which takes as long as OpenMM itself.
    __getattr__, __dir__ = lazy(__name__, {'reporters': ['StateDataReporter']})

__all__ = [
    'addRigidWater', 'addRigidResidues', 'addRigidMultiblob', 'bindBodies', 'excludeWithinBodies',
    'placeBodies', 'makeWhole', 'minimize', 'MinimizationResult', 'RigidBodyReporter',
    'readBodyStates', 'BodyStates', 'StateDataReporter', 'sphereShell', 'multiblobSphere',
    'outerRadius', 'rod', 'cylinder', 'boomerang', 'tetramer', 'icosahedron', 'readVertexFile',
    'readClones', 'writeClones', 'GsdReporter', 'readGsd', 'H5mdReporter', 'readH5md', 'Trajectory',
    'show', 'movie', 'squirmerSlip', 'randomSuspension', 'bodyTopology'
]
