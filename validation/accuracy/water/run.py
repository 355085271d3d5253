"""What accuracy costs for TIP4P-Ew water: the measurement in results/, made again.

Further options are passed on, e.g. ``--budget 600 --output mine``. See ``python3 -m
openmmrigidhi.accuracy --help``.
"""
import pathlib
import sys

from openmmrigidhi.accuracy import cli

HERE = pathlib.Path(__file__).resolve().parent
sys.path.append(str(HERE.parents[1]/'common'))
import campaign  # noqa: E402

ARGUMENTS = [
    '--scene', 'water', '--bodies', '216', '--temperature', '298.15', '--gamma', '5', '--Gamma',
    '10', '--seed', '2026', '--methods', 'LangevinC:1,2,3,4,5,6,7,8,9,10,11', 'LangevinB:2,4,6,8',
    'LangevinMiddle:1,2,3,4,5,6,7,8,9', '--wanted-error', 'potential_energy:0.5%', '--threads', '1',
    '--clock', 'cpu', '--budget', '3450', '--price', 'potential_energy:0.5%', '--output',
    str(HERE/'results')
]

if __name__ == '__main__':
    # Of two equal options, the last counts.
    arguments = ARGUMENTS + sys.argv[1:]
    status = cli.main(arguments)
    campaign.keepPictures(cli.parser().parse_args(arguments).output, 'error_potential_energy.png',
                          'price_potential_energy_0.5pc.png')
    sys.exit(status)
