// The scheme LangevinHI is compared with Langevin C where the friction is constant, with linear
// theory in one step, and with closed forms in equilibrium. Further tests are of its order, its
// counters, and hard cases. Units have kT = 1 unless said otherwise.

#include <openmm/CustomExternalForce.h>
#include <openmm/VirtualSite.h>
#include <openmm/serialization/XmlSerializer.h>

#include <sstream>

#include "HydrodynamicSupport.h"

using namespace OpenMM;
using namespace RigidHITest;
using namespace std;

namespace {

const double T1 = 1 / boltzmann;  // the temperature with kT = 1

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
    {"ForceCouplingPeriodic", MobilityForce::ForceCoupling, MobilityForce::Periodic, false, false}};
void choose(FluidScene& scene, const ModelCase& model) {
    scene.fluid->setModel(model.model);
    scene.fluid->setBoundary(model.boundary);
    scene.fluid->setWallHeight(-2.1);  // just below all of addAllKinds()
    scene.fluid->setSphereWallMobility(model.sphereWall);
}

class EveryModel : public testing::TestWithParam<ModelCase> {};
INSTANTIATE_TEST_SUITE_P(LangevinHI, EveryModel, testing::ValuesIn(models),
                         [](const testing::TestParamInfo<ModelCase>& info) {
                             return info.param.name;
                         });

/** A force on every particle from an energy of x, y, z. */
void addField(System& system, const string& energy) {
    auto* field = new CustomExternalForce(energy);
    for (int i = 0; i < system.getNumParticles(); i++)
        if (!system.isVirtualSite(i)) field->addParticle(i, vector<double>());
    system.addForce(field);
}

/** A sphere about its origin with any inertia. A field turns the sphere by its marker. */
BodyKind markedSphere(double radius, double mass, const Vec3& moments) {
    return {"marked sphere", mass, moments, {Vec3(), Vec3(0.1, 0.15, 0.7)}, {radius, 0}};
}
BodyKind linearSphere(double radius, double mass, double moment) {
    return {"linear sphere", mass, Vec3(moment, moment, 0), {Vec3(), Vec3(0, 0, 0.6)}, {radius, 0}};
}
BodyKind pointKind(double radius, double mass) {
    return {"point", mass, Vec3(), {Vec3()}, {radius}};
}

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

struct Snapshot {
    vector<Vec3> x, v, R, V, omega;
    vector<QuaternionArray> q;
    explicit Snapshot(FluidScene& scene) {
        x = positionsOf(*scene.context);
        v = velocitiesOf(*scene.context);
        R = scene.integrator.getBodyPositions();
        V = scene.integrator.getBodyVelocities();
        omega = scene.integrator.getBodyAngularVelocities();
        q = scene.integrator.getBodyOrientations();
    }
    void expectSameBits(const Snapshot& other, const string& what) const {
        EXPECT_TRUE(sameBits(x, other.x) && sameBits(v, other.v)) << what << ": particles";
        EXPECT_TRUE(sameBits(R, other.R) && sameBits(V, other.V) && sameBits(omega, other.omega))
            << what;
        EXPECT_EQ(q, other.q) << what;
    }
    void expectNear(const Snapshot& other, double tolerance, const string& what) const {
        double worst = 0;
        for (size_t i = 0; i < x.size(); i++)
            worst = max(worst, max(norm(x[i] - other.x[i]), norm(v[i] - other.v[i])));
        for (size_t b = 0; b < R.size(); b++) {
            worst = max(worst, norm(omega[b] - other.omega[b]));
            for (int k = 0; k < 4; k++) worst = max(worst, abs(q[b][k] - other.q[b][k]));
        }
        EXPECT_LT(worst, tolerance) << what;
    }
};

