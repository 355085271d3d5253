"""Follow the recipes of CONTRIBUTING.md in a copy of the sources, and test the result.

`make recipes` runs this script. The pages' code blocks are written where the page says, and the
copy is built. The tests that run over all schemes and models must pass with the new ones on both
platforms. Then every recipe's example is spoiled as its page says, and a test must notice:
otherwise no test had checked it. Averages over many steps (ctest's label quick-statistics) are left
to `make test`: shorter tests run the new schemes and models too. The copy and its build stay in
build/recipes, so that the next run builds only what changed.

A page says in comments, which readers do not see, what a recipe does. Before a code block, which
may not be empty:
    <!-- recipe: create FILE -->
        the block is the file
    <!-- recipe: add to the list MACRO in FILE -->
        lines at the end of a macro: the line before them gets its backslash
    <!-- recipe: in FILE before TEXT -->
        the block goes before the one line of the file that has this text; likewise `after`, and
        `in place of` for a block that takes the place of the line
Anywhere:
    <!-- recipe: test NAME NAME -->
        test programs, as files in tests/unit, tests/platform or tests/device are named, that must
        pass
    <!-- recipe: pytest FILE FILE -->
        tests in Python that must pass
    <!-- recipe: python EXPRESSION -->
        is true after `from openmmrigidhi import *`
    <!-- recipe: spoil FILE: OLD -> NEW, seen by NAME -->
        with this replacement the test program must fail, on both platforms
"""
import argparse
import difflib
import os
import pathlib
import re
import shutil
import subprocess
import sys
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
PAGES = ('CONTRIBUTING.md',
         *sorted(str(page.relative_to(ROOT)) for page in (ROOT/'tests/recipes').glob('*.md')))
# Within the copy, as in the repository: a compiler cache then finds what is the same.
BUILD = 'build'
RUNTIME = ('OpenMMRigidHIReference', 'OpenMMRigidHICPU', 'OpenMMRigidHIAny', 'RigidHIPythonPackage')


class RecipeError(Exception):
    """A recipe that cannot be followed, or does not do what it promises."""


def tracked_files():
    """The files of the repository, and new files that are not ignored: path -> bytes."""
    listed = subprocess.run(['git', 'ls-files', '-z', '--cached', '--others', '--exclude-standard'],
                            cwd=ROOT, check=True, capture_output=True).stdout.decode().split('\0')
    return {name: (ROOT/name).read_bytes() for name in listed if name and (ROOT/name).is_file()}


