"""Methods to compare: one method is one curve in the picture.

A study adds the quantity that changes along the curve. The name of a method is the name of a way to
integrate, followed by the differences from the scene. LangevinC-I8-g2-G4 is LangevinC with moments
times 8 and frictions of 2/ps and 4/ps. LangevinMiddle-H3 has hydrogens of 3 dalton. :data:`OPTIONS`
lists the letters, and :func:`byName` reads such names.
"""
from __future__ import annotations

import copy
import functools
import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Callable, Optional

import openmm

from .. import _schemes, _units
from ..integrator import CustomRigidHIIntegrator

if TYPE_CHECKING:
    from .scenes import Scene


@dataclass(frozen=True)
class Method:
    """A way to integrate a scene.

    Parameters
    ----------
    name : str
        name in tables and pictures
    makeIntegrator : callable
        (scene, stepSize in ps, seed) -> openmm.Integrator; a module-level function, so that another
        process can receive it
    order : int
        weak order of the error in the step size
    whyNot : callable, optional
        scene -> None, or the reason why the method cannot run in this scene
    description : str
    prepare : callable, optional
        scene -> Scene: the scene of the method's runs, if the System must be another; canonical
        averages over configurations must be those of the original scene
    """

    name: str
    makeIntegrator: Callable
    order: int = 2
    whyNot: Optional[Callable] = None
    description: str = ''
    prepare: Optional[Callable] = None

    def sceneOf(self, scene: Scene) -> Scene:
        """The scene of the method's runs: the result of `prepare` for this scene.

        Parameters
        ----------
        scene : Scene

        Returns
        -------
        Scene
        """
        return scene if self.prepare is None else self.prepare(scene)


class RigidScheme:
    """Makes the scene's own integrator with one of the plugin's schemes.

    Parameters
    ----------
    scheme : int
        a constant of CustomRigidHIIntegrator
    inertiaScale : float, optional
        factor that replaces the scene's
    friction, rotationalFriction : float, optional
        1/ps, replaces the scene's; bodies with their own frictions (setBodyFriction) keep them
    """
    def __init__(self, scheme: int, inertiaScale: Optional[float] = None,
                 friction: Optional[float] = None,
                 rotationalFriction: Optional[float] = None) -> None:
        self.scheme = scheme
        self.inertiaScale = inertiaScale
        self.friction = friction
        self.rotationalFriction = rotationalFriction

    def __call__(self, scene, stepSize, seed):
        integrator = scene.makeIntegrator()
        integrator.setScheme(self.scheme)
        if self.inertiaScale is not None:
            integrator.setInertiaScale(self.inertiaScale)
        if self.friction is not None:
            integrator.setFriction(self.friction)
        if self.rotationalFriction is not None:
            integrator.setRotationalFriction(self.rotationalFriction)
        integrator.setStepSize(stepSize)
        integrator.setRandomNumberSeed(seed)
        return integrator


class LangevinMiddle:
    """Makes OpenMM's LangevinMiddleIntegrator, or a multiple-time-step version of it.

    The second version evaluates reciprocal space only in every few steps, for a scene from
    :func:`reciprocalSpaceApart`. It is an impulse method. In each `every`-th step the force of
    reciprocal space kicks `every` times as long, and in the other steps not at all. It is a
    CustomIntegrator whose step is the short step. It therefore places virtual sites before each
    evaluation of forces; OpenMM's MTSLangevinIntegrator does not.

    Parameters
    ----------
    friction : float, optional
        1/ps, replaces the scene's
    every : int
        1: all forces in every step
    """
    def __init__(self, friction: Optional[float] = None, every: int = 1) -> None:
        self.friction = friction
        self.every = every

    def __call__(self, scene, stepSize, seed):
        friction = scene.friction if self.friction is None else self.friction
        if self.every == 1:
            integrator = openmm.LangevinMiddleIntegrator(scene.temperature, friction, stepSize)
        else:
            integrator = self._with_slow_kicks(scene, friction, stepSize)
        integrator.setRandomNumberSeed(seed)
        return integrator

    def _with_slow_kicks(self, scene, friction, stepSize):
        slow, fast = _force_groups(scene.system)
        integrator = openmm.CustomIntegrator(stepSize)
        integrator.addGlobalVariable('a', math.exp(-friction*stepSize))
        integrator.addGlobalVariable('b', math.sqrt(-math.expm1(-2*friction*stepSize)))
        integrator.addGlobalVariable('kT', GAS_CONSTANT*scene.temperature)
        integrator.addGlobalVariable('taken', 0)
        integrator.addPerDofVariable('x1', 0)
        integrator.addUpdateContextState()
        for group in fast:
            integrator.addComputePerDof('v', f'v + dt*f{group}/m')
        integrator.beginIfBlock('taken = 0')
        for group in slow:
            integrator.addComputePerDof('v', f'v + {self.every}*dt*f{group}/m')
        integrator.endBlock()
        integrator.addComputeGlobal('taken',
                                    f'select(step(taken - {self.every - 1.5}), 0, taken + 1)')
        integrator.addConstrainVelocities()
        integrator.addComputePerDof('x', 'x + 0.5*dt*v')
        integrator.addComputePerDof('v', 'a*v + b*sqrt(kT/m)*gaussian')
        integrator.addComputePerDof('x', 'x + 0.5*dt*v')
        integrator.addComputePerDof('x1', 'x')
        integrator.addConstrainPositions()
        integrator.addComputePerDof('v', 'v + (x - x1)/dt')
        return integrator


