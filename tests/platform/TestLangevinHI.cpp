// The scheme LangevinHI is compared with Langevin C where the friction is constant, and one step
// with linear theory. Further tests are of its order, its counters, and exact resume.
// TestLangevinHIAverages.cpp tests averages, free particles and many bodies. Units have kT = 1
// unless said otherwise.

#include <openmm/serialization/XmlSerializer.h>

#include <sstream>

#include "Instrumented.h"
#include "LangevinHISupport.h"

using namespace OpenMM;
using namespace RigidHITest;
using namespace std;

namespace {

/** The models with which the scheme runs. A new model is one more line here. */
struct ModelCase {
    string name;
    MobilityForce::Model model;
    MobilityForce::Boundary boundary;
    bool takesMultiblobs, takesFreeParticles;
    MobilityForce::SphereWallMobility sphereWall = MobilityForce::FromModel;
};
void PrintTo(const ModelCase& model, ostream* out) {
    *out << model.name;
}  // for GoogleTest's messages
const vector<ModelCase> models = {
    {"FreeDraining", MobilityForce::FreeDraining, MobilityForce::Unbounded, true, true},
    {"RotnePragerYamakawa", MobilityForce::RotnePragerYamakawa, MobilityForce::Unbounded, true,
     true},
    {"StokesianDynamics", MobilityForce::StokesianDynamics, MobilityForce::Unbounded, false, false},
    {"RotnePragerYamakawaWall", MobilityForce::RotnePragerYamakawa, MobilityForce::NoSlipWall, true,
     true},
    {"BestKnownAtTheWall", MobilityForce::RotnePragerYamakawa, MobilityForce::NoSlipWall, true,
     false, MobilityForce::BestKnown},
    {"RotnePragerYamakawaPeriodic", MobilityForce::RotnePragerYamakawa, MobilityForce::Periodic,
     true, false},
    {"StokesianDynamicsPeriodic", MobilityForce::StokesianDynamics, MobilityForce::Periodic, false,
     false},
    {"ForceCouplingPeriodic", MobilityForce::ForceCoupling, MobilityForce::Periodic, false, false},
    {"RotnePragerYamakawaPeriodicWall", MobilityForce::RotnePragerYamakawa,
     MobilityForce::PeriodicWall, true, false},
    {"RotnePragerYamakawaNoSlipChannel", MobilityForce::RotnePragerYamakawa,
     MobilityForce::NoSlipChannel, true, false}};
void choose(FluidScene& scene, const ModelCase& model) {
    scene.fluid->setModel(model.model);
    scene.fluid->setBoundary(model.boundary);
    scene.fluid->setWallHeight(-2.1);  // just below all of addAllKinds()
    scene.fluid->setChannelWalls(-2.1, 12);
    scene.fluid->setSphereWallMobility(model.sphereWall);
}

class EveryModelWithMomenta : public testing::TestWithParam<ModelCase> {};
INSTANTIATE_TEST_SUITE_P(LangevinHI, EveryModelWithMomenta, testing::ValuesIn(models),
                         [](const testing::TestParamInfo<ModelCase>& info) {
                             return info.param.name;
                         });

/**
 * Bodies of all kinds, or spheres only where a model takes no others, at positions about 2.5 apart.
 */
void addAllKinds(FluidScene& scene, bool multiblobs, const Vec3& offset = Vec3()) {
    mt19937 random(5);
    vector<BodyKind> kinds = {sphereKind(0.5, 1, 0.3), markedSphere(0.6, 2, Vec3(0.5, 0.3, 0.4)),
                              linearSphere(0.4, 1.5, 0.2), pointKind(0.3, 0.7)};
    if (multiblobs)
        for (const BodyKind& kind : {boomerangKind(), rodKind()}) kinds.push_back(kind);
    int place = 0;
    for (const BodyKind& kind : kinds) {
        scene.add(kind, offset + Vec3(2.6 * (place % 2), 2.4 * (place / 2 % 2), 2.7 * (place / 4)),
                  randomQuaternion(random));
        place++;
    }
}

/** The inverse of masses and inertia tensors in the lab frame. It is zero about axes without
 * inertia. */
MatrixXd inverseInertia(FluidScene& scene) {
    const int n = scene.bodies.size();
    MatrixXd result = MatrixXd::Zero(6 * n + 3 * scene.freeParticles.size(),
                                     6 * n + 3 * scene.freeParticles.size());
    const auto q = scene.integrator.getBodyOrientations();
    for (int b = 0; b < n; b++) {
        const BodyKind& kind = scene.bodies[b];
        Vector3d inverse;
        for (int k = 0; k < 3; k++) inverse[k] = kind.moments[k] > 0 ? 1 / kind.moments[k] : 0;
        const Matrix3d A = rotationOf(q[b]);
        result.block(6 * b, 6 * b, 3, 3) = Matrix3d::Identity() / kind.mass;
        result.block(6 * b + 3, 6 * b + 3, 3, 3) = A * inverse.asDiagonal() * A.transpose();
    }
    for (size_t i = 0; i < scene.freeParticles.size(); i++) {
        const int row = 6 * n + 3 * i;
        result.block(row, row, 3, 3) =
            Matrix3d::Identity() / scene.system.getParticleMass(scene.freeParticles[i]);
    }
    return result;
}

}  // namespace

