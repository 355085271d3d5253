#include "mobility/models/stokesian/StokesianDynamics.h"

#include <openmm/OpenMMException.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <map>

#include "mobility/StressletBasis.h"
#include "mobility/models/rotneprager/FreeFlow.h"
#include "mobility/models/stokesian/ForceTorqueStresslet.h"
#include "openmmrigidhi/internal/Messages.h"
#include "rigidbody/EigenVec3.h"

namespace RigidHIPlugin {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using OpenMM::OpenMMException;
using OpenMM::Vec3;

namespace {

std::string nameOf(const HydrodynamicParticles& particles, int i) {
    return "particle " + std::to_string(particles.systemIndex[i]) +
           (particles.body[i] < 0 ? " (in no body)"
                                  : " (body " + std::to_string(particles.body[i]) + ")");
}

double distanceBetween(const Vec3& a, const Vec3& b) {
    const Vec3 d = a - b;
    return std::sqrt(d.dot(d));
}

/**
 * Write the Cholesky factor into the lower triangle of a matrix made for these particles, in place.
 */
void factorize(MatrixXd& matrix) {
    const Eigen::LLT<Eigen::Ref<MatrixXd>> factor(matrix);
    if (factor.info() != Eigen::Success) refuseIndefiniteSpheres(matrix.rows() / 6);
}

void inverseFromFactor(const MatrixXd& lower, MatrixXd& scratch, MatrixXd& inverse) {
    scratch.setIdentity(lower.rows(), lower.rows());
    lower.triangularView<Eigen::Lower>().solveInPlace(scratch);
    inverse.setZero(lower.rows(), lower.rows());
    inverse.selfadjointView<Eigen::Lower>().rankUpdate(scratch.transpose());
    inverse.triangularView<Eigen::StrictlyUpper>() = inverse.transpose();
}

}  // namespace

void refuseIndefiniteSpheres(int numSpheres) {
    throw OpenMMException("StokesianDynamics: the matrix of " + std::to_string(numSpheres) +
                          " spheres is not positive definite; look for spheres that overlap by "
                          "more than the minimum gap can make up for: separate them, use smaller "
                          "time steps, or use the model RotnePragerYamakawa");
}

MobilityTraits StokesianDynamics::traitsOf(bool lubrication) {
    MobilityTraits traits("StokesianDynamics");
    traits.mayObject = true;
    traits.isHomogeneous = traits.isIsotropic = true;
    traits.hasStresslets = true;
    traits.hasProducts = false;
    traits.isMadeFromFriction = lubrication;
    return traits;
}

StokesianDynamics::StokesianDynamics(const HydrodynamicParticles& particles, double viscosity,
                                     bool lubrication, double minimumGap, bool selfPairs,
                                     const MobilityTraits& traits)
    : MobilityModel(particles, viscosity, traits), lubrication(lubrication),
      minimumGap(minimumGap) {
    if (!(minimumGap >= 0 && minimumGap < 1))
        throw OpenMMException("StokesianDynamics: the minimum gap is " + text(minimumGap) +
                              " mean radii of a pair; it must be at least 0 (none) and below 1");
    std::map<int, int> particleOfBody;
    for (int i = 0; i < particles.size(); i++) {
        if (!particles.hasTorque[i])
            throw OpenMMException(
                "StokesianDynamics is a model of spheres that rotate, and " + nameOf(particles, i) +
                " has no torque; make it a body of its own, or use the model RotnePragerYamakawa");
        const auto inserted = particleOfBody.emplace(particles.body[i], i);
        if (particles.body[i] >= 0 && !inserted.second)
            throw OpenMMException("StokesianDynamics is a model of single spheres, and body " +
                                  std::to_string(particles.body[i]) + " has particles " +
                                  std::to_string(particles.systemIndex[inserted.first->second]) +
                                  " and " + std::to_string(particles.systemIndex[i]) +
                                  " that the fluid sees; give all but one the radius 0, or use the "
                                  "model RotnePragerYamakawa");
    }
    std::vector<double> radii = particles.radii;
    std::sort(radii.begin(), radii.end());
    radii.erase(std::unique(radii.begin(), radii.end()), radii.end());
    for (double radius : particles.radii)
        kind.push_back(std::lower_bound(radii.begin(), radii.end(), radius) - radii.begin());
    if (!lubrication) return;
    if (!radii.empty() && radii.back() > TwoSphereResistance::maximumRatio * radii.front()) {
        const auto extremes = std::minmax_element(particles.radii.begin(), particles.radii.end());
        throw OpenMMException(
            "StokesianDynamics: the radii " + text(*extremes.second) + " nm of " +
            nameOf(particles, extremes.second - particles.radii.begin()) + " and " +
            text(*extremes.first) + " nm of " +
            nameOf(particles, extremes.first - particles.radii.begin()) + " have the ratio " +
            text(*extremes.second / *extremes.first) + "; lubrication is known up to a ratio of " +
            text(TwoSphereResistance::maximumRatio) +
            ": turn it off by setLubrication(False), or use the model RotnePragerYamakawa");
    }
    std::vector<int> copies(radii.size());
    for (int k : kind) copies[k]++;
    tables.resize(radii.size());
    for (size_t larger = 0; larger < radii.size(); larger++) {
        tables[larger].resize(larger + 1);
        for (size_t smaller = 0; smaller <= larger; smaller++)
            if (smaller < larger || selfPairs || copies[larger] > 1)
                tables[larger][smaller] = TwoSphereResistance::get(radii[smaller] / radii[larger]);
    }
}

bool StokesianDynamics::overlaps(const std::vector<Vec3>& positions, int& i, int& j) const {
    if (minimumGap > 0) return false;
    for (i = 0; i < particles.size(); i++)
        for (j = i + 1; j < particles.size(); j++)
            if (distanceBetween(positions[i], positions[j]) <=
                particles.radii[i] + particles.radii[j])
                return true;
    return false;
}

std::string StokesianDynamics::objectionToPair(int i, int j, double distance,
                                               const char* image) const {
    const double contact = particles.radii[i] + particles.radii[j];
    if (minimumGap > 0 && distance > 0) return {};
    if (minimumGap > 0)
        return "StokesianDynamics: " + nameOf(particles, i) + " and " + image +
               nameOf(particles, j) +
               " are at the same place, so their line of centres has no direction; move one of "
               "them";
    if (distance > contact) return {};
    return "StokesianDynamics: " + nameOf(particles, i) + " and " + image + nameOf(particles, j) +
           " overlap or touch: their distance is " + text(distance) +
           " nm, the sum of their radii " + text(contact) +
           " nm; separate the particles, allow overlap by setMinimumGap(), or use the model "
           "RotnePragerYamakawa";
}

std::string StokesianDynamics::objection(const Placement& placement) const {
    const std::vector<Vec3>& at = placement.positions;
    for (int i = 0; i < particles.size(); i++)
        for (int j = i + 1; j < particles.size(); j++) {
            const std::string found = objectionToPair(i, j, distanceBetween(at[i], at[j]), "");
            if (!found.empty()) return found;
        }
    return {};
}

void StokesianDynamics::addLubrication(const Vector3d& toJ, int i, int j, double weight,
                                       MatrixXd& friction) const {
    const bool swapped =
        particles.radii[i] < particles.radii[j];  // tables are for sphere 1 the larger
    if (swapped) std::swap(i, j);
    const double a[2] = {particles.radii[i], particles.radii[j]}, mean = (a[0] + a[1]) / 2;
    const double distance = std::sqrt(toJ[0] * toJ[0] + toJ[1] * toJ[1] + toJ[2] * toJ[2]);
    const double gap = std::max((distance - a[0] - a[1]) / mean, minimumGap);
    const TwoSphereValues<double> f = tables[kind[i]][kind[j]]->correction(gap);

    const Vector3d d = (swapped ? -1.0 : 1.0) * toJ / distance;
    const Matrix3d along = d * d.transpose(), across = Matrix3d::Identity() - along;
    Matrix3d turn;  // T_i = B eps_ijk d_k U_j
    turn << 0, d.z(), -d.y(), -d.z(), 0, d.x(), d.y(), -d.x(), 0;
    const int row[2] = {particles.firstRow[i], particles.firstRow[j]};
    for (int p = 0; p < 2; p++)
        for (int q = 0; q < 2; q++) {
            const double sum = a[p] + a[q], unit = weight * M_PI * viscosity * sum;
            friction.block<3, 3>(row[p], row[q]) +=
                3 * unit * (f[XA11 + p + q] * along + f[YA11 + p + q] * across);
            friction.block<3, 3>(row[p] + 3, row[q] + 3) +=
                unit * sum * sum * (f[XC11 + p + q] * along + f[YC11 + p + q] * across);
            const Matrix3d torqueOfVelocity = unit * sum * f[YB11 + 2 * p + q] * turn;
            friction.block<3, 3>(row[p] + 3, row[q]) += torqueOfVelocity;
            friction.block<3, 3>(row[q], row[p] + 3) += torqueOfVelocity.transpose();
        }
}

Eigen::VectorXd StokesianDynamics::stressletsOf(const StressletResponse& response,
                                                const MatrixXd& forces, const DrivenFlow* flow,
                                                const std::vector<Vec3>& positions) const {
    Eigen::VectorXd rates = Eigen::VectorXd::Zero(5 * particles.size());
    if (flow) strainRates(*flow, positions, rates);
    return response.stresslets(forces.col(0), rates, viscosity);
}

void StokesianDynamics::strainRates(const DrivenFlow& flow, const std::vector<Vec3>& positions,
                                    Eigen::VectorXd& rates) const {
    rates.resize(5 * particles.size());
    for (int i = 0; i < particles.size(); i++)
        rates.segment<5>(5 * i) = inStressletBasis(
            flow.strainRateAt(toEigen(positions[i]), waveFactors(particles.radii[i], flow.k)));
}

namespace {

class StokesianDynamicsAt : public MobilityAt {
public:
    explicit StokesianDynamicsAt(const StokesianDynamics& model)
        : MobilityAt(model), model(model) {}
    void multiply(const MatrixXd& forces, MatrixXd& velocities, const Accuracy&) override;
    void dense(MatrixXd& mobility) override;
    void friction(MatrixXd& friction) override;
    void addStressletsOf(const DrivenFlow& flow, MatrixXd& slips) override {
        makeFarField();
        model.strainRates(flow, positions, rates);
        response.addVelocities(rates, slips.col(0));
    }

