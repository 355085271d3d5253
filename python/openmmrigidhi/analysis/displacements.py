"""Mean square displacements of rigid bodies, with errors from blocks of the trajectory."""
from __future__ import annotations

import dataclasses
import warnings
from typing import TYPE_CHECKING, Optional, Sequence

import numpy as np
from openmm import unit

from .. import _units
from .._types import Array, Number, Numbers
from .._quaternions import conjugate, product, rotate

if TYPE_CHECKING:
    import numpy.typing as npt

#: The length of quaternions may differ from 1 by the rounding of single precision.
_NORM_TOLERANCE = 1e-6
_DEFAULT_LAGS = 50
#: Positions count as wrapped if a move between frames is longer than the one part of the extent of
#: all positions along an axis, and half of the moves are shorter than the other part.
LEAST_JUMP, LARGEST_MOVE = 0.8, 0.05


@dataclasses.dataclass
class MeanSquareDisplacement:
    r"""A mean square displacement as a function of lag time.

    Attributes
    ----------
    lagTimes : Quantity of shape (lags,)
        lag times, ps
    mean : Quantity or array of shape (lags, 3, 3) or (lags,)
        the tensor :math:`\langle d_i d_j \rangle` of displacements d (or
        :math:`\langle d^2 \rangle` of a scalar displacement): nm^2; without unit for rotations
        (rad^2)
    error : as mean
        standard error of mean, from the spread of the blocks
    blocks : Quantity or array of shape (blocks,) + shape of mean
        the mean square displacement of each block of the trajectory; mean is the mean over blocks
    limit : float or None
        what each diagonal component, or the one number, tends to for free rotation; None where
        displacements grow without bound
    """

    lagTimes: unit.Quantity
    mean: object
    error: object
    blocks: object
    limit: Optional[float] = None

    @property
    def parallel(self) -> MeanSquareDisplacement:
        """The sum of the xx and yy components, for motion along a wall or in a plane."""
        return self.component((1, 1, 0))

    @property
    def perpendicular(self) -> MeanSquareDisplacement:
        """The zz component, for motion normal to a wall."""
        return self.component((0, 0, 1))

    @property
    def trace(self) -> MeanSquareDisplacement:
        """The sum of the xx, yy and zz components."""
        return self.component((1, 1, 1))

    @property
    def isotropic(self) -> MeanSquareDisplacement:
        """A third of the trace: the mean over three axes; its slope is 2 D."""
        return self.component((1/3, 1/3, 1/3))

    @property
    def lateral(self) -> MeanSquareDisplacement:
        """The mean of the xx and yy components; its slope is 2 D along a wall."""
        return self.component((1/2, 1/2, 0))

    def component(self, weights: npt.ArrayLike) -> MeanSquareDisplacement:
        """Get a weighted sum of components of the tensor, with an error from their correlation.

        Parameters
        ----------
        weights : array-like of shape (3,) or (3, 3)
            weights of xx, yy and zz, or of all components

        Returns
        -------
        MeanSquareDisplacement
            with one number for each lag time

        Raises
        ------
        ValueError
            for weights of another shape, or if the displacement already is one number for each lag
            time
        """
        weights = np.array(weights, dtype=float)
        if weights.shape == (3,):
            weights = np.diag(weights)
        blocks, attach = _without_unit(self.blocks)
        if blocks.ndim != 4 or weights.shape != (3, 3):
            raise ValueError(
                f'component: weights of shape {weights.shape} for a mean square displacement of '
                f'shape {blocks.shape[1:]}; a tensor needs 3 or 3 x 3 weights, and a scalar has '
                'no components to choose from')
        limit = None if self.limit is None else self.limit*np.trace(weights)
        return _summarise(self.lagTimes, np.einsum('blij,ij->bl', blocks, weights), attach, limit)