// ---- Constant isotropic friction is Langevin C ----

namespace {

enum class Layout { FreeDraining, AloneUnderRpy, TwoGroups };

/** Compares the same bodies in a fluid and with the frictions of Langevin C. */
void compareWithLangevinC(Layout layout, CustomRigidHIIntegrator::NoiseLaw law,
                          double temperature) {
    vector<BodyKind> kinds = {markedSphere(0.5, 1.5, Vec3(0.3, 0.5, 0.4)),
                              linearSphere(0.4, 2, 0.35), markedSphere(0.3, 1, Vec3(0.2, 0.2, 0.2)),
                              pointKind(0.6, 3)};
    const double eta = 0.6;
    for (size_t first = 0; first < (layout == Layout::AloneUnderRpy ? kinds.size() : 1); first++) {
        vector<BodyKind> chosen = kinds;
        if (layout == Layout::AloneUnderRpy) chosen = {kinds[first]};
        if (layout == Layout::TwoGroups) chosen.resize(2);
        FluidScene hydrodynamic(temperature, 0.02), plain(temperature, 0.02);
        mt19937 random(9);
        for (size_t b = 0; b < chosen.size(); b++) {
            const QuaternionArray q = randomQuaternion(random);
            for (FluidScene* scene : {&hydrodynamic, &plain})
                scene->add(chosen[b], Vec3(0.4 * b, 0, 0), q);
        }
        if (layout == Layout::FreeDraining)
            for (FluidScene* scene : {&hydrodynamic, &plain})
                scene->addFree(2, 0.45, Vec3(1, 1, 1));
        if (layout == Layout::TwoGroups) hydrodynamic.fluid->setGroups({3, 1});
        if (layout == Layout::FreeDraining)
            hydrodynamic.fluid->setModel(MobilityForce::FreeDraining);
        plain.removeFluid();
        plain.integrator.setScheme(CustomRigidHIIntegrator::LangevinC);
        for (size_t b = 0; b < chosen.size(); b++) {
            double sum = 0;
            for (int k = 0; k < 3; k++)
                sum += chosen[b].moments[k] > 0 ? 1 / chosen[b].moments[k] : 0;
            const double a = chosen[b].radii[0];
            plain.integrator.setBodyFriction(b, 6 * M_PI * eta * a / chosen[b].mass,
                                             8 * M_PI * eta * pow(a, 3) * sum);
        }
        plain.integrator.setFriction(6 * M_PI * eta * 0.45 / 2);  // of the free particle
        vector<Snapshot> ends;
        vector<double> randomNumbers;
        for (FluidScene* scene : {&hydrodynamic, &plain}) {
            addField(scene->system, "2*(x^2+y^2+z^2)+sin(3*x)*y+0.7*z");
            scene->integrator.setNoiseLaw(law);
            scene->start(testPlatform());
            scene->integrator.step(1);
            scene->integrator.step(40);
            ends.emplace_back(*scene);
            randomNumbers.push_back(scene->integrator.getStepStatistics().at("randomNumbers"));
        }
        ends[0].expectNear(ends[1], 1e-11,
                           "layout " + to_string(int(layout)) + " law " + to_string(law));
        EXPECT_EQ(randomNumbers[0], randomNumbers[1]);
    }
}

}  // namespace

TEST(LangevinHI, WithConstantIsotropicFrictionIsLangevinC) {
    for (auto layout : {Layout::FreeDraining, Layout::AloneUnderRpy, Layout::TwoGroups}) {
        for (auto law : {CustomRigidHIIntegrator::Gaussian, CustomRigidHIIntegrator::ThreePoint,
                         CustomRigidHIIntegrator::TwoPoint})
            compareWithLangevinC(layout, law, 0.3 * T1);
        compareWithLangevinC(layout, CustomRigidHIIntegrator::Gaussian, 0);
    }
}

