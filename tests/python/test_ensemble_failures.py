"""openmmrigidhi.ensemble: what fails, is damaged, missing or wrong is named; the rest is used."""
import errno
import fcntl
import json
import math
import os
import resource

import numpy as np
import pytest

import ensemble_tasks
from ensemble_support import SCENE, same, samples, small
from openmmrigidhi import accuracy, ensemble
from openmmrigidhi.accuracy import scenes
from openmmrigidhi.ensemble import study as studyModule, taskfiles, tasks

pytest_plugins = ['ensemble_fixtures']
pytestmark = pytest.mark.usefixtures('marks')


def test_a_failing_setting_is_reported_and_the_rest_goes_on(tmp_path):
    study = small(settings=[{}, {'broken': True}], replicas=2, length=1.0)
    result = study.run(str(tmp_path/'study'), quiet=True)
    assert [task.status for task in result.tasks] == ['complete', 'complete', 'failed', 'failed']
    failed = result.problems()[0]
    assert failed.seed == ensemble.taskSeed(1, 1, 0) and failed.settings == {'broken': True}
    assert ('ArithmeticError: this scene is broken on purpose' in failed.message
            and 'in scene' in failed.traceback)
    assert str(failed.seed) in result.table() and '2 failed' in result.row('energy', 1)['note']
    assert result.row('energy', 1)['mean'] is None and result.row('energy', 0)['replicas'] == 2


def test_what_failed_is_tried_again_from_its_checkpoint(undisturbed, tmp_path):
    directory = str(tmp_path/'study')
    study = small(['ensemble_tasks:energyOrNot'])
    first = study.run(directory, quiet=True)
    assert [task.status for task in first.tasks] == ['failed', 'complete', 'complete']
    assert first.tasks[0].samples == 20 and first.row('energyOrNot')['replicas'] == 2
    second = study.run(directory, quiet=True)
    assert second.isComplete and not second.about['failures']
    assert same(samples(second), samples(undisturbed))


def test_an_observable_that_is_infinite(tmp_path):
    result = small(['ensemble_tasks:infinite'], replicas=1).run(str(tmp_path/'study'), quiet=True)
    assert 'it must be finite: the run may have exploded' in result.tasks[0].message


def test_damaged_files_are_named_and_the_rest_is_used(undisturbed, tmp_path):
    directory = tmp_path/'study'
    study = small()
    whole = study.run(str(directory), quiet=True)
    path = directory/'tasks'/'s0000_r0001.h5'
    path.write_bytes(path.read_bytes()[:1000])
    damaged = ensemble.read(directory)
    assert [task.status for task in damaged.tasks] == ['complete', 'damaged', 'complete']
    assert 's0000_r0001.h5: it is damaged' in damaged.table() and damaged.row(
        'energy')['replicas'] == 2
    assert np.array_equal(damaged.series('energy', 0, 2), whole.series('energy', 0, 2))
    with pytest.raises(ValueError, match='found no samples of .*, of a task that has begun'):
        damaged.series('energy', 0, 1)
    again = study.run(str(directory), quiet=True)
    assert same(samples(again), samples(undisturbed))
    assert (directory/'tasks'/'s0000_r0001.h5.damaged1').stat().st_size == 1000
    assert again.about['sessions'][-1]['put_aside'] == [
        str(directory/'tasks'/'s0000_r0001.h5.damaged1')
    ]


def test_files_that_cannot_be_read_are_named_and_stay_where_they_are(tmp_path, monkeypatch):
    directory = tmp_path/'study'
    study = small()
    study.run(str(directory), quiet=True)
    path = directory/'tasks'/'s0000_r0001.h5'
    before = path.read_bytes()
    # Root may read everything, so the system's refusal is made up.
    plain = open

    def refuse(name, *arguments, **keywords):
        if str(name) == str(path):
            raise PermissionError(errno.EACCES, 'Permission denied')
        return plain(name, *arguments, **keywords)

    monkeypatch.setattr('builtins.open', refuse)
    found = ensemble.read(directory)
    assert [task.status for task in found.tasks] == ['complete', 'damaged', 'complete']
    assert r's0000_r0001.h5: it cannot be read (Permission denied)' in found.tasks[1].message
    with pytest.raises(taskfiles.UnreadableFile, match='it cannot be read .Permission denied'):
        study.run(str(directory), quiet=True)
    monkeypatch.undo()
    assert path.read_bytes() == before
    assert not list(path.parent.glob('*.damaged*'))


