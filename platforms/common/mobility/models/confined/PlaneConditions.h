#ifndef RIGIDHI_PLANE_CONDITIONS_H_
#define RIGIDHI_PLANE_CONDITIONS_H_

#include <Eigen/Core>
#include <vector>

namespace RigidHIPlugin {

/**
 * Planes z = const in a fluid that is periodic along all axes, and the law of the fluid's
 * velocities on these planes. A plane at rest is a wall. A plane whose velocities have the law of a
 * fluid on its other side is no obstacle. So planes confine a periodic fluid, and the flow between
 * the planes does not depend on the period.
 *
 * Equation:  G' = G - G E C E^+ G, with G the response of the periodic fluid, E^+ its velocities on
 *            the planes, S = E^+ G E, C = 1/S - 1/S T 1/S, and T the law (covariance) of the
 *            velocities on the planes. T is 0 for planes at rest. From a random field y of
 *            covariance G, y + G E (1/S) (w - E^+ y) makes a field of covariance G', with w of
 *            covariance T independent of y (Matheron's rule).
 * Waves:     For a wave vector k along the planes, the velocities are those along k (l), along the
 *            normal times -i (z), and along z x k (t). Forces have the same components. Then S and
 *            T are real, depend on |k| alone, and couple t with neither l nor z.
 * Modes:     The unknowns of the first two planes are their mean velocity and half of their
 *            difference; that of a third plane is its difference from this mean. For waves much
 *            longer than the distance of two planes, their velocities are nearly equal. S of the
 *            planes themselves would lose the digits of the difference.
 * Mean flow: Without a wave vector, S of a velocity along the planes is (P/12 - z/2 + z^2/2P). A
 *            uniform velocity is an additional unknown, which makes the forces of planes balance
 *            all others.
 *
 * The viscosity is 1, and lengths are in nm. Numbers are long doubles, because the matrices are
 * nearly singular for long waves.
 */
class PlaneConditions {
public:
    using Real = long double;
    /** For at most three planes: each has a velocity along k and one normal to the planes. */
    using Matrix = Eigen::Matrix<Real, Eigen::Dynamic, Eigen::Dynamic, 0, 6, 6>;
    /**
     * Matrices of one wave number: for t, and for l of all unknowns followed by z of all unknowns.
     */
    struct Matrices {
        Matrix t, lz;
    };

    /**
     * Two planes at rest, in a period of height + gap.
     *
     * @param zeroFlux  whether the mean flow along the planes has no flux; otherwise it has no mean
     *     pressure gradient
     */
    static PlaneConditions channel(double height, double gap, bool zeroFlux);
    /** A plane at rest, and a free surface, along which the fluid slips. */
    static PlaneConditions film(double height, double gap);
    /**
     * A plane at rest, with the fluid above it. The velocities at the distance `height` above it
     * have the law of an unbounded fluid above a wall. A second plane at rest is at the distance
     * `below` behind the first one.
     */
    static PlaneConditions wall(double height, double gap, double below);
    /**
     * Likewise without a second plane at rest, for particles that lie completely between the
     * planes.
     */
    static PlaneConditions layer(double height, double gap);

    int numPlanes() const { return planes.size(); }
    /** z of a plane. The first two are at equal distances from z = 0. */
    double place(int plane) const { return static_cast<double>(planes[plane]); }
    /** The height of z = 0 above the lower wall. */
    double getOrigin() const { return origin; }
    double getPeriod() const { return static_cast<double>(period); }
    double getHeight() const { return static_cast<double>(height); }
    bool hasZeroFlux() const { return zeroFlux; }
    /** The unknowns as combinations of planes, a row for each unknown. */
    const Matrix& combinations() const { return combined; }

    /** S and T of a nonzero wave number. */
    Matrices periodic(Real k) const;
    Matrices law(Real k) const;
    /**
     * The response of the periodic fluid at the distance z above a plane to forces on the plane. lz
     * is the response of l to a force along z, and minus the response of z to a force along l.
     */
    struct Response {
        double ll, zz, tt, lz;
        Response(double k, double z, double period);
    };
    /**
     * Likewise to a mean force on a plane, without the uniform velocity, and to a mean force spread
     * evenly between the first two planes.
     */
    double meanResponse(double z) const;
    double meanResponseToGradient(double z) const;
    /** Conditions on the mean flow along an axis: the planes' unknowns, and the flux if it is 0. */
    int numOfMean() const { return numPlanes() + zeroFlux; }
    /** S of these conditions, and T. */
    Matrix meanPeriodic() const;
    Matrix meanLaw() const;
    /** The contribution of a unit uniform velocity to each condition. */
    Eigen::Matrix<Real, Eigen::Dynamic, 1, 0, 6, 1> meanOfUniform() const;

private:
    enum Kind { Channel, Film, Wall };
    PlaneConditions(Kind kind, double height, double period, bool zeroFlux);
    Matrix combine(const Matrix& ofPlanes, int kinds) const;

    const Kind kind;
    const Real height, period;
    const bool zeroFlux;
    double origin = 0;
    std::vector<Real> planes;
    Matrix combined;
};

}  // namespace RigidHIPlugin

#endif
