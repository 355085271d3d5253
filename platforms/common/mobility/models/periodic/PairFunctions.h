#ifndef RIGIDHI_PAIR_FUNCTIONS_H_
#define RIGIDHI_PAIR_FUNCTIONS_H_

#include <Eigen/Core>

namespace RigidHIPlugin {

/**
 * The mutual mobility of particles i and j, with r = r_i - r_j, as functions of the distance, in
 * units of 1/(8 pi eta):
 *
 *     V_i = ttI F_j + ttR r (r.F_j) + tr T_j x r + ts S_j.r + tsR r (r.S_j.r)
 *     W_i = rt F_j x r + rrI T_j + rrR r (r.T_j) + rs (S_j.r) x r
 *     V_j = ... - st S_i.r - stR r (r.S_i.r),   W_j = ... + rs (S_i.r) x r
 *     S_i:E_i = ssI S_i:S_j + ssV (S_i.r).(S_j.r) + ssR (r.S_i.r) (r.S_j.r)
 */
struct PairFunctions {
    double ttI = 0, ttR = 0, tr = 0, rt = 0, rrI = 0, rrR = 0;
    double ts = 0, tsR = 0, st = 0, stR = 0, rs = 0, ssI = 0, ssV = 0, ssR = 0;
};

/** All functions of a minus those of b. */
PairFunctions operator-(PairFunctions a, const PairFunctions& b);

/**
 * Add the functions of stresslets for one wave number k, with these weights of the spreadings.
 *
 * @param phi  besselQuotients() of k times the distance
 */
inline void addStressletsOfWave(double k2, double st, double ts, double tt, const double (&phi)[5],
                                PairFunctions& f) {
    const double k4 = k2 * k2;
    f.ts += st * k2 * (phi[1] - 2 * phi[2]);
    f.tsR += st * k4 * phi[3];
    f.st += ts * k2 * (phi[1] - 2 * phi[2]);
    f.stR += ts * k4 * phi[3];
    f.rs += 0.5 * tt * k4 * phi[2];
    f.ssI += tt * k2 * (phi[1] - 2 * phi[2]);
    f.ssV -= tt * k4 * (phi[2] - 4 * phi[3]);
    f.ssR -= tt * k4 * k2 * phi[4];
}

/** The velocity V_i above from the force, torque and stresslet (five numbers, or null) of j. */
Eigen::Vector3d velocityOf(const PairFunctions& f, const Eigen::Vector3d& r,
                           const Eigen::Vector3d& force, const Eigen::Vector3d& torque,
                           const double* stresslet);

/**
 * The blocks of a pair, as a sum over images, with rows of i and columns of j. S is in the basis of
 * StressletBasis.h.
 */
struct PairBlocks {
    Eigen::Matrix3d tt, tr, rt, rr;
    Eigen::Matrix<double, 3, 5> ts, rs;  // of S_j on V_i, W_i
    Eigen::Matrix<double, 3, 5> st, sr;  // of S_i on V_j, W_j
    Eigen::Matrix<double, 5, 5> ss;

    void setZero();
    /** @param stresslets  whether to add to their blocks, too */
    void add(const PairFunctions& f, const Eigen::Vector3d& r, bool stresslets);
};

/**
 * phi_n(x) = j_n(x)/x^n for n = 0 ... 4, with spherical Bessel functions j_n. They are entire
 * functions of x^2, computed by series and the downward recurrence for small x, and by the upward
 * recurrence elsewhere. Relative error 1e-15.
 */
void besselQuotients(double x, double (&phi)[5]);

}  // namespace RigidHIPlugin

#endif
