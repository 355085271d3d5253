#include "openmmrigidhi/MobilityForce.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "openmmrigidhi/CustomRigidHIIntegrator.h"
#include "openmmrigidhi/ModelTraits.h"
#include "openmmrigidhi/RigidHIKernels.h"
#include "openmmrigidhi/internal/Errors.h"
#include "openmmrigidhi/internal/MobilityForceImpl.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

namespace {

constexpr ErrorsOf fail{"MobilityForce"};

/** Water at 298.15 K: 0.89 mPa s, in dalton/(nm ps). */
constexpr double viscosityOfWater = 0.89 * 602.214076;
/** How far a tensor may be from symmetric, relative to its largest entry of the same kind. */
constexpr double symmetryTolerance = 1e-9;
constexpr double smallestTolerance = 1e-14, largestTolerance = 0.1;
/** How far the trace of a velocity gradient may be from 0, relative to its largest entry. */
constexpr double traceTolerance = 1e-12;

/** Check a wave of a velocity across the direction of the wave. */
void checkWave(const char* method, int forceAxis, int waveAxis, int waveVectorIndex) {
    for (int axis : {forceAxis, waveAxis})
        if (axis < 0 || axis > 2)
            fail(method, "an axis is " + text(axis), "it must be 0, 1 or 2, for x, y or z");
    if (forceAxis == waveAxis)
        fail(method, "both axes are " + text(forceAxis),
             "a force along its own wave makes pressure and no flow in an incompressible fluid",
             "give two different axes");
    if (waveVectorIndex < 1)
        fail(method, "the wave-vector index is " + text(waveVectorIndex), "it must be at least 1",
             "give the number of periods in the box");
}

/**
 * Replace a 6 x 6 matrix by its Cholesky factor (lower triangle). @return false if not positive
 * definite
 */
bool factorise(vector<double>& a) {
    for (int j = 0; j < 6; j++) {
        for (int k = 0; k < j; k++)
            for (int i = j; i < 6; i++) a[6 * i + j] -= a[6 * i + k] * a[6 * j + k];
        if (!(a[7 * j] > 0)) return false;
        const double root = sqrt(a[7 * j]);
        for (int i = j; i < 6; i++) a[6 * i + j] /= root;
    }
    return true;
}

vector<double> inverse(const vector<double>& matrix) {
    vector<double> factor(matrix), result(36);
    factorise(factor);
    for (int column = 0; column < 6; column++) {
        double x[6];
        for (int i = 0; i < 6; i++) {
            x[i] = i == column;
            for (int k = 0; k < i; k++) x[i] -= factor[6 * i + k] * x[k];
            x[i] /= factor[7 * i];
        }
        for (int i = 5; i >= 0; i--) {
            for (int k = i + 1; k < 6; k++) x[i] -= factor[6 * k + i] * x[k];
            x[i] /= factor[7 * i];
        }
        for (int i = 0; i < 6; i++) result[6 * i + column] = x[i];
    }
    for (int i = 0; i < 6; i++)
        for (int k = 0; k < i; k++)
            result[6 * i + k] = result[6 * k + i] = 0.5 * (result[6 * i + k] + result[6 * k + i]);
    return result;
}

}  // namespace

MobilityForce::MobilityForce()
    : viscosity(viscosityOfWater), minimumGap(0), solverTolerance(1e-6), gridSpacing(0),
      wallHeight(0), channelLow(0), channelHigh(0), model(RotnePragerYamakawa), boundary(Unbounded),
      sphereWallMobility(FromModel), channelCondition(ZeroPressureGradient), solver(Auto),
      lubrication(AutoLubrication) {}

// The destructor is not inline, so that other libraries do not export it too.
MobilityForce::~MobilityForce() {}

bool MobilityForce::usesPeriodicBoundaryConditions() const { return traitsOf(boundary).isPeriodic; }

int MobilityForce::addParticle(double radius) {
    settingsVersion++;
    radii.push_back(0);
    try {
        setParticleRadius(getNumParticles() - 1, radius);
    } catch (...) {
        radii.pop_back();
        throw;
    }
    return getNumParticles() - 1;
}