class Recipes:
    """The changes that all recipes of all pages make to the sources."""
    def __init__(self, files):
        self.files = files
        self.programs, self.python_tests, self.expressions, self.spoils = [], [], [], []
        self.steps = 0

    def follow(self, page):
        text = self.text(page)
        for found in re.finditer(r'^<!-- recipe: (.*?) -->\n(?:```\w+\n(.*?)^```$)?', text,
                                 flags=re.S | re.M):
            try:
                self.do(' '.join(found[1].split()), found[2])
            except RecipeError as error:
                raise RecipeError(
                    f'{page}, line {text.count(chr(10), 0, found.start()) + 1}: {error}') from None
            self.steps += 1
        if text.count('<!-- recipe:') != len(
                re.findall(r'^<!-- recipe: .*? -->$', text, flags=re.S | re.M)):
            raise RecipeError(
                f'{page}: a comment that begins with "recipe:" must be alone on its lines')

    def text(self, name):
        if name not in self.files:
            raise RecipeError(f'there is no {name}')
        return self.files[name].decode()

    def do(self, step, block):
        verbs = ((r'create (\S+)', self.create), (r'add to the list (\S+) in (\S+)',
                                                  self.add_to_list),
                 (r'in (\S+) (before|after|in place of) (.+)',
                  self.insert), (r'test (.+)', self.test), (r'pytest (.+)', self.pytest),
                 (r'python (.+)', self.python), (r'spoil (\S+): (.+) -> (.+), seen by (\S+)',
                                                 self.spoil))
        for pattern, action in verbs:
            words = re.fullmatch(pattern, step)
            if words is None:
                continue
            needs_block = action in (self.create, self.add_to_list, self.insert)
            if needs_block != (block is not None) or block == '':
                raise RecipeError(
                    f'"{step}" '
                    f'{"needs a code block after it" if needs_block else "takes no code block"}')
            action(*words.groups(), *([block] if needs_block else []))
            return
        raise RecipeError(f'"{step}" is no step; tools/follow_recipes.py lists them')

    def create(self, name, block):
        if name in self.files:
            raise RecipeError(f'{name} is there already')
        self.files[name] = block.encode()

    def add_to_list(self, macro, name, block):
        lines = self.text(name).split('\n')
        last = next((k for k, line in enumerate(lines) if line.startswith(f'#define {macro}(')),
                    None)
        if last is None:
            raise RecipeError(f'{name} has no list {macro}')
        while lines[last].endswith('\\'):
            last += 1
        lines[last] += ' \\'
        lines[last + 1:last + 1] = block.rstrip('\n').split('\n')
        self.files[name] = '\n'.join(lines).encode()

    def insert(self, name, where, text, block):
        lines = self.text(name).split('\n')
        places = [k for k, line in enumerate(lines) if text in line]
        if len(places) != 1:
            raise RecipeError(f'{len(places)} lines of {name} have "{text}", not one')
        at = places[0] + (where == 'after')
        end = at + (where == 'in place of')
        lines[at:end] = block[:-1].split('\n')
        self.files[name] = '\n'.join(lines).encode()

    def programs_of(self, name):
        if f'tests/unit/{name}.cpp' in self.files:
            return [name]
        if f'tests/platform/{name}.cpp' in self.files:
            return [name.replace('Test', 'Test' + platform, 1) for platform in ('Reference', 'CPU')]
        if f'tests/device/{name}.cpp' in self.files:
            return [name.replace('Test', 'TestOpenCL', 1)]
        raise RecipeError(f'there is no test program {name}')

    def test(self, names):
        for name in names.split():
            self.programs += [
                program for program in self.programs_of(name) if program not in self.programs
            ]

    def pytest(self, names):
        for name in names.split():
            self.text(name)
            self.python_tests.append(name)

    def python(self, expression):
        self.expressions.append(expression)

    def spoil(self, name, old, new, program):
        if self.text(name).count(old) != 1:
            raise RecipeError(f'{name} has "{old}" {self.text(name).count(old)} times, not once')
        self.spoils.append((name, old, new, self.programs_of(program)))


def formatter(name):
    """The command that formats a file of this name from its standard input, or None where there is
    not the formatter of Debian 12."""
    if name.endswith(('.h', '.cpp')):
        program, version = shutil.which('clang-format-14') or shutil.which('clang-format'), '14.'
        command = [program, f'--assume-filename={ROOT/name}']
    elif name.endswith('.py'):
        program, version, command = shutil.which('yapf3'), '0.32', ['yapf3']
    else:
        return None
    known = program and f' {version}' in subprocess.run([program, '--version'], capture_output=True,
                                                        text=True).stdout
    return command if known else None


def unformatted(files, before):
    """What `make format` would change in the files that the recipes made or changed: lines.

    The backslashes of lists are left to it, because their column depends on all lines.
    """
    found = []
    for name, content in files.items():
        command = formatter(name) if content != before.get(name) else None
        if command is None:
            continue
        formatted = subprocess.run(command, input=content, cwd=ROOT, check=True,
                                   capture_output=True).stdout
        was, wanted = (re.sub(r' +\\\n', '\n', text.decode()).splitlines()
                       for text in (content, formatted))
        found += difflib.unified_diff(was, wanted, name, name, 'as the page says',
                                      'as make format would have it', n=0, lineterm='')
    return found


def write_copy(files, folder):
    """Make the folder hold these files and no others, except for its build.

    A file that is the same is not written, since it would be compiled again.
    """
    for path in folder.rglob('*'):
        name = path.relative_to(folder)
        if path.is_file() and name.parts[0] != BUILD and str(name) not in files:
            path.unlink()
    for name, content in files.items():
        path = folder/name
        if path.exists() and path.read_bytes() == content:
            continue
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
        path.chmod((ROOT/name).stat().st_mode if (ROOT/name).exists() else 0o644)


