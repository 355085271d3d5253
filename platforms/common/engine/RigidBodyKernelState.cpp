// RigidBodyKernel: saving and resuming.

#include <openmm/OpenMMException.h>
#include <openmm/serialization/SerializationNode.h>

#include <cmath>
#include <cstring>
#include <iostream>
#include <limits>
#include <sstream>

#include "engine/RigidBodyKernel.h"
#include "engine/StateHash.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

namespace {

[[noreturn]] void fail(const string& message) { throw OpenMMException("CustomRigidHIIntegrator: " + message); }

const char checkpointMark[8] = {'R', 'I', 'G', 'I', 'D', 'H', 'I', '1'};
const int stateVersion = 1;
const char* const valueNames[13] = {"Rx", "Ry", "Rz", "qw", "qx", "qy", "qz", "px", "py", "pz", "lx", "ly", "lz"};

template <class T>
void put(string& bytes, const T& value) {
    bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

/** Reads values from bytes and notices their end. */
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

private:
    const string& bytes;
    size_t at = 0;
};

}  // namespace

RigidBodyKernel::SavedState RigidBodyKernel::collectState(ContextImpl& context) {
    SavedState saved;
    saved.seed = seed;
    saved.stepNumber = stepNumber;
    if (!positionsAreSet) return saved;
    takeInChanges(context);
    saved.hasBodies = true;
    saved.positionsHash = hashOf(positions());
    saved.velocitiesHash = hashOf(velocities());
    saved.geometries = geometries;
    for (int b = 0; b < bodies.getNumBodies(); b++) saved.bodies.push_back(bodies.getStoredState(b));
    return saved;
}

void RigidBodyKernel::adoptState(const SavedState& saved) {
    const int n = definitions->getNumRigidBodies();
    if (saved.hasBodies) {
        if ((int)saved.bodies.size() != n)
            fail("the saved state has " + to_string(saved.bodies.size()) + " bodies, but this integrator has " +
                 to_string(n) + "; load it into an integrator with the same bodies");
        for (int b = 0; b < n; b++) {
            const BodyGeometry& g = saved.geometries[b];
            if (g.sites.size() != definitions->getRigidBodyParticles(b).size())
                fail("body " + to_string(b) + ": the saved state has " + to_string(g.sites.size()) +
                     " particles for it, but this integrator has " +
                     to_string(definitions->getRigidBodyParticles(b).size()) +
                     "; load it into an integrator with the same bodies");
            for (double x : saved.bodies[b])
                if (!isfinite(x))
                    fail("body " + to_string(b) +
                         ": the saved state is corrupt: it has a non-finite number; use another");
            if (!definitions->getRigidBodyIsExplicit(b)) continue;
            BodyGeometry own;
            vector<int> particles;
            definitions->getRigidBodyParameters(b, particles, own.mass, own.moments, own.sites);
            double difference = abs(g.mass - own.mass) / max(own.mass, numeric_limits<double>::min());
            for (size_t i = 0; i < g.sites.size(); i++)
                for (int k = 0; k < 3; k++) difference = max(difference, abs(g.sites[i][k] - own.sites[i][k]));
            if (!(difference < integrator->getPoseTolerance()))
                fail("body " + to_string(b) +
                     " was saved with another shape or mass than this integrator gives it; load "
                     "the state into the integrator it was saved with");
        }
        for (int b = 0; b < n; b++)
            if (!definitions->getRigidBodyIsExplicit(b)) recordGeometry(b, saved.geometries[b]);
        buildBodies();
        for (int b = 0; b < n; b++) bodies.setStoredState(b, saved.bodies[b]);
        compareByHash = true;
        expectedPositions = saved.positionsHash;
        expectedVelocities = saved.velocitiesHash;
        forcesAreValid = false;
        // Arrays that are not the saved ones count as changed by the user.
        lastPositions.assign(lastPositions.size(), Vec3(NAN, NAN, NAN));
        lastVelocities = lastPositions;
    }
    seed = saved.seed;
    stepNumber = saved.stepNumber;
}

void RigidBodyKernel::createCheckpoint(ContextImpl& context, ostream& stream) {
    const SavedState saved = collectState(context);
    string bytes;
    put(bytes, saved.seed);
    put(bytes, saved.stepNumber);
    put(bytes, (int32_t)saved.hasBodies);
    put(bytes, saved.positionsHash);
    put(bytes, saved.velocitiesHash);
    put(bytes, (int32_t)saved.bodies.size());
    for (size_t b = 0; b < saved.bodies.size(); b++) {
        put(bytes, saved.bodies[b]);
        const BodyGeometry& g = saved.geometries[b];
        put(bytes, g.mass);
        put(bytes, g.moments);
        put(bytes, (int32_t)g.sites.size());
        for (const Vec3& s : g.sites) put(bytes, s);
    }
    stream.write(checkpointMark, sizeof checkpointMark);
    const uint64_t length = bytes.size(), hash = hashOf(bytes);
    stream.write(reinterpret_cast<const char*>(&length), sizeof length);
    stream.write(reinterpret_cast<const char*>(&hash), sizeof hash);
    stream.write(bytes.data(), bytes.size());
}

