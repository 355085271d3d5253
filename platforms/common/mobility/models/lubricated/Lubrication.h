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

/** What the lubrication of a model depends on besides its particles. */
struct LubricationScene {
    LubricationReach reach;
    /** In mean radii of a pair: smaller gaps, and overlaps, count as this gap. 0: none. */
    double minimumGap = 0;
    /** How many vectors of the box are periods: 0, 2 (the first two) or 3. */
    int numPeriods = 0;
    /** The no-slip walls across z, nm; infinite where there is none. */
    double low = -std::numeric_limits<double>::infinity(),
           high = std::numeric_limits<double>::infinity();
    /** How far behind them ForceCoupling has another plane at rest, nm. */
    double behind = 0;
    /** A plane along which the fluid slips is across this axis, at `mirror`; -1: there is none. */
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
 * What a mobility without lubrication lacks of the friction of spheres that are close to each other
 * or to a wall.
 *
 * Equation:  Delta = sum over pairs w(r) (R_exact - M_pair^-1) + sum over spheres and walls
 *            (R_exact - M_wall^-1). R_exact is the friction of two rigid spheres alone in unbounded
 *            fluid, or of one above a wall. M_pair and M_wall are the mobilities of the same
 *            spheres in the model, so that the sum with the model's friction is exact for two
 *            spheres, and for one above a wall. Forces and torques take part, strains do not. A
 *            reach of 0 is for overlaps alone.
 * Mirrors:   A plane along which the fluid slips, a wall of SlipChannel or the surface of a Film,
 *            makes a mirror image of each sphere. Spheres have the terms of pairs with their own
 *            images and with those of others, w times P^T (R_exact - M_pair^-1) P, where P gives an
 *            image the mirrored velocity. The terms of a sphere and its own image count half, since
 *            the other half is the friction of the image.
 * Accuracy:  Pairs 1e-10 of the friction, walls 3e-8. Each term is positive semidefinite except
 *            for these errors; negative eigenvalues are set to 0, so that square roots exist.
 * Limits:    Spheres with torque; other particles have none. Ratios of radii up to 10. Surfaces
 *            must not touch, unless there is a minimum gap, and never touch a wall.
 */
class Lubrication {
public:
    using Pair = AxisymmetricBlock<2>;
    using Single = AxisymmetricBlock<1>;

    /**
     * @param spreading  the pair mobility of the model in unbounded fluid
     * @param name       of the model in messages
     * @throws OpenMMException  for radii in too large a ratio
     */
    Lubrication(const HydrodynamicParticles& particles, double viscosity,
                const Spreading& spreading, const LubricationScene& scene, const char* name)
        : Lubrication(particles, viscosity, &spreading, scene, name) {}
    /** Likewise for the model of forces, torques and stresslets, FTS. */
    Lubrication(const HydrodynamicParticles& particles, double viscosity,
                const LubricationScene& scene, const char* name)
        : Lubrication(particles, viscosity, nullptr, scene, name) {}
    const LubricationScene& getScene() const { return scene; }
    const HydrodynamicParticles& getParticles() const { return particles; }
    /** Whether there is any sphere that can have lubrication. */
    static bool isAny(const HydrodynamicParticles& particles, const LubricationScene& scene);

    /** Which spheres have lubrication, with what and how far, for describeEffects(). */
    std::string describe() const;
    /** Why the spheres have no lubrication at a placement, naming them; empty if they have. */
    std::string objection(const Placement& placement) const;

    /** Two spheres, j or an image of it, with the axis from i to j. i <= j. */
    struct NearPair {
        int i, j;
        std::array<int, 3> image;  // in vectors of the box
        Eigen::Vector3d axis;
        double distance;
        bool mirrored = false;  // whether the second is a mirror image
    };
    /** The first pair that touches or overlaps; with a minimum gap, that is at the same place. */
    bool findOverlap(const Placement& placement, NearPair& found) const;
    /** All pairs nearer than where nothing is left of lubrication, in a fixed order. */
    void findPairs(const Placement& placement, std::vector<NearPair>& pairs) const;
    /** A pair's term of Delta, and a square root, Delta = root root^T. */
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
     * forces += roots of the terms times random numbers. The numbers belong to the indices of the
     * particles in the System and to the image.
     *
     * @return how many numbers
     */
    long long addNoise(const Terms& terms, const NoiseStream& noise, uint32_t purpose,
                       Eigen::MatrixXd& forces) const;
    /** Which of a stream's fields the numbers of a pair belong to, and its index there. */
    void keyOfPair(const NearPair& pair, uint32_t& field, uint32_t& index) const;
    /**
     * Add the terms of pairs nearer than so many mean radii to a preconditioner.
     *
     * @param blockOf  of each particle, its row of blocks
     */
    void addNearer(double meanRadii, const Terms& terms, const std::vector<int>& blockOf,
                   BlockIncompleteCholesky& matrix) const;
    /** Add all terms to a friction matrix. */
    void addTo(const Terms& terms, Eigen::MatrixXd& friction) const;
    /**
     * A sphere's term of Delta at the walls, its root, and its friction in the model by itself, all
     * with the axis z.
     */
    void ofSphere(int i, double z, Single& delta, Single& root, Single& own) const;

private:
    double meanRadius(int i, int j) const {
        return 0.5 * (particles.radii[i] + particles.radii[j]);
    }
    Lubrication(const HydrodynamicParticles& particles, double viscosity,
                const Spreading* spreading, const LubricationScene& scene, const char* name);
    /** The friction of scaled functions of a pair in the order of the tables. */
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
    std::vector<int> kind;     // of each particle: index of its radius among those of spheres
    double largestRadius = 0;
    std::vector<std::vector<std::shared_ptr<const TwoSphereResistance>>>
        tables;                               // [kind of the larger][kind of the smaller]
    std::vector<ForceCouplingAtWall> atWall;  // of each kind, where the model is ForceCoupling
};

}  // namespace RigidHIPlugin

#endif