double MobilityForce::getParticleRadius(int index) const {
    if (index < 0 || index >= getNumParticles())
        fail("getParticleRadius()", "particle index " + text(index) + " is out of range",
             "the Force has " + text(radii.size()) + " particles, counted from 0",
             "add the particle first");
    return radii[index];
}

void MobilityForce::setParticleRadius(int index, double radius) {
    settingsVersion++;
    if (index < 0 || index >= getNumParticles())
        fail("setParticleRadius()", "particle index " + text(index) + " is out of range",
             "the Force has " + text(radii.size()) + " particles, counted from 0",
             "add the particle first");
    if (!isfinite(radius) || radius < 0)
        fail("particle " + text(index), "hydrodynamic radius is " + text(radius) + " nm",
             "it must be finite and not negative",
             "give a radius, or 0 for a particle that the fluid does not see");
    radii[index] = radius;
}

void MobilityForce::setViscosity(double eta) {
    settingsVersion++;
    if (!isfinite(eta) || eta <= 0)
        fail("setViscosity()", "viscosity is " + text(eta) + " dalton/(nm ps)",
             "it must be finite and positive",
             "give a value above 0; water has 0.89 mPa s = 536 dalton/(nm ps)");
    viscosity = eta;
}

void MobilityForce::setModel(Model model) {
    settingsVersion++;
    if (!hasRow(modelTable, model))
        fail("setModel()", "model " + text(static_cast<int>(model)) + " is unknown",
             "it must be one of " + listOf(modelTable), "use the class constants");
    this->model = model;
}

void MobilityForce::setBoundary(Boundary boundary) {
    settingsVersion++;
    if (!hasRow(boundaryTable, boundary))
        fail("setBoundary()", "boundary " + text(static_cast<int>(boundary)) + " is unknown",
             "it must be one of " + listOf(boundaryTable), "use the class constants");
    this->boundary = boundary;
}

void MobilityForce::setWallHeight(double height) {
    settingsVersion++;
    if (!isfinite(height))
        fail("setWallHeight()", "height is " + text(height) + " nm", "it must be finite",
             "give the z coordinate of the wall");
    wallHeight = height;
}

void MobilityForce::setChannelWalls(double low, double high) {
    settingsVersion++;
    if (!isfinite(low) || !isfinite(high) || !(low < high))
        fail("setChannelWalls()", "the walls are at " + text(low) + " and " + text(high) + " nm",
             "both must be finite, and the first below the second", "give the lower wall first");
    channelLow = low;
    channelHigh = high;
}

void MobilityForce::setChannelCondition(ChannelCondition condition) {
    settingsVersion++;
    if (condition < ZeroPressureGradient || condition > ZeroFlux)
        fail("setChannelCondition()",
             "channel condition " + text(static_cast<int>(condition)) + " is unknown",
             "it must be one of ZeroPressureGradient, ZeroFlux", "use the class constants");
    channelCondition = condition;
}

void MobilityForce::setSphereWallMobility(SphereWallMobility mobility) {
    settingsVersion++;
    if (mobility < FromModel || mobility > BestKnown)
        fail("setSphereWallMobility()",
             "sphere-wall mobility " + text(static_cast<int>(mobility)) + " is unknown",
             "it must be one of FromModel, BestKnown", "use the class constants");
    sphereWallMobility = mobility;
}

void MobilityForce::setLubrication(Lubrication wanted) {
    settingsVersion++;
    if (wanted < AutoLubrication || wanted > Off)
        fail("setLubrication()", "the number " + text(wanted) + " stands for no setting",
             "it must be one of Auto, On, Off", "use the class constants");
    lubrication = wanted;
}

void MobilityForce::setLubrication(Solver wanted) {
    settingsVersion++;
    if (wanted != Auto)
        fail("setLubrication()", "got the number " + text(wanted) + " of a solver",
             "it must be one of Auto, On, Off", "use setSolver() for solvers");
    lubrication = AutoLubrication;
}