void RigidBodyKernel::loadCheckpoint(ContextImpl& context, istream& stream) {
    char mark[sizeof checkpointMark];
    stream.read(mark, sizeof mark);
    if (!stream || memcmp(mark, checkpointMark, sizeof mark) != 0)
        fail("the checkpoint was not written by this version of this integrator; use one that was, or a State");
    uint64_t length = 0, hash = 0;
    stream.read(reinterpret_cast<char*>(&length), sizeof length);
    stream.read(reinterpret_cast<char*>(&hash), sizeof hash);
    const uint64_t implausible = uint64_t(1) << 40;
    if (!stream || length > implausible)
        fail("the checkpoint is corrupt: its header is damaged; use another checkpoint");
    string bytes;
    // Read in pieces, so that a damaged length cannot ask for all the memory.
    char piece[65536];
    while (bytes.size() < length) {
        stream.read(piece, min<uint64_t>(sizeof piece, length - bytes.size()));
        if (stream.gcount() == 0) fail("the checkpoint is corrupt: it ends too early; use another checkpoint");
        bytes.append(piece, stream.gcount());
    }
    if (hashOf(bytes) != hash) fail("the checkpoint is corrupt: its check sum does not match; use another checkpoint");
    ByteReader reader(bytes);
    SavedState saved;
    saved.seed = reader.get<uint32_t>();
    saved.stepNumber = reader.get<int64_t>();
    saved.hasBodies = reader.get<int32_t>();
    saved.positionsHash = reader.get<uint64_t>();
    saved.velocitiesHash = reader.get<uint64_t>();
    const int n = reader.get<int32_t>();
    for (int b = 0; b < n; b++) {
        saved.bodies.push_back(reader.get<array<double, 13> >());
        BodyGeometry g;
        g.mass = reader.get<double>();
        g.moments = reader.get<Vec3>();
        const int sites = reader.get<int32_t>();
        for (int i = 0; i < sites; i++) g.sites.push_back(reader.get<Vec3>());
        saved.geometries.push_back(g);
    }
    adoptState(saved);
}

void RigidBodyKernel::serialize(ContextImpl& context, SerializationNode& node) {
    const SavedState saved = collectState(context);
    SerializationNode& root = node.createChildNode("RigidBodyState");
    root.setIntProperty("version", stateVersion);
    root.setLongProperty("seed", saved.seed);
    root.setLongProperty("stepNumber", saved.stepNumber);
    if (!saved.hasBodies) return;
    root.setStringProperty("positionsHash", to_string(saved.positionsHash));
    root.setStringProperty("velocitiesHash", to_string(saved.velocitiesHash));
    SerializationNode& list = root.createChildNode("Bodies");
    for (size_t b = 0; b < saved.bodies.size(); b++) {
        SerializationNode& body = list.createChildNode("Body");
        for (int k = 0; k < 13; k++) body.setDoubleProperty(valueNames[k], saved.bodies[b][k]);
        const BodyGeometry& g = saved.geometries[b];
        body.setDoubleProperty("mass", g.mass);
        body.setDoubleProperty("I1", g.moments[0])
            .setDoubleProperty("I2", g.moments[1])
            .setDoubleProperty("I3", g.moments[2]);
        for (const Vec3& s : g.sites)
            body.createChildNode("Site").setDoubleProperty("x", s[0]).setDoubleProperty("y", s[1]).setDoubleProperty(
                "z", s[2]);
    }
}

void RigidBodyKernel::deserialize(ContextImpl& context, const SerializationNode& node) {
    // A State that was saved under an integrator without parameters carries none: its positions and velocities serve.
    if (node.getChildren().empty() && node.getProperties().empty()) return;
    const SerializationNode* root = nullptr;
    for (const SerializationNode& child : node.getChildren())
        if (child.getName() == "RigidBodyState") root = &child;
    if (root == nullptr)
        fail(
            "the State's integrator parameters belong to another integrator; save it without them (in Python: "
            "getState(getIntegratorParameters=False)), or load it under the integrator it was saved with");
    if (root->getIntProperty("version", 0) != stateVersion)
        fail("the State has version " + root->getStringProperty("version", "none") +
             " of the body state, but this library "
             "reads version " +
             to_string(stateVersion) + "; load it with the library it was saved with");
    SavedState saved;
    try {
        saved.seed = root->getLongProperty("seed");
        saved.stepNumber = root->getLongProperty("stepNumber");
        saved.hasBodies = root->hasProperty("positionsHash");
        if (saved.hasBodies) {
            saved.positionsHash = stoull(root->getStringProperty("positionsHash"));
            saved.velocitiesHash = stoull(root->getStringProperty("velocitiesHash"));
            for (const SerializationNode& body : root->getChildNode("Bodies").getChildren()) {
                array<double, 13> values;
                for (int k = 0; k < 13; k++) values[k] = body.getDoubleProperty(valueNames[k]);
                saved.bodies.push_back(values);
                BodyGeometry g;
                g.mass = body.getDoubleProperty("mass");
                g.moments =
                    Vec3(body.getDoubleProperty("I1"), body.getDoubleProperty("I2"), body.getDoubleProperty("I3"));
                for (const SerializationNode& site : body.getChildren())
                    g.sites.push_back(
                        Vec3(site.getDoubleProperty("x"), site.getDoubleProperty("y"), site.getDoubleProperty("z")));
                saved.geometries.push_back(g);
            }
        }
    } catch (const std::exception& e) {
        fail(string("the State's integrator parameters are corrupt (") + e.what() + "); use another State");
    }
    adoptState(saved);
}

}  // namespace RigidHIPlugin
