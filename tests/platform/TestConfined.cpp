// Fluids that are periodic along no-slip walls in a Context: steps of all schemes, rejections at
// both walls, own tensors, resuming, and refused input.

#include <set>

#include "GridSceneSupport.h"
#include "Instrumented.h"
#include "openmmrigidhi/ModelTraits.h"
#include "openmmrigidhi/SchemeTraits.h"

using namespace OpenMM;
using namespace RigidHITest;
using namespace std;

namespace {

using RigidHI = CustomRigidHIIntegrator;

struct Case {
    MobilityForce::Model model;
    MobilityForce::Boundary boundary;
    MobilityForce::Solver solver;
};
string nameOf(const Case& c) {
    return string(RigidHIPlugin::traitsOf(c.model).name) +
           RigidHIPlugin::traitsOf(c.boundary).name +
           (c.solver == MobilityForce::Dense ? "Dense" : "OnGrid");
}
void PrintTo(const Case& c, ostream* out) { *out << nameOf(c); }

/** All models with boundaries that are periodic along no-slip walls, as matrices and on grids. */
vector<Case> allCases() {
    vector<Case> all;
    for (const auto& model : RigidHIPlugin::modelTable)
        for (const auto& boundary : RigidHIPlugin::boundaryTable)
            for (auto solver : {MobilityForce::Dense, MobilityForce::MatrixFree})
                if (model.hasBoundary(boundary.boundary) && boundary.isPeriodic &&
                    boundary.isAcross(2))
                    all.push_back({model.model, boundary.boundary, solver});
    return all;
}

const double low = -0.4, high = 5.2;
const BodyKind threeBlobs = {"three blobs",
                             1,
                             Vec3(0.5, 0.6, 0.7),
                             {Vec3(-0.8, 0, 0), Vec3(0.8, 0, 0), Vec3(0, 0.8, 0.1)},
                             {0.9, 0.9, 0.9}};

struct ConfinedScene : GridScene {
    explicit ConfinedScene(const Case& c, double temperature = 0,
                           RigidHI::Scheme scheme = RigidHI::TrapezoidalSlip, double h = 0.002,
                           double tolerance = 1e-2)
        : GridScene(c.model, temperature, scheme, h, c.solver, tolerance) {
        fluid->setBoundary(c.boundary);
        fluid->setWallHeight(low);
        fluid->setChannelWalls(low, high);
        side = 7;
    }
    /** Spheres and a multiblob near both walls and across faces of the box, and forces on them. All
     * have one radius, which makes grids of RotnePragerYamakawa cheap. */
    void addBodies(bool touching = true) {
        const double a = 0.9;
        add(sphereKind(a, 1, 0.3), Vec3(0, 0, low + (touching ? a : a + 0.4)));
        add(sphereKind(a, 1, 0.3), Vec3(2.1, 6.8, high - (touching ? a : a + 0.4)));
        add(threeBlobs, Vec3(-1, 3.5, 2.4));
        auto* pull = new CustomExternalForce("0.7*x-0.4*y+0.2*(z-2.4)^2");
        for (int i = 0; i < system.getNumParticles(); i++) pull->addParticle(i, vector<double>());
        system.addForce(pull);
    }
};

class Confined : public testing::TestWithParam<Case> {};
INSTANTIATE_TEST_SUITE_P(Fluids, Confined, testing::ValuesIn(allCases()),
                         [](const testing::TestParamInfo<Case>& info) {
                             return nameOf(info.param);
                         });

}  // namespace

TEST_P(Confined, TheThirdVectorOfTheBoxDoesNotMatter) {
    ConfinedScene scene(GetParam());
    scene.addBodies();
    scene.start(testPlatform());
    const MatrixXd N = scene.mobility();
    scene.setBox(7, 7, 31);
    EXPECT_EQ(scene.mobility(), N);
    scene.setBox(7, 8, 31);
    EXPECT_GT((scene.mobility() - N).norm(), 1e-3 * N.norm());
}

TEST_P(Confined, AllSchemesMakeSteps) {
    for (const RigidHIPlugin::SchemeTraits& traits : RigidHIPlugin::schemeTable) {
        if (!traits.needsFluid()) continue;
        SCOPED_TRACE(traits.name);
        ConfinedScene scene(GetParam(), T1, traits.scheme, 1e-4);
        scene.addBodies(false);
        scene.start(testPlatform());
        scene.integrator.step(allOrFew(3, 1));
        const VectorXd state = scene.state();
        EXPECT_TRUE(state.allFinite());
        EXPECT_GT(scene.count("randomNumbers"), 0);
        for (const Vec3& R : scene.integrator.getBodyPositions()) {
            EXPECT_GT(R[2], low);
            EXPECT_LT(R[2], high);
        }
    }
}

