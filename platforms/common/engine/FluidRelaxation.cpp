// Fluid: what it does to momenta in a step of LangevinHI.

#include <cmath>

#include "engine/BodyPoses.h"
#include "engine/Fluid.h"
#include "mobility/OneBlasThread.h"
#include "rigidbody/EigenVec3.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

namespace {

/** How much more exactly than the tolerance Lanczos' products are taken where they are solves themselves. */
const double innerTolerance = 0.05;

}  // namespace

Thermostat Fluid::bodyThermostat(int body, const BodyInertia& inertia, double kT, double h) const {
    const Group& group = *groups[groupOfBody[body]];
    Thermostat c;
    if (!group.isThermostat) return c;
    const double rate = group.drag_t / inertia.mass;
    c.decay_p = exp(-rate * h);
    c.noise_p = sqrt(-inertia.mass * kT * expm1(-2 * rate * h));
    for (int k = 0; k < 3; k++) {
        if (!inertia.isLive(k)) continue;
        const double rate_k = group.drag_r[k] / inertia.moments[k];
        c.decay_l[k] = exp(-rate_k * h);
        c.noise_l[k] = sqrt(-inertia.moments[k] * kT * expm1(-2 * rate_k * h));
    }
    return c;
}

bool Fluid::freeThermostat(int freeParticle, double mass, double kT, double h, Thermostat& thermostat) const {
    if (groupOfFree[freeParticle] < 0) return false;
    thermostat = Thermostat();
    const Group& group = *groups[groupOfFree[freeParticle]];
    if (!group.isThermostat) return true;
    const double rate = group.drag_t / mass;
    thermostat.decay_p = exp(-rate * h);
    thermostat.noise_p = sqrt(-mass * kT * expm1(-2 * rate * h));
    return true;
}

/** S = T xi T^T, or its inverse = T N T^T: T has m^(-1/2) and I_k^(-1/2) (A e_k)^T, or their reciprocals. */
void Fluid::scaleToZ(Group& group, const BodySet& bodies, const FreeParticles& freeParticles, bool inverse) {
    const MatrixXd& matrix = inverse ? group.mobility->mobility() : group.mobility->friction();
    const auto& elements = group.mobility->getElements();
    group.relaxation.half.resize(group.relaxation.numZ, matrix.cols());
    group.relaxation.S.resize(group.relaxation.numZ, group.relaxation.numZ);
    const auto weight = [&](double inertia) { return inverse ? sqrt(inertia) : 1 / sqrt(inertia); };
    for (int pass = 0; pass < 2; pass++)
        for (size_t e = 0; e < elements.size(); e++) {
            const int row = group.mobility->firstRow(e), z = group.relaxation.firstZ[e];
            const double mass =
                elements[e].isFree() ? freeParticles.mass(group.freeIndex[e]) : bodies.inertia(elements[e].body).mass;
            if (pass == 0)
                group.relaxation.half.middleRows<3>(z) = weight(mass) * matrix.middleRows<3>(row);
            else
                group.relaxation.S.middleCols<3>(z) = weight(mass) * group.relaxation.half.middleCols<3>(row);
            if (elements[e].isFree()) continue;
            const BodyInertia& inertia = bodies.inertia(elements[e].body);
            const Matrix3d& A = group.mobility->getTurn(e);
            for (int k = 0, next = z + 3; k < 3; k++) {
                if (!inertia.isLive(k)) continue;
                const Vector3d axis = weight(inertia.moments[k]) * A.col(k);
                if (pass == 0)
                    group.relaxation.half.row(next++).noalias() = axis.transpose() * matrix.middleRows<3>(row + 3);
                else
                    group.relaxation.S.col(next++).noalias() = group.relaxation.half.middleCols<3>(row + 3) * axis;
            }
        }
}

