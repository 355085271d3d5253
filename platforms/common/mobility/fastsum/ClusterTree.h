#ifndef RIGIDHI_CLUSTER_TREE_H_
#define RIGIDHI_CLUSTER_TREE_H_

#include <openmm/Vec3.h>

#include <Eigen/Core>
#include <array>
#include <vector>

namespace RigidHIPlugin {

/**
 * An octree of cubes with particles, and the pairs of cubes that are far from each other.
 *
 * Method:    A cube with more than `leafSize` particles is divided into eight. The radius of a cube
 *            is that of a ball about its centre that contains the centres of its particles. A pair
 *            of cubes is far if the sum of their radii is at most `opening` times their distance
 *            and no two of their particles can touch. The tree splits all other pairs, down to
 *            pairs of leaves, which are near. So every pair of particles is in exactly one pair of
 *            cubes.
 * Wall:      z counts from the wall. A cube on the wall with all particles in its lower half has
 *            its centre on the wall. The multipoles of its particles and of their images then share
 *            this centre, so whatever cancels far away cancels to the last digit. Every other cube
 *            has a mirror image, which is farther from each target than the cube.
 * Classes:   Far pairs are grouped by the relative position of their cubes, up to reflections. The
 *            pairs of a class share a matrix (FarClass).
 * Cost:      n log n. The tree keeps its memory for the next call.
 *
 * The result depends on positions, radii and the order of particles alone.
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
        double largest;  // the largest radius of its particles
        bool isLeaf() const { return numChildren == 0; }
    };
    /** A class of far pairs: the position of targets relative to their sources. */
    struct FarClass {
        // The level of the target minus that of the source; the level of the source for images off
        // the lattice, else -1; the three offsets in halves of the finer edge, not negative.
        // Classes with the same key share a matrix.
        std::array<int, 5> key;
        int mirrored;       // axes (bits 0, 1, 2) along which the target lies below the source
        Eigen::Vector3d D;  // from source to target, in halves of the source's edge
        int first, end;     // far pairs
        void lie(const Cell& to, const Cell& from, bool image, double bottom);
    };
    /** A source is a cell, or, at or above the number of cells, the mirror image of a cell. */
    struct FarPair {
        int target, source;
    };

    /**
     * @param positions  with a wall, z counts from it and must not be negative
     * @param kinds      sorts the particles of a leaf, larger kinds first; particles of one kind
     *     keep the order of their indices
     */
    void build(const std::vector<OpenMM::Vec3>& positions, const std::vector<double>& radii,
               const std::vector<char>& kinds, bool hasWall, const Options& options);

    std::vector<Cell> cells;        // level by level
    std::vector<int> firstOfLevel;  // the last element is the number of cells
    std::vector<int> order;         // particles, leaf by leaf
    std::vector<int> leaves;        // cells
    std::vector<int> firstNear,
        near;  // for each leaf (as numbered in `leaves`), the cells near it, including itself
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
