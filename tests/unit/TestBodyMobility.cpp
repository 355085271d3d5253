// The friction and the mobility of rigid multiblobs, spheres and free particles together agree with
// an independent dense computation.

#include "CoupledBodiesSupport.h"
#include "HydrodynamicSupport.h"
#include "TestSupport.h"
#include "mobility/models/rotneprager/RotnePragerYamakawa.h"

using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace std;

namespace {

const double eta = 0.7;

unique_ptr<MobilityModel> makeRpy(const HydrodynamicParticles& particles) {
    return make_unique<RotnePragerYamakawa>(particles, eta);
}

FluidElement element(const vector<Vector3d>& sites, const vector<double>& radii) {
    FluidElement e;
    e.body = 0;
    e.sites = sites;
    e.radii = radii;
    for (size_t i = 0; i < sites.size(); i++) e.particles.push_back(i);
    return e;
}
FluidElement freeParticle(double radius) {
    FluidElement e = element({Vector3d::Zero()}, {radius});
    e.body = -1;
    return e;
}

struct Named {
    string name;
    FluidElement element;
};
/** One of each kind of body. */
vector<Named> kinds() {
    return {
        {"boomerang",
         element({{0.1, 0, 0}, {1.3, 0.1, 0}, {2.2, -0.4, 0.3}, {0, 1.1, 0.2}, {-0.3, 2, 0.1}},
                 {0.7, 0.5, 0.6, 0.7, 0.4})},
        {"three blobs", element({{-1, 0, 0}, {1.2, 0.5, 0.3}, {0.2, -1.4, 1.1}}, {1, 1, 1})},
        {"sphere about its centre", element({{0, 0, 0}}, {0.8})},
        {"sphere off the body's origin", element({{0.3, -0.5, 0.9}}, {0.6})},
        {"dimer", element({{0, 0, -0.9}, {0, 0, 0.7}}, {0.8, 0.5})},
        {"rod along a skew line",
         element({{-1.2, 0.6, 0.6}, {0, 0, 0}, {0.8, -0.4, -0.4}, {2, -1, -1}},
                 {0.6, 0.5, 0.4, 0.7})},
        {"rod whose line misses the origin",
         element({{0.5, -1, 0.4}, {0.5, 0, 0.4}, {0.5, 1.3, 0.4}}, {0.5, 0.5, 0.6})},
        {"free particle", freeParticle(0.9)},
    };
}

struct Scene {
    vector<FluidElement> elements;
    vector<Pose> poses;
    /** Elements at random orientations in a cube. */
    Scene(const vector<FluidElement>& elements, double size, int seed) : elements(elements) {
        mt19937 random(seed);
        uniform_real_distribution<double> u(0, size);
        for (size_t e = 0; e < elements.size(); e++) {
            this->elements[e].body = elements[e].isFree() ? -1 : e;
            Pose pose;
            pose.R = Vector3d(u(random), u(random), u(random));
            const QuaternionArray q = randomQuaternion(random);
            pose.q = {q[0], q[1], q[2], q[3]};
            poses.push_back(pose);
        }
    }
    IndependentMobility expected() const {
        vector<LabBody> bodies;
        for (size_t e = 0; e < elements.size(); e++) {
            LabBody body;
            body.R = poses[e].R;
            body.radii = elements[e].radii;
            body.isFree = elements[e].isFree();
            for (const Vector3d& s : elements[e].sites)
                body.offsets.push_back(poses[e].rotation() * s);
            bodies.push_back(body);
        }
        return IndependentMobility(bodies, eta);
    }
    TestedBodies make(bool isConstant = true) const {
        TestedBodies result(elements, makeRpy, isConstant);
        result.setPoses(poses);
        return result;
    }
};

void expectSame(const string& name, TestedBodies& measured, const IndependentMobility& expected) {
    EXPECT_LT(difference(measured.friction(), expected.friction), 1e-12) << name;
    EXPECT_LT(difference(measured.mobility(), expected.mobility), 1e-11) << name;
    EXPECT_LT(difference(measured.mobility().transpose(), measured.mobility()), 1e-15) << name;
    EXPECT_LT(difference(measured.friction().transpose(), measured.friction()), 1e-15) << name;
    const MatrixXd wrenches = MatrixXd::Random(expected.mobility.rows(), 3);
    MatrixXd twists;
    measured.multiply(wrenches, twists);
    EXPECT_LT(difference(twists, expected.mobility * wrenches), 1e-11) << name;
}

/** Vertices of the icosahedron and of its subdivisions, on the unit sphere: 12, 42, 162. */
vector<Vector3d> icosphere(int subdivisions) {
    const double g = (1 + sqrt(5.0)) / 2;
    vector<Vector3d> vertices;
    for (double s : {-1.0, 1.0})
        for (double t : {-g, g}) {
            vertices.push_back(Vector3d(0, s, t).normalized());
            vertices.push_back(Vector3d(s, t, 0).normalized());
            vertices.push_back(Vector3d(t, 0, s).normalized());
        }
    // The faces are the triples of nearest neighbours. They remain so after subdivision, although
    // the edges at vertices with five and with six neighbours then differ a little in length.
    vector<array<int, 3>> faces;
    for (int i = 0; i < 12; i++)
        for (int j = 0; j < i; j++)
            for (int k = 0; k < j; k++) {
                const double edge = 1.06;
                if ((vertices[i] - vertices[j]).norm() < edge &&
                    (vertices[j] - vertices[k]).norm() < edge &&
                    (vertices[k] - vertices[i]).norm() < edge)
                    faces.push_back({{i, j, k}});
            }
    for (int level = 0; level < subdivisions; level++) {
        map<pair<int, int>, int> middle;
        const auto between = [&](int a, int b) {
            const auto key = make_pair(min(a, b), max(a, b));
            if (!middle.count(key)) {
                middle[key] = vertices.size();
                vertices.push_back((vertices[a] + vertices[b]).normalized());
            }
            return middle[key];
        };
        vector<array<int, 3>> finer;
        for (const auto& f : faces) {
            const int a = between(f[0], f[1]), b = between(f[1], f[2]), c = between(f[2], f[0]);
            finer.insert(finer.end(),
                         {{{f[0], a, c}}, {{f[1], b, a}}, {{f[2], c, b}}, {{a, b, c}}});
        }
        faces = finer;
    }
    return vertices;
}

}  // namespace

