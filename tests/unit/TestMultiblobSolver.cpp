// The solver of rigid multiblobs keeps its promises at any tolerance, with exact and rough
// products, with first guesses, and with any number of ranges.

#include "CoupledBodiesSupport.h"
#include "HydrodynamicSupport.h"
#include "TestSupport.h"
#include "mobility/models/rotneprager/CpuRotnePragerYamakawa.h"
#include "mobility/models/rotneprager/RotnePragerYamakawa.h"
#include "rigid/MultiblobSolver.h"
#include "rigid/StoppingRule.h"

using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace std;

namespace {

/** Points spread over a sphere. */
vector<Vector3d> shell(int count, double radius) {
    vector<Vector3d> sites;
    for (int i = 0; i < count; i++) {
        const double z = 1 - (2 * i + 1.0) / count, rho = sqrt(1 - z * z),
                     angle = M_PI * (3 - sqrt(5.0)) * i;
        sites.push_back(radius * Vector3d(rho * cos(angle), rho * sin(angle), z));
    }
    return sites;
}

MatrixXd normal(mt19937& random, int rows, int columns) {
    normal_distribution<double> gauss;
    MatrixXd m(rows, columns);
    for (int i = 0; i < m.size(); i++) m.data()[i] = gauss(random);
    return m;
}

/** Shells of blobs and one free particle close to each other and to a wall. */
struct Layer {
    vector<FluidElement> elements;
    vector<Pose> poses;
    unique_ptr<CoupledBodies> bodies;
    /** @param numRanges  0: the model without SIMD, which has no rough products, in unbounded fluid
     */
    Layer(const vector<Vector3d>& sites, double blobRadius, double spacing, int count,
          int numRanges = 1) {
        mt19937 random(7);
        for (int b = 0; b <= count; b++) {
            const bool isFree = b == count;
            FluidElement e;
            e.body = isFree ? -1 : b;
            e.sites = isFree ? vector<Vector3d>{Vector3d::Zero()} : sites;
            e.radii.assign(e.sites.size(), isFree ? 0.3 : blobRadius);
            for (size_t i = 0; i < e.sites.size(); i++) e.particles.push_back(sites.size() * b + i);
            elements.push_back(e);
            Pose pose;
            pose.R = isFree ? Vector3d(0.5 * spacing, 0.5 * spacing, 2.9)
                            : Vector3d(spacing * (b % 2), spacing * (b / 2), 1.15 + 0.05 * (b % 3));
            const QuaternionArray q = randomQuaternion(random);
            pose.q = {q[0], q[1], q[2], q[3]};
            poses.push_back(pose);
        }
        bodies = make_unique<CoupledBodies>(
            elements, [numRanges](const HydrodynamicParticles& particles) {
                unique_ptr<MobilityModel> model;
                const auto ranges = [numRanges](int size, const function<void(int, int)>& task) {
                    for (int t = 0; t < numRanges; t++)
                        task(size * t / numRanges, size * (t + 1) / numRanges);
                };
                if (numRanges == 0)
                    model = make_unique<RotnePragerYamakawa>(particles, 1);
                else
                    model = make_unique<CpuRotnePragerYamakawa>(particles, 1, ranges,
                                                                NoSlipPlane(0, false));
                return model;
            });
    }
    BodyMobility& dense() { return strategies().get(BodyMobility::Dense); }
    BodyMobility& byProducts() { return strategies().get(BodyMobility::Krylov); }
    void setPoses() {
        dense().setPoses(poses);
        byProducts().setPoses(poses);
    }
    /** The error of twists in the norm of the friction, relative to the exact twists. */
    double errorOf(const MatrixXd& twists, const MatrixXd& wrenches, int column) {
        const MatrixXd& N = dense().mobility();
        const VectorXd difference = twists.col(column) - N * wrenches.col(column);
        const double square = difference.dot(N.ldlt().solve(difference));
        return sqrt(square / wrenches.col(column).dot(N * wrenches.col(column)));
    }
    MatrixXd blobMobility() {
        Placement placement;
        vector<Matrix3d> turns;
        setTurns(poses, turns);
        bodies->getMotion().place(poses, turns, placement);
        MatrixXd M;
        bodies->getModel().at(placement)->dense(M);
        return M;
    }

private:
    BodyMobilities& strategies() {
        if (!made) made = make_unique<BodyMobilities>(*bodies, 1e-6);
        return *made;
    }
    unique_ptr<BodyMobilities> made;
};

/** The solver itself at the poses of a layer. */
struct SolverOf {
    vector<Matrix3d> turns;
    Placement placement;
    unique_ptr<MobilityAt> place;
    MultiblobSolver solver;
    explicit SolverOf(Layer& layer)
        : solver(layer.bodies->getMotion(), layer.bodies->getNullTwists(),
                 layer.bodies->getModel()) {
        goTo(layer);
    }
    void goTo(Layer& layer) {
        setTurns(layer.poses, turns);
        layer.bodies->getMotion().place(layer.poses, turns, placement);
        place = layer.bodies->getModel().at(placement);
        solver.setPoses(layer.poses, turns);
    }
};

/** A place whose products are wrong by all of the error that they may have. */
struct CoarsePlace : MobilityAt {
    const MatrixXd M, errors;
    CoarsePlace(const MobilityModel& model, const MatrixXd& M, const MatrixXd& anyMatrix)
        : MobilityAt(model), M(M), errors(M.operatorNorm() / anyMatrix.operatorNorm() * anyMatrix) {
    }
    void multiply(const MatrixXd& forces, MatrixXd& velocities, const Accuracy& accuracy) override {
        velocities = M * forces;
        if (accuracy.error > 0) velocities += accuracy.error * (errors * forces);
    }
    void moveTo(const Placement&, bool) override {}
};

/** Conjugate gradients for A x = b with a diagonal matrix, from x = 0. */
struct KnownDescent {
    const VectorXd A, b;
    VectorXd x, residual, direction;
    double gradient = 0, before = 0;
    ConjugateSteps steps;
    KnownDescent(const VectorXd& A, const VectorXd& b)
        : A(A), b(b), x(VectorXd::Zero(A.size())), residual(-b), direction(b),
          gradient(b.squaredNorm()) {}
    void step() {
        const double ratio = before > 0 ? gradient / before : 0;
        if (before > 0) direction = ratio * direction - residual;
        const VectorXd product = A.cwiseProduct(direction);
        const double length = gradient / direction.dot(product);
        steps.add(length, ratio);
        x += length * direction;
        residual += length * product;
        before = gradient;
        gradient = residual.squaredNorm();
    }
    /** The error in the energy norm, relative to the solution. */
    double relativeError() const {
        const VectorXd exact = b.cwiseQuotient(A), error = x - exact;
        return sqrt(error.dot(A.cwiseProduct(error)) / exact.dot(b));
    }
    double energy() const { return x.dot(A.cwiseProduct(x)); }
};

}  // namespace

