#include "mobility/models/ewald/WaveField.h"

#include <algorithm>

#include "mobility/models/forcecoupling/Envelopes.h"

namespace RigidHIPlugin {

WaveField::WaveField(const HydrodynamicParticles& particles, const std::vector<EwaldKind>& kinds)
    : particles(particles) {
    for (const EwaldKind& kind : kinds) {
        points.emplace_back();
        for (int p = 0; p < particles.size(); p++)
            if (particles.radii[p] == kind.radius) points.back().particles.push_back(p);
        points.back().radius = kind.radius;
        parts.push_back({(int)points.size() - 1, false});
        if (kind.torques == 0) continue;
        if (kind.torques < kind.particles) {
            points.emplace_back();
            for (int p = 0; p < particles.size(); p++)
                if (particles.radii[p] == kind.radius && particles.hasTorque[p])
                    points.back().particles.push_back(p);
            points.back().radius = kind.radius;
        }
        parts.push_back({(int)points.size() - 1, true});
    }
}

void WaveField::setBox(const SplitBox& box) {
    shape = box.splitting.shape;
    for (Points& these : points) {
        these.asPoints = HydrodynamicParticles();
        for (int p : these.particles)
            these.asPoints.add(radiusOfForceEnvelope(box.splitting.width), false,
                               particles.systemIndex[p], -1);
        these.stencils = std::make_unique<GridStencils>(these.asPoints, box.resolution);
        these.stencils->layOut(shape);
    }
    channels.clear();
    for (size_t g = 0; g < parts.size(); g++) {
        const Points& these = points[parts[g].points];
        const double w = box.splitting.width;
        channels.push_back({these.stencils.get(), box.factors[g].get(), parts[g].ofTorques,
                            these.radius * these.radius / 6 - 0.5 * w * w});
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
    gathered.resize(rowsOf(channels));
    double* to = gathered.data();
    for (const Part& part : parts)
        for (int p : points[part.points].particles) {
            const double* from = forces + particles.firstRow[p] + (part.ofTorques ? 3 : 0);
            to = std::copy_n(from, 3, to);
        }
    fluid.multiply(channels, viscosity, inSingle, gathered, results);
    scatterAdd(results.data(), velocities);
}

void WaveField::scatterAdd(const double* from, double* velocities) const {
    for (const Part& part : parts)
        for (int p : points[part.points].particles)
            for (int c = 0; c < 3; c++)
                velocities[particles.firstRow[p] + (part.ofTorques ? 3 : 0) + c] += *from++;
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
        fluid.average(fields[g], *channels[g].stencils, results);
        gathered.segment(row, results.size()) = results;
        row += results.size();
    }
    scatterAdd(gathered.data(), velocities);
}

}  // namespace RigidHIPlugin
