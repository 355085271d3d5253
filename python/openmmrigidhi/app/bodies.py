"""Make bodies from residues, and tell OpenMM that a body is one molecule."""
from __future__ import annotations

import collections
import itertools
import warnings
from typing import TYPE_CHECKING, Optional, Sequence

import openmm

from .. import _units
from .._types import Number, Numbers
from ..integrator import CustomRigidHIIntegrator
from ..mobility import MobilityForce
from .blobfiles import warnOfUnits

if TYPE_CHECKING:
    import openmm.app

#: Residue names that mean water in PDB files and in the force fields that OpenMM, Amber, CHARMM and
#: GROMACS ship.
WATER_NAMES = ('HOH', 'WAT', 'H2O', 'SOL', 'DOD', 'TIP', 'SPC', 'SPCE', 'SPE', 'TIP3', 'TIP3P',
               'T3P', 'TP3', 'TIP4', 'TIP4P', 'T4P', 'T4E', 'TP4', 'TP4E', 'TIP5', 'TIP5P', 'T5P',
               'T5E', 'TP5', 'OPC', 'OPC3', 'OP3', 'FB3', 'FB4', 'T3F', 'T4F', 'TP3F', 'TP4F')


def addRigidWater(integrator: CustomRigidHIIntegrator, topology: openmm.app.Topology,
                  system: Optional[openmm.System] = None, names: Sequence[str] = (),
                  skipFrozen: Optional[bool] = None) -> list[int]:
    """Make every water molecule of a topology one rigid body.

    Extra particles (M sites, lone pairs) are part of the body. If the System was made with
    ``rigidWater=True`` (the default of openmm.app.ForceField.createSystem), the shape comes from
    the System's constraints and virtual sites at Context creation. It never comes from the
    coordinates of a PDB file. Pass the system to check the constraints, and to find virtual sites
    that the topology lacks.

    The residue names of :data:`WATER_NAMES` and of names identify water. A warning names other
    residues that have the composition of water and are left out.

    Parameters
    ----------
    integrator : CustomRigidHIIntegrator
        gets the bodies
    topology : openmm.app.Topology
        the topology, after openmm.app.Modeller.addExtraParticles() if the model has extra particles
    system : openmm.System, optional
        the System. Its constraints must fix the shape of every water molecule. Virtual sites whose
        parents are all in one molecule become part of its body, even if the topology lacks them, as
        topologies of OpenFF do.
    names : sequence of str, optional
        additional residue names of water
    skipFrozen : bool, optional
        whether to leave out molecules whose particles have mass 0 in the System, so that they stay
        where they are. None: leave them out, with a warning that gives their number. False: make
        them bodies without mass, for schemes without momenta in a fluid. True needs the system.

    Returns
    -------
    list of int
        indices of the bodies, in the order of the residues

    Raises
    ------
    ValueError
        if the topology has no water, a residue of such a name is not one water molecule, the
        constraints of a molecule do not fix its shape, topology and System do not belong together,
        or skipFrozen is True without a system
    """
    where = 'addRigidWater'
    integrator = CustomRigidHIIntegrator.cast(integrator)
    wanted = {*WATER_NAMES, *_names(names, where)}
    residues = [residue for residue in topology.residues() if residue.name in wanted]
    others = [
        residue for residue in topology.residues()
        if residue.name not in wanted and _elements(residue) == _WATER
    ]
    if not residues:
        present = sorted({residue.name for residue in topology.residues()})
        like = sorted({residue.name for residue in others})
        raise ValueError(
            f'{where}: topology: no residue has a name that means water; the topology has '
            f'{", ".join(present) or "no residues"}: give the residue names of water as '
            f'names={like or ["..."]}')
    for residue in residues:
        if _elements(residue) - _WATER:
            found = ', '.join(f'{n} {symbol}' for symbol, n in sorted(_elements(residue).items()))
            raise ValueError(f'{where}: residue {residue.name} {residue.id} has {found}; each '
                             'residue must be one water molecule: make each molecule a residue, or '
                             'rename what is not water')
    particles = _ParticlesOfAtoms(topology, system, where)
    skipped = collections.Counter(residue.name for residue in others
                                  if not particles.are_frozen(residue))
    if skipped:
        warnings.warn(
            f'{where}: {_counted(skipped)} have the composition of water, but are not made bodies, '
            f'since their name is not known: give names={sorted(skipped)} to include them',
            stacklevel=2)
    return _add_residues(integrator, residues, particles, skipFrozen, where)