TEST(LangevinHI, OwnIsotropicTensorsAreLangevinCToo) {
    // With a diagonal own tensor a multiblob has the plain thermostat of Langevin C, although the
    // friction of its blobs is not diagonal.
    FluidScene hydrodynamic(T1, 0.02), plain(T1, 0.02);
    for (FluidScene* scene : {&hydrodynamic, &plain}) scene->add(boomerangKind());
    hydrodynamic.fluid->setModel(MobilityForce::FreeDraining);
    MatrixXd friction = MatrixXd::Zero(6, 6);
    friction.diagonal() << 4, 4, 4, 2, 2, 2;
    hydrodynamic.fluid->setBodyFriction(0, rowsOf(friction));
    plain.removeFluid();
    plain.integrator.setScheme(CustomRigidHIIntegrator::LangevinC);
    plain.integrator.setBodyFriction(0, 4.0 / 3, 2 * (1 / 1.3 + 1 / 0.7 + 1 / 1.1));
    for (FluidScene* scene : {&hydrodynamic, &plain}) {
        addField(scene->system, "x^2+y^2+z^2+0.3*x*y");
        scene->start(testPlatform());
        scene->integrator.step(40);
    }
    Snapshot(hydrodynamic).expectNear(Snapshot(plain), 1e-11, "own tensor");
}

TEST(LangevinHI, TheCoupledPathWithIsotropicFrictionIsLangevinCUpToTheNeighbour) {
    // Two spheres so far apart that they hardly feel each other take the general path, with the
    // same random numbers.
    FluidScene hydrodynamic(T1, 0.02), plain(T1, 0.02);
    const double far = 1e7;
    for (FluidScene* scene : {&hydrodynamic, &plain}) {
        scene->add(markedSphere(0.5, 1.5, Vec3(0.3, 0.5, 0.4)));
        scene->add(linearSphere(0.4, 2, 0.35), Vec3(far, 0, 0));
        scene->add(pointKind(0.3, 1), Vec3(0, far, 0));
    }
    plain.removeFluid();
    plain.integrator.setScheme(CustomRigidHIIntegrator::LangevinC);
    const double eta = 0.6;
    plain.integrator.setBodyFriction(0, 6 * M_PI * eta * 0.5 / 1.5,
                                     8 * M_PI * eta * 0.125 * (1 / 0.3 + 1 / 0.5 + 1 / 0.4));
    plain.integrator.setBodyFriction(1, 6 * M_PI * eta * 0.4 / 2,
                                     8 * M_PI * eta * 0.064 * 2 / 0.35);
    plain.integrator.setBodyFriction(2, 6 * M_PI * eta * 0.3, 0);
    for (FluidScene* scene : {&hydrodynamic, &plain}) {
        addField(scene->system, "x*0.3-y*0.2+z");
        scene->start(testPlatform());
        scene->integrator.step(20);
    }
    Snapshot(hydrodynamic).expectNear(Snapshot(plain), 1e-6, "far away");
}

// ---- One step against linear theory ----

