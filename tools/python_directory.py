"""Say where below a prefix the Python package is to be installed, and how Python finds it there.

Usage: python_directory.py [--advise] PREFIX

Without --advise, prints the directory relative to the prefix. It is the first directory below the
prefix where this Python looks for packages. If there is none and the prefix is a virtual
environment, it is the environment's directory for packages. Otherwise it is Debian's
lib/python3/dist-packages.
"""
import os
import sys

DEFAULT = os.path.join('lib', 'python3', 'dist-packages')


def package_directory(prefix):
    """The directory relative to the prefix, and whether a Python finds packages there by itself."""
    below = [
        os.path.relpath(path, prefix) for path in sys.path
        if path.startswith(os.path.join(prefix, 'lib', '')) and path.endswith('-packages')
    ]
    if below:
        return below[0], True
    if os.path.exists(os.path.join(prefix, 'pyvenv.cfg')):
        version = f'python{sys.version_info[0]}.{sys.version_info[1]}'
        return os.path.join('lib', version, 'site-packages'), True
    return DEFAULT, False


def main(arguments):
    advise = arguments[:1] == ['--advise']
    prefix = os.path.abspath(arguments[-1])
    directory, found = package_directory(prefix)
    if not advise:
        print(directory)
        return
    print(f'Installed the Python package into {os.path.join(prefix, directory)}')
    print(f'and headers into {os.path.join(prefix, "include", "openmmrigidhi")}.')
    if not found:
        print(f'Python does not look there by itself. To use it:\n    export '
              f'PYTHONPATH={os.path.join(prefix, directory)}')


main(sys.argv[1:])
