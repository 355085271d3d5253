#!/usr/bin/env python3
"""Draw the report of a GPU: nanoseconds a day of water boxes, and times of products.

    python3 benchmarks/gpu_picture.py benchmarks/results/gpu.json benchmarks/results/gpu.png
"""
import argparse
import json
import pathlib

import matplotlib

matplotlib.use('Agg')
from matplotlib import pyplot  # noqa: E402

COLOURS = {'host': '#d08a3c', 'device': '#2a6f97', '': '#8a8a8a'}


def nameOf(row):
    """A method as a label."""
    where = {'device': ', bodies on the device', 'host': ', bodies on the host'}
    mass = row.get('mass_of_hydrogens')
    heavy = f', H of {mass:g} Da' if isinstance(mass, (int, float)) else ''
    moments = f', moments x {row["moments_times"]:g}' if row['moments_times'] != 1 else ''
    return (f'{row["method"]} {row["step_fs"]:g} fs{heavy}{moments}' +
            where.get(row['bodies_asked_for'], ''))


def drawWater(axes, rows):
    """Bars of ns/day, one for each method."""
    rows = [row for row in rows if not row.get('failed') and row.get('steps_by')]
    speeds = [row['steps_by']['calls of 1000']['ns_per_day'] for row in rows]
    axes.barh(range(len(rows)), speeds, color=[COLOURS[row['bodies_asked_for']] for row in rows])
    axes.set_yticks(range(len(rows)), [nameOf(row) for row in rows], fontsize=8)
    axes.invert_yaxis()
    for k, speed in enumerate(speeds):
        axes.text(speed, k, f' {speed:.0f}', va='center', fontsize=8)
    axes.set_xlim(0, 1.15*max(speeds))
    axes.set_xlabel('ns/day')
    axes.set_title(f'{rows[0]["particles"]:,} particles of water (PME)', fontsize=10)


def drawProducts(axes, rows, boundary):
    """Times of products against the number of particles."""
    styles = {
        ('spheres, all pairs', 'host'): ('o-', 'host, all pairs'),
        ('spheres, multipoles', 'host'): ('s--', 'host, multipoles'),
        ('spheres, all pairs', 'device'): ('o-', 'device, all pairs')
    }
    for (kind, place), (style, label) in styles.items():
        chosen = [
            row for row in rows if row['kind'] == kind and row['place'] == place
            and row['boundary'] == boundary and row.get('product')
        ]
        if chosen:
            axes.loglog([row['particles'] for row in chosen],
                        [row['product']['milliseconds']['median'] for row in chosen], style,
                        color=COLOURS[place], label=label)
    axes.set_xlabel('spheres')
    axes.set_ylabel('ms of a product')
    where = {'Unbounded': 'unbounded fluid', 'NoSlipWall': 'above a wall'}[boundary]
    axes.set_title(f'Mobility times forces and torques, {where}', fontsize=10)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n', maxsplit=1)[0])
    parser.add_argument('report', type=pathlib.Path)
    parser.add_argument('picture', type=pathlib.Path)
    options = parser.parse_args()
    report = json.loads(options.report.read_text(encoding='utf-8'))
    figure, axes = pyplot.subplots(2, 2, figsize=(13, 8), constrained_layout=True)
    sizes = sorted({row['particles'] for row in report['water']})[-2:]
    for place, particles in zip(axes[0], sizes):
        drawWater(place, [row for row in report['water'] if row['particles'] == particles])
    for place, boundary in zip(axes[1], ('Unbounded', 'NoSlipWall')):
        drawProducts(place, report['products'], boundary)
    gpus = ', '.join(gpu['name'] for gpu in report['machine'].get('gpus', []))
    figure.suptitle(
        f'{gpus}; {report["machine"]["cores"]} cores of {report["machine"]["processor"]}; '
        f'OpenMM {report["machine"]["openmm"]}')
    figure.savefig(options.picture, dpi=110)


if __name__ == '__main__':
    main()
