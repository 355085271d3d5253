#include "mobility/models/ewald/NearPair.h"

#include <cmath>

#include "mobility/models/periodic/PeriodicMobility.h"

namespace RigidHIPlugin {

NearPair::NearPair(double a_i, double a_j, double xi, bool torques, bool stresslets)
    : a_i(a_i), a_j(a_j), torques(torques), stresslets(stresslets) {
    // Gaussians are cut off where they are exp(-depth^2) = 2e-16.
    const double depth = 6, largestWave = 2 * depth * xi;
    reach = depth / xi + a_i + a_j;
    // The trapezoidal rule adds copies of the functions at other periods. For distances within the
    // reach, these copies are farther away than twice the reach.
    const double step = M_PI / reach;
    const int numNodes = std::ceil(largestWave / step);
    nodes = Eigen::ArrayXd::LinSpaced(numNodes + 1, 0, numNodes * step);
    ss.resize(numNodes + 1);
    st = ts = tt = ss;
    for (int n = 0; n <= numNodes; n++) {
        const WaveFactors i = overSurfaces().waveFactors(a_i, nodes[n]),
                          j = overSurfaces().waveFactors(a_j, nodes[n]);
        const double weight = 4 / M_PI * step * (n == 0 ? 0.5 : 1) * hasimoto(nodes[n], xi);
        ss[n] = weight * i.s * j.s;
        st[n] = weight * i.s * j.t;
        ts[n] = weight * i.t * j.s;
        tt[n] = weight * i.t * j.t;
    }
}

PairFunctions NearPair::screened(double distance) const {
    PairFunctions f;
    for (int n = 0; n < nodes.size(); n++) {
        double phi[5];
        besselQuotients(nodes[n] * distance, phi);
        const double k2 = nodes[n] * nodes[n];
        f.ttI += ss[n] * (phi[0] - phi[1]);
        f.ttR += ss[n] * k2 * phi[2];
        if (!torques) continue;
        f.tr += 0.5 * st[n] * k2 * phi[1];
        f.rt += 0.5 * ts[n] * k2 * phi[1];
        f.rrI += 0.25 * tt[n] * k2 * (phi[0] - phi[1]);
        f.rrR += 0.25 * tt[n] * k2 * k2 * phi[2];
        if (stresslets) addStressletsOfWave(k2, st[n], ts[n], tt[n], phi, f);
    }
    return f;
}

PairFunctions NearPair::withoutScreened(double distance, const PairFunctions& f) const {
    return overSurfaces().free(a_i, a_j, distance, torques, stresslets) - f;
}

PairFunctions NearPair::at(double distance) const {
    return withoutScreened(distance, screened(distance));
}

}  // namespace RigidHIPlugin
