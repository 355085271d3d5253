#include "fluid/Relaxation.h"

#include <cmath>

#include "rigid/ErrorBudget.h"
#include "rigidbody/BodyPoses.h"
#include "rigidbody/EigenVec3.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

namespace {

/**
 * The constant process of one body. Its matrices are constant in the body's frame, for each step
 * size and inertia scale.
 */
class ConstantRelaxation : public Relaxation {
public:
    using Relaxation::Relaxation;

protected:
    void evolve(const RelaxationStep& step) override {
        const Matrix3d A = mobility.getTurn(0);
        if (knownH != step.h || knownInertiaScale != step.bodies.getInertiaScale()) {
            mobility.setPoses({Pose()});
            scaling.matrix(false, mobility, step.bodies, step.freeParticles, S);
            process.decompose(S, false);
            process.matrices(step.h, decay, noise);
            knownH = step.h;
            knownInertiaScale = step.bodies.getInertiaScale();
        }
        // l is already in the body's frame. Turn p into this frame and back.
        Z.segment<3>(0) = (A.transpose() * Z.segment<3>(0)).eval();
        change.noalias() = decay * Z;
        if (step.kT > 0) {
            chi.segment<3>(0) = (A.transpose() * chi.segment<3>(0)).eval();
            Z += change;
            change.noalias() = noise * chi;
            Z += sqrt(step.kT) * change;
        } else
            Z += change;
        Z.segment<3>(0) = (A * Z.segment<3>(0)).eval();
    }

private:
    double knownH = -1, knownInertiaScale = 0;  // for which `decay` and `noise` hold
    MatrixXd S, decay, noise;
    VectorXd change;
    FluidOrnsteinUhlenbeck process;
};

/** The process by an eigendecomposition of S. */
class DenseRelaxation : public Relaxation {
public:
    using Relaxation::Relaxation;

protected:
    void evolve(const RelaxationStep& step) override {
        // A dead axis makes S a part of K^(1/2) xi K^(1/2). The inverse of this part is not the
        // same part of the mobility.
        const bool inverse = scaling.deadAxesAreNull() && !mobility.getBodies().prefersFriction();
        scaling.matrix(inverse, mobility, step.bodies, step.freeParticles, S);
        process.decompose(S, inverse);
        process.step(step.h, step.kT, Z, chi);
    }

private:
    MatrixXd S;
    FluidOrnsteinUhlenbeck process;
};

/** The process by Lanczos on S^-1 = T N T^T, which needs products only. */
class KrylovRelaxation : public Relaxation {
public:
    KrylovRelaxation(BodyMobility& mobility, const MomentumScaling& scaling,
                     const GroupMembers& members, double tolerance)
        : Relaxation(mobility, scaling, members), tolerance(tolerance), lanczos(tolerance) {}
    string describeProducts() const override {
        // The process is an iteration of its own, and takes no roots of the mobility.
        const bool iterate = productsIterate();
        return mobility.describeProducts(
            iterate ? ErrorBudget::ofRelaxation(tolerance, iterate) : ErrorBudget(tolerance),
            false);
    }

protected:
    void prepare() override {
        mobility.setErrors(ErrorBudget::ofRelaxation(tolerance, productsIterate()));
    }
    void evolve(const RelaxationStep& step) override {
        const BodyMobility::Solving timed(mobility);
        const auto product = [&](double error, const MatrixXd& x, MatrixXd& y) {
            scaling.wrenches(x, mobility, step.bodies, step.freeParticles, wrenches);
            mobility.multiply(wrenches, twists, {error, Accuracy::Value});
            scaling.scaled(twists, mobility, step.bodies, step.freeParticles, y);
        };
        vector<SpectralFunction> functions = {SpectralFunction::decay(step.h)};
        columns.resize(Z.size(), step.kT > 0 ? 2 : 1);
        columns.col(0) = Z;
        if (step.kT > 0) {
            columns.col(1) = sqrt(step.kT) * chi;
            functions.push_back(SpectralFunction::decayNoise(step.h));
        }
        // For multiblobs a product is a solve, whose own products are inexact where this is
        // accurate enough.
        vector<InexactProduct> inexact;
        if (!productsIterate())
            inexact = ErrorBudget(tolerance).inRoots(mobility.getBodies().getModel(), 1);
        lanczos.apply(product, columns, functions, results, Lanczos::NormOfSum, inexact);
        if (!lanczos.isIncrement(0)) Z.setZero();
        for (int c = 0; c < results.cols(); c++) Z += results.col(c);
        iterations += lanczos.getNumIterations();
    }

private:
    /** Whether products with N are iterations themselves. */
    bool productsIterate() const { return !mobility.getBodies().multipliesWithoutIterations(); }

    const double tolerance;
    Lanczos lanczos;
    MatrixXd columns, results, wrenches, twists;
};

}  // namespace

unique_ptr<Relaxation> makeRelaxation(BodyMobility& mobility, const MomentumScaling& scaling,
                                      const GroupMembers& members, double tolerance) {
    switch (mobility.getWay()) {
        case BodyMobility::Constant:
            return make_unique<ConstantRelaxation>(mobility, scaling, members);
        case BodyMobility::Dense: return make_unique<DenseRelaxation>(mobility, scaling, members);
        case BodyMobility::Krylov: break;
    }
    return make_unique<KrylovRelaxation>(mobility, scaling, members, tolerance);
}

