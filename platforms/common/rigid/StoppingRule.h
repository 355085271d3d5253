#ifndef RIGIDHI_STOPPING_RULE_H_
#define RIGIDHI_STOPPING_RULE_H_

#include <vector>

namespace RigidHIPlugin {

/** The course of conjugate gradients for one vector, which shows the spectrum of the matrix. */
class ConjugateSteps {
public:
    /**
     * @param length  of the step, in units of the direction
     * @param ratio   of the gradient to the one before it; 0 for the first step
     */
    void add(double length, double ratio);
    /**
     * An estimate of the smallest eigenvalue of the preconditioned matrix: the smallest Ritz value
     * (Golub, Van Loan, Matrix Computations, section 11.3), at most 1. Before the first step: 1.
     */
    double smallestEigenvalue() const;

private:
    std::vector<double> lengths, ratios;
};

/**
 * The stopping rule of MultiblobSolver: whether the energy norm of the error of lambda is below the
 * tolerance times the norm that it is relative to.
 *
 * The energy of the error is at most that of the residual with M~^-1, the bodies' own matrices,
 * over the smallest eigenvalue of M~^-1 M.
 *
 * @param residual  the energy of the residual, r^T M~^-1 r
 * @param scale     the energy that the error is relative to
 */
bool errorIsWithin(double tolerance, double residual, double scale, const ConjugateSteps& steps);

/**
 * The scale of the error of lambda where blobs have slips: the energy of forces and slips together.
 * But the slips of many blobs have far more energy than the part of them that moves the body. The
 * scale is therefore never more than the larger of two parts: the energy of the twists, and the
 * energy that random slips give to twists.
 *
 * @param ofAll     the energy of forces and slips
 * @param ofTwists  U^T N~^-1 U, with the bodies' own frictions
 * @param ofSlips   s^T M~^-1 s
 */
double scaleWithSlips(double ofAll, double ofTwists, double ofSlips, int numBodyRows,
                      int numBlobRows);

}  // namespace RigidHIPlugin

#endif
