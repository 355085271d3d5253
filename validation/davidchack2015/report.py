#!/usr/bin/env python3
"""Fits, table and pictures from the runs of run.py, beside the numbers printed in the paper.

The paper is Davidchack, Ouldridge, Tretyakov 2015.

    python3 report.py [--output results] [--work results/work]

<A>_h = A0 + E_A h^p, p = 2 for Langevin A, B, C (h <= 6 fs) and 1 for the gradient thermostat (h <=
4 fs), as in the paper's Table 1, by weighted least squares. The error of each <A>_h comes from
block averages: it is the largest of the estimates from 60, 30, 20, 15 and 10 blocks, so that
correlations longer than a short block are not overlooked. Where chi^2 per degree of freedom exceeds
1, the errors of A0 and E_A are multiplied by its square root. The reason is that slow quantities (U
and RDFs under the gradient thermostat) stay correlated over more than a block. Intervals are 95 %.
"""
import argparse
import glob
import json
import os

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402

import tip4p_model as tip4p  # noqa: E402

ROWS = ("T_tk", "T_rk", "T_tc", "T_rc", "U", "P_ex", "g_OO", "g_OH", "g_HH")
LABELS = {
    "T_tk": "T_tk, K",
    "T_rk": "T_rk, K",
    "T_tc": "T_tc, K",
    "T_rc": "T_rc, K",
    "U": "U, kcal/mol",
    "P_ex": "P_ex, MPa",
    "g_OO": "g_OO(2.78 Å)",
    "g_OH": "g_OH(1.82 Å)",
    "g_HH": "g_HH(2.38 Å)"
}
SCHEMES = ("A", "B", "C", "gradient")
NAMES = {
    "A": "Langevin A",
    "B": "Langevin B",
    "C": "Langevin C",
    "gradient": "Gradient",
    "SETTLE": "LangevinMiddle + SETTLE"
}
LARGEST_H = {"gradient": 4}  # largest step of the fit, fs; for Langevin 6
Z95 = 1.96

# Table 1: (A0, 95 % of A0, E_A, 95 % of E_A); P_ex with the + convention, as in the paper's table.
PAPER = {
    "A": {
        "T_tk": (300.0, 0.2, -0.136, 0.008),
        "T_rk": (299.9, 0.2, -0.808, 0.008),
        "T_tc": (300.1, 0.3, 0.022, 0.013),
        "T_rc": (299.8, 0.3, 0.158, 0.011),
        "U": (-9.068, 0.004, -0.0004, 0.0002),
        "P_ex": (-117.4, 1.3, -0.02, 0.05),
        "g_OO": (3.007, 0.004, 0.0006, 0.0002),
        "g_OH": (1.490, 0.003, 0.0003, 0.0002),
        "g_HH": (1.283, 0.002, 0.00012, 0.00007)
    },
    "B": {
        "T_tk": (299.9, 0.2, 0.100, 0.013),
        "T_rk": (299.8, 0.3, -0.092, 0.013),
        "T_tc": (299.9, 0.4, 0.45, 0.02),
        "T_rc": (299.6, 0.4, 0.99, 0.02),
        "U": (-9.071, 0.004, 0.0059, 0.0002),
        "P_ex": (-117.4, 1.6, 0.27, 0.09),
        "g_OO": (3.009, 0.004, -0.0027, 0.0002),
        "g_OH": (1.492, 0.002, -0.0024, 0.0002),
        "g_HH": (1.284, 0.002, -0.00082, 0.00006)
    },
    "C": {
        "T_tk": (300.0, 0.2, -0.135, 0.007),
        "T_rk": (300.1, 0.2, -0.803, 0.008),
        "T_tc": (300.1, 0.3, 0.021, 0.013),
        "T_rc": (299.9, 0.3, 0.152, 0.011),
        "U": (-9.066, 0.003, -0.0005, 0.0002),
        "P_ex": (-117.5, 1.4, -0.01, 0.05),
        "g_OO": (3.009, 0.004, 0.0004, 0.0002),
        "g_OH": (1.490, 0.002, 0.00028, 0.00009),
        "g_HH": (1.282, 0.002, 0.00018, 0.00007)
    },
    "gradient": {
        "T_tc": (299.6, 1.0, 3.6, 0.5),
        "T_rc": (298.6, 1.6, 9.9, 0.4),
        "U": (-9.075, 0.011, 0.033, 0.004),
        "P_ex": (-118, 11, 1.7, 2.8),
        "g_OO": (3.012, 0.009, -0.011, 0.004),
        "g_OH": (1.491, 0.007, -0.011, 0.002),
        "g_HH": (1.284, 0.004, -0.004, 0.002)
    },
}


