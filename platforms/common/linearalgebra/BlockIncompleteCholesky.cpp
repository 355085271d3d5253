#include "linearalgebra/BlockIncompleteCholesky.h"

#include <openmm/OpenMMException.h>

#include <algorithm>
#include <numeric>

#include "linearalgebra/Decompositions.h"

using namespace std;
using Eigen::Lower;
using Eigen::MatrixXd;

namespace RigidHIPlugin {

void BlockIncompleteCholesky::setZero(int numBlockRows) {
    matrix.assign(numBlockRows, {});
    diagonal.assign(numBlockRows, Block::Zero());
    links.assign(numBlockRows, {});
}

void BlockIncompleteCholesky::link(int i, int j) {
    links[i].push_back(j);
    links[j].push_back(i);
}

void BlockIncompleteCholesky::add(int i, int j, const Block& block) {
    if (i == j) {
        diagonal[i] += block;
        return;
    }
    vector<Entry>& row = matrix[i];
    const auto at = lower_bound(row.begin(), row.end(), j, [](const Entry& entry, int column) {
        return entry.column < column;
    });
    if (at != row.end() && at->column == j)
        at->block += block;
    else
        row.insert(at, {j, block});
}

/** Every linked part begins at a row with the fewest links. */
void BlockIncompleteCholesky::findOrder() {
    const int rows = matrix.size();
    const auto hasFewer = [&](int i, int j) { return links[i].size() < links[j].size(); };
    vector<int> starts(rows);
    iota(starts.begin(), starts.end(), 0);
    stable_sort(starts.begin(), starts.end(), hasFewer);
    vector<char> isIn(rows, false);
    order.clear();
    for (const int start : starts) {
        if (isIn[start]) continue;
        isIn[start] = true;
        order.push_back(start);
        for (size_t k = order.size() - 1; k < order.size(); k++) {
            vector<int>& next = links[order[k]];
            sort(next.begin(), next.end());
            stable_sort(next.begin(), next.end(), hasFewer);
            for (const int i : next)
                if (!isIn[i]) {
                    isIn[i] = true;
                    order.push_back(i);
                }
        }
    }
    reverse(order.begin(), order.end());
}

vector<vector<BlockIncompleteCholesky::Entry>> BlockIncompleteCholesky::inOrder() const {
    vector<int> place(order.size());
    for (size_t k = 0; k < order.size(); k++) place[order[k]] = k;
    vector<vector<Entry>> rows(order.size());
    for (size_t i = 0; i < matrix.size(); i++)
        for (const Entry& entry : matrix[i]) {
            const int a = place[i], b = place[entry.column];
            if (a > b)
                rows[a].push_back({b, entry.block});
            else
                rows[b].push_back({a, entry.block.transpose()});
        }
    for (vector<Entry>& row : rows)
        sort(row.begin(), row.end(),
             [](const Entry& a, const Entry& b) { return a.column < b.column; });
    return rows;
}

double BlockIncompleteCholesky::factorise() {
    const double firstShift = 1e-3, lastShift = 10;
    findOrder();
    if (tryToFactorise(0)) return 0;
    for (double shift = firstShift; shift < lastShift; shift *= 2)
        if (tryToFactorise(shift)) return shift;
    throw OpenMM::OpenMMException(
        "BlockIncompleteCholesky: a matrix has blocks on its diagonal that are not positive "
        "definite; look for positions that are not finite");
}

bool BlockIncompleteCholesky::tryToFactorise(double shift) {
    factor = inOrder();
    factorOfDiagonal.clear();
    for (const int row : order) factorOfDiagonal.push_back((1 + shift) * diagonal[row]);
    Eigen::LLT<Block> root;
    for (size_t i = 0; i < factor.size(); i++) {
        Block& own = factorOfDiagonal[i];
        for (size_t e = 0; e < factor[i].size(); e++) {
            Entry& entry = factor[i][e];
            // Columns present both in this row and in the row of the entry's column.
            const vector<Entry>& other = factor[entry.column];
            size_t a = 0, b = 0;
            while (a < e && b < other.size())
                if (factor[i][a].column < other[b].column)
                    a++;
                else if (factor[i][a].column > other[b].column)
                    b++;
                else {
                    entry.block.noalias() -= factor[i][a].block * other[b].block.transpose();
                    a++, b++;
                }
            factorOfDiagonal[entry.column]
                .triangularView<Lower>()
                .transpose()
                .solveInPlace<Eigen::OnTheRight>(entry.block);
            own.noalias() -= entry.block * entry.block.transpose();
        }
        root.compute(own);
        if (root.info() != Eigen::Success) return false;
        own = root.matrixL();
    }
    return true;
}

void BlockIncompleteCholesky::solveL(Eigen::Ref<MatrixXd> x) const {
    for (size_t i = 0; i < factor.size(); i++) {
        auto own = x.middleRows<6>(6 * order[i]);
        for (const Entry& entry : factor[i])
            own.noalias() -= entry.block * x.middleRows<6>(6 * order[entry.column]);
        factorOfDiagonal[i].triangularView<Lower>().solveInPlace(own);
    }
}

void BlockIncompleteCholesky::solveLTransposed(Eigen::Ref<MatrixXd> x) const {
    for (size_t i = factor.size(); i-- > 0;) {
        auto own = x.middleRows<6>(6 * order[i]);
        factorOfDiagonal[i].triangularView<Lower>().transpose().solveInPlace(own);
        for (const Entry& entry : factor[i])
            x.middleRows<6>(6 * order[entry.column]).noalias() -= entry.block.transpose() * own;
    }
}

int BlockIncompleteCholesky::getNumBlocks() const {
    int sum = diagonal.size();
    for (const vector<Entry>& row : matrix) sum += row.size();
    return sum;
}

}  // namespace RigidHIPlugin