TEST_P(Confined, ResumesBitForBit) {
    for (auto scheme : {RigidHI::TrapezoidalSlip, RigidHI::LangevinHI}) {
        expectToResumeBitForBit<ConfinedScene>(
            [&](int threads) {
                auto scene = make_unique<ConfinedScene>(GetParam(), T1, scheme, 1e-3);
                scene->addBodies(false);
                scene->start(testPlatform(), threads);
                return scene;
            },
            [](ConfinedScene& scene) { scene.integrator.step(allOrFew(2, 1)); }, 1);
    }
}

TEST_P(Confined, StepsThroughEitherPlaneAreRedone) {
    const bool above = RigidHIPlugin::traitsOf(GetParam().boundary).numWalls == 2;
    for (bool atTop : {false, true}) {
        if (atTop && !above) continue;
        ConfinedScene scene(GetParam(), T1, RigidHI::EulerMaruyama, 0.1);
        const double a = 0.9;
        scene.add(sphereKind(a), Vec3(0, 0, atTop ? high - 1.05 * a : low + 1.05 * a));
        auto* weight = new CustomExternalForce(atTop ? "-10*z" : "10*z");
        weight->addParticle(0, vector<double>());
        scene.system.addForce(weight);
        scene.start(testPlatform());
        scene.integrator.step(20);
        EXPECT_GT(scene.integrator.getNumRejectedSteps(), 0);
        const double z = scene.integrator.getBodyPositions()[0][2];
        EXPECT_GE(z, low + a);
        EXPECT_LE(z, above ? high - a : INFINITY);
    }
}

TEST_P(Confined, ParticlesBehindAPlaneAreRefusedByName) {
    const string name = RigidHIPlugin::traitsOf(GetParam().boundary).name;
    for (auto rejection : {RigidHI::Overlap, RigidHI::Crossing}) {
        const bool crossing = rejection == RigidHI::Crossing;
        ConfinedScene scene(GetParam());
        scene.integrator.setWallRejection(rejection);
        scene.add(sphereKind(0.9), Vec3(0, 0, crossing ? low - 0.1 : low + 0.8));
        expectError(
            [&] {
                scene.start(testPlatform());
                scene.mobility();
            },
            {name + ": particle 0 (body 0) has its centre at z = ",
             crossing ? "has no mobility; move it into the fluid"
                      : "nearer to a plane than its radius, 0.9 nm"});
    }
}

TEST_P(Confined, BodiesMayHaveTensorsOfTheirOwn) {
    ConfinedScene scene(GetParam()), without(GetParam());
    for (ConfinedScene* s : {&scene, &without}) s->add(threeBlobs, Vec3(0, 0, 2.4));
    vector<double> tensor(36, 0.0);
    for (int k = 0; k < 6; k++) tensor[7 * k] = k < 3 ? 0.05 : 0.02;
    scene.fluid->setBodyMobility(0, tensor);
    scene.start(testPlatform());
    without.start(testPlatform());
    const MatrixXd N = scene.mobility();
    EXPECT_LT((N - N.transpose()).cwiseAbs().maxCoeff(), 1e-10 * N.norm());
    EXPECT_GT((N - without.mobility()).norm(), 0.05 * N.norm());
    EXPECT_GT(Eigen::SelfAdjointEigenSolver<MatrixXd>(N).eigenvalues()[0], 0);
}

TEST_P(Confined, EffectsNameThePlanes) {
    ConfinedScene scene(GetParam(), T1);
    scene.addBodies();
    scene.start(testPlatform());
    const string effect = scene.effect("hydrodynamics");
    const map<MobilityForce::Boundary, string> planes = {
        {MobilityForce::PeriodicWall, "above a no-slip wall at z = -0.4 nm"},
        {MobilityForce::NoSlipChannel,
         "between no-slip walls at z = -0.4 and 5.2 nm (the scheme redoes a step after which a "
         "particle overlaps a wall), without a pressure gradient along them,"},
        {MobilityForce::Film, "between a no-slip wall and a free surface at z = -0.4 and 5.2 nm"}};
    EXPECT_NE(effect.find(planes.at(GetParam().boundary)), string::npos) << effect;
    EXPECT_EQ(effect.find(" on a grid of") != string::npos,
              GetParam().solver == MobilityForce::MatrixFree ||
                  GetParam().model == MobilityForce::ForceCoupling)
        << effect;
    const bool byMatrices = GetParam().solver == MobilityForce::Dense &&
                            GetParam().model == MobilityForce::RotnePragerYamakawa;
    EXPECT_EQ(effect.find("by matrices of lattice sums (each matrix has 21 rows, ") != string::npos,
              byMatrices)
        << effect;
}

TEST_P(Confined, WallsAndTheirConditionStayAsLongAsTheContext) {
    ConfinedScene scene(GetParam());
    scene.addBodies();
    scene.start(testPlatform());
    scene.fluid->setChannelCondition(MobilityForce::ZeroFlux);
    expectError([&] { scene.fluid->updateParametersInContext(*scene.context); },
                {"cannot change the walls or the condition of a channel"});
}

