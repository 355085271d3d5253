#!/usr/bin/env python3
"""A shell of blobs is towed near a wall: the force that this takes, and how it fluctuates.

    python3 run.py                     # two minutes; draws picture.png and writes results.json
    python3 run.py --animation         # draws animation.gif, too
"""
import argparse
import sys
from pathlib import Path

import numpy as np
import openmm
import tqdm
from openmm import unit

from openmmrigidhi import CustomBodyMotion, CustomRigidHIIntegrator, MobilityForce, app

sys.path.insert(0, str(Path(__file__).resolve().parents[2]/'validation'/'common'))
import recording  # noqa: E402

#: Water at 300 K.
TEMPERATURE, VISCOSITY = 300*unit.kelvin, 0.89e-3*unit.pascal*unit.second
KT = (unit.MOLAR_GAS_CONSTANT_R*TEMPERATURE).value_in_unit(unit.kilojoule_per_mole)
#: Particles in a mole.
AVOGADRO = unit.AVOGADRO_CONSTANT_NA*unit.mole
#: Radius of a shell, nm, and its friction far from the wall, dalton/ps.
RADIUS = 1000.0
STOKES = 6*np.pi*AVOGADRO*1e-18*VISCOSITY.value_in_unit(unit.pascal*unit.second)*RADIUS
#: 1 μm/s in nm/ps; 1 kJ/(mol nm) in fN.
SPEED, FEMTONEWTON = 1e-9, 1e27/AVOGADRO
#: Height of the centre in the runs with noise, and distance of a second shell, radii.
HEIGHT, BESIDE = 1.5, 2.3
MILLISECOND = 1e9  # ps


def world(bodies, blobs, step=MILLISECOND, exact=False, groups=None, seed=1):
    """A Context with shells above the wall z = 0.

    Parameters
    ----------
    bodies : list of (place, state)
        centre of a shell in radii; and the velocity (vx, vy, vz), nm/ps, with which it is towed
        without turning, or 'held', or 'free'
    blobs : int
        of a shell, or 1 for a sphere
    step : float
        ps
    exact : bool
        whether spheres have the mobility of a rigid sphere at the wall
    groups : sequence of int, optional
        of bodies that feel each other; by default each body is alone
    seed : int

    Returns
    -------
    integrator : CustomRigidHIIntegrator
    fluid : MobilityForce
    context : openmm.Context
    """
    system, fluid = openmm.System(), MobilityForce()
    fluid.setBoundary(fluid.NoSlipWall)
    fluid.setViscosity(VISCOSITY)
    fluid.setSolver(fluid.Dense)
    if exact:
        fluid.setSphereWallMobility(fluid.BestKnown)
    integrator = CustomRigidHIIntegrator(TEMPERATURE, step)
    integrator.setScheme(integrator.TrapezoidalSlip)
    integrator.setRandomNumberSeed(seed)
    motion = CustomBodyMotion('x', 'y', 'z', '0', '0', '0')
    for name in 'xyz':
        motion.addPerBodyParameter(name)
    sites, radius = shape(blobs)
    for _, state in bodies:
        body = app.addRigidMultiblob(system, integrator, fluid, sites, radius)
        if state == 'held':
            integrator.setBodyHeld(body, True)
        elif state != 'free':
            motion.addBody(body, state)
    fluid.setGroups(range(len(bodies)) if groups is None else groups)
    system.addForce(fluid)
    system.addForce(motion)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('CPU'))
    context.setPositions(positions(bodies, blobs))
    return integrator, fluid, context


def shape(blobs):
    """Centres of blobs about that of the shell, and their radius, nm."""
    if blobs == 1:
        return np.zeros((1, 3)), RADIUS
    sites, radius = app.multiblobSphere(blobs, RADIUS)
    return sites/unit.nanometer, radius/unit.nanometer


def positions(bodies, blobs):
    """Positions of all blobs, nm."""
    return np.concatenate([shape(blobs)[0] + RADIUS*np.asarray(place) for place, _ in bodies])