def addRigidResidues(integrator: CustomRigidHIIntegrator, topology: openmm.app.Topology,
                     names: Sequence[str], system: Optional[openmm.System] = None,
                     skipFrozen: bool = False, fromPositions: bool = False) -> list[int]:
    """Make every residue with one of these names one rigid body.

    Parameters
    ----------
    integrator : CustomRigidHIIntegrator
        gets the bodies
    topology : openmm.app.Topology
        the topology
    names : sequence of str
        residue names
    system : openmm.System, optional
        if given, the constraints must fix the shape of every residue. Without it, a residue whose
        shape the constraints do not fix takes its shape from the first positions. Virtual sites of
        the System become part of bodies as in :func:`addRigidWater`.
    skipFrozen : bool, optional
        whether to leave out residues whose particles have mass 0 in the System, as in
        :func:`addRigidWater`; None: leave them out, with a warning that gives their number. True
        needs the system.
    fromPositions : bool, optional
        take the shape of a residue from the first positions where constraints do not fix it, and
        tie its particles into one molecule for OpenMM, as :func:`bindBodies` does, so that boxes
        and barostats keep it whole even without bonds. True needs the system.

    Returns
    -------
    list of int
        indices of the bodies, in the order of the residues

    Raises
    ------
    ValueError
        if the topology has none of these residues, the constraints of one do not fix its shape and
        fromPositions is False, topology and System do not belong together, or skipFrozen or
        fromPositions is True without a system
    """
    where = 'addRigidResidues'
    integrator = CustomRigidHIIntegrator.cast(integrator)
    wanted = _names(names, where)
    residues = [residue for residue in topology.residues() if residue.name in wanted]
    if not residues:
        present = sorted({residue.name for residue in topology.residues()})
        raise ValueError(
            f'{where}: names: no residue is named {", ".join(sorted(wanted))}; the topology has '
            f'{", ".join(present) or "no residues"}')
    fromPositions = _units.boolean(fromPositions, where, 'fromPositions')
    if fromPositions and system is None:
        raise ValueError(
            f'{where}: fromPositions: got True without a system; OpenMM must be told there what is '
            'a molecule: give the system, too, or leave fromPositions out')
    bodies = _add_residues(integrator, residues, _ParticlesOfAtoms(topology, system, where),
                           skipFrozen, where, fromPositions)
    if system is not None and fromPositions:
        _bind(system, [integrator.getRigidBodyParticles(body) for body in bodies])
    return bodies


#: What a residue of water is made of, beside extra particles.
_WATER = collections.Counter(O=1, H=2)


def _names(names, where):
    """A set of residue names."""
    if isinstance(names, str):
        raise TypeError(f'{where}: names: got the string {names!r}; it must be a sequence of '
                        f'names: give [{names!r}]')
    return set(names)


def _elements(residue):
    """The number of atoms of each element in a residue; extra particles and beads have none."""
    symbols = (atom.element.symbol for atom in residue.atoms()
               if atom.element is not None and atom.element.mass._value > 0)
    return collections.Counter('H' if symbol == 'D' else symbol for symbol in symbols)


def _counted(names):
    return ', '.join(f'{count} residues named {name}' for name, count in sorted(names.items()))


class _ParticlesOfAtoms:
    """The System's particles of a topology's atoms.

    Some programs write topologies without the virtual sites of the System. Virtual sites may then
    lie behind all atoms, or between them.
    """
    def __init__(self, topology, system, where):
        self.system = system
        self.where = where
        count = topology.getNumAtoms()
        if system is None:
            self.indices = range(count)
            return
        real = [i for i in range(system.getNumParticles()) if not system.isVirtualSite(i)]
        self.indices = range(count)
        if count > system.getNumParticles() or any(
                system.isVirtualSite(atom.index)
                for atom in topology.atoms() if atom.element is not None):
            self.indices = real
        if count > len(self.indices):
            raise ValueError(
                f'{where}: topology: it has {count} atoms, and the System has '
                f'{system.getNumParticles()} particles, {len(real)} of which are no virtual sites; '
                'the atoms must be all particles, or all that are no virtual sites: give the '
                'topology that the System was made from')
        self.sitesOfParent = collections.defaultdict(list)
        for i in set(range(system.getNumParticles())) - set(real):
            self.sitesOfParent[system.getVirtualSite(i).getParticle(0)].append(i)

    def of(self, residue):
        """The particles of a residue."""
        return [self.indices[atom.index] for atom in residue.atoms()]

    def are_frozen(self, residue):
        """Whether all particles of a residue have mass 0, as far as the System is known."""
        return self.system is not None and all(
            self.system.getParticleMass(i)._value == 0 for i in self.of(residue))

    def dependent_sites(self, particles, taken):
        """Virtual sites with all parents among these particles, except sites already taken."""
        found = []
        family = set(particles)
        queue = list(particles)
        while queue and self.system is not None:
            for i in self.sitesOfParent.get(queue.pop(0), ()):
                site = self.system.getVirtualSite(i)
                parents = {site.getParticle(k) for k in range(site.getNumParticles())}
                if i not in family and i not in taken and parents <= family:
                    found.append(i)
                    family.add(i)
                    queue.append(i)
        return sorted(found)


