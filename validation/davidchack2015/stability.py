#!/usr/bin/env python3
"""Where the thermostats of Davidchack, Ouldridge, Tretyakov 2015 stop working.

The paper has this in section VI, in the text after Table 1.

    python3 stability.py [--quick] [--jobs 1]       writes results/stability.json and .png

1. Largest stable step of Langevin A, B, C without friction (paper: unstable at around 8 fs) and
   with gamma + Gamma = 15/ps (stable up to about 10 fs when the sum is above 8/ps).
2. Gradient thermostat: largest h upsilon with h Upsilon small (paper: about 150 fs^2), and largest
   h Upsilon with h upsilon small (about 70 fs^2).
3. Langevin A against C for growing gamma or Gamma at h = 2 fs: A breaks down above gamma ~ 100/ps,
   Gamma ~ 200/ps.

A Langevin run is called stable if it ends without an exception (non-finite coordinates) and its
kinetic temperature rises by less than 1 K/ps from its second to its last quarter (in runs of 10 ps
or more). A gradient run is called stable if it ends with U below -5 kcal/mol (at 300 K it is
-9.07). Stability depends on the length of a run, too: lengths are in the JSON.

For a free particle under Langevin A, T_tk/T = x/sinh(x), x = gamma h, exactly. The pictures show
this curve beside the measured values. For the rotation they show the mean over axes l of the same
function with x_l = Gamma h/(I_l sum 1/I).
"""
import argparse
import json
import os
import pathlib
import time

for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

import matplotlib  # noqa: E402

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402
import openmm as mm  # noqa: E402

import observables  # noqa: E402
import run  # noqa: E402
import tip4p_model as tip4p  # noqa: E402
from run import campaign  # noqa: E402

UNSTABLE_U = -5.0  # kcal/mol per molecule
UNSTABLE_DRIFT = 1.0  # K/ps
# ps: in shorter runs the drift is noise, and only a run that blows up is unstable.
SHORTEST_FOR_DRIFT = 10.0