# ---- Without noise -------------------------------------------------------------------------------


def drags(heights, blobs, exact=False):
    """Force over 6 pi eta a v for towing along the wall and towards it, (heights, 2).

    It is nan where blobs would reach through the wall.
    """
    sites, radius = shape(blobs)
    fits = np.asarray(heights)*RADIUS > np.abs(sites[:, 2]).max() + radius
    bodies = [((0, 0, height), velocity) for height in np.asarray(heights)[fits]
              for velocity in ((SPEED, 0, 0), (0, 0, SPEED))]
    integrator, _, context = world(bodies, blobs, exact=exact)
    result = np.full((len(heights), 2), np.nan)
    holds = integrator.computeHoldingWrenches().reshape(-1, 2, 6)
    result[fits] = holds[:, (0, 1), (0, 2)]/(STOKES*SPEED)
    return result


def faxen(heights):
    """The first column of drags() far from the wall: Faxén's series for a sphere."""
    u = 1/np.asarray(heights)
    return 1/(1 - 9/16*u + u**3/8 - 45/256*u**4 - u**5/16)


def brenner(heights):
    """The second column of drags() for a sphere: Brenner's sum of 1961."""
    alpha = np.arccosh(np.asarray(heights, float))[..., None]
    n = np.arange(1, 200)
    x, y = (2*n + 1)*alpha, 2*alpha
    # Numerator and denominator are divided by exp(x), so that they do not overflow.
    up = (1 - np.exp(-2*x)) + (2*n + 1)*np.sinh(y)*np.exp(-x)
    down = ((1 - np.exp(-x))**2 - (2*n + 1)**2*np.exp(-x)*np.sinh(alpha)**2)
    terms = n*(n + 1)/((2*n - 1)*(2*n + 3))*(up/down - 1)
    return 4/3*np.sinh(alpha[..., 0])*terms.sum(axis=-1)


# ---- With noise ----------------------------------------------------------------------------------


def pull(speeds, steps, blobs=42, seed=1, quiet=False):
    """Recorded wrenches (steps, speeds, 6) of shells that are towed along the wall, each alone.

    Returns them, and the friction (6, 6) of a shell.
    """
    bodies = [((0, 0, HEIGHT), (speed*SPEED, 0, 0)) for speed in speeds]
    integrator, fluid, context = world(bodies, blobs, seed=seed)
    friction = np.asarray(fluid.getFrictionInContext(context))[:6, :6]
    holds = []
    for _ in tqdm.trange(steps, desc='shells at several speeds', disable=quiet):
        integrator.step(1)
        holds.append(integrator.getHoldingWrenches())
    return np.array(holds), friction


def beside(state, windows, blobs=42, replicas=4, steps=5, step=0.1*MILLISECOND, seed=1,
           quiet=False):
    """Wrenches of shells at rest beside a second shell, averaged over a few steps.

    After each window the shells are put back, so that a second shell that is free stays where it
    is.

    Parameters
    ----------
    state : str
        'held' or 'free', of the second shell

    Returns
    -------
    averages : array of shape (windows*replicas, 6)
    friction : array of shape (6, 6)
        of a first shell, while the second is held or free
    """
    pair = [((0, 0, HEIGHT), (0, 0, 0)), ((BESIDE, 0, HEIGHT), state)]
    bodies = pair*replicas
    integrator, fluid, context = world(bodies, blobs, step, seed=seed,
                                       groups=np.repeat(np.arange(replicas), 2))
    friction = np.asarray(fluid.getFrictionInContext(context))[:12, :12]  # of all, held or not
    if state == 'free':
        friction = np.linalg.inv(np.linalg.inv(friction)[:6, :6])
    start, averages = positions(bodies, blobs), []
    for _ in tqdm.trange(windows, desc=f'beside a shell that is {state}', disable=quiet):
        context.setPositions(start)
        holds = []
        for _ in range(steps):
            integrator.step(1)
            holds.append(integrator.getHoldingWrenches()[::2])
        averages.append(np.mean(holds, axis=0))
    return np.concatenate(averages), friction[:6, :6]


