#ifndef RIGIDHI_FAST_SUM_H_
#define RIGIDHI_FAST_SUM_H_

#include <Eigen/Core>
#include <functional>
#include <map>
#include <memory>
#include <vector>

#include "mobility/MobilityModel.h"
#include "mobility/fastsum/ClusterTree.h"
#include "mobility/fastsum/SolidHarmonics.h"

namespace RigidHIPlugin {

/**
 * Products with the Rotne-Prager-Yamakawa mobility of many particles, unbounded or above a no-slip
 * wall, by multipoles. Their time grows little faster than the number of particles.
 *
 * Equation:  Far from spheres with forces F_j, torques T_j and radii b_j at y_j, the flow is
 *                u = f - x_k grad f_k + grad g,
 *                8 pi eta V_i = (1 + a_i^2/6 lap) u = u - (a_i^2/3) grad div f,
 *                8 pi eta W_i = curl f
 *            with four harmonic functions, f_k and g. Their sources are charges and dipoles at y_j,
 *            with the derivative D by y_j of p = 1/|x - y_j|:
 *                f = (F_j + T_j x D/2) p,
 *                g = (y_j.F_j + (b_j^2/3) F_j.D + (y_j x T_j).D/2) p.
 *            A wall at z = 0 adds the same form, with p of the mirror image of y_j, e = e_z and
 *                E = (2 z_j F_j.D + (2 b_j^2/3) D_z F_j.D + (T_j x e).D) p,
 *                f -> -f + e E,   g -> -g.
 *            For spheres that do not overlap, these equations are exactly those of
 *            RotnePragerYamakawa-inl.h and RotnePragerYamakawaWall-inl.h.
 * Method:    A fast multipole method, with four harmonic functions instead of tensors. Moments and
 *            local expansions are SolidHarmonics about the centres of the cubes of a ClusterTree,
 *            and x and y_j count from these centres. Pairs of particles in near cubes are summed
 *            directly.
 * Error:     At most the error passed to choose(), relative to the norm of M, scaled as for grids
 *            (docs/theory/mobility_of_particles.md). The errors were measured in many kinds of
 *            scenes; see the table in FastSum.cpp. M is symmetric only to within this error.
 * Cost:      See benchmarks/README.md. Memory: about (P + 1)^2 (8 bytes x 30) for each cube, and a
 *            matrix of up to (P + 1)^4 numbers for each class.
 * Units:     The unit of length is a power of two near the radii, so that results do not depend on
 *            the size of the particles.
 * Order:     The tree alone determines the order of additions in each cube. So results do not
 *            depend on threads. In double precision, from AVX2 on, they do not depend on the width
 *            of packs either.
 * Reference: Tornberg, Greengard, J. Comput. Phys. 227, 1613 (2008); Gimbutas, Greengard,
 *            Veerapaneni, J. Fluid Mech. 776, R1 (2015); Liang, Gimbutas, Greengard, Huang, Jiang,
 *            J. Comput. Phys. 234, 133 (2013): RPY from four harmonic sums.
 */
class FastSum {
public:
    /** Calls task(first, end) for ranges that cover 0 ... count - 1, perhaps on several threads. */
    using ForRanges = std::function<void(int count, const std::function<void(int, int)>& task)>;
    struct Accuracy {
        int order;       // P
        double opening;  // of ClusterTree
        int leafSize;    // likewise, for blobs without a wall
        int floats;      // in single precision: 0 nothing, 1 near pairs, 2 far pairs, too
    };
    /**
     * The parameters for this error of products (MobilityAt::multiply()) with so many particles;
     * null if the sum over all pairs takes less time.
     */
    static const Accuracy* choose(double error, int numParticles, bool hasWall);

    FastSum(const HydrodynamicParticles& particles, bool hasWall, const Accuracy& accuracy,
            const ForRanges& forRanges);
    ~FastSum();
    /**
     * @param positions  of particles. With a wall, z counts from it and is at least the radius,
     *     because the formulas hold only there
     * @param weights  factors that multiply forces and velocities
     */
    void moveTo(const std::vector<OpenMM::Vec3>& positions, const std::vector<double>& weights);
    /**
     * Move particles a little and keep the cubes of the last moveTo(). For `floats` of 0, products
     * are then a smooth function of the positions, so that differences of products have about the
     * same relative error as products.
     */
    void displaceTo(const std::vector<OpenMM::Vec3>& positions, const std::vector<double>& weights);
    /** velocities = M forces; @param scale 1/(8 pi eta) */
    void apply(const Eigen::MatrixXd& forces, double scale, Eigen::MatrixXd& velocities);
    const ClusterTree& getTree() const { return tree; }
    /** Bytes of allocated memory. */
    size_t getMemory() const;

private:
    template <class Number>
    struct Far;
    template <class Number>
    Far<Number>& far();
    template <class Number>
    void prepareFar();
    template <class Number>
    void multiply(const Eigen::MatrixXd& forces, int column, int columns, double scale,
                  Eigen::MatrixXd& velocities);
    template <class Number>
    void sumFar(int columns);
    void gatherMoments(int cell, int columns);
    void shareLocal(int cell, int columns);
    const Eigen::MatrixXd& shiftOf(const ClusterTree::Cell& child);
    void inParts(const std::vector<double>& costs, const std::function<void(int, int)>& task) const;

    const HydrodynamicParticles& particles;
    const bool hasWall;
    /**
     * The unit of length of all members below, near the radii. If radii are far from a nanometre,
     * fifth powers of distances would otherwise leave the range of floats.
     */
    const double length;
    const Accuracy accuracy;
    const int leafSize;
    const ForRanges forRanges;
    const SolidHarmonics harmonics;
    ClusterTree tree;
    std::map<std::array<int, 3>, Eigen::MatrixXd>
        shifts;  // by the offset of a child from its parent, in halves of the child's edge
    std::vector<const Eigen::MatrixXd*> shiftOfCell;
    // In the order of the tree.
    std::vector<double> x, y, z, radius, weight;
    std::vector<int> row, numSpheres;    // numSpheres: for each cell; 0 unless a leaf
    std::vector<double> loads, results;  // six numbers for each column of each particle
    std::vector<double> up, down;        // moments and local expansions of cells
    std::vector<double> costsOfLeaves, costsOfFar;
    std::unique_ptr<Far<float>> singleFar;
    std::unique_ptr<Far<double>> doubleFar;
};

}  // namespace RigidHIPlugin

#endif