class MTSLangevin:
    """Makes OpenMM's MTSLangevinIntegrator: reciprocal space once a step, the rest several times.

    The scene must come from :func:`reciprocalSpaceApart`. The step size is the outer step size.
    Before OpenMM 8.0 the class of OpenMM damped in each of the inner steps with its friction times
    the *outer* step. The factors of an inner step are therefore set here. The friction is then as
    requested with every version.

    Parameters
    ----------
    friction : float, optional
        1/ps, replaces the scene's
    inner : int
        number of steps of the faster forces in each step
    """
    def __init__(self, friction: Optional[float] = None, inner: int = 2) -> None:
        self.friction = friction
        self.inner = inner

    def __call__(self, scene, stepSize, seed):
        friction = scene.friction if self.friction is None else self.friction
        slow, fast = _force_groups(scene.system)
        groups = [(group, 1) for group in slow] + [(group, self.inner) for group in fast]
        integrator = openmm.MTSLangevinIntegrator(scene.temperature, friction, stepSize, groups)
        damping = friction*stepSize/self.inner
        integrator.setGlobalVariableByName('a', math.exp(-damping))
        integrator.setGlobalVariableByName('b', math.sqrt(-math.expm1(-2*damping)))
        integrator.setRandomNumberSeed(seed)
        return integrator


# ---- Other Systems -------------------------------------------------------------------------------

GAS_CONSTANT = _units.GAS_CONSTANT
#: A particle that is not heavier than this, dalton, is a hydrogen.
HEAVIEST_HYDROGEN = 1.2


def heavyHydrogens(scene: Scene, mass: float) -> Scene:
    """The scene with heavier hydrogens (hydrogen mass repartitioning).

    The heaviest particle of the hydrogen's body gives the mass. The masses of bodies and the
    constraints stay. Canonical averages over configurations stay, too: bodies are rigid, so masses
    enter only kinetic energies. Velocities of the start are drawn anew. The method follows K. A.
    Feenstra, B. Hess, H. J. C. Berendsen, J. Comput. Chem. 20, 786 (1999).

    Parameters
    ----------
    scene : Scene
        a scene whose bodies have hydrogens, particles with a mass up to HEAVIEST_HYDROGEN
    mass : float
        mass of each hydrogen, dalton

    Returns
    -------
    Scene

    Raises
    ------
    ValueError
        if the bodies have no hydrogens, or if a hydrogen would be heavier than the particle that
        gives it its mass
    """
    system = openmm.XmlSerializer.deserialize(openmm.XmlSerializer.serialize(scene.system))
    masses = [system.getParticleMass(i)._value for i in range(system.getNumParticles())]
    found = 0
    for index, body in enumerate(scene.bodies):
        hydrogens = [i for i in body if 0 < masses[i] <= HEAVIEST_HYDROGEN]
        found += len(hydrogens)
        if not hydrogens:
            continue
        heaviest = max(body, key=lambda i: masses[i])
        left = masses[heaviest] - sum(mass - masses[i] for i in hydrogens)
        if heaviest in hydrogens or left < mass:
            raise ValueError(
                f'heavyHydrogens: mass: got {mass:g}; the hydrogens of body {index} would be '
                f'heavier than the {left:.4g} dalton that are left of '
                f'particle {heaviest}, which their mass is taken from: choose less')
        for i in hydrogens:
            system.setParticleMass(i, mass)
        system.setParticleMass(heaviest, left)
    if not found:
        raise ValueError(f'heavyHydrogens: scene {scene.name!r}: no body has a particle of up to '
                         f'{HEAVIEST_HYDROGEN} dalton; hydrogens are told by their mass: '
                         'leave this method out')
    return _velocities_anew(scene.withSystem(system))


