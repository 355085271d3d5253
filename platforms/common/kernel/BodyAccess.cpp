#include "kernel/BodyAccess.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <vector>

#include "context/ContextMirror.h"
#include "context/Effects.h"
#include "context/MidStepTemperatures.h"
#include "context/SystemCheck.h"
#include "context/Warnings.h"
#include "fluid/StepResolution.h"
#include "stepping/Stepper.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

namespace {

class BodyAccess : public BodiesInContext {
public:
    BodyAccess(Scene& scene, ContextMirror& mirror, Stepper& stepper, const string& platform)
        : scene(scene), mirror(mirror), stepper(stepper), platform(platform) {}

    int getNumBodies() const override { return scene.definitions.getNumBodies(); }

    void requireGeometry() override {
        if (!scene.isBuilt())
            prepare("the geometry of bodies that were added by their particles alone");
    }

    // ---- Poses and twists -----------------------------------------------------------------------

    vector<Vec3> getBodyPositions() override {
        prepare("getBodyPositions()");
        return ofBodies([&](int b) { return scene.bodies.getState(b).R; });
    }

    vector<QuaternionArray> getBodyOrientations() override {
        prepare("getBodyOrientations()");
        return ofBodies([&](int b) { return scene.bodies.getState(b).q; });
    }

    vector<Vec3> getBodyVelocities() override {
        prepare("getBodyVelocities()");
        return ofBodies([&](int b) {
            return scene.bodies.getState(b).p / max(scene.bodies.inertia(b).mass, 1e-300);
        });
    }

    vector<Vec3> getBodyAngularVelocities() override {
        prepare("getBodyAngularVelocities()");
        return ofBodies([&](int b) { return scene.bodies.getAngularVelocity_lab(b); });
    }

    void setBodyPositions(const vector<Vec3>& rows) override {
        prepare("setBodyPositions()");
        for (int b = 0; b < scene.bodies.getNumBodies(); b++) {
            BodyState state = scene.bodies.getState(b);
            state.R = rows[b];
            scene.bodies.setState(b, state);
        }
        posesWereSet();
    }

    void setBodyOrientations(const vector<QuaternionArray>& rows) override {
        prepare("setBodyOrientations()");
        BodySet& bodies = scene.bodies;
        for (int b = 0; b < bodies.getNumBodies(); b++) {
            const Vec3 omega_lab = bodies.getAngularVelocity_lab(b);  // the motion in the lab stays
            BodyState state = bodies.getState(b);
            const auto& q = rows[b];
            const double length = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
            const bool same = state.q == q;
            for (int k = 0; k < 4; k++) state.q[k] = q[k] / length;
            if (same) continue;
            bodies.setState(b, state);
            bodies.setAngularVelocity_lab(b, omega_lab);
        }
        posesWereSet();
    }

    void setBodyVelocities(const vector<Vec3>& rows) override {
        prepare("setBodyVelocities()");
        for (int b = 0; b < scene.bodies.getNumBodies(); b++) {
            BodyState state = scene.bodies.getState(b);
            state.p = rows[b] * scene.bodies.inertia(b).mass;
            scene.bodies.setState(b, state);
        }
        twistsWereSet();
    }

    void setBodyAngularVelocities(const vector<Vec3>& rows) override {
        prepare("setBodyAngularVelocities()");
        for (int b = 0; b < scene.bodies.getNumBodies(); b++)
            scene.bodies.setAngularVelocity_lab(b, rows[b]);
        twistsWereSet();
    }

    double getPoseResidual() override {
        prepare("getPoseResidual()");
        return mirror.getPoseResidual();
    }

    // ---- Forces, energies and temperatures ------------------------------------------------------

    vector<Vec3> getBodyForces() override {
        requireGeometry();
        return ofBodies([&](int b) { return scene.bodies.getForce_lab(b); });
    }

    vector<Vec3> getBodyTorques() override {
        requireGeometry();
        return ofBodies([&](int b) { return scene.bodies.getTorque_lab(b); });
    }

    vector<double> computeHoldingWrenches() override {
        return rowsOf(findHolds("computeHoldingWrenches()").ofBodies);
    }

