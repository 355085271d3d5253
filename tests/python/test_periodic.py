"""Periodic fluids in Python: published matrices and arrays, independent sums, and changes of the
box."""
import json
from pathlib import Path

import numpy as np
import openmm
import pytest

import openmmrigidhi
from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce

REFERENCE = json.loads((Path(__file__).parent/'data'/'periodic_three_spheres.json').read_text())


def scene(positions, radii, box, model, lubrication=True, platform='Reference'):
    """Spheres in a box, viscosity 1."""
    system, fluid = openmm.System(), MobilityForce()
    system.setDefaultPeriodicBoxVectors(*np.array(box, float))
    integrator = CustomRigidHIIntegrator(0, 0.01)
    integrator.setScheme(CustomRigidHIIntegrator.EulerMaruyama)
    fluid.setViscosity(1)
    fluid.setModel(model)
    fluid.setBoundary(MobilityForce.Periodic)
    if not lubrication:
        fluid.setLubrication(False)
    for i, radius in enumerate(radii):
        system.addParticle(0)
        fluid.addParticle(radius)
        integrator.addRigidBody([i], 0, (0, 0, 0), [(0, 0, 0)])
    system.addForce(fluid)
    platform = platform if isinstance(
        platform, openmm.Platform) else openmm.Platform.getPlatformByName(platform)
    context = openmm.Context(system, integrator, platform)
    context.setPositions(positions)
    return context, fluid, integrator


@pytest.mark.parametrize('model, key', [(MobilityForce.RotnePragerYamakawa, 'rpy'),
                                        (MobilityForce.ForceCoupling, 'fcm'),
                                        (MobilityForce.StokesianDynamics, 'fts_mobility')])
def test_three_unequal_spheres(platform, model, key):
    case = REFERENCE['case']
    expected = np.array(case[key] if key in case else REFERENCE[key])
    context, fluid, _ = scene(case['positions'], case['radii'], np.diag(case['box']), model, False,
                              platform)
    M = fluid.getMobilityInContext(context)
    # The expected matrix is printed with 13 digits of its largest entry.
    assert np.abs(M - expected).max() < 1e-12*np.abs(expected).max()
    # Other images of the spheres give the same matrix.
    L = case['box'][0]
    context.setPositions(
        np.array(case['positions']) + L*np.array([(3, -2, 0), (0, 5, -1), (1, 1, 1)]))
    assert np.abs(fluid.getMobilityInContext(context) -
                  expected).max() < 1e-12*np.abs(expected).max()


def test_force_coupling_is_its_definition():
    """The matrix is the sum of its definition over all waves, by NumPy."""
    box, radii = np.array([(7, 0, 0), (3.4, 6.5, 0), (-3.1, 2.9, 7.2)]), np.array([1, 0.7, 0.8])
    x = np.array([(0.41, 6.9, 1.2), (2.15, 0.35, 8.9), (2.3, 0.9, 9.4)])
    volume, reciprocal = np.linalg.det(box), 2*np.pi*np.linalg.inv(box)  # columns
    n = np.stack(np.meshgrid(*[np.arange(-32, 33)]*3, indexing='ij'), -1).reshape(-1, 3)
    k = n @ reciprocal.T
    k = k[(n != 0).any(1) & ((k**2).sum(1) < 24**2)]
    k2 = (k**2).sum(1)
    green = (np.eye(3) - k[:, :, None]*k[:, None, :]/k2[:, None, None])/(k2*volume)[:, None, None]
    turn = np.cross(k[:, None, :], np.eye(3)).transpose(0, 2, 1)  # turn e = k x e
    blocks = []
    for a, place in zip(radii, x):
        phase = np.exp(-1j*(k @ place))[:, None, None]
        blocks += [
            phase*np.exp(-a**2/np.pi*k2/2)[:, None, None]*np.eye(3),
            phase*0.5j*np.exp(-(a/(6*np.sqrt(np.pi))**(1/3))**2*k2/2)[:, None, None]*turn
        ]
    D = np.concatenate(blocks, 2)
    expected = np.einsum('kai,kab,kbj->ij', D.conj(), green, D, optimize=True).real
    context, fluid, _ = scene(x, radii, box, MobilityForce.ForceCoupling)
    assert np.abs(fluid.getMobilityInContext(context) - expected).max() < 1e-12*expected.max()


