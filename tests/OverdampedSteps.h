#ifndef RIGIDHI_OVERDAMPED_STEPS_H_
#define RIGIDHI_OVERDAMPED_STEPS_H_

// Scenes of bodies in a fluid, and single steps of the schemes without momenta that start from
// them: with random numbers, or with means and covariances without sampling.

#include <Eigen/Geometry>
#include <cmath>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "CoupledBodiesSupport.h"
#include "HydrodynamicSupport.h"
#include "Instrumented.h"
#include "RandomFieldModel.h"
#include "StepMoments.h"
#include "TestSupport.h"
#include "schemes/OverdampedSchemes.h"

namespace RigidHITest {

using Integrator = RigidHIPlugin::CustomRigidHIIntegrator;
using Quaternion = RigidHIPlugin::scalar::Quaternion<double>;

inline const std::vector<Integrator::Scheme> overdampedSchemes = [] {
    std::vector<Integrator::Scheme> found;
    for (const RigidHIPlugin::SchemeTraits& traits : RigidHIPlugin::schemeTable)
        if (traits.isOverdamped()) found.push_back(traits.scheme);
    return found;
}();
/** The schemes that include the stochastic drift. */
inline const std::vector<Integrator::Scheme> consistent = [] {
    std::vector<Integrator::Scheme> found;
    for (const Integrator::Scheme scheme : overdampedSchemes)
        if (!RigidHIPlugin::traitsOf(scheme).omitsDrift()) found.push_back(scheme);
    return found;
}();

// ---- Scenes

RigidHIPlugin::FluidElement element(int body, const std::vector<Vector3d>& sites,
                                    const std::vector<double>& radii);

/** Bodies at positions, in the form in which schemes take them. */
struct Scene {
    std::string name;
    std::vector<RigidHIPlugin::FluidElement> elements;
    std::vector<Vector3d> R;
    std::vector<Quaternion> q;
    RigidHIPlugin::NoiseStream::Law law = RigidHIPlugin::NoiseStream::Gaussian;
    bool wall = false, matrixFree = false, bestKnown = false, stokesian = false, field = false,
         inBox = false, gaussians = false, channel = false, lubricated = false;
    double viscosity = 1 / (6 * M_PI);
    std::shared_ptr<MobilityForce> force;  // the fluid, where a user's settings make it
    // With `force`: on a grid, where it may also have matrices, and without its random field
    bool onGrid = false, withoutField = false;
    RigidHIPlugin::BoxVectors box = {};

