#!/usr/bin/env python3
"""Steady shear of Brownian hard spheres: viscosity by parts, and normal stresses, over the Peclet
number.

The radius is 1, and the unit of time is that in which a sphere alone has D = 1; the Peclet number
is then the shear rate. Runs start from equilibrium of hard spheres. A short repulsion keeps spheres
apart, so that few steps are redone for overlaps: redoing many takes away spheres near contact, and
samples of the Brownian stress have no variance where gaps may be of any size.

    python3 steady_shear.py --output results --jobs 2     # an hour; goes on where it was stopped
"""
import pathlib
import sys
import time

import numpy as np
import openmm
from openmm import unit

sys.path.append(str(pathlib.Path(__file__).resolve().parents[1]/'common'))
import campaign  # noqa: E402
from hardspheres import contactValue, fits, hardSpheres, periodicFluid  # noqa: E402
from recording import brackets, provenance, pyplot, save  # noqa: E402

KT = 6*np.pi  # of D = 1 at the viscosity 1
TEMPERATURE = KT/unit.MOLAR_GAS_CONSTANT_R.value_in_unit(unit.kilojoule_per_mole/unit.kelvin)
REACH = (3, 4)
NUMBER = 32
FRACTIONS = (0.3, 0.45)
PECLET = (0.3, 1, 3, 10, 30)
PARTS = ('hydrodynamic', 'brownian', 'interparticle')
EVERY = 10  # steps between two samples
#: The energy of two spheres at a gap is REPULSION kT exp(-gap/RANGE).
REPULSION, RANGE, CUTOFF = 4.0, 0.02, 2.3
#: Steps are so long in time, or in strain, whichever is shorter.
STEP = {0.3: 1.5e-3, 0.45: 1e-3}
STRAIN = 3e-3
#: What is left out at the start, in time or in strain, whichever is longer ago.
SETTLE = 2.0
#: Gaps of pairs are counted up to these, in radii.
EDGES = (0.002, 0.005, 0.01, 0.02, 0.05, 0.1)
BLOCKS = 6
#: Volume fraction and Peclet numbers of --halved.
HALVED = 0.45, (10, 30)
#: Largest number of steps of a run that are redone in a row.
REDONE = 1000


def stepOf(phi, peclet):
    return min(STEP[phi], STRAIN/peclet)


def zeroShear(phi):
    """The viscosity of weak shear over that of the fluid: Verberg, de Schepper, Cohen (1997)."""
    chi = contactValue(phi)
    return chi*(1 + 1.44*phi**2*chi**2/(1 - 0.1241*phi + 10.46*phi**2))


def pairsNearer(x, box):
    """Numbers of pairs per sphere whose gaps are below EDGES, in a box that tilts along x."""
    d = x[:, None] - x
    for axis in (2, 1, 0):
        d -= np.round(d[..., axis:axis + 1]/box[axis, axis])*box[axis]
    # The nearest image has no other row of the lattice than these.
    gaps = np.concatenate([
        np.linalg.norm(d + k*box[0] + j*box[1], axis=-1)[np.triu_indices(len(x), 1)]
        for k in (-1, 0, 1) for j in (-1, 0, 1)
    ]) - 2
    return [2*np.count_nonzero(gaps < edge)/len(x) for edge in EDGES]


def repulsion(number):
    """What keeps spheres apart."""
    force = openmm.CustomNonbondedForce(f'{REPULSION*KT}*exp(-(r - 2)/{RANGE})')
    force.setNonbondedMethod(force.CutoffPeriodic)
    force.setCutoffDistance(CUTOFF)
    for _ in range(number):
        force.addParticle([])
    return force


def boltzmann(gap):
    """exp(-energy/kT) of two spheres."""
    return np.exp(-REPULSION*np.exp(-gap/RANGE))


def effectiveDiameter():
    """Of hard spheres that have the equilibrium of these, by Barker and Henderson."""
    gap = np.linspace(0, 20*RANGE, 4001)
    return 2 + np.trapz(1 - boltzmann(gap), gap)


def effectiveFraction(phi):
    return phi*(effectiveDiameter()/2)**3


def equilibrium(phi, isRepelled=True):
    """pairsNearer() in equilibrium, of these spheres, or of hard ones.

    The cavity function is that of hard spheres of the effective diameter near contact.
    """
    diameter = effectiveDiameter() if isRepelled else 2
    own = phi*(diameter/2)**3
    slope = -9*own*(1 + own)/(2*(1 - own)**3)/diameter  # of g at contact, by Percus and Yevick
    gap = np.linspace(0, 1, 401)*np.array(EDGES)[:, None]
    g = contactValue(own) + slope*(2 + gap - diameter)
    if isRepelled:
        g *= boltzmann(gap)
    return np.trapz(g*4*np.pi*(2 + gap)**2*phi*3/(4*np.pi), gap, axis=1).tolist()