void Relaxation::relax(const vector<Pose>& poses, const RelaxationStep& step) {
    randomNumbers = iterations = 0;
    prepare();
    mobility.setPoses(poses);
    takeMomenta(step);
    Z_start = Z;
    const bool flows = takeMomentaOfFlow(step);
    if (flows) Z -= Z_flow.col(0);
    evolve(step);
    if (flows) Z += Z_flow.col(0);
    giveMomenta(step);
}

/** @return whether the fluid has a flow, driven or of bodies whose motion is prescribed */
bool Relaxation::takeMomentaOfFlow(const RelaxationStep& step) {
    const bool isDriven = members.readPrescribed(step.prescribed, prescribed);
    if (!isDriven && !step.flow) return false;
    if (isDriven) {
        // K U_p is a slip of the free bodies' fluid: U_flow = -xi_ff^-1 xi_fp U_p and the flow's.
        const vector<Pose>& here = mobility.getPoses();
        setTurns(here, turns);
        mobility.getBodies().getFreeMotion().motionOfFixed(turns, prescribed, twistsOfFixed);
        mobility.rigidSlips(here, -twistsOfFixed, slips);
        if (step.flow) {
            mobility.flow().slipsOf(*step.flow, slipsOfFlow);
            slips += slipsOfFlow;
        }
        noWrenches.setZero(mobility.getBodies().getNumRows(), 1);
        mobility.solve(noWrenches, slips, twists);
    } else
        mobility.flow().twistsOf(*step.flow, twists);
    scaling.scaled(twists, mobility, step.bodies, step.freeParticles, Z_flow);
    return true;
}

void Relaxation::getImpulses(const RelaxationStep& step, MatrixXd& impulses) const {
    scaling.wrenches(Z_start - Z, mobility, step.bodies, step.freeParticles, impulses);
}

/** Set Z = K^(1/2) (p, l), and draw a random number for each of its rows. */
void Relaxation::takeMomenta(const RelaxationStep& step) {
    const auto& elements = mobility.getBodies().getElements();
    const BodySet& bodies = step.bodies;
    Z.resize(scaling.getNumRows());
    chi.resize(scaling.getNumRows());
    for (size_t e = 0; e < elements.size(); e++) {
        const int z = scaling.firstRow(e);
        if (elements[e].isWhollyFixed()) continue;
        double numbers[6];
        if (elements[e].isFree()) {
            const int p = elements[e].particles[0];
            Z.segment<3>(z) = sqrt(step.freeParticles.mass(scaling.getFreeIndex()[e])) *
                              toEigen(step.velocities[p]);
            if (step.kT == 0) continue;
            step.loops.fillNoise(step.noise, NoiseStream::FreeFirstDraw, &p, 1, numbers);
            chi.segment<3>(z) = Vector3d(numbers[0], numbers[1], numbers[2]);
            randomNumbers += 3;
            continue;
        }
        const int b = elements[e].body, s = bodies.slot(b);
        const BodyInertia& inertia = bodies.inertia(b);
        Z.segment<3>(z) =
            Vector3d(bodies.p[0][s], bodies.p[1][s], bodies.p[2][s]) / sqrt(inertia.mass);
        // The random numbers are those of Langevin C, so that with constant isotropic friction this
        // scheme is Langevin C (CONVENTIONS.md).
        if (step.kT > 0) {
            for (int k = 0; k < 3; k++)
                step.noise.pair(NoiseStream::FirstDraw, b, k, numbers[2 * k], numbers[2 * k + 1]);
            chi.segment<3>(z) = Vector3d(numbers[0], numbers[1], numbers[2]);
            randomNumbers += 3 + scaling.getNumLive(e);
        }
        for (int k = 0, next = z + 3; k < 3; k++) {
            if (!inertia.isLive(k)) continue;
            if (step.kT > 0) chi[next] = numbers[3 + k];
            Z[next++] = bodies.l[k][s] / sqrt(inertia.moments[k]);
        }
    }
}

void Relaxation::giveMomenta(const RelaxationStep& step) const {
    const auto& elements = mobility.getBodies().getElements();
    BodySet& bodies = step.bodies;
    for (size_t e = 0; e < elements.size(); e++) {
        const int z = scaling.firstRow(e);
        if (elements[e].isWhollyFixed()) continue;
        if (elements[e].isFree()) {
            step.velocities[elements[e].particles[0]] =
                toVec3(Z.segment<3>(z) / sqrt(step.freeParticles.mass(scaling.getFreeIndex()[e])));
            continue;
        }
        const int s = bodies.slot(elements[e].body);
        const BodyInertia& inertia = bodies.inertia(elements[e].body);
        for (int k = 0; k < 3; k++) bodies.p[k][s] = sqrt(inertia.mass) * Z[z + k];
        for (int k = 0, next = z + 3; k < 3; k++)
            if (inertia.isLive(k)) bodies.l[k][s] = sqrt(inertia.moments[k]) * Z[next++];
    }
}

}  // namespace RigidHIPlugin
