// Hydrodynamic models, and their mobilities at several placements at once.

#include <Eigen/Geometry>

#include "CoupledBodiesSupport.h"
#include "TestSupport.h"
#include "mobility/models/lubricated/LubricatedMobility.h"
#include "mobility/models/periodic/PeriodicMobility.h"
#include "mobility/models/periodic/PeriodicStokesianDynamics.h"
#include "mobility/models/rotneprager/CpuRotnePragerYamakawa.h"
#include "mobility/models/rotneprager/RotnePragerYamakawa.h"
#include "mobility/models/stokesian/StokesianDynamics.h"
#include "mobility/models/wall/RotnePragerYamakawaWall.h"
#include "mobility/models/wall/SphereWall.h"

using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace OpenMM;
using namespace std;
using Eigen::MatrixXd;
using Eigen::Vector3d;

namespace {

const double eta = 0.7;

HydrodynamicParticles threeSpheres() {
    HydrodynamicParticles particles;
    for (int i = 0; i < 3; i++) particles.add(0.4 + 0.1 * i, true, i, i);
    return particles;
}

struct Case {
    string name;
    unique_ptr<MobilityModel> model;
    bool atWall, inBox = false;
};

vector<Case> cases(const HydrodynamicParticles& particles) {
    const NoSlipPlane wall(0, false);
    vector<Case> all;
    const auto add = [&](const string& name, MobilityModel* model, bool atWall,
                         bool inBox = false) {
        all.push_back({name, unique_ptr<MobilityModel>(model), atWall, inBox});
    };
    add("RotnePragerYamakawa", new RotnePragerYamakawa(particles, eta), false);
    add("RotnePragerYamakawaWall", new RotnePragerYamakawaWall(particles, eta, wall), true);
    add("BestKnown",
        new SphereWallCongruence(particles, eta, wall, "NoSlipWall",
                                 make_unique<RotnePragerYamakawaWall>(particles, eta, wall)),
        true);
    add("CpuRotnePragerYamakawa", new CpuRotnePragerYamakawa(particles, eta), false);
    add("CpuRotnePragerYamakawa at a wall", new CpuRotnePragerYamakawa(particles, eta, {}, wall),
        true);
    add("StokesianDynamics", new StokesianDynamics(particles, eta, true, 0), false);
    add("StokesianDynamics without lubrication", new StokesianDynamics(particles, eta, false, 0),
        false);
    add("PeriodicRotnePragerYamakawa", new PeriodicRotnePragerYamakawa(particles, eta), false,
        true);
    add("PeriodicForceCoupling", new PeriodicForceCoupling(particles, eta), false, true);
    add("PeriodicStokesianDynamics", new PeriodicStokesianDynamics(particles, eta, true, 0), false,
        true);
    LubricationScene inFluid, atTheWall, periodic;
    inFluid.reach = atTheWall.reach = periodic.reach = {3, 4};
    atTheWall.low = 0;
    periodic.numPeriods = 3;
    add("RotnePragerYamakawa with lubrication",
        new LubricatedMobility(particles, eta, overSurfaces(), inFluid,
                               make_unique<RotnePragerYamakawa>(particles, eta)),
        false);
    add("RotnePragerYamakawaWall with lubrication",
        new LubricatedMobility(particles, eta, overSurfaces(), atTheWall,
                               make_unique<RotnePragerYamakawaWall>(particles, eta, wall)),
        true);
    add("PeriodicRotnePragerYamakawa with lubrication",
        new LubricatedMobility(particles, eta, overSurfaces(), periodic,
                               make_unique<PeriodicRotnePragerYamakawa>(particles, eta)),
        false, true);
    add("PeriodicStokesianDynamics without lubrication",
        new PeriodicStokesianDynamics(particles, eta, false, 0), false, true);
    return all;
}

// Models of periodic fluids have this triclinic box.
const BoxVectors box = {Vec3(4, 0, 0), Vec3(1, 4.5, 0), Vec3(-0.7, 0.9, 3.8)};
const Placement first = {{Vec3(0, 0, 1), Vec3(1.2, 0, 1.5), Vec3(0, 1.3, 0.9)}, box},
                second = {{Vec3(0.3, 0, 2), Vec3(1.9, 0, 0.8), Vec3(0, 1.6, 1.9)}, box};

struct Answers {
    MatrixXd dense, friction, products;
    explicit Answers(MobilityAt& at) {
        at.dense(dense);
        at.friction(friction);
        at.multiply(MatrixXd::Identity(dense.rows(), dense.rows()), products);
    }
    bool operator==(const Answers& other) const {
        return dense == other.dense && friction == other.friction && products == other.products;
    }
};

}  // namespace

