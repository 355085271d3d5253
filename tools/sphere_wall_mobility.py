#!/usr/bin/python3
"""Fit the resistance of a sphere above a no-slip wall, for the arrays of SphereWall.cpp.

The arrays are in platforms/common/mobility/models/wall/SphereWall.cpp.

Exact values: for a sphere that moves or turns parallel to the wall, the Stokes flow is found in
bispherical coordinates with the ansatz of Dean, O'Neill, Mathematika 10, 13 (1963) and O'Neill,
Mathematika 11, 67 (1964): pressure Q cos(phi) and velocities from harmonic U0, U2, W. The boundary
conditions and div u = 0 are collocated on both surfaces. For turns about the normal: Jeffery, Proc.
Lond. Math. Soc. 14, 327 (1915), a sum. For motion towards the wall: Brenner, Chem. Eng. Sci. 16,
242 (1961), a sum.

Fits: the variables are u = a/h and the gap's logarithm. The leading terms of both ends are
prescribed (Goldman, Cox, Brenner, Chem. Eng. Sci. 22, 637, 1967; towards the wall Cox, Brenner,
Chem. Eng. Sci. 22, 1753, 1967). The script prints the arrays for the source, the errors of the fits
and of mobilities made of them, values for tests, and the errors of the approximations in Delong et
al. 2015, eqs. 95 to 97.
"""
import numpy as np

#: For each function: coefficient at contact of 1/gap and of ln(1 - u), power of u, first
#: coefficient far away (without the part of 1/gap).
SHAPES = {
    'Ft': (0, -8/15, 1, 9/16),
    'Tt': (0, 1/10, 4, -3/32),
    'Tr': (0, -2/5, 3, 5/16),
    'Tz': (0, 0, 3, 1/8),
    'Fz': (1, -1/5, 1, 1/8)
}
POWERS, LOGARITHMS = 10, 4


def legendre(count, mu):
    """P_n^m and its derivative by mu, for m = 0, 1, 2 and n = 0 ... count - 1."""
    P = np.zeros((count, len(mu)))
    P[0], P[1] = 1, mu
    for n in range(1, count - 1):
        P[n + 1] = ((2*n + 1)*mu*P[n] - n*P[n - 1])/(n + 1)
    n, s2 = np.arange(count)[:, None], 1 - mu**2
    s = np.sqrt(s2)
    d1 = n*(np.vstack([np.zeros(len(mu)), P[:-1]]) - mu*P)/s2
    d2 = (2*mu*d1 - n*(n + 1)*P)/s2
    d3 = (4*mu*d2 - (n*(n + 1) - 2)*d1)/s2
    return (P, d1), (s*d1, s*d2 - mu/s*d1), (s2*d2, s2*d3 - 2*mu*d2)


