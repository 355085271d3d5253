#include "ReferenceScenes.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <fstream>
#include <iterator>
#include <limits>
#include <numeric>
#include <sstream>
#include <stdexcept>

#include "mobility/models/rotneprager/RotnePragerYamakawa.h"
#include "mobility/models/wall/RotnePragerYamakawaWall.h"

using namespace Eigen;
using namespace RigidHIPlugin;
using namespace std;

namespace RigidHITest {

// ---- JSON

namespace {

class JsonReader {
public:
    explicit JsonReader(const string& text) : text(text) {}
    JsonValue readAll() {
        JsonValue all = value();
        skipSpaces();
        if (at < text.size()) fail("the end");
        return all;
    }

private:
    [[noreturn]] void fail(const string& expected) const {
        throw runtime_error("JSON: there is no " + expected + " at character " + to_string(at));
    }
    void skipSpaces() {
        while (at < text.size() && isspace((unsigned char)text[at])) at++;
    }
    bool take(const string& word) {
        skipSpaces();
        if (text.compare(at, word.size(), word) != 0) return false;
        at += word.size();
        return true;
    }
    void require(const string& word) {
        if (!take(word)) fail("'" + word + "'");
    }
    JsonValue value() {
        JsonValue v;
        skipSpaces();
        const char next = at < text.size() ? text[at] : 0;
        if (take("{")) {
            v.kind = JsonValue::Map;
            for (bool more = !take("}"); more; more = !end("}")) {
                const string name = quoted();
                require(":");
                v.map[name] = value();
            }
        } else if (take("[")) {
            v.kind = JsonValue::List;
            for (bool more = !take("]"); more; more = !end("]")) v.list.push_back(value());
        } else if (next == '"') {
            v.kind = JsonValue::Text;
            v.text = quoted();
        } else if (take("true") || take("false")) {
            v.kind = JsonValue::Boolean;
            v.number = next == 't';
        } else if (!take("null")) {
            v.kind = JsonValue::Number;
            v.number = number();
        }
        return v;
    }
    /** Whether a list ends here; if not, a comma must follow. */
    bool end(const string& bracket) {
        if (take(bracket)) return true;
        require(",");
        return false;
    }
    string quoted() {
        require("\"");
        string found;
        for (; at < text.size() && text[at] != '"'; at++) {
            if (text[at] == '\\') at++;  // of the escapes, these texts have \" and \\ only
            found += text[at];
        }
        require("\"");
        return found;
    }
    double number() {
        if (take("NaN")) return numeric_limits<double>::quiet_NaN();
        size_t count = 0;
        double found = 0;
        try {
            found = stod(text.substr(at, 40), &count);
        } catch (const exception&) {
            fail("value");
        }
        at += count;
        return found;
    }

