#ifndef RIGIDHI_GRID_MODES_H_
#define RIGIDHI_GRID_MODES_H_

#include <complex>

#include "mobility/models/forcecoupling/GridShape.h"
#include "random/CounterNoise.h"

namespace RigidHIPlugin {

/**
 * The random numbers of the modes of a field: three complex numbers for each integer wave vector,
 * with mean 0 and <|x|^2> = 1. They are independent, except that the numbers at -n are the
 * conjugates of those at n.
 */
class ModeNoise {
public:
    virtual ~ModeNoise() {}
    /** Fill numbers[c * count + i] for component c of the modes (nx[i], ny, nz), i = 0 ... count -
     * 1; nz is not negative. */
    virtual void fill(const int* nx, int count, int ny, int nz,
                      std::complex<double>* numbers) const = 0;
    /**
     * Likewise for the velocities on planes (GridPlanes): for component c of unknown j and the wave
     * vectors (nx[i], ny) along the planes.
     */
    virtual void fillPlane(const int* nx, int count, int ny, int j,
                           std::complex<double>* numbers) const = 0;
};

/**
 * The numbers of a NoiseStream. They belong to the wave vector, so a finer and a coarser grid have
 * the same noise in their common modes.
 */
class CounterModeNoise : public ModeNoise {
public:
    CounterModeNoise(const NoiseStream& noise, uint32_t purpose) : noise(noise), purpose(purpose) {}
    void fill(const int* nx, int count, int ny, int nz,
              std::complex<double>* numbers) const override {
        for (int i = 0; i < count; i++) {
            // Draw the numbers for only one of n and -n.
            const int sign = isMirrored(nx[i], ny, nz) ? -1 : 1;
            for (int c = 0; c < 3; c++) {
                double re, im;
                noise.pair(purpose, NoiseStream::indexOfMode(sign * nx[i], sign * ny, nz),
                           NoiseStream::blockOfMode(nz, c), re, im);
                numbers[c * count + i] = std::sqrt(0.5) * std::complex<double>(re, sign * im);
            }
        }
    }
    void fillPlane(const int* nx, int count, int ny, int j,
                   std::complex<double>* numbers) const override {
        for (int i = 0; i < count; i++) {
            const int sign = isMirrored(nx[i], ny, 0) ? -1 : 1;
            for (int c = 0; c < 3; c++) {
                double re, im;
                noise.pair(purpose,
                           NoiseStream::indexOfMode(sign * nx[i], sign * ny, modeOfPlane(j)),
                           NoiseStream::blockOfMode(modeOfPlane(j), c), re, im);
                numbers[c * count + i] = std::sqrt(0.5) * std::complex<double>(re, sign * im);
            }
        }
    }
    /** Whether the numbers are the conjugates of those drawn for the opposite wave vector. */
    static bool isMirrored(int nx, int ny, int nz) {
        return nz == 0 && (ny < 0 || (ny == 0 && nx < 0));
    }

    /** A wave number nz that no grid has, for unknown j of planes, j < 4. */
    static int modeOfPlane(int j) { return 4095 - j; }

protected:
    const NoiseStream noise;
    const uint32_t purpose;
};

/**
 * The random numbers of a grid's field, made from those of a periodic field. They differ only if
 * the grid is mirrored.
 *
 * On a mirrored grid the field is its own reflection, P u(Pr) = u(r), and has the law of (u(r) + P
 * u(Pr))/sqrt(2) of a periodic field u. So x(-n) = conj(x(n)) and x(Pn) = P x(n), and one of the
 * four modes n, Pn, -n and -Pn has numbers with the law above. If two of the four are the same
 * mode, the law differs: at ny = 0 the components along the walls are larger by sqrt(2). At nx = nz
 * = 0 these components are real, and the component normal to the walls is 0, because a
 * divergence-free flow has none.
 */
class GridModeNoise : public ModeNoise {
public:
    GridModeNoise(const GridShape& shape, const ModeNoise& periodic)
        : mirrored(shape.mirrored), periodic(periodic) {}
    void fill(const int* nx, int count, int ny, int nz,
              std::complex<double>* numbers) const override;
    void fillPlane(const int* nx, int count, int ny, int j,
                   std::complex<double>* numbers) const override {
        periodic.fillPlane(nx, count, ny, j, numbers);
    }
    /** The number of random numbers that a field takes. */
    static long long numbersOf(const GridShape& shape);

private:
    const bool mirrored;
    const ModeNoise& periodic;
};

}  // namespace RigidHIPlugin

#endif
