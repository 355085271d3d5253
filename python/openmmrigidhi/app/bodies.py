"""Make bodies of residues, and tell OpenMM that a body is one molecule."""
import openmm

from .. import _units
from ..integrator import CustomRigidHIIntegrator
from ..mobility import MobilityForce
from .blobfiles import warnOfUnits

#: Residue names that mean water in PDB files and in the force fields that OpenMM, Amber, CHARMM and
#: GROMACS ship.
WATER_NAMES = ('HOH', 'WAT', 'H2O', 'SOL', 'DOD', 'SPC', 'SPCE', 'TIP3', 'TIP3P', 'TP3', 'TIP4',
               'TIP4P', 'TP4', 'T4P', 'TIP5', 'TIP5P', 'TP5', 'OPC')


def addRigidWater(integrator, topology, system=None):
    """Make every water molecule of a topology one rigid body.

    Extra particles (M sites, lone pairs) are part of the body. If the System was made with
    ``rigidWater=True`` (the default of openmm.app.ForceField.createSystem), the shape comes from
    the System's constraints and virtual sites when the Context is created. It never comes from the
    coordinates of a PDB file. Pass the system to have the constraints checked.

    Parameters
    ----------
    integrator : CustomRigidHIIntegrator
        gets the bodies
    topology : openmm.app.Topology
        the topology, after openmm.app.Modeller.addExtraParticles() if the model has extra particles
    system : openmm.System, optional
        the System, only to check that its constraints fix the shape of every water molecule

    Returns
    -------
    list of int
        indices of the bodies, in the order of the residues

    Raises
    ------
    ValueError
        if the topology has no water, or the constraints of a molecule do not fix its shape
    """
    return addRigidResidues(integrator, topology, WATER_NAMES, system)


def addRigidResidues(integrator, topology, names, system=None):
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
        shape is not fixed by constraints takes its shape from the first positions.

    Returns
    -------
    list of int
        indices of the bodies, in the order of the residues

    Raises
    ------
    ValueError
        if the topology has none of these residues, or the constraints of one do not fix its shape
    """
    integrator = CustomRigidHIIntegrator.cast(integrator)
    if isinstance(names, str):
        raise TypeError(
            f'addRigidResidues: names: got the string {names!r}; it must be a sequence of names: '
            f'give [{names!r}]')
    wanted = set(names)
    residues = [residue for residue in topology.residues() if residue.name in wanted]
    if not residues:
        present = sorted({residue.name for residue in topology.residues()})
        raise ValueError(
            f'addRigidResidues: names: no residue is named {", ".join(sorted(wanted))}; the '
            f'topology has '
            f'{", ".join(present) or "no residues"}: correct the names')
    if system is not None:
        _checkConstraints(residues, system)
    return [
        integrator.addRigidBody([atom.index for atom in residue.atoms()]) for residue in residues
    ]


def _checkConstraints(residues, system):
    """Every pair of massive atoms of every residue must be constrained."""
    constrained = {
        frozenset(system.getConstraintParameters(i)[:2])
        for i in range(system.getNumConstraints())
    }
    for residue in residues:
        massive = [
            atom.index for atom in residue.atoms() if system.getParticleMass(atom.index)._value > 0
        ]
        missing = [(i, j) for k, i in enumerate(massive) for j in massive[:k]
                   if frozenset((i, j)) not in constrained]
        if missing:
            raise ValueError(
                f'addRigidResidues: residue {residue.name} {residue.id}: particles {missing[0][1]} '
                f'and '
                f'{missing[0][0]} have no constraint; the constraints must fix its shape: create '
                f'the System '
                'with rigidWater=True, or pass no system to take the shape from the first positions'
            )


def addRigidMultiblob(system, integrator, mobilityForce, sitePositions, radii, mass=0,
                      principalMoments=(0, 0, 0), particleMasses=None):
    """Add particles to a System and a MobilityForce, and make them one rigid body.

    Call it for one body after the other, before the Context is created, while System and
    MobilityForce have the same number of particles. If an argument is refused, nothing has been
    added. A warning says where sites are so near or far that they and the radii seem to be in
    different units of length.

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
        hydrodynamic radius of all particles or of each, nm; 0: a marker that the fluid does not see
    mass : float or Quantity
        mass of the body, dalton; 0 is enough for overdamped schemes
    principalMoments : Vec3, sequence or Quantity of shape (3,)
        principal moments of inertia about the body axes, dalton nm^2; 0 is enough for overdamped
        schemes
    particleMasses : sequence or Quantity of shape (n,), optional
        masses that OpenMM sees, dalton; None: equal shares of the body's mass

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
        for a number of radii or masses other than that of sites, for negative or non-finite ones,
        or if the MobilityForce and the System have different numbers of particles
    openmm.OpenMMException
        as in CustomRigidHIIntegrator.addRigidBody
    """
    where = 'addRigidMultiblob'
    integrator = CustomRigidHIIntegrator.cast(integrator)
    mobilityForce = MobilityForce.cast(mobilityForce)
    sites = _units.rows(sitePositions, _units.LENGTH, 3, where, 'sitePositions')
    radii = _units.perSite(radii, _units.LENGTH, len(sites), where, 'radii')
    mass = _units.number(mass, _units.MASS, where, 'mass')
    masses = None if particleMasses is None else _units.perSite(particleMasses, _units.MASS,
                                                                len(sites), where, 'particleMasses')
    first = system.getNumParticles()
    if mobilityForce.getNumParticles() != first:
        raise ValueError(
            f'{where}: mobilityForce: it has {mobilityForce.getNumParticles()} particles and the '
            f'System {first}; '
            'the numbers must agree before a body is added: add what is missing')
    # The body comes first, since it checks most: if it throws, nothing has been added.
    body = integrator.addRigidBody(range(first, first + len(sites)), mass, principalMoments, sites)
    for particleMass, radius in zip(masses or len(sites)*[mass/len(sites)], radii):
        system.addParticle(particleMass)
        mobilityForce.addParticle(radius)
    warnOfUnits(sites, radii, where)
    return body


def bindBodies(system, integrator):
    """Tie each body's particles into one molecule, for OpenMM.

    OpenMM keeps molecules whole in ``getState(enforcePeriodicBox=True)``, and Monte Carlo barostats
    scale them as units. An Integrator cannot tell OpenMM what is a molecule. This function adds one
    HarmonicBondForce of strength 0, with bonds from each body's first particle to its other
    particles. Its energy and forces are 0. Call the function before the Context is created. Bodies
    that are held together by constraints, virtual sites or bonds do not need it.

    Parameters
    ----------
    system : openmm.System
        gets the force
    integrator : CustomRigidHIIntegrator
        has the bodies

    Returns
    -------
    openmm.HarmonicBondForce
        the force that was added
    """
    integrator = CustomRigidHIIntegrator.cast(integrator)
    force = openmm.HarmonicBondForce()
    force.setName('openmmrigidhi.app.bindBodies')
    # A force that is not periodic does not make the System periodic, and a periodic force needs a
    # periodic System.
    force.setUsesPeriodicBoundaryConditions(system.usesPeriodicBoundaryConditions())
    for body in range(integrator.getNumRigidBodies()):
        first, *others = integrator.getRigidBodyParticles(body)
        for other in others:
            force.addBond(first, other, 0, 0)
    system.addForce(force)
    return force