TEST(MobilityModel, SeveralPlacesLiveAtOnce) {
    for (const Case& c : cases(threeSpheres())) {
        const auto a = c.model->at(first), b = c.model->near(second);
        const Answers atFirst(*a), atSecond(*b);
        EXPECT_FALSE(atFirst == atSecond) << c.name;
        EXPECT_TRUE(atFirst == Answers(*a)) << c.name;
        // The memory of a MobilityAt is used for another placement. The first placement has no
        // influence.
        auto lent = c.model->at(first);
        Answers unused(*lent);
        const MobilityAt* memory = lent.get();
        c.model->place(lent, second);
        EXPECT_EQ(lent.get(), memory) << c.name;
        EXPECT_TRUE(atSecond == Answers(*lent)) << c.name;
        EXPECT_TRUE(atFirst == Answers(*a)) << c.name;
    }
}

TEST(MobilityModel, TraitsAreWhatTheMatricesDo) {
    // Shifted sideways and upwards; turned about an axis along the wall.
    const Eigen::Matrix3d Q = Eigen::AngleAxisd(0.4, Vector3d(1, 2, 0).normalized()).matrix();
    const double eps = 1e-11;
    for (const Case& c : cases(threeSpheres())) {
        Placement shifted = first, turned = first;
        for (Vec3& r : shifted.positions) r += Vec3(0.3, -0.2, 0.7);
        for (Vec3& r : turned.positions) {
            const Vector3d t = Q * Vector3d(r[0], r[1], r[2] - 1);
            r = Vec3(t[0], t[1], t[2] + 3);
        }
        const MatrixXd M = Answers(*c.model->at(first)).dense;
        MatrixXd Q6 = MatrixXd::Zero(M.rows(), M.rows());
        for (int i = 0; i < M.rows(); i += 3) Q6.block<3, 3>(i, i) = Q;
        const double shift = (Answers(*c.model->at(shifted)).dense - M).norm() / M.norm();
        const double turn =
            (Answers(*c.model->at(turned)).dense - Q6 * M * Q6.transpose()).norm() / M.norm();
        EXPECT_EQ(shift < eps, c.model->getTraits().isHomogeneous) << c.name << " " << shift;
        EXPECT_EQ(turn < eps, c.model->getTraits().isIsotropic) << c.name << " " << turn;
        EXPECT_EQ(c.model->getTraits().isHomogeneous, !c.atWall);
        EXPECT_EQ(c.model->getTraits().isIsotropic, !c.atWall && !c.inBox);
        EXPECT_EQ(c.model->box() != nullptr, c.inBox);
        const GridOfModel* grid = c.model->grid();
        EXPECT_EQ(grid != nullptr, c.model->getTraits().isMatrixFree);
        if (grid) {
            EXPECT_EQ(grid->describe(first.box).find("a grid of"), 0u);
        }
        unique_ptr<RandomField> field;
        if (c.model->randomField())
            c.model->randomField()->draw(NoiseStream(), NoiseStream::FirstDraw, first.box, field);
        EXPECT_EQ(field != nullptr, grid != nullptr);
        EXPECT_NE(string(c.model->name()), "");
    }
}

/**
 * A request for some columns gives the same bits as one for all columns, whichever particles are
 * spheres.
 */
TEST(MobilityModel, SomeColumnsAreThoseOfAllOfThem) {
    HydrodynamicParticles mixed;
    for (int i = 0; i < 3; i++) mixed.add(0.3 + 0.1 * i, i == 1, i, i);
    vector<Case> all = cases(threeSpheres());
    for (MobilityModel* model : initializer_list<MobilityModel*>{
             new RotnePragerYamakawa(mixed, eta), new CpuRotnePragerYamakawa(mixed, eta),
             new CpuRotnePragerYamakawa(mixed, eta, {}, NoSlipPlane(0, false)),
             new RotnePragerYamakawaWall(mixed, eta, NoSlipPlane(0, false)),
             new PeriodicRotnePragerYamakawa(mixed, eta)})
        all.push_back({"mixed", unique_ptr<MobilityModel>(model), false});
    for (const Case& c : all) {
        const HydrodynamicParticles& particles = c.model->getParticles();
        const auto at = c.model->at(first);
        MatrixXd matrix, some;
        at->dense(matrix);
        for (int p = 0; p <= particles.size(); p++) {
            at->denseColumns(p, some);
            const int columns =
                p == particles.size() ? 0 : particles.numRows - particles.firstRow[p];
            EXPECT_EQ(MatrixXd(some.rightCols(columns)), MatrixXd(matrix.rightCols(columns)))
                << c.name << " " << p;
        }
    }
}

TEST(MobilityModel, ABodyByItselfIsThatOfUnboundedFluid) {
    HydrodynamicParticles body;
    const vector<Vec3> sites = {Vec3(), Vec3(0.5, 0.1, -3), Vec3(0.2, -0.8, 0.4)};
    for (size_t i = 0; i < sites.size(); i++) body.add(0.3 + 0.1 * i, false, i, 0);
    MatrixXd expected, own;
    RotnePragerYamakawa(body, eta).at({sites})->dense(expected);
    for (const Case& c : cases(threeSpheres())) {
        c.model->ownMobility(body, sites, own);
        if (string(c.model->name()) == "ForceCoupling") {
            // The particles are Gaussians. The own mobility is that in a box so large that images
            // do not count.
            const double L = 1e15;
            PeriodicForceCoupling(body, eta)
                .at({sites, {Vec3(L, 0, 0), Vec3(0, L, 0), Vec3(0, 0, L)}})
                ->dense(expected);
            EXPECT_LT((own - expected).cwiseAbs().maxCoeff(), 1e-14 * expected.maxCoeff())
                << c.name;
            RotnePragerYamakawa(body, eta).at({sites})->dense(expected);
            continue;
        }
        EXPECT_LT((own - expected).cwiseAbs().maxCoeff(), 1e-14 * expected.maxCoeff()) << c.name;
    }
}

