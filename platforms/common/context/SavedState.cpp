#include "context/SavedState.h"

#include <cmath>
#include <cstring>
#include <iostream>
#include <numeric>
#include <sstream>

#include "context/Messages.h"
#include "context/StateHash.h"
#include "openmmrigidhi/internal/StrictNode.h"
#include "rigidbody/BodySet.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

namespace {

const int version = 4, firstVersionWithUserFrame = 2, firstVersionWithInertiaScale = 3,
          firstVersionWithLastStep = 3, firstVersionWithHolds = 4;
/** The version of states in which nothing is held, which older libraries can read. */
const int versionWithoutHolds = 3;
const char checkpointMark[7] = {'R', 'I', 'G', 'I', 'D', 'H', 'I'};  // and the version's digit
const char* const quaternionNames[4] = {"qw", "qx", "qy", "qz"};
const char* const momentumNames[6] = {"px", "py", "pz", "lx", "ly", "lz"};
const char* const axisNames[3] = {"x", "y", "z"};

/**
 * How far, relative, a quaternion's length, and numbers that describe the same motion, may be from
 * their right values: rounding.
 */
const double consistencyTolerance = 1e-9;

/**
 * Derive the user's values from the stored numbers, with the moments that they were stored with.
 */
void deriveUserStates(vector<SavedBody>& bodies, double inertiaScale) {
    vector<BodyGeometry> geometries;
    vector<vector<int>> particles;
    vector<vector<bool>> carriesForce;
    for (const SavedBody& body : bodies) {
        geometries.push_back(body.geometry);
        particles.emplace_back(body.geometry.sites.size());
        iota(particles.back().begin(), particles.back().end(), 0);
        carriesForce.emplace_back(body.geometry.sites.size(), false);
    }
    BodySet set(geometries, particles, vector<vector<double>>(bodies.size()), carriesForce);
    set.setInertiaScale(inertiaScale);
    for (size_t b = 0; b < bodies.size(); b++) {
        set.setStoredState(b, bodies[b].stored);
        const BodyState state = set.getState(b);
        bodies[b].R = state.R;
        bodies[b].q = state.q;
        bodies[b].velocity =
            bodies[b].geometry.mass > 0 ? state.p / bodies[b].geometry.mass : Vec3();
        bodies[b].omega_lab = set.getAngularVelocity_lab(b);
    }
}

/** Refuse values that no body can have. */
void check(const SavedState& saved) {
    if (saved.stepNumber < 0)
        fail("the saved state is corrupt: its step number " + to_string(saved.stepNumber) +
             " is below 0; use another state");
    const double coarsest = 1e-3;  // single precision is finer
    for (double rounding : {saved.rounding.positions, saved.rounding.velocities})
        if (!(rounding >= 0 && rounding <= coarsest))
            fail("the saved state is corrupt: its platform's rounding " + text(rounding) +
                 " is not from 0 to " + text(coarsest) + "; use another state");
    if (!(saved.inertiaScale > 0) || !isfinite(saved.inertiaScale))
        fail("the saved state is corrupt: its inertia scale " + text(saved.inertiaScale) +
             " is not positive and finite; use another state");
    for (const SavedParticle& particle : saved.particles)
        if (!isFinite(particle.position) || !isFinite(particle.velocity))
            fail("the saved state is corrupt: particle " + to_string(particle.index) +
                 ", which is in no body, has infinite or undefined numbers; use another state");
    for (size_t b = 0; b < saved.bodies.size(); b++) {
        const SavedBody& body = saved.bodies[b];
        const string corrupt = "body " + to_string(b) + ": the saved state is corrupt: ";
        const BodyGeometry& g = body.geometry;
        bool finite = isfinite(g.mass) && isFinite(g.moments) && isFinite(body.R) &&
                      isFinite(body.velocity) && isFinite(body.omega_lab);
        for (double x : body.stored) finite = finite && isfinite(x);
        for (double x : body.q) finite = finite && isfinite(x);
        for (const Vec3& site : g.sites) finite = finite && isFinite(site);
        if (!finite) fail(corrupt + "it has a non-finite number; use another state");
        const double sum = g.moments[0] + g.moments[1] + g.moments[2];
        const bool hasMomentum = body.stored[7] != 0 || body.stored[8] != 0 || body.stored[9] != 0;
        if (g.mass < 0 || (g.mass == 0 && hasMomentum))
            fail(corrupt + "it has mass " + text(g.mass) + " amu; use another state");
        for (int k = 0; k < 3; k++)
            if (g.moments[k] < 0 ||
                g.moments[k] > (sum - g.moments[k]) * (1 + consistencyTolerance))
                fail(corrupt + "no body has its moments (" + text(g.moments[0]) + ", " +
                     text(g.moments[1]) + ", " + text(g.moments[2]) +
                     ") amu nm^2; use another state");
        for (int inner = 0; inner < 2; inner++) {
            double square = 0;
            for (int k = 0; k < 4; k++)
                square += pow(inner == 1 ? body.stored[3 + k] : body.q[k], 2);
            if (!(abs(sqrt(square) - 1) <= consistencyTolerance))
                fail(corrupt + "its quaternion has length " + text(sqrt(square)) +
                     ", which must be 1; use another state");
        }
    }
}

/** Refuse user's values that do not match the stored numbers. */
void checkUserStates(const SavedState& saved) {
    vector<SavedBody> derived = saved.bodies;
    deriveUserStates(derived, saved.inertiaScale);
    const auto largest = [](const Vec3& v) { return max(abs(v[0]), max(abs(v[1]), abs(v[2]))); };
    const auto differ = [&](const Vec3& is, const Vec3& must) {
        return !isFinite(must) || !(largest(is - must) <= consistencyTolerance * largest(must));
    };
    for (size_t b = 0; b < derived.size(); b++) {
        const SavedBody &is = saved.bodies[b], &must = derived[b];
        double turn = 0;
        for (int k = 0; k < 4; k++) turn = max(turn, abs(is.q[k] - must.q[k]));
        if (turn > consistencyTolerance || differ(is.R, must.R) ||
            differ(is.velocity, must.velocity) || differ(is.omega_lab, must.omega_lab))
            fail("body " + to_string(b) +
                 ": the saved state is corrupt: its pose or velocities do not agree with its "
                 "stored internal state; use another state");
    }
}

template <class T>
void put(string& bytes, const T& value) {
    bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

/** Reads values from bytes and detects their end. */
class ByteReader {
public:
    explicit ByteReader(const string& bytes) : bytes(bytes) {}
    template <class T>
    T get() {
        T value;
        if (at + sizeof value > bytes.size())
            fail("the checkpoint is corrupt: it ends too early; use another checkpoint");
        memcpy(&value, bytes.data() + at, sizeof value);
        at += sizeof value;
        return value;
    }
    /**
     * Read a count that the remaining bytes can hold, so that a damaged count cannot ask for all
     * the memory.
     */
    int count() {
        const int32_t n = get<int32_t>();
        if (n < 0 || static_cast<size_t>(n) > bytes.size() - at)
            fail("the checkpoint is corrupt: it claims that " + to_string(n) +
                 " items follow; use another checkpoint");
        return n;
    }
    string characters(int n) {
        string result = bytes.substr(at, n);
        at += n;
        return result;
    }
    bool isAtEnd() const { return at == bytes.size(); }
    void end() const {
        if (at != bytes.size())
            fail("the checkpoint is corrupt: " + to_string(bytes.size() - at) +
                 " bytes follow its end; use another checkpoint");
    }

private:
    const string& bytes;
    size_t at = 0;
};

void putMemory(string& bytes, const SchemeMemory& memory) {
    put(bytes, (int32_t)memory.scheme.size());
    bytes += memory.scheme;
    put(bytes, (int32_t)memory.groups.size());
    for (const auto& group : memory.groups) {
        put(bytes, (int32_t)group.size());
        for (const Eigen::MatrixXd& vectors : group) {
            put(bytes, (int32_t)vectors.rows());
            put(bytes, (int32_t)vectors.cols());
            for (int i = 0; i < vectors.size(); i++) put(bytes, vectors.data()[i]);
        }
    }
}

SchemeMemory readMemory(ByteReader& reader) {
    SchemeMemory memory;
    memory.scheme = reader.characters(reader.count());
    memory.groups.resize(reader.count());
    for (auto& group : memory.groups) {
        group.resize(reader.count());
        for (Eigen::MatrixXd& vectors : group) {
            const int rows = reader.count(), columns = reader.count();
            vector<double> values;
            for (int64_t i = 0; i < int64_t(rows) * columns; i++)
                values.push_back(reader.get<double>());
            vectors = Eigen::Map<Eigen::MatrixXd>(values.data(), rows, columns);
        }
    }
    return memory;
}

void writeMemory(SerializationNode& root, const char* name, const SchemeMemory& memory) {
    if (memory.groups.empty()) return;
    SerializationNode& node = root.createChildNode(name);
    node.setStringProperty("scheme", memory.scheme);
    for (const auto& group : memory.groups) {
        SerializationNode& list = node.createChildNode("Group");
        for (const Eigen::MatrixXd& vectors : group) {
            SerializationNode& values = list.createChildNode("Vectors");
            values.setIntProperty("rows", vectors.rows()).setIntProperty("columns", vectors.cols());
            for (int i = 0; i < vectors.size(); i++)
                values.createChildNode("Value").setDoubleProperty("value", vectors.data()[i]);
        }
    }
}

SchemeMemory readMemory(const StrictNode& node) {
    SchemeMemory memory;
    memory.scheme = node.text("scheme");
    for (const SerializationNode& list : node.children()) {
        memory.groups.emplace_back();
        for (const SerializationNode& child : list.getChildren()) {
            const StrictNode vectors(child, "State");
            const int rows = vectors.integer("rows"), columns = vectors.integer("columns");
            vector<double> values;
            for (const SerializationNode& value : child.getChildren())
                values.push_back(StrictNode(value, "State").number("value"));
            if (rows < 0 || columns < 0 || int64_t(rows) * columns != (int64_t)values.size())
                vectors.wrongValue("rows", "the number of values divided by the number of columns");
            memory.groups.back().push_back(
                Eigen::Map<Eigen::MatrixXd>(values.data(), rows, columns));
        }
    }
    return memory;
}

Vec3 readVector(const StrictNode& node, const string& prefix) {
    return Vec3(node.number(prefix + axisNames[0]), node.number(prefix + axisNames[1]),
                node.number(prefix + axisNames[2]));
}

void writeVector(SerializationNode& node, const string& prefix, const Vec3& v) {
    for (int k = 0; k < 3; k++) node.setDoubleProperty(prefix + axisNames[k], v[k]);
}

SavedBody readBody(const StrictNode& node, int fileVersion) {
    SavedBody body;
    const bool hasUserFrame = fileVersion >= firstVersionWithUserFrame;
    const StrictNode exact = hasUserFrame ? node.child("Exact") : node;
    body.R = readVector(node, "R");
    for (int k = 0; k < 3; k++) body.stored[k] = body.R[k];
    for (int k = 0; k < 4; k++) body.stored[3 + k] = exact.number(quaternionNames[k]);
    for (int k = 0; k < 6; k++) body.stored[7 + k] = exact.number(momentumNames[k]);
    if (hasUserFrame) {
        for (int k = 0; k < 4; k++) body.q[k] = node.number(quaternionNames[k]);
        body.velocity = readVector(node, "v");
        body.omega_lab = readVector(node, "w");
    }
    body.geometry.mass = node.number("mass");
    body.geometry.moments = Vec3(node.number("I1"), node.number("I2"), node.number("I3"));
    for (const SerializationNode& child : node.children())
        if (child.getName() == "Site")
            body.geometry.sites.push_back(readVector(StrictNode(child, "State"), ""));
    return body;
}

void readRounded(const StrictNode& node, SavedState& saved) {
    saved.rounding.positions = node.number("positions");
    saved.rounding.velocities = node.number("velocities");
    for (const SerializationNode& child : node.children()) {
        const StrictNode particle(child, "State");
        saved.particles.push_back(
            {particle.integer("index"), readVector(particle, ""), readVector(particle, "v")});
    }
}

SavedState readNode(const StrictNode& root, int fileVersion) {
    SavedState saved;
    saved.seed = root.integer<uint32_t>("seed");
    saved.stepNumber = root.integer<int64_t>("stepNumber");
    saved.hasBodies = root.has("positionsHash");
    if (!saved.hasBodies) return saved;
    saved.positionsHash = root.integer<uint64_t>("positionsHash");
    saved.velocitiesHash = root.integer<uint64_t>("velocitiesHash");
    if (fileVersion >= firstVersionWithInertiaScale)
        saved.inertiaScale = root.number("inertiaScale");
    for (const SerializationNode& body : root.child("Bodies").children())
        saved.bodies.push_back(readBody(StrictNode(body, "State"), fileVersion));
    for (const SerializationNode& child : root.children())
        if (child.getName() == "SchemeMemory")
            saved.memory = readMemory(StrictNode(child, "State"));
        else if (child.getName() == "LastStep")
            saved.lastStep = readMemory(StrictNode(child, "State"));
        else if (child.getName() == "Holds")
            saved.holds = readMemory(StrictNode(child, "State"));
        else if (child.getName() == "RoundedPlatform")
            readRounded(StrictNode(child, "State"), saved);
    return saved;
}

}  // namespace

bool sameGeometry(const BodyGeometry& a, const BodyGeometry& b) {
    const auto same = [](const Vec3& u, const Vec3& v) { return memcmp(&u, &v, sizeof u) == 0; };
    bool result = memcmp(&a.mass, &b.mass, sizeof a.mass) == 0 && same(a.moments, b.moments) &&
                  a.sites.size() == b.sites.size();
    for (size_t i = 0; result && i < a.sites.size(); i++) result = same(a.sites[i], b.sites[i]);
    return result;
}

void SavedState::write(ostream& checkpoint) const {
    string bytes;
    put(bytes, seed);
    put(bytes, stepNumber);
    put(bytes, (int32_t)hasBodies);
    put(bytes, positionsHash);
    put(bytes, velocitiesHash);
    put(bytes, inertiaScale);
    put(bytes, (int32_t)bodies.size());
    for (const SavedBody& body : bodies) {
        put(bytes, body.stored);
        put(bytes, body.q);
        put(bytes, body.velocity);
        put(bytes, body.omega_lab);
        put(bytes, body.geometry.mass);
        put(bytes, body.geometry.moments);
        put(bytes, (int32_t)body.geometry.sites.size());
        for (const Vec3& site : body.geometry.sites) put(bytes, site);
    }
    putMemory(bytes, memory);
    putMemory(bytes, lastStep);
    if (!holds.groups.empty()) putMemory(bytes, holds);
    if (!rounding.isExact()) {
        put(bytes, rounding);
        put(bytes, (int32_t)particles.size());
        for (const SavedParticle& particle : particles) {
            put(bytes, (int32_t)particle.index);
            put(bytes, particle.position);
            put(bytes, particle.velocity);
        }
    }
    checkpoint.write(checkpointMark, sizeof checkpointMark);
    checkpoint.put(static_cast<char>('0' + (holds.groups.empty() ? versionWithoutHolds : version)));
    const uint64_t length = bytes.size(), hash = hashOf(bytes);
    checkpoint.write(reinterpret_cast<const char*>(&length), sizeof length);
    checkpoint.write(reinterpret_cast<const char*>(&hash), sizeof hash);
    checkpoint.write(bytes.data(), bytes.size());
}

SavedState SavedState::read(istream& checkpoint) {
    char mark[sizeof checkpointMark], digit = 0;
    checkpoint.read(mark, sizeof mark);
    checkpoint.get(digit);
    if (!checkpoint || memcmp(mark, checkpointMark, sizeof mark) != 0 || digit < '1' || digit > '9')
        fail(
            "the checkpoint was not written by this integrator; use a checkpoint of this "
            "integrator, or a State");
    const int fileVersion = digit - '0', oldest = 2;
    if (fileVersion < oldest || fileVersion > version)
        fail("the checkpoint has version " + to_string(fileVersion) +
             ", but this library reads versions " + to_string(oldest) + " to " +
             to_string(version) + "; load it with the library that saved it, or use a State");
    uint64_t length = 0, hash = 0;
    checkpoint.read(reinterpret_cast<char*>(&length), sizeof length);
    checkpoint.read(reinterpret_cast<char*>(&hash), sizeof hash);
    const uint64_t implausible = uint64_t(1) << 40;
    if (!checkpoint || length > implausible)
        fail("the checkpoint is corrupt: its header is damaged; use another checkpoint");
    string bytes;
    // Read the text in pieces, so that a damaged length cannot ask for all the memory.
    char piece[65536];
    while (bytes.size() < length) {
        checkpoint.read(piece, min<uint64_t>(sizeof piece, length - bytes.size()));
        if (checkpoint.gcount() == 0)
            fail("the checkpoint is corrupt: it ends too early; use another checkpoint");
        bytes.append(piece, checkpoint.gcount());
    }
    if (hashOf(bytes) != hash)
        fail("the checkpoint is corrupt: its check sum does not match; use another checkpoint");
    ByteReader reader(bytes);
    SavedState saved;
    saved.seed = reader.get<uint32_t>();
    saved.stepNumber = reader.get<int64_t>();
    const int32_t hasBodies = reader.get<int32_t>();
    saved.hasBodies = hasBodies == 1;
    saved.positionsHash = reader.get<uint64_t>();
    saved.velocitiesHash = reader.get<uint64_t>();
    if (fileVersion >= firstVersionWithInertiaScale) saved.inertiaScale = reader.get<double>();
    const int32_t count = reader.get<int32_t>();
    if (hasBodies < 0 || hasBodies > 1 || count < 0 || (count > 0 && !saved.hasBodies))
        fail("the checkpoint is corrupt: it claims to hold " + to_string(count) +
             " bodies; use another checkpoint");
    for (int b = 0; b < count; b++) {
        SavedBody body;
        body.stored = reader.get<array<double, 13>>();
        body.R = Vec3(body.stored[0], body.stored[1], body.stored[2]);
        body.q = reader.get<array<double, 4>>();
        body.velocity = reader.get<Vec3>();
        body.omega_lab = reader.get<Vec3>();
        body.geometry.mass = reader.get<double>();
        body.geometry.moments = reader.get<Vec3>();
        const int32_t sites = reader.get<int32_t>();
        for (int i = 0; i < sites; i++) body.geometry.sites.push_back(reader.get<Vec3>());
        saved.bodies.push_back(body);
    }
    saved.memory = readMemory(reader);
    if (fileVersion >= firstVersionWithLastStep) saved.lastStep = readMemory(reader);
    if (fileVersion >= firstVersionWithHolds) saved.holds = readMemory(reader);
    if (!reader.isAtEnd()) {
        saved.rounding = reader.get<Rounding>();
        saved.particles.resize(reader.count());
        for (SavedParticle& particle : saved.particles) {
            particle.index = reader.get<int32_t>();
            particle.position = reader.get<Vec3>();
            particle.velocity = reader.get<Vec3>();
        }
    }
    reader.end();
    check(saved);
    checkUserStates(saved);
    return saved;
}

void SavedState::write(SerializationNode& node) const {
    SerializationNode& root = node.createChildNode("RigidBodyState");
    root.setIntProperty("version", holds.groups.empty() ? versionWithoutHolds : version);
    root.setLongProperty("seed", seed);
    root.setLongProperty("stepNumber", stepNumber);
    if (!hasBodies) return;
    root.setStringProperty("positionsHash", to_string(positionsHash));
    root.setStringProperty("velocitiesHash", to_string(velocitiesHash));
    root.setDoubleProperty("inertiaScale", inertiaScale);
    SerializationNode& list = root.createChildNode("Bodies");
    for (const SavedBody& saved : bodies) {
        SerializationNode& body = list.createChildNode("Body");
        writeVector(body, "R", saved.R);
        for (int k = 0; k < 4; k++) body.setDoubleProperty(quaternionNames[k], saved.q[k]);
        writeVector(body, "v", saved.velocity);
        writeVector(body, "w", saved.omega_lab);
        const BodyGeometry& g = saved.geometry;
        body.setDoubleProperty("mass", g.mass);
        body.setDoubleProperty("I1", g.moments[0])
            .setDoubleProperty("I2", g.moments[1])
            .setDoubleProperty("I3", g.moments[2]);
        SerializationNode& exact = body.createChildNode("Exact");
        for (int k = 0; k < 4; k++)
            exact.setDoubleProperty(quaternionNames[k], saved.stored[3 + k]);
        for (int k = 0; k < 6; k++) exact.setDoubleProperty(momentumNames[k], saved.stored[7 + k]);
        for (const Vec3& site : g.sites) writeVector(body.createChildNode("Site"), "", site);
    }
    writeMemory(root, "SchemeMemory", memory);
    writeMemory(root, "LastStep", lastStep);
    writeMemory(root, "Holds", holds);
    if (rounding.isExact()) return;
    SerializationNode& rest = root.createChildNode("RoundedPlatform");
    rest.setDoubleProperty("positions", rounding.positions)
        .setDoubleProperty("velocities", rounding.velocities);
    for (const SavedParticle& particle : particles) {
        SerializationNode& child = rest.createChildNode("Particle");
        child.setIntProperty("index", particle.index);
        writeVector(child, "", particle.position);
        writeVector(child, "v", particle.velocity);
    }
}

SavedState SavedState::read(const SerializationNode& node) {
    int fileVersion = 0;
    SavedState saved;
    try {
        const StrictNode root(node, "State");
        fileVersion = root.integer("version");
        if (fileVersion >= 1 && fileVersion <= version) saved = readNode(root, fileVersion);
    } catch (const std::exception& e) {
        fail(string("the State's integrator parameters are corrupt (") + e.what() +
             "); use another State");
    }
    if (fileVersion < 1 || fileVersion > version)
        fail("the State has version " + to_string(fileVersion) +
             " of the body state, but this library reads versions 1 to " + to_string(version) +
             "; load it with the library that saved it");
    if (fileVersion == 1) deriveUserStates(saved.bodies, saved.inertiaScale);
    check(saved);
    if (fileVersion != 1) checkUserStates(saved);
    return saved;
}

}  // namespace RigidHIPlugin
