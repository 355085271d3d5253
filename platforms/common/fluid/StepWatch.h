#ifndef RIGIDHI_STEP_WATCH_H_
#define RIGIDHI_STEP_WATCH_H_

#include <Eigen/Core>
#include <vector>

#include "fluid/BodiesAlone.h"
#include "rigid/CoupledBodies.h"
#include "rigidbody/Pose.h"

namespace RigidHIPlugin {

/**
 * Watches whether the steps of a scheme without momenta resolve the forces on each element of a
 * group, and the motion that is not random.
 *
 * The first measure is the length of the step over the time in which an element relaxes in its
 * forces. Over a step, let dx be the displacement of an element and dF the change of its force.
 * With noise, a block of steps gives the stiffness K that fits dF = -K dx best, for any scheme,
 * step and flow. With the element's mobility mu, the measure is mu K h along the stiffest
 * direction. Turns and torques have a measure of their own. Walls, lubrication and joints hinder
 * motion: the displacements of the block then bound mu. Three blocks in a row must agree, so that a
 * rare collision does not decide. Elements that act on each other may relax faster together than
 * each alone: the watch also compares dF dx of an element with h dF (N dF), where N is the mobility
 * of all. Where forces keep their direction within a step, the ratio is no larger than the fastest
 * relaxation. Where forces act in few samples only, as in rare collisions, it counts if steps
 * overshoot. Without noise, the measure is the mean of
 * -dF dx/|F dx| over steps, for forces and torques together, where F is the force at the beginning
 * of the step. This is exact where the motion follows these forces, also for elements that
 * interact. In a flow, and with forces at a mid-point, h/(dx zeta dx) takes the place of 1/|F dx|,
 * with the element's own friction zeta, unless its motion is hindered.
 *
 * The second measure is the mean displacement in a step, relative to the other elements, or a
 * single leap of many radii.
 *
 * The third measure finds steps so short that nothing moves: the largest displacement or turn of
 * any element in some hundred steps with noise.
 *
 * Of every `interval` steps the watch looks at one. Checkpoints do not contain the watch, and no
 * step depends on it.
 */
class StepWatch {
public:
    /** @param alone  of the elements */
    StepWatch(const CoupledBodies& bodies, BodiesAlone& alone) : bodies(bodies), alone(alone) {}
    /** What the motion of a step consists of. */
    struct Motion {
        bool flowIsUniform;  // the driven flow moves all elements alike
        bool followsForces;  // without noise it is h times mobility times the forces noted
    };
    /** Joints hinder the motion of elements. */
    void setHasJoints(bool has) { hasJoints = has; }
    /**
     * Take in the forces of a step, which are the first ones that it needs.
     *
     * @param step      the number of steps before
     * @param poses     where the forces are evaluated
     * @param wrenches  forces and torques about the origins, lab frame; one column
     */
    void note(long long step, double h, double kT, const std::vector<Pose>& poses,
              const Eigen::MatrixXd& wrenches, const Motion& motion);
    /**
     * The falls of the forces over the step that note() has looked at, for the velocities that the
     * mobility of all elements gives them; null: the watch does not want them.
     */
    const Eigen::MatrixXd* getFalls() const { return wantsVelocities ? &falls : nullptr; }
    /** Whether these are the poses of the last note(), where velocities are wanted. */
    bool isAt(const std::vector<Pose>& poses) const;
    /** Take in the mobility at the poses of the last note() times getFalls(). */
    void addVelocities(const Eigen::MatrixXd& velocities);
    /** Positions were set from outside: the next ones do not follow from the former ones. */
    void interrupt() {
        hasBefore = false;
        stiffestSoFar = farthestSoFar = Finding();
    }
    /** The element with the largest finding; -1: none. */
    struct Finding {
        int element = -1;
        double value = 0;
    };
    /** An element whose relaxation takes fewer than two steps, and the steps over this time. */
    const Finding& getStiffest() const { return stiffest; }
    /** An element whose mean displacement is above half the smallest radius, nm. */
    const Finding& getFarthest() const { return farthest; }
    /** The largest of these findings since positions were set: forces may have ended in between. */
    const Finding& getStiffestSoFar() const { return stiffestSoFar; }
    const Finding& getFarthestSoFar() const { return farthestSoFar; }
    /** The element that moves farthest in a step, in smallest radii or radians, if that is tiny. */
    const Finding& getCrawling() const { return crawling; }
    /** Whether some element has moved farther, or may yet. */
    bool hasMoved() const { return motion.element >= 0 && crawling.element < 0; }
    double getSmallestRadius() const { return smallestRadius; }

    static constexpr double largestRelaxation = 0.5;
    /** In smallest radii. */
    static constexpr double largestMeanDisplacement = 0.5, largestLeap = 10, leastMotion = 1e-5;

private:
    /** Sums over a block of steps, of displacements and forces, or of turns and torques. */
    struct Block {
        Eigen::Matrix3d changes = Eigen::Matrix3d::Zero(), squares = Eigen::Matrix3d::Zero(),
                        squaresOfFalls = Eigen::Matrix3d::Zero();
        Eigen::Vector3d displacement = Eigen::Vector3d::Zero();
        void add(const Eigen::Vector3d& displacement, const Eigen::Vector3d& fall);
        double relaxation(int samples, double mobility, double h, double kT, bool isHindered) const;
    };
    /** Sums over samples of an element: h dF (N dF), and dF dx. */
    struct Together {
        double samples = 0, own = 0, fallen = 0, squareOfOwn = 0, squareOfFallen = 0, product = 0;
        void add(double ownOfStep, double fallenOfStep);
        double relaxation() const;
    };
    struct Stiffness {
        Together together;
        Block forces, torques;
        int blocksInARow = 0;
        double least = 0;  // of these blocks
    };
    struct Sums {
        double relaxation = 0, squareOfRelaxation = 0, squareOfDisplacement = 0;
        Eigen::Vector3d displacement = Eigen::Vector3d::Zero();
        int relaxations = 0;  // samples of relaxation
    };
    void restart();
    void compare(double kT, const std::vector<Pose>& poses, const Eigen::MatrixXd& wrenches,
                 const Motion& motion);
    void judge(bool isUniform);
    void remember();
    void noteMotion(const std::vector<Pose>& poses);
    void addToBlock(int element, const std::vector<Pose>& poses, const Eigen::MatrixXd& wrenches);
    void judgeBlock();
    bool isHindered() const;

    const CoupledBodies& bodies;
    BodiesAlone& alone;
    bool hasJoints = false;
    double stepSize = -1, energy = -1;  // h and kT of the steps so far
    double smallestRadius = 0;
    bool hasBefore = false;
    std::vector<Pose> before;
    Eigen::MatrixXd wrenchesBefore;
    bool wantsVelocities = false;
    std::vector<Pose> posesOfFalls;
    Eigen::MatrixXd falls, moves;  // of forces, and of elements; one column
    std::vector<Sums> sums;        // of the elements
    std::vector<Stiffness> stiffness;
    int samplesOfBlock = 0;
    int samples = 0;
    int samplesOfMotion = 0;
    Finding stiffestAlone, stiffest, stiffestSoFar, farthestSoFar, farthest, leap, motion, crawling;
};

}  // namespace RigidHIPlugin

#endif
