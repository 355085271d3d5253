#!/usr/bin/env python3
"""How the fast variant of the potential differs from the formula: cost, energy, forces, averages.

    python3 compare_potentials.py [--frames 40] [--threads 1 2] [--cluster ADDRESS]

Writes results/potentials.json. Frames, 0.5 ps apart, come from a run of the fast variant with
OpenMM's own integrator (SETTLE), so the plugin is not needed. Averages under the formula follow
from averages under the fast variant to first order, <A>_exact - <A>_fast = -cov(A, U_exact -
U_fast)/kT. run.py records the same for every production run.
"""
import argparse
import json
import os
import pathlib
import time

for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

import numpy as np  # noqa: E402
import openmm as mm  # noqa: E402

import observables  # noqa: E402
import run  # noqa: E402
import tip4p_model as tip4p  # noqa: E402
from run import campaign  # noqa: E402


def seconds_per_force_call(n, positions, potential, threads):
    context = tip4p.make_context(n, mm.VerletIntegrator(0.001), potential, threads=threads)
    context.setPositions(positions)
    evaluate = lambda: context.getState(getForces=True, groups={0})
    evaluate()
    calls = 100 if potential == "fast" else 10
    began = time.perf_counter()
    for _ in range(calls):
        evaluate()
    return (time.perf_counter() - began)/calls


def differences(argument, job, start):
    """Energy difference of each frame, mean squares of force and torque and of their differences.

    main() names the entries.
    """
    n, frames = argument
    integrator = tip4p.make_integrator(n, "SETTLE", 2.0, seed=77)
    fast = tip4p.make_context(n, integrator)
    fast.setPositions(start)
    fast.setVelocitiesToTemperature(tip4p.TEMPERATURE, 77)
    fast.getState(getForces=True)
    exact = tip4p.make_context(n, mm.VerletIntegrator(0.001), "exact")
    offset = tip4p.fast_energy_offset(n)
    energy = lambda context: context.getState(getEnergy=True, groups={0}).getPotentialEnergy(
    )._value
    state = campaign.State(job, n)
    kept = state.load()
    rows = list(kept.get("rows", ()))
    if kept:
        fast.loadCheckpoint(kept["checkpoint"].tobytes())
    while len(rows) < frames:
        integrator.step(250)
        positions = fast.getState(getPositions=True).getPositions(asNumpy=True)
        exact.setPositions(positions)
        forces, torques = zip(*(observables.body_forces_and_torques(c, c.getIntegrator())
                                for c in (fast, exact)))
        square = lambda v: np.mean(np.sum(v**2, axis=1))
        rows.append([
            energy(fast) - offset - energy(exact),
            square(forces[0] - forces[1]),
            square(forces[1]),
            square(forces[0]),
            square(torques[0] - torques[1]),
            square(torques[1]),
            square(torques[0])
        ])
        job.report(len(rows))
        if state.isDue():
            state.save(rows=rows, checkpoint=campaign.checkpoint(fast))
    return rows


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--molecules", type=int, default=512)
    parser.add_argument("--frames", type=int, default=40)
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--start-file")
    parser.add_argument("--output", type=pathlib.Path, default=run.HERE/"results")
    campaign.addOptions(parser)
    options = campaign.settle(parser.parse_args())
    n = options.molecules
    options.output.mkdir(parents=True, exist_ok=True)
    start = run.start_positions(n, options.start_file or options.work/f"start_{n}.npz")
    cost = {
        f"{potential}, {threads} thread(s)":
        1e3*seconds_per_force_call(n, start, potential, threads)
        for potential in ("exact", "fast") for threads in options.threads
    }

    # Times above are of a process alone; all frames are one run.
    rows, = campaign.run(differences, [(n, options.frames)], ["potentials"], options,
                         [options.frames], "frame", "frames", given=start)
    rows = np.array(rows)
    mean, error = rows.mean(axis=0), rows.std(axis=0, ddof=1)/np.sqrt(len(rows))
    ratio = lambda a, b: {
        "mean": float(np.mean(rows[:, a])/np.mean(rows[:, b]) - 1),
        "standard_error": float(np.std(rows[:, a] - rows[:, b], ddof=1)/np.sqrt(len(rows))/mean[b])
    }
    result = {
        "molecules": n,
        "frames": options.frames,
        "milliseconds_per_force_call": cost,
        "energy_fast_minus_exact_kJ_per_mol_of_the_box": {
            "mean": float(mean[0]),
            "standard_error": float(error[0]),
            "standard_deviation": float(rows[:, 0].std(ddof=1))
        },
        "force_difference_rms_relative": float(np.sqrt(mean[1]/mean[2])),
        "torque_difference_rms_relative": float(np.sqrt(mean[4]/mean[5])),
        "mean_force_square_fast_over_exact_minus_1": ratio(3, 2),
        "mean_torque_square_fast_over_exact_minus_1": ratio(6, 5),
        "provenance": run.provenance()
    }
    with open(options.output/"potentials.json", "w") as file:
        json.dump(result, file, indent=1)
    print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
