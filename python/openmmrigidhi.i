// The interface between C++ and Python. It is kept thin: it passes numbers, strings, dictionaries,
// and arrays as raw buffers of doubles or 32-bit integers. Units, shapes, defaults and
// documentation are in openmmrigidhi/integrator.py.
%module(package="openmmrigidhi") _bindings

%begin %{
// Lets numpy's integers and floats pass as numbers.
#define SWIG_PYTHON_CAST_MODE
%}

%{
#include <OpenMM.h>

#include <cstring>
#include <exception>

#include "openmmrigidhi/CustomBodyForce.h"
#include "openmmrigidhi/CustomBodyMotion.h"
#include "openmmrigidhi/CustomRigidHIIntegrator.h"
#include "openmmrigidhi/MobilityForce.h"
#include "openmmrigidhi/ModelTraits.h"
#include "openmmrigidhi/SchemeTraits.h"
#include "openmmrigidhi/Version.h"

using RigidHIPlugin::CustomBodyForce;
using RigidHIPlugin::CustomBodyMotion;
using RigidHIPlugin::CustomRigidHIIntegrator;
using RigidHIPlugin::MobilityForce;
using RigidHIPlugin::QuaternionArray;

namespace {

/** Copy a C-contiguous buffer of numbers of one type and a length that is a multiple of the row
 * into a vector. */
template <class Number, class Row>
bool copyBuffer(PyObject* object, const char* format, std::vector<Row>& rows) {
    static_assert(sizeof(Row) % sizeof(Number) == 0, "a row consists of numbers");
    Py_buffer view;
    if (PyObject_GetBuffer(object, &view, PyBUF_C_CONTIGUOUS | PyBUF_FORMAT) != 0) {
        PyErr_SetString(PyExc_TypeError,
                        "openmmrigidhi: expected an object with a C-contiguous buffer");
        return false;
    }
    const bool fits = view.itemsize == sizeof(Number) && view.format != nullptr &&
                      std::strcmp(view.format, format) == 0 && view.len % sizeof(Row) == 0;
    if (fits) {
        rows.resize(view.len / sizeof(Row));
        if (view.len > 0) std::memcpy(static_cast<void*>(rows.data()), view.buf, view.len);
    } else
        PyErr_Format(PyExc_TypeError,
                     "openmmrigidhi: expected a buffer of format '%s' with rows of %zu numbers",
                     format, sizeof(Row) / sizeof(Number));
    PyBuffer_Release(&view);
    return fits;
}

template <class Row>
PyObject* toBuffer(const Row* rows, size_t count) {
    // Writable, so that numpy.frombuffer() needs no copy.
    return PyByteArray_FromStringAndSize(reinterpret_cast<const char*>(rows), count * sizeof(Row));
}

PyObject* toPython(int value) { return PyLong_FromLong(value); }
PyObject* toPython(double value) { return PyFloat_FromDouble(value); }
PyObject* toPython(const std::string& value) {
    return PyUnicode_FromStringAndSize(value.data(), value.size());
}

template <class Value>
PyObject* toDictionary(const std::map<std::string, Value>& entries) {
    PyObject* dictionary = PyDict_New();
    for (const auto& entry : entries) {
        PyObject* value = toPython(entry.second);
        PyDict_SetItemString(dictionary, entry.first.c_str(), value);
        Py_DECREF(value);
    }
    return dictionary;
}

PyObject* toDictionary(const RigidHIPlugin::JointDefinition& joint) {
    using RigidHIPlugin::JointDefinition;
    PyObject* dictionary =
        Py_BuildValue("{sssisisN}", "kind", RigidHIPlugin::jointKindNames[joint.kind], "i", joint.i,
                      "j", joint.j, "anchor_i", toBuffer(&joint.anchor_i, 1));
    const auto add = [&](const char* name, PyObject* value) {
        PyDict_SetItemString(dictionary, name, value);
        Py_DECREF(value);
    };
    add(joint.kind == JointDefinition::BallToPoint ? "point" : "anchor_j",
        toBuffer(&joint.anchor_j, 1));
    if (joint.kind == JointDefinition::Link) add("length", toPython(joint.length));
    if (joint.kind == JointDefinition::Hinge) {
        add("axis_i", toBuffer(&joint.axis_i, 1));
        add("axis_j", toBuffer(&joint.axis_j, 1));
    }
    return dictionary;
}

void setOpenMMException(const char* message) {
    PyObject* openmm = PyImport_ImportModule("openmm");
    PyObject* type = openmm ? PyObject_GetAttrString(openmm, "OpenMMException") : nullptr;
    if (type) PyErr_SetString(type, message);
    Py_XDECREF(type);
    Py_XDECREF(openmm);
}

}  // namespace
%}