def _free(a, b, r):
    """Rotne-Prager-Yamakawa of two spheres in unbounded fluid (Zuk et al., 2014), 8 pi eta times
    it: 6 x 6, r = r_a - r_b."""
    R, sum_, d = np.linalg.norm(r), a + b, abs(a - b)
    n = r/R if R > 0 else r
    I, nn, cross = np.eye(3), np.outer(n, n), np.array([(0, -n[2], n[1]), (n[2], 0, -n[0]),
                                                        (-n[1], n[0], 0)])
    s2 = a*a + b*b

    def turn(first, second):
        if R > sum_:
            return 1/R**2
        if R > d:
            return ((first - second + R)**2*(second**2 + 2*second*(first + R) - 3*(first - R)**2)/
                    (16*R**2*first**3*second))
        return R/first**3 if first > second else 0

    if R > sum_:
        tt, rr = ((1 + s2/(3*R**2))*I + (1 - s2/R**2)*nn)/R, (3*nn - I)/(2*R**3)
    elif R > d:
        tt = ((16*R**3*sum_ - (d**2 + 3*R**2)**2)*I + 3*(d**2 - R**2)**2*nn)/(32*R**3)*4/(3*a*b)
        A = (5*R**6 - 27*R**4*s2 + 32*R**3*(a**3 + b**3) - 9*R**2*(a**2 - b**2)**2 - d**4*
             (s2 + 4*a*b))/(64*R**3)
        rr = (A*I + 3*(d**2 - R**2)**2*(s2 + 4*a*b - R**2)/(64*R**3)*nn)/(a*b)**3
    else:
        tt, rr = I*4/(3*max(a, b)), I/max(a, b)**3
    return np.block([[tt, -turn(b, a)*cross], [-turn(a, b)*cross, rr]])


def _screened(a, b, r, xi, k, weights):
    """The part of the pair mobility that waves k with Hasimoto's H make, by Gauss-Legendre
    quadrature over k."""
    def j(n, x):
        return (np.sin(x)/x, np.sin(x)/x**2 - np.cos(x)/x,
                (3/x**3 - 1/x)*np.sin(x) - 3*np.cos(x)/x**2)[n]

    R = np.linalg.norm(r)
    if R < 1e-3:
        R, n = 0, 0*r
        j0, j1x, j2, j1 = 1 + 0*k, 1/3 + 0*k, 0*k, 0*k
    else:
        n, x = r/R, k*R
        j0, j1x, j2, j1 = j(0, x), j(1, x)/x, j(2, x), j(1, x)
    H = 4/np.pi*weights*(1 + k**2/(4*xi**2))*np.exp(-k**2/(4*xi**2))
    s, t = [j(0, k*c) for c in (a, b)], [3*j(1, k*c)/(k*c) for c in (a, b)]
    I, nn, cross = np.eye(3), np.outer(n, n), np.array([(0, -n[2], n[1]), (n[2], 0, -n[0]),
                                                        (-n[1], n[0], 0)])
    tensor = [np.sum(H*f*(j0 - j1x))*I + np.sum(H*f*j2)*nn for f in (s[0]*s[1], t[0]*t[1]*k**2/4)]
    turns = [-np.sum(H*f*k*j1)/2*cross for f in (s[0]*t[1], t[0]*s[1])]
    return np.block([[tensor[0], turns[0]], [turns[1], tensor[1]]])