def variance(values):
    """Variance about the mean of each column, and its standard error, for normal numbers."""
    values = values - values.mean(axis=0)
    free = len(values) - 1
    result = (values**2).sum(axis=0)/free
    return result, result*np.sqrt(2/free)


def windows(holds, length):
    """Averages of (steps, bodies, 6) over windows of so many steps: (windows, bodies, 6)."""
    whole = len(holds) // length*length
    return holds[:whole].reshape(-1, length, *holds.shape[1:]).mean(axis=1)


# ---- Numbers and pictures ------------------------------------------------------------------------


def measure(arguments):
    """All numbers, as a dictionary, and the recorded wrenches."""
    found = {'without_noise': {}}
    heights = np.array([1.1, 1.25, 1.5, 2, 3, 5, 8])
    found['without_noise'] = {
        'heights': heights,
        'shells': {n: drags(heights, n)
                   for n in (12, 42, 162)},
        'sphere': drags(heights, 1, exact=True),
        'faxen': faxen(heights),
        'brenner': brenner(heights)
    }
    speeds = np.arange(9)
    holds, friction = pull(speeds, arguments.steps, seed=arguments.seed)
    mean = FEMTONEWTON*holds[:, :, 0].mean(axis=0)
    error = FEMTONEWTON*np.sqrt(variance(holds[:, :, 0])[0]/len(holds))
    slope = (speeds*mean).sum()/(speeds**2).sum()
    time = 1e-12*MILLISECOND
    found['force_against_speed'] = {
        'speeds_um_per_s': speeds,
        'mean_force_fN': mean,
        'error_fN': error,
        'slope': slope,
        'slope_error': np.sqrt((speeds**2*error**2).sum())/(speeds**2).sum(),
        'friction': FEMTONEWTON*SPEED*friction[0, 0]
    }
    lengths = [n for n in (1, 3, 10, 30, 100) if 5*n <= len(holds)]
    rows = []
    for length in lengths:
        # About the mean of each body: one degree of freedom less for each.
        each = windows(holds, length)
        values, _ = variance(each)
        free = (len(each) - 1)*len(speeds)
        expected = 2*KT*np.diag(friction)/(MILLISECOND*length)
        ratio = values.mean(axis=0)/expected
        rows.append({
            'time_s': time*length,
            'std_fN': FEMTONEWTON*np.sqrt(values.mean(axis=0)[[0, 2]]),
            'expected_std_fN': FEMTONEWTON*np.sqrt(expected[[0, 2]]),
            'variance_over_expected': ratio[[0, 2, 4]],
            'error': ratio[[0, 2, 4]]*np.sqrt(2/free)
        })
    found['fluctuation'] = rows
    found['beside_a_second_shell'] = {}
    for state in ('held', 'free'):
        averages, friction = beside(state, arguments.windows, seed=arguments.seed)
        value, error = variance(averages)
        scale = 5*0.1*MILLISECOND/(2*KT)
        found['beside_a_second_shell'][state] = {
            'variance_as_friction': scale*value[0]/STOKES,
            'error': scale*error[0]/STOKES,
            'friction_over_stokes': friction[0, 0]/STOKES
        }
    return found, holds


