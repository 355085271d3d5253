// The moves of which the schemes of rigid bodies consist: arithmetic on one body (or on a pack of
// bodies, or on lines of kernel text), without loads and stores.
//
// A Real has arithmetic, construction from double, sincos, squareRoot and maximum
// (Quaternion-inl.h).

#if defined(RIGIDHI_BODY_MOVES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef RIGIDHI_BODY_MOVES_INL_H_
#undef RIGIDHI_BODY_MOVES_INL_H_
#else
#define RIGIDHI_BODY_MOVES_INL_H_
#endif

#include "rigidbody/BodySet.h"
#include "rigidbody/FreeRotor-inl.h"
#include "rigidbody/Quaternion-inl.h"

namespace RigidHIPlugin {
namespace RIGIDHI_TARGET {

/**
 * One body (or pack) on its way through a step. The members are the moves of which schemes consist.
 *
 * @tparam Time  the type of a time: double, or a Real if the step is a variable of kernel text
 * @tparam Flow  the class that derives from this one. It has rotor(), hasNoise(), the factors of
 *     the thermostat as decay_p(), noise_p(), decay_l(), noise_l(), move_R(), noise_R(), move_q()
 *     and noise_q(), and drawNoise(draw, xi, eta).
 */
template <class Real, class Time, class Flow>
class BodyMoves {
public:
    /** p <- p + t f, l <- l + t tau. Axes without inertia take no angular momentum. */
    void kick(const Time& t) {
        p += Real(t) * force_lab;
        if (flow().rotor() == RotorKind::General)
            l += Real(t) * torque;
        else if (flow().rotor() == RotorKind::Linear)
            l += Real(t) * Vector3<Real>{Real(0.0), torque.y, torque.z};
    }
    /** R <- R + t p/m; free rotation over t. */
    void drift(const Time& t) {
        R += Real(t) * inverseMass * p;
        if (flow().rotor() == RotorKind::General)
            rotateFreely(q, l, inverseMoments, t);
        else if (flow().rotor() == RotorKind::Linear)
            rotateLinearBodyFreely(q, l, inverseMoments, t);
    }
    /** p <- decay p, l <- decay l. */
    void damp() {
        p = flow().decay_p() * p;
        l = multiply(flow().decay_l(), l);
    }
    /** Add noise to p and l, with the random numbers of set `draw` of this step. */
    void addNoise(int draw) {
        if (!flow().hasNoise()) return;
        Vector3<Real> xi, eta;
        flow().drawNoise(draw, xi, eta);
        p += flow().noise_p() * xi;
        if (flow().rotor() != RotorKind::Point) l += multiply(flow().noise_l(), eta);
    }
    void ornsteinUhlenbeck(int draw) {
        damp();
        addNoise(draw);
    }
    /** The step of the gradient thermostat (GradientThermostat-inl.h). */
    void gradientMove(int draw) {
        const Vector3<Real> turn_body = multiply(flow().move_q(), torque);
        Vector3<Real> right = turn_body;
        R += flow().move_R() * force_lab;
        const Vector3<Real> left = Rotation<Real>(q).toLab(turn_body);
        if (flow().hasNoise()) {
            Vector3<Real> xi, eta;
            flow().drawNoise(draw, xi, eta);
            R += flow().noise_R() * xi;
            if (flow().rotor() != RotorKind::Point) right += multiply(flow().noise_q(), eta);
        }
        if (flow().rotor() != RotorKind::Point) q = exponential(left) * q * exponential(right);
    }

    // The torque is in the frame of BodySet::torquesAreInLab().
    Vector3<Real> R, p, l, force_lab, torque, inverseMoments;
    Quaternion<Real> q;
    Real inverseMass;

private:
    Flow& flow() { return static_cast<Flow&>(*this); }
};

/**
 * A free particle on its way through a step, without constraints: the moves of FreeParticles, with
 * the velocity in the place of a momentum.
 *
 * @tparam Flow  as in BodyMoves; it has decay_p(), noise_p(), move_R(), noise_R() and drawNoise().
 */
template <class Real, class Time, class Flow>
class FreeParticleMoves {
public:
    void kick(const Time& t) { v += Real(t) * inverseMass * force; }
    void drift(const Time& t) { r += Real(t) * v; }
    void damp() { v = flow().decay_p() * v; }
    void addNoise(int draw) {
        Vector3<Real> xi, eta;
        flow().drawNoise(draw, xi, eta);
        v += flow().noise_p() * inverseMass * xi;
    }
    void ornsteinUhlenbeck(int draw) {
        damp();
        addNoise(draw);
    }
    void gradientMove(int draw) {
        Vector3<Real> xi, eta;
        flow().drawNoise(draw, xi, eta);
        r += flow().move_R() * force;
        r += flow().noise_R() * xi;
    }

    Vector3<Real> r, v, force;
    Real inverseMass;

private:
    Flow& flow() { return static_cast<Flow&>(*this); }
};

}  // namespace RIGIDHI_TARGET
}  // namespace RigidHIPlugin

#endif
