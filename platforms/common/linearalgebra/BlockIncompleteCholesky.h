#ifndef RIGIDHI_BLOCK_INCOMPLETE_CHOLESKY_H_
#define RIGIDHI_BLOCK_INCOMPLETE_CHOLESKY_H_

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <vector>

namespace RigidHIPlugin {

/**
 * The incomplete Cholesky factor without fill, A ~ L L^T, of a symmetric positive definite matrix
 * of 6 x 6 blocks, few of which are not 0.
 *
 * Method:    L has blocks where the lower triangle of A has blocks. Where a block of the diagonal
 *            is not positive definite any more, all of them are multiplied by 1 + shift and the
 *            factor is made again, with larger and larger shifts.
 * Cost:      The number of pairs of blocks in one row that meet in a third one, times 400
 *            multiplications; solves take the number of blocks times 40.
 */
class BlockIncompleteCholesky {
public:
    using Block = Eigen::Matrix<double, 6, 6>;

    /** Begin with a matrix of so many rows of blocks, which is 0. */
    void setZero(int numBlockRows);
    /** Add to a block, i >= j, and thereby to its transpose. */
    void add(int i, int j, const Block& block);
    /**
     * Replace the matrix by its factor.
     *
     * @return the shift of the diagonal that was needed, relative; 0: none
     * @throws OpenMMException if no shift helps
     */
    double factorise();
    /** x = L^-1 x and x = L^-T x, of rows of blocks in their order. */
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
