"""The tasks that workers of the tests of ensembles compute. Workers import this module by name."""
import multiprocessing
import os
import signal
import time

from openmmrigidhi.accuracy import Observable, scenes

#: The environment variable that holds the directory where tasks leave marks.
MARKS = 'RIGIDHI_TEST_MARKS'


def onlyOnce(name):
    """Whether this is the first call with this name in any process."""
    try:
        os.close(os.open(os.path.join(os.environ[MARKS], name), os.O_CREAT | os.O_EXCL))
    except FileExistsError:
        return False
    return True


def die():
    os.kill(os.getpid(), signal.SIGKILL)


def scene(bodies=3, temperature=300.0, broken=False, seed=1):
    if broken:
        raise ArithmeticError('this scene is broken on purpose')
    return scenes.trap(bodies, temperature, seed=seed)


def otherScene(bodies=3, seed=1):
    """The scene with the same parameters, but with another System if a test has left the mark."""
    return scenes.trap(
        bodies, gamma=5.0 if os.path.exists(os.path.join(os.environ[MARKS], 'changed')) else 10.0,
        seed=seed)


def bare(seed=1):
    made = scenes.trap(2, seed=seed)
    return made.system, made.positions, made.makeIntegrator()


def energy(context):
    return context.getState(getEnergy=True).getPotentialEnergy()


energy.unit = 'kJ/mol'


def energyOfMortals(context):
    """The energy. One of all tasks that come to 1.5 ps dies, once."""
    if context.getState().getTime()._value > 1.51 and onlyOnce('died'):
        die()
    return energy(context)


def energyOfTheSlow(context):
    """The energy, slowly."""
    time.sleep(0.02)
    return energy(context)


def energyOrNot(context):
    """The energy. The first run that comes to 1.5 ps fails."""
    if context.getState().getTime()._value > 1.51 and onlyOnce('failed'):
        raise RuntimeError('this measurement fails on purpose')
    return energy(context)


def energyOrNan(context):
    """The energy. One sample of the first run that comes to 1.5 ps is no number."""
    if context.getState().getTime()._value > 1.51 and onlyOnce('nan'):
        return float('nan')
    return energy(context)


class _Count:
    def __init__(self, scene, platform, properties):
        self.samples = 0


def _time_from_the_third_on(sample, count):
    count.samples += 1
    return sample.energies.getTime()._value if count.samples > 2 else float('nan')


#: An observable that needs two earlier samples, and does not say what it remembers.
forgetful = Observable('forgetful', 'time', 'ps', _time_from_the_third_on, setup=_Count)


def infinite(context):
    return float('inf')


def exits(context):
    """Ends the task's process, if it is not the process of the tests."""
    if multiprocessing.parent_process() is not None:
        raise SystemExit('leaving')
    return 0.0


def exitsAtLargeSteps(context):
    """Ends the task's process where steps are longer than 5 fs."""
    return exits(context) if context.getIntegrator().getStepSize()._value > 0.005 else 1.0


def square(x, job):
    job.report(1)
    return x*x


def throwAtThree(x, job):
    if x == 3:
        raise ValueError('three is not wanted here')
    return x*x


def alwaysDie(x, job):
    if x == 1:
        # It dies so late that this worker's earlier results have been fetched.
        time.sleep(0.3)
        die()
    return x


def countInDirectory(x, job):
    """Counts to 6 in a file, and dies once at 3."""
    path = os.path.join(job.directory, 'count')
    begin = 0
    if os.path.exists(path):
        with open(path) as file:
            begin = int(file.read())
    for k in range(begin, 6):
        if k == 3 and x == 0 and onlyOnce('counting'):
            die()
        with open(path, 'w') as file:
            file.write(str(k + 1))
    return begin


def dieOften(x, job):
    """Counts to 3 in a file, and dies after each."""
    path, done = os.path.join(job.directory, 'count'), 0
    if os.path.exists(path):
        with open(path) as file:
            done = int(file.read())
    if done < 3:
        with open(path, 'w') as file:
            file.write(str(done + 1))
        job.report(done + 1)
        # It dies so late that the report has arrived, also on a machine with ten times the load.
        time.sleep(0.5)
        die()
    return done


_born = None


def energyOfTheShortLived(context):
    """The energy, slowly. A process dies 0.7 s after its first sample."""
    global _born
    _born = _born or time.monotonic()
    if time.monotonic() - _born > 0.7:
        die()
    return energyOfTheSlow(context)


def countTogether(x, job):
    """The number of tasks that worked at the same time as this one. The task waits until as many as
    wanted work, 20 s at most, and then 0.5 s for more."""
    wanted, number = x
    mine, seen = os.path.join(os.environ[MARKS], f'working{wanted}_{number}'), 0
    open(mine, 'w').close()
    deadline, enough = time.monotonic() + 20, None
    while time.monotonic() < (deadline if enough is None else enough):
        seen = max(
            seen,
            sum(name.startswith(f'working{wanted}_') for name in os.listdir(os.environ[MARKS])))
        if seen >= wanted and enough is None:
            enough = time.monotonic() + 0.5
        time.sleep(0.05)
    os.remove(mine)
    return seen


def unpicklable(x, job):
    return lambda: x


def leave(x, job):
    raise SystemExit('leaving')


class Fragile:
    """A value that pickle accepts, and that cannot be unpickled."""
    def __reduce__(self):
        return _break, ()


def _break():
    raise RuntimeError('this breaks on purpose')


def fragileOne(x, job):
    return Fragile() if x == 1 else x


class Stillborn:
    """An argument whose unpickling kills the process a number of times."""
    def __init__(self, times):
        self.times = times

    def __reduce__(self):
        return _come_to_life, (self.times,)


def _come_to_life(times):
    if any(onlyOnce(f'birth{k}') for k in range(times)):
        die()
    return times


def returnIt(x, job):
    return x