def _slow_sum(x, radii, box, xi):
    """The Ewald sum of Rotne, Prager and Yamakawa, wave by wave and image by image."""
    volume, reciprocal = np.linalg.det(box), 2*np.pi*np.linalg.inv(box)
    n = np.stack(np.meshgrid(*[np.arange(-14, 15)]*3, indexing='ij'), -1).reshape(-1, 3)
    waves = (n @ reciprocal.T)[(n != 0).any(1)]
    waves = waves[(waves**2).sum(1) < (13*xi)**2]
    images = n @ box
    nodes, weights = np.polynomial.legendre.leggauss(160)
    nodes, weights = 6.5*xi*(nodes + 1), 6.5*xi*weights
    M = np.zeros((6*len(x), 6*len(x)))
    k2 = (waves**2).sum(1)
    k = np.sqrt(k2)
    H = 8*np.pi/(volume*k2)*(1 + k2/(4*xi**2))*np.exp(-k2/(4*xi**2))
    green = np.eye(3) - waves[:, :, None]*waves[:, None, :]/k2[:, None, None]
    turn = np.cross(waves[:, None, :], np.eye(3)).transpose(0, 2, 1)
    s = [np.sin(k*a)/(k*a) for a in radii]
    t = [3*(np.sin(k*a)/(k*a)**3 - np.cos(k*a)/(k*a)**2) for a in radii]
    D = np.concatenate([
        np.exp(-1j*(waves @ place))[:, None, None]*block for place, si, ti in zip(x, s, t)
        for block in (si[:, None, None]*np.eye(3), 0.5j*ti[:, None, None]*turn)
    ], 2)
    M += np.einsum('kai,k,kab,kbj->ij', D.conj(), H, green, D, optimize=True).real
    for i, a in enumerate(radii):
        for j, b in enumerate(radii):
            for r in x[i] - x[j] + images:
                if np.linalg.norm(r) < 6.5/xi + a + b:
                    M[6*i:6*i + 6,
                      6*j:6*j + 6] += _free(a, b, r) - _screened(a, b, r, xi, nodes, weights)
    return M/(8*np.pi)


def test_rotne_prager_yamakawa_is_a_slow_sum():
    """The matrix is that of a sum that is written down again, with another splitting, in a
    triclinic box. Spheres are apart, overlap, or are inside one another, with radii up to 1 : 10.
    """
    box, radii = np.array([(7, 0, 0), (3.4, 6.5, 0),
                           (-3.1, 2.9, 7.2)]), np.array([1, 0.7, 0.6, 0.1])
    x = np.array([(0.41, 6.9, 1.2), (2.15, 0.35, 8.9), (2.3, 0.9, 9.4), (0.6, 7.1, 1.5)])
    context, fluid, _ = scene(x, radii, box, MobilityForce.RotnePragerYamakawa)
    M, expected = fluid.getMobilityInContext(context), _slow_sum(x, radii, box, 0.8)
    scale = np.sqrt(np.diag(expected))
    assert np.abs((M - expected)/np.outer(scale, scale)).max() < 1e-11


def test_a_box_that_changes():
    context, fluid, integrator = scene([(0, 0, 0), (2.5, 0, 0)], [1, 1], 9*np.eye(3),
                                       MobilityForce.RotnePragerYamakawa)
    assert 'the periodic box (9, 0, 0), (0, 9, 0), (0, 0, 9) nm' in integrator.describeEffects()
    before = fluid.getMobilityInContext(context)
    context.setPeriodicBoxVectors((20, 0, 0), (0, 20, 0), (0, 0, 20))
    assert fluid.getMobilityInContext(context)[0, 0] > before[0, 0]
    context.setPeriodicBoxVectors((1.9, 0, 0), (0, 9, 0), (0, 0, 9))
    with pytest.raises(
            openmm.OpenMMException, match=
            'body 0 has the length 2 nm, hydrodynamic radii included, and would overlap its own'):
        integrator.step(1)


def test_bodies_are_bound_to_molecules():
    system, fluid = openmm.System(), MobilityForce()
    system.setDefaultPeriodicBoxVectors(*8*np.eye(3))
    integrator = CustomRigidHIIntegrator(300, 0.001)
    integrator.setScheme(CustomRigidHIIntegrator.DriftCorrectorRFD)
    shell = openmmrigidhi.app.sphereShell(12, 1)
    for _ in shell:
        system.addParticle(0)
        fluid.addParticle(0.5)
    integrator.addRigidBody(range(12), 0, (0, 0, 0), shell)
    fluid.setBoundary(MobilityForce.Periodic)
    fluid.setModel(MobilityForce.ForceCoupling)
    system.addForce(fluid)
    assert system.usesPeriodicBoundaryConditions()
    with pytest.raises(openmm.OpenMMException, match='bindBodies'):
        openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    integrator = openmmrigidhi.CustomRigidHIIntegrator.cast(openmm.XmlSerializer.clone(integrator))
    openmmrigidhi.app.bindBodies(system, integrator)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('CPU'))
    context.setPositions(shell)
    integrator.step(3)
    N = fluid.getMobilityInContext(context)
    assert np.linalg.eigvalsh(N)[0] > 0
    # The shell's images make an array of nearly spheres, which is slower than one sphere alone.
    assert N[0, 0] < 0.8/(6*np.pi*fluid.getViscosity()._value)
