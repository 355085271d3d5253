"""What the suspensions of Westwood 2022 share: units, soft spheres, poses in a Context.

They are those of sections 6.3 and 6.4. Units: the radius a of a bead is 1 nm, kT is 1 kJ/mol, tau =
6 pi eta a^3/kT is 1 ps.
"""
import numpy as np
from openmm import unit

from openmmrigidhi._quaternions import rotate

TEMPERATURE = 1/unit.MOLAR_GAS_CONSTANT_R.value_in_unit(
    unit.kilojoule_per_mole/unit.kelvin)  # kT = 1 kJ/mol
VISCOSITY = 1/(6*np.pi)  # kJ/mol ps/nm^3
STEP = 1/600  # ps, that is tau/600, as in the paper
LENGTH = 77.65  # L, nm, the edge of the paper's box
#: U0, kJ/mol, b and 2a, nm, of eq. 60.
PAIR_STRENGTH, PAIR_RANGE, CONTACT = 20.0, 0.5, 2.0


def placed(sites, R, q):
    """Places (..., n, m, 3) of the m beads of bodies at R (..., n, 3), turned by q (..., n, 4)."""
    return R[..., None, :] + rotate(q[..., None, :], sites)


class Moving:
    """Bodies that move.

    A derived class has a ``context``, its ``integrator``, and the ``sites`` of a body's beads.
    """
    def place(self, R, q):
        self.context.setPositions(placed(self.sites, R, q).reshape(-1, 3))
        self.integrator.setBodyPositions(R)
        self.integrator.setBodyOrientations(q)

    def poses(self):
        return self.integrator.getBodyPositions()._value.copy(
        ), self.integrator.getBodyOrientations().copy()

    def energy(self):
        return self.context.getState(getEnergy=True).getPotentialEnergy()._value
