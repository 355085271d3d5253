// The loops over bodies, for one body at a time (Real = double) or a SIMD pack of bodies.
//
// A Real has arithmetic, construction from double, sincos, squareRoot, maximum (Quaternion-inl.h),
// and the functions load, store, lanes and noisePairs below.

#if defined(RIGIDHI_BODY_LOOPS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef RIGIDHI_BODY_LOOPS_INL_H_
#undef RIGIDHI_BODY_LOOPS_INL_H_
#else
#define RIGIDHI_BODY_LOOPS_INL_H_
#endif

#include "host/BodyMoves-inl.h"
#include "host/StepSettings.h"
#include "schemes/Thermostats-inl.h"

namespace RigidHIPlugin {
namespace RIGIDHI_TARGET {

// The scalar versions of these functions.
inline void load(const double* from, double& x) { x = *from; }
inline void store(double x, double* to) { *to = x; }
inline int lanes(double) { return 1; }
inline bool isFinite(double x) { return x - x == 0; }
template <int count>
inline void noisePairs(const NoiseStream& noise, uint32_t purpose, const int* index,
                       uint32_t firstBlock, double (&numbers)[2 * count]) {
    for (int k = 0; k < count; k++)
        noise.pair(purpose, index[0], firstBlock + k, numbers[2 * k], numbers[2 * k + 1]);
}

template <class Real>
inline Vector3<Real> loadVector(const BodySet::Column* v, int slot) {
    Vector3<Real> r;
    load(&v[0][slot], r.x);
    load(&v[1][slot], r.y);
    load(&v[2][slot], r.z);
    return r;
}
template <class Real>
inline void storeVector(const Vector3<Real>& r, BodySet::Column* v, int slot) {
    store(r.x, &v[0][slot]);
    store(r.y, &v[1][slot]);
    store(r.z, &v[2][slot]);
}
template <class Real>
inline Real loadScalar(const BodySet::Column& v, int slot) {
    Real r;
    load(&v[slot], r);
    return r;
}

/** One body (or pack) on its way through a step: loads and stores around the moves. */
template <class Real>
class BodyFlow : public BodyMoves<Real, double, BodyFlow<Real>> {
    using Moves = BodyMoves<Real, double, BodyFlow<Real>>;

public:
    using Moves::force_lab;
    using Moves::inverseMass;
    using Moves::inverseMoments;
    using Moves::l;
    using Moves::p;
    using Moves::q;
    using Moves::R;
    using Moves::torque;

    BodyFlow(BodySet& bodies, const StepSettings& settings, int slot)
        : bodies(bodies), settings(settings), slot(slot),
          block(bodies.blocks[slot / BodySet::blockSize]) {
        R = loadVector<Real>(bodies.R, slot);
        p = loadVector<Real>(bodies.p, slot);
        l = loadVector<Real>(bodies.l, slot);
        q = {loadScalar<Real>(bodies.q[0], slot), loadScalar<Real>(bodies.q[1], slot),
             loadScalar<Real>(bodies.q[2], slot), loadScalar<Real>(bodies.q[3], slot)};
        inverseMass = loadScalar<Real>(bodies.inverseMass, slot);
        inverseMoments = loadVector<Real>(bodies.inverseMoments, slot);
        force_lab = loadVector<Real>(bodies.force_lab, slot);
        torque = loadVector<Real>(bodies.torque, slot);
    }
    void storePose() {
        renormalise(q);
        storeVector(R, bodies.R, slot);
        store(q.w, &bodies.q[0][slot]);
        store(q.x, &bodies.q[1][slot]);
        store(q.y, &bodies.q[2][slot]);
        store(q.z, &bodies.q[3][slot]);
    }
    void storeMomenta() {
        storeVector(p, bodies.p, slot);
        storeVector(l, bodies.l, slot);
    }

