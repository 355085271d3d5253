"""Metropolis moves of rigid bodies: what may move, by how much, and where a wall is."""
import numpy as np
from openmm import unit

from .. import _units
from .._quaternions import product

COORDINATES = ('x', 'y', 'z', 'rotation')
OVERLAP, CROSSING = 'Overlap', 'Crossing'
#: A value between the best for one coordinate (0.44) and for many (0.23): Roberts and Rosenthal,
#: Stat. Sci. 16, 351 (2001).
_TARGET_ACCEPTANCE = 0.4
#: Every move along a coordinate on which the energy does not depend is accepted, so this limits the
#: growth of its steps.
_LARGEST_GROWTH = 1e6


class Motion:
    """The coordinates that are sampled, and random displacements along them.

    All proposals are symmetric with respect to the measure dR times Haar's on SO(3): a displacement
    is as likely as its inverse.
    """
    def __init__(self, coordinates, rotationAxis, where):
        names = [coordinates] if isinstance(coordinates, str) else list(coordinates)
        unknown = [name for name in names if name not in COORDINATES]
        if unknown or not names:
            raise ValueError(
                f'{where}: coordinates: got {coordinates!r}; they must be one or more of '
                f'{", ".join(COORDINATES)}')
        self.along = np.array([name in names for name in COORDINATES[:3]], dtype=float)
        self.kinds = [
            kind for kind, there in (('translation', self.along.any()),
                                     ('rotation', 'rotation' in names)) if there
        ]
        self.axis = None
        if rotationAxis is not None:
            axis = _units.vector(rotationAxis, _units.NONE, where, 'rotationAxis')
            if not 0 < np.linalg.norm(axis) < np.inf:
                raise ValueError(
                    f'{where}: rotationAxis: got {axis}; to turn about it its length must be '
                    'finite and above 0: give a vector such as (0, 0, 1)')
            self.axis = axis/np.linalg.norm(axis)

    def translations(self, random, sizes):
        """Displacements (n, 3), Gaussian along each coordinate that is sampled.

        Their standard deviations are sizes (n,).
        """
        return random.standard_normal((len(sizes), 3))*self.along*sizes[:, None]

    def rotations(self, random, angles):
        """Quaternions (n, 4) of turns by at most these angles (n,).

        They are uniform in Haar's measure up to these angles, or about the axis.
        """
        if self.axis is None:
            return uniform_rotations(random, angles)
        half = 0.5*angles*random.uniform(-1, 1, len(angles))
        return np.concatenate([np.cos(half)[:, None], np.sin(half)[:, None]*self.axis], axis=1)


def uniform_rotations(random, largestAngles):
    """Quaternions (n, 4) of random rotations by at most these angles (n,), at most pi.

    They are uniform on SO(3) among such rotations. Rotation vectors uniform in a ball have the
    density of Haar's measure divided by (sin(r/2)/(r/2))^2. This factor is the probability to keep
    a rotation; it is at least 0.4.
    """
    angles = np.empty(len(largestAngles))
    open_ = np.arange(len(angles))
    while len(open_):
        drawn = largestAngles[open_]*np.cbrt(random.random(len(open_)))
        angles[open_] = drawn
        open_ = open_[random.random(len(open_)) >= np.sinc(drawn/(2*np.pi))**2]
    axes = random.standard_normal((len(angles), 3))
    axes *= (np.sin(0.5*angles)/np.sqrt(np.einsum('ij,ij->i', axes, axes)))[:, None]
    return np.concatenate([np.cos(0.5*angles)[:, None], axes], axis=1)


def turned(turns, orientations):
    """Orientations after turns in the lab frame, of length 1 whatever the number of moves was."""
    q = product(turns, orientations)
    return q/np.sqrt(np.einsum('ij,ij->i', q, q))[:, None]


