#ifndef RIGIDHI_LUBRICATION_H_
#define RIGIDHI_LUBRICATION_H_

#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "linearalgebra/BlockIncompleteCholesky.h"
#include "mobility/MobilityModel.h"
#include "mobility/models/confined/ForceCouplingAtWall.h"
#include "mobility/models/lubricated/AxisymmetricBlock.h"
#include "mobility/models/lubricated/LubricationReach.h"
#include "mobility/models/periodic/LatticeSum.h"
#include "mobility/models/stokesian/TwoSphereResistance.h"
#include "random/CounterNoise.h"

namespace RigidHIPlugin {

/** Everything besides its particles that determines the lubrication of a model. */
struct LubricationScene {
    LubricationReach reach;
    /**
     * In mean radii of a pair; smaller gaps, and overlaps, count as this gap. 0 for no minimum gap.
     */
    double minimumGap = 0;
    /** The number of box vectors that are periods: 0, 2 (the first two) or 3. */
    int numPeriods = 0;
    /** z of the no-slip walls, nm; infinite without a wall. */
    double low = -std::numeric_limits<double>::infinity(),
           high = std::numeric_limits<double>::infinity();
    /** How far behind them ForceCoupling has another plane at rest, nm. */
    double behind = 0;
    /** A plane along which the fluid slips is across this axis, at `mirror`; -1: none. */
    int mirrorAxis = -1;
    double mirror = 0;
    /** With another such plane: the period of images, which is twice their distance. */
    double mirrorPeriod = 0;

    bool hasWalls() const { return std::isfinite(low) || std::isfinite(high); }
    bool hasMirror() const { return mirrorAxis >= 0; }
    /** The periods of images; that of mirrors takes the place of the box's own. */
    BoxVectors periods(const BoxVectors& box) const {
        BoxVectors result = box;
        if (mirrorPeriod > 0) {
            result[mirrorAxis] = OpenMM::Vec3();
            result[mirrorAxis][mirrorAxis] = mirrorPeriod;
        }
        return result;
    }
};

/**
 * The friction of spheres close to each other or to a wall that a mobility without lubrication
 * lacks.
 *
 * Equation:  Delta = sum over pairs w(r) (R_exact - M_pair^-1) + sum over spheres and walls
 *            (R_exact - M_wall^-1). R_exact is the friction of two rigid spheres alone in unbounded
 *            fluid, or of one above a wall. M_pair and M_wall are the mobilities of the same
 *            spheres in the model. The sum of Delta and the model's friction is therefore exact for
 *            two spheres, and for one above a wall. Delta includes forces and torques, but no
 *            strains. With a reach of 0 this class only detects overlaps.
 * Mirrors:   A plane along which the fluid slips, a wall of SlipChannel or the surface of a Film,
 *            makes a mirror image of each sphere. Spheres have the terms of pairs with their own
 *            images and with those of others, w P^T (R_exact - M_pair^-1) P, where P gives an image
 *            the mirrored velocity. The term of a sphere and its own image counts half, since the
 *            other half is the friction of the image.
 * Accuracy:  1e-10 of the friction for pairs, 3e-8 for walls. Except for these errors each term is
 *            positive semidefinite. Negative eigenvalues are set to 0, so that square roots exist.
 * Limits:    Only particles with torque (spheres) have lubrication. Ratios of radii up to 10.
 *            Surfaces must not touch each other without a minimum gap, and must never touch a wall.
 */
class Lubrication {
public:
    using Pair = AxisymmetricBlock<2>;
    using Single = AxisymmetricBlock<1>;

    /**
     * @param spreading  the pair mobility of the model in unbounded fluid
     * @param name       the name of the model in messages
     * @throws OpenMMException  if the ratio of radii is too large
     */
    Lubrication(const HydrodynamicParticles& particles, double viscosity,
                const Spreading& spreading, const LubricationScene& scene, const char* name)
        : Lubrication(particles, viscosity, &spreading, scene, name) {}
    /** Likewise for the model of forces, torques and stresslets (FTS). */
    Lubrication(const HydrodynamicParticles& particles, double viscosity,
                const LubricationScene& scene, const char* name)
        : Lubrication(particles, viscosity, nullptr, scene, name) {}
    const LubricationScene& getScene() const { return scene; }
    const HydrodynamicParticles& getParticles() const { return particles; }
    /** Whether any sphere can have lubrication. */
    static bool isAny(const HydrodynamicParticles& particles, const LubricationScene& scene);

