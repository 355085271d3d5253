#!/usr/bin/env python3
"""What steps of rigid water and products with the mobility take on a GPU: one report, one JSON.

Water boxes (TIP4P-Ew, PME) are stepped by OpenMM's integrators and by ours, with bodies on the
device and on the host. All methods of a box take turns, each round in another order, after a common
equilibration by OpenMM's integrator and a warm-up of each. Times are by the clock, from the call of
step() until the device has finished, so calls of 1000 steps, of 10 and of 1 differ by what happens
at the end of a call. Products of random forces with the mobility, and steps whose noise needs
products, are timed for comparison. The JSON has the machine, versions, seeds and lengths, medians
and quartiles over the rounds, ratios within a round, and of each method the temperature and the
potential energy at the end, so that a wrong run shows. A method that fails is a row with the
reason. The JSON is written after each part, so that an interrupted run leaves what it has.

On a platform that computes on the processor (OpenCL with pocl) the report tests itself; its times
say nothing about a GPU.

    PYTHONPATH=build/python python3 tools/gpu-report.py --platform CUDA --quick --output report.json
    PYTHONPATH=build/python python3 tools/gpu-report.py --platform OpenCL --waters 64 \\
        --products 100 --budget 0.2 --output report.json
"""
import argparse
import json
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import openmm
from openmm import app, unit
from tqdm import tqdm

import openmmrigidhi
from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce

ROOT = pathlib.Path(__file__).resolve().parents[1]
sys.path += [str(ROOT/'benchmarks'), str(ROOT/'tools')]
import test_opencl  # noqa: E402
from common import describeMachine, spheresAtRandom, spread, waterBox  # noqa: E402

TEMPERATURE = 300.0  # K
#: Rates of OpenMM's LangevinMiddle and of ours, 1/ps, as in validation/accuracy/water.
FRICTION, ROTATIONAL_FRICTION = 5.0, 10.0
HYDROGEN = 3.0  # dalton, where hydrogens are made heavier
#: 23,328 and 97,556 particles: whole cubes, so that the lattice has no gap.
WATERS = (18**3, 29**3)
PRODUCTS = (1000, 3000, 10000, 30000, 100000)
#: Steps in one call of step().
CALLS = (1000, 10, 1)
TOLERANCE = 1e-3  # of iterations and multipoles
#: Our library keeps bodies on the host if this environment variable is 1 when a Context is made.
ON_HOST = 'RIGIDHI_BODIES_ON_HOST'
#: And where it makes products: device or host.
PRODUCTS_ON = 'RIGIDHI_PRODUCTS'
#: Temperatures beyond this factor of the bath's are a run that has failed.
TOO_FAR = 3
QUICK = {'rounds': 3, 'budget': 0.9, 'equilibration': 5.0, 'at_most': 220.0}
THOROUGH = {'rounds': 7, 'budget': 4.0, 'equilibration': 20.0, 'at_most': 3600.0}


class Method:
    """One integrator at one step size.

    Parameters
    ----------
    kind : str
        'Verlet', 'LangevinMiddle' or 'LangevinC', the last being ours
    step : float
        fs
    moments : float
        factor of the moments of inertia (ours only)
    bodies : str
        'device' or 'host': where bodies are asked to be (ours only)
    hydrogen : float
        mass of a hydrogen, dalton; 0: as it is
    """
    def __init__(self, kind, step, moments=1, bodies='', hydrogen=0):
        self.kind, self.step, self.moments = kind, step, moments
        self.bodies, self.hydrogen = bodies, hydrogen
        self.name = kind + (f', moments times {moments}' if moments != 1 else '') + (
            f', hydrogens of {hydrogen:g} dalton' if hydrogen else
            '') + f', {step:g} fs' + (f', bodies on the {bodies}' if bodies else '')

    def isOurs(self):
        return self.kind == 'LangevinC'

    def makeIntegrator(self, topology, seed):
        step = self.step*unit.femtosecond
        if self.kind == 'Verlet':
            return openmm.VerletIntegrator(step)
        if self.kind == 'LangevinMiddle':
            integrator = openmm.LangevinMiddleIntegrator(TEMPERATURE, FRICTION, step)
        else:
            integrator = CustomRigidHIIntegrator(TEMPERATURE, step)
            integrator.setFriction(FRICTION)
            integrator.setRotationalFriction(ROTATIONAL_FRICTION)
            integrator.setInertiaScale(self.moments)
            openmmrigidhi.app.addRigidWater(integrator, topology)
        integrator.setRandomNumberSeed(seed)
        return integrator