namespace {

/**
 * The response of all velocities at the end of one step to all velocities at its start, without
 * forces and noise, by central differences.
 */
MatrixXd measuredResponse(FluidScene& scene, double size) {
    const int n = scene.bodies.size(), rows = 6 * n + 3 * scene.freeParticles.size();
    const auto R = scene.integrator.getBodyPositions();
    const auto q = scene.integrator.getBodyOrientations();
    MatrixXd response(rows, rows);
    for (int column = 0; column < rows; column++) {
        VectorXd ends[2];
        for (int sign = 0; sign < 2; sign++) {
            VectorXd twists = VectorXd::Zero(rows);
            twists[column] = sign ? size : -size;
            scene.context->setPositions(scene.positions);
            if (n > 0) scene.pose(R, q);
            vector<Vec3> free;
            for (int i = 6 * n; i < rows; i += 3) free.push_back(toVec3(twists.segment<3>(i)));
            setTwists(scene, twists, free);
            scene.integrator.step(1);
            ends[sign] = twistsOf(scene);
        }
        response.col(column) = (ends[1] - ends[0]) / (2 * size);
    }
    scene.context->setPositions(scene.positions);
    scene.pose(R, q);
    return response;
}

/** The exponential of any square matrix: Taylor's series of a part of it, squared again and again.
 */
MatrixXd exponential(const MatrixXd& m) {
    const int squarings = max(0, int(ceil(log2(m.norm() + 1e-300))) + 3);
    const MatrixXd part = m * pow(0.5, squarings);
    // exp(part) - 1, so that nothing is lost where it is small: (1 + e)^2 - 1 = 2 e + e^2.
    MatrixXd term = part, sum = part;
    for (int k = 2; k < 20; k++) {
        term = (term * part).eval() / k;
        sum += term;
    }
    for (int i = 0; i < squarings; i++) sum = (2 * sum + sum * sum).eval();
    return sum + MatrixXd::Identity(m.rows(), m.cols());
}

/** The response in theory: V(h) = exp(-h I^-1 xi) V(0), on velocities that bodies can have. */
MatrixXd expectedResponse(const MatrixXd& friction, const MatrixXd& inverse, double h) {
    const MatrixXd onLive = inverse * inverse.completeOrthogonalDecomposition().pseudoInverse();
    return exponential(-h * inverse * friction) * onLive;
}

MatrixXd squareRoot(const MatrixXd& m) {
    return Eigen::SelfAdjointEigenSolver<MatrixXd>(m).operatorSqrt();
}

MatrixXd fullFriction(FluidScene& scene, const ModelCase& model) {
    const auto bodies = scene.labBodies();
    if (model.model == MobilityForce::RotnePragerYamakawa &&
        model.sphereWall == MobilityForce::FromModel && !scene.isPeriodic())
        return scene.expected().friction;
    // Other models have unit tests of their matrices, and no free particles.
    if (model.model != MobilityForce::FreeDraining) return scene.friction();
    int rows = 0, row = 0;
    for (const LabBody& body : bodies) rows += body.rows();
    MatrixXd friction = MatrixXd::Zero(rows, rows);
    for (const LabBody& body : bodies) {
        friction.block(row, row, body.rows(), body.rows()) = scene.expected({body}).friction;
        row += body.rows();
    }
    return friction;
}

}  // namespace

TEST_P(EveryModelWithMomenta, OneStepResponseIsTheExponentialOfFrictionOverInertia) {
    for (bool free : {false, true})
        for (double h : {1e-4, 0.05, 1.0}) {
            if (isInstrumented() && h < 1) continue;
            if (free && !GetParam().takesFreeParticles) continue;
            // Free particles, or none, at two steps each.
            if (GetParam().takesFreeParticles && h == (free ? 1e-4 : 1.0)) continue;
            FluidScene scene(0, h);
            choose(scene, GetParam());
            addAllKinds(scene, GetParam().takesMultiblobs);
            if (free)
                for (double radius : {0.35, 0.5})
                    scene.addFree(1.3, radius, Vec3(-2, 2 * radius, 1));
            scene.start(testPlatform());
            const MatrixXd expected =
                expectedResponse(fullFriction(scene, GetParam()), inverseInertia(scene), h);
            EXPECT_LT(difference(measuredResponse(scene, 1e-5), expected), readTolerance(1e-8, 1))
                << "h = " << h;
        }
}

TEST(LangevinHI, OneStepOfABodyAloneAndOfPairs) {
    // The scenes take the path for constant friction, the path for spheres only, where the mobility
    // is decomposed and not the friction, and the path for bodies without inertia about a line.
    const vector<vector<BodyKind>> scenes = {
        {boomerangKind()},
        {rodKind()},
        {{"sphere off the origin", 1, Vec3(0.4, 0.2, 0.3), {Vec3(0.3, -0.2, 0.1)}, {0.5}}},
        {sphereKind(0.5), sphereKind(0.7, 2, 0.1)},
        {sphereKind(0.5), linearSphere(0.6, 1, 0.2)},
        {pointKind(0.5, 1), pointKind(0.6, 2)},
        {boomerangKind(), sphereKind(0.5)},
        {rodKind(), rodKind()}};
    for (const auto& kinds : scenes)
        for (double h : {1e-3, 0.1}) {
            FluidScene scene(0, h);
            mt19937 random(4);
            for (size_t b = 0; b < kinds.size(); b++)
                scene.add(kinds[b], Vec3(1.7 * b, 0.4 * b, 0), randomQuaternion(random));
            scene.start(testPlatform());
            const MatrixXd expected =
                expectedResponse(scene.expected().friction, inverseInertia(scene), h);
            EXPECT_LT(difference(measuredResponse(scene, 1e-5), expected), readTolerance(1e-8, 1))
                << kinds[0].name << ", h = " << h;
        }
}