    // The functions that BodyMoves needs.
    RotorKind rotor() const { return block.rotor; }
    bool hasNoise() const { return block.hasNoise; }
    Real decay_p() const { return loadScalar<Real>(bodies.decay_p, slot); }
    Real noise_p() const { return loadScalar<Real>(bodies.noise_p, slot); }
    Real move_R() const { return loadScalar<Real>(bodies.move_R, slot); }
    Real noise_R() const { return loadScalar<Real>(bodies.noise_R, slot); }
    Vector3<Real> decay_l() const { return loadVector<Real>(bodies.decay_l, slot); }
    Vector3<Real> noise_l() const { return loadVector<Real>(bodies.noise_l, slot); }
    Vector3<Real> move_q() const { return loadVector<Real>(bodies.move_q, slot); }
    Vector3<Real> noise_q() const { return loadVector<Real>(bodies.noise_q, slot); }
    void drawNoise(int draw, Vector3<Real>& xi, Vector3<Real>& eta) {
        const uint32_t purpose = draw == 0 ? NoiseStream::FirstDraw : NoiseStream::SecondDraw;
        const int* index = &bodies.bodyOfSlot[slot];
        if (block.rotor == RotorKind::Point) {
            Real n[4];
            noisePairs<2>(settings.noise, purpose, index, 0, n);
            xi = {n[0], n[1], n[2]};
            eta = {Real(0.0), Real(0.0), Real(0.0)};
        } else {
            Real n[6];
            noisePairs<3>(settings.noise, purpose, index, 0, n);
            xi = {n[0], n[1], n[2]};
            eta = {n[3], n[4], n[5]};
        }
        int active = 0;
        for (int i = 0; i < lanes(R.x); i++) active += bodies.drawsNoise[slot + i];
        randomNumbers += active * (block.rotor == RotorKind::Point    ? 3
                                   : block.rotor == RotorKind::Linear ? 5
                                                                      : 6);
    }

    /**
     * Sum the forces of the particles: force in the lab frame, torque about the origin in the frame
     * of BodySet::torquesAreInLab().
     */
    void gatherForces(const double* forces) {
        const int lane = slot % BodySet::blockSize;
        force_lab = {Real(0.0), Real(0.0), Real(0.0)};
        Vector3<Real> torque_lab = force_lab;
        const Rotation<Real> A(q);
        for (int s = block.firstSite; s < block.firstSite + block.numSites; s++) {
            const Vector3<Real> force =
                gather(&bodies.forceParticle[s * BodySet::blockSize + lane], forces);
            force_lab += force;
            torque_lab += cross(A.toLab(site(s, lane)), force);
        }
        torque = bodies.torquesAreInLab() ? torque_lab : A.toBody(torque_lab);
        storeVector(force_lab, bodies.force_lab, slot);
        storeVector(torque, bodies.torque, slot);
    }
    /**
     * Momentum and angular momentum from the velocities of the members: p = sum m v and, in the
     * body frame, l = sum m s x v times the inertia scale.
     */
    void gatherMomenta(const double* velocities) {
        const int lane = slot % BodySet::blockSize;
        p = l = {Real(0.0), Real(0.0), Real(0.0)};
        const Rotation<Real> A(q);
        for (int s = block.firstSite; s < block.firstSite + block.numSites; s++) {
            Real mass;
            load(&bodies.siteMass[s * BodySet::blockSize + lane], mass);
            const Vector3<Real> momentum =
                mass * gather(&bodies.siteParticle[s * BodySet::blockSize + lane], velocities);
            p += momentum;
            l += cross(site(s, lane), A.toBody(momentum));
        }
        l = Real(bodies.getInertiaScale()) * l;
        if (block.rotor == RotorKind::Linear) l.x = Real(0.0);
        if (block.rotor == RotorKind::Point) l = {Real(0.0), Real(0.0), Real(0.0)};
    }
    void scatterPositions(double* positions, double* copy) const {
        const int lane = slot % BodySet::blockSize;
        const Rotation<Real> A(q);
        for (int s = block.firstSite; s < block.firstSite + block.numSites; s++)
            scatter(s, R + A.toLab(site(s, lane)), positions, copy);
    }
    void scatterVelocities(double* velocities, double* copy) const {
        const int lane = slot % BodySet::blockSize;
        const Rotation<Real> A(q);
        const Vector3<Real> omega_body = multiply(l, inverseMoments), velocity = inverseMass * p;
        for (int s = block.firstSite; s < block.firstSite + block.numSites; s++)
            scatter(s, velocity + A.toLab(cross(omega_body, site(s, lane))), velocities, copy);
    }
    /** Held bodies: set all velocities to exactly 0, never to -0. */
    void scatterRest(double* velocities, double* copy) const {
        const Vector3<Real> zero = {Real(0.0), Real(0.0), Real(0.0)};
        for (int s = block.firstSite; s < block.firstSite + block.numSites; s++)
            scatter(s, zero, velocities, copy);
    }

    bool isHeld() const { return block.rotor == RotorKind::Held; }
    bool massesMakeTheBodies() const { return block.massesMakeTheBodies; }
    bool poseIsFinite() const { return isFinite(R.x + R.y + R.z + q.w + q.x + q.y + q.z); }
    bool momentaAreFinite() const { return isFinite(p.x + p.y + p.z + l.x + l.y + l.z); }
    bool forcesAreFinite() const {
        return isFinite(force_lab.x + force_lab.y + force_lab.z + torque.x + torque.y + torque.z);
    }