    vector<double> getHoldingWrenches() override {
        return rowsOf(lastHolds("getHoldingWrenches()").ofBodies);
    }

    vector<Vec3> computeParticleHoldingForces() override {
        return vectorsOf(findHolds("computeParticleHoldingForces()").ofParticles);
    }

    vector<Vec3> getParticleHoldingForces() override {
        return vectorsOf(lastHolds("getParticleHoldingForces()").ofParticles);
    }

    vector<Vec3> getJointForces() override {
        prepareFluid("getJointForces()");
        const int count = scene.definitions.joints().size();
        if (count == 0 || !scene.fluid) return vector<Vec3>(count);
        const auto forces = scene.fluid->getAnswers().jointForcesOfLastStep(count);
        vector<Vec3> result;
        for (int k = 0; k < count; k++)
            result.push_back(Vec3(forces(0, k), forces(1, k), forces(2, k)));
        return result;
    }

    vector<double> getHingeMotorTorques() override {
        prepareFluid("getHingeMotorTorques()");
        vector<double> torques(scene.definitions.motors().size());
        if (!torques.empty() && scene.fluid)
            scene.fluid->getAnswers().motorTorquesOfLastStep(torques);
        return torques;
    }

    double computeTranslationalKineticEnergy() override {
        if (!hasMomenta() || !mirror.hasPositions() || isActedOn()) return 0;
        mirror.takeInVelocitiesIfChanged();
        return scene.bodies.translationalKineticEnergy();
    }

    Vec3 computeRotationalKineticEnergies() override {
        if (!hasMomenta() || !mirror.hasPositions() || isActedOn()) return Vec3();
        mirror.takeInVelocitiesIfChanged();
        return scene.bodies.rotationalKineticEnergies();
    }

    double computeFreeParticleKineticEnergy() override {
        if (!hasMomenta() || isActedOn()) return 0;
        scene.adoptInertia();
        scene.arrays->pullVelocities();
        return scene.freeParticles->kineticEnergy(scene.arrays->velocities());
    }

    map<string, int> getDegreesOfFreedom() override {
        if (hasMomenta()) requireGeometry();
        scene.adoptInertia();
        return countDegreesOfFreedom(scene);
    }

    map<string, double> computeMidStepTemperatures() override {
        return midStepTemperatures(scene, stepper.findMidStepEnergies());
    }

    // ---- Effects and counters -------------------------------------------------------------------

    map<string, string> getEffects() override {
        takeInWhatEffectsAreOf();
        return findEffects(scene, platform);
    }

    vector<string> getWarnings() override {
        takeInWhatEffectsAreOf();
        vector<string> texts;
        if (scene.isBuilt())
            for (const auto& warning : findAllWarnings(scene)) texts.push_back(warning.second);
        return texts;
    }

    map<string, double> getStepStatistics() override { return nameCounters(scene); }

    int getNumRejectedSteps() override {
        // The public type is int, but the counter is longer. In a long run the result stays at the
        // largest int instead of becoming negative.
        return static_cast<int>(
            min<long long>(scene.counters.rejectedSteps, numeric_limits<int>::max()));
    }

private:
    void takeInWhatEffectsAreOf() {
        if (!scene.isBuilt() && mirror.hasPositions()) mirror.takeInChanges();
        scene.adoptInertia();
        scene.fluid.takeBox();
    }

    /** Whether bodies are in the middle of a step elsewhere; then only barostats ask. */
    bool isActedOn() const { return scene.native && scene.native->isActedOn(); }

    void prepare(const char* method) {
        mirror.requirePositions(method);
        mirror.takeInChanges();
    }

    template <class Of>
    auto ofBodies(Of of) const -> vector<decltype(of(0))> {
        vector<decltype(of(0))> result;
        for (int b = 0; b < scene.bodies.getNumBodies(); b++) result.push_back(of(b));
        return result;
    }

    // ---- Wrenches and forces that hold bodies and particles

