#ifndef RIGIDHI_REFERENCE_SCENES_H_
#define RIGIDHI_REFERENCE_SCENES_H_

#include <map>
#include <string>
#include <vector>

#include "CoupledBodiesSupport.h"
#include "rigid/Joints.h"

namespace RigidHITest {

/** A value of a JSON text. Numbers may be NaN. */
struct JsonValue {
    enum Kind { Null, Boolean, Number, Text, List, Map } kind = Null;
    double number = 0;  // of a Boolean: 0 or 1
    std::string text;
    std::vector<JsonValue> list;
    std::map<std::string, JsonValue> map;

    bool has(const std::string& name) const { return map.count(name) > 0; }
    /** @throws std::runtime_error if this value does not exist */
    const JsonValue& operator[](const std::string& name) const;
    int size() const { return list.size(); }
    const JsonValue& operator[](int i) const { return list.at(i); }
    /** All numbers of a list, with those of its lists one after the other. */
    std::vector<double> numbers() const;
    Eigen::Vector3d vector3() const;
    Eigen::VectorXd column() const;
};
/** @throws std::runtime_error with the place of an error in the text */
JsonValue parseJson(const std::string& text);
/**
 * The file tests/data/NAME.json.
 *
 * @throws std::runtime_error if the file does not exist
 */
JsonValue readTestData(const std::string& name);

/** Bodies and free particles at some poses in a fluid. Components of some of them are fixed. */
struct PosedBodies {
    std::string name;
    std::vector<RigidHIPlugin::FluidElement> elements;
    std::vector<RigidHIPlugin::Pose> poses;
    std::vector<RigidHIPlugin::Joint> joints;
    Eigen::VectorXd motorRates;  // of motors of joints
    RigidHIPlugin::CoupledBodies::ModelFactory makeModel;
    RigidHIPlugin::BoxVectors box = {};
    bool mayBeConstant = true;
    Eigen::MatrixXd wrenches;    // a column; empty: none
    Eigen::MatrixXd velocities;  // prescribed ones of fixed components; empty: they are at rest

    RigidHIPlugin::FluidElement& add(const RigidHIPlugin::FluidElement& element,
                                     const Eigen::Vector3d& R,
                                     const Eigen::Vector3d& turn = Eigen::Vector3d::Zero());
    int numRows() const;
    int firstRow(int element) const;
    bool anyFixed() const;
    TestedBodies bodies(double tolerance = 1e-6) const;
    /** The poses to which this twist leads in unit time. */
    std::vector<RigidHIPlugin::Pose> posesAfter(const Eigen::VectorXd& twist) const;
    /**
     * The rows C of conditions on twists, C U = b, at any poses: of fixed components, in the order
     * of components, then of joints. The row of a motor is the last of its joint.
     */
    Eigen::MatrixXd constraints(const std::vector<RigidHIPlugin::Pose>& at) const;
};

/** A body with these hydrodynamic particles, or for index -1 a free particle. */
RigidHIPlugin::FluidElement fluidElement(int body, const std::vector<Eigen::Vector3d>& sites,
                                         const std::vector<double>& radii);

/**
 * A scene of tests/data/bodies. The file has its mobility, velocities and holding wrenches with
 * twelve digits, computed independently of this library. Bodies and values are in the order of the
 * file, except that held bodies come first, as in groups of bodies.
 */
struct ReferenceScene : public PosedBodies {
    explicit ReferenceScene(const std::string& name);
    /** One number for each row of bodies, or for each row of their particles. */
    Eigen::VectorXd ofBodies(const std::string& value) const;
    Eigen::VectorXd ofParticles(const std::string& value) const;
    /** Rows and columns of bodies. */
    Eigen::MatrixXd matrix(const std::string& value) const;
    std::vector<RigidHIPlugin::Pose> posesOf(const std::string& value) const;
    /** The contents of the file, with the file's numbers of bodies. */
    JsonValue data;
    std::vector<int> elementOfBody;  // by the file's number

private:
    void addFixedComponent(const JsonValue& constraint, std::vector<double>& values);
    void addJoint(const JsonValue& constraint);
    void addMotor(const JsonValue& constraint);

    std::vector<int> bodyRows, particleRows;  // in the file, of each row here
};

}  // namespace RigidHITest

#endif