void MobilityForce::setLubricationReach(double whole, double nothing) {
    settingsVersion++;
    const double contact = 2;
    if (!(whole == 0 && nothing == 0) &&
        !(isfinite(whole) && isfinite(nothing) && whole >= contact && nothing > whole))
        fail("setLubricationReach()",
             "lubrication is whole up to " + text(whole) + " and nothing from " + text(nothing) +
                 " mean radii on",
             "the first must be at least 2, which is contact, and the second above it, both finite",
             "give two distances of centres in mean radii, or 0, 0 for those of the model");
    wholeLubrication = whole;
    noLubrication = nothing;
}

void MobilityForce::setMinimumGap(double gap) {
    settingsVersion++;
    if (!isfinite(gap) || gap < 0)
        fail("setMinimumGap()", "gap is " + text(gap) + " mean radii",
             "it must be finite and not negative");
    minimumGap = gap;
}

void MobilityForce::setSolver(Solver solver) {
    settingsVersion++;
    if (solver < Auto || solver > MatrixFree)
        fail("setSolver()", "solver " + text(static_cast<int>(solver)) + " is unknown",
             "it must be one of Auto, Dense, MatrixFree", "use the class constants");
    this->solver = solver;
}

void MobilityForce::setSolverTolerance(double tolerance) {
    settingsVersion++;
    if (!(tolerance >= smallestTolerance && tolerance <= largestTolerance))
        fail("setSolverTolerance()", "tolerance is " + text(tolerance),
             "it must be between 1e-14 and 0.1", "give a relative tolerance such as 1e-6");
    solverTolerance = tolerance;
}

void MobilityForce::setGridSpacing(double spacing) {
    settingsVersion++;
    if (!isfinite(spacing) || spacing < 0)
        fail("setGridSpacing()", "spacing is " + text(spacing) + " nm",
             "it must be finite and not negative",
             "give a length, or 0 for the spacing that the solver tolerance needs");
    gridSpacing = spacing;
}

// ---- Driven flows ----

void MobilityForce::setBackgroundFlow(const Vec3& velocity, const vector<double>& gradient) {
    settingsVersion++;
    if (gradient.size() != 9)
        fail("setBackgroundFlow()", "the gradient has " + text(gradient.size()) + " numbers",
             "it must be 3 x 3", "give 9 numbers dv_a/dx_b, row after row");
    double largest = 0;
    for (double x : gradient) {
        if (!isfinite(x))
            fail("setBackgroundFlow()", "the gradient has an entry " + text(x),
                 "all entries must be finite");
        largest = max(largest, abs(x));
    }
    if (!isFinite(velocity))
        fail("setBackgroundFlow()", "the velocity at the origin is " + text(velocity) + " nm/ps",
             "it must be finite");
    const double trace = gradient[0] + gradient[4] + gradient[8];
    if (!(abs(trace) <= traceTolerance * largest))
        fail("setBackgroundFlow()", "the trace of the gradient is " + text(trace) + "/ps",
             "it must be 0 within 1e-12 of the largest entry of the gradient, since the fluid is "
             "incompressible",
             "correct the diagonal of the gradient");
    flowVelocity = velocity;
    flowGradient = gradient;
}

void MobilityForce::getSinusoidalForceDensity(double& f0, int& alongForce, int& alongWave,
                                              int& index) const {
    f0 = forceDensity;
    alongForce = forceAxis;
    alongWave = waveAxis;
    index = waveVectorIndex;
}

void MobilityForce::setSinusoidalForceDensity(double f0, int alongForce, int alongWave, int index) {
    settingsVersion++;
    if (!isfinite(f0))
        fail("setSinusoidalForceDensity()", "f0 is " + text(f0) + " kJ/(mol nm^4)",
             "it must be finite", "give a finite force density, or 0 for none");
    checkWave("setSinusoidalForceDensity()", alongForce, alongWave, index);
    forceDensity = f0;
    forceAxis = alongForce;
    waveAxis = alongWave;
    waveVectorIndex = index;
}

void MobilityForce::setWallVelocity(const Vec3& velocity) {
    settingsVersion++;
    if (!isFinite(velocity) || velocity[2] != 0)
        fail("setWallVelocity()", "the velocity is " + text(velocity) + " nm/ps",
             "it must be finite and along the wall", "give a velocity along x and y, with z = 0");
    wallVelocity = velocity;
}