def parallel(gap):
    """Ft, Tt, Tr of motion parallel to the wall.

    Ft is the force from moving over 6 pi eta a, Tt the torque from moving over 8 pi eta a^2, Tr the
    torque from turning over 8 pi eta a^3. Signs: of what acts on the sphere from outside, for V
    along x and W about y; the wall is below.
    """
    alpha = np.arccosh(1 + gap)
    a, N = 1/np.sinh(alpha), int(max(30, 16/alpha))
    centre = a*(1 + gap)
    mu, weight = np.polynomial.legendre.leggauss(N)
    polynomials = legendre(N + 3, mu)
    columns = {
        'Q': slice(0, 2*N),
        'U0': slice(2*N, 4*N),
        'U2': slice(4*N, 6*N),
        'W': slice(6*N, 7*N)
    }

    def harmonics(m, xi):
        """Values and derivatives by xi and mu at (xi, mu) of the modes.

        Modes that are 1 on the sphere come first, then modes that are 1 on the wall.
        """
        n = np.arange(1 if m == 1 else m, N + (1 if m == 1 else m))
        k, X = n + 0.5, np.sqrt(np.cosh(xi) - mu)
        F, G = (p[n]/np.maximum(n, 1.0)[:, None]**m for p in polynomials[m])
        far, near = k/np.sinh(np.minimum(k*alpha, 700)), k/np.tanh(k*alpha)
        zero, one = np.zeros(N), np.ones(N)
        result = []
        for value, slope in ((zero, far), (one, -near)) if xi == 0 else ((one, near), (zero, -far)):
            value, slope = value[:, None], slope[:, None]
            result.append(
                (X*value*F, np.sinh(xi)/(2*X)*value*F + X*slope*F, -value*F/(2*X) + X*value*G))
        return [np.vstack(parts).T for parts in zip(*result)]

    equations, right = [], []
    s = np.sqrt(1 - mu**2)
    for xi in (0.0, alpha):
        D = np.cosh(xi) - mu
        z, rho = np.sinh(xi)/D, s/D
        z_xi, rho_xi = (1 - np.cosh(xi)*mu)/D**2, -s*np.sinh(xi)/D**2
        z_mu, rho_mu = np.sinh(xi)/D**2, (s - mu/s*D)/D**2
        determinant = rho_xi*z_mu - z_xi*rho_mu
        modes = {'Q': harmonics(1, xi), 'U0': harmonics(0, xi), 'U2': harmonics(2, xi)}
        modes['W'] = [part[:, :N] for part in harmonics(1, xi)]  # W is 0 on the wall

        def gradient(name):
            _, by_xi, by_mu = modes[name]
            column = (1/determinant)[:, None]
            return (column*(z_mu[:, None]*by_xi - z_xi[:, None]*by_mu),
                    column*(rho_xi[:, None]*by_mu - rho_mu[:, None]*by_xi))

        def add(row, name, block):
            row[:, columns[name]] += block

        half_rho, half_z = 0.5*rho[:, None], 0.5*z[:, None]
        divergence = np.zeros((N, 7*N))
        (Q_rho, Q_z), (U0_rho, _), (U2_rho, _), (_, W_z) = map(gradient, ('Q', 'U0', 'U2', 'W'))
        add(divergence, 'Q', 1.5*modes['Q'][0] + half_rho*Q_rho + half_z*Q_z)
        add(divergence, 'U0', 0.5*U0_rho)
        add(divergence, 'U2', 0.5*U2_rho + modes['U2'][0]/rho[:, None])
        add(divergence, 'W', W_z)
        moves = np.zeros((N, 2)) if xi == 0 else np.stack([np.ones(N), z - centre], 1)
        row2, row0 = np.zeros((N, 7*N)), np.zeros((N, 7*N))
        for row, name in ((row2, 'U2'), (row0, 'U0')):
            add(row, name, modes[name][0])
            add(row, 'Q', half_rho*modes['Q'][0])
        equations += [divergence/D[:, None]**1.5, row2, row0]
        right += [np.zeros((N, 2)), np.zeros((N, 2)), 2*moves]
        if xi > 0:
            row = np.zeros((N, 7*N))
            add(row, 'W', modes['W'][0])
            add(row, 'Q', half_z*modes['Q'][0])
            equations.append(row)
            right.append(np.stack([np.zeros(N), -rho], 1))
    equations = np.vstack(equations)
    scale = np.linalg.norm(equations, axis=0)
    solution = np.linalg.solve(equations/scale, np.vstack(right))/scale[:, None]

    # On the sphere the traction is -p n + d(u - rigid motion)/dn, and d/dn = -D d/dxi.
    Q = modes['Q'][0] @ solution[columns['Q']]
    Q_xi, U0_xi, U2_xi, W_xi = (modes[name][1] @ solution[columns[name]]
                                for name in ('Q', 'U0', 'U2', 'W'))
    rho, z, D, z_xi, rho_xi = (v[:, None] for v in (rho, z, D, z_xi, rho_xi))
    none = np.zeros((N, 1))
    rigid, rigid_z = np.hstack([none, z_xi]), np.hstack([none, -rho_xi])
    n_rho, n_z = rho/a, (z - centre)/a
    f_rho = -Q*n_rho - D*(0.5*(rho_xi*Q + rho*Q_xi + U2_xi + U0_xi) - rigid)
    f_phi = -D*(0.5*(U2_xi - U0_xi) + rigid)
    f_z = -Q*n_z - D*(0.5*(z_xi*Q + z*Q_xi) + W_xi - rigid_z)
    area = np.pi*weight[:, None]/D**2
    force = -np.sum((f_rho - f_phi)*area, 0)
    torque = -np.sum(a*(n_z*(f_rho - f_phi) - n_rho*f_z)*area, 0)
    Ft, Fr = force/(6*np.pi*a*np.array([1, a]))
    Tt, Tr = torque/(8*np.pi*a**2*np.array([1, a]))
    assert abs(Fr - 4/3*Tt) < 1e-6, 'the resistance must be symmetric'
    return Ft, Tt, Tr


def about_normal(gap):
    """Torque from turning about the normal, over 8 pi eta a^3 (Jeffery)."""
    alpha = np.arccosh(1 + gap)
    return np.sum((np.sinh(alpha)/np.sinh(np.arange(1, 60/alpha + 20)*alpha))**3)


def towards_wall(gap):
    """Force from moving towards the wall, over 6 pi eta a (Brenner)."""
    alpha = np.arccosh(1 + gap)
    n = np.arange(1, 60/alpha + 20)
    k = 2*n + 1
    ratio = (2*np.sinh(k*alpha) + k*np.sinh(2*alpha))/(4*np.sinh(k*alpha/2)**2 -
                                                       (k*np.sinh(alpha))**2)
    return 4/3*np.sinh(alpha)*np.sum(n*(n + 1)/((2*n - 1)*(2*n + 3))*(ratio - 1))


