#ifndef RIGIDHI_CLUSTER_TREE_H_
#define RIGIDHI_CLUSTER_TREE_H_

#include <openmm/Vec3.h>

#include <Eigen/Core>
#include <array>
#include <vector>

namespace RigidHIPlugin {

/**
 * Particles in the cubes of an octree, and which pairs of cubes are far from each other.
 *
 * Method:    a cube with more than `leafSize` particles is divided in eight. Pairs of cubes are far
 * where the sum of their radii (of balls about their centres that hold the particles' centres) is
 * at most `opening` of their distance and no two particles can touch; other pairs are divided, down
 * to pairs of leaves, which are near. So every pair of particles is in one pair of cubes. At a
 * wall: z counts from it. A cube on the wall that has its particles in its lower half has its
 * centre on the wall: there the multipoles of particles and of their images are one, and what
 * cancels of them far away cancels to the last digit. Other cubes have a mirror image, which is
 * farther from each target than they are. Far pairs are sorted by how the cubes lie to each other,
 * but for reflections: those of one class share a matrix (FarClass). Everything follows from
 * positions, radii and the order of particles alone. Cost:      n log n; no memory is given back.
 */
class ClusterTree {
public:
    struct Options {
        int leafSize;
        double opening;
    };
    struct Cell {
        int parent, firstChild, numChildren;  // -1, 0: a leaf
        int first, end;                       // its particles, in the order of the tree
        int level;
        std::array<int, 3> index;  // of the cube in its level
        bool onWall;               // its centre is
        Eigen::Vector3d centre = Eigen::Vector3d::Zero();
        double half;     // half of the edge
        double reach;    // of its particles' centres from the centre
        double largest;  // radius of a particle
        bool isLeaf() const { return numChildren == 0; }
    };
    /** How targets lie to sources: a class of far pairs. */
    struct FarClass {
        // Level of the target less that of the source; level of the source where it matters, else
        // -1; offsets in halves of the edge of the finer of both, not negative. Classes with one
        // key share a matrix.
        std::array<int, 5> key;
        int mirrored;       // along which axes (bits 0, 1, 2) the target lies below the source
        Eigen::Vector3d D;  // from source to target, in halves of the source's edge
        int first, end;     // far pairs
        void lie(const Cell& to, const Cell& from, bool image, double bottom);
    };
    /** Sources are cells, or, from the number of cells on, their mirror images. */
    struct FarPair {
        int target, source;
    };

    /**
     * @param positions  z from the wall, if there is one, and not negative then
     * @param kinds      particles of a leaf are sorted by it, ties by their index
     */
    void build(const std::vector<OpenMM::Vec3>& positions, const std::vector<double>& radii,
               const std::vector<char>& kinds, bool hasWall, const Options& options);

    std::vector<Cell> cells;        // level by level
    std::vector<int> firstOfLevel;  // and the number of cells
    std::vector<int> order;         // particles, leaf by leaf
    std::vector<int> leaves;        // cells
    std::vector<int> firstNear,
        near;  // of each leaf (as numbered in `leaves`) the cells near it, itself too
    std::vector<FarClass> classes;
    std::vector<FarPair> farPairs;  // class by class, in each by targets, then by sources

private:
    void divide(const std::vector<double>& radii, bool hasWall, const Options& options);
    void pairUp(int a, int b, const Options& options);
    bool areFar(const Cell& a, const Cell& b, double opening) const;
    void classify(bool hasWall);

    std::vector<std::pair<uint64_t, int>> keys;
    std::vector<std::pair<int, int>> nearPairs, farCells;  // of cells, once each
    std::vector<int> leafOfCell;
    OpenMM::Vec3 corner;
    double edge;
    std::vector<OpenMM::Vec3> places;  // in the order of the tree
};

}  // namespace RigidHIPlugin

#endif