TEST(StoppingRule, TheSmallestEigenvalueComesFromTheSteps) {
    mt19937 random(11);
    EXPECT_EQ(ConjugateSteps().smallestEigenvalue(), 1);
    for (double smallest : {1e-3, 0.2}) {
        const int n = 12;
        KnownDescent descent(VectorXd::LinSpaced(n, smallest, 3), normal(random, n, 1));
        double last = 1;
        for (int k = 0; k < n; k++) {
            descent.step();
            // Ritz values lie within the spectrum, and the smallest one falls.
            const double now = descent.steps.smallestEigenvalue();
            EXPECT_LE(now, last * (1 + 1e-12));
            EXPECT_GE(now, smallest * (1 - 1e-9));
            last = now;
        }
        EXPECT_NEAR(last, smallest, 1e-6 * smallest);
    }
    // Where all eigenvalues are larger than 1, the residual alone decides.
    KnownDescent above(VectorXd::LinSpaced(5, 2, 4), normal(random, 5, 1));
    above.step();
    EXPECT_EQ(above.steps.smallestEigenvalue(), 1);
}

TEST(StoppingRule, TheErrorIsBelowTheToleranceAndNotFarBelow) {
    mt19937 random(12);
    for (double smallest : {1e-4, 1e-2, 0.5})
        for (double tolerance : {1e-2, 1e-4, 1e-6}) {
            const int n = 60;
            VectorXd A = VectorXd::LinSpaced(n, 0.5, 2);
            A[0] = smallest;
            KnownDescent descent(A, normal(random, n, 1));
            int k = 0;
            while (!errorIsWithin(tolerance, descent.gradient, descent.energy(), descent.steps)) {
                ASSERT_LT(k++, n);
                descent.step();
            }
            EXPECT_GT(k, 0);
            EXPECT_LE(descent.relativeError(), tolerance) << smallest;
            // The bound is too large by the root of the condition number at most.
            EXPECT_GE(descent.relativeError(), 0.02 * tolerance * sqrt(smallest)) << smallest;
        }
}

