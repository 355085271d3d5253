#include "mobility/models/ewald/WaveField.h"

#include <algorithm>

#include "mobility/StressletBasis.h"
#include "mobility/models/forcecoupling/Envelopes.h"

namespace RigidHIPlugin {

namespace {

using Stresslet = Eigen::Matrix<double, 5, 1>;

}  // namespace

WaveField::WaveField(const HydrodynamicParticles& particles, const std::vector<EwaldKind>& kinds)
    : particles(particles) {
    for (const EwaldKind& kind : kinds) {
        points.emplace_back();
        for (int p = 0; p < particles.size(); p++)
            if (particles.radii[p] == kind.radius) points.back().particles.push_back(p);
        points.back().radius = kind.radius;
        parts.push_back({(int)points.size() - 1, Forces});
        if (kind.torques == 0) continue;
        if (kind.torques < kind.particles) {
            points.emplace_back();
            for (int p = 0; p < particles.size(); p++)
                if (particles.radii[p] == kind.radius && particles.hasTorque[p])
                    points.back().particles.push_back(p);
            points.back().radius = kind.radius;
        }
        parts.push_back({(int)points.size() - 1, kind.stresslets ? Dipoles : Torques});
    }
}

void WaveField::setBox(const SplitBox& box) {
    setGrid(box.splitting.shape, box.splitting.width, box.resolution, box.factors);
}

void WaveField::setGrid(const GridShape& newShape, double width, const GridResolution& resolution,
                        const std::vector<std::unique_ptr<const GridFactors>>& factors) {
    shape = newShape;
    for (Points& these : points) {
        these.asPoints = HydrodynamicParticles();
        for (int p : these.particles)
            these.asPoints.add(radiusOfForceEnvelope(width), false, particles.systemIndex[p], -1);
        these.stencils = std::make_unique<GridStencils>(these.asPoints, resolution);
        these.stencils->layOut(shape);
    }
    channels.clear();
    for (size_t g = 0; g < parts.size(); g++) {
        const Points& these = points[parts[g].points];
        channels.push_back({these.stencils.get(), factors[g].get(), parts[g].moment == Torques,
                            these.radius * these.radius / 6 - 0.5 * width * width,
                            parts[g].moment == Dipoles});
    }
}

void WaveField::moveTo(const std::vector<OpenMM::Vec3>& positions, bool keepAnchors) {
    for (Points& these : points) {
        positionsOfPoints.clear();
        for (int p : these.particles) positionsOfPoints.push_back(positions[p]);
        these.stencils->moveTo(shape, positionsOfPoints, keepAnchors);
    }
}

void WaveField::addProduct(GridFluid& fluid, double viscosity, bool inSingle, const double* forces,
                           double* velocities) {
    gather(forces);
    fluid.multiply(channels, viscosity, inSingle, gathered, results);
    scatterAdd(results.data(), velocities);
}

void WaveField::gather(const double* forces) {
    gathered.resize(rowsOf(channels));
    double* to = gathered.data();
    const Eigen::Matrix3d T = shape.skew.matrix();
    for (const Part& part : parts)
        for (int p : points[part.points].particles) {
            const double* from = forces + particles.firstRow[p] + (part.moment == Forces ? 0 : 3);
            if (part.moment != Dipoles) {
                to = std::copy_n(from, 3, to);
                continue;
            }
            const double* stresslet = forces + particles.numRows + 5 * p;
            // d/dx = T^T d/dx' (GridSkew)
            const Eigen::Matrix<double, 3, 3, Eigen::RowMajor> Q =
                (tensorOfStresslet(Eigen::Map<const Stresslet>(stresslet)) +
                 0.5 * crossProduct(Eigen::Map<const Eigen::Vector3d>(from))) *
                T.transpose();
            std::copy_n(Q.data(), 9, to);
            to += 9;
        }
}

void WaveField::scatterAdd(const double* from, double* velocities) const {
    const Eigen::Matrix3d T = shape.skew.matrix();
    for (const Part& part : parts)
        for (int p : points[part.points].particles) {
            double* const to = velocities + particles.firstRow[p] + (part.moment == Forces ? 0 : 3);
            if (part.moment != Dipoles) {
                for (int c = 0; c < 3; c++) to[c] += *from++;
                continue;
            }
            const Eigen::Matrix3d G =
                Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(from) * T;
            from += 9;
            to[0] += 0.5 * (G(2, 1) - G(1, 2));
            to[1] += 0.5 * (G(0, 2) - G(2, 0));
            to[2] += 0.5 * (G(1, 0) - G(0, 1));
            Eigen::Map<Stresslet>(velocities + particles.numRows + 5 * p) += inStressletBasis(G);
        }
}

void WaveField::draw(GridFluid& fluid, double viscosity, const NoiseStream& noise, uint32_t purpose,
                     std::vector<GridField>& fields) const {
    fluid.draw(channels, viscosity, noise, purpose, fields);
}

void WaveField::draw(GridFluid& fluid, double viscosity, const ModeNoise& noise,
                     std::vector<GridField>& fields) const {
    fluid.draw(channels, viscosity, noise, fields);
}

void WaveField::addAverages(GridFluid& fluid, const std::vector<GridField>& fields,
                            double* velocities) {
    gathered.resize(rowsOf(channels));
    int row = 0;
    for (size_t g = 0; g < channels.size(); g++) {
        const int rows = channels[g].numRows();
        if (channels[g].ofDipoles) {
            fluid.averageGradients(fields[g], *channels[g].stencils, gradients);
            gathered.segment(row, rows) = Eigen::Map<const Eigen::VectorXd>(gradients.data(), rows);
        } else {
            fluid.average(fields[g], *channels[g].stencils, results);
            gathered.segment(row, rows) = results;
        }
        row += rows;
    }
    scatterAdd(gathered.data(), velocities);
}

}  // namespace RigidHIPlugin
