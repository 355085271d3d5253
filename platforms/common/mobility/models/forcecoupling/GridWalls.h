#ifndef RIGIDHI_GRID_WALLS_H_
#define RIGIDHI_GRID_WALLS_H_

#include <complex>
#include <memory>
#include <mutex>
#include <vector>

#include "mobility/models/confined/ConfiningPlanes.h"
#include "mobility/models/forcecoupling/GridWallFields.h"

namespace RigidHIPlugin {

/**
 * The flows by which no-slip walls change the flow of a periodic fluid, for channels of points on a
 * grid (GridChannel).
 *
 * Equation:  For a wave vector k along the walls, M = M_P - sum over a, b of V_a Q_ab V_b^+, with V
 *            the flows of exp(-kz), kz exp(-kz), exp(-k(H - z)) and k(H - z) exp(-k(H - z)), as
 *            velocities across the walls, and of the first and the third along t (PlaneModes.h).
 *            With a wall at z = 0, the subtracted flows are the images of the wall and those of the
 *            period P, and H is the height up to which particles are. With walls at z = 0 and H,
 *            they are U S^-1 U^T, with U the flows of forces on both planes in the periodic fluid,
 *            and S these flows on the planes.
 * Method:    Points spread Gaussians, which do not change harmonic functions. For other functions a
 *            Gaussian adds (width^2/2) lap, and a sphere (a^2/6) lap; GridChannel::faxen is the
 *            difference. Sums over nodes along z are sums over kz with the transforms of V. They
 *            need all kz, so the number of nodes along z is odd. Let z be 0 in the middle between
 *            the walls, x = k dz/2, y = kz dz/2 and s = sinh(x + iy). The sum of exp(-(k + i kz) z)
 *            over the nodes is sinh(kP/2)/s (-1)^(kz P/2 pi). The sum of z exp(-(k + i kz) z) also
 *            has the term (dz/2) sinh(kP/2) cosh(x + iy)/s^2, with the same sign. All sums consist
 *            of four profiles: the real parts of 1/s and of cosh(x + iy)/s^2, and minus the
 *            imaginary parts, which are odd in kz.
 * Limits:    Only wave numbers up to `largestWave` count. The caller treats k = 0 (UniformFlow).
 *            Double precision only, because functions of z grow beyond the walls.
 *
 * An instance is immutable, except that it makes the data of random fields at their first draw.
 */
class GridWalls {
public:
    static constexpr int numProfiles = 4;
    /**
     * @param shape  its edge along z is the period P, z = 0 is in the middle, and its size along z
     *     is odd
     * @param height  H
     * @param part  the part of each mode on the grid, as a function of the wave number
     */
    GridWalls(const ConfiningPlanes& planes, const GridShape& shape, double height,
              double largestWave, const GridWallFields::PartOfMode& part);
    /** Factors of profiles that depend on k alone, and on kz alone. */
    struct Along {
        double cosh, sinh;  // of x
    };
    struct Across {
        double cos, sin, sign;  // of y, and (-1)^(kz P/2 pi)
    };
    Along along(double k) const;
    Across across(int z) const { return ofModes[z]; }
    static void profiles(const Along& a, const Across& b, double (&values)[numProfiles]) {
        const double re = a.sinh * b.cos, im = a.cosh * b.sin, w = 1 / (re * re + im * im),
                     p = re * w, q = im * w, square = p * p - q * q, twice = 2 * p * q,
                     c = a.cosh * b.cos, d = a.sinh * b.sin;
        values[0] = b.sign * p;
        values[1] = b.sign * q;
        values[2] = b.sign * (c * square + d * twice);
        values[3] = b.sign * (c * twice - d * square);
    }
    static constexpr bool isOdd(int profile) { return profile % 2 == 1; }

    /** For each profile, the sums over all kz of the profile times the forces along x, y and z. */
    using Sums = std::complex<double>[numProfiles][3];
    /**
     * Replace the sums of all channels by factors of profiles: the velocities of a mode kz are the
     * sums of factors times profiles, in units of 1/viscosity, with the normalisation of transforms
     * in PlainGridFluid.
     *
     * @param x, y  indices of the wave vector along the axes
     */
    template <class Channel>
    void respond(int x, int y, const Channel* channels, int count, Sums* sums) const;

