// One step of the schemes without momenta: its stochastic drift, its covariance, and its order
// without noise. TestOverdampedFlows has the flow of the fluid in a step.

#include "OverdampedSteps.h"

using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace std;

namespace {

Matrix3d rotationMatrix(const Quaternion& q) {
    return Eigen::Quaterniond(q.w, q.x, q.y, q.z).toRotationMatrix();
}

/** div N = sum_k d_k N_ik by central differences. Rows are those of twists, and rotations are turns
 * about lab axes. */
VectorXd divergence(const Scene& scene) {
    auto bodies = scene.mobility();
    const int n = bodies->getNumRows();
    const double delta = 1e-4;
    VectorXd sum = VectorXd::Zero(n);
    for (int k = 0; k < n; k++) {
        const VectorXd u = delta * VectorXd::Unit(n, k);
        sum += (mobilityAt(scene, bodies, u).col(k) - mobilityAt(scene, bodies, -u).col(k)) /
               (2 * delta);
    }
    return sum;
}

/** The mean displacement is kT h div N. */
void checkDrift(const Scene& scene) {
    const double kT = 1.3;
    const VectorXd expected = kT * divergence(scene);
    const double size = expected.norm();
    checkMean<ExactSteps>(scene, kT, expected);
    // A scheme that omits the drift fails, by far.
    const VectorXd without = ExactSteps(Integrator::EulerMaruyama, scene, kT).mean();
    EXPECT_GT((without - expected).norm(), 0.99 * size);
}

void checkSampledDrift(const Scene& scene, const vector<Integrator::Scheme>& schemes) {
    const double h = 1e-4, kT = 1.3;
    const VectorXd expected = kT * h * divergence(scene);
    for (Integrator::Scheme scheme : schemes) {
        SCOPED_TRACE(scene.name + ", " + traitsOf(scheme).name);
        Steps steps(scheme, scene, kT);
        checkSampledMean(expected, h, [&](int k, double h) { return steps.increment(k, h); });
    }
}

}  // namespace

TEST(OverdampedSchemes, DriftOfThreeBlobsAboveAWall) {
    const Scene scene = boomerangAtWall();
    // The expected values were computed independently (REFERENCE VALUES 7).
    const double reference[6] = {0.02606396, -0.0487483, 0.35555906,
                                 0.00676236, 0.00126031, 0.00062502};
    const VectorXd found = divergence(scene);
    for (int i = 0; i < 6; i++) EXPECT_NEAR(found[i], reference[i], 2e-8);
    checkDrift(scene);
}