%import(module="openmm") "openmm_stub.i"

// ---- Exceptions ---------------------------------------------------------------------------------

%exception {
    try {
        $action
    } catch (const std::exception& error) {
        setOpenMMException(error.what());
        SWIG_fail;
    } catch (...) {
        PyErr_SetString(PyExc_RuntimeError, "openmmrigidhi: unknown C++ exception in $symname");
        SWIG_fail;
    }
}

// Steps are long: other Python threads may run meanwhile.
%exception RigidHIPlugin::CustomRigidHIIntegrator::step {
    std::string failure;
    bool failed = false;
    Py_BEGIN_ALLOW_THREADS
    try {
        $action
    } catch (const std::exception& error) {
        failed = true;
        failure = error.what();
    } catch (...) {
        failed = true;
        failure = "openmmrigidhi: unknown C++ exception in $symname";
    }
    Py_END_ALLOW_THREADS
    if (failed) {
        setOpenMMException(failure.c_str());
        SWIG_fail;
    }
}

// SWIG takes None for a null pointer, also for self.
%typemap(check) SWIGTYPE* {
    if (!$1)
        SWIG_exception_fail(SWIG_TypeError,
                            "openmmrigidhi: in method '$symname', argument $argnum is None");
}

// ---- Arrays -------------------------------------------------------------------------------------

%typemap(in) const std::vector<int>& (std::vector<int> rows) {
    if (!copyBuffer<int>($input, "i", rows)) SWIG_fail;
    $1 = &rows;
}
%typemap(in) const std::vector<double>& (std::vector<double> numbers) {
    if (!copyBuffer<double>($input, "d", numbers)) SWIG_fail;
    $1 = &numbers;
}
%typemap(in) const std::vector<OpenMM::Vec3>& (std::vector<OpenMM::Vec3> rows) {
    if (!copyBuffer<double>($input, "d", rows)) SWIG_fail;
    $1 = &rows;
}
%typemap(in) const std::vector<RigidHIPlugin::QuaternionArray>&
    (std::vector<RigidHIPlugin::QuaternionArray> rows) {
    if (!copyBuffer<double>($input, "d", rows)) SWIG_fail;
    $1 = &rows;
}
%typemap(in) const OpenMM::Vec3& (std::vector<OpenMM::Vec3> rows) {
    if (!copyBuffer<double>($input, "d", rows)) SWIG_fail;
    if (rows.size() != 1)
        SWIG_exception_fail(SWIG_TypeError, "openmmrigidhi: expected a buffer of 3 numbers");
    $1 = &rows[0];
}
%typemap(freearg) const std::vector<int>&, const std::vector<double>&,
                  const std::vector<OpenMM::Vec3>&,
                  const std::vector<RigidHIPlugin::QuaternionArray>&, const OpenMM::Vec3& ""
%typemap(typecheck, precedence=SWIG_TYPECHECK_DOUBLE_ARRAY) const std::vector<int>&,
    const std::vector<OpenMM::Vec3>&, const std::vector<RigidHIPlugin::QuaternionArray>&,
    const OpenMM::Vec3& {
    $1 = PyObject_CheckBuffer($input);
}

