#ifndef RIGIDHI_LUBRICATION_REACH_H_
#define RIGIDHI_LUBRICATION_REACH_H_

namespace RigidHIPlugin {

/**
 * How far the lubrication of a pair reaches, in mean radii of the pair. It has its full strength up
 * to a distance `whole` of the centres, and vanishes from the distance `nothing` on. In between its
 * weight is w = 1 - 10 z^3 + 15 z^4 - 6 z^5, which has two continuous derivatives.
 */
struct LubricationReach {
    double whole, nothing;

    double weight(double distance) const {
        const double z = (distance - whole) / (nothing - whole);
        if (z <= 0) return 1;
        if (z >= 1) return 0;
        return 1 + z * z * z * (-10 + z * (15 - 6 * z));
    }
};

}  // namespace RigidHIPlugin

#endif