void MobilityForce::setBodyForceDensity(const Vec3& density) {
    settingsVersion++;
    if (!isFinite(density) || density[2] != 0)
        fail("setBodyForceDensity()", "the force density is " + text(density) + " kJ/(mol nm^4)",
             "it must be finite and along the walls",
             "give a force density along x and y, with z = 0");
    bodyForceDensity = density;
}

void MobilityForce::getShear(double& rate, int& alongFlow, int& alongGradient) const {
    rate = shearRate;
    alongFlow = flowAxis;
    alongGradient = gradientAxis;
}

void MobilityForce::setShear(double rate, int alongFlow, int alongGradient) {
    settingsVersion++;
    if (!isfinite(rate))
        fail("setShear()", "the rate is " + text(rate) + "/ps", "it must be finite",
             "give a finite rate, or 0 for none");
    for (int axis : {alongFlow, alongGradient})
        if (axis < 0 || axis > 2)
            fail("setShear()", "an axis is " + text(axis),
                 "the axes of a flow and its gradient are 0, 1 or 2, for x, y or z");
    if (alongFlow >= alongGradient)
        fail("setShear()",
             "the flow is along axis " + text(alongFlow) + " and its gradient along axis " +
                 text(alongGradient),
             "OpenMM's boxes are lower triangular and tilt along an axis before that of the "
             "gradient only",
             "give the axes (0, 1), (0, 2) or (1, 2), and name the axes of the System to match");
    shearRate = rate;
    flowAxis = alongFlow;
    gradientAxis = alongGradient;
}

// ---- Tensors and groups ----

void MobilityForce::checkTensor(int body, const vector<double>& tensor, const char* method) const {
    if (body < 0)
        fail(method, "body index " + text(body) + " is negative", "bodies are counted from 0");
    const string object = "body " + text(body);
    if (tensor.size() != 36)
        fail(object, "its tensor has " + text(tensor.size()) + " numbers", "it must be 6 x 6",
             "give 36 numbers");
    for (double x : tensor)
        if (!isfinite(x))
            fail(object, "its tensor has an entry " + text(x), "all entries must be finite");
    for (int i = 0; i < 6; i++)
        for (int k = 0; k < i; k++) {
            const double scale = sqrt(abs(tensor[7 * i] * tensor[7 * k]));
            if (!(abs(tensor[6 * i + k] - tensor[6 * k + i]) <= symmetryTolerance * scale))
                fail(object,
                     "its tensor is not symmetric: entries (" + text(i) + ", " + text(k) +
                         ") and (" + text(k) + ", " + text(i) + ") are " + text(tensor[6 * i + k]) +
                         " and " + text(tensor[6 * k + i]),
                     "they must agree to 1e-9", "symmetrise it, or check its rows and columns");
        }
    vector<double> factor(tensor);
    if (!factorise(factor))
        fail(object, "its tensor is not positive definite",
             "the motion of a body must dissipate energy", "check the signs of its entries");
}

void MobilityForce::setBodyMobility(int body, const vector<double>& mobility) {
    settingsVersion++;
    checkTensor(body, mobility, "setBodyMobility()");
    ownTensors[body] = {false, mobility};
}

void MobilityForce::setBodyFriction(int body, const vector<double>& friction) {
    settingsVersion++;
    checkTensor(body, friction, "setBodyFriction()");
    ownTensors[body] = {true, friction};
}

const MobilityForce::OwnTensor& MobilityForce::ownTensor(int body, const char* method) const {
    const auto found = ownTensors.find(body);
    if (found == ownTensors.end())
        fail(method, "body " + text(body) + " has no tensor of its own",
             "only tensors that were set can be returned",
             "call setBodyMobility() or setBodyFriction() first; getMobilityInContext() returns "
             "the mobility that the model gives");
    return found->second;
}

bool MobilityForce::getBodyTensorIsFriction(int body) const {
    return ownTensor(body, "getBodyTensorIsFriction()").isFriction;
}

vector<double> MobilityForce::getBodyMobility(int body) const {
    const OwnTensor& own = ownTensor(body, "getBodyMobility()");
    return own.isFriction ? inverse(own.values) : own.values;
}