def translationalMSD(positions: Numbers, orientations: Optional[npt.ArrayLike],
                     frameInterval: Number, trackingPoint: Optional[Numbers] = None,
                     lags: Optional[Sequence[int]] = None, numBlocks: int = 10,
                     bodyFrame: bool = False,
                     independentBodies: bool = False) -> MeanSquareDisplacement:
    """Get the mean square displacement of a point of rigid bodies.

    The choice of the tracked point matters at short times but not at long times. At short times the
    tensor is :math:`2 kT N_{tt}` times the lag time, with the translational mobility :math:`N_{tt}`
    about this point. If the point is the centre of mobility of an isolated body, this holds at all
    times (eq. 67). The average runs over all pairs of frames within a block, and over all bodies. A
    warning says if positions look as if they were wrapped into a box.

    Parameters
    ----------
    positions : array-like or Quantity of shape (frames, bodies, 3)
        origins of the bodies at equal intervals, unwrapped, nm
    orientations : array-like of shape (frames, bodies, 4), or None
        unit quaternions (w, x, y, z), body frame to lab frame; None is enough for the bodies'
        origins along the lab axes
    frameInterval : float or Quantity
        time between frames, ps
    trackingPoint : Vec3, sequence or Quantity of shape (3,)
        the point in the body frame, nm; (0, 0, 0) is the body's origin. You must give it if you
        give orientations.
    lags : sequence of int, optional
        lag times as numbers of frames, from 0 to less than the length of a block; None: about 50,
        from 1 to a quarter of a block in equal ratios
    numBlocks : int
        number of blocks of the trajectory in time. A block should be longer than all relaxation
        times and several times the largest lag; otherwise errors are too small. Frames at the start
        that do not fill a block are left out.
    bodyFrame : bool
        resolve displacements along the body axes of the earlier frame instead of the lab axes
    independentBodies : bool
        count the blocks of each body separately. This is right for replicas without interactions;
        numBlocks=1 may be enough for them.

    Returns
    -------
    MeanSquareDisplacement
        a tensor, nm^2

    Raises
    ------
    TypeError, ValueError
        for arrays of other shapes, dimensions or lengths, for lags that do not fit into a block,
        for fewer than two blocks, or for another point or frame without orientations
    """
    where = 'translationalMSD'
    R = _units.frames(positions, _units.LENGTH, 3, where, 'positions')
    if trackingPoint is None and orientations is not None:
        raise TypeError(f'{where}: trackingPoint: got none; which point of a body is followed '
                        "matters at short times: give it, (0, 0, 0) for the body's origin")
    point = np.zeros(3) if trackingPoint is None else _units.vector(trackingPoint, _units.LENGTH,
                                                                    where, 'trackingPoint')
    bodyFrame = _units.boolean(bodyFrame, where, 'bodyFrame')
    if orientations is None:
        if point.any() or bodyFrame:
            raise ValueError(
                f'{where}: orientations: got None with trackingPoint {point.tolist()} nm and '
                f'bodyFrame {bodyFrame}; without orientations only the origins of bodies can be '
                'followed, along the lab axes: give the orientations')
        orientations = np.broadcast_to((1.0, 0.0, 0.0, 0.0), R.shape[:2] + (4,))
    q = _orientations(orientations, where)
    if R.shape[:2] != q.shape[:2]:
        raise ValueError(
            f'{where}: positions: got {R.shape[0]} frames of {R.shape[1]} bodies, but '
            f'orientations of {q.shape[0]} frames of {q.shape[1]}: give both from one trajectory')
    blocks = _Blocks(len(R), R.shape[1], frameInterval, lags, numBlocks, independentBodies, where)
    _warn_of_wrapping(R, where)
    tracked = blocks.cut(R + rotate(q, point) if point.any() else R)
    toBody = blocks.cut(conjugate(q)) if bodyFrame else None

    def displacements(lag):
        d = tracked[:, lag:] - tracked[:, :blocks.length - lag]
        return d if toBody is None else rotate(toBody[:, :blocks.length - lag], d)

    return blocks.average(displacements, lambda values: unit.Quantity(values, unit.nanometer**2))