def _add_residues(integrator, residues, particles, skipFrozen, where, fromPositions=False):
    """Make a body of each residue; the indices of the bodies."""
    if skipFrozen is not None:
        skipFrozen = _units.boolean(skipFrozen, where, 'skipFrozen')
        if skipFrozen and particles.system is None:
            raise ValueError(f'{where}: skipFrozen: got True without a system; masses are in the '
                             'System: give the system, too')
    frozen = [residue for residue in residues if particles.are_frozen(residue)]
    if skipFrozen is not False and frozen:
        if skipFrozen is None:
            names = collections.Counter(residue.name for residue in frozen)
            warnings.warn(
                f'{where}: {_counted(names)} have mass 0 in the System and are not made bodies, so '
                'that they stay where they are: give skipFrozen=True to leave them out without a '
                'warning, or skipFrozen=False to make them bodies without mass', stacklevel=3)
        left = set(map(id, frozen))
        residues = [residue for residue in residues if id(residue) not in left]
    if particles.system is not None and not fromPositions:
        _check_constraints(residues, particles, where)
    members = [particles.of(residue) for residue in residues]
    taken = {i for body in members for i in body}
    return [
        integrator.addRigidBody(body + particles.dependent_sites(body, taken)) for body in members
    ]


def _check_constraints(residues, particles, where):
    """Every pair of massive atoms of every residue must be constrained."""
    system = particles.system
    constrained = {
        frozenset(system.getConstraintParameters(i)[:2])
        for i in range(system.getNumConstraints())
    }
    for residue in residues:
        massive = [i for i in particles.of(residue) if system.getParticleMass(i)._value > 0]
        missing = [(i, j) for k, i in enumerate(massive) for j in massive[:k]
                   if frozenset((i, j)) not in constrained]
        if not missing:
            continue
        if _elements(residue) != _WATER:
            remedy = ('add one for each pair by System.addConstraint()')
        elif residue.name == 'HOH':
            remedy = 'create the System with rigidWater=True'
        else:
            remedy = ('add one for each pair by System.addConstraint(), or name the residue HOH '
                      "before the System is created with rigidWater=True, since OpenMM's "
                      'ForceField takes no other name for water')
        raise ValueError(
            f'{where}: residue {residue.name} {residue.id}: particles {missing[0][1]} and '
            f'{missing[0][0]} have no constraint; the constraints must fix its shape: {remedy}, or '
            'pass no system to take the shape from the first positions'
            f'{" (or fromPositions=True)" if where == "addRigidResidues" else ""}')