namespace {

/** A model whose mobility is that of Stokes drag over 1 + the volume of the box. */
class InABox : public MobilityModel {
public:
    InABox(const HydrodynamicParticles& particles, double viscosity)
        : MobilityModel(particles, viscosity, traitsInABox()) {}
    static MobilityTraits traitsInABox() {
        MobilityTraits traits("InABox");
        traits.mayObject = true;
        return traits;
    }
    string objection(const Placement& placement) const override {
        return placement.box[0][0] < 0 ? "no box" : "";
    }

protected:
    unique_ptr<MobilityAt> makePlace() const override { return make_unique<InABoxAt>(*this); }

private:
    class InABoxAt : public MobilityAt {
    public:
        using MobilityAt::MobilityAt;
        void multiply(const MatrixXd& forces, MatrixXd& velocities, const Accuracy&) override {
            velocities = forces / (1 + volume);
        }

    protected:
        void moveTo(const Placement& p, bool) override {
            volume = p.box[0][0] * p.box[1][1] * p.box[2][2];
        }

    private:
        double volume = 0;
    };
};

}  // namespace

TEST(MobilityModel, TheBoxComesWithThePoses) {
    FluidElement sphere;
    sphere.body = 0;
    sphere.particles = {0};
    sphere.sites = {Vector3d::Zero()};
    sphere.radii = {1};
    TestedBodies bodies({sphere}, [](const HydrodynamicParticles& particles) {
        return make_unique<InABox>(particles, eta);
    });
    bodies.setPoses({Pose()});
    EXPECT_EQ(bodies.mobility()(0, 0), 1);
    bodies->setBox({Vec3(2, 0, 0), Vec3(0, 3, 0), Vec3(0, 0, 4)});
    EXPECT_EQ(bodies.mobility()(0, 0), 1) << "at poses set before";
    bodies.setPoses({Pose()});
    EXPECT_EQ(bodies.mobility()(0, 0), 1.0 / 25);
    EXPECT_EQ(bodies.byMatrices().objection({Pose()}), "");
    bodies->setBox({Vec3(-1, 0, 0), Vec3(), Vec3()});
    EXPECT_EQ(bodies.byMatrices().objection({Pose()}), "no box");
    EXPECT_FALSE(bodies.byMatrices().acceptsNearby({Pose()}));
}

TEST(MobilityModel, FlowAtPointsIsKnownOrRefused) {
    // A model whose author has written no method for the flow at points.
    struct Nowhere : RotnePragerYamakawa {
        using RotnePragerYamakawa::RotnePragerYamakawa;
        struct At : MobilityAt {
            using MobilityAt::MobilityAt;
            void multiply(const MatrixXd& forces, MatrixXd& velocities, const Accuracy&) override {
                velocities = forces;
            }
            void moveTo(const Placement&, bool) override {}
        };
        unique_ptr<MobilityAt> makePlace() const override { return make_unique<At>(*this); }
    };
    const HydrodynamicParticles particles = threeSpheres();
    const Nowhere model(particles, eta);
    const unique_ptr<MobilityAt> at = model.at(first);
    Velocities velocities = Velocities::Zero(3, 1);
    expectError(
        [&] {
            at->addFlowAt({MatrixXd::Zero(18, 1), {}}, {Vec3()}, 1, velocities);
        },
        {"the model does not know the flow at points of the fluid",
         "ask for the velocities of bodies by applyMobilityInContext()"});
    // The models that know the flow add it to the given velocities.
    for (const Case& c : cases(particles)) {
        const unique_ptr<MobilityAt> place = c.model->at(first);
        MatrixXd forces = MatrixXd::Zero(18, 1);
        forces << 1, 0.2, -0.3, 0.1, 0.5, 0, 0.4, -1, 0.2, 0, 0, 1, 0.3, 0.3, 0.3, -0.1, 0, 0;
        const FlowSources sources = place->sources(forces, nullptr);
        const vector<Vec3> points = {Vec3(0.7, 0.8, 2), Vec3(-1, 0.5, 0.4)};
        Velocities once = Velocities::Zero(3, 2), twice = Velocities::Ones(3, 2);
        place->addFlowAt(sources, points, 1, once);
        place->addFlowAt(sources, points, -2, twice);
        EXPECT_GT(once.norm(), 0.01) << c.name;
        EXPECT_LT((twice - (Velocities::Ones(3, 2) - 2 * once)).norm(), 1e-13) << c.name;
    }
}
