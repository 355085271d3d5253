#!/usr/bin/env python3
"""Check a wheel of openmm-rigidhi: its metadata, its files, and what its libraries are linked with.

The wheel must need the one series of OpenMM for which it was compiled. It must have all files of
the Python package, and no path of the machine that built it. Its libraries must look for others
only relative to themselves, and need only libraries that this script can explain. Then the wheel
is installed into a new virtual environment that sees the system's packages, and the first script
of README.md runs there, outside of the source tree.

Example
-------
OPENMM_DIR=/opt/openmm pip wheel --no-deps --no-build-isolation --wheel-dir build/wheels .
tools/check_wheel.py build/wheels/openmm_rigidhi-*.whl
"""
import argparse
import email
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import zipfile

ROOT = pathlib.Path(__file__).resolve().parents[1]
PACKAGE = 'openmmrigidhi'

#: Libraries of the compiler and the C library, which every library may need.
COMPILERS = r'lib(stdc\+\+|m|gcc_s|c|pthread|dl)\.so\.\d+|ld-linux.*\.so\.\d+'
#: Regular expressions of the other libraries, with what they are for.
NUMERICS = {
    r'libopenblas(p.*)?\.so(\.\d+)?': 'linear algebra',
    r'libfftw3f?\.so\.\d+': 'Fourier transforms',
    r'libmuparser\.so\.[\d.]+': 'expressions of users',
    r'libhwy\.so\.[\d.]+': 'dispatch by instruction set'
}
OPENMM = {r'libOpenMM\.so(\.[\d.]+)?': 'OpenMM'}
API = {r'libOpenMMRigidHI\.so': "this package's API"}
DEVICES = {
    'OpenCL': {
        r'libOpenCL\.so\.\d+': 'OpenCL'
    },
    'CUDA': {
        r'lib(cuda|nvrtc|cufft)\.so(\.[\d.]+)?': 'CUDA'
    },
    'HIP': {
        r'lib(amdhip64|hiprtc|hipfft)\.so(\.[\d.]+)?': 'HIP'
    }
}
#: What a library may need, by its name: the glue to OpenMM needs OpenMM only.
EXPECTED = {
    f'_{PACKAGE}.so': OPENMM | API,
    'libOpenMMRigidHI.so': OPENMM,
    'libOpenMMRigidHIReference.so': OPENMM | API | NUMERICS,
    'libOpenMMRigidHICPU.so': OPENMM | API | NUMERICS,
    'libOpenMMRigidHIAny.so': OPENMM | API | NUMERICS
}
for platform, software in DEVICES.items():
    EXPECTED[f'libOpenMMRigidHI{platform}.so'] = OPENMM | API | NUMERICS | software | {
        rf'libOpenMM{platform}\.so': f"OpenMM's platform {platform}"
    }
#: Libraries that a wheel has on every machine.
EVERYWHERE = [name for name in EXPECTED if not name.endswith(tuple(f'{d}.so' for d in DEVICES))]


def dynamic_section(listing):
    """What a library needs, and where it looks for it.

    Parameters
    ----------
    listing : str
        what `readelf -d` prints of it

    Returns
    -------
    dict
        'needed' and 'path', lists of str
    """
    entries = re.findall(r'\((NEEDED|RUNPATH|RPATH)\).*\[(.*)\]', listing)
    return {
        'needed': [value for key, value in entries if key == 'NEEDED'],
        'path': [p for key, value in entries if key != 'NEEDED' for p in value.split(':')]
    }


def explain(name, needed):
    """What a library needs another one for; None if it should not need it."""
    if re.fullmatch(COMPILERS, needed):
        return 'compiler, C library'
    for pattern, purpose in EXPECTED.get(name, {}).items():
        if re.fullmatch(pattern, needed):
            return purpose
    return None


def faults_of_library(name, section):
    """Faults of a library's dynamic section, as sentences."""
    faults = [] if name in EXPECTED else [f'{name} is not a library of this package']
    faults += [
        f'{name} needs {needed}, which it should not' for needed in section['needed']
        if explain(name, needed) is None
    ]
    faults += [
        f'{name} looks in {place}, which is not relative to it' for place in section['path']
        if not re.match(r'\$ORIGIN(/|$)', place)
    ]
    return faults


def series_of_metadata(metadata):
    """The series of OpenMM that a wheel needs, '8.1' say; None if it does not need exactly one."""
    needs = [need.replace(' ', '') for need in metadata.get_all('Requires-Dist', [])]
    needs = [need for need in needs if re.match(r'openmm\b', need)]
    bounds = sorted(needs[0][len('openmm'):].strip('()').split(',')) if len(needs) == 1 else []
    found = [re.fullmatch(r'(<|>=)(\d+)\.(\d+)', bound) for bound in bounds]
    if len(found) != 2 or None in found or [match[1] for match in found] != ['<', '>=']:
        return None
    (_, major, minor), (_, first, second) = (match.groups() for match in found)
    return f'{first}.{second}' if (major, int(minor)) == (first, int(second) + 1) else None