def methodsFor(places):
    """The methods that take turns in a box. Only ours can step by 15 fs."""
    methods = [
        Method('Verlet', 2),
        Method('LangevinMiddle', 2),
        Method('LangevinMiddle', 4),
        Method('LangevinMiddle', 8, hydrogen=HYDROGEN)
    ]
    for step, moments in ((4, 1), (12, 8), (15, 8)):
        methods += [Method('LangevinC', step, moments, place) for place in places]
    return methods


class Clock:
    """The time that the report has; parts that would begin after its end are left out, by name."""
    def __init__(self, seconds):
        self.end = time.monotonic() + seconds
        self.leftOut = []

    def hasTimeFor(self, what):
        if time.monotonic() < self.end:
            return True
        self.leftOut.append(what)
        return False


# ---- The machine and the tests -------------------------------------------------------------------


def devices():
    """What the NVIDIA driver says of its GPUs: one dict each; none without the driver's program."""
    fields = ('name', 'driver_version', 'memory.total', 'clocks.max.sm', 'clocks.max.memory',
              'power.limit', 'compute_cap')
    program = shutil.which('nvidia-smi')
    if program is None:
        return []
    finished = subprocess.run([program, '--query-gpu=' + ','.join(fields), '--format=csv,noheader'],
                              text=True, capture_output=True, check=False)
    return [
        dict(zip(fields, (each.strip() for each in line.split(','))))
        for line in finished.stdout.splitlines() if line.count(',') == len(fields) - 1
    ]


def describe(platform, precisions, commit=None):
    """Machine, GPUs, versions, commit, and the properties of a Context in each precision."""
    properties = {}
    for precision in precisions:
        system = openmm.System()
        system.addParticle(1)
        context = openmm.Context(system, openmm.VerletIntegrator(0.001), platform,
                                 propertiesFor(precision))
        properties[precision or 'the only one'] = {
            name: platform.getPropertyValue(context, name)
            for name in platform.getPropertyNames()
        }
    commit = commit or ''
    if not commit and shutil.which('git'):
        commit = subprocess.run(['git', 'describe', '--always', '--dirty'], text=True, cwd=ROOT,
                                capture_output=True, check=False).stdout.strip()
    return {
        **describeMachine(), 'numpy': np.__version__,
        'commit': commit or 'unknown',
        'gpus': devices(),
        'platform': platform.getName(),
        'properties_by_precision': properties,
        'plugins_that_failed_to_load': list(openmm.Platform.getPluginLoadFailures())
    }


def propertiesFor(precision):
    return {'Precision': precision} if precision else {}


def runTests(programs, precisions, jobs, minutes):
    """Rows of files of test programs: those of platforms with a device run in each precision."""
    tasks = []
    for program in programs:
        hasDevice = any(name in program.name for name in ('OpenCL', 'CUDA', 'HIP'))
        tasks += [(file, precision) for precision in (precisions if hasDevice else ('double',))
                  for file in test_opencl.files_of(program)]
    rows = []
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(jobs) as pool:
        logs = pathlib.Path(folder)
        futures = [
            pool.submit(test_opencl.runs, file, precision or 'double', logs/'kernels', logs,
                        60*minutes) for file, precision in tasks
        ]
        with tqdm(futures, desc='Test programs') as bar:
            for future in bar:
                run = future.result()
                rows.append({
                    'program': run.name,
                    'precision': run.precision,
                    'passed': run.passed,
                    'skipped': run.skipped,
                    'failed': run.failed,
                    'seconds': round(run.seconds, 2)
                })
                if run.failed:
                    log = (logs/f'{run.name}.{run.precision}.log').read_text(errors='replace')
                    rows[-1]['end_of_output'] = log[-3000:]
                    bar.write(f'{run.name} in {run.precision} precision: '
                              f'{", ".join(run.failed)} failed')
    return rows