TEST(StoppingRule, TheLimitIsTheSquareOfTheTolerance) {
    const ConjugateSteps none;
    EXPECT_TRUE(errorIsWithin(0.1, 0.99e-2, 1, none));
    EXPECT_FALSE(errorIsWithin(0.1, 1.01e-2, 1, none));
    EXPECT_TRUE(errorIsWithin(0.1, 3.99e-2, 4, none));
    // One step of length 4 has seen the eigenvalue 1/4.
    ConjugateSteps one;
    one.add(4, 0);
    EXPECT_TRUE(errorIsWithin(0.1, 0.249e-2, 1, one));
    EXPECT_FALSE(errorIsWithin(0.1, 0.251e-2, 1, one));
    // Without forces there is nothing to do, and what is not a number is never small.
    EXPECT_TRUE(errorIsWithin(0.1, 0, 0, none));
    EXPECT_FALSE(errorIsWithin(0.1, NAN, 1, none));
    EXPECT_FALSE(errorIsWithin(0.1, 0, NAN, none));
}

TEST(StoppingRule, SlipsThatMoveNoBodyDoNotCount) {
    // A third of the rows are those of bodies: of the energy of slips, nine times a third counts.
    EXPECT_DOUBLE_EQ(scaleWithSlips(100, 2, 1, 6, 18), 3);
    EXPECT_DOUBLE_EQ(scaleWithSlips(100, 5, 1, 6, 18), 5);
    EXPECT_DOUBLE_EQ(scaleWithSlips(1, 5, 1, 6, 18), 1);
}

TEST(MultiblobSolver, RoughProductsKeepAnyTolerance) {
    mt19937 random(1);
    Layer layer(shell(20, 0.8), 0.25, 2.2, 5);
    layer.setPoses();
    const MatrixXd wrenches = normal(random, layer.bodies->getNumRows(), 2);
    SolverOf at(layer);
    for (double tolerance : {1e-1, 1e-3, 1e-4, 1e-6, 1e-8, 1e-10}) {
        MatrixXd twists, exactly;
        const int iterations = at.solver.solve(*at.place, wrenches, MatrixXd(), tolerance,
                                               Accuracy::errorOfSinglePrecision, twists);
        const int products = at.solver.getNumProducts(), exact = at.solver.getNumExactProducts();
        const int exactIterations =
            at.solver.solve(*at.place, wrenches, MatrixXd(), tolerance, 0, exactly);
        for (int c = 0; c < 2; c++) {
            EXPECT_LT(layer.errorOf(twists, wrenches, c), 3 * tolerance) << tolerance;
            EXPECT_LT(layer.errorOf(exactly, wrenches, c), 3 * tolerance) << tolerance;
        }
        // There is one exact product for each further four digits, and next to no additional
        // iteration.
        EXPECT_EQ(exact, 2 * (tolerance >= 5e-5 ? 0 : tolerance >= 2e-9 ? 1 : 2)) << tolerance;
        EXPECT_EQ(products, 2 * (iterations + 1) + exact);
        EXPECT_LE(iterations, exactIterations + 1) << tolerance;
        EXPECT_EQ(at.solver.getNumExactProducts(), at.solver.getNumProducts());
        cout << "tolerance " << tolerance << ": " << iterations << " iterations, " << exact / 2
             << " of " << products / 2 << " products exact; with exact ones only "
             << exactIterations << " iterations" << endl;
    }
}

