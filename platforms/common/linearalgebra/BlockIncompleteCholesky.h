#ifndef RIGIDHI_BLOCK_INCOMPLETE_CHOLESKY_H_
#define RIGIDHI_BLOCK_INCOMPLETE_CHOLESKY_H_

#include <Eigen/Core>
#include <vector>

namespace RigidHIPlugin {

/**
 * The incomplete Cholesky factor without fill, A ~ L L^T, of a symmetric positive definite matrix
 * of 6 x 6 blocks, few of which are not 0.
 *
 * Method:    Rows are eliminated in the reverse order of Cuthill and McKee along the strongest
 *            links. The fill that L leaves out is then small: 256 spheres with gaps of 1e-4 radii
 *            at a volume fraction of 0.45 take 19 iterations to 1e-3, as many as with the whole
 *            factor; 21 to 51 with all links alike, and 54 in the order of the spheres. L has
 *            blocks where the triangle of A has blocks. If a diagonal block loses positive
 *            definiteness, the factorisation starts again with all diagonal blocks of A multiplied
 *            by 1 + shift, and larger shifts until it succeeds.
 * Reference: Cuthill and McKee, Proc. 24th Nat. Conf. ACM, 157 (1969).
 * Cost:      About 400 multiplications for each pair of blocks in a row that contributes to a third
 *            block. Solves take about 40 multiplications for each block and column.
 */
class BlockIncompleteCholesky {
public:
    using Block = Eigen::Matrix<double, 6, 6>;

    /** Begin with a zero matrix of so many rows of blocks. */
    void setZero(int numBlockRows);
    /** Add to block (i, j), i >= j, and implicitly to its transpose. */
    void add(int i, int j, const Block& block);
    /** Say that rows i and j are strongly linked: one is eliminated soon after the other. */
    void link(int i, int j);
    /**
     * Replace the matrix by its factor.
     *
     * @return the relative shift of the diagonal; 0 if none was necessary
     * @throws OpenMMException if no shift helps
     */
    double factorise();
    /**
     * x = L^-1 x and x = L^-T x. The rows of x are in the order of the rows of blocks, before and
     * after.
     */
    void solveL(Eigen::Ref<Eigen::MatrixXd> x) const;
    void solveLTransposed(Eigen::Ref<Eigen::MatrixXd> x) const;
    int getNumBlocks() const;

private:
    struct Entry {
        int column;
        Block block;
    };
    void findOrder();
    /** The lower triangle of the matrix in the order of elimination. */
    std::vector<std::vector<Entry>> inOrder() const;
    bool tryToFactorise(double shift);

    // Lower triangles by rows, columns ascending; the factor in the order of elimination.
    std::vector<std::vector<Entry>> matrix, factor;
    std::vector<Block> diagonal, factorOfDiagonal;
    std::vector<std::vector<int>> links;
    std::vector<int> order;  // the row of blocks that is eliminated k-th
};

}  // namespace RigidHIPlugin

#endif