def run(argument, job):
    """The means of one run.

    A sample has the components (xy, xx - yy, yy - zz) of the stress by PARTS, over viscosity and
    rate, and the pairs nearer than EDGES.
    """
    phi, peclet, number, samples, every, h, seed = argument
    x, edge = hardSpheres(number, phi, np.random.default_rng((seed, round(1000*phi))))
    context, fluid, integrator = periodicFluid('StokesianDynamics', REACH, x, edge, (peclet, 0, 1),
                                               scheme='TractionEulerMaruyama',
                                               temperature=TEMPERATURE, step=h, seed=seed,
                                               forces=[repulsion(number)])
    integrator.setMaximumRejections(REDONE)
    state = campaign.State(job, (phi, peclet, number, seed, h, every, REACH, REPULSION, RANGE))
    kept = state.load()
    rows, seconds, redone = [], 0.0, 0
    if kept:
        rows, seconds, redone = list(kept['rows']), float(kept['seconds']), int(kept['redone'])
        context.loadCheckpoint(kept['checkpoint'].tobytes())
    before, began = integrator.getNumRejectedSteps(), time.process_time()

    def spent():
        return (seconds + time.process_time() - began,
                redone + integrator.getNumRejectedSteps() - before)

    while len(rows) < samples:
        integrator.step(every)
        stress = fluid.getStressInContext(context)
        parts = [(s[0, 1], s[0, 0] - s[1, 1], s[1, 1] - s[2, 2])
                 for s in (getattr(stress, part)._value for part in PARTS)]
        box = context.getState().getPeriodicBoxVectors(asNumpy=True)._value
        rows.append(
            np.concatenate(
                [np.ravel(parts)/peclet,
                 pairsNearer(integrator.getBodyPositions()._value, box)]))
        job.report(len(rows))
        if state.isDue() or len(rows) == samples:
            state.save(rows=rows, checkpoint=campaign.checkpoint(context), seconds=spent()[0],
                       redone=spent()[1])
    seconds, redone = spent()
    rows = np.array(rows)
    times = h*every*(np.arange(len(rows)) + 1)
    late = rows[(times >= SETTLE/max(1, peclet)) | (times >= times[-1]/2)]
    blocks = np.array([block.mean(axis=0) for block in np.array_split(late, BLOCKS)])
    stresses = dict(zip(PARTS, blocks[:, :9].reshape(BLOCKS, 3, 3).transpose(1, 0, 2)))
    stresses['thermal'] = stresses['brownian'] + stresses['interparticle']
    stresses['total'] = stresses['thermal'] + stresses['hydrodynamic']
    found = {
        'fraction': phi,
        'peclet': peclet,
        'number': number,
        'seed': seed,
        'step': h,
        'steps': samples*every,
        'time': float(times[-1]),
        'strain': float(times[-1]*peclet),
        'settled_from': float(times[-1] - h*every*len(late)),
        'redone': redone/(samples*every),
        'processor_seconds': seconds
    }
    for k, name in enumerate(('viscosity', 'N1', 'N2')):
        for part, values in stresses.items():
            found[f'{name}_{part}'] = [values[:, k].mean(), values[:, k].std(ddof=1)/BLOCKS**0.5]
    found['viscosity_total'][0] += 1
    found['near'] = blocks[:, 9:].mean(axis=0)
    found['near_error'] = blocks[:, 9:].std(axis=0, ddof=1)/BLOCKS**0.5
    return found


def tables(data):
    """Lines of tables in Markdown."""
    yield ('| volume fraction | Péclet number | viscosity | hydrodynamic part | Brownian part '
           '| interparticle part | N₁/(ηγ̇) | hydrodynamic | thermal | N₂/(ηγ̇) |')
    yield '|---'*10 + '|'
    for each in data['runs']:
        cells = [
            brackets(*each[key])
            for key in ('viscosity_total', 'viscosity_hydrodynamic', 'viscosity_brownian',
                        'viscosity_interparticle', 'N1_total', 'N1_hydrodynamic', 'N1_thermal',
                        'N2_total')
        ]
        yield f'| {each["fraction"]:g} | {each["peclet"]:g} | ' + ' | '.join(cells) + ' |'
    yield ''
    yield ('| volume fraction | Péclet number | step | steps | time | strain | left out | redone '
           '| processor s |')
    yield '|---'*9 + '|'
    for each in data['runs']:
        yield (f'| {each["fraction"]:g} | {each["peclet"]:g} | {each["step"]:.2g} | '
               f'{each["steps"]} | {each["time"]:.2g} | {each["strain"]:.3g} | '
               f'{each["settled_from"]:.2g} | {100*each["redone"]:.1f} % | '
               f'{each["processor_seconds"]:.0f} |')
    yield ''
    yield '| neighbours at gaps below | ' + ' | '.join(f'{edge:g}' for edge in EDGES) + ' |'
    yield '|---'*(1 + len(EDGES)) + '|'
    for phi in dict.fromkeys(each['fraction'] for each in data['runs']):
        for name, isRepelled in (('hard spheres', False), ('with the repulsion', True)):
            yield f'| {phi:g}, equilibrium, {name} | ' + ' | '.join(
                f'{value:.3f}' for value in equilibrium(phi, isRepelled)) + ' |'
        for each in data['runs']:
            if each['fraction'] == phi:
                yield f'| {phi:g}, Péclet number {each["peclet"]:g} | ' + ' | '.join(
                    brackets(*pair) for pair in zip(each['near'], each['near_error'])) + ' |'


