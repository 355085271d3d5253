#!/usr/bin/python3
"""What fluids along no-slip walls cost beside the same scene in a periodic box, in one run.

The scenes are those of growth.py: boomerangs of 15 blobs in layers, under TrapezoidalSlip, matrix-
free at a tolerance of 1e-3, on one thread. Of each model the rows are steps with the boundary
Periodic and with walls across z, and the ratio of both. Times are the process's own.

    PYTHONPATH=build/python /usr/bin/python3 benchmarks/confined.py
"""
import argparse
import json
import pathlib

import growth  # before numpy: it sets the number of threads of BLAS
import tqdm
from common import RESULTS, describeMachine, save

NUMBERS = (1000, 3000, 10000, 30000, 100000)
# yapf: disable
SERIES = (
    ('ForceCoupling', ('Periodic', 'SlipChannel', 'NoSlipChannel', 'PeriodicWall', 'Film')),
    ('RotnePragerYamakawa', ('NoSlipWall', 'Periodic', 'NoSlipChannel', 'PeriodicWall')),
)
# yapf: enable


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--limit', type=float, default=20, help='seconds of a step, at most')
    parser.add_argument('--seconds', type=float, default=1, help='of steps for each time')
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    arguments = parser.parse_args()
    result = {'tolerance': growth.TOLERANCE, 'limit_seconds': arguments.limit, 'series': []}
    machine = describeMachine()
    progress = tqdm.tqdm(total=sum(len(boundaries) for _, boundaries in SERIES)*len(NUMBERS))
    for model, boundaries in SERIES:
        for boundary in boundaries:
            rows = []
            for number in NUMBERS:
                progress.update()
                if rows and rows[-1]['seconds']*(number/rows[-1]['number'])**1.3 > arguments.limit:
                    continue
                rows.append(
                    growth.measure('blobs', model, boundary, 'MatrixFree', number,
                                   arguments.seconds))
            result['series'].append({
                'model': model,
                'boundary': boundary,
                'exponent': growth.exponent(rows, 'MatrixFree'),
                'rows': rows
            })
            save(arguments.output, 'confined.json', machine, result)
    print(json.dumps(result, indent=1))


if __name__ == '__main__':
    main()