def basis(name, gaps):
    """The prescribed terms, and the functions whose coefficients are fitted."""
    pole, contact, power, far = SHAPES[name]
    u = 1/(1 + gaps)
    logarithm = np.log(gaps*u)
    start = 0 if name == 'Tt' else 1
    prescribed = start + pole/gaps + u**power*(far + contact*logarithm)
    return prescribed, np.array([u**(power + k) for k in range(1, POWERS)] +
                                [u**power*logarithm*(1 - u)**k for k in range(1, LOGARITHMS)]).T


def fit(name, gaps, values):
    """Coefficients of the fit; both p_0 and l_0 are prescribed.

    f = [1 or 0] + [1/gap] + u^power (sum p_k u^k + ln(1 - u) sum l_k (1 - u)^k).
    """
    prescribed, functions = basis(name, gaps)
    scale = 1/(np.abs(values) + (1e-3 if name == 'Tt' else 0))
    return np.linalg.lstsq(functions*scale[:, None], (values - prescribed)*scale, rcond=None)[0]


def fitted(name, solution, gaps):
    prescribed, functions = basis(name, gaps)
    return prescribed + functions @ solution


def along(Ft, Tt, Tr):
    """Mobilities along the wall, over those of free fluid.

    They are V from a force, W from a torque, and a W from a force.
    """
    determinant = Ft*Tr - 4/3*Tt**2
    return Tr/determinant, Ft/determinant, -Tt/determinant


def exactAt(gaps):
    values = dict(zip(('Ft', 'Tt', 'Tr'), np.array([parallel(gap) for gap in gaps]).T))
    values['Tz'] = np.array([about_normal(gap) for gap in gaps])
    return values


def main():
    gaps = np.concatenate([np.geomspace(3e-4, 0.1, 30), np.geomspace(0.12, 50, 40)])
    wide = np.geomspace(1e-6, 1e3, 200)  # the sum towards the wall holds at any gap
    exact, solutions = exactAt(gaps), {}
    between = np.sqrt(gaps[1:]*gaps[:-1])
    exactBetween = exactAt(between)
    exactBetween['Fz'] = np.array([towards_wall(gap) for gap in np.sqrt(wide[1:]*wide[:-1])])
    for name in SHAPES:
        at, values = (wide, np.array([towards_wall(gap)
                                      for gap in wide])) if name == 'Fz' else (gaps, exact[name])
        solutions[name] = solution = fit(name, at, values)
        # ln(1 - u) = -u - ... of the logarithms must not change what was prescribed far away: it
        # starts one power higher.
        _, contact, _, far = SHAPES[name]
        powers, logarithms = np.append(far, solution[:POWERS - 1]), np.append(
            contact, solution[POWERS - 1:])
        check = exactBetween[name]
        error = np.max(
            np.abs(fitted(name, solution, np.sqrt(at[1:]*at[:-1])) - check)/
            (np.abs(check) + (1e-3 if name == 'Tt' else 0)))
        print(f'// {name}: relative error {error:.1e}')
        print('{' + ', '.join(f'{c:.12g}'
                              for c in powers) + '}, {' + ', '.join(f'{c:.12g}'
                                                                    for c in logarithms) + '}')
    names = ('Ft', 'Tt', 'Tr')
    for what, found, right in zip(('V along', 'W along', 'a W from F'),
                                  along(*(fitted(n, solutions[n], between) for n in names)),
                                  along(*(exactBetween[n] for n in names))):
        print(f'// {what}: error {np.max(np.abs(found - right)):.1e}, relative '
              f'{np.max(np.abs(found/right - 1)):.1e}')
    print(
        '\n// gap, then mobilities: V along, V towards the wall over that of free fluid; W along, '
        'W about the normal over free; '
        'a W along from F over V of free fluid; errors of eqs. 95, 96, 97')
    for gap in (1e-3, 0.003, 0.01, 0.03, 0.035, 0.1, 0.13, 0.3, 1, 3, 10):
        Ft, Tt, Tr = parallel(gap)
        determinant = Ft*Tr - 4/3*Tt**2
        across, u, l = 1/towards_wall(gap), 1/(1 + gap), np.log(gap)
        e95 = (6*gap**2 + 2*gap)/(6*gap**2 + 9*gap + 2)/across - 1
        e96 = -2*(l - 0.9543)/(l**2 - 3.188*l + 1.591)/(Tr/determinant) - 1
        e97 = (1 - 9*u/16 + u**3/8 - 45*u**4/256 - u**5/16)/(Tr/determinant) - 1
        print(f'{{{gap:g}, {Tr/determinant:.8f}, {across:.8f}, {Ft/determinant:.8f}, '
              f'{1/about_normal(gap):.8f}, '
              f'{-Tt/determinant:.8f}}},  // {e95:+.1e} {e96:+.1e} {e97:+.1e}')


if __name__ == '__main__':
    main()