def draw(data, file):
    plt = pyplot()
    figure, axes = plt.subplots(1, 3, figsize=(13.5, 4.2), layout='constrained')
    fractions = list(dict.fromkeys(each['fraction'] for each in data['runs']))
    for axis, phi in zip(axes, fractions):
        own = [each for each in data['runs'] if each['fraction'] == phi]
        x = [each['peclet'] for each in own]
        for key, fmt, label in (('viscosity_total', 'ko-', 'whole'),
                                ('viscosity_hydrodynamic', 'C0s--', '1 + hydrodynamic part'),
                                ('viscosity_thermal', 'C3^--', 'Brownian and interparticle')):
            value, error = np.array([each[key] for each in own]).T
            axis.errorbar(x, value + ('hydro' in key), error, fmt=fmt, ms=5, lw=0.9, capsize=3,
                          label=label)
        axis.axhline(
            fits(phi)['viscosity'], color='C0', lw=0.8, ls=':',
            label='high frequency, published fit')
        axis.axhspan(zeroShear(phi), zeroShear(effectiveFraction(phi)), color='0.9', zorder=0,
                     label='weak shear, published fit')
        axis.set(xscale='log', xlabel='Péclet number', ylabel='over the viscosity of the fluid',
                 title=f'volume fraction {phi:g}', ylim=(0, None))
        axis.legend(fontsize=7)
    for k, phi in enumerate(fractions):
        # In weaker flow they are noise.
        own = [each for each in data['runs'] if each['fraction'] == phi and each['peclet'] >= 1]
        for name, fmt in (('N1', 'o-'), ('N2', 's--')):
            value, error = np.array([each[f'{name}_total'] for each in own]).T
            axes[2].errorbar([each['peclet'] for each in own], value, error, fmt=f'C{k}' + fmt,
                             ms=5, lw=0.9, capsize=3,
                             label=f'{"N₁" if name == "N1" else "N₂"}, {phi:g}')
    axes[2].axhline(0, color='0.7', lw=0.7)
    axes[2].set(xscale='log', xlabel='Péclet number', ylabel='over viscosity × rate',
                title='normal stress differences')
    axes[2].legend(fontsize=8)
    for axis in axes:
        axis.grid(alpha=0.3)
    figure.savefig(file, dpi=85)
    plt.close(figure)


def main():
    parser = campaign.parser(__doc__, 'two short runs: seconds')
    parser.add_argument('--halved', action='store_true',
                        help='make some of the runs with half the step, and half as long')
    parser.add_argument(
        '--samples', type=int, default=400,
        help='of runs at the volume fraction 0.3 and Péclet numbers up to 1, one '
        'every 10 steps (%(default)s); there are 0.6 times as many above 1, and '
        '1.4 times as many at 0.45')
    parser.add_argument('--seed', type=int, default=1)
    campaign.addOptions(parser)
    args = campaign.settle(parser.parse_args())
    cases = [(phi, peclet, NUMBER,
              round(args.samples*(1.4 if phi > 0.4 else 1)*(1 if peclet <= 1 else 0.6)), EVERY,
              stepOf(phi, peclet), args.seed + k) for k, peclet in enumerate(PECLET)
             for phi in FRACTIONS]
    if args.halved:
        cases = [(phi, peclet, *rest, h/2, seed) for phi, peclet, *rest, h, seed in cases
                 if phi == HALVED[0] and peclet in HALVED[1]]
    if args.quick:
        cases = [(phi, 10, NUMBER, 12, 1, stepOf(phi, 10), args.seed) for phi in FRACTIONS]
    runs = campaign.run(
        run, cases,
        [f'shear {phi:g} {peclet:g}' + ' halved'*args.halved
         for phi, peclet, *_ in cases], args, [case[3] for case in cases], 'sample', 'steady shear')
    runs.sort(key=lambda each: (each['fraction'], each['peclet']))
    data = {'provenance': provenance(args), 'reach': REACH, 'runs': runs}
    if args.halved:
        save(args.output, 'steady_shear_halved.json', data)
    else:
        save(args.output, 'steady_shear.json', data)
        draw(data, args.output/'steady_shear.png')
    print('\n'.join(tables(data)))


if __name__ == '__main__':
    main()