def addRigidMultiblob(system: openmm.System, integrator: CustomRigidHIIntegrator,
                      mobilityForce: MobilityForce, sitePositions: Numbers, radii: Numbers,
                      mass: Number = 0, principalMoments: Numbers = (0, 0, 0),
                      particleMasses: Optional[Numbers] = None) -> int:
    """Add particles to a System and a MobilityForce, and make them one rigid body.

    Call it for one body after the other, before Context creation, while System and MobilityForce
    have the same number of particles. If an argument is invalid, the function adds nothing. A
    warning appears where sites are so near or far that they and the radii seem to be in different
    units of length.

    Parameters
    ----------
    system : openmm.System
        gets one particle for each site
    integrator : CustomRigidHIIntegrator
        gets the body, with explicit geometry
    mobilityForce : MobilityForce
        gets the particles' radii; add it to the System yourself, before or after
    sitePositions : array-like or Quantity of shape (n, 3)
        position of each particle in the body frame, nm, as the builders of shapes return them. The
        frame's origin is the tracking point. For schemes with momenta it must be the centre of
        mass, and the axes must be principal axes.
    radii : float, or sequence or Quantity of shape (n,)
        hydrodynamic radius of all particles or of each, nm; 0: a marker that does not interact with
        the fluid
    mass : float or Quantity
        mass of the body, dalton; 0 is enough for overdamped schemes
    principalMoments : Vec3, sequence or Quantity of shape (3,)
        principal moments of inertia about the body axes, dalton nm^2; 0 is enough for overdamped
        schemes
    particleMasses : sequence or Quantity of shape (n,), optional
        masses for OpenMM, dalton; None: equal shares of the body's mass

    Returns
    -------
    int
        index of the body. Its particles are the System's last ones;
        ``integrator.getRigidBodyParticles`` gives their indices.

    Raises
    ------
    TypeError
        for arguments of another kind or dimension
    ValueError
        if the numbers of radii, masses and sites differ, for negative or non-finite ones, or if the
        MobilityForce and the System have different numbers of particles
    openmm.OpenMMException
        as in CustomRigidHIIntegrator.addRigidBody
    """
    where = 'addRigidMultiblob'
    integrator = CustomRigidHIIntegrator.cast(integrator)
    mobilityForce = MobilityForce.cast(mobilityForce)
    sites = _units.rows(sitePositions, _units.LENGTH, 3, where, 'sitePositions')
    radii = _units.per_site(radii, _units.LENGTH, len(sites), where, 'radii')
    mass = _units.number(mass, _units.MASS, where, 'mass')
    masses = None if particleMasses is None else _units.per_site(
        particleMasses, _units.MASS, len(sites), where, 'particleMasses')
    first = system.getNumParticles()
    if mobilityForce.getNumParticles() != first:
        raise ValueError(
            f'{where}: mobilityForce: it has {mobilityForce.getNumParticles()} particles and the '
            f'System {first}; the numbers must agree before a body is added: add what is missing')
    # The body comes first, since it checks most: if it throws, nothing has been added.
    body = integrator.addRigidBody(range(first, first + len(sites)), mass, principalMoments, sites)
    for particleMass, radius in zip(masses or len(sites)*[mass/len(sites)], radii):
        system.addParticle(particleMass)
        mobilityForce.addParticle(radius)
    warnOfUnits(sites, radii, where)
    return body


def bindBodies(system: openmm.System,
               integrator: CustomRigidHIIntegrator) -> openmm.HarmonicBondForce:
    """Tie each body's particles into one molecule, for OpenMM.

    OpenMM keeps molecules whole in ``getState(enforcePeriodicBox=True)``, and Monte Carlo barostats
    scale them as units. An Integrator cannot tell OpenMM what is a molecule. This function adds one
    HarmonicBondForce of strength 0, with bonds from each body's first particle to its other
    particles. Its energy and forces are 0. Call the function before Context creation. Bodies held
    together by constraints, virtual sites or bonds do not need it.

    Parameters
    ----------
    system : openmm.System
        gets the force
    integrator : CustomRigidHIIntegrator
        has the bodies

    Returns
    -------
    openmm.HarmonicBondForce
        the added force
    """
    integrator = CustomRigidHIIntegrator.cast(integrator)
    return _bind(
        system,
        [integrator.getRigidBodyParticles(body) for body in range(integrator.getNumRigidBodies())])


def excludeWithinBodies(system: openmm.System, integrator: CustomRigidHIIntegrator) -> int:
    """Exclude each body's particles from acting on each other.

    Forces within a rigid body move nothing, but cost time. Their energies may be so large that in
    single precision rounding disturbs barostats and minimisers. This function adds exceptions
    without charge and epsilon to each NonbondedForce, and exclusions to each CustomNonbondedForce.
    It does not change other forces between pairs, such as GayBerneForce or CustomGBForce.
    Exceptions that are there already stay as they are. Call the function before Context creation.

    Parameters
    ----------
    system : openmm.System
        its forces get the exclusions
    integrator : CustomRigidHIIntegrator
        has the bodies

    Returns
    -------
    int
        the number of pairs that some force did not exclude before

    Notes
    -----
    A body of n particles has n(n - 1)/2 pairs. For bodies of thousands of particles choose forces
    without pairs of the body from the start, such as interaction groups.
    """
    integrator = CustomRigidHIIntegrator.cast(integrator)
    pairs = {
        pair
        for body in range(integrator.getNumRigidBodies())
        for pair in itertools.combinations(sorted(integrator.getRigidBodyParticles(body)), 2)
    }
    added = set()
    for force in system.getForces():
        if isinstance(force, openmm.NonbondedForce):
            known = {
                tuple(sorted(force.getExceptionParameters(i)[:2]))
                for i in range(force.getNumExceptions())
            }
            missing = sorted(pairs - known)
            for one, other in missing:
                force.addException(one, other, 0, 1, 0)
        elif isinstance(force, openmm.CustomNonbondedForce):
            known = {
                tuple(sorted(force.getExclusionParticles(i)))
                for i in range(force.getNumExclusions())
            }
            missing = sorted(pairs - known)
            for one, other in missing:
                force.addExclusion(one, other)
        else:
            continue
        added.update(missing)
    return len(added)