# ---- Water ---------------------------------------------------------------------------------------


class Runner:
    """A method with its Context in a box, which has a warm-up behind it."""
    def __init__(self, method, box, platform, precision, state, seed, warmUp):
        self.method, self.waters = method, box.waters
        self.integrator = method.makeIntegrator(box.topology, seed)
        begin = time.perf_counter()
        os.environ[ON_HOST] = '1' if method.bodies == 'host' else '0'
        self.context = openmm.Context(box.system(method.hydrogen), self.integrator, platform,
                                      propertiesFor(precision))
        self.context.setPositions(state.getPositions(asNumpy=True))
        self.context.setVelocitiesToTemperature(TEMPERATURE, seed)
        self.integrator.step(1)
        self.secondsToCreate = time.perf_counter() - begin
        self.integrator.step(max(1, round(warmUp*1000/method.step)))
        self.check()

    def wait(self):
        """Wait until the device has done its work: reading the velocities does."""
        self.context.getState(getVelocities=True)

    def time(self, steps, calls):
        """Seconds a step. The time of reading velocities, which ends the wait, is taken off."""
        self.wait()
        begin = time.perf_counter()
        for _ in range(calls):
            self.integrator.step(steps)
        self.wait()
        end = time.perf_counter()
        self.wait()
        return (end - begin - (time.perf_counter() - end))/(steps*calls)

    def own(self):
        """Milliseconds since the Context was made, of ours: scheme and forces."""
        statistics = self.integrator.getStepStatistics()
        return np.array([1e3*statistics['seconds_' + each] for each in ('scheme', 'forces')])

    def check(self):
        """(temperature, potential energy of a molecule), K and kJ/mol; RuntimeError if they are
        those of a failed run."""
        state = self.context.getState(getEnergy=True)
        energy = state.getPotentialEnergy()._value/self.waters
        if self.method.isOurs():
            temperature = self.integrator.computeMidStepTemperature()._value
        else:
            freedom = 6*self.waters - 3
            temperature = 2*state.getKineticEnergy()/freedom/unit.MOLAR_GAS_CONSTANT_R/unit.kelvin
        if not (np.isfinite(energy) and temperature < TOO_FAR*TEMPERATURE):
            raise RuntimeError(f'the run has exploded: the temperature is {temperature:g} K, the '
                               f'potential energy of a molecule {energy:g} kJ/mol')
        return temperature, energy


class Box:
    """A box of water: the topology and the Systems."""
    def __init__(self, waters, cutoff):
        self.waters = waters
        self.topology, self.positions = waterBox(waters)
        edge = self.topology.getPeriodicBoxVectors()[0][0]._value
        self.cutoff = min(cutoff, 0.45*edge)
        self.plain = app.ForceField('tip4pew.xml').createSystem(self.topology,
                                                                nonbondedMethod=app.PME,
                                                                nonbondedCutoff=self.cutoff)

    def system(self, hydrogen=0):
        """The System, with hydrogens of that mass, dalton, if it is not 0."""
        if not hydrogen:
            return self.plain
        system = openmm.XmlSerializer.clone(self.plain)
        masses = [system.getParticleMass(i)._value for i in range(system.getNumParticles())]
        for residue in self.topology.residues():
            oxygen, *hydrogens = [
                atom.index for atom in residue.atoms() if atom.element is not None
            ]
            for i in hydrogens:
                system.setParticleMass(i, hydrogen)
            system.setParticleMass(oxygen,
                                   masses[oxygen] - sum(hydrogen - masses[i] for i in hydrogens))
        return system