    void add(const RigidHIPlugin::FluidElement& e, const Vector3d& at,
             const Vector3d& turn = Vector3d::Zero());
    void placeIn(RigidHIPlugin::OverdampedMove& move) const;
    RigidHIPlugin::CoupledBodies::ModelFactory factory() const;
    TestedBodies mobility() const;

private:
    std::unique_ptr<RigidHIPlugin::MobilityModel> withLubrication(
        const RigidHIPlugin::HydrodynamicParticles& particles) const;
    std::unique_ptr<RigidHIPlugin::MobilityModel> ofForce(
        const RigidHIPlugin::HydrodynamicParticles& particles) const;
};

inline const std::vector<Vector3d> threeBlobs = {{-1, 0, 0}, {1.2, 0.5, 0.3}, {0.2, -1.4, 1.1}};

Scene boomerangAtWall();
Scene threeBodiesAtWall();
Scene rodsUnbounded();
Scene lubricatedSpheres();
/** Bodies with own tensors, which enter by congruence: N = B N_RPY B^T, B not symmetric. */
Scene ownTensors();
Scene stokesianSpheres();
/**
 * Rotne-Prager-Yamakawa with lubrication of pairs and of the wall; a multiblob and a free particle
 * have none.
 */
Scene lubricatedBodiesAtWall();
/** Spheres about their centres and a free particle. */
Scene lubricatedSpheresAtWall();
/**
 * lubricatedBodiesAtWall() with a sphere and the free particle held, and another sphere that
 * neither rises nor turns about y.
 */
Scene lubricatedBodiesBesideHeldOnes();
/**
 * Spheres of ForceCoupling near the walls of a boundary, with lubrication of pairs and of walls.
 */
Scene lubricatedGaussians(MobilityForce::Boundary boundary);
/**
 * Two particles near the walls of a boundary, one at the lower wall, one at the upper, with the
 * random field of the grid. Particles without torques have coarser grids.
 */
Scene gaussiansBetweenPlanes(MobilityForce::Boundary boundary);
/** The same with roots of products on the grid. */
Scene surfacesBetweenPlanes(MobilityForce::Boundary boundary);
/** Unequal spheres that overlap, one of them inside another, and a free particle. */
Scene spheresUnbounded();
Scene blobsInAField();
Scene bodyInAChannel();
Scene aloneOffCentre();
/** A bent rod about a point off its line, whose spin is slowed to a fifth of its rate. */
Scene slowedRod(bool wall, bool field);
/** As slowedRod(), alone in an unbounded fluid. */
Scene slowedAlone();
Scene matrixFree(Scene s);

/** N at the poses to which the twist vector `u` leads from the poses of the scene. */
MatrixXd mobilityAt(const Scene& scene, TestedBodies& bodies, const VectorXd& u);

// ---- Steps

/**
 * The displacement of one step, as a twist times time: translations, and rotation vectors in the
 * lab frame.
 */
VectorXd displacementOf(const RigidHIPlugin::OverdampedMove& move,
                        const RigidHIPlugin::CoupledBodies& bodies);

/** Steps of a scheme that all start from the poses of the scene. Each has its own random numbers.
 */
struct Steps {
    const Scene& scene;
    const RigidHIPlugin::OverdampedEntry& entry;
    const std::unique_ptr<RigidHIPlugin::OverdampedScheme> scheme;
    TestedBodies bodies;
    RigidHIPlugin::OverdampedMove move;
    RigidHIPlugin::OverdampedStep step;

    Steps(Integrator::Scheme s, const Scene& scene, double kT);
    /**
     * The displacement of step i. It is the first of a run, so data that a scheme keeps from
     * earlier steps are cleared.
     */
    VectorXd increment(int i, double h);
};

/** The mean and the covariance of a step's displacement over h, without sampling. */
struct ExactSteps : StepMoments {
    const RigidHIPlugin::OverdampedEntry& entry;
    const std::unique_ptr<RigidHIPlugin::OverdampedScheme> scheme;
    TestedBodies bodies;
    TestedMove move;
    RigidHIPlugin::OverdampedStep step;

    ExactSteps(Integrator::Scheme s, const Scene& scene, double kT);
    VectorXd take(const RandomNumbers& values) override;
};

// ---- Means

/**
 * Bounds of relative errors of means: those of differences, whose steps are 1e-5, and 3e-3 where
 * products have errors of 1e-8. They are of the second order in the step, but of the first with
 * DriftCorrectorFD, which takes the difference at one side.
 */
double errorOfDrift(Integrator::Scheme scheme, const Scene& scene);

/** @param expected  the mean of `Exact`, without sampling */
template <typename Exact>
void checkMean(const Scene& scene, double kT, const VectorXd& expected,
               const std::vector<Integrator::Scheme>& schemes = consistent) {
    const double size = expected.norm();
    ASSERT_GT(size, 0);
    for (Integrator::Scheme scheme : schemes)
        EXPECT_LT((Exact(scheme, scene, kT).mean() - expected).norm(),
                  errorOfDrift(scheme, scene) * size)
            << scene.name << ", " << RigidHIPlugin::traitsOf(scheme).name;
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
void checkSampledMean(const VectorXd& expected, double h,
                      const std::function<VectorXd(int k, double h)>& takeStep);

}  // namespace RigidHITest

#endif