TEST(MultiblobSolver, CoarseProductsKeepTheTolerance) {
    mt19937 random(5);
    Layer layer(shell(20, 0.8), 0.25, 2.2, 5);
    layer.setPoses();
    const MatrixXd wrenches = normal(random, layer.bodies->getNumRows(), 2),
                   M = layer.blobMobility();
    SolverOf at(layer);
    CoarsePlace coarse(layer.bodies->getModel(), M, normal(random, M.rows(), M.rows()));
    for (double tolerance : {1e-2, 1e-3, 1e-4}) {
        const double allowed = at.solver.errorFor(tolerance);
        EXPECT_GT(allowed, 1e-3 * tolerance);
        // What the solver is given is not always what it would ask for.
        for (double factor : {1.0, 30.0, 1e4}) {
            MatrixXd twists, exactly;
            const int iterations =
                at.solver.solve(coarse, wrenches, MatrixXd(), tolerance, factor * allowed, twists);
            const int exact = at.solver.getNumExactProducts();
            const int exactIterations =
                at.solver.solve(coarse, wrenches, MatrixXd(), tolerance, 0, exactly);
            cout << "tolerance " << tolerance << ", products to " << factor * allowed << ": "
                 << iterations << " iterations, " << exact / 2
                 << " exact products; with exact ones " << exactIterations << " iterations; error "
                 << layer.errorOf(twists, wrenches, 0) << endl;
            for (int c = 0; c < 2; c++)
                EXPECT_LT(layer.errorOf(twists, wrenches, c), 3 * tolerance);
            if (factor == 1) {
                EXPECT_EQ(exact, 0);
                EXPECT_LE(iterations, exactIterations + 1);
            }
        }
    }
}

// The random slips of many blobs have far more energy than the part of them that moves the body.
// The error is relative to this part: to the bodies' random velocities, scaled by the roots of
// their own frictions.
TEST(MultiblobSolver, RandomVelocitiesOfManyBlobsAreRightRelativeToThemselves) {
    vector<Vector3d> cube;
    const int side = 6;
    const double radius = 0.1;
    for (int i = 0; i < side * side * side; i++)
        cube.push_back(
            2 * radius *
            (Vector3d(i % side, i / side % side, i / side / side).array() - (side - 1) / 2.0));
    Layer layer(cube, radius, 1.45, 2);
    mt19937 random(6);
    BodyMobility& mobility = layer.byProducts();
    mobility.setPoses(layer.poses);
    const int samples = 4;
    const MatrixXd W = normal(random, layer.bodies->getParticles().numRows, samples),
                   noWrenches = MatrixXd::Zero(layer.bodies->getNumRows(), samples);
    const auto velocities = [&](double tolerance, bool bySlips) {
        MatrixXd thermal, twists;
        mobility.setTolerance(tolerance);
        if (bySlips) {
            mobility.thermalSlip(W, thermal);
            mobility.solve(noWrenches, thermal, twists);
        } else {
            mobility.thermalWrench(W, thermal);
            mobility.solve(thermal, twists);
        }
        return twists;
    };
    // All bodies, but the free particle, have the same friction when they are alone.
    Layer alone(cube, radius, 1.45, 1);
    alone.poses[0].R += Vector3d(0, 0, 1e6);
    alone.poses[1].R += Vector3d(1e6, 0, 2e6);
    alone.dense().setPoses(alone.poses);
    const MatrixXd ofShape = alone.dense().mobility().topLeftCorner<6, 6>().inverse();
    vector<Matrix3d> turns, turnAlone;
    setTurns(layer.poses, turns);
    setTurns(alone.poses, turnAlone);
    const auto energy = [&](const VectorXd& twists) {
        double sum = 0;
        for (int b = 0; b < 2; b++) {
            VectorXd u = twists.segment<6>(6 * b);
            for (int k : {0, 3})
                u.segment<3>(k) = turnAlone[0] * turns[b].transpose() * u.segment<3>(k);
            sum += u.dot(ofShape * u);
        }
        return sum;
    };
    for (bool bySlips : {true, false}) {
        const MatrixXd exact = velocities(1e-9, bySlips);
        for (double tolerance : {3e-2, 1e-2, 1e-3, 1e-4}) {
            const MatrixXd found = velocities(tolerance, bySlips);
            double worst = 0;
            for (int c = 0; c < samples; c++)
                worst =
                    max(worst, sqrt(energy(found.col(c) - exact.col(c)) / energy(exact.col(c))));
            EXPECT_LT(worst, 5 * tolerance) << (bySlips ? "slips" : "wrenches");
            cout << (bySlips ? "slips" : "wrenches") << " to " << tolerance << ": "
                 << worst / tolerance << " tolerances" << endl;
        }
    }
}

