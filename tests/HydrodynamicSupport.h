#ifndef RIGIDHI_HYDRODYNAMIC_SUPPORT_H_
#define RIGIDHI_HYDRODYNAMIC_SUPPORT_H_

// Hydrodynamic tests compare with this second implementation of Rotne-Prager-Yamakawa tensors and
// rigid multiblobs. It follows the textbook, without regard for speed, and does not use
// platforms/common. The only exception is the contribution of a wall; TestRotnePragerYamakawaWall
// compares this contribution with averages of Blake's solution over spheres.

#include <Eigen/Dense>
#include <Eigen/Geometry>
#include <cmath>
#include <functional>
#include <memory>
#include <random>
#include <sstream>
#include <vector>

#include "TestSupport.h"
#include "linearalgebra/Decompositions.h"
#include "mobility/models/wall/RotnePragerYamakawaWall.h"
#include "openmmrigidhi/MobilityForce.h"

namespace RigidHITest {

using RigidHIPlugin::MobilityForce;

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

Matrix3d cross(const Vector3d& v);

/** The pair mobility of Wajnryb et al. 2013 without a wall: velocities of i (rows V, W) from force
 * and torque on j, r = r_i - r_j. */
MatrixXd pairOfSpheres(double a_i, double a_j, const Vector3d& r, double eta);

/** A body (or free particle) as the fluid sees it, in the lab frame. */
struct LabBody {
    Vector3d R = Vector3d::Zero();
    std::vector<Vector3d> offsets;  // of its hydrodynamic particles from R
    std::vector<double> radii;
    bool isFree = false;

    bool isSphere() const { return !isFree && radii.size() == 1; }
    int rows() const { return isFree ? 3 : 6; }
    bool isLine() const;
};

/**
 * The friction K^T M^-1 K, and the mobility. The mobility is the inverse of the friction on the
 * twists that do not turn collinear bodies about their lines.
 */
struct IndependentMobility {
    MatrixXd friction, mobility;
    MatrixXd following;  // mobility K^T M^-1: twists of bodies without forces from slips (surface
                         // velocities) of their particles
    /** @param wall  null: no wall */
    IndependentMobility(const std::vector<LabBody>& bodies, double eta,
                        const RigidHIPlugin::NoSlipPlane* wall = nullptr);
};

/** The largest difference of entries, relative to the largest entry. */
double difference(const MatrixXd& a, const MatrixXd& b);

/** The matrix with its blocks of three rows and columns turned by A. */
MatrixXd turned(const MatrixXd& m, const Matrix3d& A);

/** A positive definite 6 x 6 matrix without any further symmetry. Its translational part is about
 * 1, the rotational one about 2. */
MatrixXd tensorWithoutSymmetry(int seed);

/** The square matrix with these numbers row after row, as MobilityForce gives and takes it. */
MatrixXd squareOf(const std::vector<double>& numbers);
std::vector<double> rowsOf(const MatrixXd& m);

inline Vector3d toEigen(const Vec3& v) { return Vector3d(v[0], v[1], v[2]); }
inline Vec3 toVec3(const Vector3d& v) { return Vec3(v[0], v[1], v[2]); }
Matrix3d rotationOf(const QuaternionArray& q);

/** A body with mass, moments and sites in its body frame. Sites of radius 0 are markers. */
struct BodyKind {
    std::string name;
    double mass;
    Vec3 moments;
    std::vector<Vec3> sites;
    std::vector<double> radii;
};
BodyKind sphereKind(double radius, double mass = 1, double moment = 0.4);
/** A multiblob without symmetry, whose moments are not in ascending order. */
BodyKind boomerangKind();
/** Three blobs on the z axis, about which the body has no inertia. */
BodyKind rodKind();

/** Bodies and free particles in a fluid. */
struct FluidScene {
    OpenMM::System system;
    MobilityForce* fluid = new MobilityForce();  // owned by the System; null after removeFluid()
    CustomRigidHIIntegrator integrator;
    std::unique_ptr<OpenMM::Context> context;
    std::vector<BodyKind> bodies;
    std::vector<std::vector<int>> particles;  // of each body
    std::vector<int> freeParticles;
    std::vector<Vec3> positions;  // of all particles
    double side = 13;             // of the cubic box of a periodic fluid; before start()
    double boxHeight = 0;         // length of its third vector; 0: that of its side
    double shear = 0;             // x of its third vector, which makes it triclinic

    explicit FluidScene(double temperature = 0, double h = 0.01) : integrator(temperature, h) {
        system.addForce(fluid);
        fluid->setViscosity(0.6);
        integrator.setScheme(CustomRigidHIIntegrator::LangevinHI);
        integrator.setRandomNumberSeed(1);
    }
    void add(const BodyKind& kind, const Vec3& R = Vec3(),
             const QuaternionArray& q = {{1, 0, 0, 0}});
    void addFree(double mass, double radius, const Vec3& x);
    /** The box and bonds of a periodic fluid; start() calls it if the fluid is periodic. */
    void bind();
    void start(OpenMM::Platform& platform, int threadCount = 1);
    /** Move all bodies. */
    void pose(const std::vector<Vec3>& R, const std::vector<QuaternionArray>& q) {
        integrator.setBodyPositions(R);
        integrator.setBodyOrientations(q);
    }
    /** Positions and velocities of all particles. */
    VectorXd state();
    MatrixXd mobility();
    MatrixXd friction();
    /** The bodies, then the free particles that the fluid sees, at the present poses. */
    std::vector<LabBody> labBodies();
    bool isPeriodic() const { return fluid && fluid->usesPeriodicBoundaryConditions(); }
    /** Removes the fluid from the scene. */
    void removeFluid() {
        system.removeForce(0);
        fluid = nullptr;
    }
    /** The mobility that RotnePragerYamakawa must give. */
    IndependentMobility expected(const std::vector<LabBody>& bodies);
    IndependentMobility expected();

private:
    std::vector<Vec3> places;
    std::vector<QuaternionArray> turns;
};

/**
 * Make the same scene four times, once with two threads. Two of the scenes run through `before`,
 * where anything may happen, and one of these goes on for the given number of steps. The remaining
 * two load a checkpoint and an XML State of the other one, and must then go on to the same bits.
 */
template <class Scene>
void expectToResumeBitForBit(const std::function<std::unique_ptr<Scene>(int threads)>& start,
                             const std::function<void(Scene&)>& before, int numSteps);

/** n random places in a cube, no two nearer than `apart` if this is positive. */
std::vector<Vec3> randomPlaces(int n, double size, double apart, std::mt19937& random);
std::vector<QuaternionArray> randomTurns(int n, std::mt19937& random);

void saveState(OpenMM::Context& context, std::stringstream& checkpoint, std::stringstream& xml);
void loadState(OpenMM::Context& context, std::stringstream& xml);

template <class Scene>
void expectToResumeBitForBit(const std::function<std::unique_ptr<Scene>(int threads)>& start,
                             const std::function<void(Scene&)>& before, int numSteps) {
    const auto once = start(1), twice = start(1), third = start(2), fourth = start(1);
    before(*once);
    before(*twice);
    std::stringstream checkpoint, xml;
    saveState(*twice->context, checkpoint, xml);
    once->integrator.step(numSteps);
    third->context->loadCheckpoint(checkpoint);
    third->integrator.step(numSteps);
    EXPECT_EQ(third->state(), once->state());
    fourth->integrator.step(1);
    loadState(*fourth->context, xml);
    fourth->integrator.step(numSteps);
    EXPECT_EQ(fourth->state(), once->state());
}

}  // namespace RigidHITest

#endif