TEST(LangevinHI, AChangedStepSizeIsHonoured) {
    // A body alone keeps the matrices of its step, which depend on the step size.
    FluidScene scene(0, 0.1);
    scene.add(boomerangKind());
    scene.start(testPlatform());
    for (double h : {0.1, 0.03, 0.1}) {
        scene.integrator.setStepSize(h);
        const MatrixXd expected =
            expectedResponse(scene.expected().friction, inverseInertia(scene), h);
        EXPECT_LT(difference(measuredResponse(scene, 1e-5), expected), readTolerance(1e-8, 1));
    }
}

TEST(LangevinHI, HardRatiosOfMassesAndOfFrictionToMass) {
    for (double ratio : {1e-6, 1e6})
        for (double frictionOverMass : {1e-6, 1.0, 1e6})
            for (bool multiblob : {false, true}) {
                const double h = 0.01, xi = 6 * M_PI * 0.6 * 0.5, mass = xi / frictionOverMass;
                FluidScene scene(0, h);
                scene.add(sphereKind(0.5, mass, 0.1 * mass));
                scene.add(sphereKind(0.6, mass * ratio, 0.1 * mass * ratio), Vec3(1.5, 0.3, 0));
                BodyKind boomerang = boomerangKind();
                boomerang.mass *= mass;
                boomerang.moments *= mass;
                if (multiblob) scene.add(boomerang, Vec3(-2, 0, 0));
                scene.start(testPlatform());
                // In momenta divided by the roots of masses all entries are of order 1.
                const MatrixXd inverse = inverseInertia(scene), root = squareRoot(inverse),
                               friction = scene.expected().friction;
                const MatrixXd S = root * friction * root;
                const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(S);
                const MatrixXd expected =
                    eigen.eigenvectors() *
                    (-h * eigen.eigenvalues().array()).exp().matrix().asDiagonal() *
                    eigen.eigenvectors().transpose();
                const MatrixXd measured = root.inverse() * measuredResponse(scene, 1e-5) * root;
                EXPECT_LT((measured - expected).cwiseAbs().maxCoeff(), 1e-6)
                    << "mass ratio " << ratio << ", friction/mass " << frictionOverMass;
            }
}

namespace {

void checkNoise(const ModelCase& model, int samples, int samplesInBoxes) {
    // Steps start from rest, at a temperature so small that bodies hardly move. The exact
    // covariance is <V V^T> = kT (I^-1 - E I^-1 E^T), with E the response. The theory is used to
    // make the samples white. Entry (i, k) of their covariance then has the error sqrt((1 +
    // delta_ik)/n).
    const double smallT = 1e-12 * T1;
    for (double h : {0.01, 0.5}) {
        FluidScene scene(smallT, h);
        choose(scene, model);
        addAllKinds(scene, model.takesMultiblobs);
        if (model.takesFreeParticles) scene.addFree(1.3, 0.35, Vec3(-2, 1, 1));
        scene.start(testPlatform());
        const MatrixXd inverse = inverseInertia(scene), friction = fullFriction(scene, model);
        const MatrixXd E = exponential(-h * inverse * friction);
        const MatrixXd covariance = inverse - E * inverse * E.transpose();
        const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(covariance);
        const int rows = covariance.rows(), n = scene.isPeriodic() ? samplesInBoxes : samples;
        int dead = 0;
        while (eigen.eigenvalues()[dead] < 1e-10 * eigen.eigenvalues()[rows - 1]) dead++;
        EXPECT_EQ(dead, model.takesMultiblobs ? 5 : 4);  // two linear bodies or one, a point
        const int live = rows - dead;
        const MatrixXd white =
            eigen.eigenvalues().tail(live).cwiseInverse().cwiseSqrt().asDiagonal() *
            eigen.eigenvectors().rightCols(live).transpose() * 1e6;
        const auto R = scene.integrator.getBodyPositions();
        const auto q = scene.integrator.getBodyOrientations();
        MatrixXd sum = MatrixXd::Zero(live, live);
        VectorXd mean = VectorXd::Zero(live);
        double unseen = 0;
        for (int sample = 0; sample < n; sample++) {
            scene.context->setPositions(scene.positions);
            scene.pose(R, q);
            setTwists(scene, VectorXd::Zero(rows), {Vec3()});
            scene.integrator.step(1);
            const VectorXd V = twistsOf(scene), y = white * V;
            sum += y * y.transpose() / n;
            mean += y / n;
            unseen = max(unseen, (eigen.eigenvectors().leftCols(dead).transpose() * V).norm());
        }
        EXPECT_LT(unseen, 1e-11);  // other components have a size of 1e-6
        double worst = mean.cwiseAbs().maxCoeff() * sqrt(n);
        for (int i = 0; i < live; i++)
            for (int k = 0; k <= i; k++)
                worst = max(worst, abs(sum(i, k) - (i == k)) * sqrt(n / (i == k ? 2.0 : 1.0)));
        cout << "h = " << h << ": largest z of " << live * (live + 3) / 2 << " entries: " << worst
             << endl;
        EXPECT_LT(worst, 5.5);  // some hundreds of entries, chi^2 tails
    }
}

}  // namespace