    /** The data of random fields. */
    const GridWallFields& getFields() const;
    /** Bytes of the walls of a grid, with the data of random fields. */
    static double memory(const GridShape& shape) {
        return static_cast<double>(sizeof(Response)) * (shape.size[0] / 2 + 1) *
                   (shape.size[1] / 2 + 1) +
               GridWallFields::memory(shape);
    }
    /**
     * Set the sums to factors of profiles of random flows. The other arguments are those of
     * GridWallFields::respond(). Velocities are in the units of transforms that are not normalised.
     */
    template <class Channel>
    void respondRandomly(int x, int y, const Channel* channels, int count,
                         const std::complex<double>* velocities,
                         const std::complex<double>* numbers, double scale,
                         std::complex<double>* near, Sums* sums) const;

private:
    /** Matrices of one wave vector, for basis functions whose transforms consist of profiles. */
    struct Response {
        double across[4][4], alongT[2][2];
        bool isLeftOut = true;
    };
    /** The basis functions of a wave vector, in terms of sums. */
    struct Directions {
        double k, lx, ly;         // l = (lx, ly)
        double toPlain, toSlope;  // 4k/dz and 2/(k dz)
    };
    void addMoments(const Directions& at, double faxen, bool ofTorques, const Sums& sums,
                    std::complex<double> (&across)[4], std::complex<double> (&alongT)[2]) const;
    void setVelocities(const Directions& at, double faxen, bool ofTorques,
                       const std::complex<double> (&across)[4],
                       const std::complex<double> (&alongT)[2], Sums& sums) const;
    Response responseOf(const ConfiningPlanes& planes, double k) const;
    /**
     * The functions exp(-kz) and kz exp(-kz) in terms of functions whose transforms are profiles.
     */
    struct ToProfiles {
        double A;
        Eigen::Matrix4d across;
    };
    ToProfiles toProfiles(double k) const;
    GridWallFields::Flows flowsOfPlanes(double k) const;
    Directions directionsOf(int x, int y) const {
        const double kx = shape.waveNumber(0, x), ky = shape.waveNumber(1, y),
                     k = std::sqrt(kx * kx + ky * ky);
        return {k, kx / k, ky / k, 4 * k / spacing, 2 / (k * spacing)};
    }
    const Response& responseAt(int x, int y) const {
        return responses[(size_t)std::min(y, shape.size[1] - y) * numX +
                         std::min(x, shape.size[0] - x)];
    }

    const GridShape shape;
    const double height, largestWave, period, spacing, scale;
    const int numX;
    const PlaneConditions conditions;
    const GridWallFields::PartOfMode part;
    std::vector<Across> ofModes;
    std::vector<Response> responses;
    mutable std::once_flag fieldsAreMade;
    mutable std::unique_ptr<const GridWallFields> fields;
};

template <class Channel>
void GridWalls::respond(int x, int y, const Channel* channels, int count, Sums* sums) const {
    const Response& response = responseAt(x, y);
    if (response.isLeftOut) {
        for (int g = 0; g < count; g++)
            for (auto& profile : sums[g])
                for (std::complex<double>& factor : profile) factor = 0;
        return;
    }
    const Directions at = directionsOf(x, y);
    std::complex<double> moments[4] = {}, momentsOfT[2] = {}, forces[4], forcesOfT[2];
    for (int g = 0; g < count; g++)
        addMoments(at, channels[g].faxen, channels[g].ofTorques, sums[g], moments, momentsOfT);
    for (int a = 0; a < 4; a++) {
        forces[a] = 0;
        for (int b = 0; b < 4; b++) forces[a] += response.across[a][b] * moments[b];
    }
    for (int a = 0; a < 2; a++)
        forcesOfT[a] =
            response.alongT[a][0] * momentsOfT[0] + response.alongT[a][1] * momentsOfT[1];
    for (int g = 0; g < count; g++)
        setVelocities(at, channels[g].faxen, channels[g].ofTorques, forces, forcesOfT, sums[g]);
}

template <class Channel>
void GridWalls::respondRandomly(int x, int y, const Channel* channels, int count,
                                const std::complex<double>* velocities,
                                const std::complex<double>* numbers, double scale,
                                std::complex<double>* near, Sums* sums) const {
    if (responseAt(x, y).isLeftOut) {
        std::fill_n(near, GridWallFields::numUnknowns, 0.0);
        for (int g = 0; g < count; g++)
            for (auto& profile : sums[g])
                for (std::complex<double>& factor : profile) factor = 0;
        return;
    }
    const Directions at = directionsOf(x, y);
    std::complex<double> across[4], alongT[2];
    getFields().respond(x, y, velocities, numbers, scale, near, across, alongT);
    for (int g = 0; g < count; g++)
        setVelocities(at, channels[g].faxen, channels[g].ofTorques, across, alongT, sums[g]);
}

}  // namespace RigidHIPlugin

#endif
