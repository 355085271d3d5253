"""describeEffects() names what is on first, what is off in one line, and warnings last."""
import os
import pathlib
import subprocess
import sys

import numpy as np
import openmm
import openmmrigidhi
import pytest


def scene(scheme, boundary, step=0.001):
    system, fluid = openmm.System(), openmmrigidhi.MobilityForce()
    integrator = openmmrigidhi.CustomRigidHIIntegrator(300, step)
    integrator.setScheme(scheme)
    for _ in range(2):
        openmmrigidhi.app.addRigidMultiblob(system, integrator, fluid, [(0, 0, 0)], 1.0)
    fluid.setBoundary(boundary)
    system.addForce(fluid)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setPositions([(0, 0, 2), (4, 0, 2)])
    return integrator, context


def parts(text):
    """The lines of effects that are on, the names of those that are off, and the warnings."""
    lines = text.splitlines()
    off = next(k for k, line in enumerate(lines) if line.startswith('off '))
    assert lines[0] == 'on:' and all(line.startswith('  ') for line in lines[1:off])
    names = lines[off].partition('): ')[2].split(', ')
    on, lines = [line[2:] for line in lines[1:off]], lines[off + 1:]
    if lines[0] == 'advice:':
        lines = lines[2:]
    assert lines[0] in ('warnings:', 'warnings: none')
    return on, names, [line[2:] for line in lines[1:]]


@pytest.mark.parametrize('scheme, boundary', [('TrapezoidalSlip', 'NoSlipWall'),
                                              ('FixmanMidpoint', 'Unbounded')])
def test_every_effect_is_on_or_off_and_none_is_lost(scheme, boundary):
    integrator, _context = scene(scheme, boundary)
    on, off, warnings = parts(integrator.describeEffects())
    effects = integrator.getEffects()
    assert warnings == [] and effects.pop('warnings') == 'off: none'
    effects.pop('advice', None)  # of a machine with an old OpenBLAS
    assert sorted(off) == sorted(name for name, why in effects.items() if why.startswith('off'))
    assert sorted(on) == sorted(f'{name}{why[2:]}' for name, why in effects.items()
                                if why.startswith('on'))
    assert on[0] == f'scheme: {scheme}' and len(on) < 20


def test_warnings_are_sentences_with_a_remedy(capfd):
    integrator, _context = scene('EulerMaruyama', 'NoSlipWall', step=10000)
    warnings = parts(integrator.describeEffects())[2]
    assert len(warnings) == 3
    for warning in warnings:
        assert warning[0].isupper() and warning.endswith('.')
        assert '; use ' in warning or '; take a step of ' in warning
    # getEffects() has the same texts in one.
    joined = integrator.getEffects()['warnings']
    assert all(warning[1:-1] in joined for warning in warnings)
    _context.setPositions(_context.getState(getPositions=True).getPositions())
    assert capfd.readouterr().err == ''  # until a step
    integrator.step(1)
    assert capfd.readouterr().err.count('Warning: ') == 3


SAYS_KERNELS = '''
import openmm, openmmrigidhi
system, fluid = openmm.System(), openmmrigidhi.MobilityForce()
integrator = openmmrigidhi.CustomRigidHIIntegrator(300, 0.001)
integrator.setScheme('EulerMaruyama')
openmmrigidhi.app.addRigidMultiblob(system, integrator, fluid, [(0, 0, 0)], 1.0)
system.addForce(fluid)
context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
context.setPositions([(0, 0, 0)])
print(integrator.getEffects().get('advice'))
'''


def avx2():
    cpu = pathlib.Path('/proc/cpuinfo')
    return cpu.exists() and ' avx2' in cpu.read_text(encoding='utf-8')


@pytest.mark.skipif(not avx2(), reason='without AVX2 there are no better kernels')
@pytest.mark.parametrize('kernels, isOld', [('Prescott', True), ('Haswell', False)])
def test_old_kernels_of_openblas_are_named_with_the_remedy(kernels, isOld):
    finished = subprocess.run([sys.executable, '-c', SAYS_KERNELS], env={
        **os.environ, 'OPENBLAS_CORETYPE': kernels
    }, capture_output=True, text=True, check=True)
    assert ('set the environment variable OPENBLAS_CORETYPE' in finished.stdout) == isOld
    assert finished.stderr == ''


@pytest.mark.parametrize('platform, bodies, advised', [('Reference', 2, False), ('CPU', 2, True),
                                                       ('CPU', 60, False)])
def test_few_bodies_are_advised_to_take_reference(platform, bodies, advised):
    system = openmm.System()
    integrator = openmmrigidhi.CustomRigidHIIntegrator(300, 0.001)
    for _ in range(bodies):
        integrator.addRigidBody([system.addParticle(10)], 10, (1, 1, 1), [(0, 0, 0)])
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName(platform))
    context.setPositions(np.arange(3*bodies).reshape(-1, 3))
    text = integrator.describeEffects()
    advice = 'advice:\n  For so few particles platform CPU takes longer than Reference'
    assert (advice in text) == advised
    assert ('take Reference' in integrator.getEffects().get('advice', '')) == advised
    assert text.endswith('warnings: none\n')