%typemap(out) const std::vector<int>& { $result = toBuffer($1->data(), $1->size()); }
%typemap(out) std::vector<int>, std::vector<double> {
    const auto& numbers = $1;
    $result = toBuffer(numbers.data(), numbers.size());
}
%typemap(out) std::vector<OpenMM::Vec3> {
    const std::vector<OpenMM::Vec3>& rows = $1;
    $result = toBuffer(rows.data(), rows.size());
}
%typemap(out) std::vector<RigidHIPlugin::QuaternionArray> {
    const std::vector<RigidHIPlugin::QuaternionArray>& rows = $1;
    $result = toBuffer(rows.data(), rows.size());
}
%typemap(out) OpenMM::Vec3 { $result = toBuffer(&$1, 1); }
%typemap(out) std::string { $result = toPython($1); }
%typemap(out) const std::string& { $result = toPython(*$1); }
%typemap(in) const std::string& (std::string text) {
    Py_ssize_t length = 0;
    const char* utf8 = PyUnicode_Check($input) ? PyUnicode_AsUTF8AndSize($input, &length) : nullptr;
    if (!utf8)
        SWIG_exception_fail(SWIG_TypeError,
                            "openmmrigidhi: expected text as argument $argnum of $symname");
    text.assign(utf8, length);
    $1 = &text;
}
%typemap(freearg) const std::string& ""
%typemap(out) const RigidHIPlugin::JointDefinition& { $result = toDictionary(*$1); }
%typemap(out) std::map<std::string, int>, std::map<std::string, double>,
              std::map<std::string, std::string> {
    $result = toDictionary($1);
}

// References that C++ fills in become a tuple of results.
%typemap(in, numinputs=0) std::vector<int>& particles (std::vector<int> value) "$1 = &value;"
%typemap(in, numinputs=0) std::vector<OpenMM::Vec3>& sitePositions (std::vector<OpenMM::Vec3> value)
    "$1 = &value;"
%typemap(in, numinputs=0) OpenMM::Vec3& principalMoments (OpenMM::Vec3 value) "$1 = &value;"
%typemap(in, numinputs=0) double& mass (double value), double& gamma (double value),
               double& Gamma (double value), double& low (double value),
               double& high (double value), double& f0 (double value),
               double& radius (double value), double& rate (double value),
               double& whole (double value), double& nothing (double value)
    "$1 = &value;"
%typemap(argout) std::vector<int>& particles, std::vector<OpenMM::Vec3>& sitePositions {
    $result = SWIG_AppendOutput($result, toBuffer($1->data(), $1->size()));
}
%typemap(argout) OpenMM::Vec3& principalMoments {
    $result = SWIG_AppendOutput($result, toBuffer($1, 1));
}
%typemap(argout) double& mass, double& gamma, double& Gamma, double& low, double& high,
                 double& f0, double& radius, double& rate, double& whole, double& nothing {
    $result = SWIG_AppendOutput($result, PyFloat_FromDouble(*$1));
}
%typemap(in, numinputs=0) int& bodyIndex (int value), int& body (int value), int& forceAxis (int value),
               int& waveAxis (int value), int& waveVectorIndex (int value),
               int& hinge (int value), int& flowAxis (int value), int& gradientAxis (int value)
    "$1 = &value;"
%typemap(in, numinputs=0) std::vector<double>& parameters (std::vector<double> value),
               std::vector<double>& gradient (std::vector<double> value) "$1 = &value;"
%typemap(in, numinputs=0) OpenMM::Vec3& velocity (OpenMM::Vec3 value),
               OpenMM::Vec3& site (OpenMM::Vec3 value), OpenMM::Vec3& force (OpenMM::Vec3 value)
    "$1 = &value;"
%typemap(argout) OpenMM::Vec3& velocity, OpenMM::Vec3& site, OpenMM::Vec3& force {
    $result = SWIG_AppendOutput($result, toBuffer($1, 1));
}
%typemap(argout) int& bodyIndex, int& body, int& forceAxis, int& waveAxis, int& waveVectorIndex,
                 int& hinge, int& flowAxis, int& gradientAxis {
    $result = SWIG_AppendOutput($result, PyLong_FromLong(*$1));
}
%typemap(argout) std::vector<double>& parameters, std::vector<double>& gradient {
    $result = SWIG_AppendOutput($result, toBuffer($1->data(), $1->size()));
}
%typemap(argout) const std::vector<double>& parameters, const std::vector<double>& gradient,
                 const OpenMM::Vec3& velocity, const OpenMM::Vec3& site,
                 const OpenMM::Vec3& force ""