def test_files_that_others_have_locked_are_read(tmp_path):
    directory = tmp_path/'study'
    small(replicas=1, length=0.2).run(str(directory), quiet=True)
    with open(directory/'tasks'/'s0000_r0000.h5', 'rb') as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        assert [task.status for task in ensemble.read(directory).tasks] == ['complete']


def test_a_file_where_a_directory_should_be(tmp_path):
    (tmp_path/'study').mkdir()
    (tmp_path/'study'/'tasks').write_text('')
    with pytest.raises(NotADirectoryError, match='tasks: it is, or is below, a file; it must be'):
        small(replicas=1, length=0.2).run(str(tmp_path/'study'), quiet=True)
    (tmp_path/'file').write_text('')
    with pytest.raises(NotADirectoryError, match='it is, or is below, a file; it must be a direct'):
        small(replicas=1, length=0.2).run(str(tmp_path/'file'), quiet=True)


def test_a_file_system_without_locks(tmp_path, monkeypatch):
    def refuse(*arguments):
        raise OSError(errno.ENOLCK, 'No locks available')

    monkeypatch.setattr(fcntl, 'flock', refuse)
    with pytest.raises(OSError, match='it cannot be locked .No locks available.; its file system'):
        small(replicas=1, length=0.2).run(str(tmp_path/'study'), quiet=True)


def test_every_flipped_byte_that_matters_is_noticed(undisturbed, tmp_path):
    """One wrong byte anywhere: the file is refused, or its content is unchanged."""
    source = undisturbed.tasks[0].path
    good, data = taskfiles.load(source), open(source, 'rb').read()
    rng, refused = np.random.default_rng(1), 0
    path = str(tmp_path/'flipped.h5')
    for place in rng.choice(len(data), 150, replace=False):
        flipped = bytearray(data)
        flipped[place] ^= 1 << int(rng.integers(8))
        with open(path, 'wb') as file:
            file.write(flipped)
        try:
            found = taskfiles.load(path)
        except taskfiles.DamagedFile as error:
            refused += 1
            assert 'flipped.h5: it is damaged' in str(
                error) and 'it must be a whole file of a task' in str(error)
        else:
            assert found.about == good.about and found.state == good.state and same(
                found.series, good.series)
    print(f'{refused} of 150 were refused')
    # Nearly half of the bytes of so small a file have no meaning.
    assert refused > 50


def test_files_of_other_formats_and_with_missing_samples(undisturbed, tmp_path):
    path = str(tmp_path/'other.h5')
    content = taskfiles.load(undisturbed.tasks[0].path)
    content.about['samples'] += 1
    taskfiles.save(path, content)
    with pytest.raises(taskfiles.DamagedFile, match='60 samples where 61 are said to be'):
        taskfiles.load(path)
    import h5py
    with h5py.File(path, 'w') as file:
        file.attrs['format'] = 'something else'
    with pytest.raises(taskfiles.DamagedFile, match='its format is .something else. instead of'):
        taskfiles.load(path)
    assert taskfiles.load(str(tmp_path/'nothing.h5')) is None


def test_a_writer_that_fails_leaves_the_old_file(undisturbed, tmp_path, monkeypatch):
    path = str(tmp_path/'task.h5')
    content = taskfiles.load(undisturbed.tasks[0].path)
    taskfiles.save(path, content)
    before = open(path, 'rb').read()
    content.series['energy'] = ['not a number']
    with pytest.raises(ValueError):
        taskfiles.save(path, content)
    assert open(path, 'rb').read() == before and os.listdir(tmp_path/'..'/tmp_path.name) == sorted(
        os.listdir(tmp_path))
    assert not [name for name in os.listdir(tmp_path) if name.endswith('.part')]
    (tmp_path/'task.h5.host.1.part').write_text('')
    taskfiles.clean(str(tmp_path))
    assert not (tmp_path/'task.h5.host.1.part').exists()


