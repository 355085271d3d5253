"""Parts of the pictures of bodies above a wall."""
import numpy as np


def densities(axis, entries, key, labels, markers='.'):
    """Probability densities of runs' bins with standard errors, and the exact one."""
    for k, (entry, label) in enumerate(zip(entries, labels)):
        h = entry['histograms'][key]
        edges = np.array(h['edges'])
        width, middle = np.diff(edges), (edges[1:] + edges[:-1])/2
        if not k:
            axis.plot(middle, np.array(h['exact'])/width, 'k-', lw=1, label='quadrature')
        axis.errorbar(middle,
                      np.array(h['P'])/width,
                      np.array(h['error'])/width, fmt=markers, ms=5, color=f'C{k}', label=label)


def withoutDrift(axis, entry, exact, label):
    """The density to which a scheme without the stochastic drift tends, in the bins of a run."""
    edges = np.array(entry['histograms']['h']['edges'])
    axis.plot((edges[1:] + edges[:-1])/2,
              np.array(exact['without drift']['P'])/np.diff(edges), 'k:', lw=1, label=label)


def displacements(axis, entries, names, colours=None):
    """Mean square displacements with standard errors.

    A marker stands for a name and a colour for a run. With `colours`, a colour for each name, a
    marker stands for a run.
    """
    for k, entry in enumerate(entries):
        for j, name in enumerate(names):
            m = entry['msd'][name]
            axis.errorbar(m['lag'], m['mean'], m['error'], fmt='osD^'[k if colours else j], ms=4,
                          mfc='none', color=colours[j] if colours else f'C{k}',
                          label=f'{name}, {entry["scheme"]}')


def finish(axis, title, x, y, logarithmic=''):
    """Add title, axes and legend; `logarithmic` names the logarithmic axes."""
    axis.set(title=title, xlabel=x, ylabel=y)
    if 'x' in logarithmic:
        axis.set_xscale('log')
    if 'y' in logarithmic:
        axis.set_yscale('log')
    axis.legend(fontsize=7)
