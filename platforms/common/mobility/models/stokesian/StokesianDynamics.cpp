#include "mobility/models/stokesian/StokesianDynamics.h"

#include <openmm/OpenMMException.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>

#include "linearalgebra/Decompositions.h"
#include "mobility/StressletBasis.h"
#include "mobility/models/rotneprager/FreeFlow.h"
#include "mobility/models/stokesian/ForceTorqueStresslet.h"
#include "openmmrigidhi/internal/Messages.h"
#include "rigidbody/EigenVec3.h"

namespace RigidHIPlugin {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
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

/** Replace the lower triangle of a matrix of these spheres by its Cholesky factor. */
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
                                     const MobilityTraits& traits, const LubricationReach& reach)
    : MobilityModel(particles, viscosity, traits), lubrication(lubrication), minimumGap(minimumGap),
      reach(reach) {
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

StokesianDynamics::LubricatedPair StokesianDynamics::lubricatedPair(const Vector3d& toJ, int i,
                                                                    int j) const {
    const bool swapped = particles.radii[i] < particles.radii[j];
    if (swapped) std::swap(i, j);
    const double a[2] = {particles.radii[i], particles.radii[j]}, mean = (a[0] + a[1]) / 2;
    const double distance = std::sqrt(toJ[0] * toJ[0] + toJ[1] * toJ[1] + toJ[2] * toJ[2]);
    return {{i, j},
            {a[0], a[1]},
            (swapped ? -1.0 : 1.0) * toJ / distance,
            std::max((distance - a[0] - a[1]) / mean, minimumGap),
            tables[kind[i]][kind[j]].get()};
}

void StokesianDynamics::addLubrication(const Vector3d& toJ, int i, int j, double weight,
                                       MatrixXd& friction) const {
    const LubricatedPair pair = lubricatedPair(toJ, i, j);
    const auto f = pair.table->correctionOfMotion(pair.gap);
    const Vector3d& d = pair.direction;
    const Matrix3d along = d * d.transpose(), across = Matrix3d::Identity() - along;
    const Matrix3d turn = -crossProduct(d);  // T_i = B eps_ijk d_k U_j
    const int row[2] = {particles.firstRow[pair.particle[0]], particles.firstRow[pair.particle[1]]};
    for (int p = 0; p < 2; p++)
        for (int q = 0; q < 2; q++) {
            const double sum = pair.radius[p] + pair.radius[q],
                         unit = weight * M_PI * viscosity * sum;
            friction.block<3, 3>(row[p], row[q]) +=
                3 * unit * (f[XA11 + p + q] * along + f[YA11 + p + q] * across);
            friction.block<3, 3>(row[p] + 3, row[q] + 3) +=
                unit * sum * sum * (f[XC11 + p + q] * along + f[YC11 + p + q] * across);
            const Matrix3d torqueOfVelocity = unit * sum * f[YB11 + 2 * p + q] * turn;
            friction.block<3, 3>(row[p] + 3, row[q]) += torqueOfVelocity;
            friction.block<3, 3>(row[q], row[p] + 3) += torqueOfVelocity.transpose();
        }
}

void StokesianDynamics::addLubricationForces(const Vector3d& toJ, int i, int j, double weight,
                                             const VectorXd& twists, const VectorXd& strains,
                                             VectorXd& forces, VectorXd& stresslets) const {
    const LubricatedPair pair = lubricatedPair(toJ, i, j);
    const TwoSphereValues<double> f = pair.table->correction(pair.gap);
    const Vector3d& d = pair.direction;
    const Eigen::Matrix<double, 3, 5> v = contractBasis(d);
    const Eigen::Matrix<double, 5, 1> s = v.transpose() * d;
    for (int p = 0; p < 2; p++)
        for (int q = 0; q < 2; q++) {
            const int rowP = particles.firstRow[pair.particle[p]],
                      rowQ = particles.firstRow[pair.particle[q]];
            const int strainP = 5 * pair.particle[p], strainQ = 5 * pair.particle[q];
            const double sum = pair.radius[p] + pair.radius[q],
                         unit = weight * M_PI * viscosity * sum;
            const Vector3d U = twists.segment<3>(rowQ), Omega = twists.segment<3>(rowQ + 3);
            const Eigen::Matrix<double, 5, 1> E = strains.segment<5>(strainQ);
            const double b = unit * sum, c = b * sum, m = 5 * c / 6;
            // Forces and torques from velocities, as in addLubrication().
            const auto mixed = [&](double x, double y, const Vector3d& of) -> Vector3d {
                return (x - y) * d.dot(of) * d + y * of;
            };
            forces.segment<3>(rowP) +=
                3 * unit * mixed(f[XA11 + p + q], f[YA11 + p + q], U) +
                unit * (pair.radius[p] + pair.radius[q]) * f[YB11 + 2 * q + p] * d.cross(Omega);
            forces.segment<3>(rowP + 3) += c * mixed(f[XC11 + p + q], f[YC11 + p + q], Omega) -
                                           b * f[YB11 + 2 * p + q] * d.cross(U);
            // Stresslets of velocities: with e_i = e of the direction, G_ijk = X (d_i d_j - 1/3)
            // d_k
            // + Y (d_i 1_jk + d_j 1_ik - 2 d_i d_j d_k), H_ijk = Y (d_i eps_jkm d_m + d_j eps_ikm
            // d_m).
            stresslets.segment<5>(strainP) +=
                b * (f[XG11 + 2 * p + q] * d.dot(U) * s +
                     2 * f[YG11 + 2 * p + q] * (v.transpose() * U - d.dot(U) * s)) -
                2 * c * f[YH11 + 2 * p + q] * (v.transpose() * d.cross(Omega));
            // Forces and torques from strains: the transposes.
            forces.segment<3>(rowP) += b * (f[XG11 + 2 * q + p] * s.dot(E) * d +
                                            2 * f[YG11 + 2 * q + p] * (v * E - s.dot(E) * d));
            forces.segment<3>(rowP + 3) -= 2 * c * f[YH11 + 2 * q + p] * (v * E).cross(d);
            // Stresslets from strains: the parts of azimuthal order 0, 1 and 2 about the direction.
            const Eigen::Matrix<double, 5, 1> part0 = 1.5 * s * s.dot(E),
                                              part1 = 2 * (v.transpose() * (v * E) - s * s.dot(E));
            stresslets.segment<5>(strainP) +=
                m * (f[XM11 + p + q] * part0 + f[YM11 + p + q] * part1 +
                     f[ZM11 + p + q] * (E - part0 - part1));
        }
}

void StokesianDynamics::strainRates(const DrivenFlow& flow, const std::vector<Vec3>& positions,
                                    VectorXd& rates) const {
    rates.resize(5 * particles.size());
    for (int i = 0; i < particles.size(); i++)
        rates.segment<5>(5 * i) = inStressletBasis(
            flow.strainRateAt(toEigen(positions[i]), waveFactors(particles.radii[i], flow.k)));
}

void SpheresAt::lubricationForces(const VectorXd& twists, const VectorXd& strains, VectorXd& forces,
                                  VectorXd& stresslets) const {
    forces.setZero(particles.numRows);
    stresslets.setZero(5 * particles.size());
    if (!model.hasLubrication()) return;
    const auto add = [&](const Vector3d& toJ, int i, int j, double weight) {
        model.addLubricationForces(toJ, i, j, weight, twists, strains, forces, stresslets);
    };
    visitPairs(std::cref(add));  // a std::function of a reference allocates nothing
}

bool SpheresAt::strainsPairs(const DrivenFlow* flow) const {
    // A flow has a wave or a uniform gradient (UserFlow).
    return model.hasLubrication() && flow && flow->hasGradient() && flow->waveVelocity == 0;
}

void SpheresAt::relativeVelocities(const DrivenFlow& flow, VectorXd& velocities) {
    // Without lubrication the stresslets induce the velocities u of the far field. With lubrication
    // R w = M^-1 u + Delta_FE E, which is R (w - u) = Delta_FE E - Delta_FF u.
    //
    // This holds for a flow whose gradient is the mean gradient of the whole suspension. A wave is
    // driven by forces. Then u contains a wave, too, which makes the suspension's flow slower than
    // the driven flow. A pair term slightly resists a common motion of two spheres. In Delta_FF u
    // this would hold the spheres back in the driven flow, as a porous medium does, with a force
    // that does not vanish with k as it must: arrays at a volume fraction of 0.216 would have the
    // viscosities 1.64, 1.77, ... in longer and longer waves, and denser arrays none at all. So a
    // wave gives u alone.
    model.strainRates(flow, positions, ofStrains);
    velocities.setZero(particles.numRows);
    farFieldResponse().addVelocities(ofStrains, velocities);
    if (!strainsPairs(&flow)) return;
    model.strainRates(flow, positions, pairRates);
    pairRates = -pairRates;
    lubricationForces(velocities, pairRates, pairForces, pairStresslets);
    column = -pairForces;
    multiply(column, answer);
    velocities += answer.col(0);
}

void SpheresAt::addStressletsOf(const DrivenFlow& flow, MatrixXd& slips) {
    relativeVelocities(flow, relative);
    slips.col(0) += relative;
}

FlowSources SpheresAt::sources(const MatrixXd& forces, const DrivenFlow* flow, const Accuracy&) {
    FlowSources result;
    result.forces = forces;
    rates.setZero(5 * particles.size());
    if (flow) model.strainRates(*flow, positions, rates);
    VectorXd farForces = forces.col(0), ofPairs = VectorXd::Zero(rates.size());
    if (model.hasLubrication()) {
        VectorXd velocities = VectorXd::Zero(particles.numRows), ofForces;
        pairRates.setZero(rates.size());
        if (strainsPairs(flow)) {
            relativeVelocities(*flow, velocities);
            pairRates = -rates;
        }
        multiply(forces, answer);
        velocities += answer.col(0);
        lubricationForces(velocities, pairRates, ofForces, ofPairs);
        farForces -= ofForces;
    }
    result.stresslets = farFieldResponse().stresslets(farForces, rates, viscosity) + ofPairs;
    return result;
}

namespace {

class StokesianDynamicsAt : public SpheresAt {
public:
    explicit StokesianDynamicsAt(const StokesianDynamics& model) : SpheresAt(model) {}
    void multiply(const MatrixXd& forces, MatrixXd& velocities, const Accuracy&) override;
    void dense(MatrixXd& mobility) override;
    void friction(MatrixXd& friction) override;
    void addFlowAt(const FlowSources& sources, const std::vector<Vec3>& points, double factor,
                   Velocities& velocities) override {
        addFreeFlowAt(particles, positions, sources, points, factor / (8 * M_PI * viscosity),
                      velocities);
    }

protected:
    void moveTo(const Placement& placement, bool) override;
    void visitPairs(const PairVisitor& visit) const override;
    const StressletResponse& farFieldResponse() override {
        makeFarField();
        return response;
    }

private:
    // Each matrix is made on first use.
    void makeFarField();
    void makeFriction();
    void makeFactor();

    MatrixXd farField, frictionMatrix, factor, scratch;
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
        visitPairs([&](const Vector3d& toJ, int i, int j, double weight) {
            model.addLubrication(toJ, i, j, weight, frictionMatrix);
        });
    frictionIsKnown = true;
}

void StokesianDynamicsAt::visitPairs(const PairVisitor& visit) const {
    for (int i = 0; i < particles.size(); i++)
        for (int j = 0; j < i; j++) {
            const Vector3d toJ = toEigen(positions[j] - positions[i]);
            const double mean = (particles.radii[i] + particles.radii[j]) / 2,
                         w = model.getReach().weight(toJ.norm() / mean);
            if (w > 0) visit(toJ, i, j, w);
        }
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
