#!/usr/bin/env python3
"""Davidchack, Ouldridge, Tretyakov 2015, section VI, with this plugin: Figures 1-4 and Table 1.

    python3 run.py                     512 molecules, h = 2, 4, 6, 8 fs (gradient 1 to 4),
                                       60 000 steps each
    python3 run.py --jobs 2            two single-thread runs at once
    python3 run.py --paper             the paper's size: 1728 molecules, 20 000 + 200 000 steps,
                                       h = 1 ... 9 fs
    python3 run.py --schemes C --h 2   one run; runs that --work has are in the table, too, and an
                                       interrupted run goes on
    python3 run.py --report-only       table and pictures from the runs that --work has

Each run has a directory below --work; report.py then fits A0 and E_A and draws.
"""
import argparse
import os
import pathlib
import sys
import time

for _variable in ("OPENBLAS_NUM_THREADS",
                  "OMP_NUM_THREADS"):  # one thread a process; must precede numpy
    os.environ.setdefault(_variable, "1")

import numpy as np  # noqa: E402
import openmm as mm  # noqa: E402
from tqdm import tqdm  # noqa: E402

HERE = pathlib.Path(__file__).resolve().parent
sys.path.append(str(HERE.parent/"common"))
import campaign  # noqa: E402
import observables  # noqa: E402
import tip4p_model as tip4p  # noqa: E402
from recording import provenance  # noqa: E402

KINETIC_INTERVAL = 2  # steps between samples of kinetic energies
FORCE_INTERVAL = 10  # ... of forces and torques
PAIR_INTERVAL = 50  # ... of everything that needs pairs: energy, pressure, Laplacians, RDFs
BLOCKS = 60
GAMMA, BIG_GAMMA = 5.0, 10.0  # 1/ps
UPSILON, BIG_UPSILON = 4.0, 1.0  # fs
SCHEMES = ("C", "A", "B", "gradient")


def name(spec):
    """The name of a run, and of its directory."""
    return f"tip4p_{spec['scheme']}_h{spec['h_fs']:g}" + (f"_r{spec['replica']}"
                                                          if spec["replica"] else "")