def test_files_of_other_tasks_are_named(undisturbed, tmp_path):
    """A whole file at the wrong place: of another replica, setting, or study. It is not taken for
    the one that belongs there, and put aside."""
    directory, other = tmp_path/'study', tmp_path/'other'
    study = small(settings=[{}, {'temperature': 280.0}], replicas=2, length=1.0)
    whole = study.run(str(directory), quiet=True)
    small(settings=[{}, {'temperature': 280.0}], replicas=2, length=1.0).run(str(other), quiet=True)
    path = directory/'tasks'/'s0000_r0000.h5'
    for source, text in ((directory/'tasks'/'s0000_r0001.h5',
                          'it is of another task: its replica is 1 instead of 0'),
                         (directory/'tasks'/'s0001_r0000.h5', 'its setting is 1 instead of 0'),
                         (other/'tasks'/'s0000_r0000.h5', 'its study is ')):
        path.write_bytes(source.read_bytes())
        found = ensemble.read(directory)
        assert [task.status for task in found.tasks] == ['damaged', *['complete']*3]
        assert text in found.tasks[0].message and found.row('energy')['replicas'] == 1
        again = study.run(str(directory), quiet=True)
        assert again.isComplete and same(samples(again), samples(whole))


def test_files_of_earlier_versions_are_read(tmp_path):
    """They do not say of which study they are, and study.json has no checksum."""
    directory = tmp_path/'study'
    study = small(replicas=1, length=0.5)
    whole = study.run(str(directory), quiet=True)
    content = taskfiles.load(whole.tasks[0].path)
    del content.about['study']
    taskfiles.save(whole.tasks[0].path, content)
    about = json.loads((directory/'study.json').read_text())
    del about['checksum']
    (directory/'study.json').write_text(json.dumps(about))
    longer = study.extended(length=1.0).run(str(directory), extend=True, quiet=True)
    assert np.array_equal(longer.series('energy', 0, 0)[:10], whole.series('energy', 0, 0))
    assert taskfiles.load(whole.tasks[0].path).about['study'] == about['identity']
    content.about = {'samples': 10}
    taskfiles.save(whole.tasks[0].path, content)
    assert 'it does not say its setting' in ensemble.read(directory).tasks[0].message


def test_every_change_of_study_json_is_noticed(tmp_path):
    """A flipped bit, or a number or text that was changed, is refused: a wrong temperature there
    would be the one that the results are said to be of."""
    directory = tmp_path/'study'
    small(settings=[{'temperature': 280.0}], replicas=2, length=0.1).run(str(directory), quiet=True)
    path = directory/'study.json'
    data, good = path.read_bytes(), studyModule._read_about(directory)
    changed = [data.replace(b'280.0', b'281.0'), data.replace(b'"length": 0.1', b'"length": 0.2')]
    rng = np.random.default_rng(3)
    for place in rng.choice(len(data), 150, replace=False):
        flipped = bytearray(data)
        flipped[place] ^= 1 << int(rng.integers(8))
        changed.append(bytes(flipped))
    refused = 0
    for each in changed:
        path.write_bytes(each)
        try:
            found = studyModule._read_about(directory)
        except ValueError as error:
            refused += 1
            assert 'study.json: it is damaged' in str(error)
        else:
            # One bit may make another name of the checksum itself.
            assert all(found[key] == good[key] for key in good if key != 'checksum')
    # Blanks at the beginnings of lines have no meaning.
    assert refused > 75
    path.write_bytes(changed[0])
    with pytest.raises(ValueError, match='the one that its checksum is of'):
        ensemble.Study.load(directory)