/** The same by Lanczos on S^-1 = T N T^T (T as in scaleToZ), of which products are enough. */
void Fluid::relaxMatrixFree(Group& group, double h, double kT, const BodySet& bodies,
                            const FreeParticles& freeParticles) {
    const auto& elements = group.mobility->getElements();
    // x -> T^T x, and velocities -> T velocities.
    const auto scale = [&](const MatrixXd& from, MatrixXd& to, bool fromZ) {
        to.resize(fromZ ? group.mobility->getNumRows() : group.relaxation.numZ, from.cols());
        for (size_t e = 0; e < elements.size(); e++) {
            const int z = group.relaxation.firstZ[e], row = group.mobility->firstRow(e);
            if (elements[e].isFree()) {
                to.middleRows<3>(fromZ ? row : z) =
                    sqrt(freeParticles.mass(group.freeIndex[e])) * from.middleRows<3>(fromZ ? z : row);
                continue;
            }
            const BodyInertia& inertia = bodies.inertia(elements[e].body);
            to.middleRows<3>(fromZ ? row : z) = sqrt(inertia.mass) * from.middleRows<3>(fromZ ? z : row);
            if (fromZ) to.middleRows<3>(row + 3).setZero();
            for (int k = 0, next = z + 3; k < 3; k++) {
                if (!inertia.isLive(k)) continue;
                const Vector3d axis = sqrt(inertia.moments[k]) * group.mobility->getTurn(e).col(k);
                if (fromZ)
                    to.middleRows<3>(row + 3).noalias() += axis * from.row(next++);
                else
                    to.row(next++).noalias() = axis.transpose() * from.middleRows<3>(row + 3);
            }
        }
    };
    const auto product = [&](double toleranceOfProducts) {
        return [&, toleranceOfProducts](const MatrixXd& x, MatrixXd& y) {
            scale(x, group.relaxation.wrenches, true);
            group.mobility->applyMatrixFree(group.relaxation.wrenches, innerTolerance * force.getSolverTolerance(),
                                            group.relaxation.twists, toleranceOfProducts);
            scale(group.relaxation.twists, y, false);
        };
    };
    vector<SpectralFunction> functions = {SpectralFunction::decay(h)};
    group.relaxation.columns.resize(group.relaxation.numZ, kT > 0 ? 2 : 1);
    group.relaxation.columns.col(0) = group.relaxation.Z;
    if (kT > 0) {
        group.relaxation.columns.col(1) = sqrt(kT) * group.relaxation.chi;
        functions.push_back(SpectralFunction::decayNoise(h));
    }
    group.relaxation.lanczos->apply(product(0), group.relaxation.columns, functions, group.relaxation.results,
                                    Lanczos::NormOfSum, product(force.getSolverTolerance()));
    if (!group.relaxation.lanczos->isIncrement(0)) group.relaxation.Z.setZero();
    for (int c = 0; c < group.relaxation.results.cols(); c++) group.relaxation.Z += group.relaxation.results.col(c);
    group.iterations += group.relaxation.lanczos->getNumIterations();
}

