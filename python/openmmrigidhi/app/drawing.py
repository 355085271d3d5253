"""Pictures and films of bodies, by matplotlib, as seen from far away.

They show spheres, orientation marks, walls and boxes.
"""
from __future__ import annotations

import os
from typing import TYPE_CHECKING, Optional, Sequence

import numpy as np
from openmm import NonbondedForce, unit

from .. import _units
from .._types import Numbers, Path
from .._quaternions import rotation_matrices
from .._systems import BodyDefinitions, forces_of, hydrodynamic_radii, walls_of
from ..integrator import CustomRigidHIIntegrator
from ..mobility import MobilityForce
from .bodystates import BodyStates, readBodyStates
from .gsdfiles import readGsd
from .h5mdfiles import readH5md

if TYPE_CHECKING:
    import matplotlib.axes
    import openmm

#: Colours of bodies, by Okabe and Ito, which can be told apart without seeing red and green.
_COLOURS = np.array([(0, 114, 178), (230, 159, 0), (0, 158, 115), (213, 94, 0), (204, 121, 167),
                     (86, 180, 233), (240, 228, 66)])/255
_FREE = np.array([0.62, 0.62, 0.62])
#: Where the light comes from, in the axes of the picture: right, up, towards the viewer.
_LIGHT = np.array([-0.4, 0.5, 0.77])
#: The colour of the half of a body with negative x in its frame is multiplied by this factor.
_SHADE = 0.62
#: Sites without a radius are dots, whose size is this part of the picture's width.
_DOT = 0.006
#: Half the opening angle of a mark on a sphere, rad, and where it ends, so that the rim is seen.
_MARK_ANGLE, _MARK_WITHIN = 0.35, 0.94
#: Up to this number bodies have a colour each; more bodies have one colour for each type.
_EACH_ITS_OWN = 12
#: Units of times, the longest first, in ps.
_TIMES = (('s', 1e12), ('ms', 1e9), ('µs', 1e6), ('ns', 1e3), ('ps', 1))


def show(context: openmm.Context, radii: Optional[Numbers] = None, view: tuple[float,
                                                                               float] = (20, -60),
         wrap: bool = True, ax: Optional[matplotlib.axes.Axes] = None,
         title: Optional[str] = None) -> matplotlib.axes.Axes:
    """Draw the present bodies of a Context, with walls and periodic box.

    In a notebook the picture appears.

    Parameters
    ----------
    context : openmm.Context
        of a CustomRigidHIIntegrator, with positions
    radii : sequence or Quantity, optional
        radius of each particle of the System, nm. The default is the radii of the MobilityForce, or
        else half of sigma of the NonbondedForce. Particles without a radius are dots.
    view : pair of float
        elevation above the plane of x and y, and azimuth of the viewer, degrees; (0, -90) has x to
        the right and z upwards, and (90, -90) looks down on x and y
    wrap : bool
        draw each body, and each free particle, with its origin in the periodic box
    ax : matplotlib.axes.Axes, optional
        where to draw; by default a new figure
    title : str, optional
        by default the time

    Returns
    -------
    matplotlib.axes.Axes
        axes of the picture in nm; ``show(context).figure.savefig(name)`` saves its figure

    Raises
    ------
    TypeError
        if the Context has another integrator
    ValueError
        for invalid radii or an invalid view

    Notes
    -----
    Spheres are drawn in the order of their distance from the viewer, so a sphere in front hides an
    overlapping sphere behind it as a whole. The half of a body with positive x in its frame is
    light, and the other half is dark. A body that is one sphere has marks where its axes x (white)
    and z (black) leave it.
    """
    system = _units.context(context, 'show').getSystem()
    integrator = CustomRigidHIIntegrator.cast(context.getIntegrator())
    state = context.getState(getPositions=True)
    bodies = BodyDefinitions(integrator)
    radii = _radii(system, radii, 'show')
    scene = _Scene(bodies.sites, [radii[particles] for particles in bodies.particles])
    inBodies = np.zeros(system.getNumParticles(), dtype=bool)
    inBodies[bodies.members] = True
    free = np.flatnonzero(~inBodies & (radii > 0))
    positions = state.getPositions(asNumpy=True)._value
    scene.set_free(radii[free])
    box = state.getPeriodicBoxVectors(
        asNumpy=True)._value if system.usesPeriodicBoundaryConditions() else None
    frame = scene.frame(integrator.getBodyPositions()._value, integrator.getBodyOrientations(),
                        positions[free], box if wrap else None)
    picture = _Picture(_view(view, 'show'), _walls(system), [frame], [box])
    ax = picture.axes(ax)
    picture.draw(ax, scene, frame, box)
    time = state.getTime().value_in_unit(unit.picosecond)
    ax.set_title(_time_text(time, time) if title is None else title)
    return ax


