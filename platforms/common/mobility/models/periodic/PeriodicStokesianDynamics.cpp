#include "mobility/models/periodic/PeriodicStokesianDynamics.h"

#include <openmm/OpenMMException.h>

#include <algorithm>
#include <cmath>

#include "linearalgebra/CholeskyFactor.h"
#include "linearalgebra/SymmetricProduct.h"
#include "mobility/models/periodic/PeriodicMobility.h"
#include "mobility/models/stokesian/ForceTorqueStresslet.h"
#include "openmmrigidhi/internal/Messages.h"

namespace RigidHIPlugin {

using Eigen::MatrixXd;
using Eigen::Vector3d;

namespace {

/**
 * The largest number of rows of M_FTS. It takes as much memory and time as the largest matrices of
 * the other periodic models.
 */
const int largestRows = 11000;

/**
 * Whether R, and not -R, counts. A sphere with its image on one side is the same pair as the sphere
 * with its image on the other side.
 */
bool isFirstOfTwo(const Vector3d& R) {
    return R[0] > 0 || (R[0] == 0 && (R[1] > 0 || (R[1] == 0 && R[2] > 0)));
}

class PeriodicStokesianDynamicsAt : public SpheresAt {
public:
    explicit PeriodicStokesianDynamicsAt(const PeriodicStokesianDynamics& model)
        : SpheresAt(model), sum(particles, overSurfaces(), true),
          largestRadius(particles.radii.empty()
                            ? 0
                            : *std::max_element(particles.radii.begin(), particles.radii.end())) {}
    void multiply(const MatrixXd& forces, MatrixXd& velocities, const Accuracy&) override;
    void dense(MatrixXd& mobility) override;
    void friction(MatrixXd& friction) override;
    void addFlowAt(const FlowSources& sources, const std::vector<OpenMM::Vec3>& points,
                   double factor, Velocities& velocities) override {
        LatticeSum sumAtPoints(particles, overSurfaces(), true, true);
        sumAtPoints.setBox(box);
        sumAtPoints.addFlowAt(positions, sources, points, factor / (8 * M_PI * viscosity),
                              velocities);
    }

protected:
    void moveTo(const Placement& placement, bool) override;
    void visitPairs(const PairVisitor& visit) const override;
    const StressletResponse& farFieldResponse() override {
        if (responseIsKnown) return response;
        responseIsWanted = true;  // keep the response from now on
        farFieldIsKnown = false;
        makeFarField();
        return response;
    }

private:
    void makeFarField();
    void makeFriction();
    void invert(const MatrixXd& matrix, MatrixXd& inverse);

