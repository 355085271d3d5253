#include "mobility/models/confined/UniformField.h"

#include <algorithm>
#include <cmath>
#include <complex>

#include "linearalgebra/Decompositions.h"
#include "mobility/models/confined/WallModes.h"

namespace RigidHIPlugin {

using Eigen::MatrixXd;
using std::complex;

UniformField::UniformField(const HydrodynamicParticles& particles, double viscosity,
                           const PlaneConditions& conditions, const GridShape& shape,
                           const GridWallFields::PartOfMode& part,
                           const std::function<WaveFactors(double, double)>& waveFactors)
    : particles(particles), viscosity(viscosity), conditions(conditions), shape(shape),
      profiles(GridPlanes::profilesOf(conditions, shape)),
      fluxProfile(GridPlanes::profileOfFlux(conditions, shape)) {
    using Real = PlaneConditions::Real;
    const int numModes = (shape.size[2] + 1) / 2, n = numConditions();
    parts.assign(numModes, 0.0);
    for (int z = 1; z < numModes; z++) parts[z] = part(shape.waveNumber(2, z));
    for (double radius : particles.radii) {
        const auto found = std::find(radii.begin(), radii.end(), radius);
        kind.push_back(found - radii.begin());
        if (found != radii.end()) continue;
        radii.push_back(radius);
        s.push_back(Eigen::ArrayXd::Zero(numModes));
        t.push_back(s.back());
        for (int z = 1; z < numModes; z++) {
            const WaveFactors f = waveFactors(radius, shape.waveNumber(2, z));
            s.back()[z] = f.s;
            t.back()[z] = f.t;
        }
    }
    // Polynomials in the height above the lower plane: the flow P/12 - d/2 + d^2/2P of a force on a
    // plane at the distance d, and the flow of a pressure gradient
    // (PlaneConditions::meanResponseToGradient()).
    const double P = conditions.getPeriod(), H = conditions.getHeight();
    Eigen::Matrix<double, 3, 2> ofPlanes;
    ofPlanes << P / 12, P / 12 - H / 2 + H * H / (2 * P), -0.5, 0.5 - H / P, 0.5 / P, 0.5 / P;
    polynomials.setZero(3, n + 1);
    polynomials.leftCols(2) = ofPlanes * conditions.combinations().transpose().cast<double>();
    if (conditions.hasZeroFlux()) {
        const double middle = conditions.meanResponseToGradient(0), bend = -0.5 + H / (2 * P);
        polynomials.col(2) << middle + bend * H * H / 4, -bend * H, bend;
    }
    polynomials(0, n) = 1;
    const PlaneConditions::Matrix S = conditions.meanPeriodic(),
                                  SY = GridPlanes::truncatedMean(
                                      conditions, profiles, fluxProfile, shape, [&](Real k2) {
                                          return static_cast<Real>(
                                              part(std::sqrt(static_cast<double>(k2))));
                                      });
    const PlaneConditions::Matrix near = S - SY;
    const MatrixXd square = near.cast<double>(), L = square.llt().matrixL();
    factor = L;
    inverseFactor = inverseOf(L).transpose();
    MatrixXd K = MatrixXd::Zero(n + 1, n + 1);
    K.topLeftCorner(n, n) = S.cast<double>();
    K.col(n).head(n) = conditions.meanOfUniform().cast<double>();
    K.row(n) = K.col(n).transpose().eval();
    inverse = inverseOf(K);
    const MatrixXd meanLaw = conditions.meanLaw().cast<double>();
    const Eigen::SelfAdjointEigenSolver<MatrixXd> law(meanLaw);
    root = law.eigenvectors() * law.eigenvalues().cwiseMax(0).cwiseSqrt().asDiagonal();
}

void UniformField::moveTo(const std::vector<OpenMM::Vec3>& positions) {
    const int n = numConditions(), numModes = parts.size();
    for (MatrixXd* of : {&wholeAlong, &wholeAbout}) of->resize(n + 1, particles.size());
    for (MatrixXd* of : {&nearAlong, &nearAbout}) of->resize(n, particles.size());
    for (int i = 0; i < particles.size(); i++) {
        const double z = positions[i][2];  // from the middle
        const Eigen::Matrix<double, 3, 2> felt =
            UniformFlow::felt(z + 0.5 * conditions.getHeight(), particles.radii[i]);
        wholeAlong.col(i) = polynomials.transpose() * felt.col(0);
        wholeAbout.col(i) = polynomials.transpose() * felt.col(1);
        nearAlong.col(i) = wholeAlong.col(i).head(n);
        nearAbout.col(i) = wholeAbout.col(i).head(n);
        for (int m = 1; m < numModes; m++) {
            const double k = shape.waveNumber(2, m), cosine = std::cos(k * z),
                         sine = std::sin(k * z),
                         strength = 2 * parts[m] / (k * k * conditions.getPeriod()),
                         along = strength * s[kind[i]][m],
                         about = 0.5 * k * strength * t[kind[i]][m];
            const auto subtract = [&](int j, double value, bool odd) {
                nearAlong(j, i) -= along * value * (odd ? sine : cosine);
                nearAbout(j, i) -= about * value * (odd ? cosine : -sine);
            };
            for (const GridPlanes::Profile& profile : profiles)
                subtract(profile.unknown, profile.values[m], profile.isImaginary);
            if (!fluxProfile.empty()) subtract(n - 1, fluxProfile[m], false);
        }
    }
}

void UniformField::draw(const ModeNoise& noise) {
    const int n = numConditions(), none = 0;
    const double area = shape.edge[0] * shape.edge[1], scale = 1 / std::sqrt(viscosity * area),
                 ofModes = scale / std::sqrt(shape.edge[2]);
    Numbers own[2], ofLaw[2], sums[2];
    for (int axis = 0; axis < 2; axis++) {
        own[axis].resize(n);
        ofLaw[axis].resize(n);
        sums[axis].setZero(n + 1);
    }
    complex<double> drawn[3];
    for (int j = 0; j < n; j++) {
        noise.fillPlane(&none, 1, 0, j, drawn);
        for (int axis = 0; axis < 2; axis++) {
            own[axis][j] = std::sqrt(2.0) * scale * drawn[axis].real();
            ofLaw[axis][j] = std::sqrt(2.0) * scale * drawn[axis].imag();
        }
    }
    // The velocities of the grid's modes on the planes.
    for (size_t m = 1; m < parts.size(); m++) {
        noise.fill(&none, 1, 0, m, drawn);
        const double factorOfMode = 2 * ofModes * std::sqrt(parts[m]) / shape.waveNumber(2, m);
        for (int axis = 0; axis < 2; axis++) {
            for (const GridPlanes::Profile& profile : profiles)
                sums[axis][profile.unknown] +=
                    factorOfMode * profile.values[m] *
                    (profile.isImaginary ? -drawn[axis].imag() : drawn[axis].real());
            if (!fluxProfile.empty())
                sums[axis][n - 1] += factorOfMode * fluxProfile[m] * drawn[axis].real();
        }
    }
    for (int axis = 0; axis < 2; axis++) {
        nearForces[axis] = inverseFactor * own[axis];
        sums[axis].head(n) += factor * own[axis] - root * ofLaw[axis];
        forces[axis] = -inverse * sums[axis];
    }
}

/** Call task(particle, axis, row of the velocity along it, row of the angular velocity or -1, sign)
 */
template <class Task>
void UniformField::forRows(const Task& task) const {
    for (int i = 0; i < particles.size(); i++)
        for (int axis = 0; axis < 2; axis++) {
            const int row = particles.firstRow[i];
            // V_x with W_y, and V_y with -W_x
            task(i, axis, row + axis, particles.hasTorque[i] ? row + 4 - axis : -1,
                 axis == 0 ? 1.0 : -1.0);
        }
}

void UniformField::addTo(double* velocities) const {
    forRows([&](int i, int axis, int along, int about, double sign) {
        velocities[along] +=
            nearAlong.col(i).dot(nearForces[axis]) + wholeAlong.col(i).dot(forces[axis]);
        if (about >= 0)
            velocities[about] += sign * (nearAbout.col(i).dot(nearForces[axis]) +
                                         wholeAbout.col(i).dot(forces[axis]));
    });
}

void UniformField::subtractProduct(const double* of, double* velocities) const {
    Numbers sums[2] = {Numbers::Zero(numConditions()), Numbers::Zero(numConditions())};
    forRows([&](int i, int axis, int along, int about, double sign) {
        sums[axis] += of[along] * nearAlong.col(i);
        if (about >= 0) sums[axis] += sign * of[about] * nearAbout.col(i);
    });
    const double scale = 8 * M_PI / (shape.edge[0] * shape.edge[1]);
    for (Numbers& sum : sums)
        sum = scale * (inverseFactor * (inverseFactor.transpose() * sum)).eval();
    forRows([&](int i, int axis, int along, int about, double sign) {
        velocities[along] -= nearAlong.col(i).dot(sums[axis]);
        if (about >= 0) velocities[about] -= sign * nearAbout.col(i).dot(sums[axis]);
    });
}

}  // namespace RigidHIPlugin