%typemap(argout) const std::vector<OpenMM::Vec3>& sitePositions,
                 const OpenMM::Vec3& principalMoments, const std::vector<int>& particles ""

%constant const char* version = RIGIDHI_VERSION;
%constant const char* openmmVersionOfBuild = RIGIDHI_OPENMM_VERSION;
%inline %{
std::string versionConflictOfBindings() {
    return RigidHIPlugin::versionConflict("openmmrigidhi", RIGIDHI_VERSION, RIGIDHI_OPENMM_VERSION);
}
std::string libraryPath() { return RigidHIPlugin::getLibraryPath(); }
%}

%include "openmmrigidhi/internal/SchemeList.h"
%include "openmmrigidhi/internal/ModelList.h"
%inline %{
/* The table of schemes: name, number, momenta, needs a fluid, overdamped, weak order, order at
 * T = 0, forces a step, what is differenced, drift, description. */
PyObject* schemeTable() {
    static const char* const differenced[] = {"", "products", "solves", "square roots"};
    PyObject* table = PyList_New(0);
    for (const RigidHIPlugin::SchemeTraits& t : RigidHIPlugin::schemeTable) {
        PyObject* row = Py_BuildValue(
            "(siOOOiiisss)", t.name, static_cast<int>(t.scheme), t.hasMomenta ? Py_True : Py_False,
            t.needsFluid() ? Py_True : Py_False, t.isOverdamped() ? Py_True : Py_False,
            t.weakOrder, t.coldOrder, t.forces, differenced[static_cast<int>(t.differenced)],
            t.drift, t.description);
        PyList_Append(table, row);
        Py_DECREF(row);
    }
    return table;
}
/* The table of boundaries: name, number, periodic, axis across the walls, number of walls,
 * what the walls do, description. */
PyObject* boundaryTable() {
    PyObject* table = PyList_New(0);
    for (const RigidHIPlugin::BoundaryTraits& t : RigidHIPlugin::boundaryTable) {
        PyObject* row = Py_BuildValue("(siOiiss)", t.name, static_cast<int>(t.boundary),
                                      t.isPeriodic ? Py_True : Py_False, t.wallAxis, t.numWalls,
                                      t.walls, t.description);
        PyList_Append(table, row);
        Py_DECREF(row);
    }
    return table;
}
/* The table of models: name, number, names of boundaries, names of boundaries with a grid, takes
 * overlap, takes multiblobs, couples bodies, interactions, cost, description. */
PyObject* modelTable() {
    using namespace RigidHIPlugin;
    PyObject* table = PyList_New(0);
    for (const ModelTraits& t : RigidHIPlugin::modelTable) {
        const std::string boundaries =
            namesIn(RigidHIPlugin::boundaryTable, " ",
                    [&](const BoundaryTraits& b) { return t.hasBoundary(b.boundary); });
        const std::string grids =
            namesIn(RigidHIPlugin::boundaryTable, " ",
                    [&](const BoundaryTraits& b) { return t.hasGrid(b.boundary); });
        PyObject* row = Py_BuildValue(
            "(sissOOOsss)", t.name, static_cast<int>(t.model), boundaries.c_str(), grids.c_str(),
            t.takesOverlap ? Py_True : Py_False, t.takesMultiblobs ? Py_True : Py_False,
            t.couplesBodies ? Py_True : Py_False, t.interactions, t.cost, t.description);
        PyList_Append(table, row);
        Py_DECREF(row);
    }
    return table;
}
%}

// ---- Classes: the declarations of the C++ header, word for word ---------------------------------

namespace OpenMM {
class Vec3;
}