def test_a_kept_scene_is_the_one_of_its_study(tmp_path):
    """A System that was changed in the directory, or another Scene, would give the replicas of an
    extension another System than the earlier ones have."""
    directory = tmp_path/'study'

    def study(scene):
        return ensemble.Study(scene, replicas=1, length=0.2, equilibration=0.1,
                              observables=['ensemble_tasks:energy'], platform='Reference')

    study(scenes.trap(3)).run(str(directory), quiet=True)
    for name, old, new in (('system.xml', 'mass="16"', 'mass="17"'),
                           ('integrator.xml', 'temperature="300"', 'temperature="301"'),
                           ('scene.json', '"sampleInterval": 0.05', '"sampleInterval": 0.06')):
        path = directory/'scene'/name
        whole = path.read_text()
        assert old in whole
        path.write_text(whole.replace(old, new, 1))
        with pytest.raises(ValueError, match='its checksum is not the one that the study has'):
            ensemble.Study.load(directory)
        path.write_text(whole)
    with pytest.raises(ValueError, match='its study has scene .*it must be the same'):
        study(scenes.trap(4)).run(str(directory), quiet=True)
    assert study(scenes.trap(3)).run(str(directory), quiet=True).isComplete
    # A study of an earlier version does not know the checksum.
    about = json.loads((directory/'study.json').read_text())
    del about['checksum'], about['definition']['scene']['sha256']
    (directory/'study.json').write_text(json.dumps(about))
    assert study(scenes.trap(3)).run(str(directory), quiet=True).isComplete
    assert ensemble.Study.load(directory).run(str(directory), quiet=True).isComplete


def test_other_files_are_not_replaced(tmp_path):
    (tmp_path/'results.csv').write_text('of another program')
    with pytest.raises(
            ValueError, match='no study.json; a study begins in an empty '
            'directory, so that it replaces no other files'):
        small(replicas=1, length=0.1).run(str(tmp_path), quiet=True)
    assert os.listdir(tmp_path) == ['results.csv']
    with pytest.raises(ValueError, match='jobs: got 0'):
        small(replicas=1, length=0.1).run(str(tmp_path/'study'), jobs=0)
    assert not (tmp_path/'study').exists()


@pytest.mark.parametrize('name', ['task.h5', 'study.json'])
def test_a_full_disk_is_named_and_loses_nothing(name, undisturbed, tmp_path, capfd):
    """The limit on the size of files stands for the disk."""
    path = str(tmp_path/name)
    content = taskfiles.load(undisturbed.tasks[0].path)

    def write():
        if name == 'study.json':
            taskfiles.write(path, b'x'*10000)
        else:
            taskfiles.save(path, content)

    write()
    before, limits = open(path, 'rb').read(), resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, limits[1]))
    try:
        with pytest.raises(OSError, match=f'{name}: it cannot be written .*before is kept'):
            write()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert open(path, 'rb').read() == before and os.listdir(tmp_path) == [name]
    assert capfd.readouterr() == ('', '')


def test_a_platform_that_is_not_there_is_named(tmp_path):
    study = ensemble.Study(SCENE, replicas=1, length=0.1, platform='Quantum')
    result = study.run(str(tmp_path/'study'), quiet=True)
    assert "platform 'Quantum': OpenMM has no platform of this name" in result.tasks[0].message


def test_a_study_that_is_damaged_or_missing(tmp_path):
    directory = tmp_path/'study'
    with pytest.raises(FileNotFoundError, match='so it is no study; give'):
        ensemble.read(directory)
    small(replicas=1, length=0.1).run(str(directory), quiet=True)
    about = (directory/'study.json').read_text()
    for text in (about[:200], '{}', json.dumps(dict(json.loads(about), seeds=None, definition=[]))):
        (directory/'study.json').write_text(text)
        with pytest.raises(ValueError,
                           match='study.json: it is damaged .*it must say what the study is'):
            ensemble.read(directory)
    (directory/'study.json').unlink()
    with pytest.raises(ValueError, match='it has tasks but no .*a study begins in an empty'):
        small(replicas=1, length=0.1).run(str(directory), quiet=True)


