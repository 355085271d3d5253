"""Pictures of hedgehogs in a driven fluid, from the data of hedgehogs.json and poses."""
import numpy as np
from PIL import Image, ImageDraw

import hedgehogmodel as model
from recording import pyplot

COLOURS = {'repel-attract': 'tab:blue', 'repel-attract-repel': 'tab:red'}
MARKS = {'repel-attract': 'o', 'repel-attract-repel': 's'}


def draw(data, bodies, path):
    """The pair potentials (Figure 10, right), and the results (Figure 11)."""
    plt = pyplot()
    figure, axes = plt.subplots(2, 2, figsize=(11, 8.4), layout='constrained')
    potentials(axes[0, 0])
    viscosities(axes[0, 1], data, bodies)
    distributions(axes[1], data, bodies)
    figure.savefig(path, dpi=90)
    plt.close(figure)


def potentials(ax):
    """Figure 10, right: the two pair potentials, with the soft repulsion that both have."""
    r = np.linspace(1.5, 6, 600)
    for name in model.GAUSSIANS:
        ax.plot(r, model.pairEnergy(r, name), color=COLOURS[name], label=name)
    ax.plot(r, model.PAIR_STRENGTH*np.exp((model.CONTACT - r)/model.PAIR_RANGE), ':', color='0.5',
            label='soft repulsion alone (eq. 60)')
    ax.axhline(0, color='0.8', lw=0.7)
    ax.axvline(model.CONTACT, color='0.8', lw=0.7)
    ax.set(title='pair potentials', xlabel='distance of two beads, r/a', ylabel='energy/kT',
           xlim=(1.8, 6), ylim=(-4, 12))
    ax.legend()


def viscosities(ax, data, bodies):
    """Figure 11, top: effective viscosity against shear rate."""
    ticker = pyplot()
    for name in model.GAUSSIANS:
        for size, fill in sorted({(row['bodies'], row['bodies'] == bodies)
                                  for row in data['runs']}, key=lambda pair: not pair[1]):
            rows = [
                row for row in data['runs']
                if row['potential'] == name and row['bodies'] == size and 'ratio' in row
            ]
            if not rows:
                continue
            x, y = (np.array([row[key] for row in rows]).T for key in ('shear_rate', 'ratio'))
            ax.errorbar(x[0], y[0], xerr=x[1], yerr=y[1], fmt=MARKS[name] + ('-' if fill else ''),
                        ms=5 if fill else 8, lw=1, capsize=2, color=COLOURS[name],
                        mfc=None if fill else 'none', label=f'{name}, {size} hedgehogs')
    for name, ratio in data['without_forces_and_noise'].items():
        ax.axhline(ratio, color=COLOURS[name], lw=0.8, ls=':')
    ax.set(xscale='log', yscale='log', xlabel='shear rate × τ', ylabel='η_eff/η', ylim=(5, 100),
           title='viscosity (dotted: without forces and noise)')
    ax.yaxis.set_major_locator(ticker.FixedLocator((5, 10, 20, 50, 100)))
    ax.yaxis.set_major_formatter('{x:g}')
    ax.yaxis.set_minor_formatter(ticker.NullFormatter())
    ax.legend(fontsize=8)
    ax.grid(which='both', color='0.92', lw=0.6)


def distributions(axes, data, bodies):
    """Figure 11, bottom: radial distribution functions of centres."""
    for ax, name in zip(axes, model.GAUSSIANS):
        rows = [row for row in data['runs'] if row['potential'] == name and row['bodies'] == bodies]
        for k, row in enumerate(rows):
            grey = str(0.8*(1 - k/max(1, len(rows) - 1)))
            r, g, error = (np.array(row[key]) for key in ('r', 'g', 'g_error'))
            ax.plot(r, g, color=grey, lw=1.2, label=f'{row["bare_shear_rate"]:g}')
            ax.fill_between(r, g - error, g + error, color=grey, alpha=0.25, lw=0)
        ax.axhline(1, color='0.8', lw=0.7)
        ax.axvspan(8, 10, color='tab:orange', alpha=0.12, lw=0)
        ax.set(title=f'{name}, {bodies} hedgehogs', xlabel='distance of centres, r/a',
               ylabel='g(r)', xlim=(0, None), ylim=(0, 1.35))
        ax.legend(title='f0/(kη) τ', fontsize=8)


def animation(track, side, path, size=330):
    """A GIF of poses (frames, bodies, 7), the nearer half of the box seen along z.

    Beads are discs. Their colour is the place along y where their body began, so that the wave is
    seen. At y = side/4 the fluid is driven to the right, at 3 side/4 to the left.
    """
    track = np.asarray(track, float)
    colours = np.array(pyplot().get_cmap('twilight')((track[0, :, 1] % side)/side)[:, :3]*255, int)
    scale, frames = size/side, []
    shifts = np.array([(i, j, 0) for i in (-1, 0, 1) for j in (-1, 0, 1)])*side
    for poses in track:
        image = Image.new('RGB', (size, size), (255, 255, 255))
        draw = ImageDraw.Draw(image)
        R = poses[:, :3] % side
        near = R[:, 2] > side/2
        # Bodies and their periodic images, parts of which reach over the edges.
        x = (model.beads(R[near], poses[near, 3:])[None] + shifts[:, None, None]).reshape(-1, 3)
        owner = np.tile(np.repeat(np.flatnonzero(near), len(model.SITES)), len(shifts))
        seen = np.all((x[:, :2] > -1) & (x[:, :2] < side + 1), axis=1)
        x, owner = x[seen], owner[seen]
        for k in np.argsort(x[:, 2]):
            colour = tuple(int(c) for c in colours[owner[k]])
            u, v, r = scale*x[k, 0], size - scale*x[k, 1], scale
            draw.ellipse((u - r, v - r, u + r, v + r), fill=colour, outline=(40, 40, 40))
        frames.append(
            image.quantize(16, dither=Image.Dither.NONE if hasattr(Image, 'Dither') else 0))
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=100, loop=0,
                   optimize=True)