/** Give every body and free particle a velocity, every body an angular velocity. */
void setTwists(FluidScene& scene, const VectorXd& twists, const vector<Vec3>& freeVelocities = {}) {
    vector<Vec3> V, omega;
    for (size_t b = 0; b < scene.bodies.size(); b++) {
        V.push_back(toVec3(twists.segment<3>(6 * b)));
        omega.push_back(toVec3(twists.segment<3>(6 * b + 3)));
    }
    if (!freeVelocities.empty()) {
        vector<Vec3> v(scene.positions.size());
        for (size_t i = 0; i < scene.freeParticles.size(); i++)
            v[scene.freeParticles[i]] = freeVelocities[i];
        scene.context->setVelocities(v);
    }
    scene.integrator.setBodyVelocities(V);
    scene.integrator.setBodyAngularVelocities(omega);
}
VectorXd twistsOf(FluidScene& scene) {
    const auto V = scene.integrator.getBodyVelocities(),
               omega = scene.integrator.getBodyAngularVelocities();
    const auto v = velocitiesOf(*scene.context);
    VectorXd result(6 * V.size() + 3 * scene.freeParticles.size());
    for (size_t b = 0; b < V.size(); b++)
        result.segment<6>(6 * b) << toEigen(V[b]), toEigen(omega[b]);
    for (size_t i = 0; i < scene.freeParticles.size(); i++)
        result.segment<3>(6 * V.size() + 3 * i) = toEigen(v[scene.freeParticles[i]]);
    return result;
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

TEST_P(EveryModel, OneStepResponseIsTheExponentialOfFrictionOverInertia) {
    for (bool free : {false, true})
        for (double h : {1e-4, 0.05, 1.0}) {
            if (free && !GetParam().takesFreeParticles) continue;
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
    const vector<vector<BodyKind> > scenes = {
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

TEST_P(EveryModel, OneStepNoiseHasTheCovarianceOfTheory) {
    // Steps start from rest, at a temperature so small that bodies hardly move. The exact
    // covariance is <V V^T> = kT (I^-1 - E I^-1 E^T), with E the response. The theory is used to
    // make the samples white. Entry (i, k) of their covariance then has the error sqrt((1 +
    // delta_ik)/n).
    const double smallT = 1e-12 * T1;
    for (double h : {0.01, 0.5}) {
        FluidScene scene(smallT, h);
        choose(scene, GetParam());
        addAllKinds(scene, GetParam().takesMultiblobs);
        if (GetParam().takesFreeParticles) scene.addFree(1.3, 0.35, Vec3(-2, 1, 1));
        scene.start(testPlatform());
        const MatrixXd inverse = inverseInertia(scene), friction = fullFriction(scene, GetParam());
        const MatrixXd E = exponential(-h * inverse * friction);
        const MatrixXd covariance = inverse - E * inverse * E.transpose();
        const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(covariance);
        // Steps with lattice sums take longer. Their noise is made like that of other dense
        // matrices.
        const int rows = covariance.rows(), n = scene.isPeriodic() ? 300 : 3000;
        int dead = 0;
        while (eigen.eigenvalues()[dead] < 1e-10 * eigen.eigenvalues()[rows - 1]) dead++;
        EXPECT_EQ(dead, GetParam().takesMultiblobs ? 5 : 4);  // two linear bodies or one, a point
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

TEST_P(EveryModel, TrajectoriesConvergeWithOrderTwo) {
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
    const Snapshot fine = end(0.0005);
    srand(1);
    const Snapshot coarse = end(0.02);
    srand(1);
    const Snapshot half = end(0.01);
    EXPECT_NEAR(log2(distance(coarse, fine) / distance(half, fine)), 2.0, 0.15);
}

// ---- Equilibrium ----

namespace {

/** Replicas of a scene, each in a group of its own. Traps hold the origins, and fields act on the
 * markers. */
struct Replicas {
    FluidScene scene;
    CustomExternalForce* trap = new CustomExternalForce("0.5*k*((x-x0)^2+y^2+z^2)");
    CustomExternalForce* field = new CustomExternalForce("-charge*z");
    vector<int> groups;
    Replicas(double temperature, double h) : scene(temperature, h) {
        trap->addPerParticleParameter("k");
        trap->addPerParticleParameter("x0");
        field->addPerParticleParameter("charge");
        scene.system.addForce(trap);
        scene.system.addForce(field);
    }
    /** A body whose last three sites must be its origin and a pair of opposite markers. */
    void add(const BodyKind& kind, int group, double x0, double k, double charge,
             const QuaternionArray& q) {
        scene.add(kind, Vec3(x0, 0, 0), q);
        const vector<int>& p = scene.particles.back();
        const int n = p.size();
        trap->addParticle(p[n - 3], {k, x0});
        field->addParticle(p[n - 2], {charge});
        field->addParticle(p[n - 1], {-charge});
        groups.push_back(group);
    }
    void start() {
        scene.fluid->setGroups(groups);
        scene.start(testPlatform());
        scene.context->setVelocitiesToTemperature(scene.integrator.getTemperature(), 3);
    }
};

/** The boomerang with an origin and two markers along a direction that is no principal axis. */
const Vec3 markerDirection(0.6, 0.48, 0.64);
BodyKind heldBoomerang() {
    BodyKind kind = boomerangKind();
    kind.sites.insert(kind.sites.end(), {Vec3(), markerDirection, markerDirection * -1});
    kind.radii.insert(kind.radii.end(), {0, 0, 0});
    return kind;
}
BodyKind heldSphere(double radius, double mass, const Vec3& moments) {
    return {"held sphere",
            mass,
            moments,
            {Vec3(), Vec3(), markerDirection, markerDirection * -1},
            {radius, 0, 0, 0}};
}

/** The mean and its error from the means of replicas, which are independent of each other. */
struct ByReplica {
    vector<double> sums;
    int count = 0;
    void add(const vector<double>& values) {
        sums.resize(values.size());
        for (size_t i = 0; i < values.size(); i++) sums[i] += values[i];
        count++;
    }
    Estimate result() const {
        vector<double> means;
        for (double s : sums) means.push_back(s / count);
        return estimate(means);
    }
};

}  // namespace

TEST(LangevinHI, EquilibriumUnderStrongCouplingOfTranslationAndRotation) {
    // A boomerang whose centre of mass is far from the middle of its blobs, alone and with a
    // neighbour in the same group. The trap, the field and the moments determine its distribution,
    // not the friction.
    const double k = 3, charge = 1, h = 0.04;
    for (bool neighbour : {false, true}) {
        Replicas replicas(T1, h);
        replicas.scene.fluid->setViscosity(0.2);
        mt19937 random(7);
        const int copies = neighbour ? 60 : 200;
        for (int i = 0; i < copies; i++) {
            replicas.add(heldBoomerang(), i, 5 * i, k, charge, randomQuaternion(random));
            if (neighbour)
                replicas.add(heldSphere(0.8, 2, Vec3(0.5, 0.9, 0.7)), i, 5 * i + 2, k, charge,
                             randomQuaternion(random));
        }
        replicas.start();
        replicas.scene.integrator.step(400);
        const int perCopy = neighbour ? 2 : 1;
        map<string, ByReplica> sums;
        map<string, double> expected;
        const int samples = neighbour ? 60 : 80;
        for (int s = 0; s < samples; s++) {
            replicas.scene.integrator.step(20);
            const Snapshot now(replicas.scene);
            map<string, vector<double> > values;
            for (size_t b = 0; b < now.R.size(); b++) {
                const BodyKind& kind = replicas.scene.bodies[b];
                const string body = b % perCopy == 0 ? "boomerang " : "sphere ";
                const Vec3 x = now.R[b] - Vec3(5.0 * (b / perCopy) + 2.0 * (b % perCopy), 0, 0);
                const Vector3d omega = rotationOf(now.q[b]).transpose() * toEigen(now.omega[b]);
                const string axes = "xyz";
                for (int c = 0; c < 3; c++) {
                    values[body + "k " + axes[c] + "^2"].push_back(k * x[c] * x[c]);
                    expected[body + "k " + axes[c] + "^2"] = 1;
                    values[body + "I omega^2 of " + axes[c]].push_back(kind.moments[c] * omega[c] *
                                                                       omega[c]);
                    values[body + "m v^2 of " + axes[c]].push_back(kind.mass * now.V[b][c] *
                                                                   now.V[b][c]);
                    // As in Langevin C the kinetic energy has a bias of -h^2 w^2/4, which is below
                    // 2e-3 here.
                    expected[body + "I omega^2 of " + axes[c]] = 1;
                    expected[body + "m v^2 of " + axes[c]] = 1 - h * h * k / kind.mass / 4;
                    values[body + "x v of " + axes[c]].push_back(x[c] * now.V[b][c]);
                    expected[body + "x v of " + axes[c]] = 0;
                }
                values[body + "n_z"].push_back(rotate(now.q[b], markerDirection)[2]);
                expected[body + "n_z"] = 1 / tanh(2 * charge) - 1 / (2 * charge);
                values[body + "omega_x v_y"].push_back(omega[0] * now.V[b][1]);
                expected[body + "omega_x v_y"] = 0;
            }
            if (neighbour)
                for (int c = 0; c < 3; c++)
                    for (size_t b = 0; b < now.R.size(); b += 2) {
                        const Vec3 home(5.0 * (b / 2), 0, 0);
                        values["x1 x2 of " + to_string(c)].push_back(
                            (now.R[b] - home)[c] * (now.R[b + 1] - home - Vec3(2, 0, 0))[c]);
                        values["v1 v2 of " + to_string(c)].push_back(now.V[b][c] * now.V[b + 1][c]);
                        expected["x1 x2 of " + to_string(c)] =
                            expected["v1 v2 of " + to_string(c)] = 0;
                    }
            for (const auto& value : values) sums[value.first].add(value.second);
        }
        for (const auto& sum : sums)
            expectMean(sum.first, sum.second.result(), expected.at(sum.first));
    }
}

TEST(LangevinHI, StaticCovariancesOfTwoTrappedSpheres) {
    // Spheres that touch and overlap under RPY: friction varies strongly, but the Gibbs
    // distribution does not depend on it.
    const double k = 2, h = 0.1;
    Replicas replicas(T1, h);
    mt19937 random(3);
    for (int i = 0; i < 120; i++)
        for (int b = 0; b < 2; b++)
            replicas.add(heldSphere(0.5, 1, Vec3(0.1, 0.1, 0.1)), i, b, k, 0,
                         randomQuaternion(random));
    replicas.start();
    replicas.scene.integrator.step(100);
    ByReplica xx[3], cross[3], vv[3];
    for (int s = 0; s < 60; s++) {
        replicas.scene.integrator.step(15);
        const Snapshot now(replicas.scene);
        for (int c = 0; c < 3; c++) {
            vector<double> a, b, v;
            for (size_t i = 0; i < now.R.size(); i += 2) {
                const Vec3 x1 = now.R[i], x2 = now.R[i + 1] - Vec3(1, 0, 0);
                a.push_back(k * (x1[c] * x1[c] + x2[c] * x2[c]) / 2);
                b.push_back(k * x1[c] * x2[c]);
                v.push_back(now.V[i][c] * now.V[i + 1][c]);
            }
            xx[c].add(a);
            cross[c].add(b);
            vv[c].add(v);
        }
    }
    for (int c = 0; c < 3; c++) {
        expectMean("k x^2/kT", xx[c].result(), 1);
        expectMean("k x1 x2/kT", cross[c].result(), 0);
        expectMean("v1 v2", vv[c].result(), 0);
    }
}

TEST(LangevinHI, DiffusionIsTheTemperatureTimesMobility) {
    // The mean square displacement of the mobility centre, where coupling is symmetric, is linear
    // in time once inertia is forgotten: 2 kT tr mu_tt t (Cichocki, Ekiel-Jezewska, Wajnryb, J.
    // Chem. Phys. 136, 071102, 2012).
    FluidScene scene(T1, 0.01);
    scene.fluid->setModel(MobilityForce::FreeDraining);
    const int copies = 1500;
    mt19937 random(1);
    BodyKind light = boomerangKind();
    light.mass = 1;
    light.moments *= 0.3;
    for (int i = 0; i < copies; i++) scene.add(light, Vec3(), randomQuaternion(random));
    scene.start(testPlatform());
    LabBody home;
    for (size_t i = 0; i < light.sites.size(); i++) {
        home.offsets.push_back(toEigen(light.sites[i]));
        home.radii.push_back(light.radii[i]);
    }
    const auto mobilityAbout = [&](const Vector3d& point) {
        LabBody moved = home;
        for (Vector3d& x : moved.offsets) x -= point;
        return IndependentMobility({moved}, 0.6).mobility;
    };
    // The antisymmetric part of mu_rt is linear in the point, which gives three equations.
    const auto antisymmetric = [&](const Vector3d& point) {
        const Matrix3d b = mobilityAbout(point).bottomLeftCorner(3, 3);
        return Vector3d(b(1, 2) - b(2, 1), b(2, 0) - b(0, 2), b(0, 1) - b(1, 0));
    };
    const Vector3d zero = antisymmetric(Vector3d::Zero());
    Matrix3d slope;
    for (int k = 0; k < 3; k++) slope.col(k) = antisymmetric(Vector3d::Unit(k)) - zero;
    const Vector3d centre = -slope.inverse() * zero;
    ASSERT_LT(antisymmetric(centre).norm(), 1e-12);
    const double expected = 2 * mobilityAbout(centre).topLeftCorner(3, 3).trace();

    const auto centres = [&] {
        const auto R = scene.integrator.getBodyPositions();
        const auto q = scene.integrator.getBodyOrientations();
        vector<Vec3> result;
        for (int i = 0; i < copies; i++) result.push_back(R[i] + rotate(q[i], toVec3(centre)));
        return result;
    };
    const auto start = centres();
    scene.integrator.step(100);
    const auto early = centres();
    scene.integrator.step(500);
    const auto late = centres();
    vector<double> slopes;
    for (int i = 0; i < copies; i++) {
        const Vec3 a = early[i] - start[i], b = late[i] - start[i];
        slopes.push_back((b.dot(b) - a.dot(a)) / 5.0);
    }
    expectMean("d<r^2>/dt", estimate(slopes), expected);
}

TEST(LangevinHI, TemperatureAtAnyFriction) {
    for (double frictionOverMass : {1e-6, 1.0, 1e6}) {
        FluidScene scene(T1, 0.01);
        const int pairs = 60;
        const double mass = 6 * M_PI * 0.6 * 0.5 / frictionOverMass;
        vector<int> groups;
        for (int i = 0; i < pairs; i++)
            for (int b = 0; b < 2; b++) {
                scene.add(markedSphere(0.5, mass, Vec3(0.2, 0.2, 0.2) * mass),
                          Vec3(3 * i + 1.2 * b, 0, 0));
                groups.push_back(i);
            }
        scene.fluid->setGroups(groups);
        scene.start(testPlatform());
        scene.context->setVelocitiesToTemperature(T1, 2);
        const double start = scene.integrator.computeTranslationalKineticEnergy();
        vector<double> translational, rotational[3];
        scene.integrator.step(10);
        for (int s = 0; s < 40; s++) {
            scene.integrator.step(3);
            translational.push_back(scene.integrator.computeTranslationalKineticEnergy());
            for (int k = 0; k < 3; k++)
                rotational[k].push_back(scene.integrator.computeRotationalKineticEnergies()[k]);
        }
        const double bodies = 2 * pairs;
        if (frictionOverMass < 1e-3) {
            // 130 steps of 0.01 at this friction change the energy by less than 2e-6, and noise by
            // less than the root of that.
            for (double e : translational) ASSERT_NEAR(e / start, 1, 0.01);
            continue;
        }
        // With strong friction every sample is independent. With a friction of 1/ps the relaxation
        // time is 100 steps.
        const double independent = frictionOverMass > 1e3 ? 40 : 1;
        expectMean(
            "translation at " + to_string(frictionOverMass),
            {estimate(translational).mean / (1.5 * bodies), sqrt(2 / (3 * bodies * independent))},
            1);
        for (int k = 0; k < 3; k++)
            expectMean(
                "axis " + to_string(k),
                {estimate(rotational[k]).mean / (0.5 * bodies), sqrt(2 / (bodies * independent))},
                1);
    }
}

TEST(LangevinHI, WeakFrictionKeepsEnergy) {
    // At T = 0 and friction/mass 1e-6 a free flight loses 2 gamma t of its energy. Rounding adds no
    // loss.
    const double mass = 6 * M_PI * 0.6 * 0.5 * 1e6;
    FluidScene scene(0, 0.01);
    for (int b = 0; b < 2; b++) scene.add(sphereKind(0.5, mass, 0.1 * mass), Vec3(1.2 * b, 0, 0));
    scene.start(testPlatform());
    VectorXd twists = VectorXd::Zero(12);
    twists[1] = twists[7] = 1e-3;  // together, so that they keep their distance
    setTwists(scene, twists);
    const double start = scene.integrator.computeTranslationalKineticEnergy();
    scene.integrator.step(2000);
    VectorXd together = VectorXd::Zero(12);
    together[1] = together[7] = 1 / sqrt(2.0);
    const double drag = together.dot(scene.expected().friction * together);
    EXPECT_NEAR(
        log(scene.integrator.computeTranslationalKineticEnergy() / start) / (-2 * drag / mass * 20),
        1, 1e-5);
}

// ---- Only the effects the scene calls for ----

namespace {

double counter(FluidScene& scene, const string& name) {
    return scene.integrator.getStepStatistics().at(name);
}

}  // namespace

TEST_P(EveryModel, RandomNumbersAreCountedExactly) {
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

// ---- Company ----

TEST(LangevinHI, FreeParticlesThatTheFluidDoesNotSeeFeelLangevinC) {
    // The free particles are beside bodies that feel each other, and beside free particles that the
    // fluid sees.
    FluidScene hydrodynamic(T1, 0.02), plain(T1, 0.02);
    for (FluidScene* scene : {&hydrodynamic, &plain}) {
        for (int b = 0; b < 2; b++) scene->add(sphereKind(0.5), Vec3(2 * b, 0, 0));
        scene->addFree(1, 0.3, Vec3(0, 3, 0));
        for (int i = 0; i < 3; i++) scene->addFree(2, 0, Vec3(i, 5, 0));
        // A molecule with a constraint.
        for (int i = 0; i < 2; i++) scene->addFree(2, 0, Vec3(0.5 * i, 7, 0));
        scene->system.addConstraint(scene->freeParticles[4], scene->freeParticles[5], 0.5);
        scene->integrator.setFriction(3);
        addField(scene->system, "x^2+y^2+z^2");
    }
    plain.removeFluid();
    plain.integrator.setScheme(CustomRigidHIIntegrator::LangevinC);
    vector<vector<Vec3> > x;
    for (FluidScene* scene : {&hydrodynamic, &plain}) {
        scene->start(testPlatform());
        scene->integrator.step(30);
        x.push_back(positionsOf(*scene->context));
    }
    for (size_t i = 1; i < hydrodynamic.freeParticles.size(); i++) {
        const int p = hydrodynamic.freeParticles[i];
        EXPECT_LT(norm(x[0][p] - x[1][p]), 1e-12) << p;
    }
    EXPECT_GT(norm(x[0][hydrodynamic.freeParticles[0]] - x[1][hydrodynamic.freeParticles[0]]),
              1e-3);
}

TEST(LangevinHI, FreeParticlesBelongToGroupZero) {
    vector<Snapshot> ends;
    for (const vector<int>& groups : {vector<int>(), vector<int>{0}, vector<int>{1}}) {
        FluidScene scene(T1, 0.02);
        scene.add(boomerangKind(), Vec3(-2, 0, 0));
        scene.addFree(1.5, 0.5, Vec3());
        scene.addFree(1.5, 0.4, Vec3(1.1, 0.2, 0));
        scene.fluid->setGroups(groups);
        addField(scene.system, "z+0.3*x*y");
        scene.start(testPlatform());
        scene.integrator.step(20);
        ends.emplace_back(scene);
    }
    ends[0].expectSameBits(ends[1], "group 0 is where free particles are");
    EXPECT_GT(norm(ends[0].x[5] - ends[2].x[5]), 1e-4);
}

TEST(LangevinHI, VirtualSitesFollowTheirBodies) {
    System system;
    CustomRigidHIIntegrator integrator(300, 0.002);
    auto* fluid = new MobilityForce();
    vector<Vec3> positions;
    const Shape water = waterShape();
    for (int b = 0; b < 3; b++) {
        vector<int> particles;
        for (int i = 0; i < 3; i++) {
            particles.push_back(system.addParticle(water.masses[i]));
            positions.push_back(water.sites[i] + Vec3(0.4 * b, 0, 0));
            fluid->addParticle(i == 0 ? 0 : 0.05);
        }
        particles.push_back(system.addParticle(0));
        system.setVirtualSite(
            particles[3],
            new ThreeParticleAverageSite(particles[0], particles[1], particles[2], 0.6, 0.2, 0.2));
        positions.push_back(Vec3());
        fluid->addParticle(0.14);
        integrator.addRigidBody(particles);
    }
    system.addForce(fluid);
    addField(system, "x^2+y^2+z^2");
    integrator.setScheme(CustomRigidHIIntegrator::LangevinHI);
    Context context(system, integrator, testPlatform());
    context.setPositions(positions);
    context.computeVirtualSites();
    integrator.step(100);
    const auto x = positionsOf(context);
    for (int b = 0; b < 3; b++) {
        const Vec3* p = &x[4 * b];
        EXPECT_LT(norm(p[3] - p[0] * 0.6 - p[1] * 0.2 - p[2] * 0.2), readTolerance(1e-12, 1));
        EXPECT_NEAR(norm(p[1] - p[0]), 0.09572, readTolerance(1e-12, 1));
    }
}

TEST(LangevinHI, ReplicasDoNotFeelEachOther) {
    // The motion of a replica depends, bit for bit, neither on where the others are nor on how many
    // there are.
    const auto run = [](double apart, int replicas, int threadCount) {
        FluidScene scene(T1, 0.02);
        vector<int> groups;
        mt19937 random(2);
        for (int r = 0; r < replicas; r++) {
            scene.add(boomerangKind(), Vec3(r * apart, 0, 0), {{1, 0, 0, 0}});
            scene.add(sphereKind(0.5), Vec3(r * apart + 2.5, 0, 0));
            groups.insert(groups.end(), {r, r});
        }
        scene.fluid->setGroups(groups);
        scene.start(testPlatform(), threadCount);
        scene.integrator.step(15);
        return Snapshot(scene);
    };
    const Snapshot alone = run(0, 1, 1);
    for (const Snapshot& other : {run(0.3, 2, 1), run(1e4, 2, 1), run(3, 5, 2)})
        for (int b = 0; b < 2; b++) {
            EXPECT_EQ(memcmp(&alone.R[b], &other.R[b], sizeof(Vec3)), 0);
            EXPECT_EQ(memcmp(&alone.omega[b], &other.omega[b], sizeof(Vec3)), 0);
            EXPECT_EQ(alone.q[b], other.q[b]);
        }
}

TEST_P(EveryModel, ReferenceAndCpuTakeTheSameStep) {
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

TEST(LangevinHI, MatrixFreeIsDenseToFiveTimesTheTolerance) {
    // One step from the same state is compared, in the norm of mass-weighted momenta.
    double worst = 0;
    for (bool multiblobs : {false, true})
        for (double h : {1e-4, 0.03, 3.0})
            for (double temperature : {0.0, T1})
                for (double tolerance : {1e-3, 1e-6, 1e-9}) {
                    VectorXd Z[2];
                    for (bool matrixFree : {false, true}) {
                        FluidScene scene(temperature, h);
                        mt19937 random(5);
                        for (int b = 0; b < 12; b++) {
                            const Vec3 place(1.1 * (b % 3), 1.2 * (b / 3 % 2), 1.3 * (b / 6));
                            const BodyKind kind = !multiblobs  ? markedSphere(0.3 + 0.03 * b, 1 + b,
                                                                              Vec3(0.2, 0.3, 0.4))
                                                  : b % 3 == 0 ? boomerangKind()
                                                  : b % 3 == 1 ? rodKind()
                                                               : sphereKind(0.4);
                            scene.add(kind, place * (multiblobs ? 2.5 : 1),
                                      randomQuaternion(random));
                        }
                        scene.addFree(1.5, 0.4, Vec3(-1, -1, -1));
                        scene.fluid->setSolver(matrixFree ? MobilityForce::MatrixFree
                                                          : MobilityForce::Dense);
                        scene.fluid->setSolverTolerance(tolerance);
                        scene.start(testPlatform());
                        // Momenta are small, so that the rotation in the step has no visible
                        // effect.
                        VectorXd twists(72);
                        normal_distribution<double> normal(0, 1e-3);
                        for (double& x : twists) x = normal(random);
                        setTwists(scene, twists, {Vec3(1e-3, 0, 2e-3)});
                        scene.integrator.setTemperature(1e-6 * temperature);
                        scene.integrator.step(1);
                        const VectorXd end = twistsOf(scene);
                        const auto q = scene.integrator.getBodyOrientations();
                        Z[matrixFree] = end;
                        for (int b = 0; b < 12; b++) {
                            const BodyKind& kind = scene.bodies[b];
                            Z[matrixFree].segment<3>(6 * b) *= sqrt(kind.mass);
                            const Vector3d omega =
                                rotationOf(q[b]).transpose() * end.segment<3>(6 * b + 3);
                            for (int k = 0; k < 3; k++)
                                Z[matrixFree][6 * b + 3 + k] = sqrt(kind.moments[k]) * omega[k];
                        }
                        Z[matrixFree].tail<3>() *= sqrt(1.5);
                        EXPECT_EQ(counter(scene, "solverIterations") > 0, matrixFree);
                    }
                    // Where only decayed momenta are left, the error is relative to the norm of the
                    // start.
                    const double scale = max(Z[0].norm(), temperature == 0 ? 5e-3 : 0.0);
                    const double error = (Z[1] - Z[0]).norm() / scale / tolerance;
                    EXPECT_LT(error, 5) << "h = " << h << ", kT = " << temperature << ", tolerance "
                                        << tolerance << (multiblobs ? ", multiblobs" : ", spheres");
                    worst = max(worst, error);
                }
    cout << "largest difference, in tolerances: " << worst << endl;
}

TEST(LangevinHI, OneHundredBodies) {
    FluidScene scene(T1, 0.01);
    for (int b = 0; b < 100; b++) scene.add(sphereKind(0.4), Vec3(b % 5, b / 5 % 5, b / 25));
    scene.start(testPlatform(), 2);
    scene.context->setVelocitiesToTemperature(T1, 3);
    scene.integrator.step(3);
    EXPECT_TRUE(isfinite(scene.integrator.computeTranslationalKineticEnergy()));
    EXPECT_EQ(counter(scene, "randomNumbers"), 1800);
}

TEST(LangevinHI, FullFiveHundredBodies) {
    if (!onCpu()) GTEST_SKIP() << "3000 rows: on CPU only";
    FluidScene scene(T1, 0.01);
    for (int b = 0; b < 500; b++) scene.add(sphereKind(0.4), Vec3(b % 8, b / 8 % 8, b / 64));
    scene.start(testPlatform(), 2);
    scene.context->setVelocitiesToTemperature(T1, 3);
    scene.integrator.step(3);
    // The temperature is within 5 standard deviations of a mean over 1500 components.
    EXPECT_NEAR(scene.integrator.computeTranslationalKineticEnergy() / 750, 1,
                5 * sqrt(2.0 / 1500));
}

// ---- Resuming and changing ----

TEST_P(EveryModel, ResumesBitForBit) {
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
        scene.context.reset(new Context(scene.system, scene.integrator, testPlatform(),
                                        threads(testPlatformName(), 1)));
    };
    FluidScene once(T1, 0.02), twice(T1, 0.02), third(T1, 0.02), fourth(T1, 0.02);
    make(once, true);
    make(twice, true);
    once.integrator.step(20);
    twice.integrator.step(10);
    twice.mobility();  // reading the state changes nothing
    twice.friction();
    twice.context->getState(State::Energy | State::Forces);
    stringstream checkpoint, xml;
    twice.context->createCheckpoint(checkpoint);
    const State state = twice.context->getState(State::Positions | State::Velocities |
                                                State::Parameters | State::IntegratorParameters);
    XmlSerializer::serialize<State>(&state, "State", xml);
    twice.integrator.step(10);
    Snapshot(once).expectSameBits(Snapshot(twice), "step(20) and twice step(10)");
    make(third, false);
    third.context->loadCheckpoint(checkpoint);
    third.integrator.step(10);
    Snapshot(once).expectSameBits(Snapshot(third), "checkpoint");
    unique_ptr<State> copy(XmlSerializer::deserialize<State>(xml));
    make(fourth, true);
    fourth.integrator.step(3);
    fourth.context->setState(*copy);
    fourth.integrator.step(10);
    Snapshot(once).expectSameBits(Snapshot(fourth), "State from XML");
}

TEST_P(EveryModel, ChangedParametersActFromTheNextStepOn) {
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
