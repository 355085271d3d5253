"""What 0.5 % of water's energy and of its mean square dipole moment costs: the best that users have today beside LangevinC.

216 TIP4P-Ew molecules, CPU platform, one thread, processor time. LangevinC with real moments and with moments times 4, 8, 16, OpenMM's
LangevinMiddleIntegrator with its own hydrogens and heavier ones, and its MTSLangevinIntegrator, each with several frictions. ``price.py run`` makes the runs of a
series, in turn; stopped and started again it goes on where it was. What is asked for more than once (a longer run, another series) goes on, too. ``price.py report``
writes results_price/ from all runs that there are.
"""
import argparse
import os
import pathlib
import sys

for _variable in ('OPENBLAS_NUM_THREADS', 'OMP_NUM_THREADS'):
    os.environ.setdefault(_variable, '1')

import numpy as np  # noqa: E402
import openmm  # noqa: E402
from tqdm import tqdm  # noqa: E402

from openmmrigidhi import accuracy  # noqa: E402
from openmmrigidhi.accuracy import measurement, observables  # noqa: E402
from openmmrigidhi.accuracy.scenes import Scene  # noqa: E402

HERE = pathlib.Path(__file__).resolve().parent
OBSERVABLES = ['potential_energy', 'dipole_squared', 'translational_temperature', 'rotational_temperature_1']
WANTED = ['potential_energy:0.5%', 'dipole_squared:0.5%', 'potential_energy:0.5%,dipole_squared:0.5%']
#: The limit of small steps of results/results.json, kJ/mol.
REFERENCES = {'potential_energy': (-46.498, 0.042)}
#: Method -> steps in fs.
SERIES = {
    'first': {'LangevinC-g1-G2': (9,), 'LangevinC-I4-g1-G2': (12,), 'LangevinC-I8-g1-G2': (14, 16), 'LangevinMiddle-g1': (7,),
              'LangevinMiddle-H3-g1': (10, 12), 'LangevinMiddle-H4-g1': (12,), 'MTSLangevin-N2-g1': (10,)},
}
#: ps that a setting advances in one turn; what is between two notes on disk.
PIECE = 20.0
SAMPLE_INTERVAL, EQUILIBRATION = 0.2, 20.0


class _Components:
    """The box's dipole moment, e nm: each of its components is a series, from which correlation times are known better than from the square alone."""

    name, setup = 'components', observables.BUILT_IN['dipole_squared'].setup

    @staticmethod
    def measure(sample, charges):
        return observables.dipoleMoment(sample, charges)


class Legs(accuracy.StepSizeStudy):
    """Settings whose runs are made in legs: each time that a run is taken up again, its random numbers are others."""

    leg = 0

    def __init__(self, *arguments, **keywords):
        super().__init__(*arguments, **keywords)
        self.reported = list(self.observables)
        self.observables.append(_Components())

    def settingSeed(self, setting):
        return (super().settingSeed(setting) + 7919*self.leg) % (2**31 - 2) + 1


class Kept:
    """A run that is kept in a folder: samples and times, and the State that it goes on from."""

    def __init__(self, study, setting, folder):
        self.study = study
        self.setting = setting
        self.path = folder/f'{setting.method.name}_{1000*setting.stepSize:g}fs.npz'
        self.record = measurement.Record(0.0)
        self.state, self.legs, self.run = None, 0, None
        if self.path.exists():
            with np.load(self.path) as file:
                kept = {name: file[name] for name in file}
            self.state, self.legs = str(kept['state']), int(kept['legs'])
            record = self.record
            record.samplesAt, record.length, record.equilibration = (float(kept[name]) for name in ('samplesAt', 'length', 'equilibration'))
            record.status, record.message = str(kept['status']), str(kept['message'])
            record.timings = [tuple(row) for row in kept['timings']]
            record.series = {name[7:]: list(values) for name, values in kept.items() if name.startswith('series_')}

    def _begin(self):
        """A Context where the run stands."""
        self.study.leg = self.legs
        self.legs += 1
        self.run = self.study._makeRun(self.setting)
        if self.state is None:
            self.run.advance(round(EQUILIBRATION/self.run.record.samplesAt), record=False)
            self.record = self.run.record
        else:
            # What its energy may be was found at the scene's start. The time goes on with the record's.
            state = openmm.XmlSerializer.deserialize(self.state)
            self.run.context.setPositions(state.getPositions())
            self.run.context.setVelocities(state.getVelocities())
            self.run.time = self.record.equilibration + self.record.length
            self.run.record = self.record

    def advance(self, ps):
        """Go on, and keep what there is then."""
        if self.record.status != measurement.STABLE:
            return
        if self.run is None:
            self._begin()
        if self.run.isAlive:
            self.run.advance(max(1, round(ps/self.run.record.samplesAt)))
        self._keep()

    def _keep(self):
        record = self.record = self.run.record
        if self.run.isAlive:
            self.state = openmm.XmlSerializer.serialize(self.run.context.getState(getPositions=True, getVelocities=True))
        new = self.path.with_suffix('.new.npz')
        np.savez(new, state=self.state or '', legs=self.legs, samplesAt=record.samplesAt, length=record.length, equilibration=record.equilibration,
                 status=record.status, message=record.message, timings=np.array(record.timings).reshape(-1, 3),
                 **{f'series_{name}': np.array(values) for name, values in record.series.items()})
        os.replace(new, self.path)


