"""The cost of grids: the error of products on a grid against their time.

The products are those with the mobility of force coupling.
"""
from __future__ import annotations

import re
import time
from typing import TYPE_CHECKING, Callable, Optional, Sequence, Union

import numpy as np
import openmm
from scipy.sparse.linalg import LinearOperator, eigsh

from ..integrator import CustomRigidHIIntegrator
from ..mobility import MobilityForce
from . import scenes
from ._results import check_lengths, provenance
from .gridresult import GridResult
from .measurement import NOT_APPLICABLE, STABLE
from .rungs import Spheres
from .scenes import platformProperties

if TYPE_CHECKING:
    from .scenes import Scene

#: The tolerances that are compared by default.
TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10)
#: Finenesses sigma/dx between which all grids are looked at.
FINENESSES = (0.65, 1.7)
#: Widths of envelopes, radii (docs/theory/periodic_fluid.md): of forces, and of torques. The
#: narrower envelopes of torques decide where spheres have torques.
WIDTHS = {'forces': np.pi**-0.5, 'wrenches': (6*np.pi**0.5)**(-1/3)}
#: What is compared: name -> label, description.
OBSERVABLES = {
    'forces': {
        'label': 'products with forces',
        'description': 'velocities of spheres from forces on them, as for blobs: the grid follows '
        'the envelope of forces, sigma = a/sqrt(pi) = 0.564 a'
    },
    'wrenches': {
        'label': 'products with forces and torques',
        'description': 'velocities and angular velocities from forces and torques, as for bodies '
        'that are one sphere: the grid follows the narrower envelope of torques, '
        'sigma_D = a/(6 sqrt(pi))^(1/3) = 0.455 a'
    }
}
#: What setSolverTolerance takes.
LEAST_TOLERANCE, LARGEST_TOLERANCE = 1e-14, 0.1
#: Norms are wanted to two digits.
NORM_TOLERANCE = 0.005
#: Columns that stay empty where a setting was refused.
_NOT_MEASURED = ('nodes', 'fineness', 'described', 'error', 'own_error', 'typical',
                 'seconds_product', 'seconds_median')


def gridSizes(least: float, most: float) -> list[int]:
    """Even numbers of nodes without prime factors above 7.

    Parameters
    ----------
    least, most : float

    Returns
    -------
    list of int
    """
    def is_smooth(n):
        for factor in (2, 3, 5, 7):
            while n % factor == 0:
                n //= factor
        return n == 1

    return [n for n in range(2, int(most) + 1, 2) if n >= least and is_smooth(n)]


def describedGrid(integrator: CustomRigidHIIntegrator) -> tuple[list[int], float]:
    """The grid of a fluid, as an integrator describes it.

    It is the pair (nodes along the edges, tolerance of products).

    Parameters
    ----------
    integrator : CustomRigidHIIntegrator

    Raises
    ------
    ValueError
        if the fluid is on no grid
    """
    found = re.search(
        r'on a grid of (\d+) x (\d+) x (\d+) nodes, whose products have the tolerance ([^,]+)',
        integrator.getEffects()['hydrodynamics'])
    if found is None:
        raise ValueError(
            'the fluid is on no grid; it must be ForceCoupling with the boundary Periodic: choose '
            'these, and the solver MatrixFree')
    return [int(n) for n in found.groups()[:3]], float(found[4])