def nonAffinePositions(positions: Numbers, frameInterval: Number, rate: Number, flowAxis: int,
                       gradientAxis: int) -> unit.Quantity:
    r"""Get positions without the displacements by a shear (:meth:`MobilityForce.setShear`).

    The function subtracts along flowAxis the integral of :math:`g\,y(t)` from the first frame on,
    with the rate g of the shear and the body's own coordinate y along gradientAxis. Differences of
    the results are non-affine displacements, the integrals of :math:`U - G x` with the gradient G
    of the flow. You may give the results to :func:`translationalMSD`.

    Parameters
    ----------
    positions : array-like or Quantity of shape (frames, bodies, 3)
        positions at equal intervals, unwrapped, as from :class:`CustomRigidHIIntegrator`, nm
    frameInterval : float or Quantity
        time between frames, ps
    rate : float or Quantity
        rate of the shear, 1/ps
    flowAxis, gradientAxis : int
        0, 1, 2 for x, y, z; not the same

    Returns
    -------
    Quantity of shape (frames, bodies, 3)
        nm; the first frame equals the first frame of positions

    Raises
    ------
    TypeError, ValueError
        for arrays of other shapes or dimensions, and for axes that are not as above

    Notes
    -----
    The integral uses trapezoids. Diffusion with the coefficient D between frames adds the variance
    :math:`g^2 D\,\Delta t^3/6` per interval of the length :math:`\Delta t`. With a frame at each
    step the integral has the order of the schemes.
    """
    where = 'nonAffinePositions'
    R = _units.frames(positions, _units.LENGTH, 3, where, 'positions').copy()
    interval = _units.number(frameInterval, _units.TIME, where, 'frameInterval')
    rate = _units.number(rate, _units.RATE, where, 'rate')
    axes = [
        _units.integer(axis, where, name)
        for axis, name in ((flowAxis, 'flowAxis'), (gradientAxis, 'gradientAxis'))
    ]
    if not set(axes) <= {0, 1, 2} or axes[0] == axes[1]:
        raise ValueError(
            f'{where}: flowAxis, gradientAxis: got {axes[0]} and {axes[1]}; the axes of '
            'a shear are two of 0, 1 and 2: give those of setShear()')
    y = R[:, :, axes[1]]
    R[1:, :, axes[0]] -= rate*interval*np.cumsum((y[1:] + y[:-1])/2, axis=0)
    return _units.LENGTH.attach(R)


def rotationalMSD(orientations: npt.ArrayLike, frameInterval: Number,
                  lags: Optional[Sequence[int]] = None, numBlocks: int = 10,
                  bodyFrame: bool = False,
                  independentBodies: bool = False) -> MeanSquareDisplacement:
    r"""Get the rotational mean square displacement of rigid bodies (eqs. 20-22).

    The rotational displacement between two frames is
    :math:`u = \frac12 \sum_i u_i(0) \times u_i(t)` over the body axes :math:`u_i`. It is
    :math:`\sin \theta` times the axis of the rotation by :math:`\theta` between the frames. At
    short times its tensor is :math:`2 kT N_{rr}` times the lag time. For free rotation it tends to
    1/6 of the unit matrix.

    Parameters
    ----------
    orientations : array-like of shape (frames, bodies, 4)
        unit quaternions (w, x, y, z) at equal intervals, body frame to lab frame
    frameInterval : float or Quantity
        time between frames, ps
    lags : sequence of int, optional
        as in :func:`translationalMSD`
    numBlocks : int
        as in :func:`translationalMSD`
    bodyFrame : bool
        resolve displacements along the body axes instead of the lab axes
    independentBodies : bool
        as in :func:`translationalMSD`

    Returns
    -------
    MeanSquareDisplacement
        a tensor without unit

    Raises
    ------
    TypeError, ValueError
        as in :func:`translationalMSD`
    """
    where = 'rotationalMSD'
    q = _orientations(orientations, where)
    blocks = _Blocks(len(q), q.shape[1], frameInterval, lags, numBlocks, independentBodies, where)
    q = blocks.cut(q)
    bodyFrame = _units.boolean(bodyFrame, where, 'bodyFrame')

    def displacements(lag):
        earlier, later = q[:, :blocks.length - lag], q[:, lag:]
        turn = product(conjugate(earlier), later) if bodyFrame else product(
            later, conjugate(earlier))
        return 2*turn[..., :1]*turn[..., 1:]  # (cos, sin axis)(angle/2) to sin(angle) axis

    return blocks.average(displacements, lambda values: values, limit=1/6)


