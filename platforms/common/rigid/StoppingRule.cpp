#include "rigid/StoppingRule.h"

#include <cmath>

#include "linearalgebra/Decompositions.h"

using namespace Eigen;
using namespace std;

namespace RigidHIPlugin {

void ConjugateSteps::add(double length, double ratio) {
    lengths.push_back(length);
    ratios.push_back(ratio);
}

double ConjugateSteps::smallestEigenvalue() const {
    const int k = lengths.size();
    if (k == 0) return 1;
    VectorXd diagonal(k), beside(k - 1);
    for (int i = 0; i < k; i++) {
        diagonal[i] = 1 / lengths[i] + (i > 0 ? ratios[i] / lengths[i - 1] : 0);
        if (i > 0) beside[i - 1] = sqrt(ratios[i]) / lengths[i - 1];
    }
    SelfAdjointEigenSolver<MatrixXd> solver;
    solver.computeFromTridiagonal(diagonal, beside, EigenvaluesOnly);
    return solver.info() == Success ? min(1.0, solver.eigenvalues()[0]) : 0;
}

bool errorIsWithin(double tolerance, double residual, double scale, const ConjugateSteps& steps) {
    const double allowed = tolerance * tolerance * scale;
    // The eigenvalue makes a difference only when the residual is small enough. A residual that is
    // not a number is never small.
    return residual <= allowed && residual <= allowed * steps.smallestEigenvalue();
}

double scaleWithSlips(double ofAll, double ofTwists, double ofSlips, int numBodyRows,
                      int numBlobRows) {
    // Random velocities may have an error of five tolerances, three of them from the solve. The
    // bodies' share of the energy of random slips is their share of the rows.
    const double ofRandom = 3;
    const double partOfBodies = ofRandom * ofRandom * numBodyRows / numBlobRows;
    return min(ofAll, max(ofTwists, partOfBodies * ofSlips));
}

}  // namespace RigidHIPlugin