    /**
     * A text for describeEffects(): which spheres have lubrication, with what, and up to what
     * distance.
     */
    std::string describe() const;
    /**
     * The reason why the spheres have no lubrication at a placement, with their names; empty if
     * they have it.
     */
    std::string objection(const Placement& placement) const;

    /** Sphere i and sphere j, or an image of j, with the axis from i to j. i <= j. */
    struct NearPair {
        int i, j;
        std::array<int, 3> image;  // in vectors of the box
        Eigen::Vector3d axis;
        double distance;
        bool mirrored = false;  // whether the second is a mirror image
    };
    /** The first pair that touches or overlaps; with a minimum gap, the first pair at one place. */
    bool findOverlap(const Placement& placement, NearPair& found) const;
    /** All pairs within the reach of lubrication, in a fixed order. */
    void findPairs(const Placement& placement, std::vector<NearPair>& pairs) const;
    /** A pair's term of Delta and its square root, Delta = root root^T. */
    void ofPair(const NearPair& pair, Pair& delta, Pair& root) const;
    /** The pairs of a placement, with the terms of Delta and their square roots. */
    struct Terms {
        std::vector<NearPair> pairs;
        std::vector<Pair> deltas, roots;
    };
    void findTerms(const Placement& placement, Terms& terms) const;
    /** forces += terms of Delta times velocities */
    void addProduct(const Terms& terms, const Eigen::MatrixXd& velocities,
                    Eigen::MatrixXd& forces) const;
    /**
     * forces += roots of the terms times random numbers. The indices of the particles in the System
     * and the image determine the numbers.
     *
     * @return the number of random numbers
     */
    long long addNoise(const Terms& terms, const NoiseStream& noise, uint32_t purpose,
                       Eigen::MatrixXd& forces) const;
    /**
     * The field of a stream to which the random numbers of a pair belong, and the pair's index
     * there.
     */
    void keyOfPair(const NearPair& pair, uint32_t& field, uint32_t& index) const;
    /**
     * Add the terms of pairs nearer than so many mean radii to a preconditioner.
     *
     * @param blockOf     the row of blocks of each particle
     * @param projectors  the matrix gets the terms between these, one for each row; empty: 1
     */
    void addNearer(double meanRadii, const Terms& terms, const std::vector<int>& blockOf,
                   const std::vector<BlockIncompleteCholesky::Block>& projectors,
                   BlockIncompleteCholesky& matrix) const;
    /** Add all terms to a friction matrix. */
    void addTo(const Terms& terms, Eigen::MatrixXd& friction) const;
    /**
     * A sphere's term of Delta at the walls, the root of this term, and the sphere's own friction
     * in the model, all with the axis z.
     */
    void ofSphere(int i, double z, Single& delta, Single& root, Single& own) const;

private:
    double meanRadius(int i, int j) const {
        return 0.5 * (particles.radii[i] + particles.radii[j]);
    }
    Lubrication(const HydrodynamicParticles& particles, double viscosity,
                const Spreading* spreading, const LubricationScene& scene, const char* name);
    /** The friction of a pair from scaled functions in the order of the tables. */
    template <class Values>
    Pair frictionOf(const Values& f, int i, int j) const;
    const TwoSphereResistance& tableOf(int i, int j) const;
    double gapOf(int i, int j, double distance) const;
    Pair pairOfModel(int i, int j, double distance) const;
    template <class Use>
    void forPairsWithin(const Placement& placement, double meanRadii, const Use& use) const;
    /** The signs that a mirror gives the velocities of a sphere, or the force and torque. */
    Eigen::Matrix<double, 6, 1> signsOfMirror() const;
    /** A pair's matrix for the velocities of both spheres, not of a mirror image. */
    Pair::Whole wholeOf(const NearPair& pair, const Pair& block) const;
    std::string touching(const Placement& placement, int i, const std::string& what) const;

    const HydrodynamicParticles& particles;
    const double viscosity;
    const Spreading* const spreading;  // null: FTS
    const LubricationScene scene;
    const char* const name;
    std::vector<int> spheres;  // the particles with torque
    std::vector<int> kind;     // the index of each particle's radius among the radii of spheres
    double largestRadius = 0;
    std::vector<std::vector<std::shared_ptr<const TwoSphereResistance>>>
        tables;                               // [kind of the larger][kind of the smaller]
    std::vector<ForceCouplingAtWall> atWall;  // of each kind, where the model is ForceCoupling
};

}  // namespace RigidHIPlugin

#endif