def movie(file: Path, output: Optional[Path] = None, context: Optional[openmm.Context] = None,
          radii: Optional[Numbers] = None, view: tuple[float, float] = (20, -60), wrap: bool = True,
          walls: Optional[Sequence[tuple]] = None, every: int = 1, framesPerSecond: float = 12,
          width: float = 5.0, quiet: bool = False) -> str:
    """Draw a trajectory file of bodies frame by frame into a GIF or MP4.

    Parameters
    ----------
    file : str or path
        file of a GsdReporter (.gsd), H5mdReporter or RigidBodyReporter
    output : str or path, optional
        name of the film, which ends in .gif, or in .mp4 where ffmpeg is installed; by default the
        name of the file with .gif
    context : openmm.Context, optional
        its System gives the radii of sites, and walls, where the file has none
    radii : sequence or Quantity, optional
        radius of each site, nm, body after body, or one for all
    view, wrap
        as in show()
    walls : sequence of (axis, place), optional
        planes to draw, such as ``[('z', 0)]``, nm; by default those of the Context
    every : int
        draw one frame out of this number
    framesPerSecond : float
        frames per second of the film
    width : float
        width of the picture, inches of 100 points each
    quiet : bool
        draw no progress bar

    Returns
    -------
    str
        name of the film

    Raises
    ------
    ImportError
        without h5py, gsd or matplotlib
    ValueError
        if the file is of another kind or has no frames, or if an argument is invalid
    """
    every = _units.integer(every, 'movie', 'every')
    if every < 1:
        raise ValueError(f'movie: every: got {every}; it must be positive: give a number of frames')
    if not framesPerSecond > 0:
        raise ValueError(
            f'movie: framesPerSecond: got {framesPerSecond}; it must be positive: give frames a '
            f'second, such as 12')
    name = os.fspath(file)
    output = os.path.splitext(name)[0] + '.gif' if output is None else os.fspath(output)
    kind = os.path.splitext(output)[1]
    if kind not in ('.gif', '.mp4'):
        raise ValueError(f'movie: output: got {output}; its name must end in .gif or .mp4')
    trajectory = _read(name)
    if not len(trajectory):
        raise ValueError(f'movie: {name}: it has no frames to draw: run longer')
    scene = _scene_of(trajectory, context, radii)
    chosen = range(0, len(trajectory), every)
    positions = trajectory.positions._value
    blobs = _free_blobs(trajectory)
    boxes = [
        None if trajectory.boxVectors is None else trajectory.boxVectors._value[k] for k in chosen
    ]
    if isinstance(
            trajectory, BodyStates
    ) and context is not None and not context.getSystem().usesPeriodicBoundaryConditions():
        boxes = [None]*len(boxes)
    frames = [
        scene.frame(positions[k], trajectory.orientations[k], blobs[k], box if wrap else None)
        for k, box in zip(chosen, boxes)
    ]
    picture = _Picture(
        _view(view, 'movie'),
        _given_walls(walls) if walls is not None else
        [] if context is None else _walls(context.getSystem()), frames, boxes)
    _write(picture, scene, frames, boxes, trajectory.time._value[::every], output, framesPerSecond,
           width, quiet)
    return output