namespace RigidHIPlugin {

struct JointDefinition;

class CustomRigidHIIntegrator : public OpenMM::Integrator {
public:
    enum Scheme : int {
#define RIGIDHI_ROW(name, ...) name,
        RIGIDHI_SCHEMES(RIGIDHI_ROW)
#undef RIGIDHI_ROW
    };
    enum NoiseLaw : int { Gaussian = 0, ThreePoint = 1, TwoPoint = 2 };
    enum WallRejection : int { Overlap = 0, Crossing = 1 };
    enum DriftCorrectorScaling : int { SlipOnly = 0, Whole = 1 };

    CustomRigidHIIntegrator(double temperature, double stepSize);
    ~CustomRigidHIIntegrator();

    int addRigidBody(const std::vector<int>& particles);
    int addRigidBody(const std::vector<int>& particles, double mass,
                     const OpenMM::Vec3& principalMoments,
                     const std::vector<OpenMM::Vec3>& sitePositions);
    int getNumRigidBodies() const;
    int getNumRigidBodiesOfContext() const;
    void getRigidBodyParameters(int index, std::vector<int>& particles, double& mass,
                                OpenMM::Vec3& principalMoments,
                                std::vector<OpenMM::Vec3>& sitePositions) const;
    const std::vector<int>& getRigidBodyParticles(int index) const;
    bool getRigidBodyIsExplicit(int index) const;
    bool getRigidBodyGeometryIsKnown(int index) const;
    void setRigidBodyParameters(int index, const std::vector<int>& particles, double mass,
                                const OpenMM::Vec3& principalMoments,
                                const std::vector<OpenMM::Vec3>& sitePositions);
    void resetBodyGeometry();

    Scheme getScheme() const;
    void setScheme(Scheme scheme);
    NoiseLaw getNoiseLaw() const;
    void setNoiseLaw(NoiseLaw law);
    double getTemperature() const;
    void setTemperature(double temperature);
    double getFriction() const;
    void setFriction(double gamma);
    double getRotationalFriction() const;
    void setRotationalFriction(double Gamma);
    double getInertiaScale() const;
    void setInertiaScale(double factor);
    void setBodyFriction(int index, double gamma, double Gamma);
    void getBodyFriction(int index, double& gamma, double& Gamma) const;
    bool getBodyHasOwnFriction(int index) const;
    void clearBodyFriction(int index);
    void setBodyHeld(int index, bool held);
    bool getBodyHeld(int index) const;
    void setParticleHeld(int particle, bool held);
    bool getParticleHeld(int particle) const;
    std::vector<int> getHeldParticles() const;

    int addBallJoint(int i, const OpenMM::Vec3& anchor_i, int j, const OpenMM::Vec3& anchor_j);
    int addBallJointToPoint(int i, const OpenMM::Vec3& anchor_i, const OpenMM::Vec3& point);
    int addLink(int i, const OpenMM::Vec3& anchor_i, int j, const OpenMM::Vec3& anchor_j,
                double length);
    int addHinge(int i, const OpenMM::Vec3& anchor_i, int j, const OpenMM::Vec3& anchor_j,
                 const OpenMM::Vec3& axis_i, const OpenMM::Vec3& axis_j);
    int getNumJoints() const;
    const JointDefinition& getJointParameters(int index) const;
    int addHingeMotor(int hinge, double rate);
    int getNumHingeMotors() const;
    void getHingeMotorParameters(int index, int& hinge, double& rate) const;
    double getHingeMotorRate(int index) const;
    void setHingeMotorRate(int index, double rate);
    double getJointTolerance() const;
    void setJointTolerance(double tolerance);

