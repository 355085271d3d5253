// One step of the schemes without momenta: its stochastic drift, its covariance, and its order
// without noise.

#include <Eigen/Geometry>

#include "CoupledBodiesSupport.h"
#include "HydrodynamicSupport.h"
#include "Instrumented.h"
#include "RandomFieldModel.h"
#include "StepMoments.h"
#include "TestSupport.h"
#include "mobility/MobilityDecorator.h"
#include "mobility/Models.h"
#include "mobility/models/lubricated/LubricatedMobility.h"
#include "mobility/models/periodic/PeriodicMobility.h"
#include "mobility/models/rotneprager/RotnePragerYamakawa.h"
#include "mobility/models/stokesian/StokesianDynamics.h"
#include "mobility/models/wall/RotnePragerYamakawaWall.h"
#include "mobility/models/wall/SlipChannel.h"
#include "mobility/models/wall/SphereWall.h"
#include "schemes/OverdampedSchemes.h"

using namespace RigidHIPlugin;
using namespace RigidHITest;
using namespace std;

namespace {

using Integrator = CustomRigidHIIntegrator;
using Quaternion = scalar::Quaternion<double>;

const vector<Integrator::Scheme> overdampedSchemes = [] {
    vector<Integrator::Scheme> found;
    for (const SchemeTraits& traits : schemeTable)
        if (traits.isOverdamped()) found.push_back(traits.scheme);
    return found;
}();

FluidElement element(int body, const vector<Vector3d>& sites, const vector<double>& radii) {
    FluidElement e;
    e.body = body;
    e.sites = sites;
    e.radii = radii;
    for (size_t i = 0; i < sites.size(); i++) e.particles.push_back(10 * (body + 1) + i);
    return e;
}

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

/** Bodies at positions, in the form in which schemes take them. */
struct Scene {
    string name;
    vector<FluidElement> elements;
    vector<Vector3d> R;
    vector<Quaternion> q;
    NoiseStream::Law law = NoiseStream::Gaussian;
    bool wall = false, matrixFree = false, bestKnown = false, stokesian = false, field = false,
         inBox = false, gaussians = false, channel = false, lubricated = false;
    double viscosity = 1 / (6 * M_PI);
    shared_ptr<MobilityForce> force;  // the fluid, where a user's settings make it
    // With `force`: on a grid, where it may also have matrices, and without its random field
    bool onGrid = false, withoutField = false;
    BoxVectors box = {};
    void add(const FluidElement& e, const Vector3d& at, const Vector3d& turn = Vector3d::Zero()) {
        elements.push_back(e);
        R.push_back(at);
        q.push_back(
            scalar::exponential(scalar::Vector3<double>{turn.x() / 2, turn.y() / 2, turn.z() / 2}));
    }
    void placeIn(OverdampedMove& move) const {
        for (size_t e = 0; e < elements.size(); e++) {
            move.start[e].R = R[e];
            move.start[e].q = q[e];
        }
    }
    /** Lubrication above the wall, of which a part has its taper. */
    unique_ptr<MobilityModel> withLubrication(const HydrodynamicParticles& particles) const {
        LubricationScene own;
        own.reach = {2.3, 3};
        if (wall) own.low = 0;
        unique_ptr<MobilityModel> model;
        if (wall)
            model =
                make_unique<RotnePragerYamakawaWall>(particles, viscosity, NoSlipPlane(0, false));
        else
            model = make_unique<RotnePragerYamakawa>(particles, viscosity);
        return make_unique<LubricatedMobility>(particles, viscosity, overSurfaces(), own,
                                               move(model));
    }
    unique_ptr<MobilityModel> ofForce(const HydrodynamicParticles& particles) const {
        MobilityScene scene;
        scene.onGrid = onGrid;
        PlatformModels own;
        own.gridFluid = [] { return make_shared<TestedGridFluid>(); };
        unique_ptr<MobilityModel> model = createMobility(*force, scene, particles, own);
        if (!withoutField) return model;
        return make_unique<WithoutField>(particles, viscosity, move(model));
    }
    CoupledBodies::ModelFactory factory() const {
        return [this](const HydrodynamicParticles& particles) -> unique_ptr<MobilityModel> {
            if (force) return ofForce(particles);
            if (lubricated) return withLubrication(particles);
            if (stokesian) return make_unique<StokesianDynamics>(particles, viscosity, true, 0);
            if (field) return make_unique<RandomFieldModel>(particles);
            if (channel)
                return make_unique<SlipChannel>(particles, viscosity, SlipWalls{-1.2, 4.2, false},
                                                make_unique<PeriodicForceCoupling>(
                                                    SlipChannel::withImages(particles), viscosity));
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
    TestedBodies mobility() const {
        TestedBodies bodies(elements, factory(), true, 1e-8);
        if (inBox)
            bodies->setBox(
                {OpenMM::Vec3(5, 0, 0), OpenMM::Vec3(1, 5.5, 0), OpenMM::Vec3(-2, 0.5, 6)});
        if (force) bodies->setBox(box);
        if (channel)
            bodies->setBox({OpenMM::Vec3(4, 0, 0), OpenMM::Vec3(0, 7, 0), OpenMM::Vec3(0, 0, 4.2)});
        return bodies;
    }
};

const vector<Vector3d> threeBlobs = {{-1, 0, 0}, {1.2, 0.5, 0.3}, {0.2, -1.4, 1.1}};

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
MatrixXd ownTensor(int seed) {
    const MatrixXd m = tensorWithoutSymmetry(seed);
    return m / (m.trace() / 6);
}
/** Bodies with own tensors, which enter by congruence: N = B N_RPY B^T, B not symmetric. */
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
/** Rotne-Prager-Yamakawa with lubrication of pairs and of the wall; a multiblob and a free particle
 * have none. */
Scene lubricatedBodiesAtWall() {
    Scene s = threeBodiesAtWall();
    s.name += ", with lubrication";
    s.lubricated = true;
    s.add(element(2, {{0, 0, 0}}, {0.8}), {3.4, -0.1, 1.3});
    return s;
}
/** Spheres about their centres, as products need them. */
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
/** Spheres of ForceCoupling near the walls of a boundary, with lubrication of pairs and of walls.
 */
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
/** Two particles near the walls of a boundary: one at the lower wall, one at the upper. */
Scene betweenPlanes(MobilityForce::Model model, MobilityForce::Boundary boundary) {
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
/** With the random field of the grid. Particles without torques have coarser grids. */
Scene gaussiansBetweenPlanes(MobilityForce::Boundary boundary) {
    Scene s = betweenPlanes(MobilityForce::ForceCoupling, boundary);
    s.force->setSolverTolerance(1e-5);
    s.add(element(-1, {{0, 0, 0}}, {0.9}), {0.31, 0.42, 1.03});
    s.add(element(-1, {{0, 0, 0}}, {0.9}), {1.72, 1.9, 1.61});
    s.elements[1].particles = {1};  // with random numbers of its own
    return s;
}
/** With roots of products on the grid. */
Scene surfacesBetweenPlanes(MobilityForce::Boundary boundary) {
    Scene s = betweenPlanes(MobilityForce::RotnePragerYamakawa, boundary);
    s.withoutField = true;
    s.force->setSolverTolerance(1e-5);
    s.add(element(0, {{0, 0, 0}}, {0.9}), {0.31, 0.42, 1.03}, {0.5, 0.2, 0});
    s.add(element(-1, {{0, 0, 0}}, {0.9}), {1.72, 1.9, 1.61});
    return s;
}
/** Unequal spheres that overlap, one of them inside another, and a free particle. */
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
/** A bent rod about a point off its line, whose spin is slowed to a fifth of its rate. */
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
/** As slowedRod(), alone in an unbounded fluid. */
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

Matrix3d rotationMatrix(const Quaternion& q) {
    return Eigen::Quaterniond(q.w, q.x, q.y, q.z).toRotationMatrix();
}

/** N at the poses to which the twist vector `u` leads from the poses of the scene. */
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

/**
 * The displacement of one step, as a twist times time: translations, and rotation vectors in the
 * lab frame.
 */
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

/** Steps of a scheme that all start from the poses of the scene. Each step has its own random
 * numbers. */
struct Steps {
    const Scene& scene;
    const OverdampedEntry& entry;
    const unique_ptr<OverdampedScheme> scheme;
    TestedBodies bodies;
    OverdampedMove move;
    OverdampedStep step;

    Steps(Integrator::Scheme s, const Scene& scene, double kT)
        : scene(scene), entry(overdampedScheme(s)), scheme(entry.make()), bodies(scene.mobility()),
          move(scene.matrixFree ? bodies.byProducts() : bodies.byMatrices()) {
        scene.placeIn(move);
        step.kT = kT;
        step.difference = scene.matrixFree ? 3e-3 : 1e-5;
        step.noise.seed = 4711;
        step.noise.law = scene.law;
    }
    /**
     * The displacement of step i. It is the first of a run, so data that a scheme keeps from
     * earlier steps are cleared.
     */
    VectorXd increment(int i, double h) {
        for (OverdampedScheme::Vectors* vectors : scheme->memory()) vectors->resize(0, 0);
        step.h = h;
        step.noise.step = i;
        move.begin(step);
        for (int stage = 0; stage < entry.numStages(); stage++) scheme->run(stage, move);
        return displacementOf(move, *bodies);
    }
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

/** The mean and the covariance of a step's displacement over h, without sampling. */
struct ExactSteps : StepMoments {
    const OverdampedEntry& entry;
    const unique_ptr<OverdampedScheme> scheme;
    TestedBodies bodies;
    TestedMove move;
    OverdampedStep step;

    ExactSteps(Integrator::Scheme s, const Scene& scene, double kT)
        : StepMoments(s), entry(overdampedScheme(s)), scheme(entry.make()),
          bodies(scene.mobility()),
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
    VectorXd take(const RandomNumbers& values) override {
        setNumbers(move, values);
        for (OverdampedScheme::Vectors* vectors : scheme->memory()) vectors->resize(0, 0);
        move.begin(step);
        for (int stage = 0; stage < entry.numStages(); stage++) scheme->run(stage, move);
        endNumbers();
        return displacementOf(move, *bodies) / step.h;
    }
};

/** The schemes that include the stochastic drift. */
const vector<Integrator::Scheme> consistent = [] {
    vector<Integrator::Scheme> found;
    for (const Integrator::Scheme scheme : overdampedSchemes)
        if (!traitsOf(scheme).omitsDrift()) found.push_back(scheme);
    return found;
}();

/**
 * Bounds of relative errors of means: those of differences, whose steps are 1e-5, and 3e-3 where
 * products have errors of 1e-8. They are of the second order in the step, but of the first with
 * DriftCorrectorFD, which takes the difference at one side.
 */
double errorOfDrift(Integrator::Scheme scheme, const Scene& scene) {
    if (scheme == Integrator::DriftCorrectorFD) return scene.matrixFree ? 1e-2 : 1e-3;
    return scene.matrixFree ? 1e-3 : 3e-4;
}

/** @param expected  the mean of `Exact`, without sampling */
template <typename Exact>
void checkMean(const Scene& scene, double kT, const VectorXd& expected,
               const vector<Integrator::Scheme>& schemes = consistent) {
    const double size = expected.norm();
    ASSERT_GT(size, 0);
    for (Integrator::Scheme scheme : schemes)
        EXPECT_LT((Exact(scheme, scene, kT).mean() - expected).norm(),
                  errorOfDrift(scheme, scene) * size)
            << scene.name << ", " << traitsOf(scheme).name;
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

/**
 * The same by sampling, for products with lubrication, where pairs have random numbers of their
 * own. The rest after the leading noise is of order h, and odd powers of sqrt(h) have zero mean. So
 * at this h the bias is h kT N/a^2 = 1e-4 of the drift. Samples are taken until the component along
 * the expected drift is known to a tenth, so that a scheme without drift is 10 errors off, and 5
 * are allowed, and until all rows together are known to 0.4 of it. Instrumented programs, which
 * look for other faults, take the first samples only.
 *
 * @param takeStep  gives sample k of a step of length h, as displacement or flow times h
 */
template <typename TakeStep>
void checkSampledMean(const VectorXd& expected, double h, TakeStep takeStep) {
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
TEST(OverdampedSchemes, FullDriftWithLubricationOfPairsMatrixFree) {
    checkSampledDrift(matrixFree(lubricatedSpheresAtWall()), consistent);
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
    checkSampledCovariance(matrixFree(lubricatedSpheresAtWall()),
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

// ---- The flow of the fluid in a step ----

namespace {

const vector<OpenMM::Vec3> pointsOfFluid = {OpenMM::Vec3(0.4, 1.2, 1.4),
                                            OpenMM::Vec3(1.5, -0.6, 2.1)};

/** The flow at points of the fluid that is made by these shares of a step's flow. */
VectorXd flowAt(BodyMobility& mobility, const FlowOfStep& made, RandomField* field,
                const DrivenFlow* driven = nullptr) {
    Velocities velocities = Velocities::Zero(3, pointsOfFluid.size());
    for (const FlowOfStep::Share& share : made.shares) {
        mobility.setPoses(share.poses, true);
        mobility.flow().addAt(
            mobility.flow().sourcesOf(share.forces, share.movesBodies ? driven : nullptr,
                                      share.movesBodies),
            pointsOfFluid, share.weight, velocities);
    }
    if (made.fieldWeight != 0) field->addFlowAt(pointsOfFluid, made.fieldWeight, velocities);
    return velocities.reshaped();
}

/** Steps whose flow is recorded. */
struct FlowingSteps : Steps {
    const char* name;
    FlowingSteps(Integrator::Scheme s, const Scene& scene, double kT)
        : Steps(s, scene, kT), name(traitsOf(s).name) {}
    /** The flow of step i, times h. */
    VectorXd flow(int i, double h) {
        FlowOfStep made;
        move.recording.flow = &made;
        increment(i, h);
        move.recording.flow = nullptr;
        made.check(name);
        return h * flowAt(move.getMobility(), made, move.getField());
    }
};

/**
 * div N_xQ of the flow at points that a wrench makes, by central differences of the bodies' poses.
 */
VectorXd divergenceOfFlow(const Scene& scene) {
    auto bodies = scene.mobility();
    BodyMobility& mobility = bodies.byMatrices();
    const int n = bodies->getNumRows();
    const double delta = 1e-4;
    VectorXd sum = VectorXd::Zero(3 * pointsOfFluid.size());
    MatrixXd twists, forces;
    for (int k = 0; k < n; k++)
        for (double sign : {1, -1}) {
            mobilityAt(scene, bodies, sign * delta * VectorXd::Unit(n, k));
            const vector<Pose> poses = mobility.getPoses();
            mobility.solve(MatrixXd(VectorXd::Unit(n, k)), twists);
            mobility.getBlobForces(forces);
            FlowOfStep made;
            made.shares.push_back({1, poses, forces, false});
            sum += sign / (2 * delta) * flowAt(mobility, made, nullptr);
        }
    return sum;
}

/** The mean of a step's flow, without sampling. */
struct ExactFlows : ExactSteps {
    const char* name;
    bool whole = true;  // false: only the flow that comes from solves for velocities
    ExactFlows(Integrator::Scheme s, const Scene& scene, double kT)
        : ExactSteps(s, scene, kT), name(traitsOf(s).name) {}
    VectorXd take(const RandomNumbers& values) override {
        FlowOfStep made;
        move.recording.flow = &made;
        ExactSteps::take(values);
        move.recording.flow = nullptr;
        made.check(name);
        if (!whole) {
            // Besides these shares, only thermal slips are recorded.
            made.fieldWeight = 0;
            if (made.shares.size() > 1) made.shares.resize(1);
        }
        return flowAt(move.getMobility(), made, move.getField());
    }
};

/**
 * The mean flow of a step without forces is kT div N_xQ. It is the stochastic drift of a particle
 * at the point, without the fluid's own derivative, because the point stays where it is.
 */
void checkMeanFlow(const Scene& scene) {
    const double kT = 1.3;
    checkMean<ExactFlows>(scene, kT, kT * divergenceOfFlow(scene));
}

/** The same by sampling, where pairs have random numbers of their own. */
void checkSampledMeanFlow(const Scene& scene, const vector<Integrator::Scheme>& schemes) {
    const double h = 1e-4, kT = 1.3;
    const VectorXd expected = kT * h * divergenceOfFlow(scene);
    for (Integrator::Scheme scheme : schemes) {
        SCOPED_TRACE(scene.name + ", " + traitsOf(scheme).name);
        FlowingSteps steps(scheme, scene, kT);
        checkSampledMean(expected, h, [&](int k, double h) { return steps.flow(k, h); });
    }
}

}  // namespace

TEST(OverdampedSchemes, MeanFlowOfOneBodyAboutAnyPoint) { checkMeanFlow(aloneOffCentre()); }
TEST(OverdampedSchemes, MeanFlowOfThreeBlobsAboveAWall) { checkMeanFlow(boomerangAtWall()); }
TEST(OverdampedSchemes, MeanFlowOfRodsUnbounded) { checkMeanFlow(rodsUnbounded()); }
TEST(OverdampedSchemes, MeanFlowWithOwnTensors) { checkMeanFlow(ownTensors()); }
TEST(OverdampedSchemes, MeanFlowWithARandomField) { checkMeanFlow(blobsInAField()); }
TEST(OverdampedSchemes, MeanFlowWithLubricationOfPairs) {
    checkMeanFlow(lubricatedSpheresAtWall());
}
/** Only this scheme is sampled here, with two spheres; the others would take minutes. */
TEST(OverdampedSchemes, MeanFlowWithLubricationOfPairsMatrixFree) {
    Scene scene = lubricatedSpheresAtWall();
    scene.elements.erase(scene.elements.begin() + 2);
    scene.R.erase(scene.R.begin() + 2);
    scene.q.erase(scene.q.begin() + 2);
    checkSampledMeanFlow(matrixFree(scene), {Integrator::TractionEulerMaruyama});
}
TEST(OverdampedSchemes, FullMeanFlowWithLubricationOfPairsMatrixFree) {
    checkSampledMeanFlow(matrixFree(lubricatedSpheresAtWall()), consistent);
}
TEST(OverdampedSchemes, MeanFlowWithLubrication) { checkMeanFlow(stokesianSpheres()); }

/**
 * Without the random flow, the flow of the forces that keep bodies rigid has another mean, because
 * the random flow is correlated with nu.
 */
TEST(OverdampedSchemes, MeanFlowNeedsTheRandomFlow) {
    const double kT = 1.3;
    for (const Scene& scene : {boomerangAtWall(), blobsInAField()}) {
        const VectorXd expected = kT * divergenceOfFlow(scene);
        ExactFlows flows(Integrator::DriftCorrectorFD, scene, kT);
        flows.whole = false;
        EXPECT_GT((flows.mean() - expected).norm(), 0.1 * expected.norm()) << scene.name;
    }
}

/**
 * Spheres have no Brownian stress, because the flow of a force has no divergence, neither with
 * respect to the position of the force nor to the point. The mean flow is therefore that of forces
 * alone. With slips of the mid-point instead of those of the start, the drift correctors would have
 * a mean of 0.01 in row 3.
 */
TEST(OverdampedSchemes, MeanFlowOfSpheresIsThatOfForces) {
    Scene scene;
    scene.add(element(0, {{0, 0, 0}}, {0.9}), {0, 0, 0});
    scene.add(element(1, {{0, 0, 0}}, {0.8}), {1.4, 0.7, 0.5});
    scene.add(element(-1, {{0, 0, 0}}, {0.6}), {-0.6, 1.9, 1.0});
    EXPECT_LT(divergenceOfFlow(scene).norm(), 1e-8);
    for (Integrator::Scheme scheme : overdampedSchemes)
        for (bool iterate : {false, true})
            EXPECT_LT(ExactFlows(scheme, iterate ? matrixFree(scene) : scene, 1).mean().norm(),
                      iterate ? 3e-4 : 3e-5)
                << traitsOf(scheme).name << (iterate ? ", matrix-free" : "");
}

TEST(OverdampedSchemes, SayWhatTheirFlowIs) {
    // Each solve for velocities is recorded once. FlowingSteps::flow() checks this too, with noise.
    for (Integrator::Scheme scheme : overdampedSchemes)
        for (bool whole : {false, true})
            for (double kT : {0.0, 1.0}) {
                const Scene scene = threeBodiesAtWall();
                FlowingSteps steps(scheme, scene, kT);
                steps.step.driftFactorScalesAll = whole;
                FlowOfStep made;
                steps.move.recording.flow = &made;
                steps.increment(0, 0.01);
                EXPECT_NO_THROW(made.check(traitsOf(scheme).name)) << traitsOf(scheme).name;
                EXPECT_NEAR(made.solveWeight, made.flowWeight, 1e-14);
                if (kT == 0) {
                    EXPECT_EQ(made.flowWeight, 1);
                }
            }
    FlowOfStep forgotten;
    expectError(
        [&] { forgotten.check("Forgetful"); },
        {"the scheme Forgetful does not record the flow of its step completely",
         "its solves for velocities in this flow add up to 0.000000, and must add up to 1.000000",
         "give each such solve its weight"});
}