def planarAngleMSD(orientations: npt.ArrayLike, frameInterval: Number, bodyVector: Numbers,
                   lags: Optional[Sequence[int]] = None, numBlocks: int = 10,
                   independentBodies: bool = False) -> MeanSquareDisplacement:
    """Get the mean square displacement of the angle of a body vector in the xy plane.

    The angle belongs to the vector's projection onto the plane. The function follows it from frame
    to frame through full turns. It would take a change by more than half a turn between frames for
    a turn in the opposite direction. The angle is undefined where the vector is along z, so the
    result says little about bodies that flip.

    Parameters
    ----------
    orientations : array-like of shape (frames, bodies, 4)
        unit quaternions (w, x, y, z) at equal intervals, body frame to lab frame
    frameInterval : float or Quantity
        time between frames, ps
    bodyVector : Vec3 or sequence of shape (3,)
        the vector in the body frame, of any length but 0, such as a boomerang's bisector
    lags : sequence of int, optional
        as in :func:`translationalMSD`
    numBlocks : int
        as in :func:`translationalMSD`
    independentBodies : bool
        as in :func:`translationalMSD`

    Returns
    -------
    MeanSquareDisplacement
        one number for each lag time, rad^2

    Raises
    ------
    TypeError, ValueError
        as in :func:`translationalMSD`, and for a vector of length 0
    """
    where = 'planarAngleMSD'
    q = _orientations(orientations, where)
    vector = _direction(bodyVector, where)
    blocks = _Blocks(len(q), q.shape[1], frameInterval, lags, numBlocks, independentBodies, where)
    projected = rotate(q, vector)
    angle = blocks.cut(np.unwrap(np.arctan2(projected[..., 1], projected[..., 0]), axis=0))
    return blocks.average(lambda lag: angle[:, lag:] - angle[:, :blocks.length - lag],
                          lambda values: values)