def equilibrate(box, platform, precision, seed, picoseconds):
    """A State after a run of LangevinMiddle, which uses nothing of ours.

    The first tenth of the time has short steps and a high friction, since molecules of the lattice
    are turned at random. They have no overlaps, so no minimisation is needed.
    """
    integrator = openmm.LangevinMiddleIntegrator(TEMPERATURE, 10*FRICTION, 0.5*unit.femtosecond)
    integrator.setConstraintTolerance(1e-6)
    integrator.setRandomNumberSeed(seed)
    context = openmm.Context(box.system(), integrator, platform, propertiesFor(precision))
    context.setPositions(box.positions)
    context.setVelocitiesToTemperature(TEMPERATURE, seed)
    parts = 20
    for part in tqdm(range(parts), desc=f'Equilibration of {box.waters} waters', leave=False):
        if part == 2:
            integrator.setFriction(FRICTION)
            integrator.setStepSize(2*unit.femtosecond)
        step = 0.5 if part < 2 else 2
        integrator.step(max(1, round(picoseconds*1000/step/parts)))
        context.getState(getVelocities=True)
    return context.getState(getPositions=True)


def nanosecondsPerDay(step, milliseconds):
    """From a step in fs and its time."""
    return round(step*86.4/milliseconds, 2)


def ratios(times, reference):
    """Ratios of the times of a round to those of another method; the spread over the rounds."""
    return spread([a/b for a, b in zip(times, reference)])


def measureWater(box, platform, precision, places, arguments, clock):
    """Rows of all methods in one box."""
    what = f'{box.waters} waters' + (f', {precision}' if precision else '')
    if not clock.hasTimeFor(what):
        return []
    methods = methodsFor(places)
    begin = time.monotonic()
    state = equilibrate(box, platform, precision, arguments.seed, arguments.equilibration)
    seconds = time.monotonic() - begin
    rows = {
        method.name: {
            'waters': box.waters,
            'particles': box.plain.getNumParticles(),
            'cutoff_nm': round(box.cutoff, 4),
            'precision': precision,
            'method': method.kind,
            'step_fs': method.step,
            'moments_times': method.moments,
            'mass_of_hydrogens': method.hydrogen or 'as it is',
            'bodies_asked_for': method.bodies,
            'seconds_of_equilibration': round(seconds, 2)
        }
        for method in methods
    }
    runners = {}

    def failed(name, error):
        runners.pop(name, None)
        rows[name]['failed'] = str(error).strip()
        bar.write(f'{what}: {name} failed: {rows[name]["failed"]}')

    with tqdm(total=len(methods)*(1 + arguments.rounds*len(CALLS)), desc=what) as bar:
        for method in methods:
            bar.update()
            if not clock.hasTimeFor(f'{what}: {method.name}'):
                continue
            try:
                runner = Runner(method, box, platform, precision, state, arguments.seed,
                                arguments.equilibration/10)
            except (openmm.OpenMMException, RuntimeError) as error:
                failed(method.name, error)
                continue
            runners[method.name] = runner
            rows[method.name]['seconds_to_create'] = round(runner.secondsToCreate, 2)
            if method.isOurs():
                effects = runner.integrator.getEffects()
                rows[method.name]['loops'] = effects['loops']
                rows[method.name]['bodies on the device'] = effects.get('bodies on the device')
        times, plans = {}, {}
        for number in range(arguments.rounds):
            names = list(runners)
            shift = number*len(names) // arguments.rounds
            for call in CALLS:
                for name in names[shift:] + names[:shift]:
                    bar.update()
                    if name not in runners or not clock.hasTimeFor(f'{what}: {name}, call of '
                                                                   f'{call}, round {number + 1}'):
                        continue
                    try:
                        if (name, call) not in plans:
                            plans[name, call] = plan(runners[name], call,
                                                     arguments.budget/arguments.rounds)
                        before = runners[name].own() if runners[name].method.isOurs() else None
                        taken = 1e3*runners[name].time(*plans[name, call])
                    except (openmm.OpenMMException, RuntimeError) as error:
                        failed(name, error)
                        continue
                    times.setdefault((name, call), {})[number] = taken
                    if before is not None and call == CALLS[0]:
                        own = (runners[name].own() - before)/np.prod(plans[name, call])
                        times.setdefault((name, 'scheme'), {})[number] = own[0]
                        times.setdefault((name, 'forces'), {})[number] = own[1]
    for name, runner in list(runners.items()):
        try:
            temperature, energy = runner.check()
            rows[name].update(temperature_K=round(temperature, 1),
                              energy_of_a_molecule=round(energy, 3))
        except (openmm.OpenMMException, RuntimeError) as error:
            rows[name]['failed'] = str(error).strip()
    summarise(rows, methods, times, plans)
    return list(rows.values())