vector<double> MobilityForce::getBodyFriction(int body) const {
    const OwnTensor& own = ownTensor(body, "getBodyFriction()");
    return own.isFriction ? own.values : inverse(own.values);
}

void MobilityForce::clearBodyTensor(int body) {
    settingsVersion++;
    ownTensors.erase(body);
}

vector<int> MobilityForce::getBodiesWithOwnTensors() const {
    vector<int> result;
    for (const auto& entry : ownTensors) result.push_back(entry.first);
    return result;
}

void MobilityForce::setBodySlip(int body, const vector<Vec3>& velocities) {
    settingsVersion++;
    if (body < 0)
        fail("setBodySlip()", "the index of the body is " + text(body), "it must be 0 or above");
    for (size_t i = 0; i < velocities.size(); i++)
        if (!isFinite(velocities[i]))
            fail("body " + text(body),
                 "velocity " + text(i) + " of its slip is " + text(velocities[i]) + " nm/ps",
                 "all velocities must be finite");
    slips[body] = velocities;
}

vector<Vec3> MobilityForce::getBodySlip(int body) const {
    const auto found = slips.find(body);
    if (found == slips.end())
        fail("getBodySlip()", "body " + text(body) + " has no slip",
             "only slips that were set can be returned", "call setBodySlip() first");
    return found->second;
}

void MobilityForce::clearBodySlip(int body) {
    settingsVersion++;
    slips.erase(body);
}

vector<int> MobilityForce::getBodiesWithSlip() const {
    vector<int> result;
    for (const auto& entry : slips) result.push_back(entry.first);
    return result;
}

int MobilityForce::addBodyForceOnFluid(int body, const Vec3& site, double radius,
                                       const Vec3& force) {
    settingsVersion++;
    forcesOnFluid.emplace_back();
    try {
        setBodyForceOnFluidParameters(getNumBodyForcesOnFluid() - 1, body, site, radius, force);
    } catch (...) {
        forcesOnFluid.pop_back();
        throw;
    }
    return getNumBodyForcesOnFluid() - 1;
}

void MobilityForce::checkForceOnFluid(int index, const char* method) const {
    if (index < 0 || index >= getNumBodyForcesOnFluid())
        fail(method, "force index " + text(index) + " is out of range",
             "the Force has " + text(forcesOnFluid.size()) + " forces on the fluid, counted from 0",
             "add the force by addBodyForceOnFluid() first");
}

void MobilityForce::getBodyForceOnFluidParameters(int index, int& body, Vec3& site, double& radius,
                                                  Vec3& force) const {
    checkForceOnFluid(index, "getBodyForceOnFluidParameters()");
    const ForceOnFluid& own = forcesOnFluid[index];
    body = own.body;
    site = own.site;
    radius = own.radius;
    force = own.force;
}

void MobilityForce::setBodyForceOnFluidParameters(int index, int body, const Vec3& site,
                                                  double radius, const Vec3& force) {
    settingsVersion++;
    checkForceOnFluid(index, "setBodyForceOnFluidParameters()");
    const string object = "force " + text(index) + " on the fluid";
    if (body < 0) fail(object, "the index of its body is " + text(body), "it must be 0 or above");
    if (!isFinite(site))
        fail(object, "its site is " + text(site) + " nm", "it must be finite",
             "give a place in the body frame");
    if (!isfinite(radius) || radius <= 0)
        fail(object, "the radius of its particle is " + text(radius) + " nm",
             "it must be finite and positive", "give the size of what exerts the force");
    if (!isFinite(force))
        fail(object, "it is " + text(force) + " kJ/(mol nm)", "it must be finite",
             "give a finite force, or 0 for none");
    forcesOnFluid[index] = {body, site, radius, force};
}

void MobilityForce::setGroups(const vector<int>& groups) {
    settingsVersion++;
    for (size_t i = 0; i < groups.size(); i++)
        if (groups[i] < 0)
            fail("body " + text(i), "its group is " + text(groups[i]),
                 "groups are numbered from 0");
    this->groups = groups;
}

