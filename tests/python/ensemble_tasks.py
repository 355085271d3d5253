"""What the workers of test_ensemble.py compute: they import it by name."""
import multiprocessing
import os
import signal
import time

from openmmrigidhi.accuracy import scenes

#: Where tasks leave marks, an environment variable.
MARKS = 'RIGIDHI_TEST_MARKS'


def onlyOnce(name):
    """Whether this is the first call with this name, of all processes."""
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
    """The same parameters, another System, if the tests say so."""
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
    """The same; of all tasks that come to 1.5 ps one dies, once."""
    if context.getState().getTime()._value > 1.51 and onlyOnce('died'):
        die()
    return energy(context)


def energyOfTheSlow(context):
    """The same, slowly."""
    time.sleep(0.02)
    return energy(context)


def energyOrNot(context):
    """The same, but the first run that comes to 1.5 ps fails."""
    if context.getState().getTime()._value > 1.51 and onlyOnce('failed'):
        raise RuntimeError('this measurement fails on purpose')
    return energy(context)


def infinite(context):
    return float('inf')


def exits(context):
    """Ends the task, where it is not the program that the tests are."""
    if multiprocessing.parent_process() is not None:
        raise SystemExit('leaving')
    return 0.0


def square(x, job):
    job.report(1)
    return x*x


def throwAtThree(x, job):
    if x == 3:
        raise ValueError('three is not wanted here')
    return x*x


def alwaysDie(x, job):
    if x == 1:
        # So late that what this worker found before has been fetched.
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
    """Counts to 4 in a file, and dies after each."""
    path, done = os.path.join(job.directory, 'count'), 0
    if os.path.exists(path):
        with open(path) as file:
            done = int(file.read())
    if done < 4:
        with open(path, 'w') as file:
            file.write(str(done + 1))
        job.report(done + 1)
        # So late that the report has arrived, on a machine with twenty times its load too.
        time.sleep(1.0)
        die()
    return done


def countTogether(x, job):
    """How many tasks were at work at a time while this one was; it waits until they are as many as
    wanted, 20 s at most, then 1 s for more."""
    wanted, number = x
    mine, seen = os.path.join(os.environ[MARKS], f'working{wanted}_{number}'), 0
    open(mine, 'w').close()
    deadline, enough = time.monotonic() + 20, None
    while time.monotonic() < (deadline if enough is None else enough):
        seen = max(
            seen,
            sum(name.startswith(f'working{wanted}_') for name in os.listdir(os.environ[MARKS])))
        if seen >= wanted and enough is None:
            enough = time.monotonic() + 1
        time.sleep(0.05)
    os.remove(mine)
    return seen


def unpicklable(x, job):
    return lambda: x


def leave(x, job):
    raise SystemExit('leaving')