    double getGradientRelaxationTime() const;
    void setGradientRelaxationTime(double upsilon);
    double getGradientRotationalRelaxationTime() const;
    void setGradientRotationalRelaxationTime(double Upsilon);
    int getRandomNumberSeed() const;
    void setRandomNumberSeed(int seed);
    int getRandomNumberSeedAsSet() const;
    double getPoseTolerance() const;
    void setPoseTolerance(double tolerance);
    WallRejection getWallRejection() const;
    void setWallRejection(WallRejection rejection);
    DriftCorrectorScaling getDriftCorrectorScaling() const;
    void setDriftCorrectorScaling(DriftCorrectorScaling scaling);
    int getNumHostThreads() const;
    void setNumHostThreads(int number);
    int getMaximumRejections() const;
    void setMaximumRejections(int number);
    double getFiniteDifferenceStep() const;
    void setFiniteDifferenceStep(double relative);
    int getNumRejectedSteps() const;
    void setStepSize(double size);
    void setConstraintTolerance(double tolerance);

    std::vector<OpenMM::Vec3> getBodyPositions() const;
    std::vector<RigidHIPlugin::QuaternionArray> getBodyOrientations() const;
    std::vector<OpenMM::Vec3> getBodyVelocities() const;
    std::vector<OpenMM::Vec3> getBodyAngularVelocities() const;
    void setBodyPositions(const std::vector<OpenMM::Vec3>& positions);
    void setBodyOrientations(const std::vector<RigidHIPlugin::QuaternionArray>& orientations);
    void setBodyVelocities(const std::vector<OpenMM::Vec3>& velocities);
    void setBodyAngularVelocities(const std::vector<OpenMM::Vec3>& angularVelocities);
    std::vector<OpenMM::Vec3> getBodyForces() const;
    std::vector<OpenMM::Vec3> getBodyTorques() const;
    std::vector<double> computeHoldingWrenches() const;
    std::vector<double> getHoldingWrenches() const;
    std::vector<OpenMM::Vec3> computeParticleHoldingForces() const;
    std::vector<OpenMM::Vec3> getParticleHoldingForces() const;
    std::vector<OpenMM::Vec3> getJointForces() const;
    std::vector<double> getHingeMotorTorques() const;
    double getPoseResidual() const;

    double computeTranslationalKineticEnergy() const;
    OpenMM::Vec3 computeRotationalKineticEnergies() const;
    double computeFreeParticleKineticEnergy() const;
    std::map<std::string, int> getDegreesOfFreedom() const;
    double computeSystemTemperature();
    double computeMidStepTemperature() const;
    std::map<std::string, double> computeMidStepTemperatures() const;

    std::string describeEffects() const;
    std::map<std::string, std::string> getEffects() const;
    std::map<std::string, double> getStepStatistics() const;

    void step(int steps);

    %extend {
        /** The same object as this class, or None if it is of another class. Ownership stays. */
        static RigidHIPlugin::CustomRigidHIIntegrator* _fromGeneric(
            OpenMM::Integrator* integrator) {
            return dynamic_cast<CustomRigidHIIntegrator*>(integrator);
        }
    }
};

// Python's own method makes an enumerator of these.
%ignore MobilityForce::setLubrication(bool);
%ignore MobilityForce::setLubrication(Solver);

class MobilityForce : public OpenMM::Force {
public:
    enum Model : int {
#define RIGIDHI_ROW(name, ...) name,
        RIGIDHI_MODELS(RIGIDHI_ROW)
#undef RIGIDHI_ROW
    };
    enum Boundary : int {
#define RIGIDHI_ROW(name, ...) name,
        RIGIDHI_BOUNDARIES(RIGIDHI_ROW)
#undef RIGIDHI_ROW
    };
    enum SphereWallMobility : int { FromModel = 0, BestKnown = 1 };
    enum Lubrication : int { AutoLubrication = 0, On = 1, Off = 2 };
    enum ChannelCondition : int { ZeroPressureGradient = 0, ZeroFlux = 1 };
    enum Solver : int { Auto = 0, Dense = 1, MatrixFree = 2 };

    MobilityForce();
    ~MobilityForce();