    static vector<double> rowsOf(const Eigen::VectorXd& numbers) {
        return vector<double>(numbers.data(), numbers.data() + numbers.size());
    }
    static vector<Vec3> vectorsOf(const Eigen::VectorXd& numbers) {
        vector<Vec3> result;
        for (int i = 0; i < numbers.size(); i += 3)
            result.push_back(Vec3(numbers[i], numbers[i + 1], numbers[i + 2]));
        return result;
    }
    void prepareFluid(const char* method) {
        prepare(method);
        if (!scene.fluid) return;
        scene.fluid.adoptSettings();
        scene.fluid.adoptBox();
    }

    /** The holds at the present poses, without noise. */
    FluidAnswers::Holds findHolds(const char* method) {
        prepareFluid(method);
        stepper.evaluateForces();
        prepareFluid(method);
        scene.arrays->pullVelocities();
        if (scene.fluid)
            return scene.fluid->getAnswers().holdsNow(
                {scene.bodies, *scene.freeParticles, scene.arrays->positions(),
                 scene.arrays->velocities(), scene.integrator.getScheme(), scene.prescribedNow()});
        // Without a fluid only forces act on held bodies and particles.
        FluidAnswers::Holds holds = noHolds();
        for (int b = 0; b < scene.bodies.getNumBodies(); b++) {
            if (!scene.integrator.getBodyHeld(b)) continue;
            const Vec3 force = scene.bodies.getForce_lab(b), torque = scene.bodies.getTorque_lab(b);
            for (int k = 0; k < 3; k++) {
                holds.ofBodies[6 * b + k] = -force[k];
                holds.ofBodies[6 * b + 3 + k] = -torque[k];
            }
        }
        for (int p : scene.integrator.getHeldParticles())
            for (int k = 0; k < 3; k++)
                holds.ofParticles[3 * p + k] = -scene.arrays->forces()[p][k];
        return holds;
    }

    FluidAnswers::Holds noHolds() const {
        return {Eigen::VectorXd::Zero(6 * scene.bodies.getNumBodies()),
                Eigen::VectorXd::Zero(3 * scene.system.getNumParticles())};
    }
    bool holdsAny() const {
        bool any = scene.bodyMotions.isOn() || !scene.integrator.getHeldParticles().empty();
        for (int b = 0; b < scene.bodies.getNumBodies(); b++)
            any = any || scene.integrator.getBodyHeld(b);
        return any;
    }

    FluidAnswers::Holds lastHolds(const char* method) {
        prepareFluid(method);
        if (!holdsAny()) return noHolds();
        const SchemeTraits& traits = traitsOf(scene.integrator.getScheme());
        if (!traits.needsFluid())
            throw OpenMMException(string("CustomRigidHIIntegrator: ") + method +
                                  " is for schemes in a fluid, not for " + traits.name +
                                  ", whose steps do not record what holds bodies; use the method "
                                  "that computes it at the present poses");
        const FluidAnswers& answers = scene.fluid->getAnswers();
        if (!answers.knowsHoldsOfLastStep())
            throw OpenMMException(
                string("CustomRigidHIIntegrator: ") + method +
                " needs a step since bodies were held or let go; take a step "
                "before, or use the method that computes it at the present poses");
        return answers.holdsOfLastStep(scene.system.getNumParticles());
    }

    bool hasMomenta() const { return traitsOf(scene.integrator.getScheme()).hasMomenta; }

    void posesWereSet() {
        if (scene.fluid) {
            scene.fluid->getMemory().forget();
            interruptWatches(scene.fluid->getContents());
        }
        mirror.writePoses();
        scene.noteChange();
        scene.noiseHistory.stateWasSet(scene);
        scene.watch.restart();
    }

    void twistsWereSet() {
        mirror.writeTwists();
        scene.noiseHistory.stateWasSet(scene);
        scene.watch.restart();
    }

    Scene& scene;
    ContextMirror& mirror;
    Stepper& stepper;
    const string platform;
};

}  // namespace

unique_ptr<BodiesInContext> accessToBodies(Scene& scene, ContextMirror& mirror, Stepper& stepper,
                                           const string& platform) {
    return make_unique<BodyAccess>(scene, mirror, stepper, platform);
}

}  // namespace RigidHIPlugin