def _velocities_anew(scene):
    """The scene whose velocities are drawn when a Context is made."""
    changed = copy.copy(scene)
    changed.velocities = None
    return changed


def reciprocalSpaceApart(scene: Scene) -> Scene:
    """The scene with the reciprocal space of its NonbondedForce in its own force group.

    This group is the first that has nothing else in it. The energy of the NonbondedForce's original
    group (energy_group_N) is then that of direct space.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    Scene
    """
    system = openmm.XmlSerializer.deserialize(openmm.XmlSerializer.serialize(scene.system))
    _, others = _force_groups(system)
    free = next(group for group in range(32) if group not in others)
    for force in _with_reciprocal_space(system):
        force.setReciprocalSpaceForceGroup(free)
    return scene.withSystem(system)


def _with_reciprocal_space(system):
    methods = (openmm.NonbondedForce.Ewald, openmm.NonbondedForce.PME, openmm.NonbondedForce.LJPME)
    return [
        force for force in system.getForces()
        if isinstance(force, openmm.NonbondedForce) and force.getNonbondedMethod() in methods
    ]


def _force_groups(system):
    """Force groups of reciprocal spaces, and all other groups with forces."""
    reciprocal = {force.getReciprocalSpaceForceGroup()
                  for force in _with_reciprocal_space(system)} - {-1}
    return sorted(reciprocal), sorted({force.getForceGroup() for force in system.getForces()})


# ---- Methods by name -----------------------------------------------------------------------------


def _not_held_by_constraints(scene):
    return scene.rigidByConstraints()


def _no_reciprocal_space(scene):
    if not _with_reciprocal_space(scene.system):
        return ('the System has no NonbondedForce with Ewald, PME or LJPME, so no reciprocal space '
                'that could be evaluated less often')
    return scene.rigidByConstraints()


def _not_split(scene):
    if any(scene.system.isVirtualSite(i) for i in range(scene.system.getNumParticles())):
        return ("OpenMM's MTSLangevinIntegrator places virtual sites only at the end of its outer "
                "steps: the forces of its inner steps would be those of "
                'sites left behind (LangevinMiddle-N2 places them in time)')
    return _no_reciprocal_space(scene)


#: The methods that are known by name.
BUILT_IN = {
    method.name: method
    for method in
    (Method('LangevinA', RigidScheme(CustomRigidHIIntegrator.LangevinA), 2, None,
            'Davidchack 2015, eq. 20'),
     Method('LangevinB', RigidScheme(CustomRigidHIIntegrator.LangevinB), 2, None,
            'Davidchack 2015, eq. 27'),
     Method('LangevinC', RigidScheme(CustomRigidHIIntegrator.LangevinC), 2, None,
            'Davidchack 2015, eq. 28'),
     Method('GradientThermostat', RigidScheme(CustomRigidHIIntegrator.GradientThermostat), 1, None,
            'Davidchack 2015, eq. 30'),
     Method(
         'LangevinMiddle', LangevinMiddle(), 2, _not_held_by_constraints,
         "OpenMM's LangevinMiddleIntegrator, bodies held by constraints (SETTLE for water), "
         "friction gamma"),
     Method(
         'MTSLangevin', MTSLangevin(), 2, _not_split,
         "OpenMM's MTSLangevinIntegrator: reciprocal space once a step, the other forces several "
         "times (2, or -N), friction gamma", reciprocalSpaceApart),
     )
}


@dataclass(frozen=True)
class Option:
    """An option behind a method's name: a dash, a letter, a number.

    Parameters
    ----------
    meaning : str
        for descriptions and messages; {} is the number
    isGood : callable
        number -> bool
    values : str
        the numbers that are good
    """

    meaning: str
    isGood: Callable
    values: str


def _is_positive(value):
    return 0 < value < math.inf


#: Options by letter; byName() says which methods have them.
OPTIONS = {
    'I': Option('moments times {}', _is_positive, 'above 0'),
    'g': Option('gamma = {}/ps', _is_positive, 'above 0'),
    'G': Option('Gamma = {}/ps', _is_positive, 'above 0'),
    'H': Option('hydrogens of {} dalton, their mass taken from the heaviest particle of the body',
                lambda mass: HEAVIEST_HYDROGEN < mass < math.inf,
                f'above {HEAVIEST_HYDROGEN}, the heaviest hydrogen'),
    'N': Option('reciprocal space in one of {} steps', lambda count: count in range(2, 101),
                'a whole number from 2 to 100'),
}
#: The form of a number in a name.
_NUMBER = r'[0-9]+(?:\.[0-9]+)?(?:e-?[0-9]+)?'