class StepSizes:
    """The sizes of the moves of one kind, one number for each thing that moves.

    They change in burn-in only.
    """
    def __init__(self, count, size, largest):
        self.sizes = np.full(count, float(size))
        self._smallest = size/_LARGEST_GROWTH
        self._largest = largest
        self._updates = np.zeros(count)
        self.forget()

    def forget(self):
        """Begin to count acceptance anew."""
        self.tried = self.accepted = 0

    def count(self, which, tried, accepted, adapt):
        """Note how many of some trials were accepted.

        In burn-in, change the sizes towards the wanted rate.
        """
        self.tried += tried
        self.accepted += accepted
        if adapt:
            # Robbins and Monro: steps whose sum diverges and that tend to 0.
            self._updates[which] += 1
            change = np.exp((accepted/tried - _TARGET_ACCEPTANCE)/np.sqrt(self._updates[which]))
            self.sizes[which] = np.minimum(np.maximum(self.sizes[which]*change, self._smallest),
                                           self._largest)

    @property
    def acceptance(self):
        """The accepted fraction since forget()."""
        return self.accepted/self.tried if self.tried else float('nan')


def stepSizes(kinds, count, extent):
    """{kind: StepSizes} at the start, for things of this extent, nm."""
    first = {'translation': (0.1*extent, 0.1*extent*_LARGEST_GROWTH), 'rotation': (0.3, np.pi)}
    return {kind: StepSizes(count, *first[kind]) for kind in kinds}


class Wall:
    """A hard wall below particles of these radii, or (side = -1) above them.

    It is at a place along one axis. Particles of radius 0 do not feel it.
    """
    def __init__(self, place, radii, rejection, where, axis=2, side=1):
        name = getattr(rejection, 'name', rejection)
        if name not in (OVERLAP, CROSSING):
            raise ValueError(
                f'{where}: rejection: got {rejection!r}; a wall rejects {OVERLAP!r} or '
                f'{CROSSING!r}')
        self.crossing = name == CROSSING
        self.axis, self.side = axis, side
        self.limits = np.where(radii > 0, side*place + (0 if self.crossing else radii), -np.inf)

    def heights(self, places):
        """Heights of places (..., 3), which grow away from the wall, nm."""
        return self.side*places[..., self.axis]

    def allows(self, heights, limits=None):
        """Whether all particles (last axis) at these heights, nm, are above their limits."""
        limits = self.limits if limits is None else limits
        return np.all(heights > limits if self.crossing else heights >= limits, axis=-1)


def thermal_energy(temperature, where):
    """k_B T in kJ/mol; a temperature above 0."""
    temperature = _units.number(temperature, _units.TEMPERATURE, where, 'temperature')
    if not 0 < temperature < np.inf:
        raise ValueError(
            f'{where}: temperature: got {temperature} K; a Boltzmann distribution needs a '
            f'finite temperature above 0')
    return _units.GAS_CONSTANT*temperature


def plain_energies(values, where):
    """What an energyFunction returned, kJ/mol, as an array."""
    if unit.is_quantity(values):
        values = _units.ENERGY.strip(values, where, 'energyFunction')
    return np.asarray(values, dtype=float)


def is_no_energy(energies):
    """Where energies are no numbers, or -infinity."""
    return np.isnan(energies) | (energies == -np.inf)


def generator(seed, where):
    """The seed, or a fresh one for 0, and the generator that it makes."""
    seed = _units.integer(seed, where, 'seed')
    if seed < 0:
        raise ValueError(
            f'{where}: seed: got {seed}; seeds are not negative, and 0 draws a fresh one: give '
            f'another')
    seed = seed or int(np.random.SeedSequence().generate_state(1)[0] >> 1)
    return seed, np.random.default_rng(seed)


def positive(value, where, name):
    """An integer above 0."""
    value = _units.integer(value, where, name)
    if value < 1:
        raise ValueError(f'{where}: {name}: got {value}; it must be 1 or more')
    return value


def progress_bar(iterable, label, progress, things=' sweeps'):
    """The iterable with a progress bar; None: on a terminal only."""
    import tqdm
    return tqdm.tqdm(iterable, desc=label, unit=things, mininterval=0.5,
                     disable=None if progress is None else not progress)