// If blobs of two bodies nearly touch or coincide, the smallest eigenvalue of the preconditioned
// matrix is small, and the residual is smaller than the error, most of all for forces that pull the
// bodies apart.
TEST(MultiblobSolver, TouchingAndNearlyCoincidentBodiesKeepTheTolerance) {
    mt19937 random(8);
    const double radius = 0.8;
    for (double distance : {2.004, 0.1, 0.06, 0.04}) {
        Layer layer(shell(42, radius), 0.25 * radius, distance * radius, 2, 0);
        for (Pose& pose : layer.poses) pose.q = {1, 0, 0, 0};
        layer.poses[1].R = layer.poses[0].R + Vector3d(distance * radius, 0, 0);
        layer.setPoses();
        MatrixXd wrenches = MatrixXd::Zero(layer.bodies->getNumRows(), 6);
        wrenches.topRows<6>() = normal(random, 6, 6);
        wrenches.middleRows<6>(6) = -wrenches.topRows<6>();
        SolverOf at(layer);
        for (double tolerance : {3e-2, 1e-2, 1e-3, 1e-5}) {
            MatrixXd twists;
            at.solver.solve(*at.place, wrenches, MatrixXd(), tolerance, 0, twists);
            double worst = 0;
            for (int c = 0; c < wrenches.cols(); c++)
                worst = max(worst, layer.errorOf(twists, wrenches, c));
            EXPECT_LT(worst, tolerance) << distance;
            cout << "distance " << distance << " to " << tolerance << ": " << worst / tolerance
                 << " tolerances" << endl;
        }
    }
}

TEST(MultiblobSolver, SlipsTooAndTheForcesOfBlobs) {
    mt19937 random(2);
    Layer layer(shell(20, 0.8), 0.25, 2.2, 5);
    layer.setPoses();
    const MatrixXd M = layer.blobMobility(),
                   wrenches = normal(random, layer.bodies->getNumRows(), 1);
    const MatrixXd slips = M.llt().matrixL() * normal(random, M.rows(), 1);
    MatrixXd K;
    vector<Matrix3d> turns;
    setTurns(layer.poses, turns);
    layer.bodies->getMotion().fill(turns, K);
    const Eigen::LLT<MatrixXd> factor(M);
    const MatrixXd N = (K.transpose() * factor.solve(K)).inverse();
    const VectorXd U = N * (wrenches + K.transpose() * factor.solve(slips)),
                   lambda = factor.solve(K * U - slips);
    SolverOf at(layer);
    for (double tolerance : {1e-3, 1e-6, 1e-9}) {
        MatrixXd twists, forces;
        at.solver.solve(*at.place, wrenches, slips, tolerance, Accuracy::errorOfSinglePrecision,
                        twists);
        at.solver.getBlobForces(forces);
        const VectorXd difference = forces - lambda, ofTwists = twists - U;
        // Errors are relative to forces and slips together, in the energy norm.
        const double scale = lambda.dot(M * lambda) + slips.col(0).dot(factor.solve(slips.col(0)));
        EXPECT_LT(sqrt(difference.dot(M * difference) / scale), 3 * tolerance);
        EXPECT_LT(ofTwists.dot(N.inverse() * ofTwists), 9 * tolerance * tolerance * scale);
        // The forces add up to the wrenches, whatever the tolerance.
        EXPECT_LT((K.transpose() * forces - wrenches).norm(), 1e-10 * wrenches.norm());
    }
}