def faults_of_files(names, source=ROOT):
    """Faults of the list of files of a wheel."""
    folder = source/'python'/PACKAGE
    expected = {
        f'{PACKAGE}/{path.relative_to(folder).as_posix()}'
        for pattern in ('*.py', '*.html', 'py.typed') for path in folder.rglob(pattern)
    }
    expected |= {
        f'{PACKAGE}/{name}'
        for name in ('_bindings.py', '_bindings.pyi', '_enumerations.pyi', f'_{PACKAGE}.so',
                     'lib/libOpenMMRigidHI.so')
    }
    expected |= {f'{PACKAGE}/lib/plugins/{name}' for name in EVERYWHERE[2:]}
    faults = [f'{name} is missing' for name in sorted(expected - set(names))]
    allowed = expected | {
        f'{PACKAGE}/lib/plugins/libOpenMMRigidHI{platform}.so'
        for platform in DEVICES
    }
    return faults + [
        f'{name} should not be in the wheel' for name in sorted(set(names) - allowed)
        if not re.match(r'openmm_rigidhi-[\d.]+\.dist-info/', name)
    ]


def inspect(wheel):
    """Print what a wheel's libraries need.

    Returns
    -------
    str
        the series of OpenMM that the wheel needs
    list of str
        faults
    """
    version = re.search(r'project\(openmm-rigidhi VERSION ([0-9.]+)',
                        (ROOT/'CMakeLists.txt').read_text())[1]
    with zipfile.ZipFile(wheel) as archive, tempfile.TemporaryDirectory() as directory:
        names = [name for name in archive.namelist() if not name.endswith('/')]
        (record,) = (name for name in names if name.endswith('.dist-info/METADATA'))
        metadata = email.message_from_bytes(archive.read(record))
        series = series_of_metadata(metadata)
        print(f"{metadata['Name']} {metadata['Version']}, OpenMM {series}, {len(names)} files")
        faults = faults_of_files(names)
        if (metadata['Name'], metadata['Version']) != ('openmm-rigidhi', version):
            faults.append(f"the metadata name {metadata['Name']} {metadata['Version']}; they must "
                          f'name openmm-rigidhi {version}')
        if series is None:
            faults.append('the metadata do not need one series of OpenMM, as openmm>=8.1,<8.2')
        faults += [
            f'{name} contains the path {ROOT}' for name in names
            if str(ROOT).encode() in archive.read(name)
        ]
        for name in names:
            if not name.endswith('.so'):
                continue
            path = archive.extract(name, directory)
            section = dynamic_section(
                subprocess.run(['readelf', '-d', path], capture_output=True, text=True,
                               check=True).stdout)
            base = os.path.basename(name)
            print(f"{name}: looks in {' '.join(section['path']) or 'no directory of its own'}")
            for needed in section['needed']:
                print(f'    {needed}: {explain(base, needed)}')
            faults += faults_of_library(base, section)
    return series, faults


def first_script():
    """The first script of README.md."""
    return re.search('```python\n(.*?)```', (ROOT/'README.md').read_text(encoding='utf-8'),
                     flags=re.S)[1]


def try_out(wheel, series):
    """Install a wheel into a new virtual environment, import it, and run README's first script.

    Returns
    -------
    list of str
        faults
    """
    check = (f'import openmm, {PACKAGE}, sys\n'
             f'print({PACKAGE}.describe())\n'
             f'assert {PACKAGE}.__file__.startswith(sys.prefix), {PACKAGE}.__file__\n'
             "loaded = openmm.Platform.getOpenMMVersion().split('.')\n"
             f"assert loaded[:2] == {series!r}.split('.'), loaded\n")
    with tempfile.TemporaryDirectory() as directory:
        # Nothing but the environment tells Python where to look.
        environment = {
            key: value
            for key, value in os.environ.items()
            if key not in ('PYTHONPATH', 'OPENMM_DIR', 'OPENMM_PLUGIN_DIR')
        }
        place = pathlib.Path(directory)
        python = place/'environment'/'bin'/'python'
        steps = {
            'making the environment': [
                sys.executable, '-m', 'venv', '--system-site-packages', place/'environment'
            ],
            # With its dependencies, which the system has: pip refuses an OpenMM of another series.
            'installing': [
                python, '-m', 'pip', 'install', '--quiet', '--no-index',
                wheel.resolve()
            ],
            'importing': [python, '-c', check],
            'the first script of README.md': [python, '-c', first_script()],
            'openmmrigidhi-accuracy': [python.with_name('openmmrigidhi-accuracy'), '--help']
        }
        for name, command in steps.items():
            finished = subprocess.run(command, cwd=directory, env=environment, text=True,
                                      capture_output=True)
            print(f"{name}: {'passed' if finished.returncode == 0 else 'FAILED'}")
            if finished.returncode != 0:
                return [f'{name} failed: {finished.stdout}{finished.stderr}']
            if name == 'importing':
                print('    ' + finished.stdout.replace(directory, '...').replace('\n', '\n    '))
    return []


def main(arguments=None):
    """Returns the number of faults, which are printed."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('wheel', type=pathlib.Path, help='the wheel, a file *.whl')
    parser.add_argument('--only-look', action='store_true', help='do not install the wheel')
    options = parser.parse_args(arguments)
    series, faults = inspect(options.wheel)
    if not options.only_look:
        faults += try_out(options.wheel, series)
    for fault in faults:
        print(f'fault: {fault}')
    print(f'{len(faults)} faults')
    return len(faults)


if __name__ == '__main__':
    sys.exit(min(main(), 1))