TEST(BodyMobility, OneBodyOfEachKind) {
    for (const Named& kind : kinds())
        for (bool constant : {false, true})
            for (int seed = 0; seed < 3; seed++) {
                const Scene scene({kind.element}, 5, seed);
                TestedBodies measured = scene.make(constant);
                EXPECT_EQ(measured->isConstantInBodyFrame(), constant && !kind.element.isFree());
                expectSame(kind.name + (constant ? ", constant" : ""), measured, scene.expected());
            }
}

TEST(BodyMobility, EachKindWithEachOther) {
    const auto all = kinds();
    for (const Named& a : all)
        for (const Named& b : all)
            for (int seed = 0; seed < 2; seed++) {
                const Scene scene({a.element, b.element}, 6, seed);
                TestedBodies measured = scene.make();
                expectSame(a.name + " with " + b.name, measured, scene.expected());
            }
}

TEST(BodyMobility, MixturesOfAllKinds) {
    vector<FluidElement> elements;
    for (const Named& kind : kinds()) {
        elements.push_back(kind.element);
        elements.insert(elements.begin(), kind.element);
    }
    for (int seed = 0; seed < 10; seed++) {
        const Scene scene(elements, 12, seed);
        TestedBodies measured = scene.make();
        expectSame("mixture " + to_string(seed), measured, scene.expected());
    }
}

TEST(BodyMobility, RowsFollowTheElements) {
    const auto all = kinds();
    vector<FluidElement> elements;
    for (const Named& kind : all) elements.push_back(kind.element);
    TestedBodies measured = Scene(elements, 5, 1).make();
    int row = 0;
    for (size_t e = 0; e < all.size(); e++) {
        EXPECT_EQ(measured->firstRow(e), row);
        row += all[e].element.numRows();
        EXPECT_EQ(measured->hasNullVector(e),
                  all[e].name.find("rod") == 0 || all[e].name == "dimer")
            << all[e].name;
    }
    EXPECT_EQ(measured->getNumRows(), row);
}

