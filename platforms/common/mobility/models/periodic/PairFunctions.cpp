#include "mobility/models/periodic/PairFunctions.h"

#include <Eigen/Geometry>
#include <cmath>

#include "mobility/StressletBasis.h"

namespace RigidHIPlugin {

using Eigen::Matrix3d;
using Eigen::Vector3d;

PairFunctions operator-(PairFunctions a, const PairFunctions& b) {
    a.ttI -= b.ttI;
    a.ttR -= b.ttR;
    a.tr -= b.tr;
    a.rt -= b.rt;
    a.rrI -= b.rrI;
    a.rrR -= b.rrR;
    a.ts -= b.ts;
    a.tsR -= b.tsR;
    a.st -= b.st;
    a.stR -= b.stR;
    a.rs -= b.rs;
    a.ssI -= b.ssI;
    a.ssV -= b.ssV;
    a.ssR -= b.ssR;
    return a;
}

Vector3d velocityOf(const PairFunctions& f, const Vector3d& r, const Vector3d& force,
                    const Vector3d& torque, const double* stresslet) {
    Vector3d velocity = f.ttI * force + f.ttR * r.dot(force) * r + f.tr * torque.cross(r);
    if (!stresslet) return velocity;
    const Vector3d Sr = contractBasis(r) * Eigen::Map<const Eigen::Matrix<double, 5, 1>>(stresslet);
    return velocity + f.ts * Sr + f.tsR * r.dot(Sr) * r;
}

void PairBlocks::setZero() {
    tt.setZero();
    tr.setZero();
    rt.setZero();
    rr.setZero();
    ts.setZero();
    rs.setZero();
    st.setZero();
    sr.setZero();
    ss.setZero();
}

void PairBlocks::add(const PairFunctions& f, const Vector3d& r, bool stresslets) {
    Matrix3d cross;  // cross b = r x b
    cross << 0, -r.z(), r.y(), r.z(), 0, -r.x(), -r.y(), r.x(), 0;
    tt += f.ttR * r * r.transpose();
    tt.diagonal().array() += f.ttI;
    tr -= f.tr * cross;
    rt -= f.rt * cross;
    rr += f.rrR * r * r.transpose();
    rr.diagonal().array() += f.rrI;
    if (!stresslets) return;
    const Eigen::Matrix<double, 3, 5> v = contractBasis(r);
    const Eigen::Matrix<double, 1, 5> s = r.transpose() * v;
    ts += f.ts * v + f.tsR * r * s;
    st -= f.st * v + f.stR * r * s;
    const Eigen::Matrix<double, 3, 5> turned = f.rs * cross * v;
    rs -= turned;
    sr -= turned;
    ss += f.ssV * v.transpose() * v + f.ssR * s.transpose() * s;
    ss.diagonal().array() += f.ssI;
}

void besselQuotients(double x, double (&phi)[5]) {
    const double x2 = x * x, seriesBelow = 2;
    if (x < seriesBelow) {
        // phi_n = sum over m of (-x^2/2)^m/(m! (2n + 2m + 1)!!). After 12 terms, the terms at x = 2
        // are below 1e-17.
        const int numTerms = 14;
        double third = 0, fourth = 0;
        for (int m = numTerms; m > 0; m--) {
            third = (third + 1) * (-0.5 * x2) / (m * (2 * m + 7));
            fourth = (fourth + 1) * (-0.5 * x2) / (m * (2 * m + 9));
        }
        phi[3] = (1 + third) / 105;
        phi[4] = (1 + fourth) / 945;
        for (int n = 2; n >= 0; n--) phi[n] = (2 * n + 3) * phi[n + 1] - x2 * phi[n + 2];
        return;
    }
    phi[0] = std::sin(x) / x;
    phi[1] = (phi[0] - std::cos(x)) / x2;
    for (int n = 1; n < 4; n++) phi[n + 1] = ((2 * n + 1) * phi[n] - phi[n - 1]) / x2;
}

}  // namespace RigidHIPlugin