/**
 * A thousand samples show a variance that is wrong by 5.5 sqrt(2/1000), a quarter. Steps with
 * lattice sums take longer. Their noise is made like that of other dense matrices.
 */
TEST_P(EveryModelWithMomenta, OneStepNoiseHasTheCovarianceOfTheory) {
    checkNoise(GetParam(), allOrFew(1000, 100), allOrFew(300, 100));
}
TEST_P(EveryModelWithMomenta, FullOneStepNoiseHasTheCovarianceOfTheory) {
    checkNoise(GetParam(), 3000, 1000);
}

// ---- Deterministic limit ----

TEST(LangevinHI, ASedimentingPairFallsAsItsMobilitySays) {
    // Two equal spheres side by side keep their distance. V and omega of the steady state are those
    // of the mobility in the limit h^2 -> 0.
    const double apart = 1.4, radius = 0.5;
    double error[2][2], limit[2] = {0, 0};
    VectorXd expected;
    for (int i = 0; i < 2; i++) {
        const double h = i == 0 ? 0.1 : 0.05;
        FluidScene scene(0, h);
        scene.add(sphereKind(radius));
        scene.add(sphereKind(radius), Vec3(apart, 0, 0));
        addField(scene.system, "z");
        scene.start(testPlatform());
        scene.integrator.step(int(round(20 / h)));
        VectorXd force = VectorXd::Zero(12);
        force[2] = force[8] = -1;
        expected = scene.expected().mobility * force;
        const VectorXd steady = twistsOf(scene);
        EXPECT_LT((steady.head(3) - steady.segment(6, 3)).norm(), 1e-12);
        EXPECT_LT((steady.segment(3, 3) + steady.segment(9, 3)).norm(), 1e-12);
        for (int k = 0; k < 2; k++) {
            const int row = k == 0 ? 2 : 4;
            error[i][k] = steady[row] - expected[row];
            limit[k] += (i == 0 ? -1.0 : 4.0) / 3 * steady[row];
        }
    }
    for (int k = 0; k < 2; k++) {
        EXPECT_NEAR(error[0][k] / error[1][k], 4, 0.1);
        EXPECT_NEAR(limit[k] / expected[k == 0 ? 2 : 4], 1, 1e-3);
        cout << "V, omega at h -> 0, relative to the mobility: "
             << limit[k] / expected[k == 0 ? 2 : 4] << endl;
    }
}

TEST_P(EveryModelWithMomenta, TrajectoriesConvergeWithOrderTwo) {
    const auto end = [&](double h) {
        FluidScene scene(0, h);
        choose(scene, GetParam());
        addAllKinds(scene, GetParam().takesMultiblobs);
        scene.addFree(1, GetParam().takesFreeParticles ? 0.4 : 0, Vec3(-2, 0, 0));
        addField(scene.system, "0.6*(x-1)^2+0.4*(y-1)^2+0.5*(z-1)^2+sin(2*x)*y");
        scene.start(testPlatform());
        mt19937 random(2);
        setTwists(scene, VectorXd::Random(6 * scene.bodies.size()), {Vec3(0.3, -1, 0.5)});
        scene.integrator.step(int(round(0.8 / h)));
        return Snapshot(scene);
    };
    const auto distance = [](const Snapshot& a, const Snapshot& b) {
        double sum = 0;
        for (size_t i = 0; i < a.x.size(); i++) sum += (a.x[i] - b.x[i]).dot(a.x[i] - b.x[i]);
        return sqrt(sum);
    };
    // All runs need the same start, so the generator of Eigen's Random is set each time.
    srand(1);
    const double steps[] = {0.02, 0.01, 0.005};
    const Snapshot fine = end(steps[2]);
    srand(1);
    const Snapshot coarse = end(steps[0]);
    srand(1);
    const Snapshot half = end(steps[1]);
    // The finest trajectory has an error of the same kind. Errors of order 2 have a ratio of 5
    // here, and those of order 1 would have 3, or 0.7 less as a logarithm.
    const auto differenceOf = [&](int i) { return pow(steps[i], 2) - pow(steps[2], 2); };
    EXPECT_NEAR(log2(distance(coarse, fine) / distance(half, fine)),
                log2(differenceOf(0) / differenceOf(1)), 0.15);
}