def block_error(values):
    """Standard error of the mean of a correlated series of block means.

    It is the largest over five block lengths.
    """
    values = np.asarray(values)
    estimates = []
    for size in (1, 2, 3, 4, 6):
        means = values[:len(values) // size*size].reshape(-1, size).mean(axis=1)
        estimates.append(means.std(ddof=1)/np.sqrt(len(means)))
    return max(estimates)


def measured(run):
    """{quantity: (mean, standard error)} of one run."""
    blocks = {name: np.array(values) for name, values in run["blocks"].items()}
    result = {
        name: (blocks[name].mean(), block_error(blocks[name]))
        for name in ("T_tk", "T_rk", "T_rk_axis1", "T_rk_axis2", "T_rk_axis3", "U", "P_ex", "g_OO",
                     "g_OH", "g_HH") if name in blocks
    }
    for name, above, below in (("T_tc", "force_squared", "laplacian_translation"),
                               ("T_rc", "torque_squared", "laplacian_rotation")):
        a, b = blocks[above], blocks[below]
        ratio = a.mean()/b.mean()
        result[name] = (ratio/tip4p.BOLTZMANN, block_error(a - ratio*b)/b.mean()/tip4p.BOLTZMANN)
    return result


def combined(runs):
    """measured() of several runs with the same scheme and step: means weighted by length."""
    total = sum(r["steps"] for r in runs)
    parts = [(r["steps"]/total, measured(r)) for r in runs]
    return {
        name: (sum(w*p[name][0] for w, p in parts), np.sqrt(sum(
            (w*p[name][1])**2 for w, p in parts)))
        for name in parts[0][1]
    }


def fit(h, values, errors, power, fixed=None):
    """Weighted least squares of values = A0 + E h^power.

    fixed: a known A0. The result is a dictionary with A0, E, their standard errors (times
    sqrt(chi2/degrees of freedom) where it exceeds 1) and chi2.
    """
    x, y, w = np.asarray(h, float)**power, np.asarray(values), 1/np.asarray(errors)
    design = np.stack([w, w*x], axis=1)[:, 0 if fixed is None else 1:]
    covariance = np.linalg.inv(design.T @ design)
    solution = covariance @ design.T @ (w*(y - (fixed or 0.0)))
    chi2 = float(np.sum((w*(y - (fixed or 0.0)) - design @ solution)**2))
    freedom = len(x) - len(solution)
    scale = max(1.0, np.sqrt(chi2/freedom)) if freedom else 1.0
    error = scale*np.sqrt(np.diag(covariance))
    a0, a0_error = (solution[0], error[0]) if fixed is None else (fixed, 0.0)
    return {
        "A0": a0,
        "A0_error": a0_error,
        "E": solution[-1],
        "E_error": error[-1],
        "chi2": chi2,
        "degrees_of_freedom": freedom
    }


def load_runs(work):
    runs = []
    for file in glob.glob(os.path.join(work, "tip4p_*", "result.json")):
        with open(file) as stream:
            runs.append(json.load(stream)["result"])
    return sorted(runs, key=lambda r: (r["scheme"], r["h_fs"]))


def analyse(runs):
    """Per scheme: the points and the fits."""
    result = {}
    for scheme in sorted({r["scheme"] for r in runs}):
        good = [r for r in runs if r["scheme"] == scheme and "failed" not in r]
        points = {
            h: combined([r for r in good if r["h_fs"] == h])
            for h in {r["h_fs"]
                      for r in good}
        }
        entry = {
            "points": {
                f"{h:g}":
                {k: {
                    "mean": float(v[0]),
                    "error95": float(Z95*v[1])
                }
                 for k, v in p.items()}
                for h, p in sorted(points.items())
            },
            "measured_steps": {
                f"{h:g}": sum(r["steps"] for r in good if r["h_fs"] == h)
                for h in sorted(points)
            },
            "fits": {},
            "failed": {
                f"{r['h_fs']:g}": r["failed"]
                for r in runs if r["scheme"] == scheme and "failed" in r
            }
        }
        power, limit = (1, LARGEST_H["gradient"]) if scheme == "gradient" else (2, 6)
        used = [h for h in sorted(points) if h <= limit]
        for row in ROWS:
            h = [x for x in used if row in points[x]]
            if len(h) < 2:
                continue
            values, errors = zip(*(points[x][row] for x in h))
            line = {
                k: v if isinstance(v, int) else float(v)
                for k, v in fit(h, values, errors, power).items()
            }
            if row.startswith("T_"):
                line["E_if_A0_is_300"], line["E_if_A0_is_300_error"] = (float(
                    fit(h, values, errors, power, tip4p.TEMPERATURE)[k]) for k in ("E", "E_error"))
            paper = PAPER.get(scheme, {}).get(row)
            if paper:
                line["paper"] = dict(zip(("A0", "A0_error95", "E", "E_error95"), paper))
                line["z_A0"] = (line["A0"] - paper[0])/np.hypot(line["A0_error"], paper[1]/Z95)
                line["z_E"] = (line["E"] - paper[2])/np.hypot(line["E_error"], paper[3]/Z95)
            entry["fits"][row] = line
        result[scheme] = entry
    return result


def with_error(value, error):
    """12.34(5): value with its 95 % error in the last digits."""
    if not np.isfinite(error) or error <= 0:
        return f"{value:.5g}"
    digits = max(0,
                 int(np.ceil(-np.log10(error/2) - 1e-9)))  # an error of 2 to 19 in the last digits
    shown = f"{error:.{digits}f}" if error >= 1 else f"{error * 10**digits:.0f}"
    return f"{value:.{digits}f}({shown})"


def table(analysis):
    """Table 1 as Markdown."""
    lines = []
    for scheme in (s for s in SCHEMES if s in analysis):
        power = 1 if scheme == "gradient" else 2
        lines += [
            f"\n**{NAMES[scheme]}**, E_A per fs{'²' if power == 2 else ''}; (95 %), z in combined "
            f"standard errors\n",
            "| A | A0 here | A0 paper | z | E_A here | E_A paper | z | E_A with A0 = 300 K | "
            "χ²/dof |", "|---|---|---|---|---|---|---|---|---|"
        ]
        for row in ROWS:
            line = analysis[scheme]["fits"].get(row)
            if not line or row not in PAPER[scheme]:
                continue
            constrained = (with_error(line["E_if_A0_is_300"], Z95*line["E_if_A0_is_300_error"])
                           if "E_if_A0_is_300" in line else "")
            paper = PAPER[scheme][row]
            lines.append(f"| {LABELS[row]} | {with_error(line['A0'], Z95 * line['A0_error'])} | "
                         f"{with_error(*paper[:2])} | {line['z_A0']:+.1f} | "
                         f"{with_error(line['E'], Z95 * line['E_error'])} | "
                         f"{with_error(*paper[2:])} | {line['z_E']:+.1f} | {constrained} | "
                         f"{line['chi2']:.1f}/{line['degrees_of_freedom']} |")
    return "\n".join(lines).strip() + "\n"


def points_table(analysis):
    """Every measured point as Markdown."""
    rows = ROWS + ("T_rk_axis1", "T_rk_axis2", "T_rk_axis3")
    lines = [
        "| scheme | h, fs | steps | " + " | ".join(LABELS.get(r, r) for r in rows) + " |",
        "|---"*(len(rows) + 3) + "|"
    ]
    for scheme in (s for s in SCHEMES + ("SETTLE",) if s in analysis):
        for h, point in sorted(analysis[scheme]["points"].items(), key=lambda item: float(item[0])):
            cells = (with_error(point[r]["mean"], point[r]["error95"]) if r in point else "–"
                     for r in rows)
            lines.append(f"| {NAMES[scheme]} | {h} | {analysis[scheme]['measured_steps'][h]} | " +
                         " | ".join(cells) + " |")
        lines += [
            f"| {NAMES[scheme]} | {h} | failed: {why} |"
            for h, why in analysis[scheme]["failed"].items()
        ]
    return "\n".join(lines) + "\n"


def picture(analysis, file):
    """Figures 1 to 4 in one: rows temperatures, U, P_ex, RDF differences; columns schemes."""
    schemes = [s for s in SCHEMES if s in analysis and analysis[s]["points"]]
    figure, axes = plt.subplots(4, len(schemes), figsize=(3.9*len(schemes), 12), squeeze=False,
                                sharex="col")
    panels = (("T_tk", "T_rk", "T_tc", "T_rc"), ("U",), ("P_ex",), ("g_OO", "g_OH", "g_HH"))
    units = ("temperature, K", "U, kcal/mol", "P_ex, MPa", "g(r)$_h$ − g(r)$_0$")
    colours, markers = ("tab:blue", "tab:red", "tab:green", "tab:purple"), "osD^"
    for column, scheme in enumerate(schemes):
        entry = analysis[scheme]
        power = 1 if scheme == "gradient" else 2
        hs = sorted(entry["points"], key=float)
        fine = np.linspace(0, max(map(float, hs))*1.03, 100)
        for row, quantities in enumerate(panels):
            ax = axes[row, column]
            for quantity, colour, marker in zip(quantities, colours, markers):
                there = [h for h in hs if quantity in entry["points"][h]]
                if not there:
                    continue
                line = entry["fits"].get(quantity)
                shift = line["A0"] if (line and row == 3) else 0
                ax.errorbar([float(h) for h in there],
                            [entry["points"][h][quantity]["mean"] - shift for h in there],
                            [entry["points"][h][quantity]["error95"] for h in there], fmt=marker,
                            ms=5, color=colour, capsize=2, label=quantity.replace("_", " "))
                if line:
                    ax.plot(fine, line["A0"] + line["E"]*fine**power - shift, color=colour, lw=1.2)
                paper = PAPER.get(scheme, {}).get(quantity)
                if paper:
                    ax.plot(fine, (0 if row == 3 else paper[0]) + paper[2]*fine**power,
                            color=colour, lw=1, ls=(0, (4, 3)), alpha=0.7)
            if row == 0:
                ax.axhline(300, color="0.8", lw=0.8, zorder=0)
                ax.set_title(NAMES[scheme])
            if row == len(panels) - 1:
                ax.set_xlabel("h, fs")
            if column == 0:
                ax.set_ylabel(units[row])
            ax.legend(fontsize=8, ncol=2 if row == 0 else 1)
            ax.set_xlim(0, None)
    figure.suptitle(
        "TIP4P water, Davidchack 2015 Figs. 1–4: points and full lines this plugin (95 %), dashed "
        "lines the paper's Table 1", fontsize=11)
    figure.tight_layout(rect=(0, 0, 1, 0.985))
    figure.savefig(file, dpi=80)
    plt.close(figure)


def rdf_picture(runs, file):
    """RDFs of the smallest step of each scheme, and the paper's values near the first maxima."""
    figure, axes = plt.subplots(1, 3, figsize=(13, 3.8))
    for ax, kind, where in zip(axes, ("OO", "OH", "HH"), (0.278, 0.182, 0.238)):
        for scheme in SCHEMES:
            good = [r for r in runs if r["scheme"] == scheme and "failed" not in r]
            if good:
                best = min(good, key=lambda r: r["h_fs"])
                ax.plot(10*np.array(best["rdf"][kind]["r_nm"]), best["rdf"][kind]["g"], lw=1,
                        label=f"{NAMES[scheme]}, {best['h_fs']:g} fs")
        ax.plot(10*where, PAPER["C"][f"g_{kind}"][0], "k*", ms=9, label="paper, C, h → 0")
        ax.set_xlim(1.4 if kind != "OO" else 2.2, 8)
        ax.set_xlabel(f"r$_{{{kind}}}$, Å")
        ax.set_ylabel(f"g$_{{{kind}}}$")
        ax.legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(file, dpi=80)
    plt.close(figure)


def write_report(out, work):
    runs = load_runs(work)
    if not runs:
        raise SystemExit(f"no runs in {work} yet: start run.py without --report-only")
    analysis = analyse(runs)
    summary = {
        "what": "Davidchack, Ouldridge, Tretyakov 2015, Table 1",
        "confidence": "errors named error95 are 95 %; others one standard error",
        "schemes": analysis,
        "runs": [{
            k: r.get(k)
            for k in ("scheme", "h_fs", "molecules", "steps", "equilibration_steps", "seed",
                      "replica", "potential", "platform", "seconds", "ms_per_step",
                      "sampling_share_of_run", "averages_exact_minus_fast", "failed", "provenance")
        } for r in runs]
    }
    with open(os.path.join(out, "table1.json"), "w") as file:
        json.dump(summary, file, indent=1)
    text = table(analysis) + "\n## Every point\n\n" + points_table(analysis)
    with open(os.path.join(out, "table1.md"), "w") as file:
        file.write(text)
    picture(analysis, os.path.join(out, "figures1-4.png"))
    rdf_picture(runs, os.path.join(out, "rdf.png"))
    print(text)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    results = os.path.join(os.path.dirname(os.path.abspath(__file__)), "results")
    parser.add_argument("--output", default=results)
    parser.add_argument("--work", default=os.path.join(results, "work"))
    options = parser.parse_args()
    write_report(options.output, options.work)