def report(found):
    """The tables of the page."""
    still = found['without_noise']
    print('\n| height/radius | along: 12, 42, 162 blobs | rigid sphere | Faxén | towards: 12, 42, '
          '162 blobs | rigid sphere | Brenner |\n|---|---|---|---|---|---|---|')
    for k, height in enumerate(still['heights']):
        cells = []
        for axis, series in ((0, 'faxen'), (1, 'brenner')):
            cells.append(', '.join('—' if np.isnan(shell[k, axis]) else f'{shell[k, axis]:.3f}'
                                   for shell in still['shells'].values()))
            cells += [f'{still["sphere"][k, axis]:.4f}', f'{still[series][k]:.4f}']
        print(f'| {height:g} | {" | ".join(cells)} |')
    line = found['force_against_speed']
    print('\nforce/speed: {} fN s/μm, without noise {:.2f}'.format(
        recording.brackets(line['slope'], line['slope_error']), line['friction']))
    print('\n| time, s | spread along, fN | variance/expected: along | towards | torque |\n'
          '|---|---|---|---|---|')
    for row in found['fluctuation']:
        ratios = ' | '.join(
            recording.brackets(*each) for each in zip(row['variance_over_expected'], row['error']))
        print(f'| {row["time_s"]:g} | {row["std_fN"][0]:.1f} | {ratios} |')
    print('\n| second shell | variance T/(2 kT) | friction |\n|---|---|---|')
    for state, row in found['beside_a_second_shell'].items():
        print(f'| {state} | {recording.brackets(row["variance_as_friction"], row["error"])} | '
              f'{row["friction_over_stokes"]:.4f} |')


def picture(found, path):
    plt = recording.pyplot()
    figure, axes = plt.subplots(1, 3, figsize=(13, 4.2), layout='constrained')
    fine = np.geomspace(1.06, 8.5, 60)
    still = found['without_noise']
    exact = drags(fine, 1, exact=True)
    for axis, (name, color) in enumerate(
        (('along the wall', 'tab:blue'), ('towards the wall', 'tab:orange'))):
        axes[0].plot(fine, exact[:, axis], color=color, linewidth=1, label=f'{name}: rigid sphere')
        axes[0].plot(still['heights'], still['shells'][162][:, axis], 'o', color=color,
                     markersize=5, label='shell of 162 blobs')
    axes[0].plot(fine, faxen(fine), '--', color='0.4', linewidth=1, label='series of Faxén')
    axes[0].set(xlabel='height of the centre / radius', ylabel='force / (6π × viscosity × radius '
                '× speed)', xscale='log', yscale='log', ylim=(0.95, 20),
                title='the force without noise')
    axes[0].set_xticks([1, 1.5, 2, 3, 5, 8], ['1', '1.5', '2', '3', '5', '8'])
    axes[0].set_yticks([1, 2, 5, 10, 20], ['1', '2', '5', '10', '20'])
    axes[0].minorticks_off()
    line = found['force_against_speed']
    speeds = line['speeds_um_per_s']
    axes[1].plot(speeds, line['friction']*speeds, color='0.6', linewidth=2, label='without noise')
    axes[1].errorbar(speeds, line['mean_force_fN'], line['error_fN'], fmt='o', markersize=4,
                     color='tab:blue', label='mean of the recorded force')
    axes[1].set(xlabel='speed (μm/s)', ylabel='force along the wall (fN)',
                title=f'towed at {HEIGHT} radii')
    rows = found['fluctuation']
    time = np.array([row['time_s'] for row in rows])
    for axis, (name, color, marker) in enumerate(
        (('along the wall', 'tab:blue', 'o'), ('towards the wall', 'tab:orange', 's'))):
        axes[2].plot(time, [row['expected_std_fN'][axis] for row in rows], color=color, linewidth=1)
        axes[2].plot(time, [row['std_fN'][axis] for row in rows], marker, color=color, markersize=5,
                     label=name)
    axes[2].set(xlabel='averaged over the time T (s)', ylabel='spread of the mean force (fN)',
                xscale='log', yscale='log', title='points: recorded, lines: √(2kT friction/T)')
    axes[2].set_yticks([50, 100, 200, 500], ['50', '100', '200', '500'])
    for ax in axes:
        ax.legend(fontsize=9)
    figure.savefig(path, dpi=100)
    plt.close(figure)