    LatticeSum sum;
    const double largestRadius;
    BoxVectors box = {};
    std::vector<Vector3d> images;
    StressletResponse response;
    bool responseIsWanted = false, responseIsKnown = false;
    MatrixXd all, strains, coupling, scratch;
    MatrixXd farField, frictionMatrix, mobilityMatrix;
    CholeskyFactor factor;
    bool farFieldIsKnown = false, frictionIsKnown = false, mobilityIsKnown = false;
};

void PeriodicStokesianDynamicsAt::moveTo(const Placement& placement, bool) {
    sum.setBox(placement.box);
    images = sum.getLattice().within(model.getReach().nothing * largestRadius +
                                     sum.getLattice().getReach());
    positions = placement.positions;
    box = placement.box;
    farFieldIsKnown = frictionIsKnown = mobilityIsKnown = responseIsKnown = false;
}

/**
 * Compute the mobility for forces and torques, with the stresslets S = -M_ES^-1 M_EF F that keep
 * every sphere rigid.
 */
void PeriodicStokesianDynamicsAt::makeFarField() {
    if (farFieldIsKnown) return;
    const int rows = particles.numRows, stresslets = sum.getNumRows() - rows;
    sum.compute(positions, true, all);
    farField = all.topLeftCorner(rows, rows);
    coupling = all.bottomLeftCorner(stresslets, rows);
    strains = all.bottomRightCorner(stresslets, stresslets);
    if (!factor.compute(strains)) refuseIndefiniteSpheres(particles.size());
    factor.solveL(coupling);
    if (responseIsWanted) {
        response.factor = factor.L();
        response.halfCoupling = coupling;
    }
    responseIsKnown = responseIsWanted;
    addProductOfColumns(coupling, -1, farField);
    mirrorLower(farField);
    farField *= 1 / (8 * M_PI * viscosity);
    farFieldIsKnown = true;
}

void PeriodicStokesianDynamicsAt::invert(const MatrixXd& matrix, MatrixXd& inverse) {
    const int n = matrix.rows();
    strains = matrix;
    if (!factor.compute(strains)) refuseIndefiniteSpheres(particles.size());
    scratch.setIdentity(n, n);
    factor.solveL(scratch);
    inverse.setZero(n, n);
    addProductOfColumns(scratch, 1, inverse);
    mirrorLower(inverse);
}

void PeriodicStokesianDynamicsAt::makeFriction() {
    if (frictionIsKnown) return;
    makeFarField();
    invert(farField, frictionMatrix);
    if (model.hasLubrication())
        visitPairs([&](const Vector3d& toJ, int i, int j, double w) {
            model.addLubrication(toJ, i, j, w, frictionMatrix);
        });
    frictionIsKnown = true;
}

void PeriodicStokesianDynamicsAt::visitPairs(const PairVisitor& visit) const {
    for (int i = 0; i < particles.size(); i++)
        for (int j = 0; j <= i; j++) {
            const Vector3d toJ = sum.getLattice().wrapped(positions[j] - positions[i]);
            const double mean = (particles.radii[i] + particles.radii[j]) / 2;
            for (const Vector3d& image : images) {
                if (i == j && !isFirstOfTwo(image)) continue;
                const double w = model.getReach().weight((toJ + image).norm() / mean);
                if (w > 0) visit(toJ + image, i, j, w);
            }
        }
}

void PeriodicStokesianDynamicsAt::friction(MatrixXd& friction) {
    makeFriction();
    friction = frictionMatrix;
}

void PeriodicStokesianDynamicsAt::dense(MatrixXd& mobility) {
    if (!model.hasLubrication()) {
        makeFarField();
        mobility = farField;
        return;
    }
    if (!mobilityIsKnown) {
        makeFriction();
        invert(frictionMatrix, mobilityMatrix);
        mobilityIsKnown = true;
    }
    mobility = mobilityMatrix;
}

void PeriodicStokesianDynamicsAt::multiply(const MatrixXd& forces, MatrixXd& velocities,
                                           const Accuracy&) {
    dense(scratch);
    velocities.noalias() = scratch * forces;
}

}  // namespace

namespace {

MobilityTraits inABox(MobilityTraits traits) {
    traits.isIsotropic = false;
    return traits;
}

}  // namespace

PeriodicStokesianDynamics::PeriodicStokesianDynamics(const HydrodynamicParticles& particles,
                                                     double viscosity, bool lubrication,
                                                     double minimumGap,
                                                     const LubricationReach& reach)
    : StokesianDynamics(particles, viscosity, lubrication, minimumGap, true,
                        inABox(traitsOf(lubrication)), reach) {
    checkPeriodicRows(11 * particles.size(), largestRows);
}

WaveFactors PeriodicStokesianDynamics::waveFactors(double radius, double k) const {
    return overSurfaces().waveFactors(radius, k);
}

double PeriodicStokesianDynamics::volume(const BoxVectors& box) const {
    return Lattice(box).getVolume();
}

void PeriodicStokesianDynamics::checkWave(const BoxVectors& box, int axis, int periods) const {
    checkPeriodicWave(box, axis, periods);
}

std::string PeriodicStokesianDynamics::objection(const Placement& placement) const {
    const Lattice lattice(placement.box);
    for (int i = 0; i < particles.size(); i++) {
        const std::string found =
            objectionToPair(i, i, lattice.getShortest(), "the nearest image of ");
        if (!found.empty()) return found;
        for (int j = i + 1; j < particles.size(); j++) {
            const OpenMM::Vec3 d = placement.positions[i] - placement.positions[j];
            const double distance = lattice.nearestImage(d).norm();
            const std::string problem = objectionToPair(
                i, j, distance, d.dot(d) <= distance * distance ? "" : "an image of ");
            if (!problem.empty()) return problem;
        }
    }
    return {};
}

std::unique_ptr<MobilityAt> PeriodicStokesianDynamics::makePlace() const {
    return std::make_unique<PeriodicStokesianDynamicsAt>(*this);
}

}  // namespace RigidHIPlugin
