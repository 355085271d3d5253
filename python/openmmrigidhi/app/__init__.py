"""What an OpenMM script with rigid bodies needs beside the integrator: builders, a minimiser, reporters, shapes."""
from .bodies import addRigidResidues, addRigidWater, bindBodies
from .bodystates import BodyStates, RigidBodyReporter, readBodyStates
from .minimizer import MinimizationResult, minimize
from .reporters import StateDataReporter
from .shapes import multiblobSphere, sphereShell

__all__ = ['addRigidWater', 'addRigidResidues', 'bindBodies', 'minimize', 'MinimizationResult', 'RigidBodyReporter',
           'readBodyStates', 'BodyStates', 'StateDataReporter', 'sphereShell', 'multiblobSphere']