    FlowSources sources(const MatrixXd& forces, const DrivenFlow* flow) override {
        FlowSources result;
        multiply(forces, result.forces, Accuracy());
        makeFarField();
        Eigen::LLT<MatrixXd>(farField).solveInPlace(result.forces);
        result.stresslets = model.stressletsOf(response, result.forces, flow, positions);
        return result;
    }
    void addFlowAt(const FlowSources& sources, const std::vector<Vec3>& points, double factor,
                   Velocities& velocities) override {
        addFreeFlowAt(particles, positions, sources, points, factor / (8 * M_PI * viscosity),
                      velocities);
    }

protected:
    void moveTo(const Placement& placement, bool) override;

private:
    // Each matrix is made when it is first asked for.
    void makeFarField();
    void makeFriction();
    void makeFactor();

    const StokesianDynamics& model;
    std::vector<Vec3> positions;
    MatrixXd farField, frictionMatrix, factor, scratch;
    Eigen::VectorXd rates;
    StressletResponse response;  // of the far field
    bool farFieldIsKnown = false, frictionIsKnown = false, factorIsKnown = false;
};

void StokesianDynamicsAt::moveTo(const Placement& placement, bool) {
    positions = placement.positions;
    farFieldIsKnown = frictionIsKnown = factorIsKnown = false;
}

void StokesianDynamicsAt::makeFarField() {
    if (farFieldIsKnown) return;
    computeForceTorqueStressletMobility(particles.radii, positions, viscosity, response, farField);
    farFieldIsKnown = true;
}

void StokesianDynamicsAt::makeFriction() {
    if (frictionIsKnown) return;
    makeFarField();
    factor = farField;
    factorIsKnown = false;
    factorize(factor);
    inverseFromFactor(factor, scratch, frictionMatrix);
    if (model.hasLubrication())
        for (int i = 0; i < particles.size(); i++)
            for (int j = 0; j < i; j++) {
                const Vec3 toJ = positions[j] - positions[i];
                model.addLubrication(Vector3d(toJ[0], toJ[1], toJ[2]), i, j, 1, frictionMatrix);
            }
    frictionIsKnown = true;
}

/** Make the Cholesky factor of the friction. */
void StokesianDynamicsAt::makeFactor() {
    if (factorIsKnown) return;
    makeFriction();
    factor = frictionMatrix;
    factorize(factor);
    factorIsKnown = true;
}

void StokesianDynamicsAt::friction(MatrixXd& friction) {
    makeFriction();
    friction = frictionMatrix;
}

void StokesianDynamicsAt::multiply(const MatrixXd& forces, MatrixXd& velocities, const Accuracy&) {
    if (!model.hasLubrication()) {
        makeFarField();
        velocities.noalias() = farField * forces;
        return;
    }
    makeFactor();
    velocities = forces;
    factor.triangularView<Eigen::Lower>().solveInPlace(velocities);
    factor.triangularView<Eigen::Lower>().transpose().solveInPlace(velocities);
}

void StokesianDynamicsAt::dense(MatrixXd& mobility) {
    if (!model.hasLubrication()) {
        makeFarField();
        mobility = farField;
        return;
    }
    makeFactor();
    inverseFromFactor(factor, scratch, mobility);
}

}  // namespace

std::unique_ptr<MobilityAt> StokesianDynamics::makePlace() const {
    return std::make_unique<StokesianDynamicsAt>(*this);
}

}  // namespace RigidHIPlugin