// ---- In a Context ----

IntegrateRigidBodiesKernel& MobilityForce::kernelIn(Context& context, const char* method) const {
    getImplInContext(context);  // throws if this Force is not in the Context
    return dynamic_cast<CustomRigidHIIntegrator&>(context.getIntegrator())
        .getKernelForForces(method);
}

void MobilityForce::updateParametersInContext(Context& context) {
    kernelIn(context, "updateParametersInContext()").getFluid().updateParameters(*this);
}

vector<double> MobilityForce::getMobilityInContext(Context& context) const {
    return kernelIn(context, "getMobilityInContext()").getFluid().getMobility();
}

vector<double> MobilityForce::getFrictionInContext(Context& context) const {
    return kernelIn(context, "getFrictionInContext()").getFluid().getFriction();
}

vector<double> MobilityForce::applyMobilityInContext(Context& context,
                                                     const vector<double>& wrenches) const {
    FluidInContext& fluid = kernelIn(context, "applyMobilityInContext()").getFluid();
    for (size_t i = 0; i < wrenches.size(); i++)
        if (!isfinite(wrenches[i]))
            fail("applyMobilityInContext()", "the wrench of body " + text(i / 6) + " is not finite",
                 "forces and torques must be finite");
    return fluid.applyMobility(wrenches);
}

vector<double> MobilityForce::applyBlobMobilityInContext(Context& context,
                                                         const vector<double>& forces) const {
    FluidInContext& fluid = kernelIn(context, "applyBlobMobilityInContext()").getFluid();
    for (size_t i = 0; i < forces.size(); i++)
        if (!isfinite(forces[i]))
            fail("applyBlobMobilityInContext()",
                 "the force on particle " + text(i / 3) + " is not finite",
                 "forces on blobs must be finite");
    return fluid.applyBlobMobility(forces);
}

vector<Vec3> MobilityForce::getFlowInContext(Context& context, const vector<Vec3>& points) const {
    FluidInContext& fluid = kernelIn(context, "getFlowInContext()").getFluid();
    for (size_t i = 0; i < points.size(); i++)
        if (!isFinite(points[i]))
            fail("getFlowInContext()", "point " + text(i) + " is at " + text(points[i]) + " nm",
                 "it must be finite", "give a position in the fluid");
    return fluid.getFlow(points);
}

vector<double> MobilityForce::getFlowModeInContext(Context& context, int alongForce, int alongWave,
                                                   int index) const {
    FluidInContext& fluid = kernelIn(context, "getFlowModeInContext()").getFluid();
    checkWave("getFlowModeInContext()", alongForce, alongWave, index);
    return fluid.getFlowMode(alongForce, alongWave, index);
}

vector<double> MobilityForce::getRandomFlowModeInContext(Context& context, int alongForce,
                                                         int alongWave, int index) const {
    FluidInContext& fluid = kernelIn(context, "getRandomFlowModeInContext()").getFluid();
    checkWave("getRandomFlowModeInContext()", alongForce, alongWave, index);
    return fluid.getRandomFlowMode(alongForce, alongWave, index);
}

Vec3 MobilityForce::getMeanFlowInContext(Context& context) const {
    return kernelIn(context, "getMeanFlowInContext()").getFluid().getMeanFlow();
}

Vec3 MobilityForce::getRandomMeanFlowInContext(Context& context) const {
    return kernelIn(context, "getRandomMeanFlowInContext()").getFluid().getRandomMeanFlow();
}

vector<double> MobilityForce::getStressInContext(Context& context) const {
    return kernelIn(context, "getStressInContext()").getFluid().getStress();
}

ForceImpl* MobilityForce::createImpl() const { return new MobilityForceImpl(*this); }

void MobilityForceImpl::initialize(ContextImpl& context) {
    if (dynamic_cast<CustomRigidHIIntegrator*>(&context.getIntegrator()) == nullptr)
        fail("Context", "its integrator is not a CustomRigidHIIntegrator",
             "another integrator would ignore the fluid",
             "use openmmrigidhi.CustomRigidHIIntegrator, or remove the Force");
}

}  // namespace RigidHIPlugin
