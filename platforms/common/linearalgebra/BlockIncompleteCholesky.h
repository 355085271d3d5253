#ifndef RIGIDHI_BLOCK_INCOMPLETE_CHOLESKY_H_
#define RIGIDHI_BLOCK_INCOMPLETE_CHOLESKY_H_

#include <Eigen/Core>
#include <vector>

namespace RigidHIPlugin {

/**
 * The incomplete Cholesky factor without fill, A ~ L L^T, of a symmetric positive definite matrix
 * of 6 x 6 blocks, few of which are not 0.
 *
 * Method:    L has blocks where the lower triangle of A has blocks. If a diagonal block loses
 *            positive definiteness, the factorisation starts again with all diagonal blocks of A
 *            multiplied by 1 + shift, and larger shifts until it succeeds.
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
    /**
     * Replace the matrix by its factor.
     *
     * @return the relative shift of the diagonal; 0 if none was necessary
     * @throws OpenMMException if no shift helps
     */
    double factorise();
    /** x = L^-1 x and x = L^-T x. The rows of x are in the order of the rows of blocks. */
    void solveL(Eigen::Ref<Eigen::MatrixXd> x) const;
    void solveLTransposed(Eigen::Ref<Eigen::MatrixXd> x) const;
    int getNumBlocks() const;

private:
    struct Entry {
        int column;
        Block block;
    };
    bool tryToFactorise(double shift);

    std::vector<std::vector<Entry>> matrix, factor;  // lower triangle by rows, columns ascending
    std::vector<Block> diagonal, factorOfDiagonal;
};

}  // namespace RigidHIPlugin

#endif