    const string& text;
    size_t at = 0;
};

void collect(const JsonValue& value, vector<double>& numbers) {
    if (value.kind != JsonValue::List) numbers.push_back(value.number);
    for (const JsonValue& item : value.list) collect(item, numbers);
}

}  // namespace

const JsonValue& JsonValue::operator[](const string& name) const {
    if (!has(name)) throw runtime_error("JSON: there is no value named " + name);
    return map.at(name);
}

vector<double> JsonValue::numbers() const {
    vector<double> found;
    collect(*this, found);
    return found;
}

Vector3d JsonValue::vector3() const {
    if (size() != 3) throw runtime_error("JSON: a list is no vector of three numbers");
    return Vector3d(list[0].number, list[1].number, list[2].number);
}

VectorXd JsonValue::column() const {
    const vector<double> found = numbers();
    return Eigen::Map<const VectorXd>(found.data(), found.size());
}

JsonValue parseJson(const string& text) { return JsonReader(text).readAll(); }

// ---- Bodies

FluidElement fluidElement(int body, const vector<Vector3d>& sites, const vector<double>& radii) {
    FluidElement e;
    e.body = body;
    e.sites = sites;
    e.radii = radii;
    for (size_t i = 0; i < sites.size(); i++) e.particles.push_back(100 * (body + 1) + i);
    return e;
}

namespace {

scalar::Quaternion<double> exponentialOf(const Vector3d& turn) {
    return scalar::exponential(scalar::Vector3<double>{turn.x() / 2, turn.y() / 2, turn.z() / 2});
}

}  // namespace

FluidElement& PosedBodies::add(const FluidElement& element, const Vector3d& R,
                               const Vector3d& turn) {
    elements.push_back(element);
    poses.emplace_back();
    poses.back().R = R;
    poses.back().q = exponentialOf(turn);
    return elements.back();
}

int PosedBodies::firstRow(int element) const {
    int row = 0;
    for (int e = 0; e < element; e++) row += elements[e].numRows();
    return row;
}

int PosedBodies::numRows() const { return firstRow(elements.size()); }

bool PosedBodies::anyFixed() const {
    return any_of(elements.begin(), elements.end(),
                  [](const FluidElement& e) { return !e.isWhollyFree(); });
}

TestedBodies PosedBodies::bodies(double tolerance) const {
    TestedBodies made(elements, makeModel, mayBeConstant, tolerance);
    made->setBox(box);
    return made;
}

vector<Pose> PosedBodies::posesAfter(const VectorXd& twist) const {
    vector<Pose> moved = poses;
    for (size_t e = 0; e < elements.size(); e++) {
        const int row = firstRow(e);
        moved[e].R += twist.segment<3>(row);
        if (!elements[e].isFree())
            moved[e].q = exponentialOf(twist.segment<3>(row + 3)) * poses[e].q;
    }
    return moved;
}

MatrixXd PosedBodies::constraints(const vector<Pose>& at) const {
    vector<VectorXd> rows;
    for (size_t e = 0; e < elements.size(); e++) {
        const FluidElement& element = elements[e];
        const Matrix3d axes =
            element.fixedInBody ? Matrix3d(at[e].rotation() * element.axes) : Matrix3d::Identity();
        for (int k = 0; k < element.numRows(); k++) {
            if (!element.isFixed(k)) continue;
            rows.push_back(VectorXd::Zero(numRows()));
            rows.back().segment<3>(firstRow(e) + k / 3 * 3) = axes.col(k % 3);
        }
    }
    for (const Joint& joint : joints) {
        const Matrix3d A_i = at[joint.i].rotation();
        const Vector3d a_i = A_i * joint.anchor_i;
        const Vector3d a_j =
            joint.j < 0 ? Vector3d::Zero() : Vector3d(at[joint.j].rotation() * joint.anchor_j);
        // The velocities of the anchors along a direction, one minus the other.
        const auto addAlong = [&](const Vector3d& e) {
            rows.push_back(VectorXd::Zero(numRows()));
            rows.back().segment<6>(firstRow(joint.i)) << e, a_i.cross(e);
            if (joint.j >= 0) rows.back().segment<6>(firstRow(joint.j)) << -e, -a_j.cross(e);
        };
        if (joint.kind == Joint::Link) {
            addAlong((at[joint.i].R + a_i - at[joint.j].R - a_j).normalized());
            continue;
        }
        for (int k = 0; k < 3; k++) addAlong(Vector3d::Unit(k));
        if (joint.kind != Joint::Hinge) continue;
        const Vector3d first = joint.axis_i.unitOrthogonal();
        for (const Vector3d& across : {first, Vector3d(joint.axis_i.cross(first))}) {
            const Vector3d u = (at[joint.j].rotation() * joint.axis_j).cross(A_i * across);
            rows.push_back(VectorXd::Zero(numRows()));
            rows.back().segment<3>(firstRow(joint.i) + 3) = -u;
            rows.back().segment<3>(firstRow(joint.j) + 3) = u;
        }
        if (!joint.hasMotor()) continue;
        const Vector3d h = A_i * joint.axis_i;
        rows.push_back(VectorXd::Zero(numRows()));
        rows.back().segment<3>(firstRow(joint.i) + 3) = -h;
        rows.back().segment<3>(firstRow(joint.j) + 3) = h;
    }
    MatrixXd C(rows.size(), numRows());
    for (size_t i = 0; i < rows.size(); i++) C.row(i) = rows[i];
    return C;
}

// ---- Scenes of files

JsonValue readTestData(const string& name) {
    const string path = string(RIGIDHI_TEST_DATA) + "/" + name + ".json";
    ifstream file(path);
    if (!file) throw runtime_error("there is no file " + path);
    return parseJson(string(istreambuf_iterator<char>(file), istreambuf_iterator<char>()));
}

namespace {

Pose poseOf(const JsonValue& value) {
    Pose pose;
    pose.R = value["position"].vector3();
    const JsonValue& q = value["quaternion"];
    pose.q = {q[0].number, q[1].number, q[2].number, q[3].number};
    return pose;
}

}  // namespace

ReferenceScene::ReferenceScene(const string& sceneName)
    : data(readTestData("bodies/" + sceneName)) {
    name = sceneName;
    const double viscosity = data["viscosity"].number;
    const bool wall = data["boundary"].text != "Unbounded";
    makeModel = [viscosity,
                 wall](const HydrodynamicParticles& particles) -> unique_ptr<MobilityModel> {
        const NoSlipPlane plane(0, false);
        if (wall) return make_unique<RotnePragerYamakawaWall>(particles, viscosity, plane);
        return make_unique<RotnePragerYamakawa>(particles, viscosity);
    };
    const JsonValue &bodies = data["bodies"], &constraints = data["constraints"];
    vector<bool> held(bodies.size());
    for (const JsonValue& constraint : constraints.list)
        if (constraint["type"].text == "held") held[constraint["body"].number] = true;
    vector<int> order(bodies.size());
    iota(order.begin(), order.end(), 0);
    stable_partition(order.begin(), order.end(), [&](int body) { return held[body]; });

    vector<int> firstBodyRow = {0}, firstParticleRow = {0};
    vector<FluidElement> inFile;
    for (int b = 0; b < bodies.size(); b++) {
        vector<Vector3d> sites;
        for (const JsonValue& site : bodies[b]["sites"].list) sites.push_back(site.vector3());
        FluidElement e = fluidElement(b, sites, bodies[b]["radii"].numbers());
        if (bodies[b]["free"].number) e.body = -1;
        inFile.push_back(e);
        firstBodyRow.push_back(firstBodyRow[b] + e.numRows());
        firstParticleRow.push_back(firstParticleRow[b] + e.numParticleRows());
    }
    elementOfBody.resize(bodies.size());
    for (int body : order) {
        elementOfBody[body] = elements.size();
        elements.push_back(inFile[body]);
        if (held[body]) elements.back().hold();
        poses.push_back(poseOf(bodies[body]));
        for (int row = firstBodyRow[body]; row < firstBodyRow[body + 1]; row++)
            bodyRows.push_back(row);
        for (int row = firstParticleRow[body]; row < firstParticleRow[body + 1]; row++)
            particleRows.push_back(row);
    }
    vector<double> values(numRows());
    for (const JsonValue& constraint : constraints.list)
        if (constraint["type"].text == "component")
            addFixedComponent(constraint, values);
        else if (constraint["type"].text == "motor")
            addMotor(constraint);
        else if (constraint["type"].text != "held")
            addJoint(constraint);
    if (any_of(values.begin(), values.end(), [](double v) { return v != 0; }))
        velocities = Map<MatrixXd>(values.data(), values.size(), 1);
    wrenches = ofBodies("wrenches");
}

/**
 * Fix a component along an axis. An axis other than x, y and z must be an axis of the body frame,
 * and the body's only fixed component.
 */
void ReferenceScene::addFixedComponent(const JsonValue& constraint, vector<double>& values) {
    const int e = elementOfBody[constraint["body"].number];
    FluidElement& element = elements[e];
    const Vector3d axis = constraint["axis"].vector3();
    int k = 0;
    while (k < 3 && axis != Vector3d::Unit(k)) k++;
    element.fixedInBody = constraint["frame"].text == "body";
    if (k == 3) {
        if (!element.fixedInBody || element.fixed)
            throw runtime_error(name + ": no single component of a body is along this axis");
        k = 0;
        element.axes.col(0) = axis;
        element.axes.col(1) = axis.unitOrthogonal();
        element.axes.col(2) = axis.cross(element.axes.col(1));
    }
    if (constraint["what"].text == "W") k += 3;
    element.fixed |= 1u << k;
    values[firstRow(e) + k] = constraint["value"].number;
}

void ReferenceScene::addJoint(const JsonValue& constraint) {
    const string& type = constraint["type"].text;
    Joint joint;
    joint.index = joints.size();
    joint.i = elementOfBody[constraint["i"].number];
    joint.anchor_i = constraint["li"].vector3();
    const bool toPoint = constraint["j"].kind == JsonValue::Null;
    joint.j = toPoint ? -1 : elementOfBody[constraint["j"].number];
    joint.anchor_j = constraint["lj"].vector3();
    joint.kind = type == "link"    ? Joint::Link
                 : type == "hinge" ? Joint::Hinge
                 : toPoint         ? Joint::BallToPoint
                                   : Joint::Ball;
    if (type == "link") joint.length = constraint["length"].number;
    if (type == "hinge") {
        joint.axis_i = constraint["hi"].vector3().normalized();
        joint.axis_j = constraint["hj"].vector3().normalized();
    }
    if (type != "link" && type != "hinge" && type != "ball")
        throw runtime_error(name + ": there is no joint of the type " + type);
    joints.push_back(joint);
}

/** Add a motor to a hinge that comes before it in the file. */
void ReferenceScene::addMotor(const JsonValue& constraint) {
    for (Joint& joint : joints)
        if (joint.kind == Joint::Hinge && joint.i == elementOfBody[constraint["i"].number] &&
            joint.j == elementOfBody[constraint["j"].number] &&
            constraint["hi"].vector3() == joint.axis_i) {
            joint.motor = motorRates.size();
            motorRates.conservativeResize(joint.motor + 1);
            motorRates[joint.motor] = constraint["value"].number;
            return;
        }
    throw runtime_error(name + ": there is no hinge for a motor");
}

namespace {

VectorXd permuted(const VectorXd& values, const vector<int>& rows) {
    if (values.size() != (int)rows.size()) throw runtime_error("a list has another length");
    VectorXd found(values.size());
    for (size_t i = 0; i < rows.size(); i++) found[i] = values[rows[i]];
    return found;
}

}  // namespace

VectorXd ReferenceScene::ofBodies(const string& value) const {
    return permuted(data[value].column(), bodyRows);
}

VectorXd ReferenceScene::ofParticles(const string& value) const {
    return permuted(data[value].column(), particleRows);
}

MatrixXd ReferenceScene::matrix(const string& value) const {
    MatrixXd found(bodyRows.size(), bodyRows.size());
    for (size_t i = 0; i < bodyRows.size(); i++)
        found.row(i) = permuted(data[value][bodyRows[i]].column(), bodyRows);
    return found;
}

vector<Pose> ReferenceScene::posesOf(const string& value) const {
    vector<Pose> found(elements.size());
    for (int body = 0; body < data[value].size(); body++)
        found[elementOfBody[body]] = poseOf(data[value][body]);
    return found;
}

}  // namespace RigidHITest