TEST(ConfinedWall, BestKnownIsForRotnePragerYamakawa) {
    ConfinedScene scene(
        {MobilityForce::ForceCoupling, MobilityForce::PeriodicWall, MobilityForce::MatrixFree});
    scene.fluid->setSphereWallMobility(MobilityForce::BestKnown);
    scene.add(sphereKind(0.9), Vec3(0, 0, 2));
    expectError([&] { scene.start(testPlatform()); },
                {"sphere-wall mobility BestKnown is for the model RotnePragerYamakawa, but the "
                 "model is ForceCoupling",
                 "setModel(RotnePragerYamakawa) or setSphereWallMobility(FromModel)"});
}

TEST(ConfinedWall, BestKnownIsTheMobilityOfOneSphereAboveTheWall) {
    // In a wide box the mobility is that above a NoSlipWall, up to the images: 8e-4 along the wall.
    const auto mobility = [](MobilityForce::Boundary boundary, MobilityForce::Solver solver,
                             MobilityForce::SphereWallMobility sphereWall) {
        ConfinedScene scene({MobilityForce::RotnePragerYamakawa, boundary, solver});
        scene.fluid->setSphereWallMobility(sphereWall);
        scene.side = 36;
        scene.add(sphereKind(0.9), Vec3(0, 0, low + 1.1 * 0.9));
        scene.start(testPlatform());
        return scene.mobility();
    };
    const auto ofWall = [&](MobilityForce::SphereWallMobility sphereWall) {
        return mobility(MobilityForce::NoSlipWall, MobilityForce::Dense, sphereWall);
    };
    const MatrixXd best = ofWall(MobilityForce::BestKnown),
                   model = ofWall(MobilityForce::FromModel);
    EXPECT_GT(difference(model, best), 0.05);
    for (auto solver : {MobilityForce::Dense, MobilityForce::MatrixFree}) {
        const auto inBox = [&](MobilityForce::SphereWallMobility sphereWall) {
            return mobility(MobilityForce::PeriodicWall, solver, sphereWall);
        };
        const MatrixXd bestInBox = inBox(MobilityForce::BestKnown),
                       modelInBox = inBox(MobilityForce::FromModel);
        const double accuracy = solver == MobilityForce::Dense ? 1e-3 : 1e-2;
        EXPECT_LE(difference(bestInBox, best), accuracy);
        // Across the wall, and about its normal, the congruence is a factor.
        for (int k : {2, 5})
            EXPECT_NEAR(bestInBox(k, k) / modelInBox(k, k), best(k, k) / model(k, k), 1e-12);
    }
}

TEST(ConfinedChoice, AutoDoesNotLookAtTheThirdVectorOfTheBox) {
    for (auto boundary : {MobilityForce::PeriodicWall, MobilityForce::NoSlipChannel}) {
        set<string> choices;
        for (double boxHeight : {4.0, 40.0, 400.0}) {
            ConfinedScene scene({MobilityForce::RotnePragerYamakawa, boundary, MobilityForce::Auto},
                                0, RigidHI::EulerMaruyama);
            scene.side = 15;
            scene.boxHeight = boxHeight;
            for (int i = 0; i < 36; i++)
                scene.add(sphereKind(0.9), Vec3(2.5 * (i % 6), 2.5 * (i / 6), 1.5));
            scene.start(testPlatform());
            const string text = scene.effect("hydrodynamics"),
                         estimate = "chosen by Auto: a step is estimated to take ",
                         way = text.find(" on a grid of ") != string::npos ? "grid" : "matrices";
            const size_t first = text.find(estimate);
            ASSERT_NE(first, string::npos) << text;
            choices.insert(way + text.substr(first, text.find(" on one thread", first) - first));
        }
        EXPECT_EQ(choices.size(), 1u) << *choices.begin() << "; " << *choices.rbegin();
    }
}

TEST(ConfinedChannel, ConditionsDiffer) {
    MatrixXd N[2];
    for (int zeroFlux = 0; zeroFlux < 2; zeroFlux++) {
        ConfinedScene scene({MobilityForce::RotnePragerYamakawa, MobilityForce::NoSlipChannel,
                             MobilityForce::Dense});
        if (zeroFlux) scene.fluid->setChannelCondition(MobilityForce::ZeroFlux);
        scene.add(sphereKind(0.9), Vec3(0, 0, 2));
        scene.start(testPlatform());
        N[zeroFlux] = scene.mobility();
    }
    const double H = high - low, s = 2 - low, p = s * (H - s) - 0.9 * 0.9 / 3;
    EXPECT_NEAR(N[0](0, 0) - N[1](0, 0), 3 * p * p / (0.6 * H * H * H * 49), 1e-12);
}

TEST(ConfinedChannel, BadConditionsAreRefused) {
    MobilityForce fluid;
    expectError([&] { fluid.setChannelCondition(static_cast<MobilityForce::ChannelCondition>(2)); },
                {"setChannelCondition(): channel condition 2 is unknown",
                 "ZeroPressureGradient, ZeroFlux"});
}