class _Blocks:
    """A trajectory cut into blocks of equal length in time, and the averages over them."""
    def __init__(self, frames, bodies, frameInterval, lags, numBlocks, independentBodies, where):
        self.interval = _units.number(frameInterval, _units.TIME, where, 'frameInterval')
        if not 0 < self.interval < np.inf:
            raise ValueError(
                f'{where}: frameInterval: got {self.interval} ps; the time between frames must be '
                'finite and positive')
        self.number = _units.integer(numBlocks, where, 'numBlocks')
        self.independent = _units.boolean(independentBodies, where, 'independentBodies')
        if self.number < 1 or self.number*(bodies if self.independent else 1) < 2:
            raise ValueError(
                f'{where}: numBlocks: got {self.number}; errors need at least two blocks: give 2 '
                f'or more')
        self.length = frames // self.number
        self.skipped = frames - self.length*self.number
        if self.length < 2:
            raise ValueError(
                f'{where}: {frames} frames are too few for {self.number} blocks, which need 2 '
                'frames each: give a longer trajectory or fewer blocks')
        if lags is None:
            lags = np.unique(
                np.rint(np.geomspace(1, max(1, self.length // 4), _DEFAULT_LAGS)).astype(int))
        if np.size(lags) == 0:
            raise ValueError(f'{where}: lags: got none; at least one is needed: give numbers '
                             f'of frames from 0 to {self.length - 1}, or leave lags out')
        self.lags = _units.indices(lags, where, 'lags')
        for lag in self.lags:
            if not 0 <= lag < self.length:
                raise ValueError(f'{where}: lags: got a lag of {lag} frames; it must be from 0 to '
                                 f'{self.length - 1}, less than a block: '
                                 'give smaller lags or fewer blocks')

    def cut(self, values):
        """Values (frames, ...) as (blocks, frames of a block, ...)."""
        return values[self.skipped:].reshape((self.number, self.length) + values.shape[1:])

    def average(self, displacements, attach, limit=None):
        """The mean square displacement.

        displacements(lag) gives the displacements of a lag as (blocks, pairs, bodies[, 3]).
        """
        rows = []
        for lag in self.lags:
            d = displacements(lag)
            vector = d if d.ndim == 4 else d[..., None]
            squares = np.einsum('btni,btnj->bnij', vector, vector)/d.shape[1]
            squares = squares.reshape(-1, *squares.shape[2:]) if self.independent else squares.mean(
                axis=1)
            rows.append(squares if d.ndim == 4 else squares[:, 0, 0])
        lagTimes = _units.TIME.attach(self.interval*self.lags)
        return _summarise(lagTimes, np.stack(rows, axis=1), attach, limit)


def _summarise(lagTimes, blocks, attach, limit):
    """A MeanSquareDisplacement of these blocks."""
    mean, error = meanAndError(blocks)
    return MeanSquareDisplacement(lagTimes, attach(mean), attach(error), attach(blocks), limit)


def meanAndError(blocks: Array) -> tuple[Array, Array]:
    """Mean over the first axis and its standard error."""
    return blocks.mean(axis=0), blocks.std(axis=0, ddof=1)/np.sqrt(len(blocks))


def _without_unit(values):
    """The numbers of a Quantity or array, and a function that gives numbers their unit back."""
    if not unit.is_quantity(values):
        return values, lambda numbers: numbers
    return values._value, lambda numbers: unit.Quantity(numbers, values.unit)


def _warn_of_wrapping(R, where):
    """Warn of bodies that jump from face to face of a box, while all others hardly move."""
    for axis in range(3):
        moves = np.abs(np.diff(R[..., axis], axis=0))
        size = np.ptp(R[..., axis])
        frame, body = np.unravel_index(np.argmax(moves), moves.shape)
        if moves[frame, body] > LEAST_JUMP*size and np.median(moves) < LARGEST_MOVE*size:
            warnings.warn(
                f'{where}: positions: body {body} jumps by {moves[frame, body]:.3g} nm along '
                f'{"xyz"[axis]} between frames {frame} and {frame + 1}, from one end of all '
                'positions to the other, as in positions that were wrapped into a box; give '
                'unwrapped positions, of getBodyPositions() or '
                'getState(enforcePeriodicBox=False)', stacklevel=3)
            return


def _direction(bodyVector, where):
    """A vector in the body frame as a unit vector; an error for one without a direction."""
    vector = _units.vector(bodyVector, _units.NONE, where, 'bodyVector')
    length = np.linalg.norm(vector)
    if not 0 < length < np.inf:
        raise ValueError(
            f'{where}: bodyVector: got {vector}; its length must be finite and positive to have a '
            'direction: give another vector')
    return vector/length


def _orientations(orientations, where):
    q = _units.frames(orientations, _units.NONE, 4, where, 'orientations')
    norms = np.linalg.norm(q, axis=-1)
    if np.max(np.abs(norms - 1)) > _NORM_TOLERANCE:
        frame, body = np.unravel_index(np.argmax(np.abs(norms - 1)), norms.shape)
        raise ValueError(
            f'{where}: orientations: frame {frame}, body {body}: a quaternion has length '
            f'{norms[frame, body]:.8g}; '
            'orientations must be unit quaternions (w, x, y, z): normalise them')
    return q/norms[..., None]
