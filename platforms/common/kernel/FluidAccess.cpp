#include "kernel/FluidAccess.h"

#include <string>

#include "context/ContextMirror.h"
#include "context/Messages.h"
#include "fluid/StressReader.h"
#include "stepping/Stepper.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

namespace {

vector<double> rowAfterRow(const Eigen::MatrixXd& matrix) {
    vector<double> result(matrix.size());
    for (int i = 0; i < matrix.rows(); i++)
        for (int k = 0; k < matrix.cols(); k++) result[i * matrix.cols() + k] = matrix(i, k);
    return result;
}

Eigen::Map<const Eigen::VectorXd> asVector(const vector<double>& numbers) {
    return Eigen::Map<const Eigen::VectorXd>(numbers.data(), numbers.size());
}

vector<double> asNumbers(const Eigen::VectorXd& v) {
    return vector<double>(v.data(), v.data() + v.size());
}

class FluidAccess : public FluidInContext {
public:
    FluidAccess(Scene& scene, ContextMirror& mirror, Stepper& stepper)
        : scene(scene), mirror(mirror), stepper(stepper) {}

    void updateParameters(const MobilityForce& force) override { scene.fluid.update(force); }

    // ---- Mobility and friction ------------------------------------------------------------------

    vector<double> getMobility() override {
        Fluid& fluid = prepare("getMobilityInContext()");
        return rowAfterRow(fluid.getAnswers().mobility(scene.bodies, scene.arrays->positions()));
    }

    vector<double> getFriction() override {
        Fluid& fluid = prepare("getFrictionInContext()");
        return rowAfterRow(fluid.getAnswers().friction(scene.bodies, scene.arrays->positions()));
    }

    vector<double> applyMobility(const vector<double>& wrenches) override {
        Fluid& fluid = prepare("applyMobilityInContext()");
        if ((int)wrenches.size() != 6 * scene.bodies.getNumBodies())
            fail("applyMobilityInContext() was given " + to_string(wrenches.size()) +
                 " numbers, but the Context has " + to_string(scene.bodies.getNumBodies()) +
                 " bodies; give 6 numbers for each body");
        return asNumbers(
            fluid.getAnswers().apply(asVector(wrenches), scene.bodies, scene.arrays->positions()));
    }

    vector<double> applyBlobMobility(const vector<double>& forces) override {
        Fluid& fluid = prepare("applyBlobMobilityInContext()");
        const int particles = scene.system.getNumParticles();
        if ((int)forces.size() != 3 * particles)
            fail("applyBlobMobilityInContext() was given " + to_string(forces.size()) +
                 " numbers, but the System has " + to_string(particles) +
                 " particles; give 3 numbers for each of them, whether the fluid sees it or not");
        return asNumbers(fluid.getAnswers().applyToBlobs(asVector(forces), scene.bodies,
                                                         scene.arrays->positions()));
    }

    // ---- The flow -------------------------------------------------------------------------------

    vector<Vec3> getFlow(const vector<Vec3>& points) override {
        const Velocities velocities =
            prepareFlow("getFlowInContext()").flowAt(points, askForFlow());
        vector<Vec3> result;
        for (int p = 0; p < velocities.cols(); p++)
            result.push_back(Vec3(velocities(0, p), velocities(1, p), velocities(2, p)));
        return result;
    }

    vector<double> getFlowMode(int forceAxis, int waveAxis, int waveVectorIndex) override {
        const auto amplitudes = prepareFlow("getFlowModeInContext()")
                                    .flowMode(forceAxis, waveAxis, waveVectorIndex, askForFlow());
        return {amplitudes[0], amplitudes[1]};
    }

    vector<double> getRandomFlowMode(int forceAxis, int waveAxis, int waveVectorIndex) override {
        const auto amplitudes =
            prepareFlow("getRandomFlowModeInContext()")
                .randomFlowMode(forceAxis, waveAxis, waveVectorIndex, askForFlow());
        return {amplitudes[0], amplitudes[1]};
    }

    OpenMM::Vec3 getMeanFlow() override {
        return prepareFlow("getMeanFlowInContext()").meanFlow(askForFlow());
    }

    OpenMM::Vec3 getRandomMeanFlow() override {
        return prepareFlow("getRandomMeanFlowInContext()").randomMeanFlow(askForFlow());
    }

    vector<double> getStress() override {
        const char* const method = "getStressInContext()";
        const auto scheme = scene.integrator.getScheme();
        StressReader(prepare(method).getContents()).check();
        if (!traitsOf(scheme).isOverdamped())
            fail(string(method) +
                 " is for schemes without momenta, where no body has inertia, and the scheme is " +
                 traitsOf(scheme).name + "; ask with one such as TractionEulerMaruyama");
        if (!scene.arrays->canSetBox())
            fail(string(method) +
                 " strains the box for the stress of OpenMM's forces, which the platform does not "
                 "allow for; ask on the platform CPU or Reference");
        if (scene.bodyForces.isOn(scene.integrator.getIntegrationForceGroups()))
            fail(string(method) +
                 " does not know the stress of a CustomBodyForce; ask in a Context without it, or "
                 "leave its group out by setIntegrationForceGroups()");
        const Eigen::Matrix3d virial = stepper.findVirial();
        stepper.evaluateForces();
        const StepSettings& settings = scene.settings;
        const StressParts parts =
            StressReader(prepare(method).getContents())
                .find(askForFlow(), {settings.h, settings.kT, settings.difference, settings.noise},
                      virial);
        vector<double> numbers;
        for (const Eigen::Matrix3d& part :
             {parts.hydrodynamic, parts.brownian, parts.interparticle, parts.ideal})
            for (double x : rowAfterRow(part)) numbers.push_back(x);
        return numbers;
    }

private:
    /** The fluid, after taking in changes; without a fluid an error that names the method. */
    Fluid& prepare(const char* method) {
        mirror.requirePositions(method);
        mirror.takeInChanges();
        if (!scene.fluid) fail(string(method) + " needs a MobilityForce in the System");
        scene.fluid.adoptSettings();
        scene.fluid.adoptBox();
        return *scene.fluid.get();
    }

    /** prepare() for the flow, and evaluate present forces if the flow is theirs. */
    FlowReader& prepareFlow(const char* method) {
        Fluid& fluid = prepare(method);
        if (scene.integrator.getTemperature() > 0 && fluid.getContents().hasOneFlow() &&
            fluid.getContents().losesFlowOfNoise())
            fail(string(method) +
                 " includes the flow of the noise of a step, which model StokesianDynamics with "
                 "solver MatrixFree does not keep; ask at the temperature 0, take the stress "
                 "by getStressInContext(), or use setSolver(Dense)");
        FlowReader& reader = fluid.getFlowReader();
        const auto scheme = scene.integrator.getScheme();
        if (traitsOf(scheme).hasMomenta ||
            reader.findLastStep(scene.bodies, scene.arrays->positions(), scheme))
            return reader;
        stepper.evaluateForces();
        return prepare(method).getFlowReader();
    }

    FlowQuestion askForFlow() {
        scene.arrays->pullVelocities();
        return {scene.bodies,
                *scene.freeParticles,
                scene.arrays->positions(),
                scene.arrays->velocities(),
                scene.integrator.getScheme(),
                scene.prescribedNow()};
    }

    Scene& scene;
    ContextMirror& mirror;
    Stepper& stepper;
};

}  // namespace

unique_ptr<FluidInContext> accessToFluid(Scene& scene, ContextMirror& mirror, Stepper& stepper) {
    return make_unique<FluidAccess>(scene, mirror, stepper);
}

}  // namespace RigidHIPlugin