def plan(runner, call, seconds):
    """(steps in a call, calls) that take about these seconds.

    Where a call would take more than five times as long, it has fewer steps.
    """
    # One call may be shorter than the wait that is taken off.
    trial, steps, calls = 0, min(call, 10), 1
    while trial*steps*calls < 0.1*seconds:
        trial = runner.time(steps, calls)
        if steps < call:
            steps = min(call, 4*steps)
        else:
            calls *= 4
    steps = min(call, max(1, round(5*seconds/trial)))
    return steps, max(1, round(seconds/(trial*steps)))


def summarise(rows, methods, times, plans):
    """Put the times of the methods, and their ratios, into their rows."""
    def common(one, other):
        """Times of both in the rounds that both have."""
        a, b = times.get(one, {}), times.get(other, {})
        rounds = sorted(set(a) & set(b))
        return [a[k] for k in rounds], [b[k] for k in rounds]

    references = {method.step: method.name for method in methods if method.kind == 'LangevinMiddle'}
    for method in methods:
        row = rows[method.name]
        row['steps_by'] = {}
        for call in CALLS:
            taken = times.get((method.name, call))
            if not taken:
                continue
            values = spread(list(taken.values()))
            steps, calls = plans[method.name, call]
            entry = row['steps_by'][f'calls of {call}'] = {
                'steps_in_a_call': steps,
                'calls_in_a_round': calls,
                'rounds': len(taken),
                'milliseconds': values,
                'ns_per_day': nanosecondsPerDay(method.step, values['median'])
            }
            others = {'LangevinMiddle at the same step': references.get(method.step)}
            if method.bodies == 'device':
                others['bodies on the host'] = method.name.replace('on the device', 'on the host')
            for other, name in others.items():
                if name not in (None, method.name) and common((method.name, call), (name, call))[0]:
                    entry[f'time_over_that_of_{other.replace(" ", "_")}'] = ratios(
                        *common((method.name, call), (name, call)))
            ours, middle = common((method.name, call), (references[4], call))
            if ours and method.name != references[4]:
                entry['ns_per_day_over_LangevinMiddle_at_4_fs'] = spread(
                    [method.step/a/(4/b) for a, b in zip(ours, middle)])
        for part in ('scheme', 'forces'):
            if times.get((method.name, part)):
                row[f'milliseconds_{part}_by_our_timer'] = spread(
                    list(times[method.name, part].values()))


# ---- Products ------------------------------------------------------------------------------------

#: name: (blobs of a body, multipoles allowed)
SCENES = {
    'spheres, all pairs': (1, False),
    'spheres, multipoles': (1, True),
    'blobs, all pairs': (10, False)
}