def simulate(spec, start, job=None):
    """One run: equilibrate, measure, return a dictionary for JSON.

    spec: dictionary with scheme, h_fs, molecules, steps, equilibration_steps, seed, replica,
    potential, platform.
    start: positions (4 n, 3), nm.
    job: its directory keeps what another worker needs to go on.
    """
    n, steps = spec["molecules"], spec["steps"]
    integrator = tip4p.make_integrator(n, spec["scheme"], spec["h_fs"], GAMMA, BIG_GAMMA, UPSILON,
                                       BIG_UPSILON, spec["seed"])
    context = tip4p.make_context(n, integrator, spec["potential"], spec["platform"])
    context.setPositions(start)
    has_momenta = spec["scheme"] != "gradient"
    if has_momenta:
        context.setVelocitiesToTemperature(tip4p.TEMPERATURE, spec["seed"])
    began = time.time()
    sums = observables.PairSums(n)
    state = campaign.State(job, sorted(spec.items()))
    kept = state.load()
    kinetic, squares, pairs, rdf_counts = (list(kept.get(
        series, ())) for series in ("kinetic", "squares", "pairs", "rdf_counts"))
    block_steps = steps // BLOCKS
    stepping, first = 0.0, 1
    report = job.report if job is not None else lambda done: None
    if kept:
        context.loadCheckpoint(kept["checkpoint"].tobytes())
        stepping, began, first = float(
            kept["stepping"]), began - float(kept["seconds"]), int(kept["k"]) + 1
        sums.samples = int(kept["samples"])
        sums.counts = {kind: kept[f"counts_{kind}"] for kind in sums.counts}
    else:
        done = 0
        while done < spec["equilibration_steps"]:
            integrator.step(min(200, spec["equilibration_steps"] - done))
            done += 200
            report(done)
    kinds = list(sums.counts)
    for k in range(first, steps // KINETIC_INTERVAL + 1):
        clock = time.perf_counter()
        integrator.step(KINETIC_INTERVAL)
        stepping += time.perf_counter() - clock
        step = k*KINETIC_INTERVAL
        if has_momenta:
            kinetic.append(observables.kinetic_energies(context, integrator))
        if step % FORCE_INTERVAL == 0:
            force, torque = observables.body_forces_and_torques(context, integrator)
            squares.append((np.sum(force**2), np.sum(torque**2)))
        if step % PAIR_INTERVAL == 0:
            sample = sums.sample(
                context.getState(getPositions=True).getPositions(asNumpy=True)._value)
            pairs.append([sample[name] for name in observables.SCALARS])
            report(spec["equilibration_steps"] + step)
        if step % block_steps == 0:
            rdf_counts.append(np.array([sums.counts[kind] for kind in kinds]))
        if state.isDue():
            state.save(k=k, kinetic=kinetic, squares=squares, pairs=pairs, rdf_counts=rdf_counts,
                       stepping=stepping, seconds=time.time() - began, samples=sums.samples,
                       checkpoint=campaign.checkpoint(context),
                       **{f"counts_{kind}": counts
                          for kind, counts in sums.counts.items()})
    seconds = time.time() - began

    blocks = block_means(n, sums, np.array(kinetic), np.array(squares), np.array(pairs),
                         [dict(zip(kinds, counts)) for counts in rdf_counts])
    rdf = {}
    for kind, where in observables.RDF_POINTS.items():
        r, g = sums.rdf(kind)
        position, height = observables.rdf_first_maximum(r, g, where)
        rdf[kind] = {
            "r_nm": np.round(r, 5).tolist(),
            "g": np.round(g, 4).tolist(),
            "maximum_nm": position,
            "maximum": height
        }
    result = dict(spec)
    result.update(
        gamma_per_ps=GAMMA, Gamma_per_ps=BIG_GAMMA, upsilon_fs=UPSILON, Upsilon_fs=BIG_UPSILON,
        temperature_K=tip4p.TEMPERATURE, blocks=blocks, rdf=rdf, seconds=seconds,
        ms_per_step=1e3*stepping/steps,
        sampling_share_of_run=1 - (stepping/steps)*(steps + spec["equilibration_steps"])/seconds,
        averages_exact_minus_fast=exact_minus_fast(sums, np.array(pairs)), provenance=provenance())
    if hasattr(integrator, "getStepStatistics"):
        result["step_statistics"] = {
            k: float(v)
            for k, v in dict(integrator.getStepStatistics()).items()
        }
    return result


def block_means(n, sums, kinetic, squares, pairs, rdf_counts):
    """Block means of everything, lists of BLOCKS numbers.

    Units are K, kcal/mol, MPa; kJ/mol and nm for force squares and Laplacians.
    """
    mean = lambda series: np.asarray(series).reshape(BLOCKS, -1, *np.shape(series)[1:]).mean(axis=1)
    blocks = {}
    if len(kinetic):
        k = mean(kinetic)*2/(n*tip4p.BOLTZMANN)
        blocks["T_tk"] = k[:, 0]/3
        blocks["T_rk"] = k[:, 1:].sum(axis=1)/3
        for axis in range(3):
            blocks[f"T_rk_axis{axis + 1}"] = k[:, 1 + axis]
    s, p = mean(squares)/n, mean(pairs)/n
    blocks["force_squared"], blocks["torque_squared"] = s[:, 0], s[:, 1]
    blocks["laplacian_translation"], blocks["laplacian_rotation"] = p[:, 2], p[:, 3]
    blocks["U"] = p[:, 0]/tip4p.KCAL
    blocks["P_ex"] = sums.pressure(p[:, 1]*n)
    for kind, where in observables.RDF_POINTS.items():
        totals = np.array([counts[kind] for counts in rdf_counts])
        per_block = np.diff(totals, axis=0, prepend=0)
        blocks[f"g_{kind}"] = np.array([
            observables.rdf_value(*sums.rdf(kind, counts, sums.samples/BLOCKS), where)
            for counts in per_block
        ])
    return {name: [float(f"{v:.8g}") for v in values] for name, values in blocks.items()}


def exact_minus_fast(sums, pairs):
    """By what averages would change with the formula instead of NonbondedForce's direct space.

    This is to first order in the energy difference: -cov(A, U_exact - U_fast)/kT. U is in kcal/mol
    per molecule, P_ex in MPa.
    """
    difference = -pairs[:, 4]/(tip4p.BOLTZMANN*tip4p.TEMPERATURE)
    shift = lambda a: float(-np.cov(a, difference)[0, 1])
    return {
        "U": shift(pairs[:, 0]/sums.n/tip4p.KCAL),
        "P_ex": shift(sums.pressure(pairs[:, 1])),
        "laplacian_translation_relative": shift(pairs[:, 2])/pairs[:, 2].mean(),
        "laplacian_rotation_relative": shift(pairs[:, 3])/pairs[:, 3].mean(),
        "standard_deviation_of_energy_difference_in_kT": float(difference.std())
    }


def perform(spec, job, start):
    """simulate(), and whether the run failed."""
    try:
        return simulate(spec, start, job)
    except mm.OpenMMException as error:  # an unstable step size is a result too
        return dict(spec, failed=str(error), provenance=provenance())


def start_positions(n, file):
    """The equilibrated start of n molecules, read from `file` or made and saved there."""
    if os.path.exists(file):
        positions = np.load(file)["positions"]
        if len(positions) == 4*n:
            return positions
    with tqdm(total=1, unit="step", desc=f"equilibrating {n} molecules (once)") as bar:

        def progress(done, total):
            bar.total = total
            bar.update(done - bar.n)

        positions = tip4p.equilibrated_start(n, progress=progress)
    pathlib.Path(file).parent.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(file, positions=positions)
    return positions


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--molecules", type=int, default=512)
    parser.add_argument("--steps", type=int, default=60000,
                        help="measured steps, a multiple of 3000 (default 60000)")
    parser.add_argument("--equilibration", type=int,
                        help="steps before measuring (default: 20 ps, at least 5000 steps)")
    parser.add_argument("--schemes", nargs="+", default=list(SCHEMES),
                        choices=SCHEMES + ("SETTLE",))
    parser.add_argument("--h", nargs="+", type=float,
                        help="time steps, fs (default 2 4 6 8; gradient 1 2 3 4)")
    parser.add_argument("--paper", action="store_true",
                        help="paper's size: 1728 molecules, 20 000 + 200 000 steps, h = 1 ... 9 fs")
    parser.add_argument("--seed", type=int, default=2015,
                        help="run k of the fixed list gets seed + k")
    parser.add_argument(
        "--replica", type=int, default=0,
        help="with k > 0: independent further runs, with other seeds and files; "
        "the report combines all runs that there are")
    parser.add_argument("--platform", default="CPU", choices=("CPU", "Reference"))
    parser.add_argument("--potential", default="fast", choices=("fast", "exact"))
    parser.add_argument("--output", type=pathlib.Path, default=HERE/"results")
    parser.add_argument(
        "--start-file",
        help="file of the equilibrated start (default: start_<molecules>.npz in --work)")
    parser.add_argument("--report-only", action="store_true")
    campaign.addOptions(parser)
    options = campaign.settle(parser.parse_args())
    if options.paper:
        options.molecules, options.steps, options.equilibration = 1728, 200000 // 3000*3000, 20000
    if options.steps % 3000:
        parser.error(
            f"--steps {options.steps}: take a multiple of 3000, so that {BLOCKS} blocks hold whole "
            f"samples")
    options.output.mkdir(parents=True, exist_ok=True)
    if not options.report_only:
        run_series(options)
    import report
    report.write_report(options.output, options.work)


def run_series(options):
    specs = []
    for scheme in options.schemes:
        default = [1, 2, 3, 4] if scheme == "gradient" else [2, 4, 6, 8]
        for h in options.h or (list(range(1, 10)) if options.paper else default):
            equilibration = options.equilibration
            if equilibration is None:
                equilibration = 10000 if scheme == "gradient" else max(5000, int(round(20e3/h, -2)))
            specs.append({
                "scheme": scheme,
                "h_fs": h,
                "molecules": options.molecules,
                "steps": options.steps,
                "equilibration_steps": equilibration,
                "potential": options.potential,
                "platform": options.platform,
                "replica": options.replica,
                "seed": options.seed + 10000*options.replica + 100*
                (SCHEMES + ("SETTLE",)).index(scheme) + int(round(10*h))
            })
    start = start_positions(options.molecules, options.start_file
                            or options.work/f"start_{options.molecules}.npz")

    def show(index, result):
        tqdm.write(f"{name(specs[index])}: {result.get('failed') or 'done'}", file=sys.stderr)

    campaign.run(perform, specs, [name(s) for s in specs], options,
                 [s["steps"] + s["equilibration_steps"] for s in specs], "step", "TIP4P", show,
                 given=start)


if __name__ == "__main__":
    main()
