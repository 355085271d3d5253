"""What scripts share: provenance of results, JSONs, pictures, tables, numbers with errors."""
import argparse
import hashlib
import json
import os
import pathlib
import platform
import subprocess
import sys
import time

import numpy as np
import openmm

import openmmrigidhi
from openmmrigidhi.accuracy._results import json_text

HERE = pathlib.Path(__file__).resolve().parent


def provenance(arguments=None):
    """Machine, versions, commit, checksum of the plugin, command line, date."""
    def command(*words):
        try:
            return subprocess.run(words, cwd=HERE, capture_output=True, text=True,
                                  check=True).stdout.strip()
        except (OSError, subprocess.CalledProcessError):
            return 'unknown'

    processor = 'unknown'
    if os.path.exists('/proc/cpuinfo'):
        with open('/proc/cpuinfo') as file:
            processor = next((line.split(':', 1)[1].strip()
                              for line in file if line.startswith('model name')), processor)
    libraries = sorted(
        (pathlib.Path(openmmrigidhi.__file__).parent/'lib').rglob('libOpenMMRigidHI*.so'))
    digest = hashlib.sha256(b''.join(
        path.read_bytes() for path in libraries)).hexdigest()[:16] if libraries else 'unknown'
    return {
        'script': pathlib.Path(sys.argv[0]).name,
        'arguments': {
            k: str(v)
            for k, v in vars(arguments or object).items()
            if k not in ('output', 'work', 'cluster', '__dict__', '__doc__')
        } if arguments else {},
        'processor': processor,
        'cores': os.cpu_count(),
        'load': os.getloadavg(),
        'system': platform.platform(),
        'python': platform.python_version(),
        'numpy': np.__version__,
        'openmm': openmm.version.version,
        'plugin_sha256': digest,
        'commit': command('git', 'rev-parse', 'HEAD'),
        'date': time.strftime('%Y-%m-%dT%H:%M:%SZ', time.gmtime())
    }


def plain(value):
    """Numbers and arrays as json writes them, rounded to the digits that a measurement can have."""
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, (np.bool_, bool)):
        return bool(value)
    if isinstance(value, np.integer):
        return int(value)
    if isinstance(value, (float, np.floating)):
        return float(f'{value:.12g}')
    return value


def save(folder, name, data):
    """Write a JSON, with numbers of 12 digits, and each list of numbers on one line."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder/name).write_text(json_text(plain(data)))
    print(f'wrote {folder/name}')


def pyplot():
    """matplotlib.pyplot, set to draw into files."""
    import matplotlib
    matplotlib.use('Agg')
    import matplotlib.pyplot as plt
    return plt


def brackets(value, error):
    """A value with its error in brackets: 1.2345 with error 0.0012 is 1.2345(12)."""
    if not (np.isfinite(error) and error > 0):
        return f'{value:.6g}'
    digits = max(0, 1 - int(np.floor(np.log10(error))))
    return f'{value:.{digits}f}({round(error*10**digits)})'


def printTables(description, results, tables):
    """The command line of a report: print in Markdown the tables for which there are results.

    Parameters
    ----------
    description : str
        of the command line
    results : pathlib.Path
        where the JSONs are, unless --input names another folder
    tables : sequence of (str, callable)
        pattern of the names of JSONs, and a generator of the lines of their table
    """
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument('--input', type=pathlib.Path, default=results)
    folder = parser.parse_args().input
    for pattern, table in tables:
        for path in sorted(folder.glob(pattern)):
            print(f'\n**{path.stem}**\n')
            print('\n'.join(table(json.loads(path.read_text()))))
