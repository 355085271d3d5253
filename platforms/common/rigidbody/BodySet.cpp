#include "rigidbody/BodySet.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numeric>

#include "rigidbody/Quaternion-inl.h"

using namespace OpenMM;
using namespace std;

namespace RigidHIPlugin {

namespace {

RotorKind rotorKind(const BodyInertia& inertia) {
    const int live = inertia.isLive(0) + inertia.isLive(1) + inertia.isLive(2);
    return live == 3 ? RotorKind::General : live == 2 ? RotorKind::Linear : RotorKind::Point;
}

}  // namespace

BodySet::BodySet(const vector<BodyGeometry>& geometries, const vector<vector<int>>& particles,
                 const vector<vector<double>>& siteMasses, const vector<vector<bool>>& carriesForce,
                 const vector<bool>& held) {
    const int n = geometries.size();
    inertias.resize(n);
    axisOrder.resize(n);
    axisSign.assign(n, {{1, 1, 1}});
    frameTurn.resize(n);
    vector<RotorKind> kinds(n);
    for (int i = 0; i < n; i++) {
        const BodyInertia inertia = liveInertia(geometries[i].mass, geometries[i].moments);
        array<int, 3>& order = axisOrder[i];
        order = {{0, 1, 2}};
        stable_sort(order.begin(), order.end(),
                    [&](int a, int b) { return inertia.moments[a] < inertia.moments[b]; });
        const bool odd = (order[0] > order[1]) ^ (order[0] > order[2]) ^ (order[1] > order[2]);
        if (odd) axisSign[i][2] = -1;  // keep the frame right-handed
        inertias[i].mass = inertia.mass;
        Eigen::Matrix3d columns = Eigen::Matrix3d::Zero();  // inner axes in the user's frame
        for (int k = 0; k < 3; k++) {
            inertias[i].moments[k] = inertia.moments[order[k]];
            columns(order[k], k) = axisSign[i][k];
        }
        const Eigen::Quaterniond turn(columns);
        frameTurn[i] = {{turn.w(), turn.x(), turn.y(), turn.z()}};
        const bool isHeld = !held.empty() && held[i];
        kinds[i] = isHeld ? RotorKind::Held : rotorKind(inertias[i]);
        numHeld += isHeld;
    }
    ownInertias = inertias;

    // Slots: general bodies first, then linear, points and held ones, each kind padded to whole
    // blocks.
    slotOfBody.resize(n);
    for (RotorKind kind :
         {RotorKind::General, RotorKind::Linear, RotorKind::Point, RotorKind::Held}) {
        for (int i = 0; i < n; i++)
            if (kinds[i] == kind) {
                slotOfBody[i] = bodyOfSlot.size();
                bodyOfSlot.push_back(i);
            }
        while (bodyOfSlot.size() % blockSize != 0) bodyOfSlot.push_back(-1);
        while (blocks.size() * blockSize < bodyOfSlot.size()) {
            blocks.emplace_back();
            blocks.back().rotor = kind;
        }
    }

    const int numSlots = bodyOfSlot.size();
    drawsNoise.assign(numSlots, false);
    makeColumns();

    for (int b = 0; b < getNumBlocks(); b++) {
        Block& block = blocks[b];
        block.firstSite = siteParticle.size() / blockSize;
        for (int lane = 0; lane < blockSize; lane++) {
            const int body = bodyOfSlot[b * blockSize + lane];
            if (body >= 0) block.numSites = max<int>(block.numSites, particles[body].size());
        }
        siteParticle.resize((block.firstSite + block.numSites) * blockSize, -1);
        forceParticle.resize(siteParticle.size(), -1);
        sites.resize(3 * siteParticle.size(), 0.0);
        siteMass.resize(siteParticle.size(), 0.0);
        block.massesMakeTheBodies = true;
        for (int lane = 0; lane < blockSize; lane++) {
            const int slot = b * blockSize + lane, body = bodyOfSlot[slot];
            if (body < 0) continue;
            const double mass = inertias[body].mass;
            const bool isHeld = block.rotor == RotorKind::Held;
            inverseMass[slot] = mass > 0 && !isHeld ? 1 / mass : 0;
            // The loops give all held bodies the momentum 0.
            if (siteMasses[body].empty() && !isHeld) block.massesMakeTheBodies = false;
            for (size_t s = 0; s < particles[body].size(); s++) {
                const int entry = block.firstSite + s;
                siteParticle[entry * blockSize + lane] = particles[body][s];
                if (!siteMasses[body].empty())
                    siteMass[entry * blockSize + lane] = siteMasses[body][s];
                if (carriesForce[body][s])
                    forceParticle[entry * blockSize + lane] = particles[body][s];
                const Vec3 site = toInner(body, geometries[body].sites[s]);
                for (int c = 0; c < 3; c++) sites[(entry * 3 + c) * blockSize + lane] = site[c];
            }
        }
    }
    setInverseMoments();
}

void BodySet::makeColumns() {
    vector<Column*> columns;
    const auto add = [&](Column* first, int count) {
        for (int k = 0; k < count; k++) columns.push_back(first + k);
    };
    for (Column* three : {R, p, l, force_lab, torque}) add(three, 3);
    add(q, 4);
    const size_t numOfState = columns.size();
    for (Column* three : {inverseMoments, decay_l, noise_l, move_q, noise_q}) add(three, 3);
    for (Column* one : {&inverseMass, &decay_p, &noise_p, &move_R, &noise_R}) add(one, 1);

    const size_t n = bodyOfSlot.size();
    // A stride that divides a page would put all numbers of a body into the same few lines of the
    // cache.
    stride = n % 256 == 0 ? n + blockSize : n;
    stateSize = numOfState * stride;
    numbers.assign(columns.size() * stride, 0.0);
    for (size_t c = 0; c < columns.size(); c++) columns[c]->first = &numbers[c * stride];
    for (Column* one : {&q[0], &decay_p, &decay_l[0], &decay_l[1], &decay_l[2]})
        fill_n(one->first, n, 1.0);
}

void BodySet::setInverseMoments() {
    for (int b = 0; b < getNumBodies(); b++)
        for (int k = 0; k < 3; k++)
            inverseMoments[k][slotOfBody[b]] =
                inertias[b].isLive(k) && !isHeld(b) ? 1 / inertias[b].moments[k] : 0;
}

void BodySet::setInertiaScale(double factor) {
    if (factor == inertiaScale) return;
    for (int b = 0; b < getNumBodies(); b++)
        for (int k = 0; k < 3; k++) {
            inertias[b].moments[k] = factor * ownInertias[b].moments[k];
            l[k][slotOfBody[b]] *= factor / inertiaScale;
        }
    inertiaScale = factor;
    setInverseMoments();
}

void BodySet::takeStates(const BodySet& others) {
    setInertiaScale(others.inertiaScale);
    torquesInLab = others.torquesInLab;
    for (int b = 0; b < getNumBodies(); b++) {
        // The first columns are those of the state.
        const double* from = others.numbers.data() + others.slot(b);
        double* to = numbers.data() + slot(b);
        for (size_t c = 0; c * stride < stateSize; c++) to[c * stride] = from[c * others.stride];
        if (isHeld(b)) stop(slot(b));
    }
}

/** Set the momenta of a slot to 0. */
void BodySet::stop(int slot) {
    for (int k = 0; k < 3; k++) p[k][slot] = l[k][slot] = 0;
}

Vec3 BodySet::toInner(int body, const Vec3& v) const {
    const auto& order = axisOrder[body];
    const auto& sign = axisSign[body];
    return Vec3(sign[0] * v[order[0]], sign[1] * v[order[1]], sign[2] * v[order[2]]);
}

Vec3 BodySet::toUser(int body, const Vec3& v) const {
    Vec3 result;
    for (int k = 0; k < 3; k++) result[axisOrder[body][k]] = axisSign[body][k] * v[k];
    return result;
}

namespace {
scalar::Rotation<double> rotation(const BodySet::Column* q, int slot) {
    return scalar::Rotation<double>({q[0][slot], q[1][slot], q[2][slot], q[3][slot]});
}
Vec3 toVec3(const scalar::Vector3<double>& v) { return Vec3(v.x, v.y, v.z); }
Vec3 read(const BodySet::Column* v, int slot) { return Vec3(v[0][slot], v[1][slot], v[2][slot]); }
void write(BodySet::Column* v, int slot, const Vec3& x) {
    for (int k = 0; k < 3; k++) v[k][slot] = x[k];
}
}  // namespace

Vec3 BodySet::toLab(int slot, const Vec3& v) const {
    return toVec3(rotation(q, slot).toLab({v[0], v[1], v[2]}));
}

Vec3 BodySet::toInnerBody(int slot, const Vec3& v) const {
    return toVec3(rotation(q, slot).toBody({v[0], v[1], v[2]}));
}

BodyState BodySet::getState(int body) const {
    const int slot = slotOfBody[body];
    BodyState state;
    state.R = read(R, slot);
    state.p = read(p, slot);
    state.l = toUser(body, read(l, slot));
    const auto& turn = frameTurn[body];
    const scalar::Quaternion<double> inner = {q[0][slot], q[1][slot], q[2][slot], q[3][slot]};
    const auto user =
        inner * scalar::conjugate(scalar::Quaternion<double>{turn[0], turn[1], turn[2], turn[3]});
    state.q = {{user.w, user.x, user.y, user.z}};
    return state;
}

void BodySet::setState(int body, const BodyState& state) {
    const int slot = slotOfBody[body];
    write(R, slot, state.R);
    write(p, slot, state.p);
    Vec3 inner = toInner(body, state.l);
    for (int k = 0; k < 3; k++)
        if (!inertias[body].isLive(k)) inner[k] = 0;
    write(l, slot, inner);
    if (isHeld(body)) stop(slot);
    // Turning to the user's frame and back may change last bits. A body that does not turn keeps
    // its bits.
    if (state.q == getState(body).q) return;
    const auto& turn = frameTurn[body];
    const scalar::Quaternion<double> user = {state.q[0], state.q[1], state.q[2], state.q[3]};
    const auto turned = user * scalar::Quaternion<double>{turn[0], turn[1], turn[2], turn[3]};
    q[0][slot] = turned.w;
    q[1][slot] = turned.x;
    q[2][slot] = turned.y;
    q[3][slot] = turned.z;
}

array<double, 13> BodySet::getStoredState(int body) const {
    const int s = slotOfBody[body];
    return {{R[0][s], R[1][s], R[2][s], q[0][s], q[1][s], q[2][s], q[3][s], p[0][s], p[1][s],
             p[2][s], l[0][s], l[1][s], l[2][s]}};
}

void BodySet::setStoredState(int body, const array<double, 13>& v) {
    const int s = slotOfBody[body];
    for (int k = 0; k < 3; k++) {
        R[k][s] = v[k];
        p[k][s] = v[7 + k];
        l[k][s] = v[10 + k];
    }
    for (int k = 0; k < 4; k++) q[k][s] = v[3 + k];
    if (isHeld(body)) stop(s);
}

Vec3 BodySet::getForce_lab(int body) const { return read(force_lab, slotOfBody[body]); }

Vec3 BodySet::getTorque_lab(int body) const {
    const int slot = slotOfBody[body];
    return torquesInLab ? read(torque, slot) : toLab(slot, read(torque, slot));
}

void BodySet::keepTorquesInLab(bool inLab) {
    if (torquesInLab == inLab) return;
    torquesInLab = inLab;
    for (int slot : slotOfBody)
        write(torque, slot,
              inLab ? toLab(slot, read(torque, slot)) : toInnerBody(slot, read(torque, slot)));
}

void BodySet::addForceAndTorque_lab(int body, const Vec3& addedForce_lab,
                                    const Vec3& addedTorque_lab) {
    const int slot = slotOfBody[body];
    write(force_lab, slot, read(force_lab, slot) + addedForce_lab);
    write(
        torque, slot,
        read(torque, slot) + (torquesInLab ? addedTorque_lab : toInnerBody(slot, addedTorque_lab)));
}

Vec3 BodySet::getAngularVelocity_lab(int body) const {
    const int slot = slotOfBody[body];
    Vec3 omega = read(l, slot);
    for (int k = 0; k < 3; k++) omega[k] *= inverseMoments[k][slot];
    return toLab(slot, omega);
}

void BodySet::setAngularVelocity_lab(int body, const Vec3& omega_lab) {
    const int slot = slotOfBody[body];
    Vec3 momentum = toInnerBody(slot, omega_lab);
    for (int k = 0; k < 3; k++) momentum[k] *= inertias[body].moments[k];
    write(l, slot, momentum);
    if (isHeld(body)) stop(slot);
}

void BodySet::setThermostat(int body, const Thermostat& given) {
    const int slot = slotOfBody[body];
    const Thermostat none, &t = isHeld(body) ? none : given;
    decay_p[slot] = t.decay_p;
    noise_p[slot] = t.noise_p;
    move_R[slot] = t.move_R;
    noise_R[slot] = t.noise_R;
    for (int k = 0; k < 3; k++) {
        decay_l[k][slot] = t.decay_l[k];
        noise_l[k][slot] = t.noise_l[k];
        move_q[k][slot] = t.move_q[k];
        noise_q[k][slot] = t.noise_q[k];
    }
    drawsNoise[slot] = t.hasNoise();
    if (t.hasNoise()) blocks[slot / blockSize].hasNoise = true;
}

double BodySet::translationalKineticEnergy() const {
    double sum = 0;
    for (size_t s = 0; s < bodyOfSlot.size(); s++)
        sum += inverseMass[s] * (p[0][s] * p[0][s] + p[1][s] * p[1][s] + p[2][s] * p[2][s]);
    return 0.5 * sum;
}

Vec3 BodySet::rotationalKineticEnergies() const {
    Vec3 sum;
    for (int k = 0; k < 3; k++)
        for (size_t s = 0; s < bodyOfSlot.size(); s++)
            sum[k] += 0.5 * inverseMoments[k][s] * l[k][s] * l[k][s];
    return sum;
}

void BodySet::save(Snapshot& snapshot) const {
    snapshot.values.assign(numbers.begin(), numbers.begin() + stateSize);
}

void BodySet::restore(const Snapshot& snapshot) {
    copy(snapshot.values.begin(), snapshot.values.end(), numbers.begin());
}

void BodySet::restore(const Snapshot& snapshot, int body) {
    for (size_t i = slot(body); i < snapshot.values.size(); i += stride)
        numbers[i] = snapshot.values[i];
}

void BodySet::saveForces(Snapshot& snapshot) const {
    const double* forces = force_lab[0].first;  // the torques come next
    snapshot.values.assign(forces, forces + 6 * stride);
}

void BodySet::restoreForces(const Snapshot& snapshot) {
    copy(snapshot.values.begin(), snapshot.values.end(), force_lab[0].first);
}

}  // namespace RigidHIPlugin