def productScene(kind, boundary, count, platform, precision, seed):
    """(integrator, Context, fluid, number of bodies) of spheres or rods of blobs of radius 1."""
    blobs, multipoles = SCENES[kind]
    fluid, system = MobilityForce(), openmm.System()
    integrator = CustomRigidHIIntegrator(TEMPERATURE, 1e-3)
    # Rods, and spheres at a wall, drift at random, which EulerMaruyama leaves out.
    drifts = boundary == 'NoSlipWall' or blobs > 1
    integrator.setScheme('RandomFiniteDifference' if drifts else 'EulerMaruyama')
    integrator.setRandomNumberSeed(seed)
    bodies = max(1, count // blobs)
    sites = np.zeros((blobs, 3))
    sites[:, 0] = 2*(np.arange(blobs) - (blobs - 1)/2)
    centres = spheresAtRandom(bodies)
    centres[:, 0] *= blobs  # room for rods, which lie along x
    centres[:, 2] += 2  # above the wall
    for _ in range(bodies):
        openmmrigidhi.app.addRigidMultiblob(system, integrator, fluid, sites, 1.0)
    fluid.setModel(MobilityForce.RotnePragerYamakawa)
    fluid.setBoundary(getattr(MobilityForce, boundary))
    fluid.setSolver(MobilityForce.MatrixFree)
    fluid.setSolverTolerance(TOLERANCE)
    fluid.setFastSummation(multipoles)
    system.addForce(fluid)
    context = openmm.Context(system, integrator, platform, propertiesFor(precision))
    context.setPositions((centres[:, None] + sites).reshape(-1, 3))
    return integrator, context, fluid, bodies


def repeated(task, seconds):
    """Milliseconds of a task: spread over the repetitions that the time allows, 1 to 20."""
    times, end = [], time.perf_counter() + seconds
    while not times or (time.perf_counter() < end and len(times) < 20):
        begin = time.perf_counter()
        task()
        times.append(1e3*(time.perf_counter() - begin))
    return {'repetitions': len(times), 'milliseconds': spread(times)}


def stepsWithNoise(integrator, seconds):
    """Times of steps, and what they need: the square root of the noise takes iterations, whose
    products need few digits. The first step is left out if there is time for a second."""
    first = repeated(lambda: integrator.step(1), 0)
    before = {}
    if first['milliseconds']['median'] < 1e3*seconds:
        before = integrator.getStepStatistics()
        first = repeated(lambda: integrator.step(1), seconds)
    after = integrator.getStepStatistics()
    steps = after['steps'] - before.get('steps', 0)
    return {
        'scheme': CustomRigidHIIntegrator.Scheme(integrator.getScheme()).name,
        **first, 'products_a_step': round(
            (after['mobilityProducts'] - before.get('mobilityProducts', 0))/steps, 2),
        'milliseconds_mobility': round(
            1e3*(after['seconds_mobility'] - before.get('seconds_mobility', 0))/steps, 4)
    }


def productPlaces(platform, boundary, kind):
    """Where products of a scene are made: multipoles are the host's, all pairs are both's."""
    ownSteps = platform.getName() not in ('Reference', 'CPU')
    return ('host', 'device') if ownSteps and kind.endswith('all pairs') else ('host',)


def measureProducts(counts, platform, precision, arguments, clock):
    """Rows of products and of steps that need them, one for each scene and each place."""
    rows = []
    scenes = [(count, boundary, kind, place) for count in counts
              for boundary in ('Unbounded', 'NoSlipWall') for kind in SCENES
              for place in productPlaces(platform, boundary, kind)]
    for count, boundary, kind, place in tqdm(scenes, desc='Products'):
        if not clock.hasTimeFor(f'products: {count} particles, {boundary}, {kind}, {place}'):
            continue
        row = {
            'particles': count,
            'boundary': boundary,
            'kind': kind,
            'place': place,
            'precision': precision
        }
        rows.append(row)
        random = np.random.default_rng(arguments.seed)  # the same forces in both places
        os.environ[PRODUCTS_ON] = place
        try:
            begin = time.perf_counter()
            integrator, context, fluid, bodies = productScene(kind, boundary, count, platform,
                                                              precision, arguments.seed)
            row['particles'] = context.getSystem().getNumParticles()
            # Of rods, an iteration whose products need few digits. applyBlobMobilityInContext()
            # would be exact, and so the host's.
            wrenches = random.normal(size=(bodies, 6))
            if kind.startswith('blobs'):
                wrenches[:, 3] = 0  # nothing resists a rod's rotation about its line

            def product():
                return fluid.applyMobilityInContext(context, wrenches)

            product()
            row['seconds_to_create'] = round(time.perf_counter() - begin, 3)
            row['product'] = repeated(product, arguments.budget)
            # A step has up to 40 products, of half the digits.
            if 20e-3*row['product']['milliseconds']['median'] > 10*arguments.budget:
                clock.leftOut.append(f'steps: {count} particles, {boundary}, {kind}')
            else:
                row['step_with_noise'] = stepsWithNoise(integrator, arguments.budget)
            effects = integrator.getEffects()
            row['effects'] = {
                name: effects[name]
                for name in ('loops', 'hydrodynamics', 'products on the device') if name in effects
            }
        except (openmm.OpenMMException, RuntimeError) as error:
            row['failed'] = str(error).strip()
            tqdm.write(f'products of {count} particles, {boundary}, {kind}: {row["failed"]}')
        finally:
            del os.environ[PRODUCTS_ON]
    return rows


# ---- The report ----------------------------------------------------------------------------------


def table(report):
    """The report as lines of text."""
    lines = []
    for row in report.get('tests', ()):
        if row['failed']:
            lines.append(f'{row["program"]} ({row["precision"]}): failed: '
                         f'{", ".join(row["failed"])}')
    if report.get('tests'):
        lines.append(f'{sum(row["passed"] for row in report["tests"])} tests passed, '
                     f'{sum(len(row["failed"]) for row in report["tests"])} failed')
    place = None
    for row in report.get('water', ()):
        if place != (row['particles'], row['precision']):
            place = row['particles'], row['precision']
            lines += [
                '', f'{row["particles"]} particles, {row["precision"] or ""}: ns/day by calls of '
                f'{", ".join(map(str, CALLS))} steps; ms/step (calls of {CALLS[0]}), over '
                'LangevinMiddle at the same step; T in K, U of a molecule in kJ/mol'
            ]
        name = f'{row["method"]} {row["step_fs"]:g} fs' + (
            f' I x {row["moments_times"]:g}' if row['moments_times'] != 1 else
            '') + (' H 3' if row['method'] == 'LangevinMiddle' and row['step_fs'] > 4 else
                   '') + f' {row["bodies_asked_for"]}'
        if row.get('failed'):
            lines.append(f'  {name:36} failed: {row["failed"][:120]}')
            continue
        speeds = [row['steps_by'].get(f'calls of {call}') for call in CALLS]
        if not all(speeds):
            lines.append(f'  {name:36} not measured')
            continue
        ratio = speeds[0].get('time_over_that_of_LangevinMiddle_at_the_same_step')
        lines.append(f'  {name:36}' + ''.join(f'{each["ns_per_day"]:>10.1f}' for each in speeds) +
                     f'{speeds[0]["milliseconds"]["median"]:>10.4f}' +
                     (f'{ratio["median"]:>7.2f}' if ratio else 7*' ') +
                     f'{row["temperature_K"]:>8.1f}{row["energy_of_a_molecule"]:>9.2f}')
    if report.get('products'):
        lines += ['', 'Products: ms of a product, ms of a step with noise']
    for row in report.get('products', ()):
        name = f'  {row["particles"]:>7} {row["boundary"]:11} {row["kind"]:20} {row["place"]:7}'
        if row.get('failed'):
            lines.append(f'{name} failed: {row["failed"][:120]}')
            continue
        step = row.get('step_with_noise')
        lines.append(f'{name} {row["product"]["milliseconds"]["median"]:>10.3f}' + (
            f'{step["milliseconds"]["median"]:>12.3f} ({step["products_a_step"]:.0f} products)'
            if step else ''))
    if report.get('left_out'):
        lines += [
            '', f'Left out for lack of time: {len(report["left_out"])} measurements, from '
            f'"{report["left_out"][0]}" on'
        ]
    return '\n'.join(lines)


def choosePlatform(name):
    """The platform of this name, or else the fastest that is there."""
    if name is None:
        name = max(
            (openmm.Platform.getPlatform(i) for i in range(openmm.Platform.getNumPlatforms())),
            key=lambda platform: platform.getSpeed()).getName()
    openmmrigidhi.checkPlatform(name)
    return openmm.Platform.getPlatformByName(name)


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--platform', help='CUDA, HIP, OpenCL …; without it, the fastest there is')
    parser.add_argument('--precision', nargs='+', choices=('single', 'mixed', 'double'),
                        default=['mixed'], help='of platforms that have the property')
    parser.add_argument('--waters', nargs='*', type=int, default=WATERS,
                        help='molecules of each box; none: no boxes')
    parser.add_argument('--cutoff', type=float, default=0.9, help='nm')
    parser.add_argument('--bodies', nargs='+', choices=('device', 'host'),
                        help='where ours has bodies; without it both, if the platform has devices')
    parser.add_argument('--products', nargs='*', type=int,
                        help='particles of each scene of products; none: no products')
    parser.add_argument('--tests', nargs='*', type=pathlib.Path, default=[],
                        help='programs with tests to run first')
    parser.add_argument('--jobs', type=int, default=4, help='test programs at once')
    parser.add_argument('--quick', action='store_true', help='at most four minutes on an H100')
    parser.add_argument('--budget', type=float,
                        help='seconds of each measurement, all rounds together')
    parser.add_argument('--rounds', type=int)
    parser.add_argument('--equilibration', type=float, help='ps of each box')
    parser.add_argument('--at-most', type=float,
                        help='seconds after which no further measurement begins')
    parser.add_argument('--seed', type=int, default=2026)
    parser.add_argument('--commit', help='of the library, where it was not built from this folder')
    parser.add_argument('--output', type=pathlib.Path, required=True, help='the JSON')
    arguments = parser.parse_args()
    for program in arguments.tests:
        if not program.is_file():
            parser.error(f'--tests: there is no program {program}: build it, or correct the path')
    for name, value in (QUICK if arguments.quick else THOROUGH).items():
        if getattr(arguments, name) is None:
            setattr(arguments, name, value)
    if arguments.products is None:
        arguments.products = PRODUCTS[::2] if arguments.quick else PRODUCTS

    platform = choosePlatform(arguments.platform)
    hasPrecision = 'Precision' in platform.getPropertyNames()
    precisions = arguments.precision if hasPrecision else ['']
    places = arguments.bodies or (['device', 'host'] if hasPrecision else ['host'])
    report = {
        'machine': describe(platform, precisions, arguments.commit),
        'settings': {
            name: [each.name for each in value]
            if name == 'tests' else value.name if isinstance(value, pathlib.Path) else value
            for name, value in vars(arguments).items()
        },
        'temperature_K': TEMPERATURE,
        'friction_per_ps': FRICTION,
        'rotational_friction_per_ps': ROTATIONAL_FRICTION
    }

    def write():
        report['left_out'] = clock.leftOut
        report['seconds'] = round(time.monotonic() - begin, 1)
        report['machine']['load_average_after'] = round(os.getloadavg()[0], 2)
        arguments.output.parent.mkdir(parents=True, exist_ok=True)
        arguments.output.write_text(json.dumps(report, indent=1) + '\n')

    begin = time.monotonic()
    clock = Clock(arguments.at_most)
    if arguments.tests:
        report['tests'] = runTests(arguments.tests, precisions, arguments.jobs, 5)
        write()
    report['water'] = []
    for waters in arguments.waters:
        box = Box(waters, arguments.cutoff)
        for precision in precisions:
            report['water'] += measureWater(box, platform, precision, places, arguments, clock)
            write()
    report['products'] = measureProducts(arguments.products, platform, precisions[0], arguments,
                                         clock)
    write()
    print(table(report))
    bad = [
        row for part in ('tests', 'water', 'products') for row in report.get(part, ())
        if row.get('failed')
    ]
    return int(bool(bad))


if __name__ == '__main__':
    sys.exit(main())