TEST(OverdampedSchemes, DriftOfThreeBodiesAboveAWall) { checkDrift(threeBodiesAtWall()); }
TEST(OverdampedSchemes, DriftOfLubricatedSpheres) { checkDrift(lubricatedSpheres()); }
TEST(OverdampedSchemes, DriftWithLubricationOfPairs) {
    checkDrift(lubricatedBodiesAtWall());
    checkDrift(lubricatedSpheresAtWall());
}
/** Noise as wrenches and as slips. Other schemes take either of them, and the same solves. */
TEST(OverdampedSchemes, DriftWithLubricationOfPairsMatrixFree) {
    checkSampledDrift(matrixFree(lubricatedSpheresAtWall()),
                      {Integrator::FixmanMidpoint, Integrator::TrapezoidalSlip});
}
TEST(OverdampedSchemes, DriftWithLubricationBesideMultiblobsMatrixFree) {
    checkSampledDrift(matrixFree(lubricatedBodiesAtWall()),
                      {Integrator::TractionEulerMaruyama, Integrator::RandomFiniteDifference});
}
TEST(OverdampedSchemes, DriftWithLubricationBesideHeldBodiesMatrixFree) {
    checkSampledDrift(matrixFree(lubricatedBodiesBesideHeldOnes()),
                      {Integrator::TractionEulerMaruyama, Integrator::TrapezoidalSlip});
}
TEST(OverdampedSchemes, FullDriftWithLubricationOfPairsMatrixFree) {
    checkSampledDrift(matrixFree(lubricatedSpheresAtWall()), consistent);
    checkSampledDrift(matrixFree(lubricatedBodiesAtWall()), consistent);
    checkSampledDrift(matrixFree(lubricatedBodiesBesideHeldOnes()),
                      {Integrator::FixmanMidpoint, Integrator::RandomFiniteDifference});
}
TEST(OverdampedSchemes, DriftWithLubricationOfForceCoupling) {
    if (isInstrumented()) return;  // hundreds of matrices by products on a grid
    const Scene scene = lubricatedGaussians(MobilityForce::PeriodicWall);
    checkMean<ExactSteps>(scene, 1.3, 1.3 * divergence(scene), {Integrator::TractionEulerMaruyama});
}
TEST(OverdampedSchemes, FullDriftWithLubricationOfForceCoupling) {
    for (const auto boundary : {MobilityForce::PeriodicWall, MobilityForce::NoSlipChannel,
                                MobilityForce::Film, MobilityForce::SlipChannel})
        checkDrift(lubricatedGaussians(boundary));
}
/** Every random number of the field by itself. */
TEST(OverdampedSchemes, DriftBetweenWallsWithTheFieldOfAGrid) {
    const Scene scene = gaussiansBetweenPlanes(MobilityForce::NoSlipChannel);
    checkMean<ExactSteps>(scene, 1.3, 1.3 * divergence(scene), {Integrator::DriftCorrectorFD});
}
TEST(OverdampedSchemes, FullDriftBetweenWallsWithTheFieldOfAGrid) {
    for (const auto boundary : {MobilityForce::PeriodicWall, MobilityForce::NoSlipChannel})
        checkDrift(gaussiansBetweenPlanes(boundary));
}
TEST(OverdampedSchemes, DriftBetweenWallsOnAGrid) {
    const Scene scene = surfacesBetweenPlanes(MobilityForce::NoSlipChannel);
    checkMean<ExactSteps>(scene, 1.3, 1.3 * divergence(scene), {Integrator::TrapezoidalSlip});
}
TEST(OverdampedSchemes, FullDriftBetweenWallsOnAGrid) {
    for (const auto boundary : {MobilityForce::PeriodicWall, MobilityForce::NoSlipChannel})
        checkDrift(surfacesBetweenPlanes(boundary));
}
TEST(OverdampedSchemes, DriftWithOwnTensors) { checkDrift(ownTensors()); }
TEST(OverdampedSchemes, DriftWithOwnTensorsMatrixFree) { checkDrift(matrixFree(ownTensors())); }
TEST(OverdampedSchemes, DriftWithARandomField) { checkDrift(blobsInAField()); }
TEST(OverdampedSchemes, DriftOfASlowedSpin) {
    checkDrift(slowedRod(true, false));
    checkDrift(slowedAlone());
}
TEST(OverdampedSchemes, DriftOfASlowedSpinByIterationsAndFields) {
    checkDrift(matrixFree(slowedRod(false, false)));
    checkDrift(slowedRod(false, true));
}
TEST(OverdampedSchemes, DriftInASlipChannel) { checkDrift(bodyInAChannel()); }
TEST(OverdampedSchemes, DriftWithLubrication) { checkDrift(stokesianSpheres()); }
TEST(OverdampedSchemes, DriftOfRodsUnbounded) { checkDrift(rodsUnbounded()); }
TEST(OverdampedSchemes, DriftOfOneBodyAboutAnyPoint) { checkDrift(aloneOffCentre()); }
TEST(OverdampedSchemes, DriftMatrixFree) { checkDrift(matrixFree(rodsUnbounded())); }

/**
 * Wherever isDivergenceFree() is true, div N = 0 up to the error of differences. Elsewhere div N is
 * 1e4 times larger.
 */
TEST(OverdampedSchemes, DivergenceIsZeroWhereItIsSaidToBe) {
    mt19937 random(5);
    uniform_real_distribution<double> u(0, 1);
    for (int k = 0; k < 20; k++) {
        Scene scene;
        scene.viscosity = 1;
        scene.inBox = k % 4 == 3;
        scene.gaussians = k % 8 == 3;
        const auto place = [&](double size) {
            return Vector3d(size * u(random), size * u(random), size * u(random));
        };
        for (int i = 0; i < 6; i++) {
            const bool isFree = u(random) < 0.3;
            scene.add(element(isFree ? -1 : i, {{0, 0, 0}}, {0.4 + 1.1 * u(random)}),
                      place(k % 2 ? 3 : 6), place(3));
        }
        auto bodies = scene.mobility();
        EXPECT_TRUE(bodies->isDivergenceFree());
        const double largest =
            mobilityAt(scene, bodies, VectorXd::Zero(bodies->getNumRows())).maxCoeff();
        // Third derivatives are up to the inverse cube of a radius here. Differences have an error
        // of a sixth of 1e-8 of these derivatives.
        EXPECT_LT(divergence(scene).cwiseAbs().maxCoeff(), 1e-7 * largest) << k;
    }
    for (const Scene& scene : {threeBodiesAtWall(), rodsUnbounded(), lubricatedSpheres(),
                               ownTensors(), stokesianSpheres()})
        EXPECT_FALSE(scene.mobility()->isDivergenceFree()) << scene.name;
    Scene offOrigin = spheresUnbounded();
    offOrigin.elements[0].sites[0] = Vector3d(0.1, 0, 0);
    EXPECT_FALSE(offOrigin.mobility()->isDivergenceFree());
    // Spheres with a wall or lubrication have a divergence.
    EXPECT_GT(divergence(lubricatedSpheres()).norm(), 1e-3);
    Scene lubrication = stokesianSpheres();
    lubrication.elements[1].sites[0].setZero();
    EXPECT_GT(divergence(lubrication).norm(), 1e-3);
}