// ---- Only the effects the scene calls for ----

TEST_P(EveryModelWithMomenta, RandomNumbersAreCountedExactly) {
    FluidScene scene(0, 0.01);
    choose(scene, GetParam());
    addAllKinds(scene, GetParam().takesMultiblobs);
    scene.addFree(1, GetParam().takesFreeParticles ? 0.4 : 0, Vec3(-2, 0, 0));
    scene.addFree(1, 0, Vec3(-2, 2, 0));
    scene.start(testPlatform());
    scene.integrator.step(5);
    EXPECT_EQ(counter(scene, "randomNumbers"), 0);
    EXPECT_EQ(counter(scene, "squareRoots"), 0);
    scene.integrator.setTemperature(T1);
    scene.integrator.step(3);
    // Two spheres and the boomerang take 6 numbers each, the linear sphere and the rod 5, the point
    // and the free particles 3.
    const int perStep = 2 * 6 + 5 + 3 + 3 + 3 + (GetParam().takesMultiblobs ? 11 : 0);
    EXPECT_EQ(counter(scene, "randomNumbers"), 3 * perStep);
    scene.integrator.setFriction(0);  // of the particle that the fluid does not see
    scene.integrator.step(1);
    EXPECT_EQ(counter(scene, "randomNumbers"),
              4 * perStep - (GetParam().takesFreeParticles ? 3 : 6));
    EXPECT_EQ(counter(scene, "forceEvaluations"), counter(scene, "steps") + 1);
}

TEST(LangevinHI, MatricesAreMadeOnlyWhereNeeded) {
    const auto products = [](FluidScene& scene) {
        scene.start(testPlatform());
        scene.integrator.step(1);
        const double before = counter(scene, "mobilityProducts");
        scene.integrator.step(10);
        return counter(scene, "mobilityProducts") - before;
    };
    FluidScene spheres(T1), alone(T1), pair(T1), multiblobs(T1), one(T1);
    spheres.fluid->setModel(MobilityForce::FreeDraining);
    for (int b = 0; b < 3; b++) spheres.add(sphereKind(0.5), Vec3(2 * b, 0, 0));
    EXPECT_EQ(products(spheres), 0);
    EXPECT_EQ(counter(spheres, "squareRoots"), 0);
    alone.add(boomerangKind());
    EXPECT_EQ(products(alone), 0);
    one.add(sphereKind(0.5));
    EXPECT_EQ(products(one), 0);
    EXPECT_EQ(counter(one, "squareRoots"), 0);
    multiblobs.fluid->setModel(MobilityForce::FreeDraining);
    for (int b = 0; b < 3; b++) multiblobs.add(boomerangKind(), Vec3(4 * b, 0, 0));
    EXPECT_EQ(products(multiblobs), 0);
    for (int b = 0; b < 2; b++) pair.add(sphereKind(0.5), Vec3(2 * b, 0, 0));
    pair.fluid->setSolver(MobilityForce::Dense);
    EXPECT_EQ(products(pair), 10);
    EXPECT_EQ(counter(pair, "squareRoots"), 11);
}

TEST_P(EveryModelWithMomenta, ReferenceAndCpuTakeTheSameStep) {
    if (!onCpu()) GTEST_SKIP() << "the program of the platform CPU compares the two";
    vector<Snapshot> ends;
    for (const char* name : {"Reference", "CPU"}) {
        FluidScene scene(T1, 0.01);
        choose(scene, GetParam());
        addAllKinds(scene, GetParam().takesMultiblobs);
        scene.addFree(1, GetParam().takesFreeParticles ? 0.4 : 0, Vec3(-2, 0, 0));
        scene.addFree(1, 0, Vec3(-2, 2, 0));
        addField(scene.system, "x^2+y^2+z^2+x*y");
        scene.start(platform(name), 2);
        scene.context->setVelocitiesToTemperature(T1, 3);
        scene.integrator.step(1);
        ends.emplace_back(scene);
    }
    ends[0].expectNear(ends[1], 1e-11, GetParam().name);
}

// ---- Resuming and changing ----