void Fluid::relaxGroup(Group& group, double h, double kT, const NoiseStream& noise, BodySet& bodies,
                       const FreeParticles& freeParticles, const vector<OpenMM::Vec3>& positions,
                       vector<OpenMM::Vec3>& velocities) {
    const auto& elements = group.mobility->getElements();
    const bool constant = group.mobility->isConstantInBodyFrame();
    group.randomNumbers = group.iterations = 0;
    if (constant)
        group.poses[0] = poseOf(bodies, elements[0].body);
    else
        setPoses(group, bodies, positions);

    const Matrix3d A = constant ? group.poses[0].rotation() : Matrix3d();

    // Z = K^(1/2) (p, l). One body's constant process is known in its own frame, so its p is turned there.
    group.relaxation.Z.resize(group.relaxation.numZ);
    group.relaxation.chi.resize(group.relaxation.numZ);
    for (size_t e = 0; e < elements.size(); e++) {
        const int z = group.relaxation.firstZ[e];
        double numbers[6];
        if (elements[e].isFree()) {
            const int p = elements[e].particles[0];
            group.relaxation.Z.segment<3>(z) = sqrt(freeParticles.mass(group.freeIndex[e])) * toEigen(velocities[p]);
            if (kT == 0) continue;
            loops.fillNoise(noise, NoiseStream::FreeFirstDraw, &p, 1, numbers);
            group.relaxation.chi.segment<3>(z) = Vector3d(numbers[0], numbers[1], numbers[2]);
            group.randomNumbers += 3;
            continue;
        }
        const int b = elements[e].body, s = bodies.slot(b);
        const BodyInertia& inertia = bodies.inertia(b);
        group.relaxation.Z.segment<3>(z) =
            Vector3d(bodies.p[0][s], bodies.p[1][s], bodies.p[2][s]) / sqrt(inertia.mass);
        // Langevin C's numbers, so that with constant isotropic friction this is Langevin C (CONVENTIONS.md).
        if (kT > 0) {
            for (int k = 0; k < 3; k++) noise.pair(NoiseStream::FirstDraw, b, k, numbers[2 * k], numbers[2 * k + 1]);
            group.relaxation.chi.segment<3>(z) = Vector3d(numbers[0], numbers[1], numbers[2]);
            group.randomNumbers += 3 + group.relaxation.numLive[e];
        }
        for (int k = 0, next = z + 3; k < 3; k++) {
            if (!inertia.isLive(k)) continue;
            if (kT > 0) group.relaxation.chi[next] = numbers[3 + k];
            group.relaxation.Z[next++] = bodies.l[k][s] / sqrt(inertia.moments[k]);
        }
        if (constant) {
            group.relaxation.Z.segment<3>(z) = (A.transpose() * group.relaxation.Z.segment<3>(z)).eval();
            group.relaxation.chi.segment<3>(z) = (A.transpose() * group.relaxation.chi.segment<3>(z)).eval();
        }
    }

    if (constant) {
        if (group.relaxation.constantH != h) {
            group.mobility->setPoses({Pose()});
            scaleToZ(group, bodies, freeParticles, false);
            group.relaxation.process.decompose(group.relaxation.S, false);
            group.relaxation.process.matrices(h, group.relaxation.decay, group.relaxation.noise);
            group.relaxation.constantH = h;
        }
        group.relaxation.half.noalias() = group.relaxation.decay * group.relaxation.Z;
        group.relaxation.Z += group.relaxation.half.col(0);
        if (kT > 0) {
            group.relaxation.half.noalias() = group.relaxation.noise * group.relaxation.chi;
            group.relaxation.Z += sqrt(kT) * group.relaxation.half.col(0);
        }
        group.relaxation.Z.segment<3>(0) = (A * group.relaxation.Z.segment<3>(0)).eval();
    } else if (group.relaxation.solvesMatrixFree) {
        relaxMatrixFree(group, h, kT, bodies, freeParticles);
    } else {
        // A dead axis makes S a part of K^(1/2) xi K^(1/2), whose inverse is not that part of the mobility.
        const bool inverse = group.relaxation.deadAxesAreNull && !group.mobility->prefersFriction();
        scaleToZ(group, bodies, freeParticles, inverse);
        group.relaxation.process.decompose(group.relaxation.S, inverse);
        group.relaxation.process.step(h, kT, group.relaxation.Z, group.relaxation.chi);
    }

    for (size_t e = 0; e < elements.size(); e++) {
        const int z = group.relaxation.firstZ[e];
        if (elements[e].isFree()) {
            velocities[elements[e].particles[0]] =
                toVec3(group.relaxation.Z.segment<3>(z) / sqrt(freeParticles.mass(group.freeIndex[e])));
            continue;
        }
        const int s = bodies.slot(elements[e].body);
        const BodyInertia& inertia = bodies.inertia(elements[e].body);
        for (int k = 0; k < 3; k++) bodies.p[k][s] = sqrt(inertia.mass) * group.relaxation.Z[z + k];
        for (int k = 0, next = z + 3; k < 3; k++)
            if (inertia.isLive(k)) bodies.l[k][s] = sqrt(inertia.moments[k]) * group.relaxation.Z[next++];
    }
}

LoopResult Fluid::relax(double h, double kT, const NoiseStream& noise, BodySet& bodies,
                        const FreeParticles& freeParticles, const vector<OpenMM::Vec3>& positions,
                        vector<OpenMM::Vec3>& velocities) {
    const OneBlasThread single;
    const auto task = [&](int i) {
        relaxGroup(*coupledGroups[i], h, kT, noise, bodies, freeParticles, positions, velocities);
    };
    if (operationsPerStep > worthThreads)
        loops.forTasks(coupledGroups.size(), task);
    else
        for (size_t i = 0; i < coupledGroups.size(); i++) task(i);
    LoopResult result;
    for (const Group* group : coupledGroups) {
        result.randomNumbers += group->randomNumbers;
        numSquareRoots += kT > 0;
        numIterations += group->iterations;
        result.finite = result.finite && group->relaxation.Z.allFinite();
    }
    return result;
}

}  // namespace RigidHIPlugin