/**
 * Without drift a step has the mean 0. The mid-point alone, or the divergence of slips alone, would
 * give 1e-2 of kT here: kT sum_jk (d_j L_ik) L_jk, with L the root.
 */
TEST(OverdampedSchemes, SpheresUnboundedHaveNoDrift) {
    const double kT = 1.3;
    for (Scene scene : {spheresUnbounded(), matrixFree(spheresUnbounded())}) {
        auto bodies = scene.mobility();
        const int n = bodies->getNumRows();
        const auto root = [&](const VectorXd& u) {
            return MatrixXd(mobilityAt(scene, bodies, u).llt().matrixL());
        };
        const double delta = 1e-4;
        const MatrixXd L = root(VectorXd::Zero(n));
        VectorXd halfDrift = VectorXd::Zero(n);
        for (int j = 0; j < n; j++) {
            const VectorXd u = delta * VectorXd::Unit(n, j);
            halfDrift += (root(u) - root(-u)) / (2 * delta) * L.row(j).transpose();
        }
        const double size = kT * halfDrift.norm();
        ASSERT_GT(size, 1e-2 * kT);
        // The steps of all schemes but FixmanMidpoint are their leading noise and nothing else.
        // What is left is of the order of h, or of rounding over h.
        for (const Integrator::Scheme scheme : overdampedSchemes)
            EXPECT_LT(ExactSteps(scheme, scene, kT).mean().norm(),
                      scheme == Integrator::FixmanMidpoint ? 1e-4 * size : 1e-8)
                << scene.name << ", " << traitsOf(scheme).name;
    }
}

namespace {

/** Displacements have the covariance 2 kT h N, to an error of h = 1e-6. */
void checkCovariance(const Scene& scene) {
    const double kT = 0.8;
    auto bodies = scene.mobility();
    const MatrixXd N = mobilityAt(scene, bodies, VectorXd::Zero(bodies->getNumRows()));
    for (const Integrator::Scheme scheme : overdampedSchemes) {
        ExactSteps steps(scheme, scene, kT);
        const MatrixXd found = steps.step.h / (2 * kT) * steps.covariance();
        EXPECT_LT((found - N).cwiseAbs().maxCoeff(), 1e-5 * N.cwiseAbs().maxCoeff())
            << scene.name << ", " << traitsOf(scheme).name;
    }
}

/**
 * Increments have the covariance 2 kT h N. The test allows 5 standard errors. The standard
 * deviation of a product of normal numbers is sqrt(N_ii N_jj + N_ij^2).
 */
void checkSampledCovariance(const Scene& scene, const vector<Integrator::Scheme>& schemes) {
    const double h = 1e-6, kT = 0.8;
    const int samples = allOrFew(scene.matrixFree ? 1000 : 4000, 300);
    auto bodies = scene.mobility();
    const MatrixXd N = mobilityAt(scene, bodies, VectorXd::Zero(bodies->getNumRows()));
    for (const Integrator::Scheme scheme : schemes) {
        if (scheme == Integrator::DriftCorrectorFD) continue;  // noise of the other corrector
        SCOPED_TRACE(scene.name + ", " + traitsOf(scheme).name);
        Steps steps(scheme, scene, kT);
        MatrixXd found = MatrixXd::Zero(N.rows(), N.rows());
        for (int i = 0; i < samples; i++) {
            const VectorXd u = steps.increment(i, h);
            found += u * u.transpose() / (2 * kT * h * samples);
        }
        for (int i = 0; i < N.rows(); i++)
            for (int k = 0; k <= i; k++)
                EXPECT_LT(abs(found(i, k) - N(i, k)),
                          5 * sqrt((N(i, i) * N(k, k) + N(i, k) * N(i, k)) / samples) + 1e-12)
                    << i << " " << k;
    }
}

}  // namespace

TEST(OverdampedSchemes, Covariance) {
    for (const Scene& scene :
         {threeBodiesAtWall(), rodsUnbounded(), aloneOffCentre(), matrixFree(rodsUnbounded()),
          ownTensors(), matrixFree(ownTensors()), stokesianSpheres(), spheresUnbounded(),
          blobsInAField(), slowedRod(true, false), slowedAlone(), lubricatedBodiesAtWall()})
        checkCovariance(scene);
    for (const Scene& scene :
         {lubricatedSpheresAtWall(), lubricatedBodiesAtWall(), lubricatedBodiesBesideHeldOnes()})
        checkSampledCovariance(matrixFree(scene),
                               {Integrator::FixmanMidpoint, Integrator::TractionEulerMaruyama});
}