def test_another_study_in_the_directory_is_refused(tmp_path):
    directory = str(tmp_path/'study')
    small(replicas=2, length=0.2).run(directory, quiet=True)
    with pytest.raises(ValueError,
                       match='its study has seed 1, and this one 2; it must be the same'):
        small(replicas=2, length=0.2, seed=2).run(directory, extend=True, quiet=True)
    with pytest.raises(ValueError, match='nothing that is there may be left out'):
        small(replicas=1, length=0.2).run(directory, extend=True, quiet=True)
    with pytest.raises(ValueError, match='only an extension may change it: say extend=True'):
        small(replicas=3, length=0.2).run(directory, quiet=True)


def test_two_processes_do_not_run_one_study(tmp_path):
    directory = str(tmp_path/'study')
    study = small(replicas=1, length=0.2)
    study.run(directory, quiet=True)
    with studyModule._locked(directory):
        with pytest.raises(RuntimeError, match='another process runs this study at the moment'):
            study.run(directory, quiet=True)


def test_a_scene_that_has_changed_is_noticed(tmp_path, marks):
    directory = str(tmp_path/'study')
    study = ensemble.Study('ensemble_tasks:otherScene', replicas=1, length=1.0,
                           observables=['potential_energy'], platform='Reference')
    study.run(directory, quiet=True)
    (marks/'changed').touch()
    result = study.extended(length=2.0).run(directory, extend=True, quiet=True)
    assert 'makes another System or integrator now than when' in result.tasks[0].message
    assert result.tasks[0].samples == 20


def test_a_worker_that_does_not_see_the_directory(tmp_path):
    study, directory = small(replicas=1), str(tmp_path/'study')
    study.run(directory, quiet=True)
    larger = study.extended(length=4.0)
    about = studyModule._read_about(directory)
    task, = larger._left(directory, about)[0]
    task.study = 'another'
    outcome, = tasks.run(studyModule.simulate, [task], quiet=True)
    assert (outcome.failure.kind == 'FileNotFoundError'
            and 'it does not see the study in' in outcome.failure.message)


@pytest.mark.parametrize(
    'wrong, text',
    [(dict(scene='nothing'), 'module:function, a function or a Scene'),
     (dict(scene='nowhere:nothing'), 'which cannot be imported'),
     (dict(scene='__main__:nothing'), 'it was defined in a script'),
     (dict(observables=[]), 'give one or more, none of them twice'),
     (dict(observables=['potential_energy']*2), 'give one or more, none of them twice'),
     (dict(replicas=0), 'replicas: got 0; it must be a whole number, at least'),
     (dict(replicas=1.5), 'replicas: got 1.5; it must be a whole number, at least'),
     (dict(seed=-1), 'seed: got -1; it must be a whole number, at least'),
     (dict(length=None), 'it must be a finite time above 0, in ps'),
     (dict(length=math.inf), 'it must be a finite time above 0, in ps'),
     (dict(checkpointInterval=-1), 'it must be a finite time above or at 0, in s'),
     (dict(settings=[]), 'the list is empty; at least one dict is needed'),
     (dict(settings=[{
         'size': 3
     }]), "got 'size', which the scene trap does not have"),
     (dict(settings=[{
         'bodies': 3
     }]*2), 'is there already; settings must differ')])
def test_wrong_studies_are_refused(wrong, text):
    with pytest.raises(ValueError, match=text):
        ensemble.Study(**{'scene': 'trap', 'length': 1.0, **wrong})


@pytest.mark.parametrize('name', ['time/box', '.', '', 'a\0b'])
def test_names_that_files_cannot_have_are_refused(name):
    observable = accuracy.Observable(name, 'time', 'ps', ensemble_tasks.energy)
    with pytest.raises(ValueError, match='it must be a text without / and other than'):
        ensemble.Study('trap', length=1.0, observables=[observable])


def test_settings_must_be_what_json_takes():
    with pytest.raises(TypeError, match='a number, a text, a truth value or a list'):
        ensemble.Study('trap', [{'bodies': {1, 2}}], length=1.0)