def byName(name: str) -> Method:
    """The method of this name: a built-in method, with options behind its name.

    ==========  ===================================  ==============================================
    option      for                                  meaning
    ==========  ===================================  ==============================================
    -I8         LangevinA, LangevinB, LangevinC      setInertiaScale(8)
    -g2         LangevinA, LangevinB, LangevinC,     gamma, the friction (of translation, for the
                LangevinMiddle, MTSLangevin          plugin's schemes), 1/ps
    -G4         LangevinA, LangevinB, LangevinC      Gamma, the rotational friction, 1/ps
    -H3         LangevinMiddle, MTSLangevin          hydrogens of 3 dalton (:func:`heavyHydrogens`)
    -N3         LangevinMiddle, MTSLangevin          reciprocal space in one of 3 steps: of
                                                     LangevinMiddle's own steps; of the inner steps
                                                     of MTSLangevin, whose step is the outer one
                                                     (without -N3, 2)
    ==========  ===================================  ==============================================

    Without an option a setting is the scene's setting. Options may be in any order, each once.

    Parameters
    ----------
    name : str
        e.g. LangevinC, LangevinC-I8-g2-G4, LangevinMiddle-H3-g1, MTSLangevin-N2

    Returns
    -------
    Method

    Raises
    ------
    ValueError
        for any other name, if the method has no such option, or if the number is invalid
    """
    name = str(name)
    base = BUILT_IN.get(re.split('-', name)[0])
    if base is None:
        raise _wrong_name(name, 'no method has this name')
    text = name[len(base.name):]
    found = re.findall(f'-([A-Za-z])({_NUMBER})', text)
    if ''.join(f'-{letter}{number}' for letter, number in found) != text:
        raise _wrong_name(name, f'{text!r} are no options, each a dash, a letter and a number')
    values = {}
    for letter, number in found:
        if letter not in _options_of(base):
            raise _wrong_name(
                name, f'{base.name} has no option -{letter}, only {_listed(_options_of(base))}')
        if letter in values:
            raise _wrong_name(name, f'-{letter} occurs twice')
        values[letter] = float(number)
        if not OPTIONS[letter].isGood(values[letter]):
            raise _wrong_name(name, f'the number behind -{letter} must be {OPTIONS[letter].values}')
    return _with_options(name, base, values) if values else base


def _wrong_name(name, why):
    return ValueError(
        f'method: got {name!r}: {why}; it must be a Method or the name of one of these: '
        f'{", ".join(BUILT_IN)}; options may follow, such as LangevinC-I8 (moments times 8) or '
        'LangevinMiddle-g1 (friction 1/ps)')


def _options_of(method):
    make = method.makeIntegrator
    if isinstance(make, RigidScheme):
        return 'IgG' if _schemes.TABLE[make.scheme].hasMomenta else ''
    return 'gHN'


def _listed(letters):
    return ', '.join(f'-{letter}' for letter in letters) or 'none'


def _with_options(name, base, values):
    make, prepare, whyNot = base.makeIntegrator, base.prepare, base.whyNot
    gamma = values.get('g')
    if isinstance(make, RigidScheme):
        made = RigidScheme(make.scheme, values.get('I'), gamma, values.get('G'))
        # The scene's velocities belong to its own moments. With moments 8 times as large they would
        # be 8 times too hot.
        prepare = _velocities_anew if 'I' in values else None
    elif isinstance(make, MTSLangevin):
        made = MTSLangevin(gamma, int(values.get('N', make.inner)))
    else:
        made = LangevinMiddle(gamma, int(values.get('N', 1)))
        if 'N' in values:
            prepare, whyNot = reciprocalSpaceApart, _no_reciprocal_space
    if 'H' in values:
        prepare = functools.partial(_heavy_then, mass=values['H'], then=prepare)
        whyNot = functools.partial(_not_heavy, mass=values['H'], first=whyNot)
    meanings = [OPTIONS[letter].meaning.format(f'{value:g}') for letter, value in values.items()]
    return Method(name, made, base.order, whyNot, '; '.join([base.description, *meanings]), prepare)


def _heavy_then(scene, mass, then):
    scene = heavyHydrogens(scene, mass)
    return scene if then is None else then(scene)


def _not_heavy(scene, mass, first):
    refusal = first(scene)
    if refusal is not None:
        return refusal
    try:
        heavyHydrogens(scene, mass)
    except ValueError as error:
        return str(error)
    return None