    int getNumParticles() const;
    int addParticle(double radius);
    double getParticleRadius(int index) const;
    void setParticleRadius(int index, double radius);
    double getViscosity() const;
    void setViscosity(double eta);
    Model getModel() const;
    void setModel(Model model);
    Boundary getBoundary() const;
    void setBoundary(Boundary boundary);
    double getWallHeight() const;
    void setWallHeight(double height);
    void getChannelWalls(double& low, double& high) const;
    void setChannelWalls(double low, double high);
    ChannelCondition getChannelCondition() const;
    void setChannelCondition(ChannelCondition condition);
    SphereWallMobility getSphereWallMobility() const;
    void setSphereWallMobility(SphereWallMobility mobility);
    Lubrication getLubrication() const;
    void setLubrication(Lubrication lubrication);
    void setLubrication(bool lubrication);
    void setLubrication(Solver lubrication);
    void getLubricationReach(double& whole, double& nothing) const;
    void setLubricationReach(double whole, double nothing);
    double getMinimumGap() const;
    void setMinimumGap(double gap);
    Solver getSolver() const;
    void setSolver(Solver solver);
    double getSolverTolerance() const;
    void setSolverTolerance(double tolerance);
    double getGridSpacing() const;
    void setGridSpacing(double spacing);
    bool getFastSummation() const;
    void setFastSummation(bool enabled);
    void getBackgroundFlow(OpenMM::Vec3& velocity, std::vector<double>& gradient) const;
    void setBackgroundFlow(const OpenMM::Vec3& velocity, const std::vector<double>& gradient);
    void getSinusoidalForceDensity(double& f0, int& forceAxis, int& waveAxis,
                                   int& waveVectorIndex) const;
    void setSinusoidalForceDensity(double f0, int forceAxis, int waveAxis, int waveVectorIndex);
    OpenMM::Vec3 getWallVelocity() const;
    void setWallVelocity(const OpenMM::Vec3& velocity);
    OpenMM::Vec3 getBodyForceDensity() const;
    void setBodyForceDensity(const OpenMM::Vec3& forceDensity);
    void getShear(double& rate, int& flowAxis, int& gradientAxis) const;
    void setShear(double rate, int flowAxis, int gradientAxis);

    void setBodyMobility(int body, const std::vector<double>& mobility);
    void setBodyFriction(int body, const std::vector<double>& friction);
    bool getBodyHasOwnTensor(int body) const;
    bool getBodyTensorIsFriction(int body) const;
    std::vector<double> getBodyMobility(int body) const;
    std::vector<double> getBodyFriction(int body) const;
    void clearBodyTensor(int body);
    std::vector<int> getBodiesWithOwnTensors() const;

    void setBodySlip(int body, const std::vector<OpenMM::Vec3>& velocities);
    std::vector<OpenMM::Vec3> getBodySlip(int body) const;
    void clearBodySlip(int body);
    std::vector<int> getBodiesWithSlip() const;
    int addBodyForceOnFluid(int body, const OpenMM::Vec3& site, double radius,
                            const OpenMM::Vec3& force);
    int getNumBodyForcesOnFluid() const;
    void getBodyForceOnFluidParameters(int index, int& body, OpenMM::Vec3& site, double& radius,
                                       OpenMM::Vec3& force) const;
    void setBodyForceOnFluidParameters(int index, int body, const OpenMM::Vec3& site, double radius,
                                       const OpenMM::Vec3& force);

    const std::vector<int>& getGroups() const;
    void setGroups(const std::vector<int>& groups);

    void updateParametersInContext(OpenMM::Context& context);
    std::vector<double> getMobilityInContext(OpenMM::Context& context) const;
    std::vector<double> getFrictionInContext(OpenMM::Context& context) const;
    std::vector<double> applyMobilityInContext(OpenMM::Context& context,
                                               const std::vector<double>& wrenches) const;
    std::vector<double> applyBlobMobilityInContext(OpenMM::Context& context,
                                                   const std::vector<double>& forces) const;
    std::vector<OpenMM::Vec3> getFlowInContext(OpenMM::Context& context,
                                               const std::vector<OpenMM::Vec3>& points) const;
    std::vector<double> getFlowModeInContext(OpenMM::Context& context, int forceAxis, int waveAxis,
                                             int waveVectorIndex) const;
    std::vector<double> getRandomFlowModeInContext(OpenMM::Context& context, int forceAxis,
                                                   int waveAxis, int waveVectorIndex) const;
    OpenMM::Vec3 getMeanFlowInContext(OpenMM::Context& context) const;
    OpenMM::Vec3 getRandomMeanFlowInContext(OpenMM::Context& context) const;
    std::vector<double> getStressInContext(OpenMM::Context& context) const;
    bool usesPeriodicBoundaryConditions() const;