def trial(task, start):
    """One run from the equilibrated start.

    task: scheme, h_fs, gamma, Gamma (1/ps), upsilon_fs, Upsilon_fs, steps, molecules, seed. The
    result is the task with stable, T_tk, T_rk (second half, with standard errors; None for the
    gradient thermostat), U, why.
    """
    n = task["molecules"]
    integrator = tip4p.make_integrator(n, task["scheme"], task["h_fs"], task["gamma"],
                                       task["Gamma"], task["upsilon_fs"], task["Upsilon_fs"],
                                       task["seed"])
    context = tip4p.make_context(n, integrator)
    context.setPositions(start)
    momenta = task["scheme"] != "gradient"
    if momenta:
        context.setVelocitiesToTemperature(tip4p.TEMPERATURE, task["seed"])
    result = dict(task, stable=False, why="", T_tk=None, T_rk=None, U=None, drift_K_per_ps=None,
                  began_to_fail_at_step=None)
    energy = lambda: ((context.getState(getEnergy=True, groups={0}).getPotentialEnergy()._value -
                       tip4p.fast_energy_offset(n))/n/tip4p.KCAL)
    temperatures = []
    chunk, done = 4, 0
    try:
        while done < task["steps"]:
            integrator.step(chunk)
            done += chunk
            if momenta:
                k = observables.kinetic_energies(context, integrator)*2/(3*n*tip4p.BOLTZMANN)
                temperatures.append((k[0], k[1:].sum()))
                if max(temperatures[-1]) > 10*tip4p.TEMPERATURE:
                    raise ArithmeticError(f"temperature above {10 * tip4p.TEMPERATURE:g} K")
        u = energy()
        if not np.isfinite(u):
            raise ArithmeticError("non-finite energy")
    except (mm.OpenMMException, ArithmeticError) as error:
        result.update(why=str(error).splitlines()[0][:160], began_to_fail_at_step=done)
        return result
    result["U"] = float(u)
    if momenta:
        half = np.array(temperatures)[len(temperatures) // 2:]
        blocks = half[:len(half) // 10*
                      10].reshape(10, -1, 2).mean(axis=1) if len(half) >= 10 else half
        for column, name in enumerate(("T_tk", "T_rk")):
            result[name] = {
                "mean": float(half[:, column].mean()),
                "standard_error": float(blocks[:, column].std(ddof=1)/np.sqrt(len(blocks)))
            }
        picoseconds = task["steps"]*task["h_fs"]*1e-3
        quarter = len(temperatures) // 4
        mean = np.mean(temperatures, axis=1)
        drift = (mean[3*quarter:].mean() - mean[quarter:2*quarter].mean())/(0.5*picoseconds)
        heats = picoseconds >= SHORTEST_FOR_DRIFT and drift > UNSTABLE_DRIFT
        result.update(drift_K_per_ps=float(drift), stable=not heats,
                      why=f"heats by {drift:.1f} K/ps" if heats else "")
    else:
        result["stable"] = bool(u < UNSTABLE_U)
        result["why"] = "" if result["stable"] else f"U = {u:.2f} kcal/mol"
    return result


def perform(task, job, start):
    return trial(task, start)


def tasks(options):
    """All trials, grouped: {group: list of tasks, each with its scan variable `x`}."""
    common = {
        "molecules": options.molecules,
        "seed": options.seed,
        "gamma": 5.0,
        "Gamma": 10.0,
        "upsilon_fs": 4.0,
        "Upsilon_fs": 1.0
    }
    picoseconds = 5.0 if options.quick else options.picoseconds
    groups = {}
    for scheme in "ABC":
        for name, gamma, big in (("no friction", 0.0, 0.0), ("gamma 5, Gamma 10 per ps", 5.0,
                                                             10.0)):
            if scheme == "B" and gamma == 0:
                # Without friction B is A (C differs from both only in turning twice by h/2).
                continue
            hs = ([7, 8, 9] if gamma == 0 else [9, 10, 11, 12]) if options.quick else (
                [6, 7, 7.5, 8, 8.5, 9, 9.5] if gamma == 0 else [8, 9, 9.5, 10, 10.5, 11, 12])
            groups[f"Langevin {scheme}, {name}"] = [
                dict(common, scheme=scheme, h_fs=h, x=h, gamma=gamma, Gamma=big,
                     steps=int(picoseconds*1e3/h) // 20*20) for h in hs
            ]
    products = {
        "upsilon": [80, 110, 130, 150, 170, 200, 240],
        "Upsilon": [30, 50, 60, 70, 80, 100, 130]
    }
    for name, values in products.items():
        groups[f"gradient, h {name}"] = [
            dict(common, scheme="gradient", h_fs=1.0, x=v,
                 upsilon_fs=float(v) if name == "upsilon" else 1.0,
                 Upsilon_fs=float(v) if name == "Upsilon" else 1.0,
                 steps=1000 if options.quick else 2000) for v in values
        ]
    frictions = [30, 100, 300, 1000] if options.quick else [10, 30, 100, 200, 300, 500, 1000]
    for scheme in "AC":
        for name in ("gamma", "Gamma"):
            groups[f"Langevin {scheme}, {name}"] = [
                dict(common, scheme=scheme, h_fs=2.0, x=f, steps=1000 if options.quick else 2000,
                     **{name: float(f)}) for f in frictions
            ]
    return groups


def picture(results, file):
    figure, axes = plt.subplots(2, 2, figsize=(12, 8.5))
    ax = axes[0, 0]
    for name, trials in results.items():
        if "friction" in name or "per ps" in name:
            good = [t for t in trials if t["T_rk"]]
            for ls, key in (("-", "T_rk"), (":", "T_tk")):
                ax.plot([t["h_fs"] for t in good], [t[key]["mean"] for t in good], ls=ls,
                        marker="o", ms=3, color=f"C{list(results).index(name)}",
                        label=f"{name}: {key}")
            bad = [t["h_fs"] for t in trials if not t["stable"]]
            ax.plot(bad, [620 - 12*list(results).index(name)]*len(bad), "x",
                    color=f"C{list(results).index(name)}")
    ax.axhline(300, color="0.8", lw=0.8)
    ax.set(xlabel="h, fs", ylabel="kinetic temperature, K", ylim=(0, 640),
           title="step size (crosses: heating by 1 K/ps or more, or blown up)")
    ax.legend(*ax.get_legend_handles_labels(), fontsize=6, ncol=2, loc="lower left")
    ax = axes[0, 1]
    for name, trials in results.items():
        if name.startswith("gradient"):
            colour = "C0" if "upsilon" in name else "C1"
            finite = [t for t in trials if t["U"] is not None and t["U"] < 5]
            ax.plot([t["x"] for t in finite], [t["U"] for t in finite], "o-", color=colour, ms=4,
                    label=name + ", fs²")
            lost = [t["x"] for t in trials if t not in finite]
            ax.plot(lost, [1.0]*len(lost), "x", color=colour)
    ax.axvline(150, color="C0", lw=0.8, ls="--")
    ax.axvline(70, color="C1", lw=0.8, ls="--")
    ax.set(xlabel="h υ or h Υ, fs²", ylabel="U at the end, kcal/mol",
           title="gradient (crosses: blown up; dashed: the paper's limits)")
    ax.legend(*ax.get_legend_handles_labels(), fontsize=8)
    moments = tip4p.principal_moments()
    shares = 1/moments/np.sum(1/moments)
    for ax, name, key, rates in ((axes[1, 0], "gamma", "T_tk", [1.0]), (axes[1, 1], "Gamma", "T_rk",
                                                                        shares)):
        for scheme, colour in (("A", "tab:red"), ("C", "tab:blue")):
            good = [t for t in results.get(f"Langevin {scheme}, {name}", []) if t[key]]
            ax.errorbar([t["x"] for t in good], [t[key]["mean"] for t in good],
                        [1.96*t[key]["standard_error"] for t in good], fmt="o", ms=4, color=colour,
                        capsize=2, label=f"Langevin {scheme}, h = 2 fs")
        x = np.geomspace(10, 1000, 200)
        ax.plot(x, np.mean([300*(x*r*0.002)/np.sinh(x*r*0.002) for r in rates],
                           axis=0), color="tab:red", lw=1,
                label="Langevin A, free particle" if name == "gamma" else "Langevin A, free body")
        ax.axhline(300, color="0.8", lw=0.8)
        ax.axvline(100 if name == "gamma" else 200, color="0.5", lw=0.8, ls="--")
        ax.set(xscale="log", xlabel=f"{name}, 1/ps", ylabel=f"{key}, K",
               title=f"large {name} (dashed: the paper's limit for A)")
        ax.legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(file, dpi=80)
    plt.close(figure)


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="coarser scans, shorter runs")
    parser.add_argument("--molecules", type=int, default=343)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--picoseconds", type=float, default=20.0,
                        help="length of the runs that look for the largest step")
    parser.add_argument("--start-file")
    parser.add_argument("--output", type=pathlib.Path, default=run.HERE/"results")
    campaign.addOptions(parser)
    options = campaign.settle(parser.parse_args())
    options.output.mkdir(parents=True, exist_ok=True)
    start = run.start_positions(options.molecules, options.start_file
                                or options.work/f"start_{options.molecules}.npz")
    began = time.time()
    groups = tasks(options)
    places = [(name, task) for name, group in groups.items() for task in group]
    done = campaign.run(perform, [task for _, task in places],
                        [f"stability {name} {task['x']:g}" for name, task in places], options,
                        title="stability", given=start)
    results = {
        name: [trial for trial, (other, _) in zip(done, places) if other == name]
        for name in groups
    }
    write(results, time.time() - began, options.output)
    for name, limit in limits(results).items():
        print(
            f"{name:45s} stable to {limit['largest_stable_below_the_first_failure']}, unstable at "
            f"{limit['smallest_unstable']}")


def limits(results):
    """The first failure of each group."""
    found = {}
    for name, trials in results.items():
        if name.endswith((", gamma", ", Gamma")):
            continue  # these scans are about temperatures, not about a limit
        unstable = [t["x"] for t in trials if not t["stable"]]
        below = [t["x"] for t in trials if t["stable"] and (not unstable or t["x"] < min(unstable))]
        found[name] = {
            "largest_stable_below_the_first_failure": max(below, default=None),
            "smallest_unstable": min(unstable, default=None)
        }
    return found


def write(results, seconds, out):
    with open(os.path.join(out, "stability.json"), "w") as file:
        json.dump(
            {
                "limits": limits(results),
                "trials": results,
                "seconds": seconds,
                "provenance": run.provenance()
            }, file, indent=1)
    picture(results, os.path.join(out, "stability.png"))


if __name__ == "__main__":
    main()
