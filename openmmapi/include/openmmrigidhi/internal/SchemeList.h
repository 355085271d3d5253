#ifndef OPENMMRIGIDHI_SCHEME_LIST_H_
#define OPENMMRIGIDHI_SCHEME_LIST_H_

/**
 * The one list of schemes, in the order of their numbers. A new scheme is a line at the end. The
 * list generates the enumeration in C++ and Python, names in XML and messages, checks, the loops
 * that run a scheme, docstrings, the tables of the pages, and the lists in the tests.
 *
 * ROW(name, kind, momenta, weakOrder, coldOrder, forces, differenced, work, drift, description)
 *   name         of the enumerator, of the struct or class that is the scheme, and of its file in
 *                platforms/common/schemes
 *   kind         Thermostat: moves and forces in turn, without a fluid; FluidThermostat: the fluid
 *                changes momenta in the middle of the step; Overdamped: without momenta, in a fluid
 *   momenta      whether bodies have momenta
 *   weakOrder    of averages at a temperature
 *   coldOrder    of trajectories at temperature 0
 *   forces       force evaluations a step
 *   differenced  what the scheme takes finite differences of where the divergence of the mobility
 *                is not known (Differenced)
 *   work         how many solves, fields, ... of the mobility a step needs, for Solver::Auto
 *                (SchemeWork): (solves, fields, roots, matrices, driftSolves, driftMatrices,
 *                driftMatricesOfBody), zeros at the end left out; () without a fluid
 *   drift        how the scheme makes the stochastic drift kT div N; empty if it makes none
 *   description  a sentence or two for docstrings and tables, with the paper
 */
#define RIGIDHI_SCHEMES(ROW)                                                                       \
    ROW(LangevinA, Thermostat, true, 2, 2, 1, Nothing, (), "",                                     \
        "Langevin thermostat: a Hamiltonian step with noise in its kicks, between two half steps " \
        "of damping. Breaks down above gamma 100/ps or Gamma 200/ps (Davidchack 2015, eq. 20).")   \
    ROW(LangevinB, Thermostat, true, 2, 2, 1, Nothing, (), "",                                     \
        "Langevin thermostat: half an exact Ornstein-Uhlenbeck step, a Hamiltonian step, half an " \
        "Ornstein-Uhlenbeck step (OBABO). Take it for accurate kinetic temperatures (Davidchack "  \
        "2015, eq. 27).")                                                                          \
    ROW(LangevinC, Thermostat, true, 2, 2, 1, Nothing, (), "",                                     \
        "Langevin thermostat: half a Hamiltonian step, an exact Ornstein-Uhlenbeck step, half a "  \
        "Hamiltonian step (BAOAB). It is the default, and the most accurate scheme for averages "  \
        "over configurations (Davidchack 2015, eq. 28).")                                          \
    ROW(GradientThermostat, Thermostat, false, 1, 1, 1, Nothing, (), "",                           \
        "Brownian (gradient) dynamics without momenta and without a fluid (Davidchack 2015, eq. "  \
        "30).")                                                                                    \
    ROW(LangevinHI, FluidThermostat, true, 2, 2, 1, Nothing, (0, 0, 0, 1), "",                     \
        "LangevinC with the friction of a fluid that couples the bodies; one friction evaluation " \
        "a step (Davidchack 2017, eq. 27).")                                                       \
    ROW(EulerMaruyama, Overdamped, false, 1, 1, 1, Nothing, (1, 1, 0, 1), "",                      \
        "Omits the stochastic drift, so averages are wrong wherever the drift is not 0; the "      \
        "scheme then warns. One mobility problem (Delong 2015, eq. 37).")                          \
    ROW(FixmanMidpoint, Overdamped, false, 1, 2, 2, Nothing, (2, 0, 2, 2),                         \
        "by the mobility at the mid-point",                                                        \
        "Takes the mobility at a mid-point, without finite differences. Forces at t and t + h/2, " \
        "two mobility problems (Delong 2015, eqs. 41 and 44).")                                    \
    ROW(RandomFiniteDifference, Overdamped, false, 1, 1, 1, Solves, (1, 1, 0, 1, 1, 1),            \
        "by a random finite difference of the mobility",                                           \
        "Takes finite differences of the mobility along a random direction. Mobility problems at " \
        "two configurations (Delong 2015, eqs. 48 and 51).")                                       \
    ROW(TractionEulerMaruyama, Overdamped, false, 1, 1, 1, Products, (1, 1, 0, 1, 1, 2),           \
        "by random finite differences along which blob forces are kept",                           \
        "Takes finite differences, along a random direction, of quantities that need no solves. "  \
        "Two mobility problems at one configuration (Sprinkle 2017).")                             \
    ROW(TrapezoidalSlip, Overdamped, false, 1, 2, 2, Products, (2, 1, 0, 2, 0, 2),                 \
        "by random finite differences along which blob forces are kept, and the mobility at the "  \
        "end of the step",                                                                         \
        "Trapezoidal rule with the same random slips of particles at both ends. Forces at t and "  \
        "t + h, three mobility problems at two configurations (Sprinkle 2017).")                   \
    ROW(DriftCorrectorFD, Overdamped, false, 1, 1, 1, Roots, (1, 1, 0, 1, 0, 1, 6),                \
        "by the mobility at the mid-point and the divergence of slips",                            \
        "The generalised drifter-corrector with finite differences: forces at t + h/2, one "       \
        "mobility problem; two square roots of the particles' mobility, and six more a body "      \
        "(Westwood 2022, eqs. 37 to 44).")                                                         \
    ROW(DriftCorrectorRFD, Overdamped, false, 1, 1, 1, Roots, (1, 1, 0, 1, 0, 2),                  \
        "by the mobility at the mid-point and the divergence of slips",                            \
        "The generalised drifter-corrector with random finite differences: forces at t + h/2, "    \
        "one mobility problem, three square roots of the particles' mobility (Westwood 2022, eq. " \
        "40).")

#endif
