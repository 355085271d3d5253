#include "forces/BodyMotions.h"

#include <cmath>

#include "forces/CompiledExpressions.h"
#include "openmmrigidhi/internal/CustomBodyMotionImpl.h"
#include "rigidbody/EigenVec3.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

namespace {

constexpr ErrorsOf failMotion{"CustomBodyMotion"};

const char* const componentNames[6] = {"vx", "vy", "vz", "wx", "wy", "wz"};

/** Blobs nearer to a line than this, relative to their distances, are on it. */
constexpr double lineTolerance = 1e-9;

/** Whether sites are on a line along one of the body's axes. */
bool areOnLineAlong(int axis, const vector<Vector3d>& sites) {
    double across = 0, along = 0;
    for (const Vector3d& site : sites) {
        Vector3d r = site - sites[0];
        along = max(along, abs(r[axis]));
        r[axis] = 0;
        across = max(across, r.norm());
    }
    return across <= lineTolerance * along;
}

}  // namespace

string PrescribedComponents::names() const {
    string result;
    for (int c = 0; c < 6; c++)
        if (components >> c & 1) result += (result.empty() ? "" : ", ") + string(componentNames[c]);
    return result;
}

Matrix3d userAxes(const BodySet& bodies, int body) {
    Matrix3d axes;
    for (int k = 0; k < 3; k++)
        axes.col(k) = toEigen(bodies.toInner(body, OpenMM::Vec3(k == 0, k == 1, k == 2)));
    return axes;
}

/** One CustomBodyMotion, with the expressions of the components that are not free. */
struct BodyMotions::Motion : CompiledExpressions {
    Motion(int index, const CustomBodyMotionImpl& impl) : CompiledExpressions(index, impl) {
        prescribed.force = index;
        prescribed.inBody = impl.getOwner().getFrame() == CustomBodyMotion::Body;
        for (int c = 0; c < 6; c++) {
            if (impl.getOwner().getExpression(componentNames[c]).empty()) continue;
            compile(componentNames[c]);
            components.push_back(c);
            prescribed.components |= 1u << c;
            if (expressions().back().isZero()) prescribed.zeros |= 1u << c;
        }
    }
    PrescribedComponents prescribed;
    vector<int> components;  // of the expressions
};

BodyMotions::BodyMotions() {}
BodyMotions::~BodyMotions() {}
BodyMotions& BodyMotions::operator=(BodyMotions&&) = default;

BodyMotions::BodyMotions(const vector<OpenMM::ForceImpl*>& impls, int numBodies)
    : numBodies(numBodies) {
    for (size_t i = 0; i < impls.size(); i++) {
        const auto* impl = dynamic_cast<const CustomBodyMotionImpl*>(impls[i]);
        if (impl == nullptr) continue;
        auto motion = make_unique<Motion>(i, *impl);
        for (int b : motion->getBodies()) {
            const auto added = prescribed.insert({b, motion->prescribed});
            if (!added.second)
                failMotion("forces " + to_string(added.first->second.force) + " and " +
                           to_string(i) + " both prescribe the motion of body " + to_string(b) +
                           "; remove the body from one of them");
        }
        time = time || motion->uses(0, 1);
        motions.push_back(move(motion));
    }
}

void BodyMotions::evaluate(const map<string, double>& parametersOfContext, double t,
                           MatrixXd& values) {
    values.setZero(6, numBodies);
    for (const auto& motion : motions) {
        motion->setGlobals(parametersOfContext);
        motion->variables()[0] = t;
        int entry = 0;
        for (int b : motion->getBodies()) {
            motion->setEntry(entry++);
            for (size_t i = 0; i < motion->components.size(); i++) {
                const int c = motion->components[i];
                const double value = values(c, b) = motion->expressions()[i].evaluate();
                if (!isfinite(value))
                    failMotion("force " + to_string(motion->getForce()),
                               string(componentNames[c]) + " of body " + to_string(b) + " is " +
                                   text(value) + " at t = " + text(t) + " ps",
                               "a prescribed velocity must be finite",
                               "correct its expression or its parameters");
            }
        }
    }
}

void BodyMotions::checkSpins(const vector<BodyGeometry>& geometries,
                             const vector<vector<int>>& particlesOfBodies,
                             const MobilityForce* fluid) const {
    if (fluid == nullptr) return;
    for (const auto& [b, components] : prescribed) {
        if (!components.inBody || fluid->getBodyHasOwnTensor(b)) continue;
        vector<Vector3d> sites;
        for (size_t i = 0; i < particlesOfBodies[b].size(); i++)
            if (fluid->getParticleRadius(particlesOfBodies[b][i]) > 0)
                sites.push_back(toEigen(geometries[b].sites[i]));
        if (sites.size() < 2) continue;
        for (int axis = 0; axis < 3; axis++) {
            const unsigned spin = 1u << (3 + axis);
            if ((components.components & ~components.zeros & spin) != 0 &&
                areOnLineAlong(axis, sites))
                failMotion(
                    "force " + to_string(components.force) + " prescribes " +
                    componentNames[3 + axis] + " of body " + to_string(b) +
                    ", but all its hydrodynamic particles are on one line along this axis, so "
                    "that the spin has no effect on the fluid; leave the component free by an "
                    "empty expression, or prescribe 0");
        }
    }
}

string BodyMotions::describe() const {
    if (!isOn()) return "no CustomBodyMotion prescribes the motion of a body";
    string result;
    for (const auto& motion : motions) {
        const vector<int>& bodies = motion->getBodies();
        if (bodies.empty()) continue;
        result += (result.empty() ? "" : "; ") +
                  (bodies.size() == 1 ? "body " + to_string(bodies[0])
                                      : to_string(bodies.size()) + " bodies") +
                  ": " + motion->prescribed.names() +
                  (motion->prescribed.inBody ? " in the body frame" : "");
    }
    return result;
}

}  // namespace RigidHIPlugin
