#include "OverdampedSteps.h"

#include "mobility/MobilityDecorator.h"
#include "mobility/Models.h"
#include "mobility/models/lubricated/LubricatedMobility.h"
#include "mobility/models/periodic/PeriodicMobility.h"
#include "mobility/models/rotneprager/RotnePragerYamakawa.h"
#include "mobility/models/stokesian/StokesianDynamics.h"
#include "mobility/models/wall/RotnePragerYamakawaWall.h"
#include "mobility/models/wall/SlipChannel.h"
#include "mobility/models/wall/SphereWall.h"

using namespace RigidHIPlugin;
using namespace std;

namespace RigidHITest {

namespace {

/** A model without its random field. Noise then comes from roots of its matrix or products. */
class WithoutField : public MobilityDecorator {
public:
    WithoutField(const HydrodynamicParticles& particles, double viscosity,
                 unique_ptr<MobilityModel> model)
        : MobilityDecorator(particles, viscosity, model->getTraits(), move(model)) {}
    bool acceptsNearby(const Placement& placement) const override {
        return getModel().acceptsNearby(placement);
    }

protected:
    unique_ptr<MobilityAt> makePlace() const override { return make_unique<Place>(*this); }

private:
    /** Its matrix consists of products. */
    class Place : public MobilityAt {
    public:
        explicit Place(const WithoutField& model) : MobilityAt(model), model(model.getModel()) {}
        void multiply(const MatrixXd& forces, MatrixXd& velocities,
                      const Accuracy& accuracy) override {
            inner->multiply(forces, velocities, accuracy);
        }

    protected:
        void moveTo(const Placement& placement, bool nearby) override {
            if (nearby)
                model.placeNear(inner, placement);
            else
                model.place(inner, placement);
        }