def _write(picture, scene, frames, boxes, times, output, framesPerSecond, width, quiet):
    """One matplotlib figure, drawn anew for each frame."""
    import tqdm
    from matplotlib import animation
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    if output.endswith('.mp4') and not animation.FFMpegWriter.isAvailable():
        raise ValueError(
            f'movie: output: {output} needs the program ffmpeg, which is not installed: install '
            f'it, or give a name that ends in .gif')
    figure = Figure(figsize=(width, width*picture.aspect), dpi=100)
    FigureCanvasAgg(figure)
    ax = picture.axes(figure.add_axes((0, 0, 1, 1)))
    writer = (animation.PillowWriter if output.endswith('.gif') else animation.FFMpegWriter)(
        fps=framesPerSecond)
    with writer.saving(figure, output, 100):
        for frame, box, time in tqdm.tqdm(list(zip(frames, boxes, times)), desc='Frames',
                                          disable=quiet):
            ax.clear()
            picture.axes(ax)
            picture.draw(ax, scene, frame, box)
            ax.text(0.02, 0.98, _time_text(time, times[-1]), transform=ax.transAxes, va='top')
            writer.grab_frame()


def _time_text(time, longest):
    """A time in ps as text, in the unit that suits the longest time."""
    name, size = next((each for each in _TIMES if abs(longest) >= each[1]), _TIMES[-1])
    return f't = {time/size:.6g} {name}'


def _read(name):
    """A trajectory of any of this package's kinds of files."""
    if name.endswith('.gsd'):
        return readGsd(name)
    try:
        return readBodyStates(name)
    except ValueError as asStates:
        try:
            return readH5md(name, velocities=False)
        except ValueError as asH5md:
            raise ValueError(
                f'movie: {name}: it must be a file of GsdReporter, whose name ends in .gsd, of '
                f'H5mdReporter or of RigidBodyReporter; '
                f'as the second: {asH5md}; as the third: {asStates}') from None


def _scene_of(trajectory, context, radii):
    """Sites and radii of a trajectory's bodies."""
    count = trajectory.positions._value.shape[1]
    if isinstance(trajectory, BodyStates):
        sites, known = [each._value for each in trajectory.sitePositions], None
    else:
        sites, known = trajectory.sites, trajectory.siteRadii
        if sites is not None:
            sites, known = [each._value for each in sites], [each._value for each in known]
    if context is not None and (sites is None or known is None):
        bodies = BodyDefinitions(CustomRigidHIIntegrator.cast(context.getIntegrator()))
        if len(bodies) != count:
            raise ValueError(
                f'movie: context: it has {len(bodies)} bodies, and the file has {count}; the '
                f'numbers must agree: give the Context of the file')
        each = _radii(context.getSystem(), None, 'movie')
        sites, known = bodies.sites, [each[particles] for particles in bodies.particles]
    if sites is None:
        sites = [np.zeros((1, 3))]*count
    if radii is not None:
        total = sum(map(len, sites))
        if np.ndim(_units.plain(radii)) == 0:
            radii = np.full(total, _units.number(radii, _units.LENGTH, 'movie', 'radii'))
        radii = np.array(_units.per_site(radii, _units.LENGTH, total, 'movie', 'radii'))
        known = np.split(radii, np.cumsum([len(each) for each in sites])[:-1])
    scene = _Scene(sites, known or [np.zeros(len(each)) for each in sites],
                   getattr(trajectory, 'types', None))
    scene.set_free(
        np.zeros(0) if getattr(trajectory, 'blobBodies', None) is None else trajectory.blobRadii.
        _value[trajectory.blobBodies < 0])
    return scene


def _free_blobs(trajectory):
    """Positions of free particles with a radius, frame by frame."""
    if getattr(trajectory, 'blobBodies', None) is None:
        return [np.zeros((0, 3))]*len(trajectory)
    return trajectory.blobPositions._value[:, trajectory.blobBodies < 0]