TEST_P(EveryModelWithMomenta, ResumesBitForBit) {
    const auto make = [&](FluidScene& scene, bool start) {
        choose(scene, GetParam());
        addAllKinds(scene, GetParam().takesMultiblobs);
        addAllKinds(scene, false, Vec3(0, 0, 7));
        scene.addFree(1, GetParam().takesFreeParticles ? 0.4 : 0, Vec3(-2, 0, 0));
        scene.addFree(1, 0, Vec3(-2, 2, 0));
        vector<int> groups(scene.bodies.size(), 1);
        groups[0] = groups[2] = 0;
        groups.back() = 4;  // alone
        scene.fluid->setGroups(groups);
        addField(scene.system, "x^2+y^2+z^2+x*y");
        if (start) {
            scene.start(testPlatform(), 2);
            scene.context->setVelocitiesToTemperature(T1, 3);
            return;
        }
        if (scene.isPeriodic()) scene.bind();
        scene.context = make_unique<Context>(scene.system, scene.integrator, testPlatform(),
                                             threads(testPlatformName(), 1));
    };
    FluidScene once(T1, 0.02), twice(T1, 0.02), third(T1, 0.02), fourth(T1, 0.02);
    make(once, true);
    make(twice, true);
    once.integrator.step(8);
    twice.integrator.step(4);
    twice.mobility();  // reading the state changes nothing
    twice.friction();
    twice.context->getState(State::Energy | State::Forces);
    stringstream checkpoint, xml;
    twice.context->createCheckpoint(checkpoint);
    const State state = twice.context->getState(State::Positions | State::Velocities |
                                                State::Parameters | State::IntegratorParameters);
    XmlSerializer::serialize<State>(&state, "State", xml);
    twice.integrator.step(4);
    Snapshot(once).expectSameBits(Snapshot(twice), "step(8) and twice step(4)");
    make(third, false);
    third.context->loadCheckpoint(checkpoint);
    third.integrator.step(4);
    Snapshot(once).expectSameBits(Snapshot(third), "checkpoint");
    unique_ptr<State> copy(XmlSerializer::deserialize<State>(xml));
    make(fourth, true);
    fourth.integrator.step(3);
    fourth.context->setState(*copy);
    fourth.integrator.step(4);
    Snapshot(once).expectSameBits(Snapshot(fourth), "State from XML");
}

TEST_P(EveryModelWithMomenta, ChangedParametersActFromTheNextStepOn) {
    FluidScene changed(T1, 0.02), started(T1, 0.02);
    stringstream checkpoint;
    for (FluidScene* scene : {&changed, &started}) {
        choose(*scene, GetParam());
        addAllKinds(*scene, GetParam().takesMultiblobs);
        addField(scene->system, "x^2+y^2+z^2+x*y");
        if (scene == &started) scene->fluid->setViscosity(1.2);
        scene->start(testPlatform());
    }
    changed.integrator.step(5);
    changed.context->createCheckpoint(checkpoint);
    const double before = counter(changed, "mobilityProducts");
    changed.fluid->setViscosity(1.2);
    changed.fluid->updateParametersInContext(*changed.context);
    EXPECT_GE(counter(changed, "mobilityProducts"), before);
    changed.integrator.step(5);
    started.context->loadCheckpoint(checkpoint);
    started.integrator.step(5);
    Snapshot(changed).expectSameBits(Snapshot(started), "viscosity");
}

TEST(LangevinHI, SchemesChangeWhereTheSystemAllows) {
    FluidScene scene(T1, 0.01), dry(T1, 0.01);
    scene.add(sphereKind(0.5));
    scene.start(testPlatform());
    scene.integrator.step(2);
    scene.integrator.setScheme(CustomRigidHIIntegrator::LangevinC);
    expectError([&] { scene.integrator.step(1); },
                {"the System has a MobilityForce", "LangevinC", "use LangevinHI"});
    scene.integrator.setScheme(CustomRigidHIIntegrator::LangevinHI);
    scene.integrator.step(2);
    dry.add(sphereKind(0.5));
    dry.removeFluid();
    dry.integrator.setScheme(CustomRigidHIIntegrator::LangevinC);
    dry.start(testPlatform());
    dry.integrator.step(2);
    dry.integrator.setScheme(CustomRigidHIIntegrator::LangevinHI);
    expectError([&] { dry.integrator.step(1); },
                {"0 MobilityForces", "LangevinHI", "add a MobilityForce"});
    dry.integrator.setScheme(CustomRigidHIIntegrator::LangevinC);
    dry.integrator.step(2);
}