class Copy:
    """The copy of the sources and its build."""
    def __init__(self, folder, python, jobs):
        self.sources, self.build, self.python, self.jobs = folder, folder/BUILD, python, str(jobs)

    def run(self, what, command, **settings):
        start = time.monotonic()
        print(f'-- {what}', flush=True)
        finished = subprocess.run(command, cwd=self.sources, text=True, stdout=subprocess.PIPE,
                                  stderr=subprocess.STDOUT, **settings)
        print(f'   {time.monotonic() - start:.0f} s', flush=True)
        return finished

    def must(self, what, command, **settings):
        finished = self.run(what, command, **settings)
        if finished.returncode != 0:
            print(finished.stdout[-12000:])
            raise RecipeError(f'{what}: failed')

    def configure(self):
        # The library is compiled for this one run of short tests, so -O1 and few instruction sets
        # take less time than a release.
        self.must('configure', [
            'cmake', '--preset', 'release', '-B',
            str(self.build), f'-DPython3_EXECUTABLE={self.python}',
            '-DCMAKE_CXX_FLAGS_RELEASE=-O1 -DNDEBUG -DRIGIDHI_FEW_SIMD_TARGETS'
        ])

    @staticmethod
    def programs_with(names):
        """The programs that have the tests of these names (tests/CMakeLists.txt)."""
        found = set()
        for name in names:
            platform = re.match('Test(Reference|CPU|OpenCL)[A-Z]', name)
            found.add(name if name.endswith('Allocations') else 'Test' +
                      (platform[1] if platform else 'Units'))
        return sorted(found)

    def make(self, targets):
        self.must(
            'build',
            ['cmake', '--build',
             str(self.build), '--parallel', self.jobs, '--target', *targets])

    def test(self, programs, *options):
        return self.run('run ' + ' '.join(programs), [
            'ctest', '--test-dir',
            str(self.build), '-L', 'quick', '-LE', 'statistics', '-R',
            rf'^({"|".join(programs)})\.', '--no-tests=error', '--output-on-failure', '--parallel',
            self.jobs, *options
        ])


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--folder', type=pathlib.Path, default=ROOT/'build/recipes',
                        help='folder of the copy and its build')
    parser.add_argument('--jobs', type=int, default=1)
    parser.add_argument('--check', action='store_true',
                        help='check only whether all steps can be followed; build nothing')
    arguments = parser.parse_args(argv)
    before = tracked_files()
    recipes = Recipes(dict(before))
    for page in PAGES:
        recipes.follow(page)
    bad = unformatted(recipes.files, before)
    if bad:
        raise RecipeError(
            '`make format` would format the code blocks of the pages in another way:\n' +
            '\n'.join(bad))
    if not recipes.spoils:
        raise RecipeError('no page has a recipe')
    print(f'-- followed {recipes.steps} steps on {len(PAGES)} pages')
    if arguments.check:
        return

    copy = Copy(arguments.folder.resolve(), sys.executable, arguments.jobs)
    write_copy(recipes.files, copy.sources)
    copy.configure()
    copy.make([*RUNTIME, *copy.programs_with(recipes.programs)])
    for expression in recipes.expressions:
        copy.must(f'Python: {expression}', [
            sys.executable, '-c', f'import sys; sys.path.insert(0, sys.argv[1])\n'
            f'from openmmrigidhi import *\nassert {expression}',
            str(copy.build/'python')
        ])
    if recipes.python_tests:
        copy.must(
            'run ' + ' '.join(recipes.python_tests),
            [sys.executable, '-m', 'pytest', '-q', '-p', 'no:cacheprovider', *recipes.python_tests],
            env={
                **os.environ, 'PYTHONPATH': str(copy.build/'python')
            })
    finished = copy.test(recipes.programs)
    if finished.returncode != 0:
        print(
            re.sub(r'^ *(Start +\d+:|\d+/\d+ Test .* Passed ).*\n', '', finished.stdout,
                   flags=re.M)[-12000:])
        raise RecipeError('the tests fail with what the recipes made')

    spoiled = dict(recipes.files)
    for name, old, new, _ in recipes.spoils:
        spoiled[name] = spoiled[name].decode().replace(old, new).encode()
    write_copy(spoiled, copy.sources)
    seen_by = [program for *_, programs in recipes.spoils for program in programs]
    copy.make([*RUNTIME[:2], *copy.programs_with(seen_by)])
    unseen = [
        program for program in seen_by if copy.test([program], '--stop-on-failure').returncode == 0
    ]
    write_copy(recipes.files, copy.sources)
    if unseen:
        raise RecipeError('these tests do not notice that the example is spoiled: ' +
                          ', '.join(unseen))
    print('All recipes work.')


if __name__ == '__main__':
    try:
        main()
    except RecipeError as error:
        sys.exit(f'follow_recipes.py: {error}')