    long long randomNumbers = 0;

private:
    Vector3<Real> site(int s, int lane) const {
        const double* from = &bodies.sites[s * 3 * BodySet::blockSize + lane];
        Vector3<Real> r;
        load(from, r.x);
        load(from + BodySet::blockSize, r.y);
        load(from + 2 * BodySet::blockSize, r.z);
        return r;
    }
    /** One vector of each lane's particle; zero for a lane without one (-1). */
    static Vector3<Real> gather(const int* particle, const double* from) {
        static const double zero[3] = {0, 0, 0};
        double v[3][BodySet::blockSize];
        for (int i = 0; i < lanes(Real(0.0)); i++) {
            const double* source = particle[i] >= 0 ? from + 3 * particle[i] : zero;
            v[0][i] = source[0];
            v[1][i] = source[1];
            v[2][i] = source[2];
        }
        Vector3<Real> result;
        load(v[0], result.x);
        load(v[1], result.y);
        load(v[2], result.z);
        return result;
    }
    void scatter(int s, const Vector3<Real>& value, double* to, double* copy) const {
        const int width = lanes(R.x), lane = slot % BodySet::blockSize;
        double v[3][BodySet::blockSize];
        store(value.x, v[0]);
        store(value.y, v[1]);
        store(value.z, v[2]);
        const int* particle = &bodies.siteParticle[s * BodySet::blockSize + lane];
        for (int i = 0; i < width; i++)
            if (particle[i] >= 0)
                for (int c = 0; c < 3; c++)
                    copy[3 * particle[i] + c] = to[3 * particle[i] + c] = v[c][i];
    }
    BodySet& bodies;
    const StepSettings& settings;
    const int slot;
    const BodySet::Block& block;
};

/**
 * Call action(flow) for every body (or pack) of a range of blocks, and for held bodies only if
 * Action::concernsHeld. The action returns whether its numbers were finite.
 */
template <class Real, class Action>
inline LoopResult forEachBody(BodySet& bodies, const StepSettings& settings, int firstBlock,
                              int endBlock, Action action) {
    LoopResult result;
    const int width = lanes(Real(0.0));
    for (int slot = firstBlock * BodySet::blockSize; slot < endBlock * BodySet::blockSize;
         slot += width) {
        if (bodies.bodyOfSlot[slot] < 0) continue;  // padding comes last in a block
        if (!Action::concernsHeld &&
            bodies.blocks[slot / BodySet::blockSize].rotor == RotorKind::Held)
            continue;
        BodyFlow<Real> flow(bodies, settings, slot);
        result.finite &= action(flow);
        result.randomNumbers += flow.randomNumbers;
    }
    return result;
}

/** The part of a step before the force evaluation: new poses, new positions of the particles. */
template <class Real, class Scheme>
struct BeforeForces {
    static const bool concernsHeld = false;
    const StepSettings& settings;
    const ParticleArrays& arrays;
    bool operator()(BodyFlow<Real>& flow) const {
        Scheme::beforeForces(flow, settings.h);
        flow.storePose();
        flow.storeMomenta();
        flow.scatterPositions(arrays.positions, arrays.lastPositions);
        return flow.poseIsFinite();
    }
};

/**
 * The part of a step before the fluid changes momenta, if the fluid needs poses in the middle of
 * the step: new poses.
 */
template <class Real, class Scheme>
struct BeforeFriction {
    static const bool concernsHeld = false;
    const StepSettings& settings;
    bool operator()(BodyFlow<Real>& flow) const {
        Scheme::beforeFriction(flow, settings.h);
        flow.storePose();
        flow.storeMomenta();
        return flow.poseIsFinite();
    }
};

/** The part of a step after the fluid has changed momenta: new positions of the particles. */
template <class Real, class Scheme>
struct AfterFriction {
    static const bool concernsHeld = false;
    const StepSettings& settings;
    const ParticleArrays& arrays;
    bool operator()(BodyFlow<Real>& flow) const {
        Scheme::afterFriction(flow, settings.h);
        flow.storePose();
        flow.storeMomenta();
        flow.scatterPositions(arrays.positions, arrays.lastPositions);
        return flow.poseIsFinite();
    }
};

/**
 * The part of a step after the force evaluation: new momenta, new velocities of the particles. Held
 * bodies have forces, but no momenta.
 */
template <class Real, class Scheme>
struct AfterForces {
    static const bool concernsHeld = true;
    const StepSettings& settings;
    const ParticleArrays& arrays;
    bool operator()(BodyFlow<Real>& flow) const {
        if (!settings.forcesAreGathered) flow.gatherForces(arrays.forces);
        if (flow.isHeld()) {
            if (settings.hasMomenta()) flow.scatterRest(arrays.velocities, arrays.lastVelocities);
            return flow.forcesAreFinite();
        }
        Scheme::afterForces(flow, settings.h);
        flow.storeMomenta();
        if (settings.hasMomenta()) flow.scatterVelocities(arrays.velocities, arrays.lastVelocities);
        return flow.forcesAreFinite() && flow.momentaAreFinite();
    }
};

/** The loops that do not depend on the scheme. */
template <class Real>
struct SchemelessLoop {
    static const bool concernsHeld = true;
    BodyLoop loop;
    BodySet& bodies;
    const ParticleArrays& arrays;
    bool operator()(BodyFlow<Real>& flow) const {
        if (loop == BodyLoop::GatherForces) {
            flow.gatherForces(arrays.forces);
            return flow.forcesAreFinite();
        }
        if (loop == BodyLoop::ScatterPositions)
            flow.scatterPositions(arrays.positions, arrays.lastPositions);
        // The momenta of held bodies are always 0.
        if (flow.isHeld()) {
            if (loop == BodyLoop::ScatterVelocities || loop == BodyLoop::TakeInAndScatterVelocities)
                flow.scatterRest(arrays.velocities, arrays.lastVelocities);
            return true;
        }
        if (loop == BodyLoop::ScatterVelocities)
            flow.scatterVelocities(arrays.velocities, arrays.lastVelocities);
        const bool scatter = loop == BodyLoop::TakeInAndScatterVelocities;
        if ((loop == BodyLoop::TakeInVelocities || scatter) && flow.massesMakeTheBodies()) {
            flow.gatherMomenta(arrays.velocities);
            flow.storeMomenta();
            if (scatter) flow.scatterVelocities(arrays.velocities, arrays.lastVelocities);
        }
        return true;
    }
};

/** Run one loop over a range of blocks. */
template <class Real>
inline LoopResult runBodyLoop(BodyLoop loop, BodySet& bodies, const StepSettings& settings,
                              const ParticleArrays& arrays, int firstBlock, int endBlock) {
    const auto run = [&](auto action) {
        return forEachBody<Real>(bodies, settings, firstBlock, endBlock, action);
    };
    switch (loop) {
        case BodyLoop::BeforeForces:
            return withThermostat(settings.scheme, [&](auto scheme) {
                return run(BeforeForces<Real, decltype(scheme)>{settings, arrays});
            });
        case BodyLoop::AfterForces:
            return withThermostat(settings.scheme, [&](auto scheme) {
                return run(AfterForces<Real, decltype(scheme)>{settings, arrays});
            });
        case BodyLoop::BeforeFriction:
            return withFluidThermostat(settings.scheme, [&](auto scheme) {
                return run(BeforeFriction<Real, decltype(scheme)>{settings});
            });
        case BodyLoop::AfterFriction:
            return withFluidThermostat(settings.scheme, [&](auto scheme) {
                return run(AfterFriction<Real, decltype(scheme)>{settings, arrays});
            });
        case BodyLoop::GatherForces:
        case BodyLoop::ScatterPositions:
        case BodyLoop::ScatterVelocities:
        case BodyLoop::TakeInVelocities:
        case BodyLoop::TakeInAndScatterVelocities: break;
    }
    return run(SchemelessLoop<Real>{loop, bodies, arrays});
}

/** Fill xi with three numbers for each of `count` particles (their indices are in `index`). */
template <class Real>
inline void fillNoise(const NoiseStream& noise, uint32_t purpose, const int* index, int count,
                      double* xi) {
    const int width = lanes(Real(0.0));
    for (int i = 0; i < count; i += width) {
        int padded[BodySet::blockSize] = {0};
        for (int k = 0; k < width && i + k < count; k++) padded[k] = index[i + k];
        Real n[4];
        noisePairs<2>(noise, purpose, padded, 0, n);
        double v[3][BodySet::blockSize];
        for (int c = 0; c < 3; c++) store(n[c], v[c]);
        for (int k = 0; k < width && i + k < count; k++)
            for (int c = 0; c < 3; c++) xi[3 * (i + k) + c] = v[c][k];
    }
}

}  // namespace RIGIDHI_TARGET
}  // namespace RigidHIPlugin

#endif