class GridStudy:
    r"""Error of products with the mobility on a grid, against time and against the fineness.

    D has the self-mobilities of the particles. The matrices
    :math:`d = D^{-1/2} (M_\mathrm{grid} - M) D^{-1/2}` and :math:`m = D^{-1/2} M D^{-1/2}` have no
    units. The error is the norm of d divided by the norm of m: the largest error of velocities
    divided by the largest velocities, for forces of one size. The norm of d alone is the error
    relative to self-mobilities. The error of velocities from random forces is relative to these
    velocities. M is the matrix of lattice sums (``setSolver(Dense)``).

    Parameters
    ----------
    scene : Scene, optional
        spheres in a periodic fluid, in a box with edges along the axes; default: 500 spheres at
        random positions at a volume fraction of 0.1. A driven flow of the fluid is left out.
    tolerances : sequence of float
        tolerances of setSolverTolerance
    finenesses : (float, float) or None
        also study all grids of the box with sigma/dx between these values, by setGridSpacing; None:
        no such grids
    observables : sequence of str
        forces, wrenches
    platform : str
    threads : int
        threads of the CPU platform; with one thread, time is the process's CPU time where other
        programs lengthen the wall-clock time
    seed : int
        seed of random forces

    Examples
    --------
    >>> from openmmrigidhi import accuracy
    >>> scene = accuracy.scenes.periodicSuspension(3)
    >>> study = accuracy.GridStudy(scene, [1e-2, 1e-4], None, ['forces'])
    >>> print(study.run(rounds=1).recommend('forces:0.1%').setting['tolerance'])
    0.0001
    """
    def __init__(self, scene: Optional[Union[Scene, dict[float, Scene]]] = None,
                 tolerances: Sequence[float] = TOLERANCES,
                 finenesses: Optional[tuple[float, float]] = FINENESSES,
                 observables: Sequence[str] = tuple(OBSERVABLES), platform: str = 'CPU',
                 threads: int = 1, seed: int = 1) -> None:
        self.scene = scenes.periodicSuspension(500, 0.1, seed=seed) if scene is None else scene
        if not isinstance(self.scene, scenes.Scene):
            raise ValueError(
                f'GridStudy: scene: got a {type(scene).__name__}; it must be one scene of spheres, '
                f'such as scenes.periodicSuspension()')
        self.spheres = Spheres(self.scene)
        box = self.scene.boxVectors
        if self.spheres.boundary != MobilityForce.Periodic or np.count_nonzero(
                box - np.diag(np.diag(box))):
            raise ValueError(
                'GridStudy: scene: its fluid must be periodic, in a box with edges along the axes: '
                'call setBoundary(Periodic) of its MobilityForce')
        self.edges = np.diag(box)
        self.tolerances = sorted(map(float, tolerances), reverse=True)
        if not all(LEAST_TOLERANCE <= tolerance <= LARGEST_TOLERANCE
                   for tolerance in self.tolerances):
            raise ValueError(
                f'GridStudy: tolerances: got {self.tolerances}; setSolverTolerance() takes '
                f'{LEAST_TOLERANCE:g} to {LARGEST_TOLERANCE:g}: leave out the others')
        self.finenesses = finenesses
        self.observables = list(observables)
        unknown = [name for name in self.observables if name not in OBSERVABLES]
        if unknown or not self.observables or not self.tolerances:
            raise ValueError(
                f'GridStudy: got the observables {self.observables} and the tolerances '
                f'{self.tolerances}; observables are {", ".join(OBSERVABLES)}, and at '
                'least one of each is needed')
        self.platform = platform
        self.threads = threads
        self.seed = seed

    def makeContext(
            self, observable: str, solver: int, tolerance: float,
            spacing: float = 0.0) -> tuple[MobilityForce, CustomRigidHIIntegrator, openmm.Context]:
        """The spheres in a fluid, as free particles or as bodies.

        Parameters
        ----------
        observable : str
            'forces': free particles, which take no torques; 'wrenches': bodies
        solver : constant
            constant of MobilityForce
        tolerance : float
        spacing : float
            nm; 0: the spacing for the tolerance

        Returns
        -------
        (MobilityForce, CustomRigidHIIntegrator, openmm.Context)
        """
        system, fluid, integrator = openmm.System(), MobilityForce(), CustomRigidHIIntegrator(0, 1)
        integrator.setScheme(CustomRigidHIIntegrator.EulerMaruyama)
        system.setDefaultPeriodicBoxVectors(*np.diag(self.edges))
        fluid.setViscosity(self.spheres.viscosity)
        fluid.setModel(MobilityForce.ForceCoupling)
        fluid.setBoundary(MobilityForce.Periodic)
        fluid.setSolver(solver)
        fluid.setSolverTolerance(tolerance)
        fluid.setGridSpacing(spacing)
        for radius in self.spheres.radii:
            particle = system.addParticle(0)
            fluid.addParticle(radius)
            if observable == 'wrenches':
                integrator.addRigidBody([particle], 0, (0, 0, 0), [(0, 0, 0)])
        system.addForce(fluid)
        context = openmm.Context(system, integrator,
                                 openmm.Platform.getPlatformByName(self.platform),
                                 platformProperties(self.platform, self.threads))
        context.setPositions(self.spheres.centres)
        return fluid, integrator, context

    @staticmethod
    def _product(observable, fluid, context, vector):
        if observable == 'wrenches':
            return fluid.applyMobilityInContext(context, vector.reshape(-1, 6)).ravel()
        return fluid.applyBlobMobilityInContext(context, vector.reshape(-1, 3))._value.ravel()

    def run(self, rounds: int = 5, progress: Optional[Callable] = None) -> GridResult:
        """Compute and time everything.

        Parameters
        ----------
        rounds : int
            number of rounds in which the tolerances take turns with a product each; the fastest
            product counts
        progress : callable, optional
            called with (done, total, text)

        Returns
        -------
        GridResult
        """
        check_lengths('GridStudy.run', rounds=rounds)
        began = time.perf_counter()
        settings = [(observable, *setting) for observable in self.observables
                    for setting in self._settings(observable)]
        total, done = 1 + len(settings) + rounds, 0

        def count(text):
            nonlocal done
            done += 1
            if progress is not None:
                progress(done, total, text)

        fluid, _, context = self.makeContext('wrenches', MobilityForce.Dense, 1e-6)
        matrix = fluid.getMobilityInContext(context)
        n = len(self.spheres.radii)
        dense = self._seconds('wrenches', fluid, context, np.ones(6*n))
        del context
        count('lattice sums')
        exact = {
            'wrenches': matrix,
            'forces': matrix.reshape(n, 6, n, 6)[:, :3, :, :3].reshape(3*n, 3*n)
        }
        norms = {
            name: self._norm(
                lambda vector, M=exact[name], root=np.sqrt(np.diag(exact[name])): M @ (vector.ravel(
                )/root)/root, len(exact[name]))
            for name in self.observables
        }
        rows, timed = [], []
        for observable, kind, value, spacing in settings:
            row = {
                'observable': observable,
                'kind': kind,
                'setting': value,
                'status': STABLE,
                'message': '',
                **dict.fromkeys(_NOT_MEASURED)
            }
            rows.append(row)
            try:
                fluid, integrator, context = self.makeContext(
                    observable, MobilityForce.MatrixFree, value if kind == 'tolerance' else 1e-6,
                    spacing)
                nodes, row['described'] = describedGrid(integrator)
                row['nodes'] = ' x '.join(map(str, nodes))
                row['fineness'] = float(
                    WIDTHS[observable]*self.spheres.radii.min()/max(self.edges/nodes))
                row['own_error'], row['typical'] = self._errors(observable, fluid, context,
                                                                exact[observable])
                row['error'] = row['own_error']/norms[observable]
                if kind == 'tolerance':
                    timed.append((row, fluid, context, []))
            except openmm.OpenMMException as error:
                row['status'], row['message'] = NOT_APPLICABLE, str(error)
            count(f'{OBSERVABLES[observable]["label"]}, {kind} {value:.3g}')
        rng = np.random.default_rng(self.seed)
        for _ in range(rounds):
            for k in rng.permutation(len(timed)):
                row, fluid, context, times = timed[k]
                times.append(
                    self._seconds(row['observable'], fluid, context,
                                  np.ones(len(exact[row['observable']]))))
            count('timing')
        for row, _, _, times in timed:
            row['seconds_product'], row['seconds_median'] = min(times), float(np.median(times))
        about = {
            'name': self.scene.name,
            'description': self.scene.description,
            'bodies': n,
            'edges': self.edges.tolist(),
            'least_radius': float(self.spheres.radii.min()),
            'seconds_dense': dense
        }
        return GridResult(
            about, rows, {
                name: dict(OBSERVABLES[name], width=float(WIDTHS[name]), norm=norms[name])
                for name in self.observables
            }, {
                'rounds': rounds,
                'threads': self.threads,
                'seed': self.seed,
                'platform': self.platform,
                **provenance(began)
            })

    def _settings(self, observable):
        """(kind, value, spacing), where value is a tolerance, or sigma/dx."""
        settings = [('tolerance', tolerance, 0.0) for tolerance in self.tolerances]
        if self.finenesses is not None:
            width = WIDTHS[observable]*self.spheres.radii.min()
            edge = max(self.edges)
            # The spacing is a little more than the edge over the nodes, so that rounding does not
            # add a node.
            settings += [('spacing', width*nodes/edge, edge/nodes*(1 + 1e-9))
                         for nodes in gridSizes(*(fineness*edge/width
                                                  for fineness in self.finenesses))]
        return settings

    def _errors(self, observable, fluid, context, exact):
        """The norm of the error relative to self-mobilities, and the error for random forces.

        The latter is the root of the mean square of relative errors of velocities.
        """
        root = np.sqrt(np.diag(exact))

        def difference(vector):
            forces = vector.ravel()/root
            return (self._product(observable, fluid, context, forces) - exact @ forces)/root

        rng, squares = np.random.default_rng(self.seed), []
        for _ in range(4):
            vector = rng.normal(size=len(exact))
            squares.append(
                (np.linalg.norm(difference(vector))/np.linalg.norm(exact @ (vector/root)/root))**2)
        return self._norm(difference, len(exact)), float(np.sqrt(np.mean(squares)))

    def _norm(self, apply, rows):
        """The norm of a symmetric operator."""
        start = np.random.default_rng(self.seed).normal(size=rows)
        return float(
            abs(
                eigsh(LinearOperator((rows, rows), matvec=apply, dtype=float), k=1, which='LM',
                      tol=NORM_TOLERANCE, v0=start, return_eigenvectors=False)[0]))

    def _seconds(self, observable, fluid, context, vector):
        """Seconds of one product.

        They are by the clock, or the process's CPU time if it is less because other programs
        disturb.
        """
        began, cpu = time.perf_counter(), time.process_time()
        self._product(observable, fluid, context, vector)
        cpu, wall = time.process_time() - cpu, time.perf_counter() - began
        return min(wall, cpu) if self.threads == 1 else wall