TEST(BodyMobility, NothingHoldsRodsAboutTheirLine) {
    for (const Named& kind : kinds()) {
        const Scene scene({kind.element, kinds()[0].element}, 6, 4);
        TestedBodies measured = scene.make();
        if (!measured->hasNullVector(0)) continue;
        const VectorXd null =
            twoRotations(scene.poses[0].rotation()) * measured->getNullVector_body(0);
        EXPECT_NEAR(null.norm(), 1, 1e-15);
        EXPECT_LT((measured.friction().leftCols(6) * null).norm(),
                  1e-13 * measured.friction().norm())
            << kind.name;
        // A torque about the line does not move the body, and no force or torque turns the body
        // about the line, wherever its origin is.
        VectorXd torque = null;
        torque.head(3).setZero();
        EXPECT_LT((measured.mobility().leftCols(6) * torque).norm(),
                  1e-13 * measured.mobility().norm())
            << kind.name;
        // N is a generalised inverse of xi: N xi N = N, xi N xi = xi.
        const MatrixXd &N = measured.mobility(), &xi = measured.friction();
        EXPECT_LT(difference(N * xi * N, N), 1e-12);
        EXPECT_LT(difference(xi * N * xi, xi), 1e-12);
    }
}

TEST(BodyMobility, ABodyTurnedAndMovedHasItsTensorTurnedOnly) {
    for (const Named& kind : kinds()) {
        if (kind.element.isFree()) continue;
        TestedBodies home({kind.element}, makeRpy, false), away({kind.element}, makeRpy, false);
        home.setPoses({Pose()});
        const Scene scene({kind.element}, 100, 9);
        away.setPoses(scene.poses);
        EXPECT_LT(difference(away.mobility(), turned(home.mobility(), scene.poses[0].rotation())),
                  1e-12)
            << kind.name;
    }
}

TEST(BodyMobility, PosesMayBeSetManyTimes) {
    vector<FluidElement> elements = {kinds()[0].element, kinds()[2].element, kinds()[4].element};
    for (bool one : {true, false}) {
        if (one) elements.resize(1);
        TestedBodies measured(elements, makeRpy, true);
        for (int seed = 0; seed < 3; seed++) {
            const Scene scene(elements, 7, seed);
            measured.setPoses(scene.poses);
            EXPECT_LT(difference(measured.mobility(), scene.expected().mobility), 1e-11);
            EXPECT_LT(difference(measured.friction(), scene.expected().friction), 1e-12);
        }
        elements = {kinds()[0].element, kinds()[2].element, kinds()[4].element};
    }
}

TEST(BodyMobility, MatricesAreMadeOncePerPose) {
    const Scene scene({kinds()[0].element, kinds()[2].element}, 7, 0);
    TestedBodies measured = scene.make();
    const long long before = measured.byMatrices().getCosts().matrices;
    measured.friction();
    measured.friction();
    measured.mobility();
    EXPECT_EQ(measured.byMatrices().getCosts().matrices - before, 1);
    measured.setPoses(scene.poses);
    measured.mobility();
    measured.friction();
    EXPECT_EQ(measured.byMatrices().getCosts().matrices - before, 2);
}

TEST(BodyMobility, ShellsHaveTheirHydrodynamicRadii) {
    // These values were computed independently, with a blob radius of half the smallest spacing and
    // a geometric radius of 1.
    const double translational[] = {1.262447, 1.122022, 1.052965},
                 rotational[] = {1.231345, 1.101902, 1.047197};
    for (int level = 0; level < 3; level++) {
        const vector<Vector3d> blobs = icosphere(level);
        ASSERT_EQ((int)blobs.size(), level == 0 ? 12 : level == 1 ? 42 : 162);
        double spacing = INFINITY;
        for (size_t i = 0; i < blobs.size(); i++)
            for (size_t k = 0; k < i; k++) spacing = min(spacing, (blobs[i] - blobs[k]).norm());
        TestedBodies shell({element(blobs, vector<double>(blobs.size(), spacing / 2))}, makeRpy,
                           true);
        shell.setPoses({Pose()});
        const MatrixXd& N = shell.mobility();
        EXPECT_NEAR(1 / (6 * M_PI * eta * N(0, 0)), translational[level], 1e-6);
        EXPECT_NEAR(cbrt(1 / (8 * M_PI * eta * N(3, 3))), rotational[level], 1e-6);
        MatrixXd isotropic = MatrixXd::Zero(6, 6);
        isotropic.diagonal() << N(0, 0), N(0, 0), N(0, 0), N(3, 3), N(3, 3), N(3, 3);
        EXPECT_LT(difference(N, isotropic), 1e-12);
    }
}

// ---- Own tensors ----