def _radii(system, radii, where):
    """The radii given, or else those of the MobilityForce, or else half of sigma."""
    found = hydrodynamic_radii(system, radii, where)
    if radii is not None or found.any():
        return found
    for force in system.getForces():
        if isinstance(force, NonbondedForce):
            for i in range(force.getNumParticles()):
                _, sigma, epsilon = force.getParticleParameters(i)
                if epsilon._value > 0:
                    found[i] = sigma.value_in_unit(unit.nanometer)/2
    return found


def _walls(system):
    """(axis, place) of the walls of the System's fluid."""
    fluids = forces_of(system, MobilityForce)
    return [(axis, place) for axis, place, _ in walls_of(fluids[0])] if fluids else []


def _given_walls(walls):
    result = []
    for wall in walls:
        if not (isinstance(wall, (tuple, list)) and len(wall) == 2 and wall[0] in ('x', 'y', 'z')):
            raise ValueError(
                f"movie: walls: got {wall}; a wall must be an axis and a place, such as ('z', 0)")
        result.append(('xyz'.index(wall[0]), _units.number(wall[1], _units.LENGTH, 'movie',
                                                           'walls')))
    return result


def _view(view, where):
    """The axes of the picture, right, up and towards the viewer, as rows."""
    try:
        elevation, azimuth = (np.radians(_units.number(angle, _units.NONE, where, 'view'))
                              for angle in view)
    except (TypeError, ValueError):
        raise ValueError(
            f'{where}: view: got {view}; it must be elevation and azimuth in degrees, such as (20, '
            f'-60)') from None
    toViewer = np.array(
        [np.cos(elevation)*np.cos(azimuth),
         np.cos(elevation)*np.sin(azimuth),
         np.sin(elevation)])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0])
    return np.stack([right, np.cross(toViewer, right), toViewer])


class _Scene:
    """The constants of a film: sites and radii of bodies, colours."""
    def __init__(self, sites, radii, types=None):
        self.sites = np.concatenate([np.zeros((0, 3)), *sites])
        self.radii = np.concatenate([np.zeros(0), *radii])
        counts = np.array([len(each) for each in sites], dtype=int)
        self.owners = np.repeat(np.arange(len(sites)), counts)
        ofBodies = self._colours(counts, types)
        colours = ofBodies[self.owners]
        # Bodies of several sites are light and dark. If all sites have the same x, there is nothing
        # to tell apart.
        dark = np.zeros(len(self.sites), dtype=bool)
        first = np.cumsum(np.concatenate([[0], counts]))
        for a, b in zip(first[:-1], first[1:]):
            x = self.sites[a:b, 0]
            if b - a > 2:
                dark[a:b] = x < 0.5*(x.min() + x.max()) - 1e-9*(1 + np.ptp(x))
        colours[dark] *= _SHADE
        self.colours = colours
        single = np.flatnonzero((counts == 1) if len(counts) else [])
        self.marked = first[single] if len(single) else np.zeros(0, dtype=int)
        self.freeRadii = np.zeros(0)

    @staticmethod
    def _colours(counts, types):
        if len(counts) <= _EACH_ITS_OWN:
            kinds = np.arange(len(counts))
        elif types is not None:
            names = list(dict.fromkeys(types))
            kinds = np.array([names.index(name) for name in types])
        else:
            kinds = np.unique(counts, return_inverse=True)[1]
        return _COLOURS[kinds % len(_COLOURS)] if len(counts) else np.zeros((0, 3))

    def set_free(self, radii):
        """Radii of particles that are in no body."""
        self.freeRadii = np.asarray(radii, dtype=float)

    def frame(self, positions, orientations, free, box):
        """Centres of sites and free particles, and rotation matrices of bodies.

        The centres are in the box, if a box is given.
        """
        positions, free = (_wrapped(np.asarray(each, dtype=float).reshape(-1, 3), box)
                           for each in (positions, free))
        turns = rotation_matrices(np.asarray(
            orientations, dtype=float)) if len(orientations) else np.zeros((0, 3, 3))
        centres = np.einsum('mij,mj->mi', turns[self.owners],
                            self.sites) + positions[self.owners] if len(self.sites) else np.zeros(
                                (0, 3))
        return np.concatenate([centres, free]), turns