TEST(MultiblobSolver, IllConditionedBodiesAreNotTrustedToRoughProducts) {
    // Two blobs are nearly at one place. So errors of products are magnified by the root of the
    // condition number of a body's matrix.
    mt19937 random(3);
    vector<Vector3d> sites = shell(10, 0.8);
    sites.push_back(sites[3] + Vector3d(2e-5, 1e-5, 0));
    Layer layer(sites, 0.3, 2.3, 3);
    layer.setPoses();
    const MatrixXd wrenches = normal(random, layer.bodies->getNumRows(), 1);
    SolverOf at(layer);
    for (double tolerance : {1e-4, 1e-6}) {
        MatrixXd twists;
        at.solver.solve(*at.place, wrenches, MatrixXd(), tolerance,
                        Accuracy::errorOfSinglePrecision, twists);
        EXPECT_LT(layer.errorOf(twists, wrenches, 0), 3 * tolerance);
        EXPECT_GE(at.solver.getNumExactProducts(), 1);
    }
}

TEST(MultiblobSolver, ModelsWithoutRoughProductsHaveNoneInVain) {
    mt19937 random(4);
    Layer layer(shell(12, 0.7), 0.3, 2.3, 3, 0);
    layer.setPoses();
    const MatrixXd wrenches = normal(random, layer.bodies->getNumRows(), 1);
    SolverOf at(layer);
    MatrixXd twists;
    const int iterations = at.solver.solve(*at.place, wrenches, MatrixXd(), 1e-6,
                                           Accuracy::errorOfSinglePrecision, twists);
    EXPECT_EQ(at.solver.getNumProducts(), iterations + 1);
    EXPECT_LT(layer.errorOf(twists, wrenches, 0), 3e-6);
}

TEST(MultiblobSolver, BeginsAtAGuessThatTurnsWithTheBodies) {
    mt19937 random(5);
    Layer layer(shell(20, 0.8), 0.25, 2.2, 5);
    const MatrixXd wrenches = normal(random, layer.bodies->getNumRows(), 1),
                   change = normal(random, wrenches.rows(), 1);
    const MatrixXd slips = layer.blobMobility().llt().matrixL() *
                           normal(random, layer.bodies->getNumParticleRows(), 1);
    SolverOf at(layer);
    for (double tolerance : {1e-3, 1e-6})
        for (double step : {0.0, 1e-3, 1e-2}) {
            Layer moved(shell(20, 0.8), 0.25, 2.2, 5);
            MatrixXd twists, expected, guessed;
            at.goTo(layer);
            at.solver.solve(*at.place, wrenches, slips, tolerance, Accuracy::errorOfSinglePrecision,
                            twists);
            at.solver.keepGuess(0);
            for (Pose& pose : moved.poses) {
                pose.R += step * Vector3d(normal(random, 3, 1)).cwiseAbs();
                pose.q =
                    scalar::exponential(scalar::Vector3<double>{step, -step, 2 * step}) * pose.q;
            }
            at.goTo(moved);
            const MatrixXd wrenchesThere = wrenches + step * change;
            at.solver.solve(*at.place, wrenchesThere, slips, 1e-10, 0, expected);
            const int cold = at.solver.solve(*at.place, wrenchesThere, slips, tolerance,
                                             Accuracy::errorOfSinglePrecision, twists);
            const int warm = at.solver.solve(*at.place, wrenchesThere, slips, tolerance,
                                             Accuracy::errorOfSinglePrecision, guessed, true);
            cout << "step " << step << ", tolerance " << tolerance << ": " << warm
                 << " iterations instead of " << cold << endl;
            EXPECT_LT((guessed - expected).norm(), 10 * tolerance * expected.norm());
            EXPECT_LE(warm, step == 0 ? 0 : cold - 1);
        }
}

TEST(MultiblobSolver, RangesDoNotShow) {
    mt19937 random(6);
    MatrixXd first;
    for (int numRanges : {1, 2, 3, 4}) {
        Layer layer(shell(42, 0.8), 0.2, 2.2, 4, numRanges);
        layer.byProducts().setPoses(layer.poses);
        if (numRanges == 1) first = normal(random, layer.bodies->getNumRows(), 1);
        MatrixXd twists, slips;
        layer.byProducts().solve(first, twists);
        layer.byProducts().thermalSlip(
            MatrixXd::Constant(layer.bodies->getNumParticleRows(), 1, 0.3), slips);
        static MatrixXd twistsOfOne, slipsOfOne;
        if (numRanges == 1) twistsOfOne = twists, slipsOfOne = slips;
        EXPECT_EQ(twists, twistsOfOne) << numRanges;
        EXPECT_EQ(slips, slipsOfOne) << numRanges;
    }
}