    %extend {
        /** The same object as this class, or None if it is of another class. Ownership stays. */
        static RigidHIPlugin::MobilityForce* _fromGeneric(OpenMM::Force* force) {
            return dynamic_cast<MobilityForce*>(force);
        }
    }
};

class CustomBodyForce : public OpenMM::Force {
public:
    CustomBodyForce(const std::string& fx, const std::string& fy, const std::string& fz,
                    const std::string& tx, const std::string& ty, const std::string& tz);
    ~CustomBodyForce();

    const std::string& getExpression(const std::string& component) const;
    void setExpression(const std::string& component, const std::string& expression);

    int getNumPerBodyParameters() const;
    int addPerBodyParameter(const std::string& name);
    const std::string& getPerBodyParameterName(int index) const;
    void setPerBodyParameterName(int index, const std::string& name);

    int getNumGlobalParameters() const;
    int addGlobalParameter(const std::string& name, double defaultValue);
    const std::string& getGlobalParameterName(int index) const;
    void setGlobalParameterName(int index, const std::string& name);
    double getGlobalParameterDefaultValue(int index) const;
    void setGlobalParameterDefaultValue(int index, double defaultValue);

    int getNumBodies() const;
    int addBody(int bodyIndex, const std::vector<double>& parameters);
    void getBodyParameters(int index, int& bodyIndex, std::vector<double>& parameters) const;
    void setBodyParameters(int index, int bodyIndex, const std::vector<double>& parameters);

    void updateParametersInContext(OpenMM::Context& context);
    bool usesPeriodicBoundaryConditions() const;

    %extend {
        /** The same object as this class, or None if it is of another class. Ownership stays. */
        static RigidHIPlugin::CustomBodyForce* _fromGeneric(OpenMM::Force* force) {
            return dynamic_cast<CustomBodyForce*>(force);
        }
    }
};

class CustomBodyMotion : public OpenMM::Force {
public:
    enum Frame : int { Lab = 0, Body = 1 };

    CustomBodyMotion(const std::string& vx, const std::string& vy, const std::string& vz,
                     const std::string& wx, const std::string& wy, const std::string& wz);
    ~CustomBodyMotion();

    const std::string& getExpression(const std::string& component) const;
    void setExpression(const std::string& component, const std::string& expression);

    Frame getFrame() const;
    void setFrame(Frame frame);

    int getNumPerBodyParameters() const;
    int addPerBodyParameter(const std::string& name);
    const std::string& getPerBodyParameterName(int index) const;
    void setPerBodyParameterName(int index, const std::string& name);

    int getNumGlobalParameters() const;
    int addGlobalParameter(const std::string& name, double defaultValue);
    const std::string& getGlobalParameterName(int index) const;
    void setGlobalParameterName(int index, const std::string& name);
    double getGlobalParameterDefaultValue(int index) const;
    void setGlobalParameterDefaultValue(int index, double defaultValue);

    int getNumBodies() const;
    int addBody(int bodyIndex, const std::vector<double>& parameters);
    void getBodyParameters(int index, int& bodyIndex, std::vector<double>& parameters) const;
    void setBodyParameters(int index, int bodyIndex, const std::vector<double>& parameters);

    void updateParametersInContext(OpenMM::Context& context);
    bool usesPeriodicBoundaryConditions() const;

    %extend {
        /** The same object as this class, or None if it is of another class. Ownership stays. */
        static RigidHIPlugin::CustomBodyMotion* _fromGeneric(OpenMM::Force* force) {
            return dynamic_cast<CustomBodyMotion*>(force);
        }
    }
};

}  // namespace RigidHIPlugin