class _Picture:
    """A view from far away with limits that hold all frames."""
    def __init__(self, axes, walls, frames, boxes):
        self.view, self.walls = axes, walls
        points = np.concatenate([frame[0] for frame in frames])
        for box in boxes:
            if box is not None:
                points = np.concatenate([points, _corners(box)])
        if not len(points):
            points = np.zeros((1, 3))
        self.lower, self.upper = points.min(axis=0), points.max(axis=0)
        size = max((self.upper - self.lower).max(), 1e-9)
        self.margin = 0.08*size
        for axis, place in walls:
            self.lower[axis], self.upper[axis] = min(self.lower[axis],
                                                     place), max(self.upper[axis], place)
        self.points = points
        self.limits = None

    def _set_limits(self, scene):
        reach = max(scene.radii.max(initial=0), scene.freeRadii.max(initial=0)) + self.margin
        corners = [self._wall_corners(*wall) for wall in self.walls]
        flat = self.points @ self.view[:2].T
        edges = np.concatenate([flat - reach, flat + reach] + [
            corner @ self.view[:2].T + shift for corner in corners
            for shift in (-0.1*self.margin, 0.1*self.margin)
        ])
        self.limits = edges.min(axis=0), edges.max(axis=0)

    @property
    def aspect(self):
        """Approximate ratio of height to width."""
        corners = (_corners(np.diag(self.upper - self.lower)) + self.lower) @ self.view[:2].T
        extent = np.ptp(corners, axis=0) + 4*self.margin
        return float(np.clip(extent[1]/extent[0], 0.4, 1.6))

    def axes(self, ax):
        """The axes given, or new axes, without ticks."""
        if ax is None:
            import matplotlib.pyplot as plt
            _, ax = plt.subplots(figsize=(5, 5*self.aspect))
        ax.set_axis_off()
        ax.set_aspect('equal')
        return ax

    def draw(self, ax, scene, frame, box):
        """Draw everything, the most distant objects first."""
        if self.limits is None:
            self._set_limits(scene)
        (left, low), (right, high) = self.limits
        ax.set_xlim(left, right)
        ax.set_ylim(low, high)
        self._draw_walls(ax)
        if box is not None:
            self._draw_box(ax, box)
        self._draw_spheres(ax, scene, frame)
        self._draw_axes(ax)

    def _wall_corners(self, axis, place):
        """The corners of a wall, a little wider than what is in front of it."""
        first, second = (k for k in range(3) if k != axis)
        corners = np.zeros((4, 3))
        corners[:, axis] = place
        low, high = self.lower - self.margin, self.upper + self.margin
        corners[:, first] = low[first], high[first], high[first], low[first]
        corners[:, second] = low[second], low[second], high[second], high[second]
        return corners

    def _draw_walls(self, ax):
        for wall in self.walls:
            flat = self._wall_corners(*wall) @ self.view[:2].T
            ax.fill(flat[:, 0], flat[:, 1], facecolor='#d9d2c5', edgecolor='#8c8375', alpha=0.6,
                    linewidth=1, zorder=0)

    def _draw_box(self, ax, box):
        from matplotlib.collections import LineCollection
        lines = []
        for k in range(3):
            i, j = (m for m in range(3) if m != k)
            for a in (0, 1):
                for b in (0, 1):
                    start = a*box[i] + b*box[j]
                    lines.append(np.array([start, start + box[k]]) @ self.view[:2].T)
        ax.add_collection(LineCollection(lines, colors='0.45', linewidths=0.8, zorder=1),
                          autolim=False)

    def _draw_spheres(self, ax, scene, frame):
        from matplotlib.collections import EllipseCollection
        centres, turns = frame
        radii = np.concatenate([scene.radii, scene.freeRadii])
        dot = _DOT*(self.limits[1][0] - self.limits[0][0])
        radii = np.where(radii > 0, radii, dot)
        colours = np.concatenate([scene.colours, np.tile(_FREE, (len(scene.freeRadii), 1))])
        places = centres @ self.view.T
        order = np.argsort(places[:, 2], kind='stable')
        places, radii, colours = places[order], radii[order], colours[order]
        position = np.empty(len(order), dtype=int)
        position[order] = np.arange(len(order))
        # Each sphere has a dark rim, its colour, and light from one side. They are discs, one
        # within the other.
        discs = [(places[:, :2] + shift*radii[:, None]*_LIGHT[:2], size*radii, size*radii,
                  np.zeros(len(radii)), np.clip(colours*factor + white, 0, 1))
                 for shift, size, factor, white in ((0, 1, 0.55, 0), (0.04, 0.95, 1, 0),
                                                    (0.22, 0.62, 0.9, 0.1), (0.38, 0.3, 0.7, 0.3))]
        ranks = [np.arange(len(radii)) + part/8 for part in range(len(discs))]
        for column, colour in ((0, (1, 1, 1)), (2, (0, 0, 0))):
            disc, rank = self._marks(scene, turns, column, colour, places, radii, position)
            discs.append(disc)
            ranks.append(rank)
        xy, wide, high, angle, colour = (np.concatenate(parts) for parts in zip(*discs))
        sequence = np.argsort(np.concatenate(ranks), kind='stable')
        ax.add_collection(
            EllipseCollection(2*wide[sequence], 2*high[sequence], angle[sequence], units='xy',
                              offsets=xy[sequence], facecolors=colour[sequence], linewidths=0,
                              transOffset=ax.transData, zorder=2), autolim=False)

    def _marks(self, scene, turns, column, colour, places, radii, position):
        """Discs where an axis leaves a body that is one sphere, if on the side of the viewer."""
        bodies = scene.owners[scene.marked]
        at = position[scene.marked]
        directions = turns[bodies][:, :, column] @ self.view.T if len(bodies) else np.zeros((0, 3))
        seen = (directions[:, 2] > 0.05) & (scene.radii[scene.marked] > 0)
        directions, at = directions[seen], at[seen]
        inside = _MARK_WITHIN*radii[at]
        size = inside*np.sin(_MARK_ANGLE)
        xy = places[at, :2] + inside[:, None]*np.cos(_MARK_ANGLE)*directions[:, :2]
        angle = np.degrees(np.arctan2(directions[:, 1], directions[:, 0]))
        return (xy, size*directions[:, 2], size, angle,
                np.tile(np.array(colour, dtype=float), (len(at), 1))), at + 7/8

    def _draw_axes(self, ax):
        """The lab's axes in a corner."""
        (left, low), (right, high) = self.limits
        length = 0.07*min(right - left, high - low)
        origin = np.array([left + 1.6*length, low + 1.6*length])
        for k, name in enumerate('xyz'):
            end = length*self.view[:2, k]
            if np.hypot(*end) < 0.15*length:
                continue
            ax.annotate('', origin + end, origin, arrowprops={
                'arrowstyle': '->',
                'color': '0.3',
                'linewidth': 0.8
            }, zorder=3)
            ax.text(*(origin + 1.35*end), name, color='0.3', ha='center', va='center',
                    fontsize='small', zorder=3)


def _wrapped(positions, box):
    """Positions in the box whose vectors are the rows of a triangular matrix, as in OpenMM."""
    if box is None:
        return positions
    # In two dimensions a vector is 0; then the pseudo-inverse leaves its direction alone.
    return positions - np.floor(positions @ np.linalg.pinv(box) + 1e-12) @ box


def _corners(vectors):
    """The eight corners of a box at the origin."""
    return np.array([[a, b, c] for a in (0, 1) for b in (0, 1)
                     for c in (0, 1)]) @ np.asarray(vectors, dtype=float)