def water(folder, threads):
    """The equilibrated box, made once for all runs of this folder."""
    names = [folder/f'water_{part}.xml' for part in ('system', 'state', 'integrator')]
    if not all(name.exists() for name in names):
        folder.mkdir(parents=True, exist_ok=True)
        with tqdm(desc='equilibrating', unit='step') as bar:
            scene = accuracy.scenes.water(216, seed=2026, threads=threads, progress=lambda done, total: bar.update(done - bar.n))
        context = scene.makeContext(openmm.VerletIntegrator(0.001), openmm.Platform.getPlatformByName('Reference'), {}, 1)
        objects = (scene.system, context.getState(getPositions=True, getVelocities=True), scene.makeIntegrator())
        for name, thing in zip(names, objects):
            name.write_text(openmm.XmlSerializer.serialize(thing))
    system, state, integrator = (openmm.XmlSerializer.deserialize(name.read_text()) for name in names)
    return Scene(system, state, integrator, 'water216', '216 TIP4P-Ew molecules at 995 kg/m^3 and 298.15 K, PME, cutoff 0.9 nm; where a method\'s name says '
                 'nothing else gamma = 5/ps, Gamma = 10/ps', equilibration=EQUILIBRATION, sampleInterval=SAMPLE_INTERVAL)


def makeStudy(options, settings):
    steps = {name: [h/1000 for h in own] for name, own in settings.items()}
    return Legs(water(options.work, 1), list(steps), steps, REFERENCES, observables=OBSERVABLES, platform='CPU', threads=1, seed=options.seed, clock='cpu')


def wanted(options):
    """Method -> steps in fs, of a series or of what was named."""
    if not options.methods:
        return SERIES[options.series]
    return {name: tuple(float(h) for h in own.split(',')) for name, _, own in (text.partition(':') for text in options.methods)}


def run(options):
    """Settings advance in turn until each has its length."""
    study = makeStudy(options, wanted(options))
    kept = [Kept(study, setting, options.work) for setting in study.settings()]
    rng = np.random.default_rng()
    with tqdm(total=options.length*len(kept), initial=sum(min(each.record.length, options.length) for each in kept), unit='ps', mininterval=5) as bar:
        while True:
            waiting = [each for each in kept if each.record.status == measurement.STABLE and each.record.length < options.length - 0.5*PIECE]
            if not waiting:
                break
            for i in rng.permutation(len(waiting)):
                each = waiting[i]
                bar.set_description(f'{each.setting.method.name} {1000*each.setting.stepSize:g} fs')
                before = each.record.length
                each.advance(PIECE)
                bar.update(each.record.length - before)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('what', choices=['run', 'report'])
    parser.add_argument('--series', choices=SERIES, default='scout')
    parser.add_argument('--methods', nargs='+', metavar='NAME:STEPS', help='instead of a series, e.g. LangevinC-I8:14,16 (fs)')
    parser.add_argument('--length', type=float, default=100, help='ps for each setting, with what it has already (100)')
    parser.add_argument('--seed', type=int, default=2031)
    parser.add_argument('--work', type=pathlib.Path, default=HERE/'results_price'/'notes', help='where runs are kept (results_price/notes)')
    parser.add_argument('--output', type=pathlib.Path, default=HERE/'results_price')
    options = parser.parse_args()
    {'run': run}[options.what](options)


if __name__ == '__main__':
    main()
