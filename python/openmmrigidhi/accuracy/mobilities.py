"""The quantities of the hydrodynamic ladder: the mobility matrix, and numbers from it.

The numbers belong to given forces.
"""
from __future__ import annotations

from typing import Callable, Optional, Union

import numpy as np

from .. import _units
from .._types import Array
from .scenes import findObservable


class MobilitySample:
    """The mobility of a scene's spheres at its start, by one rung of the ladder.

    Attributes
    ----------
    mobility : array of shape (6n, 6n)
        rows per body Vx Vy Vz Wx Wy Wz about the spheres' centres, lab frame, OpenMM's units
    centres : array of shape (n, 3)
        centres of the spheres, nm
    radii : array of shape (n,)
        nm
    viscosity : float
        dalton/(nm ps)
    forces, torques : arrays of shape (n, 3)
        forces and torques of the scene on its bodies at the start, about the spheres' centres
    """
    def __init__(self, mobility: Array, centres: Array, radii: Array, viscosity: float,
                 forces: Array, torques: Array) -> None:
        self.mobility = mobility
        self.centres = centres
        self.radii = radii
        self.viscosity = viscosity
        self.forces = forces
        self.torques = torques

    @property
    def friction(self) -> Array:
        """Inverse of the mobility, an array of shape (6n, 6n)."""
        return np.linalg.inv(self.mobility)

    def twists(self, forces: Union[float, Array],
               torques: Union[float, Array] = 0.0) -> tuple[Array, Array]:
        """Velocities and angular velocities from forces and torques on the bodies.

        The result is two arrays of shape (n, 3).

        Parameters
        ----------
        forces, torques : array-like that can be broadcast to shape (n, 3)
        """
        wrenches = np.empty((len(self.radii), 6))
        wrenches[:, :3], wrenches[:, 3:] = forces, torques
        twists = (self.mobility @ wrenches.ravel()).reshape(-1, 6)
        return twists[:, :3], twists[:, 3:]


class MobilityObservable:
    r"""A number or an array computed from the mobility.

    Parameters
    ----------
    name : str
        name in tables, on the command line, in file names
    label : str
        name in pictures
    measure : callable
        MobilitySample -> float or array, or None where the observable has no meaning
    compare : callable, optional
        (value, value of the reference) -> relative error; default: :math:`(x - r)/|r|`, and for
        arrays :math:`\|x - r\|/\|r\|`
    description : str
    """
    def __init__(self, name: str, label: str, measure: Callable, compare: Optional[Callable] = None,
                 description: str = '') -> None:
        self.name = name
        self.label = label
        self.measure = measure
        self.compare = compare or _relative
        self.description = description


def _relative(value, reference):
    """The relative error; None where there is nothing to divide by."""
    if value is None or reference is None:
        return None
    difference, size = np.asarray(value) - np.asarray(reference), np.linalg.norm(reference)
    if size == 0:
        return None
    return float(difference/size if difference.ndim == 0 else np.linalg.norm(difference)/size)


def _drag(sample):
    """Forces along z, over Stokes', that move all spheres alike along z without rotation."""
    forces = sample.friction[2::6, 2::6].sum(axis=1)
    return float((forces/(6*np.pi*sample.viscosity*sample.radii)).mean())


def _rotational_drag(sample):
    """Torques about z, over Stokes', that rotate all spheres alike about z without moving them."""
    torques = sample.friction[5::6, 5::6].sum(axis=1)
    return float((torques/(8*np.pi*sample.viscosity*sample.radii**3)).mean())


def _scaled(sample):
    """The mobility divided by the square roots of Stokes' mobilities of the spheres alone.

    It has no units, and 1 on the diagonal for distant spheres.
    """
    eta, a = sample.viscosity, sample.radii
    alone = np.stack([1/(6*np.pi*eta*a)]*3 + [1/(8*np.pi*eta*a**3)]*3, axis=1).ravel()
    return sample.mobility/np.sqrt(np.outer(alone, alone))