namespace {

MatrixXd squareRoot(const MatrixXd& m) {
    return Eigen::SelfAdjointEigenSolver<MatrixXd>(m).operatorSqrt();
}
MatrixXd inverseRoot(const MatrixXd& m) {
    return Eigen::SelfAdjointEigenSolver<MatrixXd>(m).operatorInverseSqrt();
}

/** Bodies of the kinds that take tensors of their own, the first `owners` with one. */
Scene ownTensorScene(int owners, double size, int seed) {
    vector<FluidElement> elements;
    for (const Named& kind : kinds())
        if (kind.name.find("rod") != 0 && kind.name != "dimer") elements.push_back(kind.element);
    for (int i = 0; i < owners; i++) elements[i].ownMobility = 0.05 * tensorWithoutSymmetry(i);
    return Scene(elements, size, seed);
}

}  // namespace

TEST(BodyMobility, OwnTensorsOfABodyAloneAreTaken) {
    for (const Named& kind : kinds()) {
        if (kind.element.isFree()) continue;
        FluidElement e = kind.element;
        e.ownMobility = tensorWithoutSymmetry(3);
        const Scene scene({e}, 4, 2);
        TestedBodies measured = scene.make();
        const MatrixXd expected = turned(e.ownMobility, scene.poses[0].rotation());
        EXPECT_LT(difference(measured.mobility(), expected), 1e-13) << kind.name;
        EXPECT_LT(difference(measured.friction(), expected.inverse()), 1e-12) << kind.name;
        MatrixXd twists;
        measured.multiply(MatrixXd::Identity(6, 6), twists);
        EXPECT_LT(difference(twists, expected), 1e-13) << kind.name;
    }
}

TEST(BodyMobility, OwnTensorsEnterByCongruence) {
    for (int owners : {1, 2, 4})
        for (int seed = 0; seed < 3; seed++) {
            Scene scene = ownTensorScene(owners, 8, seed);
            TestedBodies measured = scene.make();
            const MatrixXd model = scene.expected().mobility;
            MatrixXd B = MatrixXd::Identity(model.rows(), model.cols());
            for (int e = 0; e < owners; e++) {
                const int row = measured->firstRow(e);
                Scene alone({scene.elements[e]}, 1, 0);
                alone.poses = {Pose()};
                const MatrixXd B_body = squareRoot(scene.elements[e].ownMobility) *
                                        inverseRoot(alone.expected().mobility);
                B.block(row, row, 6, 6) = turned(B_body, scene.poses[e].rotation());
                // The factor turns with the body: D B D^T.
            }
            const MatrixXd expected = B * model * B.transpose();
            EXPECT_LT(difference(measured.mobility(), expected), 1e-11);
            EXPECT_LT(difference(measured.friction(), expected.inverse()), 1e-10);
            const MatrixXd wrenches = MatrixXd::Random(model.rows(), 2);
            MatrixXd twists;
            measured.multiply(wrenches, twists);
            EXPECT_LT(difference(twists, expected * wrenches), 1e-11);
        }
}

TEST(BodyMobility, OwnTensorsOfSpheresAreTheSameWithAndWithoutMatrices) {
    // For spheres about their centres, products with the particles' mobility give the answer.
    vector<FluidElement> elements(3, kinds()[2].element);
    elements[0].ownMobility = 0.05 * tensorWithoutSymmetry(1);
    elements[2].ownMobility = 0.03 * tensorWithoutSymmetry(2);
    const Scene scene(elements, 4, 3);
    TestedBodies byMatrix = scene.make(), byProducts = scene.make();
    ASSERT_TRUE(byProducts->hasProducts());
    const MatrixXd wrenches = MatrixXd::Random(18, 2);
    MatrixXd twists;
    byProducts.multiply(wrenches, twists);
    EXPECT_EQ(byProducts.byProducts().getCosts().products, 2);
    EXPECT_LT(difference(twists, byMatrix.mobility() * wrenches), 1e-13);
    EXPECT_LT(difference(byMatrix.friction(), byMatrix.mobility().inverse()), 1e-11);
}

TEST(BodyMobility, OwnTensorsAreExactFarAwayAndPositiveNearby) {
    double smallest = INFINITY;
    for (int trial = 0; trial < 300; trial++) {
        const double size = trial % 3 == 0 ? 1 : trial % 3 == 1 ? 3 : 10;
        Scene scene = ownTensorScene(4, size, trial);
        TestedBodies measured = scene.make();
        const MatrixXd N = measured.mobility();
        const VectorXd d = N.diagonal().cwiseSqrt().cwiseInverse();
        const double least =
            Eigen::SelfAdjointEigenSolver<MatrixXd>(MatrixXd(d.asDiagonal() * N * d.asDiagonal()))
                .eigenvalues()[0];
        ASSERT_GT(least, 0) << trial;
        smallest = min(smallest, least);
    }
    cout << "smallest eigenvalue " << smallest << endl;
    // At a large distance the self block is the own tensor, and forces on other bodies make the
    // flow of a point force.
    Scene far = ownTensorScene(2, 1, 5);
    far.poses[1].R += Vector3d(2e4, 0, 0);
    far.elements.resize(2);
    far.poses.resize(2);
    TestedBodies measured = far.make();
    const MatrixXd N = measured.mobility();
    for (int e = 0; e < 2; e++)
        EXPECT_LT(difference(N.block(6 * e, 6 * e, 6, 6),
                             turned(far.elements[e].ownMobility, far.poses[e].rotation())),
                  1e-6);
}