def animation(holds, friction, path, speed=8, steps=1000, frames=60):
    """The shell that goes along the wall, and the mean of its recorded force until then.

    Parameters
    ----------
    holds : array
        as from pull()
    friction : float
        of the shell along the wall, dalton/ps
    path : str
        of the GIF
    speed : int
        of which shell of holds
    steps, frames : int
        how many steps are shown, in how many frames
    """
    from matplotlib.animation import FuncAnimation, PillowWriter
    plt = recording.pyplot()
    figure, axes = plt.subplots(1, 2, figsize=(7.6, 2.8), layout='constrained',
                                gridspec_kw={'width_ratios': [1.3, 1]})
    force = FEMTONEWTON*holds[:steps, speed, 0]
    time = 1e-12*MILLISECOND*np.arange(1, len(force) + 1)
    mean = np.cumsum(force)/np.arange(1, len(force) + 1)
    spread = FEMTONEWTON*np.sqrt(2*KT*friction/(1e12*time))
    steady = FEMTONEWTON*SPEED*speed*friction
    first = np.searchsorted(time, 0.02*time[-1])
    axes[0].axhspan(-0.3, 0, color='0.8')
    axes[0].set(xlim=(-1.5, speed*time[-1] + 1.5), ylim=(-0.3, 4), aspect='equal', xlabel='x (μm)',
                ylabel='z (μm)')
    axes[1].fill_between(time[first:], (steady - spread)[first:], (steady + spread)[first:],
                         color='0.85', label='√(2kT friction/T)')
    axes[1].axhline(steady, color='0.5', linewidth=1, label='without noise')
    graph, = axes[1].plot([], [], color='tab:blue', linewidth=1, label='mean until then')
    axes[1].set(xlim=(0, time[-1]), ylim=(steady - 1.2*spread[first], steady + 2.6*spread[first]),
                xlabel='time T (s)', ylabel='force (fN)')
    axes[1].legend(fontsize=8, loc='upper right')
    sites, radius = (each/1000 for each in shape(42))
    discs = [
        axes[0].add_patch(
            plt.Circle(site[[0, 2]], radius, facecolor='tab:blue', edgecolor='k', linewidth=0.5))
        for site in sites[np.argsort(-sites[:, 1])]
    ]
    centres = [disc.get_center() for disc in discs]

    def draw(frame):
        k = max(1, round((frame + 1)/frames*len(force)))
        for disc, centre in zip(discs, centres):
            disc.set_center(np.add(centre, (speed*time[k - 1], HEIGHT)))
        shown = slice(first, k, max(1, len(force) // 300))
        graph.set_data(time[shown], mean[shown])
        return graph, *discs

    FuncAnimation(figure, draw, frames).save(path, PillowWriter(fps=12), dpi=80)
    plt.close(figure)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--steps', type=int, default=20000,
                        help='of 1 ms of the shells that are towed (default 20000)')
    parser.add_argument('--windows', type=int, default=2000,
                        help='of 0.5 ms beside a second shell (default 2000)')
    parser.add_argument('--seed', type=int, default=1, help='of the noise (default 1)')
    parser.add_argument('--picture', default='picture.png',
                        help='file to draw (default picture.png)')
    parser.add_argument('--results', default='results.json', type=Path,
                        help='file for the numbers (default results.json)')
    parser.add_argument('--animation', nargs='?', const='animation.gif',
                        help='draw an animation, too (animation.gif)')
    parser.add_argument('--frames', type=int, default=60, help='of the animation (default 60)')
    arguments = parser.parse_args()
    found, holds = measure(arguments)
    report(found)
    recording.save(arguments.results.parent, arguments.results.name, {
        **found, 'run': recording.provenance(arguments)
    })
    picture(found, arguments.picture)
    if arguments.animation:
        animation(holds, found['force_against_speed']['friction']/(FEMTONEWTON*SPEED),
                  arguments.animation, frames=arguments.frames)


if __name__ == '__main__':
    main()
