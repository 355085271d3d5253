"""What the benchmarks share: where they run, how results are kept, and a box of water."""
import datetime
import json
import os
import pathlib
import platform

import numpy as np
import openmm
from openmm import app, unit

import openmmrigidhi

RESULTS = pathlib.Path(__file__).parent/'results'


def describeMachine():
    """The machine and the versions, for the results; load averages tell whether others were using it."""
    processors = [line.split(':')[1].strip() for line in open('/proc/cpuinfo') if line.startswith('model name')]
    flags = next((line for line in open('/proc/cpuinfo') if line.startswith('flags')), '').split()
    return {'processor': processors[0] if processors else platform.processor(), 'cores': os.cpu_count(),
            'avx512': 'avx512f' in flags, 'system': platform.system() + ' ' + platform.release().split('-')[0],
            'python': platform.python_version(), 'openmm': openmm.version.short_version,
            'openmmrigidhi': openmmrigidhi.__version__, 'load_average_before': round(os.getloadavg()[0], 2),
            'date': datetime.datetime.now(datetime.timezone.utc).strftime('%Y-%m-%d %H:%M UTC')}


def save(output, name, machine, result):
    """Write a result as JSON, with the machine described at its start and the load at its end."""
    output.mkdir(parents=True, exist_ok=True)
    machine = dict(machine, load_average_after=round(os.getloadavg()[0], 2))
    (output/name).write_text(json.dumps({'machine': machine, **result}, indent=1) + '\n')


def spread(values):
    """Median and quartiles."""
    low, middle, high = np.percentile(values, (25, 50, 75))
    return {'median': round(float(middle), 6), 'quartiles': [round(float(low), 6), round(float(high), 6)]}


def show(values, digits=3):
    """A spread as text."""
    return f'{values["median"]:.{digits}f} ({values["quartiles"][0]:.{digits}f} ... {values["quartiles"][1]:.{digits}f})'


def waterBox(molecules, density=989.85):
    """TIP4P-Ew molecules on a lattice, randomly oriented: (topology, positions); density in kg/m^3."""
    forceField = app.ForceField('tip4pew.xml')
    random = np.random.default_rng(1)
    edge = (molecules*18.01528/(density*0.602214076))**(1/3)  # nm
    side = int(np.ceil(molecules**(1/3) - 1e-9))
    cells = np.array(list(np.ndindex(side, side, side)))[:molecules]
    angle = np.deg2rad(104.52)
    shape = 0.09572*np.array([(0, 0, 0), (1, 0, 0), (np.cos(angle), np.sin(angle), 0)])
    topology = app.Topology()
    topology.setPeriodicBoxVectors(np.eye(3)*edge*unit.nanometer)
    chain = topology.addChain()
    positions = []
    for cell in cells:
        residue = topology.addResidue('HOH', chain)
        oxygen, *hydrogens = [topology.addAtom(name, app.Element.getBySymbol(name[0]), residue)
                              for name in ('O', 'H1', 'H2')]
        for hydrogen in hydrogens:
            topology.addBond(oxygen, hydrogen)
        rotation = np.linalg.qr(random.normal(size=(3, 3)))[0]
        positions.extend((cell + 0.5)*edge/side + shape @ rotation)
    modeller = app.Modeller(topology, np.array(positions)*unit.nanometer)
    modeller.addExtraParticles(forceField)
    return modeller.topology, modeller.positions