    private:
        const MobilityModel& model;
        unique_ptr<MobilityAt> inner;
    };
};

struct Averages {
    VectorXd mean, error;      // of the increments minus the leading noise
    double along, alongError;  // of their component along a direction
};

/** Sums over samples, for means and their standard errors. */
class Sampling {
public:
    Sampling(const VectorXd& direction)
        : direction(direction), sum(VectorXd::Zero(direction.size())), squares(sum) {}
    void add(const VectorXd& x) {
        samples++;
        sum += x;
        squares += x.cwiseAbs2();
        alongSum += x.dot(direction);
        alongSquares += pow(x.dot(direction), 2);
    }
    Averages averages() const {
        Averages result;
        result.mean = sum / samples;
        result.error =
            ((squares / samples - result.mean.cwiseAbs2()) / samples).cwiseMax(0).cwiseSqrt();
        result.along = alongSum / samples;
        result.alongError =
            sqrt(max(0.0, alongSquares / samples - result.along * result.along) / samples);
        return result;
    }
    int samples = 0;

private:
    VectorXd direction, sum, squares;
    double alongSum = 0, alongSquares = 0;
};

}  // namespace

// ---- Scenes

FluidElement element(int body, const vector<Vector3d>& sites, const vector<double>& radii) {
    FluidElement e;
    e.body = body;
    e.sites = sites;
    e.radii = radii;
    for (size_t i = 0; i < sites.size(); i++) e.particles.push_back(10 * (body + 1) + i);
    return e;
}

void Scene::add(const FluidElement& e, const Vector3d& at, const Vector3d& turn) {
    elements.push_back(e);
    R.push_back(at);
    q.push_back(
        scalar::exponential(scalar::Vector3<double>{turn.x() / 2, turn.y() / 2, turn.z() / 2}));
}

void Scene::placeIn(OverdampedMove& move) const {
    for (size_t e = 0; e < elements.size(); e++) {
        move.start[e].R = R[e];
        move.start[e].q = q[e];
    }
}

/** Lubrication above the wall, of which a part has its taper. */
unique_ptr<MobilityModel> Scene::withLubrication(const HydrodynamicParticles& particles) const {
    LubricationScene own;
    own.reach = {2.3, 3};
    if (wall) own.low = 0;
    unique_ptr<MobilityModel> model;
    if (wall)
        model = make_unique<RotnePragerYamakawaWall>(particles, viscosity, NoSlipPlane(0, false));
    else
        model = make_unique<RotnePragerYamakawa>(particles, viscosity);
    return make_unique<LubricatedMobility>(particles, viscosity, overSurfaces(), own, move(model));
}

unique_ptr<MobilityModel> Scene::ofForce(const HydrodynamicParticles& particles) const {
    MobilityScene scene;
    scene.onGrid = onGrid;
    PlatformModels own;
    own.gridFluid = [] { return make_shared<TestedGridFluid>(); };
    unique_ptr<MobilityModel> model = createMobility(*force, scene, particles, own);
    if (!withoutField) return model;
    return make_unique<WithoutField>(particles, viscosity, move(model));
}

CoupledBodies::ModelFactory Scene::factory() const {
    return [this](const HydrodynamicParticles& particles) -> unique_ptr<MobilityModel> {
        if (force) return ofForce(particles);
        if (lubricated) return withLubrication(particles);
        if (stokesian) return make_unique<StokesianDynamics>(particles, viscosity, true, 0);
        if (field) return make_unique<RandomFieldModel>(particles);
        if (channel)
            return make_unique<SlipChannel>(
                particles, viscosity, SlipWalls{-1.2, 4.2, false},
                make_unique<PeriodicForceCoupling>(SlipChannel::withImages(particles), viscosity));
        if (inBox && gaussians) return make_unique<PeriodicForceCoupling>(particles, viscosity);
        if (inBox) return make_unique<PeriodicRotnePragerYamakawa>(particles, viscosity);
        const NoSlipPlane plane(0, false);
        if (bestKnown)
            return make_unique<SphereWallCongruence>(
                particles, viscosity, plane, "NoSlipWall",
                make_unique<RotnePragerYamakawaWall>(particles, viscosity, plane));
        if (wall) return make_unique<RotnePragerYamakawaWall>(particles, viscosity, plane);
        return make_unique<RotnePragerYamakawa>(particles, viscosity);
    };
}

TestedBodies Scene::mobility() const {
    TestedBodies bodies(elements, factory(), true, 1e-8);
    if (inBox)
        bodies->setBox({OpenMM::Vec3(5, 0, 0), OpenMM::Vec3(1, 5.5, 0), OpenMM::Vec3(-2, 0.5, 6)});
    if (force) bodies->setBox(box);
    if (channel)
        bodies->setBox({OpenMM::Vec3(4, 0, 0), OpenMM::Vec3(0, 7, 0), OpenMM::Vec3(0, 0, 4.2)});
    return bodies;
}

Scene boomerangAtWall() {
    Scene s;
    s.name = "three blobs above a wall";
    s.wall = true;
    s.add(element(0, threeBlobs, {1, 1, 1}), {0, 0, 2.5});
    return s;
}

Scene threeBodiesAtWall() {
    Scene s;
    s.name = "multiblob, sphere and free particle above a wall";
    s.wall = true;
    s.add(element(0, threeBlobs, {1, 0.8, 1}), {0, 0, 2.2}, {0.3, 0.1, -0.5});
    s.add(element(1, {{0.1, 0, 0.2}}, {0.9}), {2.6, 1.6, 1.5}, {0, 1, 0.3});
    s.add(element(-1, {{0, 0, 0}}, {0.6}), {-0.6, 1.9, 1.0});
    return s;
}

Scene rodsUnbounded() {
    Scene s;
    s.name = "two rods and a sphere, unbounded";
    s.add(element(0, {{0, 0, -1}, {0, 0, 0.2}, {0, 0, 1.2}}, {0.7, 0.7, 0.7}), {0, 0, 0},
          {0.5, 0.2, 0});
    s.add(element(1, {{0.3, -1, 0}, {0.3, 1, 0}}, {0.8, 0.6}), {1.9, 0.4, 0.5}, {0.1, -0.6, 0.9});
    s.add(element(2, {{0, 0, 0}}, {0.7}), {0.2, 2.0, 0.3});
    return s;
}

Scene lubricatedSpheres() {
    Scene s;
    s.name = "two spheres above a wall, best known mobilities";
    s.wall = s.bestKnown = true;
    s.add(element(0, {{0, 0, 0}}, {1}), {0, 0, 1.2});
    s.add(element(1, {{0, 0, 0}}, {0.8}), {1.9, 0.4, 1.5}, {0.1, 0.4, 0});
    return s;
}

/** A symmetric tensor without any further symmetry, in the units of these scenes. */

static MatrixXd ownTensor(int seed) {
    const MatrixXd m = tensorWithoutSymmetry(seed);
    return m / (m.trace() / 6);
}

Scene ownTensors() {
    Scene s;
    s.name = "multiblob and sphere with own tensors beside a multiblob, unbounded";
    s.add(element(0, threeBlobs, {1, 0.8, 1}), {0, 0, 0}, {0.3, 0.1, -0.5});
    s.elements.back().ownMobility = ownTensor(1);
    s.add(element(1, {{0.1, 0, 0.2}}, {0.9}), {2.6, 1.6, 0.5}, {0, 1, 0.3});
    s.elements.back().ownMobility = ownTensor(2);
    s.add(element(2, threeBlobs, {0.7, 0.8, 0.6}), {-0.6, 3.2, 1.0}, {1, 0, 0});
    return s;
}

Scene stokesianSpheres() {
    Scene s;
    s.name = "three spheres with lubrication, one off its body's origin";
    s.stokesian = true;
    s.add(element(0, {{0, 0, 0}}, {1}), {0, 0, 0});
    s.add(element(1, {{0.2, 0, -0.1}}, {0.8}), {1.9, 0.4, 0.5}, {0.1, 0.4, 0});
    s.add(element(2, {{0, 0, 0}}, {0.9}), {0.3, 2.1, 0.4});
    return s;
}

Scene lubricatedBodiesAtWall() {
    Scene s = threeBodiesAtWall();
    s.name += ", with lubrication";
    s.lubricated = true;
    s.add(element(2, {{0, 0, 0}}, {0.8}), {3.4, -0.1, 1.3});
    return s;
}

Scene lubricatedBodiesBesideHeldOnes() {
    Scene s = lubricatedBodiesAtWall();
    s.name += ", two of them held, one with fixed components";
    s.elements[1].fixed = 1u << 2 | 1u << 4;
    for (auto held : {2, 3}) {  // held elements come first
        s.elements[held].hold();
        rotate(s.elements.begin(), s.elements.begin() + held, s.elements.begin() + held + 1);
        rotate(s.R.begin(), s.R.begin() + held, s.R.begin() + held + 1);
        rotate(s.q.begin(), s.q.begin() + held, s.q.begin() + held + 1);
    }
    return s;
}

Scene lubricatedSpheresAtWall() {
    Scene s;
    s.name = "spheres and a free particle above a wall, with lubrication";
    s.wall = s.lubricated = true;
    s.add(element(0, {{0, 0, 0}}, {1}), {0, 0, 1.15}, {0.5, 0.2, 0});
    s.add(element(1, {{0, 0, 0}}, {0.8}), {1.8, 0.4, 1.3}, {0.1, 0.4, 0});
    s.add(element(2, {{0, 0, 0}}, {0.9}), {0.6, 2.1, 1.6});
    s.add(element(-1, {{0, 0, 0}}, {0.5}), {-1.2, 1.3, 1.0});
    return s;
}

Scene lubricatedGaussians(MobilityForce::Boundary boundary) {
    Scene s;
    s.name = string("two spheres of ForceCoupling with lubrication, ") + boundaryName(boundary);
    s.force = make_shared<MobilityForce>();
    s.force->setViscosity(s.viscosity);
    s.force->setModel(MobilityForce::ForceCoupling);
    s.force->setBoundary(boundary);
    s.force->setLubrication(true);
    s.force->setLubricationReach(2.3, 3);
    s.force->setSolverTolerance(1e-6);
    s.force->setChannelWalls(0, 4.2);
    s.box = {OpenMM::Vec3(5, 0, 0), OpenMM::Vec3(0, 5, 0), OpenMM::Vec3(0, 0, 5)};
    s.add(element(0, {{0, 0, 0}}, {1}), {0, 1.15, 1.15}, {0.5, 0.2, 0});
    s.add(element(1, {{0, 0, 0}}, {0.8}), {1.8, 1.3, 1.55}, {0.1, 0.4, 0});
    return s;
}

/** Two particles near the walls of a boundary. */

static Scene betweenPlanes(MobilityForce::Model model, MobilityForce::Boundary boundary) {
    Scene s;
    s.name = string("two particles of ") + modelName(model) + ", " + boundaryName(boundary);
    s.force = make_shared<MobilityForce>();
    s.force->setViscosity(s.viscosity);
    s.force->setModel(model);
    s.force->setBoundary(boundary);
    s.force->setChannelWalls(0, 2.6);
    s.box = {OpenMM::Vec3(3, 0, 0), OpenMM::Vec3(0, 3.1, 0), OpenMM::Vec3(0, 0, 5)};
    s.onGrid = s.matrixFree = true;
    return s;
}

Scene gaussiansBetweenPlanes(MobilityForce::Boundary boundary) {
    Scene s = betweenPlanes(MobilityForce::ForceCoupling, boundary);
    s.force->setSolverTolerance(1e-5);
    s.add(element(-1, {{0, 0, 0}}, {0.9}), {0.31, 0.42, 1.03});
    s.add(element(-1, {{0, 0, 0}}, {0.9}), {1.72, 1.9, 1.61});
    s.elements[1].particles = {1};  // with random numbers of its own
    return s;
}

Scene surfacesBetweenPlanes(MobilityForce::Boundary boundary) {
    Scene s = betweenPlanes(MobilityForce::RotnePragerYamakawa, boundary);
    s.withoutField = true;
    s.force->setSolverTolerance(1e-5);
    s.add(element(0, {{0, 0, 0}}, {0.9}), {0.31, 0.42, 1.03}, {0.5, 0.2, 0});
    s.add(element(-1, {{0, 0, 0}}, {0.9}), {1.72, 1.9, 1.61});
    return s;
}

Scene spheresUnbounded() {
    Scene s;
    s.name = "spheres and a free particle, unbounded";
    s.add(element(0, {{0, 0, 0}}, {1}), {0, 0, 0}, {0.5, 0.2, 0});
    s.add(element(1, {{0, 0, 0}}, {0.6}), {1.1, 0.4, -0.5}, {0.1, 0.4, 0});
    s.add(element(2, {{0, 0, 0}}, {0.8}), {-1.4, 1.7, 0.4});
    s.add(element(3, {{0, 0, 0}}, {0.3}), {0.4, -0.1, 0.2});
    s.add(element(-1, {{0, 0, 0}}, {0.5}), {0.2, 1.3, 0.3});
    return s;
}

Scene blobsInAField() {
    Scene s;
    s.name = "three blobs and a free particle in a fluid with a random field";
    s.field = true;
    s.add(element(0, threeBlobs, {1, 0.8, 1}), {0, 0, 0}, {0.3, 0.1, -0.5});
    s.add(element(-1, {{0, 0, 0}}, {0.6}), {-0.6, 1.9, 1.0});
    return s;
}

Scene bodyInAChannel() {
    Scene s;
    s.name = "three blobs between slip walls";
    s.channel = true;
    s.add(element(0, threeBlobs, {1, 0.8, 1}), {0, 1.6, 0}, {0.3, 0.1, -0.5});
    return s;
}

Scene aloneOffCentre() {
    Scene s;
    s.name = "one body about a point that is not its centre of mobility, unbounded";
    s.add(element(0, threeBlobs, {1, 1, 1}), {0, 0, 0}, {0.2, 0.7, -0.4});
    return s;
}

Scene slowedRod(bool wall, bool field) {
    Scene s;
    s.name = string("a bent rod with slowed spin beside a sphere") +
             (wall ? ", above a wall" : "") + (field ? ", in a fluid with a random field" : "");
    s.wall = wall;
    s.field = field;
    s.add(element(0, {{0.3, 0.1, -2}, {0.4, 0.3, -0.7}, {0.4, 0.2, 0.8}, {0.3, -0.1, 2}},
                  {0.8, 0.7, 0.8, 0.7}),
          {0, 0, 3.2}, {0.3, 0.6, -0.5});
    SlowedSpin& spin = s.elements[0].spin;
    const MatrixXd alone = s.mobility()->alone(0).mobility;
    spin = findRotation(alone, 1e6).spin;
    EXPECT_TRUE(spin.isSlowed());
    spin.factor = 1 / sqrt(5.0);
    if (!field) s.add(element(1, {{0.1, 0, 0.2}}, {0.9}), {2.6, 1.6, 1.5}, {0, 1, 0.3});
    return s;
}

Scene slowedAlone() {
    Scene s = slowedRod(false, false);
    s.name = "a bent rod with slowed spin, alone";
    s.elements.pop_back();
    s.R.pop_back();
    s.q.pop_back();
    return s;
}

Scene matrixFree(Scene s) {
    s.name += ", matrix-free";
    s.matrixFree = true;
    return s;
}

MatrixXd mobilityAt(const Scene& scene, TestedBodies& bodies, const VectorXd& u) {
    vector<Pose> poses(scene.elements.size());
    for (size_t e = 0; e < poses.size(); e++) {
        const int row = bodies->firstRow(e);
        poses[e].R = scene.R[e] + u.segment<3>(row);
        poses[e].q = scene.q[e];
        if (scene.elements[e].isFree()) continue;
        const Vector3d turn = u.segment<3>(row + 3);
        poses[e].q =
            scalar::exponential(scalar::Vector3<double>{turn.x() / 2, turn.y() / 2, turn.z() / 2}) *
            scene.q[e];
    }
    bodies.setPoses(poses);
    return bodies.mobility();
}

// ---- Steps

VectorXd displacementOf(const OverdampedMove& move, const CoupledBodies& bodies) {
    VectorXd u = VectorXd::Zero(bodies.getNumRows());
    for (size_t e = 0; e < move.start.size(); e++) {
        const int row = bodies.firstRow(e);
        u.segment<3>(row) = move.present[e].R - move.start[e].R;
        if (bodies.getElements()[e].isFree()) continue;
        const Quaternion d = move.present[e].q * scalar::conjugate(move.start[e].q);
        const Eigen::AngleAxisd turn(Eigen::Quaterniond(d.w, d.x, d.y, d.z));
        u.segment<3>(row + 3) = turn.angle() * turn.axis();
    }
    return u;
}

Steps::Steps(Integrator::Scheme s, const Scene& scene, double kT)
    : scene(scene), entry(overdampedScheme(s)), scheme(entry.make()), bodies(scene.mobility()),
      move(scene.matrixFree ? bodies.byProducts() : bodies.byMatrices()) {
    scene.placeIn(move);
    step.kT = kT;
    step.difference = scene.matrixFree ? 3e-3 : 1e-5;
    step.noise.seed = 4711;
    step.noise.law = scene.law;
}

VectorXd Steps::increment(int i, double h) {
    for (OverdampedScheme::Vectors* vectors : scheme->memory()) vectors->resize(0, 0);
    step.h = h;
    step.noise.step = i;
    move.begin(step);
    for (int stage = 0; stage < entry.numStages(); stage++) scheme->run(stage, move);
    return displacementOf(move, *bodies);
}

ExactSteps::ExactSteps(Integrator::Scheme s, const Scene& scene, double kT)
    : StepMoments(s), entry(overdampedScheme(s)), scheme(entry.make()), bodies(scene.mobility()),
      move(scene.matrixFree ? bodies.byProducts() : bodies.byMatrices()) {
    scene.placeIn(move);
    step.kT = kT;
    step.h = 1e-6;
    step.difference = scene.matrixFree ? 3e-3 : 1e-5;
    TestedGridFluid::startList();
    ExactSteps::take({});
    TestedGridFluid::endList();
    findNumbers(move);
}

VectorXd ExactSteps::take(const RandomNumbers& values) {
    setNumbers(move, values);
    for (OverdampedScheme::Vectors* vectors : scheme->memory()) vectors->resize(0, 0);
    move.begin(step);
    for (int stage = 0; stage < entry.numStages(); stage++) scheme->run(stage, move);
    endNumbers();
    return displacementOf(move, *bodies) / step.h;
}

// ---- Means

double errorOfDrift(Integrator::Scheme scheme, const Scene& scene) {
    if (scheme == Integrator::DriftCorrectorFD) return scene.matrixFree ? 1e-2 : 1e-3;
    return scene.matrixFree ? 1e-3 : 3e-4;
}

void checkSampledMean(const VectorXd& expected, double h,
                      const function<VectorXd(int k, double h)>& takeStep) {
    const double size = expected.norm(), shortness = 1e-8;
    ASSERT_GT(size, 0);
    Sampling sampling(expected / size);
    Averages found;
    const int block = 100, most = 200000;  // so many that errors are known to a few per cent
    do {
        for (int i = 0; i < block; i++) {
            const int k = sampling.samples;
            sampling.add(takeStep(k, h) - takeStep(k, shortness * h) / sqrt(shortness));
        }
        found = sampling.averages();
    } while (sampling.samples < most && (sampling.samples < 4 * block ||
                                         (!isInstrumented() && (found.alongError > 0.1 * size ||
                                                                found.error.norm() > 0.4 * size))));
    ASSERT_LT(sampling.samples, most);
    EXPECT_LT(abs(found.along - size), 5 * found.alongError + 1e-3 * size);
    for (int i = 0; i < expected.size(); i++)
        EXPECT_LT(abs(found.mean[i] - expected[i]), 5 * found.error[i] + 1e-3 * size)
            << "row " << i;
}

}  // namespace RigidHITest
