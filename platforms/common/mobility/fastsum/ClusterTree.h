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
 * Method:    A cube with more than `leafSize` particles is divided in eight. The radius of a cube
 *            is that of a ball about its centre that holds the centres of its particles. A pair of
 *            cubes is far where the sum of their radii is at most `opening` times their distance
 *            and no two of their particles can touch. Other pairs are divided, down to pairs of
 *            leaves, which are near. So every pair of particles is in one pair of cubes.
 * Wall:      z counts from the wall. A cube on the wall that has its particles in its lower half
 *            has its centre on the wall. The multipoles of its particles and of their images then
 *            have one centre, and what cancels of them far away cancels to the last digit. Other
 *            cubes have a mirror image, which is farther from each target than they are.
 * Classes:   Far pairs are sorted by the relative position of their cubes, up to reflections. The
 *            pairs of one class share a matrix (FarClass).
 * Cost:      n log n; no memory is given back.
 *
 * The result follows from positions, radii and the order of particles alone.
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
        bool onWall;               // whether its centre is on the wall
        Eigen::Vector3d centre = Eigen::Vector3d::Zero();
        double half;     // half of the edge
        double reach;    // the largest distance of its particles' centres from its centre
        double largest;  // radius of a particle, the largest
        bool isLeaf() const { return numChildren == 0; }
    };
    /** A class of far pairs: the position of targets relative to their sources. */
    struct FarClass {
        // The level of the target less that of the source; the level of the source where it
        // matters, else -1; the offsets in halves of the edge of the finer of both, not negative.
        // Classes with one key share a matrix.
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
    std::vector<int> firstOfLevel;  // and, as the last element, the number of cells
    std::vector<int> order;         // particles, leaf by leaf
    std::vector<int> leaves;        // cells
    std::vector<int> firstNear,
        near;  // for each leaf (as numbered in `leaves`), the cells near it, itself included
    std::vector<FarClass> classes;
    std::vector<FarPair> farPairs;  // class by class; in each class by targets, then by sources

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
