"""What accuracy costs for TIP4P-Ew water: the measurement in results/, made again.

Further options are passed on, e.g. ``--budget 600 --output mine``. See ``python3 -m
openmmrigidhi.accuracy --help``.
"""
import os
import sys

from openmmrigidhi.accuracy import cli

ARGUMENTS = [
    '--scene', 'water', '--bodies', '216', '--temperature', '298.15', '--gamma', '5', '--Gamma',
    '10', '--seed', '2026', '--methods', 'LangevinC:1,2,3,4,5,6,7,8,9,10,11', 'LangevinB:2,4,6,8',
    'LangevinMiddle:1,2,3,4,5,6,7,8,9', '--wanted-error', 'potential_energy:0.5%', '--threads', '1',
    '--clock', 'cpu', '--budget', '3450', '--output',
    os.path.join(os.path.dirname(os.path.abspath(__file__)), 'results')
]

if __name__ == '__main__':
    # Of two equal options, the last counts.
    sys.exit(cli.main(ARGUMENTS + sys.argv[1:]))