/**
 * Weak order 1 depends on the first and second moments of random numbers only, because higher odd
 * moments vanish by symmetry. Steps with random numbers of each law therefore have the same
 * covariance.
 */
TEST(OverdampedSchemes, NumbersOfEveryLawHaveTheCovariance) {
    for (auto law : {NoiseStream::Gaussian, NoiseStream::ThreePoint, NoiseStream::TwoPoint}) {
        Scene scene = boomerangAtWall();
        scene.law = law;
        scene.name += ", law " + to_string(law);
        checkSampledCovariance(scene, overdampedSchemes);
    }
}

/**
 * The difference of square roots at close poses is right to about the tolerance, although the
 * distance of the poses is smaller than the tolerance, because iterations follow one course. After
 * the differences, iterations go to a coarser tolerance.
 */
TEST(OverdampedSchemes, DifferencedRootsFollowOneCourse) {
    const double tolerance = 1e-4, delta = 1e-6;
    Scene scene;
    scene.wall = true;
    for (int b = 0; b < 9; b++)
        scene.add(element(b, threeBlobs, {1, 0.8, 1}), {3.0 * (b % 3), 3.0 * (b / 3), 3.2},
                  {0.3 * b, 0.1, -0.5});
    auto bodies = scene.mobility();
    mt19937 random(4);
    normal_distribution<double> gauss;
    MatrixXd W(bodies->getMotion().getParticles().numRows, 1), directions(bodies->getNumRows(), 1);
    for (int i = 0; i < W.size(); i++) W(i) = gauss(random);
    for (int i = 0; i < directions.size(); i++) directions(i) = gauss(random);
    vector<Pose> here(scene.elements.size()), there;
    for (size_t e = 0; e < here.size(); e++) here[e] = {scene.R[e], scene.q[e]};
    there = here;
    for (size_t e = 0; e < here.size(); e++)
        there[e].R += delta * directions.middleRows<3>(bodies->firstRow(e));
    struct Found {
        MatrixXd difference;
        long long start, displaced, afterwards;
    };
    const auto find = [&](double wanted) {
        BodyMobility& mobility = bodies.byProducts();
        ErrorBudget::Needs needed;
        needed.partOfTolerance = 0.1;
        needed.exactProducts = true;
        mobility.setErrors(ErrorBudget(wanted, needed));
        Found found;
        MatrixXd first, second, last;
        const auto productsOf = [&](MatrixXd& slips) {
            const long long before = mobility.getCosts().products;
            mobility.thermalSlip(W, slips);
            return mobility.getCosts().products - before;
        };
        mobility.setPoses(here);
        found.start = productsOf(first);
        mobility.setPoses(there, true);
        found.displaced = productsOf(second);
        mobility.setPoses(here);
        mobility.endDifferences();
        found.afterwards = productsOf(last);
        found.difference = (second - first) / delta;
        EXPECT_LT((last - first).norm(), 5 * wanted * first.norm());
        return found;
    };
    const Found exact = find(1e-9), found = find(tolerance);
    EXPECT_EQ(found.displaced, found.start);
    EXPECT_LT(found.afterwards, found.start);
    // A tenth of the tolerance, times a small power of the number of products.
    const double error =
        (found.difference - exact.difference).norm() / exact.difference.norm() / tolerance;
    cout << found.start << " products, then " << found.afterwards << "; error of the difference "
         << error << " tolerances" << endl;
    EXPECT_LT(error, 20);
}

/** No step turns a rod about its line, wherever its origin is. */
TEST(OverdampedSchemes, NoNoiseAboutARodsLine) {
    const Scene scene = rodsUnbounded();
    for (bool matrixFree : {false, true}) {
        auto bodies = scene.mobility();
        BodyMobility& mobility = matrixFree ? bodies.byProducts() : bodies.byMatrices();
        mobility.setTolerance(1e-10);
        OverdampedMove move(mobility);
        for (size_t e = 0; e < scene.elements.size(); e++) {
            move.start[e].R = scene.R[e];
            move.start[e].q = scene.q[e];
        }
        OverdampedStep step;
        step.h = 1e-3;
        step.kT = 1;
        move.begin(step);
        overdampedScheme(Integrator::EulerMaruyama).make()->run(0, move);
        for (int e = 0; e < 2; e++) {
            const Vector3d line =
                rotationMatrix(scene.q[e]) * bodies->getNullVector_body(e).tail<3>().normalized();
            const Vector3d W = displacementOf(move, *bodies).segment<3>(bodies->firstRow(e) + 3);
            EXPECT_LT(abs(W.dot(line)), 1e-12 * W.norm());
        }
    }
}
