#ifndef RIGIDHI_UNIT_NOISE_H_
#define RIGIDHI_UNIT_NOISE_H_

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <complex>
#include <functional>

#include "mobility/models/forcecoupling/GridModes.h"

namespace RigidHITest {

/**
 * Noise in which one number of one mode has a value, and its mirror image has the conjugate. All
 * other numbers are 0.
 */
class UnitNoise : public RigidHIPlugin::ModeNoise {
public:
    UnitNoise(std::array<int, 3> mode, int component, std::complex<double> value)
        : mode(mode), component(component), value(value) {}
    /** A number of unknown j of planes (GridPlanes) for the wave vector (nx, ny). */
    static UnitNoise ofPlane(int nx, int ny, int j, int component, std::complex<double> value) {
        UnitNoise made({nx, ny, 0}, component, value);
        made.plane = j;
        return made;
    }
    void fill(const int* nx, int count, int ny, int nz,
              std::complex<double>* numbers) const override {
        for (int i = 0; i < count; i++)
            for (int c = 0; c < 3; c++) {
                if (plane >= 0) {
                    numbers[c * count + i] = 0;
                    continue;
                }
                const bool same = std::array<int, 3>{nx[i], ny, nz} == mode,
                           mirrored = std::array<int, 3>{-nx[i], -ny, -nz} == mode;
                numbers[c * count + i] = c != component ? 0.0
                                         : same         ? value
                                         : mirrored     ? std::conj(value)
                                                        : 0.0;
            }
    }

    void fillPlane(const int* nx, int count, int ny, int j,
                   std::complex<double>* numbers) const override {
        for (int i = 0; i < count; i++)
            for (int c = 0; c < 3; c++) {
                const bool same = nx[i] == mode[0] && ny == mode[1],
                           mirrored = nx[i] == -mode[0] && ny == -mode[1];
                numbers[c * count + i] = c != component || j != plane ? 0.0
                                         : same                       ? value
                                         : mirrored                   ? std::conj(value)
                                                                      : 0.0;
            }
    }

private:
    const std::array<int, 3> mode;
    const int component;
    const std::complex<double> value;
    int plane = -1;
};

/**
 * B B^T, where B has a column for every random number of a field: the real and the imaginary part,
 * each of variance 1/2, of three components of every drawn mode.
 *
 * @param size        nodes of the grid along each axis
 * @param lowest      the lowest ny
 * @param isMirrored  whether a mode is the conjugate of another drawn mode
 * @param column      gives the velocities of all particles in the field of such a noise
 */
inline Eigen::MatrixXd covarianceOfFields(
    const std::array<int, 3>& size, int numRows, int lowest,
    const std::function<bool(int, int, int)>& isMirrored,
    const std::function<Eigen::VectorXd(const UnitNoise&)>& column) {
    Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(numRows, numRows);
    for (int nx = -size[0] / 2; nx <= size[0] / 2; nx++)
        for (int ny = lowest; ny <= size[1] / 2; ny++)
            for (int nz = 0; nz <= size[2] / 2; nz++) {
                if (isMirrored(nx, ny, nz)) continue;
                for (int c = 0; c < 3; c++)
                    for (std::complex<double> value :
                         {std::complex<double>(1, 0), std::complex<double>(0, 1)}) {
                        const Eigen::VectorXd v =
                            column(UnitNoise({nx, ny, nz}, c, std::sqrt(0.5) * value));
                        covariance += v * v.transpose();
                    }
            }
    return covariance;
}

}  // namespace RigidHITest

#endif
