"""Longer steps in water with scaled moments of inertia: the measurement of results_inertia/.

LangevinC runs with the real moments and with 4, 8 and 16 times these (setInertiaScale), up to steps
where the energy fails. The results are compared with the limit of small steps of
results/results.json. Further options are passed on, e.g. ``--budget 600 --output mine``.
"""
import pathlib
import sys

from openmmrigidhi.accuracy import cli

HERE = pathlib.Path(__file__).resolve().parent
sys.path.append(str(HERE.parents[1]/'common'))
import campaign  # noqa: E402

ARGUMENTS = [
    '--scene', 'water', '--bodies', '216', '--temperature', '298.15', '--gamma', '5', '--Gamma',
    '10', '--seed', '2028', '--methods', 'LangevinC:4,9,10', 'LangevinC-I4:9,12,14',
    'LangevinC-I8:12,14,16', 'LangevinC-I16:15,16', '--reference',
    'potential_energy=-46.498+-0.042', '--wanted-error', 'potential_energy:0.5%', '--baseline',
    'LangevinC', '--threads', '1', '--clock', 'cpu', '--rounds', '10', '--budget', '1100',
    '--output',
    str(HERE/'results_inertia')
]

if __name__ == '__main__':
    # Of two equal options, the last counts.
    arguments = ARGUMENTS + sys.argv[1:]
    status = cli.main(arguments)
    campaign.keepPictures(cli.parser().parse_args(arguments).output, 'error_potential_energy.png')
    sys.exit(status)
