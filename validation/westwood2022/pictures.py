"""Pictures of rods between walls, from the data of rods.json and a track of poses."""
import numpy as np
from PIL import Image, ImageDraw

import model
from recording import pyplot

COLOURS = {8: 'tab:red', 4: 'tab:green', 2: 'tab:blue'}
LINES = ('-', '--', ':')  # the largest cut-off is first
MARKS = {'DriftCorrectorFD': 'o', 'EulerMaruyama': 'x'}


def _scenes(data):
    """Each scene with L/Ly, and the rank of its cut-off, the largest first."""
    cutoffs = sorted({scene['cutoff'] for scene in data['scenes']}, reverse=True)
    for scene in data['scenes']:
        yield scene, round(1/scene['width_over_L']), cutoffs.index(scene['cutoff'])


def _at_the_papers_step(scene):
    return [
        run for run in scene['dynamics']
        if run['scaling'] == 'Whole' and abs(run['step_over_tau']/model.STEP - 1) < 1e-6
    ]


def _density(found, parts=1):
    """Middles of bins, densities and their errors."""
    edges = np.array(found['edges'])
    width = parts*np.diff(edges)
    return (edges[1:] + edges[:-1])/2, np.array(found['P'])/width, np.array(found['error'])/width


def draw(data, path):
    """Figures 8 and 9: heights above, angles below."""
    plt = pyplot()
    figure = plt.figure(figsize=(12, 8), layout='constrained')
    above, below = figure.subfigures(2, 1)
    heights(above, data)
    angles(below, data)
    figure.savefig(path, dpi=90)
    plt.close(figure)


def heights(figure, data):
    """Figure 8: densities of the centres' y, each half the mirror image of the other."""
    fractions = [f for f in (8, 4, 2) if any(f == fraction for _, fraction, _ in _scenes(data))]
    axes = figure.subplots(1, len(fractions), squeeze=False)
    for scene, fraction, line in _scenes(data):
        ax, half = axes[0, fractions.index(fraction)], scene['width']/2

        def both(off, values):
            return np.concatenate([half - off[::-1],
                                   half + off]), np.concatenate([values[::-1], values])

        off, p, error = _density(scene['monte_carlo']['y'], 2)
        y, p2 = both(off, p)
        _, error2 = both(off, error)
        colour = ('k', 'tab:blue', 'tab:gray')[line]
        ax.plot(y, p2, LINES[line], color=colour, lw=1.2,
                label=f'Monte Carlo, cut-off {scene["cutoff"]:g} a')
        ax.fill_between(y, p2 - error2, p2 + error2, color=colour, alpha=0.2, lw=0)
        for run in _at_the_papers_step(scene):
            off, p, error = _density(run['y'], 2)
            y, p2 = both(off, p)
            _, error2 = both(off, error)
            name = 'gDC' if run['scheme'] == 'DriftCorrectorFD' else run['scheme']
            ax.errorbar(y, p2, error2, fmt=MARKS[run['scheme']], ms=3, lw=0.7,
                        color=('tab:red', 'tab:orange', 'tab:brown')[line],
                        label=f'{name}, cut-off {scene["cutoff"]:g} a')
        ax.set(title=f'Ly = L/{fraction} = {scene["width"]:.2f} a, {scene["rods"]} rods',
               xlabel='y/a', ylabel='density of y, 1/a', xlim=(0, scene['width']))
    for ax in axes.flat:
        ax.set_ylim(0, 1.25*ax.get_ylim()[1])
        ax.legend(fontsize=7, loc='upper center', ncols=2)


def angles(figure, data):
    """Figure 9: densities of the angle between rods and walls, linear and logarithmic."""
    axes = figure.subplots(1, 2)
    for scene, fraction, line in _scenes(data):
        theta, p, error = _density(scene['monte_carlo']['theta'])
        for ax in axes:
            ax.plot(theta, np.where(p > 0, p, np.nan), LINES[line], color=COLOURS[fraction], lw=1.2,
                    label=f'L/{fraction}, Monte Carlo, cut-off {scene["cutoff"]:g} a')
            ax.fill_between(theta, np.maximum(p - error, 1e-5), p + error, color=COLOURS[fraction],
                            alpha=0.15, lw=0)
            for run in _at_the_papers_step(scene):
                if line == 0 and run['scheme'] == 'DriftCorrectorFD':
                    theta, q, error2 = _density(run['theta'])
                    ax.errorbar(theta[q > 0], q[q > 0], error2[q > 0], fmt='o', ms=3, lw=0.7,
                                color=COLOURS[fraction], label=f'L/{fraction}, gDC')
    for ax in axes:
        ax.axvline(np.pi/8, color='0.7', lw=0.7)
        ax.set(xlabel='θ, rad (the grey line is π/8)', ylabel='density of θ, 1/rad',
               xlim=(0, np.pi/2))
    axes[0].set(ylim=(0, None))
    axes[1].set(yscale='log', ylim=(1e-3, 20))
    axes[0].legend(fontsize=7)


def animation(scene, track, path, size=440, every=1):
    """A GIF of poses (frames, rods, 7): beads as discs.

    They are seen along z and a little from the side and above. Each rod has a grey of its own, as
    in the paper's Figure 7.
    """
    track = np.asarray(track, float)[::every]
    side, width = scene.side, scene.width
    turn, tilt = 0.45, 0.28
    right = np.array([np.cos(turn), 0, -np.sin(turn)])
    up = np.array([-np.sin(tilt)*np.sin(turn), np.cos(tilt), -np.sin(tilt)*np.cos(turn)])
    towards = np.cross(right, up)
    corners = np.array([(x, y, z) for y in (0, width)
                        for x, z in ((0, 0), (1, 0), (1, 1), (0, 1))], float)*((side, 1, side))
    flat = np.stack([corners @ right, corners @ up], axis=1)
    low, high = flat.min(0) - 3, flat.max(0) + 3
    scale = size/(high - low)[0]
    shape = size, int((high - low)[1]*scale)

    def place(points):
        return (np.asarray(points) @ np.stack([right, up], axis=1) - low)*(scale, -scale) + (
            0, shape[1])

    greys = np.random.default_rng(3).permutation(np.linspace(70, 215, scene.rods)).astype(int)
    frames = []
    for poses in track:
        image = Image.new('L', shape, 255)
        draw = ImageDraw.Draw(image)
        draw.polygon([tuple(point) for point in place(corners[:4])], fill=235, outline=150)
        R = poses[:, :3].copy()
        R[:, ::2] %= side
        x = model.beads(R, poses[:, 3:]).reshape(-1, 3)
        radius = 1.15*scale
        for k in np.argsort(x @ towards):
            u, v = place(x[k])
            draw.ellipse((u - radius, v - radius, u + radius, v + radius),
                         fill=int(greys[k // len(model.SITES)]), outline=40)
        upper = [tuple(point) for point in place(corners[4:])]
        draw.line(upper + upper[:1], fill=150)
        frames.append(image.quantize(16))
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=110, loop=0,
                   optimize=True)
