"""What the four experiments share: the paper's reduced units, spheres in a fluid, statistics.

The reduced units of the paper are HYDROLIB's: sphere radius 1, viscosity 1/(4 pi), and a mass
scale. They are used as if they were OpenMM's nm, ps, dalton, kJ/mol; kT becomes a temperature by
OpenMM's gas constant. The Stokes friction of a sphere is then 6 pi eta a = 1.5 and 8 pi eta a^3 =
2.
"""
import pathlib
import sys

import numpy as np
import openmm
from openmm import unit

import openmmrigidhi
from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce

HERE = pathlib.Path(__file__).resolve().parent
sys.path.append(str(HERE.parent/'common'))
import campaign  # noqa: E402, F401
from recording import brackets, printTables, provenance, pyplot, save  # noqa: E402, F401

RESULTS = HERE/'results'
VISCOSITY = 1/(4*np.pi)
GAS_CONSTANT = unit.MOLAR_GAS_CONSTANT_R.value_in_unit(unit.kilojoule_per_mole/unit.kelvin)


# ---- Scenes --------------------------------------------------------------------------------------
class Spheres:
    """Spheres of radius 1, each a rigid body of its centre and, if asked for, a marker.

    The fluid does not see the marker. Forces are added to ``system`` before :meth:`start` makes the
    Context. The centre of sphere i is particle ``centre(i)``, its marker ``marker(i)``.
    """
    def __init__(self, count, mass, moments, kT, step, model, lubrication=True, marker=None,
                 seed=1):
        self.count = count
        self.kT = kT
        self.marked = marker is not None
        self.system = openmm.System()
        self.integrator = CustomRigidHIIntegrator(kT/GAS_CONSTANT, step)
        self.integrator.setScheme(CustomRigidHIIntegrator.LangevinHI)
        self.integrator.setRandomNumberSeed(seed)
        self.fluid = MobilityForce()
        self.fluid.setViscosity(VISCOSITY)
        self.fluid.setModel(model)
        if not lubrication:
            self.fluid.setLubrication(False)
        sites = [(0, 0, 0)] + ([tuple(marker)] if self.marked else [])
        self.sites = np.array(sites, dtype=float)
        for _ in range(count):
            members = [self.system.addParticle(mass)]
            self.fluid.addParticle(1.0)
            if self.marked:
                members.append(self.system.addParticle(0.0))
                self.fluid.addParticle(0.0)
            self.integrator.addRigidBody(members, mass, moments, self.sites)
        self.system.addForce(self.fluid)
        self.context = None

    def centre(self, i):
        return (1 + self.marked)*i

    def marker(self, i):
        return 2*i + 1

    def start(self, positions, platformName='Reference'):
        """Make the Context, with the spheres' centres at these positions, not turned."""
        openmmrigidhi.app.bindBodies(self.system, self.integrator)
        properties = {'Threads': '1'} if platformName == 'CPU' else {}
        self.context = openmm.Context(self.system, self.integrator,
                                      openmm.Platform.getPlatformByName(platformName), properties)
        self.context.setPositions(
            (np.asarray(positions)[:, None, :] + self.sites[None]).reshape(-1, 3))

    def positions(self):
        return self.integrator.getBodyPositions()._value

    def orientations(self):
        return self.integrator.getBodyOrientations()

    def velocities(self):
        return self.integrator.getBodyVelocities()._value

    def angularVelocities(self):
        return self.integrator.getBodyAngularVelocities()._value

    def potentialEnergy(self):
        return self.context.getState(getEnergy=True).getPotentialEnergy()._value


def sample(integrator, samples, every, report=None, done=0):
    """Step, and yield the number of each sample.

    report gets the number of samples since the run's beginning, of which `done` were taken before.
    """
    for k in range(samples):
        integrator.step(every)
        if report is not None:
            report(done + k + 1)
        yield k


# ---- Statistics ----------------------------------------------------------------------------------
def blockError(values, blockCounts=(64, 32, 16)):
    """Standard error of the mean of a time series.

    It is the largest of the errors from averages over 64, 32 and 16 blocks.
    """
    values = np.asarray(values, dtype=float)
    errors = []
    for blocks in blockCounts:
        length = len(values) // blocks
        if length:
            means = values[:blocks*length].reshape(blocks, length, *values.shape[1:]).mean(1)
            errors.append(means.std(0, ddof=1)/np.sqrt(blocks))
    return np.max(errors, axis=0)


def weightedFit(columns, y, errors):
    """Weighted linear least squares: coefficients, standard errors, chi^2 per degree of freedom."""
    design = np.stack(columns, axis=1)/np.asarray(errors)[:, None]
    covariance = np.linalg.inv(design.T @ design)
    coefficients = covariance @ design.T @ (np.asarray(y)/errors)
    freedom = len(y) - len(columns)
    chi2 = np.sum(
        (design @ coefficients - np.asarray(y)/errors)**2)/freedom if freedom else float('nan')
    return coefficients, np.sqrt(np.diag(covariance)), float(chi2)