TEST(BodyMobility, OwnTensorsOfRodsCannotBeCombinedWithNeighbours) {
    FluidElement rod = kinds()[4].element;
    rod.ownMobility = tensorWithoutSymmetry(1);
    const Scene scene({kinds()[0].element, rod}, 9, 1);
    expectError([&] { scene.make(); }, {"body 1 was given a tensor of its own",
                                        "the model has no rotational mobility about this line"});
}

TEST(BodyMobility, BlobsAtOnePlaceAreAnError) {
    const Scene scene({element({{0, 0, 0}, {0, 0, 0}, {0, 1, 0}}, {1, 1, 1}), kinds()[0].element},
                      6, 1);
    expectError([&] { scene.make(); },
                {"particle 0 (body 0) and particle 1 (body 0)", "are at the same place"});
    const Scene spheres({element({{0, 0, 0}}, {1}), element({{0, 0, 0}}, {1})}, 0, 1);
    expectError([&] { spheres.make().friction(); }, {"are at the same place: 0 nm apart"});
}

namespace {

/** A matrix that no model of this library gives: -1, as mobility and as friction. */
class Indefinite : public MobilityModel {
public:
    Indefinite(const HydrodynamicParticles& particles, bool friction, bool alone)
        : MobilityModel(particles, eta, traitsOf(friction)), alone(alone) {}
    static MobilityTraits traitsOf(bool friction) {
        MobilityTraits traits("Indefinite");
        traits.isMadeFromFriction = friction;
        return traits;
    }
    void ownMobility(const HydrodynamicParticles& body, const vector<Vec3>& sites,
                     MatrixXd& mobility) const override {
        if (alone)
            mobility = -MatrixXd::Identity(body.numRows, body.numRows);
        else
            MobilityModel::ownMobility(body, sites, mobility);
    }

protected:
    unique_ptr<MobilityAt> makePlace() const override { return make_unique<IndefiniteAt>(*this); }

private:
    class IndefiniteAt : public MobilityAt {
    public:
        explicit IndefiniteAt(const Indefinite& model)
            : MobilityAt(model), fromFriction(model.traits.isMadeFromFriction) {}
        void multiply(const MatrixXd& forces, MatrixXd& velocities, const Accuracy&) override {
            velocities = -forces;
        }
        void friction(MatrixXd& friction) override {
            if (fromFriction)
                friction = -MatrixXd::Identity(particles.numRows, particles.numRows);
            else
                MobilityAt::friction(friction);
        }

    protected:
        void moveTo(const Placement&, bool) override {}

    private:
        const bool fromFriction;
    };
    const bool alone;
};

}  // namespace

TEST(BodyMobility, ModelsThatAreNotPositiveDefiniteAreAnError) {
    for (const FluidElement& body : {kinds()[0].element, kinds()[2].element})
        for (bool friction : {false, true}) {
            TestedBodies mobility({body}, [&](const HydrodynamicParticles& particles) {
                return make_unique<Indefinite>(particles, friction, false);
            });
            mobility.setPoses({Pose()});
            const bool multiblob = body.particles.size() > 1;
            if (!friction)
                expectError([&] { mobility.friction(); },
                            {"hydrodynamic particles is not positive definite; look for particles "
                             "at the same place"});
            else if (multiblob)
                expectError([&] { mobility.mobility(); },
                            {"the friction matrix of 1 bodies is not positive definite",
                             "blobs are all at one place"});
        }
    TestedBodies alone({kinds()[0].element}, [](const HydrodynamicParticles& particles) {
        return make_unique<Indefinite>(particles, false, true);
    });
    alone.byProducts().setPoses({Pose()});
    MatrixXd twists;
    expectError([&] { alone.byProducts().multiply(MatrixXd::Zero(6, 1), twists); },
                {"blobs of body 0 is not positive definite; look for blobs"});
}