def _bind(system, molecules):
    """Tie the particles of each molecule together by bonds of strength 0, whose force is added."""
    force = openmm.HarmonicBondForce()
    force.setName('openmmrigidhi.app.bindBodies')
    # A force that is not periodic does not make the System periodic, and a periodic force needs a
    # periodic System.
    force.setUsesPeriodicBoundaryConditions(system.usesPeriodicBoundaryConditions())
    for first, *others in molecules:
        for other in others:
            force.addBond(first, other, 0, 0)
    system.addForce(force)
    return force


def bodyTopology(system: openmm.System, integrator: CustomRigidHIIntegrator,
                 names: Optional[Sequence[str]] = None) -> openmm.app.Topology:
    """Make a topology for bodies without chemical elements, such as colloids.

    ``openmm.app.Simulation`` and reporters need a topology. Each body is a residue (several where
    other particles lie between its own), and so is each particle in no body. Atoms have no element.
    Each body's particles are bonded to its first particle, so that drawing programs keep molecules
    together.

    Parameters
    ----------
    system : openmm.System
        has all its particles
    integrator : CustomRigidHIIntegrator
        has the bodies
    names : sequence of str, optional
        residue name of each body; None: BDY. PDB files have room for three letters.

    Returns
    -------
    openmm.app.Topology
        with the System's default box, if the System is periodic

    Raises
    ------
    ValueError
        if the numbers of names and bodies differ, or for bodies with particles that the System
        lacks

    Examples
    --------
    >>> import openmm, openmmrigidhi
    >>> system, fluid = openmm.System(), openmmrigidhi.MobilityForce()
    >>> integrator = openmmrigidhi.CustomRigidHIIntegrator(300, 0.01)
    >>> sites = openmmrigidhi.app.rod(3, 1.0)
    >>> body = openmmrigidhi.app.addRigidMultiblob(system, integrator, fluid, sites, 0.5)
    >>> topology = openmmrigidhi.app.bodyTopology(system, integrator)
    >>> [residue.name for residue in topology.residues()], topology.getNumAtoms()
    (['BDY'], 3)
    """
    import openmm.app
    where = 'bodyTopology'
    integrator = CustomRigidHIIntegrator.cast(integrator)
    bodies = [
        integrator.getRigidBodyParticles(body) for body in range(integrator.getNumRigidBodies())
    ]
    if names is None:
        names = len(bodies)*['BDY']
    if isinstance(names, str) or len(names) != len(bodies):
        raise ValueError(f'{where}: names: got {names!r} for {len(bodies)} bodies; each body needs '
                         'a name of its own: give one for each')
    owner = {particle: body for body, particles in enumerate(bodies) for particle in particles}
    count = system.getNumParticles()
    if owner and max(owner) >= count:
        raise ValueError(f'{where}: system: body {owner[max(owner)]} needs particle {max(owner)}, '
                         f'but the System has {count} particles; the bodies must be of this '
                         'System: add its particles first')
    topology = openmm.app.Topology()
    chain = topology.addChain()
    residue, last, inResidue, first = None, None, 0, {}
    for particle in range(count):
        # Particles in no body are residues of their own. OpenMM wants the atoms of a residue in one
        # row, so that a body whose particles lie apart is several residues with bonds.
        body = owner.get(particle)
        if body is None or body != last:
            residue = topology.addResidue('FRE' if body is None else names[body], chain)
            inResidue = 0
        last, inResidue = body, inResidue + 1
        atom = topology.addAtom(f'B{inResidue}', None, residue)
        if body is not None and first.setdefault(body, atom) is not atom:
            topology.addBond(first[body], atom)
    if system.usesPeriodicBoundaryConditions():
        topology.setPeriodicBoxVectors(system.getDefaultPeriodicBoxVectors())
    return topology