def _worst(value, reference):
    """Largest |w^T N w/(w^T N_ref w) - 1| over all wrenches w."""
    inverse = np.linalg.inv(np.linalg.cholesky(reference))
    return float(np.abs(np.linalg.eigvalsh(inverse @ value @ inverse.T) - 1).max())


def _sedimentation(sample):
    return float(sample.twists((0, 0, 1))[0][:, 2].mean())


def _rotation_translation(sample):
    velocities, angular = sample.twists((0, 0, 1))
    return angular/velocities[:, 2].mean() if len(sample.radii) > 1 else None


def _relative_mobility(sample):
    n = len(sample.radii)
    if n < 2:
        return None
    i, j = np.triu_indices(n, 1)
    gaps = np.linalg.norm(sample.centres[i] - sample.centres[j],
                          axis=1) - sample.radii[i] - sample.radii[j]
    i, j = i[gaps.argmin()], j[gaps.argmin()]
    normal = sample.centres[j] - sample.centres[i]
    normal /= np.linalg.norm(normal)
    forces = np.zeros((n, 3))
    forces[i], forces[j] = -normal, normal
    velocities, _ = sample.twists(forces)
    return float((velocities[j] - velocities[i]) @ normal)


def _own_forces(sample):
    if not (sample.forces.any() or sample.torques.any()):
        return None
    velocities, angular = sample.twists(sample.forces, sample.torques)
    return np.concatenate([velocities, sample.radii[:, None]*angular], axis=1)


class _UserFunction:
    def __init__(self, function):
        self.function = function

    def __call__(self, sample):
        return _units.plain(self.function(sample))


#: Observables by name.
BUILT_IN = {
    observable.name: observable
    for observable in
    (MobilityObservable(
        'mobility', 'mobility matrix', _scaled, description=
        'Frobenius norm of the error of the mobility matrix over that of the matrix, both divided '
        'by the roots of the Stokes mobilities of the spheres alone'),
     MobilityObservable(
         'sedimentation', 'settling velocity', _sedimentation,
         description='mean velocity along z under the same force along z on every body'),
     MobilityObservable(
         'relative_mobility', 'mobility along the line of centres of the closest pair',
         _relative_mobility, description=
         'relative velocity of the two spheres with the smallest gap when they are pulled apart'),
     MobilityObservable(
         'rotation_translation', 'rotation per settling velocity', _rotation_translation,
         description=
         'angular velocities of all bodies over their mean velocity, under the same force along z '
         'on every body; norm'),
     MobilityObservable(
         'own_forces', "velocities under the scene's own forces", _own_forces, description=
         "velocities, and radii times angular velocities, under the scene's forces at its start; "
         "norm"),
     MobilityObservable(
         'drag', 'drag K of spheres that move alike', _drag, description=
         "mean force along z on spheres that all move alike along z and do not rotate, over "
         "Stokes' drag; in an array it is known as K"),
     MobilityObservable(
         'rotational_drag', 'rotational drag KR of spheres that rotate alike', _rotational_drag,
         description=
         "mean torque about z on spheres that all rotate alike about z and do not move, over "
         "Stokes' torque"),
     MobilityObservable(
         'worst_wrench', 'mobility of the worst forces and torques', _scaled, _worst,
         'largest relative error of the power that forces and torques spend on the fluid, over all '
         'of them'),
     )
}
#: The observables that are compared by default.
DEFAULT = ('mobility', 'sedimentation', 'relative_mobility', 'rotation_translation', 'own_forces')


def byName(name: Union[str, MobilityObservable, Callable]) -> MobilityObservable:
    """An observable by its name on the command line.

    Parameters
    ----------
    name : str or MobilityObservable or callable
        a built-in name; "module:function" or a function of the MobilitySample that returns a number
        or an array

    Returns
    -------
    MobilityObservable
    """
    found = findObservable(
        name, MobilityObservable, BUILT_IN, lambda function: MobilityObservable(
            function.__name__, function.__name__, _UserFunction(function), description=
            'given by the user'))
    if found is None:
        raise ValueError(
            f'observable of mobility: got {name!r}; it must be one of {", ".join(BUILT_IN)}, or '
            'module:function')
    return found
