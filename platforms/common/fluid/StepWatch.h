#ifndef RIGIDHI_STEP_WATCH_H_
#define RIGIDHI_STEP_WATCH_H_

#include <Eigen/Core>
#include <vector>

#include "rigid/CoupledBodies.h"
#include "rigidbody/Pose.h"

namespace RigidHIPlugin {

/**
 * Watches whether the steps of a scheme without momenta resolve the forces on each element of a
 * group, and the motion that is not random.
 *
 * The first measure needs no mobility. Over a step, let dx be the displacement and the turn of an
 * element, F the force and torque at its beginning, and dF their change. The mean of
 *     -dF dx / max(2 kT, |F dx|)
 * is about the length of the step over the time in which the element relaxes in its forces. In a
 * harmonic trap of stiffness k it is mu k h for short steps, summed over the axes that thermal
 * motion explores.
 *
 * The second measure is the mean displacement in a step, relative to the other elements.
 *
 * Of every `interval` steps the watch looks at one. Checkpoints do not contain the watch, and no
 * step depends on it.
 */
class StepWatch {
public:
    explicit StepWatch(const CoupledBodies& bodies) : bodies(bodies) {}
    /**
     * Take in the forces of a step, which are the first ones that it needs.
     *
     * @param step      the number of steps before
     * @param poses     where the forces are evaluated
     * @param wrenches  forces and torques about the origins, lab frame; one column
     * @param isUniform whether the driven flow moves all elements alike
     */
    void note(long long step, double h, double kT, const std::vector<Pose>& poses,
              const Eigen::MatrixXd& wrenches, bool isUniform);
    /** Positions were set from outside: the next ones do not follow from the former ones. */
    void interrupt() { hasBefore = false; }
    /** The element with the largest finding; -1: none. */
    struct Finding {
        int element = -1;
        double value = 0;
    };
    /** An element whose relaxation takes fewer than two steps, and the steps over this time. */
    const Finding& getStiffest() const { return stiffest; }
    /** An element whose mean displacement is above half the smallest radius, nm. */
    const Finding& getFarthest() const { return farthest; }
    double getSmallestRadius() const { return smallestRadius; }

    static constexpr double largestRelaxation = 0.5;
    /** In smallest radii. */
    static constexpr double largestMeanDisplacement = 0.5;

private:
    struct Sums {
        double relaxation = 0, squareOfRelaxation = 0, squareOfDisplacement = 0;
        Eigen::Vector3d displacement = Eigen::Vector3d::Zero();
        int relaxations = 0;  // samples of relaxation
    };
    void restart();
    void compare(double kT, const std::vector<Pose>& poses, const Eigen::MatrixXd& wrenches,
                 bool isUniform);
    void judge(bool isUniform);

    const CoupledBodies& bodies;
    double stepSize = -1, energy = -1;  // h and kT of the steps so far
    double smallestRadius = 0;
    bool hasBefore = false;
    std::vector<Pose> before;
    Eigen::MatrixXd wrenchesBefore;
    std::vector<Sums> sums;  // of the elements
    int samples = 0;
    Finding stiffest, farthest;
};

}  // namespace RigidHIPlugin

#endif
